use super::*;
use crate::store::Store;
use crate::store::specimens;
use tempfile::TempDir;

/// A data folder that has been used.
async fn used() -> TempDir {
    let folder = TempDir::new().unwrap();
    let (store, artifacts) = open(folder.path(), false).await.unwrap();
    fill(&store, &artifacts).await;
    store.close().await;
    folder
}

async fn fill(store: &SqliteStore, artifacts: &Artifacts) {
    let content = bytes::Bytes::from("scene");
    let scene = specimens::scene(&content);
    artifacts.put_scene(&scene.id, content).await.unwrap();
    store.put_scene(&scene).await.unwrap();
}

async fn opens(folder: &TempDir) {
    for _ in 0..2 {
        let (store, artifacts) = open(folder.path(), false).await.unwrap();
        assert!(artifacts.any_files().await.unwrap());
        store.close().await;
    }
}

async fn is_refused(folder: &TempDir, why: &str) {
    let had = folder.path().join(DATABASE).exists();
    for _ in 0..2 {
        let error = open(folder.path(), false).await.err().expect("it is refused");
        let text = error.to_string();
        assert!(matches!(error, FolderError::Foreign { .. }), "{text}");
        let ways = ["hemilux.sqlite", "--adopt-files", "hemilux restore"];
        assert!(text.contains(why) && ways.iter().all(|way| text.contains(way)), "{text}");
        assert_eq!(folder.path().join(DATABASE).exists(), had, "it made a database");
    }
}

async fn adopts(folder: &TempDir) {
    let (store, _) = open(folder.path(), true).await.unwrap();
    store.close().await;
    opens(folder).await;
}

#[tokio::test]
async fn files_whose_database_is_gone_are_not_taken_for_leftovers() {
    let folder = used().await;
    std::fs::rename(folder.path().join(DATABASE), folder.path().join("aside")).unwrap();
    is_refused(&folder, "there is no database").await;
    std::fs::rename(folder.path().join("aside"), folder.path().join(DATABASE)).unwrap();
    opens(&folder).await;
    std::fs::remove_file(folder.path().join(DATABASE)).unwrap();
    adopts(&folder).await;
}

#[tokio::test]
async fn another_database_is_refused() {
    let (folder, other) = (used().await, used().await);
    std::fs::copy(other.path().join(DATABASE), folder.path().join(DATABASE)).unwrap();
    is_refused(&folder, "the files are of store").await;
    adopts(&folder).await;
}

#[tokio::test]
async fn a_new_database_is_refused_beside_files_with_and_without_an_id() {
    for keep_id in [true, false] {
        let folder = used().await;
        std::fs::remove_file(folder.path().join(DATABASE)).unwrap();
        SqliteStore::open(&folder.path().join(DATABASE)).await.unwrap().close().await;
        if !keep_id {
            std::fs::remove_file(folder.path().join("artifacts/store-id")).unwrap();
        }
        is_refused(&folder, if keep_id { "the files are of store" } else { "the database is new" })
            .await;
        adopts(&folder).await;
    }
}

#[tokio::test]
async fn files_that_have_lost_their_id_are_refused() {
    let folder = used().await;
    std::fs::rename(folder.path().join(ARTIFACTS), folder.path().join("unmounted")).unwrap();
    is_refused(&folder, "is a disk missing?").await;
    std::fs::remove_dir_all(folder.path().join(ARTIFACTS)).unwrap();
    std::fs::rename(folder.path().join("unmounted"), folder.path().join(ARTIFACTS)).unwrap();
    opens(&folder).await;
}

#[tokio::test]
async fn a_folder_of_an_earlier_release_gets_its_id() {
    let folder = TempDir::new().unwrap();
    let artifacts = Artifacts::local(&folder.path().join(ARTIFACTS)).unwrap();
    let store = SqliteStore::open(&folder.path().join(DATABASE)).await.unwrap();
    fill(&store, &artifacts).await;
    store.close().await;
    opens(&folder).await;
    assert!(artifacts.store_id().await.unwrap().is_some());
    // A folder that was never used may lose everything.
    let fresh = TempDir::new().unwrap();
    open(fresh.path(), false).await.unwrap().0.close().await;
    std::fs::remove_dir_all(fresh.path().join(ARTIFACTS)).unwrap();
    open(fresh.path(), false).await.unwrap().0.close().await;
}

/// It may be wanted with the program that wrote it.
#[tokio::test]
async fn a_database_that_is_refused_is_left_as_it_was() {
    let folder = used().await;
    let database = folder.path().join(DATABASE);
    std::fs::remove_file(&database).unwrap();
    crate::store::sqlite::tests::first_release(&database).await;
    let before = std::fs::read(&database).unwrap();
    is_refused(&folder, "the database is of an early release").await;
    assert!(std::fs::read(&database).unwrap() == before, "it was changed");
    adopts(&folder).await;
}
