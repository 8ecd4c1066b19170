//! Scenes, and the rays that rendering sends through them.

#[path = "../../tests/common/meshes.rs"]
mod meshes;

use caustica::accel::{self, Intersector, available};
use caustica::math::{Ray, offset_origin, warp};
use caustica::scene;
use caustica::shape::{Geometry, Mesh, Shape, Wanted};
use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};
use std::path::Path;

/// A scene, a camera, and a lamp.
#[derive(Debug)]
pub(crate) struct Workload {
    pub(crate) name: &'static str,
    pub(crate) geometry: Geometry,
    pub(crate) eye: Vec3,
    pub(crate) target: Vec3,
    /// A square lamp that shines down: its middle, and half its side.
    pub(crate) lamp: (Vec3, f32),
    /// How many rays of a kind tell, in reasonable time.
    pub(crate) count: usize,
}

/// Rays of one kind.
#[derive(Debug)]
pub(crate) struct Rays {
    pub(crate) name: &'static str,
    /// To be answered by `occluded`.
    pub(crate) shadow: bool,
    pub(crate) rays: Vec<Ray>,
}

/// A deterministic stream of numbers in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn pair(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }
}

fn mesh((positions, triangles): meshes::Triangles, m: Affine3A) -> Shape {
    let positions = positions.into_iter().map(|p| m.transform_point3(p)).collect();
    Shape::Mesh(Mesh { positions, triangles, ..Default::default() })
}

/// The box of 14 triangles and two spheres.
pub(crate) fn cornell() -> Workload {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-spheres.xml");
    let geometry = scene::load(&file, &[], None).expect("a scene of ours").geometry;
    Workload {
        name: "cornell-spheres",
        geometry,
        eye: Vec3::new(0.0, 0.0, 3.9),
        target: Vec3::ZERO,
        lamp: (Vec3::new(0.0, 0.98, 0.0), 0.25),
        count: 100_000,
    }
}

/// A closed mesh of 1.3 million triangles like a scan's, in a room.
pub(crate) fn scan() -> Workload {
    let room = Mesh::cube(Affine3A::from_scale(Vec3::splat(4.0)));
    Workload {
        name: "scan",
        geometry: Geometry::from(vec![mesh(meshes::organic(8), Affine3A::IDENTITY), Shape::Mesh(room)]),
        eye: Vec3::new(0.5, 1.0, 3.0),
        target: Vec3::ZERO,
        lamp: (Vec3::new(0.5, 3.5, 1.0), 0.5),
        count: 400_000,
    }
}

/// A small dense mesh in a wide place of few large triangles, in a cloud of needles.
pub(crate) fn hostile() -> Workload {
    let mut random = Random(1);
    let small = Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.02),
        Quat::from_rotation_x(1.0),
        Vec3::new(0.1, -0.2, 0.1),
    );
    let stadium = mesh(meshes::organic(2), Affine3A::from_scale(Vec3::splat(50.0)));
    let needles = mesh(meshes::needles(100_000, || random.next()), Affine3A::IDENTITY);
    Workload {
        name: "hostile",
        geometry: Geometry::from(vec![mesh(meshes::organic(6), small), stadium, needles]),
        eye: Vec3::new(0.5, 1.0, 3.0),
        target: Vec3::ZERO,
        lamp: (Vec3::new(0.5, 20.0, 1.0), 5.0),
        count: 10_000,
    }
}

impl Workload {
    /// Primary rays in the film's order, and the others from random ones on, `n` of each kind. All come from one
    /// backend's hits, so that every backend gets the same.
    pub(crate) fn rays(&self, n: usize) -> [Rays; 4] {
        let built = accel::build(available()[0], &self.geometry).expect("a sound scene");
        let mut random = Random(7);
        let side = (n as f32).sqrt().ceil() as usize;
        let primary: Vec<Ray> = (0..n)
            .map(|i| self.camera_ray(Vec2::new((i % side) as f32, (i / side) as f32) / side as f32))
            .collect();
        let (mut diffuse, mut shadow, mut photon) = (Vec::new(), Vec::new(), Vec::new());
        while diffuse.len() < n {
            let ray = self.camera_ray(random.pair());
            let Some((ray, to_lamp)) = self.scatter(&*built, &ray, &mut random) else { continue };
            diffuse.push(ray);
            shadow.push(to_lamp);
        }
        while photon.len() < n {
            let o = self.lamp.0 + self.on_lamp(&mut random);
            let d = warp::cosine_hemisphere(random.pair());
            let mut ray = Ray::new(o, Vec3::new(d.x, -d.z, d.y));
            for _ in 0..4 {
                photon.push(ray);
                match self.scatter(&*built, &ray, &mut random) {
                    Some((next, _)) => ray = next,
                    None => break,
                }
            }
        }
        photon.truncate(n);
        let rays = |name, shadow, rays| Rays { name, shadow, rays };
        [
            rays("primary", false, primary),
            rays("diffuse", false, diffuse),
            rays("shadow", true, shadow),
            rays("photon", false, photon),
        ]
    }

    fn camera_ray(&self, film: Vec2) -> Ray {
        let z = (self.target - self.eye).normalize();
        let x = z.cross(Vec3::Y).normalize();
        let p = (film - 0.5) * 0.7;
        Ray::new(self.eye, (z + x * p.x + x.cross(z) * p.y).normalize())
    }

    fn on_lamp(&self, random: &mut Random) -> Vec3 {
        let p = (random.pair() - 0.5) * (2.0 * self.lamp.1);
        Vec3::new(p.x, 0.0, p.y)
    }

    /// A diffuse bounce where the ray ends, and a shadow ray from there to the lamp.
    fn scatter(&self, built: &dyn Intersector, ray: &Ray, random: &mut Random) -> Option<(Ray, Ray)> {
        let hit = built.intersect(ray)?;
        let point = self.geometry.shapes[hit.shape as usize].point(ray, &hit, Wanted::Untextured);
        let n = if point.n_g.dot(ray.d) > 0.0 { -point.n_g } else { point.n_g };
        let (x, y) = n.any_orthonormal_pair();
        let d = Mat3::from_cols(x, y, n) * warp::cosine_hemisphere(random.pair());
        let leave = |d: Vec3| offset_origin(point.p, point.n_g, d, point.magnitude);
        let to_lamp = self.lamp.0 + self.on_lamp(random) - point.p;
        let shadow = Ray { t_max: 0.999, ..Ray::new(leave(to_lamp), to_lamp) };
        Some((Ray::new(leave(d), d), shadow))
    }
}
