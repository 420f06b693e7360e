//! The settings as a page of the guide.

use super::preset::PRESETS;
use super::set::{group, settings};
use super::table::Allowed;

/// The settings as a page of Markdown: of each its name, the values that it takes, what it means
/// and what the presets give it.
pub fn settings_page() -> String {
    let presets: Vec<_> =
        PRESETS.iter().map(|p| (p.name.as_str(), p.scheme().settings())).collect();
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
            Allowed::Words(_) => String::new(),
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
            Allowed::Words(words) => {
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
