//! Settings of planners.

use serde::{Deserialize, Serialize};

/// How sequences of actions are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlannerMethod {
    /// The cross-entropy method with coloured noise, kept elites and a falling number of samples (Pinneri et al. 2020).
    Icem,
    /// Truncation selection with sparse mutation, the published optimiser of the hand tasks (Charlesworth and Montana
    /// 2021).
    Topdm,
    /// A mean weighted by exponentiated returns (Williams et al. 2017).
    Mppi,
    /// The best of some sequences around the last one, made of knots (Howell et al. 2022).
    Sampling,
}

impl PlannerMethod {
    /// Its name in configurations.
    pub fn name(self) -> &'static str {
        match self {
            PlannerMethod::Icem => "icem",
            PlannerMethod::Topdm => "topdm",
            PlannerMethod::Mppi => "mppi",
            PlannerMethod::Sampling => "sampling",
        }
    }
}

/// What lies between two knots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// The knot before.
    Zero,
    /// A straight line.
    Linear,
    /// A cubic through the knots (Catmull and Rom 1974).
    Cubic,
}

/// A planner. The table of keys says what each field means.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct PlannerSettings {
    pub method: PlannerMethod,
    pub horizon: usize,
    pub samples: usize,
    pub iterations: usize,
    pub first_iterations: usize,
    pub elites: usize,
    pub noise: f64,
    pub colour: f64,
    pub momentum: f64,
    pub sample_decay: f64,
    pub keep: f64,
    pub mutation_probability: f64,
    pub mutation_noise: f64,
    pub temperature: f64,
    pub knots: usize,
    pub interpolation: Interpolation,
    pub success_bonus: f64,
    /// Cost of each step that is left of the horizon when an object is dropped, which ends the sequence; 0 for neither.
    pub drop_cost: f64,
    /// Steps without a new highest return after which a planned episode ends; 0 for no such end.
    pub patience: usize,
    /// Environment steps between two episodes that the planner makes in training; 0 for none.
    pub every: u64,
    pub policy_share: f64,
    pub terminal_value: bool,
}
