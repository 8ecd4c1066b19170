//! Where the camera sees caustics: the density, on surfaces, of how much of the light there reaches the picture.

use super::estimate::near_plane;
use super::kdtree::{KdTree, KnnHeap};
use super::map::Packed;
use crate::bsdf::{Mode, Share};
use crate::math::{Rgb, Sampler, Stream, luminance};
use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Camera paths that find out.
const PATHS: u64 = 2048;
/// What is behind more mirrors than that is not worth looking for.
const LONGEST: u32 = 12;

/// Places that the camera sees, directly or by sharp lobes.
pub(super) struct Importance {
    tree: KdTree,
    points: Vec<Point>,
    r_max: f32,
}

#[derive(Clone, Copy)]
struct Point {
    p: Vec3,
    n_g: Vec3,
    /// On the side from which light shows; zero if it does from either.
    side: Vec3,
    weight: f32,
}

impl Importance {
    pub(super) const K: usize = 8;

    /// Looks at the scene. The same for any number of threads.
    pub(super) fn new(scene: &Scene) -> Importance {
        let paths: Vec<Vec<Point>> = (0..PATHS)
            .into_par_iter()
            .map(|index| look(scene, &mut Sampler::new(0, Stream::Pilots, u64::MAX, index)))
            .collect();
        let found = paths.concat();
        let positions: Vec<Vec3> = found.iter().map(|point| point.p).collect();
        let (tree, order) = KdTree::build(&positions);
        let points = order.iter().map(|&i| found[i as usize]).collect();
        Importance { tree, points, r_max: 0.05 * scene.bounds.radius() }
    }

    /// How much of the flux of `photon` shows.
    pub(super) fn shown(&self, photon: &Packed, heap: &mut KnnHeap) -> f32 {
        let photon = photon.unpack();
        self.tree.nearest_filtered(photon.p, self.r_max, heap, |slot, d2| {
            let point = &self.points[slot as usize];
            near_plane(photon.n_g, point.p - photon.p, d2)
                && photon.n_g.dot(point.n_g) > 0.7
                && point.side.dot(photon.wi) >= 0.0
        });
        let r2 = if heap.is_full() { heap.max_dist2() } else { self.r_max * self.r_max };
        let sum: f32 = heap.iter().map(|(slot, _)| self.points[slot as usize].weight).sum();
        // No smaller than what rounding leaves of a distance.
        luminance(photon.flux) * sum / (PI * r2.max(1e-9 * self.r_max * self.r_max))
    }
}

/// Where one camera path would show a caustic.
fn look(scene: &Scene, sampler: &mut Sampler) -> Vec<Point> {
    let (x, y, width, height) = scene.film.crop;
    let at = sampler.next_2d();
    let pixel = (x + (at.x * width as f32) as u32, y + (at.y * height as f32) as u32);
    let mut ray = scene.camera_ray(pixel, sampler);
    let mut beta = Rgb::ONE;
    let mut points = Vec::new();
    for _ in 0..LONGEST {
        let Some(s) = scene.hit(&ray) else { break };
        if s.is_crossed(sampler) {
            ray = s.spawn(ray.d);
            continue;
        }
        let wo = s.frame.to_local(-ray.d);
        if s.bsdf.has_smooth() {
            let side = match s.bsdf.transmits() {
                true => Vec3::ZERO,
                false => s.n_g * 1f32.copysign(-s.n_g.dot(ray.d)),
            };
            let weight = luminance(beta * s.bsdf.albedo());
            if weight > 0.0 && weight.is_finite() {
                points.push(Point { p: s.p, n_g: s.n_g, side, weight });
            }
        }
        let sample = s.bsdf.sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance);
        let Some(sample) = sample.filter(|_| s.bsdf.diffuse_only().is_none()) else { break };
        beta *= match sample.delta {
            true => sample.weight,
            false => {
                let broad = s.bsdf.eval(wo, sample.wi, Mode::Radiance, Share::BroadEye) / sample.pdf_w;
                (sample.weight - broad).max(Rgb::ZERO)
            }
        };
        if beta.max_element() < 1e-3 {
            break;
        }
        ray = s.spawn(s.frame.to_world(sample.wi));
    }
    points
}
