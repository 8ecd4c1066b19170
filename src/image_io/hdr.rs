//! Radiance HDR. The header is read here, as the `image` crate takes one form of it only; the crate decodes
//! the scanlines.
//!
//! EXPOSURE and COLORCORR have no effect, as in Mitsuba: values are taken as they are stored.

use super::{Image, check_size, reason};
use crate::math::Rgb;
use image::DynamicImage;
use image::codecs::hdr::HdrDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::Path;

/// What the file begins with, whatever program wrote it.
pub(super) const MAGIC: &[u8] = b"#?";

/// How scanlines follow each other, and pixels in them (Radiance's "resolution string").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    /// By line, by pixel in the line.
    axes: [Axis; 2],
    lines: usize,
    /// Pixels in a line.
    length: usize,
}

/// Where the next line or pixel lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    Right,
    Left,
    Down,
    Up,
}

impl Axis {
    /// Radiance's Y points up.
    fn parse(word: &str) -> Option<Axis> {
        Some(match word {
            "+X" => Axis::Right,
            "-X" => Axis::Left,
            "-Y" => Axis::Down,
            "+Y" => Axis::Up,
            _ => return None,
        })
    }

    fn is_vertical(self) -> bool {
        matches!(self, Axis::Down | Axis::Up)
    }

    /// Row or column number `i` of `n`, from the top or left.
    fn place(self, i: usize, n: usize) -> usize {
        match self {
            Axis::Right | Axis::Down => i,
            Axis::Left | Axis::Up => n - 1 - i,
        }
    }
}

impl Layout {
    /// `None` if the line is no resolution string.
    fn parse(line: &str) -> Option<Layout> {
        let mut words = line.split_whitespace();
        let mut next = || Some((Axis::parse(words.next()?)?, words.next()?.parse().ok()?));
        let ((first, lines), (second, length)) = (next()?, next()?);
        let complete = words.next().is_none() && first.is_vertical() != second.is_vertical();
        complete.then_some(Layout { axes: [first, second], lines, length })
    }

    /// Columns and rows of the picture.
    fn size(&self) -> (usize, usize) {
        if self.axes[0].is_vertical() { (self.length, self.lines) } else { (self.lines, self.length) }
    }

    /// The picture that stored pixels make.
    fn arrange(&self, stored: Vec<Rgb>) -> Image {
        let (width, height) = self.size();
        if self.axes == [Axis::Down, Axis::Right] {
            return Image { width, height, pixels: stored };
        }
        let mut pixels = vec![Rgb::ZERO; width * height];
        for (line, values) in stored.chunks_exact(self.length).enumerate() {
            let line = self.axes[0].place(line, self.lines);
            for (i, value) in values.iter().enumerate() {
                let i = self.axes[1].place(i, self.length);
                let at = if self.axes[0].is_vertical() { line * width + i } else { i * width + line };
                pixels[at] = *value;
            }
        }
        Image { width, height, pixels }
    }
}

/// Reads up to the first scanline.
fn header(reader: &mut impl BufRead) -> Result<Layout, String> {
    let mut is_over = false;
    loop {
        let mut line = Vec::new();
        if reader.read_until(b'\n', &mut line).map_err(|e| reason(&e))? == 0 {
            return Err("its header ends too soon".into());
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        // Like Mitsuba without waiting for the empty line.
        match Layout::parse(line) {
            Some(layout) => return Ok(layout),
            None if is_over => {
                return Err(format!("'{}' should be its size, for example '-Y 480 +X 640'", shown(line)));
            }
            None => is_over = line.is_empty(),
        }
        let format = line.split_once('=').filter(|(key, _)| key.trim() == "FORMAT").map(|(_, f)| f.trim());
        if let Some(format) = format.filter(|f| *f != "32-bit_rle_rgbe") {
            return Err(format!("its colours are '{}': convert them to 32-bit_rle_rgbe", shown(format)));
        }
    }
}

/// The beginning of a text from a file, without what a terminal would obey.
fn shown(text: &str) -> String {
    text.chars().take(40).flat_map(char::escape_debug).collect()
}

pub(super) fn read(path: &Path) -> Result<Image, String> {
    let file = File::open(path).map_err(|e| reason(&e))?;
    let bytes = file.metadata().map_err(|e| reason(&e))?.len();
    let mut reader = BufReader::new(file);
    let layout = header(&mut reader)?;
    check_size(bytes, layout.length as u64, layout.lines as u64)?;
    let plain = format!("#?RADIANCE\n\n-Y {} +X {}\n", layout.lines, layout.length);
    let decoder = HdrDecoder::new(Cursor::new(plain).chain(reader)).map_err(|e| e.to_string())?;
    let stored = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb32f();
    let pixels = stored.pixels().map(|p| Rgb::from_array(p.0)).collect();
    drop(stored);
    Ok(layout.arrange(pixels))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_io::read;
    use std::fs;

    fn read_bytes(bytes: &[u8]) -> Result<Image, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.hdr");
        fs::write(&path, bytes).unwrap();
        read(&path).map_err(|e| e.to_string())
    }

    /// A pixel by itself: (x, y, 7) / 4.
    fn rgbe(x: usize, y: usize) -> [u8; 4] {
        [x as u8, y as u8, 7, 134]
    }

    fn value(x: usize, y: usize) -> Rgb {
        Rgb::new(x as f32, y as f32, 7.0) / 4.0
    }

    fn expected(width: usize, height: usize) -> Image {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| value(x, y))).collect();
        Image { width, height, pixels }
    }

    const HEAD: &str = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n";

    /// All eight, of a picture as wide as those whose lines are not compressed, and of a wider one.
    #[test]
    fn orientations() {
        // Columns or rows (from the top) in the order in which they are stored.
        let order = |axis: &str, n: usize| -> Vec<usize> {
            match axis {
                "+X" | "-Y" => (0..n).collect(),
                _ => (0..n).rev().collect(),
            }
        };
        for (width, height) in [(3, 2), (9, 12)] {
            for x in ["+X", "-X"] {
                for y in ["+Y", "-Y"] {
                    let (columns, rows) = (order(x, width), order(y, height));
                    let mut by_row = format!("{HEAD}{y} {height} {x} {width}\n").into_bytes();
                    rows.iter().for_each(|r| columns.iter().for_each(|c| by_row.extend(rgbe(*c, *r))));
                    assert_eq!(read_bytes(&by_row).unwrap(), expected(width, height), "{y} {x}");
                    let mut by_column = format!("{HEAD}{x} {width} {y} {height}\n").into_bytes();
                    columns.iter().for_each(|c| rows.iter().for_each(|r| by_column.extend(rgbe(*c, *r))));
                    assert_eq!(read_bytes(&by_column).unwrap(), expected(width, height), "{x} {y}");
                }
            }
        }
    }

    /// Values do not depend on the header, as in Mitsuba.
    #[test]
    fn headers() {
        let pixels: Vec<u8> = [rgbe(0, 0), rgbe(1, 0), rgbe(2, 0)].concat();
        let parse = |head: &str| read_bytes(&[head.as_bytes(), &pixels].concat());
        for head in [
            "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 3\n",
            "#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 3\n",
            "#?AUTOPANO\n# a comment\npfilt -x 3 -y 1\nFORMAT = 32-bit_rle_rgbe \nVIEW= -vtv\n\n-Y 1 +X 3\n",
            "#?RADIANCE\nEXPOSURE=2.0\nEXPOSURE= .5\nCOLORCORR=1 2 3\nGAMMA=1\nPIXASPECT=2\n\n-Y 1 +X 3\n",
            "#?RADIANCE\nEXPOSURE=bright\nCOLORCORR=\n\n-Y  1  +X  3 \n",
            "#?\n\n-Y 1 +X 3\n",
            "#?RGBE\nFORMAT=32-bit_rle_rgbe\n-Y 1 +X 3\n",
            "#?RGBE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 1 +X 3\r\n",
        ] {
            assert_eq!(parse(head).unwrap(), expected(3, 1), "{head}");
        }
        for (head, said) in [
            ("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 3\n", "32-bit_rle_xyze"),
            ("#?RADIANCE\n\n-Y 1 -Y 3\n", "-Y 1 -Y 3"),
            ("#?RADIANCE\n\n-Y 1 +X\n", "-Y 480 +X 640"),
            ("#?RADIANCE\n\n-Y -1 +X 3\n", "-Y -1 +X 3"),
            ("#?RADIANCE\n\n\u{e9}\u{e9}\n", "should be its size"),
            ("#?RADIANCE\n\n-Y 0 +X 3\n", "no pixels"),
            ("#?RADIANCE\n\n-Y 2 +X 3\n", "cannot read"),
            ("#?RADIANCE\n\n+X 99999 +Y 99999\n", "too short for 99999x99999"),
        ] {
            let error = parse(head).unwrap_err();
            assert!(error.contains("a.hdr") && error.contains(said), "{head}: {error}");
        }
        let error = read_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n").unwrap_err();
        assert!(error.contains("too soon"), "{error}");
    }

    /// Lines of runs by channel, of the runs before 1991, and of none.
    #[test]
    fn compressions() {
        let line = |bytes: &[u8]| {
            let image = read_bytes(&[HEAD.as_bytes(), b"-Y 1 +X 9\n", bytes].concat()).unwrap();
            image.pixels.iter().map(|p| *p * 4.0).collect::<Vec<_>>()
        };
        let pixel = |x: u8| Rgb::new(x as f32, 5.0, 7.0);
        let channel = |value| [128 + 9, value];
        let red = [131, 1, 6, 2, 3, 4, 5, 6, 7];
        let by_channel = [&[2, 2, 0, 9][..], &red, &channel(5), &channel(7), &channel(134)].concat();
        assert_eq!(line(&by_channel), [1, 1, 1, 2, 3, 4, 5, 6, 7].map(pixel));
        let old = [[1, 5, 7, 134], [1, 1, 1, 2], [2, 5, 7, 134], [1, 1, 1, 5]].concat();
        assert_eq!(line(&old), [1, 1, 1, 2, 2, 2, 2, 2, 2].map(pixel));
        let flat: Vec<u8> = (1..10).flat_map(|x| [x, 5, 7, 134]).collect();
        assert_eq!(line(&flat), [1, 2, 3, 4, 5, 6, 7, 8, 9].map(pixel));
        // 300 = 44 + 256 · 1.
        let long = [&[9, 5, 7, 134][..], &[1, 1, 1, 43, 1, 1, 1, 1]].concat();
        let image = read_bytes(&[HEAD.as_bytes(), b"-Y 1 +X 300\n", &long].concat()).unwrap();
        assert!(image.pixels.iter().all(|p| *p * 4.0 == pixel(9)));
    }
}
