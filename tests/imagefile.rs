//! Image files written and read back.

use lumicache::imagefile::exr::{self, Attribute, Channel, Crop, Encoder, Layers, SampleKind};
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

fn plane(name: &str, kind: SampleKind, [width, height]: [u32; 2], f: impl Fn(u32, u32) -> f32) -> Channel {
    let samples = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
    Channel { name: name.to_owned(), kind, samples }
}

/// Smooth and noisy channels of every kind. Values of `Half` channels are halves, so that nothing is lost.
fn picture(width: u32, height: u32) -> Layers {
    let size = [width, height];
    let half = |x: f32| half::f16::from_f32(x).to_f32();
    Layers {
        width,
        height,
        channels: vec![
            plane("R", SampleKind::Half, size, |x, y| half(x as f32 / 64.0 + y as f32)),
            plane("B", SampleKind::Half, size, |x, y| half(noise(y * width + x))),
            plane("G", SampleKind::Half, size, |_, _| 0.5),
            plane("Z", SampleKind::Float, size, |x, y| (x as f32 + 0.3).hypot(y as f32)),
            plane("diffuse_indirect.R", SampleKind::Float, size, |x, y| 1e6 * noise(y * width + x)),
            plane("diffuse_indirect.a_name_longer_than_short", SampleKind::Float, size, |x, _| -(x as f32)),
            plane("gi.records", SampleKind::Uint, size, |x, y| (x * 4099 + y) as f32),
        ],
        attributes: vec![
            ("chromaticities".to_owned(), exr::REC_709),
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

fn sorted(mut layers: Layers) -> Layers {
    layers.channels.sort_by(|a, b| a.name.cmp(&b.name));
    layers
}

fn in_pool<T: Send>(threads: usize, job: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(job)
}

fn written(path: &Path, layers: &Layers, encoder: Encoder) -> Vec<u8> {
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
                assert_eq!(exr::read(&path).unwrap(), sorted(layers.clone()), "{encoder:?} {width} x {height}");
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
