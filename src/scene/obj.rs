//! Wavefront OBJ meshes. Own code because errors must name their line, texture coordinates flip as in Mitsuba, and
//! faces must come grouped by material for scenes that are a bare OBJ.

use crate::shape::Mesh;
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use std::path::Path;

/// What an OBJ file holds, before vertices are made.
#[derive(Debug, Default)]
pub(super) struct Obj {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    groups: Vec<Group>,
    /// (file name, line) of material libraries.
    pub libraries: Vec<(String, u32)>,
}

/// Triangles of one material.
#[derive(Debug)]
struct Group {
    material: String,
    line: u32,
    triangles: Vec<[Corner; 3]>,
}

/// Indices of position, texture coordinates and normal; [`NONE`] where there is none.
type Corner = [u32; 3];
const NONE: u32 = u32::MAX;

impl Obj {
    /// Reads a file. v of texture coordinates becomes 1 − v if `flip_v`.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Scene`] with its line if it makes no sense.
    pub(super) fn read(path: &Path, flip_v: bool) -> Result<Obj> {
        let bytes = std::fs::read(path)
            .map_err(|e| Error::File { file: path.into(), message: format!("cannot read the mesh: {e}") })?;
        let mut obj = Obj::default();
        let mut group = obj.group("", 1);
        for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
            let number = i as u32 + 1;
            obj.line(line, number, flip_v, &mut group).map_err(|message| Error::Scene {
                file: path.into(),
                line: number,
                message,
            })?;
        }
        Ok(obj)
    }

    fn group(&mut self, material: &str, line: u32) -> usize {
        if let Some(i) = self.groups.iter().position(|g| g.material == material) {
            return i;
        }
        self.groups.push(Group { material: material.into(), line, triangles: Vec::new() });
        self.groups.len() - 1
    }

    fn line(&mut self, line: &[u8], number: u32, flip_v: bool, group: &mut usize) -> Result<(), String> {
        let line = match line.iter().position(|&b| b == b'#') {
            Some(comment) => &line[..comment],
            None => line,
        };
        let mut tokens = line.split(|b| b.is_ascii_whitespace()).filter(|t| !t.is_empty());
        match tokens.next() {
            Some(b"v") => self.positions.push(Vec3::from_array(floats(&mut tokens)?)),
            // Normals may be useless (zero, NaN): they are checked when the mesh is placed.
            Some(b"vn") => self.normals.push(Vec3::from_array(numbers(&mut tokens)?)),
            Some(b"vt") => {
                let u = float(tokens.next().ok_or("too few numbers")?)?;
                let v = tokens.next().map_or(Ok(0.0), float)?;
                self.uvs.push(Vec2::new(u, if flip_v { 1.0 - v } else { v }));
            }
            Some(b"f") => {
                let first = self.corner(tokens.next().ok_or("a face without vertices")?)?;
                let mut previous = self.corner(tokens.next().ok_or("a face with one vertex")?)?;
                let mut third = false;
                // Polygons become fans.
                for token in tokens {
                    let corner = self.corner(token)?;
                    self.groups[*group].triangles.push([first, previous, corner]);
                    (previous, third) = (corner, true);
                }
                if !third {
                    return Err("a face with two vertices".into());
                }
            }
            Some(b"usemtl") => {
                let name = text(line, b"usemtl");
                *group = self.group(&name, number);
            }
            Some(b"mtllib") => self.libraries.push((text(line, b"mtllib"), number)),
            // Object and smoothing groups, lines and points make no difference to surfaces.
            _ => {}
        }
        Ok(())
    }

    /// `v`, `v/t`, `v//n` or `v/t/n`, counted from 1, or from the end if negative.
    fn corner(&self, token: &[u8]) -> Result<Corner, String> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut corner = [NONE; 3];
        for (i, part) in token.split(|&b| b == b'/').enumerate() {
            if i >= 3 || (part.is_empty() && i == 0) {
                return Err(format!("'{}' is not a face corner", show(token)));
            }
            if part.is_empty() {
                continue;
            }
            let index: i64 = parse(part).ok_or_else(|| format!("'{}' is not an index", show(part)))?;
            let resolved = if index < 0 { counts[i] as i64 + index } else { index - 1 };
            if resolved < 0 || resolved >= counts[i].min(NONE as usize) as i64 {
                let what = ["vertices", "texture coordinates", "normals"][i];
                return Err(format!("index {index} is out of range: {} {what} so far", counts[i]));
            }
            corner[i] = resolved as u32;
        }
        Ok(corner)
    }

    /// Everything as one mesh.
    pub(super) fn mesh(&self) -> Mesh {
        self.build(self.groups.iter().flat_map(|g| &g.triangles))
    }

    /// One mesh per material that is used: its name, the line of its first use, the mesh.
    pub(super) fn meshes(&self) -> Vec<(String, u32, Mesh)> {
        let used = self.groups.iter().filter(|g| !g.triangles.is_empty());
        used.map(|g| (g.material.clone(), g.line, self.build(g.triangles.iter()))).collect()
    }

    /// One vertex for each different corner.
    fn build<'a>(&self, triangles: impl Iterator<Item = &'a [Corner; 3]> + Clone) -> Mesh {
        let has = |i: usize| triangles.clone().flatten().any(|c| c[i] != NONE);
        let (has_uvs, has_normals) = (has(1), has(2));
        let mut mesh = Mesh::default();
        // Vertices of one position are chained: (corner, next vertex).
        let mut first = vec![NONE; self.positions.len()];
        let mut chain: Vec<(Corner, u32)> = Vec::new();
        for triangle in triangles {
            let indices = triangle.map(|corner| {
                let mut vertex = first[corner[0] as usize];
                while vertex != NONE && chain[vertex as usize].0 != corner {
                    vertex = chain[vertex as usize].1;
                }
                if vertex == NONE {
                    vertex = chain.len() as u32;
                    chain.push((corner, std::mem::replace(&mut first[corner[0] as usize], vertex)));
                    mesh.positions.push(self.positions[corner[0] as usize]);
                    if has_uvs {
                        mesh.uvs.push(self.uvs.get(corner[1] as usize).copied().unwrap_or_default());
                    }
                    if has_normals {
                        mesh.normals.push(self.normals.get(corner[2] as usize).copied().unwrap_or_default());
                    }
                }
                vertex
            });
            mesh.triangles.push(indices);
        }
        mesh
    }
}

fn show(token: &[u8]) -> String {
    String::from_utf8_lossy(token).chars().take(40).collect()
}

/// The rest of a line after its keyword: names may hold spaces.
fn text(line: &[u8], keyword: &[u8]) -> String {
    let line = String::from_utf8_lossy(line);
    line.trim_start().get(keyword.len()..).unwrap_or("").trim().to_string()
}

fn parse<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

fn number(token: &[u8]) -> Result<f32, String> {
    parse::<f32>(token).ok_or_else(|| format!("'{}' is not a number", show(token)))
}

fn float(token: &[u8]) -> Result<f32, String> {
    let value = number(token)?;
    if value.is_finite() { Ok(value) } else { Err(format!("'{}' is not finite", show(token))) }
}

fn floats<'a>(tokens: &mut impl Iterator<Item = &'a [u8]>) -> Result<[f32; 3], String> {
    let mut next = || float(tokens.next().ok_or("too few numbers")?);
    Ok([next()?, next()?, next()?])
}

fn numbers<'a>(tokens: &mut impl Iterator<Item = &'a [u8]>) -> Result<[f32; 3], String> {
    let mut next = || number(tokens.next().ok_or("too few numbers")?);
    Ok([next()?, next()?, next()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Obj> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Obj::read(file.path(), true)
    }

    #[test]
    fn corners_are_shared_and_polygons_split() {
        let obj = read(
            "v 0 0 0\nv 1 0 0\nv 1 1 .5\nv 0 1 0\nvt 0 .25\nvt 1 .25\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\r\n",
        );
        let mesh = obj.unwrap().mesh();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.uvs[0], Vec2::new(0.0, 0.75));
        assert!(mesh.normals.is_empty());
    }

    #[test]
    fn seams_split_vertices() {
        let obj = read(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nf -3//-1 -1//1 -2//1\n",
        );
        let mesh = obj.unwrap().mesh();
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 2]]);
        assert_eq!(mesh.normals[3], Vec3::Y);
        assert!(mesh.uvs.is_empty());
    }

    #[test]
    fn materials_group_faces() {
        let obj = read(
            "mtllib my file.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b c\nf 3 2 1\nusemtl a\nf 2 3 1\n",
        );
        let obj = obj.unwrap();
        assert_eq!(obj.libraries, [("my file.mtl".to_string(), 1)]);
        let meshes = obj.meshes();
        let summary: Vec<_> =
            meshes.iter().map(|(m, line, mesh)| (m.as_str(), *line, mesh.triangles.len())).collect();
        assert_eq!(summary, [("a", 5, 2), ("b c", 7, 1)]);
    }

    #[test]
    fn mistakes_name_their_line() {
        for (text, line) in [
            ("v 0 0\n", 1),
            ("\nv 0 0 nan\n", 2),
            ("v 0 0 1e99\n", 1),
            ("v 0 0 zero\n", 1),
            ("v 0 0 0\nf 1 1 2\n", 2),
            ("v 0 0 0\nf 0 1 1\n", 2),
            ("v 0 0 0\nf -2 1 1\n", 2),
            ("v 0 0 0\nf 1 1\n", 2),
            ("v 0 0 0\nf 1 1 1/1\n", 2),
            ("v 0 0 0\nf 1 1 1/x\n", 2),
            ("v 0 0 0\nf 1 1 1/1/1/1\n", 2),
            ("v 0 0 0\nf 1 1 99999999999999999999\n", 2),
            ("vt\n", 1),
            ("v 0 0 0\nf\n", 2),
        ] {
            match read(text) {
                Err(Error::Scene { line: found, .. }) => assert_eq!(found, line, "{text}"),
                other => panic!("{text}: {other:?}"),
            }
        }
        assert!(matches!(Obj::read(Path::new("/nonexistent.obj"), true), Err(Error::File { .. })));
    }
}
