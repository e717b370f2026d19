//! `mamf sweep`

use super::live::LiveTable;
use super::{FAILED, INTERRUPTED, Misuse, print, say, setting, signals, slurm, tell, whole};
use crate::core::parallel::cores;
use crate::core::paths::operand;
use crate::core::table::{Column, Table};
use crate::lab::sweep::memory::{Budget, needs};
use crate::lab::sweep::{
    self, Changes, Ended, Outcome, Plan, PlannedRun, Program, Standing, Sweep,
};
use crate::run::{LockError, RunDirectory, RunDirectoryError, memory};
use anyhow::Context;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long a requeued job waits for the process it had before, which may lie on another node that the cluster has lost.
const PATIENCE: Duration = Duration::from_secs(120);

/// Arguments of `mamf sweep`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The experiment, for example configs/paper/figure_2.toml
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Folder of the runs [default: runs/<name of the file>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Runs side by side [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Override a setting of all runs
    #[arg(long, value_name = "KEY=VALUE", value_parser = setting())]
    set: Vec<String>,
    /// Environment steps of each run
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Seeds instead of the experiment's
    #[arg(long, value_name = "N", num_args = 1.., value_parser = whole())]
    seeds: Option<Vec<u64>>,
    /// List the runs and what became of them, and make none
    #[arg(long)]
    dry_run: bool,
    /// Only the runs whose name matches, for example 'hopper/*/seed-0'
    #[arg(long, value_name = "PATTERN", conflicts_with = "task_index")]
    only: Option<glob::Pattern>,
    /// Make only the run of this number in the list, which begins with 0
    #[arg(long, value_name = "K")]
    task_index: Option<usize>,
    /// Go on with interrupted runs although another build of mamf began them, whose results may differ; run.json tells
    #[arg(long)]
    accept_program: bool,
    #[command(flatten)]
    slurm: Box<slurm::Args>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut settings = args.set.clone();
    settings.extend(args.steps.map(|steps| format!("steps={steps}")));
    let changes = Changes {
        seeds: args.seeds.clone(),
        settings,
    };
    let sweep = Sweep::read(&args.file, &changes)?;
    let default = || PathBuf::from("runs").join(&sweep.name);
    let out = args.out.clone().unwrap_or_else(default);
    let runs = args.chosen(sweep.runs)?;
    if out.exists() && !out.is_dir() {
        let reason = format!(
            "--out {}: not a directory; runs go to a folder",
            out.display()
        );
        return Err(Misuse(reason).into());
    }
    if args.dry_run {
        list(&runs, &out)?;
        return Ok(ExitCode::SUCCESS);
    }
    if args.slurm.slurm {
        let submission = slurm::Submission {
            name: &sweep.name,
            out: &out,
            runs: &runs,
            arguments: args.forwarded(),
        };
        return slurm::run(&args.slurm, submission);
    }

    let cores = args.cores();
    let jobs = args.jobs.map_or(cores, usize::from).min(runs.len());
    let program = std::env::current_exe().context("where this program lies")?;
    let plan = Plan {
        program: Program::own(&program),
        accept_program: args.accept_program,
        budget: budget(&runs, jobs, &out)?,
        out,
        jobs,
        // A second thread takes up half of an update at best; a third one nothing.
        threads: (cores / jobs).clamp(1, 2),
    };
    // The runs, which get an interrupt of the terminal too, end at a second one; the sweep follows them.
    let stop = signals::stop_and_save(false)?;
    if args.task_index.is_some() && slurm_number("SLURM_RESTART_COUNT").is_some() {
        for run in &runs {
            wait_for_former(&plan.out.join(&run.name), &stop);
        }
    }
    let mut table = LiveTable::new(&runs);
    let outcomes = sweep::run(&plan, &runs, &mut table, &stop);
    table.finish();
    Ok(conclude(&outcomes, &plan))
}

/// What the runs that are left take together, of which the user is told, and what there is.
fn budget(runs: &[PlannedRun], jobs: usize, out: &Path) -> anyhow::Result<Option<Budget>> {
    let Some(available) = memory::available() else {
        return Ok(None);
    };
    let left =
        |run: &PlannedRun| Standing::of(&out.join(&run.name), &run.config) != Standing::Finished;
    let all = needs(runs)?;
    let needs = all
        .iter()
        .zip(runs)
        .map(|(need, run)| if left(run) { *need } else { 0 });
    let budget = Budget {
        available,
        needs: needs.collect(),
    };
    let mut largest = budget.needs.clone();
    largest.sort_unstable_by(|a, b| b.cmp(a));
    let beside: u64 = largest.iter().take(jobs).sum();
    if beside > 0 {
        let [beside, spare] = [beside, available].map(memory::bytes);
        tell(&format!(
            "memory: up to {beside} for {jobs} at a time, of {spare} to spare"
        ));
    }
    let fitting = budget.side_by_side(jobs);
    if fitting < jobs {
        let largest = memory::bytes(largest[0]);
        tell(&format!(
            "note: only {fitting} of {jobs} fit side by side (up to {largest} each); the others wait; a smaller replay.capacity takes less"
        ));
    }
    Ok(Some(budget))
}

/// A number from 1 that Slurm left in the environment.
fn slurm_number(variable: &str) -> Option<usize> {
    let text = std::env::var(variable).ok()?;
    text.parse().ok().filter(|number| *number > 0)
}

/// Waits while another process works on a run, as that of a job before it was requeued may for a moment.
fn wait_for_former(directory: &Path, stop: &AtomicBool) {
    let began = Instant::now();
    let mut told = false;
    while !stop.load(Ordering::Relaxed) && began.elapsed() < PATIENCE {
        let Err(RunDirectoryError::Locked(error @ LockError::Held { .. })) =
            RunDirectory::open(directory)
        else {
            return;
        };
        if !told {
            tell(&format!("waiting: {error}"));
            told = true;
        }
        std::thread::sleep(Duration::from_millis(500));
    }
}

impl Args {
    /// Cores that are ours. Slurm's allotment to an element of an array counts, as not every cluster binds
    /// processes to it.
    fn cores(&self) -> usize {
        let found = cores();
        let allotted = slurm_number("SLURM_CPUS_PER_TASK");
        let allotted = allotted.filter(|_| self.task_index.is_some());
        allotted.map_or(found, |allotted| allotted.min(found))
    }

    /// The arguments that mean the same experiment, for each element of an array; its number is added there.
    fn forwarded(&self) -> Vec<PathBuf> {
        let mut words = vec!["sweep".into(), operand(&self.file)];
        if let Some(out) = &self.out {
            words.extend(["--out".into(), operand(out)]);
        }
        for setting in &self.set {
            words.extend(["--set".into(), setting.into()]);
        }
        if self.accept_program {
            words.push("--accept-program".into());
        }
        if let Some(steps) = self.steps {
            words.extend(["--steps".into(), steps.to_string().into()]);
        }
        if let Some(seeds) = &self.seeds {
            words.push("--seeds".into());
            words.extend(seeds.iter().map(|seed| seed.to_string().into()));
        }
        words
    }

    /// Those of `runs` that are to be made.
    fn chosen(&self, mut runs: Vec<PlannedRun>) -> anyhow::Result<Vec<PlannedRun>> {
        let count = runs.len();
        if let Some(index) = self.task_index {
            runs.retain(|run| run.index == index);
            if runs.is_empty() {
                let last = count - 1;
                let reason = format!("--task-index {index}: there are {count} runs, 0 to {last}");
                return Err(Misuse(reason).into());
            }
        }
        if let Some(pattern) = &self.only {
            let example = runs[0].name.clone();
            runs.retain(|run| pattern.matches(&run.name));
            if runs.is_empty() {
                let reason = format!(
                    "--only {pattern}: no run has such a name; the first of {count} is {example}"
                );
                return Err(Misuse(reason).into());
            }
        }
        Ok(runs)
    }
}

fn list(runs: &[PlannedRun], out: &Path) -> anyhow::Result<()> {
    let mut table = Table::new([
        Column::numbers("").at_least(4),
        Column::words(""),
        Column::numbers("").at_least(15),
        Column::words(""),
    ]);
    for run in runs {
        let standing = match Standing::of(&out.join(&run.name), &run.config) {
            Standing::Absent => "to be begun".to_owned(),
            Standing::Interrupted(step) => format!("to go on from step {step}"),
            Standing::Finished => "finished".to_owned(),
            Standing::InTheWay(reason) => reason,
        };
        let steps = format!("{} steps", run.config.steps);
        table.row([run.index.to_string(), run.name.clone(), steps, standing]);
    }
    print(&table.to_string())
}

/// What became of the runs, in a line, and of each that failed.
fn conclude(outcomes: &[Outcome], plan: &Plan) -> ExitCode {
    let count = |wanted: fn(&Ended) -> bool| outcomes.iter().filter(|o| wanted(&o.ended)).count();
    let finished = count(|ended| *ended == Ended::Finished);
    let interrupted = count(|ended| *ended == Ended::Interrupted);
    for outcome in outcomes {
        if let Ended::Failed(reason) = &outcome.ended {
            tell(&format!("failed: {}: {reason}", outcome.name));
        }
    }
    let (all, out) = (outcomes.len(), plan.out.display());
    say(&format!("{finished} of {all} runs finished: {out}"));
    if finished + interrupted < all {
        return ExitCode::from(FAILED);
    }
    if interrupted > 0 {
        tell(&format!(
            "{interrupted} interrupted or not begun; the same command goes on with them"
        ));
        return ExitCode::from(INTERRUPTED);
    }
    ExitCode::SUCCESS
}
