//! What a photon and a ray cost as scenes grow: time and memory for 10⁵ to 10⁸ photons, and for 10⁴ to 10⁷ triangles with
//! every backend. Prints tables; each row is measured by a process of its own, so that its peak memory is its own.
//!
//! ```text
//! cargo bench --bench scale [-- photons N | BACKEND TRIANGLES]
//! ```

use caustica::accel::{available, build};
use caustica::math::{Ray, Sampler, Stream, warp};
use caustica::photon::kdtree::KnnHeap;
use caustica::photon::{Emission, PhotonMap, Store, trace};
use caustica::scene::{self, Scene};
use caustica::shape::{Geometry, Mesh, Shape};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;
use std::path::Path;
use std::process::{Command, exit};
use std::time::Instant;

/// Searches and rays per row.
const N: u64 = 1 << 20;
const K: usize = 50;

fn main() {
    // Cargo adds --bench.
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    match &args[..] {
        [what, n] => {
            let Ok(n) = n.parse() else { fail(&format!("'{n}' is no number")) };
            match what.as_str() {
                "photons" => photons(n),
                backend => triangles(backend, n),
            }
        }
        [] => {
            println!(
                "| photons | trace, ns | build, ns | {K} nearest, µs | kept, bytes | peak, bytes | peak, GiB |"
            );
            println!("|---|---|---|---|---|---|---|");
            (5..=8).for_each(|e| row("photons", 10u64.pow(e)));
            println!("\n| backend | triangles | build, ns | bytes | ray, ns |");
            println!("|---|---|---|---|---|");
            for backend in available() {
                (4..=7).for_each(|e| row(backend.name(), 10u64.pow(e)));
            }
        }
        _ => fail("usage: scale [photons N | BACKEND TRIANGLES]"),
    }
}

fn fail(message: &str) -> ! {
    eprintln!("error: {message}");
    exit(2);
}

fn row(what: &str, n: u64) {
    let done = std::env::current_exe().and_then(|me| Command::new(me).args([what, &n.to_string()]).status());
    match done {
        Ok(status) if status.success() => {}
        Ok(status) => println!("| {what} {n} | {status} |"),
        Err(e) => fail(&e.to_string()),
    }
}

/// Bytes of memory by their name in `/proc/self/status`: resident now, or at most so far.
fn memory(name: &str) -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'));
    line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// Photons of a diffuse room, from emission to lookup.
fn photons(n: u64) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-diffuse.xml");
    let scene = scene::load(&file, &[], None).and_then(|d| Scene::new(d, available()[0]));
    let scene = scene.unwrap_or_else(|e| fail(&e.to_string()));
    let shoot = |count| trace(&scene, 1, 0, &Emission::new(Store::All, count, u32::MAX)).photons;
    let emitted = 1 << 16;
    let emitted = (n as f64 * emitted as f64 / shoot(emitted).len() as f64) as u64;

    let before = memory("VmRSS");
    let start = Instant::now();
    let photons = shoot(emitted);
    let (traced, start) = (start.elapsed(), Instant::now());
    let map = PhotonMap::of_packed(photons);
    let built = start.elapsed();
    let (kept, peak) = (memory("VmRSS") - before, memory("VmHWM"));

    let start = Instant::now();
    let found: usize = (0..N)
        .into_par_iter()
        .map_init(
            || KnnHeap::new(K),
            |heap, i| {
                let u = Sampler::new(2, Stream::Eye, i, 0).next_1d();
                let p = map.tree().position((u * map.len() as f32).min(map.len() as f32 - 1.0) as u32);
                map.tree().nearest(p + Vec3::splat(1e-4), f32::INFINITY, heap);
                heap.len()
            },
        )
        .sum();
    assert_eq!(found as u64, N * K as u64);
    let searched = start.elapsed();
    let per = |x: f64| x / map.len() as f64;
    println!(
        "| {:.2e} | {:.0} | {:.0} | {:.2} | {:.1} | {:.1} | {:.2} |",
        map.len() as f64,
        per(traced.as_nanos() as f64),
        per(built.as_nanos() as f64),
        searched.as_secs_f64() * 1e6 / N as f64,
        per(kept as f64),
        per((peak - before) as f64),
        peak as f64 / (1u64 << 30) as f64,
    );
}

/// A bumpy sphere of about `n` triangles.
fn bumpy(n: u64) -> Mesh {
    let rows = (n as f64 / 4.0).sqrt().round() as u32;
    let mut mesh = Mesh::default();
    for i in 0..=rows {
        for j in 0..2 * rows {
            let (theta, phi) = (i as f32 / rows as f32 * PI, j as f32 / rows as f32 * PI);
            let d = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let height = 1.0 + 0.05 * (19.0 * d.x).sin() * (17.0 * d.y).cos() * (18.0 * d.z).sin();
            mesh.positions.push(d * height);
        }
    }
    for i in 0..rows {
        for j in 0..2 * rows {
            let at = |i, j| i * 2 * rows + j % (2 * rows);
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

/// Incoherent rays, from around a mesh into all directions.
fn triangles(backend: &str, n: u64) {
    let Some(&backend) = available().iter().find(|b| b.name() == backend) else {
        fail(&format!("this build has no backend '{backend}'"))
    };
    let geometry = Geometry::from(vec![Shape::Mesh(bumpy(n))]);
    let n = geometry
        .shapes
        .iter()
        .map(|s| if let Shape::Mesh(m) = s { m.triangles.len() } else { 0 })
        .sum::<usize>();
    let before = memory("VmRSS");
    let start = Instant::now();
    let accel = build(backend, &geometry).unwrap_or_else(|e| fail(&e.to_string()));
    let (built, kept) = (start.elapsed(), memory("VmRSS") - before);
    let start = Instant::now();
    let hits = (0..N)
        .into_par_iter()
        .filter(|&i| {
            let mut sampler = Sampler::new(1, Stream::Eye, i, 0);
            let o = warp::sphere(sampler.next_2d()) * (2.0 * sampler.next_1d());
            accel.intersect(&Ray::new(o, warp::sphere(sampler.next_2d()))).is_some()
        })
        .count();
    assert!(hits > 0);
    println!(
        "| {} | {:.2e} | {:.0} | {:.0} | {:.0} |",
        backend.name(),
        n as f64,
        built.as_nanos() as f64 / n as f64,
        kept as f64 / n as f64,
        start.elapsed().as_nanos() as f64 / N as f64,
    );
}
