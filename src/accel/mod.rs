//! Ray backends behind one seam, [`Intersector`]. They know geometry, no materials, and invent no epsilons: a hit
//! counts when `t_min < t < t_max`.

#[cfg(feature = "bvh")]
mod bvh;
#[cfg(feature = "embree")]
mod embree;

use crate::math::Ray;
use crate::shape::{Geometry, Hit, Instance, Shape};
use crate::{Error, Result};
#[cfg(any(feature = "embree", feature = "bvh"))]
use glam::Vec3;

/// Which implementation traces the rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// The system's Embree (feature `embree`).
    Embree,
    /// Our own bounding volume hierarchy (feature `bvh`).
    Bvh,
}

impl Backend {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Backend::Embree => "embree",
            Backend::Bvh => "bvh",
        }
    }
}

/// The backends this build has; the first is the default.
pub fn available() -> &'static [Backend] {
    &[
        #[cfg(feature = "embree")]
        Backend::Embree,
        #[cfg(feature = "bvh")]
        Backend::Bvh,
    ]
}

/// The ray-scene seam. A ray's `t_min` must not be negative; rays that are not finite hit nothing.
pub trait Intersector: Send + Sync {
    /// The nearest hit.
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything lies on the ray.
    fn occluded(&self, ray: &Ray) -> bool;
}

/// Builds the acceleration structure over `geometry`.
///
/// # Errors
/// [`Error::Usage`] if the build lacks the backend or a mesh names vertices it does not have, [`Error::Runtime`] if the
/// device or memory fails.
pub fn build(backend: Backend, geometry: &Geometry) -> Result<Box<dyn Intersector>> {
    check(geometry)?;
    match backend {
        #[cfg(feature = "embree")]
        Backend::Embree => Ok(Box::new(embree::Embree::new(geometry)?)),
        #[cfg(feature = "bvh")]
        Backend::Bvh => Ok(Box::new(bvh::Bvh::new(geometry)?)),
        #[allow(unreachable_patterns)]
        _ => Err(Error::Usage(format!("this build has no backend '{}'", backend.name()))),
    }
}

/// What the backends rely on: indices within their meshes and groups, and primitives that u32 can number.
fn check(geometry: &Geometry) -> Result<()> {
    let mut primitives = geometry.instances.len();
    for (i, shape) in geometry.shapes.iter().enumerate() {
        primitives += match shape {
            Shape::Mesh(mesh) => {
                let vertices = mesh.positions.len();
                if mesh.triangles.iter().flatten().any(|&v| v as usize >= vertices) {
                    return Err(Error::Usage(format!(
                        "shape {i} has triangles of vertices beyond its {vertices}"
                    )));
                }
                mesh.triangles.len()
            }
            _ => 1,
        };
    }
    if primitives > 1 << 30 {
        return Err(Error::Usage(format!("{primitives} primitives are too many")));
    }
    let mut end = geometry.groups.first().map_or(geometry.shapes.len() as u32, |group| group.start);
    for (i, group) in geometry.groups.iter().enumerate() {
        if group.start != end || group.end < end {
            return Err(Error::Usage(format!("group {i} does not begin where the one before ends")));
        }
        end = group.end;
    }
    if end as usize != geometry.shapes.len() {
        return Err(Error::Usage("the last group does not end with the last shape".into()));
    }
    let is_bad = |i: &Instance| i.group as usize >= geometry.groups.len() || !i.is_finite();
    if let Some(i) = geometry.instances.iter().position(is_bad) {
        return Err(Error::Usage(format!("instance {i} is of no group, or its transform has no inverse")));
    }
    Ok(())
}

/// Whether a ray can hit anything. Slab tests and Embree are spared what is not finite.
#[cfg(any(feature = "embree", feature = "bvh"))]
fn is_valid(ray: &Ray) -> bool {
    let sum = ray.o + ray.d;
    (sum.x + sum.y + sum.z).is_finite() && ray.t_min >= 0.0 && ray.t_min < ray.t_max
}

/// Distance along the ray to a triangle's plane, not finite or NaN if there is none. In f64: in f32 the distances to
/// thin triangles are off by more than rays are moved off surfaces.
#[cfg(any(feature = "embree", feature = "bvh"))]
fn plane_distance([a, b, c]: &[Vec3; 3], ray: &Ray) -> f32 {
    let p = a.as_dvec3();
    let n = (b.as_dvec3() - p).cross(c.as_dvec3() - p);
    (n.dot(p - ray.o.as_dvec3()) / n.dot(ray.d.as_dvec3())) as f32
}

#[cfg(test)]
mod instance_tests;
#[cfg(test)]
mod tests;
