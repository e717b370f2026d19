//! The published optimiser of the hand tasks: truncation selection with sparse mutation.

use super::PlannerSettings;
use super::strategy::{Best, Sequences, Shape, Strategy, ranked};
use crate::core::random::Stream;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

/// Truncation selection: the best twentieth of the sequences is copied and each copy is changed in some of its numbers
/// (the published code's `planner.py`; Charlesworth and Montana 2021).
pub(super) struct Topdm {
    settings: PlannerSettings,
    shape: Shape,
    best: Best,
    /// The best sequences of the iteration before.
    elites: Vec<Vec<f32>>,
}

impl Topdm {
    pub fn new(settings: PlannerSettings, shape: Shape) -> Topdm {
        Topdm {
            settings,
            shape,
            best: Best::default(),
            elites: Vec::new(),
        }
    }

    /// Each number changes with the probability of a mutation. Draws a uniform number for each, and a normal one for
    /// each that changes.
    fn mutate(&self, sequence: &mut [f32], rng: &mut Stream) {
        let deviation = self.settings.mutation_noise as f32;
        for x in sequence.iter_mut() {
            let u: f64 = rng.random();
            if u < self.settings.mutation_probability {
                let z: f32 = StandardNormal.sample(rng);
                *x += deviation * z;
            }
        }
        self.shape.clip(sequence);
    }

    fn fresh(&self, numbers: &mut [f32], rng: &mut Stream) {
        let deviation = self.settings.noise as f32;
        for x in numbers.iter_mut() {
            let z: f32 = StandardNormal.sample(rng);
            *x = deviation * z;
        }
        self.shape.clip(numbers);
    }
}

impl Strategy for Topdm {
    fn begin(&mut self) {
        self.best.clear();
        self.elites.clear();
    }

    /// Of nominally n, `n/2 + 2n (1 - t/(T/2))` in the first half of an episode of T steps, then `n/2`.
    fn iterations(&self, step: usize) -> usize {
        let (n, t) = (self.settings.iterations as f64, step as f64);
        let half = self.shape.episode as f64 / 2.0;
        let more = 2.0 * n * (1.0 - t / half).max(0.0);
        ((n / 2.0 + more) as usize).max(1)
    }

    fn propose(&mut self, iteration: usize, rng: &mut Stream) -> Sequences {
        let (numbers, samples) = (self.shape.numbers(), self.settings.samples);
        let mut sequences = vec![0.0; samples * numbers];
        for (i, sequence) in sequences.chunks_exact_mut(numbers).enumerate() {
            if iteration > 0 {
                sequence.copy_from_slice(&self.elites[i % self.elites.len()]);
                self.mutate(sequence, rng);
            } else if self.best.is_known() {
                let planned = numbers - self.shape.action_size;
                sequence.copy_from_slice(&self.best.sequence);
                self.mutate(&mut sequence[..planned], rng);
                self.fresh(&mut sequence[planned..], rng);
            } else {
                self.fresh(sequence, rng);
            }
        }
        sequences
    }

    fn learn(&mut self, iteration: usize, sequences: &[f32], scores: &[f64]) {
        let numbers = self.shape.numbers();
        if iteration == 0 {
            self.best.restart();
        }
        self.best.see(numbers, sequences, scores);
        let kept = self.settings.elites.min(scores.len());
        let sequence = |i: usize| sequences[i * numbers..][..numbers].to_vec();
        self.elites = ranked(scores)
            .into_iter()
            .take(kept)
            .map(sequence)
            .collect();
    }

    fn decision(&self) -> &[f32] {
        &self.best.sequence
    }

    fn advance(&mut self, _: &mut Stream) {
        // The end is drawn anew for each sample.
        let last = vec![0.0; self.shape.action_size];
        self.shape.shift(&mut self.best.sequence, &last);
    }

    fn another(&self) -> Box<dyn Strategy> {
        Box::new(Topdm::new(self.settings.clone(), self.shape))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Method};
    use crate::core::random::stream;

    const SHAPE: Shape = Shape {
        horizon: 4,
        action_size: 2,
        episode: 100,
    };
    const NUMBERS: usize = 8;

    fn settings() -> PlannerSettings {
        PlannerSettings {
            samples: 20,
            elites: 4,
            iterations: 3,
            noise: 0.9,
            ..Config::preset(Method::Td3).planner
        }
    }

    /// Best where every number is as far along as its index says.
    fn score(sequence: &[f32]) -> f64 {
        let error = |(i, x): (usize, &f32)| (f64::from(*x) - i as f64 / 8.0).powi(2);
        -sequence.iter().enumerate().map(error).sum::<f64>()
    }

    /// The decision as the published code makes it, written down once more: candidates are made one after the other
    /// from the parents, judged, and cut to the best.
    fn reference(last: Option<&[f32]>, iterations: usize, rng: &mut Stream) -> Vec<f32> {
        let normal = |rng: &mut Stream| -> f32 { StandardNormal.sample(rng) };
        let mut parents: Vec<Vec<f32>> = Vec::new();
        let mut best: Option<(f64, Vec<f32>)> = None;
        for iteration in 0..iterations {
            let mut candidates: Vec<Vec<f32>> = Vec::new();
            for n in 0..20 {
                let mut candidate = Vec::new();
                let parent = match (iteration, last) {
                    (0, None) => None,
                    (0, Some(last)) => Some(last[2..].to_vec()),
                    _ => Some(parents[n % 4].clone()),
                };
                for i in 0..NUMBERS {
                    match parent.as_ref().and_then(|parent| parent.get(i)) {
                        Some(x) => {
                            let change: f64 = rng.random();
                            let z = if change < 0.3 { 0.3 * normal(rng) } else { 0.0 };
                            candidate.push((x + z).clamp(-1.0, 1.0));
                        }
                        None => candidate.push((0.9 * normal(rng)).clamp(-1.0, 1.0)),
                    }
                }
                candidates.push(candidate);
            }
            candidates.sort_by(|a, b| score(b).total_cmp(&score(a)));
            candidates.truncate(4);
            let first = (score(&candidates[0]), candidates[0].clone());
            if best.as_ref().is_none_or(|(old, _)| first.0 > *old) {
                best = Some(first);
            }
            parents = candidates;
        }
        best.unwrap().1
    }

    #[test]
    fn decisions_are_those_of_the_published_optimiser_to_the_bit() {
        let (mut ours, mut theirs) = (stream(1, "planner"), stream(1, "planner"));
        let mut topdm = Topdm::new(settings(), SHAPE);
        topdm.begin();
        let mut last: Option<Vec<f32>> = None;
        for step in [0, 1, 70] {
            let iterations = topdm.iterations(step);
            for iteration in 0..iterations {
                let sequences = topdm.propose(iteration, &mut ours);
                let scores: Vec<f64> = sequences.chunks_exact(NUMBERS).map(score).collect();
                topdm.learn(iteration, &sequences, &scores);
            }
            let expected = reference(last.as_deref(), iterations, &mut theirs);
            assert_eq!(topdm.decision(), expected, "step {step}");
            last = Some(expected);
            topdm.advance(&mut ours);
        }
    }

    #[test]
    fn iterations_fall_over_the_first_half_of_an_episode() {
        let settings = PlannerSettings {
            iterations: 80,
            ..settings()
        };
        let topdm = Topdm::new(settings, SHAPE);
        let at = |step| topdm.iterations(step);
        assert_eq!([at(0), at(25), at(50), at(99)], [200, 120, 40, 40]);
    }
}
