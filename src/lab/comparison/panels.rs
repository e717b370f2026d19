//! Runs sorted into the panels of a figure, one a task, and into lines, one a method.

use super::measure::Points;
use super::pairing::{ComparisonError, Run};
use crate::run::EvalRow;
use crate::run::schema::EVAL_CSV;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// What of the evaluations is drawn: a column of `eval.csv`, under its name there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum EvalColumn {
    /// Mean return of an evaluation
    #[default]
    ReturnMean,
    /// Standard deviation of its returns
    ReturnStd,
    /// Its lowest return
    ReturnMin,
    /// Its highest return
    ReturnMax,
    /// Mean length of its episodes
    LengthMean,
    /// Fraction of its episodes that succeeded
    SuccessRate,
}

impl EvalColumn {
    /// The figure of an evaluation; `None` where the task does not know it.
    fn of(self, row: &EvalRow) -> Option<f64> {
        match self {
            EvalColumn::ReturnMean => Some(row.return_mean),
            EvalColumn::ReturnStd => Some(row.return_std),
            EvalColumn::ReturnMin => Some(row.return_min),
            EvalColumn::ReturnMax => Some(row.return_max),
            EvalColumn::LengthMean => Some(row.length_mean),
            EvalColumn::SuccessRate => row.success_rate,
        }
    }
}

/// One run of a line.
#[derive(Debug, Clone)]
pub(super) struct Drawn {
    pub directory: PathBuf,
    pub label: String,
    pub seed: u64,
    /// Step of the last evaluation that its settings ask for.
    pub planned: u64,
    /// At least one point.
    pub curve: Vec<(u64, f64)>,
}

impl Drawn {
    /// Step of the last evaluation that there is.
    pub fn last(&self) -> u64 {
        self.curve[self.curve.len() - 1].0
    }

    /// The curve with every value replaced by the mean of the last `window` ones, of fewer at the beginning.
    pub fn smoothed(&self, window: usize) -> Vec<(u64, f64)> {
        let mean = |values: &Points| {
            values.iter().map(|(_, value)| value).sum::<f64>() / values.len() as f64
        };
        let smooth = |i: usize| {
            (
                self.curve[i].0,
                mean(&self.curve[(i + 1).saturating_sub(window)..=i]),
            )
        };
        (0..self.curve.len()).map(smooth).collect()
    }
}

/// A task in one folder, and its lines: the runs of each method, seeds growing.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    pub title: String,
    pub task: String,
    pub lines: BTreeMap<String, Vec<Drawn>>,
}

impl Panel {
    /// All its runs.
    pub fn runs(&self) -> impl Iterator<Item = &Drawn> {
        self.lines.values().flatten()
    }

    /// The step at which the longest of its runs ends, or is to end.
    pub fn intended_end(&self) -> u64 {
        intended_end(self.runs())
    }
}

/// The step at which the longest of the runs ends, or is to end.
pub(super) fn intended_end<'a>(runs: impl IntoIterator<Item = &'a Drawn>) -> u64 {
    let end = |run: &Drawn| run.planned.max(run.last());
    runs.into_iter().map(end).max().unwrap_or(0)
}

/// Sorts runs into panels by task and folder, or, to `merge` them, by task alone; ordered by title.
///
/// The directory of a run is `<folder>/<method>/seed-<n>`, or `<folder>/<method>`.
///
/// # Errors
/// When a run does not have the column, or a seed of a line is there twice.
pub(super) fn panels(
    runs: Vec<Run>,
    column: EvalColumn,
    merge: bool,
) -> Result<Vec<Panel>, ComparisonError> {
    type Lines = BTreeMap<String, BTreeMap<u64, Drawn>>;
    let mut sorted: BTreeMap<(String, PathBuf), Lines> = BTreeMap::new();
    for run in runs {
        let (label, folder) = place(&run);
        let key = (task(&run), if merge { PathBuf::new() } else { folder });
        let drawn = drawn(run, label, column)?;
        let line = sorted.entry(key.clone()).or_default();
        let line = line.entry(drawn.label.clone()).or_default();
        if let Some(other) = line.get(&drawn.seed) {
            return Err(ComparisonError::Again {
                run: drawn.directory,
                line: format!("seed {} of {} on {}", drawn.seed, drawn.label, key.0),
                other: other.directory.clone(),
            });
        }
        line.insert(drawn.seed, drawn);
    }
    let folders = |task: &str| -> Vec<&Path> {
        let of_task = sorted.keys().filter(|(other, _)| other == task);
        of_task.map(|(_, folder)| folder.as_path()).collect()
    };
    let titles: Vec<String> = sorted
        .keys()
        .map(|(task, folder)| title(task, folder, &folders(task)))
        .collect();
    let panel = |(((task, _), lines), title): (((String, PathBuf), Lines), String)| Panel {
        title,
        task,
        lines: lines
            .into_iter()
            .map(|(label, runs)| (label, runs.into_values().collect()))
            .collect(),
    };
    let mut panels: Vec<Panel> = sorted.into_iter().zip(titles).map(panel).collect();
    panels.sort_by_cached_key(|panel| by_number(&panel.title));
    Ok(panels)
}

/// The task of a run, with what changes it.
fn task(run: &Run) -> String {
    let task = run.settings.task();
    match run.settings.period() {
        Some(period) => format!("{task}, period {period}"),
        None => task.to_owned(),
    }
}

/// The name of a run's line, and the folder that holds the lines.
fn place(run: &Run) -> (String, PathBuf) {
    let directory = run.directory.canonicalize();
    let directory = directory.unwrap_or_else(|_| run.directory.clone());
    let name = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let above = |path: &Path| path.parent().unwrap_or(path).to_owned();
    let (mut label, mut folder) = (name(&directory), above(&directory));
    let seed = label.strip_prefix("seed-");
    if seed.is_some_and(|seed| !seed.is_empty() && seed.bytes().all(|b| b.is_ascii_digit())) {
        (label, folder) = (name(&folder), above(&folder));
    }
    if let Some(period) = run.settings.period() {
        // The panel says it: the same method keeps one name in all of them.
        let plain = label.strip_suffix(&format!("-period-{period}"));
        label = plain.unwrap_or(&label).to_owned();
    }
    (label, folder)
}

fn drawn(run: Run, label: String, column: EvalColumn) -> Result<Drawn, ComparisonError> {
    let point = |row: &EvalRow| Some((row.step, column.of(row)?));
    let curve: Option<Vec<_>> = run.curve.iter().map(point).collect();
    let Some(curve) = curve else {
        return Err(ComparisonError::NoSuccess {
            path: run.directory.join(EVAL_CSV),
            task: run.task(),
        });
    };
    let (steps, every) = (run.settings.steps, run.settings.evaluated_every());
    Ok(Drawn {
        label,
        seed: run.settings.seed,
        planned: steps - steps % every,
        curve,
        directory: run.directory,
    })
}

/// The task, and where several folders have it also the end of the folder's path that tells them apart.
fn title(task: &str, folder: &Path, folders: &[&Path]) -> String {
    if folders.len() == 1 {
        return task.to_owned();
    }
    let parts = |path: &Path| -> Vec<String> {
        let named = path
            .components()
            .filter(|part| matches!(part, Component::Normal(_)));
        named
            .map(|part| part.as_os_str().to_string_lossy().into_owned())
            .collect()
    };
    let end = |path: &Path, length: usize| {
        let parts = parts(path);
        parts[parts.len().saturating_sub(length)..].join("/")
    };
    let all = parts(folder).len().max(1);
    let is_unique = |length: &usize| {
        let name = end(folder, *length);
        folders
            .iter()
            .filter(|other| end(other, *length) == name)
            .count()
            == 1
    };
    let name = end(folder, (1..=all).find(is_unique).unwrap_or(all));
    if name.starts_with(task) {
        name
    } else {
        format!("{task} ({name})")
    }
}

/// A key that sorts "period 50" before "period 200": texts and numbers by turns.
fn by_number(text: &str) -> Vec<(String, u64)> {
    let mut key: Vec<(String, u64)> = vec![Default::default()];
    let mut in_number = false;
    for c in text.chars() {
        match c.to_digit(10) {
            Some(digit) => {
                in_number = true;
                if let Some((_, number)) = key.last_mut() {
                    *number = number.saturating_mul(10).saturating_add(u64::from(digit));
                }
            }
            None => {
                if in_number {
                    key.push(Default::default());
                    in_number = false;
                }
                if let Some((text, _)) = key.last_mut() {
                    text.push(c);
                }
            }
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_one_task_are_told_apart_by_the_end_of_their_path() {
        let folders = ["/a/x/Hopper-v4", "/a/y/Hopper-v4", "/b/z"].map(Path::new);
        let titled = folders.map(|folder| title("Hopper-v4", folder, &folders));
        let expected = [
            "Hopper-v4 (x/Hopper-v4)",
            "Hopper-v4 (y/Hopper-v4)",
            "Hopper-v4 (z)",
        ];
        assert_eq!(titled, expected);
        assert_eq!(title("T", folders[0], &folders[..1]), "T");
    }

    #[test]
    fn titles_are_sorted_by_their_numbers() {
        let mut titles = ["T, period 200", "T", "T, period 50", "S 3"];
        titles.sort_by_cached_key(|title| by_number(title));
        assert_eq!(titles, ["S 3", "T", "T, period 50", "T, period 200"]);
    }

    #[test]
    fn a_smoothed_point_is_the_mean_of_the_last_ones() {
        let run = Drawn {
            directory: PathBuf::new(),
            label: String::new(),
            seed: 0,
            planned: 30,
            curve: vec![(0, 1.0), (10, 3.0), (20, 8.0)],
        };
        assert_eq!(run.smoothed(2), [(0, 1.0), (10, 2.0), (20, 5.5)]);
        assert_eq!(run.smoothed(1), run.curve);
    }
}
