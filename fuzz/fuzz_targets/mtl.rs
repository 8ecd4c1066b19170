//! The materials of an OBJ mesh.
#![no_main]

use libfuzzer_sys::fuzz_target;

fn init() {
    caustica_fuzz::init();
    let faces = "mtllib scene.mtl\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n";
    caustica_fuzz::put("scene.obj", [caustica_fuzz::OBJ, faces].concat().as_bytes());
}

fuzz_target!(init: init(), |data: &[u8]| {
    caustica_fuzz::put("scene.mtl", data);
    caustica_fuzz::load(&caustica_fuzz::path("scene.obj"), None);
});
