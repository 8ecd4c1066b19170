//! What was measured: rows of `results.csv`, and the curves that they make.

use caustica::image_io::replace_file;
use caustica::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A picture that was judged. Columns are a contract: they may be added, never renamed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Row {
    pub(super) scene: String,
    pub(super) renderer: String,
    pub(super) version: String,
    /// The algorithm.
    pub(super) integrator: String,
    pub(super) backend: String,
    pub(super) threads: usize,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) seed: u64,
    /// Seconds that the picture was asked for after.
    pub(super) budget: f64,
    /// Wall time from the start of loading the scene to the picture.
    pub(super) seconds: f64,
    /// What processors worked for it in that time, if that is known; unknown in files of early versions.
    pub(super) cpu_seconds: Option<f64>,
    /// How much of the wall time was loading and building.
    pub(super) load_seconds: f64,
    /// Samples per pixel.
    pub(super) passes: u64,
    pub(super) relmse: f64,
    /// The reference's own relmse, which `relmse` contains; 0 if unknown.
    pub(super) reference_relmse: f64,
    pub(super) rmse: f64,
    pub(super) mae: f64,
    pub(super) bias_r: f64,
    pub(super) bias_g: f64,
    pub(super) bias_b: f64,
    pub(super) flip: f64,
}

/// What a curve is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Method {
    pub(super) scene: String,
    pub(super) renderer: String,
    pub(super) version: String,
    pub(super) integrator: String,
    pub(super) backend: String,
}

impl Row {
    pub(super) fn method(&self) -> Method {
        let Row { scene, renderer, version, integrator, backend, .. } = self.clone();
        Method { scene, renderer, version, integrator, backend }
    }

    /// The error without the reference's. Where that is most of it, no more is known than that it is small.
    fn own_relmse(&self) -> f64 {
        (self.relmse - self.reference_relmse).max(0.1 * self.reference_relmse)
    }
}

impl Method {
    /// Whether this is `other` in, perhaps, another version.
    pub(super) fn is_same(&self, other: &Method) -> bool {
        *self == Method { version: self.version.clone(), ..other.clone() }
    }

    /// Its name within a scene.
    pub(super) fn label(&self) -> String {
        format!("{} {} {}", self.renderer, self.integrator, self.backend)
    }

    /// Its name in file names.
    pub(super) fn slug(&self) -> String {
        slug(&format!("{} {}", self.scene, self.label()))
    }
}

/// `name` with all but letters, digits, `.` and `_` replaced.
pub(super) fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "._".contains(c) { c } else { '-' }).collect()
}

/// Reads `results.csv`.
pub(super) fn read(path: &Path) -> Result<Vec<Row>> {
    let fail = |e: csv::Error| Error::File {
        file: path.into(),
        message: format!("is no results.csv of 'caustica bench': {e}"),
    };
    let rows = csv::Reader::from_path(path).map_err(fail)?.into_deserialize();
    rows.collect::<Result<_, _>>().map_err(fail)
}

/// Writes `results.csv`.
pub(super) fn write(path: &Path, rows: &[Row]) -> Result<()> {
    replace_file(path, |w| {
        let mut csv = csv::Writer::from_writer(w);
        rows.iter().try_for_each(|row| csv.serialize(row))?;
        csv.flush()
    })
}

/// Median and extremes over repeated runs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spread {
    pub(super) median: f64,
    pub(super) min: f64,
    pub(super) max: f64,
}

impl Spread {
    /// Of at least one value.
    fn of(values: impl Iterator<Item = f64>) -> Spread {
        let mut v: Vec<f64> = values.collect();
        v.sort_by(f64::total_cmp);
        let n = v.len();
        Spread { median: 0.5 * (v[(n - 1) / 2] + v[n / 2]), min: v[0], max: v[n - 1] }
    }
}

/// All runs of a method at a budget.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) budget: f64,
    /// By the wall clock.
    wall: Timed,
    /// By processors' work, if all runs tell.
    cpu: Option<Timed>,
    pub(super) load_seconds: Spread,
    pub(super) passes: Spread,
    /// relmse, less the reference's own.
    pub(super) error: Spread,
    pub(super) flip: Spread,
    /// Relative error of the mean of all channels.
    pub(super) bias: Spread,
}

impl Point {
    /// Times by `clock`; `None` if it was not looked at.
    pub(super) fn timed(&self, clock: Clock) -> Option<Timed> {
        match clock {
            Clock::Cpu => self.cpu,
            Clock::Wall => Some(self.wall),
        }
    }
}

/// When a picture was there, and what it cost.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timed {
    pub(super) seconds: Spread,
    /// relmse times seconds, which is the same at all budgets as long as the error falls with the number of samples.
    pub(super) cost: Spread,
}

impl Timed {
    fn of(rows: &[&Row], seconds: impl Fn(&Row) -> f64) -> Timed {
        Timed {
            seconds: Spread::of(rows.iter().map(|row| seconds(row))),
            cost: Spread::of(rows.iter().map(|row| row.own_relmse() * seconds(row))),
        }
    }
}

/// What curves are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Clock {
    /// The work of all processors: how many of them a renderer keeps busy is no merit of its method.
    Cpu,
    Wall,
}

impl Clock {
    /// CPU time if all of `curves` have it.
    pub(super) fn of(curves: &[&Curve]) -> Clock {
        let all = curves.iter().flat_map(|c| &c.points).all(|p| p.cpu.is_some());
        if all { Clock::Cpu } else { Clock::Wall }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Clock::Cpu => "CPU",
            Clock::Wall => "wall",
        }
    }
}

/// Error over time of a method.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    pub(super) method: Method,
    /// By growing budget.
    pub(super) points: Vec<Point>,
}

impl Curve {
    /// The curves that `rows` make, in the order in which they appear.
    pub(super) fn all(rows: &[Row]) -> Vec<Curve> {
        let mut curves: Vec<(Method, Vec<&Row>)> = Vec::new();
        for row in rows {
            let method = row.method();
            match curves.iter_mut().find(|(m, _)| *m == method) {
                Some((_, rows)) => rows.push(row),
                None => curves.push((method, vec![row])),
            }
        }
        curves.into_iter().map(|(method, rows)| Curve { method, points: points(rows) }).collect()
    }

    pub(super) fn last(&self) -> Option<&Point> {
        self.points.last()
    }

    /// When, by `clock`, the median error first is at most `error`, interpolated between the points as the plot shows them;
    /// `None` if it never is.
    pub(super) fn time_to(&self, error: f64, clock: Clock) -> Option<Reached> {
        let found = self.points.iter().position(|p| p.error.median <= error)?;
        let b = &self.points[found];
        let end = b.timed(clock)?.seconds.median;
        let Some(a) = found.checked_sub(1).map(|i| &self.points[i]) else {
            return Some(Reached { seconds: end, at_once: true });
        };
        let start = a.timed(clock)?.seconds.median;
        let t = (error / a.error.median).ln() / (b.error.median / a.error.median).ln();
        let seconds = start * (end / start).powf(t.clamp(0.0, 1.0));
        Some(Reached { seconds, at_once: false })
    }
}

/// When a curve reaches an error.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reached {
    pub(super) seconds: f64,
    /// At its first point, so perhaps earlier.
    pub(super) at_once: bool,
}

/// Round errors that some curve reaches and not every one has at once, at most the four smallest, which come last.
pub(super) fn targets(curves: &[&Curve]) -> Vec<f64> {
    let grid = (-8..1).flat_map(|k| [10.0_f64.powi(k), 3.0 * 10.0_f64.powi(k)]);
    let told = |error: &f64| {
        let times: Vec<_> = curves.iter().map(|c| c.time_to(*error, Clock::Wall)).collect();
        times.iter().any(|t| t.is_some()) && !times.iter().all(|t| t.is_some_and(|t| t.at_once))
    };
    let mut targets: Vec<f64> = grid.filter(told).take(4).collect();
    targets.reverse();
    targets
}

fn points(mut rows: Vec<&Row>) -> Vec<Point> {
    rows.sort_by(|a, b| a.budget.total_cmp(&b.budget));
    rows.chunk_by(|a, b| a.budget == b.budget)
        .map(|rows| {
            let spread = |value: &dyn Fn(&Row) -> f64| Spread::of(rows.iter().map(|row| value(row)));
            // A logarithmic axis has no place for other values.
            let known = rows.iter().all(|r| r.cpu_seconds.is_some_and(|s| s > 0.0 && s.is_finite()));
            Point {
                budget: rows[0].budget,
                wall: Timed::of(rows, |r| r.seconds),
                cpu: known.then(|| Timed::of(rows, |r| r.cpu_seconds.unwrap_or(f64::NAN))),
                load_seconds: spread(&|r| r.load_seconds),
                passes: spread(&|r| r.passes as f64),
                error: spread(&Row::own_relmse),
                flip: spread(&|r| r.flip),
                bias: spread(&|r| (r.bias_r + r.bias_g + r.bias_b) / 3.0),
            }
        })
        .collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A run of `integrator` whose relmse is `a` / t, with reference noise 1e-6.
    pub(crate) fn run(integrator: &str, seed: u64, a: f64) -> Vec<Row> {
        let row = |budget: f64| Row {
            scene: "box".into(),
            renderer: "caustica".into(),
            version: "1".into(),
            integrator: integrator.into(),
            backend: "bvh".into(),
            threads: 2,
            width: 4,
            height: 3,
            seed,
            budget,
            seconds: budget * 1.25,
            cpu_seconds: Some(budget * 2.0),
            load_seconds: 0.1,
            passes: (budget * 8.0) as u64,
            relmse: a / (budget * 1.25) + 1e-6,
            reference_relmse: 1e-6,
            rmse: 0.1,
            mae: 0.1,
            bias_r: 0.01,
            bias_g: 0.02,
            bias_b: 0.03,
            flip: 0.2,
        };
        [1.0, 2.0, 4.0].map(row).into()
    }

    #[test]
    fn rows_survive_a_file() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("results.csv");
        let mut rows = run("photonmap", 0, 1e-2);
        rows[1].flip = f64::NAN;
        rows[1].version = "a,b \"c\"".into();
        rows[2].cpu_seconds = None;
        write(&file, &rows).unwrap();
        let back = read(&file).unwrap();
        assert_eq!(format!("{back:?}"), format!("{rows:?}"));
        std::fs::write(&file, "scene,seconds\nbox,1\n").unwrap();
        let message = read(&file).unwrap_err().to_string();
        assert!(message.contains("results.csv: is no results.csv"), "{message}");
    }

    #[test]
    fn curves_are_medians_over_runs() {
        let rows: Vec<Row> =
            [(0, 1e-2), (1, 4e-2), (2, 2e-2)].iter().flat_map(|&(seed, a)| run("path", seed, a)).collect();
        let curves = Curve::all(&rows);
        assert_eq!(curves.len(), 1);
        let Point { error, .. } = &curves[0].points[1];
        let Timed { seconds, cost } = curves[0].points[1].timed(Clock::Wall).unwrap();
        assert_eq!(seconds.median, 2.5);
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        close(error.median, 8e-3);
        close(error.min, 4e-3);
        close(error.max, 16e-3);
        close(cost.median, 2e-2);
        // The error is 2e-2 / t exactly, and so are all points between.
        let reached = curves[0].time_to(6e-3, Clock::Wall).unwrap();
        close(reached.seconds, 2e-2 / 6e-3);
        assert!(!reached.at_once && curves[0].time_to(0.1, Clock::Wall).unwrap().at_once);
        assert!(curves[0].time_to(1e-4, Clock::Wall).is_none());
        // Two processors were busy for 0.8 of it.
        close(curves[0].time_to(6e-3, Clock::Cpu).unwrap().seconds, 1.6 * reached.seconds);
        close(curves[0].points[1].timed(Clock::Cpu).unwrap().cost.median, 1.6 * 2e-2);
    }

    #[test]
    fn cpu_time_counts_if_all_have_it() {
        let (known, mut unknown) = (run("photonmap", 0, 1e-3), run("path", 0, 1e-3));
        unknown[1].cpu_seconds = None;
        let curves = Curve::all(&[known, unknown].concat());
        assert_eq!(Clock::of(&[&curves[0]]), Clock::Cpu);
        assert_eq!(Clock::of(&[&curves[0], &curves[1]]), Clock::Wall);
        assert!(curves[1].points[1].timed(Clock::Cpu).is_none());
    }

    #[test]
    fn targets_are_reached_by_some_and_not_by_all_at_once() {
        let mut rows = run("photonmap", 0, 1e-3);
        rows.extend(run("path", 0, 1e-1));
        let curves = Curve::all(&rows);
        // photonmap goes from 8e-4 to 2e-4, path from 8e-2 to 2e-2.
        assert_eq!(targets(&curves.iter().collect::<Vec<_>>()).len(), 4);
        let own = targets(&[&curves[0]]);
        assert_eq!(own.len(), 1);
        assert!((own[0] / 3e-4 - 1.0).abs() < 1e-9, "{own:?}");
        assert!(targets(&[]).is_empty());
    }
}
