//! `mamf eval`

use super::{Episodes, Misuse};
use crate::core::parallel::with_threads;
use crate::core::random::stream;
use crate::core::table::{Column, Table};
use crate::env;
use crate::run::Checkpoint;
use crate::training::{Evaluation, Evaluator, saved_policy};
use anyhow::Context;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `mamf eval`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    which: Episodes,
    /// Write one row an episode to this new file
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Refuse a checkpoint of another task than this
    #[arg(long, value_name = "ID")]
    task: Option<String>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let checkpoint = Checkpoint::load(&args.which.checkpoint)?;
    if let Some(task) = &args.task {
        env::info(task)?;
        checkpoint.require_task(task)?;
    }
    let mut evaluator = Evaluator::new(&checkpoint.config, stream(args.which.seed, "eval"))?;
    let policy = saved_policy(&checkpoint, evaluator.spec())?;
    let csv = args.csv.as_deref().map(create).transpose()?;

    let threads = checkpoint.config.compute.threads;
    let episodes = args.which.episodes as usize;
    let evaluation = with_threads(threads, || evaluator.evaluate(&policy, episodes))?;

    report(&checkpoint, &evaluation)?;
    if let (Some(writer), Some(path)) = (csv, &args.csv) {
        write(writer, &evaluation).with_context(|| format!("{}: can't write", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn report(checkpoint: &Checkpoint, e: &Evaluation) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    let (task, method) = (&checkpoint.config.task, checkpoint.config.method.name());
    writeln!(out, "{task}, {method} after {} steps", checkpoint.step)?;
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
    write!(out, "{table}")
}

/// Creates the table of episodes, but never over an existing file.
fn create(path: &Path) -> anyhow::Result<csv::Writer<File>> {
    match File::create_new(path) {
        Ok(file) => Ok(csv::Writer::from_writer(file)),
        Err(error) => Err(Misuse(format!(
            "--csv {}: {error}; it must be a new file",
            path.display()
        ))
        .into()),
    }
}

fn write(mut writer: csv::Writer<File>, evaluation: &Evaluation) -> Result<(), csv::Error> {
    writer.write_record(["episode", "return", "length", "diverged", "success"])?;
    for (i, e) in evaluation.episodes.iter().enumerate() {
        writer.serialize((i, e.episode_return, e.length, e.diverged, e.success))?;
    }
    Ok(writer.flush()?)
}
