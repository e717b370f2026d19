//! Runs of an experiment side by side: processes of this program.

use super::{PlannedRun, Progress, Standing};
use crate::core::paths::operand;
use signal_hook::consts::SIGTERM;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time between two looks at the processes.
const LOOK: Duration = Duration::from_millis(100);
/// Exit code of a run that was interrupted and can go on.
const RESUMABLE: i32 = 75;

/// How the runs are to be made.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The program.
    pub program: PathBuf,
    /// Folder that the runs go to, below their names.
    pub out: PathBuf,
    /// Processes side by side.
    pub jobs: usize,
    /// Threads of each.
    pub threads: usize,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// It took all its steps, now or before.
    Finished,
    /// It was interrupted, and can go on.
    Interrupted,
    /// It failed: why, in words.
    Failed(String),
}

/// A run and how it ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// Name of the run.
    pub name: String,
    /// How it ended.
    pub ended: Ended,
}

/// Is told how the runs proceed.
pub trait Watcher {
    /// A run begins, or goes on, with this many steps taken.
    fn began(&mut self, run: &PlannedRun, step: u64);
    /// How far a running one is; often.
    fn proceeds(&mut self, run: &PlannedRun, progress: Progress);
    /// A run ended, or need not be begun.
    fn ended(&mut self, run: &PlannedRun, ended: &Ended);
}

/// A run in its process.
struct Job<'a> {
    run: &'a PlannedRun,
    directory: PathBuf,
    log: PathBuf,
    child: Child,
    told: bool,
}

/// Makes `runs`: finished ones are passed over, interrupted ones go on. When `stop` becomes true, no more are
/// begun, and those under way are asked to save and end.
pub fn run(
    plan: &Plan,
    runs: &[PlannedRun],
    watcher: &mut dyn Watcher,
    stop: &AtomicBool,
) -> Vec<Outcome> {
    let mut waiting = runs.iter();
    let mut jobs: Vec<Job<'_>> = Vec::new();
    let mut outcomes = Vec::new();
    loop {
        let stopped = stop.load(Ordering::Relaxed);
        while jobs.len() < plan.jobs && !stopped {
            let Some(run) = waiting.next() else { break };
            match begin(plan, run, watcher) {
                Ok(job) => jobs.push(job),
                Err(ended) => end(run, ended, watcher, &mut outcomes),
            }
        }
        if stopped {
            for job in jobs.iter_mut().filter(|job| !job.told) {
                job.told = true;
                interrupt(&job.child);
            }
            for run in waiting.by_ref() {
                end(run, Ended::Interrupted, watcher, &mut outcomes);
            }
        }
        if jobs.is_empty() {
            return outcomes;
        }
        std::thread::sleep(LOOK);
        jobs.retain_mut(|job| match job.child.try_wait() {
            Ok(None) => {
                watcher.proceeds(job.run, Progress::of(&job.directory));
                true
            }
            Ok(Some(status)) => {
                // Once more, for what came since the last look.
                watcher.proceeds(job.run, Progress::of(&job.directory));
                let ended = match status.signal() {
                    // Our request came before it could hear it, and hence before it took a step.
                    Some(SIGTERM) if job.told => Ended::Interrupted,
                    _ => ended(status, &job.log),
                };
                end(job.run, ended, watcher, &mut outcomes);
                false
            }
            Err(error) => {
                let reason = format!("its process is lost: {error}");
                end(job.run, Ended::Failed(reason), watcher, &mut outcomes);
                false
            }
        });
    }
}

fn end(run: &PlannedRun, ended: Ended, watcher: &mut dyn Watcher, outcomes: &mut Vec<Outcome>) {
    watcher.ended(run, &ended);
    outcomes.push(Outcome {
        name: run.name.clone(),
        ended,
    });
}

/// Starts a run, unless it is finished or can't be started.
fn begin<'a>(
    plan: &Plan,
    run: &'a PlannedRun,
    watcher: &mut dyn Watcher,
) -> Result<Job<'a>, Ended> {
    let directory = plan.out.join(&run.name);
    let log = crate::core::files::beside(&directory, "log");
    let mut command = Command::new(&plan.program);
    // Its name alone: what a run records of its command is then the same wherever the program lies.
    command.arg0("mamf").arg("train");
    let step = match Standing::of(&directory, &run.config) {
        Standing::Finished => return Err(Ended::Finished),
        Standing::InTheWay(reason) => return Err(Ended::Failed(reason)),
        Standing::Interrupted(step) => {
            command.arg("--resume").arg(operand(&directory));
            command.args(["--steps", &run.config.steps.to_string()]);
            step
        }
        Standing::Absent => {
            command.arg("--config").arg(operand(&run.file));
            for setting in &run.settings {
                command.args(["--set", setting]);
            }
            command.args(["--seed", &run.seed.to_string()]);
            command.arg("--out").arg(operand(&directory));
            0
        }
    };
    command.args(["--threads", &plan.threads.to_string()]);
    let child = log_file(&log).and_then(|file| {
        let errors = file.try_clone()?;
        command.stdin(Stdio::null()).stdout(file).stderr(errors);
        command.spawn()
    });
    match child {
        Ok(child) => {
            watcher.began(run, step);
            Ok(Job {
                run,
                directory,
                log,
                child,
                told: false,
            })
        }
        Err(error) => {
            let log = log.display();
            Err(Ended::Failed(format!("can't be started: {log}: {error}")))
        }
    }
}

/// What a run says goes beside its directory, after what it said before.
fn log_file(path: &Path) -> io::Result<File> {
    fs::create_dir_all(crate::core::files::parent(path))?;
    OpenOptions::new().create(true).append(true).open(path)
}

fn ended(status: ExitStatus, log: &Path) -> Ended {
    match status.code() {
        Some(0) => Ended::Finished,
        Some(RESUMABLE) => Ended::Interrupted,
        _ => {
            let said = fs::read_to_string(log).unwrap_or_default();
            let last = said.lines().last().unwrap_or("nothing was said").to_owned();
            Ended::Failed(format!("{last} ({status}; {})", log.display()))
        }
    }
}

/// Asks a process to save and end. Those that share our terminal may have heard its interrupt already, and would
/// take a second one for an order to end at once: hence another signal.
fn interrupt(child: &Child) {
    let kill = format!("kill -TERM {}", child.id());
    // A process that is gone need not be asked.
    let _ = Command::new("sh")
        .args(["-c", &kill])
        .stderr(Stdio::null())
        .status();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Method};
    use std::os::unix::fs::PermissionsExt;

    /// Wants all runs to end as soon as one has begun.
    struct Impatient<'a>(&'a AtomicBool);

    impl Watcher for Impatient<'_> {
        fn began(&mut self, _: &PlannedRun, _: u64) {
            self.0.store(true, Ordering::Relaxed);
        }
        fn proceeds(&mut self, _: &PlannedRun, _: Progress) {}
        fn ended(&mut self, _: &PlannedRun, _: &Ended) {}
    }

    #[test]
    fn a_run_that_is_told_to_end_before_it_hears_can_go_on() {
        let directory = tempfile::tempdir().unwrap();
        let program = directory.path().join("deaf");
        fs::write(&program, "#!/bin/sh\nexec sleep 60\n").unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let plan = Plan {
            program,
            out: directory.path().to_owned(),
            jobs: 1,
            threads: 1,
        };
        let run = |index: usize| PlannedRun {
            index,
            name: format!("small/td3/seed-{index}"),
            file: "small.toml".into(),
            settings: Vec::new(),
            seed: 0,
            config: Config::preset(Method::Td3),
        };
        let stop = AtomicBool::new(false);
        let outcomes = super::run(&plan, &[run(0), run(1)], &mut Impatient(&stop), &stop);
        assert_eq!(outcomes.len(), 2);
        assert!(outcomes.iter().all(|o| o.ended == Ended::Interrupted));
    }
}
