//! The clear sky of Hošek & Wilkie 2012, "An Analytic Model for Full Spectral Sky-Dome Radiance".

use super::table::Table;
use crate::math::{Frame, Rgb};
use glam::{Vec2, Vec3};
use hw_skymodel::rgb::{SkyParams, SkyState};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Light from all over a clear sky, without the sun's disk.
#[derive(Clone, Debug)]
pub struct Sky {
    up: Vec3,
    sun: Vec3,
    /// The model's A to I for red, green and blue.
    coefficients: [[f32; 9]; 3],
    /// What the model's values are multiplied with.
    radiance: Rgb,
    /// The horizon lies this many right angles below the zenith.
    stretch: f32,
    /// Whether the horizon's light goes on below it, fading towards the nadir.
    extend: bool,
}

impl Sky {
    /// A sky with zenith `up` and the sun at `sun`, both unit vectors. `turbidity` tells clear air (1) from haze (10),
    /// `albedo` is that of the ground all around, `scale` multiplies the model's linear sRGB values. Nothing comes from below
    /// the horizon.
    ///
    /// # Errors
    /// A message if the sun is below the horizon, or a parameter out of range.
    pub fn new(up: Vec3, sun: Vec3, turbidity: f32, albedo: Rgb, scale: f32) -> Result<Sky, String> {
        let elevation = sun.dot(up).atan2(up.cross(sun).length());
        // A hair below is rounding.
        if elevation < -1e-5 {
            return Err("the sun is below the horizon".into());
        }
        if !(scale >= 0.0 && scale.is_finite()) {
            return Err(format!("the sky's scale must not be negative, but is {scale}"));
        }
        let elevation = elevation.clamp(0.0, FRAC_PI_2);
        let state = SkyState::new(&SkyParams { elevation, turbidity, albedo: albedo.to_array() });
        let (coefficients, radiance) = state.map_err(|e| e.to_string())?.raw();
        Ok(Sky {
            up,
            sun,
            coefficients: [0, 1, 2].map(|c| std::array::from_fn(|i| coefficients[9 * c + i])),
            radiance: scale * Rgb::from_array(radiance),
            stretch: 1.0,
            extend: false,
        })
    }

    /// With the horizon `stretch` right angles (1 to 2) below the zenith, and if `extend` is set with light from below it
    /// (Mitsuba 0.6).
    ///
    /// # Errors
    /// A message if `stretch` is out of range.
    pub fn stretched(self, stretch: f32, extend: bool) -> Result<Sky, String> {
        if !(1.0..=2.0).contains(&stretch) {
            return Err(format!("the sky can be stretched by a factor from 1 to 2, not {stretch}"));
        }
        Ok(Sky { stretch, extend, ..self })
    }

    /// Radiance from the world direction `d`.
    pub(super) fn eval(&self, d: Vec3) -> Rgb {
        let cos_theta = d.dot(self.up);
        if self.stretch == 1.0 && !self.extend {
            return if cos_theta >= 0.0 { self.model(d, cos_theta) } else { Rgb::ZERO };
        }
        let across = d - self.up * cos_theta;
        let zenith = across.length().atan2(cos_theta);
        // Not quite the horizon, as Mitsuba 0.6 has it.
        let theta = match zenith / self.stretch {
            theta if theta < FRAC_PI_2 => theta,
            _ if self.extend => FRAC_PI_2 - 1e-4,
            _ => return Rgb::ZERO,
        };
        let fade = if self.extend { (2.0 - 2.0 * zenith / PI).clamp(0.0, 1.0) } else { 1.0 };
        let (sin, cos) = theta.sin_cos();
        let bent = self.up * cos + across.normalize_or_zero() * sin;
        self.model(bent, cos) * (fade * fade * (3.0 - 2.0 * fade))
    }

    /// The model, for a direction above the horizon.
    fn model(&self, d: Vec3, cos_theta: f32) -> Rgb {
        let gamma = 2.0 * (0.5 * d.distance(self.sun)).min(1.0).asin();
        let cos_gamma = d.dot(self.sun);
        let cos2 = cos_gamma * cos_gamma;
        let root = cos_theta.max(0.0).sqrt();
        let channel = |[a, b, c, d, e, f, g, i, h]: [f32; 9]| {
            let anisotropy = 1.0 + h * h - 2.0 * h * cos_gamma;
            let chi = (1.0 + cos2) / (anisotropy * anisotropy.sqrt());
            let horizon = 1.0 + a * (b / (cos_theta + 0.01)).exp();
            horizon * (c + d * (e * gamma).exp() + f * cos2 + g * chi + i * root)
        };
        // A fit, it may fall below zero in places.
        (self.radiance * Rgb::from_array(self.coefficients.map(channel))).max(Rgb::ZERO)
    }

    /// Cosine to the zenith at which all light ends.
    fn lowest(&self) -> f32 {
        match (self.extend, self.stretch) {
            (true, _) => -1.0,
            (false, 1.0) => 0.0,
            (false, stretch) => (FRAC_PI_2 * stretch).cos(),
        }
    }

    fn frame(&self) -> Frame {
        Frame::from_normal(self.up)
    }

    /// Importance of directions, over the unit square of azimuth and height.
    pub(super) fn table(&self) -> Table {
        Table::new((256, 128), 2, |p| self.eval(self.direction(p)))
    }

    fn direction(&self, p: Vec2) -> Vec3 {
        let lowest = self.lowest();
        let z = lowest + (1.0 - lowest) * p.y;
        let (sin, cos) = (TAU * p.x).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        self.frame().to_world(Vec3::new(r * cos, r * sin, z)).normalize()
    }

    /// ∫ L dω.
    pub(super) fn integral(&self, table: &Table) -> Rgb {
        table.mean() * self.solid_angle()
    }

    fn solid_angle(&self) -> f32 {
        TAU * (1.0 - self.lowest())
    }

    /// Pdf of [`Sky::sample`].
    pub(super) fn pdf_w(&self, table: &Table, d: Vec3) -> f32 {
        let (l, lowest) = (self.frame().to_local(d), self.lowest());
        if l.z < lowest {
            return 0.0;
        }
        let x = l.y.atan2(l.x) / TAU;
        let p = Vec2::new(if x < 0.0 { x + 1.0 } else { x }, (l.z - lowest) / (1.0 - lowest));
        table.pdf(p) / self.solid_angle()
    }

    /// A world direction towards the sky, by luminance; `None` if it is black.
    pub(super) fn sample(&self, table: &Table, u: Vec2) -> Option<Vec3> {
        Some(self.direction(table.sample(u)?.0))
    }
}
