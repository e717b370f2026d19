//! The command line: one file a subcommand.

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
use crate::render::{OutputError, PaintError, RenderError};
use crate::run::{CheckpointError, LockError, RunDirectoryError};
use crate::training::{PlanError, TrainError};
use clap::builder::TypedValueParser;
use clap::{Parser, Subcommand};
use std::io::Write;
use std::path::PathBuf;
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
    2 wrong usage or configuration, nothing written; 75 interrupted, checkpoint saved: resumable; 130 ended by an interrupt."
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
    /// Run directory (its last checkpoint) or checkpoint (for example RUN/checkpoints/best)
    #[arg(long, value_name = "RUN_OR_CHECKPOINT")]
    checkpoint: PathBuf,
    /// Episodes of the deterministic policy
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

/// Writes a line to standard error; nobody listening there is no reason to fail.
fn tell(message: &str) {
    let _ = writeln!(std::io::stderr(), "{message}");
}

/// Writes a line to standard output; nobody listening there is no reason to stop what is being made.
fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
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
    let closed = |e: &std::io::Error| e.kind() == std::io::ErrorKind::BrokenPipe;
    if error.downcast_ref().is_some_and(closed) {
        // The reader of our output has seen enough, as in `mamf envs | head`.
        return ExitCode::SUCCESS;
    }
    tell(&format!("error: {error:#}"));
    exit_code(error)
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
            | RunDirectoryError::NotARun(_)
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
    )
}

fn is_misuse_of_training(error: &TrainError) -> bool {
    match error {
        TrainError::RunDirectory(error) => is_misuse_of_directory(error),
        TrainError::Demonstrations { error } => matches!(
            error,
            DemonstrationError::Find(_) | DemonstrationError::Task { .. }
        ),
        TrainError::Memory(_)
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
        CheckpointError::Missing(_) | CheckpointError::OtherTask { .. }
    )
}
