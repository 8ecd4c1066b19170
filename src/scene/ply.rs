//! Stanford PLY meshes: ASCII and binary of either byte order, properties in any order, polygons, triangle
//! strips, texture coordinates of vertices or (MeshLab) of faces' corners.
//!
//! A file is read block by block, and each block in parallel: records are laid out alike as long as their lists are of
//! equal length, which they mostly are.

use super::blocks::{Blocks, pieces};
use super::polygon::{Fans, Skipped};
use crate::image_io::srgb_to_linear;
use crate::math::first_index;
use crate::shape::{Attribute, Mesh};
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use memchr::{memchr, memchr_iter};
use rayon::prelude::*;
use std::path::Path;

/// How a mesh is read.
pub(super) struct Options<'a> {
    /// v of texture coordinates becomes 1 − v.
    pub flip_v: bool,
    pub colors: Colors,
    /// Names of attributes that are kept.
    pub attributes: &'a [String],
}

/// What numbers of attributes mean. Integers are fractions of the largest one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Colors {
    /// As they are.
    Linear,
    /// Integers are sRGB. Mitsuba 3 means the same, but 3.9.1 takes bytes for 0 to 255.
    SrgbIntegers,
    /// All are sRGB: Mitsuba 0.6.
    Srgb,
}

/// Reads a mesh, and what users are told of it.
///
/// # Errors
/// [`Error::File`] if it cannot be read or is cut off, [`Error::Scene`] with the line for mistakes in its header or in
/// ASCII data.
pub(super) fn read(path: &Path, options: &Options) -> Result<(Mesh, Option<String>)> {
    let mut blocks = Blocks::open(path)?;
    blocks.more()?;
    let at_line = |(line, message): (u32, String)| Error::Scene { file: path.into(), line, message };
    let header = Header::parse(blocks.bytes()).map_err(at_line)?;
    blocks.consume(header.length);
    let elements = &header.elements;
    let (mesh, skipped) = match header.format {
        Format::Ascii => read_elements(elements, &mut Ascii::new(blocks, header.lines + 1), options),
        Format::LittleEndian => read_elements(elements, &mut Binary::<true>(blocks), options),
        Format::BigEndian => read_elements(elements, &mut Binary::<false>(blocks), options),
    }?;
    Ok((mesh, skipped.warning(path, "number")))
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

#[derive(Debug)]
struct Property {
    name: String,
    /// Type of the count, if it is a list.
    list: Option<Type>,
    kind: Type,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Debug)]
struct Header {
    format: Format,
    elements: Vec<Element>,
    /// In bytes.
    length: usize,
    lines: u32,
}

impl Type {
    fn parse(name: &str) -> Result<Type, String> {
        Ok(match name {
            "char" | "int8" => Type::I8,
            "uchar" | "uint8" => Type::U8,
            "short" | "int16" => Type::I16,
            "ushort" | "uint16" => Type::U16,
            "int" | "int32" => Type::I32,
            "uint" | "uint32" => Type::U32,
            "float" | "float32" => Type::F32,
            "double" | "float64" => Type::F64,
            _ => return Err(format!("unknown type '{name}'")),
        })
    }

    fn size(self) -> usize {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::F64 => 8,
        }
    }
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Header, (u32, String)> {
        let mut header = Header { format: Format::Ascii, elements: Vec::new(), length: 0, lines: 0 };
        let mut has_format = false;
        loop {
            let rest = &bytes[header.length..];
            // No header line is long: a binary file without a header must not be searched to its end.
            let end = rest.iter().take(4096).position(|&b| b == b'\n');
            header.lines += 1;
            let fail = |message: &str| (header.lines, message.to_string());
            let Some(end) = end else { return Err(fail("the PLY header has no end")) };
            let line = std::str::from_utf8(&rest[..end]).map_err(|_| fail("not a PLY file"))?.trim();
            header.length += end + 1;
            if header.lines == 1 {
                if line != "ply" {
                    return Err(fail("not a PLY file"));
                }
                continue;
            }
            let words: Vec<_> = line.split_whitespace().collect();
            match words[..] {
                [] | ["comment" | "obj_info", ..] => {}
                ["format", format, "1.0"] => {
                    has_format = true;
                    header.format = match format {
                        "ascii" => Format::Ascii,
                        "binary_little_endian" => Format::LittleEndian,
                        "binary_big_endian" => Format::BigEndian,
                        _ => return Err(fail(&format!("unknown PLY format '{format}'"))),
                    };
                }
                ["element", name, count] => {
                    let count =
                        count.parse().map_err(|_| fail(&format!("'{count}' is not a number of elements")))?;
                    header.elements.push(Element { name: name.into(), count, properties: Vec::new() });
                }
                ["property", ref words @ ..] => {
                    let property = match *words {
                        ["list", count, kind, name] => {
                            let count = Type::parse(count).map_err(|m| fail(&m))?;
                            if matches!(count, Type::F32 | Type::F64) {
                                return Err(fail("a list cannot be counted in floats"));
                            }
                            let kind = Type::parse(kind).map_err(|m| fail(&m))?;
                            Property { name: name.into(), list: Some(count), kind }
                        }
                        [kind, name] => {
                            let kind = Type::parse(kind).map_err(|m| fail(&m))?;
                            Property { name: name.into(), list: None, kind }
                        }
                        _ => return Err(fail("unclear property")),
                    };
                    match header.elements.last_mut() {
                        Some(element) => element.properties.push(property),
                        None => return Err(fail("a property before any element")),
                    }
                }
                ["end_header"] if has_format => return Ok(header),
                ["end_header"] => return Err(fail("the PLY header names no format")),
                _ => return Err(fail(&format!("unclear header line '{line}'"))),
            }
        }
    }
}

/// Numbers from a file, read on as they are needed. They are stored in units: bytes, or in ASCII whole numbers.
trait Source {
    type Unit: Copy + Send + Sync;

    /// How many units a number takes.
    fn size(kind: Type) -> usize;
    /// The number at the beginning of `units`.
    fn value(units: &[Self::Unit], kind: Type) -> f64;
    /// That number as an index, [`NONE`] if it is none.
    fn index(units: &[Self::Unit], kind: Type) -> u32;
    /// What has been read and not been used.
    fn units(&self) -> &[Self::Unit];
    fn consume(&mut self, count: usize);
    /// Reads on. `false` at the end of the file.
    fn more(&mut self) -> Result<bool>;
    /// The most units that can still come, if the file's length is known.
    fn left(&self) -> Option<u64>;
    /// An error at one of [`Source::units`].
    fn error(&self, at: usize, message: String) -> Error;
}

/// No index.
const NONE: u32 = u32::MAX;

fn index_of(value: f64) -> u32 {
    let index = value as u32;
    if index as f64 == value { index } else { NONE }
}

struct Binary<const LITTLE: bool>(Blocks);

/// The first bytes, in little-endian order.
fn first<const N: usize, const LITTLE: bool>(bytes: &[u8]) -> [u8; N] {
    let mut first = bytes.first_chunk().copied().unwrap_or([0; N]);
    if !LITTLE {
        first.reverse();
    }
    first
}

impl<const LITTLE: bool> Source for Binary<LITTLE> {
    type Unit = u8;

    fn size(kind: Type) -> usize {
        kind.size()
    }

    fn value(units: &[u8], kind: Type) -> f64 {
        match kind {
            Type::I8 => i8::from_le_bytes(first::<1, LITTLE>(units)) as f64,
            Type::U8 => u8::from_le_bytes(first::<1, LITTLE>(units)) as f64,
            Type::I16 => i16::from_le_bytes(first::<2, LITTLE>(units)) as f64,
            Type::U16 => u16::from_le_bytes(first::<2, LITTLE>(units)) as f64,
            Type::I32 => i32::from_le_bytes(first::<4, LITTLE>(units)) as f64,
            Type::U32 => u32::from_le_bytes(first::<4, LITTLE>(units)) as f64,
            Type::F32 => f32::from_le_bytes(first::<4, LITTLE>(units)) as f64,
            Type::F64 => f64::from_le_bytes(first::<8, LITTLE>(units)),
        }
    }

    fn index(units: &[u8], kind: Type) -> u32 {
        match kind {
            Type::U32 => u32::from_le_bytes(first::<4, LITTLE>(units)),
            Type::I32 => {
                let index = i32::from_le_bytes(first::<4, LITTLE>(units));
                u32::try_from(index).unwrap_or(NONE)
            }
            _ => index_of(Self::value(units, kind)),
        }
    }

    fn units(&self) -> &[u8] {
        self.0.bytes()
    }

    fn consume(&mut self, count: usize) {
        self.0.consume(count);
    }

    fn more(&mut self) -> Result<bool> {
        self.0.more()
    }

    fn left(&self) -> Option<u64> {
        self.0.left()
    }

    fn error(&self, _: usize, message: String) -> Error {
        self.0.error(message)
    }
}

struct Ascii {
    blocks: Blocks,
    numbers: Numbers,
    /// How many of them have been used.
    used: usize,
    /// The line of what comes next in `blocks`.
    line: u32,
}

/// Numbers with their lines, up to the end of a piece of text or to what is no number.
#[derive(Default)]
struct Numbers {
    values: Vec<f64>,
    lines: Vec<u32>,
    bad: Option<(u32, String)>,
}

impl Numbers {
    fn parse(text: &[u8], mut line: u32) -> Numbers {
        let mut numbers = Numbers::default();
        for row in text.split(|&b| b == b'\n') {
            for token in row.split(|b| b.is_ascii_whitespace()).filter(|t| !t.is_empty()) {
                let token = std::str::from_utf8(token).unwrap_or("?");
                let Ok(value) = token.parse() else {
                    let message = format!("'{}' is not a number", token.chars().take(40).collect::<String>());
                    numbers.bad = Some((line, message));
                    return numbers;
                };
                numbers.values.push(value);
                numbers.lines.push(line);
            }
            line = line.saturating_add(1);
        }
        numbers
    }
}

impl Ascii {
    fn new(blocks: Blocks, line: u32) -> Ascii {
        Ascii { blocks, numbers: Numbers::default(), used: 0, line }
    }

    /// Parses the first `length` bytes of what has been read.
    fn parse(&mut self, length: usize) {
        let pieces: Vec<&[u8]> = pieces(&self.blocks.bytes()[..length], line_end).collect();
        let newlines = |text: &&[u8]| memchr_iter(b'\n', text).count() as u32;
        let counts: Vec<u32> = pieces.par_iter().map(newlines).collect();
        let mut starts = Vec::with_capacity(pieces.len());
        for count in counts {
            starts.push(self.line);
            self.line = self.line.saturating_add(count);
        }
        let parsed = pieces.par_iter().zip(starts).map(|(text, line)| Numbers::parse(text, line));
        for numbers in parsed.collect::<Vec<_>>() {
            self.numbers.values.extend(numbers.values);
            self.numbers.lines.extend(numbers.lines);
            if numbers.bad.is_some() {
                self.numbers.bad = numbers.bad;
                break;
            }
        }
        self.blocks.consume(length);
    }
}

/// Where the first line ends that ends at or after `from`.
fn line_end(text: &[u8], from: usize) -> Option<usize> {
    memchr(b'\n', &text[from..]).map(|i| from + i + 1)
}

impl Source for Ascii {
    type Unit = f64;

    fn size(_: Type) -> usize {
        1
    }

    fn value(units: &[f64], _: Type) -> f64 {
        units.first().copied().unwrap_or(f64::NAN)
    }

    fn index(units: &[f64], kind: Type) -> u32 {
        index_of(Self::value(units, kind))
    }

    fn units(&self) -> &[f64] {
        &self.numbers.values[self.used..]
    }

    fn consume(&mut self, count: usize) {
        self.used += count;
    }

    fn more(&mut self) -> Result<bool> {
        if let Some((line, message)) = self.numbers.bad.take() {
            return Err(Error::Scene { file: self.blocks.path().into(), line, message });
        }
        self.numbers.values.drain(..self.used);
        self.numbers.lines.drain(..self.used);
        self.used = 0;
        let before = self.numbers.values.len();
        loop {
            let more = self.blocks.more()?;
            let bytes = self.blocks.bytes();
            // A number may go on in the next block.
            let last = if more { bytes.iter().rposition(u8::is_ascii_whitespace) } else { None };
            let whole = if more { last.map_or(0, |p| p + 1) } else { bytes.len() };
            self.parse(whole);
            if self.numbers.values.len() > before || self.numbers.bad.is_some() {
                return Ok(true);
            }
            if !more {
                return Ok(false);
            }
        }
    }

    fn left(&self) -> Option<u64> {
        Some(self.units().len() as u64 + self.blocks.left()?)
    }

    fn error(&self, at: usize, message: String) -> Error {
        let line = self.numbers.lines.get(self.used + at).or(self.numbers.lines.last());
        Error::Scene { file: self.blocks.path().into(), line: line.copied().unwrap_or(self.line), message }
    }
}

/// A number in a record: how many units from its beginning.
#[derive(Clone, Copy)]
struct Field {
    offset: usize,
    kind: Type,
}

impl Field {
    fn of<S: Source>(self, record: &[S::Unit]) -> f64 {
        S::value(record.get(self.offset..).unwrap_or(&[]), self.kind)
    }
}

/// Where in a record its numbers are.
#[derive(Default)]
struct Layout {
    size: usize,
    /// For each property: its value, or the first in its list.
    fields: Vec<Field>,
    /// Lengths of its lists, and what they are.
    counts: Vec<(Field, u64)>,
}

/// What is wrong, and at which unit.
type Mistake = (usize, String);

impl Layout {
    /// Becomes that of the record at the beginning of `units`. `false` if it does not end there.
    fn update<S: Source>(&mut self, element: &Element, units: &[S::Unit]) -> Result<bool, Mistake> {
        self.fields.clear();
        self.counts.clear();
        let mut at = 0usize;
        for property in &element.properties {
            let mut count = 1;
            if let Some(kind) = property.list {
                if at.saturating_add(S::size(kind)) > units.len() {
                    return Ok(false);
                }
                let field = Field { offset: at, kind };
                count = list_length(field.of::<S>(units)).map_err(|message| (at, message))?;
                self.counts.push((field, count));
                at += S::size(kind);
            }
            self.fields.push(Field { offset: at, kind: property.kind });
            let length = usize::try_from(count).unwrap_or(usize::MAX).saturating_mul(S::size(property.kind));
            at = at.saturating_add(length);
        }
        self.size = at;
        Ok(at <= units.len())
    }

    /// How many records, at most `limit`, are of this layout one after the other.
    fn run<S: Source>(&self, units: &[S::Unit], limit: u64) -> usize {
        let whole = (units.len() / self.size).min(usize::try_from(limit).unwrap_or(usize::MAX));
        let differs = |record: &[S::Unit]| self.counts.iter().any(|(f, n)| f.of::<S>(record) != *n as f64);
        if self.counts.is_empty() {
            return whole;
        }
        // Where lengths alternate, runs are short and not worth several threads.
        let short = whole.min(SERIAL);
        let record = |i: &usize| &units[i * self.size..][..self.size];
        let first = (0..short).find(|i| differs(record(i)));
        let first = first.or_else(|| {
            let chunks = (short..whole).into_par_iter().step_by(SERIAL);
            let chunk = |start: usize| start..whole.min(start + SERIAL);
            chunks.map(|start| chunk(start).find(|i| differs(record(i)))).find_first(Option::is_some)?
        });
        first.unwrap_or(whole)
    }
}

/// So few records are read by one thread.
const SERIAL: usize = 2048;

fn list_length(count: f64) -> Result<u64, String> {
    if count >= 0.0 && count.fract() == 0.0 {
        Ok(count as u64)
    } else {
        Err(format!("a list of {count} values"))
    }
}

/// Gives `read` all records of an element, as many at a time as are laid out alike, and the number of the first.
fn for_each_run<S: Source>(
    source: &mut S,
    element: &Element,
    mut read: impl FnMut(&Layout, &[S::Unit], u64) -> Result<(), Mistake>,
) -> Result<()> {
    let mut layout = Layout::default();
    let mut done = 0;
    while done < element.count {
        let fits = layout.update::<S>(element, source.units());
        if !fits.map_err(|(at, message)| source.error(at, message))? {
            if !source.more()? {
                return Err(source.error(source.units().len(), "the file ends too early".into()));
            }
            continue;
        }
        let n = layout.run::<S>(source.units(), element.count - done);
        let end = n * layout.size;
        read(&layout, &source.units()[..end], done).map_err(|(at, message)| source.error(at, message))?;
        source.consume(end);
        done += n as u64;
    }
    Ok(())
}

/// Adds what `f` makes of each of `count` records.
fn extend<T: Send>(to: &mut Vec<T>, count: usize, f: impl Fn(usize) -> T + Sync + Send) {
    if count < SERIAL {
        to.extend((0..count).map(f))
    } else {
        to.par_extend((0..count).into_par_iter().map(f))
    }
}

fn read_elements<S: Source>(
    elements: &[Element],
    source: &mut S,
    options: &Options,
) -> Result<(Mesh, Skipped)> {
    let mut mesh = Mesh::default();
    let mut faces = Faces::default();
    let mut seen: Vec<&str> = Vec::new();
    for element in elements {
        let least: usize = element.properties.iter().map(|p| S::size(p.list.unwrap_or(p.kind))).sum();
        if least == 0 {
            continue;
        }
        // A header can promise anything: believe it only as far as the file is long.
        let most = source.left().map(|left| left / least as u64);
        if most.is_some_and(|most| element.count > most) {
            let Element { name, count, .. } = element;
            let message =
                format!("the file is too short for the {count} elements '{name}' that its header promises");
            return Err(source.error(0, message));
        }
        let expected = if most.is_some() { element.count as usize } else { 0 };
        let name = element.name.as_str();
        if seen.contains(&name) {
            return Err(source.error(0, format!("the element '{name}' comes twice")));
        }
        match name {
            "vertex" => read_vertices(element, source, options, expected, &mut mesh)?,
            "face" => read_faces(element, source, options, expected, &mut mesh, &mut faces)?,
            "tristrips" => read_strips(element, source, &mut mesh)?,
            _ => {
                for_each_run(source, element, |_, _, _| Ok(()))?;
                continue;
            }
        }
        seen.push(name);
    }
    if !seen.contains(&"vertex") || seen.len() < 2 {
        return Err(source.error(0, "the file holds no vertices or no faces: not a mesh".into()));
    }
    faces.finish(&mut mesh);
    Ok((mesh, faces.skipped))
}

/// The properties of these names, if all are there and no lists.
fn find<const N: usize>(element: &Element, names: [&[&str]; N]) -> Option<[usize; N]> {
    let found = names.map(|names| {
        element.properties.iter().rposition(|p| p.list.is_none() && names.contains(&p.name.as_str()))
    });
    found.iter().all(Option::is_some).then(|| found.map(Option::unwrap_or_default))
}

/// Properties that make an attribute together: one, or a colour's three.
struct Group {
    name: String,
    properties: Vec<usize>,
    /// Of the properties.
    kind: Type,
    colors: Colors,
}

impl Group {
    /// The value in a record.
    fn of<S: Source>(&self, layout: &Layout, record: &[S::Unit]) -> Vec3 {
        let number = |property: usize| self.decode(layout.fields[property].of::<S>(record));
        match self.properties[..] {
            [r, g, b] => Vec3::new(number(r), number(g), number(b)),
            [one, ..] => Vec3::splat(number(one)),
            [] => Vec3::ZERO,
        }
    }

    /// Integers are fractions of the largest.
    fn decode(&self, value: f64) -> f32 {
        let largest = match self.kind {
            Type::I8 => i8::MAX as f64,
            Type::U8 => u8::MAX as f64,
            Type::I16 => i16::MAX as f64,
            Type::U16 => u16::MAX as f64,
            Type::I32 => i32::MAX as f64,
            Type::U32 => u32::MAX as f64,
            Type::F32 | Type::F64 => 1.0,
        };
        let fraction = (value / largest) as f32;
        let is_float = matches!(self.kind, Type::F32 | Type::F64);
        match self.colors {
            Colors::Linear => fraction,
            Colors::SrgbIntegers if is_float => fraction,
            Colors::SrgbIntegers | Colors::Srgb => srgb_to_linear(fraction),
        }
    }
}

/// Attributes as Mitsuba 3 finds them, those that are asked for. `r`, `g`, `b` or `red`, `green`, `blue` are
/// `vertex_color` or `face_color`; neighbours `NAME_x`, `NAME_y`, `NAME_z` (or 0, 1, 2 or 1, 2, 3) or a lone `NAME_x` are
/// `vertex_NAME`; `NAME_r`, `NAME_g`, `NAME_b` are `vertex_NAME_color`.
fn groups(element: &Element, options: &Options) -> Vec<Group> {
    const OTHERS: [&str; 20] = [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        "u",
        "v",
        "s",
        "t",
        "texture_u",
        "texture_v",
        "r",
        "g",
        "b",
        "a",
        "red",
        "green",
        "blue",
        "alpha",
    ];
    let mut found: Vec<(String, Vec<usize>)> = Vec::new();
    let color = find(element, [&["r"], &["g"], &["b"]]);
    let color = color.or_else(|| find(element, [&["red"], &["green"], &["blue"]]));
    found.extend(color.map(|properties| ("color".into(), properties.to_vec())));
    let others = element.properties.iter().enumerate().filter(|(_, p)| !OTHERS.contains(&p.name.as_str()));
    let split = |p: &Property| -> Option<(String, String)> {
        let (name, postfix) = p.name.rsplit_once('_').filter(|_| p.list.is_none())?;
        Some((name.into(), postfix.into()))
    };
    let others: Vec<_> = others.map(|(i, p)| (i, split(p))).collect();
    let same = |a: &Option<(String, String)>, b: &Option<(String, String)>| match (a, b) {
        (Some(a), Some(b)) => a.0 == b.0,
        _ => false,
    };
    for run in others.chunk_by(|(_, a), (_, b)| same(a, b)) {
        let Some((_, Some((name, _)))) = run.first() else { continue };
        let postfixes: Vec<_> = run.iter().filter_map(|(_, s)| Some(s.as_ref()?.1.as_str())).collect();
        let is_valid = |all: &&[&str; 3]| postfixes == all[..] || postfixes == all[..1];
        let schemes = [["x", "y", "z"], ["r", "g", "b"], ["0", "1", "2"], ["1", "2", "3"]];
        let Some(scheme) = schemes.iter().find(is_valid) else { continue };
        let name = if scheme[0] == "r" { format!("{name}_color") } else { name.clone() };
        if found.iter().all(|(other, _)| *other != name) {
            found.push((name, run.iter().map(|(i, _)| *i).collect()));
        }
    }
    let groups = found.into_iter().map(|(name, properties)| Group {
        name: format!("{}_{name}", element.name),
        kind: element.properties[properties[0]].kind,
        properties,
        colors: options.colors,
    });
    groups.filter(|group| options.attributes.contains(&group.name)).collect()
}

fn read_vertices<S: Source>(
    element: &Element,
    source: &mut S,
    options: &Options,
    expected: usize,
    mesh: &mut Mesh,
) -> Result<()> {
    let Some(xyz) = find(element, [&["x"], &["y"], &["z"]]) else {
        return Err(source.error(0, "the vertices have no x, y, z".into()));
    };
    let normal = find(element, [&["nx"], &["ny"], &["nz"]]);
    let uv = find(element, [&["u", "s", "texture_u"], &["v", "t", "texture_v"]]);
    mesh.positions.reserve_exact(expected);
    mesh.normals.reserve_exact(if normal.is_some() { expected } else { 0 });
    mesh.uvs.reserve_exact(if uv.is_some() { expected } else { 0 });
    let groups = groups(element, options);
    let mut attributes = vec![Vec::new(); groups.len()];
    for_each_run(source, element, |layout, units, first| {
        let count = units.len() / layout.size;
        let number = |i: usize, property: usize| -> f32 {
            layout.fields[property].of::<S>(&units[i * layout.size..]) as f32
        };
        let vec3 = |i, properties: [usize; 3]| Vec3::from_array(properties.map(|p| number(i, p)));
        let start = mesh.positions.len();
        extend(&mut mesh.positions, count, |i| vec3(i, xyz));
        if let Some(i) = first_index(&mesh.positions[start..], |p| !p.is_finite()) {
            return Err((i * layout.size, format!("vertex {} is not finite", first + i as u64)));
        }
        if let Some(normal) = normal {
            extend(&mut mesh.normals, count, |i| vec3(i, normal));
        }
        if let Some([u, v]) = uv {
            let flip = |v| if options.flip_v { 1.0 - v } else { v };
            let start = mesh.uvs.len();
            extend(&mut mesh.uvs, count, |i| Vec2::new(number(i, u), flip(number(i, v))));
            if let Some(i) = first_index(&mesh.uvs[start..], |uv| !uv.is_finite()) {
                let vertex = first + i as u64;
                return Err((
                    i * layout.size,
                    format!("texture coordinates of vertex {vertex} are not finite"),
                ));
            }
        }
        for (group, values) in groups.iter().zip(&mut attributes) {
            extend(values, count, |i| group.of::<S>(layout, &units[i * layout.size..]));
        }
        Ok(())
    })?;
    add_attributes(mesh, groups, attributes);
    Ok(())
}

fn add_attributes(mesh: &mut Mesh, groups: Vec<Group>, values: Vec<Vec<Vec3>>) {
    let named = groups.into_iter().zip(values).map(|(group, values)| Attribute { name: group.name, values });
    mesh.attributes.extend(named);
}

/// What faces are beyond triangles.
#[derive(Default)]
struct Faces {
    fans: Fans,
    skipped: Skipped,
    /// Texture coordinates of triangles' corners, if any face has them.
    uvs: Vec<[Vec2; 3]>,
    has_uvs: bool,
}

/// A list of an element: its number among properties, and among lists.
fn find_list(element: &Element, names: &[&str]) -> Option<(usize, usize)> {
    let lists = element.properties.iter().enumerate().filter(|(_, p)| p.list.is_some()).zip(0..);
    let mut found =
        lists.filter(|((_, p), _)| names.contains(&p.name.as_str())).map(|((i, _), nth)| (i, nth));
    found.next().filter(|_| found.next().is_none())
}

/// A list in records of one layout that follow each other.
struct List<'a, S: Source> {
    units: &'a [S::Unit],
    record: usize,
    field: Field,
    length: usize,
}

impl<'a, S: Source> List<'a, S> {
    fn new(layout: &Layout, units: &'a [S::Unit], (property, nth): (usize, usize)) -> Self {
        let length = layout.counts[nth].1 as usize;
        List { units, record: layout.size, field: layout.fields[property], length }
    }

    /// The unit where an item of a record's list is.
    fn at(&self, record: usize, item: usize) -> usize {
        record * self.record + self.field.offset + item * S::size(self.field.kind)
    }

    fn index(&self, record: usize, item: usize) -> u32 {
        S::index(&self.units[self.at(record, item)..], self.field.kind)
    }

    fn value(&self, record: usize, item: usize) -> f64 {
        S::value(&self.units[self.at(record, item)..], self.field.kind)
    }
}

const INDICES: [&str; 2] = ["vertex_index", "vertex_indices"];

fn read_faces<S: Source>(
    element: &Element,
    source: &mut S,
    options: &Options,
    expected: usize,
    mesh: &mut Mesh,
    faces: &mut Faces,
) -> Result<()> {
    let Some(list) = find_list(element, &INDICES) else {
        return Err(source.error(0, "the faces have no list 'vertex_indices'".into()));
    };
    let uv_list = find_list(element, &["texcoord"]);
    // Each has three corners at least.
    let most = source.left().unwrap_or(0) / (3 * S::size(element.properties[list.0].kind) as u64);
    mesh.triangles.reserve_exact(expected.min(most as usize));
    let groups = groups(element, options);
    let mut attributes = vec![Vec::new(); groups.len()];
    for_each_run(source, element, |layout, units, first| {
        let count = units.len() / layout.size;
        let indices = List::<S>::new(layout, units, list);
        let corners = indices.length;
        if corners < 3 {
            faces.skipped.add(count, first);
            return Ok(());
        }
        // Polygons become fans.
        let fan = corners - 2;
        let start = mesh.triangles.len();
        extend(&mut mesh.triangles, count * fan, |i| {
            let (face, k) = (i / fan, i % fan);
            [0, k + 1, k + 2].map(|corner| indices.index(face, corner))
        });
        faces.fans.push(start, corners, count);
        for (group, values) in groups.iter().zip(&mut attributes) {
            extend(values, count * fan, |i| group.of::<S>(layout, &units[i / fan * layout.size..]));
        }
        if let Some(uv_list) = uv_list {
            let numbers = List::<S>::new(layout, units, uv_list);
            let has_uvs = numbers.length > 0;
            if has_uvs && numbers.length != 2 * corners {
                let (n, wanted) = (numbers.length, 2 * corners);
                let message =
                    format!("face {first} has {n} numbers in 'texcoord': {corners} corners need {wanted}");
                return Err((layout.counts[uv_list.1].0.offset, message));
            }
            faces.has_uvs |= has_uvs;
            let uv = |face, corner| {
                let [u, v] = [0, 1].map(|i| numbers.value(face, 2 * corner + i) as f32);
                Vec2::new(u, if options.flip_v { 1.0 - v } else { v })
            };
            let of_corner = |face, corner| if has_uvs { uv(face, corner) } else { Vec2::ZERO };
            let start = faces.uvs.len();
            extend(&mut faces.uvs, count * fan, |i| {
                let (face, k) = (i / fan, i % fan);
                [0, k + 1, k + 2].map(|corner| of_corner(face, corner))
            });
            if let Some(i) = first_index(&faces.uvs[start..], |uvs| !uvs.iter().all(|uv| uv.is_finite())) {
                let face = i / fan;
                let message = format!("texture coordinates of face {} are not finite", first + face as u64);
                return Err((face * layout.size, message));
            }
        }
        let bad = first_index(&mesh.triangles[start..], |t| t.contains(&NONE));
        let Some(face) = bad.map(|i| i / fan) else { return Ok(()) };
        let corner = (0..corners).find(|&k| indices.index(face, k) == NONE).unwrap_or(0);
        let value = indices.value(face, corner);
        Err((indices.at(face, corner), format!("face {} names vertex {value}", first + face as u64)))
    })?;
    add_attributes(mesh, groups, attributes);
    Ok(())
}

/// Strips: each vertex makes a triangle with the two before it, every other one turned around; −1 ends a
/// strip.
fn read_strips<S: Source>(element: &Element, source: &mut S, mesh: &mut Mesh) -> Result<()> {
    let Some(list) = find_list(element, &INDICES) else {
        return Err(source.error(0, "the strips have no list 'vertex_indices'".into()));
    };
    for_each_run(source, element, |layout, units, first| {
        let indices = List::<S>::new(layout, units, list);
        for strip in 0..units.len() / layout.size {
            let (mut a, mut b, mut before) = (NONE, NONE, 0);
            for item in 0..indices.length {
                let c = indices.index(strip, item);
                if c == NONE {
                    let value = indices.value(strip, item);
                    if value != -1.0 && value != NONE as f64 {
                        let message = format!("strip {} names vertex {value}", first + strip as u64);
                        return Err((indices.at(strip, item), message));
                    }
                    before = 0;
                    continue;
                }
                // Strips are joined by triangles that have one vertex twice.
                if before >= 2 && a != b && b != c && c != a {
                    mesh.triangles.push(if before % 2 == 0 { [a, b, c] } else { [b, a, c] });
                }
                (a, b, before) = (b, c, before + 1);
            }
        }
        Ok(())
    })
}

impl Faces {
    fn finish(&mut self, mesh: &mut Mesh) {
        let Mesh { positions, triangles, .. } = mesh;
        let position = |vertex: u32| positions.get(vertex as usize).copied();
        if !self.has_uvs {
            return self.fans.fit(triangles, position);
        }
        // Strips have none.
        self.uvs.resize(triangles.len(), [Vec2::ZERO; 3]);
        let with_uvs = |(t, uvs): (&[u32; 3], &[Vec2; 3])| [0, 1, 2].map(|k| (t[k], uvs[k]));
        let mut corners: Vec<_> = triangles.iter().zip(&self.uvs).map(with_uvs).collect();
        self.fans.fit(&mut corners, |(vertex, _)| position(vertex));
        give_uvs(mesh, &corners);
    }
}

/// Gives corners, of vertices, texture coordinates: there is one vertex for each different pair.
fn give_uvs(mesh: &mut Mesh, corners: &[[(u32, Vec2); 3]]) {
    let count = mesh.positions.len();
    if corners.iter().flatten().any(|(vertex, _)| *vertex as usize >= count) {
        // An error: the mesh is refused when it is placed.
        return;
    }
    let mut first = vec![NONE; count];
    // Those of one vertex are chained: (vertex, texture coordinates, next).
    let mut pairs: Vec<(u32, Vec2, u32)> = Vec::new();
    for (triangle, corners) in mesh.triangles.iter_mut().zip(corners) {
        *triangle = corners.map(|(vertex, uv)| {
            let mut pair = first[vertex as usize];
            while pair != NONE && pairs[pair as usize].1 != uv {
                pair = pairs[pair as usize].2;
            }
            if pair == NONE {
                pair = pairs.len() as u32;
                pairs.push((vertex, uv, std::mem::replace(&mut first[vertex as usize], pair)));
            }
            pair
        });
    }
    let of_pairs = |values: &mut Vec<Vec3>| {
        if !values.is_empty() {
            *values = pairs.iter().map(|(vertex, ..)| values[*vertex as usize]).collect();
        }
    };
    of_pairs(&mut mesh.positions);
    of_pairs(&mut mesh.normals);
    mesh.attributes.iter_mut().filter(|a| a.of_vertices()).for_each(|a| of_pairs(&mut a.values));
    mesh.uvs = pairs.iter().map(|(_, uv, _)| *uv).collect();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<Mesh> {
        read_colors(bytes, Colors::SrgbIntegers, &[])
    }

    fn read_colors(bytes: &[u8], colors: Colors, names: &[&str]) -> Result<Mesh> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let attributes: Vec<_> = names.iter().map(|name| name.to_string()).collect();
        read(file.path(), &Options { flip_v: false, colors, attributes: &attributes }).map(|(mesh, _)| mesh)
    }

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\nproperty float t\nproperty float s\n\
        property double z\nproperty float x\nproperty float y\nproperty uchar red\nelement edge 1\n\
        property list uchar int e\nelement face 1\nproperty uchar flag\nproperty list uchar int vertex_index\nend_header\n\
        .1 .2 3 1 2 255\n.1 .2 3 1 2 255\n.1 .2 3 1 2 255\n.3 .4 6 4 5 0\n2 7 8\n9 4 0 1 2 3\n";

    fn binary(little: bool) -> Vec<u8> {
        let order = if little { "little" } else { "big" };
        let mut bytes = ASCII.replace("ascii", &format!("binary_{order}_endian")).into_bytes();
        bytes.truncate(bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11);
        fn put<const N: usize>(bytes: &mut Vec<u8>, little: bool, mut value: [u8; N]) {
            if !little {
                value.reverse();
            }
            bytes.extend(value);
        }
        for row in [[0.1, 0.2, 3.0, 1.0, 2.0, 255.0]; 3].iter().chain(&[[0.3, 0.4, 6.0, 4.0, 5.0, 0.0]]) {
            for (i, v) in row.iter().enumerate() {
                match i {
                    2 => put(&mut bytes, little, f64::to_le_bytes(*v)),
                    5 => bytes.push(*v as u8),
                    _ => put(&mut bytes, little, f32::to_le_bytes(*v as f32)),
                }
            }
        }
        bytes.push(2);
        [7i32, 8].iter().for_each(|v| put(&mut bytes, little, v.to_le_bytes()));
        bytes.extend([9, 4]);
        [0i32, 1, 2, 3].iter().for_each(|v| put(&mut bytes, little, v.to_le_bytes()));
        bytes
    }

    #[test]
    fn all_formats_agree() {
        for bytes in [ASCII.as_bytes().to_vec(), binary(true), binary(false)] {
            let mesh = read_bytes(&bytes).unwrap();
            assert_eq!(mesh.positions[3], Vec3::new(4.0, 5.0, 6.0));
            assert_eq!(mesh.uvs[3], Vec2::new(0.4, 0.3));
            assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
            assert!(mesh.normals.is_empty());
        }
    }

    /// A square whose vertices have these properties and whose two triangles have those.
    fn square(vertex: &[(&str, [f64; 4])], face: &[(&str, [f64; 2])]) -> Vec<u8> {
        let names = |properties: &mut dyn Iterator<Item = &str>| {
            properties.map(|p| format!("property {p}\n")).collect::<String>()
        };
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}\
             element face 2\nproperty list uchar int vertex_index\n{}end_header\n",
            names(&mut vertex.iter().map(|p| p.0)),
            names(&mut face.iter().map(|p| p.0))
        );
        for (i, p) in ["-1 -1 0", "1 -1 0", "1 1 0", "-1 1 0"].iter().enumerate() {
            let values: String = vertex.iter().map(|(_, v)| format!(" {}", v[i])).collect();
            text += &format!("{p}{values}\n");
        }
        for (i, t) in ["3 0 1 2", "3 0 2 3"].iter().enumerate() {
            let values: String = face.iter().map(|(_, v)| format!(" {}", v[i])).collect();
            text += &format!("{t}{values}\n");
        }
        text.into_bytes()
    }

    /// What Mitsuba 3.9.1 calls them, and which it ignores.
    #[test]
    fn attributes_are_named_as_in_mitsuba() {
        let every =
            ["color", "foo", "foo_color", "bar", "red"].map(|n| [format!("vertex_{n}"), format!("face_{n}")]);
        let every: Vec<&str> = every.iter().flatten().map(String::as_str).collect();
        for (properties, expected) in [
            ("float b,float g,float r,float a", "vertex_color=3 2 1"),
            ("float red,float green,float blue", "vertex_color=1 2 3"),
            ("float red,float green", ""),
            ("float foo_x", "vertex_foo=1 1 1"),
            ("float foo_r", "vertex_foo_color=1 1 1"),
            ("float foo_r,float foo_g,float foo_b", "vertex_foo_color=1 2 3"),
            ("float foo_0,float foo_1", ""),
            ("float foo_0,float foo_1,float foo_2", "vertex_foo=1 2 3"),
            ("float foo_1,float foo_2,float foo_3", "vertex_foo=1 2 3"),
            ("float foo_1,float foo_2,float foo_3,float foo_4", ""),
            ("float foo_x,float foo_z,float foo_y", ""),
            ("float quality,float foo_x", "vertex_foo=2 2 2"),
            ("float foo_x,float bar_x,float foo_y", "vertex_foo=1 1 1,vertex_bar=2 2 2"),
            ("float color_x,float color_y,float color_z", "vertex_color=1 2 3"),
        ] {
            let vertex: Vec<_> =
                properties.split(',').enumerate().map(|(i, p)| (p, [i as f64 + 1.0; 4])).collect();
            let mesh = read_colors(&square(&vertex, &[]), Colors::SrgbIntegers, &every).unwrap();
            let found = mesh.attributes.iter().map(|a| {
                let v = a.values[3];
                format!("{}={} {} {}", a.name, v.x, v.y, v.z)
            });
            assert_eq!(found.collect::<Vec<_>>().join(","), expected, "{properties}");
        }
    }

    /// Expected values from Mitsuba 3.9.1, but for bytes.
    #[test]
    fn integers_are_srgb() {
        for (kind, value, expected) in [
            ("ushort", 1000.0, 0.001_181_04),
            ("ushort", 30000.0, 0.177_014_83),
            ("int", 1000.0, 3.604_189_7e-8),
            ("char", -128.0, -0.078_008_82),
            ("char", 100.0, 0.582_693_5),
            ("uchar", 51.0, 0.033_104_77),
            ("float", 0.25, 0.25),
        ] {
            let bytes = square(&[(&format!("{kind} foo_x"), [value; 4])], &[]);
            let x = |colors| read_colors(&bytes, colors, &["vertex_foo"]).unwrap().attributes[0].values[0].x;
            let found = x(Colors::SrgbIntegers);
            assert!((found - expected).abs() <= 1e-6 * expected.abs(), "{kind} {value}: {found}");
        }
        let bytes = square(&[("uchar foo_x", [51.0; 4]), ("float bar_x", [0.5; 4])], &[]);
        let both = |colors| {
            let mesh = read_colors(&bytes, colors, &["vertex_foo", "vertex_bar"]).unwrap();
            [0, 1].map(|i| mesh.attributes[i].values[0].x)
        };
        assert_eq!(both(Colors::Linear), [0.2, 0.5]);
        assert!((both(Colors::Srgb)[1] - 0.214_041).abs() < 1e-6);
    }

    #[test]
    fn faces_have_attributes_too() {
        let quad = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
            element face 2\nproperty list uchar int vertex_index\nproperty float r\nproperty float g\nproperty float b\n\
            end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 .1 .2 .3\n3 0 1 2 .4 .5 .6\n";
        let mesh = read_colors(quad.as_bytes(), Colors::SrgbIntegers, &["face_color"]).unwrap();
        let [a, b] = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.4, 0.5, 0.6)];
        assert_eq!(mesh.attributes[0].values, [a, a, b]);
        assert!(read_bytes(quad.as_bytes()).unwrap().attributes.is_empty(), "nobody asked");
    }

    /// Vertices, and elements with lists of indices (`int`) and perhaps of texture coordinates, in all three
    /// formats.
    fn formats(vertices: &[&[f32]], elements: &[(&str, &[Vec<Vec<f32>>])]) -> [Vec<u8>; 3] {
        ["ascii", "binary_little_endian", "binary_big_endian"].map(|format| {
            let names = ["x", "y", "z", "u", "v"];
            let mut header = format!("ply\nformat {format} 1.0\nelement vertex {}\n", vertices.len());
            let of_vertex = names[..vertices[0].len()].iter();
            header += &of_vertex.map(|name| format!("property float {name}\n")).collect::<String>();
            let float = |value: f32| match format {
                "ascii" => format!("{value} ").into_bytes(),
                "binary_big_endian" => value.to_be_bytes().to_vec(),
                _ => value.to_le_bytes().to_vec(),
            };
            let int = |value: f32| match format {
                "ascii" => format!("{value} ").into_bytes(),
                "binary_big_endian" => (value as i32).to_be_bytes().to_vec(),
                _ => (value as i32).to_le_bytes().to_vec(),
            };
            let mut bytes: Vec<u8> = vertices.iter().copied().flatten().flat_map(|v| float(*v)).collect();
            for (name, records) in elements {
                header += &format!("element {name} {}\n", records.len());
                header += "property list uchar int vertex_indices\n";
                if records[0].len() > 1 {
                    header += "property list uchar float texcoord\nproperty int texnumber\n";
                }
                for record in *records {
                    for (i, list) in record.iter().enumerate() {
                        let count = list.len();
                        bytes.extend(if format == "ascii" {
                            format!("{count} ").into_bytes()
                        } else {
                            vec![count as u8]
                        });
                        bytes.extend(list.iter().flat_map(|v| if i == 0 { int(*v) } else { float(*v) }));
                        bytes.extend(if i == 0 { Vec::new() } else { int(7.0) });
                    }
                }
            }
            [format!("{header}end_header\n").into_bytes(), bytes].concat()
        })
    }

    const SQUARE: [&[f32]; 5] =
        [&[0.0, 0.0, 0.0], &[1.0, 0.0, 0.0], &[1.0, 1.0, 0.0], &[0.0, 1.0, 0.0], &[0.25, 0.25, 0.0]];

    #[test]
    fn polygons_need_not_be_convex() {
        let faces = [
            vec![vec![0., 1., 2.]],
            vec![vec![1., 4., 3., 2.]],
            vec![vec![0., 1., 4., 3.]],
            vec![vec![1., 2., 3., 4.]],
            vec![vec![0., 1.]],
            vec![vec![3., 4., 1., 2.]],
        ];
        for bytes in formats(&SQUARE, &[("face", &faces)]) {
            let mesh = read_bytes(&bytes).unwrap();
            let areas: Vec<f32> = (0..9).map(|i| 0.5 * mesh.area_vector(i).z).collect();
            assert!(areas.iter().skip(3).take(2).all(|a| *a > 0.0), "{areas:?}");
            for (first, area) in [(1, -0.75), (3, 0.25), (5, 0.75), (7, 0.75)] {
                assert!((areas[first] + areas[first + 1] - area).abs() < 1e-6, "{first}: {areas:?}");
                assert!(areas[first] * areas[first + 1] > 0.0, "{first}: {areas:?}");
            }
            assert_eq!(mesh.triangles.len(), 9);
        }
    }

    #[test]
    fn faces_without_a_surface_are_counted() {
        let faces = [vec![vec![0., 1., 2.]], vec![vec![0., 1.]], vec![vec![]], vec![vec![2.]]];
        for bytes in formats(&SQUARE, &[("face", &faces)]) {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), bytes).unwrap();
            let options = Options { flip_v: false, colors: Colors::Linear, attributes: &[] };
            let (mesh, warning) = read(file.path(), &options).unwrap();
            assert_eq!(mesh.triangles, [[0, 1, 2]]);
            let warning = warning.unwrap();
            assert!(warning.contains("3 faces have") && warning.contains("number 1)"), "{warning}");
        }
    }

    /// As MeshLab writes them: every corner has its own, also where polygons are cut anew.
    #[test]
    fn corners_have_texture_coordinates() {
        let uv = |face: f32, vertex: f32| [face + vertex, 10.0 * vertex];
        let face = |i: usize, vertices: &[f32]| {
            vec![vertices.to_vec(), vertices.iter().flat_map(|v| uv(i as f32 / 2.0, *v)).collect()]
        };
        let mut faces = vec![
            face(0, &[0., 1., 2.]),
            face(1, &[0., 2., 3.]),
            face(2, &[1., 4., 3., 2.]),
            vec![vec![0., 1., 2.], vec![]],
        ];
        for bytes in formats(&SQUARE, &[("face", &faces)]) {
            let mesh = read_bytes(&bytes).unwrap();
            assert_eq!(mesh.triangles.len(), 5);
            assert_eq!((mesh.positions.len(), mesh.uvs.len()), (12, 12));
            for (i, face) in [0.0, 0.5, 1.0, 1.0].into_iter().enumerate() {
                for corner in mesh.triangles[i].map(|v| v as usize) {
                    let place = |p: &&[f32]| Vec3::from_slice(p) == mesh.positions[corner];
                    let vertex = SQUARE.iter().position(place).unwrap();
                    assert_eq!(mesh.uvs[corner], Vec2::from_array(uv(face, vertex as f32)));
                }
            }
            assert!(mesh.triangles[4].iter().all(|&v| mesh.uvs[v as usize] == Vec2::ZERO));
            assert!(mesh.area_vector(2).z < 0.0 && mesh.area_vector(3).z < 0.0);
        }
        // Too few, and what vertices have where no face has any.
        faces[1][1].pop();
        for bytes in formats(&SQUARE, &[("face", &faces)]) {
            assert!(
                read_bytes(&bytes).unwrap_err().to_string().contains("face 1 has 5 numbers in 'texcoord'")
            );
        }
        // What is no number is no place on a texture.
        faces[1][1].push(f32::NAN);
        for bytes in formats(&SQUARE, &[("face", &faces)]) {
            let error = read_bytes(&bytes).unwrap_err().to_string();
            assert!(error.contains("texture coordinates of face 1 are not finite"), "{error}");
        }
        let vertices: [&[f32]; 3] =
            [&[0., 0., 0., 0.5, 1.], &[1., 0., 0., f32::INFINITY, 0.], &[0., 1., 0., 0., 0.]];
        for bytes in formats(&vertices, &[("face", &faces[3..])]) {
            let error = read_bytes(&bytes).unwrap_err().to_string();
            assert!(error.contains("texture coordinates of vertex 1 are not finite"), "{error}");
        }
        let vertices: [&[f32]; 3] = [&[0., 0., 0., 0.5, 1.], &[1., 0., 0., 0., 0.], &[0., 1., 0., 0., 0.]];
        for bytes in formats(&vertices, &[("face", &faces[3..])]) {
            assert_eq!(read_bytes(&bytes).unwrap().uvs[0], Vec2::new(0.5, 1.0));
        }
        // The same at two corners of a vertex: one vertex.
        let same = [
            vec![vec![0., 1., 2.], vec![0., 1., 2., 3., 4., 5.]],
            vec![vec![0., 2., 3.], vec![0., 1., 4., 5., 6., 7.]],
        ];
        let mesh = read_bytes(&formats(&SQUARE, &[("face", &same)])[1]).unwrap();
        assert_eq!((mesh.triangles, mesh.uvs.len()), (vec![[0, 1, 2], [0, 2, 3]], 4));
    }

    #[test]
    fn attributes_follow_their_corners() {
        let text = "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_index\n\
            property list uchar float texcoord\nproperty float r\nproperty float g\nproperty float b\n\
            element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float a_x\n\
            property float nx\nproperty float ny\nproperty float nz\nend_header\n\
            3 0 1 2 6 0 0 0 0 0 0 .1 .2 .3\n3 0 1 2 6 0 0 1 1 0 0 .4 .5 .6\n\
            0 0 0 1 0 0 1\n1 0 0 2 0 1 0\n0 1 0 3 1 0 0\n";
        let names = ["face_color", "vertex_a"];
        let mesh = read_colors(text.as_bytes(), Colors::Linear, &names).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 3, 2]]);
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::Y, Vec3::X, Vec3::Y]);
        let x = |name: &str| mesh.attribute(name).unwrap().values.iter().map(|v| v.x).collect::<Vec<_>>();
        assert_eq!((x("face_color"), x("vertex_a")), (vec![0.1, 0.4], vec![1.0, 2.0, 3.0, 2.0]));
        // A vertex that is not there is told when the mesh is placed.
        let text = text.replace("3 0 1 2 6 0 0 1", "3 0 1 9 6 0 0 1");
        assert_eq!(read_bytes(text.as_bytes()).unwrap().triangles[1][2], 9);
    }

    #[test]
    fn strips_alternate_and_begin_anew() {
        let strips = [
            vec![vec![0., 1., 3., 2., -1., 3., 2., 1., -1., -1., 0., 1.]],
            vec![vec![0., 1., 4., 4., 3., 2.]],
        ];
        let triangles = [[0, 1, 3], [3, 1, 2], [3, 2, 1], [0, 1, 4], [3, 4, 2]];
        for bytes in formats(&SQUARE, &[("tristrips", &strips)]) {
            assert_eq!(read_bytes(&bytes).unwrap().triangles, triangles);
        }
        let faces = [vec![vec![0., 1., 2.]]];
        for bytes in formats(&SQUARE, &[("face", &faces), ("tristrips", &strips[..1])]) {
            assert_eq!(read_bytes(&bytes).unwrap().triangles, [[0, 1, 2], [0, 1, 3], [3, 1, 2], [3, 2, 1]]);
        }
        for bytes in formats(&SQUARE, &[("tristrips", &[vec![vec![0., 1., -2.]]])]) {
            assert!(read_bytes(&bytes).unwrap_err().to_string().contains("strip 0 names vertex -2"));
        }
        let [ascii, ..] = formats(&SQUARE, &[("tristrips", &strips)]);
        let unsigned = String::from_utf8(ascii).unwrap().replace("int", "uint").replace("-1", "4294967295");
        assert_eq!(read_bytes(unsigned.as_bytes()).unwrap().triangles, triangles);
    }

    #[test]
    fn every_truncation_is_an_error() {
        for bytes in [ASCII.trim_end().as_bytes().to_vec(), binary(true), binary(false)] {
            for length in 0..bytes.len() {
                assert!(read_bytes(&bytes[..length]).is_err(), "{length} of {}", bytes.len());
            }
        }
    }

    #[test]
    fn promises_are_not_believed() {
        let ascii = ASCII.replace("vertex 4", "vertex 18446744073709551615");
        assert!(read_bytes(ascii.as_bytes()).unwrap_err().to_string().contains("too short"));
        let empty = "ply\nformat ascii 1.0\nelement nothing 18446744073709551615\nend_header\n";
        assert!(read_bytes(empty.as_bytes()).is_err());
        let list = ASCII.replace("9 4 0 1 2 3", "9 4000000000 0 1 2 3");
        assert!(read_bytes(list.as_bytes()).is_err());
    }

    #[test]
    fn mistakes_name_their_line() {
        for (from, to, line) in [
            ("format ascii", "format utf8", 2),
            ("property float t", "property real t", 5),
            ("property float t", "property", 5),
            ("9 4 0", "9 4 -1", 22),
            ("9 4 0", "9 x 0", 22),
            (".3 .4 6", ".3 .4 nan", 20),
        ] {
            match read_bytes(ASCII.replace(from, to).as_bytes()) {
                Err(Error::Scene { line: found, .. }) => assert_eq!(found, line, "{to}"),
                other => panic!("{to}: {other:?}"),
            }
        }
    }

    /// A strip of triangles and quadrilaterals in turns and then of triangles alone, longer than a block; and the line of
    /// its last face in ASCII.
    fn strip(format: &str) -> (Vec<u8>, u32) {
        const N: u32 = 200_000;
        let header = format!(
            "ply\nformat {format} 1.0\nelement vertex {N}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {N}\nproperty list uchar int vertex_indices\nproperty float w\nend_header\n"
        );
        let mut bytes = header.clone().into_bytes();
        let ascii = format == "ascii";
        for i in 0..N {
            let p = [i as f32, 0.5, 2.0];
            if ascii {
                bytes.extend(format!("{} {} {}\n", p[0], p[1], p[2]).bytes());
            } else {
                bytes.extend(p.map(f32::to_le_bytes).concat());
            }
        }
        for i in 0..N {
            let face: Vec<u32> = (0..if i < 9000 { 3 + i % 2 } else { 3 }).map(|k| (i + k) % N).collect();
            if ascii {
                let face: Vec<_> = face.iter().map(u32::to_string).collect();
                bytes.extend(format!("{} {} 0\n", face.len(), face.join(" ")).bytes());
            } else {
                bytes.push(face.len() as u8);
                bytes.extend(face.iter().flat_map(|v| v.to_le_bytes()));
                bytes.extend([0; 4]);
            }
        }
        (bytes, header.lines().count() as u32 + 2 * N)
    }

    #[test]
    fn blocks_are_put_together() {
        for format in ["ascii", "binary_little_endian"] {
            let (bytes, _) = strip(format);
            let mesh = read_bytes(&bytes).unwrap();
            assert_eq!((mesh.positions.len(), mesh.triangles.len()), (200_000, 204_500), "{format}");
            assert!((0..200_000).all(|i| mesh.positions[i] == Vec3::new(i as f32, 0.5, 2.0)));
            assert_eq!(mesh.triangles[..4], [[0, 1, 2], [1, 2, 3], [1, 3, 4], [2, 3, 4]]);
            assert_eq!(mesh.triangles[204_499], [199_999, 0, 1]);
            assert!(read_bytes(&bytes[..bytes.len() - 6]).is_err());
        }
    }

    #[test]
    fn mistakes_are_found_in_later_blocks() {
        let (mut bytes, line) = strip("ascii");
        let last = b"3 199999 0 1 0\n".len();
        bytes.truncate(bytes.len() - last);
        for (end, message) in [("3 199999 -2 1 0\n", "vertex -2"), ("3 199999 ? 1 0\n", "'?'")] {
            let bytes = [&bytes, end.as_bytes()].concat();
            match read_bytes(&bytes) {
                Err(Error::Scene { line: found, message: text, .. }) => {
                    assert_eq!(found, line);
                    assert!(text.contains(message), "{text}");
                }
                other => panic!("{:?}", other.err()),
            }
        }
        let (mut bytes, _) = strip("binary_little_endian");
        let n = bytes.len();
        bytes[n - 16..n - 12].copy_from_slice(&(-2i32).to_le_bytes());
        let error = read_bytes(&bytes).unwrap_err().to_string();
        assert!(error.contains("face 199999 names vertex -2"), "{error}");
    }
}
