//! The names of a run's files and the columns of its curves, once. Headers, checks, the documentation
//! (`docs/runs.md`), sweeps, comparison and plots follow from these lists.

/// Figures of training, a row an evaluation.
pub const TRAIN_CSV: &str = "train.csv";
/// The evaluations.
pub const EVAL_CSV: &str = "eval.csv";
/// Wall-clock figures, a row an evaluation.
pub const TIMING_CSV: &str = "timing.csv";
/// The files of curves, in the order in which they are made.
pub const CURVES: [&str; 3] = [TRAIN_CSV, EVAL_CSV, TIMING_CSV];
/// The resolved configuration.
pub const CONFIG_TOML: &str = "config.toml";
/// Where the run's figures come from.
pub const RUN_JSON: &str = "run.json";

/// A column of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Its name, in the header and wherever the figure is told.
    pub name: &'static str,
    /// How a row's figure comes of those told since the row before.
    pub of: Of,
    /// What it is, with its unit, in Markdown.
    pub doc: &'static str,
}

/// How a row's figure comes of those told since the row before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// Environment steps taken.
    Step,
    /// Their number.
    Count,
    /// Their mean; empty if there are none.
    Mean,
    /// The last of them; empty if there is none.
    Last,
}

const fn column(name: &'static str, of: Of, doc: &'static str) -> Column {
    Column { name, of, doc }
}

/// What a count of full buffers is.
const BUFFERS_FULL: &str = "steps in which a buffer of MuJoCo for contacts or constraints was full, so that some were left \
     out of the physics";

/// The columns of `eval.csv`.
pub const EVAL: [Column; 10] = [
    column("step", Of::Step, "environment steps taken"),
    column("episodes", Of::Last, "episodes of this evaluation"),
    column(
        "return_mean",
        Of::Last,
        "mean of their undiscounted returns",
    ),
    column(
        "return_std",
        Of::Last,
        "standard deviation of the returns, divided by their number",
    ),
    column("return_min", Of::Last, "lowest return"),
    column("return_max", Of::Last, "highest return"),
    column(
        "length_mean",
        Of::Last,
        "mean length of the episodes, in steps",
    ),
    column(
        "success_rate",
        Of::Last,
        "fraction of the episodes whose last step is a success; empty for tasks that know none",
    ),
    column(
        "diverged",
        Of::Last,
        "episodes whose simulation blew up: their return and length are of the steps before, they are no success, and \
         such an evaluation is never the best",
    ),
    column("buffers_full", Of::Last, BUFFERS_FULL),
];

/// The columns of `train.csv`.
pub const TRAIN: [Column; 32] = [
    column("step", Of::Step, "environment steps taken"),
    column(
        "episodes",
        Of::Count,
        "training episodes that ended; segments that begin in a demonstration or from a reset are none",
    ),
    column("return_mean", Of::Mean, "return of those episodes"),
    column(
        "length_mean",
        Of::Mean,
        "length of those episodes, in steps",
    ),
    column(
        "diverged",
        Of::Count,
        "steps at which the simulation blew up",
    ),
    column("updates", Of::Count, "updates of the critics"),
    column("critic_loss", Of::Mean, "sum of the critics' losses"),
    column(
        "actor_loss",
        Of::Mean,
        "`-mean Q1` in the updates that step the actor; SAC: with the entropy's share",
    ),
    column("q_mean", Of::Mean, "mean `Q1` of the real transitions"),
    column(
        "model_loss",
        Of::Mean,
        "loss of the dynamics model: mean square error in scaled space",
    ),
    column(
        "model_error",
        Of::Last,
        "at `step`: root mean square one-step error of the model on the newest `batch_size` transitions, in scaled space",
    ),
    column(
        "eta",
        Of::Last,
        "bound of the imagined actions' noise in the last update, where ranges differ of the number with the widest",
    ),
    column(
        "target_kept",
        Of::Mean,
        "fraction of the imaginary transitions that pass the target filter",
    ),
    column(
        "uncertainty_kept",
        Of::Mean,
        "fraction of the imaginary transitions that pass the uncertainty filter",
    ),
    column(
        "kept",
        Of::Mean,
        "fraction that passes both and trains the critics",
    ),
    column("temperature", Of::Mean, "temperature of SAC"),
    column(
        "entropy",
        Of::Mean,
        "of SAC: minus the mean log-density of sampled actions, in units of the action range",
    ),
    column(
        "q_bias",
        Of::Last,
        "at `step`: mean of `Q1` minus the discounted return from there, over the first half of each evaluation \
         episode; where an episode is cut, the critic's value at the cut stands for the rest, which hides part of a \
         bias (half of a constant one where all episodes have 50 steps). SAC's critics also count entropy, which no \
         return has",
    ),
    column(
        "kept_state_error",
        Of::Last,
        "at `step`: root mean square error of the next observation, in scaled space and without coordinates that are \
         known, of imagined steps that would train the critics, executed in the simulator",
    ),
    column(
        "kept_reward_error",
        Of::Last,
        "the same: mean absolute error of the reward",
    ),
    column(
        "kept_target_error",
        Of::Last,
        "the same: mean absolute error of the target",
    ),
    column(
        "dropped_state_error",
        Of::Last,
        "as `kept_state_error`, of imagined steps that the filters drop",
    ),
    column(
        "dropped_reward_error",
        Of::Last,
        "as `kept_reward_error`, of those",
    ),
    column(
        "dropped_target_error",
        Of::Last,
        "as `kept_target_error`, of those",
    ),
    column("temperature_loss", Of::Mean, "loss of SAC's temperature"),
    column(
        "recorded_reward_5",
        Of::Last,
        "at `step`: mean reward a step of the deterministic policy in steps 1 to 5 from recorded states \
         (`telemetry.recorded_states`)",
    ),
    column("recorded_reward_15", Of::Last, "the same in steps 6 to 15"),
    column("recorded_reward_30", Of::Last, "the same in steps 16 to 30"),
    column("recorded_reward_60", Of::Last, "the same in steps 31 to 60"),
    column("buffers_full", Of::Count, BUFFERS_FULL),
    column(
        "planned_return",
        Of::Mean,
        "return of episodes that the planner made (`planner.every`)",
    ),
    column(
        "planned_length",
        Of::Mean,
        "their length, in steps, up to a drop",
    ),
];

/// The columns of `timing.csv`: seconds of wall clock since the row before.
pub const TIMING: [Column; 8] = [
    column("step", Of::Step, "environment steps taken"),
    column("seconds", Of::Last, "seconds since the row before"),
    column("steps_per_second", Of::Last, "environment steps a second"),
    column(
        "environment_seconds",
        Of::Last,
        "of those, acting and simulating",
    ),
    column("update_seconds", Of::Last, "of those, learning"),
    column("evaluation_seconds", Of::Last, "of those, evaluating"),
    column("checkpoint_seconds", Of::Last, "of those, saving"),
    column(
        "planning_seconds",
        Of::Last,
        "of those, planning (`planner.every`)",
    ),
];

/// The names of `columns`, as in a header.
pub fn names(columns: &[Column]) -> Vec<&'static str> {
    columns.iter().map(|column| column.name).collect()
}

/// Index of the column called `name`.
pub fn index(columns: &[Column], name: &str) -> Option<usize> {
    columns.iter().position(|column| column.name == name)
}
