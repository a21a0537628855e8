//! Small files that become very large once they are read.

use crate::malformed::triangle;
use hemilux_engine::scene::made::assemble;
use serde_json::json;

/// Side of each picture of [`textures`], texels: as large as one texture may be.
const SIDE: u32 = 8192;

/// A scene of `count` pictures of 64 M texels each, all of them used; the file has some hundred
/// kilobytes.
pub fn textures(count: usize) -> Vec<u8> {
    let mut picture = std::io::Cursor::new(Vec::new());
    let (kind, format) = (image::ExtendedColorType::L8, image::ImageFormat::Png);
    let black = vec![0; (SIDE * SIDE) as usize];
    image::write_buffer_with_format(&mut picture, &black, SIDE, SIDE, kind, format)
        .expect("a picture can be written to memory");
    let (mut root, mut binary) = triangle();
    binary.truncate(68);
    binary.extend_from_slice(picture.get_ref());
    root["bufferViews"][3]["byteLength"] = json!(picture.get_ref().len());
    root["buffers"][0]["byteLength"] = json!(binary.len());
    let repeated = |of: &dyn Fn(usize) -> serde_json::Value| (0..count).map(of).collect::<Vec<_>>();
    root["images"] = repeated(&|_| json!({ "bufferView": 3, "mimeType": "image/png" })).into();
    root["textures"] = repeated(&|image| json!({ "source": image })).into();
    root["materials"] = repeated(
        &|texture| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } }),
    )
    .into();
    assemble(&root, &binary)
}

/// A `.gltf` file that is nested `depth` times.
pub fn nesting(depth: usize) -> Vec<u8> {
    let (open, close) = ("[".repeat(depth), "]".repeat(depth));
    format!(r#"{{"asset":{{"version":"2.0"}},"extras":{open}{close}}}"#).into_bytes()
}

/// A `.gltf` file with a list of `bytes` bytes, each entry of which takes much more once read.
pub fn list(bytes: usize) -> Vec<u8> {
    let entries = "{},".repeat(bytes / 3);
    format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{entries}{{}}]}}"#).into_bytes()
}
