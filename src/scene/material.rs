//! Materials: scattering functions with textures still to be looked up.

use crate::bsdf::{Bsdf, Coating, Distribution, Microfacet, RoughCoating};
use crate::texture::{Color, Lookup, Scalar, Texture};

/// Roughness of a microfacet material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// The shape of the distribution.
    pub distribution: Distribution,
    /// Along ∂p/∂u.
    pub alpha_u: Scalar,
    /// Across.
    pub alpha_v: Scalar,
}

impl Roughness {
    fn eval(&self, textures: &[Texture], at: &Lookup) -> Microfacet {
        let alpha_u = self.alpha_u.eval(textures, at);
        let alpha_v = if self.is_isotropic() { alpha_u } else { self.alpha_v.eval(textures, at) };
        Microfacet::new(self.distribution, alpha_u, alpha_v)
    }

    fn is_isotropic(&self) -> bool {
        self.alpha_u == self.alpha_v
    }
}

/// What kinds of lobes a material has, whatever its textures say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobes {
    /// Something other than delta lobes: photons can be stored and light can be sampled.
    pub smooth: bool,
    /// Delta or rough lobes, which can focus light: caustics are possible.
    pub sharp: bool,
}

impl Lobes {
    /// What either has.
    pub fn union(self, other: Lobes) -> Lobes {
        Lobes { smooth: self.smooth | other.smooth, sharp: self.sharp | other.sharp }
    }
}

/// A material; [`Material::bsdf`] looks its textures up. The parameters are those of [`Bsdf`]'s constructors.
#[derive(Clone, Debug)]
pub enum Material {
    /// Nothing: light goes straight through.
    Null,
    /// Lambertian.
    Diffuse {
        /// Albedo.
        reflectance: Color,
    },
    /// Smooth metal.
    Conductor {
        /// Real part of the index of refraction.
        eta: Color,
        /// Imaginary part.
        k: Color,
        /// Factor on the reflection.
        reflectance: Color,
    },
    /// Rough metal.
    RoughConductor {
        /// Real part of the index of refraction.
        eta: Color,
        /// Imaginary part.
        k: Color,
        /// Roughness.
        roughness: Roughness,
        /// Factor on the reflection.
        reflectance: Color,
    },
    /// Smooth interface of transparent media.
    Dielectric {
        /// Interior over exterior index of refraction.
        eta: f32,
        /// Factor on the reflection.
        reflectance: Color,
        /// Factor on the transmission.
        transmittance: Color,
    },
    /// Thin sheet of a transparent medium.
    ThinDielectric {
        /// Interior over exterior index of refraction.
        eta: f32,
        /// Factor on the reflection.
        reflectance: Color,
        /// Factor on the transmission.
        transmittance: Color,
    },
    /// Rough interface of transparent media.
    RoughDielectric {
        /// Interior over exterior index of refraction, not 1.
        eta: f32,
        /// Roughness.
        roughness: Roughness,
        /// Factor on the reflection.
        reflectance: Color,
        /// Factor on the transmission.
        transmittance: Color,
    },
    /// Diffuse base under a smooth coating.
    Plastic {
        /// The coating.
        coating: Coating,
        /// Albedo of the base.
        diffuse: Color,
        /// Factor on the coating's reflection.
        specular: Color,
        /// Whether the base colours light at every internal reflection.
        nonlinear: bool,
    },
    /// Diffuse base under a rough coating.
    RoughPlastic {
        /// The coating, with its tables.
        coating: Box<RoughCoating>,
        /// Albedo of the base.
        diffuse: Color,
        /// Factor on the coating's reflection.
        specular: Color,
        /// Whether the base colours light at every internal reflection.
        nonlinear: bool,
    },
    /// One material, or one for each side, seen from its front.
    TwoSided {
        /// On the side of the shading normal.
        front: Box<Material>,
        /// On the other side; `None` for the same one.
        back: Option<Box<Material>>,
    },
    /// A material with holes.
    Mask {
        /// 0 where there is a hole, 1 where there is none.
        opacity: Scalar,
        /// What is there where there is no hole.
        nested: Box<Material>,
    },
}

impl Material {
    /// The scattering function at a place, seen from the side of the shading normal or from the other.
    pub fn bsdf<'a>(&'a self, textures: &'a [Texture], at: &Lookup, from_front: bool) -> Bsdf<'a> {
        let color = |c: &Color| c.eval(textures, at);
        match self {
            Material::Null => Bsdf::null(),
            Material::Diffuse { reflectance } => Bsdf::diffuse(color(reflectance)),
            Material::Conductor { eta, k, reflectance } => {
                Bsdf::conductor(color(eta), color(k), color(reflectance))
            }
            Material::RoughConductor { eta, k, roughness, reflectance } => {
                Bsdf::rough_conductor(color(eta), color(k), roughness.eval(textures, at), color(reflectance))
            }
            Material::Dielectric { eta, reflectance, transmittance } => {
                Bsdf::dielectric(*eta, color(reflectance), color(transmittance))
            }
            Material::ThinDielectric { eta, reflectance, transmittance } => {
                Bsdf::thin_dielectric(*eta, color(reflectance), color(transmittance))
            }
            Material::RoughDielectric { eta, roughness, reflectance, transmittance } => {
                Bsdf::rough_dielectric(
                    *eta,
                    roughness.eval(textures, at),
                    color(reflectance),
                    color(transmittance),
                )
            }
            Material::Plastic { coating, diffuse, specular, nonlinear } => {
                Bsdf::plastic(*coating, color(diffuse), color(specular), *nonlinear)
            }
            Material::RoughPlastic { coating, diffuse, specular, nonlinear } => {
                Bsdf::rough_plastic(coating, color(diffuse), color(specular), *nonlinear)
            }
            Material::TwoSided { front, back } => match back {
                Some(back) if !from_front => back.bsdf(textures, at, true).two_sided(),
                _ => front.bsdf(textures, at, true).two_sided(),
            },
            Material::Mask { opacity, nested } => {
                nested.bsdf(textures, at, from_front).masked(opacity.eval(textures, at))
            }
        }
    }

    /// The kinds of lobes it has.
    pub fn lobes(&self) -> Lobes {
        let (smooth, sharp) = match self {
            Material::Null
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. } => (false, true),
            Material::Diffuse { .. } => (true, false),
            Material::RoughConductor { .. }
            | Material::RoughDielectric { .. }
            | Material::Plastic { .. }
            | Material::RoughPlastic { .. } => (true, true),
            Material::TwoSided { front, back } => {
                return back.iter().fold(front.lobes(), |lobes, back| lobes.union(back.lobes()));
            }
            // Light goes straight through the holes.
            Material::Mask { nested, .. } => (nested.lobes().smooth, true),
        };
        Lobes { smooth, sharp }
    }

    /// Whether the shading frame must be aligned with ∂p/∂u.
    pub fn needs_tangent(&self) -> bool {
        match self {
            Material::RoughConductor { roughness, .. } | Material::RoughDielectric { roughness, .. } => {
                !roughness.is_isotropic()
            }
            Material::TwoSided { front, back } => {
                front.needs_tangent() || back.as_ref().is_some_and(|b| b.needs_tangent())
            }
            Material::Mask { nested, .. } => nested.needs_tangent(),
            _ => false,
        }
    }

    /// Whether light can get from one side to the other.
    pub fn transmits(&self) -> bool {
        match self {
            Material::Null
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::RoughDielectric { .. }
            | Material::Mask { .. } => true,
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::RoughConductor { .. }
            | Material::Plastic { .. }
            | Material::RoughPlastic { .. }
            | Material::TwoSided { .. } => false,
        }
    }
}
