//! The film: size, reconstruction filter, and the sums of passes.

use crate::image_io::Image;
use crate::math::Rgb;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec2};
use rayon::prelude::*;

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

impl Filter {
    /// Half the filter's width, pixels: beyond it [`Filter::density`] is zero.
    pub fn radius(&self) -> f32 {
        match *self {
            Filter::Box => 0.5,
            Filter::Tent { radius } => radius,
            Filter::Gaussian { stddev } => 4.0 * stddev,
        }
    }

    /// Density of [`Filter::sample`] at an offset from the pixel's centre, per square pixel.
    pub fn density(&self, offset: Vec2) -> f32 {
        // ∫ exp(−x²/2) − exp(−8) dx over [−4, 4].
        const AREA: f32 = 2.503_786;
        let along = |x: f32| match *self {
            Filter::Box => ((-0.5..0.5).contains(&x)) as u8 as f32,
            Filter::Tent { radius } => (1.0 - x.abs() / radius).max(0.0) / radius,
            Filter::Gaussian { stddev } => {
                let x = x / stddev;
                ((-0.5 * x * x).exp() - (-8f32).exp()).max(0.0) / (AREA * stddev)
            }
        };
        along(offset.x) * along(offset.y)
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

/// A sum carried to 106 bits (Knuth's two-sum), so that neither the order of passes nor how they are spread over
/// machines shows in the 24 bits of a pixel: the sum is exact while the summands' magnitudes span less than 2⁶⁰.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Sum {
    high: DVec3,
    low: DVec3,
}

impl Sum {
    /// Adds one value.
    pub fn add(&mut self, value: Rgb) {
        self.add_double(value.as_dvec3());
    }

    fn add_double(&mut self, value: DVec3) {
        let sum = self.high + value;
        let added = sum - self.high;
        self.low += (self.high - (sum - added)) + (value - added);
        self.high = sum;
    }

    fn value(self) -> DVec3 {
        self.high + self.low
    }
}

/// Sums of independent passes, per pixel.
///
/// The picture is kept twice over. Passes of even and of odd number go to two *halves*, which share no random numbers:
/// how far they differ tells the noise. And each half may hold the picture at two *levels*: wide, with the photon
/// maps' estimates as they are, and fine, with kernels so narrow that little bias is left but more noise: how far these
/// differ tells the bias, and each pixel shows the mixture of least error (see [`Film::resolve`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    width: usize,
    height: usize,
    /// 1, or 2 with a fine level.
    levels: usize,
    /// Layers beside the picture, which have neither halves nor levels.
    layers: usize,
    /// Passes in each half.
    passes: [u32; 2],
    /// `stride` sums for each pixel: half 0 (wide, fine), half 1 (wide, fine), the layers.
    sums: Vec<Sum>,
}

/// The half that a pass belongs to: blocks of passes take turns, whose length grows as the root of their number. Passes
/// are stratified against each other, and the more so the longer the block.
fn half(pass: u32) -> usize {
    let block = (pass + 1).ilog2() / 2;
    (pass >> block & 1) as usize
}

/// What a pass shows at a pixel.
#[derive(Clone, Debug)]
pub struct Values {
    /// The picture, and the fine one if the film has it.
    pub picture: Vec<Rgb>,
    /// The layers.
    pub layers: Vec<Rgb>,
}

/// What a film shows.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// The picture.
    pub image: Image,
    /// Standard deviation of the picture's noise.
    pub noise: Image,
    /// Magnitude of what the picture is off in the mean.
    pub bias: Image,
    /// Of the whole picture; 0 with fewer than two passes.
    pub error: RelativeError,
    /// For each pixel the share of the fine level.
    fine: Vec<f32>,
}

/// Estimated error of a picture: square roots of mean squares relative to the picture's values, as in `relmse`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RelativeError {
    /// From noise.
    pub noise: f64,
    /// From bias.
    pub bias: f64,
}

impl RelativeError {
    /// Both together.
    pub fn total(&self) -> f64 {
        self.noise.hypot(self.bias)
    }
}

/// Half the width of the windows that statistics are smoothed over, in pixels.
const WINDOW: usize = 2;

/// What is added to squares before they divide, as in `relmse`.
const FLOOR: f64 = 0.01;

impl Film {
    /// An empty film of the crop's size. With `fine`, passes bring the picture at two levels. `layers` is the number
    /// of further values per pixel.
    pub fn new(settings: &FilmSettings, fine: bool, layers: usize) -> Film {
        let (width, height) = (settings.crop.2 as usize, settings.crop.3 as usize);
        let levels = if fine { 2 } else { 1 };
        let mut film = Film { width, height, levels, layers, passes: [0; 2], sums: Vec::new() };
        film.sums = vec![Sum::default(); width * height * film.stride()];
        film
    }

    /// How many bytes [`Film::contents`] of such a film are.
    pub fn contents_size(size: (u32, u32), fine: bool, layers: usize) -> u64 {
        let sums = 2 * (1 + u64::from(fine)) + layers as u64;
        let pixels = u64::from(size.0) * u64::from(size.1);
        pixels.saturating_mul(sums * size_of::<Sum>() as u64)
    }

    fn stride(&self) -> usize {
        2 * self.levels + self.layers
    }

    /// Adds pass number `pass`. `pixel` fills in what it shows at a column and row, in parallel. `row` makes what
    /// `pixel` may reuse along a row; all of these are returned, from the top.
    pub fn add_pass<S: Send>(
        &mut self,
        pass: u32,
        row: impl Fn() -> S + Sync,
        pixel: impl Fn(usize, usize, &mut S, &mut Values) + Sync,
    ) -> Vec<S> {
        let (levels, layers, stride) = (self.levels, self.layers, self.stride());
        let half = half(pass);
        self.passes[half] += 1;
        let rows = self.sums.par_chunks_mut(self.width * stride).enumerate().map(|(y, sums)| {
            let mut scratch = row();
            let mut values = Values { picture: vec![Rgb::ZERO; levels], layers: vec![Rgb::ZERO; layers] };
            for (x, sums) in sums.chunks_exact_mut(stride).enumerate() {
                pixel(x, y, &mut scratch, &mut values);
                let (halves, layers) = sums.split_at_mut(2 * levels);
                let picture = halves[half * levels..].iter_mut().zip(&values.picture);
                picture.chain(layers.iter_mut().zip(&values.layers)).for_each(|(sum, &v)| sum.add(v));
            }
            scratch
        });
        rows.collect()
    }

    /// Adds light to the fine picture of a pass already added, and to `layer`.
    pub fn splat(&mut self, pass: u32, pixel: usize, value: Rgb, layer: Option<usize>) {
        let at = pixel * self.stride();
        self.sums[at + half(pass) * self.levels + self.levels - 1].add(value);
        if let Some(layer) = layer {
            self.sums[at + 2 * self.levels + layer].add(value);
        }
    }

    /// Adds all passes of `other`, which must be of the same shape.
    pub fn merge(&mut self, other: &Film) {
        assert_eq!((self.stride(), self.sums.len()), (other.stride(), other.sums.len()), "films differ");
        for (sum, other) in self.sums.iter_mut().zip(&other.sums) {
            sum.add_double(other.high);
            sum.low += other.low;
        }
        for (n, other) in self.passes.iter_mut().zip(other.passes) {
            *n += other;
        }
    }

    /// How many passes it holds.
    pub fn passes(&self) -> u32 {
        self.passes[0] + self.passes[1]
    }

    /// Everything but the shape, for keeping: passes of each half, and the sums.
    pub fn contents(&self) -> ([u32; 2], &[u8]) {
        (self.passes, bytemuck::cast_slice(&self.sums))
    }

    /// Where [`Film::contents`] of a film of the same shape are put back.
    pub fn contents_mut(&mut self) -> (&mut [u32; 2], &mut [u8]) {
        (&mut self.passes, bytemuck::cast_slice_mut(&mut self.sums))
    }

    fn pixel(&self, pixel: usize) -> &[Sum] {
        &self.sums[pixel * self.stride()..][..self.stride()]
    }

    /// Means of the passes in all, and the half difference between the means of the two halves, scaled so that its
    /// square is the variance of the mean. Both wide, and fine less wide.
    fn levels(&self, pixel: usize) -> [(DVec3, DVec3); 2] {
        let sums = self.pixel(pixel);
        let [n0, n1] = self.passes.map(f64::from);
        let n = (n0 + n1).max(1.0);
        let spread = if n0 > 0.0 && n1 > 0.0 { (n0 * n1).sqrt() / n } else { 0.0 };
        let level = |l: usize| {
            let (a, b) = (sums[l].value(), sums[self.levels + l].value());
            ((a + b) / n, (a / n0.max(1.0) - b / n1.max(1.0)) * spread)
        };
        let (wide, noise) = level(0);
        let (fine, fine_noise) = level(self.levels - 1);
        [(wide, noise), (fine - wide, fine_noise - noise)]
    }

    /// The picture, and how far it is to be trusted.
    ///
    /// Let W be the wide picture, F the fine one, free of bias for what matters, and D = F − W. The pixel shows
    /// W + sD, with the share s that makes the expected error of F + (s − 1)D least: 1 − s = cov(F, D) / E\[D²\],
    /// which takes the second moments about the truth. They are averaged over windows of 5×5 pixels; covariances
    /// come from the halves' difference. As passes grow in number, noise vanishes, and s goes to 1 wherever W is biased.
    pub fn resolve(&self) -> Resolved {
        let blend = self.windowed(|pixel| {
            let [(_, wide_noise), (difference, noise)] = self.levels(pixel);
            let fine_noise = wide_noise + noise;
            [fine_noise * noise, difference * difference, noise * noise]
        });
        let halves = self.passes.iter().all(|&n| n > 0);
        let fine: Vec<f32> = blend
            .iter()
            .map(|[covariance, square, _]| {
                let wide = covariance.element_sum() / square.element_sum();
                // NaN where both levels are the same, and where nothing is known yet.
                if !halves || !(wide < 1.0) { 0.0 } else { (1.0 - wide.max(0.0)) as f32 }
            })
            .collect();
        let mixture = |pixel: usize| {
            let [(wide, wide_noise), (difference, noise)] = self.levels(pixel);
            let share = f64::from(fine[pixel]);
            (wide + difference * share, wide_noise + noise * share)
        };
        // Noise goes with brightness, so it is relative noise that is smoothed.
        let noise = self.windowed(|pixel| {
            let (value, noise) = mixture(pixel);
            [noise * noise / (value * value + FLOOR), value, DVec3::ZERO]
        });
        let n = self.width * self.height;
        let mut error = (0.0, 0.0);
        let (mut image, mut noises, mut biases) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for pixel in 0..n {
            let (value, _) = mixture(pixel);
            let [relative_variance, around, _] = noise[pixel];
            let [_, square, variance] = blend[pixel];
            let left = 1.0 - f64::from(fine[pixel]);
            let bias = (square - variance).max(DVec3::ZERO) * (left * left);
            // A lone bright pixel must not hide its own error.
            let scale = around * around + FLOOR;
            error.0 += relative_variance.element_sum();
            error.1 += (bias / scale).element_sum();
            image.push(value.as_vec3());
            noises.push((relative_variance * (value * value + FLOOR)).map(f64::sqrt).as_vec3());
            biases.push(bias.map(f64::sqrt).as_vec3());
        }
        let mean = |sum: f64| if halves { (sum / (3 * n).max(1) as f64).sqrt() } else { 0.0 };
        let picture = |pixels| Image { width: self.width, height: self.height, pixels };
        Resolved {
            image: picture(image),
            noise: picture(noises),
            bias: picture(biases),
            error: RelativeError { noise: mean(error.0), bias: mean(error.1) },
            fine,
        }
    }

    /// The mean of a layer over all passes; black without any.
    pub fn layer(&self, layer: usize) -> Image {
        self.mixed_layer(layer, layer, None)
    }

    /// Two layers that are levels of one, mixed as the picture is.
    pub fn layer_of_levels(&self, wide: usize, fine: usize, resolved: &Resolved) -> Image {
        self.mixed_layer(wide, fine, Some(resolved))
    }

    fn mixed_layer(&self, wide: usize, fine: usize, resolved: Option<&Resolved>) -> Image {
        let scale = 1.0 / self.passes().max(1) as f64;
        let pixels = (0..self.width * self.height).map(|pixel| {
            let layers = &self.pixel(pixel)[2 * self.levels..];
            let (wide, fine) = (layers[wide].value() * scale, layers[fine].value() * scale);
            let share = resolved.map_or(0.0, |r| f64::from(r.fine[pixel]));
            (wide + (fine - wide) * share).as_vec3()
        });
        Image { width: self.width, height: self.height, pixels: pixels.collect() }
    }

    /// Means of `value` over the window around each pixel, as far as it lies on the film. What is not finite is left out.
    fn windowed(&self, value: impl Fn(usize) -> [DVec3; 3] + Sync) -> Vec<[DVec3; 3]> {
        let (width, height) = (self.width, self.height);
        let range = |i: usize, n: usize| i.saturating_sub(WINDOW)..(i + WINDOW + 1).min(n);
        let add = |mut a: [DVec3; 3], b: &[DVec3; 3]| {
            a.iter_mut().zip(b).for_each(|(a, &b)| *a += b);
            a
        };
        let row = |y: usize| {
            let column = |x: usize| {
                let values = range(y, height).map(|y| value(y * width + x));
                values.filter(|v| v.iter().all(|v| v.is_finite())).fold([DVec3::ZERO; 3], |a, b| add(a, &b))
            };
            let columns: Vec<_> = (0..width).map(column).collect();
            (0..width).map(move |x| {
                let count = range(x, width).len() * range(y, height).len();
                let sum = columns[range(x, width)].iter().fold([DVec3::ZERO; 3], add);
                sum.map(|v| v / count as f64)
            })
        };
        (0..height).into_par_iter().flat_map_iter(row).collect()
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
