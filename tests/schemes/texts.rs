//! Schemes as texts: presets, files of users, settings by name, and the page that describes them.

use crate::support::pictures::{build, fill, own, seen};
use lumicache::cache::{
    Extrapolation, LevelPoints, Metric, PRESETS, Preset, RefinementRule, Schedule, settings,
    settings_page,
};
use std::collections::BTreeSet;
use std::path::Path;

#[test]
fn every_preset_reads_back() {
    for preset in PRESETS.iter() {
        let scheme = preset.scheme();
        scheme.check().unwrap();
        assert_eq!(Preset::by_name(&preset.name).unwrap().scheme(), scheme);
        for text in [&preset.text, &preset.to_toml()] {
            let again = Preset::from_text(text).unwrap();
            assert_eq!(again.scheme(), scheme, "{}", preset.name);
            assert_eq!((&again.source, &again.summary), (&preset.source, &preset.summary));
        }
        let json = serde_json::to_string(&scheme).unwrap();
        assert_eq!(serde_json::from_str::<lumicache::cache::Scheme>(&json).unwrap(), scheme);
    }
    assert!(Preset::by_name("nonsense").is_err());
}

#[test]
fn forty_six_settings_and_each_of_them_is_in_a_preset() {
    let names: BTreeSet<&str> = settings().iter().map(|s| s.name.as_str()).collect();
    assert_eq!((names.len(), settings().len()), (46, 46));
    let used: Vec<_> = PRESETS.iter().map(|p| p.scheme().settings()).collect();
    for name in names {
        assert!(used.iter().any(|u| u.contains_key(name)), "no preset has {name}");
    }
}

#[test]
fn settings_go_by_name_together_and_in_any_order() {
    let preset = |name: &str| Preset::by_name(name).unwrap().scheme();
    // Each of them alone would not go with what ward88 is.
    let pairs = [
        ("schedule", "scattered"),
        ("gather.noise", "0.1"),
        ("gather.strata", "concentric"),
        ("radius.metric", "hessian-average"),
        ("radius.area", "sectors"),
        ("extrapolation.kind", "second"),
        ("glossy.order", "8"),
        ("glossy.hits", "stored"),
    ];
    let (mut ahead, mut back) = (preset("ward88"), preset("ward88"));
    ahead.set_all(pairs).unwrap();
    back.set_all(pairs.into_iter().rev()).unwrap();
    assert_eq!(ahead, back);
    assert_eq!(ahead.glossy.unwrap().order, 8);

    // Kinds and groups come and go.
    let mut scheme = preset("ward88");
    scheme.set("extrapolation.kind", "axes").unwrap();
    assert_eq!(scheme.extrapolation, Extrapolation::Axes { error: 0.05, light_paths: 0 });
    scheme.set("extrapolation.kind", "first").unwrap();
    assert_eq!(scheme.extrapolation, Extrapolation::First);
    let weber = [("refinement.rule", "weber"), ("schedule", "scanline")];
    scheme.set_all(weber.into_iter().rev()).unwrap();
    assert_eq!(
        (scheme.refinement.unwrap().rule, scheme.schedule),
        (RefinementRule::Weber, Schedule::Scanline)
    );
    let mut scheme = preset("krivanek06");
    scheme.set_all([("refinement", "none"), ("glossy", "none")]).unwrap();
    assert!(scheme.refinement.is_none() && scheme.glossy.is_none());
}

#[test]
fn bad_settings_change_nothing_and_say_what_is_allowed() {
    let mut scheme = Preset::by_name("tabellion04").unwrap().scheme();
    let before = scheme.clone();
    for (key, value, words) in [
        ("validity.error", "-1", "above 0"),
        ("validity.error", "much", "a number"),
        ("validity.error", "1e99", "above 0"),
        ("validity.error", "1e-60", "above 0"),
        ("validity.normal_limit", "1.5708", "at most 1.5707964"),
        ("radius.metric", "mean", "harmonic, minimum, minimum-restricted, gradient-total"),
        ("radius.metrics", "mean", "radius.metric, radius.area"),
        ("validity.fences", "1", "true or false"),
        ("nothing", "1", "gather.strata, gather.rays"),
        ("gather.rays", "1", "from 16 to 1000000"),
        ("gather.rays", "16.5", "whole number"),
        ("extrapolation.error", "0.1", "`extrapolation.kind` is rotation"),
        ("glossy.loss", "0.1", "`glossy.order`"),
        ("glossy", "some", "none"),
        ("refinement.contrast", "0.1", "`refinement.rule`"),
        ("radius.max_pixels", "1", "radius.min_pixels"),
        ("gather.gradient", "triangulated", "gather.strata"),
        ("contents", "direct-and-indirect", "extrapolation.kind"),
    ] {
        let error = scheme.set(key, value).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains(words), "{key}={value}: {error}");
    }
    let both = [("glossy", "none"), ("glossy.order", "5")];
    assert!(scheme.set_all(both).unwrap_err().to_string().contains("no effect"));
    assert_eq!(scheme, before);
}

#[test]
fn one_factor_scales_all_that_says_how_careful_a_scheme_is() {
    let scaled = |preset: &str| {
        let before = Preset::by_name(preset).unwrap().scheme();
        let mut after = before.clone();
        after.scale_error(4.0);
        let [a, b] = [&after, &before].map(|s| s.refinement.unwrap_or_default());
        let [first, second] = [&after, &before].map(|s| s.extrapolation.axis_error());
        let axis = if second > 0.0 { first / second } else { 1.0 };
        (
            after.validity.error / before.validity.error,
            a.error_min / b.error_min,
            a.contrast / b.contrast,
            axis,
        )
    };
    assert_eq!(scaled("schwarzhaupt12"), (4.0, 1.0, 1.0, 1.0));
    assert_eq!(scaled("krivanek06"), (2.0, 4.0, 4.0, 1.0));
    assert_eq!(scaled("aric11"), (4.0, 1.0, 1.0, 4.0));
}

#[test]
fn a_new_scheme_is_one_text() {
    let text = "
source = \"Nobody\"
summary = \"smallest distances, refined\"
base = \"krivanek06\"

glossy = \"none\"
levels = 1

[gather]
rays = 64

[radius]
metric = \"minimum\"
";
    let preset = Preset::from_text(text).unwrap();
    let scheme = preset.scheme();
    assert_eq!((scheme.radius.metric, scheme.gather.rays), (Metric::Minimum, 64));
    let scene = build(own("staircase"));
    let points = LevelPoints::from(seen(&scene, &scene.cameras()[0], [24, 32], 0));
    let (cache, _) = fill(&scene, scheme, &points);
    assert!(cache.record_count() > 20);
    assert!(points.points.iter().all(|p| cache.lookup(0, p, u32::MAX).is_some()));
}

/// The settings of the guide are those of the program. `LUMICACHE_WRITE_DOCS=1` writes them there.
#[test]
fn the_guide_describes_the_settings() {
    let page = settings_page();
    assert!(page.lines().all(|line| line.chars().count() <= 100), "{page}");
    assert!(settings().iter().all(|s| page.contains(&format!("`{}`", s.name))), "{page}");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/guide/settings.md");
    let (begin, end) = ("<!-- settings -->\n", "<!-- end -->\n");
    let Ok(text) = std::fs::read_to_string(&path) else { return };
    let from = text.find(begin).expect("the page has a marker") + begin.len();
    let to = from + text[from..].find(end).expect("the page has a second marker");
    let right = format!("{}\n{page}\n{}", &text[..from], &text[to..]);
    if std::env::var_os("LUMICACHE_WRITE_DOCS").is_some() {
        std::fs::write(&path, &right).unwrap();
    } else {
        assert!(text == right, "docs/guide/settings.md is old: run with LUMICACHE_WRITE_DOCS=1");
    }
}
