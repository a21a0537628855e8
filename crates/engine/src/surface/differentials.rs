//! How rays of one pixel differ on their way: ray differentials (Igehy 1999, "Tracing ray differentials"). A sun that
//! is seen by way of mirrors and lenses is met by few rays, and is far too bright then. What a ray finds on the mean
//! over the part of the pixel that it stands for is known about as well, and scatters little.

use super::point::Surface;
use super::slopes::{SlopeChanges, slope_about};
use super::world::World;
use glam::{Vec2, Vec3};

/// The n-th ray of a pixel, counted from 1, stands for n^−¼ of its width: that goes down to nothing, but slowly enough
/// for what the rays find to scatter less and less.
const NARROWING: f32 = 0.25;
/// Most that a normal turns, as the length of its difference.
const MOST_TURN: f32 = 1.0;
/// Most that directions differ, as the length of the difference.
const MOST_APART: f32 = 4.0;
/// Largest difference of directions by which a change is looked at; larger ones are taken to be in proportion.
const STEP: f32 = 0.1;
/// Width of a lobe of microfacets, as the angle between the directions at its sides, over that of its distribution.
const OF_ALPHA: f32 = 2.0;
/// Part of the longer side of a parallelogram of slopes or directions by which it is blurred besides: thin ones are
/// seldom met.
const BLUR_OF_SIDES: f32 = 0.05;
/// Largest angle by which lobes on the way blur a ray.
const MOST_BLUR: f32 = 0.4;

/// How a ray differs from those at the sides of what it stands for.
#[derive(Clone, Copy, Debug)]
pub struct Differentials {
    /// Between the places where the ray and those to its right and below meet a surface, ray units.
    places: [Vec3; 2],
    /// Between their unit directions.
    directions: [Vec3; 2],
    /// Angle by which rough lobes on the way have blurred it besides.
    blur: f32,
    /// Share of the width of a pixel, or of a lobe, that it stands for.
    share: f32,
}

/// How a ray leaves a surface.
#[derive(Clone, Copy)]
pub struct Turn {
    /// Unit direction before.
    pub from: Vec3,
    /// Unit direction after.
    pub to: Vec3,
    /// Index of refraction beyond the surface over that before it, if it goes through.
    pub index: Option<f32>,
    /// Width of the lobe that the direction was picked from, as an angle.
    pub width: f32,
}

impl Turn {
    /// By a lobe of microfacets of that width, or through it.
    pub fn by_facets([from, to]: [Vec3; 2], index: Option<f32>, alpha: f32) -> Self {
        Self { from, to, index, width: OF_ALPHA * alpha }
    }

    /// In a direction that was picked with that density, 1/sr.
    pub fn by_density([from, to]: [Vec3; 2], pdf: f32) -> Self {
        Self { from, to, index: None, width: pdf.max(1.0).powf(-0.5) }
    }
}

impl Differentials {
    /// Of the n-th ray of a pixel, counted from 0, where these are the steps to the next pixels: between places, and
    /// between directions.
    pub fn of_pixel([places, directions]: [[Vec3; 2]; 2], n: u32) -> Self {
        let share = (n as f32 + 1.0).powf(-NARROWING);
        let [places, directions] = [places, directions].map(|steps| steps.map(|step| share * step));
        Self { places, directions, blur: 0.0, share }
    }

    /// The same after a way.
    pub fn after(self, way: f32) -> Self {
        let place = |k: usize| self.places[k] + way * self.directions[k];
        Self { places: [0, 1].map(place), ..self }
    }

    /// The same after it left a surface.
    pub fn leaving(self, world: &World, surface: &Surface, turn: Turn) -> Self {
        let places = self.on(surface, turn.from);
        let middle = (turn.to - turn.from).normalize_or(surface.shading_normal);
        let direction = |k: usize| {
            let (step, along) = (self.directions[k], turn.from);
            let normal = || world.normal_change(surface, places[k]);
            match turn.index {
                None => {
                    let normal = normal();
                    let cosine = step.dot(middle) + along.dot(normal);
                    step - 2.0 * (along.dot(middle) * normal + cosine * middle)
                }
                Some(1.0) => step,
                Some(index) => refracted_change([along, step], (surface, normal()), index),
            }
        };
        let blur = (self.blur + self.share * turn.width).min(MOST_BLUR);
        let directions = [0, 1].map(|k| direction(k).clamp_length_max(MOST_APART));
        Self { places, directions, blur, ..self }
    }

    /// Between the places on a surface that rays in about that direction meet.
    fn on(&self, surface: &Surface, direction: Vec3) -> [Vec3; 2] {
        let normal = surface.normal;
        let cosine = direction.dot(normal);
        let cosine = cosine.signum() * cosine.abs().max(0.05);
        self.places.map(|place| place - direction * (place.dot(normal) / cosine))
    }

    /// Differences of directions of what it sees, and an angle by which that is blurred.
    pub fn seen(&self) -> ([Vec3; 2], f32) {
        let longer = longer(self.directions);
        (self.directions, (self.blur.hypot(2.0 * BLUR_OF_SIDES * longer)).min(MOST_BLUR))
    }

    /// By how much what a surface mirrors is blurred over which slopes change like this, as a difference of slopes to
    /// each side.
    pub fn blur_of_slopes(&self, changes: &SlopeChanges) -> f32 {
        let longer = changes.map(longer).into_iter().fold(0.0, f32::max);
        (0.25 * self.blur).hypot(BLUR_OF_SIDES * longer).min(MOST_BLUR)
    }

    /// How slopes of half vectors of the unit vector `viewer` and a source change over what it sees of a surface.
    pub fn slope_changes(
        &self,
        world: &World,
        surface: &Surface,
        [viewer, source]: [Vec3; 2],
    ) -> SlopeChanges {
        let places = self.on(surface, -viewer);
        let normals = surface.reflection().normals();
        let turns = places.map(|step| match world.beside(surface, step) {
            Some((beside, part)) => {
                let there = beside.reflection().normals();
                [0, 1].map(|lobe| change(there[lobe] - normals[lobe], part))
            }
            None => [Vec3::ZERO; 2],
        });
        [0, 1].map(|lobe| {
            let normal = normals[lobe];
            let slope = slope_about(normal, viewer, source);
            [0, 1].map(|k| {
                let (turn, step) = (turns[k][lobe], -self.directions[k]);
                let part = (STEP / (turn.length() + step.length())).min(1.0);
                let normal = (normal + part * turn).normalize();
                let viewer = (viewer + part * step).normalize();
                (slope_about(normal, viewer, source) - slope) / part
            })
        })
    }
}

/// Change of a normal over all of a step, of which such a part was looked at.
fn change(turn: Vec3, part: f32) -> Vec3 {
    (turn / part).clamp_length_max(MOST_TURN)
}

fn longer(sides: [Vec3; 2]) -> f32 {
    sides[0].length().max(sides[1].length())
}

/// Change of the direction of a ray that is refracted, where its unit direction and the shading normal change like
/// this.
fn refracted_change(
    [direction, step]: [Vec3; 2],
    (surface, turn): (&Surface, Vec3),
    index: f32,
) -> Vec3 {
    let part = (STEP / (turn.length() + step.length())).min(1.0);
    let refracted = |direction: Vec3, normal: Vec3| {
        let (direction, normal) = (direction.normalize(), normal.normalize());
        let cosine = -direction.dot(normal);
        let beyond = (1.0 - (1.0 - cosine * cosine) / (index * index)).max(0.0).sqrt();
        direction / index + (cosine / index - beyond) * normal
    };
    let normal = surface.shading_normal;
    let turned = refracted(direction + part * step, normal + part * turn);
    (turned - refracted(direction, normal)) / part
}

impl World {
    /// Change of the shading normal of a surface with a step on it, ray units.
    fn normal_change(&self, surface: &Surface, step: Vec3) -> Vec3 {
        self.beside(surface, step).map_or(Vec3::ZERO, |(beside, part)| {
            change(beside.shading_normal - surface.shading_normal, part)
        })
    }

    /// A surface as it is turned a step beside, ray units, or less where its triangle has an end before that, and which
    /// part of the step that is; `None` where it is flat.
    fn beside(&self, surface: &Surface, step: Vec3) -> Option<(Surface, f32)> {
        if self.has_one_normal(surface.triangle) && !self.has_normal_maps() {
            return None;
        }
        let ([a, b, c], _) = self.rays.corners(&self.scene, surface.triangle);
        let (u, v) = (b - a, c - a);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let (along_u, along_v) = (u.dot(step), v.dot(step));
        let area = uu * vv - uv * uv;
        let step = Vec2::new(vv * along_u - uv * along_v, uu * along_v - uv * along_u) / area;
        // Beyond the triangle its normals tell nothing.
        let part = step.abs().max_element().recip().min(1.0);
        let at = Vec2::from_array(surface.at) + part * step;
        let is_known = area > 0.0 && part > 0.0 && at.is_finite();
        is_known.then(|| (self.turned(surface, at, surface.spot), part))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use crate::rays::Eye;
    use crate::scene::environment::Environment;
    use crate::scene::made::revolved::ball;
    use crate::scene::{Material, Volume};
    use crate::surface::{Passage, PassageEnd};
    use std::sync::Arc;

    /// How far rays start apart, which are parallel.
    const APART: f32 = 1e-3;

    /// How far off differentials are of rays that a ball of glass mirrors, or that go through it, over how far rays
    /// beside them go apart: the median over many.
    fn off(way: usize) -> f32 {
        let glass = Material { volume: Some(Volume::default()), ..Material::glass("glass", 1.5) };
        let scene = ball(256, glass);
        let world = World::surrounded(Arc::new(scene), Arc::new(Environment::none()));
        let scale = world.rays.scale() as f32;
        let direction = Vec3::NEG_Z;
        let cast = |x: f32, y: f32| -> Option<(Passage, Option<Differentials>)> {
            let origin = world.rays.place(Vec3::new(x, y, 3.0));
            let hit = world.rays.closest(Eye::Camera, origin, direction)?;
            let steps = [[Vec3::X, Vec3::Y].map(|axis| APART * scale * axis), [Vec3::ZERO; 2]];
            let own = Differentials::of_pixel(steps, 0);
            let found = world.pass_both((hit, Some(own)), direction, 1)[way];
            found.filter(|(passage, _)| matches!(passage.end, PassageEnd::Escaped))
        };
        let mut numbers = Numbers::new(3, Stream::Edge, 0);
        let mut all = Vec::new();
        for _ in 0..2000 {
            let [x, y] = [(); 2].map(|()| 1.2 * numbers.uniform() - 0.6);
            let three = cast(x, y).zip(cast(x + APART, y)).zip(cast(x, y + APART));
            let Some(((middle, right), below)) = three else { continue };
            let apart = [right, below].map(|other| other.0.direction - middle.0.direction);
            let (told, _) = middle.1.expect("it had them before").seen();
            for (apart, told) in apart.into_iter().zip(told) {
                // Others have gone another way.
                if apart.length() < 20.0 * APART {
                    all.push((apart - told).length() / apart.length());
                }
            }
        }
        assert!(all.len() > 1000, "{}", all.len());
        all.sort_by(f32::total_cmp);
        all[all.len() / 2]
    }

    #[test]
    fn differentials_are_what_rays_differ_by() {
        for (way, name) in ["mirrored", "let through"].iter().enumerate() {
            let off = off(way);
            println!("{name}: {off}");
            assert!(off < 0.05, "{name}: {off}");
        }
    }

    /// They become less from ray to ray, and rough surfaces blur them.
    #[test]
    fn later_rays_stand_for_less() {
        let steps = [[Vec3::X, Vec3::Y]; 2];
        let [first, later] = [0, 15].map(|n| Differentials::of_pixel(steps, n));
        assert_eq!(first.seen().0, steps[1]);
        assert!((later.seen().0[0].length() - 0.5).abs() < 1e-6);
        let scene = ball(16, Material::default());
        let world = World::surrounded(Arc::new(scene), Arc::new(Environment::none()));
        let surface = world.at(40, [0.3; 2], false);
        let between = [-surface.normal, surface.normal];
        let blur = |own: Differentials, alpha| {
            own.leaving(&world, &surface, Turn::by_facets(between, None, alpha)).blur
        };
        assert_eq!(blur(first, 0.0), 0.0);
        assert!((blur(first, 0.1) - 0.2).abs() < 1e-6 && (blur(later, 0.1) - 0.1).abs() < 1e-6);
    }
}
