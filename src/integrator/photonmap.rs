//! Photon mapping: one pass shoots its photons, builds its maps, and renders one camera sample per pixel.

use super::direct::{self, Previous};
use super::plan::Plan;
use super::{DirectLight, Params, Parts, Seen};
use crate::bsdf::{Mode, Share};
use crate::math::{Ray, Rgb, Sampler, luminance};
use crate::photon::kdtree::KnnHeap;
use crate::photon::{Estimator, Photon, PhotonMap, Store, trace};
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

/// The photon passes of one pass of `params`: what each stores, and how many paths it emits.
fn photon_passes(params: &Params, plan: &Plan) -> [(Store, u64); 2] {
    // Gather rays end at the global map, so it holds all light; shown directly it stands beside the caustic map.
    let global =
        if params.final_gather || params.direct == DirectLight::Map { Store::All } else { Store::NotCaustic };
    [(global, plan.global_photons), (Store::Caustic, plan.caustic_photons)]
}

/// The photons that pass number 0 stores, for looking at them; `true` marks those of the caustic map.
pub(super) fn photons(scene: &Scene, params: &Params, plan: &Plan, seed: u64) -> Vec<(Photon, bool)> {
    let trace = |(store, count)| {
        let photons = trace(scene, seed, 0, store, count, params.max_segments().saturating_sub(1)).photons;
        photons.into_iter().map(move |photon| (photon, store == Store::Caustic))
    };
    photon_passes(params, plan).into_iter().flat_map(trace).collect()
}

impl Maps {
    /// Shoots the photons of `pass` and builds its maps.
    pub(super) fn new(scene: &Scene, params: &Params, plan: &Plan, seed: u64, pass: u32) -> (Maps, MapStats) {
        let mut stats = MapStats::default();
        // The camera's own segment is not the photons' to fly.
        let max_depth = params.max_segments().saturating_sub(1);
        let [(global, global_stored), (caustic, caustic_stored)] =
            photon_passes(params, plan).map(|(store, count)| {
                let start = Instant::now();
                let traced = trace(scene, seed, pass, store, count, max_depth);
                stats.seconds_photons += start.elapsed().as_secs_f64();
                let start = Instant::now();
                let map = PhotonMap::new(&traced.photons);
                stats.seconds_maps += start.elapsed().as_secs_f64();
                stats.rays += traced.rays;
                stats.emitted += count;
                let stored = map.len() as u64;
                (map, stored)
            });
        (stats.global_stored, stats.caustic_stored) = (global_stored, caustic_stored);
        let shrink = shrink(params.alpha, pass);
        let estimator =
            |k, radius| Estimator { k, r_max: radius * plan.radius, shrink, kernel: params.kernel };
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

/// Radiance along `ray`.
///
/// The path follows sharp lobes, and at every vertex that scatters light into them by broad lobes too it collects
/// direct light and caustics. When it first leaves by a broad lobe it has become a gather ray: what it now meets is
/// taken from the global map, through any sharp lobes on the way.
#[allow(clippy::too_many_arguments)]
pub(super) fn radiance(
    scene: &Scene,
    params: &Params,
    maps: &Maps,
    mut ray: Ray,
    sampler: &mut Sampler,
    scratch: &mut Scratch,
    seen: &mut Seen,
    rays: &mut u64,
) -> Parts {
    let mut sum = Parts::default();
    let mut beta = Rgb::ONE;
    // Throughput of light that the next vertex emits; zero where another part already counts it.
    let mut beta_emitted = if params.hide_emitters { Rgb::ZERO } else { Rgb::ONE };
    let mut emitted_part: fn(&mut Parts) -> &mut Rgb = |parts| &mut parts.direct;
    let mut gathering = false;
    let mut through_sharp = false;
    let mut eta = 1.0;
    let mut previous = Previous { p: ray.o, pdf_w: None };
    let max_depth = params.max_segments();
    for depth in 1..=max_depth {
        *rays += 1;
        let Some(s) = scene.hit(&ray) else {
            *emitted_part(&mut sum) += beta_emitted * direct::background(scene, &ray, &previous);
            break;
        };
        if depth == 1 {
            *seen = Seen::new(&s, &ray);
        }
        *emitted_part(&mut sum) += beta_emitted * direct::emitted(scene, &s, &ray, &previous);
        if depth == max_depth || beta == Rgb::ZERO {
            break;
        }

        let wo = s.frame.to_local(-ray.d);
        let smooth = s.bsdf.has_smooth();
        if smooth && gathering {
            let light = maps.gather(&s, -ray.d, max_depth - depth, scratch);
            *(if through_sharp { &mut sum.specular } else { &mut sum.indirect }) += beta * light;
        } else if smooth {
            let mut here = maps.seen(params, &s, -ray.d, max_depth - depth, scratch);
            if params.direct == DirectLight::Sample {
                if let Some(lit) = direct::sample_light(scene, &s, wo, sampler, rays) {
                    here.direct += lit.f * lit.light;
                }
            }
            sum +=
                if through_sharp { Parts { specular: here.sum(), ..Parts::default() } } else { here } * beta;
        }

        let Some(sample) = s.bsdf.sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance) else {
            break;
        };
        if sample.delta {
            beta *= sample.weight;
            beta_emitted = if gathering { Rgb::ZERO } else { beta };
            through_sharp |= !gathering;
            emitted_part = |parts| &mut parts.specular;
        } else {
            let share = if gathering { Share::BroadLight } else { Share::BroadEye };
            let broad = match s.bsdf.has_rough() {
                true => s.bsdf.eval(wo, sample.wi, Mode::Radiance, share) / sample.pdf_w,
                false => sample.weight,
            };
            let sharp = (sample.weight - broad).max(Rgb::ZERO);
            if gathering {
                beta *= sharp;
                beta_emitted = Rgb::ZERO;
            } else {
                beta_emitted = match params.direct {
                    DirectLight::Sample => beta * sample.weight,
                    DirectLight::Map | DirectLight::Off => Rgb::ZERO,
                };
                if !through_sharp {
                    emitted_part = |parts| &mut parts.direct;
                }
                // One ray serves both shares; which one it goes on for is decided by their proportion.
                let prob = if sharp == Rgb::ZERO { 1.0 } else { luminance(broad) / luminance(sample.weight) };
                if sampler.next_1d() < prob {
                    gathering = true;
                    beta *= if maps.gathers() { broad / prob } else { Rgb::ZERO };
                } else {
                    through_sharp = true;
                    beta *= sharp / (1.0 - prob);
                }
            }
        }
        if beta.max(beta_emitted) == Rgb::ZERO {
            break;
        }
        eta *= sample.eta;
        previous = Previous { p: s.p, pdf_w: (!sample.delta).then_some(sample.pdf_w) };
        ray = s.spawn(s.frame.to_world(sample.wi));

        if depth >= params.rr_depth {
            // eta² undoes the scaling of radiance inside glass, which says nothing about what the path will find.
            let survival = (beta.max(beta_emitted).max_element() * eta * eta).min(0.95);
            let survives = sampler.next_1d() < survival; // false for NaN
            if !survives {
                break;
            }
            beta /= survival;
            beta_emitted /= survival;
        }
    }
    sum
}

impl Maps {
    /// Whether rays that leave by broad lobes find anything in the global map.
    fn gathers(&self) -> bool {
        self.final_gather && !self.global.is_empty()
    }

    /// Radiance from a gather ray's hit: all light that arrives there and leaves by broad lobes.
    fn gather(&self, s: &Surface, wo: Vec3, max_depth: u32, scratch: &mut Scratch) -> Rgb {
        let depths = (1, max_depth);
        self.global_estimator.radiance(&self.global, s, wo, Share::BroadLight, depths, &mut scratch.global)
    }

    /// What the maps show at a vertex that the eye sees.
    fn seen(&self, params: &Params, s: &Surface, wo: Vec3, max_depth: u32, scratch: &mut Scratch) -> Parts {
        let mut parts = Parts::default();
        if !self.caustic.is_empty() {
            let depths = (2, max_depth);
            parts.caustic = self.caustic_estimator.radiance(
                &self.caustic,
                s,
                wo,
                Share::BroadEye,
                depths,
                &mut scratch.caustic,
            );
        }
        if !self.final_gather && !self.global.is_empty() {
            let depths = (if params.direct == DirectLight::Map { 1 } else { 2 }, max_depth);
            parts.indirect = self.global_estimator.radiance(
                &self.global,
                s,
                wo,
                Share::BroadEye,
                depths,
                &mut scratch.global,
            );
        }
        parts
    }
}
