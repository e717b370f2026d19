//! Actuators that differ: every number of an action has a range of its own, from the model to what is imagined.

use mamf::agent::augment::{Augment, Imagination};
use mamf::agent::{Agent, Controller, Exploring, Moment, RandomActions};
use mamf::config::{Config, Method};
use mamf::core::random::{Stream, stream};
use mamf::core::span::Span;
use mamf::env::{Info, Scene, Simulation, Task, Velocity, block};
use mamf::model::{DynamicsModel, DynamicsShape, World};
use mamf::nn::ObservationScaling;
use mamf::replay::{ReplayBuffer, Transition, Uniform};
use mamf::task::{Env, Rules};
use mamf::training::{agent_settings, fresh_agent};
use mujoco_rs::{Data, Model};
use std::sync::Arc;

const RANGES: [Span; 3] = [
    Span {
        low: -0.4,
        high: 0.4,
    },
    Span {
        low: 0.0,
        high: 10.0,
    },
    Span {
        low: -3.0,
        high: -1.0,
    },
];

/// Three masses on rails, pushed by motors of different strength.
struct Rails;

impl Task for Rails {
    type Carried = [f64; 0];

    fn start(&self, _: &mut Stream, _: &mut [f64], _: &mut [f64]) {}

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        observation[..3].copy_from_slice(data.qpos());
        observation[3..].copy_from_slice(data.qvel());
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], data: &Data, _: &[f64]) -> f64 {
        -data.qpos()[0].abs()
    }
}

impl Rules for Rails {
    fn reward(&self, _: &[f32], _: &[f32], next_obs: &[f32]) -> f32 {
        -next_obs[0].abs()
    }

    fn terminated(&self, _: &[f32]) -> bool {
        false
    }
}

const INFO: Info = Info {
    id: "Rails-v0",
    summary: "three masses on rails",
    scene: Scene::File("rails.xml"),
    frame_skip: 5,
    max_episode_steps: 100,
    observation: &[block(6, "positions and velocities")],
    reward: "-|first position|",
    termination: "never",
    reset: "at rest",
    velocity: Velocity::None,
    drops: false,
    relative: false,
};

fn model(motors: [&str; 3]) -> Arc<Model> {
    let body = |name: &str| {
        format!(
            "<body><joint name=\"{name}\" type=\"slide\" damping=\"1\"/><geom size=\"0.1\" contype=\"0\"/></body>"
        )
    };
    let motor = |(joint, limits): (&str, &str)| format!("<motor joint=\"{joint}\" {limits}/>");
    let names = ["x", "y", "z"];
    let xml = format!(
        "<mujoco><worldbody>{}</worldbody><actuator>{}</actuator></mujoco>",
        names.map(body).concat(),
        names
            .iter()
            .copied()
            .zip(motors)
            .map(motor)
            .collect::<String>()
    );
    Arc::new(Model::from_xml(&xml).unwrap())
}

fn rails() -> Simulation<Rails> {
    let motors =
        RANGES.map(|Span { low, high }| format!("ctrllimited=\"true\" ctrlrange=\"{low} {high}\""));
    let motors = motors.each_ref().map(String::as_str);
    Simulation::new(model(motors), &INFO, Rails).unwrap()
}

/// Least and most of each number of many actions.
fn extent<'a>(actions: impl Iterator<Item = &'a [f32]>) -> [[f64; 2]; 3] {
    let mut extent = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    for action in actions {
        for (extent, a) in extent.iter_mut().zip(action) {
            let a = f64::from(*a);
            *extent = [extent[0].min(a), extent[1].max(a)];
        }
    }
    extent
}

/// Whether actions keep to the ranges, and come near both ends of each.
fn fills(extent: [[f64; 2]; 3]) -> bool {
    extent.iter().zip(RANGES).all(|([least, most], range)| {
        let (within, near) = (1e-6, 0.1 * range.half());
        (range.low - within..range.low + near).contains(least)
            && (range.high - near..=range.high + within).contains(most)
    })
}

#[test]
fn the_ranges_are_those_of_the_actuators() {
    assert_eq!(rails().spec().action_ranges, RANGES);
}

#[test]
fn an_actuator_without_a_range_is_refused_by_its_number() {
    let limited = "ctrllimited=\"true\" ctrlrange=\"-1 1\"";
    let refused = Simulation::new(model([limited, limited, "gear=\"2\""]), &INFO, Rails);
    let message = refused.err().expect("it has no range").to_string();
    assert!(
        message.contains("actuator 2") && message.contains("ctrlrange"),
        "{message}"
    );
}

#[test]
fn random_and_exploring_actions_fill_every_range() {
    let env = rails();
    let mut config = Config::preset(Method::Td3);
    config.action_coupling = 1.0;
    let agent = fresh_agent(&config, env.spec(), Arc::new(Rails));
    let policy = agent.policy(&ObservationScaling::identity(6));
    let moment = Moment {
        obs: &[0.1; 6],
        previous: &[0.0; 3],
        step: 0,
        env: &env,
    };
    let rng = &mut stream(1, "exploration");
    let mut draws = |controller: &mut dyn Controller| -> Vec<Vec<f32>> {
        (0..2000).map(|_| controller.act(&moment, rng)).collect()
    };
    let random = draws(&mut RandomActions::within(&RANGES));
    assert!(fills(extent(random.iter().map(Vec::as_slice))));

    // Noise is as wide as the range that it explores.
    let deviation = 0.05;
    let explored = draws(&mut Exploring { policy, deviation });
    for (j, range) in RANGES.iter().enumerate() {
        let numbers = || explored.iter().map(|action| f64::from(action[j]));
        let mean = numbers().sum::<f64>() / 2000.0;
        let variance = numbers().map(|a| (a - mean).powi(2)).sum::<f64>() / 2000.0;
        let expected = deviation * range.half();
        assert!(
            (variance.sqrt() / expected - 1.0).abs() < 0.1,
            "{j}: {variance}"
        );
        // A fresh network says almost nothing: the policy begins in the middle of each range.
        assert!(
            (mean - range.middle()).abs() < 0.2 * range.half(),
            "{j}: {mean}"
        );
    }
}

#[test]
fn what_is_imagined_fills_every_range_and_every_method_learns_in_them() {
    let env = rails();
    let mut replay = ReplayBuffer::new(500, 6, 3);
    let mut random = RandomActions::within(&RANGES);
    let rng = &mut stream(2, "exploration");
    for i in 0..500 {
        let obs = [0.01 * (i as f32).sin(); 6];
        let moment = Moment {
            obs: &obs,
            previous: &[0.0; 3],
            step: 0,
            env: &env,
        };
        let action = random.act(&moment, rng);
        replay.push(Transition {
            obs: &obs,
            action: &action,
            reward: -obs[0].abs(),
            next_obs: &obs,
            terminated: false,
            previous_action: &[0.0; 3],
        });
    }
    let scaling = ObservationScaling::identity(6);
    for method in [Method::Mamf, Method::MamfSac, Method::MveTd3, Method::Sac] {
        let mut config = Config::preset(method);
        config.networks.hidden = vec![16];
        config.model.hidden = vec![16];
        let mut agent = fresh_agent(&config, env.spec(), Arc::new(Rails));
        for _ in 0..4 {
            let sample = agent.draw(&replay, &Uniform, 64);
            let update = agent.update(&sample, &scaling);
            assert_eq!(update.metrics.not_finite(), None, "{method:?}");
        }
        assert_eq!(agent.not_finite(), None, "{method:?}");
    }

    let mut config = Config::preset(Method::Mamf);
    config.action_coupling = 1.0;
    config.imagination.noise_relative = true;
    config.imagination.noise_deviation = 2.0;
    let device = config.compute.backend.device();
    let shape = DynamicsShape {
        obs_size: 6,
        action_size: 3,
        known: &[],
        learns_reward: false,
    };
    let model = DynamicsModel::new(&config.model, shape, &mut stream(3, "init-model"), &device);
    let world = World::new(model, Arc::new(Rails));
    let mut imagination = Imagination::new(&config.imagination, &RANGES, world, 0);
    let settings = agent_settings(&config, env.spec());
    let core = mamf::agent::ActorCritic::new(settings, 6, 3, &mut stream(3, "init"), &device);
    let mut agent = Agent::new(core, Box::new(mamf::agent::augment::Plain), 0);
    imagination.draw(&replay, &Uniform, 500, 3);
    let sample = agent.draw(&replay, &Uniform, 500);
    mamf::agent::targets(&agent.core, &mut imagination, &sample, &scaling);
    assert!(fills(extent(imagination.last().action.chunks_exact(3))));
}

#[test]
fn doubled_actions_have_the_ranges_twice() {
    let doubled = mamf::env::doubled(Box::new(rails()), 3);
    assert_eq!(doubled.spec().action_ranges, [RANGES, RANGES].concat());
}
