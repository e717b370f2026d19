//! The `mamf` binary: parse, dispatch, map errors to exit codes.

use clap::Parser;
use mamf::cli::{Cli, exit_code};
use std::process::ExitCode;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            exit_code(&error)
        }
    }
}
