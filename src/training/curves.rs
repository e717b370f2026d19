//! The learning curves: `train.csv`, `eval.csv` and, apart from them, `timing.csv`.
//!
//! Wall-clock figures live in `timing.csv` alone, so that two runs of one seed are equal byte for
//! byte in the other two. A figure that does not exist in a row is an empty field.

use super::Evaluation;
use super::telemetry::ImaginedErrors;
use crate::agent::Figures;
use serde::Serialize;
use std::fs::File;
use std::path::Path;

/// One row of `eval.csv`.
#[derive(Debug, Serialize)]
pub(super) struct EvalRow {
    step: u64,
    episodes: usize,
    return_mean: f64,
    return_std: f64,
    return_min: f64,
    return_max: f64,
    length_mean: f64,
    success_rate: Option<f64>,
}

impl EvalRow {
    pub(super) fn new(step: u64, evaluation: &Evaluation) -> EvalRow {
        EvalRow {
            step,
            episodes: evaluation.episodes.len(),
            return_mean: evaluation.return_mean(),
            return_std: evaluation.return_std(),
            return_min: evaluation.return_min(),
            return_max: evaluation.return_max(),
            length_mean: evaluation.length_mean(),
            success_rate: evaluation.success_rate(),
        }
    }
}

/// One row of `train.csv`: means over the steps since the row before.
#[derive(Debug, Serialize)]
pub(super) struct TrainRow {
    step: u64,
    episodes: u64,
    return_mean: Option<f64>,
    length_mean: Option<f64>,
    diverged: u64,
    updates: u64,
    critic_loss: Option<f64>,
    actor_loss: Option<f64>,
    q_mean: Option<f64>,
    model_loss: Option<f64>,
    model_error: Option<f64>,
    eta: Option<f64>,
    target_kept: Option<f64>,
    uncertainty_kept: Option<f64>,
    kept: Option<f64>,
    temperature: Option<f64>,
    entropy: Option<f64>,
    q_bias: Option<f64>,
    kept_state_error: Option<f64>,
    kept_reward_error: Option<f64>,
    kept_target_error: Option<f64>,
    dropped_state_error: Option<f64>,
    dropped_reward_error: Option<f64>,
    dropped_target_error: Option<f64>,
}

/// What an evaluation measured besides returns.
#[derive(Debug, Default)]
pub(super) struct Measured {
    /// Of the model on the newest transitions.
    pub model_error: Option<f32>,
    /// Of the critics on the evaluation's episodes.
    pub q_bias: Option<f64>,
    /// Of imagined steps, kept and dropped, in the simulator.
    pub imagined: [ImaginedErrors; 2],
}

/// One row of `timing.csv`, seconds of wall clock since the row before.
#[derive(Debug, Serialize)]
pub(super) struct TimingRow {
    pub step: u64,
    pub seconds: f64,
    pub steps_per_second: f64,
    pub environment_seconds: f64,
    pub update_seconds: f64,
    pub evaluation_seconds: f64,
}

/// A mean that may be of nothing.
#[derive(Debug, Default, Clone, Copy)]
struct Mean {
    sum: f64,
    n: u64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.n += 1;
    }

    fn get(self) -> Option<f64> {
        (self.n > 0).then(|| self.sum / self.n as f64)
    }
}

/// What happened since the last row of `train.csv`.
#[derive(Debug, Default)]
pub(super) struct Interval {
    episodes: u64,
    episode_return: Mean,
    length: Mean,
    diverged: u64,
    updates: u64,
    critic_loss: Mean,
    actor_loss: Mean,
    q_mean: Mean,
    model_loss: Mean,
    eta: Option<f64>,
    target_kept: Mean,
    uncertainty_kept: Mean,
    kept: Mean,
    temperature: Mean,
    entropy: Mean,
}

impl Interval {
    /// An episode of the training environment ended.
    pub(super) fn episode(&mut self, episode_return: f64, length: u64) {
        self.episodes += 1;
        self.episode_return.add(episode_return);
        self.length.add(length as f64);
    }

    /// The simulation blew up.
    pub(super) fn diverged(&mut self) {
        self.diverged += 1;
    }

    /// A step of the model alone.
    pub(super) fn model_step(&mut self, loss: f32) {
        self.model_loss.add(f64::from(loss));
    }

    /// An update of phase 2.
    pub(super) fn update(&mut self, figures: &Figures) {
        self.updates += 1;
        self.critic_loss
            .add(figures.critic_losses.iter().map(|l| f64::from(*l)).sum());
        self.q_mean.add(f64::from(figures.q_mean));
        if let Some(loss) = figures.actor_loss {
            self.actor_loss.add(f64::from(loss));
        }
        if let Some(loss) = figures.model_loss {
            self.model_step(loss);
        }
        if let Some(imagination) = figures.imagination {
            self.eta = Some(imagination.noise_bound);
            self.target_kept.add(imagination.by_target);
            self.uncertainty_kept.add(imagination.by_uncertainty);
            self.kept.add(imagination.kept);
        }
        if let Some(entropy) = figures.entropy {
            self.temperature.add(f64::from(entropy.temperature));
            self.entropy.add(f64::from(-entropy.log_density));
        }
    }

    /// The row at `step`, and a new interval.
    pub(super) fn take(&mut self, step: u64, measured: &Measured) -> TrainRow {
        let [kept, dropped] = measured.imagined;
        let i = std::mem::take(self);
        TrainRow {
            step,
            episodes: i.episodes,
            return_mean: i.episode_return.get(),
            length_mean: i.length.get(),
            diverged: i.diverged,
            updates: i.updates,
            critic_loss: i.critic_loss.get(),
            actor_loss: i.actor_loss.get(),
            q_mean: i.q_mean.get(),
            model_loss: i.model_loss.get(),
            model_error: measured.model_error.map(f64::from),
            eta: i.eta,
            target_kept: i.target_kept.get(),
            uncertainty_kept: i.uncertainty_kept.get(),
            kept: i.kept.get(),
            temperature: i.temperature.get(),
            entropy: i.entropy.get(),
            q_bias: measured.q_bias,
            kept_state_error: kept.state,
            kept_reward_error: kept.reward,
            kept_target_error: kept.target,
            dropped_state_error: dropped.state,
            dropped_reward_error: dropped.reward,
            dropped_target_error: dropped.target,
        }
    }
}

/// The three files, each row flushed as it is written, so that a crash costs no row.
pub(super) struct Curves {
    pub train: csv::Writer<File>,
    pub eval: csv::Writer<File>,
    pub timing: csv::Writer<File>,
}

impl Curves {
    /// Creates the files in the run directory.
    pub(super) fn create(directory: &Path) -> Result<Curves, csv::Error> {
        let create = |name| csv::Writer::from_path(directory.join(name));
        Ok(Curves {
            train: create("train.csv")?,
            eval: create("eval.csv")?,
            timing: create("timing.csv")?,
        })
    }
}

/// Writes and flushes one row.
pub(super) fn write<R: Serialize>(
    writer: &mut csv::Writer<File>,
    row: R,
) -> Result<(), csv::Error> {
    writer.serialize(row)?;
    Ok(writer.flush()?)
}
