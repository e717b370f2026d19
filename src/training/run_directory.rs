//! The directory of a run.

use crate::config::Config;
use std::path::{Path, PathBuf};

/// `config.toml`, `run.json`, the curves and `checkpoints/{last,best}` of one run.
#[derive(Debug, Clone)]
pub struct RunDirectory(PathBuf);

/// Why a run directory can't be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunDirectoryError {
    /// It is there already; nothing was touched.
    #[error(
        "{} exists already and is left as it is; choose another --out, or overwrite it with --force",
        .0.display()
    )]
    Exists(PathBuf),
    /// `--force` on something that is no run.
    #[error("{} is no run directory (it lacks config.toml or run.json) and is left as it is, --force or not", .0.display())]
    NotARun(PathBuf),
    /// The system refused.
    #[error("{}: {error}", path.display())]
    Io {
        /// What was to be made or removed.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
}

/// What a run writes beside its checkpoints.
const FILES: [&str; 5] = [
    "config.toml",
    "run.json",
    "train.csv",
    "eval.csv",
    "timing.csv",
];

/// Removes what a run wrote to `path`, and nothing else that may lie there.
fn remove_run(path: &Path) -> std::io::Result<()> {
    let missing = |error: &std::io::Error| error.kind() == std::io::ErrorKind::NotFound;
    let checkpoints = std::fs::remove_dir_all(path.join("checkpoints"));
    let files = FILES.map(|name| std::fs::remove_file(path.join(name)));
    files
        .into_iter()
        .chain([checkpoints])
        .find(|removed| removed.as_ref().is_err_and(|error| !missing(error)))
        .unwrap_or(Ok(()))
}

impl RunDirectory {
    /// Where a run of `config` goes unless told otherwise: `runs/<task>/<method>/seed-<n>`.
    pub fn default_path(config: &Config) -> PathBuf {
        let seed = format!("seed-{}", config.seed);
        let task = match &config.doubled_actions {
            None => config.task.clone(),
            Some(doubled) => format!("{}-doubled-{}", config.task, doubled.period),
        };
        ["runs", &task, config.method.name(), &seed]
            .iter()
            .collect()
    }

    /// Makes the directory. An existing one is an error; with `force` the files of an existing run are
    /// removed, and others in it are left.
    ///
    /// # Errors
    /// When it exists, is no run, or the system refuses.
    pub fn create(path: &Path, force: bool) -> Result<RunDirectory, RunDirectoryError> {
        let io = |error| RunDirectoryError::Io {
            path: path.to_owned(),
            error,
        };
        let occupied = match std::fs::read_dir(path) {
            Ok(mut entries) => entries.next().is_some(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => false,
            Err(error) if error.kind() == std::io::ErrorKind::NotADirectory => {
                return Err(RunDirectoryError::NotARun(path.to_owned()));
            }
            Err(error) => return Err(io(error)),
        };
        if occupied {
            if !force {
                return Err(RunDirectoryError::Exists(path.to_owned()));
            }
            if !["config.toml", "run.json"]
                .iter()
                .all(|name| path.join(name).is_file())
            {
                return Err(RunDirectoryError::NotARun(path.to_owned()));
            }
            remove_run(path).map_err(io)?;
        }
        std::fs::create_dir_all(path.join("checkpoints")).map_err(io)?;
        Ok(RunDirectory(path.to_owned()))
    }

    /// The directory itself.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The checkpoint called `name`: `last` or `best`.
    pub fn checkpoint(&self, name: &str) -> PathBuf {
        self.0.join("checkpoints").join(name)
    }

    /// Writes a file of the run.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write(&self, name: &str, contents: &str) -> Result<(), RunDirectoryError> {
        let path = self.0.join(name);
        std::fs::write(&path, contents).map_err(|error| RunDirectoryError::Io { path, error })
    }
}
