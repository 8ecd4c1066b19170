//! A backend that keeps the rays it is asked about.

use caustica::accel::Intersector;
use caustica::math::Ray;
use caustica::shape::Hit;
use std::sync::{Arc, Mutex};

/// Passes queries on; keeps the rays of those for the nearest hit.
pub(crate) struct Recorder {
    pub(crate) inner: Box<dyn Intersector>,
    pub(crate) rays: Arc<Mutex<Vec<Ray>>>,
}

impl Intersector for Recorder {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.rays.lock().unwrap().push(*ray);
        self.inner.intersect(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.inner.occluded(ray)
    }
}
