//! Orthonormal frames.

use glam::Vec3;

/// An orthonormal, right-handed basis whose z axis is `n`.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Local x.
    pub s: Vec3,
    /// Local y.
    pub t: Vec3,
    /// Local z, the normal.
    pub n: Vec3,
}

impl Frame {
    /// Any frame around the unit vector `n` (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    pub fn from_normal(n: Vec3) -> Self {
        let (s, t) = n.any_orthonormal_pair();
        Frame { s, t, n }
    }

    /// The frame around the unit vector `n` whose x axis lies in the plane of `n` and `s`; any if `s` is parallel
    /// to `n` or not finite.
    pub fn from_normal_and_tangent(n: Vec3, s: Vec3) -> Self {
        match (s - n * n.dot(s)).try_normalize() {
            Some(s) => Frame { s, t: n.cross(s), n },
            None => Frame::from_normal(n),
        }
    }

    /// World to local.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.s.dot(v), self.t.dot(v), self.n.dot(v))
    }

    /// Local to world.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}
