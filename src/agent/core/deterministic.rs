//! The actor of DDPG and TD3: a deterministic policy with a target network.

use super::actor::{Actor, ActorBatch, NextOutput};
use super::critics::Critics;
use crate::agent::{AgentSettings, BaseAlgorithm, Imitation, Metrics, SmoothingSettings};
use crate::core::parallel::halves;
use crate::nn::{
    Coupling, Gradient, LearningState, Mlp, TrainableNetwork, WeightError, Weights, matrix, rows_of,
};
use burn::tensor::{Device, Tensor};
use std::ops::Range;

/// Smallest `mean |Q1|` that the critic's part of the loss is divided by.
const VALUE_SCALE_FLOOR: f32 = 1e-3;

/// A deterministic policy and its target, whose actions TD3 smooths and DDPG does not.
pub struct Deterministic {
    actor: TrainableNetwork,
    target: Mlp,
    coupling: Coupling,
    smoothing: Option<SmoothingSettings>,
    imitation: Imitation,
    saturation_penalty: f64,
}

impl Deterministic {
    /// A policy trained on `device`.
    pub fn new(settings: &AgentSettings, actor: Mlp, target: Mlp, device: &Device) -> Self {
        let smooths = settings.base == BaseAlgorithm::Td3;
        Self {
            actor: TrainableNetwork::new(actor, settings.networks.actor_learning_rate, device),
            target,
            coupling: settings.coupling.clone(),
            smoothing: smooths.then(|| settings.smoothing.clone()),
            imitation: settings.imitation,
            saturation_penalty: settings.networks.saturation_penalty,
        }
    }
}

impl Actor for Deterministic {
    fn output(&self, observed: &[f32]) -> Vec<f32> {
        let mut output = self.actor.mlp().forward(observed);
        self.coupling.output_in_place(&mut output);
        output
    }

    fn next_output(&self, observed: &[f32], noise: &[f32]) -> NextOutput {
        let mut output = self.target.forward(observed);
        self.coupling.output_in_place(&mut output);
        if let Some(smoothing) = &self.smoothing {
            let mut noise = noise.iter();
            self.coupling.each(&mut output, |u, range| {
                let z = noise.next().copied().unwrap_or_default();
                let deviation = smoothing.deviation as f32 * range.half;
                let clip = smoothing.clip as f32 * range.half;
                let smoothed = *u + (deviation * z).clamp(-clip, clip);
                *u = smoothed.clamp(range.low, range.high);
            });
        }
        NextOutput {
            output,
            entropy_bonus: None,
        }
    }

    /// On `-mean Q1(s, p, couple(pi(s), p))`, or, where recorded actions are imitated or saturation costs something,
    /// that over `mean |Q1|`, the [imitation](Imitation) of these and the penalty. The critic's parameters get no
    /// gradients.
    fn step(&mut self, batch: ActorBatch<'_>, critics: &Critics, metrics: &mut Metrics) {
        let width = batch.observed.len() / batch.rows;
        let sa = batch.previous_action.len() / batch.rows;
        let device = self.actor.device().clone();
        let critic = critics.first().frozen();
        let (coupling, imitation) = (&self.coupling, self.imitation);
        let first_recorded = batch.rows - batch.recorded;
        let imitates = imitation.weight > 0.0 && batch.recorded > 0;
        let penalty = self.saturation_penalty;
        let scale = if imitates || penalty > 0.0 {
            f64::from(batch.value_scale.max(VALUE_SCALE_FLOOR))
        } else {
            1.0
        };
        let share = imitation.weight / (batch.recorded * sa) as f64;
        let gradient = Gradient::sum(halves(batch.rows, |range| {
            let rows = |numbers: &[f32], width: usize, range: &Range<usize>| {
                matrix(rows_of(numbers, width, range).to_vec(), width, &device)
            };
            self.actor.differentiate(|actor| {
                let observed = rows(batch.observed, width, &range);
                let previous = rows(batch.previous_action, sa, &range);
                let network = actor.forward(observed.clone());
                let action = coupling.execute(coupling.output(network.clone()), previous);
                let q = critic.forward(Tensor::cat(vec![observed.clone(), action.clone()], 1));
                let mut climb = q.clone().sum() * (-1.0 / (batch.rows as f64 * scale));
                if penalty > 0.0 {
                    climb = climb + network.square().sum() * (penalty / (batch.rows * sa) as f64);
                }
                let recorded = first_recorded.max(range.start)..range.end;
                if !imitates || recorded.is_empty() {
                    return climb;
                }
                let here = recorded.start - range.start..range.end - range.start;
                let of = |rows: Tensor<2>| rows.slice(here.clone());
                let said = rows(batch.action, sa, &recorded);
                let mut error = (of(action) - said.clone()).square().sum_dim(1);
                if imitation.filter {
                    let recorded = critic.forward(Tensor::cat(vec![of(observed), said], 1));
                    error = error * recorded.greater(of(q)).float();
                }
                climb + error.sum() * share
            })
        }));
        metrics.set("actor_loss", gradient.loss());
        self.actor.step(gradient);
    }

    fn move_target(&mut self, tau: f64) {
        self.target.polyak(self.actor.mlp(), tau);
    }

    fn save(&self, weights: &mut Weights) {
        self.actor.mlp().save("actor", weights);
        self.target.save("target_actor", weights);
    }

    fn is_finite(&self) -> bool {
        self.actor.is_finite()
    }

    fn save_state(&self, state: &mut LearningState) {
        self.actor.save_optimizer("actor", state);
    }

    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.actor.restore_optimizer("actor", state)
    }

    fn network(&self) -> &Mlp {
        self.actor.mlp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::{ActorCritic, TargetValue};
    use crate::config::{Config, Method};
    use crate::core::random::{Stream, fill_normal, stream};
    use crate::core::span::Span;
    use crate::nn::Backend;

    const ROWS: usize = 12;
    const RECORDED: usize = 4;
    const OBS: usize = 3;
    const ACTION: usize = 2;

    fn settings(weight: f64, filter: bool) -> AgentSettings {
        let mut config = Config::preset(Method::Td3);
        config.networks.hidden = vec![16];
        AgentSettings {
            base: BaseAlgorithm::Td3,
            networks: config.networks,
            coupling: Coupling::new(0.7, &[Span::symmetric(1.0); ACTION]),
            discount: 0.98,
            targets: crate::agent::TargetRule::Polyak { tau: 0.005 },
            policy_delay: 2,
            smoothing: config.target_smoothing,
            temperature: config.temperature,
            target_value: TargetValue::Minimum,
            imitation: Imitation { weight, filter },
        }
    }

    /// Actor and critics of one seed, and numbers to observe and to do.
    struct Case {
        actor: Deterministic,
        critics: Critics,
        observed: Vec<f32>,
        previous: Vec<f32>,
        action: Vec<f32>,
    }

    fn case(weight: f64, filter: bool) -> Case {
        let (settings, device) = (settings(weight, filter), Backend::Flex.device());
        let mut rng = stream(5, "imitation");
        let network = Mlp::new(&settings.actor(OBS, ACTION), &mut rng);
        let numbers = |n: usize, rng: &mut Stream| {
            let mut numbers = vec![0.0; n];
            fill_normal(rng, &mut numbers);
            numbers.iter().map(|x: &f32| x.clamp(-0.9, 0.9)).collect()
        };
        let observed: Vec<f32> = numbers(ROWS * (OBS + ACTION), &mut rng);
        Case {
            critics: Critics::new(&settings, &settings.critic(OBS, ACTION), &mut rng, &device),
            actor: Deterministic::new(&settings, network.clone(), network, &device),
            observed,
            previous: numbers(ROWS * ACTION, &mut rng),
            action: numbers(ROWS * ACTION, &mut rng),
        }
    }

    impl Case {
        /// One step, the last rows being recorded; the actor's loss before it.
        fn step(&mut self) -> f64 {
            let mut metrics = Metrics::default();
            let batch = ActorBatch {
                rows: ROWS,
                observed: &self.observed,
                previous_action: &self.previous,
                action: &self.action,
                recorded: RECORDED,
                value_scale: 0.5,
                noise: &[],
            };
            self.actor.step(batch, &self.critics, &mut metrics);
            metrics
                .iter()
                .find(|(name, _)| *name == "actor_loss")
                .unwrap()
                .1
        }

        /// What the actor does, and `Q1` of that and of the recorded actions.
        fn judged(&self) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
            let mut done = self.actor.output(&self.observed);
            self.actor
                .coupling
                .execute_in_place(&mut done, &self.previous);
            let q = |action: &[f32]| {
                let input =
                    crate::nn::side_by_side(&[(&self.observed, OBS + ACTION), (action, ACTION)]);
                self.critics.first().mlp().forward(&input)
            };
            let (said, recorded) = (q(&done), q(&self.action));
            (done, said, recorded)
        }

        /// The loss as its definition says, the imitation being of rows that `counts`.
        fn expected(&self, weight: f64, counts: impl Fn(f32, f32) -> bool) -> f64 {
            let (done, said, recorded) = self.judged();
            let climb: f64 = said.iter().map(|q| f64::from(-q) / ROWS as f64 / 0.5).sum();
            let rows = (ROWS - RECORDED..ROWS).filter(|i| counts(recorded[*i], said[*i]));
            let errors = rows.flat_map(|i| i * ACTION..(i + 1) * ACTION);
            let squares = errors.map(|i| f64::from(done[i] - self.action[i]).powi(2));
            climb + weight * squares.sum::<f64>() / (RECORDED * ACTION) as f64
        }
    }

    #[test]
    fn the_loss_is_that_of_the_definition_with_and_without_the_filter() {
        let mut plain = case(3.0, false);
        let expected = plain.expected(3.0, |_, _| true);
        assert!((plain.step() - expected).abs() < 1e-5);
        let mut filtered = case(3.0, true);
        let preferred = filtered.expected(3.0, |recorded, said| recorded > said);
        assert!((filtered.step() - preferred).abs() < 1e-5);
        assert!(
            (preferred - expected).abs() > 1e-3,
            "the filter drops some row"
        );
        assert!(
            (preferred - filtered.expected(0.0, |_, _| true)).abs() > 1e-3,
            "and keeps some"
        );
    }

    #[test]
    fn saturation_costs_the_mean_square_of_what_is_squashed() {
        let mut case = case(0.0, true);
        case.actor.saturation_penalty = 0.3;
        let network = case.actor.actor.mlp().forward(&case.observed);
        let squares = network.iter().map(|z| f64::from(z * z)).sum::<f64>();
        let penalty = 0.3 * squares / (ROWS * ACTION) as f64;
        assert!(penalty > 1e-3);
        let expected = case.expected(0.0, |_, _| true) + penalty;
        assert!((case.step() - expected).abs() < 1e-5);
        for _ in 0..300 {
            case.actor.saturation_penalty = 1e4;
            case.step();
        }
        let network = case.actor.actor.mlp().forward(&case.observed);
        let left = network.iter().map(|z| f64::from(z * z)).sum::<f64>();
        assert!(left < 0.1 * squares, "{squares} {left}");
    }

    #[test]
    fn imitation_leads_to_the_recorded_actions() {
        let mut case = case(1e4, false);
        let distance =
            |case: &Case| case.expected(1.0, |_, _| true) - case.expected(0.0, |_, _| true);
        let before = distance(&case);
        for _ in 0..3000 {
            case.step();
        }
        assert!(
            distance(&case) < 0.1 * before,
            "{before} {}",
            distance(&case)
        );
    }

    #[test]
    fn the_mean_of_both_critics_is_half_their_disagreement_above_the_minimum() {
        let values = |target_value| {
            let settings = AgentSettings {
                target_value,
                ..settings(0.0, true)
            };
            let (device, mut rng) = (Backend::Flex.device(), stream(7, "init"));
            let core = ActorCritic::new(settings, OBS, ACTION, &mut rng, &device);
            core.bootstrap(&[0.5, -1.0, 0.2], &[0.1, -0.3], &[0.0, 1.0])
        };
        let (minimum, mean) = (values(TargetValue::Minimum), values(TargetValue::Mean));
        let expected = minimum.value[0] + 0.5 * minimum.disagreement[0];
        assert!((mean.value[0] - expected).abs() < 1e-6);
        assert!(minimum.disagreement[0] > 1e-3);
    }
}
