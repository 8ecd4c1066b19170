//! Typed access to an object's properties, with an account of which were used.

use super::refused;
use super::xml::{Object, Pos, Property, Tree, Value};
use crate::Result;
use glam::{Affine3A, DAffine3, DMat4, DVec3, Mat4, Vec3};

/// The properties of one object. Plugins ask for what they know, then call [`Props::finish`].
#[derive(Clone, Copy)]
pub(super) struct Props<'a> {
    pub tree: &'a Tree,
    pub object: &'a Object,
    pub index: usize,
}

impl<'a> Props<'a> {
    pub(super) fn new(tree: &'a Tree, index: usize) -> Props<'a> {
        let props = Props { tree, object: &tree.objects[index], index };
        for property in &props.object.properties {
            property.used.set(false);
        }
        props.object.asked.borrow_mut().clear();
        props
    }

    /// The plugin's name.
    pub(super) fn plugin(&self) -> &'a str {
        &self.object.plugin
    }

    /// What to call the object in messages.
    pub(super) fn title(&self) -> String {
        if self.object.tag == "scene" {
            return "the scene".into();
        }
        format!("{} plugin '{}'", self.object.tag, self.object.plugin)
    }

    pub(super) fn error(&self, message: impl Into<String>) -> crate::Error {
        self.tree.error(self.object.pos, message)
    }

    /// For a plugin that is not among `known`: one that only Mitsuba has, or a typing error.
    pub(super) fn unknown_plugin(&self, known: &str) -> crate::Error {
        self.refusal().unwrap_or_else(|| self.error(format!("unknown {}; known are {known}", self.title())))
    }

    /// Why the plugin is refused, if it is one that Mitsuba has.
    fn refusal(&self) -> Option<crate::Error> {
        let reason = refused::reason(&self.object.tag, self.plugin())?;
        Some(self.error(format!("{} is not supported: {reason}", self.title())))
    }

    /// What to do in the place of a plugin that is not supported or not known, for a warning.
    pub(super) fn instead(&self, remedy: &str, known: &[&str]) -> String {
        match refused::reason(&self.object.tag, self.plugin()) {
            Some(reason) => format!("{} is not supported: {reason}: {remedy}", self.title()),
            None => format!("unknown {}: {remedy}; known are {}", self.title(), known.join(", ")),
        }
    }

    /// For an object that cannot stand inside of a `container`, where something at `pos` puts it.
    pub(super) fn misplaced(&self, container: &str, pos: Pos) -> crate::Error {
        self.refusal().unwrap_or_else(|| {
            let message = format!("a <{}> inside a {container} is not supported", self.object.tag);
            self.tree.error(pos, message)
        })
    }

    /// Refuses what a shape may say to be inside or outside of it.
    pub(super) fn refuse_media(&self) -> Result<()> {
        for name in ["interior", "exterior"] {
            let Some(property) = self.object.properties.iter().find(|p| p.name == name) else { continue };
            let medium = self.object_of(property)?.map(|index| &self.tree.objects[index]);
            let which = medium.map_or(String::new(), |m| format!(" ({} plugin '{}')", m.tag, m.plugin));
            let message = format!(
                "participating media are not supported{which}: light goes straight from surface to surface, \
                 leave the '{name}' out"
            );
            return Err(self.tree.error(property.pos, message));
        }
        Ok(())
    }

    /// A property by name, marked as used.
    pub(super) fn get(&self, name: &'static str) -> Option<&'a Property> {
        self.object.asked.borrow_mut().push(name);
        let property = self.object.properties.iter().find(|p| p.name == name)?;
        property.used.set(true);
        Some(property)
    }

    pub(super) fn has(&self, name: &'static str) -> bool {
        self.object.asked.borrow_mut().push(name);
        self.object.properties.iter().any(|p| p.name == name)
    }

    /// Where a property stands, or else its object.
    pub(super) fn pos(&self, name: &'static str) -> Pos {
        self.object.properties.iter().find(|p| p.name == name).map_or(self.object.pos, |p| p.pos)
    }

    /// An error at a property.
    pub(super) fn error_at(&self, name: &'static str, message: impl Into<String>) -> crate::Error {
        self.tree.error(self.pos(name), message)
    }

    fn wrong_type(&self, p: &Property, wanted: &str) -> crate::Error {
        let message = format!(
            "{}: parameter '{}' should be of type {wanted}, not {}",
            self.title(),
            p.name,
            p.value.kind()
        );
        self.tree.error(p.pos, message)
    }

    pub(super) fn opt_float(&self, name: &'static str) -> Result<Option<f32>> {
        match self.get(name) {
            None => Ok(None),
            Some(Property { value: Value::Float(v), .. }) => Ok(Some(*v as f32)),
            Some(Property { value: Value::Integer(v), .. }) => Ok(Some(*v as f32)),
            Some(p) => Err(self.wrong_type(p, "float")),
        }
    }

    pub(super) fn float(&self, name: &'static str, default: f32) -> Result<f32> {
        Ok(self.opt_float(name)?.unwrap_or(default))
    }

    pub(super) fn opt_integer(&self, name: &'static str) -> Result<Option<i64>> {
        match self.get(name) {
            None => Ok(None),
            Some(Property { value: Value::Integer(v), .. }) => Ok(Some(*v)),
            Some(p) => Err(self.wrong_type(p, "integer")),
        }
    }

    /// An integer in `range`.
    pub(super) fn count(
        &self,
        name: &'static str,
        default: u32,
        range: std::ops::RangeInclusive<u32>,
    ) -> Result<u32> {
        let Some(value) = self.opt_integer(name)? else { return Ok(default) };
        u32::try_from(value).ok().filter(|v| range.contains(v)).ok_or_else(|| {
            let message = format!("'{name}' is {value}, but must lie in {}..{}", range.start(), range.end());
            self.error_at(name, message)
        })
    }

    pub(super) fn boolean(&self, name: &'static str, default: bool) -> Result<bool> {
        match self.get(name) {
            None => Ok(default),
            Some(Property { value: Value::Boolean(v), .. }) => Ok(*v),
            Some(p) => Err(self.wrong_type(p, "boolean")),
        }
    }

    pub(super) fn opt_string(&self, name: &'static str) -> Result<Option<&'a str>> {
        match self.get(name) {
            None => Ok(None),
            Some(Property { value: Value::String(v), .. }) => Ok(Some(v)),
            Some(p) => Err(self.wrong_type(p, "string")),
        }
    }

    /// One of the given words, lower case.
    pub(super) fn choice<T: Copy>(&self, name: &'static str, default: T, choices: &[(&str, T)]) -> Result<T> {
        let Some(word) = self.opt_string(name)? else { return Ok(default) };
        choices.iter().find(|(w, _)| w.eq_ignore_ascii_case(word)).map(|(_, v)| *v).ok_or_else(|| {
            let words: Vec<_> = choices.iter().map(|(w, _)| *w).collect();
            self.error_at(name, format!("'{name}' is '{word}', but must be one of {}", words.join(", ")))
        })
    }

    pub(super) fn opt_vector(&self, name: &'static str) -> Result<Option<DVec3>> {
        match self.get(name) {
            None => Ok(None),
            Some(Property { value: Value::Vector(v), .. }) => Ok(Some(*v)),
            Some(p) => Err(self.wrong_type(p, "point or vector")),
        }
    }

    pub(super) fn matrix(&self, name: &'static str) -> Result<DMat4> {
        match self.get(name) {
            None => Ok(DMat4::IDENTITY),
            Some(Property { value: Value::Transform(v), .. }) => Ok(*v),
            Some(p) => Err(self.wrong_type(p, "transform")),
        }
    }

    /// An affine, invertible transform, as such and in double precision.
    pub(super) fn to_world(self) -> Result<DAffine3> {
        let m = self.matrix("to_world")?;
        let bottom = m.row(3);
        if bottom != glam::DVec4::W {
            return Err(self.error_at("to_world", "'to_world' must be affine (bottom row 0 0 0 1)"));
        }
        self.invertible("to_world", DAffine3::from_mat4(m))
    }

    pub(super) fn invertible(&self, name: &'static str, m: DAffine3) -> Result<DAffine3> {
        let det = m.matrix3.determinant();
        if det != 0.0 && det.is_finite() && m.inverse().is_finite() && to_f32(m).is_finite() {
            return Ok(m);
        }
        Err(self.error_at(name, format!("the transform of {} is singular or overflows", self.title())))
    }

    /// Child objects without a name, and references, in order, marked as used. Those that are used already are left out.
    pub(super) fn children(&self) -> Result<Vec<(Props<'a>, Pos)>> {
        let mut children = Vec::new();
        for property in self.unused() {
            if let Some(index) = self.object_of(property)? {
                // Named objects are parameters, except that a name changes nothing for these.
                let tag = &self.tree.objects[index].tag;
                if property.name.is_empty() || !matches!(tag.as_str(), "texture" | "volume" | "medium") {
                    property.used.set(true);
                    children.push((Props::new(self.tree, index), property.pos));
                }
            }
        }
        Ok(children)
    }

    /// The object that a property is or refers to.
    pub(super) fn object_of(&self, property: &Property) -> Result<Option<usize>> {
        match (self.tree.object_of(&property.value), &property.value) {
            (None, Value::Reference(id)) => {
                Err(self.tree.error(property.pos, format!("nothing has the id '{id}'")))
            }
            (index, _) => Ok(index),
        }
    }

    /// Properties that nobody asked for.
    pub(super) fn unused(&self) -> impl Iterator<Item = &'a Property> {
        self.object.properties.iter().filter(|p| !p.used.get())
    }

    /// Parameters that nobody asked for are noted: research forks have many more, and Mitsuba 0.6 took any.
    ///
    /// # Errors
    /// If the object holds another one that means nothing to it.
    pub(super) fn finish(self) -> Result<()> {
        for property in self.unused() {
            let is_object = matches!(property.value, Value::Object(_) | Value::Reference(_));
            if is_object && property.name.is_empty() {
                let message =
                    format!("{} does not know the child {}", self.title(), self.tree.name_of(property));
                return Err(self.tree.error(property.pos, message));
            }
            property.used.set(true);
            self.tree.note_unknown(&self.title(), property, &self.object.asked.borrow());
        }
        Ok(())
    }
}

/// To single precision.
pub(super) fn to_f32(m: DAffine3) -> Affine3A {
    Affine3A::from_mat4(Mat4::from_cols_array(&DMat4::from(m).to_cols_array().map(|x| x as f32)))
}

/// To single precision.
pub(super) fn vec3(v: DVec3) -> Vec3 {
    v.as_vec3()
}
