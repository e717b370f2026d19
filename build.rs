//! Records the commit, the compiler, and what the program computes with, for `run.json` and checkpoints.

use std::collections::hash_map::DefaultHasher;
use std::fs;
use std::hash::Hasher;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What results depend on: the rooms that compute, the physics, the models, the libraries. How results are printed, compared
/// and documented is not among it.
const COMPUTES: [&str; 15] = [
    "src/core",
    "src/task",
    "src/nn",
    "src/replay",
    "src/model",
    "src/agent",
    "src/env",
    "src/recordings",
    "src/config",
    "src/training",
    "crates/mujoco-sys",
    "crates/mujoco-rs",
    "assets",
    "Cargo.toml",
    "Cargo.lock",
];

fn main() {
    for path in [
        ".git/HEAD",
        ".git/logs/HEAD",
        ".git/index",
        "build.rs",
        "src",
    ] {
        println!("cargo::rerun-if-changed={path}");
    }
    for path in COMPUTES {
        println!("cargo::rerun-if-changed={path}");
    }
    if let Some(commit) = output("git", &["rev-parse", "HEAD"]) {
        println!("cargo::rustc-env=MAMF_COMMIT={commit}");
    }
    if let Some(changes) = output("git", &["status", "--porcelain", "--untracked-files=no"]) {
        println!("cargo::rustc-env=MAMF_DIRTY={}", !changes.is_empty());
    }
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = output(&rustc, &["--version"]).unwrap_or_default();
    println!("cargo::rustc-env=MAMF_RUSTC={version}");

    let mut computes = DefaultHasher::new();
    let mut files = Vec::new();
    for path in COMPUTES {
        collect(Path::new(path), &mut files);
    }
    files.sort();
    for file in files {
        computes.write(file.as_os_str().as_encoded_bytes());
        computes.write(&fs::read(&file).unwrap_or_default());
    }
    computes.write(version.as_bytes());
    for variable in ["TARGET", "OPT_LEVEL", "CARGO_ENCODED_RUSTFLAGS"] {
        computes.write(std::env::var(variable).unwrap_or_default().as_bytes());
        computes.write_u8(0);
    }
    println!("cargo::rustc-env=MAMF_COMPUTES={:016x}", computes.finish());
}

/// All files below `path`, or itself; tests that lie in files of their own, and what builds leave, are none.
fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if path.is_file() {
        if !name.ends_with("tests.rs") {
            files.push(path.to_owned());
        }
    } else if name != "target" && name != "tests" {
        for entry in fs::read_dir(path).into_iter().flatten().flatten() {
            collect(&entry.path(), files);
        }
    }
}

/// Standard output of a command that ends well.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
