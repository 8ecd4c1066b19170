//! Comparing images with a reference.
//!
//! All numbers but FLIP are taken from linear values over all pixels and channels, in double precision. A pixel that
//! is not finite makes every number NaN: such an image is broken, and no mean should hide it.

mod flip;

pub use flip::{hdr_flip, hdr_flip_map, ldr_flip};

use crate::image_io::Image;
use crate::{Error, Result};
use serde::Serialize;

/// How far an image is from its reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Root of the mean squared error, in units of radiance.
    pub rmse: f64,
    /// See [`relmse`].
    pub relmse: f64,
    /// Mean absolute error, in units of radiance.
    pub mae: f64,
    /// See [`bias`].
    pub bias: [f64; 3],
    /// See [`psnr`]; infinite for equal images.
    pub psnr: f64,
    /// See [`hdr_flip`].
    pub flip: f64,
}

/// Compares `image` with `reference` by every metric there is.
///
/// # Errors
/// [`Error::Usage`] if the images differ in size.
pub fn compare(image: &Image, reference: &Image) -> Result<Comparison> {
    if (image.width, image.height) != (reference.width, reference.height) {
        return Err(Error::Usage(format!(
            "the images differ in size ({}x{} and {}x{}); compare renders of the same size",
            image.width, image.height, reference.width, reference.height
        )));
    }
    Ok(Comparison {
        rmse: rmse(image, reference),
        relmse: relmse(image, reference),
        mae: mean(image, reference, |x, r| (x - r).abs()),
        bias: bias(image, reference),
        psnr: psnr(image, reference),
        flip: hdr_flip(image, reference),
    })
}

/// Root of the mean squared error of images of equal size.
pub fn rmse(image: &Image, reference: &Image) -> f64 {
    mean(image, reference, |x, r| (x - r) * (x - r)).sqrt()
}

/// Mean over pixels and channels of (x − ref)² / (ref² + 0.01), of images of equal size.
pub fn relmse(image: &Image, reference: &Image) -> f64 {
    mean(image, reference, |x, r| (x - r) * (x - r) / (r * r + 0.01))
}

/// Relative error of each channel's mean, mean(x) / mean(ref) − 1; 0 where both means are 0.
pub fn bias(image: &Image, reference: &Image) -> [f64; 3] {
    let (x, r) = (channel_means(image), channel_means(reference));
    std::array::from_fn(|c| if x[c] == r[c] { 0.0 } else { x[c] / r[c] - 1.0 })
}

/// Peak signal-to-noise ratio in dB, 20 log₁₀(peak / rmse), where peak is the largest value in the reference.
pub fn psnr(image: &Image, reference: &Image) -> f64 {
    let peak = reference.pixels.iter().map(|p| p.max_element()).fold(0.0, f32::max) as f64;
    let rmse = rmse(image, reference);
    if rmse == 0.0 { f64::INFINITY } else { 20.0 * (peak / rmse).log10() }
}

fn mean(image: &Image, reference: &Image, error: impl Fn(f64, f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for (x, r) in image.pixels.iter().zip(&reference.pixels) {
        for c in 0..3 {
            sum += error(x[c] as f64, r[c] as f64);
        }
    }
    sum / (3 * reference.pixels.len()) as f64
}

fn channel_means(image: &Image) -> [f64; 3] {
    let n = image.pixels.len() as f64;
    std::array::from_fn(|c| image.pixels.iter().map(|p| p[c] as f64).sum::<f64>() / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;

    fn image(pixels: &[[f32; 3]]) -> Image {
        Image { width: pixels.len(), height: 1, pixels: pixels.iter().map(|&p| Rgb::from_array(p)).collect() }
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-7 * b.abs().max(1.0)
    }

    #[test]
    fn by_hand() {
        let r = image(&[[1.0, 2.0, 0.0], [3.0, 2.0, 0.0]]);
        let x = image(&[[1.5, 2.0, 0.1], [3.0, 1.0, 0.1]]);
        // Squared errors 0.25, 0, 0.01; 0, 1, 0.01.
        let c = compare(&x, &r).unwrap();
        assert!(close(c.rmse, (1.27_f64 / 6.0).sqrt()));
        assert!(close(c.relmse, (0.25 / 1.01 + 1.0 + 1.0 / 4.01 + 1.0) / 6.0));
        assert!(close(c.mae, 1.7 / 6.0));
        assert!(close(c.bias[0], 4.5 / 4.0 - 1.0) && close(c.bias[1], -0.25) && c.bias[2].is_infinite());
        assert!(close(c.psnr, 10.0 * (9.0 / (1.27_f64 / 6.0)).log10()));
        assert!((0.0..=1.0).contains(&c.flip) && c.flip > 0.0);
    }

    #[test]
    fn equal_images() {
        for r in [image(&[[1.0, 0.0, 7.5]; 4]), image(&[[0.0; 3]])] {
            let c = compare(&r, &r).unwrap();
            assert_eq!((c.rmse, c.relmse, c.mae, c.bias, c.flip), (0.0, 0.0, 0.0, [0.0; 3], 0.0));
            assert_eq!(c.psnr, f64::INFINITY);
        }
    }

    #[test]
    fn broken_pixels_show() {
        let (good, bad) = (image(&[[1.0; 3]; 2]), image(&[[1.0; 3], [1.0, f32::NAN, 1.0]]));
        let c = compare(&bad, &good).unwrap();
        assert!(
            c.rmse.is_nan() && c.relmse.is_nan() && c.mae.is_nan() && c.bias[1].is_nan() && c.flip.is_nan()
        );
    }

    #[test]
    fn sizes_must_agree() {
        let (a, b) = (image(&[[1.0; 3]; 2]), image(&[[1.0; 3]]));
        assert_eq!(compare(&a, &b).unwrap_err().exit_code(), 2);
    }
}
