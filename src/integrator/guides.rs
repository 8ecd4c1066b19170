//! What the camera sees of each pixel before any pass: lights themselves and the features that pixels are compared by,
//! from camera paths without any light transport. They are cheap, so pixels with edges in them get many.

use super::photonmap::{Eye, Maps, Scratch};
use super::plan::Plan;
use super::{DirectLight, Options, Params, Seen};
use crate::film::Guide;
use crate::math::{Rgb, Sampler, Stream};
use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;

/// Camera samples of every pixel.
const FEW: u64 = 8;
/// Camera samples of a pixel that these leave in doubt.
const MANY: u64 = 64;
/// A variance of the mean, relative to its square, that leaves a pixel in doubt.
const DOUBT: f32 = 1e-3;
/// Keeps 0/0 from being no number.
const TINY: Rgb = Rgb::splat(f32::MIN_POSITIVE);

/// One guide for each pixel of the crop window, row by row. Also returns the number of rays traced.
pub(super) fn guides(scene: &Scene, options: &Options, plan: &Plan) -> (Vec<Guide>, u64) {
    let params = Params { direct: DirectLight::Off, ..options.params.clone() };
    let plan = Plan { global_photons: 0, caustic_photons: 0, ..plan.clone() };
    let (maps, _) = Maps::new(scene, &params, &plan, options.seed, 0);
    let eye = Eye { scene, params: &params, maps: &maps, aovs: false };
    let (x0, y0, width, height) = scene.film.crop;
    let (width, height) = (width as usize, height as usize);
    let see = |pixel: usize, index: u64, scratch: &mut Scratch, rays: &mut u64| {
        let (x, y) = (x0 + (pixel % width) as u32, y0 + (pixel / width) as u32);
        let set = u64::from(y) * u64::from(scene.film.size.0) + u64::from(x);
        let mut sampler = Sampler::new(options.seed, Stream::Guides, set, index);
        let mut seen = Seen::default();
        eye.radiance(scene.camera_ray((x, y), &mut sampler), &mut sampler, scratch, &mut seen, rays);
        seen
    };
    let pixels = (0..width * height).into_par_iter();
    let few: Vec<(Guide, bool, u64)> = pixels
        .clone()
        .map_init(
            || Scratch::new(Some(&maps)),
            |scratch, pixel| {
                let mut rays = 0;
                let samples: [Seen; FEW as usize] =
                    std::array::from_fn(|i| see(pixel, i as u64, scratch, &mut rays));
                let guide = Guide::new(samples.iter().map(|seen| (seen.features, seen.emitted)));
                (guide.without_emitted(), is_doubtful(&samples, &guide), rays)
            },
        )
        .collect();
    let (guides, rays): (Vec<Guide>, Vec<u64>) = pixels
        .map_init(
            || Scratch::new(Some(&maps)),
            |scratch, pixel| {
                let (x, y) = (pixel % width, pixel / width);
                let (guide, is_doubtful, mut rays) = few[pixel];
                let beside = |dx: usize, dy: usize| {
                    let (x, y) = ((x + dx).checked_sub(1)?, (y + dy).checked_sub(1)?);
                    (x < width && y < height).then(|| &few[y * width + x].0)
                };
                // What the few have missed, neighbours may know of.
                let around = [beside(0, 1), beside(2, 1), beside(1, 0), beside(1, 2)];
                if !is_doubtful && !around.into_iter().flatten().any(|other| differ(&guide, other)) {
                    return (guide, rays);
                }
                // Others than have decided.
                let samples = (FEW..FEW + MANY).map(|index| see(pixel, index, scratch, &mut rays));
                (Guide::new(samples.map(|seen| (seen.features, seen.emitted))), rays)
            },
        )
        .unzip();
    (guides, rays.iter().sum())
}

/// Whether samples with the means `guide` leave a pixel in doubt.
fn is_doubtful(samples: &[Seen], guide: &Guide) -> bool {
    let variance = |of: fn(&Seen) -> Vec3, mean: Vec3| {
        let sum: Vec3 = samples.iter().map(|s| (of(s) - mean) * (of(s) - mean)).sum();
        sum / (samples.len() * samples.len()) as f32
    };
    let (emitted, albedo, normal) = (guide.emitted, guide.features.albedo, guide.features.normal);
    (variance(|s| s.emitted, emitted) / (emitted * emitted).max(TINY)).max_element() > DOUBT
        || (variance(|s| s.features.albedo, albedo) / (albedo * albedo + 0.01)).max_element() > DOUBT
        || variance(|s| s.features.normal, normal).max_element() > DOUBT
}

/// Whether an edge runs between two pixels that share one.
fn differ(a: &Guide, b: &Guide) -> bool {
    let relative = |a: Rgb, b: Rgb| ((a - b).abs() / (a.abs() + b.abs()).max(TINY)).max_element();
    relative(a.emitted, b.emitted) > 0.3
        || relative(a.features.albedo, b.features.albedo) > 0.3
        || a.features.normal.distance_squared(b.features.normal) > 0.25
}
