//! Progress on the terminal; nothing where there is none.

use super::tell;
use crate::config::Config;
use crate::run::ReplayMemory;
use crate::training::{Monitor, Status};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt::Write;
use std::io::IsTerminal;

/// A bar with steps per second, time left and the last evaluation.
pub(super) struct Progress {
    bar: ProgressBar,
    shown: Option<f64>,
}

/// A bar of things that are made one by one, drawn on standard error when that is a terminal. Its
/// length grows as more are known to come.
pub(super) fn bar(things: &str) -> ProgressBar {
    let template =
        format!("{{wide_bar}} {{human_pos}}/{{human_len}} {things}  {{eta}} left  {{msg}}");
    let style = ProgressStyle::with_template(&template);
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::with_draw_target(Some(0), target()).with_style(style)
}

fn target() -> ProgressDrawTarget {
    if std::io::stderr().is_terminal() {
        ProgressDrawTarget::stderr_with_hz(5)
    } else {
        ProgressDrawTarget::hidden()
    }
}

impl Progress {
    /// Nothing to be seen yet.
    pub(super) fn new() -> Progress {
        Progress {
            bar: ProgressBar::hidden(),
            shown: None,
        }
    }

    /// Shows a bar for the whole run, of which `step` steps are taken, on standard error when that is a
    /// terminal.
    pub(super) fn begin(&mut self, config: &Config, step: u64) {
        if !std::io::stderr().is_terminal() {
            return;
        }
        let target = ProgressDrawTarget::stderr_with_hz(5);
        let style = ProgressStyle::with_template(
            "{prefix} {wide_bar} {human_pos}/{human_len} steps  {rate} steps/s  {eta} left  {msg}",
        )
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .with_key("rate", |state: &ProgressState, out: &mut dyn Write| {
            // A failed write of a number to the terminal is nothing to stop a run for.
            let _ = write!(out, "{:.0}", state.per_sec());
        });
        self.bar = ProgressBar::with_draw_target(Some(config.steps), target)
            .with_style(style)
            .with_position(step);
        // What was done before tells nothing of the pace.
        self.bar.reset_eta();
        self.bar
            .set_prefix(format!("{} {}", config.task, config.method.name()));
    }

    /// Leaves the bar as it stands.
    pub(super) fn finish(&self) {
        self.bar.abandon();
    }
}

impl Monitor for Progress {
    fn step(&mut self, status: &Status) {
        self.bar.set_position(status.step);
        if status.return_mean != self.shown {
            self.shown = status.return_mean;
            if let Some(return_mean) = status.return_mean {
                self.bar.set_message(format!("return {return_mean:.1}"));
            }
        }
    }

    fn memory(&mut self, memory: &ReplayMemory) {
        tell(&format!("replay buffer: {memory} when full"));
    }

    fn note(&mut self, message: &str) {
        self.bar.suspend(|| tell(&format!("note: {message}")));
    }
}
