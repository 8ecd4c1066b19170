//! Stanford PLY meshes: ASCII and binary of either byte order, properties in any order, polygons.

use crate::shape::Mesh;
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use std::path::Path;

/// Reads a mesh. v of texture coordinates becomes 1 − v if `flip_v`.
///
/// # Errors
/// [`Error::File`] if it cannot be read or is cut off, [`Error::Scene`] with the line for mistakes in its header or in
/// ASCII data.
pub(super) fn read(path: &Path, flip_v: bool) -> Result<Mesh> {
    let file = |message: String| Error::File { file: path.into(), message };
    let bytes = std::fs::read(path).map_err(|e| file(format!("cannot read the mesh: {e}")))?;
    let at_line = |(line, message): (u32, String)| Error::Scene { file: path.into(), line, message };
    let header = Header::parse(&bytes).map_err(at_line)?;
    let data = &bytes[header.length..];
    match header.format {
        Format::Ascii => {
            let mut values = Ascii { rest: data, line: header.lines + 1 };
            read_elements(&header.elements, &mut values, flip_v).map_err(|m| at_line((values.line, m)))
        }
        Format::LittleEndian => {
            read_elements(&header.elements, &mut Binary::<true> { rest: data }, flip_v).map_err(file)
        }
        Format::BigEndian => {
            read_elements(&header.elements, &mut Binary::<false> { rest: data }, flip_v).map_err(file)
        }
    }
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

/// Where values come from.
trait Values {
    fn next(&mut self, kind: Type) -> Result<f64, String>;
    /// Bytes that are left: bounds how many elements there can be.
    fn left(&self) -> usize;
    /// Fewest bytes that a value can take.
    fn least_size(kind: Type) -> usize;
}

struct Ascii<'a> {
    rest: &'a [u8],
    line: u32,
}

impl Values for Ascii<'_> {
    fn next(&mut self, _: Type) -> Result<f64, String> {
        let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(self.rest.len());
        self.line += self.rest[..start].iter().filter(|&&b| b == b'\n').count() as u32;
        let rest = &self.rest[start..];
        let end = rest.iter().position(|b| b.is_ascii_whitespace()).unwrap_or(rest.len());
        if end == 0 {
            return Err("the file ends too early".into());
        }
        self.rest = &rest[end..];
        let token = std::str::from_utf8(&rest[..end]).unwrap_or("?");
        token.parse().map_err(|_| format!("'{}' is not a number", token.chars().take(40).collect::<String>()))
    }

    fn left(&self) -> usize {
        self.rest.len()
    }

    fn least_size(_: Type) -> usize {
        1
    }
}

struct Binary<'a, const LITTLE: bool> {
    rest: &'a [u8],
}

impl<const LITTLE: bool> Binary<'_, LITTLE> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (head, rest) = self.rest.split_first_chunk::<N>().ok_or("the file ends too early")?;
        self.rest = rest;
        let mut bytes = *head;
        if !LITTLE {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl<const LITTLE: bool> Values for Binary<'_, LITTLE> {
    fn next(&mut self, kind: Type) -> Result<f64, String> {
        Ok(match kind {
            Type::I8 => i8::from_le_bytes(self.take()?) as f64,
            Type::U8 => u8::from_le_bytes(self.take()?) as f64,
            Type::I16 => i16::from_le_bytes(self.take()?) as f64,
            Type::U16 => u16::from_le_bytes(self.take()?) as f64,
            Type::I32 => i32::from_le_bytes(self.take()?) as f64,
            Type::U32 => u32::from_le_bytes(self.take()?) as f64,
            Type::F32 => f32::from_le_bytes(self.take()?) as f64,
            Type::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    fn left(&self) -> usize {
        self.rest.len()
    }

    fn least_size(kind: Type) -> usize {
        kind.size()
    }
}

/// What a vertex property means: position, normal, texture coordinates by component.
fn slot(name: &str) -> Option<usize> {
    Some(match name {
        "x" => 0,
        "y" => 1,
        "z" => 2,
        "nx" => 3,
        "ny" => 4,
        "nz" => 5,
        "u" | "s" | "texture_u" => 6,
        "v" | "t" | "texture_v" => 7,
        _ => return None,
    })
}

fn read_elements<V: Values>(elements: &[Element], values: &mut V, flip_v: bool) -> Result<Mesh, String> {
    let mut mesh = Mesh::default();
    let (mut vertices, mut faces) = (false, false);
    for element in elements {
        // A header can promise anything: believe it only as far as the file is long.
        let least: usize = element.properties.iter().map(|p| V::least_size(p.list.unwrap_or(p.kind))).sum();
        if least == 0 {
            continue;
        }
        if element.count > (values.left() / least) as u64 {
            return Err(format!(
                "the file is too short for the {} elements '{}' that its header promises",
                element.count, element.name
            ));
        }
        match element.name.as_str() {
            "vertex" if !vertices => {
                vertices = true;
                read_vertices(element, values, flip_v, &mut mesh)?;
            }
            "face" if !faces => {
                faces = true;
                read_faces(element, values, &mut mesh)?;
            }
            "vertex" | "face" => return Err(format!("the element '{}' comes twice", element.name)),
            _ => {
                for _ in 0..element.count {
                    element.properties.iter().try_for_each(|p| skip(p, values))?;
                }
            }
        }
    }
    if !vertices || !faces {
        return Err("the file holds no vertices or no faces: not a mesh".into());
    }
    Ok(mesh)
}

fn skip(property: &Property, values: &mut impl Values) -> Result<(), String> {
    let count = match property.list {
        Some(kind) => list_length(values.next(kind)?)?,
        None => 1,
    };
    (0..count).try_for_each(|_| values.next(property.kind).map(|_| ()))
}

fn list_length(count: f64) -> Result<u64, String> {
    if count >= 0.0 && count.fract() == 0.0 {
        Ok(count as u64)
    } else {
        Err(format!("a list of {count} values"))
    }
}

fn read_vertices(
    element: &Element,
    values: &mut impl Values,
    flip_v: bool,
    mesh: &mut Mesh,
) -> Result<(), String> {
    let slots: Vec<_> =
        element.properties.iter().map(|p| slot(&p.name).filter(|_| p.list.is_none())).collect();
    let has = |wanted: std::ops::Range<usize>| wanted.into_iter().all(|s| slots.contains(&Some(s)));
    if !has(0..3) {
        return Err("the vertices have no x, y, z".into());
    }
    let (has_normals, has_uvs) = (has(3..6), has(6..8));
    mesh.positions.reserve(element.count as usize);
    let mut vertex = [0.0f32; 8];
    for i in 0..element.count {
        for (property, slot) in element.properties.iter().zip(&slots) {
            match slot {
                Some(slot) => vertex[*slot] = values.next(property.kind)? as f32,
                None => skip(property, values)?,
            }
        }
        let [x, y, z, nx, ny, nz, u, v] = vertex;
        let p = Vec3::new(x, y, z);
        if !p.is_finite() {
            return Err(format!("vertex {i} is not finite"));
        }
        mesh.positions.push(p);
        if has_normals {
            mesh.normals.push(Vec3::new(nx, ny, nz));
        }
        if has_uvs {
            mesh.uvs.push(Vec2::new(u, if flip_v { 1.0 - v } else { v }));
        }
    }
    Ok(())
}

fn read_faces(element: &Element, values: &mut impl Values, mesh: &mut Mesh) -> Result<(), String> {
    let is_indices =
        |p: &Property| p.list.is_some() && matches!(p.name.as_str(), "vertex_index" | "vertex_indices");
    if element.properties.iter().filter(|p| is_indices(p)).count() != 1 {
        return Err("the faces have no list 'vertex_indices'".into());
    }
    mesh.triangles.reserve(element.count as usize);
    for i in 0..element.count {
        for property in &element.properties {
            let Some(count_kind) = property.list.filter(|_| is_indices(property)) else {
                skip(property, values)?;
                continue;
            };
            let count = list_length(values.next(count_kind)?)?;
            let mut index = || {
                let index = values.next(property.kind)?;
                if index >= 0.0 && index < u32::MAX as f64 && index.fract() == 0.0 {
                    Ok(index as u32)
                } else {
                    Err(format!("face {i} names vertex {index}"))
                }
            };
            if count < 3 {
                return Err(format!("face {i} has {count} vertices"));
            }
            // Polygons become fans.
            let (first, mut previous) = (index()?, index()?);
            for _ in 2..count {
                let next = index()?;
                mesh.triangles.push([first, previous, next]);
                previous = next;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<Mesh> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read(file.path(), false)
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
            ("9 4 0", "9 2 0", 22),
            ("9 4 0", "9 x 0", 22),
            (".3 .4 6", ".3 .4 nan", 20),
        ] {
            match read_bytes(ASCII.replace(from, to).as_bytes()) {
                Err(Error::Scene { line: found, .. }) => assert_eq!(found, line, "{to}"),
                other => panic!("{to}: {other:?}"),
            }
        }
    }
}
