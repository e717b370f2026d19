//! Wall clock, kept apart from everything that must repeat itself.

use crate::run::TimingRow;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Wall clock since the last row of `timing.csv`.
pub(super) struct Clock {
    since: Instant,
    /// What passed before the run was interrupted.
    before: Duration,
    step: u64,
    pub environment: Duration,
    pub update: Duration,
    pub checkpoint: Duration,
    pub planning: Duration,
}

/// What passed since the last row of `timing.csv`, to go on from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct ClockState {
    step: u64,
    in_all: Duration,
    environment: Duration,
    update: Duration,
    checkpoint: Duration,
    planning: Duration,
}

impl Clock {
    /// From now, at environment step `step`.
    pub fn new(step: u64) -> Clock {
        Clock {
            since: Instant::now(),
            before: Duration::ZERO,
            step,
            environment: Duration::ZERO,
            update: Duration::ZERO,
            checkpoint: Duration::ZERO,
            planning: Duration::ZERO,
        }
    }

    /// What it goes on from.
    pub fn state(&self) -> ClockState {
        ClockState {
            step: self.step,
            in_all: self.in_all(),
            environment: self.environment,
            update: self.update,
            checkpoint: self.checkpoint,
            planning: self.planning,
        }
    }

    /// Goes on from now.
    pub fn resume(state: ClockState) -> Clock {
        Clock {
            since: Instant::now(),
            before: state.in_all,
            step: state.step,
            environment: state.environment,
            update: state.update,
            checkpoint: state.checkpoint,
            planning: state.planning,
        }
    }

    /// Counts what just passed as nothing.
    pub fn leave_out(&mut self, passed: Duration) {
        self.since += passed;
    }

    fn in_all(&self) -> Duration {
        self.before + self.since.elapsed()
    }

    /// The row at `step`.
    pub fn row(&self, step: u64, evaluation: Duration) -> TimingRow {
        let seconds = self.in_all().as_secs_f64();
        TimingRow {
            step,
            seconds,
            steps_per_second: (step - self.step) as f64 / seconds,
            environment_seconds: self.environment.as_secs_f64(),
            update_seconds: self.update.as_secs_f64(),
            evaluation_seconds: evaluation.as_secs_f64(),
            checkpoint_seconds: self.checkpoint.as_secs_f64(),
            planning_seconds: self.planning.as_secs_f64(),
        }
    }
}
