//! A process that does not grow. What is measured is the memory of a whole process, so each test
//! starts this binary again and has it do the work alone.

use crate::capi::{ask, build, cache, device, loaded, ok, seen, stats, text};
use lumicache::capi::*;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A number that the environment may set.
fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |n| n.parse().expect("a number"))
}

/// Bytes of this process in memory.
fn resident() -> u64 {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    4096 * pages.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()
}

/// Has a process do what the ignored test `name` does, and passes on what it says.
fn alone(name: &str) {
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", &format!("weather::soak::{name}"), "--ignored", "--nocapture"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    eprint!("{said}");
    assert!(output.status.success() && said.contains("MiB"), "{said}");
}

/// Most bytes that a process may grow by when nothing is lost: what the allocator keeps.
const SLACK: u64 = 12 << 20;

/// The variable `LIVES` says how often, by default 40 times.
#[test]
fn loading_building_saving_and_releasing_again_and_again_takes_no_memory() {
    alone("lives");
}

#[test]
#[ignore = "in a process of its own: see above"]
fn lives() {
    let lives = number("LIVES", 40);
    let folder = tempfile::tempdir().unwrap();
    let path = text(folder.path().join("a.lumi").to_str().unwrap());
    let mut middle = 0;
    for life in 0..lives {
        let d = device("threads=2");
        let s = loaded(&d, "indirect-room");
        let points = seen(&s, 300);
        let (first, second) = (cache(&s), cache(&s));
        ok(build(first.0, &points));
        ok(unsafe { lumi_cache_save(first.0, path.as_ptr()) });
        ok(unsafe { lumi_cache_load(second.0, path.as_ptr(), 0) });
        let answers = [&first, &second].map(|c| ask(c.0, &points, 0));
        assert!(answers[0].irradiance == answers[1].irradiance);
        if life == lives / 2 {
            middle = resident();
        }
    }
    let grown = resident().saturating_sub(middle);
    eprintln!("{lives} lives: {} MiB at half, {} KiB more at the end", middle >> 20, grown >> 10);
    assert!(grown < SLACK, "{grown} bytes more after {lives} lives than after half of them");
}

/// The variable `SOAK` says for how many seconds, by default 10.
#[test]
fn queries_go_on_while_builds_and_late_records_come() {
    alone("storm");
}

#[test]
#[ignore = "in a process of its own: see above"]
fn storm() {
    let time = Duration::from_secs(number("SOAK", 10));
    let d = device("threads=2");
    let s = loaded(&d, "indirect-room");
    let points = seen(&s, 600);
    let part = |k: usize, of: usize| {
        let own = |all: &[[f32; 3]]| all.iter().skip(k).step_by(of).copied().collect::<Vec<_>>();
        (own(&points.0), own(&points.1))
    };
    let folder = tempfile::tempdir().unwrap();
    let path = text(folder.path().join("a.lumi").to_str().unwrap());
    let (started, queries, builds) = (Instant::now(), AtomicU64::new(0), AtomicU64::new(0));
    let (mut middle, mut rounds) = (0, 0);
    while rounds == 0 || started.elapsed() < time {
        // A cache lives as long as a shot that an artist works on.
        let c = cache(&s);
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (handle, done, queries, part) = (c.0 as usize, &done, &queries, &part);
                scope.spawn(move || {
                    let handle = handle as lumi_cache;
                    let (all, own) = (part(0, 1), part(thread, 8));
                    while !done.load(Ordering::Relaxed) {
                        let answers = ask(handle, &all, 0);
                        assert!(answers.irradiance.iter().flatten().all(|x| x.is_finite()));
                        ask(handle, &own, LUMI_QUERY_FILL);
                        queries.fetch_add(2, Ordering::Relaxed);
                    }
                });
            }
            for k in 0..4 {
                ok(build(c.0, &part(k, 4)));
                ok(unsafe { lumi_cache_save(c.0, path.as_ptr()) });
                builds.fetch_add(1, Ordering::Relaxed);
            }
            done.store(true, Ordering::Relaxed);
        });
        assert!(stats(c.0).records > 0);
        rounds += 1;
        if middle == 0 && (rounds == 3 || started.elapsed() > time / 2) {
            middle = resident();
        }
    }
    let [queries, builds] = [queries, builds].map(|n| n.load(Ordering::Relaxed));
    let (seconds, grown) = (started.elapsed().as_secs(), resident().saturating_sub(middle.max(1)));
    eprintln!(
        "{seconds} s, {rounds} caches, {builds} builds, {queries} queries of up to 600 points: \
         {} MiB early, {} KiB more at the end",
        middle >> 20,
        grown >> 10
    );
    assert!(middle == 0 || rounds < 6 || grown < 2 * SLACK, "{grown} bytes more");
}
