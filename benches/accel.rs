//! Every backend's build and rays per second, on the same scenes and rays: `cargo bench --bench accel`. One thread
//! traces. Embree is built as rendering builds it: robust, medium quality.

#![allow(missing_docs)] // criterion_group! makes a public function

mod workload;

use caustica::accel::{available, build};
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

fn accel(c: &mut Criterion) {
    for workload in [workload::cornell(), workload::scan(), workload::hostile()] {
        let mut group = c.benchmark_group(workload.name);
        group.sample_size(10).sampling_mode(SamplingMode::Flat);
        for &backend in available() {
            group.bench_function(format!("build/{}", backend.name()), |b| {
                b.iter_with_large_drop(|| build(backend, &workload.geometry).unwrap())
            });
        }
        let built: Vec<_> =
            available().iter().map(|&b| (b.name(), build(b, &workload.geometry).unwrap())).collect();
        for rays in workload.rays(workload.count) {
            group.throughput(Throughput::Elements(rays.rays.len() as u64));
            for (backend, built) in &built {
                group.bench_function(format!("{}/{backend}", rays.name), |b| {
                    b.iter(|| {
                        let hits = |ray| {
                            if rays.shadow {
                                built.occluded(ray)
                            } else {
                                black_box(built.intersect(ray)).is_some()
                            }
                        };
                        rays.rays.iter().filter(|&ray| hits(ray)).count()
                    })
                });
            }
        }
    }
}

criterion_group!(benches, accel);
criterion_main!(benches);
