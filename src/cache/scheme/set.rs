//! Settings by name: a scheme is made of them, changed by them and shown as them.

use super::Scheme;
use super::table::{Describe, Setting};
use crate::error::{Error, Result};
use serde_json::{Map, Value};
use std::sync::LazyLock;

/// The groups that a scheme may be without, and the setting that each of them needs.
const OPTIONAL: [(&str, &str); 2] = [("refinement", "refinement.rule"), ("glossy", "glossy.order")];

/// The value of an optional group that a scheme is without.
const NONE: &str = "none";

/// What is wrong with settings, and with which of them.
pub(super) struct Problem {
    pub at: Option<usize>,
    pub what: String,
}

/// A setting and its value.
pub(super) type Change = (String, Value);

/// Every setting that there is.
pub fn settings() -> &'static [Setting] {
    static SETTINGS: LazyLock<Vec<Setting>> = LazyLock::new(|| {
        let mut table = Vec::new();
        Scheme::describe("", "", None, &mut table);
        table
    });
    &SETTINGS
}

fn group(name: &str) -> &str {
    name.split_once('.').map_or("", |(group, _)| group)
}

/// The value that a command line gives, as TOML would have it.
fn value_of(text: &str) -> Value {
    match text.parse::<f64>().ok().and_then(serde_json::Number::from_f64) {
        Some(number) => number.into(),
        None => text.parse::<bool>().map_or_else(|_| text.into(), Value::from),
    }
}

fn unknown(name: &str) -> String {
    let similar: Vec<&str> = settings().iter().map(|s| s.name.as_str()).collect();
    let of_group: Vec<&str> = similar
        .iter()
        .copied()
        .filter(|s| !group(name).is_empty() && group(s) == group(name))
        .collect();
    if of_group.is_empty() {
        format!("there is no setting `{name}`; the settings are {}", similar.join(", "))
    } else {
        let group = group(name);
        format!("there is no setting `{name}`; those of `{group}` are {}", of_group.join(", "))
    }
}

/// `value` as the setting `name` takes it.
fn accept(name: &str, value: &Value) -> std::result::Result<Value, String> {
    let shown = || value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    if OPTIONAL.iter().any(|(group, _)| *group == name) {
        let none = value.as_str().filter(|text| text.trim_matches('"') == NONE);
        return none.map(Value::from).ok_or_else(|| {
            format!("setting `{name}` is {}, expected none or a group of settings", shown())
        });
    }
    let setting = settings().iter().find(|s| s.name == name).ok_or_else(|| unknown(name))?;
    setting
        .allowed
        .accept(value)
        .ok_or_else(|| format!("setting `{name}` is {}, expected {}", shown(), setting.allowed))
}

/// Why `name`, although it was set, is no setting of `scheme`.
fn idle(name: &str, settings: &Map<String, Value>) -> String {
    let kind = match settings.get("extrapolation.kind") {
        Some(kind) if group(name) == "extrapolation" => format!("`extrapolation.kind` is {kind}"),
        _ => format!("`{}` is none", group(name)),
    };
    format!("setting `{name}` has no effect: {}", kind.replace('"', ""))
}

/// Numbers as they are written in single precision: 0.15 and not 0.15000000596046448.
fn short(value: Value) -> Value {
    match value.as_f64().filter(|_| value.is_f64()) {
        Some(x) => (x as f32).to_string().parse::<f64>().map_or(value, Value::from),
        None => value,
    }
}

/// The scheme of these settings, and the settings that have an effect in it. `missing` says what
/// is not there.
fn build(settings: &Map<String, Value>) -> std::result::Result<Scheme, String> {
    let mut groups = Map::new();
    for (name, value) in settings {
        match name.split_once('.') {
            None => drop(groups.insert(name.clone(), value.clone())),
            Some((group, field)) => {
                let group = groups.entry(group).or_insert_with(|| Map::new().into());
                if let Value::Object(fields) = group {
                    fields.insert(field.to_owned(), value.clone());
                }
            }
        }
    }
    serde_json::from_value(groups.into()).map_err(|e| e.to_string())
}

/// The scheme that `base` becomes by `changes`; without a base they must be all that a scheme has.
pub(super) fn changed(
    base: Option<&Scheme>,
    changes: &[Change],
) -> std::result::Result<Scheme, Problem> {
    let mut settings = base.map(Scheme::settings).unwrap_or_default();
    for (at, (name, value)) in changes.iter().enumerate() {
        let value = accept(name, value).map_err(|what| Problem { at: Some(at), what })?;
        if let Some((group, _)) = OPTIONAL.iter().find(|(g, _)| *g == group(name)) {
            settings.shift_remove(*group);
        }
        settings.insert(name.clone(), value);
    }
    for (optional, needed) in OPTIONAL {
        let position = |name: &str| changes.iter().rposition(|(n, _)| n == name);
        if position(optional).is_some() {
            settings.retain(|name, _| group(name) != optional);
            settings.insert(optional.to_owned(), NONE.into());
        } else if settings.keys().any(|name| group(name) == optional)
            && !settings.contains_key(needed)
        {
            let at = changes.iter().position(|(name, _)| group(name) == optional);
            let what = format!("`{optional}` is none, and `{needed}` is needed to have it");
            return Err(Problem { at, what });
        }
    }
    let required = |name: &str| {
        let extra = name.starts_with("extrapolation.") && name != "extrapolation.kind";
        !extra && OPTIONAL.iter().all(|(optional, _)| group(name) != *optional)
    };
    if let Some(missing) =
        super::settings().iter().find(|s| required(&s.name) && !settings.contains_key(&s.name))
    {
        let what = format!("setting `{}` is missing, and there is no base", missing.name);
        return Err(Problem { at: None, what });
    }
    for (optional, _) in OPTIONAL {
        if !settings.keys().any(|name| name == optional || group(name) == optional) {
            settings.insert(optional.to_owned(), NONE.into());
        }
    }
    let whole = |what: String| Problem { at: None, what };
    let scheme = build(&settings).map_err(whole)?;
    scheme.check_combinations().map_err(|what| whole(what.to_owned()))?;
    let settings = scheme.settings();
    match changes.iter().position(|(name, _)| !settings.contains_key(name)) {
        Some(at) => Err(Problem { at: Some(at), what: idle(&changes[at].0, &settings) }),
        None => Ok(scheme),
    }
}

/// Checks that the numbers of `scheme` are within their bounds.
pub(super) fn check_ranges(scheme: &Scheme) -> std::result::Result<(), String> {
    scheme.settings().iter().try_for_each(|(name, value)| accept(name, value).map(drop))
}

impl Scheme {
    /// The settings by their names, with the values that TOML and JSON have for them. A group that
    /// the scheme is without is `none`.
    pub fn settings(&self) -> Map<String, Value> {
        let mut settings = Map::new();
        let Ok(Value::Object(groups)) = serde_json::to_value(self) else {
            unreachable!("a scheme is plain data")
        };
        for (name, value) in groups {
            match value {
                Value::Object(fields) => settings.extend(
                    fields.into_iter().map(|(field, v)| (format!("{name}.{field}"), short(v))),
                ),
                value => drop(settings.insert(name, value)),
            }
        }
        settings
    }

    /// Gives settings the values that are written as in presets, such as `gather.rays` and `512`,
    /// and checks the whole once: the order of the settings does not matter. `refinement` and
    /// `glossy` become `none`; a group that is none comes by `refinement.rule` or `glossy.order`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the setting and what it takes, also for one that has no
    /// effect; the scheme is unchanged then.
    pub fn set_all<K: AsRef<str>, V: AsRef<str>>(
        &mut self,
        pairs: impl IntoIterator<Item = (K, V)>,
    ) -> Result<()> {
        let changes: Vec<Change> = pairs
            .into_iter()
            .map(|(name, value)| (name.as_ref().to_owned(), value_of(value.as_ref())))
            .collect();
        *self = changed(Some(self), &changes).map_err(|p| Error::InvalidArgument(p.what))?;
        Ok(())
    }

    /// Gives one setting a value: see [`Scheme::set_all`].
    ///
    /// # Errors
    /// Those of [`Scheme::set_all`].
    pub fn set(&mut self, name: &str, value: &str) -> Result<()> {
        self.set_all([(name, value)])
    }

    /// All settings as TOML, which reads back to the same scheme.
    pub fn to_toml(&self) -> String {
        let settings = self.settings();
        let mut text = String::new();
        for (name, value) in settings.iter().filter(|(name, _)| group(name).is_empty()) {
            text += &format!("{name} = {value}\n");
        }
        let mut last = "";
        for (name, value) in &settings {
            let Some((group, field)) = name.split_once('.') else { continue };
            if group != last {
                text += &format!("\n[{group}]\n");
                last = group;
            }
            text += &format!("{field} = {value}\n");
        }
        text
    }
}

/// Reads and writes optional groups, as `none` where there is none.
pub(super) mod optional {
    use super::{NONE, Value};
    use serde::de::{DeserializeOwned, Error};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<T: Serialize, S: Serializer>(
        group: &Option<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        match group {
            Some(group) => group.serialize(serializer),
            None => serializer.serialize_str(NONE),
        }
    }

    pub fn deserialize<'de, T: DeserializeOwned, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<T>, D::Error> {
        let value = Value::deserialize(deserializer)?;
        if value == NONE {
            return Ok(None);
        }
        serde_json::from_value(value).map(Some).map_err(D::Error::custom)
    }
}

/// The settings as a page of Markdown: of each its name, the values that it takes, what it means
/// and what the presets give it.
pub fn settings_page() -> String {
    let presets: Vec<_> =
        super::PRESETS.iter().map(|p| (p.name.as_str(), p.scheme().settings())).collect();
    let mut page = String::new();
    let mut last = None;
    for setting in settings() {
        let group = group(&setting.name);
        if last != Some(group) {
            let title = if group.is_empty() { "the scheme itself" } else { group };
            page += &format!("{}### {title}\n\n", if last.is_some() { "\n" } else { "" });
            last = Some(group);
        }
        let mut values: Vec<(String, Vec<&str>)> = Vec::new();
        for (name, settings) in &presets {
            let Some(value) = settings.get(&setting.name) else { continue };
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            match values.iter_mut().find(|(v, _)| *v == value) {
                Some((_, names)) => names.push(name),
                None => values.push((value, vec![name])),
            }
        }
        let doc = setting.doc.replace("[`", "`").replace("`]", "`");
        let allowed = match &setting.allowed {
            super::Allowed::Words(_) => String::new(),
            allowed => format!(" ({allowed})"),
        };
        wrap(&mut page, &format!("- `{}`{allowed}: {doc}", setting.name), "  ");
        let of = |value: &str| {
            let names = values.iter().find(|(v, _)| v == value).map(|(_, names)| names.as_slice());
            match names.unwrap_or_default() {
                [] => String::new(),
                names if names.len() == presets.len() => " In all presets.".to_owned(),
                names => format!(" In {}.", names.join(", ")),
            }
        };
        match &setting.allowed {
            super::Allowed::Words(words) => {
                for (word, doc) in words {
                    let doc = doc.replace("[`", "`").replace("`]", "`");
                    wrap(&mut page, &format!("  - `{word}`: {doc}{}", of(word)), "    ");
                }
            }
            _ => {
                for (value, _) in &values {
                    wrap(&mut page, &format!("  - `{value}`:{}", of(value)), "    ");
                }
            }
        }
    }
    page
}

/// Adds `text` in lines of at most 100 columns, those after the first behind `indent`.
fn wrap(page: &mut String, text: &str, indent: &str) {
    let mut width = 0;
    let start = text.len() - text.trim_start().len();
    for (k, word) in text.split_whitespace().enumerate() {
        let length = word.chars().count();
        if k == 0 {
            page.push_str(&text[..start]);
            width = start;
        } else if width + 1 + length > 100 {
            page.push('\n');
            page.push_str(indent);
            width = indent.len();
        } else {
            page.push(' ');
            width += 1;
        }
        page.push_str(word);
        width += length;
    }
    page.push('\n');
}
