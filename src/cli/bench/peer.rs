//! Other renderers, run by a command that keeps to the contract in `bench/peers/README.md`.

use super::results::Method;
use super::{Outcome, Shot, Task, budget};
use caustica::image_io;
use serde::Deserialize;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// A line about a picture.
#[derive(Deserialize)]
struct Picture {
    seconds: f64,
    /// Not all can tell.
    cpu_seconds: Option<f64>,
    load_seconds: f64,
    passes: u64,
    image: PathBuf,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    Skipped {
        skipped: String,
    },
    Picture(Picture),
    Renderer {
        /// Name and version, with a space between.
        renderer: String,
        method: String,
        backend: String,
    },
}

/// Beyond its last budget a peer gets so much time to load, compile and write.
const GRACE: Duration = Duration::from_secs(600);

/// Runs `command`, which leaves its pictures in `dir`; that is made, and removed.
pub(super) fn run(command: &str, task: &Task, dir: &Path) -> Outcome {
    let done = fs::create_dir_all(dir)
        .map_err(|e| format!("'{}' cannot be created: {e}", dir.display()))
        .and_then(|()| execute(command, task, dir))
        .and_then(|lines| outcome(&lines, task));
    // What cannot be removed now will be overwritten.
    let _ = fs::remove_dir_all(dir);
    match done {
        Ok(Outcome::Skipped(why)) => Outcome::Skipped(format!("peer '{command}' is left out: {why}")),
        Ok(measured) => measured,
        Err(why) => Outcome::Skipped(format!("peer '{command}' failed: {why}")),
    }
}

/// All lines that it prints.
fn execute(command: &str, task: &Task, dir: &Path) -> Result<Vec<String>, String> {
    let log = dir.join("stderr.txt");
    let stderr = File::create(&log).map_err(|e| e.to_string())?;
    let list: Vec<String> = task.budgets.iter().map(f64::to_string).collect();
    let mut child = Command::new("sh")
        .args(["-c", &format!("{command} \"$@\""), "peer"])
        .args([task.file, dir])
        .args(["--budgets", &list.join(",")])
        .args(["--size", &format!("{}x{}", task.size.0, task.size.1)])
        .args(["--seed", &task.seed.to_string(), "--threads", &task.threads.to_string()])
        .args(task.common.define.iter().flat_map(|(name, value)| ["-D".into(), format!("{name}={value}")]))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(stderr)
        .spawn()
        .map_err(|e| format!("it cannot be started: {e}"))?;
    let deadline = Instant::now() + GRACE + Duration::from_secs_f64(task.budgets.iter().sum());
    let lines = lines(&mut child, deadline);
    if lines.is_err() {
        // It may have ended by itself.
        let _ = child.kill();
    }
    let status = child.wait().map_err(|e| e.to_string())?;
    let lines = lines?;
    if !status.success() {
        let said = fs::read(&log).unwrap_or_default();
        let said = String::from_utf8_lossy(&said);
        let last = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("it does not say why");
        return Err(format!("{status}: {last}"));
    }
    Ok(lines)
}

/// What the peer prints, until it closes its output.
fn lines(child: &mut Child, deadline: Instant) -> Result<Vec<String>, String> {
    let Some(out) = child.stdout.take() else { return Err("it has no output".into()) };
    let (send, receive) = mpsc::channel();
    thread::spawn(move || BufReader::new(out).lines().map_while(|l| l.ok()).try_for_each(|l| send.send(l)));
    let mut lines = Vec::new();
    loop {
        match receive.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
            Ok(line) => lines.push(line),
            Err(RecvTimeoutError::Disconnected) => return Ok(lines),
            Err(RecvTimeoutError::Timeout) => return Err("it does not come to an end".into()),
        }
    }
}

fn outcome(lines: &[String], task: &Task) -> Result<Outcome, String> {
    let mut found: Option<(Method, Vec<Shot>)> = None;
    // Renderers like to print things, too.
    for line in lines.iter().filter(|l| l.starts_with('{')) {
        match (serde_json::from_str(line), &mut found) {
            (Ok(Line::Skipped { skipped }), _) => return Ok(Outcome::Skipped(skipped)),
            (Ok(Line::Renderer { renderer, method, backend }), None) => {
                let (name, version) = renderer.rsplit_once(' ').unwrap_or((&renderer, ""));
                let method = Method {
                    scene: task.scene.into(),
                    renderer: name.into(),
                    version: version.into(),
                    integrator: method,
                    backend,
                };
                found = Some((method, Vec::new()));
            }
            (Ok(Line::Picture(picture)), Some((_, shots))) => shots.push(shot(picture, task)?),
            (Ok(_), _) => return Err(format!("it says at an unexpected place: {line}")),
            (Err(e), _) => return Err(format!("it says what is not understood ({e}): {line}")),
        }
    }
    match found {
        Some((method, shots)) if !shots.is_empty() => Ok(Outcome::Measured(method, shots)),
        _ => Err("it made no picture".into()),
    }
}

fn shot(picture: Picture, task: &Task) -> Result<Shot, String> {
    let Picture { seconds, cpu_seconds, load_seconds, passes, image: file } = picture;
    let image = image_io::read(&file).map_err(|e| e.to_string())?;
    if (image.width, image.height) != task.size {
        return Err(format!("its picture has {}x{} pixels", image.width, image.height));
    }
    // Its clock may differ from its budgets by rounding.
    let budget = budget(task.budgets, seconds * 1.001)
        .ok_or_else(|| format!("it made a picture after {seconds} s, before its first budget"))?;
    Ok(Shot { budget, seconds, cpu_seconds, load_seconds, passes, image })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::{Cli, Command as Subcommand};
    use caustica::image_io::{Channels, Image, Layer, Metadata, SampleType};
    use caustica::math::Rgb;
    use clap::Parser;

    fn peer(script: &str) -> Outcome {
        let dir = tempfile::tempdir().unwrap();
        let image = Image { width: 4, height: 3, pixels: vec![Rgb::ONE; 12] };
        let layer = Layer { name: String::new(), image, channels: Channels::Rgb };
        image_io::write_exr(&dir.path().join("a.exr"), &[layer], &Metadata::default(), SampleType::Float)
            .unwrap();
        let args = Cli::parse_from(["caustica", "bench", "x.xml", "-o", "y", "-D", "a=b c"]);
        let Subcommand::Bench(args) = args.command else { panic!() };
        let task = Task {
            file: Path::new("x y.xml"),
            scene: "x",
            budgets: &[0.5, 1.0],
            size: (4, 3),
            seed: 7,
            threads: 2,
            common: &args.common,
        };
        run(&script.replace("DIR", &dir.path().display().to_string()), &task, &dir.path().join("peer"))
    }

    const HEAD: &str = r#"{"renderer": "mitsuba 3.9", "method": "path", "backend": "x"}"#;

    /// A command that prints these lines.
    fn print(lines: &[&str]) -> String {
        let quoted: Vec<String> = lines.iter().map(|l| format!("'{l}'")).collect();
        format!("printf '%s\\n' {} #", quoted.join(" "))
    }

    #[test]
    fn contract() {
        let picture = r#"{"seconds": 0.7, "load_seconds": 0.5, "passes": 3, "image": "DIR/a.exr"}"#;
        let Outcome::Measured(method, shots) = peer(&print(&[HEAD, "chatter", picture])) else { panic!() };
        assert_eq!((method.renderer.as_str(), method.version.as_str()), ("mitsuba", "3.9"));
        assert_eq!((shots[0].passes, shots[0].budget, shots[0].seconds), (3, 0.5, 0.7));
        assert_eq!((shots[0].image.pixels[0], shots[0].cpu_seconds), (Rgb::ONE, None));
        let telling = picture.replace("0.7", "0.7, \"cpu_seconds\": 1.3");
        let Outcome::Measured(_, shots) = peer(&print(&[HEAD, &telling])) else { panic!() };
        assert_eq!(shots[0].cpu_seconds, Some(1.3));
        // Arguments arrive one by one.
        let echo =
            r#"f() { printf '{"skipped": "%s|%s|%s|%s|%s|%s"}\n' "$1" "$4" "$6" "$8" "${10}" "${12}"; }; f"#;
        let Outcome::Skipped(why) = peer(echo) else { panic!() };
        assert!(why.ends_with("is left out: x y.xml|0.5,1|4x3|7|2|a=b c"), "{why}");
    }

    #[test]
    fn failures_say_why() {
        let says = |script: &str, expected: &str| {
            let Outcome::Skipped(why) = peer(script) else { panic!() };
            assert!(why.contains("failed") && why.contains(expected), "{why}");
        };
        says("f() { echo first >&2; echo no licence >&2; exit 3; }; f", "3: no licence");
        says("no-such-program-here", "not found");
        says("true", "made no picture");
        says(&print(&[r#"{"seconds": 1}"#]), "not understood");
        let picture = r#"{"seconds": 1, "load_seconds": 0, "passes": 1, "image": "DIR/b.exr"}"#;
        says(&print(&[picture]), "unexpected place");
        says(&print(&[HEAD, picture]), "b.exr");
        let early = r#"{"seconds": 0.1, "load_seconds": 0, "passes": 1, "image": "DIR/a.exr"}"#;
        says(&print(&[HEAD, early]), "before its first budget");
    }
}
