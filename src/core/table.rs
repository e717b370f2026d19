//! Tables of text: columns as wide as their widest cell.

use std::fmt;

/// What stands where there is no figure; a column of nothing else is left out, unless it has a least width.
pub const NOTHING: &str = "-";

/// A cell under its heading.
pub type Cell = (&'static str, String);

/// A column: its heading, and on which side its cells stand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    heading: String,
    is_right: bool,
    least: usize,
}

impl Column {
    /// A column of words, which stand at its left.
    pub fn words(heading: impl Into<String>) -> Column {
        Column {
            heading: heading.into(),
            is_right: false,
            least: 0,
        }
    }

    /// A column of numbers, which stand at its right.
    pub fn numbers(heading: impl Into<String>) -> Column {
        Column {
            is_right: true,
            ..Column::words(heading)
        }
    }

    /// The column with room for so many characters at least, so that several tables stand in line; it is never left out.
    #[must_use]
    pub fn at_least(self, least: usize) -> Column {
        Column { least, ..self }
    }
}

/// Rows of cells under the headings of their columns, which are left out where all are empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table of these columns and of no rows.
    pub fn new(columns: impl IntoIterator<Item = Column>) -> Table {
        Table {
            columns: columns.into_iter().collect(),
            rows: Vec::new(),
        }
    }

    /// A table with a line for each of `lines`, whose cells stand under their headings; every line has the same headings.
    /// Columns headed by one of `words` hold words, the others numbers.
    pub fn of(lines: &[Vec<Cell>], words: &[&str]) -> Table {
        let column = |(heading, _): &Cell| match words.contains(heading) {
            true => Column::words(*heading),
            false => Column::numbers(*heading),
        };
        let mut table = Table::new(lines.iter().take(1).flatten().map(column));
        for line in lines {
            table.row(line.iter().map(|(_, cell)| cell.clone()));
        }
        table
    }

    /// Appends a row, a cell for each column; columns that are left over stay empty.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    fn cell(row: &[String], column: usize) -> &str {
        row.get(column).map_or("", String::as_str)
    }
}

/// Every row in a line of its own, nothing behind its last cell.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let has_headings = self.columns.iter().any(|column| !column.heading.is_empty());
        let mut lines = vec![String::new(); self.rows.len() + usize::from(has_headings)];
        for (i, column) in self.columns.iter().enumerate() {
            let cells = || self.rows.iter().map(|row| Table::cell(row, i));
            if column.least == 0 && !self.rows.is_empty() && cells().all(|cell| cell == NOTHING) {
                continue;
            }
            let heading = has_headings.then_some(column.heading.as_str());
            let cells: Vec<&str> = heading.into_iter().chain(cells()).collect();
            let width = |cell: &&str| cell.chars().count();
            let width = cells.iter().map(width).max().unwrap_or(0).max(column.least);
            for (line, cell) in lines.iter_mut().zip(cells) {
                if i > 0 {
                    line.push_str("  ");
                }
                *line += &match column.is_right {
                    true => format!("{cell:>width$}"),
                    false => format!("{cell:width$}"),
                };
            }
        }
        lines
            .iter()
            .try_for_each(|line| writeln!(f, "{}", line.trim_end()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(headings: [&str; 3], rows: &[[&str; 3]]) -> String {
        let [words, numbers, more] = headings;
        let mut table = Table::new([
            Column::words(words),
            Column::numbers(numbers),
            Column::words(more).at_least(5),
        ]);
        for row in rows {
            table.row(row.map(str::to_owned));
        }
        table.to_string()
    }

    #[test]
    fn words_stand_left_and_numbers_right() {
        let rows = [["é", "1", "x"], ["long", "12.5", ""]];
        assert_eq!(
            table(["a", "n", "why"], &rows),
            "a        n  why\né        1  x\nlong  12.5\n"
        );
        assert_eq!(table(["", "", ""], &rows), "é        1  x\nlong  12.5\n");
        assert_eq!(table(["a", "n", "why"], &[]), "a  n  why\n");
    }

    #[test]
    fn a_column_of_nothing_is_left_out() {
        let rows = [["a", "-", "-"], ["b", "-", "1"]];
        assert_eq!(
            table(["task", "x", "y"], &rows),
            "task  y\na     -\nb     1\n"
        );
    }
}
