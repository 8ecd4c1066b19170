//! Light sources: their radiance, direct sampling of them from a point, and emission of photons.
//!
//! Every light kind emits photons exactly as it lights directly: [`Lights::sample_emission`] and
//! [`Lights::sample_direct`] describe one and the same radiance.

mod envmap;
mod spot;

pub use envmap::Envmap;
pub use spot::Spot;

use crate::math::{Discrete, Rgb};
use crate::shape::Geometry;
use crate::texture::{Color, Texture};
use glam::{Vec2, Vec3};

/// A direction towards a light, sampled from a point.
#[derive(Clone, Copy, Debug)]
pub struct DirectSample {
    /// World direction to the light, unit length.
    pub wi: Vec3,
    /// The point on the light, already moved off its surface; `None` if it is infinitely far away. The shadow ray
    /// ends there.
    pub target: Option<Vec3>,
    /// L_e / (pdf_w · prob(light)), or the irradiance-like I/d² / prob(light) of a delta light.
    pub weight: Rgb,
    /// Solid-angle pdf including the probability of choosing the light; of no meaning for a delta light.
    pub pdf_w: f32,
    /// Whether BSDF sampling can never find this light (point, spot, directional).
    pub delta: bool,
}

/// A photon at its start.
#[derive(Clone, Copy, Debug)]
pub struct EmissionSample {
    /// Origin, already moved off the light's surface.
    pub o: Vec3,
    /// Flight direction, unit length.
    pub d: Vec3,
    /// α₀ = L_e cosθ / (pdf_a pdf_w prob(light)), in W: the photon's flux if one photon is emitted.
    pub flux: Rgb,
    /// Index of the light.
    pub light: u32,
}

/// The closed set of lights.
#[derive(Clone, Debug)]
pub enum Light {
    /// A shape that emits `radiance` from its front side (geometric normal).
    Area {
        /// Index of the shape.
        shape: u32,
        /// Emitted radiance.
        radiance: Color,
    },
    /// A point with the same intensity in all directions.
    Point {
        /// Position.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A point with angular falloff.
    Spot(Spot),
    /// Parallel light from infinitely far away.
    Directional {
        /// The direction in which the light travels, unit length.
        direction: Vec3,
        /// Irradiance on a surface facing the light, W per unit area.
        irradiance: Rgb,
    },
    /// The same radiance from everywhere.
    Constant {
        /// Radiance.
        radiance: Rgb,
    },
    /// A distant image all around.
    Envmap(Envmap),
}

/// All lights of a scene, and what is needed to choose among them.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    lights: Vec<Light>,
    by_power: Discrete,
}

impl Lights {
    /// Prepares sampling. `geometry` is the whole scene: distant lights emit towards its bounding sphere.
    pub fn new(lights: Vec<Light>, geometry: &Geometry, textures: &[Texture]) -> Self {
        let _ = (geometry, textures);
        Lights { lights, by_power: Discrete::default() }
    }

    /// The lights.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// Analytic power of light `i`, W per channel; a distant light's is what it sends through the scene's bounding
    /// sphere.
    pub fn power(&self, i: u32) -> Rgb {
        let _ = i;
        Rgb::ZERO
    }

    /// Chooses a light by power with `u_light` and a direction from the point `p` to it with `u`.
    pub fn sample_direct(
        &self,
        geometry: &Geometry,
        textures: &[Texture],
        p: Vec3,
        u_light: f32,
        u: Vec2,
    ) -> Option<DirectSample> {
        let _ = (geometry, textures, p, u_light, u, &self.by_power);
        None
    }

    /// Radiance that area light `light` emits at a surface point with geometric normal `n_g` towards `wo`.
    pub fn emitted(&self, light: u32, textures: &[Texture], uv: Vec2, n_g: Vec3, wo: Vec3) -> Rgb {
        let _ = (light, textures, uv, n_g, wo);
        Rgb::ZERO
    }

    /// Pdf with which [`Lights::sample_direct`] from `from` would have taken direction `wi` to the point `p` of the
    /// area light `light` (geometric normal `n_g` there).
    pub fn pdf_emitted_w(
        &self,
        light: u32,
        geometry: &Geometry,
        from: Vec3,
        wi: Vec3,
        p: Vec3,
        n_g: Vec3,
    ) -> f32 {
        let _ = (light, geometry, from, wi, p, n_g);
        0.0
    }

    /// Radiance of all environment lights along the escaping direction `d`.
    pub fn background(&self, d: Vec3) -> Rgb {
        let _ = d;
        Rgb::ZERO
    }

    /// Pdf with which [`Lights::sample_direct`] would have taken the escaping direction `d`.
    pub fn pdf_background_w(&self, d: Vec3) -> f32 {
        let _ = d;
        0.0
    }

    /// Emits a photon: a light by power, a position by `u_pos`, a direction by `u_dir`.
    pub fn sample_emission(
        &self,
        geometry: &Geometry,
        textures: &[Texture],
        u_light: f32,
        u_pos: Vec2,
        u_dir: Vec2,
    ) -> Option<EmissionSample> {
        let _ = (geometry, textures, u_light, u_pos, u_dir);
        None
    }
}
