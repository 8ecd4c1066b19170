//! `caustica photons`: the stored photons as points, or as the camera sees them.

use super::args::PhotonsArgs;
use super::output::extension;
use super::prepare::{prepare, with_threads};
use caustica::image_io::{self, Image};
use caustica::integrator::{self, Kind, PhotonRecord};
use caustica::math::{Rgb, luminance};
use caustica::scene::Scene;
use caustica::{Error, Result};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::io::{self, Write};
use std::path::Path;

pub(super) fn run(args: &PhotonsArgs) -> Result<()> {
    let png = match extension(&args.output).as_str() {
        "ply" if args.exposure != 0.0 => {
            return Err(Error::Usage(
                "--exposure is for PNG; a PLY holds each photon's flux as it is".into(),
            ));
        }
        "ply" => false,
        "png" => true,
        _ => {
            let message = format!("'{}': the output's name must end in .ply or .png", args.output.display());
            return Err(Error::Usage(message));
        }
    };
    image_io::check_writable(&args.output)?;
    with_threads(&args.common, || {
        let prepared = prepare(&args.scene, &args.common, Some(Kind::Photonmap))?;
        let photons = integrator::photon_records(&prepared.scene, &prepared.options);
        if png {
            image_io::write_png(&args.output, &picture(&prepared.scene, &photons), args.exposure)?;
        } else {
            write_ply(&args.output, &photons)?;
        }
        let caustic = photons.iter().filter(|p| p.caustic).count();
        let message =
            format!("{}: {} photons, {caustic} of them caustic", args.output.display(), photons.len());
        args.common.verbosity.note("", &message);
        Ok(())
    })
}

/// Binary PLY: position, direction of flight, a colour to look at, and the exact flux in W.
fn write_ply(path: &Path, photons: &[PhotonRecord]) -> Result<()> {
    let brightness = typical(photons.iter().map(|p| luminance(p.flux)).collect());
    image_io::replace_file(path, |w| {
        write!(w, "ply\nformat binary_little_endian 1.0\ncomment caustica {}\n", env!("CARGO_PKG_VERSION"))?;
        writeln!(w, "element vertex {}", photons.len())?;
        for name in ["x", "y", "z", "dx", "dy", "dz", "flux_r", "flux_g", "flux_b"] {
            writeln!(w, "property float {name}")?;
        }
        w.write_all(
            b"property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar caustic\n",
        )?;
        w.write_all(b"end_header\n")?;
        photons.iter().try_for_each(|p| write_record(w, p, brightness))
    })
}

fn write_record(w: &mut impl Write, photon: &PhotonRecord, brightness: f32) -> io::Result<()> {
    for v in [photon.p, photon.d, photon.flux] {
        for x in v.to_array() {
            w.write_all(&x.to_le_bytes())?;
        }
    }
    let shade = |x: f32| (image_io::linear_to_srgb((x * brightness).clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
    w.write_all(&photon.flux.to_array().map(shade))?;
    w.write_all(&[photon.caustic as u8])
}

/// The factor that brings typical values (those that are not zero) to a middle brightness.
fn typical(mut values: Vec<f32>) -> f32 {
    values.retain(|v| *v > 0.0 && v.is_finite());
    values.sort_unstable_by(f32::total_cmp);
    match values.get(values.len() / 2) {
        Some(median) => 0.5 / median,
        None => 1.0,
    }
}

/// Every photon that the camera sees as a point as bright as its flux.
fn picture(scene: &Scene, photons: &[PhotonRecord]) -> Image {
    let (full_width, full_height) = scene.film.size;
    let (left, top, width, height) = scene.film.crop;
    let film = Vec2::new(full_width as f32, full_height as f32);
    let pixel = |photon: &PhotonRecord| {
        let at = scene.camera.project(photon.p)?;
        let x = (at * film - Vec2::new(left as f32, top as f32)).floor();
        let inside = x.x >= 0.0 && x.y >= 0.0 && x.x < width as f32 && x.y < height as f32;
        (inside && visible(scene, at, photon.p)).then(|| x.y as usize * width as usize + x.x as usize)
    };
    let seen: Vec<Option<usize>> = photons.par_iter().map(pixel).collect();
    let mut pixels = vec![Rgb::ZERO; width as usize * height as usize];
    for (photon, at) in photons.iter().zip(seen) {
        if let Some(p) = at.and_then(|i| pixels.get_mut(i)) {
            *p += photon.flux;
        }
    }
    let brightness = typical(pixels.iter().map(|p| luminance(*p)).collect());
    pixels.iter_mut().for_each(|p| *p *= brightness);
    Image { width: width as usize, height: height as usize, pixels }
}

/// Whether the camera sees `p`, which appears at film position `at`, straight or through clear surfaces. (Refraction
/// is not followed: water shows what lies under it, though not where the eye would see it.)
fn visible(scene: &Scene, at: Vec2, p: Vec3) -> bool {
    // A drawing tolerance, relative to the distance: the photon lies on the surface that must be found.
    const TOLERANCE: f32 = 1e-3;
    const LAYERS: usize = 16;
    let mut ray = scene.camera.ray(at, Vec2::splat(0.5));
    let distance = ray.o.distance(p);
    for _ in 0..LAYERS {
        let Some(surface) = scene.hit(&ray) else { return true };
        if surface.p.distance(p) <= TOLERANCE * distance {
            return true;
        }
        if (p - surface.p).dot(ray.d) < 0.0 {
            return true;
        }
        let material = scene.material(surface.shape);
        if surface.bsdf.opacity() >= 0.5 && (material.lobes().smooth || !material.transmits()) {
            return false;
        }
        ray = surface.spawn(ray.d);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ply_has_the_size_that_its_header_says() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        let photon = PhotonRecord { p: Vec3::X, d: Vec3::Y, flux: Vec3::new(2.0, 1.0, 0.0), caustic: true };
        write_ply(&path, &[photon; 3]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let text = std::str::from_utf8(&bytes[..header]).unwrap();
        assert!(text.contains("element vertex 3\n"));
        let size = 4 * text.matches("property float").count() + text.matches("property uchar").count();
        assert_eq!(bytes.len() - header, 3 * size);
        assert_eq!(&bytes[header..header + 4], &1.0_f32.to_le_bytes());
        assert_eq!(bytes[header + size - 1], 1);
    }

    #[test]
    fn brightness_follows_the_median() {
        assert_eq!(typical(vec![0.0, 0.25, f32::NAN, 0.0, 0.5, 2.0]), 1.0);
        assert_eq!(typical(vec![]), 1.0);
    }
}
