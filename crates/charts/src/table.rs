//! Tables: CSV files, Markdown, and the generated parts of a page.

use std::fmt::Write as _;

/// Rows of text under a header.
#[derive(Clone, Debug, Default)]
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// No rows yet.
    pub fn new(header: &[&str]) -> Self {
        Self { header: header.iter().map(|name| (*name).into()).collect(), rows: Vec::new() }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// Where it is not as wide as the header.
    pub fn add(&mut self, row: Vec<String>) {
        assert_eq!(row.len(), self.header.len(), "a row does not fit its header");
        self.rows.push(row);
    }

    /// RFC 4180 with a header line.
    pub fn csv(&self) -> String {
        let quoted = |cell: &String| {
            let plain = !cell.contains([',', '"', '\n', '\r']);
            if plain { cell.clone() } else { format!("\"{}\"", cell.replace('"', "\"\"")) }
        };
        let mut text = String::new();
        for row in std::iter::once(&self.header).chain(&self.rows) {
            let cells: Vec<String> = row.iter().map(quoted).collect();
            let _ = writeln!(text, "{}", cells.join(","));
        }
        text
    }

    /// A pipe table: numbers to the right, words to the left.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let number =
            |cell: &str| cell.starts_with(|c: char| c.is_ascii_digit() || "-–".contains(c));
        let rule: Vec<String> = (0..self.header.len())
            .map(|at| self.rows.iter().any(|row| number(&row[at])))
            .map(|numbers| if numbers { "---:".into() } else { "---".into() })
            .collect();
        let mut text = line(&self.header) + &line(&rule);
        for row in &self.rows {
            let escaped: Vec<_> = row.iter().map(|cell| cell.replace('|', "\\|")).collect();
            text += &line(&escaped);
        }
        text
    }
}

/// Replaces what stands between `<!-- generated: NAME -->` and `<!-- end -->` in a page.
///
/// # Errors
/// Says which marker is missing.
pub fn replace_generated(page: &str, name: &str, content: &str) -> Result<String, String> {
    let opening = format!("<!-- generated: {name} -->");
    const CLOSING: &str = "<!-- end -->";
    let begin = page.find(&opening).ok_or(format!("the page has no {opening:?}"))? + opening.len();
    let length = page[begin..].find(CLOSING).ok_or(format!("{opening:?} has no {CLOSING:?}"))?;
    let (before, after) = (&page[..begin], &page[begin + length..]);
    if page[begin..begin + length].contains("<!-- generated:") {
        return Err(format!("{opening:?} has no {CLOSING:?} of its own"));
    }
    Ok(format!("{before}\n\n{}\n\n{after}", content.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_needs_it() {
        let mut table = Table::new(&["a", "b"]);
        table.add(vec!["x,y".into(), "say \"no\"".into()]);
        assert_eq!(table.csv(), "a,b\n\"x,y\",\"say \"\"no\"\"\"\n");
        assert_eq!(table.markdown(), "| a | b |\n| --- | --- |\n| x,y | say \"no\" |\n");
        table.add(vec!["z".into(), "-3".into()]);
        assert!(table.markdown().contains("\n| --- | ---: |\n"));
    }

    #[test]
    fn only_the_named_part_of_a_page_changes() {
        let page = "A\n<!-- generated: one -->\nold\n<!-- end -->\nB\n\
                    <!-- generated: two -->\nkept\n<!-- end -->\n";
        let once = replace_generated(page, "one", "new\n").unwrap();
        assert_eq!(once, page.replace("\nold\n", "\n\nnew\n\n"));
        assert_eq!(replace_generated(&once, "one", "new").unwrap(), once);
        assert!(replace_generated(page, "three", "").unwrap_err().contains("three"));
        let unclosed = "<!-- generated: one --> <!-- generated: two --> <!-- end -->";
        assert!(replace_generated(unclosed, "one", "").is_err());
    }
}
