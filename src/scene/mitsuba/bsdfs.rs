//! BSDF plugins to materials.

use super::props::Props;
use super::xml::{Property, Value, tokens};
use super::{Loader, disney};
use crate::Result;
use crate::bsdf::{
    Coating, Distribution, Perturbation, PrincipledParams, PrincipledThinParams, RoughCoating, WardVariant,
};
use crate::image_io::Domain;
use crate::math::Rgb;
use crate::scene::ior;
use crate::scene::material::{Material, Roughness};
use crate::scene::spectrum::{Role, Spectrum};
use crate::texture::{Color, Scalar};

const KNOWN: &str = "diffuse, dielectric, thindielectric, roughdielectric, conductor, roughconductor, plastic, \
                     roughplastic, principled, principledthin, phong, ward, roughdiffuse, difftrans, blendbsdf, \
                     normalmap, bumpmap, twosided, mask, null";

impl<'a> Loader<'a> {
    /// The index of the material that a `<bsdf>` stands for.
    pub(super) fn material(&mut self, props: Props<'a>) -> Result<u32> {
        if let Some(index) = self.material_of.get(&props.index) {
            return Ok(*index);
        }
        let material = self.make_material(props)?;
        let index = self.materials.len() as u32;
        self.materials.push(material);
        self.material_of.insert(props.index, index);
        Ok(index)
    }

    /// The material made of an object. Bsdfs may refer to others many times over, so each is made once.
    fn make_material(&mut self, props: Props<'a>) -> Result<Material> {
        if let Some(material) = self.made.get(&props.index) {
            return Ok(material.clone());
        }
        let material = self.nested(props, |loader| loader.new_material(props))?;
        self.made.insert(props.index, material.clone());
        Ok(material)
    }

    fn new_material(&mut self, props: Props<'a>) -> Result<Material> {
        let mut color = |name, default| self.color(props, name, Role::Reflectance, Rgb::splat(default));
        let material = match props.plugin() {
            // Mitsuba 0.6 knows both names.
            "diffuse" if props.object.old && props.has("diffuse_reflectance") => {
                Material::Diffuse { reflectance: color("diffuse_reflectance", 0.5)? }
            }
            "diffuse" => Material::Diffuse { reflectance: color("reflectance", 0.5)? },
            "null" => Material::Null,
            "dielectric" => Material::Dielectric {
                reflectance: color("specular_reflectance", 1.0)?,
                transmittance: color("specular_transmittance", 1.0)?,
                eta: relative_ior(props, "bk7")?,
            },
            "thindielectric" => Material::ThinDielectric {
                reflectance: color("specular_reflectance", 1.0)?,
                transmittance: color("specular_transmittance", 1.0)?,
                eta: relative_ior(props, "bk7")?,
            },
            "roughdielectric" => {
                let eta = relative_ior(props, "bk7")?;
                if eta == 1.0 {
                    return Err(props.error("a roughdielectric needs different indices inside and outside"));
                }
                let reflectance = color("specular_reflectance", 1.0)?;
                let transmittance = color("specular_transmittance", 1.0)?;
                match self.roughness(props)? {
                    Some(roughness) => {
                        Material::RoughDielectric { reflectance, transmittance, roughness, eta }
                    }
                    None => Material::Dielectric { reflectance, transmittance, eta },
                }
            }
            "conductor" => {
                let reflectance = color("specular_reflectance", 1.0)?;
                let (eta, k) = self.complex_ior(props)?;
                Material::Conductor { eta, k, reflectance }
            }
            "roughconductor" => {
                let reflectance = color("specular_reflectance", 1.0)?;
                let (eta, k) = self.complex_ior(props)?;
                match self.roughness(props)? {
                    Some(roughness) => Material::RoughConductor { eta, k, roughness, reflectance },
                    None => Material::Conductor { eta, k, reflectance },
                }
            }
            "plastic" => Material::Plastic {
                diffuse: color("diffuse_reflectance", 0.5)?,
                specular: color("specular_reflectance", 1.0)?,
                nonlinear: props.boolean("nonlinear", false)?,
                coating: Coating::new(relative_ior(props, "polypropylene")?),
            },
            "roughplastic" => {
                let diffuse = color("diffuse_reflectance", 0.5)?;
                let specular = color("specular_reflectance", 1.0)?;
                let eta = relative_ior(props, "polypropylene")?;
                let nonlinear = props.boolean("nonlinear", false)?;
                match rough_coating(props, eta)? {
                    Some(coating) => Material::RoughPlastic { coating, diffuse, specular, nonlinear },
                    None => Material::Plastic { coating: Coating::new(eta), diffuse, specular, nonlinear },
                }
            }
            "principled" => Material::Principled(Box::new(self.principled(props)?)),
            "principledthin" => Material::PrincipledThin(Box::new(self.principled_thin(props)?)),
            plugin if disney::PLUGINS.contains(&plugin) => {
                Material::Principled(Box::new(self.disney(props)?))
            }
            // Of Mitsuba 0.6.
            "phong" => Material::Phong {
                diffuse: color("diffuse_reflectance", 0.5)?,
                specular: color("specular_reflectance", 0.2)?,
                exponent: self.scalar(props, "exponent", 30.0)?,
            },
            "ward" => self.ward(props)?,
            "roughdiffuse" => Material::RoughDiffuse {
                reflectance: color(either(props, "reflectance", "diffuse_reflectance"), 0.5)?,
                alpha: self.scalar(props, "alpha", 0.2)?,
                fast: props.boolean("use_fast_approx", false)?,
            },
            "difftrans" => Material::DiffuseTransmitter {
                transmittance: color(either(props, "transmittance", "diffuse_transmittance"), 0.5)?,
            },
            "twosided" => self.two_sided(props)?,
            "blendbsdf" => {
                if !props.has("weight") {
                    return Err(props.error("a blendbsdf needs a 'weight'"));
                }
                let weight = self.scalar(props, "weight", 0.5)?;
                match <[Material; 2]>::try_from(self.nested_bsdfs(props, 2)?) {
                    Ok(nested) => Material::Blend { weight, nested: nested.map(Box::new) },
                    Err(_) => return Err(props.error("a blendbsdf needs two bsdfs inside")),
                }
            }
            "coating" | "roughcoating" if props.object.old => {
                let specular = color("specular_reflectance", 1.0)?;
                let absorption = self.color(props, "sigma_a", Role::Unbounded, Rgb::ZERO)?;
                let thickness = props.float("thickness", 1.0)?;
                self.check_texels(absorption, Domain::NonNegative, thickness, props.pos("sigma_a"));
                let eta = relative_ior(props, "bk7")?;
                let rough = match props.plugin() {
                    "coating" => None,
                    _ => rough_coating(props, eta)?,
                };
                let nested = self.only_nested_bsdf(props)?;
                if nested.transmits() {
                    return Err(props.error("what transmits light cannot be coated"));
                }
                Material::Coated { eta, specular, absorption, thickness, rough, nested }
            }
            "mixturebsdf" if props.object.old => self.mixture(props)?,
            "normalmap" => {
                let normals = match props.has("filename") {
                    true => Color::Texture(self.own_bitmap(props)?),
                    false => self.color_of(props, self.nested_texture(props)?, Role::Unbounded)?,
                };
                let rules = perturbation(props)?;
                Material::NormalMap { normals, nested: self.only_nested_bsdf(props)?, rules }
            }
            "bumpmap" => {
                let height = match props.has("filename") {
                    true => Scalar::Texture(self.own_bitmap(props)?),
                    false => self.scalar_of(props, self.nested_texture(props)?)?,
                };
                let (scale, rules) = (props.float("scale", 1.0)?, perturbation(props)?);
                Material::BumpMap { height, scale, nested: self.only_nested_bsdf(props)?, rules }
            }
            "mask" => {
                let opacity = self.scalar(props, "opacity", 0.5)?;
                Material::Mask { opacity, nested: self.only_nested_bsdf(props)? }
            }
            _ => return Err(props.unknown_plugin(KNOWN)),
        };
        if matches!(props.plugin(), "phong" | "ward" | "roughdiffuse" | "difftrans")
            && !props.boolean("ensure_energy_conservation", true)?
        {
            let pos = props.pos("ensure_energy_conservation");
            self.warn_at(pos, "'ensure_energy_conservation' has no effect: it is always ensured");
        }
        props.finish()?;
        Ok(material)
    }

    fn ward(&mut self, props: Props<'a>) -> Result<Material> {
        let alpha = self.alpha(props, "alpha", Scalar::Constant(0.1))?;
        Ok(Material::Ward {
            diffuse: self.color(props, "diffuse_reflectance", Role::Reflectance, Rgb::splat(0.5))?,
            specular: self.color(props, "specular_reflectance", Role::Reflectance, Rgb::splat(0.2))?,
            alpha_u: self.alpha(props, "alpha_u", alpha)?,
            alpha_v: self.alpha(props, "alpha_v", alpha)?,
            variant: props.choice(
                "variant",
                WardVariant::Balanced,
                &[
                    ("ward", WardVariant::Ward),
                    ("ward-duer", WardVariant::Duer),
                    ("balanced", WardVariant::Balanced),
                ],
            )?,
        })
    }

    fn principled(&mut self, props: Props<'a>) -> Result<PrincipledParams<Color, Scalar>> {
        let mut unit = |name| self.scalar_up_to(props, name, 0.0, 1.0);
        let spec_trans = unit("spec_trans")?;
        Ok(PrincipledParams {
            anisotropic: unit("anisotropic")?,
            metallic: unit("metallic")?,
            spec_tint: unit("spec_tint")?,
            sheen_tint: unit("sheen_tint")?,
            flatness: unit("flatness")?,
            clearcoat_gloss: unit("clearcoat_gloss")?,
            eta: principled_ior(props, spec_trans != Scalar::Constant(0.0))?,
            spec_trans,
            base_color: self.color(props, "base_color", Role::Reflectance, Rgb::splat(0.5))?,
            roughness: self.scalar(props, "roughness", 0.5)?,
            sheen: self.scalar(props, "sheen", 0.0)?,
            clearcoat: self.scalar(props, "clearcoat", 0.0)?,
            diffuse_rate: sampling_rate(props, "diffuse_reflectance_sampling_rate")?,
            specular_rate: sampling_rate(props, "main_specular_sampling_rate")?,
            clearcoat_rate: sampling_rate(props, "clearcoat_sampling_rate")?,
        })
    }

    fn principled_thin(&mut self, props: Props<'a>) -> Result<PrincipledThinParams<Color, Scalar>> {
        let mut unit = |name| self.scalar_up_to(props, name, 0.0, 1.0);
        Ok(PrincipledThinParams {
            anisotropic: unit("anisotropic")?,
            spec_trans: unit("spec_trans")?,
            spec_tint: unit("spec_tint")?,
            sheen_tint: unit("sheen_tint")?,
            flatness: unit("flatness")?,
            diff_trans: self.scalar_up_to(props, "diff_trans", 0.0, 2.0)?,
            base_color: self.color(props, "base_color", Role::Reflectance, Rgb::splat(0.5))?,
            roughness: self.scalar(props, "roughness", 0.5)?,
            eta: self.scalar(props, "eta", 1.5)?,
            sheen: self.scalar(props, "sheen", 0.0)?,
            diffuse_reflection_rate: sampling_rate(props, "diffuse_reflectance_sampling_rate")?,
            diffuse_transmission_rate: sampling_rate(props, "diffuse_transmittance_sampling_rate")?,
            specular_reflection_rate: sampling_rate(props, "specular_reflectance_sampling_rate")?,
            specular_transmission_rate: sampling_rate(props, "specular_transmittance_sampling_rate")?,
        })
    }

    /// A number that may be textured; not negative, and at most `most` if it is none.
    fn scalar_up_to(
        &mut self,
        props: Props<'a>,
        name: &'static str,
        default: f32,
        most: f32,
    ) -> Result<Scalar> {
        match self.scalar(props, name, default)? {
            // For rounding in luminances.
            Scalar::Constant(x) if x > 1.0001 * most => {
                Err(props.error_at(name, format!("'{name}' is {x}, but must lie in 0..{most}")))
            }
            scalar => Ok(scalar),
        }
    }

    fn two_sided(&mut self, props: Props<'a>) -> Result<Material> {
        // A twosided shows the front of what it holds, so of another twosided it shows that one's front.
        let front_of = |material| match material {
            Material::TwoSided { front, .. } => *front,
            other => other,
        };
        let mut nested = self.nested_bsdfs(props, 2)?.into_iter().map(front_of);
        let Some(front) = nested.next() else { return Err(props.error("a twosided needs a bsdf inside")) };
        let back = nested.next();
        // `allow_transmission` lets Mitsuba nest what transmits, of which it then uses only the reflection.
        if props.boolean("allow_transmission", false)? {
            return Err(props.error_at("allow_transmission", "'allow_transmission' is not supported"));
        }
        if front.transmits() || back.as_ref().is_some_and(Material::transmits) {
            return Err(
                props.error("what transmits light has two sides already: it cannot stand inside a twosided")
            );
        }
        Ok(Material::TwoSided { front: Box::new(front), back: back.map(Box::new) })
    }

    /// Mitsuba 0.6's sum of any number of materials. Where the weights add up to less than 1, the rest is black.
    fn mixture(&mut self, props: Props<'a>) -> Result<Material> {
        let text =
            props.opt_string("weights")?.ok_or_else(|| props.error("a mixturebsdf needs 'weights'"))?;
        let weight = |t: &str| t.parse::<f32>().ok().filter(|w| *w >= 0.0 && w.is_finite());
        let weights = tokens(text).map(weight).collect::<Option<Vec<_>>>();
        let nested = self.nested_bsdfs(props, usize::MAX)?;
        let weights = weights.filter(|w| w.len() == nested.len() && !w.is_empty()).ok_or_else(|| {
            let message =
                format!("'weights' is '{text}', but should be one number, not negative, for each bsdf");
            props.error_at("weights", message)
        })?;
        let mut total = weights.iter().sum::<f32>().max(1.0);
        let black = Material::Diffuse { reflectance: Color::Constant(Rgb::ZERO) };
        let mut parts: Vec<(f32, Material)> = weights.into_iter().map(|w| w / total).zip(nested).collect();
        total = parts.iter().map(|(w, _)| w).sum();
        if total < 1.0 - 1e-5 {
            parts.push((1.0 - total, black));
        }
        // From the end: a part among those after it.
        let mut rest: Option<(f32, Material)> = None;
        for (weight, material) in parts.into_iter().rev() {
            rest = Some(match rest {
                None => (weight, material),
                Some((others, other)) => {
                    let all = weight + others;
                    let share = if all > 0.0 { others / all } else { 0.0 };
                    let nested = [material, other].map(Box::new);
                    (all, Material::Blend { weight: Scalar::Constant(share), nested })
                }
            });
        }
        rest.map(|(_, mixture)| mixture).ok_or_else(|| props.error("a mixturebsdf needs bsdfs inside"))
    }

    /// The only texture inside, whatever it is called.
    fn nested_texture(&self, props: Props<'a>) -> Result<&'a Property> {
        let mut textures = Vec::new();
        for property in &props.object.properties {
            if props.object_of(property)?.is_some_and(|index| self.tree.objects[index].tag == "texture") {
                textures.push(property);
            }
        }
        match textures[..] {
            [texture] => {
                texture.used.set(true);
                Ok(texture)
            }
            _ => Err(props.error(format!("{} needs exactly one texture inside", props.title()))),
        }
    }

    /// The only material inside of another.
    fn only_nested_bsdf(&mut self, props: Props<'a>) -> Result<Box<Material>> {
        let nested = self.nested_bsdfs(props, 1)?.pop();
        nested.map(Box::new).ok_or_else(|| props.error(format!("{} needs a bsdf inside", props.title())))
    }

    /// At most `most` materials inside of another.
    fn nested_bsdfs(&mut self, props: Props<'a>, most: usize) -> Result<Vec<Material>> {
        let mut nested = Vec::new();
        for (child, pos) in props.children()? {
            if child.object.tag != "bsdf" {
                let message = format!("{} cannot hold a <{}>", props.title(), child.object.tag);
                return Err(self.tree.error(pos, message));
            }
            if nested.len() == most {
                return Err(self.tree.error(pos, format!("{} holds at most {most} bsdfs", props.title())));
            }
            nested.push(self.make_material(child)?);
        }
        Ok(nested)
    }

    /// Real and imaginary part of the index of refraction: given, or by the name of a material.
    fn complex_ior(&mut self, props: Props<'a>) -> Result<(Color, Color)> {
        // Mitsuba 0.6 makes everything of copper.
        let default = if props.object.old && !props.has("eta") && !props.has("k") { "Cu" } else { "none" };
        let material = props.opt_string("material")?.unwrap_or(default);
        if props.has("eta") || material.eq_ignore_ascii_case("none") {
            if props.has("material") && !material.eq_ignore_ascii_case("none") {
                return Err(props.error_at("material", "give either 'material' or 'eta' and 'k', not both"));
            }
            let eta = self.index_part(props, "eta", Rgb::ZERO)?;
            return Ok((eta, self.index_part(props, "k", Rgb::ONE)?));
        }
        match ior::conductor(material) {
            Some((eta, k)) => Ok((Color::Constant(eta), Color::Constant(k))),
            None => {
                let names = ior::conductor_names();
                let message = format!("unknown conductor '{material}'; known are none, {names}");
                Err(props.error_at("material", message))
            }
        }
    }

    /// A part of a complex index of refraction. Measured ones may be negative in RGB; as Fresnel's formulas square
    /// both parts, only their size counts.
    fn index_part(&mut self, props: Props<'a>, name: &'static str, default: Rgb) -> Result<Color> {
        let size = match props.get(name).map(|p| &p.value) {
            Some(Value::Rgb(v)) if v.min_element() < 0.0 => v.abs().as_vec3(),
            Some(Value::Float(v) | Value::Spectrum(Spectrum::Uniform(v))) if *v < 0.0 => {
                Rgb::splat(v.abs() as f32)
            }
            Some(Value::Integer(v)) if *v < 0 => Rgb::splat((*v as f32).abs()),
            _ => return self.color(props, name, Role::Unbounded, default),
        };
        self.warn_at(props.pos(name), &format!("'{name}' is negative: only its size counts, as in Mitsuba"));
        Ok(Color::Constant(size))
    }

    /// A roughness that may be textured. What is negative is taken for 0, as in Mitsuba.
    fn alpha(&mut self, props: Props<'a>, name: &'static str, default: Scalar) -> Result<Scalar> {
        if !props.has(name) {
            return Ok(default);
        }
        if let Some(Value::Float(_) | Value::Integer(_)) = props.get(name).map(|p| &p.value) {
            return Ok(Scalar::Constant(constant_alpha(props, name, 0.0)?));
        }
        self.scalar(props, name, 0.0)
    }

    /// `None` if the surface is smooth.
    fn roughness(&mut self, props: Props<'a>) -> Result<Option<Roughness>> {
        props.boolean("sample_visible", true)?;
        let anisotropic = props.has("alpha_u") || props.has("alpha_v");
        if anisotropic && (props.has("alpha") || !props.has("alpha_u") || !props.has("alpha_v")) {
            let at = if props.has("alpha_u") { "alpha_u" } else { "alpha_v" };
            return Err(props.error_at(at, "give either 'alpha', or 'alpha_u' and 'alpha_v'"));
        }
        let mut alpha = |name| self.alpha(props, name, Scalar::Constant(0.1));
        let (alpha_u, alpha_v) = if anisotropic {
            (alpha("alpha_u")?, alpha("alpha_v")?)
        } else {
            let alpha = alpha("alpha")?;
            (alpha, alpha)
        };
        let distribution = distribution(props)?;
        let is_smooth = [alpha_u, alpha_v].iter().all(|a| matches!(a, Scalar::Constant(a) if *a <= SMOOTH));
        Ok((!is_smooth).then_some(Roughness { distribution, alpha_u, alpha_v }))
    }
}

/// Mitsuba raises roughness to this: facets are so much alike then that the surface is as good as smooth.
const SMOOTH: f32 = 1e-4;

/// A roughness that is the same everywhere. What is negative is taken for 0, as in Mitsuba.
fn constant_alpha(props: Props, name: &'static str, default: f32) -> Result<f32> {
    let alpha = props.float(name, default)?;
    if !alpha.is_finite() {
        return Err(props.error_at(name, format!("'{name}' is out of range")));
    }
    if alpha < 0.0 {
        props.tree.warn(props.pos(name), &format!("'{name}' is {alpha}: taken for 0, a smooth surface"));
    }
    Ok(alpha.max(0.0))
}

/// The rough surface of a layer, whose roughness is the same everywhere, as it has tables. `None` if it is smooth.
fn rough_coating(props: Props, eta: f32) -> Result<Option<Box<RoughCoating>>> {
    let alpha = constant_alpha(props, "alpha", 0.1)?;
    props.boolean("sample_visible", true)?;
    let distribution = distribution(props)?;
    Ok((alpha > SMOOTH).then(|| Box::new(RoughCoating::new(eta, alpha, distribution))))
}

/// How perturbed normals are used: Mitsuba 0.6 had neither rule.
fn perturbation(props: Props) -> Result<Perturbation> {
    let new = !props.object.old;
    Ok(Perturbation {
        flip_invalid: props.boolean("flip_invalid_normals", new)?,
        shadowing: props.boolean("use_shadowing_function", new)?,
    })
}

fn distribution(props: Props) -> Result<Distribution> {
    let choices = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
    let old = props.opt_string("distribution")?.filter(|_| props.object.old);
    if let Some(name @ ("phong" | "as")) = old {
        let message = format!("the microfacets of '{name}' are those of beckmann here, which hardly differ");
        props.tree.warn(props.pos("distribution"), &message);
        return Ok(Distribution::Beckmann);
    }
    props.choice("distribution", Distribution::Beckmann, &choices)
}

/// The name of two under which a property is given.
fn either(props: Props, name: &'static str, other: &'static str) -> &'static str {
    if props.has(name) || !props.has(other) { name } else { other }
}

/// Interior over exterior index of a principled: given, or by the reflectance at normal incidence. Mitsuba takes what
/// transmits but does not refract for a mistake.
fn principled_ior(props: Props, transmits: bool) -> Result<f32> {
    if props.has("eta") && props.has("specular") {
        return Err(props.error_at("specular", "give either 'eta' or 'specular', not both"));
    }
    if let Some(eta) = props.opt_float("eta")? {
        if !(eta > 0.0 && eta.is_finite()) {
            return Err(props.error_at("eta", format!("'eta' is {eta}, but must be positive")));
        }
        return Ok(if transmits && eta == 1.0 { 1.001 } else { eta });
    }
    let specular = props.float("specular", 0.5)?;
    if !(0.0..12.5).contains(&specular) {
        return Err(props.error_at(
            "specular",
            format!("'specular' is {specular}, but must be at least 0 and below 12.5"),
        ));
    }
    let specular = if transmits && specular == 0.0 { 1e-3 } else { specular };
    // Burley 2015, §3: 8 % at most.
    Ok(2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0)
}

/// Weight of a lobe among what is sampled.
fn sampling_rate(props: Props, name: &'static str) -> Result<f32> {
    let rate = props.float(name, 1.0)?;
    if rate >= 0.0 && rate.is_finite() {
        return Ok(rate);
    }
    Err(props.error_at(name, format!("'{name}' is {rate}, but must not be negative")))
}

/// Interior over exterior index; either may be a number or a name.
fn relative_ior(props: Props, interior: &str) -> Result<f32> {
    let index = |name: &'static str, default: &str| -> Result<f32> {
        let word = match props.get(name).map(|p| &p.value) {
            None => default,
            Some(Value::String(word)) => word,
            Some(_) => {
                let value = props.float(name, 1.0)?;
                if value > 0.0 && value.is_finite() {
                    return Ok(value);
                }
                return Err(props.error_at(name, format!("'{name}' is {value}, but must be positive")));
            }
        };
        ior::dielectric(word).ok_or_else(|| {
            let message = format!("unknown material '{word}'; known are {}", ior::dielectric_names());
            props.error_at(name, message)
        })
    };
    Ok(index("int_ior", interior)? / index("ext_ior", "air")?)
}
