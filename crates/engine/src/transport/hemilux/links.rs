//! Tier 1 on the processor: each element, mostly a patch, traces rays over its hemisphere and
//! remembers the elements that they meet, its *links*; the radiosity equation over the links is then solved by sweeps.
//!
//! A shot serves all receivers, but all of them share its noise, and next to the shooter it is
//! large. Links of different patches are independent, so a second gather averages their noise
//! away: on the Cornell box 100 times cheaper than shots for the same error of the picture.

use super::patch_light::Patched;
use super::shoot::Coarse;
use crate::patches::{NO_PATCH, PatchedScene, nth_cell};
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::rays::{Eye, Spot, inset, unit_normal};
use crate::sampling::{Seed, Shifted, cosine_direction};
use crate::surface::World;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// "Met nothing that reflects."
const DARK: u32 = u32::MAX;
/// "Started inside a body."
pub(super) const COVERED: u32 = u32::MAX - 1;
/// Most links of all patches together: 4 bytes each.
pub(super) const MOST_LINKS: usize = 48 << 20;
/// Most links of a round, unless four a patch are more.
const MOST_AT_ONCE: usize = 4 << 20;
/// Sweeps of a solution at most, and the change at which they end, relative to the mean.
const MOST_SWEEPS: u32 = 400;
const SETTLED: f32 = 2e-4;
/// Patches of a task.
const CHUNK: usize = 256;

/// Least rays of a patch in a round, however small it is.
const LEAST_RAYS: f32 = 4.0;

/// The links of all patches.
#[derive(Default)]
pub struct Links {
    pub(super) rounds: Vec<Round>,
    /// Irradiance that has bounced.
    pub bounced: Vec<Rgb>,
}

/// Links that were traced together: those of patch p are `links[start[p]..start[p + 1]]`.
pub(super) struct Round {
    pub start: Vec<u32>,
    pub links: Vec<u32>,
}

impl Round {
    fn of(&self, patch: usize) -> &[u32] {
        &self.links[self.start[patch] as usize..self.start[patch + 1] as usize]
    }
}

impl Links {
    /// Number of links.
    pub fn count(&self) -> usize {
        self.rounds.iter().map(|round| round.links.len()).sum()
    }

    /// Traces `rays` more rays from each patch of ordinary size, fewer from smaller ones, which
    /// fewer rays meet; as long as there is room for them.
    pub fn trace(&mut self, world: &World, coarse: &Coarse, seed: Seed, rays: u32) {
        let area = &coarse.elements.area;
        let patches = area.len();
        // Meshes of very many triangles have very many patches; the picture must not wait.
        let rays = (rays as f32).min(MOST_AT_ONCE as f32 / patches.max(1) as f32);
        let all: f32 = area.iter().sum();
        let ordinary = area.iter().map(|area| area * (area / all)).sum::<f32>();
        let mut start = Vec::with_capacity(patches + 1);
        let mut end = 0;
        for area in area {
            start.push(end);
            end += (rays * (area / ordinary).min(1.0)).max(LEAST_RAYS).round() as u32;
        }
        start.push(end);
        if self.count() + end as usize > MOST_LINKS && !self.rounds.is_empty() {
            return;
        }
        let links = (0..patches).into_par_iter().with_max_len(64).flat_map_iter(|patch| {
            let alone = coarse.elements.members(patch).len() == 1;
            let points = coarse.elements.points(world, &coarse.scene, patch, 0.0);
            let done = self.rounds.iter().map(|round| round.of(patch).len() as u32).sum();
            let mut sequence = Shifted::new(seed, Stream::PatchLight, patch as u64).at(done);
            (start[patch]..start[patch + 1]).map(move |_| {
                let xi = sequence.next_pair();
                let others;
                let points = if alone {
                    &points
                } else {
                    let x = sequence.triple().x;
                    others = coarse.elements.points(world, &coarse.scene, patch, x);
                    &others
                };
                let (from, normal) = points.point(sequence.second_pair());
                let direction = cosine_direction(normal, xi);
                match world.rays.closest(Eye::Light, from, direction) {
                    None => DARK,
                    Some(hit) if hit.back && !world.is_two_sided(hit.triangle) => COVERED,
                    Some(hit) => coarse.element_at(&hit).unwrap_or(DARK),
                }
            })
        });
        let links = links.collect();
        self.rounds.push(Round { start, links });
    }

    /// Solves the balance B = kd (E_direct + Σ B_link/N) over the links so far.
    pub fn solve(&mut self, albedo: &[Rgb], direct: &[Patched]) {
        let patches = direct.len();
        self.bounced.resize(patches, Rgb::ZERO);
        let rows: Vec<u32> = (0..patches)
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|patch| {
                let links = self.of(patch);
                links.filter(|link| *link != COVERED).count() as u32
            })
            .collect();
        let reflected = |bounced: &[Rgb]| -> Vec<Rgb> {
            let all = direct.par_iter().zip(bounced).zip(albedo).with_min_len(CHUNK);
            all.map(|((direct, bounced), albedo)| *albedo * (direct.irradiance + *bounced))
                .collect()
        };
        for _ in 0..MOST_SWEEPS {
            let radiosity = reflected(&self.bounced);
            let next: Vec<Rgb> = (0..patches)
                .into_par_iter()
                .with_min_len(CHUNK)
                .map(|patch| {
                    let met = self.of(patch).filter_map(|link| radiosity.get(link as usize));
                    met.sum::<Rgb>() / rows[patch].max(1) as f32
                })
                .collect();
            let change = next.iter().zip(&self.bounced).map(|(a, b)| (*a - *b).abs().element_sum());
            let change: f32 = change.sum();
            let sum: f32 = next.iter().map(|e| e.element_sum()).sum();
            self.bounced = next;
            if change <= SETTLED * sum {
                break;
            }
        }
    }

    /// The links of a patch; what is none of a patch met nothing that reflects.
    pub fn of(&self, patch: usize) -> impl Iterator<Item = u32> {
        self.rounds.iter().flat_map(move |round| round.of(patch).iter().copied())
    }
}

/// A patch to pick points of, in ray units.
pub struct PatchPoints {
    corners: [Vec3; 3],
    /// Of the front.
    normal: Vec3,
    cell: [Vec2; 3],
    inset: f32,
    back: bool,
}

impl PatchPoints {
    /// The points of a patch.
    pub fn new(world: &World, scene: &PatchedScene, patch: u32) -> Self {
        let facet = &scene.facets[scene.patches.facet[patch as usize] as usize];
        let back = facet.back != NO_PATCH && patch >= facet.back;
        let first = if back { facet.back } else { facet.front };
        let cell = nth_cell(facet.divisions, patch - first);
        let corners = facet.corners.map(|c| world.rays.place(scene.positions[c as usize]));
        Self { corners, normal: unit_normal(corners), cell, inset: inset(corners), back }
    }

    fn corner(&self, at: Vec2) -> Vec3 {
        let [a, b, c] = self.corners;
        a * (1.0 - at.x - at.y) + b * at.x + c * at.y
    }

    /// Area, ray units.
    pub fn area(&self) -> f32 {
        let [a, b, c] = self.cell.map(|at| self.corner(at));
        0.5 * (b - a).cross(c - a).length()
    }

    /// Unit normal of its side.
    pub fn normal(&self) -> Vec3 {
        if self.back { -self.normal } else { self.normal }
    }

    /// Centre and radius of a ball around it.
    pub fn ball(&self) -> (Vec3, f32) {
        let corners = self.cell.map(|at| self.corner(at));
        let center = (corners[0] + corners[1] + corners[2]) / 3.0;
        (center, corners.iter().map(|corner| corner.distance(center)).fold(0.0, f32::max))
    }

    /// The point for two uniform numbers, off the surface by the rounding error, and the normal.
    pub fn point(&self, [x, y]: [f32; 2]) -> (Vec3, Vec3) {
        let [a, b, c] = self.cell;
        let root = x.sqrt();
        let at = a * (1.0 - root) + b * (root * (1.0 - y)) + c * (root * y);
        let at = at.lerp(Vec2::splat(1.0 / 3.0), self.inset);
        let spot = Spot::new(self.corners, self.normal, at.x, at.y);
        let normal = if self.back { -spot.normal } else { spot.normal };
        (spot.off_surface(normal), normal)
    }
}
