//! A scene owns everything by `Vec` and names it by `u32` index. Loaders fill a [`SceneDescription`]; [`Scene::new`]
//! builds the acceleration structure and prepares the lights.

mod blocks;
mod daylight;
mod fingerprint;
mod instances;
mod ior;
mod lines;
mod load;
mod material;
mod mitsuba;
mod mtl;
mod obj;
mod pending;
mod place;
mod ply;
mod polygon;
mod serialized;
mod spectrum;

pub use load::load;
pub use material::{Lobes, Material, Roughness, Site};

use crate::accel::{self, Backend, Intersector};
use crate::bsdf::Bsdf;
use crate::camera::Camera;
use crate::film::FilmSettings;
use crate::light::{Light, Lights, Targets};
use crate::math::{Frame, Ray, Rgb, Sampler, offset_origin};
use crate::shape::{Bounds, Facet, Facets, Geometry, Hit, Shape, Wanted};
use crate::texture::{Lookup, Texture};
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use std::path::PathBuf;

/// What a scene file says, with meshes and textures loaded.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// All shapes.
    pub geometry: Geometry,
    /// For each shape its material.
    pub shape_material: Vec<u32>,
    /// Materials; shapes name them by index.
    pub materials: Vec<Material>,
    /// Textures; materials and lights name them by index.
    pub textures: Vec<Texture>,
    /// Lights; area lights name their shape.
    pub lights: Vec<Light>,
    /// The camera.
    pub camera: Camera,
    /// Size, crop and reconstruction filter.
    pub film: FilmSettings,
    /// Samples per pixel that the file asks for.
    pub sample_count: u32,
    /// Type of the integrator that the file names, innermost of wrappers; empty if none.
    pub integrator: String,
    /// Its parameters, as (name, value, file, line): the integrator understands or refuses them.
    pub integrator_params: Vec<IntegratorParam>,
    /// What the file asks for and is ignored, ready to print.
    pub warnings: Vec<String>,
}

/// One parameter of the scene's integrator.
#[derive(Clone, Debug)]
pub struct IntegratorParam {
    /// Name as in the file.
    pub name: String,
    /// Value as text.
    pub value: String,
    /// Where it stands.
    pub file: PathBuf,
    /// Its line, from 1.
    pub line: u32,
}

/// A scene ready to be rendered.
pub struct Scene {
    /// All shapes.
    pub geometry: Geometry,
    /// Textures.
    pub textures: Vec<Texture>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Lights.
    pub lights: Lights,
    /// The camera.
    pub camera: Camera,
    /// Size, crop and filter.
    pub film: FilmSettings,
    /// Bounds of all shapes.
    pub bounds: Bounds,
    /// Everything, for aiming photons.
    pub targets: Targets,
    /// Everything that has sharp lobes, for aiming caustic photons.
    pub casters: Targets,
    facets: Facets,
    shape_material: Vec<u32>,
    shape_light: Vec<Option<u32>>,
    shape_wanted: Vec<Wanted>,
    /// Whether it has holes.
    shape_holes: Vec<bool>,
    has_holes: bool,
    intersector: Box<dyn Intersector>,
}

/// A shading point: everything that scattering at a hit needs.
#[derive(Clone)]
pub struct Surface<'a> {
    /// What it is part of.
    pub scene: &'a Scene,
    /// Position.
    pub p: Vec3,
    /// Geometric normal, as the shape is oriented.
    pub n_g: Vec3,
    /// Shading frame.
    pub frame: Frame,
    /// Where textures are looked up.
    pub at: Lookup<'a>,
    /// What scatters here.
    pub bsdf: Bsdf<'a>,
    /// The area light that the shape is.
    pub light: Option<u32>,
    /// The shape.
    pub shape: u32,
    tag: u8,
    /// The flat polygon that the surface ends with, if it is one.
    pub facet: Option<&'a Facet>,
    pub(crate) magnitude: f32,
}

/// What gets through between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transmittance {
    /// The share of light, per channel.
    pub color: Rgb,
    /// How many surfaces it crosses through their holes.
    pub crossings: u32,
}

fn tag(hit: &Hit) -> u8 {
    // Fibonacci hashing (Knuth 1998, section 6.4): neighbours differ.
    let id = hit.shape.wrapping_add(hit.instance.wrapping_mul(0x85eb_ca6b));
    (id.wrapping_mul(0x9e37_79b9) >> 24) as u8
}

impl Surface<'_> {
    /// Tells photons on this shape from those on others, but for one pair of shapes in 256.
    pub fn tag(&self) -> u8 {
        self.tag
    }

    /// Whether a path crosses the surface through one of its holes.
    pub fn is_crossed(&self, sampler: &mut Sampler) -> bool {
        match self.bsdf.opacity() {
            1.0 => false,
            0.0 => true,
            opacity => sampler.next_1d() >= opacity,
        }
    }

    /// A ray that leaves the surface in world direction `d`.
    pub fn spawn(&self, d: Vec3) -> Ray {
        Ray::new(offset_origin(self.p, self.n_g, d, self.magnitude), d)
    }

    /// The ray from the surface to `target`, which lies off its own surface, without that end.
    pub fn spawn_to(&self, target: Vec3) -> Ray {
        let o = offset_origin(self.p, self.n_g, target - self.p, self.magnitude);
        let (d, t) = (target - o, (target - o).length());
        Ray { o, t_min: 0.0, d: d / t, t_max: t * (1.0 - 4.0 * f32::EPSILON) }
    }
}

impl Scene {
    /// Builds the acceleration structure and prepares the lights.
    ///
    /// # Errors
    /// [`Error::Usage`] if the build lacks `backend`, [`Error::Runtime`] if building the structure fails.
    pub fn new(d: SceneDescription, backend: Backend) -> Result<Scene> {
        let intersector = accel::build(backend, &d.geometry)?;
        Scene::with_intersector(d, intersector)
    }

    /// The same with an `intersector` over the description's geometry that exists already.
    ///
    /// # Errors
    /// [`Error::Runtime`] if shapes and materials don't match.
    pub fn with_intersector(d: SceneDescription, intersector: Box<dyn Intersector>) -> Result<Scene> {
        let bounds = d.geometry.bounds();
        let lights = Lights::new(d.lights, &d.geometry, &d.textures);
        let mut shape_light = vec![None; d.geometry.shapes.len()];
        for (i, light) in lights.lights().iter().enumerate() {
            if let Light::Area { shape, .. } | Light::DirectionalArea { shape, .. } = light {
                shape_light[*shape as usize] = Some(i as u32);
            }
        }
        if d.shape_material.len() != d.geometry.shapes.len() {
            return Err(Error::Runtime("every shape needs a material".into()));
        }
        let shapes = d.geometry.shown();
        let targets = Targets::new(shapes.iter().copied());
        let sharp = |shape: u32| d.materials[d.shape_material[shape as usize] as usize].lobes().sharp;
        let casters = Targets::new(shapes.iter().copied().filter(|&(shape, ..)| sharp(shape)));
        let wanted = |(&material, light): (&u32, &Option<u32>)| {
            let material = &d.materials[material as usize];
            let shines_by_texture = light.is_some_and(|l| lights.lights()[l as usize].is_textured());
            match material.is_textured() || material.needs_tangent() || shines_by_texture {
                true => Wanted::All,
                false => Wanted::Untextured,
            }
        };
        let shape_wanted = d.shape_material.iter().zip(&shape_light).map(wanted).collect();
        let facets = Facets::new(&d.geometry);
        let shape_holes: Vec<bool> =
            d.shape_material.iter().map(|&m| d.materials[m as usize].lobes().holes).collect();
        Ok(Scene {
            geometry: d.geometry,
            textures: d.textures,
            materials: d.materials,
            lights,
            camera: d.camera,
            film: d.film,
            bounds,
            targets,
            casters,
            facets,
            shape_material: d.shape_material,
            shape_light,
            shape_wanted,
            has_holes: shape_holes.contains(&true),
            shape_holes,
            intersector,
        })
    }

    /// A camera ray through any pixel of the crop window.
    pub fn random_camera_ray(&self, sampler: &mut Sampler) -> Ray {
        let (x, y, width, height) = self.film.crop;
        let at = sampler.next_2d();
        self.camera_ray((x + (at.x * width as f32) as u32, y + (at.y * height as f32) as u32), sampler)
    }

    /// A camera ray through the pixel (x, y) of the full film, distributed as the reconstruction filter around it.
    pub fn camera_ray(&self, (x, y): (u32, u32), sampler: &mut Sampler) -> Ray {
        let full = Vec2::new(self.film.size.0 as f32, self.film.size.1 as f32);
        let position = Vec2::new(x as f32, y as f32) + 0.5 + self.film.filter.sample(sampler.next_2d());
        self.camera.ray(position / full, sampler.next_2d())
    }

    /// The lobes that occur anywhere in the scene.
    pub fn lobes(&self) -> Lobes {
        let materials = self.shape_material.iter().map(|&m| &self.materials[m as usize]);
        materials.fold(Lobes::default(), |lobes, material| lobes.union(material.lobes()))
    }

    /// How many of the shapes need texture coordinates and tangents.
    pub fn textured_shapes(&self) -> usize {
        self.shape_wanted.iter().filter(|&&wanted| wanted == Wanted::All).count()
    }

    /// Has texture coordinates and tangents computed everywhere, to see what it costs. No picture changes.
    pub fn compute_everything(&mut self) {
        self.shape_wanted.fill(Wanted::All);
    }

    /// The material of a shape.
    pub fn material(&self, shape: u32) -> &Material {
        &self.materials[self.shape_material[shape as usize] as usize]
    }

    /// The nearest hit.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.intersector.intersect(ray)
    }

    /// Whether anything without holes lies on the ray.
    pub fn occluded(&self, ray: &Ray) -> bool {
        match self.has_holes {
            true => {
                self.find_hit(ray, |_, hit| (!self.shape_holes[hit.shape as usize]).then_some(())).is_some()
            }
            false => self.intersector.occluded(ray),
        }
    }

    /// Whether what is hit neither shines nor has holes.
    pub fn is_plain(&self, hit: &Hit) -> bool {
        let shape = hit.shape as usize;
        self.shape_light[shape].is_none() && !self.shape_holes[shape]
    }

    /// What `look` says of the hits along a ray: the first `Some`. The ray ends at what has no holes.
    pub fn find_hit<T>(&self, ray: &Ray, look: impl Fn(&Ray, &Hit) -> Option<T>) -> Option<T> {
        let mut ray = *ray;
        loop {
            let hit = self.intersect(&ray)?;
            let found = look(&ray, &hit);
            if found.is_some() || !self.shape_holes[hit.shape as usize] {
                return found;
            }
            let s = self.surface(&ray, &hit);
            ray = Ray { t_max: ray.t_max - (s.p - ray.o).length(), ..s.spawn(ray.d) };
        }
    }

    /// The nearest surface.
    pub fn hit(&self, ray: &Ray) -> Option<Surface<'_>> {
        self.intersect(ray).map(|hit| self.surface(ray, &hit))
    }

    /// What of the light between `from` and `target`, or along `d` if that is infinitely far away, gets through holes; with
    /// `through_lights`, also through area lights, whatever they are made of. `rays` counts what is traced.
    pub fn transmittance(
        &self,
        from: &Surface,
        d: Vec3,
        target: Option<Vec3>,
        through_lights: bool,
        rays: &mut u64,
    ) -> Transmittance {
        let leave = |s: &Surface| target.map_or_else(|| s.spawn(d), |target| s.spawn_to(target));
        let mut ray = leave(from);
        let mut through = Transmittance { color: Rgb::ONE, crossings: 0 };
        let nothing = Transmittance { color: Rgb::ZERO, crossings: 0 };
        *rays += 1;
        if !self.has_holes && !through_lights {
            return if self.intersector.occluded(&ray) { nothing } else { through };
        }
        while let Some(hit) = self.intersect(&ray) {
            let shape = hit.shape as usize;
            let is_hidden = through_lights && self.shape_light[shape].is_some();
            if !is_hidden && !self.shape_holes[shape] {
                return nothing;
            }
            let s = self.surface(&ray, &hit);
            if !is_hidden {
                through.color *= 1.0 - s.bsdf.opacity();
                through.crossings += 1;
                if through.color == Rgb::ZERO {
                    return nothing;
                }
            }
            ray = leave(&s);
            *rays += 1;
        }
        through
    }

    /// Shading data of a hit.
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface<'_> {
        let shape = &self.geometry.shapes[hit.shape as usize];
        let wanted = self.shape_wanted[hit.shape as usize];
        let instance = self.geometry.instances.get(hit.instance as usize);
        let own_ray = instance.map_or(*ray, |instance| instance.ray(ray));
        let hit = match shape {
            Shape::Mesh(mesh) => &mesh.refine(&own_ray, hit),
            _ => hit,
        };
        let own = shape.point(&own_ray, hit, wanted);
        let point = instance.map_or(own, |instance| instance.point(&own));
        let at = Lookup::new(shape, point.uv, hit.primitive, Vec2::new(hit.u, hit.v));
        let material = self.material(hit.shape);
        let (frame, partials) = if wanted == Wanted::All {
            let partials = shape.partials(hit, &own);
            let partials = instance.map_or(partials, |instance| partials.map(|p| instance.vector(p)));
            let frame = match material.needs_tangent() {
                true => Frame::from_normal_and_tangent(point.n_s, partials[0]),
                false => Frame::from_normal(point.n_s),
            };
            (frame, partials.map(|p| frame.to_local(p)))
        } else {
            (Frame::from_normal(point.n_s), [Vec3::ZERO; 2])
        };
        let site = Site { at, from_front: ray.d.dot(point.n_s) <= 0.0, partials };
        Surface {
            scene: self,
            p: point.p,
            n_g: point.n_g,
            frame,
            at,
            bsdf: material.bsdf(&self.textures, &site),
            light: self.shape_light[hit.shape as usize],
            shape: hit.shape,
            tag: tag(hit),
            facet: self.facets.at(hit.shape, hit.primitive, point.p),
            magnitude: point.magnitude,
        }
    }

    /// Position, geometric normal and tag (see [`Surface::tag`]) of a hit: all that its neighbours need to know.
    pub fn geometric(&self, ray: &Ray, hit: &Hit) -> (Vec3, Vec3, u8) {
        let shape = &self.geometry.shapes[hit.shape as usize];
        let instance = self.geometry.instances.get(hit.instance as usize);
        let own_ray = instance.map_or(*ray, |instance| instance.ray(ray));
        let own = shape.point(&own_ray, hit, Wanted::Untextured);
        let point = instance.map_or(own, |instance| instance.point(&own));
        (point.p, point.n_g, tag(hit))
    }

    /// Radiance that an area light at `surface` sends towards `wo` (world).
    pub fn emitted(&self, surface: &Surface, wo: Vec3) -> Rgb {
        match surface.light {
            Some(light) => {
                self.lights.emitted(light, &self.textures, &surface.at, [surface.n_g, surface.frame.n], wo)
            }
            None => Rgb::ZERO,
        }
    }
}
