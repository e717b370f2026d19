//! Recorded transitions that have a share in every batch.

use crate::core::random::{Stream, stream};
use crate::nn::{LearningState, WeightError};
use crate::replay::{Batch, ReplayBuffer, Uniform};

/// Recorded transitions, and how much of each batch they make up. They do not age: what training adds to the replay
/// buffer never overwrites them.
pub struct Recorded {
    transitions: ReplayBuffer,
    /// Discounted return that followed each of them, if that bounds targets.
    attained: Option<Vec<f32>>,
    share: f64,
    rng: Stream,
}

impl Recorded {
    /// `transitions`, at least one, which are the fraction `share` of each batch, drawn from the stream of `seed`. What
    /// each of them `attained` after it, if that is given, is what its target is at least.
    pub fn new(
        transitions: ReplayBuffer,
        attained: Option<Vec<f32>>,
        share: f64,
        seed: u64,
    ) -> Recorded {
        Recorded {
            transitions,
            attained,
            share,
            rng: stream(seed, "recorded"),
        }
    }

    /// Adds those of `more`, of the same task and settings.
    pub fn add(&mut self, more: Recorded) {
        self.transitions.append(&more.transitions);
        if let (Some(attained), Some(more)) = (&mut self.attained, more.attained) {
            attained.extend(more);
        }
    }

    /// How many of `rows` they are.
    pub fn part_of(&self, rows: usize) -> usize {
        (self.share * rows as f64).round() as usize
    }

    /// `rows` of them, uniformly, with replacement.
    pub fn draw(&mut self, rows: usize) -> Batch {
        let batch = self.transitions.sample(rows, &Uniform, &mut self.rng);
        let attained = self.attained.iter().flat_map(|attained| {
            let of = |index: &usize| attained[*index];
            batch.indices.iter().map(of)
        });
        Batch {
            attained: attained.collect(),
            ..batch
        }
    }

    pub(super) fn save_state(&self, state: &mut LearningState) {
        state.set_stream("recorded", &self.rng);
    }

    pub(super) fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.rng = state.stream("recorded")?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Transition;

    /// A buffer of two transitions whose rewards are from `first` on.
    fn buffer(first: f32) -> ReplayBuffer {
        let mut buffer = ReplayBuffer::new(2, 1, 1);
        for i in 0..2 {
            let reward = first + i as f32;
            buffer.push(Transition {
                obs: &[0.0],
                action: &[0.0],
                reward,
                next_obs: &[0.0],
                terminated: false,
                previous_action: &[0.0],
            });
        }
        buffer
    }

    #[test]
    fn they_are_the_last_rows_of_a_batch_in_their_share() {
        let mut recorded = Recorded::new(buffer(10.0), Some(vec![7.0, 8.0]), 0.25, 1);
        assert_eq!(recorded.part_of(16), 4);
        let mut batch = buffer(0.0).sample(12, &Uniform, &mut stream(1, "replay"));
        batch.extend_recorded(&recorded.draw(4));
        assert_eq!((batch.rows, batch.recorded_rows()), (16, 12..16));
        assert_eq!(batch.obs.len(), 16);
        assert!(batch.reward[..12].iter().all(|r| *r < 2.0));
        assert!(batch.reward[12..].iter().all(|r| *r >= 10.0));
        assert_eq!(batch.indices.len(), 12);
        let attained: Vec<f32> = batch.reward[12..].iter().map(|r| r - 3.0).collect();
        assert_eq!(batch.attained, attained);
    }

    #[test]
    fn draws_go_on_from_a_saved_state() {
        let mut recorded = Recorded::new(buffer(0.0), None, 0.5, 1);
        recorded.draw(7);
        let mut state = LearningState::default();
        recorded.save_state(&mut state);
        let mut other = Recorded::new(buffer(0.0), None, 0.5, 2);
        assert!(other.restore(&LearningState::default()).is_err());
        other.restore(&state).unwrap();
        assert_eq!(recorded.draw(50), other.draw(50));
    }
}
