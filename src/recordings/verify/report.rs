//! The tables that `mamf verify` prints.

use super::replay::Summary;
use crate::core::table::{Cell, NOTHING, Table};
use crate::env::PenInertia;
use crate::recordings::Errors;

/// Columns of words.
const WORDS: [&str; 2] = ["task", "verdict"];

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
    let table = |cells: fn(&Summary) -> Vec<Cell>| {
        Table::of(&tasks.iter().map(cells).collect::<Vec<_>>(), &WORDS)
    };
    let (simulator, rules) = (table(simulator_cells), table(rules_cells));
    format!("Simulator, largest errors\n{simulator}\nRules on observations\n{rules}")
}

fn simulator_cells(summary: &Summary) -> Vec<Cell> {
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

fn rules_cells(summary: &Summary) -> Vec<Cell> {
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
