//! Checks the tasks against recorded rollouts of the published ones.
//!
//! A rollout is an `.npz` file of arrays beside a `.json` file of settings. Each recorded step is
//! replayed on its own: the simulation is put into the recorded state with the recorded solver warm
//! start, steps once, and what comes out is compared with the next recorded row.

mod replay;
mod report;

use std::path::{Path, PathBuf};

use super::ReplayError;
use crate::core::walk::{Walk, WalkError};
use crate::recordings::format::Recording;

pub use replay::{Differences, Summary, replay};
pub use report::tables;
pub(crate) use report::{largest, number};

/// Largest absolute error of a task that reproduces its rollouts.
pub const TOLERANCE: f64 = 1e-9;

/// Largest relative error where the published figures are forces and velocities under an iterative
/// solver ([`Info::relative`](crate::env::Info::relative)).
pub const RELATIVE_TOLERANCE: f64 = 1e-6;

/// What became of a directory of rollouts.
#[derive(Debug, Default)]
pub struct Report {
    /// One entry for each replayed rollout, in the order of their file names.
    pub summaries: Vec<Summary>,
    /// Rollouts that could not be replayed, each with the reason.
    pub failures: Vec<String>,
    /// How many rollouts of other tasks were left out.
    pub skipped: usize,
}

impl Report {
    /// Whether every rollout was replayed within tolerance.
    pub fn passed(&self) -> bool {
        self.failures.is_empty() && self.summaries.iter().all(Summary::within_tolerance)
    }
}

/// A directory in which there is nothing to verify.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnusableInput {
    /// The directory cannot be searched.
    #[error(transparent)]
    Directory(#[from] WalkError),
    /// There is no rollout, or none of the task asked for.
    #[error("no rollout{} in {}", task.as_ref().map(|t| format!(" of {t}")).unwrap_or_default(), path.display())]
    Empty {
        /// The directory.
        path: PathBuf,
        /// The task asked for.
        task: Option<String>,
    },
}

/// Replays every rollout in `directory` and below, or those of `task` only.
///
/// A damaged rollout is noted in the report and does not stop the others.
///
/// # Errors
/// If the directory cannot be read or holds no rollout (of the task).
pub fn verify(directory: &Path, task: Option<&str>) -> Result<Report, UnusableInput> {
    let files = rollouts(directory)?;

    let mut report = Report::default();
    for file in &files {
        let replayed = Recording::settings(file).and_then(|settings| {
            if task.is_some_and(|task| task != settings.env) {
                return Ok(None);
            }
            Recording::read(file, settings).map(Some)
        });
        match replayed {
            Ok(None) => report.skipped += 1,
            Ok(Some(rollout)) => match replay(&rollout) {
                Ok(summary) => report.summaries.push(summary),
                // An error of the rollout names the file itself.
                Err(ReplayError::Recording(error)) => report.failures.push(error.to_string()),
                Err(error) => report.failures.push(format!("{}: {error}", file.display())),
            },
            Err(error) => report.failures.push(error.to_string()),
        }
    }
    if report.summaries.is_empty() && report.failures.is_empty() {
        return Err(UnusableInput::Empty {
            path: directory.to_owned(),
            task: task.map(str::to_owned),
        });
    }
    Ok(report)
}

/// The `.npz` files in `directory` and below, and `.json` settings without one.
fn rollouts(directory: &Path) -> Result<Vec<PathBuf>, WalkError> {
    let mut rollouts = Vec::new();
    for path in Walk::default().files(directory, |_| true)? {
        let arrays = path.with_extension("npz");
        let is = |extension| path.extension().is_some_and(|e| e == extension);
        let orphan = is("json") && !arrays.exists() && Recording::settings(&arrays).is_ok();
        // Reading a pipe would wait for ever.
        if (is("npz") && path.is_file()) || orphan {
            rollouts.push(arrays);
        }
    }
    rollouts.sort();
    Ok(rollouts)
}
