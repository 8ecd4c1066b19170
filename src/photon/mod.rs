//! Photons: emission and transport ([`trace`]), storage ([`PhotonMap`]), lookup in a [`kdtree`] that knows only
//! points, and density estimation ([`Estimator`]).

mod estimate;
mod guide;
pub mod kdtree;
mod map;
mod octahedral;
mod splat;
mod trace;

pub use estimate::{Estimator, Kernel, Levels, Photons};
pub use guide::Guide;
pub use map::{Packed, Photon, PhotonMap};
pub use splat::{Splat, Splatter};
pub use trace::{Store, Traced, trace};
