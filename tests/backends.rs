//! Embree and our own BVH see the same, in pictures and ray by ray. Where only one of them is built in, there is nothing
//! to compare.
#![cfg(all(feature = "embree", feature = "bvh"))]

mod common;
#[path = "common/recorder.rs"]
mod recorder;

use caustica::accel::{self, Backend};
use caustica::image_io;
use caustica::integrator::Kind;
use caustica::math::{Frame, Ray, Sampler, Stream, warp};
use caustica::metrics;
use caustica::photon::{self, Emission, Store};
use caustica::scene::{self, Scene};
use caustica::shape::{Geometry, Hit, Shape};
use common::{load, own_scene, render, shared};
use rayon::prelude::*;
use recorder::Recorder;
use std::sync::Arc;

/// Embree first.
const BACKENDS: [Backend; 2] = [Backend::Embree, Backend::Bvh];

/// The names of all scenes of this project that have a reference.
fn scenes() -> Vec<String> {
    let files = std::fs::read_dir(own_scene("")).unwrap().map(|entry| entry.unwrap().path());
    let mut names: Vec<String> = files
        .filter(|file| file.extension().is_some_and(|e| e == "xml"))
        .map(|file| file.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    assert!(names.len() >= 6, "{names:?}");
    names
}

/// Of one seed, pictures differ by at most a tenth of their error: in squares, which is what relmse is of.
fn pictures_agree(passes: u32) {
    println!(
        "{passes} passes: relmse of one against the other, and of Embree's picture against the reference"
    );
    let mut worse = Vec::new();
    for name in scenes() {
        let file = own_scene(&format!("{name}.xml"));
        let [embree, bvh] =
            BACKENDS.map(|backend| render(&load(&file, 128, backend), Kind::Photonmap, &[], passes));
        let between = metrics::relmse(&bvh.image, &embree.image);
        let (own, against) = match shared(&format!("reference/ref/{name}.exr")) {
            Some(reference) => {
                (metrics::relmse(&embree.image, &image_io::read(&reference).unwrap()), "reference")
            }
            // What the render itself knows of its noise.
            None => (embree.error.noise.powi(2), "estimate"),
        };
        let ratio = between / own;
        println!("{name:16} between {between:.2e}  own {own:.2e} ({against})  ratio {ratio:.5}");
        if ratio.is_nan() || ratio > 0.1 {
            worse.push(name);
        }
    }
    assert!(worse.is_empty(), "the backends' pictures differ by too much: {worse:?}");
}

#[test]
fn pictures_differ_by_less_than_their_error() {
    pictures_agree(4);
}

#[test]
#[ignore = "minutes; CI runs it nightly"]
fn good_pictures_differ_by_less_than_their_error() {
    pictures_agree(64);
}

/// Rays from the camera, diffuse bounces from where they and each other land, and shadow rays from there: `samples` per
/// pixel. Embree's hits decide where paths go.
fn eye_rays(scene: &Scene, samples: u64) -> [Vec<Ray>; 3] {
    let [mut camera, mut bounces, mut shadows] = [const { Vec::new() }; 3];
    for pixel in 0..scene.film.size.0 * scene.film.size.1 {
        for sample in 0..samples {
            let mut sampler = Sampler::new(3, Stream::Eye, pixel as u64, sample);
            let at = (pixel % scene.film.size.0, pixel / scene.film.size.0);
            let mut ray = scene.camera_ray(at, &mut sampler);
            camera.push(ray);
            for _ in 0..3 {
                let Some(s) = scene.hit(&ray) else { break };
                let (u_light, u) = (sampler.next_1d(), sampler.next_2d());
                let (geometry, textures) = (&scene.geometry, &scene.textures);
                if let Some(light) = scene.lights.sample_direct(geometry, textures, s.p, u_light, u) {
                    shadows.push(light.target.map_or_else(|| s.spawn(light.wi), |p| s.spawn_to(p)));
                }
                let n = if ray.d.dot(s.n_g) < 0.0 { s.n_g } else { -s.n_g };
                let d = warp::cosine_hemisphere(sampler.next_2d());
                ray = s.spawn(Frame::from_normal(n).to_world(d));
                bounces.push(ray);
            }
        }
    }
    [camera, bounces, shadows]
}

/// What f64 knows of a hit.
#[derive(Debug)]
struct Known {
    /// Where it is along the ray, and how far off f32 may see it.
    t: f64,
    t_error: f64,
    /// How far inside of its triangle, and how far edges may move as the vertices are rounded relative to the ray's origin.
    inside: f64,
    moved: f64,
}

fn known(geometry: &Geometry, ray: &Ray, hit: &Hit) -> Known {
    let Shape::Mesh(mesh) = &geometry.shapes[hit.shape as usize] else {
        // The same code for both.
        let t = hit.t as f64;
        return Known { t, t_error: t * f32::EPSILON as f64, inside: f64::INFINITY, moved: 0.0 };
    };
    let [a, b, c] = mesh.vertices(hit.primitive).map(|p| p.as_dvec3() - ray.o.as_dvec3());
    let d = ray.d.as_dvec3();
    let n = (b - a).cross(c - a);
    let t = n.dot(a) / n.dot(d);
    let largest = [a, b, c].iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let rounding = 8.0 * f32::EPSILON as f64 * largest;
    let slope = n.length() * d.length() / n.dot(d).abs();
    let edges = [(a, b - a), (b, c - b), (c, a - c)];
    let longest = edges.iter().map(|(_, e)| e.length()).fold(0.0, f64::max);
    let distance = |(p, e)| n.dot(glam::DVec3::cross(e, d * t - p)) / (n.length() * e.length());
    Known {
        t,
        t_error: rounding * slope * (longest * longest / n.length()) / d.length(),
        inside: edges.into_iter().map(distance).fold(f64::MAX, f64::min),
        moved: rounding * slope,
    }
}

/// How answers compare.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    rays: u64,
    hits: u64,
    /// Two primitives at one distance: through what they share, or where they coincide.
    ties: u64,
    /// Hit by one alone, within rounding of an edge or of the ray's end.
    edges: u64,
    /// The largest difference of distances, across the surface, in ulps of the largest coordinate relative to the origin.
    worst: f64,
}

impl Tally {
    fn add(mut self, o: Tally) -> Tally {
        self.rays += o.rays;
        self.hits += o.hits;
        self.ties += o.ties;
        self.edges += o.edges;
        self.worst = self.worst.max(o.worst);
        self
    }
}

/// The answers to one ray; fails where they differ by more than a tie.
fn compare(geometry: &Geometry, ray: &Ray, [a, b]: [Option<Hit>; 2]) -> Tally {
    let mut tally = Tally { rays: 1, hits: a.is_some() as u64, ..Tally::default() };
    let (nearer, other) = match (a, b) {
        (None, None) => return tally,
        (Some(a), Some(b)) if (a.shape, a.primitive) == (b.shape, b.primitive) => {
            match &geometry.shapes[a.shape as usize] {
                Shape::Mesh(mesh) => {
                    let [u, v, w] = mesh.vertices(a.primitive).map(|p| p.as_dvec3() - ray.o.as_dvec3());
                    let size = [u, v, w].iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
                    let across = (v - u).cross(w - u).normalize().dot(ray.d.as_dvec3()).abs();
                    tally.worst = (a.t as f64 - b.t as f64).abs() * across / (size * f32::EPSILON as f64);
                }
                _ => assert_eq!(a, b, "{ray:?}"),
            }
            return tally;
        }
        (Some(a), Some(b)) if a.t <= b.t => (a, Some(b)),
        (Some(a), Some(b)) => (b, Some(a)),
        (a, b) => (a.or(b).unwrap(), None),
    };
    let seen = known(geometry, ray, &nearer);
    let tie = other.is_some_and(|other| {
        let behind = known(geometry, ray, &other);
        (behind.t - seen.t).abs() <= seen.t_error + behind.t_error
    });
    let end = [ray.t_min, ray.t_max].iter().any(|&t| (seen.t - t as f64).abs() <= seen.t_error);
    if tie {
        tally.ties = 1;
    } else {
        assert!(end || seen.inside.abs() <= seen.moved, "{ray:?}: Embree {a:?}, BVH {b:?}: {seen:?}");
        tally.edges = 1;
    }
    tally
}

fn rays_agree(samples: u64, photons: u64) {
    for name in scenes() {
        let description = scene::load(&own_scene(&format!("{name}.xml")), &[], Some((64, 64))).unwrap();
        let geometry = description.geometry.clone();
        let backends = BACKENDS.map(|backend| accel::build(backend, &geometry).unwrap());
        let rays = Arc::default();
        let inner = accel::build(Backend::Embree, &geometry).unwrap();
        let recorder = Recorder { inner, rays: Arc::clone(&rays) };
        let scene = Scene::with_intersector(description, Box::new(recorder)).unwrap();
        let [camera, bounces, shadows] = eye_rays(&scene, samples);
        rays.lock().unwrap().clear();
        for store in [Store::All, Store::Caustic] {
            photon::trace(&scene, 3, 0, &Emission::new(store, photons, 64));
        }
        let flights = std::mem::take(&mut *rays.lock().unwrap());
        for (kind, rays) in
            [("camera", camera), ("bounce", bounces), ("shadow", shadows), ("photon", flights)]
        {
            let one = |ray: &Ray| {
                let hits = backends.each_ref().map(|backend| {
                    let hit = backend.intersect(ray);
                    assert_eq!(backend.occluded(ray), hit.is_some(), "{name}: {ray:?} {hit:?}");
                    hit
                });
                compare(&geometry, ray, hits)
            };
            let tally = rays.par_iter().map(one).reduce(Tally::default, Tally::add);
            let Tally { rays, hits, ties, edges, worst } = tally;
            println!(
                "{name:16} {kind}: {rays:8} rays {hits:8} hits {ties:5} ties {edges:5} at edges, within {worst:.1} ulps"
            );
            assert!(rays > 0);
            assert!(worst < 8.0, "{name}, {kind}: {tally:?}");
            assert!(ties + edges <= rays / 1000, "{name}, {kind}: {tally:?}");
        }
    }
}

#[test]
fn rays_of_all_kinds_hit_alike() {
    rays_agree(1, 4000);
}

#[test]
#[ignore = "a minute; CI runs it nightly"]
fn many_rays_of_all_kinds_hit_alike() {
    rays_agree(64, 500_000);
}
