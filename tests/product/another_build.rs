//! Another build of the program: what computes decides whether runs go on with it. And what `run.json` tells of a build.

use crate::common::{Place, SMALL, config, messages, small_run};
use serde_json::Value;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output, Stdio};

/// Interrupted runs: they are begun for so many steps.
const SHORT: &str = "400";

/// An experiment of one small run.
fn experiment(place: &Place) {
    place.write("small.toml", fs::read(config("reacher")).unwrap());
    let mut text = String::from("configs = [\"small.toml\"]\nseeds = [0]\n[settings]\n");
    for setting in SMALL {
        let (key, value) = setting.split_once('=').unwrap();
        text += &format!("\"{key}\" = {value}\n");
    }
    text += "[variants.td3]\nmethod = \"td3\"\n";
    place.write("one.toml", text);
}

/// A program of these bytes in `place`.
fn install(place: &Place, name: &str, bytes: &[u8]) {
    place.write(name, bytes);
    fs::set_permissions(place.path(name), fs::Permissions::from_mode(0o755)).unwrap();
}

/// This build, made of the same sources once more: its file differs.
fn rebuilt() -> Vec<u8> {
    let mut bytes = fs::read(env!("CARGO_BIN_EXE_mamf")).unwrap();
    bytes.extend(b"built later");
    bytes
}

/// This build as if other sources had been compiled, of which it holds a checksum.
fn of_other_sources(computes: &str) -> Vec<u8> {
    let mut bytes = fs::read(env!("CARGO_BIN_EXE_mamf")).unwrap();
    let places: Vec<usize> = (0..bytes.len() - computes.len())
        .filter(|i| &bytes[*i..][..computes.len()] == computes.as_bytes())
        .collect();
    assert!(
        !places.is_empty(),
        "the program holds what it computes with"
    );
    for place in places {
        bytes[place..][..computes.len()].copy_from_slice(b"0123456789abcdef");
    }
    bytes
}

fn run(place: &Place, program: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(place.path(program));
    command.args(arguments).current_dir(place.path(""));
    command.stdin(Stdio::null()).output().unwrap()
}

fn computes(place: &Place, run: &str) -> String {
    let json: Value = serde_json::from_str(&place.read(&format!("{run}/run.json"))).unwrap();
    json["computes"].as_str().unwrap().to_owned()
}

#[test]
fn a_run_tells_of_its_build_and_its_machine() {
    let place = Place::new();
    place.succeed(&small_run("reacher", "run", &["method=td3"]));
    let json: Value = serde_json::from_str(&place.read("run/run.json")).unwrap();
    for (key, is_hex) in [
        ("program", true),
        ("computes", true),
        ("instruction_set", false),
    ] {
        let value = json[key]
            .as_str()
            .unwrap_or_else(|| panic!("{key}: {json}"));
        assert!(
            !value.is_empty() && (!is_hex || value.len() == 16),
            "{key}: {value}"
        );
    }
    // Where git knows the sources.
    assert_eq!(
        json["dirty"].is_boolean(),
        json["commit"].is_string(),
        "{json}"
    );
}

#[test]
fn an_interrupted_sweep_outlives_a_rebuild_but_no_change_of_what_computes_unless_told() {
    let place = Place::new();
    experiment(&place);
    let sweep = |program: &str, more: &[&str]| {
        run(&place, program, &[&["sweep", "one.toml"], more].concat())
    };
    install(
        &place,
        "first",
        &fs::read(env!("CARGO_BIN_EXE_mamf")).unwrap(),
    );
    let output = sweep("first", &["--steps", SHORT]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");

    install(&place, "rebuilt", &rebuilt());
    let output = sweep("rebuilt", &["--steps", "450"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");

    let computes = computes(&place, "runs/one/small/td3/seed-0");
    install(&place, "other", &of_other_sources(&computes));
    let output = sweep("other", &["--steps", "500"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = messages(&output);
    for part in [
        "something has changed since the checkpoint",
        "--accept-program",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let output = sweep("other", &["--steps", "500", "--accept-program"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let json = place.read("runs/one/small/td3/seed-0/run.json");
    assert!(
        json.contains("0123456789abcdef"),
        "the other build is told: {json}"
    );
}

#[test]
fn where_threads_can_not_be_started_nothing_is_written() {
    // Only a user without privileges is held to the limit.
    let limited = |place: &Place, arguments: &[String]| {
        let mut command = Command::new("setpriv");
        command.args([
            "--reuid",
            "64999",
            "--clear-groups",
            "bash",
            "-c",
            "ulimit -u 1; exec \"$@\"",
            "bash",
        ]);
        command
            .arg(place.path("mamf"))
            .args(arguments)
            .current_dir(place.path(""));
        command.stdin(Stdio::null()).output()
    };
    let place = Place::new();
    install(
        &place,
        "mamf",
        &fs::read(env!("CARGO_BIN_EXE_mamf")).unwrap(),
    );
    place.write("reacher.toml", fs::read(config("reacher")).unwrap());
    fs::set_permissions(place.path(""), fs::Permissions::from_mode(0o777)).unwrap();
    let mut arguments = small_run("reacher", "run", &[]);
    arguments[2] = "reacher.toml".into();
    let help = limited(&place, &["--version".into()]);
    if !help.is_ok_and(|output| output.status.success()) {
        crate::common::skipped("no setpriv, or no right to become another user");
        return;
    }
    let output = limited(&place, &arguments).unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = messages(&output);
    assert!(said.contains("can't be started"), "{said}");
    assert!(!place.path("run").exists());
}

#[test]
fn a_sweep_says_what_its_runs_take_together() {
    let place = Place::new();
    experiment(&place);
    let output = place.run(&["sweep", "one.toml"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = crate::common::stderr(&output);
    let line = said
        .lines()
        .find(|line| line.starts_with("memory: "))
        .unwrap();
    assert!(
        line.contains("for 1 at a time") && line.contains("to spare"),
        "{line}"
    );
    // Nothing is left to be made.
    let output = place.run(&["sweep", "one.toml"]);
    assert!(
        !crate::common::stderr(&output).contains("memory: "),
        "{output:?}"
    );
}
