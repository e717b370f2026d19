//! File systems as they are: layers that rename no directory, limits on the size of files, files of somebody else.

use crate::common::{Place, SMALL, config, messages, skipped, small_run};
use std::fs;
use std::process::Command;

/// A layer over a folder, as containers have it, until it is dropped.
struct Overlay(String);

impl Overlay {
    fn over(place: &Place, lower: &str, merged: &str) -> Option<Overlay> {
        for folder in [merged, "upper", "work"] {
            fs::create_dir(place.path(folder)).unwrap();
        }
        let path = |name: &str| place.path(name).to_str().unwrap().to_owned();
        let layers = format!(
            "lowerdir={},upperdir={},workdir={}",
            path(lower),
            path("upper"),
            path("work")
        );
        let mut mount = Command::new("mount");
        mount.args(["-t", "overlay", "overlay", "-o", &layers, &path(merged)]);
        let mounted = mount.output().is_ok_and(|output| output.status.success());
        mounted.then(|| Overlay(path(merged)))
    }
}

impl Drop for Overlay {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_run_in_a_lower_layer_goes_on() {
    let place = Place::new();
    place.train("inverted_pendulum", "image/run", &[]);
    place.copy("image", "whole");
    let Some(_overlay) = Overlay::over(&place, "image", "merged") else {
        return skipped("no overlayfs can be mounted here");
    };
    for out in ["whole/run", "merged/run"] {
        for steps in ["500", "700"] {
            place.succeed(&["train", "--resume", out, "--steps", steps]);
        }
    }
    for file in [
        "train.csv",
        "eval.csv",
        "checkpoints/last/weights.safetensors",
    ] {
        let bytes = |run: &str| fs::read(place.path(run).join(file)).unwrap();
        assert_eq!(bytes("whole/run"), bytes("merged/run"), "{file}");
    }
    let names = |run: &str| -> Vec<_> {
        let contents = place.contents(run);
        let root = place.path(run);
        let relative = contents
            .keys()
            .map(|path| path.strip_prefix(&root).unwrap().to_owned());
        relative.collect()
    };
    assert_eq!(names("whole/run"), names("merged/run"));
    let anew = [
        small_run("reacher", "merged/run", &[]),
        vec!["--force".into()],
    ]
    .concat();
    place.succeed(&anew);
}

#[test]
fn a_limit_on_the_size_of_files_is_an_error_that_is_told() {
    let place = Place::new();
    let small: Vec<String> = SMALL.iter().map(|set| format!("--set '{set}'")).collect();
    let file = config("inverted_pendulum");
    let line = format!(
        "ulimit -f 24; $mamf train --config {file} {} --out run",
        small.join(" ")
    );
    let output = place.bash(&line);
    let said = messages(&output);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(
        said.starts_with("error: run/") && said.contains("ulimit -f"),
        "{said}"
    );
    assert!(said.contains("checkpoint"), "{said}");
}

#[test]
fn what_somebody_else_put_into_a_run_stays() {
    let place = Place::new();
    place.train("inverted_pendulum", "run", &[]);
    let others = [
        "run/notes.txt",
        "run/checkpoints/notes.txt",
        "run/checkpoints/replay/notes.txt",
    ];
    for other in others {
        place.write(other, "mine");
    }
    place.write("run/checkpoints/previous/notes.txt", "mine");
    place.succeed(&["train", "--resume", "run"]);
    place.succeed(&["train", "--resume", "run", "--steps", "700"]);
    let force = [
        small_run("inverted_pendulum", "run", &[]),
        vec!["--force".into()],
    ]
    .concat();
    place.succeed(&force);
    for other in others {
        assert_eq!(place.read(other), "mine", "{other}");
    }
    let kept = place.contents("run/checkpoints");
    let notes = kept.keys().filter(|path| path.ends_with("notes.txt"));
    assert_eq!(notes.count(), 3, "{:?}", kept.keys());
    // What lies in a checkpoint is not read by anybody but by name.
    place.succeed(&["eval", "--checkpoint", "run", "--episodes", "1"]);
}
