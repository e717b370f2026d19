//! Checkpoints: directories that appear whole or not at all.
//!
//! `weights.safetensors` holds every network by plain names (`actor.l1.weight`, `[inputs, outputs]`)
//! and the observation scaling; `config.toml` the whole configuration; `checkpoint.json` the step. This is
//! what evaluation needs. A checkpoint that a run can go on from holds more, which is the trainer's business
//! (`training/state.rs`). `manifest.json` says what belongs to it.

mod store;

pub(crate) use store::{recover, remove_all, set_aside, stand, standing, write};

use super::manifest::{MANIFEST, Manifest};
use super::schema::{CONFIG_TOML as CONFIG, RUN_JSON};
use crate::config::{self, Config, ConfigError, Overrides};
use crate::core::files::FileError;
use crate::nn::{ObservationScaling, WeightError, Weights};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The networks and the observation scaling.
pub(crate) const WEIGHTS: &str = "weights.safetensors";
/// Times that a checkpoint may be replaced while it is read.
const MOST_CHANGES: usize = 20;
/// Time for a run to put its new checkpoint in place.
const PAUSE: Duration = Duration::from_millis(20);

const STATE: &str = "checkpoint.json";

/// A loaded checkpoint.
#[derive(Debug)]
pub struct Checkpoint {
    /// Where it was loaded from.
    pub path: PathBuf,
    /// The run's configuration.
    pub config: Config,
    /// Environment steps taken when it was saved.
    pub step: u64,
    weights: Weights,
}

/// `checkpoint.json`.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    step: u64,
    task: String,
    method: String,
    /// Mean return of the evaluation last made before it was saved.
    return_mean: Option<f64>,
    mamf_version: String,
}

/// Why a checkpoint can't be saved or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// There is none.
    #[error(
        "{}: no checkpoint here (expected a run directory, or a directory with {WEIGHTS}, {CONFIG} and {STATE})",
        .0.display()
    )]
    Missing(PathBuf),
    /// A run has none.
    #[error(
        "{}: this run has no checkpoint: it ended before the first one was saved, or its curves alone were kept; \
         `mamf train --resume` goes on with it where it has a folder checkpoints/",
        .0.display()
    )]
    NotSaved(PathBuf),
    /// It belongs to another task.
    #[error("{}: checkpoint of task `{found}`, expected `{expected}`", path.display())]
    OtherTask {
        /// The checkpoint.
        path: PathBuf,
        /// Its task.
        found: String,
        /// The task asked for.
        expected: String,
    },
    /// A file is damaged, cut short or does not fit the configuration beside it.
    #[error("{}: damaged checkpoint: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The system refused.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Files of a checkpoint by name, with their contents.
pub(crate) type Contents = Vec<(&'static str, Vec<u8>)>;

impl Checkpoint {
    /// The files of a checkpoint that evaluation needs.
    ///
    /// # Errors
    /// When an array is not of single precision.
    pub(crate) fn contents(
        config: &Config,
        step: u64,
        return_mean: Option<f64>,
        mut networks: Weights,
        scaling: &ObservationScaling,
    ) -> Result<Contents, WeightError> {
        scaling.save(&mut networks);
        let metadata = HashMap::from([("task".to_owned(), config.task.clone())]);
        let state = State {
            step,
            task: config.task.clone(),
            method: config.method.name().to_owned(),
            return_mean,
            mamf_version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let state = serde_json::to_string_pretty(&state).expect("plain data is JSON");
        Ok(vec![
            (WEIGHTS, networks.to_bytes(metadata)?),
            (CONFIG, config.to_toml().into_bytes()),
            (STATE, state.into_bytes()),
        ])
    }

    /// Loads a checkpoint, or the `last` one of a run directory; its `previous` one where a crash came
    /// between the two. A run may go on saving meanwhile.
    ///
    /// # Errors
    /// When there is none, a file is damaged, or it is of another task than the run directory says.
    pub fn load(path: &Path) -> Result<Checkpoint, CheckpointError> {
        let manifest = || fs::read(newest(path).join(MANIFEST)).ok();
        let mut before = manifest();
        for _ in 0..MOST_CHANGES {
            let loaded = Checkpoint::load_once(path);
            let after = manifest();
            // Files of two checkpoints do not fit together: a run has put a new one in place.
            let settled = before.is_some() || newest(path) == path;
            if loaded.is_ok() || (before == after && settled) {
                return loaded;
            }
            std::thread::sleep(PAUSE);
            before = after;
        }
        Checkpoint::load_once(path)
    }

    fn load_once(path: &Path) -> Result<Checkpoint, CheckpointError> {
        let found = newest(path);
        if found == path {
            return Checkpoint::load_directory(path);
        }
        if !found.is_dir() {
            // A run that has not saved its first one yet.
            return Err(CheckpointError::NotSaved(path.to_owned()));
        }
        let checkpoint = Checkpoint::load_directory(&found)?;
        let expected = read_config(&path.join(CONFIG))?;
        checkpoint.require_task(&expected.task)?;
        Ok(checkpoint)
    }

    fn load_directory(path: &Path) -> Result<Checkpoint, CheckpointError> {
        let file = |name: &str| path.join(name);
        if [WEIGHTS, CONFIG, STATE]
            .iter()
            .all(|name| !file(name).exists())
        {
            return Err(CheckpointError::Missing(path.to_owned()));
        }
        if file(RUN_JSON).exists() && !file(WEIGHTS).exists() && !file(STATE).exists() {
            return Err(CheckpointError::NotSaved(path.to_owned()));
        }
        if let Some(name) = [WEIGHTS, CONFIG, STATE]
            .iter()
            .find(|name| !file(name).exists())
        {
            return Err(CheckpointError::Damaged {
                path: file(name),
                reason: format!("missing; a checkpoint is {WEIGHTS}, {CONFIG} and {STATE}"),
            });
        }
        // Weights that were made elsewhere have no manifest, and are taken as they are.
        let manifest = path.join(MANIFEST).exists();
        let manifest = manifest.then(|| read_manifest(path)).transpose()?;
        let read = |name| read(path, name, manifest.as_ref());
        let (state, bytes, _) = (read(STATE)?, read(WEIGHTS)?, read(CONFIG)?);
        let config = read_config(&file(CONFIG))?;
        let state: State =
            serde_json::from_slice(&state).map_err(|error| damaged(file(STATE), error))?;
        let (weights, metadata) =
            Weights::from_bytes(&bytes).map_err(|error| damaged(file(WEIGHTS), error))?;
        for (name, task) in [(STATE, Some(&state.task)), (WEIGHTS, metadata.get("task"))] {
            if task.is_some_and(|task| *task != config.task) {
                let task = task.map_or("", String::as_str);
                let reason = format!(
                    "it is of task `{task}`, {CONFIG} beside it of `{}`",
                    config.task
                );
                return Err(CheckpointError::Damaged {
                    path: file(name),
                    reason,
                });
            }
        }
        Ok(Checkpoint {
            path: path.to_owned(),
            config,
            step: state.step,
            weights,
        })
    }

    /// Networks and observation scaling.
    pub(crate) fn weights(&self) -> &Weights {
        &self.weights
    }

    /// Arrays that do not fit the task and the configuration.
    pub fn misfit(&self, error: WeightError) -> CheckpointError {
        damaged(self.path.join(WEIGHTS), error)
    }

    /// Refuses a checkpoint of another task.
    ///
    /// # Errors
    /// When the checkpoint is not of `task`.
    pub fn require_task(&self, task: &str) -> Result<(), CheckpointError> {
        if self.config.task == task {
            return Ok(());
        }
        Err(CheckpointError::OtherTask {
            path: self.path.clone(),
            found: self.config.task.clone(),
            expected: task.to_owned(),
        })
    }
}

/// The checkpoint at `path`, or the newest one of the run there.
fn newest(path: &Path) -> PathBuf {
    let checkpoints = path.join("checkpoints");
    if path.join(WEIGHTS).exists() || !checkpoints.is_dir() {
        return path.to_owned();
    }
    let newest = standing(&checkpoints).into_iter().next();
    newest.unwrap_or_else(|| checkpoints.join("last"))
}

/// The manifest of the checkpoint `directory`.
pub(crate) fn read_manifest(directory: &Path) -> Result<Manifest, CheckpointError> {
    let path = directory.join(MANIFEST);
    let json = fs::read(&path).map_err(FileError::at(&path))?;
    Manifest::from_json(&json).map_err(|reason| damaged(path, reason))
}

/// The file `name` of the checkpoint `directory`, as its manifest says it must be.
pub(crate) fn read(
    directory: &Path,
    name: &str,
    manifest: Option<&Manifest>,
) -> Result<Vec<u8>, CheckpointError> {
    let path = directory.join(name);
    let bytes = fs::read(&path).map_err(FileError::at(&path))?;
    let Some(manifest) = manifest else {
        return Ok(bytes);
    };
    let seal = manifest.files.get(name);
    let seal = seal.ok_or_else(|| {
        let reason = format!("{MANIFEST} beside it does not name it");
        damaged(path.clone(), reason)
    })?;
    if bytes.len() as u64 > seal.bytes {
        let reason = format!("{} bytes instead of {}", bytes.len(), seal.bytes);
        return Err(damaged(path, reason));
    }
    seal.open(&bytes).map_err(|reason| damaged(path, reason))?;
    Ok(bytes)
}

/// The resolved configuration in the file `path`.
pub(crate) fn read_config(path: &Path) -> Result<Config, CheckpointError> {
    config::read_resolved(path, &Overrides::default()).map_err(|error| match error {
        ConfigError::Unreadable { path, error } => FileError { path, error }.into(),
        error => CheckpointError::Damaged {
            path: path.to_owned(),
            reason: error.to_string(),
        },
    })
}

pub(crate) fn damaged(path: PathBuf, error: impl std::fmt::Display) -> CheckpointError {
    CheckpointError::Damaged {
        path,
        reason: error.to_string(),
    }
}
