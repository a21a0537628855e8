//! What lobes send to elements. Links take every surface for diffuse, so the direction in which a lobe
//! reflects is lost to them; where much of the light comes from lobes, further rays find what is lacking.

use super::elements::ElementIndex;
use super::links::{Links, ordinary_area};
use super::mesh::CoarseMesh;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::{Afresh, Seed, Shifted, cosine_direction};
use crate::surface::World;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Elements that a thread looks at together.
const CHUNK: usize = 64;
/// Below that share of its light an element's lobes are left to the links.
const LEAST_SHARE: f32 = 0.02;
/// Share of its light by lobes from which on an element gets all the rays of a round.
const FULL_SHARE: f32 = 0.5;

/// Sums of what rays of each element found.
#[derive(Clone, Default)]
pub struct ByLobes {
    /// Of each element, how much of the light by its links comes from lobes that are not sharp; empty
    /// where there are none.
    shares: Vec<f32>,
    /// Sums of radiance beyond what links say, and numbers of rays; empty before the first.
    found: Vec<(Rgb, u32)>,
}

impl ByLobes {
    /// Finds how much of each element's light comes from lobes, by what each element sends.
    pub fn share_out(&mut self, mesh: &CoarseMesh, links: &Links, radiosity: &[f32]) {
        let elements = (0..radiosity.len()).into_par_iter().with_min_len(CHUNK);
        let of_lobe = |element: usize| {
            // Elements are of one material, but for textures.
            let member = mesh.elements.members(ElementIndex(element as u32)).first();
            let reflectance = member.map(|patch| mesh.cut.reflectance(*patch).0);
            let share = reflectance.filter(|found| !found.is_sharp()).map_or(0.0, |found| {
                let parts = [found.specular, found.diffuse].map(|part| part.element_sum());
                parts[0] / (parts[0] + parts[1]).max(1e-6)
            });
            radiosity[element] * share
        };
        let by_lobe: Vec<f32> = elements.clone().map(of_lobe).collect();
        self.shares.clear();
        if by_lobe.iter().any(|sent| *sent > 0.0) {
            let share = |element: usize| {
                let [lobes, all] = [&by_lobe[..], radiosity]
                    .map(|sent| links.mean(ElementIndex(element as u32), sent));
                lobes / all.max(1e-30)
            };
            self.shares = elements.map(share).collect();
        }
    }

    /// The share of an element's light that comes from lobes; 0 where it is to be left to links.
    pub fn share(&self, element: ElementIndex) -> f32 {
        let share = self.shares.get(element.at()).copied().unwrap_or_default();
        if share >= LEAST_SHARE { share } else { 0.0 }
    }

    /// Whether there are no lobes at all, so that nobody need ask for shares.
    pub fn is_empty(&self) -> bool {
        self.shares.is_empty()
    }

    /// Whether no element has light by lobes that is to be followed.
    pub fn is_idle(&self) -> bool {
        self.shares.iter().all(|share| *share < LEAST_SHARE)
    }

    /// Sends up to `rays` more rays from each element of ordinary size, fewer from smaller ones: `lacking`
    /// says what radiance comes along a ray from a point in a direction beyond what links say.
    pub fn trace(
        &mut self,
        (world, mesh): (&World, &CoarseMesh),
        seed: Seed,
        rays: u32,
        lacking: impl Fn(Vec3, Vec3, Afresh) -> Rgb + Sync,
    ) {
        self.found.resize(mesh.elements.len(), (Rgb::ZERO, 0));
        let (shares, areas) = (&self.shares, &mesh.elements.counted);
        let ordinary = ordinary_area(areas);
        let found = self.found.par_iter_mut().enumerate().with_min_len(CHUNK);
        found.for_each(|(element, (sum, count))| {
            let share = shares.get(element).copied().unwrap_or_default();
            if share < LEAST_SHARE {
                return;
            }
            let worth = (share / FULL_SHARE).min(1.0) * (areas[element] / ordinary).min(1.0);
            let more = (rays as f32 * worth).ceil() as u32;
            let mut sequence = Shifted::new(seed, Stream::FollowedLobe, element as u64).at(*count);
            for _ in 0..more {
                let xi = sequence.next_pair();
                let x = sequence.triple().x;
                let element = ElementIndex(element as u32);
                let points = mesh.elements.points(world, &mesh.cut, element, x);
                let (xi_there, beside) = (sequence.second_pair(), sequence.beside());
                let lit = mesh.elements.lit_point(world, element, &points, xi_there, beside);
                let direction = cosine_direction(lit.lit_normal, xi);
                if lit.normal.dot(direction) > 0.0 {
                    *sum += lacking(lit.start, direction, sequence.apart());
                }
            }
            *count += more;
        });
    }

    /// Irradiance of each element beyond what links say; `None` before the first ray.
    pub fn beyond(&self) -> Option<Vec<Rgb>> {
        let mean = |(sum, count): &(Rgb, u32)| *sum * (PI / (*count).max(1) as f32);
        (!self.found.is_empty()).then(|| self.found.iter().map(mean).collect())
    }

    /// Bytes that they take, about.
    pub fn held_bytes(&self) -> u64 {
        (size_of_val(&*self.shares) + size_of_val(&*self.found)) as u64
    }

    /// Writes what rays found.
    pub fn save(&self, to: &mut Writer) {
        let (sums, counts): (Vec<Rgb>, Vec<u32>) = self.found.iter().copied().unzip();
        to.value(counts.len() as u64);
        to.slice(&counts);
        to.slice(&sums);
    }

    /// Reads what [`ByLobes::save`] wrote of so many elements.
    pub fn restore(elements: usize, from: &mut Reader<'_>) -> Result<Self, CheckpointError> {
        let count = from.count(elements as u64)? as usize;
        let counts: Vec<u32> = from.exactly(count)?;
        let sums: Vec<Rgb> = from.exactly(count)?;
        Ok(Self { shares: Vec::new(), found: sums.into_iter().zip(counts).collect() })
    }
}
