//! What the method begins with that no camera has a part in: the lights and the coarse solution with
//! its first links. The next job on the same scene begins with the same, if all that it depends on is.

use super::clock::Clock;
use super::coarse::{CoarseMesh, CoarseSolution, Drawing, Elements, SampledLight};
use super::settings::HemiluxSettings;
use crate::checkpoint::{CheckpointError, Reader};
use crate::emitters::DirectLights;
use crate::patches::Cut;
use crate::sampling::Seed;
use crate::scene::environment::Environment;
use crate::surface::World;
use crate::transport::checkpoints::Past;
use crate::transport::job::Job;
use crate::transport::prepared::Beginning;
use std::sync::Arc;

/// Bound on iterations read from a checkpoint: far more than a run can do, so a larger number
/// means damage.
const MOST_ITERATIONS: u64 = 1 << 40;

/// Lights and coarse solution of a job.
pub struct Begun {
    /// The scene's lights in their surroundings; nothing of them is drawn by chance.
    pub lights: Arc<DirectLights>,
    /// The coarse solution; with its first links, unless it is from a checkpoint or has caustics.
    pub coarse: CoarseSolution,
}

/// What a job's beginning is made of.
pub struct Foundations<'a> {
    /// The scene as rays meet it.
    pub world: &'a Arc<World>,
    /// The same in patches.
    pub cut: &'a Arc<Cut>,
    /// So many of which were wanted.
    pub patches: usize,
    /// What random numbers are drawn by.
    pub seed: Seed,
    /// The settings in force.
    pub options: &'a HemiluxSettings,
    /// Whether the first picture had better come soon than be good.
    pub hasty: bool,
}

/// What the coarse solution depends on beside scene, surroundings and cut.
#[derive(Clone, Copy, PartialEq)]
struct Drawn {
    patches: usize,
    seed: Seed,
    near_field: bool,
    rays: u32,
    hasty: bool,
}

/// A beginning that is kept.
pub(super) struct Kept {
    environment: Arc<Environment>,
    cut: Arc<Cut>,
    drawn: Drawn,
    lights: Arc<DirectLights>,
    coarse: CoarseSolution,
}

impl Beginning for Kept {
    fn held_bytes(&self) -> u64 {
        self.coarse.held_bytes()
    }
}

impl Foundations<'_> {
    /// Begins as an earlier job on the scene did, or afresh; `None` where nothing shines.
    pub fn begin(&self, job: &Job<'_>, clock: &mut Clock) -> Option<Begun> {
        let environment = &self.world.environment;
        let kept = job.beginning::<Kept>().filter(|kept| kept.environment == *environment);
        let drawn = self.drawn();
        let same =
            kept.as_ref().filter(|kept| kept.drawn == drawn && Arc::ptr_eq(&kept.cut, self.cut));
        if let Some(same) = same
            && let Some(coarse) = same.coarse.again(self.world.clone())
        {
            clock.lap("seconds_patches");
            return Some(Begun { lights: same.lights.clone(), coarse });
        }
        let lights = match kept {
            Some(kept) => kept.lights.clone(),
            None => Arc::new(DirectLights::new(self.world)?),
        };
        clock.lap("seconds_prepare");
        let mut coarse = self.solution(&lights, self.mesh(), None);
        clock.lap("seconds_patches");
        if coarse.caustics().is_none() {
            // The next links are twice as many.
            let rays = if self.hasty { drawn.rays / 2 } else { drawn.rays };
            coarse.link(self.seed, 0, rays);
            clock.lap("seconds_links");
        }
        if let Some(again) = coarse.again(self.world.clone()) {
            let (environment, cut) = (environment.clone(), self.cut.clone());
            job.keep(Kept { environment, cut, drawn, lights: lights.clone(), coarse: again });
        }
        Some(Begun { lights, coarse })
    }

    /// Begins with what an earlier attempt at the job knew, or another camera's picture.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`] where that is of another mesh.
    pub fn go_on(
        &self,
        past: &mut Past<'_>,
        clock: &mut Clock,
    ) -> Result<(Option<Begun>, EarlierRuns), CheckpointError> {
        let Some(lights) = DirectLights::new(self.world).map(Arc::new) else {
            return Ok((None, EarlierRuns::default()));
        };
        clock.lap("seconds_prepare");
        let mesh = self.mesh();
        let mut earlier = EarlierRuns::of(&mut past.shared, mesh.elements.len())?;
        let coarse = self.solution(&lights, mesh, earlier.sampled.take());
        clock.lap("seconds_patches");
        Ok((Some(Begun { lights, coarse }), earlier))
    }

    fn drawn(&self) -> Drawn {
        let HemiluxSettings { near_field, coarse_rays: rays, .. } = *self.options;
        let Self { patches, seed, hasty, .. } = *self;
        Drawn { patches, seed, near_field, rays, hasty }
    }

    /// The coarse mesh.
    fn mesh(&self) -> CoarseMesh {
        let elements = Elements::new(self.cut, self.patches);
        let mesh = CoarseMesh::new(&self.world.rays, self.cut.clone(), elements);
        let mut mesh = mesh.with_crevices(self.world, self.hasty);
        if !self.options.near_field {
            mesh.ignore_near_field();
        }
        mesh
    }

    /// A coarse solution without links.
    fn solution(
        &self,
        lights: &Arc<DirectLights>,
        mesh: CoarseMesh,
        sampled: Option<Vec<SampledLight>>,
    ) -> CoarseSolution {
        let drawing = Drawing { seed: self.seed, hasty: self.hasty };
        CoarseSolution::new(self.world.clone(), lights.clone(), mesh, drawing, sampled)
    }
}

/// What a checkpoint says of the runs before this one: the part that does not depend on the camera.
#[derive(Default)]
pub struct EarlierRuns {
    /// Iterations that it took to find the solution.
    pub iterations: u64,
    /// Those of them that another camera's picture had done.
    pub reused_iterations: u64,
    /// Sampled direct light, one entry an element.
    sampled: Option<Vec<SampledLight>>,
}

impl EarlierRuns {
    /// Reads it from the beginning of the checkpoint's shared section, of a mesh of `elements`.
    fn of(from: &mut Reader<'_>, elements: usize) -> Result<Self, CheckpointError> {
        let [iterations, reused_iterations] =
            [from.count(MOST_ITERATIONS)?, from.count(MOST_ITERATIONS)?];
        Ok(Self { iterations, reused_iterations, sampled: Some(from.exactly(elements)?) })
    }
}
