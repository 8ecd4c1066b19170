//! Light sources: their radiance, direct sampling of them from a point, and emission of photons.
//!
//! Every light kind emits photons exactly as it lights directly: [`Lights::sample_emission`] and
//! [`Lights::sample_direct`] describe one and the same radiance. But for beams, which only photons can show: see
//! [`Lights::is_beam`].

mod area;
mod distant;
mod envmap;
mod projector;
mod sky;
mod spot;
mod sun;
mod table;
mod targets;

pub use envmap::Envmap;
pub use projector::Projector;
pub use sky::Sky;
pub use spot::Spot;
pub use sun::Sun;
pub use targets::Targets;

use crate::math::{Discrete, Rgb, luminance, warp};
use crate::shape::{Geometry, Shape};
use crate::texture::{Color, Lookup, Texture};
use area::AreaSampler;
use distant::World;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;
use table::Table;

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
    /// A clear sky.
    Sky(Sky),
    /// A distant disk.
    Sun(Sun),
    /// A point that throws a picture.
    Projector(Projector),
    /// A shape that emits along its shading normals only. See [`Lights::is_beam`].
    DirectionalArea {
        /// Index of the shape.
        shape: u32,
        /// Emitted flux per area, W per unit area: Mitsuba calls it radiance.
        radiance: Color,
    },
    /// A ray of light. See [`Lights::is_beam`].
    Collimated {
        /// Where it starts.
        position: Vec3,
        /// Its direction, unit length.
        direction: Vec3,
        /// W.
        power: Rgb,
    },
}

/// What sampling a light needs besides the light, prepared once.
#[derive(Clone, Debug)]
enum Prepared {
    None,
    Area(AreaSampler),
    Table(Table),
}

/// All lights of a scene, and what is needed to choose among them.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    lights: Vec<Light>,
    prepared: Vec<Prepared>,
    power: Vec<Rgb>,
    world: World,
    /// For photons: half by power, half uniform over the lights that send any, so that one strong light cannot starve those
    /// that are seen.
    for_emission: Discrete,
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
                Light::Area { shape, radiance } | Light::DirectionalArea { shape, radiance } => geometry
                    .shapes
                    .get(*shape as usize)
                    .map_or(Prepared::None, |s| Prepared::Area(AreaSampler::new(s, *radiance))),
                Light::Spot(spot) => Prepared::Table(spot.table(textures)),
                Light::Projector(projector) => Prepared::Table(projector.table(textures)),
                Light::Sky(sky) => Prepared::Table(sky.table()),
                _ => Prepared::None,
            })
            .collect();
        let power: Vec<Rgb> = lights
            .iter()
            .zip(&prepared)
            .map(|(light, prepared)| match (light, prepared) {
                (Light::Area { shape, radiance }, Prepared::Area(sampler)) => {
                    sampler.mean(&geometry.shapes[*shape as usize], *radiance, textures)
                        * (PI * sampler.area())
                }
                (Light::DirectionalArea { shape, radiance }, Prepared::Area(sampler)) => {
                    sampler.mean(&geometry.shapes[*shape as usize], *radiance, textures) * sampler.area()
                }
                (Light::Collimated { power, .. }, _) => *power,
                (Light::Point { intensity, .. }, _) => *intensity * (4.0 * PI),
                (Light::Spot(spot), Prepared::Table(table)) => spot.power(table),
                (Light::Projector(projector), Prepared::Table(table)) => projector.power(table),
                (Light::Directional { irradiance, .. }, _) => *irradiance * world.cross_section(),
                (Light::Constant { radiance }, _) => *radiance * (4.0 * PI * world.cross_section()),
                (Light::Envmap(map), _) => map.integral() * world.cross_section(),
                (Light::Sky(sky), Prepared::Table(table)) => sky.integral(table) * world.cross_section(),
                (Light::Sun(sun), _) => sun.integral() * world.cross_section(),
                _ => Rgb::ZERO,
            })
            .collect();
        let weight = |p: Rgb| if p.is_finite() { luminance(p).max(0.0) } else { 0.0 };
        let by_power = Discrete::new(power.iter().map(|&p| weight(p)));
        let half_uniform = |lit: &[bool]| {
            let uniform = 0.5 / lit.iter().filter(|&&l| l).count().max(1) as f32;
            Discrete::new(lit.iter().enumerate().map(|(i, &lit)| {
                let share = if by_power.total() > 0.0 { by_power.prob(i) } else { 0.0 };
                if lit { uniform + 0.5 * share } else { 0.0 }
            }))
        };
        let emits: Vec<bool> = power.iter().map(|&p| weight(p) > 0.0).collect();
        let for_emission = half_uniform(&emits);
        let lit: Vec<bool> = lights
            .iter()
            .zip(prepared.iter().zip(&power))
            .map(|(light, (prepared, &power))| match (light, prepared) {
                // These light points outside of the geometry's bounds too.
                (Light::Directional { irradiance, .. }, _) => weight(*irradiance) > 0.0,
                (Light::Constant { radiance }, _) => weight(*radiance) > 0.0,
                (Light::Envmap(map), _) => weight(map.integral()) > 0.0,
                (Light::Sky(_), Prepared::Table(table)) => weight(table.mean()) > 0.0,
                (Light::Sun(sun), _) => weight(sun.integral()) > 0.0,
                (beam, _) => !beam.is_beam() && weight(power) > 0.0,
            })
            .collect();
        let for_direct = half_uniform(&lit);
        let environment = (0..lights.len() as u32).filter(|&i| lights[i as usize].is_environment()).collect();
        Lights { lights, prepared, power, world, for_emission, for_direct, environment }
    }

    /// The lights.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// Whether light `i` leaves each of its points in one direction only. No point finds the right one by sampling, so this
    /// light's photons are all there is of it: wherever they land first counts as a caustic.
    pub fn is_beam(&self, i: u32) -> bool {
        self.lights[i as usize].is_beam()
    }

    /// The shape that light `i` is, if it is one.
    pub fn shape(&self, i: u32) -> Option<u32> {
        match &self.lights[i as usize] {
            Light::Area { shape, .. } | Light::DirectionalArea { shape, .. } => Some(*shape),
            _ => None,
        }
    }

    /// Whether any light may send photons to `targets` without detour.
    pub fn reach(&self, geometry: &Geometry, targets: &Targets) -> bool {
        (0..self.lights.len() as u32).any(|i| self.reaches(i, geometry, targets))
    }

    /// Whether light `i` may send photons to `targets` without detour, whatever stands in between. One that cannot turns its
    /// back to them.
    pub fn reaches(&self, i: u32, geometry: &Geometry, targets: &Targets) -> bool {
        self.power(i) != Rgb::ZERO
            && match &self.lights[i as usize] {
                Light::Area { shape, .. } => {
                    let plane = geometry.shapes.get(*shape as usize).and_then(Shape::plane);
                    plane.is_none_or(|(p, n)| targets.lie_before(p, n, *shape))
                }
                Light::Spot(spot) => spot.reaches(targets),
                _ => true,
            }
    }

    /// Whether any light is a beam.
    pub fn have_beams(&self) -> bool {
        self.lights.iter().any(Light::is_beam)
    }

    /// Whether any light can be met by a ray, or shines where nothing is met.
    pub fn can_be_met(&self) -> bool {
        !self.environment.is_empty() || self.lights.iter().any(|light| matches!(light, Light::Area { .. }))
    }

    /// Analytic power of light `i`, W per channel; a distant light's is what it sends through the scene's bounding
    /// sphere. For skies, spotlights and pictures it is integrated numerically, and for smooth
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
            (Light::Sky(sky), Prepared::Table(table)) => {
                return self.direct_background(sky.sample(table, u)?);
            }
            (Light::Sun(sun), _) => return self.direct_background(sun.sample(u)),
            (Light::Projector(projector), _) => projector.direct(textures, p)?,
            // Not prepared, or beams.
            (
                Light::Area { .. } | Light::Sky(_) | Light::DirectionalArea { .. } | Light::Collimated { .. },
                _,
            ) => return None,
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
            let (l, p) = match (&self.lights[i as usize], &self.prepared[i as usize]) {
                (Light::Constant { radiance }, _) => (*radiance, warp::SPHERE_PDF_W),
                (Light::Envmap(map), _) => {
                    let l = map.eval(d);
                    (l, map.pdf_w(l))
                }
                (Light::Sky(sky), Prepared::Table(table)) => (sky.eval(d), sky.pdf_w(table, d)),
                (Light::Sun(sun), _) => (sun.eval(d), sun.pdf_w(d)),
                _ => (Rgb::ZERO, 0.0),
            };
            (radiance + l, pdf_w + self.for_direct.prob(i as usize) * p)
        })
    }

    /// The light that `u_light` chooses for a photon, half by power and half uniformly, and its probability; `None` if no light
    /// has any power.
    pub fn emitter(&self, u_light: f32) -> Option<(u32, f32)> {
        self.for_emission.sample(u_light).map(|(i, prob, _)| (i as u32, prob))
    }

    /// Emits a photon towards `targets`, if there are any: a light by [`Lights::emitter`], a position by `u_pos`, a direction
    /// by `u_dir`.
    pub fn sample_emission(
        &self,
        geometry: &Geometry,
        textures: &[Texture],
        targets: &Targets,
        u_light: f32,
        u_pos: Vec2,
        u_dir: Vec2,
    ) -> Option<EmissionSample> {
        let (light, prob) = self.emitter(u_light)?;
        let i = light as usize;
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
            (Light::Spot(spot), Prepared::Table(table)) => spot.emission(table, textures, targets, u_dir)?,
            (Light::Projector(projector), Prepared::Table(table)) => {
                projector.emission(table, textures, targets, u_dir)?
            }
            (Light::Collimated { position, direction, power }, _) => {
                EmissionSample { o: *position, d: *direction, flux: *power, light: 0 }
            }
            (Light::DirectionalArea { shape, radiance }, Prepared::Area(sampler)) => {
                sampler.beam(&geometry.shapes[*shape as usize], *radiance, textures, u_pos)?
            }
            (Light::Directional { direction, irradiance }, _) => {
                self.world.emission(*direction, *irradiance, targets, u_pos)?
            }
            (Light::Constant { radiance }, _) => {
                self.world.emission(warp::sphere(u_dir), *radiance / warp::SPHERE_PDF_W, targets, u_pos)?
            }
            (Light::Envmap(map), _) => {
                let wi = map.sample(u_dir)?;
                let radiance = map.eval(wi);
                self.distant(wi, radiance, map.pdf_w(radiance), targets, u_pos)?
            }
            (Light::Sky(sky), Prepared::Table(table)) => {
                let wi = sky.sample(table, u_dir)?;
                self.distant(wi, sky.eval(wi), sky.pdf_w(table, wi), targets, u_pos)?
            }
            (Light::Sun(sun), _) => {
                let wi = sun.sample(u_dir);
                self.distant(wi, sun.eval(wi), sun.pdf_w(wi), targets, u_pos)?
            }
            // Not prepared.
            (
                Light::Area { .. }
                | Light::Spot(_)
                | Light::Sky(_)
                | Light::Projector(_)
                | Light::DirectionalArea { .. },
                _,
            ) => return None,
        };
        Some(EmissionSample { flux: sample.flux / prob, light, ..sample })
    }

    /// A photon of a distant light from the direction `wi`, sampled with `pdf_w`.
    fn distant(
        &self,
        wi: Vec3,
        radiance: Rgb,
        pdf_w: f32,
        targets: &Targets,
        u_pos: Vec2,
    ) -> Option<EmissionSample> {
        if pdf_w <= 0.0 {
            return None;
        }
        self.world.emission(-wi, radiance / pdf_w, targets, u_pos)
    }
}

impl Light {
    /// What it is called in scenes.
    pub fn kind(&self) -> &'static str {
        match self {
            Light::Area { .. } => "area",
            Light::Point { .. } => "point",
            Light::Spot(_) => "spot",
            Light::Directional { .. } => "directional",
            Light::Constant { .. } => "constant",
            Light::Envmap(_) => "envmap",
            Light::Sky(_) => "sky",
            Light::Sun(_) => "sun",
            Light::Projector(_) => "projector",
            Light::DirectionalArea { .. } => "directionalarea",
            Light::Collimated { .. } => "collimated",
        }
    }

    fn is_beam(&self) -> bool {
        matches!(self, Light::DirectionalArea { .. } | Light::Collimated { .. })
    }

    /// Whether texture coordinates of its surface tell how much it emits.
    pub fn is_textured(&self) -> bool {
        match self {
            Light::Area { radiance, .. } | Light::DirectionalArea { radiance, .. } => radiance.is_textured(),
            _ => false,
        }
    }

    /// Whether escaping rays see it.
    fn is_environment(&self) -> bool {
        matches!(self, Light::Constant { .. } | Light::Envmap(_) | Light::Sky(_) | Light::Sun(_))
    }
}

#[cfg(test)]
mod tests;
