//! `mamf render`

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use rand::SeedableRng;

use super::acting::Acting;
use super::progress::bar;
use super::{Misuse, say, signals};
use crate::agent::{Controller, Moment, RandomActions, Zero};
use crate::core::parallel::with_threads;
use crate::core::random::{Stream, stream};
use crate::env::{self, Inspect};
use crate::recordings::demo;
use crate::recordings::format::{Recording, Rows};
use crate::render::{
    self, Film, Format, LARGEST_SIDE, Painter, Playback, Shot, available, develop,
};
use crate::run::Checkpoint;
use crate::task::{Spec, Start};
use crate::training::{Camera, Evaluator};

/// Episodes that run between two looks at them, one in each environment.
const AT_ONCE: usize = 2;
/// Most and least times as fast as the simulation.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// Arguments of `mamf render`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true))]
pub struct Args {
    /// Draw the deterministic policy of a run (its last checkpoint) or checkpoint
    #[arg(long, value_name = "RUN_OR_CHECKPOINT", group = "what")]
    checkpoint: Option<PathBuf>,
    /// Draw this task under the actions of --actions
    #[arg(long, value_name = "ID", group = "what")]
    task: Option<String>,
    /// Draw the states of a recording
    #[arg(long, value_name = "FILE.npz", group = "what", conflicts_with_all = ["episodes", "seed"])]
    demonstration: Option<PathBuf>,
    /// Draw the planner of the section [planner] of this configuration in the task, with what the checkpoint has learned, if
    /// there is one
    #[arg(long, value_name = "FILE", conflicts_with_all = ["demonstration", "actions"])]
    planner: Option<PathBuf>,
    /// Actions of --task
    #[arg(long, value_enum, default_value_t = Actions::Zero, conflicts_with_all = ["checkpoint", "demonstration"])]
    actions: Actions,
    /// New file: .png, .gif or .mp4 (by ffmpeg), or a directory (ending in / or existing) for frame_00001.png
    /// and so on
    #[arg(long, value_name = "FILE|DIR/")]
    out: PathBuf,
    /// Episodes, one after the other
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    episodes: u32,
    /// Seed of the initial states (of `mamf eval`) and of random actions
    #[arg(
        long,
        value_name = "N",
        allow_negative_numbers = true,
        default_value_t = 0
    )]
    seed: u64,
    /// Control steps of each episode at most [default: all; none of a .png file, which shows the last state]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    steps: Option<u32>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    size: [usize; 2],
    /// A picture every N control steps [default: as many as give 30 or fewer a second of playback]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    every: Option<u32>,
    /// Camera of the task's scene [default: its first one]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// How many times as fast as the simulated time it is played
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, default_value_t = 1.0, value_parser = speed)]
    speed: f64,
}

/// What a task is drawn under.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Actions {
    /// Zero actions
    Zero,
    /// Uniformly random actions
    Random,
}

impl Actions {
    /// What takes them in the task `spec`.
    fn controller(self, spec: &Spec) -> Box<dyn Controller> {
        match self {
            Actions::Zero => Box::new(Zero),
            Actions::Random => Box::new(RandomActions::within(&spec.action_ranges)),
        }
    }
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let format = Format::of(&args.out)?;
    if format == Format::Png && args.episodes > 1 {
        let (out, episodes) = (args.out.display(), args.episodes);
        let text = format!(
            "--episodes {episodes}: {out} holds one picture; choose a .gif file or a directory"
        );
        return Err(Misuse(text).into());
    }
    let mut source = Source::open(args)?;
    available()?;
    let spec = source.spec();
    let mut painter = Painter::new(spec, args.size, args.camera.as_deref())?;
    let every = args.every.map(|every| every as usize);
    let mut playback = Playback::new(spec.dt, args.speed, every, format.ticks());
    // Before there is a file to leave behind.
    signals::leave_nothing_behind()?;
    let mut encoder = render::create(&args.out, format, args.size, playback.interval())?;

    let limit = match (args.steps, format) {
        (Some(steps), _) => steps as usize,
        (None, Format::Png) => 0,
        (None, _) => usize::MAX,
    };
    let progress = bar("pictures");
    let mut pictures = 0u64;
    while let Some(films) = source.films(limit)? {
        for mut film in films {
            if format == Format::Png {
                film.cut_to_last();
            }
            progress.inc_length(playback.clone().cuts(film.shots().len()).len() as u64);
            let go_on = || {
                pictures += 1;
                progress.inc(1);
                true
            };
            develop(&film, &mut playback, &mut painter, encoder.as_mut(), go_on)?;
        }
    }
    encoder.finish()?;
    progress.finish_and_clear();
    let out = args.out.display();
    say(&match format {
        Format::Png => format!("{out}: 1 picture"),
        Format::Frames => format!("{out}: {}", counted(pictures)),
        Format::Gif => format!("{out}: {}, {:.2} s", counted(pictures), playback.elapsed()),
        Format::Mp4 => {
            // All of its pictures stand equally long.
            let seconds = pictures as f64 * playback.interval();
            format!("{out}: {}, {seconds:.2} s", counted(pictures))
        }
    });
    Ok(ExitCode::SUCCESS)
}

fn counted(pictures: u64) -> String {
    match pictures {
        1 => "1 picture".to_owned(),
        n => format!("{n} pictures"),
    }
}

/// Where episodes come from.
enum Source {
    Acting {
        acting: Box<Acting>,
        evaluator: Box<Evaluator>,
        left: usize,
    },
    Task {
        env: Box<dyn Inspect>,
        actions: Actions,
        starts: Stream,
        noise: Stream,
        left: usize,
    },
    Recorded {
        env: Box<dyn Inspect>,
        recording: Option<Box<Recording>>,
    },
}

impl Source {
    fn open(args: &Args) -> anyhow::Result<Source> {
        let left = args.episodes as usize;
        // The stream of `mamf eval`, so that both run the same episodes.
        let starts = stream(args.seed, "eval");
        if args.checkpoint.is_some() || args.planner.is_some() {
            let checkpoint = args.checkpoint.as_deref().map(Checkpoint::load);
            let planner = args.planner.as_deref();
            let acting = Acting::of(planner, checkpoint.transpose()?, args.task.as_deref())?;
            return Ok(Source::Acting {
                evaluator: Box::new(Evaluator::new(&acting.config, starts)?),
                acting: Box::new(acting),
                left,
            });
        }
        if let Some(path) = &args.demonstration {
            return Source::recorded(path);
        }
        // The command line has one of the three.
        let id = args.task.as_deref().unwrap_or_default();
        Ok(Source::Task {
            env: env::make_inspect(id)?,
            actions: args.actions,
            starts,
            noise: stream(args.seed, "actions"),
            left,
        })
    }

    fn recorded(path: &Path) -> anyhow::Result<Source> {
        let recording = Recording::open(path)?;
        let env = demo::task_of(&recording)?;
        Ok(Source::Recorded {
            env,
            recording: Some(Box::new(recording)),
        })
    }

    fn spec(&self) -> &Spec {
        match self {
            Source::Acting { evaluator, .. } => evaluator.spec(),
            Source::Task { env, .. } | Source::Recorded { env, .. } => env.spec(),
        }
    }

    /// The next episodes, of at most `limit` steps each; `None` when there are no more.
    fn films(&mut self, limit: usize) -> anyhow::Result<Option<Vec<Film>>> {
        Ok(match self {
            Source::Acting {
                acting,
                evaluator,
                left,
            } => {
                let count = AT_ONCE.min(*left);
                *left -= count;
                if count == 0 {
                    return Ok(None);
                }
                let threads = acting.config.compute.threads;
                let camera = Camera { limit };
                let controller = acting.controller.another();
                let seen = with_threads(threads, move || {
                    evaluator.evaluate_watched(controller.as_ref(), count, &camera)
                })?;
                Some(seen.into_iter().map(|(_, film)| film).collect())
            }
            Source::Task {
                env,
                actions,
                starts,
                noise,
                left,
            } => {
                if *left == 0 {
                    return Ok(None);
                }
                *left -= 1;
                let start = Stream::from_rng(starts);
                let mut controller = actions.controller(env.spec());
                let film = play(env.as_mut(), controller.as_mut(), start, noise, limit);
                Some(vec![film])
            }
            Source::Recorded { env, recording } => recording
                .take()
                .map(|recording| recorded(env.as_mut(), &recording, limit)),
        })
    }
}

/// One episode of what `controller` does, of at most `limit` steps.
fn play(
    env: &mut dyn Inspect,
    controller: &mut dyn Controller,
    mut start: Stream,
    noise: &mut Stream,
    limit: usize,
) -> Film {
    let single = |numbers: &[f64]| numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>();
    let spec = env.spec().clone();
    let mut observation = vec![0.0; spec.obs_size];
    let mut previous = vec![0.0; spec.action_size];
    env.reset(&mut start, &mut observation);
    let mut film = Film::begin(env);
    for step in 0..limit {
        let moment = Moment {
            obs: &single(&observation),
            previous: &previous,
            step,
            env: &*env,
        };
        previous = controller.act(&moment, noise);
        let action: Vec<f64> = previous.iter().map(|a| f64::from(*a)).collect();
        let outcome = env.step(&action, &mut observation);
        film.step(env, &outcome);
        if outcome.terminated || outcome.truncated {
            break;
        }
    }
    film
}

/// The recorded states, an episode wherever the recording begins anew.
fn recorded(env: &mut dyn Inspect, recording: &Recording, limit: usize) -> Vec<Film> {
    let spec = env.spec().clone();
    let mut observation = vec![0.0; spec.obs_size];
    let nothing = vec![0.0; spec.goal_size];
    let goal = recording.desired_goal.as_ref().unwrap_or(&nothing);
    let number =
        |rows: &Option<Rows>, t: usize| rows.as_ref().and_then(|rows| Some(rows.get(t)?[0]));
    let mut films: Vec<Film> = Vec::new();
    for t in 0..=recording.steps() {
        let (Some(qpos), Some(qvel)) = (recording.qpos.get(t), recording.qvel.get(t)) else {
            continue;
        };
        env.start_at(
            &Start {
                qpos,
                qvel,
                previous_action: None,
                goal,
            },
            &mut observation,
        );
        if t == 0 || recording.reset_before(t) {
            films.push(Film::begin(env));
            continue;
        }
        let Some(film) = films.last_mut() else {
            continue;
        };
        let reward = number(&recording.reward, t - 1);
        let before = film.shots().last().and_then(|shot| shot.episode_return);
        film.push(Shot {
            qpos: env.shown_qpos(),
            step: film.shots().len(),
            reward,
            episode_return: before.zip(reward).map(|(sum, reward)| sum + reward),
            success: number(&recording.success, t - 1).map(|flag| flag != 0.0),
        });
    }
    films.iter_mut().for_each(|film| film.cut_to(limit));
    films
}

/// A width and a height in pixels.
fn size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once(['x', 'X']);
    let sides = sides.and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let right = |sides: &[usize; 2]| sides.iter().all(|side| (1..=LARGEST_SIDE).contains(side));
    sides.filter(right).ok_or_else(|| {
        format!("a width and a height from 1 to {LARGEST_SIDE}, for example 640x480")
    })
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| SPEEDS.contains(speed));
    speed.ok_or_else(|| format!("a number from {} to {}", SPEEDS.start(), SPEEDS.end()))
}
