//! Commands that are interrupted leave nothing in the way of the same command.

use crate::common::{Place, config, messages, small_run};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

fn begin(place: &Place, arguments: &[&str]) -> Child {
    let mut command = place.command(arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    child.spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    let kill = format!("kill -{name} {}", child.id());
    let status = Command::new("sh").args(["-c", &kill]).status().unwrap();
    assert!(status.success());
}

/// Waits until `done`, for a minute at most.
fn wait_for(mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "it takes long");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Whether the process hears signals by itself: SIGTERM is one that it catches.
fn hears(child: &Child) -> bool {
    let status =
        std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> 14 & 1 == 1)
}

#[test]
fn an_evaluation_and_a_recording_leave_nothing_behind_at_any_signal() {
    let place = Place::new();
    place.train("hopper", "run", &[]);
    let evaluation = [
        "eval",
        "--checkpoint",
        "run",
        "--csv",
        "new.csv",
        "--episodes",
    ];
    let recording = [
        "demo",
        "record",
        "--checkpoint",
        "run",
        "--out",
        "new/set",
        "--episodes",
    ];
    let before = || {
        let mut contents = place.contents("");
        contents.retain(|path, _| !path.ends_with("new"));
        contents
    };
    let was = before();
    for (name, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let child = begin(&place, &[&evaluation[..], &["100000"]].concat());
        wait_for(|| hears(&child));
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        assert!(
            messages(&output).contains("nothing was written"),
            "{output:?}"
        );
        assert!(before() == was, "{name}");

        let child = begin(&place, &[&recording[..], &["9999"]].concat());
        wait_for(|| place.path("new/set/episode_0003.json").exists());
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        assert!(before() == was, "{name}");
    }
    place.succeed(&[&evaluation[..], &["3"]].concat());
    place.succeed(&[&recording[..], &["3"]].concat());
    assert_eq!(place.read("new.csv").lines().count(), 4);
    assert!(place.path("new/set/episode_0003.npz").exists());
}

#[test]
fn what_nohup_keeps_alive_stays_alive() {
    let place = Place::new();
    place.train("hopper", "run", &[]);
    let mut command = Command::new("nohup");
    command
        .arg(env!("CARGO_BIN_EXE_mamf"))
        .current_dir(place.path(""));
    command.args([
        "eval",
        "--checkpoint",
        "run",
        "--csv",
        "new.csv",
        "--episodes",
        "100000",
    ]);
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(|| hears(&child));
    signal(&child, "HUP");
    std::thread::sleep(Duration::from_millis(300));
    assert!(child.try_wait().unwrap().is_none());
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(143));
}

#[test]
fn a_pair_of_interrupts_as_timeout_sends_it_is_one() {
    let place = Place::new();
    for pause in ["", "sleep 0.02; "] {
        let arguments = small_run("hopper", "run", &["steps=100000000", "replay.capacity=500"]);
        let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let child = begin(&place, &words);
        wait_for(|| place.path("run/checkpoints/previous").exists());
        let pair = format!("kill -INT {0}; {pause}kill -INT {0}", child.id());
        Command::new("sh").args(["-c", &pair]).output().unwrap();
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        std::fs::remove_dir_all(place.path("run")).unwrap();
    }
    let file = config("hopper");
    let line = format!(
        "timeout -s INT 2 $mamf train --config {file} \"${{small[@]}}\" --set steps=100000000 \
         --set replay.capacity=500 --out timed; echo code $?"
    );
    let output = place.bash(&line);
    // What `timeout` says of a command that it had to end.
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("code 124"),
        "{output:?}"
    );
    assert!(
        messages(&output).contains("go on with --resume"),
        "{output:?}"
    );
}
