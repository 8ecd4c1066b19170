//! Photon emission and transport.

use super::splat::{Splat, Splatter};
use super::{Guide, Packed, Photon, Site};
use crate::bsdf::{Mode, Share};
use crate::light::{EmissionSample, Targets};
use crate::math::{Ray, Rgb, Sampler, Stream};
use crate::scene::{Scene, Surface};
use glam::{Vec3, vec2};
use rayon::prelude::*;

/// What a photon pass stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Store {
    /// All light.
    All,
    /// Only the caustic share: light that has met nothing but sharp lobes (see [`crate::bsdf::Share::BroadLight`]),
    /// and at least one unless it left its lamp as a beam.
    Caustic,
    /// No light, but places that it reaches.
    Sites,
}

/// What a photon pass brings home.
#[derive(Default)]
pub struct Traced<'a> {
    /// Photons in order of emission, whatever the number of threads.
    pub photons: Vec<Packed>,
    /// What of them the camera sees directly, likewise in order.
    pub splats: Vec<Splat>,
    /// In [`Store::Sites`], where photons have landed on diffuse surfaces, in order.
    pub sites: Vec<Site<'a>>,
    /// With [`Emission::watched`], the shapes that photons have met, in order.
    pub met: Vec<u32>,
    /// Rays traced.
    pub rays: u64,
    /// Photons left out because their flux was no finite number.
    pub dropped: u64,
}

/// What the flux of a photon that came from `wo` and leaves along `wi` (both world, away from the surface) must be
/// multiplied with where shading and geometric normal differ: Veach 1997, Eq. 5.19, for light that travels from
/// `wo` to `wi`, with |cosθ_i| already in the scattering weight.
fn adjoint_correction(s: &Surface, wo: Vec3, wi: Vec3) -> f32 {
    if s.n_g == s.frame.n {
        return 1.0;
    }
    let above = s.frame.n.dot(wo) * s.n_g.dot(wi);
    let below = s.n_g.dot(wo) * s.frame.n.dot(wi);
    if below == 0.0 { 0.0 } else { (above / below).abs() }
}

/// What to emit, and what becomes of it.
#[derive(Clone, Copy)]
pub struct Emission<'a> {
    /// What is stored.
    pub store: Store,
    /// Photon paths.
    pub count: u64,
    /// Most segments of a path.
    pub max_depth: u32,
    /// What to start from.
    pub guide: Option<&'a Guide>,
    /// Shows caustics to the camera, too.
    pub splatter: Option<&'a Splatter<'a>>,
    /// Whether to tell what photons meet.
    pub watched: bool,
}

impl Emission<'_> {
    /// All of `store`, as if nothing were known of the scene.
    pub fn new(store: Store, count: u64, max_depth: u32) -> Emission<'static> {
        Emission { store, count, max_depth, guide: None, splatter: None, watched: false }
    }

    /// Where photons are aimed.
    pub fn targets<'a>(&'a self, scene: &'a Scene) -> &'a Targets {
        let all = if self.store == Store::Caustic { &scene.casters } else { &scene.targets };
        self.guide.and_then(Guide::targets).unwrap_or(all)
    }
}

/// Emits photon paths, and stores what they carry where they meet non-delta surfaces.
pub fn trace<'a>(scene: &'a Scene, seed: u64, pass: u32, emission: &Emission) -> Traced<'a> {
    const BATCH: u64 = 1024;
    let count = emission.count;
    let stream = match emission.store {
        Store::All => Stream::GlobalPhotons,
        Store::Caustic => Stream::CausticPhotons,
        Store::Sites => Stream::Sites,
    };
    let batches: Vec<Traced> = (0..count.div_ceil(BATCH) as usize)
        .into_par_iter()
        .with_max_len(1)
        .map(|batch| {
            let mut out = Traced::default();
            let first = batch as u64 * BATCH;
            for index in first..(first + BATCH).min(count) {
                let mut sampler = Sampler::new(seed, stream, pass as u64, index);
                let (at, weight) = Start::draw(&mut sampler, emission.guide);
                if let Some(start) = at.emit(scene, emission.targets(scene)) {
                    fly(scene, &start, weight / count as f32, &mut sampler, emission, &mut out);
                }
            }
            out
        })
        .collect();
    let mut all = Traced::default();
    all.photons.reserve_exact(batches.iter().map(|b| b.photons.len()).sum());
    for batch in batches {
        all.photons.extend_from_slice(&batch.photons);
        all.splats.extend_from_slice(&batch.splats);
        all.sites.extend_from_slice(&batch.sites);
        all.rays += batch.rays;
        all.dropped += batch.dropped;
    }
    all
}

/// The random numbers that a photon starts from: light, position, direction.
#[derive(Clone, Copy, Debug)]
pub struct Start(pub [f32; 5]);

impl Start {
    /// Draws them by `guide`, if there is one; also returns 1 / density.
    pub fn draw(sampler: &mut Sampler, guide: Option<&Guide>) -> (Start, f32) {
        let (light, position, direction) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
        let u = [light, position.x, position.y, direction.x, direction.y];
        let (at, weight) = guide.map_or((u, 1.0), |guide| guide.warp(u));
        (Start(at), weight)
    }

    /// The photon that starts from them, towards `targets`.
    pub fn emit(&self, scene: &Scene, targets: &Targets) -> Option<EmissionSample> {
        let Start([light, x, y, s, t]) = *self;
        let (geometry, textures) = (&scene.geometry, &scene.textures);
        scene.lights.sample_emission(geometry, textures, targets, light, vec2(x, y), vec2(s, t))
    }
}

/// Photons that have crossed more holes are given up: they are caught between surfaces that rounding does not part.
const MOST_CROSSINGS: u32 = 1 << 12;

/// Follows one photon of `scale` times its flux.
pub(super) fn fly<'a>(
    scene: &'a Scene,
    start: &EmissionSample,
    scale: f32,
    sampler: &mut Sampler,
    emission: &Emission,
    out: &mut Traced<'a>,
) {
    let Emission { store, max_depth, splatter, .. } = *emission;
    let mut ray = Ray::new(start.o, start.d);
    let mut flux = start.flux * scale;
    // The share of the flux that has met only sharp lobes so far.
    let mut caustic = flux;
    let beam = scene.lights.is_beam(start.light);
    // Segments, but for those that end in holes before the light has met anything, as no shadow ray counts them.
    let mut depth = 0;
    let mut has_scattered = false;
    let mut crossed = 0;
    while depth < max_depth.min(u8::MAX as u32) {
        depth += 1;
        out.rays += 1;
        let hit = scene.hit(&ray);
        let Some(s) = &hit else { return };
        let wi = -ray.d;
        // A photon tells what arrives, whether it then meets the surface or not.
        let opacity = s.bsdf.opacity();
        if opacity == 0.0 {
            // Nothing is there.
        } else if store == Store::Sites {
            if s.bsdf.diffuse_only().is_some() {
                out.sites.push(Site::new(s, wi));
            }
        } else if s.bsdf.has_smooth() {
            let mut push = |flux: Rgb, caustic| {
                if !flux.is_finite() {
                    out.dropped += 1;
                } else if flux.max_element() > 0.0 {
                    let photon =
                        Photon { p: s.p, wi, n_g: s.n_g, tag: s.tag(), flux, depth: depth as u8, caustic };
                    out.photons.push(photon.into());
                }
            };
            let shown = if has_scattered || beam { caustic } else { Rgb::ZERO };
            push(shown, true);
            if store == Store::All {
                push((flux - shown).max(Rgb::ZERO), false);
            }
            if let Some(splatter) = splatter.filter(|_| shown.max_element() > 0.0) {
                out.rays +=
                    splatter.show(s, wi, shown * opacity, max_depth - depth, sampler, &mut out.splats);
            }
        }

        if s.is_crossed(sampler) {
            crossed += 1;
            if crossed > MOST_CROSSINGS {
                return;
            }
            depth -= u32::from(!has_scattered);
            ray = s.spawn(ray.d);
            continue;
        }
        has_scattered = true;
        if emission.watched {
            out.met.push(s.shape);
        }
        let (u_lobe, u, u_rr) = (sampler.next_1d(), sampler.next_2d(), sampler.next_1d());
        let wo = s.frame.to_local(wi);
        let Some(sample) = s.bsdf.sample(wo, u_lobe, u, Mode::Flux) else { return };
        let d = s.frame.to_world(sample.wi);
        let correction = adjoint_correction(s, wi, d);
        let weight = sample.weight * correction;
        let mut sharp_weight = weight;
        if !sample.delta {
            sharp_weight = match s.bsdf.diffuse_only() {
                Some(_) => Rgb::ZERO,
                None => {
                    let broad = s.bsdf.eval(wo, sample.wi, Mode::Flux, Share::BroadLight);
                    (weight - broad * (correction / sample.pdf_w)).max(Rgb::ZERO)
                }
            };
        }
        // Russian roulette by albedo keeps the flux level; what decides is what this pass stores.
        let before = if store == Store::Caustic { caustic } else { flux }.max_element();
        flux *= weight;
        caustic *= sharp_weight;
        let after = if store == Store::Caustic { caustic } else { flux }.max_element();
        let mut survival = (after / before).min(1.0);
        if depth >= 32 {
            survival = survival.min(0.95); // light trapped by total reflection
        }
        let survives = u_rr < survival; // false for NaN
        if !survives {
            return;
        }
        flux /= survival;
        caustic /= survival;
        ray = s.spawn(d);
    }
}
