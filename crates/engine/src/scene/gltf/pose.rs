//! What an animation makes of the nodes at one moment.

use super::accessor::Accessor;
use super::animation::{Animation, Channel, Interpolation, Sampler};
use super::choice::Choice;
use super::document::{clip, malformed};
use super::extensions;
use super::warnings::Warnings;
use crate::scene::SceneError;
use glam::{DQuat, DVec3, DVec4};
use gltf::json::Root;
use gltf::json::accessor::{ComponentType, Type};
use std::collections::{HashMap, HashSet};

/// Most keys of an animation, each list of times counted once: all of them are looked at.
const MAX_KEYS: u64 = 16 << 20;

/// Most weights of morph targets that an animation may move, over all nodes.
const MAX_WEIGHTS: usize = 4 << 20;

/// Least length of a quaternion that still tells a rotation.
const MIN_ROTATION: f64 = 1e-6;

/// What is moved of a node; all else stays as the file has it.
#[derive(Default)]
pub(super) struct NodePose {
    /// Where it is.
    pub translation: Option<DVec3>,
    /// How it is turned; of length 1.
    pub rotation: Option<DQuat>,
    /// How it is scaled.
    pub scale: Option<DVec3>,
    /// How much of each morph target of its mesh is added.
    pub weights: Option<Vec<f32>>,
}

/// What is moved, by node; nothing where the file is shown at rest.
#[derive(Default)]
pub(super) struct Pose {
    nodes: HashMap<usize, NodePose>,
}

impl Pose {
    /// What is moved of a node.
    pub fn of(&self, node: usize) -> Option<&NodePose> {
        self.nodes.get(&node)
    }
}

/// The file that an animation is of.
#[derive(Clone, Copy)]
pub(super) struct Posed<'a> {
    /// The file.
    pub root: &'a Root,
    /// Its accessors.
    pub accessors: &'a [Accessor<'a>],
    /// Its animations.
    pub animations: &'a [Animation],
}

impl Posed<'_> {
    /// The pose of the chosen animation at `time`, seconds; of none at rest.
    pub fn chosen(
        &self,
        choice: Option<&Choice>,
        time: f64,
        warnings: &mut Warnings,
    ) -> Result<Pose, SceneError> {
        let names: Vec<_> = self.animations.iter().map(|one| one.name.as_deref()).collect();
        let Some(choice) = choice else {
            if !names.is_empty() {
                let what = format!(
                    "the file is shown at rest; `animation` and `time` choose one of its {} by name or index, and a moment of it",
                    names.len()
                );
                warnings.push("animations", what);
            }
            return Ok(Pose::default());
        };
        self.at(choice.find("animations", "animation", &names)?, time, warnings)
    }

    /// The pose at `time`, seconds, of the animation of that index.
    fn at(&self, index: usize, time: f64, warnings: &mut Warnings) -> Result<Pose, SceneError> {
        if !(time.is_finite() && time >= 0.0) {
            return Err(SceneError::malformed(
                "time",
                format!("{time} seconds is no moment of an animation"),
                "choose a finite time that is not negative",
            ));
        }
        let animation = &self.animations[index];
        let at = format!("animations[{index}]");
        self.check_times(animation, &at)?;
        let mut pose = Pose::default();
        let (mut moved, mut weights) = (HashSet::new(), 0);
        for (place, channel) in animation.channels.iter().enumerate() {
            let at = format!("{at}.channels[{place}].target");
            let Some(node) = channel.target.node.filter(|_| channel.target.path != "pointer")
            else {
                warn_of_pointer(&at, &channel.target.path, warnings);
                continue;
            };
            if !moved.insert((node, channel.target.path.as_str())) {
                let what = "names a property that the animation moves already; the last one holds";
                warnings.push(&at, what);
            }
            if channel.target.path == "weights" {
                weights += self.targets(node);
            }
            if weights > MAX_WEIGHTS {
                return Err(SceneError::too_large(
                    at,
                    format!("more than {MAX_WEIGHTS} weights of morph targets are moved"),
                    "animate fewer meshes or fewer of their morph targets",
                ));
            }
            let track = self.track(animation, [index, place], node)?;
            let Some(track) = track else {
                let what = "the node has no mesh with morph targets; the channel moves nothing";
                warnings.push(at, what);
                continue;
            };
            self.check_node(node, &at)?;
            track.set(channel, time, pose.nodes.entry(node).or_default())?;
        }
        Ok(pose)
    }

    /// Refuses times that do not ascend, and more of them than are allowed.
    fn check_times(&self, animation: &Animation, at: &str) -> Result<(), SceneError> {
        let used: HashSet<usize> = animation.channels.iter().map(|c| c.sampler).collect();
        let mut checked = HashSet::new();
        let mut keys = 0;
        for (place, sampler) in animation.samplers.iter().enumerate() {
            if !used.contains(&place) || !checked.insert(sampler.input) {
                continue;
            }
            let at = format!("{at}.samplers[{place}].input");
            let times = &self.accessors[sampler.input];
            if times.kind != Type::Scalar || times.component != ComponentType::F32 {
                let what = format!(
                    "{} is {:?} of {:?}; times are Scalar of F32",
                    times.at, times.kind, times.component
                );
                return Err(malformed(at, what));
            }
            keys += times.count as u64;
            if keys > MAX_KEYS {
                return Err(SceneError::too_large(
                    at,
                    format!("more than {MAX_KEYS} keys in the animation"),
                    "export the animation with fewer keys",
                ));
            }
            check_ascending(times)?;
        }
        Ok(())
    }

    /// Number of morph targets of a node's mesh.
    fn targets(&self, node: usize) -> usize {
        let mesh = self.root.nodes[node].mesh.map(|mesh| &self.root.meshes[mesh.value()]);
        let primitive = mesh.and_then(|mesh| mesh.primitives.first());
        primitive.and_then(|primitive| primitive.targets.as_ref()).map_or(0, Vec::len)
    }

    /// The keys of a channel, checked; `None` where its node has no morph targets to weigh.
    fn track(
        &self,
        animation: &Animation,
        [index, place]: [usize; 2],
        node: usize,
    ) -> Result<Option<Track<'_>>, SceneError> {
        let channel = &animation.channels[place];
        let sampler: &Sampler = &animation.samplers[channel.sampler];
        let (kind, width) = match channel.target.path.as_str() {
            "translation" | "scale" => (Type::Vec3, 1),
            "rotation" => (Type::Vec4, 1),
            "weights" => match self.targets(node) {
                0 => return Ok(None),
                targets => (Type::Scalar, targets),
            },
            path => {
                return Err(malformed(
                    format!("animations[{index}].channels[{place}].target.path"),
                    format!("{:?} is not a property that glTF 2.0 animates", clip(path)),
                ));
            }
        };
        let at = format!("animations[{index}].samplers[{}].output", channel.sampler);
        let (times, values) = (&self.accessors[sampler.input], &self.accessors[sampler.output]);
        if values.kind != kind || values.component == ComponentType::U32 {
            let what = format!(
                "{} is {:?} of {:?}; the {} of a node is {kind:?}",
                values.at, values.kind, values.component, channel.target.path
            );
            return Err(malformed(at, what));
        }
        let parts = if sampler.interpolation == Interpolation::Cubic { 3 } else { 1 };
        let needed = times.count.saturating_mul(parts).saturating_mul(width);
        if values.count != needed {
            let (count, keys) = (values.count, times.count);
            let what = format!("has {count} elements; {keys} keys need {needed}");
            return Err(malformed(at, what));
        }
        Ok(Some(Track { times, values, interpolation: sampler.interpolation, width }))
    }

    /// Refuses a node with a matrix: the format allows those to be animated whose transform is in
    /// parts.
    fn check_node(&self, node: usize, at: &str) -> Result<(), SceneError> {
        if self.root.nodes[node].matrix.is_none() {
            return Ok(());
        }
        let what = format!("node {node} has a matrix, which cannot be animated");
        Err(malformed(format!("{at}.node"), what))
    }
}

fn warn_of_pointer(at: &str, path: &str, warnings: &mut Warnings) {
    let what = if path == "pointer" {
        extensions::loss("KHR_animation_pointer")
    } else {
        "names no node; the channel moves nothing"
    };
    warnings.push(at, what);
}

fn check_ascending(times: &Accessor<'_>) -> Result<(), SceneError> {
    let mut before = f32::NEG_INFINITY;
    for key in 0..times.count {
        let time = times.element(key)[0];
        if !(time.is_finite() && time >= 0.0) {
            let what = format!("key {key} is at {time} seconds, which is no moment");
            return Err(malformed(&times.at, what));
        }
        if time <= before {
            let what = format!("key {key} is at {time} s, not after the one before at {before} s");
            return Err(malformed(&times.at, what));
        }
        before = time;
    }
    Ok(())
}

/// A moment among keys.
enum Moment {
    /// At a key, or before the first or after the last.
    Key(usize),
    /// Between a key and the next.
    Between {
        /// The key before.
        from: usize,
        /// How much of the way to the next one is gone, in (0, 1).
        share: f64,
        /// Seconds from key to key.
        span: f64,
    },
}

impl Moment {
    /// That of `time` among ascending times.
    fn of(time: f64, times: &Accessor<'_>) -> Self {
        let key = |place: usize| f64::from(times.element(place)[0]);
        let (mut low, mut high) = (0, times.count);
        while low < high {
            let middle = low + (high - low) / 2;
            if key(middle) <= time { low = middle + 1 } else { high = middle }
        }
        // Now `low` keys are not after the moment.
        if low == 0 || low == times.count {
            return Self::Key(low.saturating_sub(1));
        }
        let from = low - 1;
        let span = key(low) - key(from);
        let share = (time - key(from)) / span;
        if share > 0.0 { Self::Between { from, share, span } } else { Self::Key(from) }
    }
}

/// The keys of a channel.
struct Track<'a> {
    times: &'a Accessor<'a>,
    values: &'a Accessor<'a>,
    interpolation: Interpolation,
    /// Values of a key: the number of morph targets, 1 for all else.
    width: usize,
}

/// Which of a cubic key's three parts; other keys have the value alone.
#[derive(Clone, Copy)]
enum Part {
    InTangent,
    Value,
    OutTangent,
}

impl Track<'_> {
    /// Moves the channel's property.
    fn set(&self, channel: &Channel, time: f64, pose: &mut NodePose) -> Result<(), SceneError> {
        let moment = Moment::of(time, self.times);
        match channel.target.path.as_str() {
            "translation" => pose.translation = Some(self.value(&moment, 0)?.truncate()),
            "scale" => pose.scale = Some(self.value(&moment, 0)?.truncate()),
            "rotation" => pose.rotation = Some(self.rotation(&moment)?),
            _ => {
                let weights =
                    (0..self.width).map(|target| Ok(self.value(&moment, target)?.x as f32));
                pose.weights = Some(weights.collect::<Result<_, SceneError>>()?);
            }
        }
        Ok(())
    }

    /// A part of a key; `place` counts the values of a key.
    fn part(&self, key: usize, part: Part, place: usize) -> Result<DVec4, SceneError> {
        let row = match self.interpolation {
            Interpolation::Cubic => 3 * key + part as usize,
            _ => key,
        };
        let element = row * self.width + place;
        let value = self.values.element(element);
        if value.iter().all(|component| component.is_finite()) {
            return Ok(DVec4::from_array(value.map(f64::from)));
        }
        Err(malformed(&self.values.at, format!("element {element} is not finite")))
    }

    fn value(&self, moment: &Moment, place: usize) -> Result<DVec4, SceneError> {
        let value = |key| self.part(key, Part::Value, place);
        let (from, share, span) = match *moment {
            Moment::Key(key) => return value(key),
            Moment::Between { from, share, span } => (from, share, span),
        };
        match self.interpolation {
            Interpolation::Step => value(from),
            Interpolation::Linear => Ok(value(from)?.lerp(value(from + 1)?, share)),
            Interpolation::Cubic => {
                let leaving = span * self.part(from, Part::OutTangent, place)?;
                let arriving = span * self.part(from + 1, Part::InTangent, place)?;
                Ok(hermite([value(from)?, value(from + 1)?], [leaving, arriving], share))
            }
        }
    }

    fn rotation(&self, moment: &Moment) -> Result<DQuat, SceneError> {
        let unit = |value: DVec4, key: usize| {
            let length = value.length();
            if length > MIN_ROTATION && length.is_finite() {
                return Ok(DQuat::from_vec4(value / length));
            }
            let what = format!("key {key} is not a rotation: its length is 0 or not finite");
            Err(malformed(&self.values.at, what))
        };
        if let (Moment::Between { from, share, .. }, Interpolation::Linear) =
            (moment, self.interpolation)
        {
            let end = |key| unit(self.part(key, Part::Value, 0)?, key);
            return Ok(slerp(end(*from)?, end(from + 1)?, *share));
        }
        let (Moment::Key(key) | Moment::Between { from: key, .. }) = moment;
        unit(self.value(moment, 0)?, *key)
    }
}

/// On the shortest arc between two rotations.
fn slerp(from: DQuat, to: DQuat, share: f64) -> DQuat {
    let cosine = from.dot(to);
    // The negative quaternion is the same rotation; one of the two is nearer.
    let (to, cosine) = if cosine < 0.0 { (-to, -cosine) } else { (to, cosine) };
    let angle = cosine.min(1.0).acos();
    if angle < 1e-4 {
        // The arc is a straight line to eight digits.
        return from.lerp(to, share).normalize();
    }
    let weight = |part: f64| (part * angle).sin() / angle.sin();
    (from * weight(1.0 - share) + to * weight(share)).normalize()
}

/// On the cubic with these values and slopes at 0 and 1.
fn hermite(values: [DVec4; 2], slopes: [DVec4; 2], t: f64) -> DVec4 {
    let (square, cube) = (t * t, t * t * t);
    (2.0 * cube - 3.0 * square + 1.0) * values[0]
        + (cube - 2.0 * square + t) * slopes[0]
        + (3.0 * square - 2.0 * cube) * values[1]
        + (cube - square) * slopes[1]
}
