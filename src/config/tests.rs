//! The table of keys, and the way from the text of a file to a configuration or an error.

use super::*;
use std::collections::BTreeSet;
use toml::{Table, Value};

fn load(text: &str, sets: &[&str]) -> Result<Config, ConfigError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("c.toml");
    std::fs::write(&path, text).unwrap();
    let mut overrides = Overrides::default();
    for set in sets {
        overrides.set(set)?;
    }
    read(&path, &overrides)
}

fn message(text: &str, sets: &[&str]) -> String {
    load(text, sets).unwrap_err().to_string()
}

#[test]
fn file_overrides_preset_and_set_overrides_file() {
    let config = load(
        "task = \"Hopper-v4\"\ndiscount = 0.9\n[imagination]\ntarget_filter = true",
        &["method=td3", "tau=1"],
    )
    .unwrap();
    assert_eq!(config.discount, 0.9);
    assert_eq!(config.method, Method::Td3);
    assert!(!config.imagination.target_filter);
    assert_eq!(config.tau, 1.0);
    assert_eq!(config.batch_size, 256);
}

#[test]
fn readings_are_the_released_ones_or_those_of_the_text_and_each_can_be_said_by_itself() {
    use crate::agent::augment::imagination::{
        ImaginaryLossMean, TargetComparison, UncertaintyScale,
    };
    use crate::task::VelocityReading;
    let read = |sets: &[&str]| {
        let config = load("task = \"Hopper-v4\"", sets).unwrap();
        let imagination = config.imagination;
        (
            imagination.target_comparison,
            imagination.uncertainty_scale,
            imagination.imaginary_loss_mean,
            config.rules.velocity,
        )
    };
    let released = (
        TargetComparison::Greater,
        UncertaintyScale::BatchMax,
        ImaginaryLossMean::Batch,
        VelocityReading::Start,
    );
    let text = (
        TargetComparison::GreaterEqual,
        UncertaintyScale::RunningMax,
        ImaginaryLossMean::Kept,
        VelocityReading::Mean,
    );
    assert_eq!(read(&[]), released);
    for method in ["mamf", "mamf-sac", "ma-td3"] {
        let method = format!("method={method}");
        assert_eq!(read(&[&method]), released);
        assert_eq!(read(&[&method, "imagination.readings=text"]), text);
    }
    let one = read(&[
        "imagination.imaginary_loss_mean=batch",
        "imagination.readings=text",
    ]);
    assert_eq!(one, (text.0, text.1, ImaginaryLossMean::Batch, text.3));
    let refused = message(
        "task = \"Hopper-v4\"",
        &["method=td3", "imagination.readings=text"],
    );
    assert!(refused.contains("imagines no other actions"), "{refused}");
}

#[test]
fn a_resolved_configuration_reads_back_equal() {
    let config = load("task = \"Hopper-v4\"", &[]).unwrap();
    let text = config.to_toml();
    assert_eq!(load(&text, &[]).unwrap(), config);
}

/// The configuration of a run of any method is good for another method, whose own settings it then has.
#[test]
fn an_option_makes_another_method_of_a_resolved_configuration() {
    for from in Method::ALL {
        let mut config = Config::preset(from);
        config.task = "Hopper-v4".into();
        config.discount = 0.9;
        for to in Method::ALL {
            let mut expected = Config::preset(to);
            expected.task = "Hopper-v4".into();
            expected.discount = 0.9;
            let method = format!("method={}", to.name());
            assert_eq!(load(&config.to_toml(), &[&method]).unwrap(), expected);
        }
    }
    // What is not the method's own stays.
    let text = "task = \"Hopper-v4\"\n[imagination]\ntarget_filter = false\nnoise_bound = 0.3";
    let config = load(text, &["method=ma-td3"]).unwrap();
    assert_eq!(config.imagination.noise_bound, 0.3);
    let config = load(text, &["method=mamf-sac"]).unwrap();
    assert!(!config.imagination.target_filter);
}

#[test]
fn a_table_of_the_task_holds_its_id_and_its_wrappers_alone() {
    let table = "[task]\nid = \"Hopper-v4\"\n";
    let doubled = "doubled_actions = { period = 7 }\n";
    let config = load(&format!("{table}{doubled}"), &[]).unwrap();
    assert_eq!(config.doubled_actions.unwrap().period, 7);
    let m = message(&format!("{table}seed = 2"), &[]);
    assert!(m.contains("`task.seed`") && m.contains("`seed`"), "{m}");
    let m = message(&format!("{doubled}{table}{doubled}"), &[]);
    assert!(
        m.contains("`task.doubled_actions.period`") && m.contains("not both"),
        "{m}"
    );
    for text in [
        format!("{table}doubled_actions = {{}}"),
        format!("doubled_actions = {{}}\n{table}"),
    ] {
        let m = message(&text, &[]);
        assert!(m.contains("missing key `doubled_actions.period`"), "{m}");
    }
    let m = message(table, &["doubled_actions={}"]);
    assert!(
        m.contains("--set doubled_actions={}") && m.contains("`doubled_actions.period`"),
        "{m}"
    );
}

#[test]
fn settings_that_mean_nothing_are_refused_by_name() {
    let task = "task = \"Hopper-v4\"\n";
    for (sets, parts) in [
        (
            &["method=td3", "imagination.target_filter=false"][..],
            ["target_filter", "`td3`"],
        ),
        (
            &["method=td3", "temperature.initial=0.1"],
            ["temperature.initial", "`td3`"],
        ),
        (&["expansion.horizon=3"], ["expansion.horizon", "`mamf`"]),
        (
            &[
                "imagination.noise_decay=false",
                "imagination.decay_rate=0.5",
            ],
            ["imagination.decay_rate", "imagination.noise_decay is false"],
        ),
        (
            &["imagination.optimism=false", "imagination.bias_factor=0.5"],
            ["imagination.bias_factor", "imagination.optimism is false"],
        ),
    ] {
        let m = message(task, sets);
        assert!(parts.iter().all(|part| m.contains(part)), "{sets:?}: {m}");
    }
    let file = format!("{task}[imagination]\nbias_factor = 0.5\n");
    assert!(load(&file, &["imagination.optimism=false"]).is_ok());
}

#[test]
fn the_configuration_of_a_run_must_hold_every_key() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("config.toml");
    let config = load("task = \"Hopper-v4\"", &[]).unwrap();
    let text = config.to_toml();
    std::fs::write(&path, &text).unwrap();
    assert_eq!(read_resolved(&path, &Overrides::default()).unwrap(), config);
    for lines in 1..text.lines().count() {
        let cut: Vec<&str> = text.lines().take(lines).collect();
        std::fs::write(&path, cut.join("\n")).unwrap();
        assert!(
            read_resolved(&path, &Overrides::default()).is_err(),
            "{lines} lines"
        );
    }
}

#[test]
fn what_a_run_says_of_keys_without_a_use_is_another_programs_preset() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("config.toml");
    let config = load("task = \"Hopper-v4\"\nmethod = \"td3\"", &[]).unwrap();
    let text = config.to_toml();
    let others = text.replace("\"batch\"", "\"kept\"");
    assert_ne!(others, text);
    std::fs::write(&path, &others).unwrap();
    assert_eq!(read_resolved(&path, &Overrides::default()).unwrap(), config);
    assert!(message(&others, &[]).contains("imagination.imaginary_loss_mean"));
}

#[test]
fn unknown_keys_name_the_nearest_one() {
    let m = message("task = \"Hopper-v4\"\nbatchsize = 3", &[]);
    assert!(
        m.contains("c.toml") && m.contains("`batchsize`") && m.contains("`batch_size`"),
        "{m}"
    );
    let m = message("task = \"Hopper-v4\"", &["target_filter=false"]);
    assert!(
        m.contains("--set target_filter") && m.contains("`imagination.target_filter`"),
        "{m}"
    );
}

#[test]
fn wrong_values_name_key_value_and_what_is_right() {
    let task = "task = \"Hopper-v4\"\n";
    for (set, parts) in [
        ("steps=-5", ["`steps`", "-5", "at least 1"]),
        ("seed=-5", ["`seed`", "-5", "not negative"]),
        ("steps=0", ["`steps`", "0", "at least 1"]),
        ("discount=1.5", ["`discount`", "1.5", "from 0 to 1"]),
        ("discount=nan", ["`discount`", "nan", "from 0 to 1"]),
        (
            "imagination.decay_rate=1.1",
            ["`imagination.decay_rate`", "1.1", "at most 1"],
        ),
        ("batch_size=1", ["`batch_size`", "1", "from 2 to 1000000"]),
        (
            "batch_size=30000",
            ["`batch_size`", "30000", "random_steps (25000)"],
        ),
        ("batch_size=big", ["`batch_size`", "big", "whole number"]),
        ("method=ppo", ["`method`", "ppo", "`mamf`"]),
        ("model.predict=all", ["`model.predict`", "all", "`delta`"]),
        (
            "networks.hidden=[256, \"a\"]",
            ["`networks.hidden`", "\"a\"", "list of whole numbers"],
        ),
        (
            "networks.hidden=[]",
            ["`networks.hidden`", "[]", "one or more widths"],
        ),
        ("imagination=3", ["`imagination`", "3", "[imagination]"]),
    ] {
        let m = message(task, &[set]);
        assert!(parts.iter().all(|p| m.contains(p)), "{set}: {m}");
    }
}

#[test]
fn a_missing_task_and_malformed_input_are_named() {
    assert!(message("seed = 1", &[]).contains("missing key `task`"));
    assert!(message("seed = ", &[]).contains("not valid TOML"));
    assert!(message("task = \"x\"", &["nothing"]).contains("KEY=VALUE"));
}

// -- The table of keys ----------------------------------------------------------------------------

#[test]
fn every_key_is_a_field_and_every_field_a_key() {
    let mut config = Config::preset(Method::Mamf);
    config.doubled_actions = Some(DoubledActions { period: 1 });
    let fields: BTreeSet<String> = merge::values(&config).into_keys().collect();
    let keys: BTreeSet<String> = KEYS.iter().map(|key| key.name.to_owned()).collect();
    assert_eq!(fields, keys);
    assert_eq!(keys.len(), KEYS.len(), "a key stands twice");
}

#[test]
fn every_row_is_sound() {
    for key in KEYS {
        assert!(key.doc().ends_with('.'), "{}", key.name);
        assert!(is_section(key.section()), "{}", key.name);
        if let Some(default) = key.default() {
            assert_eq!(key.range.admit(&default), Some(default), "{}", key.name);
        }
        if let Some((switch, value)) = key.only_while {
            let range = find(switch).unwrap().range;
            assert!(range.admit(&keys::parsed(value)).is_some(), "{}", key.name);
        }
    }
    let sections: Vec<&str> = KEYS.iter().map(Key::section).collect();
    let mut order = sections.clone();
    order.dedup();
    let listed: Vec<&str> = SECTIONS.iter().map(|(section, _)| *section).collect();
    assert_eq!(order, listed);
}

#[test]
fn every_preset_is_sound_and_says_nothing_twice() {
    for method in Method::ALL {
        for (name, value) in method.definition().preset.iter().copied().flatten() {
            let key = find(name).unwrap();
            let value = keys::parsed(value);
            assert_eq!(key.range.admit(&value).as_ref(), Some(&value), "{name}");
            assert_ne!(key.default(), Some(value), "{name} of {method:?}");
        }
        assert_eq!(Config::preset(method).method, method);
    }
}

/// The ends of each range, as values: those of lists by an example.
fn ends(range: Range) -> Vec<Value> {
    match range {
        Range::Task => vec![Value::String("Hopper-v4".into())],
        Range::Method => Method::ALL.map(|m| Value::String(m.name().into())).into(),
        Range::Text => vec![Value::String(String::new())],
        Range::Flag => vec![Value::Boolean(true), Value::Boolean(false)],
        Range::Word(words) => words.iter().map(|w| Value::String((*w).into())).collect(),
        Range::Whole { least, most } => [least, most].map(|n| Value::Integer(n as i64)).into(),
        Range::Number { least, most } => [least, most].map(Value::Float).into(),
        Range::Positive { most } => vec![Value::Float(f64::MIN_POSITIVE), Value::Float(most)],
        Range::Widths => vec![keys::parsed("[1]"), keys::parsed("[8192, 8192]")],
        Range::Span { .. } => vec![keys::parsed("[]"), keys::parsed("[0, 10.0]")],
    }
}

/// Whatever a range admits, the field takes: its type is that of the range.
#[test]
fn fields_take_what_ranges_admit() {
    for key in KEYS {
        for value in ends(key.range) {
            let admitted = key.range.admit(&value);
            let admitted = admitted.unwrap_or_else(|| panic!("{}: {value}", key.name));
            let mut values = preset(Method::Mamf).clone();
            values.insert(key.name.to_owned(), admitted.clone());
            let taken = merge::values(&merge::typed(&values));
            assert_eq!(taken[key.name], admitted, "{}", key.name);
        }
    }
}

#[test]
fn words_are_all_that_a_field_takes() {
    for key in KEYS {
        let Range::Word(words) = key.range else {
            continue;
        };
        let mut table = Table::try_from(Config::preset(Method::Mamf)).unwrap();
        match key.name.split_once('.') {
            Some((section, last)) => table[section][last] = "?".into(),
            None => table[key.name] = "?".into(),
        }
        let error = table.try_into::<Config>().unwrap_err().to_string();
        let message = error.lines().next().unwrap();
        let (_, expected) = message.split_once("expected").unwrap();
        let named: BTreeSet<&str> = expected.split('`').skip(1).step_by(2).collect();
        assert_eq!(named, words.iter().copied().collect(), "{}", key.name);
    }
}

#[test]
fn what_may_change_when_a_run_is_resumed() {
    let config = Config::preset(Method::Mamf);
    let mut other = config.clone();
    other.steps += 1;
    other.compute.threads += 1;
    assert!(config.differences(&other).iter().all(Difference::is_free));
    other.tau = 0.1;
    other.checkpoint.every += 1;
    let kept: Vec<_> = config.differences(&other);
    let kept: Vec<_> = kept
        .iter()
        .map(|d| (d.key.as_str(), d.on_resume()))
        .collect();
    assert_eq!(
        kept,
        [
            ("checkpoint.every", Resume::Forced),
            ("compute.threads", Resume::Free),
            ("steps", Resume::Free),
            ("tau", Resume::Fixed),
        ]
    );
}

#[test]
fn runs_that_are_older_than_a_key_are_read_as_its_default_says() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("config.toml");
    let config = load("task = \"Hopper-v4\"", &[]).unwrap();
    let text = config.to_toml();
    let older = text
        .replace("environments = 1\n", "")
        .replace("[updates]\nevery = 1\n", "")
        .replace("[exploration]\nspread = []\nend_when_dropped = false\n", "");
    assert_eq!(older.lines().count() + 6, text.lines().count());
    std::fs::write(&path, older).unwrap();
    assert_eq!(read_resolved(&path, &Overrides::default()).unwrap(), config);
}

// -- Several environments -------------------------------------------------------------------------

#[test]
fn environments_their_noise_and_the_pace_of_learning_are_set() {
    let sets = [
        "environments=4",
        "exploration.spread=[0, 0.4]",
        "updates.every=8",
    ];
    let config = load("task = \"Hopper-v4\"", &sets).unwrap();
    assert_eq!((config.environments, config.updates.every), (4, 8));
    assert_eq!(config.exploration.spread, [0.0, 0.4]);
    let config = load("task = \"Hopper-v4\"", &["exploration.spread=[0.2, 0.2]"]).unwrap();
    assert_eq!(config.exploration.spread, [0.2, 0.2]);
    let config = load("task = \"Hopper-v4\"", &["method=sac", "environments=2"]).unwrap();
    assert_eq!((config.environments, config.updates.every), (2, 1));
    assert!(config.exploration.spread.is_empty());
}

#[test]
fn environments_and_noise_that_cannot_be_are_refused_by_name() {
    let task = "task = \"Hopper-v4\"\n";
    let many = "environments=4";
    for (sets, parts) in [
        (
            &["environments=0"][..],
            ["`environments`", "from 1 to 1024"],
        ),
        (&["environments=1025"], ["`environments`", "from 1 to 1024"]),
        (&["environments=2.5"], ["`environments`", "a whole number"]),
        (&["updates.every=0"], ["`updates.every`", "at least 1"]),
        (&["updates.evry=2"], ["`updates.evry`", "`updates.every`"]),
        (
            &[many, "exploration.spread=[0.3, 0.1]"],
            ["`exploration.spread` = [0.3, 0.1]", "low not above high"],
        ),
        (
            &[many, "exploration.spread=[0.3]"],
            ["`exploration.spread`", "two numbers"],
        ),
        (
            &[many, "exploration.spread=[0, 1, 2]"],
            ["`exploration.spread`", "two numbers"],
        ),
        (
            &[many, "exploration.spread=0.3"],
            ["`exploration.spread`", "two numbers"],
        ),
        (
            &[many, "exploration.spread=[-0.1, 1]"],
            ["`exploration.spread`", "from 0 to 10"],
        ),
        (
            &[many, "exploration.spread=[0.1, 11]"],
            ["`exploration.spread`", "from 0 to 10"],
        ),
        (
            &[many, "exploration.spread=[nan, nan]"],
            ["`exploration.spread`", "from 0 to 10"],
        ),
        (
            &["exploration.spread=[0.1, 0.3]"],
            [
                "`exploration.spread` = [0.1, 0.3]",
                "environments of at least 2 (it is 1)",
            ],
        ),
        (
            &[many, "method=sac", "exploration.spread=[0.1, 0.3]"],
            [
                "`exploration.spread`",
                "method `sac` explores by its policy's own noise",
            ],
        ),
        (
            &[many, "method=mamf-sac", "exploration.spread=[0.1, 0.3]"],
            ["`exploration.spread`", "`mamf-sac`"],
        ),
        (
            &[
                many,
                "exploration.spread=[0.1, 0.3]",
                "exploration_noise=0.2",
            ],
            [
                "`exploration_noise`",
                "while exploration.spread is [0.1, 0.3]",
            ],
        ),
    ] {
        let m = message(task, sets);
        assert!(parts.iter().all(|part| m.contains(part)), "{sets:?}: {m}");
    }
}
