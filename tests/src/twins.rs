//! Comparing two devices: scenes, shots, and comparators that say how far apart results are.

use glam::{Vec2, Vec3};
use hemilux_engine::device::ShotTrace;
use hemilux_engine::hemicube::Shot;
use hemilux_engine::patches::{PatchIndex, PatchedScene};
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::random::{Stream, uniform};
use hemilux_engine::sampling::frame;
use hemilux_engine::scene::{Material, Model, Scene, Triangle, Vertex};
use std::f32::consts::TAU;
use std::sync::Arc;

/// Builds scenes of quads.
#[derive(Default)]
pub struct Builder {
    scene: Scene,
}

impl Builder {
    /// Adds a material and returns its index.
    pub fn material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// Adds a triangle that faces the side from which its corners go counter-clockwise.
    pub fn triangle(&mut self, corners: [Vec3; 3], material: u32) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let first = self.scene.vertices.len() as u32;
        self.scene.vertices.extend(corners.map(|position| Vertex::new(position, normal)));
        self.scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material });
    }

    /// Adds a parallelogram that faces a × b, as n × n smaller ones whose material is chosen by
    /// column and row.
    pub fn grid(
        &mut self,
        origin: Vec3,
        [a, b]: [Vec3; 2],
        n: u32,
        material: impl Fn(u32, u32) -> u32,
    ) {
        let at = |i: u32, j: u32| origin + a * (i as f32 / n as f32) + b * (j as f32 / n as f32);
        for i in 0..n {
            for j in 0..n {
                let [p, q, r, s] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                self.triangle([p, q, r], material(i, j));
                self.triangle([p, r, s], material(i, j));
            }
        }
    }

    /// Adds the six walls of the box around (0, 0, 0) … (1, 1, 1), seen from inside; the middle
    /// ninth of the ceiling shines.
    pub fn room(&mut self, side: Rgb) {
        let grey = self.material(Material::lambertian("grey", Rgb::splat(0.7)));
        let left = self.material(Material::lambertian("left", side));
        let light = self.material(Material {
            emission: Rgb::new(17.0, 12.0, 4.0),
            ..Material::lambertian("light", Rgb::splat(0.3))
        });
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        self.grid(Vec3::ZERO, [z, x], 1, |_, _| grey);
        let ceiling = |i, j| if (i, j) == (1, 1) { light } else { grey };
        self.grid(y, [x, z], 3, ceiling);
        self.grid(Vec3::ZERO, [x, y], 1, |_, _| grey);
        self.grid(z, [y, x], 1, |_, _| grey);
        self.grid(Vec3::ZERO, [y, z], 1, |_, _| left);
        self.grid(x, [z, y], 1, |_, _| grey);
    }

    /// Adds a block seen from outside, turned about +Y by `angle`; edges of `size`.
    pub fn block(&mut self, center: Vec3, size: Vec3, angle: f32, material: u32) {
        let turn = glam::Quat::from_rotation_y(angle);
        let (x, y, z) = (turn * Vec3::X * size.x, Vec3::Y * size.y, turn * Vec3::Z * size.z);
        let low = center - 0.5 * (x + y + z);
        for (origin, edges) in [
            (low, [x, z]),
            (low + y, [z, x]),
            (low, [y, x]),
            (low + z, [x, y]),
            (low, [z, y]),
            (low + x, [y, z]),
        ] {
            self.grid(origin, edges, 1, |_, _| material);
        }
    }

    /// Cuts the scene into about `patches` patches.
    pub fn cut(self, patches: usize) -> Arc<PatchedScene> {
        Arc::new(PatchedScene::new(Arc::new(self.scene), patches))
    }
}

/// A metal whose Phong exponent is about `exponent`.
pub fn metal(color: Rgb, exponent: f32) -> Material {
    let roughness = (2.0 * exponent + 1.0).powf(-0.25);
    Material {
        name: "metal".into(),
        model: Model::Phong,
        base_color: color,
        metallic: 1.0,
        roughness,
        ..Material::default()
    }
}

/// A closed room with two diffuse blocks.
pub fn blocks(patches: usize) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    builder.room(Rgb::new(0.6, 0.1, 0.1));
    let white = builder.material(Material::lambertian("white", Rgb::splat(0.75)));
    builder.block(Vec3::new(0.3, 0.3, 0.3), Vec3::new(0.3, 0.6, 0.3), 0.3, white);
    builder.block(Vec3::new(0.7, 0.15, 0.65), Vec3::new(0.3, 0.3, 0.3), -0.3, white);
    builder.cut(patches)
}

/// A closed room with two metal blocks, one smoother than the other.
pub fn glossy(patches: usize) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    builder.room(Rgb::new(0.1, 0.1, 0.6));
    let rough = builder.material(metal(Rgb::new(0.9, 0.7, 0.4), 20.0));
    let smooth = builder.material(metal(Rgb::splat(0.8), 800.0));
    builder.block(Vec3::new(0.3, 0.3, 0.3), Vec3::new(0.3, 0.6, 0.3), 0.3, rough);
    builder.block(Vec3::new(0.7, 0.2, 0.65), Vec3::new(0.3, 0.3, 0.3), -0.3, smooth);
    builder.cut(patches)
}

/// A closed room with a two-sided screen, a block that floats and one that stands on a wall's
/// plane, so that facets coincide.
pub fn screens(patches: usize) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    builder.room(Rgb::splat(0.5));
    let screen = builder.material(Material {
        double_sided: true,
        ..Material::lambertian("screen", Rgb::new(0.2, 0.7, 0.2))
    });
    let white = builder.material(Material::lambertian("white", Rgb::splat(0.75)));
    let (a, b) = (Vec3::new(0.5, 0.0, 0.1), Vec3::new(0.0, 0.6, 0.0));
    builder.grid(Vec3::new(0.2, 0.2, 0.5), [a, b], 2, |_, _| screen);
    builder.block(Vec3::new(0.3, 0.7, 0.25), Vec3::splat(0.2), 0.8, white);
    builder.block(Vec3::new(0.8, 0.1, 0.8), Vec3::splat(0.2), 0.0, white);
    builder.cut(patches)
}

/// A closed room with a bumpy ball of many small triangles.
pub fn ball(patches: usize, rings: u32) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    builder.room(Rgb::new(0.6, 0.1, 0.1));
    let white = builder.material(Material::lambertian("white", Rgb::splat(0.75)));
    let segments = 2 * rings;
    let at = |ring: u32, segment: u32| {
        let polar = 0.5 * TAU * ring as f32 / rings as f32;
        let azimuth = TAU * (segment % segments) as f32 / segments as f32;
        let bump = 1.0 + 0.1 * (7.0 * azimuth).sin() * (5.0 * polar).sin() * polar.sin();
        let (sin, cos) =
            if ring == 0 || ring == rings { (0.0, polar.cos()) } else { polar.sin_cos() };
        let out = Vec3::new(sin * azimuth.cos(), cos, sin * azimuth.sin());
        Vec3::new(0.5, 0.45, 0.5) + 0.28 * bump * out
    };
    for ring in 0..rings {
        for segment in 0..segments {
            let [p, q, r, s] = [
                at(ring, segment),
                at(ring, segment + 1),
                at(ring + 1, segment + 1),
                at(ring + 1, segment),
            ];
            if ring > 0 {
                builder.triangle([p, q, r], white);
            }
            if ring + 1 < rings {
                builder.triangle([p, r, s], white);
            }
        }
    }
    builder.cut(patches)
}

/// Shots from random points of random patches with random frames; with lobes where the shooter
/// is glossy.
pub fn random_shots(scene: &PatchedScene, count: u64, seed: u64) -> Vec<Shot> {
    let patches = &scene.patches;
    (0..count)
        .map(|k| {
            let draw = |stream| uniform(seed, stream, k);
            let patch = (draw(Stream::Shooter) * patches.len() as f32) as usize;
            let position = scene.point_on_patch(
                PatchIndex(patch as u32),
                Vec2::new(draw(Stream::PointU), draw(Stream::PointV)),
            );
            let jitter = Vec2::new(draw(Stream::JitterX), draw(Stream::JitterY)) - 0.5;
            let mut shot = shot_at(position, patches.normal[patch], draw(Stream::Azimuth), jitter);
            shot.patch = patch as u32;
            if patches.is_glossy(patch) {
                shot.lobe = Rgb::splat(0.5);
                let tilt = 0.4 * TAU * (draw(Stream::Lobe) - 0.5);
                shot.lobe_axis = shot.normal * tilt.cos() + shot.tangent * tilt.sin();
                shot.exponent = patches.exponent[patch];
            }
            shot
        })
        .collect()
}

/// A diffuse shot at a point.
pub fn shot_at(position: Vec3, normal: Vec3, turn: f32, jitter: Vec2) -> Shot {
    let (tangent, bitangent) = frame(normal, TAU * turn);
    Shot { position, tangent, bitangent, normal, jitter, ..Shot::default() }
}

/// Largest share of pixels that two devices may see differently: rounding at facet edges.
pub const MAX_DIFFERENT_ITEMS: f64 = 0.005;

/// Share of pixels whose items differ.
pub fn different_items(a: &[u32], b: &[u32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).filter(|(a, b)| a != b).count() as f64 / a.len() as f64
}

/// Worst deviation between two arrays of per-patch sums in units of what is allowed: 2·10⁻⁴ or,
/// for sums above 10⁻³, 1 % if that is more; both times the heaviest face weight.
pub fn worst_sum(a: &[f32], b: &[f32], weight: f32) -> f32 {
    assert_eq!(a.len(), b.len());
    let deviation = |(a, b): (&f32, &f32)| {
        let size = a.max(*b);
        let relative = if size > 1e-3 { 0.01 * size } else { 0.0 };
        (a - b).abs() / relative.max(2e-4 * weight)
    };
    a.iter().zip(b).map(deviation).fold(0.0, f32::max)
}

/// How far two traces of one shot are apart.
#[derive(Debug, Default)]
pub struct Difference {
    /// Largest [`different_items`].
    pub items: f64,
    /// Largest [`worst_sum`] of the form factors.
    pub form_factor: f32,
    /// Largest [`worst_sum`] of the lobe factors.
    pub lobe_factor: f32,
    /// Largest deviation of the sum of all form factors.
    pub total: f64,
}

impl Difference {
    /// Compares traces of the same shots.
    pub fn between(shots: &[Shot], a: &[ShotTrace], b: &[ShotTrace]) -> Self {
        assert_eq!((shots.len(), shots.len()), (a.len(), b.len()));
        let mut worst = Self::default();
        for (shot, (a, b)) in shots.iter().zip(a.iter().zip(b)) {
            let weight = shot.face_weights.iter().fold(1f32, |a, b| a.max(*b));
            worst.items = worst.items.max(different_items(&a.items, &b.items));
            let form_factor = worst_sum(&a.form_factor, &b.form_factor, weight);
            worst.form_factor = worst.form_factor.max(form_factor);
            let lobe_factor = worst_sum(&a.lobe_factor, &b.lobe_factor, weight);
            worst.lobe_factor = worst.lobe_factor.max(lobe_factor);
            let total = (total(&a.form_factor) - total(&b.form_factor)).abs() / f64::from(weight);
            worst.total = worst.total.max(total);
        }
        worst
    }

    /// Whether two devices do the same.
    pub fn is_small(&self) -> bool {
        self.items <= MAX_DIFFERENT_ITEMS
            && self.form_factor <= 1.0
            && self.lobe_factor <= 1.0
            && self.total <= 1e-4
    }
}

/// Sum over all patches.
pub fn total(sums: &[f32]) -> f64 {
    sums.iter().map(|sum| f64::from(*sum)).sum()
}

/// Means of consecutive batches of iterations, per patch.
#[derive(Default)]
pub struct Batches {
    /// Batch, then patch.
    means: Vec<Vec<f64>>,
}

impl Batches {
    /// Adds the luminance-like mean of one batch's sums.
    pub fn push(&mut self, sums: &[Rgb], iterations: u64) {
        let mean = |rgb: &Rgb| f64::from(rgb.element_sum()) / iterations as f64;
        self.means.push(sums.iter().map(mean).collect());
    }

    /// All values times a factor, to plant an error.
    pub fn scaled(&self, factor: f64) -> Self {
        let scale = |batch: &Vec<f64>| batch.iter().map(|mean| mean * factor).collect();
        Self { means: self.means.iter().map(scale).collect() }
    }

    /// Every patch's values given to its neighbour, to plant an error.
    pub fn swapped(&self) -> Self {
        let rotate = |batch: &Vec<f64>| {
            let mut batch = batch.clone();
            batch.rotate_right(1);
            batch
        };
        Self { means: self.means.iter().map(rotate).collect() }
    }

    /// Mean and variance of the mean of a patch.
    fn moments(&self, patch: usize) -> (f64, f64) {
        let n = self.means.len() as f64;
        let values = self.means.iter().map(|batch| batch[patch]);
        let mean = values.clone().sum::<f64>() / n;
        let square = values.map(|value| (value - mean).powi(2)).sum::<f64>();
        (mean, square / (n - 1.0) / n)
    }

    /// Mean of a patch.
    pub fn mean(&self, patch: usize) -> f64 {
        self.moments(patch).0
    }
}

/// What a z-test per patch says about two devices.
#[derive(Debug)]
pub struct ZTest {
    /// Root mean square of z: about 1 where only chance differs. Patches lit by the same shots
    /// vary together, so it varies too.
    pub rms: f64,
    /// Share of patches with |z| > 4.
    pub outliers: f64,
    /// Relative difference of the area-weighted means.
    pub overall: f64,
}

impl ZTest {
    /// Compares batch means patch by patch.
    pub fn between(areas: &[f32], a: &Batches, b: &Batches) -> Self {
        let (mut squares, mut outliers, mut tested) = (0.0, 0.0, 0.0);
        let (mut sum_a, mut sum_b) = (0.0, 0.0);
        for (patch, area) in areas.iter().enumerate() {
            let ((mean_a, variance_a), (mean_b, variance_b)) = (a.moments(patch), b.moments(patch));
            sum_a += f64::from(*area) * mean_a;
            sum_b += f64::from(*area) * mean_b;
            let variance = variance_a + variance_b;
            if variance > 0.0 {
                let z = (mean_a - mean_b) / variance.sqrt();
                squares += z * z;
                outliers += f64::from(z.abs() > 4.0);
                tested += 1.0;
            } else {
                assert_eq!(mean_a, mean_b, "patch {patch} does not vary");
            }
        }
        assert!(tested > 0.0, "no patch is lit");
        Self {
            rms: (squares / tested).sqrt(),
            outliers: outliers / tested,
            overall: (sum_a / sum_b - 1.0).abs(),
        }
    }

    /// Whether the devices agree but for chance.
    pub fn passes(&self) -> bool {
        self.passes_within(0.01)
    }

    /// The same where chance moves the overall mean by up to the given share.
    pub fn passes_within(&self, overall: f64) -> bool {
        self.rms < 1.6 && self.outliers < 0.005 && self.overall < overall
    }
}

/// Relative L1 distance of per-patch sums of two devices, weighted by area; NaN without light.
pub fn distance(areas: &[f32], a: &[Rgb], b: &[Rgb]) -> f64 {
    let (mut distance, mut size) = (0.0, 0.0);
    for ((area, a), b) in areas.iter().zip(a).zip(b) {
        distance += f64::from(area * (*a - *b).abs().element_sum());
        size += f64::from(area * a.abs().element_sum());
    }
    distance / size
}
