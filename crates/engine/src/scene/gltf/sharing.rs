//! Meshes that are kept once for all instances that show them ([`crate::scene::instances`]), where that
//! pays.

use super::limits::{ImportLimits, MAX_COORDINATE};
use super::local::Local;
use super::placing::{MIN_AREA, MIN_AREA_RATIO, Placing};
use crate::scene::instances::{INSTANCE_TRIANGLES, Instances, MOST_INSTANCED_TRIANGLES};
use crate::scene::{Scene, SceneError};
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};

/// Meshes of fewer triangles are copied: an instance takes as much as [`INSTANCE_TRIANGLES`] of them,
/// and finding its triangles takes time.
const LEAST_TRIANGLES: u64 = 8;

/// What a file shows, counted before any of it is read.
#[derive(Clone, Copy, Default)]
pub(super) struct Counts {
    /// Triangles with all instances.
    pub total: u64,
    /// Triangles that are kept where all is copied that may be shared.
    pub kept: u64,
    /// Those that sharing saves of them.
    pub saved: u64,
}

impl Counts {
    /// Adds a primitive of so many triangles in one shape, which so many instances show by their
    /// transform alone and so many by their joints.
    pub fn add(&mut self, triangles: u64, rigid: u64, skinned: u64) {
        let all = triangles.saturating_mul(rigid.saturating_add(skinned));
        self.total = self.total.saturating_add(all);
        self.kept = self.kept.saturating_add(all);
        if pays(triangles, rigid) {
            let shared = triangles.saturating_add(rigid.saturating_mul(INSTANCE_TRIANGLES));
            let saved = triangles.saturating_mul(rigid).saturating_sub(shared);
            self.saved = self.saved.saturating_add(saved);
        }
    }

    /// Whether meshes are to be shared; refuses what is too much in either case.
    pub fn check(self, limits: &ImportLimits) -> Result<bool, SceneError> {
        let most = (limits.max_triangles as u64).min(u64::from(u32::MAX) / 3);
        let fix = "simplify the meshes or send fewer instances";
        if self.total > MOST_INSTANCED_TRIANGLES.max(most) {
            let what = format!(
                "{} triangles with all instances; {} are allowed, however many share a mesh",
                self.total,
                MOST_INSTANCED_TRIANGLES.max(most)
            );
            return Err(SceneError::too_large("meshes", what, fix));
        }
        let kept = self.kept.saturating_sub(self.saved);
        if kept > most {
            let what = match self.saved {
                0 => format!("{} triangles with all instances; {most} are allowed", self.total),
                _ => format!(
                    "{kept} triangles, those of shared meshes counted once and each of their instances as {INSTANCE_TRIANGLES}; {most} are allowed"
                ),
            };
            return Err(SceneError::too_large("meshes", what, fix));
        }
        Ok(self.saved > limits.share_above || self.kept > most)
    }
}

/// Whether it pays to share a primitive of so many triangles among so many instances.
pub(super) fn pays(triangles: u64, instances: u64) -> bool {
    triangles >= LEAST_TRIANGLES && instances >= 2
}

/// A primitive that instances share.
pub(super) struct SharedShape {
    number: u32,
    /// Area of its smallest triangle, and the least ratio of any's to its longest side's square.
    least_area: f64,
    least_ratio: f64,
}

impl SharedShape {
    /// Makes one of a primitive that is shown so many times; `None` where it has no triangle with an
    /// area, or is too large to be looked at in its own space.
    pub fn new(
        local: &Local,
        times: u64,
        instances: &mut Instances,
        placing: &mut Placing<'_>,
    ) -> Option<Self> {
        let farthest = local.vertices.iter().map(|v| v.position.abs().max_element());
        if farthest.fold(0.0, f64::max) > MAX_COORDINATE {
            return None;
        }
        let mut own = Scene::default();
        let mut in_own_space = Placing::new(&mut own);
        in_own_space.add_in_mesh_space(local);
        let odd = in_own_space.odd_triangles();
        if own.triangles.is_empty() {
            return None;
        }
        placing.count_odd(odd, times);
        let (mut least_area, mut least_ratio) = (f64::INFINITY, f64::INFINITY);
        for triangle in &own.triangles {
            let [a, b, c] = own.corners(triangle).map(Vec3::as_dvec3);
            let area = 0.5 * (b - a).cross(c - a).length();
            let longest = (b - a).length_squared().max((c - b).length_squared());
            least_area = least_area.min(area);
            least_ratio = least_ratio.min(area / longest.max((a - c).length_squared()));
        }
        let number = instances.add_shape(own.vertices, own.triangles);
        Some(Self { number, least_area, least_ratio })
    }

    /// Adds an instance; `false` where it is to be copied, because the transform leaves no area to
    /// some triangle or takes it too far away.
    pub fn place(&self, to_world: DMat4, instances: &mut Instances) -> Result<bool, SceneError> {
        if !self.may_stand(to_world, instances) {
            return Ok(false);
        }
        if instances.add(self.number, DAffine3::from_mat4(to_world)) {
            return Ok(true);
        }
        let what = "have too many triangles or vertices with all instances";
        let fix = "simplify the meshes or send fewer instances";
        Err(SceneError::too_large("meshes", what, fix))
    }

    fn may_stand(&self, to_world: DMat4, instances: &Instances) -> bool {
        let linear = DMat3::from_mat4(to_world);
        let squares = linear.x_axis.length_squared()
            + linear.y_axis.length_squared()
            + linear.z_axis.length_squared();
        // Bounds of the largest and the least factor of a length.
        let (most, volume) = (squares.sqrt(), linear.determinant().abs());
        let least = volume / squares;
        let uneven = most / least;
        let has_areas = least * least * self.least_area > MIN_AREA
            && self.least_ratio > MIN_AREA_RATIO * uneven * uneven;
        let shape = &instances.shapes()[self.number as usize];
        let (low, high) = (shape.low.as_dvec3(), shape.high.as_dvec3());
        let reach = to_world.transform_point3(0.5 * (low + high)).abs()
            + DVec3::splat(most * 0.5 * (high - low).length());
        // Also false for what is not finite.
        has_areas && reach.max_element() <= MAX_COORDINATE
    }
}
