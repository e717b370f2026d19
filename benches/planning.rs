//! What a planner's rollouts cost beside a bare loop over the C library that simulates the same, with one simulator and
//! with two.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use mamf::config::{Config, Method};
use mamf::core::parallel::with_threads;
use mamf::core::random::{fill_normal, stream};
use mamf::core::span::Span;
use mamf::env;
use mamf::nn::Coupling;
use mamf::planning::{MakeEnv, Origin, Rollouts, Shape};
use mamf::task::{Env, EnvState};
use mujoco_rs::Data;
use mujoco_sys as sys;

/// Sequences of one timing.
const SEQUENCES: usize = 8;
const HORIZON: usize = 20;
/// Physics steps of a control step of the hand tasks.
const FRAME_SKIP: usize = 20;
/// Timings in turn.
const ROUNDS: usize = 15;

/// The same rollouts in both ways.
struct Case {
    rollouts: [Rollouts; 2],
    bare: Data,
    start: EnvState,
    obs: Vec<f32>,
    previous: Vec<f32>,
    sequences: Vec<f32>,
    /// The commands of each step.
    commands: Vec<Vec<f64>>,
}

impl Case {
    fn new(id: &'static str) -> Case {
        let mut env = env::make_inspect(id).expect("a task");
        let spec = env.spec().clone();
        let mut observation = vec![0.0; spec.obs_size];
        env.reset(&mut stream(0, "bench"), &mut observation);
        let start = env.snapshot();
        let shape = Shape {
            horizon: HORIZON,
            action_size: spec.action_size,
            episode: spec.max_episode_steps,
        };
        // Without coupling the sequence is what is executed.
        let coupling = Coupling::new(1.0, &vec![Span::symmetric(1.0); spec.action_size]);
        let mut sequences = vec![0.0; SEQUENCES * shape.numbers()];
        fill_normal(&mut stream(1, "bench"), &mut sequences);
        shape.clip(&mut sequences);
        let mut commands = Vec::new();
        for sequence in sequences.chunks_exact(shape.numbers()) {
            env.restore(&start).expect("its own state");
            for u in sequence.chunks_exact(spec.action_size) {
                let action: Vec<f64> = u.iter().map(|x| f64::from(*x)).collect();
                env.step(&action, &mut observation);
                commands.push(env.ctrl().to_vec());
            }
        }
        let settings = Config::preset(Method::Td3).planner;
        let make: MakeEnv = Arc::new(move || -> Box<dyn Env> { env::make(id).expect("a task").0 });
        let model = env::model(id).expect("a model");
        Case {
            rollouts: [1, 2].map(|n| Rollouts::new(&make, n, shape, coupling.clone(), &settings)),
            bare: Data::new(model).expect("memory"),
            obs: vec![0.0; spec.obs_size],
            previous: vec![0.0; spec.action_size],
            start,
            sequences,
            commands,
        }
    }

    /// Seconds of the rollouts in `simulators` (1 or 2).
    fn ours(&mut self, simulators: usize) -> f64 {
        let origin = Origin {
            state: &self.start,
            obs: &self.obs,
            previous: &self.previous,
        };
        let begun = Instant::now();
        black_box(self.rollouts[simulators - 1].score(origin, &self.sequences, None));
        begun.elapsed().as_secs_f64()
    }

    /// Seconds of the physics alone.
    fn bare(&mut self) -> f64 {
        let data = &mut self.bare;
        let model = data.model().as_ptr();
        let begun = Instant::now();
        for sequence in self.commands.chunks(HORIZON) {
            data.reset().expect("a sound simulation");
            data.qpos_mut().copy_from_slice(&self.start.qpos);
            data.qvel_mut().copy_from_slice(&self.start.qvel);
            let warmstart = data.qacc_warmstart_mut();
            warmstart.copy_from_slice(&self.start.qacc_warmstart);
            for command in sequence {
                data.ctrl_mut().copy_from_slice(command);
                for _ in 0..FRAME_SKIP {
                    // SAFETY: model and data belong together and are not used elsewhere meanwhile.
                    unsafe { sys::mj_step(model, data.as_mut_ptr()) };
                }
            }
        }
        begun.elapsed().as_secs_f64()
    }
}

/// Median, and the quartiles.
fn quartiles(mut ratios: Vec<f64>) -> [f64; 3] {
    ratios.sort_by(f64::total_cmp);
    [2, 1, 3].map(|quarter| ratios[quarter * (ratios.len() - 1) / 4])
}

fn planning(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("planning");
    group.sample_size(10);
    group.measurement_time(Duration::from_secs(2));
    for id in ["PenSpin-v0", "EggCatchUnderarm-v0"] {
        let mut case = Case::new(id);
        let (rounds, case) = with_threads(2, move || {
            let rounds: Vec<[f64; 3]> = (0..ROUNDS)
                .map(|_| [case.bare(), case.ours(1), case.ours(2)])
                .collect();
            (rounds, case)
        })
        .expect("two threads");
        let ratio = |of: fn(&[f64; 3]) -> f64| quartiles(rounds.iter().map(of).collect());
        let [one, low, high] = ratio(|[bare, one, _]| bare / one);
        println!(
            "{id}: one simulator {one:.3} times as fast as the bare C loop (quartiles {low:.3}, {high:.3})"
        );
        let [two, low, high] = ratio(|[_, one, two]| one / two);
        println!(
            "{id}: two simulators {two:.3} times as fast as one (quartiles {low:.3}, {high:.3})"
        );
        let steps = (SEQUENCES * HORIZON) as f64;
        let [rate, ..] = ratio(|[_, one, _]| 1.0 / one);
        println!(
            "{id}: {:.0} simulated control steps a second with one",
            steps * rate
        );
        let mut case = case;
        group.bench_function(id, |bencher| bencher.iter(|| case.ours(1)));
    }
    group.finish();
}

criterion_group!(benches, planning);
criterion_main!(benches);
