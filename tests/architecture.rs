//! The structure of the source: module order, citations, file sizes, where `unsafe` may stand, and
//! versions that must agree.
//!
//! The files are read as text. A small lexer tells code from comments and blanks string literals,
//! so that a word in a string is no finding.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The modules of `src`, bottom to top: a module may use only those before it.
const ORDER: &[&str] = &[
    "error",
    "progress",
    "fsutil",
    "words",
    "math",
    "ffi",
    "imagefile",
    "basis",
    "sampling",
    "geometry",
    "accel",
    "texture",
    "material",
    "light",
    "camera",
    "scene",
    "gather",
    "cache",
    "transport",
    "film",
    "import",
    "render",
    "compare",
    "bench",
    "capi",
    "cli",
];

/// What the order would allow and the design does not: the cache knows no scene.
const DENIED: &[(&str, &[&str])] = &[
    ("gather", &["scene", "transport", "film", "render"]),
    ("cache", &["scene", "transport", "film", "render"]),
];

/// These see the cache as its users do: what `cache` itself exports, not its submodules.
const CACHE_USERS: &[&str] = &["compare", "bench"];

/// The modules that may hold `unsafe`.
const UNSAFE: &[&str] = &["ffi", "capi"];

/// The longest file, in lines, and the tables that may be longer.
const MAX_LINES: usize = 600;
const LONG_TABLES: &[&str] = &[];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The files under `folder` with one of these extensions, sorted, relative to the root of the
/// project.
fn files(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    fn walk(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
        let Ok(entries) = fs::read_dir(folder) else { return };
        for path in entries.map(|e| e.expect("a readable folder").path()) {
            if path.is_dir() {
                walk(&path, extensions, found);
            } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) {
                found.push(path.strip_prefix(root()).expect("inside the project").to_owned());
            }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), extensions, &mut found);
    found.sort();
    found
}

fn read(path: &Path) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A Rust source as two texts of the same length: its code with comments and literals blanked, and
/// its comments alone.
struct Source {
    code: String,
    comments: String,
}

impl Source {
    fn parse(text: &str) -> Self {
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
fn tokens(code: &str) -> Vec<String> {
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
fn paths(tree: &[String], prefix: &[String], found: &mut Vec<Vec<String>>) -> usize {
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
    i
}

/// The paths into this crate that `code` names. `depth` is that of the file's module: 1 for
/// src/x.rs and src/x/mod.rs, 2 for src/x/y.rs.
fn crate_paths(code: &str, depth: usize) -> Vec<Vec<String>> {
    let tokens = tokens(code);
    let mut found = Vec::new();
    for i in 0..tokens.len() {
        let inside_path = i > 0 && tokens[i - 1] == "::";
        if inside_path {
            continue;
        }
        if matches!(tokens[i].as_str(), "crate" | "lumicache")
            && tokens.get(i + 1).is_some_and(|t| t == "::")
        {
            paths(&tokens[i + 2..], &[], &mut found);
        } else if tokens[i] == "super" {
            let supers = tokens[i..]
                .chunks(2)
                .take_while(|c| c.len() == 2 && c[0] == "super" && c[1] == "::")
                .count();
            if supers >= depth {
                // At the top level of a file this is the crate's root; in a nested module it may
                // not be, which only a module's name tells.
                let mut relative = Vec::new();
                paths(&tokens[i + 2 * supers..], &[], &mut relative);
                found.extend(relative.into_iter().filter(|p| ORDER.contains(&p[0].as_str())));
            }
        }
    }
    found
}

/// The top-level module of a file of `src`, and the depth of the file's own module.
fn module_of(path: &Path) -> (String, usize) {
    let parts: Vec<_> = path
        .iter()
        .skip(1)
        .map(|p| p.to_string_lossy().trim_end_matches(".rs").to_owned())
        .collect();
    let depth = parts.len() - usize::from(parts.last().is_some_and(|p| p == "mod"));
    (parts[0].clone(), depth)
}

/// Why `module` may not name `path`, if so.
fn objection(module: &str, path: &[String]) -> Option<String> {
    let rank = |m: &str| ORDER.iter().position(|o| *o == m);
    let target = path[0].as_str();
    let target_rank = rank(target)?;
    if target == module {
        return None;
    }
    let own_rank = if module == "main" { ORDER.len() } else { rank(module)? };
    if target_rank > own_rank {
        return Some(format!("{module} is below {target}"));
    }
    if DENIED.iter().any(|(m, denied)| *m == module && denied.contains(&target)) {
        return Some(format!("{module} must not know {target}"));
    }
    let submodule = path
        .get(1)
        .filter(|s| target == "cache" && CACHE_USERS.contains(&module) && is_submodule(target, s));
    submodule.map(|s| format!("{s} is internal to {target}"))
}

fn is_submodule(module: &str, name: &str) -> bool {
    let folder = root().join("src").join(module);
    folder.join(format!("{name}.rs")).exists() || folder.join(name).is_dir()
}

#[test]
fn a_module_uses_only_those_below_it() {
    let mut faults = Vec::new();
    for path in files("src", &["rs"]).into_iter().filter(|p| *p != Path::new("src/lib.rs")) {
        let (module, depth) = module_of(&path);
        if module != "main" && !ORDER.contains(&module.as_str()) {
            faults
                .push(format!("{}: {module} has no place in the order of modules", path.display()));
        }
        for target in crate_paths(&Source::parse(&read(&path)).code, depth) {
            if let Some(reason) = objection(&module, &target) {
                faults.push(format!("{}: {}: {reason}", path.display(), target.join("::")));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_check_of_the_module_order_sees_every_way_to_name_a_module() {
    let code = "use crate::error::Error;\nuse crate::{film, scene::{self, SceneData}};\nfn f() { super::super::render::go(); crate::math::x() }
        // use crate::bench;\nlet s = \"crate::compare\"; let r = r#\"crate::import \" \"#; let c = '\"'; use super::light; impl<'a> X<'a> {}";
    let heads: Vec<_> =
        crate_paths(&Source::parse(code).code, 2).into_iter().map(|p| p.join("::")).collect();
    assert_eq!(
        heads,
        ["error::Error", "film", "scene::self", "scene::SceneData", "render::go", "math::x"]
    );
    let path = |p: &str| p.split("::").map(str::to_owned).collect::<Vec<_>>();
    assert!(objection("gather", &path("scene::Scene")).is_some());
    assert!(objection("math", &path("accel::Accel")).is_some());
    assert!(objection("render", &path("scene::Scene")).is_none());
    assert!(objection("main", &path("render::frame")).is_none());
}

#[test]
fn the_crate_and_the_documentation_list_the_modules_in_order() {
    let library = Source::parse(&read(Path::new("src/lib.rs"))).code;
    let declared: Vec<_> = library
        .lines()
        .filter_map(|l| l.trim().strip_prefix("pub mod ")?.strip_suffix(';'))
        .collect();
    let ordered: Vec<_> = ORDER.iter().copied().filter(|m| declared.contains(m)).collect();
    assert_eq!(declared, ordered, "src/lib.rs");
    let documented = read(Path::new("docs/ARCHITECTURE.md"));
    let rows: Vec<_> = documented
        .lines()
        .filter_map(|l| l.strip_prefix("| `")?.split('`').next())
        .filter(|m| ORDER.contains(m))
        .collect();
    assert_eq!(rows, declared, "the table of modules in docs/ARCHITECTURE.md");
}

/// The keys that `text` cites as `[Key]`, `[Key, Eq. 2]` or `[Key; Other, Sec. 3]`; markdown links
/// and quoted code are none.
fn citations(text: &str) -> Vec<String> {
    let mut keys = Vec::new();
    for (at, _) in text.match_indices('[') {
        let Some(end) = text[at..].find(']').map(|e| at + e) else { break };
        if text[end + 1..].starts_with('(') || text[..at].ends_with('`') {
            continue;
        }
        for part in text[at + 1..end].split(';') {
            let (key, place) = part.trim().split_once(',').unwrap_or((part.trim(), ""));
            let name = key
                .trim_end_matches(|c: char| c.is_ascii_lowercase())
                .trim_end_matches(|c: char| c.is_ascii_digit());
            let year = key[name.len()..].chars().take_while(char::is_ascii_digit).count();
            let plain = |s: &str| {
                s.chars().next().is_some_and(char::is_uppercase)
                    && s.chars().all(char::is_alphanumeric)
            };
            let places = [
                "Eq.",
                "Eqs.",
                "Sec.",
                "Section",
                "Fig.",
                "Alg.",
                "Algorithm",
                "Listing",
                "Table",
                "Ch.",
                "App.",
                "Appendix",
                "p.",
                "pp.",
            ];
            let located = places.iter().any(|p| place.trim_start().starts_with(p));
            if plain(key) && ((plain(name) && year == 2) || located) {
                keys.push(key.to_owned());
            }
        }
    }
    keys
}

#[test]
fn citations_are_told_from_other_brackets() {
    let text = "[Ward88] [Krivanek06, Eq. 2] [Zhao, Section 3.8; DasHazan, p. 3] [Conty18,\nSec. 4] [Error] [x, y] [Vec3] [link10](a) [0, 1] [`Schema12`] `[Key, Eq. n]`";
    assert_eq!(citations(text), ["Ward88", "Krivanek06", "Zhao", "DasHazan", "Conty18"]);
}

#[test]
fn every_citation_is_in_the_bibliography() {
    let bibliography = read(Path::new("docs/references.bib"));
    let mut entries = BTreeMap::new();
    for line in bibliography.lines().filter(|l| l.starts_with('@')) {
        let key = line
            .split_once('{')
            .and_then(|(_, k)| k.strip_suffix(','))
            .unwrap_or_else(|| panic!("docs/references.bib: {line}"));
        assert!(entries.insert(key, ()).is_none(), "docs/references.bib: {key} stands there twice");
    }
    let mut unknown = Vec::new();
    let rust = files("src", &["rs"])
        .into_iter()
        .chain(files("tests", &["rs"]).into_iter().filter(|p| !p.ends_with("architecture.rs")));
    // The slashes of a comment that goes on in the next line are no part of the citation.
    let comments = rust.map(|p| (Source::parse(&read(&p)).comments.replace(['/', '!'], " "), p));
    let prose = files("docs", &["md"]).into_iter().map(|p| (read(&p), p));
    for (text, path) in comments.chain(prose) {
        unknown.extend(
            citations(&text)
                .into_iter()
                .filter(|k| !entries.contains_key(k.as_str()))
                .map(|k| format!("{}: {k}", path.display())),
        );
    }
    assert!(unknown.is_empty(), "not in docs/references.bib:\n{}", unknown.join("\n"));
}

#[test]
fn files_are_short() {
    let sources = [("src", "rs"), ("tests", "rs"), ("scenes", "py")]
        .map(|(folder, extension)| files(folder, &[extension]));
    let tables: Vec<_> = LONG_TABLES.iter().map(Path::new).collect();
    let long: Vec<_> = sources
        .concat()
        .into_iter()
        .filter(|p| !tables.contains(&p.as_path()) && read(p).lines().count() > MAX_LINES)
        .collect();
    assert!(long.is_empty(), "longer than {MAX_LINES} lines: {long:?}");
    assert!(tables.iter().all(|t| root().join(t).exists()), "an exception for a file that is gone");
}

#[test]
fn unsafe_code_stays_where_it_belongs() {
    let mut faults = Vec::new();
    for path in files("src", &["rs"]) {
        let source = Source::parse(&read(&path));
        if !UNSAFE.contains(&module_of(&path).0.as_str())
            && tokens(&source.code).iter().any(|t| t == "unsafe")
        {
            faults.push(path);
        }
    }
    assert!(faults.is_empty(), "unsafe code outside {UNSAFE:?}: {faults:?}");
}

#[test]
fn nothing_is_left_for_later() {
    let marks = [
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("todo", "!("),
        concat!("unimpl", "emented!("),
        concat!("dbg", "!("),
    ];
    let sources = [
        files("src", &["rs"]),
        files("tests", &["rs"]),
        files("docs", &["md"]),
        files("scenes", &["py"]),
    ]
    .concat();
    let found: Vec<_> =
        sources.iter().filter(|p| marks.iter().any(|m| read(p).contains(m))).collect();
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn the_change_log_is_at_the_version_of_the_package() {
    let changes = read(Path::new("CHANGELOG.md"));
    let newest = changes.lines().find_map(|l| l.strip_prefix("## [")?.split(']').next());
    assert_eq!(newest, Some(env!("CARGO_PKG_VERSION")), "the first entry of CHANGELOG.md");
}
