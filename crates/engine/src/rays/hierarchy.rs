//! The tree of boxes around triangles: binary by the surface area heuristic in bins, top-down,
//! which hostile heaps of coinciding triangles can neither slow down nor deepen; then eight
//! children a node, with up to eight triangles a leaf, since eight are tested at once.

use super::boxes::{Boxes, LEAF, Node, Slabs};
use super::triangle::WIDTH;
use glam::Vec3A;
use std::mem::MaybeUninit;
use std::ops::Range;

/// Bins of the heuristic.
const BINS: usize = 32;
/// Below this depth of the binary tree, nodes are halved by count, so that no tree is deep.
const HALVE_BELOW: usize = 40;
/// Levels of the wide tree that a traversal's stack holds.
const MOST_LEVELS: usize = 31;
/// Nodes that wait, at most: a node leaves seven for later while its eighth is looked into.
const MOST_WAITING: usize = MOST_LEVELS * (WIDTH - 1) + 1;
/// A leaf is parted while its node has room if that saves this share of its area: otherwise leaves
/// are full, and few.
const PART: f32 = 0.2;
/// Up to so many boxes are parted without filling bins.
const FEW: usize = 16;
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
    nodes: Vec<Node>,
    /// The boxes that each leaf has, in their new order: one to [`WIDTH`].
    leaves: Vec<Range<u32>>,
}

impl Hierarchy {
    /// Bytes that it takes.
    pub fn held_bytes(&self) -> u64 {
        (size_of_val(&*self.nodes) + size_of_val(&*self.leaves)) as u64
    }

    /// The tree over boxes, which are reordered, with at most `in_leaf` of them in a leaf, which are
    /// at most [`WIDTH`].
    pub fn new(boxes: &mut [Boxed], in_leaf: usize) -> Self {
        if boxes.is_empty() {
            return Self::default();
        }
        let mut tree = Self::widened(boxes, HALVE_BELOW, in_leaf);
        if tree.levels() > MOST_LEVELS {
            tree = Self::widened(boxes, 0, in_leaf);
        }
        tree
    }

    fn widened(boxes: &mut [Boxed], halve_below: usize, in_leaf: usize) -> Self {
        let binary = binary_tree(boxes, halve_below);
        let mut tree = Self::default();
        tree.nodes.push(Node::EMPTY);
        let mut open = vec![(0usize, 0usize)];
        while let Some((wide, top)) = open.pop() {
            for (child, index) in children(&binary, top, in_leaf).into_iter().enumerate() {
                let below = &binary[index as usize];
                let place = if below.count as usize <= in_leaf {
                    tree.leaves.push(below.first..below.first + below.count);
                    LEAF | (tree.leaves.len() - 1) as u32
                } else {
                    tree.nodes.push(Node::EMPTY);
                    open.push((tree.nodes.len() - 1, index as usize));
                    (tree.nodes.len() - 1) as u32
                };
                tree.nodes[wide].put(child, below.bounds.low, below.bounds.high, place);
            }
        }
        tree
    }

    /// Levels of nodes.
    fn levels(&self) -> usize {
        let (mut deepest, mut open) = (0, vec![(0usize, 1usize)]);
        while let Some((index, level)) = open.pop() {
            deepest = deepest.max(level);
            let inner = self.nodes[index].inner();
            open.extend(inner.map(|child| (child as usize, level + 1)));
        }
        deepest
    }

    /// The boxes that each leaf has, in the order to which [`Hierarchy::new`] brought them: one to
    /// as many as that was told.
    pub fn leaves(&self) -> &[Range<u32>] {
        &self.leaves
    }

    /// Shows `leaf` the leaves that a ray meets before `end`, nearer nodes first where
    /// `NEAREST_FIRST`, until it returns `true`, and returns whether it did. It may lower `end`.
    #[inline(always)]
    pub fn walk<const NEAREST_FIRST: bool, B: Boxes>(
        &self,
        ray: &Slabs,
        mut end: f32,
        mut leaf: impl FnMut(usize, &mut f32) -> bool,
    ) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let mut waiting = [const { MaybeUninit::<(f32, u32)>::uninit() }; MOST_WAITING];
        let mut count = 0;
        let mut at = 0;
        loop {
            if at & LEAF == 0 {
                let node = &self.nodes[at as usize];
                let (mut met, enter) = B::met(node, ray, end);
                if met & met.wrapping_sub(1) == 0 && met != 0 {
                    at = node.child(met.trailing_zeros() as usize);
                    continue;
                }
                let first = count;
                while met != 0 {
                    let child = met.trailing_zeros() as usize;
                    met &= met - 1;
                    let new = (enter[child], node.child(child));
                    let mut place = count;
                    if NEAREST_FIRST {
                        // Sorted by insertion: the nearest comes last and is taken first.
                        while place > first {
                            // SAFETY: everything below `count` was written.
                            let before = unsafe { waiting[place - 1].assume_init() };
                            if before.0 >= new.0 {
                                break;
                            }
                            waiting[place].write(before);
                            place -= 1;
                        }
                    }
                    waiting[place].write(new);
                    count += 1;
                }
            } else if leaf((at & !LEAF) as usize, &mut end) {
                return true;
            }
            loop {
                if count == 0 {
                    return false;
                }
                count -= 1;
                // SAFETY: everything below `count` was written.
                let (enter, next) = unsafe { waiting[count].assume_init() };
                if !NEAREST_FIRST || enter <= end {
                    at = next;
                    break;
                }
            }
        }
    }
}

/// A node of the binary tree: its boxes are those from `first` on.
#[derive(Clone, Copy)]
struct Binary {
    bounds: Bounds,
    first: u32,
    count: u32,
    /// The first of two neighbouring children, where there are any.
    children: u32,
}

/// The binary tree over boxes, which are reordered, its root first. Its memory is written for the
/// first time where it is built, side by side.
fn binary_tree(boxes: &mut [Boxed], halve_below: usize) -> Vec<Binary> {
    let count = 2 * boxes.len() - 1;
    let mut nodes: Vec<Binary> = Vec::with_capacity(count);
    let (root, below) = nodes.spare_capacity_mut()[..count].split_at_mut(1);
    let boxes = ArrayRange { first: 0, items: boxes };
    build(boxes, &mut root[0], ArrayRange { first: 1, items: below }, halve_below);
    // SAFETY: `build` writes a node and all of the two for each box but one that are below it.
    unsafe { nodes.set_len(count) };
    nodes
}

/// The children of a wide node over the binary node `top`: first what needs nodes of its own is
/// parted, largest first; then leaves are, where that makes less area.
fn children(binary: &[Binary], top: usize, in_leaf: usize) -> Vec<u32> {
    let mut children = vec![top as u32];
    let node = |index: u32| &binary[index as usize];
    let gain = |index: u32| {
        let node = node(index);
        let area = node.bounds.half_area();
        if node.count as usize > in_leaf {
            return (true, area);
        }
        if node.count == 1 {
            return (false, 0.0);
        }
        let parts = node.children as usize;
        let parted = binary[parts].bounds.half_area() + binary[parts + 1].bounds.half_area();
        (false, area - parted)
    };
    while children.len() < WIDTH {
        let (best, (inner, most)) = (0..children.len())
            .map(|child| (child, gain(children[child])))
            .fold((0, (false, 0.0)), |best, new| {
                let more = (new.1.0, new.1.1) > (best.1.0, best.1.1);
                if more { new } else { best }
            });
        if !inner && most <= PART * node(children[best]).bounds.half_area() {
            break;
        }
        let parts = node(children[best]).children;
        children[best] = parts;
        children.push(parts + 1);
    }
    children
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

/// Consecutive items of a larger array, with the index of the first of them in that array.
struct ArrayRange<'a, T> {
    first: usize,
    items: &'a mut [T],
}

impl<T> ArrayRange<'_, T> {
    /// The first so many, and the rest.
    fn split_at(&mut self, count: usize) -> (ArrayRange<'_, T>, ArrayRange<'_, T>) {
        let (left, right) = self.items.split_at_mut(count);
        (
            ArrayRange { first: self.first, items: left },
            ArrayRange { first: self.first + count, items: right },
        )
    }
}

/// Builds the tree over `boxes` into `node` and `below`, which holds exactly the nodes below it.
fn build(
    mut boxes: ArrayRange<'_, Boxed>,
    node: &mut MaybeUninit<Binary>,
    mut below: ArrayRange<'_, MaybeUninit<Binary>>,
    depth_left: usize,
) {
    let mut bounds = Bounds::NONE;
    boxes.items.iter().for_each(|item| bounds.add(item.low, item.high));
    let (first, count) = (boxes.first as u32, boxes.items.len() as u32);
    node.write(Binary { bounds, first, count, children: below.first as u32 });
    if count == 1 {
        return;
    }
    let middle = if depth_left == 0 { None } else { partition(boxes.items) };
    let middle = middle.unwrap_or_else(|| halve(boxes.items));
    let depth_left = depth_left.saturating_sub(1);
    let many = boxes.items.len() >= SIDE_BY_SIDE;
    let (left_boxes, right_boxes) = boxes.split_at(middle);
    let (children, mut below) = below.split_at(2);
    let (left, right) = children.items.split_at_mut(1);
    let (below_left, below_right) = below.split_at(2 * middle - 2);
    let build_left = || build(left_boxes, &mut left[0], below_left, depth_left);
    let build_right = || build(right_boxes, &mut right[0], below_right, depth_left);
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
    let bins_of = |item: &Boxed| (item.low + item.high - centers.low) * scale;
    let bin_of = |item: &Boxed, axis: usize| (bins_of(item)[axis] as usize).min(BINS - 1);
    let axes = (0..3).filter(|axis| scale[*axis] > 0.0);
    let best = match boxes.len() <= FEW {
        true => best_of_few(boxes, axes, bin_of),
        false => best_of_many(boxes, axes, bin_of),
    };
    let Cut { axis, bin, .. } = best?;
    let mut first = 0;
    for at in 0..boxes.len() {
        if bin_of(&boxes[at], axis) < bin {
            boxes.swap(first, at);
            first += 1;
        }
    }
    Some(first)
}

/// Where boxes are parted: those in bins below `bin` along an axis come first.
struct Cut {
    cost: f32,
    axis: usize,
    bin: usize,
}

/// The best cut between bins, along the first axis and in the first place of all that are as good.
fn best_of_many(
    boxes: &[Boxed],
    axes: impl Iterator<Item = usize>,
    bin_of: impl Fn(&Boxed, usize) -> usize,
) -> Option<Cut> {
    let mut best: Option<Cut> = None;
    let mut bins = [[(Bounds::NONE, 0u32); BINS]; 3];
    for item in boxes {
        for (axis, bins) in bins.iter_mut().enumerate() {
            let bin = &mut bins[bin_of(item, axis)];
            bin.0.add(item.low, item.high);
            bin.1 += 1;
        }
    }
    for axis in axes {
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
            if parts && best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Cut { cost, axis, bin });
            }
        }
    }
    best
}

/// The same cut of at most [`FEW`] boxes, which leave most bins empty: only those that are not are
/// looked at, in order.
fn best_of_few(
    boxes: &[Boxed],
    axes: impl Iterator<Item = usize>,
    bin_of: impl Fn(&Boxed, usize) -> usize,
) -> Option<Cut> {
    let mut best: Option<Cut> = None;
    let count = boxes.len();
    for axis in axes {
        // Boxes by their bins, sorted by insertion.
        let mut order = [(0usize, 0usize); FEW];
        for (index, item) in boxes.iter().enumerate() {
            let (bin, mut place) = (bin_of(item, axis), index);
            while place > 0 && order[place - 1].0 > bin {
                order[place] = order[place - 1];
                place -= 1;
            }
            order[place] = (bin, index);
        }
        let mut after = [0f32; FEW];
        let mut bounds = Bounds::NONE;
        for place in (1..count).rev() {
            let item = &boxes[order[place].1];
            bounds.add(item.low, item.high);
            after[place] = bounds.half_area() * (count - place) as f32;
        }
        let mut bounds = Bounds::NONE;
        for place in 1..count {
            let (bin, index) = order[place - 1];
            bounds.add(boxes[index].low, boxes[index].high);
            if order[place].0 == bin {
                continue;
            }
            let cost = bounds.half_area() * place as f32 + after[place];
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Cut { cost, axis, bin: bin + 1 });
            }
        }
    }
    best
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    /// Few boxes are cut where many would be, also where several cuts are as good.
    #[test]
    fn few_boxes_are_cut_where_many_are() {
        let mut numbers = Numbers::new(5, Stream::Gather, 0);
        for round in 0..20_000 {
            let count = 2 + round % (FEW - 1);
            let mut number = || match round % 3 {
                0 => (4.0 * numbers.uniform()).floor(),
                _ => numbers.uniform(),
            };
            let boxes: Vec<Boxed> = (0..count)
                .map(|index| {
                    let low = Vec3A::new(number(), number(), number());
                    let size = Vec3A::new(number(), number(), number());
                    Boxed { low, high: low + size, index: index as u32 }
                })
                .collect();
            let bin_of =
                |item: &Boxed, axis: usize| ((item.low[axis] * 9.0) as usize).min(BINS - 1);
            let few = best_of_few(&boxes, 0..3, bin_of);
            let many = best_of_many(&boxes, 0..3, bin_of);
            let places = [few, many].map(|cut| cut.map(|cut| (cut.axis, cut.bin, cut.cost)));
            assert_eq!(places[0], places[1], "round {round}");
        }
    }
}
