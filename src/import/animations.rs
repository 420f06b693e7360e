//! Animations, as far as they move cameras.
//!
//! All animations of a file play together from second 0 on. Only the nodes that carry cameras are
//! looked at closely; the references of all others are checked.

use super::accessors::{Accessors, Format};
use super::budget::Budget;
use super::json::{Fault, Json, Parsed, quote};
use super::layout::{Component, Shape};
use super::nodes::{Graph, local_transform};
use crate::camera::{Interpolation, Joint, Motion, Track};
use std::collections::BTreeMap;

const TIMES: Format = Format { shapes: &[Shape::Scalar], components: &[(Component::F32, None)] };
const VECTORS: Format = Format { shapes: &[Shape::Vec3], components: &[(Component::F32, None)] };
const ROTATIONS: Format = Format {
    shapes: &[Shape::Vec4],
    components: &[
        (Component::F32, None),
        (Component::I8, Some(true)),
        (Component::U8, Some(true)),
        (Component::I16, Some(true)),
        (Component::U16, Some(true)),
    ],
};

/// A sampler as the document describes it.
struct Sampler {
    path: String,
    input: usize,
    output: usize,
    interpolation: Interpolation,
}

/// The motions of the document's cameras, by the nodes that carry them; nodes that stand still are
/// left out.
pub(super) fn motions(
    root: &Json,
    accessors: &Accessors,
    graph: &Graph,
    budget: &mut Budget,
    warnings: &mut Vec<String>,
) -> Parsed<BTreeMap<usize, Motion>> {
    let nodes = root.array("nodes")?;
    let lines = graph
        .nodes
        .iter()
        .enumerate()
        .filter(|(_, node)| node.camera.is_some())
        .map(|(i, _)| graph.line(i));
    let lines: Vec<Vec<usize>> = lines.collect();
    let mut joints: BTreeMap<usize, Joint> = BTreeMap::new();
    for &i in lines.iter().flatten() {
        joints.insert(i, at_rest(&nodes[i])?);
    }
    for animation in root.entities("animations")? {
        let samplers = animation.array("samplers")?;
        let samplers = samplers
            .iter()
            .map(|s| sampler(s, accessors.list.len()))
            .collect::<Parsed<Vec<_>>>()?;
        let list = animation.path_of("samplers");
        for channel in animation.array("channels")? {
            let sampler = &samplers
                [channel.need_index("sampler", list.trim_start_matches('/'), samplers.len())?];
            let target = channel.need_object("target")?;
            let property = target.need_string("path")?;
            let node = target.index("node", "nodes", nodes.len())?;
            let Some(joint) = node.and_then(|i| joints.get_mut(&i)) else { continue };
            let first = match property {
                "translation" => {
                    give(&mut joint.translation, sampler.track(accessors, &VECTORS, budget)?)
                }
                "rotation" => {
                    give(&mut joint.rotation, sampler.track(accessors, &ROTATIONS, budget)?)
                }
                "scale" => give(&mut joint.scale, sampler.track(accessors, &VECTORS, budget)?),
                _ => true,
            };
            if !first {
                warnings.push(format!(
                    "{}: another animation has this {property} already, and counts alone",
                    channel.path()
                ));
            }
        }
    }
    let moves = |i: &usize| {
        joints[i].translation.is_some() || joints[i].rotation.is_some() || joints[i].scale.is_some()
    };
    let motion =
        |line: &[usize]| Motion { joints: line.iter().map(|i| joints[i].clone()).collect() };
    Ok(lines
        .iter()
        .filter(|line| line.iter().any(moves))
        .map(|line| (line[line.len() - 1], motion(line)))
        .collect())
}

/// Puts `track` in its place unless there is one already.
fn give<const N: usize>(place: &mut Option<Track<N>>, track: Track<N>) -> bool {
    let free = place.is_none();
    place.get_or_insert(track);
    free
}

/// A node that no track moves.
fn at_rest(node: &Json) -> Parsed<Joint> {
    // Complaints about the transform were made when the nodes were read. Where a matrix stands for
    // the three parts, they are taken from it.
    let (scale, rotation, translation) =
        local_transform(node, &mut Vec::new())?.to_scale_rotation_translation();
    let scale = node.numbers::<3>("scale")?.map_or(scale, glam::DVec3::from_array);
    let rotation = match node.numbers::<4>("rotation")? {
        Some(xyzw) => glam::DQuat::from_array(xyzw).normalize(),
        None if node.has("scale") => glam::DQuat::IDENTITY,
        None => rotation,
    };
    Ok(Joint {
        rest: (translation, rotation, scale),
        translation: None,
        rotation: None,
        scale: None,
    })
}

fn sampler(json: &Json, accessors: usize) -> Parsed<Sampler> {
    let interpolation = match json.string("interpolation")? {
        None | Some("LINEAR") => Interpolation::Linear,
        Some("STEP") => Interpolation::Step,
        Some("CUBICSPLINE") => Interpolation::Cubic,
        Some(other) => {
            return Err(json.fault_at(
                "interpolation",
                format!("{} is no interpolation of glTF", quote(other)),
            ));
        }
    };
    let input = json.need_index("input", "accessors", accessors)?;
    let output = json.need_index("output", "accessors", accessors)?;
    Ok(Sampler { path: json.path().to_owned(), input, output, interpolation })
}

impl Sampler {
    fn track<const N: usize>(
        &self,
        accessors: &Accessors,
        format: &Format,
        budget: &mut Budget,
    ) -> Parsed<Track<N>> {
        let (input, output) = (format!("{}/input", self.path), format!("{}/output", self.path));
        let times = accessors
            .read::<1>(accessors.expect(self.input, &TIMES, &input)?, None, 0.0, budget)?
            .concat();
        let values = accessors.read::<N>(
            accessors.expect(self.output, format, &output)?,
            None,
            0.0,
            budget,
        )?;
        if times[0] < 0.0 || times.windows(2).any(|t| t[1] <= t[0]) {
            return Err(Fault::new(
                input,
                "its times must start at 0 or later, and each must exceed the one before",
            ));
        }
        let wanted =
            if self.interpolation == Interpolation::Cubic { 3 * times.len() } else { times.len() };
        if values.len() != wanted {
            let what = format!(
                "{} keyframes of this interpolation need {wanted} values, not {}",
                times.len(),
                values.len()
            );
            return Err(Fault::new(output, what));
        }
        Ok(Track { times, values, interpolation: self.interpolation })
    }
}
