//! `mamf plan`

use super::acting::name;
use super::demo::Camera;
use super::{FAILED, Misuse, number, say, setting, tell, whole};
use crate::config::{self, Config, Overrides};
use crate::core::parallel::with_threads;
use crate::core::random::stream;
use crate::env::{self, Inspect};
use crate::planning::{PlannerSettings, Worthwhile};
use crate::recordings::demo::EpisodeRecorder;
use crate::run::Checkpoint;
use crate::task::Step;
use crate::training::{self, EpisodeResult, Evaluator, Plan, PlanRow, Watch};
use indicatif::ProgressBar;
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Arguments of `mamf plan`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Id of the task
    #[arg(long, value_name = "ID", required_unless_present = "config")]
    task: Option<String>,
    /// Configuration with the section [planner], and the task unless --task gives it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Override a setting, for example --set planner.horizon=30
    #[arg(long, value_name = "KEY=VALUE", value_parser = setting())]
    set: Vec<String>,
    /// Run or checkpoint whose policy makes some of the sequences, and whose critics say what comes after them
    #[arg(long, value_name = "RUN_OR_CHECKPOINT")]
    checkpoint: Option<PathBuf>,
    /// Episodes to be planned, whether they are kept or not
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    episodes: u32,
    /// Directory for episode_0001.npz, episode_0001.json and so on, and plan.csv with what became of each
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Keep only episodes that end in "success", or whose "return > NUMBER"
    #[arg(long, value_name = "CONDITION")]
    keep: Option<Keep>,
    /// Go on with the episodes that are missing in --out, under the same settings
    #[arg(long)]
    resume: bool,
    /// Seed of the initial states and of the planner
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 0, value_parser = whole())]
    seed: u64,
    /// Threads; results do not depend on it
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole())]
    threads: Option<u64>,
}

/// Which episodes are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Keep {
    /// Those whose last step is a success.
    Success,
    /// Those with a higher return.
    Above(f64),
}

impl fmt::Display for Keep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Keep::Success => f.write_str("success"),
            Keep::Above(least) => write!(f, "return > {least}"),
        }
    }
}

impl FromStr for Keep {
    type Err = String;

    fn from_str(text: &str) -> Result<Keep, String> {
        let wrong = || "it must be \"success\" or \"return > NUMBER\"".to_owned();
        if text.trim() == "success" {
            return Ok(Keep::Success);
        }
        let (what, number) = text.split_once('>').ok_or_else(wrong)?;
        let number: f64 = number.trim().parse().map_err(|_| wrong())?;
        match what.trim() == "return" && number.is_finite() {
            true => Ok(Keep::Above(number)),
            false => Err(wrong()),
        }
    }
}

impl Keep {
    fn admits(self, result: &EpisodeResult) -> bool {
        match self {
            Keep::Success => result.success == Some(true),
            Keep::Above(least) => result.episode_return > least,
        }
    }
}

/// Records an episode and shows how far it is.
struct Watcher {
    camera: Camera,
    bar: ProgressBar,
    settings: PlannerSettings,
}

/// The recording of an episode, and its rewards so far.
struct Seen {
    recorder: EpisodeRecorder,
    worthwhile: Worthwhile,
}

impl Watch for Watcher {
    type Seen = Seen;

    fn begin(&self, env: &dyn Inspect, observation: &[f64]) -> Seen {
        Seen {
            recorder: self.camera.begin(env, observation),
            worthwhile: Worthwhile::new(&self.settings),
        }
    }

    fn step(
        &self,
        seen: &mut Seen,
        env: &dyn Inspect,
        action: &[f64],
        step: &Step,
        observation: &[f64],
    ) {
        self.camera
            .step(&mut seen.recorder, env, action, step, observation);
        seen.worthwhile.see(step);
        self.bar.inc(1);
        let so_far = seen.worthwhile.episode_return();
        self.bar.set_message(format!("return so far {so_far:.1}"));
    }

    fn ends(&self, seen: &Seen, step: &Step) -> bool {
        seen.worthwhile.is_over(step)
    }
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config = settings(args)?;
    let env = training::make_env(&config)?;
    if args.keep == Some(Keep::Success) && env.spec().goal_size == 0 {
        let text = format!("--keep success: {} knows no success", config.task);
        return Err(Misuse(text).into());
    }
    let mut planner = training::planner(&config)?;
    let mut source = format!(
        "mamf {}, planned ({})",
        env!("CARGO_PKG_VERSION"),
        config.planner.method.name()
    );
    let mut learned = String::new();
    if let Some(path) = &args.checkpoint {
        let checkpoint = Checkpoint::load(path)?;
        checkpoint.require_task(&config.task)?;
        let [then, now] = [&checkpoint.config, &config].map(|config| config.action_coupling);
        if then != now {
            let text = format!(
                "action_coupling = {now}: the policy of --checkpoint was trained with {then}; --set action_coupling={then}"
            );
            return Err(Misuse(text).into());
        }
        planner = training::taught_planner(&config, &checkpoint)?;
        learned = format!(", {}", name(&checkpoint));
        source += &format!(" with {}", name(&checkpoint));
    }
    let mut evaluator = Evaluator::new(&config, stream(args.seed, "eval"))?;
    let (episodes, seed) = (args.episodes as usize, args.seed);
    let mut said = format!("# seed = {seed}\n");
    if let Some(path) = &args.checkpoint {
        said += &format!("# checkpoint = {path:?}{learned}\n");
    }
    if let Some(keep) = args.keep {
        said += &format!("# keep = {keep}\n");
    }
    let mut plan = Plan::open(&args.out, &config, &said, args.resume)?;
    let begun = plan.rows().len();
    if begun > 0 {
        tell(&format!("note: {begun} episodes are planned already"));
    }
    evaluator.skip(begun);

    let steps = env.spec().max_episode_steps;
    let bar = super::progress::bar("steps");
    bar.set_length((episodes.saturating_sub(begun) * steps) as u64);
    let watcher = Watcher {
        camera: Camera { source },
        bar,
        settings: config.planner.clone(),
    };
    let keep = args.keep;
    with_threads(
        config.compute.threads,
        move || -> anyhow::Result<ExitCode> {
            for episode in begun..episodes {
                let (clock, before) = (Instant::now(), planner.simulated());
                let mut planned = evaluator.evaluate_watched(&planner, 1, &watcher);
                let (result, seen) = planned.pop().expect("one episode");
                let kept = !result.diverged && keep.is_none_or(|keep| keep.admits(&result));
                if kept {
                    let stem = plan.stem(episode);
                    seen.recorder.save(&stem, seed, episode)?;
                }
                let row = PlanRow {
                    episode: episode + 1,
                    episode_return: result.episode_return,
                    length: result.length,
                    success: result.success,
                    kept,
                    seconds: clock.elapsed().as_secs_f64(),
                    simulated: planner.simulated() - before,
                };
                plan.add(row)?;
                watcher.bar.suspend(|| say(&line(&row)));
            }
            watcher.bar.finish_and_clear();
            Ok(report(&plan))
        },
    )?
}

/// The settings: those of the file, if there is one, and the options.
fn settings(args: &Args) -> anyhow::Result<Config> {
    let mut overrides = Overrides::default();
    for set in &args.set {
        overrides.set(set)?;
    }
    if let Some(task) = &args.task {
        env::info(task)?;
        overrides.push(format!("--task {task}"), "task", task.clone());
    }
    if let Some(threads) = args.threads {
        let text = format!("--threads {threads}");
        overrides.push(text, "compute.threads", threads as i64);
    }
    let config = match &args.config {
        Some(path) => config::read(path, &overrides)?,
        None => config::parse("", "the options".as_ref(), &overrides)?,
    };
    if config.doubled_actions.is_some() {
        let text = "doubled_actions.period: recordings hold the actions of the task itself";
        return Err(Misuse(text.to_owned()).into());
    }
    Ok(config)
}

fn line(row: &PlanRow) -> String {
    let success = match row.success {
        Some(true) => "  success",
        Some(false) => "  no success",
        None => "",
    };
    let kept = if row.kept { "" } else { "  thrown away" };
    let time = humantime::format_duration(Duration::from_secs(row.seconds as u64));
    format!(
        "episode_{:04}  return {:.2}  length {}{success}  {time}, {} simulated steps/s{kept}",
        row.episode,
        row.episode_return,
        row.length,
        number(row.simulated as f64 / row.seconds.max(1e-3)),
    )
}

/// Says what there is; that nothing was kept is a failure.
fn report(plan: &Plan) -> ExitCode {
    let kept = plan.rows().iter().filter(|row| row.kept).count();
    let episodes = plan.rows().len();
    let thrown = episodes - kept;
    let out = plan.path().display();
    say(&format!(
        "{kept} of {episodes} episodes kept, {thrown} thrown away: {out}"
    ));
    if kept == 0 {
        tell(&format!("error: {out}: no episode was worth keeping"));
        return ExitCode::from(FAILED);
    }
    ExitCode::SUCCESS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_are_read_and_told_apart() {
        assert_eq!("success".parse(), Ok(Keep::Success));
        assert_eq!("return > 500".parse(), Ok(Keep::Above(500.0)));
        assert_eq!(" return>-1.5 ".parse(), Ok(Keep::Above(-1.5)));
        for wrong in [
            "",
            "return",
            "return < 5",
            "length > 3",
            "return > x",
            "return > inf",
        ] {
            assert!(wrong.parse::<Keep>().is_err(), "{wrong}");
        }
        let mut result = EpisodeResult {
            episode_return: 500.0,
            length: 75,
            diverged: false,
            buffers_full: 0,
            success: Some(true),
        };
        assert!(Keep::Success.admits(&result) && !Keep::Above(500.0).admits(&result));
        result.success = None;
        assert!(!Keep::Success.admits(&result) && Keep::Above(499.0).admits(&result));
    }
}
