//! One control step of each task under random actions; and what our part of a hand task's step costs
//! beside MuJoCo's own time for the same physics steps.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use mamf::core::random::stream;
use mamf::env::{self, Inspect};
use mamf::task::EnvState;
use mujoco_rs::Data;
use mujoco_sys as sys;
use rand::RngExt;

fn env_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("env_step");
    for id in env::ids().filter(|id| !id.contains("Sparse")) {
        let (mut env, _) = match env::make(id) {
            Ok(made) => made,
            Err(error) => {
                eprintln!("{id}: {error}");
                continue;
            }
        };
        let mut rng = stream(0, "bench");
        let limit = env.spec().action_ranges[0].high;
        let mut action = vec![0.0; env.spec().action_size];
        let mut observation = vec![0.0; env.spec().obs_size];
        env.reset(&mut rng, &mut observation);
        group.bench_function(id, |bencher| {
            bencher.iter(|| {
                for a in &mut action {
                    *a = rng.random_range(-limit..limit);
                }
                let step = env.step(&action, &mut observation);
                if step.terminated || step.truncated {
                    env.reset(&mut rng, &mut observation);
                }
            });
        });
    }
    group.finish();
}

/// Control steps of one timed stretch: short of the time limit of any task.
const STEPS: usize = 50;
/// Physics steps of a control step of the hand tasks.
const FRAME_SKIP: usize = 20;

/// The same stretch of a hand task in two ways: as an environment, and as a bare loop over the C library.
struct Stretch {
    env: Box<dyn Inspect>,
    bare: Data,
    start: EnvState,
    actions: Vec<Vec<f64>>,
    commands: Vec<Vec<f64>>,
    observation: Vec<f64>,
}

impl Stretch {
    fn new(id: &str) -> Stretch {
        let mut env = env::make_inspect(id).expect("a task");
        let mut rng = stream(0, "bench");
        let mut observation = vec![0.0; env.spec().obs_size];
        env.reset(&mut rng, &mut observation);
        let start = env.snapshot();
        let size = env.spec().action_size;
        let actions: Vec<Vec<f64>> = (0..STEPS)
            .map(|_| (0..size).map(|_| rng.random_range(-1.0..1.0)).collect())
            .collect();
        let mut commands = Vec::new();
        for action in &actions {
            env.step(action, &mut observation);
            commands.push(env.ctrl().to_vec());
        }
        let model = env::model(id).expect("a model");
        Stretch {
            env,
            bare: Data::new(Arc::clone(&model)).expect("memory"),
            start,
            actions,
            commands,
            observation,
        }
    }

    /// Through the environment: command, physics, divergence, observation, reward, success.
    fn ours(&mut self) -> Duration {
        self.env.restore(&self.start).expect("its own state");
        let started = Instant::now();
        for action in &self.actions {
            black_box(self.env.step(action, &mut self.observation));
        }
        started.elapsed()
    }

    /// The physics alone, from the same state under the same commands.
    fn bare(&mut self) -> Duration {
        let data = &mut self.bare;
        data.reset().expect("a sound simulation");
        data.qpos_mut().copy_from_slice(&self.start.qpos);
        data.qvel_mut().copy_from_slice(&self.start.qvel);
        let warmstart = data.qacc_warmstart_mut();
        warmstart.copy_from_slice(&self.start.qacc_warmstart);
        let model = data.model().as_ptr();
        let started = Instant::now();
        for command in &self.commands {
            data.ctrl_mut().copy_from_slice(command);
            for _ in 0..FRAME_SKIP {
                // SAFETY: model and data belong together and are not used elsewhere meanwhile.
                unsafe { sys::mj_step(model, data.as_mut_ptr()) };
            }
        }
        started.elapsed()
    }
}

/// Prints the ratio of both ways, timed in turn, and benches each.
fn hand_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("hand_step");
    for id in ["PenSpin-v0", "EggCatchUnderarm-v0"] {
        let mut stretch = Stretch::new(id);
        let mut ratios: Vec<f64> = (0..60)
            .map(|_| {
                let (ours, bare) = (stretch.ours(), stretch.bare());
                ours.as_secs_f64() / bare.as_secs_f64()
            })
            .collect();
        assert_eq!(stretch.env.qpos(), stretch.bare.qpos(), "the same motion");
        ratios.sort_by(f64::total_cmp);
        println!(
            "{id}: control step / bare C loop {:.4} (median of 60 pairs; quartiles {:.4}, {:.4})",
            ratios[30], ratios[15], ratios[45]
        );
        let per_step = |n: u64, mut stretch: Box<dyn FnMut() -> Duration + '_>| {
            let total: Duration = (0..n.div_ceil(STEPS as u64)).map(|_| stretch()).sum();
            total.mul_f64(n as f64 / (n.div_ceil(STEPS as u64) * STEPS as u64) as f64)
        };
        group.bench_function(format!("{id}/env"), |bencher| {
            bencher.iter_custom(|n| per_step(n, Box::new(|| stretch.ours())));
        });
        group.bench_function(format!("{id}/bare"), |bencher| {
            bencher.iter_custom(|n| per_step(n, Box::new(|| stretch.bare())));
        });
    }
    group.finish();
}

criterion_group!(benches, env_step, hand_step);
criterion_main!(benches);
