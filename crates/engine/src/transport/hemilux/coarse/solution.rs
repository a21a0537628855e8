//! The coarse solution (tier 1): irradiance of the whole scene on a coarse mesh. Direct light comes
//! from the closed form and shadow rays at points of every element, bounced light from the links
//! between elements. The camera sees it only through gather rays.

use super::aimed::Aimed;
use super::by_lobes::ByLobes;
use super::caustic_light::{self, CausticLight};
use super::direct::{DirectLight, Lighting, SampledLight};
use super::elements::ElementIndex;
use super::far_sides::FarSides;
use super::glow::{self, Sources};
use super::guide::Guide;
use super::links::{Linking, Links};
use super::mesh::{CoarseMesh, MeshValues};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::DirectLights;
use crate::patches::{FacetPlace, PatchIndex};
use crate::radiometry::{Rgb, importance};
use crate::rays::Hit;
use crate::sampling::{Afresh, Seed};
use crate::surface::{Reflection, Surface, World};
use glam::Vec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::f32::consts::PI;
use std::sync::Arc;

/// Points of an element whose direct light is found at first.
pub const PATCH_POINTS: u32 = 2;
/// Most points of all elements together whose direct light is found at a time, unless one an
/// element is more: it bounds the time of an iteration.
const MOST_POINTS: usize = 1 << 20;

/// Most points of an element beside those that all of them get.
const MOST_POINTS_MORE: u32 = 64;

/// How a coarse solution is drawn by chance.
#[derive(Clone, Copy)]
pub struct Drawing {
    /// What random numbers are drawn by.
    pub seed: Seed,
    /// Whether the first picture had better come soon than be good: half the points of each element.
    pub hasty: bool,
}

/// The coarse solution.
pub struct CoarseSolution {
    /// The scene as rays meet it.
    pub world: Arc<World>,
    /// Its emitters.
    pub lights: Arc<DirectLights>,
    /// The mesh that it is solved on.
    pub mesh: Arc<CoarseMesh>,
    /// Sums over points of each element, from which `direct` follows.
    sampled: Vec<SampledLight>,
    direct: Vec<DirectLight>,
    /// What elements let through diffusely, if any do.
    far_sides: Option<Arc<FarSides>>,
    /// π × radiance that elements emit without being lights; empty where none does.
    glow: Arc<Vec<Rgb>>,
    links: Links,
    /// Rays at bright elements, where there are such.
    aimed: Option<Aimed>,
    /// Light by way of clear bodies, where there are some.
    pub(super) caustics: Option<CausticLight>,
    /// Whether links, and rays for bounced light, follow sharp mirrors.
    pub(super) follows_mirrors: bool,
    /// What lobes send to elements beyond what links say.
    by_lobes: ByLobes,
    /// Bright patches that gather rays are aimed at, if any.
    pub guide: Option<Arc<Guide>>,
    /// Irradiance of the patches, direct and indirect.
    pub(super) total: MeshValues,
    /// The same, indirect only.
    pub(super) indirect: MeshValues,
}

impl CoarseSolution {
    /// A solution with direct light only, by [`PATCH_POINTS`] points of each element or half of them, or by the
    /// points in `sampled` from a checkpoint.
    pub fn new(
        world: Arc<World>,
        lights: Arc<DirectLights>,
        mesh: CoarseMesh,
        drawing: Drawing,
        sampled: Option<Vec<SampledLight>>,
    ) -> Self {
        let Drawing { seed, hasty } = drawing;
        let count = mesh.elements.len();
        let far_sides = FarSides::new(&world, &mesh).map(Arc::new);
        let glow = Arc::new(glow::of_elements(&world, &lights, &mesh));
        let caustics = CausticLight::new(&world, count, seed.number, hasty);
        // What lamps send by way of mirrors is too noisy to be found by chance.
        let follows_mirrors = (caustics.is_some() || !caustic_light::is_cast(&world))
            && caustic_light::has_mirrors(&world);
        let mut mesh = mesh;
        if follows_mirrors {
            mesh.leave_out_mirrors();
        }
        let mut this = Self {
            world,
            lights,
            mesh: Arc::new(mesh),
            sampled: sampled.unwrap_or_default(),
            direct: Vec::new(),
            far_sides,
            glow,
            links: Links::default(),
            aimed: None,
            caustics,
            follows_mirrors,
            by_lobes: ByLobes::default(),
            guide: None,
            total: MeshValues::default(),
            indirect: MeshValues::default(),
        };
        if this.sampled.is_empty() {
            this.sampled = vec![SampledLight::default(); count];
            let shared = if hasty { 2 } else { 1 };
            let points = (PATCH_POINTS / shared).min(most_points(count));
            this.sample_direct(seed, |_| points);
            this.update_direct();
            let more = this.points_where_disputed(count / shared as usize);
            this.sample_direct(seed, |element| more[element]);
        }
        this.update_direct();
        this.update_irradiance();
        this
    }

    /// The same for another job in the same surroundings, whose `world` may have another background;
    /// `None` of what has caustics.
    pub fn again(&self, world: Arc<World>) -> Option<Self> {
        if self.caustics.is_some() {
            return None;
        }
        Some(Self {
            world,
            lights: self.lights.clone(),
            mesh: self.mesh.clone(),
            sampled: self.sampled.clone(),
            direct: self.direct.clone(),
            far_sides: self.far_sides.clone(),
            glow: self.glow.clone(),
            links: self.links.clone(),
            aimed: self.aimed.clone(),
            caustics: None,
            follows_mirrors: self.follows_mirrors,
            by_lobes: self.by_lobes.clone(),
            guide: self.guide.clone(),
            total: self.total.clone(),
            indirect: self.indirect.clone(),
        })
    }

    /// Bytes that it takes, about, without scene, lights, cut and what rays are aimed at.
    pub fn held_bytes(&self) -> u64 {
        let values = [&self.total, &self.indirect].map(MeshValues::held_bytes);
        let lists =
            size_of_val(&*self.sampled) + size_of_val(&*self.direct) + size_of_val(&**self.glow);
        let far_sides = self.far_sides.as_ref().map_or(0, |far| far.held_bytes());
        let aimed = self.aimed.as_ref().map_or(0, Aimed::held_bytes);
        let shared =
            aimed + self.by_lobes.held_bytes() + self.links.held_bytes() + self.mesh.held_bytes();
        values[0] + values[1] + lists as u64 + far_sides + shared
    }

    /// Samples direct light at so many more points of each element.
    fn sample_direct(&mut self, seed: Seed, points: impl Fn(usize) -> u32 + Sync) {
        let CoarseMesh { cut, elements, .. } = &*self.mesh;
        let follows_mirrors = self.follows_mirrors;
        let (world, lights) = (&*self.world, &*self.lights);
        let lit = Lighting { world, lights, cut, elements, follows_mirrors };
        self.sampled.par_iter_mut().enumerate().with_max_len(256).for_each(|(element, sampled)| {
            sampled.add(&lit, ElementIndex(element as u32), points(element), seed);
        });
    }

    /// How many more points each element gets of about so many altogether: in proportion to how much
    /// the reflected light of those beside it differs (about Neyman's allocation). Where a patch of sun
    /// ends, the light of a whole room depends on few elements. What an element's own points say must
    /// have no part in it: two that agree by chance would get no more, and chance would stay.
    fn points_where_disputed(&self, points: usize) -> Vec<u32> {
        let elements = &self.mesh.elements;
        let lit: Vec<f32> =
            self.direct.iter().map(|direct| importance(direct.irradiance).max(0.0)).collect();
        let worth = |(element, range): (usize, Option<[f32; 2]>)| {
            let difference = range.map_or(0.0, |[least, most]| most - least);
            difference * elements.counted[element] * elements.albedo[element].max_element()
        };
        let ranges = self.mesh.ranges_beside(&lit);
        let worths: Vec<f32> = ranges.into_iter().enumerate().map(worth).collect();
        let all: f64 = worths.iter().map(|own| f64::from(*own)).sum();
        if all <= 0.0 {
            return vec![(points / lit.len().max(1)) as u32; lit.len()];
        }
        let per_worth = (points as f64 / all) as f32;
        let count = |own: &f32| ((own * per_worth).round() as u32).min(MOST_POINTS_MORE);
        worths.iter().map(count).collect()
    }

    /// Averages the points' direct light.
    fn update_direct(&mut self) {
        let all = self.sampled.iter().zip(&self.mesh.elements.albedo);
        self.direct = all.map(|(sampled, albedo)| sampled.mean(*albedo)).collect();
    }

    /// Samples direct light at `points` more points of each element, traces links by `rays` more
    /// rays of an ordinary element, solves over all links and updates the irradiance.
    pub fn link(&mut self, seed: Seed, points: u32, rays: u32) {
        if points > 0 {
            let count = self.mesh.elements.len();
            let points = points.min(most_points(count));
            // Half of them wherever it may be, half where they are worth most.
            let more = self.points_where_disputed(count * points as usize / 2);
            self.sample_direct(seed, |element| points.div_ceil(2) + more[element]);
            self.update_direct();
        }
        let linking = Linking {
            world: &self.world,
            lights: &self.lights,
            mesh: &self.mesh,
            is_mapped: self.is_mapped(),
            follows_mirrors: self.follows_mirrors,
        };
        self.links.trace(linking, seed, rays);
        // As many more aimed rays, by and by, as links.
        let rounds = self.aimed.as_ref().map_or(1, Aimed::rounds);
        if let Some(aimed) = &mut self.aimed {
            aimed.trace(&self.world, &self.mesh, seed, rounds);
        }
        self.solve();
        // What is bright the first solution says.
        if self.aimed.is_none()
            && let Some(guide) = self.guide.clone()
        {
            let aimed = self.aimed.insert(Aimed::new(&self.world, &self.mesh, guide));
            aimed.trace(&self.world, &self.mesh, seed, rounds);
            self.solve();
        }
    }

    /// Solves over all links and updates the irradiance.
    fn solve(&mut self) {
        let mut lit = Cow::Borrowed(&*self.direct);
        if let Some(caustics) = &self.caustics {
            for (element, direct) in self.mesh.elements.all().zip(lit.to_mut()) {
                let by_caustics = caustics.of_element(&self.mesh, element);
                direct.irradiance += by_caustics;
                direct.reflected_as += by_caustics;
            }
        }
        let albedo = &self.mesh.elements.albedo;
        let aimed = self.aimed.as_ref();
        let far = self.far_sides.as_deref();
        let sources = Sources { direct: &lit, far, glow: &self.glow };
        let mut beyond = aimed.map(|aimed| aimed.beyond(&self.links, albedo, sources));
        if let Some(by_lobes) = self.by_lobes.beyond() {
            let all = beyond.get_or_insert_with(|| vec![Rgb::ZERO; by_lobes.len()]);
            all.iter_mut().zip(&by_lobes).for_each(|(sum, more)| *sum += *more);
        }
        self.links.solve(&self.mesh, sources, beyond.as_deref());
        self.update_irradiance();
    }

    /// Finds what lobes send beyond what links say, by up to so many more rays of each element, and
    /// solves again; `lacking` says what of it comes along a ray from a point in a direction.
    pub fn follow_lobes(
        &mut self,
        seed: Seed,
        rays: u32,
        lacking: impl Fn(&Self, Vec3, Vec3, Afresh) -> Rgb + Sync,
    ) {
        if self.by_lobes.is_idle() {
            return;
        }
        let mut by_lobes = std::mem::take(&mut self.by_lobes);
        let (world, mesh) = (&*self.world, &*self.mesh);
        by_lobes.trace((world, mesh), seed, rays, |start, direction, numbers| {
            lacking(self, start, direction, numbers)
        });
        self.by_lobes = by_lobes;
        self.solve();
    }

    /// Finds more of the light that comes by way of clear bodies.
    pub fn shed_caustics(&mut self) {
        if let Some(caustics) = &mut self.caustics {
            caustics.advance(&self.world, &self.mesh);
        }
    }

    /// Light by way of clear bodies, where there are some.
    pub fn caustics(&self) -> Option<&CausticLight> {
        self.caustics.as_ref()
    }

    /// Writes the points' direct light, the links and the caustics.
    pub fn save(&self, to: &mut Writer) {
        to.slice(&self.sampled);
        self.links.save(self.sampled.len(), to);
        to.value(u64::from(self.aimed.is_some()));
        if let Some(aimed) = &self.aimed {
            aimed.save(to);
        }
        self.by_lobes.save(to);
        if let Some(caustics) = &self.caustics {
            caustics.save(to);
        }
    }

    /// Reads the links and caustics that [`CoarseSolution::save`] wrote behind the points' direct light, with
    /// which it was made ([`CoarseSolution::new`]).
    pub fn restore_links(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.links = Links::restore(self.sampled.len(), from)?;
        self.aimed = match from.count(1)? {
            0 => None,
            _ => Some(Aimed::restore(&self.world, &self.mesh, from)?),
        };
        self.by_lobes = ByLobes::restore(self.sampled.len(), from)?;
        if let Some(caustics) = &mut self.caustics {
            caustics.restore(from)?;
        }
        self.update_irradiance();
        Ok(())
    }

    /// Irradiance of each patch, direct and indirect; in a crowd, of each element.
    pub fn irradiances(&self) -> &[Rgb] {
        &self.total.own
    }

    /// Irradiance of a patch, direct and indirect; zero inside of closed bodies.
    pub fn of_patch(&self, patch: PatchIndex) -> Rgb {
        let element = self.mesh.elements.of(patch);
        element.map_or(Rgb::ZERO, |element| self.mesh.of_element(&self.total, element))
    }

    /// Whether a map has what emitters bring to diffuse surfaces by way of what bends light or
    /// mirrors it sharply.
    pub fn is_mapped(&self) -> bool {
        self.caustics.is_some()
    }

    /// Links, albedos, and what elements send beside.
    #[cfg(test)]
    pub fn parts(&self) -> (&Links, &[Rgb], Sources<'_>) {
        let far = self.far_sides.as_deref();
        let sources = Sources { direct: &self.direct, far, glow: &self.glow };
        (&self.links, &self.mesh.elements.albedo, sources)
    }

    /// Links so far.
    pub fn links(&self) -> usize {
        self.links.count()
    }

    /// Updates the irradiance of the patches, and the guide, from direct light and links.
    fn update_irradiance(&mut self) {
        let bounced = |element: ElementIndex| match self.direct[element.at()].open > 0.0 {
            true => self.links.bounced.get(element.at()).copied().unwrap_or_default(),
            false => Rgb::ZERO,
        };
        let all = |element: ElementIndex| {
            let lit = &self.direct[element.at()];
            if lit.open <= 0.0 {
                return Rgb::ZERO;
            }
            let caustics = self.caustics.as_ref();
            let by_caustics =
                caustics.map_or(Rgb::ZERO, |caustics| caustics.of_element(&self.mesh, element));
            bounced(element) + lit.irradiance + by_caustics
        };
        (self.total, self.indirect) = (self.mesh.values(all), self.mesh.values(bounced));
        let elements = &self.mesh.elements;
        let arriving =
            |element: ElementIndex| self.mesh.of_element(&self.total, element).max(Rgb::ZERO);
        let radiosity = elements.all().zip(&elements.albedo).map(|(element, albedo)| {
            let passed = self.far_sides.as_ref().map(|far| far.passed(element, arriving));
            importance(*albedo * arriving(element) + passed.unwrap_or_default())
        });
        let mut radiosity: Vec<f32> = radiosity.collect();
        self.by_lobes.share_out(&self.mesh, &self.links, &radiosity);
        for (sent, glow) in radiosity.iter_mut().zip(&*self.glow) {
            *sent += importance(*glow);
        }
        if self.aimed.is_some() {
            self.leave_out_outliers(&mut radiosity);
        }
        self.guide = Guide::new(&self.world, &self.mesh, &self.links, &radiosity).map(Arc::new);
    }

    /// Lowers the radiosity of elements to which few aimed rays have brought much: nothing is bright by
    /// what links know nothing of.
    fn leave_out_outliers(&self, radiosity: &mut [f32]) {
        let by_links = |element: usize| {
            let own = ElementIndex(element as u32);
            let albedo = self.mesh.elements.albedo[element];
            let bounced = self.links.mean(own, radiosity);
            let lit = importance(albedo * self.direct[element].irradiance);
            let glow = self.glow.get(element).map_or(0.0, |glow| importance(*glow));
            radiosity[element].min(glow + lit + albedo.max_element() * bounced)
        };
        let lowered: Vec<f32> =
            (0..radiosity.len()).into_par_iter().with_min_len(256).map(by_links).collect();
        radiosity.copy_from_slice(&lowered);
    }

    /// Estimated share of the direct light that arrives at the element at a place.
    pub(super) fn share(&self, place: FacetPlace) -> f32 {
        let element = self.mesh.element_on(place);
        element.map_or(0.0, |element| self.direct[element.at()].share)
    }

    /// Irradiance that has bounced, at a place of the mesh.
    pub fn bounced(&self, place: FacetPlace) -> Rgb {
        self.mesh.value(&self.indirect, place)
    }

    /// How much of the bounced light at a place comes from lobes.
    pub fn share_by_lobes(&self, place: FacetPlace) -> f32 {
        if self.by_lobes.is_empty() {
            return 0.0;
        }
        self.mesh.element_on(place).map_or(0.0, |element| self.by_lobes.share(element))
    }

    /// Radiance that a surface emits without being a light.
    pub fn glow(&self, surface: &Surface) -> Rgb {
        self.lights.glow(&self.world, surface)
    }

    /// Radiance that links take a hit to send to all sides, without its glow.
    pub fn sent_by_links(&self, surface: &Surface, hit: &Hit) -> Rgb {
        let Some(place) = self.mesh.place_of(hit) else { return Rgb::ZERO };
        let arriving = self.mesh.value(&self.total, place);
        let by_lamps = self.mesh.element_on(place).map(|element| {
            let direct = &self.direct[element.at()];
            direct.reflected_as - direct.irradiance
        });
        let reflected = (arriving + by_lamps.unwrap_or_default()).max(Rgb::ZERO);
        surface.reflection().mean_albedo() * reflected / PI
    }

    /// Irradiance from the emitters, at a place of the mesh.
    pub fn direct(&self, place: FacetPlace) -> Rgb {
        self.mesh.value(&self.total, place) - self.mesh.value(&self.indirect, place)
    }
}

/// Most points of each of so many elements at a time.
fn most_points(elements: usize) -> u32 {
    ((MOST_POINTS / elements.max(1)) as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::Cut;
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, SEED, Specimen, is_near};

    /// In a furnace the radiance is L^e/(1 − a), so the irradiance is π times that.
    #[test]
    fn the_furnace_is_solved() {
        let mut specimen = Specimen::furnace();
        let exact = PI * EMISSION / (1.0 - ALBEDO);
        let all = specimen.coarse.irradiances();
        assert!(all.iter().all(|irradiance| is_near(*irradiance, exact, 0.02)), "{all:?}");
        let before = specimen.coarse.links();
        specimen.coarse.link(SEED, 4, 16);
        assert!(specimen.coarse.links() > before);
        let all = specimen.coarse.irradiances();
        assert!(all.iter().all(|irradiance| is_near(*irradiance, exact, 0.02)), "{all:?}");
    }

    /// So it is where its triangles are a crowd.
    #[test]
    fn a_furnace_of_a_crowd_is_solved() {
        let glb = crate::scene::made::furnace(Rgb::splat(ALBEDO), Rgb::splat(EMISSION));
        let specimen = Specimen::new(&glb, 2);
        assert!(matches!(*specimen.cut, Cut::Crowd(_)));
        let exact = PI * EMISSION / (1.0 - ALBEDO);
        for irradiance in specimen.coarse.irradiances() {
            assert!(is_near(*irradiance, exact, 0.02), "{irradiance}");
        }
    }

    #[test]
    fn what_was_solved_comes_back() {
        let specimen = Specimen::furnace();
        let mut to = Writer::new(u64::MAX);
        specimen.coarse.save(&mut to);
        let bytes = to.finish().expect("there is room");
        let mut from = Reader::new(&bytes);
        let sampled = from.exactly(specimen.coarse.mesh.elements.len()).expect("it is there");
        let mut again = Specimen::furnace().coarse;
        again.sampled = sampled;
        again.links = Links::default();
        again.restore_links(&mut from).expect("sound");
        assert_eq!(again.irradiances(), specimen.coarse.irradiances());
    }
}
