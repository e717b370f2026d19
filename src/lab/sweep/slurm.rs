//! An experiment as a job array of Slurm: a batch script, each element of which makes one run.

use crate::core::paths::operand;
use std::ffi::OsString;
use std::fmt::{self, Display, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::str::FromStr;

/// Seconds by which Slurm may send its signal earlier than it is asked to (`man sbatch`, `--signal`).
const SIGNAL_EARLY: u64 = 60;

/// Why no batch script can be made or submitted; nothing was written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SlurmError {
    /// No limit of time.
    #[error(
        "expected a time as sbatch takes it: MINUTES, MINUTES:SECONDS, HOURS:MINUTES:SECONDS, DAYS-HOURS, \
        DAYS-HOURS:MINUTES or DAYS-HOURS:MINUTES:SECONDS, for example 90 or 12:00:00"
    )]
    Time,
    /// No amount of memory.
    #[error("expected a number of megabytes from 1, or one with K, M, G or T, for example 4G")]
    Memory,
    /// A name that is empty or has a newline or another control character.
    #[error("expected a name, without newlines and other control characters")]
    Name,
    /// No option of sbatch.
    #[error(
        "expected one option of sbatch as its script takes it, for example --sbatch=--nodelist=n1"
    )]
    Directive,
    /// The signal would come when the run has hardly begun, and it would be requeued for ever.
    #[error(
        "--time {time} is too short for --signal-before {signal_before}: Slurm may send the signal {SIGNAL_EARLY} seconds \
        earlier still; a time of more than {least} seconds is needed"
    )]
    TooShort {
        /// The limit as it was given.
        time: TimeLimit,
        /// Seconds before it at which the signal is wanted.
        signal_before: u16,
        /// Seconds that the limit must exceed.
        least: u64,
    },
    /// The cluster takes no array of so many.
    #[error(
        "{count} runs are too many for one job array, this cluster takes {most} (its MaxArraySize); \
        submit some of them at a time, which --only chooses"
    )]
    TooMany {
        /// Runs that are left.
        count: usize,
        /// Elements that the cluster takes.
        most: usize,
    },
    /// A word that can't stand in a script.
    #[error("{word:?} can't be put into a batch script: it has {reason}")]
    Word {
        /// The word.
        word: PathBuf,
        /// What of it does not fit.
        reason: &'static str,
    },
    /// There is no sbatch.
    #[error(
        "there is no sbatch on PATH: --slurm needs a host of the cluster that jobs are submitted from; --print shows the script"
    )]
    NoSbatch,
}

/// Why a script was not submitted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SubmitError {
    /// The system did not start sbatch.
    #[error("{}: {error}", sbatch.display())]
    Start {
        /// The program.
        sbatch: PathBuf,
        /// What the system said; part of the message, and hence no source of it.
        error: std::io::Error,
    },
    /// It ended with an error.
    #[error("sbatch refused {}: {said} ({status})", script.display())]
    Refused {
        /// The script.
        script: PathBuf,
        /// What sbatch wrote to standard error.
        said: String,
        /// How it ended.
        status: ExitStatus,
    },
}

/// A limit of time, kept as it was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TimeLimit {
    text: String,
    /// Its length, s.
    pub seconds: u64,
}

impl FromStr for TimeLimit {
    type Err = SlurmError;

    fn from_str(text: &str) -> Result<TimeLimit, SlurmError> {
        let number = |field: &str| {
            let digits = !field.is_empty() && field.bytes().all(|byte| byte.is_ascii_digit());
            let number = field.parse::<u32>().ok().filter(|_| digits);
            number.map(u64::from).ok_or(SlurmError::Time)
        };
        let (days, clock) = match text.split_once('-') {
            Some((days, clock)) => (Some(number(days)?), clock),
            None => (None, text),
        };
        let fields: Result<Vec<u64>, SlurmError> = clock.split(':').map(number).collect();
        let (hours, minutes, seconds) = match (days, &fields?[..]) {
            (Some(_), &[hours]) => (hours, 0, 0),
            (Some(_), &[hours, minutes]) => (hours, minutes, 0),
            (None, &[minutes]) => (0, minutes, 0),
            (None, &[minutes, seconds]) => (0, minutes, seconds),
            (_, &[hours, minutes, seconds]) => (hours, minutes, seconds),
            _ => return Err(SlurmError::Time),
        };
        let seconds = ((days.unwrap_or(0) * 24 + hours) * 60 + minutes) * 60 + seconds;
        if seconds == 0 {
            // Slurm takes it for no limit.
            return Err(SlurmError::Time);
        }
        Ok(TimeLimit {
            text: text.to_owned(),
            seconds,
        })
    }
}

impl Display for TimeLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// An amount of memory, as sbatch takes it.
///
/// # Errors
/// When it is none.
pub fn memory(text: &str) -> Result<String, SlurmError> {
    let number = text.trim_end_matches(['K', 'M', 'G', 'T', 'k', 'm', 'g', 't']);
    let digits = number.bytes().all(|byte| byte.is_ascii_digit());
    match number.parse::<u32>() {
        Ok(1..) if digits && text.len() - number.len() <= 1 => Ok(text.to_owned()),
        _ => Err(SlurmError::Memory),
    }
}

/// A name of a partition, an account and the like.
///
/// # Errors
/// When it is empty or has a control character.
pub fn name(text: &str) -> Result<String, SlurmError> {
    if text.trim().is_empty() || text.chars().any(char::is_control) {
        return Err(SlurmError::Name);
    }
    Ok(text.to_owned())
}

/// An option of sbatch as it stands in a script.
///
/// # Errors
/// When it begins without a dash or has a control character.
pub fn directive(text: &str) -> Result<String, SlurmError> {
    if !text.starts_with('-') || text.chars().any(char::is_control) {
        return Err(SlurmError::Directive);
    }
    Ok(text.to_owned())
}

/// What is asked of Slurm.
#[derive(Debug, Clone)]
pub struct Request {
    /// Name of the job.
    pub job_name: String,
    /// Partition, where another than the default one.
    pub partition: Option<String>,
    /// Account that is charged.
    pub account: Option<String>,
    /// Quality of service.
    pub qos: Option<String>,
    /// Features that nodes must have.
    pub constraint: Option<String>,
    /// Time limit of each element between two requeues.
    pub time: Option<TimeLimit>,
    /// Seconds before the time limit at which a run is saved.
    pub signal_before: u16,
    /// Cores of each element.
    pub cpus_per_task: u16,
    /// Memory of each element.
    pub memory: Option<String>,
    /// Most elements at a time.
    pub max_parallel: Option<u32>,
    /// Further options of sbatch, which win.
    pub directives: Vec<String>,
}

/// The elements of an array.
#[derive(Debug, Clone)]
pub struct Elements {
    /// Numbers of the runs in their experiment, ascending.
    pub indices: Vec<usize>,
    /// The program, where all nodes find it.
    pub program: PathBuf,
    /// Its arguments, but for the number of the run.
    pub arguments: Vec<PathBuf>,
    /// Working directory; absolute.
    pub directory: PathBuf,
    /// Folder of what they say; absolute.
    pub logs: PathBuf,
    /// Numbers that elements of an array may have, from 0 (`MaxArraySize` of the cluster).
    pub most: usize,
}

/// `MaxArraySize` of a cluster that says nothing else (`man slurm.conf`).
pub const MOST_ELEMENTS: usize = 1_001;

/// `MaxArraySize` of this cluster; what it is by default where that can't be asked.
pub fn most_elements() -> usize {
    let asked = Command::new("scontrol")
        .args(["show", "config"])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output();
    let said = asked.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    said.ok()
        .and_then(|said| array_size(&said))
        .unwrap_or(MOST_ELEMENTS)
}

/// `MaxArraySize` in what `scontrol show config` prints.
fn array_size(config: &str) -> Option<usize> {
    let mut lines = config.lines().filter_map(|line| line.split_once('='));
    let (_, value) = lines.find(|(name, _)| name.trim() == "MaxArraySize")?;
    value.trim().parse().ok()
}

/// The batch script of an array.
///
/// # Errors
/// When the time is too short for the signal before its end, or a word is not UTF-8 or has a newline.
pub fn script(request: &Request, elements: &Elements) -> Result<String, SlurmError> {
    let signal_before = request.signal_before;
    let least = u64::from(signal_before) + SIGNAL_EARLY;
    if let Some(time) = request.time.as_ref().filter(|time| time.seconds <= least) {
        let time = time.clone();
        return Err(SlurmError::TooShort {
            time,
            signal_before,
            least,
        });
    }
    // Elements have the numbers of their runs, as people read them, where the cluster has such numbers.
    let indices = &elements.indices;
    let counted: Vec<usize> = (0..indices.len()).collect();
    let fits = |numbers: &[usize]| numbers.last().is_none_or(|last| *last < elements.most);
    let (numbers, list, number) = if fits(indices) {
        (indices, String::new(), "$SLURM_ARRAY_TASK_ID")
    } else if fits(&counted) {
        let words: Vec<String> = indices.iter().map(usize::to_string).collect();
        let list = format!(
            "\n# The run of each element: the cluster has no elements of such numbers.\nruns=({})\n",
            words.join(" ")
        );
        (&counted, list, "${runs[$SLURM_ARRAY_TASK_ID]}")
    } else {
        return Err(SlurmError::TooMany {
            count: indices.len(),
            most: elements.most,
        });
    };
    let mut array = ranges(numbers);
    if let Some(most) = request.max_parallel {
        array += &format!("%{most}");
    }
    let logs = text(&elements.logs)?;
    if logs.contains('\\') {
        // sbatch would take `%A` and `%a` as they stand.
        return Err(SlurmError::Word {
            word: elements.logs.clone(),
            reason: "a backslash",
        });
    }
    let output = format!("{}/%A_%a.log", logs.replace('%', "%%"));
    let cpus = request.cpus_per_task.to_string();
    let time = request.time.as_ref().map(ToString::to_string);
    let options = [
        ("job-name", Some(request.job_name.clone())),
        ("array", Some(array)),
        ("partition", request.partition.clone()),
        ("account", request.account.clone()),
        ("qos", request.qos.clone()),
        ("constraint", request.constraint.clone()),
        ("time", time),
        ("cpus-per-task", Some(cpus)),
        ("mem", request.memory.clone()),
        ("chdir", Some(text(&elements.directory)?.to_owned())),
        ("output", Some(output)),
        ("open-mode", Some("append".to_owned())),
        ("signal", Some(format!("B:USR1@{signal_before}"))),
    ];
    let mut directives = String::new();
    for (option, value) in options {
        if let Some(value) = value {
            let value = quoted_for_sbatch(text(value.as_ref())?);
            let _ = writeln!(directives, "#SBATCH --{option}={value}");
        }
    }
    directives += "#SBATCH --requeue\n";
    for directive in &request.directives {
        let _ = writeln!(directives, "#SBATCH {directive}");
    }
    let mut command = quoted_for_shell(text(&elements.program)?);
    for argument in &elements.arguments {
        command += " ";
        command += &quoted_for_shell(text(argument)?);
    }
    Ok(format!(
        r#"#!/bin/bash
# Written by `mamf sweep --slurm`, and written anew by the next one: each element of the array makes one run.
{directives}
# Slurm sends USR1 to this shell before the time limit. TERM comes when the job is preempted, requeued or cancelled:
# then it is Slurm that decides whether it begins again. Either has the run saved.
child= signal= heard=
hear() {{
    heard=yes
    if [ -n "$child" ]; then kill -TERM "$child" 2>/dev/null; fi
}}
trap 'signal=${{signal:-USR1}}; hear' USR1
trap 'signal=TERM; hear' TERM
{list}
{command} --task-index "{number}" &
child=$!
# One that came before the process had its number.
if [ -n "$signal" ]; then kill -TERM "$child" 2>/dev/null; fi
# A signal ends `wait` too; then it says nothing of the process, and is asked again.
while
    heard=
    wait "$child"
    code=$?
    [ -n "$heard" ]
do :; done

# 75: saved. 143: the signal came before the program could hear it.
if [ "$signal" = USR1 ] && {{ [ "$code" = 75 ] || [ "$code" = 143 ]; }}; then
    # The number of the job alone may be that of the whole array.
    element="${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID"
    echo "the time limit is near: $element is saved and requeued"
    scontrol requeue "$element" || echo "it can't be requeued; submit it again" >&2
fi
exit "$code"
"#
    ))
}

/// A word for a script, which is text of one line.
fn text(word: &Path) -> Result<&str, SlurmError> {
    let wrong = |reason| SlurmError::Word {
        word: word.to_owned(),
        reason,
    };
    let text = word.to_str().ok_or_else(|| wrong("bytes of no text"))?;
    if text.contains(['\n', '\r', '\0']) {
        return Err(wrong("a newline"));
    }
    Ok(text)
}

/// Ascending numbers as `0,3-7`.
fn ranges(indices: &[usize]) -> String {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for &index in indices {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == index => *last = index,
            _ => ranges.push((index, index)),
        }
    }
    let words = ranges.iter().map(|(first, last)| match last - first {
        0 => first.to_string(),
        _ => format!("{first}-{last}"),
    });
    words.collect::<Vec<_>>().join(",")
}

fn is_plain(word: &str, others: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || others.contains(c);
    !word.is_empty() && word.chars().all(plain)
}

/// A word for bash.
fn quoted_for_shell(word: &str) -> String {
    if is_plain(word, "-_./=:,+@%") {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// A value in an `#SBATCH` line, where a backslash escapes within double quotes and nothing is expanded.
fn quoted_for_sbatch(value: &str) -> String {
    if is_plain(value, "-_./:,+@%") {
        return value.to_owned();
    }
    format!("\"{}\"", value.replace('\\', r"\\").replace('"', "\\\""))
}

/// The program that takes jobs.
#[derive(Debug, Clone)]
pub struct Sbatch(PathBuf);

impl Sbatch {
    /// Looks for it on `PATH`.
    ///
    /// # Errors
    /// When it isn't there.
    pub fn find() -> Result<Sbatch, SlurmError> {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let is_program = |file: &PathBuf| {
            let metadata = file.metadata();
            metadata.is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0)
        };
        let mut files = std::env::split_paths(&path).map(|folder| folder.join("sbatch"));
        let found = files.find(is_program);
        found.map(Sbatch).ok_or(SlurmError::NoSbatch)
    }

    /// Submits a script; returns the number of the job.
    ///
    /// # Errors
    /// When sbatch can't be started or refuses the script.
    pub fn submit(&self, script: &Path) -> Result<String, SubmitError> {
        let mut command = Command::new(&self.0);
        let command = command
            .arg("--parsable")
            .arg(operand(script))
            .stdin(Stdio::null());
        // They would have the last word over the script.
        for (name, _) in deciding() {
            command.env_remove(name);
        }
        let output = command.output().map_err(|error| SubmitError::Start {
            sbatch: self.0.clone(),
            error,
        })?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            return Err(SubmitError::Refused {
                script: script.to_owned(),
                said,
                status: output.status,
            });
        }
        let said = String::from_utf8_lossy(&output.stdout);
        // Between several clusters it is `<job>;<cluster>`, and a site's own notes may come before it.
        let last = said.lines().last().unwrap_or_default();
        Ok(last.split(';').next().unwrap_or_default().trim().to_owned())
    }
}

/// Variables of the environment that sbatch takes options from, with their values. What is asked of a job stands in its
/// script alone.
pub fn deciding() -> impl Iterator<Item = (OsString, OsString)> {
    let options = |name: &OsString| {
        let name = name.to_string_lossy();
        name.starts_with("SBATCH_")
            || ["SLURM_CLUSTERS", "SLURM_HINT", "SLURM_UMASK"].contains(&&*name)
    };
    std::env::vars_os().filter(move |(name, _)| options(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_whose_numbers_no_element_may_have_are_counted_anew() {
        let script = |indices: Vec<usize>, most| {
            let elements = Elements {
                indices,
                most,
                ..elements()
            };
            script(&request(), &elements)
        };
        let plain = script(vec![2, 1000], 1001).unwrap();
        assert!(
            plain.contains("--array=2,1000\n")
                && plain.contains("--task-index \"$SLURM_ARRAY_TASK_ID\" &")
        );
        let counted = script(vec![1001, 2500], 1001).unwrap();
        assert!(
            counted.contains("--array=0-1\n") && counted.contains("\nruns=(1001 2500)\n"),
            "{counted}"
        );
        assert!(
            counted.contains("--task-index \"${runs[$SLURM_ARRAY_TASK_ID]}\" &"),
            "{counted}"
        );
        let error = script((0..5).collect(), 4).unwrap_err().to_string();
        for part in ["5 runs", "takes 4", "MaxArraySize", "--only"] {
            assert!(error.contains(part), "{error}");
        }
        assert_eq!(
            array_size("A = 3\nMaxArraySize            = 77\n"),
            Some(77)
        );
        assert_eq!(array_size("MaxArraySizes = 77\n"), None);
    }

    fn request() -> Request {
        Request {
            job_name: "mamf-e".into(),
            partition: None,
            account: None,
            qos: None,
            constraint: None,
            time: None,
            signal_before: 120,
            cpus_per_task: 1,
            memory: None,
            max_parallel: None,
            directives: Vec::new(),
        }
    }

    fn elements() -> Elements {
        Elements {
            indices: vec![0, 3, 4, 5],
            program: "/opt/mamf".into(),
            arguments: vec!["sweep".into(), "e.toml".into()],
            directory: "/data".into(),
            logs: "/data/runs/e/slurm".into(),
            most: MOST_ELEMENTS,
        }
    }

    #[test]
    fn numbers_become_ranges() {
        for (indices, expected) in [
            (&[0][..], "0"),
            (&[0, 3, 4, 5, 6, 7], "0,3-7"),
            (&[1, 2, 4, 9, 10], "1-2,4,9-10"),
        ] {
            assert_eq!(ranges(indices), expected);
        }
    }

    #[test]
    fn times_are_those_of_sbatch() {
        for (text, seconds) in [
            ("90", 5_400),
            ("2:30", 150),
            ("12:00:00", 43_200),
            ("1-6", 108_000),
            ("1-06:30", 109_800),
            ("1-06:30:15", 109_815),
        ] {
            let time: TimeLimit = text.parse().unwrap();
            assert_eq!((time.seconds, time.to_string()), (seconds, text.to_owned()));
        }
        for text in [
            "",
            "0",
            "0:00",
            "1h",
            "-5",
            "+5",
            "1-",
            "1:2:3:4",
            "1-2:3:4:5",
            "1-2-3",
            "1:",
            ":1",
            "5\n",
            "99999999999",
        ] {
            assert_eq!(text.parse::<TimeLimit>(), Err(SlurmError::Time), "{text}");
        }
    }

    #[test]
    fn amounts_and_names_are_checked() {
        for good in ["1", "4096", "4G", "500m", "1T"] {
            assert_eq!(memory(good).as_deref(), Ok(good));
        }
        for wrong in [
            "", "0", "G", "4GB", "4 G", "-1", "+1", "4.5G", "4GG", "4G\n",
        ] {
            assert_eq!(memory(wrong), Err(SlurmError::Memory), "{wrong}");
        }
        assert_eq!(name("gpu,cpu").as_deref(), Ok("gpu,cpu"));
        for wrong in ["", " ", "a\nb"] {
            assert_eq!(name(wrong), Err(SlurmError::Name));
        }
        assert!(directive("--nodelist=n1").is_ok());
        for wrong in ["", "nodelist=n1", "--a\n#SBATCH --b"] {
            assert_eq!(directive(wrong), Err(SlurmError::Directive));
        }
    }

    #[test]
    fn a_script_asks_for_what_is_asked() {
        let plain = script(&request(), &elements()).unwrap();
        for line in [
            "#!/bin/bash",
            "#SBATCH --job-name=mamf-e",
            "#SBATCH --array=0,3-5",
            "#SBATCH --cpus-per-task=1",
            "#SBATCH --chdir=/data",
            "#SBATCH --output=/data/runs/e/slurm/%A_%a.log",
            "#SBATCH --open-mode=append",
            "#SBATCH --signal=B:USR1@120",
            "#SBATCH --requeue",
            "/opt/mamf sweep e.toml --task-index \"$SLURM_ARRAY_TASK_ID\" &",
        ] {
            assert!(plain.lines().any(|l| l == line), "{line} is not in {plain}");
        }
        assert_eq!(plain.matches("#SBATCH").count(), 8, "{plain}");

        let asked = Request {
            partition: Some("long".into()),
            account: Some("lab".into()),
            qos: Some("low".into()),
            constraint: Some("avx512&ib".into()),
            time: Some("1-00:00".parse().unwrap()),
            signal_before: 300,
            cpus_per_task: 2,
            memory: Some("4G".into()),
            max_parallel: Some(4),
            directives: vec!["--nodelist=n[1-2]".into()],
            ..request()
        };
        let asked = script(&asked, &elements()).unwrap();
        for line in [
            "--array=0,3-5%4",
            "--partition=long",
            "--account=lab",
            "--qos=low",
            "--constraint=\"avx512&ib\"",
            "--time=1-00:00",
            "--cpus-per-task=2",
            "--mem=4G",
            "--signal=B:USR1@300",
            "--nodelist=n[1-2]",
        ] {
            let line = format!("#SBATCH {line}");
            assert!(asked.lines().any(|l| l == line), "{line} is not in {asked}");
        }
    }

    #[test]
    fn a_time_that_leaves_no_room_for_work_is_refused() {
        let of = |time: &str| Request {
            time: Some(time.parse().unwrap()),
            ..request()
        };
        for time in ["1", "2", "3", "3:00"] {
            let message = script(&of(time), &elements()).unwrap_err().to_string();
            assert!(message.contains("--signal-before 120"), "{message}");
            assert!(message.contains("more than 180 seconds"), "{message}");
        }
        assert!(script(&of("3:01"), &elements()).is_ok());
    }

    #[test]
    fn words_are_quoted() {
        let odd = Elements {
            program: "/opt/m f/mamf".into(),
            arguments: [
                "sweep",
                "it's.toml",
                "--set",
                "a=[1, \"$HOME\"]",
                "",
                "x\\`y`",
            ]
            .map(PathBuf::from)
            .into(),
            directory: "/a b/#\"c\"".into(),
            logs: "/a b/50%/slurm".into(),
            ..elements()
        };
        let odd = script(&request(), &odd).unwrap();
        for line in [
            r#"#SBATCH --chdir="/a b/#\"c\"""#,
            r#"#SBATCH --output="/a b/50%%/slurm/%A_%a.log""#,
            r#"'/opt/m f/mamf' sweep 'it'\''s.toml' --set 'a=[1, "$HOME"]' '' 'x\`y`' --task-index "$SLURM_ARRAY_TASK_ID" &"#,
        ] {
            assert!(odd.lines().any(|l| l == line), "{line} is not in {odd}");
        }
    }

    #[test]
    fn words_that_are_no_line_of_text_are_refused() {
        use std::os::unix::ffi::OsStrExt;
        let no_text = Path::new(std::ffi::OsStr::from_bytes(b"\xff")).to_owned();
        let with = |change: &dyn Fn(&mut Elements)| {
            let mut elements = elements();
            change(&mut elements);
            script(&request(), &elements).unwrap_err().to_string()
        };
        for (message, part) in [
            (with(&|e| e.arguments.push("a\nb".into())), "a newline"),
            (with(&|e| e.directory = "/a\nb".into()), "a newline"),
            (with(&|e| e.program = no_text.clone()), "bytes of no text"),
            (with(&|e| e.logs = "/a\\b".into()), "a backslash"),
        ] {
            assert!(message.contains(part), "{message}");
        }
    }
}
