//! Camera paths over the photon maps of one pass.

use super::direct::{self, Previous};
use super::effort::Effort;
use super::maps::{Maps, Scratch};
use super::{DirectLight, Params, Parts, Seen};
use crate::bsdf::{BsdfSample, Mode, Share};
use crate::math::{Ray, Rgb, Sampler, luminance};
use crate::photon::{Incident, Levels};
use crate::scene::{Scene, Surface};
use glam::Vec3;

/// The end of a camera path that is still growing.
#[derive(Clone, Copy)]
pub(super) struct Walk {
    ray: Ray,
    /// Segments, this one included.
    depth: u32,
    /// Whether nothing has scattered yet; holes may have been crossed.
    first: bool,
    beta: Rgb,
    /// Throughput of light that the next vertex emits; zero where another part already counts it.
    beta_emitted: Rgb,
    /// The part that such light belongs to.
    emitted_part: fn(&mut Parts) -> &mut Rgb,
    /// Whether the path has left a vertex by a broad lobe: what it finds is indirect light.
    gathering: bool,
    /// Whether the first vertex has scattered by a sharp lobe.
    through_sharp: bool,
    /// Whether the path has only passed what does not bend it.
    straight: bool,
    /// Whether it has met nothing but delta lobes.
    delta: bool,
    /// Whether a surface that scatters broadly has been seen.
    known: bool,
    /// Product of the relative indices of refraction.
    eta: f32,
    previous: Previous,
}

impl Walk {
    /// A gather ray, its path's segment number `depth`, that shows indirect light only.
    pub(super) fn gather(ray: Ray, depth: u32) -> Walk {
        Walk {
            ray,
            depth,
            first: false,
            beta: Rgb::ONE,
            beta_emitted: Rgb::ZERO,
            emitted_part: |parts| &mut parts.indirect,
            gathering: true,
            through_sharp: false,
            straight: false,
            delta: false,
            known: true,
            eta: 1.0,
            previous: Previous { p: ray.o, pdf_w: None },
        }
    }

    /// How much throughput `beta` counts for: eta² undoes the scaling of radiance inside glass, which says
    /// nothing about what the path will find.
    fn shown(&self, beta: Rgb) -> f32 {
        beta.max_element() * self.eta * self.eta
    }

    /// The part of the picture that a gather ray adds to.
    fn indirect_part(&self) -> fn(&mut Parts) -> &mut Rgb {
        match self.through_sharp {
            true => |parts| &mut parts.specular,
            false => |parts| &mut parts.indirect,
        }
    }
}

/// The least throughput of a path that is followed beside another one from the same interface.
const DIMMEST: f32 = 1e-3;

/// Camera paths over the maps of one pass.
pub(super) struct Eye<'a> {
    pub(super) scene: &'a Scene,
    pub(super) params: &'a Params,
    pub(super) maps: &'a Maps,
    /// Whether gather rays go on as paths; if not, the global map tells what they find.
    pub(super) traces: bool,
    /// In how many directions to look for lights; one without it.
    pub(super) effort: Option<&'a Effort>,
    /// Whether to tell what lies first and how dense photons are there.
    pub(super) aovs: bool,
}

impl Eye<'_> {
    /// Radiance along `ray`, wide and fine (see [`crate::film::Film`]).
    ///
    /// The path follows sharp lobes, and at every vertex that scatters light into them by broad lobes too it
    /// collects direct light and caustics. When it first leaves by a broad lobe it has become a gather ray:
    /// what it now meets is taken from the global map, through any sharp lobes on the way, or from lights and
    /// from the caustic map at each vertex of the path as which it goes on. Both lobes of a
    /// smooth interface are followed, as long as neither is too dim: seen by chance, a lamp's reflection
    /// within glass would be rare and blinding.
    pub(super) fn radiance(
        &self,
        ray: Ray,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        seen: &mut Seen,
        rays: &mut u64,
    ) -> [Parts; 2] {
        let walk = Walk {
            ray,
            depth: 1,
            first: true,
            beta: Rgb::ONE,
            beta_emitted: Rgb::ONE,
            emitted_part: |parts| &mut parts.direct,
            gathering: false,
            through_sharp: false,
            straight: true,
            delta: true,
            known: false,
            eta: 1.0,
            previous: Previous { p: ray.o, pdf_w: None },
        };
        self.follow(walk, sampler, scratch, seen, rays)
    }

    /// What `walk` and all that branches off it show.
    pub(super) fn follow(
        &self,
        walk: Walk,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        seen: &mut Seen,
        rays: &mut u64,
    ) -> [Parts; 2] {
        let mut sum = [Parts::default(); 2];
        let mut pending = Vec::new();
        let mut next = Some(walk);
        while let Some(mut walk) = next.or_else(|| pending.pop()) {
            *rays += 1;
            seen.smooth |= walk.delta && !walk.first;
            let hit = match walk.first {
                true => direct::first_hit(self.scene, self.params, walk.ray, rays),
                false => self.scene.hit(&walk.ray),
            };
            // By reference: a surface is large.
            let Some(s) = &hit else {
                if !walk.known {
                    seen.add_background(walk.beta, &walk.ray, self.scene);
                }
                if !(walk.straight && self.params.hide_emitters) {
                    let light = direct::background(self.scene, &walk.ray, &walk.previous);
                    sum.iter_mut().for_each(|sum| *(walk.emitted_part)(sum) += walk.beta_emitted * light);
                    if walk.delta {
                        seen.emitted += walk.beta_emitted * light;
                    }
                }
                next = None;
                continue;
            };
            let emitted = direct::emitted(self.scene, s, &walk.ray, &walk.previous);
            sum.iter_mut().for_each(|sum| *(walk.emitted_part)(sum) += walk.beta_emitted * emitted);
            if walk.delta {
                seen.emitted += walk.beta_emitted * emitted;
            }
            let may_go_on = walk.depth < self.params.max_segments();
            if s.is_crossed(sampler) {
                next = may_go_on.then(|| Walk { ray: s.spawn(walk.ray.d), depth: walk.depth + 1, ..walk });
                continue;
            }
            if self.aovs && walk.first {
                seen.set_first(s, walk.previous.p);
                seen.density = self.maps.density(s, scratch);
            }
            if !walk.known && (s.bsdf.has_smooth() || s.light.is_some()) {
                walk.known = true;
                seen.add_surface(walk.beta, s, self.scene);
            }
            if !may_go_on || walk.beta == Rgb::ZERO {
                next = None;
                continue;
            }
            let wo = s.frame.to_local(-walk.ray.d);
            let directions = self.directions(&walk, s, wo);
            let here = self.collect(&walk, s, wo, directions, sampler, scratch, rays);
            sum.iter_mut().zip(here).for_each(|(sum, here)| *sum += here);
            if !self.looks_further(s) {
                next = None;
                continue;
            }
            next = match s.bsdf.split(wo, Mode::Radiance) {
                Some([a, b]) if walk.delta && walk.shown(walk.beta * a.weight.min(b.weight)) >= DIMMEST => {
                    pending.extend(self.scatter(&walk, s, wo, &a, 1.0, sampler));
                    self.scatter(&walk, s, wo, &b, 1.0, sampler)
                }
                _ => sample(s, wo, &scratch.incident, sampler).and_then(|sample| {
                    let share = match directions {
                        1 => 1.0,
                        n => sample.pdf_w / density(s, wo, sample.wi, &scratch.incident, n),
                    };
                    self.scatter(&walk, s, wo, &sample, share, sampler)
                }),
            };
        }
        sum
    }

    /// In how many directions to look for lights from `s`.
    fn directions(&self, walk: &Walk, s: &Surface, wo: Vec3) -> u32 {
        match self.effort {
            Some(effort) if self.traces || !walk.gathering => {
                let all = effort.directions(s, wo);
                // Fewer where less of what is found shows.
                ((all as f32 * walk.shown(walk.beta)).ceil() as u32).clamp(1, all)
            }
            _ => 1,
        }
    }

    /// Whether rays that leave by broad lobes find anything but lights.
    fn gathers(&self) -> bool {
        self.traces || self.maps.gathers()
    }

    /// Whether a path may find anything behind `s`: by sharp lobes always.
    fn looks_further(&self, s: &Surface) -> bool {
        self.gathers() || self.params.direct != DirectLight::Off || s.bsdf.diffuse_only().is_none()
    }

    /// Light that broad lobes send along the path from the surface where it has arrived, wide and fine.
    /// Lights are looked for in so many `directions`, of which the path itself takes the last.
    #[allow(clippy::too_many_arguments)]
    fn collect(
        &self,
        walk: &Walk,
        s: &Surface,
        wo: Vec3,
        directions: u32,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        rays: &mut u64,
    ) -> [Parts; 2] {
        scratch.incident.clear();
        if !s.bsdf.has_smooth() {
            return [Parts::default(); 2];
        }
        let segments_left = self.params.max_segments() - walk.depth;
        let (mut caustic, mut indirect) = (Levels::default(), Levels::default());
        let mut direct = Rgb::ZERO;
        if walk.gathering && self.traces {
            let light = self.traced(walk, s, wo, directions, segments_left, sampler, scratch, rays);
            let mut here = Parts::default();
            *walk.indirect_part()(&mut here) = walk.beta * light;
            return [here; 2];
        }
        if walk.gathering {
            let distance = (s.p - walk.previous.p).length();
            indirect.fine = self.maps.gather(s, -walk.ray.d, distance, segments_left, scratch);
        } else {
            (caustic, indirect) = self.maps.seen(self.params, s, -walk.ray.d, segments_left, scratch);
            if walk.first {
                // The splats show it.
                caustic.fine = Rgb::ZERO;
            }
            if self.params.final_gather {
                // The gather ray finds it.
                indirect.fine = Rgb::ZERO;
            }
            // The map shows by broad lobes what it shows; sharp ones are too narrow for it.
            let sharp_only = self.params.direct == DirectLight::Map;
            if self.params.direct == DirectLight::Sample || (sharp_only && s.bsdf.has_rough()) {
                let other_pdf_w = |wi| density(s, wo, wi, &scratch.incident, directions);
                let lit = direct::sample_light(self.scene, s, wo, segments_left, sampler, rays, other_pdf_w);
                if let Some(lit) = lit {
                    let shown = match sharp_only {
                        true => s.bsdf.eval(wo, lit.wi, Mode::Radiance, Share::BroadEye),
                        false => Rgb::ZERO,
                    };
                    direct = (lit.f - shown).max(Rgb::ZERO) * lit.light;
                }
            }
            for _ in 1..directions {
                direct += self.look_for_light(
                    s,
                    wo,
                    Share::All,
                    &scratch.incident,
                    directions,
                    segments_left,
                    sampler,
                    rays,
                );
            }
        }
        [(caustic.wide, indirect.wide), (caustic.fine, indirect.fine)].map(|(caustic, indirect)| {
            let mut here = Parts { direct, caustic, indirect, ..Parts::default() };
            if walk.through_sharp {
                here = Parts { specular: here.sum(), ..Parts::default() };
            }
            here * walk.beta
        })
    }

    /// What broad lobes send along a gather ray that goes on as a path, but for the light that it finds there.
    #[allow(clippy::too_many_arguments)]
    fn traced(
        &self,
        walk: &Walk,
        s: &Surface,
        wo: Vec3,
        directions: u32,
        segments_left: u32,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        rays: &mut u64,
    ) -> Rgb {
        let mut sum = self.maps.caustics(s, -walk.ray.d, segments_left, scratch);
        // What sharp lobes send is a caustic where it lands.
        let lobes = Share::BroadLight;
        let other_pdf_w = |wi| density(s, wo, wi, &scratch.incident, directions);
        let lit = direct::sample_light(self.scene, s, wo, segments_left, sampler, rays, other_pdf_w);
        if let Some(lit) = lit {
            let broad = match s.bsdf.has_rough() {
                true => s.bsdf.eval(wo, lit.wi, Mode::Radiance, lobes),
                false => lit.f,
            };
            sum += broad * lit.light;
        }
        for _ in 1..directions {
            sum += self.look_for_light(
                s,
                wo,
                lobes,
                &scratch.incident,
                directions,
                segments_left,
                sampler,
                rays,
            );
        }
        sum
    }

    /// What `lobes` send of the lights that one of so many `directions`, taken by the BSDF, finds.
    #[allow(clippy::too_many_arguments)]
    fn look_for_light(
        &self,
        s: &Surface,
        wo: Vec3,
        lobes: Share,
        incident: &Incident,
        directions: u32,
        segments_left: u32,
        sampler: &mut Sampler,
        rays: &mut u64,
    ) -> Rgb {
        let sample = s.bsdf.sample(wo, sampler.next_1d(), sampler.next_2d(), Mode::Radiance);
        let Some(sample) = sample.filter(|sample| !sample.delta) else { return Rgb::ZERO };
        let density = density(s, wo, sample.wi, incident, directions);
        let previous = Previous { p: s.p, pdf_w: Some(density) };
        let ray = s.spawn(s.frame.to_world(sample.wi));
        let light = direct::along(self.scene, ray, &previous, segments_left, sampler, rays);
        if light == Rgb::ZERO {
            return light;
        }
        let f = match lobes == Share::All || !s.bsdf.has_rough() {
            true => sample.weight * sample.pdf_w,
            false => s.bsdf.eval(wo, sample.wi, Mode::Radiance, lobes),
        };
        f * light / density
    }

    /// The path after scattering by `sample`, which is to show the part `share` of the lights that are found
    /// in its direction; `None` where it ends.
    fn scatter(
        &self,
        walk: &Walk,
        s: &Surface,
        wo: Vec3,
        sample: &BsdfSample,
        share: f32,
        sampler: &mut Sampler,
    ) -> Option<Walk> {
        let mut next = Walk {
            ray: s.spawn(s.frame.to_world(sample.wi)),
            depth: walk.depth + 1,
            first: false,
            delta: walk.delta && sample.delta,
            straight: walk.straight && direct::goes_straight(sample, wo),
            eta: walk.eta * sample.eta,
            previous: Previous { p: s.p, pdf_w: (!sample.delta).then_some(sample.pdf_w / share) },
            ..*walk
        };
        if sample.delta {
            next.beta *= sample.weight;
            next.beta_emitted = if walk.gathering { Rgb::ZERO } else { next.beta };
            next.emitted_part = |parts| &mut parts.specular;
            next.through_sharp |= !walk.gathering;
        } else {
            let lobes = if walk.gathering { Share::BroadLight } else { Share::BroadEye };
            let broad = match s.bsdf.has_rough() {
                true => s.bsdf.eval(wo, sample.wi, Mode::Radiance, lobes) / sample.pdf_w,
                false => sample.weight,
            };
            let sharp = (sample.weight - broad).max(Rgb::ZERO);
            if walk.gathering && self.traces {
                next.beta *= sample.weight;
                next.beta_emitted = walk.beta * broad * share;
                next.emitted_part = walk.indirect_part();
            } else if walk.gathering {
                next.beta *= sharp;
                next.beta_emitted = Rgb::ZERO;
            } else {
                next.beta_emitted = match self.params.direct {
                    DirectLight::Sample => walk.beta * sample.weight * share,
                    DirectLight::Map => walk.beta * sharp,
                    DirectLight::Off => Rgb::ZERO,
                };
                next.emitted_part = match walk.through_sharp {
                    true => |parts| &mut parts.specular,
                    false => |parts| &mut parts.direct,
                };
                // One ray serves both shares; which one it goes on for is decided by their proportion.
                let prob = if sharp == Rgb::ZERO { 1.0 } else { luminance(broad) / luminance(sample.weight) };
                if sampler.next_1d() < prob {
                    next.gathering = true;
                    next.beta *= if self.gathers() { broad / prob } else { Rgb::ZERO };
                } else {
                    next.through_sharp = true;
                    next.beta *= sharp / (1.0 - prob);
                }
            }
        }

        let shown = next.shown(next.beta.max(next.beta_emitted));
        let mut survives = shown > 0.0; // false for NaN
        if survives && walk.depth >= self.params.rr_depth {
            // A branch that was followed for certain stays as dim as it is.
            let prob = if next.delta && shown >= DIMMEST { 0.95 } else { shown.min(0.95) };
            survives = sampler.next_1d() < prob;
            next.beta /= prob;
            next.beta_emitted /= prob;
        }
        survives.then_some(next)
    }
}

/// Density of the direction `wi` (local) of [`sample`], and of as many more as make so many `directions`, which
/// are sampled by the BSDF alone.
fn density(s: &Surface, wo: Vec3, wi: Vec3, incident: &Incident, directions: u32) -> f32 {
    let by_bsdf = s.bsdf.pdf_w(wo, wi, Mode::Radiance);
    let one = match incident.share() {
        0.0 => by_bsdf,
        share => (1.0 - share) * by_bsdf + share * incident.pdf_w(s.frame.to_world(wi)),
    };
    one + (directions - 1) as f32 * by_bsdf
}

/// The geometric normal on the side of `wo` (local), if `s` scatters broadly and to that side alone.
pub(super) fn broad_side(s: &Surface, wo: Vec3) -> Option<Vec3> {
    let is_broad = s.bsdf.has_smooth() && !s.bsdf.transmits() && !s.bsdf.is_narrow();
    (is_broad && s.bsdf.scatters_on(wo)).then(|| s.n_g * 1f32.copysign(wo.z))
}

/// Where a camera path through a random pixel first meets what scatters broadly, and to its own side alone.
pub(super) struct Broad<'a> {
    pub(super) s: Surface<'a>,
    /// The geometric normal on that side.
    pub(super) n: Vec3,
    /// Where the path has come from, world.
    pub(super) wo: Vec3,
    /// Segments that may follow, at least one.
    pub(super) segments_left: u32,
    /// Segments of the path.
    pub(super) depth: u32,
}

impl<'a> Broad<'a> {
    /// What is behind more mirrors than that is not worth looking for.
    const LONGEST: u32 = 12;

    /// `None` if the path meets nothing of the kind.
    pub(super) fn find(scene: &'a Scene, params: &Params, sampler: &mut Sampler) -> Option<Broad<'a>> {
        let mut ray = scene.random_camera_ray(sampler);
        for depth in 1..=params.max_segments().min(Self::LONGEST) {
            let s = scene.hit(&ray)?;
            let wo = s.frame.to_local(-ray.d);
            if s.is_crossed(sampler) {
                ray = s.spawn(ray.d);
                continue;
            }
            if let Some(n) = broad_side(&s, wo) {
                let segments_left = params.max_segments() - depth;
                return (segments_left > 0).then_some(Broad { s, n, wo: -ray.d, segments_left, depth });
            }
            let u = (sampler.next_1d(), sampler.next_2d());
            let sample = s.bsdf.sample(wo, u.0, u.1, Mode::Radiance)?;
            ray = s.spawn(s.frame.to_world(sample.wi));
        }
        None
    }
}

/// Samples where a path goes from `s`: by the BSDF, or to where light comes from as far as that is known.
fn sample(s: &Surface, wo: Vec3, incident: &Incident, sampler: &mut Sampler) -> Option<BsdfSample> {
    let (u, u_dir) = (sampler.next_1d(), sampler.next_2d());
    let share = incident.share();
    if u < share {
        let wi = s.frame.to_local(incident.sample(u / share, u_dir));
        let f = s.bsdf.eval(wo, wi, Mode::Radiance, Share::All);
        let pdf_w = density(s, wo, wi, incident, 1);
        let sample = BsdfSample { wi, weight: f / pdf_w, pdf_w, delta: false, eta: 1.0 };
        return (f.max_element() > 0.0 && pdf_w > 0.0).then_some(sample);
    }
    let mut sample = s.bsdf.sample(wo, (u - share) / (1.0 - share), u_dir, Mode::Radiance)?;
    // Only diffuse surfaces know of any, so there is no delta lobe to weight.
    if share > 0.0 {
        let pdf_w = density(s, wo, sample.wi, incident, 1);
        sample.weight *= sample.pdf_w / pdf_w;
        sample.pdf_w = pdf_w;
    }
    Some(sample)
}
