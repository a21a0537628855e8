//! Where the illumination map keeps its values: a (u, v) grid on each diffuse side of a triangle,
//! in the triangle's own barycentric coordinates, so that |T_u × T_v| is one number on it.
//!
//! Values stand at grid points and are interpolated linearly over the half cells that triangles
//! have. Where two triangles meet smoothly, they share the points of their edge; a finer one's
//! points in between follow the coarser one's (divisions are powers of two). So the map has no
//! seams inside a smooth surface, and the shares of what lands anywhere sum to 1.

use crate::scene::Scene;
use glam::Vec3;
use std::collections::HashMap;

/// Triangles whose normals differ by less than 30° are one smooth surface.
const SMOOTH: f32 = 0.866;
/// Most divisions of a side of a triangle.
const MOST_DIVISIONS: u32 = 2048;
/// "No chart."
const NONE: u32 = u32::MAX;

/// A side of a triangle that can keep light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// Which side.
    pub back: bool,
    /// Area, m².
    pub area: f32,
    /// How many cells it gets, next to others.
    pub weight: f64,
}

/// The charts of a scene.
pub struct Charts {
    /// By triangle and side.
    of: Vec<[u32; 2]>,
    charts: Vec<Chart>,
    /// Value of each grid point, by chart.
    values: Vec<u32>,
    /// Integral of each value's share over the surface, m²: |T_u × T_v| Δu Δv inside a chart. 0
    /// of values that follow others.
    areas: Vec<f32>,
    following: Vec<Following>,
}

#[derive(Clone, Copy)]
struct Chart {
    first: u32,
    divisions: u32,
}

/// A value between two others on a coarser edge.
struct Following {
    value: u32,
    ends: [u32; 2],
    /// Weight of the second.
    at: f32,
}

/// Values by weight.
pub type Shares = [(u32, f32); 3];

impl Charts {
    /// Cuts receivers, which have positive areas, into about `cells` cells by weight, at least
    /// one each.
    pub fn new(scene: &Scene, receivers: &[Receiver], cells: u64) -> Self {
        let total: f64 = receivers.iter().map(|receiver| receiver.weight).sum();
        let mut charts = Self {
            of: vec![[NONE; 2]; scene.triangle_count()],
            charts: Vec::with_capacity(receivers.len()),
            values: Vec::new(),
            areas: Vec::new(),
            following: Vec::new(),
        };
        for (index, receiver) in receivers.iter().enumerate() {
            let wanted = cells as f64 * (receiver.weight / total.max(f64::MIN_POSITIVE));
            let power = (0.5 * wanted.max(1.0).log2()).round() as u32;
            let divisions = (1 << power.min(16)).min(MOST_DIVISIONS);
            charts.of[receiver.triangle as usize][usize::from(receiver.back)] = index as u32;
            let first = charts.values.len() as u32;
            charts.charts.push(Chart { first, divisions });
            charts.values.resize(charts.values.len() + points(divisions), NONE);
        }
        charts.number(&neighbours(scene, receivers));
        charts.measure(receivers);
        charts
    }

    /// Bytes of the charts of so many receivers and cells, and of a map on them, at most.
    pub fn needed_bytes(receivers: u64, cells: u64) -> u64 {
        // Rounding to powers of two may double the cells; a receiver has three points of its own.
        receivers * 800 + cells * 2 * 30
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// The integral of each value's share over the surface, m²; 0 of values that follow others.
    pub fn areas(&self) -> &[f32] {
        &self.areas
    }

    /// The values around barycentric (u, v) of a triangle's side and their weights, which are not
    /// negative and sum to 1. `None` where the side keeps no light.
    pub fn shares(&self, triangle: u32, back: bool, [u, v]: [f32; 2]) -> Option<Shares> {
        let chart = self.charts.get(self.of[triangle as usize][usize::from(back)] as usize)?;
        let n = chart.divisions;
        let (u, v) = (u.max(0.0), v.max(0.0));
        let stretch = n as f32 / (u + v).max(1.0);
        let (u, v) = (u * stretch, v * stretch);
        let i = (u as u32).min(n - 1);
        let j = (v as u32).min(n - 1 - i);
        let (a, b) = (u - i as f32, v - j as f32);
        let value = |i, j| self.values[chart.first as usize + point(n, i, j)];
        // Beyond the diagonal of the last cell there is nothing but rounding.
        Some(if a + b <= 1.0 || i + j + 1 == n {
            let (a, b) = (a.min(1.0), b.min(1.0));
            let rest = (1.0 - a - b).max(0.0);
            [(value(i, j), rest), (value(i + 1, j), a), (value(i, j + 1), 1.0 - rest - a)]
        } else {
            let (a, b) = (1.0 - a, 1.0 - b);
            [(value(i + 1, j + 1), 1.0 - a - b), (value(i, j + 1), a), (value(i + 1, j), b)]
        })
    }

    /// Hands what values have that follow others to those.
    pub fn gather<T>(&self, sums: &mut [T])
    where
        T: Copy + Default + std::ops::AddAssign + std::ops::Mul<f32, Output = T>,
    {
        for Following { value, ends: [a, b], at } in &self.following {
            let sum = std::mem::take(&mut sums[*value as usize]);
            sums[*a as usize] += sum * (1.0 - at);
            sums[*b as usize] += sum * *at;
        }
    }

    /// Sets values that follow others.
    pub fn spread<T>(&self, values: &mut [T])
    where
        T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>,
    {
        for Following { value, ends: [a, b], at } in &self.following {
            values[*value as usize] = values[*a as usize] * (1.0 - at) + values[*b as usize] * *at;
        }
    }

    /// Numbers the values of all grid points: corners, edges, insides.
    fn number(&mut self, neighbours: &[[Option<(u32, usize)>; 3]]) {
        let mut next = 0;
        let mut new = || {
            next += 1;
            next - 1
        };
        let corner_groups = corner_groups(neighbours);
        let mut group_values = HashMap::new();
        for chart in 0..self.charts.len() {
            for corner in 0..3 {
                let group = corner_groups[3 * chart + corner];
                let value = *group_values.entry(group).or_insert_with(&mut new);
                let n = self.charts[chart].divisions;
                *self.edge_value(chart, corner, 0, n) = value;
            }
        }
        for (chart, edges) in neighbours.iter().enumerate() {
            for (edge, neighbour) in edges.iter().enumerate() {
                let own = self.charts[chart].divisions;
                let other =
                    neighbour.map_or(own, |(other, _)| self.charts[other as usize].divisions);
                let common = own.min(other);
                // The edge's points belong to the first of the two.
                if neighbour.is_some_and(|(other, _)| (other as usize) < chart) {
                    continue;
                }
                for step in 1..common {
                    let value = new();
                    *self.edge_value(chart, edge, step, common) = value;
                    if let Some((other, edge)) = *neighbour {
                        *self.edge_value(other as usize, edge, common - step, common) = value;
                    }
                }
            }
        }
        for (chart, edges) in neighbours.iter().enumerate() {
            let n = self.charts[chart].divisions;
            for (edge, neighbour) in edges.iter().enumerate() {
                let other = neighbour.map_or(n, |(other, _)| self.charts[other as usize].divisions);
                let stride = n / n.min(other);
                for step in (1..n).filter(|step| step % stride != 0) {
                    let before = step - step % stride;
                    let ends = [before, before + stride]
                        .map(|step| *self.edge_value(chart, edge, step, n));
                    let value = new();
                    *self.edge_value(chart, edge, step, n) = value;
                    let at = (step % stride) as f32 / stride as f32;
                    self.following.push(Following { value, ends, at });
                }
            }
            for i in 1..n {
                for j in 1..n - i {
                    self.values[self.charts[chart].first as usize + point(n, i, j)] = new();
                }
            }
        }
        self.areas = vec![0.0; next as usize];
    }

    /// The value at `step` of `steps` along an edge, from the corner of the edge's number.
    fn edge_value(&mut self, chart: usize, edge: usize, step: u32, steps: u32) -> &mut u32 {
        let Chart { first, divisions: n } = self.charts[chart];
        let along = step * (n / steps);
        let at = match edge {
            0 => point(n, along, 0),
            1 => point(n, n - along, along),
            _ => point(n, 0, n - along),
        };
        &mut self.values[first as usize + at]
    }

    /// Integrals of the shares: a third of each half cell for each of its points.
    fn measure(&mut self, receivers: &[Receiver]) {
        let mut areas = vec![0f64; self.areas.len()];
        for (chart, receiver) in self.charts.iter().zip(receivers) {
            let n = chart.divisions;
            let third = f64::from(receiver.area) / f64::from(n * n) / 3.0;
            for i in 0..n {
                for j in 0..n - i {
                    let lower = [(i, j), (i + 1, j), (i, j + 1)];
                    let upper = [(i + 1, j + 1), (i, j + 1), (i + 1, j)];
                    let upper = upper.into_iter().filter(|_| i + j + 1 < n);
                    for (i, j) in lower.into_iter().chain(upper) {
                        let value = self.values[chart.first as usize + point(n, i, j)];
                        areas[value as usize] += third;
                    }
                }
            }
        }
        let mut areas: Vec<f32> = areas.into_iter().map(|area| area as f32).collect();
        self.gather(&mut areas);
        self.areas = areas;
    }
}

/// Grid points of a triangle.
fn points(divisions: u32) -> usize {
    let n = divisions as usize;
    (n + 1) * (n + 2) / 2
}

/// Number of the grid point (i, j).
fn point(divisions: u32, i: u32, j: u32) -> usize {
    let (n, i, j) = (divisions as usize, i as usize, j as usize);
    i * (2 * n + 3 - i) / 2 + j
}

/// For each receiver and edge, the receiver and edge on the other side, where the surface goes on
/// smoothly. Edge e leads from corner e to the next.
fn neighbours(scene: &Scene, receivers: &[Receiver]) -> Vec<[Option<(u32, usize)>; 3]> {
    let mut places: HashMap<[u32; 3], u32> = HashMap::new();
    let mut corners = |receiver: &Receiver| -> [u32; 3] {
        scene.corners(&scene.triangle(receiver.triangle)).map(|position| {
            let next = places.len() as u32;
            // Adding zero turns −0 into +0.
            *places.entry((position + 0.0).to_array().map(f32::to_bits)).or_insert(next)
        })
    };
    let corners: Vec<[u32; 3]> = receivers.iter().map(&mut corners).collect();
    // Fronts go on as fronts, in the other direction along the edge, and backs as backs.
    let ends = |receiver: usize, edge: usize| {
        let [a, b] = [edge, (edge + 1) % 3].map(|corner| corners[receiver][corner]);
        (receivers[receiver].back, a, b)
    };
    // `None`: more than one, so that it is not clear how the surface goes on.
    let mut by_ends: HashMap<(bool, u32, u32), Option<(u32, usize)>> = HashMap::new();
    for receiver in 0..receivers.len() {
        for edge in 0..3 {
            let place = Some((receiver as u32, edge));
            by_ends.entry(ends(receiver, edge)).and_modify(|known| *known = None).or_insert(place);
        }
    }
    let normal = |receiver: usize| {
        let Receiver { triangle, back, .. } = receivers[receiver];
        let [a, b, c] = scene.corners(&scene.triangle(triangle)).map(Vec3::as_dvec3);
        let normal = (b - a).cross(c - a).normalize_or_zero().as_vec3();
        if back { -normal } else { normal }
    };
    let goes_on = |receiver: usize, edge: usize| {
        let (back, a, b) = ends(receiver, edge);
        let (other, other_edge) = (*by_ends.get(&(back, b, a))?)?;
        by_ends[&(back, a, b)]?;
        let smooth = normal(receiver).dot(normal(other as usize)) > SMOOTH;
        (smooth && other as usize != receiver).then_some((other, other_edge))
    };
    (0..receivers.len()).map(|receiver| [0, 1, 2].map(|edge| goes_on(receiver, edge))).collect()
}

/// For each receiver and corner the number of a group of corners that are one point of a smooth
/// surface.
fn corner_groups(neighbours: &[[Option<(u32, usize)>; 3]]) -> Vec<usize> {
    let mut parent: Vec<usize> = (0..3 * neighbours.len()).collect();
    fn root(parent: &mut [usize], mut at: usize) -> usize {
        while parent[at] != at {
            parent[at] = parent[parent[at]];
            at = parent[at];
        }
        at
    }
    for (receiver, edges) in neighbours.iter().enumerate() {
        for (edge, neighbour) in edges.iter().enumerate() {
            let Some((other, other_edge)) = neighbour else { continue };
            let other = 3 * *other as usize;
            for (own, theirs) in [(edge, (other_edge + 1) % 3), ((edge + 1) % 3, *other_edge)] {
                let a = root(&mut parent, 3 * receiver + own);
                let b = root(&mut parent, other + theirs);
                parent[a] = b;
            }
        }
    }
    (0..parent.len()).map(|corner| root(&mut parent, corner)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;

    /// Rooms, a sphere with its poles and a box, two-sided, with uneven weights.
    fn scene() -> (Scene, Vec<Receiver>) {
        let scene = import(&made::corridor(), &Resources::new(), &ImportLimits::default());
        let scene = scene.expect("a valid scene");
        let mut numbers = Numbers::new(3, Stream::LightRay, 0);
        let mut receivers = Vec::new();
        for (index, triangle) in scene.triangles.iter().enumerate() {
            let [a, b, c] = scene.corners(triangle);
            let area = 0.5 * (b - a).cross(c - a).length();
            for back in [false, true] {
                let weight = f64::from(area) * (0.1 + numbers.fine());
                receivers.push(Receiver { triangle: index as u32, back, area, weight });
            }
        }
        (scene, receivers)
    }

    #[test]
    fn shares_sum_to_one_everywhere() {
        let (scene, receivers) = scene();
        let charts = Charts::new(&scene, &receivers, 200_000);
        let mut numbers = Numbers::new(4, Stream::LightRay, 0);
        for receiver in &receivers {
            let mut places = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [0.0, 0.3]];
            // And what rounding may make of the border.
            places.extend([[-1e-6, 0.4], [1.0 + 1e-6, -1e-7], [0.6, 0.4 + 1e-6]]);
            for _ in 0..20 {
                let (u, v) = (numbers.uniform(), numbers.uniform());
                places.push(if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] });
            }
            for at in places {
                let shares = charts.shares(receiver.triangle, receiver.back, at).expect("a chart");
                assert!(shares.iter().all(|(_, share)| *share >= -1e-6), "{at:?}: {shares:?}");
                let sum: f32 = shares.iter().map(|(_, share)| share).sum();
                assert!((sum - 1.0).abs() < 1e-6, "{at:?}: {shares:?}");
            }
        }
    }

    #[test]
    fn areas_are_the_surface() {
        let (scene, receivers) = scene();
        let surface: f64 = receivers.iter().map(|receiver| f64::from(receiver.area)).sum();
        for cells in [1, 5_000, 200_000] {
            let charts = Charts::new(&scene, &receivers, cells);
            let sum: f64 = charts.areas().iter().map(|area| f64::from(*area)).sum();
            assert!((sum / surface - 1.0).abs() < 1e-5, "{cells}: {sum} of {surface}");
            let following = charts.following.len();
            let empty = charts.areas().iter().filter(|area| **area <= 0.0).count();
            assert_eq!(empty, following, "{cells}: every other value stands for some area");
        }
    }

    /// On flat and on curved surfaces, between fine and coarse: from both sides of an edge.
    #[test]
    fn smooth_surfaces_have_no_seams() {
        let (scene, receivers) = scene();
        let charts = Charts::new(&scene, &receivers, 200_000);
        let mut numbers = Numbers::new(5, Stream::LightRay, 0);
        let mut values: Vec<f32> = (0..charts.len()).map(|_| numbers.uniform()).collect();
        charts.spread(&mut values);
        let value = |receiver: &Receiver, edge: usize, t: f32| {
            let at = [[t, 0.0], [1.0 - t, t], [0.0, 1.0 - t]][edge];
            let shares = charts.shares(receiver.triangle, receiver.back, at).expect("a chart");
            shares.iter().map(|(value, share)| values[*value as usize] * share).sum::<f32>()
        };
        let (mut smooth, mut uneven) = (0, 0);
        for (index, edges) in neighbours(&scene, &receivers).iter().enumerate() {
            for (edge, neighbour) in edges.iter().enumerate() {
                let Some((other, other_edge)) = *neighbour else { continue };
                smooth += 1;
                let divisions = |index: usize| charts.charts[index].divisions;
                uneven += usize::from(divisions(index) != divisions(other as usize));
                for step in 0..=40 {
                    let t = step as f32 / 40.0;
                    let here = value(&receivers[index], edge, t);
                    let there = value(&receivers[other as usize], other_edge, 1.0 - t);
                    assert!((here - there).abs() < 1e-3, "{index}, edge {edge}: {here} {there}");
                }
            }
        }
        assert!(smooth > 2000 && uneven > 100, "{smooth} edges, {uneven} of them uneven");
    }

    #[test]
    fn creases_are_kept_apart() {
        let (scene, receivers) = scene();
        for (index, edges) in neighbours(&scene, &receivers).iter().enumerate() {
            for (other, _) in edges.iter().flatten() {
                let [one, other] = [index, *other as usize].map(|i| {
                    let triangle = &scene.triangles[receivers[i].triangle as usize];
                    let [a, b, c] = scene.corners(triangle);
                    ((b - a).cross(c - a).normalize(), receivers[i].back)
                });
                assert!(one.0.dot(other.0) > SMOOTH && one.1 == other.1);
            }
        }
    }
}
