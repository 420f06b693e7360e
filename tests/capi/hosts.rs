//! Hosts that keep their scene: honest ones, failing ones and liars.

use super::*;
use std::sync::atomic::AtomicU64;

/// A closed shell of radius 1 with albedo 0.5 and reflected direct radiance 0.5, seen from inside:
/// the indirect irradiance is pi. How it misbehaves is in `lie`.
pub(super) struct Shell {
    lie: AtomicU32,
    calls: AtomicU64,
    largest: AtomicU32,
    threads: std::sync::Mutex<std::collections::HashSet<std::thread::ThreadId>>,
}

pub(super) unsafe extern "C" fn shell(user: *mut c_void, batch: *mut lumi_ray_batch) -> i32 {
    let (host, b) = unsafe { (&*user.cast::<Shell>(), &mut *batch) };
    host.calls.fetch_add(1, Ordering::Relaxed);
    host.largest.fetch_max(b.n, Ordering::Relaxed);
    host.threads.lock().unwrap().insert(std::thread::current().id());
    let lie = host.lie.load(Ordering::Relaxed);
    for i in 0..b.n as usize {
        unsafe {
            let (o, d) = (
                Vec3::from(b.origin.cast::<[f32; 3]>().add(i).read()),
                Vec3::from(b.dir.cast::<[f32; 3]>().add(i).read()),
            );
            assert!((d.length() - 1.0).abs() < 1e-4 && *b.bounce.add(i) >= 1);
            let half = o.dot(d);
            let t = -half + (half * half - o.length_squared() + 1.0).max(0.0).sqrt();
            b.distance.add(i).write(t);
            b.normal.cast::<[f32; 3]>().add(i).write((-(o + t * d)).normalize().to_array());
            b.radiance.cast::<[f32; 3]>().add(i).write([0.5; 3]);
            b.albedo.cast::<[f32; 3]>().add(i).write([0.5; 3]);
        }
    }
    let at = b.n as usize / 2;
    unsafe {
        match lie {
            1 => return 7,
            2 => b.distance.add(at).write(f32::NAN),
            3 => b.distance.add(at).write(-1.0),
            4 => b.radiance.add(3 * at).write(f32::INFINITY),
            5 => b.radiance.add(3 * at + 1).write(-0.1),
            6 => b.normal.add(3 * at).write(f32::NAN),
            7 => b.normal.add(3 * at).write(5.0),
            8 => b.albedo.add(3 * at).write(2.0),
            9 => b.albedo.add(3 * at).write(f32::NAN),
            10 => b.n += 1,
            11 => b.n = 0,
            _ => {}
        }
    }
    0
}

pub(super) fn host_scene(device: &Device, host: &Shell, flags: u32, max_batch: u32) -> SceneHandle {
    let scene = empty_scene(device);
    let user = (&raw const *host).cast_mut().cast();
    let desc = lumi_host_desc {
        flags,
        max_batch,
        bounds_min: [-1.0; 3],
        bounds_max: [1.0; 3],
        scene_hash: 5,
        trace: Some(shell),
        user,
        ..sized()
    };
    ok(unsafe { lumi_scene_set_host(scene.0, &raw const desc) });
    ok(unsafe { lumi_scene_commit(scene.0) });
    scene
}

pub(super) fn honest() -> Shell {
    Shell {
        lie: AtomicU32::new(0),
        calls: AtomicU64::new(0),
        largest: AtomicU32::new(0),
        threads: Default::default(),
    }
}

/// Points of the shell.
pub(super) fn on_shell(count: usize) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    (0..count)
        .map(|i| {
            let (z, phi) = (1.0 - 2.0 * (i as f32 + 0.5) / count as f32, 2.399_963 * i as f32);
            let r = (1.0 - z * z).sqrt();
            ([r * phi.cos(), r * phi.sin(), z], [-r * phi.cos(), -r * phi.sin(), -z])
        })
        .unzip()
}

#[test]
fn a_host_traces_and_the_answer_is_right() {
    let points = on_shell(400);
    let mut first: Option<Vec<[u32; 3]>> = None;
    for (flags, max_batch, threads) in [(0, 0, 2), (0, 100, 1), (LUMI_HOST_CONCURRENT, 0, 3)] {
        let (host, d) = (honest(), device(&format!("threads={threads}")));
        let s = host_scene(&d, &host, flags, max_batch);
        let c = cache(&s);
        ok(build(c.0, &points));
        let a = ask(c.0, &points, 0);
        let mean = a.irradiance.iter().map(|e| e[0]).sum::<f32>() / 400.0;
        // The series 0.5 + 0.25 + ... times pi; the deeper level interpolates.
        assert!((mean / std::f32::consts::PI - 1.0).abs() < 0.02, "{mean}");
        let callers = host.threads.lock().unwrap();
        if flags == 0 {
            assert_eq!(
                callers.iter().copied().collect::<Vec<_>>(),
                [std::thread::current().id()],
                "called from another thread"
            );
        } else {
            assert!(!callers.contains(&std::thread::current().id()));
        }
        let largest = host.largest.load(Ordering::Relaxed);
        assert!(
            if max_batch > 0 { largest <= max_batch } else { largest > 300 },
            "batches of up to {largest} rays"
        );
        let s = stats(c.0);
        assert_eq!(
            (s.host_calls, s.host_rays > s.rays),
            (host.calls.load(Ordering::Relaxed), true)
        );
        // Neither batches nor threads change a bit.
        assert!(
            bits(&a.irradiance) == *first.get_or_insert_with(|| bits(&a.irradiance)),
            "flags {flags}, batches of {max_batch}"
        );
    }
    // With all light in the answers there is one level and no path: 0.5 pi.
    let (host, d) = (honest(), device(""));
    let s = host_scene(&d, &host, LUMI_HOST_FULL, 0);
    let c = cache(&s);
    let a = ask(c.0, &points, LUMI_QUERY_FILL);
    let mean = a.irradiance.iter().map(|e| e[0]).sum::<f32>() / 400.0;
    assert!((mean / (0.5 * std::f32::consts::PI) - 1.0).abs() < 0.02, "{mean}");
}

#[test]
fn a_failing_or_lying_host_is_an_error_and_the_cache_lives_on() {
    let (host, points) = (honest(), on_shell(50));
    for flags in [0, LUMI_HOST_CONCURRENT] {
        let d = device("threads=2");
        let s = host_scene(&d, &host, flags, 0);
        for lie in 1..=11 {
            host.lie.store(lie, Ordering::Relaxed);
            let c = cache(&s);
            fails(
                build(c.0, &points),
                LUMI_ERROR_HOST_CALLBACK,
                if lie == 1 { "code 7" } else { "tracer" },
            );
            let query = lumi_query { flags: LUMI_QUERY_FILL, ..query_of(&points) };
            fails(
                unsafe { lumi_cache_query(c.0, &raw const query) },
                LUMI_ERROR_HOST_CALLBACK,
                "tracer",
            );
            assert_eq!(stats(c.0).records, 0);
            host.lie.store(0, Ordering::Relaxed);
            ok(build(c.0, &points));
            assert!(stats(c.0).records > 0);
        }
    }
}
