//! Quadrature rules and slopes of harmonics.

use lumicache::basis::{Basis, Jet, LANES, Lane, Sh, gauss_legendre};
use lumicache::math::Vec3;

#[test]
fn exact_for_polynomials() {
    for n in [1, 2, 5, 20, 64] {
        for degree in [0, 1, 2 * n - 2, 2 * n - 1] {
            let sum: f64 =
                gauss_legendre(n, 0.0, 2.0).iter().map(|(x, w)| w * x.powi(degree as i32)).sum();
            let exact = 2f64.powi(degree as i32 + 1) / (degree + 1) as f64;
            assert!((sum / exact - 1.0).abs() < 1e-12, "{n} {degree}: {sum} {exact}");
        }
    }
}

#[test]
fn slopes_are_the_first_two_components_of_the_gradients() {
    let sh = Sh::new(12);
    let (mut out, mut jets) =
        (vec![[Lane::default(); 3]; sh.count()], vec![Jet::default(); sh.count()]);
    // Directions that wind from one pole to the other, which they miss, the pole itself and the
    // horizon.
    let mut w: [Vec3; LANES] = std::array::from_fn(|k| {
        let (phi, z) = (2.4 * k as f32, 0.95 - 0.26 * k as f32);
        Vec3::new(phi.cos(), phi.sin(), 0.0) * (1.0 - z * z).sqrt() + z * Vec3::Z
    });
    (w[0], w[1]) = (Vec3::Z, Vec3::X);
    sh.slopes(&w, &mut out);
    for k in 0..LANES {
        sh.jets(w[k].as_dvec3(), false, &mut jets);
        for (got, jet) in out.iter().zip(&jets) {
            let expected = [jet.value, jet.gradient.x, jet.gradient.y];
            for (g, e) in got.iter().zip(expected) {
                assert!((f64::from(g[k]) - e).abs() < 1e-4, "{} instead of {e} at {}", g[k], w[k]);
            }
        }
    }
}
