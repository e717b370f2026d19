//! Buffers of MuJoCo that are too small for what happens: steps in which contacts are left out say so.

use mamf::core::random::{Stream, stream};
use mamf::env::{Info, Scene, Simulation, Task, Velocity, block};
use mamf::task::Env;
use mujoco_rs::{Data, Model};
use std::sync::Arc;

/// Three balls that fall on a floor.
struct Balls;

impl Task for Balls {
    type Carried = [f64; 0];

    fn start(&self, _: &mut Stream, _: &mut [f64], _: &mut [f64]) {}

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        observation.copy_from_slice(data.qpos());
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], _: &Data, _: &[f64]) -> f64 {
        0.0
    }
}

const INFO: Info = Info {
    id: "Balls-v0",
    summary: "three balls that fall on a floor",
    scene: Scene::File("balls.xml"),
    frame_skip: 5,
    max_episode_steps: 100,
    observation: &[block(3, "heights")],
    reward: "none",
    termination: "never",
    reset: "above the floor",
    velocity: Velocity::None,
    drops: false,
    relative: false,
};

/// In which of 60 steps a buffer was full, with room for `contacts` contacts and `constraints` constraints.
fn full(contacts: usize, constraints: usize) -> Vec<bool> {
    let ball = |x: usize| {
        format!(
            "<body pos=\"{x} 0 0.3\"><joint name=\"j{x}\" type=\"slide\" axis=\"0 0 1\"/><geom size=\"0.1\"/></body>"
        )
    };
    let xml = format!(
        "<mujoco><size nconmax=\"{contacts}\" njmax=\"{constraints}\"/><worldbody>\
         <geom type=\"plane\" size=\"5 5 1\"/>{}</worldbody>\
         <actuator><motor joint=\"j0\" ctrllimited=\"true\" ctrlrange=\"-1 1\"/></actuator></mujoco>",
        [0, 1, 2].map(ball).concat()
    );
    let model = Arc::new(Model::from_xml(&xml).unwrap());
    let mut env = Simulation::new(model, &INFO, Balls).unwrap();
    let mut observation = [0.0; 3];
    env.reset(&mut stream(0, "env"), &mut observation);
    let step = |_| {
        let step = env.step(&[0.0], &mut observation);
        assert!(!step.diverged);
        step.buffer_full
    };
    (0..60).map(step).collect()
}

#[test]
fn steps_in_which_contacts_are_left_out_say_so() {
    assert!(full(100, 500).iter().all(|full| !full));
    for [contacts, constraints] in [[1, 500], [100, 4]] {
        let full = full(contacts, constraints);
        // Not while the balls fall; when they lie on the floor, always.
        assert!(!full[0], "{contacts} {constraints}");
        assert!(
            full[50..].iter().all(|full| *full),
            "{contacts} {constraints}: {full:?}"
        );
    }
}
