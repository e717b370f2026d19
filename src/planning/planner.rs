//! A controller that plans.

use super::PlannerSettings;
use super::rollouts::{MakeEnv, Origin, Rollouts, outputs_in_place};
use super::strategy::{self, Shape, Strategy};
use crate::agent::{Controller, Moment, Policy};
use crate::core::random::{Stream, fill_normal};
use crate::nn::Coupling;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What a state is worth after a plan's horizon, from observation and previous action.
pub type Worth = Arc<dyn Fn(&[f32], &[f32]) -> f64 + Send + Sync>;

/// Deviation of the noise on the policy's outputs where it proposes, in units of the ranges.
const POLICY_NOISE: f32 = 0.1;

/// Plans anew at every control step in the true simulator, and executes the first action of its plan.
pub struct Planner {
    settings: PlannerSettings,
    strategy: Box<dyn Strategy>,
    rollouts: Rollouts,
    make_env: MakeEnv,
    workers: usize,
    shape: Shape,
    coupling: Coupling,
    policy: Option<Policy>,
    worth: Option<Worth>,
    /// Control steps simulated so far, by this one and those made of it.
    simulated: Arc<AtomicU64>,
}

impl Planner {
    /// A planner for the task that `make_env` makes, whose rollouts are spread over `workers` simulators.
    pub fn new(
        settings: PlannerSettings,
        make_env: MakeEnv,
        workers: usize,
        coupling: Coupling,
    ) -> Planner {
        let (action_size, episode) = {
            let env = make_env();
            (env.spec().action_size, env.spec().max_episode_steps)
        };
        let shape = Shape {
            horizon: settings.horizon,
            action_size,
            episode,
        };
        Planner {
            strategy: strategy::of(&settings, shape),
            rollouts: Rollouts::new(&make_env, workers, shape, coupling.clone(), &settings),
            settings,
            make_env,
            workers,
            shape,
            coupling,
            policy: None,
            worth: None,
            simulated: Arc::default(),
        }
    }

    /// With what was learned: `policy` makes some of the sequences, and `worth` says what comes after them.
    #[must_use]
    pub fn with(mut self, policy: Option<Policy>, worth: Option<Worth>) -> Planner {
        self.policy = policy;
        self.worth = worth;
        self
    }

    /// Control steps simulated so far, by this one and those made of it.
    pub fn simulated(&self) -> u64 {
        self.simulated.load(Ordering::Relaxed)
    }

    /// Sequences that the policy makes from `origin`, the first without noise, with their scores.
    fn proposals(&mut self, origin: Origin<'_>, rng: &mut Stream) -> (Vec<f32>, Vec<f64>) {
        let Some(policy) = &self.policy else {
            return Default::default();
        };
        let count = (self.settings.policy_share * self.settings.samples as f64).round() as usize;
        let (mut sequences, mut scores) = (Vec::new(), Vec::new());
        let coupling = &self.coupling;
        for i in 0..count {
            let deviation = if i == 0 { 0.0 } else { POLICY_NOISE };
            let mut choose = |_: usize, obs: &[f32], previous: &[f32], action: &mut [f32]| {
                let mut noise = vec![0.0; previous.len()];
                fill_normal(rng, &mut noise);
                let output = policy.output(obs, previous);
                let ranges = coupling.ranges().iter();
                for (((a, u), z), range) in action.iter_mut().zip(output).zip(noise).zip(ranges) {
                    let unit = (u - range.middle) / range.half;
                    *a = (unit + deviation * z).clamp(-1.0, 1.0);
                }
            };
            let worth = self.worth.as_deref().map(|worth| worth as _);
            let (sequence, score) = self.rollouts.follow(origin, &mut choose, worth);
            sequences.extend(sequence);
            scores.push(score);
        }
        (sequences, scores)
    }
}

impl Controller for Planner {
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Stream) -> Vec<f32> {
        if moment.step == 0 {
            self.strategy.begin();
        }
        let state = moment.env.snapshot();
        let origin = Origin {
            state: &state,
            obs: moment.obs,
            previous: moment.previous,
        };
        let (sequences, scores) = self.proposals(origin, rng);
        for iteration in 0..self.strategy.iterations(moment.step) {
            let mut proposed = self.strategy.propose(iteration, rng);
            let worth = self.worth.as_deref().map(|worth| worth as _);
            let mut judged = self.rollouts.score(origin, &proposed, worth);
            if iteration == 0 {
                proposed.extend_from_slice(&sequences);
                judged.extend_from_slice(&scores);
            }
            let taken = (judged.len() * self.shape.horizon) as u64;
            self.simulated.fetch_add(taken, Ordering::Relaxed);
            self.strategy.learn(iteration, &proposed, &judged);
        }
        let mut action = self.strategy.decision()[..self.shape.action_size].to_vec();
        outputs_in_place(&self.coupling, &mut action);
        self.coupling.execute_in_place(&mut action, moment.previous);
        self.strategy.advance(rng);
        action
    }

    fn another(&self) -> Box<dyn Controller> {
        let planner = Planner::new(
            self.settings.clone(),
            Arc::clone(&self.make_env),
            self.workers,
            self.coupling.clone(),
        );
        let mut planner = planner.with(self.policy.clone(), self.worth.clone());
        planner.simulated = Arc::clone(&self.simulated);
        Box::new(planner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Method};
    use crate::core::parallel::with_threads;
    use crate::core::random::stream;
    use crate::core::span::Span;
    use crate::env;
    use crate::task::Env;

    fn settings() -> PlannerSettings {
        PlannerSettings {
            samples: 24,
            iterations: 2,
            first_iterations: 2,
            horizon: 6,
            ..Config::preset(Method::Td3).planner
        }
    }

    fn planner(task: &'static str, workers: usize, worth: Option<Worth>) -> Planner {
        let make: MakeEnv = Arc::new(move || -> Box<dyn Env> { env::make(task).unwrap().0 });
        let width = make().spec().action_size;
        let coupling = Coupling::new(0.7, &vec![Span::symmetric(1.0); width]);
        Planner::new(settings(), make, workers, coupling).with(None, worth)
    }

    /// Rewards of some planned steps.
    fn rewards(task: &'static str, workers: usize, steps: usize) -> Vec<f64> {
        let mut planner = planner(task, workers, None);
        let mut env = env::make(task).unwrap().0;
        let mut rng = stream(1, "episode");
        let mut observation = vec![0.0; env.spec().obs_size];
        let mut previous = vec![0.0; env.spec().action_size];
        env.reset(&mut rng, &mut observation);
        let mut rewards = Vec::new();
        for step in 0..steps {
            let obs: Vec<f32> = observation.iter().map(|x| *x as f32).collect();
            let moment = Moment {
                obs: &obs,
                previous: &previous,
                step,
                env: env.as_ref(),
            };
            previous = planner.act(&moment, &mut rng);
            let action: Vec<f64> = previous.iter().map(|a| f64::from(*a)).collect();
            rewards.push(env.step(&action, &mut observation).reward);
        }
        rewards
    }

    #[test]
    fn plans_do_not_depend_on_the_number_of_simulators_and_threads() {
        let task = "EggCatchUnderarm-v0";
        let one = rewards(task, 1, 3);
        let three = with_threads(3, || rewards(task, 3, 3)).unwrap();
        assert_eq!(one, three);
    }

    #[test]
    fn a_planned_cheetah_runs_forward() {
        let sum: f64 = rewards("HalfCheetah-v4", 1, 60).iter().sum();
        // Standing still is 0, random actions are less.
        assert!(sum > 30.0, "{sum}");
    }

    #[test]
    fn a_drop_costs_every_step_that_is_left_if_it_costs_anything() {
        let task = "PenSpin-v0";
        let mut env = env::make_inspect(task).unwrap();
        let (size, width) = (env.spec().obs_size, env.spec().action_size);
        let mut observation = vec![0.0; size];
        env.reset(&mut stream(2, "episode"), &mut observation);
        let mut qpos = env.qpos().to_vec();
        // Too low for the hand, at the third step too low for anything.
        qpos[26] = 0.045;
        qpos[24] += 0.5;
        let qvel = vec![0.0; env.qvel().len()];
        let start = crate::task::Start {
            qpos: &qpos,
            qvel: &qvel,
            previous_action: None,
            goal: &[],
        };
        env.start_at(&start, &mut observation);
        let state = env.snapshot();
        let make: MakeEnv = Arc::new(move || -> Box<dyn Env> { env::make(task).unwrap().0 });
        let coupling = Coupling::new(0.7, &vec![Span::symmetric(1.0); width]);
        let score = |drop_cost| {
            let settings = PlannerSettings {
                drop_cost,
                ..settings()
            };
            let mut planner = Planner::new(settings, Arc::clone(&make), 1, coupling.clone());
            let sequence = vec![0.0; planner.shape.numbers()];
            let origin = Origin {
                state: &state,
                obs: &vec![0.0; size],
                previous: &vec![0.0; width],
            };
            planner.rollouts.score(origin, &sequence, None)[0]
        };
        let horizon = settings().horizon;
        let zero = vec![0.0; width];
        let steps = (0..horizon).map(|_| env.step(&zero, &mut observation));
        let steps: Vec<_> = steps.collect();
        let dropped = steps.iter().position(|step| step.dropped).unwrap();
        assert!(dropped + 1 < horizon);
        let sum = |steps: &[crate::task::Step]| steps.iter().map(|step| step.reward).sum::<f64>();
        assert_eq!(score(0.0), sum(&steps));
        let left = (horizon - 1 - dropped) as f64;
        assert_eq!(score(5.0), sum(&steps[..=dropped]) - 5.0 * left);
    }

    #[test]
    fn a_score_is_the_sum_of_the_rewards_that_the_sequence_brings_and_the_worth_of_its_end() {
        let task = "HalfCheetah-v4";
        let mut planner = planner(task, 2, None);
        let mut env = env::make(task).unwrap().0;
        let (size, width) = (env.spec().obs_size, env.spec().action_size);
        let mut observation = vec![0.0; size];
        env.reset(&mut stream(2, "episode"), &mut observation);
        let state = env.snapshot();
        let mut previous = vec![0.0f32; width];
        let mut sequences = vec![0.0; 2 * planner.shape.numbers()];
        fill_normal(&mut stream(3, "actions"), &mut sequences);
        planner.shape.clip(&mut sequences);
        let origin = Origin {
            state: &state,
            obs: &vec![0.0; size],
            previous: &previous.clone(),
        };
        let value = |obs: &[f32], previous: &[f32]| f64::from(obs[0] + previous[0]);
        let scores = planner.rollouts.score(origin, &sequences, Some(&value));
        let plain = planner.rollouts.score(origin, &sequences, None);
        let mut sum = 0.0;
        let second = &sequences[planner.shape.numbers()..];
        for u in second.chunks_exact(width) {
            for (p, u) in previous.iter_mut().zip(u) {
                *p = (0.7f32 * u + (1.0 - 0.7f32) * *p).clamp(-1.0, 1.0);
            }
            let action: Vec<f64> = previous.iter().map(|a| f64::from(*a)).collect();
            sum += env.step(&action, &mut observation).reward;
        }
        assert_eq!(plain[1], sum);
        assert_eq!(
            scores[1],
            sum + f64::from(observation[0] as f32 + previous[0])
        );
        assert_ne!(plain[0], plain[1]);
    }
}
