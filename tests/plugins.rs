//! `docs/plugins.md` says what becomes of every plugin; here it is held to that.

mod common;

use caustica::integrator::Kind;
use common::{assert_close, backends, load, mean, own_scene, render};
use glam::Vec3;
use std::fs;
use std::path::Path;

const IMAGE: &str = "<string name='filename' value='tiles.png'/>";

/// What the plugin needs inside.
fn inside(kind: &str, plugin: &str) -> String {
    let diffuse = "<bsdf type='diffuse'/>";
    let texture = format!("<texture type='bitmap'>{IMAGE}</texture>");
    match (kind, plugin) {
        (_, "blendbsdf") => format!("<float name='weight' value='0.5'/>{diffuse}{diffuse}"),
        (_, "mixturebsdf") => format!("<string name='weights' value='0.5, 0.3'/>{diffuse}{diffuse}"),
        (_, "normalmap") => {
            format!("{}{diffuse}", texture.replace("texture type", "texture name='normalmap' type"))
        }
        (_, "bumpmap") => format!("{texture}{diffuse}"),
        (_, "coating" | "roughcoating" | "mask" | "twosided") => diffuse.into(),
        (_, "envmap" | "bitmap") => IMAGE.into(),
        (_, "sunsky" | "sky" | "sun") => "<vector name='sun_direction' x='0.1' y='0.9' z='0.6'/>".into(),
        (_, "obj") => "<string name='filename' value='mesh.obj'/>".into(),
        (_, "ply") => "<string name='filename' value='Cone.ply'/>".into(),
        (_, "instance") => "<ref id='group'/>".into(),
        (_, "merge") => "<shape type='sphere'/>".into(),
        (_, "shapegroup") => "<shape type='cube'/>".into(),
        (_, "mesh_attribute") => "<string name='name' value='vertex_color'/>".into(),
        (_, "scale") => format!("<float name='scale' value='0.5'/>{texture}"),
        (_, "thinlens") => "<float name='aperture_radius' value='0.1'/>".into(),
        (_, "blackbody") => "<float name='temperature' value='3000'/>".into(),
        (_, "rawconstant" | "uniform") => "<float name='value' value='0.5'/>".into(),
        (_, "srgb") => "<rgb name='color' value='0.5'/>".into(),
        (_, "regular") => "<string name='values' value='1, 2'/><float name='wavelength_min' value='400'/>\
                           <float name='wavelength_max' value='700'/>"
            .into(),
        (_, "irregular") => {
            "<string name='values' value='1, 2'/><string name='wavelengths' value='400, 700'/>".into()
        }
        (_, "moment" | "aov" | "stokes" | "irrcache" | "adaptive" | "multichannel") => {
            "<integrator type='path'/>".into()
        }
        _ => String::new(),
    }
}

/// A scene with the plugin, on line 2.
fn scene(version: &str, kind: &str, plugin: &str) -> String {
    let inside = inside(kind, plugin);
    let one = match kind {
        "spectrum" => format!("<spectrum type='{plugin}' name='radiance'>{inside}</spectrum>"),
        "texture" => format!("<texture type='{plugin}' name='reflectance'>{inside}</texture>"),
        _ => format!("<{kind} type='{plugin}'>{inside}</{kind}>"),
    };
    let film = |rfilter: &str| format!("<film type='hdrfilm'>{rfilter}</film>");
    let sensor = match kind {
        "sensor" => one.clone(),
        "film" | "sampler" => format!("<sensor type='perspective'>{one}</sensor>"),
        "rfilter" => format!("<sensor type='perspective'>{}</sensor>", film(&one)),
        _ => "<sensor type='perspective'/>".into(),
    };
    let body = match kind {
        "bsdf" => format!("<shape type='sphere'>{one}</shape>"),
        "emitter" if plugin.ends_with("area") => format!("<shape type='sphere'>{one}</shape>"),
        "texture" => {
            format!(
                "<shape type='serialized'><string name='filename' value='colored.serialized'/>\
                     <bsdf type='diffuse'>{one}</bsdf></shape>"
            )
        }
        "spectrum" => format!("<emitter type='constant'>{one}</emitter>"),
        "emitter" | "shape" | "integrator" => one,
        "subsurface" => format!("<shape type='sphere'>{one}</shape>"),
        "medium" => format!("<shape type='sphere'>{}</shape>", one.replace(" type", " name='interior' type")),
        "phase" | "volume" => format!(
            "<shape type='sphere'><medium name='exterior' type='heterogeneous'>{one}</medium></shape>"
        ),
        "sensor" | "film" | "sampler" | "rfilter" => String::new(),
        _ => panic!("no scene for <{kind}>"),
    };
    format!(
        "<scene version='{version}'><shape type='shapegroup' id='group'><shape type='sphere'/></shape>\n{}\n\
         <shape type='sphere'/></scene>",
        format!("{sensor}{body}").replace('\n', "")
    )
}

/// One triangle with vertex colours, in Mitsuba's own format.
fn serialized() -> Vec<u8> {
    use std::io::Write;
    let mut body = Vec::new();
    body.extend(0x1008u32.to_le_bytes());
    body.extend(b"\0");
    body.extend(3u64.to_le_bytes());
    body.extend(1u64.to_le_bytes());
    let floats = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0.5, 0.5, 0.5, 0.1, 0.2, 0.3, 0.9, 0.8, 0.7f32];
    body.extend(floats.iter().flat_map(|v| v.to_le_bytes()));
    body.extend([0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()));
    let mut zlib = flate2::write::ZlibEncoder::new(vec![0x1C, 0x04, 4, 0], flate2::Compression::fast());
    zlib.write_all(&body).unwrap();
    zlib.finish().unwrap()
}

#[test]
fn the_table_of_plugins_is_true() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    for name in ["textures/tiles.png", "meshes/Cone.ply"] {
        let file = root.join("scenes/blender").join(name);
        put(file.file_name().unwrap().to_str().unwrap(), &fs::read(&file).unwrap());
    }
    put("mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    put("colored.serialized", &serialized());
    let path = folder.path().join("scene.xml");

    let table = fs::read_to_string(root.join("docs/plugins.md")).unwrap();
    let (mut kind, mut checked) = (String::new(), 0);
    for line in table.lines().filter(|l| l.starts_with('|')) {
        let cells: Vec<_> = line.split('|').map(str::trim).collect();
        if !cells[1].starts_with('`') {
            kind = if cells[1].starts_with('-') { kind } else { cells[1].into() };
            continue;
        }
        let plugin = cells[1].trim_matches('`');
        for (version, outcome) in [("3.0.0", cells[2]), ("0.6.0", cells[3])] {
            let mut text = scene(version, &kind, plugin);
            if plugin == "serialized" {
                text = text.replace(
                    "<shape type='serialized'>",
                    "<shape type='serialized'><string name='filename' value='colored.serialized'/>",
                );
            }
            fs::write(&path, &text).unwrap();
            let loaded = caustica::scene::load(&path, &[], None);
            let what = format!("{kind} '{plugin}' of version {version} should be {outcome}");
            match outcome {
                "read" => {
                    let scene = loaded.unwrap_or_else(|e| panic!("{what}: {e}\n{text}"));
                    assert!(scene.warnings.is_empty(), "{what}: {:?}", scene.warnings);
                }
                "warning" => {
                    let warnings = loaded.unwrap_or_else(|e| panic!("{what}: {e}\n{text}")).warnings;
                    let [warning] = &warnings[..] else { panic!("{what}: {warnings:?}") };
                    assert!(
                        warning.contains("scene.xml:2:") && warning.contains(plugin),
                        "{what}: {warning}"
                    );
                }
                "refused" => {
                    let error = loaded.map(|_| ()).expect_err(&what).to_string();
                    let blamed = match kind.as_str() {
                        "phase" | "volume" => "medium plugin 'heterogeneous'".into(),
                        _ => format!("{kind} plugin '{plugin}'"),
                    };
                    assert!(error.contains("scene.xml:2:") && error.contains(&blamed), "{what}: {error}");
                    // Not as a typing error.
                    assert!(error.contains("not supported") && !error.contains("unknown"), "{what}: {error}");
                }
                "–" => continue,
                other => panic!("{what}: what is '{other}'?"),
            }
            checked += 1;
        }
    }
    assert!(checked > 230, "{checked} rows");
}

/// A typing error is told what there is: what the table says of Mitsuba 3.
#[test]
fn typing_errors_are_told_what_there_is() {
    let table = include_str!("../docs/plugins.md");
    let rows: Vec<Vec<_>> = table.lines().map(|l| l.split('|').map(str::trim).collect()).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    for kind in ["bsdf", "emitter", "shape", "texture", "sensor", "film", "rfilter", "sampler", "integrator"]
    {
        let text = scene("3.0.0", kind, "misprint").replace("colored.serialized", "mesh.obj");
        fs::write(&path, text.replace("type='serialized'", "type='obj'")).unwrap();
        fs::write(folder.path().join("mesh.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let told = match caustica::scene::load(&path, &[], None) {
            Err(error) => error.to_string(),
            Ok(scene) => scene.warnings.concat(),
        };
        assert!(told.contains(&format!("scene.xml:2: unknown {kind} plugin 'misprint'")), "{told}");
        let (_, known) = told.split_once("known are ").unwrap();
        let known: Vec<_> = known.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        let of_kind = rows.iter().skip_while(|r| r.get(1) != Some(&kind)).skip(2).take_while(|r| r.len() > 4);
        for row in of_kind.filter(|row| row[2] != "–") {
            let plugin = row[1].trim_matches('`');
            assert_eq!(known.contains(&plugin), row[2] != "refused", "{plugin}: {told}");
        }
    }
}

/// An export as Blender's add-on wrote it, against Mitsuba 3.9.1's `path` (2048 samples, standard error 0.05 %).
#[test]
fn a_blender_export_renders() {
    let mitsuba = Vec3::new(0.5208, 0.4068, 0.3537);
    for backend in backends() {
        let scene = load(&own_scene("blender/scene.xml"), 128, backend);
        for integrator in [Kind::Path, Kind::Photonmap] {
            let image = render(&scene, integrator, &["max_depth=12"], 16).image;
            assert_close(mean(&image), mitsuba, 0.015, &format!("{} {integrator:?}", backend.name()));
        }
    }
}
