//! Sun and sky: Mitsuba 3's `sunsky`, and Mitsuba 0.6's `sky`, `sun` and `sunsky`.

use super::Loader;
use super::props::{Props, vec3};
use crate::Result;
use crate::light::{Light, Sky, Sun};
use crate::math::Rgb;
use crate::scene::daylight::{SUN_HALF_ANGLE, When, at_zenith, preetham_sun_radiance, sun_irradiance};
use crate::scene::spectrum::Role;
use glam::{DMat3, DVec3};

/// W·m⁻²·nm⁻¹ from what Hošek & Wilkie's model gives in RGB: over the sum of ȳ at 1 nm, as both Mitsubas have it.
const SKY_SCALE: f32 = 1.0 / 106.750_26;
const OLD_SKY_SCALE: f32 = 1.0 / 106.856_98;

/// What all the plugins are told.
struct Daylight {
    /// World, unit length.
    up: DVec3,
    /// Towards the sun; world, unit length.
    sun: DVec3,
    turbidity: f32,
}

impl Daylight {
    /// The sun's angle to the zenith, radians.
    fn zenith(&self) -> f64 {
        self.up.cross(self.sun).length().atan2(self.up.dot(self.sun))
    }
}

impl<'a> Loader<'a> {
    /// Mitsuba 3's `sunsky`. Its sky has the zenith at local +z.
    pub(super) fn sunsky(&mut self, props: Props<'a>) -> Result<Vec<Light>> {
        let to_world = rotation(props)?;
        let day = daylight(props, to_world.z_axis, |zenith, azimuth| {
            // North is −x, east −y.
            to_world * DVec3::new(-zenith.sin() * azimuth.cos(), -zenith.sin() * azimuth.sin(), zenith.cos())
        })?;
        let albedo = self.albedo(props, 0.3)?;
        let (sky_scale, sun_scale) = (scale(props, "sky_scale", 1.0)?, scale(props, "sun_scale", 1.0)?);
        let half_angle = match props.opt_float("sun_aperture")? {
            Some(degrees) => 0.5 * degrees as f64,
            None => SUN_HALF_ANGLE,
        };
        let limb = props.boolean("complex_sun", false)?;
        if day.zenith() > std::f64::consts::FRAC_PI_2 {
            self.warn_at(props.object.pos, "the sun is below the horizon: there is no light at all");
            return Ok(Vec::new());
        }
        let (up, sun) = (vec3(day.up), vec3(day.sun));
        let fail = |message: String| props.error(message);
        let mut lights = Vec::new();
        if sky_scale > 0.0 {
            let sky = Sky::new(up, sun, day.turbidity, albedo, sky_scale * SKY_SCALE);
            lights.push(Light::Sky(sky.map_err(fail)?));
        }
        if sun_scale > 0.0 {
            let elevation = 90.0 - day.zenith().to_degrees() as f32;
            let irradiance = sun_scale * sun_irradiance(day.turbidity, elevation);
            let sun = Sun::new(sun, half_angle.to_radians() as f32, irradiance, limb, Some(up));
            lights.push(Light::Sun(sun.map_err(fail)?));
        }
        Ok(lights)
    }

    /// Mitsuba 0.6's `sky`, `sun` and `sunsky`. Their zenith is local +y.
    pub(super) fn old_daylight(&mut self, props: Props<'a>) -> Result<Vec<Light>> {
        let to_world = rotation(props)?;
        let day = daylight(props, to_world.y_axis, |zenith, azimuth| {
            to_world * DVec3::new(zenith.sin() * azimuth.sin(), zenith.cos(), -zenith.sin() * azimuth.cos())
        })?;
        if day.zenith() > std::f64::consts::FRAC_PI_2 {
            return Err(props.error("the sun is below the horizon"));
        }
        let all = scale(props, "scale", 1.0)?;
        let (sky_scale, sun_scale) = match props.plugin() {
            "sky" => (all, 0.0),
            "sun" => (0.0, all),
            _ => (scale(props, "sky_scale", all)?, scale(props, "sun_scale", all)?),
        };
        let albedo = self.albedo(props, 0.2)?;
        let (stretch, extend) = (props.float("stretch", 1.0)?, props.boolean("extend", false)?);
        let radius_scale = scale(props, "sun_radius_scale", 1.0)?;
        // Of the picture that Mitsuba makes of them.
        props.opt_integer("resolution")?;
        let fail = |message: String| props.error(message);
        let mut lights = Vec::new();
        if sky_scale > 0.0 {
            let sky = Sky::new(vec3(day.up), vec3(day.sun), day.turbidity, albedo, sky_scale * OLD_SKY_SCALE);
            lights.push(Light::Sky(sky.and_then(|sky| sky.stretched(stretch, extend)).map_err(fail)?));
        }
        if sun_scale > 0.0 {
            let half_angle = SUN_HALF_ANGLE.to_radians();
            let solid_angle = std::f64::consts::TAU * (1.0 - half_angle.cos());
            let radiance = preetham_sun_radiance(day.turbidity as f64, day.zenith());
            let irradiance = radiance * (sun_scale * solid_angle as f32);
            let direction = vec3(at_zenith(day.up, day.sun, day.zenith() * stretch as f64));
            lights.push(match radius_scale {
                0.0 => Light::Directional { direction: -direction, irradiance },
                _ => {
                    let sun = Sun::new(direction, half_angle as f32 * radius_scale, irradiance, false, None);
                    Light::Sun(sun.map_err(fail)?)
                }
            });
        }
        Ok(lights)
    }

    /// Of the ground.
    fn albedo(&mut self, props: Props<'a>, default: f32) -> Result<Rgb> {
        let albedo = self.constant_color(props, "albedo", Role::Reflectance, Rgb::splat(default))?;
        if albedo.max_element() > 1.0 {
            return Err(props.error_at("albedo", format!("'albedo' is {albedo}, but must not exceed 1")));
        }
        Ok(albedo)
    }
}

/// Sun, zenith `up` and air. `from_angles` makes a world direction from the angle to the zenith and the azimuth from north
/// over east.
fn daylight(props: Props, up: DVec3, from_angles: impl Fn(f64, f64) -> DVec3) -> Result<Daylight> {
    let turbidity = props.float("turbidity", 3.0)?;
    if !(1.0..=10.0).contains(&turbidity) {
        let message = format!("'turbidity' is {turbidity}, but must lie between 1 and 10");
        return Err(props.error_at("turbidity", message));
    }
    let sun = match props.opt_vector("sun_direction")? {
        Some(direction) => {
            if let Some(name) = WHEN.iter().find(|name| props.has(name)) {
                let message = format!("give either 'sun_direction' or '{name}' and the like, not both");
                return Err(props.error_at(name, message));
            }
            let direction = direction.try_normalize();
            direction.ok_or_else(|| props.error_at("sun_direction", "the sun's direction is zero"))?
        }
        None => {
            let (zenith, azimuth) = when(props)?.sun();
            from_angles(zenith, azimuth)
        }
    };
    Ok(Daylight { up, sun, turbidity })
}

const WHEN: [&str; 9] =
    ["latitude", "longitude", "timezone", "year", "month", "day", "hour", "minute", "second"];

/// By default an afternoon in Tokyo.
fn when(props: Props) -> Result<When> {
    let number = |name, default: f32| Ok(props.float(name, default)? as f64);
    let integer = |name, default: i32| -> Result<i32> {
        let Some(value) = props.opt_integer(name)? else { return Ok(default) };
        let far = |_| props.error_at(name, format!("'{name}' is {value}, out of range"));
        i32::try_from(value).map_err(far)
    };
    let date = [integer("year", 2010)?, integer("month", 7)?, integer("day", 10)?];
    let hours = number("hour", 15.0)? + (number("minute", 0.0)? + number("second", 0.0)? / 60.0) / 60.0;
    Ok(When {
        latitude: number("latitude", 35.6894)?,
        longitude: number("longitude", 139.6917)?,
        timezone: number("timezone", 9.0)?,
        date,
        hours,
    })
}

fn scale(props: Props, name: &'static str, default: f32) -> Result<f32> {
    let scale = props.float(name, default)?;
    if scale >= 0.0 && scale.is_finite() {
        return Ok(scale);
    }
    Err(props.error_at(name, format!("'{name}' is {scale}, but must not be negative")))
}

/// The linear part of `to_world`, which may scale without effect.
fn rotation(props: Props) -> Result<DMat3> {
    let matrix = props.to_world()?.matrix3;
    let rotation = matrix * (1.0 / matrix.determinant().abs().cbrt());
    if (rotation.transpose() * rotation).abs_diff_eq(DMat3::IDENTITY, 1e-3) {
        return Ok(rotation);
    }
    Err(props.error_at("to_world", "a sky can be rotated and mirrored, but not stretched or sheared"))
}
