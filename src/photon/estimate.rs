//! Density estimation: reflected radiance from the photons around a point.

use super::PhotonMap;
use super::area::probe;
use super::kdtree::KnnHeap;
use super::octahedral::Direction;
use crate::bsdf::{Mode, Share};
use crate::math::{Ray, Rgb, offset_origin};
use crate::scene::{Scene, Surface};
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
    /// Which photons set the radius.
    pub among: Among,
}

/// Which photons the `k` are that set the radius of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Among {
    /// Those on the same surface; how far to look for them follows from how dense all are.
    Same,
    /// All. Where another surface is brighter, fewer are left for the estimate; the search for as many of a dim
    /// one would go through all of the bright one's (classroom: half of the time).
    All,
}

/// The photons that take part in an estimate.
#[derive(Clone, Copy, Debug)]
pub struct Photons {
    /// Fewest and most segments flown.
    pub depths: (u32, u32),
    /// Whether those of caustics do.
    pub caustics: bool,
}

impl Photons {
    /// Whether the photon in `slot` is one of them.
    pub(super) fn hold(self, map: &PhotonMap, slot: u32) -> bool {
        let (fewest, most) = self.depths;
        (fewest..=most).contains(&map.depth(slot)) && (self.caustics || !map.is_caustic(slot))
    }
}

/// Points of the disk of an estimate that are to be found on the surface: at camera vertices, and where one estimate serves many
/// gather rays.
const PROBES: u32 = 2;
const SITE_PROBES: u32 = 8;
/// Photons tell of light as far around them, as a share of the radius: of k = 32, evenly spread, three or four are that near.
const NEAR: f32 = 0.33;

/// How far to look for photons of the same surface, in radii that hold a leaf of photons of any: of a thin
/// leg among many, a sphere of the largest radius holds half of the map (classroom).
const FAR: f32 = 4.0;

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

/// Where an estimate is made.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    /// The scene around it.
    pub scene: &'a Scene,
    /// Position.
    pub p: Vec3,
    /// Geometric normal, as the shape is oriented.
    pub n_g: Vec3,
    /// Tells the surface from others.
    pub tag: u8,
    /// The flat polygon that the surface ends with, if it is one.
    pub facet: Option<&'a Facet>,
    pub(super) magnitude: f32,
}

impl<'a> Place<'a> {
    fn of(s: &Surface<'a>) -> Place<'a> {
        let Surface { scene, p, n_g, facet, magnitude, .. } = *s;
        Place { scene, p, n_g, tag: s.tag(), facet, magnitude }
    }

    /// By how far rays start off the surface.
    pub(super) fn offset(&self) -> f32 {
        (offset_origin(Vec3::ZERO, self.n_g, self.n_g, self.magnitude)).length()
    }

    /// A ray to `target`, a point off the surface.
    pub(super) fn spawn_to(&self, target: Vec3) -> Ray {
        let o = offset_origin(self.p, self.n_g, target - self.p, self.magnitude);
        let length = (target - o).length();
        Ray { t_max: length, ..Ray::new(o, (target - o) / length) }
    }

    /// Whether a point at distance² `d2`, on a surface that `is_tagged` as this one, belongs to the same surface as far as its
    /// position can tell: no leaks around corners, and none between layers.
    #[inline(always)]
    pub(super) fn is_beside(&self, p: Vec3, d2: f32, is_tagged: impl FnOnce(u8) -> bool) -> bool {
        match self.facet {
            Some(facet) => facet.is_coplanar(p),
            None => near_plane(self.n_g, p - self.p, d2) && is_tagged(self.tag),
        }
    }
}

/// A point whose irradiance is to be known, on one of its sides.
#[derive(Clone, Copy)]
pub struct Site<'a> {
    /// Where it is.
    pub place: Place<'a>,
    /// Shading normal, on the side that is meant.
    pub n_s: Vec3,
}

impl<'a> Site<'a> {
    /// The side of `s` that its shading normal says `w` (world) is on.
    pub fn new(s: &Surface<'a>, w: Vec3) -> Site<'a> {
        Site { place: Place::of(s), n_s: s.frame.n * 1f32.copysign(s.frame.n.dot(w)) }
    }

    /// The geometric normal on the side that is meant.
    pub(super) fn n_g(&self) -> Vec3 {
        self.place.n_g * 1f32.copysign(self.place.n_g.dot(self.n_s))
    }
}

/// Whether a point `to` away, at distance² `d2`, is near the plane of normal `n`: no leaks around corners.
pub(super) fn near_plane(n: Vec3, to: Vec3, d2: f32) -> bool {
    let h = n.dot(to);
    h * h <= 0.1 * d2
}

impl Estimator {
    const FEWEST: u32 = 16;

    /// For `k` photons within `r_max`, and a radius `shrink` times that of the first pass.
    ///
    /// As the radius shrinks, a search need not go as far: to find twice as many photons as the shrunk radius holds of k
    /// is enough. No fewer, for photons are spread more evenly than chance would spread them, and then an estimate over
    /// the very disk that ends at the k-th photon is too dark, by up to 1/(2k).
    pub fn new(k: u32, r_max: f32, shrink: f32, kernel: Kernel) -> Estimator {
        let enough = (2.0 * k as f32 * shrink * shrink).ceil() as u32;
        let fewer = enough.max(Self::FEWEST).min(k);
        let by_number = (fewer as f32 / k as f32).sqrt();
        Estimator {
            k: fewer,
            r_max: r_max * by_number,
            shrink: shrink / by_number,
            kernel,
            among: Among::Same,
        }
    }

    /// The same with a radius that photons `among` those around set.
    pub fn among(self, among: Among) -> Estimator {
        Estimator { among, ..self }
    }

    /// How many photons the disk of a lookup holds.
    pub fn effective_k(&self) -> f32 {
        self.k as f32 * self.shrink * self.shrink
    }

    /// Radiance that `share` of the BSDF at `s` reflects towards `wo` (world) out of the light in `what`; the fine level
    /// only if `fine`.
    ///
    /// The radius is the shrunk distance R of the k-th photon. That photon itself does not count: given R, the
    /// other k − 1 are distributed over the disk as the light is, which makes the sum unbiased where light is
    /// uniform; k/(πR²) would be k/(k−1) too bright.
    #[allow(clippy::too_many_arguments)]
    pub fn radiance(
        &self,
        map: &PhotonMap,
        s: &Surface,
        wo: Vec3,
        share: Share,
        what: Photons,
        fine: bool,
        heap: &mut KnnHeap,
    ) -> Levels {
        let wo = s.frame.to_local(wo);
        if map.is_empty() || !s.bsdf.scatters_on(wo) {
            return Levels::default();
        }
        let n_s = s.frame.n * 1f32.copysign(wo.z);
        match s.bsdf.diffuse_only() {
            Some(f) => {
                let arriving = |slot| arriving(n_s, s.n_g, map.direction(slot));
                let levels = self.sum(map, Place::of(s), n_s, PROBES, what, fine, heap, arriving).0;
                Levels { wide: f * levels.wide, fine: f * levels.fine }
            }
            None => {
                let reflected = |slot| scattered(s, wo, map.wi(slot), share);
                self.sum(map, Place::of(s), n_s, PROBES, what, fine, heap, reflected).0
            }
        }
    }

    /// Irradiance at `site`, and the radius of the disk that it was estimated over.
    pub fn irradiance(&self, map: &PhotonMap, site: &Site, what: Photons, heap: &mut KnnHeap) -> (Rgb, f32) {
        let arriving = |slot| arriving(site.n_s, site.place.n_g, map.direction(slot));
        let (levels, r) = self.sum(map, site.place, site.n_s, SITE_PROBES, what, false, heap, arriving);
        (levels.wide, r)
    }

    /// The sum of flux · `factor(slot)` · kernel over the photons around a place, per area of the surface that `probes` find on
    /// the side of `n_s`, and the kernel's radius.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn sum(
        &self,
        map: &PhotonMap,
        place: Place,
        n_s: Vec3,
        probes: u32,
        what: Photons,
        fine: bool,
        heap: &mut KnnHeap,
        factor: impl Fn(u32) -> Rgb,
    ) -> (Levels, f32) {
        let (r2_full, is_full) = self.nearest(map, place, heap);
        let r2_own = if is_full { r2_full } else { f32::INFINITY };
        let r2 = r2_full * self.shrink * self.shrink;
        if r2 <= 0.0 || heap.is_empty() {
            return (Levels::default(), r2.sqrt());
        }
        // What of the disk hangs over the edge of the surface holds no photons.
        let r = r2.sqrt();
        let at = place.facet.map(|facet| (facet, facet.project(place.p)));
        let covered = |r| at.map_or(1.0, |(facet, p)| self.kernel.coverage(facet, p, r));
        let wide_share = covered(r);
        let fine_share = if fine && wide_share < 1.0 { covered(FINE * r) } else { 1.0 };
        // Across a seam, other surfaces may go on in the same plane.
        let own = at.map(|(facet, _)| facet).filter(|_| wide_share < 1.0);
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
            if !what.hold(map, slot) {
                continue;
            }
            if own.is_some_and(|facet| !facet.contains(facet.project(map.tree().position(slot)))) {
                continue;
            }
            let arrived = map.flux(slot) * factor(slot);
            let t2 = d2 / r2;
            sum.wide += arrived * self.kernel.weight(t2);
            if fine && t2 < FINE * FINE {
                sum.fine += arrived * (self.kernel.weight(t2 / (FINE * FINE)) / (FINE * FINE));
            }
        }
        if sum.wide == Rgb::ZERO {
            return (Levels::default(), r);
        }
        let n = place.n_g * 1f32.copysign(place.n_g.dot(n_s));
        let photons = |r: f32| {
            let near2 = NEAR * NEAR * r * r;
            let heap = &*heap;
            move |x: Vec3, is_wanted: &dyn Fn(Vec3) -> bool| {
                let positions = heap.iter().map(|(slot, _)| map.tree().position(slot));
                positions.filter(|p| p.distance_squared(x) < near2).any(is_wanted)
            }
        };
        let probed = probe(&place, n, r, self.kernel, probes, photons(r));
        sum.wide *= probed.disk_over_surface;
        if sum.fine != Rgb::ZERO && !probed.is_whole {
            let r = FINE * r;
            sum.fine *= probe(&place, n, r, self.kernel, probes, photons(r)).disk_over_surface;
        }
        let scale = 1.0 / (PI * r2);
        (Levels { wide: sum.wide * (scale / wide_share), fine: sum.fine * (scale / fine_share) }, r)
    }

    /// Photons per area around `s`.
    pub fn density(&self, map: &PhotonMap, s: &Surface, heap: &mut KnnHeap) -> f32 {
        if map.is_empty() {
            return 0.0;
        }
        let (r2, is_full) = self.nearest(map, Place::of(s), heap);
        let area = PI * r2;
        let count = heap.iter().filter(|&(_, d2)| !is_full || d2 < r2).count();
        if area > 0.0 { count as f32 / area } else { 0.0 }
    }

    /// Finds the photons around a place that lie on the same surface; returns the square of the radius that holds them,
    /// and whether a photon set it.
    fn nearest(&self, map: &PhotonMap, place: Place, heap: &mut KnnHeap) -> (f32, bool) {
        let (tree, side) = (map.tree(), Direction::new(place.n_g));
        // Also facing the same way: no leaks through thin walls.
        let is_beside = |slot, d2| {
            place.is_beside(tree.position(slot), d2, |tag| map.is_on(slot, tag))
                && map.faces(slot, &side, 0.7)
        };
        let r_max = match self.among {
            Among::Same => {
                let r_max = self.r_max.min(FAR * tree.leaf_radius(place.p));
                tree.nearest_filtered(place.p, r_max, heap, is_beside);
                r_max
            }
            Among::All => {
                tree.nearest(place.p, self.r_max, heap);
                self.r_max
            }
        };
        let is_full = heap.is_full();
        let r2 = if is_full { heap.max_dist2() } else { r_max * r_max };
        if self.among == Among::All {
            heap.retain(is_beside);
        }
        (r2, is_full)
    }
}

/// Radiance that `share` of the BSDF at `s` scatters towards `wo` (local) per irradiance, counted on the geometric
/// surface, from `wi` (world). eval holds |cosθ_s|.
pub(super) fn scattered(s: &Surface, wo: Vec3, wi: Vec3, share: Share) -> Rgb {
    let cos_g = s.n_g.dot(wi).abs().max(1e-4);
    s.bsdf.eval(wo, s.frame.to_local(wi), Mode::Radiance, share) / cos_g
}

/// What flux from `wi`, of any length near 1, counts for on the side of `n_s`: |wi·n_s| / |wi·n_g|, for photons count
/// flux through the geometric surface, and scattering wants it through the shading one.
fn arriving(n_s: Vec3, n_g: Vec3, wi: Vec3) -> Rgb {
    Rgb::splat(n_s.dot(wi).max(0.0) / n_g.dot(wi).abs().max(1e-4))
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
        Facets::new(&Geometry::from(shapes.map(Shape::Mesh).to_vec()))
    }

    /// Against a midpoint sum over 400 by 400 squares, which is good to 0.003 where the kernel jumps.
    #[test]
    fn coverage_is_the_kernels_integral_over_the_facet() {
        let facets = floor();
        let facet = facets.at(0, 0, Vec3::ZERO).unwrap();
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
        let facet = facets.at(0, 0, Vec3::ZERO).unwrap();
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
