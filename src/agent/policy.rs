//! What it takes to act: an actor, its observation scaling and the coupling of its actions.

use crate::nn::{Coupling, Mlp, ObservationScaling};
use crate::random::{Stream, fill_normal};

/// A policy that turns one observation into one executed action.
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    actor: Mlp,
    scaling: ObservationScaling,
    coupling: Coupling,
}

impl Policy {
    /// A policy of `actor` on scaled observations.
    pub fn new(actor: Mlp, scaling: ObservationScaling, coupling: Coupling) -> Policy {
        Policy {
            actor,
            scaling,
            coupling,
        }
    }

    /// The deterministic executed action in `obs` (as observed) after `previous`, the action
    /// executed before (0 after a reset).
    pub fn act(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let mut action = self.output(obs, previous);
        self.coupling.execute_in_place(&mut action, previous);
        action
    }

    /// As [`act`](Policy::act), with normal noise of the given `deviation` on the policy's output.
    pub fn explore(
        &self,
        obs: &[f32],
        previous: &[f32],
        deviation: f32,
        rng: &mut Stream,
    ) -> Vec<f32> {
        let mut noise = vec![0.0; previous.len()];
        fill_normal(rng, &mut noise);
        let mut action = self.output(obs, previous);
        for (u, z) in action.iter_mut().zip(noise) {
            *u += deviation * z;
        }
        self.coupling.execute_in_place(&mut action, previous);
        action
    }

    /// The policy's output `u`.
    fn output(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let scaled = self.scaling.scale(obs);
        let observed = self
            .coupling
            .observe(&scaled, previous, obs.len(), previous.len());
        let mut output = self.actor.forward(&observed);
        self.coupling.output_in_place(&mut output);
        output
    }
}
