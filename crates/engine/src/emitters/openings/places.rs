//! Which openings the places of a scene see: trees over the sites that looked around, one for each
//! of six groups of normals, since a wall is dark on one side and not on the other.

use super::fitting::Fitted;
use super::lookout::{Lookout, MOST_SEEN};
use super::rectangle::Rectangle;
use super::search::{Site, View, leaves};
use crate::random::{Numbers, Stream};
use crate::sampling::cosine_direction;
use crate::surface::World;
use glam::Vec3;
use rayon::prelude::*;
use std::cmp::{Ordering, Reverse};
use std::f32::consts::PI;

/// Sites of a dark leaf, at most.
const LEAF_SITES: usize = 8;
/// With fewer views, openings that are seen from around count as seen.
const ENOUGH_VIEWS: usize = 4;
/// Directions by which a leaf's sites try whether openings help.
const TRIALS: u32 = 32;
/// Openings help where the variance of the sky's light falls at least by this factor.
const LEAST_GAIN: f32 = 1.5;
/// Share of the sky that a place sees which its openings must hold, where it sees more than a little: a
/// direction beside them stands for several others.
const COVERED: f32 = 0.98;
/// Share of directions that go through openings; the others are drawn by the sky's light.
pub const THROUGH_OPENINGS: f32 = 0.8;

/// A box of space, cut in two or a leaf.
enum Node {
    /// Places below `at` along `axis` are in node `below`, others in the one behind it.
    Cut { axis: usize, at: f32, below: u32 },
    /// Not dark there.
    Open,
    /// Openings that are seen from there, and whether directions through them help.
    Dark { seen: [u8; MOST_SEEN], count: u8, helps: bool },
}

/// What a dark place sees.
pub struct Seen<'a> {
    /// Indices of openings.
    pub openings: &'a [u8],
    /// Whether directions through them find the sky better than its own light does.
    pub helps: bool,
}

/// Which openings are seen from where.
pub struct Places {
    nodes: Vec<Node>,
    /// By group of normals, the root of its tree; `None` where no site is.
    roots: [Option<u32>; 6],
}

/// A gap between two sites.
struct Gap {
    /// Along this axis.
    axis: usize,
    /// Its middle.
    at: f32,
    /// How wide it is.
    width: f32,
    /// How mixed the sites on either side of it are, or how unequal in number where all are alike.
    mixed: f32,
}

/// How mixed sites are of which so many are shaded: how many of them differ from one drawn by chance (Gini's
/// impurity), each counted.
fn mixed(shaded: usize, count: usize) -> f32 {
    2.0 * shaded as f32 * (count - shaded) as f32 / count as f32
}

/// What a tree is made of.
struct Maker<'a> {
    world: &'a World,
    sites: &'a [Site],
    openings: &'a [Rectangle],
    /// By site, the openings that its views went through.
    seen: Vec<Vec<u8>>,
    nodes: Vec<Node>,
}

impl Places {
    /// Finds out what each place sees; `None` where none is dark.
    pub fn new(world: &World, sites: &[Site], views: &[View], fitted: &Fitted) -> Option<Self> {
        let mut seen = vec![Vec::new(); sites.len()];
        for (view, opening) in views.iter().zip(&fitted.of_view) {
            seen[view.site].extend(*opening);
        }
        let openings = &fitted.openings[..];
        let mut maker = Maker { world, sites, openings, seen, nodes: Vec::new() };
        let roots = std::array::from_fn(|group| {
            let is_in = |site: &usize| group_of(sites[*site].normal) == group;
            let mut own: Vec<usize> = (0..sites.len()).filter(is_in).collect();
            let root = maker.nodes.len() as u32;
            maker.nodes.push(Node::Open);
            maker.grow(root as usize, &mut own, &[]);
            (!own.is_empty()).then_some(root)
        });
        let nodes = maker.nodes;
        let is_dark = |node: &Node| matches!(node, Node::Dark { .. });
        nodes.iter().any(is_dark).then_some(Self { nodes, roots })
    }

    /// What a dark surface sees; `None` of one that is not dark.
    pub fn seen_at(&self, point: Vec3, normal: Vec3) -> Option<Seen<'_>> {
        let mut node = self.roots[group_of(normal)]?;
        loop {
            match &self.nodes[node as usize] {
                Node::Cut { axis, at, below } => {
                    node = below + u32::from(point[*axis] >= *at);
                }
                Node::Open => return None,
                Node::Dark { seen, count, helps } => {
                    let openings = &seen[..usize::from(*count)];
                    return Some(Seen { openings, helps: *helps });
                }
            }
        }
    }
}

/// The group of a normal: which axis it is nearest to, and on which side.
fn group_of(normal: Vec3) -> usize {
    let axis = normal.abs().max_position();
    2 * axis + usize::from(normal[axis] < 0.0)
}

impl Maker<'_> {
    /// Makes a node of sites, cutting the box until none is shaded, or they are few and all are. `around`
    /// are the openings that the box is known to see which it is a part of.
    fn grow(&mut self, node: usize, sites: &mut [usize], around: &[u8]) {
        let seen = self.seen_from(sites, around);
        let shaded = sites.iter().filter(|site| self.sites[**site].is_shaded()).count();
        let is_pure = shaded == 0 || shaded == sites.len();
        let is_done = is_pure && (shaded == 0 || sites.len() <= LEAF_SITES);
        let cut = if is_done { None } else { self.cut(sites, is_pure) };
        let Some(Gap { axis, at, .. }) = cut else {
            self.nodes[node] = self.leaf(sites, &seen);
            return;
        };
        sites.sort_unstable_by(|a, b| self.order(axis, *a, *b));
        let middle = sites.partition_point(|site| self.sites[*site].start[axis] < at);
        let below = self.nodes.len() as u32;
        self.nodes[node] = Node::Cut { axis, at, below };
        self.nodes.extend([Node::Open, Node::Open]);
        let (lower, upper) = sites.split_at_mut(middle);
        self.grow(below as usize, lower, &seen);
        self.grow(below as usize + 1, upper, &seen);
    }

    /// Where sites are best cut: in half along the longest side of their box where they are all alike, else
    /// where shaded ones are best told from others, as a window's reveal from the wall beside it. In the
    /// middle of the gap between two sites, the widest one of equals, since nothing is known of what lies
    /// in it. `None` where all are at one place.
    fn cut(&self, sites: &[usize], are_alike: bool) -> Option<Gap> {
        let places = sites.iter().map(|site| self.sites[*site].start);
        let (low, high) = places
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), place| {
                (low.min(place), high.max(place))
            });
        let longest = (high - low).max_position();
        let axes = if are_alike { longest..longest + 1 } else { 0..3 };
        axes.flat_map(|axis| self.gaps(sites, axis, are_alike))
            .min_by(|a, b| a.mixed.total_cmp(&b.mixed).then(b.width.total_cmp(&a.width)))
    }

    /// The gaps between sites along an axis.
    fn gaps(&self, sites: &[usize], axis: usize, are_alike: bool) -> Vec<Gap> {
        let mut sites = sites.to_vec();
        sites.sort_unstable_by(|a, b| self.order(axis, *a, *b));
        let (count, mut below) = (sites.len(), 0);
        let shaded = sites.iter().filter(|site| self.sites[**site].is_shaded()).count();
        let mut gaps = Vec::new();
        for (number, pair) in sites.windows(2).enumerate() {
            let number = number + 1;
            below += usize::from(self.sites[pair[0]].is_shaded());
            let [low, high] = [0, 1].map(|k| self.sites[pair[k]].start[axis]);
            let at = low + 0.5 * (high - low);
            if at <= low {
                continue;
            }
            let mixed = match are_alike {
                true => number.abs_diff(count / 2) as f32,
                false => mixed(below, number) + mixed(shaded - below, count - number),
            };
            gaps.push(Gap { axis, at, width: high - low, mixed });
        }
        gaps
    }

    /// The order of two sites along an axis.
    fn order(&self, axis: usize, one: usize, other: usize) -> Ordering {
        let at = |site: usize| self.sites[site].start[axis];
        at(one).total_cmp(&at(other)).then(one.cmp(&other))
    }

    /// The openings that most views of sites went through and, where views are few, those that are
    /// seen from around.
    fn seen_from(&self, sites: &[usize], around: &[u8]) -> Vec<u8> {
        let mut counts: Vec<(u8, usize)> = Vec::new();
        for index in sites.iter().flat_map(|site| &self.seen[*site]) {
            match counts.iter_mut().find(|(other, _)| other == index) {
                Some((_, count)) => *count += 1,
                None => counts.push((*index, 1)),
            }
        }
        counts.sort_by_key(|(index, count)| (Reverse(*count), *index));
        let views: usize = counts.iter().map(|(_, count)| count).sum();
        let mut seen: Vec<u8> = counts.into_iter().map(|(index, _)| index).collect();
        if views < ENOUGH_VIEWS {
            let others = around.iter().filter(|index| !seen.contains(index));
            seen.extend(others.copied().collect::<Vec<_>>());
        }
        seen.truncate(MOST_SEEN);
        seen
    }

    /// A leaf that sees these openings.
    fn leaf(&self, sites: &[usize], openings: &[u8]) -> Node {
        let shaded = sites.iter().filter(|site| self.sites[**site].is_shaded()).count();
        if sites.is_empty() || 2 * shaded < sites.len() {
            return Node::Open;
        }
        let mut seen = [0; MOST_SEEN];
        seen[..openings.len()].copy_from_slice(openings);
        let dark = sites.iter().filter(|site| self.sites[**site].is_dark()).count();
        let is_dark = 2 * dark >= sites.len();
        let helps = !openings.is_empty()
            && self.gain(sites, openings) >= LEAST_GAIN
            && (is_dark || self.covered(sites, openings) >= COVERED);
        match helps || is_dark {
            true => Node::Dark { seen, count: openings.len() as u8, helps },
            false => Node::Open,
        }
    }

    /// Share of the directions in which sites see the sky that go through those openings.
    fn covered(&self, sites: &[usize], seen: &[u8]) -> f32 {
        let (mut all, mut through) = (0, 0);
        for site in sites.iter().map(|site| &self.sites[*site]) {
            let openings = seen.iter().map(|index| self.openings[usize::from(*index)]);
            let lookout = Lookout::new(openings, site.start, site.normal);
            let holds = |direction: &&Vec3| lookout.is_some_and(|own| own.pdf(**direction) > 0.0);
            all += site.escaped.len();
            through += site.escaped.iter().filter(holds).count();
        }
        through as f32 / all.max(1) as f32
    }

    /// By which factor the variance of a uniform sky's light falls at sites, about, where most
    /// directions go through those openings.
    fn gain(&self, sites: &[usize], seen: &[u8]) -> f32 {
        let variances = |site: &usize| {
            let trial = Trial { world: self.world, site: &self.sites[*site] };
            let openings = seen.iter().map(|index| self.openings[usize::from(*index)]);
            let Site { start, normal, .. } = *trial.site;
            // By cosine a direction stands for π or nothing.
            let share = trial.site.share();
            let plain = PI * PI * share * (1.0 - share);
            let through = Lookout::new(openings, start, normal);
            [plain, through.map_or(plain, |lookout| trial.variance(&lookout, *site))]
        };
        let variances: Vec<[f32; 2]> = sites.par_iter().map(variances).collect();
        let [plain, through] = [0, 1].map(|k| variances.iter().map(|pair| pair[k]).sum::<f32>());
        match (plain > 0.0, through > 0.0) {
            (_, false) => 0.0,
            (false, true) => f32::INFINITY,
            (true, true) => plain / through,
        }
    }
}

/// A site that tries a way of drawing directions.
struct Trial<'a> {
    world: &'a World,
    site: &'a Site,
}

impl Trial<'_> {
    /// Variance of what a direction stands for of the irradiance by a uniform sky of radiance 1,
    /// where most go through openings.
    fn variance(&self, lookout: &Lookout, number: usize) -> f32 {
        let Site { start, normal, .. } = self.site;
        let mut numbers = Numbers::new(0, Stream::Opening, u64::MAX - number as u64);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..TRIALS {
            let mut next = || numbers.uniform();
            let (pick, xi) = (next(), Vec3::new(next(), next(), next()));
            let direction = match pick < THROUGH_OPENINGS {
                true => lookout.sample(xi),
                false => cosine_direction(*normal, [xi.y, xi.z]),
            };
            let cosine = normal.dot(direction);
            if cosine > 0.0 && leaves(self.world, *start, direction) {
                let density = THROUGH_OPENINGS * lookout.pdf(direction)
                    + (1.0 - THROUGH_OPENINGS) * cosine / PI;
                let light = cosine / density;
                sum += light;
                squares += light * light;
            }
        }
        let mean = sum / TRIALS as f32;
        (squares / TRIALS as f32 - mean * mean).max(0.0)
    }
}
