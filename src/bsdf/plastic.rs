//! A diffuse base under a dielectric coating, smooth or rough, with the light that the coating throws back. Opaque.

use super::{BsdfSample, fresnel, microfacet::Distribution, microfacet::Microfacet, reflect};
use crate::math::{Rgb, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// What a smooth coating has in common all over a material.
#[derive(Clone, Copy, Debug)]
pub struct Coating {
    eta: f32,
    /// Diffuse reflectance of the coating from inside.
    internal_reflectance: f32,
}

impl Coating {
    /// `eta` is the coating's index over the outer one.
    pub fn new(eta: f32) -> Self {
        Coating { eta, internal_reflectance: fresnel::diffuse_reflectance(1.0 / eta) }
    }
}

const TABLE_SIZE: usize = 64;

/// What a rough coating has in common all over a material; costs some 50 ms to build.
#[derive(Clone, Debug)]
pub struct RoughCoating {
    microfacet: Microfacet,
    coating: Coating,
    /// Light that gets in, by the cosine outside.
    transmittance: [f32; TABLE_SIZE],
}

impl RoughCoating {
    /// `eta` is the coating's index over the outer one.
    pub fn new(eta: f32, alpha: f32, distribution: Distribution) -> Self {
        let microfacet = Microfacet::new(distribution, alpha, alpha);
        let cos = |i: usize| (i as f32 / (TABLE_SIZE - 1) as f32).max(1e-6);
        let direction = |i| Vec3::new((1.0 - cos(i) * cos(i)).max(0.0).sqrt(), 0.0, cos(i));
        // Reflection inside has the edge of total reflection, which takes more points.
        let (points, more_points) = (gauss_legendre(32), gauss_legendre(64));
        let transmittance = std::array::from_fn(|i| {
            let wo = direction(i);
            mean_over_normals(&points, |u| {
                let m = microfacet.sample(wo, u);
                let o = wo.dot(m).max(0.0);
                let (f, cos_t) = fresnel::dielectric(o, eta);
                let wi = wo / eta - m * (o / eta - cos_t); // turned to the outside
                if wi.z > 0.0 { (1.0 - f) * wi.z / microfacet.visible_area(wi) } else { 0.0 }
            })
        });
        let reflectance = |i| {
            let wo = direction(i);
            mean_over_normals(&more_points, |u| {
                let m = microfacet.sample(wo, u);
                let wi = reflect(wo, m);
                let f = fresnel::dielectric(wo.dot(m).max(0.0), 1.0 / eta).0;
                if wi.z > 0.0 { f * wi.z / microfacet.visible_area(wi) } else { 0.0 }
            })
        };
        // ∫ 2 cosθ R dcosθ as Mitsuba sums it.
        let sum: f32 = (0..TABLE_SIZE).map(|i| 2.0 * cos(i) * reflectance(i)).sum();
        let internal_reflectance = sum / TABLE_SIZE as f32;
        RoughCoating { microfacet, coating: Coating { eta, internal_reflectance }, transmittance }
    }

    pub(super) fn microfacet(&self) -> &Microfacet {
        &self.microfacet
    }

    pub(super) fn roughness(&self) -> f32 {
        self.microfacet.roughness()
    }

    pub(super) fn smooth(&self) -> &Coating {
        &self.coating
    }

    /// Light that gets in, by the cosine outside.
    pub(super) fn transmittance(&self, cos: f32) -> f32 {
        let x = cos.clamp(0.0, 1.0) * (TABLE_SIZE - 1) as f32;
        let i = (x as usize).min(TABLE_SIZE - 2);
        let (a, b) = (self.transmittance[i], self.transmittance[i + 1]);
        a + (b - a) * (x - i as f32)
    }
}

/// Nodes and weights of the `n`-point Gauss–Legendre rule on [0, 1].
fn gauss_legendre(n: usize) -> Vec<(f32, f32)> {
    let node = |i: usize| {
        // Newton's method on P_n from a close guess (Abramowitz & Stegun 1964, 22.16.6).
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..6 {
            let (mut p, mut previous) = (x, 1.0);
            for k in 2..=n {
                let k = k as f64;
                (p, previous) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * previous) / k, p);
            }
            slope = n as f64 * (x * p - previous) / (x * x - 1.0);
            x -= p / slope;
        }
        ((0.5 - 0.5 * x) as f32, (1.0 / ((1.0 - x * x) * slope * slope)) as f32)
    };
    (0..n).map(node).collect()
}

/// Mean of a function of sampled normals that is symmetric to the plane of incidence.
fn mean_over_normals(rule: &[(f32, f32)], f: impl Fn(Vec2) -> f32) -> f32 {
    // Half the square, where every other node is dense enough.
    let half = gauss_legendre(rule.len() / 2);
    let line = |y| rule.iter().map(|&(x, weight)| weight * f(Vec2::new(x, 0.5 * y))).sum::<f32>();
    half.iter().map(|&(y, weight)| weight * line(y)).sum()
}

/// The colours of a plastic at one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paint {
    /// The base, with all the light that the coating reflects back to it, over π and the squared index: what is left
    /// to multiply are transmittances in and out, and the cosine.
    base: Rgb,
    pub(super) specular: Rgb,
    /// Probability of the specular lobe if both Fresnel factors were equal.
    specular_weight: f32,
}

impl Paint {
    /// `nonlinear` accounts for the base's colour at every internal reflection.
    pub(super) fn new(coating: &Coating, diffuse: Rgb, specular: Rgb, nonlinear: bool) -> Self {
        let lost = coating.internal_reflectance * if nonlinear { diffuse } else { Rgb::ONE };
        let base = diffuse / (Rgb::ONE - lost) * (FRAC_1_PI / (coating.eta * coating.eta));
        let (d, s) = (diffuse.element_sum(), specular.element_sum());
        let specular_weight = if d + s > 0.0 { s / (d + s) } else { 0.0 };
        Paint { base, specular, specular_weight }
    }

    /// Probability of the specular lobe when the coating lets `t` of the light in.
    #[inline]
    fn prob_specular(&self, t: f32) -> f32 {
        let specular = (1.0 - t) * self.specular_weight;
        let diffuse = t * (1.0 - self.specular_weight);
        // 0/0 where nothing reflects: any choice will do.
        if specular > 0.0 { specular / (specular + diffuse) } else { 0.0 }
    }

    /// Approximate reflectance.
    fn albedo(&self, coating: &Coating) -> Rgb {
        let outside = fresnel::diffuse_reflectance(coating.eta);
        let inside = 1.0 - outside;
        self.specular * outside + self.base * (std::f32::consts::PI * inside * inside)
    }
}

/// A smooth coating: a delta lobe over the base.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plastic {
    pub(super) coating: Coating,
    pub(super) paint: Paint,
}

impl Plastic {
    #[inline]
    fn transmittance(&self, cos: f32) -> f32 {
        1.0 - fresnel::dielectric(cos, self.coating.eta).0
    }

    pub(super) fn albedo(&self) -> Rgb {
        self.paint.albedo(&self.coating)
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        self.paint.base * (wi.z * self.transmittance(wo.z) * self.transmittance(wi.z))
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        (1.0 - self.paint.prob_specular(self.transmittance(wo.z))) * warp::cosine_hemisphere_pdf_w(wi)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let t = self.transmittance(wo.z);
        let prob = self.paint.prob_specular(t);
        if u_lobe < prob {
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            return Some(BsdfSample::delta(wi, self.paint.specular * ((1.0 - t) / prob), 1.0));
        }
        let wi = warp::cosine_hemisphere(u);
        let pdf_w = (1.0 - prob) * warp::cosine_hemisphere_pdf_w(wi);
        (pdf_w > 0.0).then(|| BsdfSample::smooth(wi, self.eval(wo, wi) / pdf_w, pdf_w))
    }
}

/// A rough coating.
#[derive(Clone, Copy, Debug)]
pub(super) struct RoughPlastic<'a> {
    pub(super) coating: &'a RoughCoating,
    pub(super) paint: Paint,
}

impl RoughPlastic<'_> {
    pub(super) fn albedo(&self) -> Rgb {
        self.paint.albedo(&self.coating.coating)
    }

    /// Specular and diffuse part of f·cosθ_i; the first one counts by `share`.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, share: f32) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let c = self.coating;
        let mut f = self.paint.base * (wi.z * c.transmittance(wo.z) * c.transmittance(wi.z));
        if share > 0.0 {
            let m = (wo + wi).normalize();
            let fresnel = fresnel::dielectric(wo.dot(m), c.coating.eta).0;
            f += self.paint.specular * (share * fresnel * c.microfacet.reflection(wo, wi, m));
        }
        f
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let prob = self.paint.prob_specular(self.coating.transmittance(wo.z));
        let specular = self.coating.microfacet.reflection_pdf_w(wo, (wo + wi).normalize());
        prob * specular + (1.0 - prob) * warp::cosine_hemisphere_pdf_w(wi)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let prob = self.paint.prob_specular(self.coating.transmittance(wo.z));
        let wi = if u_lobe < prob {
            reflect(wo, self.coating.microfacet.sample(wo, u))
        } else {
            warp::cosine_hemisphere(u)
        };
        let pdf_w = self.pdf_w(wo, wi);
        (pdf_w > 0.0).then(|| BsdfSample::smooth(wi, self.eval(wo, wi, 1.0) / pdf_w, pdf_w))
    }

    pub(super) fn roughness(&self) -> f32 {
        self.coating.roughness()
    }
}
