//! Where light comes from at a point, as the photons found there tell: a density of directions (Jensen 1995, "Importance
//! Driven Path Tracing using the Photon Map").

use super::estimate::Photons;
use super::kdtree::KnnHeap;
use super::map::PhotonMap;
use crate::math::{Frame, luminance, warp};
use glam::{Vec2, Vec3};

/// A sum of uniform cones around the directions of photons, weighted by flux. It lives in arrays by coordinate, full of
/// nothing beyond the cones, so that its pdf is a loop without branches.
#[derive(Clone, Debug)]
pub struct Incident {
    x: [f32; Incident::MOST],
    y: [f32; Incident::MOST],
    z: [f32; Incident::MOST],
    flux: [f32; Incident::MOST],
    len: usize,
    total: f32,
    share: f32,
}

impl Default for Incident {
    fn default() -> Self {
        let nothing = [0.0; Incident::MOST];
        Incident { x: nothing, y: nothing, z: nothing, flux: nothing, len: 0, total: 0.0, share: 0.0 }
    }
}

impl Incident {
    /// Photons that are looked at.
    const MOST: usize = 16;
    /// Sums that are formed at a time.
    const LANES: usize = 8;
    /// Fewer tell nothing.
    const FEWEST: usize = 4;
    /// Photons that are compared with all others.
    const PROBES: usize = 4;
    /// 1 − cos of the cones' half-angle, 14°.
    const WIDTH: f32 = 0.03;
    /// The share of directions to take from here where all light comes from one cone.
    const MOST_SHARE: f32 = 0.5;
    /// Less than this is not worth while.
    const LEAST_SHARE: f32 = 0.2;

    /// Forgets all photons.
    pub fn clear(&mut self) {
        self.share = 0.0;
    }

    /// The directions of those photons of `what` that `found` holds, evenly chosen where they are many.
    pub fn fill(&mut self, map: &PhotonMap, found: &KnnHeap, what: Photons) {
        (self.len, self.total, self.share) = (0, 0.0, 0.0);
        let stride = found.len().div_ceil(Self::MOST).max(1);
        for (slot, _) in found.iter().step_by(stride) {
            if what.hold(map, slot) {
                let (wi, flux) = (map.wi(slot), luminance(map.flux(slot)));
                let i = self.len;
                (self.x[i], self.y[i], self.z[i], self.flux[i]) = (wi.x, wi.y, wi.z, flux);
                self.len += 1;
                self.total += flux;
            }
        }
        self.flux[self.len..].fill(0.0);
        if self.len >= Self::FEWEST && self.total > 0.0 && self.total.is_finite() {
            let share = self.concentrated().min(Self::MOST_SHARE);
            self.share = if share < Self::LEAST_SHARE { 0.0 } else { share };
        }
    }

    /// The share of light that comes from one cone rather than from everywhere.
    ///
    /// If that is s, two photons lie within a cone of each other with the probability s² and some for the rest of them,
    /// which comes by the cosine: the cone's solid angle 2πw times the mean 2/3 of the cosine, over π.
    fn concentrated(&self) -> f32 {
        let (mut near, mut all) = (0.0, 0.0);
        for i in 0..self.len.min(Self::PROBES) {
            // Relative, for squares of flux may leave the range of numbers.
            let own = self.flux[i] / self.total;
            near += own * (self.within(self.direction(i)) / self.total - own).max(0.0);
            all += own * (1.0 - own);
        }
        let everywhere = 4.0 / 3.0 * Self::WIDTH;
        if all > 0.0 { (near / all - everywhere).max(0.0).sqrt() } else { 0.0 }
    }

    fn direction(&self, i: usize) -> Vec3 {
        Vec3::new(self.x[i], self.y[i], self.z[i])
    }

    /// Flux of the photons within a cone around `wi`.
    fn within(&self, wi: Vec3) -> f32 {
        let least = 1.0 - Self::WIDTH;
        let mut sums = [0.0; Self::LANES];
        for i in (0..Self::MOST).step_by(Self::LANES) {
            for (k, sum) in sums.iter_mut().enumerate() {
                let cos = self.x[i + k] * wi.x + self.y[i + k] * wi.y + self.z[i + k] * wi.z;
                *sum += if cos >= least { self.flux[i + k] } else { 0.0 };
            }
        }
        sums.iter().sum()
    }

    /// The share of directions to take from here, against those by the BSDF: 0 where nothing is known, or light comes from
    /// everywhere.
    pub fn share(&self) -> f32 {
        self.share
    }

    /// Density of the direction `wi` (world) per solid angle; 0 if nothing is known.
    pub fn pdf_w(&self, wi: Vec3) -> f32 {
        let sum = self.within(wi);
        if sum > 0.0 { sum / self.total * warp::cone_pdf_w(Self::WIDTH) } else { 0.0 }
    }

    /// A direction (world). There must be any.
    pub fn sample(&self, u: f32, u_cone: Vec2) -> Vec3 {
        let mut left = u * self.total;
        let mut i = 0;
        while i + 1 < self.len && left >= self.flux[i] {
            left -= self.flux[i];
            i += 1;
        }
        Frame::from_normal(self.direction(i)).to_world(warp::cone(u_cone, Self::WIDTH))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Sampler, Stream};
    use crate::photon::Photon;

    /// What is told of `n` photons that come to a floor from these directions.
    fn incident(n: u64, seed: u64, wi: impl Fn(&mut Sampler) -> Vec3) -> Incident {
        let photon = |index| {
            let mut u = Sampler::new(seed, Stream::GlobalPhotons, 0, index);
            let p = u.next_2d().extend(0.0);
            let flux = Vec3::new(1.0, 0.5, 0.2) * (0.5 + u.next_1d());
            Photon { p, wi: wi(&mut u), n_g: Vec3::Z, tag: 0, flux, depth: 2, caustic: false }
        };
        let map = PhotonMap::new(&(0..n).map(photon).collect::<Vec<_>>());
        let mut found = KnnHeap::new(n as usize);
        map.tree().nearest(Vec3::ZERO, 9.0, &mut found);
        // What was there before must not matter.
        let mut incident = Incident { flux: [9.0; Incident::MOST], ..Incident::default() };
        incident.fill(&map, &found, Photons { depths: (2, 9), caustics: false });
        incident
    }

    fn everywhere(u: &mut Sampler) -> Vec3 {
        warp::cosine_hemisphere(u.next_2d())
    }

    fn patch(u: &mut Sampler) -> Vec3 {
        Frame::from_normal(Vec3::new(0.6, 0.0, 0.8)).to_world(warp::cone(u.next_2d(), 0.01))
    }

    #[test]
    fn share_goes_with_concentration() {
        let mean = |n, wi: fn(&mut Sampler) -> Vec3| {
            (0..200).map(|seed| incident(n, seed, wi).share()).sum::<f32>() / 200.0
        };
        let half = |u: &mut Sampler| if u.next_1d() < 0.5 { patch(u) } else { everywhere(u) };
        let [none, some, all] = [mean(64, everywhere), mean(64, half), mean(64, patch)];
        assert!(
            none < 0.05 && (0.3..0.5).contains(&some) && all == Incident::MOST_SHARE,
            "{none} {some} {all}"
        );
        // Too few to tell.
        assert_eq!(incident(3, 1, patch).share(), 0.0);
    }

    /// Means of functions over samples are those over all directions by the pdf, within 5 standard deviations.
    #[test]
    fn samples_follow_the_pdf() {
        let half = |u: &mut Sampler| if u.next_1d() < 0.7 { patch(u) } else { everywhere(u) };
        let incident = incident(64, 4, half);
        assert!(incident.share() > 0.0);
        let functions: [fn(Vec3) -> f32; 5] = [|_| 1.0, |w| w.x, |w| w.y, |w| w.z * w.z, |w| w.x * w.z];
        for f in functions {
            let (mut sampled, mut integrated, mut squares) = (0.0f64, 0.0f64, 0.0f64);
            const N: u64 = 200_000;
            for index in 0..N {
                let mut u = Sampler::new(1, Stream::Eye, index, 0);
                sampled += f64::from(f(incident.sample(u.next_1d(), u.next_2d())));
                let w = warp::sphere(u.next_2d());
                let x = f64::from(f(w) * incident.pdf_w(w) / warp::SPHERE_PDF_W);
                integrated += x;
                squares += x * x;
            }
            let n = N as f64;
            let error = (squares / n / n).sqrt() + 1.0 / n.sqrt();
            let off = (sampled - integrated) / n;
            assert!(off.abs() < 5.0 * error && error < 0.02, "{off} {error}");
        }
    }
}
