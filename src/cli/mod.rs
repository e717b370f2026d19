//! The command line: one file a subcommand.

mod acting;
mod compare;
mod curves;
mod demo;
mod envs;
mod eval;
mod live;
mod plan;
mod progress;
mod render;
mod settings;
mod signals;
mod slurm;
mod sweep;
mod train;
mod verify;

use crate::config::{ConfigError, Range};
use crate::env::{MakeError, UnknownTask};
use crate::lab::comparison::ComparisonError;
use crate::lab::sweep::SweepError;
use crate::lab::sweep::slurm::SlurmError;
use crate::recordings::DemonstrationError;
use crate::recordings::format::RecordingError;
use crate::render::{OutputError, PaintError, RenderError};
use crate::run::{CheckpointError, LockError, RunDirectoryError};
use crate::training::{PlanError, TrainError};
use clap::builder::{OsStringValueParser, TypedValueParser};
use clap::{Parser, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// Exit code of a run that failed.
const FAILED: u8 = 1;
/// Exit code of wrong usage or a wrong configuration; nothing was written.
const MISUSED: u8 = 2;
/// Exit code of a run that was interrupted and saved a checkpoint (`EX_TEMPFAIL` of sysexits.h).
const INTERRUPTED: u8 = 75;

/// Reinforcement learning on MuJoCo: TD3, and MAMF, which also learns from imaginary transitions
/// in a learned model.
#[derive(Debug, Parser)]
#[command(name = "mamf", version, about, max_term_width = 100)]
#[command(
    after_help = "Exit codes: 0 done; 1 failed at run time, verification past tolerance, or --at-least not met; \
    2 wrong usage or configuration, nothing written; 75 interrupted, checkpoint saved: resumable; 130 ended by an interrupt (129 \
    by SIGHUP, 143 by SIGTERM). Whether anybody reads what is printed changes none of them."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a policy: learning curves and checkpoints in a run directory
    Train(train::Args),
    /// Make all runs of an experiment: configurations, variants and seeds of one file
    Sweep(sweep::Args),
    /// Compare two methods: runs paired by task and seed, differences with intervals
    Compare(compare::Args),
    /// Final values of many runs, or with --json all that figures of their learning curves show
    Curves(curves::Args),
    /// Evaluate the policy of a checkpoint
    Eval(eval::Args),
    /// Draw pictures and videos of a policy, a task or a recording
    Render(render::Args),
    /// Make recordings by planning in the simulator
    Plan(plan::Args),
    /// List the tasks, or show one in detail
    Envs(envs::Args),
    /// List the keys of a configuration, or all about one
    Settings(settings::Args),
    /// Replay recorded rollouts and compare every step
    Verify(verify::Args),
    /// Record demonstrations from a policy, describe and replay sets of them
    Demo(demo::Args),
}

impl Cli {
    /// Runs the subcommand.
    ///
    /// # Errors
    /// Whatever the user should read; see [`report`].
    pub fn run(self) -> anyhow::Result<ExitCode> {
        signals::survive_limits()?;
        match self.command {
            Command::Train(args) => train::run(&args),
            Command::Sweep(args) => sweep::run(&args),
            Command::Compare(args) => compare::run(&args),
            Command::Curves(args) => curves::run(&args),
            Command::Eval(args) => eval::run(&args),
            Command::Render(args) => render::run(&args),
            Command::Plan(args) => plan::run(&args),
            Command::Envs(args) => envs::run(&args),
            Command::Settings(args) => settings::run(&args),
            Command::Verify(args) => verify::run(&args),
            Command::Demo(args) => demo::run(&args),
        }
    }
}

/// Which episodes of which policy are run; the same options give the same episodes everywhere.
#[derive(Debug, clap::Args)]
struct Episodes {
    /// Episodes, of the deterministic policy unless told otherwise
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    episodes: u32,
    /// Seed of the initial states
    #[arg(
        long,
        value_name = "N",
        allow_negative_numbers = true,
        default_value_t = 0
    )]
    seed: u64,
}

/// Takes the whole numbers that a configuration holds.
fn whole() -> impl TypedValueParser<Value = u64> {
    clap::value_parser!(u64).range(..=Range::LARGEST)
}

/// A mistake of the user that has no type of its own.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Misuse(String);

/// Takes a setting. A configuration is text, and so is what is put on top of it.
fn setting() -> impl TypedValueParser<Value = String> {
    OsStringValueParser::new().try_map(|word| {
        word.into_string().map_err(|_| {
            "not UTF-8, which settings are; where a path is meant, give a link of another name to it"
        })
    })
}

/// Writes a line to standard error; nobody listening there is no reason to fail.
fn tell(message: &str) {
    let _ = writeln!(std::io::stderr(), "{message}");
}

/// Writes a line to standard output, beside work whose outcome lies elsewhere: in files, in an exit code. Nobody listening
/// there changes nothing of it.
fn say(text: &str) {
    report_to_reader(&format!("{text}\n"));
}

/// As [`say`], with a `text` of whole lines.
fn report_to_reader(text: &str) {
    if let Err(error) = print(text) {
        tell(&format!("note: {error}; nothing else depends on it"));
    }
}

/// Writes `text` to standard output, where all that a command does is to print it. A reader who has seen enough, as in
/// `mamf envs | head`, is no error.
///
/// # Errors
/// When the system takes it for another reason, such as a full disk.
fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(anyhow::anyhow!("standard output can't be written: {error}"))
        }
        _ => Ok(()),
    }
}

/// Four digits or so.
fn number(value: f64) -> String {
    let decimals = match value.abs() {
        size if size >= 1_000.0 || value == 0.0 => 0,
        size if size >= 100.0 => 1,
        size if size >= 1.0 => 2,
        _ => 4,
    };
    format!("{value:.decimals$}")
}

/// Tells the user of `error` and returns the code to end the process with.
pub fn report(error: &anyhow::Error) -> ExitCode {
    tell(&format!("error: {}", in_words(error)));
    exit_code(error)
}

/// An error and what caused it, each said once: many a message holds that of its cause already.
fn in_words(error: &anyhow::Error) -> String {
    let mut words = String::new();
    for cause in error.chain().map(ToString::to_string) {
        match words.is_empty() {
            true => words = cause,
            false if words.contains(&cause) => (),
            false => words += &format!(": {cause}"),
        }
    }
    words
}

/// The exit code an error ends the process with: 2 for wrong usage or configuration, 1 otherwise.
fn exit_code(error: &anyhow::Error) -> ExitCode {
    let misused = error.chain().any(|cause| {
        cause.is::<ConfigError>()
            || cause.is::<UnknownTask>()
            || matches!(cause.downcast_ref(), Some(MakeError::Unknown(_)))
            || cause.is::<Misuse>()
            || cause.downcast_ref().is_some_and(is_misuse_of_renderer)
            || cause.downcast_ref().is_some_and(is_misuse_of_output)
            || matches!(cause.downcast_ref(), Some(PaintError::Camera { .. }))
            || matches!(cause.downcast_ref(), Some(RecordingError::Missing { .. }))
            || cause.is::<SweepError>()
            || cause.downcast_ref().is_some_and(is_misuse_of_plan)
            || cause.is::<ComparisonError>()
            || cause.is::<SlurmError>()
            || cause
                .downcast_ref::<RunDirectoryError>()
                .is_some_and(is_misuse_of_directory)
            || cause
                .downcast_ref::<CheckpointError>()
                .is_some_and(is_misuse_of_checkpoint)
            || cause
                .downcast_ref::<TrainError>()
                .is_some_and(is_misuse_of_training)
    });
    ExitCode::from(if misused { MISUSED } else { FAILED })
}

fn is_misuse_of_directory(error: &RunDirectoryError) -> bool {
    matches!(
        error,
        RunDirectoryError::Exists(_)
            | RunDirectoryError::NotARun { .. }
            | RunDirectoryError::NoRun(_)
            | RunDirectoryError::IsACheckpoint(_)
            | RunDirectoryError::Locked(LockError::Held { .. })
    )
}

fn is_misuse_of_plan(error: &PlanError) -> bool {
    matches!(
        error,
        PlanError::NotEmpty(_) | PlanError::NothingThere(_) | PlanError::Changed { .. }
    )
}

fn is_misuse_of_renderer(error: &RenderError) -> bool {
    matches!(
        error,
        RenderError::NoRenderer { .. }
            | RenderError::InTheWay(_)
            | RenderError::Forced { .. }
            | RenderError::UnknownLibrary(_)
            | RenderError::Size(..)
    )
}

fn is_misuse_of_output(error: &OutputError) -> bool {
    matches!(
        error,
        OutputError::UnknownFormat { .. }
            | OutputError::Exists { .. }
            | OutputError::OddSize { .. }
            | OutputError::NoFfmpeg { .. }
    ) || matches!(error, OutputError::Io { error, .. } if is_no_place(error))
}

/// Whether there is no such folder to write to.
fn is_no_place(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{NotADirectory, NotFound};
    matches!(error.kind(), NotFound | NotADirectory)
}

fn is_misuse_of_training(error: &TrainError) -> bool {
    match error {
        TrainError::RunDirectory(error) => is_misuse_of_directory(error),
        TrainError::Demonstrations { error, .. } => matches!(
            error,
            DemonstrationError::Find(_) | DemonstrationError::Task { .. }
        ),
        TrainError::Memory(_)
        | TrainError::Networks { .. }
        | TrainError::Changed { .. }
        | TrainError::NotResumable(_)
        | TrainError::OtherDemonstrations(_)
        | TrainError::CheckpointsMissing { .. }
        | TrainError::StepsTaken { .. } => true,
        // The files of a run are not the user's words, but options are.
        TrainError::Config(error) => matches!(error, ConfigError::WrongValue { .. }),
        _ => false,
    }
}

fn is_misuse_of_checkpoint(error: &CheckpointError) -> bool {
    matches!(
        error,
        CheckpointError::Missing(_)
            | CheckpointError::NotSaved(_)
            | CheckpointError::OtherTask { .. }
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn a_cause_is_said_once() {
        let cause = || anyhow::anyhow!("no such thing");
        let message = in_words(&cause().context("a: no such thing").context("b"));
        assert_eq!(message, "b: a: no such thing");
        let told: anyhow::Result<()> = Err(cause()).context("can't");
        assert_eq!(in_words(&told.unwrap_err()), "can't: no such thing");
    }
}
