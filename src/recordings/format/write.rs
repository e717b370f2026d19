//! Writes recordings.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use npyz::WriterBuilder;
use serde_json::{Map, Value, json};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::archive::{Archive, member_of};
use super::read::Settings;
use crate::core::files::NewFile;
use crate::core::leftovers::Unfinished;

/// What keeps a recording from being written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// There is a file of that name, which is left alone.
    #[error("{}: exists already and is not overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The numbers do not make a recording.
    #[error("{}: array `{array}`: {problem}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// The array.
        array: String,
        /// What is wrong.
        problem: String,
    },
}

/// One array of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Its name.
    pub name: String,
    /// A line that says what it is.
    pub what: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its numbers, in C order.
    pub numbers: Vec<f64>,
}

/// A state of a trajectory.
#[derive(Debug, Clone, Copy)]
pub struct State<'a> {
    /// Positions, `[nq]`.
    pub qpos: &'a [f64],
    /// Velocities, `[nv]`.
    pub qvel: &'a [f64],
    /// Accelerations from which the solver starts, `[nv]`.
    pub qacc_warmstart: &'a [f64],
    /// Simulated time, in seconds.
    pub time: f64,
    /// Observation, `[obs_size]`.
    pub obs: &'a [f64],
    /// Goal reached, for tasks with goals.
    pub achieved_goal: Option<&'a [f64]>,
}

/// A step of a trajectory.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// Executed action, `[action_size]`.
    pub action: &'a [f64],
    /// Commands of the actuators it maps to, `[nu]`.
    pub ctrl: Option<&'a [f64]>,
    /// Reward.
    pub reward: f64,
    /// Whether the task ended (not by a time limit).
    pub terminated: bool,
    /// Whether the goal was reached, for tasks with goals.
    pub success: Option<bool>,
}

/// A trajectory as it is recorded, state by state, kept in memory until it is saved.
///
/// Where a state or a step leaves an optional part out, every other one must as well.
#[derive(Debug, Clone)]
pub struct Recorder {
    settings: Map<String, Value>,
    desired_goal: Option<Vec<f64>>,
    states: Vec<Column>,
    steps: Vec<Column>,
}

impl Recorder {
    /// Begins a trajectory of the task `env` in the state `first`; `source` says where it comes from.
    pub fn new(env: &str, source: &str, first: &State<'_>) -> Recorder {
        let mut settings = Map::new();
        settings.insert("env".into(), env.into());
        settings.insert("source".into(), source.into());
        let states = [
            ("qpos", "positions; row t before action[t]"),
            ("qvel", "velocities, rows as qpos"),
            ("qacc_warmstart", "start of the solver, rows as qpos"),
            ("time", "simulated time in seconds, rows as qpos"),
            ("obs", "observations, rows as qpos"),
            ("achieved_goal", "goals reached, rows as qpos"),
        ];
        let steps = [
            ("action", "executed actions"),
            ("ctrl", "commands of the actuators that action[t] maps to"),
            ("reward", "reward of action[t]"),
            ("terminated", "1 where the task ended by action[t], else 0"),
            ("success", "1 where action[t] reached the goal, else 0"),
        ];
        let mut recorder = Recorder {
            settings,
            desired_goal: None,
            states: states.map(Column::new).into(),
            steps: steps.map(Column::new).into(),
        };
        recorder.push_state(first);
        recorder
    }

    /// Sets the goal of the trajectory.
    #[must_use]
    pub fn with_desired_goal(mut self, goal: &[f64]) -> Recorder {
        self.desired_goal = Some(goal.to_vec());
        self
    }

    /// Adds a setting that the `.json` file is to hold besides the task, its source, the number of
    /// steps and the arrays.
    #[must_use]
    pub fn with_setting(mut self, key: &str, value: impl Into<Value>) -> Recorder {
        self.settings.insert(key.to_owned(), value.into());
        self
    }

    /// Appends a step and the state it led to.
    pub fn push(&mut self, step: &Step<'_>, after: &State<'_>) {
        let number = |flag: bool| f64::from(u8::from(flag));
        let success = step.success.map(|flag| [number(flag)]);
        let parts = [
            Some(step.action),
            step.ctrl,
            Some(&[step.reward]),
            Some(&[number(step.terminated)]),
            success.as_ref().map(<[f64; 1]>::as_slice),
        ];
        push_row(&mut self.steps, parts);
        self.push_state(after);
    }

    /// Number of steps so far.
    pub fn steps(&self) -> usize {
        self.steps[0].rows
    }

    /// Writes `<stem>.npz` and `<stem>.json`; see [`write`()].
    ///
    /// # Errors
    /// Those of [`write`()], and if there is no step or the rows of an array differ in length.
    pub fn save(&self, stem: &Path) -> Result<[Unfinished; 2], WriteError> {
        let steps = self.steps();
        if steps == 0 {
            return Err(problem(stem, "action", "is empty"));
        }
        let mut arrays = Vec::new();
        for (columns, rows) in [(&self.steps, steps), (&self.states, steps + 1)] {
            for column in columns.iter().filter(|column| column.rows > 0) {
                arrays.push(column.array(stem, rows)?);
            }
        }
        if let Some(goal) = &self.desired_goal {
            arrays.push(Array {
                name: "desired_goal".to_owned(),
                what: "goal of the trajectory".to_owned(),
                shape: vec![goal.len()],
                numbers: goal.clone(),
            });
        }
        let mut settings = self.settings.clone();
        settings.insert("steps".into(), steps.into());
        write(stem, settings, &arrays)
    }

    fn push_state(&mut self, state: &State<'_>) {
        let parts = [
            Some(state.qpos),
            Some(state.qvel),
            Some(state.qacc_warmstart),
            Some(&[state.time]),
            Some(state.obs),
            state.achieved_goal,
        ];
        push_row(&mut self.states, parts);
    }
}

fn push_row<const N: usize>(columns: &mut [Column], parts: [Option<&[f64]>; N]) {
    for (column, part) in columns.iter_mut().zip(parts) {
        if let Some(row) = part {
            column.push(row);
        }
    }
}

/// An array that grows row by row.
#[derive(Debug, Clone)]
struct Column {
    name: &'static str,
    what: &'static str,
    numbers: Vec<f64>,
    rows: usize,
    /// Length of the first row.
    width: usize,
    /// Whether a row had another length.
    ragged: bool,
}

impl Column {
    fn new((name, what): (&'static str, &'static str)) -> Column {
        Column {
            name,
            what,
            numbers: Vec::new(),
            rows: 0,
            width: 0,
            ragged: false,
        }
    }

    fn push(&mut self, row: &[f64]) {
        if self.rows == 0 {
            self.width = row.len();
        }
        self.ragged |= row.len() != self.width;
        self.numbers.extend_from_slice(row);
        self.rows += 1;
    }

    fn array(&self, stem: &Path, rows: usize) -> Result<Array, WriteError> {
        if self.ragged {
            return Err(problem(stem, self.name, "has rows of different lengths"));
        }
        if self.rows != rows {
            let text = format!("has {} rows where there should be {rows}", self.rows);
            return Err(problem(stem, self.name, text));
        }
        // One number a row: a one-dimensional array.
        let single = ["time", "reward", "terminated", "success"].contains(&self.name);
        Ok(Array {
            name: self.name.to_owned(),
            what: self.what.to_owned(),
            shape: match single {
                true => vec![rows],
                false => vec![rows, self.width],
            },
            numbers: self.numbers.clone(),
        })
    }
}

/// Writes a recording: `<stem>.npz` with the arrays, then `<stem>.json` with `settings` and a
/// description of the arrays.
///
/// Each file appears whole, and the archive before the settings that announce it. Members are stored
/// without compression, and the description says at which byte of the archive each begins, so that a
/// reader needs to know neither ZIP nor NPY. Until what is returned is dropped, both go with the process.
///
/// # Errors
/// If one of the files exists or cannot be written, or a shape does not fit its numbers.
pub fn write(
    stem: &Path,
    mut settings: Map<String, Value>,
    arrays: &[Array],
) -> Result<[Unfinished; 2], WriteError> {
    for (i, array) in arrays.iter().enumerate() {
        check(stem, array, &arrays[..i])?;
    }
    let (npz_path, json_path) = (with_ending(stem, "npz"), with_ending(stem, "json"));
    let npz = NewFile::create(npz_path.clone()).map_err(failed(&npz_path))?;
    let json = NewFile::create(json_path.clone()).map_err(failed(&json_path))?;

    write_arrays(npz.temporary(), arrays).map_err(failed(&npz_path))?;
    let description = describe(npz.temporary(), arrays).map_err(failed(&npz_path))?;
    settings.insert("arrays".into(), description);
    settings.insert("dtype".into(), "float64 little-endian, C order".into());
    let text = format!("{:#}\n", Value::Object(settings));
    fs::write(json.temporary(), text).map_err(failed(&json_path))?;

    let npz = npz.keep_for_now().map_err(failed(&npz_path))?;
    match json.keep_for_now() {
        Ok(json) => Ok([npz, json]),
        Err(error) => {
            // Half a recording is none.
            npz.remove();
            Err(failed(&json_path)(error))
        }
    }
}

fn check(stem: &Path, array: &Array, earlier: &[Array]) -> Result<(), WriteError> {
    let mut lengths = array.shape.iter();
    let size = lengths.try_fold(1usize, |size, &n| size.checked_mul(n));
    if size != Some(array.numbers.len()) {
        let (count, shape) = (array.numbers.len(), &array.shape);
        let text = format!("has {count} numbers, which do not fill the shape {shape:?}");
        return Err(problem(stem, &array.name, text));
    }
    if earlier.iter().any(|other| other.name == array.name) {
        return Err(problem(stem, &array.name, "is there twice"));
    }
    Ok(())
}

fn problem(stem: &Path, array: &str, problem: impl Into<String>) -> WriteError {
    WriteError::Array {
        path: with_ending(stem, "npz"),
        array: array.to_owned(),
        problem: problem.into(),
    }
}

fn write_arrays(path: &Path, arrays: &[Array]) -> io::Result<()> {
    // No time of day: equal trajectories make equal files.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default());
    let mut archive = ZipWriter::new(BufWriter::new(File::create(path)?));
    for array in arrays {
        let large = 8 * array.numbers.len() as u64 >= u64::from(u32::MAX) / 2;
        let shape: Vec<u64> = array.shape.iter().map(|&n| n as u64).collect();
        archive.start_file(member_of(&array.name), options.large_file(large))?;
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&shape)
            .writer(&mut archive)
            .begin_nd()?;
        writer.extend(&array.numbers)?;
        writer.finish()?;
    }
    let mut file = archive.finish()?;
    file.flush()?;
    file.get_ref().sync_all()
}

/// Shape, meaning and place of each array of the archive `path`.
fn describe(path: &Path, arrays: &[Array]) -> io::Result<Value> {
    let nothing = Settings::default();
    let mut archive = Archive::open(path, &nothing).map_err(io::Error::other)?;
    let mut description = Map::new();
    for array in arrays {
        let offset = archive.offset(&array.name, array.numbers.len());
        let offset =
            offset.ok_or_else(|| io::Error::other("the archive just written is damaged"))?;
        let entry = json!({"shape": array.shape, "offset": offset, "what": array.what});
        description.insert(array.name.clone(), entry);
    }
    Ok(Value::Object(description))
}

/// `stem` with `.ending` appended; dots in it are part of the name.
fn with_ending(stem: &Path, ending: &str) -> PathBuf {
    let mut path = stem.as_os_str().to_owned();
    path.push(".");
    path.push(ending);
    path.into()
}

/// What went wrong with the file `path`.
fn failed(path: &Path) -> impl FnOnce(io::Error) -> WriteError + use<> {
    let path = path.to_owned();
    move |source| match source.kind() {
        io::ErrorKind::AlreadyExists => WriteError::Exists { path },
        _ => WriteError::Io { path, source },
    }
}
