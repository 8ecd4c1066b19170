//! Photon transport beside its rays alone: the same rays in the same order, on one thread. What is left is emission,
//! scattering, random numbers and storage.

#[path = "../tests/common/meshes.rs"]
mod meshes;
#[path = "../tests/common/recorder.rs"]
mod recorder;

use caustica::accel::{self, Backend};
use caustica::math::Ray;
use caustica::photon::{Emission, Store, trace};
use caustica::scene::{self, Scene, SceneDescription};
use caustica::shape::{Mesh, Shape};
use criterion::{Criterion, Throughput};
use recorder::Recorder;
use std::hint::black_box;
use std::path::Path;
use std::sync::{Arc, Mutex};

fn bench(c: &mut Criterion) {
    const PATHS: u64 = 1 << 14;
    let pool = one_thread();
    let small = ["cornell-diffuse", "cornell-spheres", "pool"].map(|name| (name, scene(name)));
    for (name, scene) in small.into_iter().chain([("scan", scan())]) {
        for &backend in accel::available() {
            let emission = Emission::new(Store::All, PATHS, 64);
            let rays = recorded(scene.clone(), backend, &emission);
            let scene = Scene::new(scene.clone(), backend).expect("a sound scene");
            let mut group = c.benchmark_group(format!("trace/{name}/{}", backend.name()));
            group.sample_size(20).throughput(Throughput::Elements(rays.len() as u64));
            group.bench_function("rays", |b| {
                b.iter(|| rays.iter().filter(|ray| scene.intersect(black_box(ray)).is_some()).count());
            });
            group.bench_function("photons", |b| {
                b.iter(|| pool.install(|| trace(&scene, 1, 0, &emission).rays));
            });
            group.finish();
        }
    }
}

fn one_thread() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread")
}

fn recorded(scene: SceneDescription, backend: Backend, emission: &Emission) -> Vec<Ray> {
    let rays = Arc::new(Mutex::new(Vec::new()));
    let inner = accel::build(backend, &scene.geometry).expect("a sound scene");
    let recorder = Box::new(Recorder { inner, rays: rays.clone() });
    let recording = Scene::with_intersector(scene, recorder).expect("a sound scene");
    let traced = one_thread().install(|| trace(&recording, 1, 0, emission));
    let rays = std::mem::take(&mut *rays.lock().expect("nothing panics"));
    assert_eq!(rays.len() as u64, traced.rays);
    rays
}

fn scene(name: &str) -> SceneDescription {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.xml"));
    scene::load(&file, &[], None).unwrap_or_else(|e| panic!("{e}"))
}

/// 1.3 million triangles in the box.
fn scan() -> SceneDescription {
    let mut scene = scene("cornell-diffuse");
    let (positions, triangles) = meshes::organic(8);
    let positions = positions.into_iter().map(|p| 0.6 * p).collect();
    scene.geometry.shapes.push(Shape::Mesh(Mesh { positions, triangles, ..Mesh::default() }));
    scene.shape_material.push(scene.shape_material[0]);
    scene
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    bench(&mut criterion);
    criterion.final_summary();
}
