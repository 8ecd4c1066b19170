//! Scene files by their extension.

use super::{SceneDescription, mitsuba, mtl};
use crate::{Error, Result};
use std::path::Path;

/// Reads a scene: `.xml` is Mitsuba's format, `.obj` a bare mesh with its materials. `defines` are
/// (name, value) of `$name` parameters; `size` replaces the film's size (and drops its crop).
///
/// # Errors
/// [`Error::Scene`] with file and line where the scene asks for something wrong or unsupported, [`Error::File`] if a
/// file cannot be used at all.
pub fn load(path: &Path, defines: &[(String, String)], size: Option<(u32, u32)>) -> Result<SceneDescription> {
    if let Some((width, height)) = size {
        if width == 0 || height == 0 || width.max(height) > mitsuba::MAX_SIDE {
            return Err(Error::Usage(format!("an image of {width}x{height} pixels cannot be rendered")));
        }
    }
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let scene = match extension.as_str() {
        "xml" => mitsuba::load(path, defines, size),
        "obj" => mtl::load(path, size).map(|mut scene| {
            let unused =
                defines.iter().map(|(name, value)| format!("-D {name}={value}: an OBJ has no parameters"));
            scene.warnings.extend(unused);
            scene
        }),
        _ => {
            let message = "scenes are Mitsuba files (.xml) or meshes with materials (.obj)".into();
            return Err(Error::File { file: path.into(), message });
        }
    }?;
    if scene.geometry.shapes.is_empty() && scene.lights.is_empty() {
        return Err(Error::File {
            file: path.into(),
            message: "the scene holds no shapes and no emitters".into(),
        });
    }
    Ok(scene)
}
