//! The partition of light transport. Every path is counted by exactly one part; in Heckbert's notation, with x the
//! first vertex from the eye that scatters by a broad lobe:
//!
//! * direct: what is seen of lights themselves, and light that reaches the first vertex straight from a light;
//! * specular: everything that the first vertex scatters by a sharp lobe (except direct light on it);
//! * caustic: light that has met only sharp lobes on its way to x;
//! * indirect: the rest.
//!
//! A rough lobe is sharp by a share between 0 and 1 that changes smoothly with roughness, see
//! [`crate::bsdf::Share`]; the shares of a path always add up to one.

use crate::math::Rgb;
use std::ops::{Add, AddAssign, Mul};

/// One value for each part of the picture; their sum is the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parts {
    /// Lights seen directly, and light straight from lights.
    pub direct: Rgb,
    /// All that sharp lobes show.
    pub specular: Rgb,
    /// Caustics on the first visible surface.
    pub caustic: Rgb,
    /// Diffuse indirect light on the first visible surface.
    pub indirect: Rgb,
}

impl Parts {
    /// The picture.
    pub fn sum(&self) -> Rgb {
        self.direct + self.specular + self.caustic + self.indirect
    }
}

impl AddAssign for Parts {
    fn add_assign(&mut self, o: Parts) {
        *self = *self + o;
    }
}

impl Add for Parts {
    type Output = Parts;

    fn add(self, o: Parts) -> Parts {
        Parts {
            direct: self.direct + o.direct,
            specular: self.specular + o.specular,
            caustic: self.caustic + o.caustic,
            indirect: self.indirect + o.indirect,
        }
    }
}

impl Mul<Rgb> for Parts {
    type Output = Parts;

    fn mul(self, c: Rgb) -> Parts {
        Parts {
            direct: self.direct * c,
            specular: self.specular * c,
            caustic: self.caustic * c,
            indirect: self.indirect * c,
        }
    }
}
