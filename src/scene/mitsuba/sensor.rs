//! Sensor, film, filter and sampler.

use super::Loader;
use super::props::{Props, to_f32};
use crate::Result;
use crate::camera::{Camera, Projection};
use crate::film::{FilmSettings, Filter};
use glam::Vec2;

/// The view.
pub(super) struct Sensor {
    pub camera: Camera,
    pub film: FilmSettings,
    pub sample_count: u32,
}

#[derive(Clone, Copy, PartialEq)]
enum Axis {
    X,
    Y,
    Diagonal,
    Smaller,
    Larger,
}

impl<'a> Loader<'a> {
    pub(super) fn sensor(&mut self, props: Props<'a>, size: Option<(u32, u32)>) -> Result<Sensor> {
        let (projection, thin_lens) = match props.plugin() {
            "perspective" => (Projection::Perspective, false),
            "thinlens" => (Projection::Perspective, true),
            "orthographic" => (Projection::Orthographic, false),
            _ => return Err(props.unknown_plugin("perspective, thinlens, orthographic")),
        };
        let perspective = projection == Projection::Perspective;
        let (mut film, mut sample_count) = (None, DEFAULT_SAMPLES);
        for (child, pos) in props.children()? {
            match child.object.tag.as_str() {
                "film" => film = Some(self.film(child, size)?),
                "sampler" => sample_count = self.sampler(child)?,
                _ => return Err(child.misplaced("sensor", pos)),
            }
        }
        let film = film.unwrap_or_else(|| default_film(size));
        let aspect = film.size.0 as f32 / film.size.1 as f32;
        let to_world = props.to_world()?;
        let axes = [to_world.matrix3.x_axis, to_world.matrix3.y_axis, to_world.matrix3.z_axis];
        if perspective && axes.iter().any(|a| (a.length() - 1.0).abs() > 1e-3) {
            return Err(props.error_at("to_world", "the transform of a sensor must not scale"));
        }
        let near = props.opt_float("near_clip")?;
        let far = props.opt_float("far_clip")?;
        let clip = (near.unwrap_or(0.0), far.unwrap_or(f32::INFINITY));
        if clip.0 >= clip.1 || near.is_some_and(|n| n <= 0.0) {
            let message =
                format!("'near_clip' {} must be positive and less than 'far_clip' {}", clip.0, clip.1);
            return Err(props.error_at("near_clip", message));
        }
        // Mitsuba's default is its far plane.
        let focus_distance = props.float("focus_distance", far.unwrap_or(1e4))?;
        let aperture_radius = if thin_lens {
            let radius = props.opt_float("aperture_radius")?;
            radius.ok_or_else(|| props.error("a thinlens sensor needs an 'aperture_radius'"))?
        } else {
            0.0
        };
        if !(aperture_radius >= 0.0 && focus_distance > 0.0) {
            return Err(props.error("'aperture_radius' must not be negative, and 'focus_distance' positive"));
        }
        let offset = |name| props.float(name, 0.0);
        let (half_width, principal_offset) = match projection {
            Projection::Perspective => (
                half_width(props, aspect)?,
                Vec2::new(offset("principal_point_offset_x")?, offset("principal_point_offset_y")?),
            ),
            Projection::Orthographic => (1.0, Vec2::ZERO),
        };
        let (open, close) = (props.float("shutter_open", 0.0)?, props.float("shutter_close", 0.0)?);
        if open != close {
            self.warn_at(props.pos("shutter_close"), "nothing moves: the shutter's times have no effect");
        }
        props.finish()?;
        let camera = Camera {
            to_world: to_f32(to_world),
            projection,
            half_width,
            aspect,
            principal_offset,
            clip,
            aperture_radius,
            focus_distance,
        };
        Ok(Sensor { camera, film, sample_count })
    }

    fn film(&mut self, props: Props<'a>, size: Option<(u32, u32)>) -> Result<FilmSettings> {
        if props.plugin() != "hdrfilm" {
            self.warn_at(props.object.pos, &props.instead("read as 'hdrfilm'", &FILMS));
        }
        let sides = 1..=super::MAX_SIDE;
        let width = props.count("width", DEFAULT_SIZE.0, sides.clone())?;
        let height = props.count("height", DEFAULT_SIZE.1, sides.clone())?;
        let x = props.count("crop_offset_x", 0, 0..=super::MAX_SIDE)?;
        let y = props.count("crop_offset_y", 0, 0..=super::MAX_SIDE)?;
        let crop_width = props.count("crop_width", width, sides.clone())?;
        let crop_height = props.count("crop_height", height, sides)?;
        if x + crop_width > width || y + crop_height > height {
            return Err(props.error(format!(
                "the crop window of {crop_width}x{crop_height} pixels at {x},{y} leaves the film of {width}x{height}"
            )));
        }
        // What the command line decides, and what only Mitsuba's own film needs.
        for name in ["file_format", "pixel_format", "component_format"] {
            props.opt_string(name)?;
        }
        if props.object.old {
            props.boolean("attach_log", false)?;
        }
        for name in ["sample_border", "banner", "compensate", "high_quality_edges"] {
            props.boolean(name, false)?;
        }
        let mut filter = DEFAULT_FILTER;
        for (child, pos) in props.children()? {
            match child.object.tag.as_str() {
                "rfilter" => filter = self.filter(child)?,
                tag => {
                    self.tree.warn_once(pos, &format!("{}: a <{tag}> inside has no effect", props.title()))
                }
            }
        }
        props.finish()?;
        Ok(match size {
            Some(size) => FilmSettings { size, crop: (0, 0, size.0, size.1), filter },
            None => FilmSettings { size: (width, height), crop: (x, y, crop_width, crop_height), filter },
        })
    }

    fn filter(&mut self, props: Props<'a>) -> Result<Filter> {
        let positive = |name: &'static str, default| -> Result<f32> {
            let value = props.float(name, default)?;
            if value > 0.0 && value < 1000.0 {
                return Ok(value);
            }
            Err(props.error_at(name, format!("'{name}' is {value}, but must be a positive number of pixels")))
        };
        let filter = match props.plugin() {
            "box" => Filter::Box,
            "tent" => Filter::Tent { radius: positive("radius", 1.0)? },
            "gaussian" => Filter::Gaussian { stddev: positive("stddev", 0.5)? },
            name @ ("mitchell" | "catmullrom" | "lanczos") => {
                let message =
                    format!("filter '{name}' has negative lobes: the default gaussian is used instead");
                self.warn_at(props.object.pos, &message);
                return Ok(DEFAULT_FILTER);
            }
            _ => {
                self.warn_at(props.object.pos, &props.instead("the default gaussian is used", &FILTERS));
                return Ok(DEFAULT_FILTER);
            }
        };
        props.finish()?;
        Ok(filter)
    }

    /// Any sampler will do: only the number of samples matters.
    fn sampler(&mut self, props: Props<'a>) -> Result<u32> {
        if !SAMPLERS.contains(&props.plugin()) {
            self.warn_at(props.object.pos, &props.instead("only its number of samples counts", &SAMPLERS));
        }
        let count = props.count("sample_count", DEFAULT_SAMPLES, 1..=u32::MAX)?;
        for name in ["seed", "jitter", "strength"] {
            props.get(name);
        }
        for property in props.unused() {
            self.tree.note_unknown(&props.title(), property, &props.object.asked.borrow());
        }
        Ok(count)
    }
}

/// The film of a sensor that has none.
pub(super) fn default_film(size: Option<(u32, u32)>) -> FilmSettings {
    let (width, height) = size.unwrap_or(DEFAULT_SIZE);
    FilmSettings { size: (width, height), crop: (0, 0, width, height), filter: DEFAULT_FILTER }
}

/// Samples per pixel of a sensor without a sampler.
pub(super) const DEFAULT_SAMPLES: u32 = 4;

const DEFAULT_FILTER: Filter = Filter::Gaussian { stddev: 0.5 };

const FILMS: [&str; 2] = ["hdrfilm", "specfilm"];
const FILTERS: [&str; 6] = ["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"];

#[rustfmt::skip]
const SAMPLERS: [&str; 8] = [
    "independent", "stratified", "multijitter", "orthogonal", "ldsampler", "halton", "hammersley", "sobol",
];

/// Width and height of Mitsuba's film.
const DEFAULT_SIZE: (u32, u32) = (768, 576);

/// tan(fov_x / 2), which `fov`, `fov_axis` or `focal_length` tell.
pub(super) fn half_width(props: Props, aspect: f32) -> Result<f32> {
    let aspect = aspect as f64;
    let half_tan = |degrees: f64| (0.5 * degrees.to_radians()).tan();
    let from_diagonal = |half: f64| half / (1.0 + 1.0 / (aspect * aspect)).sqrt();
    let choices = [
        ("x", Axis::X),
        ("y", Axis::Y),
        ("diagonal", Axis::Diagonal),
        ("smaller", Axis::Smaller),
        ("larger", Axis::Larger),
    ];
    let axis = props.choice("fov_axis", Axis::X, &choices)?;
    let half_width = match props.opt_float("fov")? {
        Some(_) if props.has("focal_length") => {
            return Err(props.error_at("focal_length", "give either 'fov' or 'focal_length', not both"));
        }
        Some(fov) if !(fov > 0.0 && fov < 180.0) => {
            return Err(
                props.error_at("fov", format!("'fov' is {fov}, but must lie between 0 and 180 degrees"))
            );
        }
        Some(fov) => {
            let half = half_tan(fov as f64);
            match axis {
                Axis::Diagonal => from_diagonal(half),
                Axis::Y => half * aspect,
                Axis::Smaller if aspect > 1.0 => half * aspect,
                Axis::Larger if aspect <= 1.0 => half * aspect,
                Axis::X | Axis::Smaller | Axis::Larger => half,
            }
        }
        None => {
            let text = props.opt_string("focal_length")?.unwrap_or("50mm").trim();
            let length = text.strip_suffix("mm").unwrap_or(text).trim().parse::<f64>().ok();
            let Some(length) = length.filter(|l| *l > 0.0 && l.is_finite()) else {
                let message = format!("'focal_length' is '{text}', but should be like 50mm");
                return Err(props.error_at("focal_length", message));
            };
            // The diagonal of a 35 mm negative: 36 mm × 24 mm.
            from_diagonal(36f64.hypot(24.0) / (2.0 * length))
        }
    };
    Ok(half_width as f32)
}
