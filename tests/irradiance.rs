//! Irradiance that is estimated ahead for gather rays.

mod common;

use caustica::integrator::Kind;
use caustica::math::{Ray, Sampler, Stream};
use caustica::metrics;
use caustica::photon::kdtree::KnnHeap;
use caustica::photon::{Estimator, Irradiance, Kernel, Photon, PhotonMap, Photons, Site};
use common::{ESTIMATES, assert_mean, backends, load, own_scene, parse, render};
use glam::Vec3;

const FLOOR: &str = r#"<scene version="3.0.0"><sensor type="perspective"/><shape type="rectangle">
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape></scene>"#;

/// Even light on a floor: exact in the mean over the floor, up to its edges. It is not if the places are photons of the
/// map, which have the more floor to themselves the fewer other photons are near: that is 1 % too dark.
#[test]
fn it_is_unbiased_where_light_is_even() {
    const PHOTONS: u32 = 2000;
    let scene = parse(FLOOR, 4, backends().next().unwrap());
    let point = |stream, set: u64, i: u32| {
        let u = Sampler::new(5, stream, (set << 32) + u64::from(i), 0).next_2d();
        (2.0 * u - 1.0).extend(0.0)
    };
    let what = Photons { depths: (1, 9), caustics: true };
    let estimator = Estimator::new(32, 1.0, 1.0, Kernel::Epanechnikov);
    let at = |p: Vec3| scene.hit(&Ray::new(p + Vec3::Z, -Vec3::Z)).unwrap();
    let (mut missed, mut n) = (0, 0);
    let mut estimate = |set: u64| {
        let flux = Vec3::splat(4.0 / PHOTONS as f32);
        let photon = |p| Photon { p, wi: Vec3::Z, n_g: Vec3::Z, tag: 0, flux, depth: 1, caustic: false };
        let photons: Vec<Photon> =
            (0..PHOTONS).map(|i| photon(point(Stream::GlobalPhotons, set, i))).collect();
        let sites: Vec<Site> =
            (0..PHOTONS / 16).map(|i| Site::new(&at(point(Stream::Sites, set, i)), Vec3::Z)).collect();
        let map = PhotonMap::new(&photons);
        let irradiance = Irradiance::new(&sites, &map, &estimator, what);
        let mut heap = KnnHeap::new(1);
        let (mut sum, mut found) = (0.0, 0);
        for i in 0..1000 {
            let s = at(point(Stream::Eye, set, i));
            let e = irradiance.near(&s, Vec3::Z, 9.0, &mut heap);
            found += usize::from(e.is_some());
            sum += f64::from(e.unwrap_or(Vec3::ZERO).x);
            // No photon has shown that light comes to the other side; short rays want better.
            assert!(irradiance.near(&s, -Vec3::Z, 9.0, &mut heap).is_none());
            assert!(irradiance.near(&s, Vec3::Z, 1e-3, &mut heap).is_none());
        }
        (missed, n) = (missed + 1000 - found, n + 1000);
        sum / found as f64
    };
    let means: Vec<f64> = (0..40 * ESTIMATES).map(&mut estimate).collect();
    assert_mean(&means, 1.0, 0.0, 0.004, "irradiance");
    assert!(20 * missed < n, "{missed} of {n} points have no place near them");
}

/// A whole picture with and without it: they differ by far less than either is off (relmse 10⁻²).
#[test]
fn it_does_not_show() {
    let scene = load(&own_scene("cornell-diffuse.xml"), 64, backends().next().unwrap());
    let picture = |on: &str| {
        let settings = [on, "indirect=map", "global_photons=4096", "global_k=64"];
        render(&scene, Kind::Photonmap, &settings, 4).image
    };
    let (with, without) = (picture("irradiance_cache=true"), picture("irradiance_cache=false"));
    let difference = metrics::relmse(&with, &without);
    println!("relmse {difference:.2e}");
    assert!(difference > 0.0, "it is used");
    assert!(difference < 8e-4, "{difference}");
}
