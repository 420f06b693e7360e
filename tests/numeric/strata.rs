//! The directions of a hemisphere.

use lumicache::gather::{Density, Layout};
use std::f32::consts::TAU;

#[test]
fn both_layouts_and_densities_integrate_the_cosine() {
    for layout in [Layout::Polar { m: 20, n: 63 }, Layout::Concentric { n: 36 }] {
        for density in [Density::Cosine, Density::Uniform] {
            let (mut w, mut p) = (Vec::new(), Vec::new());
            layout.directions(density, 5, &mut w, &mut p);
            assert_eq!(w.len(), layout.rays());
            let e: f32 = w.iter().zip(&p).map(|(w, p)| w.z / p).sum::<f32>() / w.len() as f32;
            assert!((e - std::f32::consts::PI).abs() < 0.01, "{layout:?} {density:?} {e}");
            let z2: f32 =
                w.iter().zip(&p).map(|(w, p)| w.z * w.z / p).sum::<f32>() / w.len() as f32;
            assert!((z2 - std::f32::consts::TAU / 3.0).abs() < 0.02, "{layout:?} {density:?} {z2}");
            assert!(w.iter().all(|w| (w.length() - 1.0).abs() < 1e-5 && w.z > 0.0));
        }
    }
}

#[test]
fn polar_samples_lie_in_their_strata() {
    let layout = Layout::Polar { m: 8, n: 24 };
    let (mut w, mut p) = (Vec::new(), Vec::new());
    layout.directions(Density::Cosine, 1, &mut w, &mut p);
    for (k, w) in w.iter().enumerate() {
        let (j, s) = layout.cell(k);
        let ring = (1.0 - w.z * w.z) * 8.0;
        let sector = w.y.atan2(w.x).rem_euclid(TAU) / TAU * 24.0;
        assert!(ring > j as f32 - 1e-3 && ring < j as f32 + 1.001, "{k} {ring}");
        assert!(sector > s as f32 - 1e-3 && sector < s as f32 + 1.001, "{k} {sector}");
    }
}
