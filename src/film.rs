//! The film: size, reconstruction filter, and the sums of passes.

use crate::image_io::Image;
use crate::math::Rgb;
use glam::{DVec3, Vec2};

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

/// Sums of independent passes, per pixel and channel.
#[derive(Clone, Debug)]
pub struct Film {
    width: usize,
    height: usize,
    passes: u32,
    sums: Vec<DVec3>,
    squares: Vec<DVec3>,
}

impl Film {
    /// An empty film of the crop's size.
    pub fn new(settings: &FilmSettings) -> Film {
        let (width, height) = (settings.crop.2 as usize, settings.crop.3 as usize);
        let zeros = vec![DVec3::ZERO; width * height];
        Film { width, height, passes: 0, sums: zeros.clone(), squares: zeros }
    }

    /// Adds one pass: one value per pixel, row by row from the top.
    pub fn add_pass(&mut self, pixels: impl Iterator<Item = Rgb>) {
        for ((sum, square), p) in self.sums.iter_mut().zip(&mut self.squares).zip(pixels) {
            let p = p.as_dvec3();
            *sum += p;
            *square += p * p;
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
        let pixels = self.sums.iter().map(|&sum| (sum * scale).as_vec3()).collect();
        Image { width: self.width, height: self.height, pixels }
    }

    /// The error of the mean, estimated from the spread of passes: the square root of the expected `relmse`, bias
    /// left aside. 0 with fewer than two passes.
    pub fn estimated_relative_error(&self) -> f64 {
        if self.passes < 2 {
            return 0.0;
        }
        let n = self.passes as f64;
        let sum: f64 = self
            .sums
            .iter()
            .zip(&self.squares)
            .map(|(&sum, &square)| {
                let mean = sum / n;
                let variance = (square / n - mean * mean).max(DVec3::ZERO) / (n - 1.0);
                (variance / (mean * mean + 0.01)).element_sum()
            })
            .sum();
        (sum / (3 * self.sums.len()) as f64).sqrt()
    }
}
