//! Sampling of shapes: uniform by area for all, by visible solid angle for spheres.

use super::{AreaSample, Shape};
use crate::math::{Discrete, warp};
use glam::Vec2;

impl Shape {
    /// The choice of triangle that [`Shape::sample_area`] needs; empty for quadrics.
    pub fn area_distribution(&self) -> Discrete {
        match self {
            Shape::Mesh(m) => Discrete::new((0..m.triangles.len() as u32).map(|t| m.area_vector(t).length())),
        }
    }

    /// A point uniform on the surface: `pdf_a` = 1 / [`Shape::area`]. `distribution` is the shape's own
    /// [`Shape::area_distribution`]. `None` if the shape has no area.
    pub fn sample_area(&self, distribution: &Discrete, u: Vec2) -> Option<AreaSample> {
        match self {
            Shape::Mesh(m) => {
                let (triangle, _, ux) = distribution.sample(u.x)?;
                let b = warp::triangle(Vec2::new(ux, u.y));
                let point = m.point(triangle as u32, b.x, b.y);
                Some(AreaSample { p: point.p, n_g: point.n_g, uv: point.uv, magnitude: point.magnitude })
            }
        }
    }
}
