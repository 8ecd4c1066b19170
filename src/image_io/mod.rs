//! Reading and writing images, and the safe replacement of files that all outputs go through.

mod exr;
mod hdr;

pub use exr::{Channels, Layer, Metadata, SampleType, write_exr};

use crate::math::{Rgb, first_index};
use crate::{Error, Result};
use rayon::prelude::*;
use std::fmt;
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

/// What values an image may hold, by what it is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Domain {
    /// Heights, normals, refractive indices and parameters: anything finite.
    Finite,
    /// Reflectance and radiance: finite and not negative.
    NonNegative,
}

impl Domain {
    /// Whether a value is allowed.
    pub fn contains(self, value: Rgb) -> bool {
        value.is_finite() && (self == Domain::Finite || value.min_element() >= 0.0)
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Domain::Finite => "finite",
            Domain::NonNegative => "finite and not negative",
        })
    }
}

impl Image {
    /// Checks that all pixels times `scale` are allowed.
    ///
    /// # Errors
    /// A message that names the first pixel that is not, by column and row from the upper left.
    pub fn check(&self, domain: Domain, scale: Rgb) -> std::result::Result<(), String> {
        let Some(i) = first_index(&self.pixels, |p| !domain.contains(*p * scale)) else { return Ok(()) };
        let (x, y, value) = (i % self.width, i / self.width, self.pixels[i]);
        let times = if scale == Rgb::ONE { String::new() } else { format!(" times the scale {scale}") };
        Err(format!("the texel ({x}, {y}) is {value}{times}, but must be {domain}: change it in the image"))
    }

    /// The image with every pixel mapped.
    pub fn map(&self, f: impl Fn(Rgb) -> Rgb) -> Image {
        Image { width: self.width, height: self.height, pixels: self.pixels.iter().map(|&p| f(p)).collect() }
    }
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

/// Reads an image of any supported format (OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR) as linear RGB. 8- and
/// 16-bit formats are taken as sRGB-encoded. Of an EXR file it takes channels R, G, B, else X, Y, Z, else Y,
/// else the first layer with `name.R`, `name.G`, `name.B` or `name.Y`, else R alone or what is the only
/// channel, and places them in the display window. Alpha is dropped.
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
    match file.read_exact(&mut magic) {
        Err(e) if e.kind() != io::ErrorKind::UnexpectedEof => {
            return Err(fail(format!("cannot read the image: {}", reason(&e))));
        }
        _ => {}
    }
    let read = || match magic {
        [0x76, 0x2f, 0x31, 0x01] => exr::read(path),
        _ if magic.starts_with(hdr::MAGIC) => hdr::read(path),
        _ => read_other(path, encoding),
    };
    // Decoders promise errors, not panics, but files from anywhere have broken such promises before.
    catch_unwind(AssertUnwindSafe(read))
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

fn read_other(path: &Path, encoding: Encoding) -> std::result::Result<Image, String> {
    use image::{ImageFormat, ImageReader};
    const JPEG_END: [u8; 2] = [0xFF, 0xD9];
    let reader = ImageReader::open(path).and_then(|r| r.with_guessed_format()).map_err(|e| e.to_string())?;
    let bytes = fs::metadata(path).map_err(|e| reason(&e))?.len();
    match reader.format() {
        None => Err("unknown format; use OpenEXR, PNG, JPEG, BMP, TGA or Radiance HDR".into()),
        Some(ImageFormat::Jpeg) => {
            // zune-jpeg 0.4 waits for ever for the end of a JPEG that is cut off behind a restart marker.
            // What comes after the first end is not looked at.
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

/// Writes a file through a temporary one in the same directory, so that there is always either the old
/// content or all of the new. Devices and pipes are written directly.
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
            // Who may read and write a file is for its owner to say, not for who replaces it.
            let keep_mode = |file: File| match fs::metadata(&target.path) {
                Ok(old) => file.set_permissions(old.permissions()).map(|()| file),
                Err(_) => Ok(file),
            };
            let done = finish(file)
                .and_then(keep_mode)
                .and_then(|file| file.sync_all())
                .and_then(|()| fs::rename(&name, &target.path));
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
    use super::exr::tests::zoo;
    use super::*;
    use crate::math::{Sampler, Stream};

    pub(super) fn noise(width: usize, height: usize) -> Image {
        let mut s = Sampler::new(7, Stream::Eye, 0, 0);
        let pixels = (0..width * height)
            .map(|_| Rgb::new(s.next_1d(), s.next_1d() * 4.0, s.next_1d() - 0.5))
            .collect();
        Image { width, height, pixels }
    }

    pub(super) fn layer(name: &str, image: &Image) -> Layer {
        Layer { name: name.into(), image: image.clone(), channels: Channels::Rgb }
    }

    pub(super) fn files(dir: &Path) -> usize {
        fs::read_dir(dir).unwrap().count()
    }

    pub(super) fn error(result: Result<Image>) -> String {
        match result {
            Err(e @ Error::File { .. }) => e.to_string(),
            other => panic!("expected a file error, got {other:?}"),
        }
    }

    /// Cut off at any place and with random bytes anywhere, a file is read or refused, never a panic. (A
    /// panic that is caught gives the message looked for here.)
    #[test]
    fn damaged_files_are_errors() {
        let dir = tempfile::tempdir().unwrap();
        let mut originals: Vec<PathBuf> = zoo(dir.path()).into_iter().map(|(p, _)| p).collect();
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
        fs::write(&path, include_bytes!("../../tests/data/endless.jpg")).unwrap();
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
    fn the_first_texel_that_is_not_allowed_is_named() {
        let image = |value: f32| {
            let mut pixels = vec![Rgb::ONE; 20];
            pixels[13] = Rgb::new(0.5, value, 0.25);
            pixels[19] = Rgb::NAN;
            Image { width: 5, height: 4, pixels }
        };
        for (value, domain, is_allowed) in [
            (f32::NAN, Domain::Finite, false),
            (f32::INFINITY, Domain::Finite, false),
            (f32::NEG_INFINITY, Domain::NonNegative, false),
            (-1e-30, Domain::NonNegative, false),
            (-1e30, Domain::Finite, true),
            (-0.0, Domain::NonNegative, true),
            (1e30, Domain::NonNegative, true),
        ] {
            let error = image(value).check(domain, Rgb::ONE).unwrap_err();
            let texel = if is_allowed { "texel (4, 3) is [NaN, NaN, NaN]" } else { "texel (3, 2) is [0.5, " };
            assert!(
                error.contains(texel) && error.contains(&domain.to_string()),
                "{value} {domain:?}: {error}"
            );
        }
        // The product counts.
        let error = image(1e30).check(Domain::Finite, Rgb::new(1.0, 1e20, 1.0)).unwrap_err();
        assert!(error.contains("texel (3, 2)") && error.contains("times the scale"), "{error}");
        assert!(
            Image { width: 1, height: 1, pixels: vec![Rgb::ONE] }.check(Domain::Finite, Rgb::NAN).is_err()
        );
        assert!(noise(30, 40).map(Rgb::abs).check(Domain::NonNegative, Rgb::ONE).is_ok());
    }

    #[test]
    fn srgb_curve_inverts() {
        for i in 0..=1000 {
            let x = i as f32 / 1000.0;
            assert!((srgb_to_linear(linear_to_srgb(x)) - x).abs() < 1e-6);
        }
    }

    #[test]
    fn a_replaced_file_keeps_its_mode() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        for mode in [0o600, 0o664, 0o444] {
            write_png(&path, &noise(3, 2), 0.0).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            write_png(&path, &noise(2, 3), 0.0).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, mode);
            assert_eq!(read(&path).unwrap().height, 3);
            fs::remove_file(&path).unwrap();
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
