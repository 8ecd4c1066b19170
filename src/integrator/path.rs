//! The reference: a unidirectional path tracer with multiple importance sampling and Russian roulette. It uses no
//! photons, but sorts what it finds into the same [`Parts`] as photon mapping, so each part can be checked alone.

use super::direct::{self, Previous};
use super::{Params, Parts, Seen};
use crate::bsdf::{Mode, Share};
use crate::math::{Ray, Rgb, Sampler};
use crate::scene::Scene;

/// Path throughput, split by the part that light found from here on will belong to.
struct Throughput {
    /// The first vertex scattered by a sharp lobe.
    specular: Rgb,
    /// The first vertex scattered by a broad lobe, all others by sharp ones.
    caustic: Rgb,
    /// The rest.
    indirect: Rgb,
}

impl Throughput {
    fn total(&self) -> Rgb {
        self.specular + self.caustic + self.indirect
    }

    /// After scattering at vertex number `vertex` by a lobe of which `full` comes through in all, `broad` as light
    /// sees it, `broad_eye` as the eye sees it.
    fn scatter(&self, vertex: u32, full: Rgb, broad: Rgb, broad_eye: Rgb) -> Throughput {
        // A share that rounding has made greater than the whole leaves nothing, not less.
        let sharp = |broad: Rgb| (full - broad).max(Rgb::ZERO);
        if vertex == 1 {
            let before = self.total();
            Throughput {
                specular: before * sharp(broad_eye),
                caustic: before * broad_eye,
                indirect: Rgb::ZERO,
            }
        } else {
            Throughput {
                specular: self.specular * full,
                caustic: self.caustic * sharp(broad),
                indirect: self.indirect * full + self.caustic * broad,
            }
        }
    }

    /// `light` found after `bounces` of which the first was a delta one or not.
    fn parts(&self, light: Rgb, bounces: u32, first_delta: bool) -> Parts {
        if bounces == 0 || (bounces == 1 && !first_delta) {
            return Parts { direct: self.total() * light, ..Parts::default() };
        }
        Parts {
            direct: Rgb::ZERO,
            specular: self.specular * light,
            caustic: self.caustic * light,
            indirect: self.indirect * light,
        }
    }
}

/// Radiance along `ray`.
pub(super) fn radiance(
    scene: &Scene,
    params: &Params,
    mut ray: Ray,
    sampler: &mut Sampler,
    seen: &mut Seen,
    rays: &mut u64,
) -> Parts {
    let mut sum = Parts::default();
    let mut beta = Throughput { specular: Rgb::ONE, caustic: Rgb::ZERO, indirect: Rgb::ZERO };
    let mut eta = 1.0;
    let mut previous = Previous { p: ray.o, pdf_w: None };
    let mut first_delta = false;
    let mut straight = true;
    let max_depth = params.max_segments();
    // Vertices that have scattered. A crossed hole takes a segment, but is none.
    let mut bounces = 0;
    for depth in 1..=max_depth {
        *rays += 1;
        let hit = if bounces == 0 { direct::first_hit(scene, params, ray, rays) } else { scene.hit(&ray) };
        let Some(s) = hit else {
            if !(straight && params.hide_emitters) {
                sum += beta.parts(direct::background(scene, &ray, &previous), bounces, first_delta);
            }
            break;
        };
        sum += beta.parts(direct::emitted(scene, &s, &ray, &previous), bounces, first_delta);
        let is_crossed = s.is_crossed(sampler);
        if bounces == 0 && !is_crossed {
            seen.set_first(&s, previous.p);
        }
        if depth == max_depth {
            break;
        }
        if is_crossed {
            ray = s.spawn(ray.d);
            continue;
        }
        bounces += 1;

        let wo = s.frame.to_local(-ray.d);
        if s.bsdf.has_smooth() {
            let by_bsdf = |wi| s.bsdf.pdf_w(wo, wi, Mode::Radiance);
            let left = max_depth - depth;
            if let Some(lit) = direct::sample_light(scene, &s, wo, left, sampler, rays, by_bsdf) {
                let broad = |share| match s.bsdf.has_rough() {
                    true => s.bsdf.eval(wo, lit.wi, Mode::Radiance, share),
                    false => lit.f,
                };
                let next = beta.scatter(bounces, lit.f, broad(Share::BroadLight), broad(Share::BroadEye));
                sum += next.parts(lit.light, bounces, first_delta);
            }
        }

        let Some(sample) = s.bsdf.sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance) else {
            break;
        };
        beta = if sample.delta {
            first_delta |= bounces == 1;
            beta.scatter(bounces, sample.weight, Rgb::ZERO, Rgb::ZERO)
        } else {
            let broad = |share| match s.bsdf.has_rough() {
                true => s.bsdf.eval(wo, sample.wi, Mode::Radiance, share) / sample.pdf_w,
                false => sample.weight,
            };
            beta.scatter(bounces, sample.weight, broad(Share::BroadLight), broad(Share::BroadEye))
        };
        straight &= direct::goes_straight(&sample, wo);
        eta *= sample.eta;
        previous = Previous { p: s.p, pdf_w: (!sample.delta).then_some(sample.pdf_w) };
        ray = s.spawn(s.frame.to_world(sample.wi));

        if depth >= params.rr_depth {
            // eta² undoes the scaling of radiance inside glass, which says nothing about what the path will find.
            let survival = (beta.total().max_element() * eta * eta).min(0.95);
            let survives = sampler.next_1d() < survival; // false for NaN
            if !survives {
                break;
            }
            let scale = 1.0 / survival;
            beta.specular *= scale;
            beta.caustic *= scale;
            beta.indirect *= scale;
        }
    }
    sum
}
