//! Files import one way: no file imports from itself by way of others, and the engine's modules import
//! only those before them in the order that light takes.

use hemilux_tests::import_graph::{Circle, Counted, ImportGraph};
use hemilux_tests::server::repository;
use hemilux_tests::sources::{Source, all_sources, shipped};
use std::collections::BTreeSet;

/// The crates' sources, as folders of the repository.
const CRATES: [&str; 4] =
    ["crates/engine/src", "crates/charts/src", "crates/server/src", "bench/src"];

/// Circles that there still are, each as its folder and its files in order. A new one fails the test,
/// and so does one that is gone but still stands here: the list only becomes shorter.
const KNOWN: &[(&str, &[&str])] = &[
    ("crates/charts/src", &["comparison/mod.rs", "comparison/reference.rs"]),
    (
        "crates/server/src",
        &[
            "artifacts.rs",
            "artifacts/content.rs",
            "artifacts/kept.rs",
            "artifacts/orphans.rs",
            "artifacts/stream.rs",
        ],
    ),
    (
        "crates/server/src",
        &["backup/copy.rs", "backup/mod.rs", "backup/restore.rs", "backup/take.rs"],
    ),
    (
        "crates/server/src",
        &[
            "http/audit.rs",
            "http/events.rs",
            "http/fresh.rs",
            "http/jobs.rs",
            "http/mod.rs",
            "http/probes.rs",
            "http/problem.rs",
            "http/read.rs",
            "http/scenes.rs",
            "http/spool.rs",
            "http/upload.rs",
            "key_watch.rs",
            "retention.rs",
            "service.rs",
            "webhooks/mod.rs",
            "worker/mod.rs",
        ],
    ),
    (
        "crates/server/src",
        &[
            "store/bytes.rs",
            "store/keys.rs",
            "store/meta.rs",
            "store/mod.rs",
            "store/outbox.rs",
            "store/retention.rs",
            "store/scenes.rs",
        ],
    ),
    (
        "crates/server/src",
        &[
            "store/sqlite/bytes.rs",
            "store/sqlite/jobs.rs",
            "store/sqlite/outbox.rs",
            "store/sqlite/retention.rs",
            "store/sqlite/solutions.rs",
        ],
    ),
];

/// The same of the circles that there are where every path counts ([`Counted::All`]).
const KNOWN_OF_ALL_PATHS: &[(&str, &[&str])] = &[
    ("crates/charts/src", &["comparison/mod.rs", "comparison/reference.rs"]),
    (
        "crates/server/src",
        &[
            "artifacts.rs",
            "artifacts/content.rs",
            "artifacts/kept.rs",
            "artifacts/orphans.rs",
            "artifacts/stream.rs",
        ],
    ),
    (
        "crates/server/src",
        &["backup/copy.rs", "backup/mod.rs", "backup/restore.rs", "backup/take.rs"],
    ),
    (
        "crates/server/src",
        &[
            "cli/backup.rs",
            "cli/compare.rs",
            "cli/devices.rs",
            "cli/health.rs",
            "cli/keys.rs",
            "cli/mod.rs",
            "cli/render.rs",
            "cli/serve.rs",
        ],
    ),
    (
        "crates/server/src",
        &[
            "http/access.rs",
            "http/audit.rs",
            "http/dashboard.rs",
            "http/docs.rs",
            "http/events.rs",
            "http/file.rs",
            "http/fresh.rs",
            "http/guard.rs",
            "http/images.rs",
            "http/jobs.rs",
            "http/listen.rs",
            "http/mod.rs",
            "http/openapi.rs",
            "http/pin.rs",
            "http/probes.rs",
            "http/problem.rs",
            "http/read.rs",
            "http/scenes.rs",
            "http/solutions.rs",
            "http/spool.rs",
            "http/traces.rs",
            "http/upload.rs",
            "http/webhooks.rs",
            "key_watch.rs",
            "retention.rs",
            "retention/sweep.rs",
            "service.rs",
            "webhooks/mod.rs",
            "worker/checkpoints.rs",
            "worker/job.rs",
            "worker/mod.rs",
            "worker/snapshots.rs",
            "worker/watch.rs",
        ],
    ),
    (
        "crates/server/src",
        &[
            "store/bytes.rs",
            "store/keys.rs",
            "store/meta.rs",
            "store/mod.rs",
            "store/outbox.rs",
            "store/retention.rs",
            "store/scenes.rs",
            "store/solutions.rs",
            "store/sqlite/bytes.rs",
            "store/sqlite/claims.rs",
            "store/sqlite/events.rs",
            "store/sqlite/jobs.rs",
            "store/sqlite/meta.rs",
            "store/sqlite/mod.rs",
            "store/sqlite/outbox.rs",
            "store/sqlite/retention.rs",
            "store/sqlite/rows.rs",
            "store/sqlite/scenes.rs",
            "store/sqlite/solutions.rs",
        ],
    ),
];

/// The engine's modules in the order that light takes; each may import from those before it.
const ORDER: [&str; 18] = [
    "radiometry",
    "random",
    "scene",
    "checkpoint",
    "rays",
    "sampling",
    "surface",
    "patches",
    "emitters",
    "filter",
    "hemicube",
    "raster",
    "device",
    "form_factors",
    "image",
    "measurement",
    "render",
    "transport",
];

fn planted(files: &[(&str, &str)], counted: Counted) -> ImportGraph {
    let sources: Vec<Source> =
        files.iter().map(|(path, text)| Source::planted(path, text)).collect();
    ImportGraph::new(&shipped(sources), counted)
}

/// What differs between the circles that there are and those that are known.
fn surprises(found: &[(&str, Circle)], known: &[(&str, &[&str])]) -> Vec<String> {
    let is_known = |folder: &str, circle: &Circle| {
        known.iter().any(|(where_, files)| *where_ == folder && circle.files == *files)
    };
    let new = found.iter().filter(|(folder, circle)| !is_known(folder, circle));
    let new = new.map(|(folder, circle)| format!("{folder}: a new {circle}"));
    let is_there = |(folder, files): &(&str, &[&str])| {
        found.iter().any(|(where_, circle)| where_ == folder && circle.files == *files)
    };
    let gone = known.iter().filter(|known| !is_there(known));
    let gone = gone.map(|(folder, files)| {
        format!("{folder}: no circle of {} any more: remove it from KNOWN", files.join(", "))
    });
    new.chain(gone).collect()
}

/// The top module that a file belongs to.
fn top(path: &str) -> &str {
    path.split('/').next().unwrap_or(path).trim_end_matches(".rs")
}

/// Imports of modules that come later in the order.
fn backward_imports(graph: &ImportGraph) -> Vec<String> {
    let rank = |module: &str| ORDER.iter().position(|known| *known == module);
    let is_backward = |from: &str, to: &str| {
        let (own, other) = (rank(top(from)), rank(top(to)));
        own.zip(other).is_some_and(|(own, other)| other > own)
    };
    let imports = graph.imports().filter(|(from, to, _)| is_backward(from, to));
    imports
        .map(|(from, to, names)| format!("{from} imports {} from {to}", names.join(", ")))
        .collect()
}

/// The engine's top modules in the order of ARCHITECTURE's list of them.
fn rows_of_architecture() -> Vec<String> {
    let text = std::fs::read_to_string(repository().join("ARCHITECTURE.md")).expect("it is there");
    let section = text.split("\n### ").find(|part| part.starts_with("`crates/engine/src`\n"));
    let rows = section.expect("a section about the engine").lines();
    let mut found: Vec<String> = Vec::new();
    for row in rows.filter_map(|line| line.strip_prefix("- `")) {
        let module = row.split(['`', ':']).next().unwrap_or("");
        if !found.iter().any(|known| known == module) {
            found.push(module.to_owned());
        }
    }
    found
}

/// Fails where the circles of all crates are not those that are known.
fn compare_circles(counted: Counted, known: &[(&str, &[&str])]) {
    let mut found: Vec<(&str, Circle)> = Vec::new();
    for folder in CRATES {
        let graph = ImportGraph::new(&shipped(all_sources(folder)), counted);
        let imports = graph.imports().count();
        assert!(imports > 10, "{folder}: only {imports} imports are found");
        found.extend(graph.circles().into_iter().map(|circle| (folder, circle)));
    }
    let surprises = surprises(&found, known);
    let listed =
        found.iter().map(|(folder, circle)| format!("(\"{folder}\", &{:?}),\n", circle.files));
    let listed: String = listed.collect();
    assert!(surprises.is_empty(), "\n{}\nAll that there are:\n{listed}", surprises.join("\n"));
}

#[test]
fn no_file_imports_from_itself_by_way_of_others() {
    compare_circles(Counted::Rooted, KNOWN);
}

/// The same where modules that are declared in the file and then called (`child::run()`) count too.
#[test]
fn no_file_calls_modules_that_import_from_it() {
    compare_circles(Counted::All, KNOWN_OF_ALL_PATHS);
}

/// A circle that is new and one that is gone both fail, each by name.
#[test]
fn new_circles_and_those_that_are_gone_are_named() {
    let graph = planted(
        &[("lib.rs", ""), ("a.rs", "use crate::b::B;"), ("b.rs", "use crate::a::A;")],
        Counted::Rooted,
    );
    let found: Vec<(&str, Circle)> = graph.circles().into_iter().map(|c| ("planted", c)).collect();
    let known: &[(&str, &[&str])] = &[("planted", &["a.rs", "b.rs"])];
    assert_eq!(surprises(&found, known), Vec::<String>::new());
    let new = surprises(&found, &[]).join("\n");
    assert!(new.contains("a new circle of a.rs, b.rs"), "{new}");
    assert!(new.contains("a.rs imports from b.rs: crate::b::B"), "{new}");
    let other: &[(&str, &[&str])] =
        &[("planted", &["a.rs", "b.rs"]), ("planted", &["c.rs", "d.rs"])];
    let gone = surprises(&found, other);
    assert_eq!(gone, ["planted: no circle of c.rs, d.rs any more: remove it from KNOWN"]);
}

#[test]
fn engine_modules_follow_the_light() {
    let sources = shipped(all_sources("crates/engine/src"));
    for source in &sources {
        let top = top(&source.path);
        assert!(top == "lib" || ORDER.contains(&top), "{top} has no place in the order yet");
    }
    assert_eq!(backward_imports(&ImportGraph::new(&sources, Counted::All)), Vec::<String>::new());
    let planted = planted(
        &[
            ("radiometry.rs", "use crate::{random::{self, Stream}, scene}; pub struct Rgb;"),
            ("random.rs", "pub struct Stream;"),
            ("scene/mod.rs", "pub mod inner; use crate::radiometry::Rgb; pub struct Scene;"),
            ("scene/inner.rs", "use super::super::patches::PatchedScene;"),
            ("patches/mod.rs", "use crate::scene::Scene; pub struct PatchedScene;"),
            ("hemicube.rs", "fn f() { crate::device::open(\"cpu\"); }"),
            ("device/mod.rs", "pub fn open(name: &str) {}"),
            ("transport/mod.rs", "pub fn run() -> crate::render::Limits {}"),
            ("render.rs", "pub struct Limits;"),
        ],
        Counted::All,
    );
    let found = backward_imports(&planted);
    let from: BTreeSet<&str> = found.iter().filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(Vec::from_iter(from), ["hemicube.rs", "radiometry.rs", "scene/inner.rs"]);
    assert_eq!(found.len(), 4, "{found:?}");
}

/// ARCHITECTURE says that each module uses only those above it in its list, so the list has the order
/// that is tested.
#[test]
fn architecture_has_the_engines_modules_in_their_order() {
    let rows = rows_of_architecture();
    let mut rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    assert_eq!(rows, ORDER);
    rows.swap(0, 1);
    assert_ne!(rows, ORDER, "swapped rows pass");
}
