//! Cache files on the command line: saved, loaded, joined, looked into; stale and broken ones refused.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

const QUICK: &[&str] = &["--size", "32x24", "--rays", "32", "--spp", "1", "--set", "levels=2", "--quiet"];

struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lumicache"));
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null()).output().unwrap()
    }

    #[track_caller]
    fn print(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    #[track_caller]
    fn fail(&self, arguments: &[&str], words: &[&str]) {
        let output = self.run(arguments);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {error}");
        assert!(error.lines().count() == 1 && words.iter().all(|w| error.contains(w)), "{error} does not say {words:?}");
    }

    fn render(&self, scene: &str, more: &[&str]) {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{scene}.gltf"));
        self.print(&[&["render", scene.to_str().unwrap(), "-o", "out.exr"], QUICK, more].concat());
    }

    fn json(&self, arguments: &[&str]) -> Value {
        serde_json::from_str(&self.print(arguments)).unwrap()
    }

    fn records(&self, file: &str) -> u64 {
        self.json(&["cache", "info", "--json", file])["records"].as_u64().unwrap()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }
}

#[test]
fn a_saved_cache_spares_the_fill_and_gives_the_same_picture() {
    let desk = Desk::new();
    desk.render("indirect-room", &["--cache-save", "a.lumi", "--stats", "a.json"]);
    let picture = desk.bytes("out.exr");
    desk.render("indirect-room", &["--cache-load", "a.lumi", "--cache-save", "b.lumi", "--stats", "b.json"]);
    // The first fill stops at a few points that clamping had uncovered last; the second goes on there.
    let (before, after) = (desk.records("a.lumi"), desk.records("b.lumi"));
    assert!(after >= before && 50 * (after - before) < before, "{before} records, then {after}");
    let stats = |name: &str| -> Value { serde_json::from_slice(&desk.bytes(name)).unwrap() };
    let rays = |name: &str| stats(name)["rays"]["gather"].as_u64().unwrap();
    assert!(rays("a.json") > 1000 && 20 * rays("b.json") < rays("a.json"), "{} and {} rays", rays("a.json"), rays("b.json"));
    let read = |bytes: &[u8], name: &str| {
        std::fs::write(desk.path(name), bytes).unwrap();
        lumicache::imagefile::exr::read(&desk.path(name)).unwrap().channels
    };
    let (before, after) = (read(&picture, "before.exr"), read(&desk.bytes("out.exr"), "after.exr"));
    for (a, b) in before.iter().zip(&after).filter(|(a, _)| ["R", "G", "B"].contains(&a.name.as_str())) {
        let difference: f32 = a.samples.iter().zip(&b.samples).map(|(x, y)| (x - y).abs()).sum();
        assert!(difference < 0.01 * a.samples.iter().sum::<f32>(), "{}: the picture is another one", a.name);
    }
}

#[test]
fn caches_of_two_views_are_joined() {
    let desk = Desk::new();
    // Two halves of the picture, each filled by itself, as two machines would.
    desk.render("indirect-room", &["--crop", "0,0,16,24", "--prepass-only", "--cache-save", "left.lumi"]);
    assert!(!desk.path("out.exr").exists(), "a prepass writes no picture");
    desk.render("indirect-room", &["--crop", "16,0,32,24", "--prepass-only", "--cache-save", "right.lumi"]);
    desk.print(&["cache", "merge", "-o", "both.lumi", "left.lumi", "right.lumi"]);
    let [left, right, both] = ["left.lumi", "right.lumi", "both.lumi"].map(|f| desk.records(f));
    assert!(both > left.max(right) && both <= left + right, "{left} and {right} make {both}");
    desk.print(&["cache", "merge", "-o", "again.lumi", "both.lumi", "left.lumi", "right.lumi"]);
    assert!(desk.bytes("again.lumi") == desk.bytes("both.lumi"), "joining what is there changes something");
    desk.render("indirect-room", &["--cache-load", "left.lumi", "--cache-load", "right.lumi", "--cache-save", "whole.lumi"]);
    assert!(desk.records("whole.lumi") >= both);

    let csv = desk.print(&["cache", "dump", "both.lumi"]);
    assert_eq!(csv.lines().count() as u64, both + 1);
    assert!(csv.lines().all(|l| l.split(',').count() == 14));
    let list = desk.json(&["cache", "dump", "both.lumi", "--format", "json"]);
    assert_eq!(list.as_array().unwrap().len() as u64, both);
    assert!(list[0]["position"].as_array().unwrap().len() == 3 && list[0]["length"].as_f64().unwrap() > 0.0);
    let ply = desk.print(&["cache", "dump", "both.lumi", "--format", "ply"]);
    assert!(ply.starts_with("ply\nformat ascii 1.0\n") && ply.contains(&format!("element vertex {both}\n")));
    let info = desk.print(&["cache", "info", "both.lumi"]);
    assert!(["geometry", "materials", "lights", "max bounces  unlimited", "rays"].iter().all(|w| info.contains(w)), "{info}");
}

#[test]
fn stale_and_broken_files_are_refused_each_in_its_own_words() {
    let desk = Desk::new();
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/indirect-room.gltf");
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.gltf");
    let (room, cornell) = (room.to_str().unwrap(), cornell.to_str().unwrap());
    desk.render("indirect-room", &["--prepass-only", "--cache-save", "a.lumi"]);
    let with = |scene, more: &[&'static str]| [&["render", scene], QUICK, &["--cache-load", "a.lumi"], more].concat();
    desk.fail(&with(cornell, &[]), &["a.lumi", "another scene", "geometry"]);
    desk.fail(&with(room, &["--error", "0.7"]), &["a.lumi", "other settings", "error"]);
    desk.fail(&with(room, &["--max-bounces", "3"]), &["a.lumi", "3"]);
    desk.fail(&with(room, &["--integrator", "path"]), &["--integrator cache"]);
    desk.print(&[&with(room, &["--error", "0.7", "--cache-reuse", "-o", "out.exr"])[..]].concat());
    desk.render("cornell-box", &["--prepass-only", "--cache-save", "c.lumi"]);
    desk.fail(&["cache", "merge", "-o", "d.lumi", "a.lumi", "c.lumi"], &["c.lumi", "another scene"]);
    assert!(!desk.path("d.lumi").exists());

    let whole = desk.bytes("a.lumi");
    std::fs::write(desk.path("a.lumi"), &whole[..whole.len() / 2]).unwrap();
    desk.fail(&with(room, &[]), &["a.lumi", "checksum"]);
    std::fs::write(desk.path("a.lumi"), "nothing").unwrap();
    desk.fail(&with(room, &[]), &["a.lumi", "not a cache file"]);
    desk.fail(&["cache", "info", "none.lumi"], &["none.lumi"]);
    assert_eq!(desk.run(&[&["render", room], QUICK, &["--cache-reuse"]].concat()).status.code(), Some(2));
}
