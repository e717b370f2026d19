//! Model-assisted model-free reinforcement learning on MuJoCo.

pub mod agent;
pub mod cli;
pub mod comparison;
pub mod config;
pub mod demonstration;
pub mod env;
pub mod files;
pub mod imagination;
pub mod nn;
pub mod parallel;
pub mod random;
pub mod recording;
pub mod render;
pub mod replay;
pub mod sweep;
pub mod table;
pub mod training;
pub mod verification;
pub mod walk;
