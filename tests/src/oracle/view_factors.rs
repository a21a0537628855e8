//! View factors without occlusion by three routes that share nothing: closed forms, Lambert's
//! point-to-polygon formula averaged over the sender, and the contour integral.

use super::quadrature::Rule;
use glam::DVec3;
use std::f64::consts::PI;

/// F between two directly opposed parallel rectangles a × b at distance `gap` (Howell C-11).
pub fn parallel_rectangles(a: f64, b: f64, gap: f64) -> f64 {
    let (x, y) = (a / gap, b / gap);
    let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let sum = 0.5 * ((1.0 + x * x) * (1.0 + y * y) / (1.0 + x * x + y * y)).ln()
        + x * ry * (x / ry).atan()
        + y * rx * (y / rx).atan()
        - x * x.atan()
        - y * y.atan();
    2.0 / (PI * x * y) * sum
}

/// F from a rectangle `width` × `common` to a perpendicular one `height` × `common` that shares
/// the edge of length `common` (Howell C-14).
pub fn perpendicular_rectangles(common: f64, width: f64, height: f64) -> f64 {
    let (h, w) = (height / common, width / common);
    let (h2, w2) = (h * h, w * w);
    let both = h2 + w2;
    let logarithms = ((1.0 + w2) * (1.0 + h2) / (1.0 + both)).ln()
        + w2 * (w2 * (1.0 + both) / ((1.0 + w2) * both)).ln()
        + h2 * (h2 * (1.0 + both) / ((1.0 + h2) * both)).ln();
    let angles =
        w * (1.0 / w).atan() + h * (1.0 / h).atan() - both.sqrt() * (1.0 / both.sqrt()).atan();
    (angles + 0.25 * logarithms) / (PI * w)
}

/// F from a rectangle to a strip of a perpendicular one, `low` to `high` above the common edge,
/// by the additivity of receivers.
pub fn perpendicular_strip(common: f64, width: f64, low: f64, high: f64) -> f64 {
    perpendicular_rectangles(common, width, high) - perpendicular_rectangles(common, width, low)
}

/// Area of a flat polygon and its unit normal, on the side from which it turns left.
pub fn area_and_normal(polygon: &[DVec3]) -> (f64, DVec3) {
    let origin = polygon[0];
    let twice: DVec3 =
        polygon[1..].windows(2).map(|edge| (edge[0] - origin).cross(edge[1] - origin)).sum();
    (0.5 * twice.length(), twice.normalize())
}

/// The part of a polygon that lies above the plane through `point` with the given normal.
fn above(polygon: &[DVec3], point: DVec3, normal: DVec3) -> Vec<DVec3> {
    let height = |p: DVec3| (p - point).dot(normal);
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (index, &a) in polygon.iter().enumerate() {
        let b = polygon[(index + 1) % polygon.len()];
        let (ha, hb) = (height(a), height(b));
        if ha >= 0.0 {
            kept.push(a);
        }
        if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
            kept.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    kept
}

/// Lambert's formula: F from a surface element at `point` to a polygon of which it sees the
/// front, (1/2π) Σ Γ_k·n over the edges. Zero from behind the polygon; what lies below the
/// element's horizon is cut off.
pub fn point_to_polygon(point: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let (_, facing) = area_and_normal(polygon);
    if (point - polygon[0]).dot(facing) <= 0.0 {
        return 0.0;
    }
    let polygon = above(polygon, point, normal);
    if polygon.len() < 3 {
        return 0.0;
    }
    let sum: f64 = (0..polygon.len())
        .map(|k| {
            let a = polygon[k] - point;
            let b = polygon[(k + 1) % polygon.len()] - point;
            let cross = a.cross(b);
            let sine = cross.length();
            // The angle by atan2: acos loses half the digits of small ones.
            if sine == 0.0 { 0.0 } else { sine.atan2(a.dot(b)) * cross.dot(normal) / sine }
        })
        .sum();
    // Seen from the front a polygon turns left, so from the element it turns right.
    (-sum / (2.0 * PI)).max(0.0)
}

/// F between two flat convex polygons: [`point_to_polygon`] averaged over the sender, which is
/// cut into triangles and graded towards all their edges.
pub fn by_lambert(sender: &[DVec3], receiver: &[DVec3], rule: &Rule) -> f64 {
    let (area, normal) = area_and_normal(sender);
    let origin = sender[0];
    let mut sum = 0.0;
    for edge in sender[1..].windows(2) {
        let [a, b] = [edge[0] - origin, edge[1] - origin];
        let double = a.cross(b).length();
        // The unit square onto the triangle: (s, t) → s·((1−t)·a + t·b), Jacobian s.
        sum += double
            * rule.integrate(|s| {
                s * rule.integrate(|t| {
                    let at = origin + s * ((1.0 - t) * a + t * b);
                    point_to_polygon(at, normal, receiver)
                })
            });
    }
    sum / area
}

/// ∫ ln|x − p| ds along the segment from a to b, in closed form, also where p lies on it.
fn logarithm_along(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let length = a.distance(b);
    let along = (b - a) / length;
    let from = (a - p).dot(along);
    let distance = ((a - p) - from * along).length();
    let primitive = |u: f64| {
        let square = u * u + distance * distance;
        let logarithm = if square > 0.0 { 0.5 * u * square.ln() } else { 0.0 };
        let angle = if distance > 0.0 { distance * (u / distance).atan() } else { 0.0 };
        logarithm - u + angle
    };
    primitive(from + length) - primitive(from)
}

/// F between two flat polygons that see each other whole, by Stokes' theorem:
/// F = (1/2πA) ∮∮ ln r dx·dx'. The inner integral is in closed form, so the logarithm of a shared
/// edge or corner is integrated exactly along it; the outer one needs a graded `rule` there.
pub fn by_contour(sender: &[DVec3], receiver: &[DVec3], rule: &Rule) -> f64 {
    let (area, _) = area_and_normal(sender);
    let edges = |polygon: &[DVec3]| -> Vec<(DVec3, DVec3)> {
        (0..polygon.len()).map(|k| (polygon[k], polygon[(k + 1) % polygon.len()])).collect()
    };
    let mut sum = 0.0;
    for (a, b) in edges(sender) {
        for (c, d) in edges(receiver) {
            let cosine = (b - a).dot((d - c).normalize());
            if cosine != 0.0 {
                sum += cosine * rule.integrate(|t| logarithm_along(a + t * (b - a), c, d));
            }
        }
    }
    sum / (2.0 * PI * area)
}
