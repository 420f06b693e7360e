//! No circles between files: the `mod` lines of a folder's mod.rs are an order, bottom to top. A
//! file or a subfolder uses only those before it. What mod.rs itself defines is free to all.

use crate::support::source::{Source, files, paths, read, root, tokens};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Code without its test modules, which may use the whole folder.
fn without_tests(tokens: Vec<String>) -> Vec<String> {
    const MARK: [&str; 8] = ["#", "[", "cfg", "(", "test", ")", "]", "mod"];
    let mut kept = Vec::with_capacity(tokens.len());
    let mut i = 0;
    while i < tokens.len() {
        let marked = tokens[i..].iter().take(MARK.len()).eq(MARK.iter());
        if marked && tokens.get(i + MARK.len() + 1).is_some_and(|t| t == "{") {
            i += block_length(&tokens[i..]);
        } else {
            kept.push(tokens[i].clone());
            i += 1;
        }
    }
    kept
}

/// The number of tokens up to the end of the first block in braces.
fn block_length(tokens: &[String]) -> usize {
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate() {
        depth += i32::from(token == "{") - i32::from(token == "}");
        if token == "}" && depth == 0 {
            return i + 1;
        }
    }
    tokens.len()
}

/// The paths into this crate that `tokens` name, from the crate's root on. `module` is the path of
/// the file's module; blocks `mod x { … }` inside the file are followed.
fn absolute_paths(tokens: &[String], module: &[String]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let mut module = module.to_vec();
    let mut depth = 0;
    let mut inline = Vec::new(); // The depths at which blocks of modules began.
    for i in 0..tokens.len() {
        match tokens[i].as_str() {
            "{" => {
                if i >= 2 && tokens[i - 2] == "mod" {
                    module.push(tokens[i - 1].clone());
                    inline.push(depth);
                }
                depth += 1;
            }
            "}" => {
                depth -= 1;
                if inline.last() == Some(&depth) {
                    inline.pop();
                    module.pop();
                }
            }
            _ => {}
        }
        let opens = tokens.get(i + 1).is_some_and(|t| t == "::");
        if !opens || (i > 0 && tokens[i - 1] == "::") {
            continue;
        }
        let supers =
            tokens[i..].chunks(2).take_while(|c| c.len() == 2 && *c == ["super", "::"]).count();
        match tokens[i].as_str() {
            "crate" | "lumicache" => drop(paths(&tokens[i + 2..], &[], &mut found)),
            "super" if supers <= module.len() => {
                let above = &module[..module.len() - supers];
                paths(&tokens[i + 2 * supers..], above, &mut found);
            }
            _ => {}
        }
    }
    found
}

/// A folder of modules: its children in order, and what mod.rs takes from which of them.
struct Folder {
    name: String,
    children: Vec<String>,
    names: Vec<(String, usize)>,
}

impl Folder {
    fn of(name: &str, code: &[String], definitions: impl Fn(&str) -> Vec<String>) -> Self {
        let children: Vec<String> = code
            .windows(3)
            .filter(|w| w[0] == "mod" && w[2] == ";")
            .map(|w| w[1].clone())
            .collect();
        let mut names = Vec::new();
        for at in (0..code.len()).filter(|i| code[*i] == "use") {
            let mut taken = Vec::new();
            paths(&code[at + 1..], &[], &mut taken);
            for path in taken {
                let first = usize::from(path[0] == "self");
                let child = path.get(first).and_then(|f| children.iter().position(|c| c == f));
                let Some(child) = child else { continue };
                match path.last().map(String::as_str) {
                    Some("*") => {
                        names.extend(definitions(&children[child]).into_iter().map(|d| (d, child)));
                    }
                    Some(last) => names.push((last.to_owned(), child)),
                    None => {}
                }
            }
        }
        Self { name: name.to_owned(), children, names }
    }

    fn rank(&self, name: &str) -> Option<usize> {
        let child = self.children.iter().position(|c| c == name);
        child.or_else(|| self.names.iter().find(|(n, _)| n == name).map(|(_, child)| *child))
    }

    /// The other child that the child `own` uses when it names `what`. All names of the folder
    /// count as its last child.
    fn used(&self, own: &str, what: &str) -> Option<(usize, usize)> {
        let own = self.rank(own)?;
        let used = if what == "*" { self.children.len() - 1 } else { self.rank(what)? };
        (used != own).then_some((own, used))
    }

    /// What the order lacks, given who uses whom by which name; empty if nothing.
    fn faults(&self, uses: &BTreeMap<(usize, usize), String>) -> String {
        let mut text = String::new();
        let child = |i: usize| self.children[i].as_str();
        for ((own, used), by) in uses.iter().filter(|((own, used), _)| used > own) {
            text += &format!("  {} stands before {} and uses {by}\n", child(*own), child(*used));
        }
        if text.is_empty() {
            return text;
        }
        let mut left: Vec<usize> = (0..self.children.len()).collect();
        let mut sorted = Vec::new();
        while let Some(at) = left
            .iter()
            .position(|own| !uses.keys().any(|(user, used)| user == own && left.contains(used)))
        {
            sorted.push(child(left.remove(at)));
        }
        // Who is used by nobody that is left is in no circle.
        while let Some(at) = left
            .iter()
            .position(|own| !uses.keys().any(|(user, used)| used == own && left.contains(user)))
        {
            left.remove(at);
        }
        let circle = left.into_iter().map(child).collect::<Vec<_>>().join(", ");
        let way = format!("  an order that would do: {}\n", sorted.join(", "));
        text += &if circle.is_empty() { way } else { format!("  circles among: {circle}\n") };
        format!("{}:\n{text}", self.name)
    }
}

/// What a file, or the mod.rs of a folder, defines or exports at its top level.
fn definitions(path: &Path) -> Vec<String> {
    const KINDS: [&str; 8] = ["fn", "struct", "enum", "union", "const", "static", "type", "trait"];
    let code = without_tests(tokens(&Source::parse(&read(path)).code));
    code.windows(2).filter(|w| KINDS.contains(&w[0].as_str())).map(|w| w[1].clone()).collect()
}

fn module_path(file: &Path) -> Vec<String> {
    let stem = file.with_extension("");
    let parts = stem.iter().skip(1).map(|p| p.to_string_lossy().into_owned());
    parts.filter(|p| p != "mod").collect()
}

#[test]
fn a_file_uses_only_those_before_it_in_its_folder() {
    let code_of = |path: &Path| without_tests(tokens(&Source::parse(&read(path)).code));
    let sources = files("src", &["rs"]);
    let folders: Vec<Folder> = sources
        .iter()
        .filter(|p| p.ends_with("mod.rs"))
        .map(|path| {
            let folder = path.parent().expect("a folder");
            let file = |child: &str| -> PathBuf {
                let flat = folder.join(format!("{child}.rs"));
                if root().join(&flat).exists() { flat } else { folder.join(child).join("mod.rs") }
            };
            let name = module_path(path).join("/");
            Folder::of(&name, &code_of(path), |child| definitions(&file(child)))
        })
        .collect();
    let mut uses = vec![BTreeMap::new(); folders.len()];
    for path in &sources {
        let module = module_path(path);
        for target in absolute_paths(&code_of(path), &module) {
            for level in 1..module.len().min(target.len()) {
                let name = module[..level].join("/");
                let at = folders.iter().position(|f| f.name == name);
                let Some(at) = at.filter(|_| module[..level] == target[..level]) else { break };
                if let Some(pair) = folders[at].used(&module[level], &target[level]) {
                    uses[at].entry(pair).or_insert_with(|| target.join("::"));
                }
            }
        }
    }
    let faults: String = folders.iter().zip(&uses).map(|(f, uses)| f.faults(uses)).collect();
    assert!(faults.is_empty(), "files that use what comes later in their folder:\n{faults}");
}

#[test]
fn the_check_of_the_order_of_files_sees_every_way_to_name_a_file() {
    let words = |code: &str| without_tests(tokens(&Source::parse(code).code));
    let path = |p: &str| p.split("::").map(str::to_owned).collect::<Vec<_>>();
    let code = "use super::{late, Item as I}; use crate::cache::{self, early::X};
        mod inner { use super::super::late::Y; } fn f() -> super::Z { a::super_b::c() }
        #[cfg(test)] mod tests { use super::super::late; fn g() {} } fn h() { super::super::top() }";
    let found: Vec<_> = absolute_paths(&words(code), &path("cache::middle"))
        .into_iter()
        .map(|p| p.join("::"))
        .collect();
    let expected = [
        "cache::late",
        "cache::Item",
        "cache::self",
        "cache::early::X",
        "cache::late::Y",
        "cache::Z",
        "top",
    ];
    assert_eq!(found, expected);
    let facade = "mod early; pub mod middle; mod late; pub use late::{Item, Other}; use early::*;";
    let folder = Folder::of("cache", &words(facade), |_| vec!["Early".to_owned()]);
    assert_eq!(folder.used("middle", "late"), Some((1, 2)));
    assert_eq!(folder.used("middle", "Item"), Some((1, 2)));
    assert_eq!(folder.used("middle", "*"), Some((1, 2)));
    assert_eq!(folder.used("middle", "Early"), Some((1, 0)));
    assert_eq!(folder.used("middle", "DefinedInMod"), None);
    assert_eq!(folder.used("late", "Other"), None);
    let faults = |pairs: &[(usize, usize)]| {
        folder.faults(&pairs.iter().map(|pair| (*pair, "x".to_owned())).collect())
    };
    assert!(faults(&[(1, 0), (2, 0), (2, 1)]).is_empty());
    assert!(faults(&[(0, 1), (2, 0)]).contains("would do: middle, early, late"));
    assert!(faults(&[(0, 1), (1, 2), (2, 1)]).contains("circles among: middle, late"));
}
