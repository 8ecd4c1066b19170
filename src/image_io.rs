//! Reading and writing images: OpenEXR and PNG, and the safe replacement of files that all outputs go through.
//!
//! A picture is what the EXR *data window* holds; display windows are ignored, as Mitsuba does.

use crate::math::Rgb;
use crate::{Error, Result};
use exr::prelude as ex;
use rayon::prelude::*;
use std::fs::{self, File};
use std::io::{self, BufRead, BufWriter, Cursor, Read, Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Linear RGB pixels, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub pixels: Vec<Rgb>,
}

/// A named layer of an EXR file. The unnamed first layer ("") is the picture.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Layer name, e.g. `albedo`; channels become `albedo.R` and so on.
    pub name: String,
    /// Its pixels.
    pub image: Image,
    /// What its channels are called.
    pub channels: Channels,
}

/// The channels of a layer, named as other programs expect: tev groups by the name before the dot, Blender takes
/// the one letter behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// A colour: `R`, `G`, `B`.
    Rgb,
    /// A direction: `X`, `Y`, `Z`.
    Xyz,
    /// A distance, the first channel of the image: `Z`.
    Z,
    /// One number, the first channel of the image: `Y`.
    Y,
}

impl Channels {
    fn letters(self) -> &'static [&'static str] {
        match self {
            Channels::Rgb => &["R", "G", "B"],
            Channels::Xyz => &["X", "Y", "Z"],
            Channels::Z => &["Z"],
            Channels::Y => &["Y"],
        }
    }
}

impl Image {
    /// The image with every pixel mapped.
    pub fn map(&self, f: impl Fn(Rgb) -> Rgb) -> Image {
        Image { width: self.width, height: self.height, pixels: self.pixels.iter().map(|&p| f(p)).collect() }
    }
}

/// What goes into an EXR file besides pixels.
#[derive(Clone, Debug, Default)]
pub struct Metadata {
    /// (key, value) text attributes: seed, passes, command. Keys are no standard attributes of OpenEXR's other than
    /// `software`, `comments` and `owner`.
    pub attributes: Vec<(String, String)>,
}

/// Sample format of an EXR file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// 16 bits. Larger values than 65504 are stored as 65504.
    Half,
    /// 32 bits.
    Float,
}

/// Images with more pixels are refused before memory is asked for.
pub const MAX_PIXELS: u64 = 1 << 28;

/// The linear value of an sRGB-encoded one, both in [0, 1] (IEC 61966-2-1).
pub fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB encoding of a linear value, both in [0, 1] (IEC 61966-2-1).
pub fn linear_to_srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// Reads an image of any supported format (OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR) as linear RGB. 8- and 16-bit
/// formats are taken as sRGB-encoded. Of an EXR file it takes the first part with channels R, G, B, else the first
/// with Y, else the first layer with `name.R`, `name.G`, `name.B`. Alpha is dropped.
///
/// # Errors
/// [`Error::File`] if it is missing, damaged, larger than [`MAX_PIXELS`] or of an unknown format.
pub fn read(path: &Path) -> Result<Image> {
    read_encoded(path, Encoding::Srgb)
}

/// What the integers of an image file stand for. Floating-point values are linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    /// Light, encoded by the sRGB curve.
    Srgb,
    /// Numbers, scaled to [0, 1].
    Linear,
    /// Light, encoded with this exponent.
    Gamma(f32),
}

impl Encoding {
    fn decode(self, x: f32) -> f32 {
        match self {
            Encoding::Srgb => srgb_to_linear(x),
            Encoding::Linear => x,
            Encoding::Gamma(gamma) => x.powf(gamma),
        }
    }
}

/// Like [`read`], but 8- and 16-bit values are decoded only if `srgb` is set, and else just scaled to [0, 1]:
/// roughness maps and normal maps are no colours.
///
/// # Errors
/// As [`read`].
pub fn read_encoded(path: &Path, encoding: Encoding) -> Result<Image> {
    let fail = |message: String| Error::File { file: path.into(), message };
    let mut magic = [0; 4];
    let mut file = File::open(path).map_err(|e| fail(format!("cannot open the image: {}", reason(&e))))?;
    let exr = match file.read_exact(&mut magic) {
        Ok(()) => magic == [0x76, 0x2f, 0x31, 0x01],
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => false,
        Err(e) => return Err(fail(format!("cannot read the image: {}", reason(&e)))),
    };
    // Decoders promise errors, not panics, but files from anywhere have broken such promises before.
    catch_unwind(AssertUnwindSafe(|| if exr { read_exr(path) } else { read_other(path, encoding) }))
        .unwrap_or_else(|_| Err("its contents crash the decoder".into()))
        .map_err(|message| fail(format!("cannot read the image: {message}")))
}

fn reason(e: &io::Error) -> String {
    match e.kind() {
        io::ErrorKind::NotFound => "no such file or directory".into(),
        io::ErrorKind::PermissionDenied => "permission denied".into(),
        _ => e.to_string(),
    }
}

/// Most pixels that a byte of a file can hold: 8 to a byte, of which DEFLATE packs at most 1032 into one.
const MAX_PIXELS_PER_BYTE: u64 = 8 * 1032;

/// A few bytes of header must not claim gigabytes.
fn check_size(bytes: u64, width: u64, height: u64) -> std::result::Result<(), String> {
    match width.checked_mul(height) {
        Some(0) => Err("it has no pixels".into()),
        Some(n) if n > MAX_PIXELS_PER_BYTE.saturating_mul(bytes) => {
            Err(format!("the file is too short for {width}x{height} pixels"))
        }
        Some(n) if n <= MAX_PIXELS => Ok(()),
        _ => Err(format!("{width}x{height} pixels are too many (at most {MAX_PIXELS})")),
    }
}

/// The names of the channels that make the picture: one (grey) or three.
fn picture_channels(headers: &[exr::meta::header::Header]) -> Option<(usize, Vec<String>)> {
    let parts = || headers.iter().enumerate().filter(|(_, h)| !h.deep);
    let has = |h: &exr::meta::header::Header, name: &str| h.channels.list.iter().any(|c| c.name.eq(name));
    if let Some((i, _)) = parts().find(|(_, h)| ["R", "G", "B"].iter().all(|c| has(h, c))) {
        return Some((i, ["R", "G", "B"].map(String::from).into()));
    }
    if let Some((i, _)) = parts().find(|(_, h)| has(h, "Y")) {
        return Some((i, vec!["Y".into()]));
    }
    parts().find_map(|(i, h)| {
        h.channels.list.iter().find_map(|c| {
            let name = c.name.to_string();
            let names = ["R", "G", "B"].map(|c| format!("{}{c}", name.strip_suffix('R').unwrap_or("")));
            (name.ends_with(".R") && names.iter().all(|n| has(h, n))).then(|| (i, names.into()))
        })
    })
}

fn read_exr(path: &Path) -> std::result::Result<Image, String> {
    use ex::traits::*;
    let meta = exr::meta::MetaData::read_from_file(path, false).map_err(|e| e.to_string())?;
    let (part, names) = picture_channels(&meta.headers)
        .ok_or("it has neither channels R, G, B nor Y (deep images are not supported)")?;
    let size = meta.headers[part].layer_size;
    let (width, height) = (size.width(), size.height());
    let bytes = fs::metadata(path).map_err(|e| reason(&e))?.len();
    check_size(bytes, width as u64, height as u64)?;
    let create = |size: ex::Vec2<usize>| Image {
        width: size.width(),
        height: size.height(),
        pixels: vec![Rgb::ZERO; size.area()],
    };
    let set = |image: &mut Image, at: ex::Vec2<usize>, value: Rgb| {
        if let Some(p) = image.pixels.get_mut(at.y() * image.width + at.x()) {
            *p = value;
        }
    };
    // Not in parallel: a decoder that panics in another thread would end the process.
    let reader = ex::read().no_deep_data().largest_resolution_level().specific_channels();
    let image = match &names[..] {
        [y] => {
            reader
                .required(y.as_str())
                .collect_pixels(move |n, _| create(n), move |i, at, (y,): (f32,)| set(i, at, Rgb::splat(y)))
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_file(path)
                .map_err(|e| e.to_string())?
                .layer_data
                .channel_data
                .pixels
        }
        [r, g, b] => {
            reader
                .required(r.as_str())
                .required(g.as_str())
                .required(b.as_str())
                .collect_pixels(
                    move |n, _| create(n),
                    move |i, at, (r, g, b): (f32, f32, f32)| set(i, at, Rgb::new(r, g, b)),
                )
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_file(path)
                .map_err(|e| e.to_string())?
                .layer_data
                .channel_data
                .pixels
        }
        _ => return Err("it has no picture".into()),
    };
    if (image.width, image.height) != (width, height) {
        return Err("its parts contradict each other".into());
    }
    Ok(image)
}

fn read_other(path: &Path, encoding: Encoding) -> std::result::Result<Image, String> {
    use image::{ImageFormat, ImageReader};
    const JPEG_END: [u8; 2] = [0xFF, 0xD9];
    let reader = ImageReader::open(path).and_then(|r| r.with_guessed_format()).map_err(|e| e.to_string())?;
    let bytes = fs::metadata(path).map_err(|e| reason(&e))?.len();
    match reader.format() {
        None => Err("unknown format; use OpenEXR, PNG, JPEG, BMP, TGA or Radiance HDR".into()),
        Some(ImageFormat::Jpeg) => {
            // zune-jpeg 0.4 waits for ever for the end of a JPEG that is cut off behind a restart marker. What comes
            // after the first end is not looked at.
            let mut file = fs::read(path).map_err(|e| reason(&e))?;
            file.extend(JPEG_END);
            decode(ImageReader::with_format(Cursor::new(file), ImageFormat::Jpeg), bytes, encoding)
        }
        Some(_) => decode(reader, bytes, encoding),
    }
}

/// Decodes a file that has so many `bytes`.
fn decode(
    mut reader: image::ImageReader<impl BufRead + Seek>,
    bytes: u64,
    encoding: Encoding,
) -> std::result::Result<Image, String> {
    use image::{DynamicImage, ImageDecoder, Limits};
    let mut limits = Limits::default();
    limits.max_alloc = Some(16 * MAX_PIXELS);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    check_size(bytes, width as u64, height as u64)?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    let table = |max: u32| -> Vec<f32> {
        let linear = |x: f32| encoding.decode(x);
        (0..=max).map(|i| linear(i as f32 / max as f32)).collect()
    };
    let pixels = match decoded {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            decoded.into_rgb32f().pixels().map(|p| Rgb::from_array(p.0)).collect()
        }
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => {
            let t = table(65535);
            let rgb = decoded.into_rgb16();
            rgb.par_chunks_exact(3).map(|p| Rgb::from_array([0, 1, 2].map(|i| t[p[i] as usize]))).collect()
        }
        _ => {
            let t = table(255);
            let rgb = decoded.into_rgb8();
            rgb.par_chunks_exact(3).map(|p| Rgb::from_array([0, 1, 2].map(|i| t[p[i] as usize]))).collect()
        }
    };
    Ok(Image { width: width as usize, height: height as usize, pixels })
}

/// Writes an OpenEXR file: one part, ZIP-compressed, the unnamed layer as channels R, G, B and every other as
/// `name.R` and so on, by its [`Channels`]. The same layers and metadata give the same bytes.
///
/// # Errors
/// [`Error::Runtime`] if the layers differ in size or the file cannot be written; an old file then stays as it was.
pub fn write_exr(path: &Path, layers: &[Layer], metadata: &Metadata, samples: SampleType) -> Result<()> {
    let fail = |message: &str| Error::Runtime(format!("cannot write '{}': {message}", path.display()));
    let (width, height) = match layers.first() {
        Some(l) if l.image.width * l.image.height > 0 => (l.image.width, l.image.height),
        _ => return Err(fail("the image has no pixels")),
    };
    let mut names: Vec<&str> = layers.iter().map(|l| l.name.as_str()).collect();
    names.sort_unstable();
    if names.windows(2).any(|n| n[0] == n[1]) {
        return Err(fail("two layers have the same name"));
    }
    let mut channels = ex::SmallVec::new();
    for Layer { name, image, channels: letters } in layers {
        if (image.width, image.height, image.pixels.len()) != (width, height, width * height) {
            return Err(fail("its layers differ in size"));
        }
        for (c, letter) in letters.letters().iter().enumerate() {
            let name = if name.is_empty() { letter.to_string() } else { format!("{name}.{letter}") };
            let values = image.pixels.iter().map(|p| p[c]);
            let data = match samples {
                SampleType::Float => ex::FlatSamples::F32(values.collect()),
                SampleType::Half => ex::FlatSamples::F16(values.map(to_half).collect()),
            };
            let name = ex::Text::new_or_none(&name).ok_or_else(|| fail("a layer's name is not ASCII"))?;
            channels.push(ex::AnyChannel::new(name, data));
        }
    }
    let mut attributes = ex::LayerAttributes::default();
    for (key, value) in &metadata.attributes {
        // Header text is Latin 1.
        let latin: String = value.chars().map(|c| if (c as u32) < 256 { c } else { '?' }).collect();
        let value = ex::Text::new_or_none(&latin).ok_or_else(|| fail("an attribute is not text"))?;
        match (key.as_str(), ex::Text::new_or_none(key)) {
            ("software", _) => attributes.software_name = Some(value),
            ("comments", _) => attributes.comments = Some(value),
            ("owner", _) => attributes.owner = Some(value),
            (_, Some(key)) => drop(attributes.other.insert(key, ex::AttributeValue::Text(value))),
            (_, None) => return Err(fail("an attribute's name is not text")),
        }
    }
    let encoding = ex::Encoding {
        compression: ex::Compression::ZIP16,
        blocks: ex::Blocks::ScanLines,
        line_order: ex::LineOrder::Increasing,
    };
    let layer = ex::Layer::new((width, height), attributes, encoding, ex::AnyChannels::sort(channels));
    let mut bytes = Cursor::new(Vec::new());
    ex::WritableImage::write(&ex::Image::from_layer(layer))
        .to_buffered(&mut bytes)
        .map_err(|e| fail(&e.to_string()))?;
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes);
    replace_file(path, |w| w.write_all(&bytes))
}

fn to_half(x: f32) -> ex::f16 {
    // Infinity would spoil every filter that touches the pixel.
    ex::f16::from_f32(if x.is_finite() { x.clamp(-65504.0, 65504.0) } else { x })
}

/// Puts the attributes of the (first) header in order of name: the library keeps them in a hash map, so two equal
/// images would differ in bytes. Leaves the file as it is if it is not laid out as expected.
fn sort_attributes(bytes: &mut [u8]) {
    const START: usize = 8;
    let text_end = |from: usize| Some(from + bytes.get(from..)?.iter().position(|&b| b == 0)?);
    let mut spans = Vec::new();
    let mut at = START;
    while bytes.get(at).is_some_and(|&b| b != 0) {
        let span = text_end(at).and_then(|name| {
            let kind = text_end(name + 1)?;
            let size = bytes.get(kind + 1..kind + 5)?;
            Some(at..kind + 5 + u32::from_le_bytes(size.try_into().ok()?) as usize)
        });
        match span {
            Some(s) if s.end <= bytes.len() => {
                at = s.end;
                spans.push(s);
            }
            _ => return,
        }
    }
    let mut parts: Vec<Vec<u8>> = spans.into_iter().map(|s| bytes[s].to_vec()).collect();
    parts.sort();
    bytes[START..at].copy_from_slice(&parts.concat());
}

/// Writes an 8-bit sRGB PNG of the image times 2^`exposure`, clipped to what can be shown.
///
/// # Errors
/// [`Error::Runtime`] if it cannot be written; an old file then stays as it was.
pub fn write_png(path: &Path, image: &Image, exposure: f32) -> Result<()> {
    use image::ImageEncoder;
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    let scale = exposure.exp2();
    // NaN becomes black: casts take it to zero.
    let encode = |x: f32| (linear_to_srgb((x * scale).clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
    let bytes: Vec<u8> = image.pixels.iter().flat_map(|p| p.to_array().map(encode)).collect();
    let mut png = Vec::new();
    // The encoder's own choice is fast, and hardly compresses noise.
    PngEncoder::new_with_quality(&mut png, CompressionType::Default, FilterType::Adaptive)
        .write_image(&bytes, image.width as u32, image.height as u32, image::ExtendedColorType::Rgb8)
        .map_err(|e| Error::Runtime(format!("cannot write '{}': {e}", path.display())))?;
    replace_file(path, |w| w.write_all(&png))
}

/// Checks, before hours are spent on its content, that a file can be written.
///
/// # Errors
/// [`Error::Runtime`] that says why not.
pub fn check_writable(path: &Path) -> Result<()> {
    let target = target(path)?;
    if target.direct {
        return File::options().write(true).open(&target.path).map(drop).map_err(|e| cannot_write(path, &e));
    }
    temporary(&target.path)
        .and_then(|(file, name)| {
            drop(file);
            fs::remove_file(name)
        })
        .map_err(|e| cannot_write(path, &e))
}

/// Writes a file through a temporary one in the same directory, so that there is always either the old content or all
/// of the new. Devices and pipes are written directly.
///
/// # Errors
/// [`Error::Runtime`] if it cannot be written; the old file stays, and nothing else is left behind.
pub fn replace_file(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<()> {
    let finish = |file: File| {
        let mut w = BufWriter::new(file);
        write(&mut w)?;
        w.into_inner().map_err(|e| e.into_error())
    };
    let target = target(path)?;
    let done = if target.direct {
        File::options().write(true).open(&target.path).and_then(finish).map(drop)
    } else {
        temporary(&target.path).and_then(|(file, name)| {
            let done =
                finish(file).and_then(|file| file.sync_all()).and_then(|()| fs::rename(&name, &target.path));
            if done.is_err() {
                // The first error is the one to report.
                let _ = fs::remove_file(&name);
            }
            done
        })
    };
    done.map_err(|e| cannot_write(path, &e))
}

fn cannot_write(path: &Path, e: &io::Error) -> Error {
    let reason = match e.kind() {
        io::ErrorKind::NotFound => "its directory does not exist".into(),
        _ => reason(e),
    };
    Error::Runtime(format!("cannot write '{}': {reason}", path.display()))
}

struct Target {
    /// Symbolic links resolved, so that they survive.
    path: PathBuf,
    /// Neither a regular file nor new.
    direct: bool,
}

fn target(path: &Path) -> Result<Target> {
    let resolved = fs::canonicalize(path).unwrap_or_else(|_| path.into());
    match fs::metadata(&resolved) {
        Ok(m) if m.is_dir() => {
            Err(Error::Runtime(format!("cannot write '{}': it is a directory", path.display())))
        }
        Ok(m) => Ok(Target { path: resolved, direct: !m.is_file() }),
        Err(_) => Ok(Target { path: resolved, direct: false }),
    }
}

/// A new file beside `path`.
fn temporary(path: &Path) -> io::Result<(File, PathBuf)> {
    let mut n = 0;
    loop {
        let name = path.with_file_name(format!(".caustica-{}-{n}.tmp", std::process::id()));
        match File::options().write(true).create_new(true).open(&name) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => n += 1,
            other => return other.map(|file| (file, name)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Sampler, Stream};

    fn noise(width: usize, height: usize) -> Image {
        let mut s = Sampler::new(7, Stream::Eye, 0, 0);
        let pixels = (0..width * height)
            .map(|_| Rgb::new(s.next_1d(), s.next_1d() * 4.0, s.next_1d() - 0.5))
            .collect();
        Image { width, height, pixels }
    }

    fn layer(name: &str, image: &Image) -> Layer {
        Layer { name: name.into(), image: image.clone(), channels: Channels::Rgb }
    }

    fn files(dir: &Path) -> usize {
        fs::read_dir(dir).unwrap().count()
    }

    fn error(result: Result<Image>) -> String {
        match result {
            Err(e @ Error::File { .. }) => e.to_string(),
            other => panic!("expected a file error, got {other:?}"),
        }
    }

    #[test]
    fn exr_round_trips() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        for (w, h) in [(1, 1), (16384, 1), (1, 300), (37, 53)] {
            let image = noise(w, h);
            write_exr(&path, &[layer("", &image)], &Metadata::default(), SampleType::Float).unwrap();
            assert_eq!(read(&path).unwrap(), image);
            write_exr(&path, &[layer("", &image)], &Metadata::default(), SampleType::Half).unwrap();
            let half = read(&path).unwrap();
            assert!(half.pixels.iter().zip(&image.pixels).all(|(a, b)| (*a - *b).abs().max_element() < 2e-3));
        }
        assert_eq!(files(dir.path()), 1, "temporary files were left behind");
    }

    #[test]
    fn exr_layers_and_attributes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let (a, b) = (noise(5, 4), Image { width: 5, height: 4, pixels: vec![Rgb::splat(1e9); 20] });
        let attributes = ["seed", "passes", "scene", "software", "integrator", "command"]
            .map(|k| (k.to_string(), format!("the {k} – é")))
            .to_vec();
        let metadata = Metadata { attributes };
        let mut bytes = Vec::new();
        for _ in 0..8 {
            write_exr(&path, &[layer("", &a), layer("albedo", &b)], &metadata, SampleType::Half).unwrap();
            bytes.push(fs::read(&path).unwrap());
        }
        assert!(bytes.iter().all(|x| *x == bytes[0]), "equal images differ in bytes");
        let meta = exr::meta::MetaData::read_from_file(&path, true).unwrap();
        let names: Vec<String> = meta.headers[0].channels.list.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R", "albedo.B", "albedo.G", "albedo.R"]);
        match meta.headers[0].own_attributes.other.get(&b"passes"[..]) {
            Some(ex::AttributeValue::Text(t)) => assert_eq!(t.to_string(), "the passes ? é"),
            other => panic!("{other:?}"),
        }
        assert_eq!(read(&path).unwrap().width, 5);
        // Without an unnamed layer the first named one is the picture; a half does not overflow.
        write_exr(&path, &[layer("big", &b)], &metadata, SampleType::Half).unwrap();
        assert_eq!(read(&path).unwrap().pixels[7], Rgb::splat(65504.0));
        let small = noise(4, 4);
        assert!(write_exr(&path, &[layer("", &a), layer("x", &small)], &metadata, SampleType::Half).is_err());
        assert!(write_exr(&path, &[layer("", &a), layer("", &a)], &metadata, SampleType::Half).is_err());
    }

    /// Every lossless and lossy compression, tiles, a shifted data window, other sample types, grey, several parts.
    fn exr_zoo(dir: &Path) -> Vec<(PathBuf, bool)> {
        use ex::Compression as C;
        use ex::WritableImage as _;
        let image = noise(40, 33);
        let channel = |name: &str, c: usize| {
            let values = image.pixels.iter().map(|p| p[c]).collect();
            ex::AnyChannel::new(name, ex::FlatSamples::F32(values))
        };
        let mut zoo = Vec::new();
        let all = [
            (C::Uncompressed, true),
            (C::RLE, true),
            (C::ZIP1, true),
            (C::ZIP16, true),
            (C::PIZ, true),
            (C::PXR24, false),
            (C::B44, false),
            (C::B44A, false),
        ];
        for (i, (compression, lossless)) in all.into_iter().enumerate() {
            let tiled = i % 2 == 1;
            let encoding = ex::Encoding {
                compression,
                blocks: if tiled { ex::Blocks::Tiles(ex::Vec2(16, 16)) } else { ex::Blocks::ScanLines },
                line_order: ex::LineOrder::Increasing,
            };
            let attributes = ex::LayerAttributes::named("part").with_position(ex::Vec2(-7, 11));
            let channels = ex::AnyChannels::sort(ex::SmallVec::from_vec(
                (0..3).map(|c| channel("RGB".get(c..=c).unwrap(), c)).collect(),
            ));
            let depth = ex::Layer::new(
                (3, 3),
                ex::LayerAttributes::named("depth"),
                ex::Encoding::FAST_LOSSLESS,
                ex::AnyChannels::sort(ex::SmallVec::from_vec(vec![ex::AnyChannel::new(
                    "Z",
                    ex::FlatSamples::U32(vec![3; 9]),
                )])),
            );
            let part = ex::Layer::new((40, 33), attributes, encoding, channels);
            let path = dir.join(format!("{i}.exr"));
            let mut display = ex::ImageAttributes::new(ex::IntegerBounds::from_dimensions((100, 90)));
            display.pixel_aspect = 1.0;
            ex::Image::from_layers(display, vec![depth, part]).write().to_file(&path).unwrap();
            zoo.push((path, lossless));
        }
        zoo
    }

    #[test]
    fn exr_of_any_kind() {
        let dir = tempfile::tempdir().unwrap();
        let image = noise(40, 33);
        for (path, lossless) in exr_zoo(dir.path()) {
            let read = read(&path).unwrap();
            assert_eq!((read.width, read.height), (40, 33));
            let tolerance = if lossless { 0.0 } else { 0.5 };
            for (a, b) in read.pixels.iter().zip(&image.pixels) {
                assert!((*a - *b).abs().max_element() <= tolerance, "{}: {a} {b}", path.display());
            }
        }
        use ex::WritableImage as _;
        let path = dir.path().join("grey.exr");
        for samples in [ex::FlatSamples::U32(vec![2; 6]), ex::FlatSamples::F32(vec![2.0; 6])] {
            let channels =
                ex::AnyChannels::sort(ex::SmallVec::from_vec(vec![ex::AnyChannel::new("Y", samples)]));
            ex::Image::from_channels((3, 2), channels).write().to_file(&path).unwrap();
            assert_eq!(read(&path).unwrap(), Image { width: 3, height: 2, pixels: vec![Rgb::splat(2.0); 6] });
        }
    }

    /// Cut off at any place and with random bytes anywhere, a file is read or refused, never a panic. (A panic that
    /// is caught gives the message looked for here.)
    #[test]
    fn damaged_files_are_errors() {
        let dir = tempfile::tempdir().unwrap();
        let mut originals: Vec<PathBuf> = exr_zoo(dir.path()).into_iter().map(|(p, _)| p).collect();
        let png = dir.path().join("a.png");
        write_png(&png, &noise(40, 33), 0.0).unwrap();
        originals.push(png);
        for extension in ["jpg", "bmp", "tga", "hdr"] {
            let path = dir.path().join(format!("a.{extension}"));
            let rgb = image::RgbImage::from_fn(40, 33, |x, y| image::Rgb([x as u8, y as u8, 99]));
            match extension {
                "hdr" => image::DynamicImage::ImageRgb8(rgb).into_rgb32f().save(&path).unwrap(),
                _ => rgb.save(&path).unwrap(),
            }
            originals.push(path);
        }
        let mut s = Sampler::new(1, Stream::Eye, 0, 0);
        for path in originals {
            let extension = path.extension().unwrap().to_str().unwrap();
            let bytes = fs::read(&path).unwrap();
            let damaged = dir.path().join(format!("damaged.{extension}"));
            for round in 0..60 {
                let mut b = bytes.clone();
                if round % 3 == 0 {
                    b.truncate((s.next_1d() * b.len() as f32) as usize);
                } else {
                    // Mostly in the header, where it hurts.
                    let range = if round % 3 == 1 { b.len().min(600) } else { b.len() };
                    for _ in 0..4 {
                        let at = (s.next_1d() * range as f32) as usize;
                        b[at] = (s.next_1d() * 256.0) as u8;
                    }
                }
                fs::write(&damaged, &b).unwrap();
                match read(&damaged) {
                    Ok(image) => assert_eq!(image.pixels.len(), image.width * image.height),
                    Err(Error::File { .. }) => {}
                    Err(e) => panic!("{e:?}"),
                }
            }
            // A picture that is cut short is refused, not half black (some decoders of old formats forgive).
            if ["exr", "png"].contains(&extension) {
                fs::write(&damaged, &bytes[..bytes.len() * 3 / 4]).unwrap();
                error(read(&damaged));
            }
        }
    }

    #[test]
    fn what_is_no_image() {
        let dir = tempfile::tempdir().unwrap();
        assert!(error(read(&dir.path().join("none.exr"))).contains("no such file"));
        error(read(dir.path()));
        let path = dir.path().join("text.exr");
        for text in ["", "hello", "hello, this is text"] {
            fs::write(&path, text).unwrap();
            assert!(error(read(&path)).contains("format"));
        }
        // A header that claims 60000x60000 pixels.
        let small = dir.path().join("small.exr");
        write_exr(&small, &[layer("", &noise(2, 2))], &Metadata::default(), SampleType::Half).unwrap();
        let mut bytes = fs::read(&small).unwrap();
        let at =
            bytes.windows(10).position(|w| w == b"dataWindow").unwrap() + "dataWindow.box2i.....".len() - 1;
        bytes[at + 8..at + 16].copy_from_slice(&[0x60, 0xea, 0, 0, 0x60, 0xea, 0, 0]);
        fs::write(&small, &bytes).unwrap();
        error(read(&small));
        // One that claims 10000x10000, whatever the format.
        let path = dir.path().join("small.bmp");
        image::RgbImage::new(2, 2).save(&path).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        for at in [18, 22] {
            bytes[at..at + 4].copy_from_slice(&10_000_u32.to_le_bytes());
        }
        fs::write(&path, &bytes).unwrap();
        assert!(error(read(&path)).contains("too short for 10000x10000"));
    }

    /// Found by fuzzing: a progressive JPEG that ends behind a restart marker took for ever.
    #[test]
    fn a_cut_off_jpeg_comes_to_an_end() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("endless.jpg");
        fs::write(&path, include_bytes!("../tests/data/endless.jpg")).unwrap();
        let image = read(&path).unwrap();
        assert_eq!((image.width, image.height), (12, 9));
    }

    #[test]
    fn png_is_srgb() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let values = [0.0, 0.001, 0.18, 0.5, 1.0, 7.0, -1.0, f32::NAN];
        let image = Image { width: 8, height: 1, pixels: values.map(Rgb::splat).to_vec() };
        write_png(&path, &image, 0.0).unwrap();
        // 0.001 * 12.92 * 255 = 3.3; 0.18 -> 0.4614 * 255 = 117.6; 0.5 -> 0.7354 * 255 = 187.5.
        let bytes = image::open(&path).unwrap().into_rgb8();
        assert_eq!(bytes.pixels().map(|p| p.0[0]).collect::<Vec<_>>(), [0, 3, 118, 188, 255, 255, 0, 0]);
        let linear = read(&path).unwrap();
        assert!((linear.pixels[2].x - 0.18).abs() < 2e-3);
        assert_eq!(read_encoded(&path, Encoding::Linear).unwrap().pixels[2].x, 118.0 / 255.0);
        write_png(&path, &image, 1.0).unwrap();
        assert!((read(&path).unwrap().pixels[2].y - 0.36).abs() < 3e-3);
    }

    #[test]
    fn bit_depths_and_grey() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        image::ImageBuffer::from_pixel(2, 1, image::Luma([32768_u16])).save(&path).unwrap();
        let grey = read(&path).unwrap();
        assert!((grey.pixels[1] - Rgb::splat(srgb_to_linear(32768.0 / 65535.0))).abs().max_element() < 1e-6);
        assert_eq!(read_encoded(&path, Encoding::Linear).unwrap().pixels[0], Rgb::splat(32768.0 / 65535.0));
        image::ImageBuffer::from_pixel(2, 1, image::LumaA([51_u8, 7])).save(&path).unwrap();
        assert_eq!(read_encoded(&path, Encoding::Linear).unwrap().pixels[0], Rgb::splat(0.2));
        let path = dir.path().join("a.hdr");
        image::ImageBuffer::from_pixel(2, 1, image::Rgb([2.0_f32, 1.0, 0.5])).save(&path).unwrap();
        assert!((read(&path).unwrap().pixels[0] - Rgb::new(2.0, 1.0, 0.5)).abs().max_element() < 1e-2);
    }

    #[test]
    fn srgb_curve_inverts() {
        for i in 0..=1000 {
            let x = i as f32 / 1000.0;
            assert!((srgb_to_linear(linear_to_srgb(x)) - x).abs() < 1e-6);
        }
    }

    #[test]
    fn files_are_replaced_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("old");
        fs::write(&path, "old").unwrap();
        let failed = replace_file(&path, |w| {
            w.write_all(b"new")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failed.unwrap_err().to_string().contains("disk full"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        check_writable(&path).unwrap();
        check_writable(&dir.path().join("new")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(files(dir.path()), 1);
        assert!(matches!(check_writable(dir.path()), Err(Error::Runtime(_))));
        let nowhere = dir.path().join("no/such/a.exr");
        assert!(check_writable(&nowhere).unwrap_err().to_string().contains("directory does not exist"));
        // Symbolic links stay links, devices stay devices.
        let link = dir.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        replace_file(&link, |w| w.write_all(b"new")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        check_writable(Path::new("/dev/null")).unwrap();
        replace_file(Path::new("/dev/null"), |w| w.write_all(b"new")).unwrap();
    }
}
