//! The photon maps of one pass, and what camera paths look up in them.

use super::plan::Plan;
use super::{DirectLight, Params};
use crate::bsdf::Share;
use crate::math::Rgb;
use crate::photon::kdtree::KnnHeap;
use crate::photon::{
    Among, Emission, Estimator, Incident, Irradiance, Levels, Photon, PhotonMap, Photons, Splat, Splatter,
    Store, trace,
};
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
    /// Irradiance for gather rays, and the longest photon paths in it.
    irradiance: Option<(Irradiance, u32)>,
    /// Caustics that the camera sees directly, pixel by pixel.
    pub(super) splats: Vec<Splat>,
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
    /// Photons whose flux was no finite number.
    pub(super) dropped: u64,
}

/// √∏_{j=1}^{pass} (j−1+α)/j, with α the parameter: what remains of the first pass' radius (Knaus & Zwicker 2011,
/// Eq. 17 for r²).
fn shrink(alpha: f32, pass: u32) -> f32 {
    let product: f64 = (1..=pass).map(|j| (j as f64 - 1.0 + alpha as f64) / j as f64).product();
    product.sqrt() as f32
}

/// A limit of path lengths, the same for all limits that no stored photon exceeds.
fn depth_limit(segments: u32) -> u32 {
    segments.min(PhotonMap::MAX_DEPTH)
}

/// How many photon paths choose the places where irradiance is estimated ahead; `None` if that would take longer than it
/// saves.
///
/// Two places per disk of a lookup, which holds `k` photons, are near enough to each other. That takes 2/k of the paths
/// that have `stored` the photons, and an estimate at each; there is about one gather ray per pixel to use them.
fn sites(plan: &Plan, k: f32, stored: u64) -> Option<u64> {
    let per_photon = 2.0 / k;
    let pays = per_photon * stored as f32 <= 0.25 * plan.pixels as f32;
    let count = (per_photon * plan.global_photons as f32) as u64;
    (pays && count > 0).then_some(count)
}

/// The photon passes of one pass.
fn photon_passes<'a>(params: &Params, plan: &'a Plan, splatter: Option<&'a Splatter>) -> [Emission<'a>; 2] {
    let longest = params.longest_flight();
    let global = Emission::new(Store::All, plan.global_photons, longest);
    let caustic = Emission::new(Store::Caustic, plan.caustic_photons, longest);
    [
        Emission { guide: plan.global_guide.as_ref(), ..global },
        Emission { guide: plan.caustic_guide.as_ref(), splatter, ..caustic },
    ]
}

/// The photons that pass number 0 stores, for looking at them; `true` marks those of the caustic map.
pub(super) fn photons(scene: &Scene, params: &Params, plan: &Plan, seed: u64) -> Vec<(Photon, bool)> {
    let trace = |emission: Emission| {
        let photons = trace(scene, seed, 0, &emission).photons;
        photons.into_iter().map(move |photon| (photon.unpack(), emission.store == Store::Caustic))
    };
    photon_passes(params, plan, None).into_iter().flat_map(trace).collect()
}

impl Maps {
    /// Shoots the photons of `pass` and builds its maps.
    pub(super) fn new(scene: &Scene, params: &Params, plan: &Plan, seed: u64, pass: u32) -> (Maps, MapStats) {
        let mut stats = MapStats::default();
        let splatter = Splatter { scene, hide_emitters: params.hide_emitters };
        let mut splats = Vec::new();
        let [(global, global_stored), (caustic, caustic_stored)] =
            photon_passes(params, plan, Some(&splatter)).map(|emission| {
                let start = Instant::now();
                let traced = trace(scene, seed, pass, &emission);
                splats.extend(traced.splats);
                stats.seconds_photons += start.elapsed().as_secs_f64();
                let start = Instant::now();
                let map = PhotonMap::of_packed(traced.photons);
                stats.seconds_maps += start.elapsed().as_secs_f64();
                stats.rays += traced.rays;
                stats.dropped += traced.dropped;
                stats.emitted += emission.count;
                let stored = map.len() as u64;
                (map, stored)
            });
        (stats.global_stored, stats.caustic_stored) = (global_stored, caustic_stored);
        let shrink = shrink(params.alpha, pass);
        let estimator = |k, radius: f32| Estimator::new(k, radius * plan.radius, shrink, params.kernel);
        let global_estimator = estimator(params.global_k, params.global_radius);
        let irradiance = (params.final_gather && params.irradiance_cache)
            .then(|| {
                let start = Instant::now();
                let k = global_estimator.effective_k();
                let count = sites(plan, k, global.len() as u64)?;
                // Where photons go that show, gather rays look for them.
                let emission = Emission {
                    guide: plan.global_guide.as_ref(),
                    ..Emission::new(Store::Sites, count, params.longest_flight())
                };
                let traced = trace(scene, seed, pass, &emission);
                stats.rays += traced.rays;
                // Most gather rays are their path's second segment.
                let longest = depth_limit(params.max_segments().saturating_sub(2));
                let what = Photons { depths: (1, longest), caustics: true };
                let irradiance = Irradiance::new(&traced.sites, &global, &global_estimator, what);
                stats.seconds_maps += start.elapsed().as_secs_f64();
                Some((irradiance, longest))
            })
            .flatten();
        let maps = Maps {
            global,
            caustic,
            global_estimator,
            irradiance,
            caustic_estimator: estimator(params.caustic_k, params.caustic_radius).among(Among::All),
            final_gather: params.final_gather,
            splats,
        };
        (maps, stats)
    }

    /// Whether rays that leave by broad lobes find anything in the global map.
    pub(super) fn gathers(&self) -> bool {
        self.final_gather && !self.global.is_empty()
    }

    /// Radiance towards `wo` (world) from the hit of a gather ray of length `distance`: all light that arrives there and leaves
    /// by broad lobes.
    pub(super) fn gather(
        &self,
        s: &Surface,
        wo: Vec3,
        distance: f32,
        max_depth: u32,
        scratch: &mut Scratch,
    ) -> Rgb {
        let max_depth = depth_limit(max_depth);
        let ahead = self.irradiance.as_ref().filter(|(_, longest)| *longest == max_depth);
        if let (Some((irradiance, _)), Some(f)) = (ahead, s.bsdf.diffuse_only()) {
            if !s.bsdf.scatters_on(s.frame.to_local(wo)) {
                return Rgb::ZERO;
            }
            if let Some(e) = irradiance.near(s, wo, distance, &mut scratch.nearest) {
                return f * e;
            }
        }
        let what = Photons { depths: (1, max_depth), caustics: true };
        let heap = &mut scratch.global;
        self.global_estimator.radiance(&self.global, s, wo, Share::BroadLight, what, false, heap).wide
    }

    /// What the caustic map and the global map show at a vertex that the eye sees; and in `scratch`, where indirect light
    /// comes from there, if gather rays are to know.
    pub(super) fn seen(
        &self,
        params: &Params,
        s: &Surface,
        wo: Vec3,
        max_depth: u32,
        scratch: &mut Scratch,
    ) -> (Levels, Levels) {
        let share = Share::BroadEye;
        // At depth 1 there are only beams.
        let caustics = Photons { depths: (1, max_depth), caustics: true };
        let direct = params.direct == DirectLight::Map;
        let others = Photons { depths: (if direct { 1 } else { 2 }, max_depth), caustics: false };
        let (global, caustic) = (&self.global_estimator, &self.caustic_estimator);
        let caustic = caustic.radiance(&self.caustic, s, wo, share, caustics, true, &mut scratch.caustic);
        let indirect = global.radiance(&self.global, s, wo, share, others, true, &mut scratch.global);
        let is_diffuse = s.bsdf.diffuse_only().is_some() && s.bsdf.scatters_on(s.frame.to_local(wo));
        if params.guided_gather && is_diffuse && self.gathers() {
            scratch.incident.fill(&self.global, &scratch.global, others);
        }
        (caustic, indirect)
    }

    /// Radiance towards `wo` (world) that the caustic map shows where a path arrives that is seen by broad lobes.
    pub(super) fn caustics(&self, s: &Surface, wo: Vec3, max_depth: u32, scratch: &mut Scratch) -> Rgb {
        let what = Photons { depths: (1, depth_limit(max_depth)), caustics: true };
        let (estimator, heap) = (&self.caustic_estimator, &mut scratch.caustic);
        estimator.radiance(&self.caustic, s, wo, Share::BroadLight, what, false, heap).wide
    }

    /// Photons stored per area around `s`, in both maps.
    pub(super) fn density(&self, s: &Surface, scratch: &mut Scratch) -> f32 {
        let global = self.global_estimator.density(&self.global, s, &mut scratch.global);
        global + self.caustic_estimator.density(&self.caustic, s, &mut scratch.caustic)
    }
}

/// What a thread reuses from lookup to lookup.
pub(super) struct Scratch {
    nearest: KnnHeap,
    global: KnnHeap,
    caustic: KnnHeap,
    /// Where indirect light comes from at the vertex where the path is, as far as it is used.
    pub(super) incident: Incident,
}

impl Scratch {
    pub(super) fn new(maps: Option<&Maps>) -> Scratch {
        let heap = |k: fn(&Maps) -> u32| KnnHeap::new(maps.map_or(0, k) as usize);
        Scratch {
            nearest: KnnHeap::new(1),
            global: heap(|maps| maps.global_estimator.k),
            caustic: heap(|maps| maps.caustic_estimator.k),
            incident: Incident::default(),
        }
    }
}
