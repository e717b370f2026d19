//! `mamf envs`: the tasks.

use std::fmt::Write;
use std::process::ExitCode;

use crate::core::span::in_words;
use crate::core::table::{Column, Table};
use crate::env::{self, Info, Velocity};
use crate::task::Spec;

/// Arguments of `mamf envs`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Task to describe in detail
    #[arg(value_name = "ID")]
    id: Option<String>,
}

/// Prints all tasks, or one in detail.
///
/// # Errors
/// If there is no such task or MuJoCo cannot load its model.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut out = String::new();
    match &args.id {
        Some(id) => describe(&mut out, env::info(id)?, env::make(id)?.0.spec())?,
        None => list(&mut out)?,
    }
    super::print(&out)?;
    Ok(ExitCode::SUCCESS)
}

fn list(out: &mut String) -> anyhow::Result<()> {
    let number = |heading, least| Column::numbers(heading).at_least(least);
    let mut table = Table::new([
        Column::words("id"),
        number("obs", 5),
        number("action", 6),
        number("range", 6),
        number("steps", 5),
        number("dt", 6),
    ]);
    for id in env::ids() {
        let (task, _) = env::make(id)?;
        let spec = task.spec();
        table.row([
            id.to_owned(),
            spec.obs_size.to_string(),
            spec.action_size.to_string(),
            in_words(&spec.action_ranges),
            spec.max_episode_steps.to_string(),
            seconds(spec.dt).to_string(),
        ]);
    }
    write!(out, "{table}")?;
    writeln!(
        out,
        "\nsteps: control steps until an episode is cut; dt: seconds of a control step."
    )?;
    Ok(())
}

fn describe(out: &mut String, info: &Info, spec: &Spec) -> std::fmt::Result {
    writeln!(out, "{}: {}\n", info.id, info.summary)?;
    writeln!(
        out,
        "control step  {} s ({} physics steps)",
        seconds(spec.dt),
        info.frame_skip
    )?;
    writeln!(out, "episode       {} steps", spec.max_episode_steps)?;
    writeln!(
        out,
        "action        {} numbers within {}",
        spec.action_size,
        in_words(&spec.action_ranges)
    )?;
    writeln!(out, "observation   {} numbers", spec.obs_size)?;
    for (start, block) in info.blocks() {
        let range = format!("[{start}:{}]", start + block.len);
        writeln!(out, "    {range:<10}{}", block.what)?;
    }
    writeln!(out, "reward        {}", info.reward)?;
    writeln!(out, "terminates    {}", info.termination)?;
    writeln!(out, "starts        {}", info.reset)?;
    match info.velocity {
        Velocity::None => (),
        Velocity::Index(i) => writeln!(out, "velocity      observation {i}")?,
        Velocity::Computed(how) => writeln!(out, "velocity      {how}")?,
    }
    Ok(())
}

/// Seconds without the digits that binary fractions leave behind.
fn seconds(dt: f64) -> f64 {
    (dt * 1e9).round() / 1e9
}
