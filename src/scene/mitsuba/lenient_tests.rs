//! What other programs write and Mitsuba 3 or its relatives read, though no document says so: it is read, with a
//! word where the picture may be another one.

use crate::bsdf::Distribution;
use crate::film::Filter;
use crate::light::Light;
use crate::math::Rgb;
use crate::scene::{Material, SceneDescription, load};
use crate::shape::Shape;
use crate::texture::{Color, Scalar, Texture};
use crate::{Error, Result};
use glam::{DMat3, DVec3, Vec2, Vec3};
use std::fs;

const SENSOR: &str = "<sensor type='perspective'/>";

/// A scene of version 3 whose body begins in line 2, beside an image of two texels: 128 and 255.
fn try_load(start: &str, body: &str) -> Result<SceneDescription> {
    let folder = tempfile::tempdir().unwrap();
    let image = image::RgbImage::from_fn(2, 1, |x, _| image::Rgb([128 + 127 * x as u8; 3]));
    image.save(folder.path().join("row.png")).unwrap();
    fs::write(folder.path().join("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let path = folder.path().join("scene.xml");
    fs::write(&path, format!("<scene version='3.0.0'>{start}\n{body}\n</scene>")).unwrap();
    load(&path, &[], None)
}

fn read(body: &str) -> SceneDescription {
    try_load(SENSOR, body).unwrap_or_else(|e| panic!("{body}: {e}"))
}

/// The same, with the only warning.
fn warned(body: &str) -> (SceneDescription, String) {
    let mut scene = read(body);
    assert_eq!(scene.warnings.len(), 1, "{body}: {:?}", scene.warnings);
    let warning = scene.warnings.remove(0);
    (scene, warning)
}

/// A sphere's material, and all warnings.
fn material(bsdf: &str) -> (Material, String) {
    let scene = read(&format!("<shape type='sphere'>{bsdf}</shape>"));
    (scene.materials[scene.shape_material[0] as usize].clone(), scene.warnings.concat())
}

fn refused(body: &str, word: &str) {
    match try_load(SENSOR, body) {
        Err(Error::Scene { line: 2, message, .. }) => assert!(message.contains(word), "{body}: {message}"),
        other => panic!("{body}: {:?}", other.map(|_| ())),
    }
}

#[test]
fn text_and_comments_may_be_anywhere() {
    let sphere = "<shape type='sphere'/>";
    for comment in ["<!-- one -- two -->", "<!-- one --- two --->", "<!----- a ----->"] {
        let scene = read(&format!("{comment}{sphere}"));
        assert_eq!((scene.geometry.shapes.len(), scene.warnings.len()), (1, 0), "{comment}");
    }
    for stray in [
        format!("notes of an exporter{sphere}"),
        format!("{sphere}<![CDATA[notes of an exporter]]>"),
        "<shape type='sphere'>notes of an exporter</shape>".into(),
        "<shape type='sphere'><float name='radius' value='1'>notes of an exporter</float></shape>".into(),
    ] {
        let (scene, warning) = warned(&stray);
        assert_eq!(scene.geometry.shapes.len(), 1);
        assert!(warning.contains("scene.xml:2: ") && warning.contains("'notes of an exporter'"), "{warning}");
    }
    assert!(warned(&format!("one{sphere}two{sphere}three")).1.contains("'one', and 2 more"));
    assert!(read("<shape type='sphere' id='a & b < c'/>").warnings.is_empty());
}

#[test]
fn fresnel_sees_only_the_size_of_an_index() {
    for plugin in ["conductor", "roughconductor"] {
        let metal = |eta: &str, k: &str| {
            let both = format!("<rgb name='eta' value='{eta}'/><rgb name='k' value='{k}'/>");
            match material(&format!("<bsdf type='{plugin}'>{both}</bsdf>")) {
                (Material::Conductor { eta, k, .. } | Material::RoughConductor { eta, k, .. }, warnings) => {
                    (eta, k, warnings)
                }
                other => panic!("{other:?}"),
            }
        };
        let (eta, k, warnings) = metal("-0.05, 4.1, 4.6", "-0.03, 0.09, 1.3");
        assert_eq!(eta, Color::Constant(Rgb::new(0.05, 4.1, 4.6)));
        assert_eq!(k, Color::Constant(Rgb::new(0.03, 0.09, 1.3)));
        assert!(warnings.contains("'eta' is negative") && warnings.contains("'k' is negative"), "{warnings}");
        assert!(metal("0.05, 4.1, 4.6", "0.03, 0.09, 1.3").2.is_empty());
    }
    let (grey, _) = material("<bsdf type='conductor'><float name='eta' value='-2'/></bsdf>");
    assert!(matches!(grey, Material::Conductor { eta, .. } if eta == Color::Constant(Rgb::splat(2.0))));
    // Nothing else may be negative.
    refused(
        "<shape type='cube'><bsdf type='diffuse'><float name='reflectance' value='-1'/></bsdf></shape>",
        "negative",
    );
}

#[test]
fn without_roughness_a_surface_is_smooth() {
    for alpha in ["0", "1e-5", "-0.1"] {
        let negative = alpha.starts_with('-');
        let of = |plugin: &str| {
            let alpha = format!("<float name='alpha' value='{alpha}'/>");
            let (material, warnings) = material(&format!("<bsdf type='{plugin}'>{alpha}</bsdf>"));
            assert_eq!(warnings.contains("taken for 0"), negative, "{plugin} {alpha}: {warnings}");
            material
        };
        assert!(matches!(of("roughconductor"), Material::Conductor { .. }));
        assert!(matches!(of("roughdielectric"), Material::Dielectric { .. }));
        assert!(matches!(of("roughplastic"), Material::Plastic { .. }));
        let Material::Ward { alpha_u, .. } = of("ward") else { panic!() };
        assert!(matches!(alpha_u, Scalar::Constant(a) if a >= 0.0));
    }
    // Smooth across, but not along.
    let brushed = "<float name='alpha_u' value='0'/><float name='alpha_v' value='.3'/>";
    let (brushed, _) = material(&format!("<bsdf type='roughconductor'>{brushed}</bsdf>"));
    assert!(matches!(brushed, Material::RoughConductor { .. }));
}

#[test]
fn definitions_may_stand_at_the_top() {
    let film = "<film type='hdrfilm' id='f'><integer name='width' value='16'/><integer name='height' value='8'/>\
                <ref id='r'/></film><rfilter type='box' id='r'/><sampler type='independent' id='s'>\
                <integer name='sample_count' value='7'/></sampler><shape type='sphere'/>";
    for names in [["", ""], ["name='film'", "name='sampler'"]] {
        let sensor = format!(
            "<sensor type='perspective' id='c'><ref {} id='f'/><ref {} id='s'/></sensor>",
            names[0], names[1]
        );
        for again in ["", "<ref id='c'/>", "<ref name='view' id='c'/>"] {
            for body in [format!("{film}{sensor}{again}"), format!("{sensor}{again}{film}")] {
                let scene = try_load("", &body).unwrap_or_else(|e| panic!("{body}: {e}"));
                assert_eq!((scene.film.size, scene.film.filter), ((16, 8), Filter::Box));
                assert_eq!((scene.sample_count, scene.warnings.len()), (7, 0), "{:?}", scene.warnings);
            }
        }
    }
    let path = "<integrator type='path' id='i'><integer name='max_depth' value='3'/></integrator>";
    for wrapper in ["", "<ref id='i'/>", "<integrator type='aov'><ref id='i'/></integrator>"] {
        let scene = read(&format!("{path}{wrapper}<shape type='sphere'/>"));
        let named: Vec<_> = scene.integrator_params.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(
            (scene.integrator.as_str(), &named[..], scene.warnings.len()),
            ("path", &["max_depth"][..], 0)
        );
    }
}

#[test]
fn emitters_may_stand_at_the_top() {
    let lamp = "<emitter type='area' id='lamp'><rgb name='radiance' value='2'/></emitter>";
    let ball = "<shape type='sphere'><ref id='lamp'/></shape>";
    for body in [format!("{lamp}{ball}"), format!("{ball}{lamp}")] {
        let scene = read(&body);
        let [Light::Area { shape: 0, radiance }] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
        assert_eq!((*radiance, scene.warnings.len()), (Color::Constant(Rgb::splat(2.0)), 0));
    }
    assert_eq!(read(&format!("{lamp}{ball}{ball}")).lights.len(), 2);
    for plugin in ["area", "directionalarea"] {
        let (scene, warning) = warned(&format!("<emitter type='{plugin}'/><shape type='sphere'/>"));
        assert!(scene.lights.is_empty() && warning.contains("no shape refers to it"), "{warning}");
    }
    // Other emitters shine where they stand, and once.
    let point = "<emitter type='point' id='p'><point name='position' value='1, 2, 3'/></emitter>";
    for body in [
        format!("<shape type='sphere'>{point}</shape>"),
        format!(
            "{point}<shape type='sphere'><ref id='p'/></shape><shape type='sphere'><ref id='p'/></shape>"
        ),
    ] {
        let (scene, warning) = warned(&body);
        let [Light::Point { position, .. }] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
        assert_eq!(*position, Vec3::new(1.0, 2.0, 3.0));
        assert!(warning.contains("'point' inside a shape"), "{warning}");
        // What holds a lamp reflects nothing unless told otherwise.
        let black = Color::Constant(Rgb::ZERO);
        assert!(matches!(&scene.materials[0], Material::Diffuse { reflectance } if *reflectance == black));
    }
    for plugin in ["spot", "directional", "projector", "collimated", "sunsky"] {
        let (scene, warning) = warned(&format!("<shape type='sphere'><emitter type='{plugin}'/></shape>"));
        assert!(!scene.lights.is_empty() && warning.contains(plugin), "{warning}");
    }
    let (scene, warning) = warned("<shape type='sphere'><emitter type='constant'/></shape>");
    assert!(matches!(scene.lights[..], [Light::Area { .. }]) && warning.contains("'area'"), "{warning}");
    refused("<shape type='sphere'><emitter type='glow'/></shape>", "unknown emitter plugin 'glow'");
}

/// Without a sensor everything is in view.
#[test]
fn a_default_view_sees_the_scene() {
    let corners = "<shape type='cube'><transform name='to_world'><scale x='3' y='0.5'/><translate x='5'/></transform></shape>";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    fs::write(&path, format!("<scene version='3.0.0'>{corners}</scene>")).unwrap();
    for size in [None, Some((20, 10)), Some((10, 90))] {
        let scene = load(&path, &[], size).unwrap();
        assert!(
            scene.warnings.len() == 1 && scene.warnings[0].contains("no <sensor>"),
            "{:?}",
            scene.warnings
        );
        assert_eq!(scene.film.size, size.unwrap_or((768, 576)));
        let (camera, to_camera) = (&scene.camera, scene.camera.to_world.inverse());
        for i in 0..8 {
            let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
            let p = to_camera.transform_point3(Vec3::new(5.0 + 3.0 * sign(1), 0.5 * sign(2), sign(4)));
            assert!(p.z > 0.0 && (p.x / p.z).abs() < camera.half_width, "{p}");
            assert!((p.y / p.z).abs() < camera.half_width / camera.aspect, "{p}");
        }
    }
    assert!(try_load("", "<emitter type='constant'/>").is_ok());
    assert!(try_load("", "").is_err());
}

/// Expected values from Mitsuba 3.9.1.
#[test]
fn spheres_stay_round() {
    let own = "<float name='radius' value='2'/><point name='center' value='0.1 0.2 0.3'/>";
    for (matrix, [plain, moved], flipped) in [
        (
            "0.28 -0.066 0 0.51 0 0.28 -0.16 0.15 0.065 0.148 0.28 0.44 0 0 0 1",
            [([0.51, 0.15, 0.44], 0.287446), ([0.5248, 0.158, 0.5601], 0.574891)],
            false,
        ),
        ("1 0.5 0 0 0 1 0 0 0 0 1 0 0 0 0 1", [([0.0, 0.0, 0.0], 1.0), ([0.2, 0.2, 0.3], 2.0)], false),
        ("2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", [([0.0, 0.0, 0.0], 2.0), ([0.2, 0.2, 0.3], 4.0)], false),
        ("-1 0.3 0 0 0 1 0 0 0 0 1 0 0 0 0 1", [([0.0, 0.0, 0.0], 1.0), ([-0.04, 0.2, 0.3], 2.0)], true),
    ] {
        for (parameters, (center, radius)) in [("", plain), (own, moved)] {
            let transform = format!("<transform name='to_world'><matrix value='{matrix}'/></transform>");
            let (scene, warning) = warned(&format!("<shape type='sphere'>{parameters}{transform}</shape>"));
            let Shape::Sphere(sphere) = &scene.geometry.shapes[0] else { panic!() };
            assert!(sphere.center.distance(Vec3::from(center)) < 1e-5, "{matrix}: {}", sphere.center);
            assert!((sphere.radius - radius).abs() < 1e-5, "{matrix}: {}", sphere.radius);
            assert_eq!(sphere.flipped, flipped, "{matrix}");
            assert!(warning.contains("scene.xml:2: a sphere"), "{warning}");
        }
    }
    let flat = "<transform name='to_world'><scale x='0'/></transform>";
    refused(&format!("<shape type='sphere'>{flat}</shape>"), "singular");
}

/// As in Mitsuba 3.9.1, a sheared cylinder is what the transform makes of one.
#[test]
fn cylinders_are_sheared() {
    let m =
        DMat3::from_cols(DVec3::new(2.0, 0.1, 0.0), DVec3::new(0.5, 1.0, 0.2), DVec3::new(0.5, 0.0, -1.0));
    let rows: Vec<_> = m.transpose().to_cols_array().iter().map(f64::to_string).collect();
    let transform = format!("<transform name='to_world'><matrix value='{}'/></transform>", rows.join(" "));
    for flip in [false, true] {
        let flipped = format!("<boolean name='flip_normals' value='{flip}'/>");
        let radius = "<float name='radius' value='0.7'/>";
        let (scene, warning) =
            warned(&format!("<shape type='cylinder'>{radius}{flipped}{transform}</shape>"));
        assert!(warning.contains("256 flat sides"), "{warning}");
        let Shape::Mesh(mesh) = &scene.geometry.shapes[0] else { panic!() };
        for (i, p) in mesh.positions.iter().enumerate() {
            let own = m.inverse() * p.as_dvec3();
            assert!(
                (own.truncate().length() - 0.7).abs() < 1e-5
                    && (own.z.abs() < 1e-5 || (own.z - 1.0).abs() < 1e-5)
            );
            let n = (m.inverse().transpose() * own.with_z(0.0)).normalize() * if flip { -1.0 } else { 1.0 };
            assert!(mesh.normals[i].as_dvec3().distance(n) < 1e-5, "{n} {}", mesh.normals[i]);
        }
        for (i, triangle) in (0..).zip(&mesh.triangles) {
            assert!(mesh.area_vector(i).dot(mesh.normals[triangle[0] as usize]) > 0.0);
        }
        assert_eq!(mesh.uvs[2 * 64 + 1], Vec2::new(0.25, 1.0));
    }
    refused("<shape type='cylinder'><float name='radius' value='0'/></shape>", "radius");
    refused("<shape type='cylinder'><point name='p1' value='0,0,0'/></shape>", "differ");
}

#[test]
fn maps_may_name_their_image() {
    for (plugin, more) in [("normalmap", ""), ("bumpmap", "<float name='scale' value='2'/>")] {
        let image = "<string name='filename' value='row.png'/><string name='wrap_mode' value='clamp'/>";
        let body = format!("<bsdf type='{plugin}'>{image}{more}<bsdf type='diffuse'/></bsdf>");
        let scene = read(&format!("<shape type='rectangle'>{body}</shape>"));
        let texture = match scene.materials[0] {
            Material::NormalMap { normals: Color::Texture(texture), .. } => texture,
            Material::BumpMap { height: Scalar::Texture(texture), scale: 2.0, .. } => texture,
            ref other => panic!("{other:?}"),
        };
        let Texture::Bitmap(_) = &scene.textures[texture as usize] else { panic!() };
        let found = scene.textures[texture as usize].eval(&[], &Vec2::new(0.25, 0.5).into());
        // As stored, not as a colour.
        assert!((found.x - 128.0 / 255.0).abs() < 1e-3, "{plugin}: {found}");
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
}

#[test]
fn unknown_parameters_are_listed_last() {
    let scene = read(
        "<shape type='sphere'><boolean name='caustic_caster_multi' value='true'/><float name='radios' value='1'/></shape>\n\
         <shape type='sphere'><boolean name='caustic_caster_multi' value='true'/></shape>\
         <emitter type='point'><transform name='toWorld'><translate x='3'/></transform>\
         <texture name='gobo' type='bitmap'/><ref name='odd' id='nothing'/></emitter>\
         <rfilter type='box'/>stray",
    );
    let [_, renamed, sphere, point] = &scene.warnings[..] else { panic!("{:?}", scene.warnings) };
    assert!(renamed.contains("scene.xml:3: 'toWorld' is read as 'to_world'"), "{renamed}");
    assert!(matches!(scene.lights[0], Light::Point { position: Vec3 { x: 3.0, .. }, .. }));
    for (warning, words) in [
        (
            sphere,
            [
                "scene.xml:2: shape plugin 'sphere' does not know",
                "'caustic_caster_multi' (line 2), 'radios' (line 2, did you mean 'radius'?);",
                "it knows center, flip_normals, radius, silhouette_sampling_weight, to_world",
            ],
        ),
        (
            point,
            [
                "scene.xml:3: emitter plugin 'point' does not know",
                "'gobo' (line 3), 'odd' (line 3);",
                "it knows intensity, position, sampling_weight, to_world",
            ],
        ),
    ] {
        assert!(words.iter().all(|word| warning.contains(word)), "{warning}");
    }
    // Of those that are known the type counts, and what has to be there.
    refused("<shape type='sphere'><string name='radius' value='1'/></shape>", "type float, not string");
    refused("<shape type='obj'><string name='filname' value='a.obj'/></shape>", "'filename'");
    refused("<emitter type='point'><bsdf type='diffuse'/></emitter>", "<bsdf>");
}

#[test]
fn films_samplers_and_integrators_of_forks() {
    let film = "<film type='transient_hdr_film'><integer name='width' value='16'/><integer name='height' value='8'/>\
                <integer name='temporal_bins' value='300'/><rfilter type='voronoi'/><film type='hdrfilm'/></film>";
    let sampler = "<sampler type='paths'><integer name='sample_count' value='9'/><float name='odd' value='1'/></sampler>";
    let body = format!(
        "<sensor type='perspective'>{film}{sampler}</sensor><shape type='sphere'/>\
         <integrator type='transient_path'><string name='camera_unwarp' value='x'/><sampler type='independent'/>\
         <rgb name='tint' value='1'/><integrator type='guided'><integer name='max_depth' value='5'/></integrator></integrator>"
    );
    let scene = try_load("", &body).unwrap();
    assert_eq!((scene.film.size, scene.film.filter), ((16, 8), Filter::Gaussian { stddev: 0.5 }));
    assert_eq!((scene.sample_count, scene.integrator.as_str()), (9, "guided"));
    assert_eq!(scene.integrator_params[0].value, "5");
    for (word, what) in [
        ("unknown film plugin 'transient_hdr_film'", "'hdrfilm'"),
        ("unknown rfilter plugin 'voronoi'", "gaussian"),
        ("unknown sampler plugin 'paths'", "number of samples"),
        ("unknown integrator plugin 'transient_path'", "wraps"),
        ("unknown integrator plugin 'guided'", "photon mapping"),
    ] {
        let found = scene.warnings.iter().filter(|w| w.contains(word) && w.contains(what)).count();
        assert_eq!(found, 1, "{word}: {:?}", scene.warnings);
    }
    let [.., film, sampler] = &scene.warnings[..] else { panic!("{:?}", scene.warnings) };
    assert!(film.contains("'temporal_bins'") && sampler.contains("'odd'"), "{film} {sampler}");
    // What says nothing of the light is passed over.
    let (scene, warning) =
        warned("<integrator type='path'><rgb name='tint' value='1'/></integrator><shape type='sphere'/>");
    assert!(scene.integrator_params.is_empty() && warning.contains("'tint'"), "{warning}");
}

#[test]
fn distributions_in_names() {
    for (plugin, distribution) in [
        ("roughconductorGGX", Distribution::Ggx),
        ("roughconductor_ggx", Distribution::Ggx),
        ("roughconductorBeckmann", Distribution::Beckmann),
    ] {
        let (material, warning) =
            material(&format!("<bsdf type='{plugin}'><float name='alpha' value='.3'/></bsdf>"));
        let Material::RoughConductor { roughness, .. } = material else { panic!("{material:?}") };
        assert_eq!((roughness.distribution, roughness.alpha_u), (distribution, Scalar::Constant(0.3)));
        assert!(warning.contains("scene.xml:2: ") && warning.contains(plugin), "{warning}");
    }
    assert!(matches!(material("<bsdf type='roughdielectricGGX'/>").0, Material::RoughDielectric { .. }));
    // What is said counts.
    let said = "<bsdf type='roughconductorGGX'><string name='distribution' value='beckmann'/></bsdf>";
    let Material::RoughConductor { roughness, .. } = material(said).0 else { panic!() };
    assert_eq!(roughness.distribution, Distribution::Beckmann);
    refused("<shape type='cube'><bsdf type='roughconductorial'/></shape>", "unknown bsdf");
}

#[test]
fn raw_constants_of_three_numbers() {
    let color = |value: &str| {
        let texture = format!("<spectrum type='rawconstant' name='reflectance'>{value}</spectrum>");
        match material(&format!("<bsdf type='diffuse'>{texture}</bsdf>")).0 {
            Material::Diffuse { reflectance: Color::Constant(rgb) } => rgb,
            other => panic!("{other:?}"),
        }
    };
    for (value, expected) in [
        ("<vector name='value' value='0.2 0.5 0.7'/>", Rgb::new(0.2, 0.5, 0.7)),
        ("<vector name='value' x='0.2' y='0.5' z='0.7'/>", Rgb::new(0.2, 0.5, 0.7)),
        ("<rgb name='value' value='0.2 0.5 0.7'/>", Rgb::new(0.2, 0.5, 0.7)),
        ("<float name='value' value='0.2'/>", Rgb::splat(0.2)),
    ] {
        assert_eq!(color(value), expected, "{value}");
    }
    let normals =
        "<texture name='normalmap' type='rawconstant'><vector name='value' value='0.6 0.5 0.9'/></texture>";
    let (tilted, _) = material(&format!("<bsdf type='normalmap'>{normals}<bsdf type='diffuse'/></bsdf>"));
    assert!(matches!(tilted, Material::NormalMap { normals: Color::Constant(n), .. } if n.z == 0.9));
    let wrong = "<texture name='reflectance' type='rawconstant'><string name='value' value='1'/></texture>";
    refused(&format!("<shape type='cube'><bsdf type='diffuse'>{wrong}</bsdf></shape>"), "not string");
}

#[test]
fn disney_bsdfs_are_principled() {
    let read = |plugin: &str, inside: &str| {
        let color = "<rgb name='baseColor' value='0.8 0.4 0.2'/><float name='roughness' value='0.3'/>";
        let (material, warning) = material(&format!("<bsdf type='{plugin}'>{color}{inside}</bsdf>"));
        assert!(warning.contains(&format!("'{plugin}' is read as 'principled'")), "{warning}");
        let Material::Principled(p) = material else { panic!("{material:?}") };
        *p
    };
    let is = |scalar, value: f32| matches!(scalar, Scalar::Constant(v) if (v - value).abs() < 1e-6);
    let color = Color::Constant(Rgb::new(0.8, 0.4, 0.2));
    let whole = "<float name='specularTransmission' value='0.1'/><float name='metallic' value='0.2'/>\
                 <float name='subsurface' value='0.3'/><float name='specular' value='0.4'/>\
                 <float name='specularTint' value='0.5'/><float name='anisotropic' value='0.6'/>\
                 <float name='sheen' value='0.7'/><float name='sheenTint' value='0.8'/>\
                 <float name='clearcoat' value='0.9'/><float name='clearcoatGloss' value='0.95'/>\
                 <float name='eta' value='1.6'/>";
    let p = read("disneybsdf", whole);
    assert_eq!((p.base_color, p.eta), (color, 1.6));
    for (found, expected) in [
        (p.spec_trans, 0.1),
        (p.metallic, 0.2),
        (p.flatness, 0.3),
        (p.roughness, 0.3),
        (p.spec_tint, 0.5),
        (p.anisotropic, 0.6),
        (p.sheen, 0.7),
        (p.sheen_tint, 0.8),
        (p.clearcoat, 0.9),
        (p.clearcoat_gloss, 0.95),
    ] {
        assert!(is(found, expected), "{found:?} {expected}");
    }
    let diffuse = read("disneydiffuse", "<float name='subsurface' value='0.3'/>");
    assert!(is(diffuse.flatness, 0.3) && is(diffuse.metallic, 0.0) && diffuse.eta == 1.0);
    let metal = read("disneymetal", "<float name='anisotropic' value='0.3'/>");
    assert!(is(metal.metallic, 1.0) && is(metal.anisotropic, 0.3) && metal.base_color == color);
    let glass = read("disneyglass", "<float name='eta' value='1.3'/>");
    assert!(is(glass.spec_trans, 1.0) && glass.eta == 1.3 && glass.base_color == color);
    let coat = read("disneyclearcoat", "<float name='clearcoatGloss' value='0.3'/>");
    assert!(is(coat.clearcoat_gloss, 0.3) && coat.base_color == Color::Constant(Rgb::ZERO));
    let sheen = read("disneysheen", "<float name='sheenTint' value='0.3'/>");
    assert!(is(sheen.sheen, 1.0) && is(sheen.sheen_tint, 0.3) && sheen.eta == 1.0);
    refused("<shape type='cube'><bsdf type='disneyland'/></shape>", "unknown bsdf plugin 'disneyland'");
}

#[test]
fn all_missing_files_are_told_at_once() {
    let mesh = |name: &str| format!("<shape type='obj'><string name='filename' value='{name}'/></shape>");
    let texture =
        "<texture type='bitmap' name='reflectance'><string name='filename' value='no.png'/></texture>";
    let spectrum = "<spectrum name='intensity' filename='no.spd'/>";
    let body = [
        "<include filename='no.xml'/>".into(),
        mesh("a.obj"),
        mesh("no.obj"),
        // Perhaps the include defines these.
        "<shape type='sphere'><ref id='perhaps'/></shape>".into(),
        format!("<shape type='sphere'><bsdf type='diffuse'>{texture}</bsdf></shape>"),
        mesh("no.obj"),
        format!("<emitter type='point'>{spectrum}</emitter>"),
        "<emitter type='envmap'><string name='filename' value='no.exr'/></emitter>".into(),
        "<path value='nowhere'/>".into(),
    ];
    let told = |body: &str| match try_load(SENSOR, body) {
        Err(Error::Scene { line: 2, message, .. }) => message,
        other => panic!("{:?}", other.map(|_| ())),
    };
    let all = told(&body.join("\n"));
    let expected = [
        ("file 'no.xml'", 2),
        ("file 'no.obj'", 4),
        ("file 'no.png'", 6),
        ("file 'no.spd'", 8),
        ("file 'no.exr'", 9),
        ("folder 'nowhere'", 10),
    ];
    let (head, list) = all.split_once("): ").unwrap();
    assert!(head.starts_with("6 files not found"), "{all}");
    let list: Vec<_> = list.split("; ").collect();
    assert_eq!(list.len(), expected.len(), "{all}");
    for (found, (what, line)) in list.iter().zip(expected) {
        assert!(found.ends_with(&format!("scene.xml:{line}: {what}")), "{all}");
    }
    assert!(told(&mesh("no.obj")).starts_with("file 'no.obj' not found"));
    // However they are read: a projector wants its picture at once.
    let projector = "<emitter type='projector'><texture type='bitmap' name='irradiance'>\
                     <string name='filename' value='no.png'/></texture></emitter>";
    assert!(told(projector).contains("'no.png' not found"));
}
