//! What render and merge write: the picture or the part, and statistics.

use super::args::{ImageArgs, Verbosity};
use super::info;
use caustica::film::RelativeError;
use caustica::image_io::{self, Channels, Layer, Metadata, SampleType};
use caustica::integrator::{PhotonCounts, Rendering, Skipped, State, Statistics, Survey};
use caustica::{Error, Result};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Format {
    Exr(SampleType),
    Png,
    Part,
}

impl Format {
    /// By the name's extension; an error if `args` ask for what the format cannot do.
    pub(super) fn of(output: &Path, args: &ImageArgs) -> Result<Format> {
        let refuse = |what: &str| Err(Error::Usage(format!("'{}': {what}", output.display())));
        match extension(output).as_str() {
            "exr" if args.exposure != 0.0 => {
                refuse("--exposure is for PNG; an EXR holds the values as they are")
            }
            "exr" => Ok(Format::Exr(if args.half { SampleType::Half } else { SampleType::Float })),
            "png" if args.half => refuse("a PNG has no floats for --half; write an .exr"),
            "png" => Ok(Format::Png),
            "part" if args.half || args.exposure != 0.0 => {
                refuse("a part holds exact sums; --half and --exposure are for 'caustica merge' to an image")
            }
            "part" => Ok(Format::Part),
            _ => refuse("the output's name must end in .exr or .png (or .part, for parts)"),
        }
    }
}

pub(super) fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

/// Where the passes of an image come from.
pub(super) struct Origin {
    pub(super) scene: String,
    pub(super) integrator: String,
    pub(super) backend: String,
    pub(super) seed: u64,
}

/// Writes a picture to the EXR or PNG `output`.
pub(super) fn write_image(
    output: &Path,
    format: Format,
    exposure: f32,
    rendering: Rendering,
    origin: &Origin,
    passes: u32,
) -> Result<()> {
    let Format::Exr(samples) = format else {
        return image_io::write_png(output, &rendering.image, exposure);
    };
    let mut layers = vec![Layer { name: String::new(), image: rendering.image, channels: Channels::Rgb }];
    layers.extend(rendering.layers);
    let command: Vec<_> = std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect();
    let attributes = [
        ("software", format!("caustica {}", env!("CARGO_PKG_VERSION"))),
        ("scene", origin.scene.clone()),
        ("integrator", origin.integrator.clone()),
        ("seed", origin.seed.to_string()),
        ("passes", passes.to_string()),
        ("command", command.join(" ")),
    ];
    let metadata = Metadata { attributes: attributes.map(|(k, v)| (k.into(), v)).into() };
    image_io::write_exr(output, &layers, &metadata, samples)
}

/// What `--stats` writes. Keys are a contract: they may be added, never renamed.
#[derive(Serialize)]
pub(super) struct Stats<'a> {
    version: &'static str,
    scene: &'a str,
    integrator: &'a str,
    backend: &'a str,
    threads: usize,
    seed: u64,
    width: usize,
    height: usize,
    first_pass: u32,
    pub(super) passes: u32,
    interrupted: bool,
    seconds: StatsSeconds,
    rays: u64,
    rays_per_second: f64,
    photons: PhotonCounts,
    skipped: &'a [Skipped],
    dropped: u64,
    /// Gives `lights`, `lights_left_out`, `casters`, `casters_left_out`.
    #[serde(flatten)]
    survey: &'a Survey,
    estimated_relative_error: f64,
    estimated_noise: f64,
    estimated_bias: f64,
    peak_rss_bytes: u64,
}

/// Wall time by stage. `load` and `build` are this run's; the others add up over all runs that took part, and `total`
/// is this run from its start plus the rendering of the others.
#[derive(Serialize)]
struct StatsSeconds {
    load: f64,
    build: f64,
    photons: f64,
    maps: f64,
    eye: f64,
    total: f64,
}

/// The running program, as far as statistics tell of it.
pub(super) struct Run {
    pub(super) start: Instant,
    /// Seconds to load and to build.
    pub(super) seconds: (f64, f64),
    /// Seconds of rendering that other runs have done.
    pub(super) earlier: f64,
    pub(super) interrupted: bool,
}

impl<'a> Stats<'a> {
    pub(super) fn new(origin: &'a Origin, run: &Run, state: &'a State, rendering: &Rendering) -> Stats<'a> {
        let Statistics { seconds, rays, photons, skipped, dropped, survey } = &state.statistics;
        let (load, build) = run.seconds;
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: &origin.scene,
            integrator: &origin.integrator,
            backend: &origin.backend,
            threads: rayon::current_num_threads(),
            seed: origin.seed,
            width: rendering.image.width,
            height: rendering.image.height,
            first_pass: state.range().start,
            passes: state.range().len() as u32,
            interrupted: run.interrupted,
            seconds: StatsSeconds {
                load,
                build,
                photons: seconds.photons,
                maps: seconds.maps,
                eye: seconds.eye,
                total: run.earlier + run.start.elapsed().as_secs_f64(),
            },
            rays: *rays,
            rays_per_second: *rays as f64 / seconds.rendering.max(1e-9),
            photons: *photons,
            skipped,
            dropped: *dropped,
            survey,
            estimated_relative_error: rendering.error.total(),
            estimated_noise: rendering.error.noise,
            estimated_bias: rendering.error.bias,
            peak_rss_bytes: info::peak_rss_bytes(),
        }
    }

    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let mut json = serde_json::to_vec_pretty(self)
            .map_err(|e| Error::Runtime(format!("cannot write '{}': {e}", path.display())))?;
        json.push(b'\n');
        image_io::replace_file(path, |w| std::io::Write::write_all(w, &json))
    }

    pub(super) fn report(&self, verbosity: &Verbosity, output: &Path) {
        let s = &self.seconds;
        verbosity.detail(&format!(
            "seconds: load {:.2}, build {:.2}, photons {:.2}, maps {:.2}, eye {:.2}, total {:.2}",
            s.load, s.build, s.photons, s.maps, s.eye, s.total
        ));
        verbosity.detail(&format!(
            "photons: {} emitted, {} in the global map, {} in the caustic map; {} rays, {:.1} M/s; {} MiB",
            self.photons.emitted,
            self.photons.global_stored,
            self.photons.caustic_stored,
            self.rays,
            self.rays_per_second * 1e-6,
            self.peak_rss_bytes >> 20
        ));
        if self.dropped > 0 {
            let n = self.dropped;
            verbosity.note(
                "warning: ",
                &format!(
                    "{n} contributions of camera samples or photons came to no finite number and were left out; please report the scene"
                ),
            );
        }
        let error = RelativeError { noise: self.estimated_noise, bias: self.estimated_bias };
        // Passes of one half only tell nothing.
        let error = if error.total() > 0.0 { format!(", {}", error_text(&error)) } else { String::new() };
        let passes = if self.passes == 1 { "pass" } else { "passes" };
        let from = if self.first_pass == 0 { String::new() } else { format!(" from {}", self.first_pass) };
        let interrupted = if self.interrupted { ", interrupted" } else { "" };
        verbosity.note(
            "",
            &format!(
                "{}: {} {passes}{from}, {:.1} s{error}{interrupted}",
                output.display(),
                self.passes,
                s.total
            ),
        );
    }
}

pub(super) fn error_text(error: &RelativeError) -> String {
    let percent = |e: f64| 100.0 * e;
    format!(
        "error about {:.2} % (noise {:.2} %, bias {:.2} %)",
        percent(error.total()),
        percent(error.noise),
        percent(error.bias)
    )
}
