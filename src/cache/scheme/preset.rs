//! Schemes as texts: the published ones, and those that users write.

use super::Scheme;
use super::set::{Change, changed};
use crate::error::{Error, Result};
use crate::fsutil;
use serde_json::Value;
use std::path::Path;
use std::sync::LazyLock;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A named scheme: a TOML text that says where it comes from, on which preset it is based and what
/// differs.
#[derive(Clone, Debug)]
pub struct Preset {
    /// What users type; of a text that users wrote the name of its file, or nothing.
    pub name: String,
    /// Where it comes from.
    pub source: String,
    /// What is particular about it.
    pub summary: String,
    /// The preset that it differs from.
    pub base: Option<String>,
    /// The text.
    pub text: String,
    scheme: Scheme,
}

macro_rules! presets {
    ($($name:literal),+) => {
        [$(($name, include_str!(concat!("presets/", $name, ".toml")))),+]
    };
}

/// Every preset, in the order of publication, ours last.
pub static PRESETS: LazyLock<Vec<Preset>> = LazyLock::new(|| {
    let texts = presets!(
        "ward88",
        "ward-heckbert92",
        "tabellion04",
        "krivanek05",
        "krivanek06",
        "mdic",
        "hmdic",
        "aric11",
        "scotty3d",
        "jarosz12",
        "schwarzhaupt12",
        "zhao-incoming",
        "zhao-outgoing",
        "zhao-view",
        "auto"
    );
    let mut presets = Vec::with_capacity(texts.len());
    for (name, text) in texts {
        let preset = Preset::parse(name, text, &presets);
        presets.push(preset.unwrap_or_else(|e| panic!("preset {name}: {e}")));
    }
    presets
});

fn find<'a>(presets: &'a [Preset], name: &str) -> std::result::Result<&'a Preset, String> {
    presets.iter().find(|p| p.name == name).ok_or_else(|| {
        let names: Vec<_> = presets.iter().map(|p| p.name.as_str()).collect();
        format!("there is no preset `{name}`; the presets are {}", names.join(", "))
    })
}

impl Preset {
    /// The preset called `name`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] listing the names there are.
    pub fn by_name(name: &str) -> Result<&'static Self> {
        find(&PRESETS, name).map_err(Error::InvalidArgument)
    }

    /// The scheme that the TOML text `text` describes, as the presets do.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the line and the setting that is wrong.
    pub fn from_text(text: &str) -> Result<Self> {
        Self::parse("", text, &PRESETS)
            .map_err(|what| Error::InvalidArgument(format!("preset, {what}")))
    }

    /// The scheme of the TOML file `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, [`Error::InvalidArgument`] naming the file, the
    /// line and the setting that is wrong.
    pub fn from_file(path: &Path) -> Result<Self> {
        let text = String::from_utf8(fsutil::read(path)?)
            .map_err(|_| Error::InvalidArgument(format!("{}: it is no text", path.display())))?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        Self::parse(&name, &text, &PRESETS)
            .map_err(|what| Error::InvalidArgument(format!("{}, {what}", path.display())))
    }

    /// The preset called `what`, or the one that it describes if it is a TOML text.
    ///
    /// # Errors
    /// Those of [`Preset::by_name`] and [`Preset::from_text`].
    pub fn from_name_or_text(what: &str) -> Result<Self> {
        if what.contains(['=', '\n']) {
            Self::from_text(what)
        } else {
            Self::by_name(what).cloned()
        }
    }

    /// Its scheme.
    pub fn scheme(&self) -> Scheme {
        self.scheme.clone()
    }

    /// The whole scheme as a TOML text without a base.
    pub fn to_toml(&self) -> String {
        let text = |s: &str| Value::from(s);
        format!(
            "source = {}\nsummary = {}\n{}",
            text(&self.source),
            text(&self.summary),
            self.scheme.to_toml()
        )
    }

    fn parse(name: &str, text: &str, known: &[Self]) -> std::result::Result<Self, String> {
        let line = |at: usize| format!("line {}: ", 1 + text[..at].matches('\n').count());
        let table = DeTable::parse(text)
            .map_err(|e| line(e.span().map_or(0, |span| span.start)) + e.message().trim_end())?;
        let mut flat = Vec::new();
        flatten("", table.get_ref(), &mut flat);
        let (mut words, mut changes, mut places) = ([const { None }; 3], Vec::new(), Vec::new());
        for (key, value, at) in flat {
            let place = line(at);
            let value = value.ok_or_else(|| format!("{place}setting `{key}` takes one value"))?;
            match ["source", "summary", "base"].iter().position(|word| *word == key) {
                Some(k) => {
                    let word =
                        value.as_str().ok_or_else(|| format!("{place}`{key}` is no text"))?;
                    words[k] = Some(word.to_owned());
                }
                None => {
                    changes.push((key, value));
                    places.push(place);
                }
            }
        }
        let [source, summary, base] = words;
        let below = base.as_deref().map(|base| find(known, base)).transpose()?;
        let changes: Vec<Change> = changes;
        let scheme = changed(below.map(|p| &p.scheme), &changes)
            .map_err(|p| p.at.map_or_else(String::new, |k| places[k].clone()) + &p.what)?;
        Ok(Self {
            name: name.to_owned(),
            source: source.unwrap_or_default(),
            summary: summary.unwrap_or_default(),
            base,
            text: text.to_owned(),
            scheme,
        })
    }
}

/// The keys of `table`, dotted, with their values, if these are numbers, texts or flags, and where
/// they stand.
fn flatten(before: &str, table: &DeTable, all: &mut Vec<(String, Option<Value>, usize)>) {
    for (key, value) in table {
        let name = format!("{before}{}", key.get_ref());
        let at = Spanned::span(key).start;
        let found = match value.get_ref() {
            DeValue::Table(inner) => {
                flatten(&format!("{name}."), inner, all);
                continue;
            }
            DeValue::String(text) => Some(Value::from(text.as_ref())),
            DeValue::Boolean(flag) => Some((*flag).into()),
            DeValue::Integer(number) => number.as_str().parse::<i64>().ok().map(Value::from),
            DeValue::Float(number) => number.as_str().parse::<f64>().ok().map(Value::from),
            DeValue::Array(_) | DeValue::Datetime(_) => None,
        };
        all.push((name, found, at));
    }
}
