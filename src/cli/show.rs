//! `lumicache presets`.

use super::render::preset;
use super::terminal::{print, print_line};
use lumicache::cache::{PRESETS, Preset};
use lumicache::error::Result;
use serde_json::{Value, json};

/// `lumicache presets`: all of them, or the one called `name`.
pub fn presets(name: Option<&str>, all: bool, as_json: bool) -> Result<()> {
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
