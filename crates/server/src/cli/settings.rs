//! `hemilux settings`.

use super::process::{Failure, print};
use crate::api::settings::Setting;
use crate::worker;
use clap::Args;

/// Arguments of `hemilux settings`.
#[derive(Args)]
pub struct Arguments {
    /// The method; all by default.
    method: Option<String>,
    /// Those for studies of the methods, too, which the API does not take.
    #[arg(long)]
    all: bool,
    /// As a table in Markdown.
    #[arg(long)]
    markdown: bool,
}

/// Lists what methods can be set to.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let method = arguments.method.as_deref();
    if let Some(unknown) = method.filter(|name| !worker::METHODS.contains(name)) {
        let what = format!("there is no method {unknown:?}; there are {:?}", worker::METHODS);
        return Err(Failure::usage(what));
    }
    let wanted = |setting: &Setting| {
        (arguments.all || setting.public)
            && method.is_none_or(|name| name == "auto" || name == setting.method)
    };
    let rows = grouped(worker::listed_settings().filter(wanted).collect());
    print(&if arguments.markdown { markdown(&rows) } else { plain(&rows) })
}

/// A setting, and the methods that have it.
struct Row {
    methods: Vec<&'static str>,
    setting: Setting,
}

/// Settings that several methods share, once.
fn grouped(settings: Vec<Setting>) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    for setting in settings {
        let same = |row: &&mut Row| {
            let (one, other) = (&row.setting, &setting);
            (one.name, one.default, &one.range, one.meaning)
                == (other.name, other.default, &other.range, other.meaning)
        };
        match rows.iter_mut().find(same) {
            Some(row) => row.methods.push(setting.method),
            None => rows.push(Row { methods: vec![setting.method], setting }),
        }
    }
    rows
}

fn plain(rows: &[Row]) -> String {
    let entry = |row: &Row| {
        let Setting { name, default, range, meaning, .. } = &row.setting;
        format!(
            "{name} = {default}\n    {}\n    {range}{}\n    {meaning}\n",
            row.methods.join(", "),
            unit(row)
        )
    };
    rows.iter().map(entry).collect()
}

fn unit(row: &Row) -> String {
    match row.setting.unit {
        "" => String::new(),
        unit => format!(", in {unit}"),
    }
}

fn markdown(rows: &[Row]) -> String {
    let mut table =
        "| setting | of | default | values | meaning |\n|---|---|---|---|---|\n".to_string();
    for row in rows {
        let Setting { name, default, range, meaning, .. } = &row.setting;
        let methods: Vec<_> = row.methods.iter().map(|method| format!("`{method}`")).collect();
        let cells = [
            format!("`{name}`"),
            methods.join(", "),
            format!("`{default}`"),
            format!("{}{}", range.replace('"', "`"), unit(row)),
            meaning.replace('|', "\\|"),
        ];
        table.push_str(&format!("| {} |\n", cells.join(" | ")));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_methods_share_is_listed_once_and_nothing_is_left_out() {
        let all: Vec<Setting> = worker::listed_settings().collect();
        let count = all.len();
        let rows = grouped(all);
        assert_eq!(rows.iter().map(|row| row.methods.len()).sum::<usize>(), count);
        let patches = rows.iter().find(|row| row.setting.name == "patches").unwrap();
        assert_eq!(patches.methods, ["stochastic", "monte-carlo", "progressive", "gauss-seidel"]);
        let samples = rows.iter().filter(|row| row.setting.name == "pixel_samples").count();
        assert_eq!(samples, 3, "of patches, of rays, of hemilux");
    }

    #[test]
    fn tables_have_a_row_for_each() {
        let rows = grouped(worker::public_settings().collect());
        let table = markdown(&rows);
        assert_eq!(table.lines().count(), rows.len() + 2);
        // The bars in |a−b|/(a+b) are no columns.
        assert!(table.lines().all(|line| line.replace("\\|", "").matches('|').count() == 6));
    }
}
