use super::*;
use glam::{Affine3A, Mat3, Quat};

/// A deterministic stream of numbers in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

fn assert_near(a: Vec3, b: [f32; 3]) {
    assert!((a - Vec3::from(b)).abs().max_element() < 2e-5 * (1.0 + a.length()), "{a} is not {b:?}");
}

/// What a ray sees of a shape: p, n_g, uv, ∂p/∂u.
fn see(shape: &Shape, o: [f32; 3], d: [f32; 3]) -> (Vec3, Vec3, Vec2, Vec3) {
    let ray = Ray::new(o.into(), d.into());
    let hit = Hit {
        t: shape.intersect(&ray).expect("a hit"),
        u: 0.0,
        v: 0.0,
        shape: 0,
        primitive: 0,
        instance: Hit::NO_INSTANCE,
    };
    let point = shape.point(&ray, &hit, Wanted::All);
    (point.p, point.n_g, point.uv, shape.partials(&hit, &point)[0])
}

const MIRROR: Vec3 = Vec3::new(-1.0, 1.0, 1.0);

// The expected values below are what Mitsuba 3.9.1 prints for the same shapes and rays.

#[test]
fn quadrics_agree_with_mitsuba() {
    let (o, d) = ([0.3, 5.0, 3.1], [0.05, -4.6, -2.7]);
    let turn = Affine3A::from_quat(Quat::from_rotation_x(30f32.to_radians()))
        * Affine3A::from_scale(Vec3::splat(2.0));

    let sphere = |m, flip| Shape::Sphere(Sphere::new(Vec3::ZERO, 1.0, m, flip).unwrap());
    let (p, n, uv, dp_du) = see(&sphere(Affine3A::IDENTITY, false), o, d);
    assert_near(p, [0.346_440_46, 0.727_494_7, 0.592_225_1]);
    assert_near(n, p.into());
    assert_near(uv.extend(0.0), [0.179_265_95, 0.298_249_6, 0.0]);
    assert_near(dp_du, [-4.570_984, 2.176_749_5, 0.0]);
    let (p, n, uv, dp_du) = see(&sphere(Affine3A::from_scale(MIRROR), false), o, d);
    assert_near(n, (-p).into());
    assert_near(uv.extend(0.0), [0.320_734_05, 0.298_249_6, 0.0]);
    assert_near(dp_du, [4.570_984, -2.176_749_5, 0.0]);
    let (p, n, ..) = see(&sphere(Affine3A::from_scale(MIRROR), true), o, d);
    assert_near(n, p.into());
    let (_, n, uv, dp_du) = see(&sphere(turn, true), o, d);
    assert_near(n, [-0.168_349_83, -0.811_820_3, -0.559_111_83]);
    assert_near(uv.extend(0.0), [0.222_994_36, 0.475_052_4, 0.0]);
    assert_near(dp_du, [-12.347_876, 1.832_116_7, 1.057_773_1]);

    let disk = |m, flip| Shape::Disk(Disk::new(m, flip).unwrap());
    let (p, n, uv, dp_du) = see(&disk(Affine3A::IDENTITY, false), o, d);
    assert_near(p, [0.357_407_42, -0.281_480_97, 0.0]);
    assert_near(n, [0.0, 0.0, 1.0]);
    assert_near(uv.extend(0.0), [0.454_941_33, 0.893_826, 0.0]);
    assert_near(dp_du, [0.785_612_17, -0.618_719_34, 0.0]);
    let (_, n, uv, _) = see(&disk(Affine3A::from_scale(MIRROR), false), o, d);
    assert_near(n, [0.0, 0.0, 1.0]);
    assert_near(uv.extend(0.0), [0.454_941_24, 0.606_174, 0.0]);
    assert_near(see(&disk(Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0)), false), o, d).1, [0.0, 0.0, -1.0]);
    assert_near(see(&disk(Affine3A::IDENTITY, true), o, d).1, [0.0, 0.0, -1.0]);
    let shear = Mat3::from_cols(Vec3::new(1.0, 0.2, 0.1), Vec3::new(0.5, 1.5, 0.0), Vec3::new(0.0, 0.3, 0.7));
    let shear = Affine3A::from_mat3_translation(shear, Vec3::new(1.0, 2.0, 3.0));
    let (p, n, uv, dp_du) = see(&disk(shear, false), [1.2, 2.5, 10.0], [0.01, -0.1, -1.0]);
    assert_near(p, [1.269_641, 1.803_590_5, 3.035_904_6]);
    assert_near(n, [-0.106_466_03, 0.035_488_67, 0.993_682_86]);
    assert_near(uv.extend(0.0), [0.401_109_8, 0.926_460_5, 0.0]);
    assert_near(dp_du, [0.672_237_34, -0.489_665_78, 0.089_513_496]);

    let cylinder = |m, flip| Shape::Cylinder(Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, m, flip).unwrap());
    let (p, n, uv, dp_du) = see(&cylinder(Affine3A::IDENTITY, false), o, d);
    assert_near(p, [0.344_142_26, 0.938_917_64, 0.716_321]);
    assert_near(n, [0.344_142_2, 0.938_917_5, 0.0]);
    assert_near(uv.extend(0.0), [0.194_084_9, 0.716_320_93, 0.0]);
    assert_near(dp_du, [-5.899_392_6, 2.162_309_2, 0.0]);
    let (_, n, uv, dp_du) = see(&cylinder(Affine3A::from_scale(MIRROR), false), o, d);
    assert_near(n, [0.344_142_26, 0.938_917_6, 0.0]);
    assert_near(uv.extend(0.0), [0.305_915_1, 0.716_320_93, 0.0]);
    assert_near(dp_du, [5.899_392, -2.162_309_2, 0.0]);
    let (_, n, uv, _) = see(&cylinder(turn, true), o, d);
    assert_near(n, [-0.168_320_54, -0.853_669_3, -0.492_866_16]);
    assert_near(uv.extend(0.0), [0.223_082_81, 0.078_317_26, 0.0]);
    let (p0, p1) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 2.0, 3.5));
    let double = Affine3A::from_scale(Vec3::splat(2.0));
    let bent = Shape::Cylinder(Cylinder::new(p0, p1, 0.5, double, true).unwrap());
    let (p, n, uv, dp_du) = see(&bent, [5.0, 4.0, 6.5], [0.1, -1.0, 0.2]);
    assert_near(p, [5.098_404, 3.015_961_2, 6.696_808]);
    assert_near(n, [0.029_255_228, 0.984_039_07, -0.175_531_36]);
    assert_near(uv.extend(0.0), [0.721_526_27, 0.521_276_4, 0.0]);
    assert_near(dp_du, [1.016_462_7, -1.118_109_1, -6.098_774_4]);
}

#[test]
fn rectangle_and_cube_agree_with_mitsuba() {
    let rectangle = Mesh::rectangle(Affine3A::from_scale(Vec3::new(2.0, 3.0, 1.0)));
    let point = rectangle.point(0, 0.25, 0.5, Wanted::All);
    assert_eq!(point.n_g, Vec3::Z);
    assert_eq!(point.p, ((point.uv * 2.0 - 1.0) * Vec2::new(2.0, 3.0).extend(0.0).truncate()).extend(0.0));
    assert_eq!(rectangle.partials(0)[0], Vec3::X * 4.0);
    assert_eq!(rectangle.area(), 24.0);
    // Mitsuba transforms the normals as normals, and shades by them.
    assert_eq!(Mesh::rectangle(Affine3A::from_scale(MIRROR)).point(1, 0.2, 0.2, Wanted::All).n_g, Vec3::Z);
    let mut flipped = Mesh::rectangle(Affine3A::IDENTITY);
    flipped.flip();
    assert_eq!(flipped.point(0, 0.2, 0.2, Wanted::All).n_g, Vec3::NEG_Z);

    // Corners with texture coordinates (0,1) (1,1) (1,0) of each face, as Mitsuba's vertex buffer has them.
    let mitsuba = [
        ([0, -1, 0], [[1, -1, -1], [1, -1, 1], [-1, -1, 1]]),
        ([0, 1, 0], [[1, 1, -1], [-1, 1, -1], [-1, 1, 1]]),
        ([1, 0, 0], [[1, -1, -1], [1, 1, -1], [1, 1, 1]]),
        ([0, 0, 1], [[1, -1, 1], [1, 1, 1], [-1, 1, 1]]),
        ([-1, 0, 0], [[-1, -1, 1], [-1, 1, 1], [-1, 1, -1]]),
        ([0, 0, -1], [[1, 1, -1], [1, -1, -1], [-1, -1, -1]]),
    ];
    for (scale, side) in [(Vec3::ONE, 1.0), (MIRROR, 1.0)] {
        let cube = Mesh::cube(Affine3A::from_scale(scale));
        assert_eq!((cube.positions.len(), cube.triangles.len(), cube.area()), (24, 12, 24.0));
        for (face, (normal, corners)) in mitsuba.iter().enumerate() {
            let normal = scale * Vec3::from(normal.map(|x| x as f32)) * side;
            for triangle in [2 * face as u32, 2 * face as u32 + 1] {
                assert_eq!(cube.point(triangle, 0.3, 0.3, Wanted::All).n_g, normal);
            }
            for (corner, uv) in corners.iter().zip([Vec2::Y, Vec2::ONE, Vec2::X]) {
                let p = scale * Vec3::from(corner.map(|x| x as f32));
                assert!((4 * face..4 * face + 4).any(|i| cube.positions[i] == p && cube.uvs[i] == uv));
            }
        }
    }
}

#[test]
fn impossible_transforms_are_refused() {
    let scale = |x, y, z| Affine3A::from_scale(Vec3::new(x, y, z));
    let shear = Affine3A::from_mat3(Mat3::from_cols(Vec3::X, Vec3::new(0.5, 1.0, 0.0), Vec3::Z));
    let sphere = |m| Sphere::new(Vec3::ZERO, 1.0, m, false);
    let cylinder = |m| Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, m, false);
    let disk = |m| Disk::new(m, false);
    for m in
        [scale(1.0, 1.0, 1.1), scale(1.0, 1.0, 0.0), scale(0.0, 0.0, 0.0), scale(f32::NAN, 1.0, 1.0), shear]
    {
        assert!(sphere(m).is_err());
    }
    for m in [
        scale(1.0, 1.1, 1.0),
        scale(1.0, 1.0, 0.0),
        scale(0.0, 0.0, 1.0),
        scale(1.0, 1.0, f32::INFINITY),
        shear,
    ] {
        assert!(cylinder(m).is_err());
    }
    for m in [scale(0.0, 1.0, 1.0), scale(f32::NAN, 1.0, 1.0)] {
        assert!(disk(m).is_err());
    }
    assert!(
        cylinder(scale(2.0, 2.0, 3.0)).is_ok() && disk(scale(1.0, 2.0, 0.0)).is_ok() && disk(shear).is_ok()
    );
    assert!(sphere(scale(1e-25, 1e-25, 1e-25)).is_ok());
    for radius in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(Sphere::new(Vec3::ZERO, radius, Affine3A::IDENTITY, false).is_err());
        assert!(Cylinder::new(Vec3::ZERO, Vec3::Z, radius, Affine3A::IDENTITY, false).is_err());
    }
    assert!(Cylinder::new(Vec3::ONE, Vec3::ONE, 1.0, Affine3A::IDENTITY, false).is_err());
}

/// Random quadrics of sizes 10^±4, near and far: hits lie on the surface and within the bounds, and nothing is nearer.
#[test]
fn hits_lie_on_the_surface_and_in_the_bounds() {
    let mut random = Random(1);
    let mut hits = 0;
    for _ in 0..20_000 {
        let size = 10f32.powf(8.0 * random.next() - 4.0);
        let center = random.point() * size * 3.0;
        let turn = Quat::from_scaled_axis(random.point() * 3.0);
        let m = Affine3A::from_scale_rotation_translation(Vec3::splat(size), turn, center);
        let shape = match (random.next() * 3.0) as u32 {
            0 => Shape::Sphere(Sphere::new(Vec3::ZERO, 1.0, m, false).unwrap()),
            1 => Shape::Disk(Disk::new(m, false).unwrap()),
            _ => Shape::Cylinder(Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, m, false).unwrap()),
        };
        let distance = size * 10f32.powf(6.0 * random.next());
        let o = center + random.point().normalize_or_zero() * distance;
        let ray = Ray::new(o, (center + random.point() * size - o).normalize_or(Vec3::X));
        let Some(t) = shape.intersect(&ray) else { continue };
        hits += 1;
        let point = shape.point(
            &ray,
            &Hit { t, u: 0.0, v: 0.0, shape: 0, primitive: 0, instance: Hit::NO_INSTANCE },
            Wanted::All,
        );
        let bounds = shape.bounds();
        assert!(point.p.cmpge(bounds.min).all() && point.p.cmple(bounds.max).all());
        // On the ray, up to what f32 coordinates of both ends allow ...
        let ulp = f32::EPSILON as f64 * (o.abs().max_element() + point.magnitude) as f64;
        let (p, o, d) = (point.p.as_dvec3(), ray.o.as_dvec3(), ray.d.as_dvec3());
        assert!(
            (p - o).cross(d).length() <= 8.0 * f32::EPSILON as f64 * point.magnitude as f64 + 1e-12 * ulp
        );
        assert!(((p - o).dot(d) - t as f64 * d.length_squared()).abs() <= 4.0 * ulp);
        // ... and on the surface, up to what those of the point allow.
        let q = m.as_inverse(p);
        let error = match shape {
            Shape::Sphere(_) => q.length() - 1.0,
            Shape::Disk(_) => q.z,
            _ => q.x.hypot(q.y) - 1.0,
        };
        assert!(error.abs() * size as f64 <= 8.0 * f32::EPSILON as f64 * point.magnitude as f64, "{error}");
        assert!((point.n_g.length() - 1.0).abs() < 1e-6 && point.uv.clamp(Vec2::ZERO, Vec2::ONE) == point.uv);
        // Limits are exclusive.
        let up_to = |t_max| shape.intersect(&Ray { t_max, ..ray });
        assert_eq!((up_to(t), up_to(t * 1.000_001)), (None, Some(t)));
        assert_ne!(shape.intersect(&Ray { t_min: t, ..ray }), Some(t));
    }
    assert!(hits > 5_000, "{hits}");
}

trait Inverse {
    fn as_inverse(&self, p: DVec3) -> DVec3;
}

impl Inverse for Affine3A {
    fn as_inverse(&self, p: DVec3) -> DVec3 {
        self.matrix3.as_dmat3().inverse() * (p - self.translation.as_dvec3())
    }
}

#[test]
fn broken_rays_hit_nothing() {
    let shapes = [
        Shape::Sphere(Sphere::new(Vec3::ZERO, 1.0, Affine3A::IDENTITY, false).unwrap()),
        Shape::Disk(Disk::new(Affine3A::IDENTITY, false).unwrap()),
        Shape::Cylinder(Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, Affine3A::IDENTITY, false).unwrap()),
    ];
    for shape in &shapes {
        for bad in [Vec3::NAN, Vec3::INFINITY, Vec3::new(f32::NAN, 0.0, 1.0)] {
            assert_eq!(shape.intersect(&Ray::new(bad, Vec3::Z)), None);
            assert_eq!(shape.intersect(&Ray::new(Vec3::ZERO, bad)), None);
        }
        assert_eq!(shape.intersect(&Ray::new(Vec3::new(0.1, 0.2, 0.3), Vec3::ZERO)), None);
        assert_eq!(shape.intersect(&Ray { t_max: f32::NAN, ..Ray::new(Vec3::splat(-3.0), Vec3::ONE) }), None);
    }
    // Along the axis, and in the plane.
    assert_eq!(shapes[2].intersect(&Ray::new(Vec3::new(0.5, 0.0, -1.0), Vec3::Z)), None);
    assert_eq!(shapes[1].intersect(&Ray::new(Vec3::new(-5.0, 0.0, 0.0), Vec3::X)), None);
}
