//! What triangles reflect and emit, each kind once: triangles of one material that look alike share
//! it, so that a scene of millions of them holds a number a triangle.

use super::dielectric::Clear;
use super::model::Parameters;
use crate::radiometry::Rgb;
use crate::rays::unit_normal;
use crate::scene::instances::{InstanceTriangle, Instances};
use crate::scene::{Scene, Triangle};
use foldhash::{HashMap, HashMapExt};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Vertex normals within this cosine of the geometric one, .08°, are taken to be that one with
/// rounding: flat surfaces are then lit alike everywhere.
const FLAT_COSINE: f32 = 1.0 - 1e-6;
/// Triangles of a parallel task.
const CHUNK: usize = 1 << 14;

/// What a triangle reflects and emits.
#[derive(Clone)]
pub struct Finish {
    /// At its first corner; everywhere where nothing varies. Where something does, of one like it:
    /// as glossy or not.
    pub parameters: Parameters,
    /// Emitted radiance, likewise.
    pub emission: Rgb,
    /// Whether its back reflects and emits too.
    pub two_sided: bool,
    /// Whether reflection or emission changes over the triangle.
    pub varies: bool,
    /// Whether the shading normal is another than the geometric one somewhere.
    pub is_bent: bool,
    /// Radiance that a camera sees of a material that takes no part in light
    /// (KHR_materials_unlit): its base colour.
    pub is_unlit: bool,
    /// Whether light may go through it diffusely.
    pub is_translucent: bool,
    /// What it does to light as a clear surface, if it is one.
    pub clear: Option<Clear>,
}

/// The finishes of a scene's triangles.
#[derive(Default)]
pub struct Finishes {
    all: Vec<Finish>,
    /// Which of them each triangle has: those that are listed, then those of shapes.
    of_triangle: Vec<u32>,
    /// Triangles that are listed.
    listed: u32,
    instances: Arc<Instances>,
}

/// What tells finishes apart: material, whether they vary and are bent, and the bits of the vertices'
/// colour or, where something varies, whether they are glossy.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    material: u32,
    varies: bool,
    is_bent: bool,
    looks: [u32; 3],
}

/// The finishes of some triangles, in the order in which they come up.
#[derive(Default)]
struct Found {
    all: Vec<(Key, Finish)>,
    of_triangle: Vec<u32>,
}

impl Finishes {
    /// Bytes that they take.
    pub fn held_bytes(&self) -> u64 {
        (size_of_val(&*self.all) + size_of_val(&*self.of_triangle)) as u64
    }

    /// Those of a scene; a metre is so many ray units.
    pub fn new(scene: &Scene, metre: f64) -> Self {
        let unique: Vec<u32> = scene.unique_triangles().collect();
        let found: Vec<Found> =
            unique.par_chunks(CHUNK).map(|triangles| Found::of(scene, triangles, metre)).collect();
        let mut this = Self {
            listed: scene.triangles.len() as u32,
            instances: scene.instances.clone(),
            ..Self::default()
        };
        this.of_triangle.reserve_exact(unique.len());
        let mut numbers: HashMap<Key, u32> = HashMap::new();
        for Found { all, of_triangle } in found {
            let place = |(key, finish): (Key, Finish)| {
                *numbers.entry(key).or_insert_with(|| {
                    this.all.push(finish);
                    this.all.len() as u32 - 1
                })
            };
            let places: Vec<u32> = all.into_iter().map(place).collect();
            this.of_triangle.extend(of_triangle.iter().map(|own| places[*own as usize]));
        }
        this
    }

    /// That of a triangle.
    #[inline(always)]
    pub fn of(&self, triangle: u32) -> &Finish {
        let place = if triangle < self.listed { triangle } else { self.place_of(triangle) };
        &self.all[self.of_triangle[place as usize] as usize]
    }

    /// The place in the list of a triangle of an instance.
    #[inline(never)]
    fn place_of(&self, triangle: u32) -> u32 {
        let InstanceTriangle { instance, local } = self.instances.find(triangle - self.listed);
        let own = &self.instances.all()[instance as usize];
        self.listed + self.instances.shape_of(own).first + local
    }

    /// Every one that a triangle has.
    pub fn all(&self) -> &[Finish] {
        &self.all
    }
}

impl Found {
    fn of(scene: &Scene, triangles: &[u32], metre: f64) -> Self {
        let mut numbers: HashMap<Key, u32> = HashMap::new();
        let mut this = Self::default();
        let mut last: Option<(Key, u32)> = None;
        for triangle in triangles.iter().map(|index| scene.triangle(*index)) {
            let key = Key::new(scene, &triangle);
            let number = match last.filter(|(before, _)| *before == key) {
                Some((_, number)) => number,
                None => *numbers.entry(key).or_insert_with(|| {
                    this.all.push((key, Finish::new(scene, &triangle, key, metre)));
                    this.all.len() as u32 - 1
                }),
            };
            last = Some((key, number));
            this.of_triangle.push(number);
        }
        this
    }
}

impl Key {
    fn new(scene: &Scene, triangle: &Triangle) -> Self {
        let material = &scene.materials[triangle.material as usize];
        let [a, b, c] = scene.of_sources(triangle, |vertex| vertex.color);
        let varies = material.has_textured_reflection()
            || (material.emits() && material.emission_texture.is_some())
            || a != b
            || b != c;
        let normal = unit_normal(scene.corners(triangle));
        let is_off = |given: Vec3| given.normalize_or(normal).dot(normal) < FLAT_COSINE;
        let normals = scene.of_corners(triangle, |vertex| vertex.normal);
        let is_bent = material.has_normal_map() || normals.into_iter().any(is_off);
        let looks = match varies {
            true => {
                let first = Parameters::new(material, &scene.appearance(triangle, 0.0, 0.0));
                [u32::from(first.is_glossy()); 3]
            }
            false => a.to_array().map(f32::to_bits),
        };
        Self { material: triangle.material, varies, is_bent, looks }
    }
}

impl Finish {
    fn new(scene: &Scene, triangle: &Triangle, key: Key, metre: f64) -> Self {
        let Key { varies, is_bent, .. } = key;
        let material = &scene.materials[triangle.material as usize];
        let appearance = scene.appearance(triangle, 0.0, 0.0);
        let clear = Clear::new(material, metre);
        // A texture may leave the first corner opaque and others clear.
        let clear = if varies { clear } else { clear.and_then(|clear| clear.looking(&appearance)) };
        Self {
            parameters: Parameters::new(material, &appearance),
            emission: scene.emission(triangle, 0.0, 0.0),
            two_sided: material.double_sided,
            varies,
            is_bent,
            is_unlit: material.unlit,
            is_translucent: material.is_translucent(),
            clear,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;

    /// Each triangle has what it would have alone, and few are kept.
    #[test]
    fn triangles_that_look_alike_share_a_finish() {
        for glb in [made::office(), made::tessellated_room(40_000)] {
            let scene = import(&glb, &Resources::new(), &ImportLimits::default()).unwrap();
            let finishes = Finishes::new(&scene, 1.0);
            assert!(finishes.all().len() < 100, "{}", finishes.all().len());
            for (index, triangle) in scene.triangles.iter().enumerate() {
                let alone = Finish::new(&scene, triangle, Key::new(&scene, triangle), 1.0);
                let shared = finishes.of(index as u32);
                assert_eq!(alone.is_bent, shared.is_bent);
                assert_eq!(alone.varies, shared.varies);
                assert_eq!(alone.parameters.is_glossy(), shared.parameters.is_glossy());
                assert!(alone.varies || alone.parameters == shared.parameters);
                assert!(alone.varies || alone.emission == shared.emission);
            }
        }
    }
}
