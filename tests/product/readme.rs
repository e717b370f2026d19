//! The tables of the README say what the program does.

use mamf::config::Method;
use mamf::env;

/// The cells of every row of every table, without quotation marks for code.
fn rows() -> Vec<Vec<String>> {
    include_str!("../../README.md")
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"))
        .map(|line| line.split(" | ").map(|cell| cell.replace('`', "")))
        .map(Iterator::collect)
        .collect()
}

#[test]
fn every_method_is_listed() {
    let rows = rows();
    for method in Method::ALL {
        let found = rows.iter().any(|row| row[0] == method.name());
        assert!(found, "{} is not in the README", method.name());
    }
}

#[test]
fn every_task_is_listed_with_its_sizes() {
    let rows = rows();
    for id in env::ids() {
        let (task, _) = env::make(id).unwrap();
        let spec = task.spec();
        // A sparse variant stands in the row of the task it varies.
        let listed = id.replace("Sparse", "");
        let row = rows.iter().find(|row| row[0] == listed);
        let row = row.unwrap_or_else(|| panic!("{id} is not in the README"));
        let sizes = [spec.obs_size, spec.action_size];
        assert_eq!(row[1..3], sizes.map(|n| n.to_string()), "{id}");
        assert_eq!(row[3], format!("±{}", spec.action_limit), "{id}");
        assert_eq!(row[4], spec.max_episode_steps.to_string(), "{id}");
        let dt: f64 = row[5].parse().unwrap();
        assert!((dt - spec.dt).abs() < 1e-9, "{id}");
    }
}
