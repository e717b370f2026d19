//! The `mamf` binary: parse, dispatch, map errors to exit codes.

use clap::Parser;
use mamf::cli::{Cli, report};
use std::process::ExitCode;

fn main() -> ExitCode {
    Cli::parse().run().unwrap_or_else(|error| report(&error))
}
