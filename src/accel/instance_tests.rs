//! Instances on every backend against copies of what they show, and against formulas where no shape is a copy.

#![allow(clippy::single_range_in_vec_init)] // what groups are

use super::tests::{Random, build_all, bumpy_sphere, leave};
use super::*;
use crate::shape::{Cylinder, Disk, Mesh, Sphere, SurfacePoint, Wanted};
use glam::{Affine3A, DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3};

/// A transform that turns, moves, stretches along its own axes by 1 / `stretch` to `stretch`, and may mirror.
fn transform(random: &mut Random, size: f64, stretch: f64) -> DAffine3 {
    let turn =
        |random: &mut Random| DMat3::from_quat(DQuat::from_scaled_axis(random.point().as_dvec3() * 3.0));
    let factor = |random: &mut Random| stretch.powf(2.0 * random.next() as f64 - 1.0);
    let mut scale = DVec3::new(factor(random), factor(random), factor(random)) * size;
    if random.below(2) == 0 {
        scale.x = -scale.x;
    }
    let m = turn(random) * DMat3::from_diagonal(scale) * turn(random);
    DAffine3::from_mat3_translation(m, random.point().as_dvec3())
}

/// A smooth mesh with texture coordinates.
fn bumps() -> Mesh {
    let mut mesh = bumpy_sphere(16);
    mesh.normals = mesh.positions.iter().map(|p| p.normalize()).collect();
    mesh.uvs = mesh.positions.iter().map(|p| Vec2::new(p.x, p.y + p.z)).collect();
    mesh
}

fn quadrics() -> [Shape; 3] {
    let m = Affine3A::from_rotation_x(0.7) * Affine3A::from_scale(Vec3::splat(0.8));
    [
        Shape::Sphere(Sphere::new(Vec3::X, 0.5, m, false).unwrap()),
        Shape::Disk(Disk::new(m * Affine3A::from_translation(Vec3::Z * 1.5), false).unwrap()),
        Shape::Cylinder(
            Cylinder::new(Vec3::NEG_Z, Vec3::Z, 0.4, m * Affine3A::from_translation(Vec3::Y * 2.0), true)
                .unwrap(),
        ),
    ]
}

/// Many instances of two groups that overlap shapes of the world and each other, and one of an empty group. Beside it the
/// same made of copies, and for each copy the shape and instance that it stands for.
fn placed(seed: u64, stretch: f64, grouped: Vec<Shape>) -> (Geometry, Geometry, Vec<(u32, u32)>) {
    let mut random = Random(seed);
    let mut shapes =
        vec![Shape::Mesh(Mesh::cube(Affine3A::from_scale(Vec3::splat(0.3)))), quadrics()[0].clone()];
    let rectangle = Mesh::rectangle(Affine3A::from_rotation_x(0.3));
    let groups = vec![2..3, 3..3, 3..3 + grouped.len() as u32];
    let mut instances = vec![Instance::new(1, DAffine3::IDENTITY)];
    for i in 0..60 {
        instances.push(Instance::new(2 * (i % 2), transform(&mut random, 0.2, stretch)));
    }
    let mut copies = shapes.clone();
    let mut stand_for: Vec<_> = (0..2).map(|shape| (shape, Hit::NO_INSTANCE)).collect();
    shapes.push(Shape::Mesh(rectangle));
    shapes.extend(grouped);
    for (i, instance) in (0..).zip(&instances) {
        for shape in groups[instance.group as usize].clone() {
            copies.push(shapes[shape as usize].placed(instance).expect("a shape"));
            stand_for.push((shape, i));
        }
    }
    (Geometry { shapes, groups, instances }, copies.into(), stand_for)
}

fn point(geometry: &Geometry, ray: &Ray, hit: &Hit) -> (SurfacePoint, [Vec3; 2]) {
    let shape = &geometry.shapes[hit.shape as usize];
    match geometry.instances.get(hit.instance as usize) {
        Some(instance) => {
            let own = shape.point(&instance.ray(ray), hit, Wanted::All);
            (instance.point(&own), shape.partials(hit, &own).map(|v| instance.vector(v)))
        }
        None => {
            let own = shape.point(ray, hit, Wanted::All);
            (own, shape.partials(hit, &own))
        }
    }
}

/// Nearest hits, occlusion and surfaces. `smooth` is by how much shading normals may be off: copies interpolate after they
/// are bent.
fn agree_with_copies(seed: u64, stretch: f64, grouped: Vec<Shape>, smooth: f32) {
    let (geometry, copies, stand_for) = placed(seed, stretch, grouped);
    let mut random = Random(seed + 100);
    let rays: Vec<Ray> = (0..30_000)
        .map(|i| {
            let ray = Ray::new(random.point() * 2.0, random.direction() * [1.0, 3.0][i % 2]);
            let t_max = [f32::INFINITY, random.next()][i / 2 % 2];
            Ray { t_max, ..ray }
        })
        .collect();
    for ((name, instanced), (_, flat)) in build_all(&geometry).into_iter().zip(build_all(&copies)) {
        let (mut hits, mut others, mut mirrored) = (0, 0, 0);
        for ray in &rays {
            let (a, b) = (instanced.intersect(ray), flat.intersect(ray));
            assert_eq!(instanced.occluded(ray), a.is_some(), "{name} {ray:?}");
            let (Some(a), Some(b)) = (a, b) else {
                others += (a.is_some() != b.is_some()) as u32;
                continue;
            };
            if (a.shape, a.instance) != stand_for[b.shape as usize] || a.primitive != b.primitive {
                others += 1;
                continue;
            }
            let (p, q) = (point(&geometry, ray, &a), point(&copies, ray, &b));
            hits += (a.instance != Hit::NO_INSTANCE) as u32;
            let cos = p.0.n_g.dot(ray.d.normalize()).abs();
            let told = format!("{name} {ray:?}: {a:?} {p:?}, copied {b:?} {q:?}");
            assert!((a.t - b.t).abs() * cos < 2e-5, "{told}");
            assert!(p.0.n_g.distance(q.0.n_g) < 1e-3, "{told}");
            assert!(p.0.n_s.distance(q.0.n_s) < smooth, "{told}");
            assert!(p.0.p.distance(q.0.p) * cos < 1e-4, "{told}");
            assert!(p.0.p.distance(ray.at(a.t)) * cos < 1e-4, "{told}");
            if cos > 0.1 {
                assert!(p.0.uv.distance(q.0.uv) < 1e-2, "{told}");
            }
            for (v, w) in p.1.into_iter().zip(q.1) {
                assert!(v.distance(w) * cos <= 1e-3 + 1e-2 * v.length(), "{told}");
            }
            let instance = geometry.instances.get(a.instance as usize);
            mirrored += instance.is_some_and(|i| i.to_world().matrix3.determinant() < 0.0) as u32;
        }
        assert!(hits > 3000 && mirrored > 1000, "{name}: {hits} {mirrored}");
        assert!(others < 30, "{name}: {others} of {hits}");
    }
}

#[test]
fn instances_are_like_copies() {
    let all = [Shape::Mesh(bumps())].into_iter().chain(quadrics()).collect();
    agree_with_copies(1, 1.0, all, 1e-3);
}

#[test]
fn stretched_instances_are_like_copies() {
    let meshes =
        vec![Shape::Mesh(bumps()), quadrics()[1].clone(), Shape::Mesh(Mesh::cube(Affine3A::IDENTITY))];
    agree_with_copies(2, 3.0, meshes, 0.3);
}

/// Both backends bring rays into groups alike, so they find the same, but for ties and silhouettes.
#[test]
fn backends_agree_on_instances() {
    let grouped =
        vec![Shape::Mesh(bumps()), quadrics()[1].clone(), Shape::Mesh(Mesh::cube(Affine3A::IDENTITY))];
    let (geometry, ..) = placed(3, 5.0, grouped);
    let backends = build_all(&geometry);
    let mut random = Random(4);
    let (mut same, mut others) = (0, 0);
    for _ in 0..50_000 {
        let ray = Ray::new(random.point() * 2.0, random.direction());
        for pair in backends.windows(2) {
            match (pair[0].1.intersect(&ray), pair[1].1.intersect(&ray)) {
                (None, None) => {}
                (Some(a), Some(b))
                    if (a.shape, a.primitive, a.instance) == (b.shape, b.primitive, b.instance) =>
                {
                    same += 1;
                    let cos = point(&geometry, &ray, &a).0.n_g.dot(ray.d).abs();
                    assert!((a.t - b.t).abs() * cos < 1e-5, "{a:?} {b:?}");
                }
                _ => others += 1,
            }
        }
    }
    assert!(backends.len() < 2 || same > 10_000, "{same}");
    assert!(others < 20, "{others} of {same}");
}

/// A stretched sphere is an ellipsoid: on it, and across the normal, every hit must lie.
#[test]
fn quadrics_may_be_stretched() {
    let shapes = [
        Shape::Sphere(Sphere::new(Vec3::ZERO, 1.0, Affine3A::IDENTITY, false).unwrap()),
        Shape::Cylinder(Cylinder::new(Vec3::NEG_Z, Vec3::Z, 1.0, Affine3A::IDENTITY, false).unwrap()),
    ];
    let mut random = Random(5);
    for round in 0..100 {
        let instance = Instance::new(0, transform(&mut random, 1.0, 4.0));
        let shape = round % 2;
        let geometry = Geometry {
            shapes: vec![shapes[shape as usize].clone()],
            groups: vec![0..1],
            instances: vec![instance],
        };
        assert!(geometry.shapes[0].placed(&instance).is_none());
        let (to_group, mut hits) = (instance.to_world().inverse(), 0);
        for (name, backend) in build_all(&geometry) {
            for _ in 0..200 {
                let target = instance.to_world().transform_point3(random.point().as_dvec3() * 0.7).as_vec3();
                let o = random.direction() * 10.0;
                let ray = Ray::new(o, (target - o).normalize());
                let hit = backend.intersect(&ray);
                assert_eq!(hit.is_some(), backend.occluded(&ray), "{name}");
                let Some(hit) = hit else { continue };
                hits += 1;
                let (found, partials) = point(&geometry, &ray, &hit);
                let own = to_group.transform_point3(found.p.as_dvec3());
                let own = if shape == 0 { own } else { DVec3::new(own.x, own.y, 0.0) };
                assert!((own.length() - 1.0).abs() < 1e-4, "{name} {own}");
                let gradient = (to_group.matrix3.transpose() * own).normalize().as_vec3();
                assert!(found.n_g.distance(gradient) < 1e-3, "{name} {found:?} {gradient}");
                let cos = gradient.dot(ray.d).abs();
                assert!(found.p.distance(ray.at(hit.t)) * cos < 1e-4, "{name} {found:?} {hit:?}");
                for v in partials {
                    assert!(v.dot(gradient).abs() <= 1e-3 * v.length(), "{name} {v} {gradient}");
                }
            }
        }
        assert!(hits > 100, "{hits}");
    }
}

/// Rays that leave a flat surface never hit it again, however far it is moved and stretched.
#[test]
fn offset_rays_leave_instances() {
    let mut random = Random(6);
    for i in 0..1000 {
        let size = 10f64.powf(6.0 * random.next() as f64 - 3.0);
        let own = 10f32.powf(4.0 * random.next() - 2.0);
        let corners = [0; 3].map(|_| random.point() * own);
        let mut to_world = transform(&mut random, size, [1.0, 30.0][i % 2]);
        to_world.translation *= 10f64.powf(4.0 * random.next() as f64 - 2.0);
        let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Default::default() };
        let instance = Instance::new(0, to_world);
        let geometry =
            Geometry { shapes: vec![Shape::Mesh(mesh)], groups: vec![0..1], instances: vec![instance] };
        let backends = build_all(&geometry);
        for _ in 0..100 {
            let uv = crate::math::warp::triangle(Vec2::new(random.next(), random.next()));
            let hit = Hit { t: 0.0, u: uv.x, v: uv.y, shape: 0, primitive: 0, instance: 0 };
            let (found, _) = point(&geometry, &Ray::new(Vec3::ZERO, Vec3::X), &hit);
            let ray = leave(&mut random, &found);
            for (name, backend) in &backends {
                let hit = backend.intersect(&ray);
                assert!(hit.is_none(), "{name}: {geometry:?} {found:?} {ray:?} {hit:?}");
                assert!(!backend.occluded(&ray), "{name}");
            }
        }
    }
}

#[test]
fn bounds_hold_what_instances_show() {
    let (geometry, copies, _) = placed(7, 3.0, vec![Shape::Mesh(bumps())]);
    let (loose, tight) = (geometry.bounds(), copies.bounds());
    assert_eq!(loose, loose.union(tight));
    assert!(loose.radius() < 1.5 * tight.radius());
    let shown = geometry.shown();
    assert_eq!(shown.len(), copies.shapes.len());
    for ((shape, bounds, radius), copy) in shown.into_iter().zip(&copies.shapes) {
        assert_eq!(bounds, bounds.union(copy.bounds()), "{shape}");
        assert!(copy.radius_around(bounds.center()) <= radius * 1.0001, "{shape}");
    }
}

#[test]
fn impossible_groups_are_refused() {
    let cube = || Shape::Mesh(Mesh::cube(Affine3A::IDENTITY));
    let at = |group, m| Instance::new(group, m);
    for (groups, instances) in [
        (vec![1..1, 2..2], vec![]),
        (vec![1..3], vec![]),
        (vec![0..1], vec![]),
        (vec![1..2], vec![at(1, DAffine3::IDENTITY)]),
        (vec![1..2], vec![at(0, DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)))]),
    ] {
        let geometry = Geometry { shapes: vec![cube(), cube()], groups, instances };
        for &backend in available() {
            assert!(matches!(build(backend, &geometry), Err(Error::Usage(_))), "{geometry:?}");
        }
    }
}
