//! What it takes to act: an actor, its observation scaling and the coupling of its actions.

use super::BaseAlgorithm;
use super::base::sample_in_place;
use crate::nn::{Coupling, Mlp, ObservationScaling};
use crate::random::{Stream, fill_normal};

/// A policy that turns one observation into one executed action.
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    actor: Mlp,
    base: BaseAlgorithm,
    scaling: ObservationScaling,
    coupling: Coupling,
}

impl Policy {
    /// A policy of `actor`, trained by `base`, on scaled observations.
    pub fn new(
        actor: Mlp,
        base: BaseAlgorithm,
        scaling: ObservationScaling,
        coupling: Coupling,
    ) -> Policy {
        Policy {
            actor,
            base,
            scaling,
            coupling,
        }
    }

    /// The deterministic executed action in `obs` (as observed) after `previous`, the action
    /// executed before (0 after a reset). A stochastic policy gives its mean.
    pub fn act(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let mut action = self.network(obs, previous);
        action.truncate(previous.len());
        self.coupling.output_in_place(&mut action);
        self.coupling.execute_in_place(&mut action, previous);
        action
    }

    /// As [`act`](Policy::act), with normal noise of the given `deviation` on the policy's output; a
    /// stochastic policy is sampled instead.
    pub fn explore(
        &self,
        obs: &[f32],
        previous: &[f32],
        deviation: f32,
        rng: &mut Stream,
    ) -> Vec<f32> {
        let mut noise = vec![0.0; previous.len()];
        fill_normal(rng, &mut noise);
        let mut action = self.network(obs, previous);
        if self.base.is_stochastic() {
            action = sample_in_place(&action, &noise, previous.len(), self.coupling, None);
        } else {
            self.coupling.output_in_place(&mut action);
            for (u, z) in action.iter_mut().zip(noise) {
                *u += deviation * z;
            }
        }
        self.coupling.execute_in_place(&mut action, previous);
        action
    }

    /// What the network says.
    fn network(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let scaled = self.scaling.scale(obs);
        let observed = self
            .coupling
            .observe(&scaled, previous, obs.len(), previous.len());
        self.actor.forward(&observed)
    }
}
