//! The way of a ray through clear surfaces: from the first one that it meets to what is opaque, or
//! out of the scene. At each, chance says whether light was mirrored or let through, or whether the
//! surface is opaque there; the numbers follow from the ray itself, so that the same ray always goes
//! the same way.

use super::dielectric::{Clear, ExitDirection, Inside};
use super::differentials::{Differentials, Turn};
use super::point::Surface;
use super::reflection::Reflection;
use super::world::World;
use crate::radiometry::Rgb;
use crate::random::pcg;
use crate::rays::{Eye, Hit};
use glam::Vec3;

/// Clear surfaces in a row before a ray may be ended by chance, as far as some of it was taken.
const SURE_CROSSINGS: u32 = 8;
/// The same for what nothing was taken of: what goes on by chance counts as more than whole then, which
/// links of the coarse mesh cannot say. Light that a block of glass holds by total reflection comes to
/// its end after dozens of crossings.
const SURE_WHOLE_CROSSINGS: u32 = 128;
/// Most that it goes on with by chance after that, so that it ends even in white glass.
const MOST_SURVIVAL: f32 = 0.97;

/// Most panes that an aimed ray passes.
const MOST_PANES: u32 = 16;
/// Most mirrors that a ray follows in a row.
const MOST_MIRRORS: u32 = 8;
/// Most that chance lets a mirror mirror.
const MOST_MIRRORED: f32 = 0.98;

/// Probability at which [`World::follow_mirrors`] follows the lobe of a surface that is sharp: that of its
/// brightest channel, so that what is left of no channel grows, blue metal's neither.
pub fn mirrored_share(surface: &Surface, viewer: Vec3) -> f32 {
    surface.lobe_only().reflection().albedo(viewer).max_element().min(MOST_MIRRORED)
}

/// A ray that clear surfaces were in the way of.
#[derive(Clone, Copy, Debug)]
pub struct Passage {
    /// What is left of each channel of light that comes along it.
    pub left: Rgb,
    /// Radiance that clear surfaces on the way emit, as it arrives.
    pub shine: Rgb,
    /// Whether it was mirrored or bent anywhere; else it went on along its line.
    pub is_bent: bool,
    /// Unit direction at its end.
    pub direction: Vec3,
    /// Length of all its way, ray units.
    pub way: f32,
    /// What it came to.
    pub end: PassageEnd,
    /// A uniform number that nothing was decided by yet.
    pub chance: f32,
}

/// What a ray through clear surfaces came to.
#[derive(Clone, Copy, Debug)]
pub enum PassageEnd {
    /// A surface that is opaque there.
    Met(Hit),
    /// It left the scene.
    Escaped,
    /// Nothing: all was absorbed.
    Lost,
}

/// Uniform numbers of a ray.
struct HashedNumbers(u32);

impl HashedNumbers {
    fn new(direction: Vec3, hit: &Hit, number: u32) -> Self {
        let values = [direction.x, direction.y, direction.z, hit.u, hit.v];
        let start = pcg(hit.triangle ^ pcg(number));
        Self(values.iter().fold(start, |state, value| pcg(state ^ value.to_bits())))
    }

    fn next(&mut self) -> f32 {
        self.0 = pcg(self.0);
        (self.0 >> 8) as f32 * (1.0 / 16_777_216.0)
    }
}

impl World {
    /// What a ray from `origin` (ray units) along the unit `direction` meets, if need be behind clear
    /// surfaces.
    #[inline]
    pub fn look(&self, origin: Vec3, direction: Vec3) -> Passage {
        self.look_differing(origin, direction, || None).0
    }

    /// The same of a ray with such differentials where it starts, and what has become of them; `None` where nothing
    /// clear was in the way.
    pub fn look_differing(
        &self,
        origin: Vec3,
        direction: Vec3,
        differentials: impl FnOnce() -> Option<Differentials>,
    ) -> (Passage, Option<Differentials>) {
        match self.rays.closest(Eye::Light, origin, direction) {
            Some(hit) if self.is_clear(hit.triangle) => {
                let there = differentials().map(|own| own.after(hit.distance));
                self.pass_differing(hit, direction, there)
            }
            Some(hit) => (Passage::straight(direction, hit.distance, PassageEnd::Met(hit)), None),
            None => (Passage::straight(direction, f32::INFINITY, PassageEnd::Escaped), None),
        }
    }

    /// Follows a ray along the unit `direction`, which has met `hit`, through clear surfaces; where
    /// that is opaque it ends there.
    pub fn pass(&self, hit: Hit, direction: Vec3) -> Passage {
        self.pass_differing(hit, direction, None).0
    }

    /// The same of a ray with differentials, as they are at the hit, and what has become of them.
    fn pass_differing(
        &self,
        hit: Hit,
        direction: Vec3,
        differing: Option<Differentials>,
    ) -> (Passage, Option<Differentials>) {
        let mut numbers = HashedNumbers::new(direction, &hit, 0);
        let flight = Flight { differing, ..Flight::new(hit, direction, &mut numbers) };
        self.pass_from(flight, &mut numbers)
    }

    /// What a ray along the unit `direction` comes to that has met `hit`, if need be behind clear surfaces:
    /// by chance as [`World::pass`] or, of one that was aimed at something, straight on through panes; `None`
    /// where that cannot be.
    #[inline]
    pub fn reach(&self, hit: Hit, direction: Vec3, is_aimed: bool) -> Option<Passage> {
        if !self.is_clear(hit.triangle) {
            return Some(Passage::straight(direction, hit.distance, PassageEnd::Met(hit)));
        }
        if is_aimed { self.straight_on(hit, direction) } else { Some(self.pass(hit, direction)) }
    }

    /// Follows a ray along the unit `direction`, which has met `hit`, straight on through panes to what is
    /// none; `None` where something bends it, or where there is nothing.
    fn straight_on(&self, mut hit: Hit, direction: Vec3) -> Option<Passage> {
        let (mut left, mut way) = (Rgb::ONE, hit.distance);
        for _ in 0..MOST_PANES {
            if !self.is_clear(hit.triangle) {
                let straight = Passage::straight(direction, way, PassageEnd::Met(hit));
                return Some(Passage { left, ..straight });
            }
            if !self.is_pane(hit.triangle) {
                return None;
            }
            let start = self.surface_of(&hit).start_behind();
            left *= self.through_pane(hit.triangle, start, direction);
            hit = self.rays.closest(Eye::Light, start, direction)?;
            way += hit.distance;
        }
        None
    }

    fn pass_from(
        &self,
        mut flight: Flight,
        numbers: &mut HashedNumbers,
    ) -> (Passage, Option<Differentials>) {
        loop {
            let Some((surface, clear)) = self.arrive(&mut flight, numbers) else {
                return (flight.passage, flight.differing);
            };
            let clear = flight.split(clear, numbers);
            let xi = [numbers.next(), numbers.next(), numbers.next()];
            let passed = clear.pass(surface.side(), -flight.passage.direction, xi);
            if !self.leave(&mut flight, (&surface, &clear), passed) {
                return (flight.passage, flight.differing);
            }
        }
    }

    /// Follows a camera's ray, which has met `hit`, both ways that it goes from there, mirrored and
    /// let through; each has its share in [`Passage::left`]. A ray that is traced several times goes
    /// other ways for another `number`. Its differentials, if it has any, are those at the hit.
    pub fn pass_both(
        &self,
        (hit, differing): (Hit, Option<Differentials>),
        direction: Vec3,
        number: u32,
    ) -> [Option<(Passage, Option<Differentials>)>; 2] {
        let mut numbers = HashedNumbers::new(direction, &hit, number);
        let mut flight = Flight { differing, ..Flight::new(hit, direction, &mut numbers) };
        flight.eye = Eye::Camera;
        let Some((surface, clear)) = self.arrive(&mut flight, &mut numbers) else {
            return [Some((flight.passage, differing)), None];
        };
        let clear = flight.split(clear, &mut numbers);
        let xi = [numbers.next(), numbers.next()];
        let both = clear.pass_both(surface.side(), -direction, xi);
        let mut way = |(share, passed): (f32, Option<ExitDirection>)| {
            let mut flight = flight;
            flight.passage.left *= share;
            if share <= 0.0 {
                return None;
            }
            if self.leave(&mut flight, (&surface, &clear), passed) {
                return Some(self.pass_from(flight, &mut numbers));
            }
            Some((flight.passage, flight.differing))
        };
        both.map(&mut way)
    }

    /// Follows a ray that has met a sharp mirror, as often as chance says that it is mirrored, to what
    /// reflects it diffusely, or out of the scene. At a mirror that it ends at, chance has picked what
    /// is reflected diffusely.
    pub fn follow_mirrors(&self, mut passage: Passage) -> Passage {
        for _ in 0..MOST_MIRRORS {
            let Some(hit) = passage.met().filter(|hit| self.may_mirror(hit.triangle)) else {
                break;
            };
            let Some(surface) = self.surface(&hit) else { break };
            if !surface.reflection().is_sharp() {
                break;
            }
            let mut numbers = HashedNumbers::new(passage.direction, &hit, 1);
            passage.chance = numbers.next();
            let viewer = -passage.direction;
            let share = mirrored_share(&surface, viewer);
            if numbers.next() >= share {
                break;
            }
            passage.is_bent = true;
            let xi = [numbers.next(), numbers.next()];
            let lobe = surface.lobe_only().reflection();
            let Some(scattered) = lobe.sample(viewer, 0.0, false, xi) else {
                passage.end = PassageEnd::Lost;
                break;
            };
            passage.left *= scattered.factor.lobe / share;
            let next = self.look(surface.start(), scattered.direction);
            passage.shine += passage.left * next.shine;
            passage.left *= next.left;
            (passage.direction, passage.end) = (next.direction, next.end);
            passage.way += next.way;
        }
        passage
    }

    /// Where a ray has arrived: a surface that it goes on at as clear; `None` where it is opaque, or
    /// where chance ends it.
    fn arrive(&self, flight: &mut Flight, numbers: &mut HashedNumbers) -> Option<(Surface, Clear)> {
        let Flight { passage, hit, inside, crossings, .. } = flight;
        passage.end = PassageEnd::Met(*hit);
        let surface = self.surface_of(hit);
        // What it was in: a surface at the end of the way that bounds that knows it, too.
        if let Some(inside) = surface.body_before().or(*inside) {
            passage.left *= inside.left_after(hit.distance);
        }
        let clear = surface.clear.filter(|clear| numbers.next() < clear.share)?;
        if *crossings > 0 {
            passage.shine += passage.left * surface.emission;
        }
        *crossings += 1;
        passage.survives(*crossings, numbers).then_some((surface, clear))
    }

    /// Goes on from a clear surface to the next one, or out of the scene; whether there is a next one.
    fn leave(
        &self,
        flight: &mut Flight,
        (surface, clear): (&Surface, &Clear),
        passed: Option<ExitDirection>,
    ) -> bool {
        let Flight { passage, hit, inside, eye, differing, .. } = flight;
        let Some(passed) = passed else {
            passage.end = PassageEnd::Lost;
            return false;
        };
        passage.left *= passed.tint;
        passage.is_bent |= !(passed.through && self.is_pane(hit.triangle));
        *differing = differing.map(|own| {
            let index = passed.through.then(|| clear.index(surface.back));
            let turn = Turn::by_facets([passage.direction, passed.direction], index, clear.alpha());
            own.leaving(self, surface, turn)
        });
        passage.direction = passed.direction;
        let mut start = surface.start();
        if passed.through {
            (start, *inside) = (surface.start_behind(), passed.inside);
        } else {
            *eye = Eye::Light;
        }
        let Some(next) = self.rays.closest(*eye, start, passed.direction) else {
            passage.end = PassageEnd::Escaped;
            return false;
        };
        passage.way += next.distance;
        *differing = differing.map(|own| own.after(next.distance));
        *hit = next;
        true
    }
}

/// A ray on its way.
#[derive(Clone, Copy)]
struct Flight {
    passage: Passage,
    /// Whose it is: a camera's as long as nothing mirrored it, so that it passes backs that are not there
    /// for cameras.
    eye: Eye,
    /// What it came to last.
    hit: Hit,
    inside: Option<Inside>,
    crossings: u32,
    /// Its differentials where it is, if it has any.
    differing: Option<Differentials>,
}

impl Flight {
    fn new(hit: Hit, direction: Vec3, numbers: &mut HashedNumbers) -> Self {
        let passage = Passage::straight(direction, hit.distance, PassageEnd::Met(hit));
        let passage = Passage { chance: numbers.next(), ..passage };
        Self { passage, eye: Eye::Light, hit, inside: None, crossings: 0, differing: None }
    }

    /// A clear surface as the ray meets it: as one colour where that bends colours by different angles.
    fn split(&mut self, clear: Clear, numbers: &mut HashedNumbers) -> Clear {
        if !clear.disperses() {
            return clear;
        }
        let (clear, factor) = clear.split(self.passage.left, numbers.next());
        self.passage.left *= factor;
        clear
    }
}

impl Passage {
    /// A ray that nothing clear was in the way of.
    fn straight(direction: Vec3, way: f32, end: PassageEnd) -> Self {
        let (left, shine) = (Rgb::ONE, Rgb::ZERO);
        Self { left, shine, is_bent: false, direction, way, end, chance: 0.0 }
    }

    /// Ends it by chance after many crossings; whether it goes on.
    fn survives(&mut self, crossings: u32, numbers: &mut HashedNumbers) -> bool {
        if crossings <= SURE_CROSSINGS {
            return true;
        }
        let most = if crossings > SURE_WHOLE_CROSSINGS { MOST_SURVIVAL } else { 1.0 };
        let survival = self.left.max_element().min(most);
        if numbers.next() >= survival {
            self.end = PassageEnd::Lost;
            return false;
        }
        self.left /= survival;
        true
    }

    /// Radiance that a bent ray brings of what is not reflected: of the sky, and `with_emission` of
    /// emitters. Of the sun, which such rays meet too seldom, it brings nothing.
    pub fn bent_light(&self, world: &World, with_emission: bool) -> Rgb {
        let shine = if with_emission { self.shine } else { Rgb::ZERO };
        match self.end {
            PassageEnd::Escaped => shine + self.left * world.environment.radiance(self.direction),
            PassageEnd::Met(hit) if with_emission => {
                let surface = world.surface(&hit);
                shine + surface.map_or(Rgb::ZERO, |surface| self.left * surface.emission)
            }
            _ => shine,
        }
    }

    /// What it met; `None` where that is nothing.
    pub fn met(&self) -> Option<Hit> {
        match self.end {
            PassageEnd::Met(hit) => Some(hit),
            _ => None,
        }
    }
}
