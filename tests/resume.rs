//! Checkpoints, resuming, pass ranges and merging: the same pixels however passes are spread, and no file is trusted.

mod common;

use caustica::Error;
use caustica::accel::Backend;
use caustica::image_io;
use caustica::integrator::{Budget, Kind, Layout, Options, Rendering, State};
use caustica::math::{Sampler, Stream};
use caustica::part_file::{self, Identity};
use caustica::scene::Scene;
use common::program::{Dir, signal, stderr};
use common::{backends, params};
use exr::prelude as ex;
use std::fs;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A glass ball over a textured floor and a mesh, under a lamp.
const SCENE: &str = r#"<scene version="3.0.0">
    <default name="albedo" value="0.5"/>
    <integrator type="photonmap">
        <integer name="global_photons" value="1500"/>
        <integer name="caustic_photons" value="1500"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="0, 1, 5" target="0, 0.8, 0" up="0, 1, 0"/></transform>
        <sampler type="independent"><integer name="sample_count" value="3"/></sampler>
        <film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="9"/></film>
    </sensor>
    <shape type="rectangle">
        <transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/></transform>
        <bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="floor.png"/>
        </texture></bsdf>
    </shape>
    <shape type="obj">
        <string name="filename" value="wall.obj"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="$albedo"/></bsdf>
    </shape>
    <shape type="sphere">
        <point name="center" x="0" y="0.7" z="0"/><float name="radius" value="0.5"/>
        <bsdf type="dielectric"/>
    </shape>
    <shape type="rectangle">
        <transform name="to_world">
            <scale value="0.3"/><rotate x="1" angle="90"/><translate x="0" y="2" z="0"/>
        </transform>
        <emitter type="area"><rgb name="radiance" value="10"/></emitter>
    </shape>
</scene>
"#;

const WALL: &str = "v -2 0 -1\nv 2 0 -1\nv 2 3 -1\nv -2 3 -1\nf 1 2 3\nf 1 3 4\n";

impl Dir {
    fn with_scene() -> Dir {
        let dir = Dir::new();
        dir.write("a.xml", SCENE);
        dir.write("wall.obj", WALL);
        dir.floor(200);
        dir
    }

    fn floor(&self, blue: u8) {
        let picture = image::RgbImage::from_fn(4, 4, |x, y| image::Rgb([50 * x as u8, 60 * y as u8, blue]));
        picture.save(self.path("floor.png")).unwrap();
    }

    /// All channels of an EXR: names and bits of the samples.
    fn channels(&self, name: &str) -> Vec<(String, Vec<u32>)> {
        let image = ex::read_first_flat_layer_from_file(self.path(name)).unwrap();
        let channels = image.layer_data.channel_data.list.iter();
        let bits =
            |c: &ex::AnyChannel<ex::FlatSamples>| c.sample_data.values_as_f32().map(f32::to_bits).collect();
        channels.map(|c| (c.name.to_string(), bits(c))).collect()
    }

    /// The range of a part that must be sound.
    #[track_caller]
    fn range(&self, name: &str) -> Range<u32> {
        part_file::read(&self.path(name)).unwrap().1.range()
    }

    fn hidden_files(&self) -> usize {
        self.names().iter().filter(|name| name.starts_with('.')).count()
    }

    fn scene(&self, backend: Backend) -> Scene {
        let description = caustica::scene::load(&self.path("a.xml"), &[], None).unwrap();
        Scene::new(description, backend).unwrap()
    }
}

fn options(integrator: Kind, passes: u32) -> Options {
    let params = params(&["global_photons=1500", "caustic_photons=1500"]);
    Options { integrator, params, seed: 3, budget: Budget::Passes(passes), aovs: true }
}

/// Goes on until the state holds `passes` passes.
fn go_on(state: &mut State, scene: &Scene, options: &Options, passes: u32) {
    let options = Options { budget: Budget::Passes(passes), ..options.clone() };
    state.render(scene, &options, &mut |_, _| ControlFlow::Continue(()));
}

#[track_caller]
fn assert_same(a: &Rendering, b: &Rendering, what: &str) {
    assert!(a.image == b.image, "{what}: the pictures differ");
    assert_eq!(a.layers.len(), b.layers.len());
    for (a, b) in a.layers.iter().zip(&b.layers) {
        assert!(a.name == b.name && a.image == b.image, "{what}: layer {}", a.name);
    }
}

/// A number below `n`, drawn by the `i`-th of seeded draws.
fn draw(i: u64, n: usize) -> usize {
    ((Sampler::new(7, Stream::Eye, i, 0).next_1d() * n as f32) as usize).min(n - 1)
}

#[test]
fn kept_and_taken_up_again() {
    let dir = Dir::with_scene();
    let file = dir.path("c.part");
    for backend in backends() {
        let scene = dir.scene(backend);
        for kind in [Kind::Photonmap, Kind::Path] {
            let options = options(kind, 9);
            let identity = Identity::new(&scene, backend, &options);
            let mut whole = State::new(&scene, &options, 0).unwrap();
            go_on(&mut whole, &scene, &options, 9);
            let mut state = State::new(&scene, &options, 0).unwrap();
            for passes in [1, 2, 5, 9] {
                go_on(&mut state, &scene, &options, passes);
                part_file::write(&file, &identity, "a.xml", &state).unwrap();
                let (header, read) = part_file::read(&file).unwrap();
                assert_eq!((header.range(), read.range()), (0..passes, 0..passes));
                assert_eq!(header.identity.difference(&identity), None);
                assert_eq!(read.statistics.rays, state.statistics.rays);
                state = read;
            }
            assert_same(&whole.resolve(), &state.resolve(), &format!("{} {kind:?}", backend.name()));
        }
    }
}

/// Where a render stops by its error does not depend on breaks in between.
#[test]
fn error_budget_is_met_at_the_same_pass() {
    let dir = Dir::with_scene();
    let backend = backends().next().unwrap();
    let scene = dir.scene(backend);
    let mut options = options(Kind::Photonmap, 0);
    let mut goal = State::new(&scene, &options, 0).unwrap();
    let error = |passes| {
        go_on(&mut goal, &scene, &options, passes);
        goal.resolve().error.total() as f32
    };
    // Not met within the first 24 passes, where estimates are made after every one.
    options.budget = Budget::Error((4..=24).map(error).fold(1.0, f32::min) * 0.99);
    let mut whole = State::new(&scene, &options, 0).unwrap();
    whole.render(&scene, &options, &mut |_, _| ControlFlow::Continue(()));
    let passes = whole.range().end;
    assert!(passes > 24, "too few to tell: {passes}");
    let mut state = State::new(&scene, &options, 0).unwrap();
    // After each pass, and once more when all is done.
    for _ in 0..passes + 1 {
        state.render(&scene, &options, &mut |_, _| ControlFlow::Break(()));
    }
    assert_eq!(state.range().end, passes);
}

#[test]
fn merged_ranges_are_the_single_run() {
    let dir = Dir::with_scene();
    let bounds = [0, 1, 4, 5, 10, 12, 13, 16];
    for backend in backends() {
        for integrator in ["photonmap", "path"] {
            let common =
                format!("render a.xml -q --aovs --backend {} --integrator {integrator}", backend.name());
            dir.succeed(&format!("{common} --passes 16 -o whole.exr --stats whole.json"));
            let whole = dir.channels("whole.exr");
            assert!(whole.len() > 20, "{}", whole.len());
            for pair in bounds.windows(2) {
                dir.succeed(&format!("{common} --pass-range {}..{} --threads 2", pair[0], pair[1]));
            }
            let name = |i: usize| format!("a.{}-{}.part", bounds[i], bounds[i + 1]);
            let names = |order: &[usize]| order.iter().map(|&i| name(i)).collect::<Vec<_>>().join(" ");
            assert_eq!(dir.range(&name(3)), 5..10);

            dir.succeed(&format!("merge -q {} -o m.exr --stats m.json", names(&[4, 1, 6, 0, 3, 2, 5])));
            assert!(dir.channels("m.exr") == whole, "shuffled");
            let (one, many) = (dir.json("whole.json"), dir.json("m.json"));
            for key in
                ["passes", "first_pass", "rays", "photons", "width", "seed", "skipped", "backend", "scene"]
            {
                assert_eq!(one[key], many[key], "{key}");
            }
            assert_eq!(one["estimated_noise"], many["estimated_noise"]);

            dir.succeed(&format!("merge -q {} -o low.part", names(&[2, 1, 3])));
            assert_eq!(dir.range("low.part"), 1..10);
            dir.succeed(&format!("merge -q {} -o high.part", names(&[6, 5])));
            dir.succeed(&format!("merge -q high.part low.part {} -o h.exr", names(&[4, 0])));
            assert!(dir.channels("h.exr") == whole, "by groups");
            dir.succeed(&format!("merge -q high.part low.part {} -o h.png --exposure 1", names(&[4, 0])));
            assert_eq!(image_io::read(&dir.path("h.png")).unwrap().width, 12);
            dir.succeed(&format!("merge -q high.part low.part {} -o h.exr --half", names(&[4, 0])));
        }
    }
}

#[test]
fn checkpoints_change_nothing() {
    let dir = Dir::with_scene();
    let common = "render a.xml -q --aovs --checkpoint c.part --checkpoint-interval 0.001";
    dir.succeed("render a.xml -q --aovs --passes 12 -o whole.exr --stats whole.json");
    let whole = dir.channels("whole.exr");
    dir.succeed(&format!("{common} --passes 12 -o b.exr"));
    assert!(dir.channels("b.exr") == whole, "checkpointed");
    // A checkpoint is a part, too.
    dir.succeed("merge c.part -q -o b.exr");
    assert!(dir.channels("b.exr") == whole, "from the checkpoint");

    dir.succeed(&format!("{common} --passes 1 -o b.exr"));
    for passes in [4, 5, 12] {
        let stats = "--stats b.json";
        dir.succeed(&format!("{common} --resume c.part --passes {passes} -o b.exr {stats}"));
        assert_eq!(dir.range("c.part"), 0..passes);
    }
    assert!(dir.channels("b.exr") == whole, "resumed");
    let (one, many) = (dir.json("whole.json"), dir.json("b.json"));
    assert_eq!((&one["rays"], &one["photons"]), (&many["rays"], &many["photons"]));
    assert!(many["seconds"]["total"].as_f64() > many["seconds"]["eye"].as_f64());
    // Equally many: the image alone is written.
    fs::remove_file(dir.path("b.exr")).unwrap();
    dir.succeed("render a.xml -q --aovs --resume c.part --passes 12 -o b.exr --stats b.json");
    assert!(dir.channels("b.exr") == whole, "written again");
    assert_eq!(dir.json("b.json")["rays"], one["rays"]);
    dir.fail("render a.xml -q --aovs --resume c.part --passes 11", 2, &["c.part", "11", "--passes", "merge"]);
    dir.fail("render a.xml -q --aovs --resume c.part", 2, &["c.part", "passes 0 to 11", "3", "--passes"]);
    // Time counts from this run's start.
    dir.succeed("render a.xml -q --aovs --resume c.part --time 1 -o b.exr --checkpoint c.part");
    assert!(dir.range("c.part").end > 12);

    // A range is resumed, too, and its part may be its own checkpoint.
    let range = "render a.xml -q --aovs --pass-range";
    dir.succeed(&format!("{range} 5..7 -o r.part --checkpoint r.part"));
    dir.fail(&format!("{range} 5..6 -o r.part --resume r.part"), 2, &["r.part", "passes 5 to 6"]);
    dir.fail(&format!("{range} 4..9 -o r.part --resume r.part"), 2, &["r.part", "pass 5", "not 4"]);
    dir.fail("render a.xml -q --aovs --resume r.part", 2, &["r.part", "pass 5", "--pass-range"]);
    dir.succeed(&format!("{range} 5..12 -o r.part --checkpoint r.part --resume r.part"));
    dir.succeed(&format!("{range} 0..5"));
    dir.succeed("merge -q r.part a.0-5.part -o b.exr");
    assert!(dir.channels("b.exr") == whole, "from ranges");
    assert_eq!(dir.hidden_files(), 0);
}

/// Kills a render `kills` times at random moments and resumes it, then lets it end.
fn kill_and_resume(kills: usize, passes: u32, longest: usize) {
    let dir = Dir::with_scene();
    let common = format!("render a.xml -q --aovs --passes {passes}");
    dir.succeed(&format!("{common} -o whole.exr"));
    let (mut killed, mut tries, mut done) = (0, 0, 0);
    while killed < kills {
        let resume = if dir.path("c.part").exists() { "--resume c.part" } else { "" };
        let args = format!("{common} {resume} --checkpoint c.part --checkpoint-interval 0.0001 -o b.exr");
        let mut child = dir.command(&args).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(draw(tries, longest) as u64));
        child.kill().unwrap();
        match child.wait().unwrap().code() {
            None => killed += 1,
            Some(code) => assert_eq!(code, 0),
        }
        tries += 1;
        if dir.path("c.part").exists() {
            let range = dir.range("c.part");
            assert!(range.start == 0 && range.end >= done, "work is lost: {range:?} after {done}");
            done = range.end;
            if done == passes {
                // Nothing is left to be killed: from the start again.
                fs::remove_file(dir.path("c.part")).unwrap();
                done = 0;
            }
        }
        assert!(tries < 100 * kills as u64, "renders too fast to be killed");
    }
    let resume = if dir.path("c.part").exists() { "--resume c.part" } else { "" };
    dir.succeed(&format!("{common} {resume} -o b.exr"));
    assert!(dir.channels("b.exr") == dir.channels("whole.exr"));
    println!("{killed} kills in {tries} runs, the last one at pass {done} of {passes}");
}

#[test]
fn killed_and_resumed() {
    kill_and_resume(5, 60, 100);
}

#[test]
#[ignore = "takes a minute"]
fn killed_twenty_times_and_resumed() {
    for round in 0..5 {
        kill_and_resume(20, 500 + round, 400);
    }
}

/// As batch systems end jobs: TERM, maybe twice.
#[test]
#[cfg(unix)]
fn terminated_and_resumed() {
    let dir = Dir::with_scene();
    let args = "render a.xml -q --time 60 -o b.exr --checkpoint c.part --stats s.json";
    let child = dir.command(args).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(1));
    for _ in 0..2 {
        signal(&child, "TERM");
    }
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(130), "{}", stderr(&out));
    assert_eq!(dir.json("s.json")["interrupted"], true);
    let passes = dir.range("c.part").end;
    assert_eq!(dir.json("s.json")["passes"], passes);
    dir.succeed("merge c.part -q -o m.exr");
    assert!(dir.channels("m.exr") == dir.channels("b.exr"));
    dir.succeed(&format!("render a.xml -q --resume c.part --passes {} -o b.exr", passes + 2));
    dir.succeed(&format!("render a.xml -q --passes {} -o m.exr", passes + 2));
    assert!(dir.channels("m.exr") == dir.channels("b.exr"));
}

#[test]
#[cfg(target_os = "linux")]
fn full_disk() {
    let dir = Dir::with_scene();
    dir.succeed("render a.xml -q --passes 1 -o whole.exr");
    // The checkpoint cannot be written: told at once, an error in the end, but there is an image.
    let out = dir
        .command("render a.xml --passes 1 -o b.exr --checkpoint /dev/full --checkpoint-interval 0.0001")
        .output()
        .unwrap();
    let text = stderr(&out);
    assert_eq!(out.status.code(), Some(1), "{text}");
    assert!(
        text.contains("warning: cannot write '/dev/full'") && text.contains("error: cannot write"),
        "{text}"
    );
    assert!(dir.channels("b.exr") == dir.channels("whole.exr"));
    // The image cannot be written: there is a checkpoint.
    std::os::unix::fs::symlink("/dev/full", dir.path("full.exr")).unwrap();
    std::os::unix::fs::symlink("/dev/full", dir.path("full.part")).unwrap();
    dir.fail("render a.xml -q --passes 1 -o full.exr --checkpoint c.part", 1, &["full.exr"]);
    dir.succeed("merge c.part -q -o b.exr");
    assert!(dir.channels("b.exr") == dir.channels("whole.exr"));
    dir.fail("render a.xml -q --pass-range 0..1 -o full.part", 1, &["full.part"]);
    dir.fail("merge c.part -o full.part", 1, &["full.part"]);
    dir.fail("merge c.part -o full.exr", 1, &["full.exr"]);

    // Files may grow to 8 KiB: enough for the image, not for the part.
    dir.succeed("render a.xml -q --passes 2 -o b.exr --checkpoint c.part");
    let before = fs::read(dir.path("c.part")).unwrap();
    assert!(before.len() > 16_384);
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$@\"";
    let out = Command::new("bash")
        .args([
            "-c",
            script,
            "bash",
            env!("CARGO_BIN_EXE_caustica"),
            "render",
            "a.xml",
            "-q",
            "--passes",
            "4",
        ])
        .args([
            "--resume",
            "c.part",
            "--checkpoint",
            "c.part",
            "--checkpoint-interval",
            "0.0001",
            "-o",
            "b.exr",
        ])
        .current_dir(dir.root())
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", stderr(&out));
    assert!(stderr(&out).contains("cannot write 'c.part'"), "{}", stderr(&out));
    assert!(fs::read(dir.path("c.part")).unwrap() == before, "the last good file is gone");
    assert_eq!(dir.hidden_files(), 0);
}

/// A file system with room for one part and a half.
#[test]
#[cfg(target_os = "linux")]
fn full_file_system() {
    struct Mounted(PathBuf);
    impl Drop for Mounted {
        fn drop(&mut self) {
            let _ = Command::new("umount").arg(&self.0).status();
        }
    }
    let dir = Dir::with_scene();
    let small = dir.path("small");
    fs::create_dir(&small).unwrap();
    dir.succeed("render a.xml -q --passes 2 -o b.exr --checkpoint c.part");
    let size = format!("size={}", fs::metadata(dir.path("c.part")).unwrap().len() * 3 / 2);
    let mount = Command::new("mount")
        .args(["-t", "tmpfs", "-o", &size, "caustica-test"])
        .arg(&small)
        .stderr(Stdio::null())
        .status();
    if !mount.is_ok_and(|status| status.success()) {
        println!("skipped: no right to mount a file system");
        return;
    }
    let _mounted = Mounted(small.clone());
    dir.succeed("render a.xml -q --passes 2 -o b.exr --checkpoint small/c.part");
    let before = fs::read(small.join("c.part")).unwrap();
    let args = "render a.xml -q --passes 4 -o b.exr --resume small/c.part --checkpoint small/c.part";
    dir.fail(args, 1, &["small/c.part", "space"]);
    assert!(fs::read(small.join("c.part")).unwrap() == before, "the last good file is gone");
    assert_eq!(fs::read_dir(&small).unwrap().count(), 1, "the file that did not fit was left");
    dir.succeed("render a.xml -q --passes 4 -o b.exr --resume small/c.part");
}

/// Cut off anywhere, changed anywhere: refused as a file, never a panic.
#[test]
fn damaged_parts() {
    let dir = Dir::with_scene();
    dir.succeed("render a.xml -q --passes 2 -o b.exr --checkpoint c.part");
    let good = fs::read(dir.path("c.part")).unwrap();
    let file = dir.path("d.part");
    let refused = |bytes: &[u8], what: &str| {
        fs::write(&file, bytes).unwrap();
        match part_file::read(&file) {
            Err(Error::File { message, .. }) => message,
            other => panic!("{what}: {other:?}"),
        }
    };
    // All of the header and its surroundings, and a sample of the rest.
    let offsets = (0..1500)
        .step_by(7)
        .chain((0..150).map(|i| 1500 + draw(i, good.len() - 1500)))
        .chain([good.len() - 1]);
    for (i, at) in offsets.enumerate() {
        let message = refused(&good[..at], "cut");
        assert!(message.contains("cut short") || message.contains("no part"), "cut at {at}: {message}");
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (i % 8);
        refused(&bytes, "flipped");
    }
    assert!(refused(&[&good[..], b"x"].concat(), "longer").contains("damaged"));
    let long = [&good[..12], &[255; 4], &good[16..]].concat();
    assert!(refused(&long, "long header").contains("damaged"));
    assert!(refused(&[&good[..8], &[9], &good[9..]].concat(), "newer").contains("format 9"));
    assert!(refused(&fs::read(dir.path("b.exr")).unwrap(), "foreign").contains("no part"));

    // Sound by its checksums, absurd by what it claims.
    let header_length = u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    let header = std::str::from_utf8(&good[16..16 + header_length]).unwrap();
    for (from, to) in [
        (r#"[12,9]"#, "[4000000000,4000000000]"),
        (r#"12,9]"#, "400000,400000]"),
        (r#"12,9]"#, "0,0]"),
        (r#""passes":[1,1]"#, r#""passes":[4294967295,4294967295]"#),
        (r#""passes":[1,1]"#, r#""passes":[0,0]"#),
        (r#""first":0"#, r#""first":4294967295"#),
        (r#""first":0"#, r#""first":-1"#),
        (r#""rays":"#, r#""rays":9"#),
        (r#""aovs":false"#, r#""aovs":true"#),
        (r#""identity""#, r#""identitty""#),
        ("{", "["),
    ] {
        let changed = match from {
            // Far beyond what sums of counts can hold.
            r#""rays":"# => header.replacen(from, r#""rays":18446744073709551615,"x":"#, 1),
            _ => header.replace(from, to),
        };
        assert_ne!(changed, header, "{from}");
        let mut bytes = [&good[..12], &(changed.len() as u32).to_le_bytes(), changed.as_bytes()].concat();
        for rest in [&good[16 + header_length + 16..good.len() - 16], &[]] {
            bytes.extend(xxhash_rust::xxh3::xxh3_128(&bytes).to_le_bytes());
            bytes.extend(rest);
        }
        refused(&bytes, to);
    }
    // Through the command line.
    dir.write("d.part", &good[..good.len() / 2]);
    dir.fail("merge d.part -o m.exr", 2, &["d.part", "cut short"]);
    dir.fail("render a.xml --resume d.part", 2, &["d.part", "cut short"]);
    let mut bytes = good.clone();
    bytes[good.len() / 2] ^= 4;
    dir.write("d.part", &bytes);
    dir.fail("merge c.part d.part -o m.part", 2, &["d.part"]);
    dir.fail("merge d.part -o m.part", 2, &["d.part", "damaged"]);
    dir.fail("render a.xml -q --resume d.part", 2, &["d.part", "damaged"]);
    dir.fail("render a.xml --resume none.part", 2, &["none.part", "no such file"]);
    dir.fail("merge none.part -o m.exr", 2, &["none.part", "no such file"]);
    dir.fail("merge . -o m.exr", 2, &["regular file"]);
    dir.fail("merge a.xml -o m.exr", 2, &["a.xml", "no part"]);
    assert!(!dir.path("m.exr").exists() && !dir.path("m.part").exists());
}

#[test]
fn other_renders_are_refused() {
    let dir = Dir::with_scene();
    let sized = "render a.xml -q --size 8x6 --passes 2";
    dir.succeed(&format!("{sized} -o b.exr --checkpoint c.part"));
    let resume = format!("{sized} --resume c.part -o b.exr");
    dir.succeed(&resume);
    dir.fail(&format!("{resume} --seed 4"), 2, &["c.part", "with seed 0, not 4"]);
    dir.fail(&format!("{resume} --set global_k=7"), 2, &["with global_k = 32, not 7"]);
    dir.fail(&format!("{resume} --set kernel=cone"), 2, &["kernel = epanechnikov, not cone"]);
    dir.fail(&format!("{resume} --integrator path"), 2, &["integrator photonmap, not path"]);
    dir.fail(&format!("{resume} --aovs"), 2, &["without --aovs"]);
    dir.fail(&format!("{resume} -D albedo=0.25"), 2, &["another scene"]);
    dir.fail("render a.xml -q --passes 2 --resume c.part", 2, &["at size 8x6, not 12x9"]);
    for backend in backends().skip(1) {
        let name = backend.name();
        dir.fail(&format!("{resume} --backend {name}"), 2, &["with the backend", &format!("not {name}")]);
    }
    // What the scene's files hold counts, not what they look like or are called.
    dir.write(
        "b.xml",
        SCENE.replace("<film", "<!-- a comment -->  <film").replace("value=\"3\"", "value=\"5\""),
    );
    dir.succeed(&resume.replace("a.xml", "b.xml"));
    dir.write("wall.obj", WALL.replace("-2 3 -1", "-2 3.001 -1"));
    dir.fail(&resume, 2, &["another scene"]);
    dir.write("wall.obj", format!("# a comment\n{WALL}"));
    dir.succeed(&resume);
    dir.floor(201);
    dir.fail(&resume, 2, &["another scene"]);
    dir.floor(200);
    dir.succeed(&resume);

    let (header, state) = part_file::read(&dir.path("c.part")).unwrap();
    let other = Identity { version: "0.0.9".into(), ..header.identity };
    part_file::write(&dir.path("c.part"), &other, "a.xml", &state).unwrap();
    dir.fail(&resume, 2, &["by caustica 0.0.9, not"]);
    dir.fail("merge c.part -o m.exr", 2, &["caustica 0.0.9"]);
}

/// Of an environment map, too.
#[test]
fn fingerprints_of_environments() {
    let dir = Dir::with_scene();
    let lamp = SCENE.find("<emitter").unwrap();
    let xml = SCENE[..lamp].to_string()
        + r#"</shape><emitter type="envmap"><string name="filename" value="floor.png"/></emitter></scene>"#;
    dir.write("a.xml", xml);
    let backend = backends().next().unwrap();
    let first = dir.scene(backend).fingerprint();
    assert_eq!(first, dir.scene(backend).fingerprint());
    dir.write("wall.obj", WALL.replace("f 1 2 3", "f 2 3 1"));
    assert_ne!(first, dir.scene(backend).fingerprint());
    dir.write("wall.obj", WALL);
    dir.floor(201);
    assert_ne!(first, dir.scene(backend).fingerprint());
    dir.floor(200);
    assert_eq!(first, dir.scene(backend).fingerprint());
}

#[test]
fn parts_that_do_not_fit() {
    let dir = Dir::with_scene();
    for range in ["0..2", "2..3", "1..4", "5..9", "9..10"] {
        dir.succeed(&format!("render a.xml -q --pass-range {range}"));
    }
    let fail = |args: &str, words: &[&str]| dir.fail(&format!("merge -q {args} -o m.exr"), 2, words);
    fail("a.0-2.part a.5-9.part", &["a.5-9.part", "passes 2 to 4 are missing"]);
    fail("a.0-2.part a.2-3.part a.5-9.part", &["passes 3 to 4 are missing"]);
    fail("a.9-10.part a.2-3.part a.0-2.part", &["passes 3 to 8 are missing"]);
    fail("a.2-3.part", &["a.2-3.part", "passes 0 to 1 are missing"]);
    fail("a.1-4.part", &["pass 0 is missing"]);
    fail("a.0-2.part a.1-4.part", &["a.1-4.part", "pass 1 is in a.0-2.part, too"]);
    fail("a.0-2.part a.0-2.part", &["passes 0 to 1 are in", "too"]);
    fail("a.1-4.part a.0-2.part a.2-3.part", &["a.1-4.part", "pass 1 is in"]);
    dir.succeed("merge -q a.9-10.part a.5-9.part -o m.part");
    assert_eq!(dir.range("m.part"), 5..10);

    dir.succeed("render a.xml -q --pass-range 2..3 --seed 8 -o s.part");
    fail("a.0-2.part s.part", &["s.part: does not belong to a.0-2.part", "with seed 8, not 0"]);
    dir.succeed("render a.xml -q --pass-range 2..3 --aovs -o s.part");
    fail("s.part a.0-2.part", &["s.part: does not belong to a.0-2.part", "with --aovs, not without"]);
    assert!(!dir.path("m.exr").exists());
}

/// Parts whose headers agree in all but what their sums mean.
#[test]
fn sums_of_another_layout_are_refused() {
    let dir = Dir::with_scene();
    let common = "render a.xml -q --backend bvh";
    dir.succeed(&format!("{common} --pass-range 0..1"));
    dir.succeed(&format!("{common} --pass-range 1..2"));
    let (header, state) = part_file::read(&dir.path("a.1-2.part")).unwrap();
    let other = Layout { fine: !state.layout().fine, ..state.layout() };
    for first in [0, 1] {
        let mut state = State::empty(other, first);
        *state.film_mut().contents_mut().0 = [1 - first, first];
        let name = format!("other{first}.part");
        part_file::write(&dir.path(&name), &header.identity, "a.xml", &state).unwrap();
    }
    dir.fail("merge a.0-1.part other1.part -o a.exr", 2, &["laid out"]);
    dir.fail(&format!("{common} --passes 2 --resume other0.part -o a.exr"), 2, &["laid out"]);
}

#[test]
fn bad_command_lines() {
    let dir = Dir::with_scene();
    for budget in ["--passes 3", "--time 3", "--error 0.1"] {
        dir.fail(&format!("render a.xml --pass-range 0..2 {budget}"), 2, &["--pass-range"]);
    }
    for range in ["2", "3..3", "5..2", "0..x"] {
        dir.fail(&format!("render a.xml --pass-range {range}"), 2, &["--pass-range"]);
    }
    dir.fail("render a.xml --pass-range 0..2 -o b.exr", 2, &["b.exr", ".part"]);
    dir.fail("render a.xml --pass-range 0..2 -o b.png", 2, &["b.png", ".part"]);
    dir.fail("render a.xml --pass-range 0..2 --half", 2, &["--half"]);
    dir.fail("render a.xml -o b.part", 2, &["b.part", "--pass-range"]);
    dir.fail("render a.xml --checkpoint-interval 5", 2, &["--checkpoint"]);
    dir.fail("render a.xml --checkpoint c --checkpoint-interval 0", 2, &["--checkpoint-interval"]);
    dir.fail("render a.xml -o b.exr --checkpoint b.exr", 2, &["b.exr", "checkpoint"]);
    dir.fail("render none.xml --checkpoint no/such/c.part", 1, &["no/such/c.part", "directory"]);
    dir.fail("merge", 2, &["<PART>"]);
    dir.fail("merge c.part", 2, &["--output"]);
    dir.fail("merge c.part -o b.jpg", 2, &["b.jpg", ".exr", ".part"]);
    dir.fail("merge c.part -o b.part --half", 2, &["--half"]);
    dir.fail("merge c.part -o b.png --half", 2, &["--half"]);
    dir.fail("merge c.part -o b.exr --exposure 1", 2, &["--exposure"]);
    dir.fail("merge c.part -o no/such/b.exr", 1, &["no/such/b.exr"]);
    dir.fail("merge c.part -o b.exr --stats no/such/s.json", 1, &["no/such/s.json"]);
    assert!(!Path::exists(&dir.path("b.exr")));
}
