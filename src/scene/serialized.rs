//! Mitsuba's `.serialized` meshes, versions 3 (Mitsuba 0.3) and 4 (0.4 to 3.9): a header of two 16-bit words, then a zlib stream of
//! flags, name (version 4), counts and arrays; several meshes follow each other, with a table of their offsets at the
//! end of the file. Everything is little-endian.

use super::blocks::cannot_read;
use crate::shape::{Attribute, Mesh};
use crate::{Error, Result};
use bytemuck::Pod;
use flate2::bufread::ZlibDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const DOUBLE: u32 = 0x2000;

/// Reads mesh number `index` of a file, of its colours only what `attributes` names. The flag 0x10 (face normals) is ignored, as in Mitsuba 3.
///
/// # Errors
/// [`Error::File`] if the file cannot be read, is cut off, or does not hold the mesh.
pub(super) fn read(path: &Path, index: u32, attributes: &[String]) -> Result<Mesh> {
    let file = File::open(path).map_err(|e| cannot_read(path, &e))?;
    let mut mesh = parse(BufReader::with_capacity(1 << 18, file), index)
        .map_err(|message| Error::File { file: path.into(), message })?;
    mesh.attributes.retain(|attribute| attributes.contains(&attribute.name));
    Ok(mesh)
}

fn parse(mut file: impl BufRead + Seek, index: u32) -> Result<Mesh, String> {
    let mut version = header(&mut file)?;
    if index != 0 {
        let start = offset(&mut file, version, index)?;
        file.seek(SeekFrom::Start(start)).map_err(|_| TABLE)?;
        version = header(&mut file)?;
    }
    let mut reader = Reader(ZlibDecoder::new(file));
    let flags = reader.u32()?;
    if version == 4 {
        while reader.bytes::<1>()? != [0] {}
    }
    let (vertices, triangles) = (reader.u64()?, reader.u64()?);
    let double = flags & DOUBLE != 0;
    let mut mesh = Mesh { positions: reader.floats(vertices, double)?, ..Mesh::default() };
    if flags & HAS_NORMALS != 0 {
        mesh.normals = reader.floats(vertices, double)?;
    }
    if flags & HAS_UVS != 0 {
        mesh.uvs = reader.floats(vertices, double)?;
    }
    if flags & HAS_COLORS != 0 {
        let values = reader.floats(vertices, double)?;
        mesh.attributes.push(Attribute { name: "vertex_color".into(), values });
    }
    mesh.triangles = reader.array(triangles)?;
    mesh.triangles.iter_mut().flatten().for_each(|i| *i = u32::from_le(*i));
    Ok(mesh)
}

const TABLE: &str = "the table of meshes is damaged";
const EARLY: &str = "the file ends too early";

fn exactly<const N: usize>(file: &mut impl Read) -> Result<[u8; N], String> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes).map_err(|e| failure(&e))?;
    Ok(bytes)
}

fn failure(e: &std::io::Error) -> String {
    match e.kind() {
        std::io::ErrorKind::UnexpectedEof => EARLY.into(),
        _ => format!("the compressed data is damaged: {e}"),
    }
}

/// The version, before what is compressed.
fn header(file: &mut impl Read) -> Result<u16, String> {
    let [a, b, c, d] = exactly(file)?;
    if [a, b] != [0x1C, 0x04] {
        return Err("not a serialized mesh".into());
    }
    match u16::from_le_bytes([c, d]) {
        version @ (3 | 4) => Ok(version),
        version => Err(format!("serialized meshes of version {version} are not supported, only 3 and 4")),
    }
}

/// Where a mesh begins, by the table at the end: offsets (32 bits in version 3, else 64), then their number.
fn offset(file: &mut (impl Read + Seek), version: u16, index: u32) -> Result<u64, String> {
    let size = if version == 3 { 4 } else { 8 };
    file.seek(SeekFrom::End(-4)).map_err(|_| EARLY)?;
    let count = u32::from_le_bytes(exactly(file)?);
    if index >= count {
        return Err(format!("there is no mesh number {index}: the file holds {count}"));
    }
    file.seek(SeekFrom::End(-4 - (count - index) as i64 * size)).map_err(|_| TABLE)?;
    let mut entry = [0; 8];
    file.read_exact(&mut entry[..size as usize]).map_err(|_| TABLE)?;
    Ok(u64::from_le_bytes(entry))
}

struct Reader<R>(ZlibDecoder<R>);

impl<R: BufRead> Reader<R> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], String> {
        exactly(&mut self.0)
    }

    /// So many items, in the file's byte order. Memory grows only as data arrives.
    fn array<T: Pod>(&mut self, count: u64) -> Result<Vec<T>, String> {
        const PIECE: u64 = 1 << 14;
        let mut items: Vec<T> = Vec::new();
        while (items.len() as u64) < count {
            let old = items.len();
            items.resize(old + PIECE.min(count - old as u64) as usize, T::zeroed());
            self.0.read_exact(bytemuck::cast_slice_mut(&mut items[old..])).map_err(|e| failure(&e))?;
        }
        Ok(items)
    }

    /// So many vectors of floats.
    fn floats<T: Pod>(&mut self, count: u64, double: bool) -> Result<Vec<T>, String> {
        let mut items: Vec<T> = Vec::new();
        if double {
            let components = size_of::<T>() / 4;
            let mut left = count;
            while left > 0 {
                let piece = left.min(1 << 14);
                let doubles: Vec<u64> = self.array(piece * components as u64)?;
                let float = |bits: &u64| f64::from_bits(u64::from_le(*bits)) as f32;
                let floats: Vec<f32> = doubles.iter().map(float).collect();
                items.extend_from_slice(bytemuck::cast_slice(&floats));
                left -= piece;
            }
        } else {
            items = self.array(count)?;
            bytemuck::cast_slice_mut::<T, u32>(&mut items).iter_mut().for_each(|w| *w = u32::from_le(*w));
        }
        Ok(items)
    }

    fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.bytes()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::ZlibEncoder};
    use glam::{Vec2, Vec3};
    use std::io::{Cursor, Write};

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
                let mesh = parse(Cursor::new(&bytes), index).unwrap();
                assert_eq!(mesh.positions[1], Vec3::X);
                assert_eq!(mesh.normals[2], Vec3::Z);
                assert_eq!(mesh.uvs[1], Vec2::new(1.0, 0.0));
                assert_eq!(mesh.attribute("vertex_color").unwrap().values, [Vec3::splat(0.5); 3]);
                assert_eq!(mesh.triangles, [[0, 1, 2]]);
            }
            assert!(parse(Cursor::new(&bytes), 2).unwrap_err().contains("holds 2"));
        }
    }

    #[test]
    fn damage_is_an_error() {
        let bytes = mesh_bytes(4, false, 3);
        // The last bytes only end the stream.
        for length in 0..bytes.len() * 3 / 4 {
            assert!(parse(Cursor::new(&bytes[..length]), 0).is_err(), "{length}");
        }
        for count in [4, 1 << 40, u64::MAX] {
            assert!(parse(Cursor::new(&mesh_bytes(4, false, count)), 0).is_err(), "{count}");
        }
        let mut table = file(4);
        let end = table.len();
        table[end - 12..end - 4].fill(0xFF);
        assert!(parse(Cursor::new(&table), 1).is_err());
        table[end - 4..].fill(0xFF);
        assert!(parse(Cursor::new(&table), 1).is_err());
        let mut other = file(4);
        other[2] = 9;
        assert!(parse(Cursor::new(&other), 0).unwrap_err().contains("version 9"));
    }
}
