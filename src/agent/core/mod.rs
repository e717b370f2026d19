//! Actor and critics with their targets, and one update of both: targets (equation 4), the critics' step (equation 10),
//! and when the actor and the targets follow. The actor's own half of it is its file: `deterministic.rs` of TD3 and DDPG,
//! `gaussian.rs` of SAC.

mod actor;
mod critics;
mod deterministic;
mod gaussian;

pub use actor::{Actor, ActorBatch, NextOutput};
pub use critics::{CriticRows, Critics, Stepped};
pub(super) use gaussian::sample_in_place;

use super::{AgentSettings, Metrics, Sample, TargetValue, Update};
use crate::core::parallel::join;
use crate::core::random::Stream;
use crate::nn::{
    LearningState, Mlp, ObservationScaling, WeightError, Weights, rows_of, side_by_side,
};
use burn::tensor::{Device, Tensor};
use std::ops::Range;

/// An actor, its critics and their target networks: TD3, DDPG or SAC.
pub struct ActorCritic {
    pub(super) settings: AgentSettings,
    pub(super) obs_size: usize,
    pub(super) action_size: usize,
    actor: Box<dyn Actor>,
    critics: Critics,
    /// Updates of actor and critics so far.
    updates: u64,
}

/// Values by the target critics.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    /// The smaller one of both critics', or the only one's, `[n]`.
    pub value: Vec<f32>,
    /// `|Q1' - Q2'|`, `[n]`; zeros with one critic.
    pub disagreement: Vec<f32>,
}

/// A sample as networks see it.
pub struct Inputs<'a> {
    /// Transitions and noise.
    pub sample: &'a Sample,
    /// How observations are scaled.
    pub scaling: &'a ObservationScaling,
    /// Observations of the batch, scaled, `[n, obs_size]`.
    pub obs: Vec<f32>,
    /// What actor and critics see of them: also the previous actions, where these matter, `[n, width]`.
    pub observed: Vec<f32>,
}

impl ActorCritic {
    /// Fresh networks drawn from `rng`, trained on `device`.
    pub fn new(
        settings: AgentSettings,
        obs_size: usize,
        action_size: usize,
        rng: &mut Stream,
        device: &Device,
    ) -> ActorCritic {
        let actor = Mlp::new(&settings.actor(obs_size, action_size), rng);
        let actor = actor::fresh(&settings, actor, device);
        ActorCritic::with_actor(settings, obs_size, action_size, actor, rng, device)
    }

    /// The same around an actor of one's own.
    pub fn with_actor(
        settings: AgentSettings,
        obs_size: usize,
        action_size: usize,
        actor: Box<dyn Actor>,
        rng: &mut Stream,
        device: &Device,
    ) -> ActorCritic {
        let critic = settings.critic(obs_size, action_size);
        ActorCritic {
            critics: Critics::new(&settings, &critic, rng, device),
            actor,
            settings,
            obs_size,
            action_size,
            updates: 0,
        }
    }

    /// Saved networks, without their optimisers' moments.
    ///
    /// # Errors
    /// When an array is missing or has another shape than the settings say.
    pub fn load(
        settings: AgentSettings,
        obs_size: usize,
        action_size: usize,
        weights: &Weights,
        device: &Device,
    ) -> Result<ActorCritic, WeightError> {
        let actor = settings.actor(obs_size, action_size);
        let critic = settings.critic(obs_size, action_size);
        Ok(ActorCritic {
            actor: actor::load(&settings, &actor, weights, device)?,
            critics: Critics::load(&settings, &critic, weights, device)?,
            settings,
            obs_size,
            action_size,
            updates: 0,
        })
    }

    /// `sample` under `scaling`, as networks see it.
    pub fn inputs<'a>(&self, sample: &'a Sample, scaling: &'a ObservationScaling) -> Inputs<'a> {
        let obs = scaling.scale(&sample.batch.obs);
        Inputs {
            observed: self.observe(&obs, &sample.batch.previous_action),
            obs,
            sample,
            scaling,
        }
    }

    /// Targets `y = r + gamma (1 - d) min(Q1', Q2')(s', a')` of the real transitions in the rows `range`, `a'` being
    /// the target policy's smoothed and coupled action (equation 4).
    pub fn real_targets(&self, inputs: &Inputs<'_>, range: Range<usize>) -> Vec<f32> {
        let (batch, sa) = (&inputs.sample.batch, self.action_size);
        let next = rows_of(&batch.next_obs, self.obs_size, &range);
        let next = inputs.scaling.scale(next);
        let action = rows_of(&batch.action, sa, &range);
        let noise = rows_of(&inputs.sample.next_noise, sa, &range);
        let values = self.bootstrap(&next, action, noise);
        let (reward, terminated) = (&batch.reward[range.clone()], &batch.terminated[range]);
        self.backup(reward, terminated, &values.value)
    }

    /// Target critics at the policy's next action in `next_obs` (scaled, `[n, obs_size]`), reached by `action`;
    /// `noise` is standard normal, `[n, action_size]` both. The entropy's share of the value is in it.
    pub fn bootstrap(&self, next_obs: &[f32], action: &[f32], noise: &[f32]) -> Values {
        let coupling = &self.settings.coupling;
        let observed = self.observe(next_obs, action);
        let next = self.actor.next_output(&observed, noise);
        let mut next_action = next.output;
        coupling.execute_in_place(&mut next_action, action);
        let input = self.critic_input(&observed, &next_action);
        let joined = match self.settings.target_value {
            TargetValue::Minimum => f32::min,
            TargetValue::Mean => |a: f32, b: f32| 0.5 * (a + b),
        };
        // min(Q1', Q2'), or the only one.
        let mut values = match self.critics.target_values(&input).as_slice() {
            [first, second] => Values {
                value: first
                    .iter()
                    .zip(second)
                    .map(|(a, b)| joined(*a, *b))
                    .collect(),
                disagreement: first
                    .iter()
                    .zip(second)
                    .map(|(a, b)| (a - b).abs())
                    .collect(),
            },
            said => Values {
                disagreement: vec![0.0; said[0].len()],
                value: said[0].clone(),
            },
        };
        let bonuses = next.entropy_bonus.iter().flatten();
        for (value, bonus) in values.value.iter_mut().zip(bonuses) {
            *value += bonus;
        }
        values
    }

    /// `r + gamma (1 - d) value`, `[n]` each.
    pub fn backup(&self, reward: &[f32], terminated: &[f32], value: &[f32]) -> Vec<f32> {
        let discount = self.settings.discount as f32;
        let rows = reward.iter().zip(terminated).zip(value);
        rows.map(|((r, d), v)| r + discount * (1.0 - d) * v)
            .collect()
    }

    /// One step of each critic on `rows`, of which the first are the real transitions of a batch of `real` (equation
    /// 10; Algorithm 1, line 22).
    pub fn step_critics(&mut self, rows: CriticRows, real: usize, mut metrics: Metrics) -> Update {
        // The weights hold 1/N of the real rows, and whatever the augmentation gave its own.
        let loss = |q: Tensor<2>, y: Tensor<2>, weight: Tensor<2>| {
            let error = q - y;
            (error.clone() * error * weight).sum()
        };
        let stepped = self.critics.step(rows, real, loss);
        let losses = stepped.losses.iter().map(|loss| f64::from(*loss));
        metrics.set("critic_loss", losses.sum::<f64>());
        let values = &stepped.values[..real];
        let mean = |sum: f32| sum / real as f32;
        metrics.set("q_mean", mean(values.iter().sum()));
        let value_scale = mean(values.iter().map(|q| q.abs()).sum());
        Update {
            critic_losses: stepped.losses,
            errors: stepped.errors,
            value_scale,
            actor_changed: false,
            metrics,
        }
    }

    /// Counts an update; every `policy_delay` of them the actor takes a step up `Q1`, and the targets move when they
    /// are due (lines 23 to 26).
    pub fn step_actor_if_due(&mut self, sample: &Sample, observed: &[f32], update: &mut Update) {
        self.updates += 1;
        if self.updates.is_multiple_of(self.settings.policy_delay) {
            let batch = ActorBatch {
                rows: sample.batch.rows,
                observed,
                previous_action: &sample.batch.previous_action,
                action: &sample.batch.action,
                recorded: sample.batch.recorded,
                value_scale: update.value_scale,
                noise: &sample.actor_noise,
            };
            self.actor.step(batch, &self.critics, &mut update.metrics);
            update.actor_changed = true;
        }
        let due = self
            .settings
            .targets
            .due(self.updates, self.settings.policy_delay);
        if let Some(tau) = due {
            let (actor, critics) = (&mut self.actor, &mut self.critics);
            join(|| actor.move_target(tau), || critics.move_targets(tau));
        }
    }

    /// Optimistic start: `bias` becomes the output bias of all critics and their targets (equation 6). To be used
    /// once, before the first update.
    pub fn set_optimism(&mut self, bias: f32) {
        self.critics.set_output_bias(bias);
    }

    /// The policy's deterministic output `u` for what it observes, `[n, action_size]`, not yet coupled.
    pub fn output(&self, observed: &[f32]) -> Vec<f32> {
        self.actor.output(observed)
    }

    /// The actor's network.
    pub fn actor(&self) -> &Mlp {
        self.actor.network()
    }

    /// What actor and critics see of scaled observations and previous actions, row by row.
    pub fn observe(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        self.settings
            .coupling
            .observe(obs, previous, self.obs_size, self.action_size)
    }

    /// Numbers that [`observe`](ActorCritic::observe) gives a row.
    pub fn observed_width(&self) -> usize {
        self.settings
            .coupling
            .observed_width(self.obs_size, self.action_size)
    }

    fn critic_input(&self, observed: &[f32], action: &[f32]) -> Vec<f32> {
        side_by_side(&[
            (observed, self.observed_width()),
            (action, self.action_size),
        ])
    }

    /// `Q1` of executed actions, row by row; observations not scaled.
    pub fn q(
        &self,
        obs: &[f32],
        previous_action: &[f32],
        action: &[f32],
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let observed = self.observe(&scaling.scale(obs), previous_action);
        let input = self.critic_input(&observed, action);
        self.critics.first().mlp().forward(&input)
    }

    /// `Q1` of the deterministic policy's actions, row by row; observations not scaled.
    pub fn value(
        &self,
        obs: &[f32],
        previous_action: &[f32],
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let observed = self.observe(&scaling.scale(obs), previous_action);
        let mut action = self.output(&observed);
        let coupling = &self.settings.coupling;
        coupling.execute_in_place(&mut action, previous_action);
        self.q(obs, previous_action, &action, scaling)
    }

    /// Output biases of all critics, then of their targets: what an optimistic start sets.
    pub fn output_biases(&self) -> Vec<f32> {
        self.critics.output_biases()
    }

    /// Adds all networks to `weights`.
    pub fn save(&self, weights: &mut Weights) {
        self.actor.save(weights);
        self.critics.save(weights);
    }

    /// Name of a network of which a parameter, or its second moment, was not finite after some step.
    pub fn not_finite(&self) -> Option<&'static str> {
        if !self.actor.is_finite() {
            return Some("actor");
        }
        (!self.critics.are_finite()).then_some("critics")
    }

    /// Saves what learning goes on from beside the networks.
    pub fn save_state(&self, state: &mut LearningState) {
        state.set("updates", self.updates as f64);
        self.actor.save_state(state);
        self.critics.save_state(state);
    }

    /// Goes on from what was saved.
    ///
    /// # Errors
    /// When something is missing or has another shape than the settings say.
    pub fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.updates = state.count("updates")?;
        self.actor.restore(state)?;
        self.critics.restore(state)
    }
}
