//! Looks for openings by rays: from sites all over the scene's surfaces, and along those rays of
//! shaded sites that leave the scene, to where they come into the open.

use crate::radiometry::importance;
use crate::random::{Numbers, Stream};
use crate::rays::{Spot, inset, unit_normal};
use crate::sampling::{Discrete, Seed, Shifted, cosine_direction};
use crate::scene::Scene;
use crate::surface::World;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{GOLDEN_RATIO, TAU};

/// Sites that look around.
const SITES: u64 = 2048;
/// Rays of each, and of those that may be shaded.
const RAYS: [u32; 2] = [16, 96];
/// A site may be shaded where so many of its first rays left the scene at most.
const FEW: u32 = 5;
/// A site is shaded where this share of its rays left the scene at most, and dark where this.
const SHADED: f32 = 0.3;
const DARK: f32 = 0.06;
/// With a smaller share of dark sites than this there is nothing to gain.
const LEAST_DARK: f32 = 0.05;
/// Rays that left the scene from shaded sites that are followed at most.
const MOST_VIEWS: usize = 512;
/// A place is in the open where this share of all directions leave the scene.
const OPEN: f32 = 0.2;
/// Directions by which that is found out.
const ALL_ROUND: u32 = 32;
/// How often the way of a ray is halved to find where it comes into the open.
const HALVINGS: u32 = 10;
/// Largest radius of an opening, in distances from which it was seen.
const WIDEST: f32 = 0.3;
/// How much larger an opening's ball is made than what of it was found: rays seldom find the
/// corners.
const MARGIN: f32 = 1.25;
/// How often what was found is shared out among the openings anew.
const ROUNDS: usize = 3;
/// Most openings.
const MOST_OPENINGS: usize = 64;
/// Openings are the same for every job of a scene.
const SEED: Seed = Seed { number: 0, well_spread: true };

/// A place on a surface, and which of its rays left the scene.
pub struct Site {
    /// Where rays start.
    pub start: Vec3,
    /// Unit normal of its side.
    pub normal: Vec3,
    /// Rays so far, by cosine.
    rays: u32,
    /// Directions of those that left the scene.
    pub escaped: Vec<Vec3>,
}

/// A ball around places where rays from shaded places come into the open, ray units.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    /// Its centre.
    pub center: Vec3,
    /// Its radius.
    pub radius: f32,
}

impl Ball {
    /// Whether a place is in it.
    pub fn holds(&self, place: Vec3) -> bool {
        self.center.distance_squared(place) <= self.radius * self.radius
    }
}

/// A ray from a shaded site that left the scene.
pub struct View {
    /// Index of the site.
    pub site: usize,
    /// Where it came into the open.
    pub place: Vec3,
    /// How far from the site.
    distance: f32,
}

impl Site {
    /// Share of its rays that left the scene.
    pub fn share(&self) -> f32 {
        self.escaped.len() as f32 / self.rays as f32
    }

    /// Whether it sees but a part of the sky.
    pub fn is_shaded(&self) -> bool {
        self.rays == RAYS[1] && self.share() <= SHADED
    }

    /// Whether it sees hardly anything of the sky.
    pub fn is_dark(&self) -> bool {
        self.rays == RAYS[1] && self.share() <= DARK
    }
}

/// Whether light from infinitely far away arrives at a place from a unit direction.
pub fn leaves(world: &World, start: Vec3, direction: Vec3) -> bool {
    importance(world.visibility(start, start + direction * world.rays.beyond())) > 0.0
}

/// Looks around from sites on all surfaces; `None` where hardly any is dark.
pub fn look_around(world: &World) -> Option<Vec<Site>> {
    let listed = world.scene.triangles.len() as u32;
    let mut areas: Vec<f32> = (0..listed)
        .into_par_iter()
        .map(|triangle| world.rays.corners(&world.scene, triangle).1)
        .collect();
    let square = world.square_metre().recip();
    areas.extend(world.scene.instance_areas(|_| 1.0).map(|(_, area)| area as f32 * square));
    if areas.iter().sum::<f32>().partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let by_area = Discrete::new(areas.iter().map(|area| f64::from(*area)));
    let of_shapes = by_area_of_shapes(&world.scene);
    let look = |index| {
        let mut site = site(world, &areas, (&by_area, &of_shapes), index)?;
        let mut sequence = Shifted::new(SEED, Stream::Opening, index);
        site.look(world, &mut sequence, RAYS[0]);
        if site.escaped.len() as u32 <= FEW {
            site.look(world, &mut sequence, RAYS[1]);
        }
        Some(site)
    };
    let sites: Vec<Site> = (0..SITES).into_par_iter().filter_map(look).collect();
    let dark = sites.iter().filter(|site| site.is_dark()).count();
    (dark as f32 > LEAST_DARK * sites.len() as f32).then_some(sites)
}

/// The triangles of each shape, to be picked by their areas.
fn by_area_of_shapes(scene: &Scene) -> Vec<Discrete> {
    let shapes = scene.instances.shapes().iter();
    shapes.map(|shape| Discrete::new(shape.triangle_areas())).collect()
}

/// A site: half of them lie on triangles picked by area, half on those picked by number (an instance counts as one), so that
/// neither a house on a wide plain nor the plain is left out. `None` on a triangle without area.
fn site(
    world: &World,
    areas: &[f32],
    (by_area, of_shapes): (&Discrete, &[Discrete]),
    index: u64,
) -> Option<Site> {
    let mut numbers = Numbers::new(SEED.number, Stream::Opening, SITES + index);
    let pick = numbers.fine();
    let triangle = match index % 2 {
        0 => by_area.pick(pick),
        _ => ((pick * areas.len() as f64) as usize).min(areas.len() - 1),
    };
    if areas[triangle] <= 0.0 {
        return None;
    }
    let mut triangle = triangle as u32;
    if let Some(instance) = triangle.checked_sub(world.scene.triangles.len() as u32) {
        let instances = &world.scene.instances;
        let shape = instances.all()[instance as usize].shape;
        let local = of_shapes[shape as usize].pick(numbers.fine()) as u32;
        triangle += instances.triangles_of(instance).start - instance + local;
    }
    let corners = world.rays.corners(&world.scene, triangle).0;
    let root = numbers.uniform().sqrt();
    let at = Vec2::new(root * (1.0 - numbers.uniform()), 0.0);
    let at = Vec2::new(at.x, root - at.x).lerp(Vec2::splat(1.0 / 3.0), inset(corners));
    let spot = Spot::new(corners, unit_normal(corners), at.x, at.y);
    let back = world.is_two_sided(triangle) && numbers.uniform() < 0.5;
    let normal = if back { -spot.normal } else { spot.normal };
    Some(Site { start: spot.off_surface(normal), normal, rays: 0, escaped: Vec::new() })
}

impl Site {
    /// Casts rays until there are `rays` of them.
    fn look(&mut self, world: &World, sequence: &mut Shifted, rays: u32) {
        for _ in self.rays..rays {
            let direction = cosine_direction(self.normal, sequence.next_pair());
            if leaves(world, self.start, direction) {
                self.escaped.push(direction);
            }
        }
        self.rays = rays;
    }
}

/// Follows rays that left the scene from shaded sites to where they come into the open.
pub fn views_of_shaded(world: &World, sites: &[Site]) -> Vec<View> {
    let of_site = |(index, site): (usize, &Site)| {
        let seen = if site.is_shaded() { &site.escaped[..] } else { &[] };
        seen.iter().map(move |direction| (index, *direction)).collect::<Vec<_>>()
    };
    let rays: Vec<(usize, Vec3)> = sites.iter().enumerate().flat_map(of_site).collect();
    let step = rays.len().div_ceil(MOST_VIEWS).max(1);
    let follow = |(index, direction): &(usize, Vec3)| {
        let start = sites[*index].start;
        let distance = into_the_open(world, start, *direction);
        View { site: *index, place: start + *direction * distance, distance }
    };
    rays.par_iter().step_by(step).map(follow).collect()
}

/// How far along a ray that leaves the scene a place in the open is, ray units.
fn into_the_open(world: &World, start: Vec3, direction: Vec3) -> f32 {
    let (mut dark, mut open) = (0.0, 0.5 * world.rays.beyond());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (dark + open);
        match openness(world, start + direction * middle) > OPEN {
            true => open = middle,
            false => dark = middle,
        }
    }
    open
}

/// Share of all directions from a place that leave the scene: a spiral's points are well spread
/// over the sphere.
fn openness(world: &World, place: Vec3) -> f32 {
    let golden = TAU * GOLDEN_RATIO;
    let free = (0..ALL_ROUND).filter(|k| {
        let height = 1.0 - 2.0 * (*k as f32 + 0.5) / ALL_ROUND as f32;
        let across = (1.0 - height * height).sqrt();
        let (sin, cos) = (golden * *k as f32).sin_cos();
        leaves(world, place, Vec3::new(across * cos, height, across * sin))
    });
    free.count() as f32 / ALL_ROUND as f32
}

/// Balls around where views come into the open: wide ones where they are seen from afar, as many as
/// are needed, but for those that hardly any view has.
pub fn balls(views: &[View]) -> Vec<Ball> {
    let mut order: Vec<&View> = views.iter().collect();
    order.sort_by(|a, b| b.distance.total_cmp(&a.distance));
    // The widest that each may be, by the farthest view of it.
    let mut found: Vec<(Ball, f32)> = Vec::new();
    for view in order {
        let is_in = |(ball, widest): &(Ball, f32)| {
            ball.center.distance_squared(view.place) <= widest * widest
        };
        if !found.iter().any(is_in) && found.len() < MOST_OPENINGS {
            found.push((Ball { center: view.place, radius: 0.0 }, WIDEST * view.distance));
        }
    }
    let mut balls: Vec<Ball> = found.into_iter().map(|(ball, _)| ball).collect();
    for _ in 0..ROUNDS {
        balls = shared_out(&balls, views);
    }
    balls
}

/// The same balls moved to the middle of the views that are nearest to each.
fn shared_out(balls: &[Ball], views: &[View]) -> Vec<Ball> {
    let mut boxes = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY, 0u32); balls.len()];
    let nearest: Vec<usize> = views.iter().filter_map(|view| nearest(balls, view.place)).collect();
    for (view, nearest) in views.iter().zip(&nearest) {
        let (low, high, count) = &mut boxes[*nearest];
        (*low, *high, *count) = (low.min(view.place), high.max(view.place), *count + 1);
    }
    let mut moved: Vec<Ball> = boxes
        .iter()
        .map(|(low, high, _)| Ball { center: (*low + *high) * 0.5, radius: 0.0 })
        .collect();
    for (view, nearest) in views.iter().zip(&nearest) {
        let ball = &mut moved[*nearest];
        ball.radius = ball.radius.max(MARGIN * ball.center.distance(view.place));
    }
    // One view alone has no extent.
    let several = boxes.iter().map(|(_, _, count)| *count > 1);
    moved.into_iter().zip(several).filter(|(_, several)| *several).map(|(moved, _)| moved).collect()
}

/// Index of the ball whose centre is nearest to a place.
pub fn nearest(balls: &[Ball], place: Vec3) -> Option<usize> {
    let far = |ball: &Ball| ball.center.distance_squared(place);
    (0..balls.len()).min_by(|a, b| far(&balls[*a]).total_cmp(&far(&balls[*b])))
}
