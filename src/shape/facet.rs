//! Facets: flat parts of meshes that end at all their edges (walls, floors, sides of boxes). Density estimation near
//! their edges must know where they end (Hey & Purgathofer 2002, "Advanced Radiance Estimation for Photon Map Global
//! Illumination"). Curved surfaces have none: there is nothing to know.

use super::parted::{self, Parting};
use super::{Geometry, Mesh, Shape};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

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
    /// How far off the plane points of the surface may be found.
    thickness: f32,
    /// Whether all is cut out of it that others cover.
    is_bare: bool,
    /// Smaller facets that it consists of.
    pub(super) parting: Option<Parting>,
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

    pub(super) fn normal(&self) -> Vec3 {
        self.s.cross(self.t)
    }

    pub(super) fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Whether all is cut out of it that other facets cover.
    pub fn is_bare(&self) -> bool {
        self.is_bare
    }

    /// Whether `p` lies in the plane, as far as the surface does and rounding can tell.
    pub fn is_coplanar(&self, p: Vec3) -> bool {
        let v = p - self.origin;
        v.dot(self.normal()).abs() <= self.thickness
    }

    /// Where a point of the plane lies in space.
    pub(super) fn point(&self, p: Vec2) -> Vec3 {
        self.origin + self.s * p.x + self.t * p.y
    }

    /// Another one in the same plane.
    pub(super) fn with_edges(&self, edges: Vec<Edge>) -> Facet {
        Facet { edges, parting: None, ..*self }
    }

    pub(super) fn corners(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.edges.iter().map(|[a, _]| self.point(*a))
    }
}

fn crosses(p: Vec2, a: Vec2, b: Vec2) -> bool {
    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * ((p.y - a.y) / (b.y - a.y))
}

impl Facets {
    /// Finds them, but for those in groups: where an instance's surfaces end, nobody knows.
    pub fn new(geometry: &Geometry) -> Facets {
        let per_shape: Vec<(Vec<Facet>, Vec<u32>)> = geometry
            .world()
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
            all.facets.iter_mut().for_each(|facet| facet.is_bare = true);
            cut_contacts(&mut all.facets);
            parted::part_all(&mut all.facets);
        }
        all
    }

    /// The facet around `p`, a point of a triangle of a shape.
    pub fn at(&self, shape: u32, triangle: u32, p: Vec3) -> Option<&Facet> {
        let of = self.of.get(shape as usize)?.get(triangle as usize)?;
        let mut facet = self.facets.get(*of as usize)?;
        while let Some(parting) = &facet.parting {
            facet = &self.facets[parting.side(facet.project(p)) as usize];
        }
        Some(facet)
    }

    #[cfg(test)]
    fn get(&self, shape: u32, triangle: u32) -> Option<&Facet> {
        self.at(shape, triangle, Vec3::ZERO)
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

/// For each vertex the first one at its position: seams of texture coordinates or normals part vertices, not the
/// surface.
fn weld(mesh: &Mesh) -> Vec<u32> {
    let positions = &mesh.positions;
    // Adding zero makes both zeros one.
    let key = |i: u32| (positions[i as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut sorted: Vec<u32> = if positions.len() > 3 * mesh.triangles.len() {
        mesh.triangles.iter().flatten().copied().collect()
    } else {
        (0..positions.len() as u32).collect()
    };
    sorted.sort_unstable_by_key(|&i| (key(i), i));
    let mut welded = vec![0; positions.len()];
    for same in sorted.chunk_by(|&a, &b| key(a) == key(b)) {
        same.iter().for_each(|&i| welded[i as usize] = same[0]);
    }
    welded
}

/// The sides of triangles, by the smaller one of their vertices.
struct Sides {
    /// Where the sides of each vertex begin.
    starts: Vec<u32>,
    /// The greater vertex; triangle; whether the triangle runs from the smaller to the greater one.
    sides: Vec<(u32, u32, bool)>,
}

impl Sides {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Sides {
        let sides = || (0..).zip(triangles).flat_map(|(t, v)| [0, 1, 2].map(|k| (v[k], v[(k + 1) % 3], t)));
        let mut starts = vec![0u32; vertices + 1];
        sides().for_each(|(a, b, _)| starts[a.min(b) as usize] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        // From the end of each vertex' sides to their beginning.
        let mut sorted = vec![(0, 0, false); 3 * triangles.len()];
        for (a, b, t) in sides() {
            let start = &mut starts[a.min(b) as usize];
            *start -= 1;
            sorted[*start as usize] = (a.max(b), t, a < b);
        }
        Sides { starts, sides: sorted }
    }

    /// The only other triangle with a side of triangle `t`, and whether it runs as [`Sides::sides`] says.
    fn other(&self, t: u32, a: u32, b: u32) -> Option<(u32, bool)> {
        let v = a.min(b) as usize;
        let all = &self.sides[self.starts[v] as usize..self.starts[v + 1] as usize];
        let mut others = all.iter().filter(|(end, other, _)| *end == a.max(b) && *other != t);
        let &(_, other, forward) = others.next()?;
        others.next().is_none().then_some((other, forward))
    }
}

fn of_mesh(mesh: &Mesh) -> (Vec<Facet>, Vec<u32>) {
    let n = mesh.triangles.len();
    let welded = weld(mesh);
    let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|i| welded[i as usize])).collect();
    let sides = Sides::new(mesh.positions.len(), &triangles);
    let normals: Vec<Option<DVec3>> = (0..n)
        .map(|t| {
            let [a, b, c] = mesh.vertices(t as u32).map(|p| p.as_dvec3());
            (b - a).cross(c - a).try_normalize()
        })
        .collect();
    let beyond = |t: usize, k: usize| {
        let v = triangles[t];
        let (a, b) = (v[k], v[(k + 1) % 3]);
        let Some((other, forward)) = sides.other(t as u32, a, b) else { return Beyond::End };
        match (normals[t], normals[other as usize]) {
            // Seen from the other side: nothing goes on there.
            _ if forward == (a < b) => Beyond::End,
            (Some(n), Some(m)) if n.dot(m) > SAME_PLANE => Beyond::Flat(other),
            (Some(n), Some(m)) if n.dot(m) < CREASE => Beyond::End,
            _ => Beyond::Curved,
        }
    };

    let (mut facets, mut of) = (Vec::new(), vec![NONE; n]);
    let mut visited = vec![false; n];
    let (mut members, mut ends) = (Vec::new(), Vec::new());
    for seed in 0..n {
        let Some(normal) = normals[seed] else { continue };
        if visited[seed] {
            continue;
        }
        visited[seed] = true;
        members.clear();
        members.push(seed as u32);
        ends.clear();
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
        let edges = Vec::with_capacity(ends.len());
        let mut facet = Facet { origin, s, t, edges, thickness: 0.0, is_bare: false, parting: None };
        let normal = facet.normal();
        for &(triangle, k) in &ends {
            let v = mesh.vertices(triangle);
            facet.edges.push([v[k], v[(k + 1) % 3]].map(|p| facet.project(p)));
            // A photon's position is good to a few ulps, and so is the normal over the facet's extent.
            let rounding = 64.0 * f32::EPSILON * v[k].abs().max_element();
            let off = (v[k] - origin).dot(normal).abs();
            facet.thickness = facet.thickness.max(2.0 * off + rounding);
        }
        members.iter().for_each(|&t| of[t as usize] = facets.len() as u32);
        facets.push(facet);
    }
    if facets.is_empty() {
        of = Vec::new();
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
                let edges = cover.edges.iter().map(|edge| edge.map(|p| floor.project(cover.point(p))));
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::math::{Sampler, Stream};
    use crate::shape::Sphere;
    use glam::Affine3A;

    pub(in crate::shape) fn facets(meshes: Vec<Mesh>) -> Facets {
        Facets::new(&Geometry::from(meshes.into_iter().map(Shape::Mesh).collect::<Vec<_>>()))
    }

    fn mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Mesh {
        let positions = positions.iter().map(|&p| Vec3::from_array(p)).collect();
        Mesh { positions, triangles: triangles.to_vec(), ..Mesh::default() }
    }

    /// Signed area of what the edges enclose.
    pub(in crate::shape) fn area(facet: &Facet) -> f32 {
        facet.edges().iter().map(|[a, b]| 0.5 * a.perp_dot(*b)).sum()
    }

    #[test]
    fn a_cube_has_six_squares() {
        let to_world = Affine3A::from_rotation_x(0.4) * Affine3A::from_translation(Vec3::new(3.0, -7.0, 9.0));
        let cube = facets(vec![Mesh::cube(to_world)]);
        assert_eq!(cube.facets.len(), 6);
        for triangle in 0..12 {
            let facet = cube.get(0, triangle).unwrap();
            assert_eq!(facet.edges().len(), 4);
            assert!((area(facet) - 4.0).abs() < 1e-5);
            let center = to_world.transform_point3(Vec3::ZERO);
            assert!(((facet.origin - center).dot(facet.normal()) - 1.0).abs() < 1e-5, "it faces outwards");
        }
        assert!(cube.get(0, 12).is_none() && cube.get(1, 0).is_none());
    }

    /// Vertices that only texture coordinates part are one; an L is not convex; a fold of 6 degrees goes on.
    #[test]
    fn polygons_are_put_together() {
        let l = mesh(
            &[
                [0., 0., 0.],
                [2., 0., 0.],
                [2., 1., 0.],
                [0., 1., 0.], // below
                [0., 1., 0.],
                [1., 1., 0.],
                [1., 2., 0.],
                [0., 2., 0.], // above, welded along part of an edge only
            ],
            &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        );
        let two = facets(vec![l]);
        assert_eq!(two.facets.len(), 2, "edges that only touch in part are no neighbours");
        let split = mesh(
            &[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 0., 0.], [1., 1., 0.], [0., 1., 0.]],
            &[[0, 1, 2], [3, 4, 5]],
        );
        let one = facets(vec![split]);
        let facet = one.get(0, 1).unwrap();
        assert_eq!((one.facets.len(), facet.edges().len(), area(facet)), (1, 4, 1.0));
        for (x, y, inside) in [(0.5, 0.2, true), (0.2, 0.5, true), (1.1, 0.5, false), (0.5, -0.1, false)] {
            assert_eq!(facet.contains(facet.project(Vec3::new(x, y, 0.0))), inside, "{x} {y}");
        }
        let fold = |height| {
            mesh(
                &[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [2., 0., height], [2., 1., height]],
                &[[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]],
            )
        };
        assert_eq!(facets(vec![fold(0.1)]).facets.len(), 0);
        assert_eq!(facets(vec![fold(1.0)]).facets.len(), 2);
    }

    /// Six steps from pole to pole turn by 30 degrees at edges: facets. Sixty go on smoothly: none.
    #[test]
    fn curved_surfaces_have_none() {
        let drum = |n: u32| {
            let mut m = Mesh::default();
            for i in 0..n {
                let angle = i as f32 / n as f32 * std::f32::consts::TAU;
                let (y, x) = angle.sin_cos();
                m.positions.extend([Vec3::new(x, y, 0.0), Vec3::new(x, y, 1.0)]);
                let (a, b, c, d) = (2 * i, 2 * i + 1, 2 * (i + 1) % (2 * n), (2 * (i + 1) + 1) % (2 * n));
                m.triangles.extend([[a, c, d], [a, d, b]]);
            }
            facets(vec![m]).facets.len()
        };
        assert_eq!((drum(6), drum(60)), (6, 0));
        let sphere = Sphere::new(Vec3::ZERO, 1.0, Affine3A::IDENTITY, false).unwrap();
        assert!(Facets::new(&Geometry::from(vec![Shape::Sphere(sphere)])).get(0, 0).is_none());
    }

    #[test]
    fn boxes_leave_holes_where_they_stand() {
        let floor = Mesh::rectangle(Affine3A::from_scale(Vec3::splat(5.0)));
        let stand = |p: Vec3| Mesh::cube(Affine3A::from_translation(p));
        let area = |height: f32, x: f32| {
            let scene = facets(vec![floor.clone(), stand(Vec3::new(x, 0.0, 1.0 + height))]);
            area(scene.get(0, 0).unwrap())
        };
        assert!((area(0.0, 1.0) - 96.0).abs() < 1e-4);
        assert!((area(0.001, 1.0) - 96.0).abs() < 1e-4);
        assert_eq!(area(0.5, 1.0), 100.0, "light gets under it");
        assert_eq!(area(0.0, 4.5), 100.0, "it stands out over the edge");
        let scene = facets(vec![floor, stand(Vec3::Z)]);
        let facet = scene.get(0, 0).unwrap();
        let inside = |x, y| facet.contains(facet.project(Vec3::new(x, y, 0.0)));
        assert!(inside(1.5, 0.0) && !inside(0.5, 0.0) && !inside(5.5, 0.0));
    }

    /// Neither slivers, nor triangles of no area, nor edges shared by three break anything.
    #[test]
    fn broken_meshes_have_fewer_facets() {
        let mut rng = Sampler::new(5, Stream::Eye, 0, 0);
        for _ in 0..200 {
            let mut random = |n: u32| (rng.next_1d() * n as f32) as u32;
            let positions: Vec<[f32; 3]> =
                (0..6).map(|_| std::array::from_fn(|_| random(3) as f32)).collect();
            let triangles: Vec<[u32; 3]> = (0..12).map(|_| std::array::from_fn(|_| random(6))).collect();
            let found = facets(vec![mesh(&positions, &triangles)]);
            for facet in &found.facets {
                assert!(facet.edges().iter().flatten().all(|p| p.is_finite()));
            }
        }
    }
}
