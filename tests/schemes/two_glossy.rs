//! Light from one glossy surface on another: the change of radiance with the point it is seen from,
//! as records have it, against differences of dense gathers; pictures with and without it.

use crate::numeric::radiance::{norm, off};
use crate::schemes::glossy::layer;
use crate::support::pictures::{build, cached, difference, own, render, scheme, settings};
use lumicache::accel::Ray;
use lumicache::basis::{Basis, Sh};
use lumicache::cache::{Cache, Hits, LevelPoints, Scheme};
use lumicache::gather::{
    Bundle, Deeper, Density, HemisphereSamples, HitChange, Layout, NoDeeper, RadianceProbe,
    TriangleRadiance,
};
use lumicache::geometry::SurfacePoint;
use lumicache::imagefile::Picture;
use lumicache::material::{Material, NativeBrdf};
use lumicache::math::{Color, Vec3};
use lumicache::progress::Progress;
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::Scene;
use lumicache::transport::{GlossyLobes, PathTracer, SceneProbe};

/// The two planes with the wall made of `wall`, and a point of the floor.
fn planes(wall: Option<Material>) -> Scene {
    let mut data = own("two-glossy-planes");
    if let Some(wall) = wall {
        let place = data.materials.iter().position(
            |m| matches!(m.native, Some(NativeBrdf::Phong { exponent, .. }) if exponent > 20.0),
        );
        let place = place.expect("the wall is the sharper of the two");
        data.materials[place] = Material { double_sided: true, ..wall };
    }
    build(data)
}

/// The floor at `(x, 0, z)`.
fn floor(scene: &Scene, x: f32, z: f32) -> SurfacePoint {
    let down = Ray { origin: Vec3::new(x, 0.5, z), tmin: 0.0, dir: Vec3::NEG_Y, tmax: 1.0 };
    scene.intersect(&down, 0).expect("there is a floor").0
}

const PLACE: [f32; 2] = [0.45, 0.1];

fn gathered(
    scene: &Scene, at: &SurfacePoint, n: u32, seed: u64, how: HitChange,
) -> HemisphereSamples {
    // One bounce: what the point light sends to a hit is reflected once, and no sample is noisy.
    let probe = SceneProbe::new(PathTracer { scene, max_bounces: 1 });
    let mut samples =
        HemisphereSamples::new(Layout::Concentric { n }, Density::Cosine).with_change(how);
    samples.gather(&probe, at, 0, &NoDeeper, seed);
    samples
}

/// Gradient of the red coefficients of five bands, as the mean over eight gathers of 64 x 64 rays.
fn gradient(scene: &Scene, how: HitChange) -> [Vec<f64>; 2] {
    let basis = Sh::new(5);
    let mut sum = [vec![0.0; basis.count()], vec![0.0; basis.count()]];
    for seed in 0..8 {
        let d = gathered(scene, &floor(scene, PLACE[0], PLACE[1]), 64, seed, how)
            .radiance_derivatives(&basis, TriangleRadiance::Hybrid, false);
        for (sum, got) in sum.iter_mut().zip(&d.gradient) {
            sum.iter_mut().zip(got).for_each(|(s, g)| *s += f64::from(*g) / 8.0);
        }
    }
    sum
}

/// The same by central differences of gathers of 10⁶ rays along the same directions.
fn reference(scene: &Scene) -> [Vec<f64>; 2] {
    let basis = Sh::new(5);
    let h = 0.01;
    let frame = floor(scene, PLACE[0], PLACE[1]).frame;
    [frame.s, frame.t].map(|axis| {
        let at = |sign: f32| {
            let moved = h * sign * axis;
            gathered(
                scene,
                &floor(scene, PLACE[0] + moved.x, PLACE[1] + moved.z),
                1000,
                7,
                HitChange::None,
            )
            .project(&basis)
        };
        let (ahead, behind) = (at(1.0), at(-1.0));
        (0..basis.count()).map(|i| f64::from(ahead[i] - behind[i]) / f64::from(2.0 * h)).collect()
    })
}

#[test]
fn the_gradient_knows_that_hits_look_different_from_elsewhere() {
    let phong = |exponent| Material {
        native: Some(NativeBrdf::Phong { kd: Color::splat(0.1), ks: Color::splat(0.6), exponent }),
        ..Material::default()
    };
    let metal = Material {
        base_color: Color::splat(0.8),
        metallic: 1.0,
        roughness: 0.5,
        ..Material::default()
    };
    let coated = Material { clearcoat: 1.0, clearcoat_roughness: 0.5, ..Material::default() };
    for (wall, name) in
        [(phong(24.0), "Phong 24"), (phong(8.0), "Phong 8"), (metal, "metal"), (coated, "coated")]
    {
        let scene = planes(Some(wall));
        let expected = reference(&scene);
        let [without, with] =
            [HitChange::None, HitChange::Frozen].map(|how| off(&gradient(&scene, how), &expected));
        println!("{name}: gradient off by {without:.3} without the change, {with:.3} with it");
        // What is left is the mesh at the borders of the wall.
        assert!(with < 0.12, "{name}: off by {with}");
        assert!(without > 4.0 * with, "{name}: off by {without} only");
    }
}

#[test]
fn the_closed_form_agrees_with_evaluation_aside() {
    let scene = planes(None);
    let [frozen, analytic] =
        [HitChange::Frozen, HitChange::Analytic].map(|how| gradient(&scene, how));
    assert!(off(&frozen, &analytic) < 5e-3, "{}", off(&frozen, &analytic));
    assert!(norm(&analytic[0]) > 0.0);
}

#[test]
fn harmonics_of_the_hit_s_lobe_tell_its_change_where_they_represent_it() {
    // Ten bands hold a lobe of exponent 8.
    let wall = NativeBrdf::Phong { kd: Color::splat(0.1), ks: Color::splat(0.6), exponent: 8.0 };
    let scene = planes(Some(Material { native: Some(wall), ..Material::default() }));
    let scheme = scheme("zhao-incoming");
    assert_eq!(scheme.glossy().order, 10);
    let lobes = GlossyLobes::new(&scene, &scheme, u32::MAX).unwrap();
    let probe = SceneProbe::new(PathTracer { scene: &scene, max_bounces: 1 })
        .with_lobes(Some(lobes.choice(&scheme)));
    let of = |how| {
        let mut samples =
            HemisphereSamples::new(Layout::Concentric { n: 64 }, Density::Cosine).with_change(how);
        samples.gather(&probe, &floor(&scene, PLACE[0], PLACE[1]), 0, &NoDeeper, 1);
        samples
            .radiance_derivatives(&Sh::new(5), TriangleRadiance::Hybrid, false)
            .gradient
            .map(|g| g.iter().map(|x| f64::from(*x)).collect())
    };
    let [none, frozen, harmonics]: [[Vec<f64>; 2]; 3] =
        [HitChange::None, HitChange::Frozen, HitChange::Harmonics].map(of);
    println!(
        "{:.3} from frozen samples, {:.3} without any",
        off(&harmonics, &frozen),
        off(&none, &frozen)
    );
    assert!(off(&harmonics, &frozen) < 0.1 && off(&none, &frozen) > 0.3);
}

/// Light from far away that grows brighter towards one side.
struct Dawn;

impl RadianceProbe for Dawn {
    fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        let of = |w: &Vec3| {
            Color::splat((1.0 + from.frame.to_world(*w).dot(Vec3::new(0.3, 0.6, 0.2))).powi(4))
        };
        bundle.radiance = bundle.dir_local.iter().map(of).collect();
        bundle.distance.fill(100.0);
    }
}

#[test]
fn records_at_the_hits_tell_how_the_light_they_know_changes() {
    let wall = NativeBrdf::Phong { kd: Color::splat(0.1), ks: Color::splat(0.8), exponent: 8.0 };
    let scene = planes(Some(Material { native: Some(wall), ..Material::default() }));
    let mut scheme = scheme("zhao-incoming");
    scheme.set_all([("glossy.levels", "2"), ("gather.noise", "0")]).unwrap();
    let lobes = GlossyLobes::new(&scene, &scheme, u32::MAX).unwrap();
    let lobes = Some(lobes.choice(&scheme));
    let tracer = PathTracer { scene: &scene, max_bounces: u32::MAX };
    let at = floor(&scene, PLACE[0], PLACE[1]);
    let hits = tracer.next_points(&[at], 16_384, 1, lobes);
    let (points, orders) =
        hits.into_iter().map(|(point, _)| (point, scheme.glossy().order)).unzip();
    let points = LevelPoints { points, orders, round: 0 };
    let mut cache = Cache::new(scheme.clone(), u32::MAX).with_radiance();
    cache.fill_radiance(&Dawn, None, 1, &points, 1, &Progress::default()).unwrap();
    let count = cache.radiance_records(1).len();
    assert!(count > 3, "{count} records behind the first level");
    // What the light sends to a hit straight away does not matter here: it would hide the rest.
    let behind = cache.behind(1);
    let [direct, whole] = [1, u32::MAX].map(|max_bounces| {
        let probe = SceneProbe::new(PathTracer { max_bounces, ..tracer }).with_lobes(lobes);
        let deeper: &dyn Deeper = if max_bounces == 1 { &NoDeeper } else { &behind };
        (probe, deeper)
    });
    let basis = Sh::new(5);
    type Known<'a> = (SceneProbe<'a>, &'a dyn Deeper);
    let gather = |(probe, deeper): &Known, at: &SurfacePoint, n: u32, how: HitChange| {
        let mut samples =
            HemisphereSamples::new(Layout::Concentric { n }, Density::Cosine).with_change(how);
        samples.gather(probe, at, 0, *deeper, 7);
        samples
    };
    let indirect = |f: &dyn Fn(&Known) -> Vec<f64>| -> Vec<f64> {
        f(&whole).iter().zip(f(&direct)).map(|(a, b)| a - b).collect()
    };
    let [without, with] = [HitChange::None, HitChange::Harmonics].map(|how| {
        [0, 1].map(|k| {
            indirect(&|probe| {
                let d = gather(probe, &at, 128, how).radiance_derivatives(
                    &basis,
                    TriangleRadiance::Hybrid,
                    false,
                );
                d.gradient[k].iter().map(|x| f64::from(*x)).collect()
            })
        })
    });
    let h = 0.01;
    let expected = [at.frame.s, at.frame.t].map(|axis| {
        indirect(&|probe| {
            let [ahead, behind] = [h, -h].map(|h| {
                let moved = h * axis;
                gather(
                    probe,
                    &floor(&scene, PLACE[0] + moved.x, PLACE[1] + moved.z),
                    400,
                    HitChange::None,
                )
                .project(&basis)
            });
            (0..basis.count())
                .map(|i| f64::from(ahead[i] - behind[i]) / f64::from(2.0 * h))
                .collect()
        })
    });
    let [without, with] = [without, with].map(|g| off(&g, &expected));
    println!(
        "light that records know: gradient off by {without:.3} without its change, {with:.3} with it"
    );
    assert!(with < 0.15 && without > 4.0 * with, "{without} {with}");
}

#[test]
fn diffuse_hits_look_the_same_from_everywhere() {
    let scene = planes(Some(Material {
        native: Some(NativeBrdf::Phong { kd: Color::splat(0.7), ks: Color::ZERO, exponent: 1.0 }),
        ..Material::default()
    }));
    for how in [HitChange::Frozen, HitChange::Analytic] {
        let samples = gathered(&scene, &floor(&scene, PLACE[0], PLACE[1]), 32, 1, how);
        assert!(samples.bundle().radiance.iter().any(|l| *l != Color::ZERO));
        assert!(samples.bundle().change.iter().all(|c| c.len() == samples.bundle().len()));
        assert!(samples.bundle().change.iter().flatten().all(|c| *c == Color::ZERO));
    }
}

/// Glossy indirect light of the floor near the wall.
fn edge(scene: &Scene, settings: Settings) -> Picture {
    let settings = Settings { max_bounces: 2, window: [0, 0, 48, 6], ..settings };
    layer(&render(scene, &settings), "glossy_indirect")
}

#[test]
fn the_edge_between_two_glossy_surfaces_is_clean() {
    let scene = planes(None);
    let size = [48, 36];
    let reference = edge(&scene, settings(&scene, IntegratorKind::Path, size, 4096));
    let relmse = |change: &dyn Fn(&mut Scheme)| {
        let mut settings = cached(&scene, "zhao-incoming", size, 4);
        (
            settings.scheme.validity.error,
            settings.scheme.gather.noise,
            settings.scheme.radius.min_pixels,
        ) = (1e-4, 0.0, 1.0);
        change(&mut settings.scheme);
        difference(&edge(&scene, settings), &reference).relmse
    };
    let hits = |hits: Hits, rays: u32| {
        relmse(&|s| {
            s.gather.rays = rays;
            s.glossy.as_mut().unwrap().hits = hits;
        })
    };
    let [without, with] = [Hits::None, Hits::Frozen].map(|how| hits(how, 4096));
    println!("relmse {without:.2e} without the change of hits, {with:.2e} with it");
    assert!(with < 0.25 * without, "{with} {without}");
    // Without harmonics and derivatives the same: it is the hits' light that must change.
    let [frozen, traced] = [Hits::Stored, Hits::Retraced].map(|how| hits(how, 1024));
    println!(
        "relmse {frozen:.2e} from hits that stay as they are, {traced:.2e} from hits traced anew"
    );
    assert!(traced < 0.5 * frozen, "{traced} {frozen}");
}
