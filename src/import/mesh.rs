//! Meshes of the document: their primitives become triangle meshes in object space.

use super::accessor::{Accessor, Accessors, Format};
use super::budget::Budget;
use super::document::Document;
use super::fault::{Fault, Parsed, label, name};
use super::topology::{self, Mode};
use super::value::index;
use super::warnings::Warnings;
use crate::geometry::TriangleMesh;
use crate::math::{Vec2, Vec3, Vec4};
use gltf::json::{mesh as json, validation::Checked};
use serde_json::Value;
use std::ops::{AddAssign, Mul};

/// Indices of accessors with vertex attributes, or with what a morph target adds to them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Attributes {
    position: Option<usize>,
    normal: Option<usize>,
    tangent: Option<usize>,
    uv: [Option<usize>; 2],
    color: Option<usize>,
}

/// Everything that decides the shape of a primitive; two primitives with the same recipe are one
/// mesh.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Recipe {
    mode: Mode,
    attributes: Attributes,
    /// Accessors of joint numbers and weights, four joints to a set.
    pub joints: Vec<(usize, usize)>,
    indices: Option<usize>,
    /// Index of the material.
    pub material: Option<usize>,
    targets: Vec<Attributes>,
}

impl Recipe {
    /// What the specification demands and nothing here needs, of the primitive at `path`.
    fn check(&self, path: &str, accessors: &Accessors, warnings: &mut Warnings) -> Parsed<()> {
        let at = format!("{path}/attributes/POSITION");
        let bounds = |i: usize| accessors.list[i].bounds.iter().all(Option::is_some);
        if !self.attributes.position.is_some_and(bounds) {
            warnings.allow(&at, "its accessor has no min and max")?;
        }
        let base = self.attributes.all();
        for (k, target) in self.targets.iter().enumerate() {
            if target
                .all()
                .iter()
                .zip(base)
                .any(|(target, base)| target.is_some() && base.is_none())
            {
                let what = "it changes an attribute that the primitive does not have";
                warnings.mend(&format!("{path}/targets/{k}"), what)?;
            }
        }
        Ok(())
    }
}

/// A primitive that makes triangles.
#[derive(Clone, Debug)]
pub(super) struct Primitive {
    /// JSON path.
    pub path: String,
    /// Its contents.
    pub recipe: Recipe,
}

/// A mesh of the document.
#[derive(Clone, Debug)]
pub(super) struct Mesh {
    /// Name for messages.
    pub name: String,
    /// The primitives that make triangles.
    pub primitives: Vec<Primitive>,
    /// Default weights of the morph targets.
    pub weights: Vec<f32>,
    /// Number of morph targets.
    pub targets: usize,
}

/// Reads and checks all meshes of the document; `highest` is the highest value of each accessor's
/// first component.
pub(super) fn meshes(
    document: &Document, accessors: &Accessors, highest: &[f64], warnings: &mut Warnings,
) -> Parsed<Vec<Mesh>> {
    let mut meshes = Vec::new();
    for (i, mesh) in document.root().meshes.iter().enumerate() {
        let (path, json) = (format!("/meshes/{i}"), &document.json["meshes"][i]);
        let weights = mesh.weights.clone().unwrap_or_default();
        let targets = |k: usize| json["primitives"][k]["targets"].as_array().map_or(0, Vec::len);
        if !weights.is_empty() && weights.len() != targets(0) {
            let what = "must have one weight for each morph target";
            return Err(Fault::new(format!("{path}/weights"), what));
        }
        let mut primitives = Vec::new();
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let at = format!("{path}/primitives/{k}");
            if targets(k) != targets(0) {
                let what = "the primitives of a mesh must have equally many morph targets";
                return Err(Fault::new(at, what));
            }
            let recipe = self::primitive(primitive, &json["primitives"][k], &at, accessors)?;
            if let Some(Recipe { indices: Some(indices), attributes, .. }) = &recipe {
                let position = attributes.position.map(|i| &accessors.list[i]);
                check_indices(*indices, position, highest, accessors)?;
            }
            if let Some(recipe) = &recipe {
                recipe.check(&at, accessors, warnings)?;
            }
            primitives.extend(recipe.map(|recipe| Primitive { path: at, recipe }));
        }
        let skipped = mesh.primitives.len() - primitives.len();
        if skipped > 0 {
            warnings.push(format!(
                "{}: {skipped} primitives without triangles (points, lines) are left out",
                label(&path, json)
            ));
        }
        let name = name(json).map_or(path, str::to_owned);
        meshes.push(Mesh { name, primitives, weights, targets: targets(0) });
    }
    Ok(meshes)
}

/// Checks that no index is beyond the vertices.
fn check_indices(
    indices: usize, position: Option<&Accessor>, highest: &[f64], accessors: &Accessors,
) -> Parsed<()> {
    let Some(position) = position.filter(|p| highest[indices] >= p.count as f64) else {
        return Ok(());
    };
    let indices = &accessors.list[indices];
    let values = accessors.read_indices(indices, &mut Budget::new(None))?;
    let beyond = values.iter().position(|v| u64::from(*v) >= position.count).unwrap_or(0);
    let what = format!(
        "element {beyond} is the vertex {}, and {} has {}",
        values[beyond], position.path, position.count
    );
    Err(Fault::new(indices.path.as_str(), what))
}

/// Reads a primitive; `None` for one that makes no triangles.
fn primitive(
    primitive: &json::Primitive, value: &Value, path: &str, accessors: &Accessors,
) -> Parsed<Option<Recipe>> {
    let at = format!("{path}/attributes");
    let attributes = self::attributes(&value["attributes"], &at, accessors, true)?;
    let indices = primitive.indices.map(|indices| indices.value());
    if let Some(indices) = indices {
        let at = format!("{path}/indices");
        let view = accessors.expect(indices, &Format::INDICES, &at)?.view;
        let view = view.map(|view| &accessors.buffers().views[view]);
        if let Some(view) = view.filter(|view| view.stride().is_some()) {
            let what = format!("{} must not have a byteStride for this use", view.path);
            return Err(Fault::new(at, what));
        }
    }
    let mut joints = Vec::new();
    loop {
        let keys = ["JOINTS", "WEIGHTS"].map(|name| format!("{name}_{}", joints.len()));
        let [joint, weight] = keys.each_ref().map(|key| index(&value["attributes"][key.as_str()]));
        match (joint, weight) {
            (Some(joint), Some(weight)) => {
                accessors.expect(joint, &Format::JOINTS, &format!("{at}/{}", keys[0]))?;
                accessors.expect(weight, &Format::WEIGHTS, &format!("{at}/{}", keys[1]))?;
                joints.push((joint, weight));
            }
            (None, None) => break,
            _ => {
                let what = format!("{} and {} must come together", keys[0], keys[1]);
                return Err(Fault::new(at, what));
            }
        }
    }
    let targets = value["targets"].as_array().into_iter().flatten().enumerate();
    let targets = targets
        .map(|(k, t)| self::attributes(t, &format!("{path}/targets/{k}"), accessors, false))
        .collect::<Parsed<Vec<_>>>()?;
    let mode = match primitive.mode {
        Checked::Valid(json::Mode::Triangles) => Mode::Triangles,
        Checked::Valid(json::Mode::TriangleStrip) => Mode::Strip,
        Checked::Valid(json::Mode::TriangleFan) => Mode::Fan,
        _ => return Ok(None),
    };
    let Some(position) = attributes.position else { return Ok(None) };
    let compressed = value["extensions"].get("KHR_draco_mesh_compression").is_some();
    if compressed && accessors.list[position].view.is_none() {
        let what = "it is stored with Draco compression alone, which this program does not read: decompress the file first";
        return Err(Fault::unsupported(path, what));
    }
    let material = primitive.material.map(|material| material.value());
    let recipe = Recipe { mode, attributes, joints, indices, material, targets };
    check_counts(&recipe, accessors, &at)?;
    Ok(Some(recipe))
}

fn attributes(json: &Value, at: &str, accessors: &Accessors, base: bool) -> Parsed<Attributes> {
    let find = |key: &str, of_base: &'static Format, of_target: &'static Format| {
        let Some(index) = index(&json[key]) else { return Ok(None) };
        let format = if base { of_base } else { of_target };
        accessors.expect(index, format, &format!("{at}/{key}"))?;
        Ok(Some(index))
    };
    Ok(Attributes {
        position: find("POSITION", &Format::POSITION, &Format::POSITION)?,
        normal: find("NORMAL", &Format::NORMAL, &Format::POSITION)?,
        tangent: find("TANGENT", &Format::TANGENT, &Format::POSITION)?,
        uv: [
            find("TEXCOORD_0", &Format::TEXCOORD, &Format::TEXCOORD)?,
            find("TEXCOORD_1", &Format::TEXCOORD, &Format::TEXCOORD)?,
        ],
        color: find("COLOR_0", &Format::COLOR, &Format::TARGET_COLOR)?,
    })
}

impl Attributes {
    fn all(&self) -> [Option<usize>; 6] {
        [self.position, self.normal, self.tangent, self.uv[0], self.uv[1], self.color]
    }

    fn accessors(&self) -> impl Iterator<Item = usize> {
        self.all().into_iter().flatten()
    }
}

fn check_counts(recipe: &Recipe, accessors: &Accessors, at: &str) -> Parsed<()> {
    let count = |i: usize| accessors.list[i].count;
    let mut all = recipe.attributes.accessors().collect::<Vec<_>>();
    all.extend(recipe.targets.iter().flat_map(Attributes::accessors));
    all.extend(recipe.joints.iter().flat_map(|(j, w)| [*j, *w]));
    let first = count(all[0]);
    match all.iter().find(|i| count(**i) != first) {
        Some(other) => {
            let what = format!(
                "POSITION has {first} elements, and /accessors/{other} has {}",
                count(*other)
            );
            Err(Fault::new(at, what))
        }
        None => Ok(()),
    }
}

/// Joint numbers and weights of each vertex.
pub(super) struct Influences {
    /// As many as there are vertices, times the number of joints per vertex.
    pub joints: Vec<[f32; 4]>,
    /// Beside `joints`.
    pub weights: Vec<[f32; 4]>,
    /// Sets of four joints per vertex; set `s` of vertex `v` is entry `s * vertices + v`.
    pub sets: usize,
}

/// A primitive in object space, with morph targets applied.
pub(super) struct Built {
    /// The mesh, whose material index is the document's or 0.
    pub mesh: TriangleMesh,
    /// What skinning needs.
    pub influences: Influences,
    /// Triangles that were dropped because they have no area.
    pub degenerate: usize,
}

/// Builds the geometry of a primitive under the morph weights `weights`.
pub(super) fn build(
    primitive: &Primitive, weights: &[f32], accessors: &Accessors, budget: &mut Budget,
) -> Parsed<Built> {
    let Recipe { mode, attributes, indices, .. } = &primitive.recipe;
    let position = match attributes.position {
        Some(position) => &accessors.list[position],
        None => return Err(Fault::new(primitive.path.as_str(), "it has no POSITION")),
    };
    let mut triangles = match indices {
        Some(indices) => indexed(*mode, &accessors.list[*indices], accessors, budget)?,
        None => {
            budget.spend(position.count, 12, &position.path)?;
            let count = u32::try_from(position.count)
                .map_err(|_| Fault::new(position.path.as_str(), "it has too many vertices"))?;
            topology::triangulate(*mode, count as usize, |i| i as u32)
        }
    };
    let used =
        topology::used_vertices(&triangles, usize::try_from(position.count).unwrap_or(usize::MAX));
    if let Some(used) = &used {
        topology::renumber(&mut triangles, used);
    }
    let mut reader = Reader { primitive, weights, accessors, pick: used.as_deref(), budget };
    let positions = reader.read::<3, Vec3>(|a| a.position, 0.0)?.unwrap_or_default();
    if let Some(bad) = positions.iter().position(|p| !p.is_finite()) {
        let what = format!("a vertex is at {}, which is no finite place", positions[bad]);
        return Err(Fault::new(position.path.as_str(), what));
    }
    let degenerate = topology::drop_degenerate(&mut triangles, &positions);
    let normals = reader.read::<3, Vec3>(|a| a.normal, 0.0)?;
    let tangents = reader.read::<4, Vec4>(|a| a.tangent, 0.0)?;
    let uv = [reader.read::<2, Vec2>(|a| a.uv[0], 0.0)?, reader.read::<2, Vec2>(|a| a.uv[1], 0.0)?];
    let mut colors = reader.read::<4, Vec4>(|a| a.color, 1.0)?;
    colors.iter_mut().flatten().for_each(|c| *c = c.clamp(Vec4::ZERO, Vec4::ONE));
    let influences = reader.influences()?;
    let mesh = TriangleMesh {
        name: String::new(),
        positions: positions.into(),
        indices: triangles.into(),
        // Without normals the given tangents mean nothing.
        tangents: if normals.is_some() { tangents } else { None },
        normals,
        uv,
        colors,
        material: primitive.recipe.material.unwrap_or(0) as u32,
    };
    Ok(Built { mesh, influences, degenerate })
}

fn indexed(
    mode: Mode, indices: &Accessor, accessors: &Accessors, budget: &mut Budget,
) -> Parsed<Vec<[u32; 3]>> {
    let values = accessors.read_indices(indices, budget)?;
    budget.spend(values.len() as u64, 12, &indices.path)?;
    Ok(topology::triangulate(mode, values.len(), |i| values[i]))
}

/// Reads attributes of the vertices in use, morph targets added.
struct Reader<'r, 'a> {
    primitive: &'r Primitive,
    weights: &'r [f32],
    accessors: &'r Accessors<'a>,
    pick: Option<&'r [u32]>,
    budget: &'r mut Budget,
}

impl Reader<'_, '_> {
    fn accessor<const N: usize, T: From<[f32; N]> + Clone>(
        &mut self, index: usize, fill: f32,
    ) -> Parsed<Vec<T>> {
        self.accessors.read(&self.accessors.list[index], self.pick, fill, self.budget)
    }

    fn read<const N: usize, T>(
        &mut self, which: impl Fn(&Attributes) -> Option<usize>, fill: f32,
    ) -> Parsed<Option<Vec<T>>>
    where
        T: From<[f32; N]> + Copy + AddAssign + Mul<f32, Output = T>,
    {
        let recipe = &self.primitive.recipe;
        let Some(base) = which(&recipe.attributes) else { return Ok(None) };
        let mut values: Vec<T> = self.accessor(base, fill)?;
        for (target, weight) in recipe.targets.iter().zip(self.weights) {
            let Some(target) = which(target).filter(|_| *weight != 0.0) else { continue };
            let deltas: Vec<T> = self.accessor(target, 0.0)?;
            values.iter_mut().zip(deltas).for_each(|(value, delta)| *value += delta * *weight);
        }
        Ok(Some(values))
    }

    fn influences(&mut self) -> Parsed<Influences> {
        let (mut joints, mut weights) = (Vec::new(), Vec::new());
        let sets = &self.primitive.recipe.joints;
        for (joint, weight) in sets {
            joints.extend(self.accessor::<4, [f32; 4]>(*joint, 0.0)?);
            weights.extend(self.accessor::<4, [f32; 4]>(*weight, 0.0)?);
        }
        Ok(Influences { joints, weights, sets: sets.len() })
    }
}
