//! What the targets share.

use serde_json::{Number, Value, json};
use std::path::Path;

/// Hands `bytes` to `read` as a file of that name, alone in its folder.
pub fn as_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a folder");
    }
    FOLDER.with(|folder| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a file");
        read(&path);
    });
}

/// Numbers that look random.
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u32) -> Self {
        Self(u64::from(seed) ^ 0x9e37_79b9_7f4a_7c15)
    }

    /// A number below `n`, or 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        ((self.0 >> 33) as usize).checked_rem(n).unwrap_or(0)
    }
}

/// What numbers of files are when they are wrong.
const EXTREMES: [f64; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1e-45,
    1e-30,
    1e10,
    1e19,
    3.4e38,
    -3.4e38,
    1e39,
    1e308,
    255.0,
    4_294_967_295.0,
    65_536.0,
];

/// Words that mean something in the files that are read.
const WORDS: [&str; 28] = [
    "SCALAR",
    "VEC2",
    "VEC3",
    "VEC4",
    "MAT2",
    "MAT4",
    "OPAQUE",
    "MASK",
    "BLEND",
    "point",
    "spot",
    "directional",
    "perspective",
    "orthographic",
    "LINEAR",
    "STEP",
    "CUBICSPLINE",
    "translation",
    "rotation",
    "scale",
    "weights",
    "image/png",
    "image/jpeg",
    "phong",
    "ward",
    "ATTRIBUTES",
    "OCTAHEDRAL",
    "x",
];

/// A part of `value`.
fn part<'a>(value: &'a Value, dice: &mut Dice) -> &'a Value {
    let next = match value {
        Value::Object(members) => members.values().nth(dice.below(members.len())),
        Value::Array(items) => items.get(dice.below(items.len())),
        _ => None,
    };
    next.filter(|_| dice.below(5) > 0).map_or(value, |inner| part(inner, dice))
}

/// Changes one place of `value`: a number or a word becomes another, a member goes, comes twice or
/// changes places with its neighbour, or a part of `other` comes there.
pub fn change(value: &mut Value, other: &Value, dice: &mut Dice) {
    match value {
        Value::Object(members) if !members.is_empty() && dice.below(8) > 0 => {
            let key = members.keys().nth(dice.below(members.len())).expect("one of them").clone();
            match dice.below(16) {
                0 => {
                    members.remove(&key);
                }
                1 => {
                    let twin = members.keys().nth(dice.below(members.len())).expect("one").clone();
                    let copy = members[&twin].clone();
                    members.insert(key, copy);
                }
                2 => {
                    if let Value::Object(theirs) = part(other, dice)
                        && let Some((key, inner)) = theirs.iter().nth(dice.below(theirs.len()))
                    {
                        members.insert(key.clone(), inner.clone());
                    }
                }
                _ => change(&mut members[&key], other, dice),
            }
        }
        Value::Array(items) if !items.is_empty() && dice.below(8) > 0 => {
            let (at, twin) = (dice.below(items.len()), dice.below(items.len()));
            match dice.below(16) {
                0 => {
                    items.remove(at);
                }
                1 => items.insert(at, items[twin].clone()),
                2 => items.swap(at, twin),
                _ => change(&mut items[at], other, dice),
            }
        }
        Value::Number(number) => {
            let whole = number.as_i64();
            *value = match (whole, dice.below(3)) {
                (Some(n), 0) => json!(n.wrapping_add(dice.below(5) as i64 - 2)),
                (Some(_), 1) => json!(EXTREMES[dice.below(16)].abs() as u64),
                _ => Number::from_f64(EXTREMES[dice.below(16)]).map_or(Value::Null, Value::Number),
            };
        }
        Value::Bool(b) => *b = !*b,
        Value::String(_) if dice.below(8) > 0 => *value = json!(WORDS[dice.below(WORDS.len())]),
        _ if dice.below(2) > 0 => *value = part(other, dice).clone(),
        _ => {
            let kinds = [json!(null), json!(-1), json!(1e39), json!("x"), json!([]), json!({})];
            *value = kinds[dice.below(kinds.len())].clone();
        }
    }
}

/// The JSON in `file`, and the bytes before and after it: all of a text, the first chunk of a
/// binary container.
pub fn json_of(file: &[u8]) -> Option<(Value, &[u8], &[u8])> {
    if let Some(rest) = file.strip_prefix(b"glTF") {
        let word = |at: usize| Some(u32::from_le_bytes(rest.get(at..at + 4)?.try_into().ok()?));
        let json = rest.get(16..16usize.checked_add(word(8)? as usize)?)?;
        return Some((serde_json::from_slice(json).ok()?, &file[..12], &rest[16 + json.len()..]));
    }
    Some((serde_json::from_slice(file).ok()?, &[], &[]))
}

/// The file with `json` in the place that [`json_of`] found it in.
pub fn with_json(json: &Value, before: &[u8], after: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    if before.is_empty() {
        return text;
    }
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = (12 + 8 + text.len() + after.len()) as u32;
    let chunk = [&(text.len() as u32).to_le_bytes()[..], b"JSON", &text].concat();
    [&before[..8], &length.to_le_bytes(), &chunk, after].concat()
}

/// Puts `file` into the fuzzer's buffer if it fits; the length then.
pub fn replace(data: &mut [u8], most: usize, file: &[u8]) -> Option<usize> {
    let fits = file.len() <= most.min(data.len());
    fits.then(|| {
        data[..file.len()].copy_from_slice(file);
        file.len()
    })
}
