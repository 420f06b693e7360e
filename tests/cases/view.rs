//! Flattened objects, clipping planes, bright pixels.

use crate::support::gltf_maker::{Gltf, floats};
use crate::support::pictures::{build, load, render, settings};
use crate::support::testdata;
use lumicache::geometry::interpolate;
use lumicache::math::Vec3;
use lumicache::render::IntegratorKind;
use serde_json::json;

/// A tetrahedron with normals, under nodes of these transforms.
fn under(nodes: &[serde_json::Value]) -> Gltf {
    let mut file = Gltf::new();
    let points = [0.0, 0.0, 0.0, 1.0, 0.0, 0.2, 0.0, 0.1, -1.0, 0.3, 1.0, -0.3];
    let position = file.positions(&points);
    let normals = [[-0.6, -0.8, 0.0], [0.8, 0.0, 0.6], [0.0, 0.6, -0.8], [0.0, 1.0, 0.0]].concat();
    let normal = file.accessor(&floats(&normals), 5126, "VEC3", 4, json!({}), None);
    let indices: Vec<u8> = [[0_u8, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]].concat();
    let indices = file.accessor(&indices, 5121, "SCALAR", 12, json!({}), None);
    let primitive =
        json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices});
    let mesh = file.add("meshes", json!({"primitives": [primitive]}));
    let mut child = json!({"mesh": mesh});
    for (i, node) in nodes.iter().enumerate().rev() {
        if i + 1 < nodes.len() {
            child = json!({"children": [file.node(child)]});
        }
        for (key, value) in node.as_object().unwrap() {
            child[key] = value.clone();
        }
    }
    let root = file.node(child);
    file.scene(&[root]);
    file
}

/// Flat along an axis, along a slanted direction, and below a rotated and a shearing parent.
#[test]
fn flattened_objects_lie_in_their_plane_and_face_away_from_it() {
    let quarter = 0.5_f64.sqrt();
    let turn = json!({"rotation": [quarter, 0, 0, quarter]});
    let slanted = json!({"matrix": [1, 0.5, 0, 0, 0, 0, 0, 0, 0, 0.3, 1, 0, 2, 1, 0, 1]});
    let shear = json!({"matrix": [1, 0, 0, 0, 0.7, 1, 0, 0, 0, 0.2, 1, 0, 0, 0, 3, 1]});
    let flat = json!({"scale": [1, 0, 1]});
    for (nodes, normal) in [
        (vec![flat.clone()], Vec3::Y),
        (vec![json!({"scale": [2, 1e-9, 3]})], Vec3::Y),
        (vec![turn.clone(), flat.clone()], Vec3::Z),
        (vec![flat.clone(), turn.clone()], Vec3::Y),
        (vec![slanted.clone()], Vec3::new(-0.5, 1.0, -0.3).normalize()),
        (vec![shear, turn, flat], Vec3::Z),
    ] {
        let scene = under(&nodes).load();
        assert_eq!(scene.geometry.instances.len(), 1, "{nodes:?}: {:?}", scene.warnings);
        let count = scene.geometry.triangle_count();
        assert!((2..=4).contains(&count), "{nodes:?}: {count}");
        for triangle in 0..count as u32 {
            let at = interpolate(&scene.geometry, 0, triangle, 0.3, 0.3, -normal);
            assert!(at.ng.dot(normal) > 0.9999, "{nodes:?}: {}", at.ng);
            assert!(at.frame.n.dot(normal) > 0.9999, "{nodes:?}: {}", at.frame.n);
        }
        build(scene);
    }
}

#[test]
fn what_is_squeezed_to_a_line_or_a_point_is_left_out_with_a_warning() {
    for scale in [[1, 0, 0], [0, 0, 0]] {
        let scene = under(&[json!({"scale": scale})]).load();
        assert!(scene.geometry.instances.is_empty());
        assert!(
            scene.warnings.iter().any(|w| w.contains("a line or a point")),
            "{:?}",
            scene.warnings
        );
    }
}

#[test]
fn a_floor_flattened_by_its_node_is_lit_as_the_flat_one() {
    for name in ["flat_quad", "flat_scale0"] {
        let Some(path) = testdata::find(&format!("cases/flat-scale0/{name}.gltf")) else { return };
        let scene = build(load(&path));
        for kind in [IntegratorKind::Path, IntegratorKind::Cache, IntegratorKind::Bdpt] {
            let film = render(&scene, &settings(&scene, kind, [64, 48], 16)).film;
            let rows = film.pixels()[22 * 64..26 * 64].chunks(64);
            let middle = rows.flat_map(|row| &row[30..34]).map(|p| p.radiance().x);
            let mean = middle.sum::<f32>() / 16.0;
            assert!((mean / 0.0367 - 1.0).abs() < 0.03, "{name}, {}: {mean}", kind.name());
        }
    }
}

mod clip {
    use crate::support::desk::{Desk, QUICK, mean};
    use crate::support::pictures::{build, render, settings, with_rays};
    use crate::support::rooms::{ALBEDO, EMISSION, cube, diffuse};
    use crate::support::testdata;
    use lumicache::camera::{Camera, Projection};
    use lumicache::film::LAYERS;
    use lumicache::imagefile::exr;
    use lumicache::material::Material;
    use lumicache::math::{Affine3A, Color, Vec3};
    use lumicache::render::{IntegratorKind, Settings};

    const INTEGRATORS: [IntegratorKind; 3] =
        [IntegratorKind::Cache, IntegratorKind::Path, IntegratorKind::Bdpt];
    const SIZE: [u32; 2] = [12, 12];

    /// The mean radiance of a closed glowing box seen from 2 before its front wall, and the depths
    /// of the pixels.
    fn seen(kind: IntegratorKind, projection: Projection, clip: [f32; 2]) -> (Color, Vec<f32>) {
        let mut data = cube(Material { emission: EMISSION, ..diffuse() });
        let to_world = Affine3A::from_translation(Vec3::new(0.0, 0.0, 3.0));
        let camera = Camera { name: String::new(), projection, aspect: None, to_world, clip };
        data.cameras = vec![camera];
        let scene = build(data);
        let defaults = settings(&scene, kind, SIZE, 64);
        let scheme = with_rays(defaults.scheme.clone(), 256);
        let film = render(&scene, &Settings { scheme, max_bounces: 24, ..defaults }).film;
        let depth = LAYERS.iter().find(|l| l.name == "Z").unwrap();
        let radiance = film.radiance();
        (radiance.iter().sum::<Color>() / radiance.len() as f32, film.channels(depth).remove(0))
    }

    #[test]
    fn planes_cut_what_the_camera_sees_and_no_light() {
        let inside = EMISSION / (Color::ONE - ALBEDO);
        let views = [
            Projection::Perspective { yfov: 0.4 },
            Projection::Orthographic { xmag: 0.8, ymag: 0.8 },
        ];
        for (kind, projection) in INTEGRATORS.iter().flat_map(|k| views.map(|p| (*k, p))) {
            for (clip, wanted) in [
                (Camera::NO_CLIP, EMISSION),
                ([0.1, 100.0], EMISSION),
                // Behind the front wall.
                ([2.5, f32::INFINITY], inside),
                // Along the axis: towards the corners the back wall is farther away than that.
                ([2.5, 4.01], inside),
                // Between the walls there is nothing.
                ([2.5, 3.5], Color::ZERO),
                ([4.5, 9.0], Color::ZERO),
            ] {
                let (mean, depths) = seen(kind, projection, clip);
                let error = (mean - wanted).abs().max_element() / inside.max_element();
                assert!(error < 0.02, "{kind:?} {projection:?} {clip:?}: {mean}, not {wanted}");
                let hit = wanted != Color::ZERO;
                let first = if wanted == EMISSION { 2.0 } else { 4.0 };
                for depth in depths {
                    let sound = if hit {
                        (first..1.1 * first).contains(&(depth + 1e-3))
                    } else {
                        !(0.0..9.0).contains(&depth) || depth == 0.0
                    };
                    assert!(sound, "{kind:?} {projection:?} {clip:?}: depth {depth}");
                }
            }
        }
    }

    #[test]
    fn the_planes_of_a_file_show_the_inside_of_a_room() {
        let Some(file) = testdata::find("cases/near-clip/nearclip.gltf") else { return };
        let desk = Desk::new();
        let render = |more: &[&str]| {
            let scene = file.to_str().unwrap();
            desk.print(&[&["render", scene, "-o", "a.exr", "--spp", "4"], QUICK, more].concat());
            mean(&exr::read(&desk.path("a.exr")).unwrap(), "R")
        };
        assert!(render(&[]) > 0.05);
        assert!(render(&["--no-clip"]) < 1e-3);
    }
}
