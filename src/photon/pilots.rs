//! A few photons sent ahead, which find out what photons are worth: a [`Guide`] for those to come, and of
//! every light and everything sharp, whether it takes part in the picture at all.

use super::guide::{Guide, Norm, Pilot};
use super::importance::Importance;
use super::kdtree::KnnHeap;
use super::map::Packed;
use super::trace::{Emission, Start, Store, Traced, fly};
use crate::math::{Sampler, Stream, luminance};
use crate::scene::Scene;
use rayon::prelude::*;

/// How many photons are sent ahead for one map: in rounds, each of which draws by what the one before has
/// learnt, and sends twice as many.
struct Rounds {
    most: u64,
    /// The first one's: one of so many of a pass.
    first: u64,
    /// But no fewer nor more than that.
    range: [u64; 2],
    /// The share of photons that is seen with which there is not enough left to learn.
    enough: f64,
}

/// Fewer than a pass emits. Where most photons show anyway, there is nothing to learn.
const ALL: Rounds = Rounds { most: 4, first: 16, range: [1 << 10, 1 << 13], enough: 0.5 };
/// Caustics want to be known precisely.
const CAUSTICS: Rounds = Rounds { most: 3, first: 4, range: [1 << 12, 1 << 13], enough: 1.0 };
/// The share of photons that are emitted as if nothing had been learnt, for the caustic map and for all
/// light.
const UNIFORM: [f32; 2] = [0.05, 0.2];
/// How much of what a caustic photon is worth the camera decides; the rest is for what it may have
/// overlooked.
const SEEN: f32 = 0.75;

/// What became of the photons that a light has sent ahead, or that have met something sharp.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Photons that were to leave the light, or have met the shape.
    pub sent: u64,
    /// Those of them that have met anything, or have made a caustic.
    pub landed: u64,
    /// Those that have met the light's own shape first.
    pub inside: u64,
    /// Those that show in the picture.
    pub seen: u64,
    /// Those that would show if paths were as long as they liked, where that was tried.
    pub deeper: u64,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, o: Tally) {
        self.sent += o.sent;
        self.landed += o.landed;
        self.inside += o.inside;
        self.seen += o.seen;
        self.deeper += o.deeper;
    }
}

/// What photons sent ahead have found out.
#[derive(Clone, Debug)]
pub struct Learnt {
    /// What to start from; `None` if no photon was worth anything.
    pub guide: Option<Guide>,
    /// Of each light.
    pub lights: Vec<Tally>,
    /// Of each shape, as far as it is sharp and caustics were looked for.
    pub casters: Vec<Tally>,
}

/// What a photon sent ahead has found. All amounts are times 1 / density.
struct Sent {
    at: Start,
    weight: f32,
    light: Option<u32>,
    /// Its flux if it has met something sharp.
    aimed: f32,
    /// What of it shows.
    shown: f32,
    seen: bool,
    /// What it has met.
    met: Vec<u32>,
    photons: Vec<Packed>,
}

impl Sent {
    fn new(
        scene: &Scene,
        sampler: &mut Sampler,
        emission: &Emission,
        importance: &Importance,
        heap: &mut KnnHeap,
    ) -> Sent {
        let (at, weight) = Start::draw(sampler, emission.guide);
        let Start([u_light, ..]) = at;
        let light = scene.lights.emitter(u_light).map(|(light, _)| light);
        let mut sent =
            Sent { at, weight, light, aimed: 0.0, shown: 0.0, seen: false, met: vec![], photons: vec![] };
        let Some(start) = at.emit(scene, emission.targets(scene)) else { return sent };
        let mut traced = Traced::default();
        fly(scene, &start, weight, sampler, emission, &mut traced);
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let first_is_sharp = |shape: &u32| scene.material(*shape).lobes().sharp;
        // What lands first from a beam is a caustic already.
        if traced.met.first().is_some_and(first_is_sharp) || scene.lights.is_beam(start.light) {
            sent.aimed = finite(weight * luminance(start.flux));
        }
        let show = |photon| importance.shown(scene, photon, emission.store, heap);
        sent.shown = finite(traced.photons.iter().map(show).sum());
        sent.seen = sent.shown > 0.0
            || traced.photons.iter().any(|photon| importance.sees_direct(scene, photon, heap));
        (sent.met, sent.photons) = (traced.met, traced.photons);
        sent
    }
}

impl Learnt {
    /// Learns for passes of `emission`, whose own guide does not matter, what is worth emitting. The same for
    /// any number of threads.
    ///
    /// Photons of all light also tell `importance` how bright the picture is.
    pub fn new(scene: &Scene, importance: &mut Importance, emission: &Emission) -> Learnt {
        let store = emission.store;
        let rounds = if store == Store::Caustic { CAUSTICS } else { ALL };
        let first = (emission.count / rounds.first).clamp(rounds.range[0], rounds.range[1]);
        let targets = match store {
            Store::Caustic => None,
            _ => scene.targets.learnt(&importance.positions(), scene.bounds),
        };
        // Where to aim is known before the first photon.
        let mut guide = targets.clone().map(|targets| Guide::even(Some(targets)));
        let mut learnt = Learnt {
            guide: guide.clone(),
            lights: vec![Tally::default(); scene.lights.lights().len()],
            casters: vec![Tally::default(); scene.geometry.shapes.len()],
        };
        // Caustics are aimed at: what misses everything sharp is lost (tests/aiming.rs).
        let norm = if store == Store::Caustic { Norm::Mean } else { Norm::RootMeanSquare };
        let uniform = UNIFORM[usize::from(store != Store::Caustic)];
        for round in 0..rounds.most {
            let emission = Emission {
                guide: guide.as_ref(),
                watched: true,
                ..Emission::new(store, first << round, emission.max_depth)
            };
            let mut sent = send(scene, importance, &emission, round);
            learnt.count(scene, store, &sent);
            let found = Guide::of(&mut pilots(&sent, store), uniform, norm, targets.clone());
            if store != Store::Caustic {
                let photons = sent.iter_mut().flat_map(|sent| std::mem::take(&mut sent.photons)).collect();
                importance.balance(scene, photons, emission.count);
            }
            let is_enough = sent.iter().filter(|s| s.seen).count() as f64 > rounds.enough * sent.len() as f64;
            if is_enough && round == 0 {
                break;
            }
            if found.is_some() || store == Store::Caustic {
                learnt.guide = found;
                guide = learnt.guide.clone();
            }
            if is_enough {
                break;
            }
        }
        let is_cut_short = |tally: &Tally| tally.landed > 0 && tally.seen == 0;
        if emission.max_depth < u32::from(u8::MAX) && learnt.lights.iter().any(is_cut_short) {
            let emission = Emission { watched: true, ..Emission::new(store, first, u32::MAX) };
            for sent in send(scene, importance, &emission, rounds.most) {
                if let Some(light) = sent.light {
                    learnt.lights[light as usize].deeper += u64::from(sent.seen);
                }
            }
        }
        learnt
    }

    /// Counts what lights and casters have to do with the picture.
    fn count(&mut self, scene: &Scene, store: Store, sent: &[Sent]) {
        for sent in sent {
            let Some(light) = sent.light else { continue };
            let own = scene.lights.shape(light);
            self.lights[light as usize] += Tally {
                sent: 1,
                landed: u64::from(!sent.met.is_empty()),
                inside: u64::from(own.is_some() && sent.met.first().copied() == own),
                seen: u64::from(sent.seen),
                deeper: 0,
            };
            if store != Store::Caustic {
                continue;
            }
            let mut sharp: Vec<u32> =
                sent.met.iter().copied().filter(|&shape| scene.material(shape).lobes().sharp).collect();
            sharp.sort_unstable();
            sharp.dedup();
            for shape in sharp {
                self.casters[shape as usize] += Tally {
                    sent: 1,
                    landed: u64::from(!sent.photons.is_empty()),
                    seen: u64::from(sent.seen),
                    ..Tally::default()
                };
            }
        }
    }
}

/// Sends a round of photons ahead, in the order of their emission.
fn send(scene: &Scene, importance: &Importance, emission: &Emission, round: u64) -> Vec<Sent> {
    // The two maps learn from photons of their own.
    let set = round + if emission.store == Store::Caustic { 0 } else { 1 << 32 };
    (0..emission.count as usize)
        .into_par_iter()
        .with_max_len(512)
        .map_init(
            || KnnHeap::new(Importance::K),
            |heap, index| {
                let mut sampler = Sampler::new(0, Stream::Pilots, set, index as u64);
                Sent::new(scene, &mut sampler, emission, importance, heap)
            },
        )
        .collect()
}

/// What each photon was worth: to show, and to have met something sharp if that is looked for.
fn pilots(sent: &[Sent], store: Store) -> Vec<Pilot> {
    let total = |of: fn(&Sent) -> f32| sent.iter().map(of).sum::<f32>();
    let (aimed, shown) = (total(|s| s.aimed), total(|s| s.shown));
    let relative = |x: f32, total: f32| if total > 0.0 { x / total } else { 0.0 };
    let seen = if store == Store::Caustic { SEEN } else { 1.0 };
    let worth = |s: &Sent| (1.0 - seen) * relative(s.aimed, aimed) + seen * relative(s.shown, shown);
    sent.iter().map(|s| Pilot { at: s.at.0, weight: s.weight, worth: worth(s) }).collect()
}
