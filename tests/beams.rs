//! Light that leaves its lamp in one direction: only photons show it.

mod common;

use caustica::integrator::{Budget, Kind, Options};
use common::{ESTIMATES, assert_mean, backends, mean, params, parse, render_with};
use std::f64::consts::PI;

/// A white floor, seen from above without perspective: `half` to each side.
fn scene(half: f64, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
            <sensor type="orthographic"><transform name="to_world"><scale x="{half}" y="{half}"/>
                <lookat origin="0, 0, 0.9" target="0, 0, 0" up="0, 1, 0"/></transform>
                <film type="hdrfilm"><rfilter type="box"/></film></sensor>
            <shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
            {light}
        </scene>"#
    )
}

const DOWN: &str = r#"<transform name="to_world"><scale value="0.5"/><rotate x="1" angle="180"/>
    <translate z="1"/></transform>"#;

fn check(xml: &str, exact: f64) {
    for backend in backends() {
        let scene = parse(xml, 16, backend);
        let picture = |integrator, settings: &[&str], seed| {
            let few = [settings, &["global_photons=2000", "caustic_photons=4000"]].concat();
            let budget = Budget::Passes(4);
            let options = Options { integrator, params: params(&few), seed, budget, aovs: false };
            mean(&render_with(&scene, &options).image).x as f64
        };
        assert_eq!(picture(Kind::Path, &[], 0), 0.0);
        for settings in [&[][..], &["max_depth=2"], &["direct=map", "final_gather=false"]] {
            let means: Vec<f64> =
                (0..ESTIMATES).map(|seed| picture(Kind::Photonmap, settings, seed)).collect();
            assert_mean(&means, exact, 1e-3, 2e-2, &format!("{settings:?}"));
        }
    }
}

/// A lamp that shines straight down gives its flux per area to what lies below it.
#[test]
fn directional_lamps_show_what_they_light() {
    let lamp = format!(
        r#"<shape type="rectangle">{DOWN}<emitter type="directionalarea"><rgb name="radiance" value="3"/></emitter>
            </shape>"#
    );
    check(&scene(0.2, &lamp), 0.8 * 3.0 / PI);
}

/// All of a beam's power lands in one pixel.
#[test]
fn a_beam_lights_a_point() {
    let beam = r#"<emitter type="collimated"><rgb name="power" value="3"/><transform name="to_world">
        <lookat origin="0.03, 0.02, 0.5" target="0.03, 0.02, 0" up="0, 1, 0"/></transform></emitter>"#;
    check(&scene(0.5, beam), 0.8 * 3.0 / PI);
}
