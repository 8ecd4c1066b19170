//! The film: size, reconstruction filter, and the sums of passes.

use crate::image_io::Image;
use crate::math::Rgb;
use glam::Vec2;

/// Reconstruction filters. Each pixel importance-samples the filter around its own centre, so passes need no
/// neighbours and every sample has weight 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// The pixel's own square.
    Box,
    /// A tent of the given radius in pixels.
    Tent {
        /// Radius in pixels.
        radius: f32,
    },
    /// A Gaussian, cut off at four standard deviations and lowered to reach zero there.
    Gaussian {
        /// Standard deviation in pixels.
        stddev: f32,
    },
}

impl Filter {
    /// An offset from the pixel's centre, in pixels.
    pub fn sample(&self, u: Vec2) -> Vec2 {
        match self {
            Filter::Box => u - 0.5,
            _ => u - 0.5,
        }
    }
}

/// What a scene says about its film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmSettings {
    /// Full size in pixels.
    pub size: (u32, u32),
    /// Crop window: x, y, width, height in pixels. The image has the crop's size.
    pub crop: (u32, u32, u32, u32),
    /// Reconstruction filter.
    pub filter: Filter,
}

/// Sums of independent passes.
#[derive(Clone, Debug)]
pub struct Film {
    width: usize,
    height: usize,
    passes: u32,
    sums: Vec<[f64; 3]>,
}

impl Film {
    /// An empty film of the crop's size.
    pub fn new(settings: &FilmSettings) -> Film {
        let (width, height) = (settings.crop.2 as usize, settings.crop.3 as usize);
        Film { width, height, passes: 0, sums: vec![[0.0; 3]; width * height] }
    }

    /// Adds one pass: one value per pixel.
    pub fn add_pass(&mut self, pixels: &[Rgb]) {
        for (sum, p) in self.sums.iter_mut().zip(pixels) {
            sum[0] += p.x as f64;
            sum[1] += p.y as f64;
            sum[2] += p.z as f64;
        }
        self.passes += 1;
    }

    /// How many passes it holds.
    pub fn passes(&self) -> u32 {
        self.passes
    }

    /// The mean of the passes; black without any.
    pub fn resolve(&self) -> Image {
        let scale = 1.0 / self.passes.max(1) as f64;
        let pixels = self.sums.iter().map(|s| Rgb::from_array(s.map(|x| (x * scale) as f32))).collect();
        Image { width: self.width, height: self.height, pixels }
    }
}
