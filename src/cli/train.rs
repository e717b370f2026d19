//! `mamf train`

use super::progress::Progress;
use super::{INTERRUPTED, tell};
use crate::config::{self, Overrides};
use crate::training::{self, Outcome, RunDirectory, Trainer};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Arguments of `mamf train`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration of the run, for example configs/quickstart.toml
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Override a setting, for example --set imagination.target_filter=false --set method=td3
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of every random stream
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u32>,
    /// Environment steps of the run
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    steps: Option<u32>,
    /// Run directory [default: runs/<task>/<method>/seed-<n>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Threads; results do not depend on it
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    threads: Option<u32>,
    /// Remove an existing run in the run directory first
    #[arg(long)]
    force: bool,
}

/// Trains to the end, or until the first interrupt, which saves a checkpoint; a second one ends
/// the process at once.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut overrides = Overrides::default();
    for set in &args.set {
        overrides.set(set)?;
    }
    for (option, key, value) in [
        ("--seed", "seed", args.seed),
        ("--steps", "steps", args.steps),
        ("--threads", "compute.threads", args.threads),
    ] {
        if let Some(value) = value {
            overrides.push(format!("{option} {value}"), key, i64::from(value));
        }
    }
    let config = config::read(&args.config, &overrides)?;
    let path = args
        .out
        .clone()
        .unwrap_or_else(|| RunDirectory::default_path(&config));
    // First, so that a wrong path leaves no run directory behind.
    let demonstrations = training::demonstrations(&config)?;
    let directory = RunDirectory::create(&path, args.force)?;

    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal finds the flag unset and only sets it.
        flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&stop))?;
        flag::register(signal, Arc::clone(&stop))?;
    }

    let mut progress = Progress::new(&config);
    let outcome = Trainer::new(config, demonstrations, directory)?.run(&mut progress, &stop);
    progress.finish();
    match outcome? {
        Outcome::Finished => {
            writeln!(std::io::stdout(), "finished: {}", path.display())?;
            Ok(ExitCode::SUCCESS)
        }
        Outcome::Interrupted(step) => {
            let checkpoint = path.join("checkpoints").join("last");
            let saved = checkpoint.display();
            tell(&format!("interrupted after step {step}; saved {saved}"));
            Ok(ExitCode::from(INTERRUPTED))
        }
    }
}
