//! The program as people use it: commands, files, curves, documentation.

mod action_ranges;
mod another_build;
mod cli;
mod common;
mod compare;
mod demo;
mod demonstrations_format;
mod envs_command;
mod full_buffers;
mod paper;
mod plan;
mod plots;
mod properties;
mod readme;
mod render;
mod resume;
mod settings_command;
mod slurm;
mod sweep;
mod verify;
mod walls;
