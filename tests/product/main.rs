//! The program as people use it: commands, files, curves, documentation.

mod cli;
mod common;
mod compare;
mod demo;
mod demonstrations_format;
mod envs_command;
mod file_systems;
mod interrupted;
mod odd_paths;
mod paper;
mod plots;
mod properties;
mod readme;
mod render;
mod resume;
mod run_ends;
mod settings_command;
mod slurm;
mod sweep;
mod unread;
mod verify;
mod walls;
mod wording;
