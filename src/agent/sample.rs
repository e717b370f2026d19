//! What one update of the core consumes: transitions and noise, all drawn beforehand.

use super::Recorded;
use crate::core::random::{Stream, fill_normal, stream};
use crate::nn::{LearningState, WeightError};
use crate::replay::{Batch, ReplayBuffer, Sampler};

/// Transitions and noise of one update of actor and critics.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The batch that critics and actor learn from.
    pub batch: Batch,
    /// Standard normal draws of the next action at `s'`, `[n, action_size]`: of the target policy's smoothing, or of
    /// the policy itself if that is stochastic.
    pub next_noise: Vec<f32>,
    /// Standard normal draws of the actor's step, `[n, action_size]`; empty for deterministic policies.
    pub actor_noise: Vec<f32>,
}

/// The random streams that samples are drawn from.
#[derive(Debug, Clone)]
pub(super) struct SampleStreams {
    replay: Stream,
    smoothing: Stream,
    policy: Stream,
}

impl SampleStreams {
    pub fn new(seed: u64) -> SampleStreams {
        SampleStreams {
            replay: stream(seed, "replay"),
            smoothing: stream(seed, "smoothing"),
            policy: stream(seed, "policy"),
        }
    }

    /// A sample of `rows` transitions for actions of `action_size` numbers, some of them `recorded`.
    pub fn draw(
        &mut self,
        replay: &ReplayBuffer,
        sampler: &dyn Sampler,
        recorded: Option<&mut Recorded>,
        rows: usize,
        action_size: usize,
        stochastic: bool,
    ) -> Sample {
        let part = recorded.as_ref().map_or(0, |set| set.part_of(rows));
        let mut batch = replay.sample(rows - part, sampler, &mut self.replay);
        if let Some(recorded) = recorded {
            batch.extend_recorded(&recorded.draw(part));
        }
        let next_noise = standard_normal(rows * action_size, &mut self.smoothing);
        let actor_noise = if stochastic {
            standard_normal(rows * action_size, &mut self.policy)
        } else {
            Vec::new()
        };
        Sample {
            batch,
            next_noise,
            actor_noise,
        }
    }

    pub fn save_state(&self, state: &mut LearningState) {
        state.set_stream("replay", &self.replay);
        state.set_stream("smoothing", &self.smoothing);
        state.set_stream("policy", &self.policy);
    }

    pub fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.replay = state.stream("replay")?;
        self.smoothing = state.stream("smoothing")?;
        self.policy = state.stream("policy")?;
        Ok(())
    }
}

/// `n` independent standard normal numbers.
pub(super) fn standard_normal(n: usize, rng: &mut Stream) -> Vec<f32> {
    let mut draws = vec![0.0; n];
    fill_normal(rng, &mut draws);
    draws
}
