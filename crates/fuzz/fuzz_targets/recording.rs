//! Any archive is a recording or is refused. The first two bytes are the length of what lies beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mamf::recordings::format::Recording;

fuzz_target!(|bytes: &[u8]| {
    let Some((length, rest)) = bytes.split_first_chunk::<2>() else {
        return;
    };
    let length = usize::from(u16::from_le_bytes(*length)).min(rest.len());
    let (settings, archive) = rest.split_at(length);
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("fuzzed.npz");
    std::fs::write(&path, archive).expect("written");
    std::fs::write(directory.path().join("fuzzed.json"), settings).expect("written");
    let _ = Recording::open(&path);
});
