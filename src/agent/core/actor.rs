//! What the base algorithms differ in: the actor, the action that targets bootstrap from, and the actor's step.
//! Everything else of a core is theirs in common.

use super::critics::Critics;
use super::deterministic::Deterministic;
use super::gaussian::Gaussian;
use crate::agent::{AgentSettings, Metrics};
use crate::nn::{Architecture, LearningState, Mlp, WeightError, Weights};
use burn::tensor::Device;

/// Rows on which an actor takes a step.
#[derive(Debug, Clone, Copy)]
pub struct ActorBatch<'a> {
    /// Number of rows.
    pub rows: usize,
    /// What actor and critics see, `[n, width]`.
    pub observed: &'a [f32],
    /// Previous executed actions, `[n, action_size]`.
    pub previous_action: &'a [f32],
    /// Executed actions, `[n, action_size]`.
    pub action: &'a [f32],
    /// How many rows, the last ones, are recorded.
    pub recorded: usize,
    /// Mean of `|Q1|` over the rows, before the critics' step.
    pub value_scale: f32,
    /// Standard normal draws, `[n, action_size]`, of stochastic policies.
    pub noise: &'a [f32],
}

/// The next action that a target is computed with.
#[derive(Debug, Clone, PartialEq)]
pub struct NextOutput {
    /// The policy's output `u`, `[n, action_size]`, not yet coupled.
    pub output: Vec<f32>,
    /// What is added to its value for the policy's entropy, `[n]`; nothing for deterministic policies.
    pub entropy_bonus: Option<Vec<f32>>,
}

/// An actor with its target, if it has one, and its optimiser.
pub trait Actor: Send + Sync {
    /// The policy's deterministic output `u` for what it observes, row by row.
    fn output(&self, observed: &[f32]) -> Vec<f32>;

    /// The output that targets bootstrap from, in states observed as `observed`; `noise` is standard
    /// normal, `[n, action_size]`.
    fn next_output(&self, observed: &[f32], noise: &[f32]) -> NextOutput;

    /// One step of the actor towards actions that the critics value; tells `actor_loss`, the loss before it.
    fn step(&mut self, batch: ActorBatch<'_>, critics: &Critics, metrics: &mut Metrics);

    /// Moves the actor's target, if there is one, the fraction `tau` of the way towards it.
    fn move_target(&mut self, tau: f64);

    /// Adds all its networks to `weights`.
    fn save(&self, weights: &mut Weights);

    /// Whether all parameters and second moments have been finite after every step.
    fn is_finite(&self) -> bool;

    /// Saves what training goes on from beside the networks.
    fn save_state(&self, state: &mut LearningState);

    /// Goes on from what was saved.
    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError>;

    /// The actor's network.
    fn network(&self) -> &Mlp;
}

/// A fresh actor of this network.
pub(super) fn fresh(settings: &AgentSettings, actor: Mlp, device: &Device) -> Box<dyn Actor> {
    if settings.base.is_stochastic() {
        Box::new(Gaussian::new(settings, actor, device))
    } else {
        let target = actor.clone();
        Box::new(Deterministic::new(settings, actor, target, device))
    }
}

/// An actor with saved networks.
pub(super) fn load(
    settings: &AgentSettings,
    architecture: &Architecture,
    weights: &Weights,
    device: &Device,
) -> Result<Box<dyn Actor>, WeightError> {
    let actor = Mlp::load("actor", architecture, weights)?;
    Ok(if settings.base.is_stochastic() {
        let log_temperature = weights.get("log_temperature", &[1])?[0];
        Box::new(Gaussian::new(settings, actor, device).at_log_temperature(log_temperature))
    } else {
        let target = Mlp::load("target_actor", architecture, weights)?;
        Box::new(Deterministic::new(settings, actor, target, device))
    })
}
