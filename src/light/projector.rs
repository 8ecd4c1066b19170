//! Projectors: a picture thrown from a point (Mitsuba 3 `projector`).

use super::table::Table;
use super::{DirectSample, EmissionSample, Targets};
use crate::math::Rgb;
use crate::texture::{Color, Texture};
use glam::{Affine3A, Mat3, Vec2, Vec3};
use std::f32::consts::PI;

/// A perspective camera backwards: it lights a plane across its axis with a picture. Looks along local +z, x to the
/// *left* of the picture.
#[derive(Clone, Debug)]
pub struct Projector {
    position: Vec3,
    to_world: Mat3,
    to_local: Mat3,
    /// Half the picture's width at distance 1.
    half_width: f32,
    aspect: f32,
    irradiance: Color,
    scale: f32,
}

impl Projector {
    /// A picture tan(fov_x / 2) = `half_width` to either side at distance 1, `aspect` times as wide as high. There a surface
    /// across the axis receives π · `scale` · `irradiance`, as in Mitsuba.
    ///
    /// # Errors
    /// A message if the transform scales or a parameter makes no sense.
    pub fn new(
        to_world: Affine3A,
        half_width: f32,
        aspect: f32,
        irradiance: Color,
        scale: f32,
    ) -> Result<Projector, String> {
        let (matrix, position) = (Mat3::from(to_world.matrix3), Vec3::from(to_world.translation));
        if !(position.is_finite() && (matrix.transpose() * matrix).abs_diff_eq(Mat3::IDENTITY, 2e-3)) {
            return Err("the transform of a projector must not scale".into());
        }
        if !(half_width > 0.0 && half_width.is_finite() && aspect > 0.0 && aspect.is_finite()) {
            return Err("the projector's field of view is empty or too wide".into());
        }
        if !(scale >= 0.0 && scale.is_finite()) {
            return Err(format!("the projector's scale must not be negative, but is {scale}"));
        }
        let to_local = matrix.inverse();
        Ok(Projector { position, to_world: matrix, to_local, half_width, aspect, irradiance, scale })
    }

    /// Area of the picture at distance 1.
    fn area(&self) -> f32 {
        4.0 * self.half_width * self.half_width / self.aspect
    }

    fn irradiance(&self, textures: &[Texture], uv: Vec2) -> Rgb {
        self.irradiance.eval(textures, &uv.into()) * (PI * self.scale)
    }

    /// Radiant intensity, W/sr, in the world direction `d`: from irradiance at distance 1 by distance squared over cosine.
    fn intensity(&self, textures: &[Texture], d: Vec3) -> Rgb {
        let l = self.to_local * d;
        if l.z <= 0.0 {
            return Rgb::ZERO;
        }
        let plane = Vec2::new(l.x, l.y * self.aspect) / (l.z * self.half_width);
        if plane.abs().max_element() > 1.0 {
            return Rgb::ZERO;
        }
        let cos = l.z / l.length();
        self.irradiance(textures, 0.5 * (1.0 - plane)) / (cos * cos * cos)
    }

    pub(super) fn direct(&self, textures: &[Texture], p: Vec3) -> Option<DirectSample> {
        let to = self.position - p;
        let wi = to.try_normalize()?;
        let weight = self.intensity(textures, -wi) / to.length_squared();
        (weight != Rgb::ZERO).then_some(DirectSample {
            wi,
            target: Some(self.position),
            weight,
            pdf_w: 1.0,
            delta: true,
        })
    }

    /// Importance of the picture's parts.
    pub(super) fn table(&self, textures: &[Texture]) -> Table {
        let size = match self.irradiance {
            Color::Constant(_) => (1, 1),
            Color::Texture(i) => match textures.get(i as usize) {
                Some(Texture::Bitmap(bitmap)) => bitmap.size(),
                _ => (0, 0),
            },
        };
        // Small pictures may repeat, large ones are summarised.
        let cells = |n: usize| if n == 1 { 1 } else { n.clamp(64, 512) };
        Table::new((cells(size.0), cells(size.1)), 4, |uv| self.irradiance(textures, uv))
    }

    /// W, with the mean over the picture from [`Projector::table`].
    pub(super) fn power(&self, table: &Table) -> Rgb {
        table.mean() * self.area()
    }

    pub(super) fn emission(
        &self,
        table: &Table,
        textures: &[Texture],
        targets: &Targets,
        u: Vec2,
    ) -> Option<EmissionSample> {
        let (d, flux) = match targets.aim_from(self.position, None) {
            Some(aim) => {
                let (d, pdf_w) = aim.sample(u)?;
                (d, self.intensity(textures, d) / pdf_w)
            }
            None => {
                let (uv, density) = table.sample(u)?;
                let plane = (1.0 - 2.0 * uv) * Vec2::new(self.half_width, self.half_width / self.aspect);
                let d = (self.to_world * plane.extend(1.0)).normalize();
                (d, self.irradiance(textures, uv) * (self.area() / density))
            }
        };
        (flux != Rgb::ZERO).then_some(EmissionSample { o: self.position, d, flux, light: 0 })
    }
}
