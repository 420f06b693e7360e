//! The property `asset`: which version of glTF a file is written for.

use super::json::{Json, Parsed, quote};

/// Refuses documents of another major version.
pub(super) fn check(root: &Json, warnings: &mut Vec<String>) -> Parsed<()> {
    root.object()?;
    let asset = root.need_object("asset")?;
    let version = match version(&asset, "version")? {
        Some(version) => version,
        None => return Err(asset.missing("version")),
    };
    if version.0 != 2 {
        return Err(asset.fault_at(
            "version",
            format!("glTF version {}.{}; only version 2 is read", version.0, version.1),
        ));
    }
    if let Some(least) = self::version(&asset, "minVersion")?
        && least > version
    {
        let what =
            format!("{}.{} exceeds the version {}.{}", least.0, least.1, version.0, version.1);
        return Err(asset.fault_at("minVersion", what));
    }
    if version.1 > 0 {
        warnings.push(format!(
            "the file is written for glTF {}.{}; what is newer than 2.0 is not read",
            version.0, version.1
        ));
    }
    Ok(())
}

/// Major and minor number.
fn version(asset: &Json, key: &str) -> Parsed<Option<(u64, u64)>> {
    let Some(text) = asset.string(key)? else { return Ok(None) };
    let number = |digits: &str| {
        let plain = !digits.is_empty() && digits.bytes().all(|c| c.is_ascii_digit());
        if plain { digits.parse::<u64>().ok() } else { None }
    };
    match text.split_once('.').and_then(|(major, minor)| Some((number(major)?, number(minor)?))) {
        Some(version) => Ok(Some(version)),
        None => Err(asset.fault_at(key, format!("{} is no version of the form 2.0", quote(text)))),
    }
}
