//! Settings by name: a scheme is made of them, changed by them and shown as them.

use super::Scheme;
use super::table::{Describe, Setting};
use crate::error::{Error, Result};
use serde_json::{Map, Value};
use std::sync::LazyLock;

/// The groups that a scheme may be without, and the setting that each of them needs.
const OPTIONAL: [(&str, &str); 3] = [
    ("refinement", "refinement.rule"),
    ("glossy", "glossy.order"),
    ("radiosity", "radiosity.rays"),
];

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

/// The group of a setting, nothing for one of the scheme itself.
pub(super) fn group(name: &str) -> &str {
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

/// The scheme of these settings.
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
    base: Option<&Scheme>, changes: &[Change],
) -> std::result::Result<Scheme, Problem> {
    let mut chosen = base.map(Scheme::settings).unwrap_or_default();
    for (at, (name, value)) in changes.iter().enumerate() {
        let value = accept(name, value).map_err(|what| Problem { at: Some(at), what })?;
        if let Some((group, _)) = OPTIONAL.iter().find(|(g, _)| *g == group(name)) {
            chosen.shift_remove(*group);
        }
        chosen.insert(name.clone(), value);
    }
    for (optional, needed) in OPTIONAL {
        let position = |name: &str| changes.iter().rposition(|(n, _)| n == name);
        if position(optional).is_some() {
            chosen.retain(|name, _| group(name) != optional);
            chosen.insert(optional.to_owned(), NONE.into());
        } else if chosen.keys().any(|name| group(name) == optional) && !chosen.contains_key(needed)
        {
            let at = changes.iter().position(|(name, _)| group(name) == optional);
            let wanted = at.map_or(optional, |at| changes[at].0.as_str());
            let what = format!("`{wanted}`: `{optional}` is none without `{needed}`");
            return Err(Problem { at, what });
        }
    }
    let required = |name: &str| {
        let extra = name.starts_with("extrapolation.") && name != "extrapolation.kind";
        !extra && OPTIONAL.iter().all(|(optional, _)| group(name) != *optional)
    };
    if let Some(missing) =
        settings().iter().find(|s| required(&s.name) && !chosen.contains_key(&s.name))
    {
        let what = format!("setting `{}` is missing, and there is no base", missing.name);
        return Err(Problem { at: None, what });
    }
    for (optional, _) in OPTIONAL {
        if !chosen.keys().any(|name| name == optional || group(name) == optional) {
            chosen.insert(optional.to_owned(), NONE.into());
        }
    }
    let whole = |what: String| Problem { at: None, what };
    let scheme = build(&chosen).map_err(whole)?;
    scheme.check_combinations().map_err(|what| whole(what.to_owned()))?;
    let effective = scheme.settings();
    match changes.iter().position(|(name, _)| !effective.contains_key(name)) {
        Some(at) => Err(Problem { at: Some(at), what: idle(&changes[at].0, &effective) }),
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
    /// and checks the whole once: the order of the settings does not matter. `refinement`,
    /// `glossy` and `radiosity` become `none`; a group that is none comes by `refinement.rule`,
    /// `glossy.order` or `radiosity.rays`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the setting and what it takes, also for one that has no
    /// effect; the scheme is unchanged then.
    pub fn set_all<K: AsRef<str>, V: AsRef<str>>(
        &mut self, pairs: impl IntoIterator<Item = (K, V)>,
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
        group: &Option<T>, serializer: S,
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
