//! Integrators: a render is a sum of independent passes, and pass i depends only on (scene, seed, i).

mod params;

pub use params::{Kernel, Params};

use crate::image_io::Image;
use crate::scene::Scene;
use crate::{Error, Result};
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::Duration;

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
/// [`Error::Usage`] for parameters out of range, [`Error::Runtime`] if the render fails.
pub fn render(
    scene: &Scene,
    options: &Options,
    on_pass: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Rendering> {
    let _ = (scene, options, on_pass);
    Err(Error::Runtime("no integrator yet".into()))
}

/// What the render would skip, and why, before anything is traced.
pub fn plan(scene: &Scene, options: &Options) -> Vec<Skipped> {
    let _ = (scene, options);
    Vec::new()
}

/// A photon as it is stored in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonRecord {
    /// Where it is stored.
    pub p: glam::Vec3,
    /// Its direction of flight, unit length.
    pub d: glam::Vec3,
    /// Its flux in W.
    pub flux: crate::math::Rgb,
    /// Whether it belongs to the caustic map.
    pub caustic: bool,
}

/// The photons that the first pass stores, of both maps.
///
/// # Errors
/// As [`render`].
pub fn photon_records(scene: &Scene, options: &Options) -> Result<Vec<PhotonRecord>> {
    let _ = (scene, options);
    Err(Error::Runtime("no integrator yet".into()))
}
