//! The steps of critics, actor and target networks.

use super::{Targets, Td3};
use crate::agent::{Figures, ImaginationFigures};
use crate::nn::{Gradient, Learner, column, matrix, rows_of, side_by_side, to_vec};
use crate::parallel::{halves, join};
use crate::replay::Batch;
use burn::tensor::Tensor;

impl Td3 {
    /// Steps of the critics (equation 10) and, when due, of actor and targets (lines 22 to 26).
    pub fn learn(&mut self, batch: &Batch, targets: &Targets) -> Figures {
        let (critic_losses, q_mean) = self.step_critics(batch, targets);
        self.updates += 1;
        let due = self.updates.is_multiple_of(self.settings.policy_delay);
        let actor_loss = due.then(|| self.step_actor_and_targets(batch, &targets.observed));
        let fraction = |n: usize| n as f64 / batch.rows as f64;
        Figures {
            critic_losses,
            q_mean,
            actor_loss,
            model_loss: targets.model_loss,
            imagination: targets.imaginary.as_ref().map(|i| ImaginationFigures {
                noise_bound: i.noise_bound,
                by_target: fraction(i.kept.by_target),
                by_uncertainty: fraction(i.kept.by_uncertainty),
                kept: fraction(i.kept.rows.len()),
            }),
        }
    }

    /// One step of each critic, side by side, on the real rows and the kept imaginary ones in one
    /// batch. Returns the losses and the mean of `Q1` on the real rows.
    fn step_critics(&mut self, batch: &Batch, targets: &Targets) -> ([f32; 2], f32) {
        let (rows, sa) = (batch.rows, self.action_size);
        let width = targets.observed.len() / rows;
        let mut input = side_by_side(&[(&targets.observed, width), (&batch.action, sa)]);
        let mut y = targets.y.clone();
        let mut weight = vec![1.0 / rows as f32; rows];
        if let (Some(imaginary), Some(imagination)) = (&targets.imaginary, &self.imagination) {
            let row_weight = imagination.row_weight(imaginary.kept.rows.len(), rows);
            for &i in &imaginary.kept.rows {
                input.extend_from_slice(&targets.observed[i * width..][..width]);
                input.extend_from_slice(&imaginary.action[i * sa..][..sa]);
                y.push(imaginary.y_hat[i]);
                weight.push(row_weight);
            }
        }
        let training = self.critics[0].device();
        let input = matrix(input, width + sa, training);
        let (y, weight) = (column(y, training), column(weight, training));
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
        let [critic1, critic2] = &mut self.critics;
        let ((loss1, values), (loss2, _)) = join(|| step(critic1), || step(critic2));
        let q_mean = values[..rows].iter().sum::<f32>() / rows as f32;
        ([loss1, loss2], q_mean)
    }

    /// One step of the actor on `-mean Q1(s, p, couple(pi(s), p))`, and Polyak averaging of all
    /// targets. The critic's parameters get no gradients.
    fn step_actor_and_targets(&mut self, batch: &Batch, observed: &[f32]) -> f32 {
        let (rows, sa) = (batch.rows, self.action_size);
        let width = observed.len() / rows;
        let training = self.actor.device().clone();
        let critic = self.critics[0].frozen();
        let coupling = self.settings.coupling;
        let tau = self.settings.tau;
        let gradient = Gradient::sum(halves(rows, |range| {
            self.actor.differentiate(|actor| {
                let observed = matrix(rows_of(observed, width, &range).to_vec(), width, &training);
                let previous = rows_of(&batch.previous_action, sa, &range).to_vec();
                let output = coupling.output(actor.forward(observed.clone()));
                let action = coupling.execute(output, matrix(previous, sa, &training));
                critic.forward(Tensor::cat(vec![observed, action], 1)).sum() * (-1.0 / rows as f64)
            })
        }));
        let loss = gradient.loss();
        join(
            || {
                self.actor.step(gradient);
                self.target_actor.polyak(self.actor.mlp(), tau);
            },
            || {
                for (target, critic) in self.target_critics.iter_mut().zip(&self.critics) {
                    target.polyak(critic.mlp(), tau);
                }
            },
        );
        loss
    }
}
