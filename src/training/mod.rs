//! The only room where a simulator and an agent meet: the loop, where experience comes from, evaluation.

mod assemble;
mod clock;
mod collector;
mod error;
mod evaluation;
mod guidance;
mod metrics;
mod plan;
mod rehearsal;
mod segments;
mod state;
mod telemetry;
mod trainer;
mod video;

pub use assemble::{
    agent_settings, demonstrations, fresh_agent, make_env, make_rules, planner, saved_policy,
    taught_planner,
};
pub use error::TrainError;
pub use evaluation::{EpisodeResult, Evaluation, Evaluator, Watch};
pub use plan::{Plan, PlanError, PlanRow};
pub use state::{ResumeOptions, Resumed};
pub use trainer::{Monitor, Outcome, Status, Trainer};
pub use video::{Camera, check_video};
