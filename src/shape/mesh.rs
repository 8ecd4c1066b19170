//! Triangle meshes.

use super::{Bounds, SurfacePoint};
use glam::{Vec2, Vec3};

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
}

impl Mesh {
    /// The positions of a triangle's vertices.
    pub fn vertices(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|i| self.positions[i as usize])
    }

    /// World-space bounds of the vertices that triangles use.
    pub fn bounds(&self) -> Bounds {
        self.triangles.iter().flatten().fold(Bounds::EMPTY, |b, &i| b.grow(self.positions[i as usize]))
    }

    /// The cross product of a triangle's edges: twice its area long.
    pub fn area_vector(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.vertices(triangle);
        (b - a).cross(c - a)
    }

    /// Sum of the triangles' areas.
    pub fn area(&self) -> f32 {
        (0..self.triangles.len() as u32).map(|t| 0.5 * self.area_vector(t).length() as f64).sum::<f64>()
            as f32
    }

    /// The point with barycentric weights (1−u−v, u, v). A triangle of no area has the normal z.
    pub fn point(&self, triangle: u32, u: f32, v: f32) -> SurfacePoint {
        let [i, j, k] = self.triangles[triangle as usize].map(|i| i as usize);
        let (a, b, c) = (self.positions[i], self.positions[j], self.positions[k]);
        let w = 1.0 - u - v;
        let n_g = (b - a).cross(c - a).try_normalize().unwrap_or(Vec3::Z);
        let n_s = match self.normals.get(..) {
            Some([]) | None => n_g,
            Some(n) => (n[i] * w + n[j] * u + n[k] * v).try_normalize().unwrap_or(n_g),
        };
        let uv = match self.uvs.get(..) {
            Some([]) | None => Vec2::new(u, v),
            Some(t) => t[i] * w + t[j] * u + t[k] * v,
        };
        let magnitude = a.abs().max(b.abs()).max(c.abs()).max_element();
        SurfacePoint { p: a * w + b * u + c * v, magnitude, n_g, n_s, uv }
    }

    /// ∂p/∂u of a triangle; the zero vector where the texture coordinates are degenerate.
    pub fn dp_du(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.vertices(triangle);
        let (e1, e2) = (b - a, c - a);
        if self.uvs.is_empty() {
            return e1;
        }
        let [ta, tb, tc] = self.triangles[triangle as usize].map(|i| self.uvs[i as usize]);
        let (d1, d2) = (tb - ta, tc - ta);
        let det = d1.perp_dot(d2);
        if det == 0.0 { Vec3::ZERO } else { (e1 * d2.y - e2 * d1.y) / det }
    }
}
