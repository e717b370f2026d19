//! What a recording holds.

use std::path::{Path, PathBuf};

use super::{UnusableRecording, common_directory, name, tasks};
use crate::core::table::{Cell, NOTHING, Table};
use crate::env;
use crate::recordings::format::{Recording, Rows};
use crate::recordings::{DemonstrationError, Demonstrations, Sizes};

/// Columns of words.
const WORDS: [&str; 4] = ["recording", "task", "demonstration", "source"];

/// What a recording holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// The archive.
    pub path: PathBuf,
    /// Id of the task.
    pub task: String,
    /// Number of actions.
    pub steps: usize,
    /// Number of recorded states: one more than actions, unless the last one is lacking.
    pub states: usize,
    /// Sum of the rewards, where they are recorded.
    pub episode_return: Option<f64>,
    /// In how many steps the goal was reached, and whether in the last, where that is recorded.
    pub success: Option<(usize, bool)>,
    /// Whether the accelerations are recorded from which the solver started.
    pub has_warmstart: bool,
    /// Whether the state that each step led to is recorded beside the states.
    pub has_next: bool,
    /// Whether the goal is recorded.
    pub has_goal: bool,
    /// Where the recording came from.
    pub source: Option<String>,
    /// The row at which it begins anew; only a single episode can be a demonstration.
    pub reset: Option<usize>,
}

/// Reads the recording `path` and makes the checks of [`Demonstrations::load`] for its own task.
///
/// # Errors
/// If it is damaged, of an unknown task or of other sizes than its task, or holds a number that is
/// not finite.
pub fn describe(path: &Path) -> Result<Description, UnusableRecording> {
    let recording = Recording::open(path)?;
    let env = env::make_inspect(&recording.env).map_err(UnusableRecording::task(path))?;
    let spec = env.spec();
    let sizes = Sizes::of(spec);
    let reset = match Demonstrations::check(&recording, &sizes) {
        Ok(()) => None,
        Err(DemonstrationError::Reset { row, .. }) => Some(row),
        Err(error) => return Err(error.into()),
    };
    Ok(Description {
        path: path.to_owned(),
        steps: recording.steps(),
        states: recording.qpos.rows(),
        episode_return: recording.reward.as_ref().map(|r| column(r).sum()),
        success: recording.success.as_ref().map(|flags| {
            let reached = |flag: &f64| *flag != 0.0;
            let steps = column(flags).filter(reached).count();
            (steps, column(flags).last().as_ref().is_some_and(reached))
        }),
        has_warmstart: recording.qacc_warmstart.is_some(),
        has_next: recording.next_qpos.is_some() && recording.next_qvel.is_some(),
        has_goal: recording.desired_goal.is_some(),
        source: recording.source,
        task: recording.env,
        reset,
    })
}

/// The numbers of an array with one number a row.
fn column(rows: &Rows) -> impl Iterator<Item = f64> + '_ {
    (0..rows.rows()).filter_map(|t| rows.get(t)?.first().copied())
}

/// A table with a line for each recording.
pub fn descriptions(descriptions: &[Description]) -> String {
    let base = common_directory(descriptions.iter().map(|d| d.path.as_path()));
    let line = |d: &Description| {
        let success = |(steps, last): (usize, bool)| {
            let end = if last { "in the last" } else { "lost" };
            match steps {
                0 => "0".to_owned(),
                steps => format!("{steps}, {end}"),
            }
        };
        vec![
            ("recording", name(&d.path, &base)),
            ("task", d.task.clone()),
            ("steps", d.steps.to_string()),
            ("return", figure(d.episode_return)),
            ("success", d.success.map_or(NOTHING.to_owned(), success)),
            ("states", d.states.to_string()),
            ("warm start", yes(d.has_warmstart)),
            ("next", yes(d.has_next)),
            ("goal", yes(d.has_goal)),
            ("demonstration", usable(d)),
            ("source", d.source.clone().unwrap_or(NOTHING.to_owned())),
        ]
    };
    let lines: Vec<Vec<Cell>> = descriptions.iter().map(line).collect();
    Table::of(&lines, &WORDS).to_string()
}

fn usable(description: &Description) -> String {
    match description.reset {
        None => "yes".to_owned(),
        Some(row) => format!("no: resets at row {row}"),
    }
}

fn yes(held: bool) -> String {
    if held { "yes" } else { NOTHING }.to_owned()
}

fn figure(value: Option<f64>) -> String {
    value.map_or(NOTHING.to_owned(), |value| format!("{value:.2}"))
}

/// A table with a line for each task: its trajectories, the states that precede an action, the
/// returns, how many end in success, and how many can be demonstrations.
pub fn totals(descriptions: &[Description]) -> String {
    let tasks = tasks(descriptions, |d| &d.task);
    let lines: Vec<Vec<Cell>> = tasks.iter().map(|task| total(task, descriptions)).collect();
    Table::of(&lines, &WORDS).to_string()
}

fn total(task: &str, descriptions: &[Description]) -> Vec<Cell> {
    let of_task = || descriptions.iter().filter(|d| d.task == task);
    let returns: Vec<f64> = of_task().filter_map(|d| d.episode_return).collect();
    let reduced = |f: fn(f64, f64) -> f64| figure(returns.iter().copied().reduce(f));
    let mean = (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64);
    let told = of_task().any(|d| d.success.is_some());
    let ended = of_task().filter(|d| d.success.is_some_and(|(_, last)| last));
    vec![
        ("task", task.to_owned()),
        ("trajectories", of_task().count().to_string()),
        (
            "states",
            of_task().map(|d| d.steps).sum::<usize>().to_string(),
        ),
        ("return min", reduced(f64::min)),
        ("mean", figure(mean)),
        ("max", reduced(f64::max)),
        (
            "end in success",
            match told {
                true => ended.count().to_string(),
                false => NOTHING.to_owned(),
            },
        ),
        (
            "usable",
            of_task().filter(|d| d.reset.is_none()).count().to_string(),
        ),
    ]
}
