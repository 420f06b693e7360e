//! From text to a JSON tree, with the JSON path of the place where that fails.

use super::budget::Budget;
use super::fault::{Fault, Parsed, quote};
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::fmt::{self, Display};

/// Parses the bytes of a document. A property that appears twice is an error, as the specification
/// says.
pub(super) fn parse(bytes: &[u8], budget: &mut Budget) -> Parsed<Value> {
    if bytes.starts_with(b"\xEF\xBB\xBF") {
        return Err(Fault::new(
            "",
            "the JSON begins with a byte order mark, which glTF forbids: save it as plain UTF-8",
        ));
    }
    let mut state = State { path: Vec::new(), budget, refused: None };
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = Tree(&mut state).deserialize(&mut deserializer);
    value.and_then(|value| deserializer.end().map(|()| value)).map_err(|e| {
        let place: String = state.path.iter().map(|step| format!("/{step}")).collect();
        state.refused.unwrap_or_else(|| Fault::new(place, format!("not valid JSON: {e}")))
    })
}

/// A step from a value to one below it.
enum Step {
    Element(usize),
    Key(String),
}

impl Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Element(i) => i.fmt(f),
            Self::Key(key) => key.fmt(f),
        }
    }
}

struct State<'b> {
    /// The steps to the value at hand.
    path: Vec<Step>,
    budget: &'b mut Budget,
    /// What the budget does not allow.
    refused: Option<Fault>,
}

/// Builds a value and keeps, where it fails, the steps that led there.
struct Tree<'s, 'b>(&'s mut State<'b>);

impl<'b> Tree<'_, 'b> {
    fn below(&mut self, step: Step) -> Tree<'_, 'b> {
        self.0.path.push(step);
        Tree(self.0)
    }

    /// Takes memory from the budget.
    fn spend<E: Error>(&mut self, bytes: usize) -> Result<(), E> {
        self.0.budget.spend(1, bytes as u64, "").map_err(|fault| {
            let text = E::custom(&fault.what);
            self.0.refused = Some(fault);
            text
        })
    }
}

impl<'de> DeserializeSeed<'de> for Tree<'_, '_> {
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

impl<'de> Visitor<'de> for Tree<'_, '_> {
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
        while let Some(element) =
            elements.next_element_seed(self.below(Step::Element(array.len())))?
        {
            self.0.path.pop();
            self.spend(size_of::<Value>())?;
            array.push(element);
        }
        self.0.path.pop();
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
            // The map keeps key and value, and an index of its entries.
            self.spend(size_of::<(String, Value)>() + 2 * key.len() + 32)?;
            let value = entries.next_value_seed(self.below(Step::Key(key.clone())))?;
            self.0.path.pop();
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
        assert_eq!(
            parse(text.as_bytes(), &mut Budget::new(None)).unwrap(),
            serde_json::from_str::<Value>(text).unwrap()
        );
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
            assert_eq!(
                parse(text.as_bytes(), &mut Budget::new(None)).unwrap_err().path,
                path,
                "{text}"
            );
        }
        assert!(parse(b"{\"a\": \"\xff\"}", &mut Budget::new(None)).is_err());
    }

    #[test]
    fn deep_nesting_is_an_error_and_not_a_crash() {
        for text in ["[".repeat(1_000_000), "{\"a\":".repeat(1_000_000)] {
            let fault = parse(text.as_bytes(), &mut Budget::new(None)).unwrap_err();
            assert!(fault.what.contains("recursion"), "{}", fault.what);
        }
    }
}
