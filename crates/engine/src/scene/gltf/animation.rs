//! Animations as the file has them: which properties of nodes they move, and by which keys. Every
//! index in them is checked here, before anything follows it.

use super::accessor::Accessor;
use super::document::{malformed, typed};
use crate::scene::{AnimationName, SceneError};
use gltf::json::Root;
use gltf::json::accessor::{ComponentType, Type};
use serde::Deserialize;
use serde_json::Value;

/// An animation.
#[derive(Deserialize)]
pub(super) struct Animation {
    /// Its name.
    pub name: Option<String>,
    /// What it moves.
    #[serde(default)]
    pub channels: Vec<Channel>,
    /// The keys by which it moves.
    #[serde(default)]
    pub samplers: Vec<Sampler>,
}

/// A property and the keys by which it moves.
#[derive(Deserialize)]
pub(super) struct Channel {
    /// The keys: one of the animation's samplers.
    pub sampler: usize,
    /// The property.
    pub target: Target,
}

/// A property of a node.
#[derive(Deserialize)]
pub(super) struct Target {
    /// The node; without one an extension says what is moved.
    pub node: Option<usize>,
    /// `translation`, `rotation`, `scale`, `weights`, or what an extension calls it.
    pub path: String,
}

/// Keys: times, and the values at them.
#[derive(Deserialize)]
pub(super) struct Sampler {
    /// Accessor of the times, seconds.
    pub input: usize,
    /// Accessor of the values.
    pub output: usize,
    /// What is between keys.
    #[serde(default)]
    pub interpolation: Interpolation,
}

/// What a property is between two keys.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
pub(super) enum Interpolation {
    /// The value of the key before.
    #[serde(rename = "STEP")]
    Step,
    /// On the straight line, or for rotations on the shortest arc.
    #[default]
    #[serde(rename = "LINEAR")]
    Linear,
    /// On the cubic that has the keys' values and tangents.
    #[serde(rename = "CUBICSPLINE")]
    Cubic,
}

/// Reads the list of animations; every index in it is in range then.
pub(super) fn read(list: Value, root: &Root) -> Result<Vec<Animation>, SceneError> {
    if list.is_null() {
        return Ok(Vec::new());
    }
    let animations: Vec<Animation> = typed(&list, "animations")?;
    for (index, animation) in animations.iter().enumerate() {
        check(animation, &format!("animations[{index}]"), root)?;
    }
    Ok(animations)
}

fn check(animation: &Animation, at: &str, root: &Root) -> Result<(), SceneError> {
    let within = |at: String, index: usize, count: usize, list: &str| {
        if index < count {
            return Ok(());
        }
        Err(malformed(at, format!("{index}, but there are {count} {list}")))
    };
    for (place, sampler) in animation.samplers.iter().enumerate() {
        for (member, index) in [("input", sampler.input), ("output", sampler.output)] {
            let at = format!("{at}.samplers[{place}].{member}");
            within(at, index, root.accessors.len(), "accessors")?;
        }
    }
    for (place, channel) in animation.channels.iter().enumerate() {
        let at = format!("{at}.channels[{place}]");
        let count = animation.samplers.len();
        within(format!("{at}.sampler"), channel.sampler, count, "samplers in the animation")?;
        if let Some(node) = channel.target.node {
            within(format!("{at}.target.node"), node, root.nodes.len(), "nodes")?;
        }
    }
    Ok(())
}

/// What there is to choose from, and how long each lasts: until the last key of all its samplers.
pub(super) fn names(animations: &[Animation], accessors: &[Accessor<'_>]) -> Vec<AnimationName> {
    let last = |sampler: &Sampler| {
        let times = &accessors[sampler.input];
        let is_time = times.kind == Type::Scalar && times.component == ComponentType::F32;
        is_time.then(|| times.element(times.count - 1)[0])
    };
    let seconds = |animation: &Animation| {
        let lasts = animation.samplers.iter().filter_map(last);
        lasts.filter(|time| time.is_finite()).fold(0.0, f32::max)
    };
    let name = |animation: &Animation| AnimationName {
        name: animation.name.clone(),
        seconds: seconds(animation),
    };
    animations.iter().map(name).collect()
}
