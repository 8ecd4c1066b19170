//! Comparing images.
