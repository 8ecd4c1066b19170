//! Caustics that the camera sees directly are splatted onto the film, through any lens, filter and crop window.

mod common;

use caustica::integrator::Kind;
use common::{assert_close, backends, layer, mean, render};

/// A floor, lit by a lamp by way of a mirror behind it. The lamp is large: path tracing finds this caustic, too. With
/// `above`, it hangs between camera and floor.
fn scene(sensor: &str, size: &str, filter: &str, above: bool) -> String {
    let (x, y) = if above { (0.9, 1.5) } else { (0.0, 3.0) };
    let lens = match sensor {
        "thinlens" => {
            r#"<float name="aperture_radius" value="0.15"/><float name="focus_distance" value="2"/>"#
        }
        _ => "",
    };
    format!(
        r#"<scene version="3.0.0">
            <sensor type="{sensor}">
                <float name="fov" value="50"/>
                {lens}
                <transform name="to_world"><lookat origin="0, 2.2, 1.5" target="0, 0, 0" up="0, 1, 0"/></transform>
                <film type="hdrfilm">{size}<rfilter type="{filter}"/></film>
            </sensor>
            <shape type="rectangle">
                <transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/></transform>
                <bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf>
            </shape>
            <shape type="rectangle">
                <transform name="to_world"><translate z="-1.5"/></transform>
                <bsdf type="conductor"><string name="material" value="none"/></bsdf>
            </shape>
            <shape type="rectangle">
                <transform name="to_world">
                    <scale value="1"/><rotate x="1" angle="140"/><translate x="{x}" y="{y}" z="0.4"/>
                </transform>
                <emitter type="area"><rgb name="radiance" value="3, 4, 5"/></emitter>
            </shape>
        </scene>"#
    )
}

/// Means within 2 %: five standard errors of the path tracer's.
#[test]
fn they_agree_with_the_path_tracer() {
    let plain = r#"<integer name="width" value="24"/><integer name="height" value="16"/>"#;
    let crop = r#"<integer name="width" value="40"/><integer name="height" value="30"/>
        <integer name="crop_offset_x" value="9"/><integer name="crop_offset_y" value="4"/>
        <integer name="crop_width" value="20"/><integer name="crop_height" value="15"/>"#;
    let cases = [
        ("perspective", plain, "box", false, "hide_emitters=false"),
        ("thinlens", plain, "gaussian", false, "hide_emitters=false"),
        ("perspective", crop, "tent", false, "hide_emitters=false"),
        ("perspective", plain, "box", true, "hide_emitters=false"),
        ("thinlens", crop, "gaussian", true, "hide_emitters=true"),
    ];
    let backend = backends().next().unwrap();
    for case @ (sensor, size, filter, above, hide) in cases {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("scene.xml");
        std::fs::write(&file, scene(sensor, size, filter, above)).unwrap();
        let description = caustica::scene::load(&file, &[], None).unwrap();
        let scene = caustica::scene::Scene::new(description, backend).unwrap();
        let path = render(&scene, Kind::Path, &[hide, "max_depth=4"], 2048);
        let photons = render(&scene, Kind::Photonmap, &[hide, "max_depth=4"], 64);
        let what = format!("{}, {case:?}", backend.name());
        let means = [&path, &photons].map(|rendering| mean(layer(rendering, "caustic")));
        assert!(means[0].min_element() > 0.002, "{what}: there is a caustic, {}", means[0]);
        println!("{what}: {} and {}", means[0], means[1]);
        assert_close(means[1], means[0], 0.02, &what);
    }
}
