//! The update agrees with an independent implementation, `scripts/reference_update.py`, whose
//! results lie in `fixtures/update` (see the README there).

use mamf::agent::{ImaginationDraws, Sample, SmoothingSettings, Td3, Td3Settings};
use mamf::env::{self, VelocityReading};
use mamf::imagination::{
    DynamicsModel, DynamicsShape, Imagination, ImaginationSettings, ModelSettings,
};
use mamf::nn::{Backend, Coupling, NetworkSettings, ObservationScaling, Weights};
use mamf::replay::Batch;
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
        weights
    }

    fn agent(&self) -> Td3 {
        let device = Backend::Flex.device();
        let weights = self.weights();
        let coupling = Coupling {
            beta: self.f("beta"),
            limit: self.f("a_max"),
        };
        let settings = Td3Settings {
            networks: NetworkSettings {
                hidden: self.parse("hidden"),
                actor_learning_rate: self.f("actor_lr"),
                critic_learning_rate: self.f("critic_lr"),
            },
            coupling,
            discount: self.f("gamma"),
            tau: self.f("tau"),
            policy_delay: self.n("policy_delay") as u64,
            smoothing: SmoothingSettings {
                deviation: 0.2,
                clip: 0.5,
            },
        };
        let imagination = self.b("imagination").then(|| {
            let velocity: VelocityReading = self.parse("velocity");
            let rules = env::rules(self.settings["task"].as_str().unwrap(), velocity).unwrap();
            let known: Vec<usize> = self.parse("known");
            assert_eq!(rules.known(), known);
            let shape = DynamicsShape {
                obs_size: self.n("observation_size"),
                action_size: self.n("action_size"),
                known: &known,
            };
            let model = ModelSettings {
                hidden: self.parse("model_hidden"),
                learning_rate: self.f("model_lr"),
                predict: self.parse("predict"),
            };
            let model = DynamicsModel::load(&model, shape, &weights, &device).unwrap();
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
                bias_factor: 0.0,
                decay_rate: self.f("rho"),
                target_comparison: serde_json::from_value(comparison.into()).unwrap(),
                uncertainty_scale: self.parse("uncertainty_scale"),
                imaginary_loss_mean: self.parse("imaginary_loss_mean"),
            };
            Imagination::new(&settings, coupling.limit, model, rules)
                .with_progress(self.f("eta"), self.f("running_max") as f32)
        });
        let (obs_size, action_size) = (self.n("observation_size"), self.n("action_size"));
        Td3::load(
            settings,
            obs_size,
            action_size,
            imagination,
            &weights,
            &device,
        )
        .unwrap()
    }

    fn sample(&self, step: usize) -> Sample {
        let input = |name: &str| self.single(&format!("in.{step}.{name}"));
        let batch = Batch {
            rows: self.n("batch_size"),
            obs: input("batch.obs"),
            action: input("batch.action"),
            reward: input("batch.reward"),
            next_obs: input("batch.next_obs"),
            terminated: input("batch.terminated"),
            previous_action: input("batch.prev_action"),
        };
        let imagination = self.b("imagination").then(|| ImaginationDraws {
            model_batch: Batch {
                obs: input("model_batch.obs"),
                action: input("model_batch.action"),
                next_obs: input("model_batch.next_obs"),
                ..batch.clone()
            },
            action: input("noise.imaginary"),
            smoothing: input("noise.smoothing_imaginary"),
            keep: input("noise.keep"),
        });
        Sample {
            batch,
            smoothing: input("noise.smoothing"),
            imagination,
        }
    }
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
    let mut agent = case.agent();
    for step in 0..case.n("steps") {
        let out = |name: &str| case.array(&format!("out.{step}.{name}"));
        let label = |what: &str| format!("{name}, step {step}, {what}");
        let sample = case.sample(step);
        let targets = agent.prepare(&sample, &scaling);
        agree(&label("y"), &targets.y, &out("y"));
        if let Some(imaginary) = &targets.imaginary {
            agree(&label("eta"), &[imaginary.noise_bound as f32], &out("eta"));
            agree(
                &label("model loss"),
                &[targets.model_loss.unwrap()],
                &out("model_loss"),
            );
            agree(&label("a_hat"), &imaginary.action, &out("a_hat"));
            agree(&label("y_hat"), &imaginary.y_hat, &out("y_hat"));
            agree(&label("delta"), &imaginary.disagreement, &out("delta"));
            let kept: Vec<usize> = out("keep_mask")
                .iter()
                .enumerate()
                .filter(|(_, m)| **m == 1.0)
                .map(|(i, _)| i)
                .collect();
            assert_eq!(imaginary.kept.rows, kept, "{}", label("kept rows"));
            assert_eq!(
                imaginary.kept.by_target as f64,
                out("target_mask").iter().sum::<f64>()
            );
            assert_eq!(
                imaginary.kept.by_uncertainty as f64,
                out("uncertainty_mask").iter().sum::<f64>()
            );
        }
        let figures = agent.learn(&sample.batch, &targets);
        agree(
            &label("loss of critic 1"),
            &figures.critic_losses[..1],
            &out("critic1_loss"),
        );
        agree(
            &label("loss of critic 2"),
            &figures.critic_losses[1..],
            &out("critic2_loss"),
        );
        assert_eq!(figures.actor_loss.is_some(), step == 1);
        if let Some(loss) = figures.actor_loss {
            agree(&label("actor loss"), &[loss], &out("actor_loss"));
        }
    }
    let weights = agent.weights();
    let last = case.n("steps") - 1;
    for network in weights.names() {
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
}
