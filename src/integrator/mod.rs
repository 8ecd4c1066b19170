//! Integrators: a render is a sum of independent passes, and pass i depends only on (scene, seed, i).

mod direct;
mod effort;
mod eye;
mod guides;
mod indirect;
mod maps;
mod params;
mod parts;
mod path;
mod plan;
mod state;
mod survey;

pub use params::{DirectLight, IndirectLight, Params};
pub use parts::Parts;
pub use state::{Layout, PhotonCounts, Progress, Rendering, Seconds, Skipped, State, Statistics};
pub use survey::{CasterSurvey, LightSurvey, Survey};

use crate::film::Features;
use crate::math::{Ray, Rgb, luminance};
use crate::scene::{Scene, Surface};
use glam::Vec3;
use plan::Plan;
use std::time::Duration;

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

/// When to stop. A first pass is always finished.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// With so many passes in all.
    Passes(u32),
    /// When so much time has gone, counted from where rendering begins or is taken up again.
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

/// The photons that the first pass stores, those of the global map also where indirect light is not taken from it.
pub fn photon_records(scene: &Scene, options: &Options) -> Vec<PhotonRecord> {
    let mut plan = Plan::new(scene, options);
    let params = Params { indirect: IndirectLight::Map, ..options.params.clone() };
    plan.learn(scene, &params);
    maps::photons(scene, &params, &plan, options.seed)
        .into_iter()
        .map(|(photon, caustic)| PhotonRecord { p: photon.p, d: -photon.wi, flux: photon.flux, caustic })
        .collect()
}

/// What a camera sample sees first; zero where it sees nothing.
#[derive(Clone, Copy, Default)]
struct Seen {
    albedo: Rgb,
    normal: Vec3,
    depth: f32,
    /// Photons per area, in the maps of the pass.
    density: f32,
    /// What of the sample's radiance lights send to the camera themselves, by delta lobes at most.
    emitted: Rgb,
    /// Whether it has met a smooth interface.
    smooth: bool,
    /// What it sees first through whatever is sharp.
    features: Features,
}

impl Seen {
    /// Takes down the first surface, seen from `eye`.
    fn set_first(&mut self, s: &Surface, eye: Vec3) {
        self.albedo = s.bsdf.albedo();
        self.normal = s.frame.n;
        self.depth = (s.p - eye).length();
    }

    /// Adds `s` to the features with `weight`.
    fn add_surface(&mut self, weight: Rgb, s: &Surface, scene: &Scene) {
        let w = luminance(weight);
        self.features.albedo += weight * s.bsdf.albedo();
        self.features.normal += w * s.frame.n;
        self.features.position += w * scene.bounds.relative(s.p);
    }

    /// Adds what lies behind the scene along `ray` to the features with `weight`.
    fn add_background(&mut self, weight: Rgb, ray: &Ray, scene: &Scene) {
        let w = luminance(weight);
        self.features.albedo += weight;
        self.features.normal -= w * ray.d;
        self.features.position += w * (scene.bounds.relative(ray.o).clamp_length_max(1.0) + ray.d);
    }
}
