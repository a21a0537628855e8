//! Jobs that are given more budget.

use super::fixture::{Home, claim, done, furnished, queue, state, wish};
use crate::api::jobs::{Picture, PictureFormat, Progress, Stats};
use crate::job_state::{Cause, JobState, MAX_FAILURES};
use crate::store::solutions::Extended;
use crate::store::{Outcome, Report, Store};
use uuid::Uuid;

fn picture(sha256: &str) -> Picture {
    Picture {
        format: PictureFormat::Exr,
        url: String::new(),
        sha256: sha256.into(),
        size: 1,
        width: 1,
        height: 1,
        base64: None,
    }
}

/// An end with a picture of that many iterations.
fn end(state: JobState, sha256: &str, iterations: u64) -> Outcome {
    let figures = serde_json::json!({
        "method": "stochastic", "stopped": "iterations", "iterations": iterations, "shots": 0,
        "light_source_selection_ratio": 0.0, "estimated_error": null, "seconds_solve": 0.0,
        "seconds_total": 0.0, "patches": 0, "triangles": 0,
    });
    let stats: Stats = serde_json::from_value(figures).unwrap();
    Outcome { stats: Some(stats), pictures: vec![picture(sha256)], ..Outcome::of(state) }
}

async fn extend(store: &dyn Store, id: Uuid) {
    let extended = store.extend(id, &wish(0).request, 100, None).await.unwrap();
    assert!(matches!(extended, Extended::Queued(_)), "{extended:?}");
}

/// Checks which picture is the result, and the newest.
async fn shows(store: &dyn Store, id: Uuid, sha256: &str, iterations: u64) {
    let job = store.job(id).await.unwrap().unwrap();
    assert_eq!(job.result.unwrap(), [picture(sha256)]);
    assert_eq!(job.stats.unwrap().figures.iterations, iterations);
    if job.state.is_terminal() {
        let newest = store.newest_picture(id, PictureFormat::Exr).await.unwrap();
        assert_eq!(newest.unwrap(), picture(sha256));
    }
}

pub async fn an_extension_keeps_the_result_until_there_is_a_better_one(place: &dyn Home) {
    let store = furnished(place).await;
    let id = queue(&*store, wish(0)).await;
    store.finish(claim(&*store).await, end(JobState::Succeeded, "first", 40)).await.unwrap();
    extend(&*store, id).await;
    shows(&*store, id, "first", 40).await;

    // It fails, after a snapshot.
    let held = claim(&*store).await;
    let snapshots = vec![(vec![picture("worse")], Progress::default())];
    store.report(held, Report { snapshots, ..Report::default() }).await.unwrap();
    store.finish(held, Outcome::of(JobState::Failed)).await.unwrap();
    assert_eq!(state(&*store, id).await, JobState::Failed);
    shows(&*store, id, "first", 40).await;

    // It can be tried again; this time it is given up.
    extend(&*store, id).await;
    for _ in 0..MAX_FAILURES {
        store.release(claim(&*store).await, Cause::Failure, "it crashed").await.unwrap();
    }
    let job = store.job(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.error.unwrap().code.as_str()), (JobState::Failed, "poisoned"));
    shows(&*store, id, "first", 40).await;

    // It is cancelled: waiting, with less than there was, and with more.
    extend(&*store, id).await;
    assert_eq!(store.job(id).await.unwrap().unwrap().error, None);
    store.cancel(id).await.unwrap();
    shows(&*store, id, "first", 40).await;
    for (sha256, iterations, expected) in [("less", 39, ("first", 40)), ("more", 41, ("more", 41))]
    {
        extend(&*store, id).await;
        let held = claim(&*store).await;
        store.finish(held, end(JobState::Cancelled, sha256, iterations)).await.unwrap();
        shows(&*store, id, expected.0, expected.1).await;
    }

    // A success replaces it.
    extend(&*store, id).await;
    store.finish(claim(&*store).await, end(JobState::Succeeded, "last", 7)).await.unwrap();
    shows(&*store, id, "last", 7).await;

    // What never had a result cannot be extended.
    let other = queue(&*store, wish(0)).await;
    store.finish(claim(&*store).await, Outcome::of(JobState::Failed)).await.unwrap();
    let extended = store.extend(other, &wish(0).request, 100, None).await.unwrap();
    assert!(matches!(extended, Extended::NotNow(_)), "{extended:?}");
    // An extension that shows nothing at its good end has no result.
    extend(&*store, id).await;
    store.finish(claim(&*store).await, done()).await.unwrap();
    assert_eq!(store.job(id).await.unwrap().unwrap().result, None);
}
