//! Sequences of actions tried out in the simulator.

use super::{PlannerSettings, Shape};
use crate::core::parallel::join;
use crate::nn::Coupling;
use crate::task::{Env, EnvState};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Makes another simulator of the task.
pub type MakeEnv = Arc<dyn Fn() -> Box<dyn Env> + Send + Sync>;

/// What a state is worth at the end of a rollout: observation and previous action to a value.
pub type Value<'a> = &'a (dyn Fn(&[f32], &[f32]) -> f64 + Sync);

/// Simulators in which sequences are tried out side by side. Each begins in a given state, exactly; results do not
/// depend on how many simulators there are.
pub struct Rollouts {
    workers: Vec<Worker>,
    common: Common,
}

/// A simulator with its scratch.
struct Worker {
    env: Box<dyn Env>,
    observation: Vec<f64>,
    single: Vec<f32>,
    action: Vec<f32>,
    previous: Vec<f32>,
    command: Vec<f64>,
}

/// Where rollouts begin.
#[derive(Clone, Copy)]
pub struct Origin<'a> {
    /// The state.
    pub state: &'a EnvState,
    /// The observation there.
    pub obs: &'a [f32],
    /// The action executed before.
    pub previous: &'a [f32],
}

/// Writes each action of a rollout, `[action_size]` in units of its ranges, from the number of the step, the observation
/// and the previous action.
pub(super) type Choose<'a> = &'a mut dyn FnMut(usize, &[f32], &[f32], &mut [f32]);

/// What all rollouts of a planner have in common.
struct Common {
    shape: Shape,
    coupling: Coupling,
    success_bonus: f64,
    drop_cost: f64,
}

impl Rollouts {
    /// `workers` simulators, with the bonus and the cost of `settings`.
    pub fn new(
        make_env: &MakeEnv,
        workers: usize,
        shape: Shape,
        coupling: Coupling,
        settings: &PlannerSettings,
    ) -> Rollouts {
        let worker = |_| {
            let env = make_env();
            Worker {
                observation: vec![0.0; env.spec().obs_size],
                single: vec![0.0; env.spec().obs_size],
                action: vec![0.0; shape.action_size],
                previous: vec![0.0; shape.action_size],
                command: vec![0.0; shape.action_size],
                env,
            }
        };
        Rollouts {
            workers: (0..workers).map(worker).collect(),
            common: Common {
                shape,
                coupling,
                success_bonus: settings.success_bonus,
                drop_cost: settings.drop_cost,
            },
        }
    }

    /// The score of each of `sequences`, `[n, horizon, action_size]`: the sum of its rewards, and of `value` where it
    /// ends, unless the task ended before; minus infinity where the simulation blows up.
    pub fn score(
        &mut self,
        origin: Origin<'_>,
        sequences: &[f32],
        value: Option<Value<'_>>,
    ) -> Vec<f64> {
        let common = &self.common;
        let (numbers, width) = (common.shape.numbers(), common.shape.action_size);
        let count = sequences.len() / numbers;
        let next = AtomicUsize::new(0);
        let work = |worker: &mut Worker| {
            let mut scores = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= count {
                    return scores;
                }
                let sequence = &sequences[i * numbers..][..numbers];
                let mut next = |t: usize, _: &[f32], _: &[f32], action: &mut [f32]| {
                    action.copy_from_slice(&sequence[t * width..][..width]);
                };
                scores.push((i, worker.roll(origin, common, &mut next, value)));
            }
        };
        let mut scores = vec![0.0; count];
        for (i, score) in each(&mut self.workers, &work) {
            scores[i] = score;
        }
        scores
    }

    /// Rolls out whatever `choose` does, in the first simulator: the sequence and its score.
    pub(super) fn follow(
        &mut self,
        origin: Origin<'_>,
        choose: Choose<'_>,
        value: Option<Value<'_>>,
    ) -> (Vec<f32>, f64) {
        let width = self.common.shape.action_size;
        let mut sequence = vec![0.0; self.common.shape.numbers()];
        let mut keep = |t: usize, obs: &[f32], previous: &[f32], action: &mut [f32]| {
            choose(t, obs, previous, action);
            sequence[t * width..][..width].copy_from_slice(action);
        };
        let score = self.workers[0].roll(origin, &self.common, &mut keep, value);
        (sequence, score)
    }
}

/// What `work` makes of each worker, side by side.
fn each<T: Send>(workers: &mut [Worker], work: &(impl Fn(&mut Worker) -> Vec<T> + Sync)) -> Vec<T> {
    match workers {
        [] => Vec::new(),
        [one] => work(one),
        more => {
            let (first, second) = more.split_at_mut(more.len() / 2);
            let (mut done, others) = join(|| each(first, work), || each(second, work));
            done.extend(others);
            done
        }
    }
}

impl Worker {
    /// The score of the actions that `choose` writes.
    fn roll(
        &mut self,
        origin: Origin<'_>,
        common: &Common,
        choose: Choose<'_>,
        value: Option<Value<'_>>,
    ) -> f64 {
        if self.env.restore(origin.state).is_err() {
            return f64::NEG_INFINITY;
        }
        self.previous.copy_from_slice(origin.previous);
        self.single.copy_from_slice(origin.obs);
        let mut sum = 0.0;
        for t in 0..common.shape.horizon {
            choose(t, &self.single, &self.previous, &mut self.action);
            match self.step(common) {
                Stepped::On(reward) => sum += reward,
                Stepped::Over(reward) => return sum + reward,
                Stepped::Dropped(reward) => {
                    let left = (common.shape.horizon - 1 - t) as f64;
                    return sum + reward - common.drop_cost * left;
                }
                Stepped::Diverged => return f64::NEG_INFINITY,
            }
        }
        sum + value.map_or(0.0, |value| value(&self.single, &self.previous))
    }

    /// Executes what `action` becomes after the one before.
    fn step(&mut self, common: &Common) -> Stepped {
        let coupling = &common.coupling;
        outputs_in_place(coupling, &mut self.action);
        coupling.execute_in_place(&mut self.action, &self.previous);
        for (command, action) in self.command.iter_mut().zip(&self.action) {
            *command = f64::from(*action);
        }
        let step = self.env.step(&self.command, &mut self.observation);
        self.previous.copy_from_slice(&self.action);
        for (single, x) in self.single.iter_mut().zip(&self.observation) {
            *single = *x as f32;
        }
        let reward = step.reward
            + if step.success == Some(true) {
                common.success_bonus
            } else {
                0.0
            };
        if step.diverged {
            Stepped::Diverged
        } else if step.terminated || step.truncated {
            Stepped::Over(reward)
        } else if step.dropped && common.drop_cost > 0.0 {
            Stepped::Dropped(reward)
        } else {
            Stepped::On(reward)
        }
    }
}

/// What became of a step.
enum Stepped {
    On(f64),
    Over(f64),
    Dropped(f64),
    Diverged,
}

/// From numbers in units of the ranges to the outputs that are coupled.
pub(super) fn outputs_in_place(coupling: &Coupling, numbers: &mut [f32]) {
    for (x, range) in numbers.iter_mut().zip(coupling.ranges()) {
        *x = range.half * *x + range.middle;
    }
}
