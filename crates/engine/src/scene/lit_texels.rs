//! Where emissive textures are black, by blocks of texels, so that no sample is taken there.

use super::{Scene, Texture, TextureSlot};
use glam::Vec2;
use std::collections::HashMap;

/// Texels along a side of a block.
const BLOCK: u32 = 8;

/// Blocks of texels in or beside which a texel is not black.
struct LitBlocks {
    /// Blocks in a row.
    across: u32,
    lit: Vec<bool>,
    /// Whether there is any.
    any: bool,
}

/// Of all textures that say what a surface emits, where they are not black.
pub struct LitTexels {
    of: HashMap<u32, LitBlocks>,
}

impl LitTexels {
    /// Looks through the textures of a scene's emissive materials.
    pub fn new(scene: &Scene) -> Self {
        let mut of = HashMap::new();
        for material in scene.materials.iter().filter(|material| material.emits()) {
            if let Some(slot) = &material.emission_texture {
                of.entry(slot.texture)
                    .or_insert_with(|| LitBlocks::new(&scene.textures[slot.texture as usize]));
            }
        }
        Self { of }
    }

    /// Whether a texture may be anything but black in the box of some coordinates of the mesh.
    pub fn may_shine(&self, scene: &Scene, slot: &TextureSlot, corners: [Vec2; 3]) -> bool {
        let Some(blocks) = self.of.get(&slot.texture) else { return true };
        let texture = &scene.textures[slot.texture as usize];
        let size = Vec2::new(texture.width as f32, texture.height as f32);
        let places = corners.map(|corner| slot.transformed(corner) * size);
        let low = places.iter().copied().fold(Vec2::INFINITY, Vec2::min) - 1.0;
        let high = places.iter().copied().fold(Vec2::NEG_INFINITY, Vec2::max) + 1.0;
        let extent = high - low;
        if !(extent.x < size.x && extent.y < size.y) {
            return blocks.any;
        }
        let steps = (extent / BLOCK as f32).ceil().as_uvec2();
        let texel = |axis: usize, step: u32, size: u32| {
            let at = (low[axis] + (step * BLOCK) as f32).min(high[axis]).floor() as i64;
            slot.wrap[axis].texel(at, i64::from(size)) as u32
        };
        (0..=steps.y).any(|row| {
            let y = texel(1, row, texture.height);
            (0..=steps.x).any(|column| {
                let x = texel(0, column, texture.width);
                blocks.lit[(y / BLOCK * blocks.across + x / BLOCK) as usize]
            })
        })
    }
}

impl LitBlocks {
    fn new(texture: &Texture) -> Self {
        let [across, down] = [texture.width, texture.height].map(|side| side.div_ceil(BLOCK));
        let mut own = vec![false; (across * down) as usize];
        for (y, row) in texture.texels.chunks_exact(texture.width as usize).enumerate() {
            let first = (y as u32 / BLOCK * across) as usize;
            for (block, texels) in row.chunks(BLOCK as usize).enumerate() {
                own[first + block] |= texels.iter().any(|texel| texel[..3] != [0; 3]);
            }
        }
        // Their neighbours too: values between texels are mixed with those beside, and a block at
        // the rim may be narrower than the steps in which a box is looked through.
        let any = own.iter().any(|lit| *lit);
        let lit = (0..across * down)
            .map(|at| {
                let (x, y) = (at % across, at / across);
                let around = |at: u32, all: u32| [(at + all - 1) % all, at, (at + 1) % all];
                any && around(y, down)
                    .into_iter()
                    .any(|y| around(x, across).into_iter().any(|x| own[(y * across + x) as usize]))
            })
            .collect();
        Self { across, lit, any }
    }
}
