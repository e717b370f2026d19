//! Every key of a configuration, a row each: what it means, what it may be, its default, and who it is for.
//!
//! Defaults, checks, error messages, `mamf settings` and `docs/configuration.md` all follow from this table. The
//! fields of [`Config`](super::Config) have the names of the keys and their types; a new key is a row here and a
//! field there. Defaults are the paper's figures (appendix B) where the paper states one; what a method has
//! otherwise stands in its [preset](super::Method::definition).

use super::range::Range;
use super::{Concern, Method};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// What is known of a key.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Its name, with the section before a dot.
    pub name: &'static str,
    /// What it means, with its unit.
    doc: &'static str,
    /// What it may be.
    pub range: Range,
    /// Its default as TOML; none for a key that has to be given.
    default: Option<&'static str>,
    /// The methods that have a use for it.
    pub concern: Concern,
    /// Whether the other methods take it all the same, so that they can be compared under the same options.
    pub tolerated: bool,
    /// Another key and the value (as TOML) that it must have for this one to mean something.
    pub only_while: Option<(&'static str, &'static str)>,
    /// Whether a run may be resumed with another value.
    pub resume: Resume,
    /// Whether runs that were made before the key was there, and hence as its default says, are still read.
    pub is_young: bool,
}

/// Whether a run may be resumed with another value of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resume {
    /// No: results depend on it.
    Fixed,
    /// With `--force`: no result depends on it, but what the run stores does, or, of demonstrations, only on what lies
    /// there, which is compared.
    Forced,
    /// Without a word.
    Free,
}

/// Sections in their order, each with what it is about. Keys without a section come first.
pub const SECTIONS: &[(&str, &str)] = &[
    ("", "The run as a whole"),
    ("doubled_actions", "Doubled actions (paper, figure 3 c)"),
    ("updates", "How often the networks learn"),
    ("exploration", "How experience is collected"),
    ("networks", "Actor and critics, and their optimiser"),
    ("target_smoothing", "Smoothing of the target policy"),
    ("temperature", "Temperature of SAC"),
    ("scaling", "Standardisation of observations"),
    ("replay", "Replay buffer"),
    ("demonstrations", "Recordings that experience begins from"),
    ("model", "Learned dynamics model"),
    ("imagination", "Imaginary transitions (paper, section 4)"),
    ("expansion", "Model-based value expansion"),
    ("rules", "What the designer knows of the task"),
    (
        "evaluation",
        "Evaluation of the deterministic policy, in an environment of its own",
    ),
    ("telemetry", "What evaluations measure besides returns"),
    ("video", "Videos of the policy"),
    ("checkpoint", "Checkpoints in the run directory"),
    (
        "planner",
        "Planning in the simulator: `mamf plan`, and guided exploration in training",
    ),
    (
        "compute",
        "Where and with how many threads tensors are computed",
    ),
];

/// Rows of the form `/// doc`, `"name" => range, then what is special about the key;`.
macro_rules! keys {
    ($($(#[doc = $doc:literal])+ $name:literal => $row:expr;)+) => {
        /// All keys, in the order of [`SECTIONS`].
        pub static KEYS: &[Key] = &[
            $(Key { name: $name, doc: concat!($($doc),+), ..$row },)+
        ];
    };
}

keys! {
    /// Id of the task.
    "task" => key(Range::Task);
    /// The method, whose preset the other keys override.
    "method" => key(Range::Method).or("\"mamf\"");
    /// Seed of every random stream.
    "seed" => whole(0, LARGEST).or("0");
    /// Environment steps of the run, phase 1 included.
    "steps" => whole(1, LARGEST).or("3_000_000").on_resume(Resume::Free);
    /// Environment steps of phase 1, in which actions are uniformly random (`h` in the paper). At least `batch_size`,
    /// and for methods with a dynamics model at least `model_start`.
    "random_steps" => whole(0, LARGEST).or("25_000");
    /// Environment step after which the dynamics model is trained (`h0` in the paper).
    "model_start" => whole(0, LARGEST).or("5_000").of(Concern::Model).tolerated();
    /// Environments stepped side by side, whose experience goes into one replay buffer.
    "environments" => whole(1, 1_024).or("1").young();
    /// Transitions in a batch.
    "batch_size" => whole(2, 1_000_000).or("256"); // a batch is updated in two halves
    /// Discount factor.
    "discount" => number(0.0, 1.0).or("0.98");
    /// `beta` in `a = beta u + (1 - beta) p`: share of the policy's output `u` in the executed action, the rest being
    /// the previous executed action `p`. 1 is plain TD3.
    "action_coupling" => positive(1.0).or("0.7");
    /// Standard deviation of the exploration noise, as a fraction of half of each action number's range.
    "exploration_noise" => number(0.0, 10.0).or("0.1").of(Concern::ExplorationNoise)
        .only_while("exploration.spread", "[]");
    /// Learning steps between two updates of the actor and the target networks.
    "policy_delay" => whole(1, LARGEST).or("2");
    /// Updates of the critics (and of the dynamics model) in one learning step.
    "critic_updates" => whole(1, 1_000).or("1");
    /// What becomes of the values of both target critics in a target: the smaller one, or their mean.
    "target_value" => word(&["minimum", "mean"]).or("\"minimum\"").of(Concern::TwinCritics).young();
    /// Polyak averaging rate of the target networks, per update.
    "tau" => positive(1.0).or("0.005");

    /// Environment steps after which the two halves of a doubled action change places: the actions of the task become
    /// pairs, of which one half acts at a time, and a phase bit joins the observation. Not set, the task is as it is.
    "doubled_actions.period" => whole(1, LARGEST);

    /// Environment steps between two learning steps in phase 2, and between two steps of the dynamics model in phase 1.
    "updates.every" => whole(1, LARGEST).or("1").young();

    /// Standard deviations of the exploration noise as fractions of half of each action number's range, spread evenly over the
    /// environments in place of `exploration_noise`: environment i of N, from 0, has `low + (high - low) i / (N - 1)`.
    "exploration.spread" => key(Range::Span { most: 10.0 }).or("[]").of(Concern::ExplorationNoise).young();
    /// Whether training episodes and segments end, as if the task did, where an object has fallen past the hands: what
    /// follows is worth next to nothing, and takes neither steps nor batches. For hand tasks with a dense reward.
    "exploration.end_when_dropped" => flag().or("false").young();

    /// Run or checkpoint whose networks, and scaling of observations, the run begins with in place of fresh ones: of the same
    /// task, method and sizes, relative to the working directory.
    "networks.from" => key(Range::Text).or("\"\"").young();
    /// Widths of the hidden layers of actor and critics.
    "networks.hidden" => key(Range::Widths).or("[256, 256]");
    /// Adam's learning rate of the actor.
    "networks.actor_learning_rate" => positive(1.0).or("3e-4");
    /// Adam's learning rate of the critics.
    "networks.critic_learning_rate" => positive(1.0).or("3e-4");
    /// What is done to the critics' hidden layers before the activation: nothing, layer normalisation without
    /// parameters, or division by the mean absolute value.
    "networks.critic_normalisation" => word(&["none", "layer", "average_l1"]).or("\"none\"").young();
    /// Weight of the mean square of the actor's outputs before they are squashed into the actions' range, beside
    /// `-mean Q1 / mean |Q1|`: keeps a policy off the ends of the range, where it hardly learns. 0 for none.
    "networks.saturation_penalty" => number(0.0, 1e6).or("0.0").of(Concern::Deterministic).young();

    /// Standard deviation of the target policy's noise, as a fraction of half of each action number's range.
    "target_smoothing.deviation" => number(0.0, 10.0).or("0.2").of(Concern::Smoothing);
    /// Bound of that noise, as a fraction of half of each action number's range.
    "target_smoothing.clip" => number(0.0, 10.0).or("0.5").of(Concern::Smoothing);

    /// The temperature (weight of the policy's entropy) at first.
    "temperature.initial" => positive(1e3).or("0.1").of(Concern::Temperature);
    /// Adam's learning rate on the logarithm of the temperature.
    "temperature.learning_rate" => positive(1.0).or("3e-4").of(Concern::Temperature);

    /// Whether observations are standardised by running mean and deviation.
    "scaling.enabled" => flag().or("true");
    /// Environment steps between two recomputations of both.
    "scaling.every" => whole(1, LARGEST).or("20");
    /// Bound of scaled observations, in deviations.
    "scaling.clip" => number(1e-6, 1e6).or("5.0");
    /// Smallest deviation divided by, in the observation's own unit.
    "scaling.deviation_floor" => number(1e-6, 1e6).or("1e-2");

    /// Transitions kept; the oldest are overwritten.
    "replay.capacity" => whole(1, 1_000_000_000).or("1_000_000");

    /// Recordings in whose states segments of experience begin: a directory, an archive or a glob, relative to the
    /// working directory. Empty for plain episodes.
    "demonstrations.path" => key(Range::Text).or("\"\"").on_resume(Resume::Forced);
    /// Probability that the first segment begins in a recorded state (`p_d` in the paper).
    "demonstrations.probability" => number(0.0, 1.0).or("0.7");
    /// Probability that the first segment begins from a reset (`p_r`); both together at most 1.
    "demonstrations.reset_probability" => number(0.0, 1.0).or("0.2");
    /// Factor on both probabilities, a segment.
    "demonstrations.decay" => positive(1.0).or("0.999996");
    /// Environment steps of a segment.
    "demonstrations.segment_steps" => whole(1, LARGEST).or("15");
    /// Share of recorded transitions in every batch: each recorded action is executed in its state once, which gives
    /// the reward and what follows. They stay for the whole run.
    "demonstrations.batch_share" => number(0.0, 0.9).or("0.0").young();
    /// Whether the targets of those rows are at least the discounted return that followed in the recording.
    "demonstrations.return_bound" => flag().or("false").young();
    /// Weight of the actor's imitation of the actions in those rows: of their mean squared error beside
    /// `-mean Q1 / mean |Q1|`. 0 for none.
    "demonstrations.imitation" => number(0.0, 1e6).or("0.0").of(Concern::Deterministic).young();
    /// Whether only those actions are imitated that `Q1` prefers to the policy's.
    "demonstrations.imitation_filter" => flag().or("true").of(Concern::Deterministic).young();

    /// Widths of the hidden layers of the dynamics model.
    "model.hidden" => key(Range::Widths).or("[256, 256, 256]").of(Concern::Model).tolerated();
    /// Adam's learning rate of the dynamics model.
    "model.learning_rate" => positive(1.0).or("1e-4").of(Concern::Model).tolerated();
    /// What the model predicts in scaled space: the next observation (equation 5), or its change.
    "model.predict" => word(&["next_state", "delta"]).or("\"next_state\"").of(Concern::Model).tolerated();

    /// Optimistic start of the critics (equation 6).
    "imagination.optimism" => flag().or("true").of(Concern::Imagination);
    /// Whether the bound of the imagined actions' noise decays.
    "imagination.noise_decay" => flag().or("true").of(Concern::Imagination);
    /// Keep only imaginary transitions whose target is not below the real one (equation 8).
    "imagination.target_filter" => flag().or("true").of(Concern::Imagination);
    /// Keep imaginary transitions in proportion to the target critics' disagreement (equation 9).
    "imagination.uncertainty_filter" => flag().or("true").of(Concern::Imagination);
    /// Standard deviation of the imagined actions' noise before it is clipped (equation 7), in units of the action, or
    /// as `noise_relative` says.
    "imagination.noise_deviation" => number(0.0, 10.0).or("1.0").of(Concern::Imagination);
    /// Whether that deviation is a fraction of half of each action number's range.
    "imagination.noise_relative" => flag().or("false").of(Concern::Imagination);
    /// Bound `eta` of that noise at first, as a fraction of half of each action number's range.
    "imagination.noise_bound" => number(0.0, 10.0).or("1.0").of(Concern::Imagination);
    /// What the critics' first bias is a part of: `c r* l`, of the return of the largest reward `r*` of phase 1 at each of
    /// the `l` steps of an episode (`return`, equation 6), or `c r* / (1 - discount)`, of the discounted value of that
    /// (`value`), where `c` below 1 is a part of what can be attained. A note at the beginning of phase 2 says the bias
    /// beside that value.
    "imagination.bias" => word(&["return", "value"]).or("\"return\"").of(Concern::Imagination)
        .only_while("imagination.optimism", "true").young();
    /// `c`, the factor of the critics' first bias.
    "imagination.bias_factor" => number(0.0, 1.0).or("0.16666666666666666").of(Concern::Imagination)
        .only_while("imagination.optimism", "true");
    /// `rho`: factor of the noise bound, per update.
    "imagination.decay_rate" => positive(1.0).or("0.9999996").of(Concern::Imagination)
        .only_while("imagination.noise_decay", "true");
    /// Where the paper's text and the code that its authors released differ, what the defaults of the next three keys and
    /// of `rules.velocity` follow: the code (`released`), which made the published curves, or the text.
    "imagination.readings" => word(&["released", "text"]).or("\"released\"").of(Concern::Imagination).young();
    /// How the target filter compares the imaginary target with the real one. Text: `greater_equal`.
    "imagination.target_comparison" => word(&["greater_equal", "greater"]).or("\"greater\"")
        .of(Concern::Imagination);
    /// What the critics' disagreement is divided by: the largest since phase 2 began (text), or the largest of the batch.
    "imagination.uncertainty_scale" => word(&["running_max", "batch_max"]).or("\"batch_max\"")
        .of(Concern::Imagination);
    /// What the summed imaginary loss is divided by: the number of kept transitions (text, equation 10), or the batch
    /// size.
    "imagination.imaginary_loss_mean" => word(&["kept", "batch"]).or("\"batch\"").of(Concern::Imagination);

    /// Imagined steps after the real one.
    "expansion.horizon" => whole(1, 100).or("3").of(Concern::Expansion);

    /// Where the rewards of imagined steps come from: the known rule, or a further output of the dynamics model, for
    /// tasks whose reward nobody can write down.
    "rules.reward" => word(&["known", "learned"]).or("\"known\"").of(Concern::Model).tolerated();
    /// Velocity in imagined forward rewards: the mean of before and after the step (text), or that before.
    "rules.velocity" => word(&["mean", "start"]).or("\"start\"").of(Concern::Model).tolerated();

    /// Environment steps between two evaluations.
    "evaluation.every" => whole(1, LARGEST).or("5_000");
    /// Episodes of one evaluation.
    "evaluation.episodes" => whole(1, 100_000).or("10");

    /// States of the simulator, chosen at random since the last evaluation, in which imagined steps are executed and
    /// measured. 0 for none.
    "telemetry.states" => whole(0, 100_000).or("256").of(Concern::Imagination).tolerated();

    /// Recorded states, spread evenly over the demonstrations, in which evaluations start the policy for 60 steps each
    /// to measure what it makes of them. 0 for none.
    "telemetry.recorded_states" => whole(0, 100_000).or("0").young();

    /// Environment steps between two videos, a multiple of `evaluation.every`. 0 for none.
    "video.every" => whole(0, LARGEST).or("0").on_resume(Resume::Forced).young();

    /// Environment steps between two saves of `checkpoints/last`.
    "checkpoint.every" => whole(1, LARGEST).or("50_000").on_resume(Resume::Forced);
    /// Whether the replay buffer is saved with it. Without, a run can be evaluated but not resumed.
    "checkpoint.replay" => flag().or("true");

    /// How sequences of actions are made: `icem` (Pinneri et al. 2020), `topdm` (the published optimiser of the hand tasks,
    /// Charlesworth and Montana 2021), `mppi` (Williams et al. 2017) or `sampling` (predictive sampling, Howell et al. 2022).
    "planner.method" => word(&["icem", "topdm", "mppi", "sampling"]).or("\"icem\"").young();
    /// Control steps that are looked ahead.
    "planner.horizon" => whole(1, 1_000).or("20").young();
    /// Sequences in an iteration; of `icem` in the first one.
    "planner.samples" => whole(2, 1_000_000).or("64").young();
    /// Iterations at a control step; of `topdm` the nominal number, from which the number falls over the episode.
    "planner.iterations" => whole(1, 10_000).or("3").young();
    /// Iterations at the first control step of an episode, of all but `topdm`.
    "planner.first_iterations" => whole(1, 10_000).or("10").young();
    /// Best sequences that the next ones are made of, of `icem` and `topdm`.
    "planner.elites" => whole(1, 100_000).or("10").young();
    /// Standard deviation of new sequences, as a fraction of half of each number's range.
    "planner.noise" => positive(10.0).or("0.5").young();
    /// Exponent of the noise's power over frequency, of `icem` and `mppi`: 0 is white, 2 is smooth.
    "planner.colour" => number(0.0, 10.0).or("2.0").young();
    /// Share of the old mean and deviation in the new ones, of `icem`.
    "planner.momentum" => number(0.0, 0.999).or("0.1").young();
    /// Factor by which the number of samples falls with each iteration, of `icem`.
    "planner.sample_decay" => number(1.0, 10.0).or("1.25").young();
    /// Share of the elites that are kept for the next iteration and the next step, of `icem`.
    "planner.keep" => number(0.0, 1.0).or("0.3").young();
    /// Probability that a number of a copied sequence changes, of `topdm`.
    "planner.mutation_probability" => positive(1.0).or("0.3").young();
    /// Standard deviation of that change, as a fraction of half of each number's range.
    "planner.mutation_noise" => positive(10.0).or("0.3").young();
    /// Temperature on the standardised scores, of `mppi`.
    "planner.temperature" => positive(1e3).or("0.1").young();
    /// Knots that noise is put on, of `sampling`.
    "planner.knots" => whole(2, 1_000).or("5").young();
    /// What lies between two knots.
    "planner.interpolation" => word(&["zero", "linear", "cubic"]).or("\"cubic\"").young();
    /// What a step in which the goal is reached adds to a sequence's score, beside its reward.
    "planner.success_bonus" => number(0.0, 1e6).or("1.0").young();
    /// What a sequence's score loses for every step of the horizon that is left when an object has fallen past the hands. The
    /// sequence ends there, and so does a planned episode. 0: both go on, and only rewards count.
    "planner.drop_cost" => number(0.0, 1e6).or("0.0").young();
    /// Steps in a row after which a planned episode ends if its return so far has not risen above what it was before. 0: it does not.
    "planner.patience" => whole(0, 1_000_000).or("0").young();
    /// Environment steps of phase 2 between two episodes that the planner makes in training, with the policy's proposals and
    /// the critics' values: each is recorded in the run's directory and joins the demonstrations. Neither its steps nor those
    /// tried out count as environment steps. 0 for none.
    "planner.every" => whole(0, LARGEST).or("0").young();
    /// Sequences that a checkpoint's policy makes at each control step, as a fraction of `samples`.
    "planner.policy_share" => number(0.0, 1.0).or("0.1").young();
    /// Whether a checkpoint's critics say what comes after the horizon.
    "planner.terminal_value" => flag().or("true").young();

    /// Tensor library that networks are trained with.
    "compute.backend" => word(&["flex", "ndarray"]).or("\"flex\"");
    /// Threads, but no more than the process has cores, by its affinity and the quota of its control groups. Results do not
    /// depend on it.
    "compute.threads" => whole(1, MOST_THREADS).or("2").on_resume(Resume::Free);
}

/// No end but that of TOML's whole numbers.
const LARGEST: u64 = Range::LARGEST;

/// More threads than this never help: an update has two tasks side by side.
const MOST_THREADS: u64 = 64;

const fn key(range: Range) -> Key {
    Key {
        name: "",
        doc: "",
        range,
        default: None,
        concern: Concern::All,
        tolerated: false,
        only_while: None,
        resume: Resume::Fixed,
        is_young: false,
    }
}

const fn whole(least: u64, most: u64) -> Key {
    key(Range::Whole { least, most })
}

const fn number(least: f64, most: f64) -> Key {
    key(Range::Number { least, most })
}

const fn positive(most: f64) -> Key {
    key(Range::Positive { most })
}

const fn word(words: &'static [&'static str]) -> Key {
    key(Range::Word(words))
}

const fn flag() -> Key {
    key(Range::Flag)
}

/// What is special about a key.
impl Key {
    const fn or(self, default: &'static str) -> Key {
        let default = Some(default);
        Key { default, ..self }
    }

    const fn of(self, concern: Concern) -> Key {
        Key { concern, ..self }
    }

    const fn tolerated(self) -> Key {
        Key {
            tolerated: true,
            ..self
        }
    }

    const fn only_while(self, key: &'static str, value: &'static str) -> Key {
        Key {
            only_while: Some((key, value)),
            ..self
        }
    }

    const fn on_resume(self, resume: Resume) -> Key {
        Key { resume, ..self }
    }

    const fn young(self) -> Key {
        Key {
            is_young: true,
            ..self
        }
    }
}

impl Key {
    /// What it means, with its unit.
    pub fn doc(&self) -> &'static str {
        self.doc.trim()
    }

    /// The section it stands in; empty for keys without one.
    pub fn section(&self) -> &'static str {
        self.name.split_once('.').map_or("", |(section, _)| section)
    }

    /// Its default; none where it has to be given, or the configuration is good without it.
    pub fn default(&self) -> Option<Value> {
        self.default.map(parsed)
    }

    /// Why `method` refuses it, if it does.
    pub fn refusal(&self, method: Method) -> Option<&'static str> {
        let taken = self.tolerated || self.concern.includes(method);
        if taken {
            None
        } else {
            self.concern.otherwise()
        }
    }

    /// The key that makes this one mean nothing, and its present value, if there is one among all `values`.
    pub(super) fn switched_off<'a>(
        &self,
        values: &'a BTreeMap<String, Value>,
    ) -> Option<(&'static str, &'a Value)> {
        let (switch, needed) = self.only_while?;
        let value = values.get(switch)?;
        (*value != parsed(needed)).then_some((switch, value))
    }
}

/// A value that this crate writes itself, as TOML.
pub(super) fn parsed(text: &str) -> Value {
    let table: Table = toml::from_str(&format!("value = {text}")).expect("TOML, as a test says");
    table["value"].clone()
}

/// The key called `name`.
pub fn find(name: &str) -> Option<&'static Key> {
    KEYS.iter().find(|key| key.name == name)
}

/// Whether keys stand in a section called `name`.
pub fn is_section(name: &str) -> bool {
    SECTIONS.iter().any(|(section, _)| *section == name)
}

/// The key that `written` was probably meant to be, if any is near.
pub fn nearest(written: &str) -> Option<&'static str> {
    // A key of another section is nearly as near as its last part.
    let last = |name: &str| name.rsplit('.').next().unwrap_or(name).to_owned();
    let likeness = |name: &str| {
        let whole = strsim::normalized_damerau_levenshtein(written, name);
        whole.max(0.95 * strsim::normalized_damerau_levenshtein(&last(written), &last(name)))
    };
    KEYS.iter()
        .map(|key| (likeness(key.name), key.name))
        .filter(|(score, _)| *score > 0.5)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}
