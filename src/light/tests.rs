use super::*;
use crate::image_io::Image;
use crate::math::{Ray, Sampler, Stream};
use crate::shape::{Cylinder, Disk, Hit, Mesh, Shape, Sphere, SurfacePoint};
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
            geometry: Geometry { shapes: vec![Shape::Mesh(ground)] },
            textures: vec![checkerboard()],
            lights: Lights::default(),
        };
        setup.lights = Lights::new(vec![light], &setup.geometry, &setup.textures);
        setup
    }

    fn area(shape: Shape, radiance: Color) -> Setup {
        let geometry = Geometry { shapes: vec![shape] };
        let textures = vec![checkerboard()];
        let lights = Lights::new(vec![Light::Area { shape: 0, radiance }], &geometry, &textures);
        Setup { geometry, textures, lights }
    }

    fn direct(&self, p: Vec3, s: &mut Sampler) -> Option<DirectSample> {
        let (u_light, u) = (s.next_1d(), s.next_2d());
        self.lights.sample_direct(&self.geometry, &self.textures, p, u_light, u)
    }

    fn emission(&self, s: &mut Sampler) -> Option<EmissionSample> {
        let (u_light, u_pos, u_dir) = (s.next_1d(), s.next_2d(), s.next_2d());
        self.lights.sample_emission(
            &self.geometry,
            &self.textures,
            &Targets::default(),
            u_light,
            u_pos,
            u_dir,
        )
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
        color0: Rgb::new(0.2, 0.3, 0.9),
        color1: Rgb::new(0.8, 0.5, 0.1),
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

/// The nearest hit by brute force.
fn hit(shape: &Shape, ray: &Ray) -> Option<SurfacePoint> {
    let Shape::Mesh(mesh) = shape else {
        let t = shape.intersect(ray)?;
        return Some(shape.point(ray, &Hit { t, u: 0.0, v: 0.0, shape: 0, primitive: 0 }));
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
            nearest = (t, Some(mesh.point(triangle, u as f32, v as f32)));
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
    let disk = Disk::new(Affine3A::from_scale(Vec3::new(2.0, 3.0, 1.0)), false).unwrap();
    assert!(close(Setup::area(Shape::Disk(disk), WHITE).lights.power(0), Rgb::splat(PI * PI * 6.0), 1e-5));
}

/// Flux through a disk at the origin, from above: counted photons against direct sampling.
#[test]
fn emission_and_direct_light_agree() {
    const N: u64 = 1 << 18;
    const RADIUS: f32 = 0.8;
    for (name, setup) in every_kind() {
        let (mut photons, mut direct) = ([0.0f64; 3], [0.0f64; 3]);
        for i in 0..N {
            if let Some(e) = setup.emission(&mut sampler(i)) {
                let t = -e.o.z / e.d.z;
                if e.d.z < 0.0 && t > 0.0 && (e.o + e.d * t).truncate().length() < RADIUS {
                    for (s, f) in photons.iter_mut().zip(e.flux.to_array()) {
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
        let (photons, direct) = (mean(photons), mean(direct));
        assert!(direct.min_element() > 0.0, "{name} does not reach the disk");
        // Some per cent of the photons arrive: three standard deviations, were they independent.
        assert!(close(photons, direct, 0.015), "{name}: {photons} by photons, {direct} directly");
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
    assert_eq!(emitted, [1200, 0, 0, 0, 0]);
    assert_eq!(lights.for_direct.prob(1), 0.0);
    assert_eq!(lights.for_direct.prob(3), 0.0);
}

#[test]
fn several_environments_are_sampled_together() {
    let geometry = Setup::new(Light::Constant { radiance: Rgb::ONE }).geometry;
    let map = Envmap::new(sky(), 1.5, rotated()).unwrap();
    let expected = map.integral() + Rgb::splat(0.5 * 4.0 * PI);
    let all = vec![Light::Envmap(map), Light::Constant { radiance: Rgb::splat(0.5) }];
    let lights = Lights::new(all, &geometry, &[]);
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
