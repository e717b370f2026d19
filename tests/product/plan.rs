//! `mamf plan`: episodes are planned, kept or thrown away, and gone on with.

use crate::common::{Place, small_run, stderr};

const FEW: [&str; 6] = [
    "planner.samples=6",
    "planner.iterations=1",
    "planner.first_iterations=2",
    "planner.elites=2",
    "planner.horizon=5",
    "planner.policy_share=0.5",
];

/// Arguments of a small plan of a task whose episodes are short.
fn plan<'a>(out: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["plan", "--task", "InvertedPendulum-v4", "--out", out];
    for setting in FEW {
        arguments.extend(["--set", setting]);
    }
    arguments.extend(rest);
    arguments
}

/// `plan.csv` without the wall-clock times.
fn rows(place: &Place, out: &str) -> Vec<String> {
    let text = place.read(&format!("{out}/plan.csv"));
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        [&fields[..5], &fields[6..]].concat().join(",")
    };
    text.lines().map(row).collect()
}

#[test]
fn planned_episodes_are_recordings_and_a_resumed_plan_is_the_whole_one() {
    let place = Place::new();
    let said = place.succeed(&plan("whole", &["--episodes", "3", "--threads", "1"]));
    assert!(said.contains("3 of 3 episodes kept"), "{said}");
    place.succeed(&plan("parts", &["--episodes", "1", "--threads", "2"]));
    // As an interruption leaves it: an episode that has no row yet.
    for ending in ["npz", "json"] {
        place.write(&format!("parts/episode_0002.{ending}"), "half");
    }
    let resumed = place.run(&plan("parts", &["--episodes", "3", "--resume"]));
    assert_eq!(resumed.status.code(), Some(0), "{resumed:?}");
    assert!(stderr(&resumed).contains("1 episodes are planned already"));
    assert_eq!(rows(&place, "whole"), rows(&place, "parts"));
    for episode in 1..=3 {
        let name = |out: &str| format!("{out}/episode_000{episode}.npz");
        let bytes = |out: &str| std::fs::read(place.path(&name(out))).unwrap();
        assert_eq!(bytes("whole"), bytes("parts"), "{episode}");
    }
    let info = place.succeed(&["demo", "info", "whole"]);
    assert!(info.contains("planned (icem)"), "{info}");
    place.succeed(&["demo", "replay", "whole"]);
    let trained = place.run(&small_run(
        "inverted_pendulum",
        "run",
        &["demonstrations.path=whole"],
    ));
    assert_eq!(trained.status.code(), Some(0), "{trained:?}");
}

#[test]
fn a_plan_goes_on_only_as_it_was_and_with_all_that_it_kept() {
    let place = Place::new();
    place.succeed(&plan("whole", &["--episodes", "3"]));
    let refuse = |code, name: &str, change: &dyn Fn(&Place), more: &[&str], parts: &[&str]| {
        place.copy("whole", name);
        change(&place);
        let more = [&["--episodes", "4", "--resume"], more].concat();
        place.refuse(code, &plan(name, &more), parts);
    };
    let remove =
        |path: &'static str| move |place: &Place| std::fs::remove_file(place.path(path)).unwrap();
    let write =
        |path: &'static str, text: &'static str| move |place: &Place| place.write(path, text);
    refuse(
        1,
        "a",
        &remove("a/episode_0002.npz"),
        &[],
        &["a/episode_0002.npz", "not there"],
    );
    refuse(
        1,
        "b",
        &remove("b/plan.csv"),
        &[],
        &["b/plan.csv", "more recordings"],
    );
    refuse(
        1,
        "c",
        &write("c/plan.csv", ""),
        &[],
        &["c/plan.csv", "no table"],
    );
    refuse(
        1,
        "d",
        &write("d/plan.csv", "a,b\n"),
        &[],
        &["d/plan.csv", "no table"],
    );
    refuse(
        1,
        "e",
        &write("e/plan.toml", "x = [\n"),
        &[],
        &["e/plan.toml", "TOML"],
    );
    let keep = ["--keep", "return > 3"];
    refuse(2, "f", &|_| (), &keep, &["keep = return > 3"]);
}

#[test]
fn a_checkpoint_proposes_and_judges() {
    let place = Place::new();
    place.train("inverted_pendulum", "run", &[]);
    place.succeed(&plan("with", &["--checkpoint", "run"]));
    let judged = rows(&place, "with");
    place.succeed(&plan(
        "proposed",
        &[
            "--checkpoint",
            "run",
            "--set",
            "planner.terminal_value=false",
        ],
    ));
    place.succeed(&plan("without", &[]));
    assert_ne!(judged, rows(&place, "without"));
    let name = "with/episode_0001.json";
    assert!(
        place.read(name).contains("after 400 steps"),
        "{}",
        place.read(name)
    );
    place.refuse(
        2,
        &[
            "plan",
            "--task",
            "Hopper-v4",
            "--out",
            "other",
            "--checkpoint",
            "run",
        ],
        &["Hopper-v4", "InvertedPendulum-v4"],
    );
}

#[test]
fn the_planner_is_evaluated_as_a_policy_is() {
    let place = Place::new();
    place.train("inverted_pendulum", "run", &[]);
    place.succeed(&plan("plans", &["--episodes", "2", "--seed", "7"]));
    place.succeed(&plan(
        "taught",
        &["--episodes", "2", "--seed", "7", "--checkpoint", "run"],
    ));
    let returns = |table: &str| -> Vec<String> {
        let text = place.read(table);
        let fields = text.lines().skip(1).map(|line| line.split(',').nth(1));
        fields.map(|field| field.unwrap().to_owned()).collect()
    };
    let eval = |csv: &str, more: &[&str]| {
        let options = ["--episodes", "2", "--seed", "7", "--csv", csv];
        place.succeed(
            &[
                &["eval", "--planner", "plans/plan.toml"],
                &options[..],
                more,
            ]
            .concat(),
        )
    };
    // The same episodes, planned in the same way.
    let said = eval("plain.csv", &[]);
    assert!(
        said.starts_with("InvertedPendulum-v4, planned (icem)\n"),
        "{said}"
    );
    assert_eq!(returns("plain.csv"), returns("plans/plan.csv"));
    let said = eval("with.csv", &["--checkpoint", "run"]);
    assert!(
        said.contains("planned (icem) with mamf after 400 steps"),
        "{said}"
    );
    assert_eq!(returns("with.csv"), returns("taught/plan.csv"));
    assert_ne!(returns("plain.csv"), returns("with.csv"));

    place.write(
        "few.toml",
        "[planner]\nsamples = 4\nelites = 2\nhorizon = 3\n",
    );
    place.write("other.toml", "task = \"Hopper-v4\"\n");
    let task = ["--task", "InvertedPendulum-v4", "--episodes", "1"];
    place.succeed(&[&["eval", "--planner", "few.toml"], &task[..]].concat());
    place.refuse(
        2,
        &["eval", "--planner", "few.toml"],
        &["few.toml", "`task`"],
    );
    place.refuse(2, &["eval"], &["--checkpoint"]);
    place.refuse(2, &["eval", "--planner", "nowhere.toml"], &["nowhere.toml"]);
    let other = ["eval", "--planner", "other.toml", "--checkpoint", "run"];
    place.refuse(
        2,
        &other,
        &["other.toml", "Hopper-v4", "InvertedPendulum-v4"],
    );
}

#[test]
fn what_is_not_worth_keeping_is_thrown_away_and_nothing_kept_is_a_failure() {
    let place = Place::new();
    let keep = ["--episodes", "2", "--keep", "return > 1e6"];
    let output = place.run(&plan("none", &keep));
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(stderr(&output).contains("no episode was worth keeping"));
    assert_eq!(rows(&place, "none").len(), 3);
    assert!(!place.path("none/episode_0001.npz").exists());
    place.refuse(
        2,
        &plan("x", &["--keep", "success"]),
        &["--keep success", "knows no success"],
    );
}

#[test]
fn plans_that_make_no_sense_are_refused_and_nothing_is_written() {
    let place = Place::new();
    let refuse = |rest: &[&str], parts: &[&str]| place.refuse(2, &plan("out", rest), parts);
    refuse(
        &["--set", "planner.horizon=0"],
        &["planner.horizon", "from 1 to 1000"],
    );
    refuse(
        &["--set", "planner.samples=1"],
        &["planner.samples", "from 2 to"],
    );
    refuse(
        &["--set", "planner.elites=60"],
        &["planner.elites", "60", "planner.samples"],
    );
    refuse(
        &[
            "--set",
            "planner.method=sampling",
            "--set",
            "planner.knots=9",
        ],
        &["planner.knots", "9", "planner.horizon"],
    );
    place.refuse(
        2,
        &["plan", "--task", "Nowhere-v1", "--out", "out"],
        &["Nowhere-v1"],
    );
    refuse(&["--resume"], &["plan.toml", "out"]);
    refuse(
        &[
            "--set",
            "doubled_actions.period=3",
            "--set",
            "action_coupling=1",
        ],
        &["doubled_actions"],
    );
    place.succeed(&plan("out", &[]));
    refuse(&[], &["--out out", "not empty", "--resume"]);
    refuse(
        &["--resume", "--set", "planner.noise=0.3"],
        &["planner.noise", "0.5", "0.3"],
    );
    refuse(&["--resume", "--seed", "4"], &["seed = 0", "seed = 4"]);
}
