//! From XML text to a flat tree of plugin objects with typed properties: `$name` substitution, `<default>`,
//! `<include>`, `<path>`, `<alias>`, ids, transforms. Knows the format's grammar, but no plugin.

use super::markup::{self, MAX_DEPTH};
use super::upgrade;
use crate::scene::place::look_at;
use crate::scene::spectrum::Spectrum;
use crate::{Error, Result};
use glam::{DMat4, DVec3};
use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Deepest nesting of includes: scenes need less than ten.
const MAX_INCLUDES: usize = 15;
/// Bounds the work of includes that include each other twice and the like.
const MAX_FILES: usize = 10_000;

/// Where something stands: index of a file, and line from 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pos {
    pub file: u32,
    pub line: u32,
}

/// A property's value.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Float(f64),
    Integer(i64),
    Boolean(bool),
    String(String),
    Rgb(DVec3),
    Spectrum(Spectrum),
    Vector(DVec3),
    Transform(DMat4),
    /// Index of an object.
    Object(usize),
    /// Id of an object, found when everything is read: references may point forward.
    Reference(String),
}

impl Value {
    /// Its type's name, for messages.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Value::Float(_) => "float",
            Value::Integer(_) => "integer",
            Value::Boolean(_) => "boolean",
            Value::String(_) => "string",
            Value::Rgb(_) => "rgb",
            Value::Spectrum(_) => "spectrum",
            Value::Vector(_) => "vector",
            Value::Transform(_) => "transform",
            Value::Object(_) | Value::Reference(_) => "object",
        }
    }
}

/// A named value inside an object.
#[derive(Clone, Debug)]
pub(super) struct Property {
    /// Empty for children without a name.
    pub name: String,
    pub value: Value,
    pub pos: Pos,
    /// Whether a plugin asked for it; see [`super::props::Props::finish`].
    pub used: Cell<bool>,
}

/// A plugin object: `<bsdf type="diffuse" id="white">`.
#[derive(Clone, Debug)]
pub(super) struct Object {
    /// The element's name: `bsdf`, `shape`, … (`spectrum` objects count as textures).
    pub tag: String,
    /// The `type` attribute.
    pub plugin: String,
    pub pos: Pos,
    pub properties: Vec<Property>,
    /// From a file of Mitsuba 0.4 to 0.6: names are today's, defaults are not.
    pub old: bool,
    /// Names that a plugin asked for.
    pub asked: RefCell<Vec<&'static str>>,
}

impl Object {
    /// The name of the mesh attribute that it looks up, if it is a texture that does.
    pub(super) fn mesh_attribute(&self) -> Option<&str> {
        match self.plugin.as_str() {
            "mesh_attribute" => self.properties.iter().find_map(|p| match &p.value {
                Value::String(name) if p.name == "name" => Some(name.as_str()),
                _ => None,
            }),
            "vertexcolors" => Some("vertex_color"),
            _ => None,
        }
    }
}

/// A mesh attribute that a texture looks up.
#[derive(Clone, Debug)]
pub(super) struct Asked {
    pub name: String,
    /// The texture.
    pub object: usize,
}

/// Everything that the files say. Object 0 is the scene.
#[derive(Debug)]
pub(super) struct Tree {
    pub files: Vec<PathBuf>,
    pub objects: Vec<Object>,
    pub ids: HashMap<String, usize>,
    /// Folders named by `<path>`, the latest first.
    pub search: Vec<PathBuf>,
    warnings: RefCell<Vec<String>>,
    /// What is told once.
    told: RefCell<HashSet<String>>,
    unknown: RefCell<Vec<Unknown>>,
    /// Files and folders that were looked for in vain, and where they are named first.
    missing: RefCell<Vec<(Pos, String)>>,
    parameters: Vec<Parameter>,
}

/// Parameters that a plugin does not know.
#[derive(Debug)]
struct Unknown {
    title: String,
    /// Where the first of them stands.
    pos: Pos,
    parameters: Vec<String>,
    /// What it knows.
    known: Vec<&'static str>,
}

#[derive(Clone, Debug)]
struct Parameter {
    name: String,
    value: String,
    /// Given on the command line, and not named by the scene so far.
    unused_define: bool,
}

const OBJECT_TAGS: [&str; 15] = [
    "scene",
    "bsdf",
    "shape",
    "emitter",
    "sensor",
    "film",
    "rfilter",
    "sampler",
    "integrator",
    "texture",
    "medium",
    "subsurface",
    "phase",
    "volume",
    "spectrum",
];

impl Tree {
    /// Reads a file and everything it includes.
    pub(super) fn read(path: &Path, defines: &[(String, String)]) -> Result<Tree> {
        let parameters = defines.iter().map(|(name, value)| Parameter {
            name: name.clone(),
            value: value.clone(),
            unused_define: true,
        });
        let mut tree = Tree {
            files: Vec::new(),
            objects: Vec::new(),
            ids: HashMap::new(),
            search: Vec::new(),
            warnings: RefCell::default(),
            told: RefCell::default(),
            unknown: RefCell::default(),
            missing: RefCell::default(),
            parameters: parameters.collect(),
        };
        tree.sort_parameters();
        if let Err(error) = tree.read_file(path, None, 0) {
            return tree.unless_files_are_missing(Err(error));
        }
        let unused = tree.parameters.iter().filter(|p| p.unused_define);
        let unused = unused.map(|p| format!("-D {}={}: the scene has no such parameter", p.name, p.value));
        tree.warnings.borrow_mut().extend(unused);
        Ok(tree)
    }

    /// An error at `pos`.
    pub(super) fn error(&self, pos: Pos, message: impl Into<String>) -> Error {
        Error::Scene { file: self.file(pos).into(), line: pos.line, message: message.into() }
    }

    /// The file of `pos`.
    pub(super) fn file(&self, pos: Pos) -> &Path {
        self.files.get(pos.file as usize).map_or(Path::new(""), |p| p)
    }

    /// `FILE:LINE: message`, for warnings.
    fn at(&self, pos: Pos, message: &str) -> String {
        format!("{}:{}: {message}", self.file(pos).display(), pos.line)
    }

    /// Warns of something at `pos`.
    pub(super) fn warn(&self, pos: Pos, message: &str) {
        self.warnings.borrow_mut().push(self.at(pos, message));
    }

    /// Warns at the first place of all that have the same message.
    pub(super) fn warn_once(&self, pos: Pos, message: &str) {
        if self.told.borrow_mut().insert(message.into()) {
            self.warn(pos, message);
        }
    }

    /// Warns, once for each plugin and parameter, that the parameter has no effect.
    pub(super) fn warn_ignored(&self, title: &str, property: &Property) {
        self.warn_once(property.pos, &format!("{title}: {} has no effect", self.name_of(property)));
    }

    /// What to call a parameter, or a child without a name, in messages.
    pub(super) fn name_of(&self, property: &Property) -> String {
        match &property.value {
            Value::Object(index) if property.name.is_empty() => format!("<{}>", self.objects[*index].tag),
            Value::Reference(id) if property.name.is_empty() => format!("<ref id=\"{id}\">"),
            _ => format!("'{}'", property.name),
        }
    }

    /// The object that a value is or refers to, if there is one.
    pub(super) fn object_of(&self, value: &Value) -> Option<usize> {
        match value {
            Value::Object(index) => Some(*index),
            Value::Reference(id) => self.ids.get(id).copied(),
            _ => None,
        }
    }

    /// Notes a parameter that the plugin of this title does not know, for the list at the end of all warnings.
    pub(super) fn note_unknown(&self, title: &str, property: &Property, known: &[&'static str]) {
        let what = self.name_of(property);
        if !self.told.borrow_mut().insert(format!("{title} does not know {what}")) {
            return;
        }
        let mut list = self.unknown.borrow_mut();
        let index = list.iter().position(|unknown| unknown.title == title).unwrap_or(list.len());
        if index == list.len() {
            let (title, pos) = (title.into(), property.pos);
            list.push(Unknown { title, pos, parameters: Vec::new(), known: Vec::new() });
        }
        let unknown = &mut list[index];
        unknown.known.extend(known);
        let at = match property.pos.file == unknown.pos.file {
            true => format!("line {}", property.pos.line),
            false => format!("{}:{}", self.file(property.pos).display(), property.pos.line),
        };
        let meant =
            nearest(&property.name, known).map_or_else(String::new, |n| format!(", did you mean '{n}'?"));
        unknown.parameters.push(format!("{what} ({at}{meant})"));
    }

    /// The list of what was noted: a warning for each plugin.
    fn unknown_parameters(&self) -> impl Iterator<Item = String> + use<'_> {
        self.unknown.take().into_iter().map(|Unknown { title, pos, parameters, mut known }| {
            known.sort_unstable();
            known.dedup();
            let (parameters, known) = (parameters.join(", "), known.join(", "));
            let message =
                format!("{title} does not know, so these have no effect: {parameters}; it knows {known}");
            self.at(pos, &message)
        })
    }

    /// The mesh attributes that an object looks up, by whatever it holds or refers to.
    pub(super) fn mesh_attributes(&self, object: usize) -> Vec<Asked> {
        let (mut found, mut seen, mut waiting) = (Vec::new(), HashSet::new(), vec![object]);
        while let Some(index) = waiting.pop() {
            let object = &self.objects[index];
            if !seen.insert(index) {
                continue;
            }
            found.extend(object.mesh_attribute().map(|name| Asked { name: name.into(), object: index }));
            waiting.extend(object.properties.iter().filter_map(|p| self.object_of(&p.value)));
        }
        found
    }

    /// All warnings so far, the list of unknown parameters last.
    pub(super) fn take_warnings(&self) -> Vec<String> {
        self.warnings.take().into_iter().chain(self.unknown_parameters()).collect()
    }

    /// Finds a file that a scene names: beside the file that names it, in the folders of `<path>`, beside the
    /// outermost scene file. If it is missing, [`Tree::unless_files_are_missing`] tells in the end.
    pub(super) fn resolve(&self, name: &str, pos: Pos) -> Option<PathBuf> {
        let parent = |file: &Path| file.parent().map(Path::to_path_buf).unwrap_or_default();
        let folders = std::iter::once(parent(self.file(pos)))
            .chain(self.search.iter().cloned())
            .chain(self.files.first().map(|f| parent(f)));
        let found = folders.map(|folder| folder.join(name)).find(|candidate| candidate.is_file());
        if found.is_none() {
            self.miss(pos, format!("file '{name}'"));
        }
        found
    }

    fn miss(&self, pos: Pos, what: String) {
        if self.told.borrow_mut().insert(format!("{what} not found")) {
            self.missing.borrow_mut().push((pos, what));
        }
    }

    /// What came of reading the scene, or of walking through it.
    ///
    /// # Errors
    /// If files are missing: one that names them all. Whatever else is wrong may be so because of that.
    pub(super) fn unless_files_are_missing<T>(&self, made: Result<T>) -> Result<T> {
        const SEARCHED: &str = "(searched beside the scene and in its <path>s)";
        if made.is_err() && !self.missing.borrow().is_empty() {
            self.look_for_files();
        }
        let mut missing = self.missing.take();
        missing.sort_by_key(|(pos, _)| (pos.file, pos.line));
        match &missing[..] {
            [] => made,
            [(pos, what)] => Err(self.error(*pos, format!("{what} not found {SEARCHED}"))),
            [(first, _), ..] => {
                let mut message = format!("{} files not found {SEARCHED}: ", missing.len());
                let list: Vec<_> = missing.iter().map(|(pos, what)| self.at(*pos, what)).collect();
                message += &list.join("; ");
                Err(self.error(*first, message))
            }
        }
    }

    /// Looks for the files that nothing came to.
    fn look_for_files(&self) {
        let reads =
            |object: &&Object| matches!(object.tag.as_str(), "shape" | "bsdf" | "texture" | "emitter");
        for property in self.objects.iter().filter(reads).flat_map(|object| &object.properties) {
            if let (Value::String(name), "filename") = (&property.value, property.name.as_str()) {
                self.resolve(name, property.pos);
            }
        }
    }

    /// Longest name first, so that `$name` does not eat the start of `$name2`.
    fn sort_parameters(&mut self) {
        self.parameters.sort_by(|a, b| b.name.len().cmp(&a.name.len()).then(a.name.cmp(&b.name)));
    }

    fn read_file(&mut self, path: &Path, parent: Option<usize>, depth: usize) -> Result<()> {
        let unreadable =
            |e| Error::File { file: path.into(), message: format!("cannot read the scene: {e}") };
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let file = self.files.len() as u32;
        self.files.push(path.into());
        let tidy = markup::tidy(&markup::decode(bytes)).map_err(|line| {
            self.error(Pos { file, line }, format!("elements are nested more than {MAX_DEPTH} deep"))
        })?;
        if let [(line, first), more @ ..] = &tidy.stray[..] {
            let more = if more.is_empty() { String::new() } else { format!(", and {} more", more.len()) };
            let message = format!("text between elements has no effect: '{first}'{more}");
            self.warn(Pos { file, line: *line }, &message);
        }
        let document = roxmltree::Document::parse(&tidy.text)
            .map_err(|e| self.error(Pos { file, line: e.pos().row }, format!("not valid XML: {e}")))?;
        let root = document.root_element();
        Reader { tree: self, lines: line_starts(&tidy.text), file, old: false }.root(root, parent, depth)
    }
}

fn line_starts(text: &str) -> Vec<usize> {
    std::iter::once(0)
        .chain(text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1))
        .collect()
}

type Node<'a, 'b> = roxmltree::Node<'a, 'b>;

/// Reads one file into the tree.
struct Reader<'t> {
    tree: &'t mut Tree,
    lines: Vec<usize>,
    file: u32,
    /// Whether the file is one of Mitsuba 0.4 to 0.6.
    old: bool,
}

/// An element with its parameters substituted.
struct Element {
    tag: String,
    attributes: Vec<(String, String)>,
    pos: Pos,
}

impl Element {
    fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_str())
    }
}

impl Reader<'_> {
    fn pos(&self, node: Node) -> Pos {
        let line = self.lines.partition_point(|&start| start <= node.range().start) as u32;
        Pos { file: self.file, line }
    }

    fn root(&mut self, node: Node, parent: Option<usize>, depth: usize) -> Result<()> {
        let element = self.element(node)?;
        let version = element.get("version").ok_or_else(|| {
            self.tree.error(
                element.pos,
                format!("<{}> has no version attribute: not a Mitsuba scene", element.tag),
            )
        })?;
        let mut numbers = version.split('.').map(|n| n.trim().parse::<u32>().ok());
        self.old = match (numbers.next().flatten(), numbers.next()) {
            (Some(2..), _) => false,
            (Some(0), Some(Some(4..))) => true,
            (Some(_), _) => {
                let message = format!(
                    "scenes of version {version} are not supported: use Mitsuba 0.4 to 0.6, or 2 and later"
                );
                return Err(self.tree.error(element.pos, message));
            }
            _ => {
                return Err(self.tree.error(element.pos, format!("'{version}' is not a version number")));
            }
        };
        if element.tag == "scene" {
            // An included scene's children become the including scene's own.
            let scene = match parent {
                Some(parent) => parent,
                None => self.add_object(&element, "scene".into())?,
            };
            self.children(node, scene, depth)
        } else if let Some(parent) = parent {
            self.object(node, element, parent, depth)
        } else {
            Err(self.tree.error(element.pos, format!("the root element is <{}>, not <scene>", element.tag)))
        }
    }

    fn element(&mut self, node: Node) -> Result<Element> {
        let pos = self.pos(node);
        let mut tag = node.tag_name().name();
        if self.old {
            tag = upgrade::element(tag);
        }
        let mut attributes = Vec::new();
        for attribute in node.attributes() {
            let mut value = self.substitute(attribute.value(), pos)?;
            match attribute.name() {
                // What a colour is meant for is known from where it stands.
                "intent" if self.old => continue,
                "name" if self.old && tag != "default" => value = upgrade::name(&value),
                "name" if tag != "default" => value = self.snake_case(value, pos),
                "type" if self.old => value = upgrade::plugin(tag, &value).into(),
                _ => {}
            }
            attributes.push((attribute.name().to_string(), value));
        }
        Ok(Element { tag: tag.to_string(), attributes, pos })
    }

    /// Mitsuba 3 has no names like `toWorld`, but scenes of other versions and renderers have.
    fn snake_case(&self, name: String, pos: Pos) -> String {
        let today = upgrade::snake_case(&name);
        if today != name {
            self.tree.warn_once(
                pos,
                &format!("'{name}' is read as '{today}', as it is called in scenes of version 3"),
            );
        }
        today
    }

    /// Replaces `$name`; `\$` is a dollar sign. Each value is inserted once, so substitution cannot grow without end.
    fn substitute(&mut self, text: &str, pos: Pos) -> Result<String> {
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(i) = rest.find('$') {
            let (before, after) = (&rest[..i], &rest[i + 1..]);
            if let Some(before) = before.strip_suffix('\\') {
                out.push_str(before);
                out.push('$');
                rest = after;
                continue;
            }
            out.push_str(before);
            let Some(parameter) = self.tree.parameters.iter_mut().find(|p| after.starts_with(&p.name)) else {
                let name: String = after.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let message = format!("undefined parameter ${name}: give it with -D {name}=… or <default>");
                return Err(self.tree.error(pos, message));
            };
            parameter.unused_define = false;
            out.push_str(&parameter.value);
            rest = &after[parameter.name.len()..];
        }
        out.push_str(rest);
        Ok(out)
    }

    /// Refuses attributes beyond `allowed`; a leading `!` marks those that must be there.
    fn check(&self, element: &Element, allowed: &[&str]) -> Result<()> {
        let tag = &element.tag;
        for (name, _) in &element.attributes {
            if !allowed.iter().any(|a| a.trim_start_matches('!') == name) {
                return Err(self
                    .tree
                    .error(element.pos, format!("<{tag}> has an unknown attribute '{name}'")));
            }
        }
        for name in allowed.iter().filter_map(|a| a.strip_prefix('!')) {
            if element.get(name).is_none() {
                return Err(self.tree.error(element.pos, format!("<{tag}> lacks the attribute '{name}'")));
            }
        }
        Ok(())
    }

    fn add_object(&mut self, element: &Element, plugin: String) -> Result<usize> {
        let index = self.tree.objects.len();
        if let Some(id) = element.get("id").filter(|id| !id.is_empty()) {
            self.name_object(id, index, element.pos)?;
        }
        let tag = if element.tag == "spectrum" { "texture".into() } else { element.tag.clone() };
        let old = self.old;
        self.tree.objects.push(Object {
            tag,
            plugin,
            pos: element.pos,
            properties: Vec::new(),
            old,
            asked: RefCell::default(),
        });
        Ok(index)
    }

    fn name_object(&mut self, id: &str, index: usize, pos: Pos) -> Result<()> {
        if let Some(other) = self.tree.ids.get(id).and_then(|&i| self.tree.objects.get(i)) {
            let first = self.tree.at(other.pos, "");
            let message = format!("id '{id}' is used twice, first at {}", first.trim_end_matches(": "));
            return Err(self.tree.error(pos, message));
        }
        self.tree.ids.insert(id.to_string(), index);
        Ok(())
    }

    fn set(&mut self, parent: usize, name: &str, value: Value, pos: Pos) -> Result<()> {
        let object = &mut self.tree.objects[parent];
        let name = upgrade::parameter(&object.tag, &object.plugin, name);
        if let Some(first) = object.properties.iter().position(|p| !name.is_empty() && p.name == name) {
            let message = format!("parameter '{name}' is given twice");
            if !self.old {
                return Err(self.tree.error(pos, message));
            }
            // As in Mitsuba 0.6.
            object.properties.remove(first);
            self.tree.warn(pos, &format!("{message}: the last one counts"));
        }
        let object = &mut self.tree.objects[parent];
        object.properties.push(Property { name: name.into(), value, pos, used: Cell::new(false) });
        Ok(())
    }

    fn children(&mut self, node: Node, parent: usize, depth: usize) -> Result<()> {
        node.children().filter(|c| c.is_element()).try_for_each(|child| self.child(child, parent, depth))
    }

    fn object(&mut self, node: Node, element: Element, parent: usize, depth: usize) -> Result<()> {
        let is_root = element.get("version").is_some() && node.parent().is_some_and(|p| p.is_root());
        let allowed: &[&str] =
            if is_root { &["version", "!type", "id", "name"] } else { &["!type", "id", "name"] };
        self.check(&element, allowed)?;
        let given = element.get("type").unwrap_or("");
        let (plugin, distribution) = match upgrade::split_distribution(&element.tag, given) {
            Some((plugin, distribution)) => (plugin, Some(distribution)),
            None => (given, None),
        };
        let index = self.add_object(&element, plugin.to_string())?;
        let name = element.get("name").unwrap_or("");
        self.set(parent, name, Value::Object(index), element.pos)?;
        self.children(node, index, depth)?;
        let has_own = self.tree.objects[index].properties.iter().any(|p| p.name == "distribution");
        match distribution {
            Some(distribution) if !has_own => {
                let message =
                    format!("bsdf plugin '{given}' is read as '{plugin}' of distribution '{distribution}'");
                self.tree.warn_once(element.pos, &message);
                self.set(index, "distribution", Value::String(distribution.into()), element.pos)
            }
            _ => Ok(()),
        }
    }

    fn child(&mut self, node: Node, parent: usize, depth: usize) -> Result<()> {
        let element = self.element(node)?;
        let pos = element.pos;
        let error = |tree: &Tree, message: String| Err(tree.error(pos, message));
        let tag = element.tag.as_str();
        if tag == "scene" {
            return error(self.tree, "<scene> inside another element".into());
        }
        if OBJECT_TAGS.contains(&tag) && (tag != "spectrum" || element.get("type").is_some()) {
            return self.object(node, element, parent, depth);
        }
        if self.old && tag == "null" {
            return Ok(());
        }
        if !matches!(tag, "transform" | "animation") {
            if let Some(inner) = node.children().find(|c| c.is_element()) {
                let message = format!("<{}> cannot stand inside <{tag}>", inner.tag_name().name());
                return Err(self.tree.error(self.pos(inner), message));
            }
        }
        let name = element.get("name").unwrap_or("").to_string();
        let text = element.get("value").unwrap_or("");
        let value = match tag {
            "float" | "integer" | "boolean" | "string" => {
                self.check(&element, &["!name", "!value"])?;
                match (tag, text.trim()) {
                    ("float", t) => Value::Float(self.number(t, pos)?),
                    ("integer", t) => match t.parse() {
                        Ok(n) => Value::Integer(n),
                        Err(_) => return error(self.tree, format!("'{text}' is not an integer")),
                    },
                    ("boolean", t) if t.eq_ignore_ascii_case("true") => Value::Boolean(true),
                    ("boolean", t) if t.eq_ignore_ascii_case("false") => Value::Boolean(false),
                    ("boolean", _) => return error(self.tree, format!("'{text}' is neither true nor false")),
                    _ => Value::String(text.to_string()),
                }
            }
            "point" | "vector" => {
                self.check(&element, &["!name", "value", "x", "y", "z"])?;
                if element.get("value").is_none() && ["x", "y", "z"].iter().any(|a| element.get(a).is_none())
                {
                    return error(self.tree, format!("<{tag}> needs a value, or x, y and z"));
                }
                Value::Vector(self.vector(&element, 0.0)?)
            }
            "rgb" => {
                self.check(&element, &["!name", "!value"])?;
                Value::Rgb(self.rgb(text, pos)?)
            }
            "srgb" if self.old => {
                self.check(&element, &["!name", "!value"])?;
                // `#rrggbb` is encoded anyway.
                let encoded = self.rgb(text, pos)?;
                let linear = |v: f64| crate::image_io::srgb_to_linear(v as f32) as f64;
                Value::Rgb(if text.trim().starts_with('#') { encoded } else { encoded.map(linear) })
            }
            "spectrum" => {
                self.check(&element, &["!name", "value", "filename"])?;
                let spectrum = match (element.get("value"), element.get("filename")) {
                    // In RGB, Mitsuba 0.6 took one number for grey or white, and three for a colour.
                    (Some(text), None) if self.old && !text.contains(':') => {
                        return self.set(parent, &name, Value::Rgb(self.rgb(text, pos)?), pos);
                    }
                    (Some(text), None) => Spectrum::parse(text),
                    (None, Some(file)) => {
                        let Some(path) = self.tree.resolve(file, pos) else { return Ok(()) };
                        let text = std::fs::read_to_string(&path).map_err(|e| Error::File {
                            file: path.clone(),
                            message: format!("cannot read the spectrum: {e}"),
                        })?;
                        return match Spectrum::parse_file(&text) {
                            Ok(spectrum) => self.set(parent, &name, Value::Spectrum(spectrum), pos),
                            Err((line, message)) => Err(Error::Scene { file: path, line, message }),
                        };
                    }
                    _ => Err("<spectrum> needs either a value or a filename".into()),
                };
                Value::Spectrum(spectrum.map_err(|message| self.tree.error(pos, message))?)
            }
            "blackbody" => {
                self.check(&element, &["!name", "!temperature", "scale"])?;
                let kelvin = element.get("temperature").unwrap_or("");
                let kelvin = self.number(kelvin.trim().trim_end_matches(['K', 'k']), pos)?;
                let scale = element.get("scale").map_or(Ok(1.0), |s| self.number(s, pos))?;
                let spectrum = Spectrum::blackbody(kelvin, scale);
                Value::Spectrum(spectrum.map_err(|message| self.tree.error(pos, message))?)
            }
            "transform" => {
                self.check(&element, &["!name"])?;
                let mut transform = DMat4::IDENTITY;
                for step in node.children().filter(|c| c.is_element()) {
                    transform = self.transform(step)? * transform;
                }
                Value::Transform(transform)
            }
            "animation" if self.old => {
                self.check(&element, &["!name"])?;
                self.tree.warn(pos, "nothing moves: of an animation only the first transform counts");
                let Some(first) = node.children().find(|c| c.has_tag_name("transform")) else {
                    return error(self.tree, "an <animation> needs a <transform>".into());
                };
                let mut transform = DMat4::IDENTITY;
                for step in first.children().filter(|c| c.is_element()) {
                    transform = self.transform(step)? * transform;
                }
                Value::Transform(transform)
            }
            "ref" => {
                self.check(&element, &["!id", "name"])?;
                Value::Reference(element.get("id").unwrap_or("").to_string())
            }
            "default" => {
                self.check(&element, &["!name", "!value"])?;
                if name.is_empty() {
                    return error(self.tree, "<default> needs a name".into());
                }
                match self.tree.parameters.iter_mut().find(|p| p.name == name) {
                    Some(parameter) => parameter.unused_define = false,
                    None => {
                        let value = text.to_string();
                        self.tree.parameters.push(Parameter { name, value, unused_define: false });
                        self.tree.sort_parameters();
                    }
                }
                return Ok(());
            }
            "include" => {
                self.check(&element, &["!filename", "name"])?;
                let Some(path) = self.tree.resolve(element.get("filename").unwrap_or(""), pos) else {
                    return Ok(());
                };
                if depth >= MAX_INCLUDES || self.tree.files.len() >= MAX_FILES {
                    return error(self.tree, format!("includes are nested more than {MAX_INCLUDES} deep"));
                }
                return self.tree.read_file(&path, Some(parent), depth + 1);
            }
            "alias" => {
                self.check(&element, &["!id", "!as"])?;
                let (id, alias) = (element.get("id").unwrap_or(""), element.get("as").unwrap_or(""));
                return match self.tree.ids.get(id).copied() {
                    Some(index) => self.name_object(alias, index, pos),
                    None => error(self.tree, format!("<alias>: nothing above has the id '{id}'")),
                };
            }
            "path" => {
                self.check(&element, &["!value"])?;
                if parent != 0 {
                    return error(self.tree, "<path> must stand directly inside <scene>".into());
                }
                let beside = self.tree.file(pos).parent().unwrap_or(Path::new("")).join(text);
                let elsewhere = self.tree.search.iter().map(|s| s.join(text));
                match std::iter::once(beside).chain(elsewhere).find(|p| p.is_dir()) {
                    Some(folder) => self.tree.search.insert(0, folder),
                    None => self.tree.miss(pos, format!("folder '{text}'")),
                }
                return Ok(());
            }
            "translate" | "rotate" | "scale" | "lookat" | "matrix" => {
                return error(self.tree, format!("<{tag}> belongs inside a <transform>"));
            }
            _ => return error(self.tree, format!("unknown element <{tag}>")),
        };
        self.set(parent, &name, value, pos)
    }

    fn number(&self, text: &str, pos: Pos) -> Result<f64> {
        let number = text.trim().parse::<f64>().ok().filter(|n| n.is_finite());
        number.ok_or_else(|| self.tree.error(pos, format!("'{text}' is not a number")))
    }

    fn numbers(&self, text: &str, pos: Pos) -> Result<Vec<f64>> {
        tokens(text).map(|t| self.number(t, pos)).collect()
    }

    fn triple(&self, text: &str, pos: Pos) -> Result<DVec3> {
        match self.numbers(text, pos)?[..] {
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            _ => Err(self.tree.error(pos, format!("'{text}' should be three numbers"))),
        }
    }

    /// Three or one numbers in `value`, or x, y, z of which any may be missing.
    fn vector(&self, element: &Element, default: f64) -> Result<DVec3> {
        let pos = element.pos;
        if let Some(text) = element.get("value") {
            if ["x", "y", "z"].iter().any(|a| element.get(a).is_some()) {
                return Err(self.tree.error(pos, "give either value or x, y, z, not both"));
            }
            return match self.numbers(text, pos)?[..] {
                [x] => Ok(DVec3::splat(x)),
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                _ => Err(self.tree.error(pos, format!("'{text}' should be one or three numbers"))),
            };
        }
        let axis = |name| element.get(name).map_or(Ok(default), |text| self.number(text, pos));
        Ok(DVec3::new(axis("x")?, axis("y")?, axis("z")?))
    }

    /// One or three numbers, or `#rrggbb` in sRGB encoding.
    fn rgb(&self, text: &str, pos: Pos) -> Result<DVec3> {
        if let Some(hex) = text.trim().strip_prefix('#') {
            let value = u32::from_str_radix(hex, 16).ok().filter(|_| hex.len() == 6 && hex.is_ascii());
            let value = value
                .ok_or_else(|| self.tree.error(pos, format!("'{text}' is not a colour like #ff8000")))?;
            let channel =
                |shift: u32| crate::image_io::srgb_to_linear(((value >> shift) & 255) as f32 / 255.0) as f64;
            return Ok(DVec3::new(channel(16), channel(8), channel(0)));
        }
        match self.numbers(text, pos)?[..] {
            [v] => Ok(DVec3::splat(v)),
            [r, g, b] => Ok(DVec3::new(r, g, b)),
            _ => Err(self.tree.error(pos, format!("'{text}' should be one or three numbers"))),
        }
    }

    fn transform(&mut self, node: Node) -> Result<DMat4> {
        let element = self.element(node)?;
        let pos = element.pos;
        let error = |tree: &Tree, message: &str| Err(tree.error(pos, message));
        let matrix = match element.tag.as_str() {
            "translate" => {
                self.check(&element, &["value", "x", "y", "z"])?;
                DMat4::from_translation(self.vector(&element, 0.0)?)
            }
            "scale" => {
                self.check(&element, &["value", "x", "y", "z"])?;
                DMat4::from_scale(self.vector(&element, 1.0)?)
            }
            "rotate" => {
                self.check(&element, &["!angle", "value", "x", "y", "z"])?;
                let angle = self.number(element.get("angle").unwrap_or(""), pos)?;
                match self.vector(&element, 0.0)?.try_normalize() {
                    Some(axis) => DMat4::from_axis_angle(axis, angle.to_radians()),
                    None => return error(self.tree, "the rotation axis is zero"),
                }
            }
            "lookat" => {
                self.check(&element, &["!origin", "!target", "up"])?;
                let origin = self.triple(element.get("origin").unwrap_or(""), pos)?;
                let target = self.triple(element.get("target").unwrap_or(""), pos)?;
                let up = match element.get("up") {
                    Some(text) => self.triple(text, pos)?,
                    None => DVec3::ZERO,
                };
                match look_at(origin, target, up) {
                    Some(matrix) => matrix,
                    None => {
                        return error(self.tree, "lookat: origin equals target, or up points along the view");
                    }
                }
            }
            "matrix" => {
                self.check(&element, &["!value"])?;
                match self.numbers(element.get("value").unwrap_or(""), pos)?[..] {
                    [a, b, c, d, e, f, g, h, i] => {
                        DMat4::from_mat3(glam::DMat3::from_cols_array(&[a, d, g, b, e, h, c, f, i]))
                    }
                    ref rows if rows.len() == 16 => DMat4::from_cols_slice(rows).transpose(),
                    _ => return error(self.tree, "a matrix needs 9 or 16 numbers"),
                }
            }
            other => {
                let message = format!("<{other}> cannot stand inside <transform>");
                return error(self.tree, &message);
            }
        };
        Ok(matrix)
    }
}

/// The word that is spelt nearly like `name`, if there is one.
fn nearest<'w>(name: &str, words: &[&'w str]) -> Option<&'w str> {
    // Comparing takes time in proportion to the length.
    let name = Some(name).filter(|name| name.len() < 100)?;
    let distances = words.iter().map(|word| (strsim::damerau_levenshtein(word, name), *word));
    distances.min().filter(|(distance, _)| *distance <= 1 + name.len() / 5).map(|(_, word)| word)
}

/// Splits at commas and white space.
pub(super) fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty())
}
