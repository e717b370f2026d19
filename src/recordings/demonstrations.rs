//! Demonstrations: states of recorded trajectories, from which segments of experience begin.

use std::path::{Path, PathBuf};

use rand::RngExt;

use crate::core::files::{Checksum, Checksummer};
use crate::core::random::Stream;
use crate::core::span::Span;
use crate::recordings::format::{Recording, RecordingError, Rows};
use crate::recordings::{FindError, find};
use crate::task::{self, Spec};

/// Why there are no demonstrations. Each message names the file, or the pattern that finds none.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DemonstrationError {
    /// There is no file to read.
    #[error(transparent)]
    Find(#[from] FindError),
    /// A file is damaged, or its rows are not as long as the task's, or not of finite numbers.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A file is of another task.
    #[error("{}: is of {found}, not {expected}", path.display())]
    Task {
        /// The file.
        path: PathBuf,
        /// Its task.
        found: String,
        /// The task asked for.
        expected: String,
    },
    /// A file holds several episodes.
    #[error("{}: begins anew at row {row}; a demonstration is one trajectory without a reset", path.display())]
    Reset {
        /// The file.
        path: PathBuf,
        /// The first row after the reset.
        row: usize,
    },
}

/// The task that demonstrations are for.
#[derive(Debug, Clone, Copy)]
pub struct Sizes<'a> {
    /// Id of the task.
    pub task: &'a str,
    /// Length of the positions.
    pub nq: usize,
    /// Length of the velocities.
    pub nv: usize,
    /// Length of the observations, without the goal.
    pub obs_size: usize,
    /// Length of the goal; 0 for a task without one.
    pub goal_size: usize,
    /// Length of the actions.
    pub action_size: usize,
    /// Where each number of an action lies.
    pub action_ranges: &'a [Span],
}

impl Sizes<'_> {
    /// Those of the task `spec`.
    pub fn of(spec: &Spec) -> Sizes<'_> {
        Sizes {
            task: &spec.id,
            nq: spec.nq,
            nv: spec.nv,
            obs_size: spec.obs_size - spec.goal_size,
            goal_size: spec.goal_size,
            action_size: spec.action_size,
            action_ranges: &spec.action_ranges,
        }
    }

    /// Makes sure that the rows of `recording` are as long as the task's.
    ///
    /// # Errors
    /// Names the first array that is not.
    pub fn check(&self, recording: &Recording) -> Result<(), RecordingError> {
        let rows = [
            ("action", Some(&recording.action), self.action_size),
            ("qpos", Some(&recording.qpos), self.nq),
            ("qvel", Some(&recording.qvel), self.nv),
            ("qacc_warmstart", recording.qacc_warmstart.as_ref(), self.nv),
            ("ctrl", recording.ctrl.as_ref(), self.action_size),
            ("obs", recording.obs.as_ref(), self.obs_size),
            (
                "achieved_goal",
                recording.achieved_goal.as_ref(),
                self.goal_size,
            ),
        ];
        for (name, rows, columns) in rows {
            if let Some(rows) = rows {
                recording.expect_columns(name, rows, columns)?;
            }
        }
        let vectors = [
            ("desired_goal", &recording.desired_goal, self.goal_size),
            ("presettle_qpos", &recording.presettle_qpos, self.nq),
            ("presettle_qvel", &recording.presettle_qvel, self.nv),
            (
                "presettle_qacc_warmstart",
                &recording.presettle_qacc_warmstart,
                self.nv,
            ),
            ("settle_ctrl", &recording.settle_ctrl, self.action_size),
        ];
        for (name, numbers, length) in vectors {
            if let Some(numbers) = numbers {
                recording.expect_length(name, numbers, length)?;
            }
        }
        Ok(())
    }
}

/// Recorded trajectories of one task, from whose states training segments begin.
#[derive(Debug, Clone, Default)]
pub struct Demonstrations {
    trajectories: Vec<Demonstration>,
}

#[derive(Debug, Clone)]
struct Demonstration {
    action: Rows,
    qpos: Rows,
    qvel: Rows,
    /// What the recorded episode was about, where the recording says it.
    goal: Option<Vec<f64>>,
}

/// A state of a demonstration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DemonstrationState<'a> {
    /// Positions, `[nq]`.
    pub qpos: &'a [f64],
    /// Velocities, `[nv]`.
    pub qvel: &'a [f64],
    /// Action executed before this state, `[action_size]`; `None` at the first.
    pub previous_action: Option<&'a [f64]>,
    /// Positions in the trajectory's first state, `[nq]`.
    pub first_qpos: &'a [f64],
}

/// States of a demonstration, each with the action that follows it.
pub type Steps<'a> = Vec<(DemonstrationState<'a>, &'a [f64])>;

impl Demonstrations {
    /// Reads the recordings that `pattern` means; see [`find`].
    ///
    /// Demonstrations of a task serve its sparse variant and the other way round, as both differ in
    /// the reward alone. Actions beyond the limit are brought within it, as the task does with those
    /// it executes.
    ///
    /// # Errors
    /// If there is no recording, or one is damaged, of another task, of other sizes, holds a number
    /// that is not finite or more than one episode.
    pub fn load(
        pattern: impl AsRef<Path>,
        sizes: &Sizes<'_>,
    ) -> Result<Demonstrations, DemonstrationError> {
        let files = find(pattern.as_ref())?;
        let trajectories: Result<Vec<_>, _> = files
            .iter()
            .map(|path| Demonstration::read(path, sizes))
            .collect();
        Ok(Demonstrations {
            trajectories: trajectories?,
        })
    }

    /// Makes sure that `recording` can serve as a demonstration.
    ///
    /// # Errors
    /// If it is of another task or of other sizes, or holds a number that is not finite or more than
    /// one episode.
    pub fn check(recording: &Recording, sizes: &Sizes<'_>) -> Result<(), DemonstrationError> {
        check_task(&recording.path, &recording.env, sizes)?;
        sizes.check(recording)?;
        recording.check_finite()?;
        match (1..recording.qpos.rows()).find(|&t| recording.reset_before(t)) {
            None => Ok(()),
            Some(row) => Err(DemonstrationError::Reset {
                path: recording.path.clone(),
                row,
            }),
        }
    }

    /// These, and `more` after them.
    #[must_use]
    pub fn with(&self, more: Demonstrations) -> Demonstrations {
        let mut trajectories = self.trajectories.clone();
        trajectories.extend(more.trajectories);
        Demonstrations { trajectories }
    }

    /// Whether there are none, so that none can be drawn.
    pub fn is_empty(&self) -> bool {
        self.trajectories.is_empty()
    }

    /// Number of trajectories.
    pub fn trajectories(&self) -> usize {
        self.trajectories.len()
    }

    /// Number of states that precede an action, over all trajectories.
    pub fn states(&self) -> usize {
        self.trajectories.iter().map(|t| t.action.rows()).sum()
    }

    /// Of all their numbers, in order.
    pub fn checksum(&self) -> Checksum {
        let mut checksummer = Checksummer::default();
        for demonstration in &self.trajectories {
            for rows in [
                &demonstration.action,
                &demonstration.qpos,
                &demonstration.qvel,
            ] {
                checksummer.add(&(rows.rows() as u64).to_le_bytes());
                for row in 0..rows.rows() {
                    for number in rows.get(row).unwrap_or_default() {
                        checksummer.add(&number.to_le_bytes());
                    }
                }
            }
        }
        checksummer.checksum()
    }

    /// The trajectories, each with the goal of its episode, where it says one, and its states that precede an action
    /// with that action, `[action_size]`.
    pub fn each(&self) -> impl Iterator<Item = (Option<&[f64]>, Steps<'_>)> {
        self.trajectories.iter().map(|trajectory| {
            let steps = (0..trajectory.action.rows())
                .filter_map(|t| Some((trajectory.state(t)?, trajectory.action.get(t)?)));
            (trajectory.goal.as_deref(), steps.collect())
        })
    }

    /// `states` of those states, or all if there are not as many, spread evenly over all trajectories, each with the
    /// goal of its episode where the recording says one.
    pub fn spread(
        &self,
        states: usize,
    ) -> impl Iterator<Item = (DemonstrationState<'_>, Option<&[f64]>)> {
        let all = self.trajectories.iter().flat_map(|trajectory| {
            let states = (0..trajectory.action.rows()).filter_map(|t| trajectory.state(t));
            states.map(|state| (state, trajectory.goal.as_deref()))
        });
        let (total, wanted) = (self.states(), states.min(self.states()));
        // Number i is taken where i * wanted / total steps up.
        all.enumerate()
            .filter(move |(i, _)| (i + 1) * wanted / total > i * wanted / total)
            .map(|(_, state)| state)
    }

    /// A uniformly random one of the states that precede an action, of a uniformly random trajectory, of which there must be one.
    pub fn draw(&self, rng: &mut Stream) -> DemonstrationState<'_> {
        let trajectory = &self.trajectories[rng.random_range(0..self.trajectories.len())];
        let t = rng.random_range(0..trajectory.action.rows());
        trajectory.state(t).expect("each action has a state")
    }
}

impl Demonstration {
    fn read(path: &Path, sizes: &Sizes<'_>) -> Result<Demonstration, DemonstrationError> {
        let settings = Recording::settings(path)?;
        check_task(path, &settings.env, sizes)?;
        let recording = Recording::read(path, settings)?;
        Demonstrations::check(&recording, sizes)?;
        Ok(Demonstration {
            action: recording.action.clipped(sizes.action_ranges),
            qpos: recording.qpos,
            qvel: recording.qvel,
            goal: recording.desired_goal,
        })
    }

    /// The state before action `t`, if there is one.
    fn state(&self, t: usize) -> Option<DemonstrationState<'_>> {
        Some(DemonstrationState {
            qpos: self.qpos.get(t)?,
            qvel: self.qvel.get(t)?,
            previous_action: t.checked_sub(1).and_then(|before| self.action.get(before)),
            first_qpos: self.qpos.get(0)?,
        })
    }
}

/// Makes sure that the recording `path` of the task `found` is of the one that `sizes` are of.
fn check_task(path: &Path, found: &str, sizes: &Sizes<'_>) -> Result<(), DemonstrationError> {
    if task::dense(found) == task::dense(sizes.task) {
        return Ok(());
    }
    Err(DemonstrationError::Task {
        path: path.to_owned(),
        found: found.to_owned(),
        expected: sizes.task.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;

    /// A trajectory of `steps` steps whose row t holds `base + t`, and action t the same plus 0.5.
    fn demonstration(base: f64, steps: usize) -> Demonstration {
        let column = |rows: usize, plus: f64| {
            let numbers = (0..rows).map(|t| base + t as f64 + plus).collect();
            Rows::new(numbers, rows, 1)
        };
        Demonstration {
            action: column(steps, 0.5),
            qpos: column(steps + 1, 0.0),
            qvel: column(steps + 1, 0.1),
            goal: None,
        }
    }

    fn two() -> Demonstrations {
        Demonstrations {
            trajectories: vec![demonstration(0.0, 2), demonstration(100.0, 8)],
        }
    }

    #[test]
    fn states_come_with_the_action_before_them() {
        let demonstrations = two();
        assert_eq!(
            (demonstrations.trajectories(), demonstrations.states()),
            (2, 10)
        );
        let mut rng = stream(1, "demonstrations");
        for _ in 0..500 {
            let state = demonstrations.draw(&mut rng);
            let (qpos, first) = (state.qpos[0], state.first_qpos[0]);
            assert_eq!(state.qvel, [qpos + 0.1]);
            assert_eq!(first, if qpos < 50.0 { 0.0 } else { 100.0 });
            let last = if qpos < 50.0 { 1.0 } else { 107.0 };
            assert!((first..=last).contains(&qpos), "{qpos}");
            match state.previous_action {
                None => assert_eq!(qpos, first),
                Some(action) => assert_eq!(action, [qpos - 0.5]),
            }
        }
    }

    #[test]
    fn trajectories_are_equally_likely_whatever_their_length() {
        let demonstrations = two();
        let mut rng = stream(2, "demonstrations");
        let mut counts = std::collections::BTreeMap::new();
        for _ in 0..16_000 {
            let qpos = demonstrations.draw(&mut rng).qpos[0] as u64;
            *counts.entry(qpos).or_insert(0) += 1;
        }
        assert_eq!(counts.len(), 10, "{counts:?}");
        for (state, count) in counts {
            let expected = if state < 50 { 4000.0 } else { 1000.0 };
            let deviations = (f64::from(count) - expected) / f64::sqrt(expected);
            assert!(deviations.abs() < 4.0, "{state}: {count}");
        }
    }

    #[test]
    fn spread_states_are_evenly_apart_and_all_of_them_at_most() {
        let demonstrations = two();
        let spread = |n| {
            let states = demonstrations.spread(n);
            states.map(|(state, _)| state.qpos[0]).collect::<Vec<f64>>()
        };
        assert_eq!(spread(5), [1.0, 101.0, 103.0, 105.0, 107.0]);
        assert_eq!(spread(10), spread(99));
        assert_eq!(spread(99).len(), 10);
        assert!(spread(0).is_empty());
        let each: Vec<usize> = demonstrations
            .each()
            .map(|(_, steps)| steps.len())
            .collect();
        assert_eq!(each, [2, 8]);
    }

    #[test]
    fn draws_repeat_for_one_seed() {
        let demonstrations = two();
        let draws = |seed| {
            let mut rng = stream(seed, "demonstrations");
            let draws = (0..50).map(|_| demonstrations.draw(&mut rng).qpos[0]);
            draws.collect::<Vec<f64>>()
        };
        assert_eq!(draws(1), draws(1));
        assert_ne!(draws(1), draws(2));
    }
}
