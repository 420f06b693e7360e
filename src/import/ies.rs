//! Measured luminaires: IES files, EXT_lights_ies, and the same as `extras`; the format of the
//! latter is documented at [`super`].

use super::accessors::Accessors;
use super::json::{Fault, Json, Parsed, quote};
use super::uri::{self, Target};
use super::{ImportOptions, LightUnits};
use crate::error::{Error, Result};
use crate::light::{IesProfile, PunctualLight};
use crate::math::{Color, Mat3};
use glam::{DAffine3, DVec3};
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Longest file that is read, in bytes: ten times what a degree of resolution each way takes.
const LONGEST_FILE: u64 = 1 << 23;

/// Reads the IES file at `path` (ANSI/IES LM-63 of 1986 to 2019, type A, B or C).
///
/// # Errors
/// [`Error::Scene`] that names the file and the line, [`Error::InvalidArgument`] if the file cannot
/// be read.
pub fn ies(path: &Path) -> Result<IesProfile> {
    let bytes =
        uri::read(path, "", LONGEST_FILE).map_err(|fault| Error::InvalidArgument(fault.what))?;
    IesProfile::parse(&bytes, &|name| tilt_file(name, path.parent().unwrap_or(Path::new(""))))
        .map_err(|fault| Error::scene(path, format!("line {}", fault.line), fault.what))
}

/// The file that a line TILT=NAME names: one beside the IES file.
fn tilt_file(name: &str, folder: &Path) -> std::result::Result<Vec<u8>, String> {
    let name = Path::new(name);
    if !name.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
        return Err("only a file beside the IES file is read".to_owned());
    }
    uri::read(&folder.join(name), "", LONGEST_FILE).map_err(|fault| fault.what)
}

/// A profile as a node or a light of the document uses it.
#[derive(Clone)]
pub(super) struct Luminaire {
    profile: Arc<IesProfile>,
    /// Factor on the candela.
    scale: Color,
}

impl Luminaire {
    /// A luminaire of a punctual light: its `extras` decide between the candela of the file and its
    /// own intensity at the peak.
    pub fn of_light(
        json: &Json,
        color: Color,
        intensity: f32,
        files: &mut Profiles,
        units: LightUnits,
    ) -> Parsed<Option<Self>> {
        let Some(extras) = extras(json)? else { return Ok(None) };
        reject_unknown(&extras, &["ies", "multiplier", "relative"])?;
        let profile = files.load(extras.need_string("ies")?, &extras.path_of("ies"))?;
        let mut factor = extras.number_in("multiplier", 1.0, 0.0, f64::INFINITY)?;
        if extras.boolean("relative", false)? {
            factor *= if profile.peak() > 0.0 { intensity / profile.peak() } else { 0.0 };
        }
        Ok(Some(Self { profile, scale: color * factor / units.efficacy() }))
    }

    fn of_node(json: &Json, profile: Arc<IesProfile>, units: LightUnits) -> Parsed<Self> {
        let color = Color::from_array(json.numbers_in::<3>("color", 1.0, 0.0, 1.0)?);
        let multiplier = json.number_in("multiplier", 1.0, 0.0, f64::INFINITY)?;
        Ok(Self { profile, scale: color * multiplier / units.efficacy() })
    }

    /// The luminaire on a node: it shines along the node's -Z and the node's scale does not touch
    /// it, but a mirroring one mirrors it. `None` where the transform leaves it no direction.
    pub fn placed(&self, to_world: &DAffine3, range: f32) -> Option<PunctualLight> {
        let z = to_world.transform_vector3(DVec3::Z).try_normalize()?;
        let y = to_world.transform_vector3(DVec3::Y);
        let y = (y - z * y.dot(z)).try_normalize()?;
        let x = if to_world.matrix3.determinant() < 0.0 { -y.cross(z) } else { y.cross(z) };
        let to_world_axes = Mat3::from_cols(x.as_vec3(), y.as_vec3(), z.as_vec3());
        // Straight down is -Y, and the luminaire looks along -z.
        let tilt = z.dot(DVec3::Y).clamp(-1.0, 1.0).acos();
        Some(PunctualLight::Ies {
            position: to_world.translation.as_vec3(),
            from_world: to_world_axes.transpose(),
            scale: self.scale * self.profile.tilt_factor(tilt as f32),
            range,
            profile: Arc::clone(&self.profile),
        })
    }
}

/// The object `extras.lumicache` of a node or a light, if it names a profile.
fn extras<'a>(json: &Json<'a>) -> Parsed<Option<Json<'a>>> {
    let Some(extras) = json.get("extras")?.filter(Json::is_object) else { return Ok(None) };
    Ok(extras.object_at("lumicache")?.filter(|own| own.has("ies")))
}

/// A misspelt property would silently give another light.
fn reject_unknown(json: &Json, known: &[&str]) -> Parsed<()> {
    match json.object()?.keys().find(|key| !known.contains(&key.as_str())) {
        Some(key) => Err(json.fault(format!(
            "the property {} is unknown here; known are {}",
            quote(key),
            known.join(", ")
        ))),
        None => Ok(()),
    }
}

/// The IES files of a document, each read once.
pub(super) struct Profiles<'a> {
    folder: &'a Path,
    files: HashMap<PathBuf, Arc<IesProfile>>,
    listed: Vec<Arc<IesProfile>>,
}

impl<'a> Profiles<'a> {
    /// Reads the profiles that EXT_lights_ies lists.
    pub fn parse(root: &Json, accessors: &Accessors, folder: &'a Path) -> Parsed<Self> {
        let mut profiles = Self { folder, files: HashMap::new(), listed: Vec::new() };
        let Some(extension) = root.extension("EXT_lights_ies")? else { return Ok(profiles) };
        for json in extension.array("lights")? {
            let profile = profiles.listed(&json, accessors)?;
            profiles.listed.push(profile);
        }
        Ok(profiles)
    }

    fn listed(&mut self, json: &Json, accessors: &Accessors) -> Parsed<Arc<IesProfile>> {
        json.object()?;
        json.string("name")?;
        let buffers = accessors.buffers();
        match (json.string("uri")?, json.index("bufferView", "bufferViews", buffers.views.len())?) {
            (Some(uri), None) => self.load(uri, &json.path_of("uri")),
            (None, Some(view)) => {
                if json.string("mimeType")?.is_none() {
                    return Err(json.missing("mimeType"));
                }
                let at = json.path_of("bufferView");
                let bytes = buffers.bytes(view).map_err(|why| Fault::new(at.as_str(), why))?;
                embedded(bytes, &at)
            }
            _ => Err(json.fault("must have either a uri or a bufferView, and not both")),
        }
    }

    /// The profile that `uri`, which stands at the JSON path `at`, refers to.
    fn load(&mut self, uri: &str, at: &str) -> Parsed<Arc<IesProfile>> {
        match uri::resolve(uri, at, self.folder)? {
            Target::Data { bytes, .. } => embedded(&bytes, at),
            Target::File(file) => {
                if let Some(profile) = self.files.get(&file) {
                    return Ok(Arc::clone(profile));
                }
                let profile =
                    Arc::new(ies(&file).map_err(|error| Fault::new(at, error.to_string()))?);
                self.files.insert(file, Arc::clone(&profile));
                Ok(profile)
            }
            Target::Absolute => Err(Fault::new(
                at,
                format!(
                    "the uri {} is not relative to the scene file, and only such files are read",
                    quote(uri)
                ),
            )),
        }
    }

    /// The luminaire of each node, by EXT_lights_ies or by its `extras`.
    pub fn nodes(
        &mut self,
        root: &Json,
        options: &ImportOptions,
    ) -> Parsed<Vec<Option<Luminaire>>> {
        let mut luminaires = Vec::new();
        for node in root.entities("nodes")? {
            let (extension, extras) = (node.extension("EXT_lights_ies")?, extras(&node)?);
            luminaires.push(match (extension, extras) {
                (None, None) => None,
                (Some(_), Some(_)) => {
                    return Err(node
                        .fault("it has a luminaire by EXT_lights_ies and another in its extras"));
                }
                (Some(reference), None) => {
                    let index = reference.need_index(
                        "light",
                        "extensions/EXT_lights_ies/lights",
                        self.listed.len(),
                    )?;
                    Some(Luminaire::of_node(
                        &reference,
                        Arc::clone(&self.listed[index]),
                        options.light_units,
                    )?)
                }
                (None, Some(extras)) => {
                    reject_unknown(&extras, &["ies", "multiplier", "color"])?;
                    let profile = self.load(extras.need_string("ies")?, &extras.path_of("ies"))?;
                    Some(Luminaire::of_node(&extras, profile, options.light_units)?)
                }
            });
        }
        Ok(luminaires)
    }
}

fn embedded(bytes: &[u8], at: &str) -> Parsed<Arc<IesProfile>> {
    let no_folder =
        |_: &str| Err("an IES file inside another file has no folder to look in".to_owned());
    IesProfile::parse(bytes, &no_folder)
        .map(Arc::new)
        .map_err(|fault| Fault::new(at, format!("the IES file is broken: {fault}")))
}
