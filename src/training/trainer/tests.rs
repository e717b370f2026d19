//! The loop on simulations and figures that go wrong.

use super::*;
use crate::config::Method;
use crate::env::{Env, EnvState, Spec, Start, StateMismatch, Step};
use crate::files::Files;
use crate::replay::Transition;

struct Notes(Vec<String>);

impl Monitor for Notes {
    fn step(&mut self, _: &Status) {}
    fn note(&mut self, message: &str) {
        self.0.push(message.to_owned());
    }
}

/// A simulation that blows up at every second step.
struct Diverging {
    spec: Spec,
    steps: u32,
}

impl Env for Diverging {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self, _: &mut Stream, observation: &mut [f64]) {
        observation.fill(0.0);
    }

    fn step(&mut self, _: &[f64], observation: &mut [f64]) -> Step {
        self.steps += 1;
        let diverged = self.steps.is_multiple_of(2);
        observation.fill(if diverged { f64::NAN } else { 0.5 });
        Step {
            reward: if diverged { f64::NAN } else { 1.0 },
            terminated: false,
            truncated: diverged,
            diverged,
            success: None,
        }
    }

    fn start_at(&mut self, _: &Start<'_>, _: &mut [f64]) {
        unreachable!("there are no demonstrations")
    }

    fn draw_goal(&self, _: &mut Stream, _: &[f64]) -> Vec<f64> {
        unreachable!("the task has no goal")
    }

    fn snapshot(&self) -> EnvState {
        unreachable!("the loop does not save simulations")
    }

    fn restore(&mut self, _: &EnvState) -> Result<(), StateMismatch> {
        unreachable!("the loop does not save simulations")
    }
}

fn trainer(directory: &std::path::Path, steps: u64) -> Trainer {
    let mut config = Config::preset(Method::Mamf);
    config.task = "InvertedPendulum-v4".into();
    (config.steps, config.random_steps, config.model_start) = (steps, 40, 20);
    config.batch_size = 16;
    config.networks.hidden = vec![16];
    config.model.hidden = vec![16];
    (config.evaluation.every, config.evaluation.episodes) = (50, 1);
    config.checkpoint.every = 50;
    config.telemetry.states = 0;
    let directory = RunDirectory::create(&directory.join("run"), false).unwrap();
    Trainer::new(config, None, directory).unwrap()
}

#[test]
fn a_diverged_step_is_a_logged_truncation_and_is_not_stored() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 100);
    let spec = trainer.experience.spec().clone();
    trainer.experience.main.env = Box::new(Diverging { spec, steps: 0 });
    let mut notes = Notes(Vec::new());
    let outcome = trainer.train(&mut notes, &AtomicBool::new(false)).unwrap();
    assert_eq!(outcome, Outcome::Finished);
    assert_eq!(trainer.replay.len(), 50);
    let stored = trainer.replay.newest(50);
    assert!(
        stored
            .next_obs
            .iter()
            .chain(&stored.reward)
            .all(|x| x.is_finite())
    );
    assert_eq!(notes.0.len(), 50);
    assert!(
        notes.0[0].contains("step 2: the simulation diverged"),
        "{}",
        notes.0[0]
    );
    let text = std::fs::read_to_string(trainer.directory.path().join("train.csv")).unwrap();
    let row: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    let diverged = text
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|c| c == "diverged");
    assert_eq!(row[diverged.unwrap()], "25");
}

#[test]
fn a_loss_that_is_not_finite_stops_the_run_and_spares_the_checkpoint() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 60);
    let mut notes = Notes(Vec::new());
    trainer.train(&mut notes, &AtomicBool::new(false)).unwrap();
    let before = std::fs::read(
        trainer
            .directory
            .checkpoint("last")
            .join("weights.safetensors"),
    );

    let (obs, action) = ([0.0; 4], [0.0]);
    for _ in 0..1000 {
        trainer.replay.push(Transition {
            obs: &obs,
            action: &action,
            reward: f32::NAN,
            next_obs: &obs,
            terminated: false,
            previous_action: &action,
        });
    }
    let error = trainer.learn(61).unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("step 61: loss of critic 1 is not finite"),
        "{message}"
    );
    assert!(message.contains("checkpoints/last"), "{message}");
    let after = std::fs::read(
        trainer
            .directory
            .checkpoint("last")
            .join("weights.safetensors"),
    );
    assert_eq!(before.unwrap(), after.unwrap());
}
