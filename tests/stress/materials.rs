//! Materials at the ends of their ranges.

use crate::common::assert_mean;
use crate::{camera, for_all};
use caustica::integrator::Kind;

const SKY: &str = r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;

fn glass(kind: &str, inside: f64, outside: f64, more: &str) -> String {
    format!(
        r#"<bsdf type="{kind}"><float name="int_ior" value="{inside}"/><float name="ext_ior" value="{outside}"/>{more}</bsdf>"#
    )
}

fn ball(radius: f64, bsdf: &str) -> String {
    format!(r#"<shape type="sphere"><float name="radius" value="{radius}"/>{bsdf}</shape>"#)
}

fn alpha(alpha: f64, distribution: &str) -> String {
    format!(r#"<float name="alpha" value="{alpha}"/><string name="distribution" value="{distribution}"/>"#)
}

/// White things cannot be seen under a white sky: what loses no light sends back 1, in all directions.
#[test]
fn white_furnace() {
    let view = camera(20.0, [5.0, 0.1, 0.2], [0.0; 3], 1.0, 0.0);
    let cases = [
        (
            "diffuse, albedo 1",
            ball(1.0, r#"<bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf>"#),
        ),
        ("mirror", ball(1.0, r#"<bsdf type="conductor"/>"#)),
        ("null", ball(1.0, r#"<bsdf type="null"/>"#)),
        ("index 1", ball(1.0, &glass("dielectric", 1.0, 1.0, ""))),
        ("index 1.5", ball(1.0, &glass("dielectric", 1.5, 1.0, ""))),
        ("index 10000", ball(1.0, &glass("dielectric", 1e4, 1.0, ""))),
        ("index 1/10000", ball(1.0, &glass("dielectric", 1.0, 1e4, ""))),
        (
            "bubble",
            ball(1.0, &glass("dielectric", 1.5, 1.0, "")) + &ball(0.8, &glass("dielectric", 1.0, 1.5, "")),
        ),
        (
            "water in glass",
            ball(1.0, &glass("dielectric", 1.5, 1.0, ""))
                + &ball(0.9, &glass("dielectric", 1.33, 1.5, ""))
                + &ball(0.5, &glass("dielectric", 2.4, 1.33, "")),
        ),
        ("glass cube", format!(r#"<shape type="cube">{}</shape>"#, glass("dielectric", 1.5, 1.0, ""))),
        ("thin", ball(1.0, &glass("thindielectric", 1.5, 1.0, ""))),
        // Of so little roughness that facets neither shadow nor scatter twice.
        ("rough glass 1e-4", ball(1.0, &glass("roughdielectric", 1.5, 1.0, &alpha(1e-4, "ggx")))),
        (
            "rough metal 1e-4",
            ball(1.0, &format!(r#"<bsdf type="roughconductor">{}</bsdf>"#, alpha(1e-4, "beckmann"))),
        ),
    ];
    for (name, shapes) in cases {
        for_all(name, &format!("{view}{SKY}{shapes}"), (10, 10), move |view| {
            // Surfaces that only the map shows have the kernel's bias.
            let map = view.what.contains("map") && view.scene.lobes().smooth;
            let bias = if map { 0.03 } else { 1e-3 };
            assert_mean(&view.means(2), 1.0, bias, 0.1, &view.what);
        });
    }
}

/// No material gives more than it gets. Scattering once only, as in Mitsuba's models, rough ones lose light, but hardly any
/// up to a roughness of 0.01. Both integrators see the same of it.
#[test]
fn rough_materials() {
    let view = camera(20.0, [5.0, 0.1, 0.2], [0.0; 3], 1.0, 0.0);
    for distribution in ["ggx", "beckmann"] {
        for a in [1e-4, 1e-2, 0.1, 1.0] {
            let rough = alpha(a, distribution);
            let white = r#"<rgb name="diffuse_reflectance" value="1"/>"#;
            let cases = [
                ("metal", format!(r#"<bsdf type="roughconductor">{rough}</bsdf>"#)),
                ("plastic", format!(r#"<bsdf type="roughplastic">{rough}{white}</bsdf>"#)),
                ("glass", glass("roughdielectric", 1.5, 1.0, &rough)),
                ("glass of index 10000", glass("roughdielectric", 1e4, 1.0, &rough)),
                ("glass of index 1.0001", glass("roughdielectric", 1.0001, 1.0, &rough)),
            ];
            for (name, bsdf) in cases {
                let name = format!("{name} {a} {distribution}");
                for_all(&name, &format!("{view}{SKY}{}", ball(1.0, &bsdf)), (8, 8), move |view| {
                    let path = view.path_mean(64);
                    assert!(
                        path <= 1.01 && path >= if a <= 0.01 { 0.95 } else { 0.0 },
                        "{}: {path}",
                        view.what
                    );
                    // Few photons under a lobe of this roughness: what they show is seldom and bright, and 16 means of
                    // it lie below the expectation more often than not.
                    let (bias, precision) = match view.kind {
                        Kind::Path => (0.02, 0.1),
                        Kind::Photonmap => (0.08, 0.25),
                    };
                    assert_mean(&view.means(2), path, bias, precision, &view.what);
                });
            }
        }
    }
}

/// Black is black.
#[test]
fn albedo_zero() {
    let view = camera(5.0, [5.0, 0.1, 0.2], [0.0; 3], 1.0, 0.0);
    let black = ball(1.0, r#"<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>"#);
    for_all("black", &format!("{view}{SKY}{black}"), (8, 8), |view| {
        assert_eq!(view.render(1, 2).image.pixels.iter().map(|p| p.max_element()).fold(0.0, f32::max), 0.0);
    });
}

/// From within a glass cube, the sky is n² as bright in directions that total reflection does not trap; a mirrored direction
/// keeps the magnitudes of its components, so those with none above cosθ_c never leave, however many segments they have.
#[test]
fn camera_inside_glass() {
    let cube = format!(r#"<shape type="cube">{}</shape>"#, glass("dielectric", 1.5, 1.0, ""));
    for (name, target, expected) in [("out", [1.0, 0.1, 0.05], 2.25), ("trapped", [1.0, 1.1, 0.9], 0.0)] {
        let view = camera(5.0, [0.01, 0.02, 0.03], target, 1.0, 0.0);
        for_all(name, &format!("{view}{SKY}{cube}"), (8, 8), move |view| {
            let means = view.means(2);
            if expected == 0.0 {
                assert!(means.iter().all(|&m| m == 0.0), "{}: {means:?}", view.what);
            } else {
                assert_mean(&means, expected, 1e-4, 0.02, &view.what);
            }
        });
    }
    let ball = ball(1.0, &glass("dielectric", 1.5, 1.0, ""));
    let view = camera(30.0, [0.0; 3], [1.0, 0.2, 0.3], 1.0, 0.0);
    for_all("in a ball", &format!("{view}{SKY}{ball}"), (8, 8), |view| {
        assert_mean(&view.means(2), 2.25, 1e-3, 0.05, &view.what);
    });
}

/// A diffuse plane under the sky looks white from any angle, and as bright as it is lit from a sun at any height.
#[test]
fn grazing() {
    let plane = r#"<shape type="rectangle"><transform name="to_world"><scale value="1000"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>"#;
    // The last way sees photons that are few on so large a plane: it must be sane only.
    let grazing = camera(0.0001, [1.0, 0.0, 1e-4], [0.0; 3], 1.0, 0.0).replace("0.1, 0.2, 1", "0, 0, 1");
    for_all("grazing view", &format!("{grazing}{plane}{SKY}"), (8, 8), |view| {
        match view.what.contains("map") {
            false => assert_mean(&view.means(4), 1.0, 1e-4, 0.05, &view.what),
            true => drop(view.render(1, 2)),
        }
    });
    let above = camera(10.0, [0.0, 0.0, 2.0], [0.0; 3], 1.0, 0.0);
    for slope in [1e-2, 1e-4] {
        let sun = format!(
            r#"<emitter type="directional"><vector name="direction" value="1, 0, {}"/>
                <rgb name="irradiance" value="1"/></emitter>"#,
            -slope
        );
        for_all("grazing light", &format!("{above}{plane}{sun}"), (8, 8), move |view| {
            match view.what.contains("map") {
                false => assert_mean(&view.means(2), slope / std::f64::consts::PI, 1e-3, 0.01, &view.what),
                true => drop(view.render(1, 2)),
            }
        });
    }
}
