//! Episodes of whatever acts, in environments of their own.

use super::assemble::make_env;
use crate::agent::{Controller, Moment};
use crate::config::Config;
use crate::core::parallel::join;
use crate::core::random::Stream;
use crate::env::{Inspect, MakeError};
use crate::run::EvalRow;
use crate::task::{Spec, Step};
use rand::SeedableRng;

/// How one episode went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeResult {
    /// Undiscounted sum of the rewards.
    pub episode_return: f64,
    /// Control steps.
    pub length: usize,
    /// The simulation blew up; return and length are of what came before.
    pub diverged: bool,
    /// Steps in which a buffer of the simulator was full.
    pub buffers_full: usize,
    /// Whether the goal was reached in the last step; `None` for a task that knows no success.
    pub success: Option<bool>,
}

/// Several episodes and what they say of the policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// The episodes, in order.
    pub episodes: Vec<EpisodeResult>,
}

impl Evaluation {
    /// Mean of the returns.
    pub fn return_mean(&self) -> f64 {
        mean(self.returns())
    }

    /// Standard deviation of the returns (of the episodes themselves: divided by their number).
    pub fn return_std(&self) -> f64 {
        let centre = self.return_mean();
        mean(self.returns().map(|r| (r - centre).powi(2))).sqrt()
    }

    /// Smallest return.
    pub fn return_min(&self) -> f64 {
        self.returns().fold(f64::INFINITY, f64::min)
    }

    /// Largest return.
    pub fn return_max(&self) -> f64 {
        self.returns().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Mean of the episodes' lengths.
    pub fn length_mean(&self) -> f64 {
        mean(self.episodes.iter().map(|e| e.length as f64))
    }

    /// Fraction of the episodes that end in success; `None` for a task that knows none.
    pub fn success_rate(&self) -> Option<f64> {
        let successes: Option<Vec<bool>> = self.episodes.iter().map(|e| e.success).collect();
        let rate = |s: Vec<bool>| mean(s.into_iter().map(|s| f64::from(u8::from(s))));
        successes.map(rate)
    }

    /// Episodes whose simulation blew up.
    pub fn diverged(&self) -> usize {
        self.episodes.iter().filter(|e| e.diverged).count()
    }

    /// Steps in which a buffer of the simulator was full.
    pub fn buffers_full(&self) -> usize {
        self.episodes.iter().map(|e| e.buffers_full).sum()
    }

    /// The row of `eval.csv` after `step` environment steps.
    pub fn row(&self, step: u64) -> EvalRow {
        EvalRow {
            step,
            episodes: self.episodes.len(),
            return_mean: self.return_mean(),
            return_std: self.return_std(),
            return_min: self.return_min(),
            return_max: self.return_max(),
            length_mean: self.length_mean(),
            success_rate: self.success_rate(),
            diverged: self.diverged(),
            buffers_full: self.buffers_full(),
        }
    }

    fn returns(&self) -> impl Iterator<Item = f64> + '_ {
        self.episodes.iter().map(|e| e.episode_return)
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0u32), |(sum, n), x| (sum + x, n + 1));
    sum / f64::from(n)
}

/// Looks on while episodes run, several at a time.
pub trait Watch: Sync {
    /// What is kept of one episode.
    type Seen: Send;

    /// An episode began with this observation.
    fn begin(&self, env: &dyn Inspect, observation: &[f64]) -> Self::Seen;

    /// `action` was executed, with this outcome; `observation` follows it.
    fn step(
        &self,
        seen: &mut Self::Seen,
        env: &dyn Inspect,
        action: &[f64],
        step: &Step,
        observation: &[f64],
    );

    /// Whether this outcome is the episode's last: the end of the task, unless the watcher has `seen` enough before.
    fn ends(&self, _seen: &Self::Seen, step: &Step) -> bool {
        step.terminated || step.truncated
    }
}

/// Nobody looks on.
struct Unwatched;

impl Watch for Unwatched {
    type Seen = ();

    fn begin(&self, _: &dyn Inspect, _: &[f64]) {}

    fn step(&self, (): &mut (), _: &dyn Inspect, _: &[f64], _: &Step, _: &[f64]) {}
}

/// Two environments in which episodes are run side by side.
pub struct Evaluator {
    envs: [Box<dyn Inspect>; 2],
    rng: Stream,
}

impl Evaluator {
    /// An evaluator of controllers for the task of `config`; `rng` seeds the episodes.
    ///
    /// # Errors
    /// When there is no such task or MuJoCo can't run it.
    pub fn new(config: &Config, rng: Stream) -> Result<Evaluator, MakeError> {
        Ok(Evaluator {
            envs: [make_env(config)?, make_env(config)?],
            rng,
        })
    }

    /// An evaluator in these environments.
    #[cfg(test)]
    pub(super) fn within(envs: [Box<dyn Inspect>; 2], rng: Stream) -> Evaluator {
        Evaluator { envs, rng }
    }

    /// Sizes, ranges and limits of the task.
    pub fn spec(&self) -> &Spec {
        self.envs[0].spec()
    }

    /// The generator of the next episodes.
    pub(super) fn stream(&self) -> &Stream {
        &self.rng
    }

    /// Has the next episodes drawn from `rng`.
    pub(super) fn set_stream(&mut self, rng: Stream) {
        self.rng = rng;
    }

    /// Leaves out `episodes` episodes, as if they had been run.
    pub fn skip(&mut self, episodes: usize) {
        for _ in 0..episodes {
            let _ = Stream::from_rng(&mut self.rng);
        }
    }

    /// Runs `episodes` episodes. Every episode has a stream of its own, so that results do not
    /// depend on which environment it runs in, nor on the number of threads.
    pub fn evaluate(&mut self, controller: &dyn Controller, episodes: usize) -> Evaluation {
        let watched = self.evaluate_watched(controller, episodes, &Unwatched);
        Evaluation {
            episodes: watched.into_iter().map(|(result, ())| result).collect(),
        }
    }

    /// As [`evaluate`](Evaluator::evaluate), with what `watch` kept of each episode. The episodes are
    /// the same whether all are run at once or some now and some later.
    pub fn evaluate_watched<W: Watch>(
        &mut self,
        controller: &dyn Controller,
        episodes: usize,
        watch: &W,
    ) -> Vec<(EpisodeResult, W::Seen)> {
        let streams: Vec<Stream> = (0..episodes)
            .map(|_| Stream::from_rng(&mut self.rng))
            .collect();
        let run = |env: &mut dyn Inspect, mut actor: Box<dyn Controller>, first: usize| {
            let streams = streams.iter().skip(first).step_by(2);
            let episodes =
                streams.map(|stream| run_episode(env, actor.as_mut(), &mut stream.clone(), watch));
            episodes.collect::<Vec<_>>()
        };
        let [even, odd] = &mut self.envs;
        let [first, second] = [controller.another(), controller.another()];
        let (even, odd) = join(
            || run(even.as_mut(), first, 0),
            || run(odd.as_mut(), second, 1),
        );
        let mut odd = odd.into_iter();
        even.into_iter()
            .flat_map(|e| [Some(e), odd.next()])
            .flatten()
            .collect()
    }
}

/// One episode; `rng` draws its beginning, and what the controller leaves to chance.
pub(super) fn run_episode<W: Watch>(
    env: &mut dyn Inspect,
    controller: &mut dyn Controller,
    rng: &mut Stream,
    watch: &W,
) -> (EpisodeResult, W::Seen) {
    let (obs_size, action_size) = (env.spec().obs_size, env.spec().action_size);
    let mut observation = vec![0.0; obs_size];
    let mut previous = vec![0.0f32; action_size];
    let mut result = EpisodeResult {
        episode_return: 0.0,
        length: 0,
        diverged: false,
        buffers_full: 0,
        success: None,
    };
    env.reset(rng, &mut observation);
    let mut seen = watch.begin(env, &observation);
    let mut step = 0;
    loop {
        let obs: Vec<f32> = observation.iter().map(|x| *x as f32).collect();
        let moment = Moment {
            obs: &obs,
            previous: &previous,
            step,
            env: &*env,
        };
        previous = controller.act(&moment, rng);
        step += 1;
        let action: Vec<f64> = previous.iter().map(|a| f64::from(*a)).collect();
        let outcome = env.step(&action, &mut observation);
        watch.step(&mut seen, env, &action, &outcome, &observation);
        result.diverged |= outcome.diverged;
        result.buffers_full += usize::from(outcome.buffer_full);
        if !outcome.diverged {
            result.episode_return += outcome.reward;
            result.length += 1;
        }
        // A simulation that blew up has not succeeded, whatever it did before.
        result.success = outcome.success.or(result.success.map(|_| false));
        if watch.ends(&seen, &outcome) {
            return (result, seen);
        }
    }
}
