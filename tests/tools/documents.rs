//! The commands in the documents do what they say: every block that is fenced as `sh` runs as
//! written, the blocks of a document one after the other in a folder with a copy of scenes/. What
//! needs a host, the network or minutes is fenced as `console` or `text` and does not run.

use crate::support::source::{documents, read, root};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// A block of code: its line, what its fence says, its text. Blocks by indentation say nothing.
struct Block {
    line: usize,
    tag: String,
    text: String,
}

fn blocks(text: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut fenced = false;
    let mut after_blank = true;
    for (i, line) in text.lines().enumerate() {
        if let Some(tag) = line.trim_start().strip_prefix("```") {
            fenced = !fenced;
            if fenced {
                found.push(Block { line: i + 1, tag: tag.trim().to_owned(), text: String::new() });
            }
        } else if fenced {
            let block = found.last_mut().expect("a fence opened it");
            block.text += &format!("{line}\n");
        } else if after_blank && line.starts_with("    ") {
            found.push(Block { line: i + 1, tag: String::new(), text: format!("{line}\n") });
        }
        after_blank = line.trim().is_empty() || (after_blank && line.starts_with("    "));
    }
    found
}

/// The fences that say whether a block runs.
const TAGS: [&str; 3] = ["sh", "console", "text"];

#[test]
fn commands_in_documents_say_by_their_fence_whether_they_run() {
    let mut faults = Vec::new();
    for path in documents() {
        for block in blocks(&read(&path)) {
            let command = block.text.lines().any(|l| l.trim_start().starts_with("lumicache "));
            if command && !TAGS.contains(&block.tag.as_str()) {
                faults.push(format!(
                    "{}:{}: fenced as `{}`",
                    path.display(),
                    block.line,
                    block.tag
                ));
            }
        }
    }
    assert!(faults.is_empty(), "neither run nor marked:\n{}", faults.join("\n"));
}

#[test]
fn every_command_of_the_documents_runs_as_written() {
    let program = Path::new(env!("CARGO_BIN_EXE_lumicache")).parent().expect("a folder");
    let path = std::env::var("PATH").unwrap_or_default();
    let mut faults = Vec::new();
    for document in documents() {
        let desk = tempfile::tempdir().expect("a folder");
        let scenes = desk.path().join("scenes");
        fs::create_dir(&scenes).expect("a folder");
        for entry in fs::read_dir(root().join("scenes")).expect("our scenes") {
            let from = entry.expect("a file").path();
            if from.is_file() {
                fs::copy(&from, scenes.join(from.file_name().expect("a name"))).expect("a copy");
            }
        }
        for block in blocks(&read(&document)).into_iter().filter(|b| b.tag == "sh") {
            let start = Instant::now();
            let output = Command::new("bash")
                .args(["-euo", "pipefail", "-c", &block.text])
                .env("PATH", format!("{}:{path}", program.display()))
                .current_dir(desk.path())
                .stdin(Stdio::null())
                .output()
                .expect("bash");
            let place = format!("{}:{}", document.display(), block.line);
            println!("{place}: {:.1} s", start.elapsed().as_secs_f64());
            if !output.status.success() {
                let message = String::from_utf8_lossy(&output.stderr);
                faults.push(format!("{place}:\n{}{message}", block.text));
            }
        }
    }
    assert!(faults.is_empty(), "commands that fail:\n{}", faults.join("\n"));
}

#[test]
fn blocks_are_found_by_fence_and_by_indentation() {
    let text = "a\n\n    lumicache x\n    y\n\n```sh\nlumicache y \\\n    z\n```\n- b\n    c\n";
    let found: Vec<_> = blocks(text).into_iter().map(|b| (b.line, b.tag, b.text)).collect();
    let expected =
        [(3, "", "    lumicache x\n"), (4, "", "    y\n"), (6, "sh", "lumicache y \\\n    z\n")];
    assert_eq!(found, expected.map(|(l, tag, text)| (l, tag.to_owned(), text.to_owned())));
}
