//! Flattened objects, clipping planes, bright pixels.

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
