//! Integrators: a render is a sum of independent passes, and pass i depends only on (scene, seed, i).

mod direct;
mod params;
mod parts;
mod path;
mod photonmap;
mod plan;

pub use params::{DirectLight, Params};
pub use parts::Parts;

use crate::film::Film;
use crate::image_io::Image;
use crate::math::{Rgb, Sampler, Stream};
use crate::scene::Scene;
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use photonmap::{Maps, Scratch};
use plan::Plan;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Which integrator renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Photon mapping.
    Photonmap,
    /// The unidirectional reference path tracer.
    Path,
}

/// When to stop. The first pass is always finished.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// After so many passes.
    Passes(u32),
    /// When so much time has gone, counted from the start of the first pass.
    Time(Duration),
    /// When the estimated relative error is at most this.
    Error(f32),
}

/// What to render.
#[derive(Clone, Debug)]
pub struct Options {
    /// The integrator.
    pub integrator: Kind,
    /// Its parameters.
    pub params: Params,
    /// Names the random numbers.
    pub seed: u64,
    /// When to stop.
    pub budget: Budget,
}

/// How far a render is, told after each pass.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Finished passes.
    pub passes: u32,
    /// Seconds since the first pass began.
    pub seconds: f64,
    /// Share of the budget that is used, 0 to 1.
    pub fraction: f64,
}

/// A stage that the scene does not need.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Skipped {
    /// Its name, e.g. `caustic map`.
    pub stage: &'static str,
    /// Why.
    pub reason: String,
}

/// Seconds spent, by stage, wall time.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Seconds {
    /// Emitting and tracing photons.
    pub photons: f64,
    /// Building maps.
    pub maps: f64,
    /// Camera paths.
    pub eye: f64,
}

/// Counts of photons over all passes.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct PhotonCounts {
    /// Photons emitted.
    pub emitted: u64,
    /// Records stored in the global map.
    pub global_stored: u64,
    /// Records stored in the caustic map.
    pub caustic_stored: u64,
}

/// What a render has to tell besides pixels.
#[derive(Clone, Debug, Default)]
pub struct RenderStats {
    /// Finished passes.
    pub passes: u32,
    /// Seconds by stage.
    pub seconds: Seconds,
    /// Rays traced, shadow rays included.
    pub rays: u64,
    /// Photons.
    pub photons: PhotonCounts,
    /// Stages that were not needed.
    pub skipped: Vec<Skipped>,
    /// Estimated relative error of the image (noise from the spread of passes); 0 with fewer than two passes.
    pub estimated_relative_error: f64,
}

/// A finished (or interrupted) render.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The picture.
    pub image: Image,
    /// Named parts and auxiliary layers: direct, specular, caustic, indirect (their sum is the picture), albedo,
    /// normal, depth, …
    pub layers: Vec<(&'static str, Image)>,
    /// Statistics.
    pub stats: RenderStats,
}

/// Renders until the budget is used up or `on_pass` breaks off.
///
/// # Errors
/// [`Error::Usage`] for a scene without pixels.
pub fn render(
    scene: &Scene,
    options: &Options,
    on_pass: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Rendering> {
    if scene.film.crop.2 == 0 || scene.film.crop.3 == 0 {
        return Err(Error::Usage("the film has no pixels".into()));
    }
    let plan = Plan::new(scene, options);
    let mut films: Vec<(&'static str, Film)> = Vec::new();
    let mut picture = Film::new(&scene.film);
    let mut stats = RenderStats { skipped: plan.skipped.clone(), ..RenderStats::default() };
    let start = Instant::now();
    loop {
        let layers = pass(scene, options, &plan, stats.passes, &mut stats);
        if films.is_empty() {
            films = layers.iter().map(|(name, _)| (*name, Film::new(&scene.film))).collect();
        }
        picture.add_pass(&sum_of_parts(&layers));
        for ((_, film), (_, pixels)) in films.iter_mut().zip(&layers) {
            film.add_pass(pixels);
        }
        stats.passes += 1;
        stats.estimated_relative_error = picture.estimated_relative_error();
        let seconds = start.elapsed().as_secs_f64();
        let fraction = match options.budget {
            Budget::Passes(n) => stats.passes as f64 / n.max(1) as f64,
            Budget::Time(limit) => seconds / limit.as_secs_f64().max(1e-9),
            // The error of a mean of n passes falls with √n.
            Budget::Error(goal) if stats.passes > 1 => {
                (goal as f64 / stats.estimated_relative_error.max(1e-30)).powi(2).min(1.0)
            }
            Budget::Error(_) => 0.0,
        };
        let progress = Progress { passes: stats.passes, seconds, fraction: fraction.min(1.0) };
        if on_pass(&progress).is_break() || fraction >= 1.0 {
            break;
        }
    }
    Ok(Rendering {
        image: picture.resolve(),
        layers: films.into_iter().map(|(name, film)| (name, film.resolve())).collect(),
        stats,
    })
}

/// What the render would skip, and why, before anything is traced.
pub fn plan(scene: &Scene, options: &Options) -> Vec<Skipped> {
    Plan::new(scene, options).skipped
}

/// One value per pixel, by layer.
type Layers = Vec<(&'static str, Vec<Rgb>)>;

fn sum_of_parts(layers: &Layers) -> Vec<Rgb> {
    let parts = &layers[..4];
    (0..parts[0].1.len()).map(|i| parts.iter().map(|(_, pixels)| pixels[i]).sum()).collect()
}

/// What a camera sample sees first.
#[derive(Clone, Copy, Default)]
struct Seen {
    albedo: Rgb,
    normal: Vec3,
    depth: f32,
}

/// Renders pass number `index`: the four parts, then what the camera sees first.
fn pass(scene: &Scene, options: &Options, plan: &Plan, index: u32, stats: &mut RenderStats) -> Layers {
    let params = &options.params;
    let maps = (options.integrator == Kind::Photonmap).then(|| {
        let (maps, m) = Maps::new(scene, params, plan, options.seed, index);
        stats.seconds.photons += m.seconds_photons;
        stats.seconds.maps += m.seconds_maps;
        stats.rays += m.rays;
        stats.photons.emitted += m.emitted;
        stats.photons.global_stored += m.global_stored;
        stats.photons.caustic_stored += m.caustic_stored;
        maps
    });
    let start = Instant::now();
    let (x0, y0, width, height) = scene.film.crop;
    let full = Vec2::new(scene.film.size.0 as f32, scene.film.size.1 as f32);
    let filter = scene.film.filter.sampler();
    let rows: Vec<(Vec<(Parts, Seen)>, u64)> = (0..height)
        .into_par_iter()
        .map_init(
            || Scratch::new(params),
            |scratch, y| {
                let mut rays = 0;
                let row = (0..width).map(|x| {
                    let (x, y) = (x0 + x, y0 + y);
                    let pixel = y as u64 * scene.film.size.0 as u64 + x as u64;
                    let mut sampler = Sampler::new(options.seed, Stream::Eye, pixel, index as u64);
                    let position = Vec2::new(x as f32, y as f32) + 0.5 + filter.sample(sampler.next_2d());
                    let ray = scene.camera.ray(position / full, sampler.next_2d());
                    let seen = first_hit(scene, &ray);
                    let parts = match &maps {
                        Some(maps) => {
                            photonmap::radiance(scene, params, maps, ray, &mut sampler, scratch, &mut rays)
                        }
                        None => path::radiance(scene, params, ray, &mut sampler, &mut rays),
                    };
                    (parts, seen)
                });
                (row.collect(), rays)
            },
        )
        .collect();
    stats.rays += rows.iter().map(|(_, rays)| rays).sum::<u64>();
    stats.seconds.eye += start.elapsed().as_secs_f64();

    let pixels = || rows.iter().flat_map(|(row, _)| row);
    let mut layers: Layers = (0..4)
        .map(|i| (Parts::default().named()[i].0, pixels().map(|(parts, _)| parts.named()[i].1).collect()))
        .collect();
    layers.push(("albedo", pixels().map(|(_, seen)| seen.albedo).collect()));
    layers.push(("normal", pixels().map(|(_, seen)| seen.normal).collect()));
    layers.push(("depth", pixels().map(|(_, seen)| Rgb::splat(seen.depth)).collect()));
    layers
}
