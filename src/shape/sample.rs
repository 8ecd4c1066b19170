//! Sampling of shapes: uniform by area for all, by visible solid angle for spheres.

use super::{AreaSample, Shape, Sphere, SurfacePoint, Wanted};
use crate::math::{Discrete, warp};
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

impl Shape {
    /// The choice of triangle that [`Shape::sample_area`] needs; empty for quadrics.
    pub fn area_distribution(&self) -> Discrete {
        match self {
            Shape::Mesh(m) => {
                let triangles = (0..m.triangles.len() as u32).into_par_iter();
                let lengths: Vec<f32> = triangles.map(|t| m.area_vector(t).length()).collect();
                Discrete::new(lengths)
            }
            Shape::Sphere(_) | Shape::Disk(_) | Shape::Cylinder(_) => Discrete::default(),
        }
    }

    /// A point uniform on the surface: `pdf_a` = 1 / [`Shape::area`]. `distribution` is the shape's own
    /// [`Shape::area_distribution`]. `None` if the shape has no area.
    pub fn sample_area(&self, distribution: &Discrete, u: Vec2, wanted: Wanted) -> Option<AreaSample> {
        let point = match self {
            Shape::Mesh(m) => {
                let (triangle, _, ux) = distribution.sample(u.x)?;
                let b = warp::triangle(Vec2::new(ux, u.y));
                let point = m.point(triangle as u32, b.x, b.y, wanted);
                return Some(AreaSample { triangle: triangle as u32, weights: b, ..point.into() });
            }
            Shape::Sphere(s) => s.at(warp::sphere(u).as_dvec3(), wanted),
            Shape::Disk(d) => d.at(warp::disk(u).as_dvec2(), wanted),
            Shape::Cylinder(c) => {
                let (sin, cos) = (TAU * u.x as f64).sin_cos();
                c.at(c.x_axis.as_dvec3() * cos + c.y_axis.as_dvec3() * sin, u.y as f64, wanted)
            }
        };
        Some(point.into())
    }
}

impl Sphere {
    /// 1 − cos of the half-angle under which the sphere is seen, and the squared sine; `None` from within. A sphere
    /// that shows its inside is seen from within alone, whatever rounding says of points on it.
    fn visible_cone(&self, from: Vec3) -> Option<(f64, f64)> {
        let distance2 = self.center.as_dvec3().distance_squared(from.as_dvec3());
        let sin2 = (self.radius as f64).powi(2) / distance2;
        (!self.flipped && sin2 < 1.0).then(|| (sin2 / (1.0 + (1.0 - sin2).sqrt()), sin2))
    }

    /// A point uniform in the solid angle under which the sphere is seen from `from`, and the unit direction to it.
    /// `None` from within.
    pub fn sample_visible(&self, from: Vec3, u: Vec2, wanted: Wanted) -> Option<(Vec3, AreaSample)> {
        let (one_minus_cos_max, sin2_max) = self.visible_cone(from)?;
        let h = u.y as f64 * one_minus_cos_max;
        let (cos, sin2) = (1.0 - h, h * (2.0 - h));
        // The angle at the sphere's centre (Pharr et al. 2023, "Physically Based Rendering", Eq. 6.14).
        let cos_alpha = sin2 / sin2_max.sqrt() + cos * (1.0 - sin2 / sin2_max).max(0.0).sqrt();
        let sin_alpha = (1.0 - cos_alpha * cos_alpha).max(0.0).sqrt();

        let axis = (self.center.as_dvec3() - from.as_dvec3()).normalize();
        let (s, t) = axis.any_orthonormal_pair();
        let around = DVec2::from_angle(TAU * u.x as f64);
        let across: DVec3 = s * around.x + t * around.y;
        let wi = (axis * cos + across * sin2.sqrt()).as_vec3().normalize();
        Some((wi, self.at(across * sin_alpha - axis * cos_alpha, wanted).into()))
    }

    /// Pdf of [`Sphere::sample_visible`].
    pub fn visible_pdf_w(&self, from: Vec3) -> Option<f32> {
        self.visible_cone(from).map(|(one_minus_cos, _)| (1.0 / (TAU * one_minus_cos)) as f32)
    }
}

impl From<SurfacePoint> for AreaSample {
    fn from(point: SurfacePoint) -> AreaSample {
        let SurfacePoint { p, magnitude, n_g, n_s, uv } = point;
        AreaSample { p, n_g, n_s, uv, magnitude, triangle: 0, weights: Vec2::ZERO }
    }
}
