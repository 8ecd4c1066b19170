//! Lambertian transmission.

use super::{BsdfSample, mirror};
use crate::math::{Rgb, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Transmits from both sides and reflects nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct DiffuseTransmitter {
    pub(super) transmittance: Rgb,
}

impl DiffuseTransmitter {
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.transmittance * self.pdf_w(wo, wi)
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        let crosses = (wo.z > 0.0 && wi.z < 0.0) || (wo.z < 0.0 && wi.z > 0.0);
        if crosses { FRAC_1_PI * wi.z.abs() } else { 0.0 }
    }

    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let up = warp::cosine_hemisphere(u);
        let wi = if wo.z > 0.0 { mirror(up) } else { up };
        Some(BsdfSample::smooth(wi, self.transmittance, warp::cosine_hemisphere_pdf_w(up)))
    }
}
