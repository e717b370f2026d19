//! Model-based value expansion (Feinberg et al. 2018): targets over imagined steps, every one of whose
//! states trains the critics.

use super::agent::Seen;
use super::critics::CriticRows;
use super::{Agent, Sample};
use crate::imagination::World;
use crate::nn::{ObservationScaling, rows_of};
use crate::parallel::halves;
use std::ops::Range;

/// The expansion of a batch: the real step (position 0) and the imagined ones that follow it.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpandedTargets {
    /// The positions, `horizon + 1`.
    pub positions: Vec<Position>,
}

/// One position of the segments of a batch.
#[derive(Debug, Clone, PartialEq)]
pub struct Position {
    /// What actor and critics see, `[n, width]`.
    pub observed: Vec<f32>,
    /// Executed actions, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Targets, `[n]`.
    pub y: Vec<f32>,
    /// 1 where the segment had not ended before, else 0, `[n]`: only those rows train.
    pub alive: Vec<f32>,
}

/// A position under way: what happens there, before the targets are known.
struct Taken {
    observed: Vec<f32>,
    action: Vec<f32>,
    reward: Vec<f32>,
    terminated: Vec<f32>,
}

impl Agent {
    /// Rolls the policy `horizon` steps through `world` from the next states of the batch, and backs the
    /// value at the end up through all positions.
    pub(super) fn expanded_targets(
        &self,
        world: &World,
        horizon: usize,
        seen: &Seen<'_>,
        observed: &[f32],
    ) -> ExpandedTargets {
        let (sample, scaling) = (seen.sample, seen.scaling);
        let half =
            |range: Range<usize>| self.expand(world, horizon, sample, observed, range, scaling);
        let [first, second] = halves(sample.batch.rows, half);
        let join = |(first, second): (Position, Position)| Position {
            observed: [first.observed, second.observed].concat(),
            action: [first.action, second.action].concat(),
            y: [first.y, second.y].concat(),
            alive: [first.alive, second.alive].concat(),
        };
        ExpandedTargets {
            positions: first.into_iter().zip(second).map(join).collect(),
        }
    }

    /// The positions of the rows `range`.
    fn expand(
        &self,
        world: &World,
        horizon: usize,
        sample: &Sample,
        observed: &[f32],
        range: Range<usize>,
        scaling: &ObservationScaling,
    ) -> Vec<Position> {
        let (batch, so, sa) = (&sample.batch, self.obs_size, self.action_size);
        let width = observed.len() / batch.rows;
        let coupling = self.settings.coupling;
        let mut taken = vec![Taken {
            observed: rows_of(observed, width, &range).to_vec(),
            action: rows_of(&batch.action, sa, &range).to_vec(),
            reward: batch.reward[range.clone()].to_vec(),
            terminated: batch.terminated[range.clone()].to_vec(),
        }];
        let mut raw = rows_of(&batch.next_obs, so, &range).to_vec();
        let mut obs = scaling.scale(&raw);
        for _ in 0..horizon {
            let previous = &taken[taken.len() - 1].action;
            let observed = self.observe(&obs, previous);
            let mut action = self.base.output(&observed);
            coupling.execute_in_place(&mut action, previous);
            let imagined = world.imagine(&raw, &obs, &action, scaling);
            taken.push(Taken {
                observed,
                action,
                reward: imagined.reward,
                terminated: imagined.terminated,
            });
            (raw, obs) = (imagined.raw, imagined.next_obs);
        }
        let last = &taken[taken.len() - 1].action;
        let values = self.bootstrap(&obs, last, rows_of(&sample.smoothing, sa, &range));
        self.back_up(taken, values.value)
    }

    /// Targets from the end to the beginning, and from the beginning on which rows are alive.
    fn back_up(&self, taken: Vec<Taken>, mut value: Vec<f32>) -> Vec<Position> {
        let mut positions = Vec::with_capacity(taken.len());
        let mut ends = Vec::with_capacity(taken.len());
        for position in taken.into_iter().rev() {
            value = self.backup(&position.reward, &position.terminated, &value);
            positions.push(Position {
                observed: position.observed,
                action: position.action,
                alive: vec![1.0; value.len()],
                y: value.clone(),
            });
            ends.push(position.terminated);
        }
        positions.reverse();
        ends.reverse();
        for t in 1..positions.len() {
            let before = positions[t - 1].alive.iter().zip(&ends[t - 1]);
            positions[t].alive = before.map(|(alive, d)| alive * (1.0 - d)).collect();
        }
        positions
    }
}

impl ExpandedTargets {
    /// The rows of all positions that are alive. The loss is the mean over the positions.
    pub(super) fn rows(&self) -> CriticRows {
        let mut rows = CriticRows::default();
        for position in &self.positions {
            let n = position.y.len();
            let (width, sa) = (position.observed.len() / n, position.action.len() / n);
            let weight = 1.0 / (n * self.positions.len()) as f32;
            for i in (0..n).filter(|&i| position.alive[i] > 0.0) {
                let observed = &position.observed[i * width..][..width];
                let action = &position.action[i * sa..][..sa];
                rows.push(observed, action, position.y[i], weight);
            }
        }
        rows
    }
}
