//! Facets: flat parts of meshes that end at all their edges (walls, floors, sides of boxes). Density estimation near
//! their edges must know where they end (Hey & Purgathofer 2002, "Advanced Radiance Estimation for Photon Map Global
//! Illumination"). Curved surfaces have none: there is nothing to know.

use super::{Geometry, Mesh, Shape};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Larger meshes are not searched: their triangles are small, and loading must not wait.
const MAX_TRIANGLES: usize = 1 << 17;
/// Facets with more edges are left out: every lookup on them asks all edges.
const MAX_EDGES: usize = 64;
/// Contacts are looked for among so many facets at most.
const MAX_CONTACTS: usize = 2048;
/// Cosine of the angle between triangles of one plane.
const SAME_PLANE: f64 = 1.0 - 1e-6;
/// Cosine of the angle from which on a surface counts as ending at an edge.
const CREASE: f64 = 0.94;

/// A directed edge, in the plane of its facet: the facet lies to its left.
pub type Edge = [Vec2; 2];

/// A flat polygon, perhaps with holes.
#[derive(Clone, Debug, PartialEq)]
pub struct Facet {
    origin: Vec3,
    s: Vec3,
    t: Vec3,
    edges: Vec<Edge>,
}

/// The facets of a scene, by shape and triangle.
#[derive(Clone, Debug, Default)]
pub struct Facets {
    facets: Vec<Facet>,
    /// For each shape: for each triangle its facet, or `NONE`; empty if there are none.
    of: Vec<Vec<u32>>,
}

const NONE: u32 = u32::MAX;

impl Facet {
    /// Where `p` lies in the plane.
    pub fn project(&self, p: Vec3) -> Vec2 {
        let v = p - self.origin;
        Vec2::new(v.dot(self.s), v.dot(self.t))
    }

    /// The boundary.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Whether a point of the plane lies inside.
    pub fn contains(&self, p: Vec2) -> bool {
        // Even-odd rule, along +x.
        self.edges.iter().filter(|[a, b]| crosses(p, *a, *b)).count() % 2 == 1
    }

    fn normal(&self) -> Vec3 {
        self.s.cross(self.t)
    }

    fn corners(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.edges.iter().map(|[a, _]| self.origin + self.s * a.x + self.t * a.y)
    }
}

fn crosses(p: Vec2, a: Vec2, b: Vec2) -> bool {
    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * ((p.y - a.y) / (b.y - a.y))
}

impl Facets {
    /// Finds them.
    pub fn new(geometry: &Geometry) -> Facets {
        let per_shape: Vec<(Vec<Facet>, Vec<u32>)> = geometry
            .shapes
            .par_iter()
            .map(|shape| match shape {
                Shape::Mesh(mesh) if mesh.triangles.len() <= MAX_TRIANGLES => of_mesh(mesh),
                _ => Default::default(),
            })
            .collect();
        let mut all = Facets::default();
        for (facets, mut of) in per_shape {
            let first = all.facets.len() as u32;
            of.iter_mut().filter(|f| **f != NONE).for_each(|f| *f += first);
            all.facets.extend(facets);
            all.of.push(of);
        }
        if all.facets.len() <= MAX_CONTACTS {
            cut_contacts(&mut all.facets);
        }
        all
    }

    /// The facet that a triangle of a shape belongs to.
    pub fn get(&self, shape: u32, triangle: u32) -> Option<&Facet> {
        let of = self.of.get(shape as usize)?.get(triangle as usize)?;
        self.facets.get(*of as usize)
    }
}

/// What lies beyond an edge of a triangle.
#[derive(Clone, Copy, PartialEq)]
enum Beyond {
    /// Nothing, or a surface at an angle.
    End,
    /// A triangle of the same plane.
    Flat(u32),
    /// The surface goes on, bent.
    Curved,
}

fn of_mesh(mesh: &Mesh) -> (Vec<Facet>, Vec<u32>) {
    let n = mesh.triangles.len();
    // Seams of texture coordinates or normals part vertices, not the surface.
    let mut by_position = HashMap::new();
    let welded: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = by_position.len() as u32;
            *by_position.entry((*p + Vec3::ZERO).to_array().map(f32::to_bits)).or_insert(next)
        })
        .collect();
    let corners = |t: usize| mesh.triangles[t].map(|i| welded[i as usize]);
    let normals: Vec<Option<DVec3>> = (0..n)
        .map(|t| {
            let [a, b, c] = mesh.vertices(t as u32).map(|p| p.as_dvec3());
            (b - a).cross(c - a).try_normalize()
        })
        .collect();
    let mut edges = HashMap::with_capacity(3 * n);
    for t in 0..n {
        let v = corners(t);
        for k in 0..3 {
            let (a, b) = (v[k], v[(k + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_insert_with(Vec::new).push((t as u32, a < b));
        }
    }
    let beyond = |t: usize, k: usize| {
        let v = corners(t);
        let (a, b) = (v[k], v[(k + 1) % 3]);
        let others = edges[&(a.min(b), a.max(b))].iter().filter(|(o, _)| *o as usize != t);
        let others: Vec<_> = others.collect();
        let [(other, forward)] = others[..] else { return Beyond::End };
        match (normals[t], normals[*other as usize]) {
            // Seen from the other side: nothing goes on there.
            _ if *forward == (a < b) => Beyond::End,
            (Some(n), Some(m)) if n.dot(m) > SAME_PLANE => Beyond::Flat(*other),
            (Some(n), Some(m)) if n.dot(m) < CREASE => Beyond::End,
            _ => Beyond::Curved,
        }
    };

    let (mut facets, mut of) = (Vec::new(), vec![NONE; n]);
    let mut visited = vec![false; n];
    for seed in 0..n {
        let Some(normal) = normals[seed] else { continue };
        if visited[seed] {
            continue;
        }
        visited[seed] = true;
        let mut members = vec![seed as u32];
        let mut ends = Vec::new();
        let mut whole = true;
        let mut next = 0;
        while let Some(&t) = members.get(next) {
            next += 1;
            for k in 0..3 {
                match beyond(t as usize, k) {
                    Beyond::End => ends.push((t, k)),
                    Beyond::Curved => whole = false,
                    Beyond::Flat(other) => {
                        let flat = normals[other as usize].is_some_and(|m| m.dot(normal) > SAME_PLANE);
                        whole &= flat;
                        if flat && !visited[other as usize] {
                            visited[other as usize] = true;
                            members.push(other);
                        }
                    }
                }
            }
        }
        if !whole || ends.len() > MAX_EDGES {
            continue;
        }
        let [origin, ..] = mesh.vertices(seed as u32);
        let (s, t) = normal.as_vec3().any_orthonormal_pair();
        let mut facet = Facet { origin, s, t, edges: Vec::with_capacity(ends.len()) };
        for (triangle, k) in ends {
            let v = mesh.vertices(triangle);
            facet.edges.push([v[k], v[(k + 1) % 3]].map(|p| facet.project(p)));
        }
        members.iter().for_each(|&t| of[t as usize] = facets.len() as u32);
        facets.push(facet);
    }
    if facets.is_empty() {
        of.clear()
    }
    (facets, of)
}

/// Cuts out of every facet what another one, facing it, covers: a box leaves a hole in the floor it stands on.
fn cut_contacts(facets: &mut [Facet]) {
    /// A gap of this share of the covering facet's size is no gap to light.
    const GAP: f32 = 0.01;
    let mut holes = Vec::new();
    for (i, floor) in facets.iter().enumerate() {
        let normal = floor.normal();
        for cover in facets.iter() {
            if cover.normal().dot(normal) > -1.0 + 1e-5 {
                continue;
            }
            let size = cover.edges.iter().map(|[a, b]| a.distance(*b)).fold(0.0, f32::max);
            let height = (cover.origin - floor.origin).dot(normal);
            let rounding = 8.0 * f32::EPSILON * cover.origin.abs().max_element();
            if height > -rounding
                && height < GAP * size
                && cover.corners().all(|p| floor.contains(floor.project(p)))
            {
                // Facing the other way, it runs round its hole as a hole's edges do.
                let edges = cover
                    .edges
                    .iter()
                    .map(|edge| edge.map(|p| floor.project(cover.origin + cover.s * p.x + cover.t * p.y)));
                holes.push((i, edges.collect::<Vec<_>>()));
            }
        }
    }
    for (i, edges) in holes {
        if facets[i].edges.len() + edges.len() <= MAX_EDGES {
            facets[i].edges.extend(edges);
        }
    }
}
