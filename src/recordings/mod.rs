//! Recorded trajectories: their format, the check of the tasks against published ones, and demonstrations. No
//! networks.

pub mod demo;
mod demonstrations;
mod find;
pub mod format;
pub mod verify;

pub use demonstrations::{DemonstrationError, DemonstrationState, Demonstrations, Sizes};
pub use find::{FindError, find};
