//! A host of Rust closures: what a gather gets does not depend on batches or threads, and a host
//! that fails or lies ends the work.

use lumicache::error::Error;
use lumicache::geometry::Aabb;
use lumicache::hosted::{Batch, Description, Exchange, Host, run};
use lumicache::math::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

fn description(concurrent: bool, max_batch: usize) -> Description {
    Description {
        bounds: Aabb { min: Vec3::ZERO, max: Vec3::ONE },
        scene_hash: 1,
        all_bounces: false,
        concurrent,
        environment: false,
        preferred_batch: 1000,
        max_batch,
    }
}

fn trace(batch: &mut Batch, range: Range<usize>) {
    for i in range {
        batch.distance[i] = batch.origin[i].x + batch.bounce[i] as f32;
        batch.normal[i] = Vec3::Z;
    }
}

/// How many gathers and threads; an interpreter takes a thousand times as long.
const GATHERS: u32 = if cfg!(miri) { 20 } else { 500 };
const THREADS: usize = if cfg!(miri) { 4 } else { 40 };

/// The sums of the distances that gathers of up to 30 rays see.
fn gathers(exchange: &Exchange) -> Vec<Option<f32>> {
    let one = |gather: u32| {
        let mut batch = Batch::default();
        for k in 0..gather % 7 * 5 {
            batch.push(Vec3::splat(gather as f32), Vec3::X, k, u64::from(gather + k));
        }
        let answers = exchange.ask(batch)?;
        assert!(answers.origin.iter().all(|o| o.x == gather as f32), "rays of another gather");
        Some(answers.distance.iter().sum())
    };
    (0..GATHERS).into_par_iter().map(one).collect()
}

#[test]
fn answers_do_not_depend_on_batches_and_threads() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(THREADS).build().unwrap();
    let alone: Vec<_> =
        (0..GATHERS).map(|g| Some((0..g % 7 * 5).map(|k| (g + k) as f32).sum::<f32>())).collect();
    for (concurrent, most) in [(false, usize::MAX), (false, 7), (true, usize::MAX), (true, 1)] {
        let tracer = move |batch: &mut Batch, range: Range<usize>| {
            assert!(range.len() <= most);
            trace(batch, range);
            Ok(())
        };
        let host = Host::new(description(concurrent, most), tracer).unwrap();
        assert_eq!(run(&pool, Some(&host), 3, || (), gathers).unwrap(), alone);
        let rays: u64 = (0..u64::from(GATHERS)).map(|g| g % 7 * 5).sum();
        assert_eq!(host.counts()[1], rays);
    }
}

#[test]
fn a_host_that_fails_or_lies_ends_the_work() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
    let lies: [fn(&mut Batch, usize); 4] = [
        |b, i| b.distance[i] = f32::NAN,
        |b, i| b.radiance[i].x = -1.0,
        |b, i| b.normal[i] = Vec3::ZERO,
        |b, i| b.albedo[i].y = 2.0,
    ];
    for (concurrent, lie) in [false, true].into_iter().flat_map(|c| lies.map(|l| (c, l))) {
        let calls = AtomicUsize::new(0);
        let tracer = move |batch: &mut Batch, range: Range<usize>| {
            let first = range.start;
            trace(batch, range);
            if calls.fetch_add(1, Ordering::Relaxed) == 4 {
                lie(batch, first);
            }
            Ok(())
        };
        let host = Host::new(description(concurrent, 50), tracer).unwrap();
        let outcome = run(&pool, Some(&host), 3, || (), gathers);
        assert!(matches!(outcome, Err(Error::Host(_))), "{outcome:?}");
    }
    let failing = |_: &mut Batch, _: Range<usize>| Err(Error::Host("no".into()));
    let host = Host::new(description(false, 50), failing).unwrap();
    assert!(run(&pool, Some(&host), 3, || (), gathers).is_err());
}
