//! Where light reaches the picture: the density, on surfaces, of how much of the light there shows, relative
//! to what the pixel shows anyway.

use super::PhotonMap;
use super::estimate::{Estimator, Kernel, Photons, Place, Site, near_plane};
use super::kdtree::{KdTree, KnnHeap};
use super::map::Packed;
use super::trace::Store;
use crate::bsdf::{BsdfSample, Mode, Share};
use crate::math::{Ray, Rgb, Sampler, Stream, luminance};
use crate::scene::{Scene, Surface};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Camera paths that find out.
const PATHS: u64 = 2048;
/// What is behind more mirrors than that is not worth looking for.
const LONGEST: u32 = 12;
/// How far from a place that shows, in units of the distances between such places there, light may still
/// show.
const REACH: f32 = 2.0;
/// Pixels darker than this share of the mean count as if they were as bright as that.
const DARKEST: f32 = 0.1;

/// Which photons are looked up where.
#[derive(Clone, Copy, Debug)]
pub struct Uses {
    /// Whether those of the global map that come straight from their light show where the camera looks.
    pub direct: bool,
    /// Whether gather rays look for photons, too.
    pub gathers: bool,
}

/// Places that show in the picture.
pub struct Importance {
    uses: Uses,
    /// Those that the camera sees, directly or by sharp lobes.
    seen: Places,
    /// Those that gather rays find from there, likewise.
    gathered: Places,
    /// What each camera path shows of lights themselves.
    emitted: Vec<f32>,
}

/// Places, found by position.
struct Places {
    tree: KdTree,
    points: Vec<Point>,
    r_max: f32,
}

#[derive(Clone, Copy)]
struct Point {
    p: Vec3,
    n_g: Vec3,
    /// Tells the surface from others.
    tag: u8,
    magnitude: f32,
    /// On the side from which light shows; zero if it does from either.
    side: Vec3,
    /// The camera path that found it.
    path: u32,
    /// The part of the irradiance there that the path would show, times π.
    throughput: f32,
    /// The same relative to what the path shows.
    weight: f32,
    /// Light farther away than the root of this is elsewhere.
    reach2: f32,
}

impl Point {
    fn new(s: &Surface, ray: &Ray, beta: Rgb, path: u32) -> Option<Point> {
        let side = match s.bsdf.transmits() {
            true => Vec3::ZERO,
            false => s.n_g * 1f32.copysign(-s.n_g.dot(ray.d)),
        };
        let throughput = luminance(beta * s.bsdf.albedo());
        (throughput > 0.0 && throughput.is_finite()).then_some(Point {
            p: s.p,
            n_g: s.n_g,
            tag: s.tag(),
            magnitude: s.magnitude,
            side,
            path,
            throughput,
            weight: throughput,
            reach2: 0.0,
        })
    }
}

impl Places {
    fn new(found: &[Point], scene: &Scene) -> Places {
        let positions: Vec<Vec3> = found.iter().map(|point| point.p).collect();
        let (tree, order) = KdTree::build(&positions);
        let points: Vec<Point> = order.iter().map(|&i| found[i as usize]).collect();
        let mut places = Places { tree, points, r_max: 0.05 * scene.bounds.radius() };
        let reach2: Vec<f32> = places
            .points
            .par_iter()
            .with_min_len(64)
            .map_init(|| KnnHeap::new(Importance::K), |heap, point| places.spacing2(point, heap))
            .collect();
        places.points.iter_mut().zip(reach2).for_each(|(point, reach2)| point.reach2 = reach2);
        places
    }

    /// The square of [`REACH`] times the distance to the last of the neighbours of `point`.
    fn spacing2(&self, point: &Point, heap: &mut KnnHeap) -> f32 {
        self.tree.nearest_filtered(point.p, self.r_max, heap, |slot, d2| {
            let other = &self.points[slot as usize];
            near_plane(point.n_g, other.p - point.p, d2) && point.n_g.dot(other.n_g) > 0.7
        });
        let r2 = if heap.is_full() { heap.max_dist2() } else { self.r_max * self.r_max };
        REACH * REACH * r2
    }

    /// How much of the flux of a photon that has landed at `p`, on a surface with normal `n_g`, from `wi`
    /// shows.
    fn shown(&self, scene: &Scene, p: Vec3, n_g: Vec3, wi: Vec3, heap: &mut KnnHeap) -> f32 {
        // By the photon's own normal: light that grazes a round shell from outside does not shine in.
        let side = n_g * n_g.dot(wi);
        self.tree.nearest_filtered(p, self.r_max, heap, |slot, d2| {
            let point = &self.points[slot as usize];
            d2 <= point.reach2
                && near_plane(n_g, point.p - p, d2)
                && n_g.dot(point.n_g) > 0.7
                && point.side.dot(side) >= 0.0
        });
        let Some((nearest, d2)) = heap.iter().min_by(|a, b| a.1.total_cmp(&b.1)) else { return 0.0 };
        let points = || heap.iter().map(|(slot, _)| &self.points[slot as usize]);
        let r2 = match heap.is_full() {
            true => heap.max_dist2(),
            false => points().map(|point| point.reach2).fold(0.0, f32::max),
        };
        // A wall stands between a room and the sunlit ground beside it, which may well be one plane with the
        // floor.
        let nearest = &self.points[nearest as usize];
        if d2 > 1e-4 * self.r_max * self.r_max && !connected(scene, p, nearest, n_g, wi, d2.sqrt()) {
            return 0.0;
        }
        let sum: f32 = points().map(|point| point.weight).sum();
        // No smaller than what rounding leaves of a distance.
        sum / (PI * r2.max(1e-9 * self.r_max * self.r_max))
    }
}

/// Whether nothing stands between `p` and the point nearby, both on the side of `wi`.
fn connected(scene: &Scene, p: Vec3, point: &Point, n_g: Vec3, wi: Vec3, distance: f32) -> bool {
    // So far above the surface that it may be curved.
    let above = |n: Vec3| n * (0.1 * distance).copysign(n.dot(wi));
    let (from, to) = (p + above(n_g), point.p + above(point.n_g));
    let (d, t_max) = (to - from, (to - from).length());
    t_max <= 0.0 || !scene.occluded(&Ray { o: from, t_min: 0.0, d: d / t_max, t_max })
}

impl Importance {
    pub(super) const K: usize = 8;

    /// Looks at the scene. The same for any number of threads.
    pub fn new(scene: &Scene, uses: Uses) -> Importance {
        let looks: Vec<Look> = (0..PATHS)
            .into_par_iter()
            .map(|index| {
                let mut look = Look { path: index as u32, ..Look::default() };
                look.along(scene, &mut Sampler::new(0, Stream::Pilots, u64::MAX, index));
                look
            })
            .collect();
        let of = |points: fn(&Look) -> &Vec<Point>| {
            let found: Vec<Point> = looks.iter().flat_map(points).copied().collect();
            Places::new(&found, scene)
        };
        Importance {
            uses,
            seen: of(|look| &look.seen),
            gathered: of(|look| &look.gathered),
            emitted: looks.iter().map(|look| look.emitted).collect(),
        }
    }

    /// Where the places are.
    pub(super) fn positions(&self) -> Vec<Vec3> {
        let places = [&self.seen, &self.gathered];
        let places = places.into_iter().take(if self.uses.gathers { 2 } else { 1 });
        places.flat_map(|places| places.points.iter().map(|point| point.p)).collect()
    }

    /// How much of the flux of `photon`, which the map of `store` holds, shows.
    pub(super) fn shown(&self, scene: &Scene, photon: &Packed, store: Store, heap: &mut KnnHeap) -> f32 {
        let photon = photon.unpack();
        let mut of = |places: &Places| places.shown(scene, photon.p, photon.n_g, photon.wi, heap);
        let is_seen = match store {
            Store::Caustic => true,
            _ => !photon.caustic && (photon.depth > 1 || self.uses.direct),
        };
        let mut density = if is_seen { of(&self.seen) } else { 0.0 };
        if self.uses.gathers && store != Store::Caustic {
            density += of(&self.gathered);
        }
        luminance(photon.flux) * density
    }

    /// Whether the camera looks where `photon` has landed, straight from its light: what it shows there is
    /// sampled from the light, if it is not taken from the map.
    pub(super) fn sees_direct(&self, scene: &Scene, photon: &Packed, heap: &mut KnnHeap) -> bool {
        let photon = photon.unpack();
        photon.depth == 1 && self.seen.shown(scene, photon.p, photon.n_g, photon.wi, heap) > 0.0
    }

    /// Counts what shows relative to what the pixel shows anyway, as far as `photons` tell, whose flux is `count` times
    /// that of one of so many.
    pub(super) fn balance(&mut self, scene: &Scene, photons: Vec<Packed>, count: u64) {
        let map = PhotonMap::of_packed(photons);
        let estimator = Estimator::new(Self::K as u32 * 2, 2.0 * self.seen.r_max, 1.0, Kernel::Epanechnikov);
        let what = Photons { depths: (1, PhotonMap::MAX_DEPTH), caustics: true };
        let irradiance: Vec<f32> = self
            .seen
            .points
            .par_iter()
            .with_min_len(64)
            .map_init(
                || KnnHeap::new(estimator.k as usize),
                |heap, point| {
                    let Point { p, n_g, tag, magnitude, .. } = *point;
                    let place = Place { scene, p, n_g, tag, facet: None, magnitude };
                    let n_s = if point.side == Vec3::ZERO { point.n_g } else { point.side };
                    luminance(estimator.irradiance(&map, &Site { place, n_s }, what, heap).0)
                },
            )
            .collect();
        let mut shown = self.emitted.clone();
        for (point, irradiance) in self.seen.points.iter().zip(irradiance) {
            shown[point.path as usize] += point.throughput * irradiance * FRAC_1_PI / count as f32;
        }
        let mean = shown.iter().filter(|x| x.is_finite()).sum::<f32>() / shown.len() as f32;
        let floor = DARKEST * mean;
        if !(floor > 0.0 && floor.is_finite()) {
            return;
        }
        for point in self.seen.points.iter_mut().chain(&mut self.gathered.points) {
            let relative = point.throughput / (shown[point.path as usize] + floor);
            point.weight = if relative.is_finite() { relative } else { 0.0 };
        }
    }
}

/// Where one camera path would show light.
#[derive(Default)]
struct Look {
    path: u32,
    seen: Vec<Point>,
    gathered: Vec<Point>,
    emitted: f32,
}

impl Look {
    fn along(&mut self, scene: &Scene, sampler: &mut Sampler) {
        let mut ray = scene.random_camera_ray(sampler);
        let mut beta = Rgb::ONE;
        let mut gather = None;
        for _ in 0..LONGEST {
            let Some(s) = scene.hit(&ray) else {
                self.emitted += luminance(beta * scene.lights.background(ray.d));
                break;
            };
            self.emitted += luminance(beta * scene.emitted(&s, -ray.d));
            if s.is_crossed(sampler) {
                ray = s.spawn(ray.d);
                continue;
            }
            if s.bsdf.has_smooth() {
                self.seen.extend(Point::new(&s, &ray, beta, self.path));
            }
            let Some((sample, broad)) = scatter(&s, &ray, Share::BroadEye, sampler) else { break };
            if broad != Rgb::ZERO && gather.is_none() {
                gather = Some((s.spawn(s.frame.to_world(sample.wi)), beta * broad));
            }
            beta *= (sample.weight - broad).max(Rgb::ZERO);
            if beta.max_element() < 1e-3 {
                break;
            }
            ray = s.spawn(s.frame.to_world(sample.wi));
        }
        let Some((mut ray, mut beta)) = gather else { return };
        for _ in 0..LONGEST {
            let Some(s) = scene.hit(&ray) else { return };
            if s.is_crossed(sampler) {
                ray = s.spawn(ray.d);
                continue;
            }
            if s.bsdf.has_smooth() {
                self.gathered.extend(Point::new(&s, &ray, beta, self.path));
            }
            let Some((sample, broad)) = scatter(&s, &ray, Share::BroadLight, sampler) else { return };
            beta *= (sample.weight - broad).max(Rgb::ZERO);
            if beta.max_element() < 1e-3 {
                return;
            }
            ray = s.spawn(s.frame.to_world(sample.wi));
        }
    }
}

/// A direction sampled where `ray` has met `s`, and the broad share of its weight.
fn scatter(s: &Surface, ray: &Ray, share: Share, sampler: &mut Sampler) -> Option<(BsdfSample, Rgb)> {
    let wo = s.frame.to_local(-ray.d);
    let sample = s.bsdf.sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance)?;
    let broad = match (sample.delta, s.bsdf.diffuse_only()) {
        (true, _) => Rgb::ZERO,
        (false, Some(_)) => sample.weight,
        (false, None) => s.bsdf.eval(wo, sample.wi, Mode::Radiance, share) / sample.pdf_w,
    };
    broad.is_finite().then_some((sample, broad))
}
