//! The kd-tree beside the `kiddo` crate (its immutable tree), on photons spread over surfaces and on a caustic.
//! Searches start where photons lie, in random order. Time is per search, and per build of the whole tree.

use caustica::math::{Sampler, Stream, warp};
use caustica::photon::kdtree::{KdTree, KnnHeap};
use criterion::{BatchSize, Criterion, Throughput};
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::hint::black_box;
use std::num::NonZero;

const N: u64 = 1_000_000;
const K: usize = 50;

/// The walls of a room and a ball in it.
fn uniform(u: &mut Sampler) -> Vec3 {
    let (wall, p) = (u.next_1d() * 7.0, u.next_2d());
    let side = wall.fract().round();
    match wall as u32 / 2 {
        0 => Vec3::new(side, p.x, p.y),
        1 => Vec3::new(p.x, side, p.y),
        2 => Vec3::new(p.x, p.y, side),
        _ => 0.5 + 0.2 * warp::sphere(p),
    }
}

/// The nephroid that a ring throws onto the floor, over a faint background.
fn clustered(u: &mut Sampler) -> Vec3 {
    let (lobe, p) = (u.next_1d(), u.next_2d());
    if lobe < 0.1 {
        return p.extend(0.0);
    }
    let (sin, cos) = (std::f32::consts::TAU * p.x).sin_cos();
    let cusp = glam::Vec2::new(cos * cos * cos, sin + 0.5 * sin * cos * cos);
    (0.5 + 0.3 * (1.0 - 0.3 * p.y.powi(4)) * cusp).extend(0.0)
}

fn points(kind: fn(&mut Sampler) -> Vec3, seed: u64, n: u64) -> Vec<Vec3> {
    (0..n).map(|i| kind(&mut Sampler::new(seed, Stream::GlobalPhotons, i, 0))).collect()
}

fn bench(c: &mut Criterion) {
    for (name, kind) in [("uniform", uniform as fn(&mut Sampler) -> Vec3), ("clustered", clustered)] {
        let photons = points(kind, 1, N);
        let arrays: Vec<[f32; 3]> = photons.iter().map(|p| p.to_array()).collect();
        let queries = points(kind, 2, 1 << 15);
        let (tree, _) = KdTree::build(&photons);
        let kiddo = ImmutableKdTree::<f32, 3>::new_from_slice(&arrays);
        let mut next = queries.iter().cycle();
        let mut query = || *next.next().expect("cycle is endless");

        // The radius that holds 50 photons on average.
        let mut r = 0.01f32;
        for _ in 0..12 {
            let mut found = 0;
            queries[..2000].iter().for_each(|&p| tree.within(p, r, |_, _| found += 1));
            r *= (K as f32 * 2000.0 / found as f32).sqrt();
        }

        let mut group = c.benchmark_group(format!("kdtree/{name}/build"));
        group.sample_size(10).throughput(Throughput::Elements(N));
        group.bench_function("caustica", |b| b.iter_with_large_drop(|| KdTree::build(&photons)));
        group.bench_function("kiddo", |b| {
            b.iter_with_large_drop(|| ImmutableKdTree::<f32, 3>::new_from_slice(&arrays));
        });
        group.finish();

        for k in [1, K] {
            for r_max in [f32::INFINITY, 1.25 * r] {
                let limit = if r_max < f32::INFINITY { "_within_r" } else { "" };
                let mut heap = KnnHeap::new(k);
                let n = NonZero::new(k).expect("k > 0");
                let mut group = c.benchmark_group(format!("kdtree/{name}/nearest_{k}{limit}"));
                group.bench_function("caustica", |b| {
                    b.iter_batched(
                        &mut query,
                        |p| {
                            tree.nearest(p, r_max, &mut heap);
                            heap.max_dist2()
                        },
                        BatchSize::SmallInput,
                    );
                });
                group.bench_function("kiddo", |b| {
                    b.iter_batched(
                        &mut query,
                        |p| {
                            let p = p.to_array();
                            if k == 1 && r_max == f32::INFINITY {
                                kiddo.nearest_one::<SquaredEuclidean>(&p).distance
                            } else if r_max == f32::INFINITY {
                                kiddo
                                    .nearest_n::<SquaredEuclidean>(&p, n)
                                    .iter()
                                    .fold(0.0, |m, x| x.distance.max(m))
                            } else {
                                kiddo
                                    .nearest_n_within::<SquaredEuclidean>(&p, r_max * r_max, n, false)
                                    .iter()
                                    .fold(0.0, |m, x| x.distance.max(m))
                            }
                        },
                        BatchSize::SmallInput,
                    );
                });
                group.finish();
            }
        }

        let mut group = c.benchmark_group(format!("kdtree/{name}/within_r"));
        group.bench_function("caustica", |b| {
            b.iter_batched(
                &mut query,
                |p| {
                    let mut sum = 0.0;
                    tree.within(p, r, |_, d2| sum += d2);
                    sum
                },
                BatchSize::SmallInput,
            );
        });
        group.bench_function("kiddo", |b| {
            b.iter_batched(
                &mut query,
                |p| {
                    let found = kiddo.within_unsorted::<SquaredEuclidean>(&p.to_array(), r * r);
                    black_box(found).iter().map(|x| x.distance).sum::<f32>()
                },
                BatchSize::SmallInput,
            );
        });
        group.finish();
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    bench(&mut criterion);
    criterion.final_summary();
}
