//! Runs of two sides, paired by task and seed.

use crate::config::DoubledActions;
use crate::core::paths::{PatternsError, matching};
use crate::core::text;
use crate::core::walk::{Walk, WalkError};
use crate::run::schema::{CONFIG_TOML, EVAL_CSV};
use crate::run::{CurveError, EvalRow, read_evaluations};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// Why two sides can't be compared. Every message names files, or the runs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ComparisonError {
    /// A side names nothing.
    #[error(
        "{0}: no such directory; a run directory is needed, a folder above some, or a quoted pattern of them, for example 'runs/comparison/*/mamf'"
    )]
    Missing(String),
    /// A side is no pattern.
    #[error("{pattern}: {error}")]
    Pattern {
        /// The side as it was given.
        pattern: String,
        /// Where it goes wrong; part of the message, and hence no source of it.
        error: PatternsError,
    },
    /// There is no run.
    #[error("{0}: no run there, that is, no directory that holds an eval.csv")]
    NoRun(String),
    /// A directory or a file can't be read.
    #[error("{}: {error}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// A directory can't be searched.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// The settings of a run are not what they should be.
    #[error("{}: {error}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// Position and reason.
        error: Box<toml::de::Error>,
    },
    /// The curve of a run can't be read.
    #[error(transparent)]
    Curve(CurveError),
    /// A run has no evaluation of a policy that was trained.
    #[error(
        "{}: every evaluation in it is of the untrained policy, the last one after step {last} of {random} random ones; there is \
         nothing to compare: let the run go on",
        path.display()
    )]
    Untrained {
        /// Its curve.
        path: PathBuf,
        /// Steps before its last evaluation.
        last: u64,
        /// Steps before which nothing is trained.
        random: u64,
    },
    /// Two runs of one side have the same task and seed.
    #[error(
        "{side}: two runs of {key}: {} and {}; name the runs of one method, for example with a pattern such as 'runs/comparison/*/mamf'", runs[0].display(), runs[1].display()
    )]
    Twice {
        /// The side as it was given.
        side: String,
        /// Task and seed.
        key: String,
        /// The runs.
        runs: [PathBuf; 2],
    },
    /// One run stands on both sides.
    #[error("{}: this run is on both sides", .0.display())]
    Same(PathBuf),
    /// Some runs have no partner.
    #[error(
        "without a partner of the same task and seed: {}; {}",
        .0.join(", "),
        "make the missing runs, name the sides more closely, or leave them out with --paired-only"
    )]
    Unpaired(Vec<String>),
    /// No run has a partner.
    #[error("no two runs have the same task and seed: A has {}; B has {}", .0[0], .0[1])]
    NothingPairs([String; 2]),
    /// A run has no such figure.
    #[error("{}: success_rate is empty: the task {task} does not know success; choose another --metric", path.display())]
    NoSuccess {
        /// Its curve.
        path: PathBuf,
        /// Its task.
        task: String,
    },
    /// A run of a line has the seed of another one.
    #[error("{}: {line} a second time, after {}; leave one of them out", run.display(), other.display())]
    Again {
        /// The run.
        run: PathBuf,
        /// Seed, line and task.
        line: String,
        /// The other run.
        other: PathBuf,
    },
    /// Runs of a line are never evaluated at the same step.
    #[error("{}: no evaluation at a step at which {} has one too", .0[0].display(), .0[1].display())]
    NoCommonStep([PathBuf; 2]),
    /// A file of scales does not have that of a panel.
    #[error("{}: a line \"{title}\" = [low, high] with low < high is needed, found {found}", path.display())]
    Scale {
        /// The file.
        path: PathBuf,
        /// The panel.
        title: String,
        /// What is there.
        found: String,
    },
    /// A threshold is for a task that is not compared.
    #[error("--threshold {threshold}: no such task is compared; compared are {tasks}")]
    UnknownTask {
        /// The option.
        threshold: String,
        /// Those that there are.
        tasks: String,
    },
}

/// A run and its learning curve.
#[derive(Debug, Clone)]
pub struct Run {
    /// Its directory.
    pub directory: PathBuf,
    /// What of its settings matters here.
    pub settings: Settings,
    /// Its evaluations.
    pub curve: Vec<EvalRow>,
}

/// Part of a run's `config.toml`. The rest may be that of an older or a newer version.
#[derive(Debug, Clone, Deserialize)]
pub struct Settings {
    task: String,
    doubled_actions: Option<DoubledActions>,
    evaluation: Option<Evaluations>,
    random_steps: Option<u64>,
    /// Seed of the run.
    pub seed: u64,
    /// Environment steps that it is to take.
    pub steps: u64,
}

/// When a run is evaluated.
#[derive(Debug, Clone, Deserialize)]
struct Evaluations {
    every: Option<u64>,
}

impl Settings {
    /// Id of the task.
    pub(super) fn task(&self) -> &str {
        &self.task
    }

    /// Steps after which the halves of doubled actions change places, where they are doubled.
    pub(super) fn period(&self) -> Option<usize> {
        self.doubled_actions.as_ref().map(|doubled| doubled.period)
    }

    /// Steps between two evaluations; one where it is not said.
    pub(super) fn evaluated_every(&self) -> u64 {
        let every = self
            .evaluation
            .as_ref()
            .and_then(|evaluation| evaluation.every);
        every.unwrap_or(1).max(1)
    }
}

impl Run {
    /// Reads the run in `directory`.
    fn read(directory: &Path) -> Result<Run, ComparisonError> {
        let path = directory.join(CONFIG_TOML);
        let text = text::read(&path).map_err(unreadable(path.clone()))?;
        let settings = toml::from_str(&text).map_err(|error| ComparisonError::Settings {
            path,
            error: Box::new(error),
        })?;
        let curve = read_evaluations(&directory.join(EVAL_CSV));
        Ok(Run {
            directory: directory.to_owned(),
            settings,
            curve: curve.map_err(ComparisonError::Curve)?,
        })
    }

    /// Its task in words; what changes the task is part of it.
    pub fn task(&self) -> String {
        let task = &self.settings.task;
        match self.settings.period() {
            None => task.clone(),
            Some(period) => format!("{task} with doubled actions, period {period}"),
        }
    }

    /// Makes sure that some evaluation is of a policy that was trained.
    fn check_trained(&self) -> Result<(), ComparisonError> {
        let (last, random) = (self.last_step(), self.settings.random_steps.unwrap_or(0));
        match last > random {
            true => Ok(()),
            false => Err(ComparisonError::Untrained {
                path: self.directory.join(EVAL_CSV),
                last,
                random,
            }),
        }
    }

    /// Environment steps before its last evaluation.
    pub fn last_step(&self) -> u64 {
        self.curve.last().map_or(0, |row| row.step)
    }
}

/// The runs that any of `patterns` names, each once.
///
/// # Errors
/// As [`find`].
pub fn find_all(patterns: &[PathBuf]) -> Result<Vec<Run>, ComparisonError> {
    let mut found = BTreeMap::new();
    for pattern in patterns {
        for run in find(pattern)? {
            let place = run.directory.canonicalize();
            let place = place.map_err(unreadable(run.directory.clone()))?;
            found.entry(place).or_insert(run);
        }
    }
    Ok(found.into_values().collect())
}

/// The runs that `side` names, a directory or a pattern of directories, and those below.
///
/// # Errors
/// When there is none, or one can't be read.
pub fn find(side: &Path) -> Result<Vec<Run>, ComparisonError> {
    let text = || side.display().to_string();
    let mut found = matching(side).map_err(|error| ComparisonError::Pattern {
        pattern: text(),
        error,
    })?;
    found.retain(|path| path.is_dir());
    if found.is_empty() {
        return Err(ComparisonError::Missing(text()));
    }
    let mut directories = Vec::new();
    let mut walk = Walk::default();
    for directory in found {
        descend(&mut walk, &directory, &mut directories)?;
    }
    if directories.is_empty() {
        return Err(ComparisonError::NoRun(text()));
    }
    directories.sort();
    directories.iter().map(|run| Run::read(run)).collect()
}

/// Adds the run in `directory`, or all runs below.
fn descend(walk: &mut Walk, directory: &Path, runs: &mut Vec<PathBuf>) -> Result<(), WalkError> {
    let enters = |directory: &Path| {
        let is_run = directory.join(EVAL_CSV).is_file();
        if is_run {
            runs.push(directory.to_owned());
        }
        !is_run
    };
    walk.files(directory, enters)?;
    Ok(())
}

pub(super) fn unreadable(path: PathBuf) -> impl FnOnce(io::Error) -> ComparisonError {
    |error| ComparisonError::Unreadable { path, error }
}

/// Two runs of one task and seed.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Their seed.
    pub seed: u64,
    /// The run of side A.
    pub a: Run,
    /// The run of side B.
    pub b: Run,
}

/// Pairs by task, and who has no partner.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// Of each task at least one, seeds growing.
    pub tasks: BTreeMap<String, Vec<Pair>>,
    /// Runs without a partner, in words.
    pub unpaired: Vec<String>,
}

/// Task and seed.
type Key = (String, u64);

/// Pairs the runs of two sides, which are called by `names` in messages.
///
/// # Errors
/// When two runs of a side have the same task and seed, a run is on both sides or was not evaluated once it was trained, or
/// nothing pairs.
pub fn pair(sides: [Vec<Run>; 2], names: [&str; 2]) -> Result<Pairs, ComparisonError> {
    let [a, b] = sides;
    let (a, mut b) = (by_key(a, names[0])?, by_key(b, names[1])?);
    let seeds = |runs: &BTreeMap<Key, Run>| {
        let keys: Vec<String> = runs.keys().map(in_words).collect();
        keys.join(", ")
    };
    let both = [seeds(&a), seeds(&b)];
    let mut pairs = Pairs {
        tasks: BTreeMap::new(),
        unpaired: Vec::new(),
    };
    let lonely = |key: &Key, run: &Run| format!("{} ({})", run.directory.display(), in_words(key));
    for (key, a) in a {
        let Some(b) = b.remove(&key) else {
            pairs.unpaired.push(lonely(&key, &a));
            continue;
        };
        if is_same(&a.directory, &b.directory) {
            return Err(ComparisonError::Same(a.directory));
        }
        a.check_trained()?;
        b.check_trained()?;
        let (task, seed) = key;
        let of_task = pairs.tasks.entry(task).or_default();
        of_task.push(Pair { seed, a, b });
    }
    pairs
        .unpaired
        .extend(b.iter().map(|(key, run)| lonely(key, run)));
    if pairs.tasks.is_empty() {
        return Err(ComparisonError::NothingPairs(both));
    }
    Ok(pairs)
}

fn by_key(runs: Vec<Run>, side: &str) -> Result<BTreeMap<Key, Run>, ComparisonError> {
    let mut found: BTreeMap<Key, Run> = BTreeMap::new();
    for run in runs {
        let key = (run.task(), run.settings.seed);
        if let Some(other) = found.get(&key) {
            return Err(ComparisonError::Twice {
                side: side.to_owned(),
                key: in_words(&key),
                runs: [other.directory.clone(), run.directory],
            });
        }
        found.insert(key, run);
    }
    Ok(found)
}

fn in_words((task, seed): &Key) -> String {
    format!("{task} seed {seed}")
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
