//! Runs of Caustica itself.

use super::super::args::{BackendName, IntegratorName, SceneArgs, Verbosity};
use super::super::prepare::{Prepared, prepare};
use super::results::Method;
use super::{Outcome, Shot, Task, budget};
use caustica::Result;
use caustica::integrator::{Budget, State};
use caustica::part_file::MAX_PASSES;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Renders until the last budget, and keeps the pictures on the way.
pub(super) fn run(integrator: IntegratorName, backend: BackendName, task: &Task) -> Result<Outcome> {
    let (start, cpu_start) = (Instant::now(), cpu_time());
    // What there is to be told about the scene has been told.
    let verbosity = Verbosity { verbose: false, quiet: true };
    let common = SceneArgs { backend: Some(backend), seed: task.seed, verbosity, ..task.common.clone() };
    let Prepared { scene, mut options, .. } = prepare(task.file, &common, Some(integrator.kind()))?;
    let load_seconds = start.elapsed().as_secs_f64();
    options.budget = Budget::Passes(MAX_PASSES);
    let mut state = State::new(&scene, &options, 0)?;
    let mut shots: Vec<Shot> = Vec::new();
    // Earlier pictures are no part of the work that a later one takes.
    let (mut paused, mut cpu_paused) = (Duration::ZERO, Duration::ZERO);
    state.render(&scene, &options, &mut |progress, state| {
        let (before, cpu_before) = (Instant::now(), cpu_time());
        let elapsed = (before - start - paused).as_secs_f64();
        let Some(budget) = budget(task.budgets, elapsed) else { return ControlFlow::Continue(()) };
        if shots.last().is_none_or(|shot| shot.budget < budget) {
            let image = state.resolve().image;
            let seconds = (start.elapsed() - paused).as_secs_f64();
            let cpu = cpu_since(cpu_start).map(|t| t.saturating_sub(cpu_paused).as_secs_f64());
            shots.push(Shot {
                budget,
                seconds,
                cpu_seconds: cpu,
                load_seconds,
                passes: progress.passes.into(),
                image,
            });
            paused += before.elapsed();
            cpu_paused += cpu_since(cpu_before).unwrap_or_default();
        }
        if task.budgets.last() == Some(&budget) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let method = Method {
        scene: task.scene.into(),
        renderer: "caustica".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        integrator: integrator.kind().name().into(),
        backend: backend.backend().name().into(),
    };
    Ok(Outcome::Measured(method, shots))
}

/// How long processors have worked for this process; only Unix tells.
fn cpu_time() -> Option<Duration> {
    #[cfg(unix)]
    {
        use rustix::time::{ClockId, clock_gettime};
        Duration::try_from(clock_gettime(ClockId::ProcessCPUTime)).ok()
    }
    #[cfg(not(unix))]
    None
}

fn cpu_since(start: Option<Duration>) -> Option<Duration> {
    Some(cpu_time()?.saturating_sub(start?))
}
