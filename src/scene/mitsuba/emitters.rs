//! Emitters that are no shapes, and the radiance of those that are.

use super::Loader;
use super::props::{Props, to_f32, vec3};
use crate::image_io;
use crate::light::{Envmap, Light, Spot};
use crate::math::Rgb;
use crate::scene::pending::Pending;
use crate::scene::spectrum::Role;
use crate::texture::Color;
use crate::{Error, Result};
use glam::Vec3;

const KNOWN: &str = "area (inside a shape), point, spot, directional, constant, envmap";

impl<'a> Loader<'a> {
    /// The radiance of an `area` emitter.
    pub(super) fn area_radiance(&mut self, props: Props<'a>) -> Result<Color> {
        if props.plugin() != "area" {
            let known = ["point", "spot", "directional", "constant", "envmap"].contains(&props.plugin());
            return Err(if known {
                props.error(format!("{} cannot stand inside a shape, only 'area' can", props.title()))
            } else {
                props.unknown_plugin(KNOWN)
            });
        }
        let radiance = self.color(props, "radiance", Role::Emission, Rgb::ONE)?;
        finish(props)?;
        Ok(radiance)
    }

    /// An emitter directly inside the scene.
    pub(super) fn emitter(&mut self, props: Props<'a>) -> Result<()> {
        let light = match props.plugin() {
            "envmap" => self.envmap(props)?,
            _ => Pending::Ready(self.small_emitter(props)?),
        };
        finish(props)?;
        self.lights.push(light);
        Ok(())
    }

    /// An emitter that needs no file.
    fn small_emitter(&mut self, props: Props<'a>) -> Result<Light> {
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
            "area" => return Err(props.error("an area emitter belongs inside a shape")),
            _ => return Err(props.unknown_plugin(KNOWN)),
        })
    }

    /// A vector given directly, or taken from `to_world`.
    fn either_or(
        &self,
        props: Props,
        name: &str,
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
        let (path, srgb) = match nested {
            Some(bitmap) => (self.filename(bitmap)?, !bitmap.boolean("raw", false)?),
            None => (self.filename(props)?, true),
        };
        let scale = props.float("scale", 1.0)?;
        props.boolean("mis_compensation", false)?;
        let to_world = to_f32(props.to_world()?);
        let (file, line) = (self.tree.file(props.object.pos).to_path_buf(), props.object.pos.line);
        Ok(Pending::file(self.next_file(), move || {
            let envmap = Envmap::new(image_io::read_encoded(&path, srgb)?, scale, to_world);
            envmap.map(Light::Envmap).map_err(|message| {
                let message = format!("{}: {message}", path.display());
                Error::Scene { file, line, message }
            })
        }))
    }
}

fn finish(props: Props) -> Result<()> {
    // Steers only how Mitsuba samples.
    props.opt_float("sampling_weight")?;
    props.finish()
}
