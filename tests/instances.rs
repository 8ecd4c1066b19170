//! Instances in scene files: they show what copies show, at the price of one.

mod common;

use caustica::integrator::{Budget, Kind, Options};
use caustica::metrics::relmse;
use caustica::scene::{self, Scene};
use caustica::shape::Instance;
use common::program::{Dir, stdout};
use common::{assert_close, backends, mean, params, render_with};
use glam::{DAffine3, DVec3};

#[path = "common/meshes.rs"]
mod meshes;

/// A binary PLY file of 20·4^`level` triangles.
fn organic(level: u32) -> Vec<u8> {
    let (positions, triangles) = meshes::organic(level);
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        positions.len(),
        triangles.len()
    )
    .into_bytes();
    positions.iter().flat_map(|p| p.to_array()).for_each(|x| file.extend(x.to_le_bytes()));
    for triangle in triangles {
        file.push(3);
        triangle.iter().for_each(|i| file.extend(i.to_le_bytes()));
    }
    file
}

const FLOOR: &str = "<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='40'/>\
    <transform name='to_world'><lookat origin='0, 4, 9' target='0, 0.7, 0' up='0, 1, 0'/></transform></sensor>\
    <shape type='rectangle'><transform name='to_world'><scale value='5'/><rotate x='1' angle='-90'/></transform></shape>";
const LAMP: &str = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='90'/><translate y='5'/></transform>\
    <emitter type='area'><rgb name='radiance' value='12'/></emitter></shape>";
const SKY: &str = "<emitter type='constant'/>";

/// By the name of an attribute and its value: turned, mirrored, stretched and moved.
fn places() -> [(String, DAffine3); 4] {
    [(-2.4, 0.5, 1.0, 1.4), (-0.8, -0.6, 1.0, 0.6), (0.8, 0.6, 1.5, -0.6), (2.4, 0.5, -0.7, 1.2)].map(
        |(at, x, y, z)| {
            let text = format!(
                "<transform name='to_world'><scale x='{x}' y='{y}' z='{z}'/><rotate y='1' angle='30'/>\
             <translate x='{at}' y='1.2'/></transform>"
            );
            let m = DAffine3::from_translation(DVec3::new(at, 1.2, 0.0))
                * DAffine3::from_rotation_y(30f64.to_radians())
                * DAffine3::from_scale(DVec3::new(x, y, z));
            (text, m)
        },
    )
}

fn ply(bsdf: &str) -> String {
    format!("<shape type='ply'><string name='filename' value='organic.ply'/>{bsdf}</shape>")
}

const MATTE: &str =
    "<bsdf type='twosided'><bsdf type='diffuse'><rgb name='reflectance' value='0.7 0.4 0.2'/></bsdf></bsdf>";
const GLASS: &str = "<bsdf type='dielectric'/>";

/// The file loads as copies, being small, and the same with real instances.
fn copied_and_instanced(light: &str, bsdf: &str) -> [scene::SceneDescription; 2] {
    let dir = Dir::new();
    dir.write("organic.ply", organic(3));
    let load = |shapes: &str| {
        dir.write("scene.xml", format!("{FLOOR}{light}{shapes}</scene>"));
        scene::load(&dir.path("scene.xml"), &[], Some((48, 32))).unwrap()
    };
    let group = format!("<shape type='shapegroup' id='g'>{}</shape>", ply(bsdf));
    let instance = |(m, _): &(String, DAffine3)| format!("<shape type='instance'><ref id='g'/>{m}</shape>");
    let copied = load(&format!("{group}{}", places().iter().map(instance).collect::<String>()));
    let mut instanced = load(&ply(bsdf));
    let shapes = instanced.geometry.shapes.len() as u32;
    assert_eq!(copied.geometry.shapes.len() as u32, shapes + 3);
    assert!(copied.geometry.instances.is_empty());
    instanced.geometry.groups.push(shapes - 1..shapes);
    instanced.geometry.instances.extend(places().iter().map(|(_, m)| Instance::new(0, *m)));
    [copied, instanced]
}

/// Up to the noise of other random numbers, of which the same ones bring least where nothing amplifies
/// rounding.
#[test]
fn instances_render_like_copies() {
    for (light, bsdf, kind, share) in [
        (LAMP, MATTE, Kind::Path, 0.1),
        // Where a photon sent ahead lands elsewhere, others are emitted: of all 16 passes, 0.16 to 0.18 were
        // measured.
        (LAMP, MATTE, Kind::Photonmap, 0.4),
        // Bumpy glass amplifies rounding. Paths find a lamp through it by rare chance only.
        (SKY, GLASS, Kind::Path, 0.5),
        (LAMP, GLASS, Kind::Photonmap, 2.0),
    ] {
        let [copied, instanced] = copied_and_instanced(light, bsdf);
        for backend in backends() {
            let copied = Scene::new(copied.clone(), backend).unwrap();
            let instanced = Scene::new(instanced.clone(), backend).unwrap();
            let image = |scene, seed| {
                let budget = Budget::Passes(16);
                let params = params(&["global_photons=20000", "caustic_photons=20000"]);
                render_with(scene, &Options { integrator: kind, params, seed, budget, aovs: false }).image
            };
            let (a, b, other) = (image(&copied, 1), image(&instanced, 1), image(&copied, 2));
            let (off, noise) = (relmse(&b, &a), relmse(&other, &a));
            let name = format!(
                "{} {kind:?} {light} {bsdf}: relmse {off:.2e}, of other numbers {noise:.2e}",
                backend.name()
            );
            println!("{name}");
            assert_close(mean(&b), mean(&a), 0.02, &name);
            assert!(off < share * noise, "{name}");
        }
    }
}

#[test]
fn fingerprints_tell_places_apart() {
    let [_, instanced] = copied_and_instanced(LAMP, MATTE);
    let Some(backend) = backends().next() else { return };
    let print = |d: &scene::SceneDescription| Scene::new(d.clone(), backend).unwrap().fingerprint();
    let mut moved = instanced.clone();
    moved.geometry.instances[2] = Instance::new(0, DAffine3::from_translation(DVec3::Y));
    assert_eq!(print(&instanced), print(&instanced));
    assert_ne!(print(&instanced), print(&moved));
}

/// Copies would take more than 10 GB.
#[test]
fn a_thousand_instances_take_the_memory_of_one() {
    let dir = Dir::new();
    dir.write("organic.ply", organic(6));
    let instance = |i: u32| {
        format!(
            "<shape type='instance'><ref id='g'/><transform name='to_world'><translate x='{i}'/></transform></shape>"
        )
    };
    let instances: String = (0..1000).map(instance).collect();
    dir.write(
        "many.xml",
        format!("{FLOOR}{LAMP}<shape type='shapegroup' id='g'>{}</shape>{instances}</scene>", ply(MATTE)),
    );
    for backend in backends() {
        let text = stdout(&dir.succeed(&format!("info many.xml --backend {}", backend.name())));
        let line =
            |name: &str| text.lines().find_map(|l| l.strip_prefix(name)).unwrap_or_else(|| panic!("{text}"));
        assert_eq!(line("shapes: "), "3");
        assert_eq!(line("triangles: "), "81924");
        assert_eq!(line("instances: "), "1000, with them 81920004 triangles show");
        let peak: f64 = line("peak memory: ").trim_end_matches(" MiB").parse().unwrap();
        assert!(peak < 200.0, "{}: {peak} MiB", backend.name());
    }
}

#[test]
fn instances_out_of_range_are_refused() {
    let dir = Dir::new();
    let instance = |scale: &str| {
        format!(
            "{FLOOR}{LAMP}<shape type='shapegroup' id='g'><shape type='sphere'><float name='radius' value='1e10'/></shape></shape>\n\
             <shape type='instance'><ref id='g'/><transform name='to_world'><scale value='{scale}'/></transform></shape></scene>"
        )
    };
    dir.write("a.xml", instance("1e30"));
    dir.fail("info a.xml", 2, &["a.xml:2: ", "out of the range"]);
    dir.write("a.xml", instance("0"));
    dir.fail("info a.xml", 2, &["a.xml:2: ", "singular"]);
}

/// What could be no copy: a ball stretched by an instance.
#[test]
fn stretched_balls_show() {
    let xml = format!(
        "{FLOOR}{LAMP}<shape type='shapegroup' id='g'><shape type='sphere'/></shape><shape type='instance'><ref id='g'/>{}</shape></scene>",
        places()[3].0
    );
    for backend in backends() {
        let scene = common::parse(&xml, 16, backend);
        let (x, y) = (2.4, 1.2);
        let down = caustica::math::Ray::new(glam::Vec3::new(x, 4.0, 0.0), glam::Vec3::NEG_Y);
        let top = scene.hit(&down).unwrap();
        assert!((top.p.y - (y + 0.7)).abs() < 1e-4 && top.n_g.y > 0.999, "{:?} {:?}", top.p, top.n_g);
        assert_eq!(scene.geometry.instances.len(), 1);
    }
}
