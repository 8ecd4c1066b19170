//! Where facets pass through each other: no light on a floor crosses the wall that stands in it, and what of the floor lies
//! behind the wall may see none. So each is parted along the line where they meet. The line is taken to go on to the facet's
//! edges; where the wall ends before, estimates near the line use the photons of one side only, which is as good, if noisier.

use super::Bounds;
use super::facet::{Edge, Facet};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A line must run along this share of a facet, lest every leg of a table part the floor.
const SHARE: f32 = 0.25;
/// Points along a line that are tried.
const POINTS: usize = 32;
/// Lengths below this share of a facet's size are none.
const TINY: f32 = 1e-3;
/// Facets are parted into so many at most.
const MAX_PARTS: usize = 16;

/// The line along which a facet is parted, and the indices of the facets to its left and right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Parting {
    line: Edge,
    sides: [u32; 2],
}

impl Parting {
    /// The facet on the side of `p`.
    pub(super) fn side(&self, p: Vec2) -> u32 {
        self.sides[(height(self.line, p) < 0.0) as usize]
    }
}

/// How far `p` lies to the left of a line.
fn height([a, b]: Edge, p: Vec2) -> f32 {
    (b - a).normalize_or_zero().perp_dot(p - a)
}

/// Parts all facets along the lines where others pass through them, or end on them.
pub(super) fn part_all(facets: &mut Vec<Facet>) {
    let bounds: Vec<Bounds> = facets.iter().map(bounds).collect();
    let near = |a: &Bounds, b: &Bounds| a.min.cmple(b.max).all() && b.min.cmple(a.max).all();
    let lines = |i: usize| -> Vec<Edge> {
        (0..facets.len())
            .filter(|&j| j != i && near(&bounds[i], &bounds[j]))
            .filter_map(|j| meeting(&facets[i], &facets[j]))
            .collect()
    };
    let lines: Vec<Vec<Edge>> = (0..facets.len()).into_par_iter().map(lines).collect();
    for (i, lines) in lines.into_iter().enumerate() {
        let mut parts = 1;
        lines.into_iter().for_each(|line| part(facets, i, line, &mut parts));
    }
}

/// Around a facet, and what rounding makes of it.
fn bounds(facet: &Facet) -> Bounds {
    let Bounds { min, max } = facet.corners().fold(Bounds::EMPTY, Bounds::grow);
    let pad = Vec3::splat(rounding(facet));
    Bounds { min: min - pad, max: max + pad }
}

/// By how much corners may be off.
fn rounding(facet: &Facet) -> f32 {
    8.0 * f32::EPSILON * facet.corners().map(|p| p.abs().max_element()).fold(0.0, f32::max)
}

fn part(facets: &mut Vec<Facet>, i: usize, line: Edge, parts: &mut usize) {
    if let Some(Parting { sides, .. }) = facets[i].parting {
        sides.iter().for_each(|&side| part(facets, side as usize, line, parts));
        return;
    }
    if *parts >= MAX_PARTS {
        return;
    }
    if let Some(sides) = split(&facets[i], line) {
        let first = facets.len() as u32;
        facets[i].parting = Some(Parting { line, sides: [first, first + 1] });
        facets.extend(sides);
        *parts += 1;
    }
}

/// The facets left and right of a line, unless it leaves nothing on one side.
fn split(facet: &Facet, line: Edge) -> Option<[Facet; 2]> {
    let [a, b] = line;
    let along = (b - a).normalize_or_zero();
    let tiny = TINY * size(facet);
    let (mut least, mut most) = (0.0f32, 0.0f32);
    let mut sides = [Vec::new(), Vec::new()];
    let mut crossings = Vec::new();
    for &[p, q] in facet.edges() {
        let (hp, hq) = (height(line, p), height(line, q));
        (least, most) = (least.min(hp), most.max(hp));
        let (of_p, of_q) = ((hp < 0.0) as usize, (hq < 0.0) as usize);
        if of_p == of_q {
            sides[of_p].push([p, q]);
        } else {
            let x = p + (q - p) * (hp / (hp - hq));
            sides[of_p].push([p, x]);
            sides[of_q].push([x, q]);
            crossings.push(x);
        }
    }
    if least > -tiny || most < tiny || crossings.len() % 2 == 1 {
        return None;
    }
    // Between each two crossings the line runs inside.
    crossings.sort_by(|x, y| along.dot(*x - a).total_cmp(&along.dot(*y - a)));
    for inside in crossings.chunks_exact(2) {
        sides[0].push([inside[0], inside[1]]);
        sides[1].push([inside[1], inside[0]]);
    }
    Some(sides.map(|edges| facet.with_edges(edges)))
}

/// The line along which `wall` meets `floor`, if light on both sides of it would otherwise be taken for one.
fn meeting(floor: &Facet, wall: &Facet) -> Option<Edge> {
    let normal = floor.normal();
    if normal.dot(wall.normal()).abs() > 0.99 {
        return None;
    }
    let rounding = rounding(wall).max(rounding(floor));
    let over = |p: Vec3| (p - floor.origin()).dot(normal);
    // Where the wall's outline meets the floor's plane.
    let mut met = Vec::new();
    for &edge in wall.edges() {
        let [p, q] = edge.map(|p| wall.point(p));
        let (hp, hq) = (over(p), over(q));
        if hp.abs() <= rounding {
            met.push(p);
        } else if hq.abs() > rounding && (hp < 0.0) != (hq < 0.0) {
            met.push(p + (q - p) * (hp / (hp - hq)));
        }
    }
    let met: Vec<Vec2> = met.into_iter().map(|p| floor.project(p)).collect();
    let (&first, rest) = met.split_first()?;
    let far = |from: Vec2| met.iter().copied().max_by(|p, q| from.distance(*p).total_cmp(&from.distance(*q)));
    let a = far(first).filter(|_| !rest.is_empty())?;
    let b = far(a)?;
    let along = (b - a).normalize_or_zero();
    let across = along.perp() * (TINY * size(floor));
    // Along an edge of the floor, or of a hole, it ends anyway.
    let parts = |i: usize| {
        let p = a + (b - a) * ((i as f32 + 0.5) / POINTS as f32);
        floor.contains(p + across) && floor.contains(p - across)
    };
    let share = (0..POINTS).filter(|&i| parts(i)).count() as f32 / POINTS as f32;
    (share * a.distance(b) >= SHARE * extent(floor, along) && share > 0.0).then_some([a, b])
}

/// How far a facet extends in a direction.
fn extent(facet: &Facet, direction: Vec2) -> f32 {
    let at = facet.edges().iter().map(|[p, _]| direction.dot(*p));
    let (least, most) = at.fold((f32::INFINITY, -f32::INFINITY), |(l, m), x| (l.min(x), m.max(x)));
    most - least
}

fn size(facet: &Facet) -> f32 {
    extent(facet, Vec2::X).max(extent(facet, Vec2::Y))
}

#[cfg(test)]
mod tests {
    use crate::shape::Mesh;
    use crate::shape::facet::tests::{area, facets};
    use glam::{Affine3A, Vec3};

    /// 4 by 4, facing +z.
    fn floor() -> Mesh {
        Mesh::rectangle(Affine3A::from_scale(Vec3::splat(2.0)))
    }

    /// Facing ±x, from z = `low` on, and as long as the floor times `length`.
    fn wall(x: f32, low: f32, length: f32) -> Mesh {
        let turn = Affine3A::from_rotation_y(std::f32::consts::FRAC_PI_2);
        Mesh::rectangle(
            Affine3A::from_translation(Vec3::new(x, 0.1, low + 1.0))
                * Affine3A::from_scale(Vec3::new(1.0, 2.0 * length, 1.0))
                * turn,
        )
    }

    /// Areas of the floor left and right of x = 0.5.
    fn areas(meshes: Vec<Mesh>) -> [f32; 2] {
        let facets = facets(meshes);
        [0.0, 1.0].map(|x| area(facets.at(0, 0, Vec3::new(x, 0.3, 0.0)).unwrap()))
    }

    #[test]
    fn walls_part_floors() {
        for low in [-0.5, 0.0] {
            let [left, right] = areas(vec![floor(), wall(0.5, low, 2.0)]);
            assert!((left - 10.0).abs() < 1e-4 && (right - 6.0).abs() < 1e-4, "{low}: {left} {right}");
        }
        // Above it, beside it, and as short as a leg.
        for beside in [wall(0.5, 0.1, 2.0), wall(2.5, -0.5, 2.0), wall(0.5, -0.5, 0.1)] {
            assert_eq!(areas(vec![floor(), beside]), [16.0; 2]);
        }
    }

    /// Four walls make a room within; a box that stands on the floor has its hole already.
    #[test]
    fn parts_are_parted_further() {
        let turn = Affine3A::from_rotation_z(std::f32::consts::FRAC_PI_2);
        let turned = |mesh: Mesh| Mesh {
            positions: mesh.positions.iter().map(|&p| turn.transform_point3(p)).collect(),
            ..mesh
        };
        let walls = [-1.0, 1.0].map(|x| wall(x, -0.5, 1.0));
        let walls = walls.clone().into_iter().chain(walls.map(turned));
        let facets = facets(std::iter::once(floor()).chain(walls).collect());
        let at = |x, y| facets.at(0, 1, Vec3::new(x, y, 0.0)).unwrap();
        for (x, y, expected) in [(0.0, 0.0, 4.0), (0.0, 1.5, 2.0), (1.5, 1.5, 1.0), (-1.2, 0.2, 2.0)] {
            let facet = at(x, y);
            assert!((area(facet) - expected).abs() < 1e-3, "{x} {y}: {}", area(facet));
            assert!(facet.contains(facet.project(Vec3::new(x, y, 0.0))));
        }
        let stand = Mesh::cube(Affine3A::from_translation(Vec3::Z));
        let [left, right] = areas(vec![floor(), stand]);
        assert!((left - 12.0).abs() < 1e-4 && left == right, "{left} {right}");
    }
}
