//! What a scene needs, derived before the first pass: stages that cannot contribute are skipped, with the
//! reason.

use super::effort::Effort;
use super::indirect;
use super::maps::Maps;
use super::{DirectLight, IndirectLight, Kind, Options, Params, Skipped, Survey};
use crate::photon::{Emission, Guide, Importance, Learnt, Store, Uses};
use crate::scene::Scene;

/// The seed of what is tried before the first pass: a render learns the same whatever its own.
pub(super) const SEED: u64 = u64::MAX;

/// The work of each pass.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// Photon paths for the global map; 0 if it is skipped.
    pub(super) global_photons: u64,
    /// Photon paths for the caustic map; 0 if it is skipped.
    pub(super) caustic_photons: u64,
    /// What is worth emitting for the global map; not before [`Plan::learn`].
    pub(super) global_guide: Option<Guide>,
    /// The same for the caustic map.
    pub(super) caustic_guide: Option<Guide>,
    /// In how many directions lights are looked for, if that is more than one anywhere; not before [`Plan::learn`].
    pub(super) effort: Option<Effort>,
    /// Whether gather rays go on as paths in place of looking at the global map; not before [`Plan::learn`].
    pub(super) traces_indirect: bool,
    /// Pixels of the film.
    pub(super) pixels: u64,
    /// Radius of the scene, which relative lookup radii refer to.
    pub(super) radius: f32,
    /// What is skipped.
    pub(super) skipped: Vec<Skipped>,
    /// What lights and casters have to do with the picture; not before [`Plan::learn`].
    pub(super) survey: Survey,
}

impl Plan {
    pub(super) fn new(scene: &Scene, options: &Options) -> Plan {
        let params = &options.params;
        let pixels = scene.film.crop.2 as u64 * scene.film.crop.3 as u64;
        // In proportion to the camera's work, which is about as long per pixel as a photon path or two.
        let auto = |n: u64, per_pixel: u64| match n {
            0 => (per_pixel * pixels).clamp(per_pixel * 16_384, 2_000_000),
            n => n,
        };
        let mut plan = Plan {
            global_photons: auto(params.global_photons, 1),
            caustic_photons: auto(params.caustic_photons, 1),
            global_guide: None,
            caustic_guide: None,
            effort: None,
            traces_indirect: false,
            pixels,
            radius: scene.bounds.radius(),
            skipped: Vec::new(),
            survey: Survey::default(),
        };
        if params.skip {
            plan.skip_texture_coordinates(scene);
        }
        if options.integrator == Kind::Path {
            plan.skip_both(match scene.lights.have_beams() {
                true => "the path tracer uses no photons, so it sees nothing of collimated light",
                false => "the path tracer uses no photons",
            });
            return plan;
        }
        if !params.skip {
            return plan;
        }
        let lobes = scene.lobes();
        if scene.lights.lights().is_empty() {
            plan.skip_both("there are no lights");
        } else if !lobes.smooth {
            plan.skip_both("no surface scatters by anything but delta lobes, so no photon could be stored");
        } else if scene.lights.have_beams() {
            // They show where they land, on whatever surface.
        } else if params.max_segments() <= 2 && params.direct == DirectLight::Sample {
            plan.skip_both("max_depth leaves nothing but direct light");
        } else if !lobes.sharp {
            plan.skip_caustic("no surface has a sharp lobe that could focus light");
        } else if !scene.lights.reach(&scene.geometry, &scene.casters) {
            plan.skip_caustic("all lights face away from the surfaces with sharp lobes");
        }
        plan
    }

    /// Sends a few photons ahead. What they find depends on the scene alone, so all passes go by the same.
    pub(super) fn learn(&mut self, scene: &Scene, params: &Params) {
        if !self.has_photons() {
            return;
        }
        let uses = Uses { direct: params.direct == DirectLight::Map, gathers: params.final_gather };
        let mut importance = Importance::new(scene, uses);
        let mut learn = |store, count| {
            (count > 0).then(|| {
                let emission = Emission::new(store, count, params.longest_flight());
                Learnt::new(scene, &mut importance, &emission)
            })
        };
        // The first tells how bright the picture is.
        let global = learn(Store::All, self.global_photons);
        let caustics = learn(Store::Caustic, self.caustic_photons);
        self.survey = Survey::new(scene, global.as_ref(), caustics.as_ref());
        if caustics.as_ref().is_some_and(|learnt| learnt.guide.is_none())
            && params.skip
            && params.caustic_photons == 0
        {
            // None found a caster, so few are worth sending after them. Not none: that would prove nothing.
            self.caustic_photons = self.caustic_photons.div_ceil(16);
        }
        self.global_guide = global.and_then(|learnt| learnt.guide);
        self.caustic_guide = caustics.and_then(|learnt| learnt.guide);
        let [global, caustic] = [self.global_photons, self.caustic_photons].map(|count| count.div_ceil(2));
        let few = Plan { global_photons: global, caustic_photons: caustic, ..self.clone() };
        let maps = |pass| Maps::new(scene, params, &few, SEED, pass).0;
        let first = maps(0);
        self.effort = Effort::new(scene, params, self.pixels, &first);
        // Without final gathering, the map is to be shown.
        self.traces_indirect = params.final_gather
            && params.direct != DirectLight::Map
            && match params.indirect {
                IndirectLight::Auto => indirect::is_better_traced(scene, params, &[first, maps(1)]),
                IndirectLight::Map => false,
                IndirectLight::Path => true,
            };
        if self.traces_indirect && params.skip {
            self.global_photons = 0;
            let reason = "gather rays that go on as paths leave less noise than photons do";
            self.skipped.push(Skipped { stage: "global map".into(), reason: reason.into() });
        }
    }

    /// Whether any photons are shot.
    pub(super) fn has_photons(&self) -> bool {
        self.global_photons > 0 || self.caustic_photons > 0
    }

    fn skip_texture_coordinates(&mut self, scene: &Scene) {
        let (textured, all) = (scene.textured_shapes(), scene.geometry.shapes.len());
        let reason = match all - textured {
            0 => return,
            n if n == all => "no material or lamp is textured, none has grain or bumps".into(),
            n => format!("on {n} of {all} shapes nothing is textured, and nothing has grain or bumps"),
        };
        self.skipped.push(Skipped { stage: "texture coordinates".into(), reason });
    }

    fn skip_both(&mut self, reason: &str) {
        self.global_photons = 0;
        self.skipped.push(Skipped { stage: "global map".into(), reason: reason.into() });
        self.skip_caustic(reason);
    }

    fn skip_caustic(&mut self, reason: &str) {
        self.caustic_photons = 0;
        self.skipped.push(Skipped { stage: "caustic map".into(), reason: reason.into() });
    }
}
