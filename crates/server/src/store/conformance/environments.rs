//! Maps of skies, beside scenes and as they are.

use super::fixture::{Home, furnished, queue, wish};
use crate::api::environments::EnvironmentMap;
use crate::store::scenes::{ScenePosition, Viewer};
use crate::store::{Accepted, NewJob, Store, specimens};
use jiff::Timestamp;

const EVERYONE: Viewer<'static> = Viewer { holder: "admin", sees_all: true };

fn map(id: &str, created_s: i64) -> EnvironmentMap {
    let created_at = Timestamp::from_second(created_s).unwrap();
    EnvironmentMap { id: id.into(), size: 7, created_at, ..specimens::map(b"?") }
}

/// A job whose sky is that map.
fn under(map: &str) -> NewJob {
    let mut job = wish(0);
    let environment = serde_json::json!({"sky": {"environment": map}});
    job.request.environment = serde_json::from_value(environment).unwrap();
    job
}

async fn ids(store: &dyn Store, viewer: Viewer<'_>) -> Vec<String> {
    let maps = store.shown_environments(viewer, None, 10).await.unwrap();
    maps.into_iter().map(|map| map.id).collect()
}

pub async fn maps_and_scenes_are_kept_alike_and_listed_apart(place: &dyn Home) {
    let store = furnished(place).await;
    for (id, created_s) in [("dawn", 1), ("noon", 3), ("dusk", 2)] {
        assert!(store.put_environment(&map(id, created_s)).await.unwrap());
        assert!(!store.put_environment(&map(id, created_s)).await.unwrap());
    }
    assert_eq!(store.environment("noon").await.unwrap(), Some(map("noon", 3)));
    assert_eq!(ids(&*store, EVERYONE).await, ["noon", "dusk", "dawn"]);
    let place = ScenePosition { created_ms: 2000, id: "dusk".into() };
    let rest = store.shown_environments(EVERYONE, Some(&place), 10).await.unwrap();
    assert_eq!(rest, [map("dawn", 1)]);
    // Neither is the other.
    assert_eq!(store.scene("noon").await.unwrap(), None);
    assert_eq!(store.environment("scene").await.unwrap(), None);
    assert_eq!(store.shown_scenes(EVERYONE, None, 10).await.unwrap().len(), 1);
    assert!(store.is_stored("noon").await.unwrap() && store.is_stored("scene").await.unwrap());
    assert!(!store.is_stored("night").await.unwrap());
    // Holders, names and bytes are as those of scenes, and count together.
    let ann = Viewer { holder: "ann", sees_all: false };
    assert_eq!(store.shown_environment("noon", ann).await.unwrap(), None);
    assert!(store.hold_scene("noon", "ann").await.unwrap());
    assert!(store.hold_scene("scene", "ann").await.unwrap());
    store.name_scene("noon", "ann", "noon.exr").await.unwrap();
    let shown = store.shown_environment("noon", ann).await.unwrap().unwrap();
    assert_eq!(shown.name.as_deref(), Some("noon.exr"));
    assert_eq!(ids(&*store, ann).await, ["noon"]);
    assert_eq!(store.scene_bytes_of("ann").await.unwrap(), 8);
    assert_eq!(store.stored_bytes().await.unwrap(), 1 + 3 * 7);
}

pub async fn a_job_keeps_the_map_of_its_sky(place: &dyn Home) {
    let store = furnished(place).await;
    let refused = store.accept(under("noon"), 100).await.unwrap();
    assert!(matches!(refused, Accepted::EnvironmentGone), "{refused:?}");
    for id in ["noon", "dusk"] {
        store.put_environment(&map(id, 1)).await.unwrap();
        store.hold_scene(id, "ann").await.unwrap();
    }
    let job = queue(&*store, under("noon")).await;
    for id in ["noon", "dusk"] {
        store.let_go_scene(id, Some("ann")).await.unwrap();
    }
    assert_eq!(store.scenes_let_go(10).await.unwrap(), ["dusk"]);
    assert!(!store.forget_let_go("noon").await.unwrap());
    assert!(store.forget_let_go("dusk").await.unwrap());
    let before = Timestamp::MAX;
    assert!(!store.unused_scenes(before, 10).await.unwrap().contains(&"noon".to_owned()));
    assert!(!store.forget_scene("noon", before).await.unwrap());
    // While the job waits, its map makes no room for others.
    let staying = store.staying(before).await.unwrap();
    assert_eq!((staying.bytes, staying.fixed), (1 + 7, 1 + 7));
    store.delete(job).await.unwrap();
    assert!(!store.forget_let_go("noon").await.unwrap(), "a deleted job names it, too");
    store.purge(0).await.unwrap();
    assert!(store.forget_let_go("noon").await.unwrap());
    assert_eq!(store.environment("noon").await.unwrap(), None);
}
