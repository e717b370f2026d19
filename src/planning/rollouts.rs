//! Sequences of actions tried out in the simulator.

use super::Shape;
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
    shape: Shape,
    coupling: Coupling,
    success_bonus: f64,
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

/// Chooses each action of a rollout, `[action_size]` in units of its ranges, from observation and previous action.
pub(super) type Choose<'a> = &'a mut dyn FnMut(usize, &[f32], &[f32]) -> Vec<f32>;

impl Rollouts {
    /// `workers` simulators; each step in which the task succeeds adds `success_bonus` to a score.
    pub fn new(
        make_env: &MakeEnv,
        workers: usize,
        shape: Shape,
        coupling: Coupling,
        success_bonus: f64,
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
            shape,
            coupling,
            success_bonus,
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
        let (shape, coupling, bonus) = (self.shape, &self.coupling, self.success_bonus);
        let numbers = shape.numbers();
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
                scores.push((
                    i,
                    worker.score(origin, sequence, shape, coupling, bonus, value),
                ));
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
        let (shape, coupling, bonus) = (self.shape, &self.coupling, self.success_bonus);
        self.workers[0].follow(origin, choose, shape, coupling, bonus, value)
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
    fn score(
        &mut self,
        origin: Origin<'_>,
        sequence: &[f32],
        shape: Shape,
        coupling: &Coupling,
        bonus: f64,
        value: Option<Value<'_>>,
    ) -> f64 {
        if self.begin(origin) {
            return f64::NEG_INFINITY;
        }
        let mut sum = 0.0;
        for u in sequence.chunks_exact(shape.action_size) {
            self.action.copy_from_slice(u);
            match self.step(coupling, bonus) {
                Stepped::On(reward) => sum += reward,
                Stepped::Over(reward) => return sum + reward,
                Stepped::Diverged => return f64::NEG_INFINITY,
            }
        }
        sum + self.worth(value)
    }

    fn follow(
        &mut self,
        origin: Origin<'_>,
        choose: Choose<'_>,
        shape: Shape,
        coupling: &Coupling,
        bonus: f64,
        value: Option<Value<'_>>,
    ) -> (Vec<f32>, f64) {
        let mut sequence = vec![0.0; shape.numbers()];
        if self.begin(origin) {
            return (sequence, f64::NEG_INFINITY);
        }
        self.single.copy_from_slice(origin.obs);
        let mut sum = 0.0;
        for (t, u) in sequence.chunks_exact_mut(shape.action_size).enumerate() {
            u.copy_from_slice(&choose(t, &self.single, &self.previous));
            self.action.copy_from_slice(u);
            match self.step(coupling, bonus) {
                Stepped::On(reward) => sum += reward,
                Stepped::Over(reward) => return (sequence, sum + reward),
                Stepped::Diverged => return (sequence, f64::NEG_INFINITY),
            }
            self.observe();
        }
        let worth = self.worth(value);
        (sequence, sum + worth)
    }

    /// Puts the simulator where rollouts begin; whether it can't.
    fn begin(&mut self, origin: Origin<'_>) -> bool {
        self.previous.copy_from_slice(origin.previous);
        self.env.restore(origin.state).is_err()
    }

    /// Executes what `action` becomes after the one before.
    fn step(&mut self, coupling: &Coupling, bonus: f64) -> Stepped {
        outputs_in_place(coupling, &mut self.action);
        coupling.execute_in_place(&mut self.action, &self.previous);
        for (command, action) in self.command.iter_mut().zip(&self.action) {
            *command = f64::from(*action);
        }
        let step = self.env.step(&self.command, &mut self.observation);
        self.previous.copy_from_slice(&self.action);
        let reward = step.reward
            + if step.success == Some(true) {
                bonus
            } else {
                0.0
            };
        if step.diverged {
            Stepped::Diverged
        } else if step.terminated || step.truncated {
            Stepped::Over(reward)
        } else {
            Stepped::On(reward)
        }
    }

    fn observe(&mut self) {
        for (single, x) in self.single.iter_mut().zip(&self.observation) {
            *single = *x as f32;
        }
    }

    fn worth(&mut self, value: Option<Value<'_>>) -> f64 {
        let Some(value) = value else {
            return 0.0;
        };
        self.observe();
        value(&self.single, &self.previous)
    }
}

/// What became of a step.
enum Stepped {
    On(f64),
    Over(f64),
    Diverged,
}

/// From numbers in units of the ranges to the outputs that are coupled.
pub(super) fn outputs_in_place(coupling: &Coupling, numbers: &mut [f32]) {
    for (x, range) in numbers.iter_mut().zip(coupling.ranges()) {
        *x = range.half * *x + range.middle;
    }
}
