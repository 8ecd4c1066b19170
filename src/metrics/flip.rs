//! FLIP: how large the differences are that a viewer sees who flips between two images.
//!
//! * LDR-FLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild 2020, "FLIP: A Difference
//!   Evaluator for Alternating Images".
//! * HDR-FLIP: Andersson, Nilsson, Shirley and Akenine-Möller 2021, "Visualizing Errors in Rendered High Dynamic
//!   Range Images".
//!
//! Written from the papers; section numbers are those of the 2020 paper.

use crate::image_io::{Image, srgb_to_linear};
use crate::math::Rgb;
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;

/// The papers' viewer: 0.7 m away from a monitor 0.7 m wide with 3840 pixels, which is 67 pixels per degree.
const PIXELS_PER_DEGREE: f32 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Mean LDR-FLIP, in [0, 1], of sRGB-encoded images of equal size (values are clipped to [0, 1]). NaN if a value is
/// not finite.
pub fn ldr_flip(image: &Image, reference: &Image) -> f64 {
    let linear = |p: Rgb| p.clamp(Vec3::ZERO, Vec3::ONE).to_array().map(srgb_to_linear).into();
    if !is_finite(image) || !is_finite(reference) {
        return f64::NAN;
    }
    mean(&error_map(&map(image, linear), &map(reference, linear)))
}

/// Mean HDR-FLIP, in [0, 1], of linear images of equal size: at each pixel the largest LDR-FLIP over a range of
/// exposures that follows from the reference, tone-mapped as ACES does. No exposure has to be chosen, and errors in
/// highlights count as well as those in shadows. NaN if a value is not finite; negative values count as black.
pub fn hdr_flip(image: &Image, reference: &Image) -> f64 {
    mean(&hdr_flip_map(image, reference))
}

/// HDR-FLIP at every pixel, row by row; all NaN if a value is not finite. See [`hdr_flip`].
pub fn hdr_flip_map(image: &Image, reference: &Image) -> Vec<f32> {
    if !is_finite(image) || !is_finite(reference) {
        return vec![f32::NAN; reference.pixels.len()];
    }
    let mut worst = vec![0.0_f32; reference.pixels.len()];
    for exposure in exposures(reference) {
        let show = |p: Rgb| aces(p.max(Vec3::ZERO) * exposure.exp2());
        let errors = error_map(&map(image, show), &map(reference, show));
        worst.iter_mut().zip(errors).for_each(|(w, e)| *w = w.max(e));
    }
    worst
}

fn is_finite(image: &Image) -> bool {
    image.pixels.iter().all(|p| p.is_finite())
}

fn mean(errors: &[f32]) -> f64 {
    errors.iter().map(|&e| e as f64).sum::<f64>() / errors.len() as f64
}

fn map(image: &Image, f: impl Fn(Rgb) -> Rgb + Sync) -> Image {
    Image {
        width: image.width,
        height: image.height,
        pixels: image.pixels.par_iter().map(|&p| f(p)).collect(),
    }
}

/// The ACES film curve as fitted by Narkowicz 2016, with the exposure factor 0.6 folded in: numerator and
/// denominator, by falling power of x.
const ACES: [f32; 6] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

fn aces(x: Rgb) -> Rgb {
    let [a, b, c, d, e, f] = ACES;
    // Far beyond white, where x² would overflow.
    let x = x.min(Vec3::splat(1e9));
    ((x * x * a + x * b + c) / (x * x * d + x * e + f)).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Andersson et al. 2021, Sec. 4: from the exposure that maps the brightest pixel to 85 % of white to the one that
/// does so to the median, in steps of about one stop.
fn exposures(reference: &Image) -> Vec<f32> {
    let mut luminance: Vec<f32> =
        reference.pixels.iter().map(|p| p.max(Vec3::ZERO).dot(Vec3::new(0.2126, 0.7152, 0.0722))).collect();
    luminance.sort_unstable_by(f32::total_cmp);
    let largest = luminance.last().copied().unwrap_or(0.0);
    let mut median = luminance.get(luminance.len() / 2).copied().unwrap_or(0.0);
    if median == 0.0 {
        // More than half is black: the paper's exposure would be infinite. Take the median of the rest.
        let lit = &luminance[luminance.partition_point(|&y| y == 0.0)..];
        median = lit.get(lit.len() / 2).copied().unwrap_or(0.0);
    }
    if largest == 0.0 {
        return vec![0.0];
    }
    let [a, b, c, d, e, f] = ACES.map(f64::from);
    let (p, q, r) = (0.85 * d - a, 0.85 * e - b, 0.85 * f - c);
    let white = (-q - (q * q - 4.0 * p * r).sqrt()) / (2.0 * p);
    let (start, stop) = ((white / largest as f64).log2(), (white / median as f64).log2());
    let count = (stop - start).ceil().max(2.0);
    (0..count as usize).map(|i| (start + (stop - start) * i as f64 / (count - 1.0)) as f32).collect()
}

// Linear sRGB to XYZ and back (IEC 61966-2-1, D65).
const TO_XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(0.412_390_8, 0.212_639, 0.019_330_8),
    Vec3::new(0.357_584_33, 0.715_168_7, 0.119_194_78),
    Vec3::new(0.180_480_8, 0.072_192_32, 0.950_532_15),
);

/// XYZ relative to white.
fn to_xyz(rgb: Rgb) -> Vec3 {
    (TO_XYZ * rgb) / (TO_XYZ * Vec3::ONE)
}

/// The opponent space YCxCz (Sec. 4.1).
fn to_ycxcz(rgb: Rgb) -> Vec3 {
    let v = to_xyz(rgb);
    Vec3::new(116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z))
}

fn from_ycxcz(c: Vec3, from_xyz: &Mat3) -> Rgb {
    let y = (c.x + 16.0) / 116.0;
    *from_xyz * (Vec3::new(c.y / 500.0 + y, y, y - c.z / 200.0) * (TO_XYZ * Vec3::ONE))
}

/// CIELAB with the Hunt effect: colours of dark pixels count less (Sec. 4.1).
fn to_hunt_lab(rgb: Rgb) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let f = |t: f32| {
        if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [x, y, z] = to_xyz(rgb).to_array().map(f);
    let l = 116.0 * y - 16.0;
    Vec3::new(l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z))
}

fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// FLIP at every pixel, of linear images in [0, 1].
fn error_map(image: &Image, reference: &Image) -> Vec<f32> {
    let (colors, features) = (Color::new(), Features::new());
    let (xc, rc) = (colors.filter(image), colors.filter(reference));
    let (xf, rf) = (features.filter(image), features.filter(reference));
    (0..rc.len())
        .into_par_iter()
        .map(|i| {
            let color = colors.redistribute(hyab(xc[i], rc[i]));
            // Sec. 4.2.2, with q_f = 0.5.
            let feature = (xf[i].0 - rf[i].0).abs().max((xf[i].1 - rf[i].1).abs());
            let feature = (feature * std::f32::consts::FRAC_1_SQRT_2).min(1.0).sqrt();
            if color == 0.0 { 0.0 } else { color.powf(1.0 - feature) }
        })
        .collect()
}

/// The colour pipeline (Sec. 4.1).
struct Color {
    /// For each channel of YCxCz the Gaussians of its contrast sensitivity function, with their weights.
    csf: [Vec<(f32, Vec<f32>)>; 3],
    from_xyz: Mat3,
    largest: f32,
}

impl Color {
    fn new() -> Color {
        // (a, b) of Table 1.
        let table: [&[(f32, f32)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
        let csf = table.map(|gaussians| {
            let mut parts: Vec<(f32, Vec<f32>)> = gaussians
                .iter()
                .map(|&(a, b)| {
                    let g = |i: i32| (-(PI * i as f32 / PIXELS_PER_DEGREE).powi(2) / b).exp();
                    let taps: Vec<f32> = (-radius..=radius).map(g).collect();
                    let sum: f32 = taps.iter().sum();
                    (a * (PI / b).sqrt() * sum * sum, taps.iter().map(|t| t / sum).collect())
                })
                .collect();
            let total: f32 = parts.iter().map(|p| p.0).sum();
            parts.iter_mut().for_each(|p| p.0 /= total);
            parts
        });
        let largest = hyab(to_hunt_lab(Vec3::Y), to_hunt_lab(Vec3::Z)).powf(0.7);
        Color { csf, from_xyz: TO_XYZ.inverse(), largest }
    }

    /// What the eye resolves at the viewing distance, in Hunt-adjusted CIELAB.
    fn filter(&self, image: &Image) -> Vec<Vec3> {
        let (w, h) = (image.width, image.height);
        let opponent: Vec<Vec3> = image.pixels.par_iter().map(|&p| to_ycxcz(p)).collect();
        let mut seen = vec![Vec3::ZERO; opponent.len()];
        for (c, gaussians) in self.csf.iter().enumerate() {
            let plane: Vec<f32> = opponent.iter().map(|p| p[c]).collect();
            for (weight, taps) in gaussians {
                let blurred = columns(&rows(&plane, w, taps), w, h, taps);
                seen.iter_mut().zip(blurred).for_each(|(s, b)| s[c] += weight * b);
            }
        }
        seen.par_iter()
            .map(|&s| to_hunt_lab(from_ycxcz(s, &self.from_xyz).clamp(Vec3::ZERO, Vec3::ONE)))
            .collect()
    }

    /// Compresses large differences, and scales to [0, 1] (Sec. 4.1.4): q_c = 0.7, p_c = 0.4, p_t = 0.95.
    fn redistribute(&self, difference: f32) -> f32 {
        let (e, knee) = (difference.powf(0.7), 0.4 * self.largest);
        let scaled =
            if e < knee { 0.95 / knee * e } else { 0.95 + (e - knee) / (self.largest - knee) * (1.0 - 0.95) };
        scaled.min(1.0)
    }
}

/// The feature pipeline: edges and points in luminance (Sec. 4.2).
struct Features {
    gauss: Vec<f32>,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Features {
    fn new() -> Features {
        // Half the width of 0.082° is the standard deviation.
        let sigma = 0.5 * 0.082 * PIXELS_PER_DEGREE;
        let radius = (3.0 * sigma).ceil() as i32;
        let kernel = |f: &dyn Fn(f32) -> f32| -> Vec<f32> {
            (-radius..=radius).map(|i| i as f32 / sigma).map(|x| f(x) * (-0.5 * x * x).exp()).collect()
        };
        // Derivatives are scaled such that positive and negative weights each sum to one.
        let normalise = |taps: Vec<f32>| -> Vec<f32> {
            let positive: f32 = taps.iter().filter(|t| **t > 0.0).sum();
            let negative: f32 = -taps.iter().filter(|t| **t < 0.0).sum::<f32>();
            taps.into_iter()
                .map(|t| if t > 0.0 { t / positive } else { t / negative.max(f32::MIN_POSITIVE) })
                .collect()
        };
        Features {
            gauss: normalise(kernel(&|_| 1.0)),
            first: normalise(kernel(&|x| -x)),
            second: normalise(kernel(&|x| x * x - 1.0)),
        }
    }

    /// (edge, point) strength at every pixel.
    fn filter(&self, image: &Image) -> Vec<(f32, f32)> {
        let (w, h) = (image.width, image.height);
        let luminance: Vec<f32> = image.pixels.par_iter().map(|&p| to_xyz(p).y).collect();
        let smooth = rows(&luminance, w, &self.gauss);
        let edge_x = columns(&rows(&luminance, w, &self.first), w, h, &self.gauss);
        let edge_y = columns(&smooth, w, h, &self.first);
        let point_x = columns(&rows(&luminance, w, &self.second), w, h, &self.gauss);
        let point_y = columns(&smooth, w, h, &self.second);
        (0..luminance.len()).map(|i| (edge_x[i].hypot(edge_y[i]), point_x[i].hypot(point_y[i]))).collect()
    }
}

/// Convolves each row with `taps` (odd in number); pixels beyond the border repeat it.
fn rows(plane: &[f32], width: usize, taps: &[f32]) -> Vec<f32> {
    let radius = taps.len() / 2;
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.resize(width + 2 * radius, row[width - 1]);
        for (x, o) in out.iter_mut().enumerate() {
            *o = padded[x..].iter().zip(taps).map(|(p, t)| p * t).sum();
        }
    });
    out
}

/// Convolves each column with `taps`, likewise.
fn columns(plane: &[f32], width: usize, height: usize, taps: &[f32]) -> Vec<f32> {
    let radius = taps.len() / 2;
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (i, t) in taps.iter().enumerate() {
            let from = (y + i).saturating_sub(radius).min(height - 1);
            let row = &plane[from * width..(from + 1) * width];
            out.iter_mut().zip(row).for_each(|(o, p)| *o += p * t);
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: usize, height: usize, f: impl Fn(f64, f64) -> [f64; 3]) -> Image {
        let pixel = |i: usize| {
            let p = f((i % width) as f64, (i / width) as f64);
            Rgb::from_array(p.map(|v| v as f32))
        };
        Image { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    /// Waves and a checkerboard.
    fn pattern(k: f64) -> Image {
        image(48, 40, |x, y| {
            let squares = (x / 4.0).floor() + (y / (3.0 + k)).floor();
            [
                0.5 + 0.5 * (0.37 * x + 0.11 * y * k + k).sin(),
                0.5 + 0.5 * (0.05 * x * k + 0.23 * y + 1.0).sin(),
                (squares % 2.0) * 0.8 + 0.1,
            ]
        })
    }

    fn blend(a: &Image, b: &Image, t: f32) -> Image {
        let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| (1.0 - t) * *a + t * *b).collect();
        Image { pixels, ..*a }
    }

    fn bright(a: &Image) -> Image {
        map(a, |p| p * p * p * p * 30.0)
    }

    #[track_caller]
    fn agree(ours: f64, theirs: f64) {
        assert!((ours - theirs).abs() < 2e-4 * theirs.max(0.05), "{ours} instead of {theirs}");
    }

    /// Numbers from the authors' own implementation, flip-evaluator 1.7 (Python package).
    #[test]
    fn agrees_with_the_authors_program() {
        let (a, b) = (pattern(0.0), pattern(1.0));
        let near = blend(&a, &b, 0.1);
        agree(ldr_flip(&b, &a), 0.861_866_95);
        agree(ldr_flip(&near, &a), 0.266_577_42);
        let mut spot = a.clone();
        for (x, y) in [(20, 20), (21, 20), (20, 21), (21, 21)] {
            spot.pixels[y * 48 + x] = Vec3::ZERO;
        }
        agree(ldr_flip(&spot, &a), 0.005_896_488);
        agree(hdr_flip(&bright(&b), &bright(&a)), 0.895_853_34);
        agree(hdr_flip(&bright(&a), &bright(&b)), 0.902_869_94);
        agree(hdr_flip(&bright(&near), &bright(&a)), 0.251_780_72);
        agree(hdr_flip(&bright(&spot), &bright(&a)), 0.006_459_088);
        agree(hdr_flip(&map(&bright(&a), |p| 1.2 * p), &bright(&a)), 0.173_479_38);
        let mut firefly = bright(&a);
        firefly.pixels[5 * 48 + 5] = Vec3::splat(3000.0);
        agree(hdr_flip(&bright(&near), &firefly), 0.300_913_72);
        agree(hdr_flip(&firefly, &bright(&a)), 0.003_102_916);
    }

    #[test]
    fn bounds_and_order() {
        let (black, white) = (image(9, 7, |_, _| [0.0; 3]), image(9, 7, |_, _| [1e6; 3]));
        let (a, b) = (bright(&pattern(0.0)), bright(&pattern(1.0)));
        assert_eq!(hdr_flip(&a, &a), 0.0);
        assert_eq!(hdr_flip(&black, &black), 0.0);
        for (x, r) in [(&black, &white), (&white, &black), (&a, &b)] {
            let e = hdr_flip(x, r);
            assert!(e > 0.0 && e <= 1.0, "{e}");
        }
        // Further away is worse; LDR-FLIP is symmetric.
        let errors = [0.02, 0.1, 0.4].map(|t| hdr_flip(&blend(&a, &b, t), &a));
        assert!(errors[0] < errors[1] && errors[1] < errors[2]);
        agree(ldr_flip(&pattern(1.0), &pattern(0.0)), ldr_flip(&pattern(0.0), &pattern(1.0)));
        let tiny = image(1, 1, |_, _| [0.3; 3]);
        assert_eq!(hdr_flip(&tiny, &tiny), 0.0);
        assert!(hdr_flip(&map(&tiny, |p| p / 0.0), &tiny).is_nan());
    }
}
