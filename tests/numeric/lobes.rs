//! Tables of glossy lobes against quadrature.

use crate::numeric::radiance::norm;
use crate::support::bsdfs::{at, bsdf, hemisphere, lafortune, metal, plastic, point, values};
use lumicache::basis::{BasisKind, HSH_COSINE, Hsh};
use lumicache::material::tables::{GlossyTables, Lobe, LobeTable, TableSettings, TableStore};
use lumicache::material::{Bsdf, LafortuneLobe, Material, NativeBrdf};
use lumicache::math::{Color, Vec3};

fn settings(basis: BasisKind, order: usize, loss: f32) -> TableSettings {
    TableSettings { basis, order, loss, padding: true, whole: false, forced: false }
}

#[test]
fn tables_hold_the_lobes_of_every_model() {
    let native = |brdf| Material { native: Some(brdf), ..Material::default() };
    let (kd, ks) = (Color::splat(0.2), Color::new(0.6, 0.5, 0.3));
    let ward = |alpha_x, alpha_y| native(NativeBrdf::WardDuer { kd, ks, alpha_x, alpha_y });
    let one = |c: [f32; 3], n: f32| {
        [lafortune(c, Color::splat(n)), LafortuneLobe::default(), LafortuneLobe::default()]
    };
    let coated = Material { clearcoat: 0.7, clearcoat_roughness: 0.6, ..metal(ks, 0.7) };
    let materials = [
        metal(ks, 0.5477),
        plastic(ks, 0.8),
        coated,
        native(NativeBrdf::Phong { kd, ks, exponent: 22.0 }),
        native(NativeBrdf::Lafortune { kd, lobes: one([-0.9, -0.9, 0.9], 12.0), count: 1 }),
        ward(0.4, 0.4),
        ward(0.35, 0.6),
    ];
    let nodes = hemisphere();
    for kind in [BasisKind::Hsh, BasisKind::Sh] {
        let tables = GlossyTables::new(&materials, settings(kind, 10, 0.5), &TableStore::default());
        let basis = kind.basis(10);
        let mut c = Vec::new();
        for (number, material) in materials.iter().enumerate() {
            let surface = bsdf(material, false);
            for wo in [at(5.0, 10.0), at(40.0, 130.0), at(62.0, -77.0)] {
                assert!(
                    tables.project(number as u32, &surface, wo, &mut c).is_some(),
                    "{number} {wo}"
                );
                // The coefficients by quadrature; linear interpolation between 48 nodes, or between
                // 32 x 32 for the anisotropic lobe, misses a little.
                let mut expected = vec![0f64; 300];
                for (wi, solid_angle) in &nodes {
                    let f = surface.f_glossy(wo, *wi) * wi.z;
                    for (i, h) in values(basis.as_ref(), *wi).into_iter().enumerate() {
                        (0..3).for_each(|k| {
                            expected[100 * k + i] += f64::from(f[k] * h) * solid_angle
                        });
                    }
                }
                // With so large a loss few bands are in use, and only those are filled in.
                let order = tables.project(number as u32, &surface, wo, &mut c).unwrap();
                let used = |k: &usize| k % 100 < order * order;
                let got: Vec<f64> = (0..300).filter(used).map(|k| f64::from(c[k])).collect();
                let expected: Vec<f64> = (0..300).filter(used).map(|k| expected[k]).collect();
                let error =
                    norm(&got.iter().zip(&expected).map(|(a, b)| a - b).collect::<Vec<_>>())
                        / norm(&expected);
                let tolerance = if number == 6 { 0.03 } else { 0.01 };
                assert!(error < tolerance, "{kind:?} {number} {wo}: off by {error}");
            }
        }
    }
}

#[test]
fn orders_follow_the_energy() {
    // Energy that is lost by a modified Phong lobe times the cosine, exponent 22 seen straight on:
    // 4.5 % with order 6, 0.39 % with 8, 0.02 % with 10; extended by zero in spherical harmonics
    // 22, 6.6, 1.4 %.
    let phong = |exponent| Material {
        native: Some(NativeBrdf::Phong { kd: Color::ZERO, ks: Color::ONE, exponent }),
        ..Material::default()
    };
    let order = |kind, exponent, wo: Vec3, loss| {
        let material = phong(exponent);
        let tables = GlossyTables::new(
            std::slice::from_ref(&material),
            settings(kind, 10, loss),
            &TableStore::default(),
        );
        tables.project(0, &bsdf(&material, false), wo, &mut Vec::new())
    };
    let up = Vec3::Z;
    for (kind, bounds) in [
        (BasisKind::Hsh, [(0.044, 0.046, 6), (0.0037, 0.0041, 8)]),
        (BasisKind::Sh, [(0.21, 0.23, 6), (0.065, 0.067, 8)]),
    ] {
        for (below, above, n) in bounds {
            assert!(order(kind, 22.0, up, below) > Some(n), "{kind:?} {n}");
            assert!(order(kind, 22.0, up, above) <= Some(n), "{kind:?} {n}");
        }
    }
    assert!(order(BasisKind::Hsh, 22.0, up, 1.5e-4).is_none_or(|n| n == 10));
    assert_eq!(order(BasisKind::Sh, 22.0, up, 0.01), None, "1.4 % at order 10: of high frequency");
    // Exponent 7 at 75 degrees: HSH order 4 loses 5.7 %, SH order 6 4.9 %; the next node of the
    // table, nearer to the horizon, a little more.
    let grazing = at(75.0, 20.0);
    assert_eq!(order(BasisKind::Hsh, 7.0, grazing, 0.062), Some(4));
    assert_eq!(order(BasisKind::Hsh, 7.0, grazing, 0.05), Some(5));
    assert_eq!(order(BasisKind::Sh, 7.0, grazing, 0.06), Some(6));
    assert_eq!(order(BasisKind::Hsh, 2000.0, up, 0.05), None);
}

#[test]
fn what_cannot_be_tabulated_is_left_alone() {
    let materials = [
        metal(Color::ONE, 0.1),
        Material { transmission: 0.5, ..plastic(Color::ONE, 0.7) },
        Material {
            native: Some(NativeBrdf::Phong { kd: Color::ONE, ks: Color::ZERO, exponent: 5.0 }),
            ..Material::default()
        },
    ];
    let tables =
        GlossyTables::new(&materials, settings(BasisKind::Hsh, 10, 0.05), &TableStore::default());
    assert!(tables.is_empty());
    for (number, material) in materials.iter().enumerate() {
        assert_eq!(
            tables.project(number as u32, &bsdf(material, false), Vec3::Z, &mut Vec::new()),
            None
        );
        assert_eq!(tables.record_order(&point(false), &bsdf(material, false)), None);
    }
    assert_eq!(tables.project(0, &Bsdf::lambert(Color::ONE), Vec3::Z, &mut Vec::new()), None);
}

#[test]
fn textured_roughness_is_interpolated() {
    // Tables at the roughnesses of the grid serve those between.
    let exact = metal(Color::splat(0.8), 0.61);
    let textured: Vec<Material> =
        (0..30).map(|k| metal(Color::ONE, 0.3 + 0.7 * k as f32 / 29.0)).collect();
    let wanted = settings(BasisKind::Hsh, 8, 0.5);
    let tables = GlossyTables::new(&textured, wanted, &TableStore::default());
    let reference = GlossyTables::new(std::slice::from_ref(&exact), wanted, &TableStore::default());
    let surface = bsdf(&exact, false);
    for wo in [at(10.0, 0.0), at(60.0, 50.0)] {
        let (mut a, mut b) = (Vec::new(), Vec::new());
        let (m, n) = (
            tables.project(0, &surface, wo, &mut a).unwrap(),
            reference.project(0, &surface, wo, &mut b).unwrap(),
        );
        let count = m.min(n).pow(2);
        let (a, b) =
            (a[..count].iter().map(|x| f64::from(*x)), b[..count].iter().map(|x| f64::from(*x)));
        let difference: Vec<f64> = a.zip(b.clone()).map(|(a, b)| a - b).collect();
        assert!(norm(&difference) < 0.01 * norm(&b.collect::<Vec<_>>()), "{}", norm(&difference));
    }
}

#[test]
fn any_function_can_be_tabulated() {
    // A constant f: cos θ alone, two bands, nothing lost.
    let lobe = Lobe { f: &|_, _| [1.0, 0.5, 0.25], parts: 3, isotropic: true };
    let table = LobeTable::build(&lobe, &Hsh::new(4));
    let channels = [Color::X, Color::Y, Color::Z];
    assert_eq!(table.needed_order(at(50.0, 0.0), &channels, 1e-5), Some(2));
    let mut c = vec![0.0; 48];
    table.add(at(50.0, 30.0), 2, &channels, &mut c);
    for (channel, factor) in [1.0, 0.5, 0.25].into_iter().enumerate() {
        assert!(
            (c[16 * channel] - factor * HSH_COSINE[0]).abs() < 1e-5
                && (c[16 * channel + 2] - factor * HSH_COSINE[1]).abs() < 1e-5
        );
    }
}
