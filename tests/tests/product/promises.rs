//! The tests that documents name exist: each in the last column of the tables of `docs/promises.md`, and
//! each file of tests that any page names.

use hemilux_tests::server::repository;
use hemilux_tests::sources::{Source, all_sources};

/// Where tests lie, with the files of each place.
struct Tests {
    /// Below `tests/tests`, named by path: `server/keys.rs`.
    of_product: Vec<Source>,
    /// Beside the code, named by module: `sqlite::tests`.
    of_crates: Vec<Source>,
}

impl Tests {
    fn new() -> Self {
        let of_crates =
            ["crates/server/src", "crates/engine/src", "crates/charts/src"].map(all_sources);
        Self { of_product: all_sources("tests/tests"), of_crates: of_crates.concat() }
    }

    /// The files that a place means: one by its path, or a module's with those below it. The module
    /// `tests` of a file may lie in it.
    fn files(&self, place: &str) -> Vec<&Source> {
        if place.ends_with(".rs") {
            return self.of_product.iter().filter(|source| source.path == place).collect();
        }
        let place = place.replace('/', "::");
        let above = place.strip_suffix("::tests").unwrap_or(&place);
        let named: Vec<String> = above.split("::").map(str::to_owned).collect();
        let is_meant = |source: &&Source| {
            let module = source.module();
            module.windows(named.len()).any(|part| part == named)
        };
        self.of_crates.iter().filter(is_meant).collect()
    }

    /// What is wrong with one name in a row; `place` is where the names without one belong.
    fn judge<'a>(&self, name: &'a str, place: &mut &'a str) -> Option<String> {
        if name.starts_with("scripts/") || name.starts_with("tests/") {
            return (!repository().join(name).exists()).then(|| format!("{name}: no such file"));
        }
        let function = match name.split_once(": ") {
            Some((before, function)) => {
                *place = before;
                Some(function)
            }
            None if name.ends_with(".rs") => {
                *place = name;
                None
            }
            None if name.contains("::") || name.contains('/') => match name.rsplit_once("::") {
                // `module::tests::name`
                Some((before, function)) if self.files(name).is_empty() => {
                    *place = before;
                    Some(function)
                }
                _ => {
                    *place = name;
                    None
                }
            },
            None => Some(name),
        };
        let files = self.files(place);
        let proves = |source: &&Source| match function {
            Some(function) => has_function(&source.text, function),
            None => {
                ["#[test]", "#[tokio::test", "pub async fn"].iter().any(|t| source.text.contains(t))
            }
        };
        let found = files.iter().any(proves);
        (!found).then(|| format!("{name}: not in {place} ({} files)", files.len()))
    }
}

/// Whether a text has a function of that name, or one that begins so where the name ends with `…`.
fn has_function(text: &str, name: &str) -> bool {
    match name.strip_suffix('…') {
        Some(start) => text.contains(&format!("fn {start}")),
        None => text.contains(&format!("fn {name}(")),
    }
}

/// Whatever stands between backticks.
fn code_spans(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Whether what stands between backticks is the name of a test or of where tests lie.
fn names_a_test(span: &str) -> bool {
    let named = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "_:/. …".contains(c);
    let is_word = !span.contains(['_', ':', '/', '.']);
    span.chars().all(named) && !is_word && !span.starts_with('/')
}

/// What is wrong with the names in a page's tables, and how many there are.
fn wrong_names(tests: &Tests, page: &str) -> (Vec<String>, usize) {
    let (mut wrong, mut count) = (Vec::new(), 0);
    for row in page.lines().filter(|line| line.starts_with('|')) {
        let proof = row.trim_end_matches('|').rsplit('|').next().unwrap_or("");
        let mut place = "";
        for name in code_spans(proof).filter(|span| names_a_test(span)) {
            count += 1;
            wrong.extend(tests.judge(name, &mut place));
        }
    }
    (wrong, count)
}

#[test]
fn every_test_that_a_promise_names_exists() {
    let page = std::fs::read_to_string(repository().join("docs/promises.md")).expect("it is there");
    let page = page.split("## The kill loop at full size").next().unwrap_or("");
    let tests = Tests::new();
    let (wrong, count) = wrong_names(&tests, page);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count > 100, "only {count} names are found");
}

#[test]
fn a_name_that_is_wrong_is_found() {
    let tests = Tests::new();
    let planted = "\
| right | `product/promises.rs: a_name_that_is_wrong_is_found`, `every_test_that_…`; `leases::store_tests: clocks_may_jump` |
| right | `store::conformance`; `memory::tests`; `scripts/test`; `Idempotency-Key` and `kill -9` |
| another name | `product/promises.rs: a_name_that_nothing_has` |
| another beginning | `product/promises.rs: every_test_of_…` |
| another file | `server/keys.rs: a_name_that_is_wrong_is_found` |
| no file | `server/locks.rs` |
| after another file | `server/keys.rs`, `a_name_that_is_wrong_is_found` |
| no module | `store::nothing: clocks_may_jump` |
| no script | `scripts/untested` |
";
    let (wrong, count) = wrong_names(&tests, planted);
    let lines: Vec<&str> = wrong.iter().filter_map(|line| line.split(':').next()).collect();
    assert_eq!((lines.len(), count), (7, 14), "{wrong:#?}");
}

/// Files of tests that any page or the sources' own comments name.
#[test]
fn files_of_tests_that_pages_name_exist() {
    let pages =
        ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(|name| repository().join(name));
    let docs = std::fs::read_dir(repository().join("docs")).expect("docs can be listed");
    let docs = docs.map(|entry| entry.expect("docs can be listed").path());
    let mut count = 0;
    for page in docs.chain(pages).filter(|path| path.extension().is_some_and(|e| e == "md")) {
        let text = std::fs::read_to_string(&page).expect("pages can be read");
        for name in
            code_spans(&text).filter(|span| span.starts_with("tests/") && names_a_test(span))
        {
            count += 1;
            assert!(repository().join(name).exists(), "{} names {name}", page.display());
        }
    }
    assert!(count >= 5, "only {count} names are found");
}
