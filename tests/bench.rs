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

/// A peer that takes the first picture for its own.
const PEER: &str = r#"#!/bin/sh
echo '{"renderer": "other 2.0", "method": "path", "backend": "fast"}'
echo '{"seconds": 0.2, "load_seconds": 0.1, "passes": 7, "image": "picture.exr"}'
"#;

impl Dir {
    fn with_scene() -> Dir {
        let dir = Dir::new();
        dir.write("room.xml", SCENE);
        dir
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
    let dir = Dir::with_scene();
    dir.write("peer", PEER);
    fs::set_permissions(dir.path("peer"), fs::Permissions::from_mode(0o755)).unwrap();
    dir.succeed("render room.xml --passes 4 -q -o picture.exr");

    let args =
        "bench room.xml -o out --time 0.4 --repeats 2 --reference-passes 256 --peer ./peer --peer false";
    let stderr = stderr(&dir.succeed(args));
    assert_eq!(stderr.matches("peer 'false' failed").count(), 1, "{stderr}");
    assert!(stderr.contains("256 passes for a reference"), "{stderr}");

    // Every method at every budget but those that one pass outlasts.
    let methods = 2 * caustica::accel::available().len();
    let renderers = dir.column("renderer");
    let count = |name: &str| renderers.iter().filter(|r| *r == name).count();
    assert_eq!(count("other"), 2);
    assert!(count("caustica") >= 2 * methods && count("caustica") <= 2 * 7 * methods, "{renderers:?}");
    for name in ["seconds", "relmse", "passes", "flip"] {
        assert!(dir.column(name).iter().all(|v| v.parse::<f64>().is_ok_and(|v| v > 0.0)), "{name}");
    }
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
        let mut csv = csv::Reader::from_path(dir.path("out/results.csv")).unwrap();
        let headers = csv.headers().unwrap().clone();
        let mut writer = csv::Writer::from_path(dir.path("then.csv")).unwrap();
        writer.write_record(&headers).unwrap();
        for record in csv.records() {
            let record = record.unwrap();
            let values = headers.iter().zip(&record).map(|(h, v)| match (h, v.parse::<f64>()) {
                ("relmse" | "reference_relmse", Ok(v)) => (factor * v).to_string(),
                _ => v.to_string(),
            });
            writer.write_record(values).unwrap();
        }
        writer.flush().unwrap();
        let output = dir.run(&format!("{args} --baseline then.csv"));
        let stderr = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{stderr}");
        let page = dir.page();
        let mark = if status == 1 { "class=\"worse\"" } else { "class=\"better\"" };
        assert!(page.contains(mark), "{page}");
        assert_eq!(stderr.contains("worse than the baseline: room, caustica path bvh"), status == 1);
    }
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
