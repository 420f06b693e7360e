//! Disks, devices, links, limits and signals.

use crate::support::desk::{Desk, QUICK, scene, text};
use nix::sys::signal::{Signal, kill};
use nix::sys::stat::Mode;
use nix::unistd::{Pid, mkfifo};
use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A desk with a scene of two files, a map, a preset and a cache file.
fn furnished() -> Desk {
    let desk = Desk::new();
    for name in ["cornell-box.gltf", "cornell-box.bin"] {
        fs::copy(scene("cornell-box").replace("cornell-box.gltf", name), desk.path(name)).unwrap();
    }
    let map = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x80\x80\x80\x81";
    fs::write(desk.path("map.hdr"), map).unwrap();
    fs::write(desk.path("mine.toml"), "base = \"auto\"\nlevels = 1\n").unwrap();
    let save = ["--prepass-only", "--cache-save", "old.lumi", "--preset", "mine.toml"];
    desk.print(&[&["render", "cornell-box.gltf"], QUICK, &save].concat());
    desk
}

/// The arguments of a quick render that reads all files of a [`furnished`] desk.
const RENDER: &[&str] = &[
    "render",
    "cornell-box.gltf",
    "--env",
    "map.hdr",
    "--cache-load",
    "old.lumi",
    "--cache-reuse",
    "--preset",
    "mine.toml",
    "--spp",
    "1",
    "--quiet",
];

#[test]
fn no_output_takes_the_place_of_an_input() {
    let desk = furnished();
    for input in ["cornell-box.gltf", "cornell-box.bin", "map.hdr", "old.lumi", "mine.toml"] {
        symlink(input, desk.path("soft.exr")).unwrap();
        fs::hard_link(desk.path(input), desk.path("hard.exr")).unwrap();
        let before = fs::read(desk.path(input)).unwrap();
        for flag in ["-o", "--preview", "--cache-save", "--stats"] {
            for name in [input, "soft.exr", "hard.exr"] {
                // Some names are refused because no such output is written.
                let arguments = [RENDER, QUICK, &["-o", "out.exr"][..], &[flag, name]].concat();
                let arguments =
                    if flag == "-o" { [RENDER, QUICK, &[flag, name]].concat() } else { arguments };
                desk.fail(&arguments, &[name]);
                assert_eq!(fs::read(desk.path(input)).unwrap(), before, "{flag} {name}");
            }
        }
        fs::remove_file(desk.path("soft.exr")).unwrap();
        fs::remove_file(desk.path("hard.exr")).unwrap();
    }
    // The same records under another name are fine.
    desk.print(&[RENDER, QUICK, &["--cache-save", "new.lumi"]].concat());
}

#[test]
fn what_merge_compare_and_report_write_is_not_what_they_read() {
    let desk = furnished();
    fs::copy(desk.path("old.lumi"), desk.path("second.lumi")).unwrap();
    symlink("old.lumi", desk.path("soft.lumi")).unwrap();
    fs::hard_link(desk.path("old.lumi"), desk.path("hard.lumi")).unwrap();
    let before = fs::read(desk.path("old.lumi")).unwrap();
    for output in ["old.lumi", "./old.lumi", "soft.lumi", "hard.lumi"] {
        for files in [["old.lumi", "second.lumi"], ["second.lumi", "old.lumi"]] {
            let merge = [&["cache", "merge", "-o", output], &files[..]].concat();
            desk.fail(&merge, &[output, "input"]);
            assert_eq!(fs::read(desk.path("old.lumi")).unwrap(), before, "{output} {files:?}");
        }
    }
    desk.print(&["cache", "merge", "-o", "third.lumi", "old.lumi", "second.lumi"]);
    // What stands there and is no input is replaced.
    desk.print(&["cache", "merge", "-o", "third.lumi", "old.lumi"]);

    desk.print(&[RENDER, QUICK, &["-o", "a.exr"]].concat());
    symlink("a.exr", desk.path("a.png")).unwrap();
    desk.fail(&["compare", "a.exr", "a.exr", "--flip", "a.png"], &["a.png"]);
    desk.fail(&["compare", "a.exr", "a.exr", "--flip", "a.tif"], &["a.tif", ".png"]);
    fs::create_dir(desk.path("report")).unwrap();
    symlink("../cornell-box.bin", desk.path("report/index.html")).unwrap();
    let report = ["report", "cornell-box.gltf", "-o", "report", "--quiet"];
    desk.fail(&report, &["index.html", "input"]);
    fs::remove_file(desk.path("report/index.html")).unwrap();
    symlink("../a.exr", desk.path("report/index.html")).unwrap();
    desk.fail(&[&report[..], &["--reference", "a.exr"]].concat(), &["index.html", "input"]);
    fs::remove_file(desk.path("report/index.html")).unwrap();
    // The reference of an earlier report in the same folder stays as it is.
    let quick = ["--size", "16x12", "--records", "20", "--rays", "16", "--presets", "ward88"];
    let report = [&report[..], &quick].concat();
    desk.print(&[&report[..], &["--reference-rays", "32"]].concat());
    let before = fs::read(desk.path("report/reference.exr")).unwrap();
    desk.print(&[&report[..], &["--reference", "report/reference.exr"]].concat());
    assert_eq!(fs::read(desk.path("report/reference.exr")).unwrap(), before);
}

#[test]
fn devices_and_pipes_are_refused_and_stay_what_they_are() {
    let desk = furnished();
    for name in ["pipe.exr", "pipe.lumi", "pipe.gltf", "pipe.hdr"] {
        mkfifo(&desk.path(name), Mode::S_IRWXU).unwrap();
    }
    let not = "regular file";
    desk.fail(&["cache", "info", "pipe.lumi"], &["pipe.lumi", not]);
    desk.fail(&["cache", "dump", "/dev/zero"], &["/dev/zero", not]);
    desk.fail(&["compare", "pipe.exr", "pipe.exr"], &["pipe.exr", not]);
    desk.fail(&["info", "pipe.gltf"], &["pipe.gltf", not]);
    desk.fail(&["presets", "/dev/zero.toml"], &["/dev/zero.toml"]);
    for (flag, pipe) in [("--env", "pipe.hdr"), ("--cache-load", "pipe.lumi")] {
        desk.fail(&[&["render", "cornell-box.gltf", flag, pipe], QUICK].concat(), &[pipe, not]);
    }
    symlink("pipe.exr", desk.path("link.exr")).unwrap();
    symlink("/dev/null", desk.path("null.exr")).unwrap();
    for output in ["pipe.exr", "link.exr", "null.exr"] {
        for flag in ["-o", "--stats", "--cache-save"] {
            let arguments = [&["render", "cornell-box.gltf", flag, output], QUICK].concat();
            desk.fail(&arguments, &[output, not]);
        }
    }
    assert!(fs::metadata(desk.path("pipe.exr")).unwrap().file_type().is_fifo());
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
}

#[test]
fn a_sparse_file_is_judged_by_its_first_bytes() {
    let desk = furnished();
    let started = Instant::now();
    for (name, head) in [
        ("zeros.lumi", vec![]),
        ("cut.lumi", fs::read(desk.path("old.lumi")).unwrap()),
        ("magic.lumi", fs::read(desk.path("old.lumi")).unwrap()[..24].to_vec()),
    ] {
        fs::write(desk.path(name), head).unwrap();
        let file = fs::OpenOptions::new().write(true).open(desk.path(name)).unwrap();
        file.set_len(20 << 30).unwrap();
        desk.fail(&["cache", "info", name], &[name]);
    }
    assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
}

#[test]
fn outputs_follow_links_keep_modes_and_respect_read_only_files() {
    let desk = furnished();
    let render = |more: &[&str]| desk.print(&[RENDER, QUICK, more].concat());
    fs::create_dir(desk.path("elsewhere")).unwrap();
    symlink("elsewhere/real.exr", desk.path("a.exr")).unwrap();
    render(&["-o", "a.exr"]);
    fs::set_permissions(desk.path("a.exr"), fs::Permissions::from_mode(0o640)).unwrap();
    render(&["-o", "a.exr", "--seed", "1"]);
    assert!(desk.path("a.exr").is_symlink());
    assert_eq!(fs::metadata(desk.path("elsewhere/real.exr")).unwrap().mode() & 0o777, 0o640);
    fs::set_permissions(desk.path("a.exr"), fs::Permissions::from_mode(0o440)).unwrap();
    desk.fail(&[RENDER, QUICK, &["-o", "a.exr"]].concat(), &["a.exr", "read-only"]);
}

#[test]
fn names_of_other_formats_get_an_error_that_says_what_to_do() {
    let desk = Desk::new();
    let room = scene("cornell-box");
    for (flag, name, instead) in
        [("-o", "a.png", ".exr"), ("-o", "a.tiff", ".exr"), ("--preview", "a.exr", ".jpg")]
    {
        desk.fail(&["render", &room, flag, name], &[name, instead]);
    }
    for name in ["a.jpg", "a.JPEG", "a.png"] {
        desk.render("cornell-box", &["--preview", name]);
        let format = image::guess_format(&fs::read(desk.path(name)).unwrap()).unwrap();
        assert_eq!(format == image::ImageFormat::Jpeg, name != "a.png", "{name}");
    }
}

/// Runs a command of the shell in which `$0` is the program.
fn shell(desk: &Desk, command: &str) -> std::process::Output {
    Command::new("sh")
        .args(["-c", command, env!("CARGO_BIN_EXE_lumicache")])
        .current_dir(desk.path("."))
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn nobody_listening_is_no_panic() {
    let desk = furnished();
    for (command, codes) in [
        ("\"$0\" render cornell-box.gltf --nonsense 2>/dev/full", [2, 2]),
        ("\"$0\" render missing.gltf 2>/dev/full", [1, 1]),
        ("\"$0\" render missing.gltf 2>&-", [1, 1]),
        ("\"$0\" cache info old.lumi >/dev/full", [1, 1]),
        ("\"$0\" cache info old.lumi >&-", [0, 1]),
        ("\"$0\" --help >/dev/full", [0, 1]),
        ("{ \"$0\" cache dump old.lumi; echo $? >code; } | true; exit $(cat code)", [0, 0]),
    ] {
        let output = shell(&desk, command);
        let code = output.status.code().unwrap_or(-1);
        assert!(codes.contains(&code), "{command}: {code}, {}", text(&output.stderr));
    }
    // A warning that nobody can read.
    fs::write(desk.path("dark.gltf"), r#"{"asset": {"version": "2.0"}}"#).unwrap();
    let output = shell(&desk, "\"$0\" render dark.gltf --size 8x8 --spp 1 2>/dev/full");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn control_characters_of_names_do_not_reach_the_terminal() {
    let desk = Desk::new();
    let name = "a\u{1b}[31m\nb.gltf";
    let output = desk.run(&["info", name]);
    let error = text(&output.stderr);
    assert!(error.contains("a\\u{1b}[31m\\nb.gltf") && error.lines().count() == 1, "{error:?}");
}

#[test]
fn a_full_disk_costs_nothing_that_was_there() {
    let desk = furnished();
    desk.print(&[RENDER, QUICK, &["-o", "a.exr", "--cache-save", "b.lumi"]].concat());
    let files = desk.files();
    let old = ["a.exr", "b.lumi"].map(|name| fs::read(desk.path(name)).unwrap());
    for outputs in ["-o a.exr", "-o c.exr", "-o c.exr --cache-save b.lumi"] {
        let command =
            format!("ulimit -f 4; exec \"$0\" {} {} {outputs}", RENDER.join(" "), QUICK.join(" "));
        let output = shell(&desk, &command);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{outputs}: {error}");
        assert!(error.starts_with("lumicache: ") && error.lines().count() == 1, "{error:?}");
        assert_eq!(desk.files(), files, "{outputs}");
    }
    assert_eq!(["a.exr", "b.lumi"].map(|name| fs::read(desk.path(name)).unwrap()), old);
}

#[test]
fn a_home_that_is_not_there_is_no_failure() {
    let desk = furnished();
    for home in ["/nonexistent", "/dev/null", ""] {
        let room = scene("cornell-box-glossy");
        let arguments =
            [&["render", &room, "-o", "a.exr", "--preset", "krivanek05"], QUICK].concat();
        let mut command = desk.command(&arguments);
        command.env("HOME", home).env_remove("XDG_CACHE_HOME").env_remove("LUMICACHE_TABLES");
        let output = command.output().unwrap();
        assert_eq!(
            (output.status.code(), text(&output.stderr)),
            (Some(0), String::new()),
            "{home}"
        );
    }
}

#[test]
fn a_picture_larger_than_memory_is_an_error() {
    let desk = Desk::new();
    let command = format!(
        "ulimit -v 8000000; exec \"$0\" render {} --size 16384x16384 --quiet",
        scene("cornell-box")
    );
    let output = shell(&desk, &command);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("16384 x 16384") && error.contains("memory"), "{error}");
    assert!(error.lines().count() == 1 && desk.files().is_empty(), "{error}");
}

#[test]
fn more_records_than_memory_holds_are_an_error() {
    let desk = Desk::new();
    // Records that keep the hits of all their rays.
    let run = |kilobytes: u64, rays: u32| {
        let command = format!(
            "ulimit -v {kilobytes}; exec \"$0\" render {} --size 64x48 --threads 1 --quiet \
             --preset krivanek05 --set glossy.bands=all --set glossy.hits=stored --set levels=1 \
             --set gather.noise=0 --set radius.max_radius=0.01 --set radius.min_pixels=0.5 \
             --max-bounces 1 --rays {rays} --prepass-only --cache-save a.lumi",
            scene("metal-hall")
        );
        let mut shell = Command::new("sh");
        shell.args(["-c", &command, env!("CARGO_BIN_EXE_lumicache")]);
        let output = shell.current_dir(desk.path(".")).stdin(Stdio::null()).output().unwrap();
        (output.status.code(), text(&output.stderr))
    };
    // The least memory in which the program starts and keeps few rays.
    let mut starts = (8..100).map(|k| 25_000 * k);
    let least = starts.find(|limit| run(*limit, 16).0 == Some(0)).unwrap();
    fs::remove_file(desk.path("a.lumi")).unwrap();
    for more in [0, 100_000] {
        let (code, error) = run(least + more, 4096);
        assert_eq!(code, Some(1), "{least} + {more} kB: {error}");
        assert!(error.contains("records of level 0: there is no memory"), "{error}");
        assert!(error.lines().count() == 1 && desk.files().is_empty(), "{error}");
    }
}

/// A number from 0 to 1 that looks random.
fn noise(seed: u32) -> f64 {
    let mut x = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    x = (x ^ (x >> 15)).wrapping_mul(0x2c1b_3c6d);
    f64::from(x ^ (x >> 16)) / f64::from(u32::MAX)
}

/// Kills renders and joins of caches that write over existing files at random moments, as often as
/// the variable `KILLS` says, by default 20 times.
#[test]
fn a_kill_leaves_whole_files_and_nothing_for_long() {
    let desk = furnished();
    let kills: u32 = std::env::var("KILLS").map_or(20, |n| n.parse().unwrap());
    let arguments =
        [RENDER, QUICK, &["-o", "a.exr", "--preview", "a.png", "--cache-save", "b.lumi"]];
    let arguments = arguments.concat();
    let started = Instant::now();
    desk.print(&arguments);
    let whole = started.elapsed();
    let names = desk.files();
    let (mut killed, mut left) = (0, 0);
    for k in 0..kills {
        let mut child = desk.command(&arguments).stderr(Stdio::null()).spawn().unwrap();
        // Most of the writing is at the end.
        std::thread::sleep(whole.mul_f64(0.4 + 0.7 * noise(k)));
        let _ = kill(Pid::from_raw(child.id() as i32), Signal::SIGKILL);
        killed += u32::from(child.wait().unwrap().code().is_none());
        assert!(lumicache::imagefile::exr::read(&desk.path("a.exr")).is_ok(), "kill {k}");
        let preview = fs::read(desk.path("a.png")).unwrap();
        assert!(lumicache::imagefile::ldr::decode(&preview).is_ok(), "kill {k}");
        assert!(lumicache::cache::CacheFile::read(&desk.path("b.lumi")).is_ok(), "kill {k}");
        let more = desk.files().len() - names.len();
        assert!(more <= 1, "kill {k} left {:?}", desk.files());
        left += more;
        if more > 0 {
            desk.print(&arguments);
            assert_eq!(desk.files(), names, "kill {k}");
        }
    }
    eprintln!("{kills} runs, {killed} killed, {left} temporary files, all removed by the next run");
    assert!(killed > 0);
}
