//! Gather rays that go to where photons came from.

mod common;

use caustica::image_io::Image;
use caustica::integrator::{Budget, Kind, Options};
use caustica::scene::Scene;
use common::{ESTIMATES, assert_mean, backends, mean, mean_and_error, params, parse, render_with};

/// A room in the light of a spot on its ceiling: all of it comes from one patch.
const SPOT: &str = r#"<scene version="3.0.0">
    <sensor type="perspective"><float name="fov" value="70"/>
        <transform name="to_world"><lookat origin="0, 0, 0.95" target="0, -0.1, 0" up="0, 1, 0"/></transform></sensor>
    <shape type="cube"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.6, 0.5"/></bsdf></shape>
    <emitter type="spot"><float name="cutoff_angle" value="8"/><rgb name="intensity" value="10"/>
        <transform name="to_world"><lookat origin="0, 0, 0" target="0.3, 1, -0.2" up="1, 0, 0"/></transform></emitter>
    </scene>"#;

fn pictures(scene: &Scene, setting: &str) -> Vec<Image> {
    let options = |seed| Options {
        integrator: Kind::Photonmap,
        params: params(&["indirect=map", setting, "regression=false", "global_photons=4096"]),
        seed,
        budget: Budget::Passes(64),
        aovs: false,
    };
    (0..ESTIMATES).map(|seed| render_with(scene, &options(seed)).image).collect()
}

fn means(pictures: &[Image]) -> Vec<f64> {
    pictures.iter().map(|picture| f64::from(mean(picture).y)).collect()
}

/// Mean over the pixels of the variance over the pictures, relative to the squared mean.
fn variance(pictures: &[Image]) -> f64 {
    let pixel = |i: usize| {
        let values: Vec<f64> = pictures.iter().map(|picture| f64::from(picture.pixels[i].y)).collect();
        let (mean, error) = mean_and_error(&values);
        (error / mean).powi(2) * values.len() as f64
    };
    (0..pictures[0].pixels.len()).map(pixel).sum::<f64>() / pictures[0].pixels.len() as f64
}

/// With it there is a fraction of the noise, and the mean is the same but for what noise does to the choice between wide and
/// fine, some 0.5 % here; at 1000 passes both have what the path tracer has.
#[test]
fn it_brings_less_noise_and_no_bias() {
    let scene = parse(SPOT, 32, backends().next().unwrap());
    let [on, off] = ["guided_gather=true", "guided_gather=false"].map(|setting| pictures(&scene, setting));
    let (with, without) = (variance(&on), variance(&off));
    println!("variance {with:.2e}, without it {without:.2e}");
    let (exact, error) = mean_and_error(&means(&off));
    assert_mean(&means(&on), exact, 4.0 * error / exact + 0.005, 0.01, "mean");
    assert!(4.0 * error < 0.01 * exact, "{exact} ± {error} is not precise enough");
    assert!(2.0 * with < without);
}
