//! Every backend against a brute-force reference in f64, and against each other.

#[path = "../../tests/common/meshes.rs"]
pub(super) mod meshes;

use super::*;
use crate::math::offset_origin;
use crate::shape::{Cylinder, Disk, Mesh, Sphere, SurfacePoint, Wanted};
use glam::{Affine3A, DVec3, Quat, Vec3};
use rayon::prelude::*;

/// A deterministic stream of numbers in [0, 1).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        ((self.next() * n as f32) as usize).min(n - 1)
    }

    /// In [-1, 1]³.
    pub(super) fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    pub(super) fn direction(&mut self) -> Vec3 {
        self.point().try_normalize().unwrap_or(Vec3::X)
    }
}

pub(super) fn build_all(geometry: &Geometry) -> Vec<(&'static str, Box<dyn Intersector>)> {
    available().iter().map(|&b| (b.name(), build(b, geometry).unwrap())).collect()
}

/// A random closed surface: a sphere with bumps, 2·n·2n triangles.
pub(super) fn bumpy_sphere(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..2 * n {
            let (theta, phi) =
                (i as f32 / n as f32 * std::f32::consts::PI, j as f32 / n as f32 * std::f32::consts::PI);
            let d = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            // All vertices of a pole coincide, whatever sin π rounds to.
            let d = if i == 0 || i == n { Vec3::Z * d.z } else { d };
            mesh.positions.push(d * (1.0 + 0.1 * (9.0 * d.x).sin() * (7.0 * d.y).cos() * (8.0 * d.z).sin()));
        }
    }
    for i in 0..n {
        for j in 0..2 * n {
            let at = |i, j| i * 2 * n + j % (2 * n);
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

/// Triangles and quadrics of many sizes, some degenerate, in [-2, 2]³.
pub(super) fn mixed(seed: u64, n: usize) -> Geometry {
    let mut random = Random(seed);
    let mut soup = Mesh::default();
    for _ in 0..n {
        let (p, size) = (random.point(), 10f32.powf(-2.0 * random.next()));
        let (mut e, f) = (random.point() * size, random.point() * size);
        match random.below(10) {
            0 => e = Vec3::ZERO,
            1 => e = f * 0.5,
            2 => e.z = f.z, // One edge in a plane z = const
            3 => e *= 1e-3, // A sliver
            _ => (),
        }
        let base = soup.positions.len() as u32;
        soup.positions.extend([p, p + e, p + f]);
        soup.triangles.push([base, base + 1, base + 2]);
    }
    let mut shapes =
        vec![Shape::Mesh(soup), Shape::Mesh(Mesh::default()), Shape::Mesh(Mesh::cube(Affine3A::IDENTITY))];
    for _ in 0..n / 10 {
        let size = 0.3 * 10f32.powf(-2.0 * random.next());
        let turn = Quat::from_scaled_axis(random.point() * 3.0);
        let m = Affine3A::from_scale_rotation_translation(Vec3::splat(size), turn, random.point());
        shapes.push(match random.below(3) {
            0 => Shape::Sphere(Sphere::new(Vec3::ZERO, 1.0, m, false).unwrap()),
            1 => Shape::Disk(Disk::new(m, false).unwrap()),
            _ => Shape::Cylinder(Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, m, false).unwrap()),
        });
    }
    Geometry::from(shapes)
}

/// Random rays, axis-parallel ones, and ones through vertices and edges.
pub(super) fn ray(random: &mut Random, geometry: &Geometry) -> Ray {
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let o = random.point() * [0.5, 3.0][random.below(2)];
    let mut vertex = || match &geometry.shapes[[0, 2][random.below(2)]] {
        Shape::Mesh(mesh) if !mesh.triangles.is_empty() => {
            let t = mesh.vertices(random.below(mesh.triangles.len()) as u32);
            (t[0], t[1])
        }
        _ => (Vec3::ZERO, Vec3::X),
    };
    let (a, b) = vertex();
    match random.below(6) {
        0 => Ray::new(o, axes[random.below(6)]),
        1 => Ray::new(o, (a - o).normalize_or(Vec3::X)),
        2 => Ray::new(o, (a.midpoint(b) - o).normalize_or(Vec3::X)),
        3 => Ray::new(a - axes[random.below(6)] * 2.0, axes[random.below(6)]),
        _ => Ray::new(o, random.direction()),
    }
}

/// What f64 knows of a ray and a primitive.
#[derive(Debug)]
struct Reference {
    /// Between which distances a hit may be reported.
    t: [f64; 2],
    /// Hit even if all is moved by rounding.
    surely: bool,
    /// Hit if moved by rounding.
    maybe: bool,
    /// No area, or less than rounding as the ray sees it.
    edge_on: bool,
}

fn reference(vertices: [Vec3; 3], ray: &Ray) -> Reference {
    let [a, b, c] = vertices.map(|p| p.as_dvec3() - ray.o.as_dvec3());
    let d = ray.d.as_dvec3();
    let n = (b - a).cross(c - a);
    let t = n.dot(a) / n.dot(d);
    // f32 rounds coordinates relative to the ray's origin; that moves the plane, and with it the hit along the ray,
    // the more the flatter they meet, and the more the thinner the triangle is.
    let rounding =
        8.0 * f32::EPSILON as f64 * [a, b, c].iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    let edges = [(a, b - a), (b, c - b), (c, a - c)];
    let longest = edges.iter().map(|(_, e)| e.length()).fold(0.0, f64::max);
    let slope = n.length() * d.length() / n.dot(d).abs();
    let tolerance = rounding * slope * (longest * longest / n.length()) / d.length();
    // Signed distances of the hit to the edges' lines.
    let distance = |(p, e): (DVec3, DVec3)| n.dot(e.cross(d * t - p)) / (n.length() * e.length());
    let inside = edges.into_iter().map(distance).fold(f64::MAX, f64::min);
    if tolerance.is_nan() || tolerance > 1e-2 * longest {
        // No area, or seen edge-on: it may be hit as the line it looks like.
        let d = d.normalize();
        let across = |v: DVec3| v - d * v.dot(d);
        let near = |(p, e): (DVec3, DVec3)| {
            let (p, e) = (across(p), across(e));
            let k = -p.dot(e) / e.length_squared();
            (p + e * if k.is_finite() { k.clamp(0.0, 1.0) } else { 0.0 }).length() < 4.0 * rounding
        };
        let depths = [a, b, c].map(|p| p.dot(d) / ray.d.as_dvec3().length());
        // Embree's distances to such are vague, and checked against f64 to 1/16 only.
        let first = depths.into_iter().fold(f64::MAX, f64::min) - rounding;
        let last = depths.into_iter().fold(f64::MIN, f64::max) + rounding;
        let t = [first - first.abs() / 15.0, last + last.abs() / 15.0];
        let maybe = inside >= 0.0 || edges.into_iter().any(near);
        return Reference { t, surely: false, maybe, edge_on: true };
    }
    let moved = rounding * slope;
    Reference {
        t: [t - tolerance, t + tolerance],
        surely: inside > moved,
        maybe: inside >= -moved,
        edge_on: false,
    }
}

/// All primitives that the ray can meet.
fn candidates(geometry: &Geometry, ray: &Ray) -> Vec<((u32, u32), Reference)> {
    let mut found = Vec::new();
    for (i, shape) in geometry.shapes.iter().enumerate() {
        match shape {
            Shape::Mesh(mesh) => {
                for t in 0..mesh.triangles.len() as u32 {
                    found.push(((i as u32, t), reference(mesh.vertices(t), ray)));
                }
            }
            // Tested on their own, beside the shapes.
            quadric => found.extend(quadric.intersect(ray).map(|t| {
                ((i as u32, 0), Reference { t: [t as f64; 2], surely: true, maybe: true, edge_on: false })
            })),
        }
    }
    found
}

/// A hit must be possible and nothing certain may be nearer; a miss must not skip anything certain.
fn assert_right(name: &str, ray: &Ray, hit: Option<Hit>, candidates: &[((u32, u32), Reference)]) {
    let (t_min, t_max) = (ray.t_min as f64, ray.t_max as f64);
    let end = hit.map_or(t_max, |h| h.t as f64);
    if let Some(hit) = hit {
        let (_, r) =
            candidates.iter().find(|c| c.0 == (hit.shape, hit.primitive)).expect("a possible primitive");
        assert!(r.maybe, "{name}: {ray:?} misses {hit:?}");
        assert!((r.t[0]..=r.t[1]).contains(&(hit.t as f64)), "{name}: {hit:?} is at {:?}", r.t);
        assert!(hit.t > ray.t_min && hit.t < ray.t_max);
    }
    for (id, r) in candidates {
        let nearer = r.t[0] > t_min && r.t[1] < end;
        assert!(!(nearer && r.surely), "{name}: {ray:?} skips {id:?} at {:?}, got {hit:?}", r.t);
    }
}

#[test]
fn agree_with_brute_force() {
    for seed in 0..4 {
        let geometry = mixed(seed, 300);
        let backends = build_all(&geometry);
        let mut random = Random(seed + 100);
        let mut hits = 0;
        for i in 0..5000 {
            let mut ray = ray(&mut random, &geometry);
            if i % 3 == 0 {
                ray.t_min = random.next() * 2.0;
                ray.t_max = ray.t_min + random.next() * 2.0;
            }
            let candidates = candidates(&geometry, &ray);
            for (name, backend) in &backends {
                let hit = backend.intersect(&ray);
                hits += hit.is_some() as u32;
                assert_right(name, &ray, hit, &candidates);
                assert_eq!(backend.occluded(&ray), hit.is_some(), "{name}: {ray:?} {hit:?}");
            }
        }
        assert!(hits as usize > 2000 * backends.len(), "{hits}");
    }
}

#[test]
fn backends_agree() {
    let geometry = Geometry::from(vec![
        Shape::Mesh(bumpy_sphere(60)),
        Shape::Sphere(Sphere::new(Vec3::new(0.3, 0.2, 0.0), 0.4, Affine3A::IDENTITY, false).unwrap()),
        Shape::Mesh(Mesh::rectangle(Affine3A::from_scale(Vec3::splat(5.0)))),
    ]);
    let backends = build_all(&geometry);
    let mut random = Random(5);
    let (mut worst, mut other) = (0.0f32, 0);
    for _ in 0..50_000 {
        let ray = Ray::new(random.point() * 2.0, random.direction());
        let hits: Vec<_> = backends.iter().map(|(_, b)| b.intersect(&ray)).collect();
        for pair in hits.windows(2) {
            match (pair[0], pair[1]) {
                (Some(a), Some(b)) if (a.shape, a.primitive) == (b.shape, b.primitive) => {
                    let Shape::Mesh(mesh) = &geometry.shapes[a.shape as usize] else {
                        assert_eq!(a, b);
                        continue;
                    };
                    let n = mesh.point(a.primitive, a.u, a.v, Wanted::All).n_g;
                    worst = worst.max((a.t - b.t).abs() * n.dot(ray.d).abs() / f32::EPSILON);
                    assert!((a.u - b.u).abs().max((a.v - b.v).abs()) < 1e-2);
                }
                // Through an edge, or along the rectangle.
                (a, b) => other += (a != b) as u32,
            }
        }
    }
    // In ulps of 1, across the surface; coordinates go up to 5.
    assert!(worst < 8.0, "{worst}");
    assert!(other < 50, "{other}");
}

/// From inside a closed mesh no ray escapes through edges; our own tree is tight at vertices as well.
#[test]
fn closed_meshes_are_watertight() {
    let mut mesh = bumpy_sphere(40);
    let mut random = Random(8);
    // Off-centre, so that no coordinate is round.
    mesh.positions.iter_mut().for_each(|p| *p = *p * 3.7 + Vec3::new(11.3, -7.1, 3.3));
    let geometry = Geometry::from(vec![Shape::Mesh(mesh.clone())]);
    for (name, backend) in build_all(&geometry) {
        let mut leaks = 0;
        for i in 0..60_000 {
            let o = Vec3::new(11.3, -7.1, 3.3) + random.point();
            let [a, b, c] = mesh.vertices(random.below(mesh.triangles.len()) as u32);
            let target = match i % 3 {
                0 => a,
                1 => a.lerp(b, random.next()),
                _ => b.lerp(c, random.next()),
            };
            let ray = Ray::new(o, (target - o).normalize());
            if !(backend.intersect(&ray).is_some() && backend.occluded(&ray)) {
                assert!(name == "embree" && i % 3 == 0, "{name}: {ray:?}");
                leaks += 1;
            }
        }
        // Embree guards edges; rays to within an ulp of a vertex can slip through its fan of triangles. That is rare
        // even among rays aimed at vertices, and never seen otherwise.
        assert!(leaks < 100, "{name}: {leaks}");
    }
}

fn organic(level: u32) -> Mesh {
    let (positions, triangles) = meshes::organic(level);
    Mesh { positions, triangles, ..Default::default() }
}

/// From inside a closed mesh no ray escapes.
fn no_ray_escapes(level: u32, rays: u64) {
    let geometry = Geometry::from(vec![Shape::Mesh(organic(level))]);
    for (name, backend) in build_all(&geometry) {
        const CHUNK: u64 = 1 << 12;
        let escapes = |chunk: u64| {
            let mut random = Random(chunk.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let mut ray = || Ray::new(random.point() * 0.28, random.direction());
            (0..CHUNK)
                .map(|_| ray())
                .filter(|r| backend.intersect(r).is_none() || !backend.occluded(r))
                .count()
        };
        let escaped: usize = (0..rays.div_ceil(CHUNK)).into_par_iter().map(escapes).sum();
        assert_eq!(escaped, 0, "{name}");
    }
}

#[test]
fn no_ray_escapes_a_closed_mesh() {
    no_ray_escapes(6, 300_000);
}

#[test]
#[ignore = "minutes"]
fn none_of_a_hundred_million_rays_escapes() {
    no_ray_escapes(8, 100_000_000);
}

/// The hardest rays at a mesh, some with limits; `kind` in 0..12.
fn adversarial(random: &mut Random, mesh: &Mesh, kind: usize) -> Ray {
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let triangle = random.below(mesh.triangles.len()) as u32;
    let [a, b, c] = mesh.vertices(triangle);
    let o = random.point() * [0.3, 3.0][random.below(2)];
    let axis = axes[random.below(6)];
    let to = |p: Vec3| Ray::new(o, (p - o).normalize_or(Vec3::X));
    let uv = crate::math::warp::triangle(glam::Vec2::new(random.next(), random.next()));
    let point = mesh.point(triangle, uv.x, uv.y, Wanted::Untextured);
    match kind {
        0 => Ray::new(o, random.direction()),
        // Through a vertex, the middle of an edge, and anywhere on an edge.
        1 => to(a),
        2 => to(a.midpoint(b)),
        3 => to(b.lerp(c, random.next())),
        // Along an edge.
        4 => Ray::new(a - (b - a) * 3.0, (b - a).normalize_or(Vec3::X)),
        // Parallel to an axis, with zeros of either sign, anywhere and through a vertex.
        5 => Ray::new(o, axis * (1.0 + random.next())),
        6 => Ray::new(a - axis * 4.0, axis),
        // Grazing.
        7 => {
            let along = random.direction().cross(point.n_g).normalize_or(Vec3::X);
            let d = (along - point.n_g * 10f32.powf(-5.0 * random.next())).normalize();
            Ray::new(point.p - d * 2.0, d)
        }
        // Starting on a surface, offset and not.
        8 => leave(random, &point),
        9 => Ray::new(point.p, random.direction()),
        // All but parallel to an axis, by a denormal number.
        10 => Ray::new(o, axis + axes[random.below(6)] * 1e-41),
        // Very long, and very short.
        _ => {
            let far = random.direction() * 10f32.powf(4.0 * random.next());
            let d = (point.p - far) * [1.0, 1e-6][random.below(2)];
            Ray { t_max: 10f32.powf(8.0 * random.next()), ..Ray::new(far, d) }
        }
    }
}

/// How two backends' answers compare.
#[derive(Debug, Default)]
struct Tally {
    equal: u64,
    /// Through what triangles share: another one at the same distance.
    ties: u64,
    /// Past an edge, or at a limit, by less than rounding: hit by the first alone, or by the second.
    edges: [u64; 2],
    /// Hit on a triangle seen edge-on, past its edges by more than vertices are rounded: by the first, or the second.
    /// Embree's edge tests are in f32, which is vague about edges along the ray.
    vague: [u64; 2],
    /// Largest difference of distance across the surface, in ulps of the largest coordinate relative to the origin.
    worst: f32,
}

fn compare(tally: &mut Tally, mesh: &Mesh, ray: &Ray, hits: [Option<Hit>; 2]) {
    let known = |hit: Hit| (hit, reference(mesh.vertices(hit.primitive), ray));
    let vague = |tally: &mut Tally, by: usize, r: &Reference| {
        assert!(r.maybe || r.edge_on, "{ray:?} {hits:?} {r:?}");
        tally.vague[by] += !r.maybe as u64;
        !r.maybe
    };
    let alone = |tally: &mut Tally, by: usize, r: &Reference| {
        let at_limit = r.t[0] <= ray.t_min as f64 || r.t[1] >= ray.t_max as f64;
        assert!(!r.surely || at_limit, "{ray:?} {hits:?} {r:?}");
        if !vague(tally, by, r) {
            tally.edges[by] += 1;
        }
    };
    match hits {
        [None, None] => tally.equal += 1,
        [Some(a), Some(b)] if a.primitive == b.primitive => {
            tally.equal += 1;
            let vertices = mesh.vertices(a.primitive);
            let n = mesh.point(a.primitive, a.u, a.v, Wanted::Untextured).n_g;
            let size = vertices.iter().map(|p| (*p - ray.o).abs().max_element()).fold(0.0, f32::max);
            tally.worst = tally.worst.max((a.t - b.t).abs() * n.dot(ray.d).abs() / (size * f32::EPSILON));
        }
        [Some(a), Some(b)] => {
            let [(a, r), (b, q)] = [known(a), known(b)];
            if vague(tally, 0, &r) | vague(tally, 1, &q) {
                return;
            }
            let reach = |r: &Reference, t: f32| r.t[0] <= t as f64 && t as f64 <= r.t[1];
            let [u, v, w] = mesh.vertices(a.primitive);
            let longest = u.distance(v).max(v.distance(w)).max(w.distance(u));
            let neighbours = (a.t - b.t).abs() * ray.d.length() <= longest;
            if neighbours && (reach(&r, b.t) || reach(&q, a.t)) {
                tally.ties += 1;
            } else {
                alone(tally, if a.t < b.t { 0 } else { 1 }, if a.t < b.t { &r } else { &q });
            }
        }
        [Some(hit), None] => alone(tally, 0, &known(hit).1),
        [None, Some(hit)] => alone(tally, 1, &known(hit).1),
    }
}

fn backends_agree_ray_by_ray(level: u32, rays: u64) {
    let mesh = organic(level);
    let geometry = Geometry::from(vec![Shape::Mesh(mesh.clone())]);
    let backends = build_all(&geometry);
    const KINDS: u64 = 12;
    for kind in 0..KINDS {
        let (mut tally, mut random) = (Tally::default(), Random(kind));
        for _ in 0..rays / KINDS {
            let ray = adversarial(&mut random, &mesh, kind as usize);
            for pair in backends.windows(2) {
                compare(&mut tally, &mesh, &ray, [pair[0].1.intersect(&ray), pair[1].1.intersect(&ray)]);
            }
            for (name, backend) in &backends {
                assert_eq!(backend.occluded(&ray), backend.intersect(&ray).is_some(), "{name}: {ray:?}");
            }
        }
        println!("{kind}: {tally:?}");
        // Of triangles seen edge-on, along an edge, Embree's f32 distances are vaguer.
        let few = if kind == 4 { 16.0 } else { 8.0 };
        assert!(tally.worst < few, "{kind}: {tally:?}");
    }
}

#[test]
fn backends_agree_on_adversarial_rays() {
    backends_agree_ray_by_ray(5, 60_000);
}

#[test]
#[ignore = "minutes"]
fn backends_agree_on_ten_million_adversarial_rays() {
    backends_agree_ray_by_ray(8, 10_000_000);
}

#[test]
fn limits_are_exclusive() {
    let geometry = Geometry::from(vec![Shape::Mesh(Mesh::rectangle(Affine3A::IDENTITY))]);
    for (name, backend) in build_all(&geometry) {
        let ray = Ray::new(Vec3::new(0.25, 0.5, 4.0), Vec3::NEG_Z);
        let hit = backend.intersect(&ray).unwrap();
        assert!((hit.t - 4.0).abs() <= 4.0 * f32::EPSILON);
        // Embree divides by way of an approximate reciprocal: its limits are exclusive up to an ulp or two.
        let (before, after) = if name == "bvh" { (4.0, 4.0) } else { (3.999_999, 4.000_001) };
        for (t_min, t_max, expected) in [
            (0.0, before, false),
            (0.0, 4.000_002, true),
            (after, 9.0, false),
            (3.999_998, 9.0, true),
            (5.0, 4.0, false),
            (4.1, f32::INFINITY, false),
            (f32::NAN, 9.0, false),
            (0.0, f32::NAN, false),
        ] {
            let ray = Ray { t_min, t_max, ..ray };
            assert_eq!(backend.intersect(&ray).is_some(), expected, "{name} {t_min} {t_max}");
            assert_eq!(backend.occluded(&ray), expected, "{name} {t_min} {t_max}");
        }
    }
}

#[test]
fn sphere_from_a_million_radii() {
    let sphere = Sphere::new(Vec3::new(1.0, 2.0, 3.0), 1e-3, Affine3A::IDENTITY, false).unwrap();
    let geometry = Geometry::from(vec![Shape::Sphere(sphere)]);
    let mut random = Random(2);
    for (name, backend) in build_all(&geometry) {
        for _ in 0..10_000 {
            // Towards a point up to 1.5 radii off; whether that hits is known but for rounding of the direction.
            let o = sphere.center + random.direction() * 1e3;
            let across = random.direction().cross(sphere.center - o).normalize_or_zero();
            let ray = Ray::new(o, sphere.center + across * (1.5e-3 * random.next()) - o);
            let (f, d) = (sphere.center.as_dvec3() - ray.o.as_dvec3(), ray.d.as_dvec3());
            let distance = f.cross(d).length() / d.length();
            let hit = backend.intersect(&ray);
            assert_eq!(hit.is_some(), distance <= sphere.radius as f64, "{name}: {distance}");
            assert_eq!(backend.occluded(&ray), hit.is_some());
            if let Some(hit) = hit {
                let p = geometry.shapes[0].point(&ray, &hit, Wanted::All).p;
                let along = f.dot(d) / d.length_squared();
                assert!(p.distance(ray.at(along as f32)) < 1.1e-3 + 1e-4, "{p}");
                assert!((p.distance(sphere.center) - 1e-3).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn empty_scenes_and_degenerate_triangles() {
    let rays = [
        Ray::new(Vec3::ZERO, Vec3::X),
        Ray::new(Vec3::splat(0.1), Vec3::NAN),
        Ray::new(Vec3::INFINITY, Vec3::X),
    ];
    let point = Mesh { positions: vec![Vec3::ONE; 3], triangles: vec![[0, 1, 2]; 100], ..Default::default() };
    let line = Mesh {
        positions: vec![Vec3::X, Vec3::X * 2.0, Vec3::X * 3.0],
        triangles: vec![[0, 1, 2], [1, 1, 2], [0, 0, 0]],
        ..Default::default()
    };
    let broken = Mesh {
        positions: vec![Vec3::NAN, Vec3::X, Vec3::Y, Vec3::INFINITY, Vec3::new(0.0, f32::NAN, 1.0)],
        triangles: vec![[0, 1, 2], [1, 2, 3], [1, 2, 4], [2, 1, 4]],
        ..Default::default()
    };
    let mesh = |m: &Mesh| Shape::Mesh(m.clone());
    for shapes in
        [vec![], vec![mesh(&Mesh::default())], vec![mesh(&point)], vec![mesh(&line)], vec![mesh(&broken)]]
    {
        for (name, backend) in build_all(&Geometry::from(shapes)) {
            for ray in &rays {
                assert_eq!(backend.intersect(ray), None, "{name}");
                assert!(!backend.occluded(ray), "{name}");
            }
        }
    }
    // What is broken does not hide what is sound.
    let sound = Mesh::rectangle(Affine3A::IDENTITY);
    for (name, backend) in build_all(&Geometry::from(vec![mesh(&broken), mesh(&line), mesh(&sound)])) {
        let hit = backend.intersect(&Ray::new(Vec3::new(0.1, 0.2, 1.0), Vec3::NEG_Z));
        assert!(hit.is_some_and(|h| h.shape == 2 && (h.t - 1.0).abs() < 1e-6), "{name}");
        for bad in [Vec3::NAN, Vec3::INFINITY, Vec3::new(0.0, f32::NAN, -1.0)] {
            assert_eq!(backend.intersect(&Ray::new(bad, Vec3::NEG_Z)), None);
            assert_eq!(backend.intersect(&Ray::new(Vec3::Z, bad)), None);
        }
        assert_eq!(backend.intersect(&Ray::new(Vec3::ZERO, Vec3::ZERO)), None);
    }
    let out_of_range = Mesh { positions: vec![Vec3::ZERO], triangles: vec![[0, 0, 1]], ..Default::default() };
    for &backend in available() {
        assert!(build(backend, &Geometry::from(vec![mesh(&out_of_range)])).is_err());
    }
}

/// Nothing to split by, and trees that spatial splits alone would make as deep as they have leaves.
#[test]
fn hostile_distributions() {
    let triangle = |s: f32| [Vec3::new(s, 0.0, 0.0), Vec3::new(s, s, 0.0), Vec3::new(s, 0.0, s)];
    let mut identical = Mesh { positions: triangle(1.0).to_vec(), ..Default::default() };
    identical.triangles = vec![[0, 1, 2]; 1_000_000];
    let mut exponential = Mesh::default();
    for i in 0..20_000u32 {
        exponential.positions.extend(triangle(0.98f32.powi((i % 4000) as i32)));
        exponential.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let huge = Mesh {
        positions: triangle(1e10).into_iter().chain(triangle(3e-10)).collect(),
        triangles: [[0, 1, 2], [3, 4, 5]].repeat(50),
        ..Default::default()
    };
    let ray = Ray::new(Vec3::new(-1.0, 0.1, 0.1), Vec3::X);
    for (mesh, t) in [(identical, 2.0), (exponential, 1.2)] {
        for (name, backend) in build_all(&Geometry::from(vec![Shape::Mesh(mesh)])) {
            let hit = backend.intersect(&ray).unwrap();
            assert!((hit.t - t).abs() < 0.01, "{name} {hit:?}");
            assert!(backend.occluded(&ray) && !backend.occluded(&Ray { d: Vec3::NEG_X, ..ray }), "{name}");
        }
    }
    for (name, backend) in build_all(&Geometry::from(vec![Shape::Mesh(huge)])) {
        assert!(backend.occluded(&Ray::new(Vec3::new(0.0, 1e9, 1e9), Vec3::X)), "{name}");
    }
}

/// Which of several coinciding triangles is hit must not change from build to build.
#[test]
fn ties_are_broken_alike_in_every_build() {
    let mut mesh = bumpy_sphere(60);
    mesh.triangles = mesh.triangles.repeat(5);
    let geometry = Geometry::from(vec![Shape::Mesh(mesh)]);
    let mut random = Random(3);
    let rays: Vec<Ray> = (0..2000).map(|_| Ray::new(random.point() * 0.5, random.direction())).collect();
    for &backend in available() {
        let trace = || {
            let built = build(backend, &geometry).unwrap();
            rays.iter().map(|r| built.intersect(r)).collect::<Vec<_>>()
        };
        let first = trace();
        for _ in 0..3 {
            assert!(trace() == first, "{}", backend.name());
        }
    }
}

/// Leaves `point` in a random direction, often a grazing one.
pub(super) fn leave(random: &mut Random, point: &SurfacePoint) -> Ray {
    let mut d = random.direction();
    if random.below(2) == 0 {
        let n = point.n_g;
        d = (d - n * n.dot(d) + n * (random.next() - 0.5) * 10f32.powf(-7.0 * random.next())).normalize_or(n);
    }
    Ray::new(offset_origin(point.p, point.n_g, d, point.magnitude), d)
}

/// Rays that leave a flat surface never hit it again, at any scale, size and place.
#[test]
fn offset_rays_leave_flat_surfaces() {
    let mut random = Random(4);
    for i in 0..1500 {
        let scale = 10f32.powf(12.0 * random.next() - 6.0);
        let size = 10f32.powf(-3.0 * random.next());
        let place = if i % 2 == 0 { random.point() } else { Vec3::ZERO };
        let corners = [0; 3].map(|_| (place + random.point() * size) * scale);
        // Slivers, and planes along the axes, as well.
        let corners = match i % 5 {
            0 => {
                [corners[0], corners[1], corners[0].lerp(corners[1], 0.4) + (corners[2] - corners[0]) * 1e-2]
            }
            1 => corners.map(|p| p.with_z(corners[0].z)),
            _ => corners,
        };
        let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Default::default() };
        let turn = Quat::from_scaled_axis(random.point() * 3.0);
        let m = Affine3A::from_scale_rotation_translation(Vec3::splat(size * scale), turn, place * scale);
        for shape in [Shape::Mesh(mesh), Shape::Disk(Disk::new(m, false).unwrap())] {
            let geometry = Geometry::from(vec![shape]);
            let backends = build_all(&geometry);
            for _ in 0..100 {
                let uv = crate::math::warp::triangle(glam::Vec2::new(random.next(), random.next()));
                let point = match &geometry.shapes[0] {
                    Shape::Disk(disk) => disk.at(uv.as_dvec2(), Wanted::All),
                    shape => {
                        let hit = Hit {
                            t: 0.0,
                            u: uv.x,
                            v: uv.y,
                            shape: 0,
                            primitive: 0,
                            instance: Hit::NO_INSTANCE,
                        };
                        shape.point(&Ray::new(Vec3::ZERO, Vec3::X), &hit, Wanted::All)
                    }
                };
                let ray = leave(&mut random, &point);
                for (name, backend) in &backends {
                    let hit = backend.intersect(&ray);
                    assert!(hit.is_none(), "{name}: {:?} {point:?} {ray:?} {hit:?}", geometry.shapes);
                    assert!(!backend.occluded(&ray), "{name}");
                }
            }
        }
    }
}

/// Rays that leave a round surface outwards never hit it; inwards they hit the far side, not the point they left.
#[test]
fn offset_rays_leave_round_surfaces() {
    let mut random = Random(6);
    for _ in 0..1000 {
        let scale = 10f32.powf(12.0 * random.next() - 6.0);
        let size = 10f32.powf(-2.0 * random.next());
        let turn = Quat::from_scaled_axis(random.point() * 3.0);
        let m = Affine3A::from_scale_rotation_translation(
            Vec3::splat(size * scale),
            turn,
            random.point() * scale,
        );
        let sphere = Sphere::new(Vec3::ZERO, 1.0, m, false).unwrap();
        let cylinder = Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, m, false).unwrap();
        for (shape, radius) in
            [(Shape::Sphere(sphere), sphere.radius), (Shape::Cylinder(cylinder), cylinder.radius)]
        {
            let geometry = Geometry::from(vec![shape]);
            let backends = build_all(&geometry);
            for _ in 0..50 {
                let point = match &geometry.shapes[0] {
                    Shape::Cylinder(c) => {
                        let phi = random.next() as f64 * std::f64::consts::TAU;
                        c.at(
                            c.x_axis.as_dvec3() * phi.cos() + c.y_axis.as_dvec3() * phi.sin(),
                            random.next() as f64,
                            Wanted::All,
                        )
                    }
                    _ => sphere.at(random.direction().as_dvec3(), Wanted::All),
                };
                let ray = leave(&mut random, &point);
                for (name, backend) in &backends {
                    let hit = backend.intersect(&ray);
                    match hit {
                        Some(hit) => {
                            let cos = -point.n_g.dot(ray.d);
                            assert!(cos > 0.0, "{name}: {:?} {point:?} {ray:?} {hit:?}", geometry.shapes);
                            // The chord of a sphere; through a cylinder it is no shorter.
                            let offset = (ray.o - point.p).length();
                            assert!(
                                hit.t >= 2.0 * radius * cos - offset / cos.max(1e-3) - radius * 1e-5,
                                "{hit:?}"
                            );
                        }
                        None => assert!(
                            point.n_g.dot(ray.d) >= 0.0 || matches!(geometry.shapes[0], Shape::Cylinder(_)),
                            "{name}: {point:?} {ray:?}"
                        ),
                    }
                    assert_eq!(backend.occluded(&ray), hit.is_some(), "{name}");
                }
            }
        }
    }
}
