//! Materials: scattering functions with textures still to be looked up.

use crate::bsdf::{
    Bsdf, Coating, Distribution, Layer, Microfacet, Perturbation, PrincipledParams, PrincipledThinParams,
    RoughCoating, WardVariant,
};
use crate::texture::{Color, Lookup, Scalar, Texture};
use glam::Vec3;
use std::cell::Cell;

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

/// Where a material is asked for its scattering function.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// Where textures are looked up.
    pub at: Lookup<'a>,
    /// Whether it is seen from the side of the shading normal.
    pub from_front: bool,
    /// ∂p/∂u and ∂p/∂v in the local frame; of no meaning unless [`Material::needs_tangent`].
    pub partials: [Vec3; 2],
}

/// What kinds of lobes a material has, whatever its textures say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobes {
    /// Something other than delta lobes: photons can be stored and light can be sampled.
    pub smooth: bool,
    /// Delta or rough lobes, which can focus light: caustics are possible.
    pub sharp: bool,
    /// Holes that light goes through as if nothing were there.
    pub holes: bool,
}

impl Lobes {
    /// What either has.
    pub fn union(self, other: Lobes) -> Lobes {
        Lobes {
            smooth: self.smooth | other.smooth,
            sharp: self.sharp | other.sharp,
            holes: self.holes | other.holes,
        }
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
    /// Burley's blend of paint, metal and glass under a clear coat.
    Principled(Box<PrincipledParams<Color, Scalar>>),
    /// Burley's thin sheet of paint or glass.
    PrincipledThin(Box<PrincipledThinParams<Color, Scalar>>),
    /// Phong's lobe over a diffuse base.
    Phong {
        /// Albedo of the base.
        diffuse: Color,
        /// Albedo of the lobe.
        specular: Color,
        /// Sharpness of the lobe.
        exponent: Scalar,
    },
    /// Ward's lobe over a diffuse base.
    Ward {
        /// Albedo of the base.
        diffuse: Color,
        /// Factor on the lobe.
        specular: Color,
        /// Roughness along ∂p/∂u.
        alpha_u: Scalar,
        /// Roughness across.
        alpha_v: Scalar,
        /// How the lobe is normalised.
        variant: WardVariant,
    },
    /// Rough diffuse surface.
    RoughDiffuse {
        /// Albedo of what it is made of.
        reflectance: Color,
        /// Roughness.
        alpha: Scalar,
        /// Without interreflection.
        fast: bool,
    },
    /// Lambertian transmission.
    DiffuseTransmitter {
        /// Share that gets through.
        transmittance: Color,
    },
    /// One material, or one for each side, seen from its front.
    TwoSided {
        /// On the side of the shading normal.
        front: Box<Material>,
        /// On the other side; `None` for the same one.
        back: Option<Box<Material>>,
    },
    /// (1 − weight) of the first material and weight of the second.
    Blend {
        /// Share of the second material, clamped to 0..1.
        weight: Scalar,
        /// The materials.
        nested: [Box<Material>; 2],
    },
    /// A material under a dielectric layer.
    Coated {
        /// The layer's index over the outer one.
        eta: f32,
        /// Factor on what the layer's surface reflects.
        specular: Color,
        /// Absorption coefficient of the layer, per thickness.
        absorption: Color,
        /// Thickness of the layer.
        thickness: f32,
        /// The layer's surface, if that is rough.
        rough: Option<Box<RoughCoating>>,
        /// What is below.
        nested: Box<Material>,
    },
    /// A material whose normal is told by a texture, as (n + 1) / 2 in the shading frame.
    NormalMap {
        /// The texture.
        normals: Color,
        /// What scatters about that normal.
        nested: Box<Material>,
        /// How the normal is used.
        rules: Perturbation,
    },
    /// A material whose normal is that of a surface lifted by a texture.
    BumpMap {
        /// The height.
        height: Scalar,
        /// Factor on the height.
        scale: f32,
        /// What scatters about that normal.
        nested: Box<Material>,
        /// How the normal is used.
        rules: Perturbation,
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
    /// The scattering function at `site`.
    pub fn bsdf<'a>(&'a self, textures: &'a [Texture], site: &Site) -> Bsdf<'a> {
        let at = &site.at;
        let color = |c: &Color| c.eval(textures, at);
        let scalar = |s: &Scalar| s.eval(textures, at);
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
            Material::Principled(params) => Bsdf::principled(&params.map(color, scalar)),
            Material::PrincipledThin(params) => Bsdf::principled_thin(&params.map(color, scalar)),
            Material::Phong { diffuse, specular, exponent } => {
                Bsdf::phong(color(diffuse), color(specular), scalar(exponent))
            }
            Material::Ward { diffuse, specular, alpha_u, alpha_v, variant } => {
                Bsdf::ward(color(diffuse), color(specular), scalar(alpha_u), scalar(alpha_v), *variant)
            }
            Material::RoughDiffuse { reflectance, alpha, fast } => {
                Bsdf::rough_diffuse(color(reflectance), scalar(alpha), *fast)
            }
            Material::DiffuseTransmitter { transmittance } => Bsdf::diffuse_transmitter(color(transmittance)),
            Material::TwoSided { front, back } => {
                let shown = match back {
                    Some(back) if !site.from_front => back,
                    _ => front,
                };
                shown.bsdf(textures, &Site { from_front: true, ..*site }).two_sided()
            }
            Material::Blend { weight, nested: [first, second] } => {
                let (first, second) = (first.bsdf(textures, site), second.bsdf(textures, site));
                Bsdf::blend(first, second, weight.eval(textures, at))
            }
            Material::Coated { eta, specular, absorption, thickness, rough, nested } => {
                nested.bsdf(textures, site).coated(Layer {
                    eta: *eta,
                    specular: color(specular),
                    absorption: color(absorption) * *thickness,
                    rough: rough.as_deref(),
                })
            }
            Material::NormalMap { normals, nested, rules } => {
                let n = 2.0 * color(normals) - Vec3::ONE;
                nested.bsdf(textures, site).perturbed(n.try_normalize().unwrap_or(Vec3::Z), Vec3::X, *rules)
            }
            Material::BumpMap { height, scale, nested, rules } => {
                let slope = height.gradient(textures, at) * *scale;
                // Blinn 1978, "Simulation of Wrinkled Surfaces".
                let [p_u, p_v] = site.partials;
                let (p_u, p_v) = (p_u.with_z(slope.x), p_v.with_z(slope.y));
                let n = p_u.cross(p_v).try_normalize().unwrap_or(Vec3::Z);
                let n = if n.z < 0.0 { -n } else { n };
                nested.bsdf(textures, site).perturbed(n, p_u, *rules)
            }
            Material::Mask { opacity, nested } => {
                nested.bsdf(textures, site).masked(opacity.eval(textures, at))
            }
        }
    }

    /// The kinds of lobes it has.
    pub fn lobes(&self) -> Lobes {
        let (smooth, sharp) = match self {
            Material::Null => return Lobes { holes: true, ..Lobes::default() },
            Material::Conductor { .. } | Material::Dielectric { .. } | Material::ThinDielectric { .. } => {
                (false, true)
            }
            // As lamps often are.
            Material::Diffuse { reflectance: Color::Constant(Vec3::ZERO) } => (false, false),
            Material::Diffuse { .. }
            | Material::RoughDiffuse { .. }
            | Material::DiffuseTransmitter { .. } => (true, false),
            Material::PrincipledThin(params) => (true, !is_zero(&params.spec_trans)),
            Material::RoughConductor { .. }
            | Material::RoughDielectric { .. }
            | Material::Plastic { .. }
            | Material::RoughPlastic { .. }
            | Material::Principled(_)
            | Material::Phong { .. }
            | Material::Ward { .. } => (true, true),
            Material::TwoSided { front, back } => {
                return back.iter().fold(front.lobes(), |lobes, back| lobes.union(back.lobes()));
            }
            Material::Blend { nested: [first, second], .. } => return first.lobes().union(second.lobes()),
            Material::Coated { rough, nested, .. } => {
                let nested = nested.lobes();
                return Lobes { smooth: rough.is_some() || nested.smooth, sharp: true, ..nested };
            }
            Material::NormalMap { nested, .. } | Material::BumpMap { nested, .. } => return nested.lobes(),
            Material::Mask { nested, .. } => return Lobes { holes: true, ..nested.lobes() },
        };
        Lobes { smooth, sharp, holes: false }
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
            Material::Blend { nested, .. } => nested.iter().any(|m| m.needs_tangent()),
            Material::NormalMap { .. } | Material::BumpMap { .. } => true,
            Material::Coated { nested, .. } | Material::Mask { nested, .. } => nested.needs_tangent(),
            Material::Principled(params) => !is_zero(&params.anisotropic),
            Material::PrincipledThin(params) => !is_zero(&params.anisotropic),
            Material::Ward { alpha_u, alpha_v, .. } => alpha_u != alpha_v,
            _ => false,
        }
    }

    /// Whether anything about it is looked up by texture coordinates.
    pub fn is_textured(&self) -> bool {
        let colors = |colors: &[&Color]| colors.iter().any(|c| c.is_textured());
        let scalars = |scalars: &[&Scalar]| scalars.iter().any(|s| s.is_textured());
        let rough = |r: &Roughness| scalars(&[&r.alpha_u, &r.alpha_v]);
        match self {
            Material::Null => false,
            Material::Diffuse { reflectance } => colors(&[reflectance]),
            Material::Conductor { eta, k, reflectance } => colors(&[eta, k, reflectance]),
            Material::RoughConductor { eta, k, roughness, reflectance } => {
                colors(&[eta, k, reflectance]) || rough(roughness)
            }
            Material::Dielectric { reflectance, transmittance, .. }
            | Material::ThinDielectric { reflectance, transmittance, .. } => {
                colors(&[reflectance, transmittance])
            }
            Material::RoughDielectric { roughness, reflectance, transmittance, .. } => {
                colors(&[reflectance, transmittance]) || rough(roughness)
            }
            Material::Plastic { diffuse, specular, .. }
            | Material::RoughPlastic { diffuse, specular, .. } => colors(&[diffuse, specular]),
            Material::Principled(params) => {
                let any = Cell::new(false);
                let note = |textured: bool| any.set(any.get() | textured);
                let _ = params.map(|c| note(c.is_textured()), |s| note(s.is_textured()));
                any.get()
            }
            Material::PrincipledThin(params) => {
                let any = Cell::new(false);
                let note = |textured: bool| any.set(any.get() | textured);
                let _ = params.map(|c| note(c.is_textured()), |s| note(s.is_textured()));
                any.get()
            }
            Material::Phong { diffuse, specular, exponent } => {
                colors(&[diffuse, specular]) || scalars(&[exponent])
            }
            Material::Ward { diffuse, specular, alpha_u, alpha_v, .. } => {
                colors(&[diffuse, specular]) || scalars(&[alpha_u, alpha_v])
            }
            Material::RoughDiffuse { reflectance, alpha, .. } => colors(&[reflectance]) || scalars(&[alpha]),
            Material::DiffuseTransmitter { transmittance } => colors(&[transmittance]),
            Material::TwoSided { front, back } => {
                front.is_textured() || back.as_ref().is_some_and(|b| b.is_textured())
            }
            Material::Blend { weight, nested } => {
                scalars(&[weight]) || nested.iter().any(|m| m.is_textured())
            }
            Material::Coated { specular, absorption, nested, .. } => {
                colors(&[specular, absorption]) || nested.is_textured()
            }
            Material::NormalMap { normals, nested, .. } => colors(&[normals]) || nested.is_textured(),
            Material::BumpMap { height, nested, .. } => scalars(&[height]) || nested.is_textured(),
            Material::Mask { opacity, nested } => scalars(&[opacity]) || nested.is_textured(),
        }
    }

    /// Whether light can get from one side to the other.
    pub fn transmits(&self) -> bool {
        match self {
            Material::Null
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::RoughDielectric { .. }
            | Material::PrincipledThin(_)
            | Material::DiffuseTransmitter { .. }
            | Material::Mask { .. } => true,
            Material::Blend { nested, .. } => nested.iter().any(|m| m.transmits()),
            Material::NormalMap { nested, .. } | Material::BumpMap { nested, .. } => nested.transmits(),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::RoughConductor { .. }
            | Material::Plastic { .. }
            | Material::RoughPlastic { .. }
            | Material::Coated { .. }
            | Material::Phong { .. }
            | Material::Ward { .. }
            | Material::RoughDiffuse { .. }
            | Material::TwoSided { .. } => false,
            Material::Principled(params) => !is_zero(&params.spec_trans),
        }
    }
}

fn is_zero(scalar: &Scalar) -> bool {
    *scalar == Scalar::Constant(0.0)
}
