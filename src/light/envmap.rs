//! Environment maps in latitude-longitude format (Mitsuba 3 `envmap`).

use crate::image_io::{Domain, Image};
use crate::math::{Discrete, Rgb, luminance};
use glam::{Affine3A, Mat3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// An infinitely distant image. Texels are centred in longitude and periodic, while the first and the last row lie
/// *on* the poles; in between, radiance is interpolated bilinearly. Local +y is up, and the image's left edge lies
/// towards −z.
///
/// Directions are sampled exactly in proportion to the interpolated luminance, so the pdf needs no table.
#[derive(Clone, Debug)]
pub struct Envmap {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
    pub(super) to_world: Mat3,
    pub(super) to_local: Mat3,
    /// For each row the running integral of luminance over its `width` spans from texel centre to texel centre.
    columns: Vec<f32>,
    /// For each row where the parts of equal luminance begin into which it is divided, [`STARTS`] and the last span.
    starts: Vec<u32>,
    /// The spans between rows, by luminance per solid angle.
    rows: Discrete,
    /// ∫ L dω, W·m⁻².
    integral: Rgb,
    /// 1 / ∫ luminance dω; 0 for a black map.
    inv_luminance: f32,
}

/// Parts of a row that are found at once: what is left to search lies close together in memory.
const STARTS: usize = 256;

/// The last span that begins at or before `target`, from `first` and before `end`.
fn last_span(mut first: usize, end: usize, target: f32, begins: impl Fn(usize) -> f32) -> usize {
    let mut count = end - first;
    while count > 1 {
        let half = count / 2;
        if begins(first + half) <= target {
            first += half;
        }
        count -= half;
    }
    first
}

impl Envmap {
    /// `scale` multiplies the image; `to_world` may rotate, mirror and (without effect) scale uniformly.
    ///
    /// # Errors
    /// A message if the image is empty, holds values that are negative or not finite, or if the transformation
    /// distorts.
    pub fn new(image: Image, scale: f32, to_world: Affine3A) -> Result<Envmap, String> {
        if image.width == 0 || image.height == 0 || image.pixels.len() != image.width * image.height {
            return Err("the environment map has no pixels".into());
        }
        image.check(Domain::NonNegative, Rgb::splat(scale))?;
        let Image { width, mut height, mut pixels } = image;
        pixels.iter_mut().for_each(|p| *p *= scale);
        // Mitsuba 3 repeats the last row until there are three.
        while height < 3 {
            pixels.extend_from_within((height - 1) * width..);
            height += 1;
        }

        let matrix = Mat3::from(to_world.matrix3);
        let to_world = matrix * (1.0 / matrix.determinant().abs().cbrt());
        if !(to_world.transpose() * to_world).abs_diff_eq(Mat3::IDENTITY, 1e-3) {
            return Err("an environment map can be rotated and mirrored, but not stretched or sheared".into());
        }

        let mut columns = Vec::with_capacity((width + 1) * height);
        for row in pixels.chunks(width) {
            let mut sum = 0.0f64;
            columns.push(0.0);
            for x in 0..width {
                sum += 0.5 * (luminance(row[x]) as f64 + luminance(row[(x + 1) % width]) as f64);
                columns.push(sum as f32);
            }
        }
        let starts = columns.chunks(width + 1).flat_map(|row| {
            let at = |k| last_span(0, width, row[width] * (k as f32 / STARTS as f32), |x| row[x]) as u32;
            (0..=STARTS).map(at)
        });
        let starts = starts.collect();
        let row_sums: Vec<[f64; 3]> = pixels
            .chunks(width)
            .map(|row| {
                row.iter().fold([0.0; 3], |s, p| [s[0] + p.x as f64, s[1] + p.y as f64, s[2] + p.z as f64])
            })
            .collect();
        let h = PI / (height - 1) as f64;
        let texel = h * TAU / width as f64;
        let mut sums = [0.0f64; 3];
        let spans: Vec<f64> = (0..height - 1)
            .map(|y| {
                let upper = row_integral(y as f64 * h, h, 1.0, 0.0, 1.0);
                let lower = row_integral(y as f64 * h, h, 0.0, 1.0, 1.0);
                for (c, sum) in sums.iter_mut().enumerate() {
                    *sum += texel * (row_sums[y][c] * upper + row_sums[y + 1][c] * lower);
                }
                let end = |y: usize| columns[(width + 1) * (y + 1) - 1] as f64;
                end(y) * upper + end(y + 1) * lower
            })
            .collect();
        let total = texel * spans.iter().sum::<f64>();
        let largest = spans.iter().fold(0.0f64, |m, s| m.max(*s));
        Ok(Envmap {
            width,
            height,
            pixels,
            to_world,
            to_local: to_world.inverse(),
            columns,
            starts,
            rows: Discrete::new(spans.iter().map(|s| if largest > 0.0 { (s / largest) as f32 } else { 0.0 })),
            integral: Rgb::from_array(sums.map(|s| s as f32)),
            inv_luminance: if total > 0.0 { (1.0 / total) as f32 } else { 0.0 },
        })
    }

    /// All that the map is made from: its columns, its pixels times the scale, and its orientation.
    pub fn contents(&self) -> (usize, &[Rgb], Mat3) {
        (self.width, &self.pixels, self.to_world)
    }

    /// ∫ L dω over the sphere.
    pub(super) fn integral(&self) -> Rgb {
        self.integral
    }

    /// Radiance that arrives from the world direction `d`.
    pub(super) fn eval(&self, d: Vec3) -> Rgb {
        let l = self.to_local * d;
        // Not acos(y), which is blind near the poles.
        let theta = l.x.hypot(l.z).atan2(l.y);
        let phi = l.x.atan2(-l.z);
        let y = theta * ((self.height - 1) as f32 * std::f32::consts::FRAC_1_PI);
        let x = phi * (self.width as f32 / std::f32::consts::TAU) - 0.5;
        let (xi, yi) = (x.floor(), (y as usize).min(self.height - 2));
        let (fx, fy) = (x - xi, y - yi as f32);
        let wrap = |i: i64| i.rem_euclid(self.width as i64) as usize;
        let (x0, x1) = (wrap(xi as i64), wrap(xi as i64 + 1));
        let row = |y: usize| self.pixels[y * self.width + x0].lerp(self.pixels[y * self.width + x1], fx);
        row(yi).lerp(row(yi + 1), fy.min(1.0))
    }

    /// Pdf of [`Envmap::sample`] in a direction of this radiance: luminance over its integral.
    pub(super) fn pdf_w(&self, radiance: Rgb) -> f32 {
        luminance(radiance) * self.inv_luminance
    }

    /// A world direction towards the map, by luminance; `None` if it is black.
    pub(super) fn sample(&self, u: Vec2) -> Option<Vec3> {
        let (y, _, v) = self.rows.sample(u.y)?;
        let row = |y: usize| &self.columns[y * (self.width + 1)..(y + 1) * (self.width + 1)];
        let (upper, lower) = (row(y), row(y + 1));
        let h = PI / (self.height - 1) as f64;
        let theta = y as f64 * h;
        let fy = sample_span(theta, h, upper[self.width] as f64, lower[self.width] as f64, v as f64);

        let t = fy as f32;
        let running = |x: usize| upper[x] * (1.0 - t) + lower[x] * t;
        let target = u.x * running(self.width);
        // Where a share of a mixture ends lies between where that of either row ends.
        let part = ((u.x * STARTS as f32) as usize).min(STARTS - 1);
        let [a, b] = [y, y + 1].map(|y| &self.starts[y * (STARTS + 1) + part..]);
        let (first, last) = (a[0].min(b[0]) as usize, a[1].max(b[1]) as usize);
        // By one more, for rounding.
        let x = last_span(first.saturating_sub(1), (last + 2).min(self.width), target, running);
        let (begin, end) = (running(x), running(x + 1));
        let texel = |x: usize, y: usize| luminance(self.pixels[y * self.width + x % self.width]);
        let mix = |x: usize| texel(x, y) * (1.0 - t) + texel(x, y + 1) * t;
        let rest = if end > begin { ((target - begin) / (end - begin)).clamp(0.0, 1.0) } else { 0.5 };
        let fx = sample_linear(mix(x), mix(x + 1), rest);

        let (sin_theta, cos_theta) = (theta + h * fy).sin_cos();
        let phi = TAU * (x as f64 + 0.5 + fx as f64) / self.width as f64;
        let (sin_phi, cos_phi) = phi.sin_cos();
        let l = glam::DVec3::new(sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta).as_vec3();
        Some((self.to_world * l).normalize())
    }
}

/// ∫₀ᵗ (a (1−s) + b s) sin(θ + h s) ds.
fn row_integral(theta: f64, h: f64, a: f64, b: f64, t: f64) -> f64 {
    let (sin0, cos0) = theta.sin_cos();
    let (sin1, cos1) = (theta + h * t).sin_cos();
    a * (cos0 - cos1) / h + (b - a) * ((sin1 - sin0) / h - t * cos1) / h
}

/// Samples t in [0, 1] with a density proportional to (a (1−t) + b t) sin(θ + h t).
fn sample_span(theta: f64, h: f64, a: f64, b: f64, u: f64) -> f64 {
    let ((sin0, cos0), sin_end) = (theta.sin_cos(), (theta + h).sin().max(0.0));
    let target = u * row_integral(theta, h, a, b, 1.0);
    // Newton's method from the solution for a linear density, kept inside a shrinking bracket.
    let mut t = sample_linear((a * sin0) as f32, (b * sin_end) as f32, u as f32) as f64;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..32 {
        let (sin, cos) = (theta + h * t).sin_cos();
        // As in row_integral.
        let error = a * (cos0 - cos) / h + (b - a) * ((sin - sin0) / h - t * cos) / h - target;
        if error > 0.0 {
            high = t;
        } else {
            low = t;
        }
        let next = t - error / ((a * (1.0 - t) + b * t) * sin);
        let next = if next > low && next < high { next } else { 0.5 * (low + high) };
        let step = (next - t).abs();
        t = next;
        // What remains is of the order of the square.
        if step < 1e-4 {
            break;
        }
    }
    t
}

/// Samples x in [0, 1] with a density proportional to a (1−x) + b x.
fn sample_linear(a: f32, b: f32, u: f32) -> f32 {
    if a + b <= 0.0 {
        return u;
    }
    // Scaled, so that squares neither overflow nor vanish.
    let (a, b) = (a / (a + b), b / (a + b));
    let denominator = a + (a * a + (b * b - a * a) * u).max(0.0).sqrt();
    if denominator > 0.0 { (u / denominator).min(1.0) } else { 0.0 }
}
