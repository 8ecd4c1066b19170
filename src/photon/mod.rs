//! Photons: emission and transport ([`trace`]), storage ([`PhotonMap`]), lookup in a [`kdtree`] that knows only
//! points, and density estimation ([`Estimator`]).

mod area;
mod estimate;
mod guide;
mod importance;
mod incident;
mod irradiance;
pub mod kdtree;
mod map;
mod octahedral;
mod pilots;
mod splat;
mod trace;

pub use estimate::{Among, Estimator, Kernel, Levels, Photons, Place, Site};
pub use guide::Guide;
pub use importance::{Importance, Uses};
pub use incident::Incident;
pub use irradiance::Irradiance;
pub use map::{Packed, Photon, PhotonMap};
pub use pilots::{Learnt, Tally};
pub use splat::{Splat, Splatter};
pub use trace::{Emission, Start, Store, Traced, trace};
