//! Sample streams: Owen-scrambled Sobol points (Burley 2020, "Practical Hash-based Owen Scrambling").

use glam::Vec2;
use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::{Int4, hash, hash_int4, owen_scramble_int4_rev, owen_scramble_rev, sobol_int4_rev};
use std::sync::LazyLock;

/// What a stream of samples is for. Streams of one seed are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// Camera paths; `set` is the pixel and the half of the film, `index` counts the samples of the half.
    Eye = 1,
    /// Photon paths of the global map; `set` is the pass, `index` the photon.
    GlobalPhotons = 2,
    /// Photon paths of the caustic map.
    CausticPhotons = 3,
    /// Camera rays before the first pass; `set` is the pixel, `index` the sample.
    Guides = 4,
    /// Photons that are sent ahead to learn where caustics come from.
    Pilots = 5,
    /// Photon paths that only show where light lands.
    Sites = 6,
}

/// One point of a low-discrepancy set, read dimension by dimension.
#[derive(Clone, Debug)]
pub struct Sampler {
    /// The point's index in the Sobol sequence, which is the given one after an Owen shuffle, with its bits reversed.
    index_rev: u32,
    seed: u32,
    set: u32,
    used: u32,
    buffer: [f32; 4],
}

/// What each value of each of the four nibbles of an index adds to four dimensions of its Sobol point: sums by `^`.
type Nibbles = [[Int4; 16]; 4];

/// For every four dimensions. A loop over the bits of an index would end with a branch that is mispredicted.
static SOBOL: LazyLock<Vec<Nibbles>> = LazyLock::new(|| {
    let value = |set, nibble: usize, value: usize| sobol_int4_rev((value as u32) << (28 - 4 * nibble), set);
    (0..NUM_DIMENSION_SETS_4D)
        .map(|set| std::array::from_fn(|nibble| std::array::from_fn(|v| value(set, nibble, v))))
        .collect()
});

/// A finaliser with full avalanche (Stafford's mix 13, as in SplitMix64).
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

impl Sampler {
    /// Sample `index` of the point set that (`seed`, `stream`, `set`) names. Points of one set are stratified
    /// against each other; different sets are independent.
    pub fn new(seed: u64, stream: Stream, set: u64, index: u64) -> Self {
        // A set holds 2^16 points; what lies beyond goes to further sets.
        let key = mix(mix(mix(seed ^ (stream as u64) << 56).wrapping_add(set)).wrapping_add(index >> 16));
        let seed = key as u32;
        let index_rev = owen_scramble_rev(((index & 0xffff) as u32).reverse_bits(), hash(seed ^ 0x79c6_8e4a));
        Sampler { index_rev, seed, set: 0, used: 4, buffer: [0.0; 4] }
    }

    fn refill(&mut self) {
        let (index, seed, set) = (self.index_rev, self.seed, self.set);
        self.buffer = if let Some(nibbles) = SOBOL.get(set as usize) {
            // As `sobol_burley::sample_4d` does it, to the last bit.
            let at = |nibble: usize| nibbles[nibble][(index >> (28 - 4 * nibble)) as usize % 16];
            let sobol = (at(0) ^ at(1)) ^ (at(2) ^ at(3));
            let key = seed.wrapping_mul(0x9c8f_2d3b) ^ set;
            let keys =
                [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8].map(|dimension: u32| key ^ dimension);
            owen_scramble_int4_rev(sobol, hash_int4(keys.into())).reverse_bits().to_f32_norm()
        } else {
            // Paths this long gain nothing from stratification: independent numbers.
            let a = mix((seed as u64) << 32 | index as u64).wrapping_add(mix(set as u64));
            let (a, b) = (mix(a), mix(a ^ 0x9e37_79b9_7f4a_7c15));
            let unit = |bits: u64| ((bits & 0xff_ffff) as f32) * (1.0 / 16_777_216.0);
            [unit(a), unit(a >> 32), unit(b), unit(b >> 32)]
        };
        self.set += 1;
        self.used = 0;
    }

    /// The next dimension, in [0, 1).
    pub fn next_1d(&mut self) -> f32 {
        if self.used > 3 {
            self.refill();
        }
        self.used += 1;
        self.buffer[self.used as usize - 1]
    }

    /// The next two dimensions, which are stratified together.
    pub fn next_2d(&mut self) -> Vec2 {
        if self.used > 2 {
            self.refill();
        }
        self.used += 2;
        Vec2::new(self.buffer[self.used as usize - 2], self.buffer[self.used as usize - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stays_in_the_unit_interval_and_is_uniform() {
        let (mut sum, mut n) = (0.0f64, 0);
        for index in 0..1000 {
            let mut s = Sampler::new(7, Stream::Eye, 3, index);
            for _ in 0..400 {
                let x = s.next_1d();
                assert!((0.0..1.0).contains(&x));
                sum += x as f64;
                n += 1;
            }
        }
        // Five standard deviations of independent samples.
        assert!((sum / n as f64 - 0.5).abs() < 5.0 * (1.0f64 / 12.0 / n as f64).sqrt());
    }

    #[test]
    fn points_are_those_of_sobol_burley() {
        for index in (0..65_536).step_by(251).chain([65_535]) {
            let mut s = Sampler::new(5, Stream::Sites, 9, index);
            for set in 0..NUM_DIMENSION_SETS_4D {
                let expected = sobol_burley::sample_4d(index as u32, set, s.seed);
                assert_eq!([(); 4].map(|()| s.next_1d()), expected, "point {index}, set {set}");
            }
        }
    }

    #[test]
    fn sets_and_streams_differ() {
        let first = |stream, set| Sampler::new(1, stream, set, 0).next_1d();
        assert_ne!(first(Stream::Eye, 0), first(Stream::Eye, 1));
        assert_ne!(first(Stream::Eye, 0), first(Stream::GlobalPhotons, 0));
    }
}
