//! The update agrees with an independent implementation, `scripts/reference_update.py`, whose
//! results lie in `fixtures/update` (see the README there).

use mamf::agent::augment::expansion::RolloutStep;
use mamf::agent::augment::imagination::{
    Draws, ImaginaryTargets, Imagination, ImaginationSettings, OptimisticBias, Readings,
};
use mamf::agent::augment::{Augment, Expansion, ExpansionSettings, Plain};
use mamf::agent::{
    ActorCritic, AgentSettings, BaseAlgorithm, Imitation, Sample, SmoothingSettings, TargetRule,
    TargetValue, TemperatureSettings, Update, targets,
};
use mamf::core::span::Span;
use mamf::env;
use mamf::model::{DynamicsModel, DynamicsShape, ModelSettings, World};
use mamf::nn::{Backend, Coupling, NetworkSettings, Normalisation, ObservationScaling, Weights};
use mamf::replay::Batch;
use mamf::task::VelocityReading;
use safetensors::SafeTensors;
use serde_json::Value;
use std::path::PathBuf;

/// Largest relative error of losses, targets and parameters.
const TOLERANCE: f64 = 1e-5;

struct Case {
    bytes: Vec<u8>,
    settings: Value,
}

impl Case {
    fn load(name: &str) -> Case {
        let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "tests/fixtures/update", name]
            .iter()
            .collect();
        let bytes = std::fs::read(path.with_extension("safetensors")).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let text = &header.metadata().as_ref().unwrap()["settings"];
        let settings = serde_json::from_str(text).unwrap();
        Case { bytes, settings }
    }

    fn f(&self, key: &str) -> f64 {
        self.settings[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}"))
    }

    fn n(&self, key: &str) -> usize {
        self.settings[key]
            .as_u64()
            .unwrap_or_else(|| panic!("{key}")) as usize
    }

    fn b(&self, key: &str) -> bool {
        self.settings[key]
            .as_bool()
            .unwrap_or_else(|| panic!("{key}"))
    }

    /// A setting whose type reads the same strings.
    fn parse<T: serde::de::DeserializeOwned>(&self, key: &str) -> T {
        serde_json::from_value(self.settings[key].clone()).unwrap_or_else(|e| panic!("{key}: {e}"))
    }

    fn array(&self, name: &str) -> Vec<f64> {
        let tensors = SafeTensors::deserialize(&self.bytes).unwrap();
        let view = tensors
            .tensor(name)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let data = view.data();
        match view.dtype() {
            safetensors::Dtype::F32 => data
                .chunks_exact(4)
                .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
                .collect(),
            safetensors::Dtype::F64 => data
                .chunks_exact(8)
                .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
                .collect(),
            other => panic!("{name}: {other:?}"),
        }
    }

    fn single(&self, name: &str) -> Vec<f32> {
        self.array(name).iter().map(|x| *x as f32).collect()
    }

    /// The networks before the first step.
    fn weights(&self) -> Weights {
        let mut weights = Weights::default();
        for (name, view) in SafeTensors::deserialize(&self.bytes).unwrap().iter() {
            if let Some(network) = name.strip_prefix("in.")
                && network.contains(".l")
            {
                let data = burn::tensor::TensorData::new(self.single(name), view.shape().to_vec());
                weights.insert(network.to_owned(), data);
            }
        }
        if self.base() == BaseAlgorithm::Sac {
            let data = burn::tensor::TensorData::new(self.single("in.log_alpha"), [1]);
            weights.insert("log_temperature".to_owned(), data);
        }
        weights
    }

    fn base(&self) -> BaseAlgorithm {
        match self.settings["base"].as_str().unwrap() {
            "td3" => BaseAlgorithm::Td3,
            "ddpg" => BaseAlgorithm::Ddpg,
            "sac" => BaseAlgorithm::Sac,
            other => panic!("{other}"),
        }
    }

    fn has_model(&self) -> bool {
        self.b("imagination") || self.n("horizon") > 0
    }

    fn world(&self, weights: &Weights) -> World {
        let velocity: VelocityReading = self.parse("velocity");
        let rules = env::rules(self.settings["task"].as_str().unwrap(), velocity).unwrap();
        let known: Vec<usize> = self.parse("known");
        assert_eq!(rules.known(), known);
        let shape = DynamicsShape {
            obs_size: self.n("observation_size"),
            action_size: self.n("action_size"),
            known: &known,
            learns_reward: self.settings["reward"] == "learned",
        };
        let model = ModelSettings {
            hidden: self.parse("model_hidden"),
            learning_rate: self.f("model_lr"),
            predict: self.parse("predict"),
        };
        let device = Backend::Flex.device();
        let model = DynamicsModel::load(&model, shape, weights, &device).unwrap();
        World::new(model, rules)
    }

    fn augmentation(&self, weights: &Weights) -> Added {
        if self.n("horizon") > 0 {
            let settings = ExpansionSettings {
                horizon: self.n("horizon"),
            };
            let world = self.world(weights);
            return Added::Expansion(Box::new(Expansion::new(&settings, world, 0)));
        }
        if !self.b("imagination") {
            return Added::Nothing(Plain);
        }
        let comparison = if self.b("strict") {
            "greater"
        } else {
            "greater_equal"
        };
        let settings = ImaginationSettings {
            optimism: false,
            noise_decay: self.b("noise_decay"),
            target_filter: self.b("target_filter"),
            uncertainty_filter: self.b("uncertainty_filter"),
            noise_deviation: self.f("noise_deviation"),
            noise_relative: self.b("noise_relative"),
            noise_bound: 1.0,
            bias: OptimisticBias::Return,
            bias_factor: 0.0,
            decay_rate: self.f("rho"),
            readings: Readings::Text,
            target_comparison: serde_json::from_value(comparison.into()).unwrap(),
            uncertainty_scale: self.parse("uncertainty_scale"),
            imaginary_loss_mean: self.parse("imaginary_loss_mean"),
        };
        let mut imagination = Imagination::new(&settings, &self.ranges(), self.world(weights), 0);
        imagination.set_progress(self.f("eta"), self.f("running_max") as f32);
        Added::Imagination(Box::new(imagination))
    }

    fn ranges(&self) -> Vec<Span> {
        vec![Span::symmetric(self.f("a_max")); self.n("action_size")]
    }

    fn core(&self, weights: &Weights) -> ActorCritic {
        let settings = AgentSettings {
            base: self.base(),
            networks: NetworkSettings {
                hidden: self.parse("hidden"),
                actor_learning_rate: self.f("actor_lr"),
                critic_learning_rate: self.f("critic_lr"),
                critic_normalisation: Normalisation::None,
                saturation_penalty: 0.0,
            },
            coupling: Coupling::new(self.f("beta"), &self.ranges()),
            discount: self.f("gamma"),
            targets: TargetRule::Polyak { tau: self.f("tau") },
            policy_delay: self.n("policy_delay") as u64,
            smoothing: SmoothingSettings {
                deviation: 0.2,
                clip: 0.5,
            },
            temperature: TemperatureSettings {
                initial: self.f("initial_temperature"),
                learning_rate: self.f("temperature_lr"),
            },
            target_value: TargetValue::Minimum,
            imitation: Imitation {
                weight: 0.0,
                filter: true,
            },
        };
        ActorCritic::load(
            settings,
            self.n("observation_size"),
            self.n("action_size"),
            weights,
            &Backend::Flex.device(),
        )
        .unwrap()
    }

    /// The batch of the given name in step `step`; its rewards and ends may be missing.
    fn batch(&self, step: usize, name: &str) -> Batch {
        let (rows, sa) = (self.n("batch_size"), self.n("action_size"));
        let input = |field: &str| self.single(&format!("in.{step}.{name}.{field}"));
        let or_zeros = |field: &str, length: usize| {
            if self.has(&format!("in.{step}.{name}.{field}")) {
                input(field)
            } else {
                vec![0.0; length]
            }
        };
        Batch {
            rows,
            obs: input("obs"),
            action: input("action"),
            reward: or_zeros("reward", rows),
            next_obs: input("next_obs"),
            terminated: or_zeros("terminated", rows),
            previous_action: or_zeros("prev_action", rows * sa),
            ..Batch::default()
        }
    }

    /// Noise of step `step`; nothing where the method has none of that name.
    fn noise(&self, step: usize, name: &str) -> Vec<f32> {
        let name = format!("in.{step}.noise.{name}");
        if self.has(&name) {
            self.single(&name)
        } else {
            Vec::new()
        }
    }

    fn has(&self, name: &str) -> bool {
        let tensors = SafeTensors::deserialize(&self.bytes).unwrap();
        tensors.tensor(name).is_ok()
    }

    /// The sample of a critic update that comes before the step's own, if there is one.
    fn extra_sample(&self, step: usize) -> Option<Sample> {
        (self.n("critic_updates") > 1).then(|| Sample {
            batch: self.batch(step, "extra_batch"),
            next_noise: self.noise(step, "smoothing_extra"),
            actor_noise: Vec::new(),
        })
    }

    fn sample(&self, step: usize) -> Sample {
        let batch = self.batch(step, "batch");
        // DDPG smooths nothing; the noise it is given must not matter.
        let mut smoothing = self.noise(step, "smoothing");
        if smoothing.is_empty() {
            smoothing = vec![1.0; batch.action.len()];
        }
        Sample {
            next_noise: smoothing,
            actor_noise: self.noise(step, "policy"),
            batch,
        }
    }

    /// What the augmentation draws in step `step`.
    fn give(&self, step: usize, added: &mut Added) {
        match added {
            Added::Nothing(_) => (),
            Added::Expansion(expansion) => {
                expansion
                    .learned_mut()
                    .give(self.batch(step, "model_batch"));
            }
            Added::Imagination(imagination) => {
                let draws = Draws {
                    action: self.noise(step, "imaginary"),
                    next: self.noise(step, "smoothing_imaginary"),
                    keep: self.noise(step, "keep"),
                };
                imagination.give(draws, self.batch(step, "model_batch"));
            }
        }
    }
}

/// An augmentation that can be looked into.
enum Added {
    Nothing(Plain),
    Imagination(Box<Imagination>),
    Expansion(Box<Expansion>),
}

impl Added {
    fn augment(&mut self) -> &mut dyn Augment {
        match self {
            Added::Nothing(plain) => plain,
            Added::Imagination(imagination) => imagination.as_mut(),
            Added::Expansion(expansion) => expansion.as_mut(),
        }
    }
}

/// Of one critic update: the losses and the figures agree with what is expected under `prefix`.
fn agree_on_losses(update: &Update, prefix: &str, out: &impl Fn(&str) -> Vec<f64>, label: &str) {
    for (i, loss) in update.critic_losses.iter().enumerate() {
        let expected = out(&format!("{prefix}critic{}_loss", i + 1));
        agree(label, &[*loss], &expected);
    }
    let sum: f64 = update.critic_losses.iter().map(|l| f64::from(*l)).sum();
    assert_eq!(update.metrics.get("critic_loss"), Some(sum), "{label}");
}

/// Compares with the largest expected number as the scale, so that numbers near 0 count as what
/// they are beside the others.
#[track_caller]
fn agree(what: &str, found: &[f32], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected
        .iter()
        .fold(0.0f64, |m, x| m.max(x.abs()))
        .max(1e-30);
    let error = found
        .iter()
        .zip(expected)
        .map(|(a, b)| (f64::from(*a) - b).abs())
        .fold(0.0, f64::max);
    assert!(
        error <= TOLERANCE * scale,
        "{what}: error {error:e} at scale {scale:e}"
    );
}

fn reproduces(name: &str) {
    let case = Case::load(name);
    let scaling = ObservationScaling::new(
        case.single("in.scaling.mean"),
        case.single("in.scaling.deviation"),
        5.0,
    );
    let weights = case.weights();
    let (mut core, mut added) = (case.core(&weights), case.augmentation(&weights));
    for step in 0..case.n("steps") {
        let out = |name: &str| case.array(&format!("out.{step}.{name}"));
        let label = |what: &str| format!("{name}, step {step}, {what}");
        let rows = case.n("batch_size");
        if let Some(sample) = case.extra_sample(step) {
            let found = targets(&core, added.augment(), &sample, &scaling);
            agree(&label("first y"), &found.rows.y, &out("extra_y"));
            let update = core.step_critics(found.rows, rows, found.metrics);
            agree_on_losses(&update, "extra_", &out, &label("first loss of a critic"));
        }
        let sample = case.sample(step);
        case.give(step, &mut added);
        let found = targets(&core, added.augment(), &sample, &scaling);
        agree(&label("y"), &found.rows.y[..rows], &out("y"));
        let model_loss = found.metrics.get("model_loss");
        assert_eq!(model_loss.is_some(), case.has_model());
        if let Some(loss) = model_loss {
            agree(&label("model loss"), &[loss as f32], &out("model_loss"));
        }
        match &added {
            Added::Nothing(_) => (),
            Added::Imagination(imagination) => {
                compare_imaginary(imagination.last(), &out, &label);
            }
            Added::Expansion(expansion) => compare_expanded(expansion.last(), &out, &label),
        }
        let wanted = found.rows.y[..rows].to_vec();
        let mut update = core.step_critics(found.rows, rows, found.metrics);
        core.step_actor_if_due(&sample, &found.observed, &mut update);
        assert_eq!(update.critic_losses.len(), case.base().critics());
        assert_eq!((update.errors.len(), wanted.len()), (rows, rows));
        assert!(update.errors.iter().all(|e| *e >= 0.0));
        agree_on_losses(&update, "", &out, &label("loss of a critic"));
        let due = (step + 1).is_multiple_of(case.n("policy_delay"));
        assert_eq!(update.actor_changed, due);
        let told = |name: &str| update.metrics.get(name);
        assert_eq!(told("actor_loss").is_some(), due);
        if let Some(loss) = told("actor_loss") {
            agree(&label("actor loss"), &[loss as f32], &out("actor_loss"));
        }
        assert_eq!(told("entropy").is_some(), case.base() == BaseAlgorithm::Sac);
        if let (Some(entropy), Some(loss)) = (told("entropy"), told("temperature_loss")) {
            agree(&label("log pi"), &[-entropy as f32], &out("log_pi"));
            agree(
                &label("temperature loss"),
                &[loss as f32],
                &out("temperature_loss"),
            );
            let mut weights = Weights::default();
            core.save(&mut weights);
            let log_temperature = weights.get("log_temperature", &[1]).unwrap();
            agree(&label("log alpha"), &log_temperature, &out("log_alpha"));
        }
    }
    let mut weights = Weights::default();
    core.save(&mut weights);
    if let Some(learned) = added.augment().learned() {
        learned.world.model.save(&mut weights);
    }
    let last = case.n("steps") - 1;
    let networks: Vec<_> = weights.names().filter(|n| n.contains(".l")).collect();
    assert!(networks.len() >= 24, "{networks:?}");
    for network in networks {
        let expected = case.array(&format!("out.{last}.{network}"));
        let shape = SafeTensors::deserialize(&case.bytes)
            .unwrap()
            .tensor(&format!("in.{network}"))
            .unwrap()
            .shape()
            .to_vec();
        agree(
            &format!("{name}, {network}"),
            &weights.get(network, &shape).unwrap(),
            &expected,
        );
    }
}

fn compare_imaginary(
    imaginary: &ImaginaryTargets,
    out: &impl Fn(&str) -> Vec<f64>,
    label: &impl Fn(&str) -> String,
) {
    agree(&label("eta"), &[imaginary.noise_bound as f32], &out("eta"));
    agree(&label("a_hat"), &imaginary.action, &out("a_hat"));
    agree(&label("y_hat"), &imaginary.y_hat, &out("y_hat"));
    agree(&label("delta"), &imaginary.disagreement, &out("delta"));
    let mask = out("keep_mask");
    let kept: Vec<usize> = (0..mask.len()).filter(|&i| mask[i] == 1.0).collect();
    assert_eq!(imaginary.kept.rows, kept, "{}", label("kept rows"));
    let passed = |name: &str| out(name).iter().sum::<f64>();
    assert_eq!(imaginary.kept.by_target as f64, passed("target_mask"));
    assert_eq!(
        imaginary.kept.by_uncertainty as f64,
        passed("uncertainty_mask")
    );
}

fn compare_expanded(
    expanded: &[RolloutStep],
    out: &impl Fn(&str) -> Vec<f64>,
    label: &impl Fn(&str) -> String,
) {
    let joined = |part: fn(&RolloutStep) -> &Vec<f32>| -> Vec<f32> {
        expanded.iter().flat_map(part).copied().collect()
    };
    let actions = joined(|step| &step.action);
    agree(&label("actions"), &actions, &out("a_positions"));
    let y = joined(|step| &step.y);
    agree(&label("y at all positions"), &y, &out("y_positions"));
    let mask: Vec<f64> = joined(|step| &step.mask)
        .into_iter()
        .map(f64::from)
        .collect();
    assert_eq!(mask, out("mask"), "{}", label("mask"));
}

macro_rules! cases {
    ($($name:ident)*) => {
        $(#[test] fn $name() { reproduces(stringify!($name)); })*

        #[test]
        fn every_fixture_is_tested() {
            let tested = [$(stringify!($name)),*];
            let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/update");
            for entry in std::fs::read_dir(directory).unwrap() {
                let path = entry.unwrap().path();
                if path.extension().is_some_and(|e| e == "safetensors") {
                    let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
                    assert!(tested.contains(&name.as_str()), "{name}");
                }
            }
        }
    };
}

cases! {
    td3
    td3_uncoupled
    mamf_paper
    mamf_released
    mamf_no_target_filter
    mamf_no_uncertainty_filter
    mamf_delta
    mamf_reacher
    mamf_pendulum
    mamf_pendulum_uncoupled
    mamf_nothing_kept
    mamf_learned_reward
    mamf_sac
    ma_td3
    ma_td3_pendulum
    mve
    mve_pendulum
    mve_reacher_h1
    ddpg
    ddpg_uncoupled
    sac
    sac_uncoupled
    sac_pendulum
    td3_critic2
}
