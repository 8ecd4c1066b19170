//! Interfaces between transparent media: smooth, rough, and thin sheets. They scatter from both sides; seen from the
//! back they are evaluated mirrored, with the inverse index.

use super::{BsdfSample, Mode, fresnel, microfacet::Microfacet, mirror, reflect};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// A smooth interface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dielectric {
    /// Index below the surface over the index above.
    pub(super) eta: f32,
    pub(super) reflectance: Rgb,
    pub(super) transmittance: Rgb,
}

/// Radiance is compressed into fewer directions inside the denser medium (Veach 1997, Eq. 5.12).
#[inline]
fn radiance_scale(mode: Mode, eta: f32) -> f32 {
    match mode {
        Mode::Radiance => 1.0 / (eta * eta),
        Mode::Flux => 1.0,
    }
}

impl Dielectric {
    /// The same interface for a `wo` above it.
    #[inline]
    fn facing(&self, wo: Vec3) -> Self {
        if wo.z < 0.0 { Dielectric { eta: 1.0 / self.eta, ..*self } } else { *self }
    }

    /// Approximate reflectance plus transmittance of `interfaces` in a row: everything is scattered but for the tints.
    pub(super) fn albedo(&self, interfaces: u32) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).0;
        let r = if interfaces > 1 { 2.0 * r / (1.0 + r) } else { r };
        self.transmittance.lerp(self.reflectance, r)
    }

    /// Probability of reflection.
    pub(super) fn reflects(&self, wo: Vec3) -> f32 {
        fresnel::dielectric(wo.z.abs(), self.facing(wo).eta).0
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, mode: Mode) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let eta = self.facing(wo).eta;
        let (f, cos_t) = fresnel::dielectric(wo.z.abs(), eta);
        if u_lobe < f {
            return Some(BsdfSample::delta(Vec3::new(-wo.x, -wo.y, wo.z), self.reflectance, 1.0));
        }
        let wi = Vec3::new(-wo.x / eta, -wo.y / eta, -cos_t.copysign(wo.z));
        Some(BsdfSample::delta(wi, self.transmittance * radiance_scale(mode, eta), eta))
    }
}

/// A thin sheet with both its interfaces; light goes straight through.
#[derive(Clone, Copy, Debug)]
pub(super) struct ThinDielectric(pub(super) Dielectric);

impl ThinDielectric {
    /// Probability of reflection, all orders of internal reflection: R + TRT + TR³T + … = 2R / (1 + R).
    pub(super) fn reflects(&self, wo: Vec3) -> f32 {
        let r = fresnel::dielectric(wo.z.abs(), self.0.eta).0;
        2.0 * r / (1.0 + r)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        if u_lobe < self.reflects(wo) {
            Some(BsdfSample::delta(Vec3::new(-wo.x, -wo.y, wo.z), self.0.reflectance, 1.0))
        } else {
            Some(BsdfSample::delta(-wo, self.0.transmittance, 1.0))
        }
    }
}

/// An interface with microfacets (Walter et al. 2007).
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughDielectric {
    pub(super) interface: Dielectric,
    pub(super) microfacet: Microfacet,
}

/// How a facet couples two directions, `wo` being above the surface.
struct Coupling {
    /// The facet's normal.
    m: Vec3,
    reflectance: f32,
    /// |dω_m / dω_i|, Eqs. 14 and 17.
    jacobian: f32,
}

impl RoughDielectric {
    /// How broad the lobes are. Facets turn what they transmit by an angle in proportion to n − 1, n being the greater index
    /// over the lesser: near 1 the lobe is narrow whatever the roughness. Full from n = 1.25, which leaves glass and
    /// water alone.
    pub(super) fn roughness(&self) -> f32 {
        let eta = self.interface.eta;
        self.microfacet.roughness() * (4.0 * (eta.max(1.0 / eta) - 1.0)).min(1.0)
    }

    /// The facet that couples `wo` (above) with `wi`, unless that one is seen from its back.
    #[inline]
    fn couple(wo: Vec3, wi: Vec3, eta: f32) -> Option<Coupling> {
        let reflects = wi.z > 0.0;
        // Eqs. 13 and 16.
        let m = (wo + if reflects { wi } else { wi * eta }).normalize();
        let m = if m.z < 0.0 { -m } else { m };
        Self::coupling(wo, wi, m, eta)
    }

    #[inline]
    fn coupling(wo: Vec3, wi: Vec3, m: Vec3, eta: f32) -> Option<Coupling> {
        let (o, i) = (wo.dot(m), wi.dot(m));
        // Written so that NaN fails: m is undefined where eta is 1.
        let front = o > 0.0 && i * wi.z > 0.0;
        if !front {
            return None;
        }
        let jacobian = if wi.z > 0.0 {
            0.25 / i
        } else {
            let d = o + eta * i;
            eta * eta * i.abs() / (d * d)
        };
        Some(Coupling { m, reflectance: fresnel::dielectric(o, eta).0, jacobian })
    }

    /// Brings the interface below `wo`: `wo` and `wi` mirrored alike, and the interface as seen from there.
    #[inline]
    fn above(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3, Dielectric) {
        let interface = self.interface.facing(wo);
        if wo.z < 0.0 { (mirror(wo), mirror(wi), interface) } else { (wo, wi, interface) }
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode) -> Rgb {
        let (wo, wi, Dielectric { eta, reflectance, transmittance }) = self.above(wo, wi);
        if wo.z == 0.0 || wi.z == 0.0 {
            return Rgb::ZERO;
        }
        let Some(c) = Self::couple(wo, wi, eta) else {
            return Rgb::ZERO;
        };
        let scattered = if wi.z > 0.0 {
            reflectance * c.reflectance
        } else {
            transmittance * ((1.0 - c.reflectance) * radiance_scale(mode, eta))
        };
        // Eqs. 20 and 21, with G₁ / cosθ as 1/σ.
        let up = Vec3::new(wi.x, wi.y, wi.z.abs());
        let sigma = self.microfacet.visible_area(wo) * self.microfacet.visible_area(up);
        scattered * (self.microfacet.d(c.m) * wo.dot(c.m) * c.jacobian * up.z / sigma)
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (wo, wi, Dielectric { eta, .. }) = self.above(wo, wi);
        if wo.z == 0.0 || wi.z == 0.0 {
            return 0.0;
        }
        Self::couple(wo, wi, eta).map_or(0.0, |c| self.coupled_pdf_w(wo, wi, &c))
    }

    #[inline]
    fn coupled_pdf_w(&self, wo: Vec3, wi: Vec3, c: &Coupling) -> f32 {
        let prob = if wi.z > 0.0 { c.reflectance } else { 1.0 - c.reflectance };
        prob * self.microfacet.d(c.m) * wo.dot(c.m) * c.jacobian / self.microfacet.visible_area_exact(wo)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let back = wo.z < 0.0;
        let (wo, _, Dielectric { eta, reflectance, transmittance }) = self.above(wo, wo);
        let m = self.microfacet.sample(wo, u);
        let o = wo.dot(m);
        let (f, cos_t) = fresnel::dielectric(o.max(0.0), eta);
        let reflects = u_lobe < f;
        let (wi, tint, eta_path) = if reflects {
            (reflect(wo, m), reflectance, 1.0)
        } else {
            (m * (o / eta - cos_t) - wo / eta, transmittance * radiance_scale(mode, eta), eta)
        };
        if (wi.z > 0.0) != reflects || wi.z == 0.0 {
            return None;
        }
        let c = Self::coupling(wo, wi, m, eta)?;
        let pdf_w = self.coupled_pdf_w(wo, wi, &c);
        let usable = pdf_w > 0.0 && pdf_w.is_finite();
        if !usable {
            return None;
        }
        let weight = tint * self.microfacet.weight(wo, Vec3::new(wi.x, wi.y, wi.z.abs()));
        let wi = if back { mirror(wi) } else { wi };
        Some(BsdfSample { eta: eta_path, ..BsdfSample::smooth(wi, weight, pdf_w) })
    }
}
