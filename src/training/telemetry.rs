//! What evaluations tell of imagination and of the critics, off the hot path: imagined steps measured in
//! the simulator, and values against returns.

use super::Watch;
use crate::agent::{Agent, ImaginationDraws, ModelDraws, Sample};
use crate::env::{Env, EnvState, Replay, Step};
use crate::nn::ObservationScaling;
use crate::random::Stream;
use crate::replay::{Batch, Transition};
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A uniform choice of the transitions since it was last emptied, with the simulator's state before each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Reservoir {
    capacity: usize,
    seen: usize,
    states: Vec<EnvState>,
    batch: Batch,
    rng: Stream,
}

impl Reservoir {
    /// An empty one for `capacity` transitions; `rng` chooses.
    pub fn new(capacity: usize, rng: Stream) -> Reservoir {
        Reservoir {
            capacity,
            seen: 0,
            states: Vec::new(),
            batch: Batch::default(),
            rng,
        }
    }

    /// The place of the next transition, if it is chosen; its state is to be saved then.
    pub fn place(&mut self) -> Option<usize> {
        self.seen += 1;
        if self.states.len() < self.capacity {
            return Some(self.states.len());
        }
        if self.capacity == 0 {
            return None;
        }
        let place = self.rng.random_range(0..self.seen);
        (place < self.capacity).then_some(place)
    }

    /// Keeps a transition that began in `state` at its place.
    pub fn keep(&mut self, place: usize, state: EnvState, transition: &Transition<'_>) {
        if place < self.states.len() {
            self.states[place] = state;
            self.batch.set(place, transition);
        } else {
            self.states.push(state);
            self.batch.push(transition);
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.seen = 0;
        self.states.clear();
        self.batch = Batch::default();
    }
}

/// What imagined steps are measured with.
pub(super) struct Probing {
    /// Where they begin.
    pub reservoir: Reservoir,
    /// Where they are executed.
    pub env: Box<dyn Replay>,
}

/// Errors of imagined steps against the simulator, of the rows that the filters keep or drop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct ImaginedErrors {
    /// Root mean square error of the next observation, in scaled space.
    pub state: Option<f64>,
    /// Mean absolute error of the reward.
    pub reward: Option<f64>,
    /// Mean absolute error of the target `y_hat`.
    pub target: Option<f64>,
}

/// Sums of errors over rows.
#[derive(Default)]
struct Sums {
    rows: usize,
    state: f64,
    reward: f64,
    target: f64,
}

impl Sums {
    fn errors(&self) -> ImaginedErrors {
        let mean = |sum: f64| (self.rows > 0).then(|| sum / self.rows as f64);
        ImaginedErrors {
            state: mean(self.state).map(f64::sqrt),
            reward: mean(self.reward),
            target: mean(self.target),
        }
    }
}

/// Executes in `env` what `agent` imagines in the states of `reservoir`. The errors of the rows that train
/// the critics, and of those that do not; `None` for agents that imagine nothing, or without states.
pub(super) fn measure(
    agent: &Agent,
    reservoir: &mut Reservoir,
    env: &mut dyn Env,
    scaling: &ObservationScaling,
) -> Option<[ImaginedErrors; 2]> {
    let rows = reservoir.batch.rows;
    if rows == 0 {
        return None;
    }
    let (so, sa) = (env.spec().obs_size, env.spec().action_size);
    let batch = reservoir.batch.clone();
    let draws = ModelDraws {
        imagination: Some(ImaginationDraws::draw(rows, sa, &mut reservoir.rng)),
        batch: batch.clone(),
    };
    let sample = Sample {
        model: Some(draws),
        ..Sample::draw(batch, sa, &mut reservoir.rng)
    };
    let probe = agent.probe(&sample, scaling)?;

    let (mut next_obs, mut reward, mut ended) = (Vec::new(), Vec::new(), Vec::new());
    let mut observation = vec![0.0; so];
    let mut sound = Vec::new();
    for (state, action) in reservoir.states.iter().zip(probe.action.chunks_exact(sa)) {
        let command: Vec<f64> = action.iter().map(|a| f64::from(*a)).collect();
        let restored = env.restore(state).is_ok();
        let step = env.step(&command, &mut observation);
        sound.push(restored && !step.diverged);
        next_obs.extend(observation.iter().map(|x| *x as f32));
        reward.push(step.reward as f32);
        ended.push(f32::from(u8::from(step.terminated)));
    }
    let scaled = scaling.scale(&next_obs);
    let y = agent.imaginary_backup(&sample, &probe.action, &scaled, &reward, &ended);

    let [mut kept, mut dropped] = [Sums::default(), Sums::default()];
    for i in (0..rows).filter(|&i| sound[i]) {
        let sums = if probe.kept.rows.contains(&i) {
            &mut kept
        } else {
            &mut dropped
        };
        let pairs = probe.next_obs[i * so..][..so].iter().zip(&scaled[i * so..]);
        let squares = pairs.map(|(a, b)| f64::from(a - b).powi(2));
        sums.rows += 1;
        sums.state += squares.sum::<f64>() / so as f64;
        sums.reward += f64::from(probe.reward[i] - reward[i]).abs();
        sums.target += f64::from(probe.y_hat[i] - y[i]).abs();
    }
    Some([kept.errors(), dropped.errors()])
}

/// Keeps what the critics' values are compared with.
pub(super) struct Returns;

/// An episode as it was seen: one row a step.
#[derive(Default)]
pub(super) struct SeenEpisode {
    obs: Vec<f32>,
    /// The action executed before each observation; zeros at the first.
    previous: Vec<f32>,
    action: Vec<f32>,
    reward: Vec<f64>,
    terminated: bool,
}

impl Watch for Returns {
    type Seen = SeenEpisode;

    fn begin(&self, env: &dyn Replay, observation: &[f64]) -> SeenEpisode {
        SeenEpisode {
            obs: single(observation),
            previous: vec![0.0; env.spec().action_size],
            ..SeenEpisode::default()
        }
    }

    fn step(
        &self,
        seen: &mut SeenEpisode,
        _: &dyn Replay,
        action: &[f64],
        step: &Step,
        observation: &[f64],
    ) {
        if step.diverged {
            return;
        }
        let action = single(action);
        seen.action.extend_from_slice(&action);
        seen.previous.extend(action);
        seen.reward.push(step.reward);
        seen.terminated |= step.terminated;
        seen.obs.extend(single(observation));
    }
}

/// Mean of `Q1(s, a)` minus the discounted return from there, over the first half of each episode. Where an
/// episode is cut, the critic's own value at the cut stands for what would have followed.
pub(super) fn q_bias(
    agent: &Agent,
    episodes: &[SeenEpisode],
    discount: f64,
    scaling: &ObservationScaling,
) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for episode in episodes.iter().filter(|e| !e.reward.is_empty()) {
        let steps = episode.reward.len();
        let (so, sa) = (
            episode.obs.len() / (steps + 1),
            episode.action.len() / steps,
        );
        let mut value = if episode.terminated {
            0.0
        } else {
            let last = (&episode.obs[steps * so..], &episode.previous[steps * sa..]);
            f64::from(agent.value(last.0, last.1, scaling)[0])
        };
        let mut returns = vec![0.0; steps];
        for t in (0..steps).rev() {
            value = episode.reward[t] + discount * value;
            returns[t] = value;
        }
        let half = steps.div_ceil(2);
        let said = agent.q(
            &episode.obs[..half * so],
            &episode.previous[..half * sa],
            &episode.action[..half * sa],
            scaling,
        );
        let errors = said.iter().zip(&returns).map(|(q, g)| f64::from(*q) - g);
        sum += errors.sum::<f64>();
        count += half;
    }
    (count > 0).then(|| sum / count as f64)
}

fn single(numbers: &[f64]) -> Vec<f32> {
    numbers.iter().map(|x| *x as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::Augmentation;
    use crate::config::{Config, Method};
    use crate::env;
    use crate::random::stream;

    #[test]
    fn a_reservoir_is_a_uniform_choice() {
        let mut reservoir = Reservoir::new(10, stream(4, "telemetry"));
        let mut counts = [0; 5];
        for _ in 0..400 {
            for t in 0..100 {
                if let Some(place) = reservoir.place() {
                    let obs = [t as f32];
                    let transition = Transition {
                        obs: &obs,
                        action: &obs,
                        reward: t as f32,
                        next_obs: &obs,
                        terminated: false,
                        previous_action: &obs,
                    };
                    reservoir.keep(place, state(t), &transition);
                }
            }
            assert_eq!((reservoir.states.len(), reservoir.batch.rows), (10, 10));
            for (state, reward) in reservoir.states.iter().zip(&reservoir.batch.reward) {
                assert_eq!(state.elapsed_steps as f32, *reward);
                counts[state.elapsed_steps / 20] += 1;
            }
            reservoir.clear();
        }
        // 4000 kept, 800 expected of each fifth.
        assert!(counts.iter().all(|n| (700..900).contains(n)), "{counts:?}");
    }

    #[test]
    fn kept_states_are_those_before_their_transitions() {
        let mut env = env::make_replay("Hopper-v4").unwrap();
        let mut rng = stream(5, "env");
        let mut obs = vec![0.0; 11];
        env.reset(&mut rng, &mut obs);
        let mut reservoir = Reservoir::new(20, stream(5, "telemetry"));
        for t in 0..200 {
            let action = [0.3 * f64::from(t).sin(), 0.2, -0.1];
            let place = reservoir.place().map(|place| (place, env.snapshot()));
            let before = single(&obs);
            let step = env.step(&action, &mut obs);
            if let Some((place, state)) = place {
                let transition = Transition {
                    obs: &before,
                    action: &single(&action),
                    reward: step.reward as f32,
                    next_obs: &single(&obs),
                    terminated: step.terminated,
                    previous_action: &[0.0; 3],
                };
                reservoir.keep(place, state, &transition);
            }
            if step.terminated {
                env.reset(&mut rng, &mut obs);
            }
        }
        let batch = &reservoir.batch;
        assert_eq!(batch.rows, 20);
        for (i, state) in reservoir.states.iter().enumerate() {
            env.restore(state).unwrap();
            let action: Vec<f64> = batch.action[3 * i..][..3]
                .iter()
                .map(|x| f64::from(*x))
                .collect();
            let step = env.step(&action, &mut obs);
            let error = |found: f64, kept: f32| (found - f64::from(kept)).abs();
            let kept = &batch.next_obs[11 * i..][..11];
            // The action went through single precision.
            assert!(obs.iter().zip(kept).all(|(a, b)| error(*a, *b) < 1e-4));
            assert!(error(step.reward, batch.reward[i]) < 1e-5);
        }
    }

    #[test]
    fn the_bias_is_value_minus_return() {
        let config = Config::preset(Method::Td3);
        let spec = env::make("InvertedPendulum-v4").unwrap().0.spec().clone();
        let agent = Agent::new(
            config.agent(&spec),
            4,
            1,
            Augmentation::None,
            &mut stream(6, "init"),
            &config.compute.backend.device(),
        );
        let scaling = ObservationScaling::identity(4);
        let rows = |n: usize, width: usize| -> Vec<f32> {
            (0..n * width).map(|i| 0.1 * (i as f32).cos()).collect()
        };
        let mut episode = SeenEpisode {
            obs: rows(4, 4),
            previous: rows(4, 1),
            action: rows(3, 1),
            reward: vec![1.0, 2.0, 4.0],
            terminated: true,
        };
        // Two of three steps are compared.
        let q = agent.q(
            &episode.obs[..8],
            &episode.previous[..2],
            &episode.action[..2],
            &scaling,
        );
        let said = f64::from(q[0] + q[1]);
        let bias = |episode: &SeenEpisode| {
            let alone = std::slice::from_ref(episode);
            q_bias(&agent, alone, 0.5, &scaling).unwrap()
        };
        let returns = (1.0 + 0.5 * (2.0 + 0.5 * 4.0)) + (2.0 + 0.5 * 4.0);
        assert!((bias(&episode) - (said - returns) / 2.0).abs() < 1e-6);
        episode.terminated = false;
        let tail = f64::from(agent.value(&episode.obs[12..], &episode.previous[3..], &scaling)[0]);
        let returns = returns + tail * (0.125 + 0.25);
        assert!((bias(&episode) - (said - returns) / 2.0).abs() < 1e-6);
        assert_eq!(q_bias(&agent, &[], 0.5, &scaling), None);
    }

    fn state(elapsed_steps: usize) -> EnvState {
        EnvState {
            time: 0.0,
            qpos: Vec::new(),
            qvel: Vec::new(),
            act: Vec::new(),
            ctrl: Vec::new(),
            qacc_warmstart: Vec::new(),
            carried: Vec::new(),
            goal: Vec::new(),
            elapsed_steps,
        }
    }
}
