//! The command line's grammar. What it accepts is a contract: scripts depend on it.

use caustica::accel::{self, Backend};
use caustica::image_io::MAX_PIXELS;
use caustica::integrator::Kind;
use caustica::part_file::MAX_PASSES;
use clap::builder::styling::Styles;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

/// A photon-mapping renderer for Mitsuba 3 scenes.
#[derive(Parser, Debug)]
#[command(name = "caustica", version, styles = Styles::plain(), max_term_width = 100)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Subcommand, Debug)]
pub(super) enum Command {
    /// Render a scene to an image.
    Render(RenderArgs),
    /// Add up part files (of --pass-range, or checkpoints) to an image or to a larger part.
    Merge(MergeArgs),
    /// Compare an image with a reference: rmse, relmse, mae, bias per channel, psnr, flip.
    Compare(CompareArgs),
    /// Measure run time against error, of integrators, backends and other renderers, and report it on a page.
    Bench(BenchArgs),
    /// Write the photons that the first pass stores: as points (PLY), or as the camera sees them (PNG).
    Photons(PhotonsArgs),
    /// Show version, backends and CPU; of a scene, what it holds and what rendering it takes.
    Info(InfoArgs),
}

#[derive(Args, Clone, Debug)]
pub(super) struct Verbosity {
    /// Print the plan, the stages' times and what is ignored.
    #[arg(short, long, conflicts_with = "quiet")]
    pub(super) verbose: bool,
    /// Print errors only.
    #[arg(short, long)]
    pub(super) quiet: bool,
}

/// How a scene is loaded and made ready.
#[derive(Args, Clone, Debug)]
pub(super) struct SceneArgs {
    /// Replace $NAME in the scene by VALUE.
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = assignment)]
    pub(super) define: Vec<(String, String)>,
    /// Who traces the rays [default: the first that `info` lists].
    #[arg(long, value_enum)]
    pub(super) backend: Option<BackendName>,
    /// Number of threads [default: one per CPU]. The image does not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Names the random numbers: equal seeds give equal images.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(super) seed: u64,
    /// Size of the film in pixels, instead of the scene's.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(super) size: Option<(u32, u32)>,
    /// Set a parameter of the integrator; goes before the scene's value.
    #[arg(long = "set", value_name = "PARAM=VALUE", value_parser = assignment)]
    pub(super) set: Vec<(String, String)>,
    #[command(flatten)]
    pub(super) verbosity: Verbosity,
}

#[derive(Args, Debug)]
pub(super) struct RenderArgs {
    /// The scene: Mitsuba XML or OBJ.
    pub(super) scene: PathBuf,
    /// The image, OpenEXR or PNG by its extension [default: the scene's name with .exr, in this directory]; a .part
    /// with --pass-range.
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    pub(super) output: Option<PathBuf>,
    /// Integrator to render with [default: photonmap].
    #[arg(long, value_enum)]
    pub(super) integrator: Option<IntegratorName>,
    /// Render so many passes of one sample per pixel [default: the scene's sample_count].
    #[arg(long, value_name = "N", group = "budget", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) passes: Option<u32>,
    /// Stop after so many seconds, counted from the program's start. The first pass is always finished.
    #[arg(long, value_name = "SECONDS", group = "budget", value_parser = seconds)]
    pub(super) time: Option<Duration>,
    /// Stop when the estimated relative error is at most REL, e.g. 0.02.
    #[arg(long, value_name = "REL", group = "budget", value_parser = positive)]
    pub(super) error: Option<f32>,
    /// Write the parts of the picture (direct, specular, caustic, indirect), albedo, normal, depth and more as layers.
    #[arg(long)]
    pub(super) aovs: bool,
    #[command(flatten)]
    pub(super) image: ImageArgs,
    /// Write all that was rendered to FILE now and then, for --resume or merge.
    #[arg(long, value_name = "FILE")]
    pub(super) checkpoint: Option<PathBuf>,
    /// Seconds between checkpoints.
    #[arg(long, value_name = "SECONDS", default_value = "60", requires = "checkpoint", value_parser = seconds)]
    pub(super) checkpoint_interval: Duration,
    /// Go on where the checkpoint or part in FILE ends. --passes is the number in all, --time counts anew.
    #[arg(long, value_name = "FILE")]
    pub(super) resume: Option<PathBuf>,
    /// Render passes A to B-1 only, into a part file that merge adds to others.
    #[arg(long, value_name = "A..B", group = "budget", value_parser = pass_range)]
    pub(super) pass_range: Option<Range<u32>>,
    #[command(flatten)]
    pub(super) common: SceneArgs,
}

/// How an image is written.
#[derive(Args, Debug)]
pub(super) struct ImageArgs {
    /// Write 16-bit instead of 32-bit floats to the EXR.
    #[arg(long)]
    pub(super) half: bool,
    /// Brighten a PNG by EV stops.
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(super) exposure: f32,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE.json")]
    pub(super) stats: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(super) struct MergeArgs {
    /// The part files, in any order.
    #[arg(required = true, value_name = "PART")]
    pub(super) parts: Vec<PathBuf>,
    /// The image, or the larger part, by its extension.
    #[arg(short, long, value_name = "OUT.exr|OUT.png|OUT.part")]
    pub(super) output: PathBuf,
    #[command(flatten)]
    pub(super) image: ImageArgs,
    #[command(flatten)]
    pub(super) verbosity: Verbosity,
}

#[derive(Args, Debug)]
pub(super) struct CompareArgs {
    /// The image to judge.
    pub(super) image: PathBuf,
    /// What it should look like.
    pub(super) reference: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Args, Debug)]
pub(super) struct BenchArgs {
    /// The scenes: Mitsuba XML or OBJ.
    #[arg(required = true, value_name = "SCENE")]
    pub(super) scenes: Vec<PathBuf>,
    /// Directory for results.csv, run.json, index.html, plots/ and images/.
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: PathBuf,
    /// Length of a run. Errors are taken then, and at its halves, quarters and so on to a 64th.
    #[arg(long, value_name = "SECONDS", default_value = "16", value_parser = seconds)]
    pub(super) time: Duration,
    /// Runs of each kind, each with a seed of its own.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) repeats: u32,
    /// Render with this integrator only [default: all].
    #[arg(long, value_enum)]
    pub(super) integrator: Option<IntegratorName>,
    /// Reference images: a directory that holds SCENE.exr for each scene, or the image of the only scene [default: computed
    /// by the path tracer, and kept in DIR].
    #[arg(long, value_name = "DIR|IMAGE")]
    pub(super) reference: Option<PathBuf>,
    /// Passes of a computed reference.
    #[arg(long, value_name = "N", default_value_t = 16384, value_parser = clap::value_parser!(u32).range(2..), conflicts_with = "reference")]
    pub(super) reference_passes: u32,
    /// The relmse of a given reference itself, by scene; it is taken off. May be repeated.
    #[arg(long, value_name = "SCENE=RELMSE", value_parser = named_error, requires = "reference")]
    pub(super) reference_noise: Vec<(String, f64)>,
    /// Also measure the renderer that COMMAND runs, see bench/peers/README.md. May be repeated.
    #[arg(long = "peer", value_name = "COMMAND")]
    pub(super) peers: Vec<String>,
    /// Compare with an earlier results.csv; the exit status is 1 if a curve is worse.
    #[arg(long, value_name = "results.csv")]
    pub(super) baseline: Option<PathBuf>,
    #[command(flatten)]
    pub(super) common: SceneArgs,
}

#[derive(Args, Debug)]
pub(super) struct PhotonsArgs {
    /// The scene: Mitsuba XML or OBJ.
    pub(super) scene: PathBuf,
    /// Where to write, PLY or PNG by its extension.
    #[arg(short, long, value_name = "OUT.ply|OUT.png")]
    pub(super) output: PathBuf,
    /// Brighten a PNG by EV stops.
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(super) exposure: f32,
    #[command(flatten)]
    pub(super) common: SceneArgs,
}

#[derive(Args, Debug)]
pub(super) struct InfoArgs {
    /// The scene: Mitsuba XML or OBJ.
    pub(super) scene: Option<PathBuf>,
    /// Integrator to plan for [default: photonmap].
    #[arg(long, value_enum)]
    pub(super) integrator: Option<IntegratorName>,
    #[command(flatten)]
    pub(super) common: SceneArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum IntegratorName {
    /// Photon mapping.
    Photonmap,
    /// The path tracer that photon mapping is checked against.
    Path,
}

impl IntegratorName {
    pub(super) fn kind(self) -> Kind {
        match self {
            IntegratorName::Photonmap => Kind::Photonmap,
            IntegratorName::Path => Kind::Path,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum BackendName {
    /// The system's Embree.
    Embree,
    /// Caustica's own.
    Bvh,
}

impl BackendName {
    pub(super) fn backend(self) -> Backend {
        match self {
            BackendName::Embree => Backend::Embree,
            BackendName::Bvh => Backend::Bvh,
        }
    }
}

impl SceneArgs {
    /// The backend asked for, or this build's default.
    pub(super) fn backend(&self) -> caustica::Result<Backend> {
        match self.backend {
            Some(name) => Ok(name.backend()),
            None => accel::available().first().copied().ok_or_else(|| {
                caustica::Error::Usage(
                    "this build has no ray backend; build with --features embree or --features bvh".into(),
                )
            }),
        }
    }
}

fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.into(), value.into())),
        _ => Err("expected NAME=VALUE".into()),
    }
}

fn named_error(text: &str) -> Result<(String, f64), String> {
    let (name, value) = assignment(text)?;
    match value.parse::<f64>() {
        Ok(x) if x.is_finite() && x >= 0.0 => Ok((name, x)),
        _ => Err("expected SCENE=RELMSE, e.g. ring=2e-4".into()),
    }
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let size = text.split_once('x').and_then(|(w, h)| Some((w.parse::<u32>().ok()?, h.parse::<u32>().ok()?)));
    match size {
        Some((w, h)) if w > 0 && h > 0 && w as u64 * h as u64 <= MAX_PIXELS => Ok((w, h)),
        Some((0, _) | (_, 0)) => Err("an image needs at least one pixel".into()),
        Some(_) => Err(format!("at most {MAX_PIXELS} pixels")),
        None => Err("expected WxH, e.g. 640x480".into()),
    }
}

fn pass_range(text: &str) -> Result<Range<u32>, String> {
    let range = text.split_once("..").and_then(|(a, b)| Some(a.parse::<u32>().ok()?..b.parse::<u32>().ok()?));
    match range {
        Some(range) if range.is_empty() => Err("it holds no pass".into()),
        Some(range) if range.end > MAX_PASSES => Err(format!("passes are numbered up to {MAX_PASSES}")),
        Some(range) => Ok(range),
        None => Err("expected A..B, e.g. 0..16 for the first sixteen passes".into()),
    }
}

fn finite(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("expected a number".into()),
    }
}

fn positive(text: &str) -> Result<f32, String> {
    match finite(text) {
        Ok(x) if x > 0.0 => Ok(x),
        _ => Err("expected a number above 0".into()),
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().filter(|s| *s > 0.0);
    seconds
        .and_then(|s| Duration::try_from_secs_f64(s).ok())
        .ok_or_else(|| "expected a number of seconds above 0".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn grammar_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn values() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["640", "640X480", "0x5", "5x0", "-1x5", "99999x99999", "5x5x5", ""] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(assignment("a=b=c"), Ok(("a".into(), "b=c".into())));
        assert_eq!(assignment("a="), Ok(("a".into(), String::new())));
        assert!(assignment("=b").is_err() && assignment("b").is_err());
        for bad in ["0", "-1", "inf", "NaN", "x"] {
            assert!(positive(bad).is_err() && seconds(bad).is_err(), "{bad}");
        }
        assert_eq!(named_error("ring=2e-4"), Ok(("ring".into(), 2e-4)));
        for bad in ["ring", "ring=", "ring=-1", "ring=nan", "=1"] {
            assert!(named_error(bad).is_err(), "{bad}");
        }
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        assert_eq!(pass_range("3..7"), Ok(3..7));
        for bad in ["3", "3..3", "4..3", "..3", "3..", "-1..2", "1..=2", "0..4294967295", "a..b", ""] {
            assert!(pass_range(bad).is_err(), "{bad}");
        }
    }
}
