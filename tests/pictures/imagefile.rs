//! Image files written and read back.

use lumicache::imagefile::{
    Attribute, Channel, Crop, Picture, REC_709, SampleKind,
    exr::{self, Encoder},
};
use std::path::Path;

/// Every encoder of this build.
const ENCODERS: &[Encoder] = &[
    #[cfg(feature = "openexr")]
    Encoder::OpenExr,
    Encoder::Exrs,
];

/// A hash of `n` to the unit interval.
fn noise(n: u32) -> f32 {
    let mut x = n.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    x = (x ^ (x >> 15)).wrapping_mul(0x2c1b_3c6d);
    x = (x ^ (x >> 12)).wrapping_mul(0x297a_2d39);
    ((x ^ (x >> 15)) >> 8) as f32 / (1 << 24) as f32
}

fn plane(
    name: &str, kind: SampleKind, [width, height]: [u32; 2], f: impl Fn(u32, u32) -> f32,
) -> Channel {
    let samples =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
    Channel { name: name.to_owned(), kind, samples }
}

/// Smooth and noisy channels of every kind. Values of `Half` channels are halves, so that nothing
/// is lost.
fn picture(width: u32, height: u32) -> Picture {
    let size = [width, height];
    let half = |x: f32| half::f16::from_f32(x).to_f32();
    Picture {
        width,
        height,
        channels: vec![
            plane("R", SampleKind::Half, size, |x, y| half(x as f32 / 64.0 + y as f32)),
            plane("B", SampleKind::Half, size, |x, y| half(noise(y * width + x))),
            plane("G", SampleKind::Half, size, |_, _| 0.5),
            plane("Z", SampleKind::Float, size, |x, y| (x as f32 + 0.3).hypot(y as f32)),
            plane("diffuse_indirect.R", SampleKind::Float, size, |x, y| 1e6 * noise(y * width + x)),
            plane("diffuse_indirect.a_name_longer_than_short", SampleKind::Float, size, |x, _| {
                -(x as f32)
            }),
            plane("gi.records", SampleKind::Uint, size, |x, y| (x * 4099 + y) as f32),
        ],
        attributes: vec![
            ("chromaticities".to_owned(), REC_709),
            ("comments".to_owned(), Attribute::Text("Küche, 12 µm".to_owned())),
            ("expTime".to_owned(), Attribute::Float(0.125)),
            ("gi.center".to_owned(), Attribute::V3f([1.0, -2.0, 3.5])),
            ("gi.lens".to_owned(), Attribute::V2f([0.25, 8.0])),
            ("gi.spp".to_owned(), Attribute::Int(-16)),
            ("seconds".to_owned(), Attribute::Double(1.0 / 3.0)),
            ("software".to_owned(), Attribute::Text("lumicache".to_owned())),
            ("worldToCamera".to_owned(), Attribute::M44f(std::array::from_fn(|i| i as f32 / 3.0))),
        ],
        crop: None,
    }
}

fn sorted(mut layers: Picture) -> Picture {
    layers.channels.sort_by(|a, b| a.name.cmp(&b.name));
    layers
}

fn in_pool<T: Send>(threads: usize, job: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(job)
}

fn written(path: &Path, layers: &Picture, encoder: Encoder) -> Vec<u8> {
    exr::write_with(path, layers, encoder).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn exr_files_read_back_exactly() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    // Less than a chunk, whole chunks, and a last chunk of one line.
    for (width, height) in [(1, 1), (5, 3), (64, 32), (131, 65)] {
        let mut layers = picture(width, height);
        for crop in [None, Some(Crop { origin: [7, -3], whole: [400, 300] })] {
            layers.crop = crop;
            for &encoder in ENCODERS {
                exr::write_with(&path, &layers, encoder).unwrap();
                assert_eq!(
                    exr::read(&path).unwrap(),
                    sorted(layers.clone()),
                    "{encoder:?} {width} x {height}"
                );
            }
        }
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary files stay");
}

#[test]
fn exr_bytes_do_not_depend_on_threads() {
    let dir = tempfile::tempdir().unwrap();
    let layers = picture(200, 150);
    for &encoder in ENCODERS {
        let one = in_pool(1, || written(&dir.path().join("1.exr"), &layers, encoder));
        for threads in [2, 3, 8] {
            assert!(
                one == in_pool(threads, || written(&dir.path().join("n.exr"), &layers, encoder)),
                "{encoder:?}, {threads} threads"
            );
        }
    }
}

#[test]
fn both_encoders_compress_alike() {
    if ENCODERS.len() < 2 {
        return; // Without OpenEXR there is nothing to compare.
    }
    let dir = tempfile::tempdir().unwrap();
    let size = [256, 256];
    let shade = |x: u32, y: u32| 0.5 + 0.4 * (0.02 * x as f32).sin() * (0.03 * y as f32).cos();
    // Smooth, and with 1 % of noise as a render has.
    for (noisiness, most) in [(0.0, 0.15), (0.02, 0.55)] {
        let channels = ["R", "G", "B"].map(|n| {
            plane(n, SampleKind::Half, size, |x, y| {
                shade(x, y)
                    * (1.0 + noisiness * (noise(y * 256 + x + u32::from(n.as_bytes()[0])) - 0.5))
            })
        });
        let layers =
            Picture { width: 256, height: 256, channels: channels.to_vec(), ..Picture::default() };
        let sizes: Vec<f64> = ENCODERS
            .iter()
            .map(|&e| written(&dir.path().join("a.exr"), &layers, e).len() as f64)
            .collect();
        assert!(sizes[0] / sizes[1] < 1.25 && sizes[1] / sizes[0] < 1.25, "{sizes:?}");
        assert!(sizes.iter().all(|s| *s < most * 256.0 * 256.0 * 6.0), "{sizes:?}");
    }
}

#[test]
fn exr_errors_name_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let missing = dir.path().join("missing/a.exr");
    for &encoder in ENCODERS {
        assert!(
            exr::write_with(&missing, &picture(4, 4), encoder)
                .unwrap_err()
                .to_string()
                .contains("missing/a.exr")
        );
        let bad = Picture { channels: vec![], ..picture(4, 4) };
        let path = dir.path().join("bad.exr");
        assert!(exr::write_with(&path, &bad, encoder).unwrap_err().to_string().contains("bad.exr"));
        assert!(!path.exists());
    }
    assert!(exr::read(&missing).unwrap_err().to_string().contains("missing/a.exr"));
}

/// A header of one float channel and the given data window and compression, followed by zeros.
fn claim(min: [i32; 2], max: [i32; 2], compression: u8, zeros: usize) -> Vec<u8> {
    let mut file = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        file.extend(
            [
                name.as_bytes(),
                b"\0",
                kind.as_bytes(),
                b"\0",
                &(value.len() as u32).to_le_bytes(),
                value,
            ]
            .concat(),
        );
    };
    let window: Vec<u8> =
        [min[0], min[1], max[0], max[1]].iter().flat_map(|v| v.to_le_bytes()).collect();
    attribute("channels", "chlist", b"R\0\x02\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0\0");
    attribute("compression", "compression", &[compression]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    file.extend(vec![0; 1 + zeros]);
    file
}

#[test]
fn hostile_exr_headers_fail_at_once() {
    let big = 999_999_999;
    for compression in 0..12 {
        for (min, max) in [
            ([0, 0], [big, big]),
            ([0, 0], [0, big]),
            ([0, 0], [big, 0]),
            ([i32::MIN, i32::MIN], [i32::MAX, i32::MAX]),
            ([5, 5], [0, 0]),
            ([0, 0], [99_999, 99_999]),
            ([0, 0], [9, 9]),
        ] {
            let start = std::time::Instant::now();
            let error = exr::read_bytes(&claim(min, max, compression, 100)).unwrap_err();
            assert!(
                !error.is_empty() && start.elapsed().as_secs_f64() < 2.0,
                "{compression} {max:?}: {error}"
            );
        }
    }
    assert!(exr::read_bytes(&claim([0, 0], [big, big], 3, 0)).unwrap_err().contains("cannot hold"));
}

#[test]
fn damaged_exr_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let good = written(&dir.path().join("a.exr"), &picture(40, 40), Encoder::Exrs);
    for length in (0..good.len()).step_by(97) {
        assert!(exr::read_bytes(&good[..length]).is_err(), "cut at {length}");
    }
    // Errors and unharmed readings are both fine; a panic is not.
    for round in 0..2000u32 {
        let mut bad = good.clone();
        for i in 0..3 {
            let place = (noise(round * 8 + i)
                * if round % 2 == 0 { 900.0 } else { good.len() as f32 })
                as usize;
            bad[place] = (256.0 * noise(round * 8 + 4 + i)) as u8;
        }
        let _ = exr::read_bytes(&bad);
    }
}

#[test]
fn the_damaged_files_of_openexr_are_errors_or_pictures() {
    let Some(folder) = crate::support::testdata::find("scenes/malformed/openexr-damaged-a") else {
        return;
    };
    let mut refused = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if let Err(e) = exr::read(&path) {
            assert!(e.to_string().contains(path.file_name().unwrap().to_str().unwrap()), "{e}");
            refused += 1;
        }
    }
    assert!(refused > 0);
}
