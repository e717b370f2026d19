//! What recordings are good for besides beginning in them: their steps, taken again in the simulator, are transitions to
//! learn from, and their states show what the policy makes of them.

use super::assemble::make_env;
use crate::agent::{Agent, Controller, Moment, Recorded};
use crate::config::Config;
use crate::core::random::stream;
use crate::env::Inspect;
use crate::env::MakeError;
use crate::recordings::Demonstrations;
use crate::replay::{ReplayBuffer, Transition};
use crate::task::Start;
use std::sync::Arc;

/// What `demonstrations` add to each batch under `config`, if they do: each recorded action is executed in its state,
/// so that rewards and observations are this simulator's, whatever the recording holds of them. An episode without a
/// recorded goal gets one drawn as if the objects had just settled where it began.
///
/// # Errors
/// When MuJoCo can't run the task.
pub(super) fn recorded(
    config: &Config,
    demonstrations: Option<&Demonstrations>,
) -> Result<Option<Recorded>, MakeError> {
    let share = config.demonstrations.batch_share;
    let Some(demonstrations) = demonstrations.filter(|_| share > 0.0) else {
        return Ok(None);
    };
    let mut env = make_env(config)?;
    let ends = config.exploration.end_when_dropped;
    let mut rng = stream(config.seed, "recorded-goals");
    let (obs_size, action_size) = (env.spec().obs_size, env.spec().action_size);
    let at_rest = vec![0.0; action_size];
    let mut transitions = ReplayBuffer::new(demonstrations.states(), obs_size, action_size);
    let mut attained = Vec::new();
    for (goal, steps) in demonstrations.each() {
        let first = steps.first().map_or(&[][..], |(state, _)| state.first_qpos);
        let goal = match goal {
            Some(goal) => goal.to_vec(),
            None => env.draw_goal(&mut rng, first),
        };
        let mut rewards = Vec::new();
        for (state, action) in steps {
            let start = Start {
                qpos: state.qpos,
                qvel: state.qvel,
                previous_action: state.previous_action,
                goal: &goal,
            };
            let mut before = vec![0.0; obs_size];
            let mut after = vec![0.0; obs_size];
            env.start_at(&start, &mut before);
            let step = env.step(action, &mut after);
            let previous = state.previous_action.unwrap_or(&at_rest);
            let [obs, next_obs, action, previous_action] = [&before, &after, action, previous]
                .map(|numbers| numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>());
            let transition = Transition {
                obs: &obs,
                action: &action,
                reward: step.reward as f32,
                next_obs: &next_obs,
                terminated: step.terminated || ends && step.dropped,
                previous_action: &previous_action,
            };
            if !step.diverged && transition.not_finite().is_none() {
                transitions.push(transition);
                rewards.push(step.reward);
            }
        }
        // Backwards; nothing is known of what came after the last one.
        let mut after = 0.0;
        let mut returns: Vec<f32> = Vec::new();
        for reward in rewards.iter().rev() {
            after = reward + config.discount * after;
            returns.push(after as f32);
        }
        attained.extend(returns.into_iter().rev());
    }
    let bound = config.demonstrations.return_bound.then_some(attained);
    let some = !transitions.is_empty();
    Ok(some.then(|| Recorded::new(transitions, bound, share, config.seed)))
}

/// Has the steps of `more` join what is added to each batch of `agent`.
///
/// # Errors
/// When MuJoCo can't run the task.
pub(super) fn rehearse(
    config: &Config,
    more: &Demonstrations,
    agent: &mut Agent,
) -> Result<(), MakeError> {
    let Some(more) = recorded(config, Some(more))? else {
        return Ok(());
    };
    match &mut agent.recorded {
        Some(recorded) => recorded.add(more),
        none => *none = Some(more),
    }
    Ok(())
}

/// Steps of the phases that [`Following`] tells of, each up to the last one: the first from 1 on.
const PHASES: [(usize, &str); 4] = [
    (5, "recorded_reward_5"),
    (15, "recorded_reward_15"),
    (30, "recorded_reward_30"),
    (60, "recorded_reward_60"),
];

/// What the policy makes of recorded states: the leading indicator where returns from rest say nothing for hours.
pub(super) struct Following {
    env: Box<dyn Inspect>,
    demonstrations: Arc<Demonstrations>,
    states: usize,
}

impl Following {
    /// Of `states` states, spread evenly over the recordings; none without recordings.
    ///
    /// # Errors
    /// When MuJoCo can't run the task.
    pub fn new(
        config: &Config,
        demonstrations: Option<&Arc<Demonstrations>>,
    ) -> Result<Option<Following>, MakeError> {
        let states = config.telemetry.recorded_states;
        let Some(demonstrations) = demonstrations.filter(|_| states > 0) else {
            return Ok(None);
        };
        Ok(Some(Following {
            env: make_env(config)?,
            demonstrations: Arc::clone(demonstrations),
            states,
        }))
    }

    /// Mean reward a step of `controller` in each phase of episodes that begin in the states; episodes that end
    /// before a phase do not count in it. Chance is the same at every call.
    pub fn measure(&mut self, controller: &dyn Controller) -> Vec<(&'static str, f64)> {
        let mut controller = controller.another();
        let mut rng = stream(0, "recorded-states");
        let mut phases = PHASES.map(|_| (0.0, 0.0));
        let spec = self.env.spec().clone();
        let mut observation = vec![0.0; spec.obs_size];
        for (state, goal) in self.demonstrations.spread(self.states) {
            let goal = match goal {
                Some(goal) => goal.to_vec(),
                None => self.env.draw_goal(&mut rng, state.first_qpos),
            };
            let start = Start {
                qpos: state.qpos,
                qvel: state.qvel,
                previous_action: state.previous_action,
                goal: &goal,
            };
            self.env.start_at(&start, &mut observation);
            let mut previous = match state.previous_action {
                Some(action) => action.iter().map(|a| *a as f32).collect(),
                None => vec![0.0; spec.action_size],
            };
            for step in 0..PHASES[PHASES.len() - 1].0 {
                let obs: Vec<f32> = observation.iter().map(|x| *x as f32).collect();
                let moment = Moment {
                    obs: &obs,
                    previous: &previous,
                    step,
                    env: self.env.as_ref(),
                };
                previous = controller.act(&moment, &mut rng);
                let action: Vec<f64> = previous.iter().map(|a| f64::from(*a)).collect();
                let outcome = self.env.step(&action, &mut observation);
                if outcome.diverged {
                    break;
                }
                let phase = PHASES.iter().position(|(last, _)| step < *last);
                if let Some((sum, steps)) = phase.map(|phase| &mut phases[phase]) {
                    *sum += outcome.reward;
                    *steps += 1.0;
                }
                if outcome.terminated || outcome.truncated {
                    break;
                }
            }
        }
        let named = PHASES.iter().zip(phases);
        named
            .filter(|(_, (_, steps))| *steps > 0.0)
            .map(|((_, name), (sum, steps))| (*name, sum / steps))
            .collect()
    }
}
