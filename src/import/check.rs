//! The check of a whole document against [`schema`], before the crate `gltf` sees any of it.
//!
//! The crate reads what it is given with little care: a value of another type ends with a message
//! without a place, an index into nowhere and an unknown word with a panic. The check leaves no
//! such value behind, so that neither can happen. It changes the document where files in
//! circulation are sloppy and the meaning is plain: integers that are written with a fraction of
//! zero become integers, numbers beyond their range by no more than a rounding error go to the
//! range's end, and properties that nothing here reads go away.

use super::fault::{Fault, Parsed, quote};
use super::schema::{self, Field, Kind, Need, Unknown};
use super::value::{described, numbered};
use super::warnings::Warnings;
use serde_json::{Map, Value, json};
use std::collections::{BTreeSet, HashSet};
use std::fmt::{Display, Write};

/// Checks a document, in place.
pub(super) fn document(root: &mut Value, warnings: &mut Warnings) -> Parsed<()> {
    let counts = counts(root);
    let mut checker = Checker { counts, path: String::new(), warnings, used: BTreeSet::new() };
    checker.value(&schema::ROOT, root)?;
    let used = checker.used;
    let listed = |list: &str| root[list].as_array().into_iter().flatten().filter_map(Value::as_str);
    let declared: BTreeSet<&str> = listed("extensionsUsed").collect();
    for name in used.iter().map(String::as_str).filter(|name| !declared.contains(name)) {
        let what = format!("the extension {} is used and not listed here", quote(name));
        warnings.allow("/extensionsUsed", &what)?;
    }
    for (i, name) in listed("extensionsRequired").enumerate() {
        if !declared.contains(name) {
            let what = format!("{} is not listed in extensionsUsed", quote(name));
            warnings.mend(&format!("/extensionsRequired/{i}"), what)?;
        }
    }
    let animations = root.get_mut("animations").and_then(Value::as_array_mut);
    animations.into_iter().flatten().enumerate().try_for_each(|(i, value)| animation(i, value))
}

/// Checks that the channels of animation `index` refer to its samplers. One that moves no node gets
/// a property that nothing knows, and a node, without which the crate reads no channel.
fn animation(index: usize, animation: &mut Value) -> Parsed<()> {
    let count = animation["samplers"].as_array().map_or(0, Vec::len);
    let channels = animation["channels"].as_array_mut();
    for (k, channel) in channels.into_iter().flatten().enumerate() {
        let sampler = channel["sampler"].as_u64().unwrap_or(u64::MAX);
        if sampler >= count as u64 {
            let what = format!("refers to sampler {sampler}, and the animation has {count}");
            return Err(Fault::new(format!("/animations/{index}/channels/{k}/sampler"), what));
        }
        if channel["target"].get("node").is_none() {
            channel["target"] = json!({"node": 0, "path": ""});
        }
    }
    Ok(())
}

/// Checks the property `asset`, which says for which version of glTF a file is written, and so
/// whether the rest is to be understood at all.
pub(super) fn asset(root: &Value, warnings: &mut Warnings) -> Parsed<()> {
    let Some(map) = root.as_object() else {
        return Err(Fault::new("", format!("must be an object, and is {}", described(root))));
    };
    let asset = map.get("asset").map(|asset| ("asset", asset.clone()));
    let mut part: Value = asset.into_iter().collect();
    Checker { counts: Vec::new(), path: String::new(), warnings, used: BTreeSet::new() }
        .value(&schema::ONLY_ASSET, &mut part)?;
    let asset = &part["asset"];
    let Some(version) = version(asset, "version")? else { return Ok(()) };
    if version.0 != 2 {
        let what = format!("glTF version {}.{}; only version 2 is read", version.0, version.1);
        return Err(Fault::new("/asset/version", what));
    }
    if let Some(least) = self::version(asset, "minVersion")?.filter(|least| *least > version) {
        let what =
            format!("{}.{} exceeds the version {}.{}", least.0, least.1, version.0, version.1);
        return Err(Fault::new("/asset/minVersion", what));
    }
    if version.1 > 0 {
        warnings.push(format!(
            "the file is written for glTF {}.{}; what is newer than 2.0 is not read",
            version.0, version.1
        ));
    }
    Ok(())
}

/// Major and minor number.
fn version(asset: &Value, key: &str) -> Parsed<Option<(u64, u64)>> {
    let Some(text) = asset[key].as_str() else { return Ok(None) };
    let number = |digits: &str| {
        digits.parse::<u64>().ok().filter(|_| digits.bytes().all(|c| c.is_ascii_digit()))
    };
    match text.split_once('.').and_then(|(major, minor)| Some((number(major)?, number(minor)?))) {
        Some(version) => Ok(Some(version)),
        None => Err(Fault::new(
            format!("/asset/{key}"),
            format!("{} is no version of the form 2.0", quote(text)),
        )),
    }
}

/// Checks an object of our own that stands alone, for tests.
#[cfg(test)]
pub(super) fn alone(kind: &Kind, value: &mut Value) -> Parsed<()> {
    let mut warnings = Warnings::new(true);
    let (path, used) = (String::new(), BTreeSet::new());
    Checker { counts: counts(value), path, warnings: &mut warnings, used }.value(kind, value)
}

/// The lengths of the arrays that indices point into.
fn counts(root: &Value) -> Vec<(&'static str, usize)> {
    let length = |at: &&'static str| {
        let array = root.pointer(&format!("/{at}")).and_then(Value::as_array);
        (*at, array.map_or(0, Vec::len))
    };
    schema::ARRAYS.iter().map(length).collect()
}

struct Checker<'w> {
    counts: Vec<(&'static str, usize)>,
    /// Where the check stands.
    path: String,
    warnings: &'w mut Warnings,
    /// The extensions that objects have.
    used: BTreeSet<String>,
}

impl Checker<'_> {
    fn fault<T>(&self, what: impl Into<String>) -> Parsed<T> {
        Err(Fault::new(self.path.as_str(), what))
    }

    fn mismatch<T>(&self, wanted: &str, value: &Value) -> Parsed<T> {
        self.fault(format!("must be {wanted}, and is {}", described(value)))
    }

    /// Checks what stands at `step` below the present place.
    fn below(&mut self, step: impl Display, kind: &Kind, value: &mut Value) -> Parsed<()> {
        let end = self.path.len();
        let _ = write!(self.path, "/{step}");
        self.value(kind, value)?;
        self.path.truncate(end);
        Ok(())
    }

    fn value(&mut self, kind: &Kind, value: &mut Value) -> Parsed<()> {
        match kind {
            Kind::Any => Ok(()),
            Kind::Flag if value.is_boolean() => Ok(()),
            Kind::Flag => self.mismatch("a boolean", value),
            Kind::Text if value.is_string() => Ok(()),
            Kind::Text => self.mismatch("a string", value),
            Kind::Names(known, unknown) => self.name(known, *unknown, value),
            Kind::Number(low, high) => self.number(*low, *high, value),
            Kind::Positive => {
                self.number(f64::NEG_INFINITY, f64::INFINITY, value)?;
                match value.as_f64() {
                    Some(x) if x <= 0.0 => self.fault(format!("{x} is not greater than 0")),
                    _ => Ok(()),
                }
            }
            Kind::Channels(low, high) if value.is_array() => {
                self.list(&Kind::Number(*low, *high), Some(3), value)
            }
            Kind::Channels(low, high) => self.number(*low, *high, value),
            Kind::Integer => self.integer(value).map(|_| ()),
            Kind::Set => {
                // The crate wants 32 bits; nothing tells one far set from another.
                *value = self.integer(value)?.min(u32::MAX.into()).into();
                Ok(())
            }
            Kind::Count => match self.integer(value)? {
                0 => self.fault("must be at least 1, and is 0"),
                _ => Ok(()),
            },
            Kind::Codes(known, unknown) => {
                let code = self.integer(value)?;
                match unknown {
                    _ if known.contains(&code) => {}
                    Unknown::Refused => {
                        return self.fault(format!("{code} is unknown here; known are {known:?}"));
                    }
                    Unknown::First => {
                        *value = known[0].into();
                        let what = format!("{code} is unknown; taken as {}", known[0]);
                        return self.warnings.mend(&self.path, what);
                    }
                    _ => self.warn_of(&code.to_string()),
                }
                Ok(())
            }
            Kind::To(array) | Kind::Perhaps(array) => {
                let index = self.integer(value)?;
                let count = self.counts.iter().find(|(name, _)| name == array).map_or(0, |c| c.1);
                if index < count as u64 {
                    return Ok(());
                }
                let what = format!("refers to /{array}/{index}, and {array} has {count}");
                match kind {
                    Kind::Perhaps(_) => self.warnings.mend(&self.path, what),
                    _ => self.fault(what),
                }
            }
            Kind::List(kind, least) => {
                self.list(kind, None, value)?;
                match value.as_array().is_some_and(Vec::is_empty) {
                    false => Ok(()),
                    true if *least > 0 => self.fault("it must not be empty"),
                    true => self.warnings.mend(&self.path, "an empty array, which is ignored"),
                }
            }
            Kind::Tuple(kind, length) => self.list(kind, Some(*length), value),
            Kind::Object(fields) => self.object(fields, value),
            Kind::Closed(kind) => {
                self.refuse_unknown(kind, value)?;
                self.value(kind, value)
            }
            Kind::Unread(kind) => {
                self.value(kind, value)?;
                *value = json!({});
                Ok(())
            }
            Kind::Attributes => self.attributes(value),
            Kind::Extras(own) => match value.get_mut("lumicache") {
                Some(value) => self.below("lumicache", own, value),
                None => Ok(()),
            },
            Kind::Luminaire(_) if value.is_object() && value.get("ies").is_none() => Ok(()),
            Kind::Luminaire(kind) => self.value(&Kind::Closed(kind), value),
            Kind::Brdf => self.brdf(value),
        }
    }

    fn name(&mut self, known: &[&str], unknown: Unknown, value: &mut Value) -> Parsed<()> {
        let Some(name) = value.as_str() else { return self.mismatch("a string", value) };
        if known.contains(&name) {
            return Ok(());
        }
        let name = quote(name);
        match unknown {
            Unknown::Refused => {
                return self
                    .fault(format!("{name} is unknown here; known are {}", known.join(", ")));
            }
            Unknown::First => {
                let what = format!("{}: {name} is unknown; taken as {}", self.path, known[0]);
                self.warnings.push(what);
                *value = known[0].into();
            }
            Unknown::Kept => self.warn_of(&name),
        }
        Ok(())
    }

    fn warn_of(&mut self, unknown: &str) {
        self.warnings
            .push(format!("{}: {unknown} is unknown to glTF, so it is left out", self.path));
    }

    fn number(&mut self, low: f64, high: f64, value: &mut Value) -> Parsed<()> {
        let Some(x) = value.as_f64() else { return self.mismatch("a number", value) };
        if !(x as f32).is_finite() {
            return self.fault(format!("the number {x:e} is too large"));
        }
        if (low..=high).contains(&x) {
            return Ok(());
        }
        let what = match high.is_finite() {
            true => format!("{x} is not from {low} to {high}"),
            false => format!("{x} is less than {low}"),
        };
        // What is further away may be meant as percents, as bytes, or in another way.
        let slack = if high.is_finite() { high - low } else { 1e-5 };
        if x < low - slack || x > high + slack {
            return self.fault(what);
        }
        let nearest = x.clamp(low, high);
        *value = nearest.into();
        // Less than single precision tells apart is no news.
        if (x - nearest).abs() <= 1e-6 {
            return Ok(());
        }
        self.warnings.mend(&self.path, format!("{what}; taken as {nearest}"))
    }

    /// An integer of at least 0.
    fn integer(&mut self, value: &mut Value) -> Parsed<u64> {
        if let Some(n) = value.as_u64() {
            return Ok(n);
        }
        // Above 2^53 a number with a fraction of zero is no longer exact.
        let exact = |x: &f64| x.fract() == 0.0 && (0.0..=9e15).contains(x);
        match value.as_f64() {
            Some(x) if exact(&x) => {
                *value = (x as u64).into();
                self.warnings.allow(&self.path, "an integer is written with a fraction")?;
                Ok(x as u64)
            }
            Some(_) => self.fault(format!("must be an integer of at least 0, and is {value}")),
            None => self.mismatch("an integer of at least 0", value),
        }
    }

    fn list(&mut self, kind: &Kind, length: Option<usize>, value: &mut Value) -> Parsed<()> {
        let Value::Array(elements) = value else { return self.mismatch("an array", value) };
        if let Some(length) = length.filter(|length| *length != elements.len()) {
            let what = format!("must have {length} elements, and has {}", elements.len());
            return self.fault(what);
        }
        elements.iter_mut().enumerate().try_for_each(|(i, value)| self.below(i, kind, value))?;
        if matches!(kind, Kind::To(_) | Kind::Text) {
            let mut seen = HashSet::new();
            if let Some(twice) = elements.iter().find(|element| !seen.insert(*element)) {
                let what = match twice {
                    Value::String(text) => format!("it lists {} twice", quote(text)),
                    _ => format!("it lists {twice} twice"),
                };
                return self.warnings.mend(&self.path, what);
            }
        }
        Ok(())
    }

    /// Checks where extensions stand: those that we know may not be anywhere.
    fn extensions(&mut self, fields: &[Field], value: &Value) -> Parsed<()> {
        let Value::Object(map) = value else {
            let what = format!("must be an object, and is {}", described(value));
            return Err(Fault::new(format!("{}/extensions", self.path), what));
        };
        let here = fields.iter().find(|field| field.name == "extensions").map(|field| &field.kind);
        let here = if let Some(Kind::Object(fields)) = here { fields } else { &[][..] };
        for (name, value) in map {
            let at = format!("{}/extensions/{name}", self.path);
            self.used.insert(name.clone());
            if schema::PLACED.contains(&name.as_str())
                && here.iter().all(|field| field.name != name)
            {
                self.warnings.mend(&at, "this extension means nothing here, and is ignored")?;
            } else if !value.is_object() {
                return Err(Fault::new(
                    at,
                    format!("must be an object, and is {}", described(value)),
                ));
            }
        }
        Ok(())
    }

    /// Checks the properties of an object, and removes those that the schema does not name.
    fn object(&mut self, fields: &[Field], value: &mut Value) -> Parsed<()> {
        let Value::Object(map) = value else { return self.mismatch("an object", value) };
        if let Some(extensions) = map.get("extensions") {
            self.extensions(fields, extensions)?;
        }
        map.retain(|key, _| fields.iter().any(|field| field.name == key));
        for field in fields {
            if let Some(value) = map.get_mut(field.name) {
                self.below(field.name, &field.kind, value)?;
            }
        }
        for Field { name, need, .. } in fields {
            match need {
                Need::Must if !map.contains_key(*name) => {
                    return self.fault(format!("the property \"{name}\" is missing"));
                }
                Need::List => drop(map.entry(*name).or_insert_with(|| json!([]))),
                _ => {}
            }
        }
        Ok(())
    }

    /// A misspelt property of our own would silently give something else.
    fn refuse_unknown(&mut self, kind: &Kind, value: &Value) -> Parsed<()> {
        let Kind::Object(fields) = kind else { return Ok(()) };
        let known: Vec<&str> = fields.iter().map(|field| field.name).collect();
        let mut keys = value.as_object().into_iter().flat_map(Map::keys);
        match keys.find(|key| !known.contains(&key.as_str())) {
            Some(key) => self.fault(format!(
                "the property {} is unknown here; known are {}",
                quote(key),
                known.join(", ")
            )),
            None => Ok(()),
        }
    }

    /// The attributes of a primitive: all must refer to accessors, and those that are not read go.
    fn attributes(&mut self, value: &mut Value) -> Parsed<()> {
        let Value::Object(map) = value else { return self.mismatch("an object", value) };
        if map.is_empty() {
            self.warnings.mend(&self.path, "it has no attributes, and shows nothing")?;
        }
        map.iter_mut()
            .try_for_each(|(key, value)| self.below(key, &Kind::To("accessors"), value))?;
        for key in map.keys().filter(|key| !key.starts_with('_')) {
            let at = format!("{}/{key}", self.path);
            let set = schema::SETS.iter().find_map(|set| numbered(key, set));
            match set {
                None if schema::ATTRIBUTES.contains(&key.as_str()) => {}
                None => self.warnings.mend(&at, "an attribute that glTF does not know")?,
                Some((_, 0)) => {}
                Some((set, number)) if map.contains_key(&format!("{set}{}", number - 1)) => {}
                Some(_) => self.warnings.mend(&at, "the attribute before it is missing")?,
            }
        }
        map.retain(|key, _| {
            let skinned = numbered(key, "JOINTS_").or(numbered(key, "WEIGHTS_"));
            schema::ATTRIBUTES.contains(&key.as_str()) || skinned.is_some()
        });
        Ok(())
    }

    fn brdf(&mut self, value: &mut Value) -> Parsed<()> {
        let brdf = match value.get("brdf").and_then(Value::as_str) {
            Some("phong") => Kind::Closed(&schema::PHONG),
            Some("ward") => Kind::Closed(&schema::WARD),
            Some("lafortune") => Kind::Closed(&schema::LAFORTUNE),
            _ => schema::BRDF,
        };
        self.value(&brdf, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complaints_name_the_place() {
        let node = |node: Value| {
            let mut document = json!({"asset": {"version": "2.0"}, "nodes": [node]});
            let fault = super::document(&mut document, &mut Warnings::default()).unwrap_err();
            format!("{}: {}", fault.path, fault.what)
        };
        for (object, says) in [
            (json!({"mesh": -1}), "/nodes/0/mesh: must be an integer of at least 0, and is -1"),
            (json!({"mesh": 2.0}), "/nodes/0/mesh: refers to /meshes/2, and meshes has 0"),
            (json!({"name": 1}), "/nodes/0/name: must be a string, and is a number"),
            (json!({"scale": [1, "x", 1]}), "/nodes/0/scale/1: must be a number, and is a string"),
            (json!({"scale": [1, 1e300, 1]}), "/nodes/0/scale/1: the number 1e300 is too large"),
            (json!({"scale": [1, 2]}), "/nodes/0/scale: must have 3 elements, and has 2"),
            (json!([]), "/nodes/0: must be an object, and is an array"),
            (
                json!({"extensions": {"KHR_lights_punctual": {}}}),
                "/nodes/0/extensions/KHR_lights_punctual: the property \"light\" is missing",
            ),
        ] {
            assert_eq!(node(object), says);
        }
    }

    #[test]
    fn sloppy_documents_are_mended() {
        let mut document = json!({
            "asset": {"version": "2.0"},
            "scene": 0.0,
            "scenes": [{"foo": 1}],
            "materials": [{"alphaMode": "x", "pbrMetallicRoughness": {"metallicFactor": 1.001}}],
            "images": [],
        });
        let mut warnings = Warnings::default();
        super::document(&mut document, &mut warnings).unwrap();
        let wanted = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "materials": [{"alphaMode": "OPAQUE", "pbrMetallicRoughness": {"metallicFactor": 1.0}}],
            "images": [],
        });
        assert_eq!(document, wanted);
        assert_eq!(
            warnings.lines(),
            [
                "/materials/0/pbrMetallicRoughness/metallicFactor: 1.001 is not from 0 to 1; taken as 1",
                "/materials/0/alphaMode: \"x\" is unknown; taken as OPAQUE",
                "/images: an empty array, which is ignored",
            ]
        );
    }
}
