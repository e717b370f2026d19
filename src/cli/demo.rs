//! `mamf demo`: record demonstrations, describe and replay sets of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use super::{Episodes, FAILED, Misuse, print, report_to_reader, say, signals, tell};
use crate::core::leftovers::Unfinished;
use crate::core::parallel::with_threads;
use crate::core::random::stream;
use crate::env::Inspect;
use crate::recordings::demo::{
    self, Description, EpisodeRecorder, Replayed, STORED_DIFFERENCE, UnusableRecording,
};
use crate::recordings::find;
use crate::recordings::format::Recording;
use crate::run::Checkpoint;
use crate::task::Step;
use crate::training::{EpisodeResult, Evaluator, Watch, saved_policy};

/// Episodes that run between two looks at what became of them, one in each environment.
const AT_ONCE: usize = 2;

/// Arguments of `mamf demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Record episodes of the deterministic policy of a checkpoint
    Record(RecordArgs),
    /// Say what recordings hold, and whether they can serve as demonstrations
    Info(SetArgs),
    /// Step recordings from each of their states, and from the first state through all actions
    Replay(SetArgs),
}

#[derive(Debug, clap::Args)]
struct RecordArgs {
    /// Run directory (its last checkpoint) or checkpoint (for example RUN/checkpoints/best)
    #[arg(long, value_name = "RUN_OR_CHECKPOINT")]
    checkpoint: PathBuf,
    #[command(flatten)]
    which: Episodes,
    /// Directory for episode_0001.npz, episode_0001.json and so on; nothing in it is overwritten
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Debug, clap::Args)]
struct SetArgs {
    /// Directory, searched with its subdirectories, glob (in quotes) or .npz file
    #[arg(value_name = "DIR|GLOB|FILE")]
    pattern: PathBuf,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.command {
        Command::Record(args) => record(args),
        Command::Info(args) => info(&args.pattern),
        Command::Replay(args) => replay(&args.pattern),
    }
}

/// Keeps the recording of each episode.
pub(super) struct Camera {
    pub source: String,
}

impl Watch for Camera {
    type Seen = EpisodeRecorder;

    fn begin(&self, env: &dyn Inspect, observation: &[f64]) -> EpisodeRecorder {
        EpisodeRecorder::begin(env, observation, &self.source)
    }

    fn step(
        &self,
        seen: &mut EpisodeRecorder,
        env: &dyn Inspect,
        action: &[f64],
        step: &Step,
        observation: &[f64],
    ) {
        seen.step(env, action, step, observation);
    }
}

fn record(args: &RecordArgs) -> anyhow::Result<ExitCode> {
    let checkpoint = Checkpoint::load(&args.checkpoint)?;
    let config = &checkpoint.config;
    if config.doubled_actions.is_some() {
        let path = args.checkpoint.display();
        let text = format!(
            "--checkpoint {path}: its actions are doubled; recordings hold those of the task itself"
        );
        return Err(Misuse(text).into());
    }
    // The stream of `mamf eval`, so that both run the same episodes.
    let mut evaluator = Evaluator::new(config, stream(args.which.seed, "eval"))?;
    let policy = saved_policy(&checkpoint, evaluator.spec())?;
    let episodes = args.which.episodes as usize;
    signals::leave_nothing_behind()?;
    let folder = make_room(&args.out, episodes)?;

    let (method, step) = (config.method.name(), checkpoint.step);
    let version = env!("CARGO_PKG_VERSION");
    let camera = Camera {
        source: format!("mamf {version}, {method} after {step} steps"),
    };
    say(&format!("{}, {method} after {step} steps", config.task));
    // Each goes with the process until all are there: half a set would be in the way of the whole one.
    let mut saved: Vec<Unfinished> = folder.into_iter().collect();
    let diverged = with_threads(config.compute.threads, || -> anyhow::Result<usize> {
        let mut diverged = 0;
        for first in (0..episodes).step_by(AT_ONCE) {
            let count = AT_ONCE.min(episodes - first);
            let recorded = evaluator.evaluate_watched(&policy, count, &camera);
            for (episode, (result, recorder)) in (first..).zip(recorded) {
                if result.diverged {
                    diverged += 1;
                } else {
                    let stem = stem(&args.out, episode);
                    saved.extend(recorder.save(&stem, args.which.seed, episode)?);
                }
                say(&line(episode, &result));
            }
        }
        Ok(diverged)
    })?;
    let diverged = diverged.inspect_err(|_| {
        saved.drain(..).rev().for_each(Unfinished::remove);
    })?;
    drop(saved);
    let (written, out) = (episodes - diverged, args.out.display());
    say(&format!("{written} of {episodes} episodes recorded: {out}"));
    Ok(ExitCode::SUCCESS)
}

/// Makes the directory `out` unless it is there; a recording that is there already is in the way.
fn make_room(out: &Path, episodes: usize) -> Result<Option<Unfinished>, Misuse> {
    for stem in (0..episodes).map(|episode| stem(out, episode)) {
        for path in ["npz", "json"].map(|ending| stem.with_extension(ending)) {
            // A link that leads nowhere is in the way as well.
            if path.symlink_metadata().is_ok() {
                let path = path.display();
                let text = format!("--out: {path} exists already and is not overwritten");
                return Err(Misuse(text));
            }
        }
    }
    if out.is_dir() {
        return Ok(None);
    }
    let made = Unfinished::making(|| fs::create_dir_all(out), |()| out.to_owned());
    let made = made.map_err(|error| Misuse(format!("--out {}: {error}", out.display())))?;
    Ok(Some(made.1))
}

/// The files of episode number `episode`, which counts from 0, without their endings.
fn stem(out: &Path, episode: usize) -> PathBuf {
    out.join(name(episode))
}

fn name(episode: usize) -> String {
    format!("episode_{:04}", episode + 1)
}

fn line(episode: usize, result: &EpisodeResult) -> String {
    let (name, length) = (name(episode), result.length);
    if result.diverged {
        return format!("{name}  not written: the simulation diverged after {length} steps");
    }
    let success = match result.success {
        Some(true) => "  success",
        Some(false) => "  no success",
        None => "",
    };
    let episode_return = result.episode_return;
    format!("{name}  return {episode_return:.2}  length {length}{success}")
}

fn info(pattern: &Path) -> anyhow::Result<ExitCode> {
    let (found, code) = each(pattern, demo::describe)?;
    if !found.is_empty() {
        print(&description(&found))?;
    }
    Ok(code)
}

fn description(found: &[Description]) -> String {
    let (recordings, totals) = (demo::descriptions(found), demo::totals(found));
    format!(
        "{recordings}\n{totals}\n\
         success: steps in which the goal was reached, and whether it was in the last one. states: recorded rows; in the\n\
         totals those that precede an action. warm start, next, goal: what else is recorded. demonstration, usable:\n\
         whether training can begin in the states (demonstrations.path).\n"
    )
}

fn replay(pattern: &Path) -> anyhow::Result<ExitCode> {
    let (found, code) = each(pattern, |path| demo::replay(&Recording::open(path)?))?;
    if !found.is_empty() {
        report_to_reader(&comparison(&found));
    }
    Ok(code)
}

fn comparison(found: &[Replayed]) -> String {
    let tables = demo::tables(found);
    format!(
        "{tables}\
         qpos, qvel: largest error after one step from each recorded state, over the steps compared, target bodies left\n\
         out. touched: steps in which something came within 2.5 mm of the forearm, whose shape is approximate; they are kept\n\
         apart, there: largest qpos error in them. next: against the step recorded beside the states. reward: against the recorded one;\n\
         stored: against reward_recorded, which differ: steps past {STORED_DIFFERENCE:.0e}, capped: with the spin term 8 at most, the\n\
         rule of the stored ones. success: flags that differ. open-loop: largest qpos error from the first state through\n\
         all actions. drift: steps until it exceeds {drift:.0e}. untouched: the same error before the forearm is first touched.\n",
        drift = demo::DRIFT
    )
}

/// What `look` finds in each recording that `pattern` means, and the exit code: a failure if one of
/// them cannot be used, of which the user is told.
///
/// # Errors
/// If there is no recording.
fn each<T>(
    pattern: &Path,
    look: impl Fn(&Path) -> Result<T, UnusableRecording>,
) -> anyhow::Result<(Vec<T>, ExitCode)> {
    let files = find(pattern).map_err(|error| Misuse(error.to_string()))?;
    let mut found = Vec::new();
    let mut code = ExitCode::SUCCESS;
    for file in &files {
        match look(file) {
            Ok(item) => found.push(item),
            Err(error) => {
                tell(&format!("error: {error}"));
                code = ExitCode::from(FAILED);
            }
        }
    }
    Ok((found, code))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_episode_has_a_line() {
        let mut result = EpisodeResult {
            episode_return: 1.5,
            length: 75,
            diverged: false,
            buffers_full: 0,
            success: None,
        };
        assert_eq!(line(0, &result), "episode_0001  return 1.50  length 75");
        result.success = Some(true);
        assert!(line(11, &result).ends_with("length 75  success"));
        result.diverged = true;
        let text = line(11, &result);
        assert!(text.starts_with("episode_0012  not written") && text.contains("diverged"));
    }
}
