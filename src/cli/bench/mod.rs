//! `caustica bench`: run time against error.

mod baseline;
mod own;
mod page;
mod peer;
mod pictures;
mod plot;
mod reference;
mod report;
mod results;

use super::args::{BackendName, BenchArgs, IntegratorName, SceneArgs, Verbosity};
use super::console;
use super::prepare::{Prepared, prepare, with_threads};
use baseline::Verdict;
use caustica::image_io::{self, Image};
use caustica::{Error, Result, accel, metrics};
use clap::ValueEnum;
use reference::Reference;
use report::{Report, RunInfo, Scene};
use results::{Clock, Curve, Method, Reached, Row};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

pub(super) fn run(args: &BenchArgs) -> Result<()> {
    with_threads(&args.common, || {
        let names = scene_names(&args.scenes)?;
        if let Some((name, _)) = args.reference_noise.iter().find(|(name, _)| !names.contains(name)) {
            let message = format!("--reference-noise {name}=...: the scenes are called {}", names.join(", "));
            return Err(Error::Usage(message));
        }
        let then = args.baseline.as_deref().map(results::read).transpose()?.unwrap_or_default();
        for dir in [args.output.join("plots"), args.output.join("images")] {
            fs::create_dir_all(&dir)
                .map_err(|e| Error::Runtime(format!("cannot create '{}': {e}", dir.display())))?;
        }
        let mut bench = Bench {
            args,
            budgets: budgets(args.time),
            common: Vec::new(),
            report: Report {
                info: RunInfo::new(args.repeats),
                scenes: Vec::new(),
                rows: Vec::new(),
                pictured: BTreeSet::new(),
                notes: Vec::new(),
                baseline: args.baseline.as_ref().map(|file| file.display().to_string()),
                then: Curve::all(&then),
            },
        };
        for (scene, name) in args.scenes.iter().zip(names) {
            bench.add_scene(scene, name)?;
        }
        if cfg!(debug_assertions) {
            bench.note("this is no release build: its times mean little".into());
        }
        let contenders = Contender::all(args);
        let mut out = BTreeSet::new();
        // A slow spell of the machine should not hit all runs of one contender: each has its turn.
        for repeat in 0..args.repeats {
            for (scene, file) in args.scenes.iter().enumerate() {
                for (i, contender) in contenders.iter().enumerate() {
                    if !out.contains(&(scene, i)) && !bench.measure(scene, file, contender, repeat)? {
                        out.insert((scene, i));
                    }
                    // Nothing measured is lost; the rest can be made of it.
                    results::write(&args.output.join("results.csv"), &bench.report.rows)?;
                }
            }
        }
        bench.conclude()
    })
}

/// What scenes are called: by their files, and where these have the same name, as the `scene.xml` of collections do, by
/// their folders.
fn scene_names(scenes: &[PathBuf]) -> Result<Vec<String>> {
    let named = |scene: &Path, folders: usize| {
        let stem = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if folders == 0 {
            return stem;
        }
        // The folder that is meant by `.` or `..` has a name, too.
        let folder = scene.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.into());
        let mut last: Vec<_> = folder.iter().rev().take(folders).map(|name| name.to_string_lossy()).collect();
        last.reverse();
        last.join("-")
    };
    let mut names: Vec<String> = scenes.iter().map(|scene| named(scene, 0)).collect();
    // Folders may have the same name, too.
    for folders in 1..=3 {
        for i in clashing(&names) {
            names[i] = named(&scenes[i], folders);
        }
    }
    match clashing(&names).first() {
        None => Ok(names),
        Some(&i) => {
            let message =
                format!("two scenes are called '{}'; bench them into two directories", named(&scenes[i], 0));
            Err(Error::Usage(message))
        }
    }
}

/// Indices of names that others are mistaken for in file names.
fn clashing(names: &[String]) -> Vec<usize> {
    let slugs: Vec<String> = names.iter().map(|name| results::slug(name)).collect();
    let count = |slug| slugs.iter().filter(|other| *other == slug).count();
    (0..names.len()).filter(|&i| count(&slugs[i]) > 1).collect()
}

/// `time` in seconds, and its halves, quarters and so on before.
fn budgets(time: Duration) -> Vec<f64> {
    (0..=6).rev().map(|k| time.as_secs_f64() / f64::from(1 << k)).collect()
}

/// The largest of `budgets` that `seconds` have used up.
fn budget(budgets: &[f64], seconds: f64) -> Option<f64> {
    budgets.iter().copied().rev().find(|b| *b <= seconds)
}

enum Contender<'a> {
    Own(IntegratorName, BackendName),
    Peer(&'a str),
}

impl Contender<'_> {
    fn all(args: &BenchArgs) -> Vec<Contender<'_>> {
        let integrators: Vec<_> =
            args.integrator.map_or_else(|| IntegratorName::value_variants().into(), |i| vec![i]);
        let available = |b: &BackendName| accel::available().contains(&b.backend());
        let backends: Vec<_> = match args.common.backend {
            Some(backend) => vec![backend],
            None => BackendName::value_variants().iter().copied().filter(available).collect(),
        };
        let own = integrators.iter().flat_map(|&i| backends.iter().map(move |&b| Contender::Own(i, b)));
        own.chain(args.peers.iter().map(|command| Contender::Peer(command))).collect()
    }
}

/// What a contender is to do.
struct Task<'a> {
    file: &'a Path,
    /// The scene's name.
    scene: &'a str,
    /// Pixels of the picture.
    size: (usize, usize),
    /// Seconds, growing.
    budgets: &'a [f64],
    seed: u64,
    threads: usize,
    /// What the command line says of scenes.
    common: &'a SceneArgs,
}

/// A picture, and when it was there.
struct Shot {
    budget: f64,
    seconds: f64,
    /// The work of all processors, if that is known.
    cpu_seconds: Option<f64>,
    load_seconds: f64,
    passes: u64,
    image: Image,
}

/// What came of a [`Task`].
enum Outcome {
    Measured(Method, Vec<Shot>),
    /// Why it was not done.
    Skipped(String),
}

struct Bench<'a> {
    args: &'a BenchArgs,
    /// Seconds, growing.
    budgets: Vec<f64>,
    /// What the command line says of scenes, for each scene with its size.
    common: Vec<SceneArgs>,
    report: Report,
}

impl Bench<'_> {
    fn note(&mut self, note: String) {
        self.args.common.verbosity.note("note: ", &note);
        self.report.notes.push(note);
    }

    fn add_scene(&mut self, file: &Path, name: String) -> Result<()> {
        let kind = self.args.integrator.map(|i| i.kind());
        let mut common = self.args.common.clone();
        let mut prepared = prepare(file, &common, kind)?;
        let given = reference::given(self.args, &name)?;
        if let Some(size) = given.as_ref().and_then(|given| other_size(given, &prepared, &common)) {
            common.size = Some(size);
            common.verbosity = Verbosity { verbose: false, quiet: true };
            prepared = prepare(file, &common, kind)?;
            self.note(format!("{name}: rendered with {}x{} pixels, as its reference", size.0, size.1));
        }
        let reference = match given {
            Some(given) => given.checked(&prepared)?,
            None => reference::computed(self.args, &name, &prepared)?,
        };
        let picture = self.args.output.join("images").join(page::reference_name(&name));
        image_io::write_png(&picture, &reference.image, pictures::exposure(&reference.image))?;
        self.common.push(common);
        self.report.scenes.push(Scene { name, reference });
        Ok(())
    }

    /// Runs `contender` once on a scene; false if it cannot take part. What others have measured is not lost by that.
    fn measure(&mut self, scene: usize, file: &Path, contender: &Contender, repeat: u32) -> Result<bool> {
        let Scene { name, reference } = &self.report.scenes[scene];
        let task = Task {
            file,
            scene: name,
            size: (reference.image.width, reference.image.height),
            budgets: &self.budgets,
            seed: self.args.common.seed.wrapping_add(repeat.into()),
            threads: self.report.info.threads,
            common: &self.common[scene],
        };
        let (name, seed) = (name.clone(), task.seed);
        let outcome = match *contender {
            Contender::Own(integrator, backend) => own::run(integrator, backend, &task)?,
            Contender::Peer(command) => peer::run(command, &task, &self.args.output.join("peer")),
        };
        let (method, shots) = match outcome {
            Outcome::Measured(method, shots) => (method, shots),
            Outcome::Skipped(why) => {
                self.note(format!("{name}: {why}"));
                return Ok(false);
            }
        };
        for shot in &shots {
            let row = self.judge(scene, &method, seed, shot)?;
            self.report.rows.push(row);
        }
        if let Some(last) = shots.last() {
            let row = &self.report.rows[self.report.rows.len() - 1];
            let told =
                format!("{name}: {}, {:.1} s: relmse {:.2e}", method.label(), last.seconds, row.relmse);
            self.args.common.verbosity.note("", &told);
            if repeat == 0 {
                let dir = self.args.output.join("images");
                pictures::write(&dir, &method.slug(), &last.image, &self.report.scenes[scene].reference)?;
                self.report.pictured.insert(method.slug());
            }
        }
        Ok(true)
    }

    fn judge(&self, scene: usize, method: &Method, seed: u64, shot: &Shot) -> Result<Row> {
        let reference = &self.report.scenes[scene].reference;
        let c = metrics::compare(&shot.image, &reference.image)?;
        let Method { scene, renderer, version, integrator, backend } = method.clone();
        Ok(Row {
            scene,
            renderer,
            version,
            integrator,
            backend,
            threads: self.report.info.threads,
            width: shot.image.width,
            height: shot.image.height,
            seed,
            budget: shot.budget,
            seconds: shot.seconds,
            cpu_seconds: shot.cpu_seconds,
            load_seconds: shot.load_seconds,
            passes: shot.passes,
            relmse: c.relmse,
            reference_relmse: reference.relmse,
            rmse: c.rmse,
            mae: c.mae,
            bias_r: c.bias[0],
            bias_g: c.bias[1],
            bias_b: c.bias[2],
            flip: c.flip,
        })
    }

    /// Writes the report, and tells what it says in a few words.
    fn conclude(mut self) -> Result<()> {
        for note in self.report.noisy_references() {
            self.note(note);
        }
        let curves = self.report.write(&self.args.output)?;
        for Curve { method, points } in &curves {
            if let Some(last) = points.last() {
                let (scene, label) = (&method.scene, method.label());
                let relmse = last.error.median;
                let times =
                    [Clock::Wall, Clock::Cpu].map(|clock| Some((clock, last.timed(clock)?.seconds.median)));
                let times =
                    times.into_iter().flatten().map(|(clock, s)| format!("{s:.2} {} s", clock.name()));
                let times = times.collect::<Vec<_>>().join(", ");
                console::result(&format!("{scene}, {label}: relmse {relmse:.2e} in {times}"));
            }
        }
        for scene in &self.report.scenes {
            let curves: Vec<&Curve> = curves.iter().filter(|c| c.method.scene == scene.name).collect();
            if let Some((first, others)) = curves.split_first() {
                for other in others {
                    if let Some(told) = beside(first, other) {
                        console::result(&told);
                    }
                }
            }
        }
        let mut worse = Vec::new();
        for change in self.report.changes(&curves) {
            let label = format!("{}, {}", change.method.scene, change.method.label());
            let verdict = change.verdict.name();
            let clock = change.clock.name();
            console::result(&format!("{label}: cost ×{:.3} ({clock} seconds), {verdict}", change.cost));
            if change.verdict == Verdict::Worse {
                worse.push(label);
            }
        }
        let page = self.args.output.join("index.html");
        self.args.common.verbosity.note("", &format!("{} shows it all", page.display()));
        if worse.is_empty() {
            return Ok(());
        }
        Err(Error::Runtime(format!("worse than the baseline: {}", worse.join("; "))))
    }
}

/// The size of a reference where the scene's film has another one of the same shape, and nobody asked for that.
fn other_size(given: &Reference, prepared: &Prepared, common: &SceneArgs) -> Option<(u32, u32)> {
    let (.., width, height) = prepared.scene.film.crop;
    let (w, h) = (given.image.width, given.image.height);
    let same_shape = w.abs_diff((h * width as usize).div_ceil(height as usize)) <= 1;
    let other = (w, h) != (width as usize, height as usize);
    let size = (u32::try_from(w).ok()?, u32::try_from(h).ok()?);
    (common.size.is_none() && other && same_shape).then_some(size)
}

/// How long `other` takes to the smallest error that both reach, and how that is beside `first`.
fn beside(first: &Curve, other: &Curve) -> Option<String> {
    let clock = Clock::of(&[first, other]);
    let both = |error: f64| Some((error, first.time_to(error, clock)?, other.time_to(error, clock)?));
    let (error, a, b) = results::targets(&[first, other]).into_iter().filter_map(both).next_back()?;
    let time = |t: Reached| format!("{}{:.2}", if t.at_once { "≤ " } else { "" }, t.seconds);
    Some(format!(
        "{}, {} beside {}: relmse {error:.0e} in {} beside {} {} seconds, ×{:.2}",
        other.method.scene,
        other.method.label(),
        first.method.label(),
        time(b),
        time(a),
        clock.name(),
        b.seconds / a.seconds,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_double() {
        assert_eq!(budgets(Duration::from_secs(16)), [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0]);
        assert_eq!(budget(&[1.0, 2.0], 0.9), None);
        assert_eq!(budget(&[1.0, 2.0], 1.9), Some(1.0));
        assert_eq!(budget(&[1.0, 2.0], 7.0), Some(2.0));
    }

    #[test]
    fn names_are_told_apart() {
        let names = |files: &[&str]| scene_names(&files.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(names(&["a/ring.xml", "pool.obj"]).unwrap(), ["ring", "pool"]);
        // The folder has a name where there is something to be told apart, however it is written.
        assert_eq!(names(&["a/scene.xml", "b/scene.xml", "c.xml"]).unwrap(), ["a", "b", "c"]);
        assert_eq!(names(&["src/scene.xml", "scene.xml"]).unwrap()[0], "src");
        assert_ne!(names(&["src/scene.xml", "scene.xml"]).unwrap()[1], "scene");
        assert_eq!(names(&["x/a/s.xml", "y/a/s.xml", "b/s.xml"]).unwrap(), ["x-a", "y-a", "b"]);
        // Neither a folder's name nor one of another spelling is that of another scene.
        assert_eq!(names(&["x/a/s.xml", "y/b/s.xml", "z/a.xml"]).unwrap(), ["x-a", "b", "z"]);
        assert_eq!(names(&["x/a b.xml", "y/a-b.xml"]).unwrap(), ["x", "y"]);
        assert!(names(&["a/ring.xml", "a/ring.xml"]).is_err());
        assert!(names(&["a/ring.xml", "a/ring.obj"]).is_err());
    }
}
