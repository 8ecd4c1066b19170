//! Aiming photons: spheres around everything that can focus light, and how to emit towards them.
//!
//! Light whose *first* hit is a sharp surface meets one of the spheres, so emission may be confined to them
//! and stays unbiased for caustics. Where spheres overlap as seen from the light, the density is the sum over
//! all that hold the ray, whichever was chosen (one-sample balance heuristic).
//!
//! Around what is seen there may be more spheres, of a higher density each: of the photons that the sky sends
//! to a plain of a kilometre, a third go to the room that the camera is in ([`Targets::learnt`]).

use crate::math::{Discrete, Frame, warp};
use crate::shape::Bounds;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: Vec3,
    radius: f32,
    /// The shape inside, if it is a single one.
    shape: Option<u32>,
    /// How densely photons are aimed at it: 1 for what bounds what has to be hit, more where less would do.
    density: f32,
}

/// Where photons are aimed; by default nowhere in particular.
#[derive(Clone, Debug, Default)]
pub struct Targets {
    /// Those that bound what has to be hit come first.
    spheres: Vec<Sphere>,
    /// How many these are.
    bounding: usize,
    /// Times density.
    by_cross_section: Discrete,
}

impl Targets {
    /// More spheres cost more per photon than they save.
    const MAX: usize = 32;
    /// Of these around what is seen.
    const MAX_SEEN: usize = 16;
    /// How small these must be, all together, relative to the others, to be worth having.
    const MUCH_SMALLER: f32 = 0.25;

    /// Spheres around the shapes with the given indices, bounds, and radii around the middle of these.
    /// Neighbours share a sphere if there are many, or if that makes the total cross-section smaller.
    pub fn new(shapes: impl Iterator<Item = (u32, Bounds, f32)>) -> Targets {
        let shapes = shapes.filter(|(_, b, _)| !b.is_empty() && b.radius().is_finite());
        let mut boxes: Vec<Group> = shapes
            .map(|(i, bounds, r)| Group { shape: Some(i), bounds, radius: r.min(bounds.radius()) })
            .collect();
        let mut groups = Vec::new();
        group(&mut boxes, Self::MAX, &mut groups);
        while let Some((i, j)) = best_merger(&groups) {
            let other = groups.swap_remove(j);
            groups[i] = merged(&groups[i], &other);
        }
        let spheres: Vec<Sphere> = groups
            .iter()
            .map(|&Group { shape, bounds: b, radius }| {
                // A margin for what rounding does to positions and directions at the rim.
                let rounding = 16.0 * f32::EPSILON * b.min.abs().max(b.max.abs()).max_element();
                Sphere { center: b.center(), radius: radius * 1.001 + rounding, shape, density: 1.0 }
            })
            .collect();
        Targets::of(spheres.len(), spheres)
    }

    fn of(bounding: usize, spheres: Vec<Sphere>) -> Targets {
        let by_cross_section = Discrete::new(spheres.iter().map(|s| s.density * s.radius * s.radius));
        Targets { spheres, bounding, by_cross_section }
    }

    /// These targets, with two thirds of all photons going to spheres around the points `seen` (in the scene
    /// of bounds `world`): to each with the same probability. `None` if these would not be much smaller.
    ///
    /// Half of them go to ever larger spheres around the middle of these points: light that comes from nearby
    /// by a detour, off the ground before a window, would be rare and blinding beside photons that are a
    /// million times as dense.
    pub fn learnt(&self, seen: &[Vec3], world: Bounds) -> Option<Targets> {
        let all = [(0, world, world.radius())];
        let whole = Targets::new(all.into_iter());
        // The one around all is the better one if the others, together, are no smaller.
        let bounding = if self.cross_section() < whole.cross_section() { self } else { &whole };
        let point = |&p: &Vec3| Group { shape: None, bounds: Bounds { min: p, max: p }, radius: 0.0 };
        let mut groups = Vec::new();
        group(&mut seen.iter().map(point).collect::<Vec<_>>(), Self::MAX_SEEN, &mut groups);
        // A margin for what lies between the points; and for many in one place.
        let least = 1e-3 * world.radius();
        let near: Vec<_> =
            groups.iter().map(|group| (group.bounds.center(), 1.1 * group.radius + least)).collect();
        let cross_section: f32 = near.iter().map(|(_, radius)| radius.powi(2)).sum();
        if near.is_empty() || cross_section > Self::MUCH_SMALLER * bounding.cross_section() {
            return None;
        }
        let center = Vec3::from_array([0, 1, 2].map(|axis| median(seen.iter().map(|p| p[axis]))));
        let middle = median(seen.iter().map(|p| p.distance(center))).max(least);
        let around = (1..).map(|i| (center, middle * 4f32.powi(i)));
        let around: Vec<_> = around.take_while(|(_, radius)| *radius < world.radius()).collect();
        let mut spheres = bounding.spheres.clone();
        for set in [near, around] {
            let share = bounding.cross_section() / set.len() as f32;
            spheres.extend(set.into_iter().map(|(center, radius)| Sphere {
                center,
                radius,
                shape: None,
                density: share / (radius * radius),
            }));
        }
        Some(Targets::of(bounding.spheres.len(), spheres))
    }

    /// Of all spheres that bound what has to be hit, over π.
    fn cross_section(&self) -> f32 {
        self.spheres[..self.bounding].iter().map(|s| s.radius * s.radius).sum()
    }

    /// Whether a sphere reaches before the plane through `p` with normal `n`, but for that of the shape
    /// `own`.
    pub(super) fn lie_before(&self, p: Vec3, n: Vec3, own: u32) -> bool {
        let reaches = |s: &Sphere| n.dot(s.center - p) > -s.radius;
        self.spheres[..self.bounding].iter().any(|s| s.shape != Some(own) && reaches(s))
    }

    /// Whether a sphere meets the cone of half-angle `cutoff` around the unit vector `axis`.
    pub(super) fn meet_cone(&self, apex: Vec3, axis: Vec3, cutoff: f32) -> bool {
        let meets = |s: &Sphere| {
            let to = s.center - apex;
            let distance = to.length();
            let to_center = axis.cross(to).length().atan2(axis.dot(to));
            distance <= s.radius || to_center - (s.radius / distance).asin() < cutoff + 1e-3
        };
        self.spheres[..self.bounding].iter().any(meets)
    }

    /// Aims from `p`, a point on the shape `own` if that cannot light itself; `None` if the spheres fill so
    /// much of the view that there is nothing to gain.
    pub(super) fn aim_from(&self, p: Vec3, own: Option<u32>) -> Option<Aim<'_>> {
        let aim = Aim { targets: self, p, own, total: 0.0 };
        let bounding = self.spheres[..self.bounding].iter().filter(|s| aim.counts(s));
        let solid_angle: f32 = bounding.map(|s| s.solid_angle(p)).sum();
        let total = aim.spheres().map(|(_, s)| s.density * s.solid_angle(p)).sum();
        (solid_angle > 0.0 && solid_angle < PI).then_some(Aim { total, ..aim })
    }

    /// A point on the plane through the origin across the unit vector `d`, so that the line through it along
    /// `d` meets a sphere; and the pdf per area. `None` if that would be no better than a disk of radius
    /// `world`.
    pub(super) fn sample_line(&self, d: Vec3, world: f32, u: Vec2) -> Option<(Vec3, f32)> {
        let is_learnt = self.bounding < self.spheres.len();
        if !is_learnt && self.cross_section() >= world * world {
            return None;
        }
        let (chosen, _, ux) = self.by_cross_section.sample(u.x)?;
        let sphere = &self.spheres[chosen];
        let frame = Frame::from_normal(d);
        let on_disk = warp::disk(Vec2::new(ux, u.y)) * sphere.radius;
        let p = sphere.center + frame.s * on_disk.x + frame.t * on_disk.y;
        let p = p - d * d.dot(p);
        let across = |v: Vec3| v - d * d.dot(v);
        // The point was sampled in one of them, whatever rounding says.
        let holds = |i: usize, s: &Sphere| {
            i == chosen || across(s.center - p).length_squared() <= s.radius * s.radius
        };
        let density: f32 =
            self.spheres.iter().enumerate().filter(|(i, s)| holds(*i, s)).map(|(_, s)| s.density).sum();
        Some((p, density / (PI * self.by_cross_section.total() as f32)))
    }
}

impl Sphere {
    /// 1 − cos of the half-angle under which the sphere is seen from `p`; 2 from inside.
    fn one_minus_cos(&self, p: Vec3) -> f32 {
        let sin2 = self.radius * self.radius / self.center.distance_squared(p);
        if sin2 < 1.0 { sin2 / (1.0 + (1.0 - sin2).sqrt()) } else { 2.0 }
    }

    fn solid_angle(&self, p: Vec3) -> f32 {
        2.0 * PI * self.one_minus_cos(p)
    }
}

/// [`Targets`] seen from a point.
pub(super) struct Aim<'a> {
    targets: &'a Targets,
    p: Vec3,
    own: Option<u32>,
    /// Of density times solid angle.
    total: f32,
}

impl<'a> Aim<'a> {
    fn counts(&self, sphere: &Sphere) -> bool {
        self.own.is_none() || sphere.shape != self.own
    }

    fn spheres(&self) -> impl Iterator<Item = (usize, &'a Sphere)> + '_ {
        self.targets.spheres.iter().enumerate().filter(|(_, s)| self.counts(s))
    }

    /// A direction towards a sphere, and its pdf_w.
    pub(super) fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let mut rest = u.x * self.total;
        let mut chosen = None;
        for (i, sphere) in self.spheres() {
            let share = sphere.density * sphere.solid_angle(self.p);
            if share > 0.0 {
                chosen = Some((i, sphere, (rest / share).clamp(0.0, 1.0 - 0.5 * f32::EPSILON)));
                if rest < share {
                    break;
                }
            }
            rest -= share;
        }
        let (chosen, sphere, ux) = chosen?;
        let cone = warp::cone(Vec2::new(ux, u.y), sphere.one_minus_cos(self.p));
        // From within there is no axis, nor need of one.
        let axis = (sphere.center - self.p).try_normalize().unwrap_or(Vec3::Z);
        let d = Frame::from_normal(axis).to_world(cone);
        Some((d, self.pdf_w(chosen, d)))
    }

    /// Of a direction that was sampled towards the sphere `chosen`, whatever rounding says.
    fn pdf_w(&self, chosen: usize, d: Vec3) -> f32 {
        let holds = |s: &Sphere| {
            // The squared sine of the angle to the axis, without cancellation.
            let to = s.center - self.p;
            let across = to.cross(d).length_squared();
            let is_inside = to.length_squared() <= s.radius * s.radius;
            is_inside || to.dot(d) > 0.0 && across <= s.radius * s.radius
        };
        let density: f32 =
            self.spheres().filter(|&(i, s)| i == chosen || holds(s)).map(|(_, s)| s.density).sum();
        density / self.total
    }
}

/// The middle one of `values`; 0 if there is none.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// What shall share a sphere.
#[derive(Clone, Copy, Debug)]
struct Group {
    /// The shape if it is a single one.
    shape: Option<u32>,
    bounds: Bounds,
    /// Of the sphere around the middle of `bounds` that holds it all.
    radius: f32,
}

fn merged(a: &Group, b: &Group) -> Group {
    let bounds = a.bounds.union(b.bounds);
    let reach = |g: &Group| bounds.center().distance(g.bounds.center()) + g.radius;
    Group { shape: None, bounds, radius: reach(a).max(reach(b)).min(bounds.radius()) }
}

/// The two groups whose merger makes the total cross-section smallest, if it makes it smaller.
fn best_merger(groups: &[Group]) -> Option<(usize, usize)> {
    let cross_section = |group: &Group| group.radius.powi(2);
    let pairs = (0..groups.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
    pairs
        .map(|(i, j)| {
            let (a, b) = (&groups[i], &groups[j]);
            (cross_section(a) + cross_section(b) - cross_section(&merged(a, b)), (i, j))
        })
        .filter(|&(gain, _)| gain > 0.0)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, pair)| pair)
}

/// Halves the boxes at the middle of the widest spread of centres until `max` groups are left; each becomes
/// the box around it.
fn group(boxes: &mut [Group], max: usize, out: &mut Vec<Group>) {
    if boxes.len() <= max {
        out.extend_from_slice(boxes);
        return;
    }
    if max == 1 {
        out.extend(boxes.iter().copied().reduce(|a, b| merged(&a, &b)));
        return;
    }
    let centers = boxes.iter().fold(Bounds::EMPTY, |a, b| a.grow(b.bounds.center()));
    let extent = centers.max - centers.min;
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
    let middle = boxes.len() / 2;
    boxes.select_nth_unstable_by(middle, |a, b| a.bounds.center()[axis].total_cmp(&b.bounds.center()[axis]));
    let (low, high) = boxes.split_at_mut(middle);
    group(low, max / 2, out);
    group(high, max - max / 2, out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Sampler, Stream};

    fn cube(center: Vec3, half: f32) -> Bounds {
        Bounds { min: center - half, max: center + half }
    }

    fn targets(boxes: Vec<Bounds>) -> Targets {
        Targets::new(boxes.into_iter().enumerate().map(|(i, b)| (i as u32, b, b.radius())))
    }

    /// ∫ over the union of the spheres' cones of 1 dω, by sampling and by brute force over all directions.
    #[test]
    fn directions_cover_the_union_with_the_stated_pdf() {
        let targets = targets(vec![
            cube(Vec3::new(3.0, 0.0, 0.0), 0.3),
            cube(Vec3::new(4.5, 0.4, 0.0), 0.4),
            cube(Vec3::new(0.0, -9.0, 1.0), 0.5),
        ]);
        let p = Vec3::new(0.1, 0.2, 0.3);
        let aim = targets.aim_from(p, None).unwrap();
        let inside = |d: Vec3| {
            let hit = |s: &Sphere| {
                let to = s.center - p;
                to.dot(d) > 0.0 && to.cross(d).length_squared() <= s.radius * s.radius
            };
            targets.spheres.iter().any(hit)
        };
        let n = 1 << 16;
        let (mut sampled, mut brute) = (0.0f64, 0.0f64);
        for i in 0..n {
            let u = Sampler::new(3, Stream::CausticPhotons, 0, i).next_2d();
            sampled += 1.0 / aim.sample(u).unwrap().1 as f64;
            brute += if inside(warp::sphere(u)) { 4.0 * std::f64::consts::PI } else { 0.0 };
        }
        let (sampled, brute) = (sampled / n as f64, brute / n as f64);
        assert!((sampled / brute - 1.0).abs() < 0.02, "{sampled} {brute}");
    }

    #[test]
    fn lines_cover_the_union_with_the_stated_pdf() {
        let targets = targets(vec![cube(Vec3::ZERO, 0.5), cube(Vec3::new(0.4, 0.3, 5.0), 0.5)]);
        let d = Vec3::new(0.1, 0.2, 0.97).normalize();
        let n = 1 << 16;
        let frame = Frame::from_normal(d);
        let (mut sampled, mut brute) = (0.0f64, 0.0f64);
        for i in 0..n {
            let u = Sampler::new(3, Stream::CausticPhotons, 1, i).next_2d();
            let (p, pdf_a) = targets.sample_line(d, 100.0, u).unwrap();
            assert!(p.dot(d).abs() < 1e-4);
            sampled += 1.0 / pdf_a as f64;
            let q = frame.s * (8.0 * u.x - 4.0) + frame.t * (8.0 * u.y - 4.0);
            let across = |v: Vec3| v - d * d.dot(v);
            let hit = targets.spheres.iter().any(|s| across(s.center - q).length() <= s.radius);
            brute += if hit { 64.0 } else { 0.0 };
        }
        assert!((sampled / brute - 1.0).abs() < 0.02, "{sampled} {brute}");
        assert!(targets.sample_line(d, 0.1, Vec2::splat(0.5)).is_none());
    }

    /// Two places that are seen, in a world of twenty by twenty.
    fn learnt() -> Targets {
        let world = cube(Vec3::ZERO, 10.0);
        let around = |c: Vec3| {
            (0..64).map(move |i| {
                let u = Sampler::new(5, Stream::Pilots, 0, i);
                c + 0.5 * warp::sphere(u.clone().next_2d())
            })
        };
        let seen: Vec<Vec3> =
            around(Vec3::new(3.0, 2.0, 1.0)).chain(around(Vec3::new(-5.0, 0.0, 6.0))).collect();
        targets(vec![world]).learnt(&seen, world).unwrap()
    }

    /// Of lines and of directions from afar, the means of 1 and of what only holds near what is seen, over
    /// the stated pdf, are the integrals; and many of them go there.
    #[test]
    fn learnt_targets_have_the_stated_density() {
        const N: u64 = 1 << 16;
        const R: f32 = 0.4;
        let targets = learnt();
        let seen = [Vec3::new(3.0, 2.0, 1.0), Vec3::new(-5.0, 0.0, 6.0)];
        let is_near = |o: Vec3, d: Vec3, r: f32| seen.iter().any(|&c| (c - o).cross(d).length() < r);
        let whole = targets.spheres[0];
        let in_world = |o: Vec3, d: Vec3| (whole.center - o).cross(d).length() <= whole.radius * 1.0001;
        let d = Vec3::new(0.1, 0.9, -0.4).normalize();
        let far = Vec3::new(60.0, -10.0, 20.0);
        let aim = targets.aim_from(far, None).unwrap();
        let mut sums = [0.0f64; 4];
        let mut near = [0u64; 2];
        for i in 0..N {
            let u = Sampler::new(3, Stream::CausticPhotons, 2, i).next_2d();
            let line = targets.sample_line(d, 1.0, u).map(|(p, pdf_a)| (p, d, pdf_a)).unwrap();
            let direction = aim.sample(u).map(|(w, pdf_w)| (far, w, pdf_w)).unwrap();
            for (k, (o, d, pdf)) in [line, direction].into_iter().enumerate() {
                assert!(in_world(o, d));
                sums[2 * k] += 1.0 / f64::from(pdf);
                sums[2 * k + 1] += if is_near(o, d, R) { 1.0 / f64::from(pdf) } else { 0.0 };
                near[k] += u64::from(is_near(o, d, 2.0 * R));
            }
        }
        let disk = |r: f32| PI * r * r;
        let cap = |c: Vec3, r: f32| {
            2.0 * PI * (1.0 - (1.0 - f64::from(r * r / c.distance_squared(far))).sqrt()) as f32
        };
        let exact = [
            disk(whole.radius),
            2.0 * disk(R),
            cap(whole.center, whole.radius),
            seen.iter().map(|&c| cap(c, R)).sum(),
        ];
        for (sum, exact) in sums.iter().zip(exact) {
            let off = sum / N as f64 / f64::from(exact) - 1.0;
            assert!(off.abs() < 0.02, "{sums:?} over {N} are not {exact:?}: {off}");
        }
        assert!(near.iter().all(|&near| near > N * 3 / 10), "{near:?}");
    }

    /// Where all is seen, there is nothing to learn.
    #[test]
    fn what_is_as_large_as_everything_is_no_target() {
        let world = cube(Vec3::ZERO, 10.0);
        let all: Vec<Vec3> =
            (0..64).map(|i| 10.0 * warp::sphere(Sampler::new(5, Stream::Pilots, 0, i).next_2d())).collect();
        assert!(targets(vec![world]).learnt(&all, world).is_none());
        assert!(targets(vec![world]).learnt(&[], world).is_none());
        // One that is all alone is still a target.
        assert!(targets(vec![world]).learnt(&[Vec3::ONE], world).is_some());
    }

    #[test]
    fn many_boxes_share_spheres() {
        let boxes: Vec<Bounds> = (0..1000).map(|i| cube(Vec3::new(i as f32, 0.0, 0.0), 0.1)).collect();
        let targets = targets(boxes.clone());
        assert!(targets.spheres.len() <= Targets::MAX);
        for b in boxes {
            assert!(targets.spheres.iter().any(|s| s.center.distance(b.center()) <= s.radius));
        }
        assert!(super::Targets::default().aim_from(Vec3::ZERO, None).is_none());
    }
}
