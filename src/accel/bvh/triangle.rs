//! The watertight ray/triangle test of Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection": no ray slips
//! through the edge or vertex that triangles share.

use crate::accel::plane_distance;
use crate::math::Ray;
use glam::Vec3;

/// A ray prepared for the test: the shear and permutation that make it the unit vector z.
pub(super) struct Shear {
    o: Vec3,
    /// The ray's longest dimension last.
    axes: [usize; 3],
    s: Vec3,
}

impl Shear {
    pub(super) fn new(ray: &Ray) -> Shear {
        let z = ray.d.abs().max_position();
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let d = axes.map(|axis| ray.d[axis]);
        Shear { o: ray.o, axes, s: Vec3::new(d[0] / d[2], d[1] / d[2], 1.0 / d[2]) }
    }

    /// Distance and barycentric weights of the second and third vertex.
    pub(super) fn intersect(&self, vertices: &[Vec3; 3], ray: &Ray) -> Option<(f32, f32, f32)> {
        let [a, b, c] = vertices.map(|p| {
            let p = (p - self.o).to_array();
            let [x, y, z] = self.axes.map(|axis| p[axis]);
            Vec3::new(x - self.s.x * z, y - self.s.y * z, self.s.z * z)
        });
        let mut u = c.x * b.y - c.y * b.x;
        let mut v = a.x * c.y - a.y * c.x;
        let mut w = b.x * a.y - b.y * a.x;
        if u == 0.0 || v == 0.0 || w == 0.0 {
            // Which side of an edge only f64 can tell, where the products are exact.
            let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
            u = (c.x * b.y - c.y * b.x) as f32;
            v = (a.x * c.y - a.y * c.x) as f32;
            w = (b.x * a.y - b.y * a.x) as f32;
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let inverse = 1.0 / (u + v + w);
        let t = plane_distance(vertices, ray);
        // False for NaN as well: triangles of no area, or seen edge-on.
        (t > ray.t_min && t < ray.t_max).then_some((t, v * inverse, w * inverse))
    }
}
