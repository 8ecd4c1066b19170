//! Two scattering functions side by side.

use super::{Bsdf, BsdfSample, Mode, Share};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// f = (1 − weight) f₀ + weight f₁.
#[derive(Clone, Debug)]
pub(super) struct Blend<'a> {
    pub(super) weight: f32,
    pub(super) bsdfs: [Bsdf<'a>; 2],
}

impl<'a> Blend<'a> {
    /// The weights, and whom they belong to.
    fn parts(&self) -> impl Iterator<Item = (f32, &Bsdf<'a>)> {
        [1.0 - self.weight, self.weight].into_iter().zip(&self.bsdfs)
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        self.parts().map(|(weight, bsdf)| weight * bsdf.eval(wo, wi, mode, share)).sum()
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        self.parts().map(|(weight, bsdf)| weight * bsdf.pdf_w(wo, wi, mode)).sum()
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        let [first, second] = &self.bsdfs;
        let s = if u_lobe < self.weight {
            second.sample(wo, u_lobe / self.weight, u, mode)?
        } else {
            first.sample(wo, (u_lobe - self.weight) / (1.0 - self.weight), u, mode)?
        };
        if s.delta {
            // The weight of the lobe is the probability of choosing it.
            return Some(s);
        }
        let pdf_w = self.pdf_w(wo, s.wi, mode);
        let f = self.eval(wo, s.wi, mode, Share::All);
        (pdf_w > 0.0).then(|| BsdfSample { weight: f / pdf_w, pdf_w, ..s })
    }

    pub(super) fn any(&self, has: impl Fn(&Bsdf<'a>) -> bool) -> bool {
        self.parts().any(|(weight, bsdf)| weight > 0.0 && has(bsdf))
    }

    pub(super) fn albedo(&self) -> Rgb {
        self.bsdfs[0].albedo().lerp(self.bsdfs[1].albedo(), self.weight)
    }
}
