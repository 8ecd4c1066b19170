//! Where indirect light comes from: the global map shows it and tells gather rays what they find, or gather rays go
//! on as paths that sample lights. The map is what all pixels around share: where photons are dense it leaves next
//! to no noise, and where they are sparse or of uneven flux (a room that the sky lights through a window), what is
//! wrong is wrong all around. The noise of paths is each pixel's own, and averages out among neighbours. A few
//! rays sent before the first pass tell which of both leaves less.

use super::eye::{Broad, Eye, Walk};
use super::maps::{Maps, Scratch};
use super::{Params, Seen, plan};
use crate::math::{Frame, Rgb, Sampler, Stream, luminance, warp};
use crate::scene::Scene;
use crate::shape::Bounds;
use glam::Vec3;
use rayon::prelude::*;

/// Camera paths that find out.
const PATHS: usize = 4096;
/// Ends of paths that lie next to each other, whose mean says how bright it is there.
const GROUP: usize = 64;
/// Where it is darker than this share of the mean, noise is held against as much.
const DARK: f64 = 0.1;
/// Squares of deviations count as no more than this, in squares of the brightness: they say that the variance is
/// great, not how great.
const MOST: f64 = 256.0;
/// Passes over which what the map lacks is held against noise. It lacks light where that comes by few strong photons.
/// (The reverse tells nothing: paths that miss most of the light have not shown their variance.)
const PASSES: f64 = 16.0;
/// By how much more time and the denoiser lower the variance of paths than that of such a map; and the variance that
/// all else leaves in either case. (measured: the six scenes of shared/reference and eight published ones, error of
/// either way in equal time)
const LENT: f64 = 12.0;
const REST: [f64; 2] = [0.3, 0.03];

/// What indirect light looks like from where one camera path ends: twice from the map, twice by a path.
#[derive(Clone, Copy, Debug)]
struct Trial {
    p: Vec3,
    n: Vec3,
    direct: f64,
    mapped: [f64; 2],
    traced: [f64; 2],
}

/// Whether tracing paths leaves less than the global map, of which `maps` are two with half the photons of a pass
/// each. The same for any number of threads.
pub(super) fn is_better_traced(scene: &Scene, params: &Params, maps: &[Maps; 2]) -> bool {
    let trials: Vec<Option<Trial>> = (0..PATHS)
        .into_par_iter()
        .with_min_len(32)
        .map_init(
            || Scratch::new(Some(&maps[0])),
            |scratch, index| {
                let mut sampler = Sampler::new(plan::SEED, Stream::Pilots, 1, index as u64);
                trial(scene, params, maps, &mut sampler, scratch)
            },
        )
        .collect();
    is_less(trials.into_iter().flatten().collect(), scene.bounds)
}

fn is_less(mut trials: Vec<Trial>, bounds: Bounds) -> bool {
    trials.sort_by_key(|trial| place(trial, bounds));
    let mean = |trials: &[Trial], of: &dyn Fn(&Trial) -> f64| {
        trials.iter().map(of).sum::<f64>() / trials.len().max(1) as f64
    };
    let level = |trial: &Trial| trial.direct + trial.mapped.iter().chain(&trial.traced).sum::<f64>() / 4.0;
    let dark = DARK * mean(&trials, &level);
    // Variances, and what of the light the map lacks, with the square of its standard error.
    let [mut mapped, mut traced, mut lack, mut doubt] = [0.0; 4];
    for group in trials.chunks(GROUP) {
        let around = (mean(group, &level).powi(2) + dark * dark).sqrt().max(f64::MIN_POSITIVE);
        let half_square = |[a, b]: [f64; 2]| 0.5 * ((a - b) / around).powi(2).min(MOST);
        let lacks = |t: &Trial| (t.traced[0] + t.traced[1] - t.mapped[0] - t.mapped[1]) / (2.0 * around);
        let (n, share) = (group.len() as f64, group.len() as f64 / trials.len() as f64);
        mapped += share * mean(group, &|trial| half_square(trial.mapped));
        traced += share * mean(group, &|trial| half_square(trial.traced));
        let missing = mean(group, &lacks);
        lack += share * missing;
        doubt += share * share * mean(group, &|trial| (lacks(trial) - missing).powi(2)) / n;
    }
    let bias = (lack - doubt.sqrt()).max(0.0);
    traced + REST[0] < LENT * (mapped + PASSES * bias * bias + REST[1])
}

/// Orders places so that those next to each other lie near each other and face the same way: octant of the normal,
/// then Morton code of the position.
fn place(trial: &Trial, bounds: Bounds) -> u64 {
    let size = (bounds.max - bounds.min).max(Vec3::splat(f32::MIN_POSITIVE));
    let cell = ((trial.p - bounds.min) / size * 1023.0).clamp(Vec3::ZERO, Vec3::splat(1023.0)).as_uvec3();
    let octant = u64::from(trial.n.cmpge(Vec3::ZERO).bitmask());
    let bits = (0..10).rev().flat_map(|bit| cell.to_array().map(|c| u64::from(c >> bit & 1)));
    bits.fold(octant, |code, bit| code << 1 | bit)
}

fn trial(
    scene: &Scene,
    params: &Params,
    maps: &[Maps; 2],
    sampler: &mut Sampler,
    scratch: &mut Scratch,
) -> Option<Trial> {
    let Broad { s, n, wo, segments_left, depth } = Broad::find(scene, params, sampler)?;
    let albedo = s.bsdf.albedo();
    let finite = |light: Rgb| Some(f64::from(luminance(light))).filter(|x| x.is_finite()).unwrap_or(0.0);
    let u = (sampler.next_1d(), sampler.next_2d());
    let light = scene.lights.sample_direct(&scene.geometry, &scene.textures, s.p, u.0, u.1);
    let direct = light.map_or(0.0, |light| {
        let through = scene.transmittance(&s, light.wi, light.target, false, &mut 0).color;
        finite(albedo * light.weight * through * light.wi.dot(n).max(0.0)) / std::f64::consts::PI
    });
    let mapped = [0, 1].map(|i: usize| {
        let (_, indirect) = maps[i].seen(params, &s, wo, segments_left, scratch);
        finite(indirect.wide)
    });
    let frame = Frame::from_normal(n);
    let traced = [0, 1].map(|i: usize| {
        let eye = Eye { scene, params, maps: &maps[i], traces: true, effort: None, aovs: false };
        let wi = frame.to_world(warp::cosine_hemisphere(sampler.next_2d()));
        let walk = Walk::gather(s.spawn(wi), depth + 1);
        let [found, _] = eye.follow(walk, sampler, scratch, &mut Seen::default(), &mut 0);
        finite(albedo * found.indirect)
    });
    Some(Trial { p: s.p, n, direct, mapped, traced })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trials(noise: impl Fn(usize) -> [f64; 2]) -> Vec<Trial> {
        let trial = |i| {
            let [mapped, traced] = noise(i).map(|noise| [1.0 - noise, 1.0 + noise]);
            Trial { p: Vec3::splat(i as f32 / 4096.0), n: Vec3::Z, direct: 0.0, mapped, traced }
        };
        (0..4096).map(trial).collect()
    }

    const CUBE: Bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };

    #[test]
    fn paths_are_for_maps_that_are_noisy() {
        assert!(!is_less(trials(|_| [0.1, 0.8]), CUBE));
        assert!(is_less(trials(|_| [0.7, 0.8]), CUBE));
        // A few photons of great flux.
        assert!(is_less(trials(|i| [if i % 100 == 0 { 10.0 } else { 0.1 }, 0.8]), CUBE));
    }

    #[test]
    fn nothing_is_no_reason_for_photons() {
        assert!(is_less(Vec::new(), CUBE) && is_less(trials(|_| [0.0; 2]), Bounds::EMPTY));
    }

    #[test]
    fn places_are_sorted_by_where_they_are_and_face() {
        let at = |p, n| place(&Trial { p, n, direct: 0.0, mapped: [0.0; 2], traced: [0.0; 2] }, CUBE);
        let (corner, near, far) = (Vec3::splat(0.1), Vec3::splat(0.11), Vec3::splat(0.9));
        let apart = |a: u64, b| a.abs_diff(b);
        assert!(apart(at(corner, Vec3::Z), at(near, Vec3::Z)) < apart(at(corner, Vec3::Z), at(far, Vec3::Z)));
        assert!(
            apart(at(corner, Vec3::Z), at(far, Vec3::Z)) < apart(at(corner, Vec3::Z), at(near, -Vec3::Z))
        );
    }
}
