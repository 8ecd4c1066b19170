//! The watertight ray/triangle test of Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection": no ray slips
//! through the edge or vertex that triangles share. Eight triangles at a time.

use super::simd::{Lanes, Simd};
use crate::accel::plane_distance;
use crate::math::Ray;
use crate::shape::Hit;
use glam::Vec3;

/// Up to eight triangles.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub(super) struct Packet {
    /// By vertex and axis. NaN in empty lanes.
    vertices: [[Lanes<f32>; 3]; 3],
    shapes: Lanes<u32>,
    primitives: Lanes<u32>,
}

impl Packet {
    pub(super) const SIZE: usize = 8;
    pub(super) const EMPTY: Packet =
        Packet { vertices: [[[f32::NAN; 8]; 3]; 3], shapes: [0; 8], primitives: [0; 8] };

    pub(super) fn set(&mut self, lane: usize, vertices: [Vec3; 3], shape: u32, primitive: u32) {
        for (to, from) in self.vertices.iter_mut().zip(vertices) {
            for axis in 0..3 {
                to[axis][lane] = from[axis];
            }
        }
        (self.shapes[lane], self.primitives[lane]) = (shape, primitive);
    }

    fn triangle(&self, lane: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|i| Vec3::from_array(self.vertices[i].map(|axis| axis[lane])))
    }

    pub(super) fn hit(&self, found: &Found) -> Hit {
        let Found { t, u, v, lane } = *found;
        Hit { t, u, v, shape: self.shapes[lane], primitive: self.primitives[lane] }
    }
}

/// A hit with one of a packet's triangles.
pub(super) struct Found {
    pub(super) t: f32,
    pub(super) u: f32,
    pub(super) v: f32,
    pub(super) lane: usize,
}

/// A ray prepared for the test: the shear and permutation that make it the unit vector z.
pub(super) struct Shear<S: Simd> {
    o: [S::F; 3],
    /// The ray's longest dimension last.
    axes: [usize; 3],
    s: [S::F; 3],
}

impl<S: Simd> Shear<S> {
    #[inline(always)]
    pub(super) fn new(s: S, ray: &Ray) -> Shear<S> {
        let z = ray.d.abs().max_position();
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][z];
        let [x, y, z] = axes.map(|axis| ray.d[axis]);
        // Finite, so that nothing below is NaN.
        let inverse = (1.0 / z).clamp(f32::MIN, f32::MAX);
        Shear {
            o: axes.map(|axis| s.splat(ray.o[axis])),
            axes,
            s: [s.splat(x / z), s.splat(y / z), s.splat(inverse)],
        }
    }

    /// The nearest hit within the ray's range, or with `ANY` the first found. `t_max` is the ray's, in all lanes and
    /// with slack.
    #[inline(always)]
    pub(super) fn intersect<const ANY: bool>(
        &self,
        s: S,
        packet: &Packet,
        ray: &mut Ray,
        t_max: S::F,
    ) -> Option<Found> {
        let at = |vertex: usize, axis: usize| {
            s.sub(s.load(&packet.vertices[vertex][self.axes[axis]]), self.o[axis])
        };
        let z = [at(0, 2), at(1, 2), at(2, 2)];
        let x = [0, 1, 2].map(|i| s.sub(at(i, 0), s.mul(self.s[0], z[i])));
        let y = [0, 1, 2].map(|i| s.sub(at(i, 1), s.mul(self.s[1], z[i])));
        let edge = |i: usize, j: usize| s.sub(s.mul(x[i], y[j]), s.mul(y[i], x[j]));
        let (u, v, w) = (edge(2, 1), edge(0, 2), edge(1, 0));
        // Of one sign, zeros apart. In this order NaN, of overflow, is of either sign.
        let zero = s.splat(0.0);
        let least = s.min(u, s.min(v, s.min(w, s.splat(f32::INFINITY))));
        let most = s.max(u, s.max(v, s.max(w, s.splat(f32::NEG_INFINITY))));
        let inside = s.at_most(zero, least) | s.at_most(most, zero);
        let depths = z.map(|z| s.mul(z, self.s[2]));
        let nearest = s.min(depths[0], s.min(depths[1], depths[2]));
        let mut mask = inside & s.at_most(nearest, t_max);
        if mask == 0 {
            return None;
        }
        let (x, y) = (x.map(|x| s.store(x)), y.map(|y| s.store(y)));
        let (u, v, w) = (s.store(u), s.store(v), s.store(w));
        let mut found = None;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let (mut u, mut v, mut w) = (u[lane] as f64, v[lane] as f64, w[lane] as f64);
            if u == 0.0 || v == 0.0 || w == 0.0 || !(u + v + w).is_finite() {
                // Which side of an edge only f64 can tell, where the products are exact and do not overflow.
                let (x, y) = (x.map(|x| x[lane] as f64), y.map(|y| y[lane] as f64));
                let edge = |i: usize, j: usize| x[i] * y[j] - y[i] * x[j];
                (u, v, w) = (edge(2, 1), edge(0, 2), edge(1, 0));
                let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
                if !inside {
                    continue;
                }
            }
            let t = plane_distance(&packet.triangle(lane), ray);
            // False for NaN as well: triangles of no area, or seen edge-on.
            if t > ray.t_min && t < ray.t_max {
                let inverse = 1.0 / (u + v + w);
                ray.t_max = t;
                found = Some(Found { t, u: (v * inverse) as f32, v: (w * inverse) as f32, lane });
                if ANY {
                    break;
                }
            }
        }
        found
    }
}
