//! The settings as a table: name, meaning and allowed values, from the definitions of the fields.

use crate::words::Words;
use serde_json::Value;
use std::fmt;

/// A setting of a scheme.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Its name: `group.field`, or a field of the scheme itself.
    pub name: String,
    /// What it means.
    pub doc: String,
    /// The values that it takes.
    pub allowed: Allowed,
}

/// The values that a setting takes.
#[derive(Clone, Debug)]
pub enum Allowed {
    /// One of these words, each with what it means.
    Words(Vec<(String, String)>),
    /// A number, perhaps a whole one, within bounds.
    Number {
        /// True if it has no fraction.
        whole: bool,
        /// The smallest and the largest.
        bounds: Bounds,
    },
    /// `true` or `false`.
    Flag,
}

/// The range of a number.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    low: f64,
    /// The number must be above `low`.
    open: bool,
    high: f64,
}

/// From `low` to `high`, both included.
pub(super) const fn within(low: f64, high: f64) -> Bounds {
    Bounds { low, open: false, high }
}

/// Above `low`, and at most `high`.
pub(super) const fn above(low: f64, high: f64) -> Bounds {
    Bounds { low, open: true, high }
}

impl Allowed {
    /// `value` as the setting takes it; `None` if it does not.
    pub(super) fn accept(&self, value: &Value) -> Option<Value> {
        match self {
            Self::Words(words) => {
                let text = value.as_str()?.trim_matches('"');
                words.iter().any(|(word, _)| word == text).then(|| text.into())
            }
            Self::Flag => value.as_bool().map(Value::from),
            Self::Number { whole, bounds } => {
                let x = value.as_f64()?;
                let (single, low, high) = (x as f32, bounds.low as f32, bounds.high as f32);
                let above = if bounds.open { single > low } else { single >= low };
                if !(above && single <= high && single.is_finite()) {
                    return None;
                }
                if *whole { (x.fract() == 0.0).then(|| (x as u64).into()) } else { Some(x.into()) }
            }
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Words(words) => {
                let words: Vec<_> = words.iter().map(|(word, _)| word.as_str()).collect();
                write!(f, "one of {}", words.join(", "))
            }
            Self::Flag => write!(f, "true or false"),
            Self::Number { whole, bounds: Bounds { low, open, high } } => {
                write!(f, "a {}number ", if *whole { "whole " } else { "" })?;
                match (open, high.is_finite()) {
                    (true, false) => write!(f, "above {low}"),
                    (true, true) => write!(f, "above {low} and at most {high}"),
                    (false, false) => write!(f, "of at least {low}"),
                    (false, true) => write!(f, "from {low} to {high}"),
                }
            }
        }
    }
}

/// What a field of a scheme adds to the table.
pub(super) trait Describe {
    fn describe(name: &str, doc: &str, bounds: Option<Bounds>, table: &mut Vec<Setting>);
}

fn add(table: &mut Vec<Setting>, name: &str, doc: &str, allowed: Allowed) {
    table.push(Setting { name: name.to_owned(), doc: doc.to_owned(), allowed });
}

impl<T: Words> Describe for T {
    fn describe(name: &str, doc: &str, _: Option<Bounds>, table: &mut Vec<Setting>) {
        let words = T::words().into_iter().map(|w| (w.word, w.doc)).collect();
        add(table, name, doc, Allowed::Words(words));
    }
}

impl Describe for bool {
    fn describe(name: &str, doc: &str, _: Option<Bounds>, table: &mut Vec<Setting>) {
        add(table, name, doc, Allowed::Flag);
    }
}

macro_rules! number {
    ($($type:ty: $whole:literal),+) => {
        $(impl Describe for $type {
            fn describe(name: &str, doc: &str, bounds: Option<Bounds>, table: &mut Vec<Setting>) {
                let bounds = bounds.expect("a number has bounds");
                add(table, name, doc, Allowed::Number { whole: $whole, bounds });
            }
        })+
    };
}

number!(f32: false, u32: true, u8: true);

impl<T: Describe> Describe for Option<T> {
    fn describe(name: &str, doc: &str, bounds: Option<Bounds>, table: &mut Vec<Setting>) {
        T::describe(name, doc, bounds, table);
    }
}

/// Defines a group of settings: fields with their documentation and, behind `=`, the bounds of
/// numbers.
macro_rules! group {
    (
        $(#[$meta:meta])+
        pub struct $name:ident {
            $(
                $(#[doc = $doc:literal])+
                $(#[serde($($serde:tt)+)])?
                pub $field:ident: $type:ty $(= $bounds:expr)?,
            )+
        }
    ) => {
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        $(#[$meta])+
        pub struct $name {
            $(
                $(#[doc = $doc])+
                $(#[serde($($serde)+)])?
                pub $field: $type,
            )+
        }

        impl $crate::cache::scheme::table::Describe for $name {
            fn describe(
                name: &str,
                _: &str,
                _: Option<$crate::cache::scheme::table::Bounds>,
                table: &mut Vec<$crate::cache::scheme::table::Setting>,
            ) {
                let dot = if name.is_empty() { "" } else { "." };
                $(
                    let bounds = None $(.or(Some($bounds)))?;
                    <$type as $crate::cache::scheme::table::Describe>::describe(
                        &format!("{name}{dot}{}", stringify!($field)),
                        concat!($($doc),+).trim(),
                        bounds,
                        table,
                    );
                )+
            }
        }
    };
}

pub(super) use group;
