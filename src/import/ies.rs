//! Measured luminaires: IES files, EXT_lights_ies, and the same as `extras`; the format of the
//! latter is documented at [`super`].

use super::budget::Budget;
use super::buffers::Buffers;
use super::document::Document;
use super::fault::{Fault, Parsed, quote};
use super::uri::{self, Folder, OUTSIDE, Target};
use super::value::{float, floats, index};
use super::{ImportOptions, LightUnits};
use crate::error::{Error, Result};
use crate::light::{IesProfile, PunctualLight};
use crate::math::{Color, Mat3};
use glam::{DAffine3, DVec3};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap};
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
    read(path, &Folder::of(path, false), &mut Budget::new(None))
}

/// As [`ies`], for a file that belongs to a scene in `folder`.
fn read(path: &Path, folder: &Folder, budget: &mut Budget) -> Result<IesProfile> {
    let bytes = uri::read(path, "", LONGEST_FILE, budget);
    let bytes = bytes.map_err(|fault| Error::InvalidArgument(fault.what))?;
    let beside = |name: &str| tilt_file(name, path, folder);
    IesProfile::parse(&bytes, &beside)
        .map_err(|fault| Error::scene(path, format!("line {}", fault.line), fault.what))
}

/// The file that a line TILT=NAME of the IES file at `path` names: one beside it.
fn tilt_file(name: &str, path: &Path, folder: &Folder) -> std::result::Result<Vec<u8>, String> {
    if !Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir))
    {
        return Err("only a file beside the IES file is read".to_owned());
    }
    let beside = path.with_file_name(name);
    let file = folder.file_at(&beside).ok_or_else(|| format!("it {OUTSIDE}"))?;
    let mut budget = Budget::new(Some(LONGEST_FILE));
    uri::read(&file, "", LONGEST_FILE, &mut budget).map_err(|fault| fault.what)
}

/// A profile as a node or a light of the document uses it.
#[derive(Clone)]
pub(super) struct Luminaire {
    profile: Arc<IesProfile>,
    /// Factor on the candela.
    scale: Color,
}

impl Luminaire {
    /// A luminaire of the punctual light at `path`: its `extras` decide between the candela of the
    /// file and its own intensity at the peak.
    pub fn of_light(
        document: &Document, path: &str, color: Color, intensity: f32, files: &mut Profiles,
        units: LightUnits,
    ) -> Parsed<Option<Self>> {
        let path = format!("{path}/extras/lumicache");
        let Some(extras) = document.json.pointer(&path) else { return Ok(None) };
        let Some(uri) = extras["ies"].as_str() else { return Ok(None) };
        let profile = files.load(uri, &format!("{path}/ies"))?;
        let mut factor = float(&extras["multiplier"], 1.0);
        if extras["relative"] == true {
            factor *= if profile.peak() > 0.0 { intensity / profile.peak() } else { 0.0 };
        }
        Ok(Some(Self { profile, scale: color * factor / units.efficacy() }))
    }

    fn of_node(json: &Value, profile: Arc<IesProfile>, units: LightUnits) -> Self {
        let color = Color::from_array(floats(&json["color"], 1.0));
        let scale = color * float(&json["multiplier"], 1.0) / units.efficacy();
        Self { profile, scale }
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

/// The IES files of a document, each read once.
pub(super) struct Profiles<'a> {
    folder: &'a Folder,
    budget: &'a mut Budget,
    files: HashMap<PathBuf, Arc<IesProfile>>,
    /// Those inside the document, by their contents.
    embedded: HashMap<blake3::Hash, Arc<IesProfile>>,
    listed: Vec<Arc<IesProfile>>,
}

impl<'a> Profiles<'a> {
    /// Reads the profiles that EXT_lights_ies lists.
    pub fn parse(
        document: &'a Document, buffers: &Buffers, budget: &'a mut Budget,
    ) -> Parsed<Self> {
        let (files, embedded) = (HashMap::new(), HashMap::new());
        let mut profiles =
            Self { folder: &document.folder, budget, files, embedded, listed: Vec::new() };
        let lights = document.json["extensions"]["EXT_lights_ies"]["lights"].as_array();
        for (i, json) in lights.into_iter().flatten().enumerate() {
            let path = format!("/extensions/EXT_lights_ies/lights/{i}");
            let profile = profiles.listed(json, &path, buffers)?;
            profiles.listed.push(profile);
        }
        Ok(profiles)
    }

    fn listed(&mut self, json: &Value, path: &str, buffers: &Buffers) -> Parsed<Arc<IesProfile>> {
        match (json["uri"].as_str(), index(&json["bufferView"])) {
            (Some(uri), None) => self.load(uri, &format!("{path}/uri")),
            (None, Some(view)) => {
                if json.get("mimeType").is_none() {
                    return Err(Fault::new(path, "the property \"mimeType\" is missing"));
                }
                let at = format!("{path}/bufferView");
                let bytes = buffers.bytes(view).map_err(|why| Fault::new(at.as_str(), why))?;
                self.embedded(bytes, &at)
            }
            _ => Err(Fault::new(path, "must have either a uri or a bufferView, and not both")),
        }
    }

    /// The profile that `uri`, which stands at the JSON path `at`, refers to.
    fn load(&mut self, uri: &str, at: &str) -> Parsed<Arc<IesProfile>> {
        match uri::resolve(uri, at, self.folder)? {
            Target::Data { bytes, .. } => self.embedded(&bytes, at),
            Target::File(file) => {
                if let Some(profile) = self.files.get(&file) {
                    return Ok(Arc::clone(profile));
                }
                let profile = read(&file, self.folder, self.budget);
                let profile = Arc::new(profile.map_err(|error| Fault::new(at, error.to_string()))?);
                self.files.insert(file, Arc::clone(&profile));
                Ok(profile)
            }
            Target::Absolute => {
                Err(Fault::new(at, format!("the uri {} names no file", quote(uri))))
            }
        }
    }

    /// The luminaire of each node, by EXT_lights_ies or by its `extras`.
    pub fn nodes(
        &mut self, document: &Document, options: &ImportOptions,
    ) -> Parsed<BTreeMap<usize, Luminaire>> {
        let units = options.light_units;
        let nodes = document.json["nodes"].as_array();
        let mut luminaires = BTreeMap::new();
        for (i, node) in nodes.into_iter().flatten().enumerate() {
            let (reference, extras) =
                (&node["extensions"]["EXT_lights_ies"], &node["extras"]["lumicache"]);
            let luminaire = match (index(&reference["light"]), extras["ies"].as_str()) {
                (None, None) => continue,
                (Some(_), Some(_)) => {
                    let what = "it has a luminaire by EXT_lights_ies and another in its extras";
                    return Err(Fault::new(format!("/nodes/{i}"), what));
                }
                (Some(light), None) => {
                    Luminaire::of_node(reference, Arc::clone(&self.listed[light]), units)
                }
                (None, Some(uri)) => {
                    let profile = self.load(uri, &format!("/nodes/{i}/extras/lumicache/ies"))?;
                    Luminaire::of_node(extras, profile, units)
                }
            };
            luminaires.insert(i, luminaire);
        }
        Ok(luminaires)
    }

    fn embedded(&mut self, bytes: &[u8], at: &str) -> Parsed<Arc<IesProfile>> {
        let contents = blake3::hash(bytes);
        if let Some(profile) = self.embedded.get(&contents) {
            return Ok(Arc::clone(profile));
        }
        let no_folder =
            |_: &str| Err("an IES file inside another file has no folder to look in".to_owned());
        let profile = IesProfile::parse(bytes, &no_folder)
            .map(Arc::new)
            .map_err(|fault| Fault::new(at, format!("the IES file is broken: {fault}")))?;
        self.embedded.insert(contents, Arc::clone(&profile));
        Ok(profile)
    }
}
