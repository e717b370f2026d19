//! Runs that are interrupted, killed, damaged or changed, and go on: `mamf train --resume`.

use crate::common::{Place, messages, small_run, stderr};
use std::collections::BTreeSet;
use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// What must not depend on interruptions: the curves, and the networks in the end.
const SAME: [&str; 5] = [
    "train.csv",
    "eval.csv",
    "checkpoints/last/weights.safetensors",
    "checkpoints/last/optimizers.safetensors",
    "checkpoints/replay/000000000000.f32",
];

fn assert_same(place: &Place, expected: &str, found: &str, about: &str) {
    for file in SAME {
        let [expected, found] =
            [expected, found].map(|run| fs::read(place.path(&format!("{run}/{file}"))));
        assert!(
            expected.unwrap() == found.unwrap(),
            "{about}: {file} differs"
        );
    }
}

fn resume(place: &Place, run: &str, more: &[&str]) {
    place.succeed(&[&["train", "--resume", run], more].concat());
}

/// Files of a run, without what is in them.
fn names(place: &Place, run: &str) -> BTreeSet<String> {
    let root = place.path(run);
    let paths = place.contents(run).into_keys();
    let inside = paths.map(|path| path.strip_prefix(&root).unwrap().to_owned());
    inside
        .map(|path| path.to_str().unwrap().to_owned())
        .collect()
}

// ---------------------------------------------------------------------------------------------
// Going on
// ---------------------------------------------------------------------------------------------

#[test]
fn a_resumed_run_is_the_uninterrupted_one_for_every_method() {
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
        place.train("hopper", "whole", &[&setting]);
        // The stops lie in phase 1, at its end, between two updates of the actor and at an evaluation.
        let first = ["--steps", "130", "--threads", "1"];
        let mut begin = small_run("hopper", "parts", &[&setting]);
        begin.extend(first.map(Into::into));
        assert_eq!(place.run(&begin).status.code(), Some(0));
        for (steps, threads) in [("200", "2"), ("265", "3"), ("300", "1"), ("400", "2")] {
            let arguments = [
                "train",
                "--resume",
                "parts",
                "--steps",
                steps,
                "--threads",
                threads,
            ];
            let output = place.run(&arguments);
            assert_eq!(output.status.code(), Some(0), "{output:?}");
        }
        assert_same(&place, "whole", "parts", method);
    }
}

#[test]
fn a_planned_episode_that_is_lost_costs_the_checkpoints_that_need_it() {
    let place = Place::new();
    let settings = [
        "method=td3",
        "steps=150",
        "random_steps=60",
        "evaluation.every=75",
        "evaluation.episodes=1",
        "checkpoint.every=35",
        "planner.every=20",
        "planner={horizon=2, samples=4, elites=2, iterations=1, first_iterations=1, drop_cost=5}",
        "planner.patience=5",
    ];
    let output = place.run(&small_run("pen_spin", "whole", &settings));
    assert!(output.status.success(), "{output:?}");
    let resume = |run: &str| place.run(&["train", "--resume", run, "--steps", "155"]);
    let archive = |number: usize| format!("planned/episode_00000{number}.npz");
    assert!(place.path("whole").join(archive(4)).exists());
    for run in ["lost", "other", "first"] {
        place.copy("whole", run);
    }
    assert!(resume("whole").status.success());

    // The last checkpoint knows the fourth episode, the one before it three.
    fs::remove_file(place.path("lost").join(archive(4))).unwrap();
    fs::copy(
        place.path("other").join(archive(1)),
        place.path("other").join(archive(4)),
    )
    .unwrap();
    for run in ["lost", "other"] {
        let output = resume(run);
        assert!(output.status.success(), "{output:?}");
        let said = stderr(&output);
        assert!(
            said.contains(&archive(4)) && said.contains("the checkpoint before it"),
            "{said}"
        );
        assert_same(&place, "whole", run, run);
    }
    // All of them know the first.
    fs::remove_file(place.path("first").join(archive(1))).unwrap();
    place.refuse(
        1,
        &["train", "--resume", "first", "--steps", "155"],
        &[&archive(1), "missing"],
    );
}

#[test]
fn a_resumed_run_is_the_uninterrupted_one_for_every_kind_of_task() {
    const TINY: [&str; 6] = [
        "steps=150",
        "random_steps=60",
        "model_start=40",
        "evaluation.every=75",
        "evaluation.episodes=1",
        "checkpoint.every=35",
    ];
    const PLANS: [&str; 5] = [
        "planner.every=20",
        "planner={horizon=2, samples=4, elites=2, iterations=1, first_iterations=1, drop_cost=5}",
        "exploration.end_when_dropped=true",
        "method=td3",
        "demonstrations.batch_share=0.25",
    ];
    let fixture = |name: &str| {
        let root = env!("CARGO_MANIFEST_DIR");
        format!("demonstrations.path={root}/tests/fixtures/rollouts/{name}.npz")
    };
    let (spin, hand_over) = (fixture("PenSpin"), fixture("EggHandOver"));
    for (config, settings) in [
        ("pen_spin", &[][..]),
        ("pen_spin", &[spin.as_str()]),
        (
            "pen_spin",
            &[
                spin.as_str(),
                "method=td3",
                "demonstrations.batch_share=0.25",
                "demonstrations.imitation=1",
                "demonstrations.return_bound=true",
                "telemetry.recorded_states=3",
                "networks.critic_normalisation=layer",
                "target_value=mean",
            ],
        ),
        // The planner begins with recordings, or with none; it acts before, at and after the stops.
        (
            "pen_spin",
            &[
                PLANS[0],
                PLANS[1],
                PLANS[2],
                PLANS[3],
                PLANS[4],
                spin.as_str(),
                "telemetry.recorded_states=3",
            ],
        ),
        (
            "pen_spin",
            &[PLANS[0], PLANS[1], PLANS[2], PLANS[3], PLANS[4]],
        ),
        ("egg_hand_over", &[hand_over.as_str()]),
        ("egg_catch_underarm_hard", &[]),
        ("humanoid", &["rules.reward=learned"]),
        (
            "pusher",
            &["task.doubled_actions.period=7", "action_coupling=1"],
        ),
        ("ant", &["replay.capacity=50", "scaling.enabled=false"]),
        (
            "walker2d",
            &["compute.backend=ndarray", "telemetry.states=0"],
        ),
        ("hopper", &["updates.every=4", "method=td3"]),
    ] {
        let place = Place::new();
        let settings = [&TINY[..], settings].concat();
        let whole = place.run(&small_run(config, "whole", &settings));
        assert_eq!(whole.status.code(), Some(0), "{whole:?}");
        let mut begin = small_run(config, "parts", &settings);
        begin.extend(["--steps", "64"].map(Into::into));
        assert_eq!(place.run(&begin).status.code(), Some(0));
        for steps in ["101", "150"] {
            let arguments = ["train", "--resume", "parts", "--steps", steps];
            let output = place.run(&arguments);
            assert_eq!(output.status.code(), Some(0), "{output:?}");
        }
        assert_same(&place, "whole", "parts", &settings.join(" "));
    }
}

#[test]
fn a_resumed_run_of_several_environments_is_the_uninterrupted_one() {
    let recording = concat!(
        "demonstrations.path=",
        env!("CARGO_MANIFEST_DIR"),
        "/tests/fixtures/rollouts/PenSpin.npz"
    );
    const TINY: [&str; 6] = [
        "steps=168",
        "random_steps=72",
        "model_start=40",
        "evaluation.every=50",
        "evaluation.episodes=1",
        "checkpoint.every=35",
    ];
    for (config, settings) in [
        ("hopper", &["environments=2"][..]),
        (
            "half_cheetah",
            &["environments=4", "exploration.spread=[0.05, 0.4]"],
        ),
        ("reacher", &["environments=12", "updates.every=5"]),
        (
            "pen_spin",
            &["environments=2", "updates.every=3", recording],
        ),
        ("ant", &["environments=3", "replay.capacity=50"]),
        // Divides neither phase 1 nor the run: both end with a round of fewer steps.
        ("walker2d", &["environments=5", "updates.every=3"]),
    ] {
        let place = Place::new();
        let settings = [&TINY[..], settings].concat();
        let whole = place.run(&small_run(config, "whole", &settings));
        assert_eq!(whole.status.code(), Some(0), "{whole:?}");
        let mut begin = small_run(config, "parts", &settings);
        begin.extend(["--steps", "60"].map(Into::into));
        assert_eq!(place.run(&begin).status.code(), Some(0));
        // Where rounds end.
        let middle = match settings.contains(&"environments=5") {
            true => "107",
            false => "108",
        };
        for (steps, threads) in [("72", "1"), (middle, "2"), ("168", "3")] {
            let arguments = [
                "train",
                "--resume",
                "parts",
                "--steps",
                steps,
                "--threads",
                threads,
            ];
            let output = place.run(&arguments);
            assert_eq!(output.status.code(), Some(0), "{output:?}");
        }
        assert_same(&place, "whole", "parts", &settings.join(" "));
    }
}

#[test]
fn a_finished_run_says_so_and_can_be_made_longer() {
    let place = Place::new();
    place.train("reacher", "whole", &["steps=430"]);
    place.train("reacher", "run", &[]);
    let before = place.contents("run");
    let said = place.succeed(&["train", "--resume", "run"]);
    assert_eq!(said, "finished already, 400 steps: run\n");
    assert!(place.contents("run") == before);
    place.refuse(
        2,
        &["train", "--resume", "run", "--steps", "399"],
        &["steps = 399", "400 steps already"],
    );
    resume(&place, "run", &["--steps", "430"]);
    assert_same(&place, "whole", "run", "made longer");
    assert!(place.read("run/config.toml").contains("steps = 430"));
    let run: serde_json::Value = serde_json::from_str(&place.read("run/run.json")).unwrap();
    assert_eq!(run["resumed"][0]["step"], 400);
    assert_eq!(run["resumed"][0]["command"][1], "train");
    assert_eq!(run["command"][2], "--config");
}

#[test]
fn what_cannot_be_resumed_is_refused() {
    let place = Place::new();
    place.refuse(2, &["train", "--resume", "nowhere"], &["nowhere: no run"]);
    fs::create_dir(place.path("empty")).unwrap();
    place.refuse(2, &["train", "--resume", "empty"], &["empty: no run"]);
    place.train("reacher", "run", &["steps=250"]);
    // A checkpoint is no run, and neither is a directory that only holds a configuration.
    for name in ["last", "previous", "best"] {
        let checkpoint = format!("run/checkpoints/{name}");
        place.refuse(
            2,
            &["train", "--resume", &checkpoint],
            &["this is a checkpoint"],
        );
    }
    fs::create_dir(place.path("mine")).unwrap();
    fs::copy(
        place.path("run/config.toml"),
        place.path("mine/config.toml"),
    )
    .unwrap();
    place.write("mine/train.csv", "my own");
    place.refuse(2, &["train", "--resume", "mine"], &["mine: no run"]);
    // Checkpoints that were there are not made again from the first step on.
    place.copy("run", "lost");
    for name in ["last", "previous"] {
        fs::remove_dir_all(place.path(&format!("lost/checkpoints/{name}"))).unwrap();
    }
    let parts = [
        "lost: the curves go to step 250",
        "due at step 50",
        "bring checkpoints/last",
    ];
    place.refuse(2, &["train", "--resume", "lost"], &parts);
    fs::remove_dir_all(place.path("lost/checkpoints")).unwrap();
    place.refuse(2, &["train", "--resume", "lost"], &["lost: no run"]);
    for more in [
        &["--config", "run/config.toml"][..],
        &["--set", "seed=1"],
        &["--seed", "1"],
        &["--out", "other"],
    ] {
        let arguments = [&["train", "--resume", "run"], more].concat();
        place.refuse(2, &arguments, &["--resume"]);
    }
    let longer = ["train", "--resume", "run", "--steps", "300"];
    place.refuse(
        2,
        &[&longer[..3], &["--threads", "0"]].concat(),
        &["compute.threads"],
    );

    // Settings: some change results, some do not; either way the difference is shown.
    let config = place.read("run/config.toml");
    let change = |from: &str, to: &str| {
        assert!(config.contains(from), "{from}");
        place.write("run/config.toml", config.replacen(from, to, 1));
    };
    change("Reacher-v4", "Hopper-v4");
    let task = ["task: \"Reacher-v4\" then, \"Hopper-v4\" now"];
    place.refuse(2, &longer, &task);
    change("capacity = 1000000", "capacity = 100");
    place.refuse(2, &longer, &["replay.capacity: 1000000 then, 100 now"]);
    change("discount = 0.98", "discount = 0.97");
    let parts = [
        "run: something has changed",
        "discount: 0.98 then, 0.97 now",
    ];
    place.refuse(2, &longer, &parts);
    let forced = [&longer[..], &["--force"]].concat();
    place.refuse(2, &forced, &parts);
    change("every = 50\nreplay", "every = 60\nreplay");
    let parts = ["checkpoint.every: 50 then, 60 now", "--force"];
    place.refuse(2, &longer, &parts);
    place.succeed(&forced);
    place.train("reacher", "whole", &["steps=300"]);
    assert_same(&place, "whole", "run", "with other checkpoints");

    // Whether it could be resumed is no small matter.
    let config = place.read("run/config.toml");
    place.write(
        "run/config.toml",
        config.replacen("replay = true", "replay = false", 1),
    );
    let longer = ["train", "--resume", "run", "--steps", "310", "--force"];
    place.refuse(
        2,
        &longer,
        &["checkpoint.replay: true then", "--force does not help"],
    );
}

#[test]
fn without_the_replay_buffer_a_run_can_be_evaluated_only_and_says_so() {
    let place = Place::new();
    place.train("reacher", "run", &["checkpoint.replay=false", "steps=250"]);
    assert!(!place.path("run/checkpoints/replay").exists());
    assert!(!place.path("run/checkpoints/last/state.cbor").exists());
    place.succeed(&["eval", "--checkpoint", "run", "--episodes", "1"]);
    place.succeed(&["train", "--resume", "run"]);
    let longer = ["train", "--resume", "run", "--steps", "300"];
    let parts = ["checkpoint.replay = false", "evaluated, but not resumed"];
    place.refuse(2, &longer, &parts);
}

#[test]
fn memory_that_the_machine_does_not_have_is_refused_before_it_is_taken() {
    let place = Place::new();
    let settings = ["replay.capacity=1000000000", "steps=4000000000"];
    let parts = [
        "replay.capacity",
        "1000000000 transitions of 656 bytes, 656",
        "at most",
    ];
    place.refuse(2, &small_run("pen_spin", "run", &settings), &parts);
    let output = place.run(&small_run("reacher", "run", &[]));
    let said = stderr(&output);
    let expected = "replay buffer: 400 transitions of 112 bytes, 44.80 kB when full";
    assert!(said.contains(expected), "{said}");
}

#[test]
fn other_demonstrations_are_noticed() {
    let place = Place::new();
    let fixture = |name: &str| {
        let root = env!("CARGO_MANIFEST_DIR");
        format!("{root}/tests/fixtures/rollouts/{name}")
    };
    fs::create_dir(place.path("demos")).unwrap();
    for file in ["PenSpin.npz", "PenSpin.json"] {
        fs::copy(fixture(file), place.path(&format!("demos/{file}"))).unwrap();
    }
    let settings = [
        "demonstrations.path=demos",
        "steps=210",
        "evaluation.episodes=1",
    ];
    let output = place.run(&small_run("pen_spin", "run", &settings));
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    for ending in ["npz", "json"] {
        let from = fixture(&format!("PenSpin.{ending}"));
        fs::copy(from, place.path(&format!("demos/second.{ending}"))).unwrap();
    }
    let longer = ["train", "--resume", "run", "--steps", "220"];
    place.refuse(2, &longer, &["not the demonstrations that the run began"]);
    for ending in ["npz", "json"] {
        fs::remove_file(place.path(&format!("demos/second.{ending}"))).unwrap();
    }
    assert_eq!(place.run(&longer).status.code(), Some(0));
}

// ---------------------------------------------------------------------------------------------
// Signals and locks
// ---------------------------------------------------------------------------------------------

/// Waits until `done`, for a minute at most.
fn wait_for(mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "it takes long");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn begin(place: &Place, arguments: &[String]) -> Child {
    let mut command = place.command(arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    child.spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    let kill = format!("kill -{name} {}", child.id());
    assert!(
        Command::new("sh")
            .args(["-c", &kill])
            .status()
            .unwrap()
            .success()
    );
}

/// A run that goes on until it is stopped, and is past its first evaluations.
fn endless(place: &Place, run: &str, settings: &[&str]) -> Child {
    let settings = [&["steps=100000000", "replay.capacity=500"], settings].concat();
    let mut child = begin(place, &small_run("hopper", run, &settings));
    wait_for(|| {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        let standing = format!("{run}/checkpoints/previous/manifest.json");
        let learning = format!("{run}/eval.csv");
        let rows = fs::read_to_string(place.path(&learning)).unwrap_or_default();
        place.path(&standing).exists() && rows.lines().count() >= 5
    });
    child
}

#[test]
fn each_signal_saves_a_run_that_goes_on_as_if_nothing_had_been() {
    let place = Place::new();
    for name in ["INT", "TERM", "USR1"] {
        let child = endless(&place, name, &[]);
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        let message = messages(&output);
        let step = message.strip_prefix("interrupted after step ").unwrap();
        let step: u64 = step.split(';').next().unwrap().parse().unwrap();
        assert!(message.contains("go on with --resume"), "{message}");
        let steps = (step + 30).to_string();
        resume(&place, name, &["--steps", &steps]);
        let setting = format!("steps={steps}");
        place.train("hopper", "whole", &[&setting, "replay.capacity=500"]);
        assert_same(&place, "whole", name, name);
        fs::remove_dir_all(place.path("whole")).unwrap();
    }
    // A run that can't be resumed does not say that it can.
    let child = endless(&place, "without", &["checkpoint.replay=false"]);
    signal(&child, "TERM");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(messages(&output).contains("not resumed"), "{output:?}");
}

/// A run that does little else than save.
fn saving(place: &Place, run: &str) -> Child {
    let settings = [
        "steps=100000000",
        "replay.capacity=500",
        "checkpoint.every=1",
    ];
    let child = begin(place, &small_run("hopper", run, &settings));
    let previous = format!("{run}/checkpoints/previous/manifest.json");
    wait_for(|| place.path(&previous).exists());
    child
}

/// A run that is busy with its first evaluation for hours.
fn evaluating(place: &Place, run: &str) -> Child {
    let child = begin(
        place,
        &small_run("hopper", run, &["evaluation.episodes=100000"]),
    );
    wait_for(|| place.path(&format!("{run}/timing.csv")).exists());
    child
}

#[test]
fn a_second_interrupt_ends_a_run_at_once_and_harms_nothing() {
    let place = Place::new();
    let mut child = evaluating(&place, "run");
    signal(&child, "INT");
    std::thread::sleep(Duration::from_millis(300));
    assert!(
        child.try_wait().unwrap().is_none(),
        "the first one waits for the step"
    );
    let started = Instant::now();
    signal(&child, "INT");
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(started.elapsed() < Duration::from_secs(5));
    // Another signal before does not count.
    let mut child = evaluating(&place, "other");
    for name in ["TERM", "USR1", "INT"] {
        signal(&child, name);
        std::thread::sleep(Duration::from_millis(300));
    }
    assert!(child.try_wait().unwrap().is_none());
    signal(&child, "INT");
    assert_eq!(child.wait().unwrap().code(), Some(130));

    // In the middle of saving, again and again.
    for _ in 0..5 {
        let child = saving(&place, "often");
        let twice = format!("kill -INT {0}; kill -INT {0}", child.id());
        Command::new("sh").args(["-c", &twice]).output().unwrap();
        let output = child.wait_with_output().unwrap();
        let code = output.status.code();
        assert!(code == Some(130) || code == Some(75), "{output:?}");
        let step = (saved_step(&place, "often") + 5).to_string();
        let output = place.run(&["train", "--resume", "often", "--steps", &step]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        fs::remove_dir_all(place.path("often")).unwrap();
    }
}

#[test]
fn a_signal_that_comes_before_the_first_step_is_heard() {
    let place = Place::new();
    // Many transitions to be read take a while.
    let settings = [
        "steps=600000",
        "random_steps=1000000",
        "model_start=1000000",
    ];
    let settings = [
        &settings[..],
        &["evaluation.every=1000000", "checkpoint.every=600000"],
    ]
    .concat();
    let output = place.run(&small_run(
        "reacher",
        "run",
        &[&settings[..], &["method=td3"]].concat(),
    ));
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let arguments = ["train", "--resume", "run", "--steps", "700000"].map(String::from);
    let child = begin(&place, &arguments);
    wait_for(|| place.path("run/run.lock").exists());
    signal(&child, "USR1");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(75), "{output:?}");
    assert_eq!(saved_step(&place, "run"), 600_001);
}

#[test]
fn a_run_can_be_evaluated_while_it_saves() {
    let place = Place::new();
    let mut child = saving(&place, "run");
    for _ in 0..40 {
        place.succeed(&["eval", "--checkpoint", "run", "--episodes", "1"]);
    }
    assert!(child.try_wait().unwrap().is_none());
    child.kill().unwrap();
    child.wait().unwrap();
}

fn saved_step(place: &Place, run: &str) -> u64 {
    let found = ["last", "previous"].map(|name| format!("{run}/checkpoints/{name}"));
    let found = found.iter().find(|path| place.path(path).exists()).unwrap();
    let state = place.read(&format!("{found}/checkpoint.json"));
    let state: serde_json::Value = serde_json::from_str(&state).unwrap();
    state["step"].as_u64().unwrap()
}

#[test]
fn a_run_belongs_to_one_process_until_that_ends() {
    let place = Place::new();
    let mut child = endless(&place, "run", &[]);
    let pid = child.id().to_string();
    let parts = ["run.lock", pid.as_str(), "is working on this run"];
    for arguments in [
        vec!["train".to_owned(), "--resume".to_owned(), "run".to_owned()],
        [small_run("hopper", "run", &[]), vec!["--force".to_owned()]].concat(),
    ] {
        let output = place.run(&arguments);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        let message = stderr(&output);
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(
        place.path("run/run.lock").exists(),
        "left by the dead process"
    );
    let step = saved_step(&place, "run") + 10;
    let output = place.run(&["train", "--resume", "run", "--steps", &step.to_string()]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let note = format!("process {pid} on ");
    assert!(stderr(&output).contains(&note), "{output:?}");
    assert!(!place.path("run/run.lock").exists());
}

// ---------------------------------------------------------------------------------------------
// Kills
// ---------------------------------------------------------------------------------------------

/// Small random numbers; where a process is killed need not repeat itself.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % sides
    }
}

#[test]
fn a_run_killed_again_and_again_ends_with_the_same_bytes_and_leaves_nothing_behind() {
    let place = Place::new();
    // Much of the time goes into saving.
    let settings = ["checkpoint.every=7", "steps=700", "replay.capacity=300"];
    place.train("reacher", "whole", &settings);
    let expected = names(&place, "whole");
    let mut dice = Dice(0x5eed);
    for round in 0..3 {
        let run = format!("killed{round}");
        let mut kills = 0;
        loop {
            // Killed before its configuration is there, a run is begun anew.
            let begun = place.path(&format!("{run}/config.toml")).exists();
            let arguments = if begun {
                ["train", "--resume", &run].map(Into::into).to_vec()
            } else {
                small_run("reacher", &run, &settings)
            };
            let mut child = begin(&place, &arguments);
            std::thread::sleep(Duration::from_millis(20 + dice.roll(230)));
            if kills < 25 && child.try_wait().unwrap().is_none() {
                child.kill().unwrap();
                child.wait().unwrap();
                kills += 1;
                continue;
            }
            let output = child.wait_with_output().unwrap();
            let message = stderr(&output);
            assert_eq!(output.status.code(), Some(0), "{message}");
            break;
        }
        assert!(kills >= 5, "{kills} kills");
        assert_same(
            &place,
            "whole",
            &run,
            &format!("round {round}, {kills} kills"),
        );
        assert_eq!(names(&place, &run), expected);
    }
}

// ---------------------------------------------------------------------------------------------
// Damage
// ---------------------------------------------------------------------------------------------

#[test]
fn a_damaged_checkpoint_gives_way_to_the_one_before_it() {
    let place = Place::new();
    place.train("reacher", "whole", &["steps=430"]);
    place.train("reacher", "run", &[]);
    let longer = ["train", "--resume", "again", "--steps", "430"];
    for file in [
        "checkpoints/last/weights.safetensors",
        "checkpoints/last/optimizers.safetensors",
        "checkpoints/last/state.cbor",
        "checkpoints/last/manifest.json",
        "checkpoints/last/config.toml",
        "checkpoints/last/checkpoint.json",
    ] {
        for missing in [false, true] {
            place.copy("run", "again");
            let path = place.path(&format!("again/{file}"));
            let mut bytes = fs::read(&path).unwrap();
            fs::remove_file(&path).unwrap();
            if !missing {
                let middle = bytes.len() / 2;
                bytes[middle] ^= 4;
                fs::write(&path, bytes).unwrap();
            }
            let output = place.run(&longer);
            let message = stderr(&output);
            assert_eq!(output.status.code(), Some(0), "{message}");
            let name = file.rsplit('/').next().unwrap();
            for part in [name, "of step 350", "again/checkpoints/damaged"] {
                assert!(message.contains(part), "{file}: `{part}` not in {message}");
            }
            assert_same(&place, "whole", "again", file);
            fs::remove_dir_all(place.path("again")).unwrap();
        }
    }
}

#[test]
fn a_finished_run_that_cannot_be_written_to_is_finished_all_the_same() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    // A directory in the place of the lock: whoever wants to write fails.
    fs::create_dir(place.path("run/run.lock")).unwrap();
    let said = place.succeed(&["train", "--resume", "run"]);
    assert_eq!(said, "finished already, 400 steps: run\n");
    let longer = ["train", "--resume", "run", "--steps", "410"];
    place.refuse(1, &longer, &["run/run.lock"]);
}

#[test]
fn force_removes_a_run_and_nothing_else_and_only_for_a_run_that_can_begin() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    place.copy("run/checkpoints/best", "run/checkpoints/my-backup");
    place.write("run/checkpoints/notes.txt", "mine");
    let mut again = small_run("reacher", "run", &["steps=210"]);
    again.push("--force".into());
    place.succeed(&again);
    assert!(
        place
            .path("run/checkpoints/my-backup/weights.safetensors")
            .exists()
    );
    assert_eq!(place.read("run/checkpoints/notes.txt"), "mine");
    assert!(
        !place
            .path("run/checkpoints/replay/000000000400.f32")
            .exists()
    );
    // Killed between the files that a run begins with, it is still known for what it is.
    fs::remove_file(place.path("run/run.json")).unwrap();
    place.refuse(
        2,
        &small_run("reacher", "run", &[]),
        &["--force", "--resume"],
    );
    place.succeed(&again);
}

#[test]
fn damage_to_what_all_checkpoints_need_is_refused_by_name() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    let longer = ["train", "--resume", "again", "--steps", "430"];
    for (file, at) in [
        ("checkpoints/replay/000000000000.f32", 100),
        ("train.csv", 30),
        ("eval.csv", 3),
        ("timing.csv", 1),
    ] {
        place.copy("run", "again");
        let name = format!("again/{file}");
        let mut bytes = fs::read(place.path(&name)).unwrap();
        bytes[at] ^= 1;
        place.write(&name, &bytes);
        place.refuse(1, &longer, &[&name, "checksum", "no checkpoint of the run"]);
        bytes.truncate(at);
        place.write(&name, &bytes);
        place.refuse(1, &longer, &[&name, "of", "no checkpoint of the run"]);
        fs::remove_file(place.path(&name)).unwrap();
        place.refuse(1, &longer, &[&name, "No such file"]);
        fs::remove_dir_all(place.path("again")).unwrap();
    }
    place.copy("run", "again");
    let whole = place.read("again/config.toml");
    place.write("again/config.toml", &whole[..whole.len() / 2]);
    place.refuse(1, &longer, &["again/config.toml"]);
}
