//! `lumicache presets`.

use super::terminal::{print, print_line};
use lumicache::cache::PRESETS;
use lumicache::error::Result;
use serde_json::{Value, json};

pub fn presets(as_json: bool) -> Result<()> {
    let rows: Vec<(&str, &str, &str, Value)> = PRESETS
        .iter()
        .map(|p| {
            (
                p.name,
                p.source,
                p.summary,
                serde_json::to_value(p.scheme()).expect("a scheme is plain data"),
            )
        })
        .collect();
    if as_json {
        let table: Vec<Value> = rows
            .into_iter()
            .map(|(name, source, summary, scheme)| json!({"name": name, "source": source, "summary": summary, "scheme": scheme}))
            .collect();
        return print_line(&format!("{:#}", Value::from(table)));
    }
    let mut text = String::new();
    for (name, source, summary, _) in &rows {
        text += &format!("{name:<18}{source:<30}{summary}\n");
    }
    // Settings as rows, presets as columns.
    let text_of = |v: &Value| v.as_str().map_or_else(|| v.to_string(), str::to_owned);
    let fields: Vec<&String> = rows[0].3.as_object().into_iter().flat_map(|o| o.keys()).collect();
    let cells = |name: &str| rows.iter().map(|r| text_of(&r.3[name])).collect::<Vec<_>>();
    let widths: Vec<usize> = (0..rows.len())
        .map(|k| {
            fields.iter().map(|f| cells(f)[k].len()).max().unwrap_or(0).max(rows[k].0.len()) + 2
        })
        .collect();
    let row = |first: &str, cells: &[String]| {
        let cells: String = cells.iter().zip(&widths).map(|(c, w)| format!("{c:<w$}")).collect();
        format!("{first:<24}{}\n", cells.trim_end())
    };
    text += "\n";
    text += &row("setting", &rows.iter().map(|r| r.0.to_owned()).collect::<Vec<_>>());
    for field in fields {
        text += &row(field, &cells(field));
    }
    print(text.as_bytes())
}
