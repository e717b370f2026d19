//! Model-based value expansion (Feinberg et al. 2018): targets over imagined steps, every one of whose states trains
//! the critics.

use super::{Augment, Learned};
use crate::agent::Metrics;
use crate::agent::core::{ActorCritic, CriticRows, Inputs};
use crate::core::parallel::halves;
use crate::model::World;
use crate::nn::{Gradient, rows_of};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Model-based value expansion (Feinberg et al. 2018); used by the methods that expand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpansionSettings {
    /// Imagined steps after the real one.
    pub horizon: usize,
}

/// Value expansion in a learned world.
pub struct Expansion {
    learned: Learned,
    /// Imagined steps after the real one, at least 1.
    horizon: usize,
    last: Vec<RolloutStep>,
}

/// One step of the segments of a batch: the real one (the first), or an imagined one after it.
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutStep {
    /// What actor and critics see, `[n, width]`.
    pub observed: Vec<f32>,
    /// Executed actions, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Rewards, `[n]`.
    reward: Vec<f32>,
    /// Terminations, `[n]`, 1 or 0.
    terminated: Vec<f32>,
    /// Targets, `[n]`.
    pub y: Vec<f32>,
    /// 1 where the segment had not ended before, else 0, `[n]`: only those rows train.
    pub mask: Vec<f32>,
}

impl Expansion {
    /// Expansion over `settings.horizon` steps.
    pub fn new(settings: &ExpansionSettings, world: World, seed: u64) -> Expansion {
        Expansion {
            learned: Learned::new(world, seed),
            horizon: settings.horizon,
            last: Vec::new(),
        }
    }

    /// What the last update expanded: the `horizon + 1` steps.
    pub fn last(&self) -> &[RolloutStep] {
        &self.last
    }

    /// The world, to be given its batch.
    pub fn learned_mut(&mut self) -> &mut Learned {
        &mut self.learned
    }

    /// Rolls the policy through the world from the next states of the rows `range`, and backs the value at the end up
    /// through all steps: `y_H` from the target networks, then `y_t = r_t + gamma (1 - d_t) y_{t+1}`.
    fn expand(
        &self,
        core: &ActorCritic,
        inputs: &Inputs<'_>,
        range: Range<usize>,
    ) -> Vec<RolloutStep> {
        let (batch, so, sa) = (&inputs.sample.batch, core.obs_size, core.action_size);
        let coupling = &core.settings.coupling;
        let step = |observed, action, reward, terminated| RolloutStep {
            observed,
            action,
            reward,
            terminated,
            y: Vec::new(),
            mask: Vec::new(),
        };
        let mut steps = vec![step(
            rows_of(&inputs.observed, core.observed_width(), &range).to_vec(),
            rows_of(&batch.action, sa, &range).to_vec(),
            batch.reward[range.clone()].to_vec(),
            batch.terminated[range.clone()].to_vec(),
        )];
        let mut raw = rows_of(&batch.next_obs, so, &range).to_vec();
        let mut obs = inputs.scaling.scale(&raw);
        for _ in 0..self.horizon {
            let previous = &steps[steps.len() - 1].action;
            let observed = core.observe(&obs, previous);
            let mut action = core.output(&observed);
            coupling.execute_in_place(&mut action, previous);
            let world = &self.learned.world;
            let imagined = world.imagine(&raw, &obs, &action, inputs.scaling);
            steps.push(step(observed, action, imagined.reward, imagined.terminated));
            (raw, obs) = (imagined.raw, imagined.next_obs);
        }
        let last = &steps[steps.len() - 1].action;
        let noise = rows_of(&inputs.sample.next_noise, sa, &range);
        let mut value = core.bootstrap(&obs, last, noise).value;
        for step in steps.iter_mut().rev() {
            value = core.backup(&step.reward, &step.terminated, &value);
            step.y.clone_from(&value);
        }
        let mut mask = vec![1.0; value.len()];
        for step in &mut steps {
            step.mask.clone_from(&mask);
            for (mask, d) in mask.iter_mut().zip(&step.terminated) {
                *mask *= 1.0 - d;
            }
        }
        steps
    }
}

impl Augment for Expansion {
    fn learned(&self) -> Option<&Learned> {
        Some(&self.learned)
    }

    fn learned_mut(&mut self) -> Option<&mut Learned> {
        Some(&mut self.learned)
    }

    fn replaces_targets(&self) -> bool {
        true
    }

    fn augment(
        &mut self,
        core: &ActorCritic,
        inputs: &Inputs<'_>,
        gradient: Option<Gradient>,
        rows: &mut CriticRows,
        _: &mut Metrics,
    ) {
        if let Some(gradient) = gradient {
            self.learned.world.model.step(gradient);
        }
        let n = inputs.sample.batch.rows;
        let read = &*self;
        let [first, second] = halves(n, |range| read.expand(core, inputs, range));
        let joined = |(first, second): (RolloutStep, RolloutStep)| RolloutStep {
            observed: [first.observed, second.observed].concat(),
            action: [first.action, second.action].concat(),
            reward: [first.reward, second.reward].concat(),
            terminated: [first.terminated, second.terminated].concat(),
            y: [first.y, second.y].concat(),
            mask: [first.mask, second.mask].concat(),
        };
        self.last = first.into_iter().zip(second).map(joined).collect();

        // The loss is the mean over the steps, the real ones first.
        let (width, sa) = (core.observed_width(), core.action_size);
        let share = 1.0 / (n * self.last.len()) as f32;
        for step in &self.last {
            for i in (0..n).filter(|&i| step.mask[i] > 0.0) {
                let observed = &step.observed[i * width..][..width];
                let action = &step.action[i * sa..][..sa];
                let weight = share * inputs.sample.batch.weight(i);
                rows.push(observed, action, step.y[i], weight);
            }
        }
    }
}
