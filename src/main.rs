//! The `mamf` binary: parse, dispatch, map errors to exit codes.

use clap::Parser;
use mamf::cli::{Cli, report};
use std::process::ExitCode;

/// Activations and gradients of a 256 x 256 layer lie just above the size at which the system
/// allocator maps and unmaps pages on every call; mimalloc keeps them.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    Cli::parse().run().unwrap_or_else(|error| report(&error))
}
