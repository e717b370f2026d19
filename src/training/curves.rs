//! The learning curves: `train.csv`, `eval.csv` and, apart from them, `timing.csv`.
//!
//! Wall-clock figures live in `timing.csv` alone, so that two runs of one seed are equal byte for
//! byte in the other two. A figure that does not exist in a row is an empty field.

use super::manifest::Seal;
use super::telemetry::ImaginedErrors;
use super::{DiskError, Evaluation, provenance};
use crate::agent::Figures;
use crate::files::{FileError, Files};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// One row of `eval.csv`: the episodes of one evaluation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EvalRow {
    /// Environment steps taken before it.
    pub step: u64,
    /// How many episodes.
    pub episodes: usize,
    /// Mean of their returns.
    pub return_mean: f64,
    /// Standard deviation of their returns.
    pub return_std: f64,
    /// Lowest return.
    pub return_min: f64,
    /// Highest return.
    pub return_max: f64,
    /// Mean length in steps.
    pub length_mean: f64,
    /// Fraction of them that ended in success, where the task knows success.
    pub success_rate: Option<f64>,
}

/// The columns of `eval.csv`.
const EVAL_COLUMNS: [&str; 8] = [
    "step",
    "episodes",
    "return_mean",
    "return_std",
    "return_min",
    "return_max",
    "length_mean",
    "success_rate",
];

impl EvalRow {
    pub(super) fn new(step: u64, evaluation: &Evaluation) -> EvalRow {
        EvalRow {
            step,
            episodes: evaluation.episodes.len(),
            return_mean: evaluation.return_mean(),
            return_std: evaluation.return_std(),
            return_min: evaluation.return_min(),
            return_max: evaluation.return_max(),
            length_mean: evaluation.length_mean(),
            success_rate: evaluation.success_rate(),
        }
    }

    /// The first of its figures that is no finite number, and its column.
    fn not_finite(&self) -> Option<(&'static str, f64)> {
        let figures = [
            self.return_mean,
            self.return_std,
            self.return_min,
            self.return_max,
            self.length_mean,
            self.success_rate.unwrap_or_default(),
        ];
        let mut named = EVAL_COLUMNS[2..].iter().copied().zip(figures);
        named.find(|(_, figure)| !figure.is_finite())
    }
}

/// Why a curve can't be read. Every message names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CurveError {
    /// The system does not give it.
    #[error("{}: can't read the curve: {error}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// No row is in it.
    #[error("{}: there is no evaluation in it; the run has only begun, or the file was cut short", .0.display())]
    Empty(PathBuf),
    /// Its columns are others.
    #[error(
        "{}: its columns are {found}, those of eval.csv are {}; it is another file, or another version wrote it{}",
        path.display(), EVAL_COLUMNS.join(","), versions(version.as_deref())
    )]
    Columns {
        /// The file.
        path: PathBuf,
        /// Its header.
        found: String,
        /// Version of the program, as the run's provenance tells.
        version: Option<String>,
    },
    /// A line is not what it should be.
    #[error("{}, line {line}: {reason}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: u64,
        /// What is wrong, and what would be right.
        reason: String,
    },
}

/// The version that wrote a curve and ours, where they differ.
fn versions(theirs: Option<&str>) -> String {
    let ours = env!("CARGO_PKG_VERSION");
    match theirs.filter(|theirs| *theirs != ours) {
        Some(theirs) => format!(": mamf {theirs} by run.json, this is mamf {ours}"),
        None => String::new(),
    }
}

/// Reads the `eval.csv` of a run: at least one row, steps growing, returns finite.
///
/// # Errors
/// When the file is missing, empty, cut short, damaged, or of another version.
pub fn read_evaluations(path: &Path) -> Result<Vec<EvalRow>, CurveError> {
    let text = fs::read_to_string(path).map_err(|error| CurveError::Unreadable {
        path: path.to_owned(),
        error,
    })?;
    let wrong = |line: u64, reason: String| CurveError::Line {
        path: path.to_owned(),
        line,
        reason,
    };
    let header = text.lines().next().unwrap_or_default();
    if header.is_empty() {
        return Err(CurveError::Empty(path.to_owned()));
    }
    if header != EVAL_COLUMNS.join(",") {
        return Err(CurveError::Columns {
            path: path.to_owned(),
            found: header.to_owned(),
            version: provenance::version(&path.with_file_name("run.json")),
        });
    }
    if !text.ends_with('\n') {
        let line = text.lines().count() as u64;
        return Err(wrong(
            line,
            "the line does not end: the file was cut short".into(),
        ));
    }
    let mut rows: Vec<EvalRow> = Vec::new();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    for row in reader.deserialize() {
        let line = rows.len() as u64 + 2;
        let row: EvalRow = row.map_err(|error| wrong(line, reason_of(&error)))?;
        if let Some((column, found)) = row.not_finite() {
            return Err(wrong(line, format!("{column} {found} is not finite")));
        }
        if let Some(before) = rows.last().filter(|before| before.step >= row.step) {
            let (step, before) = (row.step, before.step);
            return Err(wrong(
                line,
                format!("step {step} after {before}; steps must grow"),
            ));
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(CurveError::Empty(path.to_owned()));
    }
    Ok(rows)
}

/// Why a row is none, without the line, which csv counts by bytes and records as well.
fn reason_of(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            len, expected_len, ..
        } => {
            format!("{len} fields instead of {expected_len}: the file is damaged")
        }
        csv::ErrorKind::Deserialize { err, .. } => {
            let column = err
                .field()
                .and_then(|field| EVAL_COLUMNS.get(field as usize));
            let column = column.copied().unwrap_or("a field");
            format!("{column}: {}", err.kind())
        }
        _ => error.to_string(),
    }
}

/// The fields of the last whole row of a curve, also of one that is being written.
pub fn last_row(path: &Path) -> Option<Vec<String>> {
    let text = fs::read_to_string(path).ok()?;
    let whole = &text[..text.rfind('\n')?];
    let row = whole.lines().skip(1).last()?;
    Some(row.split(',').map(str::to_owned).collect())
}

/// One row of `train.csv`: means over the steps since the row before.
#[derive(Debug, Serialize)]
pub(super) struct TrainRow {
    step: u64,
    episodes: u64,
    return_mean: Option<f64>,
    length_mean: Option<f64>,
    diverged: u64,
    updates: u64,
    critic_loss: Option<f64>,
    actor_loss: Option<f64>,
    q_mean: Option<f64>,
    model_loss: Option<f64>,
    model_error: Option<f64>,
    eta: Option<f64>,
    target_kept: Option<f64>,
    uncertainty_kept: Option<f64>,
    kept: Option<f64>,
    temperature: Option<f64>,
    entropy: Option<f64>,
    q_bias: Option<f64>,
    kept_state_error: Option<f64>,
    kept_reward_error: Option<f64>,
    kept_target_error: Option<f64>,
    dropped_state_error: Option<f64>,
    dropped_reward_error: Option<f64>,
    dropped_target_error: Option<f64>,
}

/// What an evaluation measured besides returns.
#[derive(Debug, Default)]
pub(super) struct Measured {
    /// Of the model on the newest transitions.
    pub model_error: Option<f32>,
    /// Of the critics on the evaluation's episodes.
    pub q_bias: Option<f64>,
    /// Of imagined steps, kept and dropped, in the simulator.
    pub imagined: [ImaginedErrors; 2],
}

/// One row of `timing.csv`, seconds of wall clock since the row before.
#[derive(Debug, Serialize)]
pub(super) struct TimingRow {
    pub step: u64,
    pub seconds: f64,
    pub steps_per_second: f64,
    pub environment_seconds: f64,
    pub update_seconds: f64,
    pub evaluation_seconds: f64,
    pub checkpoint_seconds: f64,
}

/// A mean that may be of nothing.
#[derive(Debug, Default, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Mean {
    sum: f64,
    n: u64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.n += 1;
    }

    fn get(self) -> Option<f64> {
        (self.n > 0).then(|| self.sum / self.n as f64)
    }
}

/// What happened since the last row of `train.csv`.
#[derive(Debug, Default, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Interval {
    episodes: u64,
    episode_return: Mean,
    length: Mean,
    diverged: u64,
    updates: u64,
    critic_loss: Mean,
    actor_loss: Mean,
    q_mean: Mean,
    model_loss: Mean,
    eta: Option<f64>,
    target_kept: Mean,
    uncertainty_kept: Mean,
    kept: Mean,
    temperature: Mean,
    entropy: Mean,
}

impl Interval {
    /// An episode of the training environment ended.
    pub(super) fn episode(&mut self, episode_return: f64, length: u64) {
        self.episodes += 1;
        self.episode_return.add(episode_return);
        self.length.add(length as f64);
    }

    /// The simulation blew up.
    pub(super) fn diverged(&mut self) {
        self.diverged += 1;
    }

    /// A step of the model alone.
    pub(super) fn model_step(&mut self, loss: f32) {
        self.model_loss.add(f64::from(loss));
    }

    /// An update of phase 2.
    pub(super) fn update(&mut self, figures: &Figures) {
        self.updates += 1;
        self.critic_loss
            .add(figures.critic_losses.iter().map(|l| f64::from(*l)).sum());
        self.q_mean.add(f64::from(figures.q_mean));
        if let Some(loss) = figures.actor_loss {
            self.actor_loss.add(f64::from(loss));
        }
        if let Some(loss) = figures.model_loss {
            self.model_step(loss);
        }
        if let Some(imagination) = figures.imagination {
            self.eta = Some(imagination.noise_bound);
            self.target_kept.add(imagination.by_target);
            self.uncertainty_kept.add(imagination.by_uncertainty);
            self.kept.add(imagination.kept);
        }
        if let Some(entropy) = figures.entropy {
            self.temperature.add(f64::from(entropy.temperature));
            self.entropy.add(f64::from(-entropy.log_density));
        }
    }

    /// The row at `step`, and a new interval.
    pub(super) fn take(&mut self, step: u64, measured: &Measured) -> TrainRow {
        let [kept, dropped] = measured.imagined;
        let i = std::mem::take(self);
        TrainRow {
            step,
            episodes: i.episodes,
            return_mean: i.episode_return.get(),
            length_mean: i.length.get(),
            diverged: i.diverged,
            updates: i.updates,
            critic_loss: i.critic_loss.get(),
            actor_loss: i.actor_loss.get(),
            q_mean: i.q_mean.get(),
            model_loss: i.model_loss.get(),
            model_error: measured.model_error.map(f64::from),
            eta: i.eta,
            target_kept: i.target_kept.get(),
            uncertainty_kept: i.uncertainty_kept.get(),
            kept: i.kept.get(),
            temperature: i.temperature.get(),
            entropy: i.entropy.get(),
            q_bias: measured.q_bias,
            kept_state_error: kept.state,
            kept_reward_error: kept.reward,
            kept_target_error: kept.target,
            dropped_state_error: dropped.state,
            dropped_reward_error: dropped.reward,
            dropped_target_error: dropped.target,
        }
    }
}

/// The files, in the order of [`Curves`]' tables.
const FILES: [&str; 3] = ["train.csv", "eval.csv", "timing.csv"];

/// The three files. Each row is written at once, so that a crash costs no row that was there.
pub(super) struct Curves {
    files: Files,
    train: Table,
    eval: Table,
    timing: Table,
}

fn length(sealed: &BTreeMap<String, Seal>, name: &str) -> u64 {
    sealed.get(name).map_or(0, |seal| seal.bytes)
}

/// One file.
struct Table {
    path: PathBuf,
    file: File,
    /// The header is still to be written.
    empty: bool,
}

impl Curves {
    /// Makes the files in the run directory.
    pub(super) fn create(files: &Files, directory: &Path) -> Result<Curves, FileError> {
        let create = |name| {
            let path = directory.join(name);
            let file = files.create(&path)?;
            Ok::<_, FileError>(Table {
                path,
                file,
                empty: true,
            })
        };
        let [train, eval, timing] = FILES;
        let curves = Curves {
            train: create(train)?,
            eval: create(eval)?,
            timing: create(timing)?,
            files: files.clone(),
        };
        files.sync_dir(directory)?;
        Ok(curves)
    }

    /// Opens the files in the run directory, to go on after what is sealed of each once they are
    /// [`cut`](Curves::cut).
    pub(super) fn open(
        files: &Files,
        directory: &Path,
        sealed: &BTreeMap<String, Seal>,
    ) -> Result<Curves, FileError> {
        let open = |name: &str| {
            let path = directory.join(name);
            Ok::<_, FileError>(Table {
                file: files.open_to_append(&path)?,
                path,
                empty: length(sealed, name) == 0,
            })
        };
        let [train, eval, timing] = FILES;
        Ok(Curves {
            train: open(train)?,
            eval: open(eval)?,
            timing: open(timing)?,
            files: files.clone(),
        })
    }

    /// Removes the rows after what is sealed.
    pub(super) fn cut(&self, sealed: &BTreeMap<String, Seal>) -> Result<(), FileError> {
        let tables = [&self.train, &self.eval, &self.timing];
        let mut named = FILES.iter().zip(tables);
        named.try_for_each(|(name, table)| self.files.truncate(&table.path, length(sealed, name)))
    }

    /// Waits until all rows outlive a loss of power, and seals them.
    pub(super) fn seal(&self) -> Result<BTreeMap<String, Seal>, FileError> {
        let tables = [&self.train, &self.eval, &self.timing];
        let seals = FILES.iter().zip(tables).map(|(name, table)| {
            self.files.sync(&table.file, &table.path)?;
            let bytes = fs::read(&table.path).map_err(FileError::at(&table.path))?;
            Ok(((*name).to_owned(), Seal::of(&bytes)))
        });
        seals.collect()
    }

    /// Writes a row of `eval.csv`.
    pub(super) fn evaluated(&mut self, row: EvalRow) -> Result<(), DiskError> {
        self.eval.write(&self.files, row)
    }

    /// Writes a row of `train.csv` and one of `timing.csv`.
    pub(super) fn trained(&mut self, row: TrainRow, timing: TimingRow) -> Result<(), DiskError> {
        self.train.write(&self.files, row)?;
        self.timing.write(&self.files, timing)
    }
}

impl Table {
    fn write(&mut self, files: &Files, row: impl Serialize) -> Result<(), DiskError> {
        let mut writer = csv::WriterBuilder::new()
            .has_headers(self.empty)
            .from_writer(Vec::new());
        let wrong = |path: &Path, error| DiskError::Row {
            path: path.to_owned(),
            error,
        };
        writer
            .serialize(row)
            .map_err(|error| wrong(&self.path, error))?;
        let line = writer.into_inner();
        let line = line.map_err(|error| wrong(&self.path, error.into_error().into()))?;
        files.append(&mut self.file, &self.path, &line)?;
        self.empty = false;
        Ok(())
    }
}
