//! PLY meshes, in a scene that looks at their shape alone, and in one that looks at their colours too.
#![no_main]

use libfuzzer_sys::fuzz_target;

fn init() {
    caustica_fuzz::init();
    let attribute = |parameter: &str, name: &str| {
        format!(
            r#"<texture type="mesh_attribute" name="{parameter}"><string name="name" value="{name}"/></texture>"#
        )
    };
    let (reflectance, opacity) = (attribute("reflectance", "vertex_a"), attribute("opacity", "face_color"));
    let light = r#"<emitter type="area"/>"#.to_string();
    let colors = format!(r#"<bsdf type="mask">{opacity}<bsdf type="diffuse">{reflectance}</bsdf></bsdf>"#);
    for (name, inside) in [("shape.xml", light), ("colors.xml", colors)] {
        let scene = format!(
            r#"<scene version="3.0.0">
                <sensor type="perspective"/>
                <shape type="ply"><string name="filename" value="scene.ply"/>{inside}</shape>
            </scene>"#
        );
        caustica_fuzz::put(name, scene.as_bytes());
    }
}

fuzz_target!(init: init(), |data: &[u8]| {
    caustica_fuzz::put("scene.ply", data);
    for scene in ["shape.xml", "colors.xml"] {
        caustica_fuzz::load(&caustica_fuzz::path(scene), None);
    }
});
