//! What the renderer needs beyond glam: frames, rays, sampling warps beside their pdfs, samplers, distributions.

mod distribution;
mod frame;
mod ray;
mod sampler;
mod search;
pub mod warp;

pub use distribution::Discrete;
pub use frame::Frame;
pub use ray::{Ray, offset_origin};
pub use sampler::{Sampler, Stream};
pub use search::first_index;

/// Linear sRGB: radiance, flux or reflectance, by context.
pub type Rgb = glam::Vec3;

/// Rec. 709 luminance of a linear colour.
pub fn luminance(c: Rgb) -> f32 {
    c.dot(Rgb::new(0.212_671, 0.715_160, 0.072_169))
}
