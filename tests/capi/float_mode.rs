//! Hosts with a floating point mode of their own: another rounding, traps, denormals as zero.

use super::*;

unsafe extern "C" {
    fn fesetround(round: i32) -> i32;
    fn fegetround() -> i32;
    fn feenableexcept(traps: i32) -> i32;
    fn fedisableexcept(traps: i32) -> i32;
    fn fegetexcept() -> i32;
    fn feclearexcept(flags: i32) -> i32;
}

/// The roundings and the traps of <fenv.h>.
const NEAREST: i32 = 0;
const DOWNWARD: i32 = 0x400;
const UPWARD: i32 = 0x800;
const TOWARD_ZERO: i32 = 0xc00;
const ALL: i32 = 0x3d;

/// Positions and normals.
type Points = (Vec<[f32; 3]>, Vec<[f32; 3]>);

/// What a host expects to find whenever its code runs.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Mode {
    round: i32,
    traps: i32,
}

impl Mode {
    fn of_thread() -> Self {
        unsafe { Self { round: fegetround(), traps: fegetexcept() } }
    }

    fn set(self) {
        unsafe {
            feclearexcept(ALL);
            fedisableexcept(ALL);
            fesetround(self.round);
            feenableexcept(self.traps);
        }
    }
}

/// A tracer that does no arithmetic, which could trap, and notes whether its mode is right.
unsafe extern "C" fn strict(user: *mut c_void, batch: *mut lumi_ray_batch) -> i32 {
    let (mode, b) = unsafe { (&*user.cast::<Mode>(), &mut *batch) };
    if Mode::of_thread() != *mode {
        return 99;
    }
    for i in 0..b.n as usize {
        unsafe {
            let dir = b.dir.cast::<[f32; 3]>().add(i).read();
            b.distance.add(i).write(1.0);
            b.normal.cast::<[f32; 3]>().add(i).write(dir.map(|x| -x));
            b.radiance.cast::<[f32; 3]>().add(i).write([0.5; 3]);
            b.albedo.cast::<[f32; 3]>().add(i).write([0.5; 3]);
        }
    }
    0
}

unsafe extern "C" fn watching(user: *mut c_void, _: f64, _: *const c_char) -> i32 {
    i32::from(Mode::of_thread() != unsafe { *user.cast::<Mode>() })
}

/// What a thread in this mode is told: by a scene of the library's, then by one of its own.
fn told(mode: Mode, points: &[Points; 2]) -> Vec<[u32; 3]> {
    std::thread::scope(|scope| {
        let work = move || {
            let user = (&raw const mode).cast_mut().cast::<c_void>();
            mode.set();
            let d = device("threads=2");
            let own = loaded(&d, "indirect-room");
            let mut all = Vec::new();
            let mut work = |scene: &SceneHandle, points: &Points| {
                let c = cache(scene);
                ok(unsafe { lumi_cache_set_progress(c.0, Some(watching), user) });
                ok(build(c.0, points));
                all.extend(bits(&ask(c.0, points, 0).irradiance));
                all.extend(bits(&ask(c.0, points, LUMI_QUERY_FILL).irradiance));
            };
            work(&own, &points[0]);
            for flags in [0, LUMI_HOST_CONCURRENT] {
                let scene = empty_scene(&d);
                let desc = lumi_host_desc {
                    flags,
                    bounds_min: [-1.0; 3],
                    bounds_max: [1.0; 3],
                    trace: Some(strict),
                    user,
                    ..sized()
                };
                ok(unsafe { lumi_scene_set_host(scene.0, &raw const desc) });
                ok(unsafe { lumi_scene_commit(scene.0) });
                work(&scene, &points[1]);
            }
            drop((own, d));
            let after = Mode::of_thread();
            Mode { round: NEAREST, traps: 0 }.set();
            assert_eq!(after, mode, "the library changed the host's mode");
            all
        };
        scope.spawn(work).join().unwrap()
    })
}

#[test]
fn results_do_not_depend_on_the_host_s_mode_and_its_code_runs_in_it() {
    let d = device("");
    let points = [seen(&loaded(&d, "indirect-room"), 200), on_shell(100)];
    let plain = told(Mode { round: NEAREST, traps: 0 }, &points);
    assert!(plain.len() > 700);
    for (round, traps) in
        [(UPWARD, 0), (DOWNWARD, 0), (TOWARD_ZERO, 0), (NEAREST, ALL), (UPWARD, ALL)]
    {
        let mode = Mode { round, traps };
        assert!(told(mode, &points) == plain, "{mode:?} changes results");
    }
}

#[test]
fn denormals_as_zero_change_nothing() {
    let d = device("");
    let points = seen(&loaded(&d, "indirect-room"), 200);
    let told = || {
        let d = device("threads=1");
        let s = loaded(&d, "indirect-room");
        let c = cache(&s);
        ok(build(c.0, &points));
        bits(&ask(c.0, &points, 0).irradiance)
    };
    let plain = told();
    let _flushing = lumicache::ffi::mxcsr::FlushDenormals::new();
    assert!(told() == plain);
}
