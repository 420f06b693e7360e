//! What the documents and the comments say: citations, file names, widths, versions.

use crate::support::source::{Source, documents, files, read, root};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The longest line of prose, comments, TOML and scripts, in columns.
const MAX_COLUMNS: usize = 100;

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

/// Folders that the project makes, and a file of the optional test data.
const UNTRACKED: &[&str] = &["target/", "out/", "fuzz/artifacts/"];
const TEST_DATA: &str = "scenes/MANIFEST.tsv";

/// The lines of a Markdown file that are prose, with their numbers: neither code nor tables.
fn prose_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fenced = false;
    text.lines().enumerate().map(|(i, line)| (i + 1, line)).filter(move |(_, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence && !line.starts_with('|')
    })
}

#[test]
fn prose_and_comments_end_at_100_columns() {
    let mut faults = BTreeMap::<PathBuf, Vec<usize>>::new();
    let mut check = |path: &Path, number: usize, line: &str| {
        let combining = |c: &char| ('\u{300}'..'\u{370}').contains(c);
        if line.chars().filter(|c| !combining(c)).count() > MAX_COLUMNS
            && !line.contains("https://")
        {
            faults.entry(path.to_owned()).or_default().push(number);
        }
    };
    for path in documents() {
        prose_lines(&read(&path)).for_each(|(number, line)| check(&path, number, line));
    }
    for path in ["src", "tests", "benches", "fuzz"].map(|folder| files(folder, &["rs"])).concat() {
        let text = read(&path);
        let comments = Source::parse(&text).comments;
        for (i, (line, comment)) in text.lines().zip(comments.lines()).enumerate() {
            let words = comment.trim().trim_start_matches(['/', '!', ' ']);
            if !words.is_empty() && !words.starts_with('|') {
                check(&path, i + 1, line);
            }
        }
    }
    let named = ["Makefile", "Cargo.toml", "rustfmt.toml", ".cargo/config.toml"].map(PathBuf::from);
    let scripts = [files(".ci", &[""]), files("ffi", &["sh", ""]), files("src", &["toml"])];
    for path in scripts.concat().into_iter().chain(named) {
        for (i, line) in read(&path).lines().enumerate().filter(|(_, l)| l.trim().starts_with('#'))
        {
            check(&path, i + 1, line);
        }
    }
    let list: Vec<_> =
        faults.iter().map(|(p, lines)| format!("{}: {lines:?}", p.display())).collect();
    assert!(list.is_empty(), "wider than {MAX_COLUMNS} columns, lines\n{}", list.join("\n"));
}

/// What `text` names in backticks, and the targets of its links, outside blocks of code.
fn names(text: &str) -> Vec<String> {
    let prose: String = prose_and_tables(text);
    let quoted = prose.split('`').skip(1).step_by(2).map(str::to_owned);
    let linked = prose.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0));
    let linked = linked.filter(|l| !l.contains("://") && !l.starts_with('#'));
    quoted.chain(linked.map(|l| format!("./{}", l.split('#').next().unwrap_or(l)))).collect()
}

/// Everything outside blocks of code.
fn prose_and_tables(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// Whether `name`, which a document in `folder` names, is a file that is missing. A name that
/// starts with a folder of the project, or with a module of src, is taken for a file's; what has
/// blanks, capitals that stand for a name, or braces is none.
fn is_missing(name: &str, folder: &Path) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-/".contains(c);
    if name.starts_with("./") || name.starts_with("../") {
        return !root().join(folder).join(name).exists();
    }
    let Some((first, _)) = name.split_once('/') else { return false };
    if !name.chars().all(plain) || name.contains("NAME") || name == TEST_DATA || first.is_empty() {
        return false;
    }
    let source = root().join("src").join(name);
    let module = root().join("src").join(first).is_dir() && first != "bench";
    let made = UNTRACKED.iter().any(|folder| name.starts_with(folder));
    let of_project = root().join(first).is_dir() && !made;
    (of_project || module)
        && !root().join(name).exists()
        && !source.exists()
        && !source.with_extension("rs").exists()
}

#[test]
fn the_files_that_documents_name_exist() {
    let mut faults = Vec::new();
    for path in documents() {
        let folder = path.parent().expect("a folder");
        for name in names(&read(&path)).into_iter().filter(|n| is_missing(n, folder)) {
            faults.push(format!("{}: {name}", path.display()));
        }
    }
    assert!(faults.is_empty(), "documents name files that are not there:\n{}", faults.join("\n"));
}

#[test]
fn names_of_files_are_told_from_other_words() {
    let text = "`src/no.rs` [a](no.md#b) [c](https://x/y) `a/b` `src/main.rs` `cache/NAME.toml`
        `cache/no` `film`\n```sh\n`src/never.rs`\n```\n";
    let missing: Vec<_> =
        names(text).into_iter().filter(|n| is_missing(n, Path::new("docs"))).collect();
    assert_eq!(missing, ["src/no.rs", "cache/no", "./no.md"]);
}
