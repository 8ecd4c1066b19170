//! Mitsuba 3's own render tests (mitsuba-data's `tests/scenes`), against the references stored there: per scene a mean
//! image and the variance of one sample per pixel, `refs/X_ref_rgb.exr` and `refs/X_ref_rgb_var.exr`.

mod common;

use caustica::accel::Backend;
use caustica::image_io::{self, Image};
use caustica::integrator::{Budget, Kind, Options, Params};
use caustica::scene::{self, Scene};
use common::{backends, mean, render_with, shared};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Images of different seeds: enough for their spread to estimate their variance.
const SEEDS: u64 = 16;

/// The same for means alone, to a standard error of at most 0.25 %.
const PHOTON_SEEDS: u64 = 4;

/// Side of the blocks that are compared.
const BLOCK: usize = 4;

struct Case {
    name: String,
    scene: Scene,
    /// What the scene says of its integrator.
    params: Params,
    reference: Image,
    /// Of one sample.
    variance: Image,
}

/// All scenes of the suite; none, with a message, where it is absent.
fn cases(backend: Backend) -> Vec<Case> {
    let mut files = Vec::new();
    if let Some(scenes) = shared("mitsuba-suite/tests/scenes") {
        find(&scenes, &mut files);
        assert!(!files.is_empty(), "{} holds no scenes", scenes.display());
    }
    files.sort();
    files.into_iter().map(|(file, reference)| case(&file, &reference, backend)).collect()
}

/// Finds the files `X_<integrator>.xml` that have a reference.
fn find(dir: &Path, files: &mut Vec<(PathBuf, PathBuf)>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.ends_with("participating_media") {
            println!("skipped: {} needs participating media", path.display());
        } else if path.is_dir() {
            find(&path, files);
        } else if path.extension().is_some_and(|e| e == "xml") {
            let stem = path.file_stem().unwrap().to_str().unwrap();
            let name = stem.rsplit_once('_').map_or(stem, |(name, _)| name);
            let reference = dir.join("refs").join(format!("{name}_ref_rgb.exr"));
            if reference.exists() {
                files.push((path, reference));
            }
        }
    }
}

fn case(file: &Path, reference: &Path, backend: Backend) -> Case {
    let description = scene::load(file, &[], None).unwrap();
    let mut params = Params::default();
    for param in &description.integrator_params {
        params.set(&param.name, &param.value).unwrap();
    }
    let variance = reference.to_str().unwrap().replace("_rgb.exr", "_rgb_var.exr");
    Case {
        name: file.file_stem().unwrap().to_string_lossy().into_owned(),
        scene: Scene::new(description, backend).unwrap(),
        params,
        reference: image_io::read(reference).unwrap(),
        variance: image_io::read(Path::new(&variance)).unwrap(),
    }
}

impl Case {
    fn render(&self, integrator: Kind, passes: u32, seed: u64) -> Image {
        let options = Options {
            integrator,
            params: self.params.clone(),
            seed,
            budget: Budget::Passes(passes),
            aovs: false,
        };
        let image = render_with(&self.scene, &options).image;
        assert_eq!((image.width, image.height), (self.reference.width, self.reference.height));
        assert!(image.pixels.iter().all(|p| p.is_finite()), "{}: values that are not finite", self.name);
        image
    }

    /// Largest relative deviation of a channel's mean.
    fn bias(&self, image_mean: DVec3) -> f64 {
        let expected = mean(&self.reference).as_dvec3();
        ((image_mean - expected) / expected).abs().max_element()
    }

    /// Renders paths with many seeds and asks whether these are samples of the reference.
    fn check_paths(&self, passes: u32) {
        let images: Vec<Image> = (1..=SEEDS).map(|seed| self.render(Kind::Path, passes, seed)).collect();
        let n = SEEDS as f64;

        // Means: within 1 %, or within four standard errors, as the reference's variance predicts them.
        let image_mean: DVec3 = images.iter().map(|image| mean(image).as_dvec3()).sum::<DVec3>() / n;
        let samples = n * passes as f64 * self.reference.pixels.len() as f64;
        let error =
            (mean(&self.variance).as_dvec3() / samples).map(f64::sqrt) / mean(&self.reference).as_dvec3();
        let (bias, allowed) = (self.bias(image_mean), (4.0 * error.max_element()).max(0.01));

        // Blocks: the RMS of Student's t with 15 degrees of freedom is 1.07. Over 64 blocks or more, 1.5 is five
        // standard deviations off.
        let reference = blocks(&self.reference);
        let images: Vec<Vec<DVec3>> = images.iter().map(blocks).collect();
        let mut sum = DVec3::ZERO;
        for (i, &expected) in reference.iter().enumerate() {
            let m = images.iter().map(|b| b[i]).sum::<DVec3>() / n;
            let variance = images.iter().map(|b| (b[i] - m) * (b[i] - m)).sum::<DVec3>() / (n - 1.0);
            // The last term is the reference's own error.
            let own = 1e-4 + 1e-3 * expected.abs();
            sum += (m - expected) * (m - expected) / (variance / n + own * own);
        }
        let t = (sum.element_sum() / (3 * reference.len()) as f64).sqrt();

        println!("{}: RMS of t over blocks {t:.2}, bias {:.2} %", self.name, 100.0 * bias);
        assert!(t <= 1.5, "{}: RMS of t over blocks is {t:.2}", self.name);
        assert!(
            bias < allowed,
            "{}: bias {:.2} %, allowed {:.2} %",
            self.name,
            100.0 * bias,
            100.0 * allowed
        );
    }

    /// Means within 1 %. Of one picture that is two standard deviations where paths seldom meet a lamp in something glossy.
    fn check_photons(&self, passes: u32) {
        let mean = |seed| mean(&self.render(Kind::Photonmap, passes, seed)).as_dvec3();
        let bias = self.bias((1..=PHOTON_SEEDS).map(mean).sum::<DVec3>() / PHOTON_SEEDS as f64);
        println!("{}: bias of photon mapping {:.2} %", self.name, 100.0 * bias);
        assert!(bias < 0.01, "{}: bias of photon mapping {:.2} %", self.name, 100.0 * bias);
    }
}

/// Means over whole blocks.
fn blocks(image: &Image) -> Vec<DVec3> {
    let (columns, rows) = (image.width / BLOCK, image.height / BLOCK);
    let mut sums = vec![DVec3::ZERO; columns * rows];
    for (i, pixel) in image.pixels.iter().enumerate() {
        let (x, y) = (i % image.width / BLOCK, i / image.width / BLOCK);
        if x < columns && y < rows {
            sums[y * columns + x] += pixel.as_dvec3();
        }
    }
    sums.iter().map(|&sum| sum / (BLOCK * BLOCK) as f64).collect()
}

#[test]
fn paths_agree_with_mitsuba() {
    cases(backends().next().unwrap()).iter().for_each(|case| case.check_paths(64));
}

#[test]
fn photon_mapping_agrees_with_mitsuba_in_the_mean() {
    cases(backends().next().unwrap()).iter().for_each(|case| case.check_photons(256));
}

#[test]
#[ignore = "a minute; CI runs it nightly"]
fn every_backend_agrees_with_mitsuba_at_length() {
    for backend in backends() {
        for case in cases(backend) {
            case.check_paths(64);
            case.check_photons(1024);
        }
    }
}
