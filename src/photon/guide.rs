//! Which of the random numbers that a photon starts from are worth drawing: those whose photons show in the
//! picture, as a few photons sent ahead find out ([`super::pilots`]). Targets ([`crate::light::Targets`])
//! bound where such photons go and know nothing of what stands in the way, of lamps that turn away, or of the
//! gaps in what they bound. The choice among lights is one of these numbers, so the one lamp of many whose
//! light is seen gets the photons.
//!
//! The five numbers of [`crate::light::Lights::sample_emission`] (light, position, direction) are the
//! coordinates of a unit cube. A tree halves it where that tells useful from useless (as the spatial trees of
//! Müller et al. 2017, "Practical Path Guiding", but over random numbers: Guo et al. 2018, "Primary Sample
//! Space Path Guiding"), and its leaves are drawn from by what they have brought, so photons also become
//! equally bright. A share of the density is uniform, so it is positive wherever a photon can start, and
//! known exactly, so nothing is biased whatever was learnt.

use crate::light::Targets;

/// Coordinates: light, position, direction.
pub(super) const AXES: usize = 5;
/// Nodes of fewer photons are not divided.
const MIN_PHOTONS: usize = 48;
/// What is known of a node without any photons weighs as much as so many.
const PRIOR: f32 = 2.0;
/// Parts of each axis that are told apart when one is chosen. More than two: a half may look like the other
/// one.
const PARTS: usize = 8;
/// By how much the parts must differ beyond chance: their relative entropy, times the node's share of all
/// worth.
const MIN_GAIN: f32 = 2e-4;
/// Steps of a half's odds in an octave. Without them, the photon that rounding sends past an edge moves every
/// photon of every pass a little, and what was to differ by rounding differs by noise (tests/backends.rs).
/// They cost under 1 % of the variance.
const STEPS: f32 = 4.0;

/// A density over the random numbers of emission.
#[derive(Clone, Debug)]
pub struct Guide {
    /// The root is the first.
    nodes: Vec<Node>,
    /// Where to aim instead of at all that counts.
    targets: Option<Targets>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    /// The axis that is halved; a leaf has none, that is [`AXES`].
    axis: u32,
    /// The lower half; the upper one follows.
    child: u32,
    /// Probability of the lower half.
    prob: f32,
}

const LEAF: Node = Node { axis: AXES as u32, child: 0, prob: 0.0 };

/// A photon sent ahead.
#[derive(Clone, Copy)]
pub(super) struct Pilot {
    /// Where it has started.
    pub(super) at: [f32; AXES],
    /// 1 / density.
    pub(super) weight: f32,
    /// What it was worth, times the weight.
    pub(super) worth: f32,
}

impl Guide {
    /// Knows nothing but where to aim.
    pub(super) fn even(targets: Option<Targets>) -> Guide {
        Guide { nodes: vec![LEAF], targets }
    }

    /// Where photons are aimed, if that was learnt as well.
    pub fn targets(&self) -> Option<&Targets> {
        self.targets.as_ref()
    }

    /// What `pilots` have learnt, but for the share `uniform` of all photons, which start as if nothing were
    /// known. `None` if no pilot was worth anything.
    pub(super) fn of(
        pilots: &mut [Pilot],
        uniform: f32,
        norm: Norm,
        targets: Option<Targets>,
    ) -> Option<Guide> {
        let mut nodes = vec![LEAF];
        let mut masses = vec![0.0];
        let whole = norm.mean(pilots, 0.0);
        let total = grow(
            norm,
            pilots,
            &mut nodes,
            &mut masses,
            0,
            whole,
            Cell { low: [0.0; AXES], size: [1.0; AXES] },
        );
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        // From masses to probabilities, with the uniform share: of each half, its share of the volume.
        let mut volumes = vec![1.0f32; nodes.len()];
        for i in 0..nodes.len() {
            let Node { axis, child, .. } = nodes[i];
            if (axis as usize) < AXES {
                let child = child as usize;
                volumes[child] = 0.5 * volumes[i];
                volumes[child + 1] = volumes[child];
                let prob = |i: usize| (1.0 - uniform) * masses[i] / total + uniform * volumes[i];
                nodes[i].prob = in_steps(prob(child) / prob(child + 1));
            }
        }
        Some(Guide { nodes, targets })
    }

    /// The point that the random numbers `u` draw, and 1 / density there.
    pub fn warp(&self, mut u: [f32; AXES]) -> ([f32; AXES], f32) {
        let (mut low, mut size, mut weight) = ([0.0f32; AXES], [1.0f32; AXES], 1.0);
        let mut node = &self.nodes[0];
        while (node.axis as usize) < AXES {
            let a = node.axis as usize;
            size[a] *= 0.5;
            let upper = u[a] >= node.prob;
            let (prob, below) = if upper { (1.0 - node.prob, node.prob) } else { (node.prob, 0.0) };
            // What is left of a number is used again, so points stay as evenly spread as they were.
            u[a] = ((u[a] - below) / prob).clamp(0.0, BELOW_ONE);
            low[a] += if upper { size[a] } else { 0.0 };
            weight *= 0.5 / prob;
            node = &self.nodes[node.child as usize + upper as usize];
        }
        let at = std::array::from_fn(|a| (low[a] + size[a] * u[a]).min(BELOW_ONE));
        (at, weight)
    }
}

const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// The part of the unit cube that a node is for.
#[derive(Clone, Copy)]
struct Cell {
    low: [f32; AXES],
    size: [f32; AXES],
}

/// Divides a node as long as that is worth while; returns its mass, ∫ worth over its volume.
fn grow(
    norm: Norm,
    pilots: &mut [Pilot],
    nodes: &mut Vec<Node>,
    masses: &mut Vec<f32>,
    node: usize,
    around: f32,
    Cell { low, size }: Cell,
) -> f32 {
    let here = norm.mean(pilots, around);
    masses[node] = size.iter().product::<f32>() * here;
    if pilots.len() < MIN_PHOTONS {
        return masses[node];
    }
    // Half of what parts differ by for chance alone: χ² of so many parts, over twice the number of photons
    // that are worth as much. (measured: all of it leaves ring's tree too coarse, see tests/aiming.rs)
    let (sum, squares) =
        pilots.iter().fold((0.0f32, 0.0f32), |(sum, sq), p| (sum + p.worth, sq + p.worth * p.worth));
    let doubt = if sum > 0.0 { 0.25 * (PARTS - 1) as f32 * squares / (sum * sum) } else { 0.0 };
    let gains: [f32; AXES] = std::array::from_fn(|a| gain(pilots, a, low[a], size[a]) - doubt);
    // Where one photon is worth more than all others, all axes tell it from them equally well but for
    // rounding.
    let compared = gains.map(|gain| (gain * 1024.0).round());
    let axis = (0..AXES).max_by(|&a, &b| compared[a].total_cmp(&compared[b])).unwrap_or(0);
    if gains[axis] * masses[node] < MIN_GAIN * masses[0] {
        return masses[node];
    }
    let middle = low[axis] + 0.5 * size[axis];
    // Stable, for the sake of equal sums whatever happens.
    pilots.sort_by_key(|p| p.at[axis] >= middle);
    let n = pilots.partition_point(|p| p.at[axis] < middle);
    let (lower, upper) = pilots.split_at_mut(n);
    if lower.is_empty() || upper.is_empty() {
        return masses[node];
    }
    let child = nodes.len();
    for _ in 0..2 {
        nodes.push(LEAF);
        masses.push(0.0);
    }
    (nodes[node].axis, nodes[node].child) = (axis as u32, child as u32);
    let mut half = size;
    half[axis] *= 0.5;
    let mut above = low;
    above[axis] = middle;
    masses[node] = grow(norm, lower, nodes, masses, child, here, Cell { low, size: half })
        + grow(norm, upper, nodes, masses, child + 1, here, Cell { low: above, size: half });
    masses[node]
}

/// How the worth of a node follows from that of its photons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Norm {
    /// Its mean, so that photons become equally bright: where most photons of a node are worthless, they are
    /// few.
    Mean,
    /// Its root mean square: in proportion to it the density leaves the least variance, also where few are
    /// worth much.
    RootMeanSquare,
}

impl Norm {
    /// Over the photons of a node, if as many as [`PRIOR`] more had brought what those of the node `around`
    /// it do: where none of a few photons was useful, the next one may be, and would be blinding if it were
    /// thought impossible.
    fn mean(self, pilots: &[Pilot], around: f32) -> f32 {
        let worth = |p: &Pilot| match self {
            Norm::Mean => p.worth,
            Norm::RootMeanSquare => p.worth * (p.worth / p.weight),
        };
        let (sum, weight) =
            pilots.iter().fold((0.0, 0.0), |(sum, weight), p| (sum + worth(p), weight + p.weight));
        let n = pilots.len() as f32;
        let own = match self {
            Norm::Mean => sum / weight,
            Norm::RootMeanSquare => (sum / weight).sqrt(),
        };
        if weight > 0.0 { (n * own + PRIOR * around) / (n + PRIOR) } else { around }
    }
}

/// A probability whose odds are `odds`, to the nearest step of these.
fn in_steps(odds: f32) -> f32 {
    // Far beyond what the uniform share leaves; it keeps both halves possible.
    let octaves = (odds.log2() * STEPS).round().clamp(-20.0 * STEPS, 20.0 * STEPS) / STEPS;
    1.0 / (1.0 + (-octaves).exp2())
}

/// Relative entropy of the worth over equal parts of an axis.
fn gain(pilots: &[Pilot], axis: usize, low: f32, size: f32) -> f32 {
    let mut parts = [(0.0f32, 0.0f32); PARTS];
    for p in pilots {
        let part = ((p.at[axis] - low) * (PARTS as f32 / size)) as usize;
        let (flux, weight) = &mut parts[part.min(PARTS - 1)];
        *flux += p.worth;
        *weight += p.weight;
    }
    let means = parts.map(|(flux, weight)| if weight > 0.0 { flux / weight } else { 0.0 });
    let total: f32 = means.iter().sum();
    if total <= 0.0 {
        return 0.0;
    }
    means.iter().map(|m| m / total).filter(|&q| q > 0.0).map(|q| q * (q * PARTS as f32).ln()).sum()
}
