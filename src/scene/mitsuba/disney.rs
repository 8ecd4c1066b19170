//! The `disney…` bsdfs of lajolla (the renderer of UC San Diego's course): Burley's model whole, and its lobes one
//! by one. All are read as Mitsuba's `principled`, which is the same model.

use super::Loader;
use super::props::Props;
use crate::Result;
use crate::bsdf::PrincipledParams;
use crate::math::Rgb;
use crate::scene::pending::Pending;
use crate::scene::spectrum::Role;
use crate::texture::{Color, Scalar, Texture};

/// The bsdfs.
pub(super) const PLUGINS: [&str; 6] =
    ["disneybsdf", "disneydiffuse", "disneymetal", "disneyglass", "disneyclearcoat", "disneysheen"];

/// The model's clear coat has a quarter of the weight that the lobe has alone.
const WHOLE_COAT: f32 = 4.0;
/// Colours the sheen, whose hue alone counts, and leaves nothing of the base.
const HUE: f32 = 1e-6;

impl<'a> Loader<'a> {
    /// A plugin of [`PLUGINS`].
    pub(super) fn disney(&mut self, props: Props<'a>) -> Result<PrincipledParams<Color, Scalar>> {
        let plugin = props.plugin();
        self.tree.warn_once(props.object.pos, &format!("{} is read as 'principled'", props.title()));
        let constant = |x: f32| Scalar::Constant(x);
        // No reflection but by the lobe that is wanted.
        let mut lobe = PrincipledParams {
            base_color: Color::Constant(Rgb::ZERO),
            roughness: constant(0.5),
            anisotropic: constant(0.0),
            metallic: constant(0.0),
            spec_trans: constant(0.0),
            eta: 1.0,
            spec_tint: constant(0.0),
            sheen: constant(0.0),
            sheen_tint: constant(0.0),
            flatness: constant(0.0),
            clearcoat: constant(0.0),
            clearcoat_gloss: constant(1.0),
            diffuse_rate: 1.0,
            specular_rate: 1.0,
            clearcoat_rate: 1.0,
        };
        if plugin != "disneyclearcoat" {
            lobe.base_color = self.color(props, "base_color", Role::Reflectance, Rgb::splat(0.5))?;
        }
        if !matches!(plugin, "disneyclearcoat" | "disneysheen") {
            lobe.roughness = self.scalar(props, "roughness", 0.5)?;
        }
        if matches!(plugin, "disneybsdf" | "disneymetal" | "disneyglass") {
            lobe.anisotropic = self.scalar(props, "anisotropic", 0.0)?;
        }
        match plugin {
            "disneydiffuse" => lobe.flatness = self.scalar(props, "flatness", 0.0)?,
            "disneymetal" => (lobe.metallic, lobe.eta) = (constant(1.0), 1.5),
            "disneyglass" => (lobe.spec_trans, lobe.eta) = (constant(1.0), refracting(eta(props)?)),
            "disneyclearcoat" => {
                lobe.clearcoat = constant(WHOLE_COAT);
                lobe.clearcoat_gloss = self.scalar(props, "clearcoat_gloss", 1.0)?;
            }
            "disneysheen" => {
                lobe.sheen = constant(1.0);
                lobe.sheen_tint = self.scalar(props, "sheen_tint", 0.5)?;
                lobe.base_color = self.scaled_color(lobe.base_color, HUE);
            }
            _ => {
                lobe.flatness = self.scalar(props, "flatness", 0.0)?;
                lobe.metallic = self.scalar(props, "metallic", 0.0)?;
                lobe.spec_trans = self.scalar(props, "spec_trans", 0.0)?;
                lobe.spec_tint = self.scalar(props, "spec_tint", 0.0)?;
                lobe.sheen = self.scalar(props, "sheen", 0.0)?;
                lobe.sheen_tint = self.scalar(props, "sheen_tint", 0.5)?;
                lobe.clearcoat = self.scalar(props, "clearcoat", 0.0)?;
                lobe.clearcoat_gloss = self.scalar(props, "clearcoat_gloss", 1.0)?;
                let (eta, specular) = (eta(props)?, self.scalar(props, "specular", 0.5)?);
                lobe.eta = match (lobe.spec_trans, specular) {
                    // What is opaque has a factor on its reflectance at normal incidence.
                    (Scalar::Constant(0.0), Scalar::Constant(specular)) => dimmed(eta, specular),
                    _ => refracting(eta),
                };
            }
        }
        Ok(lobe)
    }

    fn scaled_color(&mut self, color: Color, factor: f32) -> Color {
        match color {
            Color::Constant(rgb) => Color::Constant(rgb * factor),
            Color::Texture(texture) => {
                self.textures.push(Pending::Ready(Texture::Scaled { texture, scale: Rgb::splat(factor) }));
                Color::Texture(self.textures.len() as u32 - 1)
            }
        }
    }
}

fn eta(props: Props) -> Result<f32> {
    let eta = props.float("eta", 1.5)?;
    if eta > 0.0 && eta.is_finite() {
        return Ok(eta);
    }
    Err(props.error_at("eta", format!("'eta' is {eta}, but must be positive")))
}

/// The model takes an index of 1 of what transmits for a mistake.
fn refracting(eta: f32) -> f32 {
    if eta == 1.0 { 1.001 } else { eta }
}

/// The index whose reflectance at normal incidence is `factor` times that of `eta`.
fn dimmed(eta: f32, factor: f32) -> f32 {
    let r = ((eta - 1.0) / (eta + 1.0)).abs() * factor.clamp(0.0, 1.0).sqrt();
    (1.0 + r) / (1.0 - r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectances_are_dimmed() {
        let reflectance = |eta: f32| ((eta - 1.0) / (eta + 1.0)).powi(2);
        for (eta, factor) in [(1.5, 0.5), (1.5, 1.0), (2.4, 0.1), (0.7, 0.3), (1.5, 0.0)] {
            let expected = factor * reflectance(eta);
            assert!((reflectance(dimmed(eta, factor)) - expected).abs() < 1e-6, "{eta} {factor}");
        }
    }
}
