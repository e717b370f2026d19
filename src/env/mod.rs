//! The tasks in MuJoCo: a simulator behind [`Env`](crate::task::Env), and what its designer knows behind
//! [`Rules`](crate::task::Rules).
//!
//! A task with a goal has it at the end of its observation, where rules and policies find it.
//! Nothing here learns and nothing here sees a tensor: observations and actions are plain slices.

mod doubled;
mod hands;
mod inspect;
mod locomotion;
mod noise;
mod registry;
mod scene;
mod simulation;
mod task;

pub use doubled::{doubled, doubled_rules};
pub use hands::PenInertia;
pub use inspect::Inspect;
pub use registry::{
    Made, MakeError, UnknownTask, ids, info, make, make_inspect, make_watched, make_with, model,
    rules,
};
pub use scene::Scene;
pub use simulation::Simulation;
pub use task::{Block, Command, Info, Recorded, Task, Velocity, block};
