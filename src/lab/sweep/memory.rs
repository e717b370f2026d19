//! What the runs of an experiment take together.

use super::PlannedRun;
use crate::env::{self, MakeError};
use crate::run::ReplayMemory;
use std::collections::BTreeMap;

/// What a run takes beside its replay buffer: program, libraries, networks with their moments, simulators. Measured,
/// with networks of 256: some 100 MB on Hopper and on a two-hand task.
const BESIDE: u64 = 200_000_000;

/// Bytes that each of some runs takes with a full replay buffer.
///
/// # Errors
/// When a task can't be made.
pub fn needs(runs: &[PlannedRun]) -> Result<Vec<u64>, MakeError> {
    let mut sizes: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    let needs = runs.iter().map(|run| {
        let config = &run.config;
        let [obs, action] = match sizes.get(config.task.as_str()) {
            Some(sizes) => *sizes,
            None => {
                let (env, _) = env::make(&config.task)?;
                let found = [env.spec().obs_size, env.spec().action_size];
                *sizes.entry(&config.task).or_insert(found)
            }
        };
        let [obs, action] = match &config.doubled_actions {
            Some(_) => [obs + 1, 2 * action],
            None => [obs, action],
        };
        Ok(BESIDE + ReplayMemory::of_sizes(config, obs, action).bytes())
    });
    needs.collect()
}

/// What runs may take together.
#[derive(Debug, Clone)]
pub struct Budget {
    /// Bytes that there are to spare.
    pub available: u64,
    /// Bytes that each run takes, in the order of the runs.
    pub needs: Vec<u64>,
}

impl Budget {
    /// Whether run number `next` fits beside those `running`. One that fits nowhere may begin alone: it says itself what is
    /// missing.
    pub fn has_room(&self, running: &[usize], next: usize) -> bool {
        let need = |run: &usize| self.needs.get(*run).copied().unwrap_or(0);
        let taken: u64 = running.iter().map(need).sum();
        running.is_empty() || taken.saturating_add(need(&next)) <= self.available
    }

    /// How many of the runs fit side by side at most, of `jobs`, were the largest ones made together.
    pub fn side_by_side(&self, jobs: usize) -> usize {
        let mut needs = self.needs.clone();
        needs.sort_unstable_by(|a, b| b.cmp(a));
        let sums = needs.iter().take(jobs).scan(0u64, |sum, need| {
            *sum = sum.saturating_add(*need);
            Some(*sum)
        });
        sums.take_while(|sum| *sum <= self.available).count().max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_as_many_begin_as_fit() {
        let budget = Budget {
            available: 100,
            needs: vec![60, 30, 50, 500],
        };
        assert!(budget.has_room(&[], 0) && budget.has_room(&[0], 1));
        assert!(!budget.has_room(&[0], 2) && budget.has_room(&[1], 2));
        assert!(budget.has_room(&[], 3) && !budget.has_room(&[1], 3));
        assert_eq!(budget.side_by_side(4), 1);
        let small = Budget {
            available: 100,
            needs: vec![30, 40, 20],
        };
        assert_eq!([1, 2, 3].map(|jobs| small.side_by_side(jobs)), [1, 2, 3]);
    }
}
