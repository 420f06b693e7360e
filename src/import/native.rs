//! The BRDFs of the caching papers as the `extras` of a glTF material describe them; the format is
//! documented at [`super`].

use super::json::{Json, Parsed, quote};
use crate::material::{LafortuneLobe, NativeBrdf};
use crate::math::Color;

/// Reads the object `extras.lumicache` of a material.
pub(super) fn brdf(json: &Json) -> Parsed<NativeBrdf> {
    json.object()?;
    let kd = albedo(json, "kd")?;
    let known: &[&str] = match json.need_string("brdf")? {
        "phong" => &["kd", "ks", "exponent"],
        "lafortune" => &["kd", "lobes"],
        "ward" => &["kd", "ks", "alpha_x", "alpha_y"],
        other => {
            return Err(json.fault_at(
                "brdf",
                format!("{} is none of \"phong\", \"lafortune\" and \"ward\"", quote(other)),
            ));
        }
    };
    reject_unknown(json, known)?;
    Ok(match json.need_string("brdf")? {
        "phong" => {
            let exponent = json.need_number("exponent")?;
            if exponent < 0.0 {
                return Err(json.fault_at("exponent", format!("{exponent} is less than 0")));
            }
            NativeBrdf::Phong { kd, ks: specular(json, kd)?, exponent: exponent as f32 }
        }
        "ward" => {
            let alpha_x = roughness(json, "alpha_x")?;
            let alpha_y = if json.has("alpha_y") { roughness(json, "alpha_y")? } else { alpha_x };
            NativeBrdf::WardDuer { kd, ks: specular(json, kd)?, alpha_x, alpha_y }
        }
        _ => {
            let elements = json.array("lobes")?;
            let mut lobes = [LafortuneLobe::default(); 3];
            if elements.is_empty() || elements.len() > lobes.len() {
                return Err(json.fault_at(
                    "lobes",
                    format!("must have 1 to 3 elements, and has {}", elements.len()),
                ));
            }
            for (lobe, element) in lobes.iter_mut().zip(&elements) {
                *lobe = self::lobe(element)?;
            }
            NativeBrdf::Lafortune { kd, lobes, count: elements.len() as u8 }
        }
    })
}

/// A misspelt property would silently give another material.
fn reject_unknown(json: &Json, known: &[&str]) -> Parsed<()> {
    match json.object()?.keys().find(|key| *key != "brdf" && !known.contains(&key.as_str())) {
        Some(key) => Err(json.fault(format!(
            "the property {} is unknown here; known are brdf, {}",
            quote(key),
            known.join(", ")
        ))),
        None => Ok(()),
    }
}

/// A number for all channels, or three.
fn channels(json: &Json, key: &str) -> Parsed<Option<Color>> {
    match json.get(key)? {
        None => Ok(None),
        Some(value) if value.elements().is_ok() => {
            Ok(json.numbers::<3>(key)?.map(|v| Color::new(v[0] as f32, v[1] as f32, v[2] as f32)))
        }
        Some(value) => Ok(Some(Color::splat(value.as_number()? as f32))),
    }
}

fn albedo(json: &Json, key: &str) -> Parsed<Color> {
    let albedo = channels(json, key)?.unwrap_or(Color::ZERO);
    if albedo.min_element() < 0.0 || albedo.max_element() > 1.0 {
        return Err(json.fault_at(key, "an albedo is from 0 to 1"));
    }
    Ok(albedo)
}

fn specular(json: &Json, kd: Color) -> Parsed<Color> {
    let ks = albedo(json, "ks")?;
    if (kd + ks).max_element() > 1.0 + 1e-5 {
        return Err(json.fault_at(
            "ks",
            "kd + ks exceeds 1, so the material would reflect more light than it receives",
        ));
    }
    Ok(ks)
}

fn roughness(json: &Json, key: &str) -> Parsed<f32> {
    let alpha = json.need_number(key)?;
    if alpha <= 0.0 || alpha > 1.0 {
        return Err(json.fault_at(key, format!("{alpha} is not above 0 and at most 1")));
    }
    Ok(alpha as f32)
}

fn lobe(json: &Json) -> Parsed<LafortuneLobe> {
    reject_unknown(json, &["cx", "cy", "cz", "exponent"])?;
    let need = |key: &str| channels(json, key)?.ok_or_else(|| json.missing(key));
    let cx = need("cx")?;
    let cy = channels(json, "cy")?.unwrap_or(cx);
    let lobe = LafortuneLobe { cx, cy, cz: need("cz")?, exponent: need("exponent")? };
    if lobe.exponent.min_element() < 0.0 {
        return Err(json.fault_at("exponent", "an exponent is at least 0"));
    }
    Ok(lobe)
}

#[cfg(test)]
mod tests {
    use super::super::json::Fault;
    use super::super::parse::parse;
    use super::*;

    fn read(text: &str) -> Parsed<NativeBrdf> {
        brdf(&Json::root(&parse(text.as_bytes())?))
    }

    #[test]
    fn the_three_models() {
        assert_eq!(
            read(r#"{"brdf": "phong", "kd": 0.2, "ks": [0.3, 0.4, 0.5], "exponent": 50}"#).unwrap(),
            NativeBrdf::Phong {
                kd: Color::splat(0.2),
                ks: Color::new(0.3, 0.4, 0.5),
                exponent: 50.0
            }
        );
        assert_eq!(
            read(r#"{"brdf": "ward", "ks": 0.1, "alpha_x": 0.1, "alpha_y": 0.3}"#).unwrap(),
            NativeBrdf::WardDuer {
                kd: Color::ZERO,
                ks: Color::splat(0.1),
                alpha_x: 0.1,
                alpha_y: 0.3
            }
        );
        let lafortune = r#"{"brdf": "lafortune", "kd": 0.1, "lobes": [{"cx": -1, "cz": [0.9, 0.8, 0.7], "exponent": 20}]}"#;
        let Ok(NativeBrdf::Lafortune { lobes, count: 1, .. }) = read(lafortune) else {
            panic!("no Lafortune BRDF")
        };
        assert_eq!(lobes[0].cy, Color::splat(-1.0));
        assert_eq!(lobes[0].cz, Color::new(0.9, 0.8, 0.7));
    }

    #[test]
    fn bad_values_are_named() {
        for (text, path) in [
            (r#"{"kd": 0.2}"#, ""),
            (r#"{"brdf": "phnog"}"#, "/brdf"),
            (r#"{"brdf": "phong", "kd": 1.2, "exponent": 1}"#, "/kd"),
            (r#"{"brdf": "phong", "kd": 0.6, "ks": 0.6, "exponent": 1}"#, "/ks"),
            (r#"{"brdf": "phong", "exponent": -1}"#, "/exponent"),
            (r#"{"brdf": "phong", "exponent": 1, "shininess": 1}"#, ""),
            (r#"{"brdf": "ward", "alpha_x": 0}"#, "/alpha_x"),
            (r#"{"brdf": "lafortune", "lobes": []}"#, "/lobes"),
            (
                r#"{"brdf": "lafortune", "lobes": [{"cx": 1, "cz": 1, "exponent": "a"}]}"#,
                "/lobes/0/exponent",
            ),
        ] {
            let Fault { path: actual, .. } = read(text).expect_err(text);
            assert_eq!(actual, path, "{text}");
        }
    }
}
