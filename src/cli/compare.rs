//! `mamf compare`

use super::{FAILED, Misuse, number, report_to_reader, tell};
use crate::core::table::{Column, Table};
use crate::lab::comparison::{
    self, Comparison, ComparisonError, Estimate, Interval, Measured, Metric, Options, Overall,
    TaskComparison,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

/// Arguments of `mamf compare`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Runs of one method: a run directory, a folder above some, or a quoted pattern of them
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Runs of the other method, of the same tasks and seeds
    #[arg(value_name = "B")]
    b: PathBuf,
    /// What of the evaluations is compared
    #[arg(long, value_enum, default_value_t)]
    metric: Metric,
    /// Value to be reached; of one task with TASK=VALUE, may be repeated [default: the lower of both final values]
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    threshold: Vec<Threshold>,
    /// End with exit code 1 unless, in every task, A's final value is at least B's plus X; X is a number, or a
    /// percentage of B's value such as -5%
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    at_least: Option<Margin>,
    /// Hold the lower end of the interval to --at-least, not the mean difference; five pairs a task are needed
    #[arg(long, requires = "at_least")]
    confident: bool,
    /// Leave out runs without a partner
    #[arg(long)]
    paired_only: bool,
    /// Bootstrap resamplings for the intervals of P(A better)
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    repetitions: u32,
    /// Print the comparison as JSON
    #[arg(long)]
    json: bool,
}

/// Pairs of a task that `--confident` needs. With fewer, an interval is an assumption about the differences more than
/// what they tell.
const CONFIDENT_PAIRS: usize = 5;

/// A threshold, of one task or of all.
#[derive(Debug, Clone)]
struct Threshold {
    task: Option<String>,
    value: f64,
}

impl FromStr for Threshold {
    type Err = String;

    fn from_str(text: &str) -> Result<Threshold, String> {
        let (task, value) = match text.rsplit_once('=') {
            Some((task, value)) => (Some(task.to_owned()), value),
            None => (None, text),
        };
        let value = finite(value).ok_or("not a number, nor TASK=NUMBER such as Hopper-v4=1000")?;
        Ok(Threshold { task, value })
    }
}

/// By how much A must be better.
#[derive(Debug, Clone, Copy)]
enum Margin {
    Absolute(f64),
    /// Of the size of B's value.
    Percent(f64),
}

impl FromStr for Margin {
    type Err = String;

    fn from_str(text: &str) -> Result<Margin, String> {
        let wrong = "not a number, nor a percentage such as -5%";
        match text.strip_suffix('%') {
            Some(percent) => finite(percent).map(Margin::Percent),
            None => finite(text).map(Margin::Absolute),
        }
        .ok_or_else(|| wrong.to_owned())
    }
}

impl Margin {
    /// The least difference, where B has this value.
    fn of(self, b: f64) -> f64 {
        match self {
            Margin::Absolute(least) => least,
            Margin::Percent(percent) => percent / 100.0 * b.abs(),
        }
    }
}

fn finite(text: &str) -> Option<f64> {
    text.trim()
        .parse()
        .ok()
        .filter(|value: &f64| value.is_finite())
}

/// What `--json` prints.
#[derive(Serialize)]
struct Printed<'a> {
    a: String,
    b: String,
    #[serde(flatten)]
    comparison: &'a Comparison,
    /// Whether `--at-least` holds, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    at_least_holds: Option<bool>,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let options = args.options()?;
    let sides = [comparison::find(&args.a)?, comparison::find(&args.b)?];
    let [a, b] = [&args.a, &args.b].map(|side| side.display().to_string());
    let pairs = comparison::pair(sides, [&a, &b])?;
    if !pairs.unpaired.is_empty() && !args.paired_only {
        return Err(ComparisonError::Unpaired(pairs.unpaired).into());
    }
    let mut compared = comparison::compare(&pairs, &options)?;
    if !pairs.unpaired.is_empty() {
        let left_out = pairs.unpaired.join(", ");
        compared
            .notes
            .push(format!("left out, for they have no partner: {left_out}"));
    }
    let unmet = args
        .at_least
        .map(|margin| args.unmet(margin, &compared))
        .transpose()?;
    if args.json {
        let printed = Printed {
            a,
            b,
            comparison: &compared,
            at_least_holds: unmet.as_ref().map(Vec::is_empty),
        };
        let json = serde_json::to_string_pretty(&printed)?;
        output(&unmet, &format!("{json}\n"))?;
    } else {
        output(&unmet, &in_words(args, &compared)?)?;
    }
    match unmet {
        Some(unmet) if !unmet.is_empty() => {
            for reason in unmet {
                tell(&format!("not met: {reason}"));
            }
            Ok(ExitCode::from(FAILED))
        }
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Prints the comparison: all that there is to be had of it, unless `--at-least` asked for a verdict, which is one whoever
/// reads.
fn output(unmet: &Option<Vec<String>>, text: &str) -> anyhow::Result<()> {
    match unmet {
        None => super::print(text),
        Some(_) => {
            report_to_reader(text);
            Ok(())
        }
    }
}

impl Args {
    fn options(&self) -> Result<Options, Misuse> {
        let mut options = Options {
            metric: self.metric,
            threshold: None,
            thresholds: BTreeMap::new(),
            repetitions: self.repetitions as usize,
        };
        for Threshold { task, value } in &self.threshold {
            let (former, of) = match task {
                None => (options.threshold.replace(*value), "all tasks"),
                Some(task) => (options.thresholds.insert(task.clone(), *value), &task[..]),
            };
            if let Some(former) = former {
                let reason =
                    format!("--threshold: two of {of}, {former} and {value}; one is needed");
                return Err(Misuse(reason));
            }
        }
        Ok(options)
    }

    /// The tasks in which A is not better than B by `margin`, in words.
    fn unmet(&self, margin: Margin, compared: &Comparison) -> Result<Vec<String>, Misuse> {
        let mut unmet = Vec::new();
        for task in &compared.tasks {
            let measured = &task.final_value;
            let least = margin.of(measured.b);
            let (found, what) = if self.confident {
                let interval = measured.difference.interval;
                let enough = interval.filter(|_| task.seeds.len() >= CONFIDENT_PAIRS);
                let interval = enough.ok_or_else(|| {
                    let (task, n) = (&task.task, task.seeds.len());
                    let plural = if n == 1 { "" } else { "s" };
                    Misuse(format!(
                        "--confident: {task} has {n} pair{plural}; {CONFIDENT_PAIRS} or more are needed, for of so few the interval \
                        rests on what the differences are taken to be distributed like"
                    ))
                })?;
                (interval.low, "the interval of A - B begins at")
            } else {
                (measured.difference.value, "A - B is")
            };
            if found < least {
                let (name, found, least) = (&task.task, number(found), number(least));
                unmet.push(format!(
                    "{name}: {what} {found}, at least {least} is asked for"
                ));
            }
        }
        Ok(unmet)
    }
}

/// A table of measures; all of them have the same widths, as far as numbers are of usual lengths.
fn table(headings: [&str; 7]) -> Table {
    let [what, a, b, difference, interval, improvement, won] = headings;
    Table::new([
        Column::words(what).at_least(24),
        Column::numbers(a).at_least(8),
        Column::numbers(b).at_least(8),
        Column::numbers(difference).at_least(9),
        Column::words(interval).at_least(22),
        Column::words(improvement).at_least(20),
        Column::words(won),
    ])
}

fn in_words(args: &Args, compared: &Comparison) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    writeln!(out, "A  {}\nB  {}", args.a.display(), args.b.display())?;
    let (what, whole) = match compared.metric {
        Metric::Return => ("return", "final return"),
        Metric::Success => ("success", "final success rate"),
    };
    for task in &compared.tasks {
        let seeds: Vec<String> = task.seeds.iter().map(u64::to_string).collect();
        let count = match seeds.len() {
            1 => format!("1 pair (seed {})", seeds[0]),
            n => format!("{n} pairs (seeds {})", seeds.join(", ")),
        };
        writeln!(out, "\n{}: {count}, {} steps", task.task, task.steps)?;
        let mut table = table([
            "",
            "A",
            "B",
            "A - B",
            "95 % interval",
            "P(A better)",
            "A better in",
        ]);
        let threshold = number(task.threshold);
        let area = format!("mean {what} (area)");
        let steps = format!("steps to {threshold}");
        table.row(measured(whole, &task.final_value, task, number));
        table.row(measured(&area, &task.area, task, number));
        table.row(measured(
            &steps,
            &task.steps_to_threshold,
            task,
            whole_number,
        ));
        write!(out, "{table}")?;
        let [a, b] = task.reached;
        let n = task.seeds.len();
        if a.min(b) < n {
            let counted = "the others count with all their steps";
            writeln!(
                out,
                "  {threshold} is reached by {a} of {n} runs of A, {b} of {n} of B; {counted}"
            )?;
        }
    }
    if let Some(all) = &compared.all {
        print_overall(&mut out, all, compared.tasks.len())?;
    }
    if !compared.notes.is_empty() {
        writeln!(out)?;
    }
    for note in &compared.notes {
        writeln!(out, "note: {note}")?;
    }
    Ok(out)
}

/// The cells of a measure.
fn measured(
    what: &str,
    measured: &Measured,
    task: &TaskComparison,
    print: fn(f64) -> String,
) -> [String; 7] {
    let signed = |value: f64| with_sign(value, print);
    [
        format!("  {what}"),
        print(measured.a),
        print(measured.b),
        signed(measured.difference.value),
        interval(&measured.difference, signed),
        probability(&measured.improvement),
        format!("{} of {}", measured.won, task.seeds.len()),
    ]
}

fn print_overall(out: &mut String, all: &Overall, tasks: usize) -> std::fmt::Result {
    writeln!(
        out,
        "\nall {tasks} tasks: {} pairs; differences in units of what the better side gained on the untrained policy",
        all.pairs
    )?;
    let mut table = table([""; 7]);
    for (what, estimate, improvement) in [
        ("  final", &all.final_value, probability(&all.improvement)),
        ("  mean (area)", &all.area, String::new()),
    ] {
        let (difference, interval) = (signed(estimate.value), interval(estimate, signed));
        let empty = String::new;
        table.row([
            what.into(),
            empty(),
            empty(),
            difference,
            interval,
            improvement,
        ]);
    }
    write!(out, "{table}")
}

fn interval(estimate: &Estimate, print: impl Fn(f64) -> String) -> String {
    match estimate.interval {
        None => "-".to_owned(),
        Some(Interval { low, high }) => format!("{} to {}", print(low), print(high)),
    }
}

fn probability(estimate: &Estimate) -> String {
    let two = |value: f64| format!("{value:.2}");
    match estimate.interval {
        None => two(estimate.value),
        Some(_) => format!("{} ({})", two(estimate.value), interval(estimate, two)),
    }
}

fn signed(value: f64) -> String {
    with_sign(value, number)
}

fn with_sign(value: f64, print: fn(f64) -> String) -> String {
    let sign = if value > 0.0 { "+" } else { "" };
    format!("{sign}{}", print(value))
}

fn whole_number(value: f64) -> String {
    format!("{value:.0}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn margins_and_thresholds_are_read() {
        let least = |text: &str, b| text.parse().map(|margin: Margin| margin.of(b));
        assert_eq!(least("-5%", -200.0), Ok(-10.0));
        assert_eq!(least("2.5", -200.0), Ok(2.5));
        assert!(least("5 percent", 1.0).is_err());
        assert!(least("nan", 1.0).is_err());
        let threshold: Threshold = "Hopper-v4=-3".parse().unwrap();
        assert_eq!(
            (threshold.task.as_deref(), threshold.value),
            (Some("Hopper-v4"), -3.0)
        );
        assert!("Hopper-v4".parse::<Threshold>().is_err());
    }

    #[test]
    fn numbers_have_about_four_digits() {
        let numbers = [0.0, -0.01234, 2.71, -123.456, 30000.0].map(number);
        assert_eq!(numbers, ["0", "-0.0123", "2.71", "-123.5", "30000"]);
        assert_eq!(signed(1.0), "+1.00");
    }
}
