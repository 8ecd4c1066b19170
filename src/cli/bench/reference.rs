//! What pictures are compared with.

use super::super::args::BenchArgs;
use super::super::checkpoint::Checkpoint;
use super::super::prepare::Prepared;
use super::results::slug;
use caustica::image_io::{self, Image};
use caustica::integrator::{Budget, Kind, Options, State};
use caustica::part_file::{self, Identity};
use caustica::{Error, Result};
use indicatif::ProgressBar;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub(super) struct Reference {
    pub(super) image: Image,
    /// Its own relmse; 0 if unknown.
    pub(super) relmse: f64,
    /// Where it comes from.
    pub(super) origin: String,
}

impl Reference {
    /// This, if it has the scene's size.
    pub(super) fn checked(self, prepared: &Prepared) -> Result<Reference> {
        let (.., width, height) = prepared.scene.film.crop;
        let Image { width: w, height: h, .. } = self.image;
        if (w, h) == (width as usize, height as usize) {
            return Ok(self);
        }
        let origin = self.origin;
        Err(Error::Usage(format!(
            "the reference {origin} has {w}x{h} pixels, the scene {width}x{height}; see --size"
        )))
    }
}

/// The given reference of the scene called `name`; `None` if it is to be computed.
pub(super) fn given(args: &BenchArgs, name: &str) -> Result<Option<Reference>> {
    let Some(given) = &args.reference else { return Ok(None) };
    let file = given_file(given, name, args.scenes.len())?;
    let noise = args.reference_noise.iter().find(|(scene, _)| scene == name);
    Ok(Some(Reference {
        image: image_io::read(&file)?,
        relmse: noise.map_or(0.0, |n| n.1),
        origin: file.display().to_string(),
    }))
}

fn given_file(given: &Path, name: &str, scenes: usize) -> Result<PathBuf> {
    if given.is_dir() {
        return Ok(given.join(format!("{name}.exr")));
    }
    if scenes > 1 {
        let message = format!("'{}' is no directory, but there are {scenes} scenes", given.display());
        return Err(Error::Usage(message));
    }
    Ok(given.into())
}

/// Often enough to lose little.
const CHECKPOINT: Duration = Duration::from_secs(60);

/// Traced once, and kept as a part file: with it an interrupted bench goes on where it was, and another scene of the same
/// name is not mistaken for it.
pub(super) fn computed(args: &BenchArgs, name: &str, prepared: &Prepared) -> Result<Reference> {
    let options = Options {
        integrator: Kind::Path,
        // Runs to be judged must not share its random numbers.
        seed: !args.common.seed,
        budget: Budget::Passes(args.reference_passes),
        ..prepared.options.clone()
    };
    let dir = args.output.join("reference");
    fs::create_dir_all(&dir)
        .map_err(|e| Error::Runtime(format!("cannot create '{}': {e}", dir.display())))?;
    let identity = Identity::new(&prepared.scene, prepared.backend, &options);
    let file = dir.join(format!("{}-{:.8}.part", slug(name), identity.scene));
    let mut state = match part_file::read(&file) {
        Ok((header, state)) if header.identity == identity && header.range().start == 0 => state,
        _ => State::new(&prepared.scene, &options, 0)?,
    };
    if state.range().end < args.reference_passes {
        let verbosity = &args.common.verbosity;
        verbosity.note("", &format!("{name}: tracing {} passes for a reference", args.reference_passes));
        let mut checkpoint = Checkpoint {
            file: &file,
            interval: CHECKPOINT,
            identity: &identity,
            scene: name,
            last: Instant::now(),
        };
        let bar =
            ProgressBar::with_draw_target(Some(args.reference_passes.into()), verbosity.progress_target());
        state.render(&prepared.scene, &options, &mut |progress, state| {
            bar.set_position(progress.passes.into());
            bar.suspend(|| checkpoint.after_pass(state, verbosity));
            ControlFlow::Continue(())
        });
        bar.finish_and_clear();
        checkpoint.write(&state)?;
    }
    let passes = state.range().end;
    let rendering = state.resolve();
    // Of the difference between its even and its odd passes.
    let relmse = rendering.error.total().powi(2);
    args.common.verbosity.note("", &format!("{name}: the reference's own relmse is {relmse:.1e}"));
    Ok(Reference {
        relmse,
        origin: format!("{passes} passes of the path tracer ({})", file.display()),
        image: rendering.image,
    })
}
