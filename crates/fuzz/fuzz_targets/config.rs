//! Any text is a configuration or is refused; what is accepted reads back equal.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mamf::config::{Overrides, parse};
use std::path::Path;

fuzz_target!(|text: &str| {
    let (set, text) = text.split_once('\0').unwrap_or(("", text));
    let mut overrides = Overrides::default();
    let _ = overrides.set(set);
    if let Ok(config) = parse(text, Path::new("fuzzed.toml"), &overrides) {
        let again = parse(&config.to_toml(), Path::new("again.toml"), &Overrides::default());
        assert_eq!(again.expect("written by us"), config);
    }
});
