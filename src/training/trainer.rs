//! The training loop (paper, Algorithm 1).

use super::curves::{self, Curves, EvalRow, Interval, Measured, TimingRow};
use super::experience::{Experience, Runner, Side, Sinks};
use super::provenance::Provenance;
use super::telemetry::{self, Probing, Reservoir, Returns};
use super::{Checkpoint, Evaluation, Evaluator, RunDirectory, TrainError};
use crate::agent::{Agent, Augmentation, ImaginationDraws, ModelDraws, Sample};
use crate::config::{Addition, Config};
use crate::env::{self, Rules, Scene, Spec};
use crate::imagination::{DynamicsModel, DynamicsShape, Imagination, RewardSource, World};
use crate::nn::{ObservationScaling, RunningMoments};
use crate::parallel::{join, with_threads};
use crate::random::{Stream, stream};
use crate::replay::{Demonstrations, ReplayBuffer, Segments, Sizes};
use burn::tensor::Device;
use rand::RngExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

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
    moments: RunningMoments,
    scaling: ObservationScaling,
    streams: Streams,
    interval: Interval,
    clock: Clock,
    best_return: Option<f64>,
    last_return: Option<f64>,
    saved: Option<PathBuf>,
}

/// One stream for each use of randomness, so that none shifts another.
struct Streams {
    exploration: Stream,
    replay: Stream,
    model_replay: Stream,
    smoothing: Stream,
    policy: Stream,
    imagination: Stream,
}

/// Wall clock since the last row of `timing.csv`.
struct Clock {
    since: Instant,
    step: u64,
    environment: Duration,
    update: Duration,
}

impl Trainer {
    /// Builds a run of `config` in `directory` and writes `config.toml` and `run.json`. Where there are
    /// `demonstrations` (see [`demonstrations`]), experience comes in segments.
    ///
    /// # Errors
    /// When the task is unknown or a file can't be written.
    pub fn new(
        config: Config,
        demonstrations: Option<Demonstrations>,
        directory: RunDirectory,
    ) -> Result<Trainer, TrainError> {
        let (env, rules) = (config.env()?, config.task_rules()?);
        let spec = env.spec().clone();
        let seeded = |name| stream(config.seed, name);
        let agent = fresh_agent(&config, &spec, rules);

        let text = toml::to_string_pretty(&config).expect("a configuration is TOML");
        directory.write("config.toml", &text)?;
        let provenance =
            serde_json::to_string_pretty(&Provenance::here()).expect("plain data is JSON");
        directory.write("run.json", &provenance)?;
        let curves = Curves::create(directory.path()).map_err(|error| TrainError::Curves {
            path: directory.path().to_owned(),
            error,
        })?;

        let found = demonstrations.as_ref();
        let found = found.map(|set| [set.trajectories(), set.states()]);
        let side = demonstrations.map(|set| side(&config, set)).transpose()?;
        let capacity = config
            .replay
            .capacity
            .min(usize::try_from(config.steps).unwrap_or(usize::MAX));
        Ok(Trainer {
            experience: Experience::new(Runner::new(env, seeded("env")), side),
            demonstrations: found,
            agent,
            evaluator: Evaluator::new(&config, seeded("eval-env"))?,
            probing: probing(&config)?,
            replay: ReplayBuffer::new(capacity, spec.obs_size, spec.action_size),
            moments: RunningMoments::new(spec.obs_size),
            scaling: ObservationScaling::identity(spec.obs_size),
            streams: Streams {
                exploration: seeded("exploration"),
                replay: seeded("replay"),
                model_replay: seeded("model-replay"),
                smoothing: seeded("smoothing"),
                policy: seeded("policy"),
                imagination: seeded("imagination"),
            },
            interval: Interval::default(),
            clock: Clock::new(0),
            best_return: None,
            last_return: None,
            saved: None,
            config,
            directory,
            curves,
        })
    }

    /// Runs to the end, or until `stop` becomes true; then a checkpoint is saved at once.
    ///
    /// # Errors
    /// When a loss is not finite or a file can't be written.
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
        let mut largest_reward = f64::NEG_INFINITY;
        let mut policy = self.agent.policy(&self.scaling);
        self.evaluate(0)?;
        self.experience.reset(&mut self.moments);
        for step in 1..=steps {
            let random = step <= random_steps;
            let action = if random {
                self.random_action()
            } else {
                let limit = self.experience.spec().action_limit;
                let deviation = (self.config.exploration_noise * limit) as f32;
                let (obs, previous) = self.experience.state();
                policy.explore(obs, previous, deviation, &mut self.streams.exploration)
            };
            let reward = self.act(&action, step, monitor);
            if random {
                largest_reward = reward.map_or(largest_reward, |r| largest_reward.max(r));
            }
            let rescaled =
                self.config.scaling.enabled && step.is_multiple_of(self.config.scaling.every);
            if rescaled {
                let scaling = &self.config.scaling;
                self.scaling = self.moments.scaling(scaling.clip, scaling.deviation_floor);
            }

            let learned = self.learn(step)?;
            if step == random_steps {
                self.begin_phase_2(largest_reward);
                self.experience.reset(&mut self.moments);
            }
            if learned || (rescaled && !random) || step == random_steps {
                policy = self.agent.policy(&self.scaling);
            }

            if step.is_multiple_of(self.config.evaluation.every) {
                self.evaluate(step)?;
            }
            let stopped = stop.load(Ordering::Relaxed) && step < steps;
            if stopped || step == steps || step.is_multiple_of(self.config.checkpoint.every) {
                self.save("last", step)?;
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
    fn act(&mut self, action: &[f32], step: u64, monitor: &mut dyn Monitor) -> Option<f64> {
        let started = Instant::now();
        let mut sinks = Sinks {
            replay: &mut self.replay,
            moments: &mut self.moments,
            reservoir: self.probing.as_mut().map(|probing| &mut probing.reservoir),
        };
        let taken = self.experience.step(action, &mut sinks);
        self.clock.environment += started.elapsed();
        if let Some((episode_return, length)) = taken.ended {
            self.interval.episode(episode_return, length);
        }
        if taken.reward.is_none() {
            self.interval.diverged();
            monitor.note(&format!(
                "step {step}: the simulation diverged; the episode is truncated"
            ));
        }
        taken.reward
    }

    /// The learning of one step: the model alone in phase 1, everything in phase 2. Returns
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
        match not_finite {
            None => Ok(changed),
            Some(quantity) => Err(self.not_finite(step, quantity.to_owned())),
        }
    }

    fn not_finite(&self, step: u64, quantity: String) -> TrainError {
        TrainError::NotFinite {
            step,
            quantity,
            checkpoint: self.saved.clone(),
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
    fn begin_phase_2(&mut self, largest_reward: f64) {
        let settings = &self.config.imagination;
        let imagines = self.config.method.addition() == Addition::Imagination;
        if imagines && settings.optimism && largest_reward.is_finite() {
            let episode_limit = self.experience.spec().max_episode_steps as f64;
            let bias = largest_reward * episode_limit * settings.bias_factor;
            self.agent.set_optimism(bias as f32);
        }
    }

    /// Evaluates, writes a row of each curve, and saves the best policy so far.
    fn evaluate(&mut self, step: u64) -> Result<(), TrainError> {
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

        let path = self.directory.path().to_owned();
        let wrong = |error| TrainError::Curves { path, error };
        let clock = std::mem::replace(&mut self.clock, Clock::new(step));
        let mut write = || -> Result<(), csv::Error> {
            curves::write(&mut self.curves.eval, EvalRow::new(step, &evaluation))?;
            if step > 0 {
                curves::write(&mut self.curves.train, self.interval.take(step, &measured))?;
                curves::write(&mut self.curves.timing, clock.row(step, evaluation_time))?;
            }
            Ok(())
        };
        write().map_err(wrong)?;
        self.note_evaluation(step, &evaluation)
    }

    fn note_evaluation(&mut self, step: u64, evaluation: &Evaluation) -> Result<(), TrainError> {
        let return_mean = evaluation.return_mean();
        self.last_return = Some(return_mean);
        if self.best_return.is_none_or(|best| return_mean > best) {
            self.best_return = Some(return_mean);
            self.save("best", step)?;
        }
        Ok(())
    }

    fn save(&mut self, name: &str, step: u64) -> Result<(), TrainError> {
        let networks = self.agent.weights();
        if !self.scaling.is_finite() {
            return Err(self.not_finite(step, "the scaling of observations".to_owned()));
        }
        if let Some(array) = networks.not_finite() {
            return Err(self.not_finite(step, format!("the array `{array}`")));
        }
        let path = self.directory.checkpoint(name);
        Checkpoint::save(
            &path,
            &self.config,
            step,
            self.last_return,
            networks,
            &self.scaling,
        )?;
        self.saved = Some(path);
        Ok(())
    }
}

impl Clock {
    fn new(step: u64) -> Clock {
        Clock {
            since: Instant::now(),
            step,
            environment: Duration::ZERO,
            update: Duration::ZERO,
        }
    }

    fn row(&self, step: u64, evaluation: Duration) -> TimingRow {
        let seconds = self.since.elapsed().as_secs_f64();
        TimingRow {
            step,
            seconds,
            steps_per_second: (step - self.step) as f64 / seconds,
            environment_seconds: self.environment.as_secs_f64(),
            update_seconds: self.update.as_secs_f64(),
            evaluation_seconds: evaluation.as_secs_f64(),
        }
    }
}

/// What imagined steps are measured with: none for methods that imagine no other actions.
fn probing(config: &Config) -> Result<Option<Probing>, TrainError> {
    let states = config.telemetry.states;
    if config.method.addition() != Addition::Imagination || states == 0 {
        return Ok(None);
    }
    let rng = stream(config.seed, "telemetry");
    Ok(Some(Probing {
        reservoir: Reservoir::new(states, rng),
        env: config.env()?,
    }))
}

/// The agent that `config` describes, for a task with sizes `spec`, before its first update.
pub fn fresh_agent(config: &Config, spec: &Spec, rules: Arc<dyn Rules>) -> Agent {
    let device = config.compute.backend.device();
    Agent::new(
        config.agent(spec),
        spec.obs_size,
        spec.action_size,
        augmentation(config, spec, rules, &device),
        &mut stream(config.seed, "init"),
        &device,
    )
}

/// What the method of `config` adds to its base, with a fresh model.
fn augmentation(
    config: &Config,
    spec: &Spec,
    rules: Arc<dyn Rules>,
    device: &Device,
) -> Augmentation {
    let world = || {
        let shape = DynamicsShape {
            obs_size: spec.obs_size,
            action_size: spec.action_size,
            known: rules.known(),
            learns_reward: config.rules.reward == RewardSource::Learned,
        };
        let rng = &mut stream(config.seed, "init-model");
        let model = DynamicsModel::new(&config.model, shape, rng, device);
        World::new(model, Arc::clone(&rules))
    };
    match config.method.addition() {
        Addition::None => Augmentation::None,
        Addition::Imagination => Augmentation::Imagination(Imagination::new(
            &config.imagination,
            spec.action_limit,
            world(),
        )),
        Addition::Expansion => Augmentation::Expansion {
            world: world(),
            horizon: config.expansion.horizon,
        },
    }
}

/// The demonstrations that `config` asks for, none where their path is empty.
///
/// # Errors
/// When there are none at the path, or one is damaged or does not fit the task.
pub fn demonstrations(config: &Config) -> Result<Option<Demonstrations>, TrainError> {
    let path = &config.demonstrations.path;
    if path.is_empty() {
        return Ok(None);
    }
    let env = config.env()?;
    let spec = env.spec();
    let sizes = Sizes::of(spec);
    Ok(Some(Demonstrations::load(path, &sizes)?))
}

/// The segments beside the main episode, in an environment of their own.
fn side(config: &Config, demonstrations: Demonstrations) -> Result<Side, TrainError> {
    let seeded = |name| stream(config.seed, name);
    let settings = &config.demonstrations;
    Ok(Side::new(
        Runner::new(config.env()?, seeded("segment-env")),
        demonstrations,
        Segments::new(settings),
        settings.segment_steps,
        seeded("segments"),
    ))
}

#[cfg(test)]
mod tests;
