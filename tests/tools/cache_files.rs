//! Cache files on the command line: saved, loaded, joined, looked into; stale and broken ones
//! refused.

use crate::support::desk::{Desk, scene};
use lumicache::cache::{PRESETS, Preset};
use lumicache::imagefile::Channel;
use serde_json::Value;
use std::collections::BTreeMap;

const SHORT: &[&str] =
    &["--size", "32x24", "--rays", "32", "--spp", "1", "--set", "levels=2", "--quiet"];

/// What the tests ask of cache files.
trait Caches {
    /// Renders one of our scenes to `out.exr`, quickly but by records on two levels.
    fn cached(&self, scene: &str, more: &[&str]);
    fn records(&self, file: &str) -> u64;
    fn bytes(&self, name: &str) -> Vec<u8>;
}

impl Caches for Desk {
    fn cached(&self, name: &str, more: &[&str]) {
        self.print(&[&["render", &scene(name), "-o", "out.exr"], SHORT, more].concat());
    }

    fn records(&self, file: &str) -> u64 {
        info(self, file)["records"].as_u64().unwrap()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }
}

fn info(desk: &Desk, file: &str) -> Value {
    serde_json::from_str(&desk.print(&["cache", "info", "--json", file])).unwrap()
}

#[test]
fn a_saved_cache_spares_the_fill_and_gives_the_same_picture() {
    let desk = Desk::new();
    desk.cached("indirect-room", &["--cache-save", "a.lumi", "--stats", "a.json"]);
    let picture = desk.bytes("out.exr");
    desk.cached(
        "indirect-room",
        &["--cache-load", "a.lumi", "--cache-save", "b.lumi", "--stats", "b.json"],
    );
    // The first fill stops at a few points that clamping had uncovered last; the second goes on
    // there.
    let (before, after) = (desk.records("a.lumi"), desk.records("b.lumi"));
    assert!(after >= before && 50 * (after - before) < before, "{before} records, then {after}");
    let stats = |name: &str| -> Value { serde_json::from_slice(&desk.bytes(name)).unwrap() };
    let rays = |name: &str| stats(name)["rays"]["gather"].as_u64().unwrap();
    assert!(
        rays("a.json") > 1000 && 20 * rays("b.json") < rays("a.json"),
        "{} and {} rays",
        rays("a.json"),
        rays("b.json")
    );
    let read = |bytes: &[u8], name: &str| {
        std::fs::write(desk.path(name), bytes).unwrap();
        lumicache::imagefile::exr::read(&desk.path(name)).unwrap().channels
    };
    let (before, after) = (read(&picture, "before.exr"), read(&desk.bytes("out.exr"), "after.exr"));
    for (a, b) in
        before.iter().zip(&after).filter(|(a, _)| ["R", "G", "B"].contains(&a.name.as_str()))
    {
        let difference: f32 = a.samples.iter().zip(&b.samples).map(|(x, y)| (x - y).abs()).sum();
        assert!(
            difference < 0.01 * a.samples.iter().sum::<f32>(),
            "{}: the picture is another one",
            a.name
        );
    }
}

#[test]
fn a_file_of_any_preset_gives_the_same_picture_bit_for_bit() {
    let desk = Desk::new();
    let room = scene("cornell-box-glossy");
    for Preset { name, .. } in PRESETS.iter() {
        let render = |files: &[&str]| {
            let quick = ["--quality", "0.02", "--size", "16x12", "--spp", "1", "--denoise", "off"];
            let what = ["render", &room, "-o", "out.exr", "--quiet", "--preset", name];
            desk.print(&[&what[..], &quick, files].concat());
            let channels = lumicache::imagefile::exr::read(&desk.path("out.exr")).unwrap().channels;
            let bits = |c: Channel| (c.name, c.samples.into_iter().map(f32::to_bits).collect());
            channels.into_iter().map(bits).collect::<BTreeMap<String, Vec<u32>>>()
        };
        let first = render(&["--cache-save", "a.lumi"]);
        let loaded = render(&["--cache-load", "a.lumi", "--cache-save", "b.lumi"]);
        assert!(desk.records("a.lumi") > 100, "{name} has nothing to load");
        assert_eq!(desk.records("a.lumi"), desk.records("b.lumi"), "{name}");
        // The one pass of ward88 shows each pixel by the records up to then: with a file, by all.
        let wanted = if name == "ward88" { render(&["--cache-load", "b.lumi"]) } else { first };
        let differ: Vec<_> = wanted.keys().filter(|k| wanted.get(*k) != loaded.get(*k)).collect();
        assert!(differ.is_empty() && wanted.len() == loaded.len(), "{name}: {differ:?} differ");
    }
}

#[test]
fn caches_of_two_views_are_joined() {
    let desk = Desk::new();
    // Two halves of the picture, each filled by itself, as two machines would.
    desk.cached(
        "indirect-room",
        &["--crop", "0,0,16,24", "--prepass-only", "--cache-save", "left.lumi"],
    );
    assert!(!desk.path("out.exr").exists(), "a prepass writes no picture");
    desk.cached(
        "indirect-room",
        &["--crop", "16,0,32,24", "--prepass-only", "--cache-save", "right.lumi"],
    );
    desk.print(&["cache", "merge", "-o", "both.lumi", "left.lumi", "right.lumi"]);
    let [left, right, both] = ["left.lumi", "right.lumi", "both.lumi"].map(|f| desk.records(f));
    assert!(both > left.max(right) && both <= left + right, "{left} and {right} make {both}");
    desk.print(&["cache", "merge", "-o", "again.lumi", "both.lumi", "left.lumi", "right.lumi"]);
    assert!(
        desk.bytes("again.lumi") == desk.bytes("both.lumi"),
        "joining what is there changes something"
    );
    desk.cached(
        "indirect-room",
        &["--cache-load", "left.lumi", "--cache-load", "right.lumi", "--cache-save", "whole.lumi"],
    );
    assert!(desk.records("whole.lumi") >= both);

    let csv = desk.print(&["cache", "dump", "both.lumi"]);
    assert_eq!(csv.lines().count() as u64, both + 1);
    assert!(csv.lines().all(|l| l.split(',').count() == 14));
    let list: Value =
        serde_json::from_str(&desk.print(&["cache", "dump", "both.lumi", "--format", "json"]))
            .unwrap();
    assert_eq!(list.as_array().unwrap().len() as u64, both);
    assert!(
        list[0]["position"].as_array().unwrap().len() == 3
            && list[0]["length"].as_f64().unwrap() > 0.0
    );
    let ply = desk.print(&["cache", "dump", "both.lumi", "--format", "ply"]);
    assert!(
        ply.starts_with("ply\nformat ascii 1.0\n")
            && ply.contains(&format!("element vertex {both}\n"))
    );
    let info = desk.print(&["cache", "info", "both.lumi"]);
    assert!(
        ["geometry", "materials", "lights", "max bounces  unlimited", "rays"]
            .iter()
            .all(|w| info.contains(w)),
        "{info}"
    );
}

#[test]
fn stale_and_broken_files_are_refused_each_in_its_own_words() {
    let desk = Desk::new();
    let (room, cornell) = (scene("indirect-room"), scene("cornell-box"));
    let (room, cornell) = (room.as_str(), cornell.as_str());
    desk.cached("indirect-room", &["--prepass-only", "--cache-save", "a.lumi"]);
    let with = |scene, more: &[&'static str]| {
        [&["render", scene], SHORT, &["--cache-load", "a.lumi"], more].concat()
    };
    desk.fail(&with(cornell, &[]), &["a.lumi", "another scene", "geometry"]);
    desk.fail(&with(room, &["--error", "0.7"]), &["a.lumi", "other settings", "error"]);
    desk.fail(&with(room, &["--max-bounces", "3"]), &["a.lumi", "3"]);
    desk.fail(&with(room, &["--integrator", "path"]), &["--integrator cache"]);
    desk.print(&[&with(room, &["--error", "0.7", "--cache-reuse", "-o", "out.exr"])[..]].concat());
    desk.cached("cornell-box", &["--prepass-only", "--cache-save", "c.lumi"]);
    desk.fail(
        &["cache", "merge", "-o", "d.lumi", "a.lumi", "c.lumi"],
        &["c.lumi", "another scene"],
    );
    assert!(!desk.path("d.lumi").exists());

    let whole = desk.bytes("a.lumi");
    std::fs::write(desk.path("a.lumi"), &whole[..whole.len() / 2]).unwrap();
    desk.fail(&with(room, &[]), &["a.lumi", "cut short"]);
    std::fs::write(desk.path("a.lumi"), "nothing").unwrap();
    desk.fail(&with(room, &[]), &["a.lumi", "not a cache file"]);
    desk.fail(&["cache", "info", "none.lumi"], &["none.lumi"]);
    assert_eq!(
        desk.run(&[&["render", room], SHORT, &["--cache-reuse"]].concat()).status.code(),
        Some(2)
    );
}

/// A cache file taken apart, to be put together with a sound checksum.
struct Parts {
    head: Vec<u8>,
    header: Value,
    data: Vec<u8>,
}

impl Parts {
    fn of(bytes: &[u8]) -> Self {
        let length = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
        let (head, rest) = (bytes[..16].to_vec(), &bytes[24..bytes.len() - 32]);
        let header = serde_json::from_slice(&rest[..length]).unwrap();
        Self { head, header, data: rest[length..].to_vec() }
    }

    fn bytes(&self) -> Vec<u8> {
        let header = self.header.to_string().into_bytes();
        let length = (header.len() as u64).to_le_bytes();
        let mut bytes = [&self.head[..], &length, &header, &self.data].concat();
        bytes.extend(blake3::hash(&bytes).as_bytes());
        bytes
    }

    /// Puts `value` in the place of the first bytes of the second record of level 0.
    fn set(&mut self, column: &str, value: &[u8]) {
        let columns = self.header["levels"][0]["columns"].as_array().unwrap();
        let column = columns.iter().find(|c| c["name"] == column).unwrap();
        let number = |key: &str| column[key].as_u64().unwrap() as usize;
        let at = number("offset") + number("bytes");
        self.data[at..at + value.len()].copy_from_slice(value);
    }
}

#[test]
fn every_column_has_a_range_that_a_sound_checksum_does_not_excuse() {
    let desk = Desk::new();
    desk.cached("indirect-room", &["--prepass-only", "--cache-save", "a.lumi"]);
    let whole = desk.bytes("a.lumi");
    let write = |column: &str, value: &[u8]| {
        let mut parts = Parts::of(&whole);
        parts.set(column, value);
        std::fs::write(desk.path("b.lumi"), parts.bytes()).unwrap();
    };
    write("position", &[]);
    desk.print(&["cache", "info", "b.lumi"]);
    let (inf, nan) = (f32::INFINITY, f32::NAN);
    for (column, values) in [
        ("position", &[inf, nan, 3e38, -2e18][..]),
        ("normal", &[2.0, nan]),
        ("irradiance", &[-1.0, inf, nan, 2e18]),
        ("rotation", &[inf, nan]),
        ("translation", &[inf, nan]),
        ("length_unclamped", &[-1.0, nan]),
        ("error", &[0.0, -0.1, 1e-40, inf, nan]),
        ("footprint", &[0.0, -1.0, 1e-40, inf, nan, 3e38]),
        ("sigma", &[-1.0, nan]),
    ] {
        for value in values {
            write(column, &value.to_le_bytes());
            desk.fail(&["cache", "info", "b.lumi"], &["b.lumi", column, "record 1"]);
        }
    }
    for count in [0_u32, 3, 9, u32::MAX] {
        write("shape", &count.to_le_bytes());
        desk.fail(&["cache", "info", "b.lumi"], &["b.lumi", "shape"]);
    }
    write("fences", &5_u32.to_le_bytes());
    desk.fail(&["cache", "info", "b.lumi"], &["b.lumi", "fences"]);
    // An error above the scheme's makes a record valid everywhere.
    write("error", &3e38_f32.to_le_bytes());
    let load = ["render", &scene("indirect-room"), "-o", "out.exr", "--cache-load", "b.lumi"];
    desk.fail(&[&load[..], SHORT].concat(), &["b.lumi", "error"]);
    desk.print(&[&load[..], SHORT, &["--cache-reuse", "--error", "0.5"]].concat());
}

#[test]
fn headers_that_ask_for_more_than_the_file_holds_are_refused() {
    let desk = Desk::new();
    desk.cached("indirect-room", &["--prepass-only", "--cache-save", "a.lumi"]);
    let whole = desk.bytes("a.lumi");
    let fail = |change: &dyn Fn(&mut Parts), words: &str| {
        let mut parts = Parts::of(&whole);
        change(&mut parts);
        std::fs::write(desk.path("b.lumi"), parts.bytes()).unwrap();
        desk.fail(&["cache", "info", "b.lumi"], &["b.lumi", words]);
    };
    let repeat = |levels: usize| {
        move |parts: &mut Parts| {
            let level = parts.header["levels"][0].clone();
            parts.header["levels"] = vec![level; levels].into();
        }
    };
    fail(&repeat(2), "overlap");
    fail(&repeat(1000), "overlap");
    fail(&repeat(40_000), "header is longer");
    fail(&|parts| parts.header["levels"][0]["records"] = (1_u64 << 60).into(), "columns");
    fail(&|parts| parts.header["levels"][0]["records"] = u64::MAX.into(), "columns");
    fail(&|parts| parts.header["levels"][0]["records"] = 0.into(), "columns");
    fail(&|parts| parts.header["levels"][0]["columns"] = Value::Array(vec![]), "columns");
    fail(&|parts| parts.header["levels"][0]["columns"][0]["offset"] = u64::MAX.into(), "columns");
    for extent in [0.0, -1.0, 1e-45, 3e38] {
        fail(&|parts| parts.header["extent"] = extent.into(), "extent");
    }
    fail(&|parts| parts.data.extend([0; 9]), "longer");
    fail(&|parts| parts.data.truncate(parts.data.len() - 1), "cut short");
    // A level without records asks for nothing.
    let mut parts = Parts::of(&whole);
    let columns = parts.header["levels"][0]["columns"].clone();
    let empty = serde_json::json!({"records": 0, "columns": columns});
    parts.header["levels"].as_array_mut().unwrap().push(empty);
    std::fs::write(desk.path("b.lumi"), parts.bytes()).unwrap();
    desk.print(&["cache", "info", "b.lumi"]);
}
