//! Photons that the camera sees directly, shown on the film where they land: without a kernel, so without bias, and
//! with the noise of the photons in a pixel (light tracing, Dutré, Lafortune & Willems 1993).

use super::estimate::scattered;
use crate::bsdf::Share;
use crate::math::{Rgb, Sampler};
use crate::scene::{Scene, Surface};
use glam::{Vec2, Vec3};

/// Light on one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Splat {
    /// Index into the film's crop window, row by row from the top.
    pub pixel: u32,
    /// What the pixel's radiance grows by.
    pub value: Rgb,
}

/// Shows photons to the camera.
#[derive(Clone, Copy)]
pub struct Splatter<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Whether the camera looks through lamps.
    pub hide_emitters: bool,
}

impl Splatter<'_> {
    /// Adds what a photon of `flux` that arrived at `s` from `wi` (world) shows on the film by the lobes that the eye
    /// sees as broad, through as many holes as there are `segments_left` to cross them. Returns the number of rays that took.
    pub(super) fn show(
        &self,
        s: &Surface,
        wi: Vec3,
        flux: Rgb,
        segments_left: u32,
        sampler: &mut Sampler,
        out: &mut Vec<Splat>,
    ) -> u64 {
        let (camera, film) = (&self.scene.camera, &self.scene.film);
        let lens = if camera.aperture_radius > 0.0 { sampler.next_2d() } else { Vec2::ZERO };
        let Some(seen) = camera.connect(s.p, s.n_g, lens) else { return 0 };
        let full = Vec2::new(film.size.0 as f32, film.size.1 as f32);
        // Relative to the crop window, in pixels, with pixel centres at integers.
        let at = seen.film * full - 0.5 - Vec2::new(film.crop.0 as f32, film.crop.1 as f32);
        let radius = film.filter.radius();
        let range = |at: f32, n: u32| {
            let (first, last) = ((at - radius).ceil().max(0.0), (at + radius).floor().min(n as f32 - 1.0));
            if first <= last { first as u32..last as u32 + 1 } else { 0..0 }
        };
        let (columns, rows) = (range(at.x, film.crop.2), range(at.y, film.crop.3));
        if columns.is_empty() || rows.is_empty() {
            return 0;
        }
        let wo = s.frame.to_local((seen.lens - s.p).normalize());
        let per_pixel = seen.film_per_area * full.x * full.y;
        let value = flux * scattered(s, wo, wi, Share::BroadEye) * per_pixel;
        let lit = value.max_element() > 0.0 && value.is_finite(); // false for NaN
        if !lit {
            return 0;
        }
        let mut rays = 0;
        let d = (seen.lens - s.p).normalize();
        let through = self.scene.transmittance(s, d, Some(seen.lens), self.hide_emitters, &mut rays);
        if through.color != Rgb::ZERO && through.crossings <= segments_left {
            let value = value * through.color;
            for y in rows {
                for x in columns.clone() {
                    let density = film.filter.density(at - Vec2::new(x as f32, y as f32));
                    if density > 0.0 {
                        out.push(Splat { pixel: y * film.crop.2 + x, value: value * density });
                    }
                }
            }
        }
        rays
    }
}
