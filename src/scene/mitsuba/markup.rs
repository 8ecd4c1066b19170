//! Makes XML well-formed where Mitsuba's parser (pugixml) forgives and ours does not: comments with `--` inside,
//! text between elements, a document type, `&` and `<` in attribute values, text that is not UTF-8.

/// Deepest nesting of elements: scenes need less than ten.
pub(super) const MAX_DEPTH: usize = 60;

/// Tags alone, each where it was.
#[derive(Debug, PartialEq)]
pub(super) struct Tidy {
    pub text: String,
    /// Line and beginning of the text between elements.
    pub stray: Vec<(u32, String)>,
}

/// Text of a file: UTF-8 or UTF-16; what is neither is taken for Latin-1.
pub(super) fn decode(bytes: Vec<u8>) -> String {
    let utf16 = |of: fn([u8; 2]) -> u16| {
        let units = bytes[2..].chunks_exact(2).map(|pair| of([pair[0], pair[1]]));
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
    };
    match bytes[..] {
        [0xFF, 0xFE, ..] => utf16(u16::from_le_bytes),
        [0xFE, 0xFF, ..] => utf16(u16::from_be_bytes),
        _ => {
            String::from_utf8(bytes).unwrap_or_else(|e| e.into_bytes().into_iter().map(char::from).collect())
        }
    }
}

/// What is not tags is blanked out. Parser and readers recurse into elements: what nests too deep is refused here, with
/// its line.
pub(super) fn tidy(text: &str) -> Result<Tidy, u32> {
    let mut tidy = Tidy { text: String::with_capacity(text.len()), stray: Vec::new() };
    let (mut rest, mut line, mut depth) = (text.trim_start_matches('\u{feff}'), 1, 0usize);
    while !rest.is_empty() {
        // An end that is not there is left to the parser to tell.
        let until = |start: &str, end: &str| {
            rest[start.len()..].find(end).map_or(rest.len(), |i| start.len() + i + end.len())
        };
        let length = if !rest.starts_with('<') {
            let length = rest.find('<').unwrap_or(rest.len());
            tidy.stray(&rest[..length], line);
            length
        } else if rest.starts_with("<!--") {
            until("<!--", "-->")
        } else if rest.starts_with("<![CDATA[") {
            let length = until("<![CDATA[", "]]>");
            tidy.stray(rest[..length].trim_start_matches("<![CDATA[").trim_end_matches("]]>"), line);
            length
        } else if rest.starts_with("<?") {
            until("<?", "?>")
        } else if rest.starts_with("<!") {
            until("<!", ">")
        } else {
            tag_length(rest)
        };
        let piece;
        (piece, rest) = rest.split_at(length);
        let is_tag = piece.starts_with('<') && !piece.starts_with("<!") && !piece.starts_with("<?");
        let defines_entities = piece.starts_with("<!D") && piece.contains('[');
        if defines_entities {
            tidy.text.push_str(piece);
        } else if is_tag {
            if piece.starts_with("</") {
                depth = depth.saturating_sub(1);
            } else if !piece.ends_with("/>") {
                depth += 1;
            }
            if depth > MAX_DEPTH {
                return Err(line);
            }
            push_tag(&mut tidy.text, piece);
        } else if rest.is_empty() && piece.starts_with('<') && !piece.ends_with('>') {
            tidy.text.push_str(piece);
        } else {
            tidy.text.extend(piece.chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        }
        line += piece.bytes().filter(|b| *b == b'\n').count() as u32;
    }
    Ok(tidy)
}

impl Tidy {
    fn stray(&mut self, text: &str, line: u32) {
        let begin = text.trim_start();
        if !begin.is_empty() {
            let before = &text[..text.len() - begin.len()];
            let line = line + before.bytes().filter(|b| *b == b'\n').count() as u32;
            let shown = begin.lines().next().unwrap_or("").trim_end().chars().take(30).collect();
            self.stray.push((line, shown));
        }
    }
}

/// To the `>` that is in no quotes.
fn tag_length(text: &str) -> usize {
    let mut quote = None;
    for (i, b) in text.bytes().enumerate() {
        match (quote, b) {
            (None, b'>') => return i + 1,
            (None, b'"' | b'\'') => quote = Some(b),
            (Some(q), b) if b == q => quote = None,
            _ => {}
        }
    }
    text.len()
}

/// A tag with attribute values as XML wants them.
fn push_tag(out: &mut String, tag: &str) {
    let mut rest = tag;
    while let Some(start) = rest.find(['"', '\'']) {
        let (before, quoted) = rest.split_at(start);
        let Some(length) = quoted[1..].find(&quoted[..1]) else { break };
        let (value, after) = quoted[1..].split_at(length);
        out.push_str(before);
        out.push_str(&quoted[..1]);
        push_value(out, value);
        out.push_str(&quoted[..1]);
        rest = &after[1..];
    }
    out.push_str(rest);
}

fn push_value(out: &mut String, value: &str) {
    // A value of several lines more likely lacks a quote, which the parser tells by its `<`.
    let one_line = !value.contains('\n');
    let mut rest = value;
    while let Some(i) = rest.find(['&', '<']) {
        out.push_str(&rest[..i]);
        rest = &rest[i..];
        match &rest[..1] {
            "&" if !is_reference(rest) => out.push_str("&amp;"),
            "<" if one_line => out.push_str("&lt;"),
            other => out.push_str(other),
        }
        rest = &rest[1..];
    }
    out.push_str(rest);
}

/// Whether the `&` that the text begins with stands for a character.
fn is_reference(text: &str) -> bool {
    let Some((name, _)) = text[1..].split_once(';') else { return false };
    let digits = |text: &str, radix| !text.is_empty() && text.chars().all(|c| c.is_digit(radix));
    match name.strip_prefix('#') {
        Some(code) => digits(code, 10) || code.strip_prefix('x').is_some_and(|hex| digits(hex, 16)),
        None => matches!(name, "amp" | "lt" | "gt" | "quot" | "apos"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The attributes `a` of all elements but the first, by line.
    fn values(text: &str) -> Vec<(u32, String)> {
        let tidy = tidy(text).unwrap();
        let document = roxmltree::Document::parse(&tidy.text).unwrap_or_else(|e| panic!("{text}: {e}"));
        let inner = document.root_element().descendants().skip(1).filter(|n| n.is_element());
        inner
            .map(|n| (document.text_pos_at(n.range().start).row, n.attribute("a").unwrap_or("").to_string()))
            .collect()
    }

    #[test]
    fn what_pugixml_forgives() {
        for (text, line, value) in [
            ("<s><!-- one -- two --->\n<t a='x'/></s>", 2, "x"),
            ("<s><!----- a --\n-- b ---><t a='x'/></s>", 2, "x"),
            ("<s><!--> still one --><t a='x'/></s>", 1, "x"),
            ("<!-- before -- --><?xml version='1.0'?>\n<s><t a='x'/></s>", 2, "x"),
            ("\u{feff}  \n<?xml version='1.0' encoding='latin1'?><s><t a='x'/></s>", 2, "x"),
            ("<!DOCTYPE scene SYSTEM 'a.dtd'><s><t a='x'/></s>", 1, "x"),
            ("words <s>more & words<t a='x'/></s> and more", 1, "x"),
            ("<s><![CDATA[ <t a='no'/> ]]>\n<t a='x'/></s>", 2, "x"),
            ("<s><t a='x & y.obj'/></s>", 1, "x & y.obj"),
            ("<s><t a='x&nbsp;&#65;&#x42;&#;&amp;&lt;'/></s>", 1, "x&nbsp;AB&#;&<"),
            ("<s><t a=\"it's <x> -->\"/></s>", 1, "it's <x> -->"),
            ("<s><t b='>' a='ü'/></s>", 1, "ü"),
        ] {
            assert_eq!(values(text), [(line, value.to_string())], "{text}");
        }
    }

    #[test]
    fn stray_text_is_told() {
        let stray = |text| tidy(text).unwrap().stray;
        assert_eq!(stray("<s>\n <t/> \n <!-- a --></s>\n"), []);
        assert_eq!(stray("<s>\n\n  notes of\nmine<t/></s>x"), [(3, "notes of".into()), (4, "x".into())]);
        assert_eq!(stray("<s><![CDATA[\n y ]]></s>"), [(2, "y".into())]);
    }

    #[test]
    fn what_is_broken_stays_broken() {
        for text in [
            "<s><!-- a",
            "<s><t a='x></s>",
            "<s><t a='x/>\n<t a='y'/></s>",
            "<s",
            "<s>",
            "<s></t>",
            "<s/><s/>",
            "<?xml",
            "<![CDATA[",
            "<!DOCTYPE s [<!ENTITY a 'b'>]><s/>",
            "words",
            "",
        ] {
            let tidy = tidy(text).unwrap();
            assert!(roxmltree::Document::parse(&tidy.text).is_err(), "{text}: {}", tidy.text);
        }
        assert_eq!(tidy(&format!("\n{}", "<s>\n".repeat(MAX_DEPTH + 1))), Err(MAX_DEPTH as u32 + 2));
        assert!(tidy(&"<s></s>".repeat(MAX_DEPTH + 1)).is_ok());
    }

    #[test]
    fn encodings() {
        let text = "<s a='für'/>";
        let utf16 = |of: fn(u16) -> [u8; 2]| {
            std::iter::once(0xFEFF).chain(text.encode_utf16()).flat_map(of).collect::<Vec<_>>()
        };
        assert_eq!(decode(text.into()), text);
        assert_eq!(decode(text.chars().map(|c| c as u8).collect()), text);
        assert_eq!(decode(utf16(u16::to_le_bytes)), text);
        assert_eq!(decode(utf16(u16::to_be_bytes)), text);
        assert_eq!(decode(vec![0xFF, 0xFE, 0x41]), "");
    }
}
