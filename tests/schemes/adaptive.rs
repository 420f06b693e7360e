//! Adaptive caching: the two conditions of full convergence, what the allowed errors follow, and
//! what it costs.

use crate::support::pictures::{build, cached, one_level, own, render, scheme};
use crate::support::refined::*;
use lumicache::cache::{
    Appearance, Appearances, Cache, Irradiance, LevelPoints, RadiusRule, RefinementRule,
};
use lumicache::film::LAYERS;
use lumicache::gather::{Bundle, Deeper, Density, HemisphereSamples, NoDeeper, RadianceProbe};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, luminance};
use lumicache::progress::Progress;
use lumicache::render::Frame as Picture;
use lumicache::transport::{PathTracer, SceneProbe};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::sync::atomic::{AtomicU64, Ordering};

/// What the two conditions of full convergence say of a level, straight from the formulas.
#[derive(Debug, Default)]
struct Verdict {
    uncovered: usize,
    /// Points at which a record that may still shrink makes a visible difference.
    visible: usize,
    /// Points at which only records that may not shrink any more do.
    excused: usize,
}

fn verdict(cache: &Cache, points: &[SurfacePoint], appearance: &[Appearance]) -> Verdict {
    let scheme = cache.scheme();
    let reach = RadiusRule::new(scheme, 0, cache.extent(), 1.0);
    let tolerance = 1e-4 * cache.extent();
    let mut verdict = Verdict::default();
    for (at, look) in points.iter().zip(appearance) {
        let mut valid = Vec::new();
        for r in records(cache) {
            let (radius, _) = reach.radius(r.length, r.footprint);
            if (at.position - r.position).length() > radius {
                continue;
            }
            let share = r.error / scheme.validity.error;
            if let Some(e) = reach.error_of(r, at, tolerance).filter(|e| *e < share) {
                let weight = scheme.validity.weight.at(e / share, 1.0 / share);
                let light = luminance(look.reflectance * extrapolated(r, &reach, at));
                // The floor: a_min, or where the record is as wide as pixels allow.
                let floor = (scheme.error_min() / scheme.validity.error)
                    .max(scheme.radius.min_pixels * r.footprint / radius)
                    .min(1.0);
                valid.push((
                    weight,
                    light,
                    luminance(look.reflectance) * r.sigma,
                    share > 1.0001 * floor,
                ));
            }
        }
        if valid.is_empty() {
            verdict.uncovered += 1;
        }
        if valid.len() < 2 {
            continue;
        }
        let mean = |without: usize| {
            let others: Vec<_> =
                valid.iter().enumerate().filter(|(k, _)| *k != without).map(|(_, v)| *v).collect();
            let w: f32 = others.iter().map(|v| v.0).sum();
            let variance: f32 = others.iter().map(|v| (v.0 * v.2).powi(2)).sum();
            (others.iter().map(|v| v.0 * v.1).sum::<f32>() / w, variance.sqrt() / w)
        };
        let (all, sigma) = mean(usize::MAX);
        let differs: Vec<bool> = (0..valid.len())
            .map(|k| {
                let (without, other) = mean(k);
                // Rounding may tip what is undecided.
                (all - without).abs()
                    > 1.0001
                        * (scheme.refinement.unwrap_or_default().contrast * (all + look.direct)
                            + sigma.max(other))
            })
            .collect();
        let nearest = (0..valid.len()).max_by(|a, b| valid[*a].0.total_cmp(&valid[*b].0)).unwrap();
        let spared = |k: usize| {
            k == nearest
                && scheme.refinement.is_some_and(|r| r.rule == RefinementRule::WeberNearest)
        };
        // The nearest one may differ alone: then another must go that differs from it.
        let apart = |k: usize| {
            let (a, b) = (&valid[k], &valid[nearest]);
            (a.1 - b.1).abs()
                > 1.0001
                    * (scheme.refinement.unwrap_or_default().contrast * (all + look.direct)
                        + a.2.max(b.2))
        };
        let removable = |k: usize| {
            valid[k].3
                && !spared(k)
                && (differs[k] || (spared(nearest) && differs[nearest] && apart(k)))
        };
        if (0..valid.len()).any(removable) {
            verdict.visible += 1;
        } else if differs.contains(&true) {
            verdict.excused += 1;
        }
    }
    verdict
}

#[test]
fn levels_converge_fully() {
    for (name, size) in [
        ("cornell-box", [72, 72]),
        ("staircase-room", [96, 72]),
        ("mirror-room", [80, 60]),
        ("curved-spheres", [80, 60]),
    ] {
        let scene = build(own(name));
        for preset in ["krivanek06", "hmdic"] {
            let r = Refined::scene(&scene, quick(preset), size);
            // The points of mirrored surfaces are among them.
            assert!(
                r.points.len() > (size[0] * size[1]) as usize * 3 / 4,
                "{name}: {} points",
                r.points.len()
            );
            let [_, stats] = &r.stats;
            let v = verdict(&r.cache, &r.points, &r.appearance);
            eprintln!(
                "{name}, {preset}: {} -> {} records, {} passes, {v:?}",
                r.unrefined,
                r.records().len(),
                stats.passes
            );
            assert!(v.uncovered == 0 && v.visible == 0, "{name}, {preset}: {v:?}");
            assert!(stats.passes <= 15 && stats.reductions > 0, "{name}, {preset}: {stats:?}");
            // Before refinement the conditions do not hold: the test can fail.
            let points = LevelPoints::from(r.points.clone());
            let mut cache = Cache::new(one_level(quick(preset)), u32::MAX);
            cache.fill(&probe(&scene), 0, &points, 0, &Progress::default()).unwrap();
            assert!(verdict(&cache, &r.points, &r.appearance).visible > 20, "{name}, {preset}");
            for record in r.records() {
                let scheme = r.cache.scheme();
                assert!(
                    record.error >= 0.9999 * scheme.error_min()
                        && record.error <= scheme.validity.error,
                    "{record:?}"
                );
            }
        }
    }
}

#[test]
fn lookups_respect_each_record_s_own_error() {
    let scene = build(own("cornell-box"));
    for preset in ["krivanek06", "hmdic"] {
        let r = Refined::scene(&scene, quick(preset), [64, 64]);
        let (scheme, reach) =
            (r.cache.scheme(), RadiusRule::new(r.cache.scheme(), 0, r.cache.extent(), 1.0));
        let mut several = 0;
        for at in &r.points {
            let (mut sum, mut weights, mut allowed, mut count) = (Color::ZERO, 0.0, 0.0, 0);
            for x in r.records() {
                let share = x.error / scheme.validity.error;
                if let Some(e) =
                    reach.error_of(x, at, 1e-4 * r.cache.extent()).filter(|e| *e < share)
                {
                    let w = scheme.validity.weight.at(e / share, 1.0 / share);
                    sum += w * extrapolated(x, &reach, at);
                    weights += w;
                    allowed += w * x.error;
                    count += 1;
                }
            }
            let answer = r.cache.lookup(0, at, u32::MAX);
            // A record whose area ends at the point but for rounding may count on one side alone.
            let Some(answer) = answer.filter(|a| a.records == count) else { continue };
            several += usize::from(count > 1);
            assert!(
                (answer.irradiance - sum / weights).abs().max_element()
                    <= 1e-3 * answer.irradiance.max_element()
            );
            assert!(
                (answer.allowed - allowed / weights).abs() < 1e-3,
                "{preset}: {} {}",
                answer.allowed,
                allowed / weights
            );
        }
        assert!(
            several * 3 > r.points.len(),
            "{preset}: only {several} points have more than one record"
        );
    }
}

/// CPU seconds of this thread.
fn cpu_seconds() -> f64 {
    let u = getrusage(UsageWho::RUSAGE_THREAD).unwrap();
    (u.user_time().num_microseconds() + u.system_time().num_microseconds()) as f64 * 1e-6
}

/// A probe that knows how long it took.
struct Timed<'a> {
    probe: SceneProbe<'a>,
    microseconds: AtomicU64,
}

impl RadianceProbe for Timed<'_> {
    fn incoming(&self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle) {
        let start = cpu_seconds();
        self.probe.incoming(from, level, deeper, bundle);
        self.microseconds.fetch_add(((cpu_seconds() - start) * 1e6) as u64, Ordering::Relaxed);
    }
}

#[test]
fn refinement_costs_little_beside_gathering() {
    let scene = build(own("staircase-room"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (all, gathering, looking) = pool.install(|| {
        let start = cpu_seconds();
        let (points, appearance): (Vec<_>, Vec<_>) = seen(&scene, [256, 192]).into_iter().unzip();
        let looking = cpu_seconds() - start;
        let tracer = PathTracer { scene: &scene, max_bounces: u32::MAX };
        let timed = Timed { probe: SceneProbe::new(tracer), microseconds: AtomicU64::new(0) };
        let start = cpu_seconds();
        let mut cache = Cache::new(scheme("krivanek06"), u32::MAX);
        let deeper = LevelPoints::from(
            tracer
                .next_points(&points, 16_384, 0, None)
                .into_iter()
                .map(|(p, _)| p)
                .collect::<Vec<_>>(),
        );
        let first = LevelPoints::from(points);
        cache.fill(&timed, 1, &deeper, 0, &Progress::default()).unwrap();
        cache.fill(&timed, 0, &first, 0, &Progress::default()).unwrap();
        let appearances = Appearances { of_points: appearance, lobes: None };
        cache.refine(&timed, 0, &first, &appearances, 0, &Progress::default()).unwrap();
        let all = cpu_seconds() - start;
        // What a record costs beside its rays: directions, estimates, gradients.
        let records: u64 = (0..2).map(|level| cache.records(level).len() as u64).sum();
        let (start, idle) = (cpu_seconds(), Cache::new(scheme("krivanek06"), 0));
        let (constant, reach) = (
            Field { radiance: |_, _| 1.0, distance: 1.0 },
            RadiusRule::new(idle.scheme(), 0, cache.extent(), 1.0),
        );
        let mut samples = HemisphereSamples::new(idle.scheme().layout(0), Density::Cosine);
        for at in &first.points[..256] {
            samples.gather(&constant, at, 0, &NoDeeper, 0);
            std::hint::black_box(Irradiance::gathered(idle.scheme(), &reach, at, &samples, None));
        }
        let estimates = (cpu_seconds() - start) / 256.0 * records as f64;
        (all, timed.microseconds.into_inner() as f64 * 1e-6 + estimates, looking)
    });
    let overhead = (all - gathering) / all;
    eprintln!(
        "fill {all:.2} s, of which gathering {gathering:.2} s: overhead {:.1} %; finding the points and their light {looking:.2} s",
        100.0 * overhead
    );
    assert!(overhead < 0.10, "{overhead}");
}

/// The values of a layer of one channel.
fn layer(picture: &Picture, name: &str) -> Vec<f32> {
    picture.film.channels(LAYERS.iter().find(|l| l.name == name).unwrap()).remove(0)
}

#[test]
fn the_layer_gi_a_shows_the_allowed_errors() {
    let scene = build(own("slit-light"));
    let a = |preset: &str| {
        let mut settings = cached(&scene, preset, [64, 48], 2);
        settings.scheme.gather.rays = 256;
        let picture = render(&scene, &settings);
        let answered = layer(&picture, "gi.records");
        let a: Vec<f32> = layer(&picture, "gi.a")
            .into_iter()
            .zip(answered)
            .filter(|(_, n)| *n > 0.0)
            .map(|(a, _)| a)
            .collect();
        assert!(a.len() > 2000);
        (a, settings.scheme)
    };
    let (constant, scheme) = a("ward-heckbert92");
    assert!(constant.iter().all(|a| (a - scheme.validity.error).abs() < 1e-5), "{constant:?}");
    let (map, scheme) = a("krivanek06");
    let (least, most) =
        map.iter().fold((f32::INFINITY, 0.0_f32), |(l, m), a| (l.min(*a), m.max(*a)));
    assert!(
        least >= 0.999 * scheme.error_min() && most <= 1.001 * scheme.validity.error,
        "{least} to {most}"
    );
    assert!(least < 0.5 * most, "{least} to {most}");
}

#[test]
fn bad_input_is_refused() {
    let scene = build(own("cornell-box"));
    let mut cache = Cache::new(scheme("krivanek06"), u32::MAX);
    let (points, appearance): (Vec<_>, Vec<_>) = seen(&scene, [4, 4]).into_iter().unzip();
    let points = LevelPoints::from(points);
    let refine = |cache: &mut Cache, appearance: &[Appearance]| {
        let appearances = Appearances { of_points: appearance.to_vec(), lobes: None };
        cache
            .refine(&probe(&scene), 0, &points, &appearances, 0, &Progress::default())
            .unwrap_err()
            .to_string()
    };
    assert!(refine(&mut cache, &appearance).contains("before it is filled"));
    cache.fill(&probe(&scene), 0, &points, 0, &Progress::default()).unwrap();
    assert!(refine(&mut cache, &appearance[1..]).contains("appearances"));
    let mut scheme = scheme("ward88");
    let weber = ("refinement.rule", "weber");
    assert!(scheme.set_all([weber]).unwrap_err().to_string().contains("schedule"));
    scheme.set_all([weber, ("schedule", "scanline")]).unwrap();
    assert_eq!(scheme.refinement.unwrap().rule, RefinementRule::Weber);
    for (key, value) in
        [("refinement.error_min", "0"), ("refinement.contrast", "-1"), ("refinement.rule", "more")]
    {
        assert!(scheme.set(key, value).unwrap_err().to_string().contains(key));
    }
}
