//! Environment maps and skies.

use super::LightUnits;
use crate::error::{Error, Result, one_line};
use crate::imagefile::hdr;
use crate::light::{EnvironmentMap, PunctualLight, Sky};
use crate::math::Affine3A;
use std::path::Path;

/// Reads the equirectangular map at `path` (Radiance .hdr or OpenEXR), turned by `rotate_degrees`
/// about the vertical axis, its radiance multiplied by `scale`.
///
/// Without rotation the middle column of the map is seen along +X and +Z lies to the right of it,
/// as [`EnvironmentMap`] says, and as Blender and three.js show it. A positive rotation turns the
/// surroundings counter-clockwise as seen from above (+Y); what was seen along +X is then
/// seen towards -Z.
///
/// `memory_limit`: bytes that reading may take; `None` is 1 GiB and 64 for each byte of the file.
/// The returned lines tell the user what was mended.
///
/// # Errors
/// [`Error::InvalidArgument`] for a rotation or a scale that is no finite number or a scale below
/// 0; [`Error::Io`], [`Error::Image`] and [`Error::Unsupported`] naming the file.
pub fn environment(
    path: &Path, rotate_degrees: f32, scale: f32, memory_limit: Option<u64>,
) -> Result<(EnvironmentMap, Vec<String>)> {
    check(rotate_degrees, scale)?;
    let metadata = std::fs::metadata(path).map_err(Error::io(path))?;
    if !metadata.is_file() {
        return Err(Error::image(path, "it is not a regular file"));
    }
    let (picture, replaced) = hdr::read_environment(path, memory_limit)?;
    let warnings = (replaced > 0).then(|| {
        let what = "pixels were no finite numbers and have the mean of those beside them";
        one_line(&format!("{}: {replaced} {what}", path.display()))
    });
    let map = EnvironmentMap {
        width: picture.width,
        height: picture.height,
        pixels: picture.colors("").map_err(|what| Error::image(path, what))?,
        scale,
        from_world: Affine3A::from_rotation_y(-rotate_degrees.to_radians()),
    };
    Ok((map, warnings.into_iter().collect()))
}

/// The environment and the sun of `sky`, turned by `rotate_degrees` as a map would be, everything
/// multiplied by `scale`.
///
/// # Errors
/// [`Error::InvalidArgument`] for a rotation or a scale that is no finite number or a scale below
/// 0.
pub fn sky(
    sky: &Sky, units: LightUnits, rotate_degrees: f32, scale: f32,
) -> Result<(EnvironmentMap, Option<PunctualLight>)> {
    check(rotate_degrees, scale)?;
    // Azimuths run clockwise.
    let sky = Sky { azimuth: sky.azimuth - rotate_degrees, ..sky.clone() };
    let efficacy = units.efficacy() / scale;
    Ok((EnvironmentMap { scale, ..sky.environment(units.efficacy()) }, sky.sun(efficacy)))
}

fn check(rotate_degrees: f32, scale: f32) -> Result<()> {
    if !rotate_degrees.is_finite() {
        return Err(Error::InvalidArgument(format!(
            "the rotation of the environment is {rotate_degrees}, which is no finite angle"
        )));
    }
    if !scale.is_finite() || scale < 0.0 {
        return Err(Error::InvalidArgument(format!(
            "the scale of the environment is {scale}, and must be finite and not negative"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn a_positive_rotation_turns_the_surroundings_counter_clockwise() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.hdr");
        // Two pixels side by side, each mantissas and exponent of 1.0 and 0.5.
        std::fs::write(
            &path,
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x80",
        )
        .unwrap();
        let map = environment(&path, 90.0, 2.0, None).unwrap().0;
        assert_eq!((map.width, map.height, map.scale), (2, 1, 2.0));
        assert_eq!(map.pixels, [Vec3::ONE, Vec3::splat(0.5)]);
        let seen = map.from_world.transform_vector3(Vec3::NEG_Z);
        assert!((seen - Vec3::X).length() < 1e-6, "{seen}");
    }

    #[test]
    fn bad_arguments_and_files_are_errors() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.hdr");
        std::fs::write(&path, b"no picture").unwrap();
        assert!(matches!(environment(&path, f32::NAN, 1.0, None), Err(Error::InvalidArgument(_))));
        assert!(matches!(environment(&path, 0.0, -1.0, None), Err(Error::InvalidArgument(_))));
        assert!(environment(&path, 0.0, 1.0, None).unwrap_err().to_string().contains("a.hdr"));
        assert!(matches!(environment(dir.path(), 0.0, 1.0, None), Err(Error::Image { .. })));
        assert!(matches!(
            environment(&dir.path().join("b"), 0.0, 1.0, None),
            Err(Error::Io { .. })
        ));
    }
}
