//! The partition of light transport: photon mapping and the path tracer, which shares none of its estimators, find
//! the same light in each of the four parts.

mod common;

use caustica::integrator::Kind;
use common::{assert_close, backends, layer, load, mean, own_scene, parse, render};

const PARTS: [&str; 4] = ["direct", "specular", "caustic", "indirect"];

#[test]
fn parts_add_up_to_the_picture() {
    let backend = backends().next().unwrap();
    for kind in [Kind::Path, Kind::Photonmap] {
        let scene = load(&own_scene("glossy-caustic.xml"), 16, backend);
        let rendering = render(&scene, kind, &[], 4);
        for (i, pixel) in rendering.image.pixels.iter().enumerate() {
            let sum: glam::Vec3 = PARTS.iter().map(|part| layer(&rendering, part).pixels[i]).sum();
            assert!((sum - *pixel).abs().max_element() <= 1e-5 * pixel.max_element(), "{sum} {pixel}");
        }
    }
}

/// Light that the sharp share of rough glass has passed twice is specular, not direct.
#[test]
fn rough_glass_is_sorted_alike() {
    let xml = r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="20"/>
            <transform name="to_world"><lookat origin="5, 0.1, 0.2" target="0, 0, 0" up="0, 0, 1"/></transform>
            <film type="hdrfilm"><rfilter type="box"/></film></sensor>
        <emitter type="constant"/>
        <shape type="sphere"><bsdf type="roughdielectric"><float name="alpha" value="0.1"/></bsdf></shape></scene>"#;
    let scene = parse(xml, 8, backends().next().unwrap());
    let path = render(&scene, Kind::Path, &[], 512);
    let photons = render(&scene, Kind::Photonmap, &["caustic_photons=2000", "global_photons=2000"], 128);
    for part in ["direct", "specular"] {
        assert_close(mean(layer(&photons, part)), mean(layer(&path, part)), 0.04, part);
    }
}

/// Each part's mean within 1 %: path tracing needs this many samples for the caustic.
#[test]
#[ignore = "two minutes; CI runs it nightly"]
fn each_part_agrees_with_the_path_tracer() {
    let backend = backends().next().unwrap();
    let scene = load(&own_scene("cornell-spheres.xml"), 64, backend);
    let path = render(&scene, Kind::Path, &[], 8192);
    let photons = render(&scene, Kind::Photonmap, &[], 256);
    for part in PARTS {
        assert_close(mean(layer(&photons, part)), mean(layer(&path, part)), 0.01, part);
    }
}
