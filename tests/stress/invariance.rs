//! Pictures that must not change: with the scene's scale and place, and but for a factor with the radiance.

use crate::common::{assert_mean, backends, mean, parse};
use crate::{View, WAYS, for_all, still_life, watched};

/// The picture's mean over that of the scene as it stands, with the same random numbers: for each seed.
fn against_plain(body: String) -> impl Fn(&View) -> Vec<f64> + Send + Sync + Clone + 'static {
    move |view: &View| {
        let body = &body;
        let xml = format!(r#"<scene version="3.0.0">{body}</scene>"#);
        let backend = backends().find(|b| view.what.contains(b.name())).unwrap();
        let plain = View {
            scene: parse(&xml, 12, backend),
            kind: view.kind,
            settings: view.settings.clone(),
            what: "as it stands".into(),
        };
        view.means(4).iter().zip(plain.means(4)).map(|(a, b)| a / b).collect()
    }
}

fn check(scale: f64, offset: f64, bias: f64) {
    let ratios = against_plain(still_life(1.0, 0.0, 1.0));
    let (name, body) = (format!("scale {scale}, offset {offset}"), still_life(scale, offset * scale, 1.0));
    for_all(&name, &body, (12, 12), move |view| assert_mean(&ratios(view), 1.0, bias, 0.05, &view.what));
}

#[test]
fn the_scale_does_not_show() {
    for scale in [1e-6, 1e-3, 1e3, 1e6] {
        check(scale, 0.0, 1e-3);
    }
}

/// At 10⁴ times the scene's size from the origin, coordinates are good to a thousandth of it.
#[test]
fn the_place_hardly_shows() {
    check(1.0, 100.0, 2e-3);
    check(1.0, 1e4, 0.01);
    check(1e-6, 1e4, 0.01);
}

#[test]
#[ignore = "two minutes; CAUSTICA_STRESS=1 .ci/run runs it"]
fn no_scale_and_place_shows() {
    for exponent in -6..=6 {
        for (offset, bias) in [(0.0, 1e-3), (100.0, 2e-3), (-1e3, 5e-3), (1e4, 0.01), (-1e4, 0.01)] {
            check(10f64.powi(exponent), offset, bias);
        }
    }
}

/// Powers of two scale every number exactly.
#[test]
fn radiance_is_a_factor() {
    for backend in backends() {
        for (kind, settings) in WAYS {
            let image = move |exponent: i32| {
                let body = still_life(1.0, 0.0, 2f64.powi(exponent));
                let view = View {
                    scene: parse(&format!(r#"<scene version="3.0.0">{body}</scene>"#), 12, backend),
                    kind,
                    settings: settings.iter().map(|s| s.to_string()).collect(),
                    what: format!("radiance 2^{exponent}, {}, {kind:?}", backend.name()),
                };
                watched(&view.what.clone(), move || view.render(1, 3).image)
            };
            let plain = image(0);
            assert!(mean(&plain).min_element() > 0.01);
            for exponent in [1, -100, 100] {
                let scaled = image(exponent);
                for (i, (a, b)) in plain.pixels.iter().zip(&scaled.pixels).enumerate() {
                    assert_eq!(*a, *b * 2f32.powi(-exponent), "pixel {i} at 2^{exponent}, {kind:?}");
                }
            }
        }
    }
}

/// Both integrators see the same light in the mean, within what is left of density estimation's bias.
fn agree(passes: [u32; 2], bias: f64, precision: f64) {
    for backend in backends() {
        let [path, photons] = [0, 1].map(|way| {
            let (kind, _) = WAYS[way];
            // No path tracer finds what the glass makes of parallel light.
            let body = still_life(1.0, 0.0, 1.0);
            let (body, _sun) = body.split_once(r#"<emitter type="directional">"#).unwrap();
            let view = View {
                scene: parse(&format!(r#"<scene version="3.0.0">{body}</scene>"#), 12, backend),
                kind,
                settings: Vec::new(),
                what: format!("{kind:?}"),
            };
            watched("both integrators", move || view.means(passes[way]))
        });
        // Both are noisy.
        let exact = path.iter().sum::<f64>() / path.len() as f64;
        let ratios: Vec<f64> = photons.iter().zip(&path).map(|(a, b)| 1.0 + (a - b) / exact).collect();
        assert_mean(&ratios, 1.0, bias, precision, backend.name());
    }
}

#[test]
fn photons_agree_with_paths() {
    agree([256, 16], 3e-3, 0.025);
}

#[test]
#[ignore = "two minutes; CAUSTICA_STRESS=1 .ci/run runs it"]
fn photons_agree_closely_with_paths() {
    agree([4096, 160], 1e-3, 0.006);
}
