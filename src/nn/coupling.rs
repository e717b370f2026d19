//! From a policy's network to the executed action.

use super::side_by_side;
use crate::core::span::Span;
use burn::tensor::{Device, Tensor, TensorData};
use std::sync::Arc;

/// How the actor's network becomes the executed action (the published runs' action coupling):
/// `u = middle + half tanh(network)`, `a = clip(beta u + (1 - beta) p)` with `p` the previous executed action, where
/// middle, half and ends are those of the range of each number of an action. Each step is here twice: on tensors, to be
/// differentiated, and on slices.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupling {
    beta: f64,
    ranges: Arc<[Range]>,
    /// The limit of all numbers, where they lie within plus and minus the same one.
    limit: Option<f64>,
}

/// The range of one number of an action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Its lowest value.
    pub low: f32,
    /// Its highest value.
    pub high: f32,
    /// What lies between both.
    pub middle: f32,
    /// From the middle to either end.
    pub half: f32,
    /// The same in double precision.
    pub span: Span,
}

impl From<Span> for Range {
    fn from(span: Span) -> Range {
        Range {
            low: span.low as f32,
            high: span.high as f32,
            middle: span.middle() as f32,
            half: span.half() as f32,
            span,
        }
    }
}

impl Coupling {
    /// Coupling by `beta`, in (0, 1], of actions within `spans`, one a number; where `beta` is 1, `p` is no input of
    /// any network.
    pub fn new(beta: f64, spans: &[Span]) -> Coupling {
        let limit = spans.first().map_or(1.0, |span| span.high);
        let alike = spans.iter().all(|span| *span == Span::symmetric(limit));
        Coupling {
            beta,
            ranges: spans.iter().map(|span| Range::from(*span)).collect(),
            limit: alike.then_some(limit),
        }
    }

    /// The range of each number of an action.
    pub fn ranges(&self) -> &[Range] {
        &self.ranges
    }

    /// Whether the previous action matters, and is an input of actor and critics.
    pub fn uses_previous(&self) -> bool {
        self.beta < 1.0
    }

    /// What actor and critics see beside the action, row by row: `s`, or `s` and `p` side by side.
    pub fn observe(
        &self,
        obs: &[f32],
        previous: &[f32],
        obs_size: usize,
        action_size: usize,
    ) -> Vec<f32> {
        if self.uses_previous() {
            side_by_side(&[(obs, obs_size), (previous, action_size)])
        } else {
            obs.to_vec()
        }
    }

    /// Width of [`observe`](Coupling::observe)'s result.
    pub fn observed_width(&self, obs_size: usize, action_size: usize) -> usize {
        obs_size + if self.uses_previous() { action_size } else { 0 }
    }

    /// The policy's output `u` of what the network gives, `[n, action_size]`.
    pub fn output(&self, network: Tensor<2>) -> Tensor<2> {
        self.spread(network.tanh())
    }

    /// The output `u` for numbers from -1 to 1, `[n, action_size]`.
    pub fn spread(&self, unit: Tensor<2>) -> Tensor<2> {
        match self.limit {
            Some(limit) => unit * limit,
            None => {
                let device = unit.device();
                let half = self.row(|range| range.half, &device);
                unit * half + self.row(|range| range.middle, &device)
            }
        }
    }

    /// [`output`](Coupling::output) in place.
    pub fn output_in_place(&self, network: &mut [f32]) {
        self.each(network, |x, range| {
            *x = range.half * x.tanh() + range.middle
        });
    }

    /// The executed action for the output `u`, `[n, action_size]` each.
    pub fn execute(&self, output: Tensor<2>, previous: Tensor<2>) -> Tensor<2> {
        let coupled = if self.uses_previous() {
            output * self.beta + previous * (1.0 - self.beta)
        } else {
            output
        };
        match self.limit {
            Some(limit) => coupled.clamp(-limit, limit),
            None => {
                let (device, rows) = (coupled.device(), coupled.dims()[0]);
                let all = |row: Tensor<2>| row.repeat_dim(0, rows);
                let low = all(self.row(|range| range.low, &device));
                let high = all(self.row(|range| range.high, &device));
                coupled.max_pair(low).min_pair(high)
            }
        }
    }

    /// [`execute`](Coupling::execute) in place.
    pub fn execute_in_place(&self, output: &mut [f32], previous: &[f32]) {
        let beta = self.beta as f32;
        let mut previous = previous.iter();
        self.each(output, |u, range| {
            let p = previous.next().copied().unwrap_or_default();
            *u = (beta * *u + (1.0 - beta) * p).clamp(range.low, range.high);
        });
    }

    /// Does something with every number of actions, row by row, and its range.
    pub fn each(&self, actions: &mut [f32], mut change: impl FnMut(&mut f32, &Range)) {
        for row in actions.chunks_exact_mut(self.ranges.len().max(1)) {
            for (number, range) in row.iter_mut().zip(self.ranges.iter()) {
                change(number, range);
            }
        }
    }

    /// A figure of each range as one row.
    fn row(&self, figure: impl Fn(&Range) -> f32, device: &Device) -> Tensor<2> {
        let figures: Vec<f32> = self.ranges.iter().map(figure).collect();
        let shape = [1, figures.len()];
        Tensor::from_data(TensorData::new(figures, shape), device)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::{Backend, matrix, to_vec};

    const UNLIKE: [Span; 3] = [
        Span::symmetric(0.4),
        Span {
            low: 0.0,
            high: 2.0,
        },
        Span {
            low: -3.0,
            high: -1.0,
        },
    ];

    #[test]
    fn every_number_has_its_own_range() {
        let coupling = Coupling::new(1.0, &UNLIKE);
        let mut action = [0.0, 0.0, 0.0, 50.0, 50.0, 50.0, -50.0, -50.0, -50.0];
        coupling.output_in_place(&mut action);
        assert_eq!(action, [0.0, 1.0, -2.0, 0.4, 2.0, -1.0, -0.4, 0.0, -3.0]);
        let mut action = [9.0, 9.0, 9.0, -9.0, -9.0, -9.0];
        coupling.execute_in_place(&mut action, &[0.0; 6]);
        assert_eq!(action, [0.4, 2.0, -1.0, -0.4, 0.0, -3.0]);
    }

    #[test]
    fn tensors_and_slices_agree_with_ranges_alike_and_unlike() {
        let device = Backend::Flex.device();
        let network: Vec<f32> = (0..12).map(|i| 3.0 * (i as f32).sin()).collect();
        let previous: Vec<f32> = (0..12).map(|i| 2.5 * (i as f32).cos()).collect();
        for spans in [[Span::symmetric(0.4); 3], UNLIKE] {
            for beta in [0.7, 1.0] {
                let coupling = Coupling::new(beta, &spans);
                let output = coupling.output(matrix(network.clone(), 3, &device));
                let executed =
                    coupling.execute(output.clone(), matrix(previous.clone(), 3, &device));
                let mut there = network.clone();
                coupling.output_in_place(&mut there);
                close(&to_vec(output), &there);
                coupling.execute_in_place(&mut there, &previous);
                close(&to_vec(executed), &there);
            }
        }
    }

    fn close(a: &[f32], b: &[f32]) {
        assert_eq!(a.len(), b.len());
        assert!(
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6),
            "{a:?} {b:?}"
        );
    }
}
