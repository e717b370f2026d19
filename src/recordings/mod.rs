//! Recorded trajectories: their format, the check of the tasks against published ones, and demonstrations. No
//! networks.

pub mod demo;
mod demonstrations;
mod errors;
mod find;
pub mod format;
mod replayer;
pub mod verify;

pub use demonstrations::{DemonstrationError, DemonstrationState, Demonstrations, Sizes};
pub use errors::Errors;
pub use find::{FindError, find};
pub use replayer::ReplayError;
