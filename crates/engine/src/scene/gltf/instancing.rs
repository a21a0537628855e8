//! EXT_mesh_gpu_instancing: a node that shows its mesh many times.

use super::accessor::Accessor;
use super::document::{clip, malformed};
use super::warnings::Warnings;
use crate::scene::SceneError;
use glam::{DMat4, DQuat, DVec3};
use gltf::json::Root;
use gltf::json::accessor::{ComponentType, Type};
use serde_json::Value;

/// The extension's name in files.
const NAME: &str = "EXT_mesh_gpu_instancing";

/// How a node's copies of its mesh are placed, each before the node's own transform.
pub(super) struct Copies {
    /// How many there are.
    pub count: usize,
    translation: Option<usize>,
    rotation: Option<usize>,
    scale: Option<usize>,
}

impl Copies {
    /// Those of a node; `None` where it shows its mesh once.
    pub fn of_node(
        root: &Root,
        node: usize,
        accessors: &[Accessor<'_>],
        warnings: &mut Warnings,
    ) -> Result<Option<Self>, SceneError> {
        let extensions = root.nodes[node].extensions.as_ref();
        let Some(extension) = extensions.and_then(|all| all.others.get(NAME)) else {
            return Ok(None);
        };
        let at = format!("nodes[{node}].extensions.{NAME}.attributes");
        let attributes = extension.get("attributes").and_then(Value::as_object);
        let Some(attributes) = attributes.filter(|attributes| !attributes.is_empty()) else {
            return Err(malformed(at, "is missing or empty, so there is no number of instances"));
        };
        let mut copies = Self { count: 0, translation: None, rotation: None, scale: None };
        let mut first = None;
        for (name, value) in attributes {
            let at = format!("{at}.{}", clip(name));
            let index = value.as_u64().and_then(|index| usize::try_from(index).ok());
            let Some(index) = index.filter(|index| *index < accessors.len()) else {
                let what = format!(
                    "{}, but there are {} accessors",
                    clip(&value.to_string()),
                    accessors.len()
                );
                return Err(malformed(at, what));
            };
            let count = accessors[index].count;
            let expected = *first.get_or_insert(count);
            if count != expected {
                let what = format!("has {count} elements, but another attribute has {expected}");
                return Err(malformed(at, what));
            }
            match name.as_str() {
                "TRANSLATION" => {
                    copies.translation = Some(checked(index, at, accessors, Type::Vec3)?)
                }
                "ROTATION" => copies.rotation = Some(checked(index, at, accessors, Type::Vec4)?),
                "SCALE" => copies.scale = Some(checked(index, at, accessors, Type::Vec3)?),
                // Names that begin so are an application's own, such as ids.
                name if name.starts_with('_') && !name.starts_with("_COLOR") => {}
                _ => warnings.push(at, "is ignored; all instances look like the mesh"),
            }
        }
        copies.count = first.unwrap_or_default();
        Ok(Some(copies))
    }

    /// What places a copy.
    pub fn matrix(&self, copy: usize, accessors: &[Accessor<'_>]) -> Result<DMat4, SceneError> {
        let read = |index: Option<usize>, default: [f64; 4]| {
            let Some(accessor) = index.map(|index| &accessors[index]) else { return Ok(default) };
            let value = accessor.element(copy).map(f64::from);
            if value.iter().all(|component| component.is_finite()) {
                return Ok(value);
            }
            Err(malformed(&accessor.at, format!("element {copy} is not finite")))
        };
        let [x, y, z, _] = read(self.translation, [0.0; 4])?;
        let translation = DVec3::new(x, y, z);
        let [x, y, z, _] = read(self.scale, [1.0; 4])?;
        let scale = DVec3::new(x, y, z);
        let rotation = DQuat::from_array(read(self.rotation, [0.0, 0.0, 0.0, 1.0])?);
        let length = rotation.length();
        if let Some(accessor) = self.rotation.filter(|_| length <= 1e-6) {
            let what = format!("element {copy} is not a rotation: its length is 0");
            return Err(malformed(&accessors[accessor].at, what));
        }
        Ok(DMat4::from_scale_rotation_translation(scale, rotation / length, translation))
    }
}

fn checked(
    index: usize,
    at: String,
    accessors: &[Accessor<'_>],
    kind: Type,
) -> Result<usize, SceneError> {
    let accessor = &accessors[index];
    if accessor.kind == kind && accessor.component != ComponentType::U32 {
        return Ok(index);
    }
    Err(malformed(
        at,
        format!("{} is {:?} of {:?}", accessor.at, accessor.kind, accessor.component),
    ))
}
