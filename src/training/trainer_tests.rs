//! The loop on simulations and figures that go wrong.

use super::*;
use crate::agent::{Controller, Playing};
use crate::config::{Method, Overrides};
use crate::core::files::Files;
use crate::core::random::Stream;
use crate::replay::Transition;
use crate::run::manifest::Manifest;
use crate::task::{Env, EnvState, Spec, Start, StateMismatch, Step};
use crate::training::assemble::make_env;
use crate::training::{ResumeOptions, Resumed};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::OnceLock;

pub(super) struct Notes(pub Vec<String>);

impl Monitor for Notes {
    fn step(&mut self, _: &Status) {}
    fn note(&mut self, message: &str) {
        self.0.push(message.to_owned());
    }
}

/// Every number of the observation, the reward, and whether the simulation blew up, of step number n.
pub(super) type Script = fn(u32) -> (f64, f64, bool);

/// The number of observations in whose step a buffer was full.
const FULL: f64 = 0.75;

/// A simulation that says what it is told to.
pub(super) struct Scripted {
    spec: Spec,
    script: Script,
    steps: u32,
}

impl Scripted {
    pub fn put_into(trainer: &mut Trainer, script: Script) {
        let spec = trainer.collector.spec().clone();
        trainer.collector.sources[0].main.env = Box::new(Scripted {
            spec,
            script,
            steps: 0,
        });
    }
}

impl Env for Scripted {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self, _: &mut Stream, observation: &mut [f64]) {
        observation.fill(0.0);
    }

    fn step(&mut self, _: &[f64], observation: &mut [f64]) -> Step {
        self.steps += 1;
        let (number, reward, diverged) = (self.script)(self.steps);
        observation.fill(number);
        Step {
            reward,
            terminated: false,
            truncated: diverged,
            diverged,
            buffer_full: number == FULL,
            dropped: false,
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
        EnvState {
            time: 0.0,
            qpos: Vec::new(),
            qvel: Vec::new(),
            act: Vec::new(),
            ctrl: Vec::new(),
            qacc_warmstart: Vec::new(),
            carried: Vec::new(),
            goal: Vec::new(),
            elapsed_steps: 0,
        }
    }

    fn restore(&mut self, _: &EnvState) -> Result<(), StateMismatch> {
        unreachable!("no run goes on with it")
    }
}

pub(super) fn config(steps: u64) -> Config {
    let mut config = Config::preset(Method::Mamf);
    config.task = "InvertedPendulum-v4".into();
    (config.steps, config.random_steps, config.model_start) = (steps, 40, 20);
    config.batch_size = 16;
    config.networks.hidden = vec![16];
    config.model.hidden = vec![16];
    (config.evaluation.every, config.evaluation.episodes) = (50, 1);
    config.checkpoint.every = 50;
    config.telemetry.states = 0;
    config
}

fn trainer(directory: &Path, steps: u64) -> Trainer {
    let directory = || RunDirectory::create(&directory.join("run"), false);
    let config = config(steps);
    let env = make_env(&config).unwrap();
    Trainer::new(config, env, None, directory).unwrap()
}

#[test]
fn a_diverged_step_is_a_logged_truncation_and_is_not_stored() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 100);
    Scripted::put_into(&mut trainer, |step| match step % 2 {
        0 => (f64::NAN, f64::NAN, true),
        _ => (0.5, 1.0, false),
    });
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
    let told = notes
        .0
        .iter()
        .filter(|note| note.contains("the simulation diverged"));
    assert_eq!(told.count(), 50);
    assert!(notes.0[0].contains("step 2: "), "{}", notes.0[0]);
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
fn phase_2_begins_with_the_bias_of_equation_6_on_all_critics_and_their_targets() {
    let directory = tempfile::tempdir().unwrap();
    // It ends where phase 1 does.
    let mut trainer = trainer(directory.path(), 40);
    Scripted::put_into(&mut trainer, |step| (0.5, f64::from(step % 7) - 3.0, false));
    let before = trainer.agent.core.output_biases();
    trainer
        .train(&mut Notes(Vec::new()), &AtomicBool::new(false))
        .unwrap();
    // r* = 3, l = 1000, c = 1/6.
    assert_eq!(trainer.agent.core.output_biases(), [500.0; 4]);
    assert!(before.iter().all(|bias| bias.abs() < 1.0), "{before:?}");
}

/// The first biases of the critics and the notes of a run that ends where phase 1 does, and whose largest reward is
/// `most`.
fn beginning_of_phase_2(
    most: fn(u32) -> (f64, f64, bool),
    settings: &[&str],
) -> (Vec<f32>, String) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run");
    let mut overrides = Overrides::default();
    for setting in settings {
        overrides.set(setting).unwrap();
    }
    let text = config(40).to_toml();
    let config = crate::config::parse(&text, "test.toml".as_ref(), &overrides).unwrap();
    let env = make_env(&config).unwrap();
    let mut trainer =
        Trainer::new(config, env, None, || RunDirectory::create(&path, false)).unwrap();
    Scripted::put_into(&mut trainer, most);
    let mut notes = Notes(Vec::new());
    trainer.train(&mut notes, &AtomicBool::new(false)).unwrap();
    let notes = notes
        .0
        .into_iter()
        .filter(|note| note.starts_with("phase 2"));
    (
        trainer.agent.core.output_biases(),
        notes.collect::<Vec<_>>().join("\n"),
    )
}

#[test]
fn the_bias_of_phase_2_is_told_beside_what_can_be_attained() {
    let rising = |step: u32| (0.5, f64::from(step % 7) - 3.0, false);
    // Equation 6: 3 * 1000 / 6, beside 3 / (1 - 0.98).
    let (biases, note) = beginning_of_phase_2(rising, &[]);
    assert_eq!(biases, [500.0; 4]);
    for part in [
        "bias of 500.0",
        "150.0",
        "3.33 times",
        "more than any policy can reach",
    ] {
        assert!(note.contains(part), "{part}: {note}");
    }
    // A part of what can be attained.
    let (biases, note) = beginning_of_phase_2(
        rising,
        &["imagination.bias=value", "imagination.bias_factor=0.5"],
    );
    assert!(
        biases.iter().all(|bias| (bias - 75.0).abs() < 1e-3),
        "{biases:?}"
    );
    assert!(
        note.contains("0.50 times") && !note.contains("more than"),
        "{note}"
    );
    let negative = |step: u32| (0.5, -3.0 - f64::from(step % 7), false);
    let (biases, note) = beginning_of_phase_2(negative, &[]);
    assert_eq!(biases, [-500.0; 4]);
    assert!(
        note.contains("pessimism") && note.contains("-150.0"),
        "{note}"
    );
    let (_, note) = beginning_of_phase_2(rising, &["imagination.optimism=false"]);
    assert_eq!(note, "");
    let (_, note) = beginning_of_phase_2(rising, &["discount=1"]);
    assert!(note.contains("nothing bounds"), "{note}");
}

#[test]
fn full_buffers_are_counted_and_told_once() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 50);
    Scripted::put_into(&mut trainer, |step| {
        let number = if step % 10 == 0 { FULL } else { 0.5 };
        (number, 1.0, false)
    });
    let mut notes = Notes(Vec::new());
    trainer.train(&mut notes, &AtomicBool::new(false)).unwrap();
    let told: Vec<&String> = notes
        .0
        .iter()
        .filter(|note| note.contains("buffer of MuJoCo"))
        .collect();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].starts_with("step 10: "), "{told:?}");
    assert_eq!(figures(&trainer, "train.csv", "buffers_full"), ["5"]);
}

/// The figures of a column of a curve.
pub(super) fn figures(trainer: &Trainer, file: &str, column: &str) -> Vec<String> {
    let text = std::fs::read_to_string(trainer.directory.path().join(file)).unwrap();
    let mut lines = text.lines();
    let place = lines
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == column);
    let figure = |line: &str| line.split(',').nth(place.unwrap()).unwrap().to_owned();
    lines.map(figure).collect()
}

/// A task as long as InvertedPendulum's observations and actions, whose simulation blows up in its first step after a
/// number of episodes, and which promises much before.
struct Doomed {
    episodes: std::sync::atomic::AtomicUsize,
    sound: usize,
}

impl crate::env::Task for Doomed {
    type Carried = [f64; 0];

    fn start(&self, _: &mut Stream, _: &mut [f64], _: &mut [f64]) {
        self.episodes.fetch_add(1, Ordering::Relaxed);
    }

    fn carry(&self, _: &mujoco_rs::Data) -> [f64; 0] {
        []
    }

    fn observe(&self, _: &mujoco_rs::Data, observation: &mut [f64]) {
        observation.fill(0.0);
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], _: &mujoco_rs::Data, _: &[f64]) -> f64 {
        let episode = self.episodes.load(Ordering::Relaxed);
        if episode > self.sound { f64::NAN } else { -1.0 }
    }

    fn success(&self, _: &mujoco_rs::Data) -> Option<bool> {
        Some(true)
    }
}

/// Evaluations of which the first `sound` episodes of each environment are sound.
fn doomed(sound: usize) -> Evaluator {
    let info = env::Info {
        max_episode_steps: 3,
        ..*env::info("InvertedPendulum-v4").unwrap()
    };
    let env = || -> Box<dyn env::Inspect> {
        let model = env::model("InvertedPendulum-v4").unwrap();
        let task = Doomed {
            episodes: 0.into(),
            sound,
        };
        Box::new(env::Simulation::new(model, &info, task).unwrap())
    };
    Evaluator::within([env(), env()], crate::core::random::stream(0, "eval-env"))
}

#[test]
fn an_evaluation_that_diverges_says_so_and_is_never_the_best() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 100);
    trainer.config.evaluation.episodes = 2;
    // The one before the first step is sound; the others would be better, were their returns of whole episodes.
    trainer.evaluator = doomed(1);
    let mut notes = Notes(Vec::new());
    trainer.train(&mut notes, &AtomicBool::new(false)).unwrap();
    assert_eq!(figures(&trainer, "eval.csv", "diverged"), ["0", "2", "2"]);
    assert_eq!(
        figures(&trainer, "eval.csv", "return_mean"),
        ["-3.0", "0.0", "0.0"]
    );
    // Also in the very first step, it is a failure of a task that knows success.
    assert_eq!(
        figures(&trainer, "eval.csv", "success_rate"),
        ["1.0", "0.0", "0.0"]
    );
    assert_eq!(trainer.best_return, Some(-3.0));
    let best = trainer.directory.checkpoint("best");
    assert_eq!(crate::run::Checkpoint::load(&best).unwrap().step, 0);
    let told = notes
        .0
        .iter()
        .filter(|note| note.contains("diverged in 2 of 2 episodes"));
    assert_eq!(told.count(), 2);
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
        message.contains("step 61: critic_loss is not finite"),
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

#[test]
fn a_moment_past_single_precision_stops_the_run_at_once() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 60);
    trainer
        .train(&mut Notes(Vec::new()), &AtomicBool::new(false))
        .unwrap();
    // Errors of 1e18 make losses of 1e36 and, of features near 1e3, gradients whose squares are past 3e38.
    trainer.scaling = ObservationScaling::identity(4);
    let (obs, action) = ([1e3; 4], [0.0]);
    for _ in 0..5000 {
        trainer.replay.push(Transition {
            obs: &obs,
            action: &action,
            reward: 1e18,
            next_obs: &obs,
            terminated: true,
            previous_action: &action,
        });
    }
    let message = trainer.learn(61).unwrap_err().to_string();
    assert!(
        message.starts_with("step 61: a parameter of the critics"),
        "{message}"
    );
}

#[test]
fn a_number_past_single_precision_stops_the_run_and_is_named() {
    let scripts: [(Script, &str); 2] = [
        (|_| (0.5, 1e39, false), "the reward is not finite"),
        (|_| (1e39, 1.0, false), "the next observation is not finite"),
    ];
    for (script, expected) in scripts {
        let directory = tempfile::tempdir().unwrap();
        let mut trainer = trainer(directory.path(), 100);
        Scripted::put_into(&mut trainer, script);
        let trained = trainer.train(&mut Notes(Vec::new()), &AtomicBool::new(false));
        let message = trained.unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("step 1: {expected}")),
            "{message}"
        );
        assert!(message.contains("checkpoints/best"), "{message}");
        assert!(trainer.replay.is_empty());
    }
}

#[test]
fn an_action_that_is_not_finite_is_not_executed() {
    let directory = tempfile::tempdir().unwrap();
    let mut trainer = trainer(directory.path(), 100);
    trainer.step = 7;
    let playing = Playing {
        actions: vec![vec![f32::NAN]],
    };
    let controllers = &mut [playing.another()];
    let error = trainer
        .collect(controllers, &mut Notes(Vec::new()))
        .unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("step 8: the action is not finite")
    );
}

// ---------------------------------------------------------------------------------------------
// Crashes and damage
// ---------------------------------------------------------------------------------------------

/// A run that saves often and is over soon.
fn quick() -> Config {
    let mut config = config(60);
    (config.random_steps, config.model_start, config.batch_size) = (20, 10, 8);
    config.networks.hidden = vec![3];
    config.model.hidden = vec![3];
    config.evaluation.every = 15;
    config.checkpoint.every = 10;
    // The ring begins anew twice.
    config.replay.capacity = 25;
    config.telemetry.states = 2;
    config
}

fn go(trainer: Trainer) -> Result<Outcome, TrainError> {
    trainer.run(&mut Notes(Vec::new()), &AtomicBool::new(false))
}

/// A run of `quick` from its first step on a disk.
fn begin(path: &Path, files: Files) -> Result<Outcome, TrainError> {
    let directory = || RunDirectory::create_on(files, path, false);
    go(Trainer::new(quick(), make_env(&quick())?, None, directory)?)
}

/// What is left of it; also the notes that it begins with.
fn go_on(path: &Path, files: Files, steps: u64) -> (Result<(), TrainError>, Vec<String>) {
    let mut notes = Notes(Vec::new());
    let options = ResumeOptions {
        overrides: longer(steps as i64),
        force: false,
    };
    let resumed = RunDirectory::open_on(files, path)
        .map_err(TrainError::from)
        .and_then(|directory| Trainer::resume(directory, &options, &mut notes))
        .and_then(|resumed| match resumed {
            Resumed::Finished(_) => Ok(()),
            Resumed::Run(trainer) => go(*trainer).map(|_| ()),
        });
    (resumed, notes.0)
}

/// Every file below `path` by its name, wall-clock figures left out.
fn files_of(path: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![path.to_owned()];
    while let Some(directory) = open.pop() {
        for entry in std::fs::read_dir(&directory).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                found.insert(path, bytes);
            }
        }
    }
    let root = path;
    let names = found.into_iter().map(|(path, bytes)| {
        let name = path.strip_prefix(root).unwrap().to_owned();
        // Clocks and what tells of them: only the name counts.
        let clocked = ["timing.csv", "run.json", "state.cbor", "manifest.json"];
        let clocked = clocked.iter().any(|end| name.ends_with(end));
        (name, if clocked { Vec::new() } else { bytes })
    });
    names.collect()
}

/// Every checkpoint that stands can be gone on from: also the older one, whatever the run was doing.
fn both_are_sound(path: &Path) {
    let config = crate::config::read_resolved(&path.join("config.toml"), &longer(61)).unwrap();
    let spec = make_env(&config).unwrap().spec().clone();
    let directory = RunDirectory::open(path).unwrap();
    for checkpoint in crate::run::checkpoint::standing(&directory.checkpoints()) {
        // What is removed last may have lost some of its files.
        if !checkpoint.ends_with("previous.old") {
            state::is_sound(&checkpoint, &directory, &config, &spec)
                .unwrap_or_else(|error| panic!("{}: {error}", checkpoint.display()));
        }
    }
}

#[test]
fn a_run_survives_a_disk_that_fails_at_any_operation() {
    let directory = tempfile::tempdir().unwrap();
    let whole = directory.path().join("whole");
    begin(&whole, Files::default()).unwrap();
    let expected = files_of(&whole);
    let mut begun_anew = 0;
    let mut operations = 0;
    loop {
        let path = directory.path().join("run");
        let files = Files::failing_after(operations);
        let failed = begin(&path, files.clone());
        if failed.is_ok() {
            break;
        }
        assert!(files.failed(), "{operations}: {failed:?}");
        // The second crash comes while the run goes on from the first.
        if path.join("config.toml").exists() {
            let (second, _) = go_on(&path, Files::failing_after(operations % 37), 60);
            let message = second.map_err(|error| error.to_string());
            assert!(
                message.as_ref().is_ok_and(|()| operations > 100)
                    || message
                        .as_ref()
                        .is_err_and(|m| m.contains("no storage space")),
                "{operations}: {message:?}"
            );
            both_are_sound(&path);
            let (third, notes) = go_on(&path, Files::default(), 60);
            third.unwrap_or_else(|error| panic!("{operations}: {error}"));
            assert!(
                !notes.iter().any(|note| note.contains("damaged")),
                "{notes:?}"
            );
        } else {
            begun_anew += 1;
            begin(&path, Files::default()).unwrap();
        }
        let found = files_of(&path);
        let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&found), names(&expected), "{operations}");
        for (name, bytes) in &expected {
            assert!(found[name] == *bytes, "{operations}: {}", name.display());
        }
        std::fs::remove_dir_all(&path).unwrap();
        operations += 1;
    }
    assert!(
        begun_anew > 3 && operations > 200,
        "{begun_anew}, {operations}"
    );
}

#[test]
fn a_full_disk_is_named_with_the_last_good_checkpoint() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run");
    let (mut named, mut left) = (0, 0);
    for operations in (0..200).step_by(9) {
        let error = begin(&path, Files::failing_after(operations)).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("run") && message.contains("no storage space"),
            "{message}"
        );
        if let Some((_, good)) = message.split_once("the last good checkpoint is ") {
            crate::run::Checkpoint::load(Path::new(good)).unwrap();
            named += 1;
        }
        left += usize::from(message.contains("no checkpoint had been saved yet"));
        // The first operation makes the directory.
        if path.exists() {
            std::fs::remove_dir_all(&path).unwrap();
        }
    }
    assert!(named > 5 && left > 0, "{named}, {left}");
}

#[test]
fn every_flipped_byte_of_a_checkpoint_is_an_error_or_changes_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("run");
    begin(&path, Files::default()).unwrap();
    let last = path.join("checkpoints/last");
    let config = crate::config::read_resolved(&path.join("config.toml"), &longer(70)).unwrap();
    let open = || RunDirectory::open(&path).unwrap();
    let spec = make_env(&config).unwrap().spec().clone();
    let files = files_of(&path);
    // `previous` needs older chunks besides.
    let logged = crate::run::checkpoint::read_manifest(&last)
        .unwrap()
        .replay
        .unwrap();
    let chunk = |c: &crate::run::Chunk| format!("checkpoints/replay/{:012}.f32", c.first).into();
    let needed: Vec<PathBuf> = logged.chunks.iter().map(chunk).collect();
    assert!(needed.len() > 1);
    let belongs = |name: &&PathBuf| {
        name.starts_with("checkpoints/last")
            || name.starts_with("checkpoints/replay") && needed.contains(name)
            || name.extension().is_some_and(|ending| ending == "csv")
    };
    let run = open();
    let mut flips = 0;
    for name in files.keys().filter(belongs) {
        let file = path.join(name);
        let whole = std::fs::read(&file).unwrap();
        for i in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[i] ^= 1 << (i % 8);
            std::fs::write(&file, flipped).unwrap();
            match state::is_sound(&last, &run, &config, &spec) {
                // Nothing but the spaces of the manifest is free.
                Ok(()) => assert!(name.ends_with("manifest.json"), "{} {i}", name.display()),
                Err(error) => {
                    assert!(error.is_damage(), "{error}");
                    let message = error.to_string();
                    let named = message.contains(name.to_str().unwrap());
                    assert!(named, "{} {i}: {message}", name.display());
                }
            }
            // Evaluation does with three of the files.
            if name.starts_with("checkpoints/last") && i % 5 == 0 {
                match crate::run::Checkpoint::load(&last) {
                    Ok(checkpoint) => assert_eq!(checkpoint.step, 60),
                    Err(error) => assert!(error.to_string().contains("checkpoints/last/")),
                }
            }
            flips += 1;
        }
        std::fs::write(&file, whole).unwrap();
    }
    assert!(flips > 5_000, "{flips}");
    drop(run);
    // All is as it was: the run goes on.
    let (resumed, notes) = go_on(&path, Files::default(), 70);
    resumed.unwrap();
    assert!(notes.is_empty(), "{notes:?}");
}

fn longer(steps: i64) -> Overrides {
    let mut overrides = Overrides::default();
    overrides.push(String::new(), "steps", steps);
    overrides
}

/// As if somebody had written `state.cbor` who also knows how to seal it.
fn resealed(path: &Path, state: &[u8]) {
    let last = path.join("checkpoints/last");
    let sealed = crate::run::checkpoint::read_manifest(&last).unwrap();
    std::fs::write(last.join("state.cbor"), state).unwrap();
    let names: Vec<String> = sealed.files.keys().cloned().collect();
    let contents: Vec<Vec<u8>> = names
        .iter()
        .map(|name| std::fs::read(last.join(name)).unwrap())
        .collect();
    let files = names
        .iter()
        .map(String::as_str)
        .zip(contents.iter().map(Vec::as_slice));
    let mut manifest = Manifest::new(sealed.step, files);
    (manifest.replay, manifest.curves) = (sealed.replay, sealed.curves);
    std::fs::write(last.join("manifest.json"), manifest.to_json()).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn a_forged_state_is_taken_or_refused(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 1..=255u8), 1..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        static RUN: OnceLock<tempfile::TempDir> = OnceLock::new();
        let run = RUN.get_or_init(|| {
            let directory = tempfile::tempdir().unwrap();
            begin(&directory.path().join("run"), Files::default()).unwrap();
            directory
        });
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("run");
        let original = run.path().join("run");
        let mut names = vec![PathBuf::new()];
        while let Some(name) = names.pop() {
            let from = original.join(&name);
            if from.is_dir() {
                std::fs::create_dir_all(path.join(&name)).unwrap();
                let entries = std::fs::read_dir(&from).unwrap();
                names.extend(entries.map(|entry| name.join(entry.unwrap().file_name())));
            } else {
                std::fs::copy(&from, path.join(&name)).unwrap();
            }
        }
        std::fs::remove_dir_all(path.join("checkpoints/previous")).unwrap();
        let mut state = std::fs::read(path.join("checkpoints/last/state.cbor")).unwrap();
        for (index, bits) in flips {
            let i = index.index(state.len());
            state[i] ^= bits;
        }
        if let Some(cut) = cut {
            state.truncate(cut.index(state.len()));
        }
        resealed(&path, &state);
        let options = ResumeOptions { overrides: longer(70), force: false };
        let directory = RunDirectory::open(&path).unwrap();
        if let Err(error) = Trainer::resume(directory, &options, &mut Notes(Vec::new())) {
            prop_assert!(error.to_string().contains("checkpoints/last/"), "{error}");
        }
    }
}
