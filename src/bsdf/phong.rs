//! Phong's lobe over a diffuse base, normalised. Lafortune & Willems 1994, "Using the Modified Phong Reflectance Model for
//! Physically Based Rendering".

use super::{BsdfSample, Share, up_to};
use crate::math::{Frame, Rgb, luminance, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};

/// A diffuse base, and how often a lobe over it is sampled instead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glossy {
    diffuse: Rgb,
    specular: Rgb,
    /// Probability of the lobe.
    pub(super) prob: f32,
}

impl Glossy {
    /// As in Mitsuba 0.6, more than there is to reflect is scaled down to 99 % of it.
    pub(super) fn new(diffuse: Rgb, specular: Rgb) -> Self {
        let (diffuse, specular) = (diffuse.max(Rgb::ZERO), specular.max(Rgb::ZERO));
        let most = (diffuse + specular).max_element();
        let scale = if most > 1.0 { 0.99 / most } else { 1.0 };
        let (diffuse, specular) = (scale * diffuse, scale * specular);
        let (d, s) = (luminance(diffuse), luminance(specular));
        Glossy { diffuse, specular, prob: if d + s > 0.0 { s / (d + s) } else { 0.0 } }
    }

    /// `lobe` is that of the lobe if it reflected everything.
    pub(super) fn albedo(&self, lobe: f32) -> Rgb {
        self.diffuse + lobe * self.specular
    }

    /// f·cosθ_i above the surface, `lobe` being that of the lobe if it reflected everything.
    pub(super) fn eval(&self, wi: Vec3, lobe: f32) -> Rgb {
        self.diffuse * (FRAC_1_PI * wi.z) + self.specular * lobe
    }

    pub(super) fn pdf_w(&self, wi: Vec3, lobe_pdf_w: f32) -> f32 {
        self.prob * lobe_pdf_w + (1.0 - self.prob) * warp::cosine_hemisphere_pdf_w(wi)
    }
}

/// The model at one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phong {
    base: Glossy,
    exponent: f32,
}

impl Phong {
    pub(super) fn new(diffuse: Rgb, specular: Rgb, exponent: f32) -> Self {
        Phong { base: Glossy::new(diffuse, specular), exponent: up_to(1e7, exponent) }
    }

    /// Of facets that spread light as much (Walter et al. 2007, Eq. 29).
    pub(super) fn roughness(&self) -> f32 {
        (2.0 / (self.exponent + 2.0)).sqrt()
    }

    pub(super) fn albedo(&self) -> Rgb {
        // A narrow lobe reflects in proportion to cosθ_o.
        self.base.albedo(2.0 / 3.0)
    }

    /// cosⁿ of the angle between `wi` and the mirrored `wo`, through 1 − cos, which a great power does not turn to noise.
    fn power(&self, wo: Vec3, wi: Vec3) -> f32 {
        let one_minus_cos = 0.5 * (wi - Vec3::new(-wo.x, -wo.y, wo.z)).length_squared();
        if one_minus_cos < 1.0 { (self.exponent * (-one_minus_cos).ln_1p()).exp() } else { 0.0 }
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, share: Share) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let part = share.of(self.roughness());
        let lobe = if part > 0.0 { part * (self.exponent + 2.0) / TAU * self.power(wo, wi) } else { 0.0 };
        self.base.eval(wi, lobe * wi.z)
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        self.base.pdf_w(wi, (self.exponent + 1.0) / TAU * self.power(wo, wi))
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = if u_lobe < self.base.prob { self.sample_lobe(wo, u) } else { warp::cosine_hemisphere(u) };
        let pdf_w = self.pdf_w(wo, wi);
        let usable = pdf_w > 0.0 && pdf_w.is_finite();
        usable.then(|| BsdfSample::smooth(wi, self.eval(wo, wi, Share::All) / pdf_w, pdf_w))
    }

    fn sample_lobe(&self, wo: Vec3, u: Vec2) -> Vec3 {
        // cosα = u^(1/(n+1)).
        let ln_cos = (1.0 - u.y).ln() / (self.exponent + 1.0);
        let sin = (-(2.0 * ln_cos).exp_m1()).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u.x).sin_cos();
        let local = Vec3::new(sin * cos_phi, sin * sin_phi, ln_cos.exp());
        Frame::from_normal(Vec3::new(-wo.x, -wo.y, wo.z)).to_world(local).normalize()
    }
}
