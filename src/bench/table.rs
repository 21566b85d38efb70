//! Rows as a table that people read: Markdown, so that it can be pasted where figures are kept.

use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};

use super::report::Row;

/// The table of `rows`; numbers on the right.
pub fn table<R: Row>(rows: &[R]) -> String {
    aligned(R::COLUMNS, rows.iter().map(Row::cells))
}

/// A table of `columns`; the first is words, the others are numbers.
pub fn aligned(columns: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    aligned_after(1, columns, rows)
}

/// A table of `columns`, of which the first `words` are words and the others numbers.
pub(super) fn aligned_after(
    words: usize,
    columns: &[&str],
    rows: impl Iterator<Item = Vec<String>>,
) -> String {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN).set_header(columns);
    for row in rows {
        table.add_row(row);
    }
    for column in table.column_iter_mut().skip(words) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.to_string()
}

/// A figure with `decimals`; a dash where there is none.
pub(super) fn figure(value: Option<f64>, decimals: usize) -> String {
    value.map_or("–".into(), |v| format!("{v:.decimals$}"))
}

/// A count in millions, two decimals.
pub(super) fn millions(count: u64) -> String {
    format!("{:.2}", count as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::report;
    use super::*;

    #[test]
    fn every_row_has_a_line_and_every_column_a_cell() {
        let text = table(&report(&[("a", Some(30.0)), ("bb", None)]).rows);
        let lines: Vec<&str> = text.lines().collect();
        // Head, rule, two rows.
        assert_eq!(lines.len(), 4, "{text}");
        assert!(lines[0].contains("CPU ms") && lines[3].contains("bb"));
        assert!(
            lines.iter().all(|l| l.matches('|').count() == 3),
            "two columns: {text}"
        );
        assert_eq!(
            (figure(None, 1), figure(Some(1.25), 1)),
            ("–".into(), "1.2".into())
        );
        assert_eq!(millions(1_234_567), "1.23");
    }
}
