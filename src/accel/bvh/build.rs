//! Top-down build with the surface area heuristic over bins (Wald 2007, "On fast Construction of SAH-based Bounding
//! Volume Hierarchies"). The tree does not depend on the number of threads.

use crate::shape::Bounds;
use rayon::prelude::*;

/// No leaf lies deeper. Beyond [`SAH_DEPTH`] nodes are halved, and 2³² primitives can be halved 32 times.
pub(super) const MAX_DEPTH: u32 = SAH_DEPTH + 32;
const SAH_DEPTH: u32 = 40;
const MAX_LEAF: usize = 8;
const BINS: usize = 16;
/// Cost of visiting a node, in triangle tests.
const VISIT: f32 = 1.0;
/// Subtrees of more items than this are built in parallel.
const PARALLEL: usize = 4096;

/// A primitive as the build sees it.
#[derive(Clone, Copy)]
pub(super) struct Item {
    pub(super) bounds: Bounds,
    pub(super) index: u32,
}

/// A subtree. An inner node has children, a leaf `count` items from `first` on.
pub(super) struct Tree {
    pub(super) bounds: Bounds,
    pub(super) children: Option<Box<[Tree; 2]>>,
    pub(super) first: u32,
    pub(super) count: u32,
}

/// Brings finite items into the leaves' order and builds the tree over them; `None` without items.
pub(super) fn build(items: &mut [Item]) -> Option<Tree> {
    (!items.is_empty()).then(|| subtree(items, 0, 0))
}

fn subtree(items: &mut [Item], first: u32, depth: u32) -> Tree {
    let extents = fold(items, Extents::EMPTY, Extents::add, Extents::join);
    let split = (depth < SAH_DEPTH).then(|| best_split(items, &extents)).flatten();
    let n = items.len();
    let bounds = extents.bounds;
    // The leaf's cost is n; costs are multiplied by the node's area.
    let worth =
        split.as_ref().is_some_and(|s| s.cost + VISIT * half_area(bounds) < n as f32 * half_area(bounds));
    if n == 1 || n <= MAX_LEAF && !worth {
        return Tree { bounds, children: None, first, count: n as u32 };
    }
    let middle = match split {
        Some(split) => partition(items, |item| split.bins.of(item) < split.bin),
        None => halve(items, &extents),
    };
    let (left, right) = items.split_at_mut(middle);
    let children = if n > PARALLEL {
        rayon::join(|| subtree(left, first, depth + 1), || subtree(right, first + middle as u32, depth + 1))
    } else {
        (subtree(left, first, depth + 1), subtree(right, first + middle as u32, depth + 1))
    };
    Tree { bounds, children: Some(Box::new(children.into())), first: 0, count: 0 }
}

/// Folds over the items, in parallel if they are many. All our folds are minima, maxima and counts, so any grouping
/// gives the same result.
fn fold<T: Copy + Send + Sync>(
    items: &[Item],
    empty: T,
    add: impl Fn(&mut T, &Item) + Sync,
    join: impl Fn(&mut T, &T) + Sync,
) -> T {
    const CHUNK: usize = 1 << 15;
    let serial = |items: &[Item]| {
        let mut result = empty;
        items.iter().for_each(|item| add(&mut result, item));
        result
    };
    if items.len() < 2 * CHUNK {
        return serial(items);
    }
    let joined = |mut a: T, b: T| {
        join(&mut a, &b);
        a
    };
    items.par_chunks(CHUNK).map(serial).reduce(|| empty, joined)
}

/// Bounds of items, and of their centres.
#[derive(Clone, Copy)]
struct Extents {
    bounds: Bounds,
    centers: Bounds,
}

impl Extents {
    const EMPTY: Extents = Extents { bounds: Bounds::EMPTY, centers: Bounds::EMPTY };

    fn add(&mut self, item: &Item) {
        self.bounds = self.bounds.union(item.bounds);
        self.centers = self.centers.grow(item.bounds.center());
    }

    fn join(&mut self, other: &Extents) {
        self.bounds = self.bounds.union(other.bounds);
        self.centers = self.centers.union(other.centers);
    }
}

/// Infinite or NaN for huge boxes, which then never look worth a split.
fn half_area(b: Bounds) -> f32 {
    let d = b.max - b.min;
    if b.is_empty() { 0.0 } else { d.x * d.y + d.y * d.z + d.z * d.x }
}

/// Equal intervals along one axis of the centres' bounds.
#[derive(Clone, Copy)]
struct Bins {
    axis: usize,
    start: f32,
    scale: f32,
}

impl Bins {
    fn of(&self, item: &Item) -> usize {
        // The conversion saturates, and takes NaN (of an infinite scale) to 0.
        (((item.bounds.center()[self.axis] - self.start) * self.scale) as usize).min(BINS - 1)
    }
}

/// Bounds and number of the items in each bin.
type Filled = [(Bounds, usize); BINS];

struct Split {
    bins: Bins,
    /// The first bin of the right side.
    bin: usize,
    /// Σ half area · items of both sides.
    cost: f32,
}

fn best_split(items: &[Item], extents: &Extents) -> Option<Split> {
    let extent = extents.centers.max - extents.centers.min;
    let bins = [0, 1, 2].map(|axis| Bins {
        axis,
        start: extents.centers.min[axis],
        scale: BINS as f32 / extent[axis],
    });
    let mut best: Option<Split> = None;
    for bins in bins.into_iter().filter(|b| extent[b.axis] > 0.0) {
        let put = |filled: &mut Filled, (bin, bounds, count): (usize, Bounds, usize)| {
            filled[bin] = (filled[bin].0.union(bounds), filled[bin].1 + count);
        };
        let filled = fold(
            items,
            [(Bounds::EMPTY, 0); BINS],
            |filled, item| put(filled, (bins.of(item), item.bounds, 1)),
            |filled, other| (0..BINS).for_each(|bin| put(filled, (bin, other[bin].0, other[bin].1))),
        );
        // What lies right of each boundary, then sweep from the left.
        let mut right = [(0.0, 0); BINS];
        let mut side = (Bounds::EMPTY, 0);
        for bin in (1..BINS).rev() {
            side = (side.0.union(filled[bin].0), side.1 + filled[bin].1);
            right[bin] = (half_area(side.0) * side.1 as f32, side.1);
        }
        let mut side = (Bounds::EMPTY, 0);
        for bin in 1..BINS {
            side = (side.0.union(filled[bin - 1].0), side.1 + filled[bin - 1].1);
            let cost = half_area(side.0) * side.1 as f32 + right[bin].0;
            if side.1 > 0 && right[bin].1 > 0 && cost < best.as_ref().map_or(f32::INFINITY, |b| b.cost) {
                best = Some(Split { bins, bin, cost });
            }
        }
    }
    best
}

/// Moves the items of the left side to the front and returns how many they are.
fn partition(items: &mut [Item], is_left: impl Fn(&Item) -> bool) -> usize {
    let (mut left, mut right) = (0, items.len());
    while left < right {
        if is_left(&items[left]) {
            left += 1;
        } else {
            right -= 1;
            items.swap(left, right);
        }
    }
    left
}

/// Two halves by the centres along their longest axis.
fn halve(items: &mut [Item], extents: &Extents) -> usize {
    let axis = (extents.centers.max - extents.centers.min).max_position();
    let middle = items.len() / 2;
    let center = |item: &Item| item.bounds.center()[axis];
    items.select_nth_unstable_by(middle, |a, b| center(a).total_cmp(&center(b)).then(a.index.cmp(&b.index)));
    middle
}
