//! Light that small bright elements send to others, such as a patch of sun, by rays that are aimed at
//! them. Of the links over the hemisphere few meet such elements, and each of these brings much: how bright
//! a whole room is hangs on them. Here aimed rays say how much of the emitters' light bright elements
//! reflect to each other element, beside the links: each pair of elements is shared between the two by
//! the balance heuristic (Veach 1997), so that neither's rare rays count for much.

use super::elements::ElementIndex;
use super::glow::Sources;
use super::guide::{Guide, Met};
use super::links::{LEAST_TINT, Links};
use super::mesh::CoarseMesh;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::patches::PatchIndex;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::rays::Eye;
use crate::sampling::{Seed, Shifted};
use crate::surface::World;
use crate::transport::patch_points::PatchPoints;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::Arc;

/// Aimed rays of each element in a round.
const RAYS: usize = 4;
/// Most rounds.
const MOST_ROUNDS: usize = 64;
/// Most aimed rays of all elements together, 8 bytes each: 128 MiB.
const MOST_RAYS: usize = 16 << 20;
/// Aimed rays of an element for each of its links, about.
const RAYS_PER_LINK: f32 = 0.25;
/// Least distance between the middles of two elements, in those of the bright one's farthest corner
/// beyond the other's, at which rays are aimed: nearer ones meet it by many links, and what an aimed ray
/// says there scatters without bound, most of all where both are long and thin, as slats of a blind.
const LEAST_DISTANCE: f32 = 4.0;
/// Elements of a parallel task.
const CHUNK: usize = 256;
/// Most members of an element that its middle is found by.
const MOST_MEMBERS: usize = 16;

/// Aimed rays of all elements.
#[derive(Clone)]
pub struct Aimed {
    targets: Arc<Targets>,
    /// [`RAYS`] of each element in each round.
    rounds: Vec<Arc<Vec<Found>>>,
}

/// What is aimed at: always the same, so that what older rays found remains of use.
struct Targets {
    guide: Arc<Guide>,
    /// A patch of each element that is bright.
    bright: Vec<Option<PatchIndex>>,
    places: Vec<Middle>,
}

/// Where an element is, in ray units.
#[derive(Clone, Copy)]
struct Middle {
    point: Vec3,
    normal: Vec3,
    /// Farthest that a corner is from the middle.
    reach: f32,
}

/// What an aimed ray found: an element, and the irradiance that a radiosity of 1 there stands for, of the
/// share that is not left to links.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Found {
    element: u32,
    weight: f32,
}

impl Targets {
    fn new(world: &World, mesh: &CoarseMesh, guide: Arc<Guide>) -> Self {
        let elements = &mesh.elements;
        // Of what bends light, links say what it reflects.
        let bends = |triangle: u32| world.is_clear(triangle) || world.may_mirror(triangle);
        let mut bright = vec![None; elements.len()];
        for (element, _) in guide.bright() {
            let members = elements.members(*element);
            let mut places = members.iter().filter_map(|patch| mesh.cut.place_in(*patch, 0, 1));
            if !places.any(|(triangle, ..)| bends(triangle)) {
                bright[element.at()] = members.first().copied();
            }
        }
        let place = |element: usize| {
            let members = elements.members(ElementIndex(element as u32));
            let some = members.iter().step_by(members.len().div_ceil(MOST_MEMBERS).max(1));
            let points = |patch: &PatchIndex| PatchPoints::in_cut(world, &mesh.cut, *patch, 0.5);
            let all: Vec<PatchPoints> = some.map(points).collect();
            let point = all.iter().map(|points| points.ball().0).sum::<Vec3>();
            let point = point / all.len().max(1) as f32;
            let reach = |points: &PatchPoints| {
                let (center, radius) = points.ball();
                center.distance(point) + radius
            };
            let reach = all.iter().map(reach).fold(0.0, f32::max);
            let normal = all.iter().map(PatchPoints::normal).sum::<Vec3>().normalize_or_zero();
            Middle { point, normal, reach }
        };
        let all = (0..elements.len()).into_par_iter().with_min_len(CHUNK);
        Self { guide, bright, places: all.map(place).collect() }
    }

    /// Whether a link leads to a bright element.
    fn is_bright(&self, link: ElementIndex) -> bool {
        self.bright.get(link.at()).is_some_and(Option::is_some)
    }

    /// The share of what an element sends to another one, `from`, that aimed rays say, as the balance
    /// heuristic has it of the middles of both; links say the rest. The density of aiming is in
    /// proportion to what bright elements send to wherever: rays at one that sends `from` more than
    /// most would be few, each with a weight without bound.
    fn share(&self, from: usize, to: u32) -> f32 {
        let Some(patch) = self.bright.get(to as usize).copied().flatten() else { return 0.0 };
        let [own, other] = [self.places[from], self.places[to as usize]];
        let way = other.point - own.point;
        let distance = way.length();
        if distance <= LEAST_DISTANCE * other.reach + own.reach {
            return 0.0;
        }
        let direction = way / distance;
        let met = Met { patch, distance, cosine: other.normal.dot(direction) };
        let aimed = RAYS_PER_LINK * self.guide.density(own.point, own.normal, &met);
        let by_links = own.normal.dot(direction).max(0.0) / PI;
        if aimed > 0.0 { aimed / (aimed + by_links) } else { 0.0 }
    }
}

impl Aimed {
    /// None yet, at the elements that gather rays are aimed at.
    pub fn new(world: &World, mesh: &CoarseMesh, guide: Arc<Guide>) -> Self {
        Self { targets: Arc::new(Targets::new(world, mesh, guide)), rounds: Vec::new() }
    }

    /// Rounds so far.
    pub fn rounds(&self) -> usize {
        self.rounds.len()
    }

    /// Aims so many more rounds of rays, as long as there is room.
    pub fn trace(&mut self, world: &World, mesh: &CoarseMesh, seed: Seed, rounds: usize) {
        let elements = mesh.elements.len();
        for _ in 0..rounds {
            let round = self.rounds.len();
            if round > 0 && (round >= MOST_ROUNDS || (round + 1) * RAYS * elements > MOST_RAYS) {
                return;
            }
            let found = |ray: usize| {
                let (element, number) = (ray / RAYS, round * RAYS + ray % RAYS);
                let sequence = Shifted::new(seed, Stream::Aimed, element as u64);
                self.aim(world, mesh, element, sequence.at(number as u32))
            };
            let rays = (0..elements * RAYS).into_par_iter().with_min_len(CHUNK);
            let all = rays.map(|ray| found(ray).unwrap_or(Found { element: 0, weight: 0.0 }));
            let all = all.collect();
            self.rounds.push(Arc::new(all));
        }
    }

    /// Aims a ray from a point of an element; `None` where it has missed.
    fn aim(
        &self,
        world: &World,
        mesh: &CoarseMesh,
        element: usize,
        mut sequence: Shifted,
    ) -> Option<Found> {
        let guide = &self.targets.guide;
        let [x, _] = sequence.next_pair();
        let from = ElementIndex(element as u32);
        let points = mesh.elements.points(world, &mesh.cut, from, x);
        let (xi, beside) = (sequence.afresh().bounce, sequence.beside());
        let lit = mesh.elements.lit_point(world, from, &points, xi, beside);
        let aim = guide.aim(lit.start, lit.lit_normal, sequence.triple())?;
        if lit.normal.dot(aim.direction) <= 0.0 {
            return None;
        }
        let to = mesh.elements.of(aim.patch)?;
        let share = self.targets.share(element, to.0);
        if share <= 0.0 {
            return None;
        }
        let hit = world.rays.closest(Eye::Light, lit.start, aim.direction)?;
        let passage = world.reach(hit, aim.direction, true)?;
        let met = passage.met().filter(|met| mesh.patch_at(met) == Some(aim.patch))?;
        mesh.spot_at(world, &met).filter(|(element, _)| *element == to)?;
        let left = passage.left.max_element();
        if (Rgb::splat(left) - passage.left).max_element() > LEAST_TINT * left {
            return None;
        }
        let cosine = world.rays.spot(&met).normal.dot(aim.direction);
        let met = Met { patch: aim.patch, distance: passage.way, cosine };
        let density = guide.density(lit.start, lit.lit_normal, &met);
        let weight = share * left * lit.lit_normal.dot(aim.direction) / (PI * density);
        (weight.is_finite() && weight > 0.0).then_some(Found { element: to.0, weight })
    }

    /// By how much what aimed rays find of their share of the emitters' light that bright elements reflect,
    /// and of their glow, is more than what `links` say of it, by element; links that
    /// glass or mirrors bent or coloured on their way say of something else.
    pub fn beyond(&self, links: &Links, albedo: &[Rgb], sources: Sources<'_>) -> Vec<Rgb> {
        let Sources { direct, glow, .. } = sources;
        let sent = |element: u32| {
            let element = element as usize;
            let glow = glow.get(element).copied().unwrap_or_default();
            albedo[element] * direct[element].reflected_as + glow
        };
        let rays = (self.rounds.len() * RAYS).max(1) as f32;
        let of_element = |element: usize| {
            let (mut by_links, mut count, mut rows) = (Rgb::ZERO, 0.0f32, 0.0f32);
            for (link, is_straight) in links.ways(ElementIndex(element as u32)) {
                count += 1.0;
                rows += if Links::counts(link) { 1.0 } else { 0.0 };
                let is_bright = is_straight && self.targets.is_bright(link);
                if is_bright {
                    by_links += sent(link.0) * self.targets.share(element, link.0);
                }
            }
            let own = element * RAYS..(element + 1) * RAYS;
            let found = self.rounds.iter().flat_map(|round| &round[own.clone()]);
            let met = found.filter(|found| found.weight > 0.0);
            let by_aim: Rgb = met.map(|found| sent(found.element) * found.weight).sum();
            // Rays from inside a body do not count, among either.
            (by_aim / rays * count - by_links) / rows.max(1.0)
        };
        (0..direct.len()).into_par_iter().with_min_len(CHUNK).map(of_element).collect()
    }

    /// Bytes that they take, about.
    pub fn held_bytes(&self) -> u64 {
        let rounds: usize = self.rounds.iter().map(|round| size_of_val(&***round)).sum();
        let Targets { bright, places, .. } = &*self.targets;
        (rounds + size_of_val(&**bright) + size_of_val(&**places)) as u64
    }

    /// Writes them.
    pub fn save(&self, to: &mut Writer) {
        let (elements, powers): (Vec<u32>, Vec<f32>) =
            self.targets.guide.bright().iter().map(|(element, power)| (element.0, *power)).unzip();
        to.slice(&elements);
        to.slice(&powers);
        to.value(self.rounds.len() as u64);
        for round in &self.rounds {
            to.slice(round);
        }
    }

    /// Reads what [`Aimed::save`] wrote of a mesh.
    pub fn restore(
        world: &World,
        mesh: &CoarseMesh,
        from: &mut Reader<'_>,
    ) -> Result<Self, CheckpointError> {
        let count = mesh.elements.len();
        let damaged = |what: &str| CheckpointError::damaged(what);
        let elements: Vec<u32> = from.slice()?;
        let powers: Vec<f32> = from.exactly(elements.len())?;
        let is_sound = elements.iter().all(|element| (*element as usize) < count)
            && powers.iter().all(|power| power.is_finite() && *power > 0.0);
        let bright = elements.into_iter().map(ElementIndex).zip(powers).collect();
        let guide = Guide::of(world, mesh, bright).filter(|_| is_sound);
        let guide =
            guide.ok_or_else(|| damaged("what its rays are aimed at is not in the scene"))?;
        let mut this = Self::new(world, mesh, Arc::new(guide));
        for _ in 0..from.count(MOST_ROUNDS as u64)? {
            let round: Vec<Found> = from.exactly(count * RAYS)?;
            let is_sound =
                |found: &Found| (found.element as usize) < count && found.weight.is_finite();
            if !round.iter().all(is_sound) {
                return Err(damaged("its aimed rays are not of these elements"));
            }
            this.rounds.push(Arc::new(round));
        }
        Ok(this)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{SEED, Specimen};

    /// In a room with a patch of sun, aimed rays and links agree on what it sends, within their noise,
    /// through a pane, too, and come back from a checkpoint.
    #[test]
    fn aimed_rays_and_links_agree() {
        for house in [made::real::window(), made::real::glazed(0.0)] {
            let mut specimen = Specimen::surrounded(&house.glb, house.environment, 4000);
            for _ in 0..3 {
                specimen.coarse.link(SEED, 0, 256);
            }
            let (world, coarse) = (&specimen.world, &specimen.coarse);
            let guide = coarse.guide.clone().expect("the patch of sun is bright");
            let mut aimed = Aimed::new(world, &coarse.mesh, guide);
            aimed.trace(world, &coarse.mesh, SEED, 16);
            let (links, albedo, sources) = coarse.parts();
            let elements = &coarse.mesh.elements;
            let power = |of: &[Rgb]| -> f32 {
                of.iter().zip(&elements.area).map(|(own, area)| own.element_sum() * area).sum()
            };
            let beyond = aimed.beyond(links, albedo, sources);
            let all = power(&links.bounced);
            let none = Aimed::new(world, &coarse.mesh, aimed.targets.guide.clone());
            let by_links = -power(&none.beyond(links, albedo, sources));
            let name = house.name;
            assert!(by_links > 0.1 * all, "{name}: the patch of sun sends {by_links} of {all}");
            let more = power(&beyond);
            assert!(more.abs() < 0.1 * by_links, "{name}: {more} beside {by_links}");
            let mut to = Writer::new(u64::MAX);
            aimed.save(&mut to);
            let bytes = to.finish().expect("there is room");
            let again =
                Aimed::restore(world, &coarse.mesh, &mut Reader::new(&bytes)).expect("sound");
            assert_eq!(again.beyond(links, albedo, sources), beyond);
        }
    }

    /// Slats of a blind are long and thin, and the middles of two may be far apart where they nearly touch:
    /// one aimed ray there had the weight of 600 links.
    #[test]
    fn no_aimed_ray_counts_for_much() {
        let specimen = Specimen::new(&made::blinds(), 16_000);
        let (world, coarse) = (&specimen.world, &specimen.coarse);
        let guide = coarse.guide.clone().expect("slats that face the window are bright");
        let mut aimed = Aimed::new(world, &coarse.mesh, guide);
        aimed.trace(world, &coarse.mesh, SEED, 32);
        let weights =
            || aimed.rounds.iter().flat_map(|round| round.iter()).map(|found| found.weight);
        let count = weights().filter(|weight| *weight > 0.0).count();
        assert!(count > 10_000, "{count} rays met what they were aimed at");
        let most = weights().fold(0.0, f32::max);
        assert!(most < 8.0, "{most}: all light that arrives weighs 1");
    }
}
