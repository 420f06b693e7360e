//! Textured lamps, lamps cut by alpha, narrow spots.

use crate::support::pictures::{build, load, render, settings};
use crate::support::rooms::scene_of;
use crate::support::testdata;
use lumicache::camera::Projection;
use lumicache::geometry::{Instance, SurfacePoint, TriangleMesh};
use lumicache::light::{PunctualLight, versine};
use lumicache::material::{AlphaMode, Material};
use lumicache::math::{Affine3A, Color, PI, Vec2, Vec3, Vec4};
use lumicache::render::IntegratorKind;
use lumicache::scene::SceneData;
use lumicache::texture::*;
use std::sync::Arc;

const INTEGRATORS: [IntegratorKind; 3] =
    [IntegratorKind::Path, IntegratorKind::Cache, IntegratorKind::Bdpt];
/// Height of the lamp, whose corners lie at ±1.
const HEIGHT: f32 = 1.5;

/// A floor of albedo 0.5, whose middle a camera sees from below the lamp.
fn floor() -> SceneData {
    let mesh = square(2.0, 0.0, 1.0);
    let material = Material {
        base_color: Color::splat(0.5),
        metallic: 0.0,
        specular: 0.0,
        ..Material::default()
    };
    let mut scene = scene_of(mesh, material, Vec3::new(0.0, 1.0, 1e-3), Vec3::ZERO);
    scene.cameras[0].projection = Projection::Perspective { yfov: 0.1 };
    scene
}

/// A square of half side `half`, its front up for `up` = 1 and down for -1.
fn square(half: f32, height: f32, up: f32) -> TriangleMesh {
    let corner = |x: f32, z: f32| Vec3::new(half * x, height, half * z * up);
    TriangleMesh {
        positions: vec![corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]
            .into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        ..TriangleMesh::default()
    }
}

/// The floor below a lamp with these corners in the texture.
fn lamp(material: Material, textures: Vec<Texture>, uv: [[Vec2; 4]; 2]) -> SceneData {
    let mut scene = floor();
    let mesh = TriangleMesh {
        uv: uv.map(|uv| Some(uv.to_vec())),
        material: 1,
        ..square(1.0, HEIGHT, -1.0)
    };
    scene.geometry.meshes.push(Arc::new(mesh));
    scene.geometry.instances.push(Instance { mesh: 1, to_world: Affine3A::IDENTITY });
    scene.materials.push(Material { base_color: Color::ZERO, metallic: 0.0, ..material });
    scene.textures = textures;
    scene
}

/// A texture of `n` by `n` texels of the given values.
fn texels(n: u32, wrap: Wrap, nearest: bool, texel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
    let pixels = (0..n * n).map(|i| texel(i % n, i / n)).collect();
    let image = TextureImage { width: n, height: n, pixels: TexturePixels::Rgba8(pixels) };
    Texture { image: Arc::new(image), wrap_s: wrap, wrap_t: wrap, nearest }
}

fn plain(texture: u32) -> TextureRef {
    TextureRef {
        texture,
        uv_set: 0,
        offset: Vec2::ZERO,
        rotation: 0.0,
        scale: Vec2::ONE,
        color_space: ColorSpace::Linear,
    }
}

const UNIT: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];

/// Radiance of the middle of the floor: ρ/π times the irradiance of the lamp's points, so many
/// along each side that whole numbers of them lie on the texels of the tests.
fn expected(scene: &SceneData) -> Color {
    let (mesh, material) = (&scene.geometry.meshes[1], &scene.materials[1]);
    let side = 960;
    let mut sum = Color::ZERO;
    for i in 0..side * side {
        let t = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
        let place = Vec3::new(2.0 * t.x - 1.0, HEIGHT, 2.0 * t.y - 1.0);
        // The corners 0 to 3 stand at (-1, -1), (1, -1), (1, 1), (-1, 1).
        let uv = [0, 1].map(|k| {
            mesh.uv[k].as_ref().map_or(Vec2::ZERO, |c| {
                if t.y <= t.x {
                    c[0] + (c[1] - c[0]) * t.x + (c[2] - c[1]) * t.y
                } else {
                    c[0] + (c[2] - c[3]) * t.x + (c[3] - c[0]) * t.y
                }
            })
        });
        let mut point = SurfacePoint::plain(place, -Vec3::Y);
        point.uv = uv;
        if let Some(c) = &mesh.colors {
            point.color = if t.y <= t.x {
                c[0] + (c[1] - c[0]) * t.x + (c[2] - c[1]) * t.y
            } else {
                c[0] + (c[2] - c[3]) * t.x + (c[3] - c[0]) * t.y
            };
        }
        let light = material.emission_at(&scene.textures, &point)
            * material.opacity(&scene.textures, &point);
        let squared = place.length_squared();
        sum += light * (HEIGHT * HEIGHT / (squared * squared));
    }
    sum * (4.0 / (side * side) as f32 * 0.5 / PI)
}

/// Demands `right` as the mean of the picture, whose view is so narrow that it is the middle's.
fn assert_floor(name: &str, scene: SceneData, right: Color) {
    let scene = build(scene);
    assert!(!scene.lights().has_environment(), "{name}: a dome was switched on");
    for kind in INTEGRATORS {
        let film = render(&scene, &settings(&scene, kind, [12, 12], 256)).film;
        let mean = film.pixels().iter().map(|p| p.radiance()).sum::<Color>() / 144.0;
        let error = ((mean - right) / right.max_element()).abs().max_element();
        assert!(error < 0.02, "{name}, {}: {mean} is not {right}", kind.name());
    }
}

#[test]
fn textured_lamps_send_what_their_texels_send() {
    let glow = |texture| Material {
        emission: Color::new(20.0, 10.0, 5.0),
        emission_texture: Some(texture),
        ..Material::default()
    };
    let white = |on: bool| if on { [255; 4] } else { [0, 0, 0, 255] };
    let one = |wrap, nearest| texels(10, wrap, nearest, |x, y| white((x, y) == (7, 2)));
    let few = || texels(64, Wrap::Repeat, false, |x, y| white((x * 7 + y * 13) % 509 == 3));
    let wide = |lower: f32, upper: f32| UNIT.map(|t| lower + (upper - lower) * t);
    let turned = TextureRef {
        offset: Vec2::new(0.3, -0.2),
        rotation: 0.4,
        scale: Vec2::new(37.3, 21.7),
        ..plain(0)
    };
    let srgb = TextureRef { color_space: ColorSpace::Srgb, ..plain(0) };
    let grey = texels(16, Wrap::Repeat, false, |x, y| [(x * 16) as u8, (y * 16) as u8, 80, 255]);
    let second = TextureRef { uv_set: 1, ..plain(0) };
    for (name, reference, texture, uv) in [
        ("one texel of a hundred", plain(0), one(Wrap::Repeat, true), UNIT),
        ("one, interpolated", plain(0), one(Wrap::Repeat, false), UNIT),
        ("a few texels of 4096", plain(0), few(), UNIT),
        ("turned and repeated", turned, one(Wrap::Repeat, true), UNIT),
        ("mirrored", plain(0), one(Wrap::Mirror, false), wide(-1.5, 2.5)),
        ("clamped", plain(0), one(Wrap::Clamp, true), wide(-0.5, 1.5)),
        ("sRGB", srgb, grey, UNIT),
        ("second coordinates", second, one(Wrap::Repeat, true), UNIT),
        (
            "a strip of the texture",
            plain(0),
            one(Wrap::Repeat, true),
            UNIT.map(|t| Vec2::new(t.x, 0.25)),
        ),
    ] {
        let other =
            if reference.uv_set == 1 { [[Vec2::ZERO; 4], uv] } else { [uv, [Vec2::ZERO; 4]] };
        let scene = lamp(glow(reference), vec![texture], other);
        let right = expected(&scene);
        assert!(right.max_element() > 0.0, "{name}");
        assert_floor(name, scene, right);
    }
}

#[test]
fn what_alpha_cuts_out_of_a_lamp_does_not_shine() {
    let holes = texels(16, Wrap::Repeat, true, |x, y| {
        [255, 255, 255, if (x / 4 + y / 4) % 2 == 0 { 255 } else { 40 }]
    });
    let spots = texels(10, Wrap::Repeat, true, |x, y| {
        if (x, y) == (7, 2) || y == 9 { [255; 4] } else { [0, 0, 0, 255] }
    });
    let cut = |mode| Material {
        emission: Color::splat(3.0),
        alpha_mode: mode,
        base_color_texture: Some(plain(0)),
        ..Material::default()
    };
    for mode in [AlphaMode::Mask(0.5), AlphaMode::Blend] {
        let other = [UNIT, UNIT.map(|t| 1.5 * t)];
        let simple = lamp(cut(mode), vec![holes.clone()], other);
        assert_floor("holes", simple.clone(), expected(&simple));
        let both = |texture| Material { emission_texture: Some(texture), ..cut(mode) };
        let same = lamp(both(plain(1)), vec![holes.clone(), spots.clone()], other);
        assert_floor("texture and holes", same.clone(), expected(&same));
        let apart = TextureRef { uv_set: 1, ..plain(1) };
        let apart = lamp(both(apart), vec![holes.clone(), spots.clone()], other);
        assert_floor("texture and holes apart", apart.clone(), expected(&apart));
        let constant = Material {
            base_color_texture: None,
            base_alpha: 0.3,
            emission: Color::splat(3.0),
            ..cut(mode)
        };
        let mut vertices = lamp(Material { base_alpha: 1.0, ..constant.clone() }, vec![], other);
        let mesh = Arc::make_mut(&mut vertices.geometry.meshes[1]);
        mesh.colors = Some([0.2, 0.9, 0.7, 0.6].map(|a| Vec4::new(1.0, 1.0, 1.0, a)).to_vec());
        assert_floor("vertices", vertices.clone(), expected(&vertices));
        if mode == AlphaMode::Blend {
            let constant = lamp(constant, vec![], other);
            assert_floor("factor", constant.clone(), expected(&constant));
        }
    }
}

/// Light samples of textured lamps have the density that is said of them, and no more noise than
/// the shape of the lamp explains.
#[test]
fn light_samples_lie_where_a_triangle_glows() {
    let spot =
        texels(
            32,
            Wrap::Repeat,
            true,
            |x, y| if (x, y) == (20, 9) { [255; 4] } else { [0, 0, 0, 255] },
        );
    let material =
        Material { emission: Color::ONE, emission_texture: Some(plain(0)), ..Material::default() };
    let data = lamp(material, vec![spot], [UNIT; 2]);
    let right = expected(&data).x * PI / 0.5;
    let scene = build(data);
    let (lights, n) = (scene.lights(), Some(Vec3::Y));
    let count = 20_000;
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..count {
        let u = Vec2::new((i as f32 + 0.5) / count as f32, (i as f32 * 0.618_034).fract());
        let Some(s) = lights.sample(Vec3::ZERO, n, (i as f32 * 0.754_877_7).fract(), u) else {
            continue;
        };
        let lumicache::light::LightSource::Triangle { instance, triangle, .. } = s.source else {
            panic!()
        };
        let pdf = lights.pdf_triangle(Vec3::ZERO, n, instance, triangle, s.wi, s.distance);
        let light = scene.sent(s.source, s.radiance, s.wi).x;
        if light > 0.0 {
            assert!((s.pdf / pdf - 1.0).abs() < 1e-3, "{} {pdf}", s.pdf);
        }
        let x = f64::from(light * s.wi.y / s.pdf);
        (sum, squares) = (sum + x, squares + x * x);
    }
    let mean = sum / f64::from(count);
    assert!((mean / f64::from(right) - 1.0).abs() < 0.01, "{mean} {right}");
    assert!(squares / f64::from(count) < 2.0 * mean * mean, "noise {squares}");
}

#[test]
fn narrow_spots_have_their_intensity_on_the_axis() {
    for degrees in [0.1_f32, 1.0, 20.0] {
        let mut scene = floor();
        let outer = versine(0.5 * degrees.to_radians());
        scene.punctual.push(PunctualLight::Spot {
            position: Vec3::new(0.0, 2.0, 0.0),
            direction: -Vec3::Y,
            intensity: Color::splat(100.0),
            range: f32::INFINITY,
            inner: 0.99 * outer,
            outer,
        });
        // So narrow a view that the spot fills it.
        scene.cameras[0].projection = Projection::Perspective { yfov: 0.5 * degrees.to_radians() };
        assert_floor("spot", scene, Color::splat(100.0 / 4.0 * 0.5 / PI));
    }
}

/// Files of the extra test data with their right means over rows and columns of the picture. The
/// small screen's is that of its 36 glowing texels, each taken as a point, within 1.5 %; the
/// patch's is that of the same lamp as geometry.
#[test]
fn files_that_lost_or_invented_light_have_their_right_values() {
    for (name, right, rows, columns) in [
        ("emissive-patch/screen_0.01.gltf", 0.0138, 30..48, 0..64),
        ("emissive-patch/patch32.gltf", 0.1257, 30..48, 0..64),
        ("emissive-patch/patch_geo.gltf", 0.1257, 30..48, 0..64),
        ("alpha-lamp/alpha_MASK_0.gltf", 0.0599, 22..26, 30..34),
        ("alpha-lamp/alpha_BLEND_0.gltf", 0.0599, 22..26, 30..34),
    ] {
        let Some(path) = testdata::find(&format!("cases/{name}")) else { return };
        let scene = build(load(&path));
        for kind in INTEGRATORS {
            let film = render(&scene, &settings(&scene, kind, [64, 48], 64)).film;
            let rows = film.pixels()[rows.start * 64..rows.end * 64].chunks(64);
            let part: Vec<f32> =
                rows.flat_map(|row| &row[columns.clone()]).map(|p| p.radiance().x).collect();
            let mean = part.iter().sum::<f32>() / part.len() as f32;
            let error = (mean / right - 1.0).abs();
            assert!(error < 0.02, "{name}, {}: {mean} is not {right}", kind.name());
        }
    }
}
