//! Numbers of the JSON.

use serde_json::Value;

/// A single-precision number of the JSON, or the default.
pub(super) fn float(value: &Value, default: f32) -> f32 {
    value.as_f64().map_or(default, |x| x as f32)
}

/// Double-precision numbers of the JSON.
pub(super) fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
    numbers.try_into().ok()
}

/// Single-precision numbers of the JSON, or the default for each.
pub(super) fn floats<const N: usize>(value: &Value, default: f32) -> [f32; N] {
    numbers(value).map_or([default; N], |numbers| numbers.map(|x| x as f32))
}

/// An index of the JSON.
pub(super) fn index(value: &Value) -> Option<usize> {
    value.as_u64().map(|i| i as usize)
}

/// The prefix and the number of an attribute of which there may be several. The crate would take
/// JOINTS_01 for JOINTS_1.
pub(super) fn numbered<'p>(key: &str, prefix: &'p str) -> Option<(&'p str, u32)> {
    let digits = key.strip_prefix(prefix)?;
    let number: u32 = digits.parse().ok()?;
    (number.to_string() == digits).then_some((prefix, number))
}

/// What a value is, for messages.
pub(super) fn described(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}
