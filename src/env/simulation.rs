//! The machinery that all tasks share: frame skip, time limit, divergence, saving and restoring.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::Inspect;
use super::task::{Command, Info, Recorded, Task};
use crate::core::random::Stream;
use crate::core::span::Span;
use crate::task::{Env, EnvState, Spec, Start, StateMismatch, Step};

/// A start that is refused this often is taken as it is; the model is broken then.
const MOST_STARTS: usize = 100;

/// A task running on MuJoCo.
pub struct Simulation<T: Task> {
    spec: Spec,
    task: T,
    data: Data,
    frame_skip: usize,
    servos: Vec<Servo>,
    carried: T::Carried,
    elapsed_steps: usize,
    /// How often a buffer had been full before the next step, as MuJoCo counts.
    told_full: usize,
    watch: Option<Watch>,
}

/// How one number of an action becomes the command of an actuator.
#[derive(Debug, Clone, Copy)]
struct Servo {
    centre: f64,
    half_range: f64,
    low: f64,
    high: f64,
}

/// A second simulation that is only looked at: which of these geoms something came near to.
struct Watch {
    data: Data,
    geoms: Vec<usize>,
    touched: bool,
}

impl Watch {
    /// Looks at the positions `qpos`.
    fn look(&mut self, qpos: &[f64]) {
        self.data.qpos_mut().copy_from_slice(qpos);
        // A state that cannot be computed is noticed where it is simulated.
        let _ = self.data.forward();
        let watched = |geom| self.geoms.contains(&geom);
        let mut contacts = self.data.contacts();
        self.touched |= contacts.any(|pair| pair.into_iter().any(watched));
    }
}

impl<T: Task> Simulation<T> {
    /// A simulation of the task on its compiled model, in the model's initial state.
    ///
    /// # Errors
    /// If MuJoCo cannot set the simulation up.
    pub fn new(model: Arc<Model>, info: &Info, task: T) -> mujoco_rs::Result<Self> {
        let mut data = Data::new(Arc::clone(&model))?;
        data.forward()?;
        let ranges = command_ranges(&model)?;
        let servos: Vec<Servo> = ranges.iter().map(|range| Servo::over(*range)).collect();
        let action_ranges = match T::COMMAND {
            Command::Action => ranges,
            Command::Range => vec![Span::symmetric(1.0); ranges.len()],
        };
        Ok(Self {
            spec: Spec {
                id: info.id.to_owned(),
                obs_size: info.obs_size(),
                goal_size: info.goal_size(),
                action_size: model.nu(),
                action_ranges,
                max_episode_steps: info.max_episode_steps,
                dt: model.timestep() * info.frame_skip as f64,
                nq: model.nq(),
                nv: model.nv(),
            },
            carried: task.carry(&data),
            frame_skip: info.frame_skip,
            servos,
            task,
            data,
            elapsed_steps: 0,
            told_full: 0,
            watch: None,
        })
    }

    /// Commands the actuators as `action` says.
    fn set_command(&mut self, action: &[f64]) {
        let ctrl = self.data.ctrl_mut();
        match T::COMMAND {
            Command::Action => ctrl.copy_from_slice(action),
            Command::Range => {
                for ((ctrl, servo), a) in ctrl.iter_mut().zip(&self.servos).zip(action) {
                    *ctrl = servo.command(*a);
                }
            }
        }
    }

    /// Advances the physics by `steps` of its own steps; false if the simulation broke down.
    fn advance(&mut self, steps: usize) -> bool {
        let stepped = match &mut self.watch {
            None => self.data.step_n(steps).is_ok(),
            Some(watch) => {
                watch.touched = false;
                (0..steps).all(|_| {
                    watch.look(self.data.qpos());
                    self.data.step().is_ok()
                })
            }
        };
        let forces = !T::CONTACT_FORCES || self.data.rne_post_constraint().is_ok();
        stepped && forces && !self.data.warnings().diverged()
    }

    /// Writes a state over a cleared simulation and computes what depends on it.
    fn place(&mut self, qpos: &[f64], qvel: &[f64]) {
        // A reset fails only if MuJoCo itself is broken; the first step then reports it, as it
        // reports a state that cannot be computed.
        let _ = self.data.reset();
        self.data.qpos_mut().copy_from_slice(qpos);
        self.data.qvel_mut().copy_from_slice(qvel);
        let _ = self.data.forward();
    }

    /// Lets the state rest under the zero action; false if the simulation broke down.
    fn settle_down(&mut self) -> bool {
        let steps = self.task.settling_steps();
        if steps == 0 {
            return true;
        }
        self.set_command(&vec![0.0; self.spec.action_size]);
        let sound = self.advance(steps * self.frame_skip);
        sound && self.data.forward().is_ok()
    }

    /// Observes the state with which an episode begins.
    fn begin(&mut self, observation: &mut [f64]) {
        self.elapsed_steps = 0;
        // Of a buffer that was full while the objects settled, the first step tells.
        self.told_full = 0;
        self.carried = self.task.carry(&self.data);
        self.observe(observation);
    }

    /// Writes the observation; false, and zeros, if it holds a number that is not finite.
    fn observe(&self, observation: &mut [f64]) -> bool {
        let (state, goal) = observation.split_at_mut(self.spec.obs_size - self.spec.goal_size);
        self.task.observe(&self.data, state);
        goal.copy_from_slice(self.task.goal());
        let finite = observation.iter().all(|x| x.is_finite());
        if !finite {
            observation.fill(0.0);
        }
        finite
    }
}

impl Servo {
    fn over(range: Span) -> Servo {
        Servo {
            centre: range.middle(),
            half_range: range.half(),
            low: range.low,
            high: range.high,
        }
    }

    fn command(&self, action: f64) -> f64 {
        let command = self.centre + action.clamp(-1.0, 1.0) * self.half_range;
        command.clamp(self.low, self.high)
    }
}

/// What each actuator of `model` can be commanded. A policy explores a range; where there is none, no command
/// could be learned.
fn command_ranges(model: &Model) -> mujoco_rs::Result<Vec<Span>> {
    let ranges = model.actuator_ctrlrange().as_chunks::<2>().0.iter();
    let checked = ranges.enumerate().map(|(i, &[low, high])| {
        // Of an actuator without limits MuJoCo says 0 to 0.
        if low < high {
            Ok(Span { low, high })
        } else {
            Err(mujoco_rs::Error::NoCommandRange(i))
        }
    });
    checked.collect()
}

impl<T: Task> Env for Simulation<T> {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut Stream, observation: &mut [f64]) {
        let mut qpos = vec![0.0; self.spec.nq];
        let mut qvel = vec![0.0; self.spec.nv];
        for _ in 0..MOST_STARTS {
            qpos.copy_from_slice(self.data.model().qpos0());
            qvel.fill(0.0);
            self.task.start(rng, &mut qpos, &mut qvel);
            self.place(&qpos, &qvel);
            if self.settle_down() && self.task.accepts(&self.data) {
                break;
            }
        }
        let goal = self.draw_goal(rng, self.data.qpos());
        self.task.set_goal(&goal);
        self.begin(observation);
    }

    fn draw_goal(&self, rng: &mut Stream, qpos: &[f64]) -> Vec<f64> {
        let mut goal = vec![0.0; self.spec.goal_size];
        self.task.draw_goal(rng, qpos, &mut goal);
        goal
    }

    fn start_at(&mut self, start: &Start<'_>, observation: &mut [f64]) {
        self.place(start.qpos, start.qvel);
        if let Some(action) = start.previous_action {
            self.set_command(action);
            let _ = self.data.forward();
        }
        self.task.set_goal(start.goal);
        self.begin(observation);
    }

    fn step(&mut self, action: &[f64], observation: &mut [f64]) -> Step {
        let before = self.carried;
        self.set_command(action);
        let sound = self.advance(self.frame_skip);
        self.elapsed_steps += 1;
        self.carried = self.task.carry(&self.data);
        let finite = self.observe(observation);
        let full = self.data.warnings().buffers_full();
        let buffer_full = full > std::mem::replace(&mut self.told_full, full);
        let success = self.task.success(&self.data);
        let reward = self.task.reward(&before, &self.carried, &self.data, action);
        if !(sound && finite && reward.is_finite()) {
            observation.fill(0.0);
            return Step {
                reward: 0.0,
                terminated: false,
                truncated: true,
                diverged: true,
                buffer_full,
                dropped: false,
                // Of a task that knows success, a failure.
                success: success.map(|_| false),
            };
        }
        Step {
            reward,
            terminated: self.task.terminated(&self.data),
            truncated: self.elapsed_steps >= self.spec.max_episode_steps,
            diverged: false,
            buffer_full,
            dropped: self.task.dropped(&self.data),
            success,
        }
    }

    fn snapshot(&self) -> EnvState {
        EnvState {
            time: self.data.time(),
            qpos: self.data.qpos().to_vec(),
            qvel: self.data.qvel().to_vec(),
            act: self.data.act().to_vec(),
            ctrl: self.data.ctrl().to_vec(),
            qacc_warmstart: self.data.qacc_warmstart().to_vec(),
            carried: self.carried.as_ref().to_vec(),
            goal: self.task.goal().to_vec(),
            elapsed_steps: self.elapsed_steps,
        }
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), StateMismatch> {
        let model = Arc::clone(self.data.model());
        let lengths = [
            ("qpos", state.qpos.len(), model.nq()),
            ("qvel", state.qvel.len(), model.nv()),
            ("act", state.act.len(), model.na()),
            ("ctrl", state.ctrl.len(), model.nu()),
            ("qacc_warmstart", state.qacc_warmstart.len(), model.nv()),
            ("carried", state.carried.len(), self.carried.as_ref().len()),
            ("goal", state.goal.len(), self.spec.goal_size),
        ];
        for (part, found, expected) in lengths {
            if found != expected {
                return Err(StateMismatch {
                    id: self.spec.id.clone(),
                    part,
                    expected,
                    found,
                });
            }
        }
        // Clears the warnings and whatever error stopped the simulation before; every array that
        // the next step reads is written below.
        let _ = self.data.reset();
        self.told_full = 0;
        self.data.set_time(state.time);
        self.data.qpos_mut().copy_from_slice(&state.qpos);
        self.data.qvel_mut().copy_from_slice(&state.qvel);
        self.data.act_mut().copy_from_slice(&state.act);
        self.data.ctrl_mut().copy_from_slice(&state.ctrl);
        let warmstart = self.data.qacc_warmstart_mut();
        warmstart.copy_from_slice(&state.qacc_warmstart);
        self.carried.as_mut().copy_from_slice(&state.carried);
        self.task.set_goal(&state.goal);
        self.elapsed_steps = state.elapsed_steps;
        Ok(())
    }
}

impl<T: Task> Inspect for Simulation<T> {
    fn set_state(&mut self, qpos: &[f64], qvel: &[f64]) {
        self.data.qpos_mut().copy_from_slice(qpos);
        self.data.qvel_mut().copy_from_slice(qvel);
        self.carried = self.task.carry(&self.data);
    }

    fn set_warmstart(&mut self, qacc_warmstart: &[f64]) {
        let warmstart = self.data.qacc_warmstart_mut();
        warmstart.copy_from_slice(qacc_warmstart);
    }

    fn settle(&mut self, observation: &mut [f64]) {
        self.settle_down();
        self.begin(observation);
    }

    fn watch(&mut self, model: Arc<Model>) -> mujoco_rs::Result<()> {
        self.watch = Some(Watch {
            data: Data::new(model)?,
            geoms: self.task.recorded().approximate_geoms,
            touched: false,
        });
        Ok(())
    }

    fn touched(&self) -> bool {
        self.watch.as_ref().is_some_and(|watch| watch.touched)
    }

    fn recorded(&self) -> Recorded {
        self.task.recorded()
    }

    fn achieved_goal(&self) -> Vec<f64> {
        let mut achieved = vec![0.0; self.spec.goal_size];
        self.task.achieved_goal(&self.data, &mut achieved);
        achieved
    }

    fn shown_qpos(&self) -> Vec<f64> {
        let mut qpos = self.data.qpos().to_vec();
        self.task.place_targets(&mut qpos);
        qpos
    }

    fn goal_error(&self, qpos: &[f64], goal: &[f64], settled: bool) -> f64 {
        self.task.goal_error(qpos, goal, settled)
    }

    fn settling_time(&self) -> f64 {
        self.task.settling_steps() as f64 * self.spec.dt
    }

    fn qpos(&self) -> &[f64] {
        self.data.qpos()
    }

    fn qvel(&self) -> &[f64] {
        self.data.qvel()
    }

    fn ctrl(&self) -> &[f64] {
        self.data.ctrl()
    }
}
