//! What the fuzz targets share: limits, a folder with files to refer to, and what is expected of every input.

use cap::Cap;
use caustica::accel::Backend;
use caustica::image_io::{self, Channels, Image, Layer, Metadata, SampleType};
use caustica::math::Rgb;
use caustica::scene::{self, Scene};
use caustica::{Error, Result};
use flate2::{Compression, write::ZlibEncoder};
use std::alloc::System;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Asking for more is a crash. libFuzzer's own limit is looked at once a second, and sees no memory that was not touched.
#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, 1 << 30);

/// A mesh that is fine, for scenes to refer to.
pub const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 .5\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/2 4/2\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                   property list uchar int vertex_indices\nproperty float a_x\nend_header\n\
                   0 0 1 255 0 9\n1 0 1 0 255 9\n0 1 1 9 9 9\n3 0 1 2 0.5\n";

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("caustica-fuzz-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
});

/// A file in a folder of this process' own.
pub fn path(name: &str) -> PathBuf {
    FOLDER.join(name)
}

/// Puts a file there.
pub fn put(name: &str, content: &[u8]) -> PathBuf {
    let path = path(name);
    fs::write(&path, content).expect("room for temporary files");
    path
}

/// To be called first: keeps all work on this thread, and makes files that scenes may refer to.
pub fn init() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().expect("no thread pool so far");
    put("a.obj", OBJ.as_bytes());
    put("a.ply", PLY.as_bytes());
    put("a.serialized", &serialized(4, &serialized_body()));
    put("a.spd", b"400 0.5\n700 1\n");
    put("a.xml", br#"<scene version="3.0.0"><shape type="sphere"/></scene>"#);
    let pixels = (0..8).map(|i| Rgb::new(0.1 * i as f32, 0.5, 1.0)).collect();
    let image = Image { width: 4, height: 2, pixels };
    image_io::write_png(&path("a.png"), &image, 0.0).expect("room for temporary files");
    let layer = Layer { name: String::new(), image, channels: Channels::Rgb };
    image_io::write_exr(&path("a.exr"), &[layer], &Metadata::default(), SampleType::Half)
        .expect("room for temporary files");
}

fn serialized_body() -> Vec<u8> {
    let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut body = vec![0, 0x10, 0, 0, b'a', 0];
    body.extend([3u64, 1].map(u64::to_le_bytes).concat());
    body.extend(positions.map(f32::to_le_bytes).concat());
    body.extend([0u32, 1, 2].map(u32::to_le_bytes).concat());
    body
}

/// A `.serialized` file of one mesh.
pub fn serialized(version: u16, body: &[u8]) -> Vec<u8> {
    let mut file = vec![0x1C, 0x04];
    file.extend(version.to_le_bytes());
    let mut zlib = ZlibEncoder::new(file, Compression::none());
    zlib.write_all(body).and_then(|()| zlib.finish()).expect("memory never fails")
}

/// What is written about a file must name it, and the line if it is of a line.
pub fn check<T>(result: Result<T>) -> Option<T> {
    match result {
        Ok(value) => return Some(value),
        Err(Error::Scene { file, line, message }) => {
            assert!(file.starts_with(&*FOLDER) && line > 0 && !message.is_empty());
        }
        Err(Error::File { file, message }) => assert!(file.starts_with(&*FOLDER) && !message.is_empty()),
        Err(other) => panic!("no file is named: {other}"),
    }
    None
}

/// Reads a scene, and makes it ready to be rendered.
pub fn load(path: &Path, size: Option<(u32, u32)>) -> Option<Scene> {
    let description = check(scene::load(path, &[], size))?;
    let scene = Scene::new(description, Backend::Bvh).expect("what was read can be built");
    scene.fingerprint();
    Some(scene)
}
