//! `mamf train`

use super::progress::Progress;
use super::{FAILED, INTERRUPTED, Misuse, say, setting, signals, tell, whole};
use crate::config::{self, Overrides};
use crate::run::{LockError, ReplayMemory, RunDirectory, RunDirectoryError};
use crate::training::{self, Monitor, Outcome, ResumeOptions, Resumed, TrainError, Trainer};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

/// Arguments of `mamf train`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration of the run, for example configs/quickstart.toml
    #[arg(long, value_name = "FILE", required_unless_present = "resume")]
    config: Option<PathBuf>,
    /// Go on with the run in this directory exactly where its last checkpoint was saved
    #[arg(long, value_name = "RUN_DIR", conflicts_with_all = ["config", "set", "seed", "out"])]
    resume: Option<PathBuf>,
    /// Override a setting, for example --set imagination.target_filter=false --set method=td3
    #[arg(long, value_name = "KEY=VALUE", value_parser = setting())]
    set: Vec<String>,
    /// Seed of every random stream
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole())]
    seed: Option<u64>,
    /// Environment steps of the run; with --resume it may be made longer or shorter
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole())]
    steps: Option<u64>,
    /// Run directory [default: runs/<task>/<method>/seed-<n>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Threads; results do not depend on it
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole())]
    threads: Option<u64>,
    /// Remove an existing run in the run directory first; with --resume, go on with another build of
    /// mamf or other settings of checkpoints
    #[arg(long)]
    force: bool,
}

/// Trains to the end, or until the first signal, which saves a checkpoint; a second interrupt ends the
/// process at once.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    // First, so that a signal that comes early is not lost.
    let stop = signals::stop_and_save(true)?;
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
            overrides.push(format!("{option} {value}"), key, value as i64);
        }
    }
    let mut progress = Progress::new();
    let trainer = match (&args.resume, &args.config) {
        (Some(path), _) => match resume(path, overrides, args.force, &mut progress)? {
            Resumed::Run(trainer) => {
                // A run that began with videos is worth going on without.
                if let Err(error) = training::check_video(trainer.config()) {
                    tell(&format!("note: no videos: {error}"));
                }
                *trainer
            }
            Resumed::Finished(steps) => {
                let path = path.display();
                say(&format!("finished already, {steps} steps: {path}"));
                return Ok(ExitCode::SUCCESS);
            }
        },
        (None, Some(config)) => {
            let out = args.out.as_deref();
            begin(config, &overrides, out, args.force, &mut progress)?
        }
        (None, None) => unreachable!("one of both is required"),
    };
    finish(trainer, &mut progress, &stop)
}

fn begin(
    file: &Path,
    overrides: &Overrides,
    out: Option<&Path>,
    force: bool,
    progress: &mut Progress,
) -> anyhow::Result<Trainer> {
    let config = config::read(file, overrides)?;
    let path = out.map_or_else(|| RunDirectory::default_path(&config), Path::to_owned);
    let from = &config.networks.from;
    if !from.is_empty() && lies_in(from.as_ref(), &path) {
        let out = path.display();
        let text = format!(
            "networks.from = {from:?}: lies in {out}, where this run would go; choose another --out"
        );
        return Err(Misuse(text).into());
    }
    let env = training::make_env(&config)?;
    let demonstrations = training::demonstrations(&config, env.spec())?;
    let memory = ReplayMemory::of(&config, env.spec());
    memory.check().map_err(TrainError::from)?;
    training::check_video(&config)?;
    let directory = || {
        let directory = RunDirectory::create(&path, force)?;
        progress.memory(&memory);
        Ok(directory)
    };
    Ok(Trainer::new(config, env, demonstrations, directory)?)
}

/// Whether `path` is `folder` or something in it; not where either is not there.
fn lies_in(path: &Path, folder: &Path) -> bool {
    match (path.canonicalize(), folder.canonicalize()) {
        (Ok(path), Ok(folder)) => path.starts_with(folder),
        _ => false,
    }
}

fn resume(
    path: &Path,
    overrides: Overrides,
    force: bool,
    progress: &mut Progress,
) -> anyhow::Result<Resumed> {
    let directory = match RunDirectory::open(path) {
        // Nothing need be written to a finished run.
        Err(error @ RunDirectoryError::Locked(LockError::File(_))) => {
            let finished = Trainer::finished(path, &overrides);
            return finished.map(Resumed::Finished).ok_or(error.into());
        }
        directory => directory?,
    };
    if let Some(process) = directory.left_by() {
        tell(&format!(
            "note: process {process} left the run without ending it"
        ));
    }
    let options = ResumeOptions { overrides, force };
    Ok(Trainer::resume(directory, &options, progress)?)
}

/// Runs to the end, or until `stop`.
fn finish(
    trainer: Trainer,
    progress: &mut Progress,
    stop: &AtomicBool,
) -> anyhow::Result<ExitCode> {
    progress.begin(trainer.config(), trainer.step());
    let path = trainer.path().to_owned();
    let resumable = trainer.config().checkpoint.replay;
    let outcome = trainer.run(progress, stop);
    progress.finish();
    match outcome? {
        Outcome::Finished => {
            say(&format!("finished: {}", path.display()));
            Ok(ExitCode::SUCCESS)
        }
        Outcome::Interrupted(step) => {
            let checkpoint = path.join("checkpoints").join("last");
            let saved = checkpoint.display();
            let (next, code) = if resumable {
                ("go on with --resume", INTERRUPTED)
            } else {
                let reason = "it can be evaluated, but not resumed (checkpoint.replay = false)";
                (reason, FAILED)
            };
            tell(&format!(
                "interrupted after step {step}; saved {saved}; {next}"
            ));
            Ok(ExitCode::from(code))
        }
    }
}
