//! Lambertian reflection.

use super::BsdfSample;
use crate::math::{Rgb, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Reflects from the front side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Diffuse {
    pub(super) reflectance: Rgb,
}

impl Diffuse {
    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if wo.z > 0.0 && wi.z > 0.0 { self.reflectance * (FRAC_1_PI * wi.z) } else { Rgb::ZERO }
    }

    #[inline]
    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z > 0.0 { warp::cosine_hemisphere_pdf_w(wi) } else { 0.0 }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = warp::cosine_hemisphere(u);
        Some(BsdfSample::smooth(wi, self.reflectance, warp::cosine_hemisphere_pdf_w(wi)))
    }
}
