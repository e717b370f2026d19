//! Experiments: one file describes many runs, which are made side by side, each in a process of its own.

mod definition;
pub mod memory;
mod program;
mod runner;
pub mod slurm;
mod standing;

pub use definition::{Changes, PlannedRun, Sweep, SweepError};
pub use program::Program;
pub use runner::{Ended, Outcome, Plan, Watcher, run};
pub use standing::{Progress, Standing};
