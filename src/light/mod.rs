//! Light sources: their radiance, direct sampling of them from a point, and emission of photons.
//!
//! Every light kind emits photons exactly as it lights directly: [`Lights::sample_emission`] and
//! [`Lights::sample_direct`] describe one and the same radiance.

mod area;
mod distant;
mod envmap;
mod spot;
mod targets;

pub use envmap::Envmap;
pub use spot::Spot;
pub use targets::Targets;

use crate::math::{Discrete, Rgb, luminance, warp};
use crate::shape::Geometry;
use crate::texture::{Color, Lookup, Texture};
use area::AreaSampler;
use distant::World;
use glam::{Vec2, Vec3};
use spot::SpotTable;
use std::f32::consts::PI;

/// A direction towards a light, sampled from a point.
#[derive(Clone, Copy, Debug)]
pub struct DirectSample {
    /// World direction to the light, unit length.
    pub wi: Vec3,
    /// The point on the light, already moved off its surface; `None` if it is infinitely far away. The shadow ray
    /// ends there.
    pub target: Option<Vec3>,
    /// L_e / (pdf_w · prob(light)), or the irradiance-like I/d² / prob(light) of a delta light.
    pub weight: Rgb,
    /// Solid-angle pdf including the probability of choosing the light; of no meaning for a delta light.
    pub pdf_w: f32,
    /// Whether BSDF sampling can never find this light (point, spot, directional).
    pub delta: bool,
}

/// A photon at its start.
#[derive(Clone, Copy, Debug)]
pub struct EmissionSample {
    /// Origin, already moved off the light's surface.
    pub o: Vec3,
    /// Flight direction, unit length.
    pub d: Vec3,
    /// α₀ = L_e cosθ / (pdf_a pdf_w prob(light)), in W: the photon's flux if one photon is emitted.
    pub flux: Rgb,
    /// Index of the light.
    pub light: u32,
}

/// The closed set of lights.
#[derive(Clone, Debug)]
pub enum Light {
    /// A shape that emits `radiance` from its front side (geometric normal).
    Area {
        /// Index of the shape.
        shape: u32,
        /// Emitted radiance.
        radiance: Color,
    },
    /// A point with the same intensity in all directions.
    Point {
        /// Position.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A point with angular falloff.
    Spot(Spot),
    /// Parallel light from infinitely far away.
    Directional {
        /// The direction in which the light travels, unit length.
        direction: Vec3,
        /// Irradiance on a surface facing the light, W per unit area.
        irradiance: Rgb,
    },
    /// The same radiance from everywhere.
    Constant {
        /// Radiance.
        radiance: Rgb,
    },
    /// A distant image all around.
    Envmap(Envmap),
}

/// What sampling a light needs besides the light, prepared once.
#[derive(Clone, Debug)]
enum Prepared {
    None,
    Area(AreaSampler),
    Spot(SpotTable),
}

/// All lights of a scene, and what is needed to choose among them.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    lights: Vec<Light>,
    prepared: Vec<Prepared>,
    power: Vec<Rgb>,
    world: World,
    /// For photons.
    by_power: Discrete,
    /// For direct light: half by power, half uniform over the lights that are not black, so that one strong light
    /// cannot starve the one that is near.
    for_direct: Discrete,
    /// The lights that escaping rays see.
    environment: Vec<u32>,
}

impl Lights {
    /// Prepares sampling. `geometry` is the whole scene: distant lights emit towards its bounding sphere.
    pub fn new(lights: Vec<Light>, geometry: &Geometry, textures: &[Texture]) -> Self {
        let world = World::new(geometry.bounds());
        let prepared: Vec<Prepared> = lights
            .iter()
            .map(|light| match light {
                Light::Area { shape, .. } => geometry
                    .shapes
                    .get(*shape as usize)
                    .map_or(Prepared::None, |s| Prepared::Area(AreaSampler::new(s))),
                Light::Spot(spot) => Prepared::Spot(SpotTable::new(spot, textures)),
                _ => Prepared::None,
            })
            .collect();
        let power: Vec<Rgb> = lights
            .iter()
            .zip(&prepared)
            .map(|(light, prepared)| match (light, prepared) {
                (Light::Area { shape, radiance }, Prepared::Area(sampler)) => {
                    sampler.power(&geometry.shapes[*shape as usize], *radiance, textures)
                }
                (Light::Point { intensity, .. }, _) => *intensity * (4.0 * PI),
                (_, Prepared::Spot(table)) => table.power(),
                (Light::Directional { irradiance, .. }, _) => *irradiance * world.cross_section(),
                (Light::Constant { radiance }, _) => *radiance * (4.0 * PI * world.cross_section()),
                (Light::Envmap(map), _) => map.integral() * world.cross_section(),
                _ => Rgb::ZERO,
            })
            .collect();
        let weight = |p: Rgb| if p.is_finite() { luminance(p).max(0.0) } else { 0.0 };
        let by_power = Discrete::new(power.iter().map(|&p| weight(p)));
        let lit: Vec<bool> = lights
            .iter()
            .zip(&power)
            .map(|(light, &power)| match light {
                // These light points outside of the geometry's bounds too.
                Light::Directional { irradiance, .. } => weight(*irradiance) > 0.0,
                Light::Constant { radiance } => weight(*radiance) > 0.0,
                Light::Envmap(map) => weight(map.integral()) > 0.0,
                _ => weight(power) > 0.0,
            })
            .collect();
        let uniform = 0.5 / lit.iter().filter(|&&l| l).count().max(1) as f32;
        let for_direct = Discrete::new((0..lights.len()).map(|i| {
            let share = if by_power.total() > 0.0 { by_power.prob(i) } else { 0.0 };
            if lit[i] { uniform + 0.5 * share } else { 0.0 }
        }));
        let environment = (0..lights.len() as u32)
            .filter(|&i| matches!(lights[i as usize], Light::Constant { .. } | Light::Envmap(_)))
            .collect();
        Lights { lights, prepared, power, world, by_power, for_direct, environment }
    }

    /// The lights.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// Analytic power of light `i`, W per channel; a distant light's is what it sends through the scene's bounding
    /// sphere. For textured area lights and spotlights it is integrated numerically, and for smooth
    /// meshes an upper bound; photons carry the exact flux.
    pub fn power(&self, i: u32) -> Rgb {
        self.power[i as usize]
    }

    /// Chooses a light with `u_light` (half by power, half uniformly) and a direction from the point `p` to it with
    /// `u`.
    pub fn sample_direct(
        &self,
        geometry: &Geometry,
        textures: &[Texture],
        p: Vec3,
        u_light: f32,
        u: Vec2,
    ) -> Option<DirectSample> {
        let (i, prob, _) = self.for_direct.sample(u_light)?;
        let sample = match (&self.lights[i], &self.prepared[i]) {
            (Light::Area { shape, radiance }, Prepared::Area(sampler)) => {
                sampler.direct(&geometry.shapes[*shape as usize], *radiance, textures, p, u)?
            }
            (Light::Point { position, intensity }, _) => {
                let to = *position - p;
                DirectSample {
                    wi: to.try_normalize()?,
                    target: Some(*position),
                    weight: *intensity / to.length_squared(),
                    pdf_w: 1.0,
                    delta: true,
                }
            }
            (Light::Spot(spot), _) => spot.direct(textures, p)?,
            (Light::Directional { direction, irradiance }, _) => {
                DirectSample { wi: -*direction, target: None, weight: *irradiance, pdf_w: 1.0, delta: true }
            }
            (Light::Constant { .. }, _) => return self.direct_background(warp::sphere(u)),
            (Light::Envmap(map), _) => return self.direct_background(map.sample(u)?),
            (Light::Area { .. }, _) => return None,
        };
        Some(DirectSample { weight: sample.weight / prob, pdf_w: sample.pdf_w * prob, ..sample })
    }

    /// Environment lights are seen together, so a direction sampled from one counts for all of them.
    fn direct_background(&self, wi: Vec3) -> Option<DirectSample> {
        let (radiance, pdf_w) = self.background_with_pdf_w(wi);
        let weight = radiance / pdf_w;
        (pdf_w > 0.0 && weight.is_finite()).then_some(DirectSample {
            wi,
            target: None,
            weight,
            pdf_w,
            delta: false,
        })
    }

    /// Radiance that area light `light` emits at a surface point towards `wo`. `normals` are the geometric
    /// and the shading normal there: as in Mitsuba a smooth mesh emits above its smooth horizon.
    pub fn emitted(
        &self,
        light: u32,
        textures: &[Texture],
        at: &Lookup,
        normals: [Vec3; 2],
        wo: Vec3,
    ) -> Rgb {
        match &self.lights[light as usize] {
            Light::Area { radiance, .. } if area::emits(normals, wo) => radiance.eval(textures, at),
            _ => Rgb::ZERO,
        }
    }

    /// Pdf with which [`Lights::sample_direct`] from `from` would have taken direction `wi` to the point `p` of the
    /// area light `light` (geometric normal `n_g` there).
    pub fn pdf_emitted_w(
        &self,
        light: u32,
        geometry: &Geometry,
        from: Vec3,
        wi: Vec3,
        p: Vec3,
        n_g: Vec3,
    ) -> f32 {
        let i = light as usize;
        match (&self.lights[i], &self.prepared[i]) {
            (Light::Area { shape, .. }, Prepared::Area(sampler)) => {
                self.for_direct.prob(i) * sampler.pdf_w(&geometry.shapes[*shape as usize], from, wi, p, n_g)
            }
            _ => 0.0,
        }
    }

    /// Radiance of all environment lights along the escaping direction `d`.
    pub fn background(&self, d: Vec3) -> Rgb {
        self.background_with_pdf_w(d).0
    }

    /// Pdf with which [`Lights::sample_direct`] would have taken the escaping direction `d`.
    pub fn pdf_background_w(&self, d: Vec3) -> f32 {
        self.background_with_pdf_w(d).1
    }

    /// [`Lights::background`] and [`Lights::pdf_background_w`] at the price of one.
    pub fn background_with_pdf_w(&self, d: Vec3) -> (Rgb, f32) {
        self.environment.iter().fold((Rgb::ZERO, 0.0), |(radiance, pdf_w), &i| {
            let (l, p) = match &self.lights[i as usize] {
                Light::Constant { radiance } => (*radiance, warp::SPHERE_PDF_W),
                Light::Envmap(map) => {
                    let l = map.eval(d);
                    (l, map.pdf_w(l))
                }
                _ => (Rgb::ZERO, 0.0),
            };
            (radiance + l, pdf_w + self.for_direct.prob(i as usize) * p)
        })
    }

    /// Emits a photon towards `targets`, if there are any: a light by power, a position by `u_pos`, a direction by
    /// `u_dir`.
    pub fn sample_emission(
        &self,
        geometry: &Geometry,
        textures: &[Texture],
        targets: &Targets,
        u_light: f32,
        u_pos: Vec2,
        u_dir: Vec2,
    ) -> Option<EmissionSample> {
        let (i, prob, _) = self.by_power.sample(u_light)?;
        let sample = match (&self.lights[i], &self.prepared[i]) {
            (Light::Area { shape, radiance }, Prepared::Area(sampler)) => {
                sampler.emission(geometry, *shape, *radiance, textures, targets, u_pos, u_dir)?
            }
            (Light::Point { position, intensity }, _) => {
                let (d, pdf_w) = match targets.aim_from(*position, None) {
                    Some(aim) => aim.sample(u_dir)?,
                    None => (warp::sphere(u_dir), warp::SPHERE_PDF_W),
                };
                EmissionSample { o: *position, d, flux: *intensity / pdf_w, light: 0 }
            }
            (Light::Spot(spot), Prepared::Spot(table)) => table.emission(spot, textures, targets, u_dir)?,
            (Light::Directional { direction, irradiance }, _) => {
                self.world.emission(*direction, *irradiance, targets, u_pos)?
            }
            (Light::Constant { radiance }, _) => {
                self.world.emission(warp::sphere(u_dir), *radiance / warp::SPHERE_PDF_W, targets, u_pos)?
            }
            (Light::Envmap(map), _) => {
                let wi = map.sample(u_dir)?;
                let radiance = map.eval(wi);
                let pdf_w = map.pdf_w(radiance);
                if pdf_w <= 0.0 {
                    return None;
                }
                self.world.emission(-wi, radiance / pdf_w, targets, u_pos)?
            }
            (Light::Area { .. } | Light::Spot(_), _) => return None,
        };
        Some(EmissionSample { flux: sample.flux / prob, light: i as u32, ..sample })
    }
}

#[cfg(test)]
mod tests;
