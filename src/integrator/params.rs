//! The integrators' parameters, their names, defaults and ranges.

use crate::photon::Kernel;
use crate::{Error, Result};

/// Where direct light at surfaces that the camera sees comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectLight {
    /// From lights, sampled.
    Sample,
    /// From the global map; only without final gathering, which uses the map elsewhere.
    Map,
    /// It is left out.
    Off,
}

/// Where indirect light comes from that gather rays find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndirectLight {
    /// Whichever leaves less noise.
    Auto,
    /// From the global map, which also shows it where the camera looks.
    Map,
    /// From lights, sampled along the paths as which gather rays go on, and from the caustic map.
    Path,
}

/// Parameters of the integrators, with their defaults.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// `global_photons`: photon paths emitted per pass for the global map; 0 chooses by the number of pixels.
    pub global_photons: u64,
    /// `caustic_photons`: photon paths emitted per pass for the caustic map; 0 chooses by the number of pixels.
    pub caustic_photons: u64,
    /// `global_k`: photons in an estimate from the global map (32).
    pub global_k: u32,
    /// `caustic_k`: photons in an estimate from the caustic map (50).
    pub caustic_k: u32,
    /// `global_radius`: largest lookup radius in the global map, as a fraction of the scene's radius (0.1).
    pub global_radius: f32,
    /// `caustic_radius`: largest lookup radius in the caustic map, as a fraction of the scene's radius (0.05).
    pub caustic_radius: f32,
    /// `kernel`: `constant`, `cone`, `epanechnikov` (default) or `biweight`.
    pub kernel: Kernel,
    /// `final_gather`: also gather indirect light over the global map, and show that where the map shown directly is biased
    /// (default); or show the map alone.
    pub final_gather: bool,
    /// `regression`: pixels learn from neighbours that noise cannot tell apart from them (true).
    pub regression: bool,
    /// `irradiance_cache`: gather rays may find irradiance that was estimated ahead, where that saves time (default).
    pub irradiance_cache: bool,
    /// `guided_gather`: gather rays go to where photons came from, too (true).
    pub guided_gather: bool,
    /// `direct`: direct light is taken by `sample` (default), from the `map`, or is `off`.
    pub direct: DirectLight,
    /// `indirect`: indirect light is taken from the `map`, by tracing each `path` to its end, or `auto` by what
    /// leaves less noise (default).
    pub indirect: IndirectLight,
    /// `alpha`: how fast the lookup radius shrinks from pass to pass, in (0, 1] where 1 keeps it (2/3).
    pub alpha: f32,
    /// `max_depth`: longest path in segments, −1 for no limit (default); 1 shows only what lights emit.
    pub max_depth: i32,
    /// `rr_depth`: path length from which Russian roulette may end a path (5).
    pub rr_depth: u32,
    /// `hide_emitters`: lights are not seen directly, but what is behind them (false).
    pub hide_emitters: bool,
    /// `skip`: stages that the scene does not need are skipped (true). Switched off only to measure what that brings, so no
    /// list of parameters names it.
    pub skip: bool,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            global_photons: 0,
            caustic_photons: 0,
            global_k: 32,
            caustic_k: 50,
            global_radius: 0.1,
            caustic_radius: 0.05,
            kernel: Kernel::Epanechnikov,
            final_gather: true,
            regression: true,
            irradiance_cache: true,
            guided_gather: true,
            direct: DirectLight::Sample,
            indirect: IndirectLight::Auto,
            alpha: 2.0 / 3.0,
            max_depth: -1,
            rr_depth: 5,
            hide_emitters: false,
            skip: true,
        }
    }
}

fn number<T: std::str::FromStr>(name: &str, value: &str) -> Result<T> {
    value
        .trim()
        .parse()
        .map_err(|_| Error::Usage(format!("parameter '{name}': '{value}' is not a valid number")))
}

fn boolean(name: &str, value: &str) -> Result<bool> {
    match value.trim() {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err(Error::Usage(format!("parameter '{name}': '{value}' is neither true nor false"))),
    }
}

impl Params {
    /// Sets a parameter by name, from text as it stands in a scene or after `--set`.
    ///
    /// # Errors
    /// [`Error::Usage`] with the name if it is unknown or the value makes no sense.
    pub fn set(&mut self, name: &str, value: &str) -> Result<()> {
        let out_of_range = |range| Err(Error::Usage(format!("parameter '{name}': '{value}' is not {range}")));
        match name {
            "global_photons" => self.global_photons = number(name, value)?,
            "caustic_photons" => self.caustic_photons = number(name, value)?,
            "global_k" | "caustic_k" => match number(name, value)? {
                k @ 2..=10_000 if name == "global_k" => self.global_k = k,
                k @ 2..=10_000 => self.caustic_k = k,
                _ => return out_of_range("between 2 and 10000"),
            },
            "global_radius" | "caustic_radius" => match number::<f32>(name, value)? {
                r if r > 0.0 && r.is_finite() && name == "global_radius" => self.global_radius = r,
                r if r > 0.0 && r.is_finite() => self.caustic_radius = r,
                _ => return out_of_range("a positive fraction of the scene's radius"),
            },
            "kernel" => {
                self.kernel = match value.trim() {
                    "constant" => Kernel::Constant,
                    "cone" => Kernel::Cone,
                    "epanechnikov" => Kernel::Epanechnikov,
                    "biweight" => Kernel::Biweight,
                    _ => return out_of_range("one of constant, cone, epanechnikov, biweight"),
                }
            }
            "final_gather" => self.final_gather = boolean(name, value)?,
            "regression" => self.regression = boolean(name, value)?,
            "irradiance_cache" => self.irradiance_cache = boolean(name, value)?,
            "guided_gather" => self.guided_gather = boolean(name, value)?,
            "direct" => {
                self.direct = match value.trim() {
                    "sample" => DirectLight::Sample,
                    "map" => DirectLight::Map,
                    "off" => DirectLight::Off,
                    _ => return out_of_range("one of sample, map, off"),
                }
            }
            "indirect" => {
                self.indirect = match value.trim() {
                    "auto" => IndirectLight::Auto,
                    "map" => IndirectLight::Map,
                    "path" => IndirectLight::Path,
                    _ => return out_of_range("one of auto, map, path"),
                }
            }
            "alpha" => match number::<f32>(name, value)? {
                a if a > 0.0 && a <= 1.0 => self.alpha = a,
                _ => return out_of_range("above 0 and at most 1"),
            },
            "max_depth" => match number(name, value)? {
                d if d >= -1 => self.max_depth = d,
                _ => return out_of_range("-1 or more"),
            },
            "rr_depth" => match number(name, value)? {
                0 => return out_of_range("at least 1"),
                d => self.rr_depth = d,
            },
            "hide_emitters" => self.hide_emitters = boolean(name, value)?,
            "skip" => self.skip = boolean(name, value)?,
            _ => {
                return Err(Error::Usage(format!(
                    "unknown parameter '{name}': known are global_photons, caustic_photons, global_k, caustic_k, \
                     global_radius, caustic_radius, kernel, final_gather, regression, irradiance_cache, \
                     guided_gather, direct, indirect, alpha, max_depth, rr_depth, hide_emitters"
                )));
            }
        }
        Ok(())
    }

    /// All parameters by name, with values as [`Params::set`] takes them.
    pub fn named(&self) -> Vec<(&'static str, String)> {
        let Params {
            global_photons,
            caustic_photons,
            global_k,
            caustic_k,
            global_radius,
            caustic_radius,
            kernel,
            final_gather,
            regression,
            irradiance_cache,
            guided_gather,
            direct,
            indirect,
            alpha,
            max_depth,
            rr_depth,
            hide_emitters,
            skip,
        } = self;
        vec![
            ("global_photons", global_photons.to_string()),
            ("caustic_photons", caustic_photons.to_string()),
            ("global_k", global_k.to_string()),
            ("caustic_k", caustic_k.to_string()),
            ("global_radius", global_radius.to_string()),
            ("caustic_radius", caustic_radius.to_string()),
            ("kernel", format!("{kernel:?}").to_lowercase()),
            ("final_gather", final_gather.to_string()),
            ("regression", regression.to_string()),
            ("irradiance_cache", irradiance_cache.to_string()),
            ("guided_gather", guided_gather.to_string()),
            ("direct", format!("{direct:?}").to_lowercase()),
            ("indirect", format!("{indirect:?}").to_lowercase()),
            ("alpha", alpha.to_string()),
            ("max_depth", max_depth.to_string()),
            ("rr_depth", rr_depth.to_string()),
            ("hide_emitters", hide_emitters.to_string()),
            ("skip", skip.to_string()),
        ]
    }

    /// `max_depth` as a number of segments.
    pub fn max_segments(&self) -> u32 {
        if self.max_depth < 0 { u32::MAX } else { self.max_depth as u32 }
    }

    /// Most segments of a photon's path: the last one of all is the camera's.
    pub(super) fn longest_flight(&self) -> u32 {
        self.max_segments().saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_values_give_the_parameters_back() {
        let odd = Params {
            global_photons: 1,
            caustic_photons: u64::MAX,
            global_k: 3,
            caustic_k: 4,
            global_radius: 0.1 + f32::EPSILON,
            caustic_radius: 1e-30,
            kernel: Kernel::Biweight,
            final_gather: false,
            regression: false,
            irradiance_cache: false,
            guided_gather: false,
            direct: DirectLight::Off,
            indirect: IndirectLight::Path,
            alpha: 1.0 / 3.0,
            max_depth: 7,
            rr_depth: 8,
            hide_emitters: true,
            skip: false,
        };
        for params in [odd, Params::default()] {
            let mut copy = Params { alpha: 0.9, ..Params::default() };
            params.named().iter().try_for_each(|(name, value)| copy.set(name, value)).unwrap();
            assert_eq!(copy, params);
        }
    }
}
