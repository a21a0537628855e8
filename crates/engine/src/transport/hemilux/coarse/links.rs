//! Links of the coarse mesh (tier 1): each element, mostly a patch, traces rays over its hemisphere
//! and remembers the elements that they meet, its *links*; the radiosity equation over the links is
//! then solved by Jacobi sweeps.
//!
//! A hemicube shot serves all receivers, but they share its noise, which is large next to the
//! shooter. Links of different elements are independent, so that a gather over many elements
//! averages their noise: on the Cornell box this is 100 times cheaper than shots for the same error
//! of the picture.

use super::elements::{ElementIndex, Elements};
use super::glow::Sources;
use super::inside::{Place, is_inside};
use super::mesh::{CellSpot, CoarseMesh};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::DirectLights;
use crate::radiometry::{Rgb, importance};
use crate::random::Stream;
use crate::rays::{Eye, Hit, Ray};
use crate::sampling::{Seed, Shifted, cosine_direction};
use crate::surface::World;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::Arc;

/// Link of a ray that met nothing that reflects: it counts, and brings no light.
const DARK: u32 = u32::MAX;
/// Link of a ray that began inside a body: it does not count.
const COVERED: u32 = u32::MAX - 1;
/// Most links of all elements together, 4 bytes each: 192 MiB.
const MOST_LINKS: usize = 48 << 20;
/// Most links of a round, unless [`LEAST_ROUND_RAYS`] an element are more: it bounds the time of an
/// iteration.
const MOST_AT_ONCE: usize = 4 << 20;
/// Most sweeps of a solution.
const MOST_SWEEPS: u32 = 400;
/// Sum of all changes in a sweep, relative to the sum of all values, at which sweeps end; or mean of each
/// element's change relative to its own value.
const SETTLED_CHANGE: f32 = 2e-4;
/// How often the equation is solved over the same links: each time with the slopes of the solution
/// before.
const SOLUTIONS: u32 = 2;
/// Links from which on no more get a colour, 20 bytes each: 80 MiB.
const MOST_TINTS: usize = 4 << 20;
/// Colours of links that differ by less from white are white.
pub const LEAST_TINT: f32 = 1e-3;
/// Elements of a parallel task.
const CHUNK: usize = 256;

/// Fewest rays of an element in a round, however small it is.
const LEAST_ROUND_RAYS: f32 = 4.0;

/// The links of all elements.
#[derive(Clone, Default)]
pub struct Links {
    rounds: Vec<Arc<Round>>,
    /// Solved irradiance of each element by light that was reflected at least once.
    pub bounced: Vec<Rgb>,
}

/// Links that were traced together, never changed after: those of element e are
/// `links[start[e]..start[e + 1]]`, the elements that its rays met, or [`DARK`] or [`COVERED`].
struct Round {
    start: Vec<u32>,
    links: Vec<u32>,
    /// Where in those elements the rays ended.
    spots: Vec<CellSpot>,
    /// Σ π × radiance that each element's rays found of sky and emitters by way of what bends light;
    /// empty where nothing does.
    bent: Vec<Rgb>,
    /// What coloured glass on the way takes of links, in the order of the elements that these start
    /// from.
    tints: Vec<Tint>,
    /// Which of them were bent on the way, and by what.
    bent_links: Vec<BentLink>,
}

/// A link whose light is coloured on its way.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Tint {
    /// The element that it starts from, and the one that it met.
    from: u32,
    to: u32,
    /// The share of its light that does not arrive.
    lack: Rgb,
}

/// A link whose ray was bent or mirrored where it ended at first: what it brings, it brings by way of that.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BentLink {
    /// The element that it starts from.
    pub from: u32,
    /// The element that bends or mirrors.
    pub by: u32,
    /// The element that it leads to, or [`DARK`].
    pub to: u32,
    /// π × radiance of sky and emitters beside, as one number.
    pub light: f32,
}

/// What rays of an element found beside the elements that they met.
#[derive(Default)]
struct OnTheWay {
    /// Σ π × radiance of sky and emitters by way of what bends light.
    bent: Rgb,
    tints: Vec<Tint>,
    bent_links: Vec<BentLink>,
}

/// Where links are traced.
#[derive(Clone, Copy)]
pub struct Linking<'a> {
    /// The scene as rays meet it.
    pub world: &'a World,
    /// Its emitters.
    pub lights: &'a DirectLights,
    /// The coarse mesh.
    pub mesh: &'a CoarseMesh,
    /// Whether a map has what emitters bring by way of what bends light.
    pub is_mapped: bool,
    /// Whether links follow sharp mirrors to what those show.
    pub follows_mirrors: bool,
}

/// A ray of a link.
struct LinkRay {
    /// The element that it starts from.
    from: u32,
    /// Where it starts.
    place: Place,
    /// Unit vector.
    direction: Vec3,
    /// Whether its colour may be kept.
    has_tint: bool,
}

impl Round {
    fn of(&self, element: ElementIndex) -> &[u32] {
        let [first, end] = [self.start[element.at()], self.start[element.at() + 1]];
        &self.links[first as usize..end as usize]
    }

    fn with_spots(&self, element: ElementIndex) -> (&[u32], &[CellSpot]) {
        let [first, end] = [self.start[element.at()], self.start[element.at() + 1]];
        let own = first as usize..end as usize;
        (&self.links[own.clone()], &self.spots[own])
    }

    /// What the colours of an element's links take, where `radiosity` says what the elements send.
    fn lack(&self, element: ElementIndex, radiosity: &[Rgb]) -> Rgb {
        if self.tints.is_empty() {
            return Rgb::ZERO;
        }
        let first = self.tints.partition_point(|tint| tint.from < element.0);
        let own = self.tints[first..].iter().take_while(|tint| tint.from == element.0);
        own.map(|tint| tint.lack * radiosity[tint.to as usize]).sum()
    }
}

impl Links {
    /// Whether a link counts: those from inside a body do not.
    pub fn counts(link: ElementIndex) -> bool {
        link.0 != COVERED
    }

    /// Number of links.
    pub fn count(&self) -> usize {
        self.rounds.iter().map(|round| round.links.len()).sum()
    }

    /// Bytes that they take, about.
    pub fn held_bytes(&self) -> u64 {
        let of_round = |round: &Arc<Round>| {
            let Round { start, links, spots, bent, tints, bent_links } = &**round;
            size_of_val(&**start)
                + size_of_val(&**links)
                + size_of_val(&**spots)
                + size_of_val(&**bent)
                + size_of_val(&**tints)
                + size_of_val(&**bent_links)
        };
        let rounds: usize = self.rounds.iter().map(of_round).sum();
        (rounds + size_of_val(&*self.bounced)) as u64
    }

    /// Traces `rays` more rays from each element of ordinary size, as long as there is room for
    /// them.
    pub fn trace(&mut self, linking: Linking<'_>, seed: Seed, rays: u32) {
        let Linking { world, mesh, .. } = linking;
        let elements = mesh.elements.area.len();
        let start = starts(&mesh.elements.counted, rays);
        let end = start[elements];
        if self.count() + end as usize > MOST_LINKS && !self.rounds.is_empty() {
            return;
        }
        let has_tint =
            self.rounds.iter().map(|round| round.tints.len()).sum::<usize>() < MOST_TINTS;
        let of_element = |index: usize| {
            let element = ElementIndex(index as u32);
            let done = self.rounds.iter().map(|round| round.of(element).len() as u32).sum();
            let sequence = Shifted::new(seed, Stream::PatchLight, index as u64).at(done);
            let count = start[index + 1] - start[index];
            let (batch, normals) = link_rays(world, mesh, element, count, sequence);
            let mut hits = Vec::with_capacity(batch.len());
            world.rays.closest_many(Eye::Light, &batch, &mut hits);
            let mut way = OnTheWay::default();
            let links = hits.into_iter().zip(&batch).zip(normals);
            let side = mesh.elements.side(world, element);
            let links = links.map(|((hit, ray), normal)| {
                let Ray { origin: start, direction } = *ray;
                let place = Place { start, normal, side };
                let ray = LinkRay { from: element.0, place, direction, has_tint };
                linking.link(hit, &ray, &mut way)
            });
            (links.collect::<Vec<(u32, CellSpot)>>(), way)
        };
        let found: Vec<(Vec<(u32, CellSpot)>, OnTheWay)> =
            (0..elements).into_par_iter().with_max_len(64).map(of_element).collect();
        let mut links = Vec::with_capacity(end as usize);
        let mut spots = Vec::with_capacity(end as usize);
        for (own, _) in &found {
            links.extend(own.iter().map(|(link, _)| *link));
            spots.extend(own.iter().map(|(_, spot)| *spot));
        }
        let (mut bent, mut tints, mut bent_links) = (Vec::new(), Vec::new(), Vec::new());
        if world.has_clear() || linking.follows_mirrors {
            bent = found.iter().map(|(_, way)| way.bent).collect();
            tints = found.iter().flat_map(|(_, way)| way.tints.iter().copied()).collect();
            bent_links = found.into_iter().flat_map(|(_, way)| way.bent_links).collect();
        }
        self.rounds.push(Arc::new(Round { start, links, spots, bent, tints, bent_links }));
    }

    /// Solves the radiosity equation E_bounced = Σ ρ_link (E_direct + E_bounced)_link / N over the
    /// links so far, beginning with the solution before; what far sides let through, and what glows, is
    /// added to what a link's end reflects.
    ///
    /// A link takes its element's mean, wherever in the element the ray ended, and so light moves by
    /// parts of an element at random at every bounce, which makes it spread too far in a long white
    /// room. The slope of the light over the element, times the way from its middle to where the ray
    /// ended, corrects that to the second order.
    ///
    /// `beyond` is added to what the links of each element bring, where there is such: what aimed rays
    /// find beyond what links say.
    pub fn solve(&mut self, mesh: &CoarseMesh, sources: Sources<'_>, beyond: Option<&[Rgb]>) {
        let direct = sources.direct;
        let albedo = &mesh.elements.albedo;
        for number in 0..SOLUTIONS {
            let mut slopes = Vec::new();
            if !self.bounced.is_empty() {
                slopes = mesh
                    .slopes(|element| direct[element.at()].irradiance + self.bounced[element.at()]);
            }
            if number > 0 && slopes.is_empty() {
                return;
            }
            let mut correction = self.correction(&mesh.elements, &slopes);
            if let Some(beyond) = beyond {
                correction.resize(beyond.len(), Rgb::ZERO);
                correction.iter_mut().zip(beyond).for_each(|(sum, beyond)| *sum += *beyond);
            }
            self.balance(albedo, sources, &correction);
        }
    }

    /// What links bring beyond the means of their elements, by each element.
    fn correction(&self, elements: &Elements, slopes: &[[Rgb; 2]]) -> Vec<Rgb> {
        let of_element = |element: u32| {
            let (mut sum, mut rows) = (Rgb::ZERO, 0u32);
            for round in &self.rounds {
                let (links, spots) = round.with_spots(ElementIndex(element));
                for (link, spot) in links.iter().zip(spots) {
                    rows += u32::from(*link != COVERED);
                    let Some([along_u, along_v]) = slopes.get(*link as usize) else { continue };
                    let offset = spot.offset() - elements.center(ElementIndex(*link));
                    let beyond = *along_u * offset.x + *along_v * offset.y;
                    sum += elements.albedo[*link as usize] * beyond;
                }
            }
            sum / rows.max(1) as f32
        };
        (0..slopes.len() as u32).into_par_iter().with_min_len(CHUNK).map(of_element).collect()
    }

    /// Mean over an element's links of what their ends send.
    pub fn mean(&self, element: ElementIndex, radiosity: &[f32]) -> f32 {
        let (mut sum, mut rows) = (0.0, 0.0f32);
        for link in self.of(element).filter(|link| Self::counts(*link)) {
            sum += radiosity.get(link.at()).copied().unwrap_or_default();
            rows += 1.0;
        }
        sum / rows.max(1.0)
    }

    /// Solves the equation by sweeps, where `correction` (or nothing, if that is empty) is added to
    /// what the links of each element bring.
    fn balance(&mut self, albedo: &[Rgb], sources: Sources<'_>, correction: &[Rgb]) {
        let Sources { direct, far, glow } = sources;
        let elements = direct.len() as u32;
        self.bounced.resize(direct.len(), Rgb::ZERO);
        let rows: Vec<u32> = (0..elements)
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|element| {
                let links = self.of(ElementIndex(element));
                links.filter(|link| link.0 != COVERED).count() as u32
            })
            .collect();
        let reflected = |bounced: &[Rgb]| -> Vec<Rgb> {
            let all = direct.par_iter().zip(bounced).zip(albedo).with_min_len(CHUNK);
            let own =
                all.map(|((direct, bounced), albedo)| *albedo * (direct.reflected_as + *bounced));
            let own = own
                .enumerate()
                .map(|(element, own)| own + glow.get(element).copied().unwrap_or_default());
            let Some(far) = far else { return own.collect() };
            let arriving =
                |element: ElementIndex| direct[element.at()].irradiance + bounced[element.at()];
            let passed = |element: usize| far.passed(ElementIndex(element as u32), arriving);
            own.enumerate().map(|(element, own)| own + passed(element)).collect()
        };
        for _ in 0..MOST_SWEEPS {
            let radiosity = reflected(&self.bounced);
            let next: Vec<Rgb> = (0..elements)
                .into_par_iter()
                .with_min_len(CHUNK)
                .map(|element| {
                    let links = self.of(ElementIndex(element));
                    let met = links.filter_map(|link| radiosity.get(link.at()));
                    let sum = met.sum::<Rgb>() + self.bent(ElementIndex(element));
                    let lacks = self.rounds.iter();
                    let lacks = lacks.map(|round| round.lack(ElementIndex(element), &radiosity));
                    let sum = sum - lacks.sum::<Rgb>();
                    let beyond = correction.get(element as usize).copied().unwrap_or_default();
                    let found = sum / rows[element as usize].max(1) as f32 + beyond;
                    found.max(Rgb::ZERO)
                })
                .collect();
            let is_settled = is_settled(&self.bounced, &next);
            self.bounced = next;
            if is_settled {
                break;
            }
        }
    }

    /// The links of an element: an index that is none of an element stands for a ray that met
    /// nothing that reflects.
    pub fn of(&self, element: ElementIndex) -> impl Iterator<Item = ElementIndex> {
        let all = self.rounds.iter().flat_map(move |round| round.of(element));
        all.map(|link| ElementIndex(*link))
    }

    /// The same, each with whether its ray went there straight on and uncoloured.
    pub fn ways(&self, element: ElementIndex) -> impl Iterator<Item = (ElementIndex, bool)> {
        let all = self.rounds.iter().flat_map(move |round| {
            let (links, spots) = round.with_spots(element);
            links.iter().zip(spots)
        });
        all.map(|(link, spot)| (ElementIndex(*link), !spot.is_apart()))
    }

    /// Links so far that were bent on their way.
    pub fn bent_links(&self) -> impl Iterator<Item = &BentLink> {
        self.rounds.iter().flat_map(|round| &round.bent_links)
    }

    /// Number of links of an element.
    pub fn count_of(&self, element: ElementIndex) -> usize {
        self.rounds.iter().map(|round| round.of(element).len()).sum()
    }

    /// Σ π × radiance of sky and emitters that an element's rays found by way of what bends light.
    fn bent(&self, element: ElementIndex) -> Rgb {
        self.rounds.iter().filter_map(|round| round.bent.get(element.at())).sum()
    }

    /// Writes the links. They take most of the bytes of a checkpoint: two each where that suffices.
    pub fn save(&self, elements: usize, to: &mut Writer) {
        to.slice(&self.bounced);
        to.value(self.rounds.len() as u64);
        for round in &self.rounds {
            let Round { start, links, spots, bent, tints, bent_links } = &**round;
            to.slice(start);
            to.slice(bent);
            to.slice(spots);
            to.slice(tints);
            to.slice(bent_links);
            if fits_two_bytes(elements) {
                // The two marks are the largest numbers, in two bytes as in four.
                to.slice(&links.iter().map(|link| *link as u16).collect::<Vec<_>>());
            } else {
                to.slice(links);
            }
        }
    }

    /// Takes what [`Links::save`] wrote of so many elements.
    pub fn restore(elements: usize, from: &mut Reader<'_>) -> Result<Self, CheckpointError> {
        let damaged = |what: &str| Err(CheckpointError::damaged(what));
        let bounced: Vec<Rgb> = from.slice()?;
        let mut rounds = Vec::new();
        for _ in 0..from.count(MOST_LINKS as u64)? {
            let start: Vec<u32> = from.exactly(elements + 1)?;
            let count = start[elements] as usize;
            let bent: Vec<Rgb> = from.slice()?;
            if !bent.is_empty() && bent.len() != elements {
                return damaged("its bent light is not of these elements");
            }
            let spots: Vec<CellSpot> = from.exactly(count)?;
            let tints: Vec<Tint> = from.slice()?;
            let is_sound = |tint: &Tint| {
                let ends = [tint.from, tint.to];
                ends.iter().all(|end| (*end as usize) < elements) && tint.lack.is_finite()
            };
            if !tints.iter().all(is_sound) || !tints.is_sorted_by_key(|tint| tint.from) {
                return damaged("the colours of its links are not of these elements");
            }
            let bent_links: Vec<BentLink> = from.slice()?;
            let is_sound = |way: &BentLink| {
                let ends = [way.from, way.by].iter().all(|end| (*end as usize) < elements);
                ends && way.light.is_finite()
            };
            if !bent_links.iter().all(is_sound) {
                return damaged("its bent links are not of these elements");
            }
            if start[0] != 0 || !start.is_sorted() {
                return damaged("its links are not in order");
            }
            let links: Vec<u32> = if fits_two_bytes(elements) {
                let widen = |link: u16| match link {
                    u16::MAX | 0xfffe => u32::from(link) | 0xffff_0000,
                    link => u32::from(link),
                };
                from.exactly::<u16>(count)?.into_iter().map(widen).collect()
            } else {
                from.exactly(count)?
            };
            if links.iter().any(|link| *link as usize >= elements && *link < COVERED) {
                return damaged("a link leads nowhere");
            }
            rounds.push(Arc::new(Round { start, links, spots, bent, tints, bent_links }));
        }
        if bounced.len() != if rounds.is_empty() { 0 } else { elements } {
            return damaged("its links are not of these elements");
        }
        Ok(Self { rounds, bounced })
    }
}

/// Area of an element of ordinary size: the mean, weighted by area.
pub fn ordinary_area(areas: &[f32]) -> f32 {
    let all: f32 = areas.iter().sum();
    areas.iter().map(|area| area * (area / all)).sum()
}

/// Where the links of each element begin, and where the last ones end: `rays` of one of ordinary
/// size, fewer of smaller ones, which fewer rays meet.
fn starts(area: &[f32], rays: u32) -> Vec<u32> {
    // Meshes of very many triangles have very many elements; the picture must not wait.
    let rays = (rays as f32).min(MOST_AT_ONCE as f32 / area.len().max(1) as f32);
    let ordinary = ordinary_area(area);
    let mut start = Vec::with_capacity(area.len() + 1);
    let mut end = 0;
    for area in area {
        start.push(end);
        end += (rays * (area / ordinary).min(1.0)).max(LEAST_ROUND_RAYS).round() as u32;
    }
    start.push(end);
    start
}

impl Linking<'_> {
    /// The link of a ray that met this, and where in the element it ends; what else the ray found goes
    /// to `way`.
    fn link(&self, hit: Option<Hit>, ray: &LinkRay, way: &mut OnTheWay) -> (u32, CellSpot) {
        let Self { world, mesh, .. } = self;
        let element = |hit: &Hit| {
            mesh.spot_at(world, hit)
                .map_or((DARK, CellSpot::MIDDLE), |(element, spot)| (element.0, spot))
        };
        // No light arrives from below the geometric plane.
        let arrives = ray.place.normal.dot(ray.direction) > 0.0;
        let Some(hit) = hit.filter(|_| arrives) else { return (DARK, CellSpot::MIDDLE) };
        if world.is_black(&hit) {
            let inside = is_inside(world, &mesh.cut, &ray.place, &hit);
            let link = if inside { COVERED } else { DARK };
            return (link, CellSpot::MIDDLE);
        }
        let (is_clear, is_mirror) =
            (world.is_clear(hit.triangle), self.follows_mirrors && world.may_mirror(hit.triangle));
        if !is_clear && !is_mirror {
            return element(&hit);
        }
        let mut passage = world.pass(hit, ray.direction);
        if self.follows_mirrors {
            passage = world.follow_mirrors(passage);
        }
        let mut light = Rgb::ZERO;
        if passage.is_bent {
            light = PI * passage.bent_light(world, !self.is_mapped);
            // What it ends at sends its glow, too.
            if let Some(end) = passage.met().filter(|_| self.lights.has_glow())
                && let Some(surface) = world.surface(&end)
            {
                light -= PI * passage.left * self.lights.glow(world, &surface);
            }
            way.bent += light;
        }
        // What glass takes ends some of them, and colours others.
        let (share, lack) = tint(passage.left, ray.has_tint);
        let met = passage.met().filter(|met| !world.is_black(met) && passage.chance < share);
        let to = met.map_or((DARK, CellSpot::MIDDLE), |met| element(&met));
        let is_coloured = lack.abs().max_element() > LEAST_TINT;
        if ray.has_tint && to.0 < COVERED && is_coloured {
            way.tints.push(Tint { from: ray.from, to: to.0, lack });
        }
        if passage.is_bent
            && ray.has_tint
            && let (by, _) = element(&hit)
            && by < COVERED
        {
            let light = importance(light);
            way.bent_links.push(BentLink { from: ray.from, by, to: to.0, light });
        }
        if passage.is_bent || is_coloured { (to.0, to.1.apart()) } else { to }
    }
}

/// Probability that a link stands of which that is left of each channel, and what it lacks of each then. No
/// channel is more than whole: with what a link brings above what was sent, sweeps would not converge.
fn tint(left: Rgb, has_tint: bool) -> (f32, Rgb) {
    let share = if has_tint { left.max_element() } else { importance(left) }.clamp(0.0, 1.0);
    let whole = (left / share.max(f32::MIN_POSITIVE)).min(Rgb::ONE);
    (share, Rgb::ONE - whole)
}

/// So many rays from points of an element over the hemisphere about the normal that each is lit by, and
/// the geometric normals there.
fn link_rays(
    world: &World,
    mesh: &CoarseMesh,
    element: ElementIndex,
    count: u32,
    mut sequence: Shifted,
) -> (Vec<Ray>, Vec<Vec3>) {
    let alone = mesh.elements.is_one_patch(&mesh.cut, element);
    let points = mesh.elements.points(world, &mesh.cut, element, 0.0);
    let ray = |_| {
        let xi = sequence.next_pair();
        let others;
        let points = if alone {
            &points
        } else {
            let x = sequence.triple().x;
            others = mesh.elements.points(world, &mesh.cut, element, x);
            &others
        };
        let (at, beside) = (sequence.second_pair(), sequence.beside());
        let lit = mesh.elements.lit_point(world, element, points, at, beside);
        let direction = cosine_direction(lit.lit_normal, xi);
        (Ray { origin: lit.start, direction }, lit.normal)
    };
    (0..count).map(ray).unzip()
}

/// Whether a sweep has changed so little that no more are needed: by all light together, or by that of most
/// elements. In a narrow gap between white walls light is reflected hundreds of times; when it has
/// settled everywhere else, nobody sees what it still does there.
fn is_settled(before: &[Rgb], after: &[Rgb]) -> bool {
    let (mut change, mut sum, mut relative, mut lit) = (0.0, 0.0, 0.0, 0.0);
    for (before, after) in before.iter().zip(after) {
        let own = (*after - *before).abs().element_sum();
        let value = after.element_sum();
        change += own;
        sum += value;
        if value > 0.0 {
            relative += own / value;
            lit += 1.0;
        }
    }
    change <= SETTLED_CHANGE * sum || relative <= SETTLED_CHANGE * lit
}

/// Whether two bytes a link suffice for the elements' numbers and the two marks.
fn fits_two_bytes(elements: usize) -> bool {
    elements < usize::from(u16::MAX) - 1
}

#[cfg(test)]
mod tests;
