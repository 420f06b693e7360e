//! The chosen scene put together: its nodes' meshes, cameras and lights in world space.

use super::accessor::{Accessors, Format};
use super::budget::Budget;
use super::camera::CameraKind;
use super::document::Document;
use super::fault::{self, Fault, Parsed};
use super::flat::{flattened, is_flat};
use super::ies::Luminaire;
use super::light::Light;
use super::mesh::{self, Mesh, Primitive, Recipe};
use super::node::{self, Graph, Instancing, Node};
use super::skin::{self, Skin};
use super::tangents;
use super::warnings::Warnings;
use crate::camera::Motion;
use crate::geometry::{Aabb, Instance, TriangleMesh};
use crate::material::{Material, NativeBrdf};
use crate::math::{Affine3A, Vec2, Vec3};
use crate::scene::{Part, SceneData, center, middle};
use crate::texture::TextureRef;
use glam::{DAffine3, DQuat, DVec3};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// The parts of a document that nodes refer to.
pub(super) struct Parts<'p, 'a> {
    pub document: &'p Document<'a>,
    pub accessors: &'p Accessors<'a>,
    pub graph: &'p Graph,
    pub meshes: &'p [Mesh],
    pub skins: &'p [Skin],
    pub cameras: &'p [Option<CameraKind>],
    /// By the nodes that carry a camera.
    pub motions: &'p BTreeMap<usize, Motion>,
    pub lights: &'p [Option<Light>],
    /// By the nodes that carry one.
    pub luminaires: &'p BTreeMap<usize, Luminaire>,
}

/// A mesh of the scene with its object-space bounds.
#[derive(Clone, Copy)]
struct Placed {
    mesh: u32,
    bounds: Aabb,
    /// How far its vertices were moved.
    moved: DVec3,
}

/// An instance before the place of the scene is decided.
struct Standing {
    node: usize,
    placed: Placed,
    to_world: DAffine3,
}

/// Most bytes of a vertex: position, normal, tangent, two texture coordinates, colour.
const FLAT_VERTEX: u64 = 72;

/// Fills a scene, whose materials are there already, with what the nodes under `roots` show.
pub(super) struct Assembly<'p, 'a> {
    parts: Parts<'p, 'a>,
    scene: SceneData,
    warnings: &'p mut Warnings,
    budget: &'p mut Budget,
    /// Meshes by recipe and morph weights; `None` for those without triangles.
    made: HashMap<(Recipe, Vec<u32>), Option<Placed>>,
    default_material: Option<u32>,
    standing: Vec<Standing>,
    singular: usize,
}

impl<'p, 'a> Assembly<'p, 'a> {
    /// An assembly of `parts` into `scene`.
    pub fn new(
        parts: Parts<'p, 'a>, scene: SceneData, budget: &'p mut Budget, warnings: &'p mut Warnings,
    ) -> Self {
        Self {
            parts,
            scene,
            warnings,
            budget,
            made: HashMap::new(),
            default_material: None,
            standing: Vec::new(),
            singular: 0,
        }
    }

    /// The finished scene of `nodes`.
    pub fn build(mut self, nodes: &[usize]) -> Parsed<SceneData> {
        let graph = self.parts.graph;
        let mut cameras = Vec::new();
        for &i in nodes {
            let node = &graph.nodes[&i];
            if let Some(index) = node.mesh {
                self.mesh((i, node), &self.parts.meshes[index])?;
            }
        }
        self.place()?;
        let shift = -self.scene.origin;
        for &i in nodes {
            let node = &graph.nodes[&i];
            let to_world = DAffine3::from_translation(shift) * node.to_world;
            if let Some((index, kind)) =
                node.camera.and_then(|c| Some((c, self.parts.cameras[c].as_ref()?)))
            {
                let named = fault::name(&self.parts.document.json["nodes"][i]);
                let fallback = named.map_or_else(|| node::path(i), str::to_owned);
                match kind.placed(&to_world, &fallback) {
                    Some(camera) => {
                        let motion = self.parts.motions.get(&i).map(|m| m.shifted(shift));
                        cameras.push((index, camera, motion));
                    }
                    None => self
                        .warnings
                        .push(format!("/nodes/{i}: its camera has no direction and is left out")),
                }
            }
            let light = node
                .light
                .and_then(|l| self.parts.lights[l].as_ref())
                .map(|light| light.placed(&to_world));
            let luminaire =
                self.parts.luminaires.get(&i).map(|l| l.placed(&to_world, f32::INFINITY));
            for light in [light, luminaire].into_iter().flatten() {
                match light {
                    Some(light) => self.scene.punctual.push(light),
                    None => self
                        .warnings
                        .push(format!("/nodes/{i}: its light has no direction and is left out")),
                }
            }
        }
        cameras.sort_by_key(|(index, ..)| *index);
        (self.scene.cameras, self.scene.motions) =
            cameras.into_iter().map(|(_, camera, motion)| (camera, motion)).unzip();
        if self.singular > 0 {
            let what = format!(
                "{} instances are left out because their transform leaves a line or a point of them",
                self.singular
            );
            self.warnings.push(what);
        }
        Ok(self.scene)
    }

    fn mesh(&mut self, (i, node): (usize, &Node), mesh: &'p Mesh) -> Parsed<()> {
        let weights = node.weights.as_deref().unwrap_or(&mesh.weights);
        if let Some(skin) = node.skin {
            return self.skinned((i, node), mesh, weights, &self.parts.skins[skin]);
        }
        let mut placed = Vec::new();
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let key =
                (primitive.recipe.clone(), weights.iter().map(|w| w.to_bits()).collect::<Vec<_>>());
            let entry = match self.made.get(&key) {
                Some(entry) => *entry,
                None => {
                    let built = mesh::build(primitive, weights, self.parts.accessors, self.budget)?;
                    let entry =
                        self.finish(primitive, name(mesh, k), built.mesh, built.degenerate)?;
                    self.made.insert(key, entry);
                    entry
                }
            };
            placed.extend(entry);
        }
        match &node.instancing {
            None => placed.iter().try_for_each(|p| self.instance(i, *p, node.to_world)),
            Some(instancing) => {
                for local in self.instances(i, instancing)? {
                    placed.iter().try_for_each(|p| self.instance(i, *p, node.to_world * local))?;
                }
                Ok(())
            }
        }
    }

    /// A skinned mesh stands in the world by its joints alone: its node's own transform does not
    /// count.
    fn skinned(
        &mut self, (i, node): (usize, &Node), mesh: &Mesh, weights: &[f32], skin: &Skin,
    ) -> Parsed<()> {
        let matrices = skin.matrices(self.parts.graph, self.parts.accessors, self.budget)?;
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let mut built = mesh::build(primitive, weights, self.parts.accessors, self.budget)?;
            let mut to_world = DAffine3::IDENTITY;
            if built.influences.sets == 0 {
                to_world = node.to_world;
            } else {
                skin::apply(&mut built.mesh, &built.influences, &matrices, &primitive.path)?;
                let mesh = &mut built.mesh;
                built.degenerate +=
                    super::topology::drop_degenerate(mesh.indices.to_mut(), &mesh.positions);
            }
            if let Some(placed) =
                self.finish(primitive, name(mesh, k), built.mesh, built.degenerate)?
            {
                self.instance(i, placed, to_world)?;
            }
        }
        Ok(())
    }

    /// Completes a mesh and adds it to the scene; `None` if nothing of it is left.
    fn finish(
        &mut self, primitive: &Primitive, name: String, mut mesh: TriangleMesh, degenerate: usize,
    ) -> Parsed<Option<Placed>> {
        mesh.name = name;
        if degenerate > 0 {
            self.warnings.push(format!(
                "{}: {degenerate} triangles without area are left out",
                primitive.path
            ));
        }
        if mesh.indices.is_empty() {
            return Ok(None);
        }
        let lost = tangents::normalize(&mut mesh);
        if lost > 0 {
            self.warnings
                .push(format!("{}: {lost} normals of length 0 are replaced", primitive.path));
        }
        if primitive.recipe.material.is_none() {
            let scene = &mut self.scene;
            mesh.material = *self.default_material.get_or_insert_with(|| {
                scene
                    .materials
                    .push(Material { name: "default".to_owned(), ..Material::default() });
                scene.materials.len() as u32 - 1
            });
        }
        self.texture_space(primitive, &mut mesh);
        let (number, mut mesh) = (self.scene.geometry.meshes.len() as u32, Arc::new(mesh));
        let (moved, bounds) = center(&mut mesh);
        self.scene.geometry.meshes.push(mesh);
        Ok(Some(Placed { mesh: number, bounds, moved }))
    }

    /// Makes the tangents that the material needs, and tells of texture coordinates that it needs
    /// and the mesh lacks.
    fn texture_space(&mut self, primitive: &Primitive, mesh: &mut TriangleMesh) {
        let material = &self.scene.materials[mesh.material as usize];
        let anisotropic = matches!(
            material.native,
            Some(NativeBrdf::WardDuer { .. } | NativeBrdf::Lafortune { .. })
        );
        if let Some(set) =
            textures(material).map(|t| t.uv_set).find(|set| mesh.uv[usize::from(*set)].is_none())
        {
            let what = format!(
                "{}: its material reads a texture at TEXCOORD_{set}, which it does not have",
                primitive.path
            );
            self.warnings.push(what);
        }
        if mesh.tangents.is_some() {
            return;
        }
        match &material.normal_texture {
            Some(t) => {
                let (sin, cos) = t.rotation.sin_cos();
                tangents::generate_tangents(mesh, usize::from(t.uv_set), |uv| {
                    let uv = uv * t.scale;
                    t.offset + Vec2::new(cos * uv.x + sin * uv.y, cos * uv.y - sin * uv.x)
                });
            }
            None if anisotropic => tangents::generate_tangents(mesh, 0, |uv| uv),
            None => {}
        }
    }

    fn instance(&mut self, node: usize, placed: Placed, to_world: DAffine3) -> Parsed<()> {
        self.budget.spend(1, size_of::<Standing>() as u64, &node::path(node))?;
        let to_world = to_world * DAffine3::from_translation(placed.moved);
        self.standing.push(Standing { node, placed, to_world });
        Ok(())
    }

    /// Decides the place of the scene's coordinates, and puts the instances there.
    fn place(&mut self) -> Parsed<()> {
        let standing = std::mem::take(&mut self.standing);
        let meshes = &self.scene.geometry.meshes;
        let part = |s: &Standing| {
            let triangles = meshes[s.placed.mesh as usize].indices.len();
            Part::new(&s.placed.bounds, triangles, &s.to_world)
        };
        self.scene.origin = middle(&standing.iter().map(part).collect::<Vec<_>>());
        standing.into_iter().try_for_each(|s| self.stand(s))
    }

    fn stand(&mut self, Standing { node, placed, to_world }: Standing) -> Parsed<()> {
        let path = node::path(node);
        let exact = DAffine3::from_translation(-self.scene.origin) * to_world;
        let to_world =
            Affine3A::from_mat3_translation(exact.matrix3.as_mat3(), exact.translation.as_vec3());
        let Aabb { min, max } = placed.bounds;
        let reach = Vec3::max(min.abs(), max.abs());
        let far = to_world.matrix3.x_axis.abs() * reach.x
            + to_world.matrix3.y_axis.abs() * reach.y
            + to_world.matrix3.z_axis.abs() * reach.z;
        if !(far + to_world.translation.abs()).is_finite() {
            return Err(Fault::new(path, "its mesh leaves the range of numbers"));
        }
        let regular = to_world.matrix3.determinant().is_normal() && to_world.inverse().is_finite();
        if regular && !is_flat(&exact) {
            self.scene.geometry.instances.push(Instance { mesh: placed.mesh, to_world });
            return Ok(());
        }
        let geometry = &mut self.scene.geometry;
        let mesh = &geometry.meshes[placed.mesh as usize];
        self.budget.spend(mesh.positions.len() as u64, FLAT_VERTEX, &path)?;
        self.budget.spend(mesh.indices.len() as u64, size_of::<[u32; 3]>() as u64, &path)?;
        let mesh = flattened(mesh, &exact);
        if mesh.indices.is_empty() {
            self.singular += 1;
        } else {
            let to_world = Affine3A::IDENTITY;
            geometry.instances.push(Instance { mesh: geometry.meshes.len() as u32, to_world });
            geometry.meshes.push(Arc::new(mesh));
        }
        Ok(())
    }

    /// The transforms of EXT_mesh_gpu_instancing, relative to the node.
    fn instances(&mut self, node: usize, instancing: &Instancing) -> Parsed<Vec<DAffine3>> {
        let base = format!("/nodes/{node}/extensions/EXT_mesh_gpu_instancing/attributes");
        let mut count = None;
        let translations: Option<Vec<Vec3>> = self.instanced(
            instancing.translation,
            &Format::VECTORS,
            &base,
            "TRANSLATION",
            &mut count,
        )?;
        let rotations: Option<Vec<[f32; 4]>> =
            self.instanced(instancing.rotation, &Format::ROTATIONS, &base, "ROTATION", &mut count)?;
        let scales: Option<Vec<Vec3>> =
            self.instanced(instancing.scale, &Format::VECTORS, &base, "SCALE", &mut count)?;
        let transform = |i: usize| {
            let vector = |values: &Option<Vec<Vec3>>, default: DVec3| {
                values.as_ref().map_or(default, |v| v[i].as_dvec3())
            };
            let rotation = rotations.as_ref().map_or(DQuat::IDENTITY, |rotations| {
                DQuat::from_array(rotations[i].map(f64::from))
            });
            if rotation.length_squared() < 1e-6 {
                let what = format!("element {i} is no rotation: its length should be 1");
                return Err(Fault::new(format!("{base}/ROTATION"), what));
            }
            let (scale, translation) =
                (vector(&scales, DVec3::ONE), vector(&translations, DVec3::ZERO));
            Ok(DAffine3::from_scale_rotation_translation(scale, rotation.normalize(), translation))
        };
        (0..count.unwrap_or(1) as usize).map(transform).collect()
    }

    /// One of the attributes of instances, which all have the same count.
    fn instanced<const N: usize, T: From<[f32; N]> + Clone>(
        &mut self, index: Option<usize>, format: &Format, base: &str, key: &str,
        count: &mut Option<u64>,
    ) -> Parsed<Option<Vec<T>>> {
        let Some(index) = index else { return Ok(None) };
        let path = format!("{base}/{key}");
        let accessor = self.parts.accessors.expect(index, format, &path)?;
        if *count.get_or_insert(accessor.count) != accessor.count {
            return Err(Fault::new(path, "its count differs from that of the other attributes"));
        }
        self.parts.accessors.read(accessor, None, 0.0, self.budget).map(Some)
    }
}

fn name(mesh: &Mesh, primitive: usize) -> String {
    if mesh.primitives.len() == 1 {
        mesh.name.clone()
    } else {
        format!("{}[{primitive}]", mesh.name)
    }
}

/// The textures that a material reads.
fn textures(m: &Material) -> impl Iterator<Item = &TextureRef> {
    [
        &m.base_color_texture,
        &m.metallic_roughness_texture,
        &m.normal_texture,
        &m.emission_texture,
        &m.specular_texture,
        &m.specular_color_texture,
        &m.transmission_texture,
        &m.clearcoat_texture,
        &m.clearcoat_roughness_texture,
    ]
    .into_iter()
    .flatten()
}
