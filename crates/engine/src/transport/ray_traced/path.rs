//! Radiance along a camera ray by random walks from the eye (Kajiya 1986): at each surface the
//! lights are sampled (next-event estimation) and one reflected ray goes on; emitters that it
//! meets are weighed against the light samples by the power heuristic (Veach and Guibas 1995).
//! Where a map has the caustics, diffuse surfaces read them there, and what the walk finds of the
//! same light is left out ([`Carried`]).

use crate::emitters::{DiskPoints, Disks, LightSample, SceneLights, TriangleLights};
use crate::radiometry::{Rgb, importance};
use crate::random::Numbers;
use crate::rays::Eye;
use crate::sampling::{CHOICES, Turn, power_heuristic};
use crate::surface::{ExitDirection, Inside, Parts, Reflection, Surface, World};
use glam::Vec3;
use std::f32::consts::PI;

/// Reflections before a walk may be ended by chance.
const SURE_REFLECTIONS: u32 = 2;
/// Most that a walk goes on with by chance, so that it ends even between white walls.
const MOST_SURVIVAL: f32 = 0.97;
/// Clear surfaces in a row before a walk may be ended by chance.
const SURE_CROSSINGS: u32 = 8;

/// Caustics that were found from the lights: the irradiance that came from emitters, the sun or
/// points by one or more sharp lobes ([`Reflection::is_sharp`]) or clear surfaces that mirrored or
/// bent it, and nothing else.
pub trait Caustics: Sync {
    /// At a point of a surface.
    fn irradiance(&self, surface: &Surface) -> Mapped;
}

/// What a map of caustics says of a point.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Mapped {
    /// Irradiance.
    pub irradiance: Rgb,
    /// A random value with the mean 0 and the variance of the irradiance: how far light rays
    /// scatter.
    pub scatter: Rgb,
}

/// What traces paths.
pub struct Tracer<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its lights.
    pub lights: &'a SceneLights,
    /// What stands for them where Lange's sampling is asked for.
    pub disks: Option<(&'a Disks, DiskPoints)>,
    /// Most reflections of a path.
    pub reflections: u32,
    /// Rays that leave the first surface N.
    pub rays_per_pixel: u32,
    /// Where to read caustics, instead of finding them by chance.
    pub caustics: Option<&'a dyn Caustics>,
}

/// The random numbers of a pixel's paths, and the rays that they took.
pub struct Walk {
    /// The numbers.
    pub numbers: Numbers,
    /// Rays so far.
    pub rays: u64,
    /// Those of them that were cast at a light.
    pub light_rays: u64,
    /// What [`Mapped::scatter`] adds to the radiance in place of the irradiance.
    pub by_map: Rgb,
    /// Whether a camera ray saw an emitter.
    pub saw_emitter: bool,
    /// Whether the camera ray met no surface.
    pub missed: bool,
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
        Self {
            numbers,
            rays: 0,
            light_rays: 0,
            by_map: Rgb::ZERO,
            saw_emitter: false,
            missed: false,
            turn: None,
        }
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

/// What a walk multiplies radiance by.
#[derive(Clone, Copy)]
struct Carried {
    /// All reflections so far.
    all: Rgb,
    /// The part of it that since its last diffuse reflection was only mirrored by sharp lobes or
    /// let through: 0 before the first, and where no map has the caustics.
    since_diffuse: Rgb,
    /// The part of that which was mirrored or let through at least once: the map has what it
    /// brings from emitters.
    mapped: Rgb,
}

impl Carried {
    const START: Self = Self { all: Rgb::ONE, since_diffuse: Rgb::ZERO, mapped: Rgb::ZERO };

    fn times(self, factor: Rgb) -> Self {
        Self {
            all: self.all * factor,
            since_diffuse: self.since_diffuse * factor,
            mapped: self.mapped * factor,
        }
    }

    /// After a reflection.
    fn reflected(self, surface: &Surface, factor: Parts, has_map: bool) -> Self {
        let all = self.all * factor.both();
        if !has_map {
            return Self { all, ..Self::START };
        }
        let sharp = surface.reflection().is_sharp();
        let mapped = if sharp { self.since_diffuse * factor.lobe } else { Rgb::ZERO };
        Self { all, since_diffuse: self.all * factor.diffuse + mapped, mapped }
    }

    /// After a clear surface.
    fn passed(self, tint: Rgb) -> Self {
        Self { mapped: self.since_diffuse, ..self }.times(tint)
    }

    /// What of it counts for light from an emitter.
    fn unmapped(&self) -> Rgb {
        self.all - self.mapped
    }
}

/// A ray of a walk.
struct Flight {
    eye: Eye,
    origin: Vec3,
    direction: Vec3,
    /// Density per solid angle that the direction was picked with; infinite where light can't be
    /// sampled instead.
    density: f32,
    /// Place and unit shading normal where it began, for which lights were sampled, too; `None` of
    /// rays from the camera.
    from: Option<(Vec3, Vec3)>,
    carried: Carried,
    /// What it is in.
    inside: Option<Inside>,
    /// Length of its way through panes that do not bend it, ray units.
    way: f32,
}

impl Flight {
    /// Leaves a clear surface. What goes straight through could have been found from where the
    /// flight began, by sampling lights; what is mirrored or bent could not.
    fn leave(&mut self, surface: &Surface, passed: &ExitDirection, is_straight: bool) {
        if passed.through {
            (self.origin, self.inside) = (surface.start_behind(), passed.inside);
        } else {
            (self.origin, self.eye) = (surface.start(), Eye::Light);
        }
        self.direction = passed.direction;
        if is_straight && passed.through {
            self.carried = self.carried.times(passed.tint);
        } else {
            self.carried = self.carried.passed(passed.tint);
            (self.density, self.way) = (f32::INFINITY, 0.0);
        }
    }
}

/// Where a walk met a surface that reflects it.
#[derive(Clone, Copy)]
struct Stop {
    surface: Surface,
    viewer: Vec3,
    carried: Carried,
    inside: Option<Inside>,
}

impl Tracer<'_> {
    /// An estimate of the radiance that arrives along a camera ray.
    pub fn radiance(&self, origin: Vec3, direction: Vec3, walk: &mut Walk) -> Rgb {
        let flight = Flight {
            eye: Eye::Camera,
            origin,
            direction,
            density: f32::INFINITY,
            from: None,
            carried: Carried::START,
            inside: None,
            way: 0.0,
        };
        let (radiance, stop) = self.follow(flight, walk);
        match stop {
            Some(stop) => radiance + self.reflected(&stop, walk),
            None => radiance,
        }
    }

    /// Follows a ray through clear surfaces to one that reflects it, and says what emitters on the
    /// way bring.
    fn follow(&self, mut flight: Flight, walk: &mut Walk) -> (Rgb, Option<Stop>) {
        let (mut radiance, mut crossings) = (Rgb::ZERO, 0);
        loop {
            walk.rays += 1;
            let hit = self.world.rays.closest(flight.eye, flight.origin, flight.direction);
            let Some(hit) = hit else {
                if crossings == 0 && flight.from.is_none() {
                    walk.missed = true;
                    return (self.world.beside_surfaces(flight.direction), None);
                }
                return (radiance + self.escaped(&flight), None);
            };
            let Some(surface) = self.world.met(&hit) else { return (radiance, None) };
            flight.way += hit.distance;
            if let Some(inside) = &flight.inside {
                flight.carried = flight.carried.times(inside.left_after(hit.distance));
            }
            if crossings == 0 && flight.eye == Eye::Camera {
                walk.saw_emitter |= surface.emission != Rgb::ZERO;
                if self.world.finish(surface.triangle).is_unlit {
                    let shine = self.world.shine(surface.triangle, surface.at.into());
                    return (radiance + shine, None);
                }
            }
            radiance += self.emitted(&flight, &surface);
            let viewer = -flight.direction;
            let clear = surface
                .clear
                .filter(|clear| clear.share >= 1.0 || walk.numbers.uniform() < clear.share);
            let Some(clear) = clear else {
                let Flight { carried, inside, .. } = flight;
                let stop = Stop { surface, viewer, carried, inside };
                return (radiance, Some(self.on_a_side(stop, walk)));
            };
            crossings += 1;
            if crossings > SURE_CROSSINGS {
                let survival = flight.carried.all.max_element().min(MOST_SURVIVAL);
                if walk.numbers.uniform() >= survival {
                    return (radiance, None);
                }
                flight.carried = flight.carried.times(Rgb::splat(1.0 / survival));
            }
            let mut clear = clear;
            if clear.disperses() {
                let (one, factor) = clear.split(flight.carried.all, walk.numbers.uniform());
                (clear, flight.carried) = (one, flight.carried.times(factor));
            }
            let xi = [(); 3].map(|()| walk.numbers.uniform());
            let Some(passed) = clear.pass(surface.side(), viewer, xi) else {
                return (radiance, None);
            };
            flight.leave(&surface, &passed, self.is_pane(&surface, clear.is_straight()));
        }
    }

    /// A stop on the side of the surface that light comes from next: where it lets light through
    /// diffusely, one of both by chance.
    fn on_a_side(&self, stop: Stop, walk: &mut Walk) -> Stop {
        if !self.world.is_translucent(stop.surface.triangle) {
            return stop;
        }
        let far = self.world.far_side(&stop.surface, stop.viewer);
        let near = importance(stop.surface.reflection().albedo(stop.viewer));
        let share = importance(far.albedo());
        let share = if share > 0.0 { share / (near + share) } else { 0.0 };
        if walk.numbers.uniform() >= share {
            return Stop { carried: stop.carried.times(Rgb::splat(1.0 / (1.0 - share))), ..stop };
        }
        let carried = stop.carried.times(Rgb::splat(1.0 / share));
        Stop { surface: far.surface, viewer: far.viewer, carried, ..stop }
    }

    /// Whether light samples see through a surface; disks are not sampled through panes.
    fn is_pane(&self, surface: &Surface, is_straight: bool) -> bool {
        is_straight && self.world.is_pane(surface.triangle)
    }

    /// What a surface that a ray meets brings by its own light, as far as it was not sampled.
    fn emitted(&self, flight: &Flight, surface: &Surface) -> Rgb {
        let is_sampled = flight.density.is_finite();
        if surface.emission == Rgb::ZERO || (self.disks.is_some() && is_sampled) {
            return Rgb::ZERO;
        }
        let other = self.lights.density(surface, flight.direction, flight.way);
        flight.carried.unmapped() * surface.emission * power_heuristic(flight.density, other)
    }

    /// What a ray brings that leaves the scene: sky and sun, as far as they were not sampled.
    fn escaped(&self, flight: &Flight) -> Rgb {
        let Flight { direction, density, from, carried, .. } = flight;
        let of = |((radiance, other), carried): ((Rgb, f32), Rgb)| {
            if radiance == Rgb::ZERO {
                Rgb::ZERO
            } else {
                carried * radiance * power_heuristic(*density, other)
            }
        };
        // Maps have light of the sun, and none of the sky.
        let carried = [carried.all, carried.unmapped()];
        self.lights.escaping(*from, *direction).into_iter().zip(carried).map(of).sum()
    }

    /// Radiance that the first surface reflects, by N rays: in proportion to what the diffuse
    /// part and the lobe reflect, or at random with N = 1.
    fn reflected(&self, stop: &Stop, walk: &mut Walk) -> Rgb {
        let Stop { surface, viewer, .. } = stop;
        if !surface.reflection().reflects() {
            return Rgb::ZERO;
        }
        let count = self.rays_per_pixel;
        let mut share = surface.reflection().diffuse_share(*viewer);
        let mut diffuse_count = 0;
        if count > 1 {
            // Each part that reflects gets a ray, and the share is what it then is.
            let least = u32::from(share > 0.0);
            let most = count - u32::from(share < 1.0);
            diffuse_count = ((share * count as f32).round() as u32).clamp(least, most);
            share = diffuse_count as f32 / count as f32;
        }
        let mut radiance = self.direct((stop, 0), share, count, walk) + self.caustics(stop, walk);
        let weight = 1.0 / count as f32;
        for index in 0..count {
            let diffusely =
                if count > 1 { index < diffuse_count } else { walk.chooses_diffuse(share, 0) };
            let before = std::mem::take(&mut walk.by_map);
            radiance += weight * self.walk(*stop, share, diffusely, walk);
            walk.by_map = before + weight * walk.by_map;
        }
        radiance
    }

    /// What a ray from a surface brings: emitters that it meets, weighed against their sampling
    /// from here, and everything that was reflected before.
    fn walk(&self, mut stop: Stop, mut share: f32, mut diffusely: bool, walk: &mut Walk) -> Rgb {
        let mut radiance = Rgb::ZERO;
        let mut reflections = 1;
        loop {
            let Stop { surface, viewer, .. } = stop;
            let xi = walk.pair(Choice::Direction, reflections - 1);
            let scattered = surface.reflection().sample(viewer, share, diffusely, xi);
            let Some(scattered) = scattered else { break };
            let has_map = self.caustics.is_some();
            let mut carried = stop.carried.reflected(&surface, scattered.factor, has_map);
            if reflections > SURE_REFLECTIONS {
                let survival = carried.all.max_element().min(MOST_SURVIVAL);
                if walk.numbers.uniform() >= survival {
                    break;
                }
                carried = carried.times(Rgb::splat(1.0 / survival));
            }
            let flight = Flight {
                eye: Eye::Light,
                origin: surface.start(),
                direction: scattered.direction,
                density: scattered.pdf,
                from: Some((stop.surface.start(), stop.surface.shading_normal)),
                carried,
                inside: stop.inside,
                way: 0.0,
            };
            let (met, next) = self.follow(flight, walk);
            radiance += met;
            let Some(next) = next else { break };
            if reflections == self.reflections || !next.surface.reflection().reflects() {
                break;
            }
            reflections += 1;
            stop = next;
            share = stop.surface.reflection().diffuse_share(stop.viewer);
            let number = reflections - 1;
            radiance += self.direct((&stop, number), share, 1, walk) + self.caustics(&stop, walk);
            diffusely = walk.chooses_diffuse(share, number);
        }
        radiance
    }

    /// What the diffuse part reflects of the caustics in the map.
    fn caustics(&self, stop: &Stop, walk: &mut Walk) -> Rgb {
        let diffuse = stop.surface.reflection().diffuse(stop.viewer);
        match self.caustics {
            Some(caustics) if diffuse != Rgb::ZERO => {
                let weight = stop.carried.all * diffuse / PI;
                let Mapped { irradiance, scatter } = caustics.irradiance(&stop.surface);
                walk.by_map += weight * scatter;
                weight * irradiance
            }
            _ => Rgb::ZERO,
        }
    }

    /// Light that comes from the emitters without detour and is reflected here, by `count`
    /// samples.
    fn direct(&self, (stop, number): (&Stop, u32), share: f32, count: u32, walk: &mut Walk) -> Rgb {
        let radiance = match (self.disks, &self.lights.triangles) {
            (_, None) => Rgb::ZERO,
            (None, Some(lights)) => self.direct_by_area(lights, (stop, number), share, count, walk),
            (Some(disks), _) => self.direct_by_disks(stop, disks, count, walk),
        };
        if self.lights.has_others() {
            return radiance + self.direct_from_others((stop, number), share, walk);
        }
        radiance
    }

    /// Light of sky, sun and lights without extent, by a sample of each.
    fn direct_from_others(&self, (stop, number): (&Stop, u32), share: f32, walk: &mut Walk) -> Rgb {
        // Emissive triangles take the well-spread numbers where there are some.
        let pair = match self.lights.triangles {
            None => walk.pair(Choice::LightPoint, number),
            Some(_) => [walk.numbers.uniform(), walk.numbers.uniform()],
        };
        let surface = &stop.surface;
        let sun = [walk.numbers.uniform(), walk.numbers.uniform()];
        let samples = [
            self.lights.sample_sky(surface, pair, &mut walk.numbers),
            self.lights.sample_sun(surface, sun),
            self.lights.sample_punctual(surface, &mut walk.numbers),
        ];
        // Maps have light of the sun and of points, and none of the sky.
        let sampled = samples.into_iter().zip([false, true, true]);
        let sampled = sampled.filter_map(|(light, is_mapped)| Some((light?, is_mapped)));
        sampled.map(|(light, is_mapped)| self.arriving(stop, light, share, (is_mapped, walk))).sum()
    }

    /// What a surface reflects of a light sample that nothing hides; a map of caustics may have a
    /// part of it.
    fn arriving(
        &self,
        stop: &Stop,
        light: LightSample,
        share: f32,
        (is_mapped, walk): (bool, &mut Walk),
    ) -> Rgb {
        let Stop { surface, viewer, carried, .. } = stop;
        let LightSample { end, direction, radiance: emitted, density } = light;
        let (parts, other) = surface.reflection().evaluate_with_pdf(*viewer, direction, share);
        let reflected = carried.reflected(surface, parts, self.caustics.is_some());
        let value = if is_mapped { reflected.unmapped() } else { reflected.all };
        let cosine = surface.shading_normal.dot(direction);
        let weight = match density.is_finite() {
            true => cosine / density * power_heuristic(density, other),
            // All of a light without extent is in the sample.
            false => cosine,
        };
        let mut arriving = value * emitted * weight;
        if arriving == Rgb::ZERO {
            return arriving;
        }
        if let Some(inside) = &stop.inside {
            arriving *= inside.left_after((end - surface.start()).length());
        }
        walk.rays += 1;
        walk.light_rays += 1;
        arriving * self.world.visibility(surface.start(), end)
    }

    fn direct_by_area(
        &self,
        lights: &TriangleLights,
        (stop, number): (&Stop, u32),
        share: f32,
        count: u32,
        walk: &mut Walk,
    ) -> Rgb {
        let mut radiance = Rgb::ZERO;
        for index in 0..count {
            let pick = walk.single(Choice::Light, number);
            let pick = (f64::from(index) + pick) / f64::from(count);
            let xi = walk.pair(Choice::LightPoint, number);
            if let Some(light) = lights.sample(self.world, &stop.surface, pick, xi) {
                radiance += self.arriving(stop, light, share, (true, walk));
            }
        }
        radiance / count as f32
    }

    /// Lange's lights as Rogers prints them: the ray to a disk's centre counts w = cosⁿθ and the
    /// random ones 1 − w, with θ from the surface's normal and n its Phong exponent (1 where it
    /// has no lobe).
    fn direct_by_disks(
        &self,
        stop: &Stop,
        (disks, points): (&Disks, DiskPoints),
        count: u32,
        walk: &mut Walk,
    ) -> Rgb {
        let Stop { surface, viewer, carried, .. } = stop;
        let has_map = self.caustics.is_some();
        let reflection = surface.reflection();
        let exponent = if reflection.is_glossy() { reflection.exponent() } else { 1.0 };
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
                let cosine = surface.shading_normal.dot(direction);
                if cosine <= 0.0 || surface.normal.dot(direction) <= 0.0 {
                    return (Rgb::ZERO, 0.0);
                }
                walk.rays += 1;
                walk.light_rays += 1;
                let own = |triangle| disks.is_of(disk, triangle);
                if self.world.rays.blocked(from, end, own) {
                    return (Rgb::ZERO, cosine);
                }
                let parts = reflection.evaluate(*viewer, direction);
                let value = carried.reflected(surface, parts, has_map).unmapped();
                (value * light * cosine, cosine)
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
