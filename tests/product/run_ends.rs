//! A run is evaluated at its end, says from the start what it will say, and begins in any folder that nobody else uses.

use crate::common::{Place, config, messages, small_run};
use std::fs;

/// The first column of a curve, its header left out.
fn steps_of(place: &Place, file: &str) -> Vec<String> {
    let text = place.read(file);
    let rows = text.lines().skip(1);
    rows.map(|row| row.split(',').next().unwrap().to_owned())
        .collect()
}

#[test]
fn the_last_part_of_a_run_is_evaluated_and_a_longer_run_is_as_if_it_had_not_been() {
    let place = Place::new();
    for saved in ["true", "false"] {
        let setting = format!("checkpoint.replay={saved}");
        let run = format!("replay-{saved}");
        place.train("reacher", &run, &["steps=250", &setting]);
        assert_eq!(
            steps_of(&place, &format!("{run}/eval.csv")),
            ["0", "100", "200", "250"]
        );
        assert_eq!(
            steps_of(&place, &format!("{run}/train.csv")),
            ["100", "200", "250"]
        );
        assert_eq!(
            steps_of(&place, &format!("{run}/timing.csv")),
            ["100", "200", "250"]
        );
    }
    place.train("reacher", "never", &["evaluation.every=1000"]);
    assert_eq!(steps_of(&place, "never/eval.csv"), ["0", "400"]);
    place.train("reacher", "several", &["environments=3", "steps=299"]);
    assert_eq!(
        steps_of(&place, "several/eval.csv"),
        ["0", "102", "200", "299"]
    );

    // Made longer, it has the bytes of one that was so long from the start.
    place.succeed(&["train", "--resume", "replay-true", "--steps", "390"]);
    place.train("reacher", "whole", &["steps=390"]);
    for file in [
        "eval.csv",
        "train.csv",
        "checkpoints/last/weights.safetensors",
    ] {
        let bytes = |run: &str| fs::read(place.path(run).join(file)).unwrap();
        assert!(bytes("whole") == bytes("replay-true"), "{file}");
    }
    assert_eq!(steps_of(&place, "whole/eval.csv").last().unwrap(), "390");
}

#[test]
fn a_run_that_was_killed_before_its_last_evaluation_makes_it() {
    let place = Place::new();
    place.train("reacher", "run", &["steps=250"]);
    place.copy("run", "whole");
    for file in ["eval.csv", "train.csv"] {
        let text = place.read(&format!("run/{file}"));
        let rows: Vec<&str> = text.lines().collect();
        // As a crash leaves it, half of the last row written.
        let last = rows[rows.len() - 1];
        let cut = format!(
            "{}\n{}",
            rows[..rows.len() - 1].join("\n"),
            &last[..last.len() / 2]
        );
        place.write(&format!("run/{file}"), cut);
    }
    place.succeed(&["train", "--resume", "run"]);
    for file in ["eval.csv", "train.csv"] {
        assert_eq!(
            place.read(&format!("run/{file}")),
            place.read(&format!("whole/{file}"))
        );
    }
    let said = place.succeed(&["train", "--resume", "run"]);
    assert!(said.starts_with("finished already, 250 steps"), "{said}");
}

#[test]
fn curves_have_their_headers_before_there_is_a_row() {
    let place = Place::new();
    place.train("reacher", "run", &[]);
    let train = place.read("run/train.csv");
    let header = train.lines().next().unwrap();
    assert!(header.starts_with("step,"), "{header}");
    let steps = [
        "steps=100000000",
        "evaluation.every=100000000",
        "evaluation.episodes=100000",
    ];
    let mut child = place
        .command(&small_run("reacher", "begun", &steps))
        .spawn()
        .unwrap();
    for _ in 0..600 {
        if fs::read_to_string(place.path("begun/timing.csv")).is_ok_and(|text| text.ends_with('\n'))
        {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(place.read("begun/train.csv"), format!("{header}\n"));
    for file in ["eval.csv", "timing.csv"] {
        assert!(
            place.read(&format!("begun/{file}")).starts_with("step,"),
            "{file}"
        );
    }
}

#[test]
fn curves_of_policies_that_were_not_trained_are_not_compared() {
    let place = Place::new();
    for (method, run) in [("mamf", "a"), ("td3", "b")] {
        let method = format!("method={method}");
        let output = place.run(&small_run("reacher", run, &["steps=150", &method]));
        assert!(messages(&output).contains("inside phase 1"), "{output:?}");
    }
    let parts = ["a/eval.csv", "untrained", "step 150 of 200"];
    place.refuse(2, &["compare", "a", "b"], &parts);
    place.refuse(2, &["compare", "--at-least", "-100", "a", "b"], &parts);
    for run in ["a", "b"] {
        place.succeed(&["train", "--resume", run, "--steps", "250"]);
    }
    place.succeed(&["compare", "a", "b"]);
}

#[test]
fn a_log_in_the_folder_is_no_obstacle_and_any_other_file_is_named() {
    let place = Place::new();
    fs::create_dir(place.path("run")).unwrap();
    let file = config("reacher");
    let line = format!("$mamf train --config {file} \"${{small[@]}}\" --out run >run/log 2>&1");
    let output = place.bash(&line);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(place.read("run/log").contains("finished: run"));

    for (folder, foreign) in [("a", "notes.txt"), ("b", "checkpoints"), ("c", ".hidden")] {
        fs::create_dir(place.path(folder)).unwrap();
        place.write(&format!("{folder}/{foreign}"), "");
        let arguments = small_run("reacher", folder, &[]);
        let named = format!("{folder}/{foreign}");
        place.refuse(2, &arguments, &[&named, "--out"]);
        let force = [arguments, vec!["--force".into()]].concat();
        place.refuse(2, &force, &[&named]);
    }
    // A log of a run before is somebody else's file as well.
    fs::create_dir(place.path("d")).unwrap();
    place.write("d/log", "of yesterday\n");
    place.refuse(2, &small_run("reacher", "d", &[]), &["d/log"]);
}

#[test]
fn a_dry_run_tells_of_what_is_in_the_way() {
    let place = Place::new();
    place.write("all.toml", "task = \"Reacher-v4\"\nsteps = 100\n");
    place.write(
        "experiment.toml",
        "configs = [\"all.toml\"]\nseeds = [0, 1, 2]\n[variants]\na = { method = \"td3\" }\n",
    );
    fs::create_dir_all(place.path("out/all/a/seed-0")).unwrap();
    place.write("out/all/a/seed-0/notes.txt", "");
    place.write("out/all/a/seed-1", "a file");
    let said = place.succeed(&["sweep", "experiment.toml", "--out", "out", "--dry-run"]);
    let lines: Vec<&str> = said.lines().collect();
    assert!(lines[0].contains("out/all/a/seed-0/notes.txt"), "{said}");
    assert!(
        lines[1].contains("in the way is out/all/a/seed-1"),
        "{said}"
    );
    assert!(lines[2].ends_with("to be begun"), "{said}");
}
