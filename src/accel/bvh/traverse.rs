//! The way of a ray through the tree: iterative, nearer children first, with a stack of fixed size.

#![allow(unsafe_code)]

use super::Bvh;
use super::build::MAX_DEPTH;
use super::huge::Huge;
use super::node::{Node, ORDER, Ref, Slabs};
use super::simd::{Lanes, Portable, Simd};
use super::triangle::{Packet, Shear};
use crate::math::Ray;
use crate::shape::Hit;
use std::mem::MaybeUninit;

/// A node leaves at most seven children behind on the way down, and eight lanes are written at a time.
const STACK: usize = 7 * MAX_DEPTH as usize + 8;

fn eight<T>(from: &mut [T; STACK], start: usize) -> &mut Lanes<T> {
    from[start..].first_chunk_mut().expect("the tree is no deeper than MAX_DEPTH")
}

/// A vector unit that traversal is compiled for.
pub(super) trait Trace: Simd {
    /// The nearest hit; with `ANY` the first one found.
    fn trace<const ANY: bool>(self, bvh: &Bvh, ray: &Ray) -> Option<Hit>;
}

impl Trace for Portable {
    fn trace<const ANY: bool>(self, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
        traverse::<_, ANY>(self, bvh, ray)
    }
}

#[inline(always)]
fn traverse<S: Trace, const ANY: bool>(s: S, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
    let (nodes, packets): (&Huge<Node>, &Huge<Packet>) = (&bvh.nodes, &bvh.packets);
    if !crate::accel::is_valid(ray) {
        return None;
    }
    let slabs = Slabs::new(s, ray);
    let shear = Shear::new(s, ray);
    let order = &ORDER[slabs.octant];
    let mut ray = *ray;
    let mut limit = ray.t_max * Slabs::<S>::SLACK;
    let mut t_max = s.splat(limit);
    let mut best = None;
    // Children still to visit and where the ray enters them, initialised below the height.
    let mut refs = [MaybeUninit::uninit(); STACK];
    let mut enters = [MaybeUninit::uninit(); STACK];
    let mut height = 0;
    let mut current = Ref::node(0);
    loop {
        if current.is_node() {
            let node = &nodes[current.index()];
            let (mask, enter) = slabs.enter(s, node, t_max);
            if mask != 0 {
                let order = order[mask as usize % 256];
                s.permute(&node.children, order, eight(&mut refs, height));
                if !ANY {
                    s.permute_floats(enter, order, eight(&mut enters, height));
                }
                // The nearest one, on top, is next.
                height += mask.count_ones() as usize - 1;
                current = Ref(node.children[(order >> 56) as usize % 8]);
                if mask & (mask - 1) != 0 {
                    // SAFETY: with two children or more, the top two were written just now.
                    let mut second = Ref(unsafe { refs[height - 1].assume_init() });
                    // The order is by octant: of the last two, measure.
                    // SAFETY: as above.
                    if !ANY && unsafe { enters[height - 1].assume_init() < enters[height].assume_init() } {
                        (current, second) = (second, current);
                        refs[height - 1].write(second.0);
                        enters[height - 1] = enters[height];
                    }
                    if second.is_packet() {
                        s.prefetch(&packets[second.index()]);
                    } else if second.is_node() {
                        s.prefetch(&nodes[second.index()]);
                    }
                }
                continue;
            }
        } else {
            // Not by a closure, which would not be inlined.
            #[allow(clippy::manual_map)]
            let hit = if current.is_packet() {
                let packet = &packets[current.index()];
                match shear.intersect::<ANY>(s, packet, &mut ray, t_max) {
                    Some(found) => Some(packet.hit(&found)),
                    None => None,
                }
            } else {
                bvh.single::<S, ANY>(s, current.index(), &ray)
            };
            if let Some(hit) = hit {
                ray.t_max = hit.t;
                best = Some(hit);
                if ANY {
                    break;
                }
                limit = ray.t_max * Slabs::<S>::SLACK;
                t_max = s.splat(limit);
            }
        }
        loop {
            if height == 0 {
                return best;
            }
            height -= 1;
            // SAFETY: initialised, as it lies below the height.
            let is_near = ANY || unsafe { enters[height].assume_init() } <= limit;
            if is_near {
                // SAFETY: as above.
                current = Ref(unsafe { refs[height].assume_init() });
                break;
            }
        }
    }
    best
}

/// Traversal compiled for AVX2.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::super::simd::Avx2;
    use super::{Bvh, Hit, Ray, Trace, traverse};

    impl Trace for Avx2 {
        fn trace<const ANY: bool>(self, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
            #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
            unsafe fn compiled<const ANY: bool>(avx2: Avx2, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
                traverse::<_, ANY>(avx2, bvh, ray)
            }
            // SAFETY: `self` proves that the CPU has the features.
            unsafe { compiled::<ANY>(self, bvh, ray) }
        }
    }
}
