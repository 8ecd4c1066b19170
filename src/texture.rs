//! Textures, and parameters that may be textured. Knows no file formats: the scene loader fills it.

use crate::image_io::Image;
use crate::math::{Rgb, luminance};
use crate::shape::{Mesh, Shape};
use glam::{Affine2, IVec2, Vec2};
use std::fmt;

/// Where a texture is looked up.
#[derive(Clone, Copy)]
pub struct Lookup<'a> {
    /// Texture coordinates.
    pub uv: Vec2,
    /// The mesh, if the place is on one.
    pub mesh: Option<&'a Mesh>,
    /// Its triangle.
    pub triangle: u32,
    /// Barycentric weights of the triangle's second and third vertex.
    pub weights: Vec2,
}

impl<'a> Lookup<'a> {
    fn attribute(&self, name: &str) -> Option<Rgb> {
        let mesh = self.mesh?;
        let attribute = mesh.attribute(name)?;
        if !attribute.of_vertices() {
            return attribute.values.get(self.triangle as usize).copied();
        }
        let [a, b, c] = mesh.triangles.get(self.triangle as usize)?.map(|v| attribute.values[v as usize]);
        Some(a + (b - a) * self.weights.x + (c - a) * self.weights.y)
    }

    /// A place on a shape; `triangle` and `weights` are of no meaning where it is no mesh.
    pub fn new(shape: &'a Shape, uv: Vec2, triangle: u32, weights: Vec2) -> Lookup<'a> {
        let mesh = match shape {
            Shape::Mesh(mesh) => Some(mesh),
            _ => None,
        };
        Lookup { uv, mesh, triangle, weights }
    }
}

impl From<Vec2> for Lookup<'_> {
    /// A place that is on no shape.
    fn from(uv: Vec2) -> Self {
        Lookup { uv, mesh: None, triangle: 0, weights: Vec2::ZERO }
    }
}

impl fmt::Debug for Lookup<'_> {
    /// Without the mesh, which may be large.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "Lookup({}, triangle {}, {})", self.uv, self.triangle, self.weights)
    }
}

/// The closed set of textures.
#[derive(Clone, Debug)]
pub enum Texture {
    /// Two colours in squares.
    Checkerboard {
        /// Colour of the square at the origin.
        color0: Color,
        /// The other colour.
        color1: Color,
        /// Applied to texture coordinates first (column-major 2×3).
        to_uv: Affine2,
    },
    /// Lines along the edges of the unit squares.
    Grid {
        /// Colour between the lines.
        color0: Color,
        /// Colour of the lines.
        color1: Color,
        /// Half the width of the lines.
        line_width: f32,
        /// Applied to texture coordinates first (column-major 2×3).
        to_uv: Affine2,
    },
    /// Another texture times a colour.
    Scaled {
        /// The texture.
        texture: u32,
        /// The colour.
        scale: Rgb,
    },
    /// What the mesh has by this name; black on what has nothing.
    Attribute {
        /// The name.
        name: String,
        /// Factor on it.
        scale: Rgb,
    },
    /// An image.
    Bitmap(Bitmap),
}

/// What lies between texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The mean of the four nearest texel centres, weighted by distance.
    Bilinear,
    /// The texel itself.
    Nearest,
}

/// What lies beyond the unit square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    Repeat,
    /// The image again, every second one mirrored.
    Mirror,
    /// The outermost texels.
    Clamp,
}

/// An image as a texture: u runs to the right, v *down* from the top row, texel centres at half-integers (Mitsuba's
/// convention; OBJ files flip v to fit it).
#[derive(Clone, Debug)]
pub struct Bitmap {
    image: Image,
    interpolation: Interpolation,
    /// By u, by v.
    wrap: [Wrap; 2],
    to_uv: Affine2,
}

impl Bitmap {
    /// `wrap` says what is beyond the image by u and by v; `to_uv` is applied to texture coordinates first.
    ///
    /// # Errors
    /// A message if the image is empty.
    pub fn new(
        image: Image,
        interpolation: Interpolation,
        wrap: [Wrap; 2],
        to_uv: Affine2,
    ) -> Result<Bitmap, String> {
        let size = image.width.checked_mul(image.height);
        let fits = image.width.max(image.height) < i32::MAX as usize;
        if image.pixels.is_empty() || size != Some(image.pixels.len()) || !fits {
            return Err("the image is empty".into());
        }
        Ok(Bitmap { image, interpolation, wrap, to_uv })
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.image.width, self.image.height)
    }

    /// The image, and all else that the bitmap is made from.
    pub fn contents(&self) -> (&Image, (Interpolation, [Wrap; 2], Affine2)) {
        (&self.image, (self.interpolation, self.wrap, self.to_uv))
    }

    fn eval(&self, uv: Vec2) -> Rgb {
        let p =
            self.to_uv.transform_point2(uv) * Vec2::new(self.image.width as f32, self.image.height as f32);
        match self.interpolation {
            Interpolation::Nearest => self.texel(p.floor().as_ivec2()),
            Interpolation::Bilinear => {
                let p = p - 0.5;
                let (corner, w) = (p.floor().as_ivec2(), p - p.floor());
                let at =
                    |x, y| self.texel(IVec2::new(corner.x.saturating_add(x), corner.y.saturating_add(y)));
                let (top, bottom) = (at(0, 0).lerp(at(1, 0), w.x), at(0, 1).lerp(at(1, 1), w.x));
                top.lerp(bottom, w.y)
            }
        }
    }

    /// Partial derivatives of the luminance by u and v.
    fn gradient(&self, uv: Vec2) -> Vec2 {
        if self.interpolation == Interpolation::Nearest {
            return Vec2::ZERO;
        }
        let size = Vec2::new(self.image.width as f32, self.image.height as f32);
        let p = self.to_uv.transform_point2(uv) * size - 0.5;
        let (corner, w) = (p.floor().as_ivec2(), p - p.floor());
        let at =
            |x, y| luminance(self.texel(IVec2::new(corner.x.saturating_add(x), corner.y.saturating_add(y))));
        let [a, b, c, d] = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        let by_texel = Vec2::new((b - a) + w.y * (d - c - b + a), (c - a) + w.x * (d - b - c + a));
        self.to_uv.matrix2.transpose() * (by_texel * size)
    }

    fn texel(&self, p: IVec2) -> Rgb {
        let (width, height) = (self.image.width, self.image.height);
        let wrap = |i: i32, n: usize, wrap| -> usize {
            let n = n as i32;
            let wrapped = match wrap {
                Wrap::Repeat => i.rem_euclid(n),
                Wrap::Clamp => i.clamp(0, n - 1),
                Wrap::Mirror => {
                    let inside = i.rem_euclid(n);
                    if i.div_euclid(n) & 1 == 0 { inside } else { n - 1 - inside }
                }
            };
            wrapped as usize
        };
        let [u, v] = self.wrap;
        self.image.pixels[wrap(p.y, height, v) * width + wrap(p.x, width, u)]
    }
}

impl Texture {
    /// The value at a place. `textures` are the scene's, which this one may refer to.
    pub fn eval(&self, textures: &[Texture], at: &Lookup) -> Rgb {
        match self {
            Texture::Checkerboard { color0, color1, to_uv } => {
                let t = to_uv.transform_point2(at.uv);
                let t = t - t.floor();
                let color = if (t.x > 0.5) == (t.y > 0.5) { color0 } else { color1 };
                color.eval(textures, at)
            }
            Texture::Grid { color0, color1, line_width, to_uv } => {
                let t = to_uv.transform_point2(at.uv);
                let from_line = (t - t.round()).abs().min_element();
                let color = if from_line < *line_width { color1 } else { color0 };
                color.eval(textures, at)
            }
            Texture::Scaled { texture, scale } => textures[*texture as usize].eval(textures, at) * *scale,
            Texture::Attribute { name, scale } => at.attribute(name).unwrap_or(Rgb::ZERO) * *scale,
            Texture::Bitmap(bitmap) => bitmap.eval(at.uv),
        }
    }

    /// Partial derivatives of the luminance by u and v; zero where there are none.
    pub fn gradient(&self, textures: &[Texture], uv: Vec2) -> Vec2 {
        match self {
            Texture::Checkerboard { .. } | Texture::Grid { .. } | Texture::Attribute { .. } => Vec2::ZERO,
            Texture::Scaled { texture, scale } => {
                textures[*texture as usize].gradient(textures, uv) * luminance(*scale)
            }
            Texture::Bitmap(bitmap) => bitmap.gradient(uv),
        }
    }
}

/// A colour parameter: the same everywhere, or an index into the scene's textures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// The same everywhere.
    Constant(Rgb),
    /// Looked up; the index is valid in the scene's list of textures.
    Texture(u32),
}

impl Color {
    /// Whether it must be looked up.
    pub fn is_textured(&self) -> bool {
        matches!(self, Color::Texture(_))
    }

    /// The value at a place.
    pub fn eval(&self, textures: &[Texture], at: &Lookup) -> Rgb {
        match *self {
            Color::Constant(c) => c,
            Color::Texture(i) => textures[i as usize].eval(textures, at),
        }
    }
}

/// A number that may be textured: roughness, opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// The same everywhere.
    Constant(f32),
    /// The luminance of a texture; the index is valid in the scene's list of textures.
    Texture(u32),
}

impl Scalar {
    /// Whether it must be looked up.
    pub fn is_textured(&self) -> bool {
        matches!(self, Scalar::Texture(_))
    }

    /// The value at a place.
    pub fn eval(&self, textures: &[Texture], at: &Lookup) -> f32 {
        match *self {
            Scalar::Constant(x) => x,
            Scalar::Texture(i) => luminance(textures[i as usize].eval(textures, at)),
        }
    }

    /// Partial derivatives by u and v.
    pub fn gradient(&self, textures: &[Texture], at: &Lookup) -> Vec2 {
        match *self {
            Scalar::Constant(_) => Vec2::ZERO,
            Scalar::Texture(i) => textures[i as usize].gradient(textures, at.uv),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Attribute;

    /// Texels 0, 1, 2 / 3, 4, 5.
    fn ramp(interpolation: Interpolation, wrap: Wrap) -> Texture {
        let image = Image { width: 3, height: 2, pixels: (0..6).map(|i| Rgb::splat(i as f32)).collect() };
        Texture::Bitmap(Bitmap::new(image, interpolation, [wrap; 2], Affine2::IDENTITY).unwrap())
    }

    /// Expected values from Mitsuba 3.9.1.
    #[test]
    fn lookups_are_those_of_mitsuba() {
        const UVS: [[f32; 2]; 7] =
            [[0.1, 0.2], [0.5, 0.5], [0.9, 0.95], [-0.3, 0.4], [1.2, -0.6], [2.7, 3.1], [-1.45, -2.2]];
        let expected: [(Interpolation, Wrap, [f32; 7]); 6] = [
            (Interpolation::Bilinear, Wrap::Repeat, [0.7, 2.5, 3.4, 2.5, 1.0, 2.5, 3.85]),
            (Interpolation::Bilinear, Wrap::Mirror, [0.0, 2.5, 5.0, 1.3, 4.0, 4.6, 1.15]),
            (Interpolation::Bilinear, Wrap::Clamp, [0.0, 2.5, 5.0, 0.9, 2.0, 5.0, 0.0]),
            (Interpolation::Nearest, Wrap::Repeat, [0.0, 4.0, 5.0, 2.0, 0.0, 2.0, 4.0]),
            (Interpolation::Nearest, Wrap::Mirror, [0.0, 4.0, 5.0, 0.0, 5.0, 5.0, 1.0]),
            (Interpolation::Nearest, Wrap::Clamp, [0.0, 4.0, 5.0, 0.0, 2.0, 5.0, 0.0]),
        ];
        for (interpolation, wrap, values) in expected {
            for (uv, value) in UVS.into_iter().zip(values) {
                let x = ramp(interpolation, wrap).eval(&[], &Vec2::from_array(uv).into()).x;
                assert!((x - value).abs() < 1e-4, "{interpolation:?} {wrap:?} {uv:?}: {x} is not {value}");
            }
        }
    }

    #[test]
    fn gradients_are_differences() {
        let to_uv = Affine2::from_cols(Vec2::new(0.5, 0.2), Vec2::new(-0.3, 1.5), Vec2::new(0.1, 0.0));
        let image =
            Image { width: 3, height: 2, pixels: [0.0, 1.0, 5.0, 2.0, 2.5, -1.0].map(Rgb::splat).into() };
        let bitmap = Bitmap::new(image, Interpolation::Bilinear, [Wrap::Mirror; 2], to_uv).unwrap();
        let value = |uv| luminance(bitmap.eval(uv));
        for uv in [Vec2::new(0.3, 0.4), Vec2::new(0.9, 0.55), Vec2::new(1.7, -0.2)] {
            let step = |d: Vec2| (value(uv + d * 1e-3) - value(uv - d * 1e-3)) / 2e-3;
            let expected = Vec2::new(step(Vec2::X), step(Vec2::Y));
            assert!(
                (bitmap.gradient(uv) - expected).length() < 1e-2,
                "{uv}: {} {expected}",
                bitmap.gradient(uv)
            );
        }
        assert_eq!(ramp(Interpolation::Nearest, Wrap::Clamp).gradient(&[], Vec2::splat(0.4)), Vec2::ZERO);
    }

    #[test]
    fn strange_coordinates_are_harmless() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for interpolation in [Interpolation::Nearest, Interpolation::Bilinear] {
                for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, -0.0] {
                    ramp(interpolation, wrap).eval(&[], &Vec2::new(x, 0.5).into());
                }
            }
        }
    }

    #[test]
    fn an_empty_image_is_no_texture() {
        let empty = Image { width: 0, height: 0, pixels: vec![] };
        assert!(Bitmap::new(empty, Interpolation::Nearest, [Wrap::Clamp; 2], Affine2::IDENTITY).is_err());
    }

    #[test]
    fn textures_of_textures() {
        let textures = [
            ramp(Interpolation::Nearest, Wrap::Clamp),
            Texture::Scaled { texture: 0, scale: Rgb::new(1.0, 2.0, 3.0) },
            Texture::Checkerboard {
                color0: Color::Texture(1),
                color1: Color::Constant(Rgb::ONE),
                to_uv: Affine2::from_scale(Vec2::splat(2.0)),
            },
        ];
        let eval = |uv: Vec2| Color::Texture(2).eval(&textures, &uv.into());
        assert_eq!(eval(Vec2::new(0.9, 0.9)), Rgb::new(5.0, 10.0, 15.0));
        assert_eq!(eval(Vec2::new(0.9, 0.7)), Rgb::ONE);
    }

    /// Vertices 0, 1, 2 with x from 0 to 2; the second of two triangles.
    #[test]
    fn attributes_of_meshes() {
        let values = |scale: f32| (0..3).map(|i| Rgb::new(i as f32 * scale, 1.0, 0.0)).collect();
        let attribute = |name: &str, scale| Attribute { name: name.into(), values: values(scale) };
        let mesh = Mesh {
            positions: vec![glam::Vec3::ZERO; 3],
            triangles: vec![[0, 1, 2], [2, 0, 1]],
            attributes: vec![attribute("vertex_color", 1.0), attribute("face_color", 10.0)],
            ..Mesh::default()
        };
        let shape = Shape::Mesh(mesh);
        let at = Lookup::new(&shape, Vec2::ZERO, 1, Vec2::new(0.25, 0.5));
        let eval =
            |name: &str| Texture::Attribute { name: name.into(), scale: Rgb::splat(2.0) }.eval(&[], &at);
        assert_eq!(eval("vertex_color"), 2.0 * Rgb::new(0.25 * 2.0 + 0.5, 1.0, 0.0));
        assert_eq!(eval("face_color"), 2.0 * Rgb::new(10.0, 1.0, 0.0));
        assert_eq!(eval("vertex_other"), Rgb::ZERO);
    }
}
