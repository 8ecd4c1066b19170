//! Unpolarised Fresnel reflectance.

use crate::math::Rgb;

/// Reflectance of a smooth dielectric interface, and the cosine of the refracted direction (0 under total internal
/// reflection). `cos_i` ≥ 0 is the incident cosine, `eta` the index of the far side over that of the near side.
#[inline]
pub fn dielectric(cos_i: f32, eta: f32) -> (f32, f32) {
    let cos_t2 = 1.0 - (1.0 - cos_i * cos_i) / (eta * eta);
    let cos_t = cos_t2.max(0.0).sqrt();
    if eta == 1.0 {
        return (0.0, cos_t);
    }
    if cos_i == 0.0 {
        return (1.0, cos_t);
    }
    let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let p = (cos_t - eta * cos_i) / (cos_t + eta * cos_i);
    (0.5 * (s * s + p * p), cos_t)
}

/// Reflectance of a smooth conductor with complex index `eta` + i·`k` (relative to the medium outside), per channel.
/// `eta` = 0, `k` = 1 is the perfect mirror.
#[inline]
pub fn conductor(cos_i: f32, eta: Rgb, k: Rgb) -> Rgb {
    // Born & Wolf, Principles of Optics, §14.2: a + ib = √(η² − sin²θ), solved for real arithmetic.
    let cos2 = cos_i * cos_i;
    let sin2 = 1.0 - cos2;
    let t = eta * eta - k * k - sin2;
    let a2_plus_b2 = (t * t + 4.0 * eta * eta * k * k).map(f32::sqrt);
    let a = (0.5 * (a2_plus_b2 + t)).max(Rgb::ZERO).map(f32::sqrt);
    let q = 2.0 * cos_i * a;
    let s = (a2_plus_b2 + cos2 - q) / (a2_plus_b2 + cos2 + q);
    let u = a2_plus_b2 * cos2 + sin2 * sin2;
    let p = s * (u - q * sin2) / (u + q * sin2);
    0.5 * (s + p)
}

/// Reflectance of a smooth dielectric interface to diffuse light: [`dielectric`] averaged over the cosine-weighted
/// hemisphere. Fits: Egan & Hilgeman 1973 for `eta` < 1, d'Eon & Irving 2011 else.
pub fn diffuse_reflectance(eta: f32) -> f32 {
    let r = 1.0 / eta;
    if eta < 1.0 {
        -1.4399 * eta * eta + 0.7099 * eta + 0.6681 + 0.0636 * r
    } else {
        let poly = -7.80989 + r * (4.98554 - r * 1.36881);
        0.919317 + r * (-3.4793 + r * (6.75335 + r * poly))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_incidence_and_total_reflection() {
        assert!((dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-6);
        assert_eq!(dielectric(0.3, 1.0 / 1.5), (1.0, 0.0));
        assert_eq!(dielectric(0.3, 1.0).0, 0.0);
        assert_eq!(dielectric(0.0, 1.5).0, 1.0);
        // ((η−1)² + k²) / ((η+1)² + k²)
        let f = conductor(1.0, Rgb::new(0.2, 1.1, 2.0), Rgb::new(3.9, 2.5, 0.0));
        let expected = Rgb::new(0.951_952, 0.587_242, 1.0 / 9.0);
        assert!((f - expected).abs().max_element() < 1e-5, "{f}");
    }

    #[test]
    fn conductor_without_absorption_is_a_dielectric() {
        for cos in [0.05, 0.3, 0.8, 1.0] {
            let f = conductor(cos, Rgb::splat(1.5), Rgb::ZERO).x;
            assert!((f - dielectric(cos, 1.5).0).abs() < 1e-5);
        }
    }

    #[test]
    fn no_material_is_a_perfect_mirror() {
        for cos in [0.0, 0.05, 0.3, 0.8, 1.0] {
            assert!((conductor(cos, Rgb::ZERO, Rgb::ONE) - Rgb::ONE).abs().max_element() < 1e-6);
        }
    }

    #[test]
    fn diffuse_fit_agrees_with_quadrature() {
        // The fits are stated to be within 1 % (of 1 − F for η < 1) in this range.
        for eta in [1.1f32, 1.3, 1.5, 1.9, 1.0 / 1.3, 1.0 / 1.5, 1.0 / 1.9] {
            let n = 2000;
            let cos = |i| (i as f32 + 0.5) / n as f32;
            let mean =
                (0..n).map(|i| (2.0 * cos(i) * dielectric(cos(i), eta).0) as f64).sum::<f64>() / n as f64;
            assert!((diffuse_reflectance(eta) as f64 - mean).abs() < 0.01, "{eta}");
        }
    }
}
