//! Scenes in the words of Mitsuba 0.4 to 0.6: defaults, units and meanings that Mitsuba 3 has not. `docs/plugins.md` and its
//! test go through the plugins.

use crate::bsdf::Distribution;
use crate::film::Filter;
use crate::light::Light;
use crate::math::Rgb;
use crate::scene::{Material, SceneDescription, load};
use crate::shape::Shape;
use crate::texture::{Color, Interpolation, Lookup, Scalar, Texture, Wrap};
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use std::fs;

/// A scene of the given version, with its body in line 2, beside an image of one row: red, green, and grey of 128.
fn try_load(version: &str, body: &str) -> Result<SceneDescription> {
    let folder = tempfile::tempdir().unwrap();
    let row = [[255, 0, 0], [0, 255, 0], [128, 128, 128]];
    let image = image::RgbImage::from_fn(3, 1, |x, _| image::Rgb(row[x as usize]));
    image.save(folder.path().join("row.png")).unwrap();
    let sensor = if body.contains("<sensor") { "" } else { "<sensor type='perspective'/>" };
    let path = folder.path().join("scene.xml");
    fs::write(&path, format!("<scene version='{version}'>{sensor}\n{body}\n</scene>")).unwrap();
    load(&path, &[], None)
}

fn old(body: &str) -> SceneDescription {
    try_load("0.6.0", body).unwrap_or_else(|e| panic!("{body}: {e}"))
}

/// A sphere's material, and the scene for its textures and warnings.
fn material(bsdf: &str) -> (Material, SceneDescription) {
    let scene = old(&format!("<shape type='sphere'>{bsdf}</shape>"));
    (scene.materials[scene.shape_material[0] as usize].clone(), scene)
}

/// A diffuse surface's reflectance as the texture that it is.
fn textured(texture: &str) -> impl Fn(f32, f32) -> Rgb + use<> {
    let (material, scene) = material(&format!("<bsdf type='diffuse'>{texture}</bsdf>"));
    let Material::Diffuse { reflectance: Color::Texture(index) } = material else { panic!("{material:?}") };
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    move |u, v| scene.textures[index as usize].eval(&scene.textures, &Lookup::from(Vec2::new(u, v)))
}

fn assert_near(a: Rgb, b: [f32; 3]) {
    assert!(a.distance(Rgb::from_array(b)) < 1e-4, "{a} is not {b:?}");
}

#[test]
fn colours() {
    let reflectance = |value: &str| match material(&format!("<bsdf type='diffuse'>{value}</bsdf>")) {
        (Material::Diffuse { reflectance: Color::Constant(c) }, scene) => (c, scene.warnings),
        other => panic!("{other:?}"),
    };
    for (value, expected) in [
        ("<srgb name='reflectance' value='#ff8000'/>", [1.0, 0.215_861, 0.0]),
        ("<srgb name='reflectance' value='1, 0.5, 0'/>", [1.0, 0.214_041, 0.0]),
        ("<rgb name='reflectance' value='1, 0.5, 0'/>", [1.0, 0.5, 0.0]),
        ("<rgb name='reflectance' value='#ff8000'/>", [1.0, 0.215_861, 0.0]),
        ("<spectrum name='reflectance' value='0.3'/>", [0.3; 3]),
        ("<spectrum name='reflectance' value='0.1, 0.2, 0.3' intent='reflectance'/>", [0.1, 0.2, 0.3]),
        ("<rgb name='diffuseReflectance' value='0.1, 0.2, 0.3'/>", [0.1, 0.2, 0.3]),
    ] {
        let (found, warnings) = reflectance(value);
        assert_near(found, expected);
        assert!(warnings.is_empty(), "{value}: {warnings:?}");
    }
    // More than all light: scaled down as a whole.
    let (found, warnings) = reflectance("<rgb name='reflectance' value='2, 1, 0'/>");
    assert_near(found, [1.0, 0.5, 0.0]);
    assert!(warnings.len() == 1 && warnings[0].contains("scaled down"), "{warnings:?}");
    assert!(
        try_load(
            "3.0.0",
            "<shape type='sphere'><bsdf type='diffuse'><rgb name='reflectance' value='2'/></bsdf></shape>"
        )
        .is_err()
    );
    // White, where Mitsuba 3 makes the same words an equal-energy spectrum, which is pinkish.
    let emission = |version: &str| {
        let body = "<emitter type='constant'><spectrum name='radiance' value='10'/></emitter>";
        let Light::Constant { radiance } = try_load(version, body).unwrap().lights[0] else { panic!() };
        radiance
    };
    assert_eq!(emission("0.6.0"), Rgb::splat(10.0));
    assert!(emission("3.0.0").x > 11.0);
    // Kelvin may be spelt out.
    let lamp = |kelvin: &str| {
        let body = format!(
            "<emitter type='point'><blackbody name='intensity' temperature='{kelvin}' scale='2'/></emitter>"
        );
        let Light::Point { intensity, .. } = old(&body).lights[0] else { panic!() };
        intensity
    };
    assert_eq!(lamp("3000K"), lamp("3000"));
    assert!(lamp("3000k").x > 2.0 * lamp("3000k").z);
}

#[test]
fn metals_and_roughness() {
    let rough = |inside: &str| material(&format!("<bsdf type='roughconductor'>{inside}</bsdf>"));
    // Copper unless told otherwise; Mitsuba 3.9.1's in RGB.
    let (Material::RoughConductor { eta: Color::Constant(eta), roughness, .. }, scene) = rough("") else {
        panic!()
    };
    assert!(eta.distance(Rgb::new(0.200_438, 0.924_033, 1.102_212)) < 1e-3, "{eta}");
    assert_eq!((roughness.distribution, roughness.alpha_u), (Distribution::Beckmann, Scalar::Constant(0.1)));
    assert!(scene.warnings.is_empty());
    let (Material::RoughConductor { eta: Color::Constant(mirror), .. }, _) =
        rough("<string name='material' value='none'/>")
    else {
        panic!()
    };
    assert_eq!(mirror, Rgb::ZERO);
    // Two of its distributions are shown as the nearest one.
    for distribution in ["phong", "as"] {
        let (Material::RoughConductor { roughness, .. }, scene) = rough(&format!(
            "<string name='distribution' value='{distribution}'/><float name='alphaU' value='0.2'/>\
             <float name='alphaV' value='0.3'/>"
        )) else {
            panic!()
        };
        assert_eq!(roughness.distribution, Distribution::Beckmann);
        assert_eq!((roughness.alpha_u, roughness.alpha_v), (Scalar::Constant(0.2), Scalar::Constant(0.3)));
        let [warning] = &scene.warnings[..] else { panic!("{:?}", scene.warnings) };
        assert!(warning.contains(&format!("'{distribution}'")), "{warning}");
    }
    let new = "<bsdf type='roughconductor'><string name='distribution' value='phong'/></bsdf>";
    assert!(try_load("3.0.0", &format!("<shape type='sphere'>{new}</shape>")).is_err());
}

/// The shares of diffuse greys 0.1, 0.2 … inside of nested blends; 0 stands for black.
fn shares(material: &Material, all: f32, found: &mut Vec<(f32, f32)>) {
    match material {
        Material::Blend { weight: Scalar::Constant(weight), nested: [first, second] } => {
            shares(first, all * (1.0 - weight), found);
            shares(second, all * weight, found);
        }
        Material::Diffuse { reflectance: Color::Constant(c) } => found.push((c.x, all)),
        other => panic!("{other:?}"),
    }
}

#[test]
fn mixtures() {
    let mixture = |weights: &str, count: usize| {
        let greys = (1..=count)
            .map(|i| format!("<bsdf type='diffuse'><spectrum name='reflectance' value='0.{i}'/></bsdf>"));
        format!(
            "<bsdf type='mixturebsdf'><string name='weights' value='{weights}'/>{}</bsdf>",
            greys.collect::<String>()
        )
    };
    for (weights, count, expected) in [
        // The rest is black.
        ("0.5, 0.3, 0.1", 3, vec![(0.1, 0.5), (0.2, 0.3), (0.3, 0.1), (0.0, 0.1)]),
        ("0.25 0.75", 2, vec![(0.1, 0.25), (0.2, 0.75)]),
        // Scaled down to 1.
        ("1, 3", 2, vec![(0.1, 0.25), (0.2, 0.75)]),
        ("0, 1", 2, vec![(0.1, 0.0), (0.2, 1.0)]),
        ("0.4", 1, vec![(0.1, 0.4), (0.0, 0.6)]),
    ] {
        let mut found = Vec::new();
        shares(&material(&mixture(weights, count)).0, 1.0, &mut found);
        assert_eq!(found.len(), expected.len(), "{weights}: {found:?}");
        for ((grey, share), (grey_expected, share_expected)) in found.iter().zip(&expected) {
            assert!((grey - grey_expected).abs() < 1e-6, "{weights}: {found:?}");
            assert!((share - share_expected).abs() < 1e-6, "{weights}: {found:?}");
        }
    }
    for weights in ["1", "1, 1, 1", "1, -1", "1, x", ""] {
        let shape = format!("<shape type='sphere'>{}</shape>", mixture(weights, 2));
        match try_load("0.6.0", &shape) {
            Err(Error::Scene { line: 2, message, .. }) => assert!(message.contains("'weights'"), "{message}"),
            other => panic!("{weights}: {:?}", other.map(|_| ())),
        }
    }
}

#[test]
fn coatings() {
    let diffuse = "<bsdf type='diffuse'/>";
    let inside = "<float name='intIOR' value='1.8'/><float name='extIOR' value='1.2'/>\
                  <float name='thickness' value='3'/><rgb name='sigmaA' value='0.1, 0.2, 0.3'/>";
    let (coated, _) = material(&format!("<bsdf type='coating'>{inside}{diffuse}</bsdf>"));
    let Material::Coated { eta, absorption, thickness, rough: None, nested, .. } = coated else { panic!() };
    assert!((eta - 1.5).abs() < 1e-6 && thickness == 3.0);
    assert_eq!(absorption, Color::Constant(Rgb::new(0.1, 0.2, 0.3)));
    assert!(matches!(*nested, Material::Diffuse { .. }));
    let rough = format!("<bsdf type='roughcoating'><float name='alpha' value='0.2'/>{diffuse}</bsdf>");
    assert!(matches!(material(&rough).0, Material::Coated { rough: Some(_), .. }));
    for wrong in ["", "<bsdf type='dielectric'/>", &diffuse.repeat(2)] {
        let shape = format!("<shape type='sphere'><bsdf type='coating'>{wrong}</bsdf></shape>");
        assert!(try_load("0.6.0", &shape).is_err(), "{wrong}");
    }
    // Normals of Mitsuba 0.6 are neither turned to the eye nor shadowed.
    let bumps = |version: &str| {
        let body = "<shape type='sphere'><bsdf type='bumpmap'><texture type='bitmap'>\
                    <string name='filename' value='row.png'/></texture><bsdf type='diffuse'/></bsdf></shape>";
        let scene = try_load(version, body).unwrap();
        let Material::BumpMap { rules, .. } = &scene.materials[0] else { panic!() };
        (rules.flip_invalid, rules.shadowing)
    };
    assert_eq!((bumps("0.6.0"), bumps("3.0.0")), ((false, false), (true, true)));
}

#[test]
fn textures() {
    let coordinates = "<float name='uscale' value='2'/><float name='voffset' value='0.5'/>";
    let squares = |more: &str| {
        textured(&format!("<texture type='checkerboard' name='reflectance'>{more}</texture>"))(0.1, 0.1).x
    };
    assert_eq!((squares(""), squares(coordinates)), (0.4, 0.2));
    assert_eq!(squares("<float name='uvscale' value='6'/>"), 0.4);
    assert_eq!(squares("<float name='uvscale' value='6'/><float name='vscale' value='1'/>"), 0.2);
    let grid = textured("<texture type='gridtexture' name='reflectance'/>");
    assert_eq!((grid(0.5, 0.5).x, grid(0.995, 0.5).x, grid(0.5, 3.005).x), (0.2, 0.4, 0.4));
    assert_eq!((grid(0.02, 0.5).x, grid(0.5, 0.98).x), (0.2, 0.2));
    let wide = textured(
        "<texture type='gridtexture' name='reflectance'><float name='lineWidth' value='0.1'/>\
         <rgb name='color1' value='1 0 0'/><float name='uscale' value='2'/></texture>",
    );
    assert_eq!((wide(0.47, 0.5), wide(0.35, 0.5).x), (Rgb::X, 0.2));

    let bitmap = |more: &str| {
        textured(&format!(
            "<texture type='bitmap' name='reflectance'><string name='filename' value='row.png'/>\
             <string name='filterType' value='nearest'/>{more}</texture>"
        ))
    };
    // 128 of 255 as sRGB, by power, as it is.
    for (gamma, expected) in [("-1", 0.215_861), ("2.2", 0.219_520), ("1", 0.501_961)] {
        let grey = bitmap(&format!("<float name='gamma' value='{gamma}'/>"))(0.9, 0.5);
        assert_near(grey, [expected; 3]);
    }
    assert_near(bitmap("")(0.9, 0.5), [0.215_861; 3]);
    let green = bitmap("<string name='channel' value='g'/>");
    assert_eq!((green(0.1, 0.5), green(0.5, 0.5)), (Rgb::ZERO, Rgb::ONE));
    // Red, green, grey; then red again, grey, or grey for ever.
    let beyond = |wrap: &str| bitmap(wrap)(1.1, 0.5);
    assert_eq!(beyond(""), Rgb::X);
    assert_near(beyond("<string name='wrapMode' value='mirror'/>"), [0.215_861; 3]);
    assert_near(
        beyond("<string name='wrapModeU' value='clamp'/><string name='wrapModeV' value='repeat'/>"),
        [0.215_861; 3],
    );
    assert_eq!(beyond("<string name='wrapModeV' value='clamp'/>"), Rgb::X);
    let (_, scene) = material(
        "<bsdf type='diffuse'><texture type='bitmap' name='reflectance'><string name='filename' value='row.png'/>\
         <string name='filterType' value='ewa'/><string name='wrapModeU' value='mirror'/>\
         <string name='wrapModeV' value='clamp'/></texture></bsdf>",
    );
    let Texture::Bitmap(smooth) = &scene.textures[0] else { panic!() };
    let (_, (interpolation, wrap, _)) = smooth.contents();
    assert_eq!((interpolation, wrap), (Interpolation::Bilinear, [Wrap::Mirror, Wrap::Clamp]));

    let scaled = textured(
        "<texture type='scale' name='reflectance'><rgb name='scale' value='0.5, 0.25, 1'/><texture type='bitmap'>\
         <string name='filename' value='row.png'/><string name='filterType' value='nearest'/></texture></texture>",
    );
    assert_eq!((scaled(0.1, 0.5), scaled(0.5, 0.5)), (Rgb::X * 0.5, Rgb::Y * 0.25));
    let (constant, _) = material(
        "<bsdf type='diffuse'><texture type='scale' name='reflectance'><float name='scale' value='0.5'/>\
         <rgb name='value' value='0.4 0.6 0.8'/></texture></bsdf>",
    );
    let Material::Diffuse { reflectance: Color::Constant(c) } = constant else { panic!() };
    assert_near(c, [0.2, 0.3, 0.4]);
}

#[test]
fn views_and_films() {
    let scene = old("<sensor type='thinlens'><float name='apertureRadius' value='0.1'/>\
         <float name='focusDistance' value='3'/><float name='nearClip' value='0.5'/>\
         <string name='fovAxis' value='y'/><float name='fov' value='90'/>\
         <animation name='toWorld'><transform time='0'><lookAt origin='3,0,0' target='0,0,0' up='0,1,0'/></transform>\
         <transform time='1'><translate x='9'/></transform></animation>\
         <sampler type='ldsampler'><integer name='sampleCount' value='9'/></sampler>\
         <film type='ldrfilm'><integer name='width' value='40'/><integer name='height' value='20'/>\
         <string name='tonemapMethod' value='reinhard'/><float name='burn' value='0.1'/>\
         <boolean name='banner' value='false'/><rfilter type='box'/></film></sensor><shape type='cube'/>");
    let camera = &scene.camera;
    assert_eq!((camera.aperture_radius, camera.focus_distance, camera.clip.0), (0.1, 3.0, 0.5));
    assert!((camera.half_width - 2.0).abs() < 1e-5, "{}", camera.half_width);
    // Nothing moves.
    assert_eq!(Vec3::from(camera.to_world.translation), Vec3::new(3.0, 0.0, 0.0));
    assert_eq!((scene.film.size, scene.film.filter, scene.sample_count), ((40, 20), Filter::Box, 9));
    let about = |word: &str| scene.warnings.iter().filter(|w| w.contains(word)).count();
    assert_eq!(about("moves"), 1, "{:?}", scene.warnings);
    assert_eq!((about("'tonemap_method'"), about("'burn'")), (1, 1), "{:?}", scene.warnings);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    // 0.4 in its own words.
    let body = "<camera type='thinlens'><float name='apertureRadius' value='0.1'/>\
                <float name='focusDepth' value='7'/><film type='exrfilm'/><!--<sensor--></camera>\
                <luminaire type='constant'/>\
                <shape type='sphere'><bsdf type='bump'><texture type='ldrtexture'>\
                <string name='filename' value='row.png'/></texture><bsdf type='diffuse'/></bsdf></shape>";
    let scene = try_load("0.4.0", body).unwrap();
    assert_eq!(scene.camera.focus_distance, 7.0);
    assert!(matches!(scene.lights[0], Light::Constant { .. }));
    assert!(matches!(scene.materials[0], Material::BumpMap { .. }));
    // None of these are Mitsuba 3's words.
    for body in [
        "<camera type='perspective'/>",
        "<luminaire type='constant'/>",
        "<shape type='sphere'><bsdf type='diffuse'><srgb name='reflectance' value='0.5'/></bsdf></shape>",
        "<shape type='sphere'><bsdf type='bump'/></shape>",
    ] {
        assert!(matches!(try_load("3.0.0", body), Err(Error::Scene { line: 2, .. })), "{body}");
    }
}

#[test]
fn instances() {
    let scene = old(
        "<shape type='shapegroup' id='g'><shape type='sphere'><float name='radius' value='2'/></shape></shape>\
         <shape type='instance'><ref id='g'/><transform name='toWorld'><translate x='3'/></transform></shape>\
         <shape type='instance'><ref id='g'/><transform name='toWorld'><scale value='2'/></transform></shape>",
    );
    let spheres = scene.geometry.shapes.iter().map(|shape| match shape {
        Shape::Sphere(s) => (s.center.x, s.radius),
        other => panic!("{other:?}"),
    });
    assert_eq!(spheres.collect::<Vec<_>>(), [(3.0, 2.0), (0.0, 4.0)]);
}

#[test]
fn what_is_unknown_is_told_once() {
    let odd = "<float name='oddOne' value='1'/><string name='oddOther' value='x'/>";
    let shapes = format!("<shape type='sphere'>{odd}</shape>").repeat(3);
    let scene = old(&format!(
        "{shapes}<emitter type='point'>{odd}</emitter><emitter type='constant'>{odd}</emitter>"
    ));
    assert_eq!(scene.warnings.len(), 3, "{:?}", scene.warnings);
    for plugin in ["shape plugin 'sphere'", "emitter plugin 'point'", "emitter plugin 'constant'"] {
        for name in ["odd_one", "odd_other"] {
            let about = scene.warnings.iter().filter(|w| w.contains(plugin) && w.matches(name).count() == 1);
            assert_eq!(about.count(), 1, "{plugin} {name}: {:?}", scene.warnings);
        }
    }
    // But an object that means nothing is more than a detail.
    assert!(try_load("0.6.0", "<emitter type='point'><bsdf type='diffuse'/></emitter>").is_err());
    // The last one of two counts.
    let scene =
        old("<shape type='sphere'><float name='radius' value='1'/><float name='radius' value='2'/></shape>");
    assert!(matches!(&scene.geometry.shapes[0], Shape::Sphere(s) if s.radius == 2.0));
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("twice"), "{:?}", scene.warnings);
}
