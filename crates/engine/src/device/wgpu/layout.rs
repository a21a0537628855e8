//! Scene, settings and shots in the layout of the structures in `common.wgsl`.

use crate::device::{
    Faces, Selection, ShootingSettings, Substitute, Viewpoint, known_power, sources,
};
use crate::hemicube::{FACES, Shot};
use crate::patches::{NO_PATCH, PatchedScene};
use crate::radiometry::{LOBE_COLUMNS, LOBE_ROWS, LobeAlbedo, importance};
use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};
use std::f32::consts::PI;

/// Patches per run and runs per group of the prefix sum in `select.wgsl`.
pub const SPAN: u32 = 64;
/// Facets per run in `cull.wgsl`.
pub const FACET_RUN: u32 = 32;
/// Pixels per run in `deposit.wgsl`.
pub const PIXEL_RUN: u32 = 16;
/// Fixed-point units per form factor of 1 in the sums: those of one hemicube stay below 2³².
pub const FIXED_SCALE: f32 = (1u32 << 31) as f32;

/// `Facet.back` of a facet that is skipped when its back is seen.
const CULLED_BACK: u32 = u32::MAX - 1;
const NOT_GLOSSY: u32 = u32::MAX;
/// Bit of `Corner.item` and `Facet.divisions` of a facet that recedes; both are below it.
const RECEDES: u32 = 1 << 31;
/// Near value of the depth buffer relative to the size of the scene, or to that of so many of its
/// facets in a row if that is less.
const NEAR: f32 = 1e-8;
const ORDINARY_EDGES: f32 = 1000.0;

mod flag {
    pub const RANDOM_AZIMUTH: u32 = 1;
    pub const JITTER: u32 = 2;
    pub const VIEWER_IS_POINT: u32 = 4;
    pub const VIEWER_IS_DIRECTION: u32 = 8;
    pub const LOBES: u32 = 16;
    pub const UNIFORM_SELECTION: u32 = 32;
    pub const STRATIFIED: u32 = 64;
    pub const RANDOM_POINT: u32 = 128;
    pub const GROWING_SHOTS: u32 = 256;
}

const TABLE: usize = (LOBE_ROWS * LOBE_COLUMNS).div_ceil(4);

/// `Settings`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuSettings {
    pub seed: [u32; 2],
    pub flags: u32,
    pub resolution: u32,
    pub patches: u32,
    pub facets: u32,
    pub glossy: u32,
    pub shots: u32,
    pub runs: u32,
    pub groups: u32,
    pub facet_runs: u32,
    pub columns: u32,
    pub faces: u32,
    pub substitute: u32,
    pub expected_shots: f32,
    pub spare: u32,
    pub viewer: Vec3,
    pub near: f32,
    pub lobe_albedo: [[f32; 4]; TABLE],
}

impl GpuSettings {
    /// Settings of shooting in a scene with `glossy` glossy patches.
    pub fn new(
        scene: &PatchedScene,
        settings: &ShootingSettings,
        glossy: u32,
        columns: u32,
    ) -> Self {
        let (substitute, expected_shots) = match settings.variance_reduction {
            None => (0, None),
            Some(rule) => match rule.substitute {
                Substitute::Zero => (1, rule.shots),
                Substitute::Mean => (2, rule.shots),
            },
        };
        let mut lobe_albedo = [[0.0; 4]; TABLE];
        let cells = lobe_albedo.as_flattened_mut().iter_mut();
        cells.zip(&LobeAlbedo::shared().table).for_each(|(cell, value)| *cell = *value);
        let patches = scene.patches.len() as u32;
        let facets = scene.facets.len() as u32;
        let runs = patches.div_ceil(SPAN);
        Self {
            seed: [settings.seed as u32, (settings.seed >> 32) as u32],
            flags: flags(settings, glossy > 0),
            resolution: settings.resolution,
            patches,
            facets,
            glossy,
            shots: settings.shots_per_iteration,
            runs,
            groups: runs.div_ceil(SPAN),
            facet_runs: facets.div_ceil(FACET_RUN),
            columns,
            faces: match settings.faces {
                Faces::All => 0,
                Faces::Specular => 1,
                Faces::TopAndSide => 2,
                Faces::Randomised => 3,
            },
            substitute,
            expected_shots: expected_shots.unwrap_or(0) as f32,
            spare: 0,
            viewer: match settings.viewpoint {
                Some(Viewpoint::Eye(viewer) | Viewpoint::Direction(viewer)) => viewer,
                None => Vec3::ZERO,
            },
            near: near_value(scene),
            lobe_albedo,
        }
    }
}

/// `Settings.flags` of a scene with glossy patches or without.
fn flags(settings: &ShootingSettings, any_glossy: bool) -> u32 {
    let viewpoint = settings.viewpoint;
    let expected_shots = settings.variance_reduction.and_then(|rule| rule.shots);
    let all = [
        (settings.random_azimuth, flag::RANDOM_AZIMUTH),
        (settings.jitter, flag::JITTER),
        (matches!(viewpoint, Some(Viewpoint::Eye(_))), flag::VIEWER_IS_POINT),
        (matches!(viewpoint, Some(Viewpoint::Direction(_))), flag::VIEWER_IS_DIRECTION),
        (any_glossy, flag::LOBES),
        (settings.selection == Selection::Uniform, flag::UNIFORM_SELECTION),
        (settings.stratified, flag::STRATIFIED),
        (settings.random_point, flag::RANDOM_POINT),
        (expected_shots.is_none(), flag::GROWING_SHOTS),
    ];
    all.iter().filter(|(set, _)| *set).fold(0, |flags, (_, flag)| flags | flag)
}

/// A length below all distances in the scene that count. What lies far away from everything else must
/// not make it larger, so it goes by ordinary facets, too.
fn near_value(scene: &PatchedScene) -> f32 {
    let positions = scene.positions.iter().copied();
    let low = positions.clone().reduce(Vec3::min).unwrap_or(Vec3::ZERO);
    let high = positions.reduce(Vec3::max).unwrap_or(Vec3::ONE);
    let mut edges: Vec<f32> = scene
        .facets
        .iter()
        .map(|facet| {
            let [a, b, c] = facet.corners.map(|corner| scene.positions[corner as usize]);
            a.distance(b).max(b.distance(c)).max(c.distance(a))
        })
        .collect();
    let middle = edges.len() / 2;
    let ordinary = match edges.is_empty() {
        true => f32::INFINITY,
        false => ORDINARY_EDGES * *edges.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    ((high - low).max_element().min(ordinary) * NEAR).max(f32::MIN_POSITIVE)
}

/// `Pass`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuPass {
    pub first: u32,
    pub count: u32,
    pub opens: u32,
    pub closes: u32,
}

/// `Shot`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuShot {
    position: Vec3,
    patch: u32,
    tangent: Vec3,
    exponent: f32,
    bitangent: Vec3,
    scale: f32,
    normal: Vec3,
    has_lobe: u32,
    diffuse: Vec3,
    fixed_scale: f32,
    lobe: Vec3,
    jitter_x: f32,
    lobe_axis: Vec3,
    jitter_y: f32,
    face_weights: [f32; FACES],
    limit: f32,
    spare_a: [f32; 2],
    known: Vec3,
    spare_b: f32,
}

impl GpuShot {
    /// Bytes of one shot.
    pub const SIZE: u64 = size_of::<Self>() as u64;

    /// A shot, and the form factor of one fixed-point unit in its sums.
    pub fn new(shot: &Shot) -> (Self, f32) {
        let heaviest = shot.face_weights.iter().fold(1f32, |a, b| a.max(*b));
        let fixed_scale = FIXED_SCALE / heaviest.log2().ceil().exp2();
        let packed = Self {
            position: shot.position,
            patch: shot.patch,
            tangent: shot.tangent,
            exponent: shot.exponent,
            bitangent: shot.bitangent,
            scale: shot.scale,
            normal: shot.normal,
            has_lobe: u32::from(shot.has_lobe()),
            diffuse: shot.diffuse,
            fixed_scale,
            lobe: shot.lobe,
            jitter_x: shot.jitter.x,
            lobe_axis: shot.lobe_axis,
            jitter_y: shot.jitter.y,
            face_weights: shot.face_weights,
            // Traced shots are not reduced.
            limit: f32::MAX,
            spare_a: [0.0; 2],
            known: shot.known,
            spare_b: 0.0,
        };
        (packed, fixed_scale.recip())
    }

    /// The patches that shoot, of shots as the device holds them.
    pub fn shooters(words: &[u32]) -> impl Iterator<Item = u32> + '_ {
        let shots = words.chunks_exact(Self::SIZE as usize / 4);
        shots
            .map(bytemuck::cast_slice::<u32, Self>)
            .map(|shot| shot[0])
            .filter(|shot| shot.scale > 0.0)
            .map(|shot| shot.patch)
    }
}

/// `Patch`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuPatch {
    centroid: Vec3,
    area: f32,
    normal: Vec3,
    exponent: f32,
    shading_normal: Vec3,
    facet: u32,
    diffuse: Vec3,
    glossy: u32,
    specular: Vec3,
    emits: u32,
    source: Vec3,
    known_power: f32,
    known: Vec3,
    spare: f32,
}

impl GpuPatch {
    /// Bytes of one patch.
    pub const SIZE: u64 = size_of::<Self>() as u64;

    /// All patches of a scene and what they send; glossy ones are numbered in order.
    pub fn all(scene: &PatchedScene, settings: &ShootingSettings) -> Vec<Self> {
        let patches = &scene.patches;
        let (sources, known_power) = (sources(scene, settings), known_power(scene, settings));
        let known = settings.known.as_deref();
        let mut glossy_count = 0;
        (0..patches.len())
            .map(|i| {
                let mut glossy = NOT_GLOSSY;
                if patches.is_glossy(i) {
                    glossy = glossy_count;
                    glossy_count += 1;
                }
                Self {
                    centroid: patches.centroid[i],
                    area: patches.area[i],
                    normal: patches.normal[i],
                    exponent: patches.exponent[i],
                    shading_normal: patches.shading_normal[i],
                    facet: patches.facet[i],
                    diffuse: patches.diffuse[i],
                    glossy,
                    specular: patches.specular[i],
                    emits: u32::from(patches.emits(i)),
                    source: sources[i],
                    known_power: known_power.get(i).copied().unwrap_or(0.0),
                    known: known.map_or(Vec3::ZERO, |known| known.radiance[i]),
                    spare: 0.0,
                }
            })
            .collect()
    }

    /// Powers at the start, before any light has arrived.
    pub fn first_powers(patches: &[Self]) -> Vec<f32> {
        let power = |p: &Self| importance(PI * p.area * p.source) + p.known_power;
        patches.iter().map(power).collect()
    }
}

/// `Facet`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuFacet {
    corner: Vec3,
    divisions: u32,
    edge_1: Vec3,
    front: u32,
    edge_2: Vec3,
    back: u32,
}

impl GpuFacet {
    /// Bytes of one facet.
    pub const SIZE: u64 = size_of::<Self>() as u64;

    /// All facets of a scene.
    pub fn all(scene: &PatchedScene) -> Vec<Self> {
        let facets = scene.facets.iter().map(|facet| {
            let [a, b, c] = facet.corners.map(|corner| scene.positions[corner as usize]);
            let culled = facet.cull_back && facet.back == NO_PATCH;
            Self {
                corner: a,
                divisions: facet.divisions | if facet.recedes { RECEDES } else { 0 },
                edge_1: b - a,
                front: facet.front,
                edge_2: c - a,
                back: if culled { CULLED_BACK } else { facet.back },
            }
        });
        facets.collect()
    }
}

/// A corner of a facet as the rasteriser takes it.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct GpuCorner {
    position: Vec3,
    item: u32,
}

impl GpuCorner {
    /// Bytes of one corner.
    pub const SIZE: u64 = size_of::<Self>() as u64;
    /// Corners of one facet: three with the item code of its front, three with its back's.
    pub const PER_FACET: u64 = 6;

    /// All corners of a scene.
    pub fn all(scene: &PatchedScene) -> Vec<Self> {
        let corners = scene.facets.iter().zip(0..).flat_map(|(facet, index)| {
            [false, true].into_iter().flat_map(move |back| {
                let recedes = if facet.recedes { RECEDES } else { 0 };
                let item = crate::hemicube::item::encode(index, back) | recedes;
                facet
                    .corners
                    .map(|corner| Self { position: scene.positions[corner as usize], item })
            })
        });
        corners.collect()
    }
}

/// Three components of each vector.
pub fn triples(words: &[u32]) -> impl Iterator<Item = Vec3> + '_ {
    words
        .chunks_exact(4)
        .map(|v| Vec4::from_array([v[0], v[1], v[2], v[3]].map(f32::from_bits)).truncate())
}
