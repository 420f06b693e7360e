//! Schemes compared on equal terms.

use crate::support::pictures::{build, cached, own};
use lumicache::bench::experiment::{Plan, run, variant};
use lumicache::progress::Progress;
use lumicache::render::Settings;
use std::path::Path;

fn plan(presets: &[&str], records: &[usize]) -> Plan {
    let presets = presets.iter().map(|p| (*p).to_owned()).collect();
    Plan {
        presets,
        settings: Vec::new(),
        records: records.to_vec(),
        rays: 64,
        reference_rays: 512,
        reference: None,
    }
}

#[test]
fn schemes_get_equally_many_records_and_their_errors_are_measured() {
    let scene = build(own("cornell-box"));
    let settings = cached(&scene, "auto", [48, 48], 1);
    let folder = tempfile::tempdir().unwrap();
    let go = |plan: &Plan, settings: &Settings| {
        run(&scene, settings, plan, "a & b", folder.path(), &Progress::default())
    };
    // One pass and two, with refinement and without.
    let first = plan(&["ward88", "krivanek06"], &[250, 400]);
    let report = go(&first, &settings).unwrap();
    assert_eq!(
        report.rows.iter().map(|r| (r.preset.as_str(), r.wanted)).collect::<Vec<_>>(),
        [("ward88", 250), ("ward88", 400), ("krivanek06", 250), ("krivanek06", 400)]
    );
    let noise = report.noise.unwrap();
    for r in &report.rows {
        assert!(r.equal && r.records.abs_diff(r.wanted) * 20 <= r.wanted, "{r:?}");
        // Every error holds the reference's noise; the caching adds to it, but not so much that
        // these were other pictures.
        assert!(
            r.relmse > noise && r.relmse < 0.05 && (r.mean_ratio.unwrap() - 1.0).abs() < 0.1,
            "noise {noise}, {r:?}"
        );
        assert_eq!(r.passes > 0, r.preset == "krivanek06");
        // What is left without the noise of the reference.
        let (own_rmse, own_relmse) = (r.own_rmse.unwrap(), r.own_relmse.unwrap());
        assert!((own_relmse - (r.relmse - noise)).abs() < 1e-12 && own_relmse > 0.0);
        assert!(
            (own_rmse.hypot(report.noise_rmse.unwrap()) - r.rmse).abs() < 1e-9 && own_rmse > 0.0
        );
        assert!([&r.picture, &r.difference].iter().all(|p| folder.path().join(p).exists()));
    }
    assert!(report.points > 2000 && report.points < 48 * 48);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&read("report.json")).unwrap();
    assert_eq!(json["rows"][1]["records"], report.rows[1].records);
    assert_eq!(read("report.csv").lines().count(), 1 + report.rows.len());
    let page = read("index.html");
    assert!(
        page.contains("a &amp; b")
            && page.matches("data:image/png;base64,").count() == 1 + 2 * report.rows.len()
    );

    // Radiance records on all surfaces are compared by their irradiance.
    let reused = Plan {
        reference: Some(folder.path().join("reference.exr")),
        ..plan(&["zhao-incoming"], &[250])
    };
    let row = go(&reused, &settings).unwrap().rows.remove(0);
    assert!(
        row.equal && row.uncovered == 0 && (row.mean_ratio.unwrap() - 1.0).abs() < 0.1,
        "{row:?}"
    );

    // The reference of one run serves another.
    let again =
        Plan { reference: Some(folder.path().join("reference.exr")), ..plan(&["ward88"], &[250]) };
    let row = go(&again, &settings).unwrap().rows.remove(0);
    assert_eq!((row.records, row.rmse), (report.rows[0].records, report.rows[0].rmse));

    // Settings of all presets, and of one.
    let changed = Plan {
        settings: vec![("radius.min_pixels".into(), "4".into())],
        ..plan(&["ward88", "ward88:radius.min_pixels=1"], &[250])
    };
    let report = go(&Plan { reference: again.reference.clone(), ..changed }, &settings).unwrap();
    assert_eq!((report.rows[1].records, report.rows[1].rmse), (row.records, row.rmse));
    assert!(
        report.rows[0].rmse != row.rmse
            && folder.path().join("ward88_radius.min_pixels_1-250.png").exists()
    );

    let refused = |plan: &Plan, settings: &Settings| go(plan, settings).unwrap_err().to_string();
    assert!(
        refused(&plan(&["ward88:validity.error"], &[10]), &settings).contains("`validity.error`")
    );
    assert!(refused(&plan(&["ward88:validity.error=-1"], &[10]), &settings).contains("error"));
    assert!(refused(&plan(&["nonsense"], &[10]), &settings).contains("nonsense"));
    assert!(refused(&plan(&["ward88"], &[]), &settings).contains("numbers of records"));
    assert!(
        refused(&plan(&["ward88"], &[10]), &Settings { max_bounces: 0, ..settings.clone() })
            .contains("bounces")
    );
    let other = Plan { reference: Some(Path::new("missing.exr").into()), ..first };
    assert!(refused(&other, &settings).contains("missing.exr"));
}

#[test]
fn presets_are_compared_within_the_same_bounds() {
    for preset in lumicache::cache::PRESETS.iter() {
        let scheme = variant(&preset.name, &[]).unwrap();
        assert_eq!(
            (scheme.validity.normal_limit, scheme.radius.min_pixels, scheme.radius.max_radius),
            (1.0, 1.0, 0.3),
            "{}",
            preset.name
        );
    }
    let scheme = variant(
        "mdic:radius.max_radius=0.2:validity.error=0.5",
        &[("radius.max_radius".into(), "0.1".into()), ("gather.rays".into(), "99".into())],
    )
    .unwrap();
    assert_eq!(
        (scheme.radius.max_radius, scheme.validity.error, scheme.gather.rays),
        (0.2, 0.5, 99)
    );
}
