//! Which lights and which sharp surfaces take part in the picture, as far as photons sent ahead can tell, and
//! why the others do not: what people ask who see no caustic.

use crate::photon::{Learnt, Tally};
use crate::scene::Scene;
use crate::{light::Lights, math::luminance};
use serde::{Deserialize, Serialize};

/// A light, as photons sent ahead have found it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSurvey {
    /// Its index and kind, and its shape if it is one.
    pub name: String,
    /// Photons sent ahead.
    pub sent: u64,
    /// Those that have met anything.
    pub landed: u64,
    /// Those that show in the picture.
    pub seen: u64,
    /// Why none does.
    pub why_none: Option<String>,
}

/// A shape with sharp lobes, likewise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CasterSurvey {
    /// Its index and kind.
    pub name: String,
    /// Photons sent ahead that have met it before anything that is not sharp.
    pub met: u64,
    /// Those whose caustics show in the picture.
    pub seen: u64,
    /// Why there is none.
    pub why_none: Option<String>,
}

/// What photons sent ahead tell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Survey {
    /// Lights: those of which most is seen, and the brightest ones of which nothing is.
    pub lights: Vec<LightSurvey>,
    /// How many others there are.
    pub lights_left_out: usize,
    /// What may cast caustics, likewise, if anything was sent after them.
    pub casters: Vec<CasterSurvey>,
    /// How many others there are.
    pub casters_left_out: usize,
}

/// Of each list, so many that show and so many that do not.
const LISTED: usize = 16;

impl Survey {
    pub(super) fn new(scene: &Scene, global: Option<&Learnt>, caustics: Option<&Learnt>) -> Survey {
        let both = || global.into_iter().chain(caustics);
        if both().next().is_none() {
            return Survey::default();
        }
        let lights = &scene.lights;
        let mut tallies = vec![Tally::default(); lights.lights().len()];
        for learnt in both() {
            tallies.iter_mut().zip(&learnt.lights).for_each(|(sum, tally)| *sum += *tally);
        }
        let power = |i: u32| luminance(lights.power(i));
        let (listed, lights_left_out) = most_important(&tallies, power);
        let casters = caustics.map_or(vec![], |learnt| learnt.casters.clone());
        let sharp = |i: u32| scene.material(i).lobes().sharp;
        let indices: Vec<u32> = (0..casters.len() as u32).filter(|&i| sharp(i)).collect();
        let sharp: Vec<Tally> = indices.iter().map(|&i| casters[i as usize]).collect();
        let (listed_casters, casters_left_out) = most_important(&sharp, |i| sharp[i as usize].sent as f32);
        Survey {
            lights: listed
                .into_iter()
                .map(|i| {
                    let tally = tallies[i as usize];
                    LightSurvey {
                        name: light_name(scene, i),
                        sent: tally.sent,
                        landed: tally.landed,
                        seen: tally.seen,
                        why_none: why_no_light(scene, i, tally).map(Into::into),
                    }
                })
                .collect(),
            lights_left_out,
            casters: listed_casters
                .into_iter()
                .map(|i| {
                    let (tally, shape) = (sharp[i as usize], indices[i as usize]);
                    CasterSurvey {
                        name: shape_name(scene, shape),
                        met: tally.sent,
                        seen: tally.seen,
                        why_none: why_no_caustic(tally).map(Into::into),
                    }
                })
                .collect(),
            casters_left_out,
        }
    }

    /// The same in words, line by line.
    pub fn lines(&self) -> Vec<String> {
        let why = |reason: &Option<String>| reason.as_ref().map_or(String::new(), |why| format!(": {why}"));
        let mut lines: Vec<String> = self
            .lights
            .iter()
            .map(|l| {
                let (sent, landed, seen) = (l.sent, l.landed, l.seen);
                format!(
                    "  {}: {sent} photons sent ahead, {landed} landed, {seen} seen{}",
                    l.name,
                    why(&l.why_none)
                )
            })
            .collect();
        let others = |n: usize, what: &str| (n > 0).then(|| format!("  and {n} more {what}"));
        lines.extend(others(self.lights_left_out, "lights"));
        lines.extend(self.casters.iter().map(|c| {
            format!("  {}: {} photons met it, caustics of {} seen{}", c.name, c.met, c.seen, why(&c.why_none))
        }));
        lines.extend(others(self.casters_left_out, "shapes that may cast caustics"));
        lines
    }
}

/// The indices of those of which most is seen, and of those with the greatest `weight` of which nothing is;
/// and how many are left.
fn most_important(tallies: &[Tally], weight: impl Fn(u32) -> f32) -> (Vec<u32>, usize) {
    let (mut seen, mut unseen): (Vec<u32>, Vec<u32>) =
        (0..tallies.len() as u32).partition(|&i| tallies[i as usize].seen > 0);
    seen.sort_by_key(|&i| std::cmp::Reverse(tallies[i as usize].seen));
    unseen.sort_by(|&a, &b| weight(b).total_cmp(&weight(a)));
    seen.truncate(LISTED);
    unseen.truncate(LISTED);
    seen.append(&mut unseen);
    let left = tallies.len() - seen.len();
    (seen, left)
}

fn light_name(scene: &Scene, i: u32) -> String {
    let kind = scene.lights.lights()[i as usize].kind();
    match scene.lights.shape(i) {
        Some(shape) => format!("light {i} ({kind}, {})", shape_name(scene, shape)),
        None => format!("light {i} ({kind})"),
    }
}

fn shape_name(scene: &Scene, shape: u32) -> String {
    format!("shape {shape}, {}", scene.geometry.shapes[shape as usize].kind())
}

fn why_no_light(scene: &Scene, i: u32, tally: Tally) -> Option<&'static str> {
    let lights: &Lights = &scene.lights;
    if tally.seen > 0 {
        None
    } else if luminance(lights.power(i)) <= 0.0 {
        Some("it is black, or there is nothing that it could shine on")
    } else if !lights.reaches(i, &scene.geometry, &scene.targets) {
        Some("it faces away from everything")
    } else if tally.sent == 0 {
        Some(
            "there are so many lights that none was sent; its share of the photons is the least that all have",
        )
    } else if tally.landed == 0 {
        Some("no photon landed on anything")
    } else if tally.inside == tally.landed {
        Some("it lights the inside of its own shape only: its normals point inward")
    } else if tally.deeper > 0 {
        Some("max_depth ends the paths of its light before they are seen")
    } else {
        Some("it is hidden: its photons land only where nothing is seen")
    }
}

fn why_no_caustic(tally: Tally) -> Option<&'static str> {
    if tally.seen > 0 {
        None
    } else if tally.sent == 0 {
        Some("no light reaches it directly or by way of other sharp surfaces")
    } else if tally.landed == 0 {
        Some("what leaves it falls on nothing but sharp surfaces, or max_depth ends it before")
    } else {
        Some("its caustics fall only where nothing is seen")
    }
}
