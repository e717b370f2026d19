//! Reads a recording.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::archive::Archive;
use super::error::RecordingError;
use super::rows::Rows;
use crate::core::text;

/// The largest number, up or down, that a simulation holds: MuJoCo takes states beyond it for broken.
pub const LARGEST: f64 = 1e10;

const EXPECTED: &str = "where a finite number within +-1e10 belongs";

/// What the `.json` file says; everything else in it is for people.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Settings {
    /// Id of the task.
    pub env: String,
    /// Where the trajectory came from.
    #[serde(default)]
    pub source: Option<String>,
    /// By which rule the pen's inertia was found, for tasks with pens.
    #[serde(default)]
    pub pen_inertia: Option<String>,
    /// The arrays that the `.npz` file holds.
    #[serde(default)]
    pub(super) arrays: BTreeMap<String, ArraySettings>,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct ArraySettings {
    pub shape: Option<Vec<usize>>,
}

/// A recorded trajectory of one task, of `n` steps.
///
/// Arrays of states have `n + 1` rows, or `n` where the state after the last action is lacking; row t
/// is what held before action t. Arrays of steps have `n` rows. Lengths and angles are in metres and
/// radians, times in seconds, quaternions `w, x, y, z`.
#[derive(Debug, Clone)]
pub struct Recording {
    /// The archive it came from.
    pub path: PathBuf,
    /// Id of the task.
    pub env: String,
    /// Where the trajectory came from.
    pub source: Option<String>,
    /// By which rule the pen's inertia was found, for tasks with pens.
    pub pen_inertia: Option<String>,
    /// Actions, `[n, action_size]`.
    pub action: Rows,
    /// Commands of the actuators, `[n, nu]`.
    pub ctrl: Option<Rows>,
    /// Positions, one row a state, `[_, nq]`.
    pub qpos: Rows,
    /// Velocities, one row a state, `[_, nv]`.
    pub qvel: Rows,
    /// Accelerations from which the solver started, one row a state, `[_, nv]`.
    pub qacc_warmstart: Option<Rows>,
    /// Simulated time, one a state.
    pub time: Option<Rows>,
    /// Observations, one row a state, `[_, obs_size]`.
    pub obs: Option<Rows>,
    /// Rewards, one a step.
    pub reward: Option<Rows>,
    /// Rewards of the task's sparse variant, one a step.
    pub reward_sparse: Option<Rows>,
    /// Rewards stored with the trajectory where `reward` was computed afterwards, one a step.
    pub reward_recorded: Option<Rows>,
    /// Whether the step terminated, 0 or 1, one a step.
    pub terminated: Option<Rows>,
    /// Whether the step reached the goal, 0 or 1, one a step.
    pub success: Option<Rows>,
    /// Goals reached, one row a state.
    pub achieved_goal: Option<Rows>,
    /// The goal of the trajectory; the file may also call it `goal`.
    pub desired_goal: Option<Vec<f64>>,
    /// Positions before the scene settled into the first state, `[nq]`.
    pub presettle_qpos: Option<Vec<f64>>,
    /// Velocities before the scene settled, `[nv]`.
    pub presettle_qvel: Option<Vec<f64>>,
    /// Accelerations from which the solver started settling, `[nv]`.
    pub presettle_qacc_warmstart: Option<Vec<f64>>,
    /// Commands held while the scene settled, `[nu]`.
    pub settle_ctrl: Option<Vec<f64>>,
    /// Positions that one step from the recorded state led to, `[n, nq]`.
    pub next_qpos: Option<Rows>,
    /// Velocities that one step from the recorded state led to, `[n, nv]`.
    pub next_qvel: Option<Rows>,
    /// What the file calls `desired_goal`.
    goal_name: &'static str,
}

impl Recording {
    /// Reads the archive `path` and the settings beside it.
    ///
    /// # Errors
    /// Those of [`Recording::settings`] and [`Recording::read`].
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        Self::read(path, Self::settings(path)?)
    }

    /// Reads the settings beside the archive `path`.
    ///
    /// # Errors
    /// If there are none or they name no task.
    pub fn settings(path: &Path) -> Result<Settings, RecordingError> {
        let path = path.with_extension("json");
        let text = text::read(&path).map_err(|source| RecordingError::io(&path, source))?;
        serde_json::from_str(&text).map_err(|source| RecordingError::Settings { path, source })
    }

    /// Reads the archive `path`, whose settings are `settings`.
    ///
    /// # Errors
    /// If the archive is damaged, or an array is missing, malformed or of the wrong length.
    pub fn read(path: &Path, settings: Settings) -> Result<Self, RecordingError> {
        let mut archive = Archive::open(path, &settings)?;
        let (goal_name, desired_goal) = desired_goal(&mut archive)?;
        let recording = Self {
            action: archive.required("action")?,
            ctrl: archive.rows("ctrl")?,
            qpos: archive.required("qpos")?,
            qvel: archive.required("qvel")?,
            qacc_warmstart: archive.rows("qacc_warmstart")?,
            time: archive.rows("time")?,
            obs: archive.rows("obs")?,
            reward: archive.rows("reward")?,
            reward_sparse: archive.rows("reward_sparse")?,
            reward_recorded: archive.rows("reward_recorded")?,
            terminated: archive.rows("terminated")?,
            success: archive.rows("success")?,
            achieved_goal: archive.rows("achieved_goal")?,
            desired_goal,
            goal_name,
            presettle_qpos: archive.vector("presettle_qpos")?,
            presettle_qvel: archive.vector("presettle_qvel")?,
            presettle_qacc_warmstart: archive.vector("presettle_qacc_warmstart")?,
            settle_ctrl: archive.vector("settle_ctrl")?,
            next_qpos: archive.rows("next_qpos")?,
            next_qvel: archive.rows("next_qvel")?,
            path: path.to_owned(),
            env: settings.env,
            source: settings.source,
            pen_inertia: settings.pen_inertia,
        };
        recording.check_lengths()?;
        recording.check_widths()?;
        Ok(recording)
    }

    /// Number of recorded actions.
    pub fn steps(&self) -> usize {
        self.action.rows()
    }

    /// Whether the trajectory begins anew between rows `t - 1` and `t`.
    pub fn reset_before(&self, t: usize) -> bool {
        let at = |t| self.time.as_ref().and_then(|time| Some(time.get(t)?[0]));
        match (t.checked_sub(1).and_then(at), at(t)) {
            (Some(before), Some(now)) => now <= before,
            _ => t == 0,
        }
    }

    /// Makes sure that the array `name` has `columns` columns, as the task has.
    ///
    /// # Errors
    /// If it has not.
    pub fn expect_columns(
        &self,
        name: &str,
        rows: &Rows,
        columns: usize,
    ) -> Result<(), RecordingError> {
        if rows.columns() == columns {
            return Ok(());
        }
        let (found, env) = (rows.columns(), &self.env);
        let problem = format!("rows have {found} numbers where {env} has {columns}");
        Err(self.problem(name, problem))
    }

    /// Makes sure that the vector `name` has `length` numbers, as the task has.
    ///
    /// # Errors
    /// If it has not.
    pub fn expect_length(
        &self,
        name: &str,
        numbers: &[f64],
        length: usize,
    ) -> Result<(), RecordingError> {
        if numbers.len() == length {
            return Ok(());
        }
        let name = if name == "desired_goal" {
            self.goal_name
        } else {
            name
        };
        let (found, env) = (numbers.len(), &self.env);
        let problem = format!("has {found} numbers where {env} has {length}");
        Err(self.problem(name, problem))
    }

    /// The error that the array `name` is missing.
    pub fn missing(&self, name: &str) -> RecordingError {
        self.problem(name, "is missing")
    }

    /// Makes sure that every number is one to go on from: finite, and within what a simulation can hold
    /// ([`LARGEST`]).
    ///
    /// # Errors
    /// Names the file, the array and the row of the first one that is not.
    pub fn check_finite(&self) -> Result<(), RecordingError> {
        let arrays = [("action", Some(&self.action))];
        for (name, rows) in arrays
            .into_iter()
            .chain(self.states())
            .chain(self.per_step())
        {
            if let Some((row, number)) = rows.and_then(|rows| rows.first_beyond(LARGEST)) {
                let problem = format!("row {row} holds {number:e} {EXPECTED}");
                return Err(self.problem(name, problem));
            }
        }
        for (name, vector) in [
            (self.goal_name, &self.desired_goal),
            ("presettle_qpos", &self.presettle_qpos),
            ("presettle_qvel", &self.presettle_qvel),
            ("presettle_qacc_warmstart", &self.presettle_qacc_warmstart),
            ("settle_ctrl", &self.settle_ctrl),
        ] {
            let numbers = vector.as_deref().unwrap_or_default();
            let wrong = |x: &&f64| x.is_nan() || x.abs() > LARGEST;
            if let Some(number) = numbers.iter().find(wrong) {
                return Err(self.problem(name, format!("holds {number:e} {EXPECTED}")));
            }
        }
        Ok(())
    }

    /// Makes sure that there are as many rows as there are states or steps.
    fn check_lengths(&self) -> Result<(), RecordingError> {
        let steps = self.steps();
        if steps == 0 {
            return Err(self.problem("action", "is empty"));
        }
        for (name, rows) in self.states() {
            if rows.is_some_and(|r| r.rows() != steps && r.rows() != steps + 1) {
                return Err(self.wrong_length(name, rows));
            }
        }
        for (name, rows) in self.per_step() {
            if rows.is_some_and(|r| r.rows() != steps) {
                return Err(self.wrong_length(name, rows));
            }
        }
        Ok(())
    }

    /// Makes sure that the rows of arrays that belong together are equally long.
    fn check_widths(&self) -> Result<(), RecordingError> {
        for (name, rows) in [
            ("time", &self.time),
            ("reward", &self.reward),
            ("reward_sparse", &self.reward_sparse),
            ("reward_recorded", &self.reward_recorded),
            ("terminated", &self.terminated),
            ("success", &self.success),
        ] {
            if let Some(rows) = rows {
                self.expect_columns(name, rows, 1)?;
            }
        }
        let columns = |rows: &Option<Rows>| rows.as_ref().map(Rows::columns);
        let length = |row: &Option<Vec<f64>>| row.as_ref().map(Vec::len);
        let (nq, nv) = (Some(self.qpos.columns()), Some(self.qvel.columns()));
        let nu = columns(&self.ctrl);
        let goal = columns(&self.achieved_goal);
        for (name, found, other, expected) in [
            ("next_qpos", columns(&self.next_qpos), "qpos", nq),
            ("next_qvel", columns(&self.next_qvel), "qvel", nv),
            ("qacc_warmstart", columns(&self.qacc_warmstart), "qvel", nv),
            ("presettle_qpos", length(&self.presettle_qpos), "qpos", nq),
            ("presettle_qvel", length(&self.presettle_qvel), "qvel", nv),
            (
                "presettle_qacc_warmstart",
                length(&self.presettle_qacc_warmstart),
                "qvel",
                nv,
            ),
            ("settle_ctrl", length(&self.settle_ctrl), "ctrl", nu),
            (
                self.goal_name,
                length(&self.desired_goal),
                "achieved_goal",
                goal,
            ),
        ] {
            if let (Some(found), Some(expected)) = (found, expected)
                && found != expected
            {
                let problem =
                    format!("has {found} numbers where the rows of `{other}` have {expected}");
                return Err(self.problem(name, problem));
            }
        }
        Ok(())
    }

    fn states(&self) -> [(&'static str, Option<&Rows>); 6] {
        [
            ("qpos", Some(&self.qpos)),
            ("qvel", Some(&self.qvel)),
            ("qacc_warmstart", self.qacc_warmstart.as_ref()),
            ("time", self.time.as_ref()),
            ("obs", self.obs.as_ref()),
            ("achieved_goal", self.achieved_goal.as_ref()),
        ]
    }

    fn per_step(&self) -> [(&'static str, Option<&Rows>); 8] {
        [
            ("ctrl", self.ctrl.as_ref()),
            ("reward", self.reward.as_ref()),
            ("reward_sparse", self.reward_sparse.as_ref()),
            ("reward_recorded", self.reward_recorded.as_ref()),
            ("terminated", self.terminated.as_ref()),
            ("success", self.success.as_ref()),
            ("next_qpos", self.next_qpos.as_ref()),
            ("next_qvel", self.next_qvel.as_ref()),
        ]
    }

    fn wrong_length(&self, name: &str, rows: Option<&Rows>) -> RecordingError {
        let (rows, steps) = (rows.map_or(0, Rows::rows), self.steps());
        self.problem(name, format!("has {rows} rows for {steps} actions"))
    }

    fn problem(&self, array: &str, problem: impl Into<String>) -> RecordingError {
        RecordingError::array(&self.path, array, problem)
    }
}

/// The goal of the trajectory, and the name it goes by in the file.
fn desired_goal(
    archive: &mut Archive<'_>,
) -> Result<(&'static str, Option<Vec<f64>>), RecordingError> {
    if let Some(goal) = archive.vector("desired_goal")? {
        return Ok(("desired_goal", Some(goal)));
    }
    // Some tasks record a `goal` of another kind, one row a state.
    let goal = archive.contents("goal")?;
    let goal = goal.and_then(|(shape, numbers)| (shape.len() == 1).then_some(numbers));
    Ok(("goal", goal))
}
