//! Model-assisted model-free reinforcement learning on MuJoCo.

pub mod agent;
pub mod cli;
pub mod config;
pub mod core;
pub mod env;
pub mod lab;
pub mod model;
pub mod nn;
pub mod recordings;
pub mod render;
pub mod replay;
pub mod run;
pub mod task;
pub mod training;
