//! The product's own sources as text, for rules that read them: files of a crate, their code without
//! comments, strings and tests, and that code's tokens.

use crate::server::repository;
use std::path::{Path, PathBuf};

/// A source file.
#[derive(Clone, Debug)]
pub struct Source {
    /// Path relative to its crate's `src`, with `/`.
    pub path: String,
    /// The whole text.
    pub text: String,
}

impl Source {
    /// A file that is not there, for errors that a rule must find.
    pub fn planted(path: &str, text: &str) -> Self {
        Self { path: path.into(), text: text.into() }
    }

    /// The module path's segments, `scene/gltf/node.rs` being `scene`, `gltf`, `node`; none for the
    /// root.
    pub fn module(&self) -> Vec<String> {
        let path = self.path.trim_end_matches(".rs");
        let path = path.strip_suffix("/mod").unwrap_or(path);
        let is_root = matches!(path, "lib" | "main");
        let segments = path.split('/').filter(|_| !is_root);
        segments.map(str::to_owned).collect()
    }

    /// Lines of code with their strings, without comments and without what `#[cfg(test)]` marks.
    pub fn code(&self) -> String {
        without_tests(&without_comments(&self.text, Strings::Kept)).0
    }

    /// Modules that this file declares for tests alone and that lie in files of their own.
    fn test_modules(&self) -> Vec<Vec<String>> {
        let (_, names) = without_tests(&without_comments(&self.text, Strings::Blank));
        let below = |name| [self.module(), vec![name]].concat();
        names.into_iter().map(below).collect()
    }

    /// Tokens of the code: names, `::`, and any other character by itself; strings are empty.
    pub fn tokens(&self) -> Vec<String> {
        tokens(&without_tests(&without_comments(&self.text, Strings::Blank)).0)
    }
}

/// All source files below a folder of the repository, tests included, by path.
///
/// # Panics
/// Where the folder has hardly any: a rule over nothing would always hold.
pub fn all_sources(folder: &str) -> Vec<Source> {
    let root = repository().join(folder);
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("sources can be listed") {
            let path = entry.expect("sources can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = std::fs::read_to_string(&path).expect("sources can be read");
                found.push(Source { path: relative(&root, &path), text });
            }
        }
    }
    assert!(found.len() > 5, "the sources of {folder} are not where they were");
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

fn relative(root: &Path, path: &Path) -> String {
    path.strip_prefix(root).expect("below the root").to_string_lossy().replace('\\', "/")
}

/// The source files that ship: all but those of modules that are for tests.
pub fn shipped(sources: Vec<Source>) -> Vec<Source> {
    let tests: Vec<Vec<String>> = sources.iter().flat_map(Source::test_modules).collect();
    let ships = |source: &Source| {
        let module = source.module();
        !tests.iter().any(|test| module.starts_with(test))
    };
    sources.into_iter().filter(ships).collect()
}

/// What becomes of the insides of strings.
#[derive(Clone, Copy, PartialEq)]
enum Strings {
    Kept,
    Blank,
}

/// The text without comments. A line keeps its number.
fn without_comments(text: &str, strings: Strings) -> String {
    let mut rest = text;
    let mut code = String::with_capacity(text.len());
    while let Some(next) = rest.chars().next() {
        let before = code.chars().next_back();
        let (length, kept) = match next {
            '/' if rest.starts_with("//") => (rest.find('\n').unwrap_or(rest.len()), false),
            '/' if rest.starts_with("/*") => (block_comment(rest), false),
            '"' => (string(rest), strings == Strings::Kept),
            'r' if !before.is_some_and(is_name) && raw_string(rest).is_some() => {
                (raw_string(rest).unwrap_or(1), strings == Strings::Kept)
            }
            '\'' => (character(rest), true),
            _ => (next.len_utf8(), true),
        };
        let (part, after) = rest.split_at(length);
        if kept {
            code.push_str(part);
        } else {
            // A blank string is still a value, and lines are still lines.
            code.push_str(if part.starts_with('/') { " " } else { "\"\"" });
            code.extend(part.chars().filter(|c| *c == '\n'));
        }
        rest = after;
    }
    code
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Length of a block comment, which may hold others.
fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < text.len() {
        let here = &text[at..];
        if here.starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if here.starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
            if depth == 0 {
                return at;
            }
        } else {
            at += here.chars().next().map_or(1, char::len_utf8);
        }
    }
    text.len()
}

/// Length of a string with its quotes.
fn string(text: &str) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            '"' if !escaped => return at + 1,
            '\\' => escaped = !escaped,
            _ => escaped = false,
        }
    }
    text.len()
}

/// Length of a raw string, `r#"…"#`, where there is one.
fn raw_string(text: &str) -> Option<usize> {
    let inner = text.strip_prefix('r')?;
    let hashes = inner.len() - inner.trim_start_matches('#').len();
    let body = inner[hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    Some(body.find(&end).map_or(text.len(), |at| 1 + hashes + 1 + at + end.len()))
}

/// Length of a character, `'x'`; of a lifetime that of its quote.
fn character(text: &str) -> usize {
    let mut inside = text.char_indices().skip(1);
    match (inside.next(), inside.next()) {
        (Some((_, '\\')), Some((escaped, _))) => {
            text[escaped + 1..].find('\'').map_or(1, |end| escaped + 1 + end + 1)
        }
        (Some(_), Some((end, '\''))) => end + 1,
        _ => 1,
    }
}

/// Code without the items that `#[cfg(test)]` marks, and the names of the modules among them that
/// lie in other files.
fn without_tests(code: &str) -> (String, Vec<String>) {
    const MARK: &str = "#[cfg(test)]";
    let (mut shipped, mut modules) = (String::new(), Vec::new());
    let mut rest = code;
    while let Some(at) = rest.find(MARK) {
        let (before, marked) = rest.split_at(at);
        shipped.push_str(before);
        let item = &marked[MARK.len()..];
        let (head, after) = item.split_at(item_length(item));
        if head.ends_with(';') {
            let words = tokens(head);
            let named = words.iter().position(|word| word == "mod");
            modules.extend(named.and_then(|at| words.get(at + 1)).cloned());
        }
        shipped.extend(head.chars().filter(|c| *c == '\n'));
        rest = after;
    }
    shipped.push_str(rest);
    (shipped, modules)
}

/// Length of the item at the start: to the semicolon, or to the brace that closes its block.
fn item_length(item: &str) -> usize {
    let (mut depth, mut inside) = (0usize, 0usize);
    for (at, c) in item.char_indices() {
        match c {
            '(' | '[' => inside += 1,
            ')' | ']' => inside = inside.saturating_sub(1),
            '{' => depth += 1,
            '}' => {
                depth = depth.saturating_sub(1);
                // The braces of `use a::{b, c};` are not a block.
                if depth == 0 && !item[at + 1..].starts_with(';') {
                    return at + 1;
                }
            }
            ';' if depth == 0 && inside == 0 => return at + 1,
            _ => {}
        }
    }
    item.len()
}

/// Names, `::`, and every other character that is no white space, one by one.
fn tokens(code: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let length = if is_name(first) {
            rest.find(|c| !is_name(c)).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        found.push(rest[..length].to_owned());
        rest = rest[length..].trim_start();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_has_no_comments_and_no_tests() {
        let text = "use a::b; // crate::c\n/* crate::d /* e */ f */ let g = 'x'; let h: &'a str = \"// i\";\n\
                    #[cfg(test)]\nuse j::{k, l};\n#[cfg(test)]\nfn m(n: [u8; 2]) { o { p } }\nlet q = r#\"\"r\"#;\n\
                    #[cfg(test)]\nmod tests {\n use s;\n}\n#[cfg(test)]\npub(crate) mod plants;\nfn t() {}";
        let source = Source::planted("scene/mod.rs", text);
        let words = source.tokens();
        for gone in ["c", "d", "e", "f", "i", "j", "k", "l", "m", "o", "p", "r", "s", "plants"] {
            assert!(!words.iter().any(|word| word == gone), "{gone} is still there: {words:?}");
        }
        for stays in ["a", "b", "g", "h", "q", "t", "'"] {
            assert!(words.iter().any(|word| word == stays), "{stays} is gone: {words:?}");
        }
        assert!(source.code().contains("\"// i\"") && source.code().contains("r#\"\"r\"#"));
        assert_eq!(source.code().lines().count(), text.lines().count());
    }

    #[test]
    fn files_of_test_modules_do_not_ship() {
        let sources = vec![
            Source::planted("lib.rs", "mod a;\n#[cfg(test)]\nmod b;"),
            Source::planted("a.rs", "#[cfg(test)]\nmod tests;"),
            Source::planted("a/tests.rs", ""),
            Source::planted("a/tests/more.rs", ""),
            Source::planted("b.rs", ""),
            Source::planted("c.rs", "#[cfg(test)]\nmod tests { }"),
        ];
        let left: Vec<String> = shipped(sources).into_iter().map(|source| source.path).collect();
        assert_eq!(left, ["lib.rs", "a.rs", "c.rs"]);
    }

    #[test]
    fn modules_are_named_by_paths() {
        let module = |path| Source::planted(path, "").module().join("::");
        assert_eq!(module("scene/gltf/node.rs"), "scene::gltf::node");
        assert_eq!(module("scene/gltf/mod.rs"), "scene::gltf");
        assert_eq!((module("random.rs"), module("lib.rs")), ("random".into(), String::new()));
    }
}
