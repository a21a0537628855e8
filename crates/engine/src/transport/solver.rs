//! What a method is to the driver that runs it.

use super::bake::bake;
use super::checkpoints::Parts;
use super::job::Job;
use super::options::{AnySetting, MeshSettings, Preset, Scope, Settings};
use super::run::Run;
use crate::device::{Device, DeviceError};
use crate::image::Picture;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{ErrorBounds, RenderError, StopReason};
use crate::scene::Scene;
use crate::scene::gltf::BakedMesh;
use crate::surface::World;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Aim of one step of a solver, seconds: short enough to cancel, long enough not to matter.
pub const STEP_SECONDS: f64 = 0.04;

/// After how many iterations a job with a target error looks at its estimate: after numbers that
/// grow by an eighth, whatever the clock says, so that a fast machine neither passes the target by
/// far before a report is due, nor stops elsewhere than a slow one.
pub struct TargetChecks {
    next: u64,
}

impl TargetChecks {
    /// The checks after so many iterations.
    pub fn after(iterations: u64) -> Self {
        let mut next = 1;
        while next <= iterations {
            next += u64::div_ceil(next, 8);
        }
        Self { next }
    }

    /// Whether a check is due after so many iterations; if so, the next one is a later one.
    pub fn are_due(&mut self, iterations: u64) -> bool {
        let due = iterations >= self.next;
        if due {
            *self = Self::after(iterations);
        }
        due
    }

    /// Iterations from so many to the next check, at least 1.
    pub fn iterations_to_next(&self, iterations: u64) -> u64 {
        self.next.saturating_sub(iterations).max(1)
    }
}

/// How many triangles a scene has.
#[derive(Clone, Copy, Debug)]
pub struct TriangleCount {
    /// With those of all instances.
    pub all: u64,
    /// Those that take memory where instances share meshes; see [`Scene::kept_triangles`].
    pub kept: u64,
}

impl TriangleCount {
    /// Those of a scene.
    pub fn of(scene: &Scene) -> Self {
        Self { all: scene.triangle_count() as u64, kept: scene.kept_triangles() }
    }
}

impl From<u64> for TriangleCount {
    /// So many, all of which are listed.
    fn from(all: u64) -> Self {
        Self { all, kept: all }
    }
}

impl From<[u64; 2]> for TriangleCount {
    /// So many, and so many that take memory.
    fn from([all, kept]: [u64; 2]) -> Self {
        Self { all, kept }
    }
}

/// What the memory of a job depends on.
#[derive(Clone, Copy)]
pub struct Extent<'a> {
    /// Triangles of the scene.
    pub triangles: TriangleCount,
    /// Bytes of the smaller copies of the scene's textures, by which means over parts of them are
    /// found.
    pub pyramid_bytes: u64,
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// Whether light comes from elsewhere than surfaces, which methods on patches find by rays.
    pub patchless: bool,
    /// The settings in force.
    pub settings: &'a Settings,
}

/// Bytes that a method on patches takes at its peak, as measured: what scene, mesh, sums of the
/// device and weights of the pixels hold, the scene as rays meet it where those light it, and the
/// program itself. There is at least a patch a
/// triangle.
pub fn patched_bytes(extent: &Extent<'_>) -> u64 {
    const PROGRAM: u64 = 16 << 20;
    const PER_TRIANGLE: u64 = 300;
    const PER_PATCH: u64 = 450;
    const PER_PIXEL: u64 = 32;
    let [width, height] = extent.size.map(u64::from);
    let mesh = extent.triangles.all.saturating_mul(PER_TRIANGLE);
    let patches = MeshSettings::new(extent.settings).patches as u64;
    let light = patches.max(extent.triangles.all).saturating_mul(PER_PATCH);
    let rays = if extent.patchless { World::needed_bytes(extent.triangles.all) } else { 0 };
    let scene = mesh.saturating_add(light).saturating_add(rays);
    scene.saturating_add(PROGRAM + width * height * PER_PIXEL)
}

/// A way to solve the light transport of a scene and take a picture of it.
pub trait Method: Sync {
    /// The name that requests use.
    fn name(&self) -> &'static str;

    /// The format of its checkpoints. One more whenever what it keeps is laid out otherwise or means
    /// something else, and whenever it would go on from it to other bits than before: with other
    /// random numbers, another order of sums, another default. Versions of the program with the
    /// same number read each other's checkpoints.
    fn checkpoint_format(&self) -> u32;

    /// One sentence on what it is.
    fn summary(&self) -> &'static str;

    /// Its settings, in the order in which they are listed. What is not among them is refused.
    fn settings(&self) -> Vec<&'static dyn AnySetting>;

    /// Its presets.
    fn presets(&self) -> &'static [Preset] {
        &[]
    }

    /// All that it can be set to.
    fn scope(&self) -> Scope {
        Scope { method: self.name(), settings: self.settings(), presets: self.presets() }
    }

    /// Memory that it takes at its peak, bytes.
    fn needed_bytes(&self, extent: &Extent<'_>) -> u64;

    /// Sets up what solves a job, and announces it ([`Job::announce`]); takes up what the job begins
    /// with. `None` where there is no light, so that there is nothing to solve.
    ///
    /// # Errors
    /// See [`crate::transport::render`].
    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError>;
}

/// What an estimate of the error came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimate {
    /// Relative root mean square error of the present picture.
    Error(f64),
    /// It takes more iterations to say.
    NotYet,
    /// There never will be one: the method can't, or there is nothing to estimate it from.
    Never,
}

impl Estimate {
    /// What batch means say, of which there are `enough` or not: where there is no error in spite of
    /// that, the picture is black.
    pub fn of_batches(error: Option<f64>, enough: bool) -> Self {
        match error {
            Some(error) => Self::Error(error),
            None if enough => Self::Never,
            None => Self::NotYet,
        }
    }
}

/// The state of a method at work on one job.
pub trait Solver {
    /// Works for about [`STEP_SECONDS`], or for one iteration where that takes longer, and counts
    /// what was done in the run. Why the job is over, where it had to stop on the way.
    ///
    /// # Errors
    /// [`RenderError::Device`] where the device failed.
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError>;

    /// Why there is nothing more to do, if so.
    fn finished(&self) -> Option<StopReason> {
        None
    }

    /// Whether the picture shows anything yet.
    fn is_visible(&self) -> bool;

    /// Whether another estimate would say anything new.
    fn has_news(&self) -> bool {
        true
    }

    /// Whether the error is to be estimated now, after so many iterations, though no report is
    /// due, so that a job with a target error ends as soon as it is reached.
    fn checks_target(&mut self, _iterations: u64) -> bool {
        false
    }

    /// Estimates the error of the present picture.
    fn estimate(&mut self) -> Estimate;

    /// What the true error of the picture that was estimated last most likely lies between; `None` where
    /// the method holds no audit, or that can't tell yet.
    fn error_bounds(&self) -> Option<ErrorBounds> {
        None
    }

    /// The present picture.
    fn picture(&mut self) -> Picture;

    /// Writes all that it takes to go on from here.
    ///
    /// # Errors
    /// [`RenderError::Device`] where the device does not hand over its sums.
    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError>;

    /// Brings to an end what is under way; only the last estimate and picture come after it.
    ///
    /// # Errors
    /// [`RenderError::Device`] where the device failed.
    fn settle(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    /// The patches and their irradiance; `None` where there are none, or no solution yet.
    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        None
    }

    /// The solution as a mesh with the light in its vertices; `None` where there is none, or it would
    /// take more than so many bytes.
    fn baked(&self, most_bytes: u64) -> Option<BakedMesh> {
        let (scene, irradiance) = self.irradiance()?;
        bake(&scene, &irradiance, most_bytes)
    }

    /// Figures of the method's own by name, at the end.
    fn diagnostics(&self, _run: &Run<'_>) -> BTreeMap<String, f64> {
        BTreeMap::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checks_are_the_same_however_many_iterations_a_step_has_and_after_a_pause() {
        let by_ones = |from: u64| {
            let mut checks = TargetChecks::after(from);
            (from + 1..=200).filter(|n| checks.are_due(*n)).collect::<Vec<_>>()
        };
        let all = by_ones(0);
        assert_eq!(all[..9], [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert!(all.windows(2).all(|pair| pair[1] - pair[0] <= pair[0].div_ceil(8)));
        for from in [1, 7, 50, 123] {
            let rest: Vec<u64> = all.iter().copied().filter(|n| *n > from).collect();
            assert_eq!(by_ones(from), rest, "after {from}");
        }
        // Steps that end at checks meet each of them.
        let (mut checks, mut at, mut met) = (TargetChecks::after(0), 0, Vec::new());
        while at < 200 {
            at += checks.iterations_to_next(at).min(200 - at);
            if checks.are_due(at) {
                met.push(at);
            }
        }
        assert_eq!(met, all);
    }
}
