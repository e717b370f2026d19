//! Readers on input that nobody would write: they refuse it in words and never panic.

use mamf::config::{self, Overrides};
use mamf::nn::Weights;
use mamf::recordings::format::Recording;
use mamf::run::Checkpoint;
use mamf::training::{make_env, saved_policy};
use proptest::prelude::*;
use std::collections::HashMap;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A change of some bytes.
#[derive(Debug, Clone)]
enum Change {
    Flip(prop::sample::Index, u8),
    Cut(prop::sample::Index),
    Insert(prop::sample::Index, Vec<u8>),
    Remove(prop::sample::Index, usize),
    /// Writes a number whose size is likely to be taken for a length.
    Overwrite(prop::sample::Index, u64),
}

fn change() -> impl Strategy<Value = Change> {
    let at = any::<prop::sample::Index>;
    prop_oneof![
        (at(), 1..=255u8).prop_map(|(i, bits)| Change::Flip(i, bits)),
        at().prop_map(Change::Cut),
        (at(), prop::collection::vec(any::<u8>(), 1..20)).prop_map(|(i, b)| Change::Insert(i, b)),
        (at(), 1..200usize).prop_map(|(i, n)| Change::Remove(i, n)),
        (at(), any::<u64>()).prop_map(|(i, n)| Change::Overwrite(i, n)),
    ]
}

fn changes() -> impl Strategy<Value = Vec<Change>> {
    prop::collection::vec(change(), 1..4)
}

fn changed(mut bytes: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        // One past the end is a place to insert at.
        let place = |i: &prop::sample::Index| i.index(bytes.len() + 1);
        match change {
            Change::Flip(i, bits) => {
                let i = place(i);
                if let Some(byte) = bytes.get_mut(i) {
                    *byte ^= bits;
                }
            }
            Change::Cut(i) => bytes.truncate(place(i)),
            Change::Insert(i, more) => {
                let i = place(i);
                bytes.splice(i..i, more.iter().copied());
            }
            Change::Remove(i, n) => {
                let i = place(i);
                let end = bytes.len().min(i + n);
                bytes.drain(i..end);
            }
            Change::Overwrite(i, n) => {
                let i = place(i);
                let end = bytes.len().min(i + 8);
                bytes[i..end].copy_from_slice(&n.to_le_bytes()[..end - i]);
            }
        }
    }
    bytes
}

fn parse(text: &str, sets: &[String]) {
    let mut overrides = Overrides::default();
    for set in sets {
        if let Err(error) = overrides.set(set) {
            assert!(error.to_string().contains("--set"));
        }
    }
    match config::parse(text, Path::new("c.toml"), &overrides) {
        // What is accepted can be written and read back.
        Ok(config) => {
            let again = config::parse(
                &config.to_toml(),
                Path::new("d.toml"),
                &Overrides::default(),
            );
            assert_eq!(again.unwrap(), config);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn configs() -> Vec<String> {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/configs");
    let mut paths: Vec<_> = fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|path| fs::read_to_string(path).unwrap())
        .collect()
}

/// A value as a user might set it.
fn value() -> impl Strategy<Value = String> {
    prop_oneof![
        any::<i64>().prop_map(|n| n.to_string()),
        any::<f64>().prop_map(|x| format!("{x:?}")),
        any::<bool>().prop_map(|b| b.to_string()),
        "[a-z-]{0,12}",
        "\\[[0-9, ]{0,20}\\]",
        "\\{[a-z]{1,5} = [0-9]{1,3}\\}",
    ]
}

/// A weights file of two small networks' arrays.
fn weights() -> Vec<u8> {
    let mut weights = Weights::default();
    mamf::nn::Mlp::new(
        &mamf::nn::Architecture::relu(&[3, 4, 2]),
        &mut mamf::core::random::stream(1, "init"),
    )
    .save("actor", &mut weights);
    mamf::nn::ObservationScaling::identity(3).save(&mut weights);
    weights
        .to_bytes(HashMap::from([("task".into(), "Reacher-v4".into())]))
        .unwrap()
}

/// A recording of this repository: the archive and what lies beside it.
fn recording() -> [Vec<u8>; 2] {
    ["npz", "json"].map(|ending| {
        let root = env!("CARGO_MANIFEST_DIR");
        fs::read(format!("{root}/tests/fixtures/rollouts/Reacher.{ending}")).unwrap()
    })
}

fn read_recording(directory: &TempDir, archive: &[u8], settings: &[u8]) {
    let path = directory.path().join("r.npz");
    fs::write(&path, archive).unwrap();
    fs::write(directory.path().join("r.json"), settings).unwrap();
    if let Err(error) = Recording::open(&path) {
        let message = error.to_string();
        assert!(
            message.contains("r.npz") || message.contains("r.json"),
            "{message}"
        );
    }
}

/// The three files of a checkpoint that evaluation reads, made elsewhere: without a manifest.
fn read_checkpoint(directory: &TempDir, weights: &[u8], config: &[u8], state: &[u8]) {
    for (name, bytes) in [
        ("weights.safetensors", weights),
        ("config.toml", config),
        ("checkpoint.json", state),
    ] {
        fs::write(directory.path().join(name), bytes).unwrap();
    }
    match Checkpoint::load(directory.path()) {
        Ok(checkpoint) => {
            // Whatever loads either fits its task or says so.
            if let Ok(env) = make_env(&checkpoint.config) {
                let _ = saved_policy(&checkpoint, env.spec()).map_err(|error| error.to_string());
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_a_configuration_or_refused(text in "\\PC{0,200}", set in "\\PC{0,40}") {
        parse(&text, &[set]);
    }

    #[test]
    fn a_changed_configuration_is_one_or_refused(
        which in any::<prop::sample::Index>(),
        changes in changes(),
    ) {
        let configs = configs();
        let text = changed(which.get(&configs).clone().into_bytes(), &changes);
        parse(&String::from_utf8_lossy(&text), &[]);
    }

    #[test]
    fn any_value_of_any_setting_is_taken_or_refused(
        key in any::<prop::sample::Index>(),
        value in value(),
    ) {
        let resolved = config::Config::preset(config::Method::MamfSac).to_toml();
        let (mut section, mut keys) = (String::new(), Vec::new());
        for line in resolved.lines() {
            if let Some(name) = line.strip_prefix('[') {
                section = format!("{}.", name.trim_end_matches(']'));
            } else if let Some((name, _)) = line.split_once(" = ") {
                keys.push(format!("{section}{name}"));
            }
        }
        let set = format!("{}={value}", key.get(&keys));
        parse("task = \"Hopper-v4\"\nmethod = \"mamf-sac\"", &[set]);
    }

    #[test]
    fn changed_weights_are_read_or_refused(changes in changes()) {
        if let Err(error) = Weights::from_bytes(&changed(weights(), &changes)) {
            prop_assert!(!error.to_string().is_empty());
        }
    }

    #[test]
    fn any_bytes_are_weights_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = Weights::from_bytes(&bytes).map_err(|error| error.to_string());
    }

    #[test]
    fn a_changed_checkpoint_is_read_or_refused(changes in changes(), which in 0..3usize) {
        let directory = tempfile::tempdir().unwrap();
        let mut config = config::Config::preset(config::Method::Td3);
        config.task = "Reacher-v4".into();
        let state = br#"{"step": 7, "task": "Reacher-v4", "method": "td3", "return_mean": 1.5,
            "mamf_version": "0.1.0"}"#;
        let mut files = [weights(), config.to_toml().into_bytes(), state.to_vec()];
        files[which] = changed(std::mem::take(&mut files[which]), &changes);
        let [weights, config, state] = files;
        read_checkpoint(&directory, &weights, &config, &state);
    }

    #[test]
    fn a_changed_recording_is_read_or_refused(changes in changes(), archive in any::<bool>()) {
        let directory = tempfile::tempdir().unwrap();
        let [mut npz, mut json] = recording();
        if archive {
            npz = changed(npz, &changes);
        } else {
            json = changed(json, &changes);
        }
        read_recording(&directory, &npz, &json);
    }
}
