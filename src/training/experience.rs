//! Where transitions come from: the running episode and, with demonstrations, short segments beside it.

use super::telemetry::Reservoir;
use crate::env::{Env, EnvState, Spec, Start};
use crate::files::Checksum;
use crate::nn::RunningMoments;
use crate::random::Stream;
use crate::replay::{Demonstrations, ReplayBuffer, SegmentStart, Segments, Transition};
use serde::{Deserialize, Serialize};

/// An environment with its running episode.
pub(super) struct Runner {
    pub env: Box<dyn Env>,
    rng: Stream,
    obs: Vec<f32>,
    previous_action: Vec<f32>,
    episode_return: f64,
    length: u64,
}

/// Segments that begin in states of demonstrations or from a reset, in an environment of their own,
/// so that the main episode can go on where it stood.
pub(super) struct Side {
    runner: Runner,
    demonstrations: Demonstrations,
    segments: Segments,
    segment_steps: u64,
    rng: Stream,
    /// Steps left of the running segment.
    left: u64,
    /// Whether the running segment is one of the main episode.
    in_main: bool,
}

/// An environment and its running episode, to go on from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RunnerState {
    env: EnvState,
    rng: Stream,
    obs: Vec<f32>,
    previous_action: Vec<f32>,
    episode_return: f64,
    length: u64,
}

/// The segments, to go on from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SideState {
    runner: RunnerState,
    /// Of the demonstrations that segments begin in.
    demonstrations: Checksum,
    segments: Segments,
    rng: Stream,
    left: u64,
    in_main: bool,
}

/// Where transitions come from, to go on from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct ExperienceState {
    main: RunnerState,
    side: Option<SideState>,
}

/// Where transitions go.
pub(super) struct Sinks<'a> {
    /// What is learned from.
    pub replay: &'a mut ReplayBuffer,
    /// What observations are scaled by.
    pub moments: &'a mut RunningMoments,
    /// What imagined steps are measured with, for agents that imagine.
    pub reservoir: Option<&'a mut Reservoir>,
}

/// The source of a run's transitions.
pub(super) struct Experience {
    pub main: Runner,
    side: Option<Side>,
}

/// A number of a step is not finite in single precision: its name. The step is not stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotFinite(pub &'static str);

/// What one step brought.
#[derive(Debug)]
pub(super) struct Taken {
    /// The reward; none where the simulation blew up.
    pub reward: Option<f64>,
    /// Return and length of the main episode, if it ended.
    pub ended: Option<(f64, u64)>,
}

impl Runner {
    /// An environment whose episodes begin from `rng`; to be reset before use.
    pub fn new(env: Box<dyn Env>, rng: Stream) -> Runner {
        let (obs, action) = (env.spec().obs_size, env.spec().action_size);
        Runner {
            env,
            rng,
            obs: vec![0.0; obs],
            previous_action: vec![0.0; action],
            episode_return: 0.0,
            length: 0,
        }
    }

    /// What it goes on from.
    fn snapshot(&self) -> RunnerState {
        RunnerState {
            env: self.env.snapshot(),
            rng: self.rng.clone(),
            obs: self.obs.clone(),
            previous_action: self.previous_action.clone(),
            episode_return: self.episode_return,
            length: self.length,
        }
    }

    /// Goes on from `state`.
    ///
    /// # Errors
    /// Says so if it is of another task.
    fn restore(&mut self, state: RunnerState) -> Result<(), String> {
        let restored = self.env.restore(&state.env);
        restored.map_err(|mismatch| mismatch.to_string())?;
        let lengths = [state.obs.len(), state.previous_action.len()];
        if lengths != [self.obs.len(), self.previous_action.len()] {
            return Err("the saved observation or action is of another task".to_owned());
        }
        self.rng = state.rng;
        self.obs = state.obs;
        self.previous_action = state.previous_action;
        self.episode_return = state.episode_return;
        self.length = state.length;
        Ok(())
    }

    fn reset(&mut self, moments: &mut RunningMoments) {
        let mut observation = vec![0.0; self.obs.len()];
        self.env.reset(&mut self.rng, &mut observation);
        self.begin(&observation, moments);
        self.previous_action.fill(0.0);
    }

    /// Begins in a random state of the demonstrations, with a goal drawn as if the objects had just
    /// settled where the demonstration began.
    fn start_in(&mut self, demonstrations: &Demonstrations, moments: &mut RunningMoments) {
        let state = demonstrations.draw(&mut self.rng);
        let goal = self.env.draw_goal(&mut self.rng, state.first_qpos);
        let start = Start {
            qpos: state.qpos,
            qvel: state.qvel,
            previous_action: state.previous_action,
            goal: &goal,
        };
        let mut observation = vec![0.0; self.obs.len()];
        self.env.start_at(&start, &mut observation);
        self.begin(&observation, moments);
        match state.previous_action {
            Some(action) => write_single(&mut self.previous_action, action),
            None => self.previous_action.fill(0.0),
        }
    }

    fn begin(&mut self, observation: &[f64], moments: &mut RunningMoments) {
        moments.add(observation);
        write_single(&mut self.obs, observation);
        self.episode_return = 0.0;
        self.length = 0;
    }

    /// Executes `action` and stores the transition unless the simulation blew up; whether the episode
    /// ended, and the reward.
    fn step(
        &mut self,
        action: &[f32],
        sinks: &mut Sinks<'_>,
    ) -> Result<(bool, Option<f64>), NotFinite> {
        // The simulator takes such a command for one of 0, and carries on.
        if action.iter().any(|a| !a.is_finite()) {
            return Err(NotFinite("the action"));
        }
        let place = sinks.reservoir.as_mut().and_then(|r| r.place());
        let kept = place.map(|place| (place, self.env.snapshot()));
        let command: Vec<f64> = action.iter().map(|a| f64::from(*a)).collect();
        let mut observation = vec![0.0; self.obs.len()];
        let outcome = self.env.step(&command, &mut observation);
        let ended = outcome.terminated || outcome.truncated;
        if outcome.diverged {
            return Ok((ended, None));
        }
        let mut next_obs = vec![0.0; self.obs.len()];
        write_single(&mut next_obs, &observation);
        let transition = Transition {
            obs: &self.obs,
            action,
            reward: outcome.reward as f32,
            next_obs: &next_obs,
            terminated: outcome.terminated,
            previous_action: &self.previous_action,
        };
        if let Some(name) = transition.not_finite() {
            return Err(NotFinite(name));
        }
        sinks.moments.add(&observation);
        if let (Some(reservoir), Some((place, state))) = (&mut sinks.reservoir, kept) {
            reservoir.keep(place, state, &transition);
        }
        sinks.replay.push(transition);
        self.obs = next_obs;
        self.previous_action.copy_from_slice(action);
        self.episode_return += outcome.reward;
        self.length += 1;
        Ok((ended, Some(outcome.reward)))
    }

    /// A step after which a new episode begins if this one ended.
    fn step_on(&mut self, action: &[f32], sinks: &mut Sinks<'_>) -> Result<Taken, NotFinite> {
        let (ended, reward) = self.step(action, sinks)?;
        let ended = ended.then_some((self.episode_return, self.length));
        if ended.is_some() {
            self.reset(sinks.moments);
        }
        Ok(Taken { reward, ended })
    }
}

impl Side {
    /// Segments of `segment_steps` steps; `rng` chooses where they begin.
    pub fn new(
        runner: Runner,
        demonstrations: Demonstrations,
        segments: Segments,
        segment_steps: u64,
        rng: Stream,
    ) -> Side {
        Side {
            runner,
            demonstrations,
            segments,
            segment_steps,
            rng,
            left: 0,
            in_main: true,
        }
    }

    /// Begins the next segment.
    fn begin_segment(&mut self, moments: &mut RunningMoments) {
        self.left = self.segment_steps;
        let start = self.segments.draw(&mut self.rng);
        self.in_main = start == SegmentStart::Continue;
        match start {
            SegmentStart::Continue => (),
            SegmentStart::Reset => self.runner.reset(moments),
            SegmentStart::Demonstration => self.runner.start_in(&self.demonstrations, moments),
        }
    }
}

impl Experience {
    /// Plain episodes, or segments where there is a `side`.
    pub fn new(main: Runner, side: Option<Side>) -> Experience {
        Experience { main, side }
    }

    /// What it goes on from.
    pub fn snapshot(&self) -> ExperienceState {
        ExperienceState {
            main: self.main.snapshot(),
            side: self.side.as_ref().map(|side| SideState {
                runner: side.runner.snapshot(),
                demonstrations: side.demonstrations.checksum(),
                segments: side.segments.clone(),
                rng: side.rng.clone(),
                left: side.left,
                in_main: side.in_main,
            }),
        }
    }

    /// Goes on from `state`, with the demonstrations that it was saved with.
    ///
    /// # Errors
    /// Says so if it is of another task, or the demonstrations are others.
    pub fn restore(&mut self, state: ExperienceState) -> Result<(), String> {
        self.main.restore(state.main)?;
        match (&mut self.side, state.side) {
            (None, None) => Ok(()),
            (Some(side), Some(state)) => {
                if side.demonstrations.checksum() != state.demonstrations {
                    return Err("the demonstrations are not those that the run began with".into());
                }
                side.runner.restore(state.runner)?;
                side.segments = state.segments;
                side.rng = state.rng;
                side.left = state.left;
                side.in_main = state.in_main;
                Ok(())
            }
            _ => Err("the run was saved with demonstrations, or without".to_owned()),
        }
    }

    /// Sizes, ranges and limits of the task.
    pub fn spec(&self) -> &Spec {
        self.main.env.spec()
    }

    /// Begins a new main episode, and a new segment.
    pub fn reset(&mut self, moments: &mut RunningMoments) {
        self.main.reset(moments);
        if let Some(side) = &mut self.side {
            side.begin_segment(moments);
        }
    }

    /// Observation and previous executed action on which the next step is to be decided.
    pub fn state(&self) -> (&[f32], &[f32]) {
        let runner = match &self.side {
            Some(side) if !side.in_main => &side.runner,
            _ => &self.main,
        };
        (&runner.obs, &runner.previous_action)
    }

    /// Executes `action` and stores the transition; begins a new episode or segment where one ends. The
    /// end of a segment is no end of anything in what is stored.
    ///
    /// # Errors
    /// When a number is not finite where the simulation did not blow up.
    pub fn step(&mut self, action: &[f32], sinks: &mut Sinks<'_>) -> Result<Taken, NotFinite> {
        let Some(side) = &mut self.side else {
            return self.main.step_on(action, sinks);
        };
        side.left -= 1;
        let taken = if side.in_main {
            self.main.step_on(action, sinks)?
        } else {
            let (ended, reward) = side.runner.step(action, sinks)?;
            if ended {
                side.left = 0;
            }
            Taken {
                reward,
                ended: None,
            }
        };
        if side.left == 0 {
            side.begin_segment(sinks.moments);
        }
        Ok(taken)
    }
}

fn write_single(out: &mut [f32], numbers: &[f64]) {
    for (out, x) in out.iter_mut().zip(numbers) {
        *out = *x as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::env;
    use crate::random::stream;
    use crate::recording::{Recorder, State, Step};
    use crate::replay::{DemonstrationSettings, Sizes};

    const TASK: &str = "Reacher-v4";
    const RECORDED: usize = 30;
    const SEGMENT: u64 = 7;

    fn state<'a>(qpos: &'a [f64], qvel: &'a [f64], obs: &'a [f64], time: f64) -> State<'a> {
        State {
            qpos,
            qvel,
            qacc_warmstart: &[0.0; 4],
            time,
            obs,
            achieved_goal: None,
        }
    }

    /// A trajectory of the task under actions that tell the step they were taken in.
    fn recorded(directory: &std::path::Path) -> Demonstrations {
        let mut env = env::make_replay(TASK).unwrap();
        let mut observation = vec![0.0; env.spec().obs_size];
        env.reset(&mut stream(9, "env"), &mut observation);
        let (qpos, qvel) = (env.qpos().to_vec(), env.qvel().to_vec());
        let mut recorder = Recorder::new(TASK, "a test", &state(&qpos, &qvel, &observation, 0.0));
        for t in 0..RECORDED {
            let action = [0.02 * (t + 1) as f64, 0.0];
            let step = env.step(&action, &mut observation);
            let taken = Step {
                action: &action,
                ctrl: None,
                reward: step.reward,
                terminated: false,
                success: None,
            };
            let after = state(env.qpos(), env.qvel(), &observation, (t + 1) as f64);
            recorder.push(&taken, &after);
        }
        recorder.save(&directory.join("one")).unwrap();
        let sizes = Sizes::of(env.spec());
        Demonstrations::load(directory.to_str().unwrap(), &sizes).unwrap()
    }

    fn experience(demonstrations: Demonstrations, p_d: f64, p_r: f64) -> Experience {
        let settings = DemonstrationSettings {
            probability: p_d,
            reset_probability: p_r,
            decay: 1.0,
            ..DemonstrationSettings::default()
        };
        let runner = |name| Runner::new(env::make(TASK).unwrap().0, stream(1, name));
        let side = Side::new(
            runner("segment-env"),
            demonstrations,
            Segments::new(&settings),
            SEGMENT,
            stream(1, "segments"),
        );
        Experience::new(runner("env"), Some(side))
    }

    /// Steps of zero action, and of each: whether it was one of the main episode, the observation and
    /// previous action it was taken on, and whether it ended the main episode.
    fn run(experience: &mut Experience, steps: usize) -> Vec<(bool, Vec<f32>, Vec<f32>, bool)> {
        let mut replay = ReplayBuffer::new(steps, 11, 2);
        let mut moments = RunningMoments::new(11);
        experience.reset(&mut moments);
        let taken = (0..steps).map(|_| {
            let (obs, previous) = experience.state();
            let (obs, previous) = (obs.to_vec(), previous.to_vec());
            let main = experience.side.as_ref().is_none_or(|side| side.in_main);
            let mut sinks = Sinks {
                replay: &mut replay,
                moments: &mut moments,
                reservoir: None,
            };
            let taken = experience.step(&[0.0; 2], &mut sinks).unwrap();
            (main, obs, previous, taken.ended.is_some())
        });
        let taken = taken.collect();
        assert_eq!(replay.len(), steps);
        let stored = replay.newest(steps);
        assert!(stored.terminated.iter().all(|d| *d == 0.0));
        taken
    }

    #[test]
    fn segments_begin_in_recorded_states_after_the_recorded_action() {
        let directory = tempfile::tempdir().unwrap();
        let mut experience = experience(recorded(directory.path()), 1.0, 0.0);
        let mut seen = std::collections::BTreeSet::new();
        for (t, (main, _, previous, _)) in run(&mut experience, 700).into_iter().enumerate() {
            assert!(!main);
            if !(t as u64).is_multiple_of(SEGMENT) {
                assert_eq!(previous, [0.0, 0.0], "the action executed in the segment");
                continue;
            }
            let step = (previous[0] / 0.02).round() as usize;
            assert!((previous[0] - 0.02 * step as f32).abs() < 1e-6 && step < RECORDED);
            seen.insert(step);
        }
        assert!(seen.len() > 20 && seen.contains(&0), "{seen:?}");
    }

    #[test]
    fn the_main_episode_goes_on_where_it_stood() {
        let directory = tempfile::tempdir().unwrap();
        let demonstrations = recorded(directory.path());
        let mixed = run(&mut experience(demonstrations, 0.4, 0.3), 2000);
        // The same main environment alone, from the same stream.
        let runner = Runner::new(env::make(TASK).unwrap().0, stream(1, "env"));
        let main: Vec<_> = mixed.iter().filter(|taken| taken.0).collect();
        let alone = run(&mut Experience::new(runner, None), main.len());
        assert!(main.len() > 400 && main.len() < 800, "{}", main.len());
        for (mixed, alone) in main.into_iter().zip(&alone) {
            assert_eq!(mixed, alone);
        }
        // Whole segments, but for the ends of main episodes, which are no ends of segments.
        for segment in mixed.chunks(SEGMENT as usize) {
            assert!(segment.iter().all(|taken| taken.0 == segment[0].0));
        }
    }

    #[test]
    fn a_segment_of_a_goal_task_has_a_goal_drawn_afresh() {
        let id = "EggHandOver-v0";
        let fixture = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/tests/fixtures/rollouts/EggHandOver.npz"
        );
        let recording = crate::recording::Recording::open(fixture.as_ref()).unwrap();
        let checked = env::make_replay(id).unwrap();
        let sizes = Sizes::of(checked.spec());
        let demonstrations = Demonstrations::load(fixture, &sizes).unwrap();
        let mut runner = Runner::new(env::make(id).unwrap().0, stream(2, "segment-env"));
        let mut moments = RunningMoments::new(116);
        let recorded = recording.obs.as_ref().unwrap();
        let first = recording.qpos.get(0).unwrap();
        let mut goals: Vec<Vec<f32>> = Vec::new();
        for _ in 0..20 {
            runner.start_in(&demonstrations, &mut moments);
            let (state, goal) = runner.obs.split_at(109);
            let near = |row: &[f64]| {
                let pairs = row.iter().zip(state);
                pairs.fold(0.0f64, |m, (a, b)| m.max((a - f64::from(*b)).abs())) < 1e-5
            };
            let t = (0..14).find(|&t| near(recorded.get(t).unwrap()));
            let t = t.expect("the state of some row");
            let previous = t.checked_sub(1).and_then(|t| recording.action.get(t));
            let expected = previous.map_or(0.0, |action| action[7] as f32);
            assert!((runner.previous_action[7] - expected).abs() < 1e-6);
            let wide: Vec<f64> = goal.iter().map(|x| f64::from(*x)).collect();
            assert!(checked.goal_error(first, &wide, true) < 1e-6, "{wide:?}");
            assert!(!goals.contains(&goal.to_vec()), "drawn anew each time");
            goals.push(goal.to_vec());
        }
    }
}
