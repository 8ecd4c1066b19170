//! Open cylinders.

use super::{Bounds, SurfacePoint, Wanted, closest, padded, similar, stable_roots};
use crate::math::{Frame, Ray};
use glam::{Affine3A, DVec3, Vec2, Vec3};
use std::f64::consts::TAU;

/// A circular cylinder without caps. Texture coordinates are Mitsuba 3's: u the azimuth over 2π, v the height over the
/// length.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    /// Centre of the lower end.
    pub p0: Vec3,
    /// From the lower to the upper end.
    pub axis: Vec3,
    /// Its radius, positive.
    pub radius: f32,
    /// Unit vector across the axis at which u is 0.
    pub x_axis: Vec3,
    /// Unit vector across the axis at which u is ¼.
    pub y_axis: Vec3,
    /// Whether the normal points inwards.
    pub flipped: bool,
}

impl Cylinder {
    /// The cylinder from `p0` to `p1`, then transformed. The default one runs along z from 0 to 1 with radius 1. The
    /// normal points outwards, even under a mirror transform as in Mitsuba 3, unless `flip` is set.
    ///
    /// # Errors
    /// A message if radius or length vanish or the transform does not leave a circular cylinder.
    pub fn new(p0: Vec3, p1: Vec3, radius: f32, to_world: Affine3A, flip: bool) -> Result<Cylinder, String> {
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(format!("the cylinder's radius must be positive, not {radius}"));
        }
        let along =
            (p1.as_dvec3() - p0.as_dvec3()).try_normalize().ok_or("the cylinder's p0 and p1 must differ")?;
        let frame = Frame::from_normal(along.as_vec3());
        let m = to_world.matrix3.as_dmat3();
        let (x, y, z) = (m * frame.s.as_dvec3(), m * frame.t.as_dvec3(), m * (p1 - p0).as_dvec3());
        if !similar(x, y)
            || z == DVec3::ZERO
            || [x, y].iter().any(|a| a.dot(z).abs() > 1e-3 * (a.length() * z.length()))
        {
            return Err("a cylinder's transform must be regular, without shear and without non-uniform scale across the axis".into());
        }
        let cylinder = Cylinder {
            p0: to_world.transform_point3(p0),
            axis: z.as_vec3(),
            radius: (radius as f64 * (0.5 * x.length() + 0.5 * y.length())) as f32,
            x_axis: x.normalize().as_vec3(),
            y_axis: y.normalize().as_vec3(),
            flipped: flip,
        };
        if !(cylinder.p0 + cylinder.axis + cylinder.radius).is_finite() {
            return Err("the transformed cylinder is out of the range of numbers".into());
        }
        Ok(cylinder)
    }

    /// World-space bounds.
    pub fn bounds(&self) -> Bounds {
        let (p0, axis) = (self.p0.as_dvec3(), self.axis.as_dvec3());
        let a = axis.normalize();
        let across = (DVec3::ONE - a * a).max(DVec3::ZERO).map(f64::sqrt) * self.radius as f64;
        padded(p0, across).union(padded(p0 + axis, across))
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        (TAU * self.radius as f64 * self.axis.as_dvec3().length()) as f32
    }

    /// Both distances at which the ray's line meets the endless cylinder, ascending; solved in the plane across the
    /// axis as [`super::Sphere`] does in space.
    fn roots(&self, ray: &Ray) -> Option<[f64; 2]> {
        let (a, r) = (self.axis.as_dvec3().normalize(), self.radius as f64);
        let across = |v: DVec3| v - a * a.dot(v);
        let (f, d) = (across(self.p0.as_dvec3() - ray.o.as_dvec3()), across(ray.d.as_dvec3()));
        let a = d.length_squared();
        let b = f.dot(d) / a;
        stable_roots(b, (r * r - (f - d * b).length_squared()) / a, (f.length_squared() - r * r) / a)
    }

    /// The point at distance `t` relative to `p0`, and its height over the length.
    fn relative(&self, ray: &Ray, t: f64) -> (DVec3, f64) {
        let (p, axis) = (ray.o.as_dvec3() - self.p0.as_dvec3() + ray.d.as_dvec3() * t, self.axis.as_dvec3());
        (p, p.dot(axis) / axis.length_squared())
    }

    /// Distance of the nearest hit.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        self.roots(ray)?.into_iter().find_map(|t| {
            let inside = (0.0..=1.0).contains(&self.relative(ray, t).1);
            let t = t as f32;
            (inside && t > ray.t_min && t < ray.t_max).then_some(t)
        })
    }

    /// The surface point at the distance `t` that [`Cylinder::intersect`] found.
    pub fn point(&self, ray: &Ray, t: f32, wanted: Wanted) -> SurfacePoint {
        let t = self.roots(ray).map_or(t as f64, |roots| closest(roots, t));
        let (p, height) = self.relative(ray, t);
        self.at(p - self.axis.as_dvec3() * height, height, wanted)
    }

    /// The surface point in a direction across the axis, which need not be normalised, at `height` in [0, 1].
    pub fn at(&self, outward: DVec3, height: f64, wanted: Wanted) -> SurfacePoint {
        let (p0, axis) = (self.p0.as_dvec3(), self.axis.as_dvec3());
        let n = outward.try_normalize().unwrap_or(self.x_axis.as_dvec3());
        let n_g = if self.flipped { -n } else { n }.as_vec3();
        SurfacePoint {
            p: (p0 + axis * height + n * self.radius as f64).as_vec3(),
            magnitude: self.p0.abs().max((self.p0 + self.axis).abs()).max_element() + self.radius,
            n_g,
            n_s: n_g,
            uv: wanted.uv(|| {
                let phi = self.y_axis.as_dvec3().dot(n).atan2(self.x_axis.as_dvec3().dot(n)) / TAU;
                Vec2::new(if phi < 0.0 { phi + 1.0 } else { phi } as f32, height as f32)
            }),
        }
    }

    /// ∂p/∂u and ∂p/∂v.
    pub fn partials(&self, point: &SurfacePoint) -> [Vec3; 2] {
        let (sin, cos) = (point.uv.x * TAU as f32).sin_cos();
        [(self.y_axis * cos - self.x_axis * sin) * (TAU as f32 * self.radius), self.axis]
    }
}
