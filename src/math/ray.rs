//! Rays, and the one home of the self-intersection offset.

use glam::Vec3;

/// A ray; `d` is a unit vector wherever a pdf or a distance is taken from it. Laid out as two 16-byte stores, which
/// Embree's loads want.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Origin.
    pub o: Vec3,
    /// Hits at or before this distance do not count; not negative.
    pub t_min: f32,
    /// Direction.
    pub d: Vec3,
    /// Hits at or beyond this distance do not count.
    pub t_max: f32,
}

impl Ray {
    /// A ray without end.
    pub fn new(o: Vec3, d: Vec3) -> Self {
        Ray { o, t_min: 0.0, d, t_max: f32::INFINITY }
    }

    /// The point at distance `t`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.o + self.d * t
    }
}

/// Moves `p`, a point on a surface with geometric normal `n_g`, off it to the side into which `d` points, by a
/// distance that covers the rounding of hit points and of the backends' arithmetic. `magnitude` is the largest
/// absolute coordinate that took part in computing `p` (of the primitive's vertices and of `p` itself), so that the
/// offset scales with the scene and no absolute epsilon exists anywhere.
pub fn offset_origin(p: Vec3, n_g: Vec3, d: Vec3, magnitude: f32) -> Vec3 {
    // A hit point is good to about 3 half ulps of the largest coordinate, the origin moved off it to one more, and the
    // backends' translation of the vertices to the origin costs another. The rest is for Embree, whose plane distance
    // worsens with the ratio of a triangle's length to its height: measured, hits on the own triangle begin at a ratio
    // of 100 with 16 here, and of 230 with 32. Its backend checks ratios over 64 in f64 (`accel::tests` hold both).
    const ULPS: f32 = 32.0;
    let h = (magnitude * (ULPS * 0.5 * f32::EPSILON)).max(f32::MIN_POSITIVE);
    p + n_g * if d.dot(n_g) < 0.0 { -h } else { h }
}
