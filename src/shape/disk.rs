//! Flat disks.

use super::{Bounds, SurfacePoint, Wanted, padded};
use crate::math::Ray;
use glam::{Affine3A, DVec2, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// The unit disk of the xy plane, mapped by an affine transform: an ellipse in general. Texture coordinates are
/// Mitsuba 3's: the radius in the unit disk, and the azimuth over 2π.
#[derive(Clone, Copy, Debug)]
pub struct Disk {
    /// Its centre.
    pub center: Vec3,
    /// Image of the x axis.
    pub u_axis: Vec3,
    /// Image of the y axis.
    pub v_axis: Vec3,
    /// Unit normal.
    pub n_g: Vec3,
}

impl Disk {
    /// The transformed unit disk. Its normal is the image of +z as a normal, hence it keeps its side under a mirror
    /// transform within the plane; `flip` turns it around.
    ///
    /// # Errors
    /// A message if the transform leaves no area.
    pub fn new(to_world: Affine3A, flip: bool) -> Result<Disk, String> {
        let (u_axis, v_axis) = (Vec3::from(to_world.matrix3.x_axis), Vec3::from(to_world.matrix3.y_axis));
        let center = Vec3::from(to_world.translation);
        let normal = u_axis.as_dvec3().cross(v_axis.as_dvec3()).try_normalize();
        match normal.filter(|_| center.is_finite()) {
            None => Err("a disk's transform must be finite and leave an area".into()),
            Some(n) => {
                let n_g = if flip != (to_world.matrix3.determinant() < 0.0) { -n } else { n }.as_vec3();
                Ok(Disk { center, u_axis, v_axis, n_g })
            }
        }
    }

    /// World-space bounds.
    pub fn bounds(&self) -> Bounds {
        let (u, v) = (self.u_axis.as_dvec3(), self.v_axis.as_dvec3());
        padded(self.center.as_dvec3(), (u * u + v * v).map(f64::sqrt))
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        (PI * self.u_axis.as_dvec3().cross(self.v_axis.as_dvec3()).length()) as f32
    }

    /// Where the ray's line meets the plane: the distance, and the position in the unit disk's coordinates.
    fn meet(&self, ray: &Ray) -> Option<(f64, DVec2)> {
        let (o, d) = (ray.o.as_dvec3() - self.center.as_dvec3(), ray.d.as_dvec3());
        let (u, v) = (self.u_axis.as_dvec3(), self.v_axis.as_dvec3());
        let n = u.cross(v);
        let t = -n.dot(o) / n.dot(d);
        let p = o + d * t;
        let q = DVec2::new(p.cross(v).dot(n), u.cross(p).dot(n)) / n.length_squared();
        t.is_finite().then_some((t, q))
    }

    /// Distance of the hit.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        let (t, q) = self.meet(ray)?;
        let t = t as f32;
        (t > ray.t_min && t < ray.t_max && q.length_squared() <= 1.0).then_some(t)
    }

    /// The surface point that the ray hits.
    pub fn point(&self, ray: &Ray, wanted: Wanted) -> SurfacePoint {
        self.at(self.meet(ray).map_or(DVec2::ZERO, |(_, q)| q), wanted)
    }

    /// The surface point at a position in the unit disk.
    pub fn at(&self, q: DVec2, wanted: Wanted) -> SurfacePoint {
        let offset = self.u_axis.as_dvec3() * q.x + self.v_axis.as_dvec3() * q.y;
        SurfacePoint {
            p: (self.center.as_dvec3() + offset).as_vec3(),
            magnitude: (self.center.abs() + self.u_axis.abs() + self.v_axis.abs()).max_element(),
            n_g: self.n_g,
            n_s: self.n_g,
            uv: wanted.uv(|| {
                let phi = q.y.atan2(q.x) / TAU;
                Vec2::new(q.length() as f32, if phi < 0.0 { phi + 1.0 } else { phi } as f32)
            }),
        }
    }

    /// ∂p/∂u, along the radius, and ∂p/∂v, around it.
    pub fn partials(&self, point: &SurfacePoint) -> [Vec3; 2] {
        let (sin, cos) = (point.uv.y * TAU as f32).sin_cos();
        let around = (self.v_axis * cos - self.u_axis * sin) * (TAU as f32 * point.uv.x);
        [self.u_axis * cos + self.v_axis * sin, around]
    }
}
