//! Sample streams: Owen-scrambled Sobol points (Burley 2020, "Practical Hash-based Owen Scrambling").

use glam::Vec2;

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
    index: u32,
    seed: u32,
    set: u32,
    used: u32,
    buffer: [f32; 4],
}

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
        Sampler { index: (index & 0xffff) as u32, seed: key as u32, set: 0, used: 4, buffer: [0.0; 4] }
    }

    fn refill(&mut self) {
        self.buffer = if self.set < sobol_burley::NUM_DIMENSION_SETS_4D {
            sobol_burley::sample_4d(self.index, self.set, self.seed)
        } else {
            // Paths this long gain nothing from stratification: independent numbers.
            let a = mix((self.seed as u64) << 32 | self.index as u64).wrapping_add(mix(self.set as u64));
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
    fn sets_and_streams_differ() {
        let first = |stream, set| Sampler::new(1, stream, set, 0).next_1d();
        assert_ne!(first(Stream::Eye, 0), first(Stream::Eye, 1));
        assert_ne!(first(Stream::Eye, 0), first(Stream::GlobalPhotons, 0));
    }
}
