//! Doubled actions: a wrapper around any task (paper, section 5.5 and figure 3 c).

use std::sync::Arc;

use mujoco_rs::Model;

use super::{Inspect, Recorded};
use crate::core::random::Stream;
use crate::task::{Env, EnvState, Rules, Spec, Start, StateMismatch, Step};

/// A task whose actions are pairs of the wrapped task's: one half acts, the other has no effect, and
/// every `period` steps they change places; an episode begins with the first half.
///
/// A phase bit follows the wrapped task's observation, before the goal: 0 while the first half acts, 1
/// while the second one does.
pub struct Doubled {
    inner: Box<dyn Inspect>,
    spec: Spec,
    period: usize,
    elapsed_steps: usize,
}

/// Where the phase bit is, and what surrounds it.
#[derive(Debug, Clone, Copy)]
struct Layout {
    /// Index of the phase bit: length of the wrapped observation without its goal.
    phase: usize,
    goal_size: usize,
    /// Length of the wrapped task's actions.
    action_size: usize,
}

impl Layout {
    fn of(inner: &Spec) -> Layout {
        Layout {
            phase: inner.obs_size - inner.goal_size,
            goal_size: inner.goal_size,
            action_size: inner.action_size,
        }
    }

    /// Of a task whose sizes are `doubled` already.
    fn within(doubled: &Spec) -> Layout {
        Layout {
            phase: doubled.obs_size - doubled.goal_size - 1,
            goal_size: doubled.goal_size,
            action_size: doubled.action_size / 2,
        }
    }

    /// The half of `action` that acts where the phase is `bit`.
    fn active<T>(&self, action: &[T], second: bool) -> std::ops::Range<usize> {
        debug_assert_eq!(action.len(), 2 * self.action_size);
        let start = if second { self.action_size } else { 0 };
        start..start + self.action_size
    }
}

/// The actions of `inner` doubled, with halves that change places every `period` steps (at least 1).
pub fn doubled(inner: Box<dyn Inspect>, period: usize) -> Box<dyn Inspect> {
    let spec = inner.spec();
    let spec = Spec {
        obs_size: spec.obs_size + 1,
        action_size: 2 * spec.action_size,
        action_ranges: spec.action_ranges.repeat(2),
        ..spec.clone()
    };
    Box::new(Doubled {
        inner,
        spec,
        period: period.max(1),
        elapsed_steps: 0,
    })
}

impl Doubled {
    fn second_acts(&self) -> bool {
        (self.elapsed_steps / self.period) % 2 == 1
    }

    /// Has the wrapped task write its observation, and puts the phase bit into it.
    fn observe<T>(
        &mut self,
        observation: &mut [f64],
        write: impl FnOnce(&mut dyn Inspect, &mut [f64]) -> T,
    ) -> T {
        let layout = Layout::of(self.inner.spec());
        let end = observation.len() - 1;
        let outcome = write(self.inner.as_mut(), &mut observation[..end]);
        observation.copy_within(layout.phase..end, layout.phase + 1);
        observation[layout.phase] = f64::from(u8::from(self.second_acts()));
        outcome
    }
}

impl Env for Doubled {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut Stream, observation: &mut [f64]) {
        self.elapsed_steps = 0;
        self.observe(observation, |inner, obs| inner.reset(rng, obs));
    }

    /// The previous action is of the doubled task; its first half acts before an episode.
    fn start_at(&mut self, start: &Start<'_>, observation: &mut [f64]) {
        self.elapsed_steps = 0;
        let layout = Layout::of(self.inner.spec());
        let start = Start {
            previous_action: start
                .previous_action
                .map(|action| &action[layout.active(action, false)]),
            ..*start
        };
        self.observe(observation, |inner, obs| inner.start_at(&start, obs));
    }

    fn draw_goal(&self, rng: &mut Stream, qpos: &[f64]) -> Vec<f64> {
        self.inner.draw_goal(rng, qpos)
    }

    fn step(&mut self, action: &[f64], observation: &mut [f64]) -> Step {
        let layout = Layout::of(self.inner.spec());
        let active = &action[layout.active(action, self.second_acts())];
        self.elapsed_steps += 1;
        let step = self.observe(observation, |inner, obs| inner.step(active, obs));
        if step.diverged {
            observation.fill(0.0);
        }
        step
    }

    fn snapshot(&self) -> EnvState {
        self.inner.snapshot()
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), StateMismatch> {
        self.inner.restore(state)?;
        self.elapsed_steps = state.elapsed_steps;
        Ok(())
    }
}

impl Inspect for Doubled {
    fn set_state(&mut self, qpos: &[f64], qvel: &[f64]) {
        self.inner.set_state(qpos, qvel);
    }

    fn set_warmstart(&mut self, qacc_warmstart: &[f64]) {
        self.inner.set_warmstart(qacc_warmstart);
    }

    fn settle(&mut self, observation: &mut [f64]) {
        self.elapsed_steps = 0;
        self.observe(observation, |inner, obs| inner.settle(obs));
    }

    fn watch(&mut self, model: Arc<Model>) -> mujoco_rs::Result<()> {
        self.inner.watch(model)
    }

    fn touched(&self) -> bool {
        self.inner.touched()
    }

    fn recorded(&self) -> Recorded {
        self.inner.recorded()
    }

    fn achieved_goal(&self) -> Vec<f64> {
        self.inner.achieved_goal()
    }

    fn shown_qpos(&self) -> Vec<f64> {
        self.inner.shown_qpos()
    }

    fn goal_error(&self, qpos: &[f64], goal: &[f64], settled: bool) -> f64 {
        self.inner.goal_error(qpos, goal, settled)
    }

    fn settling_time(&self) -> f64 {
        self.inner.settling_time()
    }

    fn qpos(&self) -> &[f64] {
        self.inner.qpos()
    }

    fn qvel(&self) -> &[f64] {
        self.inner.qvel()
    }

    fn ctrl(&self) -> &[f64] {
        self.inner.ctrl()
    }
}

/// The rules of a task with doubled actions.
struct DoubledRules {
    inner: Arc<dyn Rules>,
    layout: Layout,
    period: usize,
    known: Vec<usize>,
}

/// The rules of the task `doubled` (see [`doubled`](fn@doubled)), made of `inner`, those of the task in it.
///
/// The phase bit of the next observation is known where it changes every step. With a longer period it
/// depends on the number of steps, which no observation tells, and is left to the model.
pub fn doubled_rules(inner: Arc<dyn Rules>, doubled: &Spec, period: usize) -> Arc<dyn Rules> {
    let layout = Layout::within(doubled);
    let moved = |&i: &usize| if i < layout.phase { i } else { i + 1 };
    let mut known: Vec<usize> = inner.known().iter().map(moved).collect();
    if period == 1 {
        known.push(layout.phase);
        known.sort_unstable();
    }
    Arc::new(DoubledRules {
        inner,
        layout,
        period,
        known,
    })
}

impl DoubledRules {
    /// The wrapped task's observation in `obs`.
    fn inner_obs(&self, obs: &[f32]) -> Vec<f32> {
        let (state, rest) = obs.split_at(self.layout.phase);
        [state, &rest[1..]].concat()
    }

    /// The half of `action` that acts in `obs`; a predicted phase is taken for the nearer bit.
    fn active<'a>(&self, obs: &[f32], action: &'a [f32]) -> &'a [f32] {
        &action[self.layout.active(action, obs[self.layout.phase] > 0.5)]
    }
}

impl Rules for DoubledRules {
    fn reward(&self, obs: &[f32], action: &[f32], next_obs: &[f32]) -> f32 {
        let action = self.active(obs, action);
        if self.layout.goal_size == 0 {
            // The bit is last: nothing need be copied.
            let end = self.layout.phase;
            return self.inner.reward(&obs[..end], action, &next_obs[..end]);
        }
        let (obs, next_obs) = (self.inner_obs(obs), self.inner_obs(next_obs));
        self.inner.reward(&obs, action, &next_obs)
    }

    fn terminated(&self, next_obs: &[f32]) -> bool {
        if self.layout.goal_size == 0 {
            return self.inner.terminated(&next_obs[..self.layout.phase]);
        }
        self.inner.terminated(&self.inner_obs(next_obs))
    }

    fn known(&self) -> &[usize] {
        &self.known
    }

    fn complete(&self, obs: &[f32], action: &[f32], next_obs: &mut [f32]) {
        let phase = self.layout.phase;
        let (before, action) = (self.inner_obs(obs), self.active(obs, action));
        let mut after = self.inner_obs(next_obs);
        self.inner.complete(&before, action, &mut after);
        next_obs[..phase].copy_from_slice(&after[..phase]);
        next_obs[phase + 1..].copy_from_slice(&after[phase..]);
        if self.period == 1 {
            next_obs[phase] = 1.0 - obs[phase].round();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;
    use crate::env;
    use crate::task::VelocityReading;

    fn made(id: &str, period: usize) -> (Box<dyn Inspect>, Box<dyn Inspect>, Arc<dyn Rules>) {
        let plain = env::make_inspect(id).unwrap();
        let rules = env::rules(id, VelocityReading::Mean).unwrap();
        let wrapped = doubled(env::make_inspect(id).unwrap(), period);
        let rules = doubled_rules(rules, wrapped.spec(), period);
        (plain, wrapped, rules)
    }

    #[test]
    fn halves_change_places_and_the_rest_is_the_wrapped_task() {
        for (id, period) in [
            ("HalfCheetah-v4", 3),
            ("Reacher-v4", 1),
            ("EggHandOver-v0", 2),
        ] {
            let (mut plain, mut wrapped, rules) = made(id, period);
            let spec = plain.spec().clone();
            let phase = spec.obs_size - spec.goal_size;
            assert_eq!(wrapped.spec().obs_size, spec.obs_size + 1);
            assert_eq!(wrapped.spec().action_size, 2 * spec.action_size);
            let mut expected = vec![0.0; spec.obs_size];
            let mut found = vec![0.0; spec.obs_size + 1];
            plain.reset(&mut stream(1, "env"), &mut expected);
            wrapped.reset(&mut stream(1, "env"), &mut found);
            for t in 0..10 {
                let second = (t / period) % 2 == 1;
                assert_eq!(found[phase], f64::from(u8::from(second)), "{id} {t}");
                let bare = [&found[..phase], &found[phase + 1..]].concat();
                assert_eq!(bare, expected, "{id} {t}");

                let half = |sign: f64| -> Vec<f64> {
                    let n = spec.action_size;
                    (0..n)
                        .map(|i| sign * 0.5 * ((t + i) as f64).sin())
                        .collect()
                };
                let action = [half(1.0), half(-0.7)].concat();
                let before: Vec<f32> = found.iter().map(|x| *x as f32).collect();
                let said = plain.step(&half(if second { -0.7 } else { 1.0 }), &mut expected);
                let step = wrapped.step(&action, &mut found);
                assert_eq!(step, said, "{id} {t}");

                let after: Vec<f32> = found.iter().map(|x| *x as f32).collect();
                let single: Vec<f32> = action.iter().map(|x| *x as f32).collect();
                let inner = env::rules(id, VelocityReading::Mean).unwrap();
                let without = |row: &[f32]| [&row[..phase], &row[phase + 1..]].concat();
                let active = if second { spec.action_size } else { 0 };
                let active = &single[active..active + spec.action_size];
                let reward = inner.reward(&without(&before), active, &without(&after));
                assert_eq!(rules.reward(&before, &single, &after), reward, "{id} {t}");
                let mut completed = after.clone();
                rules.known().iter().for_each(|&i| completed[i] = 9.0);
                rules.complete(&before, &single, &mut completed);
                assert_eq!(completed, after, "{id} {t}: what is known is right");
                assert_eq!(rules.known().contains(&phase), period == 1);
            }
        }
    }

    /// Where the time limit and a switch coincide, and where they do not, the last observation has the phase of the
    /// step that would follow.
    #[test]
    fn an_episode_is_cut_at_the_edge_of_a_phase() {
        for (period, last) in [(10, 1.0), (25, 0.0), (50, 1.0), (49, 1.0), (51, 0.0)] {
            let (plain, mut wrapped, _) = made("Reacher-v4", period);
            let limit = plain.spec().max_episode_steps;
            assert_eq!(limit, 50);
            let mut obs = vec![0.0; 12];
            for seed in 0..2 {
                wrapped.reset(&mut stream(seed, "env"), &mut obs);
                assert_eq!(obs[11], 0.0, "period {period}");
                for t in 1..=limit {
                    let step = wrapped.step(&[0.1, 0.2, -0.3, 0.4], &mut obs);
                    let at_end = (step.terminated, step.truncated);
                    assert_eq!(at_end, (false, t == limit), "period {period}, step {t}");
                    let phase = f64::from(u8::from((t / period) % 2 == 1));
                    assert_eq!(obs[11], phase, "period {period}, step {t}");
                }
                assert_eq!(obs[11], last, "period {period}");
            }
        }
    }

    #[test]
    fn a_restored_state_keeps_its_phase_and_the_time_limit() {
        let (_, mut wrapped, _) = made("Reacher-v4", 7);
        let mut obs = vec![0.0; 12];
        wrapped.reset(&mut stream(2, "env"), &mut obs);
        let action = [0.1, 0.2, -0.3, 0.4];
        for _ in 0..10 {
            wrapped.step(&action, &mut obs);
        }
        let state = wrapped.snapshot();
        let (_, mut other, _) = made("Reacher-v4", 7);
        other.restore(&state).unwrap();
        let mut elsewhere = vec![0.0; 12];
        for t in 11..=50 {
            let step = wrapped.step(&action, &mut obs);
            assert_eq!(other.step(&action, &mut elsewhere), step);
            assert_eq!(elsewhere, obs);
            assert_eq!(step.truncated, t == 50);
        }
        // A new episode begins with the first half.
        other.reset(&mut stream(3, "env"), &mut elsewhere);
        assert_eq!(elsewhere[11], 0.0);
    }
}
