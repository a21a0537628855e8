//! Which side of a surface light meets, and how it lies.

use glam::Vec3;

/// How the side of a surface lies that light meets.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// Unit geometric normal of that side.
    pub normal: Vec3,
    /// Unit shading normal of that side.
    pub shading_normal: Vec3,
    /// Whether it is the back.
    pub back: bool,
}

impl Side {
    /// The mirror direction of the unit vector `viewer` about the shading normal.
    #[inline]
    pub fn mirrored(&self, viewer: Vec3) -> Vec3 {
        2.0 * self.shading_normal.dot(viewer) * self.shading_normal - viewer
    }

    /// The change of power, beside what is absorbed, of light that comes from `source` and goes on
    /// in `direction`: radiance is kept, but where the shading normal n_s is not the geometric n_g,
    /// power is not, |ω_o·n_g| |ω_i·n_s| / (|ω_i·n_g| |ω_o·n_s|) (Veach 1997, §5.3).
    pub fn power_factor(&self, direction: Vec3, source: Vec3) -> f32 {
        let along = |direction: Vec3| {
            let shading = self.shading_normal.dot(direction).abs();
            self.normal.dot(direction).abs() / shading.max(f32::MIN_POSITIVE)
        };
        along(direction) / along(source)
    }

    /// Irradiance as the shading normal has it over that of the geometric normal, of light from
    /// `source`: what power that falls on the surface counts for its diffuse reflection.
    pub fn irradiance_factor(&self, source: Vec3) -> f32 {
        let [shading, geometric] = [self.shading_normal, self.normal].map(|n| n.dot(source));
        shading.max(0.0) / geometric.abs().max(f32::MIN_POSITIVE)
    }
}
