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

    /// What the simulator adds to both numbers of a state in a step, whatever is done, and what it pays besides the
    /// action.
    const MOVES: f64 = 1.0;
    const PAYS: f64 = 2.0;

    /// A world that can be written down: it ends where the first number passes 50, and blows up where it passes 90.
    struct Simple {
        spec: crate::task::Spec,
        state: [f64; 2],
    }

    impl Simple {
        fn new() -> Simple {
            let pendulum = env::make("InvertedPendulum-v4").unwrap().0;
            let spec = crate::task::Spec {
                obs_size: 2,
                ..pendulum.spec().clone()
            };
            Simple {
                spec,
                state: [0.0; 2],
            }
        }
    }

    impl Env for Simple {
        fn spec(&self) -> &crate::task::Spec {
            &self.spec
        }

        fn step(&mut self, action: &[f64], observation: &mut [f64]) -> Step {
            self.state.iter_mut().for_each(|x| *x += MOVES);
            observation.copy_from_slice(&self.state);
            let diverged = self.state[0] > 90.0;
            Step {
                reward: PAYS + action[0],
                terminated: self.state[0] > 50.0,
                truncated: diverged,
                diverged,
                buffer_full: false,
                dropped: false,
                success: None,
            }
        }

        fn restore(&mut self, state: &EnvState) -> Result<(), crate::task::StateMismatch> {
            self.state.copy_from_slice(&state.qpos);
            Ok(())
        }

        fn reset(&mut self, _: &mut Stream, _: &mut [f64]) {
            unreachable!("imagined steps begin in states that were kept")
        }

        fn start_at(&mut self, _: &crate::task::Start<'_>, _: &mut [f64]) {
            unreachable!("there are no demonstrations")
        }

        fn draw_goal(&self, _: &mut Stream, _: &[f64]) -> Vec<f64> {
            unreachable!("the task has no goal")
        }

        fn snapshot(&self) -> EnvState {
            unreachable!("nothing is kept")
        }
    }

    /// Rules of it that pay a quarter too much and never end.
    struct Generous;

    const TOO_MUCH: f32 = 0.25;

    impl crate::task::Rules for Generous {
        fn reward(&self, _: &[f32], action: &[f32], _: &[f32]) -> f32 {
            PAYS as f32 + TOO_MUCH + action[0]
        }

        fn terminated(&self, _: &[f32]) -> bool {
            false
        }
    }

    /// An agent whose critics say `worth` of everything, and whose model is wrong by `errors` in scaled space, wherever
    /// it is asked. It keeps the imagined steps whose targets are not below the real ones.
    fn wrong_agent(worth: f32, errors: [f32; 2], scaling: &ObservationScaling) -> Agent {
        let mut config = Config::preset(Method::Mamf);
        (config.networks.hidden, config.model.hidden) = (vec![1], vec![1]);
        (config.action_coupling, config.discount) = (1.0, 0.5);
        config.imagination.uncertainty_filter = false;
        config.model.predict = crate::model::Predict::Delta;
        let (mut spec, device) = (Simple::new().spec, config.compute.backend.device());
        spec.obs_size = 2;
        let mut arrays = crate::nn::Weights::default();
        let mut layers = |name: &str, inputs: usize, last: &[f32]| {
            let mut insert = |part: &str, numbers: Vec<f32>, shape: &[usize]| {
                let data = burn::tensor::TensorData::new(numbers, shape);
                arrays.insert(format!("{name}.{part}"), data);
            };
            insert("l1.weight", vec![0.0; inputs], &[inputs, 1]);
            insert("l1.bias", vec![0.0], &[1]);
            insert("l2.weight", vec![0.0; last.len()], &[1, last.len()]);
            insert("l2.bias", last.to_vec(), &[last.len()]);
        };
        for prefix in ["", "target_"] {
            layers(&format!("{prefix}actor"), 2, &[0.0]);
            layers(&format!("{prefix}critic1"), 3, &[worth]);
            layers(&format!("{prefix}critic2"), 3, &[worth]);
        }
        // The scaled length of the simulator's move, and the error.
        let [origin, moved] = [[0.0; 2], [MOVES as f32; 2]].map(|s| scaling.scale(&s));
        let said = [0, 1].map(|j| moved[j] - origin[j] + errors[j]);
        layers("model", 3, &said);

        let settings = agent_settings(&config, &spec);
        let core = ActorCritic::load(settings, 2, 1, &arrays, &device).unwrap();
        let shape = crate::model::DynamicsShape {
            obs_size: 2,
            action_size: 1,
            known: &[],
            learns_reward: false,
        };
        let model = crate::model::DynamicsModel::load(&config.model, shape, &arrays, &device);
        let world = crate::model::World::new(model.unwrap(), std::sync::Arc::new(Generous));
        let ranges = &spec.action_ranges;
        let augment =
            crate::agent::augment::Imagination::new(&config.imagination, ranges, world, 1);
        Agent::new(core, Box::new(augment), 1)
    }

    /// Transitions of `Simple` from states whose first numbers these are, with rewards that their targets are made of.
    fn kept_in(states: &[(f64, f32)]) -> Reservoir {
        let mut reservoir = Reservoir::new(states.len(), stream(2, "telemetry"));
        for (x, reward) in states {
            let place = reservoir.places(1)[0].unwrap();
            let obs = [*x as f32, 0.0];
            let transition = Transition {
                obs: &obs,
                action: &[0.0],
                reward: *reward,
                next_obs: &obs,
                terminated: false,
                previous_action: &[0.0],
            };
            let before = EnvState {
                qpos: vec![*x, 0.0],
                ..state(0)
            };
            reservoir.keep(place, before, &transition);
        }
        reservoir
    }

    #[test]
    fn known_errors_of_a_world_are_found_to_the_number() {
        // Wide enough that nothing is clipped.
        let scaling = ObservationScaling::new(vec![1.0, -2.0], vec![4.0, 0.5], 100.0);
        let (worth, errors) = (8.0, [0.3, -0.4]);
        let agent = wrong_agent(worth, errors, &scaling);
        // High rewards make targets that no imagined step reaches. The last state is one that blows up.
        let (low, high) = (-1000.0, 1000.0);
        let states = [
            (1.0, low),
            (2.0, high),
            (60.0, high),
            (3.0, low),
            (95.0, low),
        ];
        let mut reservoir = kept_in(&states);
        let found = measure(&agent, &mut reservoir, &mut Simple::new(), &scaling).unwrap();
        assert_eq!((found.kept.rows, found.dropped.rows), (2, 2));
        let named: Vec<(&str, f64)> = found.named().collect();
        let state = f64::from((0.3f32.powi(2) + 0.4f32.powi(2)) / 2.0).sqrt();
        let reward = f64::from(TOO_MUCH);
        // One of the dropped steps ends in the simulator alone: gamma times the value is missing in its target.
        let expected = [
            ("kept_state_error", state),
            ("kept_reward_error", reward),
            ("kept_target_error", reward),
            ("dropped_state_error", state),
            ("dropped_reward_error", reward),
            ("dropped_target_error", reward + 0.5 * 8.0 / 2.0),
        ];
        assert_eq!(named.len(), expected.len());
        for ((name, found), (wanted, figure)) in named.into_iter().zip(expected) {
            assert_eq!(name, wanted);
            assert!((found - figure).abs() < 1e-5, "{name}: {found} {figure}");
        }
    }

    #[test]
    fn figures_of_rows_that_there_are_not_are_left_out() {
        let scaling = ObservationScaling::identity(2);
        let agent = wrong_agent(0.0, [0.0; 2], &scaling);
        let measured = |states: &[(f64, f32)]| {
            let mut reservoir = kept_in(states);
            let env = &mut Simple::new();
            let errors = measure(&agent, &mut reservoir, env, &scaling);
            errors.map(|errors| errors.named().map(|(name, _)| name).collect::<Vec<_>>())
        };
        assert_eq!(measured(&[]), None);
        let kept = ["kept_state_error", "kept_reward_error", "kept_target_error"];
        assert_eq!(measured(&[(0.0, -1000.0)]).unwrap(), kept);
        let dropped = kept.map(|name| name.replace("kept", "dropped"));
        assert_eq!(measured(&[(0.0, 1000.0)]).unwrap(), dropped);
        assert_eq!(measured(&[(95.0, 0.0)]).unwrap(), Vec::<&str>::new());
    }

    #[test]
    fn an_agent_that_imagines_nothing_has_nothing_to_measure() {
        let scaling = ObservationScaling::identity(2);
        let mut agent = wrong_agent(0.0, [0.0; 2], &scaling);
        agent.augment = Box::new(crate::agent::augment::Plain);
        let errors = measure(
            &agent,
            &mut kept_in(&[(0.0, 0.0)]),
            &mut Simple::new(),
            &scaling,
        );
        assert_eq!(errors, None);
    }

    #[test]
    fn the_bias_is_a_mean_over_steps_not_over_episodes() {
        let scaling = ObservationScaling::identity(2);
        // Everything is worth 8.
        let agent = wrong_agent(8.0, [0.0; 2], &scaling);
        let episode = |reward: &[f64]| SeenEpisode {
            obs: vec![0.0; 2 * (reward.len() + 1)],
            previous: vec![0.0; reward.len() + 1],
            action: vec![0.0; reward.len()],
            reward: reward.to_vec(),
            terminated: true,
        };
        // Returns of 1 and, in the first two of four steps, of 4.25 and 2.5; the last has no step to speak of.
        let episodes = [
            episode(&[1.0]),
            episode(&[3.0, 1.0, 2.0, 2.0]),
            episode(&[]),
        ];
        let expected = (8.0 - 1.0 + 8.0 - 4.25 + 8.0 - 2.5) / 3.0;
        let found = q_bias(&agent.core, &episodes, 0.5, &scaling).unwrap();
        assert!((found - expected).abs() < 1e-6, "{found}");
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
