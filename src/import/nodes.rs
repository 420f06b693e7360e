//! The node graph: transforms, and what stands where.

use super::json::{Fault, Json, Parsed};
use glam::{DAffine3, DMat4, DQuat, DVec3};

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

/// Numbers of the things that nodes refer to.
pub(super) struct Counts {
    pub accessors: usize,
    pub meshes: usize,
    pub skins: usize,
    pub cameras: usize,
    pub lights: usize,
}

/// All nodes with their world transforms.
pub(super) struct Graph {
    /// The nodes.
    pub nodes: Vec<Node>,
}

impl Graph {
    /// Reads the nodes and checks that they form trees.
    pub fn parse(root: &Json, counts: &Counts, warnings: &mut Vec<String>) -> Parsed<Self> {
        let entities = root.entities("nodes")?;
        let mut locals = Vec::with_capacity(entities.len());
        let mut nodes = Vec::with_capacity(entities.len());
        for json in &entities {
            locals.push(local_transform(json, warnings)?);
            nodes.push(node(json, entities.len(), counts)?);
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

fn node(json: &Json, nodes: usize, counts: &Counts) -> Parsed<Node> {
    let children = json
        .array("children")?
        .iter()
        .map(|c| c.as_index("nodes", nodes))
        .collect::<Parsed<Vec<_>>>()?;
    let light = match json.extension("KHR_lights_punctual")? {
        Some(reference) => Some(reference.need_index(
            "light",
            "extensions/KHR_lights_punctual/lights",
            counts.lights,
        )?),
        None => None,
    };
    let instancing = match json.extension("EXT_mesh_gpu_instancing")? {
        Some(extension) => {
            let attributes = extension.need_object("attributes")?;
            let accessor = |key: &str| attributes.index(key, "accessors", counts.accessors);
            let (translation, rotation, scale) =
                (accessor("TRANSLATION")?, accessor("ROTATION")?, accessor("SCALE")?);
            Some(Instancing { translation, rotation, scale })
        }
        None => None,
    };
    let weights = match json.has("weights") {
        true => Some(
            json.array("weights")?
                .iter()
                .map(|w| Ok(w.as_number()? as f32))
                .collect::<Parsed<Vec<_>>>()?,
        ),
        false => None,
    };
    let (mesh, skin) =
        (json.index("mesh", "meshes", counts.meshes)?, json.index("skin", "skins", counts.skins)?);
    if mesh.is_none() && (skin.is_some() || weights.is_some()) {
        return Err(json.fault("it has a skin or weights, and no mesh"));
    }
    Ok(Node {
        path: json.path().to_owned(),
        name: json.object_name().unwrap_or("").to_owned(),
        to_world: DAffine3::IDENTITY,
        mesh,
        skin,
        camera: json.index("camera", "cameras", counts.cameras)?,
        light,
        weights,
        instancing,
        children,
        parent: None,
    })
}

pub(super) fn local_transform(json: &Json, warnings: &mut Vec<String>) -> Parsed<DAffine3> {
    let (translation, scale) = (json.numbers::<3>("translation")?, json.numbers::<3>("scale")?);
    let rotation = json.numbers::<4>("rotation")?;
    if let Some(matrix) = json.numbers::<16>("matrix")? {
        if translation.is_some() || rotation.is_some() || scale.is_some() {
            return Err(json.fault_at(
                "matrix",
                "a node has either a matrix or translation, rotation and scale, not both",
            ));
        }
        let matrix = DMat4::from_cols_array(&matrix);
        let last = matrix.row(3);
        if (last - glam::DVec4::W).abs().max_element() > 1e-5 {
            return Err(json.fault_at("matrix", "its last row is not 0 0 0 1"));
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let rotation = match rotation {
        Some(xyzw) => unit_quaternion(xyzw, &json.path_of("rotation"), warnings)?,
        None => DQuat::IDENTITY,
    };
    let translation = translation.map_or(DVec3::ZERO, DVec3::from_array);
    Ok(DAffine3::from_scale_rotation_translation(
        scale.map_or(DVec3::ONE, DVec3::from_array),
        rotation,
        translation,
    ))
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

/// The scene that the document itself chooses.
pub(super) fn default_scene(root: &Json) -> Parsed<Option<usize>> {
    root.index("scene", "scenes", root.array("scenes")?.len())
}

/// The nodes that the chosen scene shows.
pub(super) fn scene_roots(
    root: &Json,
    graph: &Graph,
    choice: Option<&super::SceneChoice>,
    warnings: &mut Vec<String>,
) -> Parsed<Vec<usize>> {
    let scenes = root.entities("scenes")?;
    let default = default_scene(root)?;
    let mut lists = Vec::new();
    let mut scene_of = vec![usize::MAX; graph.nodes.len()];
    for (number, scene) in scenes.iter().enumerate() {
        let mut list = Vec::new();
        for node in scene.array("nodes")? {
            let i = node.as_index("nodes", graph.nodes.len())?;
            if !graph.is_root(i) {
                return Err(
                    node.fault(format!("/nodes/{i} is the child of another node, so it cannot stand in a scene by itself"))
                );
            }
            if std::mem::replace(&mut scene_of[i], number) == number {
                return Err(node.fault(format!("/nodes/{i} is listed twice")));
            }
            list.push(i);
        }
        lists.push(list);
    }
    let names = || {
        scenes
            .iter()
            .filter_map(Json::object_name)
            .map(super::json::quote)
            .collect::<Vec<_>>()
            .join(", ")
    };
    let chosen = match choice {
        None => default.or_else(|| (!scenes.is_empty()).then_some(0)),
        Some(super::SceneChoice::Index(i)) if *i < scenes.len() => Some(*i),
        Some(super::SceneChoice::Index(i)) => {
            return Err(Fault::new(
                "/scenes",
                format!("there is no scene {i}: the file has {}", scenes.len()),
            ));
        }
        Some(super::SceneChoice::Name(name)) => {
            let found = scenes.iter().position(|s| s.object_name() == Some(name));
            Some(found.ok_or_else(|| {
                Fault::new(
                    "/scenes",
                    format!("no scene is called {name:?}; there are: {}", names()),
                )
            })?)
        }
    };
    match chosen {
        Some(i) => Ok(lists.swap_remove(i)),
        None => {
            if !graph.nodes.is_empty() {
                warnings.push("the file has no scene; all its nodes are shown".to_owned());
            }
            Ok(graph.roots())
        }
    }
}
