//! `mamf sweep --slurm`: the script, its submission, and a real job array where Slurm takes one.

use crate::common::{Place, SMALL, config, messages, skipped, stderr};
use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// An experiment of four small runs: two variants and two seeds of one configuration.
fn experiment(place: &Place, settings: &[&str]) {
    place.write("small.toml", fs::read(config("reacher")).unwrap());
    let mut text = String::from("configs = [\"small.toml\"]\nseeds = [0, 1]\n[settings]\n");
    let key = |setting: &str| setting.split_once('=').unwrap().0.to_owned();
    let kept = SMALL.iter();
    let kept = kept.filter(|small| settings.iter().all(|other| key(other) != key(small)));
    for setting in kept.chain(settings) {
        let (key, value) = setting.split_once('=').unwrap();
        text += &format!("\"{key}\" = {value}\n");
    }
    text += "[variants.mamf]\nmethod = \"mamf\"\n[variants.td3]\nmethod = \"td3\"\n";
    place.write("four.toml", text);
}

const RUNS: [&str; 4] = ["mamf/seed-0", "mamf/seed-1", "td3/seed-0", "td3/seed-1"];

/// Enough steps for a run to be caught in the middle, and checkpoints to go on from.
const LONG: [&str; 3] = ["steps=4000", "evaluation.every=500", "checkpoint.every=200"];

const PRINT: [&str; 4] = ["sweep", "four.toml", "--slurm", "--print"];

fn has_line(text: &str, line: &str) -> bool {
    text.lines().any(|found| found == line)
}

/// Puts a program into the folder `bin` of a place.
fn install(place: &Place, program: &str, text: &str) {
    let path = place.path("bin");
    fs::create_dir_all(&path).unwrap();
    let path = path.join(program);
    fs::write(&path, text).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
}

/// Runs `mamf` with the folder `bin` of its place before all others on PATH.
fn run_with_bin(place: &Place, arguments: &[&str]) -> Output {
    let path = std::env::var("PATH").unwrap();
    let path = format!("{}:{path}", place.path("bin").display());
    place.command(arguments).env("PATH", path).output().unwrap()
}

fn wait_until(what: &str, patience: Duration, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < patience, "not after {patience:?}: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn the_script_is_printed_and_nothing_else_is_done() {
    let place = Place::new();
    experiment(&place, &[]);
    let before = place.contents("");
    let script = place.succeed(&PRINT);
    let here = place.path("").canonicalize().unwrap();
    let here = here.to_str().unwrap().trim_end_matches('/');
    for line in [
        "#SBATCH --job-name=mamf-four".to_owned(),
        "#SBATCH --array=0-3".to_owned(),
        "#SBATCH --signal=B:USR1@120".to_owned(),
        "#SBATCH --requeue".to_owned(),
        "#SBATCH --open-mode=append".to_owned(),
        "#SBATCH --cpus-per-task=1".to_owned(),
        format!("#SBATCH --chdir={here}"),
        format!("#SBATCH --output={here}/runs/four/slurm/%A_%a.log"),
        format!(
            "{} sweep four.toml --task-index \"$SLURM_ARRAY_TASK_ID\" &",
            env!("CARGO_BIN_EXE_mamf")
        ),
    ] {
        assert!(has_line(&script, &line), "{line} is not in {script}");
    }
    let options = [
        "--partition=long",
        "--time=1-12",
        "--mem=4G",
        "--account=lab",
        "--qos=low",
        "--cpus-per-task=2",
        "--constraint=a&b",
        "--job-name=my job",
        "--max-parallel=2",
        "--signal-before=300",
        "--sbatch=--nice=5",
    ];
    let script = place.succeed(&[&PRINT[..], &options, &["--only", "*/seed-1"]].concat());
    for line in [
        "--partition=long",
        "--time=1-12",
        "--mem=4G",
        "--account=lab",
        "--qos=low",
        "--cpus-per-task=2",
        "--constraint=\"a&b\"",
        "--job-name=\"my job\"",
        "--array=1,3%2",
        "--signal=B:USR1@300",
        "--nice=5",
    ] {
        let line = format!("#SBATCH {line}");
        assert!(has_line(&script, &line), "{line} is not in {script}");
    }
    assert!(!script.contains("--only"), "{script}");
    assert!(place.contents("") == before);
}

#[test]
fn options_that_are_wrong_are_refused() {
    let place = Place::new();
    experiment(&place, &[]);
    for (options, parts) in [
        (
            &["--time", "1h"][..],
            &["'1h'", "--time", "HOURS:MINUTES:SECONDS"][..],
        ),
        (&["--time", "-5"], &["'-5'", "--time"]),
        (
            &["--time", "3"],
            &["--time 3", "--signal-before 120", "more than 180 seconds"],
        ),
        (
            &["--signal-before", "0"],
            &["'0'", "--signal-before", "1..="],
        ),
        (&["--max-parallel", "0"], &["'0'", "--max-parallel", "1..="]),
        (
            &["--cpus-per-task", "-1"],
            &["'-1'", "--cpus-per-task", "1..="],
        ),
        (&["--mem", "4GB"], &["'4GB'", "--mem", "for example 4G"]),
        (&["--partition", "a\nb"], &["--partition", "newline"]),
        (&["--job-name", ""], &["--job-name", "a name"]),
        (
            &["--sbatch", "nodelist=n1"],
            &["--sbatch", "--sbatch=--nodelist=n1"],
        ),
        (&["--dry-run"], &["--slurm", "--dry-run"]),
        (&["--jobs", "2"], &["--slurm", "--jobs"]),
        (&["--task-index", "2"], &["--slurm", "--task-index"]),
        (&["--set", "discount=\n0.5"], &["a newline", "discount"]),
    ] {
        place.refuse(2, &[&PRINT[..], options].concat(), parts);
    }
    for option in [
        "--print",
        "--partition=a",
        "--time=90",
        "--signal-before=60",
        "--cpus-per-task=2",
        "--mem=4G",
        "--max-parallel=2",
        "--account=a",
        "--qos=a",
        "--constraint=a",
        "--job-name=a",
        "--sbatch=--x",
    ] {
        place.refuse(2, &["sweep", "four.toml", option], &["--slurm"]);
    }
}

#[test]
fn without_sbatch_nothing_is_written_and_print_is_recommended() {
    let place = Place::new();
    experiment(&place, &[]);
    let before = place.contents("");
    let mut command = place.command(&PRINT[..3]);
    let output = command.env("PATH", "/nowhere").output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let said = stderr(&output);
    assert!(said.contains("no sbatch on PATH"), "{said}");
    assert!(said.contains("--print shows the script"), "{said}");
    assert!(place.contents("") == before);
}

#[test]
fn only_runs_that_are_left_are_submitted() {
    let place = Place::new();
    experiment(&place, &[]);
    let submit = ["sweep", "four.toml", "--slurm", "--max-parallel", "4"];
    install(
        &place,
        "sbatch",
        "#!/bin/sh\necho \"$*\" >arguments; cp \"$2\" submitted; echo '77;north'\n",
    );
    let one = ["sweep", "four.toml", "--only", "*/mamf/seed-1"];
    assert_eq!(place.run(&one).status.code(), Some(0));
    let output = run_with_bin(&place, &submit);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    for part in [
        "job 77: 3 of 4 runs submitted, 1 finished already; script: runs/four/four.sbatch\n",
        "squeue --jobs 77 ",
        " runs/four/slurm/77_*.log ",
        "scancel 77 ",
    ] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    assert_eq!(
        place.read("arguments"),
        "--parsable runs/four/four.sbatch\n"
    );
    let script = place.read("submitted");
    assert!(has_line(&script, "#SBATCH --array=0,2-3%4"), "{script}");
    assert_eq!(place.read("runs/four/four.sbatch"), script);
    assert!(place.path("runs/four/slurm").is_dir());

    // A run of other settings in the place of one: the others are submitted.
    let other = [
        "sweep",
        "four.toml",
        "--task-index",
        "3",
        "--set",
        "discount=0.5",
    ];
    assert_eq!(place.run(&other).status.code(), Some(0));
    let output = run_with_bin(&place, &submit);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = messages(&output);
    assert!(said.contains("left out: small/td3/seed-1: "), "{said}");
    assert!(said.contains("`discount` is 0.5, not 0.98"), "{said}");
    assert!(has_line(&place.read("submitted"), "#SBATCH --array=0,2%4"));

    install(
        &place,
        "sbatch",
        "#!/bin/sh\necho 'no such partition' >&2; exit 3\n",
    );
    let output = run_with_bin(&place, &submit);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = stderr(&output);
    assert!(
        said.contains("sbatch refused runs/four/four.sbatch: no such partition"),
        "{said}"
    );
    assert!(output.stdout.is_empty(), "{output:?}");

    // All are finished: there is nothing to submit, with sbatch or without.
    let finished = ["--only", "*/mamf/seed-1"];
    let output = run_with_bin(&place, &[&submit[..], &finished].concat());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        said.contains("nothing is left to be submitted, 1 of 1 runs are finished"),
        "{said}"
    );
    let output = place.run(&[&PRINT[..], &finished].concat());
    assert_eq!(
        (output.status.code(), &output.stdout[..]),
        (Some(0), &b""[..])
    );
}

/// A `sbatch` that keeps what it is given, and of the environment what sbatch would take options from.
const KEEPS: &str = "#!/bin/sh\nenv | grep -e ^SBATCH_ -e ^SLURM_CLUSTERS= >environment\ncp \"$2\" submitted; echo 77\n";

#[test]
fn variables_of_sbatch_decide_nothing_and_are_told() {
    let place = Place::new();
    experiment(&place, &[]);
    install(&place, "sbatch", KEEPS);
    let path = std::env::var("PATH").unwrap();
    let path = format!("{}:{path}", place.path("bin").display());
    let mut command = place.command(&["sweep", "four.toml", "--slurm", "--time", "60"]);
    let set = [
        ("SBATCH_TIMELIMIT", "1"),
        ("SBATCH_NO_REQUEUE", "1"),
        ("SBATCH_ARRAY_INX", "0-99"),
        ("SLURM_CLUSTERS", "elsewhere"),
    ];
    let output = command.env("PATH", path).envs(set).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(place.read("environment"), "");
    let script = place.read("submitted");
    for line in ["--time=60", "--requeue", "--array=0-3"] {
        assert!(has_line(&script, &format!("#SBATCH {line}")), "{script}");
    }
    let said = messages(&output);
    for (name, value) in set {
        assert!(said.contains(&format!("{name}={value} ")), "{name}: {said}");
    }
}

#[test]
fn a_run_numbered_above_what_the_cluster_takes_is_submitted_all_the_same() {
    let place = Place::new();
    experiment(&place, &[]);
    install(
        &place,
        "scontrol",
        "#!/bin/sh\necho 'MaxArraySize            = 2'\n",
    );
    let print = |more: &[&str]| run_with_bin(&place, &[&PRINT[..], more].concat());
    let output = print(&["--only", "*/td3/seed-1"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let script = String::from_utf8(output.stdout).unwrap();
    assert!(has_line(&script, "#SBATCH --array=0"), "{script}");
    // Element 0 makes run 3.
    let output = element(&place, &script, 0).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(place.path("runs/four/small/td3/seed-1/eval.csv").exists());
    assert!(!place.path("runs/four/small/mamf").exists());

    install(
        &place,
        "scontrol",
        "#!/bin/sh\necho 'MaxArraySize            = 2'\n",
    );
    let output = print(&[]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let said = messages(&output);
    for part in ["3 runs", "MaxArraySize", "--only"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

/// Runs a printed script as Slurm would run an element of its array, with a `scontrol` that notes what it is
/// asked.
fn element(place: &Place, script: &str, index: usize) -> Child {
    place.write("script", script);
    install(place, "scontrol", "#!/bin/sh\necho \"$*\" >>asked\n");
    let path = std::env::var("PATH").unwrap();
    let mut command = Command::new("bash");
    let command = command.arg("script").current_dir(place.path(""));
    let command = command.env("PATH", format!("{}:{path}", place.path("bin").display()));
    let command = command
        .env("SLURM_ARRAY_JOB_ID", "7")
        .env("SLURM_CPUS_PER_TASK", "1");
    let command = command.env("SLURM_ARRAY_TASK_ID", index.to_string());
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

#[test]
fn each_element_makes_the_run_that_the_command_line_means() {
    let place = Place::new();
    experiment(&place, &[]);
    fs::create_dir(place.path("it's odd")).unwrap();
    for file in ["small.toml", "four.toml"] {
        fs::rename(place.path(file), place.path("it's odd").join(file)).unwrap();
    }
    let words = [
        "it's odd/four.toml",
        "--out",
        "my \"runs\" $HOME",
        "--steps",
        "300",
        "--seeds",
        "5",
        "7",
        "--set",
        "networks.hidden=[16, 16]",
        "--set",
        "discount=0.5",
    ];
    let script = place.succeed(&[&["sweep"], &words[..], &["--slurm", "--print"]].concat());
    let output = element(&place, &script, 3).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let alone = ["--out", "alone", "--task-index", "3"];
    let mut words = [&["sweep"], &words[..], &alone].concat();
    words.drain(2..4);
    assert_eq!(place.run(&words).status.code(), Some(0));
    let run = place.path("my \"runs\" $HOME/small/td3/seed-7");
    for file in ["train.csv", "eval.csv"] {
        let made = fs::read_to_string(run.join(file)).unwrap();
        assert_eq!(made, place.read(&format!("alone/small/td3/seed-7/{file}")));
    }
    let settings = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(
        has_line(&settings, "threads = 1"),
        "Slurm gives one core: {settings}"
    );
    assert!(!place.path("asked").exists());
}

fn signal(process: u32, name: &str) {
    let kill = format!("kill -{name} {process}");
    assert!(
        Command::new("sh")
            .args(["-c", &kill])
            .status()
            .unwrap()
            .success()
    );
}

#[test]
fn the_signal_before_the_limit_requeues_and_an_end_from_outside_does_not() {
    let place = Place::new();
    experiment(&place, &LONG);
    let out = ["--out", "here"];
    let script = place.succeed(&[&PRINT[..], &out].concat());
    let eval = place.path("here/small/td3/seed-0/eval.csv");
    for (signals, requeued) in [
        (&["USR1", "USR1"][..], true),
        (&["TERM"], false),
        (&["USR1", "TERM"], false),
    ] {
        let began = eval.exists();
        let child = element(&place, &script, 2);
        wait_until("the run goes", Duration::from_secs(60), || {
            if began {
                place.path("here/small/td3/seed-0/run.lock").exists()
            } else {
                eval.exists()
            }
        });
        for name in signals {
            signal(child.id(), name);
        }
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(75), "{output:?}");
        let asked = fs::read_to_string(place.path("asked")).unwrap_or_default();
        let expected = if requeued { "requeue 7_2\n" } else { "" };
        assert_eq!(asked, expected, "{signals:?}: {output:?}");
        let _ = fs::remove_file(place.path("asked"));
    }
    let output = element(&place, &script, 2).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let plain = ["sweep", "four.toml", "--out", "plain", "--task-index", "2"];
    assert_eq!(place.run(&plain).status.code(), Some(0));
    for file in ["train.csv", "eval.csv"] {
        let name = format!("small/td3/seed-0/{file}");
        assert!(
            place.read(&format!("here/{name}")) == place.read(&format!("plain/{name}")),
            "{file}"
        );
    }
    // An element whose run is finished ends at once, with nothing written.
    let before = place.contents("here");
    let output = element(&place, &script, 2).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(place.contents("here") == before);
}

#[test]
fn a_requeued_job_waits_for_the_process_it_had_before() {
    let place = Place::new();
    experiment(&place, &[]);
    let one = ["sweep", "four.toml", "--task-index", "0"];
    assert_eq!(place.run(&one).status.code(), Some(0));
    let longer = [&one[..], &["--steps", "450"]].concat();
    let lock = File::create(place.path("runs/four/small/mamf/seed-0/run.lock")).unwrap();
    fs::write(
        place.path("runs/four/small/mamf/seed-0/run.lock"),
        "1 on n1\n",
    )
    .unwrap();
    lock.lock().unwrap();
    // The first start of a job is refused, as that of anybody else.
    let output = place.run(&longer);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(
        stderr(&output).contains("process 1 on n1 is working on this run"),
        "{output:?}"
    );
    let mut command = place.command(&longer);
    let command = command.env("SLURM_RESTART_COUNT", "1");
    let child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(1));
    drop(lock);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = messages(&output);
    assert!(
        said.contains("waiting: ") && said.contains("process 1 on n1"),
        "{said}"
    );
    assert!(said.contains("goes on from step 400"), "{said}");
}

/// This host, if it is a node of Slurm that takes jobs.
fn node() -> Option<String> {
    let said = |program: &str, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output().ok()?;
        let said = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then_some(said)
    };
    let host = said("hostname", &["-s"])?;
    let state = said(
        "sinfo",
        &["--noheader", "--Node", "--nodes", &host, "--format", "%t"],
    )?;
    let ready = state.lines().any(|state| ["idle", "mix"].contains(&state));
    ready.then_some(host)
}

/// A job of Slurm, cancelled at the end of the test if it is not over.
struct Job(String);

impl Job {
    /// Submits what is left of the experiment; `expected` is what is said of its runs.
    fn submit(place: &Place, node: &str, expected: &str) -> Job {
        // In a test there is one host, and no folder that others share.
        let node = format!("--sbatch=--nodelist={node}");
        let output = place.run(&["sweep", "four.toml", "--slurm", "--time", "60", &node]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let said = String::from_utf8(output.stdout).unwrap();
        assert!(said.contains(expected), "{said}");
        let job = said
            .strip_prefix("job ")
            .and_then(|said| said.split_once(':'));
        Job(job.unwrap().0.to_owned())
    }

    /// State of each element that is not over, as `<job>_<index> <state>`.
    fn states(&self) -> String {
        let mut command = Command::new("squeue");
        let command = command.args([
            "--noheader",
            "--array",
            "--format",
            "%i %T",
            "--jobs",
            &self.0,
        ]);
        String::from_utf8(command.output().unwrap().stdout).unwrap()
    }

    fn element(&self, index: usize) -> String {
        format!("{}_{index}", self.0)
    }

    fn log(&self, place: &Place, index: usize) -> String {
        let log = place
            .path("runs/four/slurm")
            .join(format!("{}.log", self.element(index)));
        fs::read_to_string(log).unwrap_or_default()
    }

    /// Waits until an element is in the middle of its run, with a checkpoint.
    fn wait_for_the_middle(&self, place: &Place, index: usize) {
        let run = place.path("runs/four/small").join(RUNS[index]);
        let running = format!("{} RUNNING", self.element(index));
        wait_until(&running, PATIENCE, || {
            run.join("checkpoints/last/checkpoint.json").exists()
                && has_line(&self.states(), &running)
        });
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        let _ = Command::new("scancel").args(["--quiet", &self.0]).status();
    }
}

/// Slurm holds a requeued job for two minutes unless its configuration says less.
const PATIENCE: Duration = Duration::from_secs(600);

fn slurm(program: &str, arguments: &[&str]) {
    let output = Command::new(program).args(arguments).output().unwrap();
    assert!(
        output.status.success(),
        "{program} {arguments:?}: {output:?}"
    );
}

#[test]
fn a_real_array_ends_with_the_same_bytes_however_it_is_disturbed() {
    let Some(node) = node() else {
        skipped("no Slurm here (scripts/slurm_local.sh sets one up)");
        return;
    };
    let place = Place::new();
    experiment(&place, &LONG);
    let job = Job::submit(&place, &node, "4 of 4 runs submitted, 0 finished already");

    job.wait_for_the_middle(&place, 0);
    slurm("scontrol", &["requeue", &job.element(0)]);
    // The signal that comes before a time limit. This program may try for minutes what it has already done.
    job.wait_for_the_middle(&place, 1);
    let mut scancel = Command::new("scancel");
    let scancel = scancel.args(["--signal", "USR1", "--batch", &job.element(1)]);
    let mut scancel = scancel.stderr(Stdio::null()).spawn().unwrap();
    let requeued = format!(
        "the time limit is near: {} is saved and requeued",
        job.element(1)
    );
    wait_until(&requeued, PATIENCE, || {
        has_line(&job.log(&place, 1), &requeued)
    });
    let _ = scancel.kill();
    scancel.wait().unwrap();
    // Who cancels an element wants it to end.
    job.wait_for_the_middle(&place, 2);
    slurm("scancel", &[&job.element(2)]);

    wait_until("the array is over", PATIENCE, || job.states().is_empty());
    for index in [0, 1] {
        let log = job.log(&place, index);
        assert!(log.contains(": goes on from step "), "{log}");
        assert!(log.ends_with("1 of 1 runs finished: runs/four\n"), "{log}");
    }
    let log = job.log(&place, 2);
    assert!(!log.contains(": finished"), "{log}");

    let rest = Job::submit(&place, &node, "1 of 4 runs submitted, 3 finished already");
    wait_until("the rest is over", PATIENCE, || rest.states().is_empty());
    let log = rest.log(&place, 2);
    assert!(log.contains(": goes on from step "), "{log}");

    let output = place.run(&["sweep", "four.toml", "--out", "plain"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    for run in RUNS {
        for file in ["train.csv", "eval.csv"] {
            let name = format!("small/{run}/{file}");
            let (made, plain) = (format!("runs/four/{name}"), format!("plain/{name}"));
            assert!(place.read(&made) == place.read(&plain), "{name} differs");
        }
    }
    assert_eq!(
        place.succeed(&["sweep", "four.toml", "--slurm"]),
        "nothing is left to be submitted, 4 of 4 runs are finished: runs/four\n"
    );
}
