//! A JSON document whose values know where they stand, so that every complaint can name the place.

use crate::error::Error;
use serde_json::{Map, Value};
use std::path::Path;

/// What is wrong with a document and where; becomes an [`Error`] once the file's name is at hand.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    /// JSON path, empty for the file as a whole.
    pub path: String,
    /// The complaint.
    pub what: String,
    /// The document is sound, but we cannot read it.
    pub unsupported: bool,
}

/// The result of reading a part of a document.
pub(super) type Parsed<T> = std::result::Result<T, Fault>;

impl Fault {
    /// A breach of the specification at `path`.
    pub fn new(path: impl Into<String>, what: impl Into<String>) -> Self {
        Self { path: path.into(), what: what.into(), unsupported: false }
    }

    /// Something sound at `path` that we cannot read.
    pub fn unsupported(path: impl Into<String>, what: impl Into<String>) -> Self {
        Self { path: path.into(), what: what.into(), unsupported: true }
    }

    /// The error for the scene file `file`.
    pub fn into_error(self, file: &Path) -> Error {
        if self.unsupported {
            Error::unsupported(file, self.path, self.what)
        } else {
            Error::scene(file, self.path, self.what)
        }
    }
}

/// A string of the document as it may appear in a message: quoted, control characters escaped, cut
/// to a readable length.
pub(super) fn quote(text: &str) -> String {
    const LONGEST: usize = 80;
    match text.char_indices().nth(LONGEST) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}...", &text[..end]),
    }
}

/// A value of the document with its JSON path.
#[derive(Clone, Debug)]
pub(super) struct Json<'a> {
    value: &'a Value,
    path: String,
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}

fn as_unsigned(value: &Value) -> Option<u64> {
    // An integer may be written with a fraction of zero; above 2^53 such a number is no longer
    // exact.
    value.as_u64().or_else(|| {
        value.as_f64().filter(|x| x.fract() == 0.0 && (0.0..=9e15).contains(x)).map(|x| x as u64)
    })
}

impl<'a> Json<'a> {
    /// The document itself.
    pub fn root(value: &'a Value) -> Self {
        Self { value, path: String::new() }
    }

    /// Where the value stands.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The path of a property of this object.
    pub fn path_of(&self, key: impl std::fmt::Display) -> String {
        format!("{}/{key}", self.path)
    }

    /// A complaint about this value.
    pub fn fault(&self, what: impl Into<String>) -> Fault {
        Fault::new(self.path.as_str(), what)
    }

    /// A complaint about a property of this object.
    pub fn fault_at(&self, key: &str, what: impl Into<String>) -> Fault {
        Fault::new(self.path_of(key), what)
    }

    fn mismatch(&self, wanted: &str) -> Fault {
        self.fault(format!("must be {wanted}, and is {}", kind(self.value)))
    }

    /// The value as an object.
    pub fn object(&self) -> Parsed<&'a Map<String, Value>> {
        self.value.as_object().ok_or_else(|| self.mismatch("an object"))
    }

    /// True if the value is an object.
    pub fn is_object(&self) -> bool {
        self.value.is_object()
    }

    /// A property of this object, whatever its type.
    pub fn get(&self, key: &str) -> Parsed<Option<Json<'a>>> {
        Ok(self.object()?.get(key).map(|value| Json { value, path: self.path_of(key) }))
    }

    /// True if this object has the property.
    pub fn has(&self, key: &str) -> bool {
        self.value.as_object().is_some_and(|o| o.contains_key(key))
    }

    /// The complaint that a property is missing.
    pub fn missing(&self, key: &str) -> Fault {
        self.fault(format!("the property \"{key}\" is missing"))
    }

    /// A property that is an object.
    pub fn object_at(&self, key: &str) -> Parsed<Option<Json<'a>>> {
        let Some(child) = self.get(key)? else { return Ok(None) };
        child.object()?;
        Ok(Some(child))
    }

    /// A property that is an object and must be there.
    pub fn need_object(&self, key: &str) -> Parsed<Json<'a>> {
        self.object_at(key)?.ok_or_else(|| self.missing(key))
    }

    /// The elements of this array.
    pub fn elements(&self) -> Parsed<Vec<Json<'a>>> {
        let array = self.value.as_array().ok_or_else(|| self.mismatch("an array"))?;
        Ok(array
            .iter()
            .enumerate()
            .map(|(i, value)| Json { value, path: self.path_of(i) })
            .collect())
    }

    /// The elements of a property that is an array; none if it is absent.
    pub fn array(&self, key: &str) -> Parsed<Vec<Json<'a>>> {
        self.get(key)?.map_or(Ok(Vec::new()), |array| array.elements())
    }

    /// The objects of one of the document's top-level arrays, which the specification forbids to be
    /// empty.
    pub fn entities(&self, key: &str) -> Parsed<Vec<Json<'a>>> {
        let entities = self.array(key)?;
        if entities.is_empty() && self.has(key) {
            return Err(self.fault_at(key, "an empty array is not allowed here: leave it out"));
        }
        for entity in &entities {
            entity.object()?;
            entity.string("name")?;
        }
        Ok(entities)
    }

    /// This value as a number that single precision can hold.
    pub fn as_number(&self) -> Parsed<f64> {
        let x = self.value.as_f64().ok_or_else(|| self.mismatch("a number"))?;
        if (x as f32).is_finite() {
            Ok(x)
        } else {
            Err(self.fault(format!("the number {x:e} is too large")))
        }
    }

    /// A number.
    pub fn number(&self, key: &str) -> Parsed<Option<f64>> {
        self.get(key)?.map(|n| n.as_number()).transpose()
    }

    /// A number that must be there.
    pub fn need_number(&self, key: &str) -> Parsed<f64> {
        self.number(key)?.ok_or_else(|| self.missing(key))
    }

    /// A number from `low` to `high`, or the default.
    pub fn number_in(&self, key: &str, default: f64, low: f64, high: f64) -> Parsed<f32> {
        let x = self.number(key)?.unwrap_or(default);
        self.within(key, x, low, high)
    }

    fn within(&self, key: &str, x: f64, low: f64, high: f64) -> Parsed<f32> {
        // Exporters write bounds with a rounding error.
        let slack = 1e-5;
        if x >= low - slack && x <= high + slack {
            return Ok(x.clamp(low, high) as f32);
        }
        Err(self.fault_at(
            key,
            if high.is_finite() {
                format!("{x} is not from {low} to {high}")
            } else {
                format!("{x} is less than {low}")
            },
        ))
    }

    /// `N` numbers.
    pub fn numbers<const N: usize>(&self, key: &str) -> Parsed<Option<[f64; N]>> {
        let Some(array) = self.get(key)? else { return Ok(None) };
        let elements = array.elements()?;
        if elements.len() != N {
            return Err(array.fault(format!("must have {N} elements, and has {}", elements.len())));
        }
        let mut numbers = [0.0; N];
        for (number, element) in numbers.iter_mut().zip(&elements) {
            *number = element.as_number()?;
        }
        Ok(Some(numbers))
    }

    /// `N` numbers from `low` to `high`, or the default for each.
    pub fn numbers_in<const N: usize>(
        &self,
        key: &str,
        default: f32,
        low: f64,
        high: f64,
    ) -> Parsed<[f32; N]> {
        let Some(numbers) = self.numbers::<N>(key)? else { return Ok([default; N]) };
        let mut out = [0.0; N];
        for (i, x) in numbers.into_iter().enumerate() {
            out[i] = self.within(&format!("{key}/{i}"), x, low, high)?;
        }
        Ok(out)
    }

    /// This value as an integer of at least 0.
    pub fn as_unsigned(&self) -> Parsed<u64> {
        as_unsigned(self.value).ok_or_else(|| match self.value {
            Value::Number(n) => self.fault(format!("must be an integer of at least 0, and is {n}")),
            _ => self.mismatch("an integer of at least 0"),
        })
    }

    /// An integer of at least 0.
    pub fn unsigned(&self, key: &str) -> Parsed<Option<u64>> {
        self.get(key)?.map(|n| n.as_unsigned()).transpose()
    }

    /// An integer of at least 1 that must be there.
    pub fn need_positive(&self, key: &str) -> Parsed<u64> {
        match self.unsigned(key)? {
            Some(0) => Err(self.fault_at(key, "must be at least 1, and is 0")),
            Some(n) => Ok(n),
            None => Err(self.missing(key)),
        }
    }

    /// This value as an index below `count` into the array called `array`.
    pub fn as_index(&self, array: &str, count: usize) -> Parsed<usize> {
        let index = self.as_unsigned()?;
        match usize::try_from(index) {
            Ok(i) if i < count => Ok(i),
            _ => Err(self.fault(format!("refers to /{array}/{index}, and {array} has {count}"))),
        }
    }

    /// An index below `count` into the array called `array`.
    pub fn index(&self, key: &str, array: &str, count: usize) -> Parsed<Option<usize>> {
        self.get(key)?.map(|n| n.as_index(array, count)).transpose()
    }

    /// An index that must be there.
    pub fn need_index(&self, key: &str, array: &str, count: usize) -> Parsed<usize> {
        self.index(key, array, count)?.ok_or_else(|| self.missing(key))
    }

    /// A boolean, or the default.
    pub fn boolean(&self, key: &str, default: bool) -> Parsed<bool> {
        let Some(child) = self.get(key)? else { return Ok(default) };
        child.value.as_bool().ok_or_else(|| child.mismatch("a boolean"))
    }

    /// This value as a string.
    pub fn as_string(&self) -> Parsed<&'a str> {
        self.value.as_str().ok_or_else(|| self.mismatch("a string"))
    }

    /// A string.
    pub fn string(&self, key: &str) -> Parsed<Option<&'a str>> {
        self.get(key)?.map(|s| s.as_string()).transpose()
    }

    /// A string that must be there.
    pub fn need_string(&self, key: &str) -> Parsed<&'a str> {
        self.string(key)?.ok_or_else(|| self.missing(key))
    }

    /// The object of the extension `name` on this object.
    pub fn extension(&self, name: &str) -> Parsed<Option<Json<'a>>> {
        match self.object_at("extensions")? {
            Some(extensions) => extensions.object_at(name),
            None => Ok(None),
        }
    }

    /// The name of the object, or what it is called in messages.
    pub fn label(&self) -> String {
        match self.object_name() {
            Some(name) => format!("{} ({})", self.path, quote(name)),
            None => self.path.clone(),
        }
    }

    /// The name of the object if it has one.
    pub fn object_name(&self) -> Option<&'a str> {
        self.value.get("name").and_then(Value::as_str).filter(|n| !n.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse::parse;
    use super::*;

    fn fault<T: std::fmt::Debug>(result: Parsed<T>) -> (String, String) {
        let fault = result.unwrap_err();
        (fault.path, fault.what)
    }

    #[test]
    fn complaints_name_the_place() {
        let document =
            parse(br#"{"a": [{"b": -1, "c": "x", "d": 1e300, "e": 2.0, "f": [1, 2]}]}"#).unwrap();
        let a = &Json::root(&document).array("a").unwrap()[0];
        assert_eq!(fault(a.unsigned("b")).0, "/a/0/b");
        assert_eq!(
            fault(a.number("c")),
            ("/a/0/c".into(), "must be a number, and is a string".into())
        );
        assert_eq!(fault(a.number("d")).0, "/a/0/d");
        assert_eq!(a.unsigned("e").unwrap(), Some(2));
        assert_eq!(
            fault(a.index("e", "nodes", 2)),
            ("/a/0/e".into(), "refers to /nodes/2, and nodes has 2".into())
        );
        assert_eq!(fault(a.numbers::<3>("f")).0, "/a/0/f");
        assert_eq!(
            fault(a.need_string("g")),
            ("/a/0".into(), "the property \"g\" is missing".into())
        );
        assert_eq!(fault(Json::root(&document).object_at("a")).0, "/a");
    }
}
