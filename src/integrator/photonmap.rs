//! Photon mapping: one pass shoots its photons, builds its maps, and renders one camera sample per pixel.

use super::direct::{self, Previous};
use super::plan::Plan;
use super::{Params, Parts};
use crate::bsdf::{Mode, Share};
use crate::math::{Ray, Rgb, Sampler, luminance};
use crate::photon::kdtree::KnnHeap;
use crate::photon::{Estimator, Kernel, PhotonMap, Store, trace};
use crate::scene::{Scene, Surface};
use glam::Vec3;
use std::time::Instant;

/// The maps of one pass, with the way to look them up.
pub(super) struct Maps {
    global: PhotonMap,
    caustic: PhotonMap,
    global_estimator: Estimator,
    caustic_estimator: Estimator,
    final_gather: bool,
}

/// What building the maps of a pass took.
#[derive(Default)]
pub(super) struct MapStats {
    pub(super) seconds_photons: f64,
    pub(super) seconds_maps: f64,
    pub(super) rays: u64,
    pub(super) emitted: u64,
    pub(super) global_stored: u64,
    pub(super) caustic_stored: u64,
}

/// √∏_{j=1}^{pass} (j−1+α)/j, with α the parameter: what remains of the first pass' radius (Knaus & Zwicker 2011,
/// Eq. 17 for r²).
fn shrink(alpha: f32, pass: u32) -> f32 {
    let product: f64 = (1..=pass).map(|j| (j as f64 - 1.0 + alpha as f64) / j as f64).product();
    product.sqrt() as f32
}

impl Maps {
    /// Shoots the photons of `pass` and builds its maps.
    pub(super) fn new(scene: &Scene, params: &Params, plan: &Plan, seed: u64, pass: u32) -> (Maps, MapStats) {
        let mut stats = MapStats::default();
        // The camera's own segment is not the photons' to fly.
        let max_depth = params.max_segments() - 1;
        let mut map = |store, count, stored: fn(&mut MapStats) -> &mut u64| {
            if count == 0 {
                return PhotonMap::default();
            }
            let start = Instant::now();
            let traced = trace(scene, seed, pass, store, count, max_depth);
            stats.seconds_photons += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let map = PhotonMap::new(&traced.photons);
            stats.seconds_maps += start.elapsed().as_secs_f64();
            stats.rays += traced.rays;
            stats.emitted += count;
            *stored(&mut stats) += map.len() as u64;
            map
        };
        // Gather rays end at the global map, so it holds all light; shown directly it stands beside the caustic map.
        let store = if params.final_gather { Store::All } else { Store::NotCaustic };
        let global = map(store, plan.global_photons, |s| &mut s.global_stored);
        let caustic = map(Store::Caustic, plan.caustic_photons, |s| &mut s.caustic_stored);
        let shrink = shrink(params.alpha, pass);
        let estimator = |k, radius| Estimator { k, r_max: radius * plan.radius, shrink, kernel: params.kernel };
        let maps = Maps {
            global,
            caustic,
            global_estimator: estimator(params.global_k, params.global_radius),
            caustic_estimator: estimator(params.caustic_k, params.caustic_radius),
            final_gather: params.final_gather,
        };
        (maps, stats)
    }
}

/// What a thread reuses from lookup to lookup.
pub(super) struct Scratch {
    global: KnnHeap,
    caustic: KnnHeap,
}

impl Scratch {
    pub(super) fn new(params: &Params) -> Scratch {
        Scratch {
            global: KnnHeap::new(params.global_k as usize),
            caustic: KnnHeap::new(params.caustic_k as usize),
        }
    }
}
