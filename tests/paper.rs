//! The experiments of `configs/paper` name runs that can be started.

use mamf::config::{self, Config, Overrides};
use std::collections::BTreeSet;
use std::path::Path;
use toml::{Table, Value};

const FIGURES: [&str; 4] = ["figure_2", "figure_3ab", "figure_3c", "appendix_c"];

/// Every run of an experiment but for its seed: configuration, variant and resolved settings.
fn runs(experiment: &str) -> Vec<(String, String, Config)> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let path = configs.join("paper").join(format!("{experiment}.toml"));
    let table: Table = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let known = ["configs", "seeds", "variants", "on"];
    assert!(
        table.keys().all(|key| known.contains(&key.as_str())),
        "{experiment}"
    );
    assert_eq!(table["seeds"].as_array().unwrap().len(), 5, "{experiment}");
    let variants = table["variants"].as_table().unwrap();
    let names: BTreeSet<&str> = table["configs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap())
        .collect();
    let on = table.get("on").and_then(Value::as_table);
    for (config, of_variants) in on.into_iter().flatten() {
        assert!(names.contains(config.as_str()), "{experiment}: {config}");
        for variant in of_variants.as_table().unwrap().keys() {
            assert!(variants.contains_key(variant), "{experiment}: {variant}");
        }
    }
    let mut runs = Vec::new();
    for config in names {
        for (variant, settings) in variants {
            let own = on.and_then(|on| on.get(config)?.get(variant)?.as_table());
            let mut overrides = Overrides::default();
            for (key, value) in settings
                .as_table()
                .unwrap()
                .iter()
                .chain(own.into_iter().flatten())
            {
                overrides.set(&format!("{key}={value}")).unwrap();
            }
            let path = configs.join(format!("{config}.toml"));
            let resolved = config::read(&path, &overrides)
                .unwrap_or_else(|error| panic!("{experiment}, {config}, {variant}: {error}"));
            runs.push((config.to_owned(), variant.clone(), resolved));
        }
    }
    runs
}

#[test]
fn every_run_has_settings_of_its_own() {
    for experiment in FIGURES {
        let runs = runs(experiment);
        for (i, first) in runs.iter().enumerate() {
            for second in &runs[..i] {
                assert_ne!(first.2, second.2, "{experiment}: {} {}", first.0, first.1);
            }
        }
    }
}

#[test]
fn every_experiment_is_tested_and_holds_what_the_paper_shows() {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/paper");
    for entry in std::fs::read_dir(directory).unwrap() {
        let name = entry.unwrap().path().file_stem().unwrap().to_owned();
        assert!(FIGURES.contains(&name.to_str().unwrap()), "{name:?}");
    }
    let figure_2 = runs("figure_2");
    assert_eq!(figure_2.len(), 40);
    for (config, variant, settings) in &figure_2 {
        assert_eq!(settings.method.name(), variant);
        assert_eq!(settings.discount, 0.98, "{config}");
        assert_eq!(settings.action_coupling, 0.7, "{config}");
    }
    let switches = |settings: &Config| {
        let i = &settings.imagination;
        [
            i.optimism,
            i.noise_decay,
            i.target_filter,
            i.uncertainty_filter,
        ]
    };
    for (_, variant, settings) in runs("figure_3ab") {
        let off = switches(&settings).iter().filter(|on| !**on).count();
        let expected = match variant.as_str() {
            "mamf" => 0,
            "td3" => 4,
            _ => 1,
        };
        assert_eq!(off, expected, "{variant}");
    }
    assert!(
        runs("figure_3c")
            .iter()
            .all(|run| run.2.doubled_actions.is_some())
    );
    let factor = |config: &str| {
        let runs = runs("appendix_c");
        let run = runs
            .iter()
            .find(|run| run.0 == config && run.1 == "mamf-sac");
        run.unwrap().2.imagination.bias_factor
    };
    assert!((factor("swimmer") - 1.0 / 60.0).abs() < 1e-12);
    assert!((factor("hopper") - 1.0 / 6.0).abs() < 1e-12);
}
