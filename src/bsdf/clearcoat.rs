//! The second, isotropic specular lobe of the principled model: Burley's GTR1 distribution, which has longer tails than GGX.

use crate::math::Rgb;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Roughness that the shadowing is computed with, whatever the lobe's own (Burley 2012, §5.6).
const SHADOWING_ALPHA: f32 = 0.25;

/// A thin coat of polyurethane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clearcoat {
    /// 0 for no coat, 1 for the usual one, which reflects a quarter of what the formula of microfacets gives.
    pub(super) weight: f32,
    pub(super) alpha: f32,
}

impl Clearcoat {
    /// `gloss` from 0 (satin) to 1.
    pub(super) fn new(weight: f32, gloss: f32) -> Self {
        Clearcoat { weight, alpha: 0.1 + (0.001 - 0.1) * gloss }
    }

    /// D(m) (Burley 2012, appendix B), with the sine taken from `m` itself: near the pole, 1 − cos² would be all rounding.
    fn d(&self, m: Vec3) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        let d = (alpha2 - 1.0) / (PI * alpha2.ln() * (m.truncate().length_squared() + alpha2 * m.z * m.z));
        // False for what is undefined as well.
        if d * m.z > 1e-20 { d } else { 0.0 }
    }

    /// f·cosθ_i above the surface, `m` halfway; `schlick` is (1 − cosθ_m)⁵. Mitsuba leaves the 1/(cosθ_o cosθ_i) out.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, m: Vec3, schlick: f32) -> Rgb {
        let fresnel = 0.04 + 0.96 * schlick;
        Rgb::splat(0.25 * self.weight * fresnel * self.d(m) * shadowing(wo.z) * shadowing(wi.z) * wi.z)
    }

    /// Pdf of `wi` when `m` is sampled and reflects `wo` under the cosine `o`.
    pub(super) fn pdf_w(&self, o: f32, m: Vec3) -> f32 {
        match self.d(m) {
            0.0 => 0.0,
            d => d * m.z / (4.0 * o),
        }
    }

    /// Samples a normal with pdf D(m) cosθ_m (Burley 2012, appendix B).
    pub(super) fn sample(&self, u: Vec2) -> Vec3 {
        let alpha2 = self.alpha * self.alpha;
        let sin2 = (alpha2 * (-u.y * alpha2.ln()).exp_m1() / (1.0 - alpha2)).clamp(0.0, 1.0);
        let (sin_phi, cos_phi) = (TAU * u.x).sin_cos();
        let sin = sin2.sqrt();
        Vec3::new(sin * cos_phi, sin * sin_phi, (1.0 - sin2).sqrt())
    }
}

/// Smith's G₁ of GGX.
fn shadowing(cos: f32) -> f32 {
    let (cos2, alpha2) = (cos * cos, SHADOWING_ALPHA * SHADOWING_ALPHA);
    2.0 * cos / (cos + (cos2 + alpha2 * (1.0 - cos2)).sqrt())
}
