//! Logical lines of OBJ and MTL files: a line that ends in a backslash goes on in the next one.

use memchr::{memchr, memchr_iter, memrchr, memrchr_iter};
use std::borrow::Cow;

/// Logical lines, each with how many lines of the file it takes. The last may lack its end.
pub(super) fn logical(text: &[u8]) -> impl Iterator<Item = (Cow<'_, [u8]>, u32)> {
    let mut rest = text;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let newline = memchr(b'\n', rest).unwrap_or(rest.len());
        if ends(rest, newline) {
            let (line, after) = rest.split_at(rest.len().min(newline + 1));
            rest = after;
            return Some((Cow::Borrowed(line), 1));
        }
        let (lines, after) = rest.split_at(end(rest, newline).unwrap_or(rest.len()));
        rest = after;
        Some(joined(lines))
    })
}

#[cold]
fn joined(lines: &[u8]) -> (Cow<'static, [u8]>, u32) {
    let (mut joined, mut count) = (Vec::with_capacity(lines.len()), 0);
    for line in lines.split_inclusive(|&b| b == b'\n') {
        let line = line.trim_ascii_end();
        joined.extend(if continues(line) { &line[..line.len() - 1] } else { line });
        joined.push(b' ');
        count += 1;
    }
    (Cow::Owned(joined), count)
}

/// Where the first logical line ends whose end is at or after `from`.
pub(super) fn end(text: &[u8], from: usize) -> Option<usize> {
    let from = from.min(text.len());
    memchr_iter(b'\n', &text[from..]).map(|i| from + i).find(|&i| ends(text, i)).map(|i| i + 1)
}

/// The length of all whole logical lines.
pub(super) fn whole(text: &[u8]) -> usize {
    memrchr_iter(b'\n', text).find(|&i| ends(text, i)).map_or(0, |i| i + 1)
}

/// Whether this end of a line ends a logical line.
fn ends(text: &[u8], newline: usize) -> bool {
    let last = text[..newline].iter().rev().find(|b| !matches!(b, b' ' | b'\t' | b'\r'));
    last != Some(&b'\\') || {
        let start = memrchr(b'\n', &text[..newline]).map_or(0, |i| i + 1);
        !continues(&text[start..newline])
    }
}

/// Whether a line goes on in the next. Comments don't: many quote a Windows folder at their end.
fn continues(line: &[u8]) -> bool {
    line.trim_ascii_end().ends_with(b"\\") && memchr(b'#', line).is_none()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<(String, u32)> {
        logical(text.as_bytes()).map(|(l, n)| (String::from_utf8_lossy(&l).trim().to_string(), n)).collect()
    }

    #[test]
    fn backslashes_join_lines() {
        for (text, expected) in [
            ("a b\nc", vec![("a b", 1), ("c", 1)]),
            ("a\\\nb\n\nc\n", vec![("a b", 2), ("", 1), ("c", 1)]),
            ("a \\\r\n b \\  \n c\r\nd", vec![("a   b   c", 3), ("d", 1)]),
            (
                "# C:\\dir\\\na # \\\nb \\\n c # \\\nd",
                vec![("# C:\\dir\\", 1), ("a # \\", 1), ("b   c # \\", 2), ("d", 1)],
            ),
            ("a\\b\n", vec![("a\\b", 1)]),
            ("a \\", vec![("a", 1)]),
            ("a \\\n", vec![("a", 1)]),
            ("\\\n\\\n", vec![("", 2)]),
            ("", vec![]),
        ] {
            let found = read(text);
            let found: Vec<_> = found.iter().map(|(line, n)| (line.as_str(), *n)).collect();
            assert_eq!(found, expected, "{text:?}");
        }
    }

    /// Where text is cut makes no difference.
    #[test]
    fn cuts_are_between_logical_lines() {
        let text = "v 1 \\\n2 3\n# x \\\nf 1 \\\n 2 \\\n 3\nusemtl a \\\n".as_bytes();
        for from in 0..=text.len() {
            let cut = end(text, from).unwrap_or(text.len());
            let halves: Vec<_> = logical(&text[..cut]).chain(logical(&text[cut..])).collect();
            assert!(halves.iter().eq(logical(text).collect::<Vec<_>>().iter()), "{from}");
            assert!(cut >= from);
        }
        assert_eq!(whole(text), text.len() - "usemtl a \\\n".len());
        assert_eq!(whole(b"f 1 \\\n 2"), 0);
    }
}
