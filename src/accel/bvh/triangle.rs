//! The watertight ray/triangle test of Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection": no ray slips
//! through the edge or vertex that triangles share. Eight triangles at a time.

use super::simd::{Lanes, Simd};
use crate::accel::plane_distance;
use crate::math::Ray;
use crate::shape::Hit;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Up to eight triangles.
#[derive(Clone, Copy, Pod, Zeroable)]
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

    /// Shapes and primitives of what is in the lanes.
    #[cfg(test)]
    pub(super) fn occupied(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..8)
            .filter(|&lane| !self.vertices[0][0][lane].is_nan())
            .map(|lane| (self.shapes[lane], self.primitives[lane]))
    }

    fn triangle(&self, lane: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|i| Vec3::from_array(self.vertices[i].map(|axis| axis[lane])))
    }

    #[inline(always)]
    pub(super) fn hit(&self, found: &Found) -> Hit {
        let Found { t, u, v, lane } = *found;
        Hit {
            t,
            u,
            v,
            shape: self.shapes[lane],
            primitive: self.primitives[lane],
            instance: Hit::NO_INSTANCE,
        }
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
        let (o, d) = (ray.o.to_array(), ray.d.to_array());
        let [x, y, z] = [d[axes[0]], d[axes[1]], d[axes[2]]];
        // Finite, so that nothing below is NaN.
        let inverse = (1.0 / z).clamp(f32::MIN, f32::MAX);
        Shear {
            o: [s.splat(o[axes[0]]), s.splat(o[axes[1]]), s.splat(o[axes[2]])],
            axes,
            s: [s.splat(x / z), s.splat(y / z), s.splat(inverse)],
        }
    }

    // Closures would not be inlined into what is compiled for AVX2, hence functions.

    #[inline(always)]
    fn shear(&self, s: S, vertices: &[Lanes<f32>; 3]) -> Sheared<S> {
        let x = s.sub(s.load(&vertices[self.axes[0]]), self.o[0]);
        let y = s.sub(s.load(&vertices[self.axes[1]]), self.o[1]);
        let z = s.sub(s.load(&vertices[self.axes[2]]), self.o[2]);
        Sheared {
            x: s.sub(x, s.mul(self.s[0], z)),
            y: s.sub(y, s.mul(self.s[1], z)),
            depth: s.mul(self.s[2], z),
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
        let a = self.shear(s, &packet.vertices[0]);
        let b = self.shear(s, &packet.vertices[1]);
        let c = self.shear(s, &packet.vertices[2]);
        let (u, v, w) = (edge(s, &c, &b), edge(s, &a, &c), edge(s, &b, &a));
        // Of one sign, zeros apart. In this order NaN, of overflow, is of either sign.
        let zero = s.splat(0.0);
        let least = s.min(u, s.min(v, s.min(w, s.splat(f32::INFINITY))));
        let most = s.max(u, s.max(v, s.max(w, s.splat(f32::NEG_INFINITY))));
        let inside = s.at_most(zero, least) | s.at_most(most, zero);
        let nearest = s.min(a.depth, s.min(b.depth, c.depth));
        let mut mask = inside & s.at_most(nearest, t_max);
        if mask == 0 {
            return None;
        }
        let x = [s.store(a.x), s.store(b.x), s.store(c.x)];
        let y = [s.store(a.y), s.store(b.y), s.store(c.y)];
        let (u, v, w) = (s.store(u), s.store(v), s.store(w));
        let mut found = None;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let (mut u, mut v, mut w) = (u[lane], v[lane], w[lane]);
            if u == 0.0 || v == 0.0 || w == 0.0 || !(u + v + w).is_finite() {
                match exact([0, 1, 2].map(|i| [x[i][lane], y[i][lane]])) {
                    Some(weights) => [u, v, w] = weights,
                    None => continue,
                }
            }
            let t = plane_distance(&packet.triangle(lane), ray);
            // False for NaN as well: triangles of no area, or seen edge-on.
            if t > ray.t_min && t < ray.t_max {
                let inverse = 1.0 / (u + v + w);
                ray.t_max = t;
                found = Some(Found { t, u: v * inverse, v: w * inverse, lane });
                if ANY {
                    break;
                }
            }
        }
        found
    }
}

/// Vertices seen along the ray.
struct Sheared<S: Simd> {
    x: S::F,
    y: S::F,
    /// Distance along the ray.
    depth: S::F,
}

/// Twice the signed area between the ray and two vertices.
#[inline(always)]
fn edge<S: Simd>(s: S, a: &Sheared<S>, b: &Sheared<S>) -> S::F {
    s.sub(s.mul(a.x, b.y), s.mul(a.y, b.x))
}

/// The weights of three vertices, up to a factor, if the ray passes between them. On which side of an edge it passes
/// only f64 can tell where f32 says 0 or overflows: the products are exact there.
#[cold]
fn exact([a, b, c]: [[f32; 2]; 3]) -> Option<[f32; 3]> {
    let edge = |a: [f32; 2], b: [f32; 2]| a[0] as f64 * b[1] as f64 - a[1] as f64 * b[0] as f64;
    let weights = [edge(c, b), edge(a, c), edge(b, a)];
    let inside = weights.iter().all(|&w| w >= 0.0) || weights.iter().all(|&w| w <= 0.0);
    let scale = weights.iter().fold(0.0, |max: f64, w| max.max(w.abs()));
    // All are 0 where the triangle looks like a line or a point.
    (inside && scale > 0.0).then(|| weights.map(|w| (w / scale) as f32))
}
