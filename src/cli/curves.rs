//! `mamf curves`

use super::{number, print};
use crate::core::table::{Column, Table};
use crate::lab::comparison::{
    self, CurveOptions, Curves, Estimate, EvalColumn, Interval, Statistic,
};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `mamf curves`.
#[derive(Debug, clap::Args)]
#[command(after_long_help = "\
Runs are <folder>/<method>/seed-<n>, as `mamf train` and `mamf sweep` lay them out. A panel is a task; where runs of one task lie in \
several folders, each folder has its own.

The final value of a run is the mean of its evaluations in the last tenth of its steps. Means, and interquartile means over the runs of \
one task, have 95 % intervals of Student's t; what is taken of several tasks at once and probabilities have percentile intervals of a \
stratified bootstrap.

JSON has `panels` (of each the `title` and `lines`: of each method `seeds`, `last` steps, common `steps`, `curve` with a value and an \
interval a step, `runs` with the values of each, `final_mean`, `final_iqm`), `notes`, and `scores` over all tasks (counted from the untrained policy, 0, to the \
best method's mean final value, 1): `scales`, `methods` (of each `median`, `iqm`, `mean`, `optimality_gap`, `profile` at the `thresholds`, \
`efficiency` along the `steps`) and `improvements`. Where there are no scores, `no_scores` says why.")]
pub struct Args {
    /// Run directories, folders above some, or quoted patterns of them
    #[arg(value_name = "RUNS", required = true)]
    runs: Vec<PathBuf>,
    /// Column of eval.csv
    #[arg(long, value_enum, default_value_t)]
    metric: EvalColumn,
    /// What a curve shows of the seeds
    #[arg(long, value_enum, default_value_t)]
    statistic: Statistic,
    /// Replace every point of a curve by the mean of the last N evaluations
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    smooth: u32,
    /// One panel a task, whatever folders its runs are in
    #[arg(long)]
    merge: bool,
    /// TOML of "<task>" = [low, high]: what counts as 0 and 1 in scores
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Resamplings of bootstrap intervals
    #[arg(long, value_name = "N", default_value_t = 2000, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    repetitions: u32,
    /// Print everything as JSON, as scripts/plot_curves.py draws it, instead of a table of final values
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let options = CurveOptions {
        column: args.metric,
        statistic: args.statistic,
        window: args.smooth as usize,
        merge: args.merge,
        reference: args.reference.clone(),
        repetitions: args.repetitions as usize,
    };
    let runs = comparison::find_all(&args.runs)?;
    let curves = comparison::curves(runs, &options)?;
    if args.json {
        print(&format!("{}\n", serde_json::to_string(&curves)?))?;
    } else {
        let mut text = final_values(&curves).to_string();
        for note in &curves.notes {
            text += &format!("note: {}{}\n", note.panel, note.text);
        }
        print(&text)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn final_values(curves: &Curves) -> Table {
    let mut table = Table::new([
        Column::words("task"),
        Column::words("method"),
        Column::numbers("seeds"),
        Column::numbers("steps"),
        Column::numbers("final mean"),
        Column::words("95 % interval"),
        Column::numbers("final IQM"),
        Column::words("95 % interval"),
    ]);
    for panel in &curves.panels {
        for (label, line) in &panel.lines {
            let [first, last] = [line.last.iter().min(), line.last.iter().max()];
            let steps = match (first, last) {
                (Some(first), Some(last)) if first < last => format!("{first} to {last}"),
                (_, last) => last.copied().unwrap_or_default().to_string(),
            };
            table.row([
                panel.title.clone(),
                label.clone(),
                line.seeds.len().to_string(),
                steps,
                number(line.final_mean.value),
                interval(&line.final_mean),
                number(line.final_iqm.value),
                interval(&line.final_iqm),
            ]);
        }
    }
    table
}

fn interval(estimate: &Estimate) -> String {
    match estimate.interval {
        None => crate::core::table::NOTHING.to_owned(),
        Some(Interval { low, high }) => format!("{} to {}", number(low), number(high)),
    }
}
