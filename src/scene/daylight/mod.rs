//! Where the sun stands, and how much light it sends through the air.

mod sun_irradiance;

use super::spectrum::{Role, Spectrum};
use crate::math::Rgb;
use glam::DVec3;
use sun_irradiance::SUN_IRRADIANCE;

/// Half the angle under which Mitsuba sees the sun, in degrees.
pub(super) const SUN_HALF_ANGLE: f64 = 0.5 * 0.5358;

/// A place and a moment of local time.
#[derive(Clone, Copy, Debug)]
pub(super) struct When {
    /// Degrees north.
    pub(super) latitude: f64,
    /// Degrees east.
    pub(super) longitude: f64,
    /// Hours before Greenwich.
    pub(super) timezone: f64,
    /// Year, month, day.
    pub(super) date: [i32; 3],
    /// Since midnight.
    pub(super) hours: f64,
}

impl When {
    /// The sun's angle to the zenith and its azimuth from north over east, in radians. Blanco-Muriel, Alarcón-Padilla,
    /// López-Moratalla & Lara-Coira 2001, "Computing the Solar Vector".
    pub(super) fn sun(&self) -> (f64, f64) {
        let hours = self.hours - self.timezone; // universal time
        let days = julian_day(self.date) as f64 - 0.5 + hours / 24.0 - 2_451_545.0;
        // Ecliptic coordinates.
        let omega = 2.1429 - 0.001_039_459_4 * days;
        let longitude = 4.895_063 + 0.017_202_791_698 * days;
        let anomaly = 6.24006 + 0.017_201_969_9 * days;
        let longitude = longitude + 0.033_416_07 * anomaly.sin() + 0.000_348_94 * (2.0 * anomaly).sin()
            - 0.000_113_4
            - 0.000_020_3 * omega.sin();
        let obliquity = 0.409_092_8 - 6.214e-9 * days + 0.000_039_6 * omega.cos();
        // Celestial coordinates.
        let right_ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
        let declination = (obliquity.sin() * longitude.sin()).asin();
        // Horizontal coordinates.
        let sidereal = 6.697_424_324_2 + 0.065_709_828_3 * days + hours;
        let hour_angle = (15.0 * sidereal + self.longitude).to_radians() - right_ascension;
        let (sin_latitude, cos_latitude) = self.latitude.to_radians().sin_cos();
        let cos_zenith =
            cos_latitude * hour_angle.cos() * declination.cos() + declination.sin() * sin_latitude;
        let zenith = cos_zenith.clamp(-1.0, 1.0).acos();
        let north = declination.tan() * cos_latitude - sin_latitude * hour_angle.cos();
        let azimuth = (-hour_angle.sin()).atan2(north);
        // Parallax: Earth's radius over its distance to the sun, km.
        (zenith + 6371.01 / 149_597_890.0 * zenith.sin(), azimuth)
    }
}

/// The day's Julian number (Fliegel & Van Flandern 1968).
fn julian_day([year, month, day]: [i32; 3]) -> i64 {
    let (year, month, day) = (year as i64, month as i64, day as i64);
    let leap = (month - 14) / 12;
    1461 * (year + 4800 + leap) / 4 + 367 * (month - 2 - 12 * leap) / 12
        - 3 * ((year + 4900 + leap) / 100) / 4
        + day
        - 32075
}

/// Irradiance of a surface that faces the sun, in linear sRGB as Mitsuba 3 has it: W·m⁻²·nm⁻¹ averaged over the observer's
/// curves. `elevation` in degrees above the horizon, `turbidity` from 1 to 10.
pub(super) fn sun_irradiance(turbidity: f32, elevation: f32) -> Rgb {
    let split = |x: f32, last: usize| {
        let i = (x.max(0.0) as usize).min(last - 1);
        (i, (x - i as f32).clamp(0.0, 1.0))
    };
    let (t, dt) = split(turbidity - 1.0, SUN_IRRADIANCE.len() - 1);
    let (e, de) = split((elevation - 2.0) / 3.0, SUN_IRRADIANCE[0].len() - 1);
    let at = |t: usize, e: usize| Rgb::from_array(SUN_IRRADIANCE[t][e]);
    at(t, e).lerp(at(t, e + 1), de).lerp(at(t + 1, e).lerp(at(t + 1, e + 1), de), dt)
}

/// Radiance of the sun's disk in linear sRGB, in the same units, as Mitsuba 0.6 has it: Preetham, Shirley & Smits 1999, "A
/// Practical Analytic Model for Daylight", appendix 1. `zenith` is the sun's angle to the zenith in radians.
pub(super) fn preetham_sun_radiance(turbidity: f64, zenith: f64) -> Rgb {
    let degrees = zenith.to_degrees();
    let mass = 1.0 / (zenith.cos() + 0.15 * (93.885 - degrees).max(0.0).powf(-1.253)); // relative optical mass
    let haze = 0.046_083_658_220_5 * turbidity - 0.045_860_259_285_22; // Ångström's β
    let radiance = |nm: f64| {
        let um = nm / 1000.0;
        let rayleigh = (-mass * 0.008_735 * um.powf(-4.08)).exp();
        let aerosol = (-mass * haze * um.powf(-1.3)).exp();
        let ozone = (-mass * 0.35 * linear(&OZONE, nm)).exp(); // 0.35 cm of it
        let gas = linear(&MIXED_GASES, nm) * mass;
        let gas = (-1.41 * gas / (1.0 + 118.93 * gas).powf(0.45)).exp();
        let vapour = 2.0 * linear(&WATER_VAPOUR, nm) * mass; // 2 cm of precipitable water
        let vapour = (-0.2385 * vapour / (1.0 + 20.07 * vapour).powf(0.45)).exp();
        linear(&SUN, nm) * rayleigh * aerosol * ozone * gas * vapour
    };
    let samples = (0..91).map(|i| 350.0 + 5.0 * i as f64).map(|nm| (nm, radiance(nm))).collect();
    Spectrum::samples(samples).map_or(Rgb::ZERO, |spectrum| spectrum.to_rgb(Role::Emission).0)
}

/// Between the entries of a table; zero outside.
fn linear(table: &[(f64, f64)], nm: f64) -> f64 {
    let after = table.partition_point(|entry| entry.0 < nm);
    match (after.checked_sub(1).and_then(|i| table.get(i)), table.get(after)) {
        (Some(a), Some(b)) => a.1 + (nm - a.0) / (b.0 - a.0) * (b.1 - a.1),
        (None, Some(b)) if b.0 == nm => b.1,
        _ => 0.0,
    }
}

/// The direction at angle `zenith` from `up` in the plane of `up` and `towards`.
pub(super) fn at_zenith(up: DVec3, towards: DVec3, zenith: f64) -> DVec3 {
    let across = (towards - up * up.dot(towards)).normalize_or_zero();
    up * zenith.cos() + across * zenith.sin()
}

// The tables of Preetham et al., after Iqbal 1983, "An Introduction to Solar Radiation": nm, and
// absorption coefficient of ozone, cm⁻¹,
#[rustfmt::skip]
const OZONE: [(f64, f64); 64] = [
    (300.0, 10.0), (305.0, 4.8), (310.0, 2.7), (315.0, 1.35), (320.0, 0.8), (325.0, 0.38), (330.0, 0.16),
    (335.0, 0.075), (340.0, 0.04), (345.0, 0.019), (350.0, 0.007), (355.0, 0.0), (445.0, 0.003), (450.0, 0.003),
    (455.0, 0.004), (460.0, 0.006), (465.0, 0.008), (470.0, 0.009), (475.0, 0.012), (480.0, 0.014), (485.0, 0.017),
    (490.0, 0.021), (495.0, 0.025), (500.0, 0.03), (505.0, 0.035), (510.0, 0.04), (515.0, 0.045), (520.0, 0.048),
    (525.0, 0.057), (530.0, 0.063), (535.0, 0.07), (540.0, 0.075), (545.0, 0.08), (550.0, 0.085), (555.0, 0.095),
    (560.0, 0.103), (565.0, 0.11), (570.0, 0.12), (575.0, 0.122), (580.0, 0.12), (585.0, 0.118), (590.0, 0.115),
    (595.0, 0.12), (600.0, 0.125), (605.0, 0.13), (610.0, 0.12), (620.0, 0.105), (630.0, 0.09), (640.0, 0.079),
    (650.0, 0.067), (660.0, 0.057), (670.0, 0.048), (680.0, 0.036), (690.0, 0.028), (700.0, 0.023), (710.0, 0.018),
    (720.0, 0.014), (730.0, 0.011), (740.0, 0.01), (750.0, 0.009), (760.0, 0.007), (770.0, 0.004), (780.0, 0.0),
    (790.0, 0.0),
];
/// of mixed gases, km⁻¹,
const MIXED_GASES: [(f64, f64); 4] = [(759.0, 0.0), (760.0, 3.0), (770.0, 0.21), (771.0, 0.0)];
/// of water vapour, cm⁻¹,
#[rustfmt::skip]
const WATER_VAPOUR: [(f64, f64); 13] = [
    (689.0, 0.0), (690.0, 0.016), (700.0, 0.024), (710.0, 0.0125), (720.0, 1.0), (730.0, 0.87), (740.0, 0.061),
    (750.0, 0.001), (760.0, 1e-5), (770.0, 1e-5), (780.0, 0.0006), (790.0, 0.0175), (800.0, 0.036),
];
/// and the sun's radiance outside of the atmosphere, W·m⁻²·sr⁻¹·nm⁻¹.
#[rustfmt::skip]
const SUN: [(f64, f64); 38] = [
    (380.0, 16559.0), (390.0, 16233.7), (400.0, 21127.5), (410.0, 25888.2), (420.0, 25829.1), (430.0, 24232.3),
    (440.0, 26760.5), (450.0, 29658.3), (460.0, 30545.4), (470.0, 30057.5), (480.0, 30663.7), (490.0, 28830.4),
    (500.0, 28712.1), (510.0, 27825.0), (520.0, 27100.6), (530.0, 27233.6), (540.0, 26361.3), (550.0, 25503.8),
    (560.0, 25060.2), (570.0, 25311.6), (580.0, 25355.9), (590.0, 25134.2), (600.0, 24631.5), (610.0, 24173.2),
    (620.0, 23685.3), (630.0, 23212.1), (640.0, 22827.7), (650.0, 22339.8), (660.0, 21970.2), (670.0, 21526.7),
    (680.0, 21097.9), (690.0, 20728.3), (700.0, 20240.4), (710.0, 19870.8), (720.0, 19427.2), (730.0, 19072.4),
    (740.0, 18628.9), (750.0, 18259.2),
];
