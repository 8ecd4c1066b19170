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
use crate::math::{Ray, Rgb, Sampler, Stream};
use crate::scene::{Scene, Surface};
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use photonmap::{Eye, Maps, Scratch};
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

impl Kind {
    /// The name on the command line and in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Photonmap => "photonmap",
            Kind::Path => "path",
        }
    }
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
    /// Whether to keep the parts and auxiliary layers, too.
    pub aovs: bool,
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
    /// With [`Options::aovs`]: direct, specular, caustic, indirect (their sum is the picture), albedo, normal, depth.
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
    let (_, _, width, height) = scene.film.crop;
    if width == 0 || height == 0 {
        return Err(Error::Usage("the film has no pixels".into()));
    }
    let plan = Plan::new(scene, options);
    let film = || Film::new(&scene.film);
    let mut picture = film();
    let mut layers: Vec<(Aov, Film)> =
        AOVS.iter().filter(|_| options.aovs).map(|&aov| (aov, film())).collect();
    let mut stats = RenderStats { skipped: plan.skipped.clone(), ..RenderStats::default() };
    let start = Instant::now();
    loop {
        let samples = pass(scene, options, &plan, stats.passes, &mut stats);
        let samples = || samples.iter().flatten();
        picture.add_pass(samples().map(|sample| sample.parts.sum()));
        for ((_, value), film) in &mut layers {
            film.add_pass(samples().map(value));
        }
        stats.passes += 1;
        stats.estimated_relative_error = picture.estimated_relative_error();
        let seconds = start.elapsed().as_secs_f64();
        let fraction = match options.budget {
            Budget::Passes(n) => stats.passes as f64 / n.max(1) as f64,
            Budget::Time(limit) => seconds / limit.as_secs_f64().max(1e-9),
            Budget::Error(_) if stats.passes < 2 => 0.0,
            // The error of a mean of n passes falls with √n.
            Budget::Error(goal) => (goal as f64 / stats.estimated_relative_error.max(1e-30)).powi(2),
        };
        let progress = Progress { passes: stats.passes, seconds, fraction: fraction.min(1.0) };
        if on_pass(&progress).is_break() || fraction >= 1.0 {
            break;
        }
    }
    Ok(Rendering {
        image: picture.resolve(),
        layers: layers.into_iter().map(|((name, _), film)| (name, film.resolve())).collect(),
        stats,
    })
}

/// What the render would skip, and why, before anything is traced.
pub fn plan(scene: &Scene, options: &Options) -> Vec<Skipped> {
    Plan::new(scene, options).skipped
}

/// A photon of the first pass, for looking at it.
#[derive(Clone, Copy, Debug)]
pub struct PhotonRecord {
    /// Where it landed.
    pub p: Vec3,
    /// Direction of its flight, unit length.
    pub d: Vec3,
    /// Flux, W.
    pub flux: Rgb,
    /// Whether it belongs to the caustic map.
    pub caustic: bool,
}

/// The photons that the first pass stores.
pub fn photon_records(scene: &Scene, options: &Options) -> Vec<PhotonRecord> {
    let plan = Plan::new(scene, options);
    photonmap::photons(scene, &options.params, &plan, options.seed)
        .into_iter()
        .map(|(photon, caustic)| PhotonRecord { p: photon.p, d: -photon.wi, flux: photon.flux, caustic })
        .collect()
}

/// One camera sample.
#[derive(Clone, Copy, Default)]
struct Sample {
    parts: Parts,
    seen: Seen,
}

/// What a camera sample sees first; zero where it sees nothing.
#[derive(Clone, Copy, Default)]
struct Seen {
    albedo: Rgb,
    normal: Vec3,
    depth: f32,
}

impl Seen {
    fn new(s: &Surface, ray: &Ray) -> Seen {
        Seen { albedo: s.bsdf.albedo(), normal: s.frame.n, depth: (s.p - ray.o).length() }
    }
}

/// An auxiliary layer: its name and how it is made of a sample.
type Aov = (&'static str, fn(&Sample) -> Rgb);

const AOVS: [Aov; 7] = [
    ("direct", |sample| sample.parts.direct),
    ("specular", |sample| sample.parts.specular),
    ("caustic", |sample| sample.parts.caustic),
    ("indirect", |sample| sample.parts.indirect),
    ("albedo", |sample| sample.seen.albedo),
    ("normal", |sample| sample.seen.normal),
    ("depth", |sample| Rgb::splat(sample.seen.depth)),
];

/// Renders pass number `index`, row by row.
fn pass(
    scene: &Scene,
    options: &Options,
    plan: &Plan,
    index: u32,
    stats: &mut RenderStats,
) -> Vec<Vec<Sample>> {
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
    let filter = scene.film.filter;
    let rows: Vec<(Vec<Sample>, u64)> = (y0..y0 + height)
        .into_par_iter()
        .map_init(
            || Scratch::new(params),
            |scratch, y| {
                let mut rays = 0;
                let row = (x0..x0 + width).map(|x| {
                    let pixel = y as u64 * scene.film.size.0 as u64 + x as u64;
                    let mut sampler = Sampler::new(options.seed, Stream::Eye, pixel, index as u64);
                    let position = Vec2::new(x as f32, y as f32) + 0.5 + filter.sample(sampler.next_2d());
                    let ray = scene.camera.ray(position / full, sampler.next_2d());
                    let mut seen = Seen::default();
                    let parts = match &maps {
                        Some(maps) => {
                            let eye = Eye { scene, params, maps };
                            eye.radiance(ray, &mut sampler, scratch, &mut seen, &mut rays)
                        }
                        None => path::radiance(scene, params, ray, &mut sampler, &mut seen, &mut rays),
                    };
                    Sample { parts, seen }
                });
                (row.collect(), rays)
            },
        )
        .collect();
    stats.seconds.eye += start.elapsed().as_secs_f64();
    rows.into_iter()
        .map(|(row, rays)| {
            stats.rays += rays;
            row
        })
        .collect()
}
