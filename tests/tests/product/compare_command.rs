//! `hemilux compare`: every file that it writes, and that it judges rightly.

use hemilux_engine::image::Picture;
use hemilux_tests::server::program;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

fn compare(out: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(program());
    command.args(["compare", "cornell", "--device", "cpu", "--size", "40x40", "--out"]).arg(out);
    command.args(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn text(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The rows of the table by column, of cells without quotes.
fn rows(folder: &Path) -> Vec<BTreeMap<String, String>> {
    let text = text(folder, "comparison.csv");
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned));
    let header: Vec<String> = lines.next().unwrap().collect();
    lines.map(|cells| header.iter().cloned().zip(cells).collect()).collect()
}

fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name}: {:?}", row[name]))
}

/// Few patches and small hemicubes: fractions of a second.
const SMALL: [&str; 4] = ["--set", "patches=400", "--set", "hemicube_resolution=64"];

#[test]
fn methods_are_run_judged_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/folder");
    let mut arguments = vec!["--methods", "stochastic,ray-traced,gauss-seidel"];
    arguments.extend(["--seconds", "0.6,0.3", "--seeds", "2", "--reference-seconds", "3"]);
    arguments.extend(["--set", "gauss-seidel.patches=250"]);
    arguments.extend(SMALL);
    let done = compare(&out, &arguments);
    assert!(done.status.success(), "{}", said(&done));
    assert!(said(&done).contains("seed 2 of 2"), "progress: {}", said(&done));
    assert!(String::from_utf8_lossy(&done.stdout).starts_with("| method |"));

    let rows = rows(&out);
    assert_eq!(rows.len(), 3 * 2 * 2);
    for row in &rows {
        let method = row["method"].as_str();
        let options = match method {
            "gauss-seidel" => "patches=250",
            "stochastic" => "patches=400",
            // It has no patches.
            _ => "",
        };
        assert_eq!(row["options"].contains("patches="), !options.is_empty(), "{row:?}");
        assert!(row["options"].contains(options), "{row:?}");
        assert!(number(row, "seconds_solve") > 0.0 && number(row, "shots") > 0.0);
        assert!((number(row, "mean_ratio") - 1.0).abs() < 0.4, "{row:?}");
        let error = number(row, "rrmse");
        assert!((0.005..1.5).contains(&error.abs()), "{row:?}");
        assert!((number(row, "squared_error") - error * error.abs()).abs() < 1e-3);
        assert_eq!(method == "gauss-seidel", row["diagnostics"].contains("closure_mean"));
    }
    // The full matrix of 250 patches is solved within the first budget and not again.
    let solved: Vec<_> = rows.iter().filter(|row| row["method"] == "gauss-seidel").collect();
    assert!(solved.iter().all(|row| row["stopped"] == "converged"));
    let repeated = solved.iter().filter(|row| row["repeated"] == "true").count();
    assert_eq!(repeated, 2, "{solved:?}");

    let svg = text(&out, "chart.svg");
    let page = text(&out, "comparison.md");
    for method in ["stochastic", "ray-traced", "gauss-seidel"] {
        assert!(svg.contains(method) && page.contains(&format!("| {method} |")), "{method}");
    }
    assert!(svg.contains("<polygon"), "the spread is shaded");
    assert!(page.contains("its own noise, rRMSE") && page.contains("closure mean"), "{page}");
    for name in ["chart.png", "sheet.png"] {
        let picture = image::open(out.join(name)).unwrap();
        assert!(picture.width() > 500 && picture.height() > 300, "{name}");
    }
    for name in ["reference-a.exr", "reference-b.exr"] {
        let half = Picture::from_exr(&std::fs::read(out.join(name)).unwrap()).unwrap();
        assert_eq!((half.width, half.height), (40, 40));
    }
}

/// Judged by twice the truth, every picture has half the light and an error of about a half.
#[test]
fn a_planted_error_of_the_reference_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("first");
    let mut arguments = vec!["--methods", "ray-traced", "--seeds", "1", "--reference-seconds", "2"];
    arguments.extend(["--seconds", "1", "-q"]);
    let done = compare(&first, &arguments);
    assert!(done.status.success() && said(&done).is_empty(), "{}", said(&done));
    let honest = number(&rows(&first)[0], "rrmse");

    let doubled = |name: &str| {
        let bytes = std::fs::read(first.join(name)).unwrap();
        let mut half = Picture::from_exr(&bytes).unwrap();
        half.pixels.iter_mut().for_each(|pixel| *pixel *= 2.0);
        let path = folder.path().join(name);
        std::fs::write(&path, half.to_exr().unwrap()).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let halves = [doubled("reference-a.exr"), doubled("reference-b.exr")];
    let second = folder.path().join("second");
    let mut arguments = vec!["--methods", "ray-traced", "--seeds", "1", "--seconds", "1"];
    arguments.extend(["--reference", &halves[0], "--reference", &halves[1]]);
    let done = compare(&second, &arguments);
    assert!(done.status.success(), "{}", said(&done));
    let row = &rows(&second)[0];
    assert!((number(row, "mean_ratio") - 0.5).abs() < 0.03, "{row:?}");
    assert!(number(row, "rrmse") > 0.4 && honest < 0.4, "{row:?} {honest}");
    assert!((number(row, "median_relative_error") - 0.5).abs() < 0.1, "{row:?}");
    assert!(!second.join("reference-a.exr").exists(), "a given reference is not copied");

    // The same picture twice has no noise to tell; one alone says so.
    let twice = ["--reference", &halves[0], "--reference", &halves[0]];
    let refused = compare(&second, &twice);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    let single =
        ["--reference", &halves[0], "--methods", "ray-traced", "--quick", "--seconds", ".2"];
    assert!(compare(&second, &single).status.success());
    assert!(text(&second, "comparison.md").contains("what noise it has is in every figure"));
    let other_size = ["--reference", &halves[0], "--size", "30x30"];
    let mut command = Command::new(program());
    command.args(["compare", "cornell", "--device", "cpu", "--out"]).arg(&second).args(other_size);
    let refused = command.output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("no whole multiple"), "{}", said(&refused));
}

#[test]
fn a_method_that_refuses_is_left_out_and_the_rest_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["--methods", "gauss-seidel,stochastic", "--seeds", "1"];
    arguments.extend(["--seconds", "0.3", "--reference-seconds", "1"]);
    arguments.extend(SMALL);
    // A matrix of 4·10¹⁰ entries.
    arguments.extend(["--set", "gauss-seidel.patches=200000"]);
    let done = compare(folder.path(), &arguments);
    assert!(done.status.success(), "{}", said(&done));
    let page = text(folder.path(), "comparison.md");
    assert!(page.contains("**gauss-seidel** left out"), "{page}");
    let rows = rows(folder.path());
    let refused = rows.iter().find(|row| row["method"] == "gauss-seidel").unwrap();
    assert!(refused["refused"].contains("bytes"), "{refused:?}");
    assert!(
        rows.iter().any(|row| row["method"] == "stochastic" && row["rrmse"].parse::<f64>().is_ok())
    );
    assert!(!text(folder.path(), "chart.svg").contains("gauss-seidel"));
}

#[test]
fn wrong_usage_is_2_and_failure_is_1_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    // So many that their pictures of 8000 × 8000 pixels fit into no memory.
    let budgets = (1..=96).map(|s| s.to_string()).collect::<Vec<_>>().join(",");
    for (arguments, code, words) in [
        (&["--methods", "magic"][..], 2, "no method"),
        (&["--methods", "stochastic,stochastic"], 2, "twice"),
        (&["--set", "patches=none"], 2, "patches"),
        (&["--set", "gauss-siedel.patches=9"], 2, "none of the methods that are compared has it"),
        (&["--set", "colour=blue"], 2, "none of the methods that are compared has it"),
        (&["--seconds", "0"], 2, "above 0"),
        (&["--size", "8000x8000", "--seconds", &budgets], 2, "are available"),
        (&["--size", "20000x9"], 2, "width"),
        (&["--camera", "nobody"], 2, "nobody"),
        (&["--device", "abacus"], 2, "abacus"),
        (&["--reference", "/no/such/file.exr"], 1, "cannot read"),
        (&["--reference", "Cargo.toml"], 2, "Cargo.toml"),
    ] {
        let arguments: Vec<&str> = arguments.to_vec();
        let mut command = Command::new(program());
        let cargo = Path::new(env!("CARGO_MANIFEST_DIR"));
        command.args(["compare", "cornell", "--out"]).arg(out).args(&arguments).current_dir(cargo);
        let done = command.output().unwrap();
        let said = said(&done);
        assert_eq!(done.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(said.contains(words) && !said.contains("panicked"), "{arguments:?}: {said}");
        assert!(!out.join("comparison.csv").exists());
    }
}
