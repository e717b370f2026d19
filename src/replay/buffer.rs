//! The replay buffer.

use super::Batch;
use crate::random::Stream;
use rand::RngExt;

/// One transition as it happened, unscaled.
#[derive(Debug, Clone, Copy)]
pub struct Transition<'a> {
    /// Observation `s`.
    pub obs: &'a [f32],
    /// Executed action `a`.
    pub action: &'a [f32],
    /// Reward `r`.
    pub reward: f32,
    /// Next observation `s'`.
    pub next_obs: &'a [f32],
    /// Whether the task ended in `s'` (not by a time limit).
    pub terminated: bool,
    /// Executed action before `s`; 0 after a reset.
    pub previous_action: &'a [f32],
}

impl Transition<'_> {
    /// Whether the task ended, as 1 or 0.
    pub(super) fn ended(&self) -> f32 {
        f32::from(u8::from(self.terminated))
    }
}

/// A ring of transitions, each one contiguous row of single-precision numbers, so that a sampled
/// transition costs one run of cache lines rather than six.
#[derive(Debug)]
pub struct ReplayBuffer {
    obs_size: usize,
    action_size: usize,
    capacity: usize,
    /// Rows of `s | p | a | s' | r | d`; grows up to the capacity.
    rows: Vec<f32>,
    /// Row that the next transition is written to.
    next: usize,
}

impl ReplayBuffer {
    /// An empty buffer of at most `capacity` transitions. Memory is taken as it fills.
    pub fn new(capacity: usize, obs_size: usize, action_size: usize) -> ReplayBuffer {
        ReplayBuffer {
            obs_size,
            action_size,
            capacity,
            rows: Vec::new(),
            next: 0,
        }
    }

    /// Numbers a transition takes.
    fn width(&self) -> usize {
        2 * self.obs_size + 2 * self.action_size + 2
    }

    /// Transitions stored.
    pub fn len(&self) -> usize {
        self.rows.len() / self.width()
    }

    /// Whether nothing is stored.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Stores a transition, over the oldest one when the buffer is full.
    pub fn push(&mut self, t: Transition<'_>) {
        let (start, width) = (self.next * self.width(), self.width());
        if self.rows.len() == start {
            self.rows.resize(start + width, 0.0);
        }
        let mut row = &mut self.rows[start..start + width];
        let end = [t.reward, f32::from(u8::from(t.terminated))];
        for part in [t.obs, t.previous_action, t.action, t.next_obs, &end] {
            let (head, tail) = row.split_at_mut(part.len());
            head.copy_from_slice(part);
            row = tail;
        }
        self.next = (self.next + 1) % self.capacity;
    }

    /// `rows` transitions, uniform with replacement.
    ///
    /// # Panics
    /// When the buffer is empty.
    pub fn sample(&self, rows: usize, rng: &mut Stream) -> Batch {
        let stored = self.len();
        self.gather((0..rows).map(|_| rng.random_range(0..stored)), rows)
    }

    /// The newest `rows` transitions, or as many as there are, newest first.
    pub fn newest(&self, rows: usize) -> Batch {
        let stored = self.len();
        let rows = rows.min(stored);
        self.gather(
            (1..=rows).map(|back| (self.next + stored - back) % stored),
            rows,
        )
    }

    fn gather(&self, indices: impl Iterator<Item = usize>, rows: usize) -> Batch {
        let (so, sa, width) = (self.obs_size, self.action_size, self.width());
        let mut batch = Batch {
            rows,
            obs: Vec::with_capacity(rows * so),
            action: Vec::with_capacity(rows * sa),
            reward: Vec::with_capacity(rows),
            next_obs: Vec::with_capacity(rows * so),
            terminated: Vec::with_capacity(rows),
            previous_action: Vec::with_capacity(rows * sa),
        };
        for i in indices {
            let row = &self.rows[i * width..][..width];
            let (obs, row) = row.split_at(so);
            let (previous, row) = row.split_at(sa);
            let (action, row) = row.split_at(sa);
            let (next, end) = row.split_at(so);
            batch.obs.extend_from_slice(obs);
            batch.previous_action.extend_from_slice(previous);
            batch.action.extend_from_slice(action);
            batch.next_obs.extend_from_slice(next);
            batch.reward.push(end[0]);
            batch.terminated.push(end[1]);
        }
        batch
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;

    fn push(buffer: &mut ReplayBuffer, i: f32) {
        buffer.push(Transition {
            obs: &[i, i + 0.1],
            action: &[i + 0.2],
            reward: i + 0.3,
            next_obs: &[i + 1.0, i + 1.1],
            terminated: i == 3.0,
            previous_action: &[i - 0.8],
        });
    }

    #[test]
    fn rows_come_back_as_stored() {
        let mut buffer = ReplayBuffer::new(10, 2, 1);
        (0..5).for_each(|i| push(&mut buffer, i as f32));
        let batch = buffer.newest(2);
        assert_eq!(batch.obs, [4.0, 4.1, 3.0, 3.1]);
        assert_eq!(batch.action, [4.2, 3.2]);
        assert_eq!(batch.reward, [4.3, 3.3]);
        assert_eq!(batch.next_obs, [5.0, 5.1, 4.0, 4.1]);
        assert_eq!(batch.terminated, [0.0, 1.0]);
        assert_eq!(batch.previous_action, [3.2, 2.2]);
    }

    #[test]
    fn the_oldest_are_overwritten() {
        let mut buffer = ReplayBuffer::new(4, 2, 1);
        (0..6).for_each(|i| push(&mut buffer, i as f32));
        assert_eq!(buffer.len(), 4);
        let firsts: Vec<f32> = buffer.newest(9).obs.iter().step_by(2).copied().collect();
        assert_eq!(firsts, [5.0, 4.0, 3.0, 2.0]);
    }

    #[test]
    fn sampling_is_uniform_and_repeats_for_one_seed() {
        let mut buffer = ReplayBuffer::new(8, 2, 1);
        (0..8).for_each(|i| push(&mut buffer, i as f32));
        let sample = |seed| buffer.sample(8000, &mut stream(seed, "replay"));
        assert_eq!(sample(1), sample(1));
        let mut counts = [0; 8];
        sample(2)
            .obs
            .iter()
            .step_by(2)
            .for_each(|x| counts[*x as usize] += 1);
        assert!(counts.iter().all(|c| (850..1150).contains(c)), "{counts:?}");
    }
}
