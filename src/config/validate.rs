//! What must hold between settings; the range of each stands in the table of keys.

use super::{Addition, Config};
use crate::agent::augment::imagination::OptimisticBias;
use crate::env;
use crate::planning::PlannerMethod;

/// A setting that does not go with the others: its dotted key and what would be right.
#[derive(Debug, PartialEq)]
pub(super) struct Violation {
    pub key: &'static str,
    pub expected: String,
}

/// Most actions, samples times horizon, that a planner's iteration may hold: some 1 GB of the widest ones.
const MOST_PLANNED: usize = 10_000_000;

/// First violated relation of `config`.
pub(super) fn check(config: &Config) -> Result<(), Violation> {
    let c = config;
    let drops = env::info(&c.task).is_ok_and(|info| info.drops);
    let d = &c.demonstrations;
    require(
        d.probability + d.reset_probability <= 1.0,
        "demonstrations.probability",
        || {
            format!(
                "at most {} beside demonstrations.reset_probability ({})",
                1.0 - d.reset_probability,
                d.reset_probability
            )
        },
    )?;
    require(
        c.doubled_actions.is_none() || d.path.is_empty(),
        "demonstrations.path",
        || "empty, for recorded actions are not doubled (doubled_actions)".into(),
    )?;
    let named = |name: &str| {
        format!(
            "0, or recordings in demonstrations.path ({name}) or of the planner (planner.every)"
        )
    };
    require(
        d.batch_share == 0.0 || !d.path.is_empty() || c.planner.every > 0,
        "demonstrations.batch_share",
        || named("it is empty"),
    )?;
    require(
        d.imitation == 0.0 || d.batch_share > 0.0,
        "demonstrations.imitation",
        || "0, or a demonstrations.batch_share above 0, whose rows are imitated".into(),
    )?;
    require(
        !d.return_bound || d.batch_share > 0.0,
        "demonstrations.return_bound",
        || "false, or a demonstrations.batch_share above 0, whose targets are bounded".into(),
    )?;
    require(
        !d.return_bound || c.method.addition() != Addition::Expansion,
        "demonstrations.return_bound",
        || {
            let method = c.method.name();
            format!("false, for method `{method}` has targets of its own")
        },
    )?;
    let p = &c.planner;
    let most = MOST_PLANNED / p.horizon;
    require(p.samples <= most, "planner.samples", || {
        format!(
            "at most {most} beside planner.horizon = {}, for an iteration is kept in memory",
            p.horizon
        )
    })?;
    require(p.drop_cost == 0.0 || drops, "planner.drop_cost", || {
        format!("0: in {} nothing can be dropped for good", c.task)
    })?;
    require(
        p.every == 0 || c.doubled_actions.is_none(),
        "planner.every",
        || "0, for recorded actions are not doubled (doubled_actions)".into(),
    )?;
    let selects = matches!(p.method, PlannerMethod::Icem | PlannerMethod::Topdm);
    require(!selects || p.elites <= p.samples, "planner.elites", || {
        format!("at most planner.samples ({})", p.samples)
    })?;
    require(
        p.method != PlannerMethod::Sampling || p.horizon == 1 || p.knots <= p.horizon,
        "planner.knots",
        || format!("at most planner.horizon ({})", p.horizon),
    )?;
    let every = c.evaluation.every;
    require(c.video.every.is_multiple_of(every), "video.every", || {
        format!("0 or a multiple of evaluation.every ({every})")
    })?;
    if let [low, high] = c.exploration.spread[..] {
        require(
            c.environments > 1 || low == high,
            "exploration.spread",
            || {
                format!(
                    "one deviation twice, such as [{low:?}, {low:?}], for a single environment has no other; \
                     or environments of at least 2 (it is {})",
                    c.environments
                )
            },
        )?;
    }
    require(
        !c.exploration.end_when_dropped || drops,
        "exploration.end_when_dropped",
        || {
            format!(
                "false: in {} nothing can be dropped for good at no cost",
                c.task
            )
        },
    )?;
    let i = &c.imagination;
    let is_value = i.optimism && i.bias == OptimisticBias::Value;
    require(!is_value || c.discount < 1.0, "imagination.bias", || {
        "return, for without a discount (it is 1) no value bounds what can be attained".into()
    })?;
    require(
        !(i.optimism && c.method.addition() == Addition::Imagination) || c.networks.from.is_empty(),
        "networks.from",
        || {
            "empty, or imagination.optimism = false beside it: critics that have learned begin with no \
             bias"
                .into()
        },
    )?;
    let phase_1 = c.random_steps;
    require(c.batch_size as u64 <= phase_1, "batch_size", || {
        format!("at most random_steps ({phase_1}), the transitions phase 1 delivers")
    })?;
    let capacity = c.replay.capacity;
    require(c.batch_size <= capacity, "batch_size", || {
        format!("at most replay.capacity ({capacity})")
    })?;
    require(
        !c.method.learns_model() || c.model_start <= phase_1,
        "model_start",
        || format!("at most random_steps ({phase_1}): the model is first trained in phase 1"),
    )
}

fn require(
    holds: bool,
    key: &'static str,
    expected: impl FnOnce() -> String,
) -> Result<(), Violation> {
    let violation = || Violation {
        key,
        expected: expected(),
    };
    holds.then_some(()).ok_or_else(violation)
}
