//! `mamf envs`: the tasks.

use std::io::Write;
use std::process::ExitCode;

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
    let mut out = std::io::stdout().lock();
    match &args.id {
        Some(id) => describe(&mut out, env::info(id)?, env::make(id)?.0.spec())?,
        None => list(&mut out)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn list(out: &mut impl Write) -> anyhow::Result<()> {
    let width = env::ids().map(str::len).max().unwrap_or(0);
    writeln!(
        out,
        "{:width$}  {:>5}  {:>6}  {:>6}  {:>5}  {:>6}",
        "id", "obs", "action", "range", "steps", "dt"
    )?;
    for id in env::ids() {
        let (task, _) = env::make(id)?;
        let spec = task.spec();
        writeln!(
            out,
            "{id:width$}  {:>5}  {:>6}  {:>6}  {:>5}  {:>6}",
            spec.obs_size,
            spec.action_size,
            format!("+-{}", spec.action_limit),
            spec.max_episode_steps,
            seconds(spec.dt),
        )?;
    }
    writeln!(
        out,
        "\nsteps: control steps until an episode is cut; dt: seconds of a control step."
    )?;
    Ok(())
}

fn describe(out: &mut impl Write, info: &Info, spec: &Spec) -> std::io::Result<()> {
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
        "action        {} numbers within +-{}",
        spec.action_size, spec.action_limit
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
