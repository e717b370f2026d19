//! Runs of an experiment side by side: processes of this program.

use super::memory::Budget;
use super::{PlannedRun, Program, Progress, Standing};
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
/// Signals that the system ends a process with: where memory runs out, and where a file passes its limit (POSIX has both
/// numbers so on Linux).
const SIGKILL: i32 = 9;
const SIGXFSZ: i32 = 25;
/// Exit code of a run that was interrupted and can go on.
const RESUMABLE: i32 = 75;

/// How the runs are to be made.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The program.
    pub program: Program,
    /// Whether interrupted runs go on that another program began.
    pub accept_program: bool,
    /// What the runs may take together; none where the machine does not tell.
    pub budget: Option<Budget>,
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
    /// Length of the log before it.
    said: u64,
    child: Child,
    told: bool,
    /// Its place among the runs.
    place: usize,
}

/// Makes `runs`: finished ones are passed over, interrupted ones go on. When `stop` becomes true, no more are
/// begun, and those under way are asked to save and end.
pub fn run(
    plan: &Plan,
    runs: &[PlannedRun],
    watcher: &mut dyn Watcher,
    stop: &AtomicBool,
) -> Vec<Outcome> {
    let mut waiting = runs.iter().enumerate().peekable();
    let mut jobs: Vec<Job<'_>> = Vec::new();
    let mut outcomes = Vec::new();
    loop {
        let stopped = stop.load(Ordering::Relaxed);
        let has_room = |jobs: &[Job<'_>], next: usize| {
            let running: Vec<usize> = jobs.iter().map(|job| job.place).collect();
            let budget = plan.budget.as_ref();
            budget.is_none_or(|budget| budget.has_room(&running, next))
        };
        while jobs.len() < plan.jobs && !stopped {
            let Some((place, run)) = waiting.next_if(|(place, _)| has_room(&jobs, *place)) else {
                break;
            };
            match begin(plan, place, run, watcher) {
                Ok(job) => jobs.push(job),
                Err(ended) => end(run, ended, watcher, &mut outcomes),
            }
        }
        if stopped {
            for job in jobs.iter_mut().filter(|job| !job.told) {
                job.told = true;
                interrupt(&job.child);
            }
            for (_, run) in waiting.by_ref() {
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
                    _ => ended(status, &job.log, job.said),
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
    place: usize,
    run: &'a PlannedRun,
    watcher: &mut dyn Watcher,
) -> Result<Job<'a>, Ended> {
    let directory = plan.out.join(&run.name);
    let log = crate::core::files::beside(&directory, "log");
    let mut command = Command::new(plan.program.path());
    // Its name alone: what a run records of its command is then the same wherever the program lies.
    command.arg0("mamf").arg("train");
    let step = match Standing::of(&directory, &run.config) {
        Standing::Finished => return Err(Ended::Finished),
        Standing::InTheWay(reason) => return Err(Ended::Failed(reason)),
        Standing::Interrupted(step) => {
            command.arg("--resume").arg(operand(&directory));
            command.args(["--steps", &run.config.steps.to_string()]);
            if plan.accept_program {
                command.arg("--force");
            }
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
    if let Some(reason) = plan.program.changed() {
        return Err(Ended::Failed(reason));
    }
    let mut said = 0;
    let child = log_file(&log).and_then(|file| {
        let errors = file.try_clone()?;
        said = file.metadata()?.len();
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
                said,
                child,
                told: false,
                place,
            })
        }
        Err(error) => {
            // Of the file of what it says, or of the program: which of both, the system does not tell.
            let (log, program) = (log.display(), plan.program.path().display());
            Err(Ended::Failed(format!(
                "can't be started: {program} into {log}: {error}"
            )))
        }
    }
}

/// What a run says goes beside its directory, after what it said before.
fn log_file(path: &Path) -> io::Result<File> {
    fs::create_dir_all(crate::core::files::parent(path))?;
    OpenOptions::new().create(true).append(true).open(path)
}

/// How a run ended whose process said what stands in its log after the first `before` bytes.
fn ended(status: ExitStatus, log: &Path, before: u64) -> Ended {
    match status.code() {
        Some(0) => return Ended::Finished,
        Some(RESUMABLE) => return Ended::Interrupted,
        _ => (),
    }
    let said = fs::read(log).unwrap_or_default();
    let said = said.get(before as usize..).unwrap_or_default();
    let said = String::from_utf8_lossy(said);
    let reason = match (status.signal(), reason(&said)) {
        // What it said before tells nothing of that.
        (Some(SIGKILL), _) => {
            "killed from outside, as the system does where memory runs out".to_owned()
        }
        (Some(SIGXFSZ), _) => {
            "ended by the system: a file passed the limit of its size (ulimit -f)".to_owned()
        }
        (Some(_), None) => "ended by a signal".to_owned(),
        (_, Some(reason)) => reason,
        (None, None) => "it gave no reason".to_owned(),
    };
    Ended::Failed(format!("{reason} ({status}; {})", log.display()))
}

/// The reason that a process gave for its end: the error that it ended with, with all its lines, or a panic. What it said
/// besides is none.
fn reason(said: &str) -> Option<String> {
    let lines: Vec<&str> = said.lines().collect();
    let begins = |line: &&str| line.starts_with("error: ") || line.contains("panicked at ");
    let first = lines.iter().rposition(begins)?;
    let words = lines[first..]
        .iter()
        .map(|line| line.trim())
        .filter(|line| !line.is_empty());
    let words: Vec<&str> = words.collect();
    Some(words.join(" ").trim_start_matches("error: ").to_owned())
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

    /// Looks on.
    struct Patient;

    impl Watcher for Patient {
        fn began(&mut self, _: &PlannedRun, _: u64) {}
        fn proceeds(&mut self, _: &PlannedRun, _: Progress) {}
        fn ended(&mut self, _: &PlannedRun, _: &Ended) {}
    }

    fn program(directory: &Path, script: &str) -> PathBuf {
        let program = directory.join("program");
        fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        program
    }

    /// How runs end whose process is `script`, made `jobs` side by side.
    fn made(
        directory: &Path,
        script: &str,
        runs: usize,
        jobs: usize,
        budget: Option<Budget>,
    ) -> Vec<Ended> {
        let plan = Plan {
            program: Program::at(&program(directory, script)),
            accept_program: false,
            budget,
            out: directory.to_owned(),
            jobs,
            threads: 1,
        };
        let runs: Vec<PlannedRun> = (0..runs).map(planned).collect();
        let outcomes = super::run(&plan, &runs, &mut Patient, &AtomicBool::new(false));
        outcomes.into_iter().map(|outcome| outcome.ended).collect()
    }

    fn planned(index: usize) -> PlannedRun {
        PlannedRun {
            index,
            name: format!("small/td3/seed-{index}"),
            file: "small.toml".into(),
            settings: Vec::new(),
            seed: 0,
            config: Config::preset(Method::Td3),
        }
    }

    #[test]
    fn the_reason_of_a_failure_is_the_reason_and_not_the_last_line() {
        for (script, part, not) in [
            (
                "echo 'error: a.toml: no' >&2; echo 'a note that came later, indented'",
                "a.toml: no",
                "error: ",
            ),
            (
                "echo 'error: changed:' >&2; echo '  one' >&2; echo 'undo this' >&2; exit 1",
                "changed: one undo this",
                "gave",
            ),
            (
                "echo 'replay buffer: 5 GB when full' >&2; kill -KILL $$",
                "memory runs out",
                "5 GB",
            ),
            (
                "echo 'replay buffer: 5 GB when full' >&2; exit 3",
                "it gave no reason",
                "5 GB",
            ),
        ] {
            let directory = tempfile::tempdir().unwrap();
            let log = directory.path().join("small/td3/seed-0.log");
            fs::create_dir_all(log.parent().unwrap()).unwrap();
            // Of a process before it.
            fs::write(&log, "error: an old one\n").unwrap();
            let script = format!("{script}; exit 1");
            let [Ended::Failed(reason)] = &made(directory.path(), &script, 1, 1, None)[..] else {
                panic!("{script}");
            };
            assert!(reason.contains(part) && !reason.contains(not), "{reason}");
            assert!(
                !reason.contains("an old one") && reason.contains("seed-0.log"),
                "{reason}"
            );
        }
    }

    #[test]
    fn runs_that_do_not_fit_side_by_side_wait_for_each_other() {
        let most = |available| {
            let directory = tempfile::tempdir().unwrap();
            let here = directory.path().display();
            // Each leaves how many were at work when it began.
            let script = format!(
                "mkdir '{here}'/at.$$; ls -d '{here}'/at.* | wc -l >>'{here}/count'; sleep 0.3; rmdir '{here}'/at.$$"
            );
            let budget = Budget {
                available,
                needs: vec![60; 3],
            };
            let ended = made(directory.path(), &script, 3, 3, Some(budget));
            assert!(ended.iter().all(|ended| *ended == Ended::Finished));
            let counts = fs::read_to_string(directory.path().join("count")).unwrap();
            counts
                .lines()
                .map(|n| n.trim().parse::<usize>().unwrap())
                .max()
                .unwrap()
        };
        assert_eq!([most(100), most(120), most(59)], [1, 2, 1]);
    }

    #[test]
    fn no_run_begins_with_another_program_than_the_first() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("program");
        // It is replaced, as by a build, while the first run is made.
        let script = format!(
            "cp '{0}' '{0}.new'; echo '# more' >>'{0}.new'; mv '{0}.new' '{0}'",
            path.display()
        );
        let ended = made(directory.path(), &script, 2, 1, None);
        assert_eq!(ended[0], Ended::Finished);
        assert!(
            matches!(&ended[1], Ended::Failed(reason) if reason.contains("replaced")),
            "{ended:?}"
        );
        let ended = made(
            directory.path(),
            &format!("rm '{}'", path.display()),
            2,
            1,
            None,
        );
        assert!(
            matches!(&ended[1], Ended::Failed(reason) if reason.contains("no longer there")),
            "{ended:?}"
        );
    }

    #[test]
    fn a_run_that_is_told_to_end_before_it_hears_can_go_on() {
        let directory = tempfile::tempdir().unwrap();
        let program = program(directory.path(), "exec sleep 60");
        let plan = Plan {
            program: Program::at(&program),
            accept_program: false,
            budget: None,
            out: directory.path().to_owned(),
            jobs: 1,
            threads: 1,
        };
        let stop = AtomicBool::new(false);
        let outcomes = super::run(
            &plan,
            &[planned(0), planned(1)],
            &mut Impatient(&stop),
            &stop,
        );
        assert_eq!(outcomes.len(), 2);
        assert!(outcomes.iter().all(|o| o.ended == Ended::Interrupted));
    }
}
