use super::*;
use crate::image_io::Image;
use crate::math::{Ray, Sampler, Stream};
use crate::shape::{Cylinder, Disk, Hit, Mesh, Shape, Sphere, SurfacePoint, Wanted};
use glam::{Affine2, Affine3A, DVec3, Mat3};
use std::f64::consts::{PI as PI64, TAU as TAU64};

const WHITE: Color = Color::Constant(Rgb::ONE);

fn sampler(i: u64) -> Sampler {
    Sampler::new(11, Stream::GlobalPhotons, 5, i)
}

/// A scene of one light.
struct Setup {
    geometry: Geometry,
    textures: Vec<Texture>,
    lights: Lights,
}

impl Setup {
    fn new(light: Light) -> Setup {
        // Two triangles that nothing emits from, so that distant lights have bounds to shine on.
        let ground = Mesh::rectangle(Affine3A::from_translation(Vec3::new(0.1, -0.1, 0.0)));
        let mut setup = Setup {
            geometry: Geometry::from(vec![Shape::Mesh(ground)]),
            textures: vec![checkerboard()],
            lights: Lights::default(),
        };
        setup.lights = Lights::new(vec![light], &setup.geometry, &setup.textures);
        setup
    }

    fn area(shape: Shape, radiance: Color) -> Setup {
        let geometry = Geometry::from(vec![shape]);
        let textures = vec![checkerboard()];
        let lights = Lights::new(vec![Light::Area { shape: 0, radiance }], &geometry, &textures);
        Setup { geometry, textures, lights }
    }

    fn direct(&self, p: Vec3, s: &mut Sampler) -> Option<DirectSample> {
        let (u_light, u) = (s.next_1d(), s.next_2d());
        self.lights.sample_direct(&self.geometry, &self.textures, p, u_light, u)
    }

    fn emission(&self, s: &mut Sampler) -> Option<EmissionSample> {
        self.aimed_emission(&Targets::default(), s)
    }

    fn aimed_emission(&self, targets: &Targets, s: &mut Sampler) -> Option<EmissionSample> {
        let (u_light, u_pos, u_dir) = (s.next_1d(), s.next_2d(), s.next_2d());
        self.lights.sample_emission(&self.geometry, &self.textures, targets, u_light, u_pos, u_dir)
    }

    /// Mean of weight · `measure`(wi) over `n` samples from `p`.
    fn mean(&self, p: Vec3, n: u64, measure: impl Fn(Vec3) -> f32) -> f64 {
        (0..n)
            .filter_map(|i| self.direct(p, &mut sampler(i)))
            .map(|s| (s.weight.y * measure(s.wi)) as f64)
            .sum::<f64>()
            / n as f64
    }
}

fn checkerboard() -> Texture {
    Texture::Checkerboard {
        color0: Color::Constant(Rgb::new(0.2, 0.3, 0.9)),
        color1: Color::Constant(Rgb::new(0.8, 0.5, 0.1)),
        to_uv: Affine2::from_scale(Vec2::splat(3.0)),
    }
}

/// A 8 × 5 image without symmetry.
fn sky() -> Image {
    let pixel = |x: usize, y: usize| {
        Rgb::new(
            ((x * 7 + y * 3) % 11) as f32 * 0.25,
            ((x * 5 + y * 2) % 7) as f32 * 0.5,
            ((x * 3 + y * 5) % 13) as f32 * 0.125,
        )
    };
    Image { width: 8, height: 5, pixels: (0..40).map(|i| pixel(i % 8, i / 8)).collect() }
}

/// Mitsuba 3's rotation by 40° about (0.3, 1, 0.2).
fn rotated() -> Affine3A {
    Affine3A::from_mat3(Mat3::from_cols(
        Vec3::new(0.784_678_04, 0.183_048_83, -0.592_261_25),
        Vec3::new(-0.058_824_643, 0.973_084_75, 0.222_813_16),
        Vec3::new(0.617_106_14, -0.139_997_04, 0.774_326),
    ))
}

/// Mitsuba 3's look_at(origin (1, 2, 3), target (−0.5, 0.3, 0.2), up (0.1, 1, 0.2)).
fn pose() -> Affine3A {
    Affine3A::from_cols(
        glam::Vec3A::new(-0.879_643_56, -0.007_151_575_8, 0.475_579_65),
        glam::Vec3A::new(-0.229_964_26, 0.881_645_4, -0.412_089_6),
        glam::Vec3A::new(-0.416_345_54, -0.471_858_3, -0.777_178_35),
        glam::Vec3A::new(1.0, 2.0, 3.0),
    )
}

fn spot(to_world: Affine3A, cutoff: f32, beam: f32, texture: Option<u32>) -> Light {
    Light::Spot(Spot::new(to_world, Rgb::new(5.0, 4.0, 3.0), cutoff, beam, texture).unwrap())
}

fn sky_of(sun: [f32; 3], turbidity: f32, albedo: [f32; 3]) -> Sky {
    let sun = Vec3::from(sun).normalize();
    Sky::new(Vec3::Z, sun, turbidity, Rgb::from(albedo), 1.0 / 106.750_26).unwrap()
}

fn sun_of(direction: [f32; 3], degrees: f32, irradiance: [f32; 3], limb: bool) -> Sun {
    let direction = Vec3::from(direction).normalize();
    Sun::new(direction, 0.5 * degrees.to_radians(), Rgb::from(irradiance), limb, Some(Vec3::Z)).unwrap()
}

fn projector(to_world: Affine3A, half_width: f32, aspect: f32, irradiance: Color) -> Light {
    Light::Projector(Projector::new(to_world, half_width, aspect, irradiance, 2.0).unwrap())
}

/// The nearest hit by brute force.
fn hit(shape: &Shape, ray: &Ray) -> Option<SurfacePoint> {
    let Shape::Mesh(mesh) = shape else {
        let t = shape.intersect(ray)?;
        return Some(shape.point(
            ray,
            &Hit { t, u: 0.0, v: 0.0, shape: 0, primitive: 0, instance: Hit::NO_INSTANCE },
            Wanted::All,
        ));
    };
    let mut nearest = (ray.t_max as f64, None);
    for triangle in 0..mesh.triangles.len() as u32 {
        // Möller & Trumbore 1997.
        let [a, b, c] = mesh.vertices(triangle).map(|p| p.as_dvec3());
        let (o, d) = (ray.o.as_dvec3() - a, ray.d.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let det = e1.dot(d.cross(e2));
        let (u, v) = (o.dot(d.cross(e2)) / det, d.dot(o.cross(e1)) / det);
        let t = e2.dot(o.cross(e1)) / det;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > ray.t_min as f64 && t < nearest.0 {
            nearest = (t, Some(mesh.point(triangle, u as f32, v as f32, Wanted::All)));
        }
    }
    nearest.1
}

fn tilted(scale: Vec3) -> Affine3A {
    Affine3A::from_translation(Vec3::new(0.2, -0.1, 2.0))
        * Affine3A::from_rotation_x(3.5)
        * Affine3A::from_rotation_z(0.4)
        * Affine3A::from_scale(scale)
}

/// One light of each kind and variation, with a name.
fn every_kind() -> Vec<(&'static str, Setup)> {
    let sphere =
        Shape::Sphere(Sphere::new(Vec3::new(0.3, 0.1, 2.0), 0.7, Affine3A::IDENTITY, false).unwrap());
    let bowl = Shape::Sphere(Sphere::new(Vec3::ZERO, 2.5, Affine3A::IDENTITY, true).unwrap());
    let disk = Shape::Disk(Disk::new(tilted(Vec3::new(1.0, 0.5, 1.0)), false).unwrap());
    let cylinder =
        Shape::Cylinder(Cylinder::new(Vec3::ZERO, Vec3::Z, 0.5, tilted(Vec3::splat(1.2)), false).unwrap());
    let rectangle = || Shape::Mesh(Mesh::rectangle(tilted(Vec3::new(1.0, 0.6, 1.0))));
    let cube = Shape::Mesh(Mesh::cube(tilted(Vec3::new(0.6, 0.4, 0.5))));
    let mut rounded = Mesh::cube(tilted(Vec3::new(0.6, 0.4, 0.5)));
    let center = Shape::Mesh(rounded.clone()).bounds().center();
    rounded.normals = rounded.positions.iter().map(|&p| (p - center).normalize()).collect();
    let directional =
        |d: Vec3| Light::Directional { direction: d.normalize(), irradiance: Rgb::new(1.0, 2.0, 3.0) };
    let envmap = |m| Light::Envmap(Envmap::new(sky(), 1.5, m).unwrap());
    let down = Affine3A::look_to_rh(Vec3::new(0.3, 0.2, 2.0), Vec3::new(0.1, 0.1, 1.0), Vec3::Y).inverse();
    let low_sky = sky_of([0.8, -0.5, 0.2], 2.4, [0.1, 0.2, 0.3]);
    let squeezed = down * Affine3A::from_scale(Vec3::new(1.5, 0.7, 1.2));
    vec![
        ("sphere", Setup::area(sphere.clone(), WHITE)),
        ("textured sphere", Setup::area(sphere, Color::Texture(0))),
        ("sphere inside out", Setup::area(bowl, WHITE)),
        ("disk", Setup::area(disk.clone(), WHITE)),
        ("textured disk", Setup::area(disk, Color::Texture(0))),
        ("cylinder", Setup::area(cylinder, WHITE)),
        ("rectangle", Setup::area(rectangle(), WHITE)),
        ("textured rectangle", Setup::area(rectangle(), Color::Texture(0))),
        ("cube", Setup::area(cube, WHITE)),
        ("smooth cube", Setup::area(Shape::Mesh(rounded), WHITE)),
        (
            "point",
            Setup::new(Light::Point {
                position: Vec3::new(0.5, 0.2, 1.5),
                intensity: Rgb::new(1.0, 2.0, 3.0),
            }),
        ),
        ("spot", Setup::new(spot(down, 40.0, 20.0, None))),
        ("hard spot", Setup::new(spot(down, 25.0, 25.0, None))),
        ("wide spot", Setup::new(spot(down, 120.0, 60.0, None))),
        ("textured spot", Setup::new(spot(down, 40.0, 20.0, Some(0)))),
        ("squeezed spot", Setup::new(spot(squeezed, 40.0, 20.0, Some(0)))),
        ("directional", Setup::new(directional(Vec3::new(0.3, -0.2, -1.0)))),
        ("constant", Setup::new(Light::Constant { radiance: Rgb::new(1.0, 2.0, 3.0) })),
        ("envmap", Setup::new(envmap(Affine3A::IDENTITY))),
        ("rotated envmap", Setup::new(envmap(rotated()))),
        ("sky", Setup::new(Light::Sky(low_sky.clone()))),
        ("hazy sky", Setup::new(Light::Sky(sky_of([0.0, 0.3, 1.0], 9.3, [0.4, 0.2, 0.1])))),
        ("stretched sky", Setup::new(Light::Sky(low_sky.clone().stretched(1.4, false).unwrap()))),
        ("extended sky", Setup::new(Light::Sky(low_sky.stretched(1.0, true).unwrap()))),
        ("sun", Setup::new(Light::Sun(sun_of([0.4, -0.3, 0.8], 0.5358, [1.5, 1.2, 0.9], false)))),
        ("dark rim", Setup::new(Light::Sun(sun_of([0.4, -0.3, 0.8], 0.5358, [1.5, 1.2, 0.9], true)))),
        ("setting sun", Setup::new(Light::Sun(sun_of([0.4, -0.9, 0.15], 60.0, [1.5, 1.2, 0.9], true)))),
        ("projector", Setup::new(projector(down, 0.6, 1.5, Color::Constant(Rgb::new(5.0, 4.0, 3.0))))),
        ("textured projector", Setup::new(projector(down, 0.6, 0.8, Color::Texture(0)))),
    ]
}

fn close(a: Rgb, b: Rgb, relative: f32) -> bool {
    (a - b).abs().cmple(relative * a.abs().max(b.abs()) + 1e-6).all()
}

#[test]
fn spots_are_those_of_mitsuba() {
    // Mitsuba 3.9.1, `sample_direction` of the spot above with intensity (5, 4, 3): point, and weight for cutoff 30 and
    // beam width 10; that with the checkerboard; that for cutoff 20 and its default beam width.
    #[rustfmt::skip]
    let table = [
        ([-0.5, 0.3, 0.2], [0.385208, 0.3081664, 0.23112482], [0.0770416, 0.092449926, 0.20801231], [0.385208, 0.3081664, 0.23112482]),
        ([-0.3, 0.9, 0.7], [0.6105006, 0.48840046, 0.36630034], [0.122100115, 0.14652014, 0.32967028], [0.6105006, 0.48840046, 0.36630034]),
        ([0.6, 0.2, -0.4], [0.18473557, 0.14778845, 0.110841334], [0.14778845, 0.073894225, 0.011084134], [0.07049295, 0.056394365, 0.042295773]),
        ([-1.5, 0.5, 0.5], [0.2371063, 0.18968503, 0.14226377], [0.18968503, 0.094842516, 0.014226378], [0.27045912, 0.21636729, 0.16227546]),
        ([0.2, 1.5, 2.2], [2.3356044, 1.8684835, 1.4013627], [1.8684835, 0.9342418, 0.14013627], [2.8064704, 2.2451763, 1.6838822]),
    ];
    for (p, plain, textured, narrow) in table {
        let lights = [
            spot(pose(), 30.0, 10.0, None),
            spot(pose(), 30.0, 10.0, Some(0)),
            spot(pose(), 20.0, 15.0, None),
        ];
        for (light, expected) in lights.into_iter().zip([plain, textured, narrow]) {
            let s = Setup::new(light).direct(Vec3::from(p), &mut sampler(0)).unwrap();
            assert!(close(s.weight, Rgb::from(expected), 2e-5), "{p:?}: {} is not {expected:?}", s.weight);
            assert!(s.delta && s.target == Some(Vec3::new(1.0, 2.0, 3.0)));
        }
    }
    assert!(
        Setup::new(spot(pose(), 30.0, 10.0, None))
            .direct(Vec3::new(3.0, 3.0, 3.0), &mut sampler(0))
            .is_none()
    );
    for (cutoff, beam) in [(0.0, 0.0), (181.0, 10.0), (f32::NAN, 1.0), (20.0, -1.0), (20.0, f32::NAN)] {
        assert!(Spot::new(pose(), Rgb::ONE, cutoff, beam, None).is_err());
    }
    assert!(Spot::new(Affine3A::from_scale(Vec3::ZERO), Rgb::ONE, 20.0, 10.0, None).is_err());
}

#[test]
fn environment_maps_are_those_of_mitsuba() {
    // Mitsuba 3.9.1, `eval` of the sky with scale 1.5: direction, radiance, radiance if rotated.
    #[rustfmt::skip]
    let table = [
        ([1.0, 0.0, 0.0], [2.0625, 0.75, 0.28125], [2.735144, 1.282215, 0.8287957]),
        ([0.0, 0.0, 1.0], [1.125, 3.0, 1.40625], [1.7120616, 1.8215201, 1.6056776]),
        ([0.0, 0.0, -1.0], [1.125, 3.0, 1.40625], [2.0748115, 2.9320974, 1.0556283]),
        ([0.3, 0.5, -0.7], [1.4419265, 1.8671744, 1.1804199], [2.0328908, 1.0780127, 0.7995428]),
        ([-0.6, 0.2, 0.4], [2.3130586, 1.9650679, 1.7871788], [1.3686216, 3.3904653, 1.3853629]),
        ([-0.1, -0.9, 0.25], [2.191553, 1.3811128, 0.7832753], [0.7398204, 2.6899142, 0.9280293]),
        ([0.02, 0.3, -0.9], [1.5248299, 2.3856432, 1.0487986], [1.7309597, 2.244111, 1.1568899]),
        ([-0.02, 0.3, -0.9], [1.493116, 2.3856432, 0.9957553], [1.785522, 2.3201032, 1.241488]),
    ];
    let maps = [Affine3A::IDENTITY, rotated()].map(|m| Envmap::new(sky(), 1.5, m).unwrap());
    for (d, plain, rotated) in table {
        let d = Vec3::from(d).normalize();
        for (map, expected) in maps.iter().zip([plain, rotated]) {
            assert!(
                close(map.eval(d), Rgb::from(expected), 2e-5),
                "{d}: {} is not {expected:?}",
                map.eval(d)
            );
        }
    }
}

#[test]
fn skies_are_those_of_mitsuba() {
    // Mitsuba 3.9.1, `eval` of `sunsky` without sun: its direction, turbidity, albedo, and radiance in these directions.
    let directions = [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.02],
        [0.3, 0.45, 0.75],
        [-0.5, 0.2, 0.3],
        [0.2, -0.9, 0.6],
        [-0.7, -0.7, 0.001],
    ];
    #[rustfmt::skip]
    let table = [
        ([0.3, 0.4, 0.7], 3.0, [0.3, 0.3, 0.3], [[0.0302201, 0.0495898, 0.0975862], [0.15995, 0.203782, 0.234512], [0.160692, 0.188941, 0.224111], [0.0402533, 0.0744273, 0.14186], [0.0342438, 0.065472, 0.129046], [0.162035, 0.193596, 0.190048]]),
        ([-0.9, 0.1, 0.2], 1.0, [0.0, 0.5, 1.0], [[0.00719801, 0.0191543, 0.0400134], [0.143238, 0.189251, 0.158877], [0.0110932, 0.02583, 0.0509334], [0.0338978, 0.0642775, 0.0998037], [0.0198915, 0.0409598, 0.0729387], [0.0976731, 0.134272, 0.108117]]),
        ([0.5, -0.6, 0.05], 7.5, [0.2, 0.1, 0.0], [[0.00737211, 0.0114123, 0.0152041], [0.0585165, 0.0352093, 0.0162099], [0.0137796, 0.018219, 0.0204878], [0.0292447, 0.0343021, 0.0317148], [0.0516934, 0.044851, 0.0347859], [0.0143345, 0.0059846, 0.000549424]]),
        ([0.0, 0.01, 1.0], 10.0, [1.0, 1.0, 1.0], [[1.03823, 0.963943, 0.998584], [0.325387, 0.273801, 0.262841], [0.210883, 0.240498, 0.270751], [0.157433, 0.175181, 0.212027], [0.149239, 0.169748, 0.209248], [0.34084, 0.245759, 0.218914]]),
    ];
    for (sun, turbidity, albedo, radiances) in table {
        let sky = sky_of(sun, turbidity, albedo);
        for (d, expected) in directions.into_iter().zip(radiances) {
            let radiance = sky.eval(Vec3::from(d).normalize());
            assert!(close(radiance, Rgb::from(expected), 1e-3), "{sun:?} {d:?}: {radiance}, {expected:?}");
        }
        assert_eq!(sky.eval(Vec3::new(0.6, 0.0, -0.001).normalize()), Rgb::ZERO);
    }
}

#[test]
fn skies_are_stretched_and_extended() {
    let plain = sky_of([0.3, 0.4, 0.7], 3.0, [0.2; 3]);
    let at = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Vec3::new(0.6 * sin, -0.8 * sin, cos)
    };
    let stretched = plain.clone().stretched(1.5, false).unwrap();
    for zenith in [0.0, 20.0, 89.0] {
        let (a, b) = (plain.eval(at(zenith)), stretched.eval(at(1.5 * zenith)));
        assert!(close(a, b, 1e-3), "{zenith}: {a} {b}");
    }
    assert_eq!(stretched.eval(at(136.0)), Rgb::ZERO);
    let extended = plain.clone().stretched(1.0, true).unwrap();
    assert!(close(plain.eval(at(80.0)), extended.eval(at(80.0)), 1e-4));
    // 3x² − 2x³ at a quarter and at half of the way from the nadir to the horizon.
    for (zenith, share) in [(157.5, 0.15625), (135.0, 0.5), (90.01, 1.0)] {
        let (a, b) = (extended.eval(at(89.99427)) * share, extended.eval(at(zenith)));
        assert!(close(a, b, 1e-2), "{zenith}: {a} {b}");
    }
}

#[test]
fn suns_are_those_of_mitsuba() {
    // Mitsuba 3.9.1, `eval` of `sunsky` without sky: sun, irradiance it gives, its diameter in degrees, whether it is
    // complex; radiance at 0, ½, 0.9 and 0.98 of its radius.
    type Row = ([f32; 3], [f32; 3], f32, bool, [[f32; 3]; 4]);
    let (high, low) = ([0.3, 0.4, 0.7], [-0.3, 0.2, 0.5]);
    let (bright, hazy) = ([1.4892, 1.2401, 0.94288], [1.3346, 1.0982, 0.8396]);
    let plain = [21728.9, 18094.6, 13757.7];
    #[rustfmt::skip]
    let table: [Row; 3] = [
        (high, bright, 0.5358, false, [plain; 4]),
        (high, bright, 0.5358, true, [[26196.4, 22637.3, 18210.9], [24597.4, 20981.1, 16539.3], [18619.5, 14938.5, 10660.0], [14245.1, 10687.1, 6836.76]]),
        (low, hazy, 5.0, true, [[269.11, 229.763, 185.855], [253.396, 213.864, 169.99], [192.203, 152.78, 110.161], [147.128, 109.413, 70.7608]]),
    ];
    for (direction, irradiance, degrees, limb, radiances) in table {
        let sun = sun_of(direction, degrees, irradiance, limb);
        let frame = crate::math::Frame::from_normal(Vec3::from(direction).normalize());
        let at = |share: f32| {
            let (sin, cos) = (share * 0.5 * degrees.to_radians()).sin_cos();
            sun.eval(frame.to_world(Vec3::new(0.6 * sin, 0.8 * sin, cos)))
        };
        for (share, expected) in [0.0, 0.5, 0.9, 0.98].into_iter().zip(radiances) {
            assert!(close(at(share), Rgb::from(expected), 2e-2), "{share}: {} {expected:?}", at(share));
        }
        assert_eq!(at(1.01), Rgb::ZERO);
        // Facing it, a surface receives the irradiance whatever the rim.
        assert!(close(sun.integral(), Rgb::from(irradiance), 2e-3), "{}", sun.integral());
    }
    let set = Sun::new(Vec3::X, 0.1, Rgb::ONE, false, Some(Vec3::Z)).unwrap();
    assert!(close(set.integral(), Rgb::splat(0.5), 2e-3));
    for angle in [0.0, -1.0, 1.6, f32::NAN] {
        assert!(Sun::new(Vec3::X, angle, Rgb::ONE, false, None).is_err());
    }
    for irradiance in [-1.0, f32::NAN, f32::INFINITY, 1e38] {
        assert!(Sun::new(Vec3::X, 0.004, Rgb::splat(irradiance), false, None).is_err());
    }
}

#[test]
fn impossible_skies_are_refused() {
    let new = |sun: Vec3, turbidity, albedo: f32, scale| {
        Sky::new(Vec3::Z, sun.normalize(), turbidity, Rgb::splat(albedo), scale)
    };
    assert!(new(Vec3::X, 3.0, 0.2, 1.0).is_ok() && new(Vec3::Z, 10.0, 1.0, 0.0).is_ok());
    assert!(new(Vec3::new(1.0, 0.0, -0.01), 3.0, 0.2, 1.0).unwrap_err().contains("horizon"));
    for (turbidity, albedo, scale) in
        [(0.9, 0.2, 1.0), (3.0, 1.1, 1.0), (3.0, 0.2, -1.0), (f32::NAN, 0.2, 1.0)]
    {
        assert!(new(Vec3::Z, turbidity, albedo, scale).is_err());
    }
    let sky = new(Vec3::Z, 3.0, 0.2, 1.0).unwrap();
    for stretch in [0.9, 2.1, f32::NAN] {
        assert!(sky.clone().stretched(stretch, true).is_err());
    }
}

#[test]
fn projectors_are_those_of_mitsuba() {
    // Mitsuba 3.9.1, `sample_direction` of projectors with scale 2: a constant one with fov 45, a checkerboard with fov
    // 60 and axis y, and the 8 × 5 image with fov 50 across the diagonal.
    let points = [[-0.5, 0.35, 0.25], [-0.3, 0.9, 0.7], [0.6, 0.2, -0.4], [-1.5, 0.5, 0.5]];
    #[rustfmt::skip]
    let table = [
        [[2.506587, 2.005269, 1.503952], [3.892797, 3.114238, 2.335678], [2.481884, 1.985507, 1.48913], [2.398297, 1.918638, 1.438978]],
        [[0.1002635, 0.1503952, 0.4511856], [0.1557119, 0.2335678, 0.7007034], [0.3971015, 0.2481884, 0.04963768], [0.3837275, 0.2398297, 0.04796594]],
        [[0.4243661, 1.002554, 0.4363858], [0.7911081, 0.9504241, 0.1915047], [0.1151973, 1.123295, 0.3838001], [0.8216712, 0.2507915, 0.3702884]],
    ];
    let tan = |degrees: f32| (0.5 * degrees.to_radians()).tan();
    let picture = {
        use crate::texture::{Bitmap, Interpolation, Wrap};
        Bitmap::new(sky(), Interpolation::Bilinear, [Wrap::Clamp; 2], Affine2::IDENTITY).unwrap()
    };
    let textures = [checkerboard(), Texture::Bitmap(picture)];
    let constant = Color::Constant(Rgb::new(5.0, 4.0, 3.0));
    let diagonal = tan(50.0) / (1.0f32 + 0.625 * 0.625).sqrt();
    let projectors =
        [(tan(45.0), 1.0, constant), (tan(60.0), 1.0, Color::Texture(0)), (diagonal, 1.6, Color::Texture(1))];
    for ((half_width, aspect, color), weights) in projectors.into_iter().zip(table) {
        let projector = Projector::new(pose(), half_width, aspect, color, 2.0).unwrap();
        for (p, expected) in points.into_iter().zip(weights) {
            let s = projector.direct(&textures, Vec3::from(p)).unwrap();
            assert!(close(s.weight, Rgb::from(expected), 5e-5), "{p:?}: {} is not {expected:?}", s.weight);
        }
        assert!(projector.direct(&textures, Vec3::new(3.0, 4.0, 6.0)).is_none(), "behind");
        assert!(projector.direct(&textures, Vec3::new(-2.0, 5.0, 0.2)).is_none(), "beside");
    }
    let new = |m, half_width, aspect, scale| Projector::new(m, half_width, aspect, constant, scale);
    assert!(new(Affine3A::from_scale(Vec3::splat(2.0)), 1.0, 1.0, 1.0).is_err());
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(new(pose(), bad, 1.0, 1.0).is_err() && new(pose(), 1.0, bad, 1.0).is_err());
        assert!(bad == 0.0 || new(pose(), 1.0, 1.0, bad).is_err());
    }
}

/// The mean of 1/pdf is the solid angle of all that is sampled, and the pdf integrates to 1.
#[test]
fn skies_and_suns_are_sampled_by_their_pdfs() {
    const N: u64 = 1 << 16;
    let domains = [
        ("sky", TAU64),
        ("hazy sky", TAU64),
        ("stretched sky", TAU64 * (1.0 - (0.7 * PI64).cos())),
        ("extended sky", 2.0 * TAU64),
        ("sun", TAU64 * (1.0 - 0.2679f64.to_radians().cos())),
    ];
    for (name, setup) in every_kind() {
        let Some((_, solid_angle)) = domains.into_iter().find(|d| d.0 == name) else { continue };
        let (mut mean, mut bright) = (0.0f64, 0.0f32);
        for i in 0..N {
            let Some(s) = setup.direct(Vec3::ZERO, &mut sampler(i)) else { continue };
            assert_eq!(s.pdf_w, setup.lights.pdf_background_w(s.wi));
            mean += 1.0 / s.pdf_w as f64 / N as f64;
            bright = bright.max(luminance(s.weight));
        }
        assert!((mean / solid_angle - 1.0).abs() < 1e-2, "{name}: {mean} for {solid_angle}");
        // No sample weighs much more than the mean.
        let total = luminance(setup.lights.power(0)) / setup.lights.world.cross_section();
        assert!(bright < 3.0 * total, "{name}: {bright} for {total}");
        if name == "sun" {
            continue;
        }
        let (nx, ny) = (512, 512);
        let mut sum = 0.0;
        for i in 0..nx * ny {
            let (phi, z) = (
                TAU64 * ((i % nx) as f64 + 0.5) / nx as f64,
                2.0 * ((i / nx) as f64 + 0.5) / ny as f64 - 1.0,
            );
            let (sin, r) = (phi.sin(), (1.0 - z * z).sqrt());
            let d = DVec3::new(r * phi.cos(), r * sin, z).as_vec3();
            sum += setup.lights.pdf_background_w(d) as f64 * 2.0 * TAU64 / (nx * ny) as f64;
        }
        assert!((sum - 1.0).abs() < 1e-2, "{name}: the pdf integrates to {sum}");
    }
}

#[test]
fn beams_are_only_emitted() {
    const N: u64 = 1 << 14;
    let disk = Shape::Disk(Disk::new(tilted(Vec3::splat(0.5)), false).unwrap());
    let ball = Shape::Sphere(Sphere::new(Vec3::new(0.3, 0.1, 2.0), 0.7, Affine3A::IDENTITY, false).unwrap());
    for (shape, color, mean) in [(disk, WHITE, Rgb::ONE), (ball, Color::Texture(0), Rgb::new(0.5, 0.4, 0.5))]
    {
        let area = shape.area();
        let geometry = Geometry::from(vec![shape.clone()]);
        let textures = vec![checkerboard()];
        let light = Light::DirectionalArea { shape: 0, radiance: color };
        let lights = Lights::new(vec![light], &geometry, &textures);
        assert!(close(lights.power(0), mean * area, 2e-2), "{} {}", lights.power(0), mean * area);
        assert!(lights.is_beam(0) && lights.have_beams());
        let setup = Setup { geometry, textures, lights };
        assert!((0..100).all(|i| setup.direct(Vec3::ZERO, &mut sampler(i)).is_none()));
        let up = [Vec3::Z; 2];
        assert_eq!(setup.lights.emitted(0, &setup.textures, &Vec2::ZERO.into(), up, Vec3::Z), Rgb::ZERO);
        let mut sum = Rgb::ZERO;
        for i in 0..N {
            let e = setup.emission(&mut sampler(i)).unwrap();
            sum += e.flux / N as f32;
            // Back from where it started it meets the lamp at right angles.
            let back = hit(&shape, &Ray::new(e.o + e.d, -e.d)).unwrap();
            assert!(back.n_g.dot(e.d) > 0.999 && back.p.distance(e.o) < 1e-4);
        }
        assert!(close(sum, setup.lights.power(0), 1e-2), "{sum} {}", setup.lights.power(0));
    }
    let (position, direction) = (Vec3::new(1.0, 2.0, 3.0), Vec3::NEG_Z);
    let setup = Setup::new(Light::Collimated { position, direction, power: Rgb::new(1.0, 2.0, 3.0) });
    let e = setup.emission(&mut sampler(0)).unwrap();
    assert_eq!((e.o, e.d, e.flux), (position, direction, Rgb::new(1.0, 2.0, 3.0)));
    assert!(setup.direct(Vec3::new(1.0, 2.0, 0.0), &mut sampler(0)).is_none());
}

#[test]
fn impossible_environment_maps_are_refused() {
    let image =
        |width, height, value| Image { width, height, pixels: vec![Rgb::splat(value); width * height] };
    let new = |image, m| Envmap::new(image, 1.0, m);
    assert!(new(image(0, 0, 0.0), Affine3A::IDENTITY).is_err());
    assert!(new(Image { width: 4, height: 4, pixels: vec![] }, Affine3A::IDENTITY).is_err());
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        assert!(new(image(4, 4, bad), Affine3A::IDENTITY).is_err());
    }
    assert!(new(image(4, 4, 1.0), Affine3A::from_scale(Vec3::new(1.0, 2.0, 1.0))).is_err());
    assert!(new(image(4, 4, 1.0), Affine3A::from_scale(Vec3::ZERO)).is_err());
    assert!(new(image(1, 1, 1.0), Affine3A::from_scale(Vec3::splat(-3.0))).is_ok());
}

#[test]
fn environment_maps_are_sampled_by_luminance() {
    let mut spike = Image { width: 64, height: 32, pixels: vec![Rgb::splat(0.01); 64 * 32] };
    spike.pixels[20 * 64 + 63] = Rgb::new(500.0, 400.0, 300.0);
    spike.pixels[5] = Rgb::splat(20.0); // on the pole
    let column = Image { width: 1, height: 2, pixels: vec![Rgb::X, Rgb::ZERO] };
    let maps = [
        Envmap::new(sky(), 1.0, rotated()).unwrap(),
        Envmap::new(spike, 1.0, Affine3A::IDENTITY).unwrap(),
        Envmap::new(column, 1.0, Affine3A::IDENTITY).unwrap(),
    ];
    for (k, map) in maps.iter().enumerate() {
        // Midpoint rule over local bins of longitude and latitude.
        const BINS: (usize, usize) = (32, 16);
        const SUB: usize = 24;
        let direction = |x: f64, y: f64| {
            let (phi, theta) = (TAU64 * x, PI64 * y);
            let l = DVec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin()).as_vec3();
            map.to_world * l
        };
        let (mut pdf, mut radiance) = (vec![0.0f64; BINS.0 * BINS.1], [0.0f64; 3]);
        let (nx, ny) = (BINS.0 * SUB, BINS.1 * SUB);
        for y in 0..ny {
            for x in 0..nx {
                let v = (y as f64 + 0.5) / ny as f64;
                let d = direction((x as f64 + 0.5) / nx as f64, v);
                let dw = TAU64 / nx as f64 * PI64 / ny as f64 * (PI64 * v).sin();
                pdf[y / SUB * BINS.0 + x / SUB] += map.pdf_w(map.eval(d)) as f64 * dw;
                for (sum, c) in radiance.iter_mut().zip(map.eval(d).to_array()) {
                    *sum += c as f64 * dw;
                }
            }
        }
        assert!(
            (pdf.iter().sum::<f64>() - 1.0).abs() < 2e-3,
            "map {k}: the pdf integrates to {}",
            pdf.iter().sum::<f64>()
        );
        let radiance = Rgb::from_array(radiance.map(|c| c as f32));
        assert!(close(map.integral(), radiance, 2e-3), "map {k}: {} is not {radiance}", map.integral());

        const N: u64 = 1 << 16;
        let mut count = vec![0u32; pdf.len()];
        for i in 0..N {
            let d = map.sample(sampler(i).next_2d()).unwrap();
            assert!((d.length() - 1.0).abs() < 1e-5 && map.pdf_w(map.eval(d)) > 0.0);
            let l = map.to_local * d;
            let x = l.x.atan2(-l.z) as f64 / TAU64;
            let y = l.x.hypot(l.z).atan2(l.y) as f64 / PI64;
            let (x, y) = (((x - x.floor()) * BINS.0 as f64) as usize, (y * BINS.1 as f64) as usize);
            count[y.min(BINS.1 - 1) * BINS.0 + x.min(BINS.0 - 1)] += 1;
        }
        // χ² with the few expected in small bins pooled. Stratified samples stay well below its expectation, the
        // number of bins; the bound catches any systematic error of some per mille.
        let (mut chi2, mut pooled) = (0.0, (0.0, 0.0));
        for (&c, &p) in count.iter().zip(&pdf) {
            let (c, expected) = (c as f64, p * N as f64);
            if expected < 20.0 {
                pooled = (pooled.0 + c, pooled.1 + expected);
            } else {
                chi2 += (c - expected).powi(2) / expected;
            }
        }
        assert!(chi2 < pdf.len() as f64, "map {k}: chi² {chi2}");
        assert!(
            (pooled.0 - pooled.1).abs() <= 5.0 * pooled.1.sqrt() + 1.0,
            "map {k}: {pooled:?} in small bins"
        );
    }
    let black =
        Envmap::new(Image { width: 4, height: 4, pixels: vec![Rgb::ZERO; 16] }, 1.0, Affine3A::IDENTITY)
            .unwrap();
    assert!(black.sample(Vec2::splat(0.5)).is_none());
    assert_eq!(black.pdf_w(black.eval(Vec3::X)), 0.0);
}

#[test]
fn pdfs_are_those_of_mitsuba() {
    // Mitsuba 3.9.1, `sample_direction`: shape, from, point, normal, pdf.
    let m = Affine3A::from_rotation_x(30f32.to_radians());
    let sphere = Setup::area(
        Shape::Sphere(Sphere::new(Vec3::new(1.0, 2.0, 3.0), 0.7, Affine3A::IDENTITY, false).unwrap()),
        WHITE,
    );
    for (from, pdf) in [([3.0, 2.0, 1.0], 5.116065), ([1.5, 1.2, 4.5], 1.9568315)] {
        let s = sphere.direct(Vec3::from(from), &mut sampler(3)).unwrap();
        assert!((s.pdf_w / pdf - 1.0).abs() < 1e-5, "{} is not {pdf}", s.pdf_w);
    }
    let rectangle =
        Setup::area(Shape::Mesh(Mesh::rectangle(m * Affine3A::from_scale(Vec3::new(2.0, 1.5, 1.0)))), WHITE);
    let disk = Setup::area(
        Shape::Disk(Disk::new(m * Affine3A::from_scale(Vec3::splat(2.0)), false).unwrap()),
        WHITE,
    );
    let cylinder =
        Cylinder::new(Vec3::ZERO, Vec3::Z, 1.0, m * Affine3A::from_scale(Vec3::splat(2.0)), false).unwrap();
    let cylinder = Setup::area(Shape::Cylinder(cylinder), WHITE);
    #[rustfmt::skip]
    let table = [
        (&rectangle, [3.0, 2.0, 3.0], [-0.8, 0.25980768, 0.15], [0.0, -0.5, 0.86602545], 6.750661),
        (&disk, [3.0, 2.0, 3.0], [-0.7391035, 0.26513094, 0.15307342], [0.0, -0.5, 0.86602545], 6.2602324),
        (&disk, [3.0, 2.0, 3.0], [0.87288594, -0.9479201, -0.5472819], [0.0, -0.5, 0.86602545], 6.5248876),
        (&cylinder, [-1.0, -0.5, -4.0], [-1.6180336, -1.3180742, -0.06817023], [-0.8090169, -0.5090372, -0.29389277], 11.163722),
        (&cylinder, [3.0, 2.0, 3.0], [1.1755704, 0.60125846, 2.1946576], [0.58778524, 0.70062935, 0.40450853], 0.24182425),
    ];
    for (setup, from, p, n, pdf) in table {
        let (from, p, n) = (Vec3::from(from), Vec3::from(p), Vec3::from(n));
        let wi = (p - from).normalize();
        let ours = setup.lights.pdf_emitted_w(0, &setup.geometry, from, wi, p, n);
        assert!((ours / pdf - 1.0).abs() < 1e-5, "{ours} is not {pdf}");
    }
}

#[test]
fn what_is_sampled_is_what_is_hit() {
    let from = Vec3::new(-0.4, 0.3, 0.1);
    for (name, setup) in every_kind() {
        let Light::Area { shape, .. } = setup.lights.lights()[0] else { continue };
        let shape = &setup.geometry.shapes[shape as usize];
        let mut seen = 0;
        for i in 0..2000 {
            let Some(s) = setup.direct(from, &mut sampler(i)) else { continue };
            let target = s.target.unwrap();
            let hit_at = hit(shape, &Ray::new(from, s.wi));
            // Rays that graze the silhouette may miss.
            let Some(point) = hit_at.filter(|h| h.p.distance(target) < 1e-3) else { continue };
            seen += 1;
            let pdf_w = setup.lights.pdf_emitted_w(0, &setup.geometry, from, s.wi, point.p, point.n_g);
            // A grazing ray's hit moves by the rounding of its direction over the cosine.
            let cos = -s.wi.dot(point.n_g);
            let tolerance = 1e-4 + 1e-6 / (cos * cos);
            let off = (pdf_w / s.pdf_w - 1.0).abs();
            assert!(off < tolerance, "{name}: {} sampled, {pdf_w} evaluated, cos {cos}", s.pdf_w);
            let radiance =
                setup.lights.emitted(0, &setup.textures, &point.uv.into(), [point.n_g, point.n_s], -s.wi);
            // A texture's edge may fall between the two.
            let same = close(radiance / pdf_w, s.weight, tolerance);
            assert!(same || name.starts_with("textured"), "{name}: {} for {}", s.weight, radiance / pdf_w);
            // The shadow ray must not find the light itself.
            let (d, t) = ((target - from).normalize(), (target - from).length());
            let shadow = Ray { o: from, t_min: 0.0, d, t_max: t * (1.0 - 4.0 * f32::EPSILON) };
            assert!(hit(shape, &shadow).is_none(), "{name}: in its own shadow at {target}");
        }
        let all = (0..2000).filter(|&i| setup.direct(from, &mut sampler(i)).is_some()).count();
        assert!(seen > 100 && seen * 100 >= all * 98, "{name}: {seen} of {all} found");
    }
}

#[test]
fn photons_start_off_their_own_light() {
    for (name, setup) in every_kind() {
        let Light::Area { shape, .. } = setup.lights.lights()[0] else { continue };
        let concave = name == "sphere inside out";
        for i in 0..2000 {
            let Some(e) = setup.emission(&mut sampler(i)) else { continue };
            let found = hit(&setup.geometry.shapes[shape as usize], &Ray::new(e.o, e.d));
            // A photon inside of a sphere crosses it; the others leave at once.
            let right = if concave { found.is_some_and(|h| h.n_g.dot(e.d) < 0.0) } else { found.is_none() };
            assert!(right, "{name}: photon at {} towards {} meets its own light", e.o, e.d);
        }
    }
}

#[test]
fn irradiance_is_analytic() {
    const N: u64 = 1 << 14;
    let check = |name: &str, mean: f64, expected: f64| {
        assert!((mean / expected - 1.0).abs() < 5e-3, "{name}: {mean} is not {expected}");
    };
    let up = |wi: Vec3| wi.z.max(0.0);

    // A sphere wholly above the horizon: π L sin²θ cosβ.
    for (center, radius) in
        [([0.3, 0.1, 2.0], 0.7), ([30.0, 20.0, 40.0], 0.01), ([2e4, 1e4, 5e4], 0.5), ([0.0, 0.0, 1.001], 1.0)]
    {
        let center = Vec3::from(center);
        let setup = Setup::area(
            Shape::Sphere(Sphere::new(center, radius, Affine3A::IDENTITY, false).unwrap()),
            WHITE,
        );
        let (d, r) = (center.as_dvec3(), radius as f64);
        let expected = PI64 * r * r / d.length_squared() * d.z / d.length();
        check("sphere", setup.mean(Vec3::ZERO, N, up), expected);
        // Solid angle, without cancellation.
        let sin2 = r * r / d.length_squared();
        check("solid angle", setup.mean(Vec3::ZERO, N, |_| 1.0), TAU64 * sin2 / (1.0 + (1.0 - sin2).sqrt()));
    }
    // Inside of an emitting sphere: π L, whatever the place; the solid angle is 4π.
    let bowl =
        Setup::area(Shape::Sphere(Sphere::new(Vec3::ZERO, 2.5, Affine3A::IDENTITY, true).unwrap()), WHITE);
    let p = Vec3::new(0.7, -0.9, 0.4);
    check("bowl", bowl.mean(p, N, up), PI64);
    check("bowl's solid angle", bowl.mean(p, N, |_| 1.0), 2.0 * TAU64);

    // A disk facing the receiver on its axis: π L r²/(r² + h²).
    let facing = Affine3A::from_translation(Vec3::new(0.0, 0.0, 1.5))
        * Affine3A::from_rotation_x(std::f32::consts::PI);
    let disk = Setup::area(
        Shape::Disk(Disk::new(facing * Affine3A::from_scale(Vec3::splat(0.8)), false).unwrap()),
        WHITE,
    );
    check("disk", disk.mean(Vec3::ZERO, N, up), PI64 * 0.64 / (0.64 + 2.25));

    // A rectangle: Lambert's formula, E = L/2 Σ Θ_i Γ_i·n over its edges.
    let mesh = Mesh::rectangle(
        facing * Affine3A::from_scale(Vec3::new(1.0, 0.6, 1.0)) * Affine3A::from_rotation_z(0.3),
    );
    let corners: Vec<DVec3> = [0, 3, 2, 1].iter().map(|&i| mesh.positions[i].as_dvec3()).collect();
    let p = DVec3::new(0.4, -0.3, 0.2);
    let expected: f64 = (0..4)
        .map(|i| {
            let (a, b) = ((corners[i] - p).normalize(), (corners[(i + 1) % 4] - p).normalize());
            0.5 * a.angle_between(b) * a.cross(b).normalize().z
        })
        .sum();
    let rectangle = Setup::area(Shape::Mesh(mesh), WHITE);
    check("rectangle", rectangle.mean(p.as_vec3(), N, up), expected.abs());

    // A constant environment: π L on any side.
    let constant = Setup::new(Light::Constant { radiance: Rgb::ONE });
    check("constant", constant.mean(Vec3::ZERO, N, up), PI64);
}

#[test]
fn photons_carry_the_analytic_power() {
    const N: u64 = 1 << 16;
    for (name, setup) in every_kind() {
        let mut sum = [0.0f64; 3];
        for i in 0..N {
            if let Some(e) = setup.emission(&mut sampler(i)) {
                assert!((e.d.length() - 1.0).abs() < 1e-5 && e.o.is_finite());
                for (s, f) in sum.iter_mut().zip(e.flux.to_array()) {
                    *s += f as f64;
                }
            }
        }
        let mean = Rgb::from_array(sum.map(|s| (s / N as f64) as f32));
        if name == "smooth cube" {
            // Nothing leaves between the horizons of the facet and of the shading normal.
            assert!(mean.x < setup.lights.power(0).x);
            continue;
        }
        assert!(
            close(mean, setup.lights.power(0), 5e-3),
            "{name}: photons carry {mean}, power is {}",
            setup.lights.power(0)
        );
    }
}

#[test]
fn powers_are_analytic() {
    let world = Setup::new(Light::Constant { radiance: Rgb::ONE });
    let r2 = world.geometry.bounds().radius().powi(2);
    let power = |light| Setup::new(light).lights.power(0);
    assert!(close(world.lights.power(0), Rgb::splat(4.0 * PI * PI * r2), 1e-5));
    let e = Rgb::new(1.0, 2.0, 3.0);
    assert!(close(power(Light::Directional { direction: Vec3::Z, irradiance: e }), e * PI * r2, 1e-5));
    assert!(close(power(Light::Point { position: Vec3::ZERO, intensity: e }), e * 4.0 * PI, 1e-5));
    // 2π I ∫ falloff sinθ dθ = 2π I (1 − (sin c − sin b)/(c − b)).
    let (c, b) = (40f32.to_radians(), 20f32.to_radians());
    let expected = Rgb::new(5.0, 4.0, 3.0) * std::f32::consts::TAU * (1.0 - (c.sin() - b.sin()) / (c - b));
    assert!(close(power(spot(pose(), 40.0, 20.0, None)), expected, 1e-3));
    let white = Image { width: 7, height: 4, pixels: vec![e; 28] };
    let map = Light::Envmap(Envmap::new(white, 1.0, rotated()).unwrap());
    assert!(close(power(map), e * (PI * PI * 4.0 * r2), 1e-5));
    let sun = Light::Sun(sun_of([0.4, -0.3, 0.8], 0.5358, e.to_array(), true));
    assert!(close(power(sun), e * PI * r2, 2e-3));
    // π · scale · irradiance · area at distance 1.
    let constant = projector(pose(), 0.6, 1.5, Color::Constant(e));
    assert!(close(power(constant), e * (PI * 2.0 * 1.2 * 0.8), 1e-5));
    let disk = Disk::new(Affine3A::from_scale(Vec3::new(2.0, 3.0, 1.0)), false).unwrap();
    assert!(close(Setup::area(Shape::Disk(disk), WHITE).lights.power(0), Rgb::splat(PI * PI * 6.0), 1e-5));
}

/// Flux through a disk at the origin, from above: counted photons, aimed and not, against direct sampling.
#[test]
fn emission_and_direct_light_agree() {
    const N: u64 = 1 << 18;
    const RADIUS: f32 = 0.8;
    let disk =
        crate::shape::Bounds { min: Vec3::new(-RADIUS, -RADIUS, 0.0), max: Vec3::new(RADIUS, RADIUS, 0.0) };
    // No light's own shape.
    let around = Targets::new([(7, disk, disk.radius())].into_iter());
    for (name, setup) in every_kind() {
        let (mut photons, mut aimed, mut direct) = ([0.0f64; 3], [0.0f64; 3], [0.0f64; 3]);
        for i in 0..N {
            for (targets, sum) in [(&Targets::default(), &mut photons), (&around, &mut aimed)] {
                let Some(e) = setup.aimed_emission(targets, &mut sampler(i)) else { continue };
                let t = -e.o.z / e.d.z;
                if e.d.z < 0.0 && t > 0.0 && (e.o + e.d * t).truncate().length() < RADIUS {
                    for (s, f) in sum.iter_mut().zip(e.flux.to_array()) {
                        *s += f as f64;
                    }
                }
            }
            if i % 4 == 0 {
                let mut s = sampler(i / 4);
                let p = (RADIUS * warp::disk(s.next_2d())).extend(0.0);
                if let Some(d) = setup.direct(p, &mut s) {
                    let irradiance = d.weight * d.wi.z.max(0.0) * (PI * RADIUS * RADIUS * 4.0);
                    for (s, f) in direct.iter_mut().zip(irradiance.to_array()) {
                        *s += f as f64;
                    }
                }
            }
        }
        let mean = |sum: [f64; 3]| Rgb::from_array(sum.map(|s| (s / N as f64) as f32));
        let (photons, aimed, direct) = (mean(photons), mean(aimed), mean(direct));
        assert!(direct.min_element() > 0.0, "{name} does not reach the disk");
        // Some per cent of the photons arrive: three standard deviations, were they independent.
        assert!(close(photons, direct, 0.015), "{name}: {photons} by photons, {direct} directly");
        assert!(close(aimed, direct, 0.015), "{name}: {aimed} by aimed photons, {direct} directly");
    }
}

#[test]
fn every_light_is_reachable_but_black_ones() {
    let point = |i: f32| Light::Point { position: Vec3::Z, intensity: Rgb::splat(i) };
    let lights =
        vec![point(1e6), point(0.0), point(1e-6), Light::Constant { radiance: Rgb::ZERO }, point(1.0)];
    let geometry = Geometry::default();
    let lights = Lights::new(lights, &geometry, &[]);
    let (mut direct, mut emitted) = ([0u32; 5], [0u32; 5]);
    for k in 0..1200 {
        let u = (k as f32 + 0.5) / 1200.0;
        // The weight names the light: I / prob.
        let s = lights.sample_direct(&geometry, &[], Vec3::ZERO, u, Vec2::splat(0.5)).unwrap();
        let light = if s.weight.x > 1e3 { 0 } else { 2 + 2 * (s.weight.x > 1e-3) as usize };
        direct[light] += 1;
        let photon = lights
            .sample_emission(&geometry, &[], &Targets::default(), u, Vec2::splat(0.5), Vec2::splat(0.5))
            .unwrap();
        emitted[photon.light as usize] += 1;
    }
    assert!(direct[2] >= 190 && direct[4] >= 190 && direct[0] >= 790, "{direct:?}");
    assert!(emitted[2] >= 190 && emitted[4] >= 190 && emitted[0] >= 790, "{emitted:?}");
    assert_eq!(lights.for_direct.prob(1), 0.0);
    assert_eq!(lights.for_direct.prob(3), 0.0);
}

#[test]
fn several_environments_are_sampled_together() {
    let geometry = Setup::new(Light::Constant { radiance: Rgb::ONE }).geometry;
    let map = Envmap::new(sky(), 1.5, rotated()).unwrap();
    let all = vec![
        Light::Envmap(map),
        Light::Constant { radiance: Rgb::splat(0.5) },
        Light::Sky(sky_of([0.8, -0.5, 0.2], 2.4, [0.3; 3])),
        Light::Sun(sun_of([0.8, -0.5, 0.2], 0.5358, [20.0, 15.0, 10.0], false)),
    ];
    let lights = Lights::new(all, &geometry, &[]);
    let total = (0..4).fold(Rgb::ZERO, |sum, i| sum + lights.power(i));
    let expected = total / lights.world.cross_section();
    let mut sum = Rgb::ZERO;
    for i in 0..1 << 14 {
        let mut s = sampler(i);
        let d = lights.sample_direct(&geometry, &[], Vec3::ZERO, s.next_1d(), s.next_2d()).unwrap();
        assert_eq!(d.pdf_w, lights.pdf_background_w(d.wi));
        assert!(close(d.weight * d.pdf_w, lights.background(d.wi), 1e-5));
        sum += d.weight / (1 << 14) as f32;
    }
    assert!(close(sum, expected, 5e-3), "{sum} is not {expected}");
}

#[test]
fn empty_scenes_are_lit_without_photons() {
    let geometry = Geometry::default();
    let none = Lights::new(vec![], &geometry, &[]);
    assert!(none.sample_direct(&geometry, &[], Vec3::ZERO, 0.5, Vec2::splat(0.5)).is_none());
    assert!(
        none.sample_emission(&geometry, &[], &Targets::default(), 0.5, Vec2::splat(0.5), Vec2::splat(0.5))
            .is_none()
    );
    assert_eq!(none.background(Vec3::X), Rgb::ZERO);
    let constant = Lights::new(vec![Light::Constant { radiance: Rgb::ONE }], &geometry, &[]);
    assert!(constant.sample_direct(&geometry, &[], Vec3::ZERO, 0.5, Vec2::splat(0.5)).is_some());
    assert!(
        constant
            .sample_emission(&geometry, &[], &Targets::default(), 0.5, Vec2::splat(0.5), Vec2::splat(0.5))
            .is_none()
    );
    assert_eq!(constant.power(0), Rgb::ZERO);
    let degenerate = Mesh { positions: vec![Vec3::ONE; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let flat = Setup::area(Shape::Mesh(degenerate), WHITE);
    assert!(flat.direct(Vec3::ZERO, &mut sampler(0)).is_none() && flat.emission(&mut sampler(0)).is_none());
}
