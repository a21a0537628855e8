//! Which file of a crate imports from which, read from the sources, and the circles in that.
//!
//! An import is a leaf of a `use` tree or a path in the code that begins with `crate`, `self` or `super`;
//! where it is asked for, also one that begins with a module declared here or with a name that a `use`
//! brought in ([`Counted`]). It counts as an import of the file that defines the name, through
//! re-exports; where that cannot be told (a glob of a module, a name that a macro makes), of the module
//! that it was asked of. `mod x;` alone imports nothing.

use crate::sources::Source;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// A path's segments.
type Path = Vec<String>;

/// Which paths in the code count as imports; those of `use` always do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Counted {
    /// Those that begin with `crate`, `self` or `super`.
    Rooted,
    /// Those too that begin with a module declared there or a name that a `use` brought in: where
    /// `mod child;` is declared, `child::run()` imports from `child`.
    All,
}

/// What a module, in a file of its own or within another's, defines and imports.
#[derive(Default)]
struct Module {
    file: usize,
    defined: BTreeSet<String>,
    /// Names that `use` brings in, with the path as written.
    bound: BTreeMap<String, Path>,
    /// Modules whose names `use …::*` brings in.
    globs: Vec<Path>,
    /// Every path that it names, and whether that counts only among [`Counted::All`].
    named: Vec<(Path, bool)>,
}

/// A crate's files, and who imports what from whom.
pub struct ImportGraph {
    files: Vec<String>,
    /// By importing and imported file, the paths as written.
    edges: BTreeMap<(usize, usize), BTreeSet<String>>,
}

/// Files each of which imports from the next, by way of others of them, and so from itself.
#[derive(Clone, Debug)]
pub struct Circle {
    /// The files, sorted.
    pub files: Vec<String>,
    /// Importing file, imported file, paths as written.
    pub imports: Vec<(String, String, Vec<String>)>,
}

impl fmt::Display for Circle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "circle of {}:", self.files.join(", "))?;
        for (from, to, names) in &self.imports {
            writeln!(f, "    {from} imports from {to}: {}", names.join(", "))?;
        }
        Ok(())
    }
}

impl ImportGraph {
    /// The graph of a crate's files.
    pub fn new(sources: &[Source], counted: Counted) -> Self {
        let mut modules = BTreeMap::new();
        for (file, source) in sources.iter().enumerate() {
            Reader::new(source, file, &mut modules).read();
        }
        let mut edges: BTreeMap<(usize, usize), BTreeSet<String>> = BTreeMap::new();
        for (at, module) in &modules {
            let counts = |bare: bool| counted == Counted::All || !bare;
            for path in module.named.iter().filter(|(_, bare)| counts(*bare)).map(|(path, _)| path)
            {
                let imported = |path| definer(&modules, &absolute(&modules, at, path, 0)?, 0);
                let Some(to) = imported(path).filter(|to| *to != module.file) else { continue };
                // `Color::Red` is no news where `use` has brought in Color from there.
                let first = module.bound.get(&path[0]).filter(|written| *written != path);
                if first.and_then(|written| imported(written)) != Some(to) {
                    edges.entry((module.file, to)).or_default().insert(path.join("::"));
                }
            }
        }
        Self { files: sources.iter().map(|source| source.path.clone()).collect(), edges }
    }

    /// Every import: importing file, imported file, paths as written.
    pub fn imports(&self) -> impl Iterator<Item = (&str, &str, Vec<String>)> {
        self.edges.iter().map(|((from, to), names)| {
            (&*self.files[*from], &*self.files[*to], names.iter().cloned().collect())
        })
    }

    /// All circles, each as large as it gets: the strongly connected components of more than one file.
    pub fn circles(&self) -> Vec<Circle> {
        let mut after = vec![Vec::new(); self.files.len()];
        for (from, to) in self.edges.keys() {
            after[*from].push(*to);
        }
        let reached: Vec<Vec<bool>> =
            (0..after.len()).map(|from| reachable(&after, from)).collect();
        let mut seen = vec![false; after.len()];
        let mut circles = Vec::new();
        for file in 0..after.len() {
            let both = |other: &usize| reached[file][*other] && reached[*other][file];
            let files: Vec<usize> = (0..after.len()).filter(both).collect();
            if !seen[file] && files.len() > 1 {
                files.iter().for_each(|file| seen[*file] = true);
                circles.push(self.circle(&files));
            }
        }
        circles
    }

    fn circle(&self, files: &[usize]) -> Circle {
        let within = |(from, to): &(usize, usize)| files.contains(from) && files.contains(to);
        let imports = self.edges.iter().filter(|(ends, _)| within(ends));
        let name = |file: usize| self.files[file].clone();
        let mut names: Vec<String> = files.iter().map(|file| name(*file)).collect();
        names.sort();
        Circle {
            files: names,
            imports: imports
                .map(|((from, to), names)| {
                    (name(*from), name(*to), names.iter().cloned().collect())
                })
                .collect(),
        }
    }
}

/// Which files can be reached from one in at least one step.
fn reachable(after: &[Vec<usize>], from: usize) -> Vec<bool> {
    let mut reached = vec![false; after.len()];
    let mut next = after[from].clone();
    while let Some(file) = next.pop() {
        if !std::mem::replace(&mut reached[file], true) {
            next.extend(&after[file]);
        }
    }
    reached
}

/// Steps after which a chain of re-exports is one that never ends.
const LONGEST_CHAIN: usize = 32;

/// The path from the crate's root that a path in the module `at` means; `None` for those of other
/// crates and for names that are not modules.
fn absolute(
    modules: &BTreeMap<Path, Module>,
    at: &[String],
    path: &[String],
    steps: usize,
) -> Option<Path> {
    let first = path.first()?;
    let rest = &path[1..];
    match first.as_str() {
        "crate" => Some(rest.to_vec()),
        "self" => Some([at, rest].concat()),
        "super" => {
            let ups = path.iter().take_while(|segment| *segment == "super").count();
            let base = at.get(..at.len().checked_sub(ups)?)?;
            Some([base, &path[ups..]].concat())
        }
        _ if modules.contains_key(&[at, &path[..1]].concat()) => Some([at, path].concat()),
        _ => {
            let written = modules.get(at)?.bound.get(first)?;
            // `use std;` binds its own name.
            let goes_on = steps < LONGEST_CHAIN && written.first() != Some(first);
            let base = goes_on.then(|| absolute(modules, at, written, steps + 1))??;
            Some([&base, rest].concat())
        }
    }
}

/// The file that defines what an absolute path names.
fn definer(modules: &BTreeMap<Path, Module>, path: &[String], steps: usize) -> Option<usize> {
    let length = (0..=path.len()).rev().find(|length| modules.contains_key(&path[..*length]))?;
    let (at, rest) = path.split_at(length);
    let module = modules.get(at)?;
    let Some(name) = rest.first() else { return Some(module.file) };
    if steps > LONGEST_CHAIN || module.defined.contains(name) {
        return Some(module.file);
    }
    if let Some(written) = module.bound.get(name) {
        let there = absolute(modules, at, written, 0);
        return match there {
            Some(there) => definer(modules, &[&there, &rest[1..]].concat(), steps + 1),
            None => Some(module.file),
        };
    }
    for glob in &module.globs {
        let there = absolute(modules, at, glob, 0).filter(|there| there != at);
        let from = there.as_ref().and_then(|there| modules.get(there));
        let has = |from: &Module| from.defined.contains(name) || from.bound.contains_key(name);
        if let Some(there) = there.filter(|_| from.is_some_and(has)) {
            return definer(modules, &[&there, rest].concat(), steps + 1);
        }
    }
    Some(module.file)
}

/// Keywords that a defined name follows.
const DEFINING: [&str; 8] = ["fn", "struct", "enum", "trait", "type", "const", "static", "union"];

/// Reads one file's tokens into modules.
struct Reader<'a> {
    tokens: Vec<String>,
    file: usize,
    modules: &'a mut BTreeMap<Path, Module>,
    /// The module that is being read.
    at: Path,
    /// How many braces were open where each module within the file began.
    begun: Vec<usize>,
    depth: usize,
}

impl<'a> Reader<'a> {
    fn new(source: &Source, file: usize, modules: &'a mut BTreeMap<Path, Module>) -> Self {
        let (tokens, at) = (source.tokens(), source.module());
        Self { tokens, file, modules, at, begun: Vec::new(), depth: 0 }
    }

    fn token(&self, index: usize) -> &str {
        self.tokens.get(index).map_or("", String::as_str)
    }

    fn module(&mut self) -> &mut Module {
        let file = self.file;
        self.modules.entry(self.at.clone()).or_insert_with(|| Module { file, ..Module::default() })
    }

    fn read(mut self) {
        self.module();
        let mut index = 0;
        while index < self.tokens.len() {
            index = self.step(index);
        }
    }

    /// Reads what begins at a token, and says where to go on.
    fn step(&mut self, index: usize) -> usize {
        let next = self.token(index + 1).to_owned();
        match self.token(index) {
            "mod" if self.token(index + 2) == "{" => {
                self.begun.push(self.depth);
                self.depth += 1;
                self.at.push(next);
                self.module();
                return index + 3;
            }
            // Not the `use<'a>` of a type.
            "use" if next != "<" => return self.tree(index + 1, &mut Vec::new()),
            "{" => self.depth += 1,
            "}" => {
                self.depth = self.depth.saturating_sub(1);
                if self.begun.last() == Some(&self.depth) {
                    self.begun.pop();
                    self.at.pop();
                }
            }
            "macro_rules" => {
                let name = self.token(index + 2).to_owned();
                self.module().defined.insert(name);
            }
            word if DEFINING.contains(&word) => {
                let outermost = self.begun.last().map_or(0, |depth| depth + 1);
                if self.depth == outermost {
                    self.module().defined.insert(next);
                }
            }
            word if next == "::" && is_name(word) => return self.path(index),
            _ => {}
        }
        index + 1
    }

    /// Reads a path in the code.
    fn path(&mut self, mut index: usize) -> usize {
        let before = |steps: usize| index.checked_sub(steps).map_or("", |at| self.token(at));
        // What goes on a type, `<T as U>::name`, and where something is visible, `pub(in crate::x)`.
        let counts = before(1) != "::" && !(before(1) == "in" && before(2) == "(");
        let mut path = vec![self.token(index).to_owned()];
        while self.token(index + 1) == "::" && is_name(self.token(index + 2)) {
            path.push(self.token(index + 2).to_owned());
            index += 2;
        }
        if counts && path.len() > 1 {
            let bare = !matches!(path[0].as_str(), "crate" | "self" | "super");
            self.module().named.push((path, bare));
        }
        index + 1
    }

    /// Reads a `use` tree whose part before is `base`, to behind what ends it.
    fn tree(&mut self, mut index: usize, base: &mut Path) -> usize {
        let (mut path, mut alias) = (base.clone(), None);
        loop {
            match self.token(index) {
                "{" => {
                    index += 1;
                    while !matches!(self.token(index), "}" | "") {
                        index = self.tree(index, &mut path);
                    }
                    index += 1;
                    let ends = matches!(self.token(index), "," | ";");
                    return if ends { index + 1 } else { index };
                }
                "as" => {
                    alias = Some(self.token(index + 1).to_owned());
                    index += 1;
                }
                "*" => {
                    self.module().globs.push(path.clone());
                    self.module().named.push((path.clone(), false));
                    path.clear();
                }
                end @ ("," | ";" | "}" | "") => {
                    let ends = matches!(end, "," | ";");
                    self.leaf(path, alias);
                    return if ends { index + 1 } else { index };
                }
                "::" => {}
                segment => path.push(segment.to_owned()),
            }
            index += 1;
        }
    }

    fn leaf(&mut self, mut path: Path, alias: Option<String>) {
        // `a::{self}` is a; `self::a` keeps its beginning.
        if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
            path.pop();
        }
        let Some(last) = path.last().cloned() else { return };
        let module = self.module();
        module.bound.insert(alias.unwrap_or(last), path.clone());
        module.named.push((path, false));
    }
}

fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sources::shipped;

    fn planted(files: &[(&str, &str)], counted: Counted) -> ImportGraph {
        let sources = files.iter().map(|(path, text)| Source::planted(path, text));
        ImportGraph::new(&shipped(sources.collect()), counted)
    }

    #[test]
    fn planted_circles_are_found() {
        let root = ("lib.rs", "pub mod a; pub mod b; pub mod c;");
        let circles: &[(&str, &[(&str, &str)])] = &[
            (
                "super",
                &[
                    ("a/mod.rs", "mod x; use x::X; pub struct A;"),
                    ("a/x.rs", "use super::A; pub struct X;"),
                ],
            ),
            (
                "a re-export",
                &[
                    ("a/mod.rs", "mod x; mod y; pub use x::X; pub use y::Y;"),
                    ("a/x.rs", "use super::Y; pub struct X;"),
                    ("a/y.rs", "use crate::a::X; pub struct Y;"),
                ],
            ),
            (
                "a glob re-export",
                &[
                    ("a/mod.rs", "mod x; pub use x::*;"),
                    ("a/x.rs", "pub struct X(crate::b::B);"),
                    ("b.rs", "use crate::a::X; pub struct B;"),
                ],
            ),
            (
                "nested braces",
                &[
                    ("a.rs", "use crate::{b::{self as other, inner::{B, *}}, c::C}; pub fn a() {}"),
                    ("b/mod.rs", "pub mod inner;"),
                    ("b/inner.rs", "use {std::fmt, crate::a::{self}}; pub struct B;"),
                ],
            ),
            (
                "paths in the code",
                &[
                    ("a.rs", "pub fn a() -> u32 { crate::b::B.value() }"),
                    ("b.rs", "pub struct B; fn b() { super::a::a(); }"),
                ],
            ),
            (
                "a bare path from a module that is imported",
                &[
                    ("a.rs", "use crate::b; pub struct A; fn f() { b::inner::go() }"),
                    ("b/mod.rs", "pub mod inner;"),
                    ("b/inner.rs", "use crate::a::A; pub fn go() {}"),
                ],
            ),
            (
                "a bare path from a module that is declared",
                &[
                    ("a/mod.rs", "mod x; pub struct A; fn f() { x::go() }"),
                    ("a/x.rs", "use super::A; pub fn go() {}"),
                ],
            ),
            (
                "another name",
                &[
                    ("a.rs", "use crate::b::B as Other; pub struct A;"),
                    ("b.rs", "pub use crate::c::C as B;"),
                    ("c.rs", "use crate::a::A; pub struct C;"),
                ],
            ),
            (
                "a module within a file",
                &[
                    ("a.rs", "mod within { use super::super::b::B; } pub struct A;"),
                    ("b.rs", "use crate::a::A; pub struct B;"),
                ],
            ),
            (
                "three files",
                &[
                    ("a.rs", "use crate::b::B; pub struct A;"),
                    ("b.rs", "use crate::c::C; pub struct B;"),
                    ("c.rs", "#[cfg(test)] mod tests { } use crate::a::A; pub struct C;"),
                ],
            ),
        ];
        for (what, files) in circles {
            let files: Vec<(&str, &str)> =
                [root].into_iter().chain(files.iter().copied()).collect();
            assert_eq!(planted(&files, Counted::All).circles().len(), 1, "by {what}");
            let rooted = planted(&files, Counted::Rooted).circles().len();
            assert_eq!(rooted, usize::from(!what.starts_with("a bare path")), "by {what}");
        }
    }

    #[test]
    fn what_is_no_circle_is_not_taken_for_one() {
        let root = ("lib.rs", "pub mod a; pub mod b; pub mod c;");
        let straight: &[(&str, &[(&str, &str)])] = &[
            (
                "a module is declared",
                &[("a/mod.rs", "pub mod x; pub struct A;"), ("a/x.rs", "use super::A;")],
            ),
            (
                "the one file's name goes by way of the other",
                &[
                    ("a/mod.rs", "mod x; mod y; pub use x::X; pub use y::Y;"),
                    ("a/x.rs", "pub struct X;"),
                    ("a/y.rs", "use super::X; pub struct Y;"),
                ],
            ),
            (
                "tests import",
                &[
                    (
                        "a.rs",
                        "pub struct A; #[cfg(test)] mod tests { use crate::b::B; } #[cfg(test)] use crate::b::C;",
                    ),
                    ("b.rs", "use crate::a::A; pub struct B;"),
                ],
            ),
            (
                "files of tests import",
                &[
                    (
                        "a/mod.rs",
                        "use crate::b::B; #[cfg(test)] mod plants; #[cfg(test)] pub mod tests;",
                    ),
                    ("a/tests.rs", "pub struct T;"),
                    ("a/plants.rs", "use super::A;"),
                    ("b.rs", "pub struct B; #[cfg(test)] mod tests { use crate::a::tests::T; }"),
                ],
            ),
            (
                "words in comments and strings",
                &[
                    (
                        "a.rs",
                        "// use crate::b::B;\n/* crate::b::B */ const A: &str = \"crate::b::B\";",
                    ),
                    ("b.rs", "use crate::a::A; pub struct B;"),
                ],
            ),
            (
                "visible within",
                &[
                    ("a.rs", "pub(in crate::b) struct A;"),
                    ("b.rs", "use crate::a::A; pub struct B;"),
                ],
            ),
            (
                "another crate's names",
                &[
                    ("a.rs", "use other::b::B; fn f() { b::go() }"),
                    ("b.rs", "use crate::a::A; pub fn go() {}"),
                ],
            ),
        ];
        for (what, files) in straight {
            let files: Vec<(&str, &str)> =
                [root].into_iter().chain(files.iter().copied()).collect();
            let circles = planted(&files, Counted::All).circles();
            assert!(circles.is_empty(), "{what}: {}", circles[0]);
        }
    }
}
