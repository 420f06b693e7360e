//! Files that ask for memory, work or other files.

use crate::cases::lenient::PIXEL;
use crate::support::desk::{Desk, text};
use crate::support::gltf_maker::{Gltf, floats, triangle};
use crate::support::testdata;
use lumicache::error::Error;
use lumicache::import::{ImportOptions, gltf};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// A file that the maker made, read from `path`.
fn write(path: &Path, file: &Gltf) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, file.glb()).unwrap();
}

#[test]
fn no_file_outside_the_scene_s_folder_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let scene = root.join("scene/a.glb");
    std::fs::create_dir_all(root.join("scene")).unwrap();
    std::fs::write(root.join("secret"), "root:x:0:0:IESNA:LM-63").unwrap();
    std::os::unix::fs::symlink(root.join("secret"), root.join("scene/link")).unwrap();
    let absolute = root.join("secret").display().to_string();
    let uris =
        ["../secret", "%2e%2e/secret", "x/../../secret", "link", "/etc/passwd", absolute.as_str()];
    let places: [&dyn Fn(&str) -> Gltf; 4] = [
        &|uri| {
            let mut file = Gltf::new();
            file.set("buffers", json!([{"byteLength": 1, "uri": uri}]));
            file
        },
        &|uri| {
            let mut file = Gltf::new();
            let position = file.positions(&[0.0; 9]);
            file.add("images", json!({"uri": uri}));
            file.add("textures", json!({"source": 0}));
            file.add("materials", json!({"emissiveTexture": {"index": 0}}));
            file.show(json!({"attributes": {"POSITION": position}, "material": 0}));
            file
        },
        &|uri| {
            let mut file = Gltf::new();
            file.node(json!({"extras": {"lumicache": {"ies": uri}}}));
            file
        },
        &|uri| {
            let mut file = Gltf::new();
            file.extension("EXT_lights_ies", json!({"lights": [{"uri": uri}]}));
            file
        },
    ];
    for uri in uris {
        for make in places {
            write(&scene, &make(uri));
            let error = gltf(&scene, &ImportOptions::default()).unwrap_err().to_string();
            assert!(error.contains("--allow-outside") && !error.contains("root:x"), "{error}");
            let outside = ImportOptions { allow_outside: true, ..ImportOptions::default() };
            let text = gltf(&scene, &outside).err().map_or(String::new(), |e| e.to_string());
            assert!(!text.contains("--allow-outside"), "{text}");
        }
    }
    // A photometric file inside the folder that names another one.
    let ies = "IESNA:LM-63-2002\nTILT=link\n1 1000 1 1 1 1 2 0 0 0\n1 1 10\n0\n0\n1\n";
    std::fs::write(root.join("scene/a.ies"), ies).unwrap();
    write(&scene, &places[2]("a.ies"));
    let error = gltf(&scene, &ImportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("outside the scene's folder") && !error.contains("root:x"), "{error}");
}

#[test]
fn the_program_reads_other_files_where_it_may() {
    let Some(file) = testdata::find("cases/weather/path-traversal/exfil.gltf") else { return };
    let (desk, file) = (Desk::new(), file.to_str().unwrap().to_owned());
    desk.fail(&["info", &file], &["/buffers/1/uri", "--allow-outside"]);
}

#[test]
fn no_control_character_of_a_file_reaches_the_terminal() {
    let desk = Desk::new();
    let evil = "a\u{1b}[2J\nb\u{202e}\u{85}";
    let mut texts = Vec::new();
    let mut say = |file: &Gltf| {
        std::fs::write(desk.path("a.glb"), file.glb()).unwrap();
        let output = desk.run(&["info", "a.glb"]);
        texts.push(text(&output.stdout) + &text(&output.stderr));
    };
    let with = |key: &str, value: Value| {
        let mut file = Gltf::new();
        triangle(&mut file);
        file.set(key, value);
        file
    };
    say(&with("buffers", json!([{"byteLength": 1, "uri": evil}])));
    say(&with("extensionsRequired", json!([evil])));
    say(&with("materials", json!([{"extras": {"lumicache": {"brdf": "phong", evil: 1}}}])));
    let lens = json!({"type": "perspective", "name": evil, "perspective": {"yfov": 1, "znear": 1}});
    let mut camera = with("cameras", json!([lens]));
    camera.node(json!({"camera": 0}));
    say(&camera);
    let mut anonymous = with("cameras", json!([{"type": evil}]));
    anonymous.node(json!({"name": evil}));
    say(&anonymous);
    let mut luminaire = Gltf::new();
    luminaire.node(json!({"extras": {"lumicache": {"ies": "a.ies"}}}));
    std::fs::write(desk.path("a.ies"), format!("IESNA:LM-63-2002\nTILT={evil}\n")).unwrap();
    say(&luminaire);
    std::fs::write(desk.path("a.glb"), format!("{{\"{evil}\": 1e999}}")).unwrap();
    std::fs::write(desk.path("b.gltf"), format!("{{\"{}\": 1e999}}", "a\\u001b[2J")).unwrap();
    for name in ["a.glb", "b.gltf"] {
        let output = desk.run(&["info", name]);
        texts.push(text(&output.stderr));
    }
    for text in texts {
        let bad = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
        assert!(!text.contains(bad), "{text:?}");
        if text.starts_with("lumicache:") {
            assert_eq!(text.lines().count(), 1, "{text:?}");
        }
    }
}

/// A PNG of one gray level, `side` pixels each way, with `chunks` before its pixels.
fn gray(side: u32, chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    let mut bytes = Vec::new();
    let pixels = vec![90; (side * side) as usize];
    PngEncoder::new(&mut bytes).write_image(&pixels, side, side, ExtendedColorType::L8).unwrap();
    // Behind the signature and the header of 25 bytes.
    let rest = bytes.split_off(33);
    for (kind, data) in chunks {
        bytes.extend((data.len() as u32).to_be_bytes());
        let body = [kind.as_slice(), data].concat();
        bytes.extend(&body);
        bytes.extend(checksum(&body).to_be_bytes());
    }
    bytes.extend(rest);
    bytes
}

/// The checksum of a PNG chunk.
fn checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, byte| {
        (0..8)
            .fold(sum ^ u32::from(*byte), |c, _| (c >> 1) ^ (0xEDB8_8320 & (c & 1).wrapping_neg()))
    })
}

#[test]
fn a_memory_limit_holds_before_memory_is_asked_for() {
    let mut file = Gltf::new();
    let position = file.positions(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let uv = file.accessor(&floats(&[0.0; 6]), 5126, "VEC2", 3, json!({}), None);
    let view = file.view(&gray(2000, &[]), None);
    file.add("images", json!({"bufferView": view, "mimeType": "image/png"}));
    file.add("textures", json!({"source": 0}));
    file.add("materials", json!({"emissiveTexture": {"index": 0}}));
    file.show(json!({"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "material": 0}));
    assert_eq!(file.load().textures.len(), 1);
    let limited = |bytes| ImportOptions { memory_limit: Some(bytes), ..ImportOptions::default() };
    let error = file.try_load(&limited(10_000_000)).unwrap_err();
    assert!(matches!(error, Error::OutOfMemory(_)), "{error}");
    let error = error.to_string();
    assert!(error.contains("/images/0: ") && error.contains("--memory-limit"), "{error}");
    assert!(file.try_load(&limited(40_000_000)).is_ok());
    let (desk, name) = (Desk::new(), "a.glb");
    write(&desk.path(name), &file);
    desk.fail(&["info", name, "--memory-limit", "1M"], &["--memory-limit"]);
    let said = desk.run(&["info", name, "--memory-limit", "64M"]);
    assert_eq!(said.status.code(), Some(0), "{}", text(&said.stderr));
    for wrong in ["0", "1Q", "-1", "18446744073709551615K"] {
        let said = desk.run(&["info", name, &format!("--memory-limit={wrong}")]);
        assert_eq!(said.status.code(), Some(2), "{wrong}");
    }
}

#[test]
fn profiles_inside_pictures_are_not_unpacked() {
    // 64 MiB of zeros, deflated: stored in a chunk that only the colours need.
    let picture = gray(4, &[(b"iCCP", [b"x\0\0".as_slice(), &deflated_zeros()].concat())]);
    let image = lumicache::imagefile::ldr::decode(&picture).unwrap();
    assert_eq!((image.width, image.height), (4, 4));
    assert!(lumicache::imagefile::ldr::memory(&picture) < 1000);
}

/// 64 MiB of zeros as a zlib stream, out of the pixels of a PNG.
fn deflated_zeros() -> Vec<u8> {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    let mut bytes = Vec::new();
    let zeros = vec![0; 1 << 26];
    PngEncoder::new(&mut bytes)
        .write_image(&zeros, 1 << 13, 1 << 13, ExtendedColorType::L8)
        .unwrap();
    let start = bytes.windows(4).position(|w| w == b"IDAT").unwrap();
    let length = u32::from_be_bytes(bytes[start - 4..start].try_into().unwrap()) as usize;
    bytes[start + 4..start + 4 + length].to_vec()
}

#[test]
fn millions_of_empty_nodes_take_little() {
    let desk = Desk::new();
    let nodes = vec!["{}"; 3_000_000].join(",");
    let json = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{nodes}]}}");
    std::fs::write(desk.path("a.gltf"), json).unwrap();
    // Less than they took when each became a node.
    let mut command = std::process::Command::new("sh");
    command.args(["-c", "ulimit -v 1500000; exec \"$0\" info \"$1\""]);
    command.args([env!("CARGO_BIN_EXE_lumicache"), desk.path("a.gltf").to_str().unwrap()]);
    let output = command.env("RAYON_NUM_THREADS", "1").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn work_is_bounded_by_the_size_of_the_file() {
    let started = Instant::now();
    // Nodes one below the other, each with a camera.
    let mut file = Gltf::new();
    let lens = json!({"yfov": 1, "znear": 1});
    file.add("cameras", json!({"type": "perspective", "perspective": lens}));
    for i in 1..10_000 {
        file.node(json!({"camera": 0, "children": [i]}));
    }
    file.node(json!({"camera": 0}));
    assert_eq!(file.load().cameras.len(), 10_000);
    // The same, all of it moved.
    let times = file.accessor(&floats(&[0.0, 1.0]), 5126, "SCALAR", 2, json!({}), None);
    let values = file.accessor(&floats(&[0.0; 6]), 5126, "VEC3", 2, json!({}), None);
    let target = json!({"node": 0, "path": "translation"});
    file.add(
        "animations",
        json!({"samplers": [{"input": times, "output": values}], "channels": [{"sampler": 0, "target": target}]}),
    );
    let error = file.try_load(&ImportOptions::default()).unwrap_err();
    assert!(matches!(error, Error::OutOfMemory(_)), "{error}");

    // Lamps that share a profile.
    let mut file = Gltf::new();
    let values = "1 ".repeat(181 * 361);
    let angles: String = (0..=180).map(|a| format!("{a} ")).collect();
    let planes: String = (0..=360).map(|a| format!("{a} ")).collect();
    let ies = format!(
        "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 181 361 1 2 0 0 0\n1 1 10\n{angles}\n{planes}\n{values}\n"
    );
    let view = file.view(ies.as_bytes(), None);
    let lights: Vec<Value> =
        (0..1000).map(|_| json!({"bufferView": view, "mimeType": "text/plain"})).collect();
    file.extension("EXT_lights_ies", json!({"lights": lights}));
    for light in 0..1000 {
        file.node(json!({"extensions": {"EXT_lights_ies": {"light": light}}}));
    }
    assert_eq!(file.load().punctual.len(), 1000);

    // Sparse accessors over the same lists.
    let mut file = Gltf::new();
    let count = 200_000u32;
    let places: Vec<u8> = (0..count).flat_map(u32::to_le_bytes).collect();
    let (places, values) =
        (file.view(&places, None), file.view(&vec![0; 12 * count as usize], None));
    for _ in 0..5000 {
        file.add(
            "accessors",
            json!({"componentType": 5126, "type": "VEC3", "count": count, "sparse": {"count": count,
                "indices": {"bufferView": places, "componentType": 5125}, "values": {"bufferView": values}}}),
        );
    }
    let error = file.try_load(&ImportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("cannot sensibly ask for so much"), "{error}");
    assert!(started.elapsed().as_secs() < 60, "{:?}", started.elapsed());
}

#[test]
fn a_picture_that_nothing_shows_takes_no_memory() {
    let mut file = Gltf::new();
    triangle(&mut file);
    let node = file.node(json!({"mesh": 0}));
    file.scene(&[node]);
    // The largest that is read at all.
    let view = file.view(&gray(16_384, &[]), None);
    file.add("images", json!({"bufferView": view, "mimeType": "image/png"}));
    file.add("images", json!({"uri": PIXEL}));
    file.add("textures", json!({"source": 0}));
    file.add("materials", json!({"emissiveTexture": {"index": 0}}));
    let limit = ImportOptions { memory_limit: Some(4 << 20), ..ImportOptions::default() };
    let scene = file.try_load(&limit).unwrap();
    assert!(scene.textures.is_empty() && scene.warnings.is_empty());
}
