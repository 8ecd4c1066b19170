//! `caustica render`.

use super::args::RenderArgs;
use super::checkpoint::{Checkpoint, resume};
use super::output::{Format, Origin, Run, Stats, error_text, write_image};
use super::prepare::{Prepared, prepare, with_threads};
use super::{INTERRUPTED, info};
use caustica::integrator::{self, Budget, Layout, Progress, State};
use caustica::part_file::{self, Identity};
use caustica::{Error, Result, image_io};
use indicatif::{ProgressBar, ProgressStyle};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Renders, and returns the exit status.
pub(super) fn run(args: &RenderArgs, start: Instant) -> Result<u8> {
    let output = output_path(args)?;
    let format = output_format(args, &output)?;
    for file in [Some(&output), args.image.stats.as_ref(), args.checkpoint.as_ref()].into_iter().flatten() {
        image_io::check_writable(file)?;
    }
    check_nothing_lost(args, &output)?;
    if let Some(file) = &args.resume {
        part_file::read_header(file)?;
    }
    with_threads(&args.common, || {
        let mut prepared = prepare(&args.scene, &args.common, args.integrator.map(|i| i.kind()))?;
        prepared.options.aovs = args.aovs;
        prepared.options.budget = match (args.passes, args.time, args.error, &args.pass_range) {
            (Some(n), ..) => Budget::Passes(n),
            // The user's clock started with the program.
            (_, Some(time), ..) => Budget::Time(time.saturating_sub(start.elapsed())),
            (_, _, Some(relative), _) => Budget::Error(relative),
            (.., Some(range)) => Budget::Passes(range.len() as u32),
            _ => prepared.options.budget,
        };
        info::print_plan(&prepared, |line| args.common.verbosity.detail(line));
        let first = args.pass_range.as_ref().map_or(0, |range| range.start);
        // Hashing a large scene takes a moment.
        let keeps = format == Format::Part || args.checkpoint.is_some() || args.resume.is_some();
        let identity = keeps.then(|| Identity::new(&prepared.scene, prepared.backend, &prepared.options));
        let mut state = match (&args.resume, &identity) {
            (Some(file), Some(identity)) => {
                let total = match prepared.options.budget {
                    Budget::Passes(n) => Some(n),
                    _ => None,
                };
                resume(file, identity, Layout::new(&prepared.scene, &prepared.options), first, total)?
            }
            _ => State::new(&prepared.scene, &prepared.options, first)?,
        };
        let earlier = state.statistics.seconds.rendering;
        let origin = Origin {
            scene: args.scene.display().to_string(),
            integrator: prepared.options.integrator.name().into(),
            backend: prepared.backend.name().into(),
            seed: prepared.options.seed,
        };
        let mut checkpoint =
            args.checkpoint.as_ref().zip(identity.as_ref()).map(|(file, identity)| Checkpoint {
                file,
                interval: args.checkpoint_interval,
                identity,
                scene: &origin.scene,
                last: Instant::now(),
            });

        let interrupted = catch_signals()
            .map_err(|e| Error::Runtime(format!("cannot listen to Ctrl-C and SIGTERM: {e}")))?;
        trace(args, &mut state, &prepared, &interrupted, checkpoint.as_mut());
        let interrupted = interrupted.load(Ordering::Relaxed);

        // If one of the two files cannot be written, the other shall still be.
        let kept = match &checkpoint {
            Some(checkpoint) if checkpoint.file != output => checkpoint.write(&state),
            _ => Ok(()),
        };
        let rendering = state.resolve();
        let run = Run { start, seconds: prepared.seconds, earlier, interrupted };
        let stats = Stats::new(&origin, &run, &state, &rendering);
        match &identity {
            Some(identity) if format == Format::Part => {
                part_file::write(&output, identity, &origin.scene, &state)?;
            }
            _ => write_image(&output, format, args.image.exposure, rendering, &origin, stats.passes)?,
        }
        kept?;
        if let Some(path) = &args.image.stats {
            stats.write(path)?;
        }
        stats.report(&args.common.verbosity, &output);
        Ok(if interrupted { INTERRUPTED } else { 0 })
    })
}

fn output_format(args: &RenderArgs, output: &Path) -> Result<Format> {
    let refuse = |what: &str| Err(Error::Usage(format!("'{}': {what}", output.display())));
    match (Format::of(output, &args.image)?, &args.pass_range) {
        (Format::Part, None) => refuse("a part is written with --pass-range; see also --checkpoint"),
        (Format::Part, Some(_)) => Ok(Format::Part),
        (_, Some(_)) => refuse("some passes make no picture; with --pass-range the name must end in .part"),
        (Format::Png, _) if args.aovs => refuse("a PNG has no layers for --aovs; write an .exr"),
        _ if args.checkpoint.as_deref() == Some(output) => refuse("is both the image and the checkpoint"),
        (format, _) => Ok(format),
    }
}

/// Refuses to write two things to one file, and to replace the scene, or by a checkpoint what is none.
fn check_nothing_lost(args: &RenderArgs, output: &Path) -> Result<()> {
    let refuse = |file: &Path, what: &str| Err(Error::Usage(format!("'{}': {what}", file.display())));
    let same =
        |a: &Path, b: &Path| a == b || a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    let checkpoint = args.checkpoint.as_deref().filter(|file| *file != output);
    let written: Vec<&Path> =
        [Some(output), args.image.stats.as_deref(), checkpoint].into_iter().flatten().collect();
    for (i, file) in written.iter().enumerate() {
        if same(file, &args.scene) {
            return refuse(file, "is the scene; write to another file");
        }
        let is_device = file.metadata().is_ok_and(|m| !m.is_file());
        if !is_device && written[..i].iter().any(|other| same(file, other)) {
            return refuse(file, "would be written twice; choose two names");
        }
    }
    match checkpoint {
        Some(file) if file.metadata().is_ok_and(|m| m.is_file() && m.len() > 0) => {
            match part_file::is_part(file) {
                true => Ok(()),
                false => refuse(file, "is no checkpoint, but one would replace it; choose another name"),
            }
        }
        _ => Ok(()),
    }
}

fn output_path(args: &RenderArgs) -> Result<PathBuf> {
    match (&args.output, args.scene.file_stem()) {
        (Some(path), _) => Ok(path.clone()),
        (None, Some(stem)) => {
            let mut name = stem.to_os_string();
            match &args.pass_range {
                Some(range) => name.push(format!(".{}-{}.part", range.start, range.end)),
                None => name.push(".exr"),
            }
            Ok(name.into())
        }
        (None, None) => Err(Error::File {
            file: args.scene.clone(),
            message: "is no scene; give a Mitsuba XML or OBJ file".into(),
        }),
    }
}

/// From here on Ctrl-C or SIGTERM asks for an end after the pass. A second Ctrl-C gets it at once; not so SIGTERM,
/// which batch systems may send twice before they kill.
fn catch_signals() -> io::Result<Arc<AtomicBool>> {
    let asked = Arc::new(AtomicBool::new(false));
    // In this order: the first Ctrl-C finds the flag not set yet.
    flag::register_conditional_shutdown(SIGINT, INTERRUPTED.into(), Arc::clone(&asked))?;
    flag::register(SIGINT, Arc::clone(&asked))?;
    flag::register(SIGTERM, Arc::clone(&asked))?;
    Ok(asked)
}

fn trace(
    args: &RenderArgs,
    state: &mut State,
    prepared: &Prepared,
    interrupted: &AtomicBool,
    mut checkpoint: Option<&mut Checkpoint>,
) {
    const STEPS: u64 = 10_000;
    let verbosity = &args.common.verbosity;
    let bar = ProgressBar::with_draw_target(Some(STEPS), verbosity.progress_target());
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {elapsed}  {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    let mut first = None;
    let mut is_told = false;
    let known = integrator::plan(&prepared.scene, &prepared.options).len();
    state.render(&prepared.scene, &prepared.options, &mut |progress, state| {
        if !std::mem::replace(&mut is_told, true) {
            let survey = state.statistics.survey.lines();
            // What the scene alone tells of was told before.
            let learnt = state
                .statistics
                .skipped
                .iter()
                .skip(known)
                .map(|s| format!("  no {}: {}", s.stage, s.reason));
            bar.suspend(|| survey.into_iter().chain(learnt).for_each(|line| verbosity.detail(&line)));
        }
        bar.set_position((progress.fraction.clamp(0.0, 1.0) * STEPS as f64) as u64);
        let error = progress.error.map_or(String::new(), |e| format!(", {}", error_text(&e)));
        let left = time_left(first.get_or_insert(*progress), progress)
            .map_or(String::new(), |left| format!(", {} left", indicatif::HumanDuration(left)));
        bar.set_message(format!("{} passes{error}{left}", progress.passes));
        if interrupted.load(Ordering::Relaxed) {
            return ControlFlow::Break(());
        }
        if let Some(checkpoint) = &mut checkpoint {
            bar.suspend(|| checkpoint.after_pass(state, verbosity));
        }
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
}

/// By the pace since this run's first pass, as a resumed one begins with much done.
fn time_left(first: &Progress, now: &Progress) -> Option<Duration> {
    let pace = (now.fraction - first.fraction) / (now.seconds - first.seconds);
    Duration::try_from_secs_f64(((1.0 - now.fraction) / pace).ceil()).ok()
}
