//! What became of a run so far, as its directory tells.

use crate::config::{self, Config, Overrides};
use crate::run::schema::{CONFIG_TOML, Column, EVAL, EVAL_CSV, TIMING, TIMING_CSV, index};
use crate::run::{RunDirectory, last_row};
use serde::Deserialize;
use std::path::Path;

/// What became of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Standing {
    /// It has not begun.
    Absent,
    /// It can go on from this many steps.
    Interrupted(u64),
    /// It took all its steps.
    Finished,
    /// In its place is something else, in words.
    InTheWay(String),
}

/// How far a run is, as its curves tell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Environment steps at the last evaluation.
    pub step: u64,
    /// Mean return of the last evaluation.
    pub return_mean: Option<f64>,
    /// Steps a second before it.
    pub steps_per_second: Option<f64>,
}

impl Standing {
    /// Of the run in `directory` that should have the settings `planned`.
    pub fn of(directory: &Path, planned: &Config) -> Standing {
        let path = directory.join(CONFIG_TOML);
        if !path.exists() {
            return match RunDirectory::obstacle(directory) {
                Ok(None) => Standing::Absent,
                Ok(Some(reason)) => Standing::InTheWay(reason.to_string()),
                Err(error) => Standing::InTheWay(format!("{}: {error}", directory.display())),
            };
        }
        let found = match config::read_resolved(&path, &Overrides::default()) {
            Ok(found) => found,
            Err(error) => return Standing::InTheWay(error.to_string()),
        };
        let differences = found.differences(planned);
        if let Some(difference) = differences.iter().find(|d| !d.is_free()) {
            let [found, planned] = difference.values.each_ref().map(|value| {
                let unset = || "unset".to_owned();
                value.clone().unwrap_or_else(unset)
            });
            let (path, key) = (path.display(), &difference.key);
            return Standing::InTheWay(format!(
                "{path}: a run with other settings is there: `{key}` is {found}, not {planned}; choose another --out, or remove it"
            ));
        }
        match saved_step(directory) {
            Some(step) if step >= planned.steps && is_evaluated(directory, step) => {
                Standing::Finished
            }
            step => Standing::Interrupted(step.unwrap_or(0)),
        }
    }
}

/// Whether the run was evaluated after `step` steps, its last ones, which it is once they are saved.
fn is_evaluated(directory: &Path, step: u64) -> bool {
    Progress::of(directory).step >= step
}

/// Steps that the last checkpoint is after.
fn saved_step(directory: &Path) -> Option<u64> {
    #[derive(Deserialize)]
    struct Saved {
        step: u64,
    }
    let read = |name: &str| {
        let path = directory.join("checkpoints").join(name);
        let text = std::fs::read_to_string(path.join("checkpoint.json")).ok()?;
        serde_json::from_str::<Saved>(&text).ok()
    };
    read("last")
        .or_else(|| read("previous"))
        .map(|saved| saved.step)
}

impl Progress {
    /// Of the run in `directory`; nothing where it has not begun.
    pub fn of(directory: &Path) -> Progress {
        let last = |file: &str| last_row(&directory.join(file)).unwrap_or_default();
        let (eval, timing) = (last(EVAL_CSV), last(TIMING_CSV));
        let number = |row: &[String], columns: &[Column], name: &str| -> Option<f64> {
            row.get(index(columns, name)?)?.parse().ok()
        };
        Progress {
            step: number(&eval, &EVAL, "step").unwrap_or(0.0) as u64,
            return_mean: number(&eval, &EVAL, "return_mean"),
            steps_per_second: number(&timing, &TIMING, "steps_per_second"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Method;
    use std::fs;

    #[test]
    fn a_directory_tells_what_became_of_its_run() {
        let directory = tempfile::tempdir().unwrap();
        let run = directory.path();
        let mut planned = Config::preset(Method::Td3);
        planned.task = "Reacher-v4".into();
        planned.steps = 100;
        let standing = |planned: &Config| Standing::of(run, planned);
        assert_eq!(standing(&planned), Standing::Absent);
        fs::write(run.join("config.toml"), planned.to_toml()).unwrap();
        planned.compute.threads = 1;
        assert_eq!(standing(&planned), Standing::Interrupted(0));
        fs::create_dir_all(run.join("checkpoints/previous")).unwrap();
        let state = run.join("checkpoints/previous/checkpoint.json");
        fs::write(&state, "{\"step\": 40}").unwrap();
        assert_eq!(standing(&planned), Standing::Interrupted(40));
        planned.steps = 40;
        // Its last evaluation is still to be made.
        assert_eq!(standing(&planned), Standing::Interrupted(40));
        fs::write(run.join("eval.csv"), "step,episodes\n40,1\n").unwrap();
        assert_eq!(standing(&planned), Standing::Finished);
        planned.discount = 0.5;
        match standing(&planned) {
            Standing::InTheWay(reason) => assert!(reason.contains("`discount` is 0.98, not 0.5")),
            other => panic!("{other:?}"),
        }
        fs::write(run.join("config.toml"), "task = 3").unwrap();
        assert!(matches!(standing(&planned), Standing::InTheWay(_)));
    }

    #[test]
    fn progress_is_that_of_the_last_whole_row() {
        let directory = tempfile::tempdir().unwrap();
        let run = directory.path();
        assert_eq!(Progress::of(run), Progress::default());
        let header = "step,episodes,return_mean\n";
        fs::write(run.join("eval.csv"), header).unwrap();
        assert_eq!(Progress::of(run), Progress::default());
        fs::write(
            run.join("eval.csv"),
            format!("{header}0,10,-3.5\n500,10,2.5\n700,1"),
        )
        .unwrap();
        fs::write(
            run.join("timing.csv"),
            "step,seconds,steps_per_second\n500,5,100.0\n",
        )
        .unwrap();
        let expected = Progress {
            step: 500,
            return_mean: Some(2.5),
            steps_per_second: Some(100.0),
        };
        assert_eq!(Progress::of(run), expected);
    }
}
