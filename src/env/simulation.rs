//! The machinery that all tasks share: frame skip, time limit, divergence, saving and restoring.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::task::Task;
use super::{Env, EnvState, Replay, Spec, StateMismatch, Step};
use crate::random::Stream;

/// A task running on MuJoCo.
pub struct Simulation<T: Task> {
    spec: Spec,
    task: T,
    data: Data,
    carried: T::Carried,
    elapsed_steps: usize,
}

impl<T: Task> Simulation<T> {
    /// A simulation of the task on its compiled model, in the model's initial state.
    ///
    /// # Errors
    /// If MuJoCo cannot set the simulation up.
    pub fn new(model: Arc<Model>) -> mujoco_rs::Result<Self> {
        let info = T::INFO;
        let task = T::new(&model)?;
        let mut data = Data::new(Arc::clone(&model))?;
        data.forward()?;
        Ok(Self {
            spec: Spec {
                id: info.id.to_owned(),
                obs_size: info.obs_size(),
                action_size: model.nu(),
                action_limit: model.actuator_ctrlrange().get(1).copied().unwrap_or(1.0),
                max_episode_steps: info.max_episode_steps,
                dt: super::task::dt::<T>(&model),
            },
            carried: task.carry(&data),
            task,
            data,
            elapsed_steps: 0,
        })
    }

    /// Advances the physics; false if the simulation broke down.
    fn advance(&mut self, action: &[f64]) -> bool {
        self.data.ctrl_mut().copy_from_slice(action);
        let stepped = self.data.step_n(T::INFO.frame_skip).is_ok();
        let forces = !T::CONTACT_FORCES || self.data.rne_post_constraint().is_ok();
        stepped && forces && !self.data.warnings().diverged()
    }

    /// Computes what depends on the state just written and observes it.
    fn begin(&mut self, observation: &mut [f64]) {
        // A failure here leaves zeros to observe and the first step reports the divergence.
        let _ = self.data.forward();
        self.elapsed_steps = 0;
        self.carried = self.task.carry(&self.data);
        self.task.observe(&self.data, observation);
        clear_unless_finite(observation);
    }
}

/// Overwrites an observation that holds a number that is not finite; false if it did.
fn clear_unless_finite(observation: &mut [f64]) -> bool {
    let finite = observation.iter().all(|x| x.is_finite());
    if !finite {
        observation.fill(0.0);
    }
    finite
}

impl<T: Task> Env for Simulation<T> {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut Stream, observation: &mut [f64]) {
        let mut qpos = self.data.model().qpos0().to_vec();
        let mut qvel = vec![0.0; self.data.model().nv()];
        self.task.start(rng, &mut qpos, &mut qvel);
        self.start_at(&qpos, &qvel, observation);
    }

    fn step(&mut self, action: &[f64], observation: &mut [f64]) -> Step {
        let before = self.carried;
        let sound = self.advance(action);
        self.elapsed_steps += 1;
        self.carried = self.task.carry(&self.data);
        self.task.observe(&self.data, observation);
        let reward = self.task.reward(&before, &self.carried, &self.data, action);
        if !(sound && clear_unless_finite(observation) && reward.is_finite()) {
            observation.fill(0.0);
            return Step {
                reward: 0.0,
                terminated: false,
                truncated: true,
                diverged: true,
            };
        }
        Step {
            reward,
            terminated: self.task.terminated(&self.data),
            truncated: self.elapsed_steps >= self.spec.max_episode_steps,
            diverged: false,
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
        self.data.set_time(state.time);
        self.data.qpos_mut().copy_from_slice(&state.qpos);
        self.data.qvel_mut().copy_from_slice(&state.qvel);
        self.data.act_mut().copy_from_slice(&state.act);
        self.data.ctrl_mut().copy_from_slice(&state.ctrl);
        let warmstart = self.data.qacc_warmstart_mut();
        warmstart.copy_from_slice(&state.qacc_warmstart);
        self.carried.as_mut().copy_from_slice(&state.carried);
        self.elapsed_steps = state.elapsed_steps;
        Ok(())
    }
}

impl<T: Task> Replay for Simulation<T> {
    fn start_at(&mut self, qpos: &[f64], qvel: &[f64], observation: &mut [f64]) {
        // A reset fails only if MuJoCo itself is broken; the first step then reports it.
        let _ = self.data.reset();
        self.data.qpos_mut().copy_from_slice(qpos);
        self.data.qvel_mut().copy_from_slice(qvel);
        self.begin(observation);
    }

    fn set_state(&mut self, qpos: &[f64], qvel: &[f64]) {
        self.data.qpos_mut().copy_from_slice(qpos);
        self.data.qvel_mut().copy_from_slice(qvel);
        self.carried = self.task.carry(&self.data);
    }

    fn set_warmstart(&mut self, qacc_warmstart: &[f64]) {
        let warmstart = self.data.qacc_warmstart_mut();
        warmstart.copy_from_slice(qacc_warmstart);
    }

    fn qpos(&self) -> &[f64] {
        self.data.qpos()
    }

    fn qvel(&self) -> &[f64] {
        self.data.qvel()
    }
}
