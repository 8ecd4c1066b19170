//! Geometry alone: triangle meshes and analytic quadrics, in world space or in groups that instances place there. Backends intersect it, lights sample it,
//! the scene derives shading data from it; it knows none of them.

mod cylinder;
mod disk;
mod facet;
mod instance;
mod mesh;
mod parted;
mod sample;
mod sphere;

pub use cylinder::Cylinder;
pub use disk::Disk;
pub use facet::{Edge, Facet, Facets};
pub use instance::Instance;
pub use mesh::{Attribute, Mesh};
pub use sphere::Sphere;

use crate::math::Ray;
use glam::{DVec3, Vec2, Vec3};
use std::ops::Range;

/// What a ray hit: identity and parameters, 24 bytes. Shading data is derived later, by [`Shape::point`].
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
    /// Index into [`Geometry::instances`]; [`Hit::NO_INSTANCE`] for shapes that are in no group.
    pub instance: u32,
}

impl Hit {
    /// An index that no instance has.
    pub const NO_INSTANCE: u32 = u32::MAX;
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
    /// Texture coordinates; zero unless they were wanted.
    pub uv: Vec2,
}

/// What of a surface point anybody will look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// All of it.
    All,
    /// No texture coordinates: on quadrics they take inverse tangents, on meshes memory that nothing else touches.
    Untextured,
}

impl Wanted {
    fn uv(self, compute: impl FnOnce() -> Vec2) -> Vec2 {
        if self == Wanted::All { compute() } else { Vec2::ZERO }
    }
}

/// A point sampled on a surface.
#[derive(Clone, Copy, Debug)]
pub struct AreaSample {
    /// Position.
    pub p: Vec3,
    /// Geometric unit normal.
    pub n_g: Vec3,
    /// Shading normal.
    pub n_s: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// See [`SurfacePoint::magnitude`].
    pub magnitude: f32,
    /// Triangle of the mesh; 0 for quadrics.
    pub triangle: u32,
    /// Barycentric weights of the triangle's second and third vertex; 0 for quadrics.
    pub weights: Vec2,
}

/// The closed set of shapes, in world space or that of their group.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Triangles. Rectangles and cubes are meshes too.
    Mesh(Mesh),
    /// A sphere.
    Sphere(Sphere),
    /// A flat disk.
    Disk(Disk),
    /// An open cylinder.
    Cylinder(Cylinder),
}

/// All shapes of a scene.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// The shapes; everything else names them by index. Those in groups come last.
    pub shapes: Vec<Shape>,
    /// Which shapes each group holds, one group after the other. They show only where instances place them.
    pub groups: Vec<Range<u32>>,
    /// Groups in their places.
    pub instances: Vec<Instance>,
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

    /// `p` in units of the sphere around it.
    pub fn relative(&self, p: Vec3) -> Vec3 {
        (p - self.center()) / self.radius().max(f32::MIN_POSITIVE)
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
    /// What it is.
    pub fn kind(&self) -> &'static str {
        match self {
            Shape::Mesh(_) => "mesh",
            Shape::Sphere(_) => "sphere",
            Shape::Disk(_) => "disk",
            Shape::Cylinder(_) => "cylinder",
        }
    }

    /// World-space bounds; they contain whatever [`Shape::intersect`] can hit.
    pub fn bounds(&self) -> Bounds {
        match self {
            Shape::Mesh(m) => m.bounds(),
            Shape::Sphere(s) => s.bounds(),
            Shape::Disk(d) => d.bounds(),
            Shape::Cylinder(c) => c.bounds(),
        }
    }

    /// Radius of a sphere around `center` that holds the shape, but for rounding.
    pub fn radius_around(&self, center: Vec3) -> f32 {
        match self {
            Shape::Mesh(m) => m.radius_around(center),
            Shape::Sphere(s) => s.center.distance(center) + s.radius,
            Shape::Disk(_) | Shape::Cylinder(_) => {
                let bounds = self.bounds();
                (bounds.max - center).abs().max((bounds.min - center).abs()).length()
            }
        }
    }

    /// Distance of the nearest hit with an analytic shape, which all backends share. `None` for meshes: testing
    /// triangles is the backends' own business.
    pub fn intersect(&self, ray: &Ray) -> Option<f32> {
        match self {
            Shape::Mesh(_) => None,
            Shape::Sphere(s) => s.intersect(ray),
            Shape::Disk(d) => d.intersect(ray),
            Shape::Cylinder(c) => c.intersect(ray),
        }
    }

    /// The surface point of a hit on this shape.
    pub fn point(&self, ray: &Ray, hit: &Hit, wanted: Wanted) -> SurfacePoint {
        match self {
            Shape::Mesh(m) => m.point(hit.primitive, hit.u, hit.v, wanted),
            Shape::Sphere(s) => s.point(ray, hit.t, wanted),
            Shape::Disk(d) => d.point(ray, wanted),
            Shape::Cylinder(c) => c.point(ray, hit.t, wanted),
        }
    }

    /// ∂p/∂u and ∂p/∂v at a point of this shape that was wanted with [`Wanted::All`], for anisotropic materials, normal
    /// maps and bump maps.
    pub fn partials(&self, hit: &Hit, point: &SurfacePoint) -> [Vec3; 2] {
        match self {
            Shape::Mesh(m) => m.partials(hit.primitive),
            Shape::Sphere(s) => s.partials(point),
            Shape::Disk(d) => d.partials(point),
            Shape::Cylinder(c) => c.partials(point),
        }
    }

    /// Whether rays that leave the front of the surface never meet it again: convex seen from outside, or flat.
    pub fn is_convex_outside(&self) -> bool {
        match self {
            Shape::Mesh(m) => m.is_flat(),
            Shape::Sphere(s) => !s.flipped,
            Shape::Disk(_) => true,
            Shape::Cylinder(c) => !c.flipped,
        }
    }

    /// A point and the normal of the plane that it lies in, if it does.
    pub fn plane(&self) -> Option<(Vec3, Vec3)> {
        match self {
            Shape::Mesh(m) => m.plane(),
            Shape::Disk(d) => Some((d.center, d.n_g)),
            Shape::Sphere(_) | Shape::Cylinder(_) => None,
        }
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        match self {
            Shape::Mesh(m) => m.area(),
            Shape::Sphere(s) => s.area(),
            Shape::Disk(d) => d.area(),
            Shape::Cylinder(c) => c.area(),
        }
    }
}

impl From<Vec<Shape>> for Geometry {
    /// Without groups.
    fn from(shapes: Vec<Shape>) -> Geometry {
        Geometry { shapes, ..Geometry::default() }
    }
}

impl Geometry {
    /// The shapes in no group.
    pub fn world(&self) -> &[Shape] {
        &self.shapes[..self.groups.first().map_or(self.shapes.len(), |group| group.start as usize)]
    }

    /// The shapes of a group.
    pub fn group(&self, group: u32) -> &[Shape] {
        let Range { start, end } = self.groups[group as usize];
        &self.shapes[start as usize..end as usize]
    }

    /// Bounds of everything.
    pub fn bounds(&self) -> Bounds {
        self.instance_bounds().into_iter().fold(around(self.world()), Bounds::union)
    }

    /// Bounds of each instance.
    pub fn instance_bounds(&self) -> Vec<Bounds> {
        let groups: Vec<Bounds> = (0..self.groups.len() as u32).map(|g| around(self.group(g))).collect();
        self.instances.iter().map(|instance| instance.bounds(&groups[instance.group as usize])).collect()
    }

    /// All shapes wherever they show: the index, bounds, and the radius around the middle of these that the shape keeps.
    pub fn shown(&self) -> Vec<(u32, Bounds, f32)> {
        let own = |shape: &Shape| {
            let bounds = shape.bounds();
            (bounds, shape.radius_around(bounds.center()))
        };
        let all: Vec<(Bounds, f32)> = self.shapes.iter().map(own).collect();
        let mut shown: Vec<_> = (0..).zip(&all[..self.world().len()]).map(|(i, &(b, r))| (i, b, r)).collect();
        for instance in &self.instances {
            let stretch = instance.stretch();
            shown.extend(self.groups[instance.group as usize].clone().map(|shape| {
                let (bounds, radius) = &all[shape as usize];
                (shape, instance.bounds(bounds), radius * stretch)
            }));
        }
        shown
    }
}

fn around(shapes: &[Shape]) -> Bounds {
    shapes.iter().fold(Bounds::EMPTY, |b, s| b.union(s.bounds()))
}

// What the analytic shapes share. They compute in f64: coordinates and radii are exact there, so that nothing cancels
// even for a small shape far away, and their share of a render's time is small.

/// The box around `center` that reaches `extent` to each side, widened by the rounding to f32.
fn padded(center: DVec3, extent: DVec3) -> Bounds {
    let pad = (center.abs() + extent) * f32::EPSILON as f64 + f32::MIN_POSITIVE as f64;
    Bounds { min: (center - extent - pad).as_vec3(), max: (center + extent + pad).as_vec3() }
}

/// The roots of t² − 2bt + c, ascending, whose quarter discriminant b² − c the caller knows better. The smaller one
/// in magnitude comes from their product, so that it does not cancel (Press et al., Numerical Recipes, 5.6).
fn stable_roots(b: f64, discriminant: f64, c: f64) -> Option<[f64; 2]> {
    if !(discriminant >= 0.0 && b.is_finite()) {
        return None;
    }
    let q = b + discriminant.sqrt().copysign(b);
    let other = if q == 0.0 { 0.0 } else { c / q };
    Some(if other < q { [other, q] } else { [q, other] })
}

/// The first of ascending distances that counts on this ray.
fn first_in_range(ray: &Ray, roots: [f64; 2]) -> Option<f32> {
    roots.into_iter().map(|t| t as f32).find(|&t| t > ray.t_min && t < ray.t_max)
}

/// The distance that had been rounded to `t`.
fn closest(roots: [f64; 2], t: f32) -> f64 {
    let t = t as f64;
    if (roots[0] - t).abs() <= (roots[1] - t).abs() { roots[0] } else { roots[1] }
}

/// Whether two vectors are as long as each other, at right angles, and neither null, up to a per mille: transforms
/// come with a few decimals.
fn similar(a: DVec3, b: DVec3) -> bool {
    let (a2, b2) = (a.length_squared(), b.length_squared());
    a2 > 0.0 && a2.is_finite() && (a2 - b2).abs() <= 2e-3 * a2 && a.dot(b).abs() <= 1e-3 * a2
}

/// The scale of three axes if they belong to a similarity.
pub(crate) fn similarity(axes: &[DVec3; 3]) -> Option<f64> {
    let [x, y, z] = *axes;
    (similar(x, y) && similar(y, z) && similar(z, x)).then(|| (x.length() + y.length() + z.length()) / 3.0)
}

#[cfg(test)]
mod tests;
