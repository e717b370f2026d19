//! Scenes of the hand tasks, composed as MJCF text from one hand, a mount, a layout and an object.

use std::fmt::Write as _;

use super::layout::{Layout, Mount};

const SCENE: &str = include_str!("../../../assets/mjcf/hands/scene.xml");
const HAND: &str = include_str!("../../../assets/mjcf/hands/shadow_hand.xml");
const SHAPES: &str = include_str!("../../../assets/mjcf/hands/hand_shapes.xml");
const MOUNT_JOINTS: &str = include_str!("../../../assets/mjcf/hands/mount_joints.xml");
const MOUNT_ACTUATORS: &str = include_str!("../../../assets/mjcf/hands/mount_actuators.xml");
const EGG: &str = include_str!("../../../assets/mjcf/hands/egg.xml");
const BLOCK: &str = include_str!("../../../assets/mjcf/hands/block.xml");
const PEN: &str = include_str!("../../../assets/mjcf/hands/pen.xml");

/// What the hands handle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Object {
    /// An ellipsoid.
    Egg,
    /// A cube.
    Block,
    /// A capsule.
    Pen,
}

/// Which mass and inertia pens have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum PenInertia {
    /// Those of the published tasks: a capsule counted as a cylinder as long as its straight part and
    /// one radius, as in MuJoCo before 2.1.1.
    #[default]
    Published,
    /// Those that the installed MuJoCo derives from the capsule.
    Derived,
}

/// A scene: layout, object and inertia of pens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandScene {
    /// Where things are.
    pub layout: &'static Layout,
    /// What is handled.
    pub object: Object,
    /// Mass and inertia, if that is a pen.
    pub inertia: PenInertia,
    /// Whether contacts with the forearms are listed from as far as their shape may differ from the
    /// published one: a scene to look at, not to simulate.
    pub watched: bool,
}

/// How far the published forearm may reach beyond ours, in metres: the largest deviation is 2.4 mm.
const FOREARM_DEVIATION: &str = "0.0025";

/// Explicit inertial of the published pens.
const PEN_INERTIAL: &str = "<inertial pos=\"0 0 0\" mass=\"0.04182088140458733\" \
     diaginertia=\"0.00015144735185981228 0.00015144735185981228 0.0000013382682049467946\"/>";

/// Quaternion with which pens start.
const PEN_QUATERNION: [f64; 4] = [
    0.7701511529340699,
    -0.42073549240394825,
    0.42073549240394825,
    -0.22984884706593015,
];

/// Colours of the hands' skin and finger pads, and of the objects.
const SKIN: [&str; 2] = ["0.72 0.74 0.78 1", "0.52 0.60 0.72 1"];
const PADS: [&str; 2] = ["0.93 0.62 0.24 1", "0.36 0.70 0.66 1"];
const COLOURS: [&str; 2] = ["0.93 0.84 0.42", "0.80 0.36 0.40"];

/// A file of a composed model: its name and its MJCF text.
pub type File = (String, String);

impl HandScene {
    /// The name under which the compiled scene is kept.
    pub fn name(&self) -> String {
        let inertia = match self.inertia {
            PenInertia::Published => "",
            PenInertia::Derived => "_derived_inertia",
        };
        let watched = if self.watched { "_watched" } else { "" };
        format!(
            "{}_{}{inertia}{watched}",
            self.object.name(),
            self.layout.name
        )
    }

    /// The scene's MJCF and the files it includes, but for `look.xml`.
    pub fn compose(&self) -> (String, Vec<File>) {
        let mut files = vec![("hand_shapes.xml".to_owned(), SHAPES.to_owned())];
        let mounts = self.layout.mounts.iter().enumerate();
        for (i, mount) in mounts.clone() {
            files.push(self.hand(i, mount));
        }
        for i in 0..self.layout.places.len() {
            files.push(self.object(i));
        }
        if self.layout.moving {
            for (i, _) in mounts.rev() {
                let name = format!("mount_actuators{}.xml", suffix(i));
                files.push((name, MOUNT_ACTUATORS.replace('@', suffix(i))));
            }
        }
        let parts = files[1..]
            .iter()
            .fold(String::new(), |mut text, (file, _)| {
                let _ = writeln!(text, "  <include file=\"{file}\"/>");
                text
            });
        let [position, up] = self.camera();
        let scene = fill(
            SCENE,
            &[
                ("{name}", &self.name()),
                ("{floor}", &self.layout.floor.to_string()),
                ("{camera_pos}", &numbers(&position)),
                ("{camera_up}", &numbers(&up)),
                ("{parts}", parts.trim_end()),
            ],
        );
        (scene, files)
    }

    /// Position and upward axis of the camera.
    fn camera(&self) -> [[f64; 3]; 2] {
        let view = &self.layout.view;
        let (sin, cos) = view.elevation.to_radians().sin_cos();
        let [x, y, z] = view.middle;
        let position = [x + view.distance * cos, y, z + view.distance * sin];
        [position, [-sin, 0.0, cos]]
    }

    fn hand(&self, i: usize, mount: &Mount) -> File {
        let joints = if self.layout.moving {
            MOUNT_JOINTS.trim()
        } else {
            ""
        };
        let margin = if self.watched {
            format!("margin=\"{FOREARM_DEVIATION}\"")
        } else {
            String::new()
        };
        let text = fill(
            HAND,
            &[
                ("{forearm_margin}", &margin),
                ("{mount_joints}", joints),
                ("{mount_pos}", &numbers(&mount.position)),
                ("{mount_quat}", &numbers(&mount.quaternion)),
                ("{skin}", SKIN[i]),
                ("{pad}", PADS[i]),
                ("@", suffix(i)),
            ],
        );
        (format!("shadow_hand{}.xml", suffix(i)), text)
    }

    fn object(&self, i: usize) -> File {
        let place = &self.layout.places[i];
        let target_quaternion = if self.layout.turned_targets {
            PEN_QUATERNION
        } else {
            [1.0, 0.0, 0.0, 0.0]
        };
        let inertial = match self.inertia {
            PenInertia::Published => PEN_INERTIAL,
            PenInertia::Derived => "",
        };
        let template = match self.object {
            Object::Egg => EGG,
            Object::Block => BLOCK,
            Object::Pen => PEN,
        };
        let text = fill(
            template,
            &[
                ("{object_pos}", &numbers(&place.object)),
                ("{object_quat}", &numbers(&PEN_QUATERNION)),
                ("{target_pos}", &numbers(&place.target)),
                ("{target_quat}", &numbers(&target_quaternion)),
                ("{inertial}", inertial),
                ("{colour}", COLOURS[i]),
                ("@", suffix(i)),
            ],
        );
        (format!("{}{}.xml", self.object.name(), suffix(i)), text)
    }
}

impl Object {
    /// Name in files and ids, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Object::Egg => "egg",
            Object::Block => "block",
            Object::Pen => "pen",
        }
    }
}

/// What the names of the `i`-th hand or object end in.
pub fn suffix(i: usize) -> &'static str {
    ["", "_2"][i]
}

fn fill(template: &str, words: &[(&str, &str)]) -> String {
    words
        .iter()
        .fold(template.to_owned(), |text, (word, value)| {
            text.replace(word, value)
        })
}

fn numbers(numbers: &[f64]) -> String {
    let words: Vec<String> = numbers.iter().map(f64::to_string).collect();
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::super::layout::{SPIN, TWO_CATCH_UNDERARM};
    use super::*;

    #[test]
    fn every_word_of_the_templates_is_filled_in() {
        for layout in [&SPIN, &TWO_CATCH_UNDERARM] {
            for object in [Object::Egg, Object::Block, Object::Pen] {
                let scene = HandScene {
                    layout,
                    object,
                    inertia: PenInertia::Published,
                    watched: false,
                };
                let (text, files) = scene.compose();
                for text in files.iter().map(|(_, text)| text).chain([&text]) {
                    // Comments may speak of the words.
                    for part in text.split("<!--") {
                        let bare = part.split("-->").last().unwrap_or(part);
                        assert!(!bare.contains(['@', '{', '}']), "{bare}");
                    }
                }
            }
        }
    }
}
