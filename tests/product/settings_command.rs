//! `mamf settings`, and the page that it writes.

use crate::common::Place;
use mamf::config::{KEYS, Method};

#[test]
fn the_page_of_the_documentation_is_the_one_that_is_written() {
    let printed = Place::new().succeed(&["settings", "--markdown"]);
    assert!(
        printed == include_str!("../../docs/configuration.md"),
        "write it anew: mamf settings --markdown > docs/configuration.md"
    );
}

#[test]
fn all_keys_are_listed_or_those_that_a_method_has_a_use_for() {
    let place = Place::new();
    let lists = |text: &str, key: &str| {
        let begins = format!("{key} ");
        text.lines().any(|line| line.starts_with(&begins))
    };
    let all = place.succeed(&["settings"]);
    for key in KEYS {
        assert!(lists(&all, key.name), "{}", key.name);
        assert!(all.contains(key.doc()), "{}", key.name);
    }
    for method in Method::ALL {
        let listed = place.succeed(&["settings", "--method", method.name()]);
        for key in KEYS {
            let has_use = key.concern.includes(method);
            assert_eq!(lists(&listed, key.name), has_use, "{} {method:?}", key.name);
        }
    }
    let section = place.succeed(&["settings", "imagination"]);
    assert!(
        lists(&section, "imagination.optimism") && !lists(&section, "tau"),
        "{section}"
    );
    // The preset, not the default.
    let of_sac = place.succeed(&["settings", "--method", "sac"]);
    let delay = of_sac
        .lines()
        .find(|line| line.starts_with("policy_delay "));
    assert_eq!(delay.unwrap().split_whitespace().nth(1), Some("1"));
}

#[test]
fn a_key_is_described() {
    let place = Place::new();
    for (arguments, parts) in [
        (
            &["imagination.noise_bound"][..],
            &[
                "default  1.0",
                "preset   0.5 for ma-td3",
                "a number from 0 to 10",
                "imagines no other",
            ][..],
        ),
        (
            &["imagination.decay_rate"],
            &[
                "while imagination.noise_decay = true",
                "above 0 and at most 1",
                "goes on with the value it has",
            ],
        ),
        (&["task"], &["(required)", "mamf envs"]),
        (&["doubled_actions.period"], &["(not set)"]),
        (&["steps"], &["3000000", "may go on with another value\n"]),
        (
            &["policy_delay", "--method", "ddpg"],
            &["preset   1 for ddpg"],
        ),
    ] {
        let printed = place.succeed(&[&["settings"], arguments].concat());
        for part in parts {
            assert!(printed.contains(part), "{part}: {printed}");
        }
    }
}

#[test]
fn what_is_not_there_is_refused_and_the_nearest_named() {
    let place = Place::new();
    let refuse = |arguments: &[&str], parts: &[&str]| {
        place.refuse(2, &[&["settings"], arguments].concat(), parts);
    };
    refuse(
        &["target_fliter"],
        &["`target_fliter`", "`imagination.target_filter`"],
    );
    refuse(&["--method", "td4"], &["td4", "`td3`"]);
    refuse(&["steps", "--markdown"], &["--markdown"]);
}
