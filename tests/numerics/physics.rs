//! What every task promises: repeatable resets, exact restoring, time limits, divergence as a value.

use mamf::core::random::{Stream, stream};
use mamf::env;
use mamf::task::{Env, Rules, VelocityReading};
use rand::RngExt;

/// A uniformly random action of the task.
fn action(env: &dyn Env, rng: &mut Stream) -> Vec<f64> {
    let limit = env.spec().action_ranges[0].high;
    (0..env.spec().action_size)
        .map(|_| rng.random_range(-limit..limit))
        .collect()
}

fn made(id: &str) -> (Box<dyn Env>, Vec<f64>) {
    let (env, _) = env::make(id).unwrap();
    let observation = vec![0.0; env.spec().obs_size];
    (env, observation)
}

/// The bits of an observation and a step, for exact comparison.
fn bits(observation: &[f64], step: mamf::task::Step) -> (Vec<u64>, u64, bool, bool, bool) {
    (
        observation.iter().map(|x| x.to_bits()).collect(),
        step.reward.to_bits(),
        step.terminated,
        step.truncated,
        step.diverged,
    )
}

#[test]
fn sizes_are_as_published() {
    let published = [
        ("Ant-v4", 27, 8, 1.0, 1000, 0.05),
        ("HalfCheetah-v4", 17, 6, 1.0, 1000, 0.05),
        ("Hopper-v4", 11, 3, 1.0, 1000, 0.008),
        ("Humanoid-v4", 376, 17, 0.4, 1000, 0.015),
        ("HumanoidStandup-v4", 376, 17, 0.4, 1000, 0.015),
        ("InvertedDoublePendulum-v4", 11, 1, 1.0, 1000, 0.05),
        ("InvertedPendulum-v4", 4, 1, 3.0, 1000, 0.04),
        ("Pusher-v4", 23, 7, 2.0, 100, 0.05),
        ("Reacher-v4", 11, 2, 1.0, 50, 0.02),
        ("Swimmer-v4", 8, 2, 1.0, 1000, 0.04),
        ("Walker2d-v4", 17, 6, 1.0, 1000, 0.008),
    ];
    for (id, obs, action, limit, steps, dt) in published {
        let (env, _) = env::make(id).unwrap();
        let spec = env.spec();
        assert_eq!(spec.id, id);
        assert_eq!((spec.obs_size, spec.action_size), (obs, action), "{id}");
        assert_eq!(
            (spec.action_ranges[0].high, spec.max_episode_steps),
            (limit, steps),
            "{id}"
        );
        assert!((spec.dt - dt).abs() < 1e-12, "{id}");
    }
}

#[test]
fn episodes_repeat_to_the_bit() {
    for id in env::ids() {
        let run = || {
            let (mut env, mut observation) = made(id);
            let mut rng = stream(7, "env");
            env.reset(&mut rng, &mut observation);
            let mut log = vec![observation.clone()];
            for _ in 0..20 {
                let a = action(env.as_ref(), &mut rng);
                env.step(&a, &mut observation);
                log.push(observation.clone());
            }
            log
        };
        assert_eq!(run(), run(), "{id}");
    }
}

#[test]
fn a_restored_state_goes_on_to_the_bit_in_a_fresh_instance() {
    for id in env::ids() {
        let (mut env, mut observation) = made(id);
        let mut rng = stream(3, "env");
        env.reset(&mut rng, &mut observation);
        for _ in 0..17 {
            let a = action(env.as_ref(), &mut rng);
            env.step(&a, &mut observation);
        }
        let state = env.snapshot();
        let (mut other, mut elsewhere) = made(id);
        other.restore(&state).unwrap();
        assert_eq!(other.snapshot(), state, "{id}");
        for t in 0..30 {
            let a = action(env.as_ref(), &mut rng);
            let expected = env.step(&a, &mut observation);
            let found = other.step(&a, &mut elsewhere);
            assert_eq!(
                bits(&elsewhere, found),
                bits(&observation, expected),
                "{id} step {t}"
            );
        }
        assert_eq!(other.snapshot(), env.snapshot(), "{id}");
    }
}

#[test]
fn a_state_of_another_task_is_refused() {
    let (hopper, _) = made("Hopper-v4");
    let (mut ant, _) = made("Ant-v4");
    let before = ant.snapshot();
    let error = ant.restore(&hopper.snapshot()).unwrap_err().to_string();
    assert!(
        error.contains("Ant-v4") && error.contains("qpos"),
        "{error}"
    );
    assert_eq!(ant.snapshot(), before);
}

#[test]
fn episodes_are_cut_at_the_limit_and_not_terminated_by_it() {
    for (id, limit) in [("Reacher-v4", 50), ("Pusher-v4", 100), ("Swimmer-v4", 1000)] {
        let (mut env, mut observation) = made(id);
        let mut rng = stream(1, "env");
        // The second episode counts from its own beginning.
        for _ in 0..2 {
            env.reset(&mut rng, &mut observation);
            let zero = vec![0.0; env.spec().action_size];
            for t in 1..=limit {
                let step = env.step(&zero, &mut observation);
                assert_eq!(
                    (step.truncated, step.terminated),
                    (t == limit, false),
                    "{id} {t}"
                );
            }
        }
    }
}

#[test]
fn a_fall_terminates_without_truncating() {
    for id in [
        "Hopper-v4",
        "Walker2d-v4",
        "Humanoid-v4",
        "InvertedPendulum-v4",
    ] {
        let (mut env, mut observation) = made(id);
        let mut rng = stream(2, "env");
        env.reset(&mut rng, &mut observation);
        let push = vec![env.spec().action_ranges[0].high; env.spec().action_size];
        let fallen = (0..999).map(|_| env.step(&push, &mut observation));
        let last = fallen.into_iter().find(|step| step.terminated);
        assert!(
            last.is_some_and(|step| !step.truncated && !step.diverged),
            "{id}"
        );
    }
}

#[test]
fn a_simulation_that_blows_up_is_cut_with_a_finite_observation() {
    for id in env::ids() {
        let (mut env, mut observation) = made(id);
        let mut rng = stream(5, "env");
        env.reset(&mut rng, &mut observation);
        let mut state = env.snapshot();
        state.qvel[0] = 1e12;
        let bad_action = vec![f64::NAN; env.spec().action_size];
        let calm = vec![0.0; env.spec().action_size];
        for broken in [&bad_action, &calm] {
            if std::ptr::eq(broken, &calm) {
                env.restore(&state).unwrap();
            }
            let step = env.step(broken, &mut observation);
            assert!(step.diverged && step.truncated && !step.terminated, "{id}");
            assert!(step.reward.is_finite(), "{id}");
            assert!(observation.iter().all(|x| x.is_finite()), "{id}");
            env.reset(&mut rng, &mut observation);
            assert!(!env.step(&calm, &mut observation).diverged, "{id}");
        }
    }
    assert!(!std::path::Path::new("MUJOCO_LOG.TXT").exists());
}

#[test]
fn resets_stay_within_their_noise() {
    let mut rng = stream(11, "env");
    for _ in 0..50 {
        let (mut reacher, mut observation) = made("Reacher-v4");
        reacher.reset(&mut rng, &mut observation);
        assert!(observation[4].hypot(observation[5]) <= 0.2);

        let (mut pusher, mut observation) = made("Pusher-v4");
        pusher.reset(&mut rng, &mut observation);
        let gap = (observation[17] - observation[20]).hypot(observation[18] - observation[21]);
        assert!(gap > 0.17 && gap <= 0.3f64.hypot(0.2), "{gap}");
        assert_eq!(observation[..7], [0.0; 7]);

        let (mut ant, mut observation) = made("Ant-v4");
        ant.reset(&mut rng, &mut observation);
        let norm: f64 = observation[1..5].iter().map(|q| q * q).sum();
        assert!(
            (norm - 1.0).abs() < 1e-12,
            "the forward pass normalises: {norm}"
        );
    }
}

/// Rules as learning calls them, against the simulator.
#[test]
fn rules_follow_the_simulator() {
    // Mean error that the reward read from observations may have under random actions.
    let expected = |id: &str| match id {
        "Ant-v4" | "HalfCheetah-v4" => 0.3,
        "Hopper-v4" | "Humanoid-v4" | "Swimmer-v4" | "Walker2d-v4" => 0.05,
        "InvertedDoublePendulum-v4" => 0.2,
        _ => 1e-5,
    };
    for id in env::ids() {
        let (mut env, mut observation) = made(id);
        let rules = env::rules(id, VelocityReading::default()).unwrap();
        let mut rng = stream(13, "env");
        env.reset(&mut rng, &mut observation);
        let (mut error, mut steps) = (0.0, 0.0);
        for _ in 0..200 {
            let before: Vec<f32> = observation.iter().map(|&x| x as f32).collect();
            let a = action(env.as_ref(), &mut rng);
            let step = env.step(&a, &mut observation);
            let after: Vec<f32> = observation.iter().map(|&x| x as f32).collect();
            let a: Vec<f32> = a.iter().map(|&x| x as f32).collect();
            error += (f64::from(rules.reward(&before, &a, &after)) - step.reward).abs();
            steps += 1.0;
            assert_eq!(rules.terminated(&after), step.terminated, "{id}");
            let mut completed = after.clone();
            rules.complete(&before, &a, &mut completed);
            for i in 0..completed.len() {
                if rules.known().contains(&i) {
                    let scale = after[i].abs().max(1.0);
                    assert!((completed[i] - after[i]).abs() < 1e-5 * scale, "{id} {i}");
                } else {
                    assert_eq!(completed[i], after[i], "{id} {i}");
                }
            }
            if step.terminated || step.truncated {
                env.reset(&mut rng, &mut observation);
            }
        }
        assert!(error / steps < expected(id), "{id}: {}", error / steps);
    }
}

#[test]
fn batches_are_rows() {
    let rules: &dyn Rules = &*env::rules("Reacher-v4", VelocityReading::Mean).unwrap();
    let obs: Vec<f32> = (0..22).map(|i| i as f32).collect();
    let (action, next) = ([0.5f32, 0.0, 0.0, 0.5], vec![0.0f32; 22]);
    let mut out = [0.0; 2];
    rules.reward_batch(&obs, &action, &next, &mut out);
    assert_eq!(out[1], rules.reward(&obs[11..], &action[2..], &next[11..]));
    let mut next = next;
    rules.complete_batch(&obs, &action, &mut next, 2);
    assert_eq!(next[15..17], obs[15..17]);
    assert_eq!(next[17], 0.0);
}
