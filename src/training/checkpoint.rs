//! Checkpoints: what it takes to evaluate a policy, in one directory.
//!
//! `weights.safetensors` holds every network by plain names (`actor.l1.weight`, `[inputs, outputs]`)
//! and the observation scaling; `config.toml` the whole configuration; `checkpoint.json` the step.

use crate::agent::Policy;
use crate::config::{self, Config, ConfigError};
use crate::env::Spec;
use crate::nn::{Mlp, ObservationScaling, WeightError, Weights};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

const WEIGHTS: &str = "weights.safetensors";
const CONFIG: &str = "config.toml";
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
    #[error("{}: {error}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
}

impl Checkpoint {
    /// Saves a checkpoint as the directory `path`, which is replaced only once the new one is
    /// whole.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn save(
        path: &Path,
        config: &Config,
        step: u64,
        return_mean: Option<f64>,
        mut networks: Weights,
        scaling: &ObservationScaling,
    ) -> Result<(), CheckpointError> {
        scaling.save(&mut networks);
        let metadata = HashMap::from([("task".to_owned(), config.task.clone())]);
        let weights = networks
            .to_bytes(metadata)
            .map_err(|error| damaged(path.join(WEIGHTS), error))?;
        let state = State {
            step,
            task: config.task.clone(),
            method: config.method.name().to_owned(),
            return_mean,
            mamf_version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let state = serde_json::to_string_pretty(&state).expect("plain data is JSON");
        let config = toml::to_string_pretty(config).expect("a configuration is TOML");

        let fresh = path.with_extension("new");
        let old = path.with_extension("old");
        remove(&fresh)?;
        remove(&old)?;
        fs::create_dir_all(&fresh).map_err(io(&fresh))?;
        for (name, bytes) in [
            (WEIGHTS, weights.as_slice()),
            (CONFIG, config.as_bytes()),
            (STATE, state.as_bytes()),
        ] {
            let file = fresh.join(name);
            let written = File::create(&file).and_then(|mut f| {
                f.write_all(bytes)?;
                f.sync_all()
            });
            written.map_err(io(&file))?;
        }
        if path.exists() {
            fs::rename(path, &old).map_err(io(path))?;
        }
        fs::rename(&fresh, path).map_err(io(path))?;
        remove(&old)
    }

    /// Loads a checkpoint, or the `last` one of a run directory.
    ///
    /// # Errors
    /// When there is none, a file is damaged, or it is of another task than the run directory says.
    pub fn load(path: &Path) -> Result<Checkpoint, CheckpointError> {
        let run = path.join("checkpoints").join("last");
        if !path.join(WEIGHTS).exists() && run.is_dir() {
            let checkpoint = Checkpoint::load_directory(&run)?;
            let expected = read_config(&path.join(CONFIG))?;
            checkpoint.require_task(&expected.task)?;
            return Ok(checkpoint);
        }
        if !path.join(WEIGHTS).exists() && path.join("checkpoints").is_dir() {
            // A run that has not saved its first `last` yet.
            return Err(CheckpointError::Missing(run));
        }
        Checkpoint::load_directory(path)
    }

    fn load_directory(path: &Path) -> Result<Checkpoint, CheckpointError> {
        let file = |name: &str| path.join(name);
        if [WEIGHTS, CONFIG, STATE]
            .iter()
            .all(|name| !file(name).exists())
        {
            return Err(CheckpointError::Missing(path.to_owned()));
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
        let config = read_config(&file(CONFIG))?;
        let state = fs::read_to_string(file(STATE)).map_err(io(&file(STATE)))?;
        let state: State =
            serde_json::from_str(&state).map_err(|error| damaged(file(STATE), error))?;
        let bytes = fs::read(file(WEIGHTS)).map_err(io(&file(WEIGHTS)))?;
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

    /// The saved policy for the task `spec`.
    ///
    /// # Errors
    /// When the arrays do not fit the task and the configuration.
    pub fn policy(&self, spec: &Spec) -> Result<Policy, CheckpointError> {
        let settings = self.config.agent(spec);
        let widths = settings.actor_widths(spec.obs_size, spec.action_size);
        let load = || -> Result<Policy, WeightError> {
            let actor = Mlp::load("actor", &widths, &self.weights)?;
            let scaling = ObservationScaling::load(spec.obs_size, &self.weights)?;
            Ok(Policy::new(
                actor,
                settings.base,
                scaling,
                settings.coupling,
            ))
        };
        load().map_err(|error| damaged(self.path.join(WEIGHTS), error))
    }
}

fn read_config(path: &Path) -> Result<Config, CheckpointError> {
    config::read_resolved(path).map_err(|error| match error {
        ConfigError::Unreadable { path, error } => CheckpointError::Io { path, error },
        error => CheckpointError::Damaged {
            path: path.to_owned(),
            reason: error.to_string(),
        },
    })
}

fn damaged(path: PathBuf, error: impl std::fmt::Display) -> CheckpointError {
    CheckpointError::Damaged {
        path,
        reason: error.to_string(),
    }
}

fn io(path: &Path) -> impl FnOnce(std::io::Error) -> CheckpointError {
    let path = path.to_owned();
    move |error| CheckpointError::Io { path, error }
}

fn remove(path: &Path) -> Result<(), CheckpointError> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(io(path)(error)),
        _ => Ok(()),
    }
}
