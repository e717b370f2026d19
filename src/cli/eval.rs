//! `mamf eval`

use super::acting::Acting;
use super::{Episodes, Misuse, print, report_to_reader, signals};
use crate::core::files::NewFile;
use crate::core::parallel::with_threads;
use crate::core::random::stream;
use crate::core::table::{Column, Table};
use crate::env;
use crate::run::Checkpoint;
use crate::training::{Evaluation, Evaluator};
use anyhow::Context;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `mamf eval`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Run directory (its last checkpoint) or checkpoint (for example RUN/checkpoints/best)
    #[arg(
        long,
        value_name = "RUN_OR_CHECKPOINT",
        required_unless_present = "planner"
    )]
    checkpoint: Option<PathBuf>,
    /// Evaluate the planner of the section [planner] of this configuration instead of the policy, with what the
    /// checkpoint has learned, if there is one
    #[arg(long, value_name = "FILE")]
    planner: Option<PathBuf>,
    #[command(flatten)]
    which: Episodes,
    /// Write one row an episode to this new file
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Refuse a checkpoint of another task than this; without a checkpoint, the task to plan in
    #[arg(long, value_name = "ID")]
    task: Option<String>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let checkpoint = args
        .checkpoint
        .as_deref()
        .map(Checkpoint::load)
        .transpose()?;
    if let Some(task) = &args.task {
        env::info(task)?;
        if let Some(checkpoint) = &checkpoint {
            checkpoint.require_task(task)?;
        }
    }
    let acting = Acting::of(args.planner.as_deref(), checkpoint, args.task.as_deref())?;
    let mut evaluator = Evaluator::new(&acting.config, stream(args.which.seed, "eval"))?;
    if args.csv.is_some() {
        signals::leave_nothing_behind()?;
    }
    // Long before it is written, what would be in the way.
    args.csv.as_deref().map(create).transpose()?;

    let threads = acting.config.compute.threads;
    let episodes = args.which.episodes as usize;
    let controller = acting.controller.another();
    let evaluation = with_threads(threads, move || {
        evaluator.evaluate(controller.as_ref(), episodes)
    })?;

    let text = in_words(&acting, &evaluation);
    match &args.csv {
        None => print(&text)?,
        Some(path) => {
            let written = write(create(path)?, &evaluation);
            written.with_context(|| format!("--csv {}: can't be written", path.display()))?;
            report_to_reader(&text);
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn in_words(acting: &Acting, e: &Evaluation) -> String {
    let mut table = Table::new([Column::words(""), Column::words("")]);
    let mut row = |what: &str, text: String| table.row([what.to_owned(), text]);
    row("episodes", e.episodes.len().to_string());
    row(
        "return",
        format!("{:.2} +- {:.2}", e.return_mean(), e.return_std()),
    );
    row(
        "range",
        format!("{:.2} to {:.2}", e.return_min(), e.return_max()),
    );
    row("length", format!("{:.1}", e.length_mean()));
    if let Some(rate) = e.success_rate() {
        row("success", format!("{:.1} %", 100.0 * rate));
    }
    if e.diverged() > 0 {
        row("diverged", e.diverged().to_string());
    }
    if e.buffers_full() > 0 {
        row("buffers full", format!("in {} steps", e.buffers_full()));
    }
    format!("{}, {}\n{table}", acting.config.task, acting.name)
}

/// Begins the table of episodes, but never over an existing file.
fn create(path: &Path) -> Result<NewFile, Misuse> {
    NewFile::create(path.to_owned()).map_err(|error| {
        let shown = path.display();
        Misuse(match error.kind() {
            ErrorKind::AlreadyExists => {
                format!("--csv {shown}: exists already; it must be a new file")
            }
            _ => format!("--csv {shown}: {error}"),
        })
    })
}

fn write(file: NewFile, evaluation: &Evaluation) -> anyhow::Result<()> {
    let mut writer = csv::Writer::from_path(file.temporary())?;
    writer.write_record(["episode", "return", "length", "diverged", "success"])?;
    for (i, e) in evaluation.episodes.iter().enumerate() {
        writer.serialize((i, e.episode_return, e.length, e.diverged, e.success))?;
    }
    writer.flush()?;
    drop(writer);
    Ok(file.keep()?)
}
