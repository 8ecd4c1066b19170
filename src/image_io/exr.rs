//! OpenEXR. The picture is the *display window*: black where the data window leaves it empty, cut off where
//! the data window is larger.

use super::{Image, check_size, reason, replace_file};
use crate::math::{Rgb, XYZ_TO_SRGB};
use crate::{Error, Result};
use ::exr::meta::MetaData;
use ::exr::meta::header::Header;
use ::exr::prelude as ex;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;

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

/// The channels of a layer, named as other programs expect: tev groups by the name before the dot, Blender
/// takes the one letter behind it.
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

/// What goes into an EXR file besides pixels.
#[derive(Clone, Debug, Default)]
pub struct Metadata {
    /// (key, value) text attributes: seed, passes, command. Keys are no standard attributes of OpenEXR's
    /// other than `software`, `comments` and `owner`.
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

/// How the channels of a picture become colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// They are linear sRGB.
    Rgb,
    /// They are CIE XYZ.
    Xyz,
    /// There is but one.
    Grey,
}

/// Channels of the same layer, by the letter in upper case.
type Letters = BTreeMap<String, ex::Text>;

/// The channels of a part, by layer; "" are those of none.
fn layers(header: &Header) -> BTreeMap<String, Letters> {
    let mut layers: BTreeMap<String, Letters> = BTreeMap::new();
    for channel in &header.channels.list {
        let name = channel.name.to_string();
        let (layer, letter) = name.rsplit_once('.').unwrap_or(("", &name));
        let letters = layers.entry(layer.into()).or_default();
        letters.entry(letter.to_ascii_uppercase()).or_insert_with(|| channel.name.clone());
    }
    layers
}

/// What makes a picture, the best first: whether channels belong to a layer, their letters, and those that
/// must not be beside them. With RY and BY, Y is the luminance of a colour; with X and Z in a layer, it is a
/// part of a direction.
#[rustfmt::skip]
const PICTURES: [(Kind, bool, &[&str], &[&str]); 7] = [
    (Kind::Rgb, false, &["R", "G", "B"], &[]),
    (Kind::Xyz, false, &["X", "Y", "Z"], &[]),
    (Kind::Grey, false, &["Y"], &["RY", "BY"]),
    (Kind::Rgb, true, &["R", "G", "B"], &[]),
    (Kind::Grey, true, &["Y"], &["RY", "BY", "X", "Z"]),
    (Kind::Grey, false, &["R"], &["G", "B"]),
    (Kind::Grey, true, &["R"], &["G", "B"]),
];

/// The channels that make the picture. Like Mitsuba it takes names in any case, and unlike it a lone R, or
/// any channel that is the only one beside alpha.
fn picture(headers: &[Header]) -> Option<(Kind, Vec<ex::Text>)> {
    let parts: Vec<_> = headers.iter().filter(|h| !h.deep).map(layers).collect();
    let best = PICTURES.iter().find_map(|(kind, layered, wanted, unwanted)| {
        parts.iter().flatten().find_map(|(layer, letters)| {
            let fits = layer.is_empty() != *layered && !unwanted.iter().any(|l| letters.contains_key(*l));
            let names = || wanted.iter().map(|l| letters.get(*l).cloned()).collect::<Option<Vec<_>>>();
            Some((*kind, fits.then(names)??))
        })
    });
    let only = |layers: &BTreeMap<String, Letters>| {
        let channels = || layers.values().flatten();
        let mut others = channels().filter(|(letter, _)| *letter != "A");
        let (_, one) = others.next().or_else(|| channels().next())?;
        others.next().is_none().then(|| (Kind::Grey, vec![one.clone()]))
    };
    best.or_else(|| parts.iter().find_map(only))
}

/// Why there is no picture.
fn no_picture(headers: &[Header]) -> String {
    let Some(header) = headers.iter().find(|h| !h.deep) else {
        return "deep images are not supported: flatten it".into();
    };
    const SHOWN: usize = 8;
    let shown = header.channels.list.iter().take(SHOWN);
    let names: Vec<String> = shown.map(|c| c.name.to_string().escape_debug().to_string()).collect();
    let more = if header.channels.list.len() > SHOWN { ", …" } else { "" };
    format!(
        "its channels are {}{more}: save it with channels R, G and B, or with Y or R alone",
        names.join(", ")
    )
}

/// A display window of up to 2²⁴ pixels may be empty, whatever the length of the file.
const LEAST_BYTES: u64 = (1 << 24) / super::MAX_PIXELS_PER_BYTE + 1;

/// Blocks of so many bytes may lie in a file of any length.
const SMALL_BLOCK: u128 = 1 << 28;

/// The `exr` crate asks for as much memory as a block claims to need, up to the size of a tile or a run of
/// lines, which may be far larger than the picture.
fn check_blocks(headers: &[Header], bytes: u64) -> Result<(), String> {
    // DEFLATE packs at most 1032 bytes into one.
    let most = SMALL_BLOCK.max(1032 * bytes as u128);
    let is_larger = |header: &Header| {
        let (size, depth) = (header.max_block_pixel_size(), header.channels.bytes_per_pixel);
        size.width() as u128 * size.height() as u128 * depth as u128 > most
    };
    match headers.iter().any(is_larger) {
        true => Err("the file is too short for its tiles or lines".into()),
        false => Ok(()),
    }
}

pub(super) fn read(path: &Path) -> Result<Image, String> {
    use ex::traits::*;
    let meta = MetaData::read_from_file(path, false).map_err(|e| e.to_string())?;
    let (kind, names) = picture(&meta.headers).ok_or_else(|| no_picture(&meta.headers))?;
    // The part that the reader below takes.
    let has_all = |h: &&Header| !h.deep && names.iter().all(|n| h.channels.list.iter().any(|c| c.name == *n));
    let header = meta.headers.iter().find(has_all).ok_or("it has no picture")?;
    let bytes = fs::metadata(path).map_err(|e| reason(&e))?.len();
    let (data, display) = (header.layer_size, header.shared_attributes.display_window);
    check_size(bytes, data.width() as u64, data.height() as u64)?;
    let (width, height) = (display.size.width(), display.size.height());
    check_size(bytes.max(LEAST_BYTES), width as u64, height as u64)?;
    check_blocks(&meta.headers, bytes)?;

    let corner = header.own_attributes.layer_position;
    let offset = |corner: i32, display: i32| corner as i64 - display as i64;
    let (x0, y0) = (offset(corner.x(), display.position.x()), offset(corner.y(), display.position.y()));
    let create = move |size: ex::Vec2<usize>| {
        (
            size,
            Image { width, height, pixels: vec![Rgb::ZERO; if size == data { width * height } else { 0 }] },
        )
    };
    let set = move |image: &mut Image, at: ex::Vec2<usize>, value: Rgb| {
        let (x, y) = (x0 + at.x() as i64, y0 + at.y() as i64);
        if (0..width as i64).contains(&x) && (0..height as i64).contains(&y) {
            if let Some(p) = image.pixels.get_mut(y as usize * width + x as usize) {
                *p = value;
            }
        }
    };
    let color = move |rgb: Rgb| if kind == Kind::Xyz { XYZ_TO_SRGB.as_mat3() * rgb } else { rgb };
    // Not in parallel: a decoder that panics in another thread would end the process.
    let reader = ex::read().no_deep_data().largest_resolution_level().specific_channels();
    let (size, image) = match &names[..] {
        [y] => {
            reader
                .required(y.clone())
                .collect_pixels(
                    move |n, _| create(n),
                    move |i, at, (y,): (f32,)| set(&mut i.1, at, Rgb::splat(y)),
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
        [r, g, b] => {
            reader
                .required(r.clone())
                .required(g.clone())
                .required(b.clone())
                .collect_pixels(
                    move |n, _| create(n),
                    move |i, at, (r, g, b): (f32, f32, f32)| set(&mut i.1, at, color(Rgb::new(r, g, b))),
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
    if size != data {
        return Err("its parts contradict each other".into());
    }
    Ok(image)
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

/// Puts the attributes of the (first) header in order of name: the library keeps them in a hash map, so two
/// equal images would differ in bytes. Leaves the file as it is if it is not laid out as expected.
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

#[cfg(test)]
pub(super) mod tests {
    use super::super::tests::{error, files, layer, noise};
    use super::*;
    use crate::image_io::read;
    use ex::WritableImage as _;
    use proptest::prelude::*;
    use std::path::PathBuf;

    #[test]
    fn round_trips() {
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
    fn layers_and_attributes() {
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
        let meta = MetaData::read_from_file(&path, true).unwrap();
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

    /// Every lossless and lossy compression, tiles, a shifted data window, other sample types, grey, several
    /// parts.
    pub(in crate::image_io) fn zoo(dir: &Path) -> Vec<(PathBuf, bool)> {
        use ex::Compression as C;
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
    fn files_of_any_kind() {
        let dir = tempfile::tempdir().unwrap();
        let image = noise(40, 33);
        for (path, lossless) in zoo(dir.path()) {
            let read = read(&path).unwrap();
            assert_eq!((read.width, read.height), (100, 90));
            let tolerance = if lossless { 0.0 } else { 0.5 };
            for (a, b) in read.pixels.iter().zip(placed(&image, (-7, 11), (0, 0), (100, 90)).pixels) {
                assert!((*a - b).abs().max_element() <= tolerance, "{}: {a} {b}", path.display());
            }
        }
        let path = dir.path().join("grey.exr");
        for samples in [ex::FlatSamples::U32(vec![2; 6]), ex::FlatSamples::F32(vec![2.0; 6])] {
            let channels =
                ex::AnyChannels::sort(ex::SmallVec::from_vec(vec![ex::AnyChannel::new("Y", samples)]));
            ex::Image::from_channels((3, 2), channels).write().to_file(&path).unwrap();
            assert_eq!(read(&path).unwrap(), Image { width: 3, height: 2, pixels: vec![Rgb::splat(2.0); 6] });
        }
    }

    /// What a window of the plane shows of an image that lies in it, by the definition.
    fn placed(
        image: &Image,
        corner: (i32, i32),
        window: (i32, i32),
        (width, height): (usize, usize),
    ) -> Image {
        let mut pixels = Vec::new();
        for y in window.1..window.1 + height as i32 {
            for x in window.0..window.0 + width as i32 {
                let inside = (x - corner.0, y - corner.1);
                let is_inside = (0..image.width as i32).contains(&inside.0)
                    && (0..image.height as i32).contains(&inside.1);
                pixels.push(match is_inside {
                    true => image.pixels[inside.1 as usize * image.width + inside.0 as usize],
                    false => Rgb::ZERO,
                });
            }
        }
        Image { width, height, pixels }
    }

    /// Writes channels of 32-bit floats, as one part for each list of them.
    fn write(
        path: &Path,
        parts: &[Vec<(&str, Vec<f32>)>],
        size: (usize, usize),
        encoding: ex::Encoding,
        corner: (i32, i32),
        display: ex::IntegerBounds,
    ) {
        let part = |(i, channels): (usize, &Vec<(&str, Vec<f32>)>)| {
            let channels = channels
                .iter()
                .map(|(name, values)| ex::AnyChannel::new(*name, ex::FlatSamples::F32(values.clone())));
            let attributes = ex::LayerAttributes::named(format!("part {i}").as_str())
                .with_position(ex::Vec2(corner.0, corner.1));
            ex::Layer::new(size, attributes, encoding, ex::AnyChannels::sort(channels.collect()))
        };
        let parts: Vec<_> = parts.iter().enumerate().map(part).collect();
        ex::Image::from_layers(ex::ImageAttributes::new(display), parts).write().to_file(path).unwrap();
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            rng_algorithm: proptest::test_runner::RngAlgorithm::ChaCha,
            ..ProptestConfig::with_cases(200)
        })]

        /// Beside, across, inside and around each other.
        #[test]
        fn data_windows_are_placed_in_display_windows(
            corner in (-20..20i32, -20..20i32),
            size in (1..24usize, 1..24usize),
            window in (-20..20i32, -20..20i32),
            window_size in (1..24usize, 1..24usize),
            format in 0..4usize,
            kind in 0..3usize,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.exr");
            let mut image = noise(size.0, size.1);
            if kind == 0 {
                image = image.map(|p| Rgb::splat(p.x));
            }
            let names: &[&str] = [&["Y"][..], &["R", "G", "B"], &["l.r", "l.g", "l.b"]][kind];
            let values = |c: usize| image.pixels.iter().map(|p| p[c]).collect();
            let channels = names.iter().enumerate().map(|(c, name)| (*name, values(c))).collect();
            let encoding = ex::Encoding {
                compression: [ex::Compression::Uncompressed, ex::Compression::ZIP16][format % 2],
                blocks: [ex::Blocks::ScanLines, ex::Blocks::Tiles(ex::Vec2(7, 5))][format / 2],
                line_order: ex::LineOrder::Increasing,
            };
            let display = ex::IntegerBounds::new(window, window_size);
            write(&path, &[channels], size, encoding, corner, display);
            prop_assert_eq!(read(&path).unwrap(), placed(&image, corner, window, window_size));
        }
    }

    /// Channel number i of a part holds i + 1. What Mitsuba 3.9.1 reads it reads as these; it refuses a lone
    /// channel that is not Y, and several layers.
    #[test]
    fn channels_of_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let write = |parts: &[&str]| {
            let channel = |(i, name)| (name, vec![i as f32 + 1.0; 6]);
            let parts: Vec<_> =
                parts.iter().map(|names| names.split(' ').enumerate().map(channel).collect()).collect();
            let display = ex::IntegerBounds::from_dimensions((3, 2));
            write(&path, &parts, (3, 2), ex::Encoding::FAST_LOSSLESS, (0, 0), display);
        };
        let grey = Rgb::splat;
        let rgb = Rgb::new;
        let cases: &[(&[&str], Rgb)] = &[
            (&["R G B"], rgb(1.0, 2.0, 3.0)),
            (&["r g b"], rgb(1.0, 2.0, 3.0)),
            (&["A B G R"], rgb(4.0, 3.0, 2.0)),
            (&["R g B a"], rgb(1.0, 2.0, 3.0)),
            (&["R G B r g b"], rgb(1.0, 2.0, 3.0)),
            (&["R G B Y Z l.R l.G l.B"], rgb(1.0, 2.0, 3.0)),
            (&["Z", "l.R l.G l.B", "R G B"], rgb(1.0, 2.0, 3.0)),
            (&["Y"], grey(1.0)),
            (&["y"], grey(1.0)),
            (&["A Y"], grey(2.0)),
            (&["R"], grey(1.0)),
            (&["r"], grey(1.0)),
            (&["A R Z"], grey(2.0)),
            (&["G"], grey(1.0)),
            (&["A"], grey(1.0)),
            (&["A luminance"], grey(2.0)),
            (&["a b", "b"], grey(2.0)),
            (&["X Y Z"], rgb(-1.329_426, 2.907_394, 2.819_495)),
            (&["l.R l.G l.B"], rgb(1.0, 2.0, 3.0)),
            (&["l.m.r l.m.g l.m.b l.n.X"], rgb(1.0, 2.0, 3.0)),
            (&["l.Y"], grey(1.0)),
            (&["l.R l.Z"], grey(1.0)),
            (&["b.R b.G b.B a.R a.G a.B"], rgb(4.0, 5.0, 6.0)),
            (&["Y l.R l.G l.B"], grey(1.0)),
            (&["R l.R l.G l.B"], rgb(2.0, 3.0, 4.0)),
            (&["n.X n.Y n.Z d.Y"], grey(4.0)),
        ];
        for (parts, expected) in cases {
            write(parts);
            let read = read(&path).unwrap();
            let is_close = |p: &Rgb| p.abs_diff_eq(*expected, 1e-5);
            assert!(read.pixels.len() == 6 && read.pixels.iter().all(is_close), "{parts:?}: {read:?}");
        }
        for parts in [&["R G"][..], &["BY RY Y"], &["n.X n.Y n.Z"], &["a b c d e f g h i j"]] {
            write(parts);
            let error = error(read(&path));
            assert!(error.contains("a.exr") && error.contains("its channels are"), "{parts:?}: {error}");
        }
    }

    /// Found by fuzzing: a tile of 470 million pixels, in a file that claims to hold 1.8 GB of it.
    #[test]
    fn tiles_that_no_file_can_hold() {
        let dir = tempfile::tempdir().unwrap();
        let (path, _) = zoo(dir.path()).swap_remove(1);
        let mut bytes = fs::read(&path).unwrap();
        // Both parts have one; the second is that of 16x16.
        let name = b"tiledesc\0\x09\0\0\0\x10\0\0\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() - 4;
        bytes[at..at + 4].copy_from_slice(&[0, 0, 0, 0x07]);
        fs::write(&path, &bytes).unwrap();
        assert!(error(read(&path)).contains("too short for its tiles"));
    }

    /// As much as a header can claim, and a picture may.
    #[test]
    fn large_display_windows() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let write = |corner, at, size| {
            let display = ex::IntegerBounds::new(at, size);
            write(&path, &[vec![("Y", vec![1.0; 6])]], (3, 2), ex::Encoding::FAST_LOSSLESS, corner, display);
        };
        write((100, 50), (0, 0), (2000, 1500));
        let image = read(&path).unwrap();
        assert_eq!((image.width, image.height), (2000, 1500));
        assert_eq!(image.pixels.iter().map(|p| p.x as f64).sum::<f64>(), 6.0);
        assert_eq!(image.pixels[51 * 2000 + 102], Rgb::ONE);
        write((0, 0), (0, 0), (60_000, 60_000));
        assert!(error(read(&path)).contains("60000x60000"));
        // Far away from each other.
        write((1_000_000_000, 0), (-1_000_000_000, 0), (4, 4));
        assert_eq!(read(&path).unwrap(), Image { width: 4, height: 4, pixels: vec![Rgb::ZERO; 16] });
    }
}
