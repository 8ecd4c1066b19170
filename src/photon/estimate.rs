//! Density estimation: reflected radiance from the photons around a point.

use super::PhotonMap;
use super::kdtree::KnnHeap;
use crate::bsdf::{Mode, Share};
use crate::math::Rgb;
use crate::scene::Surface;
use glam::Vec3;
use std::f32::consts::PI;

/// Kernels of density estimation, normalised over the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// The same weight everywhere.
    Constant,
    /// Falling linearly.
    Cone,
    /// 2(1 − t²): least asymptotic error.
    Epanechnikov,
    /// 3(1 − t²)²: smooth at the rim.
    Biweight,
}

impl Kernel {
    /// Weight at the squared relative distance `t2` in [0, 1]; its mean over the unit disk is 1.
    pub fn weight(self, t2: f32) -> f32 {
        match self {
            Kernel::Constant => 1.0,
            Kernel::Cone => 3.0 * (1.0 - t2.sqrt()),
            Kernel::Epanechnikov => 2.0 * (1.0 - t2),
            Kernel::Biweight => 3.0 * (1.0 - t2) * (1.0 - t2),
        }
    }
}

/// How one map is looked up in one pass.
#[derive(Clone, Copy, Debug)]
pub struct Estimator {
    /// Photons that set the radius.
    pub k: u32,
    /// Largest radius before shrinking, scene units.
    pub r_max: f32,
    /// What remains of the radius in this pass: √∏(j+α)/(j+1).
    pub shrink: f32,
    /// The kernel.
    pub kernel: Kernel,
}

impl Estimator {
    /// Radiance that `share` of the BSDF at `s` reflects towards `wo` (world) out of the map's light, from photons
    /// that flew at least `depths.0` and at most `depths.1` segments.
    ///
    /// The radius is the shrunk distance R of the k-th photon. That photon itself does not count: given R, the
    /// other k − 1 are distributed over the disk as the light is, which makes the sum unbiased where light is
    /// uniform; k/(πR²) would be k/(k−1) too bright.
    pub fn radiance(
        &self,
        map: &PhotonMap,
        s: &Surface,
        wo: Vec3,
        share: Share,
        depths: (u32, u32),
        heap: &mut KnnHeap,
    ) -> Rgb {
        let wo = s.frame.to_local(wo);
        if !s.bsdf.scatters_on(wo) {
            return Rgb::ZERO;
        }
        map.tree().nearest_filtered(s.p, self.r_max, heap, |slot, d2| {
            // Near the tangent plane, and on a surface that faces the same way: no leaks through thin walls or
            // around corners.
            let h = s.n_g.dot(map.tree().position(slot) - s.p);
            h * h <= 0.1 * d2 && map.n_g(slot).dot(s.n_g) > 0.7
        });
        let (r2_full, r2_own) = if heap.is_full() {
            (heap.max_dist2(), heap.max_dist2())
        } else {
            (self.r_max * self.r_max, f32::INFINITY)
        };
        let r2 = r2_full * self.shrink * self.shrink;
        if r2 <= 0.0 {
            return Rgb::ZERO;
        }
        let lambertian = s.bsdf.diffuse_only();
        let mut sum = Rgb::ZERO;
        let mut skipped_farthest = false;
        for (slot, d2) in heap.iter() {
            if d2 >= r2_own && !skipped_farthest {
                skipped_farthest = true;
                continue;
            }
            if d2 > r2 {
                continue;
            }
            let depth = map.depth(slot);
            if depth < depths.0 || depth > depths.1 {
                continue;
            }
            let wi = map.wi(slot);
            let weight = self.kernel.weight(d2 / r2);
            match lambertian {
                Some(_) => {
                    let wi_n = s.frame.n.dot(wi);
                    if wi_n * wo.z > 0.0 {
                        sum += map.flux(slot) * (weight * shading_ratio(wi_n, s.n_g.dot(wi)));
                    }
                }
                None => {
                    // eval holds |cosθ_s|; flux per area is measured on the geometric surface.
                    let cos_g = s.n_g.dot(wi).abs().max(1e-4);
                    let f = s.bsdf.eval(wo, s.frame.to_local(wi), Mode::Radiance, share);
                    sum += map.flux(slot) * f * (weight / cos_g);
                }
            }
        }
        sum * lambertian.unwrap_or(Rgb::ONE) / (PI * r2)
    }
}

/// |wi·n_s| / |wi·n_g|: photons count flux through the geometric surface, scattering wants it through the shading
/// one.
fn shading_ratio(wi_s: f32, wi_g: f32) -> f32 {
    wi_s.abs() / wi_g.abs().max(1e-4)
}
