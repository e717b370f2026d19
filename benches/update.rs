//! One update of each method (its model step included) at the sizes of HalfCheetah, batch and
//! noise drawn from replay as in training.

use burn::optim::{AdamConfig, GradientsParams};
use criterion::{Criterion, criterion_group, criterion_main};
use mamf::config::{Config, Method};
use mamf::core::parallel::with_threads;
use mamf::core::random::stream;
use mamf::env;
use mamf::nn::{
    Architecture, Backend, Mlp, RunningMoments, TrainableMlp, TrainableNetwork, matrix,
};
use mamf::replay::{ReplayBuffer, Transition, Uniform};
use mamf::training::fresh_agent;
use rand::RngExt;
use std::hint::black_box;
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// That of the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const TASK: &str = "HalfCheetah-v4";
const STORED: usize = 100_000;

/// A closure that makes one update of `method` on random data of the task's sizes.
fn updates(method: Method) -> impl FnMut() + Send {
    let config = Config::preset(method);
    let (env, rules) = env::make(TASK).unwrap();
    let spec = env.spec().clone();
    let (obs_size, action_size, rows) = (spec.obs_size, spec.action_size, config.batch_size);
    let mut rng = stream(0, "bench");

    let mut agent = fresh_agent(&config, &spec, rules);
    agent.core.set_optimism(50.0);

    let mut replay = ReplayBuffer::new(STORED, obs_size, action_size);
    let mut moments = RunningMoments::new(obs_size);
    for _ in 0..STORED {
        let mut uniform = |n| -> Vec<f32> { (0..n).map(|_| rng.random_range(-1.0..1.0)).collect() };
        let (obs, action, previous) = (
            uniform(obs_size),
            uniform(action_size),
            uniform(action_size),
        );
        let next_obs: Vec<f32> = obs
            .iter()
            .zip(uniform(obs_size))
            .map(|(s, e)| s + 0.1 * e)
            .collect();
        moments.add(&obs.iter().map(|x| f64::from(*x)).collect::<Vec<_>>());
        let reward = obs[8];
        replay.push(Transition {
            obs: &obs,
            action: &action,
            reward,
            next_obs: &next_obs,
            terminated: false,
            previous_action: &previous,
        });
    }
    let scaling = moments.scaling(5.0, 1e-2);
    move || {
        let sample = agent.draw(&replay, &Uniform, rows);
        black_box(agent.update(&sample, &scaling));
    }
}

fn bench(criterion: &mut Criterion) {
    // scripts/peers/compare.py sets the number of threads for both sides.
    let threads = std::env::var("MAMF_BENCH_THREADS").map_or(2, |n| n.parse().unwrap());
    for (group, threads) in [("update", threads), ("update-1-thread", 1)] {
        let mut group = criterion.benchmark_group(group);
        for method in Method::ALL {
            let mut update = updates(method);
            // One pool for all samples, as in training: it gets the number of iterations to make
            // and gives back the time they took.
            let (orders, to_make) = mpsc::channel::<u64>();
            let (done, times) = mpsc::channel();
            let pool = std::thread::spawn(move || {
                let work = || {
                    for iterations in to_make {
                        let start = Instant::now();
                        (0..iterations).for_each(|_| update());
                        done.send(start.elapsed()).unwrap();
                    }
                };
                with_threads(threads, work).unwrap();
            });
            group.bench_function(method.name(), |bencher| {
                bencher.iter_custom(|iterations| {
                    orders.send(iterations).unwrap();
                    times.recv().unwrap()
                });
            });
            drop(orders);
            pool.join().unwrap();
        }
    }
}

/// One Adam step of a critic, its gradient given: ours and burn's.
fn adam(criterion: &mut Criterion) {
    const WIDTHS: [usize; 4] = [29, 256, 256, 1];
    let device = Backend::Flex.device().autodiff();
    let loss = |mlp: &TrainableMlp| {
        let input = matrix(vec![0.1; 16 * WIDTHS[0]], WIDTHS[0], &device);
        mlp.forward(input).sum()
    };
    let mlp = Mlp::new(&Architecture::relu(&WIDTHS), &mut stream(0, "bench"));
    let mut group = criterion.benchmark_group("adam");

    let mut learner = TrainableNetwork::new(mlp.clone(), 3e-4, &device);
    group.bench_function("ours", |bencher| {
        bencher.iter_custom(|iterations| {
            let mut taken = Duration::ZERO;
            for _ in 0..iterations {
                let gradient = learner.differentiate(loss);
                let start = Instant::now();
                learner.step(gradient);
                taken += start.elapsed();
            }
            taken
        });
    });
    let mut module = Some(TrainableMlp::of(&mlp, &device));
    let mut optimizer = AdamConfig::new().with_epsilon(1e-8).init();
    group.bench_function("burn", |bencher| {
        bencher.iter_custom(|iterations| {
            let mut taken = Duration::ZERO;
            for _ in 0..iterations {
                let trained = module.take().unwrap();
                let gradients = GradientsParams::from_grads(loss(&trained).backward(), &trained);
                let start = Instant::now();
                module = Some(optimizer.step(3e-4, trained, gradients));
                taken += start.elapsed();
            }
            taken
        });
    });
}

criterion_group!(benches, bench, adam);
criterion_main!(benches);
