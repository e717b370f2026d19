//! The experiments of `configs/paper` name runs that can be started.

use mamf::config::Config;
use mamf::lab::sweep::{Changes, Sweep};
use std::path::Path;

const FIGURES: [&str; 4] = ["figure_2", "figure_3ab", "figure_3c", "appendix_c"];

/// Every run of an experiment but for its seed: configuration, variant and resolved settings.
fn runs(experiment: &str) -> Vec<(String, String, Config)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.join(format!("configs/paper/{experiment}.toml"));
    let five: Vec<u64> = (0..5).collect();
    let sweep = Sweep::read(&path, &Changes::default()).unwrap();
    for runs in sweep.runs.chunks(5) {
        let seeds: Vec<u64> = runs.iter().map(|run| run.seed).collect();
        assert_eq!(seeds, five, "{experiment}");
    }
    let runs = sweep.runs.into_iter().step_by(5).map(|run| {
        let mut names = run.name.split('/').map(str::to_owned);
        let [config, variant] = [(); 2].map(|()| names.next().unwrap());
        (config, variant, run.config)
    });
    runs.collect()
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
