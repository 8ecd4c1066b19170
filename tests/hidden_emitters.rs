//! `hide_emitters`: lamps are not there for the camera, and distant lights not before something bends its ray. Mitsuba
//! 3.9.1 renders these scenes alike.

mod common;

use caustica::integrator::Kind;
use common::{backends, mean, parse, render};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

const VIEW: &str = r#"<sensor type="perspective">
    <float name="fov" value="10"/>
    <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><rfilter type="box"/></film>
</sensor>"#;

const SQUARE: &str = r#"<shape type="rectangle"><transform name="to_world"><translate z="2"/></transform>"#;

#[track_caller]
fn expect(body: &str, expected: Vec3) {
    for backend in backends() {
        let scene = parse(&format!(r#"<scene version="3.0.0">{VIEW}{body}</scene>"#), 8, backend);
        for kind in [Kind::Path, Kind::Photonmap] {
            let image = render(&scene, kind, &["hide_emitters=true"], 4).image;
            assert!((mean(&image) - expected).abs().max_element() < 1e-5, "{kind:?}: {}", mean(&image));
        }
    }
}

#[test]
fn what_is_behind_a_lamp_shows() {
    // Lit from beside the lamp, which faces the camera.
    let wall = r#"<shape type="rectangle"/><emitter type="directional"><vector name="direction" value="1, 0, -1"/>
        <rgb name="irradiance" value="1, 2, 3"/></emitter>"#;
    // A lamp that is switched off leaves nothing to chance: the other light is always the one that is sampled.
    let lamp = format!(r#"{SQUARE}<emitter type="area"><rgb name="radiance" value="0"/></emitter></shape>"#);
    let light = Vec3::new(1.0, 2.0, 3.0) * (0.5f32.sqrt() * 0.5 * FRAC_1_PI);
    expect(&format!("{wall}{lamp}"), light);
}

#[test]
fn sky_shows_in_mirrors_only() {
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="1, 2, 3"/></emitter>"#;
    let square = |bsdf| format!(r#"{sky}{SQUARE}<bsdf type="{bsdf}"/></shape>"#);
    expect(sky, Vec3::ZERO);
    expect(&square("null"), Vec3::ZERO);
    expect(&square("conductor"), Vec3::new(1.0, 2.0, 3.0));
}
