//! What every mesh goes through after its file is read: checks, transform, normals, orientation.

use crate::math::first_index;
use crate::shape::Mesh;
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use rayon::prelude::*;

/// How a scene places a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    /// The shape's own transform.
    pub to_world: DAffine3,
    /// Turn the surface around.
    pub flip_normals: bool,
    /// No vertex normals, whatever the file holds.
    pub face_normals: bool,
}

impl Placement {
    /// As the file has it.
    pub(super) const IDENTITY: Placement =
        Placement { to_world: DAffine3::IDENTITY, flip_normals: false, face_normals: false };
}

/// Brings a mesh from its file to the scene. As in Mitsuba, a mesh without normals gets smooth ones unless
/// `face_normals` forbids it.
///
/// # Errors
/// If an index or a coordinate is unusable.
pub(super) fn place(mut mesh: Mesh, placement: &Placement) -> Result<Mesh, String> {
    let count = mesh.positions.len();
    let names_nothing = |triangle: &[u32; 3]| triangle.iter().any(|&index| index as usize >= count);
    if let Some(i) = first_index(&mesh.triangles, names_nothing) {
        let index = mesh.triangles[i].iter().find(|&&index| index as usize >= count).unwrap_or(&0);
        return Err(format!("triangle {i} names vertex {index}, but there are only {count}"));
    }
    for (values, what) in [(mesh.normals.len(), "normals"), (mesh.uvs.len(), "texture coordinates")] {
        if values != 0 && values != count {
            return Err(format!("{count} vertices have {values} {what}"));
        }
    }
    for attribute in &mesh.attributes {
        let wanted = if attribute.of_vertices() { count } else { mesh.triangles.len() };
        if attribute.values.len() != wanted {
            let (name, values) = (&attribute.name, attribute.values.len());
            return Err(format!("the attribute '{name}' has {values} values, not {wanted}"));
        }
    }
    let has_normals = !mesh.normals.is_empty();
    let is_smooth = !has_normals && !placement.face_normals;
    transform(&mut mesh.positions, placement.to_world);
    if let Some(i) = first_index(&mesh.positions, |p| !p.is_finite()) {
        return Err(format!("vertex {i} is not finite"));
    }
    if placement.face_normals {
        mesh.normals = Vec::new();
    } else if is_smooth {
        mesh.normals = smooth_normals(&mesh.positions, &mesh.triangles);
    } else {
        transform_normals(&mut mesh, placement.to_world.matrix3);
        wind_by_normals(&mut mesh);
    }
    if placement.flip_normals {
        mesh.flip();
    }
    if is_faceted(&mesh) {
        mesh.normals = Vec::new();
    }
    Ok(mesh)
}

fn transform(positions: &mut [Vec3], to_world: DAffine3) {
    if to_world != DAffine3::IDENTITY {
        positions.par_iter_mut().for_each(|p| *p = to_world.transform_point3(p.as_dvec3()).as_vec3());
    }
}

/// Turns triangles around that the given normals see from behind: mirrored ones, and those that the file has clockwise.
/// Which side is the front, the normals say, as in Mitsuba.
fn wind_by_normals(mesh: &mut Mesh) {
    let Mesh { positions, normals, triangles, .. } = mesh;
    triangles.par_iter_mut().with_min_len(4096).for_each(|triangle| {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let given: Vec3 = triangle.iter().map(|&v| normals[v as usize]).sum();
        if (b - a).cross(c - a).dot(given) < 0.0 {
            triangle.swap(1, 2);
        }
    });
}

/// Normals of adjacent triangles weighted by their angles at the vertex (Thürmer & Wüthrich 1998, "Computing Vertex
/// Normals from Polygonal Facets").
fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let of_corners = |triangle: &[u32; 3]| {
        let p = triangle.map(|i| positions[i as usize]);
        let n = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
        [0, 1, 2].map(|k| {
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            if n == Vec3::ZERO { n } else { n * a.angle_between(b) }
        })
    };
    let mut normals = vec![Vec3::ZERO; positions.len()];
    // Angles cost most and are found in parallel; the sums are taken in the triangles' order.
    let mut corners = Vec::new();
    for triangles in triangles.chunks(1 << 18) {
        triangles.par_iter().map(of_corners).collect_into_vec(&mut corners);
        for (&i, n) in triangles.iter().flatten().zip(corners.iter().flatten()) {
            normals[i as usize] += *n;
        }
    }
    normals.par_iter_mut().for_each(|n| *n = n.try_normalize().unwrap_or(Vec3::Z));
    normals
}

/// Transforms normals to unit length; those that cannot be normalised are replaced by smooth ones.
fn transform_normals(mesh: &mut Mesh, to_world: DMat3) {
    if to_world != DMat3::IDENTITY {
        let to_world = to_world.inverse().transpose();
        mesh.normals.par_iter_mut().for_each(|n| *n = (to_world * n.as_dvec3()).as_vec3());
    }
    mesh.normals.par_iter_mut().for_each(|n| *n = n.normalize_or_zero());
    if first_index(&mesh.normals, |n| *n == Vec3::ZERO).is_some() {
        let smooth = smooth_normals(&mesh.positions, &mesh.triangles);
        for (n, s) in mesh.normals.iter_mut().zip(smooth) {
            if *n == Vec3::ZERO {
                *n = s;
            }
        }
    }
}

/// Whether the vertex normals equal the triangles' own but for rounding, so that interpolating them is wasted.
fn is_faceted(mesh: &Mesh) -> bool {
    let differs = |triangle: &[u32; 3]| {
        let Some(n) = mesh.area_vector_of(triangle).try_normalize() else { return false };
        !triangle.iter().all(|&v| mesh.normals[v as usize].distance_squared(n) < 1e-12)
    };
    mesh.normals.is_empty() || first_index(&mesh.triangles, differs).is_none()
}

/// Camera-like frame: z towards the target, x to the left. A zero `up` means any.
pub(super) fn look_at(origin: DVec3, target: DVec3, up: DVec3) -> Option<DMat4> {
    let dir = (target - origin).try_normalize()?;
    let up = if up == DVec3::ZERO { dir.any_orthonormal_vector() } else { up };
    let left = up.cross(dir).try_normalize()?;
    let up = dir.cross(left);
    Some(DMat4::from_cols(left.extend(0.0), up.extend(0.0), dir.extend(0.0), origin.extend(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    fn folded() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.5), Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    /// Expected values from Mitsuba 3.9.1.
    #[test]
    fn smooth_normals_are_those_of_mitsuba() {
        let mesh = place(folded(), &Placement::IDENTITY).unwrap();
        let expected = [
            Vec3::new(-0.2357, -0.2357, 0.9428),
            Vec3::new(0.0, -0.4472, 0.8944),
            Vec3::new(-0.2357, -0.2357, 0.9428),
            Vec3::new(-0.4472, 0.0, 0.8944),
        ];
        for (n, e) in mesh.normals.iter().zip(expected) {
            assert!(n.distance(e) < 1e-4, "{n} {e}");
        }
    }

    #[test]
    fn flat_meshes_lose_their_normals() {
        let mut mesh = folded();
        mesh.positions[2].z = 0.0;
        assert!(place(mesh, &Placement::IDENTITY).unwrap().normals.is_empty());
        let faceted = Placement { face_normals: true, ..Placement::IDENTITY };
        assert!(place(folded(), &faceted).unwrap().normals.is_empty());
    }

    /// Normals follow the inverse transpose, and the geometric normal stays on their side under any transform.
    #[test]
    fn orientation_follows_given_normals() {
        let bent = Mesh { normals: vec![Vec3::new(0.1, -0.1, 1.0).normalize(); 4], ..folded() };
        for scale in [DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, -3.0), DVec3::new(-1.0, -1.0, -1.0)] {
            for flip_normals in [false, true] {
                let placement =
                    Placement { to_world: DAffine3::from_scale(scale), flip_normals, ..Placement::IDENTITY };
                let mesh = place(bent.clone(), &placement).unwrap();
                let n = mesh.normals[0];
                assert!(mesh.area_vector(0).dot(n) > 0.0, "{scale} {flip_normals}");
                let expected = (DVec3::new(0.1, -0.1, 1.0) / scale).normalize().as_vec3();
                let expected = if flip_normals { -expected } else { expected };
                assert!(n.distance(expected) < 1e-6, "{scale}: {n} is not {expected}");
            }
        }
    }

    #[test]
    fn normals_say_which_side_is_the_front() {
        let mut mesh = Mesh { normals: vec![Vec3::new(0.1, -0.1, 1.0); 4], ..folded() };
        mesh.triangles[1].swap(0, 1);
        let mesh = place(mesh, &Placement::IDENTITY).unwrap();
        assert!((0..2).all(|i| mesh.area_vector(i).z > 0.0));
    }

    #[test]
    fn nonsense_is_refused() {
        let mut mesh = folded();
        mesh.triangles[1][2] = 4;
        assert!(place(mesh, &Placement::IDENTITY).is_err());
        let mut mesh = folded();
        mesh.positions[1].y = f32::NAN;
        assert!(place(mesh, &Placement::IDENTITY).is_err());
        let mesh = Mesh { uvs: vec![Vec2::ZERO], ..folded() };
        assert!(place(mesh, &Placement::IDENTITY).is_err());
        let huge = Placement { to_world: DAffine3::from_scale(DVec3::splat(1e39)), ..Placement::IDENTITY };
        assert!(place(folded(), &huge).is_err());
    }
}
