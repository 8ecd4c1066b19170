//! Textures, spectra, and parameters that may be either.

use super::Loader;
use super::props::Props;
use super::xml::{Asked, Pos, Property, Tree, Value, tokens};
use crate::Result;
use crate::image_io::{self, Domain, Encoding};
use crate::math::{Rgb, first_index};
use crate::scene::pending::Pending;
use crate::scene::spectrum::{Role, Spectrum};
use crate::shape::Shape;
use crate::texture::{Bitmap, Color, Interpolation, Scalar, Texture, Wrap};
use glam::{Affine2, Vec2};
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

/// How a texture object is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Use {
    Color,
    Scalar,
}

/// What the texels of a texture are checked for, besides their domain.
pub(super) struct TexelCheck {
    /// They are multiplied with it.
    scale: f32,
    /// Where the texture stands.
    pos: Pos,
}

/// Checks all values that textures give, once their files are read.
pub(super) struct Checks<'a> {
    pub tree: &'a Tree,
    pub textures: &'a [Texture],
    pub texture_of: &'a HashMap<(usize, Use), u32>,
    pub files: &'a HashMap<u32, PathBuf>,
    pub checks: &'a BTreeMap<(u32, Domain), TexelCheck>,
}

impl Checks<'_> {
    /// Checks the texels of bitmaps, and of what scales them.
    pub(super) fn bitmaps(&self) -> Result<()> {
        for ((index, domain), check) in self.checks {
            let (mut index, mut scale) = (*index, Rgb::splat(check.scale));
            while let Texture::Scaled { texture, scale: factor } = &self.textures[index as usize] {
                scale *= *factor;
                index = *texture;
            }
            if let Texture::Bitmap(bitmap) = &self.textures[index as usize] {
                bitmap.contents().0.check(*domain, scale).map_err(|message| {
                    let file = self.files.get(&index).map(|f| f.display().to_string()).unwrap_or_default();
                    self.tree.error(check.pos, format!("{file}: {message}"))
                })?;
            }
        }
        Ok(())
    }

    /// Checks that a shape has the attributes that it is `asked` for, and their values.
    pub(super) fn attributes(&self, shape: &Shape, props: Props, asked: &[Asked]) -> Result<()> {
        for Asked { name, object } in asked {
            let pos = self.tree.objects[*object].pos;
            let line = || format!("{}:{}", self.tree.file(props.object.pos).display(), props.object.pos.line);
            let attribute = match shape {
                Shape::Mesh(mesh) => mesh.attribute(name),
                _ => None,
            };
            let Some(attribute) = attribute else {
                let message = format!("the shape at {} has no mesh attribute '{name}'", line());
                return Err(self.tree.error(pos, message));
            };
            for usage in [Use::Color, Use::Scalar] {
                let Some(texture) = self.texture_of.get(&(*object, usage)) else { continue };
                let Texture::Attribute { scale, .. } = &self.textures[*texture as usize] else { continue };
                for ((_, domain), _) in
                    self.checks.range((*texture, Domain::Finite)..=(*texture, Domain::NonNegative))
                {
                    let Some(i) = first_index(&attribute.values, |v| !domain.contains(*v * *scale)) else {
                        continue;
                    };
                    let times = if *scale == Rgb::ONE { String::new() } else { format!(" times {scale}") };
                    let of = if attribute.of_vertices() { "vertex" } else { "face" };
                    let (value, line) = (attribute.values[i], line());
                    let file = props.opt_string("filename")?.unwrap_or("the mesh");
                    let message = format!(
                        "{file}: the '{name}' of {of} {i} is {value}{times}, but must be {domain}: change it in \
                         that file (of the shape at {line})"
                    );
                    return Err(self.tree.error(pos, message));
                }
            }
        }
        Ok(())
    }
}

impl<'a> Loader<'a> {
    /// A colour parameter. Floats and integers mean grey.
    pub(super) fn color(
        &mut self,
        props: Props<'a>,
        name: &'static str,
        role: Role,
        default: Rgb,
    ) -> Result<Color> {
        match props.get(name) {
            Some(property) => self.color_of(props, property, role),
            None => Ok(Color::Constant(default)),
        }
    }

    /// The colour that a property gives.
    pub(super) fn color_of(&mut self, props: Props<'a>, property: &Property, role: Role) -> Result<Color> {
        if let Some(index) = props.object_of(property)? {
            let object = Props::new(self.tree, index);
            return self.nested(object, |loader| loader.texture(object, property, role, Use::Color));
        }
        match self.constant(property, role, props.object.old)? {
            Some(rgb) => Ok(Color::Constant(rgb)),
            None => Err(self.not_a_color(props, property)),
        }
    }

    /// A colour parameter that cannot be textured.
    pub(super) fn constant_color(
        &mut self,
        props: Props<'a>,
        name: &'static str,
        role: Role,
        default: Rgb,
    ) -> Result<Rgb> {
        match self.color(props, name, role, default)? {
            Color::Constant(rgb) => Ok(rgb),
            Color::Texture(_) => Err(props.error_at(name, format!("'{name}' cannot be a texture"))),
        }
    }

    /// A number that may be textured.
    pub(super) fn scalar(&mut self, props: Props<'a>, name: &'static str, default: f32) -> Result<Scalar> {
        match props.get(name) {
            Some(property) => self.scalar_of(props, property),
            None => Ok(Scalar::Constant(default)),
        }
    }

    /// The number that a property gives.
    pub(super) fn scalar_of(&mut self, props: Props<'a>, property: &Property) -> Result<Scalar> {
        if let Some(index) = props.object_of(property)? {
            let object = Props::new(self.tree, index);
            let color =
                self.nested(object, |loader| loader.texture(object, property, Role::Unbounded, Use::Scalar))?;
            return Ok(match color {
                Color::Constant(rgb) => Scalar::Constant(crate::math::luminance(rgb)),
                Color::Texture(index) => Scalar::Texture(index),
            });
        }
        match self.constant(property, Role::Unbounded, props.object.old)? {
            Some(rgb) => Ok(Scalar::Constant(crate::math::luminance(rgb))),
            None => Err(self.not_a_color(props, property)),
        }
    }

    fn not_a_color(&self, props: Props, property: &Property) -> crate::Error {
        let Property { name, value, pos, .. } = property;
        let message = format!(
            "{}: parameter '{name}' should be a colour, a spectrum, a number or a texture, not {}",
            props.title(),
            value.kind()
        );
        self.tree.error(*pos, message)
    }

    /// The colour of a property that is no object; `None` if it is no colour at all.
    fn constant(&mut self, property: &Property, role: Role, old: bool) -> Result<Option<Rgb>> {
        let rgb = match &property.value {
            Value::Float(v) => Rgb::splat(*v as f32),
            Value::Integer(v) => Rgb::splat(*v as f32),
            Value::Rgb(v) => {
                let inside = v.min_element() >= 0.0 && v.max_element() <= 1.0;
                if role == Role::Reflectance && !inside {
                    let message = format!("the reflectance '{}' is {v}, outside of 0..1", property.name);
                    if !(old && v.min_element() >= 0.0) {
                        return Err(self.tree.error(property.pos, message));
                    }
                    // As in Mitsuba 0.6, which keeps the hue.
                    self.warn_at(property.pos, &format!("{message}: scaled down"));
                    (*v / v.max_element()).as_vec3()
                } else {
                    v.as_vec3()
                }
            }
            Value::Spectrum(spectrum) => self.spectrum(property, spectrum, role),
            _ => return Ok(None),
        };
        if !rgb.is_finite() {
            return Err(self.tree.error(property.pos, format!("'{}' is out of range", property.name)));
        }
        if rgb.min_element() < 0.0 {
            return Err(self.tree.error(property.pos, format!("'{}' is negative", property.name)));
        }
        Ok(Some(rgb))
    }

    fn spectrum(&mut self, property: &Property, spectrum: &Spectrum, role: Role) -> Rgb {
        let (rgb, clamped) = spectrum.to_rgb(role);
        if clamped {
            let message =
                format!("the spectrum '{}' is outside of the sRGB gamut: clamped to {rgb}", property.name);
            self.warn_at(property.pos, &message);
        }
        rgb
    }

    /// Has the texels of a texture checked once they are read: times `scale` they must be in the `domain`.
    pub(super) fn check_texels(&mut self, color: Color, domain: Domain, scale: f32, pos: Pos) {
        let Color::Texture(index) = color else { return };
        // Nothing smaller than the texels themselves, which other uses may take as they are.
        let check = self.texel_checks.entry((index, domain)).or_insert(TexelCheck { scale: 1.0, pos });
        check.scale = check.scale.max(scale);
    }

    /// A texture object, or a spectrum object, which is a constant.
    fn texture(&mut self, props: Props<'a>, asker: &Property, role: Role, usage: Use) -> Result<Color> {
        let color = self.unchecked_texture(props, asker, role, usage)?;
        let domain = match (usage, role) {
            (Use::Color, Role::Reflectance | Role::Emission) => Domain::NonNegative,
            (Use::Color, Role::Unbounded) | (Use::Scalar, _) => Domain::Finite,
        };
        match color {
            Color::Constant(rgb) if !domain.contains(rgb) => {
                let message = format!("'{}' is {rgb}, but must be {domain}", asker.name);
                Err(self.tree.error(props.object.pos, message))
            }
            _ => {
                self.check_texels(color, domain, 1.0, props.object.pos);
                Ok(color)
            }
        }
    }

    fn unchecked_texture(
        &mut self,
        props: Props<'a>,
        asker: &Property,
        role: Role,
        usage: Use,
    ) -> Result<Color> {
        if props.object.tag != "texture" {
            let message = format!("'{}' should be a texture, not a <{}>", asker.name, props.object.tag);
            return Err(self.tree.error(asker.pos, message));
        }
        if let Some(index) = self.texture_of.get(&(props.index, usage)) {
            return Ok(Color::Texture(*index));
        }
        let texture = match props.plugin() {
            "bitmap" => self.bitmap(props, false)?,
            "checkerboard" => Pending::Ready(self.checkerboard(props, role, usage)?),
            "mesh_attribute" => Pending::Ready(self.attribute(props)?),
            "vertexcolors" if props.object.old => {
                Pending::Ready(Texture::Attribute { name: "vertex_color".into(), scale: Rgb::ONE })
            }
            "gridtexture" if props.object.old => Pending::Ready(self.grid(props, role)?),
            "scale" if props.object.old => return self.scaled(props, role, usage),
            _ => return self.spectrum_object(props, asker, role).map(Color::Constant),
        };
        props.finish()?;
        let index = self.textures.len() as u32;
        self.textures.push(texture);
        self.texture_of.insert((props.index, usage), index);
        Ok(Color::Texture(index))
    }

    /// The texture of what names an image itself, which holds numbers and no colours.
    pub(super) fn own_bitmap(&mut self, props: Props<'a>) -> Result<u32> {
        let texture = self.bitmap(props, true)?;
        self.textures.push(texture);
        Ok(self.textures.len() as u32 - 1)
    }

    /// An image as a texture; `raw` says whether it holds linear values unless told otherwise.
    fn bitmap(&mut self, props: Props<'a>, raw: bool) -> Result<Pending<Texture>> {
        let to_uv = to_uv(props)?;
        let raw = props.boolean("raw", raw)?;
        let filters: &[_] = &[
            ("bilinear", Interpolation::Bilinear),
            ("nearest", Interpolation::Nearest),
            // Mitsuba 0.6. Many samples per pixel filter as well.
            ("ewa", Interpolation::Bilinear),
            ("trilinear", Interpolation::Bilinear),
        ];
        let known = if props.object.old { filters } else { &filters[..2] };
        let interpolation = props.choice("filter_type", Interpolation::Bilinear, known)?;
        let wraps = [("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];
        let mut wrap = [props.choice("wrap_mode", Wrap::Repeat, &wraps)?; 2];
        if props.object.old {
            let [u, v] = wrap;
            wrap = [props.choice("wrap_mode_u", u, &wraps)?, props.choice("wrap_mode_v", v, &wraps)?];
        }
        // Storage formats of Mitsuba.
        props.opt_string("format")?;
        props.boolean("accel", true)?;
        let path = self.filename(props)?;
        self.bitmap_files.insert(self.textures.len() as u32, path.clone());
        let encoding = match gamma(props)? {
            Some(gamma) => Encoding::Gamma(gamma),
            None if raw => Encoding::Linear,
            None => Encoding::Srgb,
        };
        let channel = if props.object.old { channel(props)? } else { None };
        Ok(Pending::file(self.next_file(), move || {
            let mut image = image_io::read_encoded(&path, encoding)?;
            if let Some(channel) = channel {
                image.pixels.iter_mut().for_each(|p| *p = Rgb::splat(p[channel]));
            }
            let bitmap = Bitmap::new(image, interpolation, wrap, to_uv);
            bitmap.map(Texture::Bitmap).map_err(|message| crate::Error::File { file: path, message })
        }))
    }

    fn checkerboard(&mut self, props: Props<'a>, role: Role, usage: Use) -> Result<Texture> {
        let mut color = |name, default| self.color(props, name, role, Rgb::splat(default));
        let (mut color0, mut color1) = (color("color0", 0.4)?, color("color1", 0.2)?);
        if usage == Use::Scalar {
            // Mitsuba 3 (to 3.9 at least) swaps the squares where it reads a checkerboard as a number.
            std::mem::swap(&mut color0, &mut color1);
        }
        Ok(Texture::Checkerboard { color0, color1, to_uv: to_uv(props)? })
    }

    fn attribute(&mut self, props: Props<'a>) -> Result<Texture> {
        let name = props.opt_string("name")?.ok_or_else(|| props.error("a mesh_attribute needs a 'name'"))?;
        if !["vertex_", "face_"].iter().any(|of| name.starts_with(of)) {
            let message = format!("the name '{name}' of a mesh attribute should begin with vertex_ or face_");
            return Err(props.error_at("name", message));
        }
        let scale = Rgb::splat(props.float("scale", 1.0)?);
        Ok(Texture::Attribute { name: name.into(), scale })
    }

    fn grid(&mut self, props: Props<'a>, role: Role) -> Result<Texture> {
        let color0 = self.color(props, "color0", role, Rgb::splat(0.2))?;
        let color1 = self.color(props, "color1", role, Rgb::splat(0.4))?;
        let line_width = props.float("line_width", 0.01)?;
        Ok(Texture::Grid { color0, color1, line_width, to_uv: to_uv(props)? })
    }

    /// Mitsuba 0.6's product of a texture and a colour.
    fn scaled(&mut self, props: Props<'a>, role: Role, usage: Use) -> Result<Color> {
        let scale = self.constant_color(props, "scale", Role::Unbounded, Rgb::ONE)?;
        let Some(value) = props
            .unused()
            .find(|p| p.name == "value" || matches!(p.value, Value::Object(_) | Value::Reference(_)))
        else {
            return Err(props.error("a scale texture needs a 'value' or a texture inside"));
        };
        value.used.set(true);
        let color = match usage {
            Use::Color => self.color_of(props, value, role)?,
            Use::Scalar => match self.scalar_of(props, value)? {
                Scalar::Constant(v) => Color::Constant(Rgb::splat(v)),
                Scalar::Texture(index) => Color::Texture(index),
            },
        };
        props.finish()?;
        Ok(match color {
            Color::Constant(rgb) => Color::Constant(rgb * scale),
            Color::Texture(texture) => {
                let index = self.textures.len() as u32;
                self.textures.push(Pending::Ready(Texture::Scaled { texture, scale }));
                self.texture_of.insert((props.index, usage), index);
                Color::Texture(index)
            }
        })
    }

    /// `d65`, `blackbody` and the other spectrum plugins.
    fn spectrum_object(&mut self, props: Props<'a>, asker: &Property, role: Role) -> Result<Rgb> {
        let fail = |message: String| props.error(message);
        let list = |name: &'static str| -> Result<Vec<f64>> {
            let text = props.opt_string(name)?.ok_or_else(|| props.error(format!("'{name}' is missing")))?;
            let number = |t: &str| t.parse::<f64>().ok().filter(|v| v.is_finite());
            let numbers = tokens(text).map(number).collect::<Option<Vec<_>>>();
            numbers.ok_or_else(|| props.error_at(name, format!("'{name}' should be a list of numbers")))
        };
        let need = |name: &'static str| -> Result<f64> {
            let value = props.opt_float(name)?;
            value.map(|v| v as f64).ok_or_else(|| props.error(format!("'{name}' is missing")))
        };
        // Cuts off what lies outside of the visible range anyway.
        let wavelength_range = || props.opt_float("wavelength_min").and(props.opt_float("wavelength_max"));
        let spectrum = match props.plugin() {
            // In RGB the illuminant is the white point.
            "d65" => {
                let scale = props.float("scale", 1.0)?;
                let color = self.constant_color(props, "color", Role::Unbounded, Rgb::ONE)?;
                let mut nested = Rgb::ONE;
                for property in props.unused() {
                    let Some(index) = props.object_of(property)? else { continue };
                    property.used.set(true);
                    let inner = Props::new(self.tree, index);
                    let color =
                        self.nested(inner, |l| l.texture(inner, property, Role::Unbounded, Use::Color))?;
                    match color {
                        Color::Constant(rgb) => nested = rgb,
                        Color::Texture(_) => {
                            return Err(fail("a d65 spectrum with a texture inside is not supported".into()));
                        }
                    }
                }
                props.finish()?;
                return Ok(scale * color * nested);
            }
            "rawconstant" => {
                let Some(value) = props.get("value") else { return Err(fail("'value' is missing".into())) };
                let rgb = match value.value {
                    Value::Vector(v) => Value::Rgb(v),
                    ref other => other.clone(),
                };
                let value = Property { value: rgb, ..value.clone() };
                let color = self.constant(&value, role, props.object.old)?;
                props.finish()?;
                return color.ok_or_else(|| self.not_a_color(props, &value));
            }
            "uniform" => {
                let value = need("value")?;
                wavelength_range()?;
                props.finish()?;
                return Ok(Rgb::splat(value as f32));
            }
            "srgb" => {
                props.boolean("unbounded", false)?;
                let rgb = self.constant_color(props, "color", role, Rgb::ONE)?;
                props.finish()?;
                return Ok(rgb);
            }
            "blackbody" => {
                let (kelvin, scale) = (need("temperature")?, props.float("scale", 1.0)?);
                wavelength_range()?;
                Spectrum::blackbody(kelvin, scale as f64)
            }
            "regular" | "irregular" if props.has("value") => match &props.get("value").map(|p| &p.value) {
                Some(Value::Spectrum(spectrum)) => Ok(spectrum.clone()),
                _ => Err("'value' should be a spectrum".into()),
            },
            "regular" => {
                let (values, from, to) = (list("values")?, need("wavelength_min")?, need("wavelength_max")?);
                let step = (to - from) / (values.len().max(2) - 1) as f64;
                Spectrum::samples(
                    values.iter().enumerate().map(|(i, v)| (from + step * i as f64, *v)).collect(),
                )
            }
            "irregular" => {
                let (wavelengths, values) = (list("wavelengths")?, list("values")?);
                if wavelengths.len() != values.len() {
                    return Err(fail(format!(
                        "{} wavelengths have {} values",
                        wavelengths.len(),
                        values.len()
                    )));
                }
                Spectrum::samples(wavelengths.into_iter().zip(values).collect())
            }
            _ => {
                return Err(props.unknown_plugin(
                    "bitmap, checkerboard, mesh_attribute; d65, blackbody, uniform, rawconstant, regular, irregular, srgb",
                ));
            }
        };
        let spectrum = spectrum.map_err(fail)?;
        props.finish()?;
        Ok(self.spectrum(asker, &spectrum, role))
    }

    /// The file that the parameter `filename` names.
    pub(super) fn filename(&self, props: Props) -> Result<std::path::PathBuf> {
        match props.opt_string("filename")? {
            // Nothing is read if anything is missing.
            Some(name) => Ok(self.tree.resolve(name, props.pos("filename")).unwrap_or_default()),
            None => Err(props.error(format!("{} lacks the parameter 'filename'", props.title()))),
        }
    }
}

/// Mitsuba 0.6's exponent of an image's encoding: −1 stands for sRGB; `None` leaves it to the file.
pub(super) fn gamma(props: Props) -> Result<Option<f32>> {
    match if props.object.old { props.float("gamma", 0.0)? } else { 0.0 } {
        0.0 | -1.0 => Ok(None),
        gamma if gamma > 0.0 && gamma.is_finite() => Ok(Some(gamma)),
        gamma => {
            Err(props.error_at("gamma", format!("'gamma' is {gamma}, but must be positive, or -1 for sRGB")))
        }
    }
}

/// The channel of an image that a texture of Mitsuba 0.6 consists of, if it is one alone.
fn channel(props: Props) -> Result<Option<usize>> {
    match props.opt_string("channel")?.map(str::to_lowercase).as_deref() {
        None | Some("") => Ok(None),
        Some("r") => Ok(Some(0)),
        Some("g") => Ok(Some(1)),
        Some("b") => Ok(Some(2)),
        Some(other) => {
            Err(props.error_at("channel", format!("'channel' is '{other}', but must be r, g or b")))
        }
    }
}

/// The transform of texture coordinates: x and y of a 3D transform, as in Mitsuba (which therefore ignores the third
/// column of a 3×3 `<matrix>`).
fn to_uv(props: Props) -> Result<Affine2> {
    if props.object.old {
        let (both, offset) = (props.float("uv_scale", 1.0)?, |name| props.float(name, 0.0));
        let scale = Vec2::new(props.float("u_scale", both)?, props.float("v_scale", both)?);
        let offset = Vec2::new(offset("uoffset")?, offset("voffset")?);
        return Ok(Affine2::from_scale_angle_translation(scale, 0.0, offset));
    }
    let m = props.matrix("to_uv")?;
    let column = |i: usize| m.col(i).as_vec4();
    let affine = |x: glam::Vec4, y: glam::Vec4, t: glam::Vec4| {
        Affine2::from_cols(Vec2::new(x.x, x.y), Vec2::new(y.x, y.y), Vec2::new(t.x, t.y))
    };
    let to_uv = affine(column(0), column(1), column(3));
    if !to_uv.is_finite() {
        return Err(props.error_at("to_uv", "'to_uv' is out of range"));
    }
    Ok(to_uv)
}
