//! Which instances are worth it: small groups are copied instead. Photons then know where flat surfaces end, and what overlaps
//! is sorted by the builder, without which rays that meet ten instances at once take twice the time.

use crate::shape::{Geometry, Instance, Shape};
use rayon::prelude::*;
use std::ops::Range;

/// Copies of a group may hold so many primitives in all: some 50 MB.
const MAX_COPIED: usize = 1 << 18;

/// Puts copies in the place of instances where they are few or small, as far as a copy is a shape at all.
pub(super) fn copy_small(geometry: &mut Geometry, shape_material: &mut Vec<u32>) {
    let Geometry { shapes, groups, instances } = std::mem::take(geometry);
    let mut uses = vec![0usize; groups.len()];
    instances.iter().for_each(|i| uses[i.group as usize] += 1);
    let size = |shape: &Shape| if let Shape::Mesh(mesh) = shape { mesh.triangles.len() } else { 1 };
    let sizes: Vec<usize> =
        groups.iter().map(|g| shapes[g.start as usize..g.end as usize].iter().map(size).sum()).collect();
    let pays = |i: &Instance| {
        uses[i.group as usize] == 1 || uses[i.group as usize] * sizes[i.group as usize] <= MAX_COPIED
    };
    let copy = |instance: &Instance| {
        let Range { start, end } = groups[instance.group as usize];
        let copies = || shapes[start as usize..end as usize].par_iter().map(|s| s.placed(instance)).collect();
        pays(instance).then(copies).flatten()
    };
    let copies: Vec<Option<Vec<Shape>>> = instances.par_iter().map(copy).collect();

    let world = groups.first().map_or(shapes.len(), |group| group.start as usize);
    let mut own = shapes;
    let mut grouped: Vec<Option<Shape>> = own.drain(world..).map(Some).collect();
    let materials = shape_material.split_off(world);
    for (instance, copies) in instances.into_iter().zip(copies) {
        match copies {
            Some(copies) => {
                let Range { start, end } = groups[instance.group as usize];
                own.extend(copies);
                shape_material.extend(&materials[start as usize - world..end as usize - world]);
            }
            None => geometry.instances.push(instance),
        }
    }
    // What is left, numbered anew.
    let mut has_instances = vec![false; groups.len()];
    geometry.instances.iter().for_each(|i| has_instances[i.group as usize] = true);
    let mut numbers = vec![0; groups.len()];
    for (old, group) in groups.into_iter().enumerate().filter(|(old, _)| has_instances[*old]) {
        numbers[old] = geometry.groups.len() as u32;
        let start = own.len() as u32;
        for i in group.map(|i| i as usize - world) {
            own.extend(grouped[i].take());
            shape_material.push(materials[i]);
        }
        geometry.groups.push(start..own.len() as u32);
    }
    geometry.instances.iter_mut().for_each(|i| i.group = numbers[i.group as usize]);
    geometry.shapes = own;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::place::{Placement, place};
    use crate::shape::{Mesh, Sphere};
    use glam::{Affine3A, DAffine3, DVec3, Vec3};

    fn at(group: u32, scale: DVec3, x: f64) -> Instance {
        Instance::new(group, DAffine3::from_translation(DVec3::X * x) * DAffine3::from_scale(scale))
    }

    /// A mesh of this many triangles.
    fn mesh(triangles: usize) -> Shape {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        Shape::Mesh(Mesh { positions, triangles: vec![[0, 1, 2]; triangles], ..Mesh::default() })
    }

    #[test]
    fn what_is_small_is_copied() {
        let ball = Shape::Sphere(Sphere::new(Vec3::ZERO, 1.0, Affine3A::IDENTITY, false).unwrap());
        let stretched = DVec3::new(1.0, 2.0, 1.0);
        // The world; a group for each case: large, empty, of one use, small with a sphere.
        let shapes = vec![mesh(1), mesh(MAX_COPIED), mesh(MAX_COPIED + 1), mesh(3), ball];
        let groups = vec![1..2, 2..2, 2..3, 3..5];
        let instances = [
            (0, DVec3::ONE),
            (3, stretched),
            (1, DVec3::ONE),
            (0, DVec3::ONE),
            (2, DVec3::ONE),
            (3, -DVec3::ONE),
        ];
        let instances = (0..).zip(instances).map(|(i, (group, scale))| at(group, scale, i as f64)).collect();
        let mut geometry = Geometry { shapes, groups, instances };
        let mut materials = vec![10, 11, 12, 13, 14];
        copy_small(&mut geometry, &mut materials);
        assert_eq!(materials, [10, 12, 13, 14, 11, 13, 14]);
        assert_eq!(geometry.groups, [4..5, 5..7]);
        let left: Vec<_> = geometry.instances.iter().map(|i| (i.group, i.to_world().translation.x)).collect();
        assert_eq!(left, [(0, 0.0), (1, 1.0), (0, 3.0)]);
        let Shape::Sphere(copy) = &geometry.shapes[3] else { panic!() };
        assert_eq!((copy.center, copy.radius, copy.flipped), (Vec3::X * 5.0, 1.0, false));
        let Shape::Mesh(copy) = &geometry.shapes[1] else { panic!() };
        assert!(copy.triangles.len() == MAX_COPIED + 1 && copy.positions[0] == Vec3::X * 4.0);
    }

    /// Mitsuba transforms what is in an instance with its normals, which it has without the instance.
    #[test]
    fn instances_keep_sides_and_normals() {
        let folded = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.5), Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let to_world = DAffine3::from_rotation_x(0.3) * DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0));
        for scale in [DVec3::new(1.0, 1.0, 4.0), DVec3::new(-1.0, 2.0, 0.5)] {
            let instance = DAffine3::from_rotation_y(1.0) * DAffine3::from_scale(scale);
            for face_normals in [false, true] {
                let own = Placement { to_world, face_normals, ..Placement::IDENTITY };
                let alone = place(folded.clone(), &own).unwrap();
                let placed = Shape::Mesh(alone.clone()).placed(&Instance::new(0, instance));
                let Some(Shape::Mesh(mesh)) = placed else { panic!() };
                let bend = instance.matrix3.inverse().transpose();
                let bent = |n: Vec3| (bend * n.as_dvec3()).normalize().as_vec3();
                assert_eq!(mesh.normals.is_empty(), face_normals);
                for (n, own) in mesh.normals.iter().zip(&alone.normals) {
                    assert!(n.distance(bent(*own)) < 1e-5, "{n} is not {}", bent(*own));
                }
                for t in 0..2 {
                    let n = mesh.area_vector(t).normalize();
                    assert!(n.distance(bent(alone.area_vector(t))) < 1e-5, "{scale} {face_normals}");
                }
                let p = instance.transform_point3(to_world.transform_point3(DVec3::new(1.0, 1.0, 0.5)));
                assert!(mesh.positions[2].distance(p.as_vec3()) < 1e-6);
            }
        }
    }
}
