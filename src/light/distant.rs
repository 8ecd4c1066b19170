//! What all infinitely distant lights share: they shine onto the scene's bounding sphere.

use super::{EmissionSample, Targets};
use crate::math::{Frame, Rgb, offset_origin, warp};
use crate::shape::Bounds;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// The scene's bounding sphere.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct World {
    center: Vec3,
    radius: f32,
}

impl World {
    pub(super) fn new(bounds: Bounds) -> World {
        if bounds.is_empty() {
            return World::default();
        }
        World { center: bounds.center(), radius: bounds.radius() }
    }

    /// Area of the sphere's cross-section.
    pub(super) fn cross_section(&self) -> f32 {
        PI * self.radius * self.radius
    }

    /// A photon with direction `d`, from the plane that touches the sphere on the near side: towards `targets`, or
    /// uniform over the sphere. `irradiance` is what a surface facing the light receives, over the direction's pdf.
    pub(super) fn emission(
        &self,
        d: Vec3,
        irradiance: Rgb,
        targets: &Targets,
        u_pos: Vec2,
    ) -> Option<EmissionSample> {
        let (o, pdf_a) = targets.sample_line(d, self.radius, u_pos).unwrap_or_else(|| {
            let on_disk = warp::disk(u_pos) * self.radius;
            let frame = Frame::from_normal(d);
            (self.center + frame.s * on_disk.x + frame.t * on_disk.y, 1.0 / self.cross_section())
        });
        let o = o + d * (d.dot(self.center - o) - self.radius);
        let flux = irradiance / pdf_a;
        let magnitude = self.center.abs().max_element() + self.radius;
        (flux != Rgb::ZERO).then(|| EmissionSample {
            o: offset_origin(o, d, -d, magnitude),
            d,
            flux,
            light: 0,
        })
    }
}
