//! Our own bounding volume hierarchy, in safe Rust: binned SAH build, watertight triangles, traversal with a stack of
//! fixed size.

mod build;
mod triangle;

use super::Intersector;
use crate::math::Ray;
use crate::shape::{Geometry, Hit, Shape};
use build::{Item, MAX_DEPTH, Tree};
use glam::Vec3;
use triangle::Shear;

/// A binary tree over all triangles and analytic shapes of a scene.
pub(super) struct Bvh {
    /// The root first; siblings are neighbours. Empty if there is nothing to hit.
    nodes: Vec<Node>,
    /// In the leaves' order.
    primitives: Vec<Primitive>,
    quadrics: Vec<Shape>,
}

/// 32 bytes: two share a cache line.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct Node {
    min: Vec3,
    /// The first of two children, or of a leaf's primitives.
    first: u32,
    max: Vec3,
    /// How many primitives a leaf holds; 0 for an inner node.
    count: u32,
}

struct Primitive {
    form: Form,
    shape: u32,
    index: u32,
}

enum Form {
    Triangle([Vec3; 3]),
    /// Index into [`Bvh::quadrics`].
    Quadric(u32),
}

impl Bvh {
    /// Builds the tree; the meshes' indices must have been checked. What is not finite is left out.
    pub(super) fn new(geometry: &Geometry) -> Bvh {
        let (mut primitives, mut items, mut quadrics) = (Vec::new(), Vec::new(), Vec::new());
        let mut add = |form, bounds: crate::shape::Bounds, shape, index| {
            if bounds.min.is_finite() && bounds.max.is_finite() {
                items.push(Item { bounds, index: primitives.len() as u32 });
                primitives.push(Primitive { form, shape, index });
            }
        };
        for (i, shape) in geometry.shapes.iter().enumerate() {
            let i = i as u32;
            if let Shape::Mesh(mesh) = shape {
                for t in 0..mesh.triangles.len() as u32 {
                    let [a, b, c] = mesh.vertices(t);
                    // Not by min and max alone: they drop a NaN if they can.
                    if a.is_finite() && b.is_finite() && c.is_finite() {
                        let bounds = crate::shape::Bounds { min: a.min(b).min(c), max: a.max(b).max(c) };
                        add(Form::Triangle([a, b, c]), bounds, i, t);
                    }
                }
            } else {
                add(Form::Quadric(quadrics.len() as u32), shape.bounds(), i, 0);
                quadrics.push(shape.clone());
            }
        }
        let nodes = build::build(&mut items).map_or(Vec::new(), flatten);
        let mut unordered: Vec<Option<Primitive>> = primitives.into_iter().map(Some).collect();
        let primitives = items.iter().filter_map(|item| unordered[item.index as usize].take()).collect();
        Bvh { nodes, primitives, quadrics }
    }

    /// The nearest hit; with `ANY` the first one found.
    fn traverse<const ANY: bool>(&self, ray: &Ray) -> Option<Hit> {
        if !super::is_valid(ray) || self.nodes.is_empty() {
            return None;
        }
        let slabs = Slabs::new(ray);
        let shear = Shear::new(ray);
        let mut ray = *ray;
        let mut best = None;
        let mut stack = [(0u32, 0f32); MAX_DEPTH as usize];
        let mut height = 0;
        let mut current = slabs.enter(&self.nodes[0], &ray).map(|_| 0);
        while let Some(index) = current {
            let node = &self.nodes[index as usize];
            let first = node.first as usize;
            current = None;
            if node.count == 0 {
                let (a, b) = (node.first, node.first + 1);
                match (slabs.enter(&self.nodes[first], &ray), slabs.enter(&self.nodes[first + 1], &ray)) {
                    (Some(s), Some(t)) => {
                        // The nearer one first.
                        let (near, far) = if s <= t { (a, (b, t)) } else { (b, (a, s)) };
                        stack[height] = far;
                        height += 1;
                        current = Some(near);
                    }
                    (Some(_), None) => current = Some(a),
                    (None, Some(_)) => current = Some(b),
                    (None, None) => (),
                }
            } else {
                for p in &self.primitives[first..first + node.count as usize] {
                    let hit = match &p.form {
                        Form::Triangle(vertices) => shear.intersect(vertices, &ray),
                        Form::Quadric(q) => self.quadrics[*q as usize].intersect(&ray).map(|t| (t, 0.0, 0.0)),
                    };
                    if let Some((t, u, v)) = hit {
                        ray.t_max = t;
                        best = Some(Hit { t, u, v, shape: p.shape, primitive: p.index });
                        if ANY {
                            return best;
                        }
                    }
                }
            }
            while current.is_none() && height > 0 {
                height -= 1;
                let (index, enter) = stack[height];
                current = (enter <= ray.t_max).then_some(index);
            }
        }
        best
    }
}

impl Intersector for Bvh {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.traverse::<false>(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.traverse::<true>(ray).is_some()
    }
}

/// Lays the tree out as an array.
fn flatten(tree: Tree) -> Vec<Node> {
    let node = |tree: &Tree| Node {
        min: tree.bounds.min,
        max: tree.bounds.max,
        first: tree.first,
        count: tree.count,
    };
    let mut nodes = vec![node(&tree)];
    let mut open = vec![(tree, 0)];
    while let Some((tree, slot)) = open.pop() {
        if let Some(children) = tree.children {
            nodes[slot].first = nodes.len() as u32;
            for child in *children {
                let slot = nodes.len();
                nodes.push(node(&child));
                open.push((child, slot));
            }
        }
    }
    nodes
}

/// A ray prepared for the slab test.
struct Slabs {
    o: Vec3,
    inverse: Vec3,
    negative: glam::BVec3,
}

impl Slabs {
    fn new(ray: &Ray) -> Slabs {
        let inverse = ray.d.recip();
        Slabs { o: ray.o, inverse, negative: inverse.cmplt(Vec3::ZERO) }
    }

    /// Where the ray enters the box, if it does within its range. Never misses a box with a hit inside (Ize 2013,
    /// "Robust BVH Ray Traversal").
    fn enter(&self, node: &Node, ray: &Ray) -> Option<f32> {
        // The slab distances are each off by up to 3 half ulps, and the triangle test sees its vertices displaced by
        // up to 4 (translation and shear), all relative to the slab distance: 2 · (3 + 4) half ulps, rounded up to 16.
        const SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;
        let (lower, upper) = ((node.min - self.o) * self.inverse, (node.max - self.o) * self.inverse);
        let near = Vec3::select(self.negative, upper, lower);
        let far = Vec3::select(self.negative, lower, upper);
        // In this order NaN, which comes from a ray within a slab's face (0 · ∞), is ignored.
        let max = |a: f32, b: f32| if a > b { a } else { b };
        let min = |a: f32, b: f32| if a < b { a } else { b };
        let enter = max(near.x, max(near.y, max(near.z, ray.t_min)));
        let leave = min(far.x, min(far.y, min(far.z, ray.t_max)));
        (enter <= leave * SLACK).then_some(enter)
    }
}
