//! Guiding of gather rays: small patches that reflect much more than most, such as the inside of a
//! lampshade, are met by few rays spread over the hemisphere, so some rays are aimed at them; and so with
//! what bends or mirrors much light, such as frosted glass in a window.

use super::elements::{ElementIndex, Elements};
use super::links::Links;
use super::mesh::{CoarseMesh, MeshValues};
use crate::emitters::{LightBounds, LightTree};
use crate::patches::{FacetPlace, PatchIndex};
use crate::radiometry::Rgb;
use crate::rays::Hit;
use crate::surface::{Passage, World};
use crate::transport::patch_points::PatchPoints;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::f32::consts::PI;

/// An element is bright if its radiosity is over so many times the mean that others see.
const BRIGHT_FACTOR: f32 = 8.0;
/// Share of all power that elements receive of each other that must come from bright ones for aiming
/// to be worth its cost; the Cornell box has 3 % (docs/decisions/0013).
const LEAST_BRIGHT_SHARE: f32 = 0.06;
/// Share of all area from which on bright elements are met without being aimed at, as where things
/// stand under an open sky and what is bright is all that faces it.
const MOST_BRIGHT_AREA: f32 = 0.1;
/// Most patches to aim at: more are no few small ones.
const MOST_PATCHES: usize = 10_000;
/// What an element that shares a corner with a bright one is taken to reflect, of what that does: part
/// of it may lie in the same patch of sun.
const EDGE_SHARE: f32 = 0.25;
/// What others receive of a bright element, by its area, at least, of what they do of one that shares a corner
/// with it: by chance no link may have met it.
const UNMET_SHARE: f32 = 0.25;
/// Areas that are less than this, m², are taken to be this, where something is divided by them.
const LEAST_AREA: f32 = 1e-20;
/// Least distance, in sides of a bright element, of another one that counts as lit by it: nearer
/// ones meet it by many rays anyway.
const LEAST_DISTANCE: f32 = 3.0;

/// The bright patches of the coarse mesh, to aim rays at.
pub struct Guide {
    /// The bright elements, each with the power that others receive of it.
    bright: Vec<(ElementIndex, f32)>,
    tree: LightTree,
    /// Balls around the patches, each with its normal and the power that others receive of it.
    bounds: Vec<LightBounds>,
    patches: Vec<PatchIndex>,
    /// Which of them a patch is.
    number: HashMap<PatchIndex, u32>,
    /// One over their areas, ray units.
    per_area: Vec<f32>,
    points: Vec<PatchPoints>,
    /// What arrives from bright elements (first channel) and from all (second).
    arriving: MeshValues,
}

/// A patch where a ray ended, or that bent it first: how far away, and the cosine of its angle to the
/// patch's normal.
pub struct Met {
    /// The patch.
    pub patch: PatchIndex,
    /// Ray units along the ray.
    pub distance: f32,
    /// Cosine between ray and normal.
    pub cosine: f32,
}

/// The patches at which a ray in that `direction` may have been aimed to come to `passage`, where it has met
/// `hit` first: what bends or mirrors it, and what it met behind on a straight line.
pub fn aims_of(
    world: &World,
    mesh: &CoarseMesh,
    (hit, direction): (&Hit, Vec3),
    passage: &Passage,
) -> [Option<Met>; 2] {
    let met = |hit: &Hit, distance: f32| {
        let patch = mesh.patch_at(hit)?;
        Some(Met { patch, distance, cosine: world.rays.spot(hit).normal.dot(direction) })
    };
    let bends = world.is_clear(hit.triangle) || world.may_mirror(hit.triangle);
    let first = if bends { met(hit, hit.distance) } else { None };
    let end = passage.met().filter(|_| !passage.is_bent && (!bends || passage.way > hit.distance));
    [first, end.and_then(|end| met(&end, passage.way))]
}

/// Weight of a ray of the hemisphere's cosine distribution or of one aimed at a bright patch `aim`, over
/// that of the former alone, by the balance heuristic (Veach 1997): `aims` are the patches at which it may
/// have been aimed, `density` the density per solid angle of aiming at one, `height` the ray's cosine to the
/// normal where it starts, `shares` those of either kind among all rays. `None` for a ray that was aimed
/// at another patch than it met.
pub fn balanced(
    (aim, aims): (Option<PatchIndex>, &[Option<Met>; 2]),
    density: impl Fn(&Met) -> f32,
    height: f32,
    shares: [f32; 2],
) -> Option<f32> {
    let (mut aimed, mut is_met) = (0.0, aim.is_none());
    for met in aims.iter().flatten() {
        is_met |= aim == Some(met.patch);
        aimed += density(met);
    }
    let height = height.max(f32::MIN_POSITIVE);
    is_met.then(|| height / (shares[0] * height + shares[1] * PI * aimed))
}

/// A direction towards a bright patch.
pub struct Aim {
    /// Unit vector.
    pub direction: Vec3,
    /// The patch.
    pub patch: PatchIndex,
}

impl Guide {
    /// Bright patches by the elements' radiosities, a number each; `None` where aiming does not
    /// pay.
    pub fn new(world: &World, mesh: &CoarseMesh, links: &Links, radiosity: &[f32]) -> Option<Self> {
        let mut this = Self::of(world, mesh, aiming_targets(world, mesh, links, radiosity)?)?;
        this.arriving = this.arriving_by_links(mesh, links, radiosity);
        Some(this)
    }

    /// What arrives at the mesh from bright elements (first channel) and from all (second), by the links.
    fn arriving_by_links(&self, mesh: &CoarseMesh, links: &Links, radiosity: &[f32]) -> MeshValues {
        let mut is_bright = vec![false; radiosity.len()];
        for (element, _) in &self.bright {
            is_bright[element.at()] = true;
        }
        let of_element = |index: usize| {
            let met = links.of(ElementIndex(index as u32)).map(ElementIndex::at);
            let met = met.filter_map(|link| Some((is_bright.get(link)?, radiosity.get(link)?)));
            met.fold(Rgb::ZERO, |sum, (is_bright, own)| {
                sum + Rgb::new(if *is_bright { *own } else { 0.0 }, *own, 0.0)
            })
        };
        let all = (0..radiosity.len()).into_par_iter().with_min_len(256).map(of_element);
        let mut all: Vec<Rgb> = all.collect();
        for link in links.bent_links() {
            let shown = radiosity.get(link.to as usize).copied().unwrap_or_default();
            let is_known = is_bright.get(link.to as usize).is_some_and(|is_bright| *is_bright);
            let is_aimed = is_bright[link.by as usize];
            let of_bright = if is_aimed { link.light + shown } else { 0.0 };
            let before = if is_known { shown } else { 0.0 };
            all[link.from as usize] += Rgb::new(of_bright - before, link.light, 0.0);
        }
        mesh.values(|element| all[element.at()])
    }

    /// Share of the light that arrives at a place of the mesh that comes from bright elements, about.
    pub fn share(&self, mesh: &CoarseMesh, place: FacetPlace) -> f32 {
        let arriving = mesh.value(&self.arriving, place);
        if arriving.y > 0.0 { (arriving.x / arriving.y).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Of these bright elements, each with the power that others receive of it; `None` where they have
    /// too many patches, or none.
    pub fn of(world: &World, mesh: &CoarseMesh, bright: Vec<(ElementIndex, f32)>) -> Option<Self> {
        let CoarseMesh { cut, elements, .. } = mesh;
        let (mut patches, mut powers) = (Vec::new(), Vec::new());
        for (element, power) in &bright {
            for patch in elements.members(*element) {
                patches.push(*patch);
                powers.push(*power / elements.area[element.at()] * cut.area(*patch));
            }
        }
        if patches.is_empty() || patches.len() > MOST_PATCHES {
            return None;
        }
        let points: Vec<PatchPoints> =
            patches.par_iter().map(|patch| PatchPoints::in_cut(world, cut, *patch, 0.0)).collect();
        let bounds_of = |(points, power): (&PatchPoints, &f32)| {
            let (center, radius) = points.ball();
            LightBounds { center, radius, power: *power, normal: points.normal(), two_sided: false }
        };
        let bounds: Vec<LightBounds> = points.iter().zip(&powers).map(bounds_of).collect();
        Some(Self {
            bright,
            tree: LightTree::new(&bounds),
            bounds,
            number: patches.iter().copied().zip(0..).collect(),
            per_area: points.iter().map(|points| 1.0 / points.area()).collect(),
            patches,
            points,
            arriving: MeshValues::default(),
        })
    }

    /// The bright elements, each with the power that others receive of it.
    pub fn bright(&self) -> &[(ElementIndex, f32)] {
        &self.bright
    }

    /// Aims from a surface at `point` with unit `normal`, by three uniform numbers; `None` where
    /// that has missed.
    pub fn aim(&self, point: Vec3, normal: Vec3, xi: Vec3) -> Option<Aim> {
        let (pick, _) = self.tree.pick(point, normal, xi.x)?;
        self.towards(pick, point, normal, [xi.y, xi.z])
    }

    /// A direction towards a place of a patch by its number, by two uniform numbers.
    pub(super) fn towards(
        &self,
        pick: usize,
        point: Vec3,
        normal: Vec3,
        xi: [f32; 2],
    ) -> Option<Aim> {
        let direction = (self.points[pick].point(xi).0 - point).normalize_or_zero();
        let above = normal.dot(direction) > 0.0;
        above.then_some(Aim { direction, patch: self.patches[pick] })
    }

    /// Density per solid angle at which [`Guide::aim`] picks a place of a patch that a ray from there met;
    /// zero for those that are not bright.
    pub fn density(&self, point: Vec3, normal: Vec3, met: &Met) -> f32 {
        let Some(number) = self.number(met.patch) else { return 0.0 };
        self.density_of(number, self.tree.probability(number, point, normal), met)
    }

    /// The number of a bright patch.
    pub(super) fn number(&self, patch: PatchIndex) -> Option<usize> {
        self.number.get(&patch).map(|number| *number as usize)
    }

    /// Density per solid angle of a place that a ray met of the patch with that number, which is picked
    /// with that probability.
    pub(super) fn density_of(&self, number: usize, probability: f32, met: &Met) -> f32 {
        probability * met.distance * met.distance * self.per_area[number]
            / met.cosine.abs().max(1e-6)
    }

    /// Balls around the bright patches, each with its normal and the power that others receive of it.
    pub(super) fn bounds(&self) -> &[LightBounds] {
        &self.bounds
    }
}

/// Bright elements that light others which seldom meet them by chance, each with the power that
/// those receive of it; `None` where that is too little altogether.
fn aiming_targets(
    world: &World,
    mesh: &CoarseMesh,
    links: &Links,
    radiosity: &[f32],
) -> Option<Vec<(ElementIndex, f32)>> {
    let CoarseMesh { cut, elements, .. } = mesh;
    let Seen { mut power, area: seen } = Seen::by_links(elements, links, radiosity);
    let (shown, more) = shown(elements, links, radiosity);
    power += more;
    let limit = BRIGHT_FACTOR * power / seen.max(f32::MIN_POSITIVE);
    let shows = |element: usize| {
        shown.get(element).is_some_and(|shown| *shown > limit * elements.area[element])
    };
    if !(0..radiosity.len()).any(|element| radiosity[element] > limit || shows(element)) {
        return None;
    }
    // Beside a bright element, part of another may be as bright, and none of its few points say so.
    let beside = mesh.ranges_beside(radiosity).into_iter();
    let most = beside.map(|range| range.map_or(0.0, |[_, most]| EDGE_SHARE * most));
    let taken: Vec<f32> = radiosity.iter().zip(most).map(|(own, most)| own.max(most)).collect();
    let is_bright = |element: ElementIndex| taken[element.at()] > limit;
    let received = received(world, mesh, links, |link| {
        taken.get(link.at()).copied().filter(|own| *own > limit)
    });
    let densities: Vec<f32> = received
        .iter()
        .zip(&elements.counted)
        .map(|(own, area)| own / area.max(LEAST_AREA))
        .collect();
    let beside = mesh.ranges_beside(&densities);
    // Clusters of an instance are no one place to aim at, and crevices are hardly seen.
    let is_listed = |element: &ElementIndex| {
        elements.crevices.whole(*element) == *element
            && !elements.members(*element).iter().any(|patch| cut.is_cluster(*patch))
    };
    let useful = |element: ElementIndex| {
        if shows(element.at()) {
            return (element, shown[element.at()]);
        }
        let own = elements.counted[element.at()] * taken[element.at()];
        let beside = beside[element.at()].filter(|_| radiosity[element.at()] > limit);
        let most_beside = beside.map_or(0.0, |[_, most]| UNMET_SHARE * most);
        let received = received[element.at()].max(most_beside * elements.counted[element.at()]);
        (element, received.min(own))
    };
    let bright = elements
        .all()
        .filter(|element| (is_bright(*element) || shows(element.at())) && is_listed(element));
    let bright: Vec<(ElementIndex, f32)> =
        bright.map(useful).filter(|(_, useful)| *useful > 0.0).collect();
    let theirs: f32 = bright.iter().map(|(_, useful)| useful).sum();
    let area: f32 = bright.iter().map(|(element, _)| elements.counted[element.at()]).sum();
    let is_small = area < MOST_BRIGHT_AREA * elements.counted.iter().sum::<f32>();
    (is_small && theirs > LEAST_BRIGHT_SHARE * power).then_some(bright)
}

/// Power that others receive by way of each element that bends or mirrors light, by the links, and what of all
/// that comes of sky and emitters; no numbers where nothing does.
fn shown(elements: &Elements, links: &Links, radiosity: &[f32]) -> (Vec<f32>, f32) {
    let (mut shown, mut more) = (Vec::new(), 0.0);
    for link in links.bent_links() {
        shown.resize(radiosity.len(), 0.0);
        let from = ElementIndex(link.from);
        if elements.albedo[from.at()] == Rgb::ZERO {
            continue;
        }
        let each = elements.counted[from.at()] / links.count_of(from) as f32;
        let reflected = radiosity.get(link.to as usize).copied().unwrap_or_default();
        shown[link.by as usize] += each * (reflected + link.light);
        more += each * link.light;
    }
    (shown, more)
}

/// What elements see of each other. What only the sky and the sun see, as the outer walls of a house,
/// counts for nothing in it.
struct Seen {
    /// Power that they receive.
    power: f32,
    /// Their areas, each by the share of its rays that meet something.
    area: f32,
}

impl Seen {
    fn by_links(elements: &Elements, links: &Links, radiosity: &[f32]) -> Self {
        let of = |index: usize| {
            let (element, area) = (ElementIndex(index as u32), elements.counted[index]);
            let (mut sum, mut met, mut count) = (0.0f32, 0.0f32, 0.0f32);
            for link in links.of(element) {
                count += 1.0;
                if let Some(own) = radiosity.get(link.at()) {
                    (sum, met) = (sum + own, met + 1.0);
                }
            }
            let each = if elements.albedo[index] == Rgb::ZERO { 0.0 } else { area };
            [sum, met].map(|sum| f64::from(each * sum / count.max(1.0)))
        };
        let each: Vec<[f64; 2]> = (0..elements.counted.len()).into_par_iter().map(of).collect();
        // One after the other: sums in parallel would depend on the number of threads.
        let all = each.iter().fold([0.0; 2], |all, one| [all[0] + one[0], all[1] + one[1]]);
        Self { power: all[0] as f32, area: all[1] as f32 }
    }
}

/// Power that others receive of each element by the links, without those near it: what is near, as
/// in the gap between a lamp and the ceiling, is met without being aimed at. `bright` gives the
/// radiosity of an element that counts.
fn received(
    world: &World,
    mesh: &CoarseMesh,
    links: &Links,
    bright: impl Fn(ElementIndex) -> Option<f32> + Sync,
) -> Vec<f32> {
    let CoarseMesh { cut, elements, .. } = mesh;
    let area = &elements.area;
    let middle = |element: ElementIndex| elements.points(world, cut, element, 0.5).ball().0;
    let of_element = |index: usize| {
        let element = ElementIndex(index as u32);
        let met = links.of(element).filter_map(|link| Some((link, bright(link)?)));
        let mut met: Vec<(ElementIndex, f32)> = met.collect();
        if met.is_empty() || elements.albedo[index] == Rgb::ZERO {
            return Vec::new();
        }
        let each = elements.counted[index] / links.of(element).count() as f32;
        let from = middle(element);
        met.retain(|(link, _)| {
            from.distance(middle(*link))
                > LEAST_DISTANCE * area[link.at()].sqrt() * world.rays.scale() as f32
        });
        met.iter_mut().for_each(|(_, radiosity)| *radiosity *= each);
        met
    };
    let all: Vec<Vec<(ElementIndex, f32)>> =
        (0..area.len()).into_par_iter().with_min_len(256).map(of_element).collect();
    let mut received = vec![0.0; area.len()];
    for (link, power) in all.into_iter().flatten() {
        received[link.at()] += power;
    }
    received
}

#[cfg(test)]
mod tests {
    use super::Met;
    use crate::patches::{Cut, PatchIndex};
    use crate::rays::Eye;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{SEED, Specimen};
    use crate::transport::patch_points::PatchPoints;
    use glam::Vec3;

    #[test]
    fn rays_are_aimed_where_a_lamp_shines_into_its_shade() {
        assert!(Specimen::furnace().coarse.guide.is_none(), "nothing is brighter than the rest");
        let specimen = Specimen::new(&made::shade(), 4000);
        let guide = specimen.coarse.guide.as_ref().expect("the inside of the shade is bright");
        let (world, mesh) = (&specimen.world, &specimen.coarse.mesh);
        let Cut::Listed(listed) = &*mesh.cut else { panic!("it is no crowd") };
        let patches = &listed.patches;
        let radiosity = |patch: PatchIndex| {
            let patch = patch.at();
            let reflected = patches.diffuse[patch] * specimen.coarse.irradiances()[patch];
            reflected.max_element()
        };
        let all = (0..patches.len() as u32).map(PatchIndex);
        let all = all.map(|patch| patches.area[patch.at()] * radiosity(patch));
        let mean = all.sum::<f32>() / patches.area.iter().sum::<f32>();
        let (mut aimed, mut bright, mut met) = (0, 0, 0);
        for patch in (0..patches.len() as u32).step_by(37).map(PatchIndex) {
            let (point, normal) =
                PatchPoints::in_cut(world, &mesh.cut, patch, 0.0).point([0.4, 0.6]);
            for k in 0..8 {
                let xi = Vec3::new(0.123, 0.456, 0.789) * (k + 1) as f32;
                let Some(aim) = guide.aim(point, normal, xi.fract()) else { continue };
                aimed += 1;
                assert!((aim.direction.length() - 1.0).abs() < 1e-4);
                assert!(normal.dot(aim.direction) > 0.0);
                // The others lie beside bright ones.
                bright += usize::from(radiosity(aim.patch) > mean);
                let Some(hit) = world.rays.closest(Eye::Light, point, aim.direction) else {
                    continue;
                };
                if mesh.patch_at(&hit) == Some(aim.patch) {
                    met += 1;
                    let cosine = world.rays.spot(&hit).normal.dot(aim.direction);
                    let met = Met { patch: aim.patch, distance: hit.distance, cosine };
                    let density = guide.density(point, normal, &met);
                    assert!(density > 0.0 && density.is_finite());
                }
            }
        }
        assert!(aimed > 100 && met > 10, "{aimed} aimed, {met} met");
        assert!(10 * bright > 8 * aimed, "{bright} of {aimed} are aimed at what is bright");
    }

    /// The outer walls are sunlit all over, but nothing in the house sees them. Bright are what the sun
    /// shines on, and the head of the window over its sunlit sill.
    #[test]
    fn rays_in_a_house_are_aimed_at_what_the_sun_shines_on_in_it() {
        let house = made::real::window();
        let sun = house.environment.sun.as_ref().expect("it shines");
        let (sun, bright) = (sun.direction, 0.02 * sun.irradiance.max_element());
        let mut specimen = Specimen::surrounded(&house.glb, house.environment, 4000);
        let guide = specimen.coarse.guide.clone().expect("the patch of sun is bright");
        specimen.coarse.link(SEED, 0, 2048);
        let known = specimen.coarse.irradiances();
        let world = &specimen.world;
        let point = world.rays.place(Vec3::new(0.01, 1.2, 1.5));
        let (mut aimed, mut lit) = (0, 0);
        for k in 0..200 {
            let xi = Vec3::new(0.754_877_7, 0.569_840_3, 0.438_579_4) * k as f32;
            let Some(aim) = guide.aim(point, Vec3::X, xi.fract()) else { continue };
            let Some(hit) = world.rays.closest(Eye::Light, point, aim.direction) else { continue };
            aimed += 1;
            let Some(patch) = specimen.coarse.mesh.patch_at(&hit) else { continue };
            // A part of a patch in the sun makes it bright.
            let points = PatchPoints::in_cut(world, &specimen.cut, patch, 0.0);
            let sees_sun = |number: u32| {
                let [x, y] = [0.618_034, 0.754_877_7].map(|step| (step * number as f32).fract());
                let (start, normal) = points.point([x, y]);
                normal.dot(sun) > 0.0 && world.rays.closest(Eye::Light, start, sun).is_none()
            };
            let is_bright = known[patch.at()].max_element() > bright;
            lit += usize::from(is_bright || (0..32).any(sees_sun));
        }
        assert!(lit > 60 && 5 * lit > 3 * aimed, "{lit} of {aimed}");
    }
}
