//! Photon emission, transport, maps and density estimation.
