//! Metals, smooth and rough. Opaque: they reflect from the front side.

use super::{BsdfSample, fresnel, microfacet::Microfacet, reflect};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// A smooth metal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conductor {
    pub(super) eta: Rgb,
    pub(super) k: Rgb,
    pub(super) reflectance: Rgb,
}

impl Conductor {
    #[inline]
    pub(super) fn fresnel(&self, cos: f32) -> Rgb {
        self.reflectance * fresnel::conductor(cos, self.eta, self.k)
    }

    pub(super) fn sample(&self, wo: Vec3) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        Some(BsdfSample::delta(Vec3::new(-wo.x, -wo.y, wo.z), self.fresnel(wo.z), 1.0))
    }
}

/// A metal with microfacets (Walter et al. 2007, Eq. 20).
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughConductor {
    pub(super) metal: Conductor,
    pub(super) microfacet: Microfacet,
}

impl RoughConductor {
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let m = (wo + wi).normalize();
        self.metal.fresnel(wo.dot(m)) * self.microfacet.reflection(wo, wi, m)
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        self.microfacet.reflection_pdf_w(wo, (wo + wi).normalize())
    }

    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let m = self.microfacet.sample(wo, u);
        let cos = wo.dot(m);
        let wi = reflect(wo, m);
        let pdf_w = self.microfacet.reflection_pdf_w(wo, m);
        if wi.z <= 0.0 || cos <= 0.0 || pdf_w <= 0.0 {
            return None;
        }
        Some(BsdfSample::smooth(wi, self.metal.fresnel(cos) * self.microfacet.weight(wo, wi), pdf_w))
    }
}
