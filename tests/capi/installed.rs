//! The installed C library: what it exports, and the examples, built against it through pkg-config
//! and CMake and run under the sanitizers and valgrind.
//!
//! `make test-capi` installs it and sets `LUMICACHE_PREFIX`; without that these tests say that they
//! are skipped.

use super::filled;
use lumicache::accel::Backend;
use lumicache::cache::{Preset, VIEWED};
use lumicache::geometry::extent;
use lumicache::geometry::{Geometry, Instance, SurfacePoint, TriangleMesh};
use lumicache::material::Material;
use lumicache::math::{Affine3A, Color, Vec3};
use lumicache::scene::{Scene, SceneData};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

fn prefix() -> Option<PathBuf> {
    let prefix = std::env::var_os("LUMICACHE_PREFIX").filter(|p| !p.is_empty()).map(PathBuf::from);
    if prefix.is_none() {
        eprintln!(
            "SKIPPED: the installed library (LUMICACHE_PREFIX is not set: run `make test-capi`)"
        );
    }
    prefix
}

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("ffi/examples")
}

fn scene() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("scenes/indirect-room.gltf")
        .to_str()
        .unwrap()
        .to_owned()
}

/// Runs `program` with the installed library and returns what it prints.
#[track_caller]
fn run(
    prefix: &Path, program: impl AsRef<std::ffi::OsStr>, arguments: &[&str], set: &[(&str, &str)],
) -> String {
    let mut command = Command::new(program.as_ref());
    command
        .args(arguments)
        .env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"))
        .env("LD_LIBRARY_PATH", prefix.join("lib"));
    command.envs(set.iter().copied());
    let output = command.output().unwrap_or_else(|e| panic!("{:?}: {e}", program.as_ref()));
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    );
    assert!(
        output.status.success(),
        "{:?} {arguments:?}: {}\n{out}\n{err}",
        program.as_ref(),
        output.status
    );
    out
}

/// Compiles an example through pkg-config, with every warning an error.
fn compile(prefix: &Path, folder: &Path, source: &str, flags: &str, name: &str) -> PathBuf {
    let program = folder.join(name);
    let compiler = if source.ends_with(".cpp") { "g++ -std=c++17" } else { "gcc -std=c99" };
    let script = format!(
        "{compiler} -pedantic -Wall -Wextra -Werror -O1 -g {flags} {} -o {} $(pkg-config --cflags --libs lumicache) -lm -lpthread",
        examples().join(source).display(),
        program.display()
    );
    run(prefix, "sh", &["-c", &script], &[]);
    program
}

#[test]
fn only_the_interface_is_exported() {
    let Some(prefix) = prefix() else { return };
    let library = prefix.join("lib/liblumicache.so");
    let library = library.to_str().unwrap();
    let symbols = run(&prefix, "nm", &["-D", "--defined-only", library], &[]);
    let names: Vec<_> = symbols.lines().filter_map(|l| l.split_whitespace().last()).collect();
    let header = std::fs::read_to_string(prefix.join("include/lumicache.h")).unwrap();
    let declared = crate::capi::header::declared(&header);
    assert_eq!(names, declared);
    // The archive: the same, and nothing of Rust's or C++'s, but for a variable of meshoptimizer of
    // the kind that the linker keeps unique by itself.
    let archive = run(
        &prefix,
        "nm",
        &["-g", "--defined-only", prefix.join("lib/liblumicache.a").to_str().unwrap()],
        &[],
    );
    let rows = archive.lines().map(|l| l.split_whitespace().collect::<Vec<_>>());
    let globals: Vec<_> = rows.filter(|r| r.len() == 3 && r[1] != "u").map(|r| r[2]).collect();
    assert!(
        globals.iter().all(|n| n.starts_with("lumi_")) && globals.len() >= declared.len(),
        "{globals:?}"
    );
    let dynamic = run(&prefix, "readelf", &["-d", library], &[]);
    assert!(
        dynamic.contains("[liblumicache.so.1]")
            && !dynamic.contains("embree")
            && !dynamic.contains("OpenEXR"),
        "{dynamic}"
    );
}

/// The Cornell-like box of host.c in Rust.
fn box_of_host_c() -> Scene {
    let (o, x, y, z) = (Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z);
    let diffuse = |r, g, b, emission| Material {
        base_color: Color::new(r, g, b),
        metallic: 0.0,
        roughness: 0.5,
        specular: 0.0,
        emission: Color::splat(emission),
        ..Material::default()
    };
    let materials = vec![
        diffuse(0.7, 0.7, 0.7, 0.0),
        diffuse(0.6, 0.1, 0.1, 0.0),
        diffuse(0.1, 0.5, 0.1, 0.0),
        diffuse(0.0, 0.0, 0.0, 15.0),
    ];
    let lamp = (Vec3::new(0.35, 0.99, 0.35), Vec3::new(0.3, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.3));
    let quads = [
        (o, z, x, 0),
        (y, x, z, 0),
        (o, x, y, 0),
        (o, y, z, 1),
        (x, z, y, 2),
        (lamp.0, lamp.1, lamp.2, 3),
    ];
    let mut geometry = Geometry::default();
    for (i, (o, a, b, material)) in quads.into_iter().enumerate() {
        let positions = vec![o, o + a, o + a + b, o + b];
        let mesh = TriangleMesh {
            positions: positions.into(),
            indices: vec![[0, 1, 2], [0, 2, 3]].into(),
            material,
            ..TriangleMesh::default()
        };
        geometry.meshes.push(Arc::new(mesh));
        geometry.instances.push(Instance { mesh: i as u32, to_world: Affine3A::IDENTITY });
    }
    Scene::new(SceneData { geometry, materials, ..SceneData::default() }, Backend::default())
        .unwrap()
        .0
}

#[test]
fn host_c_answers_as_the_rust_api_does_bit_for_bit() {
    let Some(prefix) = prefix() else { return };
    let folder = tempfile::tempdir().unwrap();
    let program = compile(&prefix, folder.path(), "host.c", "", "host");
    let printed = run(&prefix, &program, &["1"], &[]);
    assert_eq!(
        printed,
        run(&prefix, &program, &["3"], &[]),
        "the number of threads changes the answers"
    );

    let scene = box_of_host_c();
    let mut scheme = Preset::by_name("auto").unwrap().scheme();
    scheme.gather.rays = 256;
    let n = Vec3::Y;
    let at =
        |i: usize| Vec3::new(((i % 64) as f32 + 0.5) / 64.0, 0.0, ((i / 64) as f32 + 0.5) / 64.0);
    let footprint = VIEWED * extent(64 * 64, at).unwrap();
    let point = |i| SurfacePoint { footprint, ..SurfacePoint::plain(at(i), n) };
    let points: Vec<_> = (0..64 * 64).map(point).collect();
    let cache = filled(&scene, scheme, &points, 16_384, 0);
    let mut answered = 0;
    for (line, p) in printed.lines().zip(&points) {
        let words: Vec<_> = line.split(' ').collect();
        let answer = cache.lookup(0, p, u32::MAX);
        answered += usize::from(answer.is_some());
        let wanted = answer.map_or([0.0; 3], |a| a.irradiance.to_array());
        assert_eq!(words[0], if answer.is_some() { "0" } else { "2" });
        for (word, value) in words[1..].iter().zip(wanted) {
            assert_eq!(hex_float(word).to_bits(), value.to_bits(), "{line}: {wanted:?}");
        }
    }
    assert!(
        printed.lines().count() == points.len() && answered > 4000,
        "{answered} points answered"
    );
}

/// Reads what C's `%a` prints.
fn hex_float(text: &str) -> f32 {
    let (digits, exponent) = text.strip_prefix("0x").unwrap().split_once('p').unwrap();
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let mantissa = u64::from_str_radix(&format!("{whole}{fraction}"), 16).unwrap();
    let exponent = exponent.parse::<i32>().unwrap() - 4 * fraction.len() as i32;
    (mantissa as f64 * 2.0_f64.powi(exponent)) as f32
}

#[test]
fn the_examples_run_from_c_cpp_and_python() {
    let Some(prefix) = prefix() else { return };
    let folder = tempfile::tempdir().unwrap();
    let callback = compile(&prefix, folder.path(), "callback.c", "", "callback");
    assert!(run(&prefix, callback, &[], &[]).starts_with("irradiance 3.0"));
    let cpp = compile(&prefix, folder.path(), "host.cpp", "", "host_cpp");
    assert!(run(&prefix, cpp, &[&scene()], &[]).contains("mean irradiance"));
    let library = prefix.join("lib/liblumicache.so");
    let python = examples().join("host.py");
    let printed = run(
        &prefix,
        "python3",
        &[python.to_str().unwrap(), library.to_str().unwrap(), &scene()],
        &[],
    );
    assert!(printed.contains("Embree") && printed.contains("mean irradiance"), "{printed}");
}

#[test]
fn cmake_finds_the_package() {
    let Some(prefix) = prefix() else { return };
    let folder = tempfile::tempdir().unwrap();
    let build = folder.path().to_str().unwrap();
    let source = examples();
    run(
        &prefix,
        "cmake",
        &[
            "-S",
            source.to_str().unwrap(),
            "-B",
            build,
            &format!("-DCMAKE_PREFIX_PATH={}", prefix.display()),
        ],
        &[],
    );
    run(&prefix, "cmake", &["--build", build], &[]);
    let shared = run(&prefix, folder.path().join("host_c"), &[], &[]);
    // The program with the library inside needs no search path.
    let inside = run(Path::new("/nonexistent"), folder.path().join("host_c_static"), &[], &[]);
    assert!(shared == inside && shared.lines().count() == 64 * 64);
}

#[test]
fn the_examples_are_clean_under_the_sanitizers() {
    let Some(prefix) = prefix() else { return };
    let folder = tempfile::tempdir().unwrap();
    let flags = "-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer";
    // Leaks are valgrind's to find: the sanitizer's own search for them crashes when a worker
    // thread ends meanwhile.
    let set = [("ASAN_OPTIONS", "detect_leaks=0"), ("UBSAN_OPTIONS", "print_stacktrace=1")];
    for (source, arguments) in
        [("host.c", vec![]), ("callback.c", vec![]), ("host.cpp", vec![scene()])]
    {
        let program = compile(&prefix, folder.path(), source, flags, "sanitized");
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        run(&prefix, program, &arguments, &set);
    }
}

#[test]
fn the_examples_are_clean_under_valgrind() {
    let Some(prefix) = prefix() else { return };
    let folder = tempfile::tempdir().unwrap();
    // Valgrind knows no AVX-512: Embree chooses by the processor that it shows.
    for (source, arguments) in [("host.c", vec!["1".to_owned()]), ("callback.c", vec![])] {
        let program = compile(&prefix, folder.path(), source, "", "checked");
        let program = program.to_str().unwrap();
        let options = [
            "-q",
            "--error-exitcode=9",
            "--leak-check=full",
            "--errors-for-leak-kinds=definite",
            "--show-leak-kinds=definite",
        ];
        let all: Vec<&str> = options
            .into_iter()
            .chain([program])
            .chain(arguments.iter().map(String::as_str))
            .collect();
        run(&prefix, "valgrind", &all, &[]);
    }
}
