//! Trajectory optimisation in the simulator: at every control step, sequences of actions are tried out from the very
//! state of the task, better ones are made of the best, and the first action of one of them is executed.
//!
//! A [`Strategy`] is a way of making sequences; [`Rollouts`] tries them out; the [`Planner`] is a
//! [`Controller`](crate::agent::Controller) made of both.

mod episode;
mod icem;
mod knots;
mod mppi;
mod noise;
mod planner;
mod rollouts;
mod sampling;
mod settings;
mod strategy;
mod topdm;

pub use episode::Worthwhile;
pub use planner::{Planner, Worth};
pub use rollouts::{MakeEnv, Origin, Rollouts, Value};
pub use settings::{Interpolation, PlannerMethod, PlannerSettings};
pub use strategy::{Sequences, Shape, Strategy};
