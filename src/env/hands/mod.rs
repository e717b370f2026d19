//! The Dexterous Gym hand tasks: figures and rules as published with dexterous_gym 0.1.7 and, for
//! PenSpin's hand and pen, gym 0.15.3.
//!
//! Every task is a point of layout x object x reward, and every scene is composed from one hand.

mod layout;
mod pen_spin;
mod pose;
mod scene;
mod two_hands;

use std::sync::Arc;

use mujoco_rs::Model;

use super::Inspect;
use super::noise;
use super::registry::Entry;
use super::scene::Scene;
use super::simulation::Simulation;
use super::task::{Block, Command, Info, Recorded, Task, Velocity, block, goal};
use crate::core::random::Stream;
use layout::{
    CATCH_OVERARM, CATCH_UNDERARM, CATCH_UNDERARM_HARD, HAND_OVER, Layout, SPIN, TWO_CATCH_UNDERARM,
};
use pen_spin::{PenSpin, Spin};
use scene::Object;
use two_hands::{Handle, Reward, TwoHands};

pub use scene::{HandScene, PenInertia};

/// Joints of a hand without its mount.
const HAND_JOINTS: usize = 24;
/// Control steps for which objects settle in the hands.
const SETTLING_STEPS: usize = 10;
/// Height in metres below which an object has fallen past the hands; in no published recording is one below 0.07.
const DROPPED: f64 = 0.04;
/// Physics steps of a control step.
const FRAME_SKIP: usize = 20;
/// Control steps of an episode.
const SPIN_STEPS: usize = 250;
const TWO_HAND_STEPS: usize = 75;

const HAND_OVER_OBSERVATION: &[Block] = &[
    block(24, "hand 1: positions of wrist and finger joints"),
    block(24, "hand 1: their velocities"),
    block(24, "hand 2: positions"),
    block(24, "hand 2: velocities"),
    block(7, "object: position and quaternion"),
    block(
        6,
        "object: linear and angular velocity, the latter in its own frame",
    ),
    goal(7, "goal: position and quaternion"),
];

const CATCH_OBSERVATION: &[Block] = &[
    block(
        30,
        "hand 1: positions of mount (3 slides, 3 hinges), wrist and finger joints",
    ),
    block(30, "hand 1: their velocities"),
    block(30, "hand 2: positions"),
    block(30, "hand 2: velocities"),
    block(7, "object: position and quaternion"),
    block(
        6,
        "object: linear and angular velocity, the latter in its own frame",
    ),
    goal(7, "goal: position and quaternion"),
];

const TWO_OBJECTS_OBSERVATION: &[Block] = &[
    block(
        30,
        "hand 1: positions of mount (3 slides, 3 hinges), wrist and finger joints",
    ),
    block(30, "hand 1: their velocities"),
    block(30, "hand 2: positions"),
    block(30, "hand 2: velocities"),
    block(7, "object 1: position and quaternion"),
    block(
        6,
        "object 1: linear and angular velocity, the latter in its own frame",
    ),
    block(7, "object 2: position and quaternion"),
    block(6, "object 2: linear and angular velocity"),
    goal(7, "goal of object 1: position and quaternion"),
    goal(7, "goal of object 2"),
];

const SPIN_OBSERVATION: &[Block] = &[
    block(24, "positions of wrist and finger joints"),
    block(24, "their velocities"),
    block(3, "pen: linear velocity"),
    block(3, "pen: angular velocity in its own frame"),
    block(3, "pen: position"),
    block(4, "pen: quaternion"),
];

/// A family of two-hand tasks as the reader and the registry see it.
struct Family {
    /// Its ids: this before the object's name, this after.
    id: [&'static str; 2],
    layout: &'static Layout,
    /// What is to be done, with {} for the object.
    summary: &'static str,
    observation: &'static [Block],
    /// The dense reward in words.
    reward: &'static str,
}

const FAMILIES: [Family; 5] = [
    Family {
        id: ["", "HandOver"],
        layout: &HAND_OVER,
        summary: "two fixed hands; pass the {} from hand 1 to hand 2, to a goal pose",
        observation: HAND_OVER_OBSERVATION,
        reward: "exp(-(20 d + angle)), d metres and angle radians from object to goal",
    },
    Family {
        id: ["", "CatchUnderarm"],
        layout: &CATCH_UNDERARM,
        summary: "two moving hands, palms up; throw the {} and catch it at a goal pose",
        observation: CATCH_OBSERVATION,
        reward: "exp(-0.2 (50 d + angle)), d metres and angle radians from object to goal",
    },
    Family {
        id: ["", "CatchUnderarmHard"],
        layout: &CATCH_UNDERARM_HARD,
        summary: "two moving hands far apart, palms up; throw the {} and catch it at a goal pose",
        observation: CATCH_OBSERVATION,
        reward: "exp(-0.2 (50 d + angle)), d metres and angle radians from object to goal",
    },
    Family {
        id: ["", "CatchOverarm"],
        layout: &CATCH_OVERARM,
        summary: "two moving hands held upright; throw the {} overarm and catch it at a goal pose",
        observation: CATCH_OBSERVATION,
        reward: "exp(-0.2 (50 d + angle)), d metres and angle radians from object to goal",
    },
    Family {
        id: ["Two", "CatchUnderArm"],
        layout: &TWO_CATCH_UNDERARM,
        summary: "two moving hands with an object ({}) each; throw and catch both at once",
        observation: TWO_OBJECTS_OBSERVATION,
        reward: "the sum over both objects of exp(-0.2 (50 d + angle))",
    },
];

/// All hand tasks.
pub fn entries() -> Vec<Entry> {
    let mut entries = vec![pen_spin()];
    for reward in [Reward::Dense, Reward::Sparse] {
        for family in &FAMILIES {
            for object in [Object::Egg, Object::Block, Object::Pen] {
                entries.push(two_hands(family, object, reward));
            }
        }
    }
    entries
}

fn pen_spin() -> Entry {
    let info = Info {
        id: "PenSpin-v0",
        summary: "one hand; keep the pen spinning about its x axis, level",
        scene: scene(&SPIN, Object::Pen),
        frame_skip: FRAME_SKIP,
        max_episode_steps: SPIN_STEPS,
        observation: SPIN_OBSERVATION,
        reward: "angular velocity about the pen's x axis - 15 |height between its ends|",
        termination: "never",
        reset: "the pen's position normal with deviation 0.005, then 10 control steps at rest; again \
                if it fell",
        velocity: Velocity::None,
        drops: true,
        relative: false,
    };
    Entry {
        info,
        simulation: Box::new(move |model| {
            let task = PenSpin::new(&model)?;
            Ok(Box::new(Simulation::new(model, &info, task)?) as Box<dyn Inspect>)
        }),
        rules: Box::new(|model, _| Ok(Arc::new(Spin::new(model)))),
    }
}

fn two_hands(family: &'static Family, object: Object, reward: Reward) -> Entry {
    let layout = family.layout;
    let info = Info {
        id: kept(id(family, object, reward)),
        summary: kept(family.summary.replace("{}", object.name())),
        scene: scene(layout, object),
        frame_skip: FRAME_SKIP,
        max_episode_steps: TWO_HAND_STEPS,
        observation: family.observation,
        reward: match reward {
            Reward::Dense => family.reward,
            Reward::Sparse => "0 within 1 cm and 0.1 rad of the goal, -1 elsewhere",
        },
        termination: "never; success (within 1 cm and 0.1 rad of the goal) does not end an episode",
        reset: reset(layout, object),
        velocity: Velocity::None,
        drops: reward == Reward::Dense,
        relative: false,
    };
    Entry {
        info,
        simulation: Box::new(move |model| {
            let task = TwoHands::new(layout, object, reward, &model)?;
            Ok(Box::new(Simulation::new(model, &info, task)?) as Box<dyn Inspect>)
        }),
        rules: Box::new(move |_, _| Ok(Arc::new(Handle::new(layout, reward)))),
    }
}

fn id(family: &Family, object: Object, reward: Reward) -> String {
    let object = match object {
        Object::Egg => "Egg",
        Object::Block => "Block",
        Object::Pen => "Pen",
    };
    let reward = match reward {
        Reward::Dense => "",
        Reward::Sparse => "Sparse",
    };
    let [before, after] = family.id;
    format!("{before}{object}{after}{reward}-v0")
}

fn reset(layout: &Layout, object: Object) -> &'static str {
    match (layout.beginning, object) {
        (layout::Beginning::Poised(_), _) => {
            "always the same, hand 2 ready to throw; the goal at random"
        }
        (_, Object::Pen) => "always the same, 10 control steps at rest; the goal at random",
        (..) => "the object turned at random, 10 control steps at rest; the goal at random",
    }
}

fn scene(layout: &'static Layout, object: Object) -> Scene {
    Scene::Hands(HandScene {
        layout,
        object,
        inertia: PenInertia::default(),
        watched: false,
    })
}

/// A text that lives as long as the registry, which is built once.
fn kept(text: String) -> &'static str {
    Box::leak(text.into_boxed_str())
}

/// The collision shapes of the forearms, which only approximate the published ones.
fn forearms(layout: &Layout, model: &Model) -> mujoco_rs::Result<Vec<usize>> {
    (0..layout.mounts.len())
        .map(|i| {
            let name = format!("robot0:C_forearm{}", scene::suffix(i));
            model.id(mujoco_rs::Object::Geom, &name)
        })
        .collect()
}

/// What a task's scene is with the pens' inertia as told, and watched or not.
pub fn variant(scene: Scene, inertia: PenInertia, watched: bool) -> Scene {
    match scene {
        Scene::Hands(hands) => Scene::Hands(HandScene {
            inertia,
            watched,
            ..hands
        }),
        Scene::File(name) => Scene::File(name),
    }
}
