//! KHR_lights_punctual.

use super::ImportOptions;
use super::ies::{Luminaire, Profiles};
use super::json::{Json, Parsed, quote};
use crate::light::PunctualLight;
use crate::math::{Color, Vec3};
use glam::{DAffine3, DVec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

#[derive(Clone)]
enum Kind {
    Point,
    Spot {
        cos_inner: f32,
        cos_outer: f32,
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
    root: &Json,
    options: &ImportOptions,
    profiles: &mut Profiles,
    warnings: &mut Vec<String>,
) -> Parsed<Vec<Option<Light>>> {
    let Some(extension) = root.extension("KHR_lights_punctual")? else { return Ok(Vec::new()) };
    extension.array("lights")?.iter().map(|json| light(json, options, profiles, warnings)).collect()
}

fn light(
    json: &Json,
    options: &ImportOptions,
    profiles: &mut Profiles,
    warnings: &mut Vec<String>,
) -> Parsed<Option<Light>> {
    json.object()?;
    json.string("name")?;
    let color = Color::from_array(json.numbers_in::<3>("color", 1.0, 0.0, f64::INFINITY)?);
    let strength = json.number_in("intensity", 1.0, 0.0, f64::INFINITY)?;
    let intensity = color * strength / options.light_units.efficacy();
    let range = match json.number("range")? {
        None => f32::INFINITY,
        Some(range) if range > 0.0 => range as f32,
        Some(range) => return Err(json.fault_at("range", format!("{range} is not greater than 0"))),
    };
    let mut kind = match json.need_string("type")? {
        "point" => Kind::Point,
        "directional" => Kind::Directional,
        "spot" => spot(&json.need_object("spot")?)?,
        other => {
            warnings.push(format!(
                "{} of the unknown type {} is left out",
                json.label(),
                quote(other)
            ));
            return Ok(None);
        }
    };
    if let Some(luminaire) =
        Luminaire::of_light(json, color, strength, profiles, options.light_units)?
    {
        if matches!(kind, Kind::Directional) {
            return Err(json.fault("an IES file needs a light with a place: a point or a spot"));
        }
        kind = Kind::Ies(luminaire);
    }
    Ok(Some(Light { kind, intensity, range }))
}

fn spot(json: &Json) -> Parsed<Kind> {
    let outer = json.number_in("outerConeAngle", FRAC_PI_4, 0.0, FRAC_PI_2)?;
    let inner = json.number_in("innerConeAngle", 0.0, 0.0, FRAC_PI_2)?;
    if outer <= 0.0 {
        return Err(json.fault_at("outerConeAngle", "must be greater than 0"));
    }
    if inner > outer {
        return Err(
            json.fault_at("innerConeAngle", format!("{inner} exceeds the outer angle {outer}"))
        );
    }
    Ok(Kind::Spot { cos_inner: inner.cos(), cos_outer: outer.cos() })
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
            Kind::Spot { cos_inner, cos_outer } => PunctualLight::Spot {
                position,
                direction: direction?,
                intensity,
                range,
                cos_inner,
                cos_outer,
            },
            Kind::Directional => {
                PunctualLight::Directional { direction: direction?, irradiance: intensity }
            }
        })
    }
}
