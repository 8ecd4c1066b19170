//! A static, balanced kd-tree over points: k nearest neighbours and radius search (Bentley 1975, "Multidimensional
//! Binary Search Trees Used for Associative Searching"). It knows no photons: [`KdTree::build`] returns the order of
//! its slots, and payloads are permuted once into that order.
//!
//! Points lie in blocks of 4, coordinate by coordinate, every block full but the last: block b holds the slots from 4b.
//! Nodes are in heap order (children of i: 2i, 2i + 1) and hold a plane and its axis, nothing else: node j of the 2^d
//! of a level covers the blocks from ⌊jL/2^d⌋ to ⌊(j+1)L/2^d⌋ of all L. Leaves hold 32 to 64 points, so nodes take at
//! most 5 bytes per 32 points.
//!
//! Pruning is exact without epsilons: distances to points and to cells round alike, so searches find what brute force
//! in `f32` finds (short of distances whose square overflows: those are not found).

use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Points per block: one SSE register for each coordinate.
const BLOCK: usize = 4;
/// Most blocks per leaf. Testing a point costs next to nothing beside the mispredicted branches of a descent: 16 beats
/// 8 and 4 for every kind of search.
const LEAF_BLOCKS: usize = 16;
/// Most points per leaf.
const LEAF: usize = BLOCK * LEAF_BLOCKS;
/// One bit per point of a leaf.
type Mask = u64;
/// Candidates counted at a time.
const LANES: usize = 8;
/// Up to here, the nearest are kept sorted by insertion.
const SMALL_K: usize = 8;
/// By how much distance² a search starts from more than the last one needed. Points are then found near enough at the
/// first attempt in 9 of 10 searches of a render.
const MARGIN: f32 = 1.4;
/// Subtrees of fewer points are built by one thread.
const SEQUENTIAL: usize = 8192;
/// No tree is deeper: slots are `u32`.
const MAX_DEPTH: usize = 32;

/// Points by coordinate. The last block is filled up with NaN, which no search finds.
#[derive(Clone, Copy, Debug)]
struct Block([Vec4; 3]);

impl Block {
    fn new(items: &[Item]) -> Block {
        let column =
            |a: usize| Vec4::from_array(std::array::from_fn(|k| items.get(k).map_or(f32::NAN, |i| i.c[a])));
        Block([column(0), column(1), column(2)])
    }
}

/// A balanced kd-tree.
#[derive(Clone, Debug)]
pub struct KdTree {
    len: usize,
    /// Followed by a leaf of padding, so that every leaf can be read at full size.
    blocks: Vec<Block>,
    /// Planes and their axes in heap order from 1; as many as leaves, with the unused first.
    planes: Vec<f32>,
    axes: Vec<u8>,
}

/// A point while building.
#[derive(Clone, Copy)]
struct Item {
    c: [f32; 3],
    index: u32,
}

impl KdTree {
    /// Builds the tree over finite points, with all threads of the current rayon pool; the result does not depend on
    /// their number. Also returns the order: slot i of the tree holds `points[order[i]]`.
    ///
    /// Points must be finite: others will not be found, nor perhaps their neighbours.
    ///
    /// # Panics
    /// With 2³² points or more.
    pub fn build(points: &[Vec3]) -> (KdTree, Vec<u32>) {
        Self::build_by(points.len(), |i| points[i])
    }

    /// The same over the points `point(i)` for all i below `len`, wherever they lie. Takes 32 bytes a point in passing, the
    /// tree and the order included.
    ///
    /// # Panics
    /// With 2³² points or more.
    pub fn build_by(len: usize, point: impl Fn(usize) -> Vec3 + Sync) -> (KdTree, Vec<u32>) {
        debug_assert!((0..len).all(|i| point(i).is_finite()), "points must be finite");
        Self::build_any(len, point)
    }

    /// Of any points whatever.
    fn build_any(len: usize, point: impl Fn(usize) -> Vec3 + Sync) -> (KdTree, Vec<u32>) {
        assert!(u32::try_from(len).is_ok(), "too many points");
        let item = |i: usize| Item { c: point(i).to_array(), index: i as u32 };
        let mut items: Vec<Item> = (0..len).into_par_iter().map(item).collect();
        let n_blocks = len.div_ceil(BLOCK);
        let mut depth = 0;
        while n_blocks > LEAF_BLOCKS << depth {
            depth += 1;
        }
        // In order while building, so that subtrees are slices: plane m parts the leaves m - 1 and m.
        let mut nodes = vec![(0.0, 0); 1 << depth];
        split(&mut items, &mut nodes[1..], 0, n_blocks, 0, depth);
        let mut planes = vec![0.0; 1 << depth];
        let mut axes = vec![0; 1 << depth];
        for (m, &node) in nodes.iter().enumerate().skip(1) {
            let i = (m | 1 << depth) >> (m.trailing_zeros() + 1);
            (planes[i], axes[i]) = node;
        }
        let mut blocks: Vec<Block> = Vec::with_capacity(n_blocks + LEAF_BLOCKS);
        items
            .par_chunks(BLOCK)
            .with_min_len(SEQUENTIAL / BLOCK)
            .map(Block::new)
            .collect_into_vec(&mut blocks);
        blocks.resize(blocks.len() + LEAF_BLOCKS, Block([Vec4::NAN; 3]));
        let order = items.par_iter().map(|item| item.index).collect();
        (KdTree { len, blocks, planes, axes }, order)
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The point in `slot`, which must be below [`KdTree::len`].
    pub fn position(&self, slot: u32) -> Vec3 {
        // As arrays: indexing a vector is a jump that is mispredicted.
        let [x, y, z] = self.blocks[slot as usize / BLOCK].0.each_ref().map(AsRef::<[f32; BLOCK]>::as_ref);
        let k = slot as usize % BLOCK;
        Vec3::new(x[k], y[k], z[k])
    }

    /// Visits every point with distance² <= r² in no particular order, as `visit(slot, distance²)`.
    pub fn within(&self, p: Vec3, r: f32, mut visit: impl FnMut(u32, f32)) {
        let bound = below(r);
        self.traverse(p, bound, |first, mut mask, d2| {
            while mask != 0 {
                let k = mask.trailing_zeros();
                mask &= mask - 1;
                visit(first + k, d2[k as usize % LEAF]);
            }
            bound
        });
    }

    /// The nearest points, as many as `heap` takes, with distance² <= r_max². Earlier contents are discarded.
    pub fn nearest(&self, p: Vec3, r_max: f32, heap: &mut KnnHeap) {
        self.nearest_filtered(p, r_max, heap, |_, _| true);
    }

    /// Like [`KdTree::nearest`] among the points that `accept(slot, distance²)`. It is asked only for points that are among
    /// the k nearest as far as known by then.
    pub fn nearest_filtered(
        &self,
        p: Vec3,
        r_max: f32,
        heap: &mut KnnHeap,
        mut accept: impl FnMut(u32, f32) -> bool,
    ) {
        if heap.k == 0 {
            return;
        }
        let farthest = below(r_max);
        let mut bound = heap.enough.min(farthest);
        loop {
            heap.clear(bound);
            self.traverse(p, bound, |first, mask, d2| heap.add(first, mask, d2, &mut accept));
            // Not for NaN, which no radius is below.
            if heap.len < heap.k && bound < farthest {
                bound = farthest;
            } else {
                break;
            }
        }
        heap.finish();
    }

    /// The distance to the farthest point of the leaf that `p` falls into: a ball that wide holds as many
    /// points as a leaf, 32 to 64, give or take a factor. 0 without points.
    pub fn leaf_radius(&self, p: Vec3) -> f32 {
        let (n_leaves, n_blocks) = (self.planes.len(), self.len.div_ceil(BLOCK));
        let query = p.to_array();
        let mut node = 1;
        while node < n_leaves {
            let d = query[self.axes[node] as usize] - self.planes[node];
            node = 2 * node + usize::from(d >= 0.0);
        }
        let begin = (node - n_leaves) * n_blocks / n_leaves;
        let end = (node - n_leaves + 1) * n_blocks / n_leaves;
        let mut farthest = 0.0f32;
        for Block([x, y, z]) in &self.blocks[begin..end] {
            let (x, y, z) = (x - p.x, y - p.y, z - p.z);
            // Not for NaN, which fills the last block.
            let d2 = x * x + y * y + z * z;
            farthest = d2.to_array().into_iter().fold(farthest, f32::max);
        }
        farthest.sqrt()
    }

    /// Visits the leaves that may hold points of distance² below `bound`, near ones first. `leaf(first slot, which are
    /// below the bound, distances²)` returns the new bound. Distances² beyond the leaf's points are NaN or not below.
    #[inline(always)]
    fn traverse(&self, p: Vec3, mut bound: f32, mut leaf: impl FnMut(u32, Mask, &[f32; LEAF]) -> f32) {
        let (n_leaves, n_blocks) = (self.planes.len(), self.len.div_ceil(BLOCK));
        let depth = n_leaves.trailing_zeros();
        // Every leaf has so many blocks, or one less; all are read as if they had, for a constant trip count.
        let leaf_blocks = n_blocks.div_ceil(n_leaves);
        let mut d2 = [Vec4::INFINITY; LEAF_BLOCKS];
        let query = [p.x, p.y, p.z, 0.0];
        let (px, py, pz) = (Vec4::splat(p.x), Vec4::splat(p.y), Vec4::splat(p.z));
        // Cells still to visit: their distance per axis (Arya & Mount 1993, "Algorithms for Fast Vector
        // Quantization") and node.
        let mut stack = [([0.0f32; 3], 0u32); MAX_DEPTH];
        let mut n_stack = 0;
        let mut offset = [0.0f32; 3];
        let mut node = 1;
        loop {
            while node < n_leaves {
                let axis = self.axes[node] as usize;
                let d = query[axis % 4] - self.planes[node];
                node = 2 * node + (d >= 0.0) as usize;
                let far = std::array::from_fn(|a| if a == axis { d } else { offset[a] });
                // Pushed or not without a branch: it would be mispredicted.
                stack[n_stack % MAX_DEPTH] = (far, node as u32 ^ 1);
                n_stack += (length2(far) < bound) as usize;
            }

            let j = (node - n_leaves) as u64;
            let begin = ((j * n_blocks as u64) >> depth) as usize;
            let end = (((j + 1) * n_blocks as u64) >> depth) as usize;
            let limit = Vec4::splat(bound);
            let mut mask: Mask = 0;
            for (b, Block([x, y, z])) in self.blocks[begin..begin + leaf_blocks].iter().enumerate() {
                let (x, y, z) = (x - px, y - py, z - pz);
                let d = x * x + y * y + z * z;
                d2[b % LEAF_BLOCKS] = d;
                mask |= (d.cmplt(limit).bitmask() as Mask) << (BLOCK * b);
            }
            if end - begin < leaf_blocks {
                mask &= (1 << (BLOCK * (end - begin))) - 1;
                d2[end - begin] = Vec4::INFINITY;
            }
            bound = leaf((begin * BLOCK) as u32, mask, bytemuck::cast_ref(&d2));

            loop {
                if n_stack == 0 {
                    return;
                }
                n_stack -= 1;
                let next;
                (offset, next) = stack[n_stack % MAX_DEPTH];
                node = next as usize;
                if length2(offset) < bound {
                    break;
                }
            }
        }
    }
}

/// The least number above r², so that "below" means distance² <= r².
fn below(r: f32) -> f32 {
    let r2 = r * r;
    if r2 < f32::INFINITY { f32::from_bits(r2.to_bits() + 1) } else { r2 }
}

/// One order of operations for points and cells: rounding is monotonic, so a cell is never farther than its points.
#[inline(always)]
fn length2(v: [f32; 3]) -> f32 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// Sorts the `items` of node `j` of a level into leaves. `nodes` are the planes below, in order.
fn split(items: &mut [Item], nodes: &mut [(f32, u8)], j: usize, n_blocks: usize, level: u32, depth: u32) {
    if level == depth {
        return;
    }
    let first = (j * n_blocks) >> level;
    let middle = ((2 * j + 1) * n_blocks) >> (level + 1);
    let n_left = (middle - first) * BLOCK;
    let axis = widest(items);
    // By coordinate (total order: NaN does no harm), ties by index.
    let key = |item: &Item| {
        let bits = item.c[axis].to_bits();
        let order = bits ^ ((bits as i32 >> 31) as u32 | 1 << 31);
        (order as u64) << 32 | item.index as u64
    };
    // The right half has a point, for there are more than LEAF_BLOCKS blocks.
    let (_, item, _) = items.select_nth_unstable_by_key(n_left, key);
    let plane = item.c[axis];
    let (left, right) = items.split_at_mut(n_left);
    let half = nodes.len() / 2;
    nodes[half] = (plane, axis as u8);
    let (left_nodes, right_nodes) = nodes.split_at_mut(half);
    let right_nodes = &mut right_nodes[1..];
    if left.len() + right.len() > SEQUENTIAL {
        rayon::join(
            || split(left, left_nodes, 2 * j, n_blocks, level + 1, depth),
            || split(right, right_nodes, 2 * j + 1, n_blocks, level + 1, depth),
        );
    } else {
        split(left, left_nodes, 2 * j, n_blocks, level + 1, depth);
        split(right, right_nodes, 2 * j + 1, n_blocks, level + 1, depth);
    }
}

/// The axis along which the points extend the farthest.
fn widest(items: &[Item]) -> usize {
    let mut lo = [f32::INFINITY; 3];
    let mut hi = [f32::NEG_INFINITY; 3];
    for item in items {
        for a in 0..3 {
            lo[a] = lo[a].min(item.c[a]);
            hi[a] = hi[a].max(item.c[a]);
        }
    }
    let e = [hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]];
    if e[0] >= e[1] && e[0] >= e[2] {
        0
    } else if e[1] >= e[2] {
        1
    } else {
        2
    }
}

/// Scratch and result of a search for the k nearest: reused, it never allocates.
///
/// Not a binary heap: candidates are gathered unordered, and now and then a bound on the k-th distance is found by
/// counting, which vectorises and has no branch to mispredict.
#[derive(Clone, Debug)]
pub struct KnnHeap {
    k: usize,
    /// Candidates are the first `len`; beyond them there is always room for a leaf.
    d2: Vec<f32>,
    slots: Vec<u32>,
    len: usize,
    /// Only points nearer than this can still be among the k nearest.
    bound: f32,
    /// The number of candidates at which to look for a better bound.
    full: usize,
    /// Where a search starts from: what bound would have been enough for the last one, and some more, for queries mostly
    /// follow each other closely. It changes no result, nor its order.
    enough: f32,
}

impl KnnHeap {
    /// For the `k` nearest.
    pub fn new(k: usize) -> KnnHeap {
        let room = (3 * k + 2 * LEAF).next_multiple_of(LANES);
        KnnHeap {
            k,
            d2: vec![0.0; room],
            slots: vec![0; room],
            len: 0,
            bound: 0.0,
            full: 0,
            enough: f32::INFINITY,
        }
    }

    /// How many were found.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether none was found.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether as many were found as asked for.
    pub fn is_full(&self) -> bool {
        self.len == self.k
    }

    /// The slots found and their distances², in no particular order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, f32)> + '_ {
        self.slots[..self.len].iter().copied().zip(self.d2[..self.len].iter().copied())
    }

    /// The greatest distance² among the points found, or 0.
    pub fn max_dist2(&self) -> f32 {
        max(&self.d2[..self.len])
    }

    /// Keeps those that `keep(slot, distance²)`.
    pub fn retain(&mut self, keep: impl Fn(u32, f32) -> bool) {
        let mut n = 0;
        for i in 0..self.len {
            (self.slots[n], self.d2[n]) = (self.slots[i], self.d2[i]);
            n += usize::from(keep(self.slots[n], self.d2[n]));
        }
        self.len = n;
    }

    fn clear(&mut self, bound: f32) {
        self.len = 0;
        self.bound = bound;
        self.full = self.k;
    }

    /// Takes the points of a leaf in `mask` that are accepted; returns the new bound.
    #[inline(always)]
    fn add(
        &mut self,
        first: u32,
        mut mask: Mask,
        d2: &[f32; LEAF],
        accept: &mut impl FnMut(u32, f32) -> bool,
    ) -> f32 {
        if self.k <= SMALL_K {
            return self.insert(first, mask, d2, accept);
        }
        let room = self.len..self.len + LEAF;
        if let (Some(out_d2), Some(out_slots)) = (self.d2.get_mut(room.clone()), self.slots.get_mut(room)) {
            let mut n = 0;
            while mask != 0 {
                let k = mask.trailing_zeros();
                mask &= mask - 1;
                let (slot, d2) = (first + k, d2[k as usize % LEAF]);
                out_d2[n % LEAF] = d2;
                out_slots[n % LEAF] = slot;
                n += accept(slot, d2) as usize;
            }
            self.len += n;
            if self.len >= self.full {
                self.tighten();
            }
        }
        self.bound
    }

    /// Sorted insertion, for small k.
    #[inline(always)]
    fn insert(
        &mut self,
        first: u32,
        mut mask: Mask,
        d2: &[f32; LEAF],
        accept: &mut impl FnMut(u32, f32) -> bool,
    ) -> f32 {
        if self.k == 1 && mask != 0 {
            // The nearest first: unless it is refused, it is all.
            let k = least(d2);
            let (slot, d2) = (first + k as u32, d2[k]);
            if accept(slot, d2) {
                self.d2[0] = d2;
                self.slots[0] = slot;
                self.len = 1;
                self.bound = d2;
                return d2;
            }
            mask &= !(1 << k);
        }
        while mask != 0 {
            let k = mask.trailing_zeros();
            mask &= mask - 1;
            let (slot, d2) = (first + k, d2[k as usize % LEAF]);
            if d2 < self.bound && accept(slot, d2) {
                let mut i = self.len.min(self.k - 1);
                while i > 0 && self.d2[i - 1] > d2 {
                    self.d2[i] = self.d2[i - 1];
                    self.slots[i] = self.slots[i - 1];
                    i -= 1;
                }
                self.d2[i] = d2;
                self.slots[i] = slot;
                self.len = (self.len + 1).min(self.k);
                if self.len == self.k {
                    self.bound = self.d2[self.k - 1];
                }
            }
        }
        self.bound
    }

    /// Lowers the bound, and drops candidates if room for a leaf needs it.
    #[inline(never)]
    fn tighten(&mut self) {
        let ((lo, hi), _) = self.threshold(self.k / 8);
        // With k candidates up to lo, more ties there are of no use.
        self.bound = f32::from_bits(if hi - lo > 1 { hi } else { lo });
        self.full = self.len + self.k / 4;
        if self.full + LEAF > self.d2.len() {
            self.select();
            self.full = self.len + self.k / 4;
        }
    }

    fn finish(&mut self) {
        if self.len > self.k {
            self.select();
        }
        if self.k > SMALL_K {
            self.enough = if self.is_full() { MARGIN * self.max_dist2() } else { f32::INFINITY };
        }
    }

    /// Keeps the k nearest of more than k candidates.
    fn select(&mut self) {
        let ((lo, hi), n_lo) = self.threshold(0);
        // Either k candidates are below hi, or hi follows lo and the rest is as far as lo.
        let (lo, hi) = (f32::from_bits(lo), f32::from_bits(hi));
        let mut n_ties = 0;
        let mut n = 0;
        for i in 0..self.len {
            let (d2, slot) = (self.d2[i], self.slots[i]);
            self.d2[n] = d2;
            self.slots[n] = slot;
            n += (d2 < hi) as usize;
        }
        self.len = n;
        if n > self.k {
            n = 0;
            for i in 0..self.len {
                let (d2, slot) = (self.d2[i], self.slots[i]);
                self.d2[n] = d2;
                self.slots[n] = slot;
                let tie = d2 == lo;
                n += (!tie || n_lo + n_ties < self.k) as usize;
                n_ties += tie as usize;
            }
            self.len = n;
        }
    }

    /// Finds bits (lo, hi) of distances² with fewer than k candidates below lo, and at least k but at most k + slack
    /// below hi, unless ties prevent that: then hi is next to lo. Also the number below lo. There must be k candidates.
    fn threshold(&mut self, slack: usize) -> ((u32, u32), usize) {
        let end = self.len.next_multiple_of(LANES);
        self.d2[self.len..end].fill(f32::NAN);
        let d2 = &self.d2[..end];
        let (mut lo, mut n_lo) = (0u32, 0);
        let (mut hi, mut n_hi) = if self.bound < f32::INFINITY {
            // There may be ties at the bound.
            let hi = self.bound.to_bits() + 1;
            (hi, count_below(d2, f32::from_bits(hi)))
        } else {
            (max(&self.d2[..self.len]).to_bits() + 1, self.len)
        };
        let mut interpolate = 3;
        while n_hi > self.k + slack && hi - lo > 1 {
            // On a surface, counts are about proportional to distance².
            let t = if interpolate > 0 {
                interpolate -= 1;
                let (a, b) = (f32::from_bits(lo), f32::from_bits(hi));
                let x = (self.k - n_lo) as f32 + 0.5 * slack as f32 + 0.25;
                (a + (b - a) * x / (n_hi - n_lo) as f32).to_bits().clamp(lo + 1, hi - 1)
            } else {
                interpolate = 2;
                lo + (hi - lo) / 2
            };
            let n = count_below(d2, f32::from_bits(t));
            if n < self.k {
                (lo, n_lo) = (t, n);
            } else {
                (hi, n_hi) = (t, n);
            }
        }
        ((lo, hi), n_lo)
    }
}

/// The index of the least number.
fn least(d2: &[f32; LEAF]) -> usize {
    let d2: &[Vec4; LEAF_BLOCKS] = bytemuck::cast_ref(d2);
    // In this order, `min` passes NaN over.
    let min = d2.iter().fold(Vec4::INFINITY, |min, d| d.min(min)).min_element();
    let mut at: Mask = 0;
    for (b, d) in d2.iter().enumerate() {
        at |= (d.cmple(Vec4::splat(min)).bitmask() as Mask) << (BLOCK * b);
    }
    at.trailing_zeros() as usize % LEAF
}

/// How many numbers are below `t`; the length is a multiple of [`LANES`].
fn count_below(d2: &[f32], t: f32) -> usize {
    // In f32, which counts these few exactly, and by hand: left to the compiler, lanes are shuffled about.
    let mut n = [Vec4::ZERO; 2];
    for lanes in d2.chunks_exact(LANES) {
        for (n, d2) in n.iter_mut().zip(lanes.chunks_exact(4)) {
            *n += Vec4::select(Vec4::from_slice(d2).cmplt(Vec4::splat(t)), Vec4::ONE, Vec4::ZERO);
        }
    }
    (n[0] + n[1]).element_sum() as usize
}

/// The greatest of non-negative numbers, or 0.
fn max(d2: &[f32]) -> f32 {
    let lanes = d2.chunks_exact(4);
    let rest = lanes.remainder().iter().fold(0.0, |m: f32, &d2| m.max(d2));
    lanes.fold(Vec4::splat(rest), |m, d2| m.max(Vec4::from_slice(d2))).max_element()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(points: &[Vec3], p: Vec3) -> Vec<f32> {
        let mut d2: Vec<f32> = points.iter().map(|&q| length2((q - p).to_array())).collect();
        d2.sort_by(f32::total_cmp);
        d2
    }

    /// Every search against brute force, bit by bit; `k` and `r` are tried at `p`.
    fn check(points: &[Vec3], p: Vec3, k: usize, r: f32) {
        let (tree, order) = KdTree::build(points);
        assert_eq!(tree.len(), points.len());
        let mut seen = order.clone();
        seen.sort_unstable();
        assert!(seen.iter().copied().eq(0..points.len() as u32), "order is no permutation");
        for (slot, &i) in order.iter().enumerate() {
            assert_eq!(tree.position(slot as u32), points[i as usize]);
        }
        let expected: Vec<f32> = brute(points, p).into_iter().filter(|&d2| d2 <= r * r).collect();
        let sorted = |found: &[(u32, f32)]| {
            let mut slots: Vec<u32> = found.iter().map(|f| f.0).collect();
            slots.sort_unstable();
            slots.dedup();
            assert_eq!(slots.len(), found.len(), "a slot was found twice");
            let mut d2: Vec<f32> = found.iter().map(|f| f.1).collect();
            d2.sort_by(f32::total_cmp);
            for &(slot, d2) in found {
                assert_eq!(d2, length2((tree.position(slot) - p).to_array()));
            }
            d2
        };
        let mut found = Vec::new();
        tree.within(p, r, |slot, d2| found.push((slot, d2)));
        assert_eq!(sorted(&found), expected);

        let mut heap = KnnHeap::new(k);
        for _ in 0..2 {
            tree.nearest(p, r, &mut heap);
            let found: Vec<_> = heap.iter().collect();
            let nearest = &expected[..k.min(expected.len())];
            assert_eq!(sorted(&found), nearest);
            assert_eq!(heap.len(), nearest.len());
            assert_eq!(heap.is_full(), nearest.len() == k);
            assert_eq!(heap.max_dist2(), nearest.last().copied().unwrap_or(0.0));
        }

        let even = |slot: u32| order[slot as usize] % 2 == 0;
        let half: Vec<Vec3> = points.iter().copied().step_by(2).collect();
        let expected: Vec<f32> = brute(&half, p).into_iter().filter(|&d2| d2 <= r * r).take(k).collect();
        tree.nearest_filtered(p, r, &mut heap, |slot, d2| {
            assert!(d2 <= r * r);
            even(slot)
        });
        let found: Vec<_> = heap.iter().collect();
        assert!(found.iter().all(|&(slot, _)| even(slot)));
        assert_eq!(sorted(&found), expected);
    }

    fn coordinate() -> impl Strategy<Value = f32> + Clone {
        prop_oneof![4 => -1.0f32..1.0, 1 => -1e-3f32..1e-3, 1 => Just(0.0), 1 => -1e6f32..1e6]
    }

    fn vec3(x: impl Strategy<Value = f32> + Clone) -> impl Strategy<Value = Vec3> {
        (x.clone(), x.clone(), x).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    /// A point set, and a strategy for where to search it: near a random point, or at one of the set.
    fn points() -> impl Strategy<Value = Vec<Vec3>> {
        let random = || prop::collection::vec(vec3(coordinate()), 0..1500);
        // Ties: a coarse grid, duplicates, a line and a plane, axis-parallel or not.
        let grid = prop::collection::vec(vec3((-4..4i32).prop_map(|i| i as f32)), 0..1500);
        let duplicates = (vec3(coordinate()), 0..700usize).prop_map(|(p, n)| vec![p; n]);
        let line = (vec3(-1.0f32..1.0), prop::collection::vec(-1.0f32..1.0, 0..700))
            .prop_map(|(d, t)| t.iter().map(|&t| d * t).collect());
        let flat = (random(), vec3(prop_oneof![Just(0.0f32), -1.0f32..1.0])).prop_map(|(ps, d)| {
            ps.iter().map(|p| Vec3::new(p.x, p.y, p.x * d.x + p.y * d.y + d.z)).collect()
        });
        let few = (random(), vec3(coordinate()), 1..9usize).prop_map(|(ps, q, n)| {
            ps.iter().enumerate().map(|(i, &p)| if i % n == 0 { p } else { q }).collect()
        });
        prop_oneof![random(), grid, duplicates, line, flat, few]
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 400,
            failure_persistence: None,
            rng_algorithm: prop::test_runner::RngAlgorithm::ChaCha,
            ..ProptestConfig::default()
        })]

        #[test]
        fn searches_agree_with_brute_force(
            points in points(),
            at in any::<prop::sample::Index>(),
            offset in vec3(prop_oneof![Just(0.0f32), -0.1f32..0.1, -2.0f32..2.0, (-4..4i32).prop_map(|i| i as f32)]),
            k in prop_oneof![0..12usize, 12..80usize, 80..2000usize],
            r in prop_oneof![Just(f32::INFINITY), Just(0.0f32), Just(1.0f32), 0.0f32..2.0, 0.0f32..0.2],
        ) {
            let p = offset + if points.is_empty() { Vec3::ZERO } else { points[at.index(points.len())] };
            check(&points, p, k, r);
        }
    }

    #[test]
    fn small_and_empty() {
        for n in 0..200 {
            let points: Vec<Vec3> =
                (0..n).map(|i| Vec3::new((i * 7 % 31) as f32, (i * 5 % 17) as f32, 0.5)).collect();
            for k in [0, 1, 5, 9, 50, 300] {
                check(&points, Vec3::new(3.0, 4.0, 1.0), k, f32::INFINITY);
                check(&points, Vec3::new(3.0, 4.0, 0.5), k, 5.0);
            }
        }
    }

    /// Points on a grid of 128³: ties in every coordinate, and duplicates.
    fn many(n: u32) -> Vec<Vec3> {
        let coordinate =
            |i: u32, salt: u32| ((i ^ salt).wrapping_mul(0x9e37_79b9).rotate_left(salt) >> 25) as f32;
        (0..n).map(|i| Vec3::new(coordinate(i, 1), coordinate(i, 6), coordinate(i, 11))).collect()
    }

    #[test]
    fn build_does_not_depend_on_threads() {
        let points = many(100_000);
        let build = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (tree, order) = pool.install(|| KdTree::build(&points));
            (order, tree.planes, tree.axes)
        };
        let one = build(1);
        for threads in [2, 3] {
            assert!(build(threads) == one);
        }
    }

    #[test]
    fn large_trees_agree_with_brute_force() {
        let points = many(50_000);
        for (i, k) in [1, 7, 50, 500, 40_000].into_iter().enumerate() {
            check(&points, points[i] + Vec3::new(0.0, 0.3, i as f32), k, f32::INFINITY);
            check(&points, points[i], k, 3.0);
        }
    }

    /// Not even in order, on which sums of floats depend, and threads have searched elsewhere before.
    #[test]
    fn searches_do_not_depend_on_earlier_ones() {
        let points = many(50_000);
        let (tree, _) = KdTree::build(&points);
        let mut used = KnnHeap::new(30);
        for i in 0..2000 {
            // Close by mostly, at times far off, or where there is nothing.
            let p = points[i / 50] * [1.0, 1.0, 1.0, 3.0][i % 4] + Vec3::new(0.1, 0.7 * (i % 7) as f32, 0.3);
            let r = [f32::INFINITY, 8.0, 2.0][i % 3];
            let mut fresh = KnnHeap::new(30);
            tree.nearest(p, r, &mut fresh);
            tree.nearest(p, r, &mut used);
            assert!(used.iter().eq(fresh.iter()), "{p} {r}");
        }
    }

    #[test]
    fn duplicates_are_not_all_visited() {
        let (tree, _) = KdTree::build(&vec![Vec3::ONE; 100_000]);
        for k in [1, 5, 50] {
            let mut heap = KnnHeap::new(k);
            for p in [Vec3::ONE, Vec3::ZERO] {
                let mut asked = 0;
                tree.nearest_filtered(p, f32::INFINITY, &mut heap, |_, _| {
                    asked += 1;
                    true
                });
                assert!(heap.is_full() && asked <= 2 * LEAF, "{k} of {asked}");
            }
        }
    }

    #[test]
    fn odd_numbers_do_no_harm() {
        let mut points = many(5_000);
        for (i, p) in points.iter_mut().enumerate() {
            match i % 9 {
                0 => p.x = f32::NAN,
                1 => p.y = f32::INFINITY,
                2 => p.z = f32::NEG_INFINITY,
                3 => *p = Vec3::splat(-f32::NAN),
                _ => {}
            }
        }
        let (tree, order) = KdTree::build_any(points.len(), |i| points[i]);
        assert_eq!(order.len(), points.len());
        let mut heap = KnnHeap::new(20);
        for p in points.iter().chain(&[Vec3::splat(f32::MAX), Vec3::splat(f32::INFINITY)]).take(500) {
            tree.nearest(*p, f32::INFINITY, &mut heap);
            assert!(heap.len() <= 20);
            tree.within(*p, 1.0, |slot, _| assert!(slot < 5_000));
            tree.within(*p, f32::NAN, |_, _| unreachable!());
        }
    }

    /// A ball of that radius holds all of a leaf, and of evenly spread points not many more.
    #[test]
    fn a_leaf_radius_holds_a_leaf() {
        for n in [0usize, 1, 5, 64, 65, 1000, 20_000] {
            let point = |i: usize| {
                let mut u = crate::math::Sampler::new(5, crate::math::Stream::Eye, n as u64, i as u64);
                u.next_2d().extend(0.0)
            };
            let (tree, _) = KdTree::build_by(n, point);
            for query in (0..50).map(|i| point(n + i)) {
                let mut count = 0;
                tree.within(query, 1.001 * tree.leaf_radius(query), |_, _| count += 1);
                assert!(count >= n.min(LEAF / 2) && count <= 12 * LEAF, "{n}: {count}");
            }
        }
    }
}
