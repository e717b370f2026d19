//! `mamf envs` lists the tasks and describes each.

use assert_cmd::Command;
use mamf::env;

fn envs(arguments: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("mamf").unwrap();
    command.arg("envs").args(arguments).assert()
}

#[test]
fn every_task_is_listed_and_described() {
    let output = envs(&[]).success().get_output().stdout.clone();
    let list = String::from_utf8(output).unwrap();
    for id in env::ids() {
        assert!(list.contains(id), "{list}");
        let output = envs(&[id]).success().get_output().stdout.clone();
        let details = String::from_utf8(output).unwrap();
        for part in ["observation", "reward", "terminates"] {
            assert!(details.contains(part), "{details}");
        }
    }
}

#[test]
fn an_unknown_task_is_answered_with_the_nearest() {
    let failed = envs(&["Walker-v4"]).code(2);
    let message = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(message.contains("`Walker2d-v4`"), "{message}");
}
