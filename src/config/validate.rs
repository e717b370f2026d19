//! Ranges of the settings and what must hold between them.

use super::Config;

/// A setting out of range: its dotted key and what would be right.
#[derive(Debug, PartialEq)]
pub(super) struct Violation {
    pub key: &'static str,
    pub expected: String,
}

/// First violated range or relation of `config`, in the order of the keys.
pub(super) fn check(config: &Config) -> Result<(), Violation> {
    let c = config;
    positive("steps", c.steps)?;
    if c.batch_size < 2 {
        // A minibatch is updated in two halves.
        return violation("batch_size", "at least 2".into());
    }
    positive("policy_delay", c.policy_delay)?;
    positive("critic_updates", c.critic_updates)?;
    at_most("critic_updates", c.critic_updates, 1_000)?;
    within("discount", c.discount, 0.0, 1.0)?;
    above_zero("action_coupling", c.action_coupling, 1.0)?;
    within("exploration_noise", c.exploration_noise, 0.0, 10.0)?;
    above_zero("tau", c.tau, 1.0)?;
    widths("networks.hidden", &c.networks.hidden)?;
    let rate = 1.0;
    above_zero(
        "networks.actor_learning_rate",
        c.networks.actor_learning_rate,
        rate,
    )?;
    above_zero(
        "networks.critic_learning_rate",
        c.networks.critic_learning_rate,
        rate,
    )?;
    within(
        "target_smoothing.deviation",
        c.target_smoothing.deviation,
        0.0,
        10.0,
    )?;
    within("target_smoothing.clip", c.target_smoothing.clip, 0.0, 10.0)?;
    above_zero("temperature.initial", c.temperature.initial, 1e3)?;
    above_zero(
        "temperature.learning_rate",
        c.temperature.learning_rate,
        rate,
    )?;
    positive("scaling.every", c.scaling.every)?;
    within("scaling.clip", c.scaling.clip, 1e-6, 1e6)?;
    within(
        "scaling.deviation_floor",
        c.scaling.deviation_floor,
        1e-6,
        1e6,
    )?;
    positive("replay.capacity", c.replay.capacity as u64)?;
    let d = &c.demonstrations;
    within("demonstrations.probability", d.probability, 0.0, 1.0)?;
    within(
        "demonstrations.reset_probability",
        d.reset_probability,
        0.0,
        1.0,
    )?;
    above_zero("demonstrations.decay", d.decay, 1.0)?;
    positive("demonstrations.segment_steps", d.segment_steps)?;
    if d.probability + d.reset_probability > 1.0 {
        return violation(
            "demonstrations.probability",
            format!(
                "at most {} beside demonstrations.reset_probability ({})",
                1.0 - d.reset_probability,
                d.reset_probability
            ),
        );
    }
    widths("model.hidden", &c.model.hidden)?;
    above_zero("model.learning_rate", c.model.learning_rate, rate)?;
    within(
        "imagination.bias_factor",
        c.imagination.bias_factor,
        0.0,
        1.0,
    )?;
    above_zero("imagination.decay_rate", c.imagination.decay_rate, 1.0)?;
    within(
        "imagination.noise_deviation",
        c.imagination.noise_deviation,
        0.0,
        10.0,
    )?;
    within(
        "imagination.noise_bound",
        c.imagination.noise_bound,
        0.0,
        10.0,
    )?;
    positive("expansion.horizon", c.expansion.horizon as u64)?;
    at_most("expansion.horizon", c.expansion.horizon as u64, 100)?;
    positive("evaluation.every", c.evaluation.every)?;
    positive("evaluation.episodes", c.evaluation.episodes as u64)?;
    at_most("telemetry.states", c.telemetry.states as u64, 100_000)?;
    if !c.video.every.is_multiple_of(c.evaluation.every) {
        let every = c.evaluation.every;
        let expected = format!("0 or a multiple of evaluation.every ({every})");
        return violation("video.every", expected);
    }
    positive("checkpoint.every", c.checkpoint.every)?;
    at_most("batch_size", c.batch_size as u64, 1_000_000)?;
    at_most("replay.capacity", c.replay.capacity as u64, 1_000_000_000)?;
    at_most("evaluation.episodes", c.evaluation.episodes as u64, 100_000)?;
    if !(1..=MOST_THREADS).contains(&c.compute.threads) {
        return violation("compute.threads", format!("from 1 to {MOST_THREADS}"));
    }

    if let Some(doubled) = &c.doubled_actions {
        positive("doubled_actions.period", doubled.period as u64)?;
        if !c.demonstrations.path.is_empty() {
            let expected = "empty, for recorded actions are not doubled (doubled_actions)";
            return violation("demonstrations.path", expected.into());
        }
    }

    let phase_1 = c.random_steps;
    if c.batch_size as u64 > phase_1 {
        return violation(
            "batch_size",
            format!("at most random_steps ({phase_1}), the transitions phase 1 delivers"),
        );
    }
    if c.batch_size > c.replay.capacity {
        let capacity = c.replay.capacity;
        return violation(
            "batch_size",
            format!("at most replay.capacity ({capacity})"),
        );
    }
    if c.method.learns_model() && c.model_start > phase_1 {
        return violation(
            "model_start",
            format!("at most random_steps ({phase_1}): the model is first trained in phase 1"),
        );
    }
    Ok(())
}

/// More threads than this never help: an update has two tasks side by side.
const MOST_THREADS: usize = 64;

fn violation(key: &'static str, expected: String) -> Result<(), Violation> {
    Err(Violation { key, expected })
}

fn positive(key: &'static str, value: u64) -> Result<(), Violation> {
    if value >= 1 {
        return Ok(());
    }
    violation(key, "at least 1".into())
}

fn within(key: &'static str, value: f64, low: f64, high: f64) -> Result<(), Violation> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    violation(key, format!("from {low} to {high}"))
}

fn above_zero(key: &'static str, value: f64, high: f64) -> Result<(), Violation> {
    if value > 0.0 && value <= high {
        return Ok(());
    }
    violation(key, format!("above 0 and at most {high}"))
}

/// Most weights of a network; beyond that memory is at stake, and the CPU is the wrong place.
const MOST_WEIGHTS: usize = 1 << 26;

fn widths(key: &'static str, hidden: &[usize]) -> Result<(), Violation> {
    let width = 1..=8_192;
    let weights = || {
        hidden
            .windows(2)
            .map(|pair| pair[0] * pair[1])
            .sum::<usize>()
    };
    let sound = !hidden.is_empty() && hidden.iter().all(|w| width.contains(w));
    if sound && weights() <= MOST_WEIGHTS {
        return Ok(());
    }
    violation(
        key,
        format!(
            "one or more widths from 1 to 8192, of at most {MOST_WEIGHTS} weights between them"
        ),
    )
}

fn at_most(key: &'static str, value: u64, most: u64) -> Result<(), Violation> {
    if value <= most {
        return Ok(());
    }
    violation(key, format!("at most {most}"))
}
