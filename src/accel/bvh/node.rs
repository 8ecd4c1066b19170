//! A node of eight children, the slab test of all of them, and the order in which a ray visits them.

use super::simd::{Lanes, Simd};
use crate::math::Ray;
use crate::shape::Bounds;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Where a child is: a node, a packet of triangles, or a single (a quadric or an instance), by its index below [`Ref::LIMIT`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ref(pub(super) u32);

impl Ref {
    pub(super) const LIMIT: usize = 1 << 30;
    const PACKET: u32 = 2 << 30;
    const SINGLE: u32 = 3 << 30;

    pub(super) fn node(index: usize) -> Ref {
        Ref(index as u32)
    }

    pub(super) fn packet(index: usize) -> Ref {
        Ref(index as u32 | Ref::PACKET)
    }

    pub(super) fn single(index: usize) -> Ref {
        Ref(index as u32 | Ref::SINGLE)
    }

    pub(super) fn is_node(self) -> bool {
        self.0 < Ref::PACKET
    }

    pub(super) fn is_packet(self) -> bool {
        (Ref::PACKET..Ref::SINGLE).contains(&self.0)
    }

    pub(super) fn index(self) -> usize {
        self.0 as usize % Ref::LIMIT
    }

    /// The same thing where `nodes` nodes and `packets` packets come before.
    pub(super) fn moved(self, nodes: usize, packets: usize) -> Ref {
        if self.is_node() {
            Ref(self.0 + nodes as u32)
        } else if self.is_packet() {
            Ref(self.0 + packets as u32)
        } else {
            self
        }
    }
}

/// Eight children and their bounds.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// For x, y and z the lower planes, then the upper ones.
    planes: [[Lanes<f32>; 2]; 3],
    /// As [`Ref`]s.
    pub(super) children: Lanes<u32>,
}

impl Node {
    /// Without children: nothing enters the slots.
    pub(super) const EMPTY: Node =
        Node { planes: [[[f32::INFINITY; 8], [f32::NEG_INFINITY; 8]]; 3], children: [0; 8] };

    pub(super) fn set(&mut self, slot: usize, bounds: Bounds, child: Ref) {
        for axis in 0..3 {
            self.planes[axis][0][slot] = bounds.min[axis];
            self.planes[axis][1][slot] = bounds.max[axis];
        }
        self.children[slot] = child.0;
    }

    /// What is in the slots.
    #[cfg(test)]
    pub(super) fn occupied(&self) -> impl Iterator<Item = Ref> + '_ {
        (0..8)
            .filter(|&slot| self.planes[0][0][slot] <= self.planes[0][1][slot])
            .map(|slot| Ref(self.children[slot]))
    }
}

/// The slots named by a mask in the order from far to near, one a byte, for every octant of directions; the nearest
/// one again in the last byte. Slot s is nearest to rays of octant s, and farthest from those of octant 7 - s, as in
/// Ylitie et al. 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 3.2.
pub(super) static ORDER: [[u64; 256]; 8] = {
    let mut table = [[0; 256]; 8];
    let mut octant = 0;
    while octant < 8 {
        let mut mask = 1;
        while mask < 256 {
            let (mut bytes, mut count, mut rank) = (0u64, 0, 8);
            while rank > 0 {
                rank -= 1;
                let slot = rank ^ octant;
                if mask >> slot & 1 == 1 {
                    // In place of a nearest one so far, in the last byte.
                    bytes = bytes & !(0xff << 56) | (slot as u64) << 56 | (slot as u64) << (8 * count);
                    count += 1;
                }
            }
            table[octant][mask] = bytes;
            mask += 1;
        }
        octant += 1;
    }
    table
};

/// A ray prepared for the slab test.
pub(super) struct Slabs<S: Simd> {
    o: [S::F; 3],
    inverse: [S::F; 3],
    inverse_far: [S::F; 3],
    t_min: S::F,
    /// 1 where the direction is negative, and the upper plane is the near one.
    near: [usize; 3],
    /// The near bits, x lowest.
    pub(super) octant: usize,
}

impl<S: Simd> Slabs<S> {
    /// Never misses a box with a hit inside (Ize 2013, "Robust BVH Ray Traversal"): the slab distances are each off by
    /// up to 3 half ulps, and the triangle test sees its vertices displaced by up to 4 (translation and shear), all
    /// relative to the slab distance: 2 · (3 + 4) half ulps, rounded up to 16.
    pub(super) const SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;

    #[inline(always)]
    pub(super) fn new(s: S, ray: &Ray) -> Slabs<S> {
        let inverse = ray.d.recip();
        let near = [(inverse.x < 0.0) as usize, (inverse.y < 0.0) as usize, (inverse.z < 0.0) as usize];
        Slabs {
            o: splat(s, ray.o),
            inverse: splat(s, inverse),
            inverse_far: splat(s, inverse * Self::SLACK),
            t_min: s.splat(ray.t_min),
            near,
            octant: near[0] | near[1] << 1 | near[2] << 2,
        }
    }

    /// Which children the ray enters before `t_max`, and where.
    #[inline(always)]
    pub(super) fn enter(&self, s: S, node: &Node, t_max: S::F) -> (u32, S::F) {
        let (mut enter, mut leave) = (self.t_min, t_max);
        for axis in 0..3 {
            let near = s.load(&node.planes[axis][self.near[axis]]);
            let far = s.load(&node.planes[axis][1 - self.near[axis]]);
            // In this order NaN, which comes from a ray within a slab's face (0 · ∞), is ignored.
            enter = s.max(s.mul(s.sub(near, self.o[axis]), self.inverse[axis]), enter);
            leave = s.min(s.mul(s.sub(far, self.o[axis]), self.inverse_far[axis]), leave);
        }
        (s.at_most(enter, leave), enter)
    }
}

#[inline(always)]
fn splat<S: Simd>(s: S, v: Vec3) -> [S::F; 3] {
    [s.splat(v.x), s.splat(v.y), s.splat(v.z)]
}
