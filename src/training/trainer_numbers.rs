//! What the loop does with the method's figures, to the number: which actions are executed, which rewards and which
//! observations count, and when.

use super::tests::{Notes, Script, Scripted, config, figures};
use super::*;
use crate::agent::{Moment, Policy};
use crate::core::random::{Stream, fill_normal, stream};
use crate::nn::Weights;
use crate::replay::Batch;
use crate::training::assemble::make_env;
use rand::RngExt;

/// Half of the range of InvertedPendulum's action.
const HALF: f32 = 3.0;

/// Settings of a run in which nothing is learned, so that its networks stay what they are.
fn idle(steps: u64) -> Config {
    let mut config = config(steps);
    config.updates.every = 1_000_000;
    config
}

/// The run of these settings, to its end, on a simulation that follows `script`.
fn trained(config: Config, script: Script) -> Trainer {
    let directory = tempfile::tempdir().unwrap();
    trained_in(directory.path(), config, script).0
}

/// The same in a directory that stays, and what it told.
fn trained_in(directory: &Path, config: Config, script: Script) -> (Trainer, Vec<String>) {
    let mut trainer = fresh(config, &directory.join("run"));
    let environments = trainer.collector.sources.len();
    Scripted::put_into(&mut trainer, script);
    assert_eq!(environments, 1, "the others would not follow the script");
    let mut notes = Notes(Vec::new());
    trainer.train(&mut notes, &AtomicBool::new(false)).unwrap();
    (trainer, notes.0)
}

fn fresh(config: Config, path: &Path) -> Trainer {
    let env = make_env(&config).unwrap();
    Trainer::new(config, env, None, || RunDirectory::create(path, false)).unwrap()
}

/// Observations that change, and rewards that rise all the time.
fn waves(step: u32) -> (f64, f64, bool) {
    let t = f64::from(step);
    (2.0 + (0.7 * t).sin() * t / 40.0, t, false)
}

/// What [`waves`] shows in the steps up to `last`, and the zeros of `resets` first observations.
fn shown(last: u32, resets: usize) -> Vec<f64> {
    let steps = (1..=last).map(|step| waves(step).0);
    steps.chain(std::iter::repeat_n(0.0, resets)).collect()
}

/// `clip(0.7 u + 0.3 p)` in the range of the task.
fn coupled(output: f32, previous: f32) -> f32 {
    (0.7 * output + 0.3 * previous).clamp(-HALF, HALF)
}

#[track_caller]
fn near(found: f32, expected: f32) {
    assert!((found - expected).abs() < 1e-5, "{found} {expected}");
}

#[test]
fn phase_1_executes_uniform_actions_coupled_with_the_ones_before() {
    let trainer = trained(idle(40), waves);
    let rng = &mut stream(trainer.config.seed, "exploration");
    let stored = trainer.replay.newest(40);
    let mut previous = 0.0;
    for (action, before) in oldest_first(&stored) {
        assert_eq!(before, previous);
        near(action, coupled(rng.random_range(-HALF..=HALF), previous));
        previous = action;
    }
}

#[test]
fn phase_2_executes_the_policy_with_coupled_noise_of_its_deviation() {
    let mut settings = idle(60);
    settings.exploration_noise = 0.25;
    settings.scaling.enabled = false;
    let trainer = trained(settings, waves);
    let rng = &mut stream(trainer.config.seed, "exploration");
    (0..40).for_each(|_| _ = rng.random_range(-HALF..=HALF));
    let policy = trainer.agent.policy(&trainer.scaling);
    let stored = trainer.replay.newest(20);
    let mut previous = 0.0;
    for (i, (action, before)) in oldest_first(&stored).into_iter().enumerate() {
        // Phase 2 begins with an episode of its own.
        assert_eq!(before, previous);
        let seen = if i == 0 { 0.0 } else { waves(40 + i as u32).0 };
        let output = policy.output(&[seen as f32; 4], &[previous])[0];
        near(
            action,
            coupled(output + 0.25 * HALF * normal(rng), previous),
        );
        previous = action;
    }
}

/// Executed and previous actions of a batch of one number each, in the order in which they were taken.
fn oldest_first(batch: &Batch) -> Vec<(f32, f32)> {
    let pairs = batch.action.iter().zip(&batch.previous_action);
    pairs.map(|(a, p)| (*a, *p)).rev().collect()
}

fn normal(rng: &mut Stream) -> f32 {
    let mut draw = [0.0];
    fill_normal(rng, &mut draw);
    draw[0]
}

/// Deviations of the noise that the environments explore with, as fractions of half of the range.
fn deviations(trainer: &Trainer) -> Vec<f32> {
    let policy = trainer.agent.policy(&trainer.scaling);
    let env = trainer.collector.sources[0].main.env.as_ref();
    let (obs, previous) = (&[0.1; 4][..], &[0.2][..]);
    let moment = Moment {
        obs,
        previous,
        step: 0,
        env,
    };
    let explored = trainer.controllers().into_iter().map(|mut controller| {
        let action = controller.act(&moment, &mut stream(3, "noise"))[0];
        (action - Policy::act(&policy, obs, previous)[0]) / 0.7 / HALF
    });
    let z = normal(&mut stream(3, "noise"));
    explored.map(|noise| noise / z).collect()
}

#[test]
fn deviations_are_spread_evenly_over_the_environments() {
    let directory = tempfile::tempdir().unwrap();
    let mut settings = idle(60);
    (settings.environments, settings.exploration_noise) = (4, 0.05);
    let mut trainer = fresh(settings, &directory.path().join("run"));
    trainer.step = 40;
    deviations(&trainer).iter().for_each(|d| near(*d, 0.05));
    trainer.config.exploration.spread = vec![0.02, 0.11];
    for (found, expected) in deviations(&trainer)
        .into_iter()
        .zip([0.02, 0.05, 0.08, 0.11])
    {
        near(found, expected);
    }
    // One alone has the lower end.
    trainer.config.environments = 1;
    assert_eq!(deviations(&trainer).len(), 1);
    near(deviations(&trainer)[0], 0.02);
}

#[test]
fn no_reward_after_phase_1_counts_for_the_optimistic_start() {
    let trainer = trained(idle(60), waves);
    assert_eq!(trainer.largest_reward, 40.0);
    // r* l c = 40 * 1000 / 6 on both critics and both targets.
    let bias = (40.0 * 1000.0 / 6.0) as f32;
    assert_eq!(trainer.agent.core.output_biases(), [bias; 4]);
}

#[test]
fn the_optimistic_start_changes_four_biases_and_nothing_else() {
    let arrays = |steps| trained(idle(steps), waves).agent.weights();
    let (before, after) = (arrays(39), arrays(40));
    let changed: Vec<&str> = before
        .names()
        .filter(|name| bytes(&before, name) != bytes(&after, name))
        .collect();
    let expected = ["critic1", "critic2", "target_critic1", "target_critic2"];
    assert_eq!(changed, expected.map(|critic| format!("{critic}.l2.bias")));
}

/// One array alone, as it is saved.
fn bytes(weights: &Weights, name: &str) -> Vec<u8> {
    let file = weights.to_bytes(Default::default()).unwrap();
    let arrays = safetensors::SafeTensors::deserialize(&file).unwrap();
    arrays.tensor(name).unwrap().data().to_vec()
}

#[test]
fn observations_are_scaled_by_all_before_the_last_multiple_of_the_schedule() {
    // Steps of the run, those that the scaling knows of, and the episodes that had begun by then: the second one with
    // phase 2, after step 40.
    let cases = [
        (29, 0, 0),
        (30, 30, 1),
        (59, 30, 1),
        (60, 60, 2),
        (89, 60, 2),
    ];
    for (steps, known, resets) in cases {
        let mut settings = idle(steps);
        settings.scaling.every = 30;
        let (clip, floor) = (settings.scaling.clip, settings.scaling.deviation_floor);
        let found = trained(settings, waves).scaling;
        if known == 0 {
            assert_eq!(found, ObservationScaling::identity(4));
            continue;
        }
        let expected = by_two_passes(&shown(known, resets), clip, floor);
        let probe: Vec<f32> = [-9.0, 0.3, 1.7, 9.0].repeat(4);
        for (found, expected) in found.scale(&probe).into_iter().zip(expected.scale(&probe)) {
            near(found, expected);
        }
    }
}

/// The scaling of four numbers alike that were seen with these values.
fn by_two_passes(seen: &[f64], clip: f64, floor: f64) -> ObservationScaling {
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    let squares = seen.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
    let deviation = (squares / seen.len() as f64).sqrt().max(floor);
    ObservationScaling::new(vec![mean as f32; 4], vec![deviation as f32; 4], clip as f32)
}

#[test]
fn scaling_that_is_switched_off_stays_off() {
    let mut settings = idle(60);
    (settings.scaling.enabled, settings.scaling.every) = (false, 10);
    let trainer = trained(settings, waves);
    assert_eq!(trainer.scaling, ObservationScaling::identity(4));
}

#[test]
fn phase_2_acts_on_observations_scaled_anew() {
    let mut settings = idle(60);
    (settings.scaling.every, settings.exploration_noise) = (50, 0.0);
    let trainer = trained(settings, waves);
    let unscaled = trainer.agent.policy(&ObservationScaling::identity(4));
    let scaled = trainer.agent.policy(&trainer.scaling);
    let stored = trainer.replay.newest(20);
    for (i, (action, previous)) in oldest_first(&stored).into_iter().enumerate() {
        let seen = if i == 0 { 0.0 } else { waves(40 + i as u32).0 };
        // The last step before the scaling is number 50.
        let acting = if i < 10 { &unscaled } else { &scaled };
        near(action, acting.act(&[seen as f32; 4], &[previous])[0]);
    }
}

#[test]
fn a_round_is_due_where_it_reaches_or_passes_a_multiple() {
    let round = |before, after| Round { before, after };
    let due = |before, after, every| round(before, after).due(every).collect::<Vec<_>>();
    assert_eq!(due(6, 9, 10), [0; 0]);
    assert_eq!(due(6, 10, 10), [10]);
    assert_eq!(due(10, 13, 10), [0; 0]);
    assert_eq!(due(9, 13, 10), [10]);
    assert_eq!(due(9, 13, 2), [10, 12]);
    for (before, after) in [(6, 9), (6, 10), (10, 13), (9, 13)] {
        let expected = !due(before, after, 10).is_empty();
        assert_eq!(round(before, after).is_due(10), expected);
    }
}

#[test]
fn a_method_without_imagination_begins_phase_2_as_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let mut settings = Config::preset(crate::config::Method::Td3);
    settings.task = "InvertedPendulum-v4".into();
    (settings.steps, settings.random_steps, settings.batch_size) = (45, 40, 16);
    settings.updates.every = 1_000_000;
    let before = fresh(settings.clone(), &directory.path().join("fresh"));
    let (after, notes) = trained_in(directory.path(), settings, waves);
    let biases = |trainer: &Trainer| trainer.agent.core.output_biases();
    assert_eq!(biases(&before), biases(&after));
    assert!(
        !notes.iter().any(|note| note.contains("phase 2")),
        "{notes:?}"
    );
}

#[test]
fn returns_and_lengths_of_training_episodes_are_told() {
    let directory = tempfile::tempdir().unwrap();
    // Every tenth step blows up, which ends an episode of the nine steps before it.
    let script: Script = |step| match step % 10 {
        0 => (f64::NAN, f64::NAN, true),
        n => (0.5, f64::from(n), false),
    };
    let mut settings = idle(40);
    settings.evaluation.every = 20;
    let (trainer, _) = trained_in(directory.path(), settings, script);
    let told = |column| figures(&trainer, "train.csv", column);
    assert_eq!(told("episodes"), ["2", "2"]);
    assert_eq!(told("length_mean"), ["9.0", "9.0"]);
    assert_eq!(told("return_mean"), ["45.0", "45.0"]);
}

#[test]
fn the_error_of_the_model_is_that_of_the_newest_transitions() {
    let directory = tempfile::tempdir().unwrap();
    let (trainer, _) = trained_in(directory.path(), idle(50), waves);
    let newest = trainer.replay.newest(trainer.config.batch_size);
    // Root mean square in scaled space, of the model itself.
    let scale = |observations: &[f32]| trainer.scaling.scale(observations);
    let (obs, next) = (scale(&newest.obs), scale(&newest.next_obs));
    let model = &trainer.agent.augment.learned().unwrap().world.model;
    let expected = model.error(&obs, &newest.action, &next).sqrt();
    let told = figures(&trainer, "train.csv", "model_error");
    near(told[0].parse().unwrap(), expected);
    assert!(expected > 0.1, "{expected}");
}
