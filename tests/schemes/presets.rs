//! Every scheme: how many records it makes, how far they reach, that they cover what they should,
//! and that they hold what they should.

use crate::support::pictures::{
    assert_alike, beauty, build, cached, clamp_to_neighbours, fill, one_level, own, render, scheme,
    sectors, seen, settings, with, with_rays,
};
use lumicache::cache::{
    Cache, Curve, Irradiance, Kernel, LevelPoints, PRESETS, Preset, RadiusRule, Record, Scheme,
    Validity, Weight,
};
use lumicache::gather::{Bundle, Deeper, RadianceProbe};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, Frame, Vec2, Vec3};
use lumicache::progress::Progress;
use lumicache::render::{IntegratorKind, Settings};
use lumicache::sampling::{Rng, square_to_cosine_hemisphere, square_to_disk};
use lumicache::scene::Scene;

const SIZE: [u32; 2] = [48, 64];

/// Ten steps: small features beside large flat ones. And what the camera sees of them.
pub fn staircase(round: usize) -> (Scene, LevelPoints) {
    let scene = build(own("staircase"));
    let points = seen(&scene, &scene.cameras()[0], SIZE, 0);
    assert!(points.len() > 2000);
    (scene, LevelPoints { points, round, ..LevelPoints::default() })
}

/// With few rays: what is tested here does not depend on their number.
pub fn quick(scheme: Scheme) -> Scheme {
    with_rays(scheme, 64)
}

/// Every preset, and a scheme of our own with what no preset has: sectors and extrapolation to
/// second order.
fn all() -> Vec<(&'static str, Scheme)> {
    let presets = PRESETS.iter().map(|p| (p.name.as_str(), p.scheme()));
    presets.chain([("sectors", sectors())]).collect()
}

#[test]
fn a_larger_error_needs_fewer_records() {
    let (scene, points) = staircase(0);
    for preset in PRESETS.iter() {
        let count = |factor: f32| {
            let scheme = quick(preset.scheme());
            let (cache, stats) =
                fill(&scene, with(scheme, |s| s.validity.error *= factor), &points);
            let records = cache.records(0).len();
            let layout = cache.scheme().layout(0);
            let (once, again) =
                (layout.rays() as u64, layout.with_rays(4 * layout.rays() as u32).rays() as u64);
            assert_eq!(
                stats.gather_rays,
                once * (records as u64 + stats.retaken) + again * stats.noisy
            );
            records
        };
        let counts = [0.5, 1.0, 2.0].map(count);
        assert!(
            counts[0] > counts[1] && counts[1] > counts[2] && counts[2] > 0,
            "{}: {counts:?} records",
            preset.name
        );
        eprintln!("{}: {counts:?}", preset.name);
    }
}

#[test]
fn records_are_numbers_and_reach_within_the_limits() {
    let (scene, points) = staircase(0);
    for preset in PRESETS.iter() {
        let (cache, _) = fill(&scene, quick(preset.scheme()), &points);
        let (scheme, reach) =
            (cache.scheme(), RadiusRule::new(cache.scheme(), 0, cache.extent(), 1.0));
        let scale =
            if scheme.validity.kernel == Kernel::Tabellion { scheme.validity.error } else { 1.0 };
        for r in cache.records(0) {
            assert!(
                r.position.is_finite()
                    && r.payload.irradiance.is_finite()
                    && r.payload.rotation.is_finite()
                    && r.payload.translation.is_finite()
            );
            assert!(
                r.payload.irradiance.min_element() >= 0.0
                    && r.sigma >= 0.0
                    && r.length >= 0.0
                    && !r.length.is_nan(),
                "{r:?}"
            );
            assert!(
                r.length <= r.length_unclamped
                    && r.footprint > 0.0
                    && (r.normal.length() - 1.0).abs() < 1e-4,
                "{r:?}"
            );
            let longest = scheme.radius.max_radius * cache.extent();
            let pixels = if scheme.radius.max_pixels > 0.0 {
                scheme.radius.max_pixels * r.footprint
            } else {
                f32::INFINITY
            };
            let (radius, slope) = reach.radius(r.length, r.footprint);
            assert!(
                radius <= 1.0001 * scale * longest.min(pixels),
                "{}: {radius} {r:?}",
                preset.name
            );
            assert!(
                radius >= 0.9999 * scale * (scheme.radius.min_pixels * r.footprint).min(longest),
                "{}: {radius} {r:?}",
                preset.name
            );
            assert!(slope > 0.0 && slope <= 1.0, "{}: {slope}", preset.name);
        }
    }
}

#[test]
fn every_point_that_was_filled_is_covered() {
    for round in [0, SIZE[0] as usize] {
        let (scene, points) = staircase(round);
        for preset in PRESETS.iter() {
            for neighbour_clamp in [false, true] {
                // Without smoothing: the reach under which the level was filled is the one it is
                // used with.
                let scheme = with(quick(preset.scheme()), |s| {
                    clamp_to_neighbours(s, neighbour_clamp);
                    s.validity.smoothing = 1.0;
                });
                // Clamping and gathering again change records after their round.
                let settled = !neighbour_clamp && scheme.gather.noise == 0.0;
                let (cache, stats) = fill(&scene, scheme, &points);
                let uncovered =
                    points.points.iter().filter(|p| cache.lookup(0, p, u32::MAX).is_none()).count();
                assert_eq!(
                    uncovered, 0,
                    "{}, neighbour clamping {neighbour_clamp}: points without a record",
                    preset.name
                );
                if !settled {
                    continue;
                }
                // One pass: the records that existed when a point's round ended are enough for it.
                assert_eq!(stats.births.len(), points.points.len());
                assert!(stats.births.is_sorted());
                let later = points
                    .points
                    .iter()
                    .zip(&stats.births)
                    .filter(|(p, b)| cache.lookup(0, p, **b).is_none())
                    .count();
                assert_eq!(later, 0, "{}: points whose records came later", preset.name);
            }
        }
    }
}

#[test]
fn no_record_is_used_beyond_the_limit_of_normals() {
    let scene = build(own("curved-spheres"));
    let points = LevelPoints::from(seen(&scene, &scene.cameras()[0], SIZE, 0));
    // One preset of each kernel, so careless that nothing else would end a record.
    for (preset, error) in
        [("ward-heckbert92", 3.0), ("tabellion04", 1.0), ("schwarzhaupt12", 1.0), ("aric11", 3.0)]
    {
        let counts = [0.2, 0.6].map(|normal_limit| {
            let scheme = quick(Preset::by_name(preset).unwrap().scheme());
            let careless = with(scheme, |s| {
                clamp_to_neighbours(s, false);
                s.radius.max_pixels = 0.0;
                s.validity = Validity { error, normal_limit, smoothing: 1.0, ..s.validity };
            });
            let (cache, _) = fill(&scene, careless, &points);
            let reach = RadiusRule::new(cache.scheme(), 0, cache.extent(), 1.0);
            let (mut used, mut widest) = (0, 0.0_f32);
            for (p, r) in
                points.points.iter().flat_map(|p| cache.records(0).iter().map(move |r| (p, r)))
            {
                if reach.error_of(r, p, f32::INFINITY).is_some_and(|e| e < 1.0) {
                    (used, widest) =
                        (used + 1, widest.max(p.frame.n.dot(r.normal).min(1.0).acos()));
                }
            }
            assert!(
                used > 1000 && widest < 1.001 * normal_limit && widest > 0.8 * normal_limit,
                "{preset}: {widest}"
            );
            cache.records(0).len()
        });
        assert!(counts[1] < counts[0], "{preset}: {counts:?} records");
    }
}

/// Pairs of records of which one reaches further than the other and the way between them allow.
fn missed(records: &[Record<Irradiance>]) -> usize {
    let excess = |a: &Record<Irradiance>, b: &Record<Irradiance>| {
        a.length - b.length - (a.position - b.position).length()
    };
    records
        .iter()
        .flat_map(|a| records.iter().map(move |b| (a, b)))
        .filter(|(a, b)| excess(a, b) > 1e-4 * a.length)
        .count()
}

#[test]
fn clamped_records_have_missed_no_feature() {
    let (scene, points) = staircase(0);
    for preset in PRESETS.iter() {
        let fill = |neighbour_clamp| {
            let clamp = |s: &mut Scheme| clamp_to_neighbours(s, neighbour_clamp);
            fill(&scene, with(quick(preset.scheme()), clamp), &points).0
        };
        // On this staircase records do miss the steps beside them when nothing is done about it.
        let free = fill(false);
        assert!(missed(free.records(0)) > 0, "{}: the test cannot fail", preset.name);
        let cache = fill(true);
        let records = cache.records(0);
        assert_eq!(missed(records), 0, "{}: |R_i - R_j| <= d_ij does not hold", preset.name);
        // The closed form: no record is shorter than its neighbours demand.
        for r in records {
            let limit = records
                .iter()
                .map(|j| j.length_unclamped + (r.position - j.position).length())
                .fold(f32::INFINITY, f32::min);
            assert!(
                (r.length - limit).abs() <= 1e-4 * limit,
                "{}: {} for {limit}",
                preset.name,
                r.length
            );
        }
    }
}

/// The weighted mean over all records, straight from the formulas: irradiance, error, number of
/// records.
fn brute_force(cache: &Cache, at: &SurfacePoint, limit: usize) -> Option<(Color, f32, u32)> {
    let scheme = cache.scheme();
    let reach = RadiusRule::new(scheme, 0, cache.extent(), scheme.validity.smoothing);
    let (mut sum, mut weights, mut errors, mut count) = (Color::ZERO, 0.0, 0.0, 0);
    for r in cache.records(0).iter().take(limit) {
        let (area, slope) = reach.area(r);
        let share = r.error / scheme.validity.error;
        let (offset, cosine) = (at.position - r.position, at.frame.n.dot(r.normal));
        let (d, position) = (offset.length(), area.share(r.normal, offset) / share);
        let error = reach.relative_error(position, cosine, reach.normal_scale() / share);
        let in_front = 0.5 * offset.dot(at.frame.n + r.normal) < -0.05 * d - 1e-4 * cache.extent();
        if cosine <= 0.0 || position >= 1.0 || error >= 1.0 || in_front {
            continue;
        }
        if !r.fences.admit(at.position) {
            continue;
        }
        let weight = match scheme.validity.weight {
            Weight::Inverse => 1.0 / (share * error.max(1e-6)),
            Weight::InverseMinusOne => (1.0 / error.max(1e-6) - 1.0) / share,
            Weight::Hat => 1.0 - error,
        };
        let linear = slope * (r.payload.translation * offset);
        let second = r.payload.curve.map_or(Color::ZERO, |c| {
            Curve { hessian: c.hessian * (slope * slope), ..c }.term(
                offset,
                linear,
                r.payload.irradiance,
            )
        });
        let value = match &r.payload.axes {
            Some(axes) => r.payload.irradiance + axes.at(r.normal, offset, at.frame.n).0,
            None => {
                r.payload.irradiance
                    + r.payload.rotation * r.normal.cross(at.frame.n)
                    + linear
                    + second
            }
        };
        sum += weight * value.max(Color::ZERO);
        weights += weight;
        errors += weight * error;
        count += 1;
    }
    (weights > 0.0).then(|| (sum / weights, errors / weights, count))
}

#[test]
fn the_index_finds_what_a_search_of_all_records_finds() {
    let (scene, points) = staircase(0);
    let mut rng = Rng::new(7);
    for (name, scheme) in all() {
        scheme.check().unwrap();
        let (cache, _) = fill(&scene, quick(scheme), &points);
        let records = cache.records(0);
        let reach =
            RadiusRule::new(cache.scheme(), 0, cache.extent(), cache.scheme().validity.smoothing);
        let mut found = 0;
        for k in 0..2000 {
            // Around a record out to a little beyond its reach, with its normal tilted by up to 40
            // degrees; every fourth one anywhere, turned anyhow.
            let r = &records[(rng.next_u64() % records.len() as u64) as usize];
            let frame = Frame::from_normal(r.normal);
            let (mut position, mut n) = (r.position, frame.n);
            if k % 4 == 0 {
                let b = scene.bounds();
                position = b.min
                    + (b.max - b.min) * Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32());
                n = frame.to_world(square_to_cosine_hemisphere(rng.next_2d()));
            } else {
                let radius = reach.area(r).0.longest();
                let offset = square_to_disk(rng.next_2d()).extend(0.1 * (rng.next_f32() - 0.5));
                position += 1.1 * radius * frame.to_world(offset);
                if k % 4 == 1 {
                    n = frame.to_world(
                        (0.8 * (rng.next_2d() - Vec2::splat(0.5))).extend(1.0).normalize(),
                    );
                }
            }
            let at =
                SurfacePoint { position, ng: n, frame: Frame::from_normal(n), ..points.points[0] };
            let limit = if k % 3 == 0 {
                rng.next_u64() as u32 % (records.len() as u32 + 1)
            } else {
                u32::MAX
            };
            let (mine, theirs) =
                (cache.lookup(0, &at, limit), brute_force(&cache, &at, limit as usize));
            let Some((irradiance, error, count)) = theirs else {
                assert!(
                    mine.is_none(),
                    "{}: {mine:?} at {position}, but no record is valid there",
                    name
                );
                continue;
            };
            let mine =
                mine.unwrap_or_else(|| panic!("{}: {count} records are valid at {position}", name));
            // A record whose error is 1 but for rounding may count on one side alone; its weight is
            // then as good as none, but for Ward's.
            assert!(
                mine.records.abs_diff(count) <= 1,
                "{}: {} records for {count}",
                name,
                mine.records
            );
            if mine.records == count {
                let tolerance = 1e-3 * irradiance.max_element();
                assert!(
                    (mine.irradiance - irradiance).abs().max_element() <= tolerance,
                    "{mine:?} for {irradiance}"
                );
                assert!(
                    (mine.error - error).abs() < 1e-3,
                    "{}: error {} for {error}",
                    name,
                    mine.error
                );
                found += 1;
            }
        }
        assert!(found > 500, "{}: only {found} points had records", name);
    }
}

#[test]
fn bounces_are_counted_as_by_the_path_tracer() {
    let scene = build(own("cornell-box"));
    let size = [32, 32];
    for max_bounces in [0, 1, 2, 3] {
        let path = Settings { max_bounces, ..settings(&scene, IntegratorKind::Path, size, 128) };
        let path = beauty(&render(&scene, &path));
        for preset in ["ward88", "tabellion04", "auto"] {
            let mut settings = Settings { max_bounces, ..cached(&scene, preset, size, 32) };
            settings.scheme.gather.rays = settings.scheme.gather.rays.min(256);
            let cache = beauty(&render(&scene, &settings));
            assert_alike(
                &format!("{preset}, {max_bounces} bounces"),
                &cache,
                &path,
                0.0,
                2e-3,
                0.01,
            );
        }
    }
}

/// Light from a wall, which is near on the left; a gather that starts in between lies behind a
/// facet and sees its back.
struct Hollow;

impl RadianceProbe for Hollow {
    fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        let x = from.position.x;
        let (distance, radiance) = if x < -0.01 {
            (0.05, 1.0)
        } else if x < -1e-4 {
            (1e-6, 0.0)
        } else {
            (10.0, 1.0)
        };
        bundle.distance.fill(distance);
        bundle.radiance.fill(Color::splat(radiance));
    }
}

#[test]
fn a_gather_that_is_repeated_behind_a_facet_is_thrown_away() {
    let scheme = with(one_level(with_rays(scheme("ward-heckbert92"), 64)), |s| {
        clamp_to_neighbours(s, true);
    });
    let mut cache = Cache::new(scheme, u32::MAX);
    let at = |x: f32| SurfacePoint {
        footprint: 0.01,
        ..SurfacePoint::plain(Vec3::new(x, 0.0, 0.0), Vec3::Z)
    };
    for row in [vec![at(-0.05), at(-0.03)], vec![at(0.0)]] {
        let stats =
            cache.fill(&Hollow, 0, &LevelPoints::from(row), 1, &Progress::default()).unwrap();
        assert_eq!(stats.retaken, 0);
    }
    let records = cache.records(0);
    assert_eq!(records.len(), 3);
    assert!(
        records.iter().all(|r| (r.payload.irradiance.x / std::f32::consts::PI - 1.0).abs() < 0.01),
        "{records:?}"
    );
}
