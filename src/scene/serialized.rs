//! Mitsuba's `.serialized` meshes, versions 3 (Mitsuba 0.3) and 4 (0.4 to 3.9): a header of two 16-bit words, then a zlib stream of
//! flags, name (version 4), counts and arrays; several meshes follow each other, with a table of their offsets at the
//! end of the file. Everything is little-endian.

use crate::shape::{Attribute, Mesh};
use crate::{Error, Result};
use flate2::read::ZlibDecoder;
use glam::{Vec2, Vec3};
use std::io::Read;
use std::path::Path;

const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const DOUBLE: u32 = 0x2000;

/// Reads mesh number `index` of a file. The flag 0x10 (face normals) is ignored, as in Mitsuba 3.
///
/// # Errors
/// [`Error::File`] if the file cannot be read, is cut off, or does not hold the mesh.
pub(super) fn read(path: &Path, index: u32) -> Result<Mesh> {
    let fail = |message: String| Error::File { file: path.into(), message };
    let bytes = std::fs::read(path).map_err(|e| fail(format!("cannot read the mesh: {e}")))?;
    parse(&bytes, index).map_err(fail)
}

fn parse(bytes: &[u8], index: u32) -> Result<Mesh, String> {
    let (version, _) = header(bytes)?;
    let start = if index == 0 { 0 } else { offset(bytes, version, index)? };
    let (version, stream) = header(bytes.get(start..).unwrap_or(&[]))?;
    let mut reader = Reader { stream: ZlibDecoder::new(stream), compressed: stream.len() };
    let flags = reader.u32()?;
    if version == 4 {
        while reader.bytes(1)?[0] != 0 {}
    }
    let (vertices, triangles) = (reader.u64()?, reader.u64()?);
    let double = flags & DOUBLE != 0;
    let positions = reader.floats(vertices, 3, double)?;
    let normals = if flags & HAS_NORMALS != 0 { reader.floats(vertices, 3, double)? } else { Vec::new() };
    let uvs = if flags & HAS_UVS != 0 { reader.floats(vertices, 2, double)? } else { Vec::new() };
    let colors = if flags & HAS_COLORS != 0 { reader.floats(vertices, 3, double)? } else { Vec::new() };
    let indices = reader.array(triangles, 12)?;
    let vec3 = |v: &[f32]| Vec3::new(v[0], v[1], v[2]);
    let colors: Vec<Vec3> = colors.chunks_exact(3).map(vec3).collect();
    let colors = Attribute { name: "vertex_color".into(), values: colors };
    let word = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    Ok(Mesh {
        positions: positions.chunks_exact(3).map(vec3).collect(),
        normals: normals.chunks_exact(3).map(vec3).collect(),
        uvs: uvs.chunks_exact(2).map(|v| Vec2::new(v[0], v[1])).collect(),
        triangles: indices.chunks_exact(12).map(|t| [word(t), word(&t[4..]), word(&t[8..])]).collect(),
        attributes: if colors.values.is_empty() { Vec::new() } else { vec![colors] },
    })
}

/// Version, and what follows the header.
fn header(bytes: &[u8]) -> Result<(u16, &[u8]), String> {
    let [a, b, c, d, rest @ ..] = bytes else { return Err("the file ends too early".into()) };
    if [*a, *b] != [0x1C, 0x04] {
        return Err("not a serialized mesh".into());
    }
    match u16::from_le_bytes([*c, *d]) {
        version @ (3 | 4) => Ok((version, rest)),
        version => Err(format!("serialized meshes of version {version} are not supported, only 3 and 4")),
    }
}

/// Where a mesh begins, by the table at the end: offsets (32 bits in version 3, else 64), then their number.
fn offset(bytes: &[u8], version: u16, index: u32) -> Result<usize, String> {
    let (rest, count) = bytes.split_last_chunk::<4>().ok_or("the file ends too early")?;
    let count = u32::from_le_bytes(*count);
    if index >= count {
        return Err(format!("there is no mesh number {index}: the file holds {count}"));
    }
    let size = if version == 3 { 4 } else { 8 };
    let back = (count - index) as usize * size;
    let entry = rest.len().checked_sub(back).and_then(|at| rest.get(at..at + size));
    let entry = entry.ok_or("the table of meshes is damaged")?;
    let offset = entry.iter().rev().fold(0u64, |n, b| n << 8 | *b as u64);
    usize::try_from(offset).ok().filter(|o| *o < bytes.len()).ok_or("the table of meshes is damaged".into())
}

struct Reader<'a> {
    stream: ZlibDecoder<&'a [u8]>,
    compressed: usize,
}

impl Reader<'_> {
    /// Exactly `n` bytes. Memory grows only as data arrives.
    fn bytes(&mut self, n: usize) -> Result<Vec<u8>, String> {
        let mut out = Vec::new();
        (&mut self.stream)
            .take(n as u64)
            .read_to_end(&mut out)
            .map_err(|e| format!("the compressed data is damaged: {e}"))?;
        if out.len() == n { Ok(out) } else { Err("the file ends too early".into()) }
    }

    /// `count` records, if the file can hold them at all: DEFLATE shrinks by 1032 at most.
    fn array(&mut self, count: u64, size: usize) -> Result<Vec<u8>, String> {
        let n = usize::try_from(count).ok().and_then(|c| c.checked_mul(size));
        let n = n.filter(|n| *n / 1032 <= self.compressed);
        self.bytes(n.ok_or_else(|| format!("the file is too short for the {count} records it promises"))?)
    }

    fn floats(&mut self, count: u64, components: usize, double: bool) -> Result<Vec<f32>, String> {
        Ok(if double {
            let bytes = self.array(count, 8 * components)?;
            let float =
                |b: &[u8]| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32;
            bytes.chunks_exact(8).map(float).collect()
        } else {
            let bytes = self.array(count, 4 * components)?;
            bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
        })
    }

    fn u32(&mut self) -> Result<u32, String> {
        Ok(self.bytes(4)?.iter().rev().fold(0, |n, b| n << 8 | *b as u32))
    }

    fn u64(&mut self) -> Result<u64, String> {
        Ok(self.bytes(8)?.iter().rev().fold(0, |n, b| n << 8 | *b as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::ZlibEncoder};
    use std::io::Write;

    fn mesh_bytes(version: u16, double: bool, vertices: u64) -> Vec<u8> {
        let mut body = Vec::new();
        body.extend(
            (HAS_UVS | HAS_NORMALS | HAS_COLORS | if double { DOUBLE } else { 0x1000 }).to_le_bytes(),
        );
        if version == 4 {
            body.extend(b"a name\0");
        }
        body.extend(vertices.to_le_bytes());
        body.extend(1u64.to_le_bytes());
        let rows: [&[f64]; 4] = [
            &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0],
            &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0],
            &[0.5; 9],
        ];
        for v in rows.concat() {
            if double {
                body.extend(v.to_le_bytes());
            } else {
                body.extend((v as f32).to_le_bytes());
            }
        }
        body.extend([0u32, 1, 2].map(u32::to_le_bytes).concat());
        let mut out = vec![0x1C, 0x04];
        out.extend(version.to_le_bytes());
        let mut zlib = ZlibEncoder::new(out, Compression::default());
        zlib.write_all(&body).unwrap();
        zlib.finish().unwrap()
    }

    fn file(version: u16) -> Vec<u8> {
        let (a, b) = (mesh_bytes(version, false, 3), mesh_bytes(version, true, 3));
        let mut out = [a.clone(), b].concat();
        for offset in [0, a.len() as u64] {
            out.extend(&offset.to_le_bytes()[..if version == 3 { 4 } else { 8 }]);
        }
        out.extend(2u32.to_le_bytes());
        out
    }

    #[test]
    fn both_versions_and_precisions() {
        for version in [3, 4] {
            let bytes = file(version);
            for index in 0..2 {
                let mesh = parse(&bytes, index).unwrap();
                assert_eq!(mesh.positions[1], Vec3::X);
                assert_eq!(mesh.normals[2], Vec3::Z);
                assert_eq!(mesh.uvs[1], Vec2::new(1.0, 0.0));
                assert_eq!(mesh.attribute("vertex_color").unwrap().values, [Vec3::splat(0.5); 3]);
                assert_eq!(mesh.triangles, [[0, 1, 2]]);
            }
            assert!(parse(&bytes, 2).unwrap_err().contains("holds 2"));
        }
    }

    #[test]
    fn damage_is_an_error() {
        let bytes = mesh_bytes(4, false, 3);
        // The last bytes only end the stream.
        for length in 0..bytes.len() * 3 / 4 {
            assert!(parse(&bytes[..length], 0).is_err(), "{length}");
        }
        for count in [4, 1 << 40, u64::MAX] {
            assert!(parse(&mesh_bytes(4, false, count), 0).is_err(), "{count}");
        }
        let mut table = file(4);
        let end = table.len();
        table[end - 12..end - 4].fill(0xFF);
        assert!(parse(&table, 1).is_err());
        table[end - 4..].fill(0xFF);
        assert!(parse(&table, 1).is_err());
        let mut other = file(4);
        other[2] = 9;
        assert!(parse(&other, 0).unwrap_err().contains("version 9"));
    }
}
