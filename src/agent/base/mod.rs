//! What the base algorithms differ in: the actor, the action that targets bootstrap from, and the
//! actor's step. Everything else of an agent is theirs in common.

mod deterministic;
mod gaussian;

pub(super) use deterministic::Deterministic;
pub(super) use gaussian::{Gaussian, sample_in_place};

use super::AgentSettings;
use super::critics::Critics;
use crate::nn::{Memory, Mlp, WeightError, Weights};
use burn::tensor::Device;

/// Rows on which an actor takes a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActorBatch<'a> {
    /// Number of rows.
    pub rows: usize,
    /// What actor and critics see, `[n, width]`.
    pub observed: &'a [f32],
    /// Previous executed actions, `[n, action_size]`.
    pub previous_action: &'a [f32],
    /// Standard normal draws, `[n, action_size]`, of stochastic policies.
    pub noise: &'a [f32],
}

/// The next action that a target is computed with.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NextOutput {
    /// The policy's output `u`, `[n, action_size]`, not yet coupled.
    pub output: Vec<f32>,
    /// What is subtracted from its value, `[n]`; nothing for deterministic policies.
    pub penalty: Option<Vec<f32>>,
}

/// What the step of a stochastic actor tells besides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EntropyFigures {
    /// Temperature before the step.
    pub temperature: f32,
    /// Loss of the temperature's step.
    pub temperature_loss: f32,
    /// Mean of the sampled actions' log-densities, in units of the action limit.
    pub log_density: f32,
}

/// What the step of an actor tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ActorFigures {
    /// The actor's loss before its step.
    pub loss: f32,
    /// Of stochastic actors.
    pub entropy: Option<EntropyFigures>,
}

/// The actor's side of an agent.
pub(super) trait Base: Send + Sync {
    /// The policy's deterministic output `u` for what it observes, row by row.
    fn output(&self, observed: &[f32]) -> Vec<f32>;

    /// The output that targets bootstrap from, in states observed as `observed`; `noise` is standard
    /// normal, `[n, action_size]`.
    fn next_output(&self, observed: &[f32], noise: &[f32]) -> NextOutput;

    /// One step of the actor towards actions that the critics value.
    fn step(&mut self, batch: ActorBatch<'_>, critics: &Critics) -> ActorFigures;

    /// Moves target networks of the actor, if there are any, towards it.
    fn polyak(&mut self, tau: f64);

    /// Adds all its networks to `weights`.
    fn save(&self, weights: &mut Weights);

    /// Remembers what training goes on from beside the networks.
    fn remember(&self, memory: &mut Memory);

    /// Goes on from what was remembered.
    fn restore(&mut self, memory: &Memory) -> Result<(), WeightError>;

    /// The actor's network.
    fn actor(&self) -> &Mlp;
}

/// A base with a fresh `actor`.
pub(super) fn fresh(settings: &AgentSettings, actor: Mlp, device: &Device) -> Box<dyn Base> {
    if settings.base.is_stochastic() {
        Box::new(Gaussian::new(settings, actor, device))
    } else {
        let target = actor.clone();
        Box::new(Deterministic::new(settings, actor, target, device))
    }
}

/// A base with saved networks.
pub(super) fn load(
    settings: &AgentSettings,
    widths: &[usize],
    weights: &Weights,
    device: &Device,
) -> Result<Box<dyn Base>, WeightError> {
    let actor = Mlp::load("actor", widths, weights)?;
    Ok(if settings.base.is_stochastic() {
        let log_temperature = weights.get("log_temperature", &[1])?[0];
        Box::new(Gaussian::new(settings, actor, device).at_log_temperature(log_temperature))
    } else {
        let target = Mlp::load("target_actor", widths, weights)?;
        Box::new(Deterministic::new(settings, actor, target, device))
    })
}
