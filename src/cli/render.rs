//! `caustica render`.

use super::args::{RenderArgs, Verbosity};
use super::prepare::{Prepared, prepare, with_threads};
use super::{INTERRUPTED, info};
use caustica::film::RelativeError;
use caustica::image_io::{self, Channels, Layer, Metadata, SampleType};
use caustica::integrator::{Budget, PhotonCounts, Progress, Rendering, Skipped, State, Statistics};
use caustica::{Error, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Renders, and returns the exit status.
pub(super) fn run(args: &RenderArgs, start: Instant) -> Result<u8> {
    let output = output_path(args)?;
    let format = Format::of(&output, args)?;
    image_io::check_writable(&output)?;
    if let Some(stats) = &args.stats {
        image_io::check_writable(stats)?;
    }
    with_threads(&args.common, || {
        let mut prepared = prepare(&args.scene, &args.common, args.integrator.map(|i| i.kind()))?;
        prepared.options.aovs = args.aovs;
        prepared.options.budget = match (args.passes, args.time, args.error) {
            (Some(n), _, _) => Budget::Passes(n),
            // The user's clock started with the program.
            (_, Some(time), _) => Budget::Time(time.saturating_sub(start.elapsed())),
            (_, _, Some(relative)) => Budget::Error(relative),
            _ => prepared.options.budget,
        };
        info::print_plan(&prepared, |line| args.common.verbosity.detail(line));

        let interrupted = catch_interrupt()?;
        let mut state = State::new(&prepared.scene, &prepared.options, 0)?;
        trace(&mut state, &prepared, &args.common.verbosity, &interrupted);

        let rendering = state.resolve();
        let interrupted = interrupted.load(Ordering::Relaxed);
        let stats = Stats::new(args, &prepared, &state, &rendering, start, interrupted);
        write(&output, format, rendering, &prepared, args, stats.passes)?;
        if let Some(path) = &args.stats {
            stats.write(path)?;
        }
        report(&args.common.verbosity, &output, &stats);
        Ok(if interrupted { INTERRUPTED } else { 0 })
    })
}

#[derive(Clone, Copy)]
enum Format {
    Exr(SampleType),
    Png,
}

impl Format {
    fn of(output: &Path, args: &RenderArgs) -> Result<Format> {
        let refuse = |what: &str| Err(Error::Usage(format!("'{}': {what}", output.display())));
        match extension(output).as_str() {
            "exr" if args.exposure != 0.0 => {
                refuse("--exposure is for PNG; an EXR holds the values as they are")
            }
            "exr" => Ok(Format::Exr(if args.half { SampleType::Half } else { SampleType::Float })),
            "png" if args.aovs => refuse("a PNG has no layers for --aovs; write an .exr"),
            "png" if args.half => refuse("a PNG has no floats for --half; write an .exr"),
            "png" => Ok(Format::Png),
            _ => refuse("the output's name must end in .exr or .png"),
        }
    }
}

pub(super) fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

fn output_path(args: &RenderArgs) -> Result<PathBuf> {
    match (&args.output, args.scene.file_stem()) {
        (Some(path), _) => Ok(path.clone()),
        (None, Some(stem)) => {
            let mut name = stem.to_os_string();
            name.push(".exr");
            Ok(name.into())
        }
        (None, None) => Err(Error::File {
            file: args.scene.clone(),
            message: "is no scene; give a Mitsuba XML or OBJ file".into(),
        }),
    }
}

/// From here on Ctrl-C asks for an end after the pass; the second one gets it at once.
fn catch_interrupt() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&flag);
    ctrlc::set_handler(move || {
        if seen.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
    })
    .map_err(|e| Error::Runtime(format!("cannot listen to Ctrl-C: {e}")))?;
    Ok(flag)
}

fn trace(state: &mut State, prepared: &Prepared, verbosity: &Verbosity, interrupted: &AtomicBool) {
    const STEPS: u64 = 10_000;
    // indicatif draws nothing where stderr is no terminal.
    let target = if verbosity.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(STEPS), target);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {elapsed}  {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    state.render(&prepared.scene, &prepared.options, &mut |progress, _| {
        bar.set_position((progress.fraction.clamp(0.0, 1.0) * STEPS as f64) as u64);
        let error = progress.error.map_or(String::new(), |e| format!(", {}", error_text(&e)));
        let left = time_left(progress)
            .map_or(String::new(), |left| format!(", {} left", indicatif::HumanDuration(left)));
        bar.set_message(format!("{} passes{error}{left}", progress.passes));
        if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
}

fn error_text(error: &RelativeError) -> String {
    let percent = |e: f64| 100.0 * e;
    format!(
        "error about {:.2} % (noise {:.2} %, bias {:.2} %)",
        percent(error.total()),
        percent(error.noise),
        percent(error.bias)
    )
}

fn time_left(progress: &Progress) -> Option<Duration> {
    let left = progress.seconds * (1.0 / progress.fraction - 1.0);
    Duration::try_from_secs_f64(left.ceil()).ok()
}

fn write(
    output: &Path,
    format: Format,
    rendering: Rendering,
    prepared: &Prepared,
    args: &RenderArgs,
    passes: u32,
) -> Result<()> {
    let samples = match format {
        Format::Png => return image_io::write_png(output, &rendering.image, args.exposure),
        Format::Exr(samples) => samples,
    };
    let mut layers = vec![Layer { name: String::new(), image: rendering.image, channels: Channels::Rgb }];
    layers.extend(rendering.layers);
    let command: Vec<_> = std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect();
    let attributes = [
        ("software", format!("caustica {}", env!("CARGO_PKG_VERSION"))),
        ("scene", args.scene.display().to_string()),
        ("integrator", prepared.options.integrator.name().into()),
        ("seed", prepared.options.seed.to_string()),
        ("passes", passes.to_string()),
        ("command", command.join(" ")),
    ];
    let metadata = Metadata { attributes: attributes.map(|(k, v)| (k.into(), v)).into() };
    image_io::write_exr(output, &layers, &metadata, samples)
}

/// What `--stats` writes. Keys are a contract: they may be added, never renamed.
#[derive(Serialize)]
struct Stats<'a> {
    version: &'static str,
    scene: String,
    integrator: &'static str,
    backend: &'static str,
    threads: usize,
    seed: u64,
    width: usize,
    height: usize,
    passes: u32,
    interrupted: bool,
    seconds: StatsSeconds,
    rays: u64,
    rays_per_second: f64,
    photons: PhotonCounts,
    skipped: &'a [Skipped],
    estimated_relative_error: f64,
    estimated_noise: f64,
    estimated_bias: f64,
    peak_rss_bytes: u64,
}

/// Wall time by stage; `total` is from the program's start to the end of writing the image.
#[derive(Serialize)]
struct StatsSeconds {
    load: f64,
    build: f64,
    photons: f64,
    maps: f64,
    eye: f64,
    total: f64,
}

impl<'a> Stats<'a> {
    fn new(
        args: &RenderArgs,
        prepared: &Prepared,
        state: &'a State,
        rendering: &Rendering,
        start: Instant,
        interrupted: bool,
    ) -> Stats<'a> {
        let Statistics { seconds, rays, photons, skipped } = &state.statistics;
        let (load, build) = prepared.seconds;
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: args.scene.display().to_string(),
            integrator: prepared.options.integrator.name(),
            backend: prepared.backend.name(),
            threads: rayon::current_num_threads(),
            seed: prepared.options.seed,
            width: rendering.image.width,
            height: rendering.image.height,
            passes: state.range().len() as u32,
            interrupted,
            seconds: StatsSeconds {
                load,
                build,
                photons: seconds.photons,
                maps: seconds.maps,
                eye: seconds.eye,
                total: start.elapsed().as_secs_f64(),
            },
            rays: *rays,
            rays_per_second: *rays as f64 / seconds.rendering.max(1e-9),
            photons: *photons,
            skipped,
            estimated_relative_error: rendering.error.total(),
            estimated_noise: rendering.error.noise,
            estimated_bias: rendering.error.bias,
            peak_rss_bytes: info::peak_rss_bytes(),
        }
    }

    fn write(&self, path: &Path) -> Result<()> {
        let mut json = serde_json::to_vec_pretty(self)
            .map_err(|e| Error::Runtime(format!("cannot write '{}': {e}", path.display())))?;
        json.push(b'\n');
        image_io::replace_file(path, |w| std::io::Write::write_all(w, &json))
    }
}

fn report(verbosity: &Verbosity, output: &Path, stats: &Stats) {
    let s = &stats.seconds;
    verbosity.detail(&format!(
        "seconds: load {:.2}, build {:.2}, photons {:.2}, maps {:.2}, eye {:.2}, total {:.2}",
        s.load, s.build, s.photons, s.maps, s.eye, s.total
    ));
    verbosity.detail(&format!(
        "photons: {} emitted, {} in the global map, {} in the caustic map; {} rays, {:.1} M/s; {} MiB",
        stats.photons.emitted,
        stats.photons.global_stored,
        stats.photons.caustic_stored,
        stats.rays,
        stats.rays_per_second * 1e-6,
        stats.peak_rss_bytes >> 20
    ));
    let error = RelativeError { noise: stats.estimated_noise, bias: stats.estimated_bias };
    let error = match stats.passes {
        0 | 1 => String::new(),
        _ => format!(", {}", error_text(&error)),
    };
    let passes = if stats.passes == 1 { "pass" } else { "passes" };
    let interrupted = if stats.interrupted { ", interrupted" } else { "" };
    let message =
        format!("{}: {} {passes}, {:.1} s{error}{interrupted}", output.display(), stats.passes, s.total);
    verbosity.note("", &message);
}
