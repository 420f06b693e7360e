//! `lumicache presets`, and how other commands name a scheme.

use super::terminal::{print, print_line};
use lumicache::cache::{PRESETS, Preset};
use lumicache::error::{Error, Result};
use serde_json::{Value, json};
use std::path::Path;

/// Lists all presets, or prints the one called `name`.
pub fn run(name: Option<&str>, all: bool, as_json: bool) -> Result<()> {
    if let Some(name) = name {
        let preset = preset(name)?;
        return print(if all { preset.to_toml() } else { preset.text }.as_bytes());
    }
    if as_json {
        let row = |p: &Preset| {
            json!({
                "name": p.name, "source": p.source, "summary": p.summary, "scheme": p.scheme().settings(),
            })
        };
        let table: Vec<Value> = PRESETS.iter().map(row).collect();
        return print_line(&format!("{:#}", Value::from(table)));
    }
    let row = |p: &Preset| format!("{:<17}{:<28}{}\n", p.name, p.source, p.summary);
    print(PRESETS.iter().map(row).collect::<String>().as_bytes())
}

/// True if `name` is that of a file.
pub fn is_file(name: &str) -> bool {
    name.ends_with(".toml")
}

/// The preset with this name, or of this file if it ends in `.toml`.
pub fn preset(name: &str) -> Result<Preset> {
    if is_file(name) { Preset::from_file(Path::new(name)) } else { Preset::by_name(name).cloned() }
}

/// The setting and its value that `--set` gives.
pub fn pair(text: &str) -> Result<(String, String)> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| Error::InvalidArgument(format!("--set {text}: expected KEY=VALUE")))?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}
