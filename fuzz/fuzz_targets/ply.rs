//! PLY meshes, in a scene.
#![no_main]

use libfuzzer_sys::fuzz_target;

fn init() {
    caustica_fuzz::init();
    let scene = br#"<scene version="3.0.0">
        <sensor type="perspective"/>
        <shape type="ply"><string name="filename" value="scene.ply"/><emitter type="area"/></shape>
    </scene>"#;
    caustica_fuzz::put("scene.xml", scene);
}

fuzz_target!(init: init(), |data: &[u8]| {
    caustica_fuzz::put("scene.ply", data);
    caustica_fuzz::load(&caustica_fuzz::path("scene.xml"), None);
});
