//! The replay buffer.

use super::{Batch, Sampler};
use crate::core::random::Stream;
use std::collections::TryReserveError;
use std::ops::Range;

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
    /// Name of the first part that is not finite.
    pub fn not_finite(&self) -> Option<&'static str> {
        let parts = [
            ("the observation", self.obs),
            ("the previous action", self.previous_action),
            ("the action", self.action),
            ("the reward", &[self.reward]),
            ("the next observation", self.next_obs),
        ];
        let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
        parts
            .into_iter()
            .find_map(|(name, numbers)| (!finite(numbers)).then_some(name))
    }

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
    /// Transitions ever stored. Number n, counted from 0, lies in row n modulo the capacity.
    pushed: u64,
}

impl ReplayBuffer {
    /// An empty buffer of at most `capacity` transitions. Memory is taken as it fills.
    pub fn new(capacity: usize, obs_size: usize, action_size: usize) -> ReplayBuffer {
        ReplayBuffer {
            obs_size,
            action_size,
            capacity,
            rows: Vec::new(),
            pushed: 0,
        }
    }

    /// Has the next transition of a buffer that is empty be number `first`, as if those before it had been
    /// overwritten already; they are to be followed by as many as the buffer holds.
    pub fn skip_to(&mut self, first: u64) {
        self.pushed = first;
        if first > 0 {
            self.rows.resize(self.numbers(self.capacity as u64), 0.0);
        }
    }

    /// Stores transitions as they lie in the buffer: rows `s | p | a | s' | r | d`.
    pub fn push_rows(&mut self, numbers: &[f32]) {
        for row in numbers.chunks_exact(self.width()) {
            self.next_row().copy_from_slice(row);
            self.pushed += 1;
        }
    }

    /// Adds all transitions of `more`, which is of the same sizes, and makes room for them: none is overwritten.
    pub fn append(&mut self, more: &ReplayBuffer) {
        self.capacity = self.len() + more.len();
        self.push_rows(&more.rows);
    }

    /// Numbers a transition of these sizes takes.
    pub fn row_width(obs_size: usize, action_size: usize) -> usize {
        2 * obs_size + 2 * action_size + 2
    }

    /// Asks for the memory of a full buffer at once, so that it need not be copied as it fills. The
    /// system gives it bit by bit.
    ///
    /// # Errors
    /// When there is not that much.
    pub fn reserve(&mut self) -> Result<(), TryReserveError> {
        let missing = (self.capacity * self.width()).saturating_sub(self.rows.len());
        self.rows.try_reserve_exact(missing)
    }

    /// Numbers a transition takes.
    pub fn width(&self) -> usize {
        ReplayBuffer::row_width(self.obs_size, self.action_size)
    }

    /// Numbers that `transitions` take.
    fn numbers(&self, transitions: u64) -> usize {
        transitions as usize * self.width()
    }

    /// Transitions ever stored.
    pub fn pushed(&self) -> u64 {
        self.pushed
    }

    /// The numbers of the transitions that are still there after `pushed`, counted from the first one ever
    /// stored.
    pub fn stored_of(&self, pushed: u64) -> Range<u64> {
        pushed.saturating_sub(self.capacity as u64)..pushed
    }

    /// The numbers of the transitions that are there.
    pub fn stored(&self) -> Range<u64> {
        self.stored_of(self.pushed)
    }

    /// The transitions with the numbers `range`, which must be there, as runs of rows
    /// `s | p | a | s' | r | d`.
    pub fn rows(&self, range: Range<u64>) -> impl Iterator<Item = &[f32]> {
        self.runs(range).map(|run| &self.rows[self.place(&run)])
    }

    /// `range` cut where the ring begins anew.
    fn runs(&self, range: Range<u64>) -> impl Iterator<Item = Range<u64>> + use<> {
        let capacity = self.capacity as u64;
        let turn = (range.start / capacity + 1) * capacity;
        let (first, second) = (range.start..range.end.min(turn), turn..range.end);
        [first, second].into_iter().filter(|run| !run.is_empty())
    }

    /// Where the numbers of a run are.
    fn place(&self, run: &Range<u64>) -> Range<usize> {
        let start = self.numbers(run.start % self.capacity as u64);
        start..start + self.numbers(run.end - run.start)
    }

    /// Transitions stored.
    pub fn len(&self) -> usize {
        self.rows.len() / self.width()
    }

    /// Whether nothing is stored.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Stores a transition, over the oldest one when the buffer is full; where it lies.
    pub fn push(&mut self, t: Transition<'_>) -> usize {
        let index = self.next();
        let mut row = self.next_row();
        let end = [t.reward, f32::from(u8::from(t.terminated))];
        for part in [t.obs, t.previous_action, t.action, t.next_obs, &end] {
            let (head, tail) = row.split_at_mut(part.len());
            head.copy_from_slice(part);
            row = tail;
        }
        self.pushed += 1;
        index
    }

    /// Row that the next transition is written to.
    fn next(&self) -> usize {
        (self.pushed % self.capacity as u64) as usize
    }

    fn next_row(&mut self) -> &mut [f32] {
        let (start, width) = (self.next() * self.width(), self.width());
        if self.rows.len() == start {
            self.rows.resize(start + width, 0.0);
        }
        &mut self.rows[start..start + width]
    }

    /// `rows` transitions as `sampler` chooses them.
    ///
    /// # Panics
    /// When the buffer is empty.
    pub fn sample(&self, rows: usize, sampler: &dyn Sampler, rng: &mut Stream) -> Batch {
        let chosen = sampler.choose(self.len(), rows, rng);
        Batch {
            weights: chosen.weights,
            ..self.gather(chosen.indices)
        }
    }

    /// The newest `rows` transitions, or as many as there are, newest first.
    pub fn newest(&self, rows: usize) -> Batch {
        let stored = self.len();
        let rows = rows.min(stored);
        let next = self.next();
        self.gather(
            (1..=rows)
                .map(|back| (next + stored - back) % stored)
                .collect(),
        )
    }

    /// The transitions that lie at `indices`.
    fn gather(&self, indices: Vec<usize>) -> Batch {
        let (so, sa, width) = (self.obs_size, self.action_size, self.width());
        let rows = indices.len();
        let mut batch = Batch {
            rows,
            obs: Vec::with_capacity(rows * so),
            action: Vec::with_capacity(rows * sa),
            reward: Vec::with_capacity(rows),
            next_obs: Vec::with_capacity(rows * so),
            terminated: Vec::with_capacity(rows),
            previous_action: Vec::with_capacity(rows * sa),
            indices: Vec::new(),
            weights: Vec::new(),
            recorded: 0,
            attained: Vec::new(),
        };
        for &i in &indices {
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
        batch.indices = indices;
        batch
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;
    use crate::replay::Uniform;

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
        assert_eq!(batch.indices, [4, 3]);
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
        let sample = |seed| buffer.sample(8000, &Uniform, &mut stream(seed, "replay"));
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
