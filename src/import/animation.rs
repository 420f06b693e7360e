//! Animations, as far as they move cameras.
//!
//! All animations of a file play together from second 0 on. Only the nodes that carry cameras are
//! looked at closely; the references of all others are checked.

use super::accessor::{Accessors, Format};
use super::budget::Budget;
use super::document::Document;
use super::fault::{Fault, Parsed};
use super::node::{Graph, local_transform};
use super::value::numbers;
use super::warnings::Warnings;
use crate::camera::{Interpolation, Joint, Motion, Track};
use gltf::animation::{Interpolation as Kind, Property};
use gltf::json::animation as json;
use gltf::json::validation::Checked;
use serde_json::Value;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashSet};

/// The motions of the document's cameras, by the nodes that carry them; nodes that stand still are
/// left out.
pub(super) fn motions(
    document: &Document, accessors: &Accessors, graph: &Graph, budget: &mut Budget,
    warnings: &mut Warnings,
) -> Parsed<BTreeMap<usize, Motion>> {
    let lines = moved_lines(document, graph, budget)?;
    let mut joints: BTreeMap<usize, Joint> = BTreeMap::new();
    for &i in lines.iter().flatten() {
        if let Entry::Vacant(place) = joints.entry(i) {
            place.insert(at_rest(&document.json["nodes"][i])?);
        }
    }
    for (i, animation) in document.root().animations.iter().enumerate() {
        for (k, channel) in animation.channels.iter().enumerate() {
            // The node of an unknown property need not be there.
            let Checked::Valid(property) = channel.target.path else { continue };
            let sampler = channel.sampler.value();
            let sampler = Sampler {
                json: &animation.samplers[sampler],
                path: format!("/animations/{i}/samplers/{sampler}"),
                accessors,
            };
            let Some(joint) = joints.get_mut(&channel.target.node.value()) else {
                // It moves nothing that is shown.
                if let Err(Fault { path, what, .. }) = sampler.check(property) {
                    warnings.mend(&path, what)?;
                }
                continue;
            };
            let first = match property {
                Property::Translation => {
                    give(&mut joint.translation, sampler.track(&Format::VECTORS, budget)?)
                }
                Property::Rotation => {
                    give(&mut joint.rotation, sampler.track(&Format::ANIMATED_ROTATIONS, budget)?)
                }
                Property::Scale => give(&mut joint.scale, sampler.track(&Format::VECTORS, budget)?),
                Property::MorphTargetWeights => true,
            };
            if !first {
                let what =
                    "another animation has this property of the node already, and counts alone";
                warnings.push(format!("/animations/{i}/channels/{k}: {what}"));
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

/// The nodes with cameras that something may move, each behind those above it.
fn moved_lines(document: &Document, graph: &Graph, budget: &mut Budget) -> Parsed<Vec<Vec<usize>>> {
    let animations = document.root().animations.iter();
    let channels = animations.flat_map(|animation| &animation.channels);
    let targets: HashSet<usize> = channels.map(|channel| channel.target.node.value()).collect();
    let mut moved = HashSet::new();
    let mut lines = Vec::new();
    for i in graph.reachable(&graph.roots()) {
        if targets.contains(&i) || graph.parent(i).is_some_and(|parent| moved.contains(&parent)) {
            moved.insert(i);
            if graph.nodes[&i].camera.is_some() {
                let line = graph.line(i, budget)?;
                lines.push(line);
            }
        }
    }
    lines.sort_by_key(|line| line.last().copied());
    Ok(lines)
}

/// Puts `track` in its place unless there is one already.
fn give<const N: usize>(place: &mut Option<Track<N>>, track: Track<N>) -> bool {
    let free = place.is_none();
    place.get_or_insert(track);
    free
}

/// A node that no track moves.
fn at_rest(node: &Value) -> Parsed<Joint> {
    // Complaints about the transform were made when the nodes were read. Where a matrix stands for
    // the three parts, they are taken from it.
    let (scale, rotation, translation) =
        local_transform(node, "", &mut Warnings::default())?.to_scale_rotation_translation();
    let scale = numbers::<3>(&node["scale"]).map_or(scale, glam::DVec3::from_array);
    let rotation = match numbers::<4>(&node["rotation"]) {
        Some(xyzw) => glam::DQuat::from_array(xyzw).normalize(),
        None if node.get("scale").is_some() => glam::DQuat::IDENTITY,
        None => rotation,
    };
    Ok(Joint {
        rest: (translation, rotation, scale),
        translation: None,
        rotation: None,
        scale: None,
    })
}

/// A sampler of an animation.
struct Sampler<'s, 'a> {
    json: &'s json::Sampler,
    path: String,
    accessors: &'s Accessors<'a>,
}

impl Sampler<'_, '_> {
    /// Checks what times and values are stored as, and their number.
    fn check(&self, property: Property) -> Parsed<()> {
        let Self { json, path, accessors } = self;
        let format = match property {
            Property::Translation | Property::Scale => &Format::VECTORS,
            Property::Rotation => &Format::ANIMATED_ROTATIONS,
            Property::MorphTargetWeights => &Format::ANIMATED_WEIGHTS,
        };
        let (input, output) = (format!("{path}/input"), format!("{path}/output"));
        let times = accessors.expect(json.input.value(), &Format::SCALARS, &input)?.count;
        let values = accessors.expect(json.output.value(), format, &output)?.count;
        let wanted = times.saturating_mul(if self.is_cubic() { 3 } else { 1 });
        let fits = match property {
            Property::MorphTargetWeights => values.is_multiple_of(wanted),
            _ => values == wanted,
        };
        if fits {
            return Ok(());
        }
        let what =
            format!("{times} keyframes of this interpolation need {wanted} values, not {values}");
        Err(Fault::new(output, what))
    }

    fn is_cubic(&self) -> bool {
        matches!(self.json.interpolation, Checked::Valid(Kind::CubicSpline))
    }

    fn track<const N: usize>(&self, format: &Format, budget: &mut Budget) -> Parsed<Track<N>> {
        let Self { json, path, accessors } = self;
        let (input, output) = (format!("{path}/input"), format!("{path}/output"));
        let times = accessors.expect(json.input.value(), &Format::SCALARS, &input)?;
        let times = accessors.read::<1, [f32; 1]>(times, None, 0.0, budget)?.concat();
        let values = accessors.expect(json.output.value(), format, &output)?;
        let values = accessors.read::<N, [f32; N]>(values, None, 0.0, budget)?;
        if times[0] < 0.0 || times.windows(2).any(|t| t[1] <= t[0]) {
            let what = "its times must start at 0 or later, and each must exceed the one before";
            return Err(Fault::new(input, what));
        }
        let interpolation = match json.interpolation {
            Checked::Valid(Kind::Step) => Interpolation::Step,
            Checked::Valid(Kind::CubicSpline) => Interpolation::Cubic,
            _ => Interpolation::Linear,
        };
        let wanted =
            if interpolation == Interpolation::Cubic { 3 * times.len() } else { times.len() };
        if values.len() != wanted {
            let what = format!(
                "{} keyframes of this interpolation need {wanted} values, not {}",
                times.len(),
                values.len()
            );
            return Err(Fault::new(output, what));
        }
        Ok(Track { times, values, interpolation })
    }
}
