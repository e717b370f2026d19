//! The learned dynamics model.

use super::{ModelSettings, Predict};
use crate::core::random::Stream;
use crate::nn::{
    Architecture, Gradient, LearningState, Mlp, TrainableNetwork, WeightError, Weights, matrix,
    side_by_side,
};
use burn::tensor::Device;

/// `f(s, a)`: predicts, in scaled space, the coordinates of the next observation that the task's
/// designer does not know (paper, equation 5), and the reward where that is not known either.
pub struct DynamicsModel {
    learner: TrainableNetwork,
    predict: Predict,
    obs_size: usize,
    action_size: usize,
    /// Coordinates that are predicted, ascending.
    learned: Vec<usize>,
    /// Whether the last output is the reward.
    learns_reward: bool,
}

/// Transitions that the model learns from, all rows of a batch or a part of them; observations scaled.
#[derive(Debug, Clone, Copy)]
pub struct ModelBatch<'a> {
    /// `s`, `[n, obs_size]`.
    pub obs: &'a [f32],
    /// `a`, `[n, action_size]`.
    pub action: &'a [f32],
    /// `s'`, `[n, obs_size]`.
    pub next_obs: &'a [f32],
    /// `r`, `[n]`; read by models that learn it.
    pub reward: &'a [f32],
}

/// What the model says of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// Next observation in scaled space, `[n, obs_size]`; coordinates that are not learned are those
    /// of the observation before, to be overwritten by what is known of them.
    pub next_obs: Vec<f32>,
    /// Reward, `[n]`, of models that learn it.
    pub reward: Option<Vec<f32>>,
}

/// Sizes of a task's observations and actions, and what is known of the next observation.
#[derive(Debug, Clone, Copy)]
pub struct DynamicsShape<'a> {
    /// Length of an observation.
    pub obs_size: usize,
    /// Length of an action.
    pub action_size: usize,
    /// Coordinates that need no learning, ascending.
    pub known: &'a [usize],
    /// Whether the reward is to be learned too.
    pub learns_reward: bool,
}

impl DynamicsShape<'_> {
    fn learned(&self) -> Vec<usize> {
        (0..self.obs_size)
            .filter(|i| !self.known.contains(i))
            .collect()
    }

    fn architecture(&self, hidden: &[usize]) -> Architecture {
        let widths = [
            &[self.obs_size + self.action_size],
            hidden,
            &[self.learned().len() + usize::from(self.learns_reward)],
        ]
        .concat();
        Architecture::relu(&widths)
    }
}

impl DynamicsModel {
    /// A fresh model computing on the plain `device`.
    pub fn new(
        settings: &ModelSettings,
        shape: DynamicsShape<'_>,
        rng: &mut Stream,
        device: &Device,
    ) -> DynamicsModel {
        let architecture = shape.architecture(&settings.hidden);
        let mlp = Mlp::new(&architecture, rng);
        DynamicsModel::from_mlp(settings, shape, mlp, device)
    }

    /// A saved model, without its optimiser's moments.
    ///
    /// # Errors
    /// When an array is missing or has another shape.
    pub fn load(
        settings: &ModelSettings,
        shape: DynamicsShape<'_>,
        weights: &Weights,
        device: &Device,
    ) -> Result<DynamicsModel, WeightError> {
        let architecture = shape.architecture(&settings.hidden);
        let mlp = Mlp::load("model", &architecture, weights)?;
        Ok(DynamicsModel::from_mlp(settings, shape, mlp, device))
    }

    fn from_mlp(
        settings: &ModelSettings,
        shape: DynamicsShape<'_>,
        mlp: Mlp,
        device: &Device,
    ) -> DynamicsModel {
        DynamicsModel {
            learner: TrainableNetwork::new(mlp, settings.learning_rate, device),
            predict: settings.predict,
            obs_size: shape.obs_size,
            action_size: shape.action_size,
            learned: shape.learned(),
            learns_reward: shape.learns_reward,
        }
    }

    /// Adds `model.l<i>.*` to `weights`.
    pub fn save(&self, weights: &mut Weights) {
        self.learner.mlp().save("model", weights);
    }

    /// Whether all parameters and second moments have been finite after every step.
    pub fn is_finite(&self) -> bool {
        self.learner.is_finite()
    }

    /// Saves what the optimiser goes on from.
    pub fn save_optimizer(&self, state: &mut LearningState) {
        self.learner.save_optimizer("model", state);
    }

    /// Has the optimiser go on from what was saved.
    ///
    /// # Errors
    /// When something of it is missing or has another shape.
    pub fn restore_optimizer(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.learner.restore_optimizer("model", state)
    }

    /// The gradient of the loss `mean((f(s, a) - s')^2)` over outputs and a batch of `batch_rows`
    /// rows, of which these are all or a part.
    pub fn differentiate(&self, batch: ModelBatch<'_>, batch_rows: usize) -> Gradient {
        let (so, sa, width) = (self.obs_size, self.action_size, self.outputs());
        let device = self.learner.device();
        let input = side_by_side(&[(batch.obs, so), (batch.action, sa)]);
        let input = matrix(input, so + sa, device);
        let target = matrix(self.targets(batch), width, device);
        let weight = 1.0 / (batch_rows * width) as f64;
        self.learner.differentiate(|mlp| {
            let error = mlp.forward(input) - target;
            (error.clone() * error).sum() * weight
        })
    }

    /// One Adam step down `gradient`.
    pub fn step(&mut self, gradient: Gradient) {
        self.learner.step(gradient);
    }

    /// Mean squared one-step error over rows and learned coordinates, without training.
    pub fn error(&self, obs: &[f32], action: &[f32], next_obs: &[f32]) -> f32 {
        let predicted = self.predict(obs, action).next_obs;
        let so = self.obs_size;
        let (mut sum, mut count) = (0.0f64, 0usize);
        for (p, t) in predicted.chunks_exact(so).zip(next_obs.chunks_exact(so)) {
            for &i in &self.learned {
                sum += f64::from(p[i] - t[i]).powi(2);
                count += 1;
            }
        }
        (sum / count.max(1) as f64) as f32
    }

    /// What follows `action` in `obs`, scaled, row by row.
    pub fn predict(&self, obs: &[f32], action: &[f32]) -> Prediction {
        let (so, sa, width) = (self.obs_size, self.action_size, self.outputs());
        let mut next_obs = obs.to_vec();
        if width == 0 {
            return Prediction {
                next_obs,
                reward: None,
            };
        }
        let input = side_by_side(&[(obs, so), (action, sa)]);
        let output = self.learner.mlp().forward(&input);
        let rows = next_obs
            .chunks_exact_mut(so)
            .zip(output.chunks_exact(width));
        for (next, output) in rows {
            for (&i, x) in self.learned.iter().zip(output) {
                next[i] = match self.predict {
                    Predict::NextState => *x,
                    Predict::Delta => next[i] + x,
                };
            }
        }
        let last = |row: &[f32]| row[width - 1];
        let reward = self.learns_reward;
        let reward = reward.then(|| output.chunks_exact(width).map(last).collect());
        Prediction { next_obs, reward }
    }

    /// Numbers that the network says of a row.
    fn outputs(&self) -> usize {
        self.learned.len() + usize::from(self.learns_reward)
    }

    /// What the network should say, `[n, outputs]`.
    fn targets(&self, batch: ModelBatch<'_>) -> Vec<f32> {
        let so = self.obs_size;
        let mut targets = Vec::with_capacity(batch.obs.len() / so * self.outputs());
        let rows = batch
            .obs
            .chunks_exact(so)
            .zip(batch.next_obs.chunks_exact(so));
        for (row, (s, next)) in rows.enumerate() {
            targets.extend(self.learned.iter().map(|&i| match self.predict {
                Predict::NextState => next[i],
                Predict::Delta => next[i] - s[i],
            }));
            if self.learns_reward {
                targets.push(batch.reward[row]);
            }
        }
        targets
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;
    use crate::nn::Backend;
    use rand::RngExt;

    const ROWS: usize = 64;

    /// Rows of a linear system whose second coordinate never changes.
    fn rows(rng: &mut Stream) -> [Vec<f32>; 3] {
        let (mut obs, mut action, mut next) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..ROWS {
            let [x, goal, v, a] = [(); 4].map(|()| rng.random_range(-1.0..1.0f32));
            obs.extend([x, goal, v]);
            action.push(a);
            next.extend([x + 0.5 * v, goal, 0.5 * v + 0.5 * a]);
        }
        [obs, action, next]
    }

    fn batch<'a>(obs: &'a [f32], action: &'a [f32], next_obs: &'a [f32]) -> ModelBatch<'a> {
        ModelBatch {
            obs,
            action,
            next_obs,
            reward: action,
        }
    }

    #[test]
    fn a_reward_is_learned_beside_the_state() {
        let settings = ModelSettings {
            hidden: vec![32],
            learning_rate: 1e-2,
            predict: Predict::NextState,
        };
        let shape = DynamicsShape {
            obs_size: 3,
            action_size: 1,
            known: &[0, 1, 2],
            learns_reward: true,
        };
        let rng = &mut stream(7, "dynamics");
        let mut model = DynamicsModel::new(&settings, shape, rng, &Backend::Flex.device());
        for _ in 0..400 {
            // The reward is the action.
            let [obs, action, next] = rows(rng);
            let gradient = model.differentiate(batch(&obs, &action, &next), ROWS);
            model.step(gradient);
        }
        let [obs, action, _] = rows(rng);
        let said = model.predict(&obs, &action);
        assert_eq!(said.next_obs, obs, "nothing of it is learned");
        let errors = said.reward.unwrap().into_iter().zip(action);
        let largest = errors.fold(0.0f32, |m, (r, a)| m.max((r - a).abs()));
        assert!(largest < 0.1, "{largest}");
    }

    #[test]
    fn either_prediction_learns_what_is_not_known_and_leaves_the_rest() {
        for predict in [Predict::NextState, Predict::Delta] {
            let settings = ModelSettings {
                hidden: vec![32],
                learning_rate: 1e-2,
                predict,
            };
            let shape = DynamicsShape {
                obs_size: 3,
                action_size: 1,
                known: &[1],
                learns_reward: false,
            };
            let rng = &mut stream(7, "dynamics");
            let mut model = DynamicsModel::new(&settings, shape, rng, &Backend::Flex.device());
            let [obs, action, next] = rows(rng);
            let before = model.error(&obs, &action, &next);
            for _ in 0..400 {
                let [obs, action, next] = rows(rng);
                let gradient = model.differentiate(batch(&obs, &action, &next), ROWS);
                model.step(gradient);
            }
            let after = model.error(&obs, &action, &next);
            assert!(after < 0.02 * before, "{predict:?}: {before} to {after}");
            let gradient = model.differentiate(batch(&obs, &action, &next), ROWS);
            assert!(
                (gradient.loss() - after).abs() < 1e-5,
                "the error is the loss"
            );
            let predicted = model.predict(&obs, &action).next_obs;
            assert!((0..ROWS).all(|row| predicted[3 * row + 1] == obs[3 * row + 1]));
        }
    }
}
