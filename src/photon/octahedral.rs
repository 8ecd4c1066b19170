//! Unit vectors in the octahedral parametrisation (Cigolle et al. 2014, "A Survey of Efficient Representations for
//! Independent Unit Vectors").

use glam::{Vec2, Vec3};

/// `v` mapped to the square [−1, 1]².
fn project(v: Vec3) -> Vec2 {
    let p = v.truncate() / (v.x.abs() + v.y.abs() + v.z.abs());
    if v.z >= 0.0 { p } else { (1.0 - Vec2::new(p.y, p.x).abs()) * sign(p) }
}

/// The inverse of [`project`].
fn unproject(p: Vec2) -> Vec3 {
    unfold(p, 1.0).normalize()
}

/// From the square [−one, one]² to the octahedron.
fn unfold(p: Vec2, one: f32) -> Vec3 {
    let z = one - p.x.abs() - p.y.abs();
    let xy = if z >= 0.0 { p } else { (one - Vec2::new(p.y, p.x).abs()) * sign(p) };
    xy.extend(z)
}

fn sign(p: Vec2) -> Vec2 {
    Vec2::new(1f32.copysign(p.x), 1f32.copysign(p.y))
}

/// In 32 bits: good to 6.5·10⁻⁵ rad.
pub(super) fn encode16(v: Vec3) -> [i16; 2] {
    (project(v) * 32767.0).round().to_array().map(|x| x as i16)
}

/// The inverse of [`encode16`].
pub(super) fn decode16(v: [i16; 2]) -> Vec3 {
    direction16(v).normalize()
}

/// The direction of [`decode16`], not normalised: its length lies between 0.57 and 1.
pub(super) fn direction16(v: [i16; 2]) -> Vec3 {
    unfold(Vec2::new(v[0] as f32, v[1] as f32) * (1.0 / 32767.0), 1.0)
}

/// In 16 bits: good to 1.7·10⁻² rad.
pub(super) fn encode8(v: Vec3) -> [i8; 2] {
    (project(v) * 127.0).round().to_array().map(|x| x as i8)
}

/// The inverse of [`encode8`].
pub(super) fn decode8(v: [i8; 2]) -> Vec3 {
    unproject(Vec2::new(v[0] as f32, v[1] as f32) / 127.0)
}

/// A unit vector that many packed ones are compared with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction {
    v: Vec3,
    packed: [i8; 2],
}

impl Direction {
    pub(super) fn new(v: Vec3) -> Direction {
        Direction { v, packed: encode8(v) }
    }

    /// Whether it makes an angle with the direction that [`encode8`] has packed whose cosine exceeds `cos`, a number between 0
    /// and 0.99. Needs neither division nor root, and on a plane no more than a comparison: every photon that a search comes
    /// by is asked.
    #[inline(always)]
    pub(super) fn agrees(&self, packed: [i8; 2], cos: f32) -> bool {
        if packed == self.packed {
            return true;
        }
        let v = unfold(Vec2::new(packed[0] as f32, packed[1] as f32), 127.0);
        let dot = v.dot(self.v);
        dot > 0.0 && dot * dot > cos * cos * v.length_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Sampler, Stream, warp};

    #[test]
    fn round_trips_within_the_stated_error() {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
        let random =
            (0..100_000).map(|i| warp::sphere(Sampler::new(1, Stream::Eye, 0, i).next_2d()).normalize());
        for v in axes.into_iter().chain(random) {
            assert!((decode16(encode16(v)) - v).length() < 6.5e-5, "{v}");
            assert!((decode8(encode8(v)) - v).length() < 1.7e-2, "{v}");
            assert!(Direction::new(v).agrees(encode8(v), 0.99));
            for n in axes {
                let cos = decode8(encode8(v)).dot(n);
                if (cos - 0.7).abs() > 1e-5 {
                    assert_eq!(Direction::new(n).agrees(encode8(v), 0.7), cos > 0.7, "{v} {n}");
                }
            }
        }
    }
}
