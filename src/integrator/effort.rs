//! In how many directions a vertex looks for lights, region by region: as many as pay, which rays sent before
//! the first pass find out. Through a window, one light sample in a hundred sees the sky, and one direction
//! of a diffuse surface in ten does; the second is cheap once the vertex is there.

use super::eye::{Broad, broad_side};
use super::maps::{Maps, Scratch};
use super::plan;
use super::{DirectLight, Params};
use crate::math::{Frame, Rgb, Sampler, Stream, luminance, power_heuristic, warp};
use crate::scene::{Scene, Surface};
use crate::shape::Bounds;
use glam::Vec3;
use rayon::prelude::*;

/// Camera paths, per pixel, and at least.
const PER_PIXEL: f32 = 0.125;
const FEWEST_PATHS: f32 = 2048.0;
/// Directions in which each of them tries, where it ends.
const TRIES: usize = 8;
/// Regions with more of these ends are divided; fewer tell too little, and what is known of the region around
/// is used.
const MOST: usize = 128;
const FEWEST: usize = 32;
/// Halvings of space, at most.
const DEEPEST: u32 = 40;
/// Numbers of directions to choose from.
const CHOICES: [u32; 5] = [1, 2, 4, 8, 16];
/// What a vertex costs without them, in directions; and its other variance, in squares of the mean (both
/// measured: living-room, 256×144).
const COST: f64 = 40.0;
const VARIANCE: f64 = 0.5;

/// Numbers of directions, by place and by the octant of the normal.
#[derive(Clone, Debug)]
pub(super) struct Effort {
    /// A binary tree for each octant; its root is the node of that number.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Halved along an axis at a coordinate: the lower child, which the upper one follows.
    Split { axis: u8, at: f32, child: u32 },
    /// Directions.
    Leaf(u32),
}

/// What the directions that one camera path tries find.
#[derive(Clone, Copy, Debug, Default)]
struct Trial {
    p: Vec3,
    n: Vec3,
    /// Irradiance over π. In f64, for squares of radiance leave the range of f32.
    all: f64,
    /// For each of [`CHOICES`] what one direction and what one light sample adds to that of direct light:
    /// first and second moments.
    direct: [[Moments; 2]; CHOICES.len()],
}

/// Means of a random number and of its square.
#[derive(Clone, Copy, Debug, Default)]
struct Moments([f64; 2]);

impl Moments {
    fn add(&mut self, weight: f64, [first, second]: [f64; 2]) {
        self.0[0] += weight * first;
        self.0[1] += weight * second;
    }

    fn variance(self) -> f64 {
        let [first, second] = self.0;
        (second - first * first).max(0.0)
    }
}

impl Effort {
    /// `None` if one direction does everywhere. The same for any number of threads.
    pub(super) fn new(scene: &Scene, params: &Params, pixels: u64, maps: &Maps) -> Option<Effort> {
        if params.direct != DirectLight::Sample || !scene.lights.can_be_met() {
            return None;
        }
        let count = (PER_PIXEL * pixels as f32).max(FEWEST_PATHS) as usize;
        let trials: Vec<Option<Trial>> = (0..count)
            .into_par_iter()
            .with_min_len(64)
            .map_init(
                || Scratch::new(Some(maps)),
                |scratch, index| {
                    let mut sampler = Sampler::new(plan::SEED, Stream::Pilots, 0, index as u64);
                    trial(scene, params, maps, &mut sampler, scratch)
                },
            )
            .collect();
        let effort = Effort::of(trials.into_iter().flatten(), scene.bounds);
        effort.nodes.iter().any(|node| matches!(node, Node::Leaf(2..))).then_some(effort)
    }

    fn of(trials: impl Iterator<Item = Trial>, bounds: Bounds) -> Effort {
        let mut octants: [Vec<Trial>; 8] = Default::default();
        for trial in trials {
            octants[octant(trial.n)].push(trial);
        }
        let mut effort = Effort { nodes: vec![Node::Leaf(1); 8] };
        for (root, octant) in octants.iter_mut().enumerate() {
            effort.grow(root, octant, bounds, 1, DEEPEST);
        }
        effort
    }

    /// Divides `node`, the part `bounds` of space, where the `trials` are. Where they are too few, so many
    /// directions are taken as `around`.
    fn grow(&mut self, node: usize, trials: &mut [Trial], bounds: Bounds, around: u32, depth: u32) {
        let best = if trials.len() >= FEWEST { directions(trials) } else { around };
        let size = bounds.max - bounds.min;
        let is_wide = size.max_element() > 0.0; // false for NaN
        if trials.len() <= MOST || depth == 0 || !is_wide {
            self.nodes[node] = Node::Leaf(best);
            return;
        }
        let axis = size.max_position();
        let at = 0.5 * (bounds.min[axis] + bounds.max[axis]);
        // Stable, for the sake of equal sums whatever happens.
        trials.sort_by_key(|trial| trial.p[axis] >= at);
        let n = trials.partition_point(|trial| trial.p[axis] < at);
        let (lower, upper) = trials.split_at_mut(n);
        let child = self.nodes.len();
        self.nodes.extend([Node::Leaf(best); 2]);
        self.nodes[node] = Node::Split { axis: axis as u8, at, child: child as u32 };
        let (mut below, mut above) = (bounds, bounds);
        (below.max[axis], above.min[axis]) = (at, at);
        self.grow(child, lower, below, best, depth - 1);
        self.grow(child + 1, upper, above, best, depth - 1);
    }

    /// In how many directions to look for lights from `s`, beside a light sample, on the side of `wo`
    /// (local).
    pub(super) fn directions(&self, s: &Surface, wo: Vec3) -> u32 {
        broad_side(s, wo).map_or(1, |n| self.at(s.p, n))
    }

    /// The same at `p`, on the side of the normal `n`.
    fn at(&self, p: Vec3, n: Vec3) -> u32 {
        let mut node = self.nodes[octant(n)];
        while let Node::Split { axis, at, child } = node {
            node = self.nodes[child as usize + usize::from(p[axis as usize] >= at)];
        }
        if let Node::Leaf(directions) = node { directions } else { 1 }
    }
}

/// The octant of a normal, in coordinates that are turned against the axes: most walls stand along these, and
/// rounding must not put one wall in two octants.
fn octant(n: Vec3) -> usize {
    // Rows of a rotation by 0.7 about x, then 0.6 about y, then 0.5 about z.
    const TURN: [Vec3; 3] = [
        Vec3::new(0.724_300_14, -0.047_461_88, 0.687_849_3),
        Vec3::new(0.395_686_97, 0.845_604_5, -0.358_308_35),
        Vec3::new(-0.564_642_5, 0.531_695_8, 0.631_251_5),
    ];
    let above = TURN.map(|row| usize::from(row.dot(n) >= 0.0));
    above[0] | above[1] << 1 | above[2] << 2
}

/// The number that leaves the least product of time and variance.
fn directions(trials: &[Trial]) -> u32 {
    let weight = 1.0 / trials.len() as f64;
    let all = trials.iter().map(|trial| trial.all).sum::<f64>() * weight;
    let product = |i: usize| {
        let mut moments = [Moments::default(); 2];
        for trial in trials {
            moments.iter_mut().zip(trial.direct[i]).for_each(|(sum, m)| sum.add(weight, m.0));
        }
        let [by_direction, by_light] = moments.map(Moments::variance);
        let n = f64::from(CHOICES[i]);
        (VARIANCE + (by_direction / n + by_light) / (all * all)) * (COST + n)
    };
    (0..CHOICES.len()).min_by(|&a, &b| product(a).total_cmp(&product(b))).map_or(1, |i| CHOICES[i])
}

/// What a camera path through a random pixel finds where it ends.
fn trial(
    scene: &Scene,
    params: &Params,
    maps: &Maps,
    sampler: &mut Sampler,
    scratch: &mut Scratch,
) -> Option<Trial> {
    let Broad { s, n, segments_left, .. } = Broad::find(scene, params, sampler)?;
    let frame = Frame::from_normal(n);
    let mut trial = Trial { p: s.p, n, ..Trial::default() };
    for _ in 0..TRIES {
        let wi = warp::cosine_hemisphere(sampler.next_2d());
        let pdf_w = warp::cosine_hemisphere_pdf_w(wi);
        let found = look(scene, maps, &s, frame.to_world(wi), segments_left, scratch);
        // Over the cosine's density, which a constant remains of.
        let (all, direct) = (luminance(found.direct + found.indirect), f64::from(luminance(found.direct)));
        if !(all.is_finite() && pdf_w > 0.0) {
            continue;
        }
        trial.all += f64::from(all) / TRIES as f64;
        for (moments, n) in trial.direct.iter_mut().zip(CHOICES) {
            let (density, light_pdf_w) = (n as f32 * pdf_w, found.light_pdf_w.max(f32::MIN_POSITIVE));
            let by_direction = direct * f64::from(power_heuristic(density, found.light_pdf_w));
            let by_light = direct * f64::from(power_heuristic(found.light_pdf_w, density));
            let weight = 1.0 / TRIES as f64;
            moments[0].add(weight, [by_direction, by_direction * by_direction]);
            moments[1].add(weight, [by_light, by_light * by_light * f64::from(pdf_w / light_pdf_w)]);
        }
    }
    Some(trial)
}

/// What comes from one direction.
struct Found {
    direct: Rgb,
    indirect: Rgb,
    /// The density with which light sampling finds the direct light.
    light_pdf_w: f32,
}

/// What comes to `s` from `wi` straight from an emitter, and what the photons on the first surface there
/// tell.
fn look(
    scene: &Scene,
    maps: &Maps,
    s: &Surface,
    wi: Vec3,
    segments_left: u32,
    scratch: &mut Scratch,
) -> Found {
    let ray = s.spawn(wi);
    let mut found = Found { direct: Rgb::ZERO, indirect: Rgb::ZERO, light_pdf_w: 0.0 };
    let Some(hit) = scene.hit(&ray) else {
        (found.direct, found.light_pdf_w) = scene.lights.background_with_pdf_w(wi);
        return found;
    };
    if let Some(light) = hit.light {
        found.direct = scene.emitted(&hit, -wi);
        found.light_pdf_w = scene.lights.pdf_emitted_w(light, &scene.geometry, s.p, wi, hit.p, hit.n_g);
    }
    if hit.bsdf.has_smooth() && segments_left > 1 && maps.gathers() {
        let distance = (hit.p - ray.o).length();
        found.indirect = maps.gather(&hit, -wi, distance, segments_left - 1, scratch);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::plan::Plan;
    use crate::integrator::{Budget, Kind, Options};
    use crate::scene;

    /// Trials on the floor of a unit cube where a direction finds direct light with such a variance.
    fn trials(n: u64, moment: impl Fn(Vec3) -> f64) -> Vec<Trial> {
        let trial = |index| {
            let p = Sampler::new(1, Stream::Eye, 0, index).next_2d().extend(0.0);
            let direct = CHOICES.map(|_| [Moments([0.0, moment(p)]), Moments::default()]);
            Trial { p, n: Vec3::Z, all: 1.0, direct }
        };
        (0..n).map(trial).collect()
    }

    #[test]
    fn noise_is_worth_directions() {
        let chosen = [0.0, 0.01, 0.1, 1.0, 10.0].map(|moment| directions(&trials(100, |_| moment)));
        assert!(chosen.is_sorted() && chosen[0] == 1 && chosen[4] == CHOICES[4], "{chosen:?}");
        // Black is known well enough.
        let black = vec![Trial { n: Vec3::Z, ..Trial::default() }; 100];
        assert_eq!(directions(&black), 1);
    }

    #[test]
    fn regions_differ() {
        let cube = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
        let noisy = |p: Vec3| if p.x < 0.5 { 10.0 } else { 0.0 };
        let effort = Effort::of(trials(4000, noisy).into_iter(), cube);
        let probe = |x, n| effort.at(Vec3::new(x, 0.5, 0.0), n);
        assert_eq!([probe(0.2, Vec3::Z), probe(0.8, Vec3::Z)], [CHOICES[4], 1]);
        // Nobody has seen it from below.
        assert_eq!(probe(0.2, -Vec3::Z), 1);
        // Too few to tell, or nowhere.
        for (n, bounds) in [(FEWEST as u64 - 1, cube), (0, cube), (1000, Bounds::EMPTY)] {
            let effort = Effort::of(trials(n, noisy).into_iter(), bounds);
            assert!(effort.nodes.len() == 8 && effort.at(Vec3::ZERO, Vec3::Z) >= 1);
        }
    }

    /// A floor under a lid with a hole to the sky asks for more; one under the open sky, or under a lamp,
    /// does not.
    #[test]
    fn a_hole_to_the_sky_asks_for_more() {
        let floor = "<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='40'/><transform name='to_world'>\
            <lookat origin='0, 0, 0.9' target='0, 0, 0' up='0, 1, 0'/></transform></sensor>\
            <shape type='rectangle'><transform name='to_world'><scale value='30'/></transform></shape>";
        let sky = "<emitter type='constant'/>";
        let lid: String = [(15.2, 0.0, 14.8, 30.0), (-15.2, 0.0, 14.8, 30.0), (0.0, 15.2, 0.4, 14.8), (0.0, -15.2, 0.4, 14.8)]
            .map(|(x, y, a, b)| {
                format!(
                    "<shape type='rectangle'><transform name='to_world'><scale x='{a}' y='{b}'/>\
                     <translate x='{x}' y='{y}' z='1'/></transform><bsdf type='twosided'><bsdf type='diffuse'/></bsdf></shape>"
                )
            })
            .concat();
        let lamp = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='180'/><translate z='1'/></transform>\
            <emitter type='area'/></shape>";
        let most = |body: &str| {
            let dir = tempfile::tempdir().unwrap();
            let file = dir.path().join("scene.xml");
            std::fs::write(&file, format!("{floor}{body}</scene>")).unwrap();
            let description = scene::load(&file, &[], Some((16, 16))).unwrap();
            let scene = Scene::new(description, crate::accel::available()[0]).unwrap();
            let options = Options {
                integrator: Kind::Photonmap,
                params: Params::default(),
                seed: 0,
                budget: Budget::Passes(1),
                aovs: false,
            };
            let plan = Plan::new(&scene, &options);
            let (maps, _) = Maps::new(&scene, &options.params, &plan, 0, 0);
            let effort = Effort::new(&scene, &options.params, plan.pixels, &maps);
            effort.map_or(1, |effort| effort.at(Vec3::ZERO, Vec3::Z))
        };
        let [open, lit, hole] = [most(sky), most(lamp), most(&format!("{sky}{lid}"))];
        assert!(open <= 2 && lit == 1 && hole > 4, "{open} {lit} {hole}");
    }
}
