//! Lookups of gather rays: the full estimate beside irradiance that was estimated ahead, once per pass. Photons and rays
//! are those of the Cornell box with spheres. Time is per gather ray, short ones included, and per place of an estimate.

use caustica::accel;
use caustica::bsdf::{Mode, Share};
use caustica::math::{Sampler, Stream};
use caustica::photon::kdtree::KnnHeap;
use caustica::photon::{Emission, Estimator, Irradiance, Kernel, PhotonMap, Photons, Store, trace};
use caustica::scene::{self, Scene, Surface};
use criterion::{Criterion, Throughput};
use glam::{Vec2, Vec3};
use std::hint::black_box;

/// Where gather rays end, the direction back along them, and their length.
fn gather_rays(scene: &Scene, n: u64) -> Vec<(Surface<'_>, Vec3, f32)> {
    (0..n)
        .filter_map(|i| {
            let mut sampler = Sampler::new(1, Stream::Eye, 0, i);
            let x = scene.hit(&scene.camera.ray(sampler.next_2d(), Vec2::ZERO))?;
            let wo = x.frame.to_local((scene.camera.ray(Vec2::ZERO, Vec2::ZERO).o - x.p).normalize());
            let sample = x.bsdf.sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance)?;
            let ray = x.spawn(x.frame.to_world(sample.wi));
            let y = scene.hit(&ray).filter(|y| !sample.delta && y.bsdf.diffuse_only().is_some())?;
            let distance = (y.p - x.p).length();
            Some((y, -ray.d, distance))
        })
        .collect()
}

fn bench(c: &mut Criterion) {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-spheres.xml");
    let Some(&backend) = accel::available().first() else { return };
    let scene = scene::load(file.as_ref(), &[], None).and_then(|d| Scene::new(d, backend));
    let scene = scene.expect("the scene is sound");
    let what = Photons { depths: (1, u32::MAX), caustics: true };
    for (name, photons, k) in [("16k_32", 1 << 14, 32), ("256k_32", 1 << 18, 32), ("256k_500", 1 << 18, 500)]
    {
        let rays = gather_rays(&scene, 1 << 14);
        let map = PhotonMap::of_packed(trace(&scene, 1, 0, &Emission::new(Store::All, photons, 64)).photons);
        let sites = trace(&scene, 1, 0, &Emission::new(Store::Sites, 2 * photons / u64::from(k), 64)).sites;
        let estimator = Estimator::new(k, 0.1 * scene.bounds.radius(), 1.0, Kernel::Epanechnikov);
        let irradiance = Irradiance::new(&sites, &map, &estimator, what);
        let (mut heap, mut nearest) = (KnnHeap::new(k as usize), KnnHeap::new(1));
        let mut full = |s: &Surface, wo: Vec3| {
            estimator.radiance(&map, s, wo, Share::BroadLight, what, false, &mut heap).wide
        };
        let mut found = 0;
        for (s, wo, distance) in &rays {
            found += usize::from(irradiance.near(s, *wo, *distance, &mut nearest).is_some());
        }
        println!(
            "{name}: {} sites, {:.1} % of rays use them",
            sites.len(),
            100.0 * found as f32 / rays.len() as f32
        );

        let mut group = c.benchmark_group(format!("gather/{name}"));
        group.sample_size(20).throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function("full", |b| {
            b.iter(|| rays.iter().map(|(s, wo, _)| full(black_box(s), *wo)).sum::<Vec3>());
        });
        group.bench_function("ahead", |b| {
            b.iter(|| {
                let look_up = |(s, wo, distance): &(Surface, Vec3, f32)| {
                    let known = irradiance.near(black_box(s), *wo, *distance, &mut nearest);
                    known.map_or_else(|| full(s, *wo), |e| s.bsdf.diffuse_only().unwrap_or(Vec3::ZERO) * e)
                };
                rays.iter().map(look_up).sum::<Vec3>()
            });
        });
        group.throughput(Throughput::Elements(sites.len() as u64));
        group.bench_function("estimating", |b| b.iter(|| Irradiance::new(&sites, &map, &estimator, what)));
        group.finish();
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    bench(&mut criterion);
    criterion.final_summary();
}
