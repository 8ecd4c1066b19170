//! Diffuse reflection of rough surfaces: V-shaped grooves of Lambertian sides. Oren & Nayar 1994, "Generalization of
//! Lambert's Reflectance Model".

use super::{BsdfSample, up_to};
use crate::math::{Rgb, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_1_SQRT_2};

/// Reflects from the front side.
#[derive(Clone, Copy, Debug)]
pub(super) struct OrenNayar {
    reflectance: Rgb,
    /// Variance of the grooves' slopes as angles.
    sigma2: f32,
    /// By the qualitative model, without interreflection.
    fast: bool,
}

/// A pair of directions as the model sees it.
struct Angles {
    /// Of the difference of azimuths.
    cos_phi: f32,
    /// The greater angle to the normal.
    alpha: f32,
    sin_alpha: f32,
    /// The lesser angle.
    beta: f32,
    sin_beta: f32,
    cos_beta: f32,
}

impl Angles {
    fn new(wo: Vec3, wi: Vec3) -> Self {
        let (sin_o, sin_i) = (wo.truncate().length(), wi.truncate().length());
        // Without an azimuth: Mitsuba's zero.
        let cos_phi = if sin_o > 1e-4 && sin_i > 1e-4 {
            (wo.truncate().dot(wi.truncate()) / (sin_o * sin_i)).clamp(-1.0, 1.0)
        } else {
            0.0
        };
        let (steep, sin_beta, flat, sin_alpha) =
            if wo.z > wi.z { (wo, sin_o, wi, sin_i) } else { (wi, sin_i, wo, sin_o) };
        Angles {
            cos_phi,
            alpha: sin_alpha.atan2(flat.z),
            sin_alpha,
            beta: sin_beta.atan2(steep.z),
            sin_beta,
            cos_beta: steep.z,
        }
    }
}

impl OrenNayar {
    /// `alpha` is the roughness of Beckmann facets alike.
    pub(super) fn new(reflectance: Rgb, alpha: f32, fast: bool) -> Self {
        // As Mitsuba 0.6 has it: slopes of variance α²/2, taken for angles.
        let sigma = FRAC_1_SQRT_2 * up_to(1e3, alpha);
        OrenNayar { reflectance: reflectance.max(Rgb::ZERO).min(Rgb::ONE), sigma2: sigma * sigma, fast }
    }

    /// To diffuse light; the means of what the coefficients are multiplied with are found by quadrature.
    pub(super) fn albedo(&self) -> Rgb {
        let s = self.sigma2;
        let direct = 1.0 - 0.5 * s / (s + 0.33);
        let (grooves, double) = if self.fast { (0.096, 0.0) } else { (0.028, 0.17 * s / (s + 0.13)) };
        self.reflectance * (direct + grooves * s / (s + 0.09) + self.reflectance * double)
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let angles = Angles::new(wo, wi);
        let f = if self.fast { self.qualitative(&angles, wi.z) } else { self.full(&angles, wo.z, wi.z) };
        f.max(Rgb::ZERO)
    }

    /// Eq. 30 with cosθ_i, which takes the pole of tanβ.
    fn qualitative(&self, a: &Angles, cos_i: f32) -> Rgb {
        let s = self.sigma2;
        let (c1, c2) = (1.0 - 0.5 * s / (s + 0.33), 0.45 * s / (s + 0.09));
        let tan_beta_cos = a.sin_beta * (cos_i / a.cos_beta);
        self.reflectance * (FRAC_1_PI * (c1 * cos_i + c2 * a.cos_phi.max(0.0) * a.sin_alpha * tan_beta_cos))
    }

    /// Eqs. 27 to 29 with cosθ_i.
    fn full(&self, a: &Angles, cos_o: f32, cos_i: f32) -> Rgb {
        let s = self.sigma2;
        let tan_beta_cos = a.sin_beta * (cos_i / a.cos_beta);
        let tan_half_cos = (a.sin_alpha + a.sin_beta) * (cos_i / (cos_i + cos_o));
        let beta = 2.0 * FRAC_1_PI * a.beta;
        let product = 4.0 * FRAC_1_PI * FRAC_1_PI * a.alpha * a.beta;
        let c1 = 1.0 - 0.5 * s / (s + 0.33);
        let spread = if a.cos_phi > 0.0 { a.sin_alpha } else { a.sin_alpha - beta * beta * beta };
        let c2 = 0.45 * s / (s + 0.09) * spread;
        let c3 = 0.125 * s / (s + 0.09) * product * product;
        let c4 = 0.17 * s / (s + 0.13);
        let single = c1 * cos_i + a.cos_phi * c2 * tan_beta_cos + (1.0 - a.cos_phi.abs()) * c3 * tan_half_cos;
        let double = c4 * (1.0 - a.cos_phi * beta * beta) * cos_i;
        self.reflectance * (FRAC_1_PI * (Rgb::splat(single) + self.reflectance * double))
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z > 0.0 { warp::cosine_hemisphere_pdf_w(wi) } else { 0.0 }
    }

    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = warp::cosine_hemisphere(u);
        let pdf_w = warp::cosine_hemisphere_pdf_w(wi);
        Some(BsdfSample::smooth(wi, self.eval(wo, wi) / pdf_w, pdf_w))
    }
}
