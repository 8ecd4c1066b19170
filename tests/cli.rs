//! The command line from outside: exit status, one-line messages, and what is written.

mod common;

use caustica::image_io::{self, Channels, Image, Layer, Metadata, SampleType};
use common::program::{Dir, signal, stderr, stdout};
use glam::Vec3;
use std::fs;
use std::path::Path;
use std::process::Stdio;

/// A square room seen through its missing wall, lit by a square in its ceiling; no caustics.
const SCENE: &str = r#"<scene version="3.0.0">
    <default name="albedo" value="0.5"/>
    <integrator type="photonmap">
        <integer name="max_depth" value="4"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world">
            <lookat origin="0, 1, 5" target="0, 1, 0" up="0, 1, 0"/>
        </transform>
        <sampler type="independent"><integer name="sample_count" value="2"/></sampler>
        <film type="hdrfilm">
            <integer name="width" value="16"/>
            <integer name="height" value="12"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <shape type="rectangle">
        <transform name="to_world"><rotate x="1" angle="-90"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="$albedo"/></bsdf>
    </shape>
    <shape type="rectangle">
        <transform name="to_world"><translate x="0" y="1" z="-1"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.3, 0.3"/></bsdf>
    </shape>
    <shape type="rectangle">
        <transform name="to_world">
            <scale value="0.3"/>
            <rotate x="1" angle="90"/>
            <translate x="0" y="2" z="0"/>
        </transform>
        <emitter type="area"><rgb name="radiance" value="10"/></emitter>
    </shape>
</scene>
"#;

impl Dir {
    fn image(&self, name: &str, width: usize, height: usize, value: f32) {
        let image = Image { width, height, pixels: vec![Vec3::splat(value); width * height] };
        let layers = [Layer { name: String::new(), image, channels: Channels::Rgb }];
        image_io::write_exr(&self.path(name), &layers, &Metadata::default(), SampleType::Float).unwrap();
    }

    fn scene(&self) -> &Dir {
        self.write("room.xml", SCENE);
        self
    }
}

#[test]
fn help_and_version() {
    let dir = Dir::new();
    for args in ["--help", "render --help", "compare --help", "photons --help", "info --help"] {
        assert!(stdout(&dir.succeed(args)).contains("Usage: caustica"));
    }
    assert_eq!(stdout(&dir.succeed("--version")), format!("caustica {}\n", env!("CARGO_PKG_VERSION")));
    assert_eq!(dir.run("").status.code(), Some(2));
}

#[test]
fn bad_command_lines() {
    let dir = Dir::new();
    dir.scene();
    dir.fail("paint room.xml", 2, &["paint"]);
    dir.fail("render", 2, &["<SCENE>", "--help"]);
    dir.fail("render room.xml --passes 3 --time 2", 2, &["--passes", "--time"]);
    dir.fail("render room.xml --time 3 --error 0.1", 2, &["--time", "--error"]);
    dir.fail("render room.xml -v -q", 2, &["--verbose", "--quiet"]);
    dir.fail("render room.xml --passes 0", 2, &["--passes"]);
    dir.fail("render room.xml --passes many", 2, &["--passes", "many"]);
    dir.fail("render room.xml --time -3", 2, &[]);
    dir.fail("render room.xml --time inf", 2, &["--time", "seconds"]);
    dir.fail("render room.xml --error 0", 2, &["--error"]);
    dir.fail("render room.xml --size 640", 2, &["--size", "WxH"]);
    dir.fail("render room.xml --size 0x5", 2, &["--size"]);
    dir.fail("render room.xml --threads 0", 2, &["--threads"]);
    dir.fail("render room.xml --seed -1", 2, &[]);
    dir.fail("render room.xml --backend optix", 2, &["optix", "embree", "bvh"]);
    dir.fail("render room.xml --integrator sppm", 2, &["sppm", "photonmap", "path"]);
    dir.fail("render room.xml -D albedo", 2, &["NAME=VALUE"]);
    dir.fail("render room.xml --set global_k", 2, &["NAME=VALUE"]);
    dir.fail("render room.xml --set globalk=5", 2, &["globalk", "global_k"]);
    dir.fail("render room.xml --set global_k=0", 2, &["global_k", "between"]);
    dir.fail("render room.xml --set alpha=nan", 2, &["alpha"]);
    dir.fail("render room.xml -o out.jpg", 2, &["out.jpg", ".exr", ".png"]);
    dir.fail("render room.xml -o out", 2, &[".exr", ".png"]);
    dir.fail("render room.xml -o out.png --aovs", 2, &["--aovs", ".exr"]);
    dir.fail("render room.xml -o out.png --half", 2, &["--half", ".exr"]);
    dir.fail("render room.xml --exposure 1", 2, &["--exposure", "PNG"]);
    dir.fail("photons room.xml", 2, &["--output"]);
    dir.fail("photons room.xml -o out.exr", 2, &[".ply", ".png"]);
    dir.fail("compare a.exr", 2, &["<REFERENCE>"]);
    assert_eq!(dir.names(), ["room.xml"]);
}

/// What is there already is no place for anything else: a slip of the hand must not cost the scene or a picture.
#[test]
fn nothing_is_replaced_by_a_slip() {
    let dir = Dir::new();
    dir.scene();
    dir.image("picture.exr", 2, 2, 1.0);
    let render = |args: &str| format!("render room.xml --passes 1 -q {args}");
    dir.fail(&render("-o a.exr --checkpoint room.xml"), 2, &["room.xml", "scene"]);
    dir.fail(&render("-o a.exr --stats ./room.xml"), 2, &["room.xml", "scene"]);
    dir.fail(&render("-o a.exr --checkpoint picture.exr"), 2, &["picture.exr", "checkpoint"]);
    dir.fail(&render("-o a.exr --stats a.exr"), 2, &["a.exr", "twice"]);
    dir.fail(&render("-o picture.exr --stats ./picture.exr"), 2, &["picture.exr", "twice"]);
    assert_eq!(dir.names(), ["picture.exr", "room.xml"]);
    // A checkpoint may be replaced, and a picture by a picture.
    for _ in 0..2 {
        dir.succeed(&render("-o picture.exr --checkpoint c.part --stats s.json"));
    }
}

#[test]
fn missing_files() {
    let dir = Dir::new();
    for command in ["render", "info", "photons -o a.ply"] {
        dir.fail(&format!("{command} none.xml"), 2, &["none.xml"]);
    }
    dir.fail("compare none.exr none.exr", 2, &["none.exr", "no such file"]);
    assert!(dir.names().is_empty());
}

#[test]
fn bad_scenes() {
    let dir = Dir::new();
    dir.write("cut.xml", &SCENE[..SCENE.len() / 2]);
    dir.fail("render cut.xml", 2, &["cut.xml:"]);
    dir.write("empty.xml", "");
    dir.fail("render empty.xml", 2, &["empty.xml"]);
    dir.write("binary.xml", [0xff_u8, 0xfe, 0, 1, 2, 3]);
    dir.fail("render binary.xml", 2, &["binary.xml"]);
    fs::create_dir(dir.path("dir.xml")).unwrap();
    dir.fail("render dir.xml", 2, &["dir.xml"]);
}

/// The parameters of the scene's integrator are checked where they stand.
#[test]
fn bad_integrator_parameters() {
    let dir = Dir::new();
    let line = 1 + SCENE.lines().position(|l| l.contains("max_depth")).unwrap();
    dir.write("a.xml", SCENE.replace("max_depth", "max_deptj"));
    dir.fail("render a.xml", 2, &[&format!("a.xml:{line}: "), "max_deptj"]);
    dir.write("b.xml", SCENE.replace("value=\"4\"", "value=\"-7\""));
    dir.fail("info b.xml", 2, &[&format!("b.xml:{line}: "), "-7"]);
    // Another integrator's own parameters are not ours to judge, those of path length are.
    let path = SCENE.replace("type=\"photonmap\"", "type=\"path\"");
    dir.write("c.xml", path.replace("max_depth", "samples_per_pass"));
    dir.succeed("info c.xml");
    dir.write("d.xml", path.replace("value=\"4\"", "value=\"-7\""));
    dir.fail("info d.xml", 2, &[&format!("d.xml:{line}: "), "-7"]);
}

#[test]
fn outputs_are_checked_before_anything_else() {
    let dir = Dir::new();
    dir.fail("render none.xml -o no/such/out.exr", 1, &["no/such/out.exr", "directory"]);
    dir.fail("render none.xml --stats no/such/s.json", 1, &["no/such/s.json"]);
    dir.fail("photons none.xml -o no/such/out.ply", 1, &["no/such/out.ply"]);
    fs::create_dir(dir.path("out.exr")).unwrap();
    dir.fail("render none.xml -o out.exr", 1, &["out.exr", "is a directory"]);
    assert_eq!(dir.names(), ["out.exr"]);
}

#[test]
fn compare_says_how_far() {
    let dir = Dir::new();
    dir.image("a.exr", 4, 3, 1.0);
    dir.image("b.exr", 4, 3, 1.5);
    dir.image("c.exr", 3, 4, 1.0);
    let text = stdout(&dir.succeed("compare b.exr a.exr"));
    let words: Vec<Vec<&str>> = text.lines().map(|l| l.split(' ').collect()).collect();
    let names: Vec<&str> = words.iter().map(|w| w[0]).collect();
    assert_eq!(names, ["rmse", "relmse", "mae", "bias", "psnr", "flip"]);
    assert_eq!(words[0][1].parse::<f64>().unwrap(), 0.5);
    assert!((words[1][1].parse::<f64>().unwrap() - 0.25 / 1.01).abs() < 1e-4);
    assert_eq!(words[3].len(), 4);

    let json: serde_json::Value =
        serde_json::from_str(&stdout(&dir.succeed("compare b.exr a.exr --json"))).unwrap();
    assert_eq!(json["bias"].as_array().unwrap().len(), 3);
    assert!((json["bias"][1].as_f64().unwrap() - 0.5).abs() < 1e-6);
    assert!((json["relmse"].as_f64().unwrap() - 0.25 / 1.01).abs() < 1e-6);
    let same: serde_json::Value =
        serde_json::from_str(&stdout(&dir.succeed("compare a.exr a.exr --json"))).unwrap();
    assert_eq!((same["rmse"].as_f64(), same["flip"].as_f64()), (Some(0.0), Some(0.0)));

    dir.fail("compare a.exr c.exr", 2, &["4x3", "3x4"]);
    let bytes = fs::read(dir.path("a.exr")).unwrap();
    dir.write("cut.exr", &bytes[..bytes.len() - 9]);
    dir.fail("compare cut.exr a.exr", 2, &["cut.exr"]);
    dir.write("text.exr", "no image");
    dir.fail("compare a.exr text.exr", 2, &["text.exr", "format"]);
}

#[test]
fn info_about_the_program() {
    let dir = Dir::new();
    let text = stdout(&dir.succeed("info --threads 3"));
    assert!(
        text.contains(env!("CARGO_PKG_VERSION"))
            && text.contains("backends: ")
            && text.contains("threads: 3")
    );
    for backend in caustica::accel::available() {
        assert!(text.contains(backend.name()));
    }
    // A reader that leaves early is no failure.
    let mut child = dir.command("info").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let out = child.wait_with_output().unwrap();
    assert_eq!((out.status.code(), stderr(&out)), (Some(0), String::new()));
}

#[test]
fn info_about_a_scene() {
    let dir = Dir::new();
    let text = stdout(&dir.scene().succeed("info room.xml"));
    for line in
        ["film: 16 x 12 pixels", "shapes: 3", "triangles: 6", "lights: 1", "textures: 0", "plan: photonmap"]
    {
        assert!(text.contains(line), "no '{line}' in {text}");
    }
    assert!(stdout(&dir.succeed("info room.xml --size 7x5")).contains("film: 7 x 5 pixels"));
}

#[test]
fn render_writes_an_exr_by_default() {
    let dir = Dir::new();
    let out = dir.scene().succeed("render room.xml");
    assert!(stdout(&out).is_empty());
    assert_eq!(dir.names(), ["room.exr", "room.xml"]);
    let image = image_io::read(&dir.path("room.exr")).unwrap();
    assert_eq!((image.width, image.height), (16, 12));
    assert!(image.pixels.iter().any(|p| p.max_element() > 0.0));
    assert!(stderr(&dir.succeed("render room.xml -q")).is_empty());
}

#[test]
fn render_obeys_its_options() {
    let dir = Dir::new();
    dir.scene();
    dir.succeed("render room.xml -o a.png --size 9x5 --passes 1 --exposure -1 -q");
    assert_eq!(image_io::read(&dir.path("a.png")).unwrap().width, 9);

    dir.succeed("render room.xml -o a.exr --aovs --passes 3 --seed 5 --stats s.json --threads 2");
    let s = dir.json("s.json");
    assert_eq!(
        (s["passes"].as_u64(), s["seed"].as_u64(), s["threads"].as_u64()),
        (Some(3), Some(5), Some(2))
    );
    assert_eq!((s["width"].as_u64(), s["height"].as_u64()), (Some(16), Some(12)));
    for key in ["version", "scene", "backend"] {
        assert!(s[key].is_string(), "{key}");
    }
    for key in ["rays", "rays_per_second", "estimated_relative_error", "peak_rss_bytes"] {
        assert!(s[key].is_number(), "{key}");
    }
    for key in ["load", "build", "photons", "maps", "eye", "total"] {
        assert!(s["seconds"][key].as_f64().unwrap() >= 0.0, "{key}");
    }
    for key in ["emitted", "global_stored", "caustic_stored"] {
        assert!(s["photons"][key].is_u64(), "{key}");
    }
    let skipped = s["skipped"].as_array().unwrap();
    assert!(skipped.iter().all(|s| s["stage"].is_string() && s["reason"].is_string()));
    assert!(!skipped.is_empty(), "a room without any specular surface needs no caustic map");

    // The same image whatever the number of threads; another one for another seed, and for half the light.
    let pixels = |args: &str| {
        dir.succeed(&format!("render room.xml -q -o b.exr --passes 3 {args}"));
        image_io::read(&dir.path("b.exr")).unwrap().pixels
    };
    let a = image_io::read(&dir.path("a.exr")).unwrap().pixels;
    assert_eq!(pixels("--threads 1 --seed 5"), a);
    assert_ne!(pixels("--seed 6"), a);
    let sum = |pixels: &[Vec3]| pixels.iter().map(|p| p.x as f64).sum::<f64>();
    assert!(sum(&pixels("-D albedo=0.1 --seed 5")) < sum(&a));
    assert!(sum(&pixels("--set max_depth=1 --seed 5")) < sum(&a));
    assert!(sum(&pixels("--integrator path")) > 0.0);
}

#[test]
fn time_is_bounded() {
    let dir = Dir::new();
    let start = std::time::Instant::now();
    dir.scene().succeed("render room.xml --time 1 -q --stats s.json");
    assert!(start.elapsed().as_secs_f64() < 5.0);
    assert!(dir.json("s.json")["passes"].as_u64().unwrap() > 2);
}

#[test]
fn other_integrators_are_named() {
    let dir = Dir::new();
    dir.write("room.xml", SCENE.replace("type=\"photonmap\"", "type=\"path\""));
    let text = stderr(&dir.succeed("render room.xml --passes 1"));
    assert!(text.contains("note: ") && text.contains("'path'") && text.contains("photon mapping"), "{text}");
    assert!(!stderr(&dir.succeed("render room.xml --passes 1 --integrator path")).contains("note: "));
    assert!(stderr(&dir.succeed("render room.xml --passes 1 -q")).is_empty());
}

#[test]
fn photons_as_points_and_picture() {
    let dir = Dir::new();
    dir.scene().succeed("photons room.xml -o a.ply --set global_photons=1000");
    assert!(fs::read(dir.path("a.ply")).unwrap().starts_with(b"ply\n"));
    dir.succeed("photons room.xml -o a.png --size 32x24 --set global_photons=1000");
    let image = image_io::read(&dir.path("a.png")).unwrap();
    assert_eq!((image.width, image.height), (32, 24));
    assert!(image.pixels.iter().any(|p| p.max_element() > 0.0));
}

/// Ctrl-C ends the render after a pass, and the image is there.
#[test]
#[cfg(target_os = "linux")]
fn interrupt_keeps_the_image() {
    let dir = Dir::new();
    dir.scene();
    let mut child = dir
        .command("render room.xml --time 60 --stats s.json")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_secs(2));
    if let Some(status) = child.try_wait().unwrap() {
        panic!("ended by itself: {status}");
    }
    signal(&child, "INT");
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(130), "{}", stderr(&out));
    assert_eq!(dir.json("s.json")["interrupted"], true);
    assert!(Path::exists(&dir.path("room.exr")));
}
