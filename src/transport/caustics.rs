//! Whether a scene has light that light paths alone find.

use crate::accel::Ray;
use crate::light::{Emission, Focus, LightSource};
use crate::sampling::Sampler;
use crate::scene::{Scene, same_direction};

/// Rays from the lights.
const RAYS: u32 = 1 << 14;
/// Surfaces of glass that a ray passes.
const FACES: u32 = 32;
/// Part of the rays through glass that may be bent: the edges of panes bend some.
const EDGES: u32 = 8;

/// True if glass bends light of lamps without extent, or of discs in the sky, for good, as bottles
/// and spheres do: light samples do not find that light, and no path from the camera does.
pub fn glass_bends_light(scene: &Scene) -> bool {
    if !scene.has_panes() {
        return false;
    }
    let emission = scene.emission_sampler(Some(around_glass(scene)));
    let bent = |number| {
        let mut sampler = Sampler::new(0, number);
        let (place, turn, select) = (sampler.next_2d(), sampler.next_2d(), sampler.next_1d());
        let start = emission.sample(select, place, turn)?;
        let hidden = match start.end.source {
            LightSource::Punctual(_) => true,
            LightSource::Environment => scene.lights().has_discs(),
            LightSource::Triangle { .. } => false,
        };
        if hidden { is_bent(scene, &start) } else { None }
    };
    let through: Vec<bool> = (0..RAYS).filter_map(bent).collect();
    through.iter().filter(|bent| **bent).count() * EDGES as usize > through.len()
}

/// The ball around everything that may be a pane.
fn around_glass(scene: &Scene) -> Focus {
    let bounds = scene.geometry().of_materials(|material| scene.is_pane(material)).bounds();
    Focus { center: bounds.center(), radius: 0.5 * bounds.diagonal() }
}

/// Whether light that passes glass has another direction behind it; `None` if it passes none, or
/// falls on nothing.
fn is_bent(scene: &Scene, start: &Emission) -> Option<bool> {
    let (origin, dir) = (start.origin, start.direction);
    let mut ray = Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY };
    for face in 0..FACES {
        let (mut at, _) = scene.intersect(&ray, 0)?;
        match scene.pane(&mut at) {
            Some((_, onward)) => ray = scene.spawn(&at, onward),
            None => return (face > 0).then(|| !same_direction(ray.dir, dir)),
        }
    }
    None
}
