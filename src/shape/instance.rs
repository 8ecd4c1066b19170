//! Instances: what shows a group of shapes somewhere. Rays are brought into the group's space, their length as it is, so
//! that distances along them stay what they are; what is found there is brought back.

use super::{Bounds, Cylinder, Disk, Mesh, Shape, Sphere, SurfacePoint, padded, similar, similarity};
use crate::math::Ray;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// A group of shapes, placed by an affine transform.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Index into [`super::Geometry::groups`].
    pub group: u32,
    to_world: DAffine3,
    /// The inverse. In f64, as all that is done with both: however they stretch, a ray's start in the group's space is
    /// then as good as f32 can hold it.
    to_group: DAffine3,
}

impl Instance {
    /// The group moved by `to_world`, which must be invertible.
    pub fn new(group: u32, to_world: DAffine3) -> Instance {
        Instance { group, to_world, to_group: to_world.inverse() }
    }

    /// From the group's space to the world.
    pub fn to_world(&self) -> &DAffine3 {
        &self.to_world
    }

    /// Whether both directions are made of numbers.
    pub fn is_finite(&self) -> bool {
        self.to_world.is_finite() && self.to_group.is_finite()
    }

    /// A ray of the world in the group's space. Its direction is not normalised: points have the same distances on both.
    pub fn ray(&self, ray: &Ray) -> Ray {
        Ray {
            o: self.to_group.transform_point3(ray.o.as_dvec3()).as_vec3(),
            d: self.to_group.transform_vector3(ray.d.as_dvec3()).as_vec3(),
            ..*ray
        }
    }

    /// A surface point of the group in the world. Normals keep to their sides, also in a mirror, as in Mitsuba.
    pub fn point(&self, point: &SurfacePoint) -> SurfacePoint {
        let n_g = self.normal(point.n_g);
        let length = (self.bend() * point.n_g.as_dvec3()).length();
        let p = self.place(point.p);
        // The point is off by what it was off in the group, which along the normal is 1/length times as much here, and by
        // rounding here.
        let magnitude = p.abs().max_element() + (point.magnitude as f64 / length) as f32;
        SurfacePoint { p, magnitude, n_g, n_s: self.normal(point.n_s), uv: point.uv }
    }

    fn place(&self, p: Vec3) -> Vec3 {
        self.to_world.transform_point3(p.as_dvec3()).as_vec3()
    }

    /// What turns normals.
    fn bend(&self) -> DMat3 {
        self.to_group.matrix3.transpose()
    }

    fn normal(&self, n: Vec3) -> Vec3 {
        (self.bend() * n.as_dvec3()).try_normalize().map_or(n, |n| n.as_vec3())
    }

    /// A vector along the surface, in the world.
    pub fn vector(&self, v: Vec3) -> Vec3 {
        self.to_world.transform_vector3(v.as_dvec3()).as_vec3()
    }

    /// A box around what a box of the group becomes, with the same middle.
    pub fn bounds(&self, bounds: &Bounds) -> Bounds {
        if bounds.is_empty() {
            return Bounds::EMPTY;
        }
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let (center, extent) = ((min + max) * 0.5, (max - min) * 0.5);
        let m = &self.to_world.matrix3;
        let extent = m.x_axis.abs() * extent.x + m.y_axis.abs() * extent.y + m.z_axis.abs() * extent.z;
        padded(self.to_world.transform_point3(center), extent)
    }

    /// No vector gets longer by more than this factor; a similarity makes all of them as much longer.
    pub fn stretch(&self) -> f32 {
        // The largest eigenvalue is at most the largest sum of a row.
        let m = &self.to_world.matrix3;
        let gram = m.transpose() * *m;
        gram.to_cols_array_2d()
            .map(|row| row.iter().map(|x| x.abs()).sum())
            .into_iter()
            .fold(0.0, f64::max)
            .sqrt() as f32
    }
}

impl Shape {
    /// The same in the world, if that is a shape: spheres and cylinders may be stretched to something else, and numbers
    /// overflow.
    pub fn placed(&self, instance: &Instance) -> Option<Shape> {
        let vector = |v: Vec3| instance.to_world.transform_vector3(v.as_dvec3());
        let unit = |v: DVec3| v.normalize().as_vec3();
        let placed = match self {
            Shape::Mesh(mesh) => {
                let mut placed = Mesh {
                    positions: mesh.positions.par_iter().map(|&p| instance.place(p)).collect(),
                    normals: mesh.normals.par_iter().map(|&n| instance.normal(n)).collect(),
                    ..mesh.clone()
                };
                // Faces keep their sides in a mirror.
                if instance.to_world.matrix3.determinant() < 0.0 {
                    placed.reverse();
                }
                Shape::Mesh(placed)
            }
            Shape::Sphere(s) => {
                let m = instance.to_world.matrix3;
                let scale = similarity(&[m.x_axis, m.y_axis, m.z_axis])?;
                let frame = s.frame.as_dmat3();
                let axes = [frame.x_axis, frame.y_axis, frame.z_axis].map(|a| unit(m * a).to_array());
                Shape::Sphere(Sphere {
                    center: instance.place(s.center),
                    radius: (s.radius as f64 * scale) as f32,
                    frame: glam::Mat3::from_cols_array_2d(&axes),
                    flipped: s.flipped,
                })
            }
            Shape::Disk(d) => Shape::Disk(Disk {
                center: instance.place(d.center),
                u_axis: vector(d.u_axis).as_vec3(),
                v_axis: vector(d.v_axis).as_vec3(),
                n_g: instance.normal(d.n_g),
            }),
            Shape::Cylinder(c) => {
                let (x, y, axis) = (vector(c.x_axis), vector(c.y_axis), vector(c.axis));
                let across = |v: DVec3| v.dot(axis).abs() <= 1e-3 * (v.length() * axis.length());
                if !(similar(x, y) && across(x) && across(y)) {
                    return None;
                }
                Shape::Cylinder(Cylinder {
                    p0: instance.place(c.p0),
                    axis: axis.as_vec3(),
                    radius: (c.radius as f64 * (0.5 * x.length() + 0.5 * y.length())) as f32,
                    x_axis: unit(x),
                    y_axis: unit(y),
                    flipped: c.flipped,
                })
            }
        };
        let bounds = placed.bounds();
        (bounds.is_empty() || bounds.min.is_finite() && bounds.max.is_finite()).then_some(placed)
    }
}
