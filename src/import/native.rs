//! The BRDFs of the caching papers as the `extras` of a glTF material describe them; the format is
//! documented at [`super`].

use super::fault::{Fault, Parsed};
use super::value::float;
use crate::material::{LafortuneLobe, NativeBrdf};
use crate::math::Color;
use serde_json::Value;

/// Reads the object `extras.lumicache` of a material, which stands at `path` and has passed the
/// check.
pub(super) fn brdf(json: &Value, path: &str) -> Parsed<NativeBrdf> {
    let kd = channels(&json["kd"]).unwrap_or(Color::ZERO);
    let ks = channels(&json["ks"]).unwrap_or(Color::ZERO);
    let fault = |key: &str, what: String| Err(Fault::new(format!("{path}/{key}"), what));
    if (kd + ks).max_element() > 1.0 + 1e-5 {
        let what = "kd + ks exceeds 1, so the material would reflect more light than it receives";
        return fault("ks", what.into());
    }
    Ok(match json["brdf"].as_str() {
        Some("phong") => NativeBrdf::Phong { kd, ks, exponent: float(&json["exponent"], 0.0) },
        Some("ward") => {
            let alpha_x = float(&json["alpha_x"], 1.0);
            let alpha_y = float(&json["alpha_y"], alpha_x);
            for (key, alpha) in [("alpha_x", alpha_x), ("alpha_y", alpha_y)] {
                if alpha > 1.0 {
                    return fault(key, format!("{alpha} is not above 0 and at most 1"));
                }
            }
            NativeBrdf::WardDuer { kd, ks, alpha_x, alpha_y }
        }
        _ => {
            let elements = json["lobes"].as_array().map_or(&[][..], Vec::as_slice);
            let mut lobes = [LafortuneLobe::default(); 3];
            if elements.len() > lobes.len() {
                let what = format!("must have 1 to 3 elements, and has {}", elements.len());
                return fault("lobes", what);
            }
            for (lobe, json) in lobes.iter_mut().zip(elements) {
                let of = |key: &str| channels(&json[key]);
                let cx = of("cx").unwrap_or_default();
                *lobe = LafortuneLobe {
                    cx,
                    cy: of("cy").unwrap_or(cx),
                    cz: of("cz").unwrap_or_default(),
                    exponent: of("exponent").unwrap_or_default(),
                };
            }
            NativeBrdf::Lafortune { kd, lobes, count: elements.len() as u8 }
        }
    })
}

/// A number for all channels, or three.
fn channels(json: &Value) -> Option<Color> {
    match super::value::numbers::<3>(json) {
        Some(rgb) => Some(Color::from_array(rgb.map(|x| x as f32))),
        None => json.as_f64().map(|x| Color::splat(x as f32)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{check, parse::parse, schema::Kind};
    use super::*;

    fn read(text: &str) -> Parsed<NativeBrdf> {
        let mut json = parse(text.as_bytes(), &mut super::super::budget::Budget::new(None))?;
        check::alone(&Kind::Brdf, &mut json)?;
        brdf(&json, "")
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
