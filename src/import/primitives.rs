//! Meshes of the document: their primitives become triangle meshes in object space.

use super::accessors::{Accessor, Accessors, Format};
use super::budget::Budget;
use super::json::{Fault, Json, Parsed};
use super::layout::{Component, Shape};
use super::topology::{self, Mode};
use crate::geometry::TriangleMesh;
use crate::math::{Vec2, Vec3, Vec4};

use Component::{F32, I8, I16, U8, U16, U32};

const POSITION: Format = Format {
    shapes: &[Shape::Vec3],
    components: &[(F32, None), (I8, None), (U8, None), (I16, None), (U16, None)],
};
const NORMAL: Format = Format {
    shapes: &[Shape::Vec3],
    components: &[(F32, None), (I8, Some(true)), (I16, Some(true))],
};
const TANGENT: Format = Format { shapes: &[Shape::Vec4], components: NORMAL.components };
const TEXCOORD: Format = Format { shapes: &[Shape::Vec2], components: POSITION.components };
const COLOR: Format = Format {
    shapes: &[Shape::Vec3, Shape::Vec4],
    components: &[(F32, None), (U8, Some(true)), (U16, Some(true))],
};
const TARGET_VECTOR: Format = Format { shapes: &[Shape::Vec3], components: POSITION.components };
const TARGET_TEXCOORD: Format = Format { shapes: &[Shape::Vec2], components: POSITION.components };
const TARGET_COLOR: Format = Format {
    shapes: &[Shape::Vec3, Shape::Vec4],
    components: &[
        (F32, None),
        (I8, Some(true)),
        (U8, Some(true)),
        (I16, Some(true)),
        (U16, Some(true)),
    ],
};
const JOINTS: Format =
    Format { shapes: &[Shape::Vec4], components: &[(U8, Some(false)), (U16, Some(false))] };
const WEIGHTS: Format = Format {
    shapes: &[Shape::Vec4],
    components: &[(F32, None), (U8, Some(true)), (U16, Some(true))],
};
const INDICES: Format = Format {
    shapes: &[Shape::Scalar],
    components: &[(U8, Some(false)), (U16, Some(false)), (U32, Some(false))],
};

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
    joints: Vec<(usize, usize)>,
    indices: Option<usize>,
    /// Index of the material.
    pub material: Option<usize>,
    targets: Vec<Attributes>,
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
}

/// Reads and checks all meshes of the document.
pub(super) fn meshes(
    root: &Json,
    accessors: &Accessors,
    materials: usize,
    warnings: &mut Vec<String>,
) -> Parsed<Vec<Mesh>> {
    let mut meshes = Vec::new();
    for json in root.entities("meshes")? {
        let mut primitives = Vec::new();
        let mut skipped = 0;
        let mut targets = None;
        for primitive in
            json.get("primitives")?.ok_or_else(|| json.missing("primitives"))?.elements()?
        {
            let count = primitive.array("targets")?.len();
            if *targets.get_or_insert(count) != count {
                return Err(primitive
                    .fault("the primitives of a mesh must have equally many morph targets"));
            }
            match self::primitive(&primitive, accessors, materials)? {
                Some(recipe) => {
                    primitives.push(Primitive { path: primitive.path().to_owned(), recipe })
                }
                None => skipped += 1,
            }
        }
        if targets.is_none() {
            return Err(json.fault_at("primitives", "it has no primitives"));
        }
        if skipped > 0 {
            warnings.push(format!(
                "{}: {skipped} primitives without triangles (points, lines) are left out",
                json.label()
            ));
        }
        let weights = json
            .array("weights")?
            .iter()
            .map(|w| Ok(w.as_number()? as f32))
            .collect::<Parsed<Vec<_>>>()?;
        if !weights.is_empty() && Some(weights.len()) != targets {
            return Err(json.fault_at("weights", "must have one weight for each morph target"));
        }
        meshes.push(Mesh {
            name: json.object_name().map_or_else(|| json.path().to_owned(), str::to_owned),
            primitives,
            weights,
        });
    }
    Ok(meshes)
}

/// Reads a primitive; `None` for one that makes no triangles.
fn primitive(json: &Json, accessors: &Accessors, materials: usize) -> Parsed<Option<Recipe>> {
    json.object()?;
    let json_attributes = json.need_object("attributes")?;
    let attributes = self::attributes(&json_attributes, accessors, true)?;
    let material = json.index("material", "materials", materials)?;
    let reference = |object: &Json, key: &str, format: &Format| {
        let Some(index) = object.index(key, "accessors", accessors.list.len())? else {
            return Ok(None);
        };
        accessors.expect(index, format, &object.path_of(key))?;
        Ok(Some(index))
    };
    let indices = reference(json, "indices", &INDICES)?;
    if let Some(view) = indices.and_then(|i| accessors.list[i].view) {
        let view = &accessors.buffers().views[view];
        if view.stride.is_some() {
            return Err(json.fault_at(
                "indices",
                format!("{} must not have a byteStride for this use", view.path),
            ));
        }
    }
    let mut joints = Vec::new();
    loop {
        let (joint_key, weight_key) =
            (format!("JOINTS_{}", joints.len()), format!("WEIGHTS_{}", joints.len()));
        match (
            reference(&json_attributes, &joint_key, &JOINTS)?,
            reference(&json_attributes, &weight_key, &WEIGHTS)?,
        ) {
            (Some(joint), Some(weight)) => joints.push((joint, weight)),
            (None, None) => break,
            _ => {
                return Err(json_attributes
                    .fault(format!("{joint_key} and {weight_key} must come together")));
            }
        }
    }
    let targets = json
        .array("targets")?
        .iter()
        .map(|t| self::attributes(t, accessors, false))
        .collect::<Parsed<Vec<_>>>()?;
    let mode = match json.unsigned("mode")?.unwrap_or(4) {
        0..=3 => return Ok(None),
        4 => Mode::Triangles,
        5 => Mode::Strip,
        6 => Mode::Fan,
        other => return Err(json.fault_at("mode", format!("{other} is no mode of drawing"))),
    };
    let Some(position) = attributes.position else { return Ok(None) };
    let compressed = json.extension("KHR_draco_mesh_compression")?.is_some();
    if compressed && accessors.list[position].view.is_none() {
        let what = "it is stored with Draco compression alone, which this program does not read: decompress the file first";
        return Err(Fault::unsupported(json.path(), what));
    }
    let recipe = Recipe { mode, attributes, joints, indices, material, targets };
    check_counts(&recipe, accessors, &json_attributes)?;
    Ok(Some(recipe))
}

fn attributes(json: &Json, accessors: &Accessors, base: bool) -> Parsed<Attributes> {
    json.object()?;
    let find = |key: &str, format: &Format| {
        let Some(index) = json.index(key, "accessors", accessors.list.len())? else {
            return Ok(None);
        };
        accessors.expect(index, format, &json.path_of(key))?;
        Ok(Some(index))
    };
    let pick = |of_base: &'static Format, of_target: &'static Format| {
        if base { of_base } else { of_target }
    };
    Ok(Attributes {
        position: find("POSITION", &POSITION)?,
        normal: find("NORMAL", pick(&NORMAL, &TARGET_VECTOR))?,
        tangent: find("TANGENT", pick(&TANGENT, &TARGET_VECTOR))?,
        uv: [
            find("TEXCOORD_0", pick(&TEXCOORD, &TARGET_TEXCOORD))?,
            find("TEXCOORD_1", pick(&TEXCOORD, &TARGET_TEXCOORD))?,
        ],
        color: find("COLOR_0", pick(&COLOR, &TARGET_COLOR))?,
    })
}

impl Attributes {
    fn accessors(&self) -> impl Iterator<Item = usize> {
        [self.position, self.normal, self.tangent, self.uv[0], self.uv[1], self.color]
            .into_iter()
            .flatten()
    }
}

fn check_counts(recipe: &Recipe, accessors: &Accessors, json: &Json) -> Parsed<()> {
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
            Err(json.fault(what))
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
    primitive: &Primitive,
    weights: &[f32],
    accessors: &Accessors,
    budget: &mut Budget,
) -> Parsed<Built> {
    let Recipe { mode, attributes, indices, .. } = &primitive.recipe;
    let position = match attributes.position {
        Some(position) => &accessors.list[position],
        None => return Err(Fault::new(primitive.path.as_str(), "it has no POSITION")),
    };
    let mut triangles = match indices {
        Some(indices) => indexed(*mode, &accessors.list[*indices], position, accessors, budget)?,
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
    let positions: Vec<Vec3> = reader
        .read::<3>(|a| a.position, 0.0)?
        .map_or(Vec::new(), |v| v.into_iter().map(Vec3::from_array).collect());
    if let Some(bad) = positions.iter().position(|p| !p.is_finite()) {
        return Err(Fault::new(
            position.path.as_str(),
            format!("a vertex is at {}, which is no finite place", positions[bad]),
        ));
    }
    let degenerate = topology::drop_degenerate(&mut triangles, &positions);
    let normals = reader
        .read::<3>(|a| a.normal, 0.0)?
        .map(|v| v.into_iter().map(Vec3::from_array).collect::<Vec<_>>());
    let tangents = reader
        .read::<4>(|a| a.tangent, 0.0)?
        .map(|v| v.into_iter().map(Vec4::from_array).collect::<Vec<_>>());
    let mut uv = [None, None];
    for (k, uv) in uv.iter_mut().enumerate() {
        *uv = reader
            .read::<2>(|a| a.uv[k], 0.0)?
            .map(|v| v.into_iter().map(Vec2::from_array).collect::<Vec<_>>());
    }
    let colors = reader.read::<4>(|a| a.color, 1.0)?;
    let colors = colors
        .map(|v| v.into_iter().map(|c| Vec4::from_array(c).clamp(Vec4::ZERO, Vec4::ONE)).collect());
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
    mode: Mode,
    indices: &Accessor,
    position: &Accessor,
    accessors: &Accessors,
    budget: &mut Budget,
) -> Parsed<Vec<[u32; 3]>> {
    let values = accessors.read_indices(indices, budget)?;
    if let Some(i) = values.iter().position(|v| u64::from(*v) >= position.count) {
        let what = format!(
            "element {i} is the vertex {}, and {} has {}",
            values[i], position.path, position.count
        );
        return Err(Fault::new(indices.path.as_str(), what));
    }
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
    fn read<const N: usize>(
        &mut self,
        which: impl Fn(&Attributes) -> Option<usize>,
        fill: f32,
    ) -> Parsed<Option<Vec<[f32; N]>>> {
        let recipe = &self.primitive.recipe;
        let Some(base) = which(&recipe.attributes) else { return Ok(None) };
        let mut values =
            self.accessors.read::<N>(&self.accessors.list[base], self.pick, fill, self.budget)?;
        for (target, weight) in recipe.targets.iter().zip(self.weights) {
            let Some(target) = which(target).filter(|_| *weight != 0.0) else { continue };
            let deltas = self.accessors.read::<N>(
                &self.accessors.list[target],
                self.pick,
                0.0,
                self.budget,
            )?;
            for (value, delta) in values.as_flattened_mut().iter_mut().zip(deltas.as_flattened()) {
                *value += weight * delta;
            }
        }
        Ok(Some(values))
    }

    fn influences(&mut self) -> Parsed<Influences> {
        let (mut joints, mut weights) = (Vec::new(), Vec::new());
        let sets = &self.primitive.recipe.joints;
        for (joint, weight) in sets {
            joints.extend(self.accessors.read::<4>(
                &self.accessors.list[*joint],
                self.pick,
                0.0,
                self.budget,
            )?);
            weights.extend(self.accessors.read::<4>(
                &self.accessors.list[*weight],
                self.pick,
                0.0,
                self.budget,
            )?);
        }
        Ok(Influences { joints, weights, sets: sets.len() })
    }
}
