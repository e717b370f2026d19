//! A directory of planned episodes.

use crate::config::{self, Config, ConfigError, Overrides, Resume};
use crate::core::files::{FileError, Files};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// The settings that episodes were planned under.
const SETTINGS: &str = "plan.toml";
/// What became of each episode.
const LOG: &str = "plan.csv";

/// Planned episodes on disk: the recordings of those that were kept, the settings of all, and a row each.
pub struct Plan {
    path: PathBuf,
    rows: Vec<PlanRow>,
}

/// What became of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlanRow {
    /// Its number, from 1.
    pub episode: usize,
    /// Undiscounted sum of its rewards.
    #[serde(rename = "return")]
    pub episode_return: f64,
    /// Control steps.
    pub length: usize,
    /// Whether the goal was reached in the last step, for tasks with goals.
    pub success: Option<bool>,
    /// Whether it was recorded.
    pub kept: bool,
    /// Wall-clock seconds of planning.
    pub seconds: f64,
    /// Control steps simulated for it.
    pub simulated: u64,
}

/// Why episodes can't be planned into a directory.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// There are files already.
    #[error("--out {}: it is not empty; --resume goes on with what was planned there", .0.display())]
    NotEmpty(PathBuf),
    /// Nothing was planned there.
    #[error("--out {}: there is no {SETTINGS}, so nothing to go on with", .0.display())]
    NothingThere(PathBuf),
    /// It was planned otherwise.
    #[error("--out {}: planned with {key} = {then}, not {now}", path.display())]
    Changed {
        /// The directory.
        path: PathBuf,
        /// The setting.
        key: String,
        /// Its value then.
        then: String,
        /// Its value now.
        now: String,
    },
    /// The settings there can't be read.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file can't be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The log is damaged.
    #[error("{}: {reason}", path.display())]
    Log {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

impl Plan {
    /// The directory `path` for episodes planned under `config` and what else was `said`, lines of comment; made, or
    /// with `resume` gone on with.
    ///
    /// # Errors
    /// When there is something in the way, nothing to go on with, or other settings.
    pub fn open(path: &Path, config: &Config, said: &str, resume: bool) -> Result<Plan, PlanError> {
        let (settings, log) = (path.join(SETTINGS), path.join(LOG));
        if resume {
            if !settings.exists() {
                return Err(PlanError::NothingThere(path.to_owned()));
            }
            compare(path, &settings, config, said)?;
            let rows = read(&log)?;
            let plan = Plan {
                path: path.to_owned(),
                rows,
            };
            plan.check(&log)?;
            plan.clear_next()?;
            return Ok(plan);
        }
        let mut entries = match fs::read_dir(path) {
            Ok(entries) => entries,
            Err(_) => {
                fs::create_dir_all(path).map_err(FileError::at(path))?;
                fs::read_dir(path).map_err(FileError::at(path))?
            }
        };
        if entries.next().is_some() {
            return Err(PlanError::NotEmpty(path.to_owned()));
        }
        let files = Files::default();
        files.write(&settings, format!("{said}{}", config.to_toml()).as_bytes())?;
        Ok(Plan {
            path: path.to_owned(),
            rows: Vec::new(),
        })
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What became of the episodes so far, in order.
    pub fn rows(&self) -> &[PlanRow] {
        &self.rows
    }

    /// The files of episode number `episode`, which counts from 0, without their endings.
    pub fn stem(&self, episode: usize) -> PathBuf {
        self.path.join(format!("episode_{:04}", episode + 1))
    }

    /// Notes what became of the next episode, which is on disk if it was kept.
    ///
    /// # Errors
    /// When the log can't be written.
    pub fn add(&mut self, row: PlanRow) -> Result<(), PlanError> {
        self.rows.push(row);
        let path = self.path.join(LOG);
        let mut writer = csv::Writer::from_writer(Vec::new());
        let broken = |reason: String| PlanError::Log {
            path: path.clone(),
            reason,
        };
        for row in &self.rows {
            writer
                .serialize(row)
                .map_err(|error| broken(error.to_string()))?;
        }
        let bytes = writer
            .into_inner()
            .map_err(|error| broken(error.to_string()))?;
        Ok(Files::default().replace(&path, &bytes)?)
    }

    /// Makes sure that the recordings that the `log` tells of are there, and no others but for the next one, which an
    /// interruption may have left.
    fn check(&self, log: &Path) -> Result<(), PlanError> {
        let wrong = |path: &Path, reason: &str| PlanError::Log {
            path: path.to_owned(),
            reason: reason.to_owned(),
        };
        for row in self.rows.iter().filter(|row| row.kept) {
            if let Some(lost) = self
                .recording(row.episode - 1)
                .iter()
                .find(|path| !path.exists())
            {
                return Err(wrong(lost, "plan.csv tells of it, but it is not there"));
            }
        }
        if self
            .recording(self.rows.len() + 1)
            .iter()
            .any(|path| path.exists())
        {
            return Err(wrong(log, "there are more recordings than it tells of"));
        }
        Ok(())
    }

    /// Removes what an interruption left of the next episode, which has no row yet.
    fn clear_next(&self) -> Result<(), PlanError> {
        for path in self.recording(self.rows.len()) {
            if path.exists() {
                fs::remove_file(&path).map_err(FileError::at(&path))?;
            }
        }
        Ok(())
    }

    /// Both files of episode number `episode`, from 0.
    fn recording(&self, episode: usize) -> [PathBuf; 2] {
        ["npz", "json"].map(|ending| self.stem(episode).with_extension(ending))
    }
}

/// Makes sure that what was planned at `path` was planned under the same settings.
fn compare(path: &Path, settings: &Path, config: &Config, said: &str) -> Result<(), PlanError> {
    let text = fs::read_to_string(settings).map_err(FileError::at(settings))?;
    let planned = config::read_resolved(settings, &Overrides::default())?;
    let changed = |key: &str, then: String, now: String| PlanError::Changed {
        path: path.to_owned(),
        key: key.to_owned(),
        then,
        now,
    };
    let comments = |text: &str| -> Vec<String> {
        let lines = text.lines().filter_map(|line| line.strip_prefix("# "));
        lines.map(ToOwned::to_owned).collect()
    };
    let (then, now) = (comments(&text), comments(said));
    if then != now {
        return Err(changed("options", then.join(", "), now.join(", ")));
    }
    for difference in planned.differences(config) {
        let plans = difference.key.starts_with("planner.")
            || ["task", "action_coupling"].contains(&difference.key.as_str());
        if plans || difference.on_resume() == Resume::Fixed {
            let [then, now] = difference
                .values
                .map(|value| value.unwrap_or_else(|| "nothing".to_owned()));
            return Err(changed(&difference.key, then, now));
        }
    }
    Ok(())
}

fn read(log: &Path) -> Result<Vec<PlanRow>, PlanError> {
    if !log.exists() {
        return Ok(Vec::new());
    }
    let broken = |reason: String| PlanError::Log {
        path: log.to_owned(),
        reason,
    };
    let mut reader = csv::Reader::from_path(log).map_err(|error| broken(error.to_string()))?;
    let begins = reader
        .headers()
        .map_err(|error| broken(error.to_string()))?;
    if begins.get(0) != Some("episode") {
        return Err(broken("it is no table of planned episodes".to_owned()));
    }
    let rows: Result<Vec<PlanRow>, _> = reader.deserialize().collect();
    let rows = rows.map_err(|error| broken(error.to_string()))?;
    match (1..)
        .zip(&rows)
        .find(|(number, row)| row.episode != *number)
    {
        None => Ok(rows),
        Some((number, row)) => Err(broken(format!(
            "episode {} stands where {number} should",
            row.episode
        ))),
    }
}
