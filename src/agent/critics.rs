//! The critics with their targets: values for targets, and steps.

use super::AgentSettings;
use crate::nn::{Learner, Memory, Mlp, TrainableMlp, WeightError, Weights, column, matrix, to_vec};
use crate::parallel::join;
use crate::random::Stream;
use burn::tensor::Device;

/// One or two critics, each with its target.
pub(super) struct Critics {
    learners: Vec<Learner>,
    targets: Vec<Mlp>,
}

/// Values by the target critics.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Values {
    /// The smaller one of both critics', or the only one's, `[n]`.
    pub value: Vec<f32>,
    /// `|Q1' - Q2'|`, `[n]`; zeros with one critic.
    pub disagreement: Vec<f32>,
}

/// State-action pairs that critics are trained on, with their targets.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct CriticRows {
    /// What critics see, action last, `[n, width]`.
    pub input: Vec<f32>,
    /// Targets, `[n]`.
    pub y: Vec<f32>,
    /// Weights of the squared errors, `[n]`.
    pub weight: Vec<f32>,
}

impl Critics {
    /// Fresh critics, drawn from `rng` and trained on `device`.
    pub fn new(
        settings: &AgentSettings,
        widths: &[usize],
        rng: &mut Stream,
        device: &Device,
    ) -> Critics {
        let count = settings.base.critics();
        let critics: Vec<Mlp> = (0..count).map(|_| Mlp::new(widths, rng)).collect();
        Critics::of(settings, critics.clone(), critics, device)
    }

    /// Saved critics.
    pub fn load(
        settings: &AgentSettings,
        widths: &[usize],
        weights: &Weights,
        device: &Device,
    ) -> Result<Critics, WeightError> {
        let load = |prefix: &str| -> Result<Vec<Mlp>, WeightError> {
            (1..=settings.base.critics())
                .map(|i| Mlp::load(&format!("{prefix}{i}"), widths, weights))
                .collect()
        };
        let (critics, targets) = (load("critic")?, load("target_critic")?);
        Ok(Critics::of(settings, critics, targets, device))
    }

    fn of(
        settings: &AgentSettings,
        critics: Vec<Mlp>,
        targets: Vec<Mlp>,
        device: &Device,
    ) -> Critics {
        let rate = settings.networks.critic_learning_rate;
        let learner = |critic| Learner::new(critic, rate, device);
        Critics {
            learners: critics.into_iter().map(learner).collect(),
            targets,
        }
    }

    /// Adds `critic1`, `target_critic1` and so on to `weights`.
    pub fn save(&self, weights: &mut Weights) {
        for (i, (critic, target)) in self.learners.iter().zip(&self.targets).enumerate() {
            let number = i + 1;
            critic.mlp().save(&format!("critic{number}"), weights);
            target.save(&format!("target_critic{number}"), weights);
        }
    }

    /// Remembers what the optimisers go on from.
    pub fn save_optimizers(&self, memory: &mut Memory) {
        for (i, critic) in self.learners.iter().enumerate() {
            critic.save_optimizer(&format!("critic{}", i + 1), memory);
        }
    }

    /// Has the optimisers go on from what was remembered.
    pub fn restore_optimizers(&mut self, memory: &Memory) -> Result<(), WeightError> {
        let mut learners = self.learners.iter_mut().enumerate();
        learners.try_for_each(|(i, critic)| {
            critic.restore_optimizer(&format!("critic{}", i + 1), memory)
        })
    }

    /// `Q1`, which deterministic actors climb.
    pub fn first(&self) -> &Learner {
        &self.learners[0]
    }

    /// All critics, to differentiate through.
    pub fn frozen(&self) -> Vec<TrainableMlp> {
        self.learners.iter().map(Learner::frozen).collect()
    }

    /// Optimistic start (equation 6).
    pub fn set_output_bias(&mut self, bias: f32) {
        for (critic, target) in self.learners.iter_mut().zip(&mut self.targets) {
            critic.set_output_bias(bias);
            target.set_output_bias(bias);
        }
    }

    /// What the target critics say of `input`, action last, `[n, width]`.
    pub fn target_values(&self, input: &[f32]) -> Values {
        let mut said = self.targets.iter().map(|critic| critic.forward(input));
        let first = said.next().expect("at least one critic");
        match said.next() {
            None => Values {
                disagreement: vec![0.0; first.len()],
                value: first,
            },
            Some(second) => {
                let pairs = || first.iter().zip(&second);
                Values {
                    value: pairs().map(|(a, b)| a.min(*b)).collect(),
                    disagreement: pairs().map(|(a, b)| (a - b).abs()).collect(),
                }
            }
        }
    }

    /// One step of each critic, side by side. Returns the losses, and `Q1` before its step in each row.
    pub fn step(&mut self, rows: CriticRows) -> (Vec<f32>, Vec<f32>) {
        let device = self.learners[0].device();
        let width = rows.input.len() / rows.y.len();
        let input = matrix(rows.input, width, device);
        let (y, weight) = (column(rows.y, device), column(rows.weight, device));
        let step = |critic: &mut Learner| {
            let mut values = Vec::new();
            let gradient = critic.differentiate(|critic| {
                let q = critic.forward(input.clone());
                values = to_vec(q.clone().without_autodiff());
                let error = q - y.clone();
                (error.clone() * error * weight.clone()).sum()
            });
            let loss = gradient.loss();
            critic.step(gradient);
            (loss, values)
        };
        match self.learners.as_mut_slice() {
            [only] => {
                let (loss, values) = step(only);
                (vec![loss], values)
            }
            [first, second, ..] => {
                let ((first, values), (second, _)) = join(|| step(first), || step(second));
                (vec![first, second], values)
            }
            [] => (Vec::new(), Vec::new()),
        }
    }

    /// Moves the targets towards the critics.
    pub fn polyak(&mut self, tau: f64) {
        for (target, critic) in self.targets.iter_mut().zip(&self.learners) {
            target.polyak(critic.mlp(), tau);
        }
    }
}

impl CriticRows {
    /// Appends `action` in `observed` (of this `width`), with targets and one weight, row by row.
    pub fn extend(
        &mut self,
        observed: &[f32],
        width: usize,
        action: &[f32],
        y: &[f32],
        weight: f32,
    ) {
        let rows = observed.chunks_exact(width);
        let rows = rows.zip(action.chunks_exact(action.len() / y.len()));
        for ((observed, action), y) in rows.zip(y) {
            self.push(observed, action, *y, weight);
        }
    }

    /// Appends one row.
    pub fn push(&mut self, observed: &[f32], action: &[f32], y: f32, weight: f32) {
        self.input.extend_from_slice(observed);
        self.input.extend_from_slice(action);
        self.y.push(y);
        self.weight.push(weight);
    }
}
