//! Tier 1: the light of the whole scene on a coarse mesh. Direct light at points of every patch by
//! the closed form and shadow rays; everything that bounces over the links between patches. It is
//! only ever seen through gathers.

use super::elements::Elements;
use super::guide::Guide;
use super::links::Links;
use super::lobe::{self, Through};
use super::patch_light::{Patched, Sampled};
use crate::emitters::PolygonLights;
use crate::measurement::reconstruction::{Reconstruction, Smoothness};
use crate::patches::{Facet, PatchedScene, cell_index};
use crate::radiometry::{Rgb, importance};
use crate::rays::{Eye, Hit};
use crate::sampling::{Afresh, Next, Seed, cosine_direction};
use crate::surface::{Surface, World};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::Arc;

/// Most points of all patches together whose direct light is found at a time, unless one a patch
/// is more.
const MOST_POINTS: usize = 1 << 20;

/// Nearer than so many sides of a patch its mean does not do: light there varies within it.
const NEAR_FIELD: f32 = 2.0;

/// Share of the rays that find what has bounced that is aimed at bright patches, where there are
/// such.
const AIMED_BOUNCES: f32 = 0.3;
/// How often a lobe that a gather ray meets is followed: so many times its share of what the surface
/// reflects, and at least so often; and how many lobes from there.
const LOBES: f32 = 2.0;
const LEAST_LOBES: f32 = 0.1;
const MOST_LOBES: u32 = 2;

/// Smoothing changes a patch's value by this factor at most.
const MOST_CHANGE: f32 = 2.5;

/// The coarse solution.
pub struct Coarse {
    pub(super) world: Arc<World>,
    pub(super) lights: Arc<PolygonLights>,
    /// The mesh.
    pub scene: Arc<PatchedScene>,
    reconstruction: Reconstruction,
    /// Facets of scene triangle t: `pieces[t]..pieces[t + 1]`.
    pieces: Vec<u32>,
    /// Distance within which a facet's patches are too large to be seen from, ray units.
    near: Vec<f32>,
    /// Direct light of the elements, point by point.
    pub(super) sampled: Vec<Sampled>,
    pub(super) direct: Vec<Patched>,
    pub(super) links: Links,
    /// Patches that gather rays are aimed at.
    pub guide: Option<Guide>,
    /// What the light is solved for.
    pub elements: Elements,
    /// Irradiance, direct and indirect.
    both: Values,
    /// The same, indirect only.
    indirect: Values,
}

/// A quantity on the mesh.
#[derive(Default)]
struct Values {
    patches: Vec<Rgb>,
    /// At the vertices of the reconstruction.
    vertices: Vec<Rgb>,
}

impl Coarse {
    /// Lights the patches directly, by `points` points each, unless `sampled` already says how.
    pub fn new(
        world: Arc<World>,
        lights: Arc<PolygonLights>,
        scene: Arc<PatchedScene>,
        elements: Elements,
        points: u32,
        seed: Seed,
        sampled: Option<Vec<Sampled>>,
    ) -> Self {
        let triangles = scene.scene.triangles.len();
        let mut pieces = vec![0u32; triangles + 1];
        for facet in &scene.facets {
            pieces[facet.source as usize + 1] += 1;
        }
        for triangle in 0..triangles {
            pieces[triangle + 1] += pieces[triangle];
        }
        let near = |facet: &Facet| {
            let [a, b, c] = facet.corners.map(|c| world.rays.place(scene.positions[c as usize]));
            NEAR_FIELD * (b - a).cross(c - a).length().sqrt() / facet.divisions as f32
        };
        let mut near: Vec<f32> = scene.facets.iter().map(near).collect();
        for element in (0..elements.len()).filter(|element| elements.members(*element).len() > 1) {
            let area = elements.area[element] * (world.rays.scale() as f32).powi(2);
            for patch in elements.members(element) {
                let near = &mut near[scene.patches.facet[*patch as usize] as usize];
                *near = near.max(NEAR_FIELD * (2.0 * area).sqrt());
            }
        }
        let count = elements.len();
        let points = points.min(most_points(count));
        let reconstruction = Reconstruction::new(&scene, Smoothness::Smooth);
        let mut this = Self {
            world,
            lights,
            scene,
            reconstruction,
            pieces,
            near,
            sampled: sampled.unwrap_or_default(),
            direct: Vec::new(),
            links: Links::default(),
            guide: None,
            elements,
            both: Values::default(),
            indirect: Values::default(),
        };
        if this.sampled.is_empty() {
            this.sampled = vec![Sampled::default(); count];
            this.light(seed, points);
        }
        this.look();
        this
    }

    /// Lights more points of each element.
    fn light(&mut self, seed: Seed, points: u32) {
        let (world, lights) = (&*self.world, &*self.lights);
        let (scene, elements) = (&self.scene, &self.elements);
        self.sampled.par_iter_mut().enumerate().with_max_len(256).for_each(|(element, sampled)| {
            sampled.add(world, lights, scene, elements, element, points, seed);
        });
    }

    /// Takes what the points say.
    fn look(&mut self) {
        self.direct = self.sampled.iter().map(Sampled::mean).collect();
    }

    /// Lights more points of each element, traces more links and solves for them, and makes that
    /// what hits look up.
    pub fn link(&mut self, seed: Seed, points: u32, rays: u32) {
        if points > 0 {
            self.light(seed, points.min(most_points(self.elements.len())));
            self.look();
        }
        let mut links = std::mem::take(&mut self.links);
        links.trace(&self.world, self, seed, rays);
        links.solve(&self.elements.albedo, &self.direct);
        self.links = links;
        self.refresh();
    }

    /// Irradiance of each patch, direct and indirect.
    pub fn irradiances(&self) -> &[Rgb] {
        &self.both.patches
    }

    /// Takes what is near as what is far: by the means of its patches.
    pub fn ignore_near_field(&mut self) {
        self.near.fill(0.0);
    }

    /// Links so far.
    pub fn links(&self) -> usize {
        self.links.count()
    }

    pub(super) fn refresh(&mut self) {
        let patches = self.scene.patches.len();
        let mut both = vec![Rgb::ZERO; patches];
        let mut indirect = both.clone();
        for patch in 0..patches {
            let Some(element) = self.elements.of(patch as u32) else { continue };
            let lit = &self.direct[element as usize];
            if lit.open <= 0.0 {
                continue;
            }
            let bounced = self.links.bounced.get(element as usize).copied().unwrap_or_default();
            (indirect[patch], both[patch]) = (bounced, bounced + lit.irradiance);
        }
        let smooth = |patches: Vec<Rgb>| {
            let vertices = self.reconstruction.apply(&patches);
            Values { patches, vertices }
        };
        (self.both, self.indirect) = (smooth(both), smooth(indirect));
        let all = self.elements.albedo.iter().enumerate();
        let radiosity = all.map(|(element, albedo)| {
            let patch = self.elements.members(element)[0];
            importance(*albedo * self.both.patches[patch as usize].max(Rgb::ZERO))
        });
        let radiosity: Vec<f32> = radiosity.collect();
        self.guide = Guide::new(&self.world, &self.scene, &self.elements, &self.links, &radiosity);
    }

    /// The patch at a hit; `None` at a black back.
    pub fn patch_at(&self, hit: &Hit) -> Option<u32> {
        let (facet, at) = self.facet_at(hit)?;
        let piece = &self.scene.facets[facet];
        let first = piece.first_patch(hit.back)?;
        Some(first + cell_index(piece.divisions, at.x, at.y))
    }

    /// The element at a hit; `None` at a black back and inside of closed bodies.
    pub fn element_at(&self, hit: &Hit) -> Option<u32> {
        self.elements.of(self.patch_at(hit)?)
    }

    /// Facet of a hit and barycentric coordinates there.
    fn facet_at(&self, hit: &Hit) -> Option<(usize, Vec2)> {
        let triangle = hit.triangle as usize;
        let (first, end) = (self.pieces[triangle] as usize, self.pieces[triangle + 1] as usize);
        if end == first + 1 {
            return Some((first, Vec2::new(hit.u, hit.v)));
        }
        let mut found = None;
        let mut nearest = f32::NEG_INFINITY;
        for facet in first..end {
            let at = in_piece(&self.scene.facets[facet].source_uv, hit.u, hit.v);
            let inside = at.x.min(at.y).min(1.0 - at.x - at.y);
            if inside > nearest {
                (nearest, found) = (inside, Some((facet, at)));
            }
            if inside >= 0.0 {
                break;
            }
        }
        found
    }

    fn on_facet(&self, values: &Values, facet: usize, back: bool, at: Vec2) -> Rgb {
        let (u, v) = (at.x.clamp(0.0, 1.0), at.y.clamp(0.0, 1.0 - at.x.clamp(0.0, 1.0)));
        let piece = &self.scene.facets[facet];
        let Some(corners) = self.reconstruction.corners(facet, back, piece, u, v) else {
            return Rgb::ZERO;
        };
        let all = corners.iter();
        let smooth: Rgb =
            all.map(|(vertex, weight)| values.vertices[*vertex as usize] * *weight).sum();
        // A vertex may hear patches on the other side of a wall that stands there.
        let Some(first) = piece.first_patch(back) else { return Rgb::ZERO };
        let own = values.patches[(first + cell_index(piece.divisions, u, v)) as usize];
        smooth.clamp(own / MOST_CHANGE, own * MOST_CHANGE)
    }

    /// Share of the emitters' light that gets to a patch.
    fn share(&self, facet: usize, back: bool, at: Vec2) -> f32 {
        let piece = &self.scene.facets[facet];
        let first = piece.first_patch(back);
        let u = at.x.clamp(0.0, 1.0);
        let cell = cell_index(piece.divisions, u, at.y.clamp(0.0, 1.0 - u));
        let element = first.and_then(|first| self.elements.of(first + cell));
        element.map_or(0.0, |element| self.direct[element as usize].share)
    }

    /// Irradiance that has bounced, at barycentric coordinates of a facet of the mesh.
    pub fn bounced(&self, facet: usize, back: bool, at: Vec2) -> Rgb {
        self.on_facet(&self.indirect, facet, back, at)
    }

    /// Irradiance from the emitters, at barycentric coordinates of a facet of the mesh.
    pub fn direct(&self, facet: usize, back: bool, at: Vec2) -> Rgb {
        self.on_facet(&self.both, facet, back, at) - self.on_facet(&self.indirect, facet, back, at)
    }

    /// Radiance that a hit reflects against the `direction` of the ray. With random numbers the
    /// light there is found out afresh: the emitters' by a shadow ray, what a lobe reflects, at
    /// times, by another ray, and, where the patch is so near that its mean will not do, what has
    /// bounced by one more.
    pub fn reflected(&self, hit: &Hit, direction: Vec3, afresh: Option<Afresh>) -> Rgb {
        let Some(surface) = self.world.surface(hit) else { return Rgb::ZERO };
        let numbers = afresh.filter(|_| surface.reflectance.is_glossy());
        let Some((numbers, next)) = numbers.and_then(|numbers| Some((numbers, numbers.next?)))
        else {
            return self.by_albedo(&surface, surface.albedo(), hit, afresh);
        };
        let diffuse = self.by_albedo(&surface, surface.reflectance.diffuse, hit, Some(numbers));
        let probability =
            (LOBES * (1.0 - surface.diffuse_share(-direction))).clamp(LEAST_LOBES, 1.0);
        if next.number() >= probability {
            return diffuse;
        }
        let numbers = Afresh { next: Some(next.after()), ..next.afresh() };
        let through = Through { xi: numbers.bounce, numbers, most: MOST_LOBES };
        diffuse + lobe::reflected(self, surface, -direction, through).0 / probability
    }

    /// The same as if all of it were reflected diffusely.
    pub fn reflected_as_diffuse(&self, hit: &Hit, afresh: Option<Afresh>) -> Rgb {
        let Some(surface) = self.world.surface(hit) else { return Rgb::ZERO };
        self.by_albedo(&surface, surface.albedo(), hit, afresh)
    }

    /// The same of the diffuse part alone.
    pub fn reflected_diffusely(&self, hit: &Hit, numbers: Afresh) -> Rgb {
        let Some(surface) = self.world.surface(hit) else { return Rgb::ZERO };
        self.by_albedo(&surface, surface.reflectance.diffuse, hit, Some(numbers))
    }

    fn by_albedo(&self, surface: &Surface, albedo: Rgb, hit: &Hit, afresh: Option<Afresh>) -> Rgb {
        if albedo == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let Some((facet, at)) = self.facet_at(hit) else { return Rgb::ZERO };
        let Some(afresh) = afresh else {
            return albedo * self.on_facet(&self.both, facet, hit.back, at) / PI;
        };
        let (start, normal) = (surface.start(), surface.normal);
        let direct = self.lights.once(&self.world.rays, start, normal, afresh.light);
        let direct = direct.irradiance(self.share(facet, hit.back, at));
        let bounced = match afresh.next {
            Some(next) if hit.distance < self.near[facet] => {
                self.bounced_by_ray(start, normal, afresh.bounce, next)
            }
            _ => self.on_facet(&self.indirect, facet, hit.back, at),
        };
        albedo * (bounced + direct) / PI
    }

    /// Irradiance that has bounced, by one ray: some of them are aimed at bright patches (balance
    /// heuristic, Veach 1997).
    fn bounced_by_ray(&self, start: Vec3, normal: Vec3, xi: [f32; 2], next: Next) -> Rgb {
        let aimed_share = if self.guide.is_some() { AIMED_BOUNCES } else { 0.0 };
        let guide = self.guide.as_ref();
        let aim = match guide.filter(|_| next.number() < aimed_share) {
            // Other numbers than those that light is found by behind it.
            Some(guide) => match guide.aim(start, normal, next.after().afresh().light) {
                Some(aim) => Some(aim),
                None => return Rgb::ZERO,
            },
            None => None,
        };
        let direction =
            aim.as_ref().map_or_else(|| cosine_direction(normal, xi), |aim| aim.direction);
        let Some(hit) = self.world.rays.closest(Eye::Light, start, direction) else {
            return Rgb::ZERO;
        };
        let mut weight = 1.0;
        if let Some(guide) = guide {
            let patch = self.patch_at(&hit);
            if aim.is_some_and(|aim| Some(aim.patch) != patch) {
                return Rgb::ZERO;
            }
            let cosine = self.world.rays.spot(&hit).normal.dot(direction);
            let density = patch
                .map_or(0.0, |patch| guide.density(start, normal, patch, hit.distance, cosine));
            let height = normal.dot(direction).max(f32::MIN_POSITIVE);
            weight = height / (height * (1.0 - aimed_share) + aimed_share * PI * density);
        }
        weight * PI * self.reflected_as_diffuse(&hit, Some(next.afresh()))
    }
}

/// Most points of each of so many elements at a time.
fn most_points(elements: usize) -> u32 {
    ((MOST_POINTS / elements.max(1)) as u32).max(1)
}

/// Barycentric coordinates in a piece of the barycentric (u, v) of its triangle.
fn in_piece(corners: &[Vec2; 3], u: f32, v: f32) -> Vec2 {
    let [a, b, c] = *corners;
    let (ab, ac, p) = (b - a, c - a, Vec2::new(u, v) - a);
    let determinant = ab.perp_dot(ac);
    Vec2::new(p.perp_dot(ac), ab.perp_dot(p)) / determinant
}
