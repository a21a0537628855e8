//! Skins: vertices that follow joints, which are nodes, instead of the node of their mesh.

use super::accessor::Accessor;
use super::document::malformed;
use super::node::Instance;
use crate::scene::SceneError;
use glam::{DMat4, DVec4};
use gltf::json::Root;
use gltf::json::accessor::{ComponentType, Type};

/// Most joints of all skins together.
const MAX_JOINTS: usize = 1 << 18;

/// How far the weights of a vertex may be from 1 in sum before it is warned of: what rounding
/// to bytes may lose.
const WEIGHT_TOLERANCE: f64 = 0.02;

/// By skin, what takes a vertex of the bind pose with each of its joints to the world; empty for
/// skins that no instance has.
pub(super) fn matrices(
    root: &Root,
    accessors: &[Accessor<'_>],
    worlds: &[DMat4],
    instances: &[Instance],
) -> Result<Vec<Vec<DMat4>>, SceneError> {
    let joints: usize = root.skins.iter().map(|skin| skin.joints.len()).sum();
    if joints > MAX_JOINTS {
        return Err(SceneError::too_large(
            "skins",
            format!("{joints} joints in all; {MAX_JOINTS} are allowed"),
            "export fewer skins, or skins with fewer joints",
        ));
    }
    let mut is_used = vec![false; root.skins.len()];
    for skin in instances.iter().filter_map(|instance| instance.skin) {
        is_used[skin] = true;
    }
    let skins = root.skins.iter().zip(is_used).enumerate();
    skins
        .map(|(index, (skin, is_used))| {
            if !is_used {
                return Ok(Vec::new());
            }
            let at = format!("skins[{index}]");
            if skin.joints.is_empty() {
                return Err(malformed(format!("{at}.joints"), "is empty"));
            }
            let inverse = skin.inverse_bind_matrices.map(|index| &accessors[index.value()]);
            if let Some(accessor) = inverse {
                check_inverse(accessor, &at, skin.joints.len())?;
            }
            let joints = skin.joints.iter().enumerate();
            joints
                .map(|(place, joint)| Ok(worlds[joint.value()] * inverse_bind(inverse, place)?))
                .collect()
        })
        .collect()
}

fn check_inverse(accessor: &Accessor<'_>, at: &str, joints: usize) -> Result<(), SceneError> {
    let at = format!("{at}.inverseBindMatrices");
    if accessor.kind != Type::Mat4 || accessor.component != ComponentType::F32 {
        let (kind, component) = (accessor.kind, accessor.component);
        let what = format!("{} is {kind:?} of {component:?}; it must be Mat4 of F32", accessor.at);
        return Err(malformed(at, what));
    }
    if accessor.count < joints {
        let what = format!("has {} matrices for {joints} joints", accessor.count);
        return Err(malformed(at, what));
    }
    Ok(())
}

/// What takes a vertex to where a joint sees it; the identity where the file does not say.
fn inverse_bind(accessor: Option<&Accessor<'_>>, joint: usize) -> Result<DMat4, SceneError> {
    let Some(accessor) = accessor else { return Ok(DMat4::IDENTITY) };
    let mut matrix = DMat4::from_cols_array(&accessor.matrix(joint).map(f64::from));
    if !matrix.is_finite() || !matrix.row(3).abs_diff_eq(DVec4::W, 1e-3) {
        let what = format!("matrix {joint} is not finite or not affine: its last row is 0 0 0 1");
        return Err(malformed(&accessor.at, what));
    }
    for (column, last) in [(0, 0.0), (1, 0.0), (2, 0.0), (3, 1.0)] {
        matrix.col_mut(column).w = last;
    }
    Ok(matrix)
}

/// What the vertices of a primitive follow.
pub(super) struct Bones<'a> {
    /// Of the skin, by joint.
    pub matrices: &'a [DMat4],
    /// Accessors of joints and of their weights, set by set.
    pub sets: &'a [(usize, usize)],
    /// The file's accessors.
    pub accessors: &'a [Accessor<'a>],
}

/// Vertices whose weights are not as the format wants them.
#[derive(Clone, Copy, Default)]
pub(super) struct OddWeights {
    /// Their sum is not 1.
    pub not_one: usize,
    /// Their sum is 0.
    pub zero: usize,
}

impl Bones<'_> {
    /// What takes a vertex to the world: the mean of its joints' matrices by their weights.
    pub fn matrix(&self, vertex: usize, odd: &mut OddWeights) -> Result<DMat4, SceneError> {
        let (mut sum, mut total) = (DMat4::ZERO, 0.0);
        for (joints, weights) in self.sets {
            let (joints, weights) = (&self.accessors[*joints], &self.accessors[*weights]);
            for (joint, weight) in joints.element(vertex).into_iter().zip(weights.element(vertex)) {
                if !(weight.is_finite() && weight >= 0.0) {
                    let what = format!("vertex {vertex} has the weight {weight}");
                    return Err(malformed(&weights.at, what));
                }
                // A joint without weight may be anything.
                if weight > 0.0 {
                    sum += self.joint(joints, joint, vertex)? * f64::from(weight);
                    total += f64::from(weight);
                }
            }
        }
        if total > 0.0 {
            odd.not_one += usize::from((total - 1.0).abs() > WEIGHT_TOLERANCE);
            return Ok(sum * total.recip());
        }
        odd.zero += 1;
        match self.sets.first() {
            Some((joints, _)) => {
                let joints = &self.accessors[*joints];
                self.joint(joints, joints.element(vertex)[0], vertex)
            }
            None => Ok(DMat4::IDENTITY),
        }
    }

    fn joint(&self, at: &Accessor<'_>, joint: f32, vertex: usize) -> Result<DMat4, SceneError> {
        // Joints are unsigned integers of at most 16 bits; a normalised one is a fraction.
        let index = Some(joint as usize).filter(|_| joint.fract() == 0.0);
        index.and_then(|index| self.matrices.get(index)).copied().ok_or_else(|| {
            let count = self.matrices.len();
            malformed(&at.at, format!("vertex {vertex} follows joint {joint} of {count}"))
        })
    }
}
