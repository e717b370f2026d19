//! `mamf sweep`, end to end.

use crate::common::{Place, SMALL, config, messages, stderr};
use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// An experiment of four small runs: two variants and two seeds of one configuration.
fn experiment(place: &Place) {
    place.write("small.toml", fs::read(config("reacher")).unwrap());
    let mut text = String::from("configs = [\"small.toml\"]\nseeds = [0, 1]\n[settings]\n");
    for setting in SMALL {
        let (key, value) = setting.split_once('=').unwrap();
        text += &format!("\"{key}\" = {value}\n");
    }
    text += "[variants.mamf]\nmethod = \"mamf\"\n[variants.td3]\nmethod = \"td3\"\n";
    place.write("four.toml", text);
}

const RUNS: [&str; 4] = ["mamf/seed-0", "mamf/seed-1", "td3/seed-0", "td3/seed-1"];

fn eval_of(place: &Place, out: &str, run: &str) -> String {
    place.read(&format!("{out}/small/{run}/eval.csv"))
}

#[test]
fn all_runs_are_made_and_made_only_once() {
    let place = Place::new();
    experiment(&place);
    let listed = place.succeed(&["sweep", "four.toml", "--dry-run"]);
    assert_eq!(listed.lines().count(), 4);
    for (index, (line, run)) in listed.lines().zip(RUNS).enumerate() {
        assert!(
            line.starts_with(&format!("   {index}  small/{run}  ")),
            "{line}"
        );
        assert!(line.ends_with("400 steps  to be begun"), "{line}");
    }
    assert!(!place.path("runs").exists(), "a dry run makes nothing");

    let output = place.run(&["sweep", "four.toml", "--jobs", "2"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(output.stdout, b"4 of 4 runs finished: runs/four\n");
    let said = stderr(&output);
    for run in RUNS {
        assert!(said.contains(&format!("small/{run}: began\n")), "{said}");
        let curve = eval_of(&place, "runs/four", run);
        let last: f64 = curve
            .lines()
            .last()
            .unwrap()
            .split(',')
            .nth(2)
            .unwrap()
            .parse()
            .unwrap();
        let told = format!("small/{run}: finished, return {last:.1}  ");
        assert!(said.contains(&told), "{told}: {said}");
        assert!(
            place
                .read(&format!("runs/four/small/{run}.log"))
                .contains("finished:")
        );
    }
    // The same run as `mamf train` makes of the same words.
    let mut alone: Vec<String> = ["train", "--config", "small.toml", "--out", "alone"]
        .map(Into::into)
        .into();
    for setting in SMALL.iter().chain(&["method=td3", "seed=1"]) {
        alone.extend(["--set".into(), (*setting).into()]);
    }
    place.succeed(&alone);
    assert_eq!(
        eval_of(&place, "runs/four", "td3/seed-1"),
        place.read("alone/eval.csv")
    );

    let before = place.contents("runs");
    let output = place.run(&["sweep", "four.toml"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(!stderr(&output).contains("began"), "{output:?}");
    assert!(place.contents("runs") == before);
    let listed = place.succeed(&["sweep", "four.toml", "--dry-run", "--steps", "430"]);
    assert!(
        listed
            .lines()
            .all(|line| line.ends_with("to go on from step 400")),
        "{listed}"
    );
}

#[test]
fn one_run_can_be_picked_by_its_number() {
    let place = Place::new();
    experiment(&place);
    let one = ["sweep", "four.toml", "--task-index", "2", "--out", "here"];
    let output = place.run(&one);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(output.stdout, b"1 of 1 runs finished: here\n");
    assert!(place.path("here/small/td3/seed-0/eval.csv").exists());
    assert!(!place.path("here/small/td3/seed-1").exists());
    place.refuse(
        2,
        &["sweep", "four.toml", "--task-index", "4"],
        &["--task-index 4", "4 runs, 0 to 3"],
    );
}

#[cfg(unix)]
#[test]
fn an_interrupted_sweep_goes_on_to_the_same_bytes() {
    let place = Place::new();
    experiment(&place);
    let whole = place.run(&["sweep", "four.toml", "--out", "whole", "--steps", "1500"]);
    assert_eq!(whole.status.code(), Some(0), "{whole:?}");
    let arguments = ["sweep", "four.toml", "--jobs", "2", "--steps", "1500"];
    let mut command = place.command(&arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = child.spawn().unwrap();
    let started = Instant::now();
    while !place.path("runs/four/small/mamf/seed-0/eval.csv").exists() {
        assert!(started.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(5));
    }
    let kill = format!("kill -INT {}", child.id());
    assert!(
        Command::new("sh")
            .args(["-c", &kill])
            .status()
            .unwrap()
            .success()
    );
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(75), "{output:?}");
    let said = messages(&output);
    assert!(said.contains("the same command goes on"), "{said}");

    let output = place.run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    for run in RUNS {
        let expected = eval_of(&place, "whole", run);
        assert_eq!(eval_of(&place, "runs/four", run), expected, "{run}");
    }
}

#[test]
fn failed_runs_are_named_and_the_others_made() {
    let place = Place::new();
    experiment(&place);
    // A run of other settings in the place of one, and a file in that of another.
    let other = [
        "sweep",
        "four.toml",
        "--task-index",
        "0",
        "--set",
        "discount=0.5",
    ];
    assert_eq!(place.run(&other).status.code(), Some(0));
    fs::create_dir_all(place.path("runs/four/small/td3")).unwrap();
    place.write("runs/four/small/td3/seed-1", "in the way");
    let output = place.run(&["sweep", "four.toml"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert_eq!(output.stdout, b"2 of 4 runs finished: runs/four\n");
    let said = stderr(&output);
    assert!(said.contains("failed: small/mamf/seed-0: "), "{said}");
    assert!(said.contains("`discount` is 0.5, not 0.98"), "{said}");
    assert!(said.contains("failed: small/td3/seed-1: "), "{said}");
    let way = "in the way is runs/four/small/td3/seed-1";
    assert!(said.contains(way), "{said}");
}

#[test]
fn experiments_that_are_wrong_are_refused() {
    let place = Place::new();
    experiment(&place);
    let good = place.read("four.toml");
    for (from, to, parts) in [
        ("seeds", "seed", ["unknown field", "`seed`"]),
        (
            "small.toml",
            "smal.toml",
            ["smal.toml", "relative to the experiment"],
        ),
        ("[variants.td3]", "[variants.mamf]", ["line", "duplicate"]),
    ] {
        let text = good.replacen(from, to, 1);
        if text == good {
            continue;
        }
        place.write("wrong.toml", text);
        let parts = [&parts[..], &["wrong.toml"]].concat();
        place.refuse(2, &["sweep", "wrong.toml"], &parts);
    }
    place.refuse(2, &["sweep", "none.toml"], &["none.toml", "No such file"]);
    place.refuse(
        2,
        &["sweep", "four.toml", "--set", "batchsize=3"],
        &["`batch_size`"],
    );
    place.refuse(2, &["sweep", "four.toml", "--jobs", "0"], &["--jobs"]);
}
