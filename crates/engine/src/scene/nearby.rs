//! Pairs of triangles whose boxes overlap, found by halving both sets.

use glam::Vec3;

/// So many pairs are looked at one by one.
const FEW_PAIRS: usize = 512;
/// Most halvings: boxes that all overlap are not told apart by any.
const MOST_HALVINGS: u32 = 40;

/// An axis-aligned box.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

impl Bounds {
    fn of(corners: [Vec3; 3], reach: f32) -> Self {
        let [a, b, c] = corners;
        Self { low: a.min(b).min(c) - reach, high: a.max(b).max(c) + reach }
    }

    fn around(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && self.high.cmpge(other.low).all()
    }
}

/// One of a set, and its box.
type Member = (u32, Bounds);

/// Whether a pair is wanted.
type Wanted<'a> = &'a (dyn Fn(u32, u32) -> bool + Sync);

/// Pairs (i, j) where triangle i of the first set, with its reach about it, and triangle j of the
/// second have boxes that overlap, of those that are `wanted`. In no particular order, but always the
/// same.
pub fn pairs_nearby(
    first: &[([Vec3; 3], f32)],
    second: &[[Vec3; 3]],
    wanted: Wanted<'_>,
) -> Vec<(u32, u32)> {
    let one = first.iter().map(|(corners, reach)| Bounds::of(*corners, *reach));
    let other = second.iter().map(|corners| Bounds::of(*corners, 0.0));
    let mut one: Vec<Member> = (0..).zip(one).collect();
    let mut other: Vec<Member> = (0..).zip(other).collect();
    halve((&mut one, &mut other), MOST_HALVINGS, wanted)
}

/// Pairs of two sets.
fn halve(
    (one, other): (&mut [Member], &mut [Member]),
    halvings: u32,
    wanted: Wanted<'_>,
) -> Vec<(u32, u32)> {
    let (Some(around_one), Some(around_other)) = (around(one), around(other)) else {
        return Vec::new();
    };
    if !around_one.overlaps(&around_other) {
        return Vec::new();
    }
    if one.len() * other.len() <= FEW_PAIRS || halvings == 0 {
        let mut pairs = Vec::new();
        for (i, own) in one.iter() {
            let near = other.iter().filter(|(_, bounds)| own.overlaps(bounds));
            pairs.extend(near.map(|(j, _)| (*i, *j)).filter(|(i, j)| wanted(*i, *j)));
        }
        return pairs;
    }
    let (many, few, of_one) =
        if one.len() > other.len() { (one, other, true) } else { (other, one, false) };
    let around_many = if of_one { around_one } else { around_other };
    let size = around_many.high - around_many.low;
    let axis = size.max_position();
    let middle = many.len() / 2;
    let place = |member: &Member| member.1.low[axis] + member.1.high[axis];
    many.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)).then(a.0.cmp(&b.0)));
    let (left, right) = many.split_at_mut(middle);
    let half = |half: &mut [Member]| {
        let mut near = overlapping(few, around(half));
        match of_one {
            true => halve((half, &mut near), halvings - 1, wanted),
            false => halve((&mut near, half), halvings - 1, wanted),
        }
    };
    let (mut pairs, others) = rayon::join(|| half(left), || half(right));
    pairs.extend(others);
    pairs
}

/// Those of a set whose boxes overlap another one, if there is one.
fn overlapping(members: &[Member], bounds: Option<Bounds>) -> Vec<Member> {
    let near = |bounds: Bounds| members.iter().filter(move |(_, own)| own.overlaps(&bounds));
    bounds.map(near).into_iter().flatten().copied().collect()
}

/// The box around all.
fn around(members: &[Member]) -> Option<Bounds> {
    members.iter().map(|(_, bounds)| *bounds).reduce(Bounds::around)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg;

    #[test]
    fn all_pairs_are_found_once() {
        let number = |k: u32| pcg(k) as f32 / u32::MAX as f32;
        let triangle = |k: u32, size: f32| {
            let at = Vec3::new(number(9 * k), number(9 * k + 1), number(9 * k + 2));
            let edge = |n: u32| at + size * (number(9 * k + n) - 0.5);
            [at, edge(4), edge(5) + Vec3::X * size * number(9 * k + 6)]
        };
        let first: Vec<_> = (0..60).map(|k| (triangle(k, 0.5), 0.01)).collect();
        let second: Vec<_> = (100..900).map(|k| triangle(k, 0.1)).collect();
        let mut found = pairs_nearby(&first, &second, &|_, _| true);
        found.sort_unstable();
        let mut expected = Vec::new();
        for (i, (corners, reach)) in (0..).zip(&first) {
            let own = Bounds::of(*corners, *reach);
            let near = (0..).zip(&second).filter(|(_, b)| own.overlaps(&Bounds::of(**b, 0.0)));
            expected.extend(near.map(|(j, _)| (i, j)));
        }
        assert!(expected.len() > 100 && expected.len() < 60 * 800 / 2, "{}", expected.len());
        assert_eq!(found, expected);
        let wanted = |i: u32, j: u32| (i + j).is_multiple_of(3);
        let mut found = pairs_nearby(&first, &second, &wanted);
        found.sort_unstable();
        expected.retain(|(i, j)| wanted(*i, *j));
        assert_eq!(found, expected);
    }
}
