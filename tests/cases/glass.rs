//! Lights behind panes: closed forms, and what the three integrators agree on.

use crate::support::pictures::{build, cached, load, own, render, settings};
use crate::support::rooms::scene_of;
use crate::support::testdata;
use lumicache::accel::Ray;
use lumicache::camera::Projection;
use lumicache::film::LAYERS;
use lumicache::geometry::{Instance, SurfacePoint, TriangleMesh};
use lumicache::light::{EnvironmentMap, PunctualLight};
use lumicache::material::{AlphaMode, Material};
use lumicache::math::{Affine3A, Color, Mat3, Vec3};
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::{Scene, SceneData};
use lumicache::transport::glass_bends_light;
use std::sync::Arc;

const KINDS: [IntegratorKind; 3] =
    [IntegratorKind::Path, IntegratorKind::Cache, IntegratorKind::Bdpt];
const IOR: f32 = 1.5;

fn white() -> Material {
    Material {
        base_color: Color::splat(0.6),
        metallic: 0.0,
        specular: 0.0,
        double_sided: true,
        ..Material::default()
    }
}

/// Clear glass as a thin sheet, tinted.
fn thin() -> Material {
    Material {
        base_color: Color::new(1.0, 0.9, 0.5),
        metallic: 0.0,
        roughness: 0.0,
        transmission: 1.0,
        ..Material::default()
    }
}

/// Absorbing solid glass.
fn solid() -> Material {
    Material {
        base_color: Color::ONE,
        thin: false,
        ior: IOR,
        attenuation_color: Color::new(0.5, 0.8, 0.9),
        attenuation_distance: 0.1,
        ..thin()
    }
}

fn add(data: &mut SceneData, mesh: TriangleMesh, material: Material) {
    data.materials.push(material);
    let mesh = TriangleMesh { material: data.materials.len() as u32 - 1, ..mesh };
    data.geometry
        .instances
        .push(Instance { mesh: data.geometry.meshes.len() as u32, to_world: Affine3A::IDENTITY });
    data.geometry.meshes.push(Arc::new(mesh));
}

/// A square of half side `half` in the plane of height `y`, looked at from above.
fn sheet(y: f32, half: f32) -> TriangleMesh {
    let corner = |x: f32, z: f32| Vec3::new(half * x, y, half * z);
    TriangleMesh {
        positions: vec![corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]
            .into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        ..TriangleMesh::default()
    }
}

/// A closed box, its faces outwards.
fn slab(min: Vec3, max: Vec3) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let (center, half) = (0.5 * (min + max), 0.5 * (max - min));
    for axis in 0..3 {
        for sign in [-1.0, 1.0_f32] {
            let n = sign * Vec3::AXES[axis];
            let (s, t) = (Vec3::AXES[(axis + 1) % 3], n.cross(Vec3::AXES[(axis + 1) % 3]));
            let first = mesh.positions.len() as u32;
            let corners = [n - s - t, n + s - t, n + s + t, n - s + t];
            mesh.positions.to_mut().extend(corners.map(|c| center + half * c));
            mesh.indices
                .to_mut()
                .extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    mesh
}

fn layer(y: f32, thickness: f32, half: f32) -> TriangleMesh {
    slab(Vec3::new(-half, y, -half), Vec3::new(half, y + thickness, half))
}

/// Reflectance of a boundary and the refracted cosine.
fn fresnel(cos: f32) -> (f32, f32) {
    let inside = (1.0 - (1.0 - cos * cos) / (IOR * IOR)).sqrt();
    let s = (cos - IOR * inside) / (cos + IOR * inside);
    let p = (inside - IOR * cos) / (inside + IOR * cos);
    (0.5 * (s * s + p * p), inside)
}

/// What a solid pane of `thickness` passes and reflects, all ways inside added up.
fn of_slab(cos: f32, thickness: f32) -> (Color, Color) {
    let (r, inside) = fresnel(cos);
    let Material { attenuation_color: color, attenuation_distance, .. } = solid();
    let power = thickness / inside / attenuation_distance;
    let once = Color::new(color.x.powf(power), color.y.powf(power), color.z.powf(power));
    let passed = (1.0 - r) * (1.0 - r) * once / (Color::ONE - r * r * once * once);
    (passed, Color::splat(r) + passed * once * r)
}

/// What a thin pane passes and reflects.
fn of_sheet(cos: f32) -> (Color, Color) {
    let fresnel = 0.04 + 0.96 * (1.0 - cos).powi(5);
    (thin().base_color * (1.0 - fresnel), Color::splat(fresnel))
}

/// Two panes behind one another.
fn both((t1, r1): (Color, Color), (t2, r2): (Color, Color)) -> Color {
    t1 * t2 / (Color::ONE - r1 * r2)
}

fn upwards(degrees: f32) -> Vec3 {
    Vec3::new(degrees.to_radians().sin(), degrees.to_radians().cos(), 0.0)
}

/// A scene of these meshes.
fn glass_of(panes: Vec<(TriangleMesh, Material)>) -> Scene {
    let mut data = scene_of(sheet(0.0, 1.0), white(), Vec3::new(0.0, 0.4, 0.3), Vec3::ZERO);
    panes.into_iter().for_each(|(mesh, material)| add(&mut data, mesh, material));
    data.environment = Some(EnvironmentMap::constant(Color::ONE));
    build(data)
}

/// Visibility of a light at infinity from the middle of the floor.
fn from_afar(scene: &Scene, direction: Vec3) -> Color {
    scene.visibility(&scene.spawn(&SurfacePoint::plain(0.01 * Vec3::Y, Vec3::Y), direction), 0)
}

#[track_caller]
fn assert_near(what: &str, found: Color, expected: Color, share: f32) {
    let off = (found - expected).abs().max_element();
    assert!(off <= share * expected.max_element(), "{what}: {found}, not {expected}");
}

#[test]
fn panes_have_their_transmittance() {
    const WIDE: f32 = 50.0;
    for degrees in [0.0, 30.0, 60.0, 75.0] {
        let (up, cos) = (upwards(degrees), degrees.to_radians().cos());
        let (one, two) = (of_sheet(cos), of_slab(cos, 0.02));
        let thin_one = glass_of(vec![(sheet(1.0, WIDE), thin())]);
        assert_near("thin", from_afar(&thin_one, up), one.0, 1e-4);
        let thin_two = glass_of(vec![(sheet(1.0, WIDE), thin()), (sheet(1.1, WIDE), thin())]);
        assert_near("two thin", from_afar(&thin_two, up), both(one, one), 1e-4);
        let solid_one = glass_of(vec![(layer(1.0, 0.02, WIDE), solid())]);
        assert_near("solid", from_afar(&solid_one, up), two.0, 1e-3);
        let solid_two =
            glass_of(vec![(layer(1.0, 0.02, WIDE), solid()), (layer(1.1, 0.02, WIDE), solid())]);
        assert_near("double glazing", from_afar(&solid_two, up), both(two, two), 2e-3);
    }
}

#[test]
fn distant_panes_do_not_mirror_what_passes_beside_them() {
    // The light between the two would have to leave both at 75 degrees.
    let scene = glass_of(vec![(sheet(1.0, 4.5), thin()), (sheet(3.0, 12.0), thin())]);
    let once = of_sheet(75f32.to_radians().cos()).0;
    assert_near("apart", from_afar(&scene, upwards(75.0)), once * once, 1e-4);
}

#[test]
fn curved_rough_and_opaque_surfaces_block() {
    let rough = Material { roughness: 0.4, ..thin() };
    let prism = {
        let mut mesh = layer(1.0, 0.2, 3.0);
        mesh.positions.to_mut().iter_mut().filter(|p| p.y > 1.1).for_each(|p| p.y += 0.2 * p.x);
        mesh
    };
    for (mesh, material) in [(sheet(1.0, 3.0), rough), (prism, solid()), (sheet(1.0, 3.0), white())]
    {
        let scene = glass_of(vec![(mesh, material)]);
        assert_eq!(from_afar(&scene, upwards(20.0)), Color::ZERO);
    }
    let free = glass_of(vec![(sheet(1.0, 3.0), thin()), (sheet(2.0, 3.0), white())]);
    assert_eq!(from_afar(&free, upwards(20.0)), Color::ZERO, "behind the pane");
    assert_eq!(from_afar(&free, upwards(85.0)), Color::ONE, "beside it");
}

#[test]
fn a_near_lamp_behind_thick_glass_is_as_bright_as_its_rays_are_dense() {
    // A ray that leaves the lamp under the angle θ lands on the floor at x(θ); the light of a
    // ring dθ falls on the ring dx.
    let (height, thickness) = (1.0f64, 0.3f64);
    let place = |angle: f64| {
        let inside = (angle.sin() / f64::from(IOR)).asin();
        (height - thickness) * angle.tan() + thickness * inside.tan()
    };
    let clear = Material { attenuation_distance: f32::INFINITY, ..solid() };
    let scene = glass_of(vec![(layer(0.4, thickness as f32, 9.0), clear)]);
    for angle in [0.1f64, 0.5, 0.9] {
        let (x, step) = (place(angle), 1e-4);
        let density = angle.sin() * 2.0 * step / (x * (place(angle + step) - place(angle - step)));
        // Across the ray, as the factor has it.
        let expected = density / angle.cos();
        let at = SurfacePoint::plain(Vec3::new(x as f32, 1e-5, 0.0), Vec3::Y);
        let offset = Vec3::new(0.0, height as f32, 0.0) - at.position;
        let ray = scene.segment(&at, offset.normalize(), offset.length(), 0.0);
        let (r, _) = fresnel(angle.cos() as f32);
        let passed = (1.0 - r) * (1.0 - r) / (1.0 - r * r);
        let found = scene.visibility(&ray, 0).x / passed / offset.length_squared();
        let ratio = f64::from(found) / expected;
        assert!((ratio - 1.0).abs() < 2e-3, "{angle}: {found}, not {expected}");
    }
}

#[test]
fn glass_that_bends_lamps_for_good_is_known() {
    let sun = |direction| PunctualLight::Directional { direction, irradiance: Color::ONE };
    let bends = |mut data: SceneData, light: Option<PunctualLight>| {
        data.punctual.extend(light);
        glass_bends_light(&build(data))
    };
    for (_, panes) in windows() {
        assert!(!bends(room(panes), Some(sun(-upwards(30.0)))));
    }
    let mut ball = own("curved-spheres");
    for material in &mut ball.materials {
        *material = Material { emission: material.emission, ..solid() };
    }
    let floor = sheet(ball.geometry.bounds().min.y - 0.1, 20.0);
    add(&mut ball, floor, white());
    assert!(bends(ball.clone(), Some(sun(Vec3::NEG_Y))));
    assert!(!bends(ball, None), "paths find the sky and lamps with extent");
}

#[test]
fn a_ray_passes_any_number_of_leaves() {
    let leaf = Material { base_alpha: 0.1, alpha_mode: AlphaMode::Mask(0.5), ..white() };
    let leaves = (0..1500).map(|k| (sheet(1.0 + 0.001 * k as f32, 1.0), leaf.clone())).collect();
    let scene = glass_of(leaves);
    let ray = Ray { origin: Vec3::Y * 0.5, tmin: 0.0, dir: Vec3::Y, tmax: f32::INFINITY };
    assert!(!scene.occluded(&ray, 0) && scene.intersect(&ray, 0).is_none());
}

/// A room of side 2 that is open above but for `panes`, seen from inside.
fn room(panes: Vec<(TriangleMesh, Material)>) -> SceneData {
    let mut data = scene_of(
        slab(Vec3::splat(-1.0), Vec3::ONE),
        white(),
        Vec3::new(0.7, 0.5, 0.8),
        Vec3::new(-0.5, -0.8, -0.4),
    );
    // Without its lid, the fourth of six faces, of which a frame is left.
    let lid = Arc::make_mut(&mut data.geometry.meshes[0]);
    lid.indices.to_mut().drain(6..8);
    for (min, max) in [([-1.0, -1.0], [-0.6, 1.0]), ([0.6, -1.0], [1.0, 1.0])] {
        let mesh = TriangleMesh {
            positions: [[min[0], min[1]], [max[0], min[1]], [max[0], max[1]], [min[0], max[1]]]
                .map(|[x, z]| Vec3::new(x, 1.0, z))
                .to_vec()
                .into(),
            indices: vec![[0, 1, 2], [0, 2, 3]].into(),
            ..TriangleMesh::default()
        };
        add(&mut data, mesh, white());
    }
    panes.into_iter().for_each(|(mesh, material)| add(&mut data, mesh, material));
    data
}

/// The mean of a picture in each of the three integrators, over four seeds, and its standard
/// error.
fn means(scene: &Scene, size: [u32; 2], spp: [u32; 3], part: Option<&str>) -> [[f64; 2]; 3] {
    let picture = |integrator, spp, seed| {
        let settings = match integrator {
            IntegratorKind::Cache => cached(scene, "auto", size, spp),
            _ => settings(scene, integrator, size, spp),
        };
        let film = render(scene, &Settings { seed, ..settings }).film;
        match part {
            None => {
                let pixels = film.radiance();
                let sum: Color = pixels.iter().sum();
                f64::from(sum.element_sum()) / (3 * pixels.len()) as f64
            }
            Some(name) => {
                let channels = film.channels(LAYERS.iter().find(|l| l.name == name).unwrap());
                channels.iter().flatten().map(|v| f64::from(*v)).sum::<f64>()
                    / channels.iter().map(Vec::len).sum::<usize>() as f64
            }
        }
    };
    [0, 1, 2].map(|k| {
        let values = [0, 1, 2, 3].map(|seed| picture(KINDS[k], spp[k], seed));
        let mean = values.iter().sum::<f64>() / 4.0;
        [mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 12.0).sqrt()]
    })
}

/// The integrators agree within the share `share` and five standard errors.
#[track_caller]
fn assert_agree(what: &str, scene: &Scene, spp: [u32; 3], share: f64) {
    let [path, cache, bdpt] = means(scene, [24, 18], spp, None);
    let line = format!("{what}: path {path:.4?}, cache {cache:.4?}, bdpt {bdpt:.4?}");
    eprintln!("{line}");
    for other in [path, cache] {
        let error = 5.0 * other[1].hypot(bdpt[1]);
        assert!((other[0] - bdpt[0]).abs() <= share * bdpt[0] + error, "{line}");
    }
    assert!(bdpt[0] > 1e-4, "{line}");
}

/// A thin and a solid pane over the room's opening.
fn windows() -> [(&'static str, Vec<(TriangleMesh, Material)>); 3] {
    let glazing = vec![(layer(1.01, 0.02, 1.5), solid()), (layer(1.06, 0.02, 1.5), solid())];
    [
        ("thin", vec![(sheet(1.02, 1.5), thin())]),
        ("solid", vec![(layer(1.02, 0.05, 1.5), solid())]),
        ("double glazing", glazing),
    ]
}

#[test]
fn lights_without_extent_shine_through_panes() {
    for (name, panes) in windows() {
        let mut data = room(panes);
        data.punctual = vec![
            PunctualLight::Directional {
                direction: -upwards(30.0),
                irradiance: Color::new(1.0, 0.9, 0.8),
            },
            PunctualLight::Point {
                position: Vec3::new(-0.3, 3.0, 0.2),
                intensity: Color::splat(3.0),
                range: f32::INFINITY,
            },
            PunctualLight::Spot {
                position: Vec3::new(0.2, 2.5, 0.1),
                direction: Vec3::NEG_Y,
                intensity: Color::splat(3.0),
                range: f32::INFINITY,
                inner: 0.05,
                outer: 0.1,
            },
        ];
        assert_agree(name, &build(data), [16, 16, 24], 0.01);
    }
}

#[test]
fn lamps_sky_and_sun_shine_through_panes() {
    for (name, panes) in windows() {
        let mut data = room(panes);
        let lamp = Material { emission: Color::splat(20.0), ..white() };
        add(&mut data, layer(2.0, 0.1, 0.2), lamp);
        data.environment = Some(EnvironmentMap::constant(Color::splat(0.2)));
        data.punctual = vec![PunctualLight::Disc {
            direction: -upwards(35.0),
            irradiance: Color::ONE,
            radius: 0.00465,
        }];
        assert_agree(name, &build(data), [64, 32, 48], 0.01);
    }
}

#[test]
fn panes_seen_from_outside_show_a_lit_room() {
    // Sun by the pane on the floor, the floor by the pane: light paths alone do not find that.
    for (name, panes) in windows() {
        let mut data = room(panes);
        data.cameras[0].projection = Projection::Orthographic { xmag: 0.5, ymag: 0.5 };
        data.cameras[0].to_world = Affine3A::from_mat3_translation(
            Mat3::from_cols(Vec3::X, Vec3::NEG_Z, Vec3::Y),
            Vec3::Y * 3.0,
        );
        data.punctual = vec![PunctualLight::Directional {
            direction: -upwards(10.0),
            irradiance: Color::splat(2.0),
        }];
        assert_agree(name, &build(data), [32, 32, 32], 0.01);
    }
}

#[test]
fn light_through_panes_is_direct_light_for_all() {
    let mut data = room(windows()[0].1.clone());
    data.environment = Some(EnvironmentMap::constant(Color::ONE));
    let scene = build(data);
    let parts = means(&scene, [24, 18], [64, 32, 48], Some("diffuse_direct"));
    for other in [parts[0], parts[1]] {
        let error = 5.0 * other[1].hypot(parts[2][1]);
        assert!((other[0] - parts[2][0]).abs() < 0.01 * parts[2][0] + error, "{parts:?}");
    }
    // The bound on paths counts no pane between a surface and its light.
    for integrator in KINDS {
        let bounded = Settings { max_bounces: 0, ..settings(&scene, integrator, [24, 18], 48) };
        let mean =
            render(&scene, &bounded).film.radiance().iter().map(|c| c.y).sum::<f32>() / 432.0;
        let direct = parts[2][0] as f32;
        assert!((mean / direct - 1.0).abs() < 0.15, "{integrator:?}: {mean}, {parts:?}");
    }
}

#[test]
fn forty_panes_before_a_wall_are_followed() {
    let clear = Material { base_color: Color::ONE, ..thin() };
    let solid = Material { attenuation_distance: f32::INFINITY, ..solid() };
    for (name, material, thickness) in [("thin", clear, 0.0), ("solid", solid, 0.004)] {
        let pane = |k: usize| match thickness {
            0.0 => sheet(0.1 + 0.01 * k as f32, 3.0),
            t => layer(0.1 + 0.01 * k as f32, t, 3.0),
        };
        let mut data = scene_of(sheet(0.0, 3.0), white(), Vec3::new(0.0, 1.0, 0.1), Vec3::ZERO);
        (0..20).for_each(|k| add(&mut data, pane(k), material.clone()));
        data.materials[0].emission = Color::ONE;
        data.cameras[0].projection = Projection::Orthographic { xmag: 0.2, ymag: 0.2 };
        data.cameras[0].to_world = Affine3A::from_mat3_translation(
            Mat3::from_cols(Vec3::X, Vec3::NEG_Z, Vec3::Y),
            Vec3::Y,
        );
        assert_agree(name, &build(data), [256, 64, 128], 0.02);
    }
}

#[test]
fn the_sun_through_a_window_has_its_known_means() {
    let Some(folder) = testdata::find("cases/sun-through-glass") else { return };
    let mut files = testdata::gltf_files(&folder);
    files.sort();
    assert_eq!(files.len(), 3);
    for file in files {
        let expected = match file.file_stem().unwrap().to_str().unwrap() {
            name if name.contains("thin") => 0.191,
            name if name.contains("solid") => 0.181,
            _ => 0.198,
        };
        let scene = build(load(&file));
        let found = means(&scene, [80, 60], [16, 16, 16], None);
        eprintln!("{}: {found:.4?}", file.display());
        for [mean, error] in found {
            let off = (mean - expected).abs();
            assert!(off < 0.01 * expected + 0.0006 + 4.0 * error, "{}: {found:?}", file.display());
        }
    }
}

#[test]
fn solid_panes_before_a_wall_have_their_known_means() {
    let Some(folder) = testdata::find("cases/glass-panes") else { return };
    for (name, expected) in [("panes_solid_4", 0.365), ("panes_solid_8", 0.366)] {
        let scene = build(load(&folder.join(name).with_extension("gltf")));
        for (integrator, spp) in KINDS.into_iter().zip([1024, 64, 512]) {
            let window = [30, 22, 34, 26];
            let middle = Settings { window, ..settings(&scene, integrator, [64, 48], spp) };
            let pixels = render(&scene, &middle).film.radiance();
            let mean = pixels.iter().map(|c| c.y).sum::<f32>() / pixels.len() as f32;
            eprintln!("{name}: {mean} by {integrator:?}, not {expected}");
            assert!((mean / expected - 1.0).abs() < 0.04, "{name}: {mean} by {integrator:?}");
        }
    }
}
