//! Files import one way: no file imports from itself by way of others, and the engine's modules import
//! only those before them in the order that light takes.

use hemilux_tests::import_graph::{Counted, ImportGraph};
use hemilux_tests::server::repository;
use hemilux_tests::sources::{Source, all_sources, shipped};
use std::collections::BTreeSet;

/// The crates' sources, as folders of the repository.
const CRATES: [&str; 4] =
    ["crates/engine/src", "crates/charts/src", "crates/server/src", "bench/src"];

/// The engine's modules in the order that light takes; each may import from those before it.
const ORDER: [&str; 19] = [
    "angles",
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

/// The circles of a graph, each by name.
fn named_circles(graph: &ImportGraph) -> Vec<String> {
    graph.circles().iter().map(ToString::to_string).collect()
}

/// Modules that are declared in a file and then called (`child::run()`) count as imported, too.
#[test]
fn no_file_imports_from_itself_by_way_of_others() {
    for folder in CRATES {
        let graph = ImportGraph::new(&shipped(all_sources(folder)), Counted::All);
        let imports = graph.imports().count();
        assert!(imports > 10, "{folder}: only {imports} imports are found");
        let circles = named_circles(&graph);
        assert!(circles.is_empty(), "{folder}: {}", circles.join("\n"));
    }
}

#[test]
fn circles_are_named() {
    let files = [("lib.rs", ""), ("a.rs", "use crate::b::B;"), ("b.rs", "use crate::a::A;")];
    let circles = named_circles(&planted(&files, Counted::Rooted)).join("\n");
    assert!(circles.contains("circle of a.rs, b.rs"), "{circles}");
    assert!(circles.contains("a.rs imports from b.rs: crate::b::B"), "{circles}");
    assert!(named_circles(&planted(&files[..2], Counted::Rooted)).is_empty());
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
