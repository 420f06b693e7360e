//! From text to a JSON tree, with the JSON path of the place where that fails.

use super::fault::{Fault, Parsed, quote};
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::fmt;

/// Parses the bytes of a document. A property that appears twice is an error, as the specification
/// says.
pub(super) fn parse(bytes: &[u8]) -> Parsed<Value> {
    if bytes.starts_with(b"\xEF\xBB\xBF") {
        return Err(Fault::new(
            "",
            "the JSON begins with a byte order mark, which glTF forbids: save it as plain UTF-8",
        ));
    }
    let mut path = Vec::new();
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = Tree { path: &mut path }.deserialize(&mut deserializer);
    value.and_then(|value| deserializer.end().map(|()| value)).map_err(|e| {
        let place: String = path.iter().map(|step| format!("/{step}")).collect();
        Fault::new(place, format!("not valid JSON: {e}"))
    })
}

/// Builds a value and keeps, where it fails, the steps that led there.
struct Tree<'p> {
    path: &'p mut Vec<String>,
}

impl Tree<'_> {
    fn below(&mut self, step: String) -> Tree<'_> {
        self.path.push(step);
        Tree { path: self.path }
    }
}

impl<'de> DeserializeSeed<'de> for Tree<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

macro_rules! scalars {
    ($($visit:ident: $kind:ty),*) => {
        $(fn $visit<E>(self, x: $kind) -> Result<Value, E> {
            Ok(Value::from(x))
        })*
    };
}

impl<'de> Visitor<'de> for Tree<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    scalars!(visit_bool: bool, visit_u64: u64, visit_i64: i64, visit_f64: f64, visit_str: &str);

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut elements: A) -> Result<Value, A::Error> {
        let mut array = Vec::new();
        while let Some(element) = elements.next_element_seed(self.below(array.len().to_string()))? {
            self.path.pop();
            array.push(element);
        }
        self.path.pop();
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
            let value = entries.next_value_seed(self.below(key.clone()))?;
            self.path.pop();
            if object.contains_key(&key) {
                return Err(A::Error::custom(format!(
                    "the property {} appears twice",
                    quote(&key)
                )));
            }
            object.insert(key, value);
        }
        Ok(Value::Object(object))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_that_serde_json_reads() {
        let text = r#"{"a": [1, -2, 3.5, 1e3, true, null, "x\u00e9"], "b": {}, "c": [[], [{"d": 18446744073709551615}]]}"#;
        assert_eq!(parse(text.as_bytes()).unwrap(), serde_json::from_str::<Value>(text).unwrap());
    }

    #[test]
    fn failures_have_a_path() {
        for (text, path) in [
            (r#"{"a": [0, {"b": 1e999}]}"#, "/a/1/b"),
            (r#"{"a": {"b": 1, "b": 2}}"#, "/a"),
            (r#"{"a": [1, 2"#, "/a/2"),
            (r#"{"a": 1} x"#, ""),
            ("", ""),
            ("\u{FEFF}{}", ""),
        ] {
            assert_eq!(parse(text.as_bytes()).unwrap_err().path, path, "{text}");
        }
        assert!(parse(b"{\"a\": \"\xff\"}").is_err());
    }

    #[test]
    fn deep_nesting_is_an_error_and_not_a_crash() {
        for text in ["[".repeat(1_000_000), "{\"a\":".repeat(1_000_000)] {
            let fault = parse(text.as_bytes()).unwrap_err();
            assert!(fault.what.contains("recursion"), "{}", fault.what);
        }
    }
}
