//! Photon maps without the usual crowd.

use crate::common::{backends, parse};
use crate::watched;
use caustica::bsdf::Share;
use caustica::math::{Ray, Rgb};
use caustica::photon::kdtree::KnnHeap;
use caustica::photon::{Estimator, Kernel, Levels, Photon, PhotonMap, Photons};
use glam::Vec3;
use std::f32::consts::PI;

const R_MAX: f32 = 0.5;

fn photon(x: f32, y: f32) -> Photon {
    Photon {
        p: Vec3::new(x, y, 0.0),
        wi: Vec3::Z,
        n_g: Vec3::Z,
        tag: 0,
        flux: Rgb::ONE,
        depth: 1,
        caustic: false,
    }
}

/// What 50 of these photons show at points around the origin of a white floor: the radiance of each kernel, wide.
fn seen(name: &str, photons: Vec<Photon>, at: [f32; 2]) -> [f32; 4] {
    watched(name, move || {
        let xml = r#"<scene version="3.0.0"><sensor type="perspective"/><shape type="rectangle">
            <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape></scene>"#;
        let scene = parse(xml, 4, backends().next().unwrap());
        let map = PhotonMap::new(&photons);
        assert_eq!(map.len(), photons.len());
        let s = scene.hit(&Ray::new(Vec3::new(at[0], at[1], 1.0), -Vec3::Z)).unwrap();
        [Kernel::Constant, Kernel::Cone, Kernel::Epanechnikov, Kernel::Biweight].map(|kernel| {
            let what = Photons { depths: (1, 9), caustics: true };
            let mut heap = KnnHeap::new(50);
            let estimator = Estimator::new(50, R_MAX, 1.0, kernel);
            let Levels { wide, fine } =
                estimator.radiance(&map, &s, Vec3::Z, Share::All, what, true, &mut heap);
            let density = estimator.density(&map, &s, &mut heap);
            for value in [wide.x, fine.x, density] {
                assert!(value.is_finite() && value >= 0.0, "{kernel:?} at {at:?}: {value}");
            }
            wide.x
        })
    })
}

/// A lone photon in reach is all there is within the largest radius.
#[test]
fn a_lone_photon() {
    let [constant, cone, epanechnikov, biweight] = seen("lone", vec![photon(0.3, 0.0)], [0.0, 0.0]);
    let density = 1.0 / (PI * PI * R_MAX * R_MAX);
    let t: f32 = 0.3 / R_MAX;
    for (seen, weight) in [
        (constant, 1.0),
        (cone, 3.0 * (1.0 - t)),
        (epanechnikov, 2.0 * (1.0 - t * t)),
        (biweight, 3.0 * (1.0 - t * t).powi(2)),
    ] {
        assert!((seen / (weight * density) - 1.0).abs() < 1e-4, "{seen} {}", weight * density);
    }
    assert_eq!(seen("lone, out of reach", vec![photon(0.6, 0.0)], [0.0, 0.0]), [0.0; 4]);
    assert_eq!(seen("none", vec![], [0.0, 0.0]), [0.0; 4]);
}

/// Of a million in one point, 50 are taken, all at the same distance: 49 count in a constant kernel.
#[test]
fn a_million_photons_in_a_point() {
    for d in [0.1f32, 1e-3, 1e-10, 1e-18] {
        let [constant, ..] = seen("a point", vec![photon(0.0, 0.0); 1_000_000], [d, 0.0]);
        let expected = 49.0 / (PI * PI * d * d);
        let fits = (constant / expected - 1.0).abs() < 1e-3 || d < 1e-5;
        assert!(fits, "at {d}: {constant} {expected}");
    }
    seen("on the point", vec![photon(0.0, 0.0); 1_000_000], [0.0, 0.0]);
}

/// Evenly along a line: those within r are 2r over the spacing.
#[test]
fn photons_on_a_line() {
    let line = |n: usize| (0..n).map(|i| photon((i as f32 + 0.5) / n as f32 * 2.0 - 1.0, 0.0)).collect();
    for n in [200, 200_000] {
        let [constant, ..] = seen("a line", line(n), [0.0, 0.0]);
        let r = 24.5 * 2.0 / n as f32;
        assert!((constant * PI * PI * r * r / 49.0 - 1.0).abs() < 0.01, "{n}: {constant}");
        seen("beside a line", line(n), [0.1, 0.2]);
    }
}

/// As many as fit in the bound on memory, in one point, on a line, and in two points far apart.
#[test]
#[ignore = "half a minute; CAUSTICA_STRESS=1 .ci/run runs it"]
fn ten_million_photons() {
    const N: usize = 10_000_000;
    seen("ten million in a point", vec![photon(0.0, 0.0); N], [0.1, 0.0]);
    seen("ten million on a line", (0..N).map(|i| photon(i as f32 / N as f32, 0.0)).collect(), [0.5, 0.0]);
    let twins = (0..N).map(|i| photon(if i % 2 == 0 { 0.0 } else { 1e30 }, 0.0)).collect();
    seen("ten million in two points", twins, [1e-3, 0.0]);
}
