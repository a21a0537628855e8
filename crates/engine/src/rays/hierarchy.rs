//! The tree of boxes around triangles: built here, widened and traversed by `obvhs`.
//!
//! Our own builder because files are hostile: `obvhs` clusters bottom-up, which takes quadratic
//! time and gives trees as deep as the scene is large where many boxes coincide (20,000 copies of
//! a triangle: 20 s, depth 2,856). Splitting top-down by the surface area heuristic in bins is
//! bounded in both.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::{CwBvh, Traversal};

/// Bins of the heuristic.
const BINS: usize = 32;
/// Below this depth of the binary tree, nodes are halved by count, so that no tree is deep.
const HALVE_BELOW: usize = 40;
/// Levels of the wide tree that a traversal's stack holds.
const MOST_LEVELS: usize = 31;
/// Triangles of a leaf, at most.
const LEAF_TRIANGLES: u32 = 3;
/// Nodes of at least so many triangles are built side by side.
const SIDE_BY_SIDE: usize = 4096;

/// A triangle's box.
#[derive(Clone, Copy)]
pub struct Boxed {
    /// Least coordinates.
    pub low: Vec3A,
    /// Largest coordinates.
    pub high: Vec3A,
    /// Which triangle.
    pub index: u32,
}

/// The tree.
#[derive(Default)]
pub struct Hierarchy {
    tree: CwBvh,
}

impl Hierarchy {
    /// The tree over boxes, which are reordered.
    pub fn new(boxes: &mut [Boxed]) -> Self {
        if boxes.is_empty() {
            return Self::default();
        }
        let mut tree = widened(boxes, HALVE_BELOW);
        if levels(&tree) > MOST_LEVELS {
            tree = widened(boxes, 0);
        }
        Self { tree }
    }

    /// Things in the order of the leaves, from things by [`Boxed::index`].
    pub fn in_order<T>(&self, things: Vec<T>) -> Vec<T> {
        let mut things: Vec<Option<T>> = things.into_iter().map(Some).collect();
        let order = self.tree.primitive_indices.iter();
        order.filter_map(|index| things[*index as usize].take()).collect()
    }

    /// The tree, for `obvhs::traverse!`.
    pub fn tree(&self) -> &CwBvh {
        &self.tree
    }

    /// The start of a traversal.
    pub fn traversal(&self, direction: Vec3A) -> Traversal {
        self.tree.new_traversal(direction)
    }
}

fn widened(boxes: &mut [Boxed], halve_below: usize) -> CwBvh {
    let mut nodes = vec![Bvh2Node::default(); 2 * boxes.len() - 1];
    let (root, rest) = nodes.split_at_mut(1);
    build(boxes, 0, &mut root[0], rest, 1, halve_below);
    let primitive_indices = boxes.iter().map(|item| item.index).collect();
    let binary = Bvh2 { nodes, primitive_indices, ..Bvh2::default() };
    bvh2_to_cwbvh(&binary, LEAF_TRIANGLES, true, false)
}

/// Levels of a wide tree.
fn levels(tree: &CwBvh) -> usize {
    let (mut deepest, mut open) = (0, vec![(0usize, 1usize)]);
    while let Some((index, level)) = open.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[index];
        let inner = (0..8).filter(|child| !node.is_child_empty(*child) && !node.is_leaf(*child));
        open.extend(inner.map(|child| (node.child_node_index(child) as usize, level + 1)));
    }
    deepest
}

/// A box that grows.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3A,
    high: Vec3A,
}

impl Bounds {
    const NONE: Self = Self { low: Vec3A::INFINITY, high: Vec3A::NEG_INFINITY };

    fn add(&mut self, low: Vec3A, high: Vec3A) {
        self.low = self.low.min(low);
        self.high = self.high.max(high);
    }

    /// Half the surface area; 0 of none.
    fn half_area(&self) -> f32 {
        let size = (self.high - self.low).max(Vec3A::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

/// Builds the tree over `boxes` into `node` and `below`, which holds exactly the nodes below it
/// and starts at index `first_below` of the whole.
fn build(
    boxes: &mut [Boxed],
    first_box: usize,
    node: &mut Bvh2Node,
    below: &mut [Bvh2Node],
    first_below: usize,
    depth_left: usize,
) {
    let mut bounds = Bounds::NONE;
    boxes.iter().for_each(|item| bounds.add(item.low, item.high));
    let aabb = Aabb::new(bounds.low, bounds.high);
    if boxes.len() == 1 {
        *node = Bvh2Node::new(aabb, 1, first_box as u32);
        return;
    }
    *node = Bvh2Node::new(aabb, 0, first_below as u32);
    let middle = if depth_left == 0 { None } else { partition(boxes) };
    let middle = middle.unwrap_or_else(|| halve(boxes));
    let depth_left = depth_left.saturating_sub(1);
    let many = boxes.len() >= SIDE_BY_SIDE;
    let (left_boxes, right_boxes) = boxes.split_at_mut(middle);
    let (children, below) = below.split_at_mut(2);
    let (left, right) = children.split_at_mut(1);
    let (below_left, below_right) = below.split_at_mut(2 * middle - 2);
    let (first_left, first_right) = (first_below + 2, first_below + 2 * middle);
    let mut build_left =
        || build(left_boxes, first_box, &mut left[0], below_left, first_left, depth_left);
    let mut build_right = || {
        build(right_boxes, first_box + middle, &mut right[0], below_right, first_right, depth_left);
    };
    if many {
        rayon::join(build_left, build_right);
    } else {
        build_left();
        build_right();
    }
}

/// Parts boxes where the surface area heuristic is least, and says how many come first; `None`
/// where all centres coincide.
fn partition(boxes: &mut [Boxed]) -> Option<usize> {
    let mut centers = Bounds::NONE;
    for item in boxes.iter() {
        let center = item.low + item.high;
        centers.add(center, center);
    }
    let size = centers.high - centers.low;
    let scale = size.map(|s| if s > 0.0 { BINS as f32 * (1.0 - 1e-6) / s } else { 0.0 });
    if scale == Vec3A::ZERO || !scale.is_finite() {
        return None;
    }
    let bin_of = |item: &Boxed| (item.low + item.high - centers.low) * scale;
    let mut bins = [[(Bounds::NONE, 0u32); BINS]; 3];
    for item in boxes.iter() {
        let at = bin_of(item);
        for axis in 0..3 {
            let bin = &mut bins[axis][(at[axis] as usize).min(BINS - 1)];
            bin.0.add(item.low, item.high);
            bin.1 += 1;
        }
    }
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|axis| scale[*axis] > 0.0) {
        // Cost of everything from a bin on.
        let mut after = [0f32; BINS];
        let (mut bounds, mut count) = (Bounds::NONE, 0);
        for bin in (1..BINS).rev() {
            bounds.add(bins[axis][bin].0.low, bins[axis][bin].0.high);
            count += bins[axis][bin].1;
            after[bin] = bounds.half_area() * count as f32;
        }
        let (mut bounds, mut count) = (Bounds::NONE, 0);
        for bin in 1..BINS {
            bounds.add(bins[axis][bin - 1].0.low, bins[axis][bin - 1].0.high);
            count += bins[axis][bin - 1].1;
            let cost = bounds.half_area() * count as f32 + after[bin];
            let parts = count > 0 && (count as usize) < boxes.len();
            if parts && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, bin));
            }
        }
    }
    let (_, axis, bin) = best?;
    let mut first = 0;
    for at in 0..boxes.len() {
        if ((bin_of(&boxes[at])[axis] as usize).min(BINS - 1)) < bin {
            boxes.swap(first, at);
            first += 1;
        }
    }
    Some(first)
}

/// Parts boxes in the middle of the axis along which their centres spread most.
fn halve(boxes: &mut [Boxed]) -> usize {
    let mut centers = Bounds::NONE;
    for item in boxes.iter() {
        centers.add(item.low + item.high, item.low + item.high);
    }
    let size = centers.high - centers.low;
    let axis = (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
    let middle = boxes.len() / 2;
    boxes.select_nth_unstable_by(middle, |a, b| {
        (a.low + a.high)[axis].total_cmp(&(b.low + b.high)[axis]).then(a.index.cmp(&b.index))
    });
    middle
}
