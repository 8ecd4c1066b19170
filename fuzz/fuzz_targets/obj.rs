//! OBJ meshes as scenes of their own.
#![no_main]

use libfuzzer_sys::fuzz_target;

fn init() {
    caustica_fuzz::init();
    caustica_fuzz::put("a.mtl", b"newmtl a\nKe 1 1 1\nnewmtl b\nillum 7\n");
}

fuzz_target!(init: init(), |data: &[u8]| {
    caustica_fuzz::load(&caustica_fuzz::put("scene.obj", data), None);
});
