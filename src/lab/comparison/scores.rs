//! Scores of methods over several tasks, each task's counted from the untrained policy to the best method.

use super::curves::{CurveOptions, at, common_steps, final_return, lacking, short};
use super::pairing::{ComparisonError, unreadable};
use super::panels::{Drawn, Panel, intended_end};
use super::statistics::{Estimate, average, bootstrap, improvement, iqm, mean, median};
use crate::run::schema::EVAL_CSV;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Thresholds of the performance profiles that are round, whatever the range.
const ROUND_THRESHOLDS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
/// Where a method fails altogether, scores far below 0 would take all of the width.
const LOWEST_THRESHOLD: f64 = -1.0;
/// Parts of the range of the thresholds.
const PARTS: u32 = 100;

/// What counts as 0 and as 1 on one task.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Scale {
    /// What counts as 0.
    pub low: f64,
    /// What counts as 1.
    pub high: f64,
}

impl Scale {
    fn score(self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

/// Normalised scores of all methods on the tasks that all of them have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// Titles of the panels that count.
    pub titles: Vec<String>,
    /// Scale of each.
    pub scales: BTreeMap<String, Scale>,
    /// Methods by name.
    pub methods: BTreeMap<String, MethodScores>,
    /// Each method over each other one.
    pub improvements: Vec<Improvement>,
    /// Thresholds of the performance profiles, growing.
    pub thresholds: Vec<f64>,
    /// Steps at which all runs have an evaluation.
    pub steps: Vec<u64>,
    /// The last step of any run.
    pub longest: u64,
    /// What was left out, in words.
    pub notes: Vec<String>,
}

/// The scores of a method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodScores {
    /// Runs of each task.
    pub runs: usize,
    /// The lowest final score of a run.
    pub lowest: f64,
    /// Median over tasks of the mean final score.
    pub median: Estimate,
    /// Interquartile mean of the final scores of all runs.
    pub iqm: Estimate,
    /// Mean of the final scores.
    pub mean: Estimate,
    /// How far final scores stay below 1 in the mean, those above counting as 1.
    pub optimality_gap: Estimate,
    /// Fraction of the runs with a final score above each threshold.
    pub profile: Vec<Estimate>,
    /// Interquartile mean of the scores of all runs at each step.
    pub efficiency: Vec<Estimate>,
}

/// Probability that a run of one method scores higher than one of another, mean over tasks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Improvement {
    /// The one.
    pub method: String,
    /// The other.
    pub over: String,
    /// The probability.
    pub probability: Estimate,
}

/// Scores of the methods `labels`; the inner error says in words why there are none.
///
/// # Errors
/// When the file of scales is not what it should be.
pub(super) fn scores(
    panels: &[Panel],
    labels: &BTreeSet<&str>,
    options: &CurveOptions,
) -> Result<Result<Scores, String>, ComparisonError> {
    let scales = match &options.reference {
        Some(path) => read_scales(path, panels)?,
        None => match panels.iter().map(measured_scale).collect() {
            Ok(scales) => scales,
            Err(reason) => return Ok(Err(reason)),
        },
    };
    Ok(scored(panels, &scales, labels, options))
}

/// 0 is the untrained policy, over all runs; 1 the best method's mean final value.
fn measured_scale(panel: &Panel) -> Result<Scale, String> {
    if let Some(run) = panel.runs().find(|run| run.curve[0].0 != 0) {
        return Err(format!(
            "{}, line 2: no evaluation at step 0, from which scores are counted; --reference gives what they are counted from",
            run.directory.join(EVAL_CSV).display()
        ));
    }
    let untrained: Vec<f64> = panel.runs().map(|run| run.curve[0].1).collect();
    let best = panel.lines.values().map(|runs| average(&finals(runs)));
    Ok(Scale {
        low: average(&untrained),
        high: best.fold(f64::NEG_INFINITY, f64::max),
    })
}

fn finals(runs: &[Drawn]) -> Vec<f64> {
    runs.iter().map(final_return).collect()
}

/// The scale of each panel, by its title or its task, from a TOML file of `"<task or title>" = [low, high]`.
fn read_scales(path: &Path, panels: &[Panel]) -> Result<Vec<Scale>, ComparisonError> {
    let text = crate::core::text::read(path).map_err(unreadable(path.to_owned()))?;
    let table: toml::Table = toml::from_str(&text).map_err(|error| ComparisonError::Settings {
        path: path.to_owned(),
        error: Box::new(error),
    })?;
    let scale = |panel: &Panel| {
        let found = table.get(&panel.title).or_else(|| table.get(&panel.task));
        let pair: Option<[f64; 2]> = found.and_then(|found| found.clone().try_into().ok());
        match pair {
            Some([low, high]) if low < high && low.is_finite() && high.is_finite() => {
                Ok(Scale { low, high })
            }
            _ => Err(ComparisonError::Scale {
                path: path.to_owned(),
                title: panel.title.clone(),
                found: found.map_or("nothing".to_owned(), ToString::to_string),
            }),
        }
    };
    panels.iter().map(scale).collect()
}

/// The runs of a method that count: of each task the same number.
type Chosen<'a> = Vec<Vec<&'a Drawn>>;

fn scored(
    panels: &[Panel],
    scales: &[Scale],
    labels: &BTreeSet<&str>,
    options: &CurveOptions,
) -> Result<Scores, String> {
    let mut notes = Vec::new();
    let used = usable(panels, scales, labels, &mut notes);
    if used.is_empty() {
        return Err(format!("no task to aggregate over: {}", notes.join("; ")));
    }
    let chosen: BTreeMap<&str, Chosen> = labels
        .iter()
        .map(|label| (*label, choose(&used, label, &mut notes)))
        .collect();
    let runs = || chosen.values().flatten().flatten();
    let curves: Vec<_> = runs().map(|run| run.smoothed(options.window)).collect();
    let steps = common_steps(&curves);
    if steps.is_empty() {
        return Err("no step at which all runs have an evaluation; choose other runs".into());
    }
    let scaled = |values: &dyn Fn(&Drawn) -> f64, tasks: &Chosen| -> Vec<Vec<f64>> {
        let tasks = tasks.iter().zip(&used);
        tasks
            .map(|(runs, (_, scale))| runs.iter().map(|run| scale.score(values(run))).collect())
            .collect()
    };
    let final_scores: BTreeMap<&str, Vec<Vec<f64>>> = chosen
        .iter()
        .map(|(label, tasks)| (*label, scaled(&final_return, tasks)))
        .collect();
    let thresholds = thresholds(final_scores.values().flatten().flatten().copied());
    let methods = chosen.iter().map(|(label, tasks)| {
        let along = along(tasks, &used, &steps, options.window);
        let scores = method(
            &final_scores[label],
            &along,
            &thresholds,
            options.repetitions,
        );
        ((*label).to_owned(), scores)
    });
    Ok(Scores {
        titles: used.iter().map(|(panel, _)| panel.title.clone()).collect(),
        scales: used
            .iter()
            .map(|(panel, scale)| (panel.title.clone(), *scale))
            .collect(),
        methods: methods.collect(),
        improvements: improvements(&final_scores, options.repetitions),
        thresholds,
        longest: runs().map(|run| run.last()).max().unwrap_or(0),
        steps,
        notes,
    })
}

/// The panels that count, with their scales; notes on those that do not.
fn usable<'a>(
    panels: &'a [Panel],
    scales: &[Scale],
    labels: &BTreeSet<&str>,
    notes: &mut Vec<String>,
) -> Vec<(&'a Panel, Scale)> {
    let mut used = Vec::new();
    for (panel, scale) in panels.iter().zip(scales) {
        let (title, lacking) = (&panel.title, lacking(panel, labels));
        let Scale { low, high } = *scale;
        if !lacking.is_empty() {
            let lacking = lacking.join(", ");
            notes.push(format!("{title}: left out, no runs of {lacking}"));
        } else if low < high {
            used.push((panel, *scale));
        } else {
            notes.push(format!(
                "{title}: left out, no method ends above the untrained policy ({high:.2} against {low:.2}), so there is no \
                scale; --reference gives one"
            ));
        }
    }
    used
}

/// Of each task as many runs of a method as the task with the fewest has, whole ones rather than those that end early.
fn choose<'a>(used: &[(&'a Panel, Scale)], label: &str, notes: &mut Vec<String>) -> Chosen<'a> {
    let of = |panel: &'a Panel| -> Vec<&'a Drawn> {
        let mut runs: Vec<&Drawn> = panel.lines[label].iter().collect();
        let end = panel.intended_end();
        runs.sort_by_key(|run| (run.last() < end, run.seed));
        runs
    };
    let mut tasks: Chosen = used.iter().map(|(panel, _)| of(panel)).collect();
    let count = tasks.iter().map(Vec::len).min().unwrap_or(0);
    if tasks.iter().any(|runs| runs.len() > count) {
        let plural = if count > 1 { "s" } else { "" };
        notes.push(format!(
            "{label}: {count} seed{plural} of each task count, for one task has no more"
        ));
    }
    for (runs, (panel, _)) in tasks.iter_mut().zip(used) {
        runs.truncate(count);
        let end = intended_end(panel.runs());
        for run in runs.iter().filter(|run| run.last() < end) {
            let (title, seed) = (&panel.title, run.seed);
            let (last, end) = (short(run.last()), short(end));
            notes.push(format!(
                "{title}, {label}: seed {seed} counts as far as it went, {last} of {end} steps"
            ));
        }
    }
    tasks
}

/// Scores of a method at each step: of each task those of its runs.
fn along(
    tasks: &Chosen,
    used: &[(&Panel, Scale)],
    steps: &[u64],
    window: usize,
) -> Vec<Vec<Vec<f64>>> {
    let mut along = vec![Vec::new(); steps.len()];
    for (runs, (_, scale)) in tasks.iter().zip(used) {
        let curves: Vec<_> = runs.iter().map(|run| run.smoothed(window)).collect();
        for (tasks, values) in along.iter_mut().zip(at(&curves, steps)) {
            tasks.push(values.into_iter().map(|value| scale.score(value)).collect());
        }
    }
    along
}

fn method(
    finals: &[Vec<f64>],
    along: &[Vec<Vec<f64>>],
    thresholds: &[f64],
    repetitions: usize,
) -> MethodScores {
    let pooled = |statistic: &dyn Fn(&[f64]) -> f64, tasks: &[Vec<f64>]| {
        bootstrap(tasks, |tasks| statistic(&tasks.concat()), repetitions)
    };
    let of_tasks =
        |tasks: &[Vec<f64>]| median(&tasks.iter().map(|task| average(task)).collect::<Vec<_>>());
    let gap =
        |scores: &[f64]| average(&scores.iter().map(|x| 1.0 - x.min(1.0)).collect::<Vec<_>>());
    let above = |threshold: f64| {
        move |scores: &[f64]| {
            scores.iter().filter(|score| **score > threshold).count() as f64 / scores.len() as f64
        }
    };
    MethodScores {
        runs: finals.first().map_or(0, Vec::len),
        lowest: finals
            .iter()
            .flatten()
            .copied()
            .fold(f64::INFINITY, f64::min),
        median: bootstrap(finals, of_tasks, repetitions),
        iqm: pooled(&iqm, finals),
        mean: mean(finals),
        optimality_gap: pooled(&gap, finals),
        profile: thresholds
            .iter()
            .map(|threshold| pooled(&above(*threshold), finals))
            .collect(),
        efficiency: along.iter().map(|tasks| pooled(&iqm, tasks)).collect(),
    }
}

/// Thresholds from the lowest to the highest score, 0 and 1 between them, and round ones among them.
fn thresholds(scores: impl Iterator<Item = f64>) -> Vec<f64> {
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    for score in scores {
        (low, high) = (low.min(score), high.max(score));
    }
    low = low.max(LOWEST_THRESHOLD);
    let step = (high - low) / f64::from(PARTS);
    let even = (0..=PARTS).map(|i| low + step * f64::from(i));
    let mut thresholds: Vec<f64> = even.chain(ROUND_THRESHOLDS).collect();
    thresholds.sort_by(f64::total_cmp);
    thresholds.dedup();
    thresholds
}

fn improvements(finals: &BTreeMap<&str, Vec<Vec<f64>>>, repetitions: usize) -> Vec<Improvement> {
    let mut improvements = Vec::new();
    for (method, ours) in finals {
        for (over, theirs) in finals.iter().filter(|(over, _)| *over != method) {
            // Runs of both are drawn apart, those of each task apart.
            let both = [ours.as_slice(), theirs].concat();
            let probability = |drawn: &[Vec<f64>]| {
                let (ours, theirs) = drawn.split_at(drawn.len() / 2);
                let tasks = ours.iter().zip(theirs);
                average(&tasks.map(|(x, y)| improvement(x, y)).collect::<Vec<_>>())
            };
            improvements.push(Improvement {
                method: (*method).to_owned(),
                over: (*over).to_owned(),
                probability: bootstrap(&both, probability, repetitions),
            });
        }
    }
    improvements
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_hold_the_round_ones_and_no_failure_takes_all_the_width() {
        let thresholds = thresholds([-30.0, 0.3, 1.4].into_iter());
        assert_eq!(
            (thresholds[0], thresholds[thresholds.len() - 1]),
            (-1.0, 1.4)
        );
        assert!(ROUND_THRESHOLDS.iter().all(|x| thresholds.contains(x)));
        assert!(thresholds.is_sorted() && thresholds.len() <= 106);
    }

    #[test]
    fn aggregates_of_known_scores() {
        let finals = [vec![0.0, 0.5], vec![1.0, 1.5]];
        let scores = method(&finals, &[], &[0.5], 200);
        assert_eq!(scores.median.value, 0.75);
        assert_eq!(scores.mean.value, 0.75);
        assert_eq!(scores.iqm.value, 0.75);
        assert_eq!(scores.optimality_gap.value, (1.0 + 0.5) / 4.0);
        assert_eq!(scores.profile[0].value, 0.5);
        assert_eq!(scores.lowest, 0.0);
    }
}
