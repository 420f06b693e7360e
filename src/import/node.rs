//! The node graph: transforms, and what stands where.

use super::SceneChoice;
use super::document::Document;
use super::fault::{Fault, Parsed, name, quote};
use super::value::{index, numbers};
use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::json::scene as json;
use serde_json::Value;

/// EXT_mesh_gpu_instancing: accessors of the instances' transforms.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Instancing {
    pub translation: Option<usize>,
    pub rotation: Option<usize>,
    pub scale: Option<usize>,
}

/// A node of the document.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// JSON path.
    pub path: String,
    /// Name, or the empty string.
    pub name: String,
    /// Node to world.
    pub to_world: DAffine3,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub camera: Option<usize>,
    pub light: Option<usize>,
    /// Morph target weights in place of the mesh's.
    pub weights: Option<Vec<f32>>,
    pub instancing: Option<Instancing>,
    children: Vec<usize>,
    parent: Option<usize>,
}

/// All nodes with their world transforms.
pub(super) struct Graph {
    /// The nodes.
    pub nodes: Vec<Node>,
}

impl Graph {
    /// Reads the nodes and checks that they form trees.
    pub fn parse(document: &Document, warnings: &mut Vec<String>) -> Parsed<Self> {
        let (mut locals, mut nodes) = (Vec::new(), Vec::new());
        for (i, node) in document.root().nodes.iter().enumerate() {
            let (path, json) = (format!("/nodes/{i}"), &document.json["nodes"][i]);
            locals.push(local_transform(json, &path, warnings)?);
            nodes.push(self::node(node, json, path)?);
        }
        for i in 0..nodes.len() {
            for (k, child) in nodes[i].children.clone().into_iter().enumerate() {
                if let Some(other) = nodes[child].parent {
                    let what = format!(
                        "/nodes/{child} is already a child of /nodes/{other}: nodes must form trees"
                    );
                    return Err(Fault::new(format!("/nodes/{i}/children/{k}"), what));
                }
                nodes[child].parent = Some(i);
            }
        }
        // Every node has at most one parent now, so whatever no root leads to is on or under a
        // cycle.
        let mut order: Vec<usize> =
            (0..nodes.len()).filter(|i| nodes[*i].parent.is_none()).collect();
        let mut next = 0;
        while next < order.len() {
            let i = order[next];
            next += 1;
            let parent = nodes[i].parent.map_or(DAffine3::IDENTITY, |p| nodes[p].to_world);
            let to_world = parent * locals[i];
            let (matrix, translation) =
                (to_world.matrix3.as_mat3(), to_world.translation.as_vec3());
            if !matrix.is_finite() || !translation.is_finite() {
                return Err(Fault::new(
                    nodes[i].path.as_str(),
                    "its transform leaves the range of numbers",
                ));
            }
            nodes[i].to_world = to_world;
            order.extend(nodes[i].children.iter());
        }
        if order.len() < nodes.len() {
            let mut reached = vec![false; nodes.len()];
            order.iter().for_each(|i| reached[*i] = true);
            let lost = reached.iter().position(|r| !r).unwrap_or(0);
            return Err(Fault::new(
                format!("/nodes/{lost}"),
                "it is its own ancestor, or a descendant of such a node: nodes must form trees",
            ));
        }
        Ok(Self { nodes })
    }

    /// Whether the node has no parent.
    pub fn is_root(&self, node: usize) -> bool {
        self.nodes[node].parent.is_none()
    }

    /// The node and those above it, root first.
    pub fn line(&self, node: usize) -> Vec<usize> {
        let mut line: Vec<usize> =
            std::iter::successors(Some(node), |&i| self.nodes[i].parent).collect();
        line.reverse();
        line
    }

    /// Every node without parent.
    pub fn roots(&self) -> Vec<usize> {
        (0..self.nodes.len()).filter(|i| self.is_root(*i)).collect()
    }

    /// The nodes of the trees under `roots`, parents before children, in the order of the
    /// document's lists.
    pub fn reachable(&self, roots: &[usize]) -> Vec<usize> {
        let mut stack: Vec<usize> = roots.iter().rev().copied().collect();
        let mut order = Vec::new();
        while let Some(i) = stack.pop() {
            order.push(i);
            stack.extend(self.nodes[i].children.iter().rev());
        }
        order
    }
}

fn node(node: &json::Node, json: &Value, path: String) -> Parsed<Node> {
    let extensions = &json["extensions"];
    let instancing = extensions.get("EXT_mesh_gpu_instancing").map(|extension| {
        let accessor = |key: &str| index(&extension["attributes"][key]);
        Instancing {
            translation: accessor("TRANSLATION"),
            rotation: accessor("ROTATION"),
            scale: accessor("SCALE"),
        }
    });
    let mesh = node.mesh.map(|mesh| mesh.value());
    if mesh.is_none() && (node.skin.is_some() || node.weights.is_some()) {
        return Err(Fault::new(path, "it has a skin or weights, and no mesh"));
    }
    Ok(Node {
        path,
        name: name(json).unwrap_or("").to_owned(),
        to_world: DAffine3::IDENTITY,
        mesh,
        skin: node.skin.map(|skin| skin.value()),
        camera: node.camera.map(|camera| camera.value()),
        light: index(&extensions["KHR_lights_punctual"]["light"]),
        weights: node.weights.clone(),
        instancing,
        children: node.children.iter().flatten().map(|child| child.value()).collect(),
        parent: None,
    })
}

/// The transform of the node `json`, in the double precision that the crate does not keep.
pub(super) fn local_transform(
    json: &Value, path: &str, warnings: &mut Vec<String>,
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
fn unit_quaternion(xyzw: [f64; 4], path: &str, warnings: &mut Vec<String>) -> Parsed<DQuat> {
    let quaternion = DQuat::from_array(xyzw);
    let length = quaternion.length();
    if !length.is_finite() || length < 1e-3 {
        return Err(Fault::new(path, "it is no rotation: its length should be 1"));
    }
    if (length - 1.0).abs() > 1e-2 {
        warnings.push(format!("{path}: the quaternion's length is {length:.3} and should be 1"));
    }
    Ok(quaternion.normalize())
}

/// The nodes that the chosen scene shows.
pub(super) fn scene_roots(
    document: &Document, graph: &Graph, choice: Option<&SceneChoice>, warnings: &mut Vec<String>,
) -> Parsed<Vec<usize>> {
    let scenes = &document.root().scenes;
    let mut scene_of = vec![usize::MAX; graph.nodes.len()];
    for (number, scene) in scenes.iter().enumerate() {
        for (k, node) in scene.nodes.iter().enumerate() {
            let (i, at) = (node.value(), format!("/scenes/{number}/nodes/{k}"));
            if !graph.is_root(i) {
                let what = format!(
                    "/nodes/{i} is the child of another node, so it cannot stand in a scene by itself"
                );
                return Err(Fault::new(at, what));
            }
            if std::mem::replace(&mut scene_of[i], number) == number {
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
                warnings.push("the file has no scene; all its nodes are shown".to_owned());
            }
            Ok(graph.roots())
        }
    }
}
