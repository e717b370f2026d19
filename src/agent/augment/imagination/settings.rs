//! Settings of imagination.

use serde::{Deserialize, Serialize};

/// What the bias of an optimistic start is a part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OptimisticBias {
    /// The undiscounted return of the largest reward of phase 1 at every step (equation 6).
    Return,
    /// The discounted value of that: the largest that any policy could have.
    Value,
}

/// By what the disagreement of the target critics is divided to give a probability.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UncertaintyScale {
    /// The largest disagreement since phase 2 began (paper).
    RunningMax,
    /// The largest disagreement of the batch (released code).
    BatchMax,
}

/// By what the summed loss of the kept imaginary rows is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImaginaryLossMean {
    /// The number of kept rows (paper, equation 10).
    Kept,
    /// The batch size (released code).
    Batch,
}

/// What the defaults follow where the paper's text and its authors' released code differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Readings {
    /// The released code.
    Released,
    /// The paper's text.
    Text,
}

/// How `y_hat` is compared with `y` in the target filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetComparison {
    /// `y_hat >= y` (paper, equation 8).
    GreaterEqual,
    /// `y_hat > y` (released code).
    Greater,
}

/// Imaginary transitions (paper, section 4); used by the methods that imagine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImaginationSettings {
    /// Optimistic start of the critics (equation 6).
    pub optimism: bool,
    /// Decay of the bound of the action noise.
    pub noise_decay: bool,
    /// Keep only rows whose target is not below the real one (equation 8).
    pub target_filter: bool,
    /// Keep rows in proportion to the target critics' disagreement (equation 9).
    pub uncertainty_filter: bool,
    /// Deviation of the actions' noise before it is clipped; 1 is `N(0, 1)` of equation 7.
    pub noise_deviation: f64,
    /// Whether that deviation is a fraction of half of each action number's range.
    pub noise_relative: bool,
    /// Bound `eta` of the noise at first, as a fraction of half of each action number's range.
    pub noise_bound: f64,
    /// What the critics' first bias is a part of.
    pub bias: OptimisticBias,
    /// `c` in equation 6, that part.
    pub bias_factor: f64,
    /// `rho`: factor of the noise bound per update.
    pub decay_rate: f64,
    /// What the defaults of the next three, and of the velocity in rewards, follow; nothing else depends on it.
    pub readings: Readings,
    /// Comparison of the target filter.
    pub target_comparison: TargetComparison,
    /// Scale of the uncertainty filter.
    pub uncertainty_scale: UncertaintyScale,
    /// Mean of the imaginary part of the critic loss.
    pub imaginary_loss_mean: ImaginaryLossMean,
}
