//! The node graph: transforms, and what stands where.

use super::SceneChoice;
use super::budget::Budget;
use super::document::Document;
use super::fault::{Fault, Parsed, quote};
use super::mesh::{Mesh, Primitive};
use super::value::{float, index, numbers};
use super::warnings::Warnings;
use crate::camera::Joint;
use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::json::scene as json;
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, HashSet};

/// EXT_mesh_gpu_instancing: accessors of the instances' transforms.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Instancing {
    pub translation: Option<usize>,
    pub rotation: Option<usize>,
    pub scale: Option<usize>,
}

/// A node of the document.
#[derive(Debug, Default)]
pub(super) struct Node {
    /// Node to world.
    pub to_world: DAffine3,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub camera: Option<usize>,
    pub light: Option<usize>,
    /// Morph target weights in place of the mesh's.
    pub weights: Option<Box<[f32]>>,
    pub instancing: Option<Box<Instancing>>,
    children: Box<[usize]>,
    parent: Option<usize>,
}

/// All nodes with their world transforms.
pub(super) struct Graph {
    /// By their index; without those that hold nothing and have no parent.
    pub nodes: BTreeMap<usize, Node>,
}

/// The JSON path of a node.
pub(super) fn path(node: usize) -> String {
    format!("/nodes/{node}")
}

impl Graph {
    /// Reads the nodes and checks that they form trees.
    pub fn parse(
        document: &Document, budget: &mut Budget, warnings: &mut Warnings,
    ) -> Parsed<Self> {
        let all = document.json["nodes"].as_array().map_or(&[][..], Vec::as_slice);
        let mut nodes = BTreeMap::new();
        for (i, json) in all.iter().enumerate() {
            if json.as_object().is_some_and(|map| !map.is_empty()) {
                budget.spend(1, 2 * size_of::<Node>() as u64, "/nodes")?;
                nodes.insert(i, node(json, i)?);
            }
        }
        for parent in nodes.keys().copied().collect::<Vec<_>>() {
            for (k, child) in nodes[&parent].children.clone().into_iter().enumerate() {
                let node = nodes.entry(child).or_default();
                if let Some(other) = node.parent {
                    let what = format!(
                        "/nodes/{child} is already a child of /nodes/{other}: nodes must form trees"
                    );
                    return Err(Fault::new(format!("/nodes/{parent}/children/{k}"), what));
                }
                node.parent = Some(parent);
            }
        }
        // Every node has at most one parent now, so whatever no root leads to is on or under a
        // cycle.
        let mut this = Self { nodes };
        let order = this.reachable(&this.roots());
        if order.len() < this.nodes.len() {
            let reached: HashSet<usize> = order.into_iter().collect();
            let lost = this.nodes.keys().find(|i| !reached.contains(i)).copied();
            return Err(Fault::new(
                path(lost.unwrap_or(0)),
                "it is its own ancestor, or a descendant of such a node: nodes must form trees",
            ));
        }
        for i in order {
            let parent = this.nodes[&i].parent;
            let parent = parent.map_or(DAffine3::IDENTITY, |parent| this.to_world(parent));
            let to_world = parent * local_transform(&all[i], &path(i), warnings)?;
            let (matrix, translation) =
                (to_world.matrix3.as_mat3(), to_world.translation.as_vec3());
            if !matrix.is_finite() || !translation.is_finite() {
                return Err(Fault::new(path(i), "its transform leaves the range of numbers"));
            }
            this.nodes.entry(i).or_default().to_world = to_world;
        }
        Ok(this)
    }

    /// Checks that nodes fit the meshes that they show.
    pub fn check_meshes(&self, meshes: &[Mesh], warnings: &mut Warnings) -> Parsed<()> {
        for (i, node) in &self.nodes {
            let Some(mesh) = node.mesh.map(|mesh| &meshes[mesh]) else { continue };
            if node.weights.as_ref().is_some_and(|weights| weights.len() != mesh.targets) {
                let what = "must have one weight for each morph target of the mesh";
                return Err(Fault::new(format!("{}/weights", path(*i)), what));
            }
            let joints = |p: &Primitive| !p.recipe.joints.is_empty();
            if node.skin.is_some() && !mesh.primitives.iter().any(joints) {
                warnings.mend(&path(*i), "its mesh has no joints, so its skin does nothing")?;
            }
        }
        Ok(())
    }

    /// Node to world.
    pub fn to_world(&self, node: usize) -> DAffine3 {
        self.nodes.get(&node).map_or(DAffine3::IDENTITY, |node| node.to_world)
    }

    /// The parent of a node.
    pub fn parent(&self, node: usize) -> Option<usize> {
        self.nodes.get(&node)?.parent
    }

    /// The node and those above it, root first; the budget pays for a [`Joint`] for each.
    pub fn line(&self, node: usize, budget: &mut Budget) -> Parsed<Vec<usize>> {
        let above = || std::iter::successors(Some(node), |&i| self.parent(i));
        budget.spend(above().count() as u64, size_of::<Joint>() as u64, &path(node))?;
        let mut line: Vec<usize> = above().collect();
        line.reverse();
        Ok(line)
    }

    /// Every node that holds something and has no parent.
    pub fn roots(&self) -> Vec<usize> {
        self.nodes.iter().filter(|(_, node)| node.parent.is_none()).map(|(i, _)| *i).collect()
    }

    /// The nodes of the trees under `roots`, parents before children, in the order of the
    /// document's lists; without those that hold nothing.
    pub fn reachable(&self, roots: &[usize]) -> Vec<usize> {
        let mut stack: Vec<usize> = roots.iter().rev().copied().collect();
        let mut order = Vec::new();
        while let Some(i) = stack.pop() {
            let Some(node) = self.nodes.get(&i) else { continue };
            order.push(i);
            stack.extend(node.children.iter().rev());
        }
        order
    }
}

fn node(json: &Value, i: usize) -> Parsed<Node> {
    let extensions = &json["extensions"];
    let instancing = extensions.get("EXT_mesh_gpu_instancing").map(|extension| {
        let accessor = |key: &str| index(&extension["attributes"][key]);
        Box::new(Instancing {
            translation: accessor("TRANSLATION"),
            rotation: accessor("ROTATION"),
            scale: accessor("SCALE"),
        })
    });
    let node = Node {
        to_world: DAffine3::IDENTITY,
        mesh: index(&json["mesh"]),
        skin: index(&json["skin"]),
        camera: index(&json["camera"]),
        light: index(&extensions["KHR_lights_punctual"]["light"]),
        weights: json["weights"].as_array().map(|w| w.iter().map(|w| float(w, 0.0)).collect()),
        instancing,
        children: json["children"].as_array().into_iter().flatten().filter_map(index).collect(),
        parent: None,
    };
    if node.mesh.is_none() && (node.skin.is_some() || node.weights.is_some()) {
        return Err(Fault::new(path(i), "it has a skin or weights, and no mesh"));
    }
    Ok(node)
}

/// The transform of the node `json`, in the double precision that the crate does not keep.
pub(super) fn local_transform(
    json: &Value, path: &str, warnings: &mut Warnings,
) -> Parsed<DAffine3> {
    let (translation, scale) = (numbers::<3>(&json["translation"]), numbers::<3>(&json["scale"]));
    let rotation = numbers::<4>(&json["rotation"]);
    if let Some(matrix) = numbers::<16>(&json["matrix"]) {
        let fault = |what: &str| Err(Fault::new(format!("{path}/matrix"), what));
        if translation.is_some() || rotation.is_some() || scale.is_some() {
            return fault(
                "a node has either a matrix or translation, rotation and scale, not both",
            );
        }
        let matrix = DMat4::from_cols_array(&matrix);
        if (matrix.row(3) - glam::DVec4::W).abs().max_element() > 1e-5 {
            return fault("its last row is not 0 0 0 1");
        }
        let [x, y, z] = [0, 1, 2].map(|k| matrix.col(k).truncate().normalize_or_zero());
        if [x.dot(y), y.dot(z), z.dot(x)].iter().any(|cos| cos.abs() > 5e-3) {
            let what = "it is no product of a translation, a rotation and a scale";
            warnings.allow(&format!("{path}/matrix"), what)?;
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let rotation = match rotation {
        Some(xyzw) => unit_quaternion(xyzw, &format!("{path}/rotation"), warnings)?,
        None => DQuat::IDENTITY,
    };
    let translation = translation.map_or(DVec3::ZERO, DVec3::from_array);
    let scale = scale.map_or(DVec3::ONE, DVec3::from_array);
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation, translation))
}

/// The rotation of a quaternion, which is made unit where it is nearly so.
fn unit_quaternion(xyzw: [f64; 4], path: &str, warnings: &mut Warnings) -> Parsed<DQuat> {
    let quaternion = DQuat::from_array(xyzw);
    let length = quaternion.length();
    if !length.is_finite() || length < 1e-3 {
        return Err(Fault::new(path, "it is no rotation: its length should be 1"));
    }
    if (length - 1.0).abs() > 1e-2 {
        warnings.mend(path, format!("the quaternion's length is {length:.3} and should be 1"))?;
    }
    Ok(quaternion.normalize())
}

/// The nodes that the chosen scene shows.
pub(super) fn scene_roots(
    document: &Document, graph: &Graph, choice: Option<&SceneChoice>, warnings: &mut Warnings,
) -> Parsed<Vec<usize>> {
    let scenes = &document.root().scenes;
    let mut scene_of = HashMap::new();
    for (number, scene) in scenes.iter().enumerate() {
        for (k, node) in scene.nodes.iter().enumerate() {
            let (i, at) = (node.value(), format!("/scenes/{number}/nodes/{k}"));
            if graph.parent(i).is_some() {
                let what = format!(
                    "/nodes/{i} is the child of another node, so it cannot stand in a scene by itself"
                );
                return Err(Fault::new(at, what));
            }
            if scene_of.insert(i, number) == Some(number) {
                return Err(Fault::new(at, format!("/nodes/{i} is listed twice")));
            }
        }
    }
    let named = |scene: &'_ json::Scene| scene.name.clone().filter(|name| !name.is_empty());
    let chosen = match choice {
        None => {
            document.root().scene.map(|scene| scene.value()).or((!scenes.is_empty()).then_some(0))
        }
        Some(SceneChoice::Index(i)) if *i < scenes.len() => Some(*i),
        Some(SceneChoice::Index(i)) => {
            let what = format!("there is no scene {i}: the file has {}", scenes.len());
            return Err(Fault::new("/scenes", what));
        }
        Some(SceneChoice::Name(name)) => {
            let found = scenes.iter().position(|scene| named(scene).as_ref() == Some(name));
            let names = || scenes.iter().filter_map(named).map(|name| quote(&name));
            Some(found.ok_or_else(|| {
                let names = names().collect::<Vec<_>>().join(", ");
                Fault::new("/scenes", format!("no scene is called {name:?}; there are: {names}"))
            })?)
        }
    };
    match chosen {
        Some(i) => Ok(scenes[i].nodes.iter().map(|node| node.value()).collect()),
        None => {
            if !graph.nodes.is_empty() {
                warnings.push("the file has no scene; all its nodes are shown");
            }
            Ok(graph.roots())
        }
    }
}
