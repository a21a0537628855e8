//! What may depend on what, beyond the order of files that `import_graph.rs` tests. Each rule reads the
//! sources as text, and each has a planted violation that it must find.

use hemilux_tests::server::repository;
use hemilux_tests::sources::{Source, all_sources, shipped};
use std::path::Path;

/// Whether a file belongs to one of these modules, or lies below it.
fn is_within(source: &Source, modules: &[&str]) -> bool {
    let module = source.module().join("::");
    modules.iter().any(|m| module == *m || module.starts_with(&format!("{m}::")))
}

fn sources(krate: &str) -> Vec<Source> {
    shipped(all_sources(&format!("crates/{krate}/src")))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("sources can be read")
}

/// Whether `line` names `word` as a whole path segment.
fn names(line: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices(word).any(|(at, _)| {
        !line[..at].ends_with(is_part) && !line[at + word.len()..].starts_with(is_part)
    })
}

/// Rule 1: the engine does no networking and knows no async runtime or database.
fn forbidden_dependencies(manifest: &str) -> Vec<String> {
    let forbidden = ["tokio", "axum", "sqlx", "tower", "tower-http", "hyper", "reqwest", "futures"];
    let mut in_dependencies = false;
    let mut violations = Vec::new();
    for line in manifest.lines().map(str::trim) {
        if line.starts_with('[') {
            in_dependencies = line.contains("dependencies");
        }
        let name = line.split(['.', '=', ' ']).next().unwrap_or("");
        if in_dependencies && forbidden.contains(&name) {
            violations.push(line.to_owned());
        }
    }
    violations
}

/// Rule 2: in the server, only the worker and the commands that render name the engine.
fn engine_users(sources: &[Source]) -> Vec<String> {
    let allowed = ["worker", "cli::render", "cli::compare"];
    let users = sources.iter().filter(|source| !is_within(source, &allowed));
    users
        .filter(|source| source.code().lines().any(|line| names(line, "hemilux_engine")))
        .map(|source| source.path.clone())
        .collect()
}

/// Rule 2b: what else of the server uses the charts draws with them. Their comparison renders,
/// and is for the command alone.
fn renderers_by_charts(sources: &[Source]) -> Vec<String> {
    let drawn = |line: &str| {
        let mut uses = line.match_indices("hemilux_charts").peekable();
        let named = uses.peek().is_some();
        let all_draw = uses.all(|(at, word)| line[at + word.len()..].starts_with("::chart"));
        !named || all_draw
    };
    let users = sources.iter().filter(|source| !is_within(source, &["cli::compare"]));
    users.filter(|s| !s.code().lines().all(drawn)).map(|s| s.path.clone()).collect()
}

/// Rule 3: in the engine, only the importer, the made scenes and pictures know file formats or
/// touch files.
fn file_users(sources: &[Source]) -> Vec<String> {
    let allowed = ["scene::gltf", "scene::made", "image", "checkpoint"];
    let touches = |line: &str| {
        // Asking the kernel how much memory there is reads no file of anyone's.
        (line.contains("std::fs") && !line.contains("\"/proc/"))
            || line.contains("std::net")
            || line.contains("serde_json")
            || line.trim_start().starts_with("use gltf")
            || (names(line, "image") && line.contains("image::load"))
    };
    let users = sources.iter().filter(|source| !is_within(source, &allowed));
    users.filter(|s| s.code().lines().any(touches)).map(|s| s.path.clone()).collect()
}

#[test]
fn the_engine_depends_on_no_network_runtime_or_database() {
    let manifest = read(&repository().join("crates/engine/Cargo.toml"));
    assert_eq!(forbidden_dependencies(&manifest), Vec::<String>::new());
    let planted = "[package]\nname = \"tokio\"\n[dependencies]\nglam.workspace = true\ntokio = \"1\"\n[target.'cfg(unix)'.dependencies]\naxum.workspace = true\n";
    assert_eq!(forbidden_dependencies(planted), ["tokio = \"1\"", "axum.workspace = true"]);
    let charts = read(&repository().join("crates/charts/Cargo.toml"));
    assert_eq!(forbidden_dependencies(&charts), Vec::<String>::new());
}

#[test]
fn only_worker_and_rendering_commands_name_the_engine() {
    assert_eq!(engine_users(&sources("server")), Vec::<String>::new());
    let planted = [
        Source::planted("worker/job.rs", "use hemilux_engine::render::render;"),
        Source::planted("cli/render.rs", "use hemilux_engine::render::render;"),
        Source::planted("cli/compare.rs", "use hemilux_engine::transport::REGISTRY;"),
        Source::planted("http/jobs.rs", "fn f() { hemilux_engine::device::list(); }"),
        Source::planted("workers.rs", "use hemilux_engine as engine;"),
        Source::planted("store/mod.rs", "// hemilux_engine is not for here"),
    ];
    assert_eq!(engine_users(&planted), ["http/jobs.rs", "workers.rs"]);
}

#[test]
fn only_the_compare_command_renders_by_charts() {
    assert_eq!(renderers_by_charts(&sources("server")), Vec::<String>::new());
    let planted = [
        Source::planted("cli/compare.rs", "use hemilux_charts::comparison::compare;"),
        Source::planted("http/charts.rs", "use hemilux_charts::chart::{Chart, Line};"),
        Source::planted("http/jobs.rs", "use hemilux_charts::comparison::compare;"),
        Source::planted("service.rs", "use hemilux_charts as charts;"),
        Source::planted("queue.rs", "// hemilux_charts::comparison is not for here"),
    ];
    assert_eq!(renderers_by_charts(&planted), ["http/jobs.rs", "service.rs"]);
}

#[test]
fn only_importer_and_pictures_know_files() {
    assert_eq!(file_users(&sources("engine")), Vec::<String>::new());
    let planted = [
        Source::planted("scene/gltf/node.rs", "use std::fs;"),
        Source::planted("image.rs", "std::fs::write(path, bytes)"),
        Source::planted("patches/mod.rs", "let text = std::fs::read_to_string(path);"),
        Source::planted("device/cpu/mod.rs", "use std::net::TcpStream;"),
        Source::planted("random.rs", "#[cfg(test)]\nmod tests { use std::fs; }"),
    ];
    assert_eq!(file_users(&planted), ["patches/mod.rs", "device/cpu/mod.rs"]);
}
