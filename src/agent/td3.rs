//! TD3, and MAMF as TD3 that also learns from imaginary transitions.

use super::{Policy, Sample, Td3Settings};
use crate::imagination::{DynamicsModel, Imagination, Kept};
use crate::nn::{
    Gradient, Learner, Mlp, ObservationScaling, WeightError, Weights, column, matrix, rows_of,
    side_by_side, to_vec,
};
use crate::parallel::{halves, join};
use crate::random::Stream;
use crate::replay::Batch;
use burn::tensor::{Device, Tensor};
use std::ops::Range;

/// Twin delayed deep deterministic policy gradient (Fujimoto et al. 2018) with action coupling;
/// with an [`Imagination`] it is MAMF (paper, Algorithm 1, lines 18 to 26).
pub struct Td3 {
    settings: Td3Settings,
    obs_size: usize,
    action_size: usize,
    actor: Learner,
    critics: [Learner; 2],
    target_actor: Mlp,
    target_critics: [Mlp; 2],
    imagination: Option<Imagination>,
    updates: u64,
}

/// What the critics of one update are trained towards.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// What actor and critics see of the batch, scaled (`Coupling::observe`), row by row.
    pub observed: Vec<f32>,
    /// Real targets `y` (equation 4), `[n]`.
    pub y: Vec<f32>,
    /// Of agents that imagine.
    pub imaginary: Option<ImaginaryTargets>,
}

/// The imaginary part of [`Targets`], all rows, whether kept or not.
#[derive(Debug, Clone, PartialEq)]
pub struct ImaginaryTargets {
    /// Executed imaginary actions `a_hat` (equation 7), `[n, action_size]`.
    pub action: Vec<f32>,
    /// Imaginary targets `y_hat`, `[n]`.
    pub y_hat: Vec<f32>,
    /// Disagreement `Delta` of the target critics at `s_hat` (equation 9), `[n]`.
    pub disagreement: Vec<f32>,
    /// The rows that train the critics.
    pub kept: Kept,
    /// Loss of the model's step.
    pub model_loss: f32,
    /// Bound `eta` that the actions' noise was clipped to.
    pub noise_bound: f64,
}

/// Figures of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Loss of each critic before its step (equation 10).
    pub critic_losses: [f32; 2],
    /// Mean of `Q1` on the real rows.
    pub q_mean: f32,
    /// In updates that step the actor: its loss, `-mean Q1`.
    pub actor_loss: Option<f32>,
    /// Of agents that imagine.
    pub imagination: Option<ImaginationFigures>,
}

/// Figures of the imaginary part of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImaginationFigures {
    /// Loss of the model's step (equation 5).
    pub model_loss: f32,
    /// Bound `eta` of the actions' noise.
    pub noise_bound: f64,
    /// Fraction of the rows that passes the target filter.
    pub by_target: f64,
    /// Fraction of the rows that passes the uncertainty filter.
    pub by_uncertainty: f64,
    /// Fraction of the rows that passes both.
    pub kept: f64,
}

impl Figures {
    /// Name of the first figure that is not finite.
    pub fn not_finite(&self) -> Option<&'static str> {
        let actor = self.actor_loss.unwrap_or(0.0);
        let model = self.imagination.map_or(0.0, |figures| figures.model_loss);
        [
            ("model loss", model),
            ("loss of critic 1", self.critic_losses[0]),
            ("loss of critic 2", self.critic_losses[1]),
            ("actor loss", actor),
        ]
        .into_iter()
        .find(|(_, value)| !value.is_finite())
        .map(|(name, _)| name)
    }
}

/// The networks an agent starts with.
struct Networks {
    actor: Mlp,
    critics: [Mlp; 2],
    target_actor: Mlp,
    target_critics: [Mlp; 2],
}

/// Values of a policy's next step by the target networks.
struct Bootstrap {
    /// `min(Q1', Q2')`.
    value: Vec<f32>,
    /// `|Q1' - Q2'|`.
    disagreement: Vec<f32>,
}

impl Td3 {
    /// A fresh agent trained on `device`; networks are drawn from `rng`.
    pub fn new(
        settings: Td3Settings,
        obs_size: usize,
        action_size: usize,
        imagination: Option<Imagination>,
        rng: &mut Stream,
        device: &Device,
    ) -> Td3 {
        let actor = Mlp::new(&settings.actor_widths(obs_size, action_size), rng);
        let critic_widths = settings.critic_widths(obs_size, action_size);
        let critics = [(); 2].map(|()| Mlp::new(&critic_widths, rng));
        let networks = Networks {
            target_actor: actor.clone(),
            target_critics: critics.clone(),
            actor,
            critics,
        };
        Td3::from_networks(
            settings,
            obs_size,
            action_size,
            imagination,
            networks,
            device,
        )
    }

    /// An agent with saved networks, without its optimisers' moments.
    ///
    /// # Errors
    /// When an array is missing or has another shape than the settings say.
    pub fn load(
        settings: Td3Settings,
        obs_size: usize,
        action_size: usize,
        imagination: Option<Imagination>,
        weights: &Weights,
        device: &Device,
    ) -> Result<Td3, WeightError> {
        let actor_widths = settings.actor_widths(obs_size, action_size);
        let critic_widths = settings.critic_widths(obs_size, action_size);
        let critic = |name| Mlp::load(name, &critic_widths, weights);
        let networks = Networks {
            actor: Mlp::load("actor", &actor_widths, weights)?,
            critics: [critic("critic1")?, critic("critic2")?],
            target_actor: Mlp::load("target_actor", &actor_widths, weights)?,
            target_critics: [critic("target_critic1")?, critic("target_critic2")?],
        };
        Ok(Td3::from_networks(
            settings,
            obs_size,
            action_size,
            imagination,
            networks,
            device,
        ))
    }

    fn from_networks(
        settings: Td3Settings,
        obs_size: usize,
        action_size: usize,
        imagination: Option<Imagination>,
        networks: Networks,
        device: &Device,
    ) -> Td3 {
        let (actor_rate, critic_rate) = (
            settings.networks.actor_learning_rate,
            settings.networks.critic_learning_rate,
        );
        Td3 {
            settings,
            obs_size,
            action_size,
            actor: Learner::new(networks.actor, actor_rate, device),
            critics: networks
                .critics
                .map(|critic| Learner::new(critic, critic_rate, device)),
            target_actor: networks.target_actor,
            target_critics: networks.target_critics,
            imagination,
            updates: 0,
        }
    }

    /// All networks by name: `actor`, `critic1`, `critic2`, `target_actor`, `target_critic1`,
    /// `target_critic2` and `model`.
    pub fn weights(&self) -> Weights {
        let mut weights = Weights::default();
        self.actor.mlp().save("actor", &mut weights);
        self.target_actor.save("target_actor", &mut weights);
        for (i, (critic, target)) in self.critics.iter().zip(&self.target_critics).enumerate() {
            let number = i + 1;
            critic.mlp().save(&format!("critic{number}"), &mut weights);
            target.save(&format!("target_critic{number}"), &mut weights);
        }
        if let Some(imagination) = &self.imagination {
            imagination.model.save(&mut weights);
        }
        weights
    }

    /// The current policy under `scaling`.
    pub fn policy(&self, scaling: &ObservationScaling) -> Policy {
        Policy::new(
            self.actor.mlp().clone(),
            scaling.clone(),
            self.settings.coupling,
        )
    }

    /// The imagination, for agents that have one.
    pub fn imagination(&self) -> Option<&Imagination> {
        self.imagination.as_ref()
    }

    /// Optimistic start: `bias` becomes the output bias of both critics and their targets
    /// (equation 6). To be used once, before the first update.
    pub fn set_optimism(&mut self, bias: f32) {
        self.critics
            .iter_mut()
            .for_each(|critic| critic.set_output_bias(bias));
        self.target_critics
            .iter_mut()
            .for_each(|target| target.set_output_bias(bias));
    }

    /// One step of the dynamics model alone (phase 1). Returns its loss; none without a model.
    pub fn train_model(&mut self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &mut self.imagination.as_mut()?.model;
        let gradient = model_gradient(model, batch, scaling);
        let loss = gradient.loss();
        model.step(gradient);
        Some(loss)
    }

    /// Root mean square one-step error of the dynamics model on `batch`, in scaled space.
    pub fn model_error(&self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &self.imagination.as_ref()?.model;
        let (obs, next) = (scaling.scale(&batch.obs), scaling.scale(&batch.next_obs));
        Some(model.error(&obs, &batch.action, &next).sqrt())
    }

    /// One step of phase 2: model, critics, and every `policy_delay` updates actor and targets.
    pub fn update(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Figures {
        let targets = self.prepare(sample, scaling);
        self.learn(&sample.batch, &targets)
    }

    /// The model's step and the targets of both kinds (Algorithm 1, lines 18 to 21).
    pub fn prepare(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Targets {
        let batch = &sample.batch;
        let obs = scaling.scale(&batch.obs);
        let observed = self.observe(&obs, &batch.previous_action);

        // The gradient takes both threads; applying it leaves one for the real targets, which do
        // not need the model.
        let mut imagination = self.imagination.take();
        let gradient =
            imagination
                .as_ref()
                .zip(sample.imagination.as_ref())
                .map(|(imagination, draws)| {
                    model_gradient(&imagination.model, &draws.model_batch, scaling)
                });
        let model_loss = gradient.as_ref().map(Gradient::loss);
        let (y, ()) = join(
            || self.real_targets(batch, &sample.smoothing, scaling),
            || {
                if let Some((imagination, gradient)) = imagination.as_mut().zip(gradient) {
                    imagination.model.step(gradient);
                }
            },
        );
        let imaginary = match (&mut imagination, model_loss) {
            (Some(imagination), Some(model_loss)) => Some(ImaginaryTargets {
                model_loss,
                ..self.imaginary_targets(imagination, sample, &obs, &observed, &y, scaling)
            }),
            _ => None,
        };
        self.imagination = imagination;
        Targets {
            observed,
            y,
            imaginary,
        }
    }

    /// `y = r + gamma (1 - d) min(Q1', Q2')(s', a')` (equation 4).
    fn real_targets(
        &self,
        batch: &Batch,
        smoothing: &[f32],
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let [first, second] = halves(batch.rows, |range| {
            let next = scaling.scale(rows_of(&batch.next_obs, self.obs_size, &range));
            let action = rows_of(&batch.action, self.action_size, &range);
            let bootstrap =
                self.bootstrap(&next, action, rows_of(smoothing, self.action_size, &range));
            let (reward, terminated) = (&batch.reward[range.clone()], &batch.terminated[range]);
            self.backup(reward, terminated, &bootstrap.value)
        });
        [first, second].concat()
    }

    /// Imaginary actions, where they lead, their targets and which of them are kept (equations 7
    /// to 9); the model's loss is left at 0.
    fn imaginary_targets(
        &self,
        imagination: &mut Imagination,
        sample: &Sample,
        obs: &[f32],
        observed: &[f32],
        y: &[f32],
        scaling: &ObservationScaling,
    ) -> ImaginaryTargets {
        let batch = &sample.batch;
        let draws = sample
            .imagination
            .as_ref()
            .expect("an agent that imagines is given draws");
        let noise_bound = imagination.noise_bound();
        let (so, sa, width) = (self.obs_size, self.action_size, observed.len() / batch.rows);
        let coupling = self.settings.coupling;

        let half = |range: Range<usize>| {
            let rows = |data, width| rows_of(data, width, &range);
            let mut action = self.actor.mlp().forward(rows(observed, width));
            coupling.output_in_place(&mut action);
            let bound = noise_bound as f32;
            for (u, z) in action.iter_mut().zip(rows(&draws.action, sa)) {
                *u += z.clamp(-bound, bound);
            }
            let previous = rows(&batch.previous_action, sa);
            coupling.execute_in_place(&mut action, previous);
            let imagined =
                imagination.imagine(rows(&batch.obs, so), rows(obs, so), &action, scaling);
            let bootstrap = self.bootstrap(&imagined.next_obs, &action, rows(&draws.smoothing, sa));
            let y_hat = self.backup(&imagined.reward, &imagined.terminated, &bootstrap.value);
            (action, y_hat, bootstrap.disagreement)
        };
        let [first, second] = halves(batch.rows, half);
        let action = [first.0, second.0].concat();
        let y_hat = [first.1, second.1].concat();
        let disagreement = [first.2, second.2].concat();
        imagination.decay_noise();
        let kept = imagination.filter(&y_hat, y, &disagreement, &draws.keep);
        ImaginaryTargets {
            action,
            y_hat,
            disagreement,
            kept,
            model_loss: 0.0,
            noise_bound,
        }
    }

    /// Target critics at the smoothed action of the target actor in `next_obs` (scaled), reached
    /// by `action`; `noise` is standard normal.
    fn bootstrap(&self, next_obs: &[f32], action: &[f32], noise: &[f32]) -> Bootstrap {
        let coupling = self.settings.coupling;
        let limit = coupling.limit as f32;
        let deviation = self.settings.smoothing.deviation as f32 * limit;
        let clip = self.settings.smoothing.clip as f32 * limit;

        let observed = self.observe(next_obs, action);
        let width = coupling.observed_width(self.obs_size, self.action_size);
        let mut next_action = self.target_actor.forward(&observed);
        coupling.output_in_place(&mut next_action);
        for (u, z) in next_action.iter_mut().zip(noise) {
            *u = (*u + (deviation * z).clamp(-clip, clip)).clamp(-limit, limit);
        }
        coupling.execute_in_place(&mut next_action, action);

        let input = side_by_side(&[(&observed, width), (&next_action, self.action_size)]);
        let [q1, q2] = self
            .target_critics
            .each_ref()
            .map(|critic| critic.forward(&input));
        let pairs = || q1.iter().zip(&q2);
        Bootstrap {
            value: pairs().map(|(a, b)| a.min(*b)).collect(),
            disagreement: pairs().map(|(a, b)| (a - b).abs()).collect(),
        }
    }

    /// `r + gamma (1 - d) value`.
    fn backup(&self, reward: &[f32], terminated: &[f32], value: &[f32]) -> Vec<f32> {
        let discount = self.settings.discount as f32;
        let rows = reward.iter().zip(terminated).zip(value);
        rows.map(|((r, d), v)| r + discount * (1.0 - d) * v)
            .collect()
    }

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
            imagination: targets.imaginary.as_ref().map(|i| ImaginationFigures {
                model_loss: i.model_loss,
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
        let gradient = self.actor.differentiate_by_rows(rows, |actor, range| {
            let observed = matrix(rows_of(observed, width, &range).to_vec(), width, &training);
            let previous = rows_of(&batch.previous_action, sa, &range).to_vec();
            let output = coupling.output(actor.forward(observed.clone()));
            let action = coupling.execute(output, matrix(previous, sa, &training));
            critic.forward(Tensor::cat(vec![observed, action], 1)).sum() * (-1.0 / rows as f64)
        });
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

    fn observe(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        self.settings
            .coupling
            .observe(obs, previous, self.obs_size, self.action_size)
    }
}

/// The gradient of the dynamics model's loss on `batch`.
fn model_gradient(model: &DynamicsModel, batch: &Batch, scaling: &ObservationScaling) -> Gradient {
    let (obs, next) = (scaling.scale(&batch.obs), scaling.scale(&batch.next_obs));
    model.differentiate(&obs, &batch.action, &next)
}
