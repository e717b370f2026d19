//! Paths are bytes: folders of any name, in every verb and every script.

use crate::common::{Place, SMALL, config, stderr};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Names of folders, with what is special to some program.
fn names() -> Vec<OsString> {
    let mut names: Vec<OsString> = ["[1]", "a $b*", "c:d", "-x", "two\nlines", "'\"\\", "{}%"]
        .map(OsString::from)
        .into();
    names.push(OsStr::from_bytes(b"x\xff").to_owned());
    names
}

/// Runs the program in `folder`; no word of it may be text.
fn run(folder: &Path, program: &Path, words: &[&OsStr]) -> Output {
    let output = Command::new(program)
        .args(words)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert!(
        !stderr(&output).contains("panicked"),
        "{words:?}: {output:?}"
    );
    output
}

/// Words of one kind, whatever they were.
fn words<'a>(plain: &'a [&'a str]) -> Vec<&'a OsStr> {
    plain.iter().map(OsStr::new).collect()
}

/// `option=path/more`, in one word.
fn with(option: &str, path: &OsStr, more: &str) -> OsString {
    let mut word = OsString::from(option);
    word.push(path);
    word.push(more);
    word
}

#[test]
fn every_verb_takes_folders_of_any_name() {
    let mamf = Path::new(env!("CARGO_BIN_EXE_mamf"));
    for name in names() {
        let place = Place::new();
        let folder = place.path("");
        fs::create_dir(folder.join(&name)).unwrap();
        let small: Vec<&str> = SMALL.iter().flat_map(|set| ["--set", set]).collect();
        let succeed = |arguments: Vec<&OsStr>| {
            let output = run(&folder, mamf, &arguments);
            assert_eq!(output.status.code(), Some(0), "{arguments:?}: {output:?}");
            output
        };
        let here = config("inverted_pendulum");
        fs::copy(&here, folder.join(&name).join("c.toml")).unwrap();
        let (file, out) = (
            with("--config=", &name, "/c.toml"),
            with("--out=", &name, "/runs/mamf/seed-0"),
        );
        succeed([vec![OsStr::new("train"), &file, &out], words(&small)].concat());
        let run_of = with("", &name, "/runs/mamf/seed-0");
        let resume = with("--resume=", &run_of, "");
        succeed(vec![
            OsStr::new("train"),
            &resume,
            OsStr::new("--steps=450"),
        ]);
        let again = [
            vec![OsStr::new("train"), OsStr::new("--force"), &file, &out],
            words(&small),
        ];
        succeed(again.concat());
        let other = with("--out=", &name, "/runs/td3/seed-0");
        let td3 = [
            vec![OsStr::new("train"), &file, &other],
            words(&small),
            words(&["--set", "method=td3"]),
        ];
        succeed(td3.concat());

        let checkpoint = with("--checkpoint=", &run_of, "");
        let csv = with("--csv=", &name, "/episodes.csv");
        succeed(vec![OsStr::new("eval"), &checkpoint, &csv]);
        let recorded = with("--out=", &name, "/recorded");
        succeed(vec![
            OsStr::new("demo"),
            OsStr::new("record"),
            &checkpoint,
            &recorded,
        ]);
        let set = with("", &name, "/recorded");
        for verb in ["info", "replay"] {
            succeed(vec![
                OsStr::new("demo"),
                OsStr::new(verb),
                OsStr::new("--"),
                &set,
            ]);
        }
        succeed(vec![OsStr::new("verify"), OsStr::new("--"), &set]);
        let sides = ["/runs/mamf", "/runs/td3"].map(|side| with("", &name, side));
        succeed(vec![
            OsStr::new("compare"),
            OsStr::new("--"),
            &sides[0],
            &sides[1],
        ]);
        // A pattern below, and a pattern that matches the folder itself: no run is left out.
        for pattern in [with("", &name, "/runs/*"), OsString::from("*/runs/*")] {
            let output = succeed(vec![OsStr::new("curves"), OsStr::new("--"), &pattern]);
            let table = String::from_utf8(output.stdout).unwrap();
            assert_eq!(table.lines().count(), 3, "{name:?}: {table}");
        }

        let experiment =
            "configs = [\"c.toml\"]\nseeds = [0]\n[variants]\na = { method = \"td3\" }\n";
        fs::write(folder.join(&name).join("e.toml"), experiment).unwrap();
        let (file, out) = (with("", &name, "/e.toml"), with("--out=", &name, "/sweep"));
        let sweep = [
            vec![OsStr::new("sweep")],
            words(&small),
            vec![&out, OsStr::new("--"), &file],
        ];
        succeed(sweep.concat());
        assert!(
            folder
                .join(&name)
                .join("sweep/c/a/seed-0/checkpoints/last")
                .is_dir()
        );

        // The program itself lies there: where a run came from is told, in text.
        let copy = folder.join(&name).join("mamf");
        fs::hard_link(mamf, &copy)
            .or_else(|_| fs::copy(mamf, &copy).map(drop))
            .unwrap();
        let begin = ["train", "--config", &here, "--out", "by-copy"];
        let words = [words(&begin), words(&small)];
        let output = run(&folder, &copy, &words.concat());
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let told: serde_json::Value =
            serde_json::from_str(&place.read("by-copy/run.json")).unwrap();
        assert!(
            told["command"][0].as_str().unwrap().ends_with("/mamf"),
            "{told}"
        );
    }
}

#[test]
fn a_setting_that_is_no_text_is_refused_with_what_to_do() {
    let place = Place::new();
    let set = with("demonstrations.path=", OsStr::from_bytes(b"x\xff"), "");
    let file = config("reacher");
    let words = [
        OsStr::new("train"),
        OsStr::new("--config"),
        OsStr::new(&file),
        OsStr::new("--set"),
        &set,
    ];
    let output = run(
        &place.path(""),
        Path::new(env!("CARGO_BIN_EXE_mamf")),
        &words,
    );
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(
        stderr(&output).contains("--set") && stderr(&output).contains("UTF-8"),
        "{output:?}"
    );
    assert!(place.contents("").is_empty());
}

#[test]
fn curves_are_stored_from_and_to_folders_of_any_name() {
    let place = Place::new();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/store_curves.sh");
    let folder = place.path("");
    for name in names() {
        for run in ["runs/a/seed-0", "runs/b"] {
            let run = folder.join(&name).join(run);
            fs::create_dir_all(&run).unwrap();
            for file in [
                "config.toml",
                "run.json",
                "train.csv",
                "eval.csv",
                "timing.csv",
                "more",
            ] {
                fs::write(run.join(file), format!("{run:?}{file}")).unwrap();
            }
        }
        let (from, to) = (with("", &name, "/runs"), with("", &name, "/stored"));
        for _ in 0..2 {
            let output = run(&folder, Path::new(script), &[&from, &to]);
            assert_eq!(output.status.code(), Some(0), "{name:?}: {output:?}");
        }
        let stored = folder.join(&name).join("stored");
        for run in ["a/seed-0", "b"] {
            let kept = stored.join(run).read_dir().unwrap();
            assert_eq!(kept.count(), 5, "{name:?}");
        }
    }
}
