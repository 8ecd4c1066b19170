//! What the camera sees of each pixel before any pass: lights themselves and the features that pixels are compared by,
//! from camera paths without any light transport. They are cheap, so pixels with edges in them get many.

use super::eye::Eye;
use super::maps::{Maps, Scratch};
use super::plan::Plan;
use super::{DirectLight, Options, Params, Seen};
use crate::film::Guide;
use crate::math::{Rgb, Sampler, Stream};
use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;

/// Camera samples of every pixel.
const FEW: u64 = 8;
/// Further ones for pixels that look at something smooth, where lamps show as rare glints: so many on average over all
/// pixels, but at most so many for one.
const SEARCH: [u64; 2] = [1, 16];
/// Fewest and most camera samples of a pixel that these leave in doubt.
const MORE: [u64; 2] = [16, 512];
/// Of these, those for a standard deviation of emitted light that is as great as its mean. In proportion to it they leave the
/// least variance over all pixels (Neyman 1934).
const PER_DEVIATION: f64 = 96.0;
/// Emitted light fainter than this share of what the film shows of it on average is not worth many.
const FAINT: f64 = 0.1;
/// Fewest where emitted light changes from one pixel to the next.
const AT_LIGHT: u64 = 64;
/// A variance of the mean, relative to its square, that leaves a pixel's features in doubt.
const DOUBT: f32 = 1e-3;
/// Camera samples of such a pixel in each pass: what features leave in doubt, the rest of the picture does, too.
const AT_DOUBT: u32 = 2;
/// Pixels that a thread takes at once: few, for some take a hundred times as long as others.
const AT_ONCE: usize = 64;
/// Keeps 0/0 from being no number.
const TINY: Rgb = Rgb::splat(f32::MIN_POSITIVE);

/// What the first samples of a pixel have shown.
#[derive(Clone, Copy)]
struct Look {
    guide: Guide,
    is_doubtful: bool,
    /// Whether the camera looks at a smooth interface.
    is_smooth: bool,
    lamps: Spread,
    rays: u64,
}

/// How unevenly samples see lamps.
#[derive(Clone, Copy, Default)]
struct Spread {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Spread {
    fn add(&mut self, seen: &Seen) {
        let emitted = f64::from(seen.emitted.max_element());
        self.n += 1.0;
        self.sum += emitted;
        self.squares += emitted * emitted;
    }

    fn mean(&self) -> f64 {
        self.sum / self.n
    }

    /// Standard deviation of one sample relative to the mean, to which `floor` is added; `None` if nothing was seen.
    fn relative_deviation(&self, floor: f64) -> Option<f64> {
        let mean = self.mean();
        let variance = (self.squares / self.n - mean * mean).max(0.0);
        (mean > 0.0).then(|| variance.sqrt() / (mean + floor))
    }
}

/// One guide for each pixel of the crop window, row by row. Also returns the number of rays traced.
pub(super) fn guides(scene: &Scene, options: &Options, plan: &Plan) -> (Vec<Guide>, u64) {
    let params = Params { direct: DirectLight::Off, ..options.params.clone() };
    let plan = Plan { global_photons: 0, caustic_photons: 0, ..plan.clone() };
    let (maps, _) = Maps::new(scene, &params, &plan, options.seed, 0);
    let eye = Eye { scene, params: &params, maps: &maps, traces: false, effort: None, aovs: false };
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
    let look = |scratch: &mut Scratch, pixel| {
        let mut rays = 0;
        let samples: [Seen; FEW as usize] = std::array::from_fn(|i| see(pixel, i as u64, scratch, &mut rays));
        let guide = Guide::new(samples.iter().map(|seen| (seen.features, seen.emitted)));
        let mut lamps = Spread::default();
        samples.iter().for_each(|seen| lamps.add(seen));
        Look {
            guide: guide.without_emitted(),
            is_doubtful: is_doubtful(&samples, &guide),
            is_smooth: samples.iter().any(|seen| seen.smooth),
            lamps,
            rays,
        }
    };
    let scratch = || Scratch::new(Some(&maps));
    let pixels = || (0..width * height).into_par_iter().with_max_len(AT_ONCE);
    let mut looks: Vec<Look> = pixels().map_init(scratch, look).collect();
    let smooth = looks.iter().filter(|look| look.is_smooth).count() as u64;
    let [average, most] = SEARCH;
    let more = (average * looks.len() as u64 / smooth.max(1)).min(most);
    looks.par_iter_mut().with_max_len(AT_ONCE).enumerate().filter(|(_, look)| look.is_smooth).for_each_init(
        scratch,
        |scratch, (pixel, look)| {
            let first = FEW + MORE[1];
            for index in first..first + more {
                look.lamps.add(&see(pixel, index, scratch, &mut look.rays));
            }
        },
    );

    let floor = FAINT * looks.iter().map(|look| look.lamps.mean()).sum::<f64>() / looks.len() as f64;

    // What samples have missed, neighbours may know of.
    let around = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        (0..9).filter(|&i| i != 4).filter_map(move |i| {
            let (x, y) = ((x + i % 3).checked_sub(1)?, (y + i / 3).checked_sub(1)?);
            (x < width && y < height).then_some((i % 2 == 1, y * width + x))
        })
    };
    let finish = |scratch: &mut Scratch, pixel: usize| {
        let Look { guide, is_doubtful, lamps, mut rays, .. } = looks[pixel];
        let beside = || around(pixel).map(|(shares_edge, other)| (shares_edge, &looks[other]));
        let deviation = lamps.relative_deviation(floor).unwrap_or_else(|| {
            beside().filter_map(|(_, other)| other.lamps.relative_deviation(floor)).fold(0.0, f64::max)
        });
        let wanted = (PER_DEVIATION * deviation) as u64;
        let borders = |how: fn(&Guide, &Guide) -> bool| {
            beside().any(|(shares_edge, other)| shares_edge && how(&guide, &other.guide))
        };
        let at_light = borders(lights_differ);
        if !(is_doubtful || at_light || wanted > FEW || borders(features_differ)) {
            return (guide, rays);
        }
        // Others than have decided.
        let fewest = if at_light { AT_LIGHT } else { MORE[0] };
        let samples = FEW..FEW + wanted.clamp(fewest, MORE[1]);
        let samples = samples.map(|index| see(pixel, index, scratch, &mut rays));
        let guide = Guide::new(samples.map(|seen| (seen.features, seen.emitted)));
        (guide.with_samples(if is_doubtful { AT_DOUBT } else { 1 }), rays)
    };
    let (guides, rays): (Vec<Guide>, Vec<u64>) = pixels().map_init(scratch, finish).unzip();
    (guides, rays.iter().sum())
}

/// Whether samples with the means `guide` leave a pixel's features in doubt.
fn is_doubtful(samples: &[Seen], guide: &Guide) -> bool {
    let variance = |of: fn(&Seen) -> Vec3, mean: Vec3| {
        let sum: Vec3 = samples.iter().map(|s| (of(s) - mean) * (of(s) - mean)).sum();
        sum / (samples.len() * samples.len()) as f32
    };
    let (albedo, normal) = (guide.features.albedo, guide.features.normal);
    (variance(|s| s.features.albedo, albedo) / (albedo * albedo + 0.01)).max_element() > DOUBT
        || variance(|s| s.features.normal, normal).max_element() > DOUBT
}

/// Whether light ends between two pixels that share an edge.
fn lights_differ(a: &Guide, b: &Guide) -> bool {
    contrast(a.emitted, b.emitted) > 0.3
}

/// Whether a surface does.
fn features_differ(a: &Guide, b: &Guide) -> bool {
    contrast(a.features.albedo, b.features.albedo) > 0.3
        || a.features.normal.distance_squared(b.features.normal) > 0.25
}

fn contrast(a: Rgb, b: Rgb) -> f32 {
    ((a - b).abs() / (a.abs() + b.abs()).max(TINY)).max_element()
}
