//! Scenes that are a bare `.obj` with its `.mtl`. What the materials become:
//!
//! | MTL | material |
//! |---|---|
//! | `Ke` or `map_Ke`, not black | area light of that radiance, on the front side |
//! | `illum` 4, 6, 7 or 9, or `d` < 1 with both `Tf` and `Ni` ≠ 1 | smooth glass of index `Ni` (1.5 if absent or 1), tinted by `Tf` |
//! | `illum` 3, 5 or 8 | mirror of reflectance `Ks` |
//! | `Ks` not black, `Kd` black without `map_Kd` | rough metal of reflectance `Ks` and roughness α = √(2 / (Ns + 2)) |
//! | `Ks` not black, `illum` not 0 or 1 | diffuse `Kd` under a rough coating of index 1.5, its reflection scaled by `Ks` |
//! | anything else | diffuse `Kd` |
//!
//! `map_Kd` replaces `Kd`. `d` < 1, `Tr` > 0 or `map_d` make holes in what is not glass. Surfaces have two sides.
//! The camera looks at the middle of everything from a little above, +y being up; where nothing emits, a constant
//! white sky lights the scene.

use super::material::{Material, Roughness};
use super::pending::Pending;
use super::place::{Placement, look_at, place};
use super::{SceneDescription, lines, obj};
use crate::bsdf::{Distribution, RoughCoating};
use crate::camera::{Camera, Projection};
use crate::film::{FilmSettings, Filter};
use crate::image_io::{self, Domain, Encoding};
use crate::light::Light;
use crate::math::Rgb;
use crate::shape::{Bounds, Geometry, Shape};
use crate::texture::{Bitmap, Color, Interpolation, Scalar, Texture, Wrap};
use crate::{Error, Result};
use glam::{Affine2, Affine3A, DVec3, Mat4, Vec2};
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Index of glass and coatings that give none.
const INDEX: f32 = 1.5;
const FIELD_OF_VIEW: f32 = 40.0;

/// One material of an MTL file.
#[derive(Clone, Debug, Default)]
struct Mtl {
    line: u32,
    kd: Option<Rgb>,
    ks: Rgb,
    ke: Rgb,
    tf: Option<Rgb>,
    ns: f32,
    ni: Option<f32>,
    opacity: Option<f32>,
    illum: Option<i32>,
    map_kd: Option<PathBuf>,
    map_ke: Option<PathBuf>,
    map_d: Option<PathBuf>,
}

/// Reads an OBJ and everything that belongs to it.
pub(super) fn load(path: &Path, size: Option<(u32, u32)>) -> Result<SceneDescription> {
    let obj = obj::Obj::read(path, true)?;
    let mut library = HashMap::new();
    for (names, line) in &obj.libraries {
        let at_line = |message| Error::Scene { file: path.into(), line: *line, message };
        for file in library_files(names, path.parent().unwrap_or(Path::new(""))) {
            let text = std::fs::read(&file).map_err(|e| {
                at_line(format!("cannot read the material library '{}': {e}", file.display()))
            })?;
            parse(&text, &file, &mut library)?;
        }
    }
    if obj.is_empty() {
        let message = "the file has no face of three or more corners: there is nothing to render";
        return Err(Error::File { file: path.into(), message: message.into() });
    }
    let mut builder = Builder { warnings: obj.warning(path).into_iter().collect(), ..Builder::default() };
    let mut meshes = Vec::new();
    for (name, line, mesh) in obj.meshes() {
        let (mtl, file) = match library.get(&name) {
            Some((mtl, file)) => (mtl.clone(), file.clone()),
            None if name.is_empty() || obj.libraries.is_empty() => (Mtl::default(), path.to_path_buf()),
            None => {
                let message = format!("no material library defines '{name}'");
                return Err(Error::Scene { file: path.into(), line, message });
            }
        };
        if !library.contains_key(&name) && !name.is_empty() {
            builder.warnings.push(format!(
                "{}:{line}: material '{name}' is unknown, as there is no mtllib: grey",
                path.display()
            ));
        }
        builder.add(&mtl, &file, meshes.len() as u32)?;
        meshes.push(mesh);
    }
    drop(obj);
    let placed = meshes.into_par_iter().map(|mesh| place(mesh, &Placement::IDENTITY).map(Shape::Mesh));
    let (textures, placed) = rayon::join(|| Pending::all(builder.textures), || placed.collect::<Vec<_>>());
    let textures = textures.map_err(|(_, error)| error)?;
    let shapes = placed
        .into_iter()
        .collect::<std::result::Result<Vec<_>, String>>()
        .map_err(|message| Error::File { file: path.into(), message })?;
    let geometry = Geometry::from(shapes);
    if builder.lights.is_empty() {
        builder.lights.push(Light::Constant { radiance: Rgb::ONE });
        let message = "no material emits light (Ke): a constant white sky lights the scene";
        builder.warnings.push(format!("{}: {message}", path.display()));
    }
    let (width, height) = size.unwrap_or((768, 576));
    Ok(SceneDescription {
        camera: camera(geometry.bounds(), width as f32 / height as f32),
        geometry,
        shape_material: builder.shape_material,
        materials: builder.materials,
        textures,
        lights: builder.lights,
        film: FilmSettings {
            size: (width, height),
            crop: (0, 0, width, height),
            filter: Filter::Gaussian { stddev: 0.5 },
        },
        sample_count: 16,
        integrator: String::new(),
        integrator_params: Vec::new(),
        warnings: builder.warnings,
    })
}

/// A camera that sees all of `bounds`.
pub(super) fn camera(bounds: Bounds, aspect: f32) -> Camera {
    let half_width = (0.5 * FIELD_OF_VIEW.to_radians()).tan();
    let smaller = half_width.min(half_width / aspect).atan();
    let (center, radius) = match bounds.is_empty() {
        true => (DVec3::ZERO, 1.0),
        false => (bounds.center().as_dvec3(), bounds.radius().max(f32::MIN_POSITIVE) as f64),
    };
    let distance = radius / (smaller as f64).sin();
    let eye = center + DVec3::new(0.4, 0.35, 1.0).normalize() * distance;
    let to_world = look_at(eye, center, DVec3::Y).unwrap_or(glam::DMat4::IDENTITY);
    Camera {
        to_world: Affine3A::from_mat4(Mat4::from_cols_array(&to_world.to_cols_array().map(|x| x as f32))),
        projection: Projection::Perspective,
        half_width,
        aspect,
        principal_offset: Vec2::ZERO,
        clip: (0.0, f32::INFINITY),
        aperture_radius: 0.0,
        focus_distance: distance as f32,
    }
}

#[derive(Default)]
struct Builder {
    materials: Vec<Material>,
    shape_material: Vec<u32>,
    textures: Vec<Pending<Texture>>,
    /// By file and whether it is a colour.
    texture_of: HashMap<(PathBuf, bool), u32>,
    /// By roughness: their tables cost time.
    coatings: HashMap<u32, RoughCoating>,
    lights: Vec<Light>,
    warnings: Vec<String>,
}

impl Builder {
    fn texture(&mut self, path: &Path, srgb: bool, mtl: &Mtl, file: &Path) -> Result<u32> {
        let key = (path.to_path_buf(), srgb);
        if let Some(index) = self.texture_of.get(&key) {
            return Ok(*index);
        }
        let (path, file, line) = (path.to_path_buf(), file.to_path_buf(), mtl.line);
        let index = self.textures.len() as u32;
        let (encoding, domain) = match srgb {
            true => (Encoding::Srgb, Domain::NonNegative),
            false => (Encoding::Linear, Domain::Finite),
        };
        self.textures.push(Pending::file(index, move || {
            let image = image_io::read_encoded(&path, encoding).map_err(|e| e.to_string());
            let bitmap = image.and_then(|image| {
                let check = image.check(domain, Rgb::ONE);
                check.map_err(|message| format!("{}: {message}", path.display()))?;
                Bitmap::new(image, Interpolation::Bilinear, [Wrap::Repeat; 2], Affine2::IDENTITY)
            });
            bitmap.map(Texture::Bitmap).map_err(|message| Error::Scene { file, line, message })
        }));
        self.texture_of.insert(key, index);
        Ok(index)
    }

    fn add(&mut self, mtl: &Mtl, file: &Path, shape: u32) -> Result<()> {
        let mut material = self.surface(mtl, file)?;
        if !matches!(material, Material::Dielectric { .. }) {
            material = Material::TwoSided { front: Box::new(material), back: None };
            let opacity = match &mtl.map_d {
                Some(map) => Some(Scalar::Texture(self.texture(map, false, mtl, file)?)),
                None => mtl.opacity.filter(|d| *d < 1.0).map(Scalar::Constant),
            };
            if let Some(opacity) = opacity {
                material = Material::Mask { opacity, nested: Box::new(material) };
            }
        }
        if let Some(map) = &mtl.map_ke {
            let radiance = Color::Texture(self.texture(map, true, mtl, file)?);
            self.lights.push(Light::Area { shape, radiance });
        } else if mtl.ke.max_element() > 0.0 {
            self.lights.push(Light::Area { shape, radiance: Color::Constant(mtl.ke) });
        }
        self.shape_material.push(self.materials.len() as u32);
        self.materials.push(material);
        Ok(())
    }

    fn surface(&mut self, mtl: &Mtl, file: &Path) -> Result<Material> {
        let illum = mtl.illum.unwrap_or(2);
        let index = mtl.ni.filter(|ni| *ni != 1.0);
        let clear = mtl.opacity.is_some_and(|d| d < 1.0) && mtl.tf.is_some() && index.is_some();
        if matches!(illum, 4 | 6 | 7 | 9) || clear {
            let transmittance = Color::Constant(mtl.tf.unwrap_or(Rgb::ONE));
            let reflectance = Color::Constant(Rgb::ONE);
            return Ok(Material::Dielectric { eta: index.unwrap_or(INDEX), reflectance, transmittance });
        }
        let (mirror_eta, mirror_k) = (Color::Constant(Rgb::ZERO), Color::Constant(Rgb::ONE));
        let reflectance = Color::Constant(mtl.ks);
        let shiny = mtl.ks.max_element() > 0.0;
        if shiny && matches!(illum, 3 | 5 | 8) {
            return Ok(Material::Conductor { eta: mirror_eta, k: mirror_k, reflectance });
        }
        let diffuse = match &mtl.map_kd {
            Some(map) => Color::Texture(self.texture(map, true, mtl, file)?),
            None => Color::Constant(mtl.kd.unwrap_or(Rgb::splat(0.5))),
        };
        // Walter et al. 2007, "Microfacet Models for Refraction", Sec. 5.2: exponent to Beckmann width.
        let alpha = (2.0 / (mtl.ns + 2.0)).sqrt();
        Ok(if shiny && diffuse == Color::Constant(Rgb::ZERO) {
            let alpha = Scalar::Constant(alpha);
            let roughness = Roughness { distribution: Distribution::Ggx, alpha_u: alpha, alpha_v: alpha };
            Material::RoughConductor { eta: mirror_eta, k: mirror_k, roughness, reflectance }
        } else if shiny && !matches!(illum, 0 | 1) {
            let make = || RoughCoating::new(INDEX, alpha, Distribution::Ggx);
            let coating = self.coatings.entry(alpha.to_bits()).or_insert_with(make).clone();
            Material::RoughPlastic {
                coating: Box::new(coating),
                diffuse,
                specular: reflectance,
                nonlinear: true,
            }
        } else {
            Material::Diffuse { reflectance: diffuse }
        })
    }
}

/// The files that a `mtllib` statement names: one whose name may hold spaces, or several. Each takes as few
/// words as make the name of a file.
fn library_files(names: &str, folder: &Path) -> Vec<PathBuf> {
    let file = |name: &str| folder.join(name.replace('\\', "/"));
    let mut files = Vec::new();
    let mut rest = names;
    while !rest.is_empty() {
        let all = file(rest);
        let ends = rest.match_indices(char::is_whitespace).map(|(end, _)| end);
        let end =
            if all.is_file() { None } else { ends.into_iter().find(|&end| file(&rest[..end]).is_file()) };
        let (name, after) = rest.split_at(end.unwrap_or(rest.len()));
        files.push(file(name));
        rest = after.trim_start();
    }
    files
}

/// Adds the materials of a library; the file is kept for messages.
fn parse(text: &[u8], file: &Path, library: &mut HashMap<String, (Mtl, PathBuf)>) -> Result<()> {
    let mut current: Option<String> = None;
    let mut next = 1u32;
    for (line, count) in lines::logical(text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text)) {
        let number = next;
        next = next.saturating_add(count);
        let line = String::from_utf8_lossy(&line);
        let line = line.split('#').next().unwrap_or("").trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        if keyword == "newmtl" {
            library.insert(rest.to_string(), (Mtl { line: number, ..Mtl::default() }, file.into()));
            current = Some(rest.to_string());
            continue;
        }
        let Some((mtl, _)) = current.as_ref().and_then(|name| library.get_mut(name)) else { continue };
        statement(mtl, keyword, rest, file).map_err(|message| Error::Scene {
            file: file.into(),
            line: number,
            message,
        })?;
    }
    Ok(())
}

fn statement(mtl: &mut Mtl, keyword: &str, rest: &str, file: &Path) -> Result<(), String> {
    let number = |text: &str| {
        text.parse::<f32>().ok().filter(|v| v.is_finite()).ok_or_else(|| format!("'{text}' is not a number"))
    };
    let first = || number(rest.split_whitespace().next().unwrap_or(""));
    let in_range = |value: f32, low: f32, high: f32| {
        if (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err(format!("{keyword} {value} is out of range"))
        }
    };
    let color = |highest: f32| -> Result<Rgb, String> {
        let values = rest.split_whitespace().map(number).collect::<Result<Vec<_>, _>>();
        let rgb = match values.map_err(|e| format!("{keyword}: {e}; only RGB colours are supported"))?[..] {
            [r, g, b] => Rgb::new(r, g, b),
            [v] => Rgb::splat(v),
            _ => return Err(format!("{keyword} needs one or three numbers")),
        };
        in_range(rgb.min_element(), 0.0, highest)?;
        in_range(rgb.max_element(), 0.0, highest)?;
        Ok(rgb)
    };
    match keyword {
        "Kd" => mtl.kd = Some(color(1.0)?),
        "Ks" => mtl.ks = color(1.0)?,
        "Ke" => mtl.ke = color(f32::MAX)?,
        "Tf" => mtl.tf = Some(color(1.0)?),
        "Ns" => mtl.ns = in_range(first()?, 0.0, f32::MAX)?,
        "Ni" => mtl.ni = Some(in_range(first()?, 0.001, 10.0)?),
        // `d -halo 0.5` depends on the view in ways of its own: only the number counts.
        "d" => mtl.opacity = Some(in_range(number(rest.split_whitespace().last().unwrap_or(""))?, 0.0, 1.0)?),
        "Tr" => mtl.opacity = Some(1.0 - in_range(first()?, 0.0, 1.0)?),
        "illum" => mtl.illum = Some(in_range(first()?, 0.0, 10.0)? as i32),
        "map_Kd" => mtl.map_kd = map(rest, file),
        "map_Ke" => mtl.map_ke = map(rest, file),
        "map_d" => mtl.map_d = map(rest, file),
        _ => {}
    }
    Ok(())
}

/// The file of a `map_…` statement, after its options.
fn map(text: &str, file: &Path) -> Option<PathBuf> {
    let mut words = text.split_whitespace().peekable();
    while words.peek().is_some_and(|w| w.starts_with('-')) {
        let least_most = match words.next() {
            Some("-o" | "-s" | "-t") => (1, 3),
            Some("-mm") => (2, 2),
            _ => (1, 1),
        };
        for i in 0..least_most.1 {
            let is_number = words.peek().is_some_and(|w| w.parse::<f32>().is_ok());
            if i >= least_most.0 && !is_number {
                break;
            }
            words.next();
        }
    }
    // Names may hold spaces.
    let start = words.peek().map(|w| w.as_ptr() as usize - text.as_ptr() as usize)?;
    let name = text.get(start..)?.replace('\\', "/");
    Some(file.parent().unwrap_or(Path::new("")).join(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn scene(obj: &str, mtl: &str) -> Result<SceneDescription> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        fs::write(&path, format!("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{obj}")).unwrap();
        fs::write(folder.path().join("a.mtl"), mtl).unwrap();
        load(&path, None)
    }

    #[test]
    fn materials_are_told_apart() {
        let names = ["light", "mirror", "glass", "clear", "metal", "glossy", "matt", "holes"];
        let obj: String = names.iter().map(|n| format!("usemtl {n}\nf 1 2 3\n")).collect();
        let mtl = "newmtl light\nKe 5 4 3\nnewmtl mirror\nillum 3\nKs .9 .9 .9\nnewmtl glass\nillum 7\nNi 1.33\n\
                   newmtl clear\nd .1\nNi 1.5\nTf 1 .5 1\nnewmtl metal\nKd 0 0 0\nKs 1 1 0\nNs 98\n\
                   newmtl glossy\nKd 1 0 0\nKs .5 .5 .5\nNs 10\nnewmtl matt\nKd .1 .2 .3\nKs 1 1 1\nillum 1\n\
                   newmtl holes\nTr .25\n";
        let scene = scene(&obj, mtl).unwrap();
        assert!(
            matches!(scene.lights[..], [Light::Area { shape: 0, radiance: Color::Constant(c) }] if c.x == 5.0)
        );
        let inner = |i: usize| match &scene.materials[scene.shape_material[i] as usize] {
            Material::TwoSided { front, back: None } => &**front,
            other => other,
        };
        assert!(matches!(inner(1), Material::Conductor { .. }));
        assert!(matches!(inner(2), Material::Dielectric { eta, .. } if *eta == 1.33));
        assert!(matches!(inner(3), Material::Dielectric { eta, .. } if *eta == 1.5));
        assert!(matches!(inner(4), Material::RoughConductor { .. }));
        assert!(matches!(inner(5), Material::RoughPlastic { .. }));
        assert!(matches!(inner(6), Material::Diffuse { .. }));
        assert!(matches!(inner(7), Material::Mask { opacity: Scalar::Constant(d), .. } if *d == 0.75));
        assert!(scene.warnings.is_empty());
    }

    #[test]
    fn a_dark_scene_gets_a_sky_and_a_view() {
        let scene = scene("f 1 2 3\n", "").unwrap();
        assert!(matches!(scene.lights[..], [Light::Constant { .. }]));
        assert_eq!(scene.warnings.len(), 1);
        // All of it lies in the cone of view.
        let to_camera = scene.camera.to_world.inverse();
        for p in [Vec2::ZERO, Vec2::X, Vec2::Y] {
            let p = to_camera.transform_point3(p.extend(0.0));
            assert!(p.z > 0.0 && (p.x / p.z).abs() < scene.camera.half_width);
            assert!((p.y / p.z).abs() < scene.camera.half_width / scene.camera.aspect);
        }
    }

    #[test]
    fn mistakes_name_file_and_line() {
        for (obj, mtl, line) in [
            ("usemtl a\nf 1 2 3\n", "newmtl a\nKd x 0 0\n", 2),
            ("usemtl a\nf 1 2 3\n", "newmtl a\nKd 2 0 0\n", 2),
            ("usemtl a\nf 1 2 3\n", "newmtl a\nKd spectral f.rfl\n", 2),
            ("usemtl a\nf 1 2 3\n", "\nnewmtl a\nmap_Kd missing.png\n", 2),
            ("usemtl b\nf 1 2 3\n", "newmtl a\n", 5),
        ] {
            match scene(obj, mtl) {
                Err(Error::Scene { line: found, .. }) => assert_eq!(found, line, "{mtl}"),
                other => panic!("{mtl}: {other:?}"),
            }
        }
    }

    #[test]
    fn texels_are_checked() {
        use image_io::{Channels, Image, Layer, Metadata, SampleType};
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(name);
        let load = |value: f32, map: &str| {
            let image = Image { width: 2, height: 1, pixels: vec![Rgb::ONE, Rgb::splat(value)] };
            let layer = Layer { name: String::new(), image, channels: Channels::Rgb };
            image_io::write_exr(&file("t.exr"), &[layer], &Metadata::default(), SampleType::Float).unwrap();
            fs::write(file("a.mtl"), format!("\nnewmtl a\n{map} t.exr\n")).unwrap();
            fs::write(file("a.obj"), "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n").unwrap();
            super::load(&file("a.obj"), None)
        };
        for (map, value, is_allowed) in [
            ("map_Kd", 0.5, true),
            ("map_Kd", -0.5, false),
            ("map_Kd", f32::NAN, false),
            ("map_Ke", 50.0, true),
            ("map_Ke", f32::INFINITY, false),
            ("map_d", -0.5, true),
            ("map_d", f32::NAN, false),
        ] {
            match load(value, map) {
                Ok(_) => assert!(is_allowed, "{map} {value}"),
                Err(Error::Scene { file, line, message }) => {
                    let is_named = message.contains("t.exr: the texel (1, 0)");
                    assert!(!is_allowed && file.ends_with("a.mtl") && line == 2 && is_named, "{message}");
                }
                Err(e) => panic!("{map} {value}: {e}"),
            }
        }
    }

    #[test]
    fn a_scene_needs_faces() {
        for obj in ["", "f 1 2\n"] {
            assert!(scene(obj, "").unwrap_err().to_string().contains("no face"));
        }
        let warnings = scene("f 1 2\nf 1 2 3\n", "newmtl light\nKe 1 1 1\n").unwrap().warnings;
        assert!(warnings[0].contains("1 face has fewer than three corners"), "{warnings:?}");
    }

    #[test]
    fn statements_may_name_several_libraries() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["a.mtl", "b.mtl", "my", "my file.mtl"] {
            fs::write(path(name), format!("\u{feff}newmtl {name}\nKd \\\n1 0 0\n")).unwrap();
        }
        fs::create_dir(path("d")).unwrap();
        fs::write(path("d").join("c.mtl"), "").unwrap();
        for (names, files) in [
            ("a.mtl", vec!["a.mtl"]),
            ("a.mtl  b.mtl\ta.mtl", vec!["a.mtl", "b.mtl", "a.mtl"]),
            ("my file.mtl", vec!["my file.mtl"]),
            ("a.mtl d\\c.mtl", vec!["a.mtl", "d/c.mtl"]),
            ("none.mtl", vec!["none.mtl"]),
            ("b.mtl none.mtl", vec!["b.mtl", "none.mtl"]),
            ("", vec![]),
        ] {
            let files: Vec<_> = files.into_iter().map(path).collect();
            assert_eq!(library_files(names, folder.path()), files, "{names}");
        }
        fs::remove_file(path("my")).unwrap();
        let both = vec![path("a.mtl"), path("my file.mtl"), path("b.mtl")];
        assert_eq!(library_files("a.mtl my file.mtl b.mtl", folder.path()), both);

        let obj = "mtllib a.mtl my file.mtl\nmtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n\
                   usemtl a.mtl\nf 1 2 3\nusemtl b.mtl\nf 1 2 3\nusemtl my file.mtl\nf 1 2 3\n";
        fs::write(path("a.obj"), obj).unwrap();
        assert_eq!(load(&path("a.obj"), None).unwrap().materials.len(), 3);
        fs::write(path("a.obj"), obj.replace("mtllib b.mtl", "mtllib b.mtl c.mtl")).unwrap();
        match load(&path("a.obj"), None) {
            Err(Error::Scene { line: 2, message, .. }) => assert!(message.contains("c.mtl"), "{message}"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn map_options_are_skipped() {
        let file = Path::new("d/a.mtl");
        let name = |text| map(text, file).unwrap();
        assert_eq!(name("-s 1 2 -clamp on my file.png"), Path::new("d/my file.png"));
        assert_eq!(name("-o 0.5 0.5 0 t\\a.png"), Path::new("d/t/a.png"));
        assert_eq!(map("-clamp on", file), None);
    }
}
