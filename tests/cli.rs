//! The command line as a user runs it: the built program, its files, its messages and its exit
//! codes.

use crate::desk::{Desk, QUICK, scene, text};
use crate::gltf_maker::Gltf;
use lumicache::compare::{Options, compare};
use lumicache::imagefile::exr::{self, Attribute, Channel, Crop, Layers, SampleKind};
use lumicache::imagefile::ldr;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

/// A render that nobody waits for.
const ENDLESS: &[&str] = &["--size", "640x480", "--spp", "1000000"];

fn mean(layers: &Layers, channel: &str) -> f32 {
    let samples =
        &layers.channel(channel).unwrap_or_else(|| panic!("there is no channel {channel}")).samples;
    samples.iter().sum::<f32>() / samples.len() as f32
}

fn names(layers: &Layers) -> Vec<&str> {
    layers.channels.iter().map(|c| c.name.as_str()).collect()
}

#[test]
fn a_sky_lights_the_scene() {
    let desk = Desk::new();
    let mean = |image: &Layers| image.channel("R").unwrap().samples.iter().sum::<f32>();
    let dim = desk.render(
        "curved-spheres",
        &["--sky", "overcast,elevation=30", "--light-units", "radiometric"],
    );
    let bright = desk.render(
        "curved-spheres",
        &["--sky", "overcast,elevation=30", "--env-scale", "2", "--light-units", "radiometric"],
    );
    assert!(
        mean(&dim) > 0.0 && mean(&bright) > 1.5 * mean(&dim),
        "{} {}",
        mean(&dim),
        mean(&bright)
    );
    let both_ways = desk.render(
        "curved-spheres",
        &["--sky", "overcast,elevation=30", "--light-units", "radiometric", "--integrator", "bdpt"],
    );
    assert!(
        (mean(&both_ways) / mean(&dim) - 1.0).abs() < 0.2,
        "{} {}",
        mean(&both_ways),
        mean(&dim)
    );
    desk.fail(
        &["render", &scene("cornell-box"), "--sky", "stormy"],
        &["--sky", "\"stormy\"", "overcast"],
    );
    let both = desk.run(&["render", &scene("cornell-box"), "--sky", "clear", "--env", "a.hdr"]);
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn help_and_version() {
    let desk = Desk::new();
    assert_eq!(desk.print(&["--version"]), format!("lumicache {}\n", env!("CARGO_PKG_VERSION")));
    let help = desk.print(&["--help"]);
    for command in ["render", "presets", "compare", "info", "bench", "report", "completions", "man"]
    {
        assert!(help.contains(&format!("\n  {command} ")), "--help does not list {command}");
        assert!(desk.print(&[command, "--help"]).contains("Usage: lumicache"), "{command} --help");
    }
    let help = desk.print(&["render", "--help"]);
    let flags = "output integrator preset quality set size spp max-bounces rays error backend threads seed camera crop env env-rotate env-scale light-units \
                 prepass-only aov preview exposure stats show-records display-server quiet";
    for flag in flags.split_whitespace() {
        assert!(help.contains(&format!("--{flag}")), "render --help does not list --{flag}");
    }
    assert!(desk.files().is_empty());
}

#[test]
fn wrong_usage_is_exit_code_2() {
    let desk = Desk::new();
    let room = scene("cornell-box");
    for arguments in [
        &[][..],
        &["paint"],
        &["render"],
        &["render", &room, "--nonsense"],
        &["render", &room, "--spp", "many"],
        &["render", &room, "--integrator", "radiosity"],
        &["render", &room, "--light-units", "lumen"],
        &["render", &room, "--size"],
        &["completions", "cmd"],
        &["compare", "one.exr"],
    ] {
        let output = desk.run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(!output.stderr.is_empty() && output.stdout.is_empty(), "{arguments:?}");
    }
    assert!(desk.files().is_empty());
}

#[test]
fn bad_values_are_one_clear_line() {
    let desk = Desk::new();
    let room = scene("cornell-box");
    std::fs::create_dir(desk.path("folder")).unwrap();
    std::fs::write(desk.path("broken.gltf"), "{\"asset\": {\"version\": \"2.0\"}, \"nodes\": 3}")
        .unwrap();
    std::fs::write(desk.path("broken.hdr"), "#?RADIANCE\n").unwrap();
    std::fs::write(desk.path("broken.exr"), "no picture").unwrap();
    // The file at fault, or the argument, is in every message.
    let cases: &[(&[&str], &[&str])] = &[
        (&["--set", "nonsense=1"], &["`nonsense`", "rays"]),
        (&["--set", "gather.rays"], &["KEY=VALUE"]),
        (&["--set", "gather.rays=few"], &["`gather.rays`", "few", "from 16"]),
        (&["--set", "gather.ray=1"], &["`gather.ray`", "gather.rays, gather.deeper_rays"]),
        (&["--set", "validity.kernel=gauss"], &["`validity.kernel`", "ward, tabellion"]),
        (&["--set", "extrapolation.error=1"], &["no effect", "`extrapolation.kind` is first"]),
        (&["--rays", "1"], &["`gather.rays`"]),
        (&["--error", "0"], &["`validity.error`"]),
        (&["--preset", "nonsense"], &["`nonsense`", "tabellion04"]),
        (&["--aov", "nonsense"], &["`nonsense`", "diffuse_direct"]),
        (&["--aov", "albedo,,N"], &["layer"]),
        (&["--backend", "gpu"], &["gpu", "embree", "bvh"]),
        (&["--camera", "nobody"], &["`nobody`", "`camera`", "cornell-box.gltf"]),
        (&["--size", "640"], &["--size", "640"]),
        (&["--size", "0x4"], &["--size", "0x4"]),
        (&["--size", "100000x100000"], &["100000x100000"]),
        (&["--crop", "0,0,9"], &["--crop", "0,0,9"]),
        (&["--crop", "20,0,10,9"], &["crop", "20,0,10,9"]),
        (&["--crop", "0,0,9999,9"], &["crop", "9999"]),
        (&["--spp", "0"], &["--spp"]),
        (&["--quality", "0"], &["--quality"]),
        (&["--quality", "NaN"], &["--quality"]),
        (&["--threads", "0"], &["--threads"]),
        (&["--env", "missing.hdr"], &["missing.hdr"]),
        (&["--env", "broken.hdr"], &["broken.hdr"]),
        (&["--env", "broken.exr"], &["broken.exr"]),
        (&["-o", "missing/out.exr"], &["missing/out.exr"]),
        (&["-o", "folder"], &["folder"]),
        (&["--preview", "missing/out.png"], &["missing/out.png"]),
        (&["--stats", "missing/out.json"], &["missing/out.json"]),
        (&["-o", "out.exr", "--preview", "./out.exr"], &["out.exr", "one file"]),
        (&["-o", &room], &["cornell-box.gltf", "one file"]),
    ];
    for (more, words) in cases {
        // What is wrong is told before the render starts: these would never end.
        let endless: Vec<&str> =
            ENDLESS.chunks(2).filter(|option| option[0] != more[0]).flatten().copied().collect();
        desk.fail(&[&["render", &room], &endless[..], more].concat(), words);
    }
    for (file, words) in [
        ("missing.gltf", &["missing.gltf"][..]),
        ("broken.gltf", &["broken.gltf", "/nodes"]),
        ("folder", &["folder"]),
    ] {
        desk.fail(&[&["render", file], ENDLESS].concat(), words);
        desk.fail(&["info", file], words);
    }
    desk.fail(&["compare", "broken.exr", "missing.exr"], &["broken.exr"]);
    assert_eq!(desk.files(), ["broken.exr", "broken.gltf", "broken.hdr", "folder"]);
}

#[test]
fn the_output_is_the_scene_s_name_in_the_current_folder() {
    let desk = Desk::new();
    assert_eq!(desk.print(&[&["render", &scene("cornell-box")], QUICK].concat()), "");
    assert_eq!(desk.files(), ["cornell-box.exr"]);
    // A second render replaces the first, and a name with dots keeps them.
    let desk = Desk::new();
    let mut file = Gltf::new();
    crate::gltf_maker::triangle(&mut file);
    file.node(json!({"mesh": 0}));
    file.scene(&[0]);
    std::fs::write(desk.path("box.v2.glb"), file.glb()).unwrap();
    for _ in 0..2 {
        assert_eq!(
            desk.run(&[&["render", "box.v2.glb", "--quiet"], QUICK].concat()).status.code(),
            Some(0)
        );
        assert_eq!(desk.files(), ["box.v2.exr", "box.v2.glb"]);
    }
}

#[test]
fn warnings_go_to_stderr_unless_it_is_quiet() {
    let desk = Desk::new();
    let mut file = Gltf::new();
    crate::gltf_maker::triangle(&mut file);
    file.node(json!({"mesh": 0}));
    file.scene(&[0]);
    std::fs::write(desk.path("dark.glb"), file.glb()).unwrap();
    let output = desk.run(&[&["render", "dark.glb"], QUICK].concat());
    assert_eq!((output.status.code(), text(&output.stdout)), (Some(0), String::new()));
    let error = text(&output.stderr);
    assert!(
        error.starts_with("lumicache: warning: ")
            && error.contains("no light")
            && error.lines().count() == 1,
        "{error:?}"
    );
    assert_eq!(desk.print(&[&["render", "dark.glb", "--quiet"], QUICK].concat()), "");
}

#[test]
fn size_crop_and_samples_are_as_asked() {
    let desk = Desk::new();
    let whole = desk.render("cornell-box", &["--integrator", "path"]);
    assert_eq!((whole.width, whole.height, whole.crop), (32, 24, None));
    assert_eq!(whole.attribute("samplesPerPixel"), Some(&Attribute::Int(2)));
    let part = desk.render("cornell-box", &["--integrator", "path", "--crop", "5,3,30,20"]);
    assert_eq!((part.width, part.height), (25, 17));
    assert_eq!(part.crop, Some(Crop { origin: [5, 3], whole: [32, 24] }));
    let inside: Vec<f32> = (3..20)
        .flat_map(|y| whole.channel("G").unwrap().samples[32 * y + 5..32 * y + 30].to_vec())
        .collect();
    assert_eq!(part.channel("G").unwrap().samples, inside);
    // Another seed is another picture; the same is the same.
    assert_eq!(
        desk.render("cornell-box", &["--integrator", "path"]).channel("R"),
        whole.channel("R")
    );
    assert_ne!(
        desk.render("cornell-box", &["--integrator", "path", "--seed", "1"]).channel("R"),
        whole.channel("R")
    );
    // Without light behind the first surface the picture is darker.
    let direct = desk.render("cornell-box", &["--max-bounces", "0"]);
    assert!(
        mean(&direct, "diffuse_indirect.G") == 0.0 && mean(&whole, "diffuse_indirect.G") > 0.01
    );
}

#[test]
fn aov_chooses_the_layers() {
    let desk = Desk::new();
    let beauty = ["A", "B", "G", "R"];
    assert_eq!(names(&desk.render("cornell-box", &["--aov", "none"])), beauty);
    let basic = desk.render("cornell-box", &[]);
    let all = desk.render("cornell-box", &["--aov", "all"]);
    for layer in [
        "diffuse_direct",
        "diffuse_indirect",
        "glossy_direct",
        "glossy_indirect",
        "emission",
        "albedo",
    ] {
        for c in ["R", "G", "B"] {
            let name = format!("{layer}.{c}");
            assert!(
                names(&basic).contains(&name.as_str()) && names(&all).contains(&name.as_str()),
                "{name}"
            );
        }
    }
    let kind = |layers: &Layers, name: &str| layers.channel(name).map(|c| c.kind);
    assert_eq!(
        (kind(&basic, "R"), kind(&basic, "N.X"), kind(&basic, "Z")),
        (Some(SampleKind::Half), Some(SampleKind::Half), Some(SampleKind::Float))
    );
    for name in [
        "P.X",
        "P.Y",
        "P.Z",
        "gi.records",
        "gi.status",
        "gi.error",
        "gi.irradiance.R",
        "variance.R",
    ] {
        assert!(kind(&basic, name).is_none() && kind(&all, name).is_some(), "{name}");
    }
    let two = desk.render("cornell-box", &["--aov", "albedo, Z"]);
    assert_eq!(names(&two), ["A", "B", "G", "R", "Z", "albedo.B", "albedo.G", "albedo.R"]);
    for name in [
        "software",
        "settings",
        "seconds",
        "sceneHash",
        "backend",
        "chromaticities",
        "worldToCamera",
        "worldToNDC",
    ] {
        assert!(all.attribute(name).is_some(), "attribute {name}");
    }
    assert_eq!(all.attribute("cancelled"), None);
}

#[test]
fn the_preview_is_a_png_of_the_same_size() {
    let desk = Desk::new();
    let light = |exposure: &str| {
        desk.render(
            "cornell-box",
            &["--preview", "out.png", "--exposure", exposure, "--crop", "0,0,31,20"],
        );
        let image = ldr::decode(&std::fs::read(desk.path("out.png")).unwrap()).unwrap();
        assert_eq!((image.width, image.height), (31, 20));
        let lumicache::imagefile::TexturePixels::Rgba8(pixels) = image.pixels else {
            panic!("8 bits were asked for")
        };
        pixels.iter().map(|p| u32::from(p[1])).sum::<u32>()
    };
    let (dark, bright) = (light("-2"), light("1.5"));
    assert!(dark > 0 && bright > 2 * dark, "{dark} {bright}");
    assert_eq!(desk.files(), ["out.exr", "out.png"]);
}

#[test]
fn statistics_have_their_keys() {
    let desk = Desk::new();
    desk.render(
        "cornell-box",
        &["--stats", "stats.json", "--threads", "1", "--backend", "bvh", "--set", "levels=2"],
    );
    let stats = desk.json("stats.json");
    for phase in ["load", "accel_build", "fill", "render", "write"] {
        for key in ["seconds", "cpu_seconds"] {
            assert!(
                stats["phases"][phase][key].as_f64().is_some_and(|s| s >= 0.0),
                "phases.{phase}.{key}"
            );
        }
    }
    let number = |pointer: &str| {
        stats
            .pointer(pointer)
            .and_then(Value::as_u64)
            .unwrap_or_else(|| panic!("{pointer}: {stats:#}"))
    };
    assert_eq!(
        (number("/threads"), number("/samples"), number("/rays/camera")),
        (1, 32 * 24 * 2, 32 * 24 * 2)
    );
    assert!(
        number("/lookups") >= number("/hits")
            && number("/hits") > 0
            && number("/peak_memory_bytes") > 1 << 20
    );
    assert_eq!(number("/records"), number("/levels/0/records") + number("/levels/1/records"));
    assert!(
        number("/levels/1/records") > 0
            && number("/levels/0/bytes") > 0
            && number("/rays/gather") > 0
    );
    assert_eq!((&stats["backend"]["name"], &stats["cancelled"]), (&json!("bvh"), &json!(false)));
    assert!(
        stats["backend"]["version"].is_string()
            && stats["settings"].as_str().unwrap().contains("size=32x24")
    );
}

#[test]
fn prepass_only_fills_and_writes_no_picture() {
    let desk = Desk::new();
    assert_eq!(
        desk.print(
            &[&["render", &scene("cornell-box"), "--prepass-only", "--stats", "stats.json"], QUICK]
                .concat()
        ),
        ""
    );
    assert_eq!(desk.files(), ["stats.json"]);
    let stats = desk.json("stats.json");
    assert!(stats["records"].as_u64().unwrap() > 0 && stats["samples"] == json!(0));
}

#[test]
fn records_are_shown_in_layers_and_preview() {
    let desk = Desk::new();
    let plain = desk.render("cornell-box", &["--preview", "plain.png"]);
    assert!(!names(&plain).iter().any(|n| n.starts_with("gi.")));
    let shown =
        desk.render("cornell-box", &["--preview", "shown.png", "--show-records", "--aov", "none"]);
    assert_eq!(
        names(&shown),
        ["A", "B", "G", "R", "gi.level", "gi.overlay.B", "gi.overlay.G", "gi.overlay.R"]
    );
    let level = &shown.channel("gi.level").unwrap().samples;
    assert!(
        level.iter().all(|&l| l == 0.0 || l == 1.0) && level.contains(&1.0) && level.contains(&0.0)
    );
    // The beauty is as without; the overlay differs from it where a record is, and only there.
    assert_eq!(shown.channel("R"), plain.channel("R"));
    let (overlay, beauty) =
        (&shown.channel("gi.overlay.R").unwrap().samples, &shown.channel("R").unwrap().samples);
    assert!(
        overlay.iter().zip(beauty).zip(level).all(|((o, b), &l)| l > 0.0 || o == b)
            && overlay != beauty
    );
    assert_ne!(
        std::fs::read(desk.path("plain.png")).unwrap(),
        std::fs::read(desk.path("shown.png")).unwrap()
    );
}

#[test]
fn the_environment_is_scaled_and_turned() {
    let desk = Desk::new();
    // A map with one bright column, above a triangle that faces up.
    let mut samples = vec![0.1; 8 * 4];
    (0..4).for_each(|row| samples[8 * row + 5] = 1.0);
    let channels = ["R", "G", "B"]
        .map(|c| Channel { name: c.into(), kind: SampleKind::Float, samples: samples.clone() })
        .to_vec();
    exr::write(
        &desk.path("sky.exr"),
        &Layers { width: 8, height: 4, channels, ..Layers::default() },
    )
    .unwrap();
    let shot = |more: &[&str]| {
        desk.render(
            "curved-spheres",
            &[&["--integrator", "path", "--spp", "8", "--env", "sky.exr"], more].concat(),
        )
    };
    let plain = shot(&[]);
    let double = shot(&["--env-scale", "2"]);
    // The scene's own lamps stay as they are: twice the map adds once more what the map gives.
    let dark = shot(&["--env-scale", "0"]);
    let gain = (mean(&double, "G") - mean(&dark, "G")) / (mean(&plain, "G") - mean(&dark, "G"));
    assert!((gain - 2.0).abs() < 0.1, "{gain}");
    assert_ne!(shot(&["--env-rotate", "-90"]).channel("G"), plain.channel("G"));
    assert_eq!(shot(&["--env-rotate", "360"]).width, plain.width);
}

#[test]
fn presets_are_listed_and_what_is_printed_reads_back() {
    let desk = Desk::new();
    let table = desk.print(&["presets"]);
    assert!(table.lines().all(|line| line.chars().count() <= 100), "{table}");
    let list: Value = serde_json::from_str(&desk.print(&["presets", "--json"])).unwrap();
    let list = list.as_array().unwrap();
    assert_eq!(table.lines().count(), list.len());
    let mut all = BTreeSet::new();
    for preset in list {
        let name = preset["name"].as_str().unwrap();
        let source = preset["source"].as_str().unwrap();
        assert!(table.contains(name) && table.contains(source), "{name}");
        let settings = preset["scheme"].as_object().unwrap();
        all.extend(settings.keys().filter(|k| k.contains('.') || settings[*k] != "none").cloned());
        // What is printed can be set, all at once and in any order.
        let flags: Vec<String> = settings
            .iter()
            .rev()
            .map(|(k, v)| {
                format!("{k}={}", v.as_str().map_or_else(|| v.to_string(), str::to_owned))
            })
            .collect();
        let mut arguments = vec!["render", "missing.gltf", "--preset", name];
        flags.iter().for_each(|flag| arguments.extend(["--set", flag]));
        desk.fail(&arguments, &["missing.gltf"]);
        // And so can the texts.
        for (more, file) in [(None, "short.toml"), (Some("--all"), "long.toml")] {
            let arguments: Vec<&str> = ["presets", name].into_iter().chain(more).collect();
            std::fs::write(desk.path(file), desk.print(&arguments)).unwrap();
            assert_eq!(
                desk.print(&["presets", file, "--all"]),
                desk.print(&["presets", name, "--all"])
            );
        }
    }
    all.insert("clamping".into());
    assert!(all.len() <= 40, "{} settings: {all:?}", all.len());
}

#[test]
fn a_scheme_of_ones_own_is_a_file() {
    let desk = Desk::new();
    let write = |text: &str| std::fs::write(desk.path("mine.toml"), text).unwrap();
    let render = ["render", &scene("cornell-box"), "--size", "16x12", "--spp", "1", "--quiet"];
    let run = [&render[..], &["--preset", "mine.toml", "--cache-save", "a.lumi", "-o", "a.exr"]];
    write("base = \"tabellion04\"\nlevels = 1\n\n[gather]\nrays = 32\n");
    desk.print(&run.concat());
    let info = desk.print(&["cache", "info", "a.lumi"]);
    assert!(info.contains("gather.rays") && info.contains("minimum-restricted"), "{info}");
    let fail = |text: &str, words: &[&str]| {
        write(text);
        desk.fail(&run.concat(), &[&["mine.toml"], words].concat());
    };
    fail("base = \"auto\"\n\n[gather]\nray = 3\n", &["line 4", "`gather.ray`", "gather.rays"]);
    fail("base = \"auto\"\ngather.rays = 3\n", &["line 2", "`gather.rays`", "from 16 to 1000000"]);
    fail("base = \"auto\"\ngather.rays = [1]\n", &["line 2", "`gather.rays`", "one value"]);
    fail("base = \"auto\"\n[gather\n", &["line 2"]);
    fail("base = \"nobody\"\n", &["`nobody`", "krivanek06"]);
    fail(
        "base = \"auto\"\nextrapolation.error = 0.1\n",
        &["line 2", "extrapolation.kind", "first"],
    );
    fail("levels = 1\n", &["`gather.strata`", "base"]);
    desk.fail(&[&render[..], &["--preset", "other.toml"]].concat(), &["other.toml"]);
}

#[test]
fn compare_prints_what_the_library_measures() {
    let desk = Desk::new();
    let a = desk.render("cornell-box", &["--integrator", "path"]);
    std::fs::rename(desk.path("out.exr"), desk.path("a.exr")).unwrap();
    let b = desk.render("cornell-box", &["--integrator", "path", "--seed", "1"]);
    let printed: Value = serde_json::from_str(
        &desk.print(&["compare", "a.exr", "out.exr", "--json", "--flip", "flip.png"]),
    )
    .unwrap();
    let measured = serde_json::to_value(compare(&a, &b, &Options::default()).unwrap()).unwrap();
    assert_eq!(printed.as_object().unwrap().len(), measured.as_object().unwrap().len());
    for key in ["relmse", "mape", "mean_ratio", "psnr", "flip"] {
        let (printed, measured) = (printed[key].as_f64().unwrap(), measured[key].as_f64().unwrap());
        assert!((printed - measured).abs() <= 1e-12 * measured, "{key}: {printed} for {measured}");
        assert!(
            desk.print(&["compare", "a.exr", "out.exr"]).contains(&key.replace('_', " ")),
            "{key}"
        );
    }
    assert_eq!(ldr::decode(&std::fs::read(desk.path("flip.png")).unwrap()).unwrap().width, 32);
    let layer = desk.print(&["compare", "a.exr", "a.exr", "--channel-prefix", "albedo", "--json"]);
    assert_eq!(serde_json::from_str::<Value>(&layer).unwrap()["relmse"], json!(0.0));
    desk.fail(
        &["compare", "a.exr", "out.exr", "--channel-prefix", "nonsense"],
        &["a.exr", "nonsense"],
    );
}

#[test]
fn info_completions_and_manual() {
    let desk = Desk::new();
    let info = desk.print(&["info", &scene("cornell-box")]);
    for words in ["triangles   38", "materials   6", "bounds", "camera 0    `camera`", "hash"] {
        assert!(info.contains(words), "{words} is not in {info}");
    }
    for (shell, words) in
        [("bash", "complete -F"), ("zsh", "#compdef lumicache"), ("fish", "complete -c lumicache")]
    {
        let script = desk.print(&["completions", shell]);
        assert!(script.contains(words) && script.contains("max-bounces"), "{shell}");
    }
    let page = desk.print(&["man"]);
    assert!(page.contains(".TH lumicache 1"), "{page}");
    for words in [
        ".SH LUMICACHE RENDER",
        "max\\-bounces",
        "show\\-records",
        "channel\\-prefix",
        ".SH LUMICACHE BENCH ACCEL",
    ] {
        assert!(page.contains(words), "the manual does not speak of {words}");
    }
}

/// A viewer: the address to connect to, and the types of the packets of the first connection, as
/// they come.
fn viewer(first: impl FnOnce() + Send + 'static) -> (String, std::thread::JoinHandle<Vec<u8>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let packets = std::thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let (mut first, mut kinds) = (Some(first), Vec::new());
        while let Some(kind) = packet(&mut stream) {
            kinds.push(kind);
            // Type 6 carries pixels.
            if kind == 6
                && let Some(first) = first.take()
            {
                first();
            }
        }
        kinds
    });
    (address, packets)
}

/// Reads one packet of tev's protocol: its length in bytes, its type, the rest.
fn packet(stream: &mut TcpStream) -> Option<u8> {
    let mut length = [0; 4];
    stream.read_exact(&mut length).ok()?;
    let mut rest = vec![0; u32::from_le_bytes(length) as usize - 4];
    stream.read_exact(&mut rest).unwrap();
    Some(rest[0])
}

#[test]
fn a_viewer_is_sent_every_tile() {
    let desk = Desk::new();
    let (address, packets) = viewer(|| ());
    desk.render("cornell-box", &["--spp", "20", "--display-server", &address]);
    // One packet opens the image; 32 x 24 pixels are four tiles, 20 samples two passes.
    let kinds = packets.join().unwrap();
    assert_eq!((kinds[0], kinds.len()), (4, 1 + 4 * 2), "{kinds:?}");
    assert!(kinds[1..].iter().all(|&k| k == 6), "{kinds:?}");
}

#[test]
fn a_viewer_that_is_not_there_is_told_before_rendering() {
    let desk = Desk::new();
    let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    desk.fail(
        &[&["render", &scene("cornell-box"), "--display-server", &closed], ENDLESS].concat(),
        &[&closed, "cannot connect"],
    );
}

/// What Ctrl-C does.
fn interrupt(child: &Child) {
    let process = nix::unistd::Pid::from_raw(child.id().try_into().unwrap());
    nix::sys::signal::kill(process, nix::sys::signal::Signal::SIGINT).unwrap();
}

/// Runs an endless render of the inside of the box, and interrupts it when its first pixels are
/// there.
fn interrupted(desk: &Desk, more: &[&str]) -> Output {
    let (send, receive) = std::sync::mpsc::channel();
    let (address, packets) = viewer(move || send.send(()).unwrap());
    let room = scene("cornell-box");
    let arguments = [
        &[
            "render",
            &room,
            "-o",
            "out.exr",
            "--crop",
            "160,120,480,360",
            "--display-server",
            &address,
        ],
        ENDLESS,
        more,
    ]
    .concat();
    let child =
        desk.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    receive.recv_timeout(Duration::from_secs(120)).expect("the render starts");
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    packets.join().unwrap();
    output
}

#[test]
fn an_interrupt_keeps_the_picture_so_far() {
    let desk = Desk::new();
    for integrator in ["path", "cache"] {
        let more = [
            "--integrator",
            integrator,
            "--rays",
            "16",
            "--error",
            "1",
            "--set",
            "levels=1",
            "--preview",
            "out.png",
            "--stats",
            "out.json",
        ];
        let output = interrupted(&desk, &more);
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        assert_eq!((text(&output.stdout), text(&output.stderr)), (String::new(), String::new()));
        assert_eq!(desk.files(), ["out.exr", "out.json", "out.png"]);
        let layers = exr::read(&desk.path("out.exr")).unwrap();
        assert_eq!(
            (layers.width, layers.height, layers.attribute("cancelled")),
            (320, 240, Some(&Attribute::Int(1)))
        );
        assert!(
            layers
                .channels
                .iter()
                .all(|c| c.name == "Z" || c.samples.iter().all(|x| x.is_finite()))
        );
        assert!(mean(&layers, "G") > 0.0, "{integrator}: nothing was kept");
        assert_eq!(desk.json("out.json")["cancelled"], json!(true));
    }
}

#[test]
fn an_interrupt_during_the_fill_is_heeded() {
    let desk = Desk::new();
    let arguments = [
        "render",
        &scene("indirect-room"),
        "-o",
        "out.exr",
        "--stats",
        "out.json",
        "--size",
        "640x480",
        "--rays",
        "100000",
        "--error",
        "0.01",
    ];
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let child = desk
        .command(&[&arguments[..], &["--display-server", &address]].concat())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The image is opened just before the fill begins.
    let mut stream = listener.accept().unwrap().0;
    assert_eq!(packet(&mut stream), Some(4));
    std::thread::sleep(Duration::from_millis(300));
    interrupt(&child);
    let signalled = Instant::now();
    let output = child.wait_with_output().unwrap();
    eprintln!("stopped after {:?}", signalled.elapsed());
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    let layers = exr::read(&desk.path("out.exr")).unwrap();
    assert_eq!((layers.width, layers.attribute("cancelled")), (640, Some(&Attribute::Int(1))));
}
