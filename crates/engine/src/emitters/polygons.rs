//! The polygon lights of a scene: their irradiance without occlusion, and points on them for shadow
//! rays and lobes.

use super::cells::{CellLimits, EmissionCell, EmissionCells};
use super::from_triangles::{
    UntexturedEmitter, merge_into_polygons, shine_outwards_only, untextured,
};
use super::glow::Glow;
use super::light_tree::LightTree;
use super::polygon::PolygonLight;
use super::unoccluded::{ClosedForms, LobeAxis, MOST_LIGHTS, Unoccluded};
use crate::radiometry::Rgb;
use crate::random::pcg;
use crate::rays::{Hit, Rays};
use crate::scene::Scene;
use crate::surface::World;
use glam::{Vec2, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// Points of a light that are tried to find one above the horizon of a surface.
pub const TRIES: u32 = 4;
/// The same of one of many lights, each of which a place has to be found of: with half of it below the horizon
/// four tries fail once in sixteen times.
const TRIES_OF_MANY: u32 = 16;
/// How emissive textures become lights: about as many as are cheap to evaluate one by one. What is
/// finer than a cell, and differs by less than a thousandth of all light, makes no difference that
/// is seen but from close by.
const CELLS: CellLimits = CellLimits { most: 256, least_difference: 1e-3, fine: 0.5, dim: 1e-4 };

/// The lights of a scene as polygons of constant radiance.
pub struct PolygonLights {
    closed_forms: ClosedForms,
    /// Picks one light where they are too many to evaluate all ([`MOST_LIGHTS`]).
    tree: LightTree,
    /// Light of each emissive triangle that is one as a whole.
    of_triangle: HashMap<u32, u32>,
    /// Parts of textured triangles.
    cells: Arc<EmissionCells>,
    /// Light of each cell, unless it is that of its triangle.
    of_cell: Vec<Option<u32>>,
}

/// A point of a light, sampled for a surface.
pub struct LightPoint {
    /// Where rays to it end.
    pub end: Vec3,
    /// Irradiance that it stands for, emitted radiance × cosθ over density: its mean over random
    /// points is the irradiance of all lights without occlusion.
    pub irradiance: Rgb,
    /// Density per solid angle at which it was picked.
    pub density: f32,
    /// Whether it is no part of the irradiance without occlusion that goes with it, since most of
    /// that never arrives: light of the sky that comes through openings.
    pub is_apart: bool,
    /// Whether it is of the sky.
    pub is_sky: bool,
    /// Number of the light if broad lobes see it in one direction: [`DirectLights::narrow`](super::DirectLights::narrow).
    pub narrow: Option<u8>,
}

/// What one shadow ray found out about the direct light on a surface.
#[derive(Clone, Copy, Default)]
pub struct ShadowSample {
    /// Irradiance without occlusion.
    pub unoccluded: Rgb,
    /// Irradiance that the ray's light point stands for: its mean is `unoccluded`.
    pub cast: Rgb,
    /// What arrives of it: 1 where nothing is in between, less behind panes.
    pub visibility: Rgb,
    /// Irradiance that arrives beside it, of light that [`LightPoint::is_apart`].
    pub apart: Rgb,
    /// Unit direction that the ray went in; zero where there was none.
    pub direction: Vec3,
    /// Density per solid angle at which it was picked; 0 where that is not known.
    pub density: f32,
    /// Whether its light is a narrow one: [`DirectLights::narrow`](super::DirectLights::narrow).
    pub is_narrow: bool,
}

impl ShadowSample {
    /// Irradiance that the ray saw arrive.
    pub fn arrived(&self) -> Rgb {
        self.cast * self.visibility + self.apart
    }

    /// Unbiased irradiance with a control variate: `share` is a guess of the share of the light
    /// that arrives. Where the guess is right and all or nothing is occluded, there is no noise
    /// (docs/decisions/0017).
    pub fn irradiance(&self, share: f32) -> Rgb {
        self.unoccluded * share + self.cast * (self.visibility - share) + self.apart
    }
}

impl PolygonLights {
    /// The parts of the triangles of a scene that have an emissive texture.
    pub fn cells(world: &World) -> Arc<EmissionCells> {
        Arc::new(EmissionCells::new(world, CELLS))
    }

    /// The lights of a scene with those cells, but for what glows; `None` without any.
    pub fn new(
        scene: &Scene,
        rays: &Rays,
        cells: Arc<EmissionCells>,
        glow: Option<&Glow>,
    ) -> Option<Self> {
        let glows = |triangle: u32| glow.is_some_and(|glow| glow.covers(scene, triangle));
        let mut untextured: Vec<UntexturedEmitter> = untextured(scene, rays).collect();
        untextured.retain(|emitter| !glows(emitter.triangle));
        let (mut lights, mut of_cell) = (Vec::new(), Vec::new());
        for EmissionCell { triangle, corners, radiance, is_even, .. } in &cells.cells {
            let material = scene.triangle(*triangle).material;
            let (triangle, radiance) = (*triangle, *radiance);
            if glows(triangle) {
                of_cell.push(None);
                continue;
            }
            let two_sided = scene.materials[material as usize].double_sided;
            let whole = rays.corners(scene, triangle).0;
            if *is_even {
                let corners = whole;
                untextured.push(UntexturedEmitter { triangle, corners, radiance, two_sided });
                of_cell.push(None);
                continue;
            }
            let place =
                |at: &Vec2| whole[0] * (1.0 - at.x - at.y) + whole[1] * at.x + whole[2] * at.y;
            let light = PolygonLight::new(&corners.each_ref().map(place), radiance, two_sided);
            of_cell.push(light.is_some().then_some(lights.len() as u32));
            lights.extend(light);
        }
        let mut of_triangle = HashMap::new();
        shine_outwards_only(&mut untextured, scene, rays);
        merge_into_polygons(&untextured, &mut lights, &mut of_triangle);
        let total: f64 = lights.iter().map(|light| f64::from(light.power())).sum();
        if total.is_nan() || total <= 0.0 || total.is_infinite() {
            return None;
        }
        let tree = LightTree::new(&lights.iter().map(PolygonLight::bounds).collect::<Vec<_>>());
        let closed_forms = ClosedForms::new(lights);
        Some(Self { closed_forms, tree, of_triangle, cells, of_cell })
    }

    /// Number of polygons.
    pub fn count(&self) -> usize {
        self.closed_forms.lights().len()
    }

    /// Whether the light without occlusion is known in closed form.
    pub fn is_exact(&self) -> bool {
        self.count() <= MOST_LIGHTS
    }

    /// Irradiance of all lights on a surface at `point` with unit `normal` without occlusion, by
    /// which lights are picked; zero where lights are too many for the closed form.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> Unoccluded {
        if !self.is_exact() {
            return Unoccluded::none();
        }
        self.closed_forms.unoccluded(point, normal)
    }

    /// The same for a lobe: only to pick lights by, without an irradiance.
    pub fn for_lobe(&self, point: Vec3, normal: Vec3, axis: LobeAxis) -> Unoccluded {
        if !self.is_exact() {
            return Unoccluded::none();
        }
        self.closed_forms.for_lobe(point, normal, axis)
    }

    /// Samples a point of the lights for a surface at `point`, by three uniform numbers. A light is
    /// picked in proportion to its irradiance where `unoccluded` is of, which may be another point of the
    /// surface, or, where they are too many, by the tree. `None` where the point shines nothing on the surface.
    pub fn sample(
        &self,
        unoccluded: &Unoccluded,
        point: Vec3,
        normal: Vec3,
        xi: Vec3,
    ) -> Option<LightPoint> {
        let (pick, probability) = self.pick_light(unoccluded, point, normal, xi.x)?;
        let light = &self.closed_forms.lights()[pick];
        let near = light.is_near(point);
        let (place, solid_angle) = match near {
            true => light.point_by_solid_angle(point, xi.y, xi.z)?,
            false => (light.point_by_area(xi.y, xi.z), 0.0),
        };
        let between = place - point;
        let square = between.length_squared();
        let cosine = normal.dot(between);
        let mut other = -light.normal.dot(between);
        let side = 1f32.copysign(other);
        if light.two_sided {
            other = other.abs();
        }
        if cosine <= 0.0 || other <= 0.0 || probability <= 0.0 {
            return None;
        }
        let solid_angle = match near {
            true => solid_angle,
            false => light.area * other / (square * square.sqrt()),
        };
        Some(LightPoint {
            end: place + light.normal * (side * light.error),
            irradiance: light.radiance * (cosine / square.sqrt() * solid_angle / probability),
            density: probability / solid_angle,
            is_apart: false,
            is_sky: false,
            narrow: None,
        })
    }

    fn pick_light(
        &self,
        unoccluded: &Unoccluded,
        point: Vec3,
        normal: Vec3,
        x: f32,
    ) -> Option<(usize, f32)> {
        if !self.is_exact() {
            return self.tree.pick(point, normal, x);
        }
        self.closed_forms.pick(unoccluded, x)
    }

    /// Samples one of many lights by the tree: returns where a shadow ray to it ends, and its
    /// irradiance in closed form over the probability of the pick, which has no singularity near
    /// the light. `None` where it shines nothing.
    pub fn one_of_many(&self, point: Vec3, normal: Vec3, xi: Vec3) -> Option<(Vec3, Rgb)> {
        let (pick, probability) = self.tree.pick(point, normal, xi.x)?;
        let light = &self.closed_forms.lights()[pick];
        let projected = light.projected(point, normal);
        if projected <= 0.0 || probability <= 0.0 {
            return None;
        }
        let height = |place: &Vec3| normal.dot(*place - point);
        // Further tries are at random: where the first failed is not to tell where they end.
        let mut bits = xi.y.to_bits() ^ xi.z.to_bits().rotate_left(16);
        let [mut y, mut z] = [xi.y, xi.z];
        let above = |tries: u32| {
            if tries > 0 {
                [y, z] = [(); 2].map(|()| {
                    bits = pcg(bits);
                    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
                });
            }
            Some(light.point_by_area(y, z)).filter(|place| height(place) > 0.0)
        };
        let place = (0..TRIES_OF_MANY).find_map(above).or_else(|| {
            let corners = light.corners[..light.count].iter();
            corners.copied().max_by(|a, b| height(a).total_cmp(&height(b)))
        })?;
        let side = 1f32.copysign(light.normal.dot(point - place));
        let end = place + light.normal * (side * light.error);
        Some((end, light.radiance * (projected / probability)))
    }

    /// Density per solid angle at which [`PolygonLights::sample`] picks the place of a light that a
    /// ray along the unit `direction` from a point of the surface met; `normal` is the light's there.
    pub fn density(
        &self,
        unoccluded: &Unoccluded,
        (start, start_normal): (Vec3, Vec3),
        hit: &Hit,
        normal: Vec3,
        direction: Vec3,
    ) -> f32 {
        let cell = || self.of_cell[self.cells.find(hit.triangle, [hit.u, hit.v])?];
        let light = self.of_triangle.get(&hit.triangle).copied().or_else(cell);
        let Some(pick) = light.map(|light| light as usize) else { return 0.0 };
        let probability = if self.is_exact() {
            self.closed_forms.probability(unoccluded, pick)
        } else {
            self.tree.probability(pick, start, start_normal)
        };
        let light = &self.closed_forms.lights()[pick];
        if light.is_near(start) {
            return probability / light.solid_angle(start).max(f32::MIN_POSITIVE);
        }
        let cosine = normal.dot(direction).abs().max(f32::MIN_POSITIVE);
        probability * hit.distance * hit.distance / (light.area * cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::sampling::{Seed, Shifted};
    use crate::scene::{Material, Triangle, Vertex};

    /// Of a lamp that the horizon cuts, places above it are all as likely, however many of the first ones lay
    /// below.
    #[test]
    fn places_above_the_horizon_are_all_as_likely() {
        let corner = |x: f32, y: f32| Vertex::new(Vec3::new(x, y, -30.0), Vec3::Z);
        let lamp = Material::lambertian("lamp", Rgb::ZERO);
        let scene = Scene {
            vertices: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| corner(x, y))
                .to_vec(),
            triangles: [[0, 1, 2], [0, 2, 3]]
                .map(|vertices| Triangle { vertices, material: 0 })
                .to_vec(),
            materials: vec![Material { emission: Rgb::ONE, ..lamp }],
            ..Scene::default()
        };
        let world = World::new(Arc::new(scene));
        let cells = PolygonLights::cells(&world);
        let lights = PolygonLights::new(&world.scene, &world.rays, cells, None).expect("a lamp");
        let [low, high, from] = [-1.0, 1.0, 0.0].map(|y| world.rays.place(Vec3::new(0.0, y, 0.0)));
        let sequence = Shifted::new(Seed { number: 3, well_spread: true }, Stream::Light, 1);
        const COUNT: u32 = 4000;
        let mut eighths = [0; 8];
        for n in 0..COUNT {
            let xi = sequence.of_pixel(0, n).triple();
            let Some((end, _)) = lights.one_of_many(from, Vec3::Y, xi) else { continue };
            let height = (end.y - low.y) / (high.y - low.y);
            eighths[((8.0 * height) as usize).min(7)] += 1;
        }
        assert_eq!(eighths[..4], [0; 4], "below the horizon");
        let found: u32 = eighths.iter().sum();
        assert!(found > COUNT * 9 / 10, "{found}");
        for count in &eighths[4..] {
            assert!((*count as f32 / found as f32 - 0.25).abs() < 0.02, "{eighths:?}");
        }
    }
}
