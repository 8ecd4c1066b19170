//! Scenes of Mitsuba 0.4 to 0.6 in the words of Mitsuba 3: names of elements, plugins and parameters. What differs in
//! meaning (defaults, gamma, texture coordinates) the plugins' readers know by [`super::xml::Object::old`].

/// What [`modern_name`] would not find by itself.
const NAMES: [(&str, &str); 6] = [
    ("luminaireSamples", "emitter_samples"),
    ("intensityScale", "scale"),
    ("focusDepth", "focus_distance"),
    ("uvscale", "uv_scale"),
    ("uscale", "u_scale"),
    ("vscale", "v_scale"),
];

/// Element, plugin, and what to call it.
const PLUGINS: [(&str, &str, &str); 9] = [
    ("bsdf", "bump", "bumpmap"),
    ("texture", "ldrtexture", "bitmap"),
    ("texture", "exrtexture", "bitmap"),
    ("film", "exrfilm", "hdrfilm"),
    ("film", "pngfilm", "hdrfilm"),
    ("film", "ldrfilm", "hdrfilm"),
    ("film", "tiledhdrfilm", "hdrfilm"),
    ("film", "mfilm", "hdrfilm"),
    ("integrator", "errctrl", "adaptive"),
];

/// Element, and what to call it.
const ELEMENTS: [(&str, &str); 3] = [("lookAt", "lookat"), ("camera", "sensor"), ("luminaire", "emitter")];

/// The second where the first stands.
fn look_up<'a>(table: &[(&str, &'a str)], word: &str) -> Option<&'a str> {
    table.iter().find(|(old, _)| *old == word).map(|(_, new)| *new)
}

pub(super) fn element(tag: &str) -> &str {
    look_up(&ELEMENTS, tag).unwrap_or(tag)
}

pub(super) fn plugin<'a>(tag: &str, plugin: &'a str) -> &'a str {
    PLUGINS.iter().find(|(t, old, _)| (*t, *old) == (tag, plugin)).map_or(plugin, |(.., new)| new)
}

/// lajolla's names of what Burley's model has in Mitsuba 3.
const PRINCIPLED: [(&str, &str); 3] =
    [("specular_transmission", "spec_trans"), ("specular_tint", "spec_tint"), ("subsurface", "flatness")];

/// What Mitsuba 3 calls a bsdf's parameter.
pub(super) fn parameter<'a>(tag: &str, plugin: &str, name: &'a str) -> &'a str {
    match tag == "bsdf" && (plugin == "principled" || plugin.starts_with("disney")) {
        true => look_up(&PRINCIPLED, name).unwrap_or(name),
        false => name,
    }
}

/// Plugin and distribution of names like `roughconductorGGX` or `roughplastic_beckmann`.
pub(super) fn split_distribution<'a>(tag: &str, plugin: &'a str) -> Option<(&'a str, &'static str)> {
    const ROUGH: [&str; 4] = ["roughconductor", "roughdielectric", "roughplastic", "roughcoating"];
    let start = ROUGH.iter().find(|rough| tag == "bsdf" && plugin.starts_with(*rough))?.len();
    let suffix = plugin[start..].trim_start_matches(['_', '-', ' ']);
    let known = ["ggx", "beckmann", "phong", "as"].into_iter().find(|d| suffix.eq_ignore_ascii_case(d));
    Some((&plugin[..start], known?))
}

/// What a parameter is called today.
pub(super) fn name(old: &str) -> String {
    look_up(&NAMES, old).map_or_else(|| snake_case(old), String::from)
}

/// `intIOR` is `int_ior`, `toWorld` is `to_world`, and so on.
pub(super) fn snake_case(old: &str) -> String {
    let mut new = String::with_capacity(old.len() + 4);
    let mut after_small = false;
    for c in old.chars() {
        if c.is_ascii_uppercase() && after_small {
            new.push('_');
        }
        after_small = c.is_ascii_lowercase() || c.is_ascii_digit();
        new.push(c.to_ascii_lowercase());
    }
    new
}

#[cfg(test)]
mod tests {
    #[test]
    fn names() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("diffuseReflectance", "diffuse_reflectance"),
            ("sigmaA", "sigma_a"),
            ("p0", "p0"),
            ("wrapModeU", "wrap_mode_u"),
            ("uscale", "u_scale"),
            ("maxDepth", "max_depth"),
            ("eta", "eta"),
            ("", ""),
        ] {
            assert_eq!(super::name(old), new);
        }
        assert_eq!(super::parameter("bsdf", "disneybsdf", "specular_tint"), "spec_tint");
        assert_eq!(super::parameter("bsdf", "hk", "specular_tint"), "specular_tint");
        for (plugin, expected) in [
            ("roughconductorGGX", Some(("roughconductor", "ggx"))),
            ("roughplastic_beckmann", Some(("roughplastic", "beckmann"))),
            ("roughdielectric-Phong", Some(("roughdielectric", "phong"))),
            ("roughconductor", None),
            ("roughconductors", None),
            ("ggx", None),
        ] {
            assert_eq!(super::split_distribution("bsdf", plugin), expected, "{plugin}");
        }
        assert_eq!(super::split_distribution("shape", "roughconductorGGX"), None);
        assert_eq!(super::plugin("film", "ldrfilm"), "hdrfilm");
        assert_eq!(super::plugin("bsdf", "diffuse"), "diffuse");
        assert_eq!(super::element("lookAt"), "lookat");
    }
}
