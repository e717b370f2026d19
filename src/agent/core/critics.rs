//! The critics with their targets: values for targets, and steps.

use crate::agent::AgentSettings;
use crate::core::parallel::join;
use crate::core::random::Stream;
use crate::nn::{
    Architecture, LearningState, Mlp, TrainableMlp, TrainableNetwork, WeightError, Weights, column,
    matrix, to_vec,
};
use crate::replay::Batch;
use burn::tensor::{Device, Tensor};

/// One or two critics, each with its target.
pub struct Critics {
    networks: Vec<TrainableNetwork>,
    targets: Vec<Mlp>,
}

/// State-action pairs that critics are trained on, with their targets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CriticRows {
    /// What critics see, action last, `[n, width]`.
    pub input: Vec<f32>,
    /// Targets, `[n]`.
    pub y: Vec<f32>,
    /// Weights of the squared errors, `[n]`.
    pub weight: Vec<f32>,
}

/// What a step of the critics tells.
pub struct Stepped {
    /// Loss of each critic before its step.
    pub losses: Vec<f32>,
    /// Largest absolute error of the critics before their step on each real row.
    pub errors: Vec<f32>,
    /// `Q1` before its step in each row.
    pub values: Vec<f32>,
}

impl Critics {
    /// Fresh critics, drawn from `rng` and trained on `device`.
    pub fn new(
        settings: &AgentSettings,
        critic: &Architecture,
        rng: &mut Stream,
        device: &Device,
    ) -> Critics {
        let count = settings.base.critics();
        let critics: Vec<Mlp> = (0..count).map(|_| Mlp::new(critic, rng)).collect();
        Critics::of(settings, critics.clone(), critics, device)
    }

    /// Saved critics.
    pub fn load(
        settings: &AgentSettings,
        critic: &Architecture,
        weights: &Weights,
        device: &Device,
    ) -> Result<Critics, WeightError> {
        let load = |prefix: &str| -> Result<Vec<Mlp>, WeightError> {
            (1..=settings.base.critics())
                .map(|i| Mlp::load(&format!("{prefix}{i}"), critic, weights))
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
        let trainable = |critic| TrainableNetwork::new(critic, rate, device);
        Critics {
            networks: critics.into_iter().map(trainable).collect(),
            targets,
        }
    }

    /// Adds `critic1`, `target_critic1` and so on to `weights`.
    pub fn save(&self, weights: &mut Weights) {
        for (i, (critic, target)) in self.networks.iter().zip(&self.targets).enumerate() {
            let number = i + 1;
            critic.mlp().save(&format!("critic{number}"), weights);
            target.save(&format!("target_critic{number}"), weights);
        }
    }

    /// Whether all parameters and second moments have been finite after every step.
    pub fn are_finite(&self) -> bool {
        self.networks.iter().all(TrainableNetwork::is_finite)
    }

    /// Saves what the optimisers go on from.
    pub fn save_state(&self, state: &mut LearningState) {
        for (i, critic) in self.networks.iter().enumerate() {
            critic.save_optimizer(&format!("critic{}", i + 1), state);
        }
    }

    /// Has the optimisers go on from what was saved.
    pub fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        let mut networks = self.networks.iter_mut().enumerate();
        networks.try_for_each(|(i, critic)| {
            critic.restore_optimizer(&format!("critic{}", i + 1), state)
        })
    }

    /// `Q1`, which deterministic actors climb.
    pub fn first(&self) -> &TrainableNetwork {
        &self.networks[0]
    }

    /// All critics, to differentiate through.
    pub fn frozen(&self) -> Vec<TrainableMlp> {
        self.networks.iter().map(TrainableNetwork::frozen).collect()
    }

    /// Optimistic start (equation 6).
    pub fn set_output_bias(&mut self, bias: f32) {
        for (critic, target) in self.networks.iter_mut().zip(&mut self.targets) {
            critic.set_output_bias(bias);
            target.set_output_bias(bias);
        }
    }

    /// Output biases of all critics, then of their targets.
    pub fn output_biases(&self) -> Vec<f32> {
        let critics = self.networks.iter().map(TrainableNetwork::mlp);
        let biases = critics.chain(&self.targets).map(Mlp::output_bias);
        biases.flatten().copied().collect()
    }

    /// What each target critic says of `input`, action last, `[n, width]`: `[n]` each.
    pub fn target_values(&self, input: &[f32]) -> Vec<Vec<f32>> {
        let said = self.targets.iter().map(|critic| critic.forward(input));
        said.collect()
    }

    /// One step of each critic, side by side, down `loss` of its values, the targets and the weights of `rows` (`[n, 1]`
    /// each), of which the first `real` are real transitions.
    pub fn step(
        &mut self,
        rows: CriticRows,
        real: usize,
        loss: impl Fn(Tensor<2>, Tensor<2>, Tensor<2>) -> Tensor<1> + Sync,
    ) -> Stepped {
        let device = self.networks[0].device();
        let width = rows.input.len() / rows.y.len();
        let input = matrix(rows.input, width, device);
        let wanted = rows.y[..real].to_vec();
        let (y, weight) = (column(rows.y, device), column(rows.weight, device));
        let step = |critic: &mut TrainableNetwork| {
            let mut values = Vec::new();
            let gradient = critic.differentiate(|critic| {
                let q = critic.forward(input.clone());
                values = to_vec(q.clone().without_autodiff());
                loss(q, y.clone(), weight.clone())
            });
            let loss = gradient.loss();
            critic.step(gradient);
            (loss, values)
        };
        let stepped = match self.networks.as_mut_slice() {
            [first, second, ..] => {
                let (first, second) = join(|| step(first), || step(second));
                vec![first, second]
            }
            networks => networks.iter_mut().map(step).collect(),
        };
        let error = |row: usize| {
            let errors = stepped.iter().map(|(_, q)| (q[row] - wanted[row]).abs());
            errors.fold(0.0, f32::max)
        };
        let errors = (0..real).map(error).collect();
        let (losses, values): (Vec<f32>, Vec<Vec<f32>>) = stepped.into_iter().unzip();
        Stepped {
            losses,
            errors,
            values: values.into_iter().next().unwrap_or_default(),
        }
    }

    /// Moves the targets towards the critics, by the fraction `tau` of the way.
    pub fn move_targets(&mut self, tau: f64) {
        for (target, critic) in self.targets.iter_mut().zip(&self.networks) {
            target.polyak(critic.mlp(), tau);
        }
    }
}

impl CriticRows {
    /// Appends the real transitions of `batch`, observed as `observed`, with their targets; the loss is the mean over
    /// them.
    pub fn extend_real(&mut self, observed: &[f32], batch: &Batch, y: &[f32]) {
        let rows = batch.rows;
        let (width, sa) = (observed.len() / rows, batch.action.len() / rows);
        let share = 1.0 / rows as f32;
        for (i, y) in y.iter().enumerate() {
            let (observed, action) = (
                &observed[i * width..][..width],
                &batch.action[i * sa..][..sa],
            );
            self.push(observed, action, *y, share * batch.weight(i));
        }
    }

    /// Appends one row: what is observed, the executed action, its target and the weight of its squared error.
    pub fn push(&mut self, observed: &[f32], action: &[f32], y: f32, weight: f32) {
        self.input.extend_from_slice(observed);
        self.input.extend_from_slice(action);
        self.y.push(y);
        self.weight.push(weight);
    }
}
