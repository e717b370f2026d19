//! What the hand tasks promise beyond what `mamf verify` compares: starts, goals, success, commands, rules.

use mamf::core::random::{Stream, stream};
use mamf::core::span::Span;
use mamf::env::{self, Inspect, PenInertia};
use mamf::task::{Rules, Start, VelocityReading};
use std::sync::Arc;

/// Ids of the two-hand tasks with their dense reward.
fn two_hand_ids() -> Vec<String> {
    let objects = ["Egg", "Block", "Pen"];
    let families = [
        "HandOver",
        "CatchUnderarm",
        "CatchUnderarmHard",
        "CatchOverarm",
    ];
    let one = families
        .iter()
        .flat_map(|family| objects.map(|object| format!("{object}{family}-v0")));
    one.chain(objects.map(|object| format!("Two{object}CatchUnderArm-v0")))
        .collect()
}

fn sparse(id: &str) -> String {
    id.replace("-v0", "Sparse-v0")
}

/// A task, room for its observation, and a stream.
struct Made {
    env: Box<dyn Inspect>,
    rules: Arc<dyn Rules>,
    observation: Vec<f64>,
    rng: Stream,
}

fn made(id: &str) -> Made {
    let env = env::make_inspect(id).unwrap();
    Made {
        rules: env::rules(id, VelocityReading::default()).unwrap(),
        observation: vec![0.0; env.spec().obs_size],
        rng: stream(5, "env"),
        env,
    }
}

impl Made {
    fn reset(&mut self) {
        self.env.reset(&mut self.rng, &mut self.observation);
    }

    /// The goal at the end of the observation.
    fn goal(&self) -> Vec<f64> {
        let spec = self.env.spec();
        self.observation[spec.obs_size - spec.goal_size..].to_vec()
    }

    fn step(&mut self, action: &[f64]) -> mamf::task::Step {
        self.env.step(action, &mut self.observation)
    }

    fn zero(&self) -> Vec<f64> {
        vec![0.0; self.env.spec().action_size]
    }

    /// Begins with the objects where they are now and `goal` as the goal.
    fn with_goal(&mut self, goal: &[f64]) {
        let (qpos, qvel) = (self.env.qpos().to_vec(), self.env.qvel().to_vec());
        let start = Start {
            qpos: &qpos,
            qvel: &qvel,
            previous_action: None,
            goal,
        };
        self.env.start_at(&start, &mut self.observation);
    }
}

#[test]
fn there_are_31_tasks_of_the_published_sizes() {
    let hands: Vec<&str> = env::ids().filter(|id| id.ends_with("-v0")).collect();
    assert_eq!(hands.len(), 31);
    let mut expected = vec![("PenSpin-v0".to_owned(), [61, 0, 20, 250])];
    for id in two_hand_ids() {
        let sizes = match &id {
            id if id.contains("HandOver") => [109 + 7, 7, 40, 75],
            id if id.starts_with("Two") => [146 + 14, 14, 52, 75],
            _ => [133 + 7, 7, 52, 75],
        };
        expected.push((sparse(&id), sizes));
        expected.push((id, sizes));
    }
    for (id, sizes) in &expected {
        assert!(hands.contains(&id.as_str()), "{id}");
        let (env, _) = env::make(id).unwrap();
        let spec = env.spec();
        let found = [
            spec.obs_size,
            spec.goal_size,
            spec.action_size,
            spec.max_episode_steps,
        ];
        assert_eq!(found, *sizes, "{id}");
        assert_eq!(
            spec.action_ranges,
            vec![Span::symmetric(1.0); spec.action_size],
            "{id}"
        );
        assert!((spec.dt - 0.04).abs() < 1e-12, "{id}");
    }
    assert_eq!(expected.len(), 31);
}

#[test]
fn a_hand_id_that_is_misspelt_is_answered_with_the_nearest() {
    for (written, meant) in [
        ("EggCatchUnderArm-v0", "EggCatchUnderarm-v0"),
        ("TwoEggCatchUnderarm-v0", "TwoEggCatchUnderArm-v0"),
        ("penspin", "PenSpin-v0"),
        ("EggHandOverSparse", "EggHandOverSparse-v0"),
    ] {
        assert_eq!(env::info(written).unwrap_err().nearest, Some(meant));
    }
}

#[test]
fn goals_are_drawn_where_the_object_is_not() {
    for id in two_hand_ids() {
        let mut task = made(&id);
        task.reset();
        let first = task.env.qpos().to_vec();
        let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
        let mut seconds = [f64::MAX, f64::MIN];
        for _ in 0..300 {
            let goal = task.env.draw_goal(&mut task.rng, &first);
            assert!(task.env.goal_error(&first, &goal, true) < 1e-12, "{id}");
            for i in 0..3 {
                low[i] = low[i].min(goal[i]);
                high[i] = high[i].max(goal[i]);
            }
            if let Some(y) = goal.get(8) {
                seconds = [seconds[0].min(*y), seconds[1].max(*y)];
            }
        }
        // The second region of the published table, in y.
        let [start, end] = match &id {
            id if id.contains("HandOver") => [0.60, 0.68],
            id if id.contains("Hard") => [1.20, 1.27],
            id if id.contains("Overarm") => [1.25, 1.35],
            id if id.starts_with("Two") => [0.90, 0.97],
            _ => [0.85, 1.02],
        };
        assert!(
            (low[1] - start).abs() < 0.01 && low[1] >= start,
            "{id} {low:?}"
        );
        assert!(
            (high[1] - end).abs() < 0.01 && high[1] <= end,
            "{id} {high:?}"
        );
        if id.starts_with("Two") {
            assert!(seconds[0] >= 0.38 && seconds[1] <= 0.45, "{id} {seconds:?}");
        }
        // An object on the other side gets the other region.
        let mut moved = first.clone();
        let object = if id.contains("HandOver") { 48 } else { 60 };
        moved[object + 1] = (start + end) / 2.0;
        let goal = task.env.draw_goal(&mut task.rng, &moved);
        assert!(goal[1] < start || goal[1] > end, "{id} {goal:?}");
        assert!(task.env.goal_error(&first, &goal, true) > 0.1, "{id}");
        assert!(task.env.goal_error(&first, &goal, false) < 1e-12, "{id}");
    }
}

#[test]
fn episodes_begin_as_published() {
    // Only the noise of the pen's position is random, and a pen that fell is put back.
    let mut spin = made("PenSpin-v0");
    for _ in 0..20 {
        spin.reset();
        let pen = &spin.env.qpos()[24..27];
        assert!(pen[2] > 0.04 && (pen[1] - 0.874).abs() < 0.02, "{pen:?}");
        assert!((spin.env.snapshot().time - 0.4).abs() < 1e-9);
    }
    // Pens are not turned; an overarm throw begins poised, without settling.
    for (id, time, random) in [
        ("PenHandOver-v0", 0.4, false),
        ("EggHandOver-v0", 0.4, true),
        ("TwoBlockCatchUnderArm-v0", 0.4, true),
        ("EggCatchOverarm-v0", 0.0, false),
        ("PenCatchOverarm-v0", 0.0, false),
    ] {
        let mut task = made(id);
        task.reset();
        let (first, goal) = (task.env.qpos().to_vec(), task.goal());
        assert!((task.env.snapshot().time - time).abs() < 1e-9, "{id}");
        task.reset();
        assert_eq!(task.env.qpos() != first, random, "{id}");
        assert_ne!(task.goal(), goal, "{id}");
    }
    let mut overarm = made("PenCatchOverarm-v0");
    overarm.reset();
    assert_eq!(
        overarm.env.qpos()[60..67],
        [1.0, -0.2, 0.40267, 0.5, 0.5, 0.5, 0.5]
    );
    assert!(overarm.env.qvel().iter().all(|v| *v == 0.0));
}

#[test]
fn success_is_close_in_place_and_angle_and_pays_the_sparse_reward() {
    for id in [
        "EggHandOver-v0",
        "TwoBlockCatchUnderArm-v0",
        "PenCatchOverarm-v0",
    ] {
        // The step that follows, from the same state, tells where the objects will be.
        let mut probe = made(id);
        probe.reset();
        let state = probe.env.snapshot();
        probe.step(&probe.zero());
        let arrival = probe.env.achieved_goal();
        let reward_at = |id: &str, goal: &[f64]| {
            let mut task = made(id);
            let state = mamf::task::EnvState {
                goal: goal.to_vec(),
                ..state.clone()
            };
            task.env.restore(&state).unwrap();
            let step = task.step(&task.zero());
            assert_eq!(task.goal(), goal);
            (step.reward, step.success.unwrap(), step.terminated)
        };
        let objects = f64::from(u8::from(id.starts_with("Two"))) + 1.0;
        let (reward, success, terminated) = reward_at(id, &arrival);
        assert!((reward - objects).abs() < 1e-6, "{id} {reward}");
        assert!(success && !terminated, "{id}");
        assert_eq!(reward_at(&sparse(id), &arrival).0, 0.0, "{id}");
        // Of the last object: a centimetre off, then the other quaternion of the same orientation.
        let last = arrival.len() - 7;
        let mut shifted = arrival.clone();
        shifted[last] += 0.0101;
        let mut opposite = arrival.clone();
        opposite[last + 3..].iter_mut().for_each(|x| *x = -*x);
        for goal in [&shifted, &opposite] {
            let (reward, success, _) = reward_at(id, goal);
            assert!(reward < objects - 0.05 && !success, "{id} {reward}");
            assert_eq!(reward_at(&sparse(id), goal).0, -1.0, "{id}");
        }
        let mut near = arrival.clone();
        near[last] += 0.0099;
        assert!(reward_at(id, &near).1, "{id}");
    }
    assert_eq!(made("PenSpin-v0").step(&[0.0; 20]).success, None);
}

#[test]
fn rules_agree_with_the_simulator_and_keep_the_goal() {
    for id in env::ids().filter(|id| id.ends_with("-v0")) {
        let mut task = made(id);
        task.reset();
        let mut previous: Vec<f32> = task.observation.iter().map(|x| *x as f32).collect();
        for t in 0..10 {
            let n = task.env.spec().action_size;
            let action: Vec<f64> = (0..n).map(|i| ((t * 7 + i * 3) as f64).sin()).collect();
            let step = task.step(&action);
            let next: Vec<f32> = task.observation.iter().map(|x| *x as f32).collect();
            let action: Vec<f32> = action.iter().map(|x| *x as f32).collect();
            let reward = task.rules.reward(&previous, &action, &next);
            let error = (f64::from(reward) - step.reward).abs();
            assert!(error < 1e-5, "{id} {reward} {}", step.reward);
            assert!(!task.rules.terminated(&next));
            let spec = task.env.spec();
            let known: Vec<usize> = (spec.obs_size - spec.goal_size..spec.obs_size).collect();
            assert_eq!(task.rules.known(), known, "{id}");
            let mut predicted = vec![7.0; next.len()];
            task.rules.complete(&previous, &action, &mut predicted);
            for (i, x) in predicted.iter().enumerate() {
                let expected = if known.contains(&i) { next[i] } else { 7.0 };
                assert_eq!(*x, expected, "{id} {i}");
            }
            previous = next;
        }
    }
}

#[test]
fn a_prediction_need_not_have_unit_quaternions() {
    let mut task = made("EggCatchUnderarm-v0");
    task.reset();
    let obs: Vec<f32> = task.observation.iter().map(|x| *x as f32).collect();
    let reward = |obs: &[f32]| task.rules.reward(obs, &[0.0; 52], obs);
    let mut scaled = obs.clone();
    scaled[123..127].iter_mut().for_each(|x| *x *= 1.7);
    assert!((reward(&obs) - reward(&scaled)).abs() < 1e-6);
    scaled[123..127].fill(0.0);
    assert!(reward(&scaled).is_finite());
}

#[test]
fn actions_are_clipped_and_reach_the_second_mount_first() {
    let mut task = made("EggCatchUnderarm-v0");
    task.reset();
    let state = task.env.snapshot();
    let mut command = |action: &[f64]| {
        task.env.restore(&state).unwrap();
        task.step(action);
        (task.env.ctrl().to_vec(), task.env.qpos().to_vec())
    };
    let zero = [0.0; 52];
    let (rest, _) = command(&zero);
    // Zero is the middle of each range.
    assert!((rest[0] - (-0.489 + 0.14) / 2.0).abs() < 1e-12);
    assert!((rest[3] - 1.571 / 2.0).abs() < 1e-12);
    assert_eq!(command(&[3.0; 52]), command(&[1.0; 52]));
    assert_eq!(command(&[-9.0; 52]), command(&[-1.0; 52]));
    let (_, still) = command(&zero);
    for (number, joint) in [(40, 30), (46, 0)] {
        let mut action = zero;
        action[number] = 1.0;
        let (_, moved) = command(&action);
        let mounts = (0..6).chain(30..36);
        let farthest = mounts.max_by(|&a, &b| {
            let change = |i: usize| (moved[i] - still[i]).abs();
            change(a).total_cmp(&change(b))
        });
        assert_eq!(farthest, Some(joint), "action {number}");
    }
}

#[test]
fn a_pen_on_the_forearm_is_noticed() {
    let mut task = made("PenSpin-v0");
    task.env = env::make_watched("PenSpin-v0", PenInertia::Published).unwrap();
    task.reset();
    task.step(&[0.0; 20]);
    assert!(!task.env.touched());
    let mut qpos = task.env.qpos().to_vec();
    // Above the middle of the forearm, which lies from the mount towards the fingers.
    qpos[24..27].copy_from_slice(&[1.0, 1.1, 0.24]);
    let qvel = vec![0.0; task.env.qvel().len()];
    let start = Start {
        qpos: &qpos,
        qvel: &qvel,
        previous_action: None,
        goal: &[],
    };
    task.env.start_at(&start, &mut task.observation);
    let touched = (0..25).any(|_| {
        task.step(&[0.0; 20]);
        task.env.touched()
    });
    assert!(touched);
}

#[test]
fn a_start_in_a_given_state_goes_on_from_there() {
    for id in ["PenSpin-v0", "TwoEggCatchUnderArm-v0"] {
        let mut task = made(id);
        task.reset();
        let action: Vec<f64> = task.zero().iter().map(|_| 0.3).collect();
        for _ in 0..5 {
            task.step(&action);
        }
        let (before, goal) = (task.observation.clone(), task.goal());
        task.with_goal(&goal);
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(&before, &task.observation), "{id}");
        // A new episode: its limit counts from here.
        let steps = task.env.spec().max_episode_steps;
        for t in 1..=steps {
            assert_eq!(task.step(&action).truncated, t == steps, "{id} {t}");
        }
    }
}
