//! The policy in Python of `docs/runs.md`, run as it stands there on what `mamf` has saved. Where Python or its packages
//! are missing, the test says so and passes.

use crate::common::{Place, skipped, stderr};
use mamf::core::random::{Stream, stream};
use mamf::run::Checkpoint;
use mamf::training::{make_env, saved_policy};
use rand::RngExt;
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// The lines of the snippet that name the run, the coupling and the ranges.
const CHECKPOINT: &str = "runs/Hopper-v4/mamf/seed-0/checkpoints/last/weights.safetensors";
const COUPLING: &str = "beta = 0.7 ";
const RANGES: &str = "low, high = np.array([-1.0] * 3), np.array([1.0] * 3)";
const USE: &str = "print(act(np.zeros(11), np.zeros(3)))";

/// The Python that reads `safetensors`: that of `.venv`, or the system's.
fn python() -> Option<PathBuf> {
    let own = Path::new(ROOT).join(".venv/bin/python");
    let python = if own.exists() { own } else { "python3".into() };
    let tried = Command::new(&python)
        .args(["-c", "import numpy, safetensors.numpy"])
        .output();
    let found = tried.is_ok_and(|output| output.status.success());
    if !found {
        skipped("no Python with numpy and safetensors; scripts/setup.sh --plots makes one");
    }
    found.then_some(python)
}

/// The snippet of the page.
fn snippet() -> &'static str {
    let page = include_str!("../../docs/runs.md");
    let (_, rest) = page.split_once("```python\n").expect("a snippet in Python");
    rest.split_once("```").expect("its end").0
}

/// `text` with `part`, which must be there once, replaced.
fn replaced(text: &str, part: &str, by: &str) -> String {
    assert_eq!(text.matches(part).count(), 1, "{part}");
    text.replace(part, by)
}

fn numbers(n: usize, scale: f32, rng: &mut Stream) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(-scale..scale)).collect()
}

/// Asserts that the snippet does in `settings` of a Hopper what the program does, in states that are scaled, clipped and
/// at the ends of the ranges.
fn agrees(python: &Path, settings: &[&str], beta: f64) {
    let place = Place::new();
    let coupling = format!("action_coupling={beta}");
    place.train("hopper", "run", &[settings, &[&coupling]].concat());
    let checkpoint = Checkpoint::load(&place.path("run/checkpoints/last")).unwrap();
    let spec = make_env(&checkpoint.config).unwrap().spec().clone();
    let policy = saved_policy(&checkpoint, &spec).unwrap();

    let rng = &mut stream(4, "states");
    let states: Vec<[Vec<f32>; 2]> = [0.1, 1.0, 10.0, 1000.0]
        .repeat(5)
        .into_iter()
        .map(|scale| [numbers(11, scale, rng), numbers(3, 1.0, rng)])
        .collect();
    let calls = format!("for s, p in {states:?}:\n    print(*act(np.array(s), np.array(p)))");
    let code = replaced(
        snippet(),
        CHECKPOINT,
        "run/checkpoints/last/weights.safetensors",
    );
    let code = replaced(&code, COUPLING, &format!("beta = {beta} "));
    let code = replaced(&code, USE, &calls);
    assert!(code.contains(RANGES));
    let output = Command::new(python)
        .args(["-c", &code])
        .current_dir(place.path(""))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));

    let printed = String::from_utf8(output.stdout).unwrap();
    assert_eq!(printed.lines().count(), states.len());
    for (line, [obs, previous]) in printed.lines().zip(&states) {
        let said = line.split(' ').map(|x| x.parse::<f32>().unwrap());
        for (said, done) in said.zip(policy.act(obs, previous)) {
            assert!((said - done).abs() < 1e-5, "{said} {done}");
        }
    }
}

#[test]
fn the_policy_of_the_documentation_does_what_the_program_does() {
    let Some(python) = python() else { return };
    agrees(&python, &["method=mamf"], 0.7);
    agrees(&python, &["method=td3"], 1.0);
    agrees(&python, &["method=td3", "scaling.enabled=false"], 0.7);
}
