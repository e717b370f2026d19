//! `mamf compare`, end to end, on curves whose figures are known.

use crate::common::{Place, messages};
use serde_json::Value;

const HEADER: &str =
    "step,episodes,return_mean,return_std,return_min,return_max,length_mean,success_rate\n";

/// A run directory with the given returns, an evaluation every ten steps.
fn run(place: &Place, directory: &str, task: &str, seed: u64, returns: &[f64]) {
    let mut curve = String::from(HEADER);
    for (i, value) in returns.iter().enumerate() {
        curve += &format!("{},10,{value:?},1.0,0.0,2.0,50.0,\n", 10 * i);
    }
    std::fs::create_dir_all(place.path(directory)).unwrap();
    let steps = 10 * (returns.len() - 1);
    let config = format!("task = \"{task}\"\nseed = {seed}\nsteps = {steps}\nother = 1\n");
    place.write(&format!("{directory}/config.toml"), config);
    place.write(&format!("{directory}/eval.csv"), curve);
}

/// Two tasks, two seeds. A's final values are 6 and 8 in T, 1 and 3 in U, B's 4 and 4, 2 and 3.
fn two_sides(place: &Place) {
    for (directory, task, seed, returns) in [
        ("x/t/a/seed-0", "T", 0, [0.0, 4.0, 6.0]),
        ("x/t/a/seed-5", "T", 5, [0.0, 2.0, 8.0]),
        ("x/t/b/seed-0", "T", 0, [0.0, 1.0, 4.0]),
        ("x/t/b/seed-5", "T", 5, [0.0, 5.0, 4.0]),
        ("x/u/a/seed-0", "U", 0, [-1.0, 0.0, 1.0]),
        ("x/u/a/seed-1", "U", 1, [-1.0, 1.0, 3.0]),
        ("x/u/b/seed-0", "U", 0, [-1.0, 2.0, 2.0]),
        ("x/u/b/seed-1", "U", 1, [-1.0, 1.0, 3.0]),
    ] {
        run(place, directory, task, seed, &returns);
    }
}

fn json(place: &Place, arguments: &[&str]) -> Value {
    let mut all = vec!["compare", "x/*/a", "x/*/b", "--json"];
    all.extend(arguments);
    serde_json::from_str(&place.succeed(&all)).unwrap()
}

/// Both ends of the interval of a task's final values, to three digits behind the point.
fn interval(task: &Value) -> [f64; 2] {
    let interval = &task["final_value"]["difference"]["interval"];
    ["low", "high"].map(|end| (1000.0 * interval[end].as_f64().unwrap()).round() / 1000.0)
}

#[test]
fn figures_are_those_of_the_pairs() {
    let place = Place::new();
    two_sides(&place);
    let compared = json(&place, &["--threshold", "U=1.5"]);
    let [t, u] = [&compared["tasks"][0], &compared["tasks"][1]];
    assert_eq!((&t["task"], &u["task"]), (&"T".into(), &"U".into()));
    assert_eq!(t["seeds"], serde_json::json!([0, 5]));
    assert_eq!(t["final_value"]["a"], 7.0);
    assert_eq!(t["final_value"]["b"], 4.0);
    assert_eq!(t["final_value"]["difference"]["value"], 3.0);
    // The differences are 2 and 4: 3 +- 12.706 x 1.
    assert_eq!(interval(t), [-9.706, 15.706]);
    assert_eq!(interval(u), [-6.853, 5.853]);
    assert_eq!(t["final_value"]["improvement"]["value"], 1.0);
    assert_eq!(t["final_value"]["won"], 2);
    // Trapezoids: A (2 + 5) / 2 and (1 + 5) / 2, B (0.5 + 2.5) / 2 and (2.5 + 4.5) / 2.
    assert_eq!(t["area"]["a"], 3.25);
    assert_eq!(t["area"]["b"], 2.5);
    // The lower final value, 4, is reached by A after 10 and 20 steps, by B after 20 and 10.
    assert_eq!(t["threshold"], 4.0);
    assert_eq!(t["steps_to_threshold"]["a"], 15.0);
    assert_eq!(t["steps_to_threshold"]["b"], 15.0);
    assert_eq!(t["reached"], serde_json::json!([2, 2]));

    assert_eq!(u["final_value"]["difference"]["value"], -0.5);
    // 1 beats none; 3 beats 2 and equals 3.
    assert_eq!(u["final_value"]["improvement"]["value"], 1.5 / 4.0);
    assert_eq!(u["final_value"]["won"], 0);
    // 1.5 is not reached by A's run 0, which counts with its 20 steps; fewer steps are better.
    assert_eq!(u["steps_to_threshold"]["a"], 20.0);
    assert_eq!(u["steps_to_threshold"]["b"], 15.0);
    assert_eq!(u["steps_to_threshold"]["won"], 0);
    assert_eq!(u["reached"], serde_json::json!([1, 2]));

    // The better side gained 7 in T, 3.5 in U.
    let all = compared["all"]["final_value"]["value"].as_f64().unwrap();
    assert!((all - (3.0 / 7.0 - 0.5 / 3.5) / 2.0).abs() < 1e-12, "{all}");
    assert_eq!(compared["all"]["pairs"], 4);
    assert_eq!(compared["notes"], serde_json::json!([]));

    let table = place.succeed(&["compare", "x/*/a", "x/*/b", "--threshold", "U=1.5"]);
    for part in [
        "A  x/*/a\nB  x/*/b\n",
        "T: 2 pairs (seeds 0, 5), 20 steps\n",
        "+3.00  -9.71 to +15.71",
        "1.00 (1.00 to 1.00)   2 of 2",
        "1.50 is reached by 1 of 2 runs of A, 2 of 2 of B; the others count with all their steps\n",
        "all 2 tasks: 4 pairs",
    ] {
        assert!(table.contains(part), "`{part}` is not in:\n{table}");
    }
    assert_eq!(
        table,
        place.succeed(&["compare", "x/*/a", "x/*/b", "--threshold", "U=1.5"])
    );
}

#[test]
fn the_exit_code_tells_whether_a_margin_holds() {
    let place = Place::new();
    two_sides(&place);
    let compare = |arguments: &[&str]| {
        let mut all = vec!["compare", "x/*/a", "x/*/b"];
        all.extend(arguments);
        let output = place.run(&all);
        (output.status.code(), messages(&output))
    };
    // The differences are 3 in T, -0.5 in U, of B's 4 and 2.5.
    assert_eq!(compare(&["--at-least", "-0.5"]), (Some(0), String::new()));
    assert_eq!(compare(&["--at-least=-20%"]), (Some(0), String::new()));
    let (code, said) = compare(&["--at-least", "-19%"]);
    assert_eq!(code, Some(1));
    assert_eq!(
        said,
        "not met: U: A - B is -0.5000, at least -0.4750 is asked for\n"
    );
    let compared = place.run(&["compare", "x/t/a", "x/t/b", "--json", "--at-least", "9"]);
    assert_eq!(compared.status.code(), Some(1));
    let compared: Value = serde_json::from_slice(&compared.stdout).unwrap();
    assert_eq!(compared["at_least_holds"], false);
    assert!(compared["all"].is_null());
}

#[test]
fn confidence_needs_five_pairs() {
    let place = Place::new();
    // Differences 2, 3, 4, 3, 3: 3 +- 2.776 x 0.3162.
    for (seed, difference) in (0..).zip([2.0, 3.0, 4.0, 3.0, 3.0]) {
        for (side, last) in [("a", difference), ("b", 0.0)] {
            let directory = format!("x/{side}/seed-{seed}");
            run(&place, &directory, "T", seed, &[0.0, 0.0, last]);
        }
    }
    let confident = ["--confident", "--at-least"];
    let compare = |a: &str, b: &str, least: &str| {
        let output = place.run(&[&["compare", a, b], &confident[..], &[least]].concat());
        (output.status.code(), messages(&output))
    };
    assert_eq!(compare("x/a", "x/b", "2.12"), (Some(0), String::new()));
    let (code, said) = compare("x/a", "x/b", "2.13");
    assert_eq!(code, Some(1));
    let expected = "not met: T: the interval of A - B begins at 2.12, at least 2.13 is asked for\n";
    assert_eq!(said, expected);
    place.refuse(
        2,
        &[
            "compare",
            "x/a/seed-[0-3]",
            "x/b/seed-[0-3]",
            "--confident",
            "--at-least",
            "0",
        ],
        &["--confident", "T has 4 pairs", "5 or more are needed"],
    );
}

#[test]
fn curves_of_many_runs_have_the_figures_of_their_runs() {
    let place = Place::new();
    two_sides(&place);
    let found = place.succeed(&["curves", "x/t", "x/u/*", "--json"]);
    let found: Value = serde_json::from_str(&found).unwrap();
    let [t, u] = [&found["panels"][0], &found["panels"][1]];
    assert_eq!([&t["title"], &u["title"]], ["T", "U"]);
    let a = &t["lines"]["a"];
    assert_eq!(a["seeds"], serde_json::json!([0, 5]));
    assert_eq!(a["steps"], serde_json::json!([0, 10, 20]));
    assert_eq!(
        a["runs"],
        serde_json::json!([[0.0, 4.0, 6.0], [0.0, 2.0, 8.0]])
    );
    assert_eq!(a["curve"][1]["value"], 3.0);
    assert_eq!(
        [&a["final_mean"]["value"], &a["final_iqm"]["value"]],
        [7.0, 7.0]
    );
    let scores = &found["scores"];
    assert_eq!(
        scores["scales"]["T"],
        serde_json::json!({"low": 0.0, "high": 7.0})
    );
    assert_eq!(
        scores["scales"]["U"],
        serde_json::json!({"low": -1.0, "high": 2.5})
    );
    // A scores 1 in the mean of T, (2 / 3.5 + 4 / 3.5) / 2 in U.
    let mean = scores["methods"]["a"]["mean"]["value"].as_f64().unwrap();
    assert!((mean - (1.0 + 3.0 / 3.5) / 2.0).abs() < 1e-12, "{mean}");
    let over = |i: usize| &scores["improvements"][i];
    assert_eq!([&over(0)["method"], &over(0)["over"]], ["a", "b"]);
    // All of T; 1.5 of 4 of U, the other way round 2.5.
    assert_eq!(over(0)["probability"]["value"], (1.0 + 1.5 / 4.0) / 2.0);
    assert_eq!(over(1)["probability"]["value"], (0.0 + 2.5 / 4.0) / 2.0);

    let table = place.succeed(&["curves", "x/*/*"]);
    let row = "T     a           2     20        7.00  -5.71 to 19.71        7.00  -5.71 to 19.71";
    assert!(table.contains(row), "`{row}` is not in:\n{table}");
    place.refuse(2, &["curves", "none"], &["none: no such directory"]);
}

#[test]
fn a_single_pair_has_no_interval() {
    let place = Place::new();
    two_sides(&place);
    let sides = ["compare", "x/t/a/seed-0", "x/t/b/seed-0"];
    let table = place.succeed(&sides);
    assert!(table.contains("T: 1 pair (seed 0)"), "{table}");
    assert!(
        table.contains("note: a single pair has no interval"),
        "{table}"
    );
    let with = |more: &[&'static str]| [&sides[..], more].concat();
    assert!(
        place
            .succeed(&with(&["--at-least", "2"]))
            .contains("+2.00  -")
    );
    place.refuse(
        2,
        &with(&["--at-least", "2", "--confident"]),
        &["--confident", "T has 1 pair;", "5 or more"],
    );
}

#[test]
fn what_is_uneven_is_said() {
    let place = Place::new();
    two_sides(&place);
    run(&place, "x/t/b/seed-5", "T", 5, &[0.0, 5.0]);
    place.write(
        "x/t/b/seed-5/config.toml",
        "task = \"T\"\nseed = 5\nsteps = 20\n",
    );
    let compared = json(&place, &[]);
    let t = &compared["tasks"][0];
    assert_eq!(t["steps"], 10);
    assert_eq!(t["final_value"]["a"], 3.0);
    assert_eq!(t["final_value"]["b"], 3.0);
    let table = place.succeed(&["compare", "x/*/a", "x/*/b"]);
    for part in [
        "note: T: compared up to step 10, where x/t/b/seed-5 ends; others go on to 20\n",
        "note: x/t/b/seed-5: evaluated up to step 10 of 20\n",
    ] {
        assert!(table.contains(part), "`{part}` is not in:\n{table}");
    }
}

#[test]
fn runs_that_do_not_pair_are_named() {
    let place = Place::new();
    two_sides(&place);
    run(&place, "x/t/a/seed-7", "T", 7, &[0.0, 1.0, 1.0]);
    place.refuse(
        2,
        &["compare", "x/*/a", "x/*/b"],
        &[
            "x/t/a/seed-7 (T seed 7)",
            "without a partner",
            "--paired-only",
        ],
    );
    let table = place.succeed(&["compare", "x/*/a", "x/*/b", "--paired-only"]);
    assert!(table.contains("T: 2 pairs (seeds 0, 5)"), "{table}");
    assert!(
        table.contains("note: left out, for they have no partner: x/t/a/seed-7"),
        "{table}"
    );
    place.refuse(
        2,
        &["compare", "x/t/a", "x/u/b"],
        &[
            "no two runs",
            "A has T seed 0, T seed 5, T seed 7; B has U seed 0, U seed 1",
        ],
    );
    place.refuse(
        2,
        &["compare", "x/t", "x/u/b"],
        &[
            "x/t: two runs of T seed 0: x/t/a/seed-0 and x/t/b/seed-0",
            "one method",
        ],
    );
    place.refuse(
        2,
        &["compare", "x/t/a", "x/t/*/"],
        &["x/t/*/: two runs of T seed 0"],
    );
    place.refuse(
        2,
        &["compare", "x/t/b", "x/t/b"],
        &["x/t/b/seed-0", "both sides"],
    );
}

#[test]
fn what_is_wrong_is_named() {
    let place = Place::new();
    two_sides(&place);
    std::fs::create_dir(place.path("empty")).unwrap();
    let sides = ["compare", "x/t/a", "x/t/b"];
    let refuse = |arguments: &[&str], parts: &[&str]| {
        place.refuse(2, &[&sides[..], arguments].concat(), parts);
    };
    refuse(
        &["--threshold", "V=1"],
        &["--threshold V", "compared are T"],
    );
    refuse(
        &["--threshold", "1", "--threshold", "2"],
        &["--threshold", "all tasks", "1 and 2"],
    );
    refuse(
        &["--metric", "success"],
        &["eval.csv", "success_rate", "task T"],
    );
    place.refuse(
        2,
        &["compare", "empty", "x/t/b"],
        &["empty: no run there", "eval.csv"],
    );
    place.refuse(
        2,
        &["compare", "none", "x/t/b"],
        &["none: no such directory", "pattern"],
    );
    place.refuse(2, &["compare", "x[", "x/t/b"], &["x[", "not a pattern"]);

    let (config, curve) = ("x/t/a/seed-0/config.toml", "x/t/a/seed-0/eval.csv");
    let whole = place.read(curve);
    let broken = |text: &str, parts: &[&str]| {
        place.write(curve, text);
        refuse(&[], &[&[curve], parts].concat());
    };
    broken("", &["no evaluation", "cut short"]);
    broken(HEADER, &["no evaluation"]);
    broken(whole.trim_end(), &["line 4", "cut short"]);
    broken(&whole[..whole.len() - 9], &["line 4", "cut short"]);
    broken(
        &whole.replace(",50.0,\n", ",50.0\n"),
        &["line 2", "7 fields instead of 8"],
    );
    broken(
        &whole.replace("10,10,4.0", "10,10,four"),
        &["line 3", "return_mean", "invalid float"],
    );
    broken(
        &whole.replace("10,10,4.0", "10,10,nan"),
        &["line 3", "return_mean NaN is not finite"],
    );
    broken(
        &whole.replace("20,10,6.0", "10,10,6.0"),
        &["line 4", "step 10 after 10", "grow"],
    );
    broken(
        &whole.replace("success_rate", "score"),
        &[
            "its columns are step,",
            ",score, those of eval.csv are step,",
            "another version",
        ],
    );
    place.write("x/t/a/seed-0/run.json", "{\"mamf\": \"9.1.0\"}");
    broken(
        &whole.replace("success_rate", "score"),
        &["mamf 9.1.0 by run.json, this is mamf 0."],
    );
    place.write(curve, &whole);

    place.write(config, "task = \"T\"\nsteps = 20\n");
    refuse(&[], &[config, "seed"]);
    std::fs::remove_file(place.path(config)).unwrap();
    refuse(&[], &[config, "No such file"]);
}
