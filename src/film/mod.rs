//! The film: size, reconstruction filter, and the sums of passes.

mod outliers;
mod regression;

use crate::image_io::Image;
use crate::math::Rgb;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec2, Vec3};
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

    fn merge(&mut self, other: Sum) {
        self.add_double(other.high);
        self.low += other.low;
    }

    fn value(self) -> DVec3 {
        self.high + self.low
    }
}

/// What a camera sample sees first, through whatever is sharp: what neighbouring pixels are compared by.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Features {
    /// Share of light that is scattered.
    pub albedo: Rgb,
    /// Shading normal.
    pub normal: Vec3,
    /// Position relative to the scene's bounding sphere.
    pub position: Vec3,
}

/// Sums of [`Features`] in fixed point, so that their order does not show.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
struct FeatureSums([i64; 9]);

impl FeatureSums {
    /// More than the rounding of what is added.
    const SCALE: f64 = (1 << 24) as f64;

    fn add(&mut self, features: &Features, weight: f32) {
        for (sum, value) in self.0.iter_mut().zip(bytemuck::cast::<Features, [f32; 9]>(*features)) {
            // A cast of NaN is zero. The limit keeps any number of passes from overflowing.
            let fixed = (f64::from(value.clamp(-16.0, 16.0) * weight) * Self::SCALE).round() as i64;
            *sum = sum.wrapping_add(fixed);
        }
    }

    fn merge(&mut self, other: &FeatureSums) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, other)| *sum = sum.wrapping_add(other));
    }

    fn values(&self) -> [f64; 9] {
        self.0.map(|sum| sum as f64 / Self::SCALE)
    }
}

/// What is known of a pixel before any pass: means over some camera samples of its own.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Guide {
    /// What the camera sees first.
    pub features: Features,
    /// What it sees of lights themselves, see [`Values::emitted`].
    pub emitted: Rgb,
    /// How many samples the features are from.
    count: f32,
    /// How many samples the emitted light is from.
    emitted_count: f32,
    /// Camera samples that each pass is to take.
    per_pass: u32,
}

impl Guide {
    /// From the features and emitted light of each sample.
    pub fn new(samples: impl Iterator<Item = (Features, Rgb)>) -> Guide {
        let (mut features, mut emitted, mut count) = ([0.0f64; 9], DVec3::ZERO, 0.0);
        for (f, e) in samples {
            let f: [f32; 9] = bytemuck::cast(f);
            features.iter_mut().zip(f).for_each(|(sum, f)| *sum += f64::from(f));
            emitted += e.as_dvec3();
            count += 1.0;
        }
        let n = f64::max(count, 1.0);
        Guide {
            features: bytemuck::cast(features.map(|f| (f / n) as f32)),
            emitted: (emitted / n).as_vec3(),
            count: count as f32,
            emitted_count: count as f32,
            per_pass: 1,
        }
    }

    /// The features alone. Light that has had a say in how many samples there are would be off in the mean.
    pub fn without_emitted(self) -> Guide {
        Guide { emitted_count: 0.0, ..self }
    }

    /// The same where each pass is to take so many camera samples.
    pub fn with_samples(self, per_pass: u32) -> Guide {
        Guide { per_pass, ..self }
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
    /// `stride` sums for each pixel: half 0 (wide, fine, emitted light), half 1 (the same), the layers.
    sums: Vec<Sum>,
    /// Features for each pixel in each half; nothing if the film has no guides.
    features: Vec<[FeatureSums; 2]>,
    guides: Vec<Guide>,
}

/// The half that a pass belongs to, 0 or 1. Passes are stratified against the others of their half only: halves share
/// no random numbers.
pub fn half(pass: u32) -> u32 {
    pass % 2
}

/// What a pass shows at a pixel.
#[derive(Clone, Debug)]
pub struct Values {
    /// The picture but for `emitted`, and the fine one if the film has it.
    pub picture: Vec<Rgb>,
    /// What the camera sees of lights themselves, also in mirrors and through glass. It has the noise of edges only.
    pub emitted: Rgb,
    /// What the camera sees, if the film has guides.
    pub features: Features,
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
    /// For each pixel the picture over the mean of its passes, mixed so, and what is to be added to that where the passes have
    /// shown next to nothing.
    gain: Vec<Gain>,
}

/// How what passes have shown becomes what the picture shows, at one pixel.
#[derive(Clone, Copy, Debug)]
struct Gain {
    factor: Vec3,
    /// Of lights that the camera sees, and of everything else.
    rest: [Vec3; 2],
}

/// What one of the layers that add up to the picture takes of it, where no factor on what passes have shown can bring it about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rest {
    /// Nothing.
    Nothing,
    /// What was seen of lights themselves before the first pass.
    Emitted,
    /// What neighbours have seen.
    Reflected,
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

/// A pixel's mean over all passes, and the half difference of the halves' means, scaled so that its square is the variance
/// of the mean.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    value: DVec3,
    noise: DVec3,
}

impl Estimate {
    /// From the sums of the halves, of so many passes each.
    fn new([a, b]: [DVec3; 2], [n0, n1]: [f64; 2]) -> Estimate {
        let n = (n0 + n1).max(1.0);
        let noise = (a / n0.max(1.0) - b / n1.max(1.0)) * ((n0 * n1).sqrt() / n);
        Estimate { value: (a + b) / n, noise }
    }

    /// The means of the halves.
    fn halves(&self, [n0, n1]: [f64; 2]) -> [DVec3; 2] {
        [self.value + self.noise * (n1 / n0).sqrt(), self.value - self.noise * (n0 / n1).sqrt()]
    }

    fn plus(&self, other: &Estimate, share: f64) -> Estimate {
        Estimate { value: self.value + other.value * share, noise: self.noise + other.noise * share }
    }
}

/// Most camera samples that a pass takes of a pixel, whatever a file says.
const MOST_PER_PASS: u32 = 16;

/// Half the width of the windows that statistics are smoothed over, in pixels.
const WINDOW: usize = 2;

/// The multiple of its variance from which on the square of the levels' difference counts as bias: it is as noisy as
/// the variance itself, and a share of fine that answers to noise costs more than a little bias does.
const SIGNIFICANT: f64 = 2.0;

/// What is added to squares before they divide, as in `relmse`.
const FLOOR: f64 = 0.01;

/// What is added to an albedo before it divides.
const DARK: f64 = 0.02;

/// Relative error of a sample's f32 arithmetic: no pixel is known better.
const ROUNDING: f64 = 1.0 / 65536.0;

impl Film {
    /// An empty film of so many columns and rows. With `fine`, passes bring the picture at two levels. `layers` is the
    /// number of further values per pixel. With `guided`, pixels learn from their neighbours, see [`Film::set_guides`].
    pub fn new(size: (u32, u32), fine: bool, layers: usize, guided: bool) -> Film {
        let (width, height) = (size.0 as usize, size.1 as usize);
        let levels = if fine { 2 } else { 1 };
        let guides = if guided { width * height } else { 0 };
        let mut film = Film {
            width,
            height,
            levels,
            layers,
            passes: [0; 2],
            sums: Vec::new(),
            features: vec![Default::default(); guides],
            guides: vec![Guide::default(); guides],
        };
        film.sums = vec![Sum::default(); width * height * film.stride()];
        film
    }

    /// What is known of each pixel of a guided film beforehand, row by row. The same for all films that are to be merged.
    pub fn set_guides(&mut self, guides: Vec<Guide>) {
        assert_eq!(self.guides.len(), guides.len(), "one guide for each pixel");
        self.guides = guides;
    }

    /// How many bytes [`Film::contents`] of such a film are.
    pub fn contents_size(size: (u32, u32), fine: bool, layers: usize, guided: bool) -> u64 {
        let sums = 2 * (2 + u64::from(fine)) + layers as u64;
        let guides = if guided { size_of::<[FeatureSums; 2]>() + size_of::<Guide>() } else { 0 };
        let pixels = u64::from(size.0) * u64::from(size.1);
        pixels.saturating_mul(sums * size_of::<Sum>() as u64 + guides as u64)
    }

    /// Sums of a half: its levels, and emitted light.
    fn block(&self) -> usize {
        self.levels + 1
    }

    fn stride(&self) -> usize {
        2 * self.block() + self.layers
    }

    /// Adds pass number `pass`. `pixel` fills in, in parallel, what a camera sample at a column and row shows; it is given the
    /// sample's number among those that the half takes of the pixel. `row` makes what `pixel` may reuse along a row; all of
    /// these are returned, from the top.
    pub fn add_pass<S: Send>(
        &mut self,
        pass: u32,
        row: impl Fn() -> S + Sync,
        pixel: impl Fn(usize, usize, u64, &mut S, &mut Values) + Sync,
    ) -> Vec<S> {
        let (levels, layers, stride, block) = (self.levels, self.layers, self.stride(), self.block());
        let half = half(pass) as usize;
        let earlier = u64::from(pass / 2);
        self.passes[half] += 1;
        let guides = &self.guides;
        let mut features: Vec<&mut [[FeatureSums; 2]]> = match self.features.is_empty() {
            true => (0..self.height).map(|_| Default::default()).collect(),
            false => self.features.chunks_exact_mut(self.width).collect(),
        };
        let width = self.width;
        let rows = self.sums.par_chunks_mut(width * stride).zip(features.par_iter_mut()).enumerate();
        // One row at a time, or the last thread has a share of its own left when the others are done.
        let rows = rows.with_max_len(1);
        let rows = rows.map(|(y, (sums, features))| {
            let mut scratch = row();
            let mut values = Values {
                picture: vec![Rgb::ZERO; levels],
                emitted: Rgb::ZERO,
                features: Features::default(),
                layers: vec![Rgb::ZERO; layers],
            };
            for (x, sums) in sums.chunks_exact_mut(stride).enumerate() {
                let samples = guides
                    .get(y * width + x)
                    .map_or(1, |guide| u64::from(guide.per_pass.clamp(1, MOST_PER_PASS)));
                let weight = 1.0 / samples as f32;
                for index in earlier * samples..(earlier + 1) * samples {
                    pixel(x, y, index, &mut scratch, &mut values);
                    let (halves, layers) = sums.split_at_mut(2 * block);
                    let picture = values.picture.iter().chain([&values.emitted]);
                    let picture = halves[half * block..].iter_mut().zip(picture);
                    picture
                        .chain(layers.iter_mut().zip(&values.layers))
                        .for_each(|(sum, &v)| sum.add(v * weight));
                    if let Some(features) = features.get_mut(x) {
                        features[half].add(&values.features, weight);
                    }
                }
            }
            scratch
        });
        rows.collect()
    }

    /// Adds light to the fine picture of a pass already added, and to `layer`.
    pub fn splat(&mut self, pass: u32, pixel: usize, value: Rgb, layer: Option<usize>) {
        let (at, block) = (pixel * self.stride(), self.block());
        self.sums[at + half(pass) as usize * block + self.levels - 1].add(value);
        if let Some(layer) = layer {
            self.sums[at + 2 * block + layer].add(value);
        }
    }

    /// Adds all passes of `other`, which must be of the same shape.
    pub fn merge(&mut self, other: &Film) {
        assert_eq!((self.stride(), self.sums.len()), (other.stride(), other.sums.len()), "films differ");
        assert_eq!(self.guides.len(), other.guides.len(), "films differ");
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, &other)| sum.merge(other));
        let features = self.features.iter_mut().flatten().zip(other.features.iter().flatten());
        features.for_each(|(sum, other)| sum.merge(other));
        for (n, other) in self.passes.iter_mut().zip(other.passes) {
            *n += other;
        }
    }

    /// How many passes it holds.
    pub fn passes(&self) -> u32 {
        self.passes[0] + self.passes[1]
    }

    /// Everything but the shape, for keeping: passes of each half, and numbers with the bytes that each takes.
    pub fn contents(&self) -> ([u32; 2], [(&[u8], usize); 3]) {
        let [sums, features] = [bytemuck::cast_slice(&self.sums), bytemuck::cast_slice(&self.features)];
        (self.passes, [(sums, 8), (features, 8), (bytemuck::cast_slice(&self.guides), 4)])
    }

    /// Where [`Film::contents`] of a film of the same shape are put back.
    pub fn contents_mut(&mut self) -> (&mut [u32; 2], [(&mut [u8], usize); 3]) {
        let sums = bytemuck::cast_slice_mut(&mut self.sums);
        let features = bytemuck::cast_slice_mut(&mut self.features);
        (&mut self.passes, [(sums, 8), (features, 8), (bytemuck::cast_slice_mut(&mut self.guides), 4)])
    }

    fn pixel(&self, pixel: usize) -> &[Sum] {
        &self.sums[pixel * self.stride()..][..self.stride()]
    }

    /// The wide picture, and the fine one less the wide.
    fn levels(&self, pixel: usize) -> [Estimate; 2] {
        let (wide, fine) = (self.estimate(pixel, 0), self.estimate(pixel, self.levels - 1));
        [wide, fine.plus(&wide, -1.0)]
    }

    /// Of sum number `i` of the halves.
    fn estimate(&self, pixel: usize, i: usize) -> Estimate {
        let sums = self.pixel(pixel);
        Estimate::new([sums[i].value(), sums[self.block() + i].value()], self.passes.map(f64::from))
    }

    /// What the camera sees of lights themselves: mean over all passes, and the samples that were taken before.
    fn emitted(&self, pixel: usize) -> Estimate {
        let Estimate { value, noise } = self.estimate(pixel, self.levels);
        let before = self.guides.get(pixel).copied().unwrap_or_default();
        let count = f64::from(before.emitted_count);
        let known = count / (f64::from(self.passes()) + count).max(1.0);
        let before = before.emitted.as_dvec3();
        Estimate { value: value + (before - value) * known, noise: noise * (1.0 - known) }
    }

    /// The picture, and how far it is to be trusted.
    ///
    /// Three levels are mixed in two steps: fine with wide, and what comes of it with its regression over neighbours
    /// (`film/regression.rs`). As passes grow in number, noise vanishes, and the finer level is shown wherever the other is
    /// biased.
    pub fn resolve(&self) -> Resolved {
        let n = self.width * self.height;
        let halves = self.passes.iter().all(|&n| n > 0);
        let (wide, difference): (Vec<_>, Vec<_>) =
            (0..n).into_par_iter().map(|pixel| self.levels(pixel).into()).unzip();
        let (fine, mut biases) = self.shares(&difference, &wide);
        let mixture = |coarse: &[Estimate], difference: &[Estimate], share: &[f32]| -> Vec<Estimate> {
            let mixed = coarse.par_iter().zip(difference).zip(share);
            mixed.map(|((coarse, difference), &share)| coarse.plus(difference, f64::from(share))).collect()
        };
        let mut picture = mixture(&wide, &difference, &fine);
        let mean: Vec<DVec3> = picture.par_iter().map(|mixed| mixed.value).collect();
        if halves && !self.guides.is_empty() {
            let smooth = self.smooth(&picture);
            let difference: Vec<Estimate> =
                picture.par_iter().zip(&smooth).map(|(mixed, smooth)| mixed.plus(smooth, -1.0)).collect();
            let (share, more) = self.shares(&difference, &smooth);
            picture = mixture(&smooth, &difference, &share);
            biases.iter_mut().zip(more).for_each(|(bias, more)| *bias += more);
        }
        let lights: Vec<Estimate> = (0..n).into_par_iter().map(|pixel| self.emitted(pixel)).collect();
        picture = picture.par_iter().zip(&lights).map(|(p, light)| p.plus(light, 1.0)).collect();
        // Noise goes with brightness, so it is relative noise that is smoothed.
        let noise = self.windowed(|pixel| {
            let Estimate { value, noise } = picture[pixel];
            let rounding = value * ROUNDING;
            [(noise * noise + rounding * rounding) / (value * value + FLOOR), value, DVec3::ZERO]
        });
        let mut error = (0.0, 0.0);
        let (mut image, mut noises, mut gain) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for pixel in 0..n {
            let value = picture[pixel].value;
            let [relative_variance, around, _] = noise[pixel];
            // A lone bright pixel must not hide its own error.
            let scale = around * around + FLOOR;
            error.0 += relative_variance.element_sum();
            error.1 += (biases[pixel] / scale).element_sum();
            image.push(value.as_vec3());
            noises.push((relative_variance * (value * value + FLOOR)).map(f64::sqrt).as_vec3());
            let emitted = self.estimate(pixel, self.levels).value;
            let passes = mean[pixel] + emitted;
            // A larger factor would leave rounding of the layers behind.
            let scaled = passes.abs().cmpgt(value.abs() * 1e-3);
            let factor = DVec3::select(scaled, value / passes, DVec3::ONE);
            let rest = DVec3::select(scaled, DVec3::ZERO, value - passes);
            let of_lights = DVec3::select(scaled, DVec3::ZERO, lights[pixel].value - emitted);
            let rest = [of_lights, rest - of_lights].map(|rest| rest.as_vec3());
            gain.push(Gain { factor: factor.as_vec3(), rest });
        }
        let mean = |sum: f64| if halves { (sum / (3 * n).max(1) as f64).sqrt() } else { 0.0 };
        let picture = |pixels| Image { width: self.width, height: self.height, pixels };
        Resolved {
            image: picture(image),
            noise: picture(noises),
            bias: picture(biases.iter().map(|b| b.map(f64::sqrt).as_vec3()).collect()),
            error: RelativeError { noise: mean(error.0), bias: mean(error.1) },
            fine,
            gain,
        }
    }

    /// For each pixel the share of `difference` to be added to `coarse`, and the square of the bias that is left.
    ///
    /// Let F be the finer picture, free of bias for what matters, W the coarser one, and D = F − W. The pixel shows W + sD,
    /// with the share s that makes the expected square of its error least: 1 − s = cov(F, D) / E\[D²\]. Covariances come
    /// from the halves' difference, E\[D²\] = var D + bias², where only what clearly exceeds the noise of D counts as bias;
    /// all are means over windows of 5×5 pixels.
    fn shares(&self, difference: &[Estimate], coarse: &[Estimate]) -> (Vec<f32>, Vec<DVec3>) {
        let halves = self.passes.iter().all(|&n| n > 0);
        let blend = self.windowed(|pixel| {
            let Estimate { value, noise } = difference[pixel];
            let fine_noise = coarse[pixel].noise + noise;
            [fine_noise * noise, value * value, noise * noise]
        });
        let pixel = |[covariance, square, variance]: &[DVec3; 3]| {
            let bias = (*square - *variance * SIGNIFICANT).element_sum().max(0.0);
            let wide = covariance.element_sum() / (variance.element_sum() + bias);
            // Not for NaN: both levels are the same.
            let share = if halves && wide < 1.0 { 1.0 - wide.max(0.0) } else { 0.0 };
            let left = 1.0 - share;
            // Bias that may hide in the noise is counted rather than left out.
            (share as f32, (*square - *variance).max(DVec3::ZERO) * (left * left))
        };
        blend.iter().map(pixel).unzip()
    }

    /// Means of a pixel's features: of each half, and of all samples there are.
    fn features(&self, pixel: usize) -> ([[f64; 9]; 2], [f64; 9]) {
        let sums = self.features[pixel].map(|sums| sums.values());
        let halves = [0, 1].map(|h| sums[h].map(|sum| sum / f64::from(self.passes[h].max(1))));
        let guide = &self.guides[pixel];
        let before: [f32; 9] = bytemuck::cast(guide.features);
        let count = f64::from(guide.count);
        let n = (f64::from(self.passes()) + count).max(1.0);
        let all = std::array::from_fn(|f| (sums[0][f] + sums[1][f] + f64::from(before[f]) * count) / n);
        (halves, all)
    }

    /// How much positions vary over the picture.
    fn spread(&self) -> f64 {
        let n = self.guides.len();
        let position = |pixel| DVec3::from_slice(&self.features(pixel).1[6..]);
        let positions: Vec<DVec3> = (0..n).into_par_iter().map(position).collect();
        // In order, so that the sums do not depend on the threads.
        let mean = positions.iter().sum::<DVec3>() / n as f64;
        let variance = positions.iter().map(|&p| (p - mean) * (p - mean)).sum::<DVec3>() / n as f64;
        variance.max_element().sqrt()
    }

    /// The regression of `picture` over neighbouring pixels, who share what few samples have too much of
    /// (`film/outliers.rs`). What is broken stays as it is.
    fn smooth(&self, picture: &[Estimate]) -> Vec<Estimate> {
        let n = picture.len();
        let passes = self.passes.map(f64::from);
        let spread = self.spread();
        let scaled = |f: &[f64; 9]| -> [f32; regression::FEATURES] {
            let scale = |i: usize| if i < 3 { 1.0 / 0.3 } else { 1.0 / (0.6 * spread + 1e-6) };
            std::array::from_fn(|i| (f[3 + i] * scale(i)) as f32)
        };
        let albedo = |f: &[f64; 9]| DVec3::new(f[0], f[1], f[2]).max(DVec3::ZERO) + DARK;
        // A power of two, so that brightness is a mere factor.
        let sum: f64 = picture.iter().map(|p| p.value.abs().element_sum()).filter(|v| v.is_finite()).sum();
        let unit = if sum > 0.0 { (sum / (3 * n) as f64).log2().floor().exp2() } else { 1.0 };
        let pixel = |pixel: usize| {
            let (halves, all) = self.features(pixel);
            let values = picture[pixel].halves(passes);
            let inputs = [0, 1].map(|h| regression::Input {
                value: (values[h] / (albedo(&halves[h]) * unit)).as_vec3().to_array(),
                features: scaled(&halves[h]),
            });
            (inputs, (scaled(&all), albedo(&all) * unit))
        };
        let (mut inputs, (precise, scale)): (Vec<_>, (Vec<_>, Vec<_>)) =
            (0..n).into_par_iter().map(pixel).unzip();
        let excess = outliers::take(self.width, &mut inputs);
        let variance: Vec<[f32; 3]> = self
            .windowed(|pixel| {
                let [a, b] = inputs[pixel].map(|half| Vec3::from_array(half.value).as_dvec3());
                [(a - b) * (a - b) * 0.5, DVec3::ZERO, DVec3::ZERO]
            })
            .iter()
            .map(|[variance, ..]| variance.as_vec3().to_array())
            .collect();
        let smooth = regression::smooth((self.width, self.height), &inputs, &variance, &precise);
        let given = outliers::given(self.width, &excess, &precise, &smooth);
        let pixel = |pixel: usize| {
            let of = |values: &[[[f32; 3]; 2]], h: usize| Vec3::from_array(values[pixel][h]).as_dvec3();
            let sum = |h: usize| (of(&smooth, h) + of(&given, h)) * scale[pixel] * passes[h];
            let is_sound = picture[pixel].value.is_finite() && picture[pixel].noise.is_finite();
            if is_sound { Estimate::new([sum(0), sum(1)], passes) } else { picture[pixel] }
        };
        (0..n).into_par_iter().map(pixel).collect()
    }

    /// The mean of a layer over all passes; black without any.
    pub fn layer(&self, layer: usize) -> Image {
        self.mixed_layer(layer, layer, None)
    }

    /// Two layers that are levels of one, mixed as the picture is. Of all layers that add up to it, one takes the `rest` that
    /// no factor on the others can bring about.
    pub fn layer_of_levels(&self, wide: usize, fine: usize, resolved: &Resolved, rest: Rest) -> Image {
        self.mixed_layer(wide, fine, Some((resolved, rest)))
    }

    fn mixed_layer(&self, wide: usize, fine: usize, resolved: Option<(&Resolved, Rest)>) -> Image {
        let scale = 1.0 / self.passes().max(1) as f64;
        let pixels = (0..self.width * self.height).map(|pixel| {
            let layers = &self.pixel(pixel)[2 * self.block()..];
            let (wide, fine) = (layers[wide].value() * scale, layers[fine].value() * scale);
            let (share, (gain, rest)) = match resolved {
                None => (0.0, (Vec3::ONE, Vec3::ZERO)),
                Some((resolved, of)) => {
                    let Gain { factor, rest: [emitted, reflected] } = resolved.gain[pixel];
                    let rest = match of {
                        Rest::Nothing => Vec3::ZERO,
                        Rest::Emitted => emitted,
                        Rest::Reflected => reflected,
                    };
                    (f64::from(resolved.fine[pixel]), (factor, rest))
                }
            };
            (wide + (fine - wide) * share).as_vec3() * gain + rest
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
    use crate::math::{Sampler, Stream};

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

    /// The same for [`Filter::density`]: its ratio to the density must be 1 over the integral everywhere.
    fn has_density(filter: Filter, density: impl Fn(f64) -> f64) {
        let radius = filter.radius() as f64;
        let at = |i: usize| radius * ((i as f64 + 0.5) / 500.0 - 1.0);
        let total: f64 = (0..1000).map(|i| density(at(i))).sum::<f64>() * radius / 500.0;
        for i in 0..1000 {
            let own = filter.density(Vec2::new(at(i) as f32, 0.0)) / filter.density(Vec2::ZERO)
                * density(0.0) as f32
                / total as f32;
            let expected = density(at(i)) / total;
            assert!(
                (own as f64 - expected).abs() < 2e-4 / radius,
                "{filter:?} at {}: {own} {expected}",
                at(i)
            );
        }
        let peak = (density(0.0) / total).powi(2);
        assert!((filter.density(Vec2::ZERO) as f64 / peak - 1.0).abs() < 1e-3, "{filter:?}");
        assert_eq!(filter.density(Vec2::new(0.0, filter.radius() * 1.001)), 0.0);
    }

    #[test]
    fn filters_are_sampled_exactly_and_know_their_density() {
        let check = |filter: Filter, density: fn(f64) -> f64| {
            matches(filter, filter.radius() as f64, density);
            has_density(filter, density);
        };
        check(Filter::Box, |_| 1.0);
        check(Filter::Tent { radius: 1.5 }, |x| 1.0 - x.abs() / 1.5);
        // Mitsuba 3's Gaussian.
        check(Filter::Gaussian { stddev: 0.5 }, |x| (-2.0 * x * x).exp() - (-8.0f64).exp());
        check(Filter::Gaussian { stddev: 2.0 }, |x| (-0.125 * x * x).exp() - (-8.0f64).exp());
    }

    fn uniform(rng: &mut Sampler) -> f64 {
        rng.next_1d() as f64 + (rng.next_1d() as f64) / 16_777_216.0
    }

    /// Standard normal, good enough: twelve uniforms.
    fn normal(rng: &mut Sampler) -> f32 {
        (0..12).map(|_| uniform(rng)).sum::<f64>() as f32 - 6.0
    }

    fn random(set: u64) -> Sampler {
        Sampler::new(11, Stream::Eye, set, 0)
    }

    /// Halves, thirds and any order of 4096 values over eighteen magnitudes give the same bits.
    #[test]
    fn sums_do_not_depend_on_order() {
        let mut rng = random(1);
        for _ in 0..50 {
            let mut values: Vec<Rgb> = (0..4096)
                .map(|_| {
                    let magnitude = 10f32.powf(18.0 * rng.next_1d() - 9.0);
                    Rgb::new(rng.next_1d(), rng.next_1d() - 0.5, 1.0) * magnitude
                })
                .collect();
            let sum = |values: &[Rgb]| {
                let mut sum = Sum::default();
                values.iter().for_each(|&v| sum.add(v));
                sum
            };
            let expected = sum(&values).value();
            for cut in [1, 1000, 2048, 4095] {
                let (mut a, b) = (sum(&values[..cut]), sum(&values[cut..]));
                a.merge(b);
                assert_eq!(a.value(), expected);
            }
            for i in (1..values.len()).rev() {
                values.swap(i, (uniform(&mut rng) * (i + 1) as f64) as usize);
            }
            assert_eq!(sum(&values).value(), expected);
        }
    }

    /// Adds passes whose pixels are drawn at random.
    fn add_passes(film: &mut Film, passes: u32, pixel: impl Fn(usize, &mut Sampler, &mut Values) + Sync) {
        for pass in 0..passes {
            film.add_pass(
                pass,
                || (),
                |x, y, _, (), out| {
                    pixel(x, &mut random((pass as usize * 1200 + y * 40 + x) as u64), out);
                },
            );
        }
    }

    /// A film of passes whose wide picture is 1 + bias with little noise, and whose fine one is 1 with much.
    fn film(passes: u32, bias: f32, wide_noise: f32, fine_noise: f32) -> Film {
        let mut film = Film::new((40, 30), true, 0, false);
        add_passes(&mut film, passes, |_, rng, out| {
            out.picture[0] = Rgb::splat(1.0 + bias + wide_noise * normal(rng));
            out.picture[1] = Rgb::splat(1.0 + fine_noise * normal(rng));
        });
        film
    }

    fn share(resolved: &Resolved) -> f32 {
        resolved.fine.iter().sum::<f32>() / resolved.fine.len() as f32
    }

    /// RMS deviation from 1.
    fn error(image: &Image) -> f64 {
        let sum: f64 = image.pixels.iter().map(|p| (p.x as f64 - 1.0).powi(2)).sum();
        (sum / image.pixels.len() as f64).sqrt()
    }

    /// The error is at most 1.4 times that of the best mixture of known bias and noise. It is known within a quarter, but
    /// for bias that may hide in the fine level's noise.
    #[test]
    fn pixels_show_the_mixture_of_least_error_and_know_it() {
        for passes in [16, 17, 64] {
            for (bias, wide_noise, fine_noise) in
                [(0.0, 0.1, 1.0), (0.1, 0.1, 1.0), (0.5, 0.2, 0.4), (-1.0, 0.1, 0.1)]
            {
                let resolved = film(passes, bias, wide_noise, fine_noise).resolve();
                let n = passes as f64;
                let (wide, fine) = (
                    (bias as f64).powi(2) + (wide_noise as f64).powi(2) / n,
                    (fine_noise as f64).powi(2) / n,
                );
                // Of two estimates with independent errors, weighted by the inverse of their squares.
                let best = 1.0 / (1.0 / wide + 1.0 / fine);
                let (actual, known) = (error(&resolved.image), resolved.error.total());
                let what =
                    format!("{passes} passes, bias {bias}: share {:.2}, error {actual:.4}", share(&resolved));
                println!("{what}, best {:.4}, estimated {known:.4}", best.sqrt());
                assert!(actual < 1.4 * best.sqrt(), "{what}, best {:.4}", best.sqrt());
                let hidden = 0.3 * fine.sqrt();
                assert!(
                    known > 0.75 * actual && known < 1.25 * actual.hypot(hidden),
                    "{what}, estimated {known:.4}"
                );
            }
        }
    }

    #[test]
    fn a_single_level_needs_no_choice_and_one_pass_no_estimate() {
        let mut film = Film::new((7, 5), false, 1, false);
        for pass in 0..3 {
            film.add_pass(
                pass,
                || (),
                |x, _, _, (), out| {
                    out.picture[0] = Rgb::splat((x as u32 + pass) as f32);
                    out.layers[0] = Rgb::splat(pass as f32);
                },
            );
            let resolved = film.resolve();
            assert_eq!(resolved.image.pixels[3], Rgb::splat(3.0 + pass as f32 / 2.0));
            assert_eq!(film.layer(0).pixels[3], Rgb::splat(pass as f32 / 2.0));
            assert_eq!(resolved.error.bias, 0.0);
            assert_eq!(resolved.error.noise > 0.0, pass > 0);
        }
    }

    /// Where a pass takes several samples of a pixel, it shows their mean, and each half counts its own.
    #[test]
    fn a_pass_shows_the_mean_of_its_samples() {
        let mut film = Film::new((4, 3), false, 1, true);
        film.set_guides((0..12).map(|i| Guide::new([].into_iter()).with_samples(1 + i % 3)).collect());
        for pass in 0..4 {
            let show = |_, _, sample, (): &mut (), out: &mut Values| {
                out.picture[0] = Rgb::splat(sample as f32);
                out.layers[0] = Rgb::ONE;
            };
            film.add_pass(pass, || (), show);
        }
        for pixel in 0..12 {
            // Both halves take the samples 0 to 2n - 1.
            let n = f64::from(1 + pixel as u32 % 3);
            let Estimate { value, noise } = film.estimate(pixel, 0);
            assert!((value.x - (n - 0.5)).abs() < 1e-6 && noise == DVec3::ZERO, "{pixel}: {value} {noise}");
            assert!((film.layer(0).pixels[pixel].x - 1.0).abs() < 1e-6);
        }
    }

    /// One broken sample spoils its own pixel, no other.
    #[test]
    fn what_is_not_finite_stays_where_it_is() {
        let mut film = film(8, 0.1, 0.1, 0.5);
        film.splat(3, 615, Rgb::new(1.0, f32::NAN, f32::INFINITY), None);
        let resolved = film.resolve();
        for image in [&resolved.image, &resolved.noise, &resolved.bias] {
            for (i, pixel) in image.pixels.iter().enumerate() {
                assert!(i == 615 || pixel.is_finite(), "pixel {i}: {pixel}");
            }
        }
        assert!(!resolved.image.pixels[615].is_finite());
        assert!(resolved.error.total().is_finite());
    }

    #[test]
    fn merged_films_are_one() {
        let whole = film(9, 0.2, 0.3, 0.4);
        let mut rest = whole.clone();
        let mut first = Film::new((40, 30), true, 0, false);
        // Takes away the first pass, as a part that begins with the second.
        first.merge(&film(1, 0.2, 0.3, 0.4));
        rest.passes[0] -= 1;
        for (sum, own) in rest.sums.iter_mut().zip(&first.sums) {
            sum.add_double(-own.high);
            sum.low -= own.low;
        }
        rest.merge(&first);
        let (a, b) = (whole.resolve(), rest.resolve());
        assert_eq!((a.image, a.noise, a.bias), (b.image, b.noise, b.bias));
    }

    /// Two walls that meet in an edge, one bright, with the noise of camera samples that fall on either side, and of light.
    fn walls(guided: bool, passes: u32) -> Film {
        let mut film = Film::new((40, 30), false, 0, guided);
        let features = |side: bool| Features {
            albedo: Rgb::splat(if side { 0.8 } else { 0.2 }),
            normal: if side { Vec3::X } else { Vec3::Y },
            position: Vec3::ZERO,
        };
        let guide = |i: usize| {
            let right = (0..8).map(|k| (features((i % 40 * 8 + k) >= 163), Rgb::ZERO));
            Guide::new(right)
        };
        if guided {
            film.set_guides((0..1200).map(guide).collect());
        }
        add_passes(&mut film, passes, |x, rng, out| {
            let side = (x as f32 + rng.next_1d()) * 8.0 >= 163.0;
            out.features = features(side);
            let light = if side { 2.0 } else { 1.0 } * (1.0 + 0.3 * normal(rng));
            out.picture[0] = out.features.albedo * light;
        });
        film
    }

    /// Noise goes, in the pixels that the edge runs through as well, and the edge stays.
    #[test]
    fn neighbours_take_noise_and_leave_edges() {
        let exact = |i: usize| {
            let right = ((i % 40 + 1) as f64 - 163.0 / 8.0).clamp(0.0, 1.0);
            1.6 * right + 0.2 * (1.0 - right)
        };
        let rms = |film: &Film, edge: bool| {
            let resolved = film.resolve();
            let pixels = (0..1200).filter(|i| (i % 40 == 20) == edge);
            let squares: Vec<f64> =
                pixels.map(|i| (f64::from(resolved.image.pixels[i].x) - exact(i)).powi(2)).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        let (alone, guided) = (walls(false, 16), walls(true, 16));
        for (edge, gain) in [(false, 3.0), (true, 1.25)] {
            let (before, after) = (rms(&alone, edge), rms(&guided, edge));
            println!("edge {edge}: {before:.4} -> {after:.4}");
            assert!(after * gain < before, "edge {edge}: {before:.4} -> {after:.4}");
        }
    }
}
