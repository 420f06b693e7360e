//! Refinement at steps of light: small records there, few elsewhere.

use crate::support::pictures::{build, own, scheme, with};
use crate::support::refined::*;
use lumicache::cache::{Clamping, Irradiance, Record};
use lumicache::gather::{Bundle, Deeper, RadianceProbe, TranslationalGradient};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, Vec3};

#[test]
fn records_are_small_at_a_step_and_large_away_from_it() {
    let field = Field { radiance: |x: Vec3, _| if x.x < 0.1 { 1.0 } else { 2.0 }, distance: 1.0 };
    let r = Refined::new(&field, quick("krivanek06"), floor(0.0));
    let [near, far] = [0.0..0.05, 1.0..9.0].map(|distance: std::ops::Range<f32>| {
        let chosen: Vec<f32> = r
            .records()
            .iter()
            .filter(|x| distance.contains(&(x.position.x - 0.1).abs()))
            .map(|x| x.error)
            .collect();
        chosen.iter().sum::<f32>() / chosen.len() as f32
    });
    assert!(near < 0.12 && far > 0.49, "mean a {near} at the step, {far} far from it");
    assert!(r.records().len() > 2 * r.unrefined, "{} from {}", r.records().len(), r.unrefined);
}

#[test]
fn strong_direct_light_makes_records_superfluous() {
    let field = Field { radiance: |x: Vec3, _| 1.0 + 0.3 * (8.0 * x.x).sin(), distance: 1.0 };
    let counts = [0.0, 5.0, 100.0].map(|direct| {
        let r = Refined::new(&field, quick("krivanek06"), floor(direct));
        r.records().len() - r.unrefined
    });
    // Against light that outshines it a hundred times no change of the field can be seen.
    assert!(
        2 * counts[0] > 3 * counts[1] && counts[1] > 0 && counts[2] == 0,
        "{counts:?} more records"
    );
}

#[test]
fn the_allowance_for_noise_saves_most_records() {
    // 128 rays of random radiance 0 or 2: the standard error of the irradiance is 9 %, far above
    // what the eye could see if it were no noise.
    let field =
        Field { radiance: |_, seed| 2.0 * f32::from(u8::from(seed % 2 == 0)), distance: 1.0 };
    let without_gradient = |scheme| {
        with(scheme, |s| {
            (s.gather.gradient, s.clamping) = (TranslationalGradient::None, Clamping::None);
        })
    };
    let r = Refined::new(&field, without_gradient(quick("krivanek06")), floor(0.0));
    let (before, after) = (r.unrefined, r.records().len());
    // One standard error is allowed, so that some pairs of records still seem to differ. Without
    // the allowance the same field is refined to the utmost.
    struct Certain<P>(P);
    impl<P: RadianceProbe> RadianceProbe for Certain<P> {
        fn incoming(
            &self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle,
        ) {
            self.0.incoming(from, level, deeper, bundle);
            let mean = bundle.radiance.iter().sum::<Color>() / bundle.len() as f32;
            bundle.radiance.fill(mean);
        }
    }
    let certain = Refined::new(&Certain(field), without_gradient(quick("krivanek06")), floor(0.0));
    let certain = certain.records().len();
    assert!(
        before < after && 4 * after < certain,
        "{before} records become {after}, and {certain} without the allowance"
    );
}

#[test]
fn light_through_a_slit() {
    let scene = build(own("slit-light"));
    let r = Refined::scene(
        &scene,
        with(scheme("krivanek06"), |s| (s.gather.rays, s.radius.min_pixels) = (512, 0.0)),
        [160, 120],
    );
    // The floor below the panel; the middle of each edge of the band lies where half of the panel
    // is seen, 0.36 m from the axis.
    let mean = |range: std::ops::Range<f32>| {
        let on_floor = |x: &&Record<Irradiance>| {
            x.position.y < 0.01 && x.position.z < -0.9 && x.position.z > -2.1
        };
        let here =
            r.records().iter().filter(on_floor).filter(|x| range.contains(&x.position.x.abs()));
        let errors: Vec<f32> = here.map(|x| x.error).collect();
        errors.iter().sum::<f32>() / errors.len() as f32
    };
    let (at_edge, away) = (mean(0.21..0.51), mean(0.8..1.9));
    assert!(at_edge < 0.46 && away > 0.49, "mean a {at_edge} at the edges, {away} away from them");
}

#[test]
fn no_record_misses_a_step() {
    let scene = build(own("staircase-room"));
    let r = Refined::scene(&scene, quick("krivanek06"), [160, 120]);
    let missed = |records: &[Record<Irradiance>]| {
        let excess = |a: &Record<Irradiance>, b: &Record<Irradiance>| {
            a.length - b.length - (a.position - b.position).length()
        };
        records
            .iter()
            .flat_map(|a| records.iter().map(move |b| (a, b)))
            .filter(|(a, b)| excess(a, b) > 1e-4 * a.length)
            .count()
    };
    assert_eq!(missed(r.records()), 0, "records that missed a feature that their neighbours saw");
    let free: Vec<Record<Irradiance>> =
        r.records().iter().map(|x| Record { length: x.length_unclamped, ..x.clone() }).collect();
    assert!(missed(&free) > 0, "the test cannot fail");
}
