//! A picture depends on scene, seed and passes alone.

mod common;

use caustica::integrator::Kind;
use common::{backends, load, own_scene, render};

#[test]
fn same_bits_for_any_number_of_threads() {
    for backend in backends() {
        let scene = load(&own_scene("cornell-spheres.xml"), 32, backend);
        for kind in [Kind::Path, Kind::Photonmap] {
            let images = [1, 2, 3, 16].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| render(&scene, kind, &[], 2).image)
            });
            assert!(images.iter().all(|image| *image == images[0]), "{} {kind:?}", backend.name());
        }
    }
}
