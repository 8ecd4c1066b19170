//! Serialized meshes, in a scene: as files, or compressed here, as the fuzzer cannot.
#![no_main]

use libfuzzer_sys::fuzz_target;

fn init() {
    caustica_fuzz::init();
    for index in 0..2 {
        let scene = format!(
            r#"<scene version="3.0.0">
                <sensor type="perspective"/>
                <shape type="serialized">
                    <string name="filename" value="scene.serialized"/>
                    <integer name="shape_index" value="{index}"/>
                </shape>
            </scene>"#
        );
        caustica_fuzz::put(&format!("{index}.xml"), scene.as_bytes());
    }
}

fuzz_target!(init: init(), |data: &[u8]| {
    let file = match data {
        [0x1C, ..] => data,
        [version, body @ ..] => &caustica_fuzz::serialized((*version).into(), body),
        [] => return,
    };
    caustica_fuzz::put("scene.serialized", file);
    for scene in ["0.xml", "1.xml"] {
        caustica_fuzz::load(&caustica_fuzz::path(scene), None);
    }
});
