//! A record of the irradiance cache (tier 2): rays over the hemisphere of a point turn the coarse
//! solution into its indirect irradiance, and say how far around it that counts.

use super::by_direction::ByDirection;
use crate::patches::PatchIndex;
use crate::radiometry::Rgb;
use crate::random::{Stream, pcg};
use crate::rays::{Eye, Hit, Ray};
use crate::sampling::{Afresh, Seed, Shifted, cosine_local, frame};
use crate::surface::{Passage, World};
use crate::transport::hemilux::coarse::{CoarseSolution, Met, Outlook, aims_of, balanced};
use crate::transport::hemilux::fragments::VisibleSurfaces;
use crate::transport::hemilux::gloss::{Arriving, AtTheEnd, arriving};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Sectors around the normal, of about 30° each, for which a record keeps the nearest obstacle.
pub const SECTORS: usize = 12;
/// Share of the distance to a sector's nearest obstacle up to which the record counts in full.
const CLEAR_UP_TO: f32 = 0.6;
/// Share of that distance from which the record does not count behind the obstacle's plane.
const HIDDEN_FROM: f32 = 0.9;
/// Tolerance for rounding: a point less far behind an obstacle's plane than this share of its
/// distance from the record is not behind it.
const IN_FRONT: f32 = 1e-3;

/// Of a record whose rays start at its point.
pub const NO_FRAGMENT: u32 = u32::MAX;
/// Turns of a fragment's samples among which the places that rays start from are picked.
const SAMPLE_TURNS: u32 = 16;
/// Least and largest share of a record's gather rays that are aimed at bright patches, where there are
/// such. Between them it is the share of the light that comes from there.
const AIMED_SHARES: [f32; 2] = [0.25, 0.75];
/// Least rays of a batch of which some are aimed.
const LEAST_RAYS: u32 = 4;

/// The nearest obstacle in a sector of a record's horizon, as the plane of its surface.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Obstacle {
    /// Distance along the record's surface.
    pub distance: f32,
    /// Unit normal of its surface, towards the record.
    pub normal: Vec3,
    /// How far the record is in front of its plane.
    pub offset: f32,
}

/// A sector in which no ray has met anything.
const NO_OBSTACLE: Obstacle = Obstacle { distance: f32::INFINITY, normal: Vec3::ZERO, offset: 0.0 };

/// A record: indirect irradiance at a point of a surface, in ray units.
#[derive(Clone)]
pub struct Record {
    /// Where; off the surface by the rounding error.
    pub point: Vec3,
    /// Unit normal of the lit side, interpolated between vertices where the surface is smooth.
    pub normal: Vec3,
    /// Unit normal of the triangle on that side: from below its plane no light comes.
    pub flat: Vec3,
    /// Unit vectors along the surface.
    pub tangents: [Vec3; 2],
    /// Side of a pixel there, seen from the camera that asked for it, of a picture of ordinary
    /// size.
    pub footprint: f32,
    /// Number of its random sequence.
    pub number: u32,
    /// The fragment that it was made for, from all over which its rays start, or [`NO_FRAGMENT`]: the
    /// light in a gap may vary within a pixel.
    pub fragment: u32,
    /// Rays so far.
    pub rays: u32,
    /// How many of them were aimed.
    pub aimed: u32,
    /// Σ radiance over rays.
    pub sum: Rgb,
    /// The same with the sign changed in the second half of each batch of rays: the difference
    /// between the two halves.
    pub split: Rgb,
    /// What `sum` and `split` would be by the coarse solution alone, without finding light afresh.
    pub by_mesh: Rgb,
    pub split_by_mesh: Rgb,
    /// Radiance by direction, where normal maps ask for it.
    pub by_direction: Option<Box<ByDirection>>,
    /// Σ 1/distance over rays.
    pub nearness: f32,
    /// What is nearest in each sector of the horizon.
    pub horizon: [Obstacle; SECTORS],
    /// Irradiance by the plane through the neighbouring records.
    pub value: Rgb,
    /// Half the difference of `value` between either half of all records' rays.
    pub noise: Rgb,
    /// Variance of the neighbouring records about that plane, beyond their noise.
    pub bent: Rgb,
    /// The part of it that interpolation makes, away from the record itself.
    pub between: Rgb,
    /// Whether there are too few neighbours for a plane: then nothing tells how bent light is.
    pub is_alone: bool,
    /// The same as `bent` of the corrections about theirs, which are wider.
    pub correction_bent: Rgb,
    /// Gradient of `value` along the surface, per ray unit, in world axes, a vector per channel.
    pub slope: [Vec3; 3],
    /// The same of `noise`.
    pub noise_slope: [Vec3; 3],
    /// Factor of its radius: small where irradiance is not linear along the surface.
    pub radius_factor: f32,
    /// Radius within which it counts.
    pub radius: f32,
}

/// What gather rays are traced in.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// The scene as rays meet it.
    pub world: &'a World,
    /// What they see at their ends.
    pub coarse: &'a CoarseSolution,
    /// What the camera sees: where they start.
    pub visible: &'a VisibleSurfaces,
    /// Seed of their random numbers.
    pub seed: Seed,
    /// Whether direct light is found afresh, by a shadow ray, at their ends.
    pub afresh: bool,
    /// Whether what the coarse solution says there is kept, too.
    pub asks_mesh: bool,
    /// Whether radiance is kept by direction, for normal maps.
    pub by_direction: bool,
}

/// A gather ray of a record, beside its direction.
struct GatherRay {
    /// Its number in the batch.
    number: u32,
    /// The patch that it is aimed at, if any.
    aim: Option<PatchIndex>,
    /// Random numbers to find light afresh where it ends.
    numbers: Afresh,
}

/// A batch of gather rays that a record traces together.
struct RayBatch<'a> {
    /// Rays of the record before this batch.
    first: u32,
    rays: u32,
    /// How many of them are aimed at bright patches.
    aimed: u32,
    /// How the bright patches look from the record, where some rays are aimed at them.
    outlook: Option<Outlook<'a>>,
    /// Shares of the rays that are spread over the hemisphere, and of those that are aimed.
    shares: [f32; 2],
}

impl<'a> RayBatch<'a> {
    fn new(known: &Surroundings<'a>, record: &Record, rays: u32) -> Self {
        let Surroundings { coarse, visible, .. } = *known;
        let guide = coarse.guide.as_deref().filter(|_| rays >= LEAST_RAYS);
        let aimed = guide.map_or(0, |guide| {
            let fragment = visible.fragments.get(record.fragment as usize);
            let place = fragment.map(|fragment| visible.place_on_facet(fragment));
            let share = place.map_or(0.0, |place| guide.share(&coarse.mesh, place));
            let [least, most] = AIMED_SHARES;
            (share.clamp(least, most) * rays as f32) as u32
        });
        let outlook = guide.map(|guide| Outlook::new(guide, record.point, record.normal));
        let shares = [rays - aimed, aimed].map(|count| count as f32 / rays as f32);
        Self { first: record.rays, rays, aimed, outlook, shares }
    }

    /// The outlook by which a ray of the batch is aimed; `None` for the others.
    fn outlook_of(&self, number: u32) -> Option<&Outlook<'a>> {
        let before = |number: u32| u64::from(number) * u64::from(self.aimed) / u64::from(self.rays);
        self.outlook.as_ref().filter(|_| before(number + 1) > before(number))
    }
}

impl Record {
    /// An empty record.
    pub fn new(point: Vec3, normal: Vec3, footprint: f32, number: u32) -> Self {
        let (tangent, bitangent) = frame(normal, 0.0);
        Self {
            point,
            normal,
            flat: normal,
            tangents: [tangent, bitangent],
            footprint,
            number,
            fragment: NO_FRAGMENT,
            rays: 0,
            aimed: 0,
            sum: Rgb::ZERO,
            split: Rgb::ZERO,
            by_mesh: Rgb::ZERO,
            split_by_mesh: Rgb::ZERO,
            by_direction: None,
            nearness: 0.0,
            horizon: [NO_OBSTACLE; SECTORS],
            value: Rgb::ZERO,
            noise: Rgb::ZERO,
            bent: Rgb::ZERO,
            between: Rgb::ZERO,
            is_alone: false,
            correction_bent: Rgb::ZERO,
            slope: [Vec3::ZERO; 3],
            noise_slope: [Vec3::ZERO; 3],
            radius_factor: 1.0,
            radius: 0.0,
        }
    }

    /// Traces more rays.
    pub fn gather(&mut self, known: &Surroundings<'_>, rays: u32) {
        let Surroundings { world, coarse, afresh, asks_mesh, .. } = *known;
        if known.by_direction && self.rays == 0 {
            self.by_direction = Some(Box::default());
        }
        let batch = RayBatch::new(known, self, rays);
        let (gather_rays, traced) = self.gather_rays(known, &batch);
        let mut hits = Vec::with_capacity(traced.len());
        world.rays.closest_many(Eye::Light, &traced, &mut hits);
        for ((ray, traced), hit) in gather_rays.iter().zip(&traced).zip(&hits) {
            let Some(hit) = hit else { continue };
            let Ray { direction, .. } = traced;
            let straight = ray.aim.is_some_and(|aim| coarse.mesh.patch_at(hit) != Some(aim));
            let Some(passage) = world.reach(*hit, *direction, straight) else { continue };
            let weight = self.weight(coarse, &batch, ray, (traced, hit), &passage);
            let Some(weight) = weight else { continue };
            if ray.aim.is_none() {
                self.nearness += 1.0 / (batch.shares[0] * hit.distance.max(1e-3));
            }
            self.update_horizon(world, *direction, hit);
            let end = afresh.then_some(AtTheEnd { numbers: ray.numbers, asks_mesh });
            let Arriving { radiance, by_mesh } = arriving(coarse, &passage, end);
            let half = if 2 * ray.number < rays { weight } else { -weight };
            self.sum += weight * radiance;
            self.split += half * radiance;
            self.by_mesh += weight * by_mesh;
            self.split_by_mesh += half * by_mesh;
            if let Some(seen) = &mut self.by_direction {
                seen.add(weight * radiance, *direction, self.normal.dot(*direction));
            }
        }
        self.rays += rays;
        self.aimed += batch.aimed;
    }

    /// The rays of a batch: what belongs to each, and origin and direction.
    fn gather_rays(
        &self,
        known: &Surroundings<'_>,
        batch: &RayBatch<'_>,
    ) -> (Vec<GatherRay>, Vec<Ray>) {
        let Surroundings { seed, .. } = *known;
        let [tangent, bitangent] = self.tangents;
        let sequence = |number: u64, at| Shifted::new(seed, Stream::Gather, number).at(at);
        let mut hemisphere = sequence(u64::from(self.number), batch.first - self.aimed);
        let mut aimed_at_bright = sequence(u64::from(self.number) | 1 << 32, self.aimed);
        let count = batch.rays as usize;
        let (mut gather_rays, mut traced) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for number in 0..batch.rays {
            let origin = self.origin(known.visible, batch.first + number);
            let (direction, aim, numbers) = if let Some(outlook) = batch.outlook_of(number) {
                aimed_at_bright.next_pair();
                let Some(aim) = outlook.aim(origin, aimed_at_bright.triple()) else { continue };
                // Other numbers than those that the aim was taken by.
                (aim.direction, Some(aim.patch), aimed_at_bright.apart())
            } else {
                let (local, height) = cosine_local(hemisphere.next_pair());
                let direction = tangent * local.x + bitangent * local.y + self.normal * height;
                (direction.normalize(), None, hemisphere.afresh())
            };
            if self.flat != self.normal && self.flat.dot(direction) <= 0.0 {
                continue;
            }
            gather_rays.push(GatherRay { number, aim, numbers });
            traced.push(Ray { origin, direction });
        }
        (gather_rays, traced)
    }

    /// Where its n-th ray starts.
    fn origin(&self, visible: &VisibleSurfaces, n: u32) -> Vec3 {
        let Some(fragment) = visible.fragments.get(self.fragment as usize) else {
            return self.point;
        };
        // By chance, since directions are in an order of their own.
        let turn = pcg(self.number ^ pcg(n)) % (SAMPLE_TURNS * visible.count(fragment));
        visible.sample_point(fragment, turn)
    }

    /// Weight of a ray by the balance heuristic; `None` for a ray that was aimed at another patch
    /// than it met.
    fn weight(
        &self,
        coarse: &CoarseSolution,
        batch: &RayBatch<'_>,
        ray: &GatherRay,
        (&Ray { origin, direction }, hit): (&Ray, &Hit),
        passage: &Passage,
    ) -> Option<f32> {
        let Some(outlook) = &batch.outlook else { return Some(1.0 / batch.shares[0]) };
        let aims = aims_of(&coarse.world, &coarse.mesh, (hit, direction), passage);
        let density = |met: &Met| outlook.density(origin, met);
        balanced((ray.aim, &aims), density, self.normal.dot(direction), batch.shares)
    }

    /// Takes what a ray met into the horizon, if it is the nearest in its sector.
    fn update_horizon(&mut self, world: &World, direction: Vec3, hit: &Hit) {
        let [tangent, bitangent] = self.tangents;
        let local = Vec2::new(direction.dot(tangent), direction.dot(bitangent));
        let along = hit.distance * local.length();
        let nearest = &mut self.horizon[sector(local)];
        if along < nearest.distance {
            let normal = world.rays.spot(hit).normal;
            let away = normal.dot(direction) * hit.distance;
            let normal = if away > 0.0 { -normal } else { normal };
            *nearest = Obstacle { distance: along, normal, offset: away.abs() };
        }
    }

    /// Pixels [x0, x1) × [y0, y1) where it may count for `reach` times its radius.
    pub fn window(&self, visible: &VisibleSurfaces, reach: f32) -> Option<[u32; 4]> {
        let size = [visible.width, visible.height];
        visible.frame.window(self.point, self.normal, self.radius * reach, size)
    }

    /// How much it counts at the middle of the fragment that it was made for.
    pub fn weight_at_home(&self, visible: &VisibleSurfaces) -> f32 {
        let home = visible.fragments.get(self.fragment as usize);
        home.map_or(0.0, |home| self.weight_function(1.0).weight(home.point, home.normal))
    }

    /// Mean irradiance of the rays.
    pub fn irradiance(&self) -> Rgb {
        self.sum * (PI / self.rays.max(1) as f32)
    }

    /// Half the difference of the irradiances that either half of the rays gives: its square is
    /// the variance of [`Record::irradiance`].
    pub fn noise(&self) -> Rgb {
        self.split * (PI / self.rays.max(1) as f32)
    }

    /// Irradiance of the rays beyond what the coarse solution says, and half its difference between
    /// either half of them.
    pub fn correction(&self) -> [Rgb; 2] {
        let per_ray = PI / self.rays.max(1) as f32;
        [self.sum - self.by_mesh, self.split - self.split_by_mesh].map(|sum| sum * per_ray)
    }

    /// Harmonic mean of the distances to what the rays met.
    pub fn distance(&self) -> f32 {
        self.rays as f32 / self.nearness.max(f32::MIN_POSITIVE)
    }

    /// Its weight around it, within `reach` times its radius.
    pub fn weight_function(&self, reach: f32) -> WeightFunction<'_> {
        let nearest = self.horizon.iter().fold(f32::INFINITY, |least, one| least.min(one.distance));
        let radius = self.radius * reach;
        WeightFunction {
            record: self,
            point: self.point,
            normal: self.normal,
            per_square: 1.0 / (radius * radius),
            free_square: (CLEAR_UP_TO * nearest) * (CLEAR_UP_TO * nearest),
        }
    }
}

/// A record's weight function around it.
pub struct WeightFunction<'a> {
    record: &'a Record,
    /// Where the record is.
    pub point: Vec3,
    /// Its unit normal.
    pub normal: Vec3,
    /// One over the square of the radius.
    per_square: f32,
    /// Square of the distance within which no obstacle stands in between.
    pub free_square: f32,
}

impl WeightFunction<'_> {
    /// How much the record counts at a point with the given unit normal, 0 to 1.
    #[inline]
    pub fn weight(&self, point: Vec3, normal: Vec3) -> f32 {
        let between = point - self.point;
        let (square, height) = (between.length_squared(), self.normal.dot(between));
        let weight = self.fading(square, height, self.normal.dot(normal));
        if weight > 0.0 && square > self.free_square {
            return weight * self.clearance(between, height, square);
        }
        weight
    }

    /// The same as if nothing stood between, at a distance of which `square` is the square,
    /// `height` above the surface, where the normals have a `cosine`.
    #[inline(always)]
    pub fn fading(&self, square: f32, height: f32, cosine: f32) -> f32 {
        // Half the radius off the plane, or 25° off the normal, is as far as the whole radius.
        let far = (square + 3.0 * height * height) * self.per_square
            + (1.0 - cosine) * (1.0 / (1.0 - 0.906));
        // A number that is none is far, too; rounding may make it a little less than nothing.
        let near = 1.0 - far.min(1.0).abs().sqrt();
        near * near
    }

    /// 1 where nothing stands between, 0 where something does: it is nearer, and the point lies
    /// behind it. (A wall that the record stands next to hides nothing of the floor.)
    #[inline]
    pub fn clearance(&self, between: Vec3, height: f32, square: f32) -> f32 {
        let along = between - self.normal * height;
        let [tangent, bitangent] = self.record.tangents;
        let local = Vec2::new(along.dot(tangent), along.dot(bitangent));
        let nearest = &self.record.horizon[sector(local)];
        let distance = square.sqrt();
        if distance <= CLEAR_UP_TO * nearest.distance
            || nearest.normal.dot(between) + nearest.offset >= -IN_FRONT * distance
        {
            return 1.0;
        }
        ((HIDDEN_FROM * nearest.distance - distance)
            / ((HIDDEN_FROM - CLEAR_UP_TO) * nearest.distance))
            .max(0.0)
    }
}

/// The sector of a direction along the surface.
#[inline]
fn sector(local: Vec2) -> usize {
    // Along the edge of the square |x| + |y| = 1 instead of around the circle.
    let along = local.y / (local.x.abs() + local.y.abs()).max(f32::MIN_POSITIVE);
    let turned = if local.x < 0.0 { 2.0 - along } else { along } + 1.0;
    ((turned * (SECTORS as f32 / 4.0)) as usize).min(SECTORS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, SEED, Specimen, is_near};

    fn record(specimen: &Specimen) -> Record {
        let visible = specimen.visible();
        let fragment = &visible.fragments[visible.fragments.len() / 2];
        Record::new(fragment.point, fragment.normal, 1.0, 3)
    }

    /// In a furnace what has bounced is the share a of the light: E = π a L^e/(1 − a).
    #[test]
    fn the_furnace_is_gathered() {
        let specimen = Specimen::furnace();
        for afresh in [false, true] {
            let mut record = record(&specimen);
            let visible = specimen.visible();
            let (world, coarse) = (&*specimen.world, &specimen.coarse);
            let known = Surroundings {
                world,
                coarse,
                visible: &visible,
                seed: SEED,
                afresh,
                asks_mesh: true,
                by_direction: false,
            };
            record.fragment = visible.fragments.len() as u32 / 2;
            record.gather(&known, 64);
            let exact = PI * ALBEDO * EMISSION / (1.0 - ALBEDO);
            assert!(is_near(record.irradiance(), exact, 0.02), "{}", record.irradiance());
            assert!(record.noise().abs().max_element() < 0.02 * exact);
            assert!(record.distance() > 0.0 && record.distance().is_finite());
        }
    }

    /// Behind a pane the wall of a window is in the sun, and frosted glass shines itself. Rays that are aimed
    /// there weigh as others that come there: many rays find the same light with and without aims.
    #[test]
    fn aimed_rays_pass_panes_and_meet_what_bends() {
        for roughness in [0.0, 0.3] {
            let house = crate::scene::made::real::glazed(roughness);
            let mut specimen = Specimen::surrounded(&house.glb, house.environment, 4000);
            specimen.coarse.link(SEED, 0, 64);
            let visible = specimen.visible();
            let found = |coarse: &CoarseSolution, times: u32| {
                let (world, seed) = (&*specimen.world, SEED);
                let (afresh, asks_mesh, by_direction) = (true, true, false);
                let visible = &visible;
                let known =
                    Surroundings { world, coarse, visible, seed, afresh, asks_mesh, by_direction };
                let point = world.rays.place(Vec3::new(0.01, 1.4, 3.0));
                let mut record = Record::new(point, Vec3::X, 1.0, 3);
                for _ in 0..times {
                    record.gather(&known, 4096);
                }
                [record.irradiance(), record.noise().abs()].map(Rgb::element_sum)
            };
            assert!(specimen.coarse.guide.is_some(), "{roughness}: something is bright");
            let [guided, noise] = found(&specimen.coarse, 64);
            specimen.coarse.guide = None;
            let [plain, plain_noise] = found(&specimen.coarse, 256);
            assert!(noise < 0.01 * guided && plain_noise < 0.02 * plain);
            assert!((guided / plain - 1.0).abs() < 0.03, "{roughness}: {guided} beside {plain}");
        }
    }

    #[test]
    fn records_fade_with_the_distance_and_end_at_their_radius() {
        let specimen = Specimen::furnace();
        let mut record = record(&specimen);
        record.radius = 10.0;
        let weight = |at: f32| {
            record
                .weight_function(1.0)
                .weight(record.point + record.tangents[0] * at, record.normal)
        };
        assert!((weight(0.0) - 1.0).abs() < 1e-6);
        assert!(weight(2.0) > weight(5.0) && weight(5.0) > 0.0);
        assert_eq!((weight(10.0), weight(50.0)), (0.0, 0.0));
        let turned = record.weight_function(1.0).weight(record.point, record.tangents[0]);
        assert_eq!(turned, 0.0, "a surface across hears nothing");
    }

    /// Not behind a wall that stands nearer, but on this side of it.
    #[test]
    fn records_know_their_horizon() {
        let specimen = Specimen::furnace();
        let mut record = record(&specimen);
        record.radius = 100.0;
        let toward = record.tangents[0];
        let wall = Obstacle { distance: 20.0, normal: -toward, offset: 20.0 };
        record.horizon[sector(Vec2::X)] = wall;
        let weight =
            |at: f32| record.weight_function(1.0).weight(record.point + toward * at, record.normal);
        assert!(weight(15.0) > 0.0 && weight(-40.0) > 0.0);
        assert_eq!(weight(40.0), 0.0);
    }
}
