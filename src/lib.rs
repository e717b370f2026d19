//! Model-assisted model-free reinforcement learning on MuJoCo.

pub mod agent;
pub mod cli;
pub mod config;
pub mod core;
pub mod env;
pub mod lab;
pub mod model;
pub mod nn;
pub mod planning;
pub mod recordings;
pub mod render;
pub mod replay;
pub mod run;
pub mod task;
pub mod training;

/// The examples of the page on extending, as tests.
#[cfg(doctest)]
#[doc = include_str!("../docs/extending.md")]
struct Extending;
