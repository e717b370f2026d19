//! Recordings on disk: what is written is read back, found and drawn from, and damage is an error
//! that names the file.

use std::fs;
use std::path::{Path, PathBuf};

use mamf::core::random::stream;
use mamf::recordings::find;
use mamf::recordings::format::{Array, Recorder, Recording, State, Step, WriteError, write};
use mamf::recordings::{DemonstrationError, Demonstrations, Sizes};
use serde_json::{Map, Value};
use tempfile::TempDir;

const TASK: &str = "EggHandOver-v0";
const STEPS: usize = 6;
const SIZES: Sizes<'_> = Sizes {
    task: TASK,
    nq: 3,
    nv: 2,
    obs_size: 4,
    goal_size: 7,
    action_size: 2,
    action_ranges: &[mamf::core::span::Span::symmetric(1.0); 2],
};

/// What a test may change in a trajectory: applied to the positions of row t.
type Change = fn(usize, &mut [f64; 3]);

/// A trajectory of `STEPS` steps: qpos of row t is (t, t + 0.25, 0.5), action t is (t / 4, -2).
fn trajectory(task: &str, change: Change) -> Recorder {
    let state = |t: usize, record: &mut dyn FnMut(&State<'_>)| {
        let x = t as f64;
        let mut qpos = [x, x + 0.25, 0.5];
        change(t, &mut qpos);
        record(&State {
            qpos: &qpos,
            qvel: &[-x, 0.1],
            qacc_warmstart: &[x / 3.0, 0.0],
            time: 0.04 * x,
            obs: &[x, 0.5, -x, 0.1],
            achieved_goal: Some(&[x; 7]),
        });
    };
    let mut recorder = None;
    state(0, &mut |first| {
        recorder = Some(
            Recorder::new(task, "a test", first)
                .with_desired_goal(&[0.5; 7])
                .with_setting("pen_inertia", "no pen"),
        );
    });
    let mut recorder = recorder.unwrap();
    for t in 0..STEPS {
        let action = [t as f64 / 4.0, -2.0];
        let step = Step {
            action: &action,
            ctrl: Some(&[0.1, t as f64]),
            reward: 0.5 * t as f64,
            terminated: false,
            success: Some(t == 4),
        };
        state(t + 1, &mut |after| recorder.push(&step, after));
    }
    recorder
}

/// A directory with the trajectory, saved as `demo_1`.
fn saved(task: &str, change: Change) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let stem = directory.path().join("demo_1");
    trajectory(task, change).save(&stem).unwrap();
    (directory, stem.with_extension("npz"))
}

fn load(path: &Path, sizes: &Sizes<'_>) -> Result<Demonstrations, DemonstrationError> {
    Demonstrations::load(path.to_str().unwrap(), sizes)
}

/// The message with which the demonstrations of `path` are refused: one line, the file named once.
fn refusal(path: &Path, sizes: &Sizes<'_>) -> String {
    let message = load(path, sizes).unwrap_err().to_string();
    assert!(!message.contains('\n'), "{message}");
    assert_eq!(message.matches("demo_1").count(), 1, "{message}");
    message
}

#[test]
fn what_is_written_is_read_back() {
    let (_directory, path) = saved(TASK, |_, _| ());
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.env, TASK);
    assert_eq!(recording.source.as_deref(), Some("a test"));
    assert_eq!(recording.pen_inertia.as_deref(), Some("no pen"));
    assert_eq!(recording.steps(), STEPS);
    assert_eq!(recording.qpos.rows(), STEPS + 1);
    for t in 0..=STEPS {
        let x = t as f64;
        assert_eq!(recording.qpos.get(t), Some(&[x, x + 0.25, 0.5][..]));
        assert_eq!(recording.qvel.get(t), Some(&[-x, 0.1][..]));
        let row = |rows: &Option<mamf::recordings::format::Rows>| {
            rows.as_ref().unwrap().get(t).unwrap()[0]
        };
        assert_eq!(row(&recording.qacc_warmstart), x / 3.0);
        assert_eq!(row(&recording.time), 0.04 * x);
        assert_eq!(row(&recording.obs), x);
        assert_eq!(row(&recording.achieved_goal), x);
    }
    for t in 0..STEPS {
        let row = |rows: &Option<mamf::recordings::format::Rows>| {
            rows.as_ref().unwrap().get(t).unwrap()[0]
        };
        assert_eq!(recording.action.get(t).unwrap(), [t as f64 / 4.0, -2.0]);
        assert_eq!(
            recording.ctrl.as_ref().unwrap().get(t).unwrap()[1],
            t as f64
        );
        assert_eq!(row(&recording.reward), 0.5 * t as f64);
        assert_eq!(row(&recording.terminated), 0.0);
        assert_eq!(row(&recording.success), f64::from(u8::from(t == 4)));
    }
    assert_eq!(recording.desired_goal.as_deref(), Some(&[0.5; 7][..]));
    assert!(recording.next_qpos.is_none() && recording.presettle_qpos.is_none());
    recording.check_finite().unwrap();
}

#[test]
fn offsets_lead_to_the_numbers() {
    let (_directory, path) = saved(TASK, |_, _| ());
    let settings = fs::read(path.with_extension("json")).unwrap();
    let settings: Value = serde_json::from_slice(&settings).unwrap();
    assert_eq!(settings["steps"], STEPS);
    assert_eq!(settings["dtype"], "float64 little-endian, C order");
    let bytes = fs::read(&path).unwrap();
    let numbers = |name: &str| -> (Vec<usize>, Vec<f64>) {
        let entry = &settings["arrays"][name];
        assert!(entry["what"].as_str().is_some_and(|what| !what.is_empty()));
        let shape: Vec<usize> = serde_json::from_value(entry["shape"].clone()).unwrap();
        let offset = entry["offset"].as_u64().unwrap() as usize;
        let bytes = &bytes[offset..][..8 * shape.iter().product::<usize>()];
        let numbers = bytes.as_chunks::<8>().0.iter();
        (shape, numbers.map(|b| f64::from_le_bytes(*b)).collect())
    };
    let recording = Recording::open(&path).unwrap();
    for (name, rows) in [
        ("action", &recording.action),
        ("ctrl", recording.ctrl.as_ref().unwrap()),
        ("qpos", &recording.qpos),
        ("qvel", &recording.qvel),
        ("obs", recording.obs.as_ref().unwrap()),
        ("reward", recording.reward.as_ref().unwrap()),
        ("time", recording.time.as_ref().unwrap()),
    ] {
        let (shape, numbers) = numbers(name);
        let expected: Vec<f64> = (0..rows.rows())
            .flat_map(|t| rows.get(t).unwrap().to_vec())
            .collect();
        assert_eq!(numbers, expected, "{name}");
        let single = ["reward", "time"].contains(&name);
        let full = [rows.rows(), rows.columns()];
        assert_eq!(shape, full[..2 - usize::from(single)], "{name}");
    }
    assert_eq!(numbers("desired_goal"), (vec![7], vec![0.5; 7]));
}

#[test]
fn equal_trajectories_make_equal_files_and_none_is_overwritten() {
    let (directory, path) = saved(TASK, |_, _| ());
    let again = directory.path().join("demo.2");
    trajectory(TASK, |_, _| ()).save(&again).unwrap();
    let ending = |ending| format!("{}.{ending}", again.display());
    assert_eq!(fs::read(&path).unwrap(), fs::read(ending("npz")).unwrap());

    let before = fs::read(&path).unwrap();
    let stem = path.with_extension("");
    let other = trajectory(TASK, |_, qpos| qpos[0] = 9.0);
    assert!(matches!(other.save(&stem), Err(WriteError::Exists { path: p }) if p == path));
    assert_eq!(fs::read(&path).unwrap(), before);
    // Settings without an archive are in the way as well, and no archive joins them.
    fs::remove_file(&path).unwrap();
    let message = other.save(&stem).unwrap_err().to_string();
    assert!(
        message.contains("demo_1.json") && !path.exists(),
        "{message}"
    );
    let left = fs::read_dir(directory.path()).unwrap();
    assert_eq!(left.count(), 3, "temporary files are gone");
}

#[test]
fn what_makes_no_recording_is_not_written() {
    let directory = tempfile::tempdir().unwrap();
    let stem = directory.path().join("demo_1");
    let state = State {
        qpos: &[0.0; 3],
        qvel: &[0.0; 2],
        qacc_warmstart: &[0.0; 2],
        time: 0.0,
        obs: &[0.0],
        achieved_goal: None,
    };
    let step = Step {
        action: &[0.0],
        ctrl: None,
        reward: 0.0,
        terminated: false,
        success: None,
    };
    let refused = |recorder: &Recorder| recorder.save(&stem).unwrap_err().to_string();
    assert!(refused(&Recorder::new(TASK, "", &state)).contains("is empty"));

    let mut ragged = Recorder::new(TASK, "", &state);
    ragged.push(
        &step,
        &State {
            qpos: &[0.0; 4],
            ..state
        },
    );
    assert!(refused(&ragged).contains("`qpos`: has rows of different lengths"));

    let mut gaps = Recorder::new(TASK, "", &state);
    gaps.push(&step, &state);
    gaps.push(
        &Step {
            success: Some(true),
            ..step
        },
        &state,
    );
    assert!(refused(&gaps).contains("`success`: has 1 rows where there should be 2"));

    let array = |shape: &[usize]| Array {
        name: "qpos".into(),
        what: String::new(),
        shape: shape.to_vec(),
        numbers: vec![0.0; 6],
    };
    let unfilled = write(&stem, Map::new(), &[array(&[2, 4])]).unwrap_err();
    assert!(unfilled.to_string().contains("do not fill"));
    let twice = write(&stem, Map::new(), &[array(&[6]), array(&[6])]).unwrap_err();
    assert!(twice.to_string().contains("is there twice"));
    let nowhere = trajectory(TASK, |_, _| ()).save(&directory.path().join("no/demo_1"));
    assert!(matches!(nowhere, Err(WriteError::Io { .. })));
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn demonstrations_are_loaded_and_drawn_from() {
    let (directory, path) = saved(TASK, |_, _| ());
    let below = directory.path().join("more");
    fs::create_dir(&below).unwrap();
    trajectory("EggHandOverSparse-v0", |_, qpos| qpos[0] += 100.0)
        .save(&below.join("demo_2"))
        .unwrap();
    let pattern = directory.path().join("**/demo_?.npz");
    for (from, trajectories) in [
        (directory.path(), 2),
        (path.as_path(), 1),
        (below.as_path(), 1),
        (pattern.as_path(), 2),
    ] {
        let demonstrations = load(from, &SIZES).unwrap();
        assert_eq!(demonstrations.trajectories(), trajectories);
        assert_eq!(demonstrations.states(), STEPS * trajectories);
    }
    let sparse = Sizes {
        task: "EggHandOverSparse-v0",
        ..SIZES
    };
    let demonstrations = load(directory.path(), &sparse).unwrap();
    let mut rng = stream(5, "demonstrations");
    let mut firsts = 0;
    for _ in 0..200 {
        let state = demonstrations.draw(&mut rng);
        let t = state.qpos[0] - state.first_qpos[0];
        assert!(t <= (STEPS - 1) as f64, "the state after the last action");
        assert_eq!(state.qvel, [-t, 0.1]);
        match state.previous_action {
            // The recorded action has -2 there, and beyond 1 once t reaches 5.
            Some(action) => assert_eq!(action, [((t - 1.0) / 4.0).min(1.0), -1.0]),
            None => {
                assert_eq!(t, 0.0);
                firsts += 1;
            }
        }
    }
    assert!((10..70).contains(&firsts), "{firsts}");
}

#[test]
fn recordings_of_another_kind_are_refused() {
    let (_directory, path) = saved("PenSpin-v0", |_, _| ());
    assert!(refusal(&path, &SIZES).ends_with("is of PenSpin-v0, not EggHandOver-v0"));

    let (_directory, path) = saved(TASK, |_, _| ());
    for (array, sizes) in [
        (
            "action",
            Sizes {
                action_size: 3,
                ..SIZES
            },
        ),
        ("qpos", Sizes { nq: 4, ..SIZES }),
        ("qvel", Sizes { nv: 1, ..SIZES }),
        (
            "obs",
            Sizes {
                obs_size: 5,
                ..SIZES
            },
        ),
        (
            "achieved_goal",
            Sizes {
                goal_size: 14,
                ..SIZES
            },
        ),
    ] {
        let message = refusal(&path, &sizes);
        assert!(
            message.contains(&format!("`{array}`: rows have")),
            "{message}"
        );
    }

    let (_directory, path) = saved(TASK, |t, qpos| {
        if t == 4 {
            qpos[1] = f64::NAN;
        }
    });
    let message = refusal(&path, &SIZES);
    assert!(message.contains("`qpos`: row 4 holds NaN"), "{message}");
    let (_directory, path) = saved(TASK, |t, qpos| {
        if t == 2 {
            qpos[0] = -3e40;
        }
    });
    let message = refusal(&path, &SIZES);
    assert!(message.contains("`qpos`: row 2 holds -3e40"), "{message}");
}

#[test]
fn nothing_to_load_is_told_apart() {
    let directory = tempfile::tempdir().unwrap();
    let refused = |name: &str| {
        let path = directory.path().join(name);
        load(&path, &SIZES).unwrap_err().to_string()
    };
    assert!(refused("").contains("holds no recording"));
    assert!(refused("*.npz").starts_with("nothing matches"));
    assert!(refused("nowhere").contains("nowhere"));
    fs::write(directory.path().join("notes.txt"), "").unwrap();
    assert!(refused("notes.txt").contains("holds no recording"));
}

#[test]
fn damaged_files_are_errors_or_harmless_and_never_panics() {
    let (directory, path) = saved(TASK, |_, _| ());
    let good = fs::read(&path).unwrap();
    let intact = format!("{:?}", load(&path, &SIZES).unwrap());
    for cut in (0..good.len()).step_by(7) {
        fs::write(&path, &good[..cut]).unwrap();
        assert!(
            refusal(&path, &SIZES).contains("demo_1.npz"),
            "cut at {cut}"
        );
    }
    for at in 0..good.len() {
        let mut bytes = good.clone();
        bytes[at] ^= 0xff;
        fs::write(&path, &bytes).unwrap();
        if let Ok(demonstrations) = load(&path, &SIZES) {
            assert_eq!(format!("{demonstrations:?}"), intact, "byte {at}");
        }
    }
    fs::write(&path, &good).unwrap();
    let json = path.with_extension("json");
    let settings = fs::read(&json).unwrap();
    for cut in (0..settings.len() - 3).step_by(11) {
        fs::write(&json, &settings[..cut]).unwrap();
        assert!(
            refusal(&path, &SIZES).contains("demo_1.json"),
            "cut at {cut}"
        );
    }
    fs::remove_file(&json).unwrap();
    assert!(refusal(&path, &SIZES).contains("demo_1.json: is missing"));
    assert_eq!(find(directory.path()).unwrap(), [path]);
}

/// Writes arrays of doubles without further description.
fn plain(stem: &Path, arrays: &[(&str, &[usize])]) {
    let array = |(name, shape): &(&str, &[usize])| Array {
        name: (*name).to_owned(),
        what: String::new(),
        shape: shape.to_vec(),
        numbers: (0..shape.iter().product()).map(|i| i as f64).collect(),
    };
    let arrays: Vec<Array> = arrays.iter().map(array).collect();
    let mut settings = Map::new();
    settings.insert("env".into(), TASK.into());
    write(stem, settings, &arrays).unwrap();
}

#[test]
fn arrays_that_do_not_belong_together_are_refused() {
    let base: [(&str, &[usize]); 3] = [("action", &[4, 2]), ("qpos", &[4, 3]), ("qvel", &[5, 2])];
    let cases: [(&str, &[usize], &str); 12] = [
        ("ctrl", &[5, 2], "has 5 rows for 4 actions"),
        ("reward", &[5], "has 5 rows for 4 actions"),
        ("reward_sparse", &[4, 2], "rows have 2 numbers"),
        ("success", &[3], "has 3 rows for 4 actions"),
        ("time", &[6], "has 6 rows for 4 actions"),
        ("achieved_goal", &[3, 7], "has 3 rows for 4 actions"),
        ("desired_goal", &[1, 7], "where a single row [n] belongs"),
        ("next_qpos", &[4, 2], "where the rows of `qpos` have 3"),
        ("next_qvel", &[5, 2], "has 5 rows for 4 actions"),
        ("presettle_qpos", &[2], "where the rows of `qpos` have 3"),
        ("presettle_qvel", &[4, 2], "where a single row [n] belongs"),
        ("terminated", &[], "is a single number"),
    ];
    for (name, shape, reason) in cases {
        let directory = tempfile::tempdir().unwrap();
        let stem = directory.path().join("demo_1");
        let mut arrays = base.to_vec();
        arrays.push((name, shape));
        plain(&stem, &arrays);
        let message = refusal(&stem.with_extension("npz"), &SIZES);
        let named = message.contains(&format!("demo_1.npz: array `{name}`"));
        assert!(named && message.contains(reason), "{message}");
    }
}

#[test]
fn every_known_array_is_read_and_a_goal_goes_by_two_names() {
    let directory = tempfile::tempdir().unwrap();
    let stem = directory.path().join("demo_1");
    plain(
        &stem,
        &[
            ("action", &[4, 2]),
            ("qpos", &[5, 3]),
            ("qvel", &[5, 2]),
            ("reward_recorded", &[4]),
            ("goal", &[7]),
            ("presettle_qpos", &[3]),
            ("presettle_qvel", &[2]),
            ("presettle_qacc_warmstart", &[2]),
            ("settle_ctrl", &[2]),
            ("next_qpos", &[4, 3]),
            ("next_qvel", &[4, 2]),
            ("of_no_concern", &[2, 2, 2]),
        ],
    );
    let recording = Recording::open(&stem.with_extension("npz")).unwrap();
    assert_eq!(recording.desired_goal.map(|goal| goal.len()), Some(7));
    assert_eq!(recording.presettle_qpos, Some(vec![0.0, 1.0, 2.0]));
    assert_eq!(recording.presettle_qvel, Some(vec![0.0, 1.0]));
    assert_eq!(recording.presettle_qacc_warmstart, Some(vec![0.0, 1.0]));
    assert_eq!(recording.settle_ctrl, Some(vec![0.0, 1.0]));
    assert_eq!(recording.reward_recorded.unwrap().rows(), 4);
    assert_eq!(
        recording.next_qpos.unwrap().get(3),
        Some(&[9.0, 10.0, 11.0][..])
    );
    assert_eq!(recording.next_qvel.unwrap().columns(), 2);

    // A goal that changes from row to row is another array.
    let moving = directory.path().join("moving");
    let arrays: [(&str, &[usize]); 4] = [
        ("action", &[4, 2]),
        ("qpos", &[5, 3]),
        ("qvel", &[5, 2]),
        ("goal", &[5, 3]),
    ];
    plain(&moving, &arrays);
    let recording = Recording::open(&moving.with_extension("npz")).unwrap();
    assert_eq!(recording.desired_goal, None);
}

#[test]
fn announced_arrays_are_there_and_have_the_announced_shape() {
    let arrays: [(&str, &[usize]); 3] = [("action", &[4, 2]), ("qpos", &[5, 3]), ("qvel", &[5, 2])];
    for (announced, reason) in [
        (
            r#"{"success": {"shape": [4]}}"#,
            "announced by the settings but missing",
        ),
        (r#"{"goal": {}}"#, "announced by the settings but missing"),
        (
            r#"{"qpos": {"shape": [5, 2]}}"#,
            "but the settings say [5, 2]",
        ),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let stem = directory.path().join("demo_1");
        plain(&stem, &arrays);
        let settings = format!(r#"{{"env": "{TASK}", "arrays": {announced}}}"#);
        fs::write(stem.with_extension("json"), settings).unwrap();
        let message = refusal(&stem.with_extension("npz"), &SIZES);
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn several_episodes_in_one_file_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let stem = directory.path().join("demo_1");
    let state = |time| State {
        qpos: &[0.0; 3],
        qvel: &[0.0; 2],
        qacc_warmstart: &[0.0; 2],
        time,
        obs: &[0.0; 4],
        achieved_goal: None,
    };
    let step = Step {
        action: &[0.0; 2],
        ctrl: None,
        reward: 0.0,
        terminated: false,
        success: None,
    };
    let mut recorder = Recorder::new(TASK, "a test", &state(0.0));
    for time in [0.04, 0.08, 0.0, 0.04] {
        recorder.push(&step, &state(time));
    }
    recorder.save(&stem).unwrap();
    let message = refusal(&stem.with_extension("npz"), &SIZES);
    assert!(message.contains("begins anew at row 3"), "{message}");
}

#[test]
fn numbers_of_another_type_are_refused() {
    use npyz::WriterBuilder as _;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("demo_1.npz");
    let mut archive = zip::ZipWriter::new(fs::File::create(&path).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    archive.start_file("action.npy", options).unwrap();
    let mut writer = npyz::WriteOptions::<f32>::new()
        .default_dtype()
        .shape(&[2, 2])
        .writer(&mut archive)
        .begin_nd()
        .unwrap();
    writer.extend([0.0f32; 4]).unwrap();
    writer.finish().unwrap();
    archive.finish().unwrap();
    fs::write(
        path.with_extension("json"),
        format!(r#"{{"env": "{TASK}"}}"#),
    )
    .unwrap();
    let message = refusal(&path, &SIZES);
    assert!(
        message.contains("`action`: holds <f4 where doubles (<f8) belong"),
        "{message}"
    );
}
