//! What the camera sees of each pixel before any pass: lights themselves and the features that pixels are compared by,
//! from camera rays without any light transport. They are cheap, so pixels with edges in them get many.

use super::{Params, direct};
use crate::bsdf::Mode;
use crate::film::{Features, Guide};
use crate::math::{Ray, Rgb, Sampler, Stream, luminance};
use crate::scene::{Scene, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Camera samples of every pixel.
const FEW: u64 = 8;
/// Camera samples of a pixel that these leave in doubt.
const MANY: u64 = 64;
/// A variance of the mean, relative to its square, that leaves a pixel in doubt.
const DOUBT: f32 = 1e-3;

/// Keeps 0/0 from being no number.
const TINY: Rgb = Rgb::splat(f32::MIN_POSITIVE);

/// Adds what `s` shows with `weight` at the end of a camera ray.
pub(super) fn add_surface(features: &mut Features, weight: Rgb, s: &Surface, scene: &Scene) {
    let w = luminance(weight);
    features.albedo += weight * s.bsdf.albedo();
    features.normal += w * s.frame.n;
    features.position += w * relative(s.p, scene);
}

/// Adds what `ray` shows with `weight` if it leaves the scene.
pub(super) fn add_background(features: &mut Features, weight: Rgb, ray: &Ray, scene: &Scene) {
    let w = luminance(weight);
    features.albedo += weight;
    features.normal -= w * ray.d;
    features.position += w * (relative(ray.o, scene).clamp_length_max(1.0) + ray.d);
}

fn relative(p: Vec3, scene: &Scene) -> Vec3 {
    (p - scene.bounds.center()) / scene.bounds.radius().max(f32::MIN_POSITIVE)
}

/// One guide for each pixel of the crop window, row by row. Also returns the number of rays traced.
pub(super) fn guides(scene: &Scene, params: &Params, seed: u64) -> (Vec<Guide>, u64) {
    let (_, _, width, height) = scene.film.crop;
    let sample = |pixel: usize, index: u64| {
        let (x, y) = (pixel as u32 % width, pixel as u32 / width);
        see(scene, params, seed, (x, y), index)
    };
    let few: Vec<(Guide, Doubt, u64)> = (0..width as usize * height as usize)
        .into_par_iter()
        .map(|pixel| {
            let samples = std::array::from_fn::<_, { FEW as usize }, _>(|i| sample(pixel, i as u64));
            let rays = samples.iter().map(|s| s.2).sum();
            (Guide::without_emitted(samples.iter().map(|s| (s.0, s.1))), Doubt::new(&samples), rays)
        })
        .collect();
    let refined: Vec<(Guide, u64)> = (0..few.len())
        .into_par_iter()
        .map(|pixel| {
            let (x, y) = (pixel % width as usize, pixel / width as usize);
            let (guide, own, rays) = &few[pixel];
            let mut rays = *rays;
            let beside = |dx: usize, dy: usize| {
                let (x, y) = ((x + dx).checked_sub(1)?, (y + dy).checked_sub(1)?);
                (x < width as usize && y < height as usize).then(|| &few[y * width as usize + x].1)
            };
            // What the few have missed, neighbours may know of.
            let around = [beside(0, 1), beside(2, 1), beside(1, 0), beside(1, 2)];
            if !own.is_doubtful && !around.into_iter().flatten().any(|other| own.differs(other)) {
                return (*guide, rays);
            }
            // Others than have decided.
            let samples = (FEW..FEW + MANY).map(|index| {
                let (features, emitted, n) = sample(pixel, index);
                rays += n;
                (features, emitted)
            });
            (Guide::new(samples), rays)
        })
        .collect();
    let rays = refined.iter().map(|(_, rays)| rays).sum();
    (refined.into_iter().map(|(guide, _)| guide).collect(), rays)
}

/// What a pixel's samples leave in doubt.
struct Doubt {
    emitted: Rgb,
    normal: Vec3,
    albedo: Rgb,
    is_doubtful: bool,
}

impl Doubt {
    fn new(samples: &[(Features, Rgb, u64)]) -> Doubt {
        let scale = 1.0 / samples.len() as f32;
        let mean = |of: fn(&(Features, Rgb, u64)) -> Vec3| samples.iter().map(of).sum::<Vec3>() * scale;
        let (emitted, normal, albedo) = (mean(|s| s.1), mean(|s| s.0.normal), mean(|s| s.0.albedo));
        let variance = |of: fn(&(Features, Rgb, u64)) -> Vec3, mean: Vec3| {
            let sum: Vec3 = samples.iter().map(|s| (of(s) - mean) * (of(s) - mean)).sum();
            sum * (scale * scale)
        };
        let relative = (variance(|s| s.1, emitted) / (emitted * emitted).max(TINY)).max_element();
        let features = variance(|s| s.0.normal, normal)
            .max_element()
            .max((variance(|s| s.0.albedo, albedo) / (albedo * albedo + 0.01)).max_element());
        Doubt { emitted, normal, albedo, is_doubtful: relative > DOUBT || features > DOUBT }
    }

    /// Whether an edge runs between two pixels that share one.
    fn differs(&self, other: &Doubt) -> bool {
        let relative = |a: Rgb, b: Rgb| ((a - b).abs() / (a.abs() + b.abs()).max(TINY)).max_element();
        relative(self.emitted, other.emitted) > 0.3
            || relative(self.albedo, other.albedo) > 0.3
            || self.normal.distance_squared(other.normal) > 0.25
    }
}

/// What a camera ray sees: the first surface that scatters broadly, and all lights on the way that nothing but delta
/// lobes show; by the rules of [`super::photonmap::Eye::radiance`]. And the number of rays traced.
fn see(scene: &Scene, params: &Params, seed: u64, (x, y): (u32, u32), index: u64) -> (Features, Rgb, u64) {
    let (x, y) = (x + scene.film.crop.0, y + scene.film.crop.1);
    let full = Vec2::new(scene.film.size.0 as f32, scene.film.size.1 as f32);
    let pixel = u64::from(y) * u64::from(scene.film.size.0) + u64::from(x);
    let mut sampler = Sampler::new(seed, Stream::Guides, pixel, index);
    let position = Vec2::new(x as f32, y as f32) + 0.5 + scene.film.filter.sample(sampler.next_2d());
    let ray = scene.camera.ray(position / full, sampler.next_2d());

    let (mut features, mut emitted, mut rays) = (Features::default(), Rgb::ZERO, 0);
    let mut pending = None;
    let mut next = Some((ray, Rgb::ONE, 1, true, false, 1.0));
    while let Some((ray, beta, depth, straight, mut known, eta)) = next.or_else(|| pending.take()) {
        next = None;
        rays += 1;
        let hit = match depth {
            1 => direct::first_hit(scene, params, ray, &mut rays),
            _ => scene.hit(&ray),
        };
        let Some(s) = hit else {
            if !known {
                add_background(&mut features, beta, &ray, scene);
            }
            if !(straight && params.hide_emitters) {
                emitted += beta * scene.lights.background(ray.d);
            }
            continue;
        };
        if s.light.is_some() {
            emitted += beta * scene.emitted(&s, -ray.d);
        }
        if !known && (s.bsdf.has_smooth() || s.light.is_some()) {
            known = true;
            add_surface(&mut features, beta, &s, scene);
        }
        if depth >= params.max_segments() {
            continue;
        }
        let wo = s.frame.to_local(-ray.d);
        let follow = |sample: &crate::bsdf::BsdfSample, sampler: &mut Sampler| {
            let mut beta = beta * sample.weight;
            let eta = eta * sample.eta;
            if !sample.delta || beta == Rgb::ZERO {
                return None;
            }
            if depth >= params.rr_depth {
                let prob = (beta.max_element() * eta * eta).min(0.95);
                let survives = sampler.next_1d() < prob; // false for NaN
                if !survives {
                    return None;
                }
                beta /= prob;
            }
            let straight = straight && direct::goes_straight(sample, wo);
            Some((s.spawn(s.frame.to_world(sample.wi)), beta, depth + 1, straight, known, eta))
        };
        next = match s.bsdf.split(wo, Mode::Radiance) {
            Some([a, b]) if depth == 1 => {
                pending = follow(&a, &mut sampler);
                follow(&b, &mut sampler)
            }
            _ => s
                .bsdf
                .sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance)
                .and_then(|sample| follow(&sample, &mut sampler)),
        };
    }
    (features, emitted, rays)
}
