//! Images: PNG, JPEG, WebP and KTX2 to 8-bit RGBA, dimensions checked before decoding.

use super::container::{Buffers, missing, resolve};
use super::document::{clip, malformed};
use super::ktx2;
use super::limits::{ImportLimits, Resources};
use crate::scene::{SceneError, Texture};
use gltf::json::{Image, Root};
use image::{ImageFormat, ImageReader, Limits};
use std::collections::BTreeMap;
use std::io::Cursor;

/// What a sender can do about an image that cannot be read.
const FIX_IMAGE: &str = "embed a valid PNG, JPEG, WebP or Basis Universal KTX2 image";

/// What a sender can do about an image over a limit.
const FIX_SIZE: &str = "send smaller images";

/// Bytes that a decoder may hold for each texel: 16-bit RGBA, twice.
const DECODER_BYTES_PER_TEXEL: u64 = 16;

/// Decoder memory that every image gets, however small it is.
const DECODER_BASE_BYTES: u64 = 16 << 20;

/// The images of a file, decoded when they are first asked for.
pub(super) struct Images<'a> {
    objects: &'a [Image],
    buffers: &'a Buffers<'a>,
    resources: &'a Resources,
    limits: ImportLimits,
    texels: u64,
    /// By image: its place among `textures`.
    places: BTreeMap<usize, u32>,
    /// By texture: mean of the stored channels, 0…1, without decoding sRGB.
    means: BTreeMap<u32, [f32; 4]>,
    /// By image and the bits of the glossiness factor: the place of [`Images::roughness`].
    roughness: BTreeMap<(usize, u32), u32>,
    /// Textures for [`crate::scene::Scene::textures`].
    pub textures: Vec<Texture>,
}

impl<'a> Images<'a> {
    /// The images of a file; none is decoded yet.
    pub fn new(
        root: &'a Root,
        buffers: &'a Buffers<'a>,
        resources: &'a Resources,
        limits: &ImportLimits,
    ) -> Self {
        Self {
            objects: &root.images,
            buffers,
            resources,
            limits: *limits,
            texels: 0,
            places: BTreeMap::new(),
            means: BTreeMap::new(),
            roughness: BTreeMap::new(),
            textures: Vec::new(),
        }
    }

    /// Whether the file has the image.
    pub fn has(&self, image: usize) -> bool {
        image < self.objects.len()
    }

    /// What is missing where the image's file did not come with the scene.
    pub fn missing(&self, image: usize) -> Option<String> {
        missing(self.objects[image].uri.as_ref()?, self.resources)
    }

    /// The texture of an image, an index into [`Images::textures`].
    pub fn texture(&mut self, image: usize) -> Result<u32, SceneError> {
        if let Some(place) = self.places.get(&image) {
            return Ok(*place);
        }
        let texture = self.decode(image)?;
        let place = self.textures.len() as u32;
        self.textures.push(texture);
        self.places.insert(image, place);
        Ok(place)
    }

    /// Mean of each stored channel over a texture.
    pub fn mean(&mut self, texture: u32) -> [f32; 4] {
        let textures = &self.textures;
        *self.means.entry(texture).or_insert_with(|| stored_mean(&textures[texture as usize]))
    }

    /// Least stored alpha of a texture, 0…1.
    pub fn least_alpha(&self, texture: u32) -> f32 {
        let texels = &self.textures[texture as usize].texels;
        f32::from(texels.iter().map(|texel| texel[3]).min().unwrap_or(255)) / 255.0
    }

    /// The texture, made of an image whose alpha is glossiness, whose green is the roughness
    /// 1 − `glossiness`·alpha; its blue, the share of metal, is 0.
    pub fn roughness(&mut self, image: usize, glossiness: f32) -> Result<u32, SceneError> {
        let key = (image, glossiness.to_bits());
        if let Some(place) = self.roughness.get(&key) {
            return Ok(*place);
        }
        let source = self.texture(image)? as usize;
        let texels = self.textures[source].texels.len() as u64;
        if self.texels + texels > self.limits.max_total_texels {
            let what = "its glossiness needs a texture of its own, for which there is no room";
            return Err(SceneError::too_large(format!("images[{image}]"), what, FIX_SIZE));
        }
        self.texels += texels;
        let Texture { width, height, texels } = &self.textures[source];
        let rough = |texel: &[u8; 4]| {
            let code = 255.0 - glossiness * f32::from(texel[3]);
            [0, code.round().clamp(0.0, 255.0) as u8, 0, 255]
        };
        let texels = texels.iter().map(rough).collect();
        self.textures.push(Texture { width: *width, height: *height, texels });
        let place = self.textures.len() as u32 - 1;
        self.roughness.insert(key, place);
        Ok(place)
    }

    fn decode(&mut self, image: usize) -> Result<Texture, SceneError> {
        let object = &self.objects[image];
        let at = &format!("images[{image}]");
        let held;
        let bytes: &[u8] = match (&object.uri, object.buffer_view) {
            (Some(uri), _) => {
                held = resolve(uri, self.resources, &format!("{at}.uri"))?;
                &held
            }
            (None, Some(view)) => self.buffers.view(view).0,
            (None, None) => return Err(malformed(at, "has neither a uri nor a bufferView")),
        };
        if bytes.starts_with(&ktx2::MAGIC) {
            let refused = |what: String| SceneError::malformed(at, what, FIX_IMAGE);
            let (width, height) = ktx2::size(bytes).map_err(refused)?;
            self.texels += admitted(width, height, self.texels, &self.limits, at)?;
            let texels = ktx2::decode(bytes).map_err(refused)?;
            return Ok(Texture { width, height, texels });
        }
        let (texture, texels) = decode_by_image(bytes, self.texels, &self.limits, at)?;
        self.texels += texels;
        Ok(texture)
    }
}

/// The texels of an image of that size, where it may have so many beside the `others`.
fn admitted(
    width: u32,
    height: u32,
    others: u64,
    limits: &ImportLimits,
    at: &str,
) -> Result<u64, SceneError> {
    let texels = u64::from(width) * u64::from(height);
    if texels == 0 {
        return Err(SceneError::malformed(at, "has no texels", FIX_IMAGE));
    }
    let (one, total) = (limits.max_texture_texels, limits.max_total_texels);
    if texels > one || texels > total.saturating_sub(others) {
        return Err(SceneError::too_large(
            at,
            format!(
                "has {width} × {height} texels; {one} are allowed for one image, {total} for all"
            ),
            FIX_SIZE,
        ));
    }
    Ok(texels)
}

/// Decodes a PNG, JPEG or WebP; how many texels it has.
fn decode_by_image(
    bytes: &[u8],
    others: u64,
    limits: &ImportLimits,
    at: &str,
) -> Result<(Texture, u64), SceneError> {
    let refused = |what: String| SceneError::malformed(at, what, FIX_IMAGE);
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => format,
        _ => return Err(refused("is not a PNG, JPEG, WebP or KTX2 image".into())),
    };
    let broken = |error: image::ImageError| match error {
        image::ImageError::Limits(_) => {
            SceneError::too_large(at, "is too large to decode", FIX_SIZE)
        }
        error => refused(format!("cannot be decoded: {}", clip(&error.to_string()))),
    };
    let (width, height) =
        ImageReader::with_format(Cursor::new(bytes), format).into_dimensions().map_err(broken)?;
    let texels = admitted(width, height, others, limits, at)?;
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(width);
    limits.max_image_height = Some(height);
    limits.max_alloc = Some(texels * DECODER_BYTES_PER_TEXEL + DECODER_BASE_BYTES);
    reader.limits(limits);
    // Codecs are where foreign code reads foreign bytes: a panic there costs the upload, not the
    // process.
    let decoded = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| reader.decode()))
        .map_err(|_| refused("cannot be decoded: the decoder gave up".into()))?
        .map_err(broken)?
        .into_rgba8();
    let (width, height) = decoded.dimensions();
    Ok((Texture { width, height, texels: decoded.pixels().map(|pixel| pixel.0).collect() }, texels))
}

fn stored_mean(texture: &Texture) -> [f32; 4] {
    let mut sums = [0u64; 4];
    for texel in &texture.texels {
        for (sum, code) in sums.iter_mut().zip(texel) {
            *sum += u64::from(*code);
        }
    }
    sums.map(|sum| (sum as f64 / (255.0 * texture.texels.len() as f64)) as f32)
}
