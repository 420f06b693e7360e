//! Light must not pass through thin walls by way of the cache.

use crate::support::pictures::sectors;
use crate::support::pictures::{build, cached, own, render, scheme, with};
use lumicache::cache::Scheme;
use lumicache::math::Color;

/// Mean radiance of the left and of the right half of an image of `width` columns, the middle ones
/// left out.
fn halves(pixels: &[Color], width: usize) -> [f32; 2] {
    let mut sums = [0.0; 2];
    for row in pixels.chunks(width) {
        for (x, c) in row.iter().enumerate().filter(|(x, _)| x.abs_diff(width / 2) > 1) {
            sums[usize::from(x > width / 2)] += c.element_sum();
        }
    }
    sums.map(|s| 2.0 * s / (3 * pixels.len()) as f32)
}

#[test]
fn a_room_behind_a_wall_of_two_sheets_a_millimetre_apart_stays_black() {
    let scene = build(own("two-rooms-gap"));
    let size = [200, 100];
    let lit = |scheme: Scheme, fences: bool| {
        let mut settings = cached(&scene, "auto", size, 1);
        settings.scheme = with(scheme, |s| (s.validity.fences, s.gather.rays) = (fences, 256));
        halves(&render(&scene, &settings).film.radiance(), size[0] as usize)
    };
    let [left, right] = lit(scheme("auto"), true);
    assert!(left > 0.1 && right < 1e-5 * left, "{left} {right}");
    // Sectors from the Hessian reach as far as discs, and fences hold them back as well.
    let [left, right] = lit(sectors(), true);
    assert!(left > 0.1 && right < 1e-5 * left, "{left} {right}");
    // So do records with axes that hold direct light, but for a deeper record now and then whose
    // few rays did not find the wall.
    let [left, right] = lit(scheme("aric11"), scheme("aric11").validity.fences);
    assert!(left > 0.1 && right < 2e-4 * left, "{left} {right}");
    // Without fences records reach through the wall: the scene tests what it is meant to test.
    let [left, right] = lit(scheme("ward-heckbert92"), false);
    assert!(right > 1e-5 * left, "{left} {right}");
}
