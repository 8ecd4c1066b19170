//! A render as far as it has come: the sums of a range of passes. It can be kept, taken up again, and merged with the
//! next range.

use super::eye::Eye;
use super::maps::{Maps, Scratch};
use super::plan::Plan;
use super::{Budget, Kind, Options, Seen, Survey, guides, path};
use crate::film::{self, Film, RelativeError, Rest, Values};
use crate::image_io::{Channels, Image, Layer};
use crate::math::{Rgb, Sampler, Stream};
use crate::scene::Scene;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::ops::{AddAssign, ControlFlow, Range};
use std::time::{Duration, Instant};

/// A stage that the scene does not need.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Skipped {
    /// Its name, e.g. `caustic map`.
    pub stage: String,
    /// Why.
    pub reason: String,
}

/// Seconds spent, by stage, wall time.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Seconds {
    /// Emitting and tracing photons.
    pub photons: f64,
    /// Building maps.
    pub maps: f64,
    /// Camera paths.
    pub eye: f64,
    /// All of rendering.
    pub rendering: f64,
}

/// Counts of photons over all passes.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct PhotonCounts {
    /// Photons emitted.
    pub emitted: u64,
    /// Records stored in the global map.
    pub global_stored: u64,
    /// Records stored in the caustic map.
    pub caustic_stored: u64,
}

/// What rendering the passes took.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Statistics {
    /// Seconds by stage.
    pub seconds: Seconds,
    /// Rays traced, shadow rays included.
    pub rays: u64,
    /// Photons.
    pub photons: PhotonCounts,
    /// Stages that were not needed.
    pub skipped: Vec<Skipped>,
    /// Camera samples and photons that were left out because they came to no finite number.
    #[serde(default)]
    pub dropped: u64,
    /// What photons sent ahead tell of lights and of what casts caustics.
    #[serde(default)]
    pub survey: Survey,
}

impl AddAssign<&Statistics> for Statistics {
    fn add_assign(&mut self, o: &Statistics) {
        self.seconds.photons += o.seconds.photons;
        self.seconds.maps += o.seconds.maps;
        self.seconds.eye += o.seconds.eye;
        self.seconds.rendering += o.seconds.rendering;
        // Files may claim anything.
        let add = |count: &mut u64, more: u64| *count = count.saturating_add(more);
        add(&mut self.rays, o.rays);
        add(&mut self.photons.emitted, o.photons.emitted);
        add(&mut self.photons.global_stored, o.photons.global_stored);
        add(&mut self.photons.caustic_stored, o.photons.caustic_stored);
        add(&mut self.dropped, o.dropped);
    }
}

/// How far a render is, told after each pass.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Finished passes.
    pub passes: u32,
    /// Seconds since rendering began or was taken up again.
    pub seconds: f64,
    /// Share of the budget that is used, 0 to 1.
    pub fraction: f64,
    /// Estimated error when it was last looked at.
    pub error: Option<RelativeError>,
}

/// The picture that a render shows.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The picture.
    pub image: Image,
    /// With [`Options::aovs`]: direct, specular, caustic, indirect (their sum is the picture), albedo, normal, depth,
    /// photon density, and the estimated noise and bias.
    pub layers: Vec<Layer>,
    /// Estimated error; zero with fewer than two passes.
    pub error: RelativeError,
}

/// What the sums of a render are laid out for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// Columns and rows of the film.
    pub size: (u32, u32),
    /// Whether the picture is kept at two levels.
    pub fine: bool,
    /// Whether there are layers for [`Options::aovs`].
    pub aovs: bool,
    /// Whether pixels learn from their neighbours.
    pub guided: bool,
}

impl Layout {
    /// What passes of `scene` are laid out for.
    pub fn new(scene: &Scene, options: &Options) -> Layout {
        Layout::of(scene, options, &Plan::new(scene, options))
    }

    fn of(scene: &Scene, options: &Options, plan: &Plan) -> Layout {
        let (_, _, width, height) = scene.film.crop;
        Layout {
            size: (width, height),
            fine: plan.has_photons(),
            aovs: options.aovs,
            guided: options.integrator == Kind::Photonmap && options.params.regression,
        }
    }

    fn layers(self) -> usize {
        if self.aovs { layer::COUNT } else { 0 }
    }

    /// How many bytes the sums take.
    pub fn bytes(self) -> u64 {
        Film::contents_size(self.size, self.fine, self.layers(), self.guided)
    }
}

/// The sums of passes `first..first + passes`, and what they took.
#[derive(Clone, Debug)]
pub struct State {
    first: u32,
    film: Film,
    layout: Layout,
    /// What it took.
    pub statistics: Statistics,
}

/// The film's layers with [`Options::aovs`]. Those that photon maps take part in have two levels, as the picture has.
mod layer {
    pub(super) const DIRECT: usize = 0;
    pub(super) const SPECULAR: [usize; 2] = [1, 2];
    pub(super) const CAUSTIC: [usize; 2] = [3, 4];
    pub(super) const INDIRECT: [usize; 2] = [5, 6];
    pub(super) const ALBEDO: usize = 7;
    pub(super) const NORMAL: usize = 8;
    /// Depth and photon density.
    pub(super) const SCALARS: usize = 9;
    pub(super) const COUNT: usize = 10;
}

impl State {
    /// Nothing yet; the first pass will be number `first`.
    ///
    /// # Errors
    /// [`Error::Usage`] for a scene without pixels.
    pub fn new(scene: &Scene, options: &Options, first: u32) -> Result<State> {
        let (_, _, width, height) = scene.film.crop;
        if width == 0 || height == 0 {
            return Err(Error::Usage("the film has no pixels".into()));
        }
        let plan = Plan::new(scene, options);
        let mut state = State::empty(Layout::of(scene, options, &plan), first);
        if state.layout.guided {
            let start = Instant::now();
            let (guides, rays) = guides::guides(scene, options, &plan);
            state.film.set_guides(guides);
            // Every part needs them, but together they are one render.
            if first == 0 {
                state.statistics.rays += rays;
                state.statistics.seconds.eye += start.elapsed().as_secs_f64();
            }
        }
        state.statistics.skipped = plan.skipped;
        Ok(state)
    }

    /// A state without passes, to put back into it what was kept of another by [`State::film`].
    pub fn empty(layout: Layout, first: u32) -> State {
        let film = Film::new(layout.size, layout.fine, layout.layers(), layout.guided);
        State { first, film, layout, statistics: Statistics::default() }
    }

    /// What its sums are laid out for.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Its sums.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Its sums, to be replaced.
    pub fn film_mut(&mut self) -> &mut Film {
        &mut self.film
    }

    /// The passes that it holds.
    pub fn range(&self) -> Range<u32> {
        self.first..self.first + self.film.passes()
    }

    /// Renders passes until the budget is used up or `on_pass` breaks off.
    pub fn render(
        &mut self,
        scene: &Scene,
        options: &Options,
        on_pass: &mut dyn FnMut(&Progress, &State) -> ControlFlow<()>,
    ) {
        let mut plan = Plan::new(scene, options);
        let earlier = self.statistics.seconds.rendering;
        let start = Instant::now();
        plan.learn(scene, &options.params);
        self.statistics.survey = plan.survey.clone();
        self.statistics.skipped.clone_from(&plan.skipped);
        // The estimate costs more than a small pass. Where it decides, it is made at passes whose numbers grow
        // geometrically; else it is for looking at, and takes a small share of the time.
        let decides = matches!(options.budget, Budget::Error(_));
        let mut next_estimate = if decides { MIN_PASSES } else { u32::MAX };
        let mut next_look = start + FIRST_LOOK;
        let mut passes = self.film.passes();
        let after = |passes: u32| passes.saturating_add(1).max((passes as f64 * 1.2) as u32);
        // A render that is taken up again makes its estimates where it would have made them without the break.
        while decides && next_estimate < passes {
            next_estimate = after(next_estimate);
        }
        let mut error = None;
        if passes == next_estimate {
            error = Some(self.film.resolve().error);
            next_estimate = after(passes);
        }
        loop {
            let used = |passes: u32, seconds: f64, error: Option<RelativeError>| match (options.budget, error)
            {
                (Budget::Passes(n), _) => passes as f64 / n.max(1) as f64,
                (Budget::Time(limit), _) => seconds / limit.as_secs_f64().max(1e-9),
                // The error of a mean of n passes falls with √n.
                (Budget::Error(goal), Some(e)) => (goal as f64 / e.total().max(1e-30)).powi(2),
                (Budget::Error(_), None) => 0.0,
            };
            if passes > 0 && used(passes, start.elapsed().as_secs_f64(), error) >= 1.0 {
                break;
            }
            self.add_pass(scene, options, &plan);
            passes += 1;
            if passes >= next_estimate {
                error = Some(self.film.resolve().error);
                next_estimate = after(passes);
            } else if !decides && passes > 1 && Instant::now() > next_look {
                let look = Instant::now();
                error = Some(self.film.resolve().error);
                next_look = Instant::now() + look.elapsed() * LOOK_EVERY + FIRST_LOOK;
            }
            let seconds = start.elapsed().as_secs_f64();
            self.statistics.seconds.rendering = earlier + seconds;
            let fraction = used(passes, seconds, error).min(1.0);
            if on_pass(&Progress { passes, seconds, fraction, error }, self).is_break() {
                break;
            }
        }
    }

    /// Takes in `next`, which goes on where this state ends.
    ///
    /// # Errors
    /// [`Error::Usage`] if it does not, or if its sums are laid out in another way.
    pub fn merge(&mut self, next: &State) -> Result<()> {
        let (own, next_range) = (self.range(), next.range());
        if own.end != next_range.start {
            return Err(Error::Usage(format!("passes {own:?} and {next_range:?} do not follow each other")));
        }
        if self.layout != next.layout {
            return Err(Error::Usage("sums that are laid out in different ways cannot be added".into()));
        }
        self.film.merge(&next.film);
        self.statistics += &next.statistics;
        Ok(())
    }

    /// The picture.
    pub fn resolve(&self) -> Rendering {
        let film = &self.film;
        let resolved = film.resolve();
        let mut layers = Vec::new();
        if self.layout.aovs {
            let mixed = |[wide, fine]: [usize; 2], rest| film.layer_of_levels(wide, fine, &resolved, rest);
            let scalars = film.layer(layer::SCALARS);
            let mut add = |name: &str, image, channels| {
                layers.push(Layer { name: name.into(), image, channels });
            };
            add("direct", mixed([layer::DIRECT; 2], Rest::Emitted), Channels::Rgb);
            add("specular", mixed(layer::SPECULAR, Rest::Nothing), Channels::Rgb);
            add("caustic", mixed(layer::CAUSTIC, Rest::Nothing), Channels::Rgb);
            // What only neighbours have seen is indirect light most of the time.
            add("indirect", mixed(layer::INDIRECT, Rest::Reflected), Channels::Rgb);
            add("albedo", film.layer(layer::ALBEDO), Channels::Rgb);
            add("normal", film.layer(layer::NORMAL), Channels::Xyz);
            add("depth", scalars.map(|v| Rgb::splat(v.x)), Channels::Z);
            add("photon_density", scalars.map(|v| Rgb::splat(v.y)), Channels::Y);
            add("noise", resolved.noise, Channels::Rgb);
            add("bias", resolved.bias, Channels::Rgb);
        }
        Rendering { image: resolved.image, layers, error: resolved.error }
    }

    /// Renders the next pass. It depends on nothing but (scene, options without the budget, number of the pass).
    fn add_pass(&mut self, scene: &Scene, options: &Options, plan: &Plan) {
        let (params, index) = (&options.params, self.range().end);
        let stats = &mut self.statistics;
        let mut maps = (options.integrator == Kind::Photonmap).then(|| {
            let (maps, m) = Maps::new(scene, params, plan, options.seed, index);
            stats.seconds.photons += m.seconds_photons;
            stats.seconds.maps += m.seconds_maps;
            stats.rays += m.rays;
            stats.dropped += m.dropped;
            stats.photons.emitted += m.emitted;
            stats.photons.global_stored += m.global_stored;
            stats.photons.caustic_stored += m.caustic_stored;
            maps
        });
        let start = Instant::now();
        let splats = maps.as_mut().map_or(Vec::new(), |maps| std::mem::take(&mut maps.splats));
        let (x0, y0, ..) = scene.film.crop;
        let (traces, effort) = (plan.traces_indirect, plan.effort.as_ref());
        let pixel =
            |x: usize, y: usize, sample: u64, (scratch, counts): &mut (Scratch, Counts), out: &mut Values| {
                let (x, y) = (x0 + x as u32, y0 + y as u32);
                let pixel = y as u64 * scene.film.size.0 as u64 + x as u64;
                let set = 2 * pixel + u64::from(film::half(index));
                let mut sampler = Sampler::new(options.seed, Stream::Eye, set, sample);
                let ray = scene.camera_ray((x, y), &mut sampler);
                let mut seen = Seen::default();
                let rays = &mut counts.rays;
                let mut shown = match &maps {
                    Some(maps) => {
                        let eye = Eye { scene, params, maps, traces, effort, aovs: options.aovs };
                        eye.radiance(ray, &mut sampler, scratch, &mut seen, rays)
                    }
                    None => [path::radiance(scene, params, ray, &mut sampler, &mut seen, rays); 2],
                };
                if !(shown.iter().all(|parts| parts.sum().is_finite()) && seen.emitted.is_finite()) {
                    // Black is off by what one sample brings; no number at all would spoil the pixel for good.
                    counts.dropped += 1;
                    (shown, seen.emitted) = Default::default();
                }
                for (value, parts) in out.picture.iter_mut().zip(&shown) {
                    // Lights seen directly add nothing else, so rounding of the difference goes with a bright pixel.
                    *value = parts.sum() - seen.emitted;
                }
                out.emitted = seen.emitted;
                out.features = seen.features;
                if options.aovs {
                    out.layers[layer::DIRECT] = shown[0].direct;
                    for (level, parts) in shown.iter().enumerate() {
                        out.layers[layer::SPECULAR[level]] = parts.specular;
                        out.layers[layer::CAUSTIC[level]] = parts.caustic;
                        out.layers[layer::INDIRECT[level]] = parts.indirect;
                    }
                    out.layers[layer::ALBEDO] = seen.albedo;
                    out.layers[layer::NORMAL] = seen.normal;
                    out.layers[layer::SCALARS] = Rgb::new(seen.depth, seen.density, 0.0);
                }
            };
        let rows = self.film.add_pass(index, || (Scratch::new(maps.as_ref()), Counts::default()), pixel);
        for (_, counts) in rows {
            stats.rays += counts.rays;
            stats.dropped += counts.dropped;
        }
        let layer = options.aovs.then_some(layer::CAUSTIC[1]);
        for splat in splats {
            self.film.splat(index, splat.pixel as usize, splat.value, layer);
        }
        stats.seconds.eye += start.elapsed().as_secs_f64();
    }
}

/// What is counted along a row of the film.
#[derive(Default)]
struct Counts {
    rays: u64,
    dropped: u64,
}

/// When the error is estimated first where nothing depends on it.
const FIRST_LOOK: Duration = Duration::from_secs(2);

/// Such estimates take one part of so many of the time, at most.
const LOOK_EVERY: u32 = 30;

/// An estimated error says little before.
const MIN_PASSES: u32 = 4;
