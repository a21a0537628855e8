//! KHR_materials_variants: one file, several sets of materials.

use super::document::{clip, malformed};
use crate::scene::SceneError;
use gltf::json::Root;
use gltf::json::mesh::Primitive;

/// Most names that a message lists.
const MAX_LISTED: usize = 20;

/// Which materials a file's primitives get.
pub(super) struct Variants {
    /// How many variants the file has.
    count: usize,
    /// How many materials it has.
    materials: usize,
    /// The chosen one.
    chosen: Option<usize>,
}

impl Variants {
    /// The variants of a file, of which the one called `name` is chosen.
    pub fn new(root: &Root, name: Option<&str>) -> Result<Self, SceneError> {
        let extension =
            root.extensions.as_ref().and_then(|all| all.khr_materials_variants.as_ref());
        let variants = extension.map_or(&[][..], |extension| &extension.variants);
        let (count, materials) = (variants.len(), root.materials.len());
        let Some(name) = name else { return Ok(Self { count, materials, chosen: None }) };
        let chosen = variants.iter().position(|variant| variant.name == name);
        if chosen.is_some() {
            return Ok(Self { count, materials, chosen });
        }
        let mut names: Vec<_> =
            variants.iter().take(MAX_LISTED).map(|v| format!("{:?}", clip(&v.name))).collect();
        if variants.len() > MAX_LISTED {
            names.push("…".into());
        }
        let there = if names.is_empty() { "none".into() } else { names.join(", ") };
        Err(SceneError::malformed(
            "extensions.KHR_materials_variants",
            format!("the file has no variant {:?}; there are: {there}", clip(name)),
            "choose one of these, or none",
        ))
    }

    /// Names of all variants of a file, in its order.
    pub fn names(root: &Root) -> Vec<String> {
        let extension =
            root.extensions.as_ref().and_then(|all| all.khr_materials_variants.as_ref());
        let variants = extension.map_or(&[][..], |extension| &extension.variants);
        variants.iter().map(|variant| variant.name.clone()).collect()
    }

    /// The material of a primitive in the chosen variant; `None` where it names none.
    pub fn material(&self, object: &Primitive, at: &str) -> Result<Option<usize>, SceneError> {
        let mut material = object.material.map(|material| material.value());
        let extensions = object.extensions.as_ref();
        let mappings = extensions.and_then(|all| all.khr_materials_variants.as_ref());
        let mappings = mappings.map_or(&[][..], |extension| &extension.mappings);
        for (place, mapping) in mappings.iter().enumerate() {
            let at = || format!("{at}.extensions.KHR_materials_variants.mappings[{place}]");
            let (own, count) = (mapping.material as usize, self.materials);
            if own >= count {
                let what = format!("{own}, but there are {count} materials");
                return Err(malformed(format!("{}.material", at()), what));
            }
            let count = self.count;
            if let Some(beyond) = mapping.variants.iter().find(|of| **of as usize >= count) {
                let what = format!("{beyond}, but there are {count} variants");
                return Err(malformed(format!("{}.variants", at()), what));
            }
            if mapping.variants.iter().any(|of| Some(*of as usize) == self.chosen) {
                material = Some(own);
            }
        }
        Ok(material)
    }
}
