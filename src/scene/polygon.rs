//! Polygons as triangles.
//!
//! Readers store a polygon of n corners as a fan of n − 2 triangles around its first corner, which is right if all of it is
//! seen from there, as of every convex one. [`Fans::fit`] finds those that are not, and cuts their ears instead (Meisters
//! 1975, "Polygons Have Ears"). Their number stays, so what belongs to triangles by number stays in place.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Which triangles of a mesh are fans.
#[derive(Debug, Default)]
pub(super) struct Fans(Vec<Run>);

/// Fans of equal size that follow each other.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// The first triangle.
    start: usize,
    corners: usize,
    /// How many fans.
    count: usize,
}

impl Fans {
    /// Adds `count` fans that begin at the triangle `start`.
    pub(super) fn push(&mut self, start: usize, corners: usize, count: usize) {
        match self.0.last_mut() {
            _ if corners <= 3 => {}
            Some(last) if last.corners == corners && last.end() == start => last.count += count,
            _ => self.0.push(Run { start, corners, count }),
        }
    }

    /// Adds those of triangles that are put behind `start` others.
    pub(super) fn append(&mut self, fans: Fans, start: usize) {
        fans.0.into_iter().for_each(|f| self.push(start + f.start, f.corners, f.count));
    }

    /// Makes triangles of each polygon that cover it: they have its orientation, and none overlap, unless it crosses
    /// itself. A polygon of which a corner has no position is left alone.
    pub(super) fn fit<C: Copy + Send + Sync>(
        &self,
        triangles: &mut [[C; 3]],
        position: impl Fn(C) -> Option<Vec3> + Sync,
    ) {
        // Fans that one thread takes at a time.
        const CHUNK: usize = 1 << 10;
        let mut rest = triangles;
        let mut at = 0;
        let mut tasks = Vec::new();
        for run in &self.0 {
            let (_, after) = std::mem::take(&mut rest).split_at_mut(run.start - at);
            let (fans, after) = after.split_at_mut(run.end() - run.start);
            (rest, at) = (after, run.end());
            tasks.extend(fans.chunks_mut(run.size() * CHUNK).map(|fans| (fans, run.size())));
        }
        tasks.into_par_iter().for_each_init(Room::default, |room, (fans, size)| {
            fans.chunks_mut(size).for_each(|fan| room.fit(fan, &position));
        });
    }
}

impl Run {
    /// Triangles of a fan.
    fn size(&self) -> usize {
        self.corners - 2
    }

    fn end(&self) -> usize {
        self.start + self.count * self.size()
    }
}

/// Room to work in.
#[derive(Default)]
struct Room {
    points: Vec<DVec3>,
    ears: Vec<[usize; 3]>,
}

impl Room {
    fn fit<C: Copy>(&mut self, fan: &mut [[C; 3]], position: &impl Fn(C) -> Option<Vec3>) {
        self.points.clear();
        self.points.extend(corners(fan).map_while(position).map(|p| p.as_dvec3()));
        if self.points.len() < fan.len() + 2 || fan_fits(&self.points) {
            return;
        }
        let corners: Vec<C> = corners(fan).collect();
        self.ears.clear();
        Ring::new(flatten(&self.points).collect()).cut(&mut self.ears);
        for (triangle, ear) in fan.iter_mut().zip(&self.ears) {
            *triangle = ear.map(|i| corners[i]);
        }
    }
}

/// The polygon that a fan is of.
fn corners<C: Copy>(fan: &[[C; 3]]) -> impl Iterator<Item = C> {
    fan[0][..2].iter().copied().chain(fan.iter().map(|t| t[2]))
}

/// Twice the vector area.
fn area_vector(points: &[DVec3]) -> DVec3 {
    fan(points).sum()
}

/// Twice the vector areas of a fan's triangles.
fn fan(points: &[DVec3]) -> impl Iterator<Item = DVec3> {
    let origin = points[0];
    points[1..].windows(2).map(move |w| (w[0] - origin).cross(w[1] - origin))
}

/// Whether none of a fan's triangles has the opposite orientation of the polygon.
fn fan_fits(points: &[DVec3]) -> bool {
    let normal = area_vector(points);
    fan(points).all(|n| n.dot(normal) >= 0.0)
}

/// The polygon seen against its normal, but for a linear map: counter-clockwise. Exact where an axis is the normal.
fn flatten(points: &[DVec3]) -> impl Iterator<Item = DVec2> {
    let (origin, normal) = (points[0], area_vector(points));
    let size = normal.abs();
    let axis = if size.x > size.y.max(size.z) {
        0
    } else if size.y > size.z {
        1
    } else {
        2
    };
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let (x, y) = if normal[axis] < 0.0 { (y, x) } else { (x, y) };
    points.iter().map(move |p| {
        let p = *p - origin;
        // Along the normal to the plane where that axis is 0.
        let p = p - normal * (p[axis] / normal[axis]);
        DVec2::new(p[x], p[y])
    })
}

/// Twice the area of a triangle, positive if it is counter-clockwise.
fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// A polygon of which ears are cut off, counter-clockwise.
struct Ring {
    points: Vec<DVec2>,
    next: Vec<usize>,
    previous: Vec<usize>,
    /// Whether a corner has been cut off.
    is_cut: Vec<bool>,
    boxes: Boxes,
}

impl Ring {
    fn new(points: Vec<DVec2>) -> Ring {
        let n = points.len();
        Ring {
            next: (1..n).chain([0]).collect(),
            previous: [n - 1].into_iter().chain(0..n - 1).collect(),
            is_cut: vec![false; n],
            boxes: Boxes::new(&points),
            points,
        }
    }

    /// Adds triangles that cover the polygon, two fewer than it has corners.
    fn cut(mut self, ears: &mut Vec<[usize; 3]>) {
        let n = self.points.len();
        let mut left = n;
        let mut candidates: VecDeque<usize> = (0..n).collect();
        // Whether a corner is an ear changes with its neighbours alone, but for corners that touch others' edges: all are
        // tried again, not for ever.
        let mut tries = 16 * n;
        let mut left_before = n + 1;
        let mut corner = 0;
        while left > 2 {
            let ear = match candidates.pop_front() {
                Some(i) if self.is_cut[i] => continue,
                Some(i) => {
                    tries = tries.saturating_sub(1);
                    if !self.is_ear(i) {
                        continue;
                    }
                    i
                }
                None if tries > 0 && left < left_before => {
                    left_before = left;
                    candidates.extend((0..n).filter(|&i| !self.is_cut[i]));
                    continue;
                }
                // The polygon crosses itself.
                None => self.convex(corner, left),
            };
            let (before, after) = (self.previous[ear], self.next[ear]);
            ears.push([before, ear, after]);
            (self.next[before], self.previous[after]) = (after, before);
            self.is_cut[ear] = true;
            self.boxes.remove(ear);
            candidates.extend([before, after]);
            (corner, left) = (after, left - 1);
        }
    }

    /// A corner, at or after `corner`, where the polygon turns left; `corner` if there is none.
    fn convex(&self, corner: usize, left: usize) -> usize {
        let mut i = corner;
        for _ in 0..left {
            if area(self.points[self.previous[i]], self.points[i], self.points[self.next[i]]) > 0.0 {
                return i;
            }
            i = self.next[i];
        }
        corner
    }

    /// Whether a corner can be cut off: it holds no other, or has no area.
    fn is_ear(&self, i: usize) -> bool {
        let ear @ [a, b, c] = [self.previous[i], i, self.next[i]].map(|i| self.points[i]);
        let area = area(a, b, c);
        // Two corners in one place, or a way there and back.
        if area == 0.0 && (b == c || (a - b).dot(c - b) > 0.0) {
            return true;
        }
        area > 0.0 && !self.boxes.any(&ear, |other| self.is_in_the_way(other, &ear))
    }

    /// Whether a corner lies in an ear, its outline included. One that lies on a corner of the ear does if the polygon goes
    /// on into the ear from there.
    fn is_in_the_way(&self, other: usize, &[a, b, c]: &[DVec2; 3]) -> bool {
        let p = self.points[other];
        if p == a || p == c {
            return false;
        }
        let is_within = |p| area(a, b, p) > 0.0 && area(b, c, p) > 0.0;
        if p == b {
            return [self.previous[other], self.next[other]].iter().any(|&i| is_within(self.points[i]));
        }
        area(a, b, p) >= 0.0 && area(b, c, p) >= 0.0 && area(c, a, p) >= 0.0
    }
}

/// Boxes around points, as a binary tree: those of node i are its children 2i and 2i + 1.
struct Boxes {
    nodes: Vec<[DVec2; 2]>,
    /// The points that leaves are of.
    points: Vec<usize>,
    leaf_of: Vec<usize>,
}

impl Boxes {
    const EMPTY: [DVec2; 2] = [DVec2::INFINITY, DVec2::NEG_INFINITY];

    fn new(points: &[DVec2]) -> Boxes {
        let n = points.len();
        let leaves = n.next_power_of_two();
        let mut order: Vec<usize> = (0..n).collect();
        Boxes::arrange(&mut order, points, leaves);
        let mut boxes = Boxes { nodes: vec![Boxes::EMPTY; 2 * leaves], points: order, leaf_of: vec![0; n] };
        for (leaf, &point) in (leaves..).zip(&boxes.points) {
            boxes.nodes[leaf] = [points[point]; 2];
            boxes.leaf_of[point] = leaf;
        }
        (1..leaves).rev().for_each(|i| boxes.update(i));
        boxes
    }

    /// Brings together, in each half of so many leaves, what is close to each other.
    fn arrange(order: &mut [usize], points: &[DVec2], leaves: usize) {
        let half = leaves / 2;
        if order.len() > half && half > 0 {
            let (low, high) = order.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), &i| {
                (low.min(points[i]), high.max(points[i]))
            });
            let axis = usize::from((high - low).y > (high - low).x);
            order.select_nth_unstable_by(half, |&i, &j| points[i][axis].total_cmp(&points[j][axis]));
            Boxes::arrange(&mut order[half..], points, half);
            Boxes::arrange(&mut order[..half], points, half);
        } else if half > 0 {
            Boxes::arrange(order, points, half);
        }
    }

    fn update(&mut self, i: usize) {
        let [a, b] = [self.nodes[2 * i], self.nodes[2 * i + 1]];
        self.nodes[i] = [a[0].min(b[0]), a[1].max(b[1])];
    }

    fn remove(&mut self, point: usize) {
        let mut i = self.leaf_of[point];
        self.nodes[i] = Boxes::EMPTY;
        while i > 1 {
            i /= 2;
            self.update(i);
        }
    }

    /// Whether `f` is true of any point whose box touches the triangle.
    fn any(&self, triangle: &[DVec2; 3], f: impl Fn(usize) -> bool) -> bool {
        let leaves = self.nodes.len() / 2;
        // Depth first.
        let mut i = 1;
        loop {
            let touches = touches(&self.nodes[i], triangle);
            if touches && i < leaves {
                i *= 2;
                continue;
            }
            if touches && f(self.points[i - leaves]) {
                return true;
            }
            // Up from right children, over to the right from a left one.
            i >>= i.trailing_ones();
            if i == 0 {
                return false;
            }
            i += 1;
        }
    }
}

/// Whether a box may share a point with a counter-clockwise triangle.
fn touches([min, max]: &[DVec2; 2], &[a, b, c]: &[DVec2; 3]) -> bool {
    // Rounding is monotone: what a box misses, its points miss.
    let is_beyond = |from: DVec2, to: DVec2| {
        let x = if to.y < from.y { max.x } else { min.x };
        let y = if to.x > from.x { max.y } else { min.y };
        area(from, to, DVec2::new(x, y)) < 0.0
    };
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    min.cmple(high).all() && max.cmpge(low).all() && !is_beyond(a, b) && !is_beyond(b, c) && !is_beyond(c, a)
}
