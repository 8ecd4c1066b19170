//! A bright disk infinitely far away.

use crate::math::{Frame, Rgb, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_PI_2;

/// A round light infinitely far away, such as the sun.
#[derive(Clone, Debug)]
pub struct Sun {
    /// Towards the disk's centre.
    direction: Vec3,
    /// Of the disk's half-angle.
    one_minus_cos: f32,
    /// Mean over the whole disk.
    radiance: Rgb,
    /// Whether the disk darkens towards its rim.
    limb: bool,
    /// Below the plane with this normal nothing is seen.
    up: Vec3,
    /// ∫ L dω over what is above the horizon.
    integral: Rgb,
}

/// The disk's radiance over its mean, for red, green and blue: ascending powers of the cosine at which the line of sight
/// meets the sun's surface. Fitted to the sun of Hošek & Wilkie 2013 ("Adding a Solar-Radiance Function to the
/// Hošek–Wilkie Skylight Model") at turbidity 3 and 45° of elevation, other skies differ by 2 % at most.
const LIMB: [[f32; 6]; 3] = [
    [0.40093, 1.63496, -2.32885, 3.10275, -2.28771, 0.68246],
    [0.31750, 1.66150, -1.82871, 2.11254, -1.39335, 0.38016],
    [0.20853, 1.64585, -1.21994, 1.26843, -0.78013, 0.19909],
];

impl Sun {
    /// A disk of `half_angle` (radians) around the unit vector `direction` that gives `irradiance` (W·m⁻²) to a surface
    /// facing it. `horizon` is the unit normal of a plane below which nothing is seen.
    ///
    /// # Errors
    /// A message if the angle does not lie between 0 and a right angle, or the irradiance is negative or infinite.
    pub fn new(
        direction: Vec3,
        half_angle: f32,
        irradiance: Rgb,
        limb: bool,
        horizon: Option<Vec3>,
    ) -> Result<Sun, String> {
        if !(half_angle > 0.0 && half_angle < FRAC_PI_2) {
            let degrees = 2.0 * half_angle.to_degrees();
            return Err(format!("the sun must span more than 0 and less than 180 degrees, not {degrees}"));
        }
        if !(irradiance.is_finite() && irradiance.min_element() >= 0.0) {
            return Err(format!("the sun's irradiance is {irradiance}"));
        }
        let one_minus_cos = 2.0 * (0.5 * half_angle).sin().powi(2);
        let sun = Sun {
            direction,
            one_minus_cos,
            radiance: irradiance * warp::cone_pdf_w(one_minus_cos),
            limb,
            up: horizon.unwrap_or(direction),
            integral: Rgb::ZERO,
        };
        if !sun.radiance.is_finite() {
            return Err(format!("a sun of {irradiance} on so small a disk is too bright"));
        }
        Ok(Sun { integral: sun.mean() / warp::cone_pdf_w(one_minus_cos), ..sun })
    }

    /// Mean radiance over the disk, what is below the horizon included.
    fn mean(&self) -> Rgb {
        const N: u32 = 1 << 12;
        // Hammersley points.
        let point = |i: u32| Vec2::new(i as f32 + 0.5, (i.reverse_bits() >> 20) as f32 + 0.5) / N as f32;
        let sum = (0..N).fold(glam::DVec3::ZERO, |sum, i| sum + self.eval(self.sample(point(i))).as_dvec3());
        (sum / N as f64).as_vec3()
    }

    /// ∫ L dω.
    pub(super) fn integral(&self) -> Rgb {
        self.integral
    }

    /// 1 − cos of the angle between the unit vector `d` and the disk's centre. Not from their product, which cannot tell
    /// directions on so small a disk apart.
    fn off(&self, d: Vec3) -> f32 {
        0.5 * d.distance_squared(self.direction)
    }

    /// Radiance from the world direction `d`.
    pub(super) fn eval(&self, d: Vec3) -> Rgb {
        let off = self.off(d);
        if off > self.one_minus_cos || d.dot(self.up) < 0.0 {
            return Rgb::ZERO;
        }
        if !self.limb {
            return self.radiance;
        }
        // The sun being a sphere, sines of angles are distances from its centre.
        let sin2 = |omc: f32| omc * (2.0 - omc);
        let mu = (1.0 - sin2(off) / sin2(self.one_minus_cos)).max(0.0).sqrt();
        let darkened = LIMB.map(|limb| limb.iter().rev().fold(0.0, |sum, c| sum * mu + c));
        self.radiance * Rgb::from_array(darkened)
    }

    /// Pdf of [`Sun::sample`].
    pub(super) fn pdf_w(&self, d: Vec3) -> f32 {
        if self.off(d) > self.one_minus_cos { 0.0 } else { warp::cone_pdf_w(self.one_minus_cos) }
    }

    /// A world direction towards the disk, uniform.
    pub(super) fn sample(&self, u: Vec2) -> Vec3 {
        Frame::from_normal(self.direction).to_world(warp::cone(u, self.one_minus_cos)).normalize()
    }
}
