//! A lit scene as a glTF file: the light of the surfaces as vertex colours, for viewers that know
//! nothing of light.

use crate::radiometry::Rgb;
use crate::scene::made::assemble;
use glam::Vec3;
use serde_json::json;

/// Triangles with the radiance that their vertices send.
#[derive(Clone, Debug, Default)]
pub struct BakedMesh {
    /// World positions, metres.
    pub positions: Vec<Vec3>,
    /// Radiance, W/(m²·sr) times the emission unit of the file, one a position.
    pub radiance: Vec<Rgb>,
    /// Three a triangle, counter-clockwise seen from the side that sends it.
    pub indices: Vec<u32>,
    /// Most radiance of anything that does not emit by itself.
    pub brightest: f32,
}

impl BakedMesh {
    /// Bytes of the file, nearly.
    pub fn size(&self) -> u64 {
        24 * self.positions.len() as u64 + 4 * self.indices.len() as u64 + 2048
    }

    /// A GLB file of one unlit mesh. Vertex colours are linear floats in [0, 1] as the format
    /// wants them: radiance over `extras.radiance_of_white` of the asset, what is brighter (the
    /// emitters) cut off.
    pub fn to_glb(&self) -> Vec<u8> {
        let white = if self.brightest > 0.0 { self.brightest } else { 1.0 };
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for position in &self.positions {
            (low, high) = (low.min(*position), high.max(*position));
        }
        let colors: Vec<Rgb> = (self.radiance.iter())
            .map(|radiance| (*radiance / white).clamp(Rgb::ZERO, Rgb::ONE))
            .collect();
        let mut binary = Vec::with_capacity(self.size() as usize);
        let mut views = Vec::new();
        let parts: [(&[u8], u32); 3] = [
            (bytemuck::cast_slice(&self.positions), 34_962),
            (bytemuck::cast_slice(&colors), 34_962),
            (bytemuck::cast_slice(&self.indices), 34_963),
        ];
        for (part, target) in parts {
            views.push(json!({
                "buffer": 0, "byteOffset": binary.len(), "byteLength": part.len(), "target": target,
            }));
            binary.extend_from_slice(part);
        }
        let mut root = json!({
            "asset": {
                "version": "2.0", "generator": "hemilux",
                "extras": { "radiance_of_white": white },
            },
            "scene": 0,
            "scenes": [{ "nodes": [] }],
        });
        // The format does not allow empty lists.
        if !self.indices.is_empty() {
            let count = self.positions.len();
            root["scenes"] = json!([{ "nodes": [0] }]);
            root["nodes"] = json!([{ "name": "baked light", "mesh": 0 }]);
            root["meshes"] = json!([{ "primitives": [{
                "attributes": { "POSITION": 0, "COLOR_0": 1 }, "indices": 2, "material": 0,
            }]}]);
            root["materials"] = json!([{
                "name": "baked light",
                "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
                "extensions": { "KHR_materials_unlit": {} },
            }]);
            root["extensionsUsed"] = json!(["KHR_materials_unlit"]);
            root["accessors"] = json!([
                { "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
                  "min": low.to_array(), "max": high.to_array() },
                { "bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3" },
                { "bufferView": 2, "componentType": 5125, "count": self.indices.len(),
                  "type": "SCALAR" },
            ]);
            root["bufferViews"] = json!(views);
            root["buffers"] = json!([{ "byteLength": binary.len() }]);
        }
        assemble(&root, &binary)
    }
}
