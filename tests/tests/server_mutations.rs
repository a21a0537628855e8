//! Bodies near valid ones: whatever comes, the answer is a job or a problem document, and the
//! server goes on. `HEMILUX_MUTATION_SECONDS` makes it longer; `scripts/fuzz` looks deeper.

use hemilux_tests::mutate::Mutator;
use hemilux_tests::server::{Server, repository};
use std::time::{Duration, Instant};

fn seeds(target: &str) -> Vec<Vec<u8>> {
    let folder = repository().join("fuzz/seeds").join(target);
    let mut paths: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn whatever_is_posted_is_answered_in_order() {
    // Whole seconds for each kind of body.
    let seconds = std::env::var("HEMILUX_MUTATION_SECONDS").ok().and_then(|s| s.parse().ok());
    let patience = Duration::from_secs(seconds.unwrap_or(2));
    // The queue takes nothing, so no job runs.
    let mut server = Server::start_with(&["--max-queued", "0", "--max-upload-mb", "1"]);
    for (target, path, content_type) in [
        ("job", "/v1/jobs", "application/json"),
        ("multipart", "/v1/jobs", "multipart/form-data; boundary=x"),
        ("scene", "/v1/scenes", "model/gltf-binary"),
    ] {
        let seeds = seeds(target);
        let mut mutator = Mutator::new(1);
        let begun = Instant::now();
        let (mut posts, mut statuses) = (0_u64, std::collections::BTreeMap::<u16, u64>::new());
        while begun.elapsed() < patience {
            let body = mutator.mutant(&seeds);
            let answer = server.send("POST", path, &[("content-type", content_type)], &body);
            *statuses.entry(answer.status).or_default() += 1;
            posts += 1;
            let shown = || String::from_utf8_lossy(&body).into_owned();
            assert!(answer.status < 500, "{}: {}", answer.text(), shown());
            if answer.status >= 400 {
                answer.problem(answer.status);
            }
        }
        println!("{target}: {posts} posts in {:.0} s: {statuses:?}", begun.elapsed().as_secs_f64());
        assert!(posts > 20);
        // Near enough to get past the first check, and far enough not to pass.
        assert!(statuses.len() >= 2, "{statuses:?}");
    }
    assert!(server.is_alive());
    assert_eq!(server.get("/readyz").status, 200);
}
