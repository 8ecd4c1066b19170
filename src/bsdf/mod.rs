//! Scattering at a surface point whose textures are already looked up: small `Copy` values in local coordinates
//! (z = shading normal), so this module knows neither textures nor scene.
//!
//! `eval` includes the cosine. Rough lobes belong to two *classes* at once, by weights that change smoothly with
//! roughness: that is how the light transport is split without a threshold; see [`Share`].

use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// What the scattered quantity is: refraction scales radiance, never flux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Camera paths.
    Radiance,
    /// Photons.
    Flux,
}

/// Which share of the non-delta lobes takes part. A microfacet lobe of roughness α counts with `1 − sharp(α)` to a
/// broad share, a diffuse lobe with 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Share {
    /// All non-delta lobes, in full.
    All,
    /// What density estimation can evaluate at the first vertex seen from the eye.
    BroadEye,
    /// What light must leave from for final gathering to find it; the rest carries caustics.
    BroadLight,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Local direction.
    pub wi: Vec3,
    /// f·|cosθ_i| / pdf over all non-delta lobes, or the delta lobe's reflectance over its probability.
    pub weight: Rgb,
    /// Pdf of all non-delta lobes together; of no meaning for a delta lobe.
    pub pdf_w: f32,
    /// Whether a delta lobe was chosen.
    pub delta: bool,
    /// Relative index of refraction along the path (1 for reflection): transmitted side over incident side.
    pub eta: f32,
}

/// The closed set of scattering functions.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf<'a> {
    /// Lambertian reflection from the front side.
    Diffuse {
        /// Albedo.
        reflectance: Rgb,
        /// Later variants borrow tables.
        marker: std::marker::PhantomData<&'a ()>,
    },
}

impl<'a> Bsdf<'a> {
    /// Lambertian reflection.
    pub fn diffuse(reflectance: Rgb) -> Self {
        Bsdf::Diffuse { reflectance, marker: std::marker::PhantomData }
    }

    /// f(wo, wi)·|cosθ_i| of the non-delta lobes.
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        let _ = (wo, wi, mode, share);
        Rgb::ZERO
    }

    /// Pdf with which [`Bsdf::sample`] takes `wi` from a non-delta lobe.
    pub fn pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        let _ = (wo, wi);
        0.0
    }

    /// Samples a lobe by `u_lobe` and a direction by `u`.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        let _ = (wo, u_lobe, u, mode);
        None
    }

    /// Whether any lobe is not a delta: photons are stored and light is sampled there.
    pub fn has_smooth(&self) -> bool {
        true
    }
}
