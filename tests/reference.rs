//! Pictures against references that this project did not make.

mod common;

use caustica::accel::Backend;
use caustica::image_io;
use caustica::integrator::Kind;
use caustica::metrics;
use common::{assert_close, backends, load, mean, own_scene, render, shared};

/// Scene; relmse that 16 passes must reach, about twice what they do; relmse that 256 passes must reach.
const SCENES: [(&str, f64, f64); 6] = [
    ("cornell-diffuse", 1.1e-3, 4e-4),
    ("cornell-spheres", 1.6e-3, 6e-4),
    ("ring", 1.2e-3, 6e-4),
    ("glossy-caustic", 1.4e-2, 3e-3),
    ("env-caustic", 4e-3, 1e-3),
    ("pool", 2e-3, 1.1e-3),
];

/// Renders a scene and compares it; means may differ by `bias` in each channel. `None` where there is no reference.
fn check(name: &str, backend: Backend, kind: Kind, passes: u32, relmse: f64, bias: f32) -> Option<()> {
    let reference = image_io::read(&shared(&format!("reference/ref/{name}.exr"))?).unwrap();
    let scene = load(&own_scene(&format!("{name}.xml")), 128, backend);
    let image = render(&scene, kind, &[], passes).image;
    let error = metrics::relmse(&image, &reference);
    let what = format!("{name}, {}, {kind:?}, {passes} passes", backend.name());
    println!("{what}: relmse {error:.2e}, mean {}", mean(&image) / mean(&reference));
    assert!(error < relmse, "{what}: relmse {error:.2e} is not below {relmse:.1e}");
    assert_close(mean(&image), mean(&reference), bias, &what);
    Some(())
}

#[test]
fn a_few_passes_come_near() {
    for (name, relmse, _) in SCENES {
        for backend in backends() {
            check(name, backend, Kind::Photonmap, 16, relmse, 0.02);
        }
    }
}

#[test]
#[ignore = "five minutes; CI runs it nightly"]
fn many_passes_come_nearer() {
    for (name, _, relmse) in SCENES {
        for backend in backends() {
            check(name, backend, Kind::Photonmap, 256, relmse, 0.01);
        }
    }
}

/// Within the noise of both; the pool's light is beyond any path tracer.
#[test]
#[ignore = "five minutes; CI runs it nightly"]
fn the_path_tracer_agrees_in_the_mean() {
    for (name, ..) in SCENES.into_iter().filter(|(name, ..)| *name != "pool") {
        let backend = backends().next().unwrap();
        check(name, backend, Kind::Path, 2048, f64::INFINITY, 0.005);
    }
}
