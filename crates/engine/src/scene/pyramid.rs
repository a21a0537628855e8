//! Means of textures over parts of them: each texture with its halves, quarters and so on, to read
//! where a pixel covers many texels (Williams 1983, "Pyramidal parametrics"). Along the longer side
//! of the part more places are read (Feline: McCormack et al. 1999), so that a surface that is
//! seen at a grazing angle is not blurred across.
//!
//! All is averaged in linear light, colours by what is there of them: behind holes is no colour.

use super::texture::{Encoding, Texture, TextureSlot, floor};
use super::{Alpha, Material, Scene};
use glam::{DVec2, Vec2, Vec4};
use rayon::prelude::*;

/// Where a part is longer than this many widths, coarser texels are read, which blur the width too.
const MOST_PLACES: f32 = 8.0;
/// Texels from one place that is read to the next, at most: each is between texels on both sides of it,
/// so that one place is as wide as one texel and a half, and none is left out.
const SPACING: f32 = 1.25;
/// Bytes of a texel of the pyramid.
const STORED_BYTES: u64 = size_of::<[u16; 4]>() as u64;
/// Bytes of a texel before it is stored: as single rows, and as one list.
const SUMMED_BYTES: u64 = size_of::<Vec4>() as u64;

/// How much a texel counts in a mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weight {
    /// As much as any other.
    Even,
    /// By its alpha.
    Alpha,
    /// Fully from this code of alpha on, below not at all.
    FromCode(u16),
}

impl Weight {
    /// How much a texel counts in the mean colour of a material: as much as is there of it.
    pub(super) fn of(material: &Material) -> Self {
        match material.alpha {
            Alpha::Opaque => Self::Even,
            Alpha::Blend => Self::Alpha,
            Alpha::Mask { cutoff } => {
                let least = 255.0 * cutoff / material.opacity.max(f32::MIN_POSITIVE);
                Self::FromCode(least.ceil().clamp(0.0, 256.0) as u16)
            }
        }
    }

    /// What of a texel enters a sum: colour and alpha as they are, or the colour times a weight and
    /// the weight.
    fn apply(self, texel: Vec4, alpha_code: u8) -> Vec4 {
        let weight = match self {
            Self::Even => return texel,
            Self::Alpha => texel.w,
            Self::FromCode(least) => f32::from(u8::from(u16::from(alpha_code) >= least)),
        };
        (texel.truncate() * weight).extend(weight)
    }
}

/// What of a texture the mean is asked for: a parallelogram in the mesh's texture coordinates.
pub(super) struct Lookup<'a> {
    pub texture: &'a Texture,
    pub slot: &'a TextureSlot,
    pub weight: Weight,
    /// Its middle.
    pub middle: Vec2,
    /// Its edges.
    pub edges: [Vec2; 2],
}

/// A texture at half the size of the one before, rounded down: each texel is the mean over its part
/// of the texture, linear.
struct Level {
    size: [u32; 2],
    /// In shares of 65,535 of the level's greatest value.
    texels: Vec<[u16; 4]>,
    /// That greatest value over 65,535, by channel: few bright texels among black ones leave means
    /// that are small, and are yet what the texture is from far away.
    unit: Vec4,
}

/// The smaller copies of a texture, read in one way.
struct Pyramid {
    encoding: Encoding,
    weight: Weight,
    /// Half the size, a quarter, and so on, down to one texel.
    levels: Vec<Level>,
}

/// The pyramids of all textures of a scene that say what a surface reflects or emits.
pub struct Pyramids {
    /// Of each texture, as many as ways to read it.
    of: Vec<Vec<Pyramid>>,
}

impl Pyramids {
    /// Averages all textures of a scene whose means may be asked for.
    pub fn new(scene: &Scene) -> Self {
        let needed = needed(scene);
        let mut of: Vec<Vec<Pyramid>> = scene.textures.iter().map(|_| Vec::new()).collect();
        for (texture, encoding, weight) in needed {
            let texture = texture as usize;
            of[texture].push(Pyramid::new(&scene.textures[texture], encoding, weight));
        }
        Self { of }
    }

    /// Bytes that the pyramids of a scene take at most while they are made: a third of the texels
    /// for each way to read them, and once a quarter of them in single precision.
    pub fn needed_bytes(scene: &Scene) -> u64 {
        let (mut all, mut most) = (0, 0);
        for (texture, ..) in needed(scene) {
            let Texture { width, height, .. } = &scene.textures[texture as usize];
            let [width, height] = [*width, *height].map(u64::from);
            // An image one texel wide shrinks along its length alone.
            let texels = if width.min(height) > 1 { width * height } else { 3 * width * height };
            // Lists of rows and their sums, beside the texels.
            all += (texels / 3 + width + height) * STORED_BYTES + 4096;
            most = most.max(texels / 4 * SUMMED_BYTES + height * 32);
        }
        all + most
    }

    /// The mean of a texture over a part of it: linear colour and, if all texels count alike,
    /// alpha.
    pub(super) fn mean(&self, lookup: &Lookup<'_>) -> Vec4 {
        let Lookup { texture, slot, weight, middle, edges } = lookup;
        let size = Vec2::new(texture.width as f32, texture.height as f32);
        let at = slot.transformed(*middle) * size;
        let edges = edges.map(|edge| slot.linear * edge * size);
        let all = self.of.get(slot.texture as usize);
        let pyramid = all.and_then(|all| {
            all.iter().find(|one| one.encoding == slot.encoding && one.weight == *weight)
        });
        let is_finite = at.is_finite() && edges.iter().all(|edge| edge.is_finite());
        let Some(pyramid) = pyramid.filter(|_| is_finite) else {
            return texture.sample_rgba(slot, *middle);
        };
        let (axis, long, short) = axes(edges);
        let width = short.max(long / MOST_PLACES).max(1.0);
        let level =
            (width as u64).max(1).ilog2().saturating_sub(1).min(pyramid.levels.len() as u32);
        // As many places as it takes for no texel to be left out.
        let texel = (1u64 << level) as f32;
        let count = |side: f32, most: f32| {
            let least = (side / (SPACING * texel)).min(most);
            (least as u32 + u32::from(least.fract() > 1e-3)).max(1)
        };
        let counts = [count(long, 4.0 * MOST_PLACES), count(short, 4.0)];
        let places = (counts[0] * counts[1]) as f32;
        // Nearest texels have sharp edges, which the part blurs by its own width.
        let extent = edges[0].abs() + edges[1].abs();
        let is_sharp = slot.nearest && level == 0;
        let sharp = if is_sharp { extent.min(Vec2::ONE) } else { Vec2::ONE };
        let off = |place: u32, count: u32| (place as f32 + 0.5) / count as f32 - 0.5;
        let mut sum = Vec4::ZERO;
        for (i, j) in (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j))) {
            let along = axis * (long * off(i, counts[0]));
            let across = axis.perp() * (short * off(j, counts[1]));
            sum += pyramid.read(lookup, level as usize, at + along + across, sharp);
        }
        match weight {
            Weight::Even => sum / places,
            _ if sum.w > 0.0 => (sum.truncate() / sum.w).extend(sum.w / places),
            _ => texture.sample_rgba(slot, *middle),
        }
    }
}

/// The longer axis of a parallelogram as a unit vector, and the widths along and across it: the
/// singular values of its edges. A square has its side as both.
pub(super) fn axes([a, b]: [Vec2; 2]) -> (Vec2, f32, f32) {
    // The symmetric matrix ((p, q), (q, r)) of the sums over both edges.
    let (p, q, r) = (a.x * a.x + b.x * b.x, a.x * a.y + b.x * b.y, a.y * a.y + b.y * b.y);
    let (mean, half) = (0.5 * (p + r), 0.5 * (p - r));
    let spread = (half * half + q * q).sqrt();
    let long = (mean + spread).max(0.0).sqrt();
    let short = (mean - spread).max(0.0).sqrt();
    let axis = if half > 0.0 { Vec2::new(half + spread, q) } else { Vec2::new(q, spread - half) };
    (axis.normalize_or(Vec2::X), long, short)
}

/// Textures that say what a material reflects or emits, with how much their texels count.
pub(super) fn slots(material: &Material) -> impl Iterator<Item = (&TextureSlot, Weight)> {
    let emission = material.emission_texture.as_ref().filter(|_| material.emits());
    let normal = material.normal_map.as_ref().map(|map| &map.slot);
    let slots = [
        (normal, Weight::Even),
        (material.base_color_texture.as_ref(), Weight::of(material)),
        (material.metallic_roughness_texture.as_ref(), Weight::Even),
        (material.specular_texture.as_ref(), Weight::Even),
        (material.specular_color_texture.as_ref(), Weight::Even),
        (material.transmission_texture.as_ref(), Weight::Even),
        (emission, Weight::Even),
    ];
    let layers = material.layering.iter().flat_map(|layering| layering.slots());
    let passed = material.translucency.iter().flat_map(|translucency| translucency.slots());
    let layers = layers.chain(passed).map(|slot| (slot, Weight::Even));
    slots.into_iter().filter_map(|(slot, weight)| Some((slot?, weight))).chain(layers)
}

/// Ways in which textures are read whose means may be asked for, without repetition.
fn needed(scene: &Scene) -> Vec<(u32, Encoding, Weight)> {
    let used = scene.used_materials();
    let mut all = Vec::new();
    for (material, _) in scene.materials.iter().zip(used).filter(|(_, used)| *used) {
        for (slot, weight) in slots(material) {
            let way = (slot.texture, slot.encoding, weight);
            if !all.contains(&way) {
                all.push(way);
            }
        }
    }
    all
}

impl Pyramid {
    fn new(texture: &Texture, encoding: Encoding, weight: Weight) -> Self {
        let mut levels: Vec<Level> = Vec::new();
        loop {
            let (size, next) = match levels.last() {
                None => {
                    let size = [texture.width, texture.height];
                    let read = |at: usize| stored(texture, encoding, weight, at);
                    (size, Level::halved(size, read))
                }
                Some(level) => (level.size, Level::halved(level.size, |at| level.at(at))),
            };
            if size == [1, 1] {
                return Self { encoding, weight, levels };
            }
            levels.push(next);
        }
    }

    /// What is stored around a place given in texels of the whole texture, between its four
    /// nearest texels of a level; `sharp` is how much of the way from one to the next is not
    /// flat.
    fn read(&self, lookup: &Lookup<'_>, level: usize, at: Vec2, sharp: Vec2) -> Vec4 {
        let Lookup { texture, slot, weight, .. } = lookup;
        let whole = Vec2::new(texture.width as f32, texture.height as f32);
        let level = level.checked_sub(1).map(|level| &self.levels[level]);
        let size = level.map_or([texture.width, texture.height], |level| level.size);
        let at = at * Vec2::new(size[0] as f32, size[1] as f32) / whole - 0.5;
        let first = Vec2::new(floor(at.x), floor(at.y));
        let part =
            ((at - first - 0.5) / sharp.max(Vec2::splat(1e-6)) + 0.5).clamp(Vec2::ZERO, Vec2::ONE);
        let [x, y] = [first.x as i64, first.y as i64];
        let column = |x: i64| slot.wrap[0].texel(x, i64::from(size[0])) as usize;
        let row = |y: i64| slot.wrap[1].texel(y, i64::from(size[1])) as usize * size[0] as usize;
        let columns = [column(x), column(x.saturating_add(1))];
        let rows = [row(y), row(y.saturating_add(1))];
        let read = |at: usize| match level {
            Some(level) => level.at(at),
            None => stored(texture, self.encoding, *weight, at),
        };
        let [top, bottom] =
            rows.map(|row| read(row + columns[0]).lerp(read(row + columns[1]), part.x));
        top.lerp(bottom, part.y)
    }
}

/// What enters the sums of a texel.
fn stored(texture: &Texture, encoding: Encoding, weight: Weight, at: usize) -> Vec4 {
    let texel = texture.texels[at];
    weight.apply(encoding.decode(texel), texel[3])
}

impl Level {
    /// Half of an image of that size, whose texels `read` tells.
    fn halved(size: [u32; 2], read: impl Fn(usize) -> Vec4 + Sync) -> Self {
        let half = size.map(|side| (side / 2).max(1));
        let columns: Vec<Span> = (0..half[0]).map(|x| Span::new(x, half[0], size[0])).collect();
        let is_even = size.iter().all(|side| side % 2 == 0);
        let row = |y: u32| {
            let rows = Span::new(y, half[1], size[1]);
            let of_four = |x: usize| {
                let [top, bottom] = [0, 1].map(|row| ((2 * y + row) * size[0]) as usize + 2 * x);
                0.25 * (read(top) + read(top + 1) + read(bottom) + read(bottom + 1))
            };
            let of = |columns: &Span| {
                let mut sum = Vec4::ZERO;
                for (y, across) in rows.each() {
                    for (x, along) in columns.each() {
                        sum += read(y * size[0] as usize + x) * (across * along);
                    }
                }
                sum
            };
            let row: Vec<Vec4> = match is_even {
                true => (0..columns.len()).map(of_four).collect(),
                false => columns.iter().map(of).collect(),
            };
            let most = row.iter().fold(Vec4::ZERO, |most, texel| most.max(*texel));
            (row, most)
        };
        let (rows, most): (Vec<Vec<Vec4>>, Vec<Vec4>) =
            (0..half[1]).into_par_iter().map(row).unzip();
        let most = most.into_iter().fold(Vec4::ZERO, Vec4::max);
        let unit = most / f32::from(u16::MAX);
        let per_unit = Vec4::select(unit.cmpgt(Vec4::ZERO), 1.0 / unit, Vec4::ZERO);
        let mut texels = vec![[0; 4]; half[0] as usize * half[1] as usize];
        texels.par_chunks_mut(half[0] as usize).zip(&rows).for_each(|(stored, row)| {
            for (stored, texel) in stored.iter_mut().zip(row) {
                *stored = (*texel * per_unit + 0.5).to_array().map(|x| x as u16);
            }
        });
        Self { size: half, texels, unit }
    }

    fn at(&self, at: usize) -> Vec4 {
        Vec4::from_array(self.texels[at].map(f32::from)) * self.unit
    }
}

/// The texels that one of half the number is the mean of: two, or three where their number is odd,
/// of which the outer ones count in part.
struct Span {
    first: usize,
    weights: [f32; 3],
}

impl Span {
    fn new(index: u32, half: u32, all: u32) -> Self {
        let scale = f64::from(all) / f64::from(half);
        let range = DVec2::new(f64::from(index), f64::from(index + 1)) * scale;
        let first = range.x.floor();
        let weight = |k: u32| {
            let (low, high) = (first + f64::from(k), first + f64::from(k + 1));
            ((high.min(range.y) - low.max(range.x)).max(0.0) / scale) as f32
        };
        Self { first: first as usize, weights: [weight(0), weight(1), weight(2)] }
    }

    fn each(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        let numbered = self.weights.iter().enumerate();
        numbered.filter(|(_, w)| **w > 1e-7).map(|(k, weight)| (self.first + k, *weight))
    }
}

#[cfg(test)]
mod tests;
