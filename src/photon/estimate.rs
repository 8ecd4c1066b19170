//! Density estimation: reflected radiance from the photons around a point.

use super::PhotonMap;
use super::kdtree::KnnHeap;
use crate::bsdf::{Mode, Share};
use crate::math::Rgb;
use crate::scene::Surface;
use crate::shape::Facet;
use glam::{Vec2, Vec3};
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

impl Kernel {
    /// ∫ 1 − mass(ρ) dθ along a straight edge from the foot of the perpendicular out to `s`, seen from the point at
    /// signed distance `d` from it: mass(ρ) is what of the kernel of radius 1 lies nearer than the edge is in direction
    /// θ, ρ = d/cosθ = √(d² + s²) ≤ 1. Divided by 2π it is what an edge cuts off.
    fn cut_off(self, d: f32, s: f32) -> f32 {
        let angle = s.atan2(d.abs()).copysign(s * d);
        let (d2, s2) = (d * d, s * s);
        // ∫ (d secθ)ⁿ dθ for n = 2, 4, 6, in terms of s = d tanθ.
        let (second, fourth) = (d * s, d * s * (d2 + s2 / 3.0));
        match self {
            // 1 − ρ²
            Kernel::Constant => angle - second,
            // 1 − 3ρ² + 2ρ³
            Kernel::Cone => {
                let third = 0.5
                    * (second * (d2 + s2).sqrt()
                        + if d == 0.0 { 0.0 } else { d * d2 * (s / d.abs()).asinh() });
                angle - 3.0 * second + 2.0 * third
            }
            // (1 − ρ²)²
            Kernel::Epanechnikov => angle - 2.0 * second + fourth,
            // (1 − ρ²)³
            Kernel::Biweight => {
                let sixth = d * s * (d2 * d2 + (2.0 / 3.0) * d2 * s2 + s2 * s2 / 5.0);
                angle - 3.0 * second + 3.0 * fourth - sixth
            }
        }
    }

    /// The share of the kernel of radius `r` around `p`, a point of `facet`, that lies on it.
    pub fn coverage(self, facet: &Facet, p: Vec2, r: f32) -> f32 {
        let mut cut = 0.0;
        for &[a, b] in facet.edges() {
            let along = b - a;
            let length = along.length();
            if length == 0.0 {
                continue;
            }
            let u = along / length;
            // From the nearer end, so that nothing cancels in a corner: the angles of its two edges must fit together.
            let (from_a, to_b) = (u.dot(p - a), u.dot(b - p));
            let near = if from_a.abs() < to_b.abs() { p - a } else { p - b };
            let d = u.perp_dot(near) / r;
            if d.abs() < 1.0 {
                // The part of the edge within the disk, measured from the foot of the perpendicular.
                let reach = (1.0 - d * d).sqrt();
                let (from, to) = ((-from_a / r).max(-reach), (to_b / r).min(reach));
                if from < to {
                    cut += self.cut_off(d, to) - self.cut_off(d, from);
                }
            }
        }
        let inside = 1.0 - cut / (2.0 * PI);
        // More than all is left where rounding has put the point outside, so that nothing was there to cut from.
        let covered = if inside > 1.0 + 1e-5 { inside - 1.0 } else { inside };
        covered.clamp(1e-3, 1.0)
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

/// The photons that take part in an estimate.
#[derive(Clone, Copy, Debug)]
pub struct Photons {
    /// Fewest and most segments flown.
    pub depths: (u32, u32),
    /// Whether those of caustics do.
    pub caustics: bool,
}

/// The radius of the fine level of an estimate, as a share of the wide one's.
const FINE: f32 = 0.5;

/// An estimate at two radii: wide, with the least noise, and fine, with little of its bias.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Levels {
    /// At the full radius.
    pub wide: Rgb,
    /// At half of it, from the photons in there.
    pub fine: Rgb,
}

impl Estimator {
    /// Radiance that `share` of the BSDF at `s` reflects towards `wo` (world) out of the light in `what`.
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
        what: Photons,
        heap: &mut KnnHeap,
    ) -> Levels {
        let wo = s.frame.to_local(wo);
        if map.is_empty() || !s.bsdf.scatters_on(wo) {
            return Levels::default();
        }
        let r2_full = self.nearest(map, s, heap);
        let r2_own = if heap.is_full() { r2_full } else { f32::INFINITY };
        let r2 = r2_full * self.shrink * self.shrink;
        if r2 <= 0.0 {
            return Levels::default();
        }
        // What of the disk hangs over the edge of the surface holds no photons.
        let r = r2.sqrt();
        let at = s.facet.map(|facet| (facet, facet.project(s.p)));
        let covered = |r| at.map_or(1.0, |(facet, p)| self.kernel.coverage(facet, p, r));
        let wide_share = covered(r);
        let fine_share = if wide_share < 1.0 { covered(FINE * r) } else { 1.0 };
        // Across a seam, other surfaces may go on in the same plane.
        let own = at.map(|(facet, _)| facet).filter(|_| wide_share < 1.0);
        let lambertian = s.bsdf.diffuse_only();
        let mut sum = Levels::default();
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
            if depth < what.depths.0 || depth > what.depths.1 || (!what.caustics && map.is_caustic(slot)) {
                continue;
            }
            if own.is_some_and(|facet| !facet.contains(facet.project(map.tree().position(slot)))) {
                continue;
            }
            let wi = map.wi(slot);
            let reflected = match lambertian {
                Some(_) => {
                    let wi_n = s.frame.n.dot(wi);
                    if wi_n * wo.z <= 0.0 {
                        continue;
                    }
                    map.flux(slot) * shading_ratio(wi_n, s.n_g.dot(wi))
                }
                None => map.flux(slot) * scattered(s, wo, wi, share),
            };
            let t2 = d2 / r2;
            sum.wide += reflected * self.kernel.weight(t2);
            if t2 < FINE * FINE {
                sum.fine += reflected * (self.kernel.weight(t2 / (FINE * FINE)) / (FINE * FINE));
            }
        }
        let scale = lambertian.unwrap_or(Rgb::ONE) / (PI * r2);
        Levels { wide: sum.wide * scale / wide_share, fine: sum.fine * scale / fine_share }
    }

    /// Photons per area around `s`.
    pub fn density(&self, map: &PhotonMap, s: &Surface, heap: &mut KnnHeap) -> f32 {
        if map.is_empty() {
            return 0.0;
        }
        let area = PI * self.nearest(map, s, heap);
        let count = if heap.is_full() { heap.len() - 1 } else { heap.len() };
        if area > 0.0 { count as f32 / area } else { 0.0 }
    }

    /// Finds the photons around `s` that lie on the same surface; returns the square of the radius that holds them.
    fn nearest(&self, map: &PhotonMap, s: &Surface, heap: &mut KnnHeap) -> f32 {
        map.tree().nearest_filtered(s.p, self.r_max, heap, |slot, d2| {
            // Near the tangent plane, and on a surface that faces the same way: no leaks through thin walls or
            // around corners.
            let h = s.n_g.dot(map.tree().position(slot) - s.p);
            h * h <= 0.1 * d2 && map.faces(slot, s.n_g, 0.7)
        });
        if heap.is_full() { heap.max_dist2() } else { self.r_max * self.r_max }
    }
}

/// Radiance that `share` of the BSDF at `s` scatters towards `wo` (local) per irradiance, counted on the geometric
/// surface, from `wi` (world). eval holds |cosθ_s|.
pub(super) fn scattered(s: &Surface, wo: Vec3, wi: Vec3, share: Share) -> Rgb {
    let cos_g = s.n_g.dot(wi).abs().max(1e-4);
    s.bsdf.eval(wo, s.frame.to_local(wi), Mode::Radiance, share) / cos_g
}

/// |wi·n_s| / |wi·n_g|: photons count flux through the geometric surface, scattering wants it through the shading
/// one.
fn shading_ratio(wi_s: f32, wi_g: f32) -> f32 {
    wi_s.abs() / wi_g.abs().max(1e-4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Sampler, Stream};
    use crate::shape::{Facets, Geometry, Mesh, Shape};
    use glam::Affine3A;

    const KERNELS: [Kernel; 4] = [Kernel::Constant, Kernel::Cone, Kernel::Epanechnikov, Kernel::Biweight];

    /// A floor of 2 by 2 with a box of 0.5 by 0.5 in its middle.
    fn floor() -> Facets {
        let shapes = [
            Mesh::rectangle(Affine3A::IDENTITY),
            Mesh::cube(Affine3A::from_scale(Vec3::splat(0.25)) * Affine3A::from_translation(Vec3::Z)),
        ];
        Facets::new(&Geometry { shapes: shapes.map(Shape::Mesh).into() })
    }

    /// Against a midpoint sum over 400 by 400 squares, which is good to 0.003 where the kernel jumps.
    #[test]
    fn coverage_is_the_kernels_integral_over_the_facet() {
        let facets = floor();
        let facet = facets.get(0, 0).unwrap();
        let mut rng = Sampler::new(3, Stream::Eye, 0, 0);
        for i in 0..60 {
            let p = loop {
                let p = Vec3::new(2.0 * rng.next_1d() - 1.0, 2.0 * rng.next_1d() - 1.0, 0.0);
                if facet.contains(facet.project(p)) {
                    break p;
                }
            };
            // On the edge of the floor and in its corner, too.
            let p = match i {
                0 => Vec3::new(1.0, 0.3, 0.0),
                1 => Vec3::new(1.0 - 1e-6, 1.0 - 1e-6, 0.0),
                _ => p,
            };
            let r = 0.02 + 0.8 * rng.next_1d();
            for kernel in KERNELS {
                const N: usize = 400;
                let at = |i: usize| (2.0 * (i as f32 + 0.5) / N as f32 - 1.0) * r;
                let mut sum = 0.0;
                for (x, y) in (0..N * N).map(|i| (at(i % N), at(i / N))) {
                    let t2 = (x * x + y * y) / (r * r);
                    if t2 < 1.0 && facet.contains(facet.project(p + Vec3::new(x, y, 0.0))) {
                        sum += kernel.weight(t2) as f64;
                    }
                }
                let brute = sum * (2.0 / N as f64).powi(2) / std::f64::consts::PI;
                let exact = kernel.coverage(facet, facet.project(p), r) as f64;
                assert!((exact - brute).abs() < 4e-3, "{kernel:?} at {p}, radius {r}: {exact} {brute}");
            }
        }
    }

    #[test]
    fn known_shares() {
        let facets = floor();
        let facet = facets.get(0, 0).unwrap();
        for kernel in KERNELS {
            let share = |x, y, r| kernel.coverage(facet, facet.project(Vec3::new(x, y, 0.0)), r);
            assert_eq!(share(0.6, 0.6, 0.1), 1.0);
            for (x, y, expected) in [(1.0, 0.6, 0.5), (0.25, 0.0, 0.5), (1.0, 1.0, 0.25), (-0.25, 0.25, 0.75)]
            {
                let got = share(x - 1e-6, y - 2e-6, 0.2);
                assert!((got - expected).abs() < 1e-4, "{kernel:?} {x} {y}: {got}");
            }
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let got = share(x * (1.0 - 1e-6), y * (1.0 - 1e-6), 0.5);
                assert!((got - 0.25).abs() < 1e-4, "{kernel:?} in the corner {x} {y}: {got}");
            }
        }
    }
}
