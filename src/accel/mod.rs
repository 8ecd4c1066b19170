//! Ray backends behind one seam, [`Intersector`]. They know geometry, no materials, and invent no epsilons: a hit
//! counts when `t_min < t < t_max`.

use crate::math::Ray;
use crate::shape::{Geometry, Hit};
use crate::{Error, Result};

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

/// The ray-scene seam.
pub trait Intersector: Send + Sync {
    /// The nearest hit.
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything lies on the ray.
    fn occluded(&self, ray: &Ray) -> bool;

    /// `hits[i]` answers `rays[i]`; equal lengths.
    fn intersect_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.intersect(ray);
        }
    }
}

/// Builds the acceleration structure over `geometry`.
///
/// # Errors
/// [`Error::Usage`] if the build lacks the backend, [`Error::Runtime`] if the device or memory fails.
pub fn build(backend: Backend, geometry: &Geometry) -> Result<Box<dyn Intersector>> {
    let _ = geometry;
    Err(Error::Usage(format!("this build has no backend '{}'", backend.name())))
}
