//! `mamf sweep --slurm`

use super::{FAILED, print, say, tell};
use crate::core::files::{FileError, Files};
use crate::lab::sweep::slurm::{self, Elements, Request, Sbatch, TimeLimit};
use crate::lab::sweep::{PlannedRun, Standing};
use anyhow::Context;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Options that need `--slurm`.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Slurm")]
pub(super) struct Args {
    /// Submit the runs that are not finished as a job array; each goes on by itself after a time limit or preemption
    #[arg(long, conflicts_with_all = ["dry_run", "task_index", "jobs"])]
    pub slurm: bool,
    /// Show the batch script, and write and submit nothing
    #[arg(long, requires = "slurm")]
    print: bool,
    /// Partition [default: the cluster's]
    #[arg(long, value_name = "NAME", requires = "slurm", value_parser = slurm::name)]
    partition: Option<String>,
    /// Time limit of each run, before which it is saved and requeued; for example 90 (minutes), 12:00:00 or 2-00
    /// [default: the partition's]
    #[arg(
        long,
        value_name = "TIME",
        requires = "slurm",
        allow_hyphen_values = true
    )]
    time: Option<TimeLimit>,
    /// Seconds before the time limit at which a run is saved: longer than an evaluation takes
    #[arg(long, value_name = "SECONDS", requires = "slurm", allow_negative_numbers = true, default_value_t = 120, value_parser = clap::value_parser!(u16).range(1..))]
    signal_before: u16,
    /// Cores of each run, of which it uses two at most
    #[arg(long, value_name = "N", requires = "slurm", allow_negative_numbers = true, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    cpus_per_task: u16,
    /// Memory of each run, for example 4G [default: the cluster's]
    #[arg(long, value_name = "SIZE", requires = "slurm", allow_hyphen_values = true, value_parser = slurm::memory)]
    mem: Option<String>,
    /// Runs at a time at most
    #[arg(long, value_name = "N", requires = "slurm", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    max_parallel: Option<u32>,
    /// Account that is charged
    #[arg(long, value_name = "NAME", requires = "slurm", value_parser = slurm::name)]
    account: Option<String>,
    /// Quality of service
    #[arg(long, value_name = "NAME", requires = "slurm", value_parser = slurm::name)]
    qos: Option<String>,
    /// Features that nodes must have: one type of processor gives one set of bytes
    #[arg(long, value_name = "FEATURES", requires = "slurm", value_parser = slurm::name)]
    constraint: Option<String>,
    /// Name of the job [default: mamf-<name of the file>]
    #[arg(long, value_name = "NAME", requires = "slurm", value_parser = slurm::name)]
    job_name: Option<String>,
    /// Another option of sbatch, for example --sbatch=--mail-type=END; may be repeated
    #[arg(long, value_name = "OPTION", requires = "slurm", allow_hyphen_values = true, value_parser = slurm::directive)]
    sbatch: Vec<String>,
}

/// The experiment whose runs are submitted.
pub(super) struct Submission<'a> {
    /// Its name.
    pub name: &'a str,
    /// Folder of the runs.
    pub out: &'a Path,
    /// The runs to be made.
    pub runs: &'a [PlannedRun],
    /// Arguments with which each element of the array reads the same experiment.
    pub arguments: Vec<PathBuf>,
}

/// Submits the runs that are left, or shows the script that would be submitted.
pub(super) fn run(args: &Args, submission: Submission<'_>) -> anyhow::Result<ExitCode> {
    let Submission {
        name, out, runs, ..
    } = submission;
    let mut indices = Vec::new();
    let (mut finished, mut in_the_way) = (0, Vec::new());
    for run in runs {
        match Standing::of(&out.join(&run.name), &run.config) {
            Standing::Absent | Standing::Interrupted(_) => indices.push(run.index),
            Standing::Finished => finished += 1,
            Standing::InTheWay(reason) => in_the_way.push((&run.name, reason)),
        }
    }
    let code = if in_the_way.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(FAILED)
    };
    let leave_out = || {
        for (name, reason) in &in_the_way {
            tell(&format!("left out: {name}: {reason}"));
        }
    };
    let (all, left, shown) = (runs.len(), indices.len(), out.display());
    if indices.is_empty() {
        leave_out();
        // A script is expected on standard output, and there is none.
        let speak = if args.print { tell } else { say };
        speak(&format!(
            "nothing is left to be submitted, {finished} of {all} runs are finished: {shown}"
        ));
        return Ok(code);
    }

    let directory = std::env::current_dir().context("the working directory")?;
    let logs = out.join("slurm");
    let elements = Elements {
        indices,
        program: std::env::current_exe().context("where this program lies")?,
        arguments: submission.arguments,
        logs: directory.join(&logs),
        directory,
        most: slurm::most_elements(),
    };
    let text = slurm::script(&args.request(name), &elements)?;
    if args.print {
        leave_out();
        print(&text)?;
        return Ok(code);
    }
    // Before anything is written.
    let sbatch = Sbatch::find()?;
    let path = out.join(format!("{name}.sbatch"));
    for folder in [out, &logs] {
        std::fs::create_dir_all(folder).map_err(FileError::at(folder))?;
    }
    Files::default().replace(&path, text.as_bytes())?;
    for (variable, value) in slurm::deciding() {
        let (variable, value) = (variable.display(), value.display());
        tell(&format!(
            "note: {variable}={value} of the environment is left out; --sbatch gives sbatch further options"
        ));
    }
    let job = sbatch.submit(&path)?;
    leave_out();
    let (logs, path) = (logs.display(), path.display());
    say(&format!(
        "job {job}: {left} of {all} runs submitted, {finished} finished already; script: {path}\n\
        squeue --jobs {job} shows the job, {logs}/{job}_*.log what its runs say, scancel {job} ends it\n\
        once it has ended, the same command submits what is left"
    ));
    Ok(code)
}

impl Args {
    fn request(&self, name: &str) -> Request {
        Request {
            job_name: self
                .job_name
                .clone()
                .unwrap_or_else(|| format!("mamf-{name}")),
            partition: self.partition.clone(),
            account: self.account.clone(),
            qos: self.qos.clone(),
            constraint: self.constraint.clone(),
            time: self.time.clone(),
            signal_before: self.signal_before,
            cpus_per_task: self.cpus_per_task,
            memory: self.mem.clone(),
            max_parallel: self.max_parallel,
            directives: self.sbatch.clone(),
        }
    }
}
