//! Any bytes are the weights of a checkpoint or are refused; so are any three files without a manifest.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mamf::nn::Weights;
use mamf::run::Checkpoint;

fuzz_target!(|parts: (&[u8], &[u8], &[u8])| {
    let (weights, config, state) = parts;
    let _ = Weights::from_bytes(weights);
    let directory = tempfile::tempdir().expect("a directory");
    for (name, bytes) in [
        ("weights.safetensors", weights),
        ("config.toml", config),
        ("checkpoint.json", state),
    ] {
        std::fs::write(directory.path().join(name), bytes).expect("written");
    }
    let _ = Checkpoint::load(directory.path());
});
