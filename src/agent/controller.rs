//! Whatever acts: policies, exploration, recorded, zero and random actions.

use super::BaseAlgorithm;
use super::core::sample_in_place;
use crate::core::random::{Stream, fill_normal};
use crate::core::span::Span;
use crate::nn::{Coupling, Mlp, ObservationScaling, Range};
use crate::task::Env;
use rand::RngExt;

/// What there is to act on.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    /// The observation, not scaled, `[obs_size]`.
    pub obs: &'a [f32],
    /// The action executed before, `[action_size]`; 0 after a reset.
    pub previous: &'a [f32],
    /// Control steps since the episode began.
    pub step: usize,
    /// The task in this very state, for those that look ahead in it.
    pub env: &'a dyn Env,
}

/// Whatever chooses actions.
pub trait Controller: Send {
    /// The action to execute now, `[action_size]`, within the task's limit; randomness comes from `rng`.
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Stream) -> Vec<f32>;

    /// Another one that acts alike, for an episode elsewhere.
    fn another(&self) -> Box<dyn Controller>;
}

/// A policy: an actor, its observation scaling and the coupling of its actions. As a controller it acts
/// deterministically, a stochastic one by its mean.
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    actor: Mlp,
    base: BaseAlgorithm,
    scaling: ObservationScaling,
    coupling: Coupling,
}

impl Policy {
    /// A policy of `actor`, trained by `base`, on scaled observations.
    pub fn new(
        actor: Mlp,
        base: BaseAlgorithm,
        scaling: ObservationScaling,
        coupling: Coupling,
    ) -> Policy {
        Policy {
            actor,
            base,
            scaling,
            coupling,
        }
    }

    /// The deterministic executed action in `obs` (not scaled, `[obs_size]`) after `previous`, the action executed
    /// before (`[action_size]`, 0 after a reset).
    pub fn act(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let mut action = self.output(obs, previous);
        self.coupling.execute_in_place(&mut action, previous);
        action
    }

    /// As [`act`](Policy::act), with normal noise on the policy's output, whose `deviation` is a fraction of half of each
    /// number's range; a stochastic policy is sampled instead.
    pub fn explore(
        &self,
        obs: &[f32],
        previous: &[f32],
        deviation: f64,
        rng: &mut Stream,
    ) -> Vec<f32> {
        let mut noise = vec![0.0; previous.len()];
        fill_normal(rng, &mut noise);
        let mut action = self.network(obs, previous);
        if self.base.is_stochastic() {
            action = sample_in_place(&action, &noise, &self.coupling, None);
        } else {
            self.coupling.output_in_place(&mut action);
            let ranges = self.coupling.ranges();
            for ((u, z), range) in action.iter_mut().zip(noise).zip(ranges) {
                *u += (deviation * range.span.half()) as f32 * z;
            }
        }
        self.coupling.execute_in_place(&mut action, previous);
        action
    }

    /// The deterministic output `u` in `obs` after `previous`, before it is coupled with that.
    pub fn output(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let mut output = self.network(obs, previous);
        output.truncate(previous.len());
        self.coupling.output_in_place(&mut output);
        output
    }

    /// What the network says.
    fn network(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        let scaled = self.scaling.scale(obs);
        let observed = self
            .coupling
            .observe(&scaled, previous, obs.len(), previous.len());
        self.actor.forward(&observed)
    }
}

impl Controller for Policy {
    fn act(&mut self, moment: &Moment<'_>, _: &mut Stream) -> Vec<f32> {
        Policy::act(self, moment.obs, moment.previous)
    }

    fn another(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }
}

/// A policy that explores: with normal noise on its output, or sampled if it is stochastic.
#[derive(Debug, Clone)]
pub struct Exploring {
    /// What is explored around.
    pub policy: Policy,
    /// Deviation of the noise, as a fraction of half of each number's range.
    pub deviation: f64,
}

impl Controller for Exploring {
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Stream) -> Vec<f32> {
        self.policy
            .explore(moment.obs, moment.previous, self.deviation, rng)
    }

    fn another(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }
}

/// Uniformly random actions, coupled like any other (phase 1).
#[derive(Debug, Clone)]
pub struct RandomActions {
    /// How they are coupled, and their ranges.
    pub coupling: Coupling,
}

impl RandomActions {
    /// Actions within `ranges`, not coupled.
    pub fn within(ranges: &[Span]) -> RandomActions {
        RandomActions {
            coupling: Coupling::new(1.0, ranges),
        }
    }
}

impl Controller for RandomActions {
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Stream) -> Vec<f32> {
        let draw = |range: &Range| rng.random_range(range.low..=range.high);
        let mut action: Vec<f32> = self.coupling.ranges().iter().map(draw).collect();
        self.coupling.execute_in_place(&mut action, moment.previous);
        action
    }

    fn another(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }
}

/// Zero actions.
#[derive(Debug, Clone, Copy)]
pub struct Zero;

impl Controller for Zero {
    fn act(&mut self, moment: &Moment<'_>, _: &mut Stream) -> Vec<f32> {
        vec![0.0; moment.previous.len()]
    }

    fn another(&self) -> Box<dyn Controller> {
        Box::new(Zero)
    }
}

/// Recorded actions, one a step of the episode; zeros after them.
#[derive(Debug, Clone)]
pub struct Playing {
    /// The actions, `[action_size]` each.
    pub actions: Vec<Vec<f32>>,
}

impl Controller for Playing {
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Stream) -> Vec<f32> {
        match self.actions.get(moment.step) {
            Some(action) => action.clone(),
            None => Zero.act(moment, rng),
        }
    }

    fn another(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;
    use crate::nn::Architecture;

    fn coupling() -> Coupling {
        Coupling::new(0.7, &[Span::symmetric(2.0)])
    }

    fn policy(base: BaseAlgorithm) -> Policy {
        let outputs = if base.is_stochastic() { 2 } else { 1 };
        let actor = Mlp::new(
            &Architecture::relu(&[4, 8, outputs]),
            &mut stream(3, "actor"),
        );
        Policy::new(actor, base, ObservationScaling::identity(3), coupling())
    }

    fn moments(draws: &[f32]) -> (f64, f64) {
        let n = draws.len() as f64;
        let mean = draws.iter().map(|x| f64::from(*x)).sum::<f64>() / n;
        let squares = draws.iter().map(|x| (f64::from(*x) - mean).powi(2));
        (mean, (squares.sum::<f64>() / n).sqrt())
    }

    #[test]
    fn exploration_adds_coupled_noise_of_the_asked_deviation_and_clips_it() {
        let policy = policy(BaseAlgorithm::Td3);
        let (obs, previous) = ([0.3, -0.2, 0.9], [0.5]);
        let rng = &mut stream(1, "exploration");
        let n = 20_000;
        let mut draw = |deviation| -> Vec<f32> {
            (0..n)
                .map(|_| policy.explore(&obs, &previous, deviation, rng)[0])
                .collect()
        };
        let (mean, deviation) = moments(&draw(0.1));
        let centre = f64::from(policy.act(&obs, &previous)[0]);
        // beta times 0.1 of 2, as the rest of the action is the previous one.
        assert!((mean - centre).abs() < 4.0 * 0.14 / f64::from(n).sqrt());
        assert!((deviation - 0.14).abs() < 0.003, "{deviation}");
        let clipped = draw(25.0);
        assert!(clipped.iter().all(|a| a.abs() <= 2.0));
        let at_limit = clipped.iter().filter(|a| a.abs() == 2.0).count();
        assert!(at_limit as f64 > 0.9 * f64::from(n));
    }

    #[test]
    fn a_stochastic_policy_explores_by_its_own_deviation() {
        let policy = policy(BaseAlgorithm::Sac);
        let (obs, previous) = ([0.3, -0.2, 0.9], [0.0]);
        let draws = |deviation| -> Vec<f32> {
            let rng = &mut stream(1, "exploration");
            (0..100)
                .map(|_| policy.explore(&obs, &previous, deviation, rng)[0])
                .collect()
        };
        assert_eq!(draws(0.0), draws(5.0));
        assert!(moments(&draws(0.0)).1 > 0.05);
    }

    #[test]
    fn random_actions_are_uniform_and_coupled() {
        let (env, _) = crate::env::make("InvertedPendulum-v4").unwrap();
        let moment = Moment {
            obs: &[0.0; 4],
            previous: &[1.0],
            step: 0,
            env: env.as_ref(),
        };
        let mut random = RandomActions {
            coupling: coupling(),
        };
        let rng = &mut stream(1, "exploration");
        let draws: Vec<f32> = (0..20_000).map(|_| random.act(&moment, rng)[0]).collect();
        // 0.7 u + 0.3 p with u uniform in [-2, 2].
        let (mean, deviation) = moments(&draws);
        assert!((mean - 0.3).abs() < 0.02, "{mean}");
        assert!((deviation - 0.7 * 2.0 / 3f64.sqrt()).abs() < 0.01);
        assert!(draws.iter().all(|a| (-1.1 - 1e-6..=1.7 + 1e-6).contains(a)));
    }

    #[test]
    fn a_recording_is_played_step_by_step_and_then_nothing_is_done() {
        let (env, _) = crate::env::make("InvertedPendulum-v4").unwrap();
        let mut playing = Playing {
            actions: vec![vec![0.5], vec![-0.5]],
        };
        let mut act = |step| {
            let moment = Moment {
                obs: &[0.0; 4],
                previous: &[0.0],
                step,
                env: env.as_ref(),
            };
            playing.act(&moment, &mut stream(1, "playing"))
        };
        assert_eq!([act(0), act(1), act(2)], [[0.5], [-0.5], [0.0]]);
    }
}
