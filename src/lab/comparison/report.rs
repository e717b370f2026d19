//! The comparison itself.

use super::measure::{Metric, Points, final_value, mean_height, steps_to};
use super::pairing::{ComparisonError, Pair, Pairs, Run};
use super::statistics::{Estimate, average, bootstrap, improvement, mean};
use crate::run::EvalRow;
use crate::run::schema::EVAL_CSV;
use serde::Serialize;
use std::collections::BTreeMap;

/// How to compare.
#[derive(Debug, Clone)]
pub struct Options {
    /// What of the evaluations.
    pub metric: Metric,
    /// Threshold of all tasks that have none of their own.
    pub threshold: Option<f64>,
    /// Thresholds by task.
    pub thresholds: BTreeMap<String, f64>,
    /// Resamplings for the intervals of probabilities.
    pub repetitions: usize,
}

/// One measure of both sides.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// Mean of side A.
    pub a: f64,
    /// Mean of side B.
    pub b: f64,
    /// Mean difference A - B over the pairs.
    pub difference: Estimate,
    /// Probability that a run of A is better than one of B.
    pub improvement: Estimate,
    /// Pairs in which A is better.
    pub won: usize,
}

/// The pairs of one task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TaskComparison {
    /// The task.
    pub task: String,
    /// Seeds of the pairs.
    pub seeds: Vec<u64>,
    /// Steps up to which all runs are compared: the fewest that one of them took.
    pub steps: u64,
    /// Mean of the evaluations in the last tenth of the steps.
    pub final_value: Measured,
    /// Area under the learning curve over the steps: its mean height.
    pub area: Measured,
    /// Steps before the first evaluation that reaches the threshold; fewer are better. A run that never does counts
    /// with all its steps, which is fewer than it would need.
    pub steps_to_threshold: Measured,
    /// The threshold: as asked for, or else the lower one of the two sides' final values.
    pub threshold: f64,
    /// Runs of A and of B that reach it.
    pub reached: [usize; 2],
}

/// All tasks together: differences in units of what the better side gained on the untrained policy.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Overall {
    /// Pairs in all.
    pub pairs: usize,
    /// Difference of final values.
    pub final_value: Estimate,
    /// Difference of areas.
    pub area: Estimate,
    /// Probability of improvement of final values, mean over tasks.
    pub improvement: Estimate,
}

/// Everything that is known of two sides.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// What is compared.
    pub metric: Metric,
    /// Each task.
    pub tasks: Vec<TaskComparison>,
    /// All together, where there are several and each side gained something on each.
    pub all: Option<Overall>,
    /// What a reader should know, in words.
    pub notes: Vec<String>,
}

/// One figure of both runs of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Both {
    a: f64,
    b: f64,
}

/// The curves of a pair.
struct Curves {
    a: Vec<(u64, f64)>,
    b: Vec<(u64, f64)>,
}

impl Curves {
    fn map(&self, measure: impl Fn(&Points) -> f64) -> Both {
        Both {
            a: measure(&self.a),
            b: measure(&self.b),
        }
    }
}

/// What is compared of one task.
struct Task {
    result: TaskComparison,
    finals: Vec<Both>,
    heights: Vec<Both>,
    /// What the better side gained on the untrained policy.
    gain: f64,
}

/// Compares the pairs.
///
/// # Errors
/// When a run has no value of the metric, or a threshold is of a task that is not there.
pub fn compare(pairs: &Pairs, options: &Options) -> Result<Comparison, ComparisonError> {
    for task in options.thresholds.keys() {
        if !pairs.tasks.contains_key(task) {
            let tasks: Vec<&str> = pairs.tasks.keys().map(String::as_str).collect();
            return Err(ComparisonError::UnknownTask {
                threshold: task.clone(),
                tasks: tasks.join(", "),
            });
        }
    }
    let mut notes = Vec::new();
    let mut tasks = Vec::new();
    for (name, pairs) in &pairs.tasks {
        tasks.push(compare_task(name, pairs, options, &mut notes)?);
    }
    if tasks.iter().any(|task| task.finals.len() < 2) {
        notes.push("a single pair has no interval: more seeds are needed".into());
    }
    Ok(Comparison {
        metric: options.metric,
        all: overall(&tasks, options.repetitions, &mut notes),
        tasks: tasks.into_iter().map(|task| task.result).collect(),
        notes,
    })
}

fn compare_task(
    name: &str,
    pairs: &[Pair],
    options: &Options,
    notes: &mut Vec<String>,
) -> Result<Task, ComparisonError> {
    let horizon = horizon(name, pairs, notes);
    let mut curves = Vec::new();
    for pair in pairs {
        curves.push(Curves {
            a: points(&pair.a, options.metric)?,
            b: points(&pair.b, options.metric)?,
        });
    }
    let all = |measure: &dyn Fn(&Points) -> f64| -> Vec<Both> {
        curves.iter().map(|pair| pair.map(measure)).collect()
    };
    let finals = all(&|curve| final_value(curve, horizon));
    let heights = all(&|curve| mean_height(curve, horizon));
    let untrained = all(&|curve| curve[0].1);
    let (a, b) = means(&finals);
    let threshold = options.thresholds.get(name).copied();
    let threshold = threshold.or(options.threshold).unwrap_or(a.min(b));
    let reaching = |curve: &Points| steps_to(curve, threshold, horizon);
    let steps = all(&|curve| reaching(curve).unwrap_or(horizon) as f64);
    let reached = [
        curves.iter().filter(|c| reaching(&c.a).is_some()).count(),
        curves.iter().filter(|c| reaching(&c.b).is_some()).count(),
    ];
    let start = means(&untrained);
    let more = |pairs: &[Both]| measured(pairs, options.repetitions, false);
    Ok(Task {
        gain: (a - start.0).max(b - start.1),
        result: TaskComparison {
            task: name.to_owned(),
            seeds: pairs.iter().map(|pair| pair.seed).collect(),
            steps: horizon,
            final_value: more(&finals),
            area: more(&heights),
            steps_to_threshold: measured(&steps, options.repetitions, true),
            threshold,
            reached,
        },
        finals,
        heights,
    })
}

/// Steps up to which the runs can be compared; notes whose curve ends before the others.
fn horizon(task: &str, pairs: &[Pair], notes: &mut Vec<String>) -> u64 {
    let runs = || pairs.iter().flat_map(|pair| [&pair.a, &pair.b]);
    let shortest = runs().min_by_key(|run| run.last_step());
    let horizon = shortest.map_or(0, Run::last_step);
    let longest = runs().map(Run::last_step).max().unwrap_or(horizon);
    if let Some(run) = shortest.filter(|_| horizon < longest) {
        let run = run.directory.display();
        notes.push(format!(
            "{task}: compared up to step {horizon}, where {run} ends; others go on to {longest}"
        ));
    }
    for run in runs().filter(|run| run.last_step() < run.settings.steps) {
        let (directory, steps) = (run.directory.display(), run.settings.steps);
        let last = run.last_step();
        notes.push(format!(
            "{directory}: evaluated up to step {last} of {steps}"
        ));
    }
    horizon
}

fn points(run: &Run, metric: Metric) -> Result<Vec<(u64, f64)>, ComparisonError> {
    let value = |row: &EvalRow| match metric {
        Metric::Return => Some(row.return_mean),
        Metric::Success => row.success_rate,
    };
    let points = run.curve.iter().map(|row| Some((row.step, value(row)?)));
    let points: Option<Vec<_>> = points.collect();
    points.ok_or_else(|| ComparisonError::NoSuccess {
        path: run.directory.join(EVAL_CSV),
        task: run.task(),
    })
}

fn means(pairs: &[Both]) -> (f64, f64) {
    let mean = |side: fn(&Both) -> f64| pairs.iter().map(side).sum::<f64>() / pairs.len() as f64;
    (mean(|pair| pair.a), mean(|pair| pair.b))
}

fn measured(pairs: &[Both], repetitions: usize, fewer_is_better: bool) -> Measured {
    let (a, b) = means(pairs);
    let turned: Vec<Both> = pairs.iter().map(|p| Both { a: p.b, b: p.a }).collect();
    let better = if fewer_is_better { &turned[..] } else { pairs };
    Measured {
        a,
        b,
        difference: difference(&[pairs.to_vec()]),
        improvement: probability(&[better.to_vec()], repetitions),
        won: better.iter().filter(|pair| pair.a > pair.b).count(),
    }
}

/// Mean over tasks of the mean difference A - B of each task's pairs.
fn difference(tasks: &[Vec<Both>]) -> Estimate {
    let of_task = |pairs: &Vec<Both>| pairs.iter().map(|pair| pair.a - pair.b).collect();
    mean(&tasks.iter().map(of_task).collect::<Vec<_>>())
}

/// Mean over tasks of the probability that a run of A has more than one of B. A pair is drawn as a whole, for its runs share a
/// seed.
fn probability(tasks: &[Vec<Both>], repetitions: usize) -> Estimate {
    let of_task = |pairs: &Vec<Both>| {
        let side = |of: fn(&Both) -> f64| pairs.iter().map(of).collect::<Vec<_>>();
        improvement(&side(|pair| pair.a), &side(|pair| pair.b))
    };
    let of_all = |tasks: &[Vec<Both>]| average(&tasks.iter().map(of_task).collect::<Vec<_>>());
    bootstrap(tasks, of_all, repetitions)
}

/// All tasks together; nothing for a single one.
fn overall(tasks: &[Task], repetitions: usize, notes: &mut Vec<String>) -> Option<Overall> {
    if tasks.len() < 2 {
        return None;
    }
    if let Some(task) = tasks.iter().find(|task| task.gain <= 0.0) {
        let task = &task.result.task;
        notes.push(format!(
            "{task}: neither side gained on the untrained policy, which all tasks together are measured by"
        ));
        return None;
    }
    let scaled = |of: fn(&Task) -> &Vec<Both>| -> Vec<Vec<Both>> {
        let scale = |task: &Task| {
            let divided = |pair: &Both| Both {
                a: pair.a / task.gain,
                b: pair.b / task.gain,
            };
            of(task).iter().map(divided).collect()
        };
        tasks.iter().map(scale).collect()
    };
    let finals = scaled(|task| &task.finals);
    let heights = scaled(|task| &task.heights);
    Some(Overall {
        pairs: finals.iter().map(Vec::len).sum(),
        final_value: difference(&finals),
        area: difference(&heights),
        improvement: probability(&finals, repetitions),
    })
}
