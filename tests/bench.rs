//! `caustica bench` from outside: its files, its page, and its verdict on a baseline.

mod common;

use caustica::image_io;
use common::program::{Dir, stderr};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::Command;

const SCENE: &str = r#"<scene version="3.0.0">
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm">
            <integer name="width" value="12"/>
            <integer name="height" value="8"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <shape type="rectangle"><bsdf type="diffuse"/></shape>
    <shape type="sphere">
        <point name="center" x="1" y="1" z="2"/>
        <float name="radius" value="0.3"/>
        <emitter type="area"><rgb name="radiance" value="5"/></emitter>
    </shape>
</scene>"#;

/// A peer that takes the first picture for its own; what it says of CPU time goes where `CPU` stands.
const PEER: &str = r#"#!/bin/sh
echo '{"renderer": "other 2.0", "method": "path", "backend": "fast"}'
echo '{"seconds": 0.2, CPU"load_seconds": 0.1, "passes": 7, "image": "picture.exr"}'
"#;

impl Dir {
    fn with_scene() -> Dir {
        let dir = Dir::new();
        dir.write("room.xml", SCENE);
        dir
    }

    /// The peer, and its picture.
    fn with_peer(self, cpu: &str) -> Dir {
        self.write("peer", PEER.replace("CPU", cpu));
        fs::set_permissions(self.path("peer"), fs::Permissions::from_mode(0o755)).unwrap();
        self.succeed("render room.xml --passes 4 -q -o picture.exr");
        self
    }

    /// `results.csv` with every value changed, as `then.csv`; columns without a name are left out.
    fn rewrite(&self, change: impl Fn(&str, &str) -> Option<String>) {
        let mut csv = csv::Reader::from_path(self.path("out/results.csv")).unwrap();
        let headers = csv.headers().unwrap().clone();
        let mut writer = csv::Writer::from_path(self.path("then.csv")).unwrap();
        writer.write_record(headers.iter().filter(|h| change(h, "1").is_some())).unwrap();
        for record in csv.records() {
            let record = record.unwrap();
            writer.write_record(headers.iter().zip(&record).filter_map(|(h, v)| change(h, v))).unwrap();
        }
        writer.flush().unwrap();
    }

    fn plot(&self, scene: &str) -> String {
        fs::read_to_string(self.path(&format!("out/plots/{scene}.svg"))).unwrap()
    }

    fn column(&self, name: &str) -> Vec<String> {
        let mut csv = csv::Reader::from_path(self.path("out/results.csv")).unwrap();
        let index = csv.headers().unwrap().iter().position(|h| h == name).unwrap();
        csv.records().map(|r| r.unwrap()[index].to_string()).collect()
    }

    fn page(&self) -> String {
        fs::read_to_string(self.path("out/index.html")).unwrap()
    }
}

/// Values of the attribute `name` in a page.
fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let mark = format!(" {name}=\"");
    page.split(&mark).skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

#[test]
fn measures_reports_and_compares() {
    let dir = Dir::with_scene().with_peer("\"cpu_seconds\": 0.35, ");
    let args =
        "bench room.xml -o out --time 0.4 --repeats 2 --reference-passes 256 --peer ./peer --peer false";
    let stderr = stderr(&dir.succeed(args));
    assert_eq!(stderr.matches("peer 'false' failed").count(), 1, "{stderr}");
    assert!(stderr.contains("256 passes for a reference"), "{stderr}");
    assert!(stderr.contains("the reference's own relmse is "), "{stderr}");

    // Every method at every budget but those that one pass outlasts.
    let methods = 2 * caustica::accel::available().len();
    let renderers = dir.column("renderer");
    let count = |name: &str| renderers.iter().filter(|r| *r == name).count();
    assert_eq!(count("other"), 2);
    assert!(count("caustica") >= 2 * methods && count("caustica") <= 2 * 7 * methods, "{renderers:?}");
    for name in ["seconds", "cpu_seconds", "relmse", "passes", "flip"] {
        assert!(dir.column(name).iter().all(|v| v.parse::<f64>().is_ok_and(|v| v > 0.0)), "{name}");
    }
    // All tell their CPU time, so that is what is compared.
    assert!(dir.column("cpu_seconds").contains(&"0.35".into()));
    assert!(dir.plot("room").contains("CPU seconds"));
    assert_eq!(dir.page().matches("<td>CPU</td>").count(), methods + 1);
    let last: Vec<f64> = dir.column("relmse").iter().map(|v| v.parse().unwrap()).collect();
    assert!(last.iter().all(|e| *e < 1.0), "{last:?}");

    // All that the page names is there, nothing comes from elsewhere, and pictures are pictures.
    let page = dir.page();
    let files: Vec<&str> = [attributes(&page, "src"), attributes(&page, "href")].concat();
    assert!(files.iter().filter(|f| f.ends_with(".png")).count() == 1 + 3 * (methods + 1), "{files:?}");
    for file in files.iter().filter(|f| !f.starts_with('#')) {
        assert!(dir.path("out").join(file).is_file(), "{file}");
        if file.ends_with(".png") {
            let image = image_io::read(&dir.path("out").join(file)).unwrap();
            assert_eq!((image.width, image.height), (12, 8), "{file}");
        }
    }
    assert!(!page.contains("http") && !page.contains("<script"));
    assert!(page.contains("other path fast") && page.contains("peer 'false' failed"));

    // The reference is kept.
    let stderr = common::program::stderr(&dir.succeed(args));
    assert!(!stderr.contains("for a reference"), "{stderr}");
}

#[test]
fn regressions_are_marked() {
    let dir = Dir::with_scene();
    let args =
        "bench room.xml -o out --time 0.3 --repeats 2 --reference-passes 64 --integrator path --backend bvh";
    dir.succeed(args);
    // What was ten times as good is a regression, what was ten times as bad is none.
    for (factor, status) in [(0.1, 1), (10.0, 0)] {
        dir.rewrite(|name, value| match (name, value.parse::<f64>()) {
            ("relmse" | "reference_relmse", Ok(v)) => Some((factor * v).to_string()),
            _ => Some(value.into()),
        });
        let output = dir.run(&format!("{args} --baseline then.csv"));
        let stderr = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{stderr}");
        let page = dir.page();
        let mark = if status == 1 { "class=\"worse\"" } else { "class=\"better\"" };
        assert!(page.contains(mark), "{page}");
        assert_eq!(stderr.contains("worse than the baseline: room, caustica path bvh"), status == 1);
    }
}

/// Files of before there was a column for CPU time, and peers that do not tell theirs, are compared by the wall clock.
#[test]
fn without_cpu_seconds_the_wall_clock_counts() {
    let dir = Dir::with_scene().with_peer("");
    let args = "bench room.xml -o out --time 0.3 --repeats 1 --reference-passes 16 --integrator path --backend bvh \
                --peer ./peer";
    dir.succeed(args);
    let (renderers, cpu) = (dir.column("renderer"), dir.column("cpu_seconds"));
    for (renderer, cpu) in renderers.iter().zip(&cpu) {
        assert_eq!(cpu.is_empty(), renderer == "other", "{renderer}: {cpu}");
    }
    assert!(dir.plot("room").contains("wall seconds"));
    assert_eq!(dir.page().matches("<td>wall</td>").count(), 1);

    let judged = |clock: &str| {
        let output = dir.run(&format!("{args} --baseline then.csv"));
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        let line = told.lines().find(|l| l.starts_with("room, caustica path bvh: cost")).unwrap();
        assert!(line.contains(&format!("({clock} seconds)")), "{line}");
    };
    dir.rewrite(|_, value| Some(value.into()));
    judged("CPU");
    dir.rewrite(|name, value| (name != "cpu_seconds").then(|| value.into()));
    judged("wall");
}

/// Collections call all their scenes `scene.xml`.
#[test]
fn scenes_of_one_name_are_called_by_their_folders() {
    let dir = Dir::with_scene();
    for folder in ["kitchen", "attic"] {
        fs::create_dir(dir.path(folder)).unwrap();
        dir.write(&format!("{folder}/scene.xml"), SCENE.replace("0.3", &format!("0.{}", folder.len())));
    }
    let args =
        "kitchen/scene.xml attic/scene.xml -o out --time 0.1 --repeats 1 --integrator path --backend bvh";
    dir.succeed(&format!("bench {args} --reference-passes 4"));
    let scenes: std::collections::BTreeSet<_> = dir.column("scene").into_iter().collect();
    assert_eq!(scenes.into_iter().collect::<Vec<_>>(), ["attic", "kitchen"]);
    let page = dir.page();
    let sources: Vec<&str> = attributes(&page, "src");
    for name in ["kitchen", "attic"] {
        assert_eq!(sources.iter().filter(|f| f.contains(name)).count(), 5, "{sources:?}");
    }
    assert!(sources.iter().all(|f| dir.path("out").join(f).is_file()), "{sources:?}");
    let picture = |name| fs::read(dir.path(&format!("out/images/{name}-reference.png"))).unwrap();
    assert_ne!(picture("kitchen"), picture("attic"));
    // References go by these names, too.
    let noise = "--reference . --reference-noise scene=0.1";
    dir.fail(&format!("bench {args} {noise}"), 2, &["the scenes are called kitchen, attic"]);
}

/// A scene whose film is larger than its reference is rendered at the reference's size, peers included.
#[test]
fn a_reference_sets_the_size() {
    let dir = Dir::with_scene().with_peer("");
    dir.succeed("render room.xml --size 6x4 --passes 4 -q -o picture.exr");
    let args = "bench room.xml -o out --time 0.1 --repeats 1 --integrator path --backend bvh --peer ./peer";
    let told = stderr(&dir.succeed(&format!("{args} --reference picture.exr")));
    assert!(told.contains("rendered with 6x4 pixels, as its reference"), "{told}");
    assert!(dir.column("width").iter().all(|w| w == "6"));
    assert!(dir.column("renderer").contains(&"other".into()), "{told}");
    dir.fail(&format!("{args} --reference picture.exr --size 12x8"), 2, &["see --size"]);
    dir.succeed("render room.xml --size 6x6 --passes 1 -q -o square.exr");
    dir.fail(&format!("{args} --reference square.exr"), 2, &["has 6x6 pixels, the scene 12x8"]);
}

/// Errors near the reference's own say little, and that is told.
#[test]
fn noisy_references_are_told() {
    let dir = Dir::with_scene();
    let args =
        "bench room.xml -o out --time 0.02 --repeats 1 --integrator path --backend bvh --reference-passes";
    let told = stderr(&dir.succeed(&format!("{args} 2")));
    assert!(told.contains("room: the reference is noisy") && dir.page().contains("is noisy"), "{told}");
    assert!(dir.column("reference_relmse").iter().all(|v| v.parse::<f64>().unwrap() > 0.0));
    let told = stderr(&dir.succeed(&format!("{args} 16384")));
    assert!(!told.contains("is noisy"), "{told}");
}

#[test]
fn mistakes_are_told_before_work_begins() {
    let dir = Dir::with_scene();
    dir.write("no.csv", "a,b\n1,2\n");
    fs::create_dir(dir.path("references")).unwrap();
    for (args, status, expected) in [
        ("room.xml -o out --baseline no.csv", 2, "no.csv: is no results.csv"),
        ("room.xml -o out --baseline none.csv", 2, "none.csv"),
        ("room.xml room.xml -o out", 2, "two scenes are called 'room'"),
        ("none.xml -o out", 2, "none.xml"),
        ("room.xml -o no.csv", 1, "cannot create 'no.csv"),
        ("room.xml -o out --reference references", 2, "references/room.exr"),
        ("room.xml -o out --reference-noise room=1", 2, "--reference"),
    ] {
        dir.fail(&format!("bench {args}"), status, &[expected]);
    }
}

/// The clock of our peers: making a picture, as by a denoiser, counts for that picture only, and writing it for none.
#[test]
fn peers_count_what_a_picture_takes_once() {
    let script = "
import sys, time
sys.path.insert(0, sys.argv[1])
import peer

class Arguments:
    budgets, outdir = [0.1, 0.2, 2.0], '.'

def burn(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

clock, tenths = peer.Clock(Arguments), 1
burn(0.1)
clock.picture(tenths, lambda path, made: burn(0.5), lambda: burn(0.3))
while clock.running():
    burn(0.1)
    tenths += 1
    clock.picture(tenths, lambda path, made: None)
";
    let peers = concat!(env!("CARGO_MANIFEST_DIR"), "/bench/peers");
    let Ok(output) = Command::new("python3").args(["-B", "-c", script, peers]).output() else {
        return println!("skipped: python3 is not installed");
    };
    assert!(output.status.success(), "{}", stderr(&output));
    let told = String::from_utf8_lossy(&output.stdout);
    let lines: Vec<serde_json::Value> = told.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    // The first picture outlasts the second budget.
    assert_eq!(lines.len(), 2, "{told}");
    let value = |line: usize, name: &str| lines[line][name].as_f64().unwrap();
    for (line, expected) in [(0, 0.4), (1, 0.1 * value(1, "passes"))] {
        let cpu = value(line, "cpu_seconds");
        assert!((cpu - expected).abs() < 0.15, "{told}");
        assert!(value(line, "seconds") > 0.99 * expected, "{told}");
    }
}

/// A page is judged by a browser, where there is one: every picture loads from the file system.
#[test]
fn chromium_shows_the_page() {
    let dirs = std::env::var_os("PATH").unwrap_or_default();
    let found: Option<PathBuf> =
        std::env::split_paths(&dirs).map(|dir| dir.join("chromium")).find(|p| p.is_file());
    let Some(chromium) = found else { return println!("skipped: chromium is not installed") };
    let dir = Dir::with_scene();
    dir.succeed(
        "bench room.xml -o out --time 0.2 --repeats 1 --reference-passes 16 --integrator path --backend bvh",
    );
    let page = dir.page();
    let count = "<script>onload = () => { const all = [...document.images]; document.title = 'loaded ' + \
                 all.filter(i => i.complete && i.naturalWidth > 0).length + ' of ' + all.length }</script></body>";
    dir.write("out/check.html", page.replace("</body>", count));
    let output = Command::new(chromium)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--disable-background-networking",
        ])
        .args(["--disable-component-update", "--disable-sync", "--virtual-time-budget=5000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", dir.path("profile").display()))
        .arg(format!("file://{}", dir.path("out/check.html").display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&output.stdout);
    // Plot, reference, and three pictures of the one method.
    assert!(dom.contains("<title>loaded 5 of 5</title>"), "{dom}");
}
