//! How long a planned episode is worth planning.

use super::PlannerSettings;
use crate::task::Step;

/// Watches over a planned episode.
#[derive(Debug, Clone)]
pub struct Worthwhile {
    ends_when_dropped: bool,
    patience: usize,
    episode_return: f64,
    highest: f64,
    /// Steps since the return was highest.
    idle: usize,
}

impl Worthwhile {
    /// Before the first step of an episode under `settings`.
    pub fn new(settings: &PlannerSettings) -> Worthwhile {
        Worthwhile {
            ends_when_dropped: settings.drop_cost > 0.0,
            patience: settings.patience,
            episode_return: 0.0,
            highest: f64::NEG_INFINITY,
            idle: 0,
        }
    }

    /// Takes note of a step.
    pub fn see(&mut self, step: &Step) {
        self.episode_return += step.reward;
        self.idle += 1;
        if self.episode_return > self.highest {
            self.highest = self.episode_return;
            self.idle = 0;
        }
    }

    /// The undiscounted return so far.
    pub fn episode_return(&self) -> f64 {
        self.episode_return
    }

    /// Whether the episode is over after `step`, which was seen: with the task, where an object is dropped whose drop costs
    /// something, or where nothing was gained for too long.
    pub fn is_over(&self, step: &Step) -> bool {
        let dropped = self.ends_when_dropped && step.dropped;
        let idle = self.patience > 0 && self.idle >= self.patience;
        step.terminated || step.truncated || dropped || idle
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Method};

    fn step(reward: f64, dropped: bool) -> Step {
        Step {
            reward,
            terminated: false,
            truncated: false,
            diverged: false,
            buffer_full: false,
            dropped,
            success: None,
        }
    }

    fn lasts(patience: usize, drop_cost: f64, steps: &[Step]) -> Option<usize> {
        let settings = PlannerSettings {
            patience,
            drop_cost,
            ..Config::preset(Method::Td3).planner
        };
        let mut watched = Worthwhile::new(&settings);
        steps.iter().position(|step| {
            watched.see(step);
            watched.is_over(step)
        })
    }

    #[test]
    fn an_episode_ends_when_nothing_was_gained_for_too_long_or_something_fell() {
        let rewards = [1.0, -1.0, 0.5, 2.0, 0.0, 0.0, 0.0];
        let mut steps = rewards.map(|reward| step(reward, false));
        assert_eq!(lasts(0, 0.0, &steps), None);
        assert_eq!(lasts(3, 0.0, &steps), Some(6));
        assert_eq!(lasts(2, 0.0, &steps), Some(2));
        steps[4].dropped = true;
        assert_eq!(lasts(0, 0.0, &steps), None);
        assert_eq!(lasts(3, 1.0, &steps), Some(4));
        steps[0].truncated = true;
        assert_eq!(lasts(0, 0.0, &steps), Some(0));
    }
}
