//! `mamf verify`: replay recorded rollouts.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::env;
use crate::recordings::verify::{self, Report, UnusableInput};

/// Every rollout was reproduced.
const PASSED: u8 = 0;
/// A rollout was not reproduced, or is damaged.
const FAILED: u8 = 1;
/// There is nothing to verify.
const UNUSABLE: u8 = 2;

/// Arguments of `mamf verify`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Only rollouts of this task
    #[arg(long, value_name = "ID")]
    task: Option<String>,
    /// Directory of rollouts (.npz beside .json), searched with its subdirectories
    #[arg(value_name = "DIR")]
    directory: PathBuf,
}

/// Replays the rollouts, prints a table, and tells by the exit code whether all were reproduced:
/// 0 yes, 1 past tolerance or damaged, 2 nothing to verify.
///
/// # Errors
/// If the task asked for is unknown.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(task) = &args.task {
        env::info(task)?;
    }
    let code = match verify::verify(&args.directory, args.task.as_deref()) {
        Ok(report) => print(&report),
        Err(error @ (UnusableInput::Directory(_) | UnusableInput::Empty { .. })) => {
            super::tell(&format!("error: {error}"));
            UNUSABLE
        }
    };
    Ok(ExitCode::from(code))
}

/// Prints the outcome; the exit code that goes with it.
fn print(report: &Report) -> u8 {
    let mut text = verify::tables(&report.summaries);
    text += &format!(
        "\nsettling: state and observation after the steps at rest with which an episode begins. goal: achieved\n\
         goals, and how far the desired goal is from those the task draws. sparse: reward of the sparse variant.\n\
         success, ends: steps at which simulator and recording (rules and simulator) disagree. touched: steps in\n\
         which something came within 2.5 mm of a forearm, whose shape is approximate; they are kept apart. rule: reward computed\n\
         from observations, with the velocity before the step; mean-v: with the mean of the velocities around it.\n\
         known: coordinates that rules fill in. Tolerance {:.0e}; relative {:.0e} where the verdict says so.\n",
        verify::TOLERANCE,
        verify::RELATIVE_TOLERANCE,
    );
    if report.skipped > 0 {
        text += &format!(
            "{} rollouts of other tasks were left out.\n",
            report.skipped
        );
    }
    super::report_to_reader(&text);
    for summary in report.summaries.iter().filter(|s| !s.within_tolerance()) {
        let path = summary.path.display();
        match summary.diverged {
            0 if !summary.is_judged() => super::tell(&format!(
                "error: {path}: no step could be compared: each comes near a forearm, or no state follows it"
            )),
            0 => super::tell(&format!("error: {path}: not reproduced within tolerance")),
            n => super::tell(&format!(
                "error: {path}: the simulation diverged at {n} steps"
            )),
        }
    }
    for failure in &report.failures {
        super::tell(&format!("error: {failure}"));
    }
    if report.passed() { PASSED } else { FAILED }
}
