//! One control step of each task under a constant stream of random actions.

use criterion::{Criterion, criterion_group, criterion_main};
use mamf::env;
use mamf::random::stream;
use rand::RngExt;

fn env_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("env_step");
    for id in env::ids() {
        let (mut env, _) = match env::make(id) {
            Ok(made) => made,
            Err(error) => {
                eprintln!("{id}: {error}");
                continue;
            }
        };
        let mut rng = stream(0, "bench");
        let limit = env.spec().action_limit;
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

criterion_group!(benches, env_step);
criterion_main!(benches);
