//! Photons: emission, tracing, the maps they are kept in, and density estimation.

pub mod kdtree;
