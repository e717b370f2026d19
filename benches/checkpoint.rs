//! What saving and resuming a run of PenSpin costs: the replay buffer with 100 000 and 1 000 000 transitions,
//! of which 50 000 are new (`checkpoint.every`), and everything else.
//!
//!     cargo bench --bench checkpoint -- --quick

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use mamf::config::{Config, Method};
use mamf::core::files::Files;
use mamf::replay::{ReplayBuffer, Transition};
use mamf::run::ReplayLog;
use mamf::training::{fresh_agent, make_env, make_rules};
use std::collections::HashMap;
use std::path::Path;
use std::time::{Duration, Instant};

const OBS: usize = 61;
const ACTION: usize = 20;
const CAPACITY: usize = 1_000_000;
const NEW: u64 = 50_000;

fn push(buffer: &mut ReplayBuffer, transitions: u64) {
    let mut numbers = [0.0f32; OBS];
    for i in 0..transitions {
        numbers[i as usize % OBS] += 0.1;
        buffer.push(Transition {
            obs: &numbers,
            action: &numbers[..ACTION],
            reward: 1.0,
            next_obs: &numbers,
            terminated: false,
            previous_action: &numbers[..ACTION],
        });
    }
}

fn size(directory: &Path) -> u64 {
    let entries = std::fs::read_dir(directory).expect("it is there");
    let lengths = entries.map(|entry| entry.expect("an entry").metadata().expect("a file").len());
    lengths.sum()
}

fn replay(c: &mut Criterion) {
    let files = Files::default();
    let mut group = c.benchmark_group("replay");
    group.sample_size(10);
    for stored in [100_000u64, 1_000_000] {
        let place = tempfile::tempdir_in(".").expect("a directory");
        let directory = place.path().join("replay");
        let mut buffer = ReplayBuffer::new(CAPACITY, OBS, ACTION);
        let mut log = ReplayLog::new(&directory);
        push(&mut buffer, stored);
        let logged = log.append(&files, &buffer).expect("saved");
        println!("replay/{stored}: {} bytes in all", size(&directory));

        group.bench_function(BenchmarkId::new("read", stored), |b| {
            b.iter_custom(|n| {
                let timed = (0..n).map(|_| {
                    let mut buffer = ReplayBuffer::new(CAPACITY, OBS, ACTION);
                    let started = Instant::now();
                    ReplayLog::read(&directory, &logged, &mut buffer).expect("read");
                    started.elapsed()
                });
                timed.sum()
            });
        });
        group.bench_function(BenchmarkId::new("save 50000 new of", stored), |b| {
            b.iter_custom(|n| {
                let mut timed = Duration::ZERO;
                for _ in 0..n {
                    push(&mut buffer, NEW);
                    let started = Instant::now();
                    log.append(&files, &buffer).expect("saved");
                    log.prune(&files, buffer.stored().start).expect("removed");
                    timed += started.elapsed();
                }
                timed
            });
        });
    }
    group.finish();
}

/// Networks and the optimisers' moments; the rest is a few kilobytes.
fn agent(c: &mut Criterion) {
    let mut config = Config::preset(Method::Mamf);
    config.task = "PenSpin-v0".into();
    let env = make_env(&config).expect("a task");
    let rules = make_rules(&config, env.spec()).expect("rules");
    let agent = fresh_agent(&config, env.spec(), rules);
    let place = tempfile::tempdir_in(".").expect("a directory");
    let files = Files::default();
    let save = || {
        // Twice the networks, as the moments of their optimisers would be.
        for name in ["weights", "first", "second"] {
            let weights = agent.weights().to_bytes(HashMap::new()).expect("bytes");
            files
                .write(&place.path().join(name), &weights)
                .expect("saved");
        }
    };
    save();
    println!("agent: at most {} bytes", size(place.path()));
    let mut group = c.benchmark_group("agent");
    group.sample_size(10);
    group.bench_function("save", |b| b.iter(save));
    group.finish();
}

criterion_group!(benches, replay, agent);
criterion_main!(benches);
