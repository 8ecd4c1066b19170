//! Maps from the unit square, each beside its pdf.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Uniform on the unit disk, concentric (Shirley & Chiu 1997). `pdf_a` = 1/π.
pub fn disk(u: Vec2) -> Vec2 {
    let p = 2.0 * u - Vec2::ONE;
    if p == Vec2::ZERO {
        return p;
    }
    let (r, phi) = if p.x.abs() > p.y.abs() {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else {
        (p.y, FRAC_PI_2 - FRAC_PI_4 * (p.x / p.y))
    };
    let (sin, cos) = phi.sin_cos();
    r * Vec2::new(cos, sin)
}

/// Cosine-weighted on the upper hemisphere (Malley).
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = disk(u);
    // A direction in the plane itself would have pdf 0: keep it a hair above.
    Vec3::new(p.x, p.y, (1.0 - p.length_squared()).max(1e-12).sqrt())
}

/// Pdf of [`cosine_hemisphere`].
pub fn cosine_hemisphere_pdf_w(w: Vec3) -> f32 {
    w.z.max(0.0) * FRAC_1_PI
}

/// Uniform on the unit sphere.
pub fn sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.y;
    let r = (4.0 * u.y * (1.0 - u.y)).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.x).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Pdf of [`sphere`].
pub const SPHERE_PDF_W: f32 = FRAC_1_PI / 4.0;

/// Uniform in the cone of directions around +z whose half-angle has 1 − cos = `one_minus_cos` (given as such,
/// because the cosine itself loses small cones to rounding).
pub fn cone(u: Vec2, one_minus_cos: f32) -> Vec3 {
    let h = u.y * one_minus_cos; // 1 − cosθ
    let r = (h * (2.0 - h)).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.x).sin_cos();
    Vec3::new(r * cos, r * sin, 1.0 - h)
}

/// Pdf of [`cone`].
pub fn cone_pdf_w(one_minus_cos: f32) -> f32 {
    1.0 / (2.0 * PI * one_minus_cos)
}

/// Barycentric weights of the second and third vertex, uniform on a triangle (Heitz 2019, "A Low-Distortion Map
/// Between Triangle and Square").
pub fn triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let x = 0.5 * u.x;
        Vec2::new(x, u.y - x)
    } else {
        let y = 0.5 * u.y;
        Vec2::new(u.x - y, y)
    }
}
