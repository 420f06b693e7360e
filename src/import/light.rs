//! KHR_lights_punctual.

use super::ImportOptions;
use super::document::Document;
use super::fault::{Fault, Parsed};
use super::ies::{Luminaire, Profiles};
use super::warnings::Warnings;
use crate::light::{PunctualLight, versine};
use crate::math::{Color, Vec3};
use glam::{DAffine3, DVec3};
use gltf::json::extensions::scene::khr_lights_punctual as json;
use gltf::json::validation::Checked;

#[derive(Clone)]
enum Kind {
    Point,
    Spot {
        inner: f32,
        outer: f32,
    },
    Directional,
    /// The `extras` name an IES file.
    Ies(Luminaire),
}

/// A light as the document describes it, still without a place.
#[derive(Clone)]
pub(super) struct Light {
    kind: Kind,
    intensity: Color,
    range: f32,
}

/// All lights of the document; `None` for one of an unknown type.
pub(super) fn lights(
    document: &Document, options: &ImportOptions, profiles: &mut Profiles, warnings: &mut Warnings,
) -> Parsed<Vec<Option<Light>>> {
    let lights: &[json::Light] = document.root().as_ref();
    let read = |(i, json)| {
        let path = format!("/extensions/KHR_lights_punctual/lights/{i}");
        light(json, &path, document, options, profiles, warnings)
    };
    lights.iter().enumerate().map(read).collect()
}

fn light(
    json: &json::Light, path: &str, document: &Document, options: &ImportOptions,
    profiles: &mut Profiles, warnings: &mut Warnings,
) -> Parsed<Option<Light>> {
    let color = Color::from_array(json.color);
    let kind = match (json.type_, &json.spot) {
        (Checked::Invalid, _) => return Ok(None),
        (Checked::Valid(json::Type::Point), _) => Kind::Point,
        (Checked::Valid(json::Type::Directional), _) => Kind::Directional,
        (Checked::Valid(json::Type::Spot), Some(spot)) => self::spot(spot, path, warnings)?,
        (Checked::Valid(json::Type::Spot), None) => {
            return Err(Fault::new(path, "the property \"spot\" is missing"));
        }
    };
    let luminaire =
        Luminaire::of_light(document, path, color, json.intensity, profiles, options.light_units)?;
    let kind = match (kind, luminaire) {
        (Kind::Directional, Some(_)) => {
            let what = "an IES file needs a light with a place: a point or a spot";
            return Err(Fault::new(path, what));
        }
        (_, Some(luminaire)) => Kind::Ies(luminaire),
        (kind, None) => kind,
    };
    let intensity = color * json.intensity / options.light_units.efficacy();
    Ok(Some(Light { kind, intensity, range: json.range.unwrap_or(f32::INFINITY) }))
}

fn spot(json: &json::Spot, path: &str, warnings: &mut Warnings) -> Parsed<Kind> {
    let (mut inner, mut outer) = (json.inner_cone_angle, json.outer_cone_angle);
    let at = format!("{path}/spot/innerConeAngle");
    if inner > outer {
        warnings.mend(&at, format!("{inner} exceeds the outer angle {outer}: they are swapped"))?;
        (inner, outer) = (outer, inner);
    } else if inner == outer {
        warnings.mend(&at, "it equals the outer angle, and should be less")?;
    }
    if outer <= 0.0 {
        return Err(Fault::new(format!("{path}/spot/outerConeAngle"), "must be greater than 0"));
    }
    Ok(Kind::Spot { inner: versine(inner), outer: versine(outer) })
}

impl Light {
    /// The light on a node: it shines along the node's -Z, and the node's scale does not touch it.
    pub fn placed(&self, to_world: &DAffine3) -> Option<PunctualLight> {
        let position: Vec3 = to_world.translation.as_vec3();
        let direction =
            to_world.transform_vector3(DVec3::NEG_Z).try_normalize().map(|d| d.as_vec3());
        let Light { ref kind, intensity, range } = *self;
        Some(match *kind {
            Kind::Ies(ref luminaire) => return luminaire.placed(to_world, range),
            Kind::Point => PunctualLight::Point { position, intensity, range },
            Kind::Spot { inner, outer } => PunctualLight::Spot {
                position,
                direction: direction?,
                intensity,
                range,
                inner,
                outer,
            },
            Kind::Directional => {
                PunctualLight::Directional { direction: direction?, irradiance: intensity }
            }
        })
    }
}
