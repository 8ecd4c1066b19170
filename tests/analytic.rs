//! Light that is known in closed form. Every estimate is the mean of 16 independent ones with fixed seeds, and must hold
//! the exact value in its 99.9 % confidence interval (Student's t), which must itself be narrow.

mod common;

use caustica::integrator::{self, Budget, Kind, Options, PhotonRecord};
use caustica::math::{Sampler, Stream};
use caustica::photon::kdtree::KnnHeap;
use caustica::photon::{Estimator, Kernel, Photon, PhotonMap, Photons};
use caustica::scene::Scene;
use caustica::{bsdf::Share, math::Ray};
use common::{ESTIMATES, assert_mean, backends, mean, params, parse, render_with};
use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// The ways to see light that surfaces scatter; the last sees photons alone.
const ALL: [(Kind, &[&str]); 3] = [
    (Kind::Path, &[]),
    (Kind::Photonmap, &[]),
    (Kind::Photonmap, &["final_gather=false", "direct=map", "global_photons=40000"]),
];

fn options(integrator: Kind, settings: &[&str], seed: u64, passes: u32) -> Options {
    Options { integrator, params: params(settings), seed, budget: Budget::Passes(passes), aovs: false }
}

/// The picture's mean, as each of 16 seeds has it.
fn means(scene: &Scene, kind: Kind, settings: &[&str], passes: u32) -> Vec<f64> {
    let image = |seed| render_with(scene, &options(kind, settings, seed, passes)).image;
    (0..ESTIMATES).map(|seed| mean(&image(seed)).x as f64).collect()
}

fn camera(fov: f64, origin: &str, target: &str, up: &str) -> String {
    format!(
        r#"<sensor type="perspective"><float name="fov" value="{fov}"/>
            <transform name="to_world"><lookat origin="{origin}" target="{target}" up="{up}"/></transform>
            <film type="hdrfilm"><rfilter type="box"/></film></sensor>"#
    )
}

fn scene(body: &str) -> String {
    format!(r#"<scene version="3.0.0">{body}</scene>"#)
}

/// Form factor from a surface element to a parallel rectangle at distance 1, the element lying below its corner
/// (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", B-4).
fn corner_form_factor(a: f64, b: f64) -> f64 {
    let (p, q) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
    (a / p * (b / p).atan() + b / q * (a / q).atan()) / (2.0 * PI)
}

/// To a parallel disk of radius `r` at height `h`, `a` being off its axis (Howell, B-13).
fn disk_form_factor(a: f64, h: f64, r: f64) -> f64 {
    let (a2, h2, r2) = (a * a, h * h, r * r);
    let z = a2 + h2 + r2;
    0.5 * (1.0 - (a2 + h2 - r2) / (z * z - 4.0 * a2 * r2).sqrt())
}

/// Irradiance is π times radiance times the form factor. A white floor seen from right above, below the light, shows it over
/// π: the mean of the form factor over the picture's square.
#[test]
fn irradiance_below_lights() {
    let rectangle = |x: f64, y: f64| {
        // By corners: the light spans ±0.5 by ±0.3.
        let corner = |a: f64, b: f64| corner_form_factor(a.abs(), b.abs()).copysign(a * b);
        let (x0, x1, y0, y1) = (-0.5 - x, 0.5 - x, -0.3 - y, 0.3 - y);
        corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
    };
    let disk = |x: f64, y: f64| disk_form_factor((x - 0.2).hypot(y), 1.0, 0.4);
    // A whole sphere above the horizon: cosθ r²/d².
    let sphere = |x: f64, y: f64| 0.3f64.powi(2) / (x * x + y * y + 1.0).powf(1.5);
    type Form<'a> = &'a dyn Fn(f64, f64) -> f64;
    let face = |scale: &str, move_by: &str| {
        format!(
            r#"<transform name="to_world"><scale value="{scale}"/><rotate x="1" angle="180"/>
                <translate x="{move_by}" z="1"/></transform>"#
        )
    };
    let lights: [(&str, String, Form); 3] = [
        ("rectangle", face("0.5, 0.3, 1", "0"), &rectangle),
        ("disk", face("0.4, 0.4, 1", "0.2"), &disk),
        (
            "sphere",
            r#"<point name="center" value="0, 0, 1"/><float name="radius" value="0.3"/>"#.into(),
            &sphere,
        ),
    ];
    let view = camera(90.0, "0, 0, 0.5", "0, 0, 0", "0, 1, 0");
    for (name, placement, form) in &lights {
        const N: usize = 200;
        let at = |i: usize| (i as f64 + 0.5) / N as f64 - 0.5;
        let exact = (0..N * N).map(|i| form(at(i % N), at(i / N))).sum::<f64>() / (N * N) as f64;
        let xml = scene(&format!(
            r#"{view}<shape type="rectangle"><transform name="to_world"><scale value="2"/></transform>
                <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
            <shape type="{name}">{placement}<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
                <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#
        ));
        for backend in backends() {
            let scene = parse(&xml, 16, backend);
            for (kind, settings) in ALL {
                // Density estimation knows no backends.
                if !settings.is_empty() && Some(backend) != backends().next() {
                    continue;
                }
                let what = format!("{name}, {}, {kind:?} {settings:?}", backend.name());
                // What the light curves over a lookup disk is 0.2 % at most.
                let bias = if settings.is_empty() { 0.0 } else { 0.002 };
                assert_mean(&means(&scene, kind, settings, 4), exact, bias, 0.012, &what);
            }
        }
    }
}

/// Unpolarised reflectance of an interface at an angle in degrees, by Fresnel's equations.
fn reflectance(degrees: f64, eta: f64) -> f64 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let cos_t = (1.0 - (sin / eta).powi(2)).sqrt();
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (eta * cos - cos_t) / (eta * cos + cos_t);
    0.5 * (s * s + p * p)
}

/// A slab between interfaces of reflectance R passes T² (1 + R² + R⁴ + …) = (1 − R) / (1 + R), T = 1 − R, where light counts
/// as unpolarised at every interface: seen through it, and as light that falls through it.
#[test]
fn slab_of_glass() {
    let slab = r#"<shape type="cube"><transform name="to_world"><scale value="100, 100, 0.05"/>
            <translate z="1"/></transform>
        <bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>"#;
    let plane = |inner: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="100"/></transform>{inner}</shape>"#
        )
    };
    for degrees in [0.0f64, 45.0, 80.0] {
        let r = reflectance(degrees, 1.5);
        let exact = (1.0 - r) / (1.0 + r);
        let (sin, cos) = degrees.to_radians().sin_cos();
        for backend in backends() {
            let lit = plane(r#"<emitter type="area"><rgb name="radiance" value="1"/></emitter>"#);
            let eye = format!("{}, 0, {}", 1.0 + 2.0 * sin, 1.0 + 2.0 * cos);
            let seen = scene(&format!("{}{slab}{lit}", camera(0.1, &eye, "1, 0, 1", "0, 1, 0")));
            let seen = parse(&seen, 16, backend);
            for (kind, settings) in &ALL[..2] {
                let what = format!("through a slab at {degrees}°, {}, {kind:?}", backend.name());
                assert_mean(&means(&seen, *kind, settings, 16), exact, 2e-5, 0.02, &what);
            }

            // Light from the side, and a camera between slab and floor.
            let floor = plane(r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>"#);
            let sun = format!(
                r#"<emitter type="directional"><vector name="direction" value="{}, 0, {}"/>
                    <rgb name="irradiance" value="1"/></emitter>"#,
                -sin, -cos
            );
            let view = camera(90.0, "0, 0, 0.8", "0, 0, 0", "0, 1, 0");
            let lit = parse(&scene(&format!("{view}{slab}{floor}{sun}")), 16, backend);
            // Light that the floor sends up comes back from the glass: the caustic alone is known in closed form.
            let settings = ["max_depth=6", "caustic_photons=20000", "global_photons=1"];
            let photons = photons_per_seed(&lit, &settings);
            let inside =
                |p: &&PhotonRecord| p.caustic && p.p.truncate().abs().max_element() < 40.0 && p.p.z < 0.5;
            let flux =
                photons.iter().map(|all| all.iter().filter(inside).map(|p| p.flux.x as f64).sum::<f64>());
            let irradiance: Vec<f64> = flux.map(|flux| flux / (80.0 * 80.0)).collect();
            // Five segments: two through the slab, or four with two reflections inside.
            let orders = (1.0 - r).powi(2) * (1.0 + r * r);
            let what = format!("light through a slab at {degrees}°, {}", backend.name());
            assert_mean(&irradiance, cos * orders, 2e-5, 0.05, &what);
        }
    }
}

/// The photons of the first pass for each of 16 seeds.
fn photons_per_seed(scene: &Scene, settings: &[&str]) -> Vec<Vec<PhotonRecord>> {
    let photons = |seed| integrator::photon_records(scene, &options(Kind::Photonmap, settings, seed, 1));
    (0..ESTIMATES).map(photons).collect()
}

/// Parallel light in a reflecting cylinder: the caustic is a nephroid whose cusp lies halfway between axis and wall. Rays
/// that meet the wall at the angle φ cross the symmetry axis at R / (2 cosφ), so light is densest there and falls to
/// its single reflection towards the middle, R/(R − 2x) of the uniform density at x.
#[test]
fn nephroid_in_a_ring() {
    let (radius, height) = (1.0, 2.0);
    let xml = scene(&format!(
        r#"{}<shape type="disk"><bsdf type="diffuse"/></shape>
        <shape type="cylinder"><point name="p0" value="0, 0, 0"/><point name="p1" value="0, 0, {height}"/>
            <float name="radius" value="{radius}"/><boolean name="flip_normals" value="true"/>
            <bsdf type="conductor"/></shape>
        <emitter type="directional"><vector name="direction" value="1, 0, -1"/>
            <rgb name="irradiance" value="1"/></emitter>"#,
        camera(50.0, "0, 0, 5", "0, 0, 0", "0, 1, 0")
    ));
    for backend in backends() {
        let scene = parse(&xml, 16, backend);
        const BINS: usize = 100;
        let mut bins = [0.0f64; BINS];
        let photons =
            photons_per_seed(&scene, &["caustic_photons=200000", "global_photons=1", "max_depth=3"]);
        for p in photons.iter().flatten().filter(|p| p.caustic && p.p.x > 0.0 && p.p.y.abs() < 0.005) {
            bins[(p.p.x * BINS as f32) as usize] += p.flux.x as f64;
        }
        let at = |bin: usize| (bin as f64 + 0.5) / BINS as f64;
        let peak = (0..BINS).max_by(|&a, &b| bins[a].total_cmp(&bins[b])).map_or(0.0, at);
        println!("{}: densest at {peak}", backend.name());
        assert!((peak - 0.5).abs() < 0.02, "{}: the cusp is at {peak}", backend.name());
        for range in [0.05f32..0.2, 0.2..0.3] {
            let inside = |p: &&PhotonRecord| p.caustic && range.contains(&p.p.x) && p.p.y.abs() < 0.02;
            let flux = |all: &Vec<PhotonRecord>| all.iter().filter(inside).map(|p| p.flux.x as f64).sum();
            let per_seed: Vec<f64> = photons.iter().map(flux).collect();
            // The light falls at 45°: irradiance on the wall equals the floor's. ∫ dx / (1 − 2x).
            let [from, to] = [range.start, range.end].map(f64::from);
            let exact = 0.04 * 0.5f64.sqrt() * 0.5 * ((1.0 - 2.0 * from) / (1.0 - 2.0 * to)).ln();
            assert_mean(&per_seed, exact, 1e-3, 0.12, &format!("{range:?}, {}", backend.name()));
        }
    }
}

/// Parallel light on a plane: every cell of a grid receives irradiance times area.
#[test]
fn photons_cover_a_plane_evenly() {
    let xml = scene(&format!(
        r#"{}<shape type="rectangle"><bsdf type="diffuse"/></shape>
        <emitter type="directional"><vector name="direction" value="1, 2, -3"/>
            <rgb name="irradiance" value="2"/></emitter>"#,
        camera(50.0, "0, 0, 5", "0, 0, 0", "0, 1, 0")
    ));
    const CELLS: usize = 4;
    for backend in backends() {
        let scene = parse(&xml, 16, backend);
        let photons = photons_per_seed(&scene, &["global_photons=65536", "direct=map", "final_gather=false"]);
        let exact = 2.0 * (9.0f64 / 14.0).sqrt() * 4.0 / (CELLS * CELLS) as f64;
        for cell in 0..CELLS * CELLS {
            let index = |x: f32| ((x * 0.5 + 0.5) * CELLS as f32) as usize;
            let inside = |p: &&PhotonRecord| index(p.p.x) + CELLS * index(p.p.y) == cell;
            let flux = |all: &Vec<PhotonRecord>| all.iter().filter(inside).map(|p| p.flux.x as f64).sum();
            let per_seed: Vec<f64> = photons.iter().map(flux).collect();
            assert_mean(&per_seed, exact, 1e-4, 0.01, &format!("cell {cell}, {}", backend.name()));
        }
    }
}

/// Uniformly random photons on a plane give the exact radiance in the mean, with every kernel, at both levels: in the
/// middle, at an edge and in a corner, where part of the disk hangs over.
#[test]
fn density_estimation_is_unbiased_where_light_is_even() {
    const MAPS: u64 = 16_000;
    const PHOTONS: u32 = 500;
    const KERNELS: [Kernel; 4] = [Kernel::Constant, Kernel::Cone, Kernel::Epanechnikov, Kernel::Biweight];
    let xml = scene(&format!(
        r#"{}<shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>"#,
        camera(50.0, "0, 0, 5", "0, 0, 0", "0, 1, 0")
    ));
    let backend = backends().next().unwrap();
    let scene = parse(&xml, 16, backend);
    let estimates = |map: u64| {
        let photon = |i: u32| {
            // Independent: one point from each set.
            let u = Sampler::new(9, Stream::GlobalPhotons, map * PHOTONS as u64 + i as u64, 0).next_2d();
            let p = (2.0 * u - 1.0).extend(0.0);
            let flux = Vec3::splat(4.0 / PHOTONS as f32);
            Photon { p, wi: Vec3::Z, n_g: Vec3::Z, tag: 0, flux, depth: 1, caustic: false }
        };
        let photons: Vec<Photon> = (0..PHOTONS).map(photon).collect();
        let map = (PhotonMap::new(&photons), Sampler::new(9, Stream::Eye, map, 0).next_2d());
        let (map, u) = map;
        let mut heap = KnnHeap::new(32);
        let mut at = |x: f32, y: f32| {
            let s = scene.hit(&Ray::new(Vec3::new(x, y, 1.0), -Vec3::Z)).unwrap();
            KERNELS.map(|kernel| {
                let estimator = Estimator::new(32, 1.0, 1.0, kernel);
                let what = Photons { depths: (1, 1), caustics: true };
                let levels = estimator.radiance(&map, &s, Vec3::Z, Share::All, what, true, &mut heap);
                [levels.wide.x, levels.fine.x].map(|l| l as f64 * PI)
            })
        };
        let far = 1.0 - 1e-6;
        let (close, along) = (1.0 - 0.2 * u, 0.3 * (u.x - 0.5));
        // All edges and corners: rounding differs.
        let mut sums = [[[0.0; 2]; KERNELS.len()]; 5];
        let mut add = |place: usize, x, y, share: f64| {
            for (sum, value) in sums[place].iter_mut().zip(at(x, y)) {
                (sum[0], sum[1]) = (sum[0] + share * value[0], sum[1] + share * value[1]);
            }
        };
        for (x, y) in [(0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)] {
            add(0, x * u.x, y * u.y, 0.25);
        }
        for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
            add(1, x * far + y * along, y * far + x * along, 0.25);
            add(2, x * close.x + y * along, y * close.x + x * along, 0.25);
        }
        for (x, y) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            add(3, x * far, y * far, 0.25);
            add(4, x * close.x, y * close.y, 0.25);
        }
        sums
    };
    let all: Vec<_> = (0..MAPS).into_par_iter().map(estimates).collect();
    for (place, name) in
        ["in the middle", "on an edge", "near an edge", "in a corner", "near a corner"].iter().enumerate()
    {
        for (k, kernel) in KERNELS.iter().enumerate() {
            for (level, what, precision) in [(0, "wide", 0.005), (1, "fine", 0.01)] {
                let values: Vec<f64> = all.iter().map(|sums| sums[place][k][level]).collect();
                assert_mean(&values, 1.0, 0.0, precision, &format!("{kernel:?} {name}, {what}"));
            }
        }
    }
}

/// In a closed room all light is absorbed in the end: what photons leave behind at each landing adds up to what was
/// emitted, whatever way they took through the glass.
#[test]
fn transport_keeps_the_flux() {
    let albedo = Vec3::new(0.2, 0.5, 0.8);
    let white = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.5, 0.8"/></bsdf></bsdf>"#;
    let xml = scene(&format!(
        r#"{}<shape type="cube">{white}</shape>
        <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="180"/>
            <translate z="0.9"/></transform>{white}
            <emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter></shape>
        <shape type="sphere"><float name="radius" value="0.4"/><bsdf type="dielectric"/></shape>"#,
        camera(50.0, "0.9, 0, 0", "0, 0, 0", "0, 0, 1")
    ));
    for backend in backends() {
        let scene = parse(&xml, 16, backend);
        let photons = photons_per_seed(&scene, &["global_photons=20000", "caustic_photons=16"]);
        for channel in 0..3 {
            let absorbed = |all: &Vec<PhotonRecord>| {
                let flux = all.iter().filter(|p| !p.caustic).map(|p| p.flux[channel] as f64);
                flux.sum::<f64>() * (1.0 - albedo[channel] as f64)
            };
            let exact = PI * (0.6 * 0.6) * (channel + 1) as f64;
            let per_seed: Vec<f64> = photons.iter().map(absorbed).collect();
            let what = format!("channel {channel}, {}", backend.name());
            assert_mean(&per_seed, exact, 1e-5, 0.01, &what);
        }
    }
}
