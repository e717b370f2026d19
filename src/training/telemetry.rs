//! What evaluations tell of imagination and of the critics, off the hot path: imagined steps measured in
//! the simulator, and values against returns.

use super::Watch;
use crate::agent::{ActorCritic, Agent};
use crate::core::random::Stream;
use crate::env::Inspect;
use crate::nn::ObservationScaling;
use crate::replay::{Batch, Transition};
use crate::task::{Env, EnvState, Step};
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

    /// The place of the next transition after `new` ones that are to be added, if it is chosen; its state is to be
    /// saved then.
    fn place(&mut self, new: usize) -> Option<usize> {
        self.seen += 1;
        let next = self.states.len() + new;
        if next < self.capacity {
            return Some(next);
        }
        if self.capacity == 0 {
            return None;
        }
        let place = self.rng.random_range(0..self.seen);
        (place < self.capacity).then_some(place)
    }

    /// The places of the next `steps` transitions, which are taken side by side, of those that are chosen.
    pub fn places(&mut self, steps: usize) -> Vec<Option<usize>> {
        let mut new = 0;
        let places = (0..steps).map(|_| {
            let place = self.place(new);
            new += usize::from(place.is_some_and(|place| place >= self.states.len()));
            place
        });
        places.collect()
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
    pub env: Box<dyn Inspect>,
}

/// Errors of imagined steps against the simulator, of the rows that the filters keep and of those they drop.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Errors {
    /// Of those that train the critics.
    kept: Sums,
    /// Of the others.
    dropped: Sums,
}

impl Errors {
    /// The figures by the names of their columns; none of rows that there are not.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let named = |sums: &Sums, names: [&'static str; 3]| {
            let means = [sums.state, sums.reward, sums.target].map(|sum| sum / sums.rows as f64);
            let figures = [means[0].sqrt(), means[1], means[2]];
            names.into_iter().zip(figures).take(3 * sums.rows.min(1))
        };
        let kept = ["kept_state_error", "kept_reward_error", "kept_target_error"];
        let dropped = [
            "dropped_state_error",
            "dropped_reward_error",
            "dropped_target_error",
        ];
        named(&self.kept, kept).chain(named(&self.dropped, dropped))
    }
}

/// Sums of errors over rows: squared ones of the next observation in scaled space (a mean over the coordinates that are
/// learned a row),
/// absolute ones of reward and target `y_hat`.
#[derive(Debug, Clone, Default, PartialEq)]
struct Sums {
    rows: usize,
    state: f64,
    reward: f64,
    target: f64,
}

/// Executes in `env` what `agent` imagines in the states of `reservoir`. The errors of the rows that train
/// the critics, and of those that do not; `None` for agents that imagine nothing, or without states.
pub(super) fn measure(
    agent: &Agent,
    reservoir: &mut Reservoir,
    env: &mut dyn Env,
    scaling: &ObservationScaling,
) -> Option<Errors> {
    let rows = reservoir.batch.rows;
    if rows == 0 {
        return None;
    }
    let (so, sa) = (env.spec().obs_size, env.spec().action_size);
    let Agent { core, augment, .. } = agent;
    let probe = augment.probe(core, &reservoir.batch, scaling, &mut reservoir.rng)?;
    // As in `model_error`: what is known would only make the errors of what is learned look smaller.
    let known = augment.learned().map_or(&[][..], |it| it.world.known());
    let learned: Vec<usize> = (0..so).filter(|j| !known.contains(j)).collect();

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
    // The targets had the actions led where the simulator says, under the same noise.
    let values = core.bootstrap(&scaled, &probe.action, &probe.next_noise);
    let y = core.backup(&reward, &ended, &values.value);

    let mut errors = Errors::default();
    for i in (0..rows).filter(|&i| sound[i]) {
        let sums = if probe.kept.contains(&i) {
            &mut errors.kept
        } else {
            &mut errors.dropped
        };
        let error = |j: &usize| f64::from(probe.next_obs[i * so + j] - scaled[i * so + j]);
        let squares = learned.iter().map(|j| error(j).powi(2));
        sums.rows += 1;
        sums.state += squares.sum::<f64>() / learned.len() as f64;
        sums.reward += f64::from(probe.reward[i] - reward[i]).abs();
        sums.target += f64::from(probe.y_hat[i] - y[i]).abs();
    }
    Some(errors)
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

    fn begin(&self, env: &dyn Inspect, observation: &[f64]) -> SeenEpisode {
        SeenEpisode {
            obs: single(observation),
            previous: vec![0.0; env.spec().action_size],
            ..SeenEpisode::default()
        }
    }

    fn step(
        &self,
        seen: &mut SeenEpisode,
        _: &dyn Inspect,
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
    core: &ActorCritic,
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
            f64::from(core.value(last.0, last.1, scaling)[0])
        };
        let mut returns = vec![0.0; steps];
        for t in (0..steps).rev() {
            value = episode.reward[t] + discount * value;
            returns[t] = value;
        }
        let half = steps.div_ceil(2);
        let said = core.q(
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
    use crate::config::{Config, Method};
    use crate::core::random::stream;
    use crate::env;
    use crate::training::assemble::agent_settings;

    #[test]
    fn a_reservoir_is_a_uniform_choice() {
        let mut reservoir = Reservoir::new(10, stream(4, "telemetry"));
        let mut counts = [0; 5];
        for _ in 0..400 {
            for t in 0..100 {
                if let Some(place) = reservoir.places(1)[0] {
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
        let mut env = env::make_inspect("Hopper-v4").unwrap();
        let mut rng = stream(5, "env");
        let mut obs = vec![0.0; 11];
        env.reset(&mut rng, &mut obs);
        let mut reservoir = Reservoir::new(20, stream(5, "telemetry"));
        for t in 0..200 {
            let action = [0.3 * f64::from(t).sin(), 0.2, -0.1];
            let place = reservoir.places(1)[0].map(|place| (place, env.snapshot()));
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
    fn errors_are_means_over_what_is_learned_alone() {
        let config = Config {
            task: "EggHandOver-v0".into(),
            ..Config::preset(Method::Mamf)
        };
        let mut env = crate::training::make_env(&config).unwrap();
        let spec = env.spec().clone();
        let rules = crate::training::make_rules(&config, &spec).unwrap();
        let learned: Vec<usize> = (0..spec.obs_size)
            .filter(|j| !rules.known().contains(j))
            .collect();
        assert!(learned.len() < spec.obs_size, "the goal is known");
        let mut agent = crate::training::fresh_agent(&config, &spec, rules);
        let scaling = ObservationScaling::identity(spec.obs_size);
        let mut obs = vec![0.0; spec.obs_size];
        env.reset(&mut stream(8, "env"), &mut obs);
        let mut reservoir = Reservoir::new(8, stream(8, "telemetry"));
        let zeros = vec![0.0f32; spec.action_size];
        for _ in 0..8 {
            let (place, state, before) = (reservoir.places(1)[0], env.snapshot(), single(&obs));
            let step = env.step(&vec![0.0; spec.action_size], &mut obs);
            let transition = Transition {
                obs: &before,
                action: &zeros,
                reward: step.reward as f32,
                next_obs: &single(&obs),
                terminated: false,
                previous_action: &zeros,
            };
            reservoir.keep(place.unwrap(), state, &transition);
        }
        let Agent { core, augment, .. } = &mut agent;
        let probe = augment
            .probe(core, &reservoir.batch, &scaling, &mut reservoir.rng.clone())
            .unwrap();
        let mut sums = [0.0, 0.0];
        for (i, state) in reservoir.states.iter().enumerate() {
            env.restore(state).unwrap();
            let action = &probe.action[i * spec.action_size..][..spec.action_size];
            let action: Vec<f64> = action.iter().map(|a| f64::from(*a)).collect();
            env.step(&action, &mut obs);
            let error = |j: &usize| {
                f64::from(probe.next_obs[i * spec.obs_size + j] - obs[*j] as f32).powi(2)
            };
            let mean = learned.iter().map(error).sum::<f64>() / learned.len() as f64;
            sums[usize::from(probe.kept.contains(&i))] += mean;
        }
        let errors = measure(&agent, &mut reservoir, env.as_mut(), &scaling).unwrap();
        let found = errors.dropped.state + errors.kept.state;
        assert!(
            (found / (sums[0] + sums[1]) - 1.0).abs() < 1e-9,
            "{found} {sums:?}"
        );
    }

    #[test]
    fn the_bias_is_value_minus_return() {
        let config = Config::preset(Method::Td3);
        let spec = env::make("InvertedPendulum-v4").unwrap().0.spec().clone();
        let core = ActorCritic::new(
            agent_settings(&config, &spec),
            4,
            1,
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
        let q = core.q(
            &episode.obs[..8],
            &episode.previous[..2],
            &episode.action[..2],
            &scaling,
        );
        let said = f64::from(q[0] + q[1]);
        let bias = |episode: &SeenEpisode| {
            let alone = std::slice::from_ref(episode);
            q_bias(&core, alone, 0.5, &scaling).unwrap()
        };
        let returns = (1.0 + 0.5 * (2.0 + 0.5 * 4.0)) + (2.0 + 0.5 * 4.0);
        assert!((bias(&episode) - (said - returns) / 2.0).abs() < 1e-6);
        episode.terminated = false;
        let tail = f64::from(core.value(&episode.obs[12..], &episode.previous[3..], &scaling)[0]);
        let returns = returns + tail * (0.125 + 0.25);
        assert!((bias(&episode) - (said - returns) / 2.0).abs() < 1e-6);
        assert_eq!(q_bias(&core, &[], 0.5, &scaling), None);
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
