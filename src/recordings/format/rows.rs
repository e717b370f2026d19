//! Rows of equal length.

use crate::core::span::Span;

/// Rows of equal length.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    numbers: Vec<f64>,
    rows: usize,
    columns: usize,
}

impl Rows {
    /// `rows` rows of `columns` numbers, row by row.
    ///
    /// # Panics
    /// When there are not `rows * columns` numbers.
    pub fn new(numbers: Vec<f64>, rows: usize, columns: usize) -> Rows {
        assert_eq!(Some(numbers.len()), rows.checked_mul(columns));
        Rows {
            numbers,
            rows,
            columns,
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Length of a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Row `t`, if there is one.
    pub fn get(&self, t: usize) -> Option<&[f64]> {
        (t < self.rows).then(|| &self.numbers[t * self.columns..][..self.columns])
    }

    /// The same rows with each number brought into the range of its column.
    #[must_use]
    pub fn clipped(mut self, ranges: &[Span]) -> Rows {
        for row in self.numbers.chunks_exact_mut(self.columns.max(1)) {
            for (x, range) in row.iter_mut().zip(ranges) {
                *x = range.clip(*x);
            }
        }
        self
    }

    /// The first number that is not finite or lies beyond plus and minus `largest`, with its row.
    pub fn first_beyond(&self, largest: f64) -> Option<(usize, f64)> {
        let wrong = |x: &f64| x.is_nan() || x.abs() > largest;
        let place = self.numbers.iter().position(wrong)?;
        Some((place / self.columns.max(1), self.numbers[place]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_clipping_and_finiteness() {
        let rows = Rows::new(vec![0.5, -3.0, 1.0, f64::INFINITY], 2, 2);
        assert_eq!(rows.get(1), Some(&[1.0, f64::INFINITY][..]));
        assert_eq!(rows.get(2), None);
        assert_eq!(rows.first_beyond(1e10), Some((1, f64::INFINITY)));
        let ranges = [
            Span {
                low: 0.6,
                high: 0.9,
            },
            Span::symmetric(1.0),
        ];
        let clipped = rows.clipped(&ranges);
        assert_eq!(clipped.get(0), Some(&[0.6, -1.0][..]));
        assert_eq!(clipped.get(1), Some(&[0.9, 1.0][..]));
        assert_eq!(clipped.first_beyond(1e10), None);
    }

    #[test]
    fn rows_without_columns_are_empty() {
        let rows = Rows::new(vec![], 3, 0);
        assert_eq!(rows.get(2), Some(&[][..]));
        assert_eq!(rows.first_beyond(1e10), None);
    }
}
