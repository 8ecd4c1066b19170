//! How much of a lookup's disk is surface on which photons can land. A density is flux per *area*: on columns, mouldings and
//! leaves most of the disk is air, and where a column stands on a floor, the floor goes on below it in vain.
//!
//! Probes of the disk find out: points by the kernel's density, each of which must be reached from the middle, straight or over
//! what lies in between, and then be found on the same surface from above.

use super::estimate::{Kernel, Place};
use super::octahedral::{Direction, encode8};
use crate::math::Ray;
use crate::shape::Facet;
use glam::Vec3;
use std::f32::consts::TAU;

/// A surface may rise or sink by so much of the distance: [`super::estimate::near_plane`] asks for h² ≤ 0.1 (ρ² + h²).
const SLOPE: f32 = 1.0 / 3.0;
/// Obstacles lower than that share of the distance are passed over.
const OVER: f32 = 1.5;

/// Probes that are given up after.
const MOST: u32 = 32;

/// What a kernel's integral over its disk and that over the surface differ by.
pub(super) struct Probed {
    /// The integral over the disk (over the facet, if there is one: its outline is known) in proportion to that over the
    /// surface: what an estimate that divides by the former is to be multiplied with.
    pub(super) disk_over_surface: f32,
    /// Whether every probe has found surface.
    pub(super) is_whole: bool,
}

/// Probes the disk of radius `r` until `wanted` points of it have been found to be surface. `n` is the geometric normal on the
/// side that light is to arrive on.
///
/// If each of them is with probability c, the number of probes per find has the mean 1/c, whatever c is (Haldane 1945, "On a
/// Method of Estimating Frequencies"); the inverse of a share of a given number of probes would be off by a lot.
///
/// What lies behind an obstacle is no surface unless one of the `photons` (given those within a radius of a point) shows that light
/// gets there: below a glass sphere on a floor there is floor, below a column there is none.
pub(super) fn probe(
    place: &Place,
    n: Vec3,
    r: f32,
    kernel: Kernel,
    wanted: u32,
    photons: impl Fn(Vec3, &dyn Fn(Vec3) -> bool) -> bool,
) -> Probed {
    let mut random = Random::new(place.p / place.scene.bounds.radius());
    let (s, t) = n.any_orthonormal_pair();
    let side = Direction::new(place.n_g);
    let (mut probes, mut finds) = (0, 0);
    let (mut disk, mut surface) = (0.0, 0.0);
    while finds < wanted && probes < MOST {
        probes += 1;
        // As the Epanechnikov kernel's density; the others' weights are bounded.
        let t2 = 1.0 - (1.0 - random.next()).sqrt();
        let (sin, cos) = (TAU * random.next()).sin_cos();
        let weight = kernel.weight(t2) / Kernel::Epanechnikov.weight(t2).max(1e-6);
        let rho = r * t2.sqrt();
        let x = place.p + (s * cos + t * sin) * rho;
        let found = match place.facet {
            Some(facet) if !facet.contains(facet.project(x)) => continue,
            _ => match reach(place, n, x, rho) {
                None => {
                    let is_hidden = |p: Vec3| {
                        let flat = p - n * n.dot(p - place.p);
                        let rho = flat.distance(place.p);
                        rho > 0.0 && reach(place, n, flat, rho).is_none()
                    };
                    photons(x, &is_hidden).then_some(1.0)
                }
                // Nothing is known to lie on it but what has cut it.
                Some(_) if place.facet.is_some_and(Facet::is_bare) => Some(1.0),
                Some(height) => {
                    let down = Ray { t_max: height + rho * SLOPE, ..Ray::new(x + n * height, -n) };
                    find(place, &side, &down).and_then(|(distance2, slant)| {
                        let t2_found = distance2 / (r * r);
                        (t2_found < 1.0)
                            .then(|| slant * kernel.weight(t2_found) / kernel.weight(t2).max(1e-6))
                    })
                }
            },
        };
        disk += weight;
        if let Some(area) = found {
            finds += 1;
            surface += weight * area;
        }
    }
    let disk_over_surface = if surface > 0.0 { disk / surface } else { 1.0 };
    Probed { disk_over_surface, is_whole: finds == probes }
}

/// The height above `x`, a point of the tangent plane at distance `rho`, that is reached from the place itself.
fn reach(place: &Place, n: Vec3, x: Vec3, rho: f32) -> Option<f32> {
    let clear = |ray: &Ray| !place.scene.occluded(ray);
    // A flat surface is reached along itself, also below another layer; a curved one may bulge.
    let low = if place.facet.is_some() { 2.0 * place.offset() } else { rho * SLOPE };
    if clear(&place.spawn_to(x + n * low)) {
        return Some(low);
    }
    let high = rho * OVER;
    let top = place.p + n * high;
    let across = Ray { t_max: rho, ..Ray::new(top, (x - place.p) / rho) };
    (clear(&place.spawn_to(top)) && clear(&across)).then_some(high)
}

/// If the surface goes on where `down` meets it, the squared distance there, and its area per area of the tangent plane.
fn find(place: &Place, side: &Direction, down: &Ray) -> Option<(f32, f32)> {
    place.scene.find_hit(down, |ray, hit| {
        let (p, n_g, tag) = place.scene.geometric(ray, hit);
        let d2 = p.distance_squared(place.p);
        let is_own = place.is_beside(p, d2, |own| own == tag) && side.agrees(encode8(n_g), 0.7);
        is_own.then(|| (d2, 1.0 / n_g.dot(down.d).abs().max(0.1)))
    })
}

/// Numbers that depend on a place alone, so that estimates do.
struct Random(u32);

impl Random {
    /// For a place in a scene of radius 1. In cells of 2⁻¹¹, so that rounding seldom shows.
    fn new(p: Vec3) -> Random {
        let mix = |h: u32, x: f32| {
            (h ^ (x * 2_048.0).round() as i32 as u32).wrapping_mul(0x9e37_79b1).rotate_left(15)
        };
        Random(p.to_array().into_iter().fold(0x85eb_ca6b, mix))
    }

    /// In [0, 1): PCG's output over a step of an LCG (O'Neill 2014).
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        ((word >> 22) ^ word) as f32 * (1.0 / 4_294_967_808.0)
    }
}
