//! Spheres.

use super::{Bounds, SurfacePoint, Wanted, closest, first_in_range, padded, stable_roots};
use crate::math::Ray;
use glam::{Affine3A, DVec3, Mat3, Vec2, Vec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A sphere. Texture coordinates are Mitsuba 3's: u the azimuth over 2π, v the angle from the frame's z axis over π.
#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    /// Its centre.
    pub center: Vec3,
    /// Its radius, positive.
    pub radius: f32,
    /// Orthonormal axes for the texture coordinates, as columns; left-handed under a mirror transform.
    pub frame: Mat3,
    /// Whether the normal points inwards.
    pub flipped: bool,
}

impl Sphere {
    /// The sphere around `center`, then transformed. As in Mitsuba 3 a mirror transform turns the normal inwards, and
    /// `flip` turns it around once more.
    ///
    /// # Errors
    /// A message if the radius is not positive or the transform does not leave a sphere.
    pub fn new(center: Vec3, radius: f32, to_world: Affine3A, flip: bool) -> Result<Sphere, String> {
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(format!("the sphere's radius must be positive, not {radius}"));
        }
        let m = to_world.matrix3;
        let axes = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.as_dvec3());
        let scale = super::similarity(&axes)
            .ok_or("a sphere's transform must be regular, without shear and non-uniform scale")?;
        let sphere = Sphere {
            center: to_world.transform_point3(center),
            radius: (radius as f64 * scale) as f32,
            frame: Mat3::from_cols_array_2d(&axes.map(|a| a.normalize().as_vec3().to_array())),
            flipped: flip != (m.determinant() < 0.0),
        };
        if !(sphere.center.is_finite() && sphere.radius > 0.0 && sphere.radius.is_finite()) {
            return Err("the transformed sphere is out of the range of numbers".into());
        }
        Ok(sphere)
    }

    /// World-space bounds.
    pub fn bounds(&self) -> Bounds {
        padded(self.center.as_dvec3(), DVec3::splat(self.radius as f64))
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        (2.0 * TAU * (self.radius as f64).powi(2)) as f32
    }

    /// Both distances at which the ray's line meets the sphere, ascending. The discriminant is taken from the vector
    /// to the point of closest approach, which does not cancel for far-away small spheres (Haines et al. 2019,
    /// "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, ch. 7).
    fn roots(&self, ray: &Ray) -> Option<[f64; 2]> {
        let (f, d, r) = (self.center.as_dvec3() - ray.o.as_dvec3(), ray.d.as_dvec3(), self.radius as f64);
        let a = d.length_squared();
        let b = f.dot(d) / a;
        stable_roots(b, (r * r - (f - d * b).length_squared()) / a, (f.length_squared() - r * r) / a)
    }

    /// Distance of the nearest hit.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        first_in_range(ray, self.roots(ray)?)
    }

    /// The surface point at the distance `t` that [`Sphere::intersect`] found.
    pub fn point(&self, ray: &Ray, t: f32, wanted: Wanted) -> SurfacePoint {
        // Solved again rather than stored: a distance in f32 is far too coarse for a small sphere seen from afar.
        let t = self.roots(ray).map_or(t as f64, |roots| closest(roots, t));
        self.at(ray.o.as_dvec3() + ray.d.as_dvec3() * t - self.center.as_dvec3(), wanted)
    }

    /// The surface point in a direction from the centre, which need not be normalised.
    pub fn at(&self, outward: DVec3, wanted: Wanted) -> SurfacePoint {
        let n = outward.try_normalize().unwrap_or(DVec3::Z);
        let uv = wanted.uv(|| {
            let q = self.frame.as_dmat3().transpose() * n;
            let uv = Vec2::new((q.y.atan2(q.x) / TAU) as f32, (q.x.hypot(q.y).atan2(q.z) * FRAC_1_PI) as f32);
            if uv.x < 0.0 { uv + Vec2::X } else { uv }
        });
        let n_g = if self.flipped { -n } else { n }.as_vec3();
        SurfacePoint {
            p: (self.center.as_dvec3() + n * self.radius as f64).as_vec3(),
            magnitude: self.center.abs().max_element() + self.radius,
            n_g,
            n_s: n_g,
            uv,
        }
    }

    /// ∂p/∂u (the zero vector at the poles) and ∂p/∂v.
    pub fn partials(&self, point: &SurfacePoint) -> [Vec3; 2] {
        let n = if self.flipped { -point.n_g } else { point.n_g };
        let q = self.frame.transpose() * n;
        let sin = q.x.hypot(q.y);
        let p_v = if sin == 0.0 { Vec3::X } else { Vec3::new(q.z * q.x / sin, q.z * q.y / sin, -sin) };
        let (turn, half) = (TAU as f32 * self.radius, PI as f32 * self.radius);
        [self.frame * Vec3::new(-q.y, q.x, 0.0) * turn, self.frame * p_v * half]
    }
}
