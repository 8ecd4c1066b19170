//! Burley's principled model as Mitsuba has it: a diffuse base with sheen, a specular lobe that blends metal, plastic and
//! glass, and a clear coat. Burley 2012, "Physically Based Shading at Disney", and 2015, "Extending the Disney BRDF to a
//! BSDF with Integrated Subsurface Scattering".

use super::dielectric::{Dielectric, RoughDielectric};
use super::{BsdfSample, Mode, Share, clearcoat::Clearcoat, fresnel, reflect, up_to};
use super::{Distribution, Microfacet};
use crate::math::{Rgb, luminance, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Mean of (1 − cosθ)⁵ over the cosine-weighted hemisphere.
const MEAN_SCHLICK: f32 = 1.0 / 21.0;

/// Share of diffuse light that full sheen reflects, by quadrature.
const SHEEN_ALBEDO: f32 = 0.0116;

/// Parameters of the principled model, of colours `C` and numbers `S` that are values or still textures. They range from 0
/// to 1 unless noted, and are clamped to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledParams<C = Rgb, S = f32> {
    /// Colour of the base, the metal, and (its root) of what is transmitted.
    pub base_color: C,
    /// Root of the specular lobe's α; may exceed 1.
    pub roughness: S,
    /// How much longer the specular lobe is along ∂p/∂u.
    pub anisotropic: S,
    /// From dielectric to metal.
    pub metallic: S,
    /// From opaque to transparent, of what is not metallic.
    pub spec_trans: S,
    /// Interior over exterior index of refraction. As in Mitsuba, an index of 1 makes even metals black.
    pub eta: f32,
    /// How much `base_color` colours the dielectric reflection.
    pub spec_tint: S,
    /// Reflection of fibres at grazing angles; may exceed 1.
    pub sheen: S,
    /// How much `base_color` colours the sheen.
    pub sheen_tint: S,
    /// From diffuse to a look of subsurface scattering.
    pub flatness: S,
    /// Second specular lobe; may exceed 1.
    pub clearcoat: S,
    /// From satin to gloss, of the second specular lobe.
    pub clearcoat_gloss: S,
    /// Weight of the diffuse base among what is sampled. Weights are any numbers from 0.
    pub diffuse_rate: f32,
    /// Weight of the specular lobe among what is sampled.
    pub specular_rate: f32,
    /// Weight of the clear coat among what is sampled.
    pub clearcoat_rate: f32,
}

impl<C, S> PrincipledParams<C, S> {
    /// The same with `color` and `scalar` applied.
    pub fn map<D, T>(&self, color: impl Fn(&C) -> D, scalar: impl Fn(&S) -> T) -> PrincipledParams<D, T> {
        PrincipledParams {
            base_color: color(&self.base_color),
            roughness: scalar(&self.roughness),
            anisotropic: scalar(&self.anisotropic),
            metallic: scalar(&self.metallic),
            spec_trans: scalar(&self.spec_trans),
            eta: self.eta,
            spec_tint: scalar(&self.spec_tint),
            sheen: scalar(&self.sheen),
            sheen_tint: scalar(&self.sheen_tint),
            flatness: scalar(&self.flatness),
            clearcoat: scalar(&self.clearcoat),
            clearcoat_gloss: scalar(&self.clearcoat_gloss),
            diffuse_rate: self.diffuse_rate,
            specular_rate: self.specular_rate,
            clearcoat_rate: self.clearcoat_rate,
        }
    }
}

/// Into 0..1.
pub(super) fn unit(x: f32) -> f32 {
    up_to(1.0, x)
}

/// (1 − cos)⁵ (Schlick 1994).
#[inline]
pub(super) fn schlick(cos: f32) -> f32 {
    let x = (1.0 - cos).clamp(0.0, 1.0);
    (x * x) * (x * x) * x
}

/// The hue of a colour, of luminance 1.
pub(super) fn tint(color: Rgb) -> Rgb {
    let lum = luminance(color);
    if lum > 0.0 { color / lum } else { Rgb::ONE }
}

/// Facets of the specular lobe (Burley 2012, §5.4).
pub(super) fn microfacet(roughness: f32, anisotropic: f32) -> Microfacet {
    let alpha = (roughness * roughness).min(1e3);
    let aspect = (1.0 - 0.9 * anisotropic).sqrt();
    Microfacet::new(Distribution::Ggx, (alpha / aspect).max(1e-3), (alpha * aspect).max(1e-3))
}

/// Reflectance between the dielectric's and Schlick's approximation of a coloured one.
#[derive(Clone, Copy, Debug)]
pub(super) struct TintedFresnel {
    /// Weight of the dielectric's.
    pub(super) dielectric: f32,
    /// The rest at normal incidence.
    pub(super) normal: Rgb,
    /// The rest at grazing incidence.
    pub(super) grazing: f32,
}

impl TintedFresnel {
    /// `dielectric` is Fresnel's reflectance, `schlick` Schlick's weight.
    #[inline]
    pub(super) fn eval(&self, dielectric: f32, schlick: f32) -> Rgb {
        self.normal * (1.0 - schlick) + Rgb::splat(self.dielectric * dielectric + self.grazing * schlick)
    }

    pub(super) fn albedo(&self, eta: f32) -> Rgb {
        self.eval(fresnel::diffuse_reflectance(eta).max(0.0), MEAN_SCHLICK)
    }
}

/// Reflectance at normal incidence.
pub(super) fn reflectance_at_normal(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// Fresnel's reflectance, and Schlick's weight of the angle in the thinner medium.
#[inline]
pub(super) fn fresnel_and_schlick(cos: f32, eta: f32) -> (f32, f32) {
    let (reflectance, cos_t) = fresnel::dielectric(cos, eta);
    (reflectance, schlick(if eta > 1.0 { cos } else { cos_t }))
}

/// What reflects diffusely: the base and its sheen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Base {
    pub(super) color: Rgb,
    pub(super) roughness: f32,
    pub(super) flatness: f32,
    pub(super) sheen: Rgb,
}

impl Base {
    /// f·cosθ_i above the surface, `cos_d` being the cosine between either direction and the one halfway.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, cos_d: f32) -> Rgb {
        let (fo, fi) = (schlick(wo.z), schlick(wi.z));
        let rr = 2.0 * self.roughness * cos_d * cos_d;
        // Burley 2015, Eq. 4.
        let diffuse = (1.0 - 0.5 * fo) * (1.0 - 0.5 * fi) + rr * (fo + fi + fo * fi * (rr - 1.0));
        // Burley 2012, §5.3, after Hanrahan and Krueger; with the cosine, so that it is finite.
        let fss90 = 0.5 * rr;
        let fss = (1.0 + (fss90 - 1.0) * fo) * (1.0 + (fss90 - 1.0) * fi);
        let flat = 1.25 * (fss * (wi.z / (wi.z + wo.z) - 0.5 * wi.z) + 0.5 * wi.z);
        let base = diffuse * wi.z + (flat - diffuse * wi.z) * self.flatness;
        self.color * (FRAC_1_PI * base) + self.sheen * (schlick(cos_d) * wi.z)
    }

    pub(super) fn albedo(&self) -> Rgb {
        self.color + self.sheen * SHEEN_ALBEDO
    }
}

/// The model at one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Principled {
    base: Base,
    coat: Clearcoat,
    fresnel: TintedFresnel,
    /// What is transparent, by the weight `trans`: all that is seen from behind.
    glass: RoughDielectric,
    trans: f32,
    /// Probabilities to sample base and coat; the rest goes to the specular lobe.
    prob_base: f32,
    prob_coat: f32,
    prob_specular: f32,
}

impl Principled {
    pub(super) fn new(p: &PrincipledParams) -> Self {
        let color = p.base_color.max(Rgb::ZERO).min(Rgb::ONE);
        let (metallic, spec_tint) = (unit(p.metallic), unit(p.spec_tint));
        let opaque = (1.0 - metallic) * (1.0 - unit(p.spec_trans));
        let trans = (1.0 - metallic) * unit(p.spec_trans);
        let sheen = p.sheen.max(0.0) * (1.0 - metallic);
        let tinted = (1.0 - metallic) * spec_tint;
        let coat = Clearcoat::new(p.clearcoat.max(0.0), unit(p.clearcoat_gloss));
        // Mitsuba leaves sheen out here, so that on glass almost nothing would sample it (and its scalar variants leave
        // it out of `eval` where nothing is opaque, which the vectorised ones do not).
        let base_weight = p.diffuse_rate * opaque.max(0.25 * sheen);
        let coat_weight = p.clearcoat_rate * 0.25 * coat.weight;
        let total = base_weight + coat_weight + p.specular_rate;
        let prob = |weight: f32| if total > 0.0 { weight / total } else { 0.0 };
        let interface = Dielectric {
            eta: p.eta,
            reflectance: Rgb::splat(trans),
            transmittance: trans * color.map(f32::sqrt),
        };
        let microfacet = microfacet(p.roughness.max(0.0), unit(p.anisotropic));
        Principled {
            base: Base {
                color: opaque * color,
                roughness: p.roughness.max(0.0),
                flatness: unit(p.flatness),
                sheen: sheen * Rgb::ONE.lerp(tint(color), unit(p.sheen_tint)),
            },
            coat,
            fresnel: TintedFresnel {
                dielectric: (1.0 - metallic) * (1.0 - spec_tint),
                normal: metallic * color + tinted * reflectance_at_normal(p.eta) * tint(color),
                grazing: metallic + tinted,
            },
            glass: RoughDielectric { interface, microfacet },
            trans,
            prob_base: prob(base_weight),
            prob_coat: prob(coat_weight),
            prob_specular: prob(p.specular_rate),
        }
    }

    fn eta(&self) -> f32 {
        self.glass.interface.eta
    }

    pub(super) fn transmits(&self) -> bool {
        self.trans > 0.0
    }

    /// Of the narrowest lobe.
    pub(super) fn roughness(&self) -> f32 {
        let specular = self.glass.microfacet.roughness();
        let glass = if self.transmits() { self.glass.roughness() } else { specular };
        let coat = if self.coat.weight > 0.0 { self.coat.alpha } else { specular };
        specular.min(glass).min(coat)
    }

    pub(super) fn albedo(&self) -> Rgb {
        let eta = self.eta();
        let specular = if eta == 1.0 { Rgb::ZERO } else { self.fresnel.albedo(eta) };
        let transmitted =
            self.glass.interface.transmittance * (1.0 - fresnel::diffuse_reflectance(eta).max(0.0));
        // 4 % and Schlick's rest, by the cosine that `Clearcoat::eval` has too much.
        let coat = 0.038 * self.coat.weight;
        (self.base.albedo() + specular + transmitted + coat).min(Rgb::ONE)
    }

    /// Whether a pair of directions is the business of the transparent part alone.
    #[inline]
    fn through_glass(wo: Vec3, wi: Vec3) -> bool {
        wo.z < 0.0 || wi.z < 0.0
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        if wo.z == 0.0 || wi.z == 0.0 {
            return Rgb::ZERO;
        }
        if Self::through_glass(wo, wi) {
            return match share.of(self.glass.roughness()) {
                part if part > 0.0 && self.transmits() => self.glass.eval(wo, wi, mode) * part,
                _ => Rgb::ZERO,
            };
        }
        let h = wo + wi;
        let (m, cos_d) = (h.normalize(), 0.5 * h.length());
        let (dielectric, schlick) = fresnel_and_schlick(cos_d, self.eta());
        let mut f = self.base.eval(wo, wi, cos_d);
        if self.coat.weight > 0.0 {
            f += self.coat.eval(wo, wi, m, schlick) * share.of(self.coat.alpha);
        }
        let part = share.of(self.glass.microfacet.roughness());
        if part > 0.0 && self.eta() != 1.0 {
            f +=
                self.fresnel.eval(dielectric, schlick) * (part * self.glass.microfacet.reflection(wo, wi, m));
        }
        f
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z == 0.0 || wi.z == 0.0 {
            return 0.0;
        }
        if Self::through_glass(wo, wi) {
            let prob = if wo.z > 0.0 { self.prob_specular * self.trans } else { 1.0 };
            return if self.transmits() { prob * self.glass.pdf_w(wo, wi) } else { 0.0 };
        }
        let h = wo + wi;
        let (m, cos_d) = (h.normalize(), 0.5 * h.length());
        let transmitted = self.trans * (1.0 - fresnel::dielectric(cos_d, self.eta()).0);
        let specular = (1.0 - transmitted) * self.glass.microfacet.reflection_pdf_w(wo, m);
        self.prob_base * warp::cosine_hemisphere_pdf_w(wi)
            + self.prob_coat * self.coat.pdf_w(cos_d, m)
            + self.prob_specular * specular
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return if self.transmits() { self.glass.sample(wo, u_lobe, u, mode) } else { None };
        }
        let u_coat = u_lobe - self.prob_base;
        let u_specular = u_coat - self.prob_coat;
        let (wi, eta) = if u_coat < 0.0 {
            (warp::cosine_hemisphere(u), 1.0)
        } else if u_specular < 0.0 {
            (reflect(wo, self.coat.sample(u)), 1.0)
        } else {
            self.sample_specular(wo, u_specular / self.prob_specular, u, mode)?
        };
        let pdf_w = self.pdf_w(wo, wi);
        let usable = (wi.z > 0.0 || eta != 1.0) && pdf_w > 0.0 && pdf_w.is_finite();
        if !usable {
            return None;
        }
        let weight = self.eval(wo, wi, mode, Share::All) / pdf_w;
        Some(BsdfSample { eta, ..BsdfSample::smooth(wi, weight, pdf_w) })
    }

    /// A direction of the specular lobe, and the index along the path. The transparent part reflects what it does not
    /// transmit, the rest reflects everything.
    fn sample_specular(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<(Vec3, f32)> {
        if u_lobe < self.trans {
            let s = self.glass.sample(wo, u_lobe / self.trans, u, mode)?;
            return Some((s.wi, s.eta));
        }
        Some((reflect(wo, self.glass.microfacet.sample(wo, u)), 1.0))
    }
}
