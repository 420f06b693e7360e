//! Image metrics against values worked out by hand, and FLIP against its authors' program.

use lumicache::compare::{Options, compare, compare_files, compare_pixels, flip};
use lumicache::imagefile::ldr::decode_srgb;
use lumicache::imagefile::{Channel, Picture, SampleKind, exr};
use lumicache::math::Color;

fn layers(width: u32, height: u32, planes: &[(&str, &[f32])]) -> Picture {
    let channel = |&(name, samples): &(&str, &[f32])| Channel {
        name: name.to_owned(),
        kind: SampleKind::Float,
        samples: samples.to_vec(),
    };
    Picture { width, height, channels: planes.iter().map(channel).collect(), ..Picture::default() }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * b.abs()
}

#[test]
fn metrics_are_their_definitions() {
    let image = layers(2, 1, &[("R", &[1.5, 0.0]), ("G", &[2.0, 0.5]), ("B", &[0.0, 0.1])]);
    let reference = layers(2, 1, &[("R", &[1.0, 0.0]), ("G", &[2.0, 0.0]), ("B", &[0.0, 0.1])]);
    let report = compare(&image, &reference, &Options::default()).unwrap();
    assert_eq!((report.pixels, report.pixels_left_out), (2, 0));
    assert!(close(report.relmse, (0.25 / 1.01 + 0.25 / 0.01) / 6.0), "{report:?}");
    assert!(close(report.rmse, (0.5f64 / 6.0).sqrt()), "{report:?}");
    assert!(close(report.mape, (0.5 / 1.01 + 0.5 / 0.01) / 6.0), "{report:?}");
    assert!(close(report.mean_ratio.unwrap(), 4.1 / 3.1), "{report:?}");
    assert!(
        close(report.mean_ratio_rgb[0].unwrap(), 1.5)
            && close(report.mean_ratio_rgb[1].unwrap(), 1.25)
    );
    // On a display only the second green differs: 0.5 is encoded as 0.735357.
    assert!(
        (report.psnr.unwrap() + 10.0 * (0.735_357f64.powi(2) / 6.0).log10()).abs() < 1e-4,
        "{report:?}"
    );
    let json = serde_json::to_value(&report).unwrap();
    for key in ["relmse", "rmse", "mape", "mean_ratio", "mean_ratio_rgb", "psnr", "flip", "pixels"]
    {
        assert!(!json[key].is_null(), "{key}");
    }
    assert!(report.text().contains("relmse") && report.text().contains("2 compared"));
}

#[test]
fn equal_pictures_do_not_differ() {
    let image = layers(3, 1, &[("R", &[0.2, 5.0, 0.0]), ("G", &[0.1; 3]), ("B", &[0.0; 3])]);
    let report = compare(&image, &image, &Options::default()).unwrap();
    assert_eq!(
        (report.relmse, report.rmse, report.mape, report.flip, report.psnr),
        (0.0, 0.0, 0.0, 0.0, None)
    );
    assert_eq!(
        (report.mean_ratio, report.mean_ratio_rgb),
        (Some(1.0), [Some(1.0), Some(1.0), None])
    );
}

#[test]
fn pixels_of_reference_alpha_zero_are_left_out() {
    let rgb = |a: f32, b: f32| [("R", vec![a, b]), ("G", vec![a, b]), ("B", vec![a, b])];
    let with = |values: [(&str, Vec<f32>); 3], alpha: [f32; 2]| {
        let mut l = layers(2, 1, &values.each_ref().map(|(n, v)| (*n, v.as_slice())));
        l.channels.push(Channel {
            name: "A".to_owned(),
            kind: SampleKind::Half,
            samples: alpha.to_vec(),
        });
        l
    };
    // The image's own alpha has no say, and what is left out may even be NaN.
    let report = compare(
        &with(rgb(1.0, f32::NAN), [0.0, 1.0]),
        &with(rgb(1.0, 9.0), [0.5, 0.0]),
        &Options::default(),
    )
    .unwrap();
    assert_eq!((report.pixels, report.pixels_left_out, report.relmse), (1, 1, 0.0));
    assert!(
        compare(
            &with(rgb(1.0, 1.0), [1.0; 2]),
            &with(rgb(1.0, 1.0), [0.0; 2]),
            &Options::default()
        )
        .is_err()
    );
}

#[test]
fn what_cannot_be_compared_is_told() {
    let rgb = [("R", &[1.0f32, f32::NAN][..]), ("G", &[1.0, 1.0]), ("B", &[1.0, f32::INFINITY])];
    let good = layers(2, 1, &[("R", &[1.0, 2.0]), ("G", &[1.0, 1.0]), ("B", &[1.0, 1.0])]);
    let fails = |image: &Picture, reference: &Picture, options: &Options| {
        compare(image, reference, options).unwrap_err().to_string()
    };
    let plain = Options::default();
    assert!(fails(&layers(2, 1, &rgb), &good, &plain).contains(
        "the image: 1 of the compared pixels are NaN or infinite, the first at column 1, row 0"
    ));
    assert!(fails(&good, &layers(2, 1, &rgb), &plain).contains("the reference"));
    assert!(
        fails(&layers(1, 2, &rgb), &good, &plain).contains("1 x 2, but the reference is 2 x 1")
    );
    let prefixed = Options { channel_prefix: Some("diffuse_indirect".to_owned()) };
    assert!(
        fails(&good, &good, &prefixed).contains("no channel 'diffuse_indirect.R', only R, G, B")
    );
}

#[test]
fn files_are_compared_by_prefix_and_named_in_errors() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b, map) =
        (dir.path().join("a.exr"), dir.path().join("b.exr"), dir.path().join("flip.png"));
    let gray = |v: f32| {
        layers(
            4,
            4,
            &["x.R", "x.G", "x.B"]
                .map(|n| (n, vec![v; 16]))
                .each_ref()
                .map(|(n, v)| (*n, v.as_slice())),
        )
    };
    exr::write(&a, &gray(0.25)).unwrap();
    exr::write(&b, &gray(0.5)).unwrap();
    let comparison =
        compare_files(&a, &b, &Options { channel_prefix: Some("x".to_owned()) }).unwrap();
    assert!(close(comparison.report.mean_ratio.unwrap(), 0.5));
    comparison.write_flip_map(&map).unwrap();
    assert!(map.exists());
    let error = compare_files(&a, &b, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("a.exr") && error.contains("no channel 'R'"), "{error}");
}

/// Pictures of 8-bit sRGB bytes that stress one thing each: (name, reference, test).
fn pictures(width: u32, height: u32) -> Vec<(&'static str, Vec<u8>, Vec<u8>)> {
    let render = |f: &dyn Fn(f32, f32, u32) -> [f32; 3]| -> Vec<u8> {
        (0..width * height)
            .flat_map(|i| f((i % width) as f32, (i / width) as f32, i))
            .map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
            .collect()
    };
    let noise = |n: u32| {
        (n.wrapping_mul(2_654_435_761).wrapping_add(0x9e37) ^ (n << 7)).wrapping_mul(0x85eb_ca6b)
            as f32
            / u32::MAX as f32
    };
    let waves = |x: f32, y: f32| {
        [
            0.5 + 0.4 * (0.11 * x).sin(),
            0.5 + 0.4 * (0.07 * y).cos(),
            0.5 + 0.3 * (0.05 * (x + y)).sin(),
        ]
    };
    let smooth = render(&|x, y, _| waves(x, y));
    vec![
        (
            "noise",
            smooth.clone(),
            render(&|x, y, i| waves(x, y).map(|v| v + 0.2 * (noise(i) - 0.5))),
        ),
        ("brighter", smooth.clone(), render(&|x, y, _| waves(x, y).map(|v| v * 1.1))),
        (
            "hue",
            smooth.clone(),
            render(&|x, y, _| {
                let [r, g, b] = waves(x, y);
                [g, b, r]
            }),
        ),
        (
            "fireflies",
            smooth.clone(),
            render(&|x, y, i| if noise(i) > 0.99 { [1.0; 3] } else { waves(x, y) }),
        ),
        (
            "moved edge",
            render(&|x, _, _| [f32::from(x > 30.0); 3]),
            render(&|x, _, _| [f32::from(x > 32.0); 3]),
        ),
        (
            "dark",
            render(&|x, y, _| waves(x, y).map(|v| 0.05 * v)),
            render(&|x, y, i| waves(x, y).map(|v| 0.06 * v + 0.02 * noise(i))),
        ),
        ("opposite", render(&|_, _, _| [0.0; 3]), render(&|_, _, _| [1.0; 3])),
    ]
}

#[test]
fn flip_agrees_with_its_authors_program() {
    let (width, height) = (96, 64);
    for (name, reference, test) in pictures(width, height) {
        for pixels_per_degree in [flip::PIXELS_PER_DEGREE, 30.0] {
            let load = |bytes: &[u8]| nv_flip::FlipImageRgb8::with_data(width, height, bytes);
            let theirs = nv_flip::flip(load(&reference), load(&test), pixels_per_degree).to_vec();
            let linear = |bytes: &[u8]| -> Vec<Color> {
                bytes
                    .chunks(3)
                    .map(|c| Color::new(c[0].into(), c[1].into(), c[2].into()) / 255.0)
                    .map(|c| Color::from_array(c.to_array().map(decode_srgb)))
                    .collect()
            };
            let ours =
                flip::flip(&linear(&reference), &linear(&test), width as usize, pixels_per_degree);
            let mean = |v: &[f32]| v.iter().map(|&x| f64::from(x)).sum::<f64>() / v.len() as f64;
            let worst = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(mean(&theirs) > 0.005, "{name}: nothing to compare");
            assert!(
                (mean(&ours) - mean(&theirs)).abs() < 1e-3,
                "{name}: {} but {}",
                mean(&ours),
                mean(&theirs)
            );
            assert!(worst < 0.02, "{name}: a pixel differs by {worst}");
        }
    }
}

#[test]
fn flip_does_not_depend_on_threads() {
    let gradient =
        |k: f32| -> Vec<f32> { (0..40 * 30).map(|i| (i as f32 * k).sin().abs()).collect() };
    let planes = |k: f32| [("R", gradient(k)), ("G", gradient(2.0 * k)), ("B", gradient(3.0 * k))];
    let picture = |k: f32| layers(40, 30, &planes(k).each_ref().map(|(n, v)| (*n, v.as_slice())));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            compare_pixels(&picture(0.01), &picture(0.011), &Options::default()).unwrap()
        })
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert!(one == run(threads));
    }
}

#[test]
fn pictures_out_of_a_display_s_range_are_exposed_alike() {
    let gray = |values: [f32; 4], factor: f32| {
        let values = values.map(|x| factor * x);
        layers(4, 1, &["R", "G", "B"].map(|c| (c, &values[..])))
    };
    let measure = |factor: f32| {
        let (image, reference) = ([0.1, 0.2, 0.3, 0.5], [0.1, 0.18, 0.33, 0.5]);
        compare(&gray(image, factor), &gray(reference, factor), &Options::default()).unwrap()
    };
    // The median is the third of four: 0.33.
    let (plain, lux, dim) = (measure(1.0), measure(5000.0), measure(1e-4));
    assert_eq!(plain.exposure, 0.0);
    assert!((lux.exposure - (0.18_f32 / (5000.0 * 0.33)).log2()).abs() < 1e-4, "{lux:?}");
    assert!(lux.text().contains("exposure") && !plain.text().contains("exposure"));
    // Units do not matter.
    assert!((lux.psnr.unwrap() - dim.psnr.unwrap()).abs() < 1e-3, "{lux:?} {dim:?}");
    assert!((lux.flip - dim.flip).abs() < 1e-5 && lux.flip > 0.0, "{lux:?} {dim:?}");
    // Measures of light are those of the pictures as they are.
    assert!((lux.rmse / plain.rmse - 5000.0).abs() < 0.1);
    let black = layers(1, 1, &[("R", &[0.0]), ("G", &[0.0]), ("B", &[0.0])]);
    assert_eq!(compare(&black, &black, &Options::default()).unwrap().exposure, 0.0);
}
