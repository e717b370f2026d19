//! The directory of a run.

use super::checkpoint;
use super::lock::{LOCK, LockError, RunLock};
use super::replay_log::ReplayLog;
use super::schema::{CONFIG_TOML, CURVES, RUN_JSON};
use crate::config::Config;
use crate::core::files::{FileError, Files, parent};
use std::ffi::OsStr;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// `config.toml`, `run.json`, the curves and the checkpoints of one run, which this process alone works on.
#[derive(Debug)]
pub struct RunDirectory {
    path: PathBuf,
    files: Files,
    lock: RunLock,
}

/// Why a run directory can't be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunDirectoryError {
    /// It is there already; nothing was touched.
    #[error(
        "{} exists already and is left as it is; choose another --out, go on with it with --resume, or overwrite it with --force",
        .0.display()
    )]
    Exists(PathBuf),
    /// It is no run, and something lies there.
    #[error(
        "{}: no run directory, and in the way is {}; it is left as it is, with --force as well: choose another --out, or move that away",
        path.display(),
        foreign.display()
    )]
    NotARun {
        /// Where the run was to go.
        path: PathBuf,
        /// What lies there.
        foreign: PathBuf,
    },
    /// There is nothing to resume.
    #[error(
        "{}: no run to resume here (expected a run directory, with config.toml and checkpoints/); `mamf train --config FILE` begins one",
        .0.display()
    )]
    NoRun(PathBuf),
    /// A checkpoint instead of its run.
    #[error("{}: this is a checkpoint; --resume takes the directory of its run, two folders above", .0.display())]
    IsACheckpoint(PathBuf),
    /// Another process works on it.
    #[error(transparent)]
    Locked(#[from] LockError),
    /// The system refused.
    #[error(transparent)]
    File(#[from] FileError),
}

/// What is in the way of a run in the directory `path`, if anything is: neither what a process leaves that ended before
/// its run began, nor the file that this process's own words go to.
fn foreign(path: &Path) -> std::io::Result<Option<PathBuf>> {
    let entries = match std::fs::read_dir(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) if error.kind() == ErrorKind::NotADirectory => return Ok(Some(path.to_owned())),
        entries => entries?,
    };
    let leftover = |name: &OsStr| {
        name == LOCK
            || name == "config.toml.new"
            || name == "checkpoints" && is_empty(&path.join(name))
    };
    let mut in_the_way = Vec::new();
    for entry in entries {
        let name = entry?.file_name();
        if !leftover(&name) && !is_our_log(&path.join(&name)) {
            in_the_way.push(path.join(name));
        }
    }
    Ok(in_the_way.into_iter().min())
}

/// Whether standard output or standard error of this process goes to the file `path`.
fn is_our_log(path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |path: &Path| {
        let found = path.metadata().ok().filter(std::fs::Metadata::is_file);
        found.map(|found| (found.dev(), found.ino()))
    };
    let streams = ["/proc/self/fd/1", "/proc/self/fd/2"].map(|stream| place(Path::new(stream)));
    place(path).is_some_and(|file| streams.contains(&Some(file)))
}

/// Whether a run was begun in the directory `path`.
fn is_run(path: &Path) -> bool {
    let config = path.join(CONFIG_TOML).is_file();
    config && (path.join(RUN_JSON).is_file() || path.join("checkpoints").is_dir())
}

/// Makes the directory `path`, and waits until its name and those of the new ones above it outlive a loss of power.
fn create_synced(files: &Files, path: &Path) -> Result<(), FileError> {
    let missing: Vec<&Path> = path
        .ancestors()
        .take_while(|above| !above.exists())
        .collect();
    files.create_dir(path)?;
    missing
        .into_iter()
        .filter(|above| !above.as_os_str().is_empty())
        .try_for_each(|above| files.sync_dir(parent(above)))
}

fn is_empty(directory: &Path) -> bool {
    std::fs::read_dir(directory).is_ok_and(|mut entries| entries.next().is_none())
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
    /// When it exists, is no run, another process works on it or the system refuses.
    pub fn create(path: &Path, force: bool) -> Result<RunDirectory, RunDirectoryError> {
        RunDirectory::create_on(Files::default(), path, force)
    }

    /// What is in the way of a run at `path`, if anything is.
    ///
    /// # Errors
    /// When the system refuses to tell.
    pub fn obstacle(path: &Path) -> std::io::Result<Option<RunDirectoryError>> {
        let path = path.to_owned();
        Ok(foreign(&path)?.map(|foreign| match is_run(&path) {
            true => RunDirectoryError::Exists(path),
            false => RunDirectoryError::NotARun { path, foreign },
        }))
    }

    /// As [`create`](RunDirectory::create), all that the run keeps being written through `files`.
    ///
    /// # Errors
    /// As [`create`](RunDirectory::create).
    pub fn create_on(
        files: Files,
        path: &Path,
        force: bool,
    ) -> Result<RunDirectory, RunDirectoryError> {
        let io = |error| FileError::at(path)(error);
        if let Some(error) = RunDirectory::obstacle(path).map_err(io)?
            && !(force && is_run(path))
        {
            return Err(error);
        }
        create_synced(&files, path)?;
        let directory = RunDirectory {
            path: path.to_owned(),
            lock: RunLock::take(path)?,
            files,
        };
        // Another process may have begun a run here in the meantime.
        if let Some(error) =
            RunDirectory::obstacle(path).map_err(|error| FileError::at(path)(error))?
            && !force
        {
            return Err(error);
        }
        directory.empty()?;
        Ok(directory)
    }

    /// Opens the directory of a run that is to go on.
    ///
    /// # Errors
    /// When there is no run, another process works on it or the system refuses.
    pub fn open(path: &Path) -> Result<RunDirectory, RunDirectoryError> {
        RunDirectory::open_on(Files::default(), path)
    }

    /// As [`open`](RunDirectory::open), all that the run keeps being written through `files`.
    ///
    /// # Errors
    /// As [`open`](RunDirectory::open).
    pub fn open_on(files: Files, path: &Path) -> Result<RunDirectory, RunDirectoryError> {
        if path.join("manifest.json").exists() || path.join("weights.safetensors").exists() {
            return Err(RunDirectoryError::IsACheckpoint(path.to_owned()));
        }
        if !path.join(CONFIG_TOML).is_file() || !path.join("checkpoints").is_dir() {
            return Err(RunDirectoryError::NoRun(path.to_owned()));
        }
        Ok(RunDirectory {
            path: path.to_owned(),
            lock: RunLock::take(path)?,
            files,
        })
    }

    /// Removes what a run wrote, and nothing else that may lie there. `config.toml` and `run.json` stay until they are
    /// replaced, so that at any moment it can be told that this is the directory of a run.
    pub(crate) fn empty(&self) -> Result<(), FileError> {
        for name in CURVES {
            self.files.remove(&self.path.join(name))?;
        }
        self.remove_videos()?;
        checkpoint::remove_all(&self.files, &self.checkpoints())?;
        ReplayLog::remove(&self.files, &self.replay())?;
        self.remove_planned()?;
        self.files.create_dir(&self.checkpoints())
    }

    fn remove_videos(&self) -> Result<(), FileError> {
        self.remove_made(&self.path.join("videos"), "step_", &[".gif", ".tmp"])
    }

    fn remove_planned(&self) -> Result<(), FileError> {
        self.remove_made(&self.planned(), "episode_", &[".npz", ".json", ".tmp"])
    }

    /// Removes from `folder` what a run made there, and then the folder unless something else lies in it.
    fn remove_made(&self, folder: &Path, begins: &str, ends: &[&str]) -> Result<(), FileError> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let ours = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with(begins) && ends.iter().any(|end| name.ends_with(end))
        };
        for path in entries.map(|entry| entry.path()).filter(ours) {
            self.files.remove(&path)?;
        }
        let _ = std::fs::remove_dir(folder);
        Ok(())
    }

    /// The directory itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the run is written through.
    pub fn files(&self) -> &Files {
        &self.files
    }

    /// The process that left the run locked without ending it in order, if one did.
    pub fn left_by(&self) -> Option<&str> {
        self.lock.left_by.as_deref()
    }

    /// The configuration, resolved.
    pub fn config(&self) -> PathBuf {
        self.path.join(CONFIG_TOML)
    }

    /// Where checkpoints are.
    pub fn checkpoints(&self) -> PathBuf {
        self.path.join("checkpoints")
    }

    /// The checkpoint called `name`: `last`, `previous` or `best`.
    pub fn checkpoint(&self, name: &str) -> PathBuf {
        self.checkpoints().join(name)
    }

    /// Where episodes are recorded that the planner makes.
    pub fn planned(&self) -> PathBuf {
        self.path.join("planned")
    }

    /// Where the replay buffer is saved.
    pub fn replay(&self) -> PathBuf {
        self.checkpoint("replay")
    }

    /// Writes a file of the run, whole or not at all.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write(&self, name: &str, contents: &str) -> Result<(), FileError> {
        self.files
            .replace(&self.path.join(name), contents.as_bytes())
    }
}
