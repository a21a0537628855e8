//! Radiance along a camera ray by random walks from the eye (Kajiya 1986): at each surface the
//! lights are sampled (next-event estimation) and one reflected ray goes on; emitters that it
//! meets are weighed against the light samples by the power heuristic (Veach and Guibas 1995).

use super::disks::{DiskPoints, Disks};
use super::lights::{LightSample, Lights};
use super::strata::{CHOICES, Turn};
use super::surface::{Surface, World};
use crate::radiometry::Rgb;
use crate::random::Numbers;
use crate::rays::Eye;
use glam::Vec3;

/// Reflections before a walk may be ended by chance.
const SURE_REFLECTIONS: u32 = 2;
/// Most that a walk goes on with by chance, so that it ends even between white walls.
const MOST_SURVIVAL: f32 = 0.97;

/// What traces paths.
pub struct Tracer<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its lights.
    pub lights: &'a Lights,
    /// What stands for them where Lange's sampling is asked for.
    pub disks: Option<(Disks, DiskPoints)>,
    /// Most reflections of a path.
    pub reflections: u32,
    /// Rays that leave the first surface N.
    pub rays_per_pixel: u32,
}

/// The random numbers of a pixel's paths, and the rays that they took.
pub struct Walk {
    /// The numbers.
    pub numbers: Numbers,
    /// Rays so far.
    pub rays: u64,
    /// Whether a camera ray saw an emitter.
    pub saw_emitter: bool,
    /// What spreads the choices at the first surfaces.
    pub turn: Option<Turn>,
}

/// Choices at a surface.
#[derive(Clone, Copy)]
enum Choice {
    /// Which light, and where on it.
    Light,
    LightPoint,
    /// Diffuse part or lobe, and which direction.
    Part,
    Direction,
}

impl Walk {
    /// No rays yet.
    pub fn new(numbers: Numbers) -> Self {
        Self { numbers, rays: 0, saw_emitter: false, turn: None }
    }

    /// What spreads a choice at surface number `surface` of a path.
    fn spread(&self, choice: Choice, surface: u32) -> Option<(&Turn, u64)> {
        let number = 4 * u64::from(surface) + choice as u64;
        self.turn.as_ref().filter(|_| number < CHOICES).map(|turn| (turn, number))
    }

    fn pair(&mut self, choice: Choice, surface: u32) -> [f32; 2] {
        let pair = [self.numbers.uniform(), self.numbers.uniform()];
        let spread = self.spread(choice, surface);
        spread.map_or(pair, |(turn, number)| turn.pair(number, pair))
    }

    fn single(&mut self, choice: Choice, surface: u32) -> f64 {
        let single = self.numbers.fine();
        let spread = self.spread(choice, surface);
        spread.map_or(single, |(turn, number)| turn.single(number, single))
    }

    /// Whether the diffuse part is sampled next, with probability `share`.
    fn chooses_diffuse(&mut self, share: f32, surface: u32) -> bool {
        share >= 1.0 || self.single(Choice::Part, surface) < f64::from(share)
    }
}

impl Tracer<'_> {
    /// An estimate of the radiance that arrives along a camera ray.
    pub fn radiance(&self, origin: Vec3, direction: Vec3, walk: &mut Walk) -> Rgb {
        walk.rays += 1;
        let Some((surface, _)) = self.world.meet(Eye::Camera, origin, direction) else {
            return Rgb::ZERO;
        };
        walk.saw_emitter |= surface.emission != Rgb::ZERO;
        surface.emission + self.reflected(&surface, -direction, walk)
    }

    /// Radiance that the first surface reflects, by N rays: in proportion to what the diffuse
    /// part and the lobe reflect, or at random with N = 1.
    fn reflected(&self, surface: &Surface, viewer: Vec3, walk: &mut Walk) -> Rgb {
        if !surface.reflects() {
            return Rgb::ZERO;
        }
        let count = self.rays_per_pixel;
        let mut share = surface.diffuse_share(viewer);
        let mut diffuse_count = 0;
        if count > 1 {
            // Each part that reflects gets a ray, and the share is what it then is.
            let least = u32::from(share > 0.0);
            let most = count - u32::from(share < 1.0);
            diffuse_count = ((share * count as f32).round() as u32).clamp(least, most);
            share = diffuse_count as f32 / count as f32;
        }
        let mut radiance = self.direct((surface, 0), viewer, share, count, walk);
        let weight = 1.0 / count as f32;
        for index in 0..count {
            let diffusely =
                if count > 1 { index < diffuse_count } else { walk.chooses_diffuse(share, 0) };
            radiance += weight * self.walk(*surface, viewer, share, diffusely, walk);
        }
        radiance
    }

    /// What a ray from `surface` brings: emitters that it meets, weighed against their sampling
    /// from here, and everything that was reflected before.
    fn walk(
        &self,
        mut surface: Surface,
        mut viewer: Vec3,
        mut share: f32,
        mut diffusely: bool,
        walk: &mut Walk,
    ) -> Rgb {
        let (mut radiance, mut weight) = (Rgb::ZERO, Rgb::ONE);
        let mut reflections = 1;
        loop {
            let xi = walk.pair(Choice::Direction, reflections - 1);
            let Some(scattered) = surface.scatter(viewer, share, diffusely, xi) else { break };
            weight *= scattered.factor;
            if reflections > SURE_REFLECTIONS {
                let survival = weight.max_element().min(MOST_SURVIVAL);
                if walk.numbers.uniform() >= survival {
                    break;
                }
                weight /= survival;
            }
            walk.rays += 1;
            let direction = scattered.direction;
            let met = self.world.meet(Eye::Light, surface.start(), direction);
            let Some((next, distance)) = met else { break };
            if self.disks.is_none() && next.emission != Rgb::ZERO {
                let other = self.lights.density(&next, direction, distance);
                radiance += weight * next.emission * heuristic(scattered.density, other);
            }
            if reflections == self.reflections || !next.reflects() {
                break;
            }
            reflections += 1;
            (surface, viewer) = (next, -direction);
            share = surface.diffuse_share(viewer);
            let number = reflections - 1;
            radiance += weight * self.direct((&surface, number), viewer, share, 1, walk);
            diffusely = walk.chooses_diffuse(share, number);
        }
        radiance
    }

    /// Light that comes from the emitters without detour and is reflected once, by `count`
    /// samples.
    fn direct(
        &self,
        (surface, number): (&Surface, u32),
        viewer: Vec3,
        share: f32,
        count: u32,
        walk: &mut Walk,
    ) -> Rgb {
        match &self.disks {
            None => self.direct_by_area((surface, number), viewer, share, count, walk),
            Some((disks, points)) => {
                self.direct_by_disks(surface, viewer, (disks, *points), count, walk)
            }
        }
    }

    fn direct_by_area(
        &self,
        (surface, number): (&Surface, u32),
        viewer: Vec3,
        share: f32,
        count: u32,
        walk: &mut Walk,
    ) -> Rgb {
        let mut radiance = Rgb::ZERO;
        for index in 0..count {
            let pick = walk.single(Choice::Light, number);
            let pick = (f64::from(index) + pick) / f64::from(count);
            let xi = walk.pair(Choice::LightPoint, number);
            let Some(light) = self.lights.sample(self.world, surface, pick, xi) else { continue };
            let LightSample { end, direction, radiance: emitted, density } = light;
            let (value, other) = surface.evaluate(viewer, direction, share);
            let cosine = surface.normal.dot(direction);
            let arriving = value * emitted * (cosine / density * heuristic(density, other));
            if arriving == Rgb::ZERO {
                continue;
            }
            walk.rays += 1;
            if !self.world.rays.blocked(surface.start(), end, |_| false) {
                radiance += arriving;
            }
        }
        radiance / count as f32
    }

    /// Lange's lights as Rogers prints them: the ray to a disk's centre counts w = cosⁿθ and the
    /// random ones 1 − w, with θ from the surface's normal and n its Phong exponent (1 where it
    /// has no lobe).
    fn direct_by_disks(
        &self,
        surface: &Surface,
        viewer: Vec3,
        (disks, points): (&Disks, DiskPoints),
        count: u32,
        walk: &mut Walk,
    ) -> Rgb {
        let reflectance = &surface.reflectance;
        let exponent = if reflectance.is_glossy() { reflectance.exponent } else { 1.0 };
        let from = surface.start();
        let mut radiance = Rgb::ZERO;
        // Systematic picks: those of one disk follow each other and share its centre ray.
        let offset = walk.numbers.fine();
        let mut index = 0;
        while index < count {
            let pick = |index| (f64::from(index) + offset) / f64::from(count);
            let (number, probability) = disks.pick(pick(index));
            let first = index;
            while index < count && disks.pick(pick(index)).0 == number {
                index += 1;
            }
            let disk = disks.disk(number);
            if disks.is_of(disk, surface.triangle) {
                continue;
            }
            let ray = |at, walk: &mut Walk| {
                let Some((end, direction, light)) = disk.light(from, at) else {
                    return (Rgb::ZERO, 0.0);
                };
                let cosine = surface.normal.dot(direction);
                if cosine <= 0.0 {
                    return (Rgb::ZERO, 0.0);
                }
                walk.rays += 1;
                let own = |triangle| disks.is_of(disk, triangle);
                if self.world.rays.blocked(from, end, own) {
                    return (Rgb::ZERO, cosine);
                }
                (surface.evaluate(viewer, direction, 1.0).0 * light * cosine, cosine)
            };
            let (central, cosine) = ray(disk.center(), walk);
            let weight = cosine.powf(exponent);
            let mut random = Rgb::ZERO;
            for _ in first..index {
                let at = disk.random(points, &mut walk.numbers);
                random += ray(at, walk).0;
            }
            let picked = (index - first) as f32;
            let both = weight * central + (1.0 - weight) * random / picked;
            radiance += both * (picked / probability);
        }
        radiance / count as f32
    }
}

/// Weight of a sample whose own density is `own` where another way has density `other`: the power
/// heuristic with exponent 2.
fn heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}
