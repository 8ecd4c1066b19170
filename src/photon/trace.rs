//! Photon emission and transport.

use super::splat::{Splat, Splatter};
use super::{Guide, Packed, Photon};
use crate::bsdf::{Mode, Share};
use crate::math::{Rgb, Sampler, Stream};
use crate::scene::{Scene, Surface};
use glam::Vec3;
use rayon::prelude::*;

/// What a photon pass stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Store {
    /// All light.
    All,
    /// Only the caustic share: light that has met nothing but sharp lobes (see [`crate::bsdf::Share::BroadLight`]),
    /// and at least one unless it left its lamp as a beam.
    Caustic,
}

/// What a photon pass brings home.
#[derive(Debug, Default)]
pub struct Traced {
    /// Photons in order of emission, whatever the number of threads.
    pub photons: Vec<Packed>,
    /// What of them the camera sees directly, likewise in order.
    pub splats: Vec<Splat>,
    /// Rays traced.
    pub rays: u64,
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

/// Emits `count` photon paths and stores them where they meet non-delta surfaces, up to `max_depth` segments. With a
/// `splatter`, caustics are also shown to the camera. A `guide` is for caustics only.
#[allow(clippy::too_many_arguments)]
pub fn trace(
    scene: &Scene,
    seed: u64,
    pass: u32,
    store: Store,
    count: u64,
    max_depth: u32,
    guide: Option<&Guide>,
    splatter: Option<&Splatter>,
) -> Traced {
    const BATCH: u64 = 4096;
    let stream = if store == Store::Caustic { Stream::CausticPhotons } else { Stream::GlobalPhotons };
    let batches: Vec<Traced> = (0..count.div_ceil(BATCH))
        .into_par_iter()
        .map(|batch| {
            let mut out = Traced::default();
            for index in batch * BATCH..((batch + 1) * BATCH).min(count) {
                let mut sampler = Sampler::new(seed, stream, pass as u64, index);
                trace_one(
                    scene,
                    &mut sampler,
                    store,
                    1.0 / count as f32,
                    max_depth,
                    guide,
                    splatter,
                    &mut out,
                );
            }
            out
        })
        .collect();
    let mut all = Traced::default();
    all.photons.reserve_exact(batches.iter().map(|b| b.photons.len()).sum());
    for batch in batches {
        all.photons.extend_from_slice(&batch.photons);
        all.splats.extend_from_slice(&batch.splats);
        all.rays += batch.rays;
    }
    all
}

#[allow(clippy::too_many_arguments)]
fn trace_one(
    scene: &Scene,
    sampler: &mut Sampler,
    store: Store,
    scale: f32,
    max_depth: u32,
    guide: Option<&Guide>,
    splatter: Option<&Splatter>,
    out: &mut Traced,
) {
    let (mut u_light, mut u_pos, mut u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
    let mut scale = scale;
    if let Some(guide) = guide {
        let weight;
        ([u_light, u_pos.x, u_pos.y, u_dir.x, u_dir.y], weight) =
            guide.warp([u_light, u_pos.x, u_pos.y, u_dir.x, u_dir.y]);
        scale *= weight;
    }
    let targets = if store == Store::Caustic { &scene.casters } else { &scene.targets };
    let (geometry, textures) = (&scene.geometry, &scene.textures);
    let emitted = scene.lights.sample_emission(geometry, textures, targets, u_light, u_pos, u_dir);
    let Some(start) = emitted else { return };
    let mut ray = crate::math::Ray::new(start.o, start.d);
    let mut flux = start.flux * scale;
    // The share of the flux that has met only sharp lobes so far.
    let mut caustic = flux;
    let beam = scene.lights.is_beam(start.light);
    for depth in 1..=max_depth.min(u8::MAX as u32) {
        out.rays += 1;
        let Some(s) = scene.hit(&ray) else { return };
        let wi = -ray.d;
        if s.bsdf.has_smooth() {
            let mut push = |flux: Rgb, caustic| {
                if flux.max_element() > 0.0 {
                    let photon = Photon { p: s.p, wi, n_g: s.n_g, flux, depth: depth as u8, caustic };
                    out.photons.push(photon.into());
                }
            };
            let shown = if depth == 1 && !beam { Rgb::ZERO } else { caustic };
            push(shown, true);
            if store == Store::All {
                push((flux - shown).max(Rgb::ZERO), false);
            }
            if let Some(splatter) = splatter.filter(|_| shown.max_element() > 0.0) {
                out.rays += splatter.show(&s, wi, shown, sampler, &mut out.splats);
            }
        }

        let (u_lobe, u, u_rr) = (sampler.next_1d(), sampler.next_2d(), sampler.next_1d());
        let wo = s.frame.to_local(wi);
        let Some(sample) = s.bsdf.sample(wo, u_lobe, u, Mode::Flux) else { return };
        let d = s.frame.to_world(sample.wi);
        let correction = adjoint_correction(&s, wi, d);
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
