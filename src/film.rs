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
    /// An offset from the pixel's centre, in pixels, distributed exactly like the filter.
    pub fn sample(&self, u: Vec2) -> Vec2 {
        match *self {
            Filter::Box => u - 0.5,
            Filter::Tent { radius } => u.map(|u| radius * signed(u, |v| 1.0 - (1.0 - v).sqrt())),
            Filter::Gaussian { stddev } => u.map(|u| stddev * signed(u, half_gaussian)),
        }
    }
}

/// Makes a map from [0, 1) to the positive half of a symmetric filter one to both halves, continuously.
fn signed(u: f32, half: impl Fn(f32) -> f32) -> f32 {
    let x = 2.0 * u - 1.0;
    half(x.abs()).copysign(x)
}

/// Inverts the distribution over [0, 4] whose density is proportional to exp(−x²/2) − exp(−8), to 1.4·10⁻⁴: a Newton
/// iteration on the error function costs as much as tracing a ray. The fourth root takes the steepness out of the
/// tail, so that a polynomial (our own Chebyshev fit) does for the rest.
fn half_gaussian(u: f32) -> f32 {
    #[rustfmt::skip]
    const FIT: [f32; 14] = [
        3.71757, 0.1887707, 0.6813784, 0.02610379, 0.4170053, -0.1719947, -0.9458265, 0.9746362, 2.632634, -2.314862,
        -3.217719, 2.977656, 1.219534, -1.175736,
    ];
    let w = (1.0 - u).max(0.0).sqrt().sqrt();
    let t = 2.0 * w - 1.0;
    ((1.0 - w) * FIT.iter().rev().fold(0.0, |sum, c| sum * t + c)).clamp(0.0, 4.0)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the distribution of one axis with the filter's density, integrated over bins.
    fn matches(filter: Filter, radius: f64, density: impl Fn(f64) -> f64) {
        const BINS: usize = 40;
        const N: usize = 100_000;
        let width = 2.0 * radius / BINS as f64;
        let mut bins = [0usize; BINS];
        for i in 0..N {
            let u = (i as f32 + 0.5) / N as f32;
            let p = filter.sample(Vec2::new(u, 1.0 - u));
            assert!((p.x + p.y).abs() <= 1e-4 * radius as f32, "the axes differ at {u}: {p}");
            assert!((p.x.abs() as f64) <= radius * 1.000_001);
            bins[(((p.x as f64 + radius) / width) as usize).min(BINS - 1)] += 1;
        }
        let mass = |bin: usize| -> f64 {
            (0..100).map(|k| density(-radius + (bin as f64 + (k as f64 + 0.5) / 100.0) * width)).sum()
        };
        let total: f64 = (0..BINS).map(mass).sum();
        for (i, &count) in bins.iter().enumerate() {
            let expected = mass(i) / total * N as f64;
            // Evenly spread u: a bin is off by two at most, and by the rounding of u.
            assert!(
                (count as f64 - expected).abs() < 3.0 + 1e-3 * expected,
                "bin {i}: {count} for {expected}"
            );
        }
    }

    #[test]
    fn filters_are_sampled_exactly() {
        matches(Filter::Box, 0.5, |_| 1.0);
        matches(Filter::Tent { radius: 1.5 }, 1.5, |x| 1.0 - x.abs() / 1.5);
        // Mitsuba 3's Gaussian.
        matches(Filter::Gaussian { stddev: 0.5 }, 2.0, |x| (-2.0 * x * x).exp() - (-8.0f64).exp());
        matches(Filter::Gaussian { stddev: 2.0 }, 8.0, |x| (-0.125 * x * x).exp() - (-8.0f64).exp());
    }
}
