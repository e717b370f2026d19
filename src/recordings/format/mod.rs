//! Recorded trajectories of a task on disk: found, read and written. No simulator, no networks.
//!
//! A recording is two files of one name. The `.npz` file is a ZIP archive of `.npy` arrays, all of
//! little-endian doubles in C order; the `.json` file beside it holds the settings: the task, where
//! the trajectory came from, and the shape, the meaning and the place in the file of each array.
//!
//! Arrays of states have in row t what held before action t, and one row more than there are actions
//! unless the state after the last action is lacking. Arrays of steps have one row an action.

mod archive;
mod error;
mod read;
mod rows;
mod write;

pub use error::RecordingError;
pub use read::{LARGEST, Recording, Settings};
pub use rows::Rows;
pub use write::{Array, Recorder, State, Step, WriteError, write};
