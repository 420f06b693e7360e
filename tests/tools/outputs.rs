//! What `render` writes: size, layers, preview, statistics.

use crate::support::desk::{Desk, QUICK, mean, names};
use crate::support::gltf_maker::{Gltf, triangle};
use lumicache::imagefile::{Attribute, Crop, Picture, SampleKind};
use lumicache::imagefile::{exr, ldr};
use serde_json::{Value, json};

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
    let kind = |layers: &Picture, name: &str| layers.channel(name).map(|c| c.kind);
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
    for phase in ["load", "accel_build", "fill", "render", "denoise", "write"] {
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
fn layers_that_halves_would_clip_are_floats_and_all_are_on_demand() {
    let desk = Desk::new();
    let kinds = |picture: &Picture| -> Vec<(String, SampleKind)> {
        picture.channels.iter().map(|c| (c.name.clone(), c.kind)).collect()
    };
    let float = desk.render("cornell-box", &["--float", "--aov", "all", "--show-records"]);
    assert!(kinds(&float).iter().all(|(_, kind)| *kind == SampleKind::Float), "{float:?}");
    // A sky of a million is seen beside a triangle.
    let mut file = Gltf::new();
    triangle(&mut file);
    file.node(json!({"mesh": 0}));
    file.scene(&[0]);
    std::fs::write(desk.path("bright.glb"), file.glb()).unwrap();
    let mut sky = Picture::new([1, 1]);
    for name in ["R", "G", "B"] {
        sky.add(name, SampleKind::Float, vec![1e6]);
    }
    exr::write(&desk.path("sky.exr"), &sky).unwrap();
    let arguments = [&["render", "bright.glb", "--env", "sky.exr", "-o", "out.exr"], QUICK];
    desk.print(&[&arguments.concat()[..], &["--spp", "1"]].concat());
    let picture = exr::read(&desk.path("out.exr")).unwrap();
    for (name, kind) in kinds(&picture) {
        let bright = !name.contains('.')
            || name.starts_with("emission.")
            || name.contains("diffuse")
            || name.contains("glossy");
        assert!(bright || kind == SampleKind::Half, "{name}");
        if ["R", "A", "emission.G"].contains(&name.as_str()) {
            assert_eq!(kind, SampleKind::Float, "{name}");
        }
    }
    let emitted = &picture.channel("emission.R").unwrap().samples;
    assert!(emitted.contains(&1e6), "{emitted:?}");
}
