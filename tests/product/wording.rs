//! What is said once, and clearly: missing folders, files of other editors, values that need quotes, paths that are relative.

use crate::common::{Place, config, messages, small_run};
use std::fs;

const ROLLOUTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/rollouts");

/// `text` as editors may save it.
fn encodings(text: &str) -> Vec<Vec<u8>> {
    let mut marked = vec![0xEF, 0xBB, 0xBF];
    marked.extend(text.bytes());
    let units = || std::iter::once(0xFEFF).chain(text.encode_utf16());
    vec![
        marked,
        units().flat_map(u16::to_le_bytes).collect(),
        units().flat_map(u16::to_be_bytes).collect(),
    ]
}

#[test]
fn toml_and_json_are_read_however_they_were_saved() {
    let place = Place::new();
    let small = fs::read_to_string(config("inverted_pendulum")).unwrap();
    let settings = fs::read_to_string(format!("{ROLLOUTS}/Hopper.json")).unwrap();
    let experiment = "configs = [\"c.toml\"]\nseeds = [0]\n[variants]\na = { method = \"td3\" }\n";
    fs::create_dir(place.path("rollouts")).unwrap();
    fs::copy(
        format!("{ROLLOUTS}/Hopper.npz"),
        place.path("rollouts/Hopper.npz"),
    )
    .unwrap();
    let encoded = encodings(&small).into_iter().zip(encodings(&settings));
    let encoded = encoded.zip(encodings(experiment)).enumerate();
    for (number, ((small, settings), experiment)) in encoded {
        place.write("c.toml", small);
        place.write("rollouts/Hopper.json", settings);
        place.write("e.toml", experiment);
        let out = format!("run-{number}");
        let mut arguments = small_run("inverted_pendulum", &out, &[]);
        arguments[2] = "c.toml".into();
        place.succeed(&arguments);
        place.succeed(&["verify", "rollouts"]);
        place.succeed(&["demo", "info", "rollouts"]);
        place.succeed(&["sweep", "e.toml", "--dry-run"]);
    }
    place.write("c.toml", b"task = \"Reacher-v4\xff\"\n");
    place.refuse(
        2,
        &["train", "--config", "c.toml"],
        &["c.toml", "UTF-8", "byte 18"],
    );
}

#[test]
fn a_missing_folder_is_named_and_no_temporary_file() {
    let place = Place::new();
    place.train("inverted_pendulum", "run", &[]);
    let csv = ["eval", "--checkpoint", "run", "--csv", "none/x.csv"];
    place.refuse(2, &csv, &["--csv none/x.csv", "there is no folder none"]);
    let output = place.run(&["render", "--task", "Hopper-v4", "--out", "none/x.gif"]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let said = messages(&output);
    assert!(!said.contains(".tmp"), "{said}");
    place.write("taken.csv", "");
    let taken = ["eval", "--checkpoint", "run", "--csv", "taken.csv"];
    place.refuse(2, &taken, &["taken.csv: exists already"]);
}

#[test]
fn nothing_is_said_twice() {
    let place = Place::new();
    fs::create_dir(place.path("folder.npz")).unwrap();
    fs::create_dir(place.path("folder.toml")).unwrap();
    place.write("broken.npz", "no archive");
    place.write("broken.json", "{ \"env\": 3 }");
    place.write("folder.json", "{ \"env\": \"Hopper-v4\" }");
    place.train("inverted_pendulum", "run", &[]);
    place.write("run/checkpoints/best/checkpoint.json", "{}");
    for arguments in [
        &["render", "--demonstration", "broken.npz", "--out", "x.gif"][..],
        &["render", "--demonstration", "folder.npz", "--out", "x.gif"],
        &["demo", "info", "broken.npz"],
        &["demo", "info", "none/*.npz"],
        &["demo", "info", "[.npz"],
        &["train", "--config", "folder.toml"],
        &["sweep", "folder.toml"],
        &["eval", "--checkpoint", "run/checkpoints/best"],
        &["verify", "none"],
        &["compare", "none", "run"],
        &["curves", "run", "--reference", "broken.json"],
    ] {
        let output = place.run(arguments);
        assert!(!output.status.success(), "{arguments:?}");
        let said = messages(&output);
        assert!(
            said.starts_with("error: ")
                // The place in a file is shown below.
                && (said.lines().count() == 1 || said.contains("TOML parse error")),
            "{said}"
        );
        let parts: Vec<&str> = said.trim().split(": ").collect();
        for (i, part) in parts.iter().enumerate() {
            assert!(
                part.len() < 4 || !parts[..i].contains(part),
                "`{part}` twice: {said}"
            );
        }
    }
}

#[test]
fn values_that_look_like_something_else_say_how_they_are_quoted() {
    let place = Place::new();
    let file = config("reacher");
    for (value, kind) in [
        ("2024-01-01", "datetime"),
        ("7", "integer"),
        ("true", "boolean"),
        ("1e3", "float"),
    ] {
        let set = format!("demonstrations.path={value}");
        let quoted = format!("--set 'demonstrations.path=\"{value}\"'");
        place.refuse(
            2,
            &["train", "--config", &file, "--set", &set],
            &[kind, &quoted],
        );
        // As it says.
        let set = format!("demonstrations.path=\"{value}\"");
        let nothing = format!("nothing matches `{value}`");
        place.refuse(2, &["train", "--config", &file, "--set", &set], &[&nothing]);
    }
    place.refuse(
        2,
        &["train", "--config", &file, "--set", "task=4"],
        &["--set 'task=\"4\"'"],
    );
}

#[test]
fn relative_demonstrations_are_said_to_be_relative_to_where_one_is() {
    let place = Place::new();
    fs::create_dir(place.path("demos")).unwrap();
    for file in ["PenSpin.npz", "PenSpin.json"] {
        fs::copy(
            format!("{ROLLOUTS}/{file}"),
            place.path(&format!("demos/{file}")),
        )
        .unwrap();
    }
    let settings = [
        "steps=60",
        "random_steps=40",
        "model_start=20",
        "demonstrations.path=demos",
    ];
    let output = place.run(&small_run("pen_spin", "run", &settings));
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    fs::create_dir(place.path("elsewhere")).unwrap();
    let mut command = place.command(&["train", "--resume", "../run", "--steps", "80"]);
    let output = command
        .current_dir(place.path("elsewhere"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let said = messages(&output);
    assert!(
        said.contains("relative to the working directory") && said.contains("elsewhere"),
        "{said}"
    );
}

#[test]
fn a_run_without_checkpoints_is_said_to_have_none() {
    let place = Place::new();
    place.train("inverted_pendulum", "run", &[]);
    for name in ["last", "previous", "best"] {
        fs::remove_dir_all(place.path("run/checkpoints").join(name)).unwrap();
    }
    let eval = ["eval", "--checkpoint", "run"];
    place.refuse(2, &eval, &["run: this run has no checkpoint"]);
    place.refuse(
        2,
        &["render", "--checkpoint", "run", "--out", "x.gif"],
        &["no checkpoint"],
    );
    fs::remove_dir_all(place.path("run/checkpoints")).unwrap();
    place.refuse(2, &eval, &["run: this run has no checkpoint"]);
}

#[test]
fn exit_codes_are_those_of_the_help() {
    let place = Place::new();
    place.write("broken.npz", "no archive");
    place.write("broken.json", "{ \"env\": \"Hopper-v4\" }");
    place.train("inverted_pendulum", "run", &[]);
    let file = config("inverted_pendulum");
    for (code, arguments) in [
        // Nothing there, or nothing of the kind: wrong usage.
        (2, &["train", "--config", "none.toml"][..]),
        (2, &["train", "--resume", "none"]),
        (2, &["train", "--config", &file, "--out", "run"]),
        (2, &["eval", "--checkpoint", "none"]),
        (2, &["render", "--checkpoint", "none", "--out", "x.gif"]),
        (
            2,
            &["render", "--demonstration", "none.npz", "--out", "x.gif"],
        ),
        (2, &["render", "--task", "None-v0", "--out", "x.gif"]),
        (2, &["demo", "record", "--checkpoint", "none", "--out", "x"]),
        (2, &["demo", "info", "none"]),
        (2, &["demo", "replay", "none"]),
        (2, &["verify", "none"]),
        (2, &["sweep", "none.toml"]),
        (2, &["compare", "none", "run"]),
        (2, &["curves", "none"]),
        (2, &["curves", "run", "--reference", "none.toml"]),
        (2, &["settings", "none"]),
        (2, &["envs", "None-v0"]),
        (2, &["none"]),
        // There, and damaged.
        (
            1,
            &["render", "--demonstration", "broken.npz", "--out", "x.gif"],
        ),
        (1, &["demo", "info", "broken.npz"]),
        (1, &["verify", "."]),
    ] {
        let output = place.run(arguments);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{arguments:?}: {output:?}"
        );
    }
}
