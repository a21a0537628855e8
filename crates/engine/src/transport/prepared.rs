//! What is made of a scene before its light is solved, kept for the next job on the same scene.
//!
//! Of a large scene it takes a good part of the time to the first picture: the hierarchy for rays, the
//! cut into patches, and where the file has no camera the search for one. None of it depends on the
//! seed or on the light around the scene. What depends on these, but on no camera, a method keeps with
//! a note of what it depends on, and uses again where that is the same. So another job finds the same,
//! to the bit.

use super::own_light::lights_itself;
use super::surroundings::surroundings;
use crate::checkpoint::SceneDigest;
use crate::patches::{Cut, Focus};
use crate::render::{CameraChoice, RenderError, RenderRequest};
use crate::scene::environment::Environment;
use crate::scene::{Background, Camera, Scene, Warning};
use crate::surface::World;
use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// What a method has begun with, to begin with it again in the next job on the same scene.
pub trait Beginning: Any + Send + Sync {
    /// Bytes that it takes beside what the scene's other parts take, about.
    fn held_bytes(&self) -> u64;
}

/// A scene with what jobs have made of it so far.
pub struct Prepared {
    scene: Arc<Scene>,
    /// The scene for rays, with nothing around it.
    world: OnceLock<World>,
    /// Whether what glows in it lights it, once it was asked for.
    lights_itself: OnceLock<bool>,
    cut: Mutex<Option<KeptCut>>,
    camera: Mutex<Option<MadeUpCamera>>,
    /// What the hash of the scene begins with, once it was asked for.
    pub(super) digest: Arc<OnceLock<SceneDigest>>,
    /// The latest.
    beginning: Mutex<Option<Arc<dyn Beginning>>>,
}

/// The latest cut, for so many patches that are finest about a focus.
struct KeptCut {
    wanted: (usize, Option<Focus>),
    cut: Arc<Cut>,
}

/// The latest camera of a scene that has none, for pictures of that width over height.
struct MadeUpCamera {
    aspect: f32,
    camera: Camera,
    warning: Option<Warning>,
}

impl Prepared {
    /// Of a scene that nothing has been made of yet.
    pub fn new(scene: Arc<Scene>) -> Self {
        Self {
            scene,
            world: OnceLock::new(),
            lights_itself: OnceLock::new(),
            cut: Mutex::default(),
            camera: Mutex::default(),
            digest: Arc::default(),
            beginning: Mutex::default(),
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Bytes that the scene and what is made of it take, about.
    pub fn held_bytes(&self) -> u64 {
        let world = self.world.get().map_or(0, World::held_bytes);
        let cut = locked(&self.cut).as_ref().map_or(0, |kept| kept.cut.held_bytes());
        let beginning = locked(&self.beginning).as_ref().map_or(0, |kept| kept.held_bytes());
        self.scene.held_bytes() + world + cut + beginning
    }

    /// The scene as rays meet it, in those surroundings and before that background.
    pub(super) fn world(&self, environment: Arc<Environment>, background: Background) -> World {
        self.alone().within(environment).before(background)
    }

    /// The scene as rays meet it, with nothing around it.
    fn alone(&self) -> &World {
        let none = || World::surrounded(self.scene.clone(), Arc::new(Environment::none()));
        self.world.get_or_init(none)
    }

    /// What surrounds the scene in a job, with a warning where the job does not say and nothing else lights it.
    pub(super) fn surroundings(
        &self,
        request: &RenderRequest,
    ) -> (Arc<Environment>, Option<Warning>) {
        let found = || *self.lights_itself.get_or_init(|| lights_itself(self.alone()));
        surroundings(request, found)
    }

    /// The scene in about so many patches, finest about a focus.
    pub(super) fn cut(&self, patches: usize, focus: Option<Focus>) -> Arc<Cut> {
        let mut kept = locked(&self.cut);
        if let Some(kept) = kept.as_ref().filter(|kept| kept.wanted == (patches, focus)) {
            return kept.cut.clone();
        }
        // The one before has to go first, and what was begun with it: both may not fit into memory.
        *kept = None;
        *locked(&self.beginning) = None;
        let cut = Arc::new(Cut::new(self.scene.clone(), patches, focus));
        *kept = Some(KeptCut { wanted: (patches, focus), cut: cut.clone() });
        cut
    }

    /// What a method has begun with in the latest job that kept such a thing.
    pub(super) fn beginning<T: Beginning>(&self) -> Option<Arc<T>> {
        let kept: Arc<dyn Any + Send + Sync> = locked(&self.beginning).clone()?;
        kept.downcast().ok()
    }

    /// Keeps what a method has begun with.
    pub(super) fn keep(&self, beginning: Arc<dyn Beginning>) {
        *locked(&self.beginning) = Some(beginning);
    }

    /// The camera of a request for a picture of this scene; see [`RenderRequest::camera`].
    pub(super) fn camera(
        &self,
        request: &RenderRequest,
    ) -> Result<(Camera, Option<Warning>), RenderError> {
        if request.camera != CameraChoice::First || !self.scene.cameras.is_empty() {
            return request.camera();
        }
        let aspect = request.width as f32 / request.height as f32;
        let mut kept = locked(&self.camera);
        if let Some(kept) = kept.as_ref().filter(|kept| kept.aspect == aspect) {
            return Ok((kept.camera.clone(), kept.warning.clone()));
        }
        let (camera, warning) = request.camera()?;
        *kept = Some(MadeUpCamera { aspect, camera: camera.clone(), warning: warning.clone() });
        Ok((camera, warning))
    }
}

/// What is behind a lock. A panic while it was held has left nothing half done there.
fn locked<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
