//! A static, balanced kd-tree over points: k nearest neighbours and radius search (Bentley 1975). It knows no
//! photons: [`KdTree::build`] returns the order of its slots, and payloads are permuted once into that order.
//!
//! Points lie in blocks of [`BLOCK`], coordinate by coordinate, every block full but the last: block b holds the
//! slots from `b * BLOCK`. Nodes are in heap order (children of i: 2i, 2i + 1) and hold a plane and its axis, nothing
//! else: node j of a level with 2^d nodes covers the blocks from ⌊jL/2^d⌋ to ⌊(j+1)L/2^d⌋ of all L.
//!
//! Pruning is exact: distances of points and cells round alike, so no search misses a point that brute force in
//! `f32` finds.

use glam::Vec3;

/// Points per block.
const BLOCK: usize = 8;
/// Most blocks per leaf.
const LEAF_BLOCKS: usize = 1;
/// Subtrees of fewer points are built by one thread.
const SEQUENTIAL: usize = 8192;
/// No tree is deeper: slots are `u32`.
const MAX_DEPTH: usize = 32;

#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Block([[f32; BLOCK]; 3]);

/// A balanced kd-tree.
#[derive(Clone, Debug)]
pub struct KdTree {
    len: usize,
    blocks: Vec<Block>,
    /// Planes and their axes in heap order from 1; there are 2^depth - 1.
    planes: Vec<f32>,
    axes: Vec<u8>,
}

#[derive(Clone, Copy)]
struct Item {
    c: [f32; 3],
    index: u32,
}

impl KdTree {
    /// Builds the tree over finite points, with all threads of the current rayon pool; the result does not depend on
    /// their number. Also returns the order: slot i of the tree holds `points[order[i]]`.
    ///
    /// Points that are not finite must not be passed: they will not be found, nor perhaps their neighbours.
    pub fn build(points: &[Vec3]) -> (KdTree, Vec<u32>) {
        debug_assert!(points.iter().all(|p| p.is_finite()), "points must be finite");
        Self::build_any(points)
    }

    fn build_any(points: &[Vec3]) -> (KdTree, Vec<u32>) {
        assert!(points.len() < u32::MAX as usize, "too many points");
        let mut items: Vec<Item> = Vec::with_capacity(points.len());
        items.extend(points.iter().enumerate().map(|(i, p)| Item { c: p.to_array(), index: i as u32 }));
        let n_blocks = points.len().div_ceil(BLOCK);
        let mut depth = 0;
        while n_blocks > LEAF_BLOCKS << depth {
            depth += 1;
        }
        // In order while building, so that subtrees are slices: plane m parts the leaves m - 1 and m.
        let mut nodes = vec![(0.0, 0); 1 << depth];
        split(&mut items, &mut nodes[1..], 0, n_blocks, 0, depth);
        let mut planes = vec![0.0; 1 << depth];
        let mut axes = vec![0; 1 << depth];
        for m in 1..nodes.len() {
            let i = (m | 1 << depth) >> (m.trailing_zeros() + 1);
            (planes[i], axes[i]) = nodes[m];
        }
        let blocks = items
            .chunks(BLOCK)
            .map(|chunk| {
                let mut block = Block([[f32::NAN; BLOCK]; 3]);
                for (k, item) in chunk.iter().enumerate() {
                    for a in 0..3 {
                        block.0[a][k] = item.c[a];
                    }
                }
                block
            })
            .collect();
        let order = items.iter().map(|item| item.index).collect();
        (KdTree { len: points.len(), blocks, planes, axes }, order)
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
        let Block(c) = &self.blocks[slot as usize / BLOCK];
        let k = slot as usize % BLOCK;
        Vec3::new(c[0][k], c[1][k], c[2][k])
    }

    /// Visits every point with distance² <= r² in no particular order, as `visit(slot, distance²)`.
    pub fn within(&self, p: Vec3, r: f32, mut visit: impl FnMut(u32, f32)) {
        let bound = below(r);
        self.traverse(p, bound, |first, d2| {
            for (k, &d2) in d2.iter().enumerate() {
                if d2 < bound {
                    visit(first + k as u32, d2);
                }
            }
            bound
        });
    }

    /// The nearest points, as many as `heap` takes, with distance² <= r_max². Earlier contents are discarded.
    pub fn nearest(&self, p: Vec3, r_max: f32, heap: &mut KnnHeap) {
        self.nearest_filtered(p, r_max, heap, |_, _| true);
    }

    /// Like [`KdTree::nearest`] among the points that `accept(slot, distance²)`.
    pub fn nearest_filtered(
        &self,
        p: Vec3,
        r_max: f32,
        heap: &mut KnnHeap,
        mut accept: impl FnMut(u32, f32) -> bool,
    ) {
        heap.clear(below(r_max));
        self.traverse(p, heap.bound, |first, d2| heap.add(first, d2, &mut accept));
        heap.finish();
    }

    /// Offers the blocks that may hold distances² below `bound`, near ones first. `block(first slot, distances²)`
    /// returns the new bound. Missing points of the last block are at distance NaN.
    #[inline(always)]
    fn traverse(&self, p: Vec3, mut bound: f32, mut block: impl FnMut(u32, &[f32; BLOCK]) -> f32) {
        let (n_leaves, n_blocks) = (self.planes.len(), self.blocks.len());
        let depth = n_leaves.trailing_zeros();
        let q = [p.x, p.y, p.z, 0.0];
        // The distance to a cell per axis (Arya & Mount 1993, "Algorithms for Fast Vector Quantization").
        let mut stack = [([0.0f32; 3], 0u32); MAX_DEPTH];
        let mut n = 0;
        let mut node = 1;
        let mut offset = [0.0f32; 3];
        loop {
            while node < n_leaves {
                let axis = self.axes[node];
                let d = q[axis as usize & 3] - self.planes[node];
                node = 2 * node + (d >= 0.0) as usize;
                let far = std::array::from_fn(|a| if a == axis as usize { d } else { offset[a] });
                stack[n & (MAX_DEPTH - 1)] = (far, node as u32 ^ 1);
                n += (length2(far) < bound) as usize;
            }
            let j = node as u64 - n_leaves as u64;
            let begin = (j * n_blocks as u64) >> depth;
            let end = ((j + 1) * n_blocks as u64) >> depth;
            for b in begin as usize..end as usize {
                let Block(c) = &self.blocks[b];
                let mut d2 = [0.0; BLOCK];
                for k in 0..BLOCK {
                    d2[k] = length2([c[0][k] - p.x, c[1][k] - p.y, c[2][k] - p.z]);
                }
                bound = block((b * BLOCK) as u32, &d2);
            }
            loop {
                if n == 0 {
                    return;
                }
                n -= 1;
                let next;
                (offset, next) = stack[n & (MAX_DEPTH - 1)];
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

/// Sorts the `items` of node `j` at level `level` into leaves.
fn split(items: &mut [Item], nodes: &mut [(f32, u8)], j: usize, n_blocks: usize, level: u32, depth: u32) {
    if level == depth {
        return;
    }
    let first = (j * n_blocks) >> level;
    let middle = ((2 * j + 1) * n_blocks) >> (level + 1);
    let n_left = (middle - first) * BLOCK;
    let axis = widest(items);
    let plane = if n_left < items.len() {
        let key = |item: &Item| {
            let bits = item.c[axis].to_bits();
            let order = bits ^ (((bits as i32 >> 31) as u32) | 0x8000_0000);
            (order as u64) << 32 | item.index as u64
        };
        let (_, item, _) = items.select_nth_unstable_by_key(n_left, key);
        item.c[axis]
    } else {
        f32::INFINITY
    };
    let (left, right) = items.split_at_mut(n_left.min(items.len()));
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
#[derive(Clone, Debug)]
pub struct KnnHeap {
    k: usize,
    /// Candidates: bits of distance² above the slot, so that they order by distance.
    keys: Vec<u64>,
    len: usize,
    bound: f32,
}

impl KnnHeap {
    /// For the `k` nearest.
    pub fn new(k: usize) -> KnnHeap {
        KnnHeap { k, keys: vec![0; 2 * k + 2 * BLOCK], len: 0, bound: 0.0 }
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
        self.keys[..self.len].iter().map(|&key| (key as u32, distance2(key)))
    }

    /// The greatest distance² among the points found, or 0.
    pub fn max_dist2(&self) -> f32 {
        self.keys[..self.len].iter().max().map_or(0.0, |&key| distance2(key))
    }

    fn clear(&mut self, bound: f32) {
        self.len = 0;
        self.bound = bound;
    }

    #[inline(always)]
    fn add(&mut self, first: u32, d2: &[f32; BLOCK], accept: &mut impl FnMut(u32, f32) -> bool) -> f32 {
        let Some(room) = self.keys.get_mut(self.len..self.len + BLOCK) else { return self.bound };
        let mut n = 0;
        for (k, &d2) in d2.iter().enumerate() {
            let slot = first + k as u32;
            room[n & (BLOCK - 1)] = (d2.to_bits() as u64) << 32 | slot as u64;
            n += (d2 < self.bound && accept(slot, d2)) as usize;
        }
        self.len += n;
        if self.len + BLOCK > self.keys.len() {
            self.shrink();
        }
        self.bound
    }

    fn shrink(&mut self) {
        if self.k == 0 {
            self.len = 0;
            return;
        }
        let (_, key, _) = self.keys[..self.len].select_nth_unstable(self.k - 1);
        self.bound = distance2(*key);
        self.len = self.k;
    }

    fn finish(&mut self) {
        if self.len > self.k {
            self.shrink();
        }
    }
}

fn distance2(key: u64) -> f32 {
    f32::from_bits((key >> 32) as u32)
}
