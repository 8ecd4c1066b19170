//! Pictures for the page: what was rendered, and where it is wrong.

use super::reference::Reference;
use caustica::Result;
use caustica::image_io::{Image, write_png};
use caustica::math::Rgb;
use caustica::{image_io, metrics};
use plotters::style::{RGBColor, colors::colormaps::*};
use std::path::Path;

/// Signed relative error that is shown in full colour.
pub(super) const FULL_ERROR: f32 = 0.2;

/// File names of a method's pictures, in `images/`.
pub(super) fn names(slug: &str) -> [String; 3] {
    [format!("{slug}.png"), format!("{slug}-flip.png"), format!("{slug}-error.png")]
}

/// Writes the picture, HDR-FLIP (dark violet 0, yellow 1), and the relative error (blue too dark, red too bright).
pub(super) fn write(dir: &Path, slug: &str, image: &Image, reference: &Reference) -> Result<()> {
    let [picture, flip, error] = names(slug).map(|name| dir.join(name));
    write_png(&picture, image, exposure(&reference.image))?;
    let errors = metrics::hdr_flip_map(image, &reference.image);
    let colors = errors.iter().map(|&e| linear(ViridisRGB.get_color(or_worst(e))));
    write_png(&flip, &Image { pixels: colors.collect(), ..*image }, 0.0)?;
    let map = DerivedColorMap::new(&[RGBColor(5, 48, 150), RGBColor(247, 247, 247), RGBColor(150, 10, 20)]);
    let colors = image.pixels.iter().zip(&reference.image.pixels).map(|(x, r)| {
        let relative = (*x - *r) / (*r * *r + 0.01).map(f32::sqrt);
        let mean = relative.element_sum() / 3.0;
        linear(map.get_color(or_worst(0.5 + 0.5 * mean / FULL_ERROR).clamp(0.0, 1.0)))
    });
    write_png(&error, &Image { pixels: colors.collect(), ..*image }, 0.0)
}

/// A broken pixel is as wrong as can be.
fn or_worst(error: f32) -> f32 {
    if error.is_nan() { 1.0 } else { error }
}

fn linear(RGBColor(r, g, b): RGBColor) -> Rgb {
    Rgb::from_array([r, g, b].map(|c| image_io::srgb_to_linear(c as f32 / 255.0)))
}

/// In stops, such that nineteen pixels of twenty stay below white.
pub(super) fn exposure(image: &Image) -> f32 {
    let mut peaks: Vec<f32> = image.pixels.iter().map(|p| p.max_element()).collect();
    peaks.sort_by(f32::total_cmp);
    let bright = peaks[(peaks.len() * 19 / 20).min(peaks.len() - 1)];
    if bright.is_finite() && bright > 0.0 { (0.9 / bright).log2() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_colours() {
        let dir = tempfile::tempdir().unwrap();
        let image = |values: [f32; 4]| Image { width: 4, height: 1, pixels: values.map(Rgb::splat).into() };
        let reference = Reference { image: image([1.0; 4]), relmse: 0.0, origin: String::new() };
        write(dir.path(), "a", &image([1.0, 2.0, 0.1, f32::NAN]), &reference).unwrap();
        let [_, flip, error] = names("a").map(|name| image_io::read(&dir.path().join(name)).unwrap());
        let [same, bright, dark, broken] = error.pixels[..] else { panic!() };
        assert!(same.min_element() > 0.9);
        assert!(bright.x > 2.0 * bright.z && dark.z > 2.0 * dark.x);
        assert_eq!(broken, bright);
        assert!(flip.pixels.iter().all(|p| p.is_finite()));
    }
}
