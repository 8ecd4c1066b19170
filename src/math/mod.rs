//! What the renderer needs beyond glam: frames, rays, sampling warps beside their pdfs, samplers, distributions.

mod distribution;
mod frame;
mod mis;
mod ray;
mod sampler;
mod search;
pub mod warp;

pub use distribution::Discrete;
pub use frame::Frame;
pub use mis::power_heuristic;
pub use ray::{Ray, offset_origin};
pub use sampler::{Sampler, Stream};
pub use search::first_index;

/// Linear sRGB: radiance, flux or reflectance, by context.
pub type Rgb = glam::Vec3;

/// Rec. 709 luminance of a linear colour.
pub fn luminance(c: Rgb) -> f32 {
    c.dot(Rgb::new(0.212_671, 0.715_160, 0.072_169))
}

/// CIE XYZ to linear sRGB (ITU-R BT.709 primaries, D65 white), by columns.
pub(crate) const XYZ_TO_SRGB: glam::DMat3 = glam::DMat3::from_cols_array(&[
    3.240_479, -0.969_256, 0.055_648, -1.537_150, 1.875_991, -0.204_043, -0.498_535, 0.041_556, 1.057_311,
]);
