//! Materials: scattering functions with textures still to be looked up.

use crate::bsdf::Bsdf;
use crate::texture::{Color, Texture};
use glam::Vec2;

/// What kinds of lobes a material has, whatever its textures say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobes {
    /// Something other than delta lobes: photons can be stored and light can be sampled.
    pub smooth: bool,
    /// Delta or rough lobes, which can focus light: caustics are possible.
    pub sharp: bool,
}

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

    /// The kinds of lobes it has.
    pub fn lobes(&self) -> Lobes {
        match self {
            Material::Diffuse { .. } => Lobes { smooth: true, sharp: false },
        }
    }

    /// Whether the shading frame must be aligned with ∂p/∂u.
    pub fn needs_tangent(&self) -> bool {
        false
    }
}
