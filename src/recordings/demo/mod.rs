//! Sets of recordings that serve as demonstrations: made, described, replayed. No networks.
//!
//! [`EpisodeRecorder`] turns the steps of an episode into a recording, [`describe`] tells what a
//! recording holds and whether training can begin in its states, [`replay`] how far the simulator is
//! from it.

mod describe;
mod record;
mod replay;
mod series;

use std::path::{Path, PathBuf};

use crate::env::{self, Inspect, MakeError};
use crate::recordings::DemonstrationError;
use crate::recordings::format::{Recording, RecordingError};
use crate::recordings::replayer::check_columns;

pub use describe::{Description, describe, descriptions, totals};
pub use record::EpisodeRecorder;
pub use replay::{DRIFT, Figures, OneStep, OpenLoop, Replayed, STORED_DIFFERENCE, replay, tables};
pub use series::Series;

/// Why a recording cannot be described or replayed. Each message names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnusableRecording {
    /// It is damaged, or its rows are not as long as its task's or not of finite numbers.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// It cannot be a demonstration of its task.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
    /// Its task is unknown or cannot be run.
    #[error("{}: {source}", path.display())]
    Task {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: MakeError,
    },
}

impl UnusableRecording {
    fn task(path: &Path) -> impl FnOnce(MakeError) -> UnusableRecording {
        let path = path.to_owned();
        move |source| UnusableRecording::Task { path, source }
    }
}

/// The task of `recording`, which is fit to be put into its states.
///
/// # Errors
/// If the task is unknown, the arrays do not fit it or a number is not finite.
pub fn task_of(recording: &Recording) -> Result<Box<dyn Inspect>, UnusableRecording> {
    let env =
        env::make_inspect(&recording.env).map_err(UnusableRecording::task(&recording.path))?;
    check_columns(recording, env.as_ref())?;
    recording.check_finite()?;
    Ok(env)
}

/// How a table names the file `path`: relative to the directory `base`, if it lies there.
fn name(path: &Path, base: &Path) -> String {
    let relative = path.strip_prefix(base).unwrap_or(path);
    relative.display().to_string()
}

/// The deepest directory in which all files of `paths` lie.
fn common_directory<'a>(mut paths: impl Iterator<Item = &'a Path>) -> PathBuf {
    let parent = |path: &'a Path| path.parent().unwrap_or(Path::new("")).to_owned();
    let mut base = paths.next().map(parent).unwrap_or_default();
    for path in paths {
        while !path.starts_with(&base) && base.pop() {}
    }
    base
}

/// The distinct tasks of `items`, in the order in which they come.
fn tasks<T>(items: &[T], task: impl Fn(&T) -> &str) -> Vec<&str> {
    let mut found: Vec<&str> = Vec::new();
    for item in items {
        let task = task(item);
        if !found.contains(&task) {
            found.push(task);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_from_where_they_part() {
        let base = |paths: &[&'static str]| common_directory(paths.iter().map(Path::new));
        assert_eq!(base(&["a/b/1.npz"]), Path::new("a/b"));
        assert_eq!(base(&["a/b/1.npz", "a/c/d/1.npz"]), Path::new("a"));
        assert_eq!(base(&["1.npz", "b/1.npz"]), Path::new(""));
        assert_eq!(base(&["/x/1.npz", "/xy/1.npz"]), Path::new("/"));
        assert_eq!(name(Path::new("a/b/1.npz"), Path::new("a")), "b/1.npz");
        assert_eq!(name(Path::new("1.npz"), Path::new("")), "1.npz");
    }
}
