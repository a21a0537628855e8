//! Rectangles around the openings that views of the sky go through: where all of them pass through
//! the least room, as light does in a window, and from there as far as rays get through.

use super::rectangle::{Plane, Rectangle};
use super::search::{Ball, Site, View, leaves, nearest};
use crate::random::{Numbers, Stream};
use crate::surface::World;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::ops::Range;

/// Planes that are tried along each normal.
const OFFSETS: u32 = 48;
/// An opening that lies in no wall must look smaller by this factor.
const ASKEW: f32 = 1.5;
/// Of two planes in which an opening is as wide but for this factor, it is in the outer one.
const DEEP: f32 = 1.1;
/// Normals of surfaces that are tried beside the axes, at most: windows lie in walls.
const MOST_NORMALS: usize = 6;
/// Cosine between normals that count as one.
const SAME_NORMAL: f32 = 0.999;
/// Share of the views, at either end, that may pass outside.
const OUTSIDE: f32 = 0.02;
/// Half a side of a rectangle is at least this share of the ball that its views were found in.
const LEAST_HALF_SIDE: f32 = 0.15;
/// Rays that find how far an opening goes, each time.
const PROBES: u32 = 1024;
/// How many times its sides they look in each of these times.
const LOOK_AROUND: [f32; 4] = [2.0, 2.0, 1.5, 1.2];
/// Strips of that along each side.
const STRIPS: usize = 24;
/// A strip belongs to the opening where this share of the rays gets through that does within it.
const PASSING: f32 = 0.05;
/// Width of the strip along each side, in sides, whose outermost open place is looked for in the end.
const NEAR_SIDE: f32 = 0.06;
/// What is added beyond that place, in widths of that strip: a direction through what is left out stands for a
/// hundred others.
const MARGIN: f32 = 0.3;

/// The openings, and by view the one that it goes through.
pub struct Fitted {
    /// Openings.
    pub openings: Vec<Rectangle>,
    /// By view.
    pub of_view: Vec<Option<u8>>,
}

/// An opening with the views that go through it.
struct Group {
    opening: Rectangle,
    views: Vec<usize>,
}

/// What openings are fitted to.
struct Fitting<'a> {
    world: &'a World,
    sites: &'a [Site],
    views: &'a [View],
    /// Normals of planes that are tried.
    normals: Vec<Vec3>,
}

impl Fitted {
    /// Fits a rectangle to the views about each ball, and makes one of those that are parts of one.
    pub fn new(world: &World, sites: &[Site], views: &[View], balls: &[Ball]) -> Self {
        let fitting = Fitting { world, sites, views, normals: normals(sites) };
        let mut of_ball = vec![Vec::new(); balls.len()];
        for (index, view) in views.iter().enumerate() {
            let ball = nearest(balls, view.place);
            if let Some(ball) = ball.filter(|ball| balls[*ball].holds(view.place)) {
                of_ball[ball].push(index);
            }
        }
        let fit = |(views, ball): (Vec<usize>, &Ball)| {
            if views.is_empty() {
                return None;
            }
            let opening = fitting.narrowest(&views, ball)?;
            Some(Group { opening, views })
        };
        let groups = of_ball.into_par_iter().zip(balls).filter_map(fit).collect();
        let mut groups = joined(groups);
        groups.par_iter_mut().enumerate().for_each(|(index, group)| fitting.probe(group, index));
        let groups = joined(groups);
        let mut of_view = vec![None; views.len()];
        for (index, group) in groups.iter().enumerate() {
            for view in &group.views {
                of_view[*view] = Some(index as u8);
            }
        }
        Self { openings: groups.iter().map(|group| group.opening).collect(), of_view }
    }
}

/// The axes and the normals that most sites have, opposite ones as one.
fn normals(sites: &[Site]) -> Vec<Vec3> {
    let mut counted: Vec<(Vec3, usize)> =
        [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (axis, usize::MAX)).to_vec();
    for site in sites {
        let same = |(normal, _): &&mut (Vec3, usize)| normal.dot(site.normal).abs() > SAME_NORMAL;
        match counted.iter_mut().find(same) {
            Some((_, count)) => *count = count.saturating_add(1),
            None => counted.push((site.normal, 1)),
        }
    }
    counted.sort_by_key(|(_, count)| Reverse(*count));
    counted.truncate(3 + MOST_NORMALS);
    counted.into_iter().map(|(normal, _)| normal).collect()
}

/// The same groups, of which those are one that are parts of one opening.
fn joined(mut groups: Vec<Group>) -> Vec<Group> {
    let mut index = 0;
    while index < groups.len() {
        let partner = (index + 1..groups.len())
            .find_map(|other| Some((other, groups[index].opening.joined(&groups[other].opening)?)));
        match partner {
            Some((other, opening)) => {
                let other = groups.swap_remove(other);
                groups[index].opening = opening;
                groups[index].views.extend(other.views);
                // What is larger now may reach those before it.
                index = 0;
            }
            None => index += 1,
        }
    }
    groups
}

impl Fitting<'_> {
    /// Start and unit direction of a view.
    fn line(&self, view: usize) -> (Vec3, Vec3) {
        let View { site, place, .. } = &self.views[view];
        let start = self.sites[*site].start;
        (start, (*place - start).normalize())
    }

    /// The rectangle that looks smallest along the views of all that they pass through.
    fn narrowest(&self, views: &[usize], ball: &Ball) -> Option<Rectangle> {
        let lines: Vec<(Vec3, Vec3)> = views.iter().map(|view| self.line(*view)).collect();
        let along: Vec3 = lines.iter().map(|(_, direction)| *direction).sum();
        let along = along.try_normalize().unwrap_or(Vec3::Y);
        let least = 2.0 * LEAST_HALF_SIDE * ball.radius;
        let mut best: Option<(f32, Rectangle)> = None;
        let normals = self.normals.iter().map(|normal| (*normal, 1.0));
        for (normal, factor) in normals.chain([(along, ASKEW)]) {
            let normal = if normal.dot(along) < 0.0 { -normal } else { normal };
            let slant = lines.iter().map(|(_, direction)| normal.dot(*direction).abs());
            let slant = factor * slant.sum::<f32>();
            let middle = normal.dot(ball.center);
            let offset = |k: u32| middle + ball.radius * (4.0 * k as f32 / OFFSETS as f32 - 2.0);
            let tried: Vec<(f32, Rectangle)> = (0..=OFFSETS)
                .filter_map(|k| {
                    let plane = Plane::new(normal, offset(k));
                    let (low, high) = bounds(&plane, &lines)?;
                    let size = (high - low).max(Vec2::splat(least));
                    let center = 0.5 * (low + high);
                    let opening = plane.rectangle(center - 0.5 * size, center + 0.5 * size);
                    Some((size.x * size.y * slant, opening))
                })
                .collect();
            let least = tried.iter().map(|(looks, _)| *looks).fold(f32::INFINITY, f32::min);
            // A hole in a thick wall is as wide inside as outside; what is in it looks out, too.
            let outermost = tried.into_iter().rev().find(|(looks, _)| *looks <= DEEP * least);
            let Some((_, opening)) = outermost else { continue };
            if best.is_none_or(|(best, _)| least < best) {
                best = Some((least, opening));
            }
        }
        best.map(|(_, opening)| opening)
    }

    /// Moves an opening's sides to where rays from the places that see it stop getting through.
    fn probe(&self, group: &mut Group, index: usize) {
        let mut numbers = Numbers::new(1, Stream::Opening, index as u64);
        for factor in LOOK_AROUND {
            let plane = group.opening.plane();
            let (low, high) = group.opening.bounds(&plane);
            let (middle, half) = (0.5 * (low + high), 0.5 * factor * (high - low));
            let mut tried = Tried::default();
            for _ in 0..PROBES {
                let at = Vec2::new(numbers.uniform(), numbers.uniform());
                let to = plane.at(middle + half * (2.0 * at - 1.0));
                if let Some(passes) = self.passes(group, numbers.uniform(), to) {
                    tried.add(at, passes);
                }
            }
            let strip = |bound: [f32; 2]| middle + half * (2.0 * Vec2::from(bound) - 1.0);
            if let Some((low, high)) = tried.opening(1.0 / factor) {
                group.opening = plane.rectangle(strip(low), strip(high));
            }
        }
        self.trim(group, &mut numbers);
    }

    /// Moves each side to a little beyond the outermost of many rays that get through near it.
    fn trim(&self, group: &mut Group, numbers: &mut Numbers) {
        let plane = group.opening.plane();
        let (mut low, mut high) = group.opening.bounds(&plane);
        let width = (high - low) * NEAR_SIDE;
        for axis in 0..2 {
            for side in [-1.0, 1.0] {
                let at = if side > 0.0 { high[axis] } else { low[axis] };
                let mut through: Option<f32> = None;
                for _ in 0..PROBES {
                    let mut place =
                        low + (high - low) * Vec2::new(numbers.uniform(), numbers.uniform());
                    let beyond = width[axis] * (2.0 * numbers.uniform() - 1.0);
                    place[axis] = at + side * beyond;
                    if self.passes(group, numbers.uniform(), plane.at(place)) == Some(true) {
                        through = Some(through.map_or(beyond, |most| most.max(beyond)));
                    }
                }
                // All that is nearer to the middle is known to be open.
                let moved = side * (through.unwrap_or(-width[axis]) + MARGIN * width[axis]);
                match side > 0.0 {
                    true => high[axis] = at + moved,
                    false => low[axis] = at + moved,
                }
            }
        }
        group.opening = plane.rectangle(low, high);
    }

    /// Whether a ray from one of the places that see an opening, picked by a number, gets through it
    /// at a place; `None` where it does not start upwards.
    fn passes(&self, group: &Group, pick: f32, to: Vec3) -> Option<bool> {
        let pick = (pick * group.views.len() as f32) as usize;
        let view = group.views[pick.min(group.views.len() - 1)];
        let site = &self.sites[self.views[view].site];
        let direction = (to - site.start).try_normalize()?;
        let starts = site.normal.dot(direction) > 0.0;
        starts.then(|| leaves(self.world, site.start, direction))
    }
}

/// Two corners, along a plane's axes, of the rectangle that lines pass through, but for a few of them.
fn bounds(plane: &Plane, lines: &[(Vec3, Vec3)]) -> Option<(Vec2, Vec2)> {
    let crossings = lines.iter().map(|(start, direction)| plane.crossed_by(*start, *direction));
    let crossings: Vec<Vec2> = crossings.collect::<Option<_>>()?;
    let outside = (OUTSIDE * crossings.len() as f32) as usize;
    let (mut low, mut high) = (Vec2::ZERO, Vec2::ZERO);
    for axis in 0..2 {
        let mut sorted: Vec<f32> = crossings.iter().map(|crossing| crossing[axis]).collect();
        sorted.sort_by(f32::total_cmp);
        low[axis] = sorted[outside];
        high[axis] = sorted[sorted.len() - 1 - outside];
    }
    Some((low, high))
}

/// Rays that were tried through a square of strips along both axes: how many, and how many of them
/// got through.
struct Tried {
    cells: Vec<[u16; 2]>,
}

impl Default for Tried {
    fn default() -> Self {
        Self { cells: vec![[0; 2]; STRIPS * STRIPS] }
    }
}

impl Tried {
    fn add(&mut self, at: Vec2, passes: bool) {
        let [x, y] = at.to_array().map(|x| ((x * STRIPS as f32) as usize).min(STRIPS - 1));
        let [rays, passed] = &mut self.cells[y * STRIPS + x];
        *rays += 1;
        *passed += u16::from(passes);
    }

    /// Share of the rays through those columns and rows that got through.
    fn share(&self, [columns, rows]: [Range<usize>; 2]) -> f32 {
        let cells = rows.flat_map(|y| columns.clone().map(move |x| self.cells[y * STRIPS + x]));
        let [rays, passed] = cells.fold([0u32; 2], |[rays, passed], [more, too]| {
            [rays + u32::from(more), passed + u32::from(too)]
        });
        passed as f32 / rays.max(1) as f32
    }

    /// Where they get through, from the lower to the upper corner, in the square's sides: the strips
    /// from the middle part, of that size, outwards. `None` if none does.
    fn opening(&self, size: f32) -> Option<([f32; 2], [f32; 2])> {
        let first = (STRIPS as f32 * 0.5 * (1.0 - size)).round() as usize;
        let mut ranges = [first..STRIPS - first, first..STRIPS - first];
        // Rows first, then columns, then both again within what has been found.
        for axis in [1, 0, 1, 0] {
            let enough = PASSING * self.share(ranges.clone());
            if enough <= 0.0 {
                return None;
            }
            let strip = |at: usize| {
                let mut ranges = ranges.clone();
                ranges[axis] = at..at + 1;
                self.share(ranges) >= enough
            };
            let Range { mut start, mut end } = ranges[axis].clone();
            while start + 1 < end && !strip(start) {
                start += 1;
            }
            while end - 1 > start && !strip(end - 1) {
                end -= 1;
            }
            while start > 0 && strip(start - 1) {
                start -= 1;
            }
            while end < STRIPS && strip(end) {
                end += 1;
            }
            ranges[axis] = start..end;
        }
        let low = ranges.clone().map(|range| range.start as f32 / STRIPS as f32);
        let high = ranges.map(|range| range.end as f32 / STRIPS as f32);
        Some((low, high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lets_rays_through_is_found_from_within() {
        let mut numbers = Numbers::new(3, Stream::Opening, 0);
        let mut tried = Tried::default();
        let (low, high) = (Vec2::new(0.3, 0.1), Vec2::new(0.65, 0.8));
        for _ in 0..20_000 {
            let at = Vec2::new(numbers.uniform(), numbers.uniform());
            let inside = at.cmpge(low).all() && at.cmple(high).all();
            // Another opening beside it, behind a wall.
            let other = at.x > 0.85;
            tried.add(at, (inside || other) && numbers.uniform() < 0.5);
        }
        let (from, to) = tried.opening(0.3).expect("it is open");
        let off = (Vec2::from(from) - low).abs().max((Vec2::from(to) - high).abs());
        assert!(off.max_element() <= 1.0 / STRIPS as f32, "{from:?} {to:?}");
        assert!(Tried::default().opening(0.5).is_none());
    }
}
