//! Learning curves of many runs: what a figure of them shows, computed.

use super::measure::{Points, final_value};
use super::pairing::{ComparisonError, Run};
use super::panels::{Drawn, EvalColumn, Panel, intended_end, panels};
use super::scores::{self, Scores};
use super::statistics::{Estimate, interquartile_mean, mean};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// What a curve shows of the seeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Statistic {
    /// Their mean
    #[default]
    Mean,
    /// Their interquartile mean
    Iqm,
}

/// How to make curves.
#[derive(Debug, Clone)]
pub struct CurveOptions {
    /// What of the evaluations.
    pub column: EvalColumn,
    /// What of the seeds.
    pub statistic: Statistic,
    /// Every point is the mean of so many evaluations, from 1 on.
    pub window: usize,
    /// One panel a task, whatever folders its runs are in.
    pub merge: bool,
    /// File of the figures that count as 0 and as 1 on each task.
    pub reference: Option<PathBuf>,
    /// Resamplings of bootstrap intervals.
    pub repetitions: usize,
}

/// Everything that figures of some runs show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curves {
    /// What of the evaluations.
    pub metric: EvalColumn,
    /// What of the seeds.
    pub statistic: Statistic,
    /// A panel a task.
    pub panels: Vec<PanelCurves>,
    /// What a reader should know of the curves.
    pub notes: Vec<Note>,
    /// All tasks together, where they can be.
    pub scores: Option<Scores>,
    /// Why they can't.
    pub no_scores: Option<String>,
}

/// The curves of a task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PanelCurves {
    /// The task, and where several folders have it, that.
    pub title: String,
    /// A line a method, by name.
    pub lines: BTreeMap<String, Line>,
}

/// The curve of a method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// Seeds of its runs, growing.
    pub seeds: Vec<u64>,
    /// Step of each run's last evaluation.
    pub last: Vec<u64>,
    /// Steps at which all runs have an evaluation.
    pub steps: Vec<u64>,
    /// The statistic over the runs at each of these steps.
    pub curve: Vec<Estimate>,
    /// The value of each run at each of these steps.
    pub runs: Vec<Vec<f64>>,
    /// Mean over the runs of the final value: the mean of the evaluations in the last tenth of a run's steps.
    pub final_mean: Estimate,
    /// Its interquartile mean.
    pub final_iqm: Estimate,
}

/// Something to be said of a panel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Note {
    /// Its title.
    pub panel: String,
    /// What follows the title.
    pub text: String,
}

/// The curves of `runs`.
///
/// # Errors
/// When a run has no value of the column, a seed is there twice, or the file of scales is not what it should be.
pub fn curves(runs: Vec<Run>, options: &CurveOptions) -> Result<Curves, ComparisonError> {
    let panels = panels(runs, options.column, options.merge)?;
    let labels: BTreeSet<&str> = panels
        .iter()
        .flat_map(|panel| panel.lines.keys().map(String::as_str))
        .collect();
    let mut notes = Vec::new();
    let mut drawn = Vec::new();
    for panel in &panels {
        let mut texts = Vec::new();
        let mut lines = BTreeMap::new();
        for (label, runs) in &panel.lines {
            let line = line(runs, options)?;
            texts.extend(line_notes(runs, &line.steps));
            lines.insert(label.clone(), line);
        }
        texts.extend(panel_notes(panel, &labels));
        notes.extend(texts.into_iter().map(|text| Note {
            panel: panel.title.clone(),
            text,
        }));
        drawn.push(PanelCurves {
            title: panel.title.clone(),
            lines,
        });
    }
    let scores = scores::scores(&panels, &labels, options)?;
    let (scores, no_scores) = match scores {
        Ok(scores) => (Some(scores), None),
        Err(reason) => (None, Some(reason)),
    };
    Ok(Curves {
        metric: options.column,
        statistic: options.statistic,
        panels: drawn,
        notes,
        scores,
        no_scores,
    })
}

fn line(runs: &[Drawn], options: &CurveOptions) -> Result<Line, ComparisonError> {
    let curves: Vec<_> = runs
        .iter()
        .map(|run| run.smoothed(options.window))
        .collect();
    let steps = common_steps(&curves);
    if steps.is_empty() {
        let of = |i: usize| runs[i].directory.clone();
        return Err(ComparisonError::NoCommonStep([of(0), of(1)]));
    }
    let estimate = |values: &[f64], statistic| match statistic {
        Statistic::Mean => mean(&[values.to_vec()]),
        Statistic::Iqm => interquartile_mean(values),
    };
    let values = at(&curves, &steps);
    let finals: Vec<f64> = runs.iter().map(final_return).collect();
    Ok(Line {
        seeds: runs.iter().map(|run| run.seed).collect(),
        last: runs.iter().map(Drawn::last).collect(),
        curve: values
            .iter()
            .map(|values| estimate(values, options.statistic))
            .collect(),
        runs: (0..runs.len())
            .map(|run| values.iter().map(|values| values[run]).collect())
            .collect(),
        steps,
        final_mean: estimate(&finals, Statistic::Mean),
        final_iqm: estimate(&finals, Statistic::Iqm),
    })
}

/// Mean of the evaluations in the last tenth of a run's steps.
pub(super) fn final_return(run: &Drawn) -> f64 {
    final_value(&run.curve, run.last())
}

/// Steps at which all curves have a value, growing.
pub(super) fn common_steps<C: AsRef<Points>>(curves: &[C]) -> Vec<u64> {
    let mut count = BTreeMap::new();
    for (step, _) in curves.iter().flat_map(|curve| curve.as_ref()) {
        *count.entry(*step).or_insert(0) += 1;
    }
    let common = count.into_iter().filter(|(_, n)| *n == curves.len());
    common.map(|(step, _)| step).collect()
}

/// The values of all curves at each of `steps`, which are common to them.
pub(super) fn at<C: AsRef<Points>>(curves: &[C], steps: &[u64]) -> Vec<Vec<f64>> {
    let value = |curve: &Points, step: u64| {
        let found = curve.binary_search_by_key(&step, |(step, _)| *step);
        found.ok().map(|i| curve[i].1)
    };
    let all = |step: &u64| {
        curves
            .iter()
            .filter_map(|curve| value(curve.as_ref(), *step))
            .collect()
    };
    steps.iter().map(all).collect()
}

/// What a reader must know about the runs of a line that are drawn at `steps`: texts to follow the title.
fn line_notes(runs: &[Drawn], steps: &[u64]) -> Vec<String> {
    let mut notes = Vec::new();
    let (label, drawn) = (&runs[0].label, steps[steps.len() - 1]);
    let longest = intended_end(runs);
    for run in runs.iter().filter(|run| run.last() < longest) {
        let (seed, ends, longest) = (run.seed, short(run.last()), short(longest));
        let cut = match runs.len() {
            1 => String::new(),
            _ => format!("; drawn to {}", short(drawn)),
        };
        notes.push(format!(
            ", {label}: seed {seed} ends at {ends} of {longest} steps{cut}"
        ));
    }
    let until = |run: &Drawn| run.curve.partition_point(|(step, _)| *step <= drawn);
    let possible = runs.iter().map(until).max().unwrap_or(0);
    if steps.len() < possible {
        let common = steps.len();
        notes.push(format!(
            ", {label}: seeds are evaluated at different steps; the {common} common ones of {possible} are drawn"
        ));
    }
    notes
}

/// Seeds and lines that others have and some lack: texts to follow the title.
fn panel_notes(panel: &Panel, labels: &BTreeSet<&str>) -> Vec<String> {
    let lacking = lacking(panel, labels);
    let mut notes = Vec::new();
    if !lacking.is_empty() {
        notes.push(format!(": no runs of {}", lacking.join(", ")));
    }
    let seeds = |runs: &[Drawn]| runs.iter().map(|run| run.seed).collect::<BTreeSet<u64>>();
    let everyone: BTreeSet<u64> = panel.runs().map(|run| run.seed).collect();
    for (label, runs) in &panel.lines {
        let seeds = seeds(runs);
        if seeds != everyone {
            let plural = if seeds.len() > 1 { "s" } else { "" };
            let (some, all) = (ranges(&seeds), ranges(&everyone));
            notes.push(format!(", {label}: seed{plural} {some} of {all}"));
        }
    }
    notes
}

/// The labels that have no line in a panel.
pub(super) fn lacking<'a>(panel: &Panel, labels: &BTreeSet<&'a str>) -> Vec<&'a str> {
    let lacks = |label: &&&str| !panel.lines.contains_key(**label);
    labels.iter().filter(lacks).copied().collect()
}

/// 1500000 as 1.5M, 20000 as 20k.
pub(super) fn short(steps: u64) -> String {
    match steps {
        1_000_000.. => format!("{}M", steps as f64 / 1e6),
        1000.. => format!("{}k", steps as f64 / 1e3),
        _ => steps.to_string(),
    }
}

/// 0, 1, 2, 5, 6 as "0-2, 5, 6".
fn ranges(numbers: &BTreeSet<u64>) -> String {
    let mut parts: Vec<[u64; 2]> = Vec::new();
    for number in numbers {
        match parts.last_mut() {
            Some([_, last]) if *last + 1 == *number => *last = *number,
            _ => parts.push([*number; 2]),
        }
    }
    let text = |[first, last]: [u64; 2]| match last - first {
        0 => first.to_string(),
        1 => format!("{first}, {last}"),
        _ => format!("{first}-{last}"),
    };
    parts.into_iter().map(text).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_all_curves_have() {
        let curves = [
            vec![(0, 1.0), (5, 2.0), (10, 3.0)],
            vec![(0, 4.0), (10, 6.0)],
        ];
        let steps = common_steps(&curves);
        assert_eq!(steps, [0, 10]);
        assert_eq!(at(&curves, &steps), [[1.0, 4.0], [3.0, 6.0]]);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [12_500, 999, 1_500_000, 20_000].map(short),
            ["12.5k", "999", "1.5M", "20k"]
        );
        assert_eq!(ranges(&[0, 1, 2, 5, 6, 9].into()), "0-2, 5, 6, 9");
    }
}
