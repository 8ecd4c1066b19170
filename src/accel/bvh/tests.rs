//! The vector unit's answers against plain Rust's, and the parts that traversal relies on.

#![allow(unsafe_code)] // to read what the kernels wrote
#![allow(clippy::single_range_in_vec_init)] // what groups are

use super::node::{ORDER, Ref};
use super::simd::{Portable, Simd};
use super::*;
use crate::accel::tests::{Random, meshes, mixed, ray};
use glam::{Affine3A, DAffine3, DVec3, Quat, Vec3};
use proptest::prelude::*;
use std::mem::MaybeUninit;

/// The same tree without the vector unit.
fn portable(bvh: &Bvh, ray: &Ray) -> (Option<Hit>, bool) {
    let any = bvh.trace::<_, true>(Portable, ray).is_some();
    (bvh.trace::<_, false>(Portable, ray), any)
}

fn bits(hit: Option<Hit>) -> Option<[u32; 6]> {
    hit.map(|h| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.shape, h.primitive, h.instance])
}

#[test]
fn vectors_change_no_bit_of_a_hit() {
    for seed in 0..4 {
        let geometry = mixed(seed, 2000);
        let bvh = Bvh::new(&geometry).unwrap();
        let mut random = Random(seed + 50);
        let mut hits = 0;
        for i in 0..20_000 {
            let mut ray = ray(&mut random, &geometry);
            if i % 3 == 0 {
                ray.t_min = random.next();
                ray.t_max = ray.t_min + random.next();
            }
            let (hit, any) = portable(&bvh, &ray);
            hits += hit.is_some() as u32;
            assert_eq!(bits(bvh.intersect(&ray)), bits(hit), "{ray:?}");
            assert_eq!(bvh.occluded(&ray), any, "{ray:?}");
        }
        assert!(hits > 5000, "{hits}");
    }
}

/// The mixed scene in 30 places of itself.
fn instanced() -> Geometry {
    let mut geometry = mixed(3, 500);
    let own = geometry.shapes.len() as u32;
    geometry.shapes.extend_from_within(..);
    geometry.groups.push(own..2 * own);
    let mut random = Random(8);
    for _ in 0..30 {
        let turn = Quat::from_scaled_axis(random.point() * 3.0).as_dquat();
        let m = DAffine3::from_rotation_translation(turn, random.point().as_dvec3());
        geometry.instances.push(Instance::new(0, m * DAffine3::from_scale(random.point().as_dvec3())));
    }
    geometry
}

#[test]
fn vectors_change_no_bit_in_instances() {
    let geometry = instanced();
    let bvh = Bvh::new(&geometry).unwrap();
    let mut random = Random(58);
    let mut hits = 0;
    for i in 0..20_000 {
        // Some so short that they are lengthened.
        let o = random.point() * 2.0;
        let d = random.direction() * [1.0, 1e-40][(i % 16 == 0) as usize];
        let t_max = [f32::INFINITY, random.next()][i % 2];
        let ray = Ray { t_max, ..Ray::new(o, d) };
        let (hit, any) = portable(&bvh, &ray);
        hits += hit.is_some_and(|h| h.instance != Hit::NO_INSTANCE) as u32;
        assert_eq!(bits(bvh.intersect(&ray)), bits(hit), "{ray:?}");
        assert_eq!(bvh.occluded(&ray), any, "{ray:?}");
        assert_eq!(any, hit.is_some(), "{ray:?}");
    }
    assert!(hits > 3000, "{hits}");
}

/// A tree for the group, and one of leaves alone.
#[test]
fn memory_does_not_grow_with_instances() {
    let (positions, triangles) = meshes::organic(6);
    let many = triangles.len();
    assert!(many > 80_000);
    let mesh = Shape::Mesh(Mesh { positions, triangles, ..Mesh::default() });
    let once = Bvh::new(&Geometry::from(vec![mesh.clone()])).unwrap().bytes();
    assert!(once > 36 * many);
    let at = |i: u32| Instance::new(0, DAffine3::from_translation(DVec3::X * i as f64));
    let instances: Vec<Instance> = (0..1000).map(at).collect();
    let geometry = Geometry { shapes: vec![mesh], groups: vec![0..1], instances };
    let bytes = Bvh::new(&geometry).unwrap().bytes();
    assert!(bytes < once + 1000 * 512, "{bytes} where one takes {once}");
}

#[test]
fn directions_may_have_any_length() {
    let geometry = mixed(7, 500);
    let bvh = Bvh::new(&geometry).unwrap();
    let mut random = Random(9);
    let mut hits = 0;
    for _ in 0..2000 {
        let unit = ray(&mut random, &geometry);
        // Powers of two, which hardly round: the least makes small components denormal.
        for scale in [-110, -60, 60, 100].map(|exponent| 2f32.powi(exponent)) {
            let scaled = bvh.intersect(&Ray::new(unit.o, unit.d * scale));
            match (bvh.intersect(&unit), scaled) {
                (Some(a), Some(b)) => {
                    assert_eq!((a.shape, a.primitive), (b.shape, b.primitive));
                    assert!((b.t * scale - a.t).abs() <= 2.0 * f32::EPSILON * a.t, "{unit:?} {a:?} {b:?}");
                    hits += 1;
                }
                (a, b) => assert_eq!(a, b, "{unit:?} {scale}"),
            }
        }
    }
    assert!(hits > 2000, "{hits}");
}

/// Triangles so small that f32 sees a point are missed, or their weights are numbers.
#[test]
fn weights_are_never_nan() {
    let mut random = Random(11);
    let mut hits = 0;
    for i in 0..20_000 {
        let size = 10f32.powf(-40.0 * random.next());
        let [a, b] = [random.point() * size, random.point() * size];
        let place = if i % 2 == 0 { Vec3::ZERO } else { random.point() };
        let positions = vec![place, place + a, place + b];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Default::default() };
        let bvh = Bvh::new(&Geometry::from(vec![Shape::Mesh(mesh)])).unwrap();
        let o = random.direction() * 3.0;
        for target in [place, place + (a + b) / 3.0] {
            if let Some(hit) = bvh.intersect(&Ray::new(o, target - o)) {
                assert!(hit.u.is_finite() && hit.v.is_finite(), "{hit:?}");
                hits += 1;
            }
        }
    }
    assert!(hits > 1000, "{hits}");
}

#[test]
fn directions_may_be_denormal() {
    // Behind each other, and near enough for distances to be finite.
    let layer = |z| Shape::Mesh(Mesh::rectangle(Affine3A::from_translation(Vec3::Z * z)));
    let bvh =
        Bvh::new(&Geometry::from((1..=30).map(|i| layer(-0.001 * i as f32)).collect::<Vec<_>>())).unwrap();
    for d in [Vec3::new(1e-41, 0.0, -1e-40), Vec3::new(-0.0, 0.0, -1e-40), Vec3::new(1e-44, -1e-41, -1e-40)] {
        let ray = Ray::new(Vec3::new(0.3, 0.2, 0.0), d);
        let hit = bvh.intersect(&ray).unwrap();
        assert!(hit.shape == 0 && (hit.t / 1e37 - 1.0).abs() < 1e-3, "{hit:?}");
        assert!(bvh.occluded(&ray) && !bvh.occluded(&Ray { t_max: 9e36, ..ray }));
        assert!(bvh.intersect(&Ray { t_min: 1.1e37, ..ray }).is_some_and(|hit| hit.shape == 1));
        assert!(!bvh.occluded(&Ray { d: -d, ..ray }));
    }
    assert_eq!(bvh.intersect(&Ray::new(Vec3::ZERO, Vec3::ZERO)), None);
}

/// All kinds of numbers: zeros, denormals, infinities and NaN too.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![any::<f32>(), -2f32..2.0, Just(0.0), Just(-0.0), Just(1.0)]
}

fn vector() -> impl Strategy<Value = Vec3> {
    [number(), number(), number()].prop_map(Vec3::from_array)
}

fn lanes() -> impl Strategy<Value = [f32; 8]> {
    prop::array::uniform8(number())
}

proptest! {
    #[test]
    fn vectors_change_no_bit_whatever_the_numbers(
        positions in prop::collection::vec(vector(), 3..60),
        rays in prop::collection::vec((vector(), vector(), number(), number()), 20),
    ) {
        let n = positions.len() as u32;
        let triangles = (0..n).map(|i| [i, (i + 1) % n, (i + 2) % n]).collect();
        let mesh = Mesh { positions, triangles, ..Default::default() };
        let bvh = Bvh::new(&Geometry::from(vec![Shape::Mesh(mesh)])).unwrap();
        for (o, d, t_min, t_max) in rays {
            for ray in [Ray { o, d, t_min, t_max }, Ray::new(o, d)].into_iter().filter(|r| !is_short(r)) {
                let (hit, any) = portable(&bvh, &ray);
                prop_assert_eq!(bits(bvh.intersect(&ray)), bits(hit));
                prop_assert_eq!(bvh.occluded(&ray), any);
                prop_assert_eq!(hit.is_some(), any);
            }
        }
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn avx2_computes_as_plain_rust(a in lanes(), b in lanes(), from: [u32; 8], order: [u8; 8]) {
        let Some(avx2) = simd::Avx2::detect() else { return Ok(()) };
        let (x, y) = (avx2.load(&a), avx2.load(&b));
        // NaN is NaN, whatever its bits.
        let same = |x, y: [f32; 8]| {
            let x = avx2.store(x);
            (0..8).all(|i| x[i].to_bits() == y[i].to_bits() || x[i].is_nan() && y[i].is_nan())
        };
        prop_assert!(same(x, a));
        prop_assert!(same(avx2.splat(a[0]), Portable.splat(a[0])));
        prop_assert!(same(avx2.sub(x, y), Portable.sub(a, b)));
        prop_assert!(same(avx2.mul(x, y), Portable.mul(a, b)));
        prop_assert!(same(avx2.min(x, y), Portable.min(a, b)));
        prop_assert!(same(avx2.max(x, y), Portable.max(a, b)));
        prop_assert_eq!(avx2.at_most(x, y), Portable.at_most(a, b));
        let order = u64::from_le_bytes(order.map(|lane| lane % 8));
        let mut permuted = [[MaybeUninit::new(0); 8]; 2];
        avx2.permute(&from, order, &mut permuted[0]);
        Portable.permute(&from, order, &mut permuted[1]);
        let mut floats = [[MaybeUninit::new(0.0); 8]; 2];
        avx2.permute_floats(x, order, &mut floats[0]);
        Portable.permute_floats(a, order, &mut floats[1]);
        for (lane, i) in order.to_le_bytes().into_iter().zip(0..8) {
            // SAFETY: all were written.
            let (u, v) = unsafe { (permuted[0][i].assume_init(), permuted[1][i].assume_init()) };
            prop_assert!(u == v && u == from[lane as usize]);
            // SAFETY: all were written.
            let (u, v) = unsafe { (floats[0][i].assume_init(), floats[1][i].assume_init()) };
            prop_assert!(u.to_bits() == v.to_bits() && u.to_bits() == a[lane as usize].to_bits());
        }
    }
}

#[test]
fn order_names_every_slot_of_a_mask_from_far_to_near() {
    for (octant, table) in ORDER.iter().enumerate() {
        for mask in 1..256usize {
            let bytes = table[mask].to_le_bytes().map(|slot| slot as usize);
            let named = &bytes[..mask.count_ones() as usize];
            assert!(named.iter().all(|slot| mask >> slot & 1 == 1));
            // A slot's distance is its rank, so ranks fall.
            assert!(named.windows(2).all(|w| w[0] ^ octant > w[1] ^ octant), "{octant} {mask:b} {named:?}");
            assert_eq!(named.last(), Some(&bytes[7]));
        }
    }
}

/// Every node of a full tree is met with what `Ref` says, and every primitive is in one leaf.
#[test]
fn every_primitive_has_one_leaf() {
    for n in [0, 1, 7, 8, 9, 100, 30_000] {
        let geometry = mixed(3, n);
        let bvh = Bvh::new(&geometry).unwrap();
        let mut seen = std::collections::BTreeSet::new();
        let (mut open, mut nodes, mut deepest) = (vec![(Ref::node(0), 0)], 0, 0);
        while let Some((at, depth)) = open.pop() {
            deepest = deepest.max(depth);
            if at.is_node() {
                nodes += 1;
                open.extend(bvh.nodes[at.index()].occupied().map(|child| (child, depth + 1)));
            } else if at.is_packet() {
                for lane in bvh.packets[at.index()].occupied() {
                    assert!(seen.insert(lane), "{lane:?} twice");
                }
            } else {
                let Single::Quadric(_, shape) = bvh.singles[at.index()] else { panic!() };
                assert!(seen.insert((shape, 0)));
            }
        }
        let all: usize = geometry
            .shapes
            .iter()
            .map(|s| if let Shape::Mesh(mesh) = s { mesh.triangles.len() } else { 1 })
            .sum();
        assert_eq!(seen.len(), all);
        assert!(deepest <= build::MAX_DEPTH && nodes >= all / 64);
    }
}
