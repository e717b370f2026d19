//! The tables that `mamf verify` prints.

use std::fmt::Write as _;

use super::error::Errors;
use super::replay::Summary;
use crate::env::PenInertia;

/// What stands where there is no figure; a column of nothing else is left out.
pub(crate) const NOTHING: &str = "-";

/// Two tables with one line for each task: the simulator against the recordings, and what rules say
/// of observations against the simulator.
pub fn tables(summaries: &[Summary]) -> String {
    let mut tasks: Vec<Summary> = Vec::new();
    for summary in summaries {
        match tasks.iter_mut().find(|task| task.is_alike(summary)) {
            Some(task) => task.merge(summary),
            None => tasks.push(summary.clone()),
        }
    }
    let simulator = table(&tasks, simulator_cells);
    let rules = table(&tasks, rules_cells);
    format!("Simulator, largest errors\n{simulator}\nRules on observations\n{rules}")
}

/// Columns of words; the others hold numbers.
const WORDS: [&str; 5] = ["task", "verdict", "recording", "demonstration", "source"];

/// A cell under its heading.
pub(crate) type Cell = (&'static str, String);

/// A line for each item, of the cells under their headings; every line has the same headings.
pub(crate) fn table<T>(items: &[T], cells: impl Fn(&T) -> Vec<Cell>) -> String {
    let lines: Vec<Vec<Cell>> = items.iter().map(cells).collect();
    let columns = lines.first().map_or(0, Vec::len);
    let mut text = vec![String::new(); lines.len() + 1];
    for column in 0..columns {
        if lines.iter().all(|line| line[column].1 == NOTHING) {
            continue;
        }
        let heading = lines[0][column].0;
        let gap = if column == 0 { "" } else { "  " };
        let column = lines.iter().map(|line| line[column].1.as_str());
        let cells: Vec<&str> = std::iter::once(heading).chain(column).collect();
        let width = cells.iter().map(|cell| cell.len()).max().unwrap_or(0);
        for (text, cell) in text.iter_mut().zip(cells) {
            // Words to the left, numbers to the right.
            let _ = match heading {
                heading if WORDS.contains(&heading) => write!(text, "{gap}{cell:width$}"),
                _ => write!(text, "{gap}{cell:>width$}"),
            };
        }
    }
    text.iter()
        .fold(String::new(), |all, line| all + line.trim_end() + "\n")
}

fn simulator_cells(summary: &Summary) -> Vec<(&'static str, String)> {
    let found = &summary.differences;
    let touched = match summary.touched {
        0 if summary.watched => "0".to_owned(),
        0 => NOTHING.to_owned(),
        n => n.to_string(),
    };
    let verdict = match (summary.within_tolerance(), summary.relative) {
        (true, false) => "ok",
        (true, true) => "ok (relative)",
        (false, _) if !summary.is_judged() => "nothing compared",
        (false, _) => "FAILED",
    };
    let flags = |recorded: bool, n: usize| {
        if recorded {
            n.to_string()
        } else {
            NOTHING.to_owned()
        }
    };
    vec![
        ("task", name(summary)),
        ("steps", summary.steps.to_string()),
        ("settling", largest(&found.settling)),
        ("ctrl", largest(&found.ctrl)),
        ("obs", largest(&found.obs)),
        ("goal", largest(&found.goal)),
        ("reward", largest(&found.reward)),
        ("sparse", largest(&found.sparse)),
        ("success", flags(summary.has_success, found.success)),
        ("ends", flags(summary.has_ends, found.terminated)),
        ("qpos", largest(&found.qpos)),
        ("qvel", largest(&found.qvel)),
        ("touched", touched),
        ("qpos there", largest(&summary.touched_differences.qpos)),
        ("verdict", verdict.to_owned()),
    ]
}

fn rules_cells(summary: &Summary) -> Vec<(&'static str, String)> {
    let mean = summary.mean.as_ref().map(|errors| &errors.reward);
    vec![
        ("task", name(summary)),
        ("rule mean", number(summary.start.reward.mean())),
        ("rule max", number(summary.start.reward.largest())),
        ("mean-v mean", number(mean.and_then(Errors::mean))),
        ("mean-v max", number(mean.and_then(Errors::largest))),
        ("known", largest(&summary.known)),
        ("ends", summary.start.terminated.to_string()),
    ]
}

fn name(summary: &Summary) -> String {
    match summary.inertia {
        PenInertia::Published => summary.env.clone(),
        PenInertia::Derived => format!("{} (derived inertia)", summary.env),
    }
}

/// The largest error to two digits.
pub(crate) fn largest(errors: &Errors) -> String {
    number(errors.largest())
}

/// A figure to two digits.
pub(crate) fn number(value: Option<f64>) -> String {
    match value {
        Some(0.0) => "0".to_owned(),
        Some(value) => format!("{value:.1e}"),
        None => NOTHING.to_owned(),
    }
}
