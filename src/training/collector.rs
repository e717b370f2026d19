//! Where transitions come from: environments stepped side by side, each with its running episode and, with
//! demonstrations, short segments beside it.

use super::segments::{SegmentStart, Segments};
use super::telemetry::Reservoir;
use crate::agent::{Controller, Moment};
use crate::core::files::Checksum;
use crate::core::parallel::join;
use crate::core::random::Stream;
use crate::nn::RunningMoments;
use crate::recordings::Demonstrations;
use crate::replay::{ReplayBuffer, Sampler, Transition};
use crate::task::{Env, EnvState, Spec, Start};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// An environment with its running episode.
pub(super) struct Episode {
    pub env: Box<dyn Env>,
    rng: Stream,
    obs: Vec<f32>,
    previous_action: Vec<f32>,
    episode_return: f64,
    length: u64,
    /// Whether it ends, as if the task did, where an object is dropped.
    end_when_dropped: bool,
}

/// Segments that begin in states of demonstrations or from a reset, in an environment of their own,
/// so that the main episode can go on where it stood.
pub(super) struct Side {
    episode: Episode,
    demonstrations: Arc<Demonstrations>,
    segments: Segments,
    segment_steps: u64,
    rng: Stream,
    /// Steps left of the running segment.
    left: u64,
    /// Whether the running segment is one of the main episode.
    in_main: bool,
}

/// One source of transitions: an environment, what is beside it, and the noise of what acts there.
pub(super) struct Source {
    pub main: Episode,
    side: Option<Side>,
    exploration: Stream,
}

/// All sources of a run, which take a step each in a round.
pub(super) struct Collector {
    pub sources: Vec<Source>,
}

/// An environment and its running episode, to go on from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct EpisodeState {
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
    episode: EpisodeState,
    /// Of the demonstrations that segments begin in.
    demonstrations: Checksum,
    segments: Segments,
    rng: Stream,
    left: u64,
    in_main: bool,
}

/// One source, to go on from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct SourceState {
    main: EpisodeState,
    side: Option<SideState>,
    exploration: Stream,
}

/// Where transitions come from, to go on from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct CollectorState {
    sources: Vec<SourceState>,
}

/// Where transitions go.
pub(super) struct Sinks<'a> {
    /// What is learned from.
    pub replay: &'a mut ReplayBuffer,
    /// Who chooses from it.
    pub sampler: &'a mut dyn Sampler,
    /// What observations are scaled by.
    pub moments: &'a mut RunningMoments,
    /// What imagined steps are measured with, for agents that imagine.
    pub reservoir: Option<&'a mut Reservoir>,
}

/// A number of a step is not finite in single precision: its name. The step is not stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotFinite(pub &'static str);

/// What one step of a source brought.
#[derive(Debug)]
pub(super) struct Taken {
    /// The reward; none where the simulation blew up.
    pub reward: Option<f64>,
    /// Whether a buffer of the simulator was full.
    pub buffer_full: bool,
    /// Return and length of the main episode, if it ended.
    pub ended: Option<(f64, u64)>,
}

/// A step that was taken and is still to be stored.
struct Step {
    /// None where the simulation blew up.
    row: Option<Row>,
    buffer_full: bool,
    /// Where the reservoir keeps it, and the state before it.
    kept: Option<(usize, EnvState)>,
    ended: Option<(f64, u64)>,
    /// The first observations of what began after the step.
    began: Vec<Vec<f64>>,
}

/// What a step of an episode brought.
struct Happened {
    /// The episode is over.
    ended: bool,
    buffer_full: bool,
    /// None where the simulation blew up.
    row: Option<Row>,
}

/// A transition of its own.
struct Row {
    obs: Vec<f32>,
    action: Vec<f32>,
    reward: f64,
    next_obs: Vec<f32>,
    terminated: bool,
    previous_action: Vec<f32>,
    /// The next observation in double precision.
    observation: Vec<f64>,
}

impl Row {
    fn transition(&self) -> Transition<'_> {
        Transition {
            obs: &self.obs,
            action: &self.action,
            reward: self.reward as f32,
            next_obs: &self.next_obs,
            terminated: self.terminated,
            previous_action: &self.previous_action,
        }
    }
}

impl CollectorState {
    /// Of the demonstrations that segments begin in.
    pub fn demonstrations(&self) -> Option<Checksum> {
        let first = self.sources.first()?;
        first.side.as_ref().map(|side| side.demonstrations)
    }
}

impl Episode {
    /// An environment whose episodes begin from `rng`, and end with the task or, if they `end_when_dropped`, where an
    /// object falls past the hands; to be reset before use.
    pub fn new(env: Box<dyn Env>, rng: Stream, end_when_dropped: bool) -> Episode {
        let (obs, action) = (env.spec().obs_size, env.spec().action_size);
        Episode {
            env,
            rng,
            obs: vec![0.0; obs],
            previous_action: vec![0.0; action],
            episode_return: 0.0,
            length: 0,
            end_when_dropped,
        }
    }

    fn snapshot(&self) -> EpisodeState {
        EpisodeState {
            env: self.env.snapshot(),
            rng: self.rng.clone(),
            obs: self.obs.clone(),
            previous_action: self.previous_action.clone(),
            episode_return: self.episode_return,
            length: self.length,
        }
    }

    fn restore(&mut self, state: EpisodeState) -> Result<(), String> {
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

    /// Begins a new episode; its first observation.
    fn reset(&mut self) -> Vec<f64> {
        let mut observation = vec![0.0; self.obs.len()];
        self.env.reset(&mut self.rng, &mut observation);
        self.begin(&observation);
        self.previous_action.fill(0.0);
        observation
    }

    /// Begins in a random state of the demonstrations, with a goal drawn as if the objects had just
    /// settled where the demonstration began; the first observation.
    fn start_in(&mut self, demonstrations: &Demonstrations) -> Vec<f64> {
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
        self.begin(&observation);
        match state.previous_action {
            Some(action) => write_single(&mut self.previous_action, action),
            None => self.previous_action.fill(0.0),
        }
        observation
    }

    fn begin(&mut self, observation: &[f64]) {
        write_single(&mut self.obs, observation);
        self.episode_return = 0.0;
        self.length = 0;
    }

    /// Executes what `controller` does.
    fn step(
        &mut self,
        controller: &mut dyn Controller,
        rng: &mut Stream,
    ) -> Result<Happened, NotFinite> {
        let moment = Moment {
            obs: &self.obs,
            previous: &self.previous_action,
            step: self.length as usize,
            env: self.env.as_ref(),
        };
        let action = controller.act(&moment, rng);
        // The simulator takes such a command for one of 0, and carries on.
        if action.iter().any(|a| !a.is_finite()) {
            return Err(NotFinite("the action"));
        }
        let command: Vec<f64> = action.iter().map(|a| f64::from(*a)).collect();
        let mut observation = vec![0.0; self.obs.len()];
        let outcome = self.env.step(&command, &mut observation);
        let terminated = outcome.terminated || self.end_when_dropped && outcome.dropped;
        let mut happened = Happened {
            ended: terminated || outcome.truncated,
            buffer_full: outcome.buffer_full,
            row: None,
        };
        if outcome.diverged {
            return Ok(happened);
        }
        let mut next_obs = vec![0.0; self.obs.len()];
        write_single(&mut next_obs, &observation);
        let row = Row {
            obs: std::mem::replace(&mut self.obs, next_obs.clone()),
            previous_action: std::mem::replace(&mut self.previous_action, action.clone()),
            action,
            reward: outcome.reward,
            next_obs,
            terminated,
            observation,
        };
        if let Some(name) = row.transition().not_finite() {
            return Err(NotFinite(name));
        }
        self.episode_return += outcome.reward;
        self.length += 1;
        happened.row = Some(row);
        Ok(happened)
    }
}

impl Side {
    /// Segments of `segment_steps` steps; `rng` chooses where they begin.
    pub fn new(
        episode: Episode,
        demonstrations: Arc<Demonstrations>,
        segments: Segments,
        segment_steps: u64,
        rng: Stream,
    ) -> Side {
        Side {
            episode,
            demonstrations,
            segments,
            segment_steps,
            rng,
            left: 0,
            in_main: true,
        }
    }

    /// Begins the next segment; its first observation unless the main episode goes on.
    fn begin_segment(&mut self) -> Option<Vec<f64>> {
        self.left = self.segment_steps;
        let start = self.segments.draw(&mut self.rng);
        self.in_main = start == SegmentStart::Continue;
        match start {
            SegmentStart::Continue => None,
            SegmentStart::Demonstration if !self.demonstrations.is_empty() => {
                Some(self.episode.start_in(&self.demonstrations))
            }
            SegmentStart::Demonstration | SegmentStart::Reset => Some(self.episode.reset()),
        }
    }
}

impl Source {
    /// Plain episodes, or segments where there is a `side`; what acts draws from `exploration`.
    pub fn new(main: Episode, side: Option<Side>, exploration: Stream) -> Source {
        Source {
            main,
            side,
            exploration,
        }
    }

    fn snapshot(&self) -> SourceState {
        SourceState {
            main: self.main.snapshot(),
            side: self.side.as_ref().map(|side| SideState {
                episode: side.episode.snapshot(),
                demonstrations: side.demonstrations.checksum(),
                segments: side.segments.clone(),
                rng: side.rng.clone(),
                left: side.left,
                in_main: side.in_main,
            }),
            exploration: self.exploration.clone(),
        }
    }

    fn restore(&mut self, state: SourceState) -> Result<(), String> {
        self.main.restore(state.main)?;
        self.exploration = state.exploration;
        match (&mut self.side, state.side) {
            (None, None) => Ok(()),
            (Some(side), Some(state)) => {
                side.episode.restore(state.episode)?;
                side.segments = state.segments;
                side.rng = state.rng;
                side.left = state.left;
                side.in_main = state.in_main;
                Ok(())
            }
            _ => Err("the run was saved with demonstrations, or without".to_owned()),
        }
    }

    /// The episode in which the next step is taken.
    fn current(&self) -> &Episode {
        match &self.side {
            Some(side) if !side.in_main => &side.episode,
            _ => &self.main,
        }
    }

    /// Takes a step of what `controller` does; begins a new episode or segment where one ends. The end of a segment
    /// is no end of anything in what is stored. `place` is where the reservoir wants to keep the step.
    fn step(
        &mut self,
        controller: &mut dyn Controller,
        place: Option<usize>,
    ) -> Result<Step, NotFinite> {
        let kept = place.map(|place| (place, self.current().env.snapshot()));
        let rng = &mut self.exploration;
        let mut began = Vec::new();
        let mut main_ended = None;
        let happened = match &mut self.side {
            Some(side) if !side.in_main => {
                side.left -= 1;
                let happened = side.episode.step(controller, rng)?;
                if happened.ended {
                    side.left = 0;
                }
                happened
            }
            side => {
                if let Some(side) = side {
                    side.left -= 1;
                }
                let happened = self.main.step(controller, rng)?;
                if happened.ended {
                    main_ended = Some((self.main.episode_return, self.main.length));
                    began.push(self.main.reset());
                }
                happened
            }
        };
        if let Some(side) = self.side.as_mut().filter(|side| side.left == 0) {
            began.extend(side.begin_segment());
        }
        Ok(Step {
            row: happened.row,
            buffer_full: happened.buffer_full,
            kept,
            ended: main_ended,
            began,
        })
    }
}

impl Step {
    /// Puts it where transitions go.
    fn store(self, sinks: &mut Sinks<'_>) -> Taken {
        if let Some(row) = &self.row {
            sinks.moments.add(&row.observation);
            if let (Some(reservoir), Some((place, state))) = (&mut sinks.reservoir, self.kept) {
                reservoir.keep(place, state, &row.transition());
            }
            let index = sinks.replay.push(row.transition());
            sinks.sampler.stored(index);
        }
        for observation in &self.began {
            sinks.moments.add(observation);
        }
        Taken {
            reward: self.row.map(|row| row.reward),
            buffer_full: self.buffer_full,
            ended: self.ended,
        }
    }
}

impl Collector {
    /// A collector of these sources, at least one.
    pub fn new(sources: Vec<Source>) -> Collector {
        Collector { sources }
    }

    /// What it goes on from.
    pub fn snapshot(&self) -> CollectorState {
        CollectorState {
            sources: self.sources.iter().map(Source::snapshot).collect(),
        }
    }

    /// Goes on from `state`, with the demonstrations that it was saved with.
    ///
    /// # Errors
    /// Says so if it is of another task or of another number of environments.
    pub fn restore(&mut self, state: CollectorState) -> Result<(), String> {
        let (saved, here) = (state.sources.len(), self.sources.len());
        if saved != here {
            return Err(format!("it is of {saved} environments, not {here}"));
        }
        let mut pairs = self.sources.iter_mut().zip(state.sources);
        pairs.try_for_each(|(source, state)| source.restore(state))
    }

    /// Sizes, ranges and limits of the task.
    pub fn spec(&self) -> &Spec {
        self.sources[0].main.env.spec()
    }

    /// Has segments begin in states of `demonstrations` from the next one on.
    pub fn set_demonstrations(&mut self, demonstrations: &Arc<Demonstrations>) {
        for side in self.sources.iter_mut().filter_map(|s| s.side.as_mut()) {
            side.demonstrations = Arc::clone(demonstrations);
        }
    }

    /// Begins a new main episode, and a new segment, of every source.
    pub fn reset(&mut self, moments: &mut RunningMoments) {
        for source in &mut self.sources {
            moments.add(&source.main.reset());
            let began = source.side.as_mut().and_then(Side::begin_segment);
            began
                .iter()
                .for_each(|observation| moments.add(observation));
        }
    }

    /// A step of the first sources, one for each of `controllers`, on two threads where there are two; what they
    /// bring is stored in the order of the sources, whichever came first.
    ///
    /// # Errors
    /// When a number is not finite where the simulation did not blow up: which source's. Nothing is stored then.
    pub fn round(
        &mut self,
        controllers: &mut [Box<dyn Controller>],
        sinks: &mut Sinks<'_>,
    ) -> Result<Vec<Taken>, (usize, NotFinite)> {
        let places: Vec<Option<usize>> = match &mut sinks.reservoir {
            Some(reservoir) => reservoir.places(controllers.len()),
            None => vec![None; controllers.len()],
        };
        let sources = &mut self.sources[..controllers.len()];
        let steps = if let ([source], [controller]) = (&mut *sources, &mut *controllers) {
            vec![source.step(controller.as_mut(), places[0])]
        } else {
            let middle = sources.len() / 2;
            let (first, second) = sources.split_at_mut(middle);
            let (acting, too) = controllers.split_at_mut(middle);
            let (at, there) = places.split_at(middle);
            let (mut steps, others) = join(
                || step_each(first, acting, at),
                || step_each(second, too, there),
            );
            steps.extend(others);
            steps
        };
        let numbered = steps.into_iter().enumerate();
        let steps = numbered.map(|(i, step)| step.map_err(|wrong| (i, wrong)));
        let steps = steps.collect::<Result<Vec<Step>, _>>()?;
        Ok(steps.into_iter().map(|step| step.store(sinks)).collect())
    }
}

fn step_each(
    sources: &mut [Source],
    controllers: &mut [Box<dyn Controller>],
    places: &[Option<usize>],
) -> Vec<Result<Step, NotFinite>> {
    let each = sources.iter_mut().zip(controllers).zip(places);
    each.map(|((source, controller), place)| source.step(controller.as_mut(), *place))
        .collect()
}

fn write_single(out: &mut [f32], numbers: &[f64]) {
    for (out, x) in out.iter_mut().zip(numbers) {
        *out = *x as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::Zero;
    use crate::config::DemonstrationSettings;
    use crate::core::random::stream;
    use crate::env;
    use crate::recordings::Sizes;
    use crate::recordings::format::{Recorder, State, Step};
    use crate::replay::Uniform;

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
        let mut env = env::make_inspect(TASK).unwrap();
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

    fn collector(demonstrations: Demonstrations, p_d: f64, p_r: f64) -> Collector {
        let settings = DemonstrationSettings {
            probability: p_d,
            reset_probability: p_r,
            decay: 1.0,
            ..DemonstrationSettings::default()
        };
        let episode = |name| Episode::new(env::make(TASK).unwrap().0, stream(1, name), false);
        let side = Side::new(
            episode("segment-env"),
            Arc::new(demonstrations),
            Segments::new(&settings),
            SEGMENT,
            stream(1, "segments"),
        );
        Collector::new(vec![Source::new(
            episode("env"),
            Some(side),
            stream(1, "exploration"),
        )])
    }

    /// Steps of zero action, and of each: whether it was one of the main episode, the observation and
    /// previous action it was taken on, and whether it ended the main episode.
    fn run(collector: &mut Collector, steps: usize) -> Vec<(bool, Vec<f32>, Vec<f32>, bool)> {
        let mut replay = ReplayBuffer::new(steps, 11, 2);
        let mut moments = RunningMoments::new(11);
        collector.reset(&mut moments);
        let taken = (0..steps).map(|_| {
            let source = &collector.sources[0];
            let (obs, previous) = (&source.current().obs, &source.current().previous_action);
            let (obs, previous) = (obs.clone(), previous.clone());
            let main = source.side.as_ref().is_none_or(|side| side.in_main);
            let mut sinks = Sinks {
                replay: &mut replay,
                sampler: &mut Uniform,
                moments: &mut moments,
                reservoir: None,
            };
            let taken = collector.round(&mut [Zero.another()], &mut sinks).unwrap();
            (main, obs, previous, taken[0].ended.is_some())
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
        let mut collector = collector(recorded(directory.path()), 1.0, 0.0);
        let mut seen = std::collections::BTreeSet::new();
        for (t, (main, _, previous, _)) in run(&mut collector, 700).into_iter().enumerate() {
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
    fn an_episode_ends_where_the_pen_is_dropped_if_it_shall() {
        let first = |end_when_dropped, height| {
            let mut env = env::make_inspect("PenSpin-v0").unwrap();
            let mut observation = vec![0.0; env.spec().obs_size];
            env.reset(&mut stream(1, "env"), &mut observation);
            let mut qpos = env.qpos().to_vec();
            qpos[26] = height;
            let qvel = env.qvel().to_vec();
            let start = Start {
                qpos: &qpos,
                qvel: &qvel,
                previous_action: None,
                goal: &[],
            };
            env.start_at(&start, &mut observation);
            let mut episode = Episode::new(env, stream(1, "env"), end_when_dropped);
            episode.begin(&observation);
            let mut controller = Zero.another();
            let happened = episode.step(controller.as_mut(), &mut stream(1, "noise"));
            let happened = happened.unwrap();
            (happened.ended, happened.row.unwrap().terminated)
        };
        assert_eq!(first(true, -0.1), (true, true));
        assert_eq!(first(false, -0.1), (false, false));
        assert_eq!(first(true, 0.3), (false, false));
    }

    #[test]
    fn segments_of_no_demonstrations_begin_from_a_reset() {
        let mut collector = collector(Demonstrations::default(), 1.0, 0.0);
        for (t, (main, _, previous, _)) in run(&mut collector, 3 * SEGMENT as usize)
            .into_iter()
            .enumerate()
        {
            assert!(!main, "step {t}");
            assert_eq!(previous, [0.0, 0.0]);
        }
    }

    #[test]
    fn the_main_episode_goes_on_where_it_stood() {
        let directory = tempfile::tempdir().unwrap();
        let demonstrations = recorded(directory.path());
        let mixed = run(&mut collector(demonstrations, 0.4, 0.3), 2000);
        // The same main environment alone, from the same stream.
        let episode = Episode::new(env::make(TASK).unwrap().0, stream(1, "env"), false);
        let main: Vec<_> = mixed.iter().filter(|taken| taken.0).collect();
        let source = Source::new(episode, None, stream(1, "exploration"));
        let alone = run(&mut Collector::new(vec![source]), main.len());
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
        let recording = crate::recordings::format::Recording::open(fixture.as_ref()).unwrap();
        let checked = env::make_inspect(id).unwrap();
        let sizes = Sizes::of(checked.spec());
        let demonstrations = Demonstrations::load(fixture, &sizes).unwrap();
        let mut episode = Episode::new(env::make(id).unwrap().0, stream(2, "segment-env"), false);
        let recorded = recording.obs.as_ref().unwrap();
        let first = recording.qpos.get(0).unwrap();
        let mut goals: Vec<Vec<f32>> = Vec::new();
        for _ in 0..20 {
            episode.start_in(&demonstrations);
            let (state, goal) = episode.obs.split_at(109);
            let near = |row: &[f64]| {
                let pairs = row.iter().zip(state);
                pairs.fold(0.0f64, |m, (a, b)| m.max((a - f64::from(*b)).abs())) < 1e-5
            };
            let t = (0..14).find(|&t| near(recorded.get(t).unwrap()));
            let t = t.expect("the state of some row");
            let previous = t.checked_sub(1).and_then(|t| recording.action.get(t));
            let expected = previous.map_or(0.0, |action| action[7] as f32);
            assert!((episode.previous_action[7] - expected).abs() < 1e-6);
            let wide: Vec<f64> = goal.iter().map(|x| f64::from(*x)).collect();
            assert!(checked.goal_error(first, &wide, true) < 1e-6, "{wide:?}");
            assert!(!goals.contains(&goal.to_vec()), "drawn anew each time");
            goals.push(goal.to_vec());
        }
    }
}
