//! Spectra of scene files, and their conversion to linear sRGB as Mitsuba 3's RGB modes do it: integration over the
//! CIE 1931 curves, with illuminant D65 for reflectances and refractive indices and without for emission.

use crate::math::{Rgb, XYZ_TO_SRGB};
use glam::DVec3;

/// Wavelengths in nm at which the tables begin and end.
const LAMBDA_MIN: f64 = 360.0;
const LAMBDA_MAX: f64 = 830.0;
/// Sum of the tabulated ȳ times 5 nm, less half the ends: 1/∫ȳ, which makes Y = 1 of an equal-energy spectrum of value 1.
const Y_NORMALIZATION: f64 = 1.0 / 106.750_259_399_414_06;
/// Makes D65 give Y = 1.
const D65_NORMALIZATION: f64 = 1.0 / 98.997_417_518_762_55;

/// What a spectrum stands for: that decides its white point and its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// In 0..1; lit by D65.
    Reflectance,
    /// Refractive indices and the like: not negative.
    Unbounded,
    /// Radiance and the like.
    Emission,
}

/// A spectrum as a scene file gives it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Spectrum {
    /// The same at all wavelengths.
    Uniform(f64),
    /// (wavelength in nm, value), by increasing wavelength, linear in between and zero outside.
    Samples(Vec<(f64, f64)>),
}

impl Spectrum {
    /// From one number, or `λ:value` pairs.
    pub(super) fn parse(text: &str) -> Result<Spectrum, String> {
        let tokens: Vec<_> =
            text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty()).collect();
        if let [value] = tokens[..] {
            if !value.contains(':') {
                return Ok(Spectrum::Uniform(number(value)?));
            }
        }
        let pair = |token: &str| {
            let (wavelength, value) =
                token.split_once(':').ok_or_else(|| format!("'{token}' should be wavelength:value"))?;
            Ok((number(wavelength)?, number(value)?))
        };
        Spectrum::samples(tokens.into_iter().map(pair).collect::<Result<_, String>>()?)
    }

    /// From lines of wavelength and value; `#` starts a comment. The error names the line.
    pub(super) fn parse_file(text: &str) -> Result<Spectrum, (u32, String)> {
        let mut samples = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or("").trim();
            if line.is_empty() {
                continue;
            }
            let mut tokens = line.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty());
            let (Some(wavelength), Some(value)) = (tokens.next(), tokens.next()) else {
                return Err((i as u32 + 1, format!("'{line}' should be a wavelength and a value")));
            };
            let at_line = |message| (i as u32 + 1, message);
            samples.push((number(wavelength).map_err(at_line)?, number(value).map_err(at_line)?));
        }
        Spectrum::samples(samples).map_err(|message| (1, message))
    }

    /// Checks what every sampled spectrum must fulfil.
    pub(super) fn samples(samples: Vec<(f64, f64)>) -> Result<Spectrum, String> {
        if samples.len() < 2 {
            return Err("a sampled spectrum needs at least two wavelengths".into());
        }
        if samples.windows(2).any(|w| w[0].0 >= w[1].0) {
            return Err("the wavelengths of a spectrum must increase".into());
        }
        Ok(Spectrum::Samples(samples))
    }

    /// Planck's law in W·m⁻²·sr⁻¹·nm⁻¹, times `scale`.
    pub(super) fn blackbody(kelvin: f64, scale: f64) -> Result<Spectrum, String> {
        if kelvin <= 0.0 {
            return Err(format!("a temperature of {kelvin} K is not above zero"));
        }
        // CODATA 2014.
        const C: f64 = 2.997_924_58e8;
        const H: f64 = 6.626_070_04e-34;
        const K: f64 = 1.380_648_52e-23;
        let radiance = |nm: f64| {
            let m = nm * 1e-9;
            1e-9 * 2.0 * H * C * C / (m.powi(5) * ((H * C / (m * K * kelvin)).exp() - 1.0))
        };
        Spectrum::samples((360..=830).map(|nm| (nm as f64, scale * radiance(nm as f64))).collect())
    }

    /// Its linear sRGB colour, and whether that had to be clamped to the range of its role.
    pub(super) fn to_rgb(&self, role: Role) -> (Rgb, bool) {
        let rgb = match self {
            // An equal-energy emitter is not white in sRGB, whose white is D65.
            Spectrum::Uniform(v) if role == Role::Emission => *v * (XYZ_TO_SRGB * DVec3::ONE),
            Spectrum::Uniform(v) => return (Rgb::splat(*v as f32), false),
            Spectrum::Samples(samples) => XYZ_TO_SRGB * xyz(samples, role != Role::Emission),
        };
        let upper = if role == Role::Reflectance { 1.0 } else { f64::INFINITY };
        let clamped = rgb.clamp(DVec3::ZERO, DVec3::splat(upper));
        (clamped.as_vec3(), (clamped - rgb).abs().max_element() > 1e-4)
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| format!("'{text}' is not a number"))
}

fn interpolate(table: &[f64; 95], nm: f64) -> f64 {
    let x = (nm - LAMBDA_MIN) / 5.0;
    let i = (x as usize).min(93);
    table[i] + (x - i as f64) * (table[i + 1] - table[i])
}

/// CIE XYZ by Mitsuba's own quadrature: 1000 points that include both ends, each weighing a thousandth of the range.
fn xyz(samples: &[(f64, f64)], d65: bool) -> DVec3 {
    const STEPS: usize = 1000;
    let mut sum = DVec3::ZERO;
    for i in 0..STEPS {
        let nm = LAMBDA_MIN + i as f64 / (STEPS - 1) as f64 * (LAMBDA_MAX - LAMBDA_MIN);
        let after = samples.partition_point(|s| s.0 <= nm);
        let value = match (samples.get(after.wrapping_sub(1)), samples.get(after)) {
            (Some(a), Some(b)) => a.1 + (nm - a.0) / (b.0 - a.0) * (b.1 - a.1),
            (Some(a), None) if a.0 == nm => a.1,
            _ => continue,
        };
        let light = if d65 { interpolate(&D65, nm) * D65_NORMALIZATION } else { 1.0 };
        let cie = DVec3::new(interpolate(&CIE_X, nm), interpolate(&CIE_Y, nm), interpolate(&CIE_Z, nm));
        sum += cie * (value * light);
    }
    sum * ((LAMBDA_MAX - LAMBDA_MIN) / STEPS as f64 * Y_NORMALIZATION)
}

/// CIE 1931 2° standard observer from 360 to 830 nm in steps of 5 nm (CIE 15:2004, table T.4): x̄.
#[rustfmt::skip]
const CIE_X: [f64; 95] = [
    0.0001299, 0.0002321, 0.0004149, 0.0007416, 0.001368, 0.002236, 0.004243, 0.00765, 0.01431, 0.02319,
    0.04351, 0.07763, 0.13438, 0.21477, 0.2839, 0.3285, 0.34828, 0.34806, 0.3362, 0.3187, 0.2908, 0.2511,
    0.19536, 0.1421, 0.09564, 0.05795001, 0.03201, 0.0147, 0.0049, 0.0024, 0.0093, 0.0291, 0.06327, 0.1096,
    0.1655, 0.2257499, 0.2904, 0.3597, 0.4334499, 0.5120501, 0.5945, 0.6784, 0.7621, 0.8425, 0.9163,
    0.9786, 1.0263, 1.0567, 1.0622, 1.0456, 1.0026, 0.9384, 0.8544499, 0.7514, 0.6424, 0.5419, 0.4479,
    0.3608, 0.2835, 0.2187, 0.1649, 0.1212, 0.0874, 0.0636, 0.04677, 0.0329, 0.0227, 0.01584, 0.01135916,
    0.008110916, 0.005790346, 0.004109457, 0.002899327, 0.00204919, 0.001439971, 0.0009999493,
    0.0006900786, 0.0004760213, 0.0003323011, 0.0002348261, 0.0001661505, 0.000117413, 0.00008307527,
    0.00005870652, 0.00004150994, 0.00002935326, 0.00002067383, 0.00001455977, 0.00001025398,
    0.000007221456, 0.000005085868, 0.000003581652, 0.000002522525, 0.000001776509, 0.000001251141,
];

/// ȳ.
#[rustfmt::skip]
const CIE_Y: [f64; 95] = [
    0.000003917, 0.000006965, 0.00001239, 0.00002202, 0.000039, 0.000064, 0.00012, 0.000217, 0.000396,
    0.00064, 0.00121, 0.00218, 0.004, 0.0073, 0.0116, 0.01684, 0.023, 0.0298, 0.038, 0.048, 0.06, 0.0739,
    0.09098, 0.1126, 0.13902, 0.1693, 0.20802, 0.2586, 0.323, 0.4073, 0.503, 0.6082, 0.71, 0.7932, 0.862,
    0.9148501, 0.954, 0.9803, 0.9949501, 1.0, 0.995, 0.9786, 0.952, 0.9154, 0.87, 0.8163, 0.757, 0.6949,
    0.631, 0.5668, 0.503, 0.4412, 0.381, 0.321, 0.265, 0.217, 0.175, 0.1382, 0.107, 0.0816, 0.061, 0.04458,
    0.032, 0.0232, 0.017, 0.01192, 0.00821, 0.005723, 0.004102, 0.002929, 0.002091, 0.001484, 0.001047,
    0.00074, 0.00052, 0.0003611, 0.0002492, 0.0001719, 0.00012, 0.0000848, 0.00006, 0.0000424, 0.00003,
    0.0000212, 0.00001499, 0.0000106, 0.0000074657, 0.0000052578, 0.0000037029, 0.0000026078, 0.0000018366,
    0.0000012934, 0.00000091093, 0.00000064153, 0.00000045181,
];

/// z̄.
#[rustfmt::skip]
const CIE_Z: [f64; 95] = [
    0.0006061, 0.001086, 0.001946, 0.003486, 0.006450001, 0.01054999, 0.02005001, 0.03621, 0.06785001,
    0.1102, 0.2074, 0.3713, 0.6456, 1.0390501, 1.3856, 1.62296, 1.74706, 1.7826, 1.77211, 1.7441, 1.6692,
    1.5281, 1.28764, 1.0419, 0.8129501, 0.6162, 0.46518, 0.3533, 0.272, 0.2123, 0.1582, 0.1117, 0.07824999,
    0.05725001, 0.04216, 0.02984, 0.0203, 0.0134, 0.008749999, 0.005749999, 0.0039, 0.002749999, 0.0021,
    0.0018, 0.001650001, 0.0014, 0.0011, 0.001, 0.0008, 0.0006, 0.00034, 0.00024, 0.00019, 0.0001,
    0.00004999999, 0.00003, 0.00002, 0.00001, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0,
];

/// Standard illuminant D65 at the same wavelengths (CIE 15:2004, table T.1), 100 at 560 nm.
#[rustfmt::skip]
const D65: [f64; 95] = [
    46.6383, 49.3637, 52.0891, 51.0323, 49.9755, 52.3118, 54.6482, 68.7015, 82.7549, 87.1204, 91.486,
    92.4589, 93.4318, 90.057, 86.6823, 95.7736, 104.865, 110.936, 117.008, 117.41, 117.812, 116.336,
    114.861, 115.392, 115.923, 112.367, 108.811, 109.082, 109.354, 108.578, 107.802, 106.296, 104.79,
    106.239, 107.689, 106.047, 104.405, 104.225, 104.046, 102.023, 100.0, 98.1671, 96.3342, 96.0611,
    95.788, 92.2368, 88.6856, 89.3459, 90.0062, 89.8026, 89.5991, 88.6489, 87.6987, 85.4936, 83.2886,
    83.4939, 83.6992, 81.863, 80.0268, 80.1207, 80.2146, 81.2462, 82.2778, 80.281, 78.2842, 74.0027,
    69.7213, 70.6652, 71.6091, 72.979, 74.349, 67.9765, 61.604, 65.7448, 69.8856, 72.4863, 75.087, 69.3398,
    63.5927, 55.0054, 46.4182, 56.6118, 66.8054, 65.0941, 63.3828, 63.8434, 64.304, 61.8779, 59.4519,
    55.7054, 51.959, 54.6998, 57.4406, 58.8765, 60.3125,
];

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, role: Role, expected: [f32; 3]) {
        let (rgb, _) = Spectrum::parse(text).unwrap().to_rgb(role);
        let difference = (rgb - Rgb::from_array(expected)).abs().max_element();
        assert!(difference < 1e-4 * rgb.max_element().max(1.0), "{text}: {rgb} is not {expected:?}");
    }

    /// Expected values from Mitsuba 3.9.1, `scalar_rgb`.
    #[test]
    fn colours_are_those_of_mitsuba() {
        check(
            "400:0.78, 500:0.78, 600:0.78, 700:0.78",
            Role::Reflectance,
            [0.776_366_8, 0.779_81, 0.776_029_1],
        );
        check("400:0, 500:8, 600:15.6, 700:18.4", Role::Emission, [20.710_836, 10.854_634, 2.771_152]);
        check("5", Role::Emission, [6.023_97, 4.741_455, 4.544_58]);
        check("0.78", Role::Reflectance, [0.78; 3]);
        check("400:1.7 500:1.5 600:0.3 700:0.2", Role::Unbounded, [0.0, 1.005_244, 1.678_679]);
        check("400:0.1,700:0.9", Role::Reflectance, [0.742_852_8, 0.481_14, 0.208_324_6]);
        check("600:1, 700:1", Role::Reflectance, [0.841_137_7, 0.0, 0.0]);
    }

    #[test]
    fn clamping_is_told() {
        assert!(Spectrum::parse("600:1, 700:1").unwrap().to_rgb(Role::Reflectance).1);
        assert!(!Spectrum::parse("400:0.5, 700:0.5").unwrap().to_rgb(Role::Reflectance).1);
    }

    #[test]
    fn a_hotter_body_is_bluer() {
        let ratio = |kelvin| {
            let (rgb, _) = Spectrum::blackbody(kelvin, 1.0).unwrap().to_rgb(Role::Emission);
            rgb.z / rgb.x
        };
        assert!(ratio(3000.0) < 0.5 && ratio(10_000.0) > 1.0);
        // D65's correlated colour temperature is near white.
        assert!((ratio(6504.0) - 1.0).abs() < 0.1);
    }

    #[test]
    fn mistakes_are_refused() {
        for text in ["", "400", "400:x", "400:1", "500:1 400:1", "400:1 400:2", "nan", "400:1 500"] {
            if text != "400" {
                assert!(Spectrum::parse(text).is_err(), "{text}");
            }
        }
        assert_eq!(Spectrum::parse_file("# a\n400 1\n500\n").unwrap_err().0, 3);
        assert!(Spectrum::parse_file("400 1\n500 2 # b\n").is_ok());
        assert!(Spectrum::blackbody(0.0, 1.0).is_err());
    }
}
