//! What tests share.
#![allow(dead_code, unreachable_pub)] // each test binary uses a part

pub(crate) mod program;

use caustica::accel::{self, Backend};
use caustica::image_io::Image;
use caustica::integrator::{Budget, Kind, Options, Params, Rendering, State};
use caustica::math::Rgb;
use caustica::photon::{Emission, Guide, Importance, Learnt, Store, Uses};
use caustica::scene::{self, Scene};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// A scene of this project.
pub(crate) fn own_scene(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}

/// A file beside the project's folder; `None`, with a message, where it is absent.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(path);
    if file.exists() {
        return Some(file);
    }
    println!("skipped: ../shared/{path} is not there");
    None
}

/// The scene in `file`, rendered at `size` by `backend`.
pub(crate) fn load(file: &Path, size: u32, backend: Backend) -> Scene {
    let description = scene::load(file, &[], Some((size, size))).unwrap();
    Scene::new(description, backend).unwrap()
}

/// The scene in the text `xml`.
pub(crate) fn parse(xml: &str, size: u32, backend: Backend) -> Scene {
    parse_sized(xml, (size, size), backend)
}

/// The same with a film that is no square.
pub(crate) fn parse_sized(xml: &str, size: (u32, u32), backend: Backend) -> Scene {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("scene.xml");
    std::fs::write(&file, xml).unwrap();
    Scene::new(scene::load(&file, &[], Some(size)).unwrap(), backend).unwrap()
}

/// Parameters from `NAME=VALUE`.
pub(crate) fn params(settings: &[&str]) -> Params {
    let mut params = Params::default();
    for setting in settings {
        let (name, value) = setting.split_once('=').unwrap();
        params.set(name, value).unwrap();
    }
    params
}

/// Renders `passes` passes with seed 1.
pub(crate) fn render(scene: &Scene, integrator: Kind, settings: &[&str], passes: u32) -> Rendering {
    let options =
        Options { integrator, params: params(settings), seed: 1, budget: Budget::Passes(passes), aovs: true };
    render_with(scene, &options)
}

/// Renders as the options say.
pub(crate) fn render_with(scene: &Scene, options: &Options) -> Rendering {
    let mut state = State::new(scene, options, 0).unwrap();
    state.render(scene, options, &mut |_, _| ControlFlow::Continue(()));
    state.resolve()
}

/// Mean of each channel.
pub(crate) fn mean(image: &Image) -> Rgb {
    let sum: glam::DVec3 = image.pixels.iter().map(|p| p.as_dvec3()).sum();
    (sum / image.pixels.len() as f64).as_vec3()
}

/// Mean and standard error of the mean.
pub(crate) fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (square / (n - 1.0) / n).sqrt())
}

/// Number of independent estimates that [`assert_mean`] wants at least, and Student's t that the mean of so many exceeds
/// once in 1000 times, on either side.
pub(crate) const ESTIMATES: u64 = 16;
const T: f64 = 4.073;

/// Asserts that the mean of independent estimates is `exact`: within their 99.9 % confidence interval, widened by the
/// relative `bias`, and that the interval is narrower than the relative `precision`, lest the test pass for want of
/// knowledge.
#[track_caller]
pub(crate) fn assert_mean(estimates: &[f64], exact: f64, bias: f64, precision: f64, what: &str) {
    assert!(estimates.len() as u64 >= ESTIMATES);
    let (mean, error) = mean_and_error(estimates);
    let (off, width) = (mean / exact - 1.0, T * error / exact.abs());
    let told = format!("{what}: {mean:.6e}, not {exact:.6e}: {:.3} % ± {:.3} %", 100.0 * off, 100.0 * width);
    println!("{told}");
    assert!(off.abs() <= width + bias, "{told}");
    assert!(width <= precision, "{told} is not precise enough");
}

/// A part or auxiliary layer.
pub(crate) fn layer<'a>(rendering: &'a Rendering, name: &str) -> &'a Image {
    &rendering.layers.iter().find(|layer| layer.name == name).unwrap().image
}

/// Every backend of this build.
pub(crate) fn backends() -> impl Iterator<Item = Backend> {
    accel::available().iter().copied()
}

/// Asserts that all channels agree within the relative tolerance.
#[track_caller]
pub(crate) fn assert_close(a: Rgb, b: Rgb, relative: f32, what: &str) {
    let error = ((a - b) / b.max(Rgb::splat(1e-6))).abs().max_element();
    assert!(error < relative, "{what}: {a} and {b} differ by {:.2} %", 100.0 * error);
}

/// What photons sent ahead learn for passes of `photons` into the map of `store`, where gather rays look for them.
pub(crate) fn learn(scene: &Scene, store: Store, photons: u64, max_depth: u32) -> Option<Guide> {
    let mut importance = Importance::new(scene, Uses { direct: false, gathers: true });
    Learnt::new(scene, &mut importance, &Emission::new(store, photons, max_depth)).guide
}
