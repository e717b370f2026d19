//! Predictive sampling.

use super::PlannerSettings;
use super::knots::spline;
use super::strategy::{Best, Sequences, Shape, Strategy, iterations};
use crate::core::random::Stream;
use rand_distr::{Distribution, StandardNormal};

/// Predictive sampling (Howell et al. 2022): the best so far stays, others are made by noise on knots added to it.
pub(super) struct Sampling {
    settings: PlannerSettings,
    shape: Shape,
    best: Best,
}

impl Sampling {
    pub fn new(settings: PlannerSettings, shape: Shape) -> Sampling {
        Sampling {
            settings,
            shape,
            best: Best::default(),
        }
    }
}

impl Strategy for Sampling {
    fn begin(&mut self) {
        self.best.clear();
    }

    fn iterations(&self, step: usize) -> usize {
        iterations(&self.settings, step)
    }

    fn propose(&mut self, _: usize, rng: &mut Stream) -> Sequences {
        let numbers = self.shape.numbers();
        let (deviation, knots) = (
            self.settings.noise as f32,
            self.settings.knots * self.shape.action_size,
        );
        let nominal = match self.best.is_known() {
            true => self.best.sequence.clone(),
            false => vec![0.0; numbers],
        };
        let mut sequences = nominal.clone();
        let mut added = vec![0.0; numbers];
        for _ in 1..self.settings.samples {
            let draws: Vec<f32> = (0..knots)
                .map(|_| {
                    let z: f32 = StandardNormal.sample(rng);
                    deviation * z
                })
                .collect();
            spline(&draws, self.settings.interpolation, self.shape, &mut added);
            let sums = nominal.iter().zip(&added).map(|(x, y)| x + y);
            let begin = sequences.len();
            sequences.extend(sums);
            self.shape.clip(&mut sequences[begin..]);
        }
        sequences
    }

    fn learn(&mut self, iteration: usize, sequences: &[f32], scores: &[f64]) {
        if iteration == 0 {
            self.best.restart();
        }
        self.best.see(self.shape.numbers(), sequences, scores);
    }

    fn decision(&self) -> &[f32] {
        &self.best.sequence
    }

    fn advance(&mut self, _: &mut Stream) {
        let sequence = &mut self.best.sequence;
        let last = sequence[sequence.len() - self.shape.action_size..].to_vec();
        self.shape.shift(sequence, &last);
    }

    fn another(&self) -> Box<dyn Strategy> {
        Box::new(Sampling::new(self.settings.clone(), self.shape))
    }
}
