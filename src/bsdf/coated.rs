//! Any opaque scattering function under a dielectric layer, smooth or rough, which absorbs (Mitsuba 0.6's `coating` and
//! `roughcoating`, after Weidlich & Wilkie 2007, "Arbitrarily Layered Micro-Facet Surfaces"). Light that the layer
//! reflects back inside is lost.

use super::{Bsdf, BsdfSample, Mode, RoughCoating, Share, fresnel, reflect};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// The layer.
#[derive(Clone, Debug)]
pub struct Layer<'a> {
    /// The layer's index over the outer one.
    pub eta: f32,
    /// Factor on what its surface reflects.
    pub specular: Rgb,
    /// Absorption coefficient times thickness.
    pub absorption: Rgb,
    /// Its surface, if that is rough.
    pub rough: Option<&'a RoughCoating>,
}

#[derive(Clone, Debug)]
pub(super) struct Coated<'a> {
    pub(super) layer: Layer<'a>,
    pub(super) nested: Bsdf<'a>,
}

impl Layer<'_> {
    fn transmittance(&self, cos: f32) -> f32 {
        match self.rough {
            Some(coating) => coating.transmittance(cos.abs()),
            None => 1.0 - fresnel::dielectric(cos.abs(), self.eta).0,
        }
    }

    /// The direction inside, on the same side of the surface.
    fn refract_in(&self, w: Vec3) -> Vec3 {
        let cos = fresnel::dielectric(w.z.abs(), self.eta).1;
        Vec3::new(w.x / self.eta, w.y / self.eta, cos.copysign(w.z))
    }

    /// The direction outside; `None` under total reflection.
    fn refract_out(&self, w: Vec3) -> Option<Vec3> {
        let cos = fresnel::dielectric(w.z.abs(), 1.0 / self.eta).1;
        (cos > 0.0).then(|| Vec3::new(w.x * self.eta, w.y * self.eta, cos.copysign(w.z)).normalize())
    }

    /// What absorption leaves on the way in and out.
    fn absorb(&self, wo_in: Vec3, wi_in: Vec3) -> Rgb {
        if self.absorption == Rgb::ZERO {
            return Rgb::ONE;
        }
        (-self.absorption * (1.0 / wo_in.z.abs() + 1.0 / wi_in.z.abs())).map(f32::exp)
    }

    /// Probability with which the surface is sampled, not what is below it.
    fn prob_specular(&self, cos: f32) -> f32 {
        let absorbed = (-2.0 * self.absorption).map(f32::exp).element_sum() / 3.0;
        let reflected = (1.0 - self.transmittance(cos)) / (1.0 + absorbed);
        let below = self.transmittance(cos) * absorbed / (1.0 + absorbed);
        if reflected > 0.0 { reflected / (reflected + below) } else { 0.0 }
    }

    /// f·cosθ_i of a rough surface.
    fn reflection(&self, wo: Vec3, wi: Vec3, share: Share) -> Rgb {
        match self.rough {
            Some(coating) if wo.z > 0.0 && wi.z > 0.0 => {
                let m = (wo + wi).normalize();
                let reflectance = fresnel::dielectric(wo.dot(m), self.eta).0;
                let f =
                    share.of(coating.roughness()) * reflectance * coating.microfacet().reflection(wo, wi, m);
                self.specular * f
            }
            _ => Rgb::ZERO,
        }
    }

    fn reflection_pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        match self.rough {
            Some(coating) if wo.z > 0.0 && wi.z > 0.0 => {
                coating.microfacet().reflection_pdf_w(wo, (wo + wi).normalize())
            }
            _ => 0.0,
        }
    }
}

impl Coated<'_> {
    /// dω inside over dω outside, in the direction `w` outside.
    fn compression(&self, w: Vec3, w_in: Vec3) -> f32 {
        w.z / (w_in.z * self.layer.eta * self.layer.eta)
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        let layer = &self.layer;
        if wo.z * wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let (wo_in, wi_in) = (layer.refract_in(wo), layer.refract_in(wi));
        let passed = layer.transmittance(wo.z) * layer.transmittance(wi.z) * self.compression(wi, wi_in);
        let mut f = layer.reflection(wo, wi, share);
        if passed > 0.0 {
            f += self.nested.eval(wo_in, wi_in, mode, share) * layer.absorb(wo_in, wi_in) * passed;
        }
        f
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        let layer = &self.layer;
        if wo.z * wi.z <= 0.0 {
            return 0.0;
        }
        let (wo_in, wi_in) = (layer.refract_in(wo), layer.refract_in(wi));
        let prob = layer.prob_specular(wo.z);
        let below = self.nested.pdf_w(wo_in, wi_in, mode) * self.compression(wi, wi_in);
        prob * layer.reflection_pdf_w(wo, wi) + (1.0 - prob) * below
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        let layer = &self.layer;
        if wo.z == 0.0 {
            return None;
        }
        let prob = layer.prob_specular(wo.z);
        let wi = if u_lobe < prob {
            match layer.rough {
                Some(coating) if wo.z > 0.0 => reflect(wo, coating.microfacet().sample(wo, u)),
                Some(_) => return None,
                None => {
                    let weight = layer.specular * ((1.0 - layer.transmittance(wo.z)) / prob);
                    return Some(BsdfSample::delta(Vec3::new(-wo.x, -wo.y, wo.z), weight, 1.0));
                }
            }
        } else {
            let wo_in = layer.refract_in(wo);
            let s = self.nested.sample(wo_in, (u_lobe - prob) / (1.0 - prob), u, mode)?;
            let wi = layer.refract_out(s.wi)?;
            if s.delta {
                let passed = layer.transmittance(wo.z) * layer.transmittance(wi.z) / (1.0 - prob);
                let weight = s.weight * layer.absorb(wo_in, s.wi) * passed;
                return Some(BsdfSample { wi, weight, ..s });
            }
            wi
        };
        let pdf_w = self.pdf_w(wo, wi, mode);
        (pdf_w > 0.0).then(|| BsdfSample::smooth(wi, self.eval(wo, wi, mode, Share::All) / pdf_w, pdf_w))
    }

    /// Approximate, as if the light below were diffuse.
    pub(super) fn albedo(&self) -> Rgb {
        let eta = self.layer.eta;
        let [outside, inside] = [eta, 1.0 / eta].map(fresnel::diffuse_reflectance);
        let through = (-3.0 * self.layer.absorption).map(f32::exp) * ((1.0 - outside) * (1.0 - inside));
        self.layer.specular * outside + self.nested.albedo() * through
    }
}
