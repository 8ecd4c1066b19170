//! Direct light at a surface, by light sampling and BSDF sampling combined by multiple importance sampling
//! (Veach & Guibas 1995, power heuristic).

use super::Params;
use crate::bsdf::{BsdfSample, Mode, Share};
use crate::math::{Ray, Rgb, Sampler, power_heuristic};
use crate::scene::{Scene, Surface};
use glam::Vec3;

/// A light sample that reaches the surface, and how it is weighted against the other strategy.
pub(super) struct Lit {
    /// Direction to the light, local.
    pub(super) wi: Vec3,
    /// Light over pdf, times the weight against the other strategy, times nothing of the BSDF.
    pub(super) light: Rgb,
    /// f·|cosθ_i| of all non-delta lobes.
    pub(super) f: Rgb,
}

/// Samples one light from `s`, and tests what of it is seen. The other strategy takes a local direction with
/// the density `other_pdf_w`, and finds lights through `segments_left` segments at most: crossing a hole
/// takes one of a path, none of a shadow ray. `rays` counts the shadow rays.
pub(super) fn sample_light(
    scene: &Scene,
    s: &Surface,
    wo: Vec3,
    segments_left: u32,
    sampler: &mut Sampler,
    rays: &mut u64,
    other_pdf_w: impl Fn(Vec3) -> f32,
) -> Option<Lit> {
    let (u_light, u) = (sampler.next_1d(), sampler.next_2d());
    let light = scene.lights.sample_direct(&scene.geometry, &scene.textures, s.p, u_light, u)?;
    let wi = s.frame.to_local(light.wi);
    let f = s.bsdf.eval(wo, wi, Mode::Radiance, Share::All);
    let lit = f.max_element() > 0.0; // false for NaN
    if !lit {
        return None;
    }
    let through = scene.transmittance(s, light.wi, light.target, false, rays);
    if through.color == Rgb::ZERO {
        return None;
    }
    let alone = light.delta || through.crossings >= segments_left;
    let mis = if alone { 1.0 } else { power_heuristic(light.pdf_w, other_pdf_w(wi)) };
    Some(Lit { wi, light: light.weight * through.color * mis, f })
}

/// The previous vertex of a path, as far as weighting an emitter that BSDF sampling has found needs it.
#[derive(Clone, Copy)]
pub(super) struct Previous {
    /// Its position.
    pub(super) p: Vec3,
    /// Pdf of the direction taken; `None` if no light sample could have taken it (camera, delta lobe).
    pub(super) pdf_w: Option<f32>,
}

/// What a camera ray meets first. With `hide_emitters`, lamps are not there at all, as in Mitsuba: what is
/// behind them shows. `rays` counts what is traced beyond the first ray.
pub(super) fn first_hit<'a>(
    scene: &'a Scene,
    params: &Params,
    mut ray: Ray,
    rays: &mut u64,
) -> Option<Surface<'a>> {
    loop {
        let hit = scene.hit(&ray);
        match &hit {
            Some(s) if s.light.is_some() && params.hide_emitters => {
                *rays += 1;
                ray = Ray { t_max: ray.t_max - (s.p - ray.o).length(), ..s.spawn(ray.d) };
            }
            _ => return hit,
        }
    }
}

/// Radiance that `s` emits back along `ray`, weighted against light sampling at the previous vertex.
pub(super) fn emitted(scene: &Scene, s: &Surface, ray: &Ray, previous: &Previous) -> Rgb {
    let Some(light) = s.light else { return Rgb::ZERO };
    let radiance = scene.emitted(s, -ray.d);
    match previous.pdf_w {
        Some(pdf_w) if radiance != Rgb::ZERO => {
            let other = scene.lights.pdf_emitted_w(light, &scene.geometry, previous.p, ray.d, s.p, s.n_g);
            radiance * power_heuristic(pdf_w, other)
        }
        _ => radiance,
    }
}

/// Radiance along `ray` from the light that it meets, weighted against light sampling at the previous vertex,
/// if it does so within `segments_left` segments: crossing a hole takes one.
pub(super) fn along(
    scene: &Scene,
    mut ray: Ray,
    previous: &Previous,
    segments_left: u32,
    sampler: &mut Sampler,
    rays: &mut u64,
) -> Rgb {
    let mut sum = Rgb::ZERO;
    for _ in 0..segments_left {
        *rays += 1;
        let Some(hit) = scene.intersect(&ray) else { return sum + background(scene, &ray, previous) };
        if scene.is_plain(&hit) {
            break;
        }
        let s = scene.surface(&ray, &hit);
        sum += emitted(scene, &s, &ray, previous);
        if !s.is_crossed(sampler) {
            break;
        }
        ray = s.spawn(ray.d);
    }
    sum
}

/// Radiance of the environment along `ray`, weighted against light sampling at the previous vertex.
pub(super) fn background(scene: &Scene, ray: &Ray, previous: &Previous) -> Rgb {
    let Some(pdf_w) = previous.pdf_w else { return scene.lights.background(ray.d) };
    let (radiance, other) = scene.lights.background_with_pdf_w(ray.d);
    radiance * power_heuristic(pdf_w, other)
}

/// Whether `sample` goes on as if nothing were there: hidden distant lights stay hidden behind holes and thin
/// sheets.
pub(super) fn goes_straight(sample: &BsdfSample, wo: Vec3) -> bool {
    sample.delta && sample.wi == -wo
}
