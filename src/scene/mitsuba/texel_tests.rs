//! Values of textures, by what they are used for.

use crate::image_io::{Channels, Image, Layer, Metadata, SampleType, write_exr};
use crate::math::Rgb;
use crate::scene::load;
use crate::{Error, Result};
use std::fs;

/// Loads a scene of version `version`; `t.exr` has this value in texel (2, 1), `m.ply` as the colour and as
/// `vertex_a` of vertex 1. `BITMAP` in the body stands for a texture of that file, but for its name; the line
/// after the first has to be the one that errors name.
fn load_with(value: f32, version: &str, body: &str) -> Result<()> {
    let folder = tempfile::tempdir().unwrap();
    let mut pixels = vec![Rgb::splat(0.5); 12];
    pixels[6].y = value;
    let image = Image { width: 4, height: 3, pixels };
    let layer = Layer { name: String::new(), image, channels: Channels::Rgb };
    write_exr(&folder.path().join("t.exr"), &[layer], &Metadata::default(), SampleType::Float).unwrap();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         property float r\nproperty float g\nproperty float b\nproperty float a_x\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n\
         0 0 0 .5 .5 .5 .5\n1 0 0 .5 {value} .5 {value}\n0 1 0 .5 .5 .5 .5\n3 0 1 2\n"
    );
    fs::write(folder.path().join("m.ply"), ply).unwrap();
    let body = body
        .replace("BITMAP", "type='bitmap'><string name='filename' value='t.exr'/></texture>")
        .replace("MESH", "<shape type='ply'><string name='filename' value='m.ply'/>")
        .replace("ATTRIBUTE", "type='mesh_attribute'><string name='name'");
    let path = folder.path().join("scene.xml");
    let sensor = "<sensor type='perspective'/>";
    fs::write(&path, format!("<scene version='{version}'>{sensor}\n{body}\n</scene>")).unwrap();
    load(&path, &[], None).map(drop)
}

/// How many of 0.25, -1, ∞ and NaN are allowed, in this order; errors name file, line 2 and texel or vertex.
fn allowed(version: &str, body: &str, said: [&str; 2]) -> usize {
    let values = [0.25, -1.0, f32::INFINITY, f32::NAN];
    let is_allowed = values.map(|value| match load_with(value, version, body) {
        Ok(()) => true,
        Err(Error::Scene { file, line, message }) => {
            let complete = said.iter().all(|said| message.contains(said)) && message.contains("change it");
            assert!(file.ends_with("scene.xml") && line == 2 && complete, "{value}: {line}: {message}");
            false
        }
        Err(e) => panic!("{value}: {e}"),
    });
    let count = is_allowed.iter().filter(|a| **a).count();
    assert!(is_allowed[..count].iter().all(|a| *a), "{body}: {is_allowed:?}");
    count
}

const TEXEL: [&str; 2] = ["t.exr", "the texel (2, 1) is"];

#[test]
fn colors_are_not_negative() {
    for (version, body) in [
        (
            "3.0.0",
            "<shape type='sphere'><bsdf type='diffuse'><texture name='reflectance' BITMAP</bsdf></shape>",
        ),
        (
            "3.0.0",
            "<shape type='sphere'><bsdf type='dielectric'><texture name='specular_transmittance' BITMAP</bsdf>\
             </shape>",
        ),
        (
            "3.0.0",
            "<shape type='sphere'><bsdf type='twosided'><bsdf type='principled'>\
             <texture name='base_color' BITMAP</bsdf></bsdf></shape>",
        ),
        // Within another texture.
        (
            "3.0.0",
            "<shape type='sphere'><bsdf type='diffuse'><texture name='reflectance' type='checkerboard'>\
             <texture name='color1' BITMAP</texture></bsdf></shape>",
        ),
        (
            "0.6.0",
            "<shape type='sphere'><bsdf type='diffuse'><texture name='reflectance' type='scale'>\
             <float name='scale' value='.5'/><texture BITMAP</texture></bsdf></shape>",
        ),
        // Used for something else before, or after.
        (
            "3.0.0",
            "<texture id='t' BITMAP\n<shape type='sphere'><bsdf type='normalmap'><ref id='t'/>\
             <bsdf type='diffuse'/></bsdf></shape><shape type='sphere'><bsdf type='diffuse'>\
             <ref name='reflectance' id='t'/></bsdf></shape>",
        ),
        (
            "3.0.0",
            "<texture id='t' BITMAP\n<shape type='sphere'><bsdf type='diffuse'><ref name='reflectance' id='t'/>\
             </bsdf></shape><shape type='sphere'><bsdf type='normalmap'><ref id='t'/><bsdf type='diffuse'/>\
             </bsdf></shape>",
        ),
        // Lamps.
        (
            "3.0.0",
            "<shape type='sphere'><emitter type='area'><texture name='radiance' BITMAP</emitter></shape>",
        ),
        (
            "3.0.0",
            "<shape type='sphere'><emitter type='directionalarea'><texture name='radiance' BITMAP</emitter>\
             </shape>",
        ),
        ("3.0.0", "<emitter type='projector'><texture name='irradiance' BITMAP</emitter>"),
        ("3.0.0", "<emitter type='spot'><texture name='texture' BITMAP</emitter>"),
        ("3.0.0", "<emitter type='envmap'><string name='filename' value='t.exr'/></emitter>"),
        // More than all light would get through it.
        (
            "0.6.0",
            "<shape type='sphere'><bsdf type='coating'><texture name='sigmaA' BITMAP<bsdf type='diffuse'/></bsdf>\
             </shape>",
        ),
    ] {
        assert_eq!(allowed(version, body, TEXEL), 1, "{body}");
    }
}

#[test]
fn parameters_are_finite() {
    for bsdf in [
        "<bsdf type='roughconductor'><texture name='alpha' BITMAP</bsdf>",
        "<bsdf type='principled'><texture name='roughness' BITMAP<texture name='metallic' BITMAP</bsdf>",
        "<bsdf type='mask'><texture name='opacity' BITMAP<bsdf type='diffuse'/></bsdf>",
        "<bsdf type='blendbsdf'><texture name='weight' BITMAP<bsdf type='diffuse'/><bsdf type='diffuse'/></bsdf>",
        "<bsdf type='bumpmap'><texture BITMAP<bsdf type='diffuse'/></bsdf>",
        "<bsdf type='normalmap'><texture name='normalmap' BITMAP<bsdf type='diffuse'/></bsdf>",
        // Measured metals have negative ones.
        "<bsdf type='conductor'><texture name='eta' BITMAP<rgb name='k' value='1'/></bsdf>",
    ] {
        let body = format!("<shape type='sphere'>{bsdf}</shape>");
        assert_eq!(allowed("3.0.0", &body, TEXEL), 2, "{body}");
    }
}

#[test]
fn what_nothing_uses_is_not_checked() {
    let body = "<bsdf type='diffuse' id='b'><texture name='reflectance' BITMAP</bsdf><shape type='sphere'/>";
    assert_eq!(allowed("3.0.0", body, TEXEL), 4);
}

#[test]
fn products_are_finite() {
    let fails = |version, body| {
        assert!(load_with(1.0, version, body).is_ok(), "{body}");
        let error = load_with(1e38, version, body).unwrap_err().to_string();
        assert!(error.contains("texel (2, 1)") && error.contains("times the scale"), "{error}");
    };
    fails(
        "0.6.0",
        "<shape type='sphere'><emitter type='area'><texture name='radiance' type='scale'>\
         <float name='scale' value='10'/><texture BITMAP</texture></emitter></shape>",
    );
    fails(
        "3.0.0",
        "<emitter type='projector'><texture name='irradiance' BITMAP<float name='scale' value='2'/></emitter>",
    );
    fails(
        "3.0.0",
        "<emitter type='envmap'><string name='filename' value='t.exr'/><float name='scale' value='10'/></emitter>",
    );
}

#[test]
fn attributes_of_meshes_are_checked() {
    for (body, count) in [
        (
            "MESH<bsdf type='diffuse'><texture name='reflectance' ATTRIBUTE value='vertex_color'/></texture></bsdf>",
            1,
        ),
        (
            "MESH<emitter type='area'><texture name='radiance' ATTRIBUTE value='vertex_a'/></texture></emitter>",
            1,
        ),
        (
            "MESH<bsdf type='roughconductor'><texture name='alpha' ATTRIBUTE value='vertex_a'/></texture></bsdf>",
            2,
        ),
        (
            "MESH<bsdf type='roughconductor'><texture name='eta' ATTRIBUTE value='vertex_color'/></texture></bsdf>",
            2,
        ),
        ("MESH<bsdf type='diffuse'/>", 4),
    ] {
        let body = format!("{body}</shape>");
        assert_eq!(allowed("3.0.0", &body, ["m.ply", "of vertex 1 is"]), count, "{body}");
    }
    // A negative factor on a colour.
    let body = "MESH<bsdf type='diffuse'><texture name='reflectance' ATTRIBUTE value='vertex_color'/>\
                <float name='scale' value='-1'/></texture></bsdf></shape>";
    assert!(load_with(0.5, "3.0.0", body).unwrap_err().to_string().contains("times [-1, -1, -1]"));
}

#[test]
fn spectra_are_checked_like_textures() {
    let load = |value: &str| {
        let body = format!(
            "<shape type='sphere'><bsdf type='diffuse'>\n<spectrum name='reflectance' type='uniform'>\
             <float name='value' value='{value}'/></spectrum></bsdf></shape>"
        );
        load_with(0.5, "3.0.0", &body)
    };
    assert!(load("0.25").is_ok());
    for value in ["-0.25", "1e39"] {
        let error = load(value).unwrap_err().to_string();
        assert!(error.contains("scene.xml:3") && error.contains("'reflectance'"), "{error}");
    }
}
