//! The table that `mamf verify` prints.

use std::fmt::Write as _;

use super::error::Errors;
use super::replay::{RulesErrors, Summary};

const COLUMNS: [&str; 14] = [
    "task",
    "steps",
    "obs",
    "reward",
    "qpos",
    "qvel",
    "rule mean",
    "rule max",
    "mean-v mean",
    "mean-v max",
    "known",
    "ends: rule",
    "recorded",
    "verdict",
];

/// One line for each task: largest errors of the simulator, errors of the rules on observations
/// (with the velocity read before the step, then, as `mean-v`, with the mean of the velocities around
/// it), largest error of the coordinates the rules know, and at how many steps the rules, and the
/// recording, disagree with the simulator on termination.
pub fn table(summaries: &[Summary]) -> String {
    let mut tasks: Vec<Summary> = Vec::new();
    for summary in summaries {
        match tasks.iter_mut().find(|task| task.env == summary.env) {
            Some(task) => task.merge(summary),
            None => tasks.push(summary.clone()),
        }
    }
    let mut rows = vec![COLUMNS.map(str::to_owned)];
    rows.extend(tasks.iter().map(cells));
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max();
    let widths: Vec<usize> = (0..COLUMNS.len()).filter_map(width).collect();

    let mut text = String::new();
    for row in &rows {
        let mut line = String::new();
        for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
            // Words to the left, numbers to the right.
            let _ = match column {
                0 => write!(line, "{cell:width$}"),
                13 => write!(line, "  {cell}"),
                _ => write!(line, "  {cell:>width$}"),
            };
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

fn cells(summary: &Summary) -> [String; 14] {
    let rule = |errors: Option<&RulesErrors>| match errors {
        Some(errors) => (
            number(errors.reward.mean()),
            number(errors.reward.largest()),
        ),
        None => ("-".to_owned(), "-".to_owned()),
    };
    let largest = |errors: &Errors| number(errors.largest());
    let (start_mean, start_max) = rule(Some(&summary.start));
    let (mean_mean, mean_max) = rule(summary.mean.as_ref());
    let verdict = match (summary.within_tolerance(), summary.relative) {
        (true, false) => "ok",
        (true, true) => "ok (relative)",
        (false, _) => "FAILED",
    };
    [
        summary.env.clone(),
        summary.steps.to_string(),
        largest(&summary.obs),
        largest(&summary.reward),
        largest(&summary.qpos),
        largest(&summary.qvel),
        start_mean,
        start_max,
        mean_mean,
        mean_max,
        largest(&summary.known),
        summary.start.terminated.to_string(),
        summary.terminated.to_string(),
        verdict.to_owned(),
    ]
}

fn number(value: Option<f64>) -> String {
    match value {
        Some(0.0) => "0".to_owned(),
        Some(value) => format!("{value:.1e}"),
        None => "-".to_owned(),
    }
}
