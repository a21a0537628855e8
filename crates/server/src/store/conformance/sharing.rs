//! Scenes that several hold.

use super::fixture::{Home, billed, furnished, queue, scene, wish};
use crate::store::Store;
use crate::store::scenes::{ScenePosition, Viewer};

fn by(holder: &str) -> Viewer<'_> {
    Viewer { holder, sees_all: false }
}

const EVERYONE: Viewer<'static> = Viewer { holder: "admin", sees_all: true };

async fn names(store: &dyn Store, viewer: Viewer<'_>) -> Vec<Option<String>> {
    let scenes = store.shown_scenes(viewer, None, 10).await.unwrap();
    scenes.into_iter().map(|scene| scene.name).collect()
}

pub async fn each_holder_sees_a_scene_as_their_own(place: &dyn Home) {
    let store = furnished(place).await;
    store.put_scene(&scene("other", 1)).await.unwrap();
    assert!(store.shown_scene("scene", by("a")).await.unwrap().is_none());
    assert!(store.hold_scene("scene", "a").await.unwrap());
    assert!(!store.hold_scene("scene", "a").await.unwrap());
    assert!(!store.hold_scene("no such scene", "a").await.unwrap());
    store.name_scene("scene", "a", "atrium.glb").await.unwrap();
    // For another it is as new as it was for the first: the time is theirs, and the name is not
    // the other's.
    let before = jiff::Timestamp::now();
    assert!(store.hold_scene("scene", "b").await.unwrap());
    let shown = store.shown_scene("scene", by("b")).await.unwrap().unwrap();
    assert!(shown.created_at.as_millisecond() >= before.as_millisecond(), "{shown:?}");
    assert_eq!(shown.name, None);
    assert_eq!(names(&*store, by("a")).await, [Some("atrium.glb".to_owned())]);
    assert_eq!(names(&*store, by("b")).await, [None]);
    assert_eq!(names(&*store, EVERYONE).await, [None, Some("atrium.glb".to_owned())]);
    // Positions are the viewer's own, and those of no scene are places all the same.
    let last = ScenePosition { created_ms: shown.created_at.as_millisecond(), id: "scene".into() };
    assert_eq!(store.shown_scenes(by("b"), Some(&last), 10).await.unwrap(), []);
    let later = ScenePosition { created_ms: last.created_ms + 1, id: "no scene".into() };
    assert_eq!(store.shown_scenes(by("b"), Some(&later), 10).await.unwrap(), [shown]);
    // A job keeps the name that its scene had for whoever sent it.
    let job = queue(&*store, billed("a", 9, 9, None)).await;
    store.name_scene("scene", "a", "renamed.glb").await.unwrap();
    let job = store.job(job).await.unwrap().unwrap();
    assert_eq!(job.scene_name.as_deref(), Some("atrium.glb"));
}

pub async fn who_lets_go_of_a_scene_leaves_it_to_the_others(place: &dyn Home) {
    let store = furnished(place).await;
    for holder in ["a", "b"] {
        store.hold_scene("scene", holder).await.unwrap();
    }
    assert_eq!(store.scene_bytes_of("a").await.unwrap(), 1);
    store.let_go_scene("scene", Some("a")).await.unwrap();
    store.let_go_scene("scene", Some("a")).await.unwrap();
    assert_eq!(store.scene_bytes_of("a").await.unwrap(), 0);
    assert!(store.shown_scene("scene", by("a")).await.unwrap().is_none());
    assert!(store.shown_scene("scene", by("b")).await.unwrap().is_some());
    assert!(store.scenes_let_go(10).await.unwrap().is_empty());
    // The last one leaves it to the job that names it.
    let job = queue(&*store, wish(0)).await;
    store.let_go_scene("scene", Some("b")).await.unwrap();
    assert!(store.shown_scene("scene", EVERYONE).await.unwrap().is_none());
    assert!(store.scenes_let_go(10).await.unwrap().is_empty());
    assert!(!store.forget_let_go("scene").await.unwrap());
    assert!(store.scene("scene").await.unwrap().is_some());
    store.delete(job).await.unwrap();
    assert!(!store.forget_let_go("scene").await.unwrap(), "a deleted job names it, too");
    store.purge(0).await.unwrap();
    assert_eq!(store.scenes_let_go(10).await.unwrap(), ["scene"]);
    // Whoever sends it again has it again.
    assert!(store.hold_scene("scene", "a").await.unwrap());
    assert!(!store.forget_let_go("scene").await.unwrap());
    store.let_go_scene("scene", None).await.unwrap();
    assert!(store.forget_let_go("scene").await.unwrap());
    assert!(store.scene("scene").await.unwrap().is_none());
    // Scenes without holders are of an older release and not let go of.
    store.put_scene(&scene("old", 1)).await.unwrap();
    store.let_go_scene("old", Some("a")).await.unwrap();
    assert!(store.scenes_let_go(10).await.unwrap().is_empty());
}
