//! Ways of making sequences of actions better.

use super::icem::Icem;
use super::mppi::Mppi;
use super::sampling::Sampling;
use super::topdm::Topdm;
use super::{PlannerMethod, PlannerSettings};
use crate::core::random::Stream;

/// Sizes of a sequence of actions, before the coupling: numbers from -1 to 1, in units of each range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Control steps.
    pub horizon: usize,
    /// Numbers of an action.
    pub action_size: usize,
    /// Control steps of an episode.
    pub episode: usize,
}

impl Shape {
    /// Numbers of a sequence.
    pub fn numbers(&self) -> usize {
        self.horizon * self.action_size
    }

    /// `sequence` a step later: its first action is gone, and `last` fills the end.
    pub fn shift(&self, sequence: &mut [f32], last: &[f32]) {
        sequence.copy_within(self.action_size.., 0);
        let end = sequence.len() - self.action_size;
        sequence[end..].copy_from_slice(last);
    }

    /// Brings every number within the range.
    pub fn clip(&self, numbers: &mut [f32]) {
        for x in numbers {
            *x = x.clamp(-1.0, 1.0);
        }
    }
}

/// Sequences of actions, one after the other, `[n, horizon, action_size]`.
pub type Sequences = Vec<f32>;

/// A way of making sequences of actions, better and better ones. It knows of the task but how its sequences were
/// judged: higher is better, and minus infinity is worst.
pub trait Strategy: Send {
    /// An episode begins: nothing is known of it.
    fn begin(&mut self);

    /// How often sequences are made for the decision at control step `step` of an episode; at least once.
    fn iterations(&self, step: usize) -> usize;

    /// Sequences to be tried out in the iteration number `iteration` of this decision, from 0.
    fn propose(&mut self, iteration: usize, rng: &mut Stream) -> Sequences;

    /// What became of them.
    fn learn(&mut self, iteration: usize, sequences: &[f32], scores: &[f64]);

    /// The sequence whose first action is to be executed, `[horizon, action_size]`.
    fn decision(&self) -> &[f32];

    /// A step was taken: what is planned begins a step later.
    fn advance(&mut self, rng: &mut Stream);

    /// Another one of the same settings that knows nothing yet.
    fn another(&self) -> Box<dyn Strategy>;
}

/// The strategy of `settings` for sequences of `shape`.
pub(super) fn of(settings: &PlannerSettings, shape: Shape) -> Box<dyn Strategy> {
    let settings = settings.clone();
    match settings.method {
        PlannerMethod::Icem => Box::new(Icem::new(settings, shape)),
        PlannerMethod::Topdm => Box::new(Topdm::new(settings, shape)),
        PlannerMethod::Mppi => Box::new(Mppi::new(settings, shape)),
        PlannerMethod::Sampling => Box::new(Sampling::new(settings, shape)),
    }
}

/// Iterations at `step`: more at the first one, where nothing is planned yet.
pub(super) fn iterations(settings: &PlannerSettings, step: usize) -> usize {
    if step == 0 {
        settings.first_iterations
    } else {
        settings.iterations
    }
}

/// The best sequence that a decision has seen.
#[derive(Debug, Clone, Default)]
pub(super) struct Best {
    pub sequence: Vec<f32>,
    score: Option<f64>,
}

impl Best {
    /// Forgets the scores, which were of an earlier state, and keeps the sequence.
    pub fn restart(&mut self) {
        self.score = None;
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        *self = Best::default();
    }

    /// Whether there is a sequence, if of an earlier decision.
    pub fn is_known(&self) -> bool {
        !self.sequence.is_empty()
    }

    /// Takes the best of `sequences` if it is better than what there is; of equals the first one.
    pub fn see(&mut self, numbers: usize, sequences: &[f32], scores: &[f64]) {
        for (sequence, score) in sequences.chunks_exact(numbers).zip(scores) {
            if self.score.is_none_or(|best| *score > best) {
                self.score = Some(*score);
                self.sequence = sequence.to_vec();
            }
        }
    }
}

/// Numbers of the sequences from the best score to the worst; of equals the first one comes first.
pub(super) fn ranked(scores: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]));
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Method};
    use crate::core::random::stream;

    const SHAPE: Shape = Shape {
        horizon: 6,
        action_size: 2,
        episode: 50,
    };

    /// Where the best sequence of the first decision is; a step later it begins with the second action.
    fn target(step: usize) -> Vec<f32> {
        let number = |i: usize| 0.7 * (0.4 * (i + 2 * step) as f32).sin();
        (0..SHAPE.numbers()).map(number).collect()
    }

    fn distance(sequence: &[f32], step: usize) -> f64 {
        let pairs = sequence.iter().zip(target(step));
        pairs.map(|(x, y)| f64::from(x - y).powi(2)).sum()
    }

    #[test]
    fn every_strategy_gets_better_with_iterations_and_steps_and_keeps_the_range() {
        for method in [
            PlannerMethod::Icem,
            PlannerMethod::Topdm,
            PlannerMethod::Mppi,
            PlannerMethod::Sampling,
        ] {
            let settings = PlannerSettings {
                method,
                samples: 60,
                iterations: 3,
                first_iterations: 8,
                elites: 6,
                noise: 0.3,
                ..Config::preset(Method::Td3).planner
            };
            let mut strategy = of(&settings, SHAPE).another();
            let mut rng = stream(3, "planner");
            strategy.begin();
            let mut far = Vec::new();
            for step in 0..6 {
                for iteration in 0..strategy.iterations(step) {
                    let sequences = strategy.propose(iteration, &mut rng);
                    assert!(sequences.iter().all(|x| x.abs() <= 1.0));
                    let each = sequences.chunks_exact(SHAPE.numbers());
                    let scores: Vec<f64> = each.map(|s| -distance(s, step)).collect();
                    strategy.learn(iteration, &sequences, &scores);
                }
                assert_eq!(strategy.decision().len(), SHAPE.numbers());
                far.push(distance(strategy.decision(), step));
                strategy.advance(&mut rng);
            }
            let nothing = distance(&vec![0.0; SHAPE.numbers()], 0);
            assert!(far[0] < 0.6 * nothing, "{method:?}: {far:?} of {nothing}");
            assert!(far[5] < 0.6 * nothing, "{method:?}: {far:?} of {nothing}");
        }
    }

    #[test]
    fn failures_are_ranked_last_and_never_the_best_of_others() {
        let scores = [1.0, f64::NEG_INFINITY, 3.0, 3.0];
        assert_eq!(ranked(&scores), [2, 3, 0, 1]);
        let mut best = Best::default();
        best.see(1, &[5.0, 6.0, 7.0, 8.0], &scores);
        assert_eq!(best.sequence, [7.0]);
        best.see(1, &[9.0], &[3.0]);
        assert_eq!(best.sequence, [7.0]);
        best.restart();
        best.see(1, &[9.0], &[-3.0]);
        assert_eq!(best.sequence, [9.0]);
    }
}
