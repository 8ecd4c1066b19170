//! Geometry alone: triangle meshes and analytic quadrics in world space. Backends intersect it, lights sample it,
//! the scene derives shading data from it; it knows none of them.

mod mesh;
mod sample;

pub use mesh::Mesh;

use crate::math::{Frame, Ray};
use glam::{Vec2, Vec3};

/// What a ray hit: identity and parameters, 20 bytes. Shading data is derived later, by [`Shape::point`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray.
    pub t: f32,
    /// First surface parameter (on a triangle: the barycentric weight of its second vertex; else unused).
    pub u: f32,
    /// Second surface parameter (on a triangle: the barycentric weight of its third vertex; else unused).
    pub v: f32,
    /// Index into [`Geometry::shapes`].
    pub shape: u32,
    /// Triangle of the mesh; 0 for quadrics.
    pub primitive: u32,
}

/// A point on a surface, as far as geometry goes.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position, refined (not `ray.at(t)`).
    pub p: Vec3,
    /// The largest absolute coordinate that took part in computing `p`; see [`crate::math::offset_origin`].
    pub magnitude: f32,
    /// Geometric unit normal, as the shape is oriented (flips applied).
    pub n_g: Vec3,
    /// Shading normal, unit length; equals `n_g` where no vertex normals exist.
    pub n_s: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
}

/// A point sampled on a surface.
#[derive(Clone, Copy, Debug)]
pub struct AreaSample {
    /// Position.
    pub p: Vec3,
    /// Geometric unit normal.
    pub n_g: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// See [`SurfacePoint::magnitude`].
    pub magnitude: f32,
}

/// The closed set of shapes, all in world space.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Triangles. Rectangles and cubes are meshes too.
    Mesh(Mesh),
}

/// All shapes of a scene.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// The shapes; everything else names them by index.
    pub shapes: Vec<Shape>,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Bounds {
    /// Contains nothing.
    pub const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box around both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The smallest box around this one and `p`.
    pub fn grow(self, p: Vec3) -> Bounds {
        Bounds { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Whether nothing is inside.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Its middle.
    pub fn center(&self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Half its diagonal: the radius of the sphere around it. Zero for an empty box.
    pub fn radius(&self) -> f32 {
        if self.is_empty() { 0.0 } else { ((self.max - self.min) * 0.5).length() }
    }
}

impl Shape {
    /// World-space bounds.
    pub fn bounds(&self) -> Bounds {
        match self {
            Shape::Mesh(m) => m.bounds(),
        }
    }

    /// The surface point of a hit on this shape.
    pub fn point(&self, ray: &Ray, hit: &Hit) -> SurfacePoint {
        let _ = ray;
        match self {
            Shape::Mesh(m) => m.point(hit.primitive, hit.u, hit.v),
        }
    }

    /// Unnormalised tangent ∂p/∂u at a point of this shape, for anisotropic materials and normal maps.
    pub fn dp_du(&self, hit: &Hit, point: &SurfacePoint) -> Vec3 {
        let _ = point;
        match self {
            Shape::Mesh(m) => m.dp_du(hit.primitive),
        }
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        match self {
            Shape::Mesh(m) => m.area(),
        }
    }
}

impl SurfacePoint {
    /// Any shading frame.
    pub fn frame(&self) -> Frame {
        Frame::from_normal(self.n_s)
    }
}

impl Geometry {
    /// Bounds of everything.
    pub fn bounds(&self) -> Bounds {
        self.shapes.iter().fold(Bounds::EMPTY, |b, s| b.union(s.bounds()))
    }
}
