//! Runs against each other: two methods paired by task and seed, or the learning curves and scores of many.

mod curves;
mod measure;
mod pairing;
mod panels;
mod report;
mod scores;
mod statistics;

pub use curves::{CurveOptions, Curves, Line, Note, PanelCurves, Statistic, curves};
pub use measure::Metric;
pub use pairing::{ComparisonError, Pair, Pairs, Run, Settings, find, find_all, pair};
pub use panels::EvalColumn;
pub use report::{Comparison, Measured, Options, Overall, TaskComparison, compare};
pub use scores::{Improvement, MethodScores, Scale, Scores};
pub use statistics::{Estimate, Interval};
