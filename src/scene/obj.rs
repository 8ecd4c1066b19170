//! Wavefront OBJ meshes. Own code because errors must name their line, texture coordinates flip as in Mitsuba, and
//! faces must come grouped by material for scenes that are a bare OBJ.
//!
//! A file is read block by block, and the lines of each block in parallel: a first look at them tells how many vertices
//! have been before any line, so that indices can be resolved and checked where they stand.

use super::blocks::{Blocks, pieces};
use super::lines;
use super::polygon::{Fans, Skipped};
use crate::shape::Mesh;
use crate::{Error, Result};
use glam::{Vec2, Vec3};
use memchr::memchr;
use rayon::prelude::*;
use std::path::Path;

/// What an OBJ file holds, before vertices are made.
#[derive(Debug, Default)]
pub(super) struct Obj {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    groups: Vec<Group>,
    /// Names of material libraries, one or several, and their lines.
    pub libraries: Vec<(String, u32)>,
    skipped: Skipped,
}

/// Triangles of one material.
#[derive(Debug)]
struct Group {
    material: String,
    line: u32,
    faces: Faces,
}

#[derive(Debug, Default)]
struct Faces {
    triangles: Vec<[Corner; 3]>,
    fans: Fans,
}

/// Indices of position, texture coordinates and normal; [`NONE`] where there is none.
type Corner = [u32; 3];
const NONE: u32 = u32::MAX;

/// What stands before a line.
#[derive(Clone, Copy, Debug, Default)]
struct Before {
    lines: u32,
    /// Positions, texture coordinates and normals.
    counts: [usize; 3],
    group: usize,
}

/// What a piece of a file says.
struct Piece {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    /// By group, in the order of the lines.
    faces: Vec<(usize, Faces)>,
    libraries: Vec<(String, u32)>,
    skipped: Skipped,
}

impl Obj {
    /// Reads a file. v of texture coordinates becomes 1 − v if `flip_v`.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Scene`] with its line if it makes no sense.
    pub(super) fn read(path: &Path, flip_v: bool) -> Result<Obj> {
        let mut blocks = Blocks::open(path)?;
        let mut obj = Obj::default();
        let mut before = Before { group: obj.group("", 1), ..Before::default() };
        let at_line = |(line, message)| Error::Scene { file: path.into(), line, message };
        let mut more = blocks.more()?;
        if blocks.bytes().starts_with(b"\xEF\xBB\xBF") {
            blocks.consume(3);
        }
        while more {
            let whole = lines::whole(blocks.bytes());
            obj.block(&blocks.bytes()[..whole], flip_v, &mut before).map_err(at_line)?;
            blocks.consume(whole);
            more = blocks.more()?;
        }
        obj.block(blocks.bytes(), flip_v, &mut before).map_err(at_line)?;
        let Obj { positions, groups, .. } = &mut obj;
        for Group { faces, .. } in groups {
            let position = |corner: Corner| positions.get(corner[0] as usize).copied();
            faces.fans.fit(&mut faces.triangles, position);
        }
        Ok(obj)
    }

    /// What users are told of the file at `path`.
    pub(super) fn warning(&self, path: &Path) -> Option<String> {
        self.skipped.warning(path, "line")
    }

    pub(super) fn is_empty(&self) -> bool {
        self.groups.iter().all(|group| group.faces.triangles.is_empty())
    }

    fn group(&mut self, material: &str, line: u32) -> usize {
        if let Some(i) = self.groups.iter().position(|g| g.material == material) {
            return i;
        }
        self.groups.push(Group { material: material.into(), line, faces: Faces::default() });
        self.groups.len() - 1
    }

    /// Reads whole lines.
    fn block(&mut self, text: &[u8], flip_v: bool, before: &mut Before) -> Result<(), (u32, String)> {
        let pieces: Vec<&[u8]> = pieces(text, lines::end).collect();
        let looks: Vec<Look> = pieces.par_iter().map(|piece| Look::at(piece)).collect();
        let mut starts = Vec::with_capacity(pieces.len());
        for look in looks {
            let groups: Vec<usize> =
                look.materials.iter().map(|(name, line)| self.group(name, before.lines + line)).collect();
            let last = groups.last().copied();
            starts.push((*before, groups));
            before.lines = before.lines.saturating_add(look.lines);
            before.counts.iter_mut().zip(look.counts).for_each(|(sum, n)| *sum += n);
            before.group = last.unwrap_or(before.group);
        }
        let parsed = pieces.par_iter().zip(starts);
        let parsed = parsed.map(|(text, (before, groups))| Piece::parse(text, flip_v, before, &groups));
        for piece in parsed.collect::<Vec<_>>() {
            let piece = piece?;
            self.positions.extend(piece.positions);
            self.normals.extend(piece.normals);
            self.uvs.extend(piece.uvs);
            self.libraries.extend(piece.libraries);
            for (group, Faces { triangles, fans }) in piece.faces {
                let all = &mut self.groups[group].faces;
                all.fans.append(fans, all.triangles.len());
                all.triangles.extend(triangles);
            }
            self.skipped.append(piece.skipped);
        }
        Ok(())
    }

    /// Everything as one mesh.
    pub(super) fn mesh(&self) -> Mesh {
        self.build(&mut vec![NONE; self.positions.len()], self.groups.iter().flat_map(|g| &g.faces.triangles))
    }

    /// One mesh per material that is used: its name, the line of its first use, the mesh.
    pub(super) fn meshes(&self) -> Vec<(String, u32, Mesh)> {
        let mut first = vec![NONE; self.positions.len()];
        let used = self.groups.iter().filter(|g| !g.faces.triangles.is_empty());
        used.map(|g| (g.material.clone(), g.line, self.build(&mut first, g.faces.triangles.iter()))).collect()
    }

    /// One vertex for each different corner. `first` holds [`NONE`] for every position, before and after.
    fn build<'a>(&self, first: &mut [u32], triangles: impl Iterator<Item = &'a [Corner; 3]> + Clone) -> Mesh {
        let has = |i: usize| triangles.clone().flatten().any(|c| c[i] != NONE);
        let (has_uvs, has_normals) = (has(1), has(2));
        let mut mesh = Mesh::default();
        mesh.triangles.reserve_exact(triangles.clone().count());
        // Vertices of one position are chained: (corner, next vertex).
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
                }
                vertex
            });
            mesh.triangles.push(indices);
        }
        mesh.positions = chain.iter().map(|(c, _)| self.positions[c[0] as usize]).collect();
        if has_uvs {
            let uv = |(c, _): &(Corner, u32)| self.uvs.get(c[1] as usize).copied().unwrap_or_default();
            mesh.uvs = chain.iter().map(uv).collect();
        }
        if has_normals {
            let normal =
                |(c, _): &(Corner, u32)| self.normals.get(c[2] as usize).copied().unwrap_or_default();
            mesh.normals = chain.iter().map(normal).collect();
        }
        chain.iter().for_each(|(c, _)| first[c[0] as usize] = NONE);
        mesh
    }
}

/// A first look at a piece: what later ones must know of it.
#[derive(Default)]
struct Look {
    lines: u32,
    counts: [usize; 3],
    /// Names of materials, and their lines counted from 1 in the piece.
    materials: Vec<(String, u32)>,
}

impl Look {
    fn at(text: &[u8]) -> Look {
        let mut look = Look::default();
        for (line, count) in lines::logical(text) {
            let number = look.lines + 1;
            look.lines += count;
            match keyword(&line) {
                b"v" => look.counts[0] += 1,
                b"vt" => look.counts[1] += 1,
                b"vn" => look.counts[2] += 1,
                b"usemtl" => look.materials.push((text_after(without_comment(&line), b"usemtl"), number)),
                _ => {}
            }
        }
        look
    }
}

impl Piece {
    /// Parses whole lines; `groups` are those of its materials.
    fn parse(text: &[u8], flip_v: bool, before: Before, groups: &[usize]) -> Result<Piece, (u32, String)> {
        let mut piece = Piece {
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            faces: vec![(before.group, Faces::default())],
            libraries: Vec::new(),
            skipped: Skipped::default(),
        };
        let mut groups = groups.iter();
        let mut number = before.lines.saturating_add(1);
        for (line, count) in lines::logical(text) {
            piece
                .line(&line, number, flip_v, &before.counts, &mut groups)
                .map_err(|message| (number, message))?;
            number = number.saturating_add(count);
        }
        Ok(piece)
    }

    fn line(
        &mut self,
        line: &[u8],
        number: u32,
        flip_v: bool,
        before: &[usize; 3],
        groups: &mut std::slice::Iter<usize>,
    ) -> Result<(), String> {
        let line = without_comment(line);
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
                let own = [self.positions.len(), self.uvs.len(), self.normals.len()];
                let counts = [0, 1, 2].map(|i| before[i] + own[i]);
                self.face(&mut tokens, number, &counts)?;
            }
            Some(b"usemtl") => self.faces.extend(groups.next().map(|&group| (group, Faces::default()))),
            Some(b"mtllib") => self.libraries.push((text_after(line, b"mtllib"), number)),
            // Object and smoothing groups, lines and points make no difference to surfaces.
            _ => {}
        }
        Ok(())
    }

    fn face<'a>(
        &mut self,
        tokens: &mut impl Iterator<Item = &'a [u8]>,
        line: u32,
        counts: &[usize; 3],
    ) -> Result<(), String> {
        let Some((_, Faces { triangles, fans })) = self.faces.last_mut() else { return Ok(()) };
        let start = triangles.len();
        let mut corners = tokens.map(|token| corner(token, counts));
        if let (Some(first), Some(second)) = (corners.next().transpose()?, corners.next().transpose()?) {
            // Polygons are fans at first.
            let mut previous = second;
            for corner in corners {
                let corner = corner?;
                triangles.push([first, previous, corner]);
                previous = corner;
            }
        }
        match triangles.len() - start {
            0 => self.skipped.add(1, line as u64),
            n => fans.push(start, n + 2, 1),
        }
        Ok(())
    }
}

/// `v`, `v/t`, `v//n` or `v/t/n`, counted from 1, or from the end if negative; `counts` are those so far.
fn corner(token: &[u8], counts: &[usize; 3]) -> Result<Corner, String> {
    if let Some(corner) = plain_corner(token, counts) {
        return Ok(corner);
    }
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

/// The same for indices of digits alone that are in range, as nearly all are; `None` for others.
fn plain_corner(token: &[u8], counts: &[usize; 3]) -> Option<Corner> {
    let mut corner = [NONE; 3];
    let (mut part, mut digits, mut index) = (0, 0, 0usize);
    for &b in token.iter().chain(b"/") {
        match b {
            b'0'..=b'9' if digits < 10 => (index, digits) = (10 * index + (b - b'0') as usize, digits + 1),
            b'/' if part < 3 && index > 0 && index <= counts[part].min(NONE as usize) => {
                corner[part] = index as u32 - 1;
                (part, digits, index) = (part + 1, 0, 0);
            }
            b'/' if part == 1 && digits == 0 => part = 2,
            _ => return None,
        }
    }
    Some(corner)
}

fn without_comment(line: &[u8]) -> &[u8] {
    memchr(b'#', line).map_or(line, |comment| &line[..comment])
}

/// A line's first word.
fn keyword(line: &[u8]) -> &[u8] {
    let line = line.trim_ascii_start();
    let end = line.iter().position(|b| b.is_ascii_whitespace() || *b == b'#').unwrap_or(line.len());
    &line[..end]
}

fn show(token: &[u8]) -> String {
    String::from_utf8_lossy(token).chars().take(40).collect()
}

/// The rest of a line after its keyword: names may hold spaces.
fn text_after(line: &[u8], keyword: &[u8]) -> String {
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
            ("v 0 0 0\nf 1 2\n", 2),
            ("v 0 0 0\nf 1 1 1/1\n", 2),
            ("v 0 0 0\nf 1 1 1/x\n", 2),
            ("v 0 0 0\nf 1 1 1/1/1/1\n", 2),
            ("v 0 0 0\nf 1 1 99999999999999999999\n", 2),
            ("vt\n", 1),
            ("v \\\n0 0 0\n\nf 1 1 \\\n 2\n", 4),
        ] {
            match read(text) {
                Err(Error::Scene { line: found, .. }) => assert_eq!(found, line, "{text}"),
                other => panic!("{text}: {other:?}"),
            }
        }
        assert!(matches!(Obj::read(Path::new("/nonexistent.obj"), true), Err(Error::File { .. })));
    }

    fn area(mesh: &Mesh) -> f32 {
        (0..mesh.triangles.len() as u32).map(|i| 0.5 * mesh.area_vector(i).length()).sum()
    }

    #[test]
    fn polygons_need_not_be_convex() {
        let obj = read(
            "v -1 -1 0\nv 0 0 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3 4\nusemtl a\nf 1 2 4\nf 4 3 2 1\nf 2 3 4\n\
             f 2 3 4 1\nv 9 9 9\nusemtl b\nf 1 2 3 4\nf 1 2 4\nf -2 -5 -4 -3\n",
        );
        let areas: Vec<f32> = obj.unwrap().meshes().iter().map(|(_, _, mesh)| area(mesh)).collect();
        assert_eq!(areas, [1.0, 3.0, 2.5]);
    }

    #[test]
    fn statements_go_on_in_the_next_line() {
        let obj = read(
            "\u{feff}v 0 \\\n0 0\nv 1 0 0\r\nv 1 1 0\nv 0 \\\r\n1 0\n# C:\\\nvt 0 0\nusemtl a \\\n b\n\
             mtllib a.mtl \\\nb.mtl\nf 1/1 2/1\\\n3/1 \\\n 4/1 \\\n\n",
        );
        let obj = obj.unwrap();
        assert_eq!(obj.libraries, [("a.mtl  b.mtl".to_string(), 11)]);
        let meshes = obj.meshes();
        assert_eq!((meshes[0].0.as_str(), meshes[0].1), ("a   b", 9));
        assert_eq!(meshes[0].2.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn faces_without_a_surface_are_counted() {
        let obj = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\np 1\nf 1 2\nf 1 2 3\nf 1\nf\n").unwrap();
        let warning = obj.warning(Path::new("a.obj")).unwrap();
        assert!(warning.starts_with("a.obj: 3 faces have") && warning.contains("line 6"), "{warning}");
        assert_eq!(obj.mesh().triangles.len(), 1);
        assert!(!obj.is_empty());
        let obj = read("v 0 0 0\nv 1 0 0\nf 1 2\n").unwrap();
        assert!(obj.is_empty() && obj.warning(Path::new("a.obj")).unwrap().contains("1 face has"));
        assert!(read("v 0 0 0\nf 1 1 1\n").unwrap().warning(Path::new("a.obj")).is_none());
    }

    /// Lines are shared by threads, which must know what stood before.
    #[test]
    fn pieces_are_put_together() {
        const N: u32 = 60_000;
        let mut text = String::from("v 0 0 0\nv 1 0 0\nusemtl a\n");
        for i in 0..N {
            if i % 7000 == 0 {
                text += if i % 14000 == 0 { "usemtl b\n" } else { "usemtl a\n" };
            }
            text += &format!("v {} 1 0\nvt .5 {i}\nf -3/{} {}/-1 \\\n -1/1\n", i + 2, i + 1, i + 2);
        }
        let obj = read(&text).unwrap();
        let count = |material: &str| {
            let group = obj.groups.iter().find(|g| g.material == material).unwrap();
            (group.line, group.faces.triangles.len())
        };
        assert_eq!((count("a"), count("b")), ((3, 28_000), (4, 32_000)));
        for group in &obj.groups {
            for t in &group.faces.triangles {
                let i = t[0][0];
                assert_eq!(*t, [[i, i, NONE], [i + 1, i, NONE], [i + 2, 0, NONE]]);
            }
        }
        let lines = text.lines().count() as u32;
        for end in ["f 1 2 60003\n", "f 1 2 -60003", "v 1 2\n"] {
            match read(&format!("{text}{end}")) {
                Err(Error::Scene { line, .. }) => assert_eq!(line, lines + 1, "{end}"),
                _ => panic!("{end} was taken"),
            }
        }
    }
}
