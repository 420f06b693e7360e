//! The command line as a user runs it: the built program, its files, its messages and its exit
//! codes.

use crate::support::desk::{Desk, ENDLESS, QUICK, mean, scene, text};
use crate::support::gltf_maker::Gltf;
use lumicache::compare::{Options, compare};
use lumicache::imagefile::ldr;
use lumicache::imagefile::{Channel, Picture, SampleKind, exr};
use serde_json::{Value, json};
use std::collections::BTreeSet;

#[test]
fn a_sky_lights_the_scene() {
    let desk = Desk::new();
    let mean = |image: &Picture| image.channel("R").unwrap().samples.iter().sum::<f32>();
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
                 prepass-only aov denoise preview exposure stats show-records display-server quiet";
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
        (&["-o", "out.exr", "--stats", "./out.exr"], &["out.exr", "one file"]),
        (&["-o", &room], &["cornell-box.gltf", ".exr"]),
        (&["--stats", &room], &["cornell-box.gltf", "one file"]),
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
    crate::support::gltf_maker::triangle(&mut file);
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
    crate::support::gltf_maker::triangle(&mut file);
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
        &Picture { width: 8, height: 4, channels, ..Picture::default() },
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
    assert!(all.len() <= 46, "{} settings: {all:?}", all.len());
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
