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
use crate::shape::{Bounds, Geometry, Hit, Instance, Mesh, Shape};
use build::Item;
use huge::Huge;
use node::Node;
use rayon::prelude::*;
use simd::Portable;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use traverse::Trace;
use triangle::Packet;

/// A tree over the triangles, analytic shapes and instances of a scene, or of a group.
pub(super) struct Bvh {
    /// The root first.
    nodes: Huge<Node>,
    packets: Huge<Packet>,
    singles: Vec<Single>,
    /// Those of the scene.
    instances: Vec<Instance>,
    groups: Vec<Bvh>,
    #[cfg(target_arch = "x86_64")]
    avx2: Option<simd::Avx2>,
}

/// What fills a leaf of its own.
enum Single {
    /// Beside its index.
    Quadric(Shape, u32),
    /// By its index.
    Instance(u32),
}

impl Bvh {
    /// Builds the tree; the geometry's indices must have been checked. What is not finite is left out.
    ///
    /// # Errors
    /// [`crate::Error::Runtime`] if there is not enough memory.
    pub(super) fn new(geometry: &Geometry) -> Result<Bvh> {
        let group = |(group, range): (u32, &Range<u32>)| Bvh::over(geometry.group(group), range.start, &[]);
        let groups = (0..).zip(&geometry.groups).map(group).collect::<Result<_>>()?;
        let tree = Bvh::over(geometry.world(), 0, &geometry.instance_bounds())?;
        Ok(Bvh { instances: geometry.instances.clone(), groups, ..tree })
    }

    /// The tree over shapes, the first of which has this index, and over what has these bounds.
    fn over(shapes: &[Shape], first: u32, instances: &[Bounds]) -> Result<Bvh> {
        let (mut items, mut singles, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
        let mut triangles = 0;
        let broken = AtomicBool::new(false);
        let mut single = |items: &mut Vec<Item>, bounds: Bounds, single| {
            if bounds.min.is_finite() && bounds.max.is_finite() {
                items.push(Item::single(bounds, singles.len() as u32));
                singles.push(single);
            }
        };
        for (i, shape) in (first..).zip(shapes) {
            if let Shape::Mesh(mesh) = shape {
                meshes.push((triangles, i, mesh));
                let range = (0..mesh.triangles.len() as u32).into_par_iter();
                items.par_extend(range.map(|t| {
                    item(mesh, t, triangles + t).unwrap_or_else(|| {
                        broken.store(true, Relaxed);
                        Item::BROKEN
                    })
                }));
                triangles += mesh.triangles.len() as u32;
            } else {
                single(&mut items, shape.bounds(), Single::Quadric(shape.clone(), i));
            }
        }
        for (i, bounds) in (0..).zip(instances) {
            single(&mut items, *bounds, Single::Instance(i));
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
            singles,
            instances: Vec::new(),
            groups: Vec::new(),
            #[cfg(target_arch = "x86_64")]
            avx2: simd::Avx2::detect(),
        })
    }
}

fn item(mesh: &Mesh, triangle: u32, index: u32) -> Option<Item> {
    let [a, b, c] = mesh.vertices(triangle);
    // Not by min and max alone: they drop a NaN if they can.
    let finite = a.is_finite() && b.is_finite() && c.is_finite();
    finite.then(|| Item::triangle(Bounds { min: a.min(b).min(c), max: a.max(b).max(c) }, index))
}

impl Bvh {
    /// The nearest hit; with `ANY` the first one found.
    fn trace<S: Trace, const ANY: bool>(&self, s: S, ray: &Ray) -> Option<Hit> {
        if is_short(ray) { self.trace_lengthened(s, ray) } else { s.trace::<ANY>(self, ray) }
    }

    /// The nearest hit on a ray whose direction is so short that its reciprocal overflows.
    #[cold]
    fn trace_lengthened<S: Trace>(&self, s: S, ray: &Ray) -> Option<Hit> {
        let scale = 2f32.powi(60);
        let Ray { o, t_min, d, t_max } = *ray;
        let lengthened = Ray { o, t_min: t_min / scale, d: d * scale, t_max: t_max / scale };
        let hit = s.trace::<false>(self, &lengthened)?;
        let t = hit.t * scale;
        (t > t_min && t < t_max).then_some(Hit { t, ..hit })
    }

    /// What it takes of memory.
    #[cfg(test)]
    fn bytes(&self) -> usize {
        let own = self.nodes.bytes() + self.packets.bytes();
        let lists = size_of_val(&self.singles[..]) + size_of_val(&self.instances[..]);
        own + lists + self.groups.iter().map(Bvh::bytes).sum::<usize>()
    }

    /// The hit with a single. Out of line: scenes of triangles need not make room for it.
    #[inline(never)]
    fn single<S: Trace, const ANY: bool>(&self, s: S, index: usize, ray: &Ray) -> Option<Hit> {
        match self.singles[index] {
            Single::Quadric(ref quadric, shape) => quadric.intersect(ray).map(|t| Hit {
                t,
                u: 0.0,
                v: 0.0,
                shape,
                primitive: 0,
                instance: Hit::NO_INSTANCE,
            }),
            Single::Instance(index) => {
                let instance = &self.instances[index as usize];
                // Groups hold no instances, so this goes no deeper.
                let hit = self.groups[instance.group as usize].trace::<S, ANY>(s, &instance.ray(ray))?;
                Some(Hit { instance: index, ..hit })
            }
        }
    }
}

fn is_short(ray: &Ray) -> bool {
    ray.d.abs().max_element() < f32::MIN_POSITIVE
}

impl Intersector for Bvh {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return self.trace::<_, false>(avx2, ray);
        }
        self.trace::<_, false>(Portable, ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return self.trace::<_, true>(avx2, ray).is_some();
        }
        self.trace::<_, true>(Portable, ray).is_some()
    }
}

#[cfg(test)]
mod tests;
