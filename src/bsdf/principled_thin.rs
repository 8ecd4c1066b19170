//! The thin principled model: a sheet whose two sides are alike, which reflects and transmits diffusely and specularly.
//! Burley 2015, "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering".

use super::principled::{
    Base, TintedFresnel, fresnel_and_schlick, microfacet, reflectance_at_normal, tint, unit,
};
use super::{BsdfSample, Mode, Share, fresnel, microfacet::Microfacet, mirror, reflect};
use crate::math::{Rgb, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Parameters of the thin principled model, of colours `C` and numbers `S` that are values or still textures. They range
/// from 0 to 1 unless noted, and are clamped to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledThinParams<C = Rgb, S = f32> {
    /// Colour of the base and of what is transmitted.
    pub base_color: C,
    /// Root of the specular reflection's α; may exceed 1.
    pub roughness: S,
    /// How much longer the specular lobes are along ∂p/∂u.
    pub anisotropic: S,
    /// From diffuse to specular.
    pub spec_trans: S,
    /// Index of refraction of the sheet over the one around it.
    pub eta: S,
    /// How much `base_color` colours the specular reflection.
    pub spec_tint: S,
    /// Reflection of fibres at grazing angles; may exceed 1.
    pub sheen: S,
    /// How much `base_color` colours the sheen.
    pub sheen_tint: S,
    /// From diffuse to a look of subsurface scattering.
    pub flatness: S,
    /// From diffuse reflection (0) to diffuse transmission (2).
    pub diff_trans: S,
    /// Weight of the diffuse reflection among what is sampled. Weights are any numbers from 0.
    pub diffuse_reflection_rate: f32,
    /// Weight of the diffuse transmission among what is sampled.
    pub diffuse_transmission_rate: f32,
    /// Weight of the specular reflection among what is sampled.
    pub specular_reflection_rate: f32,
    /// Weight of the specular transmission among what is sampled.
    pub specular_transmission_rate: f32,
}

impl<C, S> PrincipledThinParams<C, S> {
    /// The same with `color` and `scalar` applied.
    pub fn map<D, T>(&self, color: impl Fn(&C) -> D, scalar: impl Fn(&S) -> T) -> PrincipledThinParams<D, T> {
        PrincipledThinParams {
            base_color: color(&self.base_color),
            roughness: scalar(&self.roughness),
            anisotropic: scalar(&self.anisotropic),
            spec_trans: scalar(&self.spec_trans),
            eta: scalar(&self.eta),
            spec_tint: scalar(&self.spec_tint),
            sheen: scalar(&self.sheen),
            sheen_tint: scalar(&self.sheen_tint),
            flatness: scalar(&self.flatness),
            diff_trans: scalar(&self.diff_trans),
            diffuse_reflection_rate: self.diffuse_reflection_rate,
            diffuse_transmission_rate: self.diffuse_transmission_rate,
            specular_reflection_rate: self.specular_reflection_rate,
            specular_transmission_rate: self.specular_transmission_rate,
        }
    }
}

/// The specular lobes.
#[derive(Clone, Copy, Debug)]
struct Specular {
    weight: f32,
    eta: f32,
    fresnel: TintedFresnel,
    reflecting: Microfacet,
    /// Of what goes straight through, only spread by two rough interfaces.
    transmitting: Microfacet,
    transmittance: Rgb,
}

/// The model at one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct PrincipledThin {
    base: Base,
    /// Of the Lambertian transmission.
    transmittance: Rgb,
    specular: Specular,
    /// Probabilities of diffuse reflection and transmission, specular reflection and transmission.
    probs: [f32; 4],
}

impl PrincipledThin {
    pub(super) fn new(p: &PrincipledThinParams) -> Self {
        let color = p.base_color.max(Rgb::ZERO).min(Rgb::ONE);
        let roughness = p.roughness.max(0.0);
        let specular = unit(p.spec_trans);
        let transmitted = (1.0 - specular) * unit(0.5 * p.diff_trans);
        let reflected = (1.0 - specular) * (1.0 - unit(0.5 * p.diff_trans));
        let weights = [
            p.diffuse_reflection_rate * reflected,
            p.diffuse_transmission_rate * transmitted,
            p.specular_reflection_rate * 0.5 * specular,
            p.specular_transmission_rate * 0.5 * specular,
        ];
        let total: f32 = weights.iter().sum();
        PrincipledThin {
            base: Base {
                color: reflected * color,
                roughness,
                flatness: unit(p.flatness),
                sheen: reflected * p.sheen.max(0.0) * Rgb::ONE.lerp(tint(color), unit(p.sheen_tint)),
            },
            transmittance: transmitted * color,
            specular: Specular::new(p, color, roughness, specular),
            probs: weights.map(|w| if total > 0.0 { w / total } else { 0.0 }),
        }
    }

    /// Of the narrower specular lobe.
    pub(super) fn roughness(&self) -> Option<f32> {
        let s = &self.specular;
        (s.weight > 0.0).then(|| s.reflecting.roughness().min(s.transmitting.roughness()))
    }

    pub(super) fn albedo(&self) -> Rgb {
        let s = &self.specular;
        let (reflected, transmitted) = if s.weight > 0.0 {
            let reflected = s.fresnel.albedo(s.eta);
            let lost = fresnel::diffuse_reflectance(s.eta).clamp(0.0, 1.0);
            (reflected, s.transmittance * (1.0 - lost))
        } else {
            (Rgb::ZERO, Rgb::ZERO)
        };
        (self.base.albedo() + self.transmittance + reflected + transmitted).min(Rgb::ONE)
    }

    /// f·cosθ_i; both sides are alike.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        if wo.z == 0.0 || wi.z == 0.0 {
            return Rgb::ZERO;
        }
        let (wo, wi) = above(wo, wi);
        if wi.z > 0.0 {
            let cos_d = 0.5 * (wo + wi).length();
            self.base.eval(wo, wi, cos_d) + self.specular.reflection(wo, wi, share)
        } else {
            self.transmittance * (FRAC_1_PI * -wi.z) + self.specular.transmission(wo, wi, mode, share)
        }
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        if wo.z == 0.0 || wi.z == 0.0 {
            return 0.0;
        }
        let (wo, wi) = above(wo, wi);
        let s = &self.specular;
        let [diffuse_r, diffuse_t, specular_r, specular_t] = self.probs;
        if wi.z > 0.0 {
            let specular = if specular_r > 0.0 { s.reflection_pdf_w(wo, wi) } else { 0.0 };
            diffuse_r * warp::cosine_hemisphere_pdf_w(wi) + specular_r * specular
        } else {
            let specular = if specular_t > 0.0 { s.transmission_pdf_w(wo, wi, mode) } else { 0.0 };
            diffuse_t * warp::cosine_hemisphere_pdf_w(-wi) + specular_t * specular
        }
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let (up, _) = above(wo, wo);
        let [diffuse_r, diffuse_t, specular_r, _] = self.probs;
        let s = &self.specular;
        let (wi, reflects) = if u_lobe < diffuse_r {
            (warp::cosine_hemisphere(u), true)
        } else if u_lobe < diffuse_r + diffuse_t {
            (mirror(warp::cosine_hemisphere(u)), false)
        } else if u_lobe < diffuse_r + diffuse_t + specular_r {
            (reflect(up, s.reflecting.sample(up, u)), true)
        } else {
            let wi = mirror(reflect(up, s.transmitting.sample(up, u)));
            Specular::transmitting_facet(up, wi, mode)?;
            (wi, false)
        };
        if (wi.z > 0.0) != reflects {
            return None;
        }
        let wi = if wo.z < 0.0 { mirror(wi) } else { wi };
        let pdf_w = self.pdf_w(wo, wi, mode);
        let usable = pdf_w > 0.0 && pdf_w.is_finite();
        usable.then(|| BsdfSample::smooth(wi, self.eval(wo, wi, mode, Share::All) / pdf_w, pdf_w))
    }
}

impl Specular {
    fn new(p: &PrincipledThinParams, color: Rgb, roughness: f32, weight: f32) -> Self {
        let eta = p.eta.clamp(1e-2, 1e2);
        let eta = if eta.is_nan() { 1.5 } else { eta };
        let (anisotropic, spec_tint) = (unit(p.anisotropic), unit(p.spec_tint));
        let tinted = weight * spec_tint;
        Specular {
            weight,
            eta,
            fresnel: TintedFresnel {
                dielectric: weight * (1.0 - spec_tint),
                normal: tinted * reflectance_at_normal(eta) * tint(color),
                grazing: tinted,
            },
            reflecting: microfacet(roughness, anisotropic),
            // Burley 2015, figure 15.
            transmitting: microfacet((0.65 * eta - 0.35) * roughness, anisotropic),
            transmittance: weight * color,
        }
    }

    fn reflection(&self, wo: Vec3, wi: Vec3, share: Share) -> Rgb {
        let part = share.of(self.reflecting.roughness());
        if part * self.weight <= 0.0 {
            return Rgb::ZERO;
        }
        let h = wo + wi;
        let (dielectric, schlick) = fresnel_and_schlick(0.5 * h.length(), self.eta);
        let scattered = self.reflecting.reflection(wo, wi, h.normalize());
        self.fresnel.eval(dielectric, schlick) * (part * scattered)
    }

    fn reflection_pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.reflecting.reflection_pdf_w(wo, (wo + wi).normalize())
    }

    /// The facet that reflects `wo` to the mirror image of `wi`. Mitsuba drops facets that face away from the eye's side
    /// where the light comes from, a few at grazing angles. That is not symmetric, so that flux, to take the same way back,
    /// needs the test of the other direction.
    fn transmitting_facet(wo: Vec3, wi: Vec3, mode: Mode) -> Option<Vec3> {
        let m = (wo + mirror(wi)).normalize();
        let light = if mode == Mode::Radiance { wi } else { mirror(wo) };
        (light.dot(m) < 0.0).then_some(m) // None for NaN
    }

    fn transmission(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        let part = share.of(self.transmitting.roughness());
        if part * self.weight <= 0.0 {
            return Rgb::ZERO;
        }
        let Some(m) = Self::transmitting_facet(wo, wi, mode) else { return Rgb::ZERO };
        let (dielectric, _) = fresnel_and_schlick(wo.dot(m).max(0.0), self.eta);
        let scattered = self.transmitting.reflection(wo, mirror(wi), m);
        self.transmittance * (part * (1.0 - dielectric) * scattered)
    }

    fn transmission_pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        let facet = Self::transmitting_facet(wo, wi, mode);
        facet.map_or(0.0, |m| self.transmitting.reflection_pdf_w(wo, m))
    }
}

/// Both mirrored if `wo` is below.
#[inline]
fn above(wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
    if wo.z < 0.0 { (mirror(wo), mirror(wi)) } else { (wo, wi) }
}
