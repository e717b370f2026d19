//! Output that nobody reads, or that nobody can write down, changes no verdict and no file.

use crate::common::{Place, messages, skipped, stderr};
use std::fs;
use std::path::Path;

/// What `command` of bash ends with when whoever reads its output has gone before it says anything.
fn unread(place: &Place, command: &str) -> (i32, String) {
    let line = format!("{{ sleep 0.2; {command}; echo \"code $?\" >&2; }} | true");
    let said = stderr(&place.bash(&line));
    let code = said.lines().find_map(|line| line.strip_prefix("code "));
    (code.unwrap().parse().unwrap(), said)
}

/// A place with a run, and a damaged recording.
fn place() -> Place {
    let place = Place::new();
    place.train("inverted_pendulum", "run/td3/seed-0", &["method=td3"]);
    place.train("inverted_pendulum", "run/mamf/seed-0", &[]);
    fs::create_dir(place.path("damaged")).unwrap();
    let rollouts = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/rollouts");
    let npz = fs::read(rollouts.join("PenSpin.npz")).unwrap();
    place.write("damaged/PenSpin.npz", &npz[..npz.len() / 2]);
    place.write(
        "damaged/PenSpin.json",
        fs::read(rollouts.join("PenSpin.json")).unwrap(),
    );
    place
}

#[test]
fn a_closed_pipe_is_no_success_of_what_failed_and_no_failure_of_what_is_done() {
    let place = place();
    for (code, command) in [
        (1, "$mamf verify damaged"),
        (1, "$mamf demo replay damaged"),
        (1, "$mamf demo info damaged"),
        (1, "$mamf compare --at-least=1000 run/mamf run/td3"),
        (1, "$mamf compare --at-least=1000 --json run/mamf run/td3"),
        (0, "$mamf compare --at-least=-1000 run/mamf run/td3"),
        (0, "$mamf compare run/mamf run/td3"),
        (0, "$mamf curves run"),
        (0, "$mamf curves --json run"),
        (0, "$mamf envs"),
        (0, "$mamf settings"),
        (
            0,
            "$mamf eval --checkpoint run/td3/seed-0 --episodes 3 --csv episodes.csv",
        ),
        (
            0,
            "$mamf demo record --checkpoint run/td3/seed-0 --episodes 2 --out recorded",
        ),
        (0, "$mamf train --resume run/td3/seed-0"),
        (
            0,
            "$mamf train --config $root/configs/reacher.toml \"${small[@]}\" --out reacher",
        ),
        (2, "$mamf compare run/mamf run/none"),
    ] {
        let (found, said) = unread(&place, command);
        assert_eq!(found, code, "{command}: {said}");
        assert!(
            !said.contains("panicked") && !said.contains("Broken pipe"),
            "{said}"
        );
    }
    assert_eq!(place.read("episodes.csv").lines().count(), 4);
    assert!(place.path("recorded/episode_0002.json").exists());
    assert!(place.path("reacher/checkpoints/last").exists());
}

#[test]
fn a_sweep_with_a_failed_run_fails_whoever_reads() {
    let place = Place::new();
    place.write("all.toml", "task = \"Reacher-v4\"\nsteps = 100\n");
    place.write(
        "experiment.toml",
        "configs = [\"all.toml\"]\nseeds = [0]\n[variants]\na = { method = \"td3\" }\n",
    );
    // Something else lies where the run is to go.
    fs::create_dir_all(place.path("out/all/a/seed-0")).unwrap();
    place.write("out/all/a/seed-0/notes.txt", "");
    let (code, said) = unread(&place, "$mamf sweep experiment.toml --out out");
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("notes.txt"), "{said}");
}

#[test]
fn a_full_disk_of_the_log_is_no_failure_of_what_is_done() {
    if !Path::new("/dev/full").exists() {
        return skipped("no /dev/full here");
    }
    let place = place();
    for (code, command) in [
        (
            0,
            "$mamf train --config $root/configs/reacher.toml \"${small[@]}\" --out reacher",
        ),
        (0, "$mamf train --resume reacher"),
        (
            0,
            "$mamf eval --checkpoint run/td3/seed-0 --csv episodes.csv",
        ),
        (0, "$mamf compare --at-least=-1000 run/mamf run/td3"),
        (1, "$mamf compare --at-least=1000 run/mamf run/td3"),
        (1, "$mamf verify damaged"),
        // All that these do is to print.
        (1, "$mamf settings"),
        (1, "$mamf envs"),
        (1, "$mamf compare run/mamf run/td3"),
        (1, "$mamf curves run"),
        (1, "$mamf eval --checkpoint run/td3/seed-0"),
    ] {
        let output = place.bash(&format!("{command} >/dev/full"));
        assert_eq!(output.status.code(), Some(code), "{command}: {output:?}");
        let said = messages(&output);
        assert!(
            said.contains("standard output") || command.contains("damaged"),
            "{said}"
        );
    }
    assert_eq!(place.read("episodes.csv").lines().count(), 11);
}
