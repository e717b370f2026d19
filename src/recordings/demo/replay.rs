//! How far the simulator is from a recording, step by step and over whole trajectories.

use std::path::{Path, PathBuf};

use super::{Series, UnusableRecording, common_directory, name, tasks};
use crate::core::table::{Cell, NOTHING, Table};
use crate::recordings::format::Recording;
use crate::recordings::replayer::{Replayer, row};
use crate::recordings::verify::{largest, number};
use crate::recordings::{Errors, ReplayError};
use crate::task::Step;

/// Error of positions (metres, radians) past which an open-loop replay has left the recording.
pub const DRIFT: f64 = 1e-3;

/// Difference past which a stored reward and ours are two.
pub const STORED_DIFFERENCE: f64 = 1e-6;

/// How one step from a recorded state compares with the recording. Errors are the largest of all
/// positions (velocities) that something depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct OneStep {
    /// The step.
    pub t: usize,
    /// Whether something touched a shape that only approximates the published one.
    pub touched: bool,
    /// Whether the simulation diverged.
    pub diverged: bool,
    /// Error of the positions, where the next state is recorded.
    pub qpos: Option<f64>,
    /// Error of the velocities, where the next state is recorded.
    pub qvel: Option<f64>,
    /// Difference from `next_qpos`, where that is recorded.
    pub next_qpos: Option<f64>,
    /// Difference from `next_qvel`, where that is recorded.
    pub next_qvel: Option<f64>,
    /// Difference from `reward`, where that is recorded.
    pub reward: Option<f64>,
    /// Difference from `reward_recorded`, where that is recorded.
    pub stored: Option<f64>,
    /// The same difference by the rule with the spin term capped; PenSpin only.
    pub stored_capped: Option<f64>,
    /// Whether only one of simulator and recording reports success.
    pub success_differs: bool,
}

/// A whole trajectory from its first recorded state through all recorded actions.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OpenLoop {
    /// Largest error of the positions; infinite if the simulation diverged.
    pub worst: f64,
    /// The same before something first touches a shape that only approximates the published one.
    pub worst_untouched: f64,
    /// Number of steps after which the error first exceeds [`DRIFT`].
    pub drifted_after: Option<usize>,
}

/// A replayed recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Replayed {
    /// The archive.
    pub path: PathBuf,
    /// Id of the task.
    pub task: String,
    /// Each step, from its recorded state.
    pub steps: Vec<OneStep>,
    /// All of it, from the first.
    pub open_loop: OpenLoop,
    /// Whether the task has shapes that approximate the published ones.
    pub watched: bool,
    /// Whether the recording tells successes.
    pub has_success: bool,
}

/// Replays `recording` step by step, and as a whole.
///
/// Each step begins in the recorded state. Where the recording holds the accelerations from which the
/// solver started, the state is written over that of the step before, so that what the tasks read late
/// is as late as in the recording; where it does not, a forward pass with the previous command finds
/// them, as it does when training begins in a demonstration.
///
/// # Errors
/// If the task is unknown, the arrays do not fit it or a number is not finite.
pub fn replay(recording: &Recording) -> Result<Replayed, UnusableRecording> {
    let mut comparison = Comparison::new(recording)?;
    let steps = (0..recording.steps()).filter_map(|t| comparison.one_step(t));
    let steps = steps.collect();
    Ok(Replayed {
        path: recording.path.clone(),
        task: recording.env.clone(),
        steps,
        open_loop: comparison.open_loop(),
        watched: !comparison.replayer.recorded.approximate_geoms.is_empty(),
        has_success: recording.success.is_some(),
    })
}

/// A recording beside the simulation.
struct Comparison<'a> {
    replayer: Replayer<'a>,
    /// Whether the last step left a simulation that can go on.
    sound: bool,
}

impl<'a> Comparison<'a> {
    fn new(recording: &'a Recording) -> Result<Self, UnusableRecording> {
        let replayer = Replayer::new(recording, &recording.env);
        let replayer = replayer.map_err(|error| match error {
            ReplayError::Make(error) => UnusableRecording::task(&recording.path)(error),
            ReplayError::Recording(error) => error.into(),
        })?;
        recording.check_finite()?;
        Ok(Self {
            replayer,
            sound: false,
        })
    }

    /// Begins anew in the recorded state `t`, after the recorded action; false if there is none.
    fn begin(&mut self, t: usize) -> bool {
        let recording = self.replayer.recording;
        let (Some(qpos), Some(qvel)) = (recording.qpos.get(t), recording.qvel.get(t)) else {
            return false;
        };
        let before = t.checked_sub(1).filter(|_| !recording.reset_before(t));
        let action = before.and_then(|before| recording.action.get(before));
        self.replayer.begin(qpos, qvel, action);
        if row(&recording.qacc_warmstart, t).is_some() {
            // The forward pass may have normalised quaternions.
            self.replayer.write(t);
        }
        true
    }

    /// Puts the simulation into the recorded state `t`; false if there is none.
    fn place(&mut self, t: usize) -> bool {
        let recording = self.replayer.recording;
        let goes_on = self.sound && !recording.reset_before(t);
        if goes_on && row(&recording.qacc_warmstart, t).is_some() && self.replayer.write(t) {
            return true;
        }
        self.begin(t)
    }

    fn one_step(&mut self, t: usize) -> Option<OneStep> {
        let recording = self.replayer.recording;
        let action = recording.action.get(t)?;
        if !self.place(t) {
            return None;
        }
        let step = self.replayer.step(action);
        self.sound = !step.diverged;
        let after = (!recording.reset_before(t + 1)).then_some(t + 1);
        let number = |rows| Some(row(rows, t)?[0]);
        let stored = number(&recording.reward_recorded);
        let success = number(&recording.success).zip(step.success);
        // What a simulation that diverged is left with is no outcome of the step.
        let error = |error: f64| if step.diverged { f64::INFINITY } else { error };
        let qpos = |row: Option<&[f64]>| Some(error(self.qpos_error(row?)));
        let qvel = |row: Option<&[f64]>| Some(error(self.qvel_error(row?)));
        let from = |reward: f64| move |recorded: f64| error(difference(reward, recorded));
        Some(OneStep {
            t,
            touched: self.replayer.env.touched(),
            diverged: step.diverged,
            qpos: qpos(after.and_then(|t| recording.qpos.get(t))),
            qvel: qvel(after.and_then(|t| recording.qvel.get(t))),
            next_qpos: qpos(row(&recording.next_qpos, t)),
            next_qvel: qvel(row(&recording.next_qvel, t)),
            reward: number(&recording.reward).map(from(step.reward)),
            stored: stored.map(from(step.reward)),
            stored_capped: stored
                .zip(self.capped_reward(&step))
                .map(|(recorded, capped)| from(capped)(recorded)),
            success_differs: success.is_some_and(|(recorded, found)| found != (recorded != 0.0)),
        })
    }

    fn open_loop(&mut self) -> OpenLoop {
        let recording = self.replayer.recording;
        let mut found = OpenLoop::default();
        let (mut began, mut touched) = (0, false);
        for t in 0..recording.steps() {
            if recording.reset_before(t) {
                (began, touched) = (t, false);
                if !self.begin(t) {
                    break;
                }
            }
            let Some(action) = recording.action.get(t) else {
                break;
            };
            let step = self.replayer.step(action);
            touched |= self.replayer.env.touched();
            let error = match recording.qpos.get(t + 1) {
                _ if step.diverged => f64::INFINITY,
                Some(qpos) if !recording.reset_before(t + 1) => self.qpos_error(qpos),
                _ => continue,
            };
            found.worst = found.worst.max(error);
            if !touched {
                found.worst_untouched = found.worst_untouched.max(error);
            }
            if error > DRIFT {
                found.drifted_after.get_or_insert(t + 1 - began);
            }
            if step.diverged {
                break;
            }
        }
        found
    }

    fn qpos_error(&self, qpos: &[f64]) -> f64 {
        let mut errors = Errors::default();
        self.replayer.compare_qpos(&mut errors, qpos);
        errors.largest().unwrap_or(0.0)
    }

    fn qvel_error(&self, qvel: &[f64]) -> f64 {
        let mut errors = Errors::default();
        self.replayer.compare_qvel(&mut errors, qvel, false);
        errors.largest().unwrap_or(0.0)
    }

    /// The reward by the earlier rule that the rewards stored with the published recordings follow: the spin term
    /// counts 8 at most. Of tasks that reward spin.
    fn capped_reward(&self, step: &Step) -> Option<f64> {
        const CAP: f64 = 8.0;
        let spin = self.replayer.observation[self.replayer.recorded.spin?];
        Some(spin.min(CAP) + (step.reward - spin))
    }
}

fn difference(found: f64, recorded: f64) -> f64 {
    let mut errors = Errors::default();
    errors.add(found, recorded, false);
    errors.largest().unwrap_or(0.0)
}

/// What the steps of one recording, or of several, come to. Steps in which something touched an
/// approximate shape are left out but for [`touched`](Figures::touched) and
/// [`qpos_touched`](Figures::qpos_touched).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figures {
    /// Number of steps.
    pub steps: usize,
    /// Steps in which something touched an approximate shape.
    pub touched: usize,
    /// Errors of the positions in those steps.
    pub qpos_touched: Series,
    /// Steps at which the simulation diverged.
    pub diverged: usize,
    /// Errors of the positions.
    pub qpos: Series,
    /// Errors of the velocities.
    pub qvel: Series,
    /// Differences from `next_qpos`.
    pub next_qpos: Errors,
    /// Differences from `next_qvel`.
    pub next_qvel: Errors,
    /// Differences from `reward`.
    pub reward: Errors,
    /// Differences from `reward_recorded`.
    pub stored: Errors,
    /// How many of those exceed [`STORED_DIFFERENCE`].
    pub stored_differs: usize,
    /// Differences from `reward_recorded` by the rule with the spin term capped; PenSpin only.
    pub stored_capped: Errors,
    /// Steps at which only one of simulator and recording reports success.
    pub success_differs: usize,
    /// Worst errors of the open-loop replays, one a recording.
    pub open_loop: Series,
    /// The same before something first touches an approximate shape.
    pub open_loop_untouched: Series,
    /// How many of them drifted away.
    pub drifted: usize,
}

impl Figures {
    /// The figures of all of `recordings`.
    pub fn of<'a>(recordings: impl IntoIterator<Item = &'a Replayed>) -> Figures {
        let mut figures = Figures::default();
        for recording in recordings {
            recording.steps.iter().for_each(|step| figures.add(step));
            let open_loop = &recording.open_loop;
            figures.open_loop.push(open_loop.worst);
            figures.open_loop_untouched.push(open_loop.worst_untouched);
            figures.drifted += usize::from(open_loop.drifted_after.is_some());
        }
        figures
    }

    fn add(&mut self, step: &OneStep) {
        self.steps += 1;
        self.diverged += usize::from(step.diverged);
        if step.touched {
            self.touched += 1;
            step.qpos.iter().for_each(|e| self.qpos_touched.push(*e));
            return;
        }
        step.qpos.iter().for_each(|e| self.qpos.push(*e));
        step.qvel.iter().for_each(|e| self.qvel.push(*e));
        for (errors, error) in [
            (&mut self.next_qpos, step.next_qpos),
            (&mut self.next_qvel, step.next_qvel),
            (&mut self.reward, step.reward),
            (&mut self.stored, step.stored),
            (&mut self.stored_capped, step.stored_capped),
        ] {
            error.iter().for_each(|e| errors.add(*e, 0.0, false));
        }
        self.stored_differs += usize::from(step.stored > Some(STORED_DIFFERENCE));
        self.success_differs += usize::from(step.success_differs);
    }
}

/// For each task its id, a table with a line for each recording and, if there are several, one for all
/// of them, and the steps in which something touched an approximate shape.
pub fn tables(replayed: &[Replayed]) -> String {
    let base = common_directory(replayed.iter().map(|r| r.path.as_path()));
    let mut text = String::new();
    for task in tasks(replayed, |r| &r.task) {
        let of_task: Vec<&Replayed> = replayed.iter().filter(|r| r.task == task).collect();
        let mut lines: Vec<Vec<Cell>> = of_task.iter().map(|r| one(r, &base)).collect();
        if of_task.len() > 1 {
            lines.push(all(&of_task));
        }
        text += &format!("{task}\n{}", Table::of(&lines, &["recording"]));
        for recording in of_task {
            let name = name(&recording.path, &base);
            let touched = recording.steps.iter().filter(|step| step.touched);
            let touched = ranges(touched.map(|step| step.t));
            if !touched.is_empty() {
                text += &format!("touched in {name}: {touched}\n");
            }
        }
        text.push('\n');
    }
    text
}

fn one(recording: &Replayed, base: &Path) -> Vec<Cell> {
    let drifted = recording.open_loop.drifted_after;
    let drifted = drifted.map_or(NOTHING.to_owned(), |steps| steps.to_string());
    let name = name(&recording.path, base);
    cells(name, &[recording], NOTHING.to_owned(), drifted)
}

fn all(recordings: &[&Replayed]) -> Vec<Cell> {
    let figures = Figures::of(recordings.iter().copied());
    let drifted = match figures.drifted {
        0 => NOTHING.to_owned(),
        n => format!("{n} of {}", recordings.len()),
    };
    let median = number(figures.open_loop.median());
    cells("all".to_owned(), recordings, median, drifted)
}

fn cells(name: String, recordings: &[&Replayed], median: String, drifted: String) -> Vec<Cell> {
    let found = Figures::of(recordings.iter().copied());
    let told = |is_told: bool, n: usize| match is_told {
        true => n.to_string(),
        false => NOTHING.to_owned(),
    };
    let has_stored = found.stored.largest().is_some();
    vec![
        ("recording", name),
        ("steps", found.steps.to_string()),
        (
            "touched",
            told(recordings.iter().any(|r| r.watched), found.touched),
        ),
        ("diverged", told(found.diverged > 0, found.diverged)),
        ("compared", found.qpos.count().to_string()),
        ("qpos median", number(found.qpos.median())),
        ("99 %", number(found.qpos.quantile(0.99))),
        ("max", number(found.qpos.largest())),
        ("there", number(found.qpos_touched.largest())),
        ("qvel median", number(found.qvel.median())),
        ("max", number(found.qvel.largest())),
        ("next qpos", largest(&found.next_qpos)),
        ("next qvel", largest(&found.next_qvel)),
        ("reward", largest(&found.reward)),
        ("stored", largest(&found.stored)),
        ("differ", told(has_stored, found.stored_differs)),
        ("capped", largest(&found.stored_capped)),
        (
            "success",
            told(
                recordings.iter().any(|r| r.has_success),
                found.success_differs,
            ),
        ),
        ("open-loop median", median),
        ("worst", number(found.open_loop.largest())),
        ("drift", drifted),
        (
            "untouched",
            match found.touched {
                0 => NOTHING.to_owned(),
                _ => number(found.open_loop_untouched.largest()),
            },
        ),
    ]
}

/// Ascending numbers with neighbours drawn together: `3-5, 8`.
fn ranges(numbers: impl Iterator<Item = usize>) -> String {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for n in numbers {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == n => *last = n,
            _ => ranges.push((n, n)),
        }
    }
    let text = |(first, last): (usize, usize)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    let ranges: Vec<String> = ranges.into_iter().map(text).collect();
    ranges.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_drawn_together() {
        assert_eq!(ranges([0, 1, 2, 5, 7, 8].into_iter()), "0-2, 5, 7-8");
        assert!(ranges(std::iter::empty()).is_empty());
    }
}
