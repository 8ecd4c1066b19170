//! Triangle meshes.

use super::{Bounds, Hit, SurfacePoint, Wanted};
use crate::math::{Ray, first_index};
use glam::{Affine3A, DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Triangles that one thread takes at a time. Fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// Values that a mesh file gives beside its geometry.
#[derive(Clone, Debug, PartialEq)]
pub struct Attribute {
    /// Begins with `vertex_` for one value for each vertex, else there is one for each triangle.
    pub name: String,
    /// The values; grey if the file has but one number.
    pub values: Vec<Vec3>,
}

impl Attribute {
    /// Whether values belong to vertices, in between which they are interpolated.
    pub fn of_vertices(&self) -> bool {
        self.name.starts_with("vertex_")
    }
}

/// Indexed triangles in world space. Flipped meshes are stored flipped (winding and normals), so no flag remains.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex normals, unit length; empty for a faceted mesh.
    pub normals: Vec<Vec3>,
    /// Vertex texture coordinates; empty if there are none.
    pub uvs: Vec<Vec2>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// What textures may look up.
    pub attributes: Vec<Attribute>,
}

impl Mesh {
    /// An attribute by its name.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|a| a.name == name)
    }

    /// The positions of a triangle's vertices.
    pub fn vertices(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|i| self.positions[i as usize])
    }

    /// World-space bounds of the vertices that triangles use.
    pub fn bounds(&self) -> Bounds {
        let of_chunk = |chunk: &[[u32; 3]]| {
            chunk.iter().flatten().fold(Bounds::EMPTY, |b, &i| b.grow(self.positions[i as usize]))
        };
        let chunks: Vec<Bounds> = self.triangles.par_chunks(CHUNK).map(of_chunk).collect();
        chunks.into_iter().fold(Bounds::EMPTY, Bounds::union)
    }

    /// Greatest distance from `center` of the vertices that triangles use.
    pub fn radius_around(&self, center: Vec3) -> f32 {
        let of_triangle = |t: &[u32; 3]| {
            t.iter().map(|&i| self.positions[i as usize].distance_squared(center)).fold(0.0, f32::max)
        };
        let of_chunk = |chunk: &[[u32; 3]]| chunk.iter().map(of_triangle).fold(0.0, f32::max);
        self.triangles.par_chunks(CHUNK).map(of_chunk).reduce(|| 0.0, f32::max).sqrt()
    }

    /// The square [-1,1]² of the xy plane with normal +z and texture coordinates 0..1, transformed. The normal goes
    /// with the transform as normals do: a mirror transform within the plane leaves it on its side.
    pub fn rectangle(to_world: Affine3A) -> Mesh {
        let mut mesh = Mesh::default();
        mesh.add_square(&to_world, [Vec3::ZERO, Vec3::X, Vec3::Y]);
        mesh
    }

    /// The faceted cube [-1,1]³, transformed; texture coordinates 0..1 on every face, laid out as in Mitsuba 3.
    pub fn cube(to_world: Affine3A) -> Mesh {
        // Texture coordinates are mirrored seen from outside, so the squares face inwards at first.
        const FACES: [[Vec3; 3]; 6] = [
            [Vec3::NEG_Y, Vec3::Z, Vec3::X],
            [Vec3::Y, Vec3::NEG_X, Vec3::NEG_Z],
            [Vec3::X, Vec3::Y, Vec3::NEG_Z],
            [Vec3::Z, Vec3::Y, Vec3::X],
            [Vec3::NEG_X, Vec3::Y, Vec3::Z],
            [Vec3::NEG_Z, Vec3::NEG_Y, Vec3::X],
        ];
        let mut mesh = Mesh::default();
        for face in FACES {
            mesh.add_square(&to_world, face);
        }
        mesh.flip();
        mesh
    }

    /// Adds a square by its centre and the half edges along which u and v grow, with normal u × v before the
    /// transform.
    fn add_square(&mut self, to_world: &Affine3A, [center, u, v]: [Vec3; 3]) {
        let base = self.positions.len() as u32;
        for (s, t) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            self.positions.push(to_world.transform_point3(center + u * s + v * t));
            self.uvs.push(Vec2::new(0.5 + 0.5 * s, 0.5 + 0.5 * t));
        }
        // A mirror transform reverses the winding, hence the normal it stands for.
        let mirrored = to_world.matrix3.determinant() < 0.0;
        for [i, j, k] in [[0, 1, 2], [0, 2, 3]] {
            let [j, k] = if mirrored { [k, j] } else { [j, k] };
            self.triangles.push([base + i, base + j, base + k]);
        }
    }

    /// Turns the surface inside out: reverses the winding and the normals.
    pub fn flip(&mut self) {
        self.reverse();
        self.normals.par_iter_mut().for_each(|n| *n = -*n);
    }

    /// Reverses the winding alone.
    pub fn reverse(&mut self) {
        self.triangles.par_iter_mut().for_each(|t| t.swap(1, 2));
    }

    /// The cross product of a triangle's edges: twice its area long.
    pub fn area_vector(&self, triangle: u32) -> Vec3 {
        self.area_vector_of(&self.triangles[triangle as usize])
    }

    /// The same for any three vertices.
    pub fn area_vector_of(&self, triangle: &[u32; 3]) -> Vec3 {
        cross(triangle.map(|i| self.positions[i as usize])).as_vec3()
    }

    /// Whether all triangles lie in one plane, exactly.
    pub fn is_flat(&self) -> bool {
        self.plane().is_some()
    }

    /// A point and the normal of the plane that all triangles lie in, exactly, and face the same side of.
    pub fn plane(&self) -> Option<(Vec3, Vec3)> {
        let mut normals = (0..self.triangles.len() as u32).map(|t| self.area_vector(t));
        let n = normals.find(|n| *n != Vec3::ZERO)?;
        let origin = self.vertices(0)[0];
        let leaves = |t: &[u32; 3]| {
            let on_plane = t.iter().all(|&i| n.dot(self.positions[i as usize] - origin) == 0.0);
            let faces_alike = n.dot(self.area_vector_of(t)) >= 0.0;
            !(on_plane && faces_alike)
        };
        first_index(&self.triangles, leaves).is_none().then(|| (origin, n.normalize()))
    }

    /// Sum of the triangles' areas.
    pub fn area(&self) -> f32 {
        let of_chunk = |chunk: &[[u32; 3]]| -> f64 {
            chunk.iter().map(|t| 0.5 * cross(t.map(|i| self.positions[i as usize])).length()).sum()
        };
        let chunks: Vec<f64> = self.triangles.par_chunks(CHUNK).map(of_chunk).collect();
        chunks.iter().sum::<f64>() as f32
    }

    /// The point with barycentric weights (1−u−v, u, v), with texture coordinates if they are `wanted`. A triangle of no
    /// area has the normal z.
    pub fn point(&self, triangle: u32, u: f32, v: f32, wanted: Wanted) -> SurfacePoint {
        let [i, j, k] = self.triangles[triangle as usize].map(|i| i as usize);
        let (a, b, c) = (self.positions[i], self.positions[j], self.positions[k]);
        let w = 1.0 - u - v;
        let n_g = cross([a, b, c]).try_normalize().unwrap_or(DVec3::Z).as_vec3();
        let n_s = match self.normals.get(..) {
            Some([]) | None => n_g,
            Some(n) => (n[i] * w + n[j] * u + n[k] * v).try_normalize().unwrap_or(n_g),
        };
        let uv = wanted.uv(|| match self.uvs.get(..) {
            Some([]) | None => Vec2::new(u, v),
            Some(t) => t[i] * w + t[j] * u + t[k] * v,
        });
        let magnitude = a.abs().max(b.abs()).max(c.abs()).max_element();
        // From the edges, not the weighted vertices: the weights' rounding then stays within the plane.
        SurfacePoint { p: a + ((b - a) * u + (c - a) * v), magnitude, n_g, n_s, uv }
    }

    /// The same hit with weights that depend on the ray and the triangle alone. Those of the ray backends differ in their
    /// last bits, and what photons find out about the scene before the first pass makes other photons of that, so each
    /// backend would show noise of its own.
    pub fn refine(&self, ray: &Ray, hit: &Hit) -> Hit {
        let [a, b, c] = self.vertices(hit.primitive).map(|p| p.as_dvec3());
        let (e, f) = (b - a, c - a);
        let (o, d) = (ray.o.as_dvec3() - a, ray.d.as_dvec3());
        // Möller & Trumbore 1997.
        let (p, q) = (d.cross(f), o.cross(e));
        let inverse = 1.0 / e.dot(p);
        let (u, v) = (o.dot(p) * inverse, d.dot(q) * inverse);
        if !(u + v).is_finite() {
            return *hit;
        }
        // Rounding, or an edge on the ray, may have them outside.
        let u = u.clamp(0.0, 1.0);
        let v = v.clamp(0.0, 1.0 - u);
        Hit { u: u as f32, v: v as f32, ..*hit }
    }

    /// ∂p/∂u and ∂p/∂v of a triangle; zero vectors where the texture coordinates are degenerate.
    pub fn partials(&self, triangle: u32) -> [Vec3; 2] {
        let [a, b, c] = self.vertices(triangle);
        let (e1, e2) = (b - a, c - a);
        if self.uvs.is_empty() {
            return [e1, e2];
        }
        let [ta, tb, tc] = self.triangles[triangle as usize].map(|i| self.uvs[i as usize]);
        let (d1, d2) = (tb - ta, tc - ta);
        let det = d1.perp_dot(d2);
        if det == 0.0 {
            return [Vec3::ZERO; 2];
        }
        [(e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det]
    }
}

/// The cross product of a triangle's edges. In f64, because the normal of a sliver drowns in rounding otherwise, and
/// rays that leave it at grazing angles would start on the wrong side.
fn cross([a, b, c]: [Vec3; 3]) -> DVec3 {
    let a = a.as_dvec3();
    (b.as_dvec3() - a).cross(c.as_dvec3() - a)
}
