//! `scripts/plot_curves.py`, end to end, over curves written here. Where Python or its packages are missing, these tests
//! say so and pass.

use crate::common::{Place, skipped, stderr};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const HEADER: &str =
    "step,episodes,return_mean,return_std,return_min,return_max,length_mean,success_rate";
const FIGURES: [&str; 5] = [
    "aggregate",
    "curves",
    "efficiency",
    "improvement",
    "profiles",
];

/// The Python that has what plotting needs: that of `.venv`, or the system's.
fn python() -> Option<&'static Path> {
    static FOUND: OnceLock<Option<PathBuf>> = OnceLock::new();
    let found = FOUND.get_or_init(|| {
        let own = Path::new(ROOT).join(".venv/bin/python");
        let python = if own.exists() { own } else { "python3".into() };
        let imports = "import matplotlib, numpy";
        let tried = Command::new(&python).args(["-c", imports]).output();
        tried
            .is_ok_and(|output| output.status.success())
            .then_some(python)
    });
    if found.is_none() {
        skipped("no Python with matplotlib and numpy; scripts/setup.sh --plots makes one");
    }
    found.as_deref()
}

/// Runs the script in `place`, with few resamples; it must not end in a traceback.
fn plot(python: &Path, place: &Place, arguments: &[&str]) -> Output {
    let output = Command::new(python)
        .arg(Path::new(ROOT).join("scripts/plot_curves.py"))
        .args(["--reps", "200", "--mamf", env!("CARGO_BIN_EXE_mamf")])
        .args(arguments)
        .current_dir(place.path(""))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    assert!(!stderr(&output).contains("Traceback"), "{output:?}");
    output
}

fn succeed(python: &Path, place: &Place, arguments: &[&str]) {
    let output = plot(python, place, arguments);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(stderr(&output), "");
}

/// One run as it is written: a return at each evaluation, `every` steps apart from step 0 on.
struct Run {
    task: &'static str,
    method: &'static str,
    seed: u64,
    steps: u64,
    every: u64,
    returns: Vec<f64>,
}

impl Run {
    /// A run of 20 000 steps that returns `untrained` at first, and then from `level` on half a point more
    /// each thousand steps.
    fn new(task: &'static str, method: &'static str, seed: u64, untrained: f64, level: f64) -> Run {
        let learned = (1..=20).map(|k| level + 0.5 * f64::from(k));
        Run {
            task,
            method,
            seed,
            steps: 20_000,
            every: 1000,
            returns: std::iter::once(untrained).chain(learned).collect(),
        }
    }

    fn folder(&self) -> String {
        format!("runs/{}/{}/seed-{}", self.task, self.method, self.seed)
    }

    fn csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for (step, x) in (0..).step_by(self.every as usize).zip(&self.returns) {
            text += &format!("{step},10,{x},1.5,{x},{x},100.0,\n");
        }
        text
    }

    fn write(&self, place: &Place) {
        let folder = self.folder();
        fs::create_dir_all(place.path(&folder)).unwrap();
        let Run {
            task,
            method,
            seed,
            steps,
            every,
            ..
        } = self;
        let config = format!(
            "task = \"{task}\"\nmethod = \"{method}\"\nseed = {seed}\nsteps = {steps}\n\
             [evaluation]\nevery = {every}\n"
        );
        place.write(&format!("{folder}/config.toml"), config);
        place.write(&format!("{folder}/run.json"), "{\"mamf\": \"0.1.0\"}");
        place.write(&format!("{folder}/eval.csv"), self.csv());
    }

    /// Mean of the evaluations in the last tenth of the steps.
    fn final_return(&self) -> f64 {
        let last = (self.returns.len() - 1) as f64;
        let first = (0.9 * last).ceil() as usize;
        mean(&self.returns[first..])
    }
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// Mean of the middle half.
fn iqm(x: &[f64]) -> f64 {
    let mut sorted = x.to_vec();
    sorted.sort_by(f64::total_cmp);
    let cut = x.len() / 4;
    mean(&sorted[cut..x.len() - cut])
}

/// The cells after the first ones, `names`, of a row below the heading `section`.
fn cells(table: &str, section: &str, names: &[&str]) -> Vec<String> {
    let heading = format!("\n## {section}\n");
    let (_, below) = table
        .split_once(&heading)
        .unwrap_or_else(|| panic!("no {section}"));
    let below = below.split("\n## ").next().unwrap();
    let rows = below.lines().filter_map(|line| {
        let row = line.strip_prefix("| ")?.strip_suffix(" |")?;
        Some(row.split(" | ").map(str::to_owned).collect::<Vec<_>>())
    });
    let row = rows.into_iter().find(|row| row.starts_with(&owned(names)));
    row.unwrap_or_else(|| panic!("no {names:?} in {section}"))[names.len()..].to_vec()
}

fn owned(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// The value of a cell `value [low, high]`, which must lie in its interval.
fn value(cell: &str) -> f64 {
    let (value, interval) = cell.split_once(" [").unwrap_or((cell, ""));
    let value: f64 = value.parse().unwrap_or_else(|_| panic!("{cell}"));
    if let Some(interval) = interval.split(']').next().filter(|x| !x.is_empty()) {
        let (low, high) = interval.split_once(", ").unwrap();
        let [low, high] = [low, high].map(|x| x.parse::<f64>().unwrap());
        assert!(low <= value && value <= high, "{cell}");
    }
    value
}

/// Compares to the four digits that are written.
#[track_caller]
fn agree(cell: &str, expected: f64) {
    let found = value(cell);
    let error = (found - expected).abs();
    assert!(
        error <= 6e-4 * expected.abs() + 1e-6,
        "{cell}, expected {expected}"
    );
}

const UNTRAINED: [(&str, f64); 2] = [("Hopper-v4", 20.0), ("Reacher-v4", -40.0)];

/// Five seeds of two methods on two tasks, `levels[task][method][seed]`.
fn two_by_two() -> Vec<Run> {
    let levels = [
        [
            [100.0, 210.0, 305.0, 400.0, 990.0],
            [150.0, 155.0, 250.0, 50.0, 350.0],
        ],
        [
            [-5.0, -6.0, -7.5, -18.0, -19.0],
            [-4.0, -14.5, -16.5, -20.0, -35.0],
        ],
    ];
    let mut runs = Vec::new();
    for ((task, untrained), levels) in UNTRAINED.into_iter().zip(levels) {
        for (method, levels) in ["mamf", "td3"].into_iter().zip(levels) {
            for (seed, level) in (0..).zip(levels) {
                runs.push(Run::new(task, method, seed, untrained, level));
            }
        }
    }
    runs
}

/// Final returns of a method on a task.
fn finals(runs: &[Run], task: &str, method: &str) -> Vec<f64> {
    let chosen = runs
        .iter()
        .filter(|run| run.task == task && run.method == method);
    chosen.map(Run::final_return).collect()
}

/// Normalised final returns of a method by task.
fn scores(runs: &[Run], method: &str) -> [Vec<f64>; 2] {
    UNTRAINED.map(|(task, low)| {
        let high = ["mamf", "td3"].map(|other| mean(&finals(runs, task, other)));
        let high = high[0].max(high[1]);
        let finals = finals(runs, task, method);
        finals.iter().map(|x| (x - low) / (high - low)).collect()
    })
}

#[test]
fn the_table_holds_what_the_runs_give() {
    let Some(python) = python() else { return };
    let place = Place::new();
    let runs = two_by_two();
    runs.iter().for_each(|run| run.write(&place));
    succeed(python, &place, &["runs", "--out", "figures"]);
    let table = place.read("figures/table.md");

    for (task, untrained) in UNTRAINED {
        let mut best = f64::NEG_INFINITY;
        for method in ["mamf", "td3"] {
            let row = cells(&table, "Final return", &[task, method]);
            let finals = finals(&runs, task, method);
            assert_eq!(row[..2], ["5", "20k"]);
            agree(&row[2], mean(&finals));
            agree(&row[3], iqm(&finals));
            best = best.max(mean(&finals));
            let curve = cells(&table, "Learning curves", &[task, method]);
            let at = |k: usize| {
                let chosen = runs
                    .iter()
                    .filter(|run| run.task == task && run.method == method);
                mean(&chosen.map(|run| run.returns[k]).collect::<Vec<_>>())
            };
            for (cell, k) in curve.iter().zip([5, 10, 15, 20]) {
                let (cell, step) = cell.split_once(" at ").unwrap();
                assert_eq!(step, format!("{k}k"));
                agree(cell, at(k));
            }
        }
        let scale = cells(&table, "Scale of the scores", &[task]);
        agree(&scale[0], untrained);
        agree(&scale[1], best);
    }
    for method in ["mamf", "td3"] {
        let scores = scores(&runs, method);
        let all = scores.concat();
        let means = scores.each_ref().map(|x| mean(x));
        let capped: Vec<f64> = all.iter().map(|x| x.min(1.0)).collect();
        let row = cells(&table, "Aggregate metrics", &[method]);
        // The median of two tasks is their mean.
        agree(&row[0], mean(&means));
        agree(&row[1], iqm(&all));
        agree(&row[2], mean(&all));
        agree(&row[3], 1.0 - mean(&capped));
        let profile = cells(&table, "Performance profiles", &[method]);
        for (cell, threshold) in profile.iter().zip([0.0, 0.25, 0.5, 0.75, 1.0]) {
            let above = all.iter().filter(|x| **x > threshold).count();
            agree(cell, above as f64 / all.len() as f64);
        }
    }
    let [x, y] = ["mamf", "td3"].map(|method| scores(&runs, method));
    let better = x.iter().zip(&y).flat_map(|(x, y)| {
        let pairs = x.iter().flat_map(move |x| y.iter().map(move |y| (x, y)));
        pairs.map(|(x, y)| f64::from(u8::from(x > y)))
    });
    let row = cells(&table, "Probability of improvement", &["mamf", "td3"]);
    agree(&row[0], mean(&better.collect::<Vec<_>>()));
}

#[test]
fn figures_are_whole_and_the_same_again() {
    let Some(python) = python() else { return };
    let place = Place::new();
    two_by_two().iter().for_each(|run| run.write(&place));
    succeed(python, &place, &["runs", "--out", "one"]);
    succeed(python, &place, &["runs/*/*/seed-*", "--out", "two"]);
    let mut names = vec!["table.md".to_owned()];
    for figure in FIGURES {
        names.extend(["png", "svg"].map(|kind| format!("{figure}.{kind}")));
    }
    names.sort();
    let listed: Vec<_> = place.contents("one").into_keys().collect();
    let expected: Vec<_> = names
        .iter()
        .map(|name| place.path(&format!("one/{name}")))
        .collect();
    assert_eq!(listed, expected);
    for name in names {
        let read = |out: &str| fs::read(place.path(&format!("{out}/{name}"))).unwrap();
        let bytes = read("one");
        assert!(bytes == read("two"), "{name} differs");
        if name.ends_with(".png") {
            assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
        } else if name.ends_with(".svg") {
            let text = String::from_utf8(bytes).unwrap();
            assert!(
                text.contains("<svg") && text.ends_with("</svg>\n"),
                "{name}"
            );
            let interval = if name == "curves.svg" {
                "Band: 95 % interval of Student's t."
            } else {
                "95 % stratified-bootstrap"
            };
            assert!(text.contains(interval), "{name}");
        }
    }
    let curves = place.read("one/curves.svg");
    for part in [
        "Hopper-v4",
        "Reacher-v4",
        "mamf (5 seeds)",
        "td3 (5 seeds)",
        "20k",
    ] {
        assert!(curves.contains(part), "{part}");
    }
}

#[test]
fn a_matplotlibrc_changes_no_figure() {
    let Some(python) = python() else { return };
    let place = Place::new();
    two_by_two().iter().for_each(|run| run.write(&place));
    let figures = ["runs", "--figures", "curves", "--out"];
    succeed(python, &place, &[&figures[..], &["plain"]].concat());
    let plain = |out: &str| fs::read(place.path(&format!("{out}/curves.svg"))).unwrap();
    for (out, text) in [
        ("odd", &b"lines.linewidth: 9\naxes.facecolor: red\nsavefig.dpi: 10\naxes.prop_cycle: cycler('color', ['k'])\n"[..]),
        ("broken", b"\xff\xfe: no text"),
    ] {
        // That of the working directory is the first one that matplotlib finds.
        place.write("matplotlibrc", text);
        succeed(python, &place, &[&figures[..], &[out]].concat());
        assert!(plain(out) == plain("plain"), "{out}");
    }
}

/// Three seeds of MAMF, one with half as many evaluations; two of TD3, one that is not finished; one of SAC, on one
/// task of two.
fn uneven() -> Vec<Run> {
    let mut runs = Vec::new();
    for (task, untrained) in UNTRAINED {
        for seed in 0..3 {
            runs.push(Run::new(task, "mamf", seed, untrained, 50.0));
        }
        for seed in 0..2 {
            runs.push(Run::new(task, "td3", seed, untrained, 30.0));
        }
    }
    runs.push(Run::new("Hopper-v4", "sac", 0, 20.0, 40.0));
    runs[2].every = 2000;
    runs[2].returns.truncate(11);
    runs[4].returns.truncate(13);
    runs
}

#[test]
fn what_is_not_as_it_should_be_is_said() {
    let Some(python) = python() else { return };
    let place = Place::new();
    let mut runs = uneven();
    assert_eq!(runs[4].folder(), "runs/Hopper-v4/td3/seed-1");
    runs.iter().for_each(|run| run.write(&place));
    succeed(
        python,
        &place,
        &["runs", "--out", "figures", "--format", "svg"],
    );
    let says = |file: &str, parts: &[&str]| {
        let text = place.read(&format!("figures/{file}"));
        for part in parts {
            assert!(text.contains(part), "`{part}` is not in {file}");
        }
    };
    let notes = [
        "Hopper-v4, td3: seed 1 ends at 12k of 20k steps; drawn to 12k",
        "Hopper-v4, mamf: seeds are evaluated at different steps; the 11 common ones of 21 are drawn",
        "Hopper-v4, Reacher-v4, td3: seeds 0, 1 of 0-2",
        "Hopper-v4, sac: seed 0 of 0-2",
        "Reacher-v4: no runs of sac",
    ];
    says("curves.svg", &notes);
    says(
        "curves.svg",
        &["mamf (3 seeds)", "td3 (2 seeds)", "sac (1 seed)"],
    );
    says("table.md", &notes);
    let left_out = "Reacher-v4: left out, no runs of sac";
    let unfinished = "Hopper-v4, td3: seed 1 counts as far as it went";
    for file in [
        "aggregate.svg",
        "improvement.svg",
        "profiles.svg",
        "table.md",
    ] {
        says(file, &[left_out, unfinished]);
    }
    says("aggregate.svg", &["sac (1 seed: no interval)"]);
    says("efficiency.svg", &["Drawn to 12k of 20k steps"]);
    let table = place.read("figures/table.md");
    let row = cells(&table, "Final return", &["Hopper-v4", "sac"]);
    assert!(!row[2].contains('['), "{row:?}");
    agree(&row[2], runs.last().unwrap().final_return());
    let row = cells(&table, "Final return", &["Hopper-v4", "td3"]);
    assert_eq!(row[..2], ["2", "12k to 20k"]);
    agree(
        &row[2],
        mean(&[runs[3].final_return(), runs[4].final_return()]),
    );

    // Also where the run was meant to be no longer than it is.
    runs[4].steps = 12_000;
    runs[4].write(&place);
    succeed(
        python,
        &place,
        &["runs", "--out", "again", "--format", "svg"],
    );
    let early = format!("{unfinished}, 12k of 20k steps");
    says("../again/aggregate.svg", &[&early]);
}

#[test]
fn a_single_run_is_enough() {
    let Some(python) = python() else { return };
    let place = Place::new();
    let run = Run::new("Hopper-v4", "mamf", 3, 20.0, 40.0);
    run.write(&place);
    succeed(
        python,
        &place,
        &[&run.folder(), "--out", "figures", "--format", "svg"],
    );
    let curves = place.read("figures/curves.svg");
    for part in ["Line: the only seed; no bands.", "mamf (1 seed)"] {
        assert!(curves.contains(part), "{part}");
    }
    assert!(!place.path("figures/improvement.svg").exists());
    let table = place.read("figures/table.md");
    agree(
        &cells(&table, "Final return", &["Hopper-v4", "mamf"])[2],
        run.final_return(),
    );
}

#[test]
fn folders_of_one_task_have_panels_of_their_own() {
    let Some(python) = python() else { return };
    let place = Place::new();
    for (seed, sweep) in [(0, "first"), (1, "$x_1$")] {
        let run = Run::new("Hopper-v4", "mamf", seed, 20.0, 40.0);
        run.write(&place);
        fs::create_dir_all(place.path(sweep)).unwrap();
        fs::rename(place.path("runs"), place.path(&format!("{sweep}/runs"))).unwrap();
    }
    let curves = |more: &[&str]| {
        let fixed = [
            "first",
            "$x_1$",
            "--out",
            "figures",
            "--figures",
            "curves",
            "--format",
            "svg",
        ];
        succeed(python, &place, &[&fixed[..], more].concat());
        place.read("figures/curves.svg")
    };
    // A name is no formula. Drawn on top of one another in one panel only when asked for.
    let apart = curves(&[]);
    assert!(apart.contains("mamf (1 seed)"));
    for title in ["(first/runs/Hopper-v4)", "($x_1$/runs/Hopper-v4)"] {
        assert!(apart.contains(title), "{title}");
    }
    assert!(curves(&["--merge"]).contains("mamf (2 seeds)"));
}

/// What becomes of the file `eval.csv` of one run, and what the message about it must name.
fn damages(whole: &str) -> Vec<(String, Vec<&'static str>)> {
    let replaced = |from: &str, to: &str| whole.replacen(from, to, 1);
    let cut = |end: usize| whole[..end].to_owned();
    vec![
        (cut(whole.len() - 3), vec!["line 22", "cut short"]),
        (
            cut(whole.len() - 12) + "\n",
            vec!["line 22", "instead of 8"],
        ),
        (String::new(), vec!["no evaluation", "cut short"]),
        (format!("{HEADER}\n"), vec!["no evaluation"]),
        (
            replaced("length_mean", "length"),
            vec![",length,", HEADER, "another version"],
        ),
        (
            replaced("success_rate", "success_rate,extra"),
            vec![",extra,", HEADER],
        ),
        (
            replaced("\n3000,10,", "\n3000,ten,"),
            vec!["line 5", "episodes", "invalid digit"],
        ),
        (
            replaced(",1.5,", ",inf,"),
            vec!["line 2", "return_std inf is not finite"],
        ),
        (
            replaced("\n3000,", "\n300,"),
            vec!["line 5", "step 300 after 2000"],
        ),
    ]
}

#[test]
fn mistakes_are_explained_and_write_nothing() {
    let Some(python) = python() else { return };
    let place = Place::new();
    for seed in 0..2 {
        Run::new("Hopper-v4", "mamf", seed, 20.0, 40.0).write(&place);
    }
    let refuse = |runs: &[&str], parts: &[&str]| {
        let before = place.contents("");
        let output = plot(python, &place, &[runs, &["--out", "figures"]].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert_eq!(output.stdout, b"", "{output:?}");
        assert_eq!(message.matches("error: ").count(), 1, "{message}");
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
        assert!(place.contents("") == before, "files changed: {message}");
    };

    let file = "runs/Hopper-v4/mamf/seed-1/eval.csv";
    let whole = place.read(file);
    for (text, mut parts) in damages(&whole) {
        place.write(file, text);
        parts.push(file);
        refuse(&["runs"], &parts);
    }
    place.write(file, &whole);

    let config = "runs/Hopper-v4/mamf/seed-1/config.toml";
    let settings = place.read(config);
    place.write(config, settings.replace("seed = 1", "seed = 0"));
    let twice = ["mamf/seed-1", "seed 0", "second time", "mamf/seed-0"];
    refuse(&["runs"], &twice);
    place.write(config, settings.replace("steps = ", "step = "));
    refuse(&["runs"], &[config, "missing field `steps`"]);
    place.write(config, "task = \"Hop");
    refuse(&["runs"], &[config, "TOML parse error"]);
    fs::remove_file(place.path(config)).unwrap();
    refuse(&["runs"], &[config, "No such file"]);
    place.write(config, settings);

    fs::create_dir(place.path("nothing")).unwrap();
    refuse(&["nothing"], &["nothing", "no run there"]);
    refuse(&["nowhere"], &["nowhere", "no such directory"]);
    refuse(&["runs/*/sac"], &["runs/*/sac", "no such directory"]);
    refuse(&[file], &[file, "no such directory"]);
    let knows_none = ["success_rate", "--metric"];
    refuse(&["runs", "--metric", "success_rate"], &knows_none);
    refuse(&["runs", "--baseline", "td3"], &["--baseline td3", "mamf"]);
    let alone = ["improvement", "two methods"];
    refuse(&["runs", "--figures", "improvement"], &alone);
    refuse(&["runs", "--figures", "pies"], &["`pies`", "curves"]);
    refuse(&["runs", "--smooth", "0"], &["--smooth", "from 1 on"]);
    place.write("reference.toml", "\"Hopper-v4\" = [3000, 20]\n");
    let reference = ["reference.toml", "Hopper-v4", "low < high", "[3000, 20]"];
    refuse(&["runs", "--reference", "reference.toml"], &reference);
    let no_program = ["./no-mamf: can't be run", "cargo build --release", "--mamf"];
    refuse(&["runs", "--mamf", "./no-mamf"], &no_program);
}
