//! What is told between two rows of `train.csv`, and the row that it makes.

use crate::run::schema::{Column, Of, TRAIN, index};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Figures since the last row of `train.csv`, by the names of its columns.
#[derive(Debug, Default, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Interval {
    tallies: BTreeMap<String, Tally>,
}

/// What one column's figures come to.
#[derive(Debug, Default, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Tally {
    n: u64,
    sum: f64,
    last: f64,
}

/// A field of a row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub(super) enum Field {
    /// A number of things.
    Count(u64),
    /// A figure, if there is one.
    Figure(Option<f64>),
}

impl Interval {
    /// A figure called `name` was told; one that no column is called is left out.
    pub fn tell(&mut self, name: &str, value: f64) {
        if index(&TRAIN, name).is_none() {
            debug_assert!(false, "no column of train.csv is called {name}");
            return;
        }
        let tally = match self.tallies.get_mut(name) {
            Some(tally) => tally,
            None => self.tallies.entry(name.to_owned()).or_default(),
        };
        tally.n += 1;
        tally.sum += value;
        tally.last = value;
    }

    /// Something happened that the column `name` counts.
    pub fn count(&mut self, name: &str) {
        self.tell(name, 1.0);
    }

    /// The row at `step`, and a new interval.
    pub fn take(&mut self, step: u64) -> Vec<Field> {
        let told = std::mem::take(self).tallies;
        TRAIN
            .iter()
            .map(|column| field(column, step, &told))
            .collect()
    }
}

fn field(column: &Column, step: u64, told: &BTreeMap<String, Tally>) -> Field {
    let tally = told.get(column.name);
    match column.of {
        Of::Step => Field::Count(step),
        Of::Count => Field::Count(tally.map_or(0, |tally| tally.n)),
        Of::Mean => Field::Figure(tally.map(|tally| tally.sum / tally.n as f64)),
        Of::Last => Field::Figure(tally.map(|tally| tally.last)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_counts_averages_and_takes_the_last_as_its_columns_say() {
        let mut interval = Interval::default();
        interval.count("episodes");
        interval.count("episodes");
        interval.tell("return_mean", 1.0);
        interval.tell("return_mean", 4.0);
        interval.tell("eta", 0.5);
        interval.tell("eta", 0.25);
        let row = interval.take(70);
        let of = |name| row[index(&TRAIN, name).unwrap()];
        assert_eq!(of("step"), Field::Count(70));
        assert_eq!(of("episodes"), Field::Count(2));
        assert_eq!(of("return_mean"), Field::Figure(Some(2.5)));
        assert_eq!(of("eta"), Field::Figure(Some(0.25)));
        assert_eq!(of("kept"), Field::Figure(None));
        assert_eq!(of("diverged"), Field::Count(0));
        assert_eq!(interval, Interval::default());
    }
}
