//! Distributions of microfacet normals, with Smith's separable shadowing and sampling of visible normals.
//!
//! Shadowing appears as σ(ω) = |cosθ| / G₁(ω), the projected area of the microfacets visible from ω (Heitz 2014,
//! "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs", Eq. 17). It is finite and positive up to
//! grazing directions, where cosine and G₁ both vanish.

use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

const SQRT_PI: f32 = 1.772_453_9;

/// The shape of the distribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// Gaussian slopes.
    Beckmann,
    /// Trowbridge–Reitz: long tails.
    Ggx,
}

/// A distribution of microfacet normals, stretched along the local x (u) and y (v) axes.
#[derive(Clone, Copy, Debug)]
pub struct Microfacet {
    distribution: Distribution,
    alpha: Vec2,
}

impl Microfacet {
    /// Roughness along u and v, at least 10⁻⁴ as in Mitsuba.
    pub fn new(distribution: Distribution, alpha_u: f32, alpha_v: f32) -> Self {
        Microfacet { distribution, alpha: Vec2::new(alpha_u, alpha_v).max(Vec2::splat(1e-4)) }
    }

    /// One number for the roughness: √(α_u α_v).
    pub fn roughness(&self) -> f32 {
        (self.alpha.x * self.alpha.y).sqrt()
    }

    /// D(m), per steradian, for m.z > 0 (Walter et al. 2007, Eqs. 25 and 33, anisotropic).
    #[inline]
    pub(super) fn d(&self, m: Vec3) -> f32 {
        let cos2 = m.z * m.z;
        let e = (m.truncate() / self.alpha).length_squared();
        let norm = PI * self.alpha.x * self.alpha.y;
        let d = match self.distribution {
            Distribution::Beckmann => (-e / cos2).exp() / (norm * cos2 * cos2),
            Distribution::Ggx => 1.0 / (norm * (e + cos2) * (e + cos2)),
        };
        // False for 0/0 at the horizon as well.
        if d * m.z > 1e-20 { d } else { 0.0 }
    }

    /// σ(w) for w.z > 0, with Mitsuba's G₁: for Beckmann, the rational fit of Walter et al. 2007 (0.35 %).
    #[inline]
    pub(super) fn visible_area(&self, w: Vec3) -> f32 {
        let s = (self.alpha * w.truncate()).length();
        match self.distribution {
            Distribution::Beckmann => {
                let a = w.z / s;
                if a < 1.6 { s * (1.0 + a * (2.276 + a * 2.577)) / (3.535 + a * 2.181) } else { w.z }
            }
            Distribution::Ggx => 0.5 * (w.z + (w.z * w.z + s * s).sqrt()),
        }
    }

    /// σ(w) for w.z > 0 without approximation. The pdf needs it: the fit would leave it unnormalised.
    #[inline]
    pub(super) fn visible_area_exact(&self, w: Vec3) -> f32 {
        match self.distribution {
            Distribution::Beckmann => {
                let s = (self.alpha * w.truncate()).length();
                let (erf, exp) = erf_exp(w.z / s);
                0.5 * (w.z * (1.0 + erf) + s * exp / SQRT_PI)
            }
            Distribution::Ggx => self.visible_area(w),
        }
    }

    /// Reflection by facets that reflect everything: f·cosθ_i for directions above the surface, `m` halfway.
    #[inline]
    pub(super) fn reflection(&self, wo: Vec3, wi: Vec3, m: Vec3) -> f32 {
        self.d(m) * wi.z / (4.0 * self.visible_area(wo) * self.visible_area(wi))
    }

    /// Pdf of `wi` when `m` is sampled by [`Microfacet::sample`] and reflects `wo`.
    #[inline]
    pub(super) fn reflection_pdf_w(&self, wo: Vec3, m: Vec3) -> f32 {
        self.d(m) / (4.0 * self.visible_area_exact(wo))
    }

    /// G₁(wi), and what Mitsuba's G₁(wo) makes of the exact one that cancels against the pdf: the weight of a sampled
    /// facet that scatters everything from `wo` to `wi`. Cosines are taken as positive.
    #[inline]
    pub(super) fn weight(&self, wo: Vec3, wi: Vec3) -> f32 {
        let g1 = wi.z / self.visible_area(wi);
        match self.distribution {
            Distribution::Beckmann => g1 * self.visible_area_exact(wo) / self.visible_area(wo),
            Distribution::Ggx => g1,
        }
    }

    /// Samples a normal with pdf D(m) cosθ_m, whether visible or not (Walter et al. 2007, Eqs. 28 and 35, anisotropic).
    pub(super) fn sample_all(&self, u: Vec2) -> Vec3 {
        let tan2 = match self.distribution {
            Distribution::Beckmann => -(1.0 - u.x).ln(),
            Distribution::Ggx => u.x / (1.0 - u.x),
        };
        let slope = self.alpha * Vec2::from_angle(TAU * u.y) * tan2.sqrt();
        slope.extend(1.0).normalize()
    }

    /// Samples a normal visible from `wo` (wo.z > 0) with pdf D(m) (wo·m) / σ(wo). If isotropic, u.y and 1 − u.y lie
    /// symmetrically to the plane of incidence.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let w = Vec3::new(self.alpha.x * wo.x, self.alpha.y * wo.y, wo.z).normalize();
        let m = match self.distribution {
            Distribution::Beckmann => sample_beckmann(w, u),
            Distribution::Ggx => sample_ggx(w, u),
        };
        Vec3::new(self.alpha.x * m.x, self.alpha.y * m.y, m.z).normalize()
    }
}

/// Visible normal (any length) of the unit GGX distribution: Dupuy & Benyoub 2023, "Sampling Visible GGX Normals with
/// Spherical Caps", Listing 3.
fn sample_ggx(w: Vec3, u: Vec2) -> Vec3 {
    // The cap's height is kept apart from w.z, which would cancel it where m nears the horizon.
    let height = (1.0 - u.x) * (1.0 + w.z);
    let r = ((1.0 + w.z - height) * (height + (1.0 - w.z))).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.y).sin_cos();
    Vec3::new(r * cos + w.x, r * sin + w.y, height)
}

/// Visible normal (any length) of the unit Beckmann distribution: Jakob 2014, "An Improved Visible Normal Sampling
/// Routine for the Beckmann Distribution".
fn sample_beckmann(w: Vec3, u: Vec2) -> Vec3 {
    // Slopes are unbounded: keep off the ends.
    let u = u.clamp(Vec2::splat(1e-6), Vec2::splat(1.0 - 1e-6));
    let sin = w.truncate().length();
    let (axis, cos) = if sin > 0.0 { (w.truncate() / sin, w.z.max(1e-6)) } else { (Vec2::X, 1.0) };
    let tan = sin / cos;

    // Solve for the slope s along `axis` in the variable x = erf(s), in which the unnormalised CDF
    // 1 + x + tanθ exp(−s²)/√π has the derivative 1 − s tanθ. It ends at s = cotθ.
    let (x_max, exp) = erf_exp(cos / sin);
    let target = u.x * (1.0 + x_max + tan * exp / SQRT_PI);
    let (mut lo, mut hi) = (-1.0, x_max);
    // Exact for θ = π/2.
    let mut x = x_max - (1.0 + x_max) * erf_exp((-u.x.ln()).sqrt()).0;
    let mut slope = erf_inv(x);
    for _ in 0..10 {
        let error = 1.0 + x + tan * (-slope * slope).exp() / SQRT_PI - target;
        if error > 0.0 {
            hi = x;
        } else {
            lo = x;
        }
        let newton = x - error / (1.0 - slope * tan);
        // Bisect also for NaN.
        let next = if newton >= lo && newton <= hi { newton } else { 0.5 * (lo + hi) };
        // Newton squares the error.
        let converged = (next - x).abs() <= 2e-3 * (1.0 + x);
        x = next;
        slope = erf_inv(x);
        if converged {
            break;
        }
    }
    let across = erf_inv(2.0 * u.y - 1.0);
    (-axis * slope - axis.perp() * across).extend(1.0)
}

/// erf(x) and exp(−x²) for x ≥ 0. Abramowitz & Stegun 1964, 7.1.26 (|error| < 1.5·10⁻⁷).
fn erf_exp(x: f32) -> (f32, f32) {
    let exp = (-x * x).exp();
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let poly = -0.284_496_72 + t * (1.421_413_8 + t * (-1.453_152 + t * 1.061_405_4));
    (1.0 - t * (0.254_829_6 + t * poly) * exp, exp)
}

/// erf⁻¹(x) for |x| < 1. Giles 2010, "Approximating the erfinv function" (single precision).
fn erf_inv(x: f32) -> f32 {
    let w = -((1.0 - x) * (1.0 + x)).max(1e-30).ln();
    const CENTRAL: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725e-3,
        -4.177_681_6e-3,
        0.246_640_73,
        1.501_409_4,
    ];
    const TAIL: [f32; 9] = [
        -2.002_142_6e-4,
        1.009_505_6e-4,
        1.349_343_2e-3,
        -3.673_428_4e-3,
        5.739_507_7e-3,
        -7.622_461_3e-3,
        9.438_870_5e-3,
        1.001_674,
        2.832_976_8,
    ];
    let (w, c) = if w < 5.0 { (w - 2.5, &CENTRAL) } else { (w.sqrt() - 3.0, &TAIL) };
    let upper = ((c[0] * w + c[1]) * w + c[2]) * w + c[3];
    let middle = (((upper * w + c[4]) * w + c[5]) * w + c[6]) * w + c[7];
    x * (middle * w + c[8])
}
