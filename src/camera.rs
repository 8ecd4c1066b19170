//! Cameras: film position to ray.

use crate::math::Ray;
use glam::{Affine3A, Vec2, Vec3};

/// A perspective camera, with a thin lens if `aperture_radius` > 0. Looks along local +z, x to the *left* of the
/// image as in Mitsuba.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Camera to world.
    pub to_world: Affine3A,
    /// Half the width of the image plane at distance 1: tan(fov_x / 2).
    pub half_width: f32,
    /// Width over height of the full film.
    pub aspect: f32,
    /// Shift of the principal point, in fractions of the film.
    pub principal_offset: Vec2,
    /// Depths (along the optical axis) at which the view begins and ends: 0 and infinity unless the scene sets them.
    pub clip: (f32, f32),
    /// Lens radius; 0 is a pinhole.
    pub aperture_radius: f32,
    /// Depth of the plane in focus.
    pub focus_distance: f32,
}

impl Camera {
    /// The ray through film position `film` ((0,0) top left, (1,1) bottom right of the full film) and lens sample
    /// `lens` in the unit square.
    pub fn ray(&self, film: Vec2, lens: Vec2) -> Ray {
        let _ = (film, lens);
        Ray::new(Vec3::ZERO, Vec3::Z)
    }

    /// Where a world point appears on the film through the lens' centre; `None` behind the camera or clipped.
    pub fn project(&self, p: Vec3) -> Option<Vec2> {
        let _ = p;
        None
    }
}
