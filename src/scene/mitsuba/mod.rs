//! Mitsuba scenes, of version 3 or 0.6. [`xml`] knows the grammar, [`props`] types and use of parameters; the other modules know one kind
//! of plugin each.

mod bsdfs;
mod daylight;
mod disney;
mod emitters;
mod markup;
mod props;
mod refused;
mod sensor;
mod shapes;
mod textures;
mod upgrade;
mod xml;

#[cfg(test)]
mod lenient_tests;
#[cfg(test)]
mod old_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod texel_tests;

use super::pending::{Pending, unless_failed};
use super::{IntegratorParam, SceneDescription};
use super::{instances, mtl};
use crate::Result;
use crate::image_io::Domain;
use crate::light::Light;
use crate::scene::Material;
use crate::shape::{Bounds, Geometry, Instance};
use crate::texture::Texture;
use props::Props;
use sensor::Sensor;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use xml::{Property, Tree, Value};

/// Largest width or height of an image.
pub(super) const MAX_SIDE: u32 = 65_536;
/// References can make deeper objects than elements nest.
const MAX_DEPTH: u32 = 32;

/// Collects what goes into the scene. Materials and textures that several objects refer to are made once.
struct Loader<'a> {
    tree: &'a Tree,
    materials: Vec<Material>,
    material_of: HashMap<usize, u32>,
    /// By object, those inside of others included.
    made: HashMap<usize, Material>,
    textures: Vec<Pending<Texture>>,
    /// By object and how it is used.
    texture_of: HashMap<(usize, textures::Use), u32>,
    /// Files of textures that have one.
    bitmap_files: HashMap<u32, PathBuf>,
    /// What values of textures are checked for.
    texel_checks: BTreeMap<(u32, Domain), textures::TexelCheck>,
    lights: Vec<Pending<Light>>,
    /// Emitters that are lights, wherever they stand or are referred to.
    lit: HashSet<usize>,
    /// Shapes that are lights, and the light.
    emitters: Vec<(u32, Props<'a>)>,
    /// Names of all mesh attributes that anything looks up.
    attribute_names: Vec<String>,
    /// Shapes, and what attributes of meshes their materials and lights look up.
    attributes: Vec<(u32, Props<'a>, Vec<xml::Asked>)>,
    jobs: Vec<shapes::Job>,
    /// Shape groups that have instances.
    groups: Vec<Props<'a>>,
    instances: Vec<(Instance, Props<'a>)>,
    /// How many shapes are in groups and merges.
    nested_shapes: u32,
    /// How many files the scene has named so far.
    files: u32,
    shape_material: Vec<u32>,
    depth: u32,
}

/// What a scene holds besides materials, shapes and lights.
struct Outline {
    sensor: Option<Sensor>,
    /// Type and parameters; an empty type if there is none.
    integrator: (String, Vec<IntegratorParam>),
    /// Where the groups are among the shapes.
    groups: Vec<Range<u32>>,
}

/// Reads a Mitsuba scene.
pub(super) fn load(
    path: &Path,
    defines: &[(String, String)],
    size: Option<(u32, u32)>,
) -> Result<SceneDescription> {
    let tree = Tree::read(path, defines)?;
    let mut loader = Loader {
        tree: &tree,
        materials: Vec::new(),
        material_of: HashMap::new(),
        made: HashMap::new(),
        textures: Vec::new(),
        texture_of: HashMap::new(),
        bitmap_files: HashMap::new(),
        texel_checks: BTreeMap::new(),
        lights: Vec::new(),
        lit: HashSet::new(),
        emitters: Vec::new(),
        attribute_names: attribute_names(&tree),
        attributes: Vec::new(),
        jobs: Vec::new(),
        groups: Vec::new(),
        instances: Vec::new(),
        nested_shapes: 0,
        files: 0,
        shape_material: Vec::new(),
        depth: 0,
    };
    let walked = loader.walk(size);
    let walked = tree.unless_files_are_missing(walked)?;
    let Outline { sensor, integrator: (integrator, mut integrator_params), groups } = walked;
    let (camera, film, mut sample_count) = match sensor {
        Some(Sensor { camera, film, sample_count }) => (Some(camera), film, sample_count),
        None => {
            let message = "the scene has no <sensor>: all of it is seen from a little above, +y being up";
            tree.warn(tree.objects[0].pos, message);
            (None, sensor::default_film(size), sensor::DEFAULT_SAMPLES)
        }
    };
    // Mitsuba 0.6's progressive photon mappers count passes, not samples.
    if let Some(i) = integrator_params.iter().position(|p| p.name == "max_passes") {
        let passes = integrator_params.swap_remove(i).value;
        sample_count = passes.parse().ok().filter(|n| *n > 0).unwrap_or(sample_count);
    }
    let (shapes, (textures, lights)) = rayon::join(
        || shapes::build(loader.jobs, &loader.attribute_names),
        || rayon::join(|| Pending::all(loader.textures), || Pending::all(loader.lights)),
    );
    let mut failures = Vec::new();
    let (shapes, mesh_warnings) = unless_failed(shapes, &mut failures);
    let textures = unless_failed(textures, &mut failures);
    let lights = unless_failed(lights, &mut failures);
    if let Some((_, error)) = failures.into_iter().min_by_key(|failure| failure.0) {
        return Err(error);
    }
    let checks = textures::Checks {
        tree: &tree,
        textures: &textures,
        texture_of: &loader.texture_of,
        files: &loader.bitmap_files,
        checks: &loader.texel_checks,
    };
    checks.bitmaps()?;
    for (shape, props, asked) in &loader.attributes {
        checks.attributes(&shapes[*shape as usize], *props, asked)?;
    }
    for (shape, emitter) in loader.emitters {
        let area = shapes[shape as usize].area();
        if area.is_nan() || area <= 0.0 {
            return Err(emitter.error("this light's shape has no area, so it cannot shine: remove the light"));
        }
    }
    let (instances, at): (Vec<_>, Vec<_>) = loader.instances.into_iter().unzip();
    let mut geometry = Geometry { shapes, groups, instances };
    let overflows = |b: &Bounds| !(b.is_empty() || b.min.is_finite() && b.max.is_finite());
    if let Some(i) = geometry.instance_bounds().iter().position(overflows) {
        return Err(at[i].error("the instance is out of the range of numbers: scale or move it less"));
    }
    let mut shape_material = loader.shape_material;
    instances::copy_small(&mut geometry, &mut shape_material);
    let bounds = geometry.bounds();
    Ok(SceneDescription {
        geometry,
        shape_material,
        materials: loader.materials,
        textures,
        lights,
        camera: camera.unwrap_or_else(|| mtl::camera(bounds, film.size.0 as f32 / film.size.1 as f32)),
        film,
        sample_count,
        integrator,
        integrator_params,
        warnings: tree.take_warnings().into_iter().chain(mesh_warnings).collect(),
    })
}

/// Integrators around others: statistics, polarisation, and what steers how others sample.
const WRAPPERS: [&str; 6] = ["moment", "aov", "stokes", "irrcache", "adaptive", "multichannel"];

/// Integrators that transport light.
#[rustfmt::skip]
const INTEGRATORS: [&str; 21] = [
    "photonmap", "path", "direct", "ptracer", "volpath", "volpathmis", "prb", "prb_basic", "prb_projective", "prbvolpath",
    "direct_projective", "volprim_rf_basic", "photonmapper", "ppm", "sppm", "vpl", "volpath_simple", "bdpt", "pssmlt", "mlt",
    "erpt",
];

/// Integrators that show something else.
const LIGHTLESS: [&str; 4] = ["depth", "ao", "field", "motion"];

/// Parameters of Mitsuba's integrators that only steer how it samples.
const UNUSED_INTEGRATOR_PARAMETERS: [&str; 6] =
    ["block_size", "samples_per_pass", "timeout", "shading_samples", "emitter_samples", "bsdf_samples"];

/// Names of all mesh attributes that textures look up.
fn attribute_names(tree: &Tree) -> Vec<String> {
    let mut names: Vec<_> =
        tree.objects.iter().filter_map(|o| o.mesh_attribute()).map(String::from).collect();
    names.sort_unstable();
    names.dedup();
    names
}

impl<'a> Loader<'a> {
    fn warn_at(&self, pos: xml::Pos, message: &str) {
        self.tree.warn(pos, message);
    }

    /// Goes through everything inside the scene.
    fn walk(&mut self, size: Option<(u32, u32)>) -> Result<Outline> {
        let scene = Props::new(self.tree, 0);
        let (mut sensor, mut integrator) = (None, None);
        let (mut seen, mut lamps) = (HashSet::new(), Vec::new());
        let wrapped = self.wrapped_integrators();
        for (child, pos) in scene.children()? {
            match child.object.tag.as_str() {
                "shape" => self.shape(child)?,
                "emitter" if emitters::of_shapes(child.plugin()) => lamps.push(child),
                "emitter" => self.emitter(child)?,
                // What a reference names again.
                "sensor" | "integrator" if !seen.insert(child.index) => {}
                "sensor" if sensor.is_some() => {
                    self.warn_at(pos, "a scene with several sensors is rendered with the first");
                }
                "sensor" => sensor = Some(self.sensor(child, size)?),
                "integrator" if wrapped.contains(&child.index) => {}
                "integrator" if integrator.is_some() => {
                    self.warn_at(pos, "a second integrator is ignored");
                }
                "integrator" => integrator = Some(self.integrator(child)?),
                // Made where something refers to them.
                "bsdf" | "texture" | "medium" | "volume" | "phase" | "subsurface" | "film" | "sampler"
                | "rfilter" => {}
                tag => return Err(child.error(format!("<{tag}> cannot stand inside <scene>"))),
            }
        }
        let groups = self.grouped_shapes()?;
        for lamp in lamps.iter().filter(|lamp| !self.lit.contains(&lamp.index)) {
            let message = format!("{} shines only inside a shape, and no shape refers to it", lamp.title());
            self.warn_at(lamp.object.pos, &message);
        }
        // Named textures and media at the top are definitions like the rest.
        for property in scene.unused().filter(|p| matches!(p.value, Value::Object(_))) {
            property.used.set(true);
        }
        scene.finish()?;
        Ok(Outline { sensor, integrator: integrator.unwrap_or_default(), groups })
    }

    /// Integrators that others hold or refer to.
    fn wrapped_integrators(&self) -> HashSet<usize> {
        let integrators = self.tree.objects.iter().enumerate().filter(|(_, o)| o.tag == "integrator");
        let inside = integrators.flat_map(|(outer, object)| {
            let inner = object.properties.iter().filter_map(|p| self.tree.object_of(&p.value));
            inner.filter(move |inner| *inner != outer)
        });
        inside.collect()
    }

    /// The place of one more file in the scene.
    fn next_file(&mut self) -> u32 {
        self.files += 1;
        self.files
    }

    /// Guards recursion through references.
    fn nested<T>(&mut self, props: Props<'a>, make: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(props.error(format!("{} contains itself", props.title())));
        }
        let made = make(self);
        self.depth -= 1;
        made
    }

    /// Type and parameters of the integrator inside all wrappers.
    fn integrator(&mut self, props: Props<'a>) -> Result<(String, Vec<IntegratorParam>)> {
        let plugin = props.plugin();
        let children = props.children()?;
        let inner = children.iter().map(|(child, _)| *child).find(|c| c.object.tag == "integrator");
        let is_known = INTEGRATORS.contains(&plugin) || LIGHTLESS.contains(&plugin);
        if WRAPPERS.contains(&plugin) || !is_known && inner.is_some() {
            if !WRAPPERS.contains(&plugin) {
                let message = props.instead("what it wraps is rendered", &WRAPPERS);
                self.warn_at(props.object.pos, &message);
            } else if props.object.old || plugin == "stokes" {
                let message = format!("{} has no effect but for what it wraps", props.title());
                self.warn_at(props.object.pos, &message);
            }
            return match inner {
                Some(inner) => self.nested(inner, |loader| loader.integrator(inner)),
                None => Err(props.error(format!("{} contains no integrator", props.title()))),
            };
        }
        if LIGHTLESS.contains(&plugin) {
            let message = format!(
                "{} shows no light, but light is rendered here: --aovs writes depth, normals and more",
                props.title()
            );
            self.warn_at(props.object.pos, &message);
        } else if !is_known {
            // Research code has many more, and photon mapping renders what they do.
            let known = [&INTEGRATORS[..], &LIGHTLESS, &WRAPPERS].concat();
            self.warn_at(props.object.pos, &props.instead("rendered by photon mapping", &known));
        }
        let mut params = Vec::new();
        for property in &props.object.properties {
            let Property { name, value, pos, .. } = property;
            let value = match value {
                Value::Float(v) => v.to_string(),
                Value::Integer(v) => v.to_string(),
                Value::Boolean(v) => v.to_string(),
                Value::String(v) => v.clone(),
                _ => String::new(),
            };
            if value.is_empty() || UNUSED_INTEGRATOR_PARAMETERS.contains(&name.as_str()) {
                self.tree.warn_ignored(&props.title(), property);
                continue;
            }
            let file = self.tree.file(*pos).into();
            params.push(IntegratorParam { name: name.clone(), value, file, line: pos.line });
        }
        // Mitsuba's `direct` shows what lights emit and what one bounce makes of it.
        if plugin == "direct" && !params.iter().any(|p| p.name == "max_depth") {
            let (file, line) = (self.tree.file(props.object.pos).into(), props.object.pos.line);
            params.push(IntegratorParam { name: "max_depth".into(), value: "2".into(), file, line });
        }
        Ok((plugin.to_string(), params))
    }
}
