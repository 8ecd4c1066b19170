//! Rooms that the sky lights through a window: directions beside the light sample find it.

mod common;

use caustica::integrator::{Budget, Kind, Options};
use common::{ESTIMATES, assert_mean, backends, layer, mean, mean_and_error, params, parse, render_with};

/// A floor, matt with a coat, under a lid with a hole to the sky.
fn scene(bsdf: &str) -> String {
    let lid =
        [(15.2, 0.0, 14.8, 30.0), (-15.2, 0.0, 14.8, 30.0), (0.0, 15.2, 0.4, 14.8), (0.0, -15.2, 0.4, 14.8)];
    let lid = lid.map(|(x, y, a, b)| {
        format!(
            "<shape type='rectangle'><transform name='to_world'><scale x='{a}' y='{b}'/>\
             <translate x='{x}' y='{y}' z='1'/></transform><bsdf type='twosided'><bsdf type='diffuse'/></bsdf></shape>"
        )
    });
    format!(
        "<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='60'/><transform name='to_world'>\
         <lookat origin='0, -0.5, 0.9' target='0, 0, 0' up='0, 1, 0'/></transform></sensor><emitter type='constant'/>\
         <shape type='rectangle'><transform name='to_world'><scale value='30'/></transform>{bsdf}</shape>{}</scene>",
        lid.concat()
    )
}

/// The mean of direct light is that of the path tracer, whose paths find lights by one direction and one
/// light sample.
#[test]
fn more_directions_change_no_mean() {
    for bsdf in [
        "<bsdf type='diffuse'/>",
        "<bsdf type='roughplastic'><float name='alpha' value='0.2'/></bsdf>",
        "<bsdf type='plastic'/>",
        "<bsdf type='mask'><float name='opacity' value='0.6'/><bsdf type='diffuse'/></bsdf>",
    ] {
        let backend = backends().next().unwrap();
        let scene = parse(&scene(bsdf), 12, backend);
        let means = |integrator, passes| -> Vec<f64> {
            let options = |seed| Options {
                integrator,
                params: params(&["regression=false", "max_depth=2"]),
                seed,
                budget: Budget::Passes(passes),
                aovs: true,
            };
            let direct = |seed| {
                let rendering = render_with(&scene, &options(seed));
                f64::from(mean(layer(&rendering, "direct")).y)
            };
            (0..ESTIMATES).map(direct).collect()
        };
        let (exact, error) = mean_and_error(&means(Kind::Path, 1024));
        let bias = 4.0 * error / exact;
        assert!(bias < 0.01, "{exact} ± {error} is not precise enough");
        let what = format!("{} {bsdf}", backend.name());
        assert_mean(&means(Kind::Photonmap, 512), exact, bias, 0.01, &what);
    }
}
