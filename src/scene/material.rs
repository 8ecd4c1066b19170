//! Materials: scattering functions with textures still to be looked up.

use crate::bsdf::Bsdf;
use crate::texture::{Color, Texture};
use glam::Vec2;

/// A material; [`Material::bsdf`] looks its textures up.
#[derive(Clone, Debug)]
pub enum Material {
    /// Lambertian.
    Diffuse {
        /// Albedo.
        reflectance: Color,
    },
}

impl Material {
    /// The scattering function at `uv`.
    pub fn bsdf<'a>(&'a self, textures: &'a [Texture], uv: Vec2) -> Bsdf<'a> {
        match self {
            Material::Diffuse { reflectance } => Bsdf::diffuse(reflectance.eval(textures, uv)),
        }
    }

    /// Whether the shading frame must be aligned with ∂p/∂u.
    pub fn needs_tangent(&self) -> bool {
        false
    }
}
