//! What acts in episodes: the policy of a checkpoint, or a planner, with what the checkpoint has learned or without one.

use crate::agent::Controller;
use crate::config::{self, Config, Overrides};
use crate::core::text;
use crate::run::Checkpoint;
use crate::training::{self, saved_policy};
use anyhow::Context;
use std::path::Path;
use toml::Table;

/// Whatever acts, and the task that it acts in.
pub(super) struct Acting {
    /// The task and how it is wrapped, and the threads.
    pub config: Config,
    pub controller: Box<dyn Controller>,
    /// What it is, in words.
    pub name: String,
}

impl Acting {
    /// The policy of `checkpoint`, or the planner of the file `planner`; one of both is there.
    ///
    /// # Errors
    /// As [`policy`](Acting::policy) and [`planner`](Acting::planner).
    pub fn of(
        planner: Option<&Path>,
        checkpoint: Option<Checkpoint>,
        task: Option<&str>,
    ) -> anyhow::Result<Acting> {
        match (planner, checkpoint) {
            (Some(file), checkpoint) => Acting::planner(file, checkpoint, task),
            (None, Some(checkpoint)) => Acting::policy(checkpoint),
            (None, None) => unreachable!("the command line asks for one of both"),
        }
    }

    /// The deterministic policy of `checkpoint`.
    ///
    /// # Errors
    /// When its arrays do not fit its task.
    fn policy(checkpoint: Checkpoint) -> anyhow::Result<Acting> {
        let spec = training::make_env(&checkpoint.config)?.spec().clone();
        Ok(Acting {
            controller: Box::new(saved_policy(&checkpoint, &spec)?),
            name: name(&checkpoint),
            config: checkpoint.config,
        })
    }

    /// The planner that the section `[planner]` of `file` describes, with what `checkpoint` has learned; without one, for
    /// `task`, or else the task of the file.
    ///
    /// # Errors
    /// When the file can't be read, is of another task than the checkpoint, or something is missing.
    fn planner(
        file: &Path,
        checkpoint: Option<Checkpoint>,
        task: Option<&str>,
    ) -> anyhow::Result<Acting> {
        let mut overrides = Overrides::default();
        let mut set = |option: &str, task: &str| {
            overrides.push(format!("{option} {task}"), "task", task);
        };
        match (&checkpoint, task) {
            (Some(checkpoint), _) => {
                if let Some(named) = task_of(file) {
                    let asked = checkpoint.require_task(&named);
                    asked.with_context(|| format!("--planner {}", file.display()))?;
                }
                set("the task of --checkpoint,", &checkpoint.config.task);
            }
            (None, Some(task)) => set("--task", task),
            (None, None) => (),
        }
        let read = config::read(file, &overrides)?;
        let method = read.planner.method.name();
        let Some(checkpoint) = checkpoint else {
            return Ok(Acting {
                controller: Box::new(training::planner(&read)?),
                name: format!("planned ({method})"),
                config: read,
            });
        };
        let config = Config {
            planner: read.planner,
            ..checkpoint.config.clone()
        };
        Ok(Acting {
            controller: Box::new(training::taught_planner(&config, &checkpoint)?),
            name: format!("planned ({method}) with {}", name(&checkpoint)),
            config,
        })
    }
}

/// The method of a checkpoint and its age.
pub(super) fn name(checkpoint: &Checkpoint) -> String {
    let method = checkpoint.config.method.name();
    format!("{method} after {} steps", checkpoint.step)
}

/// The task that a configuration names, if it can be read and does.
fn task_of(file: &Path) -> Option<String> {
    let table: Table = toml::from_str(&text::read(file).ok()?).ok()?;
    Some(table.get("task")?.as_str()?.to_owned())
}
