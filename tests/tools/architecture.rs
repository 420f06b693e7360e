//! The structure of the source: the order of modules and of files, file sizes, and where `unsafe`
//! may stand.

use crate::support::source::{Source, files, paths, read, root, tokens};
use std::path::Path;

/// The modules of `src`, bottom to top: a module may use only those before it.
const ORDER: &[&str] = &[
    "error",
    "progress",
    "fsutil",
    "words",
    "math",
    "sampling",
    "basis",
    "geometry",
    "ffi",
    "imagefile",
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
    "hosted",
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

/// The longest file, in lines.
const MAX_LINES: usize = 500;

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

#[test]
fn files_are_short() {
    let sources = ["src", "tests", "benches"].map(|folder| files(folder, &["rs"]));
    let long: Vec<_> =
        sources.concat().into_iter().filter(|p| read(p).lines().count() > MAX_LINES).collect();
    assert!(long.is_empty(), "longer than {MAX_LINES} lines: {long:?}");
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
