//! Scattering about another normal than the shading normal: normal maps and bump maps, as Mitsuba 3.9 has them.
//!
//! What is seen from `eye` by light from `light` is f(eye, light)·|n'·light|, n' being the perturbed normal, times what
//! shadowing leaves; nothing if the perturbed and the shading normal disagree on which side the light is. These rules
//! are not symmetric, so photons, which arrive from the light, take them backwards: what they carry on is what a
//! camera path would have brought, times |n·eye| / |n·light| for the shading normal n that the integrators know (Veach
//! 1997, Eq. 5.19).

use super::{Bsdf, BsdfSample, Mode, Share};
use crate::math::{Frame, Rgb};
use glam::{Vec2, Vec3};

/// Probability with which a photon is scattered about the normal that views from behind would show.
const PROB_TURNED: f32 = 0.125;

/// How a perturbed normal is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Perturbation {
    /// Seen from behind, the perturbed normal is turned around the shading normal by 180° (`flip_invalid_normals`).
    pub flip_invalid: bool,
    /// Light fades towards the horizon instead of ending at it (`use_shadowing_function`).
    pub shadowing: bool,
}

/// A scattering function about the local normal `n`, with its tangent in the plane of `n` and `s`.
#[derive(Clone, Debug)]
pub(super) struct Perturbed<'a> {
    pub(super) n: Vec3,
    pub(super) s: Vec3,
    pub(super) rules: Perturbation,
    pub(super) nested: Bsdf<'a>,
}

impl Perturbed<'_> {
    /// The frame about the normal as it is, or turned.
    fn frame(&self, turned: bool) -> Frame {
        let n = if turned { Vec3::new(-self.n.x, -self.n.y, self.n.z) } else { self.n };
        Frame::from_normal_and_tangent(n, self.s)
    }

    /// Whether the normal is turned for a view from `eye`.
    fn turns(&self, eye: Vec3) -> bool {
        self.rules.flip_invalid && eye.z * eye.dot(self.n) <= 0.0
    }

    /// Estevez, Lecocq & Zwicker 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem",
    /// Ray Tracing Gems, ch. 12: GGX shadowing of a roughness that the tilt of the normal stands for.
    fn shadowing(&self, light: Vec3) -> f32 {
        if !self.rules.shadowing {
            return 1.0;
        }
        let tan2 = |w: Vec3| (1.0 - w.z * w.z).max(0.0) / (w.z * w.z);
        let alpha2 = (0.125 * tan2(self.n)).min(1.0);
        2.0 / (1.0 + (1.0 + alpha2 * tan2(light)).sqrt())
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, share: Share) -> Rgb {
        let (eye, light) = match mode {
            Mode::Radiance => (wo, wi),
            Mode::Flux => (wi, wo),
        };
        let frame = self.frame(self.turns(eye));
        let same_side = light.z * light.dot(frame.n) > 0.0; // false for NaN
        if !same_side {
            return Rgb::ZERO;
        }
        let f = self.nested.eval(frame.to_local(wo), frame.to_local(wi), mode, share) * self.shadowing(light);
        match mode {
            Mode::Radiance => f,
            Mode::Flux => {
                let adjoint = (light.dot(frame.n) * eye.z / (light.z * eye.dot(frame.n))).abs();
                if adjoint.is_finite() { f * adjoint } else { Rgb::ZERO }
            }
        }
    }

    pub(super) fn pdf_w(&self, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        let about = |turned| {
            let frame = self.frame(turned);
            self.nested.pdf_w(frame.to_local(wo), frame.to_local(wi), mode)
        };
        match mode {
            Mode::Radiance => about(self.turns(wo)),
            Mode::Flux if self.rules.flip_invalid => {
                about(false) * (1.0 - PROB_TURNED) + about(true) * PROB_TURNED
            }
            Mode::Flux => about(false),
        }
    }

    pub(super) fn sample(&self, wo: Vec3, mut u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        // Which way the normal is turned for a photon only the direction decides in which it leaves.
        let (turned, prob) = match mode {
            Mode::Radiance => (self.turns(wo), 1.0),
            Mode::Flux if !self.rules.flip_invalid => (false, 1.0),
            Mode::Flux if u_lobe < PROB_TURNED => {
                u_lobe /= PROB_TURNED;
                (true, PROB_TURNED)
            }
            Mode::Flux => {
                u_lobe = (u_lobe - PROB_TURNED) / (1.0 - PROB_TURNED);
                (false, 1.0 - PROB_TURNED)
            }
        };
        let frame = self.frame(turned);
        let s = self.nested.sample(frame.to_local(wo), u_lobe, u, mode)?;
        let wi = frame.to_world(s.wi).normalize();
        if !s.delta {
            let pdf_w = self.pdf_w(wo, wi, mode);
            let f = self.eval(wo, wi, mode, Share::All);
            return (pdf_w > 0.0).then(|| BsdfSample { wi, weight: f / pdf_w, pdf_w, ..s });
        }
        let (eye, light) = match mode {
            Mode::Radiance => (wo, wi),
            Mode::Flux => (wi, wo),
        };
        let possible = light.z * light.dot(frame.n) > 0.0 && self.turns(eye) == turned;
        let mut weight = s.weight * (self.shadowing(light) / prob);
        if mode == Mode::Flux {
            // The directions of a delta lobe are bound to each other, and so is |cosθ'| on both sides of it.
            weight *= (eye.z * light.dot(frame.n) / (light.z * eye.dot(frame.n))).abs();
        }
        (possible && weight.is_finite()).then_some(BsdfSample { wi, weight, ..s })
    }
}
