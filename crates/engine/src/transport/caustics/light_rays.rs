//! Rays from the lights by way of what makes caustics to the diffuse surfaces behind it.
//!
//! Half of them leave the light by the cosine, and count where they meet a sharp mirror or a clear
//! surface; the other half goes to points picked on those. A point y of a light and a point s of
//! such a surface weigh by how likely both ways together are to join them (balance heuristic):
//! Φ = L_e G(y, s) / (p(y) (½ p_a(s|y) + ½ p_b(s))) / N, with p_a = cosθ_y cosθ_s/(π r²) and
//! p_b = 1/(their area). Since G = π p_a, no ray carries more than twice what it would by the cosine
//! alone, and none is wasted where what makes the caustic is small.
//!
//! Light of the sun and of points has one direction at a point s: all of its rays go to points picked
//! on what makes caustics, with Φ = E cosθ_s/p_b(s)/N. Each kind of light gets the same number of
//! rays.

use super::map::PowerDeposit;
use crate::emitters::{EmissionSample, SceneLights};
use crate::radiometry::Rgb;
use crate::random::{Numbers, Stream};
use crate::rays::Eye;
use crate::sampling::Discrete;
use crate::sampling::frame;
use crate::scene::Material;
use crate::surface::{Clear, Inside, Reflection, Surface, World};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::ops::Range;

/// Rays that are traced in a row by one thread.
const CHUNK: u64 = 256;
/// Mirrors and clear surfaces on the way before a ray may be ended by chance.
const SURE_BOUNCES: u32 = 4;
/// Most that it goes on with by chance.
const MOST_SURVIVAL: f32 = 0.97;
/// Least coverage of a material that light on it is divided by.
const LEAST_COVERAGE: f32 = 0.01;
/// Numbers of a well-spread sequence that a ray takes.
const DIMENSIONS: usize = 6;

/// The triangles that make caustics.
pub struct Casters {
    triangles: Vec<u32>,
    choice: Discrete,
    /// 1/(their area), square ray units.
    density: f32,
}

impl Casters {
    /// Those of a scene; `None` without any.
    pub fn new(world: &World) -> Option<Self> {
        let scene = &world.scene;
        let area = |index: u32| f64::from(world.rays.corners(scene, index).1);
        let casting = scene.triangles_of(Material::casts_caustics);
        let triangles: Vec<u32> = casting.filter(|index| area(*index) > 0.0).collect();
        let total: f64 = triangles.iter().map(|index| area(*index)).sum();
        (total > 0.0).then(|| Self {
            choice: Discrete::new(triangles.iter().map(|index| area(*index))),
            triangles,
            density: (1.0 / total) as f32,
        })
    }

    /// A point of one of them, uniform in area: triangle and barycentric (u, v).
    fn point(&self, xi: [f64; 3]) -> (u32, [f32; 2]) {
        let triangle = self.triangles[self.choice.pick(xi[0])];
        let root = xi[1].sqrt() as f32;
        (triangle, [root * (1.0 - xi[2] as f32), root * xi[2] as f32])
    }
}

/// A scene and its lights.
#[derive(Clone, Copy)]
pub struct Lit<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its lights.
    pub lights: &'a SceneLights,
}

/// Kinds of light that make caustics.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Triangles,
    Sun,
    Points,
}

impl Lit<'_> {
    /// The kinds of light that there are.
    fn kinds(&self) -> Vec<Kind> {
        let lights = self.lights;
        let all = [
            (Kind::Triangles, lights.triangles.is_some()),
            (Kind::Sun, lights.has_sun()),
            (Kind::Points, lights.punctual_count() > 0),
        ];
        all.into_iter().filter(|(_, shines)| *shines).map(|(kind, _)| kind).collect()
    }

    /// Whether anything shines that maps have light of.
    pub fn casts(&self) -> bool {
        !self.kinds().is_empty()
    }
}

/// What shoots light.
pub struct LightRays<'a> {
    /// The scene and its lights.
    pub lit: Lit<'a>,
    /// What makes caustics in it.
    pub casters: &'a Casters,
    /// Rays of a pass, even.
    pub count: u64,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Results of a number of light rays shot from the emitters.
#[derive(Default)]
pub struct Shower {
    /// Where they landed on diffuse surfaces, in the order of the rays.
    pub deposits: Vec<PowerDeposit>,
    /// Rays that it took, with those between two mirrors.
    pub rays: u64,
}

impl LightRays<'_> {
    /// Shoots some of the rays of a pass.
    pub fn shoot(&self, pass: u64, rays: Range<u64>) -> Shower {
        let mut shifts = Numbers::new(self.seed, Stream::LightShift, pass);
        let shifts: [f64; DIMENSIONS] = std::array::from_fn(|_| shifts.fine());
        let chunks = (rays.end - rays.start).div_ceil(CHUNK);
        let showers: Vec<Shower> = (0..chunks)
            .into_par_iter()
            .map(|chunk| {
                let first = rays.start + chunk * CHUNK;
                let mut shower = Shower::default();
                for ray in first..(first + CHUNK).min(rays.end) {
                    self.trace(pass, ray, &shifts, &mut shower);
                }
                shower
            })
            .collect();
        let mut all = Shower::default();
        for shower in showers {
            all.deposits.extend(shower.deposits);
            all.rays += shower.rays;
        }
        all
    }

    /// One ray of a pass.
    fn trace(&self, pass: u64, ray: u64, shifts: &[f64; DIMENSIONS], shower: &mut Shower) {
        let kinds = self.lit.kinds();
        if kinds.is_empty() {
            return;
        }
        let numbers = Numbers::new(self.seed, Stream::LightRay, pass * self.count + ray);
        // Pairs of rays go to the kinds of light in turn.
        let (pair, of_kinds) = (ray / 2, kinds.len() as u64);
        let pairs = self.count / 2;
        let kind = (pair % of_kinds) as usize;
        let own = pairs / of_kinds + u64::from((kind as u64) < pairs % of_kinds);
        let mut walk = Walk { numbers, power: Rgb::ZERO, rays: 0, count: (2 * own) as f32 };
        let (number, is_first) = (pair / of_kinds, ray.is_multiple_of(2));
        let first = match (kinds[kind], &self.lit.lights.triangles) {
            (Kind::Triangles, Some(lights)) => {
                // Each way to the first surface has the sequence to itself.
                let xi = spread(number, shifts);
                let light = lights.emit(self.lit.world, xi[0], [xi[1] as f32, xi[2] as f32]);
                if is_first {
                    self.by_cosine(&light, [xi[3] as f32, xi[4] as f32], &mut walk)
                } else {
                    self.by_area(&light, [xi[3], xi[4], xi[5]], &mut walk)
                }
            }
            (kind, _) => {
                let xi = spread(2 * number + u64::from(!is_first), shifts);
                self.by_direction(kind, &xi, &mut walk)
            }
        };
        if let Some((surface, source)) = first {
            self.go_on(surface, source, &mut walk, &mut shower.deposits);
        }
        shower.rays += walk.rays;
    }

    /// A point of what makes caustics that the sun, or a light without extent, shines on, and the
    /// direction to the light.
    fn by_direction(
        &self,
        kind: Kind,
        xi: &[f64; DIMENSIONS],
        walk: &mut Walk,
    ) -> Option<(Surface, Vec3)> {
        let Lit { world, lights } = self.lit;
        let (triangle, at) = self.casters.point([xi[3], xi[4], xi[5]]);
        let front = world.at(triangle, at, false);
        let (source, end, irradiance) = match kind {
            Kind::Sun => {
                let (direction, irradiance) = lights.sun_ray([xi[1] as f32, xi[2] as f32])?;
                (direction, front.spot.point + direction * world.rays.beyond(), irradiance)
            }
            _ => {
                let count = lights.punctual_count();
                let number = ((xi[0] * count as f64) as usize).min(count - 1);
                let xi = [xi[1] as f32, xi[2] as f32];
                let light = lights.punctual_at(number, front.spot.point, xi)?;
                (light.direction, light.end, light.irradiance * count as f32)
            }
        };
        let surface = self.facing(front, source)?;
        let arriving = surface.normal.dot(source);
        let casts = surface.clear.is_some() || surface.reflection().is_sharp();
        walk.rays += 1;
        if !casts || world.rays.blocked(surface.start(), end, |_| false) {
            return None;
        }
        let area = world.square_metre() / self.casters.density;
        let left = match kind {
            Kind::Sun => Rgb::ONE,
            _ => left_within(&surface, end.distance(front.spot.point)),
        };
        walk.power = irradiance * left * (arriving * area / walk.count);
        (walk.power != Rgb::ZERO).then_some((surface, source))
    }

    /// The side of a surface that faces a direction; `None` where that is black.
    fn facing(&self, front: Surface, to_light: Vec3) -> Option<Surface> {
        if front.normal.dot(to_light) > 0.0 {
            return Some(front);
        }
        let world = self.lit.world;
        let has_back = front.clear.is_some() || world.is_two_sided(front.triangle);
        has_back.then(|| world.at(front.triangle, front.at, true))
    }

    /// The first surface, where it makes caustics, and the direction to the light.
    fn by_cosine(
        &self,
        light: &EmissionSample,
        xi: [f32; 2],
        walk: &mut Walk,
    ) -> Option<(Surface, Vec3)> {
        let side = if light.two_sided && walk.numbers.uniform() < 0.5 { -1.0 } else { 1.0 };
        let normal = light.spot.normal * side;
        let (cosine, sine) = ((1.0 - xi[0]).sqrt(), xi[0].sqrt());
        let (tangent, bitangent) = frame(normal, TAU * xi[1]);
        debug_assert!(bitangent.is_finite());
        let direction = normal * cosine + tangent * sine;
        walk.rays += 1;
        let origin = light.spot.off_surface(normal);
        let (surface, _) = self.lit.world.meet(Eye::Light, origin, direction)?;
        self.join(light, surface, walk)
    }

    /// A point of what makes caustics, where the light sees it, and the direction to the light.
    fn by_area(
        &self,
        light: &EmissionSample,
        xi: [f64; 3],
        walk: &mut Walk,
    ) -> Option<(Surface, Vec3)> {
        let (triangle, at) = self.casters.point(xi);
        let front = self.lit.world.at(triangle, at, false);
        let surface = self.facing(front, light.spot.point - front.spot.point)?;
        let joined = self.join(light, surface, walk)?;
        let side = -light.spot.normal.dot(joined.1).signum();
        walk.rays += 1;
        let origin = light.spot.off_surface(light.spot.normal * side);
        (!self.lit.world.rays.blocked(origin, surface.start(), |_| false)).then_some(joined)
    }

    /// What light brings to a surface that it is joined with, if that makes caustics.
    fn join(
        &self,
        light: &EmissionSample,
        surface: Surface,
        walk: &mut Walk,
    ) -> Option<(Surface, Vec3)> {
        if !(surface.clear.is_some() || surface.reflection().is_sharp())
            || surface.triangle == light.triangle
        {
            return None;
        }
        let to_light = light.spot.point - surface.spot.point;
        let square = to_light.length_squared();
        let source = to_light / square.sqrt();
        let mut leaving = -light.spot.normal.dot(source);
        if light.two_sided {
            leaving = leaving.abs();
        }
        let arriving = surface.normal.dot(source);
        if !(leaving > 0.0 && arriving > 0.0 && square > 0.0) {
            return None;
        }
        let geometry = leaving * arriving / square;
        let by_cosine = geometry / if light.two_sided { TAU } else { PI };
        let both = 0.5 * (by_cosine + self.casters.density);
        let share = (geometry / both / walk.count) / light.density;
        let left = left_within(&surface, square.sqrt());
        walk.power = light.radiance * left * (share * self.lit.world.square_metre());
        (walk.power != Rgb::ZERO).then_some((surface, source))
    }

    /// What a ray from that direction brings to a surface, in the units of radiance that walks from the
    /// camera carry: over n² inside a body, and where a material has holes or is half there, as much as
    /// comes to what is there of it.
    fn landed(
        &self,
        surface: &Surface,
        (source, inside): (Vec3, Option<Inside>),
        walk: &Walk,
    ) -> PowerDeposit {
        let Surface { triangle, back, at, .. } = *surface;
        let scene = &self.lit.world.scene;
        let coverage = scene.coverage(&scene.triangle(triangle), at[0], at[1]);
        let density = inside.map_or(1.0, |body| body.density_of_light());
        let factor = surface.side().irradiance_factor(source);
        let power = walk.power * (factor / (density * coverage.max(LEAST_COVERAGE)));
        PowerDeposit { triangle, back, at, power }
    }

    /// Follows light from its first surface through mirrors and clear surfaces.
    fn go_on(
        &self,
        mut surface: Surface,
        mut source: Vec3,
        walk: &mut Walk,
        deposits: &mut Vec<PowerDeposit>,
    ) {
        let start_power = walk.power.max_element();
        // What it is in, from the beginning on.
        let mut inside = surface.body_before();
        let mut has_crossed = false;
        // What only passed panes is found as direct light.
        let mut is_bent = false;
        for bounce in 0.. {
            if !walk.power.is_finite() {
                return;
            }
            if is_bent && surface.reflection().mean_diffuse() != Rgb::ZERO {
                // Emission inside a body counts as radiance over n² as long as it is in there.
                let body = inside.filter(|_| has_crossed);
                deposits.push(self.landed(&surface, (source, body), walk));
            }
            let clear = surface
                .clear
                .filter(|clear| clear.share >= 1.0 || walk.numbers.uniform() < clear.share);
            let (origin, direction);
            if let Some(clear) = clear {
                let clear = walk.split(clear);
                let xi = [(); 3].map(|()| walk.numbers.uniform());
                let Some(passed) = clear.pass(surface.side(), source, xi) else { return };
                is_bent |= !(passed.through && self.lit.world.is_pane(surface.triangle));
                walk.power *= passed.tint * passed.power_factor(surface.side(), source);
                direction = passed.direction;
                if passed.through {
                    (origin, inside) = (surface.start_behind(), passed.inside);
                    if let Some(body) = clear.inside().filter(|_| surface.back && !has_crossed) {
                        walk.power *= body.density_of_light();
                    }
                    has_crossed |= clear.inside().is_some();
                } else {
                    origin = surface.start();
                }
            } else if surface.reflection().is_sharp() {
                let xi = [walk.numbers.uniform(), walk.numbers.uniform()];
                let lobe = surface.lobe_only().reflection();
                let Some(scattered) = lobe.sample(source, 0.0, false, xi) else { return };
                is_bent = true;
                let factor = surface.side().power_factor(scattered.direction, source);
                walk.power *= scattered.factor.lobe * factor;
                (origin, direction) = (surface.start(), scattered.direction);
            } else {
                return;
            }
            if bounce >= SURE_BOUNCES {
                let survival = (walk.power.max_element() / start_power).min(MOST_SURVIVAL);
                if walk.numbers.uniform() >= survival {
                    return;
                }
                walk.power /= survival;
            }
            walk.rays += 1;
            let Some((met, distance)) = self.lit.world.meet(Eye::Light, origin, direction) else {
                return;
            };
            if let Some(inside) = &inside {
                walk.power *= inside.left_after(distance);
            }
            (surface, source) = (met, -direction);
        }
    }
}

/// What is left of light that has come so far, ray units, to a surface: of light from inside a body, what
/// that has not absorbed.
fn left_within(surface: &Surface, way: f32) -> Rgb {
    surface.body_before().map_or(Rgb::ONE, |body| body.left_after(way))
}

/// A ray on its way.
struct Walk {
    numbers: Numbers,
    power: Rgb,
    rays: u64,
    /// Rays of its kind of light in a pass.
    count: f32,
}

impl Walk {
    /// A clear surface as the ray meets it: as one colour where that bends colours by different angles.
    fn split(&mut self, clear: Clear) -> Clear {
        if !clear.disperses() {
            return clear;
        }
        let (clear, factor) = clear.split(self.power, self.numbers.uniform());
        self.power *= factor;
        clear
    }
}

/// Place of a ray in a well-spread sequence in the unit cube: additive recurrence by the powers of
/// the generalised golden ratio, x⁷ = x + 1, shifted by random numbers.
fn spread(index: u64, shifts: &[f64; DIMENSIONS]) -> [f64; DIMENSIONS] {
    const RATIO: f64 = 1.112_775_684_278_705_5;
    let mut step = 1.0;
    shifts.map(|shift| {
        step /= RATIO;
        (shift + index as f64 * step).fract()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use std::sync::Arc;

    /// What lands by both ways to the first surface, and by the cosine alone.
    #[test]
    fn both_ways_bring_the_light_that_one_brings() {
        for bytes in [made::ring(), made::glass()] {
            let scene = import(&bytes, &Resources::new(), &ImportLimits::default());
            let world = World::new(Arc::new(scene.expect("a valid scene")));
            let lights = SceneLights::new(&world).expect("it has a lamp");
            let lit = Lit { world: &world, lights: &lights };
            let mut casters = Casters::new(&world).expect("it makes caustics");
            let mut landed = |alone: bool| {
                if alone {
                    casters.density = 0.0;
                }
                let (count, seed) = (300_000, 1);
                let rays = LightRays { lit, casters: &casters, count, seed };
                let mut shower = Shower::default();
                for ray in (0..count).step_by(if alone { 2 } else { 1 }) {
                    rays.trace(0, ray, &[0.1, 0.7, 0.3, 0.9, 0.5, 0.2], &mut shower);
                }
                shower.deposits.iter().map(|deposit| f64::from(deposit.power.x)).sum::<f64>()
            };
            let (both, alone) = (landed(false), landed(true));
            println!("{both} W by both ways, {alone} W by the cosine");
            assert!((alone / both - 1.0).abs() < 0.05, "{alone} {both}");
        }
    }

    #[test]
    fn rays_do_not_depend_on_the_number_of_threads() {
        let scene = import(&made::ring(), &Resources::new(), &ImportLimits::default());
        let world = World::new(Arc::new(scene.expect("a valid scene")));
        let lights = SceneLights::new(&world).expect("it has a lamp");
        let lit = Lit { world: &world, lights: &lights };
        let casters = Casters::new(&world).expect("it makes caustics");
        let rays = LightRays { lit, casters: &casters, count: 5000, seed: 9 };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let shower = pool.install(|| rays.shoot(3, 1000..4001));
            (format!("{:?}", shower.deposits), shower.rays)
        };
        assert_eq!(on(1), on(3));
    }

    #[test]
    fn the_sequence_is_even_along_every_axis() {
        let count = 4096;
        for axis in 0..DIMENSIONS {
            let mut bins = [0i32; 64];
            for index in 0..count {
                bins[(spread(index, &[0.3; DIMENSIONS])[axis] * 64.0) as usize] += 1;
            }
            assert!(bins.iter().all(|bin| (bin - 64).abs() < 24), "axis {axis}: {bins:?}");
        }
    }
}
