//! Our own bounding volume hierarchy: eight-wide nodes over packets of eight triangles, tested by SIMD.

mod build;
mod huge;
mod node;
mod simd;
mod traverse;
mod triangle;

use super::Intersector;
use crate::Result;
use crate::math::Ray;
use crate::shape::{Bounds, Geometry, Hit, Mesh, Shape};
use build::Item;
use huge::Huge;
use node::{Node, Ref};
use rayon::prelude::*;
use simd::Portable;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use triangle::{Found, Packet};

/// A tree over all triangles and analytic shapes of a scene.
pub(super) struct Bvh {
    /// The root first.
    nodes: Huge<Node>,
    packets: Huge<Packet>,
    /// Beside the indices of their shapes.
    quadrics: Vec<(Shape, u32)>,
    #[cfg(target_arch = "x86_64")]
    avx2: Option<simd::Avx2>,
}

impl Bvh {
    /// Builds the tree; the meshes' indices must have been checked. What is not finite is left out.
    ///
    /// # Errors
    /// [`crate::Error::Runtime`] if there is not enough memory.
    pub(super) fn new(geometry: &Geometry) -> Result<Bvh> {
        let (mut items, mut quadrics, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
        let mut triangles = 0;
        let broken = AtomicBool::new(false);
        for (i, shape) in geometry.shapes.iter().enumerate() {
            if let Shape::Mesh(mesh) = shape {
                meshes.push((triangles, i as u32, mesh));
                let range = (0..mesh.triangles.len() as u32).into_par_iter();
                items.par_extend(range.map(|t| {
                    item(mesh, t, triangles + t).unwrap_or_else(|| {
                        broken.store(true, Relaxed);
                        Item::BROKEN
                    })
                }));
                triangles += mesh.triangles.len() as u32;
            } else {
                let bounds = shape.bounds();
                if bounds.min.is_finite() && bounds.max.is_finite() {
                    items.push(Item::quadric(bounds, quadrics.len() as u32));
                    quadrics.push((shape.clone(), i as u32));
                }
            }
        }
        if broken.into_inner() {
            items.retain(|item| !item.is_broken());
        }
        let tree = build::build(&mut items);
        let fill = |(packet, &(first, count)): (&mut Packet, &(u32, u32))| {
            *packet = Packet::EMPTY;
            for (lane, item) in items[first as usize..][..count as usize].iter().enumerate() {
                let index = item.index() as u32;
                let &(start, shape, mesh) = &meshes[meshes.partition_point(|m| m.0 <= index) - 1];
                packet.set(lane, mesh.vertices(index - start), shape, index - start);
            }
        };
        Ok(Bvh {
            nodes: Huge::new(tree.nodes.len(), |nodes| nodes.copy_from_slice(&tree.nodes))?,
            packets: Huge::new(tree.packets.len(), |packets: &mut [Packet]| {
                packets.par_iter_mut().zip(&tree.packets).for_each(fill);
            })?,
            quadrics,
            #[cfg(target_arch = "x86_64")]
            avx2: simd::Avx2::detect(),
        })
    }

    fn hit(&self, leaf: Ref, found: &Found) -> Hit {
        if leaf.is_packet() {
            self.packets[leaf.index()].hit(found)
        } else {
            let Found { t, u, v, .. } = *found;
            Hit { t, u, v, shape: self.quadrics[leaf.index()].1, primitive: 0 }
        }
    }
}

fn item(mesh: &Mesh, triangle: u32, index: u32) -> Option<Item> {
    let [a, b, c] = mesh.vertices(triangle);
    // Not by min and max alone: they drop a NaN if they can.
    let finite = a.is_finite() && b.is_finite() && c.is_finite();
    finite.then(|| Item::triangle(Bounds { min: a.min(b).min(c), max: a.max(b).max(c) }, index))
}

impl Bvh {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return traverse::intersect_avx2(avx2, self, ray);
        }
        traverse::traverse::<_, false>(Portable, self, ray)
    }

    /// The nearest hit on a ray whose direction is so short that its reciprocal overflows.
    #[cold]
    fn nearest_lengthened(&self, ray: &Ray) -> Option<Hit> {
        let scale = 2f32.powi(60);
        let Ray { o, t_min, d, t_max } = *ray;
        let hit = self.nearest(&Ray { o, t_min: t_min / scale, d: d * scale, t_max: t_max / scale })?;
        let t = hit.t * scale;
        (t > t_min && t < t_max).then_some(Hit { t, ..hit })
    }
}

fn is_short(ray: &Ray) -> bool {
    ray.d.abs().max_element() < f32::MIN_POSITIVE
}

impl Intersector for Bvh {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if is_short(ray) { self.nearest_lengthened(ray) } else { self.nearest(ray) }
    }

    fn occluded(&self, ray: &Ray) -> bool {
        if is_short(ray) {
            return self.nearest_lengthened(ray).is_some();
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return traverse::occluded_avx2(avx2, self, ray);
        }
        traverse::traverse::<_, true>(Portable, self, ray).is_some()
    }
}

#[cfg(test)]
mod tests;
