//! Top-down build with the surface area heuristic over bins (Wald 2007, "On fast Construction of SAH-based Bounding
//! Volume Hierarchies"), eight children a node (Wald, Benthin & Boulos 2008, "Getting Rid of Packets"). The tree does
//! not depend on the number of threads.

use super::node::{Node, Ref};
use super::triangle::Packet;
use crate::shape::Bounds;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// No leaf lies deeper. Beyond [`SAH_DEPTH`] sets are halved, and 2³² primitives can be halved 32 times.
pub(super) const MAX_DEPTH: u32 = SAH_DEPTH + 32;
const SAH_DEPTH: u32 = 40;
const BINS: usize = 16;
/// Sets of more items are split, and their subtrees built, by many threads.
const PARALLEL: usize = 1 << 14;

/// A primitive as the build sees it.
#[derive(Clone, Copy)]
pub(super) struct Item {
    /// The last component holds the index.
    lower: Vec4,
    /// The last component is 1 for a single (see [`Ref`]) and 0 for a triangle.
    upper: Vec4,
}

impl Item {
    /// Stands for what is not finite.
    pub(super) const BROKEN: Item = Item { lower: Vec4::NAN, upper: Vec4::NAN };

    pub(super) fn is_broken(&self) -> bool {
        self.lower.x.is_nan()
    }

    pub(super) fn triangle(bounds: Bounds, index: u32) -> Item {
        Item { lower: bounds.min.extend(Item::coded(index)), upper: bounds.max.extend(0.0) }
    }

    pub(super) fn single(bounds: Bounds, index: u32) -> Item {
        Item { lower: bounds.min.extend(Item::coded(index)), upper: bounds.max.extend(1.0) }
    }

    /// An index below [`Ref::LIMIT`] as a number that is not denormal: some CPUs are slow on those.
    fn coded(index: u32) -> f32 {
        f32::from_bits(index + Ref::LIMIT as u32)
    }

    pub(super) fn index(&self) -> usize {
        self.lower.w.to_bits() as usize - Ref::LIMIT
    }

    /// Twice the centre.
    fn center(&self) -> Vec4 {
        self.lower + self.upper
    }
}

/// A box whose last components mean nothing, or what they mean in [`Item`].
#[derive(Clone, Copy)]
struct Box4 {
    lower: Vec4,
    upper: Vec4,
}

impl Box4 {
    const EMPTY: Box4 = Box4 { lower: Vec4::INFINITY, upper: Vec4::NEG_INFINITY };

    fn grow(&mut self, lower: Vec4, upper: Vec4) {
        self.lower = self.lower.min(lower);
        self.upper = self.upper.max(upper);
    }

    fn join(&mut self, other: &Box4) {
        self.grow(other.lower, other.upper);
    }

    /// Infinite or NaN for huge boxes, which then never look worth a split.
    fn half_area(&self) -> f32 {
        let d = (self.upper - self.lower).truncate();
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: self.lower.truncate(), max: self.upper.truncate() }
    }
}

/// Items that are to become a subtree.
struct Set<'a> {
    items: &'a mut [Item],
    /// Index of the first of them.
    first: usize,
    bounds: Box4,
    /// Of twice the centres.
    centers: Box4,
    /// Splits above.
    depth: u32,
}

/// A subtree, and the items of each packet of its triangles.
#[derive(Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    /// The first item and how many.
    pub(super) packets: Vec<(u32, u32)>,
}

/// Brings finite items into the packets' order and builds the tree over them; the root is its first node, which is
/// empty if there are none.
pub(super) fn build(items: &mut [Item]) -> Tree {
    let mut tree = Tree::default();
    let (bounds, centers) = extents(items);
    let all = Set { items, first: 0, bounds, centers, depth: 0 };
    tree.add(if all.items.is_empty() { Vec::new() } else { vec![all] });
    tree
}

/// Bounds of items, and of twice their centres.
fn extents(items: &[Item]) -> (Box4, Box4) {
    let serial = |items: &[Item]| {
        let mut both = (Box4::EMPTY, Box4::EMPTY);
        for item in items {
            both.0.grow(item.lower, item.upper);
            both.1.grow(item.center(), item.center());
        }
        both
    };
    fold(items, &serial, &|a, b| {
        a.0.join(&b.0);
        a.1.join(&b.1);
    })
}

/// Folds over items, in parallel if they are many. All our folds are minima, maxima and counts, so any grouping gives
/// the same result.
fn fold<T: Send>(
    items: &[Item],
    serial: &(impl Fn(&[Item]) -> T + Sync),
    join: &(impl Fn(&mut T, &T) + Sync),
) -> T {
    if items.len() <= PARALLEL {
        return serial(items);
    }
    let (left, right) = items.split_at(items.len() / 2);
    let (mut a, b) = rayon::join(|| fold(left, serial, join), || fold(right, serial, join));
    join(&mut a, &b);
    a
}

impl Tree {
    /// Adds a node over the sets, and what hangs below.
    fn add(&mut self, mut sets: Vec<Set>) -> Ref {
        // Opens the largest one, as in Embree's builder, until there are eight.
        while sets.len() < 8 {
            let area = |i: &usize| sets[*i].bounds.half_area();
            let open =
                (0..sets.len()).filter(|&i| !sets[i].is_leaf()).max_by(|i, j| area(i).total_cmp(&area(j)));
            let Some(open) = open else { break };
            let (left, right) = sets.swap_remove(open).split();
            sets.extend([left, right]);
        }
        let slots = slots(&sets);
        let index = self.nodes.len();
        let mut node = Node::EMPTY;
        self.nodes.push(node);
        let bounds: Vec<Bounds> = sets.iter().map(|set| set.bounds.bounds()).collect();
        if sets.iter().map(|set| set.items.len()).sum::<usize>() > PARALLEL {
            let parts: Vec<(Tree, Ref)> = sets
                .into_par_iter()
                .map(|set| {
                    let mut part = Tree::default();
                    let root = part.add_set(set);
                    (part, root)
                })
                .collect();
            for (i, (part, root)) in parts.into_iter().enumerate() {
                node.set(slots[i], bounds[i], self.append(part, root));
            }
        } else {
            for (i, set) in sets.into_iter().enumerate() {
                node.set(slots[i], bounds[i], self.add_set(set));
            }
        }
        self.nodes[index] = node;
        Ref::node(index)
    }

    fn add_set(&mut self, set: Set) -> Ref {
        if !set.is_leaf() {
            return self.add(vec![set]);
        }
        match set.items {
            [item] if item.upper.w > 0.0 => Ref::single(item.index()),
            items => {
                self.packets.push((set.first as u32, items.len() as u32));
                Ref::packet(self.packets.len() - 1)
            }
        }
    }

    fn append(&mut self, part: Tree, root: Ref) -> Ref {
        let (nodes, packets) = (self.nodes.len(), self.packets.len());
        self.nodes.extend(part.nodes.into_iter().map(|mut node| {
            node.children = node.children.map(|child| Ref(child).moved(nodes, packets).0);
            node
        }));
        self.packets.extend(part.packets);
        root.moved(nodes, packets)
    }
}

/// In which slot of their node to put the sets, so that [`super::node::ORDER`] is about the order of distance: the most
/// fitting pair of set and slot first (Ylitie et al. 2017, 3.2, but greedily).
fn slots(sets: &[Set]) -> [usize; 8] {
    let mut all = Box4::EMPTY;
    sets.iter().for_each(|set| all.join(&set.bounds));
    let middle = all.lower + all.upper;
    let offsets: Vec<Vec3> =
        sets.iter().map(|set| (set.bounds.lower + set.bounds.upper - middle).truncate()).collect();
    let (mut slots, mut free) = ([usize::MAX; 8], [true; 8]);
    for _ in sets {
        let mut best: Option<(f32, usize, usize)> = None;
        for (set, offset) in offsets.iter().enumerate().filter(|(set, _)| slots[*set] == usize::MAX) {
            for slot in (0..8).filter(|&slot| free[slot]) {
                let sign = |axis: usize| if slot >> axis & 1 == 1 { 1.0 } else { -1.0 };
                let fit = offset.dot(Vec3::new(sign(0), sign(1), sign(2)));
                if best.is_none_or(|best| fit > best.0) {
                    best = Some((fit, set, slot));
                }
            }
        }
        if let Some((_, set, slot)) = best {
            slots[set] = slot;
            free[slot] = false;
        }
    }
    slots
}

impl<'a> Set<'a> {
    fn is_leaf(&self) -> bool {
        let all_triangles = self.bounds.upper.w <= 0.0;
        self.items.len() == 1 || self.items.len() <= Packet::SIZE && all_triangles
    }

    /// Two sets, neither empty, of one with more than one item.
    fn split(self) -> (Set<'a>, Set<'a>) {
        let split = (self.depth < SAH_DEPTH).then(|| Split::best(&self)).flatten();
        let (middle, centers, bounds) = match split {
            Some(split) => {
                let (middle, centers) = partition(self.items, &|center| split.is_left(center));
                (middle, centers, split.bounds)
            }
            None => {
                let middle = halve(self.items, &self.centers);
                let (left, right) = self.items.split_at(middle);
                let [left, right] = [left, right].map(extents);
                (middle, [left.1, right.1], [left.0, right.0])
            }
        };
        let (left, right) = self.items.split_at_mut(middle);
        let depth = self.depth + 1;
        (
            Set { items: left, first: self.first, bounds: bounds[0], centers: centers[0], depth },
            Set { items: right, first: self.first + middle, bounds: bounds[1], centers: centers[1], depth },
        )
    }
}

/// Equal intervals of twice the centres along each axis.
#[derive(Clone, Copy)]
struct Bins {
    start: Vec4,
    scale: Vec4,
    last: Vec4,
}

impl Bins {
    fn new(centers: &Box4, count: usize) -> Bins {
        let extent = centers.upper - centers.lower;
        let scale = extent.truncate().map(|e| if e > 0.0 { count as f32 / e } else { 0.0 });
        Bins { start: centers.lower, scale: scale.extend(0.0), last: Vec4::splat((count - 1) as f32) }
    }

    /// By axis.
    fn of(&self, center: Vec4) -> [u32; 4] {
        // In this order NaN, of what overflows, becomes 0.
        let bin = ((center - self.start) * self.scale - 0.5).max(Vec4::ZERO).min(self.last);
        // Adding 2²³ rounds to an integer, which is then in the lowest bits.
        (bin + 8_388_608.0).to_array().map(|x| x.to_bits() & 0xff)
    }
}

/// Bounds and number of the items in each bin of each axis.
struct Filled([[(Box4, u32); BINS]; 3]);

impl Filled {
    fn new(items: &[Item], bins: &Bins) -> Filled {
        let mut filled = Filled([[(Box4::EMPTY, 0); BINS]; 3]);
        for item in items {
            let bin = bins.of(item.center());
            for (filled, bin) in filled.0.iter_mut().zip(bin) {
                let (bounds, count) = &mut filled[bin as usize % BINS];
                bounds.grow(item.lower, item.upper);
                *count += 1;
            }
        }
        filled
    }

    fn join(&mut self, other: &Filled) {
        for (to, from) in self.0.iter_mut().flatten().zip(other.0.iter().flatten()) {
            to.0.join(&from.0);
            to.1 += from.1;
        }
    }
}

struct Split {
    bins: Bins,
    axis: usize,
    /// The first bin of the right side.
    bin: u32,
    bounds: [Box4; 2],
}

impl Split {
    fn is_left(&self, center: Vec4) -> bool {
        self.bins.of(center)[self.axis] < self.bin
    }

    fn best(set: &Set) -> Option<Split> {
        // Few items do not need many bins.
        let count = BINS.min(4 + set.items.len() / 8);
        let bins = Bins::new(&set.centers, count);
        let filled = fold(set.items, &|items| Filled::new(items, &bins), &Filled::join);
        let mut best: Option<Split> = None;
        let mut least = f32::INFINITY;
        for (axis, filled) in filled.0.iter().enumerate().filter(|(axis, _)| bins.scale[*axis] > 0.0) {
            // What lies right of each boundary, then sweep from the left.
            let mut right = [(Box4::EMPTY, 0); BINS];
            let mut side = (Box4::EMPTY, 0);
            for bin in (1..count).rev() {
                side.0.join(&filled[bin].0);
                side.1 += filled[bin].1;
                right[bin] = side;
            }
            let mut side = (Box4::EMPTY, 0);
            for bin in 1..count {
                side.0.join(&filled[bin - 1].0);
                side.1 += filled[bin - 1].1;
                let (left, right) = (&side, &right[bin]);
                if left.1 == 0 || right.1 == 0 {
                    continue;
                }
                let cost = left.0.half_area() * packets(left.1) + right.0.half_area() * packets(right.1);
                if cost < least {
                    least = cost;
                    best = Some(Split { bins, axis, bin: bin as u32, bounds: [left.0, right.0] });
                }
            }
        }
        best
    }
}

/// How many packets as many triangles fill.
fn packets(triangles: u32) -> f32 {
    triangles.div_ceil(Packet::SIZE as u32) as f32
}

/// Moves the items of the left side to the front, and returns how many they are and the bounds of both sides' centres.
fn partition(items: &mut [Item], is_left: &(impl Fn(Vec4) -> bool + Sync)) -> (usize, [Box4; 2]) {
    if items.len() <= PARALLEL {
        let (mut left, mut right) = (Box4::EMPTY, Box4::EMPTY);
        let mut middle = 0;
        for i in 0..items.len() {
            // Without branches: which side is hard to predict.
            let center = items[i].center();
            let goes_left = is_left(center);
            let pick = |yes: bool, no: f32| if yes { center } else { Vec4::splat(no) };
            left.grow(pick(goes_left, f32::INFINITY), pick(goes_left, f32::NEG_INFINITY));
            right.grow(pick(!goes_left, f32::INFINITY), pick(!goes_left, f32::NEG_INFINITY));
            items.swap(i, middle);
            middle += goes_left as usize;
        }
        return (middle, [left, right]);
    }
    let half = items.len() / 2;
    let (a, b) = items.split_at_mut(half);
    let ((a, mut centers), (b, others)) = rayon::join(|| partition(a, is_left), || partition(b, is_left));
    centers.iter_mut().zip(&others).for_each(|(to, from)| to.join(from));
    // Left, right, left, right: the inner two change places, as far as they are equally long.
    let inner = &mut items[a..half + b];
    let (n, length) = (b.min(half - a), inner.len());
    let (front, back) = inner.split_at_mut(length - n);
    front[..n].swap_with_slice(back);
    (a + b, centers)
}

/// Two halves by the centres along their longest axis.
fn halve(items: &mut [Item], centers: &Box4) -> usize {
    let axis = (centers.upper - centers.lower).truncate().max_position();
    let middle = items.len() / 2;
    let center = |item: &Item| item.center()[axis];
    items.select_nth_unstable_by(middle, |a, b| {
        center(a).total_cmp(&center(b)).then(a.index().cmp(&b.index()))
    });
    middle
}
