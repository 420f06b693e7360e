//! The files of the project, read as text. A small lexer tells code from comments and blanks string
//! literals: a word in a string is no finding.

use std::fs;
use std::path::{Path, PathBuf};

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The files under `folder` with one of these extensions ("" is none), sorted, relative to the root
/// of the project.
pub fn files(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    fn walk(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
        let Ok(entries) = fs::read_dir(folder) else { return };
        for path in entries.map(|e| e.expect("a readable folder").path()) {
            if path.is_dir() {
                walk(&path, extensions, found);
            } else if extensions.iter().any(|x| path.extension().unwrap_or_default() == *x) {
                found.push(path.strip_prefix(root()).expect("inside the project").to_owned());
            }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), extensions, &mut found);
    found.sort();
    found
}

/// The Markdown files of the project.
pub fn documents() -> Vec<PathBuf> {
    let top = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(PathBuf::from);
    let below = ["docs", "ffi", "benches", "fuzz"].map(|folder| files(folder, &["md"]));
    top.into_iter().chain(below.concat()).collect()
}

pub fn read(path: &Path) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A Rust source as two texts of the same length: its code with comments and literals blanked, and
/// its comments alone.
pub struct Source {
    pub code: String,
    pub comments: String,
}

impl Source {
    pub fn parse(text: &str) -> Self {
        #[derive(Clone, Copy, PartialEq)]
        enum Part {
            Code,
            Comment,
            Blank,
        }
        let chars: Vec<char> = text.chars().collect();
        let starts = |i: usize, what: &str| {
            what.chars().enumerate().all(|(k, c)| chars.get(i + k) == Some(&c))
        };
        let until = |from: usize, what: &str| {
            (from..chars.len())
                .find(|&i| starts(i, what))
                .map_or(chars.len(), |i| i + what.chars().count())
        };
        let mut parts = vec![Part::Code; chars.len()];
        let mut i = 0;
        while i < chars.len() {
            let word_before = i > 0 && (chars[i - 1].is_alphanumeric() || chars[i - 1] == '_');
            let hashes = chars[i + 1..].iter().take_while(|c| **c == '#').count();
            let (part, end) = if starts(i, "//") {
                (Part::Comment, (i..chars.len()).find(|&k| chars[k] == '\n').unwrap_or(chars.len()))
            } else if starts(i, "/*") {
                (Part::Comment, until(i, "*/"))
            } else if chars[i] == 'r' && !word_before && chars.get(i + 1 + hashes) == Some(&'"') {
                (Part::Blank, until(i + 2 + hashes, &format!("\"{}", "#".repeat(hashes))))
            } else if chars[i] == '"' {
                let mut k = i + 1;
                while k < chars.len() && chars[k] != '"' {
                    k += if chars[k] == '\\' { 2 } else { 1 };
                }
                (Part::Blank, k + 1)
            } else if chars[i] == '\'' && starts(i + 1, "\\") {
                (Part::Blank, until(i + 3, "'"))
            } else if chars[i] == '\'' && chars.get(i + 2) == Some(&'\'') {
                (Part::Blank, i + 3)
            } else {
                (Part::Code, i + 1)
            };
            let end = end.min(chars.len());
            parts[i..end].fill(part);
            i = end;
        }
        let only = |wanted: Part| {
            let keep = |(c, p): (&char, &Part)| if *p == wanted || *c == '\n' { *c } else { ' ' };
            chars.iter().zip(&parts).map(keep).collect()
        };
        Self { code: only(Part::Code), comments: only(Part::Comment) }
    }
}

/// The words and the punctuation of `code`, `::` as one token.
pub fn tokens(code: &str) -> Vec<String> {
    let mut tokens: Vec<String> = Vec::new();
    let mut joins = false;
    for c in code.chars() {
        let word = c.is_alphanumeric() || c == '_';
        if word && joins {
            tokens.last_mut().expect("a word has begun").push(c);
        } else if c == ':' && tokens.last().is_some_and(|t| t == ":") {
            *tokens.last_mut().expect("just seen") = "::".into();
        } else if !c.is_whitespace() {
            tokens.push(c.into());
        }
        joins = word;
    }
    tokens
}

/// Every path of `tree`, the part of a path after `prefix::`; groups are expanded. Returns the
/// number of tokens read.
pub fn paths(tree: &[String], prefix: &[String], found: &mut Vec<Vec<String>>) -> usize {
    let mut path = prefix.to_vec();
    let mut i = 0;
    while i < tree.len() {
        if tree[i] == "{" {
            i += 1;
            while i < tree.len() && tree[i] != "}" {
                i += if tree[i] == "," { 1 } else { paths(&tree[i..], &path, found).max(1) };
            }
            return i + 1;
        }
        path.push(tree[i].clone());
        i += 1;
        if tree.get(i).map(String::as_str) != Some("::") {
            break;
        }
        i += 1;
    }
    found.push(path);
    // A new name says nothing of what is named.
    i + if tree.get(i).is_some_and(|t| t == "as") { 2 } else { 0 }
}
