//! Stages that a scene does not need are skipped, are reported, and leave no trace in the picture.

mod common;

use caustica::integrator::{Budget, Kind, Options, State};
use common::{backends, load, own_scene, params, parse};
use std::ops::ControlFlow;

const VIEW: &str = r#"<sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 1.2, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
</sensor>"#;

/// The picture's bits, the names of the skipped stages, photons emitted, and rays.
fn render(scene: &caustica::scene::Scene, skip: bool) -> (Vec<[u32; 3]>, Vec<String>, u64, u64) {
    let skip = format!("skip={skip}");
    let options = Options {
        integrator: Kind::Photonmap,
        params: params(&[&skip]),
        seed: 1,
        budget: Budget::Passes(2),
        aovs: false,
    };
    let mut state = State::new(scene, &options, 0).unwrap();
    state.render(scene, &options, &mut |_, _| ControlFlow::Continue(()));
    let bits = state.resolve().image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
    let statistics = state.statistics;
    let stages = statistics.skipped.into_iter().map(|skipped| skipped.stage).collect();
    (bits, stages, statistics.photons.emitted, statistics.rays)
}

/// `photons`: whether any are needed.
#[track_caller]
fn check(mut scene: caustica::scene::Scene, stages: &[&str], photons: bool) {
    let (picture, skipped, emitted, rays) = render(&scene, true);
    assert_eq!(skipped, stages);
    assert_eq!(emitted > 0, photons);
    scene.compute_everything();
    let (all, skipped, all_emitted, all_rays) = render(&scene, false);
    assert!(skipped.is_empty());
    assert!(all_emitted > emitted && all_rays > rays);
    assert!(picture == all, "skipping {stages:?} changed the picture");
}

#[test]
fn without_sharp_surfaces_there_are_no_caustics() {
    for backend in backends() {
        let scene = load(&own_scene("cornell-diffuse.xml"), 32, backend);
        check(scene, &["texture coordinates", "caustic map"], true);
    }
}

#[test]
fn without_broad_surfaces_there_are_no_photons() {
    let xml = format!(
        r#"<scene version="3.0.0">{VIEW}
        <shape type="rectangle"><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
        <shape type="sphere"><float name="radius" value="0.4"/><bsdf type="dielectric"/></shape>
        <shape type="sphere"><point name="center" value="0, 3, 0"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="9"/></emitter></shape>
        <emitter type="constant"/></scene>"#
    );
    for backend in backends() {
        let scene = parse(&xml, 32, backend);
        check(scene, &["texture coordinates", "global map", "caustic map"], false);
    }
}

/// Texture coordinates are there for the one shape of four that needs them, and for a lamp's radiance. (Indirect light
/// is traced.)
#[test]
fn textures_keep_their_coordinates() {
    let checks = r#"<texture type="checkerboard" name="CHECKS"/>"#;
    let xml = format!(
        r#"<scene version="3.0.0">{VIEW}
        <shape type="sphere"><point name="center" value="0, 3, 0"/>
            <emitter type="area">{}</emitter></shape>
        <shape type="disk"><bsdf type="diffuse">{}</bsdf></shape>
        <shape type="cylinder"><bsdf type="diffuse"/></shape>
        <shape type="sphere"><float name="radius" value="0.4"/>
            <bsdf type="roughconductor"><float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.4"/></bsdf>
        </shape></scene>"#,
        checks.replace("CHECKS", "radiance"),
        checks.replace("CHECKS", "reflectance"),
    );
    for backend in backends() {
        let mut scene = parse(&xml, 32, backend);
        assert_eq!(scene.textured_shapes(), 3);
        let (picture, skipped, ..) = render(&scene, true);
        assert_eq!(skipped, ["texture coordinates", "global map"]);
        scene.compute_everything();
        assert!(picture == render(&scene, false).0);
    }
}
