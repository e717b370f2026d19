//! The training loop (paper, Algorithm 1).

mod assemble;
mod clock;
mod save;

pub use assemble::{demonstrations, fresh_agent};
pub use save::{ResumeOptions, Resumed};

use super::curves::{Curves, EvalRow, Interval, Measured};
use super::experience::{Experience, NotFinite, Sinks};
use super::telemetry::{self, Probing, Returns};
use super::{Evaluation, Evaluator, ReplayMemory, RunDirectory, TrainError, video};
use crate::agent::{Agent, ImaginationDraws, ModelDraws, Sample};
use crate::config::{Addition, Config, Overrides};
use crate::env::{self, Scene};
use crate::nn::{ObservationScaling, RunningMoments};
use crate::parallel::{join, with_threads};
use crate::random::Stream;
use crate::replay::{ReplayBuffer, ReplayLog};
use clock::Clock;
use rand::RngExt;
use serde::{Deserialize, Serialize};
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
    /// After every environment step.
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
    /// Environment steps taken.
    step: u64,
    /// Largest reward of phase 1 so far.
    largest_reward: f64,
    config: Config,
    directory: RunDirectory,
    curves: Curves,
    experience: Experience,
    demonstrations: Option<[usize; 2]>,
    agent: Agent,
    evaluator: Evaluator,
    /// Where imagined steps are measured, for agents that imagine.
    probing: Option<Probing>,
    replay: ReplayBuffer,
    log: ReplayLog,
    /// Number of the first transition that `checkpoints/last` needs.
    needed: u64,
    moments: RunningMoments,
    scaling: ObservationScaling,
    streams: Streams,
    interval: Interval,
    clock: Clock,
    best_return: Option<f64>,
    last_return: Option<f64>,
}

/// One stream for each use of randomness, so that none shifts another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Streams {
    exploration: Stream,
    replay: Stream,
    model_replay: Stream,
    smoothing: Stream,
    policy: Stream,
    imagination: Stream,
}

impl Trainer {
    /// The steps of the run in the directory `path` if it has taken all of them under `overrides`. Looks only, so
    /// that this can be said of a run that can't be written to.
    pub fn finished(path: &Path, overrides: &Overrides) -> Option<u64> {
        save::finished_run(path, overrides)
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
        let mut policy = self.agent.policy(&self.scaling);
        if self.step == 0 {
            self.evaluate()?;
            self.record_video(monitor, stop);
            self.experience.reset(&mut self.moments);
        }
        while self.step < steps {
            self.step += 1;
            let step = self.step;
            let random = step <= random_steps;
            let action = if random {
                self.random_action()
            } else {
                let limit = self.experience.spec().action_limit;
                let deviation = (self.config.exploration_noise * limit) as f32;
                let (obs, previous) = self.experience.state();
                policy.explore(obs, previous, deviation, &mut self.streams.exploration)
            };
            let reward = self.act(&action, monitor)?;
            if random && let Some(reward) = reward {
                self.largest_reward = self.largest_reward.max(reward);
            }
            let rescaled =
                self.config.scaling.enabled && step.is_multiple_of(self.config.scaling.every);
            if rescaled {
                let scaling = &self.config.scaling;
                self.scaling = self.moments.scaling(scaling.clip, scaling.deviation_floor);
            }

            let learned = self.learn()?;
            if step == random_steps {
                self.begin_phase_2();
                self.experience.reset(&mut self.moments);
            }
            if learned || (rescaled && !random) || step == random_steps {
                policy = self.agent.policy(&self.scaling);
            }

            if step.is_multiple_of(self.config.evaluation.every) {
                self.evaluate()?;
                self.record_video(monitor, stop);
            }
            let stopped = stop.load(Ordering::Relaxed) && step < steps;
            if stopped || step == steps || step.is_multiple_of(self.config.checkpoint.every) {
                self.save_last()?;
            }
            monitor.step(&Status {
                step,
                steps,
                return_mean: self.last_return,
            });
            if stopped {
                return Ok(Outcome::Interrupted(step));
            }
        }
        Ok(Outcome::Finished)
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
            None if published => monitor.note(
                "no demonstrations (demonstrations.path is empty): training on plain episodes",
            ),
            None => (),
        }
    }

    /// A uniformly random action of phase 1, coupled like any other.
    fn random_action(&mut self) -> Vec<f32> {
        let coupling = self.config.coupling(self.experience.spec());
        let limit = coupling.limit as f32;
        let rng = &mut self.streams.exploration;
        let (_, previous) = self.experience.state();
        let mut action: Vec<f32> = previous
            .iter()
            .map(|_| rng.random_range(-limit..=limit))
            .collect();
        coupling.execute_in_place(&mut action, previous);
        action
    }

    /// Executes `action`; returns the reward, none where the simulation blew up.
    fn act(
        &mut self,
        action: &[f32],
        monitor: &mut dyn Monitor,
    ) -> Result<Option<f64>, TrainError> {
        let started = Instant::now();
        let mut sinks = Sinks {
            replay: &mut self.replay,
            moments: &mut self.moments,
            reservoir: self.probing.as_mut().map(|probing| &mut probing.reservoir),
        };
        let taken = self.experience.step(action, &mut sinks);
        let taken = taken.map_err(|NotFinite(name)| self.not_finite(name.to_owned()))?;
        self.clock.environment += started.elapsed();
        if let Some((episode_return, length)) = taken.ended {
            self.interval.episode(episode_return, length);
        }
        if taken.reward.is_none() {
            self.interval.diverged();
            let step = self.step;
            monitor.note(&format!(
                "step {step}: the simulation diverged; the episode is truncated"
            ));
        }
        Ok(taken.reward)
    }

    /// The learning of one step: the model alone in phase 1, everything in phase 2. Returns
    /// whether the actor changed.
    fn learn(&mut self) -> Result<bool, TrainError> {
        let step = self.step;
        let started = Instant::now();
        let rows = self.config.batch_size;
        let mut changed = false;
        let mut not_finite = None;
        if self.replay.is_empty() {
            // Nothing but diverged steps so far.
        } else if step > self.config.random_steps {
            for n in 1..=self.config.critic_updates {
                let sample = self.draw_sample();
                let figures = if n < self.config.critic_updates {
                    self.agent.update_critics(&sample, &self.scaling)
                } else {
                    self.agent.update(&sample, &self.scaling)
                };
                not_finite = not_finite.or(figures.not_finite());
                changed = figures.actor_loss.is_some();
                self.interval.update(&figures);
            }
        } else if step > self.config.model_start && self.config.method.learns_model() {
            let batch = self.replay.sample(rows, &mut self.streams.model_replay);
            if let Some(loss) = self.agent.train_model(&batch, &self.scaling) {
                not_finite = (!loss.is_finite()).then_some("model loss");
                self.interval.model_step(loss);
            }
        }
        self.clock.update += started.elapsed();
        if let Some(quantity) = not_finite {
            return Err(self.not_finite(quantity.to_owned()));
        }
        if let Some(network) = self.agent.not_finite() {
            let quantity =
                format!("a parameter of the {network}, or the second moment of its gradient,");
            return Err(self.not_finite(quantity));
        }
        Ok(changed)
    }

    fn not_finite(&self, quantity: String) -> TrainError {
        TrainError::NotFinite {
            step: self.step,
            quantity,
            checkpoint: self.good_checkpoint(),
        }
    }

    /// Transitions and noise of one update.
    fn draw_sample(&mut self) -> Sample {
        let (rows, action_size) = (self.config.batch_size, self.experience.spec().action_size);
        let (replay, streams, method) = (&self.replay, &mut self.streams, self.config.method);
        let (sample, model) = join(
            || {
                let batch = replay.sample(rows, &mut streams.replay);
                let sample = Sample::draw(batch, action_size, &mut streams.smoothing);
                if method.base().is_stochastic() {
                    sample.with_policy_noise(action_size, &mut streams.policy)
                } else {
                    sample
                }
            },
            || {
                method.learns_model().then(|| ModelDraws {
                    batch: replay.sample(rows, &mut streams.model_replay),
                    imagination: (method.addition() == Addition::Imagination).then(|| {
                        ImaginationDraws::draw(rows, action_size, &mut streams.imagination)
                    }),
                })
            },
        );
        Sample { model, ..sample }
    }

    /// Line 12 of Algorithm 1: `b = r* l c` (equation 6).
    fn begin_phase_2(&mut self) {
        let largest_reward = self.largest_reward;
        let settings = &self.config.imagination;
        let imagines = self.config.method.addition() == Addition::Imagination;
        if imagines && settings.optimism && largest_reward.is_finite() {
            let episode_limit = self.experience.spec().max_episode_steps as f64;
            let bias = largest_reward * episode_limit * settings.bias_factor;
            self.agent.set_optimism(bias as f32);
        }
    }

    /// Evaluates, writes a row of each curve, and saves the best policy so far.
    fn evaluate(&mut self) -> Result<(), TrainError> {
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
        let trained = step > self.config.random_steps;
        let (agent, scaling) = (&self.agent, &self.scaling);
        let q_bias = trained
            .then(|| telemetry::q_bias(agent, &seen, self.config.discount, scaling))
            .flatten();
        let mut imagined = None;
        if let Some(Probing { reservoir, env }) = &mut self.probing {
            if trained {
                imagined = telemetry::measure(agent, reservoir, env.as_mut(), scaling);
            }
            reservoir.clear();
        }
        let measured = Measured {
            model_error,
            q_bias,
            imagined: imagined.unwrap_or_default(),
        };
        let evaluation_time = started.elapsed();

        let clock = std::mem::replace(&mut self.clock, Clock::new(step));
        let written = self.curves.evaluated(EvalRow::new(step, &evaluation));
        self.on_disk(written)?;
        if step > 0 {
            let row = self.interval.take(step, &measured);
            let written = self.curves.trained(row, clock.row(step, evaluation_time));
            self.on_disk(written)?;
        }
        self.note_evaluation(&evaluation)
    }

    /// Records a video where one is due. That takes none of the run's time, and one that can't be made
    /// ends no run.
    fn record_video(&mut self, monitor: &mut dyn Monitor, stop: &AtomicBool) {
        let (step, every) = (self.step, self.config.video.every);
        if every == 0 || !step.is_multiple_of(every) {
            return;
        }
        let started = Instant::now();
        let policy = self.agent.policy(&self.scaling);
        let directory = self.directory.path();
        if let Err(error) = video::record(&self.config, directory, step, &policy, stop) {
            monitor.note(&format!("step {step}: no video: {error}"));
        }
        self.clock.leave_out(started.elapsed());
    }

    fn note_evaluation(&mut self, evaluation: &Evaluation) -> Result<(), TrainError> {
        let return_mean = evaluation.return_mean();
        self.last_return = Some(return_mean);
        if self.best_return.is_none_or(|best| return_mean > best) {
            self.best_return = Some(return_mean);
            self.save_best()?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
