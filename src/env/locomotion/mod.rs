//! The locomotion tasks, version 4: figures and rules as published with gymnasium 0.29.1.

mod forward;
mod half_cheetah;
mod inverted_pendulum;
mod reacher;

pub use half_cheetah::HalfCheetah;
pub use inverted_pendulum::InvertedPendulum;
pub use reacher::Reacher;

use super::noise;
use super::task::{self, Block, Info, Task};
use super::{Rules, VelocityReading};
use crate::random::Stream;
