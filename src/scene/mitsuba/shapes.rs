//! Shapes, with their materials and area lights. Mesh files are read in parallel once all shapes are known.

use super::Loader;
use super::props::{Props, to_f32};
use super::xml::Pos;
use crate::scene::material::Material;
use crate::scene::pending::Failure;
use crate::scene::place::{Placement, place};
use crate::scene::{obj, ply, serialized};
use crate::shape::{Cylinder, Disk, Instance, Mesh, Shape, Sphere, similarity};
use crate::texture::Color;
use crate::{Error, Result};
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec2};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::path::PathBuf;

/// Children of groups and merges.
const MAX_NESTED: u32 = 1 << 20;

/// A shape, or what it takes to read it.
pub(super) enum Job {
    Ready(Shape),
    File { place: u32, format: Format, path: PathBuf, placement: Placement },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Format {
    Obj { flip_v: bool },
    Ply { flip_v: bool, colors: ply::Colors },
    Serialized { index: u32 },
}

/// A mesh file, and all shapes that are made of it: their indices, places among the scene's files, and placements.
struct MeshFile {
    format: Format,
    path: PathBuf,
    uses: Vec<(usize, u32, Placement)>,
}

/// Reads all mesh files, each once, and keeps the attributes of these names. The first error in scene order counts,
/// whatever thread finds it. Warnings come with the shapes.
pub(super) fn build(jobs: Vec<Job>, attributes: &[String]) -> Result<(Vec<Shape>, Vec<String>), Failure> {
    let mut shapes: Vec<Option<Shape>> = Vec::with_capacity(jobs.len());
    let mut files: Vec<MeshFile> = Vec::new();
    let mut file_of = HashMap::new();
    for (index, job) in jobs.into_iter().enumerate() {
        let (place, format, path, placement) = match job {
            Job::Ready(shape) => {
                shapes.push(Some(shape));
                continue;
            }
            Job::File { place, format, path, placement } => (place, format, path, placement),
        };
        shapes.push(None);
        let file = *file_of.entry((format, path.clone())).or_insert(files.len());
        if file == files.len() {
            files.push(MeshFile { format, path, uses: Vec::new() });
        }
        files[file].uses.push((index, place, placement));
    }
    let made: Vec<_> = files.into_par_iter().map(|file| file.shapes(attributes)).collect();
    let mut first: Option<Failure> = None;
    let mut warnings = Vec::new();
    for made in made {
        match made {
            Ok((placed, warning)) => {
                placed.into_iter().for_each(|(index, shape)| shapes[index] = Some(shape));
                warnings.extend(warning);
            }
            Err(failure) if first.as_ref().is_none_or(|(place, _)| failure.0 < *place) => {
                first = Some(failure)
            }
            Err(_) => {}
        }
    }
    first.map_or_else(|| Ok((shapes.into_iter().flatten().collect(), warnings)), Err)
}

/// A file's shapes, with their indices, and what users are told of it.
type Placed = (Vec<(usize, Shape)>, Option<String>);

impl MeshFile {
    fn shapes(mut self, attributes: &[String]) -> Result<Placed, Failure> {
        let Some(last) = self.uses.pop() else { return Ok((Vec::new(), None)) };
        let first = self.uses.first().map_or(last.1, |u| u.1);
        let (mesh, warning) = self.read(attributes).map_err(|error| (first, error))?;
        let placed = |mesh, (index, at, placement): &(usize, u32, Placement)| match place(mesh, placement) {
            Ok(mesh) => Ok((*index, Shape::Mesh(mesh))),
            Err(message) => Err((*at, Error::File { file: self.path.clone(), message })),
        };
        let copies: Vec<_> = self.uses.par_iter().map(|u| placed(mesh.clone(), u)).collect();
        // The last one needs no copy.
        let all: Result<Vec<_>, Failure> = copies.into_iter().chain([placed(mesh, &last)]).collect();
        Ok((all?, warning))
    }

    fn read(&self, attributes: &[String]) -> Result<(Mesh, Option<String>)> {
        let (mesh, warning) = match self.format {
            Format::Obj { flip_v } => {
                let obj = obj::Obj::read(&self.path, flip_v)?;
                (obj.mesh(), obj.warning(&self.path))
            }
            Format::Ply { flip_v, colors } => {
                ply::read(&self.path, &ply::Options { flip_v, colors, attributes })?
            }
            Format::Serialized { index } => (serialized::read(&self.path, index, attributes)?, None),
        };
        if mesh.triangles.is_empty() {
            return Err(Error::File { file: self.path.clone(), message: "the mesh has no triangles".into() });
        }
        Ok((mesh, warning))
    }
}

impl<'a> Loader<'a> {
    pub(super) fn shape(&mut self, props: Props<'a>) -> Result<()> {
        self.shape_of(props, false)
    }

    /// The groups that instances are of. They come last, as in [`crate::shape::Geometry`].
    pub(super) fn grouped_shapes(&mut self) -> Result<Vec<Range<u32>>> {
        let groups = std::mem::take(&mut self.groups);
        let of_group = |group: Props<'a>| {
            let start = self.jobs.len() as u32;
            // The group itself may have been met since an instance has named it.
            let group = Props::new(self.tree, group.index);
            self.nested(group, |loader| loader.shapes_of(group, true))?;
            Ok(start..self.jobs.len() as u32)
        };
        groups.into_iter().map(of_group).collect()
    }

    /// A shape, perhaps of a group.
    fn shape_of(&mut self, props: Props<'a>, in_group: bool) -> Result<()> {
        // A shape that others refer to is read again each time.
        let props = Props::new(self.tree, props.index);
        match props.plugin() {
            // As in Mitsuba.
            "shapegroup" | "instance" if in_group => {
                return Err(props.error(format!("a shapegroup cannot hold another {}", props.plugin())));
            }
            // Shows only where there are instances of it.
            "shapegroup" => {
                props.children()?;
                return props.finish();
            }
            "instance" => {
                let to_world = props.invertible("to_world", props.to_world()?)?;
                let (group, pos) = self.only_child(props)?;
                if group.plugin() != "shapegroup" {
                    return Err(self.tree.error(pos, "an instance is one of a shapegroup"));
                }
                props.finish()?;
                let same = |known: &Props| known.index == group.index;
                let index = self.groups.iter().position(same).unwrap_or(self.groups.len());
                if index == self.groups.len() {
                    self.groups.push(group);
                }
                self.instances.push((Instance::new(index as u32, to_world), props));
                return Ok(());
            }
            "merge" => {
                self.nested(props, |loader| loader.shapes_of(props, in_group))?;
                return props.finish();
            }
            _ => {}
        }
        let job = self.geometry(props)?;
        let index = self.jobs.len() as u32;
        let (mut material, mut light) = (None, None);
        props.refuse_media()?;
        let twice = |pos: Pos, what: &str| self.tree.error(pos, format!("a shape has only one {what}"));
        for (child, pos) in props.children()? {
            match child.object.tag.as_str() {
                "bsdf" if material.is_some() => return Err(twice(pos, "bsdf")),
                "bsdf" => material = Some(child),
                "emitter" if in_group => {
                    return Err(self.tree.error(pos, "lights inside of a shapegroup are not supported"));
                }
                "emitter" if light.is_some() => return Err(twice(pos, "emitter")),
                "emitter" => light = Some(child),
                _ => return Err(child.misplaced("shape", pos)),
            }
        }
        let material = match material {
            Some(bsdf) => self.material(bsdf)?,
            None => self.default_material(light.is_some()),
        };
        if let Some(emitter) = light {
            self.shape_light(emitter, index)?;
        }
        // How Mitsuba differentiates silhouettes.
        props.opt_float("silhouette_sampling_weight")?;
        props.finish()?;
        if !self.attribute_names.is_empty() {
            self.attributes.push((index, props, self.tree.mesh_attributes(props.index)));
        }
        self.jobs.push(job);
        self.shape_material.push(material);
        Ok(())
    }

    /// The shapes inside of a group or merge.
    fn shapes_of(&mut self, props: Props<'a>, in_group: bool) -> Result<()> {
        for (child, pos) in props.children()? {
            // Merges may refer to shapes, and merges of merges to more than memory holds.
            self.nested_shapes += 1;
            if self.nested_shapes > MAX_NESTED {
                let message = format!("groups and merges hold more than {MAX_NESTED} shapes");
                return Err(self.tree.error(pos, message));
            }
            if child.object.tag != "shape" {
                let message = format!("{} cannot hold a <{}>", props.title(), child.object.tag);
                return Err(self.tree.error(pos, message));
            }
            self.shape_of(child, in_group)?;
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

    fn geometry(&mut self, props: Props<'a>) -> Result<Job> {
        let exact = props.invertible("to_world", props.to_world()?)?;
        let to_world = to_f32(exact);
        let flip_normals = props.boolean("flip_normals", false)?;
        let fail = |message| props.error(message);
        let file = |loader: &mut Self, format| -> Result<Job> {
            let face_normals = props.boolean("face_normals", false)?;
            let path = loader.filename(props)?;
            Ok(Job::File {
                place: loader.next_file(),
                format,
                path,
                placement: Placement { to_world: exact, flip_normals, face_normals },
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
            "ply" => {
                let flip_v = props.boolean("flip_tex_coords", false)?;
                let colors = match props.object.old {
                    false => ply::Colors::SrgbIntegers,
                    true if props.boolean("srgb", true)? => ply::Colors::Srgb,
                    true => ply::Colors::Linear,
                };
                file(self, Format::Ply { flip_v, colors })
            }
            "serialized" => {
                let index = props.count("shape_index", 0, 0..=u32::MAX)?;
                file(self, Format::Serialized { index })
            }
            "rectangle" => flat(Mesh::rectangle(to_world)),
            "cube" => flat(Mesh::cube(to_world)),
            "disk" => Disk::new(to_world, flip_normals).map(|s| Job::Ready(Shape::Disk(s))).map_err(fail),
            "sphere" => {
                let (center, radius) = (vec3("center", DVec3::ZERO)?, props.float("radius", 1.0)?);
                let kept = kept_round(exact, center.as_dvec3());
                if kept.is_some() {
                    let message = "a sphere is neither sheared nor stretched: it stays one, as in Mitsuba, and the \
                                   length of the transform's first column scales its radius";
                    self.warn_at(props.pos("to_world"), message);
                }
                let sphere = Sphere::new(center, radius, kept.map_or(to_world, to_f32), flip_normals);
                sphere.map(|s| Job::Ready(Shape::Sphere(s))).map_err(fail)
            }
            "cylinder" => {
                let (p0, p1) = (vec3("p0", DVec3::ZERO)?, vec3("p1", DVec3::Z)?);
                let radius = props.float("radius", 1.0)?;
                let own = Cylinder::new(p0, p1, radius, Affine3A::IDENTITY, false).map_err(fail)?;
                if let Ok(cylinder) = Cylinder::new(p0, p1, radius, to_world, flip_normals) {
                    return Ok(Job::Ready(Shape::Cylinder(cylinder)));
                }
                let message =
                    format!("a cylinder that is sheared or stretched is made of {SIDES} flat sides");
                self.warn_at(props.pos("to_world"), &message);
                let placement = Placement { to_world: exact, flip_normals, face_normals: false };
                place(tube(&own), &placement).map(|mesh| Job::Ready(Shape::Mesh(mesh))).map_err(fail)
            }
            _ => Err(props.unknown_plugin(
                "obj, ply, serialized, sphere, rectangle, disk, cube, cylinder, shapegroup, instance, merge",
            )),
        }
    }
}

/// A transform of the sphere around `center` that Mitsuba shows where the given one shears or stretches: its middle
/// goes where it should, its radius is scaled by the length of the first column. `None` if it stays a sphere
/// anyway.
fn kept_round(to_world: DAffine3, center: DVec3) -> Option<DAffine3> {
    let (m, rounded) = (to_world.matrix3, to_f32(to_world).matrix3);
    if similarity(&[rounded.x_axis, rounded.y_axis, rounded.z_axis].map(|a| a.as_dvec3())).is_some() {
        return None;
    }
    let x = m.x_axis.try_normalize()?;
    let y = m.y_axis.reject_from_normalized(x).try_normalize()?;
    let turned = DMat3::from_cols(x, y, x.cross(y) * m.determinant().signum()) * m.x_axis.length();
    let middle = to_world.transform_point3(center);
    Some(DAffine3 { matrix3: turned, translation: middle - turned * center })
}

/// Sides of a cylinder that is a mesh: they leave it by 1/10000 of its radius.
const SIDES: u32 = 256;

fn tube(cylinder: &Cylinder) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=SIDES {
        let u = i as f32 / SIDES as f32;
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        let outward = cylinder.x_axis * cos + cylinder.y_axis * sin;
        for v in [0.0, 1.0] {
            mesh.positions.push(cylinder.p0 + cylinder.axis * v + outward * cylinder.radius);
            mesh.normals.push(outward);
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    mesh.triangles = (0..SIDES).map(|i| 2 * i).flat_map(|i| [[i, i + 2, i + 3], [i, i + 3, i + 1]]).collect();
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn faces_without_a_surface_are_told_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        let placement = Placement::IDENTITY;
        let job =
            |place| Job::File { place, format: Format::Obj { flip_v: true }, path: path.clone(), placement };
        fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1 2 3\n").unwrap();
        let (shapes, warnings) = build(vec![job(0), job(1)], &[]).unwrap();
        assert_eq!((shapes.len(), warnings.len()), (2, 1));
        assert!(warnings[0].contains("1 face has fewer than three corners"), "{warnings:?}");
        fs::write(&path, "v 0 0 0\nv 1 0 0\nf 1 2\n").unwrap();
        let (place, error) = build(vec![job(3), job(5)], &[]).unwrap_err();
        assert_eq!(place, 3);
        assert!(error.to_string().contains("the mesh has no triangles"), "{error}");
    }
}
