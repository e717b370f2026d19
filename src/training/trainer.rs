//! The training loop (paper, Algorithm 1).

use super::assemble::coupling;
use super::clock::Clock;
use super::collector::{Collector, NotFinite, Sinks};
use super::guidance::{Guidance, Planned};
use super::metrics::Interval;
use super::rehearsal::{Following, rehearse};
use super::state;
use super::telemetry::{self, Probing, Returns};
use super::{Evaluation, Evaluator, TrainError, video};
use crate::agent::augment::Phase1;
use crate::agent::{Agent, Controller, Exploring, RandomActions};
use crate::config::{Config, Overrides};
use crate::core::parallel::with_threads;
use crate::env::{self, Scene};
use crate::nn::{ObservationScaling, RunningMoments};
use crate::replay::{ReplayBuffer, Sampler};
use crate::run::{Curves, ReplayLog, ReplayMemory, RunDirectory};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Where a run stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Status {
    /// Environment steps taken.
    pub step: u64,
    /// Environment steps of the whole run.
    pub steps: u64,
    /// Mean return of the last evaluation.
    pub return_mean: Option<f64>,
}

/// Is told how a run proceeds.
pub trait Monitor: Send {
    /// After every round: a step of each environment, and what is learned from it.
    fn step(&mut self, status: &Status);
    /// Something the user should know that does not end the run.
    fn note(&mut self, message: &str);
    /// What the replay buffer takes, before it is taken.
    fn memory(&mut self, _: &ReplayMemory) {}
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// All steps were taken.
    Finished,
    /// It was asked to stop after this many steps, and saved a checkpoint.
    Interrupted(u64),
}

/// Everything a run is made of.
pub struct Trainer {
    /// Environment steps taken, by all environments together.
    pub(super) step: u64,
    /// Largest reward of phase 1 so far.
    pub(super) largest_reward: f64,
    pub(super) config: Config,
    pub(super) directory: RunDirectory,
    pub(super) curves: Curves,
    pub(super) collector: Collector,
    pub(super) demonstrations: Option<[usize; 2]>,
    pub(super) agent: Agent,
    pub(super) sampler: Box<dyn Sampler>,
    pub(super) evaluator: Evaluator,
    /// Where imagined steps are measured, for agents that imagine.
    pub(super) probing: Option<Probing>,
    /// Where the policy is started in recorded states.
    pub(super) following: Option<Following>,
    /// Where the planner makes episodes for it to learn from.
    pub(super) guidance: Option<Guidance>,
    pub(super) replay: ReplayBuffer,
    pub(super) log: ReplayLog,
    /// Number of the first transition that `checkpoints/last` needs.
    pub(super) needed: u64,
    pub(super) moments: RunningMoments,
    pub(super) scaling: ObservationScaling,
    pub(super) interval: Interval,
    pub(super) clock: Clock,
    pub(super) best_return: Option<f64>,
    pub(super) last_return: Option<f64>,
    /// Whether it has been said that a buffer of the simulator was full.
    pub(super) told_full: bool,
    /// Steps before the last evaluation.
    pub(super) evaluated: Option<u64>,
}

/// What it means that a buffer of the simulator is full.
const BUFFER_FULL: &str =
    "a buffer of MuJoCo for contacts or constraints is full: some are left out of the physics";

/// The steps that one round of the environments takes: from after `before` to `after`.
#[derive(Debug, Clone, Copy)]
struct Round {
    before: u64,
    after: u64,
}

impl Round {
    /// Whether something that happens `every` so many steps is due after it.
    fn is_due(self, every: u64) -> bool {
        self.after / every > self.before / every
    }

    /// The steps of the round after which something that happens `every` so many steps is due.
    fn due(self, every: u64) -> impl Iterator<Item = u64> {
        (self.before / every + 1..=self.after / every).map(move |n| n * every)
    }
}

impl Trainer {
    /// The steps of the run in the directory `path` if it has taken all of them under `overrides`. Looks only, so
    /// that this can be said of a run that can't be written to.
    pub fn finished(path: &Path, overrides: &Overrides) -> Option<u64> {
        state::finished_run(path, overrides)
    }

    /// The settings of the run.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Where it writes to.
    pub fn path(&self) -> &Path {
        self.directory.path()
    }

    /// Environment steps taken.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// Runs to the end, or until `stop` becomes true; then a checkpoint is saved at once.
    ///
    /// # Errors
    /// When a number is not finite or a file can't be written.
    pub fn run(
        mut self,
        monitor: &mut dyn Monitor,
        stop: &AtomicBool,
    ) -> Result<Outcome, TrainError> {
        let threads = self.config.compute.threads;
        with_threads(threads, move || self.train(monitor, stop))
            .map_err(|error| TrainError::Threads { threads, error })?
    }

    fn train(
        &mut self,
        monitor: &mut dyn Monitor,
        stop: &AtomicBool,
    ) -> Result<Outcome, TrainError> {
        let (steps, random_steps) = (self.config.steps, self.config.random_steps);
        if steps <= random_steps {
            monitor.note(&format!(
                "{steps} steps end inside phase 1 ({random_steps} random steps): the policy will not be trained"
            ));
        }
        self.tell_of_demonstrations(monitor);
        let every = self.config.planner.every;
        if every > 0 && random_steps.saturating_add(every) > steps {
            monitor.note(&format!(
                "planner.every = {every}: {steps} steps end before the first episode is planned"
            ));
        }
        let mut controllers = self.controllers();
        if self.step == 0 {
            self.evaluate(monitor)?;
            self.record_video(monitor, stop);
            self.collector.reset(&mut self.moments);
        }
        while self.step < steps {
            if !self.guide(stop)? {
                self.save_last()?;
                return Ok(Outcome::Interrupted(self.step));
            }
            let round = self.next_round();
            let random = round.after <= random_steps;
            let taking = (round.after - round.before) as usize;
            self.collect(&mut controllers[..taking], monitor)?;
            let scaling = &self.config.scaling;
            let rescaled = scaling.enabled && round.is_due(scaling.every);
            if rescaled {
                self.scaling = self.moments.scaling(scaling.clip, scaling.deviation_floor);
            }

            let mut learned = false;
            for step in round.due(self.config.updates.every) {
                learned |= self.learn(step)?;
            }
            if self.step == random_steps {
                self.begin_phase_2(monitor);
                self.collector.reset(&mut self.moments);
            }
            if learned || (rescaled && !random) || self.step == random_steps {
                controllers = self.controllers();
            }

            if round.is_due(self.config.evaluation.every) {
                self.evaluate(monitor)?;
            }
            if self.config.video.every > 0 && round.is_due(self.config.video.every) {
                self.record_video(monitor, stop);
            }
            let last = self.step == steps;
            if last && !self.config.checkpoint.replay && self.evaluated != Some(steps) {
                // No run goes on from this checkpoint.
                self.evaluate(monitor)?;
            }
            let stopped = stop.load(Ordering::Relaxed) && !last;
            if stopped || last || round.is_due(self.config.checkpoint.every) {
                self.save_last()?;
            }
            monitor.step(&Status {
                step: self.step,
                steps,
                return_mean: self.last_return,
            });
            if stopped {
                return Ok(Outcome::Interrupted(self.step));
            }
        }
        // The last part of a run that ends between two evaluations is evaluated as well, after the checkpoint: a run that is
        // made longer goes on from there as if it had never ended.
        if self.evaluated != Some(self.step) {
            self.evaluate(monitor)?;
            let synced = self.curves.sync();
            self.on_disk(synced)?;
            monitor.step(&Status {
                step: self.step,
                steps,
                return_mean: self.last_return,
            });
        }
        Ok(Outcome::Finished)
    }

    /// Has the planner make the episodes that are due; whether the run is to go on. An episode that is not finished when
    /// the run is to stop is begun again when it goes on.
    fn guide(&mut self, stop: &AtomicBool) -> Result<bool, TrainError> {
        let (config, step) = (&self.config, self.step);
        let Some(guidance) = &mut self.guidance else {
            return Ok(true);
        };
        while guidance.is_due(config, step) {
            let started = Instant::now();
            let (agent, directory) = (&mut self.agent, &self.directory);
            let planned = guidance.plan(config, agent, &self.scaling, directory, stop)?;
            self.clock.planning += started.elapsed();
            let Planned::Made(result, recorded) = planned else {
                return Ok(false);
            };
            self.interval.tell("planned_return", result.episode_return);
            self.interval.tell("planned_length", result.length as f64);
            if let Some(recorded) = recorded {
                self.collector.set_demonstrations(&guidance.demonstrations);
                rehearse(config, &recorded, agent)?;
            }
        }
        Ok(true)
    }

    /// A step of each environment, or of the first ones where fewer steps are left of phase 1 or of the run: no round
    /// goes past the end of either.
    fn next_round(&self) -> Round {
        let (before, phase_1) = (self.step, self.config.random_steps);
        let end = match before < phase_1 {
            true => phase_1.min(self.config.steps),
            false => self.config.steps,
        };
        Round {
            before,
            after: end.min(before + self.config.environments as u64),
        }
    }

    /// What acts in the next round, in each environment: random actions in phase 1, the policy with noise after it,
    /// whose deviation may be spread over the environments.
    fn controllers(&self) -> Vec<Box<dyn Controller>> {
        let (n, spec) = (self.config.environments, self.collector.spec());
        if self.step < self.config.random_steps {
            let coupling = coupling(&self.config, spec);
            let random = RandomActions { coupling };
            return (0..n).map(|_| random.another()).collect();
        }
        let policy = self.agent.policy(&self.scaling);
        let explore = |i: usize| -> Box<dyn Controller> {
            Box::new(Exploring {
                policy: policy.clone(),
                deviation: deviation(&self.config, i),
            })
        };
        (0..n).map(explore).collect()
    }

    /// Says what experience is made of where the published runs used demonstrations.
    fn tell_of_demonstrations(&self, monitor: &mut dyn Monitor) {
        let published = matches!(
            env::info(&self.config.task),
            Ok(info) if matches!(info.scene, Scene::Hands(_))
        );
        match self.demonstrations {
            Some([trajectories, states]) => monitor.note(&format!(
                "demonstrations from {}: trajectories {trajectories}, states {states}",
                self.config.demonstrations.path
            )),
            None if self.guidance.is_some() => monitor.note(
                "no demonstrations (demonstrations.path is empty) but those that the planner makes",
            ),
            None if published => monitor.note(
                "no demonstrations (demonstrations.path is empty): training on plain episodes",
            ),
            None => (),
        }
    }

    /// Has the environments step under `controllers`, one each.
    fn collect(
        &mut self,
        controllers: &mut [Box<dyn Controller>],
        monitor: &mut dyn Monitor,
    ) -> Result<(), TrainError> {
        let started = Instant::now();
        let mut sinks = Sinks {
            replay: &mut self.replay,
            sampler: self.sampler.as_mut(),
            moments: &mut self.moments,
            reservoir: self.probing.as_mut().map(|probing| &mut probing.reservoir),
        };
        let round = self.collector.round(controllers, &mut sinks);
        let round = round.map_err(|(source, NotFinite(name))| {
            self.not_finite(self.step + source as u64 + 1, name.to_owned())
        })?;
        self.clock.environment += started.elapsed();
        for taken in round {
            self.step += 1;
            if let Some((episode_return, length)) = taken.ended {
                self.interval.count("episodes");
                self.interval.tell("return_mean", episode_return);
                self.interval.tell("length_mean", length as f64);
            }
            if taken.buffer_full {
                self.interval.count("buffers_full");
                if !std::mem::replace(&mut self.told_full, true) {
                    let step = self.step;
                    monitor.note(&format!(
                        "step {step}: {BUFFER_FULL}; train.csv counts such steps from here on"
                    ));
                }
            }
            match taken.reward {
                Some(reward) if self.step <= self.config.random_steps => {
                    self.largest_reward = self.largest_reward.max(reward);
                }
                Some(_) => (),
                None => {
                    self.interval.count("diverged");
                    let step = self.step;
                    monitor.note(&format!(
                        "step {step}: the simulation diverged; the episode is truncated"
                    ));
                }
            }
        }
        Ok(())
    }

    /// What is learned because of step number `step`: the model alone in phase 1, everything in phase 2. Returns
    /// whether the actor changed.
    fn learn(&mut self, step: u64) -> Result<bool, TrainError> {
        let started = Instant::now();
        let rows = self.config.batch_size;
        let mut changed = false;
        let mut not_finite = None;
        if self.replay.is_empty() {
            // Nothing but diverged steps so far.
        } else if step > self.config.random_steps {
            for n in 1..=self.config.critic_updates {
                let sample = self.agent.draw(&self.replay, self.sampler.as_ref(), rows);
                let update = if n < self.config.critic_updates {
                    self.agent.update_critics(&sample, &self.scaling)
                } else {
                    self.agent.update(&sample, &self.scaling)
                };
                // Recorded rows, the last ones, are none of the sampler's.
                let indices = &sample.batch.indices;
                self.sampler
                    .learned(indices, &update.errors[..indices.len()]);
                not_finite = not_finite.or(update.metrics.not_finite());
                changed |= update.actor_changed;
                self.interval.count("updates");
                for (name, value) in update.metrics.iter() {
                    self.interval.tell(name, value);
                }
            }
        } else if step > self.config.model_start {
            let sampler = self.sampler.as_ref();
            let loss = self
                .agent
                .train_model(&self.replay, sampler, rows, &self.scaling);
            if let Some(loss) = loss {
                not_finite = (!loss.is_finite()).then_some("model_loss");
                self.interval.tell("model_loss", loss.into());
            }
        }
        self.clock.update += started.elapsed();
        if let Some(quantity) = not_finite {
            return Err(self.not_finite(step, quantity.to_owned()));
        }
        if let Some(network) = self.agent.not_finite() {
            let quantity =
                format!("a parameter of the {network}, or the second moment of its gradient,");
            return Err(self.not_finite(step, quantity));
        }
        Ok(changed)
    }

    pub(super) fn not_finite(&self, step: u64, quantity: String) -> TrainError {
        TrainError::NotFinite {
            step,
            quantity,
            checkpoint: self.good_checkpoint(),
        }
    }

    /// Line 12 of Algorithm 1: the augmentation is told the largest reward of phase 1 (equation 6).
    fn begin_phase_2(&mut self, monitor: &mut dyn Monitor) {
        if !self.largest_reward.is_finite() {
            return;
        }
        let seen = Phase1 {
            largest_reward: self.largest_reward,
            episode_limit: self.collector.spec().max_episode_steps,
            discount: self.config.discount,
        };
        let Agent { core, augment, .. } = &mut self.agent;
        if let Some(bias) = augment.begin(core, &seen) {
            monitor.note(&optimism(bias, &seen));
        }
    }

    /// Evaluates, writes a row of each curve, and saves the best policy so far.
    fn evaluate(&mut self, monitor: &mut dyn Monitor) -> Result<(), TrainError> {
        let step = self.step;
        let started = Instant::now();
        let policy = self.agent.policy(&self.scaling);
        let episodes = self.config.evaluation.episodes;
        let watched = self.evaluator.evaluate_watched(&policy, episodes, &Returns);
        let (episodes, seen): (Vec<_>, Vec<_>) = watched.into_iter().unzip();
        let evaluation = Evaluation { episodes };
        let newest = self.replay.newest(self.config.batch_size);
        let model_error = if newest.rows > 0 {
            self.agent.model_error(&newest, &self.scaling)
        } else {
            None
        };
        if let Some(error) = model_error {
            self.interval.tell("model_error", error.into());
        }
        if step > self.config.random_steps {
            let core = &self.agent.core;
            if let Some(bias) = telemetry::q_bias(core, &seen, self.config.discount, &self.scaling)
            {
                self.interval.tell("q_bias", bias);
            }
            if let Some(Probing { reservoir, env }) = &mut self.probing {
                let (agent, scaling) = (&self.agent, &self.scaling);
                let errors = telemetry::measure(agent, reservoir, env.as_mut(), scaling);
                for (name, error) in errors.iter().flat_map(telemetry::Errors::named) {
                    self.interval.tell(name, error);
                }
            }
        }
        if let Some(probing) = &mut self.probing {
            probing.reservoir.clear();
        }
        if let Some(following) = self.following.as_mut().filter(|_| step > 0) {
            for (name, reward) in following.measure(&policy) {
                self.interval.tell(name, reward);
            }
        }
        let evaluation_time = started.elapsed();

        let clock = std::mem::replace(&mut self.clock, Clock::new(step));
        self.note_evaluation(&evaluation, monitor)?;
        if step > 0 {
            let row = self.interval.take(step);
            let written = self.curves.trained(row, &clock.row(step, evaluation_time));
            self.on_disk(written)?;
        }
        // Last, for this row says that the evaluation is done.
        let written = self.curves.evaluated(&evaluation.row(step));
        self.on_disk(written)?;
        self.evaluated = Some(step);
        Ok(())
    }

    /// Records a video, if there are to be any. That takes none of the run's time, and one that can't be made
    /// ends no run.
    fn record_video(&mut self, monitor: &mut dyn Monitor, stop: &AtomicBool) {
        if self.config.video.every == 0 {
            return;
        }
        let step = self.step;
        let started = Instant::now();
        let policy = self.agent.policy(&self.scaling);
        let directory = self.directory.path();
        if let Err(error) = video::record(&self.config, directory, step, &policy, stop) {
            monitor.note(&format!("step {step}: no video: {error}"));
        }
        self.clock.leave_out(started.elapsed());
    }

    /// Saves the best policy so far. The returns of an evaluation that diverged are of what came before, which may look
    /// better than any whole episode.
    fn note_evaluation(
        &mut self,
        evaluation: &Evaluation,
        monitor: &mut dyn Monitor,
    ) -> Result<(), TrainError> {
        let return_mean = evaluation.return_mean();
        self.last_return = Some(return_mean);
        let (step, diverged) = (self.step, evaluation.diverged());
        if evaluation.buffers_full() > 0 && !std::mem::replace(&mut self.told_full, true) {
            monitor.note(&format!(
                "evaluation at step {step}: {BUFFER_FULL}; eval.csv counts such steps"
            ));
        }
        if diverged > 0 {
            let episodes = evaluation.episodes.len();
            monitor.note(&format!(
                "evaluation at step {step}: the simulation diverged in {diverged} of {episodes} episodes, whose returns are \
                 of the steps before; it is not kept as the best"
            ));
            return Ok(());
        }
        if self.best_return.is_none_or(|best| return_mean > best) {
            self.best_return = Some(return_mean);
            self.save_best()?;
        }
        Ok(())
    }
}

/// How optimistic critics that begin with `bias` are, in words.
fn optimism(bias: f64, seen: &Phase1) -> String {
    let (most, value) = (seen.largest_reward, seen.highest_value());
    let begins = format!("phase 2: the critics begin with a bias of {bias:.4}");
    let from = format!("largest reward {most:.4}, discount {}", seen.discount);
    if seen.discount >= 1.0 {
        return format!(
            "{begins}; without a discount nothing bounds what can be attained ({from})"
        );
    }
    let beside = format!("{begins}, beside {value:.4} that can be attained at most ({from})");
    if most == 0.0 {
        return format!("{beside}: no optimism, for no reward of phase 1 was above 0");
    }
    let times = bias / value;
    let kind = match (most > 0.0, times > 1.0) {
        (true, true) => ", more than any policy can reach",
        (true, false) => "",
        // Fresh critics say about 0.
        (false, true) => "; pessimism, for it lies below what can be attained",
        (false, false) => "; pessimism beside fresh critics, for no reward of phase 1 was above 0",
    };
    format!("{beside}: {times:.2} times that{kind}")
}

/// Deviation of the exploration noise in environment number `i`, as a fraction of half of each number's range.
fn deviation(config: &Config, i: usize) -> f64 {
    match config.exploration.spread[..] {
        [low, high] => {
            let last = (config.environments - 1).max(1);
            low + (high - low) * i as f64 / last as f64
        }
        _ => config.exploration_noise,
    }
}

#[cfg(test)]
#[path = "trainer_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "trainer_numbers.rs"]
mod numbers;
