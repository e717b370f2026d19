//! The runs of an experiment as they proceed: a live table on a terminal, elsewhere a line when one begins or ends.

use super::tell;
use crate::lab::sweep::{Ended, PlannedRun, Progress, Watcher};
use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// What is known of all runs.
pub(super) struct LiveTable {
    terminal: Option<Terminal>,
    /// How far those are that run, and when they were seen to come there.
    progress: BTreeMap<String, (Progress, Instant)>,
    running: usize,
    ended: usize,
    count: usize,
}

/// The table as it is drawn.
struct Terminal {
    bars: MultiProgress,
    /// The last line: all runs in numbers.
    all: ProgressBar,
    rows: BTreeMap<String, ProgressBar>,
    /// Whether every run has its row. Where there are more than the terminal has lines, only those have one that run,
    /// and a line stays of each that ended.
    shows_all: bool,
    /// Length of the longest name.
    width: usize,
}

impl LiveTable {
    pub(super) fn new(runs: &[PlannedRun]) -> LiveTable {
        let terminal = std::io::stderr().is_terminal();
        LiveTable {
            terminal: terminal.then(|| Terminal::new(runs)),
            progress: BTreeMap::new(),
            running: 0,
            ended: 0,
            count: runs.len(),
        }
    }

    /// Leaves the terminal to others.
    pub(super) fn finish(&self) {
        if let Some(terminal) = &self.terminal {
            terminal.all.finish_and_clear();
        }
    }

    fn count(&self) {
        if let Some(terminal) = &self.terminal {
            let running = self.running;
            let waiting = self.count.saturating_sub(self.ended + running);
            terminal.all.set_position(self.ended as u64);
            let message = format!("{running} running, {waiting} waiting");
            terminal.all.set_message(message);
        }
    }
}

impl Terminal {
    fn new(runs: &[PlannedRun]) -> Terminal {
        let lines = usize::from(console::Term::stderr().size().0);
        let bars = MultiProgress::new();
        let template = "{wide_bar} {pos}/{len} runs ended, {msg}  {elapsed}";
        let all = ProgressBar::new(runs.len() as u64).with_style(style(template));
        let mut terminal = Terminal {
            all: bars.add(all),
            bars,
            rows: BTreeMap::new(),
            // One line is that of all runs, one the cursor's.
            shows_all: runs.len() + 2 <= lines,
            width: runs.iter().map(|run| run.name.len()).max().unwrap_or(0),
        };
        if terminal.shows_all {
            for run in runs {
                terminal.add(run);
                terminal.say(run, "waiting");
            }
        }
        terminal
    }

    /// A row for a run, which is drawn as soon as something is said of it.
    fn add(&mut self, run: &PlannedRun) {
        let row = self
            .bars
            .insert_before(&self.all, ProgressBar::new(run.config.steps));
        row.set_style(style(&format!("{{prefix:{}}} {{msg}}", self.width)));
        row.set_prefix(run.name.clone());
        self.rows.insert(run.name.clone(), row);
    }

    fn say(&self, run: &PlannedRun, message: &str) {
        if let Some(row) = self.rows.get(&run.name) {
            row.set_message(message.to_owned());
        }
    }

    fn began(&mut self, run: &PlannedRun, step: u64) {
        if !self.shows_all {
            self.add(run);
        }
        if let Some(row) = self.rows.get(&run.name) {
            let template = "{bar:20} {human_pos:>9}/{human_len} steps  {msg}";
            row.set_style(style(&format!("{{prefix:{}}} {template}", self.width)));
            row.set_position(step);
            row.set_message("");
        }
    }

    fn ended(&mut self, run: &PlannedRun, message: &str) {
        if self.shows_all {
            if let Some(row) = self.rows.get(&run.name) {
                row.set_style(style(&format!("{{prefix:{}}} {{msg}}", self.width)));
                row.abandon_with_message(message.to_owned());
            }
            return;
        }
        if let Some(row) = self.rows.remove(&run.name) {
            row.finish_and_clear();
        }
        self.bars
            .suspend(|| tell(&format!("{}: {message}", run.name)));
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Last return and rate of a run.
fn in_words(progress: &Progress) -> String {
    let value = progress.return_mean;
    let value = value.map(|value| format!("return {value:.1}"));
    let rate = progress.steps_per_second;
    let rate = rate.map(|rate| format!("{rate:.0} steps/s"));
    let words: Vec<String> = value.into_iter().chain(rate).collect();
    words.join("  ")
}

impl Watcher for LiveTable {
    fn began(&mut self, run: &PlannedRun, step: u64) {
        self.running += 1;
        match &mut self.terminal {
            Some(terminal) => terminal.began(run, step),
            None if step == 0 => tell(&format!("{}: began", run.name)),
            None => tell(&format!("{}: goes on from step {step}", run.name)),
        }
        self.count();
    }

    fn proceeds(&mut self, run: &PlannedRun, progress: Progress) {
        let now = Instant::now();
        let last = self.progress.entry(run.name.clone());
        let last = last.or_insert((progress, now));
        if last.0 != progress {
            *last = (progress, now);
        }
        let since = last.1.elapsed().as_secs_f64();
        let Some(terminal) = &self.terminal else {
            return;
        };
        if let Some(row) = terminal.rows.get(&run.name) {
            row.set_position(progress.step);
        }
        let mut message = in_words(&progress);
        if let Some(rate) = progress.steps_per_second.filter(|rate| *rate > 0.0) {
            // A run tells of itself at evaluations only; between them the time goes on.
            let left = run.config.steps.saturating_sub(progress.step) as f64 / rate - since;
            let left = Duration::from_secs_f64(left.max(0.0));
            message += &format!("  {:#} left", HumanDuration(left));
        }
        terminal.say(run, &message);
    }

    fn ended(&mut self, run: &PlannedRun, ended: &Ended) {
        self.ended += 1;
        let last = self.progress.remove(&run.name);
        // Those that were finished before, or could not be started, were never seen to run.
        self.running = self.running.saturating_sub(usize::from(last.is_some()));
        let last = last.map(|(progress, _)| in_words(&progress));
        let last = last.filter(|last| !last.is_empty());
        let last = last.map_or(String::new(), |last| format!(", {last}"));
        let how = match ended {
            Ended::Finished => "finished",
            Ended::Interrupted => "interrupted",
            Ended::Failed(_) => "failed",
        };
        let (ended, count) = (self.ended, self.count);
        let message = format!("{how}{last} ({ended} of {count})");
        match &mut self.terminal {
            Some(terminal) => terminal.ended(run, &message),
            None => tell(&format!("{}: {message}", run.name)),
        }
        self.count();
    }
}
