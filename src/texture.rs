//! Textures, and parameters that may be textured. Knows no file formats: the scene loader fills it.

use crate::math::Rgb;
use glam::Vec2;

/// The closed set of textures.
#[derive(Clone, Debug)]
pub enum Texture {
    /// Two colours in squares.
    Checkerboard {
        /// Colour of the square at the origin.
        color0: Rgb,
        /// The other colour.
        color1: Rgb,
        /// Applied to texture coordinates first (column-major 2×3).
        to_uv: glam::Affine2,
    },
}

impl Texture {
    /// The value at texture coordinates `uv`.
    pub fn eval(&self, uv: Vec2) -> Rgb {
        match self {
            Texture::Checkerboard { color0, color1, to_uv } => {
                let t = to_uv.transform_point2(uv);
                let t = t - t.floor();
                if (t.x > 0.5) == (t.y > 0.5) { *color0 } else { *color1 }
            }
        }
    }

    /// Mean over the unit square of texture coordinates.
    pub fn mean(&self) -> Rgb {
        match self {
            Texture::Checkerboard { color0, color1, .. } => 0.5 * (*color0 + *color1),
        }
    }
}

/// A colour parameter: the same everywhere, or an index into the scene's textures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// The same everywhere.
    Constant(Rgb),
    /// Looked up; the index is valid in the scene's list of textures.
    Texture(u32),
}

impl Color {
    /// The value at `uv`.
    pub fn eval(&self, textures: &[Texture], uv: Vec2) -> Rgb {
        match *self {
            Color::Constant(c) => c,
            Color::Texture(i) => textures[i as usize].eval(uv),
        }
    }

    /// Mean over the texture.
    pub fn mean(&self, textures: &[Texture]) -> Rgb {
        match *self {
            Color::Constant(c) => c,
            Color::Texture(i) => textures[i as usize].mean(),
        }
    }
}
