//! Incoherent rays per second of every backend, on a bumpy sphere of 100k triangles with a few analytic spheres in it.

#![allow(missing_docs)] // criterion_group! makes a public function

use caustica::accel::{available, build};
use caustica::math::{Ray, warp};
use caustica::shape::{Geometry, Mesh, Shape, Sphere};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::PI;
use std::hint::black_box;

fn scene() -> Geometry {
    const N: u32 = 160;
    let mut mesh = Mesh::default();
    for i in 0..=N {
        for j in 0..2 * N {
            let (theta, phi) = (i as f32 / N as f32 * PI, j as f32 / N as f32 * PI);
            let d = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            mesh.positions
                .push(d * (1.0 + 0.05 * (19.0 * d.x).sin() * (17.0 * d.y).cos() * (18.0 * d.z).sin()));
        }
    }
    for i in 0..N {
        for j in 0..2 * N {
            let at = |i, j| i * 2 * N + j % (2 * N);
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let mut shapes = vec![Shape::Mesh(mesh)];
    for center in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_ONE * 0.5] {
        shapes.extend(Sphere::new(center * 0.6, 0.2, Affine3A::IDENTITY, false).map(Shape::Sphere));
    }
    Geometry { shapes }
}

/// From anywhere in and around the scene to anywhere.
fn rays(n: u32) -> Vec<Ray> {
    let unit = |i: u32, prime: u32| (i.wrapping_mul(prime) >> 8) as f32 / (1 << 24) as f32;
    let pair = |i, p, q| Vec2::new(unit(i, p), unit(i, q));
    (0..n)
        .map(|i| {
            let i = i.wrapping_mul(0x9e37_79b9) ^ i.rotate_left(13);
            let o = warp::sphere(pair(i, 0x85eb_ca6b, 0xc2b2_ae35)) * (2.0 * unit(i, 0x27d4_eb2f));
            Ray::new(o, warp::sphere(pair(i, 0x1656_67b1, 0x9e37_79b1)))
        })
        .collect()
}

fn accel(c: &mut Criterion) {
    let (geometry, rays) = (scene(), rays(10_000));
    let mut group = c.benchmark_group("accel");
    for &backend in available() {
        group.bench_function(format!("{}/build", backend.name()), |b| {
            b.iter(|| build(backend, &geometry).unwrap())
        });
        let built = build(backend, &geometry).unwrap();
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(format!("{}/intersect", backend.name()), |b| {
            b.iter(|| rays.iter().filter(|r| black_box(built.intersect(r)).is_some()).count())
        });
        group.bench_function(format!("{}/occluded", backend.name()), |b| {
            b.iter(|| rays.iter().filter(|r| black_box(built.occluded(r))).count())
        });
        group.throughput(Throughput::Elements(1));
    }
    group.finish();
}

criterion_group!(benches, accel);
criterion_main!(benches);
