//! The C header is what the source says, and every function of it goes through the guard.

use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The files of `src/capi` that declare what C sees, in the order of the header.
fn sources() -> Vec<PathBuf> {
    let structs = ["abi/common", "abi/scene", "abi/cache"];
    let functions =
        ["status", "device", "scene", "load", "cache", "records", "query", "build", "render"];
    let names = structs.iter().chain(&functions);
    names.map(|n| root().join(format!("src/capi/{n}.rs"))).collect()
}

const INTRODUCTION: &str = "\
/* lumicache.h - global illumination by caching, for other renderers. C99 and C++17.
   docs/CAPI.md is the manual. cbindgen makes this file from the source: `make header` writes it.

   ERRORS   A function returns LUMI_OK or a LUMI_ERROR_* code; lumi_get_last_error has the text, per
            thread. Failures of functions without a result are found there, too.
   HANDLES  are reference counted. Release what a *_new function gave. The library finds out
            released handles, handles of another kind and NULL; release(NULL) does nothing.
   THREADS  \"any\": any number of threads at once. \"one per X\": calls for the same X must not
            overlap; where they do, one of them may fail with LUMI_ERROR_INVALID_OPERATION, but
            nothing breaks.
   MEMORY   Arrays belong to the caller. The library reads or writes them during the call and keeps
            no pointer, but for LUMI_VIEW_SHARED and `user` pointers.
   STRUCTS  begin with their size: set struct_size, and zero what you do not use.
   UNITS    are the host's; light is linear Rec. 709. Directions point away from the surface. */
";

fn generate() -> String {
    let mut config = cbindgen::Config {
        language: cbindgen::Language::C,
        header: Some(INTRODUCTION.trim_end().into()),
        include_guard: Some("LUMICACHE_H".into()),
        cpp_compat: true,
        documentation_style: cbindgen::DocumentationStyle::C99,
        style: cbindgen::Style::Both,
        line_length: 100,
        no_includes: true,
        sys_includes: vec!["stddef.h".into(), "stdint.h".into()],
        usize_is_size_t: true,
        ..Default::default()
    };
    config.function.prefix = Some("LUMI_API".into());
    config.after_includes = Some(
        "\n#ifndef LUMI_API\n# if defined(__GNUC__)\n#  define LUMI_API __attribute__((visibility(\"default\")))\n# else\n#  define LUMI_API\n# endif\n#endif"
            .into(),
    );
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in sources() {
        builder = builder.with_src(source);
    }
    let mut text = Vec::new();
    builder.generate().unwrap_or_else(|e| panic!("{e}")).write(&mut text);
    String::from_utf8(text).unwrap()
}

#[test]
fn the_header_is_what_the_source_says() {
    let path = root().join("ffi/include/lumicache.h");
    let header = generate();
    if std::env::var_os("LUMICACHE_WRITE_HEADER").is_some() {
        std::fs::write(&path, &header).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == header, "{} is out of date: run `make header`", path.display());
}

/// The names of the functions that `header` declares, sorted.
pub fn declared(header: &str) -> Vec<String> {
    let code: String = header
        .lines()
        .filter(|l| !l.trim_start().starts_with("//"))
        .flat_map(|l| [l, "\n"])
        .collect();
    let mut names: Vec<String> = code
        .split("LUMI_API")
        .filter_map(|rest| {
            rest.split_once('(')?.0.split([' ', '*', '\n']).next_back().map(str::to_owned)
        })
        .filter(|n| n.starts_with("lumi_"))
        .collect();
    names.sort_unstable();
    names
}

/// The exported functions, each with its name and the text of its body.
fn exported(source: &str) -> Vec<(String, String)> {
    source
        .split("#[unsafe(no_mangle)]")
        .skip(1)
        .map(|rest| {
            let name = rest.split("fn ").nth(1).unwrap().split('(').next().unwrap().to_owned();
            let body = rest.split_once("{\n").unwrap().1.split("\n}\n").next().unwrap().to_owned();
            (name, body)
        })
        .collect()
}

#[test]
fn every_exported_function_goes_through_the_guard() {
    let header = generate();
    let mut functions = Vec::new();
    let folders = ["src/capi", "src/capi/abi", "src/capi/handles"].map(|f| root().join(f));
    for entry in folders.iter().flat_map(|f| std::fs::read_dir(f).unwrap()) {
        let path = entry.unwrap().path();
        if path.is_dir() {
            assert!(folders.contains(&path), "{path:?} is not searched");
            continue;
        }
        let source = std::fs::read_to_string(&path).unwrap();
        let has_functions = sources().contains(&path) && path.parent() == Some(&folders[0]);
        assert_eq!(source.contains("extern \"C\" fn lumi_"), has_functions, "{path:?}");
        functions.extend(exported(&source));
    }
    assert!(functions.len() > 30);
    for (name, body) in &functions {
        assert!(
            name.starts_with("lumi_") && header.contains(&format!("{name}(")),
            "{name} is not in the header"
        );
        // Nothing but plain declarations stands outside the guard, which is given the function's
        // own name.
        let before: Vec<_> =
            body.lines().take_while(|l| !l.contains(&format!("(\"{name}\", "))).collect();
        assert!(before.len() < body.lines().count(), "{name} has no guard of its name");
        let plain = |l: &str| {
            l.trim().starts_with("let mut ")
                || l.trim().starts_with("const ")
                || l.contains("=> ")
                || l.trim() == "};"
        };
        assert!(
            before.iter().all(|l| plain(l)),
            "{name} does something before its guard: {before:?}"
        );
        let guard = body.lines().find(|l| l.contains(&format!("(\"{name}\", "))).unwrap().trim();
        assert!(guard.starts_with("guard(") || guard.starts_with("guard_void("), "{name}: {guard}");
    }
    // The scan sees a function without a guard.
    assert_eq!(
        exported("#[unsafe(no_mangle)]\npub extern \"C\" fn lumi_x(a: u32) {\n    a + 1;\n}\n")[0]
            .1,
        "    a + 1;"
    );
}

#[test]
fn every_function_says_from_which_threads_it_may_be_called() {
    let header = generate();
    assert_eq!(declared(&header).len(), header.matches("\nLUMI_API").count());
    let mut comment = String::new();
    for line in header.lines() {
        if let Some(text) = line.strip_prefix("//") {
            comment += text;
        } else {
            if line.starts_with("LUMI_API") {
                assert!(comment.contains("Threads: "), "{line}");
            }
            comment.clear();
        }
    }
}
