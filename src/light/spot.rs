//! Spotlights: a point with an angular falloff, optionally projecting a texture (Mitsuba 3 `spot`).

use super::table::Table;
use super::{DirectSample, EmissionSample, Targets};
use crate::math::{Rgb, warp};
use crate::texture::Texture;
use glam::{Affine3A, Mat3, Vec2, Vec3};

/// A point light that shines along its local +z, fully within `beam`, falling off linearly in the angle to nothing
/// at `cutoff`.
#[derive(Clone, Debug)]
pub struct Spot {
    position: Vec3,
    to_world: Mat3,
    to_local: Mat3,
    intensity: Rgb,
    cutoff: f32,
    beam: f32,
    texture: Option<u32>,
}

impl Spot {
    /// `intensity` in W/sr, angles in degrees from the axis, `texture` an index into the scene's textures: it is
    /// projected onto the square around the cutoff cone's cross-section.
    ///
    /// # Errors
    /// A message if the transform is singular or an angle makes no sense.
    pub fn new(
        to_world: Affine3A,
        intensity: Rgb,
        cutoff_degrees: f32,
        beam_degrees: f32,
        texture: Option<u32>,
    ) -> Result<Spot, String> {
        let matrix = Mat3::from(to_world.matrix3);
        let position = Vec3::from(to_world.translation);
        let to_local = matrix.inverse();
        if !(matrix.is_finite() && position.is_finite() && to_local.is_finite()) {
            return Err("the spot light's transformation is singular or not finite".into());
        }
        if !(cutoff_degrees > 0.0 && cutoff_degrees <= 180.0) {
            return Err(format!(
                "the cutoff angle must be above 0 and at most 180 degrees, not {cutoff_degrees}"
            ));
        }
        if beam_degrees.is_nan() || beam_degrees < 0.0 {
            return Err(format!("the beam width must not be negative, but is {beam_degrees} degrees"));
        }
        let (cutoff, beam) = (cutoff_degrees.to_radians(), beam_degrees.min(cutoff_degrees).to_radians());
        Ok(Spot { position, to_world: matrix, to_local, intensity, cutoff, beam, texture })
    }

    /// Radiant intensity towards the local unit direction `l`.
    fn intensity(&self, textures: &[Texture], l: Vec3) -> Rgb {
        // The angle from both sine and cosine: acos alone is blind near the axis.
        let theta = l.truncate().length().atan2(l.z);
        if theta >= self.cutoff {
            return Rgb::ZERO;
        }
        let falloff =
            if theta <= self.beam { 1.0 } else { (self.cutoff - theta) / (self.cutoff - self.beam) };
        let projected = self.texture.and_then(|i| textures.get(i as usize)).map_or(Rgb::ONE, |texture| {
            let uv = 0.5 + 0.5 * l.truncate() / (l.z * self.cutoff.tan());
            texture.eval(textures, &uv.into())
        });
        self.intensity * projected * falloff
    }

    /// dω(world)/dω(local) at the local unit direction `l`: 1 unless the transformation scales.
    fn stretch(&self, l: Vec3) -> f32 {
        self.to_world.determinant().abs() / (self.to_world * l).length().powi(3)
    }

    /// Whether the intensity depends on the angle to the axis alone.
    fn is_round(&self) -> bool {
        let m = self.to_world.transpose() * self.to_world;
        self.texture.is_none()
            && m.abs_diff_eq(Mat3::from_diagonal(Vec3::splat(m.x_axis.x)), 1e-4 * m.x_axis.x)
    }

    /// Whether its cone meets any of `targets`.
    pub(super) fn reaches(&self, targets: &Targets) -> bool {
        // Others are not worth the bother.
        !self.is_round()
            || targets.meet_cone(self.position, (self.to_world * Vec3::Z).normalize(), self.cutoff)
    }

    fn one_minus_cos(&self) -> f32 {
        2.0 * (0.5 * self.cutoff).sin().powi(2)
    }

    pub(super) fn direct(&self, textures: &[Texture], p: Vec3) -> Option<DirectSample> {
        let to = self.position - p;
        let weight = self.intensity(textures, (self.to_local * -to).try_normalize()?) / to.length_squared();
        (weight != Rgb::ZERO).then_some(DirectSample {
            wi: to.normalize(),
            target: Some(self.position),
            weight,
            pdf_w: 1.0,
            delta: true,
        })
    }

    /// Importance of the directions in the cone, over the unit square that [`warp::cone`] maps to it.
    pub(super) fn table(&self, textures: &[Texture]) -> Table {
        // A single column does for a light that only the angle to the axis matters for.
        let size = (if self.is_round() { 1 } else { 64 }, 64);
        Table::new(size, 4, |u| {
            let l = warp::cone(u, self.one_minus_cos());
            self.intensity(textures, l) * self.stretch(l)
        })
    }

    /// W, with the mean over the cone from [`Spot::table`].
    pub(super) fn power(&self, table: &Table) -> Rgb {
        table.mean() / warp::cone_pdf_w(self.one_minus_cos())
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
                (d, self.intensity(textures, (self.to_local * d).try_normalize()?) / pdf_w)
            }
            None => {
                let (p, density) = table.sample(u)?;
                let omc = self.one_minus_cos();
                let l = warp::cone(p, omc);
                let pdf_w = density * warp::cone_pdf_w(omc);
                ((self.to_world * l).normalize(), self.intensity(textures, l) * (self.stretch(l) / pdf_w))
            }
        };
        (flux != Rgb::ZERO).then_some(EmissionSample { o: self.position, d, flux, light: 0 })
    }
}
