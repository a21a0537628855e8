//! A small GLB writer: meshes, materials with the extensions that the engine reads, cameras and
//! embedded textures.

use super::mesh::Mesh;
use crate::scene::{Alpha, Camera, LightKind, Material, Model, Projection, PunctualLight};
use glam::{Mat4, Quat, Vec3};
use serde_json::{Map, Value, json};

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// A scene on its way into a GLB file.
#[derive(Default)]
pub(super) struct GlbWriter {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    materials: Vec<Value>,
    cameras: Vec<Value>,
    images: Vec<Value>,
    lights: Vec<Value>,
    extensions: Vec<&'static str>,
}

/// Embedded textures of a material, by their numbers in the file.
#[derive(Clone, Copy, Default)]
pub(super) struct Maps {
    /// Multiplies base colour and opacity.
    pub color: Option<usize>,
    /// Multiplies the emission.
    pub emission: Option<usize>,
}

/// A number in its shortest decimal form, so that 0.73 does not become 0.730000019.
fn number(x: f32) -> Value {
    json!(x.to_string().parse::<f64>().unwrap_or_default())
}

fn numbers(values: &[f32]) -> Value {
    values.iter().copied().map(number).collect()
}

impl GlbWriter {
    /// Adds a material; its texture slots are not written, see [`GlbWriter::mapped`].
    pub fn material(&mut self, material: &Material) -> usize {
        self.mapped(material, Maps::default())
    }

    /// Adds a material whose base colour is multiplied by an embedded PNG.
    pub fn textured(&mut self, material: &Material, png: &[u8]) -> usize {
        let color = Some(self.texture(png));
        self.mapped(material, Maps { color, ..Maps::default() })
    }

    /// Adds a material whose emission is multiplied by an embedded PNG.
    pub fn shining(&mut self, material: &Material, png: &[u8]) -> usize {
        let emission = Some(self.texture(png));
        self.mapped(material, Maps { emission, ..Maps::default() })
    }

    /// Embeds a PNG as a texture: its number.
    pub fn texture(&mut self, png: &[u8]) -> usize {
        let view = self.view(png, None);
        self.images.push(json!({ "bufferView": view, "mimeType": "image/png" }));
        self.images.len() - 1
    }

    /// Adds a material with textures of the file.
    pub fn mapped(&mut self, material: &Material, maps: Maps) -> usize {
        let [r, g, b] = material.base_color.to_array();
        let mut surface = json!({
            "baseColorFactor": numbers(&[r, g, b, material.opacity]),
            "metallicFactor": number(material.metallic),
            "roughnessFactor": number(material.roughness),
        });
        if let Some(texture) = maps.color {
            surface["baseColorTexture"] = json!({ "index": texture });
        }
        let mut extensions = self.reflection_extensions(material);
        let mut value = json!({ "name": material.name, "pbrMetallicRoughness": surface });
        if material.emits() {
            let strength = material.emission.max_element().max(1.0);
            value["emissiveFactor"] = numbers(&(material.emission / strength).to_array());
            if let Some(texture) = maps.emission {
                value["emissiveTexture"] = json!({ "index": texture });
            }
            if strength > 1.0 {
                extensions.insert(
                    self.uses("KHR_materials_emissive_strength"),
                    json!({ "emissiveStrength": number(strength) }),
                );
            }
        }
        if material.double_sided {
            value["doubleSided"] = json!(true);
        }
        match material.alpha {
            Alpha::Opaque => {}
            Alpha::Mask { cutoff } => {
                value["alphaMode"] = json!("MASK");
                value["alphaCutoff"] = number(cutoff);
            }
            Alpha::Blend => value["alphaMode"] = json!("BLEND"),
        }
        if material.model == Model::Phong {
            value["extras"] = json!({ "phong": true });
        }
        if !extensions.is_empty() {
            value["extensions"] = Value::Object(extensions);
        }
        self.materials.push(value);
        self.materials.len() - 1
    }

    /// What a material says of reflection and transmission by extensions.
    fn reflection_extensions(&mut self, material: &Material) -> Map<String, Value> {
        let mut extensions = Map::new();
        if material.specular_factor != 1.0 || material.specular_color != Vec3::ONE {
            let specular = json!({
                "specularFactor": number(material.specular_factor),
                "specularColorFactor": numbers(&material.specular_color.to_array()),
            });
            extensions.insert(self.uses("KHR_materials_specular"), specular);
        }
        if material.ior != 1.5 {
            extensions
                .insert(self.uses("KHR_materials_ior"), json!({ "ior": number(material.ior) }));
        }
        if material.transmission > 0.0 {
            let share = json!({ "transmissionFactor": number(material.transmission) });
            extensions.insert(self.uses("KHR_materials_transmission"), share);
        }
        if let Some(volume) = material.volume {
            let tint = numbers(&volume.attenuation_color.to_array());
            let mut value = json!({ "thicknessFactor": 1.0, "attenuationColor": tint });
            if volume.attenuation_distance.is_finite() {
                value["attenuationDistance"] = number(volume.attenuation_distance);
            }
            extensions.insert(self.uses("KHR_materials_volume"), value);
        }
        extensions
    }

    fn uses(&mut self, extension: &'static str) -> String {
        if !self.extensions.contains(&extension) {
            self.extensions.push(extension);
        }
        extension.into()
    }

    /// Adds a mesh of one material, standing where its coordinates say.
    pub fn body(&mut self, name: &str, mesh: &Mesh, material: usize) {
        let flat: Vec<f32> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
        let position = self.floats(&flat, 3, "VEC3");
        let low = mesh.positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = mesh.positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        self.accessors[position]["min"] = numbers(&low.to_array());
        self.accessors[position]["max"] = numbers(&high.to_array());
        let mut attributes = json!({ "POSITION": position });
        if !mesh.normals.is_empty() {
            let flat: Vec<f32> = mesh.normals.iter().flat_map(|n| n.to_array()).collect();
            attributes["NORMAL"] = json!(self.floats(&flat, 3, "VEC3"));
        }
        if !mesh.uvs.is_empty() {
            let flat: Vec<f32> = mesh.uvs.iter().flat_map(|uv| uv.to_array()).collect();
            attributes["TEXCOORD_0"] = json!(self.floats(&flat, 2, "VEC2"));
        }
        let indices = self.indices(mesh);
        let primitive =
            json!({ "attributes": attributes, "indices": indices, "material": material });
        self.meshes.push(json!({ "name": name, "primitives": [primitive] }));
        self.nodes.push(json!({ "name": name, "mesh": self.meshes.len() - 1 }));
    }

    /// Adds a camera.
    pub fn camera(&mut self, camera: &Camera) {
        self.cameras.push(match camera.projection {
            Projection::Perspective { yfov } => json!({
                "type": "perspective",
                "perspective": { "yfov": number(yfov), "znear": 0.01 },
            }),
            Projection::Orthographic { ymag } => json!({
                "type": "orthographic",
                "orthographic":
                    { "xmag": number(ymag), "ymag": number(ymag), "znear": 0.0, "zfar": 1000.0 },
            }),
        });
        self.nodes.push(json!({
            "name": camera.name,
            "camera": self.cameras.len() - 1,
            "matrix": numbers(&camera.to_world.to_cols_array()),
        }));
    }

    /// Adds a light without extent.
    pub fn light(&mut self, light: &PunctualLight) {
        let strength = light.intensity.max_element();
        let mut value = json!({
            "name": light.name,
            "intensity": number(strength),
            "color": numbers(&(light.intensity / strength.max(f32::MIN_POSITIVE)).to_array()),
        });
        match light.kind {
            LightKind::Point => value["type"] = json!("point"),
            LightKind::Directional => value["type"] = json!("directional"),
            LightKind::Spot { inner_cone, outer_cone } => {
                value["type"] = json!("spot");
                value["spot"] = json!({
                    "innerConeAngle": number(inner_cone), "outerConeAngle": number(outer_cone),
                });
            }
        }
        if let Some(range) = light.range {
            value["range"] = number(range);
        }
        self.lights.push(value);
        let extension = self.uses("KHR_lights_punctual");
        // A node's light shines along its −Z.
        let turn = Quat::from_rotation_arc(Vec3::NEG_Z, light.direction);
        let matrix = Mat4::from_rotation_translation(turn, light.position);
        self.nodes.push(json!({
            "name": light.name,
            "matrix": numbers(&matrix.to_cols_array()),
            "extensions": { extension: { "light": self.lights.len() - 1 } },
        }));
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    fn floats(&mut self, values: &[f32], width: usize, kind: &str) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        self.accessor(view, 5126, values.len() / width, kind)
    }

    fn indices(&mut self, mesh: &Mesh) -> usize {
        let flat = mesh.triangles.iter().flatten();
        // 65535 itself would mean primitive restart.
        let (bytes, component): (Vec<u8>, u32) = if mesh.positions.len() <= 65535 {
            (flat.flat_map(|index| (*index as u16).to_le_bytes()).collect(), 5123)
        } else {
            (flat.flat_map(|index| index.to_le_bytes()).collect(), 5125)
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        self.accessor(view, component, mesh.triangles.len() * 3, "SCALAR")
    }

    fn accessor(&mut self, view: usize, component: u32, count: usize, kind: &str) -> usize {
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "count": count, "type": kind,
        }));
        self.accessors.len() - 1
    }

    /// The file.
    pub fn finish(self) -> Vec<u8> {
        let nodes: Vec<usize> = (0..self.nodes.len()).collect();
        let textures: Vec<Value> =
            (0..self.images.len()).map(|image| json!({ "source": image })).collect();
        let mut root = Map::new();
        root.insert("asset".into(), json!({ "version": "2.0", "generator": "hemilux" }));
        root.insert("scene".into(), json!(0));
        root.insert("scenes".into(), json!([{ "nodes": nodes }]));
        root.insert("buffers".into(), json!([{ "byteLength": self.binary.len() }]));
        if !self.lights.is_empty() {
            let lights = json!({ "KHR_lights_punctual": { "lights": self.lights } });
            root.insert("extensions".into(), lights);
        }
        // The format does not allow empty lists.
        let lists = [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("cameras", self.cameras),
            ("images", self.images),
            ("textures", textures),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
            ("extensionsUsed", self.extensions.into_iter().map(Value::from).collect()),
        ];
        for (key, list) in lists {
            if !list.is_empty() {
                root.insert(key.into(), Value::Array(list));
            }
        }
        assemble(&Value::Object(root), &self.binary)
    }
}

/// A GLB file of a JSON root and a binary chunk.
pub fn assemble(root: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let padded = binary.len().next_multiple_of(4);
    let mut length = 12 + 8 + json.len();
    if padded > 0 {
        length += 8 + padded;
    }
    let mut out = Vec::with_capacity(length);
    out.extend_from_slice(b"glTF");
    out.extend_from_slice(&2u32.to_le_bytes());
    out.extend_from_slice(&(length as u32).to_le_bytes());
    out.extend_from_slice(&(json.len() as u32).to_le_bytes());
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&json);
    if padded > 0 {
        out.extend_from_slice(&(padded as u32).to_le_bytes());
        out.extend_from_slice(b"BIN\0");
        out.extend_from_slice(binary);
        out.resize(length, 0);
    }
    out
}
