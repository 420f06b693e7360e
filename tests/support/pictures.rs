//! Pictures made inside the tests: scenes, frames, and the evidence left behind when one is wrong.

use lumicache::accel::Backend;
use lumicache::cache::{Cache, Clamping, FillStats, LevelPoints, Preset, Scheme};
use lumicache::camera::Camera;
use lumicache::compare::{Options, Report, compare};
use lumicache::film::LAYERS;
use lumicache::geometry::SurfacePoint;
use lumicache::imagefile::{Channel, Picture, SampleKind, exr};
use lumicache::import;
use lumicache::progress::Progress;
use lumicache::render::{Denoise, Frame, IntegratorKind, Job, Settings};
use lumicache::sampling::hash;
use lumicache::scene::{Scene, SceneData};
use lumicache::transport::{CameraSample, PathTracer, SceneProbe};
use std::path::Path;

/// The back ends that are compiled in.
pub fn backends() -> &'static [Backend] {
    if cfg!(feature = "embree") { &Backend::ALL } else { &[Backend::Bvh] }
}

/// `scheme` after `change`.
pub fn with(mut scheme: Scheme, change: impl FnOnce(&mut Scheme)) -> Scheme {
    change(&mut scheme);
    scheme
}

/// `scheme` for the first level alone.
pub fn one_level(scheme: Scheme) -> Scheme {
    with(scheme, |s| s.levels = 1)
}

/// `scheme` with no more than `most` rays per record.
pub fn with_rays(scheme: Scheme, most: u32) -> Scheme {
    with(scheme, |s| s.gather.rays = s.gather.rays.min(most))
}

/// Lets the neighbours of records bound them, or not.
pub fn clamp_to_neighbours(scheme: &mut Scheme, clamped: bool) {
    scheme.clamping = match (scheme.clamping.gradient(), clamped) {
        (true, true) => Clamping::Both,
        (true, false) => Clamping::Gradient,
        (false, true) => Clamping::Neighbours,
        (false, false) => Clamping::None,
    };
}

/// The scheme of a preset.
pub fn scheme(preset: &str) -> Scheme {
    Preset::by_name(preset).unwrap().scheme()
}

/// One of our own scenes.
pub fn own(name: &str) -> SceneData {
    load(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.gltf")))
}

/// A scene file.
pub fn load(path: &Path) -> SceneData {
    import::gltf(path, &Default::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// A scene that rays can be traced in.
pub fn build(data: SceneData) -> Scene {
    Scene::new(data, Backend::default()).unwrap().0
}

/// The scene's first camera, `width` x `height` pixels, `spp` samples, no bound on paths, the
/// default preset.
pub fn settings(
    scene: &Scene, integrator: IntegratorKind, [width, height]: [u32; 2], spp: u32,
) -> Settings {
    Settings {
        integrator,
        scheme: scheme("auto"),
        camera: scene.cameras()[0].clone(),
        size: [width, height],
        window: [0, 0, width, height],
        spp,
        noise: 0.0,
        max_bounces: u32::MAX,
        seed: 0,
        prepass_only: false,
        denoise: Denoise::Off,
    }
}

/// [`settings`] of the caching integrator with a preset.
pub fn cached(scene: &Scene, preset: &str, size: [u32; 2], spp: u32) -> Settings {
    Settings { scheme: scheme(preset), ..settings(scene, IntegratorKind::Cache, size, spp) }
}

/// Renders.
pub fn render(scene: &Scene, settings: &Settings) -> Frame {
    Job::with_settings(scene, settings.clone()).run().unwrap().frame
}

/// The surface points at the first sample of each pixel, from which [`render`] fills the first
/// level, row by row.
pub fn seen(scene: &Scene, camera: &Camera, size: [u32; 2], seed: u64) -> Vec<SurfacePoint> {
    let tracer = PathTracer { scene, max_bounces: u32::MAX };
    (0..size[0] * size[1])
        .filter_map(|p| {
            let pixel = [p % size[0], p / size[0]];
            let seed = hash(&[seed, pixel[0].into(), pixel[1].into()]);
            let sample = CameraSample::new(camera, pixel, size, seed, 0, u32::MAX);
            Some(tracer.first_diffuse(&sample.camera, sample.seed)?.0)
        })
        .collect()
}

/// A cache of which only the first level is filled, at `points` in rounds of `round` (0: growing
/// ones).
pub fn fill(scene: &Scene, scheme: Scheme, points: &LevelPoints) -> (Cache, FillStats) {
    let mut cache = Cache::new(one_level(scheme), u32::MAX);
    let probe = SceneProbe::new(PathTracer { scene, max_bounces: u32::MAX });
    let stats = cache.fill(&probe, 0, points, 0, &Progress::default()).unwrap();
    (cache, stats)
}

/// The beauty of a frame. Alpha is 0 where it shows a lamp or the background: the edges of a lamp
/// would be most of any error.
pub fn beauty(frame: &Frame) -> Picture {
    let pixels = frame.film.radiance();
    let emission = &frame.film.channels(LAYERS.iter().find(|l| l.name == "emission").unwrap());
    let alpha = (0..pixels.len())
        .map(|p| if emission.iter().all(|c| c[p] == 0.0) { 1.0 } else { 0.0 })
        .collect();
    let mut picture = Picture::new(frame.film.window_size());
    picture.add_colors("", SampleKind::Float, &pixels);
    picture.add("A", SampleKind::Float, alpha);
    picture
}

/// The pixels x0, y0, x1, y1 (ends excluded) of a picture.
pub fn window(layers: &Picture, [x0, y0, x1, y1]: [u32; 4]) -> Picture {
    let cut = |c: &Channel| Channel {
        samples: (y0..y1)
            .flat_map(|y| {
                &c.samples[(y * layers.width + x0) as usize..(y * layers.width + x1) as usize]
            })
            .copied()
            .collect(),
        ..c.clone()
    };
    let channels = layers.channels.iter().map(cut).collect();
    Picture { width: x1 - x0, height: y1 - y0, channels, ..Picture::default() }
}

/// Means over squares of `side` pixels; what is left over at the right and at the bottom is
/// dropped. Alpha 0 spreads over its square.
pub fn blocks(layers: &Picture, side: u32) -> Picture {
    let (width, height) = (layers.width / side, layers.height / side);
    let square = |c: &Channel, b: u32| {
        let pixels = (0..side * side)
            .map(|k| (b / width * side + k / side) * layers.width + b % width * side + k % side);
        let samples = pixels.map(|p| c.samples[p as usize]);
        if c.name == "A" {
            samples.fold(1.0, f32::min)
        } else {
            samples.sum::<f32>() / (side * side) as f32
        }
    };
    let mean = |c: &Channel| Channel {
        samples: (0..width * height).map(|b| square(c, b)).collect(),
        ..c.clone()
    };
    Picture {
        width,
        height,
        channels: layers.channels.iter().map(mean).collect(),
        ..Picture::default()
    }
}

/// How far `image` is from `reference`.
pub fn difference(image: &Picture, reference: &Picture) -> Report {
    compare(image, reference, &Options::default()).unwrap()
}

/// Fails, leaving the image, the reference and their difference as files, unless relMSE less
/// `noise`, the reference's own, is at most `relmse` and the means differ by no more than the share
/// `mean`.
pub fn assert_alike(
    name: &str, image: &Picture, reference: &Picture, noise: f64, relmse: f64, mean: f64,
) {
    let report = difference(image, reference);
    let ratio = report.mean_ratio.unwrap();
    let measured = format!(
        "{name}: relmse {:.3e} (at most {relmse:.1e}), mean ratio {ratio:.5} (1 ± {mean})",
        report.relmse - noise
    );
    if report.relmse - noise <= relmse && (ratio - 1.0).abs() <= mean {
        return eprintln!("{measured}");
    }
    let minus = |c: &Channel| {
        let r = &reference.channel(&c.name).unwrap().samples;
        Channel { samples: c.samples.iter().zip(r).map(|(x, r)| x - r).collect(), ..c.clone() }
    };
    let channels = image.channels.iter().filter(|c| c.name != "A").map(minus).collect();
    let difference = Picture { channels, ..image.clone() };
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let stem = name.replace(|c: char| !c.is_alphanumeric(), "-");
    let files: Vec<_> = [("img", image), ("ref", reference), ("diff", &difference)]
        .iter()
        .map(|(kind, layers)| {
            let path = folder.join(format!("{stem}-{kind}.exr"));
            // Attributes of a file that was read may be those that every file has.
            let pixels = Picture { attributes: Vec::new(), crop: None, ..(*layers).clone() };
            exr::write(&path, &pixels)
                .map_or_else(|e| e.to_string(), |()| path.display().to_string())
        })
        .collect();
    panic!("{measured}\nsee {}", files.join("\n    "));
}

/// The default preset with sectors from the Hessian in the place of its discs.
pub fn sectors() -> Scheme {
    let settings = [
        ("gather.strata", "concentric"),
        ("gather.gradient", "triangulated"),
        ("radius.metric", "hessian-total"),
        ("radius.area", "sectors"),
        ("radius.nearest", "0"),
        ("validity.kernel", "schwarzhaupt"),
        ("validity.normal_limit", "0.2"),
        ("validity.error", "1e-5"),
        ("extrapolation.kind", "second"),
        ("clamping", "gradient"),
    ];
    with(scheme("auto"), |s| s.set_all(settings).unwrap())
}
