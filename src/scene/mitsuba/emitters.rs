//! Emitters that are no shapes, and the radiance of those that are.

use super::Loader;
use super::props::{Props, to_f32, vec3};
use super::sensor::half_width;
use super::textures::gamma;
use crate::image_io::{self, Domain, Encoding};
use crate::light::{Envmap, Light, Projector, Spot};
use crate::math::Rgb;
use crate::scene::pending::Pending;
use crate::scene::spectrum::Role;
use crate::texture::{Color, Texture};
use crate::{Error, Result};
use glam::Vec3;

const KNOWN: &str = "area and directionalarea (inside a shape), point, spot, projector, directional, collimated, constant, \
                     envmap, sunsky";

/// Emitters that are no shapes.
const FREE: [&str; 10] =
    ["point", "spot", "projector", "directional", "collimated", "constant", "envmap", "sunsky", "sky", "sun"];

impl<'a> Loader<'a> {
    /// What an emitter inside a shape sends out.
    pub(super) fn shape_light(&mut self, props: Props<'a>, shape: u32) -> Result<()> {
        let plugin = props.plugin();
        if FREE.contains(&plugin) && plugin != "constant" {
            // As Mitsuba 3 has it.
            let message = format!("{} inside a shape shines as if it stood beside it", props.title());
            self.tree.warn_once(props.object.pos, &message);
            return self.emitter(props);
        }
        if plugin == "constant" {
            self.tree
                .warn_once(props.object.pos, "emitter plugin 'constant' inside a shape is read as 'area'");
            props.to_world()?; // means nothing
        } else if !of_shapes(plugin) {
            return Err(props.unknown_plugin(KNOWN));
        }
        let radiance = self.color(props, "radiance", Role::Emission, Rgb::ONE)?;
        finish(props)?;
        self.lit.insert(props.index);
        self.emitters.push((shape, props));
        self.lights.push(Pending::Ready(match plugin {
            "directionalarea" => Light::DirectionalArea { shape, radiance },
            _ => Light::Area { shape, radiance },
        }));
        Ok(())
    }

    /// An emitter that is no shape. It is made once, however often it is referred to.
    pub(super) fn emitter(&mut self, props: Props<'a>) -> Result<()> {
        if !self.lit.insert(props.index) {
            return Ok(());
        }
        let lights = match props.plugin() {
            "sunsky" if !props.object.old => self.sunsky(props)?,
            "sunsky" | "sky" | "sun" if props.object.old => self.old_daylight(props)?,
            "envmap" => {
                let envmap = self.envmap(props)?;
                self.lights.push(envmap);
                vec![]
            }
            _ => vec![self.single_light(props)?],
        };
        finish(props)?;
        self.lights.extend(lights.into_iter().map(Pending::Ready));
        Ok(())
    }

    /// An emitter that needs no file.
    fn single_light(&mut self, props: Props<'a>) -> Result<Light> {
        Ok(match props.plugin() {
            "point" => Light::Point {
                position: self.either_or(props, "position", |m| m.translation.into())?,
                intensity: self.constant_color(props, "intensity", Role::Emission, Rgb::ONE)?,
            },
            "directional" => {
                let direction = self.either_or(props, "direction", |m| m.matrix3.z_axis.into())?;
                if props.has("to_world") && (direction.length() - 1.0).abs() > 1e-3 {
                    let message = "only the direction of the light's transform counts, not its scale";
                    self.warn_at(props.pos("to_world"), message);
                }
                let Some(direction) = direction.try_normalize() else {
                    return Err(props.error_at("direction", "the direction is zero"));
                };
                let irradiance = self.constant_color(props, "irradiance", Role::Emission, Rgb::ONE)?;
                Light::Directional { direction, irradiance }
            }
            "constant" => {
                props.to_world()?; // turns what looks the same from everywhere
                Light::Constant {
                    radiance: self.constant_color(props, "radiance", Role::Emission, Rgb::ONE)?,
                }
            }
            "spot" => {
                let intensity = self.constant_color(props, "intensity", Role::Emission, Rgb::ONE)?;
                let texture = match self.color(props, "texture", Role::Reflectance, Rgb::ONE)? {
                    Color::Constant(_) if !props.has("texture") => None,
                    Color::Texture(index) => Some(index),
                    Color::Constant(_) => {
                        return Err(props.error_at("texture", "'texture' should be a bitmap or checkerboard"));
                    }
                };
                let cutoff = props.float("cutoff_angle", 20.0)?;
                let beam = props.float("beam_width", 0.75 * cutoff)?;
                let spot = Spot::new(to_f32(props.to_world()?), intensity, cutoff, beam, texture);
                Light::Spot(spot.map_err(|message| props.error(message))?)
            }
            "projector" => self.projector(props)?,
            "collimated" => {
                let m = to_f32(props.to_world()?);
                let direction = Vec3::from(m.matrix3.z_axis);
                if (direction.length() - 1.0).abs() > 1e-3 {
                    return Err(props.error_at("to_world", "the transform of a beam must not scale"));
                }
                Light::Collimated {
                    position: m.translation.into(),
                    direction: direction.normalize(),
                    power: self.constant_color(props, "power", Role::Emission, Rgb::ONE)?,
                }
            }
            _ => return Err(props.unknown_plugin(KNOWN)),
        })
    }

    fn projector(&mut self, props: Props<'a>) -> Result<Light> {
        let irradiance = self.color(props, "irradiance", Role::Emission, Rgb::ONE)?;
        // What has no pixels is square.
        let aspect = match irradiance {
            Color::Texture(i) => match self.textures[i as usize].now()? {
                Texture::Bitmap(bitmap) => bitmap.size().0 as f32 / bitmap.size().1 as f32,
                _ => 1.0,
            },
            Color::Constant(_) => 1.0,
        };
        let (half_width, scale) = (half_width(props, aspect)?, props.float("scale", 1.0)?);
        self.check_texels(irradiance, Domain::NonNegative, std::f32::consts::PI * scale, props.object.pos);
        let projector = Projector::new(to_f32(props.to_world()?), half_width, aspect, irradiance, scale);
        projector.map(Light::Projector).map_err(|message| props.error(message))
    }

    /// A vector given directly, or taken from `to_world`.
    fn either_or(
        &self,
        props: Props,
        name: &'static str,
        of_transform: impl Fn(glam::Affine3A) -> Vec3,
    ) -> Result<Vec3> {
        match props.opt_vector(name)? {
            Some(_) if props.has("to_world") => {
                Err(props.error_at(name, format!("give either '{name}' or 'to_world', not both")))
            }
            Some(v) => Ok(vec3(v)),
            None => Ok(of_transform(to_f32(props.to_world()?))),
        }
    }

    fn envmap(&mut self, props: Props<'a>) -> Result<Pending<Light>> {
        let nested = props.object.properties.iter().find_map(|p| {
            let index = props.object_of(p).ok().flatten()?;
            (self.tree.objects[index].plugin == "bitmap").then(|| {
                p.used.set(true);
                Props::new(self.tree, index)
            })
        });
        let (path, raw) = match nested {
            Some(bitmap) => (self.filename(bitmap)?, bitmap.boolean("raw", false)?),
            None => (self.filename(props)?, false),
        };
        let encoding = match gamma(props)? {
            Some(gamma) => Encoding::Gamma(gamma),
            None if raw => Encoding::Linear,
            None => Encoding::Srgb,
        };
        let scale = props.float("scale", 1.0)?;
        props.boolean("mis_compensation", false)?;
        let to_world = to_f32(props.to_world()?);
        let (file, line) = (self.tree.file(props.object.pos).to_path_buf(), props.object.pos.line);
        Ok(Pending::file(self.next_file(), move || {
            let envmap = Envmap::new(image_io::read_encoded(&path, encoding)?, scale, to_world);
            envmap.map(Light::Envmap).map_err(|message| {
                let message = format!("{}: {message}", path.display());
                Error::Scene { file, line, message }
            })
        }))
    }
}

/// Whether the plugin is one of those that make shapes shine.
pub(super) fn of_shapes(plugin: &str) -> bool {
    matches!(plugin, "area" | "directionalarea")
}

fn finish(props: Props) -> Result<()> {
    // Steers only how Mitsuba samples.
    props.opt_float("sampling_weight")?;
    props.finish()
}
