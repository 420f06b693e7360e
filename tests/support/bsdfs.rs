//! What the statistical tests of the BSDFs share: a collection of surfaces, random numbers,
//! quadrature over the sphere.

use lumicache::basis::{Basis, LANES, Lane, gauss_legendre};
use lumicache::geometry::SurfacePoint;
use lumicache::material::{Bsdf, LafortuneLobe, Material, NativeBrdf};
use lumicache::math::{Color, Frame, Vec3};
use std::f64::consts::{PI, TAU};

/// The unit vector with polar angle `theta` from z and azimuth `phi`.
pub fn direction(theta: f64, phi: f64) -> Vec3 {
    Vec3::new(
        (theta.sin() * phi.cos()) as f32,
        (theta.sin() * phi.sin()) as f32,
        theta.cos() as f32,
    )
}

/// A direction in the plane of azimuth `phi` (degrees) at `theta` degrees from the normal.
pub fn at(theta: f64, phi: f64) -> Vec3 {
    direction(theta.to_radians(), phi.to_radians())
}

/// A point of the plane z = 0 seen from straight above, from behind its triangle if `back_face`.
pub fn point(back_face: bool) -> SurfacePoint {
    SurfacePoint { back_face, ..SurfacePoint::plain(Vec3::ZERO, Vec3::Z) }
}

/// The BSDF of a material without textures.
pub fn bsdf(material: &Material, back_face: bool) -> Bsdf {
    material.shade(&[], &mut point(back_face))
}

/// A grey dielectric without specular reflection, to be changed field by field.
pub fn matte(albedo: Color) -> Material {
    Material { base_color: albedo, metallic: 0.0, specular: 0.0, ..Material::default() }
}

/// A metal.
pub fn metal(color: Color, roughness: f32) -> Material {
    Material { base_color: color, roughness, multiple_scattering: true, ..Material::default() }
}

/// A dielectric over a diffuse base.
pub fn plastic(color: Color, roughness: f32) -> Material {
    Material { metallic: 0.0, ..metal(color, roughness) }
}

/// Solid glass.
pub fn glass(ior: f32, roughness: f32) -> Material {
    Material { transmission: 1.0, thin: false, ior, ..plastic(Color::ONE, roughness) }
}

/// A sheet of glass.
pub fn sheet(color: Color, roughness: f32) -> Material {
    Material { transmission: 1.0, ..plastic(color, roughness) }
}

/// One lobe of the Lafortune model.
pub fn lafortune(c: [f32; 3], exponent: Color) -> LafortuneLobe {
    LafortuneLobe {
        cx: Color::splat(c[0]),
        cy: Color::splat(c[1]),
        cz: Color::new(0.97, 1.0, 0.9) * c[2],
        exponent,
    }
}

/// Surfaces of every kind, with about the width of their sharpest lobe as an angle.
pub fn zoo() -> Vec<(&'static str, Bsdf, f64)> {
    let red = Color::new(0.8, 0.3, 0.1);
    let of = |m: Material| bsdf(&m, false);
    let behind = |m: Material| bsdf(&m, true);
    let native = Bsdf::native;
    vec![
        ("lambert", of(matte(red)), 1.0),
        ("metal 0.12", of(metal(red, 0.12)), 0.014),
        ("metal 0.55", of(metal(red, 0.5477)), 0.3),
        ("metal 1", of(metal(red, 1.0)), 1.0),
        ("plastic 0.2", of(plastic(red, 0.2)), 0.04),
        ("plastic 0.7", of(plastic(red, 0.7)), 0.5),
        ("mirror over diffuse", of(plastic(red, 0.0)), 1.0),
        ("half metal", of(Material { metallic: 0.5, ..plastic(red, 0.4) }), 0.16),
        (
            "tinted specular",
            of(Material { specular_color: red, specular: 0.7, ior: 1.8, ..plastic(red, 0.5) }),
            0.25,
        ),
        (
            "coated matte",
            of(Material { clearcoat: 0.8, clearcoat_roughness: 0.4, ..matte(red) }),
            0.16,
        ),
        ("coated metal", of(Material { clearcoat: 1.0, ..metal(red, 0.5) }), 0.25),
        ("sheet 0.4", of(sheet(red, 0.4)), 0.16),
        ("half a sheet", of(Material { transmission: 0.5, ..sheet(red, 0.6) }), 0.36),
        ("glass 0.3", of(glass(1.5, 0.3)), 0.02),
        ("glass 0.7", of(glass(1.5, 0.7)), 0.1),
        ("glass 0.3 inside", behind(glass(1.5, 0.3)), 0.02),
        ("glass 0.9 inside", behind(glass(1.33, 0.9)), 0.1),
        ("half glass", of(Material { transmission: 0.5, base_color: red, ..glass(1.7, 0.5) }), 0.1),
        (
            "coated glass",
            of(Material { clearcoat: 1.0, clearcoat_roughness: 0.6, ..glass(1.4, 0.5) }),
            0.05,
        ),
        (
            "smooth glass with rough coat",
            of(Material { clearcoat: 1.0, clearcoat_roughness: 0.6, ..glass(1.5, 0.0) }),
            0.3,
        ),
        (
            "phong 7",
            native(NativeBrdf::Phong { kd: red * 0.5, ks: Color::splat(0.4), exponent: 7.0 }),
            0.4,
        ),
        (
            "phong 300",
            native(NativeBrdf::Phong { kd: Color::ZERO, ks: red, exponent: 300.0 }),
            0.05,
        ),
        (
            "lafortune",
            native(NativeBrdf::Lafortune {
                kd: red * 0.3,
                lobes: [
                    lafortune([-1.0, -1.0, 1.0], Color::new(5.0, 20.0, 40.0)),
                    lafortune([0.6, 0.7, 0.8], Color::splat(3.0)),
                    LafortuneLobe::default(),
                ],
                count: 2,
            }),
            0.15,
        ),
        (
            "ward 0.15",
            native(NativeBrdf::WardDuer {
                kd: red * 0.5,
                ks: Color::splat(0.3),
                alpha_x: 0.15,
                alpha_y: 0.15,
            }),
            0.1,
        ),
        (
            "ward 0.1 x 0.5",
            native(NativeBrdf::WardDuer { kd: Color::ZERO, ks: red, alpha_x: 0.1, alpha_y: 0.5 }),
            0.1,
        ),
    ]
}

/// The view directions at which every surface is tried.
pub fn views() -> [Vec3; 4] {
    [at(0.0, 0.0), at(35.0, 20.0), at(70.0, 200.0), at(88.0, 110.0)]
}

/// A polar chart of the sphere about an axis: `θ = π t^power`, `φ = 2π s`.
#[derive(Clone, Copy)]
pub struct Chart {
    frame: Frame,
    power: f64,
}

impl Chart {
    /// About the normal, even in the angle, so that the horizon is a grid line.
    pub fn normal() -> Self {
        Self { frame: Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::Z }, power: 1.0 }
    }

    /// About `axis`, with cells that shrink towards it.
    pub fn about(axis: Vec3) -> Self {
        Self { frame: Frame::from_normal(axis), power: 3.0 }
    }

    /// The direction at `(t, s)` and its solid angle per unit of `t` and `s`.
    pub fn direction(&self, t: f64, s: f64) -> (Vec3, f64) {
        let theta = PI * t.powf(self.power);
        let w = self.frame.to_world(direction(theta, 2.0 * PI * s));
        (w.normalize(), theta.sin() * PI * self.power * t.powf(self.power - 1.0) * 2.0 * PI)
    }

    /// The coordinates of a direction, each in [0, 1).
    pub fn coordinates(&self, w: Vec3) -> (f64, f64) {
        let l = self.frame.to_local(w).as_dvec3();
        let theta = (l.x * l.x + l.y * l.y).sqrt().atan2(l.z);
        let s = (l.y.atan2(l.x) / (2.0 * PI)).rem_euclid(1.0);
        ((theta / PI).powf(1.0 / self.power).min(1.0 - 1e-12), s.min(1.0 - 1e-12))
    }
}

/// Four numbers integrated at once.
pub type Values = [f64; 4];

/// The integral of `g` over a cell `[t0, t1] x [s0, s1]` of the chart: 3 x 3 Gauss points, refined
/// until four quarters agree within `tolerance` with the whole, at most `depth` times.
pub fn integrate(
    chart: &Chart, cell: [f64; 4], tolerance: f64, depth: u32, g: &impl Fn(Vec3) -> Values,
) -> Values {
    let whole = gauss(chart, cell, g);
    refine(chart, cell, whole, tolerance, depth, g)
}

fn refine(
    chart: &Chart, [t0, t1, s0, s1]: [f64; 4], whole: Values, tolerance: f64, depth: u32,
    g: &impl Fn(Vec3) -> Values,
) -> Values {
    let (tm, sm) = (0.5 * (t0 + t1), 0.5 * (s0 + s1));
    let quarters = [[t0, tm, s0, sm], [t0, tm, sm, s1], [tm, t1, s0, sm], [tm, t1, sm, s1]];
    let values = quarters.map(|q| gauss(chart, q, g));
    let sum = values.iter().fold([0.0; 4], |a, v| std::array::from_fn(|k| a[k] + v[k]));
    let agree = (0..4).all(|k| (sum[k] - whole[k]).abs() <= tolerance);
    // Densities jump at the horizon and at the edge of their support, maybe between the points of
    // both rules.
    let corners = [(t0, s0), (t0, s1), (t1, s0), (t1, s1)].map(|(t, s)| {
        let w = chart.direction(t, s).0;
        (w.z < 0.0, g(w)[0] > 0.0)
    });
    let crosses = corners.iter().any(|c| c.0 != corners[0].0 || c.1 != (sum[0] > 0.0));
    if depth == 0 || (agree && !(crosses && depth > 4)) {
        return sum;
    }
    quarters.iter().zip(values).fold([0.0; 4], |a, (q, v)| {
        let r = refine(chart, *q, v, tolerance, depth - 1, g);
        std::array::from_fn(|k| a[k] + r[k])
    })
}

fn gauss(chart: &Chart, [t0, t1, s0, s1]: [f64; 4], g: &impl Fn(Vec3) -> Values) -> Values {
    const X: [f64; 3] = [-0.774_596_669_241_483_4, 0.0, 0.774_596_669_241_483_4];
    const W: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
    let mut sum = [0.0; 4];
    for i in 0..3 {
        for j in 0..3 {
            let t = 0.5 * (t0 + t1) + 0.5 * (t1 - t0) * X[i];
            let s = 0.5 * (s0 + s1) + 0.5 * (s1 - s0) * X[j];
            let (w, density) = chart.direction(t, s);
            let weight = W[i] * W[j] * density * (t1 - t0) * (s1 - s0);
            for (total, value) in sum.iter_mut().zip(g(w)) {
                *total += weight * value;
            }
        }
    }
    sum
}

/// The cells of a grid of `nt` x `ns` over the chart, row by row.
pub fn cells(nt: usize, ns: usize) -> impl Iterator<Item = [f64; 4]> {
    (0..nt * ns).map(move |k| {
        let (i, j) = ((k / ns) as f64, (k % ns) as f64);
        [i / nt as f64, (i + 1.0) / nt as f64, j / ns as f64, (j + 1.0) / ns as f64]
    })
}

/// Directions about which a lobe seen from `wo` may be concentrated.
pub fn axis_of(b: &Bsdf, wo: Vec3) -> Vec3 {
    let mirror = Vec3::new(-wo.x, -wo.y, wo.z);
    if b.f(wo, mirror).max_element() > 0.0 { mirror } else { Vec3::Z }
}

/// All basis functions at `w`.
pub fn values(basis: &dyn Basis, w: Vec3) -> Vec<f32> {
    let mut out = vec![Lane::default(); basis.count()];
    basis.values(&[w; LANES], &mut out);
    out.iter().map(|v| v[0]).collect()
}

/// Directions of the hemisphere with their solid angles.
pub fn hemisphere() -> Vec<(Vec3, f64)> {
    let columns = 160;
    let mut nodes = Vec::new();
    for (z, weight) in gauss_legendre(80, 0.0, 1.0) {
        for k in 0..columns {
            let (s, c) = (TAU * (k as f64 + 0.37) / columns as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            nodes.push((
                Vec3::new((r * c) as f32, (r * s) as f32, z as f32),
                weight * TAU / columns as f64,
            ));
        }
    }
    nodes
}
