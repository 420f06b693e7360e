//! IES files: what is read, how it is evaluated and sampled, and what broken files give.

use crate::support::gltf_maker::{Gltf, triangle};
use crate::support::statistics::{Rng, assert_chi2};
use crate::support::testdata;
use lumicache::geometry::{Aabb, Geometry};
use lumicache::import::{ImportOptions, LightUnits, ies};
use lumicache::light::{IesProfile, Lights, Photometry, PunctualLight};
use lumicache::math::{Mat3, Vec2, Vec3};
use serde_json::json;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/import/corpus/ies")
}

fn own(name: &str) -> IesProfile {
    ies(&folder().join(format!("{name}.ies"))).unwrap_or_else(|e| panic!("{e}"))
}

/// The sound files of a folder, with their names.
fn sound(folder: &Path) -> Vec<(String, IesProfile)> {
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    let name = |p: &PathBuf| p.file_name().unwrap().to_string_lossy().into_owned();
    let wanted =
        |p: &PathBuf| p.extension().is_some_and(|e| e == "ies") && !name(p).starts_with("bad-");
    paths
        .iter()
        .filter(|p| wanted(p))
        .map(|p| (name(p), ies(p).unwrap_or_else(|e| panic!("{e}"))))
        .collect()
}

/// The direction of type C's angles in degrees.
fn type_c(v: f64, h: f64) -> Vec3 {
    let ((sv, cv), (sh, ch)) = (v.to_radians().sin_cos(), h.to_radians().sin_cos());
    Vec3::new((sv * ch) as f32, (sv * sh) as f32, -cv as f32)
}

/// The flux by the midpoint rule over the sphere, which knows nothing of the file's grid.
fn integrated(profile: &IesProfile) -> f64 {
    let (rows, columns) = (1440, 1440);
    let mut sum = 0.0;
    for i in 0..rows {
        let v = PI * (i as f64 + 0.5) / rows as f64;
        let row: f64 =
            (0..columns)
                .map(|j| {
                    f64::from(profile.intensity(type_c(
                        v.to_degrees(),
                        360.0 * (j as f64 + 0.5) / columns as f64,
                    )))
                })
                .sum();
        sum += row * v.sin();
    }
    sum * 2.0 * PI * PI / (rows * columns) as f64
}

#[test]
fn the_flux_is_the_integral_of_the_intensity() {
    let mut files = sound(&folder());
    assert_eq!(files.len(), 12);
    if let Some(folder) = testdata::find("scenes/ies") {
        files.extend(
            ["ieslibrary", "photometric-viewer"].iter().flat_map(|sub| sound(&folder.join(sub))),
        );
    }
    for (name, profile) in files {
        let (flux, expected) = (f64::from(profile.flux()), integrated(&profile));
        assert!(
            (flux / expected - 1.0).abs() < 0.002,
            "{name}: {flux} lm, integrated {expected} lm"
        );
    }
}

#[test]
fn known_distributions_have_their_known_flux() {
    // A Lambertian disc of 1000 cd: π times that. The same in a quadrant with three factors, its
    // azimuthal part averaging out.
    for (name, expected) in [
        ("c1-lambert-1995", 1000.0 * PI),
        ("c5-quadrant-1986", 800.0 * PI * 2.0 * 0.9 * 0.8),
        ("c-half-1991", 300.0 * 4.0 * PI),
        ("c-90-270-1995", 500.0 * PI),
        ("c-full-up-2002", 400.0 * PI * 1.5),
    ] {
        let flux = f64::from(own(name).flux());
        // Linear interpolation over steps of up to 10 degrees loses up to 0.3 %.
        assert!((flux / expected - 1.0).abs() < 0.004, "{name}: {flux}, not {expected}");
    }
}

#[test]
fn makers_files_have_the_flux_that_their_headers_state() {
    let Some(file) = testdata::find("scenes/ies/ieslibrary/007cfb11e343e2f42e3b476be4ab684e.ies")
    else {
        return;
    };
    // [LAMP] 321 lm, given as whole lumens.
    let flux = ies(&file).unwrap().flux();
    assert!((flux / 321.0 - 1.0).abs() < 0.01, "{flux}");
}

#[test]
fn directions_follow_the_types() {
    // Type C: H counter-clockwise from +X, V from -Z.
    let c = own("c-90-270-1995");
    assert_eq!(c.photometry(), Photometry::C);
    let at = |v, h| f64::from(c.intensity(type_c(v, h)));
    let formula = |v: f64, h: f64| {
        500.0 * v.to_radians().cos() * (1.0 - 0.6 * v.to_radians().sin() * h.to_radians().sin())
    };
    for (v, h) in [
        (0.0, 0.0),
        (30.0, 105.0),
        (30.0, 270.0),
        (45.0, 180.0),
        (30.0, 15.0),
        (45.0, 300.0),
        (60.0, 0.0),
    ] {
        // The file has two decimals.
        assert!(
            (at(v, h) - formula(v, h)).abs() < 0.01,
            "V {v}, H {h}: {} {}",
            at(v, h),
            formula(v, h)
        );
    }
    assert_eq!((at(91.0, 20.0), at(180.0, 0.0)), (0.0, 0.0));

    // Type B: V turns about Y, H leans from XZ towards -Y. Type A: H turns about X, V leans from YZ
    // towards X.
    let (b, a) = (own("b-full-2002"), own("a-full-2019"));
    let cos = |x: f64| x.to_radians().cos().max(0.0);
    let sin = |x: f64| x.to_radians().sin();
    for (v, h) in
        [(0.0, 0.0), (60.0, 30.0), (-30.0, 30.0), (30.0, -60.0), (-60.0, -30.0), (0.0, 60.0)]
    {
        let d = Vec3::new((cos(h) * sin(v)) as f32, -sin(h) as f32, (-cos(h) * cos(v)) as f32);
        let expected =
            2000.0 * cos(h).powi(3) * cos(v).powi(6) * (1.0 + 0.4 * sin(v) + 0.3 * sin(h));
        assert!(
            (f64::from(b.intensity(d)) - expected).abs() < 0.02,
            "B, V {v}, H {h}: {} {expected}",
            b.intensity(d)
        );
        let d = Vec3::new(sin(v) as f32, (-cos(v) * sin(h)) as f32, (-cos(v) * cos(h)) as f32);
        let expected =
            900.0 * cos(v).powi(4) * cos(h).powi(2) * (1.0 - 0.5 * sin(h) + 0.2 * sin(v));
        assert!(
            (f64::from(a.intensity(d)) - expected).abs() < 0.02,
            "A, V {v}, H {h}: {} {expected}",
            a.intensity(d)
        );
    }
    assert_eq!((b.intensity(Vec3::Z), a.intensity(Vec3::Z)), (0.0, 0.0));
}

#[test]
fn symmetric_distributions_are_extended() {
    let quadrant = own("c5-quadrant-1986");
    let half = own("c-half-1991");
    let (b, a) = (own("b-quadrant-1995"), own("a-half-1991"));
    let mut rng = Rng(3);
    for _ in 0..1000 {
        let d = rng.direction();
        let [x, y] = [Vec3::new(-d.x, d.y, d.z), Vec3::new(d.x, -d.y, d.z)];
        for (profile, images) in [
            (&quadrant, &[x, y, -x * Vec3::new(1.0, 1.0, -1.0)][..]),
            (&half, &[y]),
            (&b, &[x, y]),
            (&a, &[y]),
        ] {
            let value = profile.intensity(d);
            for image in images {
                assert!(
                    (profile.intensity(*image) - value).abs() <= 2e-3 * (1.0 + value),
                    "{d} {image}"
                );
            }
        }
    }
    // The plane of 0 to 180 mirrors, that of 90 to 270 does not.
    assert!(half.intensity(Vec3::X) > 2.0 * half.intensity(-Vec3::X));
}

#[test]
fn samples_follow_the_intensity() {
    let (rows, columns, count) = (36, 24, 200_000);
    for (name, profile) in sound(&folder()) {
        let mut rng = Rng(11);
        let mut observed = vec![0.0; rows * columns];
        let mut inverse = 0.0;
        for _ in 0..count {
            let d = profile.sample(rng.vec2()).unwrap();
            let pdf = profile.pdf(d);
            assert!((d.length() - 1.0).abs() < 1e-5 && pdf > 0.0, "{name}: {d} {pdf}");
            inverse += if profile.intensity(d) > 0.0 {
                f64::from(profile.intensity(d) / pdf)
            } else {
                0.0
            };
            let v = f64::from(-d.z).clamp(-1.0, 1.0).acos() / PI * rows as f64;
            let h = f64::from(d.y).atan2(f64::from(d.x)).rem_euclid(2.0 * PI) / (2.0 * PI)
                * columns as f64;
            observed[(v as usize).min(rows - 1) * columns + (h as usize).min(columns - 1)] += 1.0;
        }
        // The estimator of the flux has no variance.
        assert!(
            (inverse / f64::from(count) / f64::from(profile.flux()) - 1.0).abs() < 1e-4,
            "{name}"
        );
        let fine = 24;
        let mut expected = vec![0.0; rows * columns];
        for i in 0..rows * fine {
            let v = PI * (i as f64 + 0.5) / (rows * fine) as f64;
            for j in 0..columns * fine {
                let d = type_c(v.to_degrees(), 360.0 * (j as f64 + 0.5) / (columns * fine) as f64);
                let angle = 2.0 * PI * PI * v.sin() / (rows * columns * fine * fine) as f64;
                expected[i / fine * columns + j / fine] +=
                    f64::from(count) * angle * f64::from(profile.pdf(d));
            }
        }
        assert_chi2(&observed, &expected, &name);
    }
}

#[test]
fn tilt_dims_the_lamp() {
    let straight = own("c1-lambert-1995");
    assert_eq!(straight.tilt_factor(1.0), 1.0);
    let included = own("tilt-include-1995");
    for (degrees, factor) in
        [(0.0, 1.0), (22.5, 0.95), (45.0, 0.9), (67.5, 0.7), (90.0, 0.5), (180.0, 0.5)]
    {
        assert!(
            (included.tilt_factor(f32::to_radians(degrees)) - factor).abs() < 1e-5,
            "{degrees}"
        );
    }
    assert!((own("tilt-file-2002").tilt_factor(f32::to_radians(45.0)) - 0.9).abs() < 1e-5);
}

#[test]
fn a_luminaire_lights_the_points_it_shines_on() {
    let profile = own("c-90-270-1995");
    let light = |y: f32| PunctualLight::Ies {
        position: Vec3::new(0.0, y, 0.0),
        // Looks down: the profile's -Z is the world's -Y.
        from_world: Mat3::from_rotation_x(std::f32::consts::FRAC_PI_2),
        scale: Vec3::new(1.0, 0.5, 0.25),
        range: f32::INFINITY,
        profile: Arc::new(profile.clone()),
    };
    let bounds = Aabb { min: Vec3::splat(-5.0), max: Vec3::splat(5.0) };
    // Two of them, one of which looks away from what is above it.
    let lights =
        Lights::build(&Geometry::default(), vec![], vec![light(2.0), light(-3.0)], None, bounds);
    let p = Vec3::new(1.0, -0.5, 2.0);
    let to = Vec3::new(0.0, 2.0, 0.0) - p;
    let sample = lights.sample(p, Some(Vec3::Y), 0.3, Vec2::ZERO).unwrap();
    let expected = profile
        .intensity(Mat3::from_rotation_x(std::f32::consts::FRAC_PI_2) * -to.normalize())
        / to.length_squared();
    assert!(
        sample.delta && sample.pdf == 1.0 && (sample.wi - to.normalize()).length() < 1e-6,
        "{sample:?}"
    );
    assert!(
        (sample.radiance - expected * Vec3::new(1.0, 0.5, 0.25)).length() < 1e-4 * expected,
        "{sample:?} {expected}"
    );
    assert!(lights.sample(Vec3::new(0.0, 3.0, 1.0), None, 0.5, Vec2::ZERO).is_none());
}

#[test]
fn broken_files_name_the_line() {
    for row in std::fs::read_to_string(folder().join("expected.tsv")).unwrap().lines() {
        let (name, expected) = row.split_once('\t').unwrap();
        let file = folder().join(name);
        let text = ies(&file).map(|_| ()).unwrap_err().to_string();
        assert!(
            text.starts_with(file.to_str().unwrap()) && text.contains(expected),
            "{text}\nexpected {expected}"
        );
        assert!(!text.contains('\n') && text.len() < 400, "{text}");
    }
}

#[test]
fn files_cut_anywhere_do_not_panic() {
    let bytes = std::fs::read(folder().join("tilt-include-1995.ies")).unwrap();
    let none = |_: &str| Err(String::new());
    for end in 0..bytes.len() - 1 {
        let cut = IesProfile::parse(&bytes[..end], &none);
        // Only the end of the very last number may be missing without a trace.
        assert!(cut.is_err() || end + 5 > bytes.len(), "{end} bytes are read as a whole file");
    }
}

/// A document with a triangle and an IES file as the extension embeds it.
fn document() -> Gltf {
    let mut file = Gltf::new();
    triangle(&mut file);
    let view = file.view(&std::fs::read(folder().join("tilt-include-1995.ies")).unwrap(), None);
    file.extension(
        "EXT_lights_ies",
        json!({"lights": [{"bufferView": view, "mimeType": "application/x-ies-lm-63"}]}),
    );
    file.set("extensionsUsed", json!(["EXT_lights_ies", "KHR_lights_punctual"]));
    file.set("extensionsRequired", json!(["EXT_lights_ies"]));
    file
}

#[test]
fn gltf_places_luminaires_by_the_extension() {
    let mut file = document();
    let light = json!({"EXT_lights_ies": {"light": 0, "multiplier": 2.0, "color": [1, 0.5, 0.25]}});
    // -Z of the node becomes -Y: straight down.
    let half = 0.5f64.sqrt();
    let down =
        file.node(json!({"extensions": light, "translation": [1, 2, 3], "rotation": [-half, 0, 0, half], "scale": [3, 3, 3]}));
    // Without a rotation it looks along the horizon, where TILT says 0.5.
    let level = file.node(json!({"extensions": light}));
    file.scene(&[down, level]);
    for (units, unit) in [(LightUnits::Photometric, 1.0), (LightUnits::Radiometric, 1.0 / 683.0)] {
        let scene =
            file.load_with(&ImportOptions { light_units: units, ..ImportOptions::default() });
        let [
            PunctualLight::Ies { position, from_world, scale, range, profile },
            PunctualLight::Ies { scale: tilted, .. },
        ] = &scene.punctual[..]
        else {
            panic!("{:?}", scene.punctual)
        };
        assert_eq!((*position, *range), (Vec3::new(1.0, 2.0, 3.0), f32::INFINITY));
        assert!((*from_world * Vec3::NEG_Y - Vec3::NEG_Z).length() < 1e-6);
        assert!((*scale - 2.0 * unit * Vec3::new(1.0, 0.5, 0.25)).length() < 1e-6, "{scale}");
        assert!((*tilted - 0.5 * *scale).length() < 1e-6, "{tilted}");
        assert_eq!(profile.peak(), 1000.0);
    }
}

#[test]
fn mirrored_nodes_mirror_the_luminaire() {
    let mut file = document();
    let node =
        file.node(json!({"extensions": {"EXT_lights_ies": {"light": 0}}, "scale": [-1, 1, 1]}));
    file.scene(&[node]);
    let scene = file.load_with(&ImportOptions::default());
    let PunctualLight::Ies { from_world, .. } = &scene.punctual[0] else { panic!() };
    assert!(
        from_world.abs_diff_eq(Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)), 1e-6),
        "{from_world}"
    );
}

#[test]
fn gltf_names_luminaires_in_extras() {
    let text = std::fs::read_to_string(folder().join("c1-lambert-1995.ies")).unwrap();
    let uri =
        format!("data:application/x-ies-lm-63,{}", text.replace('\n', "%0A").replace(' ', "%20"));
    let build = |node: serde_json::Value, light: serde_json::Value| {
        let mut file = Gltf::new();
        triangle(&mut file);
        file.extension("KHR_lights_punctual", json!({"lights": [light]}));
        let mut node = node;
        node["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
        let node = file.node(node);
        file.scene(&[node]);
        file
    };
    let own = |key: &str, value: serde_json::Value| {
        let mut extras = json!({"lumicache": {"ies": uri}});
        extras["lumicache"][key] = value;
        extras
    };
    // On the light: absolute, and relative to its own intensity.
    for (extras, scale) in
        [(own("multiplier", json!(3)), 3.0), (own("relative", json!(true)), 0.05)]
    {
        let light = json!({"type": "spot", "spot": {}, "intensity": 50, "color": [1, 0.5, 0], "range": 9, "extras": extras});
        let scene = build(json!({}), light).load_with(&ImportOptions::default());
        let [PunctualLight::Ies { scale: actual, range, .. }] = &scene.punctual[..] else {
            panic!("{:?}", scene.punctual)
        };
        assert!(
            (*actual - scale * Vec3::new(1.0, 0.5, 0.0)).length() < 1e-6 && *range == 9.0,
            "{actual}"
        );
    }
    // On the node, beside a light of its own.
    let scene =
        build(json!({"extras": own("color", json!([0.5, 1, 1]))}), json!({"type": "point"}))
            .load_with(&ImportOptions::default());
    assert_eq!(scene.punctual.len(), 2);
    // Mistakes are named.
    for (extras, light, expected) in [
        (
            json!({}),
            json!({"type": "directional", "extras": own("multiplier", json!(1))}),
            "needs a light with a place",
        ),
        (own("mutliplier", json!(1)), json!({"type": "point"}), "\"mutliplier\" is unknown"),
        (
            json!({"lumicache": {"ies": "nowhere.ies"}}),
            json!({"type": "point"}),
            "/nodes/0/extras/lumicache/ies: cannot read",
        ),
        (
            json!({"lumicache": {"ies": "data:,IESNA91"}}),
            json!({"type": "point"}),
            "broken: line 1: there is no line TILT=",
        ),
    ] {
        let error = build(json!({"extras": extras}), light)
            .try_load(&ImportOptions::default())
            .map(|_| ())
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}
