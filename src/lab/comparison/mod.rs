//! Two methods against each other: runs paired by task and seed, and their differences with bootstrap intervals.

mod measure;
mod pairing;
mod report;
mod statistics;

pub use measure::Metric;
pub use pairing::{ComparisonError, Pair, Pairs, Run, Settings, find, pair};
pub use report::{Comparison, Measured, Options, Overall, TaskComparison, compare};
pub use statistics::{Estimate, Interval};
