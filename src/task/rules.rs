//! What a task's designer knows, on batches of observations and without a simulator.

use serde::{Deserialize, Serialize};

/// Which velocity the forward reward of a locomotion task reads from a pair of observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VelocityReading {
    /// The velocity in `s` (the published reading).
    Start,
    /// The mean of the velocities in `s` and `s'`, closer to the simulator's difference quotient.
    #[default]
    Mean,
}

impl VelocityReading {
    /// The velocity of a step from the velocities before and after it.
    pub fn of(self, before: f32, after: f32) -> f32 {
        match self {
            VelocityReading::Start => before,
            VelocityReading::Mean => 0.5 * (before + after),
        }
    }
}

/// Reward, termination and known coordinates of a task as pure functions of unscaled observations.
///
/// Rows are single precision, as they come out of replay and of the dynamics model. Tasks write
/// the row functions; the batch functions are what learning calls, one virtual call a batch.
pub trait Rules: Send + Sync {
    /// Reward of the transition `(s, a, s')`, `a` being the executed action.
    fn reward(&self, obs: &[f32], action: &[f32], next_obs: &[f32]) -> f32;

    /// Whether the task ends on arriving at `next_obs`.
    fn terminated(&self, next_obs: &[f32]) -> bool;

    /// Coordinates of the observation that need no learning, ascending; the dynamics model is
    /// trained on the others only.
    fn known(&self) -> &[usize] {
        &[]
    }

    /// Overwrites the [`known`](Rules::known) coordinates of the prediction `next_obs`.
    fn complete(&self, obs: &[f32], action: &[f32], next_obs: &mut [f32]) {
        let _ = (obs, action, next_obs);
    }

    /// Rewards of `out.len()` rows; the slices hold rows of `obs_size` and `action_size` numbers.
    fn reward_batch(&self, obs: &[f32], action: &[f32], next_obs: &[f32], out: &mut [f32]) {
        let (so, sa) = (obs.len() / out.len(), action.len() / out.len());
        for (i, r) in out.iter_mut().enumerate() {
            *r = self.reward(
                &obs[i * so..][..so],
                &action[i * sa..][..sa],
                &next_obs[i * so..][..so],
            );
        }
    }

    /// Termination of `out.len()` rows, as 1 (terminated) or 0.
    fn terminated_batch(&self, next_obs: &[f32], out: &mut [f32]) {
        let so = next_obs.len() / out.len();
        for (row, d) in next_obs.chunks_exact(so).zip(out) {
            *d = f32::from(u8::from(self.terminated(row)));
        }
    }

    /// [`complete`](Rules::complete) on `rows` rows; does nothing when nothing is known.
    fn complete_batch(&self, obs: &[f32], action: &[f32], next_obs: &mut [f32], rows: usize) {
        if self.known().is_empty() {
            return;
        }
        let (so, sa) = (obs.len() / rows, action.len() / rows);
        for i in 0..rows {
            self.complete(
                &obs[i * so..][..so],
                &action[i * sa..][..sa],
                &mut next_obs[i * so..][..so],
            );
        }
    }
}
