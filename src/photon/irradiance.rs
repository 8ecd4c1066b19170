//! Irradiance estimated ahead where some photons land, so that a gather ray needs one neighbour instead of k
//! (Christensen 1999, "Faster Photon Map Global Illumination").
//!
//! These photons are not those of the map: the fewer photons of the map are near one of them, the more gather rays it
//! is the nearest for, so that with every fourth of them pictures come out 0.9 % too dark.

use super::PhotonMap;
use super::estimate::{Estimator, Photons, Site};
use super::kdtree::{KdTree, KnnHeap};
use super::octahedral::{Direction, encode8};
use crate::math::Rgb;
use crate::scene::Surface;
use glam::Vec3;
use rayon::prelude::*;

/// What is known at one point.
#[derive(Clone, Copy, Debug)]
struct Known {
    irradiance: Rgb,
    /// Of the disk that the estimate was made over.
    radius: f32,
    /// The geometric normal, on the side that the irradiance is meant for.
    n_g: [i8; 2],
    /// Of the surface.
    tag: u8,
}

/// Irradiance at points spread as photons are.
#[derive(Debug)]
pub struct Irradiance {
    tree: KdTree,
    known: Vec<Known>,
}

impl Irradiance {
    /// Estimates the irradiance at `sites` from the photons of `map` that take part by `what`.
    pub fn new(sites: &[Site], map: &PhotonMap, estimator: &Estimator, what: Photons) -> Irradiance {
        let points: Vec<Vec3> = sites.iter().map(|site| site.place.p).collect();
        let (tree, order) = KdTree::build(&points);
        let known = order
            .par_iter()
            .with_min_len(64)
            .map_init(
                || KnnHeap::new(estimator.k as usize),
                |heap, &i| {
                    let site = &sites[i as usize];
                    let (irradiance, radius) = estimator.irradiance(map, site, what, heap);
                    Known { irradiance, radius, n_g: encode8(site.n_g()), tag: site.place.tag }
                },
            )
            .collect();
        Irradiance { tree, known }
    }

    /// The irradiance at `s`, on the side of `wo` (world), for a ray that has come `distance`: that of the nearest point on
    /// the same surface. `None` where it is farther away than twice its estimate's radius, or where the ray is so short
    /// that one such point might light all of a corner. `heap` is for one neighbour.
    pub fn near(&self, s: &Surface, wo: Vec3, distance: f32, heap: &mut KnnHeap) -> Option<Rgb> {
        let site = Site::new(s, wo);
        let side = Direction::new(site.n_g());
        self.tree.nearest_filtered(s.p, f32::INFINITY, heap, |slot, d2| {
            let known = &self.known[slot as usize];
            site.place.is_beside(self.tree.position(slot), d2, |tag| known.tag == tag)
                && side.agrees(known.n_g, 0.9)
        });
        let (slot, d2) = heap.iter().next()?;
        let known = &self.known[slot as usize];
        // A narrower limit would pick: where photons are dense by chance, radii are small.
        (d2 <= 4.0 * known.radius * known.radius && distance >= 2.0 * known.radius)
            .then_some(known.irradiance)
    }
}
