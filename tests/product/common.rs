//! What the end-to-end tests share: a place to work in, small runs, refused commands.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// Settings of a run of a fraction of a second: 200 random steps and 200 updates of small networks.
pub const SMALL: [&str; 9] = [
    "steps=400",
    "random_steps=200",
    "model_start=100",
    "batch_size=33",
    "networks.hidden=[32, 32]",
    "model.hidden=[32, 32, 32]",
    "evaluation.every=100",
    "evaluation.episodes=2",
    "checkpoint.every=50",
];

/// A configuration of this repository.
pub fn config(name: &str) -> String {
    format!("{}/configs/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

/// Arguments of a small run of `configs/<name>.toml` into `out`; `settings` come last and win.
pub fn small_run(name: &str, out: &str, settings: &[&str]) -> Vec<String> {
    let mut arguments = vec!["train".into(), "--config".into(), config(name)];
    arguments.extend(["--out".into(), out.into()]);
    for setting in SMALL.iter().chain(settings) {
        arguments.extend(["--set".into(), (*setting).into()]);
    }
    arguments
}

/// Says that a test can't be made here. Past the harness, which keeps what passing tests print to itself.
pub fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

/// An empty directory in which `mamf` is run.
pub struct Place(TempDir);

impl Place {
    pub fn new() -> Place {
        Place(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        fs::write(self.path(name), contents).unwrap();
    }

    pub fn command<S: AsRef<str>>(&self, arguments: &[S]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mamf"));
        command.current_dir(self.0.path()).stdin(Stdio::null());
        command.args(arguments.iter().map(AsRef::as_ref));
        command
    }

    /// Runs a line of bash here, with `$mamf` for the program and, in `$small`, what makes a run small.
    pub fn bash(&self, line: &str) -> Output {
        let small: Vec<String> = SMALL.iter().map(|s| format!("--set '{s}'")).collect();
        let mut command = Command::new("bash");
        command.current_dir(self.0.path()).stdin(Stdio::null());
        command.env("mamf", env!("CARGO_BIN_EXE_mamf"));
        command.env("root", env!("CARGO_MANIFEST_DIR"));
        let line = format!("small=({})\n{line}", small.join(" "));
        command.args(["-c", &line]).output().unwrap()
    }

    /// Runs `mamf`; it must not panic, whatever it is asked.
    pub fn run<S: AsRef<str>>(&self, arguments: &[S]) -> Output {
        let output = self.command(arguments).output().unwrap();
        assert!(!stderr(&output).contains("panicked at"), "{output:?}");
        output
    }

    /// Runs `mamf` to a good end; returns what it printed. No message goes to standard error.
    pub fn succeed<S: AsRef<str>>(&self, arguments: &[S]) -> String {
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert_eq!(messages(&output), "");
        String::from_utf8(output.stdout).unwrap()
    }

    /// A small run into `out`.
    pub fn train(&self, name: &str, out: &str, settings: &[&str]) {
        self.succeed(&small_run(name, out, settings));
    }

    /// Runs `mamf`, which must end with `code` and one message that has all `parts`, and must leave
    /// every file here as it was.
    pub fn refuse<S: AsRef<str>>(&self, code: i32, arguments: &[S], parts: &[&str]) {
        let before = self.contents("");
        let output = self.run(arguments);
        let message = messages(&output);
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        assert_eq!(output.stdout, b"", "{output:?}");
        assert!(message.starts_with("error: "), "{message}");
        assert_eq!(message.matches("error: ").count(), 1, "{message}");
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
        assert!(self.contents("") == before, "files changed: {message}");
    }

    /// Every file and directory below `name`, with its bytes.
    pub fn contents(&self, name: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        collect(&self.path(name), &mut found);
        found
    }

    /// Copies the directory `from`, and all in it, to `to`.
    pub fn copy(&self, from: &str, to: &str) {
        let (from, to) = (self.path(from), self.path(to));
        fs::create_dir_all(&to).unwrap();
        let mut found = BTreeMap::new();
        collect(&from, &mut found);
        for path in found.keys() {
            let copy = to.join(path.strip_prefix(&from).unwrap());
            if path.is_dir() {
                fs::create_dir_all(copy).unwrap();
            } else {
                fs::copy(path, copy).unwrap();
            }
        }
    }
}

fn collect(directory: &Path, found: &mut BTreeMap<PathBuf, Vec<u8>>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.insert(path.clone(), Vec::new());
            collect(&path, found);
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What went to standard error, but for what every run and sweep says: its memory, and how optimistic phase 2 begins.
pub fn messages(output: &Output) -> String {
    let usual = ["replay buffer: ", "memory: ", "note: phase 2: "];
    let said = stderr(output);
    let lines = said
        .lines()
        .filter(|line| !usual.iter().any(|words| line.starts_with(words)));
    lines.map(|line| format!("{line}\n")).collect()
}
