//! The actor of SAC: a squashed Gaussian policy with a learned temperature, and no target.

use super::actor::{Actor, ActorBatch, NextOutput};
use super::critics::Critics;
use crate::agent::{AgentSettings, Metrics};
use crate::core::parallel::halves;
use crate::nn::{
    Coupling, Gradient, LearningState, Mlp, ScalarAdam, TrainableMlp, TrainableNetwork,
    WeightError, Weights, matrix, rows_of, to_vec,
};
use burn::tensor::activation::softplus;
use burn::tensor::{Device, Tensor, TensorData};
use std::f64::consts::{LN_2, PI};

/// Range of the log-deviations.
const LOG_DEVIATION: [f64; 2] = [-20.0, 2.0];

/// `u = middle + half tanh(m + exp(l) z)`, mean `m` and log-deviation `l` being the network's outputs.
///
/// Densities are those of `(u - middle) / half`: the constant `log half` a number is left out, so that the
/// target entropy `-|A|` means the same for every task.
pub struct Gaussian {
    actor: TrainableNetwork,
    coupling: Coupling,
    log_temperature: f64,
    adam: ScalarAdam,
}

impl Gaussian {
    /// A policy trained on `device`.
    pub fn new(settings: &AgentSettings, actor: Mlp, device: &Device) -> Self {
        Self {
            actor: TrainableNetwork::new(actor, settings.networks.actor_learning_rate, device),
            coupling: settings.coupling.clone(),
            log_temperature: settings.temperature.initial.ln(),
            adam: ScalarAdam::new(settings.temperature.learning_rate),
        }
    }

    /// The same with this logarithm of the temperature.
    pub fn at_log_temperature(mut self, log_temperature: f32) -> Self {
        self.log_temperature = log_temperature.into();
        self
    }

    fn temperature(&self) -> f64 {
        self.log_temperature.exp()
    }

    /// Sampled outputs `u` and their log-densities, `[n, 1]`, differentiable.
    fn sample(&self, actor: &TrainableMlp, observed: Tensor<2>, z: Tensor<2>) -> [Tensor<2>; 2] {
        let network = actor.forward(observed);
        let size = z.dims()[1];
        let mean = network.clone().narrow(1, 0, size);
        let log_deviation = network
            .narrow(1, size, size)
            .clamp(LOG_DEVIATION[0], LOG_DEVIATION[1]);
        let x = mean + log_deviation.clone().exp() * z.clone();
        let normal = (z.clone() * z) * -0.5 - log_deviation - 0.5 * (2.0 * PI).ln();
        // log(1 - tanh(x)^2), without its cancellation.
        let squash = (softplus(x.clone() * -2.0, 1.0) + x.clone() - LN_2) * -2.0;
        let log_density = (normal - squash).sum_dim(1);
        [self.coupling.spread(x.tanh()), log_density]
    }

    /// One step of the temperature towards the entropy `-|A|`, from the mean log-density of the
    /// actions sampled; its loss.
    fn step_temperature(&mut self, log_density: f64, action_size: usize) -> f64 {
        let excess = log_density - action_size as f64;
        let loss = -self.log_temperature * excess;
        self.log_temperature -= self.adam.step(-excess);
        loss
    }
}

/// Turns the network's outputs, `[n, 2 action_size]`, into sampled outputs `u`; their log-densities are
/// written to `log_density` if it is wanted.
pub fn sample_in_place(
    network: &[f32],
    noise: &[f32],
    coupling: &Coupling,
    mut log_density: Option<&mut Vec<f32>>,
) -> Vec<f32> {
    let ranges = coupling.ranges();
    let action_size = ranges.len();
    let constant = 0.5 * (2.0 * PI).ln() as f32;
    let [lowest, highest] = LOG_DEVIATION.map(|x| x as f32);
    let rows = network.chunks_exact(2 * action_size);
    let mut output = Vec::with_capacity(noise.len());
    for (row, noise) in rows.zip(noise.chunks_exact(action_size)) {
        let (mean, log_deviation) = row.split_at(action_size);
        let mut density = 0.0;
        for (((m, l), z), range) in mean.iter().zip(log_deviation).zip(noise).zip(ranges) {
            let l = l.clamp(lowest, highest);
            let x = m + l.exp() * z;
            output.push(range.half * x.tanh() + range.middle);
            if log_density.is_some() {
                let softplus = (-2.0 * x).max(0.0) + (-2.0 * x.abs()).exp().ln_1p();
                let squash = 2.0 * (LN_2 as f32 - x - softplus);
                density += -0.5 * z * z - l - constant - squash;
            }
        }
        if let Some(log_density) = &mut log_density {
            log_density.push(density);
        }
    }
    output
}

impl Actor for Gaussian {
    /// `middle + half tanh(m)`.
    fn output(&self, observed: &[f32]) -> Vec<f32> {
        let network = self.actor.mlp().forward(observed);
        let size = self.actor.mlp().outputs() / 2;
        let means = network.chunks_exact(2 * size).flat_map(|row| &row[..size]);
        let mut output: Vec<f32> = means.copied().collect();
        self.coupling.output_in_place(&mut output);
        output
    }

    fn next_output(&self, observed: &[f32], noise: &[f32]) -> NextOutput {
        let network = self.actor.mlp().forward(observed);
        let size = self.actor.mlp().outputs() / 2;
        let mut bonus = Vec::with_capacity(noise.len() / size);
        let output = sample_in_place(&network, noise, &self.coupling, Some(&mut bonus));
        let temperature = self.temperature() as f32;
        bonus.iter_mut().for_each(|x| *x *= -temperature);
        NextOutput {
            output,
            entropy_bonus: Some(bonus),
        }
    }

    /// On `mean(alpha log pi - min(Q1, Q2)(s, p, couple(u, p)))` with sampled `u`, then of the
    /// temperature. The critics' parameters get no gradients.
    fn step(&mut self, batch: ActorBatch<'_>, critics: &Critics, metrics: &mut Metrics) {
        let width = batch.observed.len() / batch.rows;
        let sa = batch.previous_action.len() / batch.rows;
        let device = self.actor.device().clone();
        let frozen = critics.frozen();
        let temperature = self.temperature();
        let parts = halves(batch.rows, |range| {
            let rows = |data: &[f32], width: usize| {
                matrix(rows_of(data, width, &range).to_vec(), width, &device)
            };
            let mut log_densities = Vec::new();
            let gradient = self.actor.differentiate(|actor| {
                let observed = rows(batch.observed, width);
                let noise = rows(batch.noise, sa);
                let [output, log_density] = self.sample(actor, observed.clone(), noise);
                log_densities = to_vec(log_density.clone().without_autodiff());
                let previous = rows(batch.previous_action, sa);
                let action = self.coupling.execute(output, previous);
                let input = Tensor::cat(vec![observed, action], 1);
                let values = frozen.iter().map(|critic| critic.forward(input.clone()));
                let value = values.reduce(Tensor::min_pair).expect("critics");
                (log_density * temperature - value).sum() * (1.0 / batch.rows as f64)
            });
            (gradient, log_densities)
        });
        let sum = |densities: &[f32]| densities.iter().map(|x| f64::from(*x)).sum::<f64>();
        let log_density = (sum(&parts[0].1) + sum(&parts[1].1)) / batch.rows as f64;
        let gradient = Gradient::sum(parts.map(|(gradient, _)| gradient));
        metrics.set("actor_loss", gradient.loss());
        self.actor.step(gradient);
        let temperature_loss = self.step_temperature(log_density, sa);
        metrics.set("temperature", temperature as f32);
        metrics.set("temperature_loss", temperature_loss as f32);
        // Of actions that reach from -1 to 1.
        metrics.set("entropy", -(log_density as f32));
    }

    fn move_target(&mut self, _: f64) {}

    fn save(&self, weights: &mut Weights) {
        self.actor.mlp().save("actor", weights);
        let log_temperature = TensorData::new(vec![self.log_temperature as f32], [1]);
        weights.insert("log_temperature".to_owned(), log_temperature);
    }

    fn is_finite(&self) -> bool {
        self.actor.is_finite() && self.log_temperature.is_finite()
    }

    fn save_state(&self, state: &mut LearningState) {
        self.actor.save_optimizer("actor", state);
        // The weights hold it in single precision.
        state.set("log_temperature", self.log_temperature);
        self.adam.save("temperature", state);
    }

    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.actor.restore_optimizer("actor", state)?;
        self.log_temperature = state.number("log_temperature")?;
        self.adam.restore("temperature", state)
    }

    fn network(&self) -> &Mlp {
        self.actor.mlp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::span::Span;

    #[test]
    fn densities_integrate_to_one() {
        let coupling = Coupling::new(1.0, &[Span::symmetric(2.0)]);
        // One number with mean 0.3 and deviation 0.7: the density of u / limit over its range.
        let network = [0.3f32, 0.7f32.ln()];
        let (steps, mut integral) = (4000, 0.0);
        for i in 0..steps {
            let y = -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(steps);
            let z = ((y.atanh() - 0.3) / 0.7) as f32;
            let mut density = Vec::new();
            let u = sample_in_place(&network, &[z], &coupling, Some(&mut density));
            assert!((f64::from(u[0]) - 2.0 * y).abs() < 1e-5);
            integral += f64::from(density[0]).exp() * 2.0 / f64::from(steps);
        }
        assert!((integral - 1.0).abs() < 1e-3, "{integral}");
    }

    #[test]
    fn far_out_the_density_stays_finite() {
        let coupling = Coupling::new(1.0, &[Span::symmetric(1.0)]);
        for mean in [-80.0f32, 80.0] {
            let mut density = Vec::new();
            let u = sample_in_place(&[mean, -30.0], &[0.0], &coupling, Some(&mut density));
            assert_eq!(u[0].abs(), 1.0);
            // -l + 2 |x| - 2 log 2 - log(2 pi) / 2 with l = -20.
            assert!(
                (density[0] - (20.0 + 160.0 - 2.305)).abs() < 0.01,
                "{density:?}"
            );
        }
    }
}
