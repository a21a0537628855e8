//! The lights as polygons: what they shine on a point if nothing is in between (Lambert's closed
//! form), and points on them for the rays that find out what is in between.

use super::light_tree::{Glow, LightTree};
use crate::patches::{cell_index, cells};
use crate::radiometry::{Rgb, importance};
use crate::rays::{Hit, Rays, Spot};
use crate::scene::Scene;
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// With at most so many polygons the closed form of each is evaluated; with more, the light
/// without occlusion is sampled too.
pub const MOST_EXACT: usize = 16;
/// Points of a light that are tried for one above the horizon.
pub const TRIES: u32 = 4;
/// Divisions of an emissive triangle whose texture varies: it becomes so many squared cells.
const TEXTURE_DIVISIONS: u32 = 8;
/// With more emissive triangles than so many a texture is shown by its mean over each.
const MOST_TEXTURED: usize = 4096;
/// Beyond so many times its diameter a polygon is a point: the error is below 10⁻³, and single
/// precision could not tell its edges from each other much farther away.
const FAR: f32 = 24.0;
/// Points nearer to a polygon's plane than this share of their distance don't see it.
const IN_PLANE: f32 = 1e-5;

/// An emissive polygon, triangle or convex quadrilateral, in ray units.
struct Light {
    corners: [Vec3; 4],
    /// The same by coordinates, and the edges that begin there.
    edges: Edges,
    /// 3 or 4.
    count: usize,
    center: Vec3,
    normal: Vec3,
    area: f32,
    /// Share of the area in the triangle of corners 0, 1, 2.
    first_share: f32,
    /// Square of the largest distance between corners.
    diameter_squared: f32,
    /// How far rounding may have moved its points along the normal.
    error: f32,
    radiance: Rgb,
    two_sided: bool,
}

/// The lights of a scene.
pub struct Lights {
    lights: Vec<Light>,
    /// Which of them to ask, where they are too many to ask all.
    tree: LightTree,
    /// First light of each emissive triangle, and whether its texture made it many.
    of_triangle: HashMap<u32, (u32, bool)>,
    /// Divisions of a triangle whose texture varies.
    divisions: u32,
}

/// What the lights would shine on a point with nothing in between.
#[derive(Clone, Copy)]
pub struct Unoccluded {
    /// Irradiance of all together; an estimate where there are more than [`MOST_EXACT`].
    pub irradiance: Rgb,
    /// Importance of each light's irradiance, as running sums.
    cumulative: [f32; MOST_EXACT],
}

/// A point of a light as a surface sees it.
pub struct LightPoint {
    /// Where rays to it end.
    pub end: Vec3,
    /// Irradiance that it stands for: its mean over random points is the irradiance of all lights
    /// without occlusion.
    pub irradiance: Rgb,
    /// Density per solid angle at which it was picked.
    pub density: f32,
}

impl Lights {
    /// The lights of a scene; `None` without any.
    pub fn new(scene: &Scene, rays: &Rays) -> Option<Self> {
        let many = scene.emissive_triangles() > MOST_TEXTURED;
        let divisions = if many { 1 } else { TEXTURE_DIVISIONS };
        let mut lights = Vec::new();
        let mut of_triangle = HashMap::new();
        let mut plain: Vec<(u32, [Vec3; 3], Rgb, bool)> = Vec::new();
        for (index, triangle) in scene.triangles.iter().enumerate() {
            let material = &scene.materials[triangle.material as usize];
            if !material.emits() {
                continue;
            }
            let (corners, area) = rays.corners(scene, index as u32);
            if area.is_nan() || area <= 0.0 {
                continue;
            }
            let two_sided = material.double_sided;
            if material.emission_texture.is_none() {
                plain.push((index as u32, corners, material.emission, two_sided));
                continue;
            }
            of_triangle.insert(index as u32, (lights.len() as u32, true));
            for cell in cells(divisions) {
                let inside: Vec<Vec2> = cells(4)
                    .map(|[a, b, c]| {
                        let at = (a + b + c) / 3.0;
                        cell[0] * (1.0 - at.x - at.y) + cell[1] * at.x + cell[2] * at.y
                    })
                    .collect();
                let sum: Rgb = inside.iter().map(|at| scene.emission(triangle, at.x, at.y)).sum();
                let radiance = sum / inside.len() as f32;
                let place = |at: Vec2| {
                    corners[0] * (1.0 - at.x - at.y) + corners[1] * at.x + corners[2] * at.y
                };
                // A cell without area would be out of step with the cells of the texture.
                let light = Light::new(&cell.map(place), radiance, two_sided);
                lights.push(light.unwrap_or_else(Light::none));
            }
        }
        merged(&plain, &mut lights, &mut of_triangle);
        let total: f64 = lights.iter().map(|light| f64::from(light.power())).sum();
        if total.is_nan() || total <= 0.0 || total.is_infinite() {
            return None;
        }
        let tree = LightTree::new(&lights.iter().map(Light::glow).collect::<Vec<_>>());
        Some(Self { lights, tree, of_triangle, divisions })
    }

    /// Number of polygons.
    pub fn count(&self) -> usize {
        self.lights.len()
    }

    /// Whether the light without occlusion is known in closed form.
    pub fn is_exact(&self) -> bool {
        self.lights.len() <= MOST_EXACT
    }

    /// What all lights shine on a surface at `point` with unit `normal` where nothing is in
    /// between; zero irradiance where it has to be sampled.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> Unoccluded {
        let mut all = Unoccluded { irradiance: Rgb::ZERO, cumulative: [0.0; MOST_EXACT] };
        if self.is_exact() {
            let mut sum = 0.0;
            for (light, cumulative) in self.lights.iter().zip(&mut all.cumulative) {
                let irradiance = light.radiance * light.projected(point, normal);
                all.irradiance += irradiance;
                sum += importance(irradiance);
                *cumulative = sum;
            }
        }
        all
    }

    /// A point of the lights for three uniform numbers, as a surface at `point` sees it: picked by
    /// what each shines on it, or may shine where they are many. `None` where it shines nothing.
    pub fn sample(
        &self,
        unoccluded: &Unoccluded,
        point: Vec3,
        normal: Vec3,
        xi: Vec3,
    ) -> Option<LightPoint> {
        let (pick, probability) = self.pick(unoccluded, point, normal, xi.x)?;
        let light = &self.lights[pick];
        let place = light.place(xi.y, xi.z);
        let between = place - point;
        let square = between.length_squared();
        let cosine = normal.dot(between);
        let mut other = -light.normal.dot(between);
        let side = 1f32.copysign(other);
        if light.two_sided {
            other = other.abs();
        }
        if cosine <= 0.0 || other <= 0.0 || probability <= 0.0 {
            return None;
        }
        let factor = cosine * other / (square * square) * light.area / probability;
        Some(LightPoint {
            end: place + light.normal * (side * light.error),
            irradiance: light.radiance * factor,
            density: probability * square * square.sqrt() / (light.area * other),
        })
    }

    fn pick(
        &self,
        unoccluded: &Unoccluded,
        point: Vec3,
        normal: Vec3,
        x: f32,
    ) -> Option<(usize, f32)> {
        if !self.is_exact() {
            return self.tree.pick(point, normal, x);
        }
        let cumulative = &unoccluded.cumulative[..self.count()];
        let total = cumulative[cumulative.len() - 1];
        if total <= 0.0 {
            return None;
        }
        let at = x * total;
        let pick = cumulative.partition_point(|sum| *sum <= at).min(cumulative.len() - 1);
        let before = if pick == 0 { 0.0 } else { cumulative[pick - 1] };
        Some((pick, (cumulative[pick] - before) / total))
    }

    /// One of many lights: where a shadow ray to it ends, and its irradiance in closed form over
    /// the probability that it was picked, which has no singularity near the light. `None` where
    /// it shines nothing.
    pub fn one_of_many(&self, point: Vec3, normal: Vec3, xi: Vec3) -> Option<(Vec3, Rgb)> {
        let (pick, probability) = self.tree.pick(point, normal, xi.x)?;
        let light = &self.lights[pick];
        let projected = light.projected(point, normal);
        if projected <= 0.0 || probability <= 0.0 {
            return None;
        }
        let height = |place: &Vec3| normal.dot(*place - point);
        let above = |tries: u32| {
            let [y, z] = [(xi.y, 0.671_043_6), (xi.z, 0.549_700_5)]
                .map(|(x, step): (f32, f32)| (x + step * tries as f32).fract());
            Some(light.place(y, z)).filter(|place| height(place) > 0.0)
        };
        let place = (0..TRIES).find_map(above).or_else(|| {
            let corners = light.corners[..light.count].iter();
            corners.copied().max_by(|a, b| height(a).total_cmp(&height(b)))
        })?;
        let side = 1f32.copysign(light.normal.dot(point - place));
        let end = place + light.normal * (side * light.error);
        Some((end, light.radiance * (projected / probability)))
    }

    /// The direct light on a surface by one shadow ray: without noise where all or nothing of the
    /// only light is seen.
    pub fn once(&self, rays: &Rays, point: Vec3, normal: Vec3, xi: Vec3) -> Rgb {
        if !self.is_exact() {
            return match self.one_of_many(point, normal, xi) {
                Some((end, irradiance)) if !rays.blocked(point, end, |_| false) => irradiance,
                _ => Rgb::ZERO,
            };
        }
        let unoccluded = self.unoccluded(point, normal);
        if unoccluded.irradiance == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let sample = |tries: u32| {
            let xi = (xi + Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * tries as f32).fract();
            self.sample(&unoccluded, point, normal, xi)
        };
        match (0..TRIES).find_map(sample) {
            Some(light) if !rays.blocked(point, light.end, |_| false) => unoccluded.irradiance,
            _ => Rgb::ZERO,
        }
    }

    /// Density per solid angle at which [`Lights::sample`] picks the place of a light that a ray
    /// along the unit `direction` from the surface met; `normal` is the light's there.
    pub fn density(
        &self,
        unoccluded: &Unoccluded,
        (start, start_normal): (Vec3, Vec3),
        hit: &Hit,
        normal: Vec3,
        direction: Vec3,
    ) -> f32 {
        let Some((first, textured)) = self.of_triangle.get(&hit.triangle) else { return 0.0 };
        let cell = if *textured { cell_index(self.divisions, hit.u, hit.v) } else { 0 };
        let pick = (first + cell) as usize;
        let probability = if self.is_exact() {
            let cumulative = &unoccluded.cumulative[..self.count()];
            let total = cumulative[cumulative.len() - 1];
            if total <= 0.0 {
                return 0.0;
            }
            let before = if pick == 0 { 0.0 } else { cumulative[pick - 1] };
            (cumulative[pick] - before) / total
        } else {
            self.tree.probability(pick, start, start_normal)
        };
        let cosine = normal.dot(direction).abs().max(f32::MIN_POSITIVE);
        probability * hit.distance * hit.distance / (self.lights[pick].area * cosine)
    }
}

impl Light {
    fn new(corners: &[Vec3], radiance: Rgb, two_sided: bool) -> Option<Self> {
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        let first = 0.5 * (b - a).cross(c - a).length();
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let second = match corners.get(3) {
            Some(d) => 0.5 * (c - a).cross(*d - a).length(),
            None => 0.0,
        };
        let area = first + second;
        if normal == Vec3::ZERO || area <= 0.0 {
            return None;
        }
        let mut all = [a, b, c, a];
        all[..corners.len()].copy_from_slice(corners);
        let count = corners.len();
        let center = all[..count].iter().sum::<Vec3>() / count as f32;
        let pairs = (0..count).flat_map(|i| (0..i).map(move |j| (i, j)));
        let diameter_squared =
            pairs.map(|(i, j)| all[i].distance_squared(all[j])).fold(0.0, f32::max);
        let error = Spot::new([a, b, c], normal, 0.3, 0.3).error;
        let first_share = first / area;
        Some(Self {
            corners: all,
            edges: Edges::new(&all),
            count,
            center,
            normal,
            area,
            first_share,
            diameter_squared,
            error,
            radiance,
            two_sided,
        })
    }

    /// A light that doesn't shine.
    fn none() -> Self {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::ZERO];
        Self {
            corners,
            edges: Edges::new(&corners),
            count: 3,
            center: Vec3::ZERO,
            normal: Vec3::Y,
            area: 0.5,
            first_share: 1.0,
            diameter_squared: 2.0,
            error: 0.0,
            radiance: Rgb::ZERO,
            two_sided: false,
        }
    }

    fn glow(&self) -> Glow {
        let corners = self.corners[..self.count].iter();
        Glow {
            center: self.center,
            radius: corners.map(|corner| corner.distance(self.center)).fold(0.0, f32::max),
            power: importance(self.radiance) * self.area,
            normal: self.normal,
            two_sided: self.two_sided,
        }
    }

    fn power(&self) -> f32 {
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        importance(self.radiance) * self.area * sides
    }

    /// ∫ cosθ dω over the polygon as a surface at `point` sees it.
    fn projected(&self, point: Vec3, normal: Vec3) -> f32 {
        let to_center = self.center - point;
        let square = to_center.length_squared();
        let height = -self.normal.dot(to_center);
        if height.abs() <= IN_PLANE * square.sqrt() || (height < 0.0 && !self.two_sided) {
            return 0.0;
        }
        let corners = self.edges.corners.map_from(point);
        let heights = corners.dot(&Vec3x4::splat(normal));
        let (lowest, highest) = (heights.min_element(), heights.max_element());
        if highest <= 0.0 {
            return 0.0;
        }
        if square > FAR * FAR * self.diameter_squared && lowest > 0.0 {
            return self.area * height.abs() * normal.dot(to_center) / (square * square);
        }
        if lowest > 0.0 {
            return self.edges.projected(&corners, normal);
        }
        let mut seen = [Vec3::ZERO; 6];
        let mut count = 0;
        for k in 0..self.count {
            let next = (k + 1) % self.count;
            let (a, b) = (self.corners[k] - point, self.corners[next] - point);
            let (ha, hb) = (heights[k], heights[next]);
            if ha >= 0.0 {
                seen[count] = a;
                count += 1;
            }
            if (ha < 0.0) != (hb < 0.0) {
                seen[count] = a + (b - a) * (ha / (ha - hb));
                count += 1;
            }
        }
        let mut sum = 0.0;
        for k in 0..count {
            let (a, b) = (seen[k], seen[(k + 1) % count]);
            // a × b, which cancels less this way.
            let cross = a.cross(b - a);
            let sine = cross.length();
            if sine > 0.0 {
                let angle = angle(Vec4::splat(sine), Vec4::splat(a.dot(b))).x;
                sum += angle * cross.dot(normal) / sine;
            }
        }
        0.5 * sum.abs()
    }

    /// The point for two uniform numbers: uniform over the area.
    fn place(&self, x: f32, y: f32) -> Vec3 {
        let [a, b, c, d] = self.corners;
        let (x, b, c) = if x < self.first_share {
            (x / self.first_share, b, c)
        } else {
            ((x - self.first_share) / (1.0 - self.first_share), c, d)
        };
        let root = x.clamp(0.0, 1.0).sqrt();
        a * (1.0 - root) + b * (root * (1.0 - y)) + c * (root * y)
    }
}

/// Four vectors by coordinates.
struct Vec3x4 {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl Vec3x4 {
    fn new(all: &[Vec3; 4]) -> Self {
        let by = |axis: usize| Vec4::from_array(all.map(|v| v[axis]));
        Self { x: by(0), y: by(1), z: by(2) }
    }

    #[inline]
    fn splat(v: Vec3) -> Self {
        Self { x: Vec4::splat(v.x), y: Vec4::splat(v.y), z: Vec4::splat(v.z) }
    }

    /// The vectors from `origin`.
    #[inline]
    fn map_from(&self, origin: Vec3) -> Self {
        let origin = Self::splat(origin);
        Self { x: self.x - origin.x, y: self.y - origin.y, z: self.z - origin.z }
    }

    #[inline]
    fn dot(&self, other: &Self) -> Vec4 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline]
    fn cross(&self, other: &Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }
}

/// The edges of a polygon, four at a time; a triangle's fourth has no length.
struct Edges {
    corners: Vec3x4,
    edges: Vec3x4,
}

impl Edges {
    fn new(corners: &[Vec3; 4]) -> Self {
        let edge = |k: usize| corners[(k + 1) % 4] - corners[k];
        let edges = Vec3x4::new(&std::array::from_fn(edge));
        Self { corners: Vec3x4::new(corners), edges }
    }

    /// Lambert's formula, ½ |Σ Γ (a × b)·n / |a × b||, for corners `a` that are all above the
    /// horizon, as seen from the surface.
    #[inline]
    fn projected(&self, a: &Vec3x4, normal: Vec3) -> f32 {
        // a × b = a × (b − a), which cancels less.
        let cross = a.cross(&self.edges);
        let square = cross.dot(&cross);
        let sine = Vec4::from_array(square.to_array().map(f32::sqrt));
        let cosine = a.dot(a) + a.dot(&self.edges);
        let along = cross.dot(&Vec3x4::splat(normal)) / sine;
        let each = angle(sine, cosine) * along;
        let each = Vec4::select(sine.cmpgt(Vec4::ZERO), each, Vec4::ZERO);
        0.5 * each.element_sum().abs()
    }
}

/// atan2(sine, cosine) for sine ≥ 0, to 10⁻⁶ (Abramowitz and Stegun 4.4.49 for the inner range).
#[inline]
fn angle(sine: Vec4, cosine: Vec4) -> Vec4 {
    const SERIES: [f32; 7] = [
        -0.016_165_737,
        0.042_909_614,
        -0.075_289_64,
        0.106_562_64,
        -0.142_089,
        0.199_935_51,
        -0.333_331_45,
    ];
    let (low, high) = (sine.min(cosine.abs()), sine.max(cosine.abs()));
    let x = low / high;
    let s = x * x;
    let series = SERIES.iter().fold(Vec4::splat(0.002_866_225_7), |sum, c| sum * s + *c);
    let inner = x + x * s * series;
    let outer = Vec4::splat(std::f32::consts::FRAC_PI_2) - inner;
    let first = Vec4::select(sine.cmpgt(cosine.abs()), outer, inner);
    let obtuse = cosine.cmplt(Vec4::ZERO);
    Vec4::select(obtuse, Vec4::splat(std::f32::consts::PI) - first, first)
}

/// Polygons from emissive triangles: pairs with a common edge in one plane become one where that
/// is convex, which halves the edges to sum over.
fn merged(
    triangles: &[(u32, [Vec3; 3], Rgb, bool)],
    lights: &mut Vec<Light>,
    of_triangle: &mut HashMap<u32, (u32, bool)>,
) {
    let key = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
    let mut at_edge: HashMap<([u32; 3], [u32; 3]), usize> = HashMap::new();
    for (index, (_, corners, ..)) in triangles.iter().enumerate() {
        for k in 0..3 {
            at_edge.insert((key(corners[k]), key(corners[(k + 1) % 3])), index);
        }
    }
    let mut used = vec![false; triangles.len()];
    for (index, (triangle, corners, radiance, two_sided)) in triangles.iter().enumerate() {
        if used[index] {
            continue;
        }
        used[index] = true;
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let pair = (0..3).find_map(|k| {
            let (p, q) = (corners[k], corners[(k + 1) % 3]);
            let other = *at_edge.get(&(key(q), key(p)))?;
            let (_, theirs, shine, sides) = &triangles[other];
            if used[other] || shine != radiance || sides != two_sided {
                return None;
            }
            let apex = theirs.iter().copied().find(|c| key(*c) != key(p) && key(*c) != key(q))?;
            let opposite = corners[(k + 2) % 3];
            // p, apex, q, opposite goes round; it must be flat and turn left everywhere.
            let around = [p, apex, q, opposite];
            let flat = normal.dot(apex - p).abs() <= 1e-5 * (apex - p).length();
            let convex = (0..4).all(|i| {
                let (a, b, c) = (around[i], around[(i + 1) % 4], around[(i + 2) % 4]);
                (b - a).cross(c - b).dot(normal) > 0.0
            });
            (flat && convex).then_some((other, around))
        });
        let number = (lights.len() as u32, false);
        of_triangle.insert(*triangle, number);
        let light = match pair {
            Some((other, around)) => {
                used[other] = true;
                of_triangle.insert(triangles[other].0, number);
                Light::new(&around, *radiance, *two_sided)
            }
            None => Light::new(corners, *radiance, *two_sided),
        };
        lights.push(light.unwrap_or_else(Light::none));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factors::{Polygon, point_to_polygon};

    #[test]
    fn projected_agrees_with_the_exact_form_factor() {
        let corners = [
            Vec3::new(1.0, 3.0, -1.0),
            Vec3::new(3.0, 3.0, -1.0),
            Vec3::new(3.0, 3.0, 2.0),
            Vec3::new(1.0, 3.0, 2.0),
        ];
        let light = Light::new(&corners, Rgb::ONE, false).unwrap();
        let polygon = Polygon::new(corners.map(|c| c.as_dvec3()).to_vec()).unwrap();
        for (point, normal) in [
            (Vec3::ZERO, Vec3::Y),
            (Vec3::new(2.0, 2.9, 0.0), Vec3::Y),
            (Vec3::new(4.0, 1.0, 3.0), Vec3::new(-0.6, 0.0, -0.8)),
            (Vec3::new(0.0, 2.0, 0.0), Vec3::X),
            (Vec3::new(2.0, 0.0, 0.5), Vec3::NEG_Y),
            (Vec3::new(90.0, -50.0, 5.0), Vec3::new(-0.8, 0.6, 0.0)),
        ] {
            let exact = std::f64::consts::PI
                * point_to_polygon(point.as_dvec3(), normal.as_dvec3(), &polygon);
            let ours = f64::from(light.projected(point, normal));
            assert!((ours - exact).abs() < 2e-3 * exact + 1e-7, "{point}: {ours} {exact}");
        }
        // From behind nothing.
        assert_eq!(light.projected(Vec3::new(2.0, 4.0, 0.0), Vec3::NEG_Y), 0.0);
    }

    #[test]
    fn angles_are_those_of_atan2() {
        for step in 0..=1000 {
            let at = step as f32 / 1000.0 * std::f32::consts::PI;
            let found = angle(Vec4::splat(at.sin().max(0.0)), Vec4::splat(at.cos())).x;
            assert!((found - at).abs() < 3e-6, "{at}");
        }
    }
}
