//! Tangent frames.

use glam::Vec3;

/// Unit tangent and bitangent to a unit normal, turned by `azimuth` radians (Duff et al. 2017).
pub fn frame(normal: Vec3, azimuth: f32) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    let t = Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x);
    let s = Vec3::new(b, sign + normal.y * normal.y * a, -normal.y);
    let (sin, cos) = azimuth.sin_cos();
    (t * cos + s * sin, s * cos - t * sin)
}
