//! Area lights: a shape that emits from its front side (Mitsuba 3 `area` and `directionalarea`).

use super::{DirectSample, EmissionSample, Targets};
use crate::math::{Discrete, Frame, Rgb, offset_origin, warp};
use crate::shape::{AreaSample, Geometry, Shape, Wanted};
use crate::texture::{Color, Lookup, Texture};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Whether a surface point with these geometric and shading normals emits towards `wo`.
pub(super) fn emits([n_g, n_s]: [Vec3; 2], wo: Vec3) -> bool {
    wo.dot(n_g) > 0.0 && wo.dot(n_s) > 0.0
}

fn place<'a>(shape: &'a Shape, sample: &AreaSample) -> Lookup<'a> {
    Lookup::new(shape, sample.uv, sample.triangle, sample.weights)
}

/// What sampling an area light needs besides its shape.
#[derive(Clone, Debug)]
pub(super) struct AreaSampler {
    area: f32,
    distribution: Discrete,
    /// Whether no ray from the surface's front meets the shape again.
    lights_only_others: bool,
    /// Texture coordinates only for what is textured.
    wanted: Wanted,
}

impl AreaSampler {
    pub(super) fn new(shape: &Shape, radiance: Color) -> AreaSampler {
        AreaSampler {
            area: shape.area(),
            distribution: shape.area_distribution(),
            lights_only_others: shape.is_convex_outside(),
            wanted: if radiance.is_textured() { Wanted::All } else { Wanted::Untextured },
        }
    }

    pub(super) fn area(&self) -> f32 {
        self.area
    }

    /// Mean radiance, of a texture over 2¹⁶ evenly spread surface points.
    pub(super) fn mean(&self, shape: &Shape, radiance: Color, textures: &[Texture]) -> Rgb {
        match radiance {
            Color::Constant(c) => c,
            Color::Texture(_) => {
                const N: u32 = 1 << 16;
                let mut sum = [0.0f64; 3];
                for i in 0..N {
                    // Hammersley points.
                    let u = Vec2::new(i as f32 + 0.5, (i.reverse_bits() >> 16) as f32 + 0.5) / N as f32;
                    let Some(sample) = shape.sample_area(&self.distribution, u, self.wanted) else { break };
                    for (s, c) in
                        sum.iter_mut().zip(radiance.eval(textures, &place(shape, &sample)).to_array())
                    {
                        *s += c as f64;
                    }
                }
                Rgb::from_array(sum.map(|s| (s / N as f64) as f32))
            }
        }
    }

    pub(super) fn direct(
        &self,
        shape: &Shape,
        radiance: Color,
        textures: &[Texture],
        p: Vec3,
        u: Vec2,
    ) -> Option<DirectSample> {
        let visible = match shape {
            Shape::Sphere(sphere) => sphere.sample_visible(p, u, self.wanted),
            _ => None,
        };
        let (wi, point) = match visible {
            Some(sample) => sample,
            None => {
                let point = shape.sample_area(&self.distribution, u, self.wanted)?;
                ((point.p - p).try_normalize()?, point)
            }
        };
        let pdf_w = self.pdf_w(shape, p, wi, point.p, point.n_g);
        let weight = radiance.eval(textures, &place(shape, &point)) / pdf_w;
        // Seen from behind, or edge-on, nothing arrives.
        (emits([point.n_g, point.n_s], -wi) && weight.is_finite()).then(|| DirectSample {
            wi,
            target: Some(offset_origin(point.p, point.n_g, -wi, point.magnitude)),
            weight,
            pdf_w,
            delta: false,
        })
    }

    /// Pdf of [`AreaSampler::direct`] from `from` along `wi` to `p` with normal `n_g`.
    pub(super) fn pdf_w(&self, shape: &Shape, from: Vec3, wi: Vec3, p: Vec3, n_g: Vec3) -> f32 {
        let cos = -wi.dot(n_g);
        if cos <= 0.0 {
            return 0.0;
        }
        let visible = match shape {
            Shape::Sphere(sphere) => sphere.visible_pdf_w(from),
            _ => None,
        };
        visible.unwrap_or_else(|| p.distance_squared(from) / (cos * self.area))
    }

    #[allow(clippy::too_many_arguments)]
    pub(super) fn emission(
        &self,
        geometry: &Geometry,
        shape: u32,
        radiance: Color,
        textures: &[Texture],
        targets: &Targets,
        u_pos: Vec2,
        u_dir: Vec2,
    ) -> Option<EmissionSample> {
        let own = &geometry.shapes[shape as usize];
        let emitted = |point: &AreaSample| radiance.eval(textures, &place(own, point));
        let aim = |p: Vec3| targets.aim_from(p, self.lights_only_others.then_some(shape));
        let (point, d, flux) = match own {
            // The density of all other shapes below, but the direction hangs on two random numbers alone: it can be learnt
            // from them. Whether to aim must not depend on the point, which is drawn after the direction.
            Shape::Sphere(sphere) if !sphere.flipped && aim(sphere.center).is_none() => {
                let d = warp::sphere(u_dir);
                let n = Frame::from_normal(d).to_world(warp::cosine_hemisphere(u_pos));
                let point = sphere.at(n.as_dvec3(), self.wanted).into();
                (point, d, emitted(&point) * (PI * self.area))
            }
            _ => {
                let point = own.sample_area(&self.distribution, u_pos, self.wanted)?;
                match aim(point.p) {
                    Some(aim) => {
                        let (d, pdf_w) = aim.sample(u_dir)?;
                        let cos = d.dot(point.n_g).max(0.0);
                        (point, d, emitted(&point) * (cos * self.area / pdf_w))
                    }
                    None => {
                        let d = Frame::from_normal(point.n_g).to_world(warp::cosine_hemisphere(u_dir));
                        (point, d, emitted(&point) * (PI * self.area))
                    }
                }
            }
        };
        (flux != Rgb::ZERO && emits([point.n_g, point.n_s], d)).then(|| EmissionSample {
            o: offset_origin(point.p, point.n_g, d, point.magnitude),
            d,
            flux,
            light: 0,
        })
    }

    /// A photon along the shading normal of a [`super::Light::DirectionalArea`], where Mitsuba sends it too.
    pub(super) fn beam(
        &self,
        shape: &Shape,
        radiance: Color,
        textures: &[Texture],
        u: Vec2,
    ) -> Option<EmissionSample> {
        let point = shape.sample_area(&self.distribution, u, self.wanted)?;
        let flux = radiance.eval(textures, &place(shape, &point)) * self.area;
        let d = point.n_s.try_normalize()?;
        (flux != Rgb::ZERO).then(|| EmissionSample {
            o: offset_origin(point.p, point.n_g, d, point.magnitude),
            d,
            flux,
            light: 0,
        })
    }
}
