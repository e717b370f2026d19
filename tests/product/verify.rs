//! `mamf verify` accepts the recorded rollouts and nothing that differs from them.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use assert_cmd::Command;
use mamf::core::random::stream;
use mamf::env::{self, Inspect};
use mamf::recordings::verify::verify;
use npyz::WriterBuilder;
use rand::RngExt;
use tempfile::TempDir;

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/rollouts");

fn mamf(directory: &Path) -> assert_cmd::assert::Assert {
    Command::cargo_bin("mamf")
        .unwrap()
        .arg("verify")
        .arg(directory)
        .assert()
}

/// A directory with a copy of one rollout, whose archive went through `change`.
fn changed(task: &str, change: impl FnOnce(&mut Vec<u8>, &serde_json::Value)) -> TempDir {
    let directory = tempfile::tempdir().unwrap();
    let source = Path::new(FIXTURES).join(task);
    let settings = fs::read(source.with_extension("json")).unwrap();
    let mut archive = fs::read(source.with_extension("npz")).unwrap();
    change(&mut archive, &serde_json::from_slice(&settings).unwrap());
    fs::write(directory.path().join("copy.json"), settings).unwrap();
    fs::write(directory.path().join("copy.npz"), archive).unwrap();
    directory
}

/// Arrays by name: shape and numbers.
type Arrays = Vec<(&'static str, Vec<u64>, Vec<f64>)>;

fn write_rollout(directory: &Path, name: &str, env: &str, arrays: &Arrays) {
    let file = fs::File::create(directory.join(format!("{name}.npz"))).unwrap();
    let mut archive = zip::ZipWriter::new(file);
    for (array, shape, numbers) in arrays {
        let options = zip::write::SimpleFileOptions::default();
        archive.start_file(format!("{array}.npy"), options).unwrap();
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(&mut archive)
            .begin_nd()
            .unwrap();
        writer.extend(numbers).unwrap();
        writer.finish().unwrap();
    }
    archive.finish().unwrap();
    let mut settings = fs::File::create(directory.join(format!("{name}.json"))).unwrap();
    write!(settings, "{{\"env\": \"{env}\"}}").unwrap();
}

/// Records `steps` steps of a task, resetting whenever it terminates.
fn record(id: &str, steps: u64) -> Arrays {
    let mut env = env::make_inspect(id).unwrap();
    let mut rng = stream(21, "env");
    let (obs_size, nu) = (env.spec().obs_size, env.spec().action_size);
    let state_size = obs_size - env.spec().goal_size;
    let (nq, nv) = (env.qpos().len(), env.qvel().len());
    let mut observation = vec![0.0; obs_size];
    env.reset(&mut rng, &mut observation);
    let [mut action, mut reward, mut terminated] = [vec![], vec![], vec![]];
    let [mut qpos, mut qvel, mut warmstart, mut time, mut obs] = [(); 5].map(|()| vec![]);
    let mut row = |env: &dyn Inspect, observation: &[f64]| {
        let state = env.snapshot();
        qpos.extend(state.qpos);
        qvel.extend(state.qvel);
        warmstart.extend(state.qacc_warmstart);
        time.push(state.time);
        obs.extend_from_slice(&observation[..state_size]);
    };
    row(env.as_ref(), &observation);
    for _ in 0..steps {
        let limit = env.spec().action_ranges[0].high;
        let a: Vec<f64> = (0..nu).map(|_| rng.random_range(-limit..limit)).collect();
        let step = env.step(&a, &mut observation);
        action.extend(a);
        reward.push(step.reward);
        terminated.push(f64::from(u8::from(step.terminated)));
        if step.terminated {
            env.reset(&mut rng, &mut observation);
        }
        row(env.as_ref(), &observation);
    }
    let size = |n: usize| n as u64;
    let goal = observation[state_size..].to_vec();
    vec![
        ("desired_goal", vec![goal.len() as u64], goal),
        ("action", vec![steps, size(nu)], action),
        ("reward", vec![steps], reward),
        ("terminated", vec![steps], terminated),
        ("qpos", vec![steps + 1, size(nq)], qpos),
        ("qvel", vec![steps + 1, size(nv)], qvel),
        ("qacc_warmstart", vec![steps + 1, size(nv)], warmstart),
        ("time", vec![steps + 1], time),
        ("obs", vec![steps + 1, size(state_size)], obs),
    ]
}

#[test]
fn the_recorded_rollouts_are_reproduced() {
    let report = verify(Path::new(FIXTURES), None).unwrap();
    assert_eq!(report.summaries.len(), 25);
    assert!(report.passed(), "{report:?}");
    for summary in &report.summaries {
        assert!(summary.steps >= 12);
        assert_eq!(summary.start.terminated, 0, "{}", summary.env);
        // Rules with the mean of the velocities are closer wherever the reward reads one.
        if let Some(mean) = &summary.mean {
            assert!(
                mean.reward.mean() < summary.start.reward.mean(),
                "{}",
                summary.env
            );
        }
    }
    let output = mamf(Path::new(FIXTURES))
        .success()
        .get_output()
        .stdout
        .clone();
    let table = String::from_utf8(output).unwrap();
    for summary in &report.summaries {
        assert!(table.contains(&summary.env), "{table}");
    }
}

#[test]
fn a_task_can_be_picked() {
    let report = verify(Path::new(FIXTURES), Some("Hopper-v4")).unwrap();
    assert_eq!((report.summaries.len(), report.skipped), (1, 24));
    let mut command = Command::cargo_bin("mamf").unwrap();
    let misspelt = command
        .args(["verify", "--task", "Hoper-v4", FIXTURES])
        .assert();
    let misspelt = misspelt.code(2);
    let message = String::from_utf8_lossy(&misspelt.get_output().stderr).into_owned();
    assert!(message.contains("Hopper-v4"), "{message}");
}

/// Moves one number of `array` of the recording by `by` and expects a failure.
fn perturbed(task: &str, array: &str, row: usize, by: f64) {
    let directory = tempfile::tempdir().unwrap();
    let settings: serde_json::Value =
        serde_json::from_slice(&fs::read(format!("{FIXTURES}/{task}.json")).unwrap()).unwrap();
    let bytes = fs::read(format!("{FIXTURES}/{task}.npz")).unwrap();
    let mut arrays: Arrays = Vec::new();
    for name in [
        "action",
        "qpos",
        "qvel",
        "qacc_warmstart",
        "time",
        "obs",
        "reward",
        "terminated",
    ] {
        let entry = &settings["arrays"][name];
        let shape: Vec<u64> = serde_json::from_value(entry["shape"].clone()).unwrap();
        let size = shape.iter().product::<u64>() as usize;
        let offset = entry["offset"].as_u64().unwrap() as usize;
        let mut numbers: Vec<f64> = bytes[offset..offset + 8 * size]
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
            .collect();
        if name == array {
            numbers[row * size / shape[0] as usize] += by;
        }
        arrays.push((name, shape, numbers));
    }
    write_rollout(
        directory.path(),
        task,
        settings["env"].as_str().unwrap(),
        &arrays,
    );
    let report = verify(directory.path(), None).unwrap();
    assert!(!report.passed(), "{task} {array} was not noticed");
    assert!(report.failures.is_empty(), "{report:?}");
    mamf(directory.path()).code(1);
}

#[test]
fn a_number_that_differs_is_noticed() {
    perturbed("Hopper", "qpos", 20, 1e-6);
    perturbed("Ant", "qvel", 7, -1e-6);
    perturbed("Reacher", "reward", 3, 1e-8);
    perturbed("HalfCheetah", "obs", 40, 1e-8);
    perturbed("Walker2d", "terminated", 0, 1.0);
    perturbed("Humanoid", "qpos", 5, 1e-6);
    perturbed("Swimmer", "action", 5, 0.1);
    perturbed("InvertedPendulum", "obs", 0, f64::NAN);
}

#[test]
fn our_own_rollouts_replay_with_resets_in_between() {
    let directory = tempfile::tempdir().unwrap();
    for id in env::ids() {
        write_rollout(directory.path(), id, id, &record(id, 60));
    }
    let report = verify(directory.path(), None).unwrap();
    assert_eq!(report.summaries.len(), env::ids().count());
    for summary in &report.summaries {
        // Not 0: setting a state normalises its quaternion once more.
        for errors in [
            &summary.differences.obs,
            &summary.differences.reward,
            &summary.differences.qpos,
            &summary.differences.qvel,
        ] {
            assert!(errors.within(1e-12), "{} {errors:?}", summary.env);
        }
        assert_eq!(summary.differences.terminated, 0, "{}", summary.env);
    }
    let ends = record("InvertedPendulum-v4", 60);
    assert!(ends[3].2.contains(&1.0), "the recording holds a reset");
}

#[test]
fn optional_arrays_may_be_missing_and_others_present() {
    let directory = tempfile::tempdir().unwrap();
    let mut arrays = record("Hopper-v4", 10);
    arrays.retain(|(name, ..)| ["action", "qpos", "qvel"].contains(name));
    arrays.push(("torso_xy", vec![11, 2], vec![0.0; 22]));
    write_rollout(directory.path(), "bare", "Hopper-v4", &arrays);
    let report = verify(directory.path(), None).unwrap();
    assert!(report.passed(), "{report:?}");
    assert_eq!(report.summaries[0].steps, 10);
}

#[test]
fn a_missing_directory_and_an_empty_one_are_misuse() {
    let directory = tempfile::tempdir().unwrap();
    mamf(&directory.path().join("nowhere")).code(2);
    mamf(directory.path()).code(2);
}

#[test]
fn a_rollout_of_which_nothing_can_be_compared_does_not_pass() {
    let directory = tempfile::tempdir().unwrap();
    let mut arrays = record("Hopper-v4", 1);
    // One action, and no state after it.
    for (name, shape, numbers) in &mut arrays {
        if shape[0] == 2 && *name != "desired_goal" {
            let row = numbers.len() / 2;
            shape[0] = 1;
            numbers.truncate(row);
        }
    }
    write_rollout(directory.path(), "single", "Hopper-v4", &arrays);
    let failed = mamf(directory.path()).code(1);
    let output = failed.get_output();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        message.contains("single.npz: no step could be compared"),
        "{message}"
    );
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(table.contains("nothing compared"), "{table}");
}

#[test]
fn a_rollout_may_begin_anywhere_in_an_episode() {
    // An object under way tells nothing of the region its goal was drawn in.
    let directory = tempfile::tempdir().unwrap();
    let mut arrays = record("EggCatchUnderarm-v0", 12);
    for (name, shape, numbers) in &mut arrays {
        let lasting = *name == "desired_goal";
        if !lasting {
            let width = numbers.len() / shape[0] as usize;
            numbers.drain(..5 * width);
            shape[0] -= 5;
        }
        if *name == "qpos" {
            assert_eq!(shape[1], 74);
        }
    }
    write_rollout(directory.path(), "later", "EggCatchUnderarm-v0", &arrays);
    assert!(verify(directory.path(), None).unwrap().passed());
}

#[test]
fn a_sparse_variant_may_be_recorded_with_either_reward() {
    let dense = record("EggHandOver-v0", 6);
    let sparse = record("EggHandOverSparse-v0", 6);
    for arrays in [&dense, &sparse] {
        let directory = tempfile::tempdir().unwrap();
        write_rollout(directory.path(), "sparse", "EggHandOverSparse-v0", arrays);
        let report = verify(directory.path(), None).unwrap();
        assert!(report.passed(), "{report:?}");
        assert_eq!(report.summaries[0].env, "EggHandOverSparse-v0");
    }
    // The other way round is wrong.
    let directory = tempfile::tempdir().unwrap();
    write_rollout(directory.path(), "dense", "EggHandOver-v0", &sparse);
    assert!(!verify(directory.path(), None).unwrap().passed());
}

#[test]
fn an_unknown_task_is_named() {
    let directory = tempfile::tempdir().unwrap();
    write_rollout(
        directory.path(),
        "chess",
        "Chess-v0",
        &record("Hopper-v4", 2),
    );
    let failed = mamf(directory.path()).code(1);
    let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(
        message.contains("Chess-v0") && message.contains("chess.npz"),
        "{message}"
    );
}

#[test]
fn an_array_of_the_wrong_shape_is_named() {
    let directory = tempfile::tempdir().unwrap();
    write_rollout(directory.path(), "mixed", "Ant-v4", &record("Hopper-v4", 2));
    let failed = mamf(directory.path()).code(1);
    let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(
        message.contains("mixed.npz") && message.contains("`action`"),
        "{message}"
    );

    let directory = tempfile::tempdir().unwrap();
    let mut arrays = record("Hopper-v4", 2);
    arrays.retain(|(name, ..)| *name != "qvel");
    write_rollout(directory.path(), "short", "Hopper-v4", &arrays);
    let failed = mamf(directory.path()).code(1);
    let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(message.contains("`qvel`: is missing"), "{message}");
}

#[test]
fn damaged_files_are_errors_and_never_panics() {
    let good = fs::read(format!("{FIXTURES}/InvertedPendulum.npz")).unwrap();
    // Cut short, at every stretch of the file.
    for cut in (0..good.len()).step_by(97) {
        let directory = changed("InvertedPendulum", |bytes, _| bytes.truncate(cut));
        let report = verify(directory.path(), None).unwrap();
        assert_eq!(report.failures.len(), 1, "cut at {cut}");
    }
    // One byte wrong: noticed, or in a part of the archive that says nothing.
    for at in (0..good.len()).step_by(61) {
        let directory = changed("InvertedPendulum", |bytes, _| bytes[at] ^= 0xff);
        let _ = verify(directory.path(), None).unwrap();
    }
    // A wrong number breaks the checksum of its array, and the message names it.
    let directory = changed("InvertedPendulum", |bytes, settings| {
        let offset = settings["arrays"]["qvel"]["offset"].as_u64().unwrap();
        bytes[offset as usize + 3] ^= 0x10;
    });
    let failed = mamf(directory.path()).code(1);
    let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(
        message.contains("copy.npz") && message.contains("`qvel`"),
        "{message}"
    );
}

#[test]
fn damaged_settings_are_named() {
    for settings in ["", "{", "{\"arrays\": {}}", "[1, 2]"] {
        let directory = changed("Hopper", |_, _| ());
        fs::write(directory.path().join("copy.json"), settings).unwrap();
        let failed = mamf(directory.path()).code(1);
        let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(message.contains("copy.json"), "{message}");
    }
    let directory = changed("Hopper", |_, _| ());
    fs::remove_file(directory.path().join("copy.npz")).unwrap();
    let failed = mamf(directory.path()).code(1);
    let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(message.contains("copy.npz"), "{message}");
}
