//! Imports point one way. Each rule reads the sources as text, and each has a planted violation
//! that it must find.

use hemilux_tests::server::repository;
use std::path::{Path, PathBuf};

/// A source file: path relative to its crate's `src`, with `/`, and the text.
struct Source {
    path: String,
    text: String,
}

impl Source {
    fn planted(path: &str, text: &str) -> Self {
        Self { path: path.into(), text: text.into() }
    }

    /// The module path, `scene/gltf/node.rs` being `scene::gltf::node`.
    fn module(&self) -> String {
        let path = self.path.trim_end_matches(".rs").trim_end_matches("/mod");
        path.replace('/', "::")
    }

    /// Lines of code: without comments and without what follows `#[cfg(test)]`.
    fn code(&self) -> impl Iterator<Item = &str> {
        let shipped = self.text.split("#[cfg(test)]").next().unwrap_or("");
        shipped.lines().map(|line| line.split("//").next().unwrap_or("")).filter(|l| !l.is_empty())
    }

    fn is_within(&self, modules: &[&str]) -> bool {
        let module = self.module();
        modules.iter().any(|m| module == *m || module.starts_with(&format!("{m}::")))
    }
}

fn sources(krate: &str) -> Vec<Source> {
    let root = repository().join("crates").join(krate).join("src");
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("sources can be listed") {
            let path = entry.expect("sources can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                found.push(Source { path: relative(&root, &path), text: read(&path) });
            }
        }
    }
    assert!(found.len() > 5, "the sources of {krate} are not where they were");
    found
}

fn relative(root: &Path, path: &Path) -> String {
    path.strip_prefix(root).expect("below the root").to_string_lossy().replace('\\', "/")
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
    let users = sources.iter().filter(|source| !source.is_within(&allowed));
    users
        .filter(|source| source.code().any(|line| names(line, "hemilux_engine")))
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
    let users = sources.iter().filter(|source| !source.is_within(&["cli::compare"]));
    users.filter(|s| !s.code().all(drawn)).map(|s| s.path.clone()).collect()
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
    let users = sources.iter().filter(|source| !source.is_within(&allowed));
    users.filter(|s| s.code().any(touches)).map(|s| s.path.clone()).collect()
}

/// The engine's modules in the order that light takes; each may name those before it.
const ORDER: [&str; 14] = [
    "radiometry",
    "random",
    "scene",
    "checkpoint",
    "rays",
    "patches",
    "hemicube",
    "raster",
    "device",
    "form_factors",
    "image",
    "measurement",
    "render",
    "transport",
];

/// Names that point against [`ORDER`] on purpose: the facade calls the methods, which speak its
/// words (requests and progress).
const FACADE: (&str, &str) = ("render", "transport");

/// Rule 4: engine modules name only modules before them.
fn backward_imports(sources: &[Source]) -> Vec<String> {
    let rank = |module: &str| ORDER.iter().position(|known| *known == module);
    let mut violations = Vec::new();
    for source in sources {
        let module = source.module();
        let top = module.split("::").next().unwrap_or("");
        let Some(own) = rank(top) else { continue };
        for line in source.code() {
            for (at, _) in line.match_indices("crate::") {
                let rest = &line[at + "crate::".len()..];
                let named: Vec<&str> = match rest.strip_prefix('{') {
                    Some(list) => list.split(',').map(str::trim).collect(),
                    None => vec![rest],
                };
                for target in named {
                    let target = target.split(|c: char| !(c.is_alphanumeric() || c == '_')).next();
                    let target = target.unwrap_or("");
                    let backward = rank(target).is_some_and(|rank| rank > own);
                    if backward && (top, target) != FACADE {
                        violations.push(format!("{}: {}", source.path, line.trim()));
                    }
                }
            }
        }
    }
    violations
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

#[test]
fn engine_modules_follow_the_light() {
    let engine = sources("engine");
    assert_eq!(backward_imports(&engine), Vec::<String>::new());
    for source in &engine {
        let module = source.module();
        let top = module.split("::").next().unwrap_or("");
        assert!(top == "lib" || ORDER.contains(&top), "{top} has no place in the order yet");
    }
    let planted = [
        Source::planted("scene/mod.rs", "use crate::radiometry::Rgb;"),
        Source::planted("scene/mod.rs", "use crate::patches::PatchedScene;"),
        Source::planted("hemicube.rs", "fn f() { crate::device::open(\"cpu\"); }"),
        Source::planted("radiometry.rs", "use crate::{random, scene};"),
        Source::planted("render.rs", "crate::transport::run(device, request, observer)"),
    ];
    let found = backward_imports(&planted);
    assert_eq!(found.len(), 4, "{found:?}");
    assert!(!found.iter().any(|violation| violation.starts_with("render.rs")));
}
