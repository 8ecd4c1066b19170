//! Small scenes: what they load to, and that every mistake names its file and line.

use crate::accel;
use crate::bsdf::{Distribution, WardVariant};
use crate::camera::Projection;
use crate::film::Filter;
use crate::light::{Light, Lights, Targets};
use crate::math::{Ray, Rgb, Sampler, Stream};
use crate::scene::{Material, Scene, SceneDescription, load};
use crate::shape::Shape;
use crate::texture::{Color, Scalar, Texture};
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use std::fs;
use std::path::Path;

const SENSOR: &str = "<sensor type='perspective'/>";

/// Line 1 holds `<scene>` and the sensor, the body begins in line 2.
fn scene_text(body: &str) -> String {
    format!("<scene version='3.0.0'>{SENSOR}\n{body}\n</scene>")
}

fn load_text(text: &str, defines: &[(&str, &str)]) -> Result<SceneDescription> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    fs::write(&path, text).unwrap();
    let defines: Vec<_> = defines.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect();
    load(&path, &defines, None)
}

fn load_body(body: &str) -> Result<SceneDescription> {
    load_text(&scene_text(body), &[])
}

/// The material of a sphere with the given bsdf.
fn material(bsdf: &str) -> Material {
    let scene =
        load_body(&format!("<shape type='sphere'>{bsdf}</shape>")).unwrap_or_else(|e| panic!("{bsdf}: {e}"));
    scene.materials[scene.shape_material[0] as usize].clone()
}

#[test]
fn parameters_are_substituted() {
    let text = scene_text(
        "<default name='r' value='2'/><default name='radius' value='3'/>\
         <shape type='sphere'><float name='radius' value='$radius'/><point name='center' value='$r,0,0'/></shape>",
    );
    let sphere = |defines: &[(&str, &str)]| {
        let scene = load_text(&text, defines).unwrap();
        let Shape::Sphere(s) = scene.geometry.shapes[0].clone() else { panic!() };
        (s.radius, s.center.x, scene.warnings)
    };
    assert_eq!(sphere(&[]), (3.0, 2.0, vec![]));
    assert_eq!(sphere(&[("radius", "5")]), (5.0, 2.0, vec![]));
    let (.., warnings) = sphere(&[("other", "5")]);
    assert!(warnings[0].contains("other"), "{warnings:?}");
    let escaped = load_body("<shape type='sphere' id='\\$x'/><shape type='sphere'><ref id='\\$y'/></shape>");
    assert!(escaped.unwrap_err().to_string().contains("'$y'"));
}

#[test]
fn includes_paths_and_references() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    file(
        "scenes/main.xml",
        "<scene version='3.0.0'><path value='../common'/><default name='m' value='white'/>\
         <include filename='parts/shapes.xml'/><include filename='sensor.xml'/>\
         <bsdf type='diffuse' id='white'/><alias id='white' as='same'/></scene>",
    );
    file(
        "scenes/parts/shapes.xml",
        "<scene version='2.0.0'><shape type='obj'><string name='filename' value='a.obj'/><ref id='$m'/></shape>\
         <shape type='ply'><string name='filename' value='b.ply'/><ref id='same'/></shape></scene>",
    );
    file("scenes/sensor.xml", "<sensor version='3.0.0' type='perspective'/>");
    file("common/a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    file(
        "scenes/b.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0 1 0 0 0 1 0 3 0 1 2\n",
    );
    let scene = load(&folder.path().join("scenes/main.xml"), &[], None).unwrap();
    assert_eq!(scene.geometry.shapes.len(), 2);
    assert_eq!(scene.shape_material, [0, 0]);
}

#[test]
fn transforms_compose_in_order() {
    // scale, rotate 90° about y, translate; the expected points follow from doing so by hand.
    let scene = load_body(
        "<shape type='rectangle'><transform name='to_world'><scale x='2' y='3'/><rotate y='1' angle='90'/>\
         <translate value='1, 2, 3'/></transform></shape>\
         <shape type='rectangle'><transform name='to_world'><matrix value='0 0 1 1  0 3 0 2  -2 0 0 3  0 0 0 1'/>\
         </transform></shape>",
    );
    for shape in scene.unwrap().geometry.shapes {
        let Shape::Mesh(mesh) = shape else { panic!() };
        assert!(mesh.positions[0].distance(Vec3::new(1.0, -1.0, 5.0)) < 1e-6, "{:?}", mesh.positions);
        assert!(mesh.area_vector(0).normalize().distance(Vec3::X) < 1e-6);
    }
}

/// tan(fov_x / 2) of Mitsuba 3.9.1's `parse_fov` at aspect 4:3.
#[test]
fn fields_of_view() {
    let half_width = |sensor: &str| {
        let text = format!(
            "<scene version='3.0.0'><sensor type='perspective'>{sensor}<transform name='to_world'>\
             <lookat origin='1,2,3' target='1,2,-5' up='0,1,0'/></transform></sensor><shape type='sphere'/></scene>"
        );
        let camera = load_text(&text, &[]).unwrap().camera;
        assert!(camera.to_world.transform_vector3(Vec3::Z).distance(Vec3::NEG_Z) < 1e-6);
        assert!(camera.to_world.transform_vector3(Vec3::X).distance(Vec3::NEG_X) < 1e-6);
        assert_eq!(camera.clip, (0.0, f32::INFINITY));
        camera.half_width
    };
    let tan = |degrees: f32| (0.5 * degrees.to_radians()).tan();
    let fov = |axis: &str| {
        half_width(&format!("<float name='fov' value='40'/><string name='fov_axis' value='{axis}'/>"))
    };
    for (found, expected) in [
        (fov("x"), tan(40.0)),
        (fov("larger"), tan(40.0)),
        (fov("y"), tan(40.0) * 4.0 / 3.0),
        (fov("smaller"), tan(40.0) * 4.0 / 3.0),
        (fov("diagonal"), tan(40.0) * 0.8),
        (half_width(""), tan(38.180_75)),
        (half_width("<string name='focal_length' value='35 mm'/>"), 43.266_615 / 70.0 * 0.8),
    ] {
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }
}

#[test]
fn films_and_samplers() {
    let text = "<scene version='3.0.0'><sensor type='thinlens'><float name='aperture_radius' value='.1'/>\
        <float name='focus_distance' value='3'/><film type='hdrfilm'><integer name='width' value='40'/>\
        <integer name='height' value='20'/><integer name='crop_offset_x' value='5'/>\
        <integer name='crop_width' value='30'/><string name='pixel_format' value='rgba'/>\
        <rfilter type='tent'><float name='radius' value='2'/></rfilter></film>\
        <sampler type='multijitter'><integer name='sample_count' value='9'/><float name='odd' value='1'/></sampler>\
        </sensor><sensor type='perspective'/><shape type='sphere'/></scene>";
    let scene = load_text(text, &[]).unwrap();
    assert_eq!((scene.film.size, scene.film.crop), ((40, 20), (5, 0, 30, 20)));
    assert_eq!(scene.film.filter, Filter::Tent { radius: 2.0 });
    assert_eq!((scene.camera.aperture_radius, scene.camera.focus_distance), (0.1, 3.0));
    assert_eq!(scene.sample_count, 9);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.xml");
    fs::write(&path, text).unwrap();
    let scene = load(&path, &[], Some((10, 30))).unwrap();
    assert_eq!((scene.film.size, scene.film.crop), ((10, 30), (0, 0, 10, 30)));
    assert!((scene.camera.aspect - 1.0 / 3.0).abs() < 1e-6);
    assert!(matches!(load(&path, &[], Some((0, 30))), Err(Error::Usage(_))));
    let defaults = load_body("<shape type='sphere'/>").unwrap();
    assert_eq!((defaults.film.size, defaults.sample_count), ((768, 576), 4));
    assert_eq!(defaults.film.filter, Filter::Gaussian { stddev: 0.5 });
}

#[test]
fn integrators_are_unwrapped() {
    let scene = load_body(
        "<shape type='sphere'/><integrator type='moment'><integrator type='direct'>\
         <integer name='shading_samples' value='4'/><boolean name='hide_emitters' value='true'/>\
         </integrator></integrator>",
    )
    .unwrap();
    assert_eq!(scene.integrator, "direct");
    let params: Vec<_> =
        scene.integrator_params.iter().map(|p| (p.name.as_str(), p.value.as_str(), p.line)).collect();
    assert_eq!(params, [("hide_emitters", "true", 2), ("max_depth", "2", 2)]);
    assert!(scene.warnings[0].contains("shading_samples"));
}

#[test]
fn materials() {
    let eta_is = |material: Material, expected: f32| match material {
        Material::Dielectric { eta, .. } | Material::ThinDielectric { eta, .. } => {
            assert!((eta - expected).abs() < 1e-6, "{eta} {expected}");
        }
        other => panic!("{other:?}"),
    };
    eta_is(material("<bsdf type='dielectric'/>"), 1.5046 / 1.000_277);
    eta_is(
        material(
            "<bsdf type='dielectric'><float name='int_ior' value='1.5'/><float name='ext_ior' value='1'/></bsdf>",
        ),
        1.5,
    );
    eta_is(
        material("<bsdf type='thindielectric'><string name='int_ior' value='Diamond'/></bsdf>"),
        2.419 / 1.000_277,
    );
    let Material::Conductor { eta, k, .. } =
        material("<bsdf type='conductor'><string name='material' value='Au'/></bsdf>")
    else {
        panic!()
    };
    // Mitsuba 3.9.1, scalar_rgb.
    let close = |c: Color, rgb: [f32; 3]| match c {
        Color::Constant(c) => assert!(c.distance(Rgb::from_array(rgb)) < 1e-3, "{c}"),
        Color::Texture(_) => panic!(),
    };
    close(eta, [0.143_036, 0.375_307, 1.442_045]);
    close(k, [3.982_997, 2.385_557, 1.603_359]);
    assert!(matches!(
        material("<bsdf type='conductor'/>"),
        Material::Conductor { eta: Color::Constant(Rgb::ZERO), k: Color::Constant(Rgb::ONE), .. }
    ));
    let Material::RoughConductor { roughness, .. } = material(
        "<bsdf type='roughconductor'><string name='distribution' value='ggx'/><float name='alpha_u' value='.1'/>\
         <float name='alpha_v' value='.3'/></bsdf>",
    ) else {
        panic!()
    };
    assert_eq!(roughness.distribution, Distribution::Ggx);
    assert_eq!((roughness.alpha_u, roughness.alpha_v), (Scalar::Constant(0.1), Scalar::Constant(0.3)));
    assert!(material("<bsdf type='roughplastic'><float name='alpha' value='.2'/></bsdf>").lobes().smooth);
    assert!(matches!(material("<bsdf type='plastic'/>"), Material::Plastic { nonlinear: false, .. }));
    let principled = |inside: &str| material(&format!("<bsdf type='principled'>{inside}</bsdf>"));
    let Material::Principled(p) = principled("<float name='metallic' value='.3'/>") else { panic!() };
    assert_eq!((p.metallic, p.roughness), (Scalar::Constant(0.3), Scalar::Constant(0.5)));
    // Half of 8 % at normal incidence.
    assert!((p.eta - 1.5).abs() < 1e-6);
    assert!(!principled("<float name='spec_trans' value='0'/>").transmits());
    let glass = principled("<float name='spec_trans' value='1'/><float name='eta' value='1'/>");
    assert!(glass.transmits() && matches!(glass, Material::Principled(p) if p.eta == 1.001));
    let both = "<float name='eta' value='1.5'/><float name='specular' value='.5'/>";
    for wrong in [both, "<float name='metallic' value='2'/>", "<float name='specular' value='13'/>"] {
        let shape = format!("<shape type='cube'><bsdf type='principled'>{wrong}</bsdf></shape>");
        assert!(load_body(&shape).is_err(), "{wrong}");
    }
    let thin = "<bsdf type='principledthin'><float name='diff_trans' value='1.5'/></bsdf>";
    let Material::PrincipledThin(p) = material(thin) else { panic!() };
    assert_eq!((p.diff_trans, p.eta), (Scalar::Constant(1.5), Scalar::Constant(1.5)));
    // Of Mitsuba 0.6.
    let ward = "<bsdf type='ward'><float name='alpha' value='.3'/><float name='alpha_v' value='.2'/></bsdf>";
    let Material::Ward { alpha_u, alpha_v, variant: WardVariant::Balanced, .. } = material(ward) else {
        panic!()
    };
    assert_eq!((alpha_u, alpha_v), (Scalar::Constant(0.3), Scalar::Constant(0.2)));
    let Material::Phong { specular, exponent, .. } = material("<bsdf type='phong'/>") else { panic!() };
    assert_eq!((specular, exponent), (Color::Constant(Rgb::splat(0.2)), Scalar::Constant(30.0)));
    for name in ["reflectance", "diffuse_reflectance"] {
        let rough = material(&format!("<bsdf type='roughdiffuse'><rgb name='{name}' value='.3'/></bsdf>"));
        let Material::RoughDiffuse { reflectance, fast: false, .. } = rough else { panic!() };
        assert_eq!(reflectance, Color::Constant(Rgb::splat(0.3)));
    }
    assert!(material("<bsdf type='difftrans'/>").transmits());
    assert!(matches!(material("<bsdf type='null'/>"), Material::Null));
    let masked = "<bsdf type='mask'><float name='opacity' value='.2'/><bsdf type='twosided'><bsdf type='diffuse'/>\
                  <bsdf type='conductor'/></bsdf></bsdf>";
    let Material::Mask { opacity: Scalar::Constant(0.2), nested } = material(masked) else { panic!() };
    assert!(matches!(*nested, Material::TwoSided { back: Some(_), .. }));
    // Of a twosided inside another both show the front, however often they are named.
    let mut tree =
        String::from("<bsdf type='twosided' id='b0'><bsdf type='diffuse'/><bsdf type='conductor'/></bsdf>");
    for i in 1..30 {
        let inner = format!("<ref id='b{}'/>", i - 1);
        tree += &format!("<bsdf type='twosided' id='b{i}'>{inner}{inner}</bsdf>");
    }
    let scene = load_body(&format!("{tree}<shape type='cube'><ref id='b29'/></shape>")).unwrap();
    let Some(Material::TwoSided { front, back: Some(back) }) = scene.materials.last() else { panic!() };
    assert!(matches!((&**front, &**back), (Material::Diffuse { .. }, Material::Diffuse { .. })));
    let grey = Color::Constant(Rgb::splat(0.5));
    assert!(matches!(material(""), Material::Diffuse { reflectance } if reflectance == grey));
    // As in Mitsuba, a lamp that is not told otherwise reflects nothing.
    let black = Color::Constant(Rgb::ZERO);
    let lamp = material("<emitter type='area'/>");
    assert!(matches!(lamp, Material::Diffuse { reflectance } if reflectance == black));
}

#[test]
fn colours() {
    let reflectance = |value: &str| match material(&format!("<bsdf type='diffuse'>{value}</bsdf>")) {
        Material::Diffuse { reflectance: Color::Constant(c) } => c,
        other => panic!("{other:?}"),
    };
    let is = |value: &str, expected: [f32; 3]| {
        let c = reflectance(value);
        assert!(c.distance(Rgb::from_array(expected)) < 1e-3, "{value}: {c}");
    };
    is("<rgb name='reflectance' value='.1, .2 .3'/>", [0.1, 0.2, 0.3]);
    is("<rgb name='reflectance' value='.1'/>", [0.1; 3]);
    is("<rgb name='reflectance' value='#ff8000'/>", [1.0, 0.215_86, 0.0]);
    is("<float name='reflectance' value='.3'/>", [0.3; 3]);
    is("<spectrum name='reflectance' value='.3'/>", [0.3; 3]);
    is(
        "<spectrum name='reflectance' value='400:0.78, 500:0.78, 600:0.78, 700:0.78'/>",
        [0.776_37, 0.779_81, 0.776_03],
    );
    is("<spectrum name='reflectance' type='uniform'><float name='value' value='.4'/></spectrum>", [0.4; 3]);
    let irregular = "<spectrum name='reflectance' type='irregular'><string name='wavelengths' value='400,700'/>\
                     <string name='values' value='.1,.9'/></spectrum>";
    is(irregular, [0.742_85, 0.481_14, 0.208_32]);
}

#[test]
fn emitters() {
    let scene = load_body(
        "<emitter type='point'><point name='position' x='1' y='2' z='3'/><rgb name='intensity' value='300'/></emitter>\
         <emitter type='directional'><vector name='direction' value='0,0,-2'/></emitter>\
         <emitter type='constant'><spectrum name='radiance' value='5'/></emitter>\
         <emitter type='spot'><float name='cutoff_angle' value='30'/><transform name='to_world'>\
         <lookat origin='0,0,0' target='0,0,1' up='0,1,0'/></transform></emitter>\
         <shape type='disk'><emitter type='area'><spectrum name='radiance' type='d65'><float name='scale' value='3'/>\
         </spectrum></emitter></shape>",
    )
    .unwrap();
    let [
        Light::Point { position, intensity },
        Light::Directional { direction, irradiance },
        Light::Constant { radiance },
        Light::Spot(_),
        Light::Area { shape: 0, radiance: Color::Constant(area) },
    ] = &scene.lights[..]
    else {
        panic!("{:?}", scene.lights)
    };
    assert_eq!((*position, *intensity), (Vec3::new(1.0, 2.0, 3.0), Rgb::splat(300.0)));
    assert_eq!((*direction, *irradiance), (Vec3::NEG_Z, Rgb::ONE));
    // An equal-energy spectrum is pinkish in sRGB (Mitsuba 3.9.1).
    assert!(radiance.distance(Rgb::new(6.023_97, 4.741_455, 4.544_58)) < 1e-3);
    assert_eq!(*area, Rgb::splat(3.0));
}

#[test]
fn other_emitters() {
    let scene = load_body(
        "<emitter type='projector'><float name='scale' value='2'/><float name='fov' value='90'/></emitter>\
         <emitter type='collimated'><rgb name='power' value='1 2 3'/><transform name='to_world'>\
         <rotate y='1' angle='90'/><translate x='4'/></transform></emitter>\
         <shape type='disk'><emitter type='directionalarea'><rgb name='radiance' value='2'/></emitter></shape>",
    )
    .unwrap();
    let [
        Light::Projector(_),
        Light::Collimated { position, direction, power },
        Light::DirectionalArea { shape: 0, radiance },
    ] = &scene.lights[..]
    else {
        panic!("{:?}", scene.lights)
    };
    assert_eq!((*position, *power), (Vec3::new(4.0, 0.0, 0.0), Rgb::new(1.0, 2.0, 3.0)));
    assert!(direction.distance(Vec3::X) < 1e-6);
    assert_eq!(*radiance, Color::Constant(Rgb::splat(2.0)));
    // π · scale · area at distance 1.
    let lights = Lights::new(scene.lights, &scene.geometry, &scene.textures);
    assert!((lights.power(0).x / (std::f32::consts::PI * 2.0 * 4.0) - 1.0).abs() < 1e-5);
}

/// The lights, seen from a scene without shapes.
fn shining(lights: Vec<Light>) -> impl Fn([f32; 3]) -> Rgb {
    let lights = Lights::new(lights, &Default::default(), &[]);
    move |d| lights.background(Vec3::from(d).normalize())
}

/// Where the only light is.
fn towards(lights: Vec<Light>) -> Vec3 {
    let lights = Lights::new(lights, &Default::default(), &[]);
    let sample = lights.sample_direct(&Default::default(), &[], Vec3::ZERO, 0.5, Vec2::splat(1e-6));
    sample.unwrap().wi
}

fn near(a: Rgb, b: [f32; 3], relative: f32, what: &str) {
    let b = Rgb::from(b);
    assert!(((a - b).abs() / b).max_element() < relative, "{what}: {a} is not {b}");
}

#[test]
fn skies() {
    let emitter = |parameters: &str| {
        let shape = "<shape type='cube'/>";
        load_body(&format!("<emitter type='sunsky'>{parameters}</emitter>{shape}")).unwrap()
    };
    let lights = |parameters: &str| emitter(parameters).lights;
    // Mitsuba 3.9.1, whose single precision puts the sun off by up to 0.2°: the sun's direction, and radiance in
    // these.
    let directions = [[0.0, 0.0, 1.0], [0.3, 0.9, 0.4], [-0.5, 0.6, 0.1]];
    let vienna = "<integer name='year' value='2024'/><integer name='month' value='1'/><integer name='day' value='5'/>\
                  <float name='hour' value='10'/><float name='minute' value='30'/><float name='second' value='12'/>\
                  <float name='latitude' value='48.2'/><float name='longitude' value='16.4'/>\
                  <float name='timezone' value='1'/>";
    #[rustfmt::skip]
    let table = [
        ("", [0.0513854, 0.691748, 0.720308], [[0.0243511, 0.0423087, 0.0855948], [0.125484, 0.17138, 0.239736], [0.135496, 0.195307, 0.270443]]),
        (vienna, [0.892933, -0.350869, 0.282068], [[0.0106195, 0.0218926, 0.041469], [0.0365313, 0.060778, 0.088602], [0.099652, 0.139721, 0.154315]]),
    ];
    for (parameters, sun, expected) in table {
        let all = lights(parameters);
        assert!(matches!(all[..], [Light::Sky(_), Light::Sun(_)]), "{all:?}");
        let radiance = shining(all);
        for (d, expected) in directions.into_iter().zip(expected) {
            near(radiance(d), expected, 0.02, "sky");
        }
        let only = format!("{parameters}<float name='sky_scale' value='0'/>");
        let off = towards(lights(&only)).angle_between(Vec3::from(sun)).to_degrees();
        assert!(off < 0.4, "the sun is {off}° off");
    }
    // Zenith and sun turn with the sky, but a given direction is the world's.
    let turn = "<transform name='to_world'><rotate x='1' angle='-90'/></transform>";
    let parameters = "<float name='turbidity' value='5'/><rgb name='albedo' value='.1 .5 .9'/>";
    let (flat, turned) = (
        shining(lights(&format!("{parameters}<vector name='sun_direction' value='.3,.4,.5'/>"))),
        shining(lights(&format!("{parameters}<vector name='sun_direction' value='3,5,-4'/>{turn}"))),
    );
    for d in [[0.1, 0.2, 0.5], [-0.4, 0.1, 0.1], [0.3, 0.4, 0.501]] {
        near(turned([d[0], d[2], -d[1]]), flat(d).to_array(), 1e-3, "turned");
    }
    assert_eq!(flat([0.1, 0.2, -0.1]), Rgb::ZERO);
    // Mitsuba 3.9.1 at the centre of a simple and of a complex sun.
    let sun = |more: &str| {
        let up = "<vector name='sun_direction' value='.3,.4,.7'/><float name='sky_scale' value='0'/>";
        shining(lights(&format!("{up}{more}")))([0.3, 0.4, 0.7])
    };
    near(sun(""), [21728.9, 18094.6, 13757.7], 0.005, "sun");
    near(sun("<boolean name='complex_sun' value='true'/>"), [26196.4, 22637.3, 18210.9], 0.01, "complex sun");
    near(
        sun("<float name='sun_aperture' value='5.358'/><float name='sun_scale' value='10'/>"),
        [2172.89, 1809.46, 1375.77],
        0.005,
        "wide sun",
    );
    let night = emitter("<float name='hour' value='23'/>");
    assert!(night.lights.is_empty() && night.warnings[0].contains("horizon"), "{:?}", night.warnings);
}

/// Lights of a file of Mitsuba 0.6, the emitter in line 2.
fn old_lights(emitter: &str) -> Result<Vec<Light>> {
    let text = scene_text(&format!("{emitter}<shape type='cube'/>")).replace("3.0.0", "0.6.0");
    load_text(&text, &[]).map(|scene| scene.lights)
}

#[test]
fn old_skies() {
    let lights = |plugin: &str, parameters: &str| {
        old_lights(&format!("<emitter type='{plugin}'>{parameters}</emitter>")).unwrap()
    };
    // The same sun as above, but up is y and north −z.
    let off =
        towards(lights("sun", "")).angle_between(Vec3::new(-0.691748, 0.720308, 0.0513854)).to_degrees();
    assert!(off < 0.4, "the sun is {off}° off");
    // The same sky.
    let (old, new) = (
        shining(lights("sky", "<vector name='sunDirection' value='3,5,-4'/><float name='scale' value='2'/>")),
        load_body(
            "<emitter type='sunsky'><vector name='sun_direction' value='3,4,5'/><float name='albedo' value='.2'/>\
             <float name='sun_scale' value='0'/></emitter><shape type='cube'/>",
        ),
    );
    let new = shining(new.unwrap().lights);
    for d in [[0.1, 0.2, 0.5], [-0.4, 0.1, 0.1], [0.3, 0.4, 0.5]] {
        near(old([d[0], d[2], -d[1]]), (2.0 * new(d)).to_array(), 2e-3, "old");
    }
    assert_eq!(old([0.1, -0.1, 0.2]), Rgb::ZERO);
    let extended =
        shining(lights("sky", "<boolean name='extend' value='true'/><integer name='resolution' value='9'/>"));
    assert!(extended([0.1, -0.1, 0.2]).min_element() > 0.0);
    // The formulas of Preetham et al., evaluated independently: 30° and 75° from the zenith.
    let sun = |y: f32, more: &str| {
        let x = (1.0 - y * y).sqrt();
        let direction = format!("<vector name='sunDirection' value='{x},{y},0'/>{more}");
        (lights("sun", &direction), [x, y, 0.0])
    };
    let (high, d) = sun(0.866_025_4, "");
    near(shining(high)(d), [20440.21, 17155.78, 14480.537], 0.003, "sun at 30°");
    let (low, d) =
        sun(0.258_819_05, "<float name='turbidity' value='2.5'/><float name='sunRadiusScale' value='2'/>");
    near(shining(low)(d), [12064.11 / 4.0, 8482.443 / 4.0, 4853.1235 / 4.0], 0.003, "sun at 75°");
    let (point, d) = sun(0.866_025_4, "<float name='sunRadiusScale' value='0'/>");
    let [Light::Directional { direction, irradiance }] = &point[..] else { panic!("{point:?}") };
    assert!(direction.distance(-Vec3::from(d)) < 1e-6);
    near(*irradiance, [20440.21 * 6.868e-5, 17155.78 * 6.868e-5, 14480.537 * 6.868e-5], 0.005, "point");
    // The horizon, and with it the sun, at twice the angle.
    let (stretched, _) = sun(0.866_025_4, "<float name='stretch' value='2'/>");
    assert!(towards(stretched).distance(Vec3::new(0.866_025_4, 0.5, 0.0)) < 0.01);
    let both = lights("sunsky", "<float name='scale' value='2'/><float name='sunScale' value='0'/>");
    assert!(matches!(both[..], [Light::Sky(_)]));
    assert!(matches!(lights("sunsky", "")[..], [Light::Sky(_), Light::Sun(_)]));
    for (parameters, word) in
        [("<float name='hour' value='23'/>", "horizon"), ("<float name='stretch' value='3'/>", "stretch")]
    {
        match old_lights(&format!("<emitter type='sunsky'>{parameters}</emitter>")) {
            Err(Error::Scene { message, line: 2, .. }) => assert!(message.contains(word), "{message}"),
            other => panic!("{parameters}: {other:?}"),
        }
    }
}

#[test]
fn orthographic_views() {
    let scene = load_text(
        "<scene version='3.0.0'><sensor type='orthographic'><float name='near_clip' value='0.5'/>\
         <transform name='to_world'><scale x='3' y='3'/><lookat origin='0,0,5' target='0,0,0' up='0,1,0'/></transform>\
         <film type='hdrfilm'><integer name='width' value='200'/><integer name='height' value='100'/></film></sensor>\
         <shape type='cube'/></scene>",
        &[],
    )
    .unwrap();
    let camera = scene.camera;
    assert_eq!((camera.projection, camera.clip), (Projection::Orthographic, (0.5, f32::INFINITY)));
    let ray = camera.ray(Vec2::ZERO, Vec2::ZERO);
    assert!(
        ray.o.distance(Vec3::new(-3.0, 1.5, 5.0)) < 1e-5 && ray.d.distance(Vec3::NEG_Z) < 1e-6,
        "{ray:?}"
    );
}

#[test]
fn textures_are_shared() {
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::from_fn(2, 1, |x, _| image::Rgb([188 * x as u8, 0, 0]))
        .save(folder.path().join("t.png"))
        .unwrap();
    let path = folder.path().join("s.xml");
    let shape = "<shape type='sphere'><bsdf type='diffuse'><ref id='t' name='reflectance'/></bsdf></shape>";
    let text = scene_text(&format!(
        "<texture type='bitmap' id='t'><string name='filename' value='t.png'/><string name='filter_type' value='nearest'/>\
         <transform name='to_uv'><scale x='2'/></transform></texture>{shape}{shape}<shape type='sphere'>\
         <bsdf type='mask'><texture name='opacity' type='checkerboard'><float name='color0' value='.1'/>\
         <float name='color1' value='.9'/></texture><bsdf type='diffuse'/></bsdf></shape>"
    ));
    fs::write(&path, text).unwrap();
    let scene = load(&path, &[], None).unwrap();
    assert_eq!(scene.textures.len(), 2);
    let decoded = scene.textures[0].eval(&[], &Vec2::new(0.3, 0.0).into()).x;
    assert!((decoded - 0.502_89).abs() < 1e-4, "{decoded}");
    // Mitsuba 3.9.1 gives 0.9 here where it reads a checkerboard as a number.
    let Texture::Checkerboard { color0, .. } = &scene.textures[1] else { panic!() };
    assert_eq!(*color0, Color::Constant(Rgb::splat(0.9)));
}

/// Mistakes in line 2, and a word that the message must hold.
const MISTAKES: [(&str, &str); 55] = [
    ("<shape type='sphere'><bsdf type='foo'/></shape>", "unknown bsdf plugin 'foo'"),
    ("<shape type='foo'/>", "unknown shape plugin 'foo'"),
    ("<emitter type='foo'/>", "unknown emitter plugin 'foo'"),
    ("<shape type='sphere'><string name='radius' value='1'/></shape>", "type float, not string"),
    ("<shape type='sphere'><float name='radius' value='x'/></shape>", "'x'"),
    ("<shape type='sphere'><float name='radius' value='nan'/></shape>", "'nan'"),
    ("<shape type='sphere'><float name='radius' value='-1'/></shape>", "radius"),
    ("<shape type='sphere'><integer name='radius' value='1.5'/></shape>", "integer"),
    ("<shape type='sphere'><boolean name='flip_normals' value='yes'/></shape>", "true nor false"),
    ("<shape type='sphere'><float name='radius' value='$r'/></shape>", "$r"),
    (
        "<shape type='sphere'><float name='radius' value='1'/><float name='radius' value='1'/></shape>",
        "twice",
    ),
    ("<shape type='sphere'><float value='1'/></shape>", "'name'"),
    ("<shape type='sphere'><float name='radius' value='1' unit='m'/></shape>", "'unit'"),
    ("<shape type='sphere'><ref id='x'/></shape>", "'x'"),
    ("<shape type='sphere'><bsdf type='diffuse'/><bsdf type='diffuse'/></shape>", "only one bsdf"),
    ("<shape type='sphere'><medium name='interior' type='homogeneous'/></shape>", "media"),
    ("<shape type='sphere'/><sphere/>", "<sphere>"),
    ("<shape id='a' type='sphere'/><shape id='a' type='sphere'/>", "used twice"),
    ("<shape type='obj'/>", "'filename'"),
    ("<shape type='obj'><string name='filename' value='no.obj'/></shape>", "'no.obj'"),
    ("<include filename='no.xml'/>", "'no.xml'"),
    ("<path value='no'/>", "'no'"),
    ("<alias id='no' as='b'/>", "'no'"),
    ("<translate x='1'/>", "<transform>"),
    ("<shape type='cube'><transform name='to_world'><scale value='0'/></transform></shape>", "singular"),
    ("<shape type='cube'><transform name='to_world'><matrix value='1 2'/></transform></shape>", "9 or 16"),
    ("<shape type='cube'><transform name='to_world'><rotate angle='1'/></transform></shape>", "axis"),
    (
        "<shape type='cube'><transform name='to_world'><lookat origin='0 0 0' target='0 0 0'/></transform></shape>",
        "lookat",
    ),
    ("<bsdf type='twosided' id='a'><ref id='a'/></bsdf><shape type='cube'><ref id='a'/></shape>", "itself"),
    ("<shape type='cube'><bsdf type='twosided'><bsdf type='dielectric'/></bsdf></shape>", "two sides"),
    ("<shape type='cube'><bsdf type='mask'/></shape>", "bsdf inside"),
    ("<shape type='cube'><bsdf type='diffuse'><rgb name='reflectance' value='2'/></bsdf></shape>", "0..1"),
    (
        "<shape type='cube'><bsdf type='diffuse'><rgb name='reflectance' value='1 2'/></bsdf></shape>",
        "one or three",
    ),
    (
        "<shape type='cube'><bsdf type='diffuse'><string name='reflectance' value='a'/></bsdf></shape>",
        "not string",
    ),
    (
        "<shape type='cube'><bsdf type='diffuse'><spectrum name='reflectance' value='400:1'/></bsdf></shape>",
        "two",
    ),
    (
        "<shape type='cube'><bsdf type='diffuse'><spectrum name='reflectance' filename='no.spd'/></bsdf></shape>",
        "no.spd",
    ),
    ("<shape type='cube'><bsdf type='conductor'><string name='material' value='X'/></bsdf></shape>", "'X'"),
    (
        "<shape type='cube'><bsdf type='dielectric'><string name='int_ior' value='jelly'/></bsdf></shape>",
        "'jelly'",
    ),
    (
        "<shape type='cube'><bsdf type='roughconductor'><float name='alpha_u' value='1'/></bsdf></shape>",
        "alpha_v",
    ),
    (
        "<shape type='cube'><bsdf type='roughconductor'><string name='distribution' value='phong'/></bsdf></shape>",
        "beckmann",
    ),
    (
        "<shape type='cube'><emitter type='area'><rgb name='radiance' value='-1'/></emitter></shape>",
        "negative",
    ),
    ("<integrator type='moment'/>", "no integrator"),
    ("<emitter type='sky'/>", "'sunsky'"),
    ("<emitter type='timed_sunsky'/>", "'sunsky'"),
    ("<emitter type='sunsky'><float name='turbidity' value='0.5'/></emitter>", "turbidity"),
    ("<emitter type='sunsky'><float name='albedo' value='1.5'/></emitter>", "albedo"),
    ("<emitter type='sunsky'><float name='sun_aperture' value='180'/></emitter>", "180"),
    ("<emitter type='sunsky'><float name='sky_scale' value='-1'/></emitter>", "sky_scale"),
    ("<emitter type='sunsky'><integer name='year' value='3000000000'/></emitter>", "year"),
    ("<emitter type='sunsky'><vector name='sun_direction' value='0'/></emitter>", "zero"),
    (
        "<emitter type='sunsky'><vector name='sun_direction' value='0,0,1'/><float name='hour' value='3'/></emitter>",
        "hour",
    ),
    ("<emitter type='sunsky'><transform name='to_world'><scale x='2'/></transform></emitter>", "stretched"),
    ("<emitter type='projector'><float name='fov' value='180'/></emitter>", "180"),
    (
        "<emitter type='projector'><transform name='to_world'><scale value='2'/></transform></emitter>",
        "scale",
    ),
    (
        "<emitter type='collimated'><transform name='to_world'><scale value='2'/></transform></emitter>",
        "scale",
    ),
];

#[test]
fn mistakes_name_file_and_line() {
    for (body, word) in MISTAKES {
        match load_body(body) {
            Err(Error::Scene { file, line: 2, message }) => {
                assert!(file.ends_with("scene.xml") && message.contains(word), "{body}: {message}");
            }
            other => panic!("{body}: {:?}", other.map(|_| ())),
        }
    }
}

#[test]
fn sensors_and_whole_files_are_checked() {
    for (text, word) in [
        ("<scene version='3.0.0'>", "XML"),
        ("<scene><sensor type='perspective'/></scene>", "version"),
        ("<scene version='0.3.0'/>", "0.3.0"),
        ("<scene version='x'/>", "'x'"),
        ("<bsdf version='3.0.0' type='diffuse'/>", "<bsdf>"),
        ("<scene version='3.0.0'><sensor type='perspective'/></scene>", "no shapes"),
        ("<scene version='3.0.0'><sensor type='orthographic'/></scene>", "no shapes"),
        ("<scene version='3.0.0'><sensor type='spherical'/></scene>", "'perspective'"),
        ("<scene version='3.0.0'><sensor type='telecentric'/></scene>", "'orthographic'"),
        ("<scene version='3.0.0'><sensor type='distant'/></scene>", "'orthographic'"),
        ("<scene version='3.0.0'><sensor type='batch'/></scene>", "each on its own"),
        ("<scene version='3.0.0'><sensor type='eye'/></scene>", "unknown sensor plugin 'eye'"),
        (
            "<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='180'/></sensor></scene>",
            "180",
        ),
        ("<scene version='3.0.0'><sensor type='thinlens'/></scene>", "aperture_radius"),
        (
            "<scene version='3.0.0'><sensor type='perspective'><transform name='to_world'><scale value='2'/></transform></sensor></scene>",
            "scale",
        ),
        (
            "<scene version='3.0.0'><sensor type='perspective'><film type='hdrfilm'><integer name='width' value='0'/></film></sensor></scene>",
            "'width'",
        ),
        ("<!DOCTYPE s [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;&a;'>]><scene version='3.0.0'>&b;</scene>", "DTD"),
    ] {
        let error = load_text(text, &[]).map(|_| ()).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains(word), "{text}: {error}");
    }
    assert!(load(Path::new("/nonexistent.xml"), &[], None).is_err());
    assert!(load(Path::new("/nonexistent.gltf"), &[], None).unwrap_err().to_string().contains(".obj"));
}

#[test]
fn malicious_files_are_refused() {
    // Deep nesting, by elements, by includes, by references.
    let deep = format!("<scene version='3.0.0'>{}", "<bsdf type='twosided'>".repeat(200_000));
    assert!(load_text(&deep, &[]).unwrap_err().to_string().contains("nested"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xml");
    fs::write(&path, "<scene version='3.0.0'><include filename='a.xml'/><include filename='a.xml'/></scene>")
        .unwrap();
    assert!(load(&path, &[], None).unwrap_err().to_string().contains("includes"));
    let mut chain = String::from("<bsdf type='diffuse' id='b0'/>");
    for i in 1..100 {
        chain += &format!("<bsdf type='mask' id='b{i}'><ref id='b{}'/></bsdf>", i - 1);
    }
    assert!(load_body(&format!("{chain}<shape type='cube'><ref id='b99'/></shape>")).is_err());
}

/// The scenes that come with Mitsuba's tests and the project's references.
#[test]
fn whole_scenes_load() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let mut pending = vec![shared.join("reference/scenes"), shared.join("mitsuba-suite/tests/scenes")];
    let mut count = 0;
    while let Some(folder) = pending.pop() {
        let Ok(entries) = fs::read_dir(&folder) else {
            println!("skipped: {} is absent", folder.display());
            continue;
        };
        for path in entries.map(|e| e.unwrap().path()) {
            if path.is_dir() {
                // Parts of scenes, and scenes of media for the day that they can be rendered.
                if !path.ends_with("fragments") && !path.ends_with("participating_media") {
                    pending.push(path);
                }
            } else if path.extension().is_some_and(|e| e == "xml") {
                let scene = load(&path, &[], None).unwrap_or_else(|e| panic!("{e}"));
                assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
                count += 1;
            }
        }
    }
    println!("{count} scenes");
}

/// Words, units and defaults of Mitsuba 0.6.
#[test]
fn old_scenes_are_read_in_their_words() {
    let old = |body: &str| {
        let text = format!("<scene version='0.5.0'>{SENSOR}\n{body}\n</scene>");
        load_text(&text, &[]).unwrap_or_else(|e| panic!("{body}: {e}"))
    };
    let material = |bsdf: &str| {
        let scene = old(&format!("<shape type='sphere'>{bsdf}</shape>"));
        scene.materials[scene.shape_material[0] as usize].clone()
    };
    let Material::Diffuse { reflectance: Color::Constant(encoded) } =
        material("<bsdf type='diffuse'><srgb name='diffuseReflectance' value='0.5, 0, 1'/></bsdf>")
    else {
        panic!()
    };
    assert!(encoded.distance(Rgb::new(0.214_041, 0.0, 1.0)) < 1e-5, "{encoded}");
    // Copper unless told otherwise.
    let Material::Conductor { eta: Color::Constant(eta), .. } = material("<bsdf type='conductor'/>") else {
        panic!()
    };
    assert!(eta.x < 0.3 && eta.z > 1.0, "{eta}");
    let Material::Dielectric { eta, .. } = material(
        "<bsdf type='dielectric'><float name='intIOR' value='1.8'/><float name='extIOR' value='1.2'/></bsdf>",
    ) else {
        panic!()
    };
    assert!((eta - 1.5).abs() < 1e-6);
    // The second and third of weights that leave a tenth black.
    let diffuse = "<bsdf type='diffuse'/>";
    let Material::Blend { weight: Scalar::Constant(rest), nested: [_, others] } = material(&format!(
        "<bsdf type='mixturebsdf'><string name='weights' value='0.5, 0.3, 0.1'/>{diffuse}{diffuse}{diffuse}</bsdf>"
    )) else {
        panic!()
    };
    assert!((rest - 0.5).abs() < 1e-6);
    let Material::Blend { weight: Scalar::Constant(rest), .. } = *others else { panic!() };
    assert!((rest - 0.4).abs() < 1e-6, "{rest}");

    let scene = old(
        "<shape type='sphere'><emitter type='area'><spectrum name='radiance' value='10'/></emitter></shape>\
                     <integrator type='irrcache'><integrator type='sppm'><integer name='maxPasses' value='7'/>\
                     <float name='initialRadius' value='0.1'/></integrator></integrator>",
    );
    let Light::Area { radiance, .. } = scene.lights[0] else { panic!() };
    assert_eq!(radiance, Color::Constant(Rgb::splat(10.0)));
    assert_eq!((scene.integrator.as_str(), scene.sample_count), ("sppm", 7));
    assert_eq!(scene.integrator_params[0].name, "initial_radius");
    // What means nothing is told once, however often it is there.
    let shape = "<shape type='sphere'><float name='someThing' value='1'/></shape>";
    let scene = old(&format!("{shape}{shape}"));
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("some_thing"));
    // And 0.4's.
    let text = "<scene version='0.4.0'><camera type='perspective'><transform name='toWorld'><lookAt origin='0,0,5' \
                target='0,0,0' up='0,1,0'/></transform></camera><luminaire type='point'><blackbody name='intensity' \
                temperature='5000K'/></luminaire></scene>";
    let scene = load_text(text, &[]).unwrap();
    assert_eq!(Vec3::from(scene.camera.to_world.translation), Vec3::new(0.0, 0.0, 5.0));
    let Light::Point { intensity, .. } = scene.lights[0] else { panic!() };
    assert!(intensity.x > intensity.z && intensity.z > 0.0);
}

#[test]
fn instances_and_attributes() {
    let group = "<shape type='shapegroup' id='g'><shape type='sphere'><point name='center' value='1,0,0'/></shape></shape>";
    let instances = "<shape type='instance'><ref id='g'/><transform name='to_world'><scale value='2'/>\
         <translate x='1'/></transform></shape><shape type='instance'><ref id='g'/></shape>";
    // In whatever order.
    for body in [format!("{group}{instances}"), format!("{instances}{group}")] {
        let scene = load_body(&body).unwrap();
        let sphere = |shape: &Shape| match shape {
            Shape::Sphere(s) => (s.center.x, s.radius),
            other => panic!("{other:?}"),
        };
        let spheres: Vec<_> = scene.geometry.shapes.iter().map(sphere).collect();
        assert_eq!(spheres, [(3.0, 2.0), (1.0, 1.0)]);
    }
    let error = load_body(
        "<shape type='sphere'><bsdf type='diffuse'>\n<texture name='reflectance' type='mesh_attribute'>\
         <string name='name' value='vertex_color'/></texture></bsdf></shape>",
    );
    let error = error.unwrap_err().to_string();
    assert!(error.contains("scene.xml:3: ") && error.contains("vertex_color"), "{error}");
}

#[test]
fn a_light_without_area_is_a_mistake() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("needle.obj"), "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n").unwrap();
    let scene = dir.path().join("scene.xml");
    let text = "<scene version='3.0.0'><sensor type='perspective'/>\n<shape type='obj'>\
                <string name='filename' value='needle.obj'/><emitter type='area'/></shape></scene>";
    std::fs::write(&scene, text).unwrap();
    match load(&scene, &[], None) {
        Err(Error::Scene { line: 2, message, .. }) => assert!(message.contains("no area"), "{message}"),
        other => panic!("{:?}", other.map(|_| ())),
    }
}

/// Files are read by all threads, but the first bad one that the scene names is told of.
#[test]
fn the_first_bad_file_counts() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["bad.png", "bad.ply", "bad.exr"] {
        std::fs::write(dir.path().join(name), "nothing").unwrap();
    }
    let mesh = r#"<shape type="ply"><string name="filename" value="bad.ply"/></shape>"#;
    let texture = r#"<shape type="sphere"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
        <string name="filename" value="bad.png"/></texture></bsdf></shape>"#;
    let envmap = r#"<emitter type="envmap"><string name="filename" value="bad.exr"/></emitter>"#;
    let all = [(mesh, "bad.ply"), (texture, "bad.png"), (envmap, "bad.exr")];
    for i in 0..3 {
        let [(a, first), (b, _), (c, _)] = [0, 1, 2].map(|k| all[(i + k) % 3]);
        let path = dir.path().join("scene.xml");
        std::fs::write(&path, scene_text(&[a, b, c].concat())).unwrap();
        let error = load(&path, &[], None).unwrap_err().to_string();
        assert!(error.contains(first), "{error} is not about {first}");
    }
}

/// A folded square without normals: colours and heat at its vertices, a tint on each triangle.
const FOLDED: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property float r\nproperty float g\nproperty float b\nproperty float heat_x\nelement face 2\n\
    property list uchar int vertex_indices\nproperty float tint_r\nproperty float tint_g\nproperty float tint_b\n\
    end_header\n-1 -1 0 .1 .2 .3 .25\n1 -1 0 .9 .1 .5 .75\n1 1 .5 .3 .8 .2 1\n-1 1 0 .6 .4 .7 0\n\
    3 0 1 2 .2 .5 .8\n3 0 2 3 .7 .6 .1\n";

fn attribute(parameter: &str, name: &str, scale: f32) -> String {
    format!(
        "<texture type='mesh_attribute' name='{parameter}'><string name='name' value='{name}'/>\
         <float name='scale' value='{scale}'/></texture>"
    )
}

/// Loads `body`, which may refer to `folded.ply`.
fn load_folded(body: &str) -> Result<SceneDescription> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("folded.ply"), FOLDED).unwrap();
    let path = folder.path().join("scene.xml");
    fs::write(&path, scene_text(body)).unwrap();
    load(&path, &[], None)
}

/// The same with each backend, ready to be rendered.
fn build_folded(body: &str) -> Vec<Scene> {
    let description = load_folded(body).unwrap();
    accel::available().iter().map(|backend| Scene::new(description.clone(), *backend).unwrap()).collect()
}

const FROM_ABOVE: [[f32; 2]; 4] = [[0.3, -0.4], [-0.5, 0.45], [0.9, 0.2], [-0.2, -0.1]];

fn down([x, y]: [f32; 2]) -> Ray {
    Ray::new(Vec3::new(x, y, 5.0), Vec3::NEG_Z)
}

/// Expected values from Mitsuba 3.9.1.
#[test]
fn mesh_attributes_are_those_of_mitsuba() {
    let grey = [0.65, 0.31875, 0.875, 0.5375].map(|v| [v; 3]);
    let color = [[0.44, 0.345, 0.34], [0.3875, 0.445, 0.465], [0.5, 0.525, 0.31], [0.205, 0.45, 0.28]];
    let tint = [[0.2, 0.5, 0.8], [0.7, 0.6, 0.1], [0.2, 0.5, 0.8], [0.7, 0.6, 0.1]];
    for (name, scale, expected) in [
        ("vertex_color", 1.0, color),
        ("vertex_color", 0.5, color.map(|c| c.map(|v: f32| 0.5 * v))),
        ("face_tint_color", 1.0, tint),
        ("vertex_heat", 1.0, grey),
    ] {
        let shape = |inside: String| {
            format!("<shape type='ply'><string name='filename' value='folded.ply'/>{inside}</shape>")
        };
        let texture = attribute("reflectance", name, scale);
        for scene in build_folded(&shape(format!("<bsdf type='diffuse'>{texture}</bsdf>"))) {
            for (from, expected) in FROM_ABOVE.into_iter().zip(expected) {
                let found = scene.textures[0].eval(&scene.textures, &scene.hit(&down(from)).unwrap().at);
                assert!(found.distance(Vec3::from(expected)) < 1e-5, "{name} {from:?}: {found}");
            }
        }
        // A light shows the same, and its photons carry it.
        let texture = attribute("radiance", name, scale);
        for scene in build_folded(&shape(format!("<emitter type='area'>{texture}</emitter>"))) {
            for (from, expected) in FROM_ABOVE.into_iter().zip(expected) {
                let surface = scene.hit(&down(from)).unwrap();
                let found = scene.emitted(&surface, Vec3::Z);
                assert!(found.distance(Vec3::from(expected)) < 1e-5, "{name} {from:?}: {found}");
            }
            let mut sampler = Sampler::new(1, Stream::GlobalPhotons, 0, 0);
            let mut seen = 0;
            for _ in 0..100 {
                let (u, v) = (sampler.next_2d(), sampler.next_2d());
                let nowhere = Targets::default();
                let photon =
                    scene.lights.sample_emission(&scene.geometry, &scene.textures, &nowhere, 0.5, u, v);
                let Some(photon) = photon else { continue };
                let back = Ray::new(photon.o + photon.d * 1e-2, -photon.d);
                // The fold may be between.
                let Some(surface) = scene.hit(&back).filter(|s| s.p.distance(photon.o) < 1e-3) else {
                    continue;
                };
                let area = scene.geometry.shapes[0].area();
                let radiance = photon.flux / (std::f32::consts::PI * area);
                let there = scene.textures[0].eval(&scene.textures, &surface.at);
                assert!(radiance.distance(there) < 2e-3, "{name}: {radiance} from where there is {there}");
                seen += 1;
            }
            assert!(seen > 50, "{seen}");
        }
    }
}

#[test]
fn missing_attributes_are_mistakes() {
    let texture = attribute("reflectance", "vertex_none", 1.0);
    let bsdf = format!("<bsdf type='twosided' id='m'><bsdf type='diffuse'>{texture}</bsdf></bsdf>");
    let file = "<string name='filename' value='folded.ply'/>";
    for shape in [
        format!("<shape type='ply'>{file}{bsdf}</shape>"),
        format!("{bsdf}<shape type='sphere'><ref id='m'/></shape>"),
        format!(
            "<shape type='sphere'><emitter type='area'>{}</emitter></shape>",
            attribute("radiance", "face_none", 1.0)
        ),
        format!(
            "<shape type='shapegroup' id='g'><shape type='cube'>{bsdf}</shape></shape><shape type='instance'><ref id='g'/></shape>"
        ),
    ] {
        match load_folded(&shape).map(|_| ()) {
            Err(Error::Scene { line: 2, message, .. }) => assert!(message.contains("_none"), "{message}"),
            other => panic!("{shape}: {other:?}"),
        }
    }
    assert!(load_folded(&format!("{bsdf}<shape type='sphere'/>")).is_ok(), "nothing uses it");
}

/// Expected values from Mitsuba 3.9.1: position and both normals in instances of a mesh that has no normals of its own.
#[test]
fn instances_are_those_of_mitsuba() {
    type Point = [[f32; 3]; 3];
    let expected: [(&str, [Point; 2]); 2] = [
        (
            "<scale x='-1' y='2' z='3'/><rotate x='1' angle='20'/>",
            [
                [[0.3, -0.4, 0.3973], [0.53809, -0.42931, 0.72536], [0.21793, -0.54147, 0.81198]],
                [[-0.5, 0.45, 1.03031], [-0.33594, -0.57977, 0.7423], [0.00016, -0.57856, 0.81564]],
            ],
        ),
        (
            "<scale x='1' y='1' z='2'/><translate x='0.2'/>",
            [
                [[0.3, -0.4, 0.30179], [0.22361, -0.3873, 0.89443], [-0.04125, -0.33367, 0.94179]],
                [[-0.5, 0.45, 0.30939], [-0.3873, -0.22361, 0.89443], [-0.26109, -0.26934, 0.92698]],
            ],
        ),
    ];
    for (transform, points) in expected {
        let body = format!(
            "<shape type='shapegroup' id='g'><shape type='ply'><string name='filename' value='folded.ply'/>\
             <transform name='to_world'><rotate z='1' angle='30'/></transform></shape></shape>\
             <shape type='instance'><ref id='g'/><transform name='to_world'>{transform}</transform></shape>"
        );
        for scene in build_folded(&body) {
            for (from, expected) in FROM_ABOVE.into_iter().zip(points) {
                let surface = scene.hit(&down(from)).unwrap();
                let found = [surface.p, surface.n_g, surface.frame.n];
                // Mitsuba interpolates before it transforms.
                for ((found, expected), most) in found.iter().zip(expected).zip([2e-5, 2e-5, 0.02]) {
                    assert!(found.distance(expected.into()) < most, "{transform} {from:?}: {found}");
                }
            }
        }
    }
    // And on the other shapes the normal and the texture coordinates, mirrored and turned around.
    for (shape, flip, transform, n, uv) in [
        ("sphere", false, "<scale z='-1'/>", [0.3, 0.2, 0.933], [0.094, 0.883]),
        ("sphere", true, "<scale x='-1'/>", [-0.3, -0.2, -0.933], [0.406, 0.117]),
        ("cube", false, "<scale z='-1'/>", [0.0, 0.0, 1.0], [0.4, 0.65]),
        ("cube", true, "<scale x='-1'/>", [0.0, 0.0, -1.0], [0.6, 0.35]),
        ("cube", false, "<rotate x='1' angle='90'/>", [0.0, 0.0, 1.0], [0.35, 0.6]),
        ("rectangle", false, "<scale z='-1'/>", [0.0, 0.0, -1.0], [0.65, 0.6]),
        ("rectangle", true, "<scale x='-1'/>", [0.0, 0.0, -1.0], [0.35, 0.6]),
        ("disk", false, "<scale z='-1'/>", [0.0, 0.0, -1.0], [0.361, 0.094]),
        ("disk", true, "<scale x='-1'/>", [0.0, 0.0, -1.0], [0.361, 0.406]),
    ] {
        let body = format!(
            "<shape type='shapegroup' id='g'><shape type='{shape}'><boolean name='flip_normals' value='{flip}'/>\
             </shape></shape><shape type='instance'><ref id='g'/><transform name='to_world'>{transform}</transform></shape>"
        );
        for mut scene in build_folded(&body) {
            scene.compute_everything();
            let surface = scene.hit(&down([0.3, 0.2])).unwrap();
            let found = (surface.n_g, surface.at.uv);
            let close = found.0.distance(n.into()) < 1e-3 && found.1.distance(uv.into()) < 1e-3;
            assert!(close, "{shape} {flip} {transform}: {found:?}");
        }
    }
}

#[test]
fn groups_hold_copies() {
    let scene = load_body(
        "<shape type='shapegroup' id='g'><shape type='cube'/><shape type='merge'><shape type='sphere'/>\
         <shape type='disk' id='d'/></shape></shape><shape type='merge'><shape type='instance'><ref id='g'/></shape>\
         <shape type='merge'><ref id='d'/></shape></shape><shape type='instance'><ref id='g'/></shape>",
    );
    assert_eq!(scene.unwrap().geometry.shapes.len(), 7);
    assert!(
        load_body("<shape type='shapegroup'><shape type='cube'/></shape><emitter type='constant'/>").is_ok()
    );
    // What is referred to stays what it is.
    let scene = load_body(
        "<shape type='merge'><ref id='m'/><ref id='m'/></shape><shape type='merge' id='m'>\
         <shape type='sphere'><bsdf type='conductor'/></shape></shape>",
    );
    let scene = scene.unwrap();
    assert_eq!(scene.shape_material, [0; 3]);
    assert!(matches!(scene.materials[0], Material::Conductor { .. }));
    // Each merge holds the next one twice.
    let merge = |i: u32| {
        format!("<shape type='merge' id='m{i}'><ref id='m{}'/><ref id='m{}'/></shape>", i + 1, i + 1)
    };
    let merges: String = (0..30).map(merge).collect();
    let error = load_body(&format!("{merges}<shape type='merge' id='m30'><shape type='sphere'/></shape>"));
    assert!(error.unwrap_err().to_string().contains("more than"));
}
