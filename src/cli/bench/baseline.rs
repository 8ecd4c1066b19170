//! Whether things have become better or worse since an earlier `results.csv`.

use super::results::{Clock, Curve, Method, Point, Spread};

/// What has become of a curve.
#[derive(Clone, Debug)]
pub(super) struct Change {
    pub(super) method: Method,
    /// What seconds are told by.
    pub(super) clock: Clock,
    /// relmse × seconds at the largest budget that both have, now over then: the time to an equal error.
    pub(super) cost: f64,
    /// Its factors: relmse at equal samples (as far as it falls with their number), and seconds per sample.
    pub(super) error_per_pass: f64,
    pub(super) seconds_per_pass: f64,
    pub(super) verdict: Verdict,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Better,
    Same,
    Worse,
}

impl Verdict {
    pub(super) fn name(self) -> &'static str {
        match self {
            Verdict::Better => "better",
            Verdict::Same => "same",
            Verdict::Worse => "worse",
        }
    }
}

/// Machines are noisy: smaller changes are none.
const NOTABLE: f64 = 1.1;

/// Compares all curves that both have.
pub(super) fn compare(now: &[Curve], then: &[Curve]) -> Vec<Change> {
    let change = |now: &Curve| {
        let then = then.iter().find(|c| c.method.is_same(&now.method))?;
        let pair = |a: &Point| Some((a.clone(), then.points.iter().find(|b| b.budget == a.budget)?.clone()));
        let (a, b) = now.points.iter().rev().find_map(pair)?;
        let clock = Clock::of(&[now, then]);
        let (time, time_then) = (a.timed(clock)?, b.timed(clock)?);
        let samples = a.passes.median / b.passes.median;
        Some(Change {
            method: now.method.clone(),
            clock,
            cost: time.cost.median / time_then.cost.median,
            error_per_pass: a.error.median / b.error.median * samples,
            seconds_per_pass: time.seconds.median / time_then.seconds.median / samples,
            verdict: verdict(time.cost, time_then.cost),
        })
    };
    now.iter().filter_map(change).collect()
}

/// A change must be notable, and larger than what runs differ by among themselves.
fn verdict(now: Spread, then: Spread) -> Verdict {
    if now.median > NOTABLE * then.median && now.min > then.max {
        Verdict::Worse
    } else if then.median > NOTABLE * now.median && then.min > now.max {
        Verdict::Better
    } else {
        Verdict::Same
    }
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::run;
    use super::*;

    fn curves(errors: &[f64]) -> Vec<Curve> {
        Curve::all(&errors.iter().zip(0..).flat_map(|(&a, seed)| run("path", seed, a)).collect::<Vec<_>>())
    }

    #[test]
    fn verdicts() {
        let then = curves(&[1.0e-2, 1.1e-2, 1.2e-2]);
        let judge = |errors: &[f64]| compare(&curves(errors), &then)[0].verdict;
        assert_eq!(judge(&[1.0e-2, 1.1e-2, 1.2e-2]), Verdict::Same);
        assert_eq!(judge(&[1.3e-2, 1.4e-2, 1.5e-2]), Verdict::Worse);
        // Overlapping runs, and a difference that is small.
        assert_eq!(judge(&[1.15e-2, 1.4e-2, 1.5e-2]), Verdict::Same);
        assert_eq!(judge(&[1.201e-2, 1.202e-2, 1.203e-2]), Verdict::Same);
        assert_eq!(judge(&[0.7e-2, 0.8e-2, 0.9e-2]), Verdict::Better);
    }

    #[test]
    fn factors_multiply() {
        let (then, mut now) = (run("path", 0, 1e-2), run("path", 0, 3e-2));
        now.iter_mut().for_each(|row| row.passes *= 2);
        let change = &compare(&Curve::all(&now), &Curve::all(&then))[0];
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        close(change.cost, 3.0);
        close(change.error_per_pass, 6.0);
        close(change.seconds_per_pass, 0.5);
        // Twice the work at the same time costs twice as much, if that is known of both.
        now.iter_mut().for_each(|row| row.cpu_seconds = row.cpu_seconds.map(|s| 2.0 * s));
        let change = &compare(&Curve::all(&now), &Curve::all(&then))[0];
        assert_eq!(change.clock, Clock::Cpu);
        close(change.cost, 6.0);
        now[2].cpu_seconds = None;
        let change = &compare(&Curve::all(&now), &Curve::all(&then))[0];
        assert_eq!(change.clock, Clock::Wall);
        close(change.cost, 3.0);
        // Another version is the same method, another integrator is not.
        now.iter_mut().for_each(|row| row.version = "2".into());
        assert_eq!(compare(&Curve::all(&now), &Curve::all(&then)).len(), 1);
        now.iter_mut().for_each(|row| row.integrator = "other".into());
        assert!(compare(&Curve::all(&now), &Curve::all(&then)).is_empty());
    }
}
