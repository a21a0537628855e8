//! Emissive textures as cells: parts of triangles, each with its mean emission. A triangle is
//! divided where its emission varies, as far as that matters to the whole scene, and is left whole
//! where it is alike; black parts have no cell.

use crate::radiometry::{Rgb, importance};
use crate::scene::emission_means::{EmissionMeans, part_of};
use crate::surface::World;
use glam::Vec2;
use std::collections::{BinaryHeap, HashMap};

/// How finely emissive textures are divided.
#[derive(Clone, Copy)]
pub struct CellLimits {
    /// About the most cells of all triangles together, unless one a triangle is more.
    pub most: usize,
    /// A cell is divided if what its parts differ from its mean is more than this share of all
    /// emission.
    pub least_difference: f64,
    /// Weight of differences between parts of parts, relative to those between the parts: below 1
    /// where what is fine matters less, because it blurs with distance.
    pub fine: f64,
    /// The dimmest cells that together emit this share of all are left out.
    pub dim: f64,
}

/// A part of a triangle that emits.
#[derive(Clone, Copy, Debug)]
pub struct EmissionCell {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// Barycentric coordinates of its corners, in the triangle's orientation.
    pub corners: [Vec2; 3],
    /// Its share of the triangle's area.
    pub share: f32,
    /// Mean emitted radiance.
    pub radiance: Rgb,
    /// Whether it is a whole triangle of one radiance.
    pub is_even: bool,
}

/// A part of a triangle on the way to its cell.
#[derive(Clone, Copy)]
enum Node {
    /// Nothing shines there.
    Black,
    /// Index into [`EmissionCells::cells`].
    Cell(u32),
    /// Index of the first of four parts.
    Divided(u32),
}

/// The cells of all emissive triangles with a texture.
pub struct EmissionCells {
    nodes: Vec<Node>,
    /// The node of each triangle.
    root: HashMap<u32, u32>,
    /// The cells, none of them black.
    pub cells: Vec<EmissionCell>,
}

/// A part that may be divided: which node it is, of which triangle's means, at which level.
#[derive(Clone, Copy)]
struct Open {
    /// What its parts differ from its mean, by area.
    difference: f64,
    node: u32,
    /// Index of the triangle's means.
    tree: u32,
    level: u32,
    index: u32,
}

impl Open {
    fn key(&self) -> (u32, u32, u32) {
        (self.tree, self.level, self.index)
    }
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    /// By what they differ; where that is the same, in one order always.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let by_difference = self.difference.total_cmp(&other.difference);
        by_difference.then_with(|| other.key().cmp(&self.key()))
    }
}

/// A triangle with a texture that emits: its index, and its area times its shining sides.
type Textured = (u32, f64);

impl EmissionCells {
    /// Divides the emissive triangles of a scene that have a texture.
    pub fn new(world: &World, limits: CellLimits) -> Self {
        let emission = world.textured_emission();
        let trees = emission.means();
        let with_area = |triangle: &u32| {
            let sides = if world.scene.material_of(*triangle).double_sided { 2.0 } else { 1.0 };
            (*triangle, f64::from(world.rays.corners(&world.scene, *triangle).1) * sides)
        };
        let textured: Vec<Textured> = emission.triangles().iter().map(with_area).collect();
        let mut building = Building {
            trees,
            textured: &textured,
            fine: limits.fine,
            nodes: Vec::new(),
            info: Vec::new(),
            heap: BinaryHeap::new(),
        };
        let mut root = HashMap::new();
        for (tree, (triangle, _)) in textured.iter().enumerate() {
            root.insert(*triangle, building.nodes.len() as u32);
            building.add(tree as u32, 0, 0);
        }
        building.divide(limits);
        let Building { nodes, info, .. } = building;
        let mut this = Self { nodes, root, cells: Vec::new() };
        this.number(trees, &textured, &info);
        this.leave_out(limits.dim, &textured);
        this
    }

    /// The cell at barycentric (u, v) of a triangle; `None` where nothing shines, or without a
    /// texture.
    pub fn find(&self, triangle: u32, [mut u, mut v]: [f32; 2]) -> Option<usize> {
        let mut at = *self.root.get(&triangle)?;
        loop {
            let first = match self.nodes[at as usize] {
                Node::Black => return None,
                Node::Cell(cell) => return Some(cell as usize),
                Node::Divided(first) => first,
            };
            let (x, y) = (2.0 * u, 2.0 * v);
            let part;
            (part, u, v) = if x >= 1.0 {
                (1, x - 1.0, y)
            } else if y >= 1.0 {
                (2, x, y - 1.0)
            } else if x + y <= 1.0 {
                (0, x, y)
            } else {
                (3, 1.0 - x, 1.0 - y)
            };
            at = first + part;
        }
    }

    /// Gives each node that is not divided its cell.
    fn number(&mut self, trees: &[EmissionMeans], textured: &[Textured], info: &[Open]) {
        for (node, of) in self.nodes.iter_mut().zip(info) {
            let Node::Cell(number) = node else { continue };
            let means = &trees[of.tree as usize];
            let corners = corners_of(of.level, of.index);
            *number = self.cells.len() as u32;
            self.cells.push(EmissionCell {
                triangle: textured[of.tree as usize].0,
                corners,
                share: 0.25f32.powi(of.level as i32),
                radiance: means.at(of.level, of.index),
                is_even: of.level == 0 && means.is_even(),
            });
        }
    }

    /// Leaves out the dimmest cells that together emit that share of all.
    fn leave_out(&mut self, share: f64, textured: &[Textured]) {
        let area: HashMap<u32, f64> = textured.iter().copied().collect();
        let power = |cell: &EmissionCell| {
            f64::from(importance(cell.radiance) * cell.share) * area[&cell.triangle]
        };
        let powers: Vec<f64> = self.cells.iter().map(power).collect();
        let most = share * powers.iter().sum::<f64>();
        let mut order: Vec<usize> = (0..powers.len()).collect();
        order.sort_by(|a, b| powers[*a].total_cmp(&powers[*b]).then(a.cmp(b)));
        let (mut sum, mut kept) = (0.0, vec![true; powers.len()]);
        for cell in order {
            sum += powers[cell];
            if sum > most {
                break;
            }
            kept[cell] = false;
        }
        let mut next = 0;
        let numbers: Vec<Option<u32>> = kept
            .iter()
            .map(|kept| {
                kept.then(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect();
        for node in &mut self.nodes {
            if let Node::Cell(cell) = node {
                *node = numbers[*cell as usize].map_or(Node::Black, Node::Cell);
            }
        }
        let mut kept = kept.into_iter();
        self.cells.retain(|_| kept.next() == Some(true));
    }
}

/// The cells while they are divided.
struct Building<'a> {
    trees: &'a [EmissionMeans],
    textured: &'a [Textured],
    fine: f64,
    nodes: Vec<Node>,
    /// What each node is.
    info: Vec<Open>,
    heap: BinaryHeap<Open>,
}

impl Building<'_> {
    /// Adds a part as a node: black, or a cell that may yet be divided.
    fn add(&mut self, tree: u32, level: u32, index: u32) {
        let (means, node) = (&self.trees[tree as usize], self.nodes.len() as u32);
        let is_black = means.at(level, index) == Rgb::ZERO;
        let area = self.textured[tree as usize].1;
        let difference =
            if is_black { 0.0 } else { area * means.difference(level, index, self.fine) };
        let open = Open { difference, node, tree, level, index };
        self.nodes.push(if is_black { Node::Black } else { Node::Cell(0) });
        self.info.push(open);
        if difference > 0.0 {
            self.heap.push(open);
        }
    }

    /// Divides the parts that differ most, until that does not matter or the cells are too many.
    fn divide(&mut self, limits: CellLimits) {
        let power = |(means, (_, area)): (&EmissionMeans, &Textured)| {
            f64::from(importance(means.at(0, 0))) * area
        };
        let total: f64 = self.trees.iter().zip(self.textured).map(power).sum();
        let mut cells = self.nodes.iter().filter(|node| matches!(node, Node::Cell(_))).count();
        while let Some(open) = self.heap.pop() {
            if open.difference <= limits.least_difference * total || cells + 3 > limits.most {
                break;
            }
            let first = self.nodes.len();
            self.nodes[open.node as usize] = Node::Divided(first as u32);
            for part in 0..4 {
                self.add(open.tree, open.level + 1, 4 * open.index + part);
            }
            let parts = self.nodes[first..].iter();
            cells += parts.filter(|node| matches!(node, Node::Cell(_))).count();
            cells -= 1;
        }
    }
}

/// Barycentric corners of a part.
fn corners_of(level: u32, index: u32) -> [Vec2; 3] {
    let mut corners = [Vec2::ZERO, Vec2::X, Vec2::Y];
    for down in (0..level).rev() {
        corners = part_of(corners, index >> (2 * down) & 3);
    }
    corners
}

#[cfg(test)]
mod tests;
