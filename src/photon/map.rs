//! The photon map: records of 15 bytes in tree order beside the tree's positions, 27.2 bytes a photon in all.

use super::kdtree::KdTree;
use super::octahedral::{Direction, decode8, decode16, direction16, encode8, encode16};
use crate::math::Rgb;
use glam::Vec3;
use rayon::prelude::*;

/// A photon where it lands, as transport hands it over.
#[derive(Clone, Copy, Debug)]
pub struct Photon {
    /// Where it landed.
    pub p: Vec3,
    /// Unit direction back along its flight, world.
    pub wi: Vec3,
    /// Geometric normal of the surface.
    pub n_g: Vec3,
    /// Tells the surface from others.
    pub tag: u8,
    /// Flux, W, already divided by the number of emitted photons.
    pub flux: Rgb,
    /// Segments flown, 1 for a photon straight from its light.
    pub depth: u8,
    /// Whether it has met nothing but sharp lobes, and at least one.
    pub caustic: bool,
}

/// A stored photon. Flux is three 16-bit mantissas with one exponent, so any magnitude keeps 16 bits. Of bytes, so that none is
/// lost to alignment.
#[derive(Clone, Copy, Debug)]
struct Record {
    wi: [[u8; 2]; 2],
    mantissa: [[u8; 2]; 3],
    n_g: [i8; 2],
    tag: u8,
    exponent: u8,
    /// Segments, as far as seven bits count; the eighth marks caustics.
    depth: u8,
}

const CAUSTIC: u8 = 0x80;

/// 2^(e − 127 − 15) as a factor of mantissas.
fn exponent_factor(e: u8) -> f32 {
    f32::from_bits((e as u32) << 23) * (1.0 / 32768.0)
}

impl Record {
    fn new(photon: &Photon) -> Record {
        // The exponent of the largest channel, so that mantissas stay below 2^16.
        let e = (photon.flux.max_element().to_bits() >> 23).clamp(1, 254) as u8;
        let mantissa = (photon.flux / exponent_factor(e)).round().to_array();
        Record {
            wi: encode16(photon.wi).map(i16::to_ne_bytes),
            mantissa: mantissa.map(|m| (m as u16).to_ne_bytes()),
            n_g: encode8(photon.n_g),
            tag: photon.tag,
            exponent: e,
            depth: photon.depth.min(!CAUSTIC) | if photon.caustic { CAUSTIC } else { 0 },
        }
    }

    fn flux(&self) -> Rgb {
        let mantissa = self.mantissa.map(|m| f32::from(u16::from_ne_bytes(m)));
        Rgb::from_array(mantissa) * exponent_factor(self.exponent)
    }

    fn wi(&self) -> [i16; 2] {
        self.wi.map(i16::from_ne_bytes)
    }
}

/// A photon as it is kept until a map is built, 28 bytes.
#[derive(Clone, Copy, Debug)]
pub struct Packed {
    p: Vec3,
    record: Record,
}

impl Packed {
    /// The same photon, with directions, normal and flux rounded as in a map.
    pub fn unpack(&self) -> Photon {
        let Packed { p, record } = self;
        Photon {
            p: *p,
            wi: decode16(record.wi()),
            n_g: decode8(record.n_g),
            tag: record.tag,
            flux: record.flux(),
            depth: record.depth & !CAUSTIC,
            caustic: record.depth & CAUSTIC != 0,
        }
    }
}

impl From<Photon> for Packed {
    fn from(photon: Photon) -> Packed {
        Packed { p: photon.p, record: Record::new(&photon) }
    }
}

/// Photons, found by position.
#[derive(Debug)]
pub struct PhotonMap {
    tree: KdTree,
    records: Vec<Record>,
}

impl PhotonMap {
    /// No photon is told to have flown more segments.
    pub const MAX_DEPTH: u32 = !CAUSTIC as u32;

    /// Builds the map; the order of `photons` decides ties, so equal input gives equal maps.
    pub fn new(photons: &[Photon]) -> PhotonMap {
        PhotonMap::of_packed(photons.iter().map(|&photon| photon.into()).collect())
    }

    /// The same from photons that are packed already. Takes 60 bytes a photon at most, theirs included.
    pub fn of_packed(photons: Vec<Packed>) -> PhotonMap {
        let (tree, order) = KdTree::build_by(photons.len(), |i| photons[i].p);
        let records = order.par_iter().map(|&i| photons[i as usize].record).collect();
        PhotonMap { tree, records }
    }

    /// How many photons it holds.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether it is empty.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// The tree over the positions; its slots index the photons.
    pub fn tree(&self) -> &KdTree {
        &self.tree
    }

    /// Direction back along the flight of the photon in `slot`.
    pub fn wi(&self, slot: u32) -> Vec3 {
        decode16(self.records[slot as usize].wi())
    }

    /// The same, of a length between 0.57 and 1.
    pub(super) fn direction(&self, slot: u32) -> Vec3 {
        direction16(self.records[slot as usize].wi())
    }

    /// Whether the geometric normal under the photon in `slot` makes an angle with `n` whose cosine exceeds `cos`, give or
    /// take a degree.
    pub(super) fn faces(&self, slot: u32, n: &Direction, cos: f32) -> bool {
        n.agrees(self.records[slot as usize].n_g, cos)
    }

    /// Whether the photon in `slot` may lie on the surface with `tag`.
    pub(super) fn is_on(&self, slot: u32, tag: u8) -> bool {
        self.records[slot as usize].tag == tag
    }

    /// Flux of the photon in `slot`.
    pub fn flux(&self, slot: u32) -> Rgb {
        self.records[slot as usize].flux()
    }

    /// Segments that the photon in `slot` has flown, 127 at most.
    pub fn depth(&self, slot: u32) -> u32 {
        (self.records[slot as usize].depth & !CAUSTIC) as u32
    }

    /// Whether the photon in `slot` is part of a caustic.
    pub fn is_caustic(&self, slot: u32) -> bool {
        self.records[slot as usize].depth & CAUSTIC != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flux_keeps_sixteen_bits_at_any_magnitude() {
        assert_eq!(std::mem::size_of::<Record>(), 15);
        for magnitude in [1e-30f32, 1e-7, 1.0, 3.999_999, 4.0, 1e20, 3e38] {
            let flux = Rgb::new(1.0, 0.37, 0.0) * magnitude;
            let photon =
                Photon { p: Vec3::ZERO, wi: Vec3::Z, n_g: Vec3::Z, tag: 0, flux, depth: 1, caustic: false };
            let error = (Record::new(&photon).flux() - flux).abs().max_element();
            assert!(error <= magnitude * 2f32.powi(-15), "{magnitude}: {error}");
        }
        let dark = Photon {
            p: Vec3::ZERO,
            wi: Vec3::Z,
            n_g: Vec3::Z,
            tag: 0,
            flux: Rgb::ZERO,
            depth: 1,
            caustic: false,
        };
        assert_eq!(Record::new(&dark).flux(), Rgb::ZERO);
    }
}
