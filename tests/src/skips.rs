//! Tests that cannot run say so where everyone sees it. The test harness knows no skip at run time and
//! shows nothing that a passing test prints, so the line goes straight to the standard error stream,
//! where `scripts/test` counts it.

use std::io::Write;
use std::path::PathBuf;

/// What a line begins with whose test has checked nothing.
pub const SKIPPED: &str = "skipped: ";
/// What a line begins with whose test has left out a part and checked the rest.
pub const PARTLY_SKIPPED: &str = "partly skipped: ";

/// Says that the test that calls this checks nothing, and why. It has to return then.
pub fn skipped(why: &str) {
    say(SKIPPED, why);
}

/// Says that the test that calls this leaves out a part, and why.
pub fn partly_skipped(why: &str) {
    say(PARTLY_SKIPPED, why);
}

/// The harness names a test's thread after it.
fn say(what: &str, why: &str) {
    let thread = std::thread::current();
    let name = thread.name().unwrap_or("a test's thread");
    // `eprintln!` would be kept back. In one piece, since tests run beside each other.
    let line = format!("{what}{name}: {why}\n");
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// Whether `HEMILUX_NO_WGPU=1` says to do without GPUs, software ones included.
pub fn without_wgpu() -> bool {
    std::env::var_os("HEMILUX_NO_WGPU").is_some_and(|value| value == "1")
}

/// Where test data lies that is too large for the repository: `HEMILUX_SHARED_DIR`, or `shared` beside
/// the repository.
pub fn shared_folder() -> PathBuf {
    let beside = || crate::server::repository().join("../shared");
    std::env::var_os("HEMILUX_SHARED_DIR").map_or_else(beside, PathBuf::from)
}

/// Files of the shared test data, or the name of the first that is not there.
///
/// # Errors
/// Why the files cannot be had.
pub fn shared<const N: usize>(paths: [&str; N]) -> Result<[Vec<u8>; N], String> {
    let folder = shared_folder();
    let mut files = Vec::new();
    for path in paths {
        let file = std::fs::read(folder.join(path));
        files.push(file.map_err(|error| format!("shared test data, {path}: {error}"))?);
    }
    files.try_into().map_err(|_| unreachable!("as many files as paths"))
}

/// Files of the shared test data; where one is missing, the test is skipped.
pub fn shared_or_skip<const N: usize>(paths: [&str; N]) -> Option<[Vec<u8>; N]> {
    shared(paths).map_err(|why| skipped(&why)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// Set for this test where it runs itself as the one that asks for a file.
    const ASKS: &str = "HEMILUX_TEST_ASKS_FOR_A_SHARED_FILE";

    /// The harness keeps back what a passing test prints, but not that it is skipped.
    #[test]
    fn a_test_without_its_file_passes_and_says_that_it_is_skipped() {
        if std::env::var_os(ASKS).is_some() {
            let Some([file]) = shared_or_skip(["a/file.txt"]) else { return };
            assert_eq!(file, b"shared");
            return;
        }
        const NAME: &str =
            "skips::tests::a_test_without_its_file_passes_and_says_that_it_is_skipped";
        let folder = tempfile::tempdir().unwrap();
        let ask = || {
            let mut command = Command::new(std::env::current_exe().unwrap());
            command.args(["--exact", NAME, "--test-threads=2"]);
            command.env(ASKS, "1").env("HEMILUX_SHARED_DIR", folder.path());
            let output = command.output().unwrap();
            (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
        };
        let (passed, said) = ask();
        let begins = format!("skipped: {NAME}: shared test data, a/file.txt: ");
        assert!(passed && said.lines().any(|line| line.starts_with(&begins)), "{said}");
        std::fs::create_dir(folder.path().join("a")).unwrap();
        std::fs::write(folder.path().join("a/file.txt"), "shared").unwrap();
        assert_eq!(ask(), (true, String::new()));
        std::fs::write(folder.path().join("a/file.txt"), "another").unwrap();
        assert!(!ask().0, "another file passes");
    }
}
