//! A polygon light: an emissive triangle or convex quadrilateral, its irradiance in closed form
//! (Lambert 1760), and points of it sampled by area or by solid angle.

use super::light_tree::LightBounds;
use crate::angles::{angle_of, angles_of};
use crate::radiometry::{Rgb, importance};
use crate::rays::Spot;
use glam::{Vec3, Vec4};

/// Distance, in diameters, beyond which a polygon is evaluated as a point: the error is below 10⁻³,
/// and much farther away single precision could not tell its edges apart.
const POINT_LIKE: f32 = 24.0;
/// Distance, in diameters, within which points are picked by solid angle.
const NEAR: f32 = 2.0;
/// A polygon shines nothing on points that are nearer to its plane than this share of their
/// distance: rounding could not tell on which side they are.
const IN_PLANE: f32 = 1e-5;

/// An emissive polygon, triangle or convex quadrilateral, in ray units.
pub struct PolygonLight {
    /// Corners, counter-clockwise as seen from the front; a triangle's fourth is its first again.
    pub corners: [Vec3; 4],
    /// The corners by coordinates, and the edges that begin there.
    edges: Edges,
    /// Number of corners, 3 or 4.
    pub count: usize,
    /// Mean of the corners.
    pub center: Vec3,
    /// Unit normal of the front.
    pub normal: Vec3,
    /// Area, square ray units.
    pub area: f32,
    /// Share of the area in the triangle of corners 0, 1, 2.
    first_share: f32,
    /// Square of the largest distance between corners.
    pub diameter_squared: f32,
    /// How far rounding may have moved its points along the normal.
    pub error: f32,
    /// Emitted radiance, the same everywhere on it.
    pub radiance: Rgb,
    /// Whether the back shines too.
    pub two_sided: bool,
}

impl PolygonLight {
    /// A light of three or four corners in one plane; `None` without area.
    pub fn new(corners: &[Vec3], radiance: Rgb, two_sided: bool) -> Option<Self> {
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

    /// A light that shines nothing, in place of one without area: it keeps numbers in step.
    pub fn dark() -> Self {
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

    /// Quadrature points with areas as weights: the 2 × 2 Gauss points of a quadrilateral; of a
    /// triangle the three points halfway between corners and centre, and one without weight.
    pub fn quadrature(&self) -> [(Vec3, f32); 4] {
        let [a, b, c, d] = self.corners;
        if self.count == 3 {
            let third = self.area / 3.0;
            let near = |p: Vec3| 0.5 * p + 0.5 * self.center;
            return [(near(a), third), (near(b), third), (near(c), third), (near(a), 0.0)];
        }
        let [low, high] = [-1.0, 1.0].map(|sign: f32| 0.5 + sign * 0.5 / 3f32.sqrt());
        [[low, low], [high, low], [low, high], [high, high]].map(|[x, y]| {
            let place = a * ((1.0 - x) * (1.0 - y))
                + b * (x * (1.0 - y))
                + c * (x * y)
                + d * ((1.0 - x) * y);
            let across = (b - a) * (1.0 - y) + (c - d) * y;
            let along = (d - a) * (1.0 - x) + (c - b) * x;
            (place, 0.25 * across.cross(along).length())
        })
    }

    /// Bounds for the light tree.
    pub fn bounds(&self) -> LightBounds {
        let corners = self.corners[..self.count].iter();
        LightBounds {
            center: self.center,
            radius: corners.map(|corner| corner.distance(self.center)).fold(0.0, f32::max),
            power: importance(self.radiance) * self.area,
            normal: self.normal,
            two_sided: self.two_sided,
        }
    }

    /// Power of all sides, as one number, over π.
    pub fn power(&self) -> f32 {
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        importance(self.radiance) * self.area * sides
    }

    /// Projected solid angle ∫ cosθ dω of the polygon at `point` with unit `normal`: its irradiance
    /// over its radiance.
    pub fn projected(&self, point: Vec3, normal: Vec3) -> f32 {
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
        if square > POINT_LIKE * POINT_LIKE * self.diameter_squared && lowest > 0.0 {
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
                let angle = angle_of(sine, a.dot(b));
                sum += angle * cross.dot(normal) / sine;
            }
        }
        0.5 * sum.abs()
    }

    /// Whether the light is so near to a point that its points are to be picked by solid angle: by
    /// area, they would count as one over the square of their distance.
    pub fn is_near(&self, point: Vec3) -> bool {
        self.center.distance_squared(point) < NEAR * NEAR * self.diameter_squared
    }

    fn spherical(&self, point: Vec3) -> [SphericalTriangle; 2] {
        let [a, b, c, d] = self.corners;
        [[a, b, c], [a, c, d]].map(|corners| SphericalTriangle::new(corners, point))
    }

    /// Solid angle as seen from a point.
    pub fn solid_angle(&self, point: Vec3) -> f32 {
        self.spherical(point).iter().map(|half| half.solid_angle).sum()
    }

    /// The point for two uniform numbers, uniform over the solid angle, and the solid angle; `None`
    /// where rounding leaves none of it.
    pub fn point_by_solid_angle(&self, point: Vec3, x: f32, y: f32) -> Option<(Vec3, f32)> {
        let [first, second] = self.spherical(point);
        let all = first.solid_angle + second.solid_angle;
        let at = x * all;
        let direction = if at < first.solid_angle {
            first.direction(at / first.solid_angle, y)
        } else {
            second.direction((at - first.solid_angle) / second.solid_angle, y)
        };
        let distance = self.normal.dot(self.corners[0] - point) / self.normal.dot(direction);
        let farthest = 2.0 * (self.center.distance(point) + self.diameter_squared.sqrt());
        (distance > 0.0 && distance < farthest && all > 0.0)
            .then(|| (point + direction * distance, all))
    }

    /// The point for two uniform numbers: uniform over the area.
    pub fn point_by_area(&self, x: f32, y: f32) -> Vec3 {
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

/// A triangle as seen from a point: a spherical triangle.
struct SphericalTriangle {
    /// Unit vectors to the corners.
    corners: [Vec3; 3],
    solid_angle: f32,
}

impl SphericalTriangle {
    fn new(corners: [Vec3; 3], point: Vec3) -> Self {
        let corners = corners.map(|corner| (corner - point).normalize_or_zero());
        let [a, b, c] = corners;
        // Van Oosterom and Strackee 1983.
        let volume = a.dot(b.cross(c)).abs();
        let solid_angle = 2.0 * volume.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        Self { corners, solid_angle }
    }

    /// The direction for two uniform numbers: uniform over the solid angle (Arvo 1995).
    fn direction(&self, x: f32, y: f32) -> Vec3 {
        let [a, b, c] = self.corners;
        let (to_b, to_c) = (a.cross(b), a.cross(c));
        let alpha = a.dot(b.cross(c)).abs().atan2(to_b.dot(to_c));
        let (sine, cosine) = alpha.sin_cos();
        // The triangle a, b, p of the share x of the area has its p on the edge from a to c.
        let (s, t) = (x * self.solid_angle - alpha).sin_cos();
        let (u, v) = (t - cosine, s + sine * a.dot(b));
        let along = ((v * t - u * s) * cosine - v) / ((v * s + u * t) * sine);
        let along = if along.is_finite() { along.clamp(-1.0, 1.0) } else { 1.0 };
        let off = |from: Vec3, to: Vec3| (to - from * to.dot(from)).normalize_or_zero();
        let p = a * along + off(a, c) * (1.0 - along * along).sqrt();
        let height = 1.0 - y * (1.0 - p.dot(b));
        b * height + off(b, p) * (1.0 - height * height).max(0.0).sqrt()
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
        let each = angles_of(sine, cosine) * along;
        let each = Vec4::select(sine.cmpgt(Vec4::ZERO), each, Vec4::ZERO);
        0.5 * each.element_sum().abs()
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
        let light = PolygonLight::new(&corners, Rgb::ONE, false).unwrap();
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

    /// Places picked by solid angle are on the light, and their mean cosine is the closed form's.
    #[test]
    fn places_by_angle_are_uniform_over_the_solid_angle() {
        let corners = [
            Vec3::new(1.0, 1.0, -1.0),
            Vec3::new(3.0, 1.0, -1.0),
            Vec3::new(2.7, 1.0, 2.0),
            Vec3::new(1.2, 1.0, 1.5),
        ];
        for corners in [&corners[..], &corners[..3]] {
            let light = PolygonLight::new(corners, Rgb::ONE, true).unwrap();
            for point in [Vec3::ZERO, Vec3::new(2.0, 0.5, 0.0), Vec3::new(-2.0, 1.2, 3.0)] {
                let normal = (light.center - point).normalize();
                const SIDE: usize = 200;
                let mut sum = 0.0f64;
                for k in 0..SIDE * SIDE {
                    let [x, y] = [k % SIDE, k / SIDE].map(|k| (k as f32 + 0.5) / SIDE as f32);
                    let (place, solid_angle) = light.point_by_solid_angle(point, x, y).unwrap();
                    assert!((place.y - 1.0).abs() < 1e-4, "{place}");
                    let cosine = normal.dot((place - point).normalize()).max(0.0);
                    sum += f64::from(cosine * solid_angle);
                    assert!((solid_angle - light.solid_angle(point)).abs() < 1e-6);
                }
                let mean = sum / (SIDE * SIDE) as f64;
                let exact = f64::from(light.projected(point, normal));
                assert!((mean / exact - 1.0).abs() < 2e-3, "{point}: {mean} {exact}");
            }
        }
    }
}
