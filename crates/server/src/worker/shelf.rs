//! Scenes that a device has rendered, kept for its next jobs: as imported, with what the engine has
//! made of them. The latest ones stay, as many as fit.

use super::wire::Task;
use crate::api::parts::PartRequest;
use crate::api::scenes::SceneFormat;
use hemilux_engine::transport::Prepared;

/// What decides what is imported of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneKey {
    /// Id of the scene, which is a hash of its file.
    id: String,
    format: SceneFormat,
    max_triangles: usize,
    variant: Option<String>,
    part: Option<PartRequest>,
    animation: Option<PartRequest>,
    time: Option<f64>,
}

impl SceneKey {
    /// Of the scene that a task is about.
    pub fn of(task: &Task) -> Self {
        let request = &task.request;
        Self {
            id: task.scene.clone(),
            format: task.scene_format,
            max_triangles: task.max_triangles,
            variant: request.variant.clone(),
            part: request.gltf_scene.clone(),
            animation: request.animation.clone(),
            time: request.time,
        }
    }
}

/// The scenes.
#[derive(Default)]
pub struct SceneShelf {
    /// With their bytes, the latest last.
    kept: Vec<(SceneKey, u64, Prepared)>,
}

impl SceneShelf {
    /// Takes a scene off the shelf, if it is there. Who takes it brings it back when all went well.
    pub fn take(&mut self, key: &SceneKey) -> Option<Prepared> {
        let at = self.kept.iter().position(|(own, ..)| own == key)?;
        Some(self.kept.remove(at).2)
    }

    /// Puts a scene on the shelf, and lets those go that were there longest until all together take
    /// at most so many bytes.
    pub fn put(&mut self, key: SceneKey, scene: Prepared, most_bytes: u64) {
        let bytes = scene.held_bytes();
        self.kept.retain(|(own, ..)| *own != key);
        self.kept.push((key, bytes, scene));
        let mut all: u64 = self.kept.iter().map(|(_, bytes, _)| bytes).sum();
        while all > most_bytes {
            all -= self.kept.remove(0).1;
        }
    }

    /// Lets all of them go; whether there were any.
    pub fn clear(&mut self) -> bool {
        let had_any = !self.kept.is_empty();
        self.kept.clear();
        had_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
    use hemilux_engine::scene::made;
    use std::sync::Arc;

    fn key(id: &str) -> SceneKey {
        SceneKey {
            id: id.into(),
            format: SceneFormat::Gltf,
            max_triangles: 1000,
            variant: None,
            part: None,
            animation: None,
            time: None,
        }
    }

    fn scene() -> Prepared {
        let scene = import(&made::cornell(), &Resources::new(), &ImportLimits::default()).unwrap();
        Prepared::new(Arc::new(scene))
    }

    #[test]
    fn the_latest_scenes_stay_as_far_as_they_fit() {
        let each = scene().held_bytes();
        assert!(each > 1000, "{each}");
        let mut shelf = SceneShelf::default();
        for id in ["a", "b", "c"] {
            shelf.put(key(id), scene(), 2 * each);
        }
        assert!(shelf.take(&key("a")).is_none(), "three do not fit");
        let b = shelf.take(&key("b")).expect("two fit");
        assert!(shelf.take(&key("b")).is_none(), "it was taken");
        shelf.put(key("b"), b, 2 * each);
        // Now c is the one that was there longest.
        shelf.put(key("d"), scene(), 2 * each);
        assert!(shelf.take(&key("c")).is_none() && shelf.take(&key("b")).is_some());
        assert!(shelf.clear() && !shelf.clear());
        assert!(shelf.take(&key("d")).is_none());
    }

    #[test]
    fn what_does_not_fit_is_not_kept() {
        let each = scene().held_bytes();
        for most in [0, each - 1] {
            let mut shelf = SceneShelf::default();
            shelf.put(key("a"), scene(), most);
            assert!(shelf.take(&key("a")).is_none());
        }
    }

    #[test]
    fn what_else_is_imported_of_a_file_is_another_scene() {
        let most = u64::MAX;
        let others: [fn(&mut SceneKey); 6] = [
            |key| key.format = SceneFormat::Bundle,
            |key| key.max_triangles += 1,
            |key| key.variant = Some("red".into()),
            |key| key.part = Some(PartRequest::Index(1)),
            |key| key.animation = Some(PartRequest::Index(0)),
            |key| key.time = Some(0.5),
        ];
        for change in others {
            let mut other = key("a");
            change(&mut other);
            let mut shelf = SceneShelf::default();
            shelf.put(key("a"), scene(), most);
            assert!(shelf.take(&other).is_none(), "{other:?}");
            assert!(shelf.take(&key("a")).is_some());
        }
    }
}
