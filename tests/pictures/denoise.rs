//! Pictures without noise, by Open Image Denoise where it is installed.

use crate::support::desk::{Desk, QUICK, mean, names, scene, text};
use crate::support::pictures::{build, own};
use crate::support::testdata::skipped;
use lumicache::compare::{Options, compare};
use lumicache::ffi::denoise::{Denoiser, Noisy};
use lumicache::film::{LAYERS, Layer};
use lumicache::imagefile::{Attribute, Picture, SampleKind, exr};
use lumicache::math::Color;
use lumicache::render::{
    Denoise, IntegratorKind, Job, Rendering, denoiser_places, find_denoiser, workers,
};
use lumicache::scene::Scene;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

const PARTS: [&str; 5] =
    ["diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect", "emission"];

/// Where the library is looked for; `None` after a line on stderr that the test is skipped.
fn installed() -> Option<(Denoiser, Vec<PathBuf>)> {
    let places = denoiser_places(|name| std::env::var_os(name));
    match find_denoiser(&places) {
        Ok(denoiser) => Some((denoiser, places)),
        Err(error) => {
            skipped(&error.to_string());
            None
        }
    }
}

fn picture<'a>(
    scene: &'a Scene, integrator: IntegratorKind, size: [u32; 2], spp: u32, denoise: Denoise,
) -> Rendering<'a> {
    let places = denoiser_places(|name| std::env::var_os(name));
    let job = Job::new(scene).quality(0.1).integrator(integrator).size(size[0], size[1]).spp(spp);
    let picture = job.denoise(denoise, &places).run().unwrap();
    assert!(picture.warnings.is_empty(), "{:?}", picture.warnings);
    assert_eq!(picture.frame.film.is_denoised(), denoise != Denoise::Off);
    picture
}

fn layer(name: &str) -> &'static Layer {
    LAYERS.iter().find(|l| l.name == name).unwrap()
}

fn channels(picture: &Rendering, name: &str) -> Vec<Vec<f32>> {
    picture.frame.film.channels(layer(name))
}

#[test]
fn traced_light_loses_its_noise() {
    if installed().is_none() {
        return;
    }
    let scene = build(own("cornell-box"));
    let size = [64, 64];
    let colors = |spp, denoise| {
        let mut colors = Picture::new(size);
        let picture = picture(&scene, IntegratorKind::Path, size, spp, denoise);
        colors.add_colors("", SampleKind::Float, &picture.frame.film.radiance());
        colors
    };
    let reference = colors(256, Denoise::Off);
    let error = |image: &Picture| compare(image, &reference, &Options::default()).unwrap();
    let (noisy, clean) = (colors(4, Denoise::Off), colors(4, Denoise::On));
    let (noisy, clean) = (error(&noisy), error(&clean));
    assert!(clean.relmse < 0.5 * noisy.relmse, "{} {}", clean.relmse, noisy.relmse);
    let ratio = clean.mean_ratio.unwrap();
    assert!((ratio - 1.0).abs() < 0.03, "the denoised picture has {ratio} of the light");
}

#[test]
fn layers_sum_to_the_beauty_and_the_noisy_ones_are_kept() {
    if installed().is_none() {
        return;
    }
    let scene = build(own("glossy-still-life"));
    let size = [48, 32];
    for kind in [IntegratorKind::Path, IntegratorKind::Bdpt, IntegratorKind::Cache] {
        let before = picture(&scene, kind, size, 4, Denoise::Off);
        let after = picture(&scene, kind, size, 4, Denoise::On);
        let parts = PARTS.map(|name| channels(&after, name));
        for (c, beauty) in channels(&after, "").iter().take(3).enumerate() {
            for (p, light) in beauty.iter().enumerate() {
                let sum: f32 = parts.iter().map(|part| part[c][p]).sum();
                assert!((sum - light).abs() <= 1e-4 * light.abs().max(1e-3), "{kind:?} {p}");
            }
        }
        for name in &PARTS[..4] {
            let noisy = channels(&after, &format!("noisy.{name}"));
            assert!(noisy == channels(&before, name), "{kind:?}: noisy.{name}");
        }
        assert!(channels(&after, "emission") == channels(&before, "emission"));
        assert!(channels(&after, "variance") == channels(&before, "variance"));
        assert!(channels(&after, "diffuse_direct") != channels(&before, "diffuse_direct"));
        // Light of records stays as it is where the cache answered.
        if kind == IntegratorKind::Cache {
            let (status, noisy) = (channels(&before, "gi.status"), channels(&before, PARTS[1]));
            let same = |p: usize| parts[1].iter().zip(&noisy).all(|(a, b)| a[p] == b[p]);
            let cached = status[0].iter().enumerate().filter(|(_, s)| **s == 1.0);
            assert!(cached.clone().count() > 100 && cached.into_iter().all(|(p, _)| same(p)));
        }
    }
}

#[test]
fn threads_do_not_change_a_denoised_picture() {
    if installed().is_none() {
        return;
    }
    let scene = build(own("cornell-box"));
    let of = |threads: usize| {
        let render = || picture(&scene, IntegratorKind::Path, [64, 48], 2, Denoise::On);
        workers(threads).unwrap().install(render).frame.film.radiance()
    };
    let one = of(1);
    for threads in [2, 3, 8] {
        assert!(of(threads) == one, "{threads} threads");
    }
}

#[test]
fn a_picture_of_one_pixel_is_denoised() {
    let Some((denoiser, _)) = installed() else { return };
    let scene = build(own("cornell-box"));
    for kind in [IntegratorKind::Path, IntegratorKind::Cache] {
        let before = picture(&scene, kind, [1, 1], 16, Denoise::Off).frame.film.radiance()[0];
        let after = picture(&scene, kind, [1, 1], 16, Denoise::On).frame.film.radiance()[0];
        assert!(after.is_finite() && (after - before).length() < 0.5 * before.length());
    }
    let (wrong, right) = ([Color::ONE; 3], [Color::ONE; 4]);
    let noisy = Noisy { size: [2, 2], color: &wrong, albedo: &right, normal: &right };
    assert!(denoiser.run(&noisy, 1, &|_| true).unwrap_err().contains("2 x 2"));
}

#[test]
fn numbers_that_are_none_end_no_process() {
    let Some((denoiser, _)) = installed() else { return };
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX].map(Color::splat);
    let mixed: Vec<Color> =
        (0..48 * 40).map(|i| if i % 7 == 0 { bad[i % 4] } else { Color::ONE }).collect();
    let noisy = Noisy { size: [48, 40], color: &mixed, albedo: &mixed, normal: &mixed };
    assert_eq!(denoiser.run(&noisy, 2, &|_| true).unwrap().len(), 48 * 40);
}

#[test]
fn the_filter_tells_how_far_it_is_and_stops_when_told() {
    let Some((denoiser, _)) = installed() else { return };
    let light = vec![Color::ONE; 256 * 256];
    let noisy = Noisy { size: [256, 256], color: &light, albedo: &light, normal: &light };
    let heard = Mutex::new(Vec::new());
    let listen = |done| {
        heard.lock().unwrap().push(done);
        true
    };
    denoiser.run(&noisy, 2, &listen).unwrap();
    let heard = heard.into_inner().unwrap();
    assert!(heard.len() > 3 && heard.iter().all(|x| (0.0..=1.0).contains(x)), "{heard:?}");
    assert!(denoiser.run(&noisy, 2, &|_| false).is_err());
}

#[test]
fn a_watcher_sees_the_denoised_picture_last() {
    if installed().is_none() {
        return;
    }
    let scene = build(own("cornell-box"));
    let mut seen = Vec::new();
    let places = denoiser_places(|name| std::env::var_os(name));
    let job = Job::new(&scene).integrator(IntegratorKind::Path).size(40, 24).spp(1);
    let job = job.watcher(|area, film| seen.push((area, film.is_denoised())));
    job.denoise(Denoise::On, &places).run().unwrap();
    assert_eq!(seen.pop(), Some(([0, 0, 40, 24], true)));
    assert!(seen.iter().all(|(_, denoised)| !denoised));
}

/// A library with the functions of Open Image Denoise, made by the C compiler, of this version. Its
/// first filter fails, and the others leave the output as it is.
fn fake(folder: &Path, version: u32) -> PathBuf {
    let names = "CommitDevice ReleaseDevice SetDeviceBool SetDeviceInt SetSharedFilterImage \
                 SetFilterBool SetFilterInt SetFilterProgressMonitorFunction CommitFilter \
                 ReleaseFilter";
    let stubs = names.split_whitespace().map(|n| format!("int oidn{n}(void) {{ return 0; }}\n"));
    let source = format!(
        "{}void *oidnNewDevice(int t) {{ return (void *)16; }}\n\
         void *oidnNewFilter(void *d, const char *n) {{ return (void *)16; }}\n\
         int oidnGetDeviceInt(void *d, const char *n) {{ return {version}; }}\n\
         static int filters, fault;\n\
         int oidnExecuteFilter(void *f) {{ fault = filters++ ? 0 : 4; return 0; }}\n\
         int oidnGetDeviceError(void *d, const char **m) {{\n\
             int now = fault; fault = 0; *m = \"out of luck\"; return now;\n\
         }}\n",
        stubs.collect::<String>()
    );
    let (c, library) = (folder.join("fake.c"), folder.join(format!("fake-{version}.so")));
    std::fs::write(&c, source).unwrap();
    let output = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).arg(&c).output();
    let output = output.expect("a C compiler, which links Rust programs");
    assert!(output.status.success(), "{}", text(&output.stderr));
    std::fs::remove_file(c).unwrap();
    library
}

#[test]
fn a_library_that_is_missing_or_wrong_is_one_clear_line() {
    let desk = Desk::new();
    let folder = desk.path("libraries");
    std::fs::create_dir(&folder).unwrap();
    let text_file = folder.join("libOpenImageDenoise.so.2");
    std::fs::write(&text_file, "no library\n".repeat(100)).unwrap();
    let old = fake(&folder, 1_04_03);
    let cut_off = folder.join("cut-off.so");
    let bytes = std::fs::read(&old).unwrap();
    std::fs::write(&cut_off, &bytes[..bytes.len() / 2]).unwrap();
    let other = PathBuf::from("/lib/x86_64-linux-gnu/libm.so.6");
    let mut cases = vec![
        (folder.join("nowhere"), "was not found"),
        (text_file.clone(), "invalid ELF header"),
        (folder.clone(), "invalid ELF header"),
        (cut_off, "cut-off.so is incomplete"),
        (old, "is Open Image Denoise 1.4.3: 2.0 or newer is needed"),
    ];
    if other.exists() {
        cases.push((other, "it has no function oidnNewDevice"));
    }
    let room = scene("cornell-box");
    let quick = [&["render", &room, "-o", "out.exr", "--spp", "1", "--denoise"], QUICK].concat();
    for (path, word) in cases {
        let run = |choice: &str| {
            let mut arguments = quick.clone();
            arguments.insert(7, choice);
            desk.command(&arguments).env("LUMICACHE_OIDN", &path).output().unwrap()
        };
        let on = run("on");
        let error = text(&on.stderr);
        assert_eq!(on.status.code(), Some(1), "{error}");
        let clear = error.contains(word) && error.contains("make denoiser");
        assert!(clear && error.lines().count() == 1, "{error} does not say {word}");
        assert!(!desk.path("out.exr").exists());

        let auto = run("auto");
        let warning = text(&auto.stderr);
        assert_eq!(auto.status.code(), Some(0), "{warning}");
        let clear = warning.starts_with("lumicache: warning: not denoised:");
        assert!(clear && warning.contains(word) && warning.lines().count() == 1, "{warning}");
        assert!(mean(&exr::read(&desk.path("out.exr")).unwrap(), "G") > 0.0);
        std::fs::remove_file(desk.path("out.exr")).unwrap();

        let info = desk.command(&["info", "--denoiser"]).env("LUMICACHE_OIDN", &path).output();
        assert_eq!(info.unwrap().status.code(), Some(1));
    }
}

#[test]
fn a_filter_that_fails_leaves_the_picture_and_is_told_once() {
    let desk = Desk::new();
    let library = fake(&desk.path(""), 2_05_01);
    let walk = scene("glossy-walk");
    let flags = "--integrator path --spp 1 --denoise on --frames 3..5 -o a.%d.exr";
    let flags: Vec<&str> = flags.split(' ').collect();
    let arguments = [&["render", &walk], &flags[..], &QUICK[..2]].concat();
    let output = desk.command(&arguments).env("LUMICACHE_OIDN", &library).output().unwrap();
    let warning = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{warning}");
    assert!(warning.contains("out of luck") && warning.lines().count() == 1, "{warning}");
    let by = |name: &str| {
        let picture = exr::read(&desk.path(name)).unwrap();
        assert!(mean(&picture, "Z") > 0.0);
        picture.attribute("denoiser").cloned()
    };
    assert_eq!(by("a.3.exr"), None);
    assert_eq!(by("a.5.exr"), Some(Attribute::Text("Open Image Denoise 2.5.1".to_owned())));
}

#[test]
fn the_command_line_denoises() {
    let desk = Desk::new();
    let all = desk.render("cornell-box", &["--aov", "all"]);
    assert!(names(&all).iter().all(|name| !name.starts_with("noisy.")));
    if installed().is_none() {
        return;
    }
    assert!(desk.print(&["info", "--denoiser"]).starts_with("Open Image Denoise "));
    for choice in ["auto", "on"] {
        let flags = ["--aov", "all", "--denoise", choice, "--integrator", "path", "--float"];
        let denoised = desk.render("cornell-box", &flags);
        let difference = |name: &str| {
            let [clean, noisy] = ["", "noisy."].map(|prefix| {
                denoised.channel(&format!("{prefix}{name}")).unwrap().samples.clone()
            });
            clean.iter().zip(&noisy).filter(|(a, b)| a != b).count()
        };
        assert!(difference("diffuse_direct.G") > 100 && difference("diffuse_indirect.G") > 100);
    }
}
