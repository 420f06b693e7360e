//! Skins: vertices moved by joints in their rest pose.

use super::accessor::{Accessors, Format};
use super::budget::Budget;
use super::document::Document;
use super::fault::{Fault, Parsed};
use super::mesh::Influences;
use super::node::Graph;
use crate::geometry::TriangleMesh;
use glam::{DAffine3, DMat4, DVec3};

/// A skin of the document.
pub(super) struct Skin {
    /// Nodes.
    joints: Vec<usize>,
    /// The accessor of the inverse bind matrices.
    inverse_bind: Option<usize>,
}

/// Reads all skins.
pub(super) fn skins(document: &Document, accessors: &Accessors) -> Parsed<Vec<Skin>> {
    let skin = |(i, json): (usize, &gltf::json::Skin)| {
        let at = format!("/skins/{i}/inverseBindMatrices");
        let joints: Vec<usize> = json.joints.iter().map(|joint| joint.value()).collect();
        let inverse_bind = json.inverse_bind_matrices.map(|matrices| matrices.value());
        if let Some(index) = inverse_bind {
            let matrices = accessors.expect(index, &Format::MATRICES, &at)?;
            let (wanted, count) = (joints.len(), matrices.count);
            if count < wanted as u64 {
                let what = format!(
                    "{wanted} joints need as many matrices, and {} has {count}",
                    matrices.path
                );
                return Err(Fault::new(at, what));
            }
        }
        Ok(Skin { joints, inverse_bind })
    };
    document.root().skins.iter().enumerate().map(skin).collect()
}

impl Skin {
    /// What each joint does to a vertex: from the mesh's space to the world, in the rest pose.
    pub fn matrices(
        &self, graph: &Graph, accessors: &Accessors, budget: &mut Budget,
    ) -> Parsed<Vec<DAffine3>> {
        budget.spend(self.joints.len() as u64, size_of::<DAffine3>() as u64, "/skins")?;
        let bind = match self.inverse_bind {
            Some(index) => {
                Some(accessors.read::<16, [f32; 16]>(&accessors.list[index], None, 0.0, budget)?)
            }
            None => None,
        };
        let matrix = |(k, joint): (usize, &usize)| {
            let bind = bind.as_ref().map_or(DAffine3::IDENTITY, |b| {
                DAffine3::from_mat4(DMat4::from_cols_array(&b[k].map(f64::from)))
            });
            graph.to_world(*joint) * bind
        };
        Ok(self.joints.iter().enumerate().map(matrix).collect())
    }
}

/// Moves the vertices of `mesh` to the world by the joints' `matrices`; `path` names the primitive
/// in messages.
///
/// ```text
/// p' = Σ_j w_j (joint to world)_j (inverse bind)_j p / Σ_j w_j        [glTF20, 3.7.3.3]
/// ```
///
/// Normals take the inverse transpose of the blended matrix.
pub(super) fn apply(
    mesh: &mut TriangleMesh, influences: &Influences, matrices: &[DAffine3], path: &str,
) -> Parsed<()> {
    let count = mesh.positions.len();
    for i in 0..count {
        let mut sum = 0.0;
        let mut blend = [DVec3::ZERO; 4];
        for set in 0..influences.sets {
            let place = set * count + i;
            for (joint, weight) in influences.joints[place].iter().zip(influences.weights[place]) {
                if weight == 0.0 {
                    continue;
                }
                let matrix = matrices.get(*joint as usize).ok_or_else(|| {
                    Fault::new(
                        path,
                        format!(
                            "a vertex follows joint {joint}, and the skin has {}",
                            matrices.len()
                        ),
                    )
                })?;
                sum += f64::from(weight);
                for (column, added) in blend.iter_mut().zip(columns(matrix)) {
                    *column += f64::from(weight) * added;
                }
            }
        }
        // A vertex that follows nothing stays with the first joint; weights that do not sum to 1
        // would scale.
        let blend = match matrices {
            [first, ..] if sum <= 1e-6 => columns(first),
            _ => blend.map(|column| column / sum),
        };
        let p = mesh.positions[i].as_dvec3();
        mesh.positions[i] = (blend[0] * p.x + blend[1] * p.y + blend[2] * p.z + blend[3]).as_vec3();
        if !mesh.positions[i].is_finite() {
            return Err(Fault::new(path, "skinning moves a vertex out of the range of numbers"));
        }
        if let Some(normals) = &mut mesh.normals {
            // The cofactor matrix is the inverse transpose but for a factor.
            let n = normals[i].as_dvec3();
            let moved = blend[1].cross(blend[2]) * n.x
                + blend[2].cross(blend[0]) * n.y
                + blend[0].cross(blend[1]) * n.z;
            normals[i] = moved.normalize_or_zero().as_vec3();
        }
        if let Some(tangents) = &mut mesh.tangents {
            let t = tangents[i].as_dvec4();
            let moved = blend[0] * t.x + blend[1] * t.y + blend[2] * t.z;
            tangents[i] = moved.normalize_or_zero().as_vec3().extend(tangents[i].w);
        }
    }
    Ok(())
}

fn columns(matrix: &DAffine3) -> [DVec3; 4] {
    [matrix.matrix3.x_axis, matrix.matrix3.y_axis, matrix.matrix3.z_axis, matrix.translation]
}
