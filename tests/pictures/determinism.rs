//! Same input, same bytes: for any number of threads and for any window.

use crate::support::pictures::{backends, cached, own, render, settings};
use lumicache::accel::Backend;
use lumicache::ffi::mxcsr;
use lumicache::math::Color;
use lumicache::render::{Facts, IntegratorKind, Selection, Settings, write_exr};
use lumicache::scene::Scene;

const SIZE: [u32; 2] = [36, 24];

/// Diffuse, glossy, coated and transparent things.
fn still_life(backend: Backend) -> Scene {
    Scene::new(own("glossy-still-life"), backend).unwrap().0
}

/// The whole file that a render on `threads` threads leaves, all layers.
fn file(scene: &Scene, settings: &Settings, threads: usize) -> Vec<u8> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .start_handler(|_| mxcsr::flush_denormals())
        .build()
        .unwrap();
    let frame = pool.install(|| render(scene, settings));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    write_exr(&path, &frame, settings, &Selection::parse("all").unwrap(), &Facts::default())
        .unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn threads_do_not_change_a_byte() {
    for &backend in backends() {
        let scene = still_life(backend);
        // Path tracing in more than one pass over the image; caching in one and in two passes, with
        // and without neighbour clamping and refinement.
        let mut all = vec![("path", settings(&scene, IntegratorKind::Path, SIZE, 18))];
        for preset in
            ["ward88", "tabellion04", "krivanek05", "krivanek06", "aric11", "zhao-view", "auto"]
        {
            let mut settings = cached(&scene, preset, SIZE, 2);
            (settings.scheme.gather.rays, settings.scheme.validity.error) =
                (64, 2.0 * settings.scheme.validity.error);
            all.push((preset, settings));
        }
        for (what, settings) in all {
            let one = file(&scene, &settings, 1);
            for threads in [2, 3, 8] {
                assert!(
                    file(&scene, &settings, threads) == one,
                    "{what} on {backend}: {threads} threads make another file than 1"
                );
            }
            // The comparison can fail.
            assert!(
                file(&scene, &Settings { seed: 1, ..settings }, 2) != one,
                "{what} on {backend}: the seed changes nothing"
            );
        }
    }
}

#[test]
fn a_crop_shows_the_same_noise() {
    for &backend in backends() {
        let scene = still_life(backend);
        let whole = settings(&scene, IntegratorKind::Path, SIZE, 3);
        // Neither the window's corners nor its size fit the tiles.
        let [x0, y0, x1, y1] = [7, 5, 31, 23];
        let part = Settings { window: [x0, y0, x1, y1], ..whole.clone() };
        let (whole, part) = (render(&scene, &whole), render(&scene, &part));
        assert_eq!(part.film.window_size(), [x1 - x0, y1 - y0]);
        let bits = |pixels: Vec<Color>| -> Vec<[u32; 3]> {
            pixels.iter().map(|c| c.to_array().map(f32::to_bits)).collect()
        };
        assert_eq!(
            bits(part.film.radiance()),
            bits(whole.film.area([x0, y0, x1, y1])),
            "{backend}"
        );
    }
}
