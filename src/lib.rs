//! Caustica renders Mitsuba 3 scenes by photon mapping.
//!
//! # Conventions
//!
//! * Directions `wo` (towards the eye) and `wi` (the sampled one) both point away from the surface; in local
//!   coordinates z is the shading normal. For a photon, `wo` points back along its flight.
//! * Flux in W, radiance in W·m⁻²·sr⁻¹, lengths in scene units, angles in radians. [`math::Rgb`] is linear sRGB.
//! * Pdfs are named by measure: `pdf_w` per solid angle, `pdf_a` per area; probabilities of choices are `prob`.
//! * Hot paths return [`Option`], everything that reads or writes returns [`Result`].
//!
//! Direction of use: `cli` → `integrator` → {`photon`, `film`, `scene`} → {`accel`, `bsdf`, `light`, `camera`,
//! `texture`} → `shape` → `math`.

pub mod accel;
pub mod bsdf;
pub mod camera;
pub mod error;
pub mod film;
pub mod image_io;
pub mod integrator;
pub mod light;
pub mod math;
pub mod metrics;
pub mod part_file;
pub mod photon;
pub mod scene;
pub mod shape;
pub mod texture;

pub use error::{Error, Result};
