//! README's table of settings is what the program says that there is.

use hemilux_tests::server::{program, repository};
use std::process::Command;

const BEGIN: &str = "<!-- generated: settings -->\n";
const END: &str = "<!-- end -->";

/// What stands between the marks of a page.
fn table(page: &str) -> Option<&str> {
    let (_, rest) = page.split_once(BEGIN)?;
    rest.split_once(END).map(|(table, _)| table)
}

#[test]
fn the_table_of_settings_is_that_of_the_program() {
    let listed = Command::new(program()).args(["settings", "--markdown"]).output().unwrap();
    assert!(listed.status.success());
    let listed = String::from_utf8(listed.stdout).expect("text");
    assert!(listed.lines().count() > 20, "{listed}");
    let page = std::fs::read_to_string(repository().join("README.md")).unwrap();
    let table = table(&page).expect("README has a table of settings");
    let differs = table.lines().zip(listed.lines()).find(|(here, there)| here != there);
    assert!(
        table == listed,
        "README's table of settings is out of date: put what `hemilux settings --markdown` prints between its marks; first difference: {differs:?}"
    );
}

#[test]
fn a_planted_difference_is_found() {
    let page = format!("text\n{BEGIN}| `rays` | 1 |\n{END}\n");
    assert_eq!(table(&page), Some("| `rays` | 1 |\n"));
    assert_eq!(table("text"), None);
}
