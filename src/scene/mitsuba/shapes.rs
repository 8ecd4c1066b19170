//! Shapes, with their materials and area lights. Mesh files are read in parallel once all shapes are known.

use super::Loader;
use super::props::{Props, to_f32};
use super::xml::Pos;
use crate::scene::material::Material;
use crate::scene::pending::{Failure, Pending};
use crate::scene::place::{Placement, place};
use crate::scene::{obj, ply, serialized};
use crate::shape::{Cylinder, Disk, Mesh, Shape, Sphere};
use crate::texture::Color;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use std::path::PathBuf;

/// A shape, or what it takes to read it.
pub(super) enum Job {
    Ready(Shape),
    File { place: u32, format: Format, path: PathBuf, placement: Placement },
}

pub(super) enum Format {
    Obj { flip_v: bool },
    Ply { flip_v: bool },
    Serialized { index: u32 },
}

/// Reads all mesh files. The first error in scene order counts, whatever thread finds it.
pub(super) fn build(jobs: Vec<Job>) -> Result<Vec<Shape>, Failure> {
    let shapes: Vec<Result<Shape, Failure>> = jobs
        .into_par_iter()
        .map(|job| match job {
            Job::Ready(shape) => Ok(shape),
            Job::File { place, format, path, placement } => {
                read(format, path, &placement).map(Shape::Mesh).map_err(|error| (place, error))
            }
        })
        .collect();
    shapes.into_iter().collect()
}

fn read(format: Format, path: PathBuf, placement: &Placement) -> Result<Mesh> {
    let mesh = match format {
        Format::Obj { flip_v } => obj::Obj::read(&path, flip_v)?.mesh(),
        Format::Ply { flip_v } => ply::read(&path, flip_v)?,
        Format::Serialized { index } => serialized::read(&path, index)?,
    };
    if mesh.triangles.is_empty() {
        return Err(Error::File { file: path, message: "the mesh has no triangles".into() });
    }
    place(mesh, placement).map_err(|message| Error::File { file: path, message })
}

impl<'a> Loader<'a> {
    pub(super) fn shape(&mut self, props: Props<'a>) -> Result<()> {
        self.placed_shape(props, DAffine3::IDENTITY)
    }

    /// A shape as its own transform and then `outer` place it.
    fn placed_shape(&mut self, props: Props<'a>, outer: DAffine3) -> Result<()> {
        match props.plugin() {
            // Shows only where there are instances of it.
            "shapegroup" => {
                props.children()?;
                return props.finish();
            }
            "instance" => {
                let to_world = outer * props.to_world()?;
                let (group, pos) = self.only_child(props)?;
                if group.plugin() != "shapegroup" {
                    return Err(self.tree.error(pos, "an instance is one of a shapegroup"));
                }
                props.finish()?;
                return self.nested(group, |loader| loader.placed_children(group, to_world));
            }
            "merge" => {
                self.nested(props, |loader| loader.placed_children(props, outer))?;
                return props.finish();
            }
            _ => {}
        }
        let job = self.geometry(props, outer)?;
        let index = self.jobs.len() as u32;
        let (mut material, mut light) = (None, None);
        for name in ["interior", "exterior"] {
            if props.has(name) {
                return Err(props.error_at(name, "participating media are not supported"));
            }
        }
        let twice = |pos: Pos, what: &str| self.tree.error(pos, format!("a shape has only one {what}"));
        for (child, pos) in props.children()? {
            match child.object.tag.as_str() {
                "bsdf" if material.is_some() => return Err(twice(pos, "bsdf")),
                "bsdf" => material = Some(child),
                "emitter" if light.is_some() => return Err(twice(pos, "emitter")),
                "emitter" => light = Some(child),
                tag => {
                    return Err(self.tree.error(pos, format!("a <{tag}> inside a shape is not supported")));
                }
            }
        }
        let material = match material {
            Some(bsdf) => self.material(bsdf)?,
            None => self.default_material(light.is_some()),
        };
        if let Some(emitter) = light {
            let light = self.shape_light(emitter, index)?;
            self.lights.push(Pending::Ready(light));
            self.emitters.push((index, emitter));
        }
        // How Mitsuba differentiates silhouettes.
        props.opt_float("silhouette_sampling_weight")?;
        props.finish()?;
        if self.asks_for_attributes {
            self.attributes.push((index, props.object.pos, self.tree.mesh_attributes(props.index)));
        }
        self.jobs.push(job);
        self.shape_material.push(material);
        Ok(())
    }

    /// The shapes inside of a group.
    fn placed_children(&mut self, props: Props<'a>, outer: DAffine3) -> Result<()> {
        for (child, pos) in props.children()? {
            if child.object.tag != "shape" {
                let message = format!("{} cannot hold a <{}>", props.title(), child.object.tag);
                return Err(self.tree.error(pos, message));
            }
            self.placed_shape(child, outer)?;
        }
        Ok(())
    }

    fn only_child(&self, props: Props<'a>) -> Result<(Props<'a>, Pos)> {
        let children = props.children()?;
        match children[..] {
            [child] => Ok(child),
            _ => Err(props.error(format!("{} needs exactly one shapegroup", props.title()))),
        }
    }

    /// Mitsuba's diffuse default, made once: black for what emits, grey for the rest.
    fn default_material(&mut self, emits: bool) -> u32 {
        // No object has these indices.
        let (key, albedo) = if emits { (usize::MAX - 1, 0.0) } else { (usize::MAX, 0.5) };
        *self.material_of.entry(key).or_insert_with(|| {
            let reflectance = Color::Constant(crate::math::Rgb::splat(albedo));
            self.materials.push(Material::Diffuse { reflectance });
            self.materials.len() as u32 - 1
        })
    }

    fn geometry(&mut self, props: Props<'a>, outer: DAffine3) -> Result<Job> {
        let matrix = outer * props.to_world()?;
        let to_world = to_f32(matrix);
        let flip_normals = props.boolean("flip_normals", false)?;
        let fail = |message| props.error(message);
        let file = |loader: &mut Self, format| -> Result<Job> {
            let face_normals = props.boolean("face_normals", false)?;
            let path = loader.filename(props)?;
            Ok(Job::File {
                place: loader.next_file(),
                format,
                path,
                placement: Placement { to_world: matrix, flip_normals, face_normals },
            })
        };
        let vec3 = |name, default: DVec3| -> Result<glam::Vec3> {
            Ok(props.opt_vector(name)?.unwrap_or(default).as_vec3())
        };
        let flat = |mut mesh: Mesh| -> Result<Job> {
            props.boolean("face_normals", false)?;
            if flip_normals {
                mesh.flip();
            }
            Ok(Job::Ready(Shape::Mesh(mesh)))
        };
        match props.plugin() {
            "obj" => file(self, Format::Obj { flip_v: props.boolean("flip_tex_coords", true)? }),
            "ply" => file(self, Format::Ply { flip_v: props.boolean("flip_tex_coords", false)? }),
            "serialized" => {
                let index = props.count("shape_index", 0, 0..=u32::MAX)?;
                file(self, Format::Serialized { index })
            }
            "rectangle" => flat(Mesh::rectangle(to_world)),
            "cube" => flat(Mesh::cube(to_world)),
            "disk" => Disk::new(to_world, flip_normals).map(|s| Job::Ready(Shape::Disk(s))).map_err(fail),
            "sphere" => {
                let (center, radius) = (vec3("center", DVec3::ZERO)?, props.float("radius", 1.0)?);
                let sphere = Sphere::new(center, radius, to_world, flip_normals);
                sphere.map(|s| Job::Ready(Shape::Sphere(s))).map_err(fail)
            }
            "cylinder" => {
                let (p0, p1) = (vec3("p0", DVec3::ZERO)?, vec3("p1", DVec3::Z)?);
                let cylinder = Cylinder::new(p0, p1, props.float("radius", 1.0)?, to_world, flip_normals);
                cylinder.map(|s| Job::Ready(Shape::Cylinder(s))).map_err(fail)
            }
            "bsplinecurve" | "linearcurve" | "hair" | "sdfgrid" | "ellipsoids" | "ellipsoidsmesh"
            | "heightfield" | "deformable" | "blender" => {
                Err(props.error(format!("{} is not supported: export it as a mesh", props.title())))
            }
            _ => Err(props.unknown_plugin(
                "obj, ply, serialized, sphere, rectangle, disk, cube, cylinder, shapegroup, instance, merge",
            )),
        }
    }
}
