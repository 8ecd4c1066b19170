//! Values computed with Mitsuba 3.9.1 (`scalar_rgb`), whose `wi` is our `wo` and whose importance is our flux.

use super::*;

/// A row: name, then numbers.
fn rows(text: &str) -> impl Iterator<Item = (&str, Vec<f32>)> {
    text.lines().filter(|l| !l.starts_with('#')).map(|line| {
        let mut words = line.split_whitespace();
        (words.next().unwrap(), words.map(|w| w.parse().unwrap()).collect())
    })
}

fn find(bsdfs: &[(&str, Bsdf<'static>)], name: &str) -> Bsdf<'static> {
    bsdfs.iter().find(|b| b.0 == name).map_or(Bsdf::null(), |b| b.1.clone())
}

fn check_eval(text: &str) -> usize {
    let bsdfs = bsdfs();
    let mut checked = 0;
    for (name, v) in rows(text) {
        let bsdf = find(&bsdfs, name);
        let (wo, wi) = (Vec3::from_slice(&v[0..3]), Vec3::from_slice(&v[3..6]));
        for (mode, expected) in [(Mode::Radiance, &v[6..9]), (Mode::Flux, &v[9..12])] {
            let expected = Rgb::from_slice(expected);
            let f = bsdf.eval(wo, wi, mode, Share::All) * bsdf.opacity();
            let tolerance = 1e-3 * expected.max_element() + 1e-5;
            assert!(
                (f - expected).abs().max_element() < tolerance,
                "{name} {wo} {wi}: {f}, Mitsuba {expected}"
            );
        }
        // Mitsuba's pdf of Beckmann facets contains a fit (0.35 %), ours does not.
        let pdf_w = bsdf.pdf_w(wo, wi, Mode::Radiance) * bsdf.opacity();
        assert!(close(pdf_w, v[12], 4e-3), "{name} {wo} {wi}: pdf {pdf_w}, Mitsuba {}", v[12]);
        checked += 1;
    }
    checked
}

fn check_sample(text: &str) -> usize {
    let bsdfs = bsdfs();
    let mut checked = 0;
    for (name, v) in rows(text) {
        let bsdf = find(&bsdfs, name);
        let (wo, u_lobe, u) = (Vec3::from_slice(&v[0..3]), v[3], Vec2::from_slice(&v[4..6]));
        for (mode, weight) in [(Mode::Radiance, &v[9..12]), (Mode::Flux, &v[12..15])] {
            let weight = Rgb::from_slice(weight);
            // Mitsuba's holes are delta lobes, which end the range of `u_lobe`.
            let opacity = bsdf.opacity();
            let sample = match u_lobe < opacity {
                true => bsdf.sample(wo, u_lobe / opacity, u, mode),
                false => Some(BsdfSample::delta(-wo, Rgb::ONE, 1.0)),
            };
            let Some(s) = sample else {
                assert_eq!(weight, Rgb::ZERO, "{name} {wo} {u_lobe}");
                continue;
            };
            assert!((s.weight - weight).abs().max_element() < 1e-4, "{name} {wo} {u_lobe}: {s:?}, {weight}");
            if weight == Rgb::ZERO {
                continue;
            }
            assert_eq!(s.delta, v[16] == 1.0, "{name} {wo} {u_lobe}: {s:?}");
            assert!((s.eta - v[15]).abs() < 1e-5, "{name} {wo} {u_lobe}: {s:?}");
            assert!((s.wi - Vec3::from_slice(&v[6..9])).length() < 1e-4, "{name} {wo} {u_lobe}: {s:?}");
        }
        checked += 1;
    }
    checked
}

#[test]
fn eval_and_pdf_are_those_of_mitsuba() {
    assert!(check_eval(include_str!("mitsuba_eval.txt")) > 70);
}

#[test]
fn old_models_are_those_of_mitsuba_0_6() {
    assert_eq!(check_eval(include_str!("mitsuba_old_eval.txt")), 40);
}

#[test]
fn delta_samples_are_those_of_mitsuba() {
    assert!(check_sample(include_str!("mitsuba_sample.txt")) > 15);
}
