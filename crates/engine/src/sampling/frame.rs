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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_right_handed_and_orthonormal() {
        for normal in [Vec3::Z, Vec3::NEG_Z, Vec3::new(1.0, -2.0, 0.3).normalize()] {
            let (t, b) = frame(normal, 1.234);
            assert!((t.cross(b) - normal).length() < 1e-6);
            assert!((t.length() - 1.0).abs() < 1e-6 && t.dot(b).abs() < 1e-6);
        }
    }
}
