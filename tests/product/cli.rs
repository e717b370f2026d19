//! `mamf train` and `mamf eval`, end to end.

use crate::common::{Place, config, messages, small_run, stderr};
use mamf::run::schema::{EVAL, TIMING, TRAIN, names};
use safetensors::tensor::{Dtype, SafeTensors};
use std::collections::BTreeMap;
use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

// ---------------------------------------------------------------------------------------------
// Sameness
// ---------------------------------------------------------------------------------------------

/// Both curves of a run.
fn curves(place: &Place, run: &str) -> [String; 2] {
    ["train.csv", "eval.csv"].map(|file| place.read(&format!("{run}/{file}")))
}

/// The curves of a small run with `threads` threads and `seed`.
fn curves_of(name: &str, threads: u32, seed: u32, settings: &[&str]) -> [String; 2] {
    let place = Place::new();
    let mut arguments = small_run(name, "run", settings);
    arguments.extend(["--threads".into(), threads.to_string()]);
    arguments.extend(["--seed".into(), seed.to_string()]);
    place.succeed(&arguments);
    curves(&place, "run")
}

#[test]
fn a_seed_gives_the_same_bytes_with_any_number_of_threads() {
    for name in ["hopper", "reacher", "inverted_pendulum"] {
        for method in ["method=mamf", "method=td3"] {
            let once = curves_of(name, 1, 0, &[method]);
            assert_eq!(once, curves_of(name, 1, 0, &[method]), "{name} {method}");
            assert_eq!(once, curves_of(name, 2, 0, &[method]), "{name} {method}");
            assert_eq!(once, curves_of(name, 3, 0, &[method]), "{name} {method}");
        }
    }
}

#[test]
fn several_environments_too_give_the_same_bytes_with_any_number_of_threads() {
    for settings in [
        &["environments=4", "exploration.spread=[0.05, 0.4]"][..],
        &["environments=5", "updates.every=3", "method=td3"],
        &["environments=8", "updates.every=20", "method=mamf-sac"],
    ] {
        let once = curves_of("hopper", 1, 0, settings);
        assert_eq!(once, curves_of("hopper", 2, 0, settings), "{settings:?}");
        assert_eq!(once, curves_of("hopper", 3, 0, settings), "{settings:?}");
    }
}

#[test]
fn learning_that_follows_every_few_steps_makes_that_many_updates() {
    let updates = |settings: &[&str]| -> u64 {
        let [train, _] = curves_of("hopper", 2, 0, settings);
        let column = names(&TRAIN).iter().position(|name| *name == "updates");
        let fields = train
            .lines()
            .skip(1)
            .map(|row| row.split(',').nth(column.unwrap()).unwrap());
        fields.map(|field| field.parse::<u64>().unwrap()).sum()
    };
    // 200 steps of phase 2.
    assert_eq!(updates(&[]), 200);
    assert_eq!(updates(&["updates.every=7"]), 400 / 7 - 200 / 7);
    assert_eq!(updates(&["updates.every=8", "environments=4"]), 25);
    assert_eq!(updates(&["updates.every=2", "environments=8"]), 100);
    assert_eq!(updates(&["updates.every=4", "critic_updates=3"]), 150);
}

#[test]
fn networks_of_the_published_size_too_give_the_same_bytes() {
    let settings = [
        "random_steps=300",
        "batch_size=256",
        "networks.hidden=[256, 256]",
        "model.hidden=[256, 256, 256]",
    ];
    for method in ["method=mamf", "method=td3"] {
        let settings = [&settings[..], &[method]].concat();
        let once = curves_of("half_cheetah", 1, 0, &settings);
        assert_eq!(once, curves_of("half_cheetah", 2, 0, &settings), "{method}");
    }
}

#[test]
fn another_seed_or_method_gives_other_curves() {
    let mamf = curves_of("hopper", 2, 0, &["method=mamf"]);
    let other_seed = curves_of("hopper", 2, 1, &["method=mamf"]);
    let td3 = curves_of("hopper", 2, 0, &["method=td3"]);
    for file in 0..2 {
        assert_ne!(mamf[file], other_seed[file]);
        assert_ne!(mamf[file], td3[file]);
    }
}

#[test]
fn each_component_can_be_switched() {
    let full = curves_of("hopper", 2, 0, &[]);
    for switch in [
        "optimism",
        "noise_decay",
        "target_filter",
        "uncertainty_filter",
    ] {
        let setting = format!("imagination.{switch}=false");
        assert_ne!(full, curves_of("hopper", 2, 0, &[&setting]), "{switch}");
    }
}

// ---------------------------------------------------------------------------------------------
// The run directory
// ---------------------------------------------------------------------------------------------

#[test]
fn a_run_directory_holds_what_it_should() {
    let place = Place::new();
    let printed = place.succeed(&small_run("hopper", "run", &[]));
    assert_eq!(printed, "finished: run\n");

    let files: Vec<String> = place
        .contents("run")
        .into_keys()
        .filter(|path| path.is_file())
        .map(|path| path.strip_prefix(place.path("run")).unwrap().to_owned())
        .map(|path| path.to_str().unwrap().to_owned())
        .collect();
    let evaluated = [
        "checkpoint.json",
        "config.toml",
        "manifest.json",
        "weights.safetensors",
    ];
    let resumed = ["optimizers.safetensors", "state.cbor"];
    let mut expected: Vec<String> = ["best", "last", "previous"]
        .iter()
        .flat_map(|name| evaluated.map(|file| format!("checkpoints/{name}/{file}")))
        .collect();
    for name in ["last", "previous"] {
        expected.extend(resumed.map(|file| format!("checkpoints/{name}/{file}")));
    }
    expected.push("checkpoints/replay/000000000000.f32".to_owned());
    expected.sort();
    expected.extend(
        [
            "config.toml",
            "eval.csv",
            "run.json",
            "timing.csv",
            "train.csv",
        ]
        .map(str::to_owned),
    );
    assert_eq!(files, expected);

    for (file, header, first_step) in [
        ("eval.csv", names(&EVAL).join(","), 0),
        ("train.csv", names(&TRAIN).join(","), 100),
        ("timing.csv", names(&TIMING).join(","), 100),
    ] {
        let text = place.read(&format!("run/{file}"));
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some(header.as_str()), "{file}");
        let steps: Vec<u64> = lines
            .map(|line| line.split(',').next().unwrap().parse().unwrap())
            .collect();
        let expected: Vec<u64> = (first_step..=400).step_by(100).collect();
        assert_eq!(steps, expected, "{file}");
    }

    let run: serde_json::Value = serde_json::from_str(&place.read("run/run.json")).unwrap();
    assert_eq!(run["mamf"], env!("CARGO_PKG_VERSION"));
    assert_eq!(run["command"][1], "train");
    for key in ["mujoco", "rustc", "started"] {
        assert!(run[key].is_string(), "{key}: {run}");
    }

    let state = place.read("run/checkpoints/last/checkpoint.json");
    let state: serde_json::Value = serde_json::from_str(&state).unwrap();
    assert_eq!(state["step"], 400);
    assert_eq!(state["task"], "Hopper-v4");
    assert_eq!(state["method"], "mamf");
    assert_eq!(
        place.read("run/checkpoints/best/config.toml"),
        place.read("run/config.toml")
    );
}

#[test]
fn the_resolved_configuration_makes_the_same_run_again() {
    let place = Place::new();
    place.train("reacher", "run", &["seed=5", "action_coupling=0.5"]);
    place.succeed(&["train", "--config", "run/config.toml", "--out", "again"]);
    for file in ["config.toml", "train.csv", "eval.csv"] {
        let read = |run| place.read(&format!("{run}/{file}"));
        assert_eq!(read("run"), read("again"), "{file}");
    }
}

#[test]
fn a_run_goes_to_a_directory_named_after_task_method_and_seed() {
    let place = Place::new();
    let mut arguments = small_run("hopper", "", &["steps=5"]);
    arguments.retain(|argument| argument != "--out" && !argument.is_empty());
    arguments.extend(["--seed".into(), "7".into()]);
    let output = place.run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(place.path("runs/Hopper-v4/mamf/seed-7/eval.csv").is_file());
    // A run that ends before phase 2 is no mistake, but worth a word.
    assert!(
        messages(&output).starts_with("note: 5 steps end inside phase 1"),
        "{output:?}"
    );
}

/// Name and shape of every array in a checkpoint; all are finite 32-bit floats.
fn arrays(place: &Place, checkpoint: &str) -> BTreeMap<String, Vec<usize>> {
    let path = place.path(&format!("{checkpoint}/weights.safetensors"));
    let bytes = fs::read(path).unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let metadata = header.metadata().clone().unwrap();
    assert_eq!(metadata["task"], "Hopper-v4");
    let arrays = SafeTensors::deserialize(&bytes).unwrap();
    arrays
        .tensors()
        .into_iter()
        .map(|(name, view)| {
            assert_eq!(view.dtype(), Dtype::F32, "{name}");
            let finite = view
                .data()
                .chunks_exact(4)
                .all(|b| f32::from_le_bytes(b.try_into().unwrap()).is_finite());
            assert!(finite, "{name}");
            (name, view.shape().to_vec())
        })
        .collect()
}

/// The arrays of a perceptron with layers of these `widths`, input first.
fn perceptron(name: &str, widths: &[usize]) -> BTreeMap<String, Vec<usize>> {
    let layers = widths.windows(2).zip(1..);
    layers
        .flat_map(|(pair, l)| {
            [
                (format!("{name}.l{l}.weight"), pair.to_vec()),
                (format!("{name}.l{l}.bias"), vec![pair[1]]),
            ]
        })
        .collect()
}

#[test]
fn weights_have_plain_names_and_documented_shapes() {
    const OBS: usize = 11;
    const ACTION: usize = 3;
    let place = Place::new();
    for (run, settings, previous_action, model) in [
        ("mamf", ["method=mamf", "action_coupling=0.7"], ACTION, true),
        ("td3", ["method=td3", "action_coupling=1"], 0, false),
    ] {
        place.train("hopper", run, &settings);
        let mut expected = BTreeMap::from([
            ("scaling.mean".to_owned(), vec![OBS]),
            ("scaling.deviation".to_owned(), vec![OBS]),
            ("scaling.clip".to_owned(), vec![1]),
        ]);
        let observed = OBS + previous_action;
        for name in ["actor", "target_actor"] {
            expected.extend(perceptron(name, &[observed, 32, 32, ACTION]));
        }
        for name in ["critic1", "critic2", "target_critic1", "target_critic2"] {
            expected.extend(perceptron(name, &[observed + ACTION, 32, 32, 1]));
        }
        if model {
            expected.extend(perceptron("model", &[OBS + ACTION, 32, 32, 32, OBS]));
        }
        assert_eq!(arrays(&place, &format!("{run}/checkpoints/last")), expected);
    }
}

#[test]
fn force_replaces_a_run_and_nothing_else() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    let first = curves(&place, "run");
    let mut again = small_run("reacher", "run", &["seed=1"]);
    again.push("--force".into());
    place.succeed(&again);
    assert_ne!(first, curves(&place, "run"));

    fs::create_dir(place.path("mine")).unwrap();
    place.write("mine/letter.txt", "dear all");
    let mut other = small_run("reacher", "mine", &[]);
    other.push("--force".into());
    place.refuse(2, &other, &["mine", "no run directory"]);
}

// ---------------------------------------------------------------------------------------------
// Evaluation
// ---------------------------------------------------------------------------------------------

#[test]
fn a_run_begins_with_the_networks_of_another() {
    let place = Place::new();
    let settings = ["method=td3", "scaling.enabled=false"];
    place.train("hopper", "first", &settings);
    // Phase 1 alone: nothing is learned.
    let idle = |out: &str, more: &[&str]| {
        let phase_1 = ["steps=120", "random_steps=120"];
        let output = place.run(&small_run(
            "hopper",
            out,
            &[&settings, &phase_1, more].concat(),
        ));
        assert!(output.status.success(), "{output:?}");
    };
    idle("second", &["networks.from=first"]);
    idle("fresh", &[]);
    let eval = |run: &str| {
        let said = place.succeed(&["eval", "--checkpoint", run, "--episodes", "2"]);
        said.lines().skip(1).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(eval("first"), eval("second"));
    assert_ne!(eval("first"), eval("fresh"));

    let refuse = |change: &str, parts: &[&str]| {
        let from = ["networks.from=first", change];
        let arguments = small_run("hopper", "refused", &[&settings[..], &from].concat());
        place.refuse(2, &arguments, &[&["networks.from"], parts].concat());
        assert!(!place.path("refused").exists());
    };
    refuse("networks.from=nowhere", &["nowhere"]);
    refuse("task=Walker2d-v4", &["task", "Hopper-v4", "Walker2d-v4"]);
    // What would not fit, and what would fit and mean something else.
    for change in [
        "networks.hidden=[8]",
        "networks.critic_normalisation=layer",
        "action_coupling=0.5",
        "method=ddpg",
        "scaling.enabled=true",
    ] {
        let key = change.split('=').next().unwrap();
        refuse(change, &["\"first\"", key]);
    }
    let mut onto_itself = small_run(
        "hopper",
        "first",
        &[&settings[..], &["networks.from=first"]].concat(),
    );
    onto_itself.push("--force".into());
    place.refuse(2, &onto_itself, &["networks.from", "first", "--out"]);
}

#[test]
fn eval_takes_a_run_or_a_checkpoint_and_repeats_itself() {
    let place = Place::new();
    place.train("hopper", "run", &[]);
    let eval = |checkpoint: &str, more: &[&str]| {
        place.succeed(&[&["eval", "--checkpoint", checkpoint], more].concat())
    };

    let run = eval("run", &[]);
    assert!(
        run.starts_with("Hopper-v4, mamf after 400 steps\nepisodes  10\n"),
        "{run}"
    );
    assert_eq!(run, eval("run", &[]));
    assert_eq!(run, eval("run/checkpoints/last", &["--task", "Hopper-v4"]));
    assert_eq!(run, eval("run", &["--seed", "0", "--episodes", "10"]));
    assert_ne!(run, eval("run", &["--seed", "1"]));

    let best = eval("run/checkpoints/best", &["--episodes", "3"]);
    assert!(best.contains("\nepisodes  3\n"), "{best}");
    let saved = place.read("run/checkpoints/best/checkpoint.json");
    let saved: serde_json::Value = serde_json::from_str(&saved).unwrap();
    let step = format!("mamf after {} steps", saved["step"]);
    assert!(best.contains(&step), "{best}");
}

#[test]
fn eval_writes_a_row_an_episode_to_a_new_file() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    let arguments = [
        "eval",
        "--checkpoint",
        "run",
        "--episodes",
        "3",
        "--csv",
        "e.csv",
    ];
    let printed = place.succeed(&arguments);
    let text = place.read("e.csv");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("episode,return,length,diverged,success"));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 3);
    let returns = rows.iter().map(|row| row[1].parse::<f64>().unwrap());
    let mean = returns.sum::<f64>() / 3.0;
    assert!(printed.contains(&format!("return    {mean:.2} +-")));
    for (i, row) in rows.iter().enumerate() {
        assert_eq!([row[0], row[2], row[3]], [&i.to_string(), "50", "false"]);
    }
    place.refuse(2, &arguments, &["--csv e.csv", "must be a new file"]);
}

// ---------------------------------------------------------------------------------------------
// Bad input
// ---------------------------------------------------------------------------------------------

#[test]
fn settings_that_are_wrong_are_refused_and_nothing_is_written() {
    let place = Place::new();
    for (setting, parts) in [
        ("batchsize=3", &["`batchsize`", "`batch_size`"][..]),
        (
            "imagination.target_fliter=false",
            &["`imagination.target_filter`"],
        ),
        ("task=Hoper-v4", &["\"Hoper-v4\"", "\"Hopper-v4\""]),
        ("method=ppo", &["`method`", "\"ppo\"", "`mamf`", "`td3`"]),
        ("steps=many", &["`steps`", "\"many\"", "whole number"]),
        ("steps=-5", &["`steps`", "-5", "at least 1"]),
        ("steps=0", &["`steps`", "at least 1"]),
        ("seed=-1", &["`seed`", "-1", "not negative"]),
        (
            "networks.hidden=256",
            &["`networks.hidden`", "list of whole numbers"],
        ),
        (
            "imagination.optimism=1",
            &["`imagination.optimism`", "true or false"],
        ),
        ("discount=1.5", &["`discount`", "1.5", "from 0 to 1"]),
        ("action_coupling=0", &["`action_coupling`", "above 0"]),
        ("tau=2", &["`tau`", "2", "at most 1"]),
        (
            "imagination.decay_rate=1.1",
            &["`imagination.decay_rate`", "1.1", "at most 1"],
        ),
        (
            "imagination.decay_rate=0",
            &["`imagination.decay_rate`", "above 0"],
        ),
        ("batch_size=0", &["`batch_size`", "from 2 to 1000000"]),
        ("batch_size=1", &["`batch_size`", "from 2 to 1000000"]),
        ("batch_size=201", &["`batch_size`", "201", "200"]),
        ("model_start=201", &["`model_start`", "201", "200"]),
        ("evaluation.every=0", &["`evaluation.every`", "at least 1"]),
        (
            "evaluation.episodes=0",
            &["`evaluation.episodes`", "from 1 to 100000"],
        ),
        ("checkpoint.every=0", &["`checkpoint.every`", "at least 1"]),
        ("compute.threads=0", &["`compute.threads`", "from 1"]),
        (
            "compute.backend=gpu",
            &["`compute.backend`", "`flex`", "`ndarray`"],
        ),
        (
            "demonstrations.probability=1.5",
            &["`demonstrations.probability`", "from 0 to 1"],
        ),
        (
            "demonstrations.probability=0.9",
            &["`demonstrations.probability`", "0.9", "at most 0.8 beside"],
        ),
        (
            "demonstrations.decay=0",
            &["`demonstrations.decay`", "above 0"],
        ),
        (
            "demonstrations.segment_steps=0",
            &["`demonstrations.segment_steps`", "at least 1"],
        ),
        (
            "demonstrations.batch_share=0.5",
            &["`demonstrations.batch_share`", "0.5", "demonstrations.path"],
        ),
        (
            "exploration.end_when_dropped=true",
            &[
                "`exploration.end_when_dropped`",
                "Hopper-v4",
                "nothing can be dropped",
            ],
        ),
        (
            "planner.drop_cost=1",
            &["`planner.drop_cost`", "Hopper-v4", "nothing can be dropped"],
        ),
        (
            "planner.samples=1_000_000",
            &[
                "`planner.samples`",
                "at most 500000",
                "planner.horizon = 20",
            ],
        ),
        ("planner.every=-1", &["`planner.every`", "not negative"]),
        (
            "networks.saturation_penalty=-1",
            &["`networks.saturation_penalty`", "from 0"],
        ),
        (
            "networks.from=runs/x",
            &["`networks.from`", "imagination.optimism = false"],
        ),
        (
            "demonstrations.return_bound=true",
            &[
                "`demonstrations.return_bound`",
                "demonstrations.batch_share",
            ],
        ),
        (
            "demonstrations.imitation=1",
            &["`demonstrations.imitation`", "demonstrations.batch_share"],
        ),
        (
            "demonstrations.path=3",
            &["`demonstrations.path`", "a string"],
        ),
        ("critic_updates=0", &["`critic_updates`", "from 1 to 1000"]),
        ("expansion.horizon=0", &["`expansion.horizon`"]),
        (
            "temperature.initial=0.2",
            &["`temperature.initial`", "`mamf`"],
        ),
        (
            "rules.reward=guess",
            &["`rules.reward`", "`known`", "`learned`"],
        ),
        ("imagination", &["--set imagination", "KEY=VALUE"]),
    ] {
        // The message names the option the value came from, not the file.
        let origin = format!("--set {setting}");
        let parts = [parts, &[&origin]].concat();
        place.refuse(2, &small_run("hopper", "out", &[setting]), &parts);
    }
}

#[test]
fn settings_that_mean_nothing_to_the_method_are_refused() {
    let place = Place::new();
    for (method, setting, reason) in [
        ("td3", "imagination.target_filter=true", "imagines no other"),
        ("sac", "imagination.uncertainty_filter=true", "imagines no"),
        ("mve-td3", "imagination.optimism=true", "imagines no"),
        ("td3", "temperature.initial=0.2", "has no temperature"),
        ("mamf", "expansion.horizon=5", "expands no values"),
        ("sac", "exploration_noise=0.2", "policy's own noise"),
        ("ddpg", "target_smoothing.clip=0.3", "does not smooth"),
    ] {
        let key = setting.split('=').next().unwrap();
        let origin = format!("--set {setting}");
        let arguments = small_run("hopper", "out", &[&format!("method={method}"), setting]);
        let parts = [key, &origin, &format!("`{method}`"), reason];
        place.refuse(2, &arguments, &parts);
        // A file that names its method is held to it as well.
        let (section, rest) = key.split_once('.').unwrap_or(("", key));
        let value = setting.split('=').nth(1).unwrap();
        let table = if section.is_empty() {
            format!("{rest} = {value}\n")
        } else {
            format!("[{section}]\n{rest} = {value}\n")
        };
        let text = format!("task = \"Hopper-v4\"\nmethod = \"{method}\"\n{table}");
        place.write("own.toml", text);
        let arguments = ["train", "--config", "own.toml", "--out", "out"];
        place.refuse(2, &arguments, &["own.toml", key, reason]);
    }
    place.refuse(
        2,
        &small_run("hopper", "out", &["method=mve-td3", "expansion.horizon=0"]),
        &["`expansion.horizon`", "from 1 to 100"],
    );
    // What a file says for its own method may stay when an option picks another one.
    place.train("half_cheetah", "td3", &["method=td3"]);
    let text = place.read("td3/config.toml");
    assert!(text.contains("target_filter = false"), "{text}");
    // The resolved configuration is accepted as it stands.
    let arguments = ["train", "--config", "td3/config.toml", "--out", "again"];
    place.succeed(&arguments);
    assert_eq!(curves(&place, "td3"), curves(&place, "again"));
}

#[test]
fn every_method_trains_evaluates_and_repeats_itself() {
    let mut all: Vec<[String; 2]> = Vec::new();
    for method in [
        "mamf",
        "mamf-sac",
        "td3",
        "td3-critic2",
        "mve-td3",
        "ma-td3",
        "ddpg",
        "sac",
    ] {
        let place = Place::new();
        let setting = format!("method={method}");
        let run = |out: &str, threads: &str| {
            let mut arguments = small_run("hopper", out, &[&setting]);
            arguments.extend(["--threads".into(), threads.into()]);
            place.succeed(&arguments);
            curves(&place, out)
        };
        let once = run("a", "1");
        assert_eq!(once, run("b", "2"), "{method}");
        assert!(!all.contains(&once), "{method} is another one's double");
        all.push(once);
        let printed = place.succeed(&["eval", "--checkpoint", "a", "--episodes", "1"]);
        assert!(
            printed.contains(&format!("Hopper-v4, {method} after 400")),
            "{printed}"
        );
        // Entropy and temperature of SAC, and of it alone; errors of imagined steps where other
        // actions are imagined; the critics' bias always.
        let text = place.read("a/train.csv");
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let last: Vec<&str> = text.lines().last().unwrap().split(',').collect();
        let told = |name: &str| {
            let column = header.iter().position(|h| *h == name).unwrap();
            !last[column].is_empty()
        };
        assert_eq!(told("entropy"), method.contains("sac"), "{last:?}");
        assert_eq!(told("temperature"), method.contains("sac"), "{last:?}");
        assert!(told("q_bias"), "{last:?}");
        let imagines = method.starts_with("ma");
        for name in [
            "dropped_state_error",
            "dropped_reward_error",
            "dropped_target_error",
        ] {
            assert_eq!(told(name), imagines, "{method} {name}: {last:?}");
        }
    }
    // Measuring imagined steps changes nothing else.
    let unmeasured = curves_of("hopper", 2, 0, &["telemetry.states=0"]);
    assert_eq!(unmeasured[1], all[0][1]);
    let learned = curves_of("hopper", 2, 0, &["rules.reward=learned"]);
    assert!(!all.contains(&learned));
    assert_eq!(
        learned,
        curves_of("hopper", 1, 0, &["rules.reward=learned"])
    );
}

#[test]
fn configurations_that_are_wrong_are_refused_by_file_and_key() {
    let place = Place::new();
    let task = "task = \"Hopper-v4\"\n";
    for (text, parts) in [
        ("seed = 1\n".to_owned(), &["missing key `task`"][..]),
        (format!("{task}steps = \n"), &["not valid TOML", "line 2"]),
        (format!("{task}[replay\n"), &["not valid TOML", "line 2"]),
        (format!("{task}{task}"), &["not valid TOML", "duplicate"]),
        (
            format!("{task}batch_sise = 3\n"),
            &["`batch_sise`", "`batch_size`"],
        ),
        (
            format!("{task}[imagination]\nrho = 0.9\ndecay_rat = 0.9\n"),
            &["unknown key `imagination."],
        ),
        (format!("{task}steps = -1\n"), &["`steps`", "at least 1"]),
        (
            format!("{task}steps = \"1000\"\n"),
            &["`steps`", "whole number"],
        ),
        (format!("{task}imagination = true\n"), &["[imagination]"]),
        (
            format!("{task}[imagination]\ndecay_rate = 1.5\n"),
            &["`imagination.decay_rate`", "1.5"],
        ),
        (
            "task = \"Humanoid\"\n".to_owned(),
            &["\"Humanoid\"", "\"Humanoid-v4\""],
        ),
        ("task = 3\n".to_owned(), &["`task`", "the id of a task"]),
    ] {
        place.write("wrong.toml", text);
        let parts = [&["wrong.toml"], parts].concat();
        place.refuse(
            2,
            &["train", "--config", "wrong.toml", "--out", "out"],
            &parts,
        );
    }
    for (path, parts) in [
        ("none.toml", ["none.toml", "No such file"]),
        (".", [".: can't read", "directory"]),
    ] {
        place.refuse(2, &["train", "--config", path, "--out", "out"], &parts);
    }
    place.write("binary.toml", [0xff, 0xfe, 0x00]);
    place.refuse(2, &["train", "--config", "binary.toml"], &["binary.toml"]);
}

#[test]
fn wrong_usage_is_refused() {
    let place = Place::new();
    let hopper = config("hopper");
    for (more, part) in [
        (&["--steps", "-5"][..], "-5"),
        (&["--steps", "1.5"], "--steps"),
        (&["--seed", "one"], "--seed"),
        (&["--threads", "0"], "compute.threads"),
        (&["--sets", "seed=1"], "--set"),
        (&["more"], "more"),
    ] {
        let arguments = [&["train", "--config", &hopper, "--out", "out"], more].concat();
        place.refuse(2, &arguments, &[part]);
    }
    place.refuse(2, &["train"], &["--config"]);
    place.refuse(2, &["eval"], &["--checkpoint"]);
    place.refuse(2, &["envs", "Hoper-v4"], &["Hopper-v4"]);
    place.refuse(2, &["verify", "nothing-here"], &["nothing-here"]);
}

#[test]
fn an_output_directory_in_use_is_left_as_it_is() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    place.refuse(
        2,
        &small_run("reacher", "run", &[]),
        &["run exists already", "--out", "--force"],
    );
    place.write("file", "text");
    for out in ["file", "file/run"] {
        place.refuse(2, &small_run("reacher", out, &[]), &[out]);
    }
}

#[test]
fn a_checkpoint_that_is_missing_or_of_another_task_is_refused() {
    let place = Place::new();
    let eval = |checkpoint: &str, code, parts: &[&str]| {
        place.refuse(code, &["eval", "--checkpoint", checkpoint], parts);
    };
    eval("nowhere", 2, &["nowhere: no checkpoint here"]);
    fs::create_dir(place.path("empty")).unwrap();
    eval("empty", 2, &["empty: no checkpoint here", "run directory"]);

    place.train("hopper", "run", &[]);
    place.refuse(
        2,
        &["eval", "--checkpoint", "run", "--task", "Reacher-v4"],
        &["run", "`Hopper-v4`", "`Reacher-v4`"],
    );
    let other = |file: &str| {
        let text = place.read(file).replace("Hopper-v4", "Walker2d-v4");
        place.write(file, text);
    };
    other("run/config.toml");
    eval("run", 2, &["run", "`Hopper-v4`", "`Walker2d-v4`"]);
    fs::remove_file(place.path("run/checkpoints/last/manifest.json")).unwrap();
    other("run/checkpoints/last/config.toml");
    other("run/checkpoints/last/checkpoint.json");
    eval(
        "run",
        1,
        &["weights.safetensors", "`Hopper-v4`", "`Walker2d-v4`"],
    );
}

#[test]
fn a_checkpoint_cut_short_is_refused_and_named() {
    let place = Place::new();
    place.train("hopper", "run", &[]);
    let last = "run/checkpoints/last";
    for (file, cuts) in [
        (
            "weights.safetensors",
            &[0, 1, 7, 8, 9, 500, 2000, 4000, 30_000][..],
        ),
        ("checkpoint.json", &[0, 1, 20, 50]),
        ("config.toml", &[0, 3, 12, 30]),
    ] {
        let whole = fs::read(place.path(&format!("{last}/{file}"))).unwrap();
        let almost = [whole.len() - 4, whole.len() - 2];
        // A configuration cut at the end of a line is still TOML.
        let lines: Vec<usize> = (0..whole.len() - 1)
            .filter(|i| file == "config.toml" && whole[*i] == b'\n')
            .collect();
        for cut in cuts.iter().chain(&almost).chain(&lines) {
            place.copy(last, "cut");
            let damaged = format!("cut/{file}");
            place.write(&damaged, &whole[..*cut]);
            place.refuse(
                1,
                &["eval", "--checkpoint", "cut"],
                &[&damaged, "damaged checkpoint"],
            );
        }
        place.copy(last, "cut");
        fs::remove_file(place.path(&format!("cut/{file}"))).unwrap();
        place.refuse(
            1,
            &["eval", "--checkpoint", "cut"],
            &[&format!("cut/{file}")],
        );
    }
}

#[test]
fn a_checkpoint_with_other_contents_is_refused_and_named() {
    let place = Place::new();
    place.train("hopper", "run", &[]);
    let damage = |change: &dyn Fn(), parts: &[&str]| {
        place.copy("run/checkpoints/last", "damaged");
        // The manifest would notice any change; weights may come without one.
        fs::remove_file(place.path("damaged/manifest.json")).unwrap();
        change();
        let parts = [&["damaged checkpoint", "weights.safetensors"], parts].concat();
        place.refuse(1, &["eval", "--checkpoint", "damaged"], &parts);
    };
    damage(
        &|| {
            let path = place.path("damaged/weights.safetensors");
            let mut bytes = fs::read(&path).unwrap();
            let end = bytes.len();
            bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
            fs::write(path, bytes).unwrap();
        },
        &["not finite"],
    );
    damage(
        &|| {
            let text = place.read("damaged/config.toml");
            place.write("damaged/config.toml", text.replacen("32", "31", 2));
        },
        &["shape"],
    );
}

// ---------------------------------------------------------------------------------------------
// Early ends
// ---------------------------------------------------------------------------------------------

#[cfg(unix)]
#[test]
fn an_interrupt_ends_a_run_with_a_saved_checkpoint() {
    for signal in ["INT", "TERM"] {
        let place = Place::new();
        let arguments = small_run("hopper", "run", &["steps=100000000"]);
        let mut command = place.command(&arguments);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = child.spawn().unwrap();
        wait_for(|| {
            assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
            let rows = fs::read_to_string(place.path("run/eval.csv"));
            rows.is_ok_and(|text| text.lines().count() >= 4)
        });
        let kill = format!("kill -{signal} {}", child.id());
        let killed = Command::new("sh").args(["-c", &kill]).status().unwrap();
        assert!(killed.success());
        wait_for(|| child.try_wait().unwrap().is_some());
        let output = child.wait_with_output().unwrap();
        let message = messages(&output);
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        assert!(message.contains("run/checkpoints/last"), "{message}");

        let step = message
            .strip_prefix("interrupted after step ")
            .and_then(|rest| rest.split(';').next())
            .unwrap_or_else(|| panic!("{message}"));
        let evaluation = place.succeed(&["eval", "--checkpoint", "run", "--episodes", "2"]);
        assert!(
            evaluation.contains(&format!("after {step} steps")),
            "{evaluation}"
        );
    }
}

/// Waits until `done`, for a minute at most.
fn wait_for(mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "it takes long");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let place = Place::new();
    for arguments in [small_run("reacher", "run", &[]), vec!["envs".to_owned()]] {
        let mut command = place.command(&arguments);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = child.spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert_eq!(messages(&output), "");
    }
}

#[test]
fn a_loss_that_is_not_finite_stops_the_run_and_leaves_the_last_good_checkpoint() {
    // One step of Adam at rate 1 makes every weight of the critics about 1 in size: through twenty
    // layers of 64 the next value is past the range of 32-bit floats once squared.
    let layers = format!("networks.hidden={:?}", [64; 20]);
    for method in ["method=mamf", "method=td3"] {
        let place = Place::new();
        let settings = [method, &layers, "networks.critic_learning_rate=1"];
        let output = place.run(&small_run("reacher", "run", &settings));
        let message = messages(&output);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert_eq!(output.stdout, b"");
        let step: u64 = message
            .strip_prefix("error: step ")
            .and_then(|rest| rest.split(':').next()?.parse().ok())
            .unwrap_or_else(|| panic!("{message}"));
        assert!((201..=400).contains(&step), "{message}");
        for part in ["is not finite", "run/checkpoints/last"] {
            assert!(message.contains(part), "{message}");
        }
        assert_eq!(message.lines().count(), 1, "{message}");

        for checkpoint in ["run", "run/checkpoints/best"] {
            place.succeed(&["eval", "--checkpoint", checkpoint, "--episodes", "2"]);
        }
        let state = place.read("run/checkpoints/last/checkpoint.json");
        let state: serde_json::Value = serde_json::from_str(&state).unwrap();
        assert!(state["step"].as_u64().unwrap() < step, "{state}");
    }
}

// ---------------------------------------------------------------------------------------------
// Doubled actions
// ---------------------------------------------------------------------------------------------

#[test]
fn doubled_actions_wrap_any_task() {
    let place = Place::new();
    let doubled = "task.doubled_actions.period=50";
    let once = curves_of("reacher", 1, 0, &[doubled]);
    assert_eq!(once, curves_of("reacher", 2, 0, &[doubled]));
    assert_ne!(once, curves_of("reacher", 2, 0, &[]));
    assert_ne!(
        once,
        curves_of("reacher", 2, 0, &["task.doubled_actions.period=49"])
    );
    place.train("reacher", "run", &[doubled]);
    assert!(
        place
            .read("run/config.toml")
            .contains("[doubled_actions]\nperiod = 50")
    );
    let printed = place.succeed(&["eval", "--checkpoint", "run", "--episodes", "1"]);
    assert!(printed.contains("Reacher-v4"), "{printed}");
    // The same as a table; the run goes to a directory of its own.
    let table = "method = \"td3\"\n[task]\nid = \"Reacher-v4\"\n\
                 doubled_actions = { period = 50 }\n";
    place.write("table.toml", table);
    let mut arguments: Vec<String> = ["train", "--config", "table.toml"].map(Into::into).into();
    for setting in crate::common::SMALL {
        arguments.extend(["--set".into(), setting.into()]);
    }
    place.succeed(&arguments);
    assert!(
        place
            .path("runs/Reacher-v4-doubled-50/td3/seed-0/eval.csv")
            .exists()
    );

    let refuse = |setting: &str, parts: &[&str]| {
        place.refuse(2, &small_run("reacher", "out", &[setting]), parts);
    };
    refuse(
        "task.doubled_actions.period=0",
        &["doubled_actions", "at least 1"],
    );
    refuse(
        "task.doubled_actions.period=no",
        &["doubled_actions", "whole number"],
    );
    refuse(
        "task.doubled_action.period=5",
        &["doubled_action", "`doubled_actions.period`"],
    );
    let arguments = ["demo", "record", "--checkpoint", "run", "--out", "demos"];
    place.refuse(2, &arguments, &["run", "doubled"]);
}

// ---------------------------------------------------------------------------------------------
// Hand tasks and demonstrations
// ---------------------------------------------------------------------------------------------

/// Settings of a still smaller run, for tasks that take long to simulate.
const TINY: [&str; 5] = [
    "steps=150",
    "random_steps=60",
    "model_start=40",
    "evaluation.every=75",
    "evaluation.episodes=2",
];

/// A run that ends well and says something of demonstrations on its way; what it said.
fn noted(place: &Place, arguments: &[String]) -> String {
    let output = place.run(arguments);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    stderr(&output)
}

#[test]
fn without_demonstrations_a_hand_task_trains_on_plain_episodes_and_says_so() {
    let place = Place::new();
    let note = noted(&place, &small_run("egg_hand_over", "run", &TINY));
    assert!(note.contains("no demonstrations"), "{note}");
    assert!(note.contains("plain episodes"), "{note}");
    // Goal tasks tell how many episodes end in success.
    let text = place.read("run/eval.csv");
    let rows: Vec<&str> = text.lines().skip(1).collect();
    assert_eq!(rows.len(), 3);
    for row in rows {
        let rate: f64 = row.split(',').next_back().unwrap().parse().unwrap();
        assert!((0.0..=1.0).contains(&rate), "{row}");
    }
    let printed = place.succeed(&["eval", "--checkpoint", "run", "--episodes", "1"]);
    assert!(printed.contains("success   "), "{printed}");
}

#[test]
fn demonstrations_that_cannot_be_used_are_refused_and_nothing_is_written() {
    let place = Place::new();
    fs::create_dir(place.path("empty")).unwrap();
    let fixtures = format!("{}/tests/fixtures/rollouts", env!("CARGO_MANIFEST_DIR"));
    let refuse = |code, path: &str, parts: &[&str]| {
        let setting = format!("demonstrations.path={path}");
        let parts = [parts, &["demonstrations.path"]].concat();
        place.refuse(code, &small_run("pen_spin", "out", &[&setting]), &parts);
    };
    refuse(2, "nowhere", &["nowhere"]);
    refuse(2, "empty", &["empty"]);
    refuse(2, "nothing*.npz", &["nothing*.npz"]);
    let other = format!("{fixtures}/EggHandOver.npz");
    refuse(
        2,
        &other,
        &["EggHandOver.npz", "EggHandOver-v0", "PenSpin-v0"],
    );
    for file in ["PenSpin.npz", "PenSpin.json"] {
        fs::copy(format!("{fixtures}/{file}"), place.path(file)).unwrap();
    }
    let whole = fs::read(place.path("PenSpin.npz")).unwrap();
    place.write("PenSpin.npz", &whole[..whole.len() / 2]);
    refuse(1, "PenSpin.npz", &["PenSpin.npz"]);
    let message = stderr(&place.run(&small_run(
        "pen_spin",
        "out",
        &["demonstrations.path=PenSpin.npz"],
    )));
    assert_eq!(message.matches("PenSpin.npz").count(), 1, "{message}");
    fs::remove_file(place.path("PenSpin.json")).unwrap();
    place.write("PenSpin.npz", &whole);
    refuse(1, "PenSpin.npz", &["PenSpin.json"]);
}

#[test]
fn force_spares_demonstrations_that_lie_in_the_run() {
    let place = Place::new();
    let settings = [&TINY[..], &["steps=60", "telemetry.states=0"]].concat();
    noted(&place, &small_run("egg_hand_over", "run", &settings));
    let record = ["demo", "record", "--checkpoint", "run", "--episodes", "1"];
    place.succeed(&[&record[..], &["--out", "run/demos"]].concat());
    let before = place.contents("run/demos");
    assert_eq!(before.len(), 2);
    let settings = [&settings[..], &["demonstrations.path=run/demos"]].concat();
    let mut arguments = small_run("egg_hand_over", "run", &settings);
    arguments.push("--force".into());
    noted(&place, &arguments);
    assert_eq!(place.contents("run/demos"), before);
}

#[test]
fn demonstrations_change_a_run_and_a_seed_still_gives_the_same_bytes() {
    let place = Place::new();
    let fixture = "tests/fixtures/rollouts/EggHandOver.npz";
    let path = format!("{}/{fixture}", env!("CARGO_MANIFEST_DIR"));
    let path = format!("demonstrations.path={path}");
    let run = |out: &str, threads: &str, settings: &[&str]| {
        let settings = [&TINY[..], settings].concat();
        let mut arguments = small_run("egg_hand_over", out, &settings);
        arguments.extend(["--threads".into(), threads.into()]);
        (noted(&place, &arguments), curves(&place, out))
    };
    let (note, once) = run("a", "1", &[&path]);
    assert!(note.contains("trajectories 1, states 14"), "{note}");
    assert_eq!(once, run("b", "2", &[&path]).1);
    assert_ne!(once, run("c", "2", &[]).1);
    // The sparse variant takes them as well.
    let sparse = ["task=EggHandOverSparse-v0", &path];
    assert_ne!(once, run("d", "2", &sparse).1);
}
