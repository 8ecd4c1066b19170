//! Scattering at a surface point whose textures are already looked up: small values in local coordinates (z = shading
//! normal), so this module knows neither textures nor scene. The models are those of Mitsuba 3.9, and those of
//! Mitsuba 0.6 that it no longer has.
//!
//! `eval` includes the cosine. Rough lobes belong to two *classes* at once, by weights that change smoothly with
//! roughness: that is how the light transport is split without a threshold; see [`Share`].

mod blend;
mod clearcoat;
mod coated;
mod conductor;
mod dielectric;
mod diffuse;
pub mod fresnel;
mod microfacet;
mod oren_nayar;
mod perturbed;
mod phong;
mod plastic;
mod principled;
mod principled_thin;
#[cfg(test)]
mod tests;
mod transmitter;
mod ward;

pub use coated::Layer;
pub use microfacet::{Distribution, Microfacet};
pub use perturbed::Perturbation;
pub use plastic::{Coating, RoughCoating};
pub use principled::PrincipledParams;
pub use principled_thin::PrincipledThinParams;
pub use ward::WardVariant;

use crate::math::Rgb;
use blend::Blend;
use coated::Coated;
use conductor::{Conductor, RoughConductor};
use dielectric::{Dielectric, RoughDielectric, ThinDielectric};
use diffuse::Diffuse;
use glam::{Vec2, Vec3};
use oren_nayar::OrenNayar;
use perturbed::Perturbed;
use phong::Phong;
use plastic::{Paint, Plastic, RoughPlastic};
use principled::Principled;
use principled_thin::PrincipledThin;
use std::f32::consts::FRAC_1_PI;
use transmitter::DiffuseTransmitter;
use ward::Ward;

/// Roughness α where a lobe begins to count as broad to the eye, and where it is wholly so.
const BROAD_TO_EYE: (f32, f32) = (0.05, 0.25);

/// The same for light that leaves.
const BROAD_TO_LIGHT: (f32, f32) = (0.3, 0.8);

/// The part of a microfacet lobe of roughness `alpha` that is too narrow for density estimation at the first vertex
/// from the eye, and is sampled instead: from 1 (narrow) smoothly down to 0.
pub fn sharp_eye(alpha: f32) -> f32 {
    1.0 - smoothstep(BROAD_TO_EYE, alpha)
}

/// The part of a microfacet lobe of roughness `alpha` that is too narrow for final gathering to find the light it
/// casts, which therefore makes caustics: from 1 (narrow) smoothly down to 0.
pub fn sharp_light(alpha: f32) -> f32 {
    1.0 - smoothstep(BROAD_TO_LIGHT, alpha)
}

fn smoothstep((from, to): (f32, f32), x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// What the scattered quantity is: refraction scales radiance, never flux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Camera paths.
    Radiance,
    /// Photons.
    Flux,
}

/// Which share of the non-delta lobes takes part. A microfacet lobe of roughness α counts with `1 − sharp(α)` to a
/// broad share, a diffuse lobe with 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Share {
    /// All non-delta lobes, in full.
    All,
    /// What density estimation can evaluate at the first vertex seen from the eye.
    BroadEye,
    /// What light must leave from for final gathering to find it; the rest carries caustics.
    BroadLight,
}

impl Share {
    /// The share of a microfacet lobe of roughness `alpha`.
    fn of(self, alpha: f32) -> f32 {
        match self {
            Share::All => 1.0,
            Share::BroadEye => 1.0 - sharp_eye(alpha),
            Share::BroadLight => 1.0 - sharp_light(alpha),
        }
    }
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Local direction.
    pub wi: Vec3,
    /// f·|cosθ_i| / pdf over all non-delta lobes, or the delta lobe's reflectance over its probability.
    pub weight: Rgb,
    /// Pdf of all non-delta lobes together; of no meaning for a delta lobe.
    pub pdf_w: f32,
    /// Whether a delta lobe was chosen.
    pub delta: bool,
    /// Relative index of refraction along the path (1 for reflection): transmitted side over incident side.
    pub eta: f32,
}

impl BsdfSample {
    fn smooth(wi: Vec3, weight: Rgb, pdf_w: f32) -> Self {
        BsdfSample { wi, weight, pdf_w, delta: false, eta: 1.0 }
    }

    fn delta(wi: Vec3, weight: Rgb, eta: f32) -> Self {
        BsdfSample { wi, weight, pdf_w: 0.0, delta: true, eta }
    }
}

/// A scattering function: one of a closed set, perhaps with holes, perhaps on both sides. Only those made of others
/// allocate.
///
/// Holes are no lobe: a path crosses the surface with probability 1 − [`Bsdf::opacity`], as if nothing were there, and all
/// else that a `Bsdf` says is about paths that do not.
///
/// Reflectances and transmittances scale the physical values; 1 is Mitsuba's default for the specular ones, 0.5 for
/// the diffuse ones. `eta` of a dielectric is the index of the interior (below the surface) over the exterior.
/// What cannot transmit is black from behind unless made [`Bsdf::two_sided`].
#[derive(Clone, Debug)]
pub struct Bsdf<'a> {
    kind: Kind<'a>,
    opacity: f32,
    two_sided: bool,
}

#[derive(Clone, Debug)]
enum Kind<'a> {
    Diffuse(Diffuse),
    Conductor(Conductor),
    RoughConductor(RoughConductor),
    Dielectric(Dielectric),
    ThinDielectric(ThinDielectric),
    RoughDielectric(RoughDielectric),
    Plastic(Plastic),
    RoughPlastic(RoughPlastic<'a>),
    Principled(Principled),
    PrincipledThin(PrincipledThin),
    Phong(Phong),
    Ward(Ward),
    OrenNayar(OrenNayar),
    DiffuseTransmitter(DiffuseTransmitter),
    Blend(Box<Blend<'a>>),
    Coated(Box<Coated<'a>>),
    Perturbed(Box<Perturbed<'a>>),
}

impl<'a> Bsdf<'a> {
    fn new(kind: Kind<'a>) -> Self {
        Bsdf { kind, opacity: 1.0, two_sided: false }
    }

    /// No surface at all: light goes straight through (`null`).
    pub fn null() -> Self {
        Bsdf::diffuse(Rgb::ZERO).masked(0.0)
    }

    /// Lambertian reflection from the front side (`diffuse`).
    pub fn diffuse(reflectance: Rgb) -> Self {
        Bsdf::new(Kind::Diffuse(Diffuse { reflectance }))
    }

    /// Smooth metal (`conductor`) of complex index `eta` + i·`k`; 0 + i·1 is the perfect mirror (`material` none).
    pub fn conductor(eta: Rgb, k: Rgb, reflectance: Rgb) -> Self {
        Bsdf::new(Kind::Conductor(Conductor { eta, k, reflectance }))
    }

    /// Rough metal (`roughconductor`).
    pub fn rough_conductor(eta: Rgb, k: Rgb, microfacet: Microfacet, reflectance: Rgb) -> Self {
        let metal = Conductor { eta, k, reflectance };
        Bsdf::new(Kind::RoughConductor(RoughConductor { metal, microfacet }))
    }

    /// Smooth interface of two transparent media (`dielectric`).
    pub fn dielectric(eta: f32, reflectance: Rgb, transmittance: Rgb) -> Self {
        Bsdf::new(Kind::Dielectric(Dielectric { eta, reflectance, transmittance }))
    }

    /// Thin sheet of a transparent medium (`thindielectric`).
    pub fn thin_dielectric(eta: f32, reflectance: Rgb, transmittance: Rgb) -> Self {
        Bsdf::new(Kind::ThinDielectric(ThinDielectric(Dielectric { eta, reflectance, transmittance })))
    }

    /// Rough interface of two transparent media (`roughdielectric`). `eta` must not be 1: nothing would scatter.
    pub fn rough_dielectric(eta: f32, microfacet: Microfacet, reflectance: Rgb, transmittance: Rgb) -> Self {
        let interface = Dielectric { eta, reflectance, transmittance };
        Bsdf::new(Kind::RoughDielectric(RoughDielectric { interface, microfacet }))
    }

    /// Diffuse base under a smooth coating (`plastic`). `nonlinear` lets the base colour the light at every internal
    /// reflection. Physical for `diffuse` ≤ 1.
    pub fn plastic(coating: Coating, diffuse: Rgb, specular: Rgb, nonlinear: bool) -> Self {
        let paint = Paint::new(&coating, diffuse, specular, nonlinear);
        Bsdf::new(Kind::Plastic(Plastic { coating, paint }))
    }

    /// Diffuse base under a rough coating (`roughplastic`).
    pub fn rough_plastic(coating: &'a RoughCoating, diffuse: Rgb, specular: Rgb, nonlinear: bool) -> Self {
        let paint = Paint::new(coating.smooth(), diffuse, specular, nonlinear);
        Bsdf::new(Kind::RoughPlastic(RoughPlastic { coating, paint }))
    }

    /// (1 − `weight`) `first` + `weight` `second` (`blendbsdf`).
    pub fn blend(first: Bsdf<'a>, second: Bsdf<'a>, weight: f32) -> Self {
        let weight = if weight > 0.0 { weight.min(1.0) } else { 0.0 };
        let parts = [(1.0 - weight) * first.opacity, weight * second.opacity];
        // 1 exactly where there are no holes.
        let opacity = 1.0 - ((1.0 - weight) * (1.0 - first.opacity) + weight * (1.0 - second.opacity));
        let [first, second] = [first, second].map(|bsdf| Bsdf { opacity: 1.0, ..bsdf });
        let whole = match parts {
            [_, 0.0] => first,
            [0.0, _] => second,
            _ => Bsdf::new(Kind::Blend(Box::new(Blend {
                weight: (parts[1] / opacity).min(1.0),
                bsdfs: [first, second],
            }))),
        };
        whole.masked(opacity)
    }

    /// The same under a layer (Mitsuba 0.6's `coating` and `roughcoating`). It must not transmit.
    pub fn coated(self, layer: Layer<'a>) -> Self {
        let opacity = self.opacity;
        let nested = Bsdf { opacity: 1.0, ..self };
        Bsdf::new(Kind::Coated(Box::new(Coated { layer, nested }))).masked(opacity)
    }

    /// The same about the unit normal `n` instead of the local z axis (`normalmap`, `bumpmap`); the tangent lies in the
    /// plane of `n` and `s`.
    pub fn perturbed(self, n: Vec3, s: Vec3, rules: Perturbation) -> Self {
        let opacity = self.opacity;
        let nested = Bsdf { opacity: 1.0, ..self };
        Bsdf::new(Kind::Perturbed(Box::new(Perturbed { n, s, rules, nested }))).masked(opacity)
    }

    /// Burley's blend of paint, metal and glass under a clear coat (`principled`).
    pub fn principled(params: &PrincipledParams) -> Self {
        Bsdf::new(Kind::Principled(Principled::new(params)))
    }

    /// Burley's thin sheet of paint or glass (`principledthin`).
    pub fn principled_thin(params: &PrincipledThinParams) -> Self {
        Bsdf::new(Kind::PrincipledThin(PrincipledThin::new(params)))
    }

    /// Normalised Phong lobe over a diffuse base (`phong`). Scaled down where the two reflect more than arrives.
    pub fn phong(diffuse: Rgb, specular: Rgb, exponent: f32) -> Self {
        Bsdf::new(Kind::Phong(Phong::new(diffuse, specular, exponent)))
    }

    /// Ward's anisotropic lobe over a diffuse base (`ward`). Scaled down where the two reflect more than arrives.
    pub fn ward(diffuse: Rgb, specular: Rgb, alpha_u: f32, alpha_v: f32, variant: WardVariant) -> Self {
        Bsdf::new(Kind::Ward(Ward::new(diffuse, specular, alpha_u, alpha_v, variant)))
    }

    /// Diffuse reflection of a rough surface (`roughdiffuse`), of slopes as rough as facets of roughness `alpha`; `fast`
    /// leaves out what is reflected between them.
    pub fn rough_diffuse(reflectance: Rgb, alpha: f32, fast: bool) -> Self {
        Bsdf::new(Kind::OrenNayar(OrenNayar::new(reflectance, alpha, fast)))
    }

    /// Lambertian transmission from both sides (`difftrans`).
    pub fn diffuse_transmitter(transmittance: Rgb) -> Self {
        Bsdf::new(Kind::DiffuseTransmitter(DiffuseTransmitter { transmittance }))
    }

    /// The same with holes (`mask`): paths cross it with probability 1 − `opacity`.
    pub fn masked(self, opacity: f32) -> Self {
        Bsdf { opacity: self.opacity * opacity.clamp(0.0, 1.0), ..self }
    }

    /// The same on both sides (`twosided`): seen from behind, everything is mirrored. No effect on what transmits,
    /// which has two sides already.
    pub fn two_sided(self) -> Self {
        Bsdf { two_sided: !self.kind.transmits(), ..self }
    }

    /// f(wo, wi)·|cosθ_i| of the non-delta lobes.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        let (wo, wi) = if self.flips(wo) { (mirror(wo), mirror(wi)) } else { (wo, wi) };
        match &self.kind {
            Kind::Diffuse(b) => b.eval(wo, wi),
            kind => kind.eval(wo, wi, mode, share),
        }
    }

    /// Pdf with which [`Bsdf::sample`] takes `wi` from a non-delta lobe.
    #[inline]
    pub fn pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        let (wo, wi) = if self.flips(wo) { (mirror(wo), mirror(wi)) } else { (wo, wi) };
        match &self.kind {
            Kind::Diffuse(b) => b.pdf_w(wo, wi),
            kind => kind.pdf_w(wo, wi, mode),
        }
    }

    /// Samples a lobe by `u_lobe` and a direction by `u`, all in [0, 1). `None` means that the path ends: it counts as
    /// a sample of weight 0.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        let flips = self.flips(wo);
        let mut s = self.kind.sample(if flips { mirror(wo) } else { wo }, u_lobe, u, mode)?;
        if flips {
            s.wi = mirror(s.wi);
        }
        Some(s)
    }

    /// Both delta lobes of a smooth interface, each weighted by itself: a path may follow both instead of choosing one.
    /// `None` for all else, and where one of them is missing.
    pub fn split(&self, wo: Vec3, mode: Mode) -> Option<[BsdfSample; 2]> {
        let reflects = match &self.kind {
            Kind::Dielectric(b) => b.reflects(wo),
            Kind::ThinDielectric(b) => b.reflects(wo),
            _ => return None,
        };
        if reflects <= 0.0 || reflects >= 1.0 {
            return None;
        }
        let lobe = |u_lobe, prob| {
            let sample = self.sample(wo, u_lobe, Vec2::ZERO, mode)?;
            Some(BsdfSample { weight: sample.weight * prob, ..sample })
        };
        Some([lobe(0.0, reflects)?, lobe(reflects, 1.0 - reflects)?])
    }

    /// Whether any lobe is not a delta: photons are stored and light is sampled there.
    pub fn has_smooth(&self) -> bool {
        match &self.kind {
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) => false,
            Kind::Blend(b) => b.any(Bsdf::has_smooth),
            Kind::Coated(b) => b.layer.rough.is_some() || b.nested.has_smooth(),
            Kind::Perturbed(b) => b.nested.has_smooth(),
            _ => true,
        }
    }

    /// Whether any lobe is a delta.
    pub fn has_delta(&self) -> bool {
        match &self.kind {
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) | Kind::Plastic(_) => true,
            Kind::Blend(b) => b.any(Bsdf::has_delta),
            Kind::Coated(b) => b.layer.rough.is_none() || b.nested.has_delta(),
            Kind::Perturbed(b) => b.nested.has_delta(),
            _ => false,
        }
    }

    /// Whether a microfacet lobe is divided among the shares: some share differs from [`Share::All`].
    pub fn has_rough(&self) -> bool {
        let divided = |alpha| sharp_eye(alpha) > 0.0 || sharp_light(alpha) > 0.0;
        match &self.kind {
            Kind::Blend(b) => b.any(Bsdf::has_rough),
            Kind::Coated(b) => {
                b.layer.rough.is_some_and(|coating| divided(coating.roughness())) || b.nested.has_rough()
            }
            Kind::Perturbed(b) => b.nested.has_rough(),
            kind => kind.roughness().is_some_and(divided),
        }
    }

    /// Roughness √(α_u α_v) of the microfacet lobe, if there is one, and of the narrowest of several unless they are those
    /// of a blend; less where its facets hardly bend what they transmit.
    pub fn roughness(&self) -> Option<f32> {
        self.kind.roughness()
    }

    /// Whether there is nothing but a narrow lobe.
    pub fn is_narrow(&self) -> bool {
        match &self.kind {
            Kind::RoughConductor(b) => sharp_light(b.microfacet.roughness()) > 0.5,
            Kind::Perturbed(b) => b.nested.is_narrow(),
            _ => false,
        }
    }

    /// Whether light is scattered from one side to the other.
    pub fn transmits(&self) -> bool {
        self.kind.transmits()
    }

    /// The share of light that meets the surface; the rest goes through holes.
    pub fn opacity(&self) -> f32 {
        self.opacity
    }

    /// Whether anything is scattered that arrives on the side of `wo`.
    pub fn scatters_on(&self, wo: Vec3) -> bool {
        wo.z > 0.0 || (wo.z < 0.0 && self.scatters_below())
    }

    fn scatters_below(&self) -> bool {
        self.two_sided || self.kind.scatters_below()
    }

    /// The constant f (without cosine) of a Lambertian surface, `None` for any other. It holds for both directions on
    /// one side that [scatters](Bsdf::scatters_on).
    #[inline]
    pub fn diffuse_only(&self) -> Option<Rgb> {
        match &self.kind {
            Kind::Diffuse(b) => Some(b.reflectance * FRAC_1_PI),
            _ => None,
        }
    }

    /// Approximate share of the light that meets the surface and is scattered anywhere, by all lobes.
    pub fn albedo(&self) -> Rgb {
        match &self.kind {
            Kind::Diffuse(b) => b.reflectance,
            Kind::Conductor(b) => b.fresnel(1.0),
            Kind::RoughConductor(b) => b.metal.fresnel(1.0),
            Kind::Dielectric(b) => b.albedo(1),
            Kind::ThinDielectric(b) => b.0.albedo(2),
            Kind::RoughDielectric(b) => b.interface.albedo(1),
            Kind::Plastic(b) => b.albedo(),
            Kind::RoughPlastic(b) => b.albedo(),
            Kind::Principled(b) => b.albedo(),
            Kind::PrincipledThin(b) => b.albedo(),
            Kind::Phong(b) => b.albedo(),
            Kind::Ward(b) => b.albedo(),
            Kind::OrenNayar(b) => b.albedo(),
            Kind::DiffuseTransmitter(b) => b.transmittance,
            Kind::Blend(b) => b.albedo(),
            Kind::Coated(b) => b.albedo(),
            Kind::Perturbed(b) => b.nested.albedo(),
        }
    }

    #[inline]
    fn flips(&self, wo: Vec3) -> bool {
        self.two_sided && wo.z < 0.0
    }
}

impl Kind<'_> {
    fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        let part = |alpha| share.of(alpha);
        match self {
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) => Rgb::ZERO,
            Kind::Diffuse(b) => b.eval(wo, wi),
            Kind::RoughConductor(b) => match part(b.microfacet.roughness()) {
                0.0 => Rgb::ZERO,
                part => b.eval(wo, wi) * part,
            },
            Kind::RoughDielectric(b) => match part(b.roughness()) {
                0.0 => Rgb::ZERO,
                part => b.eval(wo, wi, mode) * part,
            },
            Kind::Plastic(b) => b.eval(wo, wi),
            Kind::RoughPlastic(b) => b.eval(wo, wi, part(b.roughness())),
            Kind::Principled(b) => b.eval(wo, wi, mode, share),
            Kind::PrincipledThin(b) => b.eval(wo, wi, mode, share),
            Kind::Phong(b) => b.eval(wo, wi, share),
            Kind::Ward(b) => b.eval(wo, wi, share),
            Kind::OrenNayar(b) => b.eval(wo, wi),
            Kind::DiffuseTransmitter(b) => b.eval(wo, wi),
            Kind::Blend(b) => b.eval(wo, wi, mode, share),
            Kind::Coated(b) => b.eval(wo, wi, mode, share),
            Kind::Perturbed(b) => b.eval(wo, wi, mode, share),
        }
    }

    fn pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        match self {
            Kind::Conductor(_) | Kind::Dielectric(_) | Kind::ThinDielectric(_) => 0.0,
            Kind::Diffuse(b) => b.pdf_w(wo, wi),
            Kind::RoughConductor(b) => b.pdf_w(wo, wi),
            Kind::RoughDielectric(b) => b.pdf_w(wo, wi),
            Kind::Plastic(b) => b.pdf_w(wo, wi),
            Kind::RoughPlastic(b) => b.pdf_w(wo, wi),
            Kind::Principled(b) => b.pdf_w(wo, wi),
            Kind::PrincipledThin(b) => b.pdf_w(wo, wi, mode),
            Kind::Phong(b) => b.pdf_w(wo, wi),
            Kind::Ward(b) => b.pdf_w(wo, wi),
            Kind::OrenNayar(b) => b.pdf_w(wo, wi),
            Kind::DiffuseTransmitter(b) => b.pdf_w(wo, wi),
            Kind::Blend(b) => b.pdf_w(wo, wi, mode),
            Kind::Coated(b) => b.pdf_w(wo, wi, mode),
            Kind::Perturbed(b) => b.pdf_w(wo, wi, mode),
        }
    }

    fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        match self {
            Kind::Diffuse(b) => b.sample(wo, u),
            Kind::Conductor(b) => b.sample(wo),
            Kind::RoughConductor(b) => b.sample(wo, u),
            Kind::Dielectric(b) => b.sample(wo, u_lobe, mode),
            Kind::ThinDielectric(b) => b.sample(wo, u_lobe),
            Kind::RoughDielectric(b) => b.sample(wo, u_lobe, u, mode),
            Kind::Plastic(b) => b.sample(wo, u_lobe, u),
            Kind::RoughPlastic(b) => b.sample(wo, u_lobe, u),
            Kind::Principled(b) => b.sample(wo, u_lobe, u, mode),
            Kind::PrincipledThin(b) => b.sample(wo, u_lobe, u, mode),
            Kind::Phong(b) => b.sample(wo, u_lobe, u),
            Kind::Ward(b) => b.sample(wo, u_lobe, u),
            Kind::OrenNayar(b) => b.sample(wo, u),
            Kind::DiffuseTransmitter(b) => b.sample(wo, u),
            Kind::Blend(b) => b.sample(wo, u_lobe, u, mode),
            Kind::Coated(b) => b.sample(wo, u_lobe, u, mode),
            Kind::Perturbed(b) => b.sample(wo, u_lobe, u, mode),
        }
    }

    fn roughness(&self) -> Option<f32> {
        match self {
            Kind::RoughConductor(b) => Some(b.microfacet.roughness()),
            Kind::RoughDielectric(b) => Some(b.roughness()),
            Kind::RoughPlastic(b) => Some(b.roughness()),
            Kind::Principled(b) => Some(b.roughness()),
            Kind::PrincipledThin(b) => b.roughness(),
            Kind::Phong(b) => Some(b.roughness()),
            Kind::Ward(b) => Some(b.roughness()),
            _ => None,
        }
    }

    /// Whether light that arrives from below is scattered, there or above.
    fn scatters_below(&self) -> bool {
        match self {
            Kind::Blend(b) => b.any(Bsdf::scatters_below),
            Kind::Coated(b) => b.nested.scatters_below(),
            Kind::Perturbed(b) => b.nested.scatters_below(),
            kind => kind.transmits(),
        }
    }

    fn transmits(&self) -> bool {
        match self {
            Kind::Dielectric(_)
            | Kind::ThinDielectric(_)
            | Kind::RoughDielectric(_)
            | Kind::PrincipledThin(_)
            | Kind::DiffuseTransmitter(_) => true,
            Kind::Principled(b) => b.transmits(),
            Kind::Blend(b) => b.any(Bsdf::transmits),
            Kind::Perturbed(b) => b.nested.transmits(),
            _ => false,
        }
    }
}

/// `x` into 0..`most`; what is no number becomes 0.
fn up_to(most: f32, x: f32) -> f32 {
    if x > 0.0 { x.min(most) } else { 0.0 }
}

/// Seen from behind.
#[inline]
fn mirror(w: Vec3) -> Vec3 {
    Vec3::new(w.x, w.y, -w.z)
}

/// Mirror reflection of `w` about the unit vector `m`.
#[inline]
fn reflect(w: Vec3, m: Vec3) -> Vec3 {
    m * (2.0 * w.dot(m)) - w
}
