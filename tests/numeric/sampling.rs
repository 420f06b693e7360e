//! Random streams, the sampler and the warps.

use lumicache::sampling::*;

#[test]
fn streams_are_uniform_and_seeds_independent() {
    let mut sum = 0.0;
    let mut cross = 0.0;
    let n = 100_000;
    let (mut a, mut b) = (Rng::new(hash(&[1, 2])), Rng::new(hash(&[2, 1])));
    for _ in 0..n {
        let (x, y) = (a.next_f32(), b.next_2d().x);
        assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
        sum += f64::from(x);
        cross += (f64::from(x) - 0.5) * (f64::from(y) - 0.5);
    }
    // Standard errors 9e-4 and 2.6e-4: both bounds are beyond 4 sigma, false alarms below 1e-4.
    assert!((sum / f64::from(n) - 0.5).abs() < 4e-3);
    assert!((cross / f64::from(n)).abs() < 1.2e-3);
}

#[test]
fn the_first_sixteen_points_are_stratified_in_both_dimensions() {
    for seed in 0..20 {
        let mut rows = [0; 16];
        let mut columns = [0; 16];
        for i in 0..16 {
            let p = Sampler::new(hash(&[seed]), i).next_2d();
            rows[(p.x * 16.0) as usize] += 1;
            columns[(p.y * 16.0) as usize] += 1;
        }
        assert!(rows.iter().chain(&columns).all(|&c| c == 1), "seed {seed}");
    }
}

#[test]
fn many_dimensions_stay_in_range() {
    let mut sampler = Sampler::new(7, 3);
    for _ in 0..2000 {
        assert!((0.0..1.0).contains(&sampler.next_1d()));
    }
}

#[test]
fn warps_invert() {
    let mut rng = Rng::new(1);
    for _ in 0..1000 {
        let u = rng.next_2d();
        assert!((disk_to_square(square_to_disk(u)) - u).length() < 1e-5, "{u}");
        assert!(
            (cosine_hemisphere_to_square(square_to_cosine_hemisphere(u)) - u).length() < 1e-5,
            "{u}"
        );
    }
}

#[test]
fn the_cosine_density_is_the_one_stated() {
    // E[1/p over the directions above 60 degrees elevation] is their solid angle, 2 pi (1 - cos
    // 30 deg).
    let mut rng = Rng::new(2);
    let n = 200_000;
    let sum: f64 = (0..n)
        .map(|_| square_to_cosine_hemisphere(rng.next_2d()))
        .filter(|w| w.z > 0.75_f32.sqrt())
        .map(|w| 1.0 / f64::from(cosine_hemisphere_pdf(w)))
        .sum();
    let expected = 2.0 * std::f64::consts::PI * (1.0 - 0.75_f64.sqrt());
    // Standard error 0.0034: beyond 5 sigma.
    assert!((sum / f64::from(n) - expected).abs() < 0.018, "{} {expected}", sum / f64::from(n));
}
