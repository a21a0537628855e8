//! Direct light on every fragment (tier 3): irradiance without occlusion in closed form, times the
//! share of it that shadow rays find unoccluded. There are few rays where they agree, and many
//! where they do not.

use super::caster::Caster;
use super::highlights::Highlights;
use super::sums::{Part, ShadowSums, StoredShadowSums, StoredShares};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::{AllUnoccluded, DirectLights, LightPoint, TRIES};
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::rays::Segment;
use crate::sampling::{BAYER, Shifted};
use crate::transport::hemilux::fragments::{Fragment, VisibleSurfaces};
use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::GOLDEN_RATIO;

/// Shadow rays of every fragment in the first pass, interleaved over tiles of 4 × 4 pixels.
const FIRST_RAYS: u32 = 1;
/// Shadow rays, in each pass, of a fragment where rays disagree.
const MORE_RAYS: u32 = 6;
/// Shares of these rays that a fragment gets at least and at most, by how far one ray of it may be
/// off: the edge of a patch of sun in a room asks for more than all the rest.
pub(super) const SHARES_OF_MORE: [f32; 2] = [0.25, 128.0];
/// The same in the first pass of a hasty job.
const MORE_RAYS_IN_HASTE: u32 = 2;
/// Shadow rays of every fragment in each pass where the setting `adaptive` is off.
const EVEN_RAYS: u32 = 2;
/// Shadow rays of every fragment in each pass where lights are too many for the closed form.
const MANY_RAYS: u32 = 4;
/// Pixels of a picture of ordinary size, 500 × 500: smaller pictures get up to four times
/// [`MORE_RAYS`].
const ORDINARY_PIXELS: u32 = 250_000;
/// A fragment where rays agree gets another one once in so many passes.
const RECHECK_PASSES: u32 = 4;
/// A fragment's first rays to the sky through openings have two directions to pick from. More of them
/// are spread well enough.
const RAYS_OF_TWO: u32 = 32;
/// Pixels in each direction whose rays are compared, and shared.
pub(super) const NEIGHBOUR_REACH: i32 = 2;
/// Cosine between normals of fragments in one plane, at least.
pub(super) const IN_PLANE: f32 = 0.98;
/// Fragments of a parallel task.
pub(super) const CHUNK: usize = 1024;
/// Shadow rays that are traced together, at least.
const BATCH: usize = 512;

/// Direct light on all fragments of a picture.
pub struct DirectLighting {
    pub(super) sums: Vec<ShadowSums>,
    /// Rays of a disputed fragment: in the first pass, and in each later one.
    more_rays: [u32; 2],
    /// Whether more rays go where they disagree, by the setting of that name.
    adaptive: bool,
    /// Passes so far.
    pub passes: u32,
    /// Shadow rays so far.
    pub rays: u64,
}

impl DirectLighting {
    /// Direct light without shadow rays yet; `hasty` if the first pass had better be short.
    pub fn new(
        lights: &DirectLights,
        visible: &VisibleSurfaces,
        adaptive: bool,
        hasty: bool,
    ) -> Self {
        let unoccluded = |fragment: &Fragment| {
            let all = lights.unoccluded(fragment.point, fragment.shading_normal);
            ShadowSums::new(&all, lights.is_exact())
        };
        let fragments = visible.fragments.par_iter().with_min_len(CHUNK);
        let sums: Vec<ShadowSums> = fragments.map(unoccluded).collect();
        // In small pictures neighbours are far apart, and rays are cheap.
        let generous = (ORDINARY_PIXELS / (visible.width * visible.height)).clamp(1, 4);
        let more_rays = MORE_RAYS * generous;
        let at_first = if hasty { MORE_RAYS_IN_HASTE } else { more_rays };
        let more_rays = [at_first, more_rays];
        let mut direct = Self { sums, more_rays, adaptive, passes: 0, rays: 0 };
        direct.average_where_uneven(lights, visible, hasty);
        direct
    }

    /// Writes what the shadow rays found.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.passes);
        to.value(self.rays);
        to.slice(&self.sums.iter().map(StoredShadowSums::of).collect::<Vec<_>>());
        let ones = self.sums.iter().filter_map(|sums| sums.by_itself.as_deref());
        to.slice(&ones.map(StoredShares::of).collect::<Vec<_>>());
        let highlights = self.sums.iter().filter_map(|sums| sums.highlights.as_deref());
        Highlights::save(&highlights.collect::<Vec<_>>(), to);
    }

    /// Reads what [`DirectLighting::save`] wrote of the same fragments.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.rays = from.value()?;
        let stored: Vec<StoredShadowSums> = from.exactly(self.sums.len())?;
        let mut pairs = self.sums.iter_mut().zip(stored);
        pairs.try_for_each(|(sums, stored)| stored.restore(sums))?;
        let ones: Vec<_> =
            self.sums.iter_mut().filter_map(|sums| sums.by_itself.as_deref_mut()).collect();
        let stored: Vec<StoredShares> = from.exactly(ones.len())?;
        ones.into_iter().zip(stored).try_for_each(|(sums, stored)| stored.restore(sums))?;
        let highlights = self.sums.iter_mut().filter_map(|sums| sums.highlights.as_deref_mut());
        Highlights::restore(highlights.collect(), from)
    }

    /// Casts another pass of rays; about `most` of them at most where they go by need and it is not the
    /// first.
    pub fn pass(&mut self, caster: &Caster<'_>, most: f64) {
        let Caster { lights, visible, .. } = *caster;
        self.look_at_highlights(caster);
        if self.passes > 0 {
            self.look_at_more_places(lights, visible);
        }
        if !self.adaptive || !lights.is_exact() {
            let rays = if lights.is_exact() { EVEN_RAYS } else { MANY_RAYS };
            self.sums.iter_mut().for_each(|sums| sums.disputed = true);
            self.cast(caster, |_, _, _| rays);
        } else if self.passes == 0 {
            self.cast(caster, |_, _, sums| FIRST_RAYS * sums.least_rays());
            self.mark_disputed(visible);
            let half = self.more_rays[0] / 2;
            self.cast(caster, |_, _, sums| if sums.is_uneven() { half } else { 0 });
            let worth = self.worth_around(visible);
            self.cast(caster, |index, fragment, _| {
                // Rounded up or down in turn.
                let turn = GOLDEN_RATIO * f64::from(fragment.pixel);
                (half as f32 * worth[index] + turn.fract() as f32).floor() as u32
            });
        } else {
            self.mark_disputed(visible);
            let mean = self.mean_deviation(visible);
            let more = self.more_rays[1] as f32;
            let wanted = |fragment: &Fragment, sums: &ShadowSums| {
                if !sums.is_uneven() {
                    return 1.0 / RECHECK_PASSES as f32;
                }
                let worth = sums.deviation() * fragment.weight() / mean;
                more * worth.clamp(SHARES_OF_MORE[0], SHARES_OF_MORE[1])
            };
            let scale = self.scale_to(most, visible, &wanted);
            let passes = self.passes;
            self.cast(caster, |_, fragment, sums| {
                if scale == 1.0 {
                    return match sums.is_uneven() {
                        true => wanted(fragment, sums).round() as u32,
                        false => {
                            u32::from((fragment.pixel + passes).is_multiple_of(RECHECK_PASSES))
                        }
                    };
                }
                // Rounded up or down in turn.
                let turn = GOLDEN_RATIO * f64::from(fragment.pixel + passes);
                (scale * wanted(fragment, sums) + turn.fract() as f32).floor() as u32
            });
        }
        self.passes += 1;
    }

    /// Casts as many shadow rays from each fragment as `count` says.
    fn cast(
        &mut self,
        caster: &Caster<'_>,
        count: impl Fn(usize, &Fragment, &ShadowSums) -> u32 + Sync,
    ) {
        let fragments = &caster.visible.fragments;
        let chunks = self.sums.par_chunks_mut(CHUNK).zip(fragments.par_chunks(CHUNK));
        let rays: u64 = chunks
            .enumerate()
            .map(|(chunk, (sums, fragments))| {
                let (mut rays, mut batch) = (0, Batch::default());
                for (index, fragment) in fragments.iter().enumerate() {
                    let mut count = count(chunk * CHUNK + index, fragment, &sums[index]);
                    let dark = caster.lights.is_exact() && sums[index].is_dark();
                    if sums[index].rays == 0 {
                        // An edge was found to show something else.
                        count = count.max(FIRST_RAYS * sums[index].least_rays());
                    }
                    let is_lit = fragment.diffuse != Rgb::ZERO || sums[index].highlights.is_some();
                    if count > 0 && !dark && is_lit {
                        caster.aim(index, &mut sums[index], fragment, count, &mut batch);
                        rays += u64::from(count);
                    }
                    if batch.segments.len() >= BATCH {
                        batch.trace(caster, sums);
                    }
                }
                batch.trace(caster, sums);
                rays
            })
            .sum();
        self.rays += rays;
    }
}

/// What a shadow ray is for.
struct End {
    /// Its fragment's index in the chunk.
    index: usize,
    /// Irradiance that its light point stands for.
    irradiance: Rgb,
    /// The part of the light that this belongs to.
    part: Part,
    /// Number of the light, if it is a narrow one.
    narrow: Option<u8>,
}

/// A batch of shadow rays that are traced together.
#[derive(Default)]
struct Batch {
    segments: Vec<Segment>,
    ends: Vec<End>,
    visible: Vec<Rgb>,
}

impl Caster<'_> {
    /// Picks light points for `count` more rays of a fragment and adds the rays to a batch.
    fn aim(
        &self,
        index: usize,
        sums: &mut ShadowSums,
        fragment: &Fragment,
        count: u32,
        to: &mut Batch,
    ) {
        let Self { lights, visible, .. } = self;
        let (x, y) = (fragment.pixel % visible.width, fragment.pixel / visible.width);
        let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
        let place = BAYER[(y % 4 * 4 + x % 4) as usize];
        let sequence = Shifted::new(self.seed, Stream::Light, tile);
        // Lights are picked by what they shine on the fragment's mean place, for all its points, but
        // where that is no guide.
        let at_middle = lights.unoccluded(fragment.point, fragment.shading_normal);
        let is_alike = |there: &AllUnoccluded| {
            (there.looks_out(), there.is_split()) == (at_middle.looks_out(), at_middle.is_split())
        };
        let is_diffuse = fragment.diffuse != Rgb::ZERO;
        for _ in 0..count {
            let n = sums.rays;
            let (from, normal) = visible.start_of_ray(fragment, n);
            if !lights.is_exact() {
                let xi = sequence.of_pixel(place * TRIES, n).triple();
                sums.rays += 1;
                sums.known.rays += 1;
                if let Some((end, irradiance)) = lights.one_of_many(from, normal, xi) {
                    let (part, narrow) = (Part::Known, None);
                    let end_of = End { index, irradiance, part, narrow };
                    to.add(Segment { from, to: end }, end_of);
                }
                continue;
            }
            let there =
                (sums.more_places > 0).then(|| lights.unoccluded(from, normal)).filter(is_alike);
            let unoccluded = there.unwrap_or(at_middle);
            // The sky or the sun and all other lights take turns. What the sky shows in a lobe its own rays find.
            let split = unoccluded.split().filter(|_| sums.by_itself.is_some());
            let is_wanted = is_diffuse || unoccluded.looks_out();
            let (mut part, picked) = match &split {
                Some(split) if is_wanted && sums.is_turn_of_one(n) => (Part::ByItself, &split.one),
                Some(split) => (Part::Known, &split.others),
                None => (Part::Known, &unoccluded),
            };
            // Where the horizon cuts a light, the ratio of seen to cast asks for points above it;
            // light apart is no such ratio.
            let light = match unoccluded.looks_out() {
                true => self.look_out(picked, (from, normal), (sequence, place, n)),
                false => {
                    let at = sequence.of_pixel(place * TRIES, n);
                    let xi = |tries| if tries == 0 { at.triple() } else { at.again(tries) };
                    (0..TRIES).find_map(|tries| lights.sample(picked, from, normal, xi(tries)))
                }
            };
            let Some(light) = light else {
                // It says nothing of what is in the way.
                sums.rays += 1;
                continue;
            };
            if light.is_apart {
                part = Part::Apart;
            }
            sums.aim(part, light.irradiance);
            let (irradiance, narrow) = (light.irradiance, light.narrow);
            to.add(Segment { from, to: light.end }, End { index, irradiance, part, narrow });
        }
    }

    /// A light point for the n-th ray of a pixel from which the sky is seen through openings, if at all.
    fn look_out(
        &self,
        all: &AllUnoccluded,
        (from, normal): (Vec3, Vec3),
        (sequence, pixel, n): (Shifted, u32, u32),
    ) -> Option<LightPoint> {
        let at = |k: u32| sequence.of_pixel(pixel * TRIES, k).triple();
        let group = at(n).x;
        if n >= RAYS_OF_TWO {
            // Those before have taken two points each.
            let xi = Vec3 { x: group, ..at(n + RAYS_OF_TWO) };
            return self.lights.sample(all, from, normal, xi);
        }
        let pick = sequence.of_pixel(pixel * TRIES, n).again(1).x;
        let xi = [Vec3 { x: group, ..at(2 * n) }, at(2 * n + 1)];
        self.lights.sample_of_two(all, (from, normal), (xi, pick))
    }
}

impl Batch {
    fn add(&mut self, segment: Segment, end: End) {
        self.segments.push(segment);
        self.ends.push(end);
    }

    /// Traces the rays, adds what they found to the fragments' sums and empties the batch.
    fn trace(&mut self, caster: &Caster<'_>, sums: &mut [ShadowSums]) {
        caster.world.visibility_many(&self.segments, &mut self.visible);
        let exact = caster.lights.is_exact();
        for (end, visibility) in self.ends.iter().zip(&self.visible) {
            let sums = &mut sums[end.index];
            sums.add(end.part, end.irradiance, *visibility, exact);
            if let (Some(light), Some(highlights)) = (end.narrow, &mut sums.highlights) {
                highlights.add_ray(light, *visibility);
            }
        }
        self.segments.clear();
        self.ends.clear();
    }
}

/// Calls `each` with the fragments of neighbouring pixels that lie in the plane of fragment
/// `index`, and how many pixels they are to the right and down.
pub(super) fn around(
    visible: &VisibleSurfaces,
    index: usize,
    reach: i32,
    mut each: impl FnMut(usize, i32, i32),
) {
    let mine = &visible.fragments[index];
    let (x, y) = ((mine.pixel % visible.width) as i32, (mine.pixel / visible.width) as i32);
    let (width, height) = (visible.width as i32, visible.height as i32);
    let flat = visible.frame.footprint(mine.point, visible.height);
    for row in (y - reach).max(0)..=(y + reach).min(height - 1) {
        for column in (x - reach).max(0)..=(x + reach).min(width - 1) {
            let pixel = (row * width + column) as usize;
            if pixel == mine.pixel as usize {
                continue;
            }
            for other in visible.start[pixel] as usize..visible.start[pixel + 1] as usize {
                let theirs = &visible.fragments[other];
                if theirs.normal.dot(mine.normal) > IN_PLANE
                    && mine.normal.dot(theirs.point - mine.point).abs() < flat
                {
                    each(other, column - x, row - y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::importance;
    use crate::random::Numbers;
    use crate::scene::{Camera, Environment, Material, Scene, Triangle, Vertex};
    use crate::transport::hemilux::specimen::{EMISSION, SEED, Specimen, is_near};
    use glam::Vec3;
    use std::f32::consts::PI;

    fn caster<'a>(specimen: &'a Specimen, visible: &'a VisibleSurfaces) -> Caster<'a> {
        let Specimen { world, lights, .. } = specimen;
        Caster { world, lights, visible, seed: SEED }
    }

    /// In a furnace nothing is in between: E = π L^e without noise, by any number of rays. (In its
    /// edges rounding may hide one wall from a ray along the other.)
    #[test]
    fn light_without_shadows_has_no_noise() {
        let specimen = Specimen::furnace();
        let visible = specimen.visible();
        let mut direct = DirectLighting::new(&specimen.lights, &visible, true, false);
        for _ in 0..2 {
            direct.pass(&caster(&specimen, &visible), f64::INFINITY);
            let light = |index| direct.irradiance(&specimen.lights, &visible, index, false);
            let all = (0..visible.fragments.len()).map(light);
            let off = all.filter(|(light, variance)| {
                !is_near(*light, PI * EMISSION, 0.005) || *variance != Rgb::ZERO
            });
            let off = off.count();
            assert!(50 * off <= visible.fragments.len(), "{off} of {}", visible.fragments.len());
        }
        assert!(direct.rays > 0);
    }

    /// Where a lamp is cut by the horizon, all places of it that a pixel tries may lie below.
    #[test]
    fn a_pixel_that_finds_no_place_of_a_lamp_goes_by_those_around() {
        let specimen = Specimen::furnace();
        let visible = specimen.visible();
        let mut direct = DirectLighting::new(&specimen.lights, &visible, true, false);
        direct.pass(&caster(&specimen, &visible), f64::INFINITY);
        let missed = visible.fragments.len() / 2;
        let sums = &mut direct.sums[missed];
        (sums.known.cast, sums.known.seen) = (Rgb::ZERO, Rgb::ZERO);
        for filtered in [false, true] {
            let light = |direct: &DirectLighting| {
                direct.irradiance(&specimen.lights, &visible, missed, filtered).0
            };
            assert!(is_near(light(&direct), PI * EMISSION, 0.005), "{}", light(&direct));
        }
        direct.sums.iter_mut().for_each(|sums| sums.known.seen *= 0.5);
        let (half, _) = direct.irradiance(&specimen.lights, &visible, missed, true);
        assert!(is_near(half, 0.5 * PI * EMISSION, 0.005), "{half}");
    }

    /// The light without occlusion on a fragment, and what arrives of it, by very many rays at random.
    fn by_very_many(
        specimen: &Specimen,
        visible: &VisibleSurfaces,
        fragment: &Fragment,
    ) -> [f32; 2] {
        const RAYS: u32 = 4096;
        let mut random = Numbers::new(5, Stream::Light, fragment.pixel.into());
        let mut sums = [0.0, 0.0];
        for n in 0..RAYS {
            let (point, normal) = (visible.sample_point(fragment, n), fragment.shading_normal);
            let xi = Vec3::from_array([0; 3].map(|_| random.uniform()));
            let sample = specimen.lights.sample_by_shadow_ray(&specimen.world, point, normal, xi);
            let [unoccluded, arrived] = [sample.unoccluded, sample.arrived()].map(importance);
            sums = [sums[0] + unoccluded, sums[1] + arrived];
        }
        sums.map(|sum| sum / RAYS as f32)
    }

    /// A floor, and far from it a lamp that reaches below it, whose uppermost quarter something hides.
    fn cut_by_the_horizon() -> Specimen {
        let upright = |half: f32, [low, high]: [f32; 2], z: f32| {
            [(-half, low), (half, low), (half, high), (-half, high)]
                .map(|(x, y)| Vertex::new(Vec3::new(x, y, z), Vec3::Z))
        };
        let floor = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
            .map(|(x, z)| Vertex::new(Vec3::new(x, 0.0, z), Vec3::Y));
        let bodies = [floor, upright(2.0, [-2.0, 2.0], -9.0), upright(2.2, [1.0, 2.2], -8.9)];
        let triangle = |body: u32| {
            [[0, 1, 2], [0, 2, 3]].map(|corners| Triangle {
                vertices: corners.map(|corner| 4 * body + corner),
                material: u32::from(body == 1),
            })
        };
        let grey = Material::lambertian("grey", Rgb::splat(0.5));
        let lamp =
            Material { emission: Rgb::splat(10.0), ..Material::lambertian("lamp", Rgb::ZERO) };
        let eye = Vec3::new(0.0, 3.0, 3.0);
        let scene = Scene {
            vertices: bodies.concat(),
            triangles: (0..3).flat_map(triangle).collect(),
            materials: vec![grey, lamp],
            cameras: vec![Camera::look_at("camera", eye, Vec3::ZERO, Vec3::Y, 0.5)],
            ..Scene::default()
        };
        Specimen::of(scene, Environment::none(), 300)
    }

    /// Where the first place that is tried of a lamp lies below the horizon, the next goes anywhere: not by
    /// a step that hangs on where the first one was.
    #[test]
    fn another_try_is_as_good_as_the_first() {
        let specimen = cut_by_the_horizon();
        let visible = specimen.visible();
        let mut direct = DirectLighting::new(&specimen.lights, &visible, true, false);
        let caster = caster(&specimen, &visible);
        (0..96).for_each(|_| direct.pass(&caster, f64::INFINITY));
        let (mut found, mut all, mut without) = (0.0, 0.0, 0.0);
        for (fragment, sums) in visible.fragments.iter().zip(&direct.sums).step_by(3) {
            let [unoccluded, expected] = by_very_many(&specimen, &visible, fragment);
            found += unoccluded * importance(sums.known.share(true));
            (all, without) = (all + expected, without + unoccluded);
        }
        assert!((0.15..0.6).contains(&(all / without)), "{all} of {without}: much is hidden");
        assert!((found / all - 1.0).abs() < 0.01, "{found} instead of {all}");
    }

    /// Where the light differs from one end of a pixel to the other, what is hidden counts by what shines
    /// where the rays start, of thirty lamps as of one.
    #[test]
    fn shares_are_weighed_by_the_light_where_rays_start() {
        let specimen = Specimen::new(&crate::scene::made::hall(), 300);
        let (visible, lights) = (specimen.visible(), &specimen.lights);
        assert!(lights.count() > 16, "{}", lights.count());
        let mut direct = DirectLighting::new(lights, &visible, true, false);
        let caster = caster(&specimen, &visible);
        (0..24).for_each(|_| direct.pass(&caster, f64::INFINITY));
        let exact = |fragment: &Fragment| by_very_many(&specimen, &visible, fragment);
        let is_wanted = |index: &usize| {
            let fragment = &visible.fragments[*index];
            direct.sums[*index].more_places > 0 && fragment.share == 1.0
        };
        let wanted: Vec<usize> = (0..visible.fragments.len()).filter(is_wanted).collect();
        let every = wanted.len().div_ceil(100);
        let (mut found, mut all) = (0.0, 0.0);
        for index in wanted.into_iter().step_by(every) {
            let [unoccluded, expected] = exact(&visible.fragments[index]);
            let own = unoccluded * importance(direct.sums[index].known.share(true));
            (found, all) = (found + own, all + expected);
            assert!((own / expected - 1.0).abs() < 0.15, "{own} instead of {expected}");
        }
        assert!((found / all - 1.0).abs() < 0.01, "{found} instead of {all}");
    }

    #[test]
    fn what_rays_found_comes_back() {
        comes_back(&Specimen::new(&crate::scene::made::cornell(), 300));
        let ground = crate::scene::made::real::checker();
        comes_back(&Specimen::surrounded(&ground.glb, ground.environment, 300));
    }

    fn comes_back(specimen: &Specimen) {
        let visible = specimen.visible();
        let mut direct = DirectLighting::new(&specimen.lights, &visible, true, false);
        direct.pass(&caster(specimen, &visible), f64::INFINITY);
        let mut to = Writer::new(u64::MAX);
        direct.save(&mut to);
        let bytes = to.finish().expect("there is room");
        let mut again = DirectLighting::new(&specimen.lights, &visible, true, false);
        again.restore(&mut Reader::new(&bytes)).expect("sound");
        for index in 0..visible.fragments.len() {
            let [one, other] = [&direct, &again]
                .map(|direct| direct.irradiance(&specimen.lights, &visible, index, true));
            assert_eq!(one, other);
        }
        let mut damaged = DirectLighting::new(&specimen.lights, &visible, true, false);
        damaged.sums.pop();
        assert!(damaged.restore(&mut Reader::new(&bytes)).is_err(), "of other fragments");
    }
}
