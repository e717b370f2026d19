//! The improved cross-entropy method.

use super::PlannerSettings;
use super::noise::Coloured;
use super::strategy::{Best, Sequences, Shape, Strategy, iterations, ranked};
use crate::core::random::Stream;
use rand_distr::{Distribution, StandardNormal};

/// iCEM (Pinneri et al. 2020): a Gaussian around a mean sequence, drawn in coloured noise and fitted to the elites,
/// some of which are kept.
pub(super) struct Icem {
    settings: PlannerSettings,
    shape: Shape,
    noise: Coloured,
    mean: Vec<f32>,
    deviation: Vec<f32>,
    /// The best sequences so far with their scores, the best first. After a step their scores are of no state any more.
    elites: Vec<(Vec<f32>, f64)>,
    best: Best,
}

impl Icem {
    pub fn new(settings: PlannerSettings, shape: Shape) -> Icem {
        let first = settings.noise as f32;
        Icem {
            noise: Coloured::new(shape.horizon, settings.colour),
            mean: vec![0.0; shape.numbers()],
            deviation: vec![first; shape.numbers()],
            elites: Vec::new(),
            best: Best::default(),
            settings,
            shape,
        }
    }

    /// How many elites are kept.
    fn kept(&self) -> usize {
        let kept = self.settings.keep * self.settings.elites as f64;
        (kept.round() as usize).min(self.elites.len())
    }
}

impl Strategy for Icem {
    fn begin(&mut self) {
        let first = self.settings.noise as f32;
        self.mean.fill(0.0);
        self.deviation.fill(first);
        self.elites.clear();
        self.best.clear();
    }

    fn iterations(&self, step: usize) -> usize {
        iterations(&self.settings, step)
    }

    /// Samples of the Gaussian, fewer with each iteration; in the first one also the elites of the last decision, and
    /// in the last ones the mean.
    fn propose(&mut self, iteration: usize, rng: &mut Stream) -> Sequences {
        let (numbers, width) = (self.shape.numbers(), self.shape.action_size);
        let fewer = self.settings.sample_decay.powi(iteration as i32);
        let samples = (self.settings.samples as f64 / fewer) as usize;
        let samples = samples.max(2 * self.settings.elites);
        let mut sequences = Vec::with_capacity((samples + self.kept() + 1) * numbers);
        for _ in 0..samples {
            let begin = sequences.len();
            sequences.extend_from_slice(&self.mean);
            let sequence = &mut sequences[begin..];
            for actuator in 0..width {
                let deviation = |t: usize| self.deviation[t * width + actuator];
                self.noise
                    .add(&mut sequence[actuator..], width, deviation, rng);
            }
            self.shape.clip(sequence);
        }
        if iteration == 0 {
            for (elite, _) in &self.elites[..self.kept()] {
                sequences.extend_from_slice(elite);
            }
        }
        sequences.extend_from_slice(&self.mean);
        sequences
    }

    fn learn(&mut self, iteration: usize, sequences: &[f32], scores: &[f64]) {
        let numbers = self.shape.numbers();
        if iteration == 0 {
            // Those that were kept are among the sequences, with scores of this state.
            self.elites.clear();
            self.best.restart();
        }
        self.best.see(numbers, sequences, scores);
        // Elites of the iteration before compete with the new ones without being tried out again.
        let kept = self.kept();
        let mut pool: Vec<(Vec<f32>, f64)> = self.elites.drain(..kept).collect();
        let new = sequences.chunks_exact(numbers).zip(scores);
        pool.extend(new.map(|(sequence, score)| (sequence.to_vec(), *score)));
        let scores: Vec<f64> = pool.iter().map(|(_, score)| *score).collect();
        let order = ranked(&scores);
        let elites = order.into_iter().take(self.settings.elites);
        self.elites = elites.map(|i| std::mem::take(&mut pool[i])).collect();

        let n = self.elites.len() as f32;
        let momentum = self.settings.momentum as f32;
        for i in 0..numbers {
            let values = || self.elites.iter().map(|(sequence, _)| sequence[i]);
            let mean = values().sum::<f32>() / n;
            let variance = values().map(|x| (x - mean).powi(2)).sum::<f32>() / n;
            self.mean[i] = momentum * self.mean[i] + (1.0 - momentum) * mean;
            self.deviation[i] = momentum * self.deviation[i] + (1.0 - momentum) * variance.sqrt();
        }
    }

    fn decision(&self) -> &[f32] {
        &self.best.sequence
    }

    fn advance(&mut self, rng: &mut Stream) {
        let (shape, width) = (self.shape, self.shape.action_size);
        let first = self.settings.noise as f32;
        let last = self.mean[self.mean.len() - width..].to_vec();
        shape.shift(&mut self.mean, &last);
        self.deviation.fill(first);
        let kept = self.kept();
        self.elites.truncate(kept);
        for (elite, _) in &mut self.elites {
            // The last action of an elite is drawn anew.
            let fresh: Vec<f32> = last
                .iter()
                .map(|mean| {
                    let z: f32 = StandardNormal.sample(rng);
                    (mean + first * z).clamp(-1.0, 1.0)
                })
                .collect();
            shape.shift(elite, &fresh);
        }
    }

    fn another(&self) -> Box<dyn Strategy> {
        Box::new(Icem::new(self.settings.clone(), self.shape))
    }
}
